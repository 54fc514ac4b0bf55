//! Cells of the grid: all descriptors with the same R1 and R2, counted at once.

use std::sync::Arc;

use descriptor::grid::{Cell, CellSignatures, Region, RegionSignatures};
use descriptor::{ChannelError, Family, PreparedCloud};
use proto::task::GridCell;

use crate::executor::Executor;
use crate::executor::error::EvaluationError;
use crate::executor::manifest::{Manifest, labels};
use crate::executor::preparation_cache::PreparationCache;

impl Executor {
    /// How many queries each descriptor of a cell recognises.
    pub(super) async fn count_cell(
        &self,
        cache: &Arc<PreparationCache>,
        [disk_um, ring_um]: [u32; 2],
        task: &GridCell,
    ) -> Result<Vec<u32>, EvaluationError> {
        let (channel, prepared) = (Family::DiskRing, cache.preparer.family());
        let quantiser = cache.preparer.quantiser().ok_or(ChannelError::Family { channel, prepared })?;
        let cell = Arc::new(Cell::new(quantiser, disk_um, ring_um).map_err(ChannelError::from)?);
        let query = self.manifests(&task.query).await?;
        let database = self.manifests(&task.database).await?;
        let queries = self.cell_signatures(cache, &cell, &query).await?;
        let entries = self.cell_signatures(cache, &cell, &database).await?;
        self.matcher.loader.work().cells += 1;
        let labels = [labels(&query), labels(&database)];
        let count = move || cell.object_correct(&queries, &labels[0], &entries, &labels[1]);
        Ok(self.matcher.loader.computing.run(count).await?)
    }

    /// All signatures of some splits for one cell, one split after the other.
    async fn cell_signatures(
        &self,
        cache: &Arc<PreparationCache>,
        cell: &Arc<Cell>,
        manifests: &[Arc<Manifest>],
    ) -> Result<Vec<CellSignatures>, EvaluationError> {
        let (loader, disk_um) = (&self.matcher.loader, cell.disk_um());
        let mut signatures = Vec::new();
        for manifest in manifests {
            let (disks, cell) = (cache.disks(manifest.digest, disk_um), Arc::clone(cell));
            let wanted = if disks.is_some() { &[Region::Ring][..] } else { &[Region::Ring, Region::Disk] };
            let describe = move |clouds: &[Arc<PreparedCloud>]| -> Vec<Vec<RegionSignatures>> {
                let quantised: Vec<_> = clouds.iter().filter_map(|cloud| cloud.quantised()).collect();
                wanted.iter().map(|&region| cell.describe(region, &quantised)).collect()
            };
            let [mut rings, mut described] = [const { Vec::new() }; 2];
            for batch in loader.stream(cache, manifest, describe).await? {
                for (all, these) in [&mut rings, &mut described].into_iter().zip(batch) {
                    all.extend(these);
                }
            }
            let disks = disks.unwrap_or_else(|| {
                let disks = Arc::new(described);
                cache.keep_disks(manifest.digest, disk_um, &disks);
                disks
            });
            loader.work().disks_described += u64::from(wanted.len() > 1);
            signatures.extend(loader.computing.run(move || CellSignatures::join(&disks, &rings)).await);
        }
        Ok(signatures)
    }
}
