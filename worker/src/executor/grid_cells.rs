//! Cells of the grid: all descriptors with the same R1 and R2, counted at once.

use std::sync::Arc;

use descriptor::grid::{Cell, CellSignatures, DiskDistances, Region, RegionSignatures};
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
        cache.disks().retain(disk_um);
        let queries = self.cell_signatures(cache, &cell, &query).await?;
        let entries = self.cell_signatures(cache, &cell, &database).await?;
        let signatures = Arc::new([queries, entries]);
        let disks = self.disk_distances(cache, &cell, task, &signatures).await;
        self.matcher.loader.work().cells += 1;
        let labels = [labels(&query), labels(&database)];
        let count = move || {
            let [queries, entries] = &*signatures;
            cell.object_correct(disks.as_deref(), queries, &labels[0], entries, &labels[1])
        };
        Ok(self.matcher.loader.computing.run(count).await?)
    }

    /// What the disks contribute to all distances; `None` if there is no room to keep it.
    async fn disk_distances(
        &self,
        cache: &Arc<PreparationCache>,
        cell: &Arc<Cell>,
        task: &GridCell,
        signatures: &Arc<[Vec<CellSignatures>; 2]>,
    ) -> Option<Arc<DiskDistances>> {
        let (disk_um, splits) = (cell.disk_um(), [task.query.clone(), task.database.clone()]);
        let [queries, entries] = signatures.each_ref().map(Vec::len);
        let bytes = DiskDistances::bytes(cell, queries, entries);
        {
            let kept = cache.disks();
            let distances = kept.distances(disk_um, &splits);
            if distances.is_some() || !kept.admits(disk_um, bytes) {
                return distances;
            }
        }
        let (cell, signatures) = (Arc::clone(cell), Arc::clone(signatures));
        let compute = move || DiskDistances::new(&cell, &signatures[0], &signatures[1]);
        let distances = Arc::new(self.matcher.loader.computing.run(compute).await);
        cache.disks().keep_distances(disk_um, splits, &distances, bytes);
        self.matcher.loader.work().disks_compared += 1;
        Some(distances)
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
            let disks = cache.disks().of_split(disk_um, manifest.digest);
            let (describing, joining) = (Arc::clone(cell), Arc::clone(cell));
            let wanted = if disks.is_some() { &[Region::Ring][..] } else { &[Region::Ring, Region::Disk] };
            let describe = move |clouds: &[Arc<PreparedCloud>]| -> Vec<Vec<RegionSignatures>> {
                let quantised: Vec<_> = clouds.iter().filter_map(|cloud| cloud.quantised()).collect();
                wanted.iter().map(|&region| describing.describe(region, &quantised)).collect()
            };
            let [mut rings, mut described] = [const { Vec::new() }; 2];
            for batch in loader.stream(cache, manifest, describe).await? {
                for (all, these) in [&mut rings, &mut described].into_iter().zip(batch) {
                    all.extend(these);
                }
            }
            let disks = disks.unwrap_or_else(|| {
                let disks = Arc::new(described);
                cache.disks().keep_split(disk_um, manifest.digest, &disks);
                disks
            });
            loader.work().disks_described += u64::from(wanted.len() > 1);
            signatures.extend(loader.computing.run(move || joining.join(&disks, &rings)).await);
        }
        Ok(signatures)
    }
}
