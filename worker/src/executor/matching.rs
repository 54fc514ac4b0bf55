//! Distances between splits in each channel of a descriptor, and the signatures that they are computed from.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use cache::ByteSize;
use descriptor::{
    Descriptor, DistanceMatrix, Label, Match, PrepareError, PreparedCloud, PrunedDatabase, Signatures,
};
use futures_util::future::try_join_all;
use proto::{Digest, MAX_DESCRIPTION_BYTES};
use tracing::{Instrument as _, debug_span};

use crate::executor::cloud_loader::CloudLoader;
use crate::executor::decoded::InvalidTask;
use crate::executor::error::EvaluationError;
use crate::executor::manifest::Manifest;
use crate::executor::preparation_cache::{PreparationCache, Shares};
use crate::executor::reuse::{Key, Pairing, Reuse};
use crate::executor::signature_files;
use crate::executor::source::{JoinedShards, Origin, Source};

/// Signatures in each channel; `None` where they are not wanted.
type ByChannel = Vec<Option<Arc<Signatures>>>;

/// The same of several sources, by their names.
type BySource = BTreeMap<Vec<Digest>, ByChannel>;

/// A descriptor, and what its channels are kept under.
struct Wanted<'a> {
    cache: &'a Arc<PreparationCache>,
    descriptor: &'a Descriptor,
    keys: Vec<Key>,
}

impl<'a> Wanted<'a> {
    fn new(cache: &'a Arc<PreparationCache>, descriptor: &'a Descriptor) -> Self {
        let preprocess = cache.preparation().preprocess;
        let keys = descriptor.channels().into_iter().map(|(channel, _)| (preprocess, channel)).collect();
        Self { cache, descriptor, keys }
    }
}

/// Describes clouds and matches them, and keeps what later tasks may ask for again.
pub(super) struct Matcher {
    /// Where prepared clouds come from.
    pub(super) loader: CloudLoader,
    reuse: Mutex<Reuse>,
    /// Signatures on this machine's disk.
    pub(super) files: signature_files::Writer,
}

impl Matcher {
    /// With clouds from `loader`; keeps up to a share of `memory`.
    pub(super) fn new(loader: CloudLoader, memory: ByteSize) -> Self {
        let files = signature_files::Writer::new(Arc::clone(&loader.store));
        Self { loader, reuse: Mutex::new(Reuse::new(Shares::of(memory).reuse)), files }
    }

    fn reuse(&self) -> MutexGuard<'_, Reuse> {
        self.reuse.lock().unwrap_or_else(PoisonError::into_inner) // entries are inserted whole
    }

    /// Distances of all queries to all clouds of the database in each channel, with its weight.
    pub(super) async fn distances(
        &self,
        cache: &Arc<PreparationCache>,
        descriptor: &Descriptor,
        query: &[Source],
        database: &[Source],
    ) -> Result<Vec<(Arc<DistanceMatrix>, f64)>, EvaluationError> {
        let wanted = Wanted::new(cache, descriptor);
        let names = |sources: &[Source], channel: usize| -> Arc<[Digest]> {
            sources.iter().map(|source| source.name(channel)).collect()
        };
        let pairings: Vec<Pairing> =
            (0..wanted.keys.len()).map(|channel| [names(query, channel), names(database, channel)]).collect();
        let kept: Vec<Option<Arc<DistanceMatrix>>> = wanted
            .keys
            .iter()
            .zip(&pairings)
            .map(|(key, pairing)| self.reuse().distances(pairing, key))
            .collect();
        let missing: Vec<bool> = kept.iter().map(Option::is_none).collect();

        let by_source = match missing.contains(&true) {
            true => self.by_source(&wanted, query.iter().chain(database), &missing).await?,
            false => BySource::new(),
        };
        let mut distances = Vec::new();
        for (index, (kept, (channel, weight))) in kept.into_iter().zip(descriptor.channels()).enumerate() {
            let matrix = match kept {
                Some(matrix) => matrix,
                None => {
                    let pairing = &pairings[index];
                    let queries = of_side(&by_source, query, index);
                    // The same clouds on both sides, as in scales and most protocols of fitness.
                    let database = (pairing[0] != pairing[1]).then(|| of_side(&by_source, database, index));
                    let compute = move || match database {
                        Some(database) => channel.distances(&joined(&queries), &joined(&database)),
                        None => channel.distances_among(&joined(&queries)),
                    };
                    let matching = self.loader.computing.run(compute).instrument(debug_span!("match"));
                    let matrix = Arc::new(matching.await);
                    self.loader.work().matched += 1;
                    self.reuse().keep_distances(pairing, &wanted.keys[index], &matrix);
                    matrix
                }
            };
            distances.push((matrix, weight));
        }
        Ok(distances)
    }

    /// Whether the distances of so many queries to so many clouds in each channel of a descriptor can be kept.
    pub(super) fn has_room(&self, descriptor: &Descriptor, clouds: [usize; 2]) -> bool {
        self.reuse().has_room(descriptor.channels().len(), clouds)
    }

    /// What each query is recognised as, by the distance of each channel over its scale: as from [`Matcher::distances`], but
    /// without them, so that memory does not grow with the product of queries and database. No scales are scales of 1.
    /// The clouds of the database show `labels`; without `runner_up` only nearest clouds are looked for.
    pub(super) async fn recognise(
        &self,
        cache: &Arc<PreparationCache>,
        descriptor: &Descriptor,
        [query, database]: [&[Source]; 2],
        scales: &[f64],
        (labels, runner_up): (Vec<Label>, bool),
    ) -> Result<Vec<Match>, EvaluationError> {
        let wanted = Wanted::new(cache, descriptor);
        let all = vec![true; wanted.keys.len()];
        let by_source = self.by_source(&wanted, query.iter().chain(database), &all).await?;
        let scales = scales.iter().copied().chain(std::iter::repeat(1.0));
        let channels: Vec<_> = descriptor
            .channels()
            .into_iter()
            .zip(scales)
            .enumerate()
            .map(|(index, ((channel, weight), scale))| {
                let sides = [query, database].map(|side| of_side(&by_source, side, index));
                (sides, channel.metric(), weight / scale)
            })
            .collect();
        drop(by_source);
        let recognise = move || {
            let known = channels.iter().map(|([_, known], metric, weight)| (joined(known), *metric, *weight));
            let database = PrunedDatabase::new(known.collect(), &labels)?;
            let asked: Vec<Cow<'_, Signatures>> =
                channels.iter().map(|([asked, _], ..)| joined(asked)).collect();
            Ok(database.recognise(&asked.iter().map(AsRef::as_ref).collect::<Vec<_>>(), runner_up).0)
        };
        self.loader.work().pruned += 1;
        self.loader.computing.run(recognise).instrument(debug_span!("match")).await
    }

    /// The signatures of the clouds of each source in the channels where they are missing.
    async fn by_source<'a>(
        &self,
        wanted: &Wanted<'_>,
        sources: impl Iterator<Item = &'a Source>,
        missing: &[bool],
    ) -> Result<BySource, EvaluationError> {
        let mut by_source = BySource::new();
        for source in sources {
            if let Entry::Vacant(vacant) = by_source.entry(source.names()) {
                vacant.insert(self.of_source(wanted, source, missing).await?);
            }
        }
        Ok(by_source)
    }

    async fn of_source(
        &self,
        wanted: &Wanted<'_>,
        source: &Source,
        missing: &[bool],
    ) -> Result<ByChannel, EvaluationError> {
        match &source.origin {
            Origin::Shard(name) => {
                let signatures = self.described(wanted, &source.manifest, *name).await?;
                self.keep_all(wanted, *name, &signatures);
                Ok(signatures.into_iter().map(Some).collect())
            }
            Origin::Split(by_channel) => {
                let to_describe: Vec<bool> = by_channel
                    .iter()
                    .zip(missing)
                    .map(|(described, missing)| *missing && described.is_none())
                    .collect();
                let mut found = self.signatures(wanted, &source.manifest, &to_describe).await?;
                for (index, described) in by_channel.iter().enumerate().filter(|(index, _)| missing[*index]) {
                    if let Some(described) = described {
                        found[index] = Some(self.joined(wanted, index, described).await?);
                    }
                }
                Ok(found)
            }
        }
    }

    /// The signatures of a split in one channel from those of its shards.
    async fn joined(
        &self,
        wanted: &Wanted<'_>,
        channel: usize,
        described: &JoinedShards,
    ) -> Result<Arc<Signatures>, EvaluationError> {
        let key = &wanted.keys[channel];
        let kept = self.reuse().signatures(described.name, key);
        if let Some(kept) = kept {
            return Ok(kept);
        }
        let alone = Descriptor::of_channel(&key.1).ok_or(InvalidTask::Described { channel })?;
        let alone = Wanted::new(wanted.cache, &alone);
        let shards = described.shards.iter().map(|(manifest, name)| self.described(&alone, manifest, *name));
        let shards: Vec<Arc<Signatures>> = try_join_all(shards).await?.into_iter().flatten().collect();
        let signatures = match &shards[..] {
            [shard] => Arc::clone(shard),
            shards => Arc::new(joined(shards).into_owned()),
        };
        self.reuse().keep_signatures(described.name, key, &signatures);
        Ok(signatures)
    }

    /// The signatures of a split in the channels where they are missing; those that are not kept are computed.
    async fn signatures(
        &self,
        wanted: &Wanted<'_>,
        manifest: &Arc<Manifest>,
        missing: &[bool],
    ) -> Result<ByChannel, EvaluationError> {
        let preparer = &wanted.cache.preparer;
        let (mut found, mut computed) = (ByChannel::new(), Vec::new());
        for (index, key) in wanted.keys.iter().enumerate() {
            let kept = if missing[index] { self.kept(manifest, key).await } else { None };
            if missing[index] && kept.is_none() {
                computed.push((index, Signatures::default(), key.1.extractor(preparer)?));
            }
            found.push(kept);
        }
        if computed.is_empty() {
            return Ok(found);
        }
        let extractors: Arc<[_]> = computed.iter().map(|(.., extractor)| extractor.clone()).collect();
        let compute = move |clouds: &[Arc<PreparedCloud>]| -> Result<Vec<Signatures>, PrepareError> {
            extractors.iter().map(|extractor| extractor.signatures(clouds)).collect()
        };
        for batch in self.loader.stream(wanted.cache, manifest, compute).await? {
            let path = || format!("split manifest {}", manifest.digest);
            let batch =
                batch.map_err(|error| EvaluationError::Cloud { path: path(), what: error.to_string() })?;
            computed.iter_mut().zip(&batch).for_each(|((_, all, _), more)| all.append(more));
        }
        for (index, signatures, _) in computed {
            let (signatures, key) = (Arc::new(signatures), &wanted.keys[index]);
            self.loader.work().described += signatures.clouds() as u64;
            self.reuse().keep_signatures(manifest.digest, key, &signatures);
            self.files.keep(manifest, key, &signatures).await;
            found[index] = Some(signatures);
        }
        Ok(found)
    }

    /// The signatures of a split in one channel, if they are in memory or on disk.
    async fn kept(&self, manifest: &Arc<Manifest>, key: &Key) -> Option<Arc<Signatures>> {
        let in_memory = self.reuse().signatures(manifest.digest, key);
        let can_be_on_disk = self.loader.store.is_kept() && signature_files::are_of(&key.1);
        if in_memory.is_some() || !can_be_on_disk {
            return in_memory;
        }
        let (store, of, wanted) = (Arc::clone(&self.loader.store), Arc::clone(manifest), key.clone());
        let load = move || signature_files::load(&store, &of, &wanted);
        let signatures = Arc::new(self.loader.computing.run(load).await?);
        self.loader.work().restored += signatures.clouds() as u64;
        self.reuse().keep_signatures(manifest.digest, key, &signatures);
        Some(signatures)
    }

    /// The signatures of a split in all channels.
    async fn all_signatures(
        &self,
        wanted: &Wanted<'_>,
        manifest: &Arc<Manifest>,
    ) -> Result<Vec<Arc<Signatures>>, EvaluationError> {
        let missing = vec![true; wanted.keys.len()];
        Ok(self.signatures(wanted, manifest, &missing).await?.into_iter().flatten().collect())
    }

    /// The signatures of a shard by the digest of their encoded form: kept, from the coordinator, or made here if it has
    /// them no more.
    async fn described(
        &self,
        wanted: &Wanted<'_>,
        manifest: &Arc<Manifest>,
        name: Digest,
    ) -> Result<Vec<Arc<Signatures>>, EvaluationError> {
        let kept: Option<Vec<Arc<Signatures>>> =
            wanted.keys.iter().map(|key| self.reuse().signatures(name, key)).collect();
        if let Some(kept) = kept {
            return Ok(kept);
        }
        if let Some(bytes) = self.loader.blobs.given(name).await {
            let clouds = manifest.clouds.len() as u32;
            self.loader.work().handed += 1;
            return Ok(wanted
                .descriptor
                .decode_signatures(&bytes, clouds)?
                .into_iter()
                .map(Arc::new)
                .collect());
        }
        let signatures = self.all_signatures(wanted, manifest).await?;
        let got = Digest::of(&encoded(wanted.descriptor, &signatures));
        if got != name {
            return Err(EvaluationError::Description { digest: manifest.digest, expected: name, got });
        }
        Ok(signatures)
    }

    /// The encoded signatures of a shard.
    pub(super) async fn describe(
        &self,
        cache: &Arc<PreparationCache>,
        descriptor: &Descriptor,
        manifest: &Arc<Manifest>,
    ) -> Result<Vec<u8>, EvaluationError> {
        let wanted = Wanted::new(cache, descriptor);
        let got = descriptor.signature_bytes(manifest.clouds.len() as u32);
        if got > MAX_DESCRIPTION_BYTES {
            return Err(EvaluationError::TooLarge { digest: manifest.digest, got });
        }
        let signatures = self.all_signatures(&wanted, manifest).await?;
        let bytes = encoded(descriptor, &signatures);
        self.keep_all(&wanted, Digest::of(&bytes), &signatures);
        Ok(bytes)
    }

    /// Keeps the signatures of a shard under the digest of their encoded form.
    fn keep_all(&self, wanted: &Wanted<'_>, name: Digest, signatures: &[Arc<Signatures>]) {
        let mut reuse = self.reuse();
        let of_channels = wanted.keys.iter().zip(signatures);
        of_channels.for_each(|(key, signatures)| reuse.keep_signatures(name, key, signatures));
    }
}

/// The signatures of one side in a channel, one split after the other.
fn of_side(by_source: &BySource, sources: &[Source], channel: usize) -> Vec<Arc<Signatures>> {
    sources.iter().filter_map(|source| by_source[&source.names()][channel].clone()).collect()
}

fn encoded(descriptor: &Descriptor, signatures: &[Arc<Signatures>]) -> Vec<u8> {
    let signatures: Vec<&Signatures> = signatures.iter().map(Arc::as_ref).collect();
    descriptor.encode_signatures(&signatures)
}

/// The signatures of several splits as if they were one.
fn joined(splits: &[Arc<Signatures>]) -> Cow<'_, Signatures> {
    match splits {
        [split] => Cow::Borrowed(split),
        splits => {
            let mut all = Signatures::default();
            splits.iter().for_each(|split| all.append(split));
            Cow::Owned(all)
        }
    }
}
