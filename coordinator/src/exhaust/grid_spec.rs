//! What an exhaustive search asks: which descriptors on which training clouds. Its key names the answer for good.

use std::path::Path;

use descriptor::{Descriptor, EVALUATION_VERSION, GENES, Parameters};
use proto::Digest;
use results::{CellPoints, FinishedGrid};

use super::cells::CountedBy;
use super::grid::{Grid, GridError};
use super::optimum::Optimum;
use crate::dataset::{CloudEntry, Dataset};
use crate::experiment::Experiment;
use crate::result_cache::source::basis_name;

/// A grid and the clouds it is evaluated on.
#[derive(Clone, Debug)]
pub struct GridSpec {
    /// The descriptors.
    pub grid: Grid,
    /// Usable clouds of the first training set.
    pub queries: u32,
    /// BLAKE3 over labels and content of the usable training clouds, hexadecimal.
    pub train_digest: String,
    /// Everything that determines the counts, as canonical TOML.
    pub text: String,
    /// BLAKE3 of `text`.
    pub key: Digest,
}

impl GridSpec {
    /// What an exhaustive search of this experiment asks: seed, method and the other two splits have no part in it.
    ///
    /// # Errors
    /// As [`Grid::of`].
    pub fn new(experiment: &Experiment, dataset: &Dataset) -> Result<Self, GridError> {
        let grid = Grid::of(experiment)?;
        let train_digest = train_digest(dataset).to_hex().to_string();
        let text = format!(
            "# an exhaustive search\nevaluation_version = {EVALUATION_VERSION}\ntrain_digest = \"{train_digest}\"\n{}",
            experiment.space_toml()
        );
        let key = Digest::of(text.as_bytes());
        Ok(Self { grid, queries: dataset.splits.train1.len() as u32, train_digest, text, key })
    }

    /// `<name>-grid-<12 hex digits of the key>`: the same command finds its grid again.
    pub fn folder_name(&self, experiment: &Experiment) -> String {
        format!("{}-grid-{}", experiment.name(), &self.key.to_string()[..12])
    }

    /// Name of a cell: R1 and R2 in micrometres.
    pub fn cell_name(&self, cell: usize) -> String {
        let (disk, ring) = self.grid.radii(cell);
        format!("{disk}-{ring}")
    }

    /// A cell's rows, as this worker counted them.
    pub fn points(&self, cell: usize, object_correct: Vec<u32>, by: Option<CountedBy>) -> CellPoints {
        let mut genes = vec![Vec::with_capacity(object_correct.len()); GENES.len()];
        for place in self.grid.places(cell) {
            let values = Descriptor::DiskRing(self.grid.descriptor(place)).values();
            for (column, value) in genes.iter_mut().zip(values) {
                column.push(value);
            }
        }
        let mut points = CellPoints {
            genes,
            object_correct,
            worker_id: None,
            principal: None,
            seconded: None,
            basis: None,
        };
        if let Some(CountedBy { worker_id, principal, seconded, basis }) = by {
            (points.worker_id, points.principal) = (Some(worker_id), Some(principal));
            (points.seconded, points.basis) = (seconded, basis.map(|basis| basis_name(basis).to_owned()));
        }
        points
    }

    /// The counts of a cell's rows as they were read, if they are those of this cell.
    pub fn counts(&self, cell: usize, points: CellPoints) -> Option<Vec<u32>> {
        let in_range = points.object_correct.iter().all(|&count| count <= self.queries);
        let CellPoints { genes, object_correct, .. } = points;
        let expected = self.points(cell, object_correct, None);
        (in_range && expected.object_correct.len() == self.grid.cell_len() && expected.genes == genes)
            .then_some(expected.object_correct)
    }

    /// The best descriptor of a finished grid that answers this spec.
    ///
    /// # Errors
    /// If the grid's row names a descriptor or count that it cannot have.
    pub fn optimum(&self, finished: &FinishedGrid, folder: &Path) -> Result<Optimum, results::Error> {
        let (genes, object_correct) = (&finished.row.best_genes, finished.row.best_object_correct);
        let parameters = Parameters::from_values(genes).filter(|best| self.grid.table().contains(best));
        match parameters {
            Some(parameters) if object_correct <= self.queries => Ok(Optimum { parameters, object_correct }),
            _ => Err(results::Error::Damaged {
                file: folder.to_owned(),
                what: "its best descriptor is not one of the grid".to_owned(),
            }),
        }
    }
}

/// BLAKE3 over, for each usable cloud of both training sets in order, split, category, instance and the digest of the
/// file's bytes. Paths and the other splits have no part in it.
fn train_digest(dataset: &Dataset) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new_derive_key("descry training clouds v1");
    let mut part = |bytes: &[u8]| {
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    };
    let clouds = &dataset.clouds;
    for (split, indices) in [("train1", &dataset.splits.train1), ("train2", &dataset.splits.train2)] {
        for &index in indices {
            let CloudEntry { category, instance, digest, .. } = &clouds.entries[index as usize];
            part(split.as_bytes());
            part(clouds.categories[*category as usize].as_bytes());
            part(clouds.instances[*instance as usize].name.as_bytes());
            part(digest);
        }
    }
    hasher.finalize()
}
