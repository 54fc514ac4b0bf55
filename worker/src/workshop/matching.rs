//! Distances between splits, from what earlier evaluations left, and parts of clouds for them.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::Arc;

use descriptor::grid::{Cell, CellParts};
use descriptor::{Binning, DistanceMatrix, Parameters, Parts, PreparedCloud, description};
use proto::{Digest, MAX_DESCRIPTION_BYTES};
use rayon::prelude::*;

use crate::workshop::manifest::Manifest;
use crate::workshop::reuse::{Half, HalfKey, Pairing};
use crate::workshop::shelf::Shelf;
use crate::workshop::{EvaluationError, Preparation, Workshop};

/// Shape and colour parts by name of their source; empty where they are not wanted.
type SplitParts = BTreeMap<Digest, [Arc<Parts>; 2]>;

/// Where the parts of some clouds come from.
pub(super) struct Source {
    /// Which clouds.
    pub(super) manifest: Arc<Manifest>,
    /// What is kept of them is kept under this: the digest of the manifest, or of the description that a job names. So
    /// that a wrong description is taken for nothing but itself.
    name: Digest,
}

impl Source {
    /// The clouds of a split, to be described here.
    pub(super) fn split(manifest: Arc<Manifest>) -> Self {
        Self { name: manifest.digest, manifest }
    }

    /// The clouds of a shard with the digest of their description.
    pub(super) fn shard((manifest, description): (Arc<Manifest>, &Digest)) -> Self {
        Self { manifest, name: *description }
    }

    fn is_described(&self) -> bool {
        self.name != self.manifest.digest
    }
}

impl Workshop {
    /// Distances of all queries to all clouds of the database, in shape and in colour.
    pub(super) async fn distances(
        &self,
        shelf: &Arc<Shelf>,
        parameters: &Parameters,
        query: &[Source],
        database: &[Source],
    ) -> Result<[Arc<DistanceMatrix>; 2], EvaluationError> {
        let names = |sources: &[Source]| sources.iter().map(|source| source.name).collect();
        let pairing: Pairing = [names(query), names(database)];
        let keys = Half::BOTH.map(|half| HalfKey::new(half, parameters));
        let kept = keys.map(|key| shelf.reuse().distances(&pairing, key));
        let missing = kept.each_ref().map(Option::is_none);

        let mut parts = SplitParts::new();
        if missing.contains(&true) {
            let binning = Arc::new(shelf.quantiser.binning(parameters)?);
            for source in query.iter().chain(database) {
                if let Entry::Vacant(vacant) = parts.entry(source.name) {
                    vacant.insert(if source.is_described() {
                        self.described(shelf, source, &binning, keys).await?
                    } else {
                        self.parts(shelf, &source.manifest, &binning, keys, missing).await?
                    });
                }
            }
        }
        let [shape, colour] = kept;
        Ok([
            self.matrix(shelf, &pairing, keys[0], shape, &parts).await,
            self.matrix(shelf, &pairing, keys[1], colour, &parts).await,
        ])
    }

    /// The kept distances, or those of `parts`.
    async fn matrix(
        &self,
        shelf: &Shelf,
        pairing: &Pairing,
        key: HalfKey,
        kept: Option<Arc<DistanceMatrix>>,
        parts: &SplitParts,
    ) -> Arc<DistanceMatrix> {
        if let Some(kept) = kept {
            return kept;
        }
        let of_splits = |splits: &[Digest]| -> Vec<Arc<Parts>> {
            splits.iter().map(|split| Arc::clone(&parts[split][key.half() as usize])).collect()
        };
        let (queries, database) = (of_splits(&pairing[0]), of_splits(&pairing[1]));
        let compute = move || DistanceMatrix::new(&joined(&queries), &joined(&database));
        let matrix = Arc::new(self.computing.run(compute).await);
        self.supply.work().matched += 1;
        shelf.reuse().keep_distances(pairing, key, &matrix);
        matrix
    }

    /// The wanted parts of a split; those that are not kept are counted.
    async fn parts(
        &self,
        shelf: &Arc<Shelf>,
        manifest: &Manifest,
        binning: &Arc<Binning>,
        keys: [HalfKey; 2],
        wanted: [bool; 2],
    ) -> Result<[Arc<Parts>; 2], EvaluationError> {
        let kept = keys.map(|key| shelf.reuse().parts(manifest.digest, key));
        let missing = [wanted[0] && kept[0].is_none(), wanted[1] && kept[1].is_none()];
        let mut counted = [Parts::default(), Parts::default()];
        if missing.contains(&true) {
            let binning = Arc::clone(binning);
            let count = move |clouds: &[Arc<PreparedCloud>]| count(clouds, &binning, missing);
            for batch in self.supply.stream(shelf, manifest, count).await? {
                counted.iter_mut().zip(&batch).for_each(|(all, more)| all.append(more));
            }
        }
        let [shape, colour] = counted;
        let [kept_shape, kept_colour] = kept;
        let keep = |key: HalfKey, kept: Option<Arc<Parts>>, counted: Parts, missing: bool| {
            let parts = kept.unwrap_or_else(|| Arc::new(counted));
            if missing {
                self.supply.work().described += parts.clouds() as u64;
                shelf.reuse().keep_parts(manifest.digest, key, &parts);
            }
            parts
        };
        Ok([keep(keys[0], kept_shape, shape, missing[0]), keep(keys[1], kept_colour, colour, missing[1])])
    }

    /// Both parts of a shard by its description: kept, from the coordinator, or made here if it has them no more.
    async fn described(
        &self,
        shelf: &Arc<Shelf>,
        source: &Source,
        binning: &Arc<Binning>,
        keys: [HalfKey; 2],
    ) -> Result<[Arc<Parts>; 2], EvaluationError> {
        let Source { manifest, name } = source;
        if let [Some(shape), Some(colour)] = keys.map(|key| shelf.reuse().parts(*name, key)) {
            return Ok([shape, colour]);
        }
        let parts = match self.supply.blobs.given(*name).await {
            Some(bytes) => {
                let clouds = manifest.clouds.len() as u32;
                self.supply.work().handed += 1;
                description::decode(&bytes, binning.parameters(), clouds)?.map(Arc::new)
            }
            None => {
                let parts = self.parts(shelf, manifest, binning, keys, [true, true]).await?;
                let got = Digest::of(&description::encode(parts.each_ref().map(Arc::as_ref)));
                if got != *name {
                    let (digest, expected) = (manifest.digest, *name);
                    return Err(EvaluationError::Description { digest, expected, got });
                }
                parts
            }
        };
        keep_both(shelf, *name, keys, &parts);
        Ok(parts)
    }

    /// The description of a shard.
    pub(super) async fn describe(
        &self,
        preparation: &Preparation,
        parameters: &Parameters,
        manifest: Digest,
    ) -> Result<Vec<u8>, EvaluationError> {
        let shelf = self.shelf(preparation)?;
        let binning = Arc::new(shelf.quantiser.binning(parameters)?);
        let keys = Half::BOTH.map(|half| HalfKey::new(half, parameters));
        let manifest = self.manifest(manifest).await?;
        refuse_too_large(&manifest, description::length(parameters, manifest.clouds.len() as u32))?;
        let parts = self.parts(&shelf, &manifest, &binning, keys, [true, true]).await?;
        let bytes = description::encode(parts.each_ref().map(Arc::as_ref));
        keep_both(&shelf, Digest::of(&bytes), keys, &parts);
        Ok(bytes)
    }

    /// All parts of some splits for one grid cell, one split after the other.
    pub(super) async fn cell_parts(
        &self,
        shelf: &Arc<Shelf>,
        cell: &Arc<Cell>,
        manifests: &[Arc<Manifest>],
    ) -> Result<Vec<CellParts>, EvaluationError> {
        let mut parts = Vec::new();
        for manifest in manifests {
            let cell = Arc::clone(cell);
            let count = move |clouds: &[Arc<PreparedCloud>]| -> Vec<CellParts> {
                clouds.par_iter().map(|cloud| cell.parts(cloud)).collect()
            };
            parts.extend(self.supply.stream(shelf, manifest, count).await?.into_iter().flatten());
        }
        Ok(parts)
    }
}

/// Refuses a shard whose description would have so many bytes.
pub(super) fn refuse_too_large(manifest: &Manifest, got: u64) -> Result<(), EvaluationError> {
    if got > MAX_DESCRIPTION_BYTES {
        return Err(EvaluationError::TooLarge { digest: manifest.digest, got });
    }
    Ok(())
}

/// Keeps both parts of a described shard under the digest of its description.
fn keep_both(shelf: &Shelf, name: Digest, keys: [HalfKey; 2], parts: &[Arc<Parts>; 2]) {
    let mut reuse = shelf.reuse();
    keys.iter().zip(parts).for_each(|(key, parts)| reuse.keep_parts(name, *key, parts));
}

/// Parts of `clouds`; empty where they are not wanted.
fn count(clouds: &[Arc<PreparedCloud>], binning: &Binning, wanted: [bool; 2]) -> [Parts; 2] {
    match wanted {
        [true, true] => Parts::both(clouds, binning),
        [true, false] => [Parts::shape(clouds, binning), Parts::default()],
        [false, true] => [Parts::default(), Parts::colour(clouds, binning)],
        [false, false] => [Parts::default(), Parts::default()],
    }
}

/// The parts of several splits as if they were one.
fn joined(splits: &[Arc<Parts>]) -> Cow<'_, Parts> {
    match splits {
        [split] => Cow::Borrowed(split),
        splits => {
            let mut all = Parts::default();
            splits.iter().for_each(|split| all.append(split));
            Cow::Owned(all)
        }
    }
}
