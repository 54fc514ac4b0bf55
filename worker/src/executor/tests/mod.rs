//! Evaluations with everything that saves work give what plain evaluations give, and do not do work twice.

mod bucket;
mod bucket_server;
mod coordinator;
mod described_splits;
mod foreign_clouds;
mod rules;
mod scales;
mod signature_files;

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::time::Duration;

use cache::Storage;
use descriptor::Domain;
use descriptor::grid::cell_to_bytes;
use descriptor::{
    EVALUATION_VERSION, FixedDescriptor, FixedKind, GeneTable, GlobalHue, Parameters, PreparedCloud,
    Preprocess, QuantisedCloud, Quantiser, SearchSpace, pcd, recognise,
};
use proto::task::{self, Description, GridCell};

use super::*;
use crate::bucket::{Access, Bucket, Patience};
use coordinator::{Archive, CLOUDS, SPLIT};

const LARGE: ByteSize = ByteSize::gib(1);
const SMALL: ByteSize = ByteSize::mib(1);
/// Not enough for the distances of six clouds to six others.
const TINY: ByteSize = ByteSize::kib(1);

fn preparation() -> Preparation {
    let domain = |low, step, count| Domain { low, step, count };
    let domains = [
        domain(8, 12, 3),
        domain(3, 2, 2),
        domain(10_000, 5_000, 2),
        domain(30_000, 10_000, 3),
        domain(0, 250_000, 5),
    ];
    Preparation { preprocess: Preprocess::default(), space: SearchSpace::DiskRing(table(domains)) }
}

fn table(domains: [Domain; 5]) -> GeneTable {
    GeneTable::new(domains, true).unwrap()
}

fn parameters(ticks: [u32; 5]) -> Parameters {
    Parameters::from_ticks(ticks)
}

/// Descriptors that differ in one gene or more from those before.
fn descriptors() -> [Parameters; 6] {
    [
        parameters([8, 3, 10_000, 30_000, 500_000]),
        parameters([8, 3, 10_000, 30_000, 250_000]),
        parameters([20, 3, 10_000, 30_000, 250_000]),
        parameters([20, 5, 10_000, 30_000, 750_000]),
        parameters([32, 5, 15_000, 50_000, 0]),
        parameters([8, 3, 10_000, 30_000, 1_000_000]),
    ]
}

/// Training (train1 against train2) or validation (validation against both): query and database.
fn splits(archive: &Archive, validation: bool) -> [Vec<Digest>; 2] {
    let [train1, train2, of_validation] = archive.splits[..] else { panic!("three splits") };
    if validation { [vec![of_validation], vec![train1, train2]] } else { [vec![train1], vec![train2]] }
}

fn subject(preparation: &Preparation, descriptor: Vec<u8>) -> task::Subject {
    task::Subject {
        preparation: preparation.to_bytes().into(),
        descriptor: descriptor.into(),
        facts: task::Facts::default(),
    }
}

fn evaluation(archive: &Archive, parameters: Parameters, validation: bool) -> Evaluation {
    let [query, database] = splits(archive, validation);
    let subject = subject(&preparation(), Descriptor::DiskRing(parameters).to_bytes());
    Evaluation { subject, query, database, want_matches: true, ..Evaluation::sample(0, 0, 0) }
}

fn task(archive: &Archive, parameters: Parameters, validation: bool) -> Task {
    Task::Evaluation(evaluation(archive, parameters, validation))
}

static QUANTISER: LazyLock<Quantiser> = LazyLock::new(|| {
    let SearchSpace::DiskRing(table) = preparation().space else { panic!("another family") };
    Quantiser::new(&table).unwrap()
});

/// All clouds as the library prepares them.
static PREPARED: LazyLock<HashMap<Digest, QuantisedCloud>> = LazyLock::new(|| {
    let archive = Archive::new();
    let clouds =
        archive.blobs.iter().filter(|(digest, _)| !archive.splits.iter().any(|s| s.0[..] == digest[..]));
    let prepared = |bytes: &[u8]| {
        let cloud = pcd::read(bytes).unwrap();
        QuantisedCloud::new(&cloud, &preparation().preprocess, &QUANTISER).unwrap()
    };
    clouds.map(|(_, bytes)| (Digest::of(bytes), prepared(bytes))).collect()
});

/// The evaluation as it is defined, without anything that saves work.
fn plain(archive: &Archive, parameters: Parameters, validation: bool) -> TaskResult {
    let binning = QUANTISER.binning(&parameters).unwrap();
    let manifests = |digests: &[Digest]| -> Vec<Arc<Manifest>> {
        let decode = |digest: &Digest| Manifest::decode(*digest, &archive.blobs[&digest.to_vec()]).unwrap();
        digests.iter().map(|digest| Arc::new(decode(digest))).collect()
    };
    let signatures = |manifests: &[Arc<Manifest>]| {
        let prepared = |cloud: &manifest::Listed| &PREPARED[&cloud.digest];
        let clouds: Vec<_> = manifests.iter().flat_map(|manifest| &manifest.clouds).map(prepared).collect();
        binning.signatures(&clouds)
    };
    let [query, database] = splits(archive, validation);
    let (query, database) = (manifests(&query), manifests(&database));
    let weights = [parameters.shape_weight(), 1.0 - parameters.shape_weight()];
    let (asked, known) = (signatures(&query), signatures(&database));
    let matches = recognise(&asked, &known, &weights, &labels(&database)).unwrap();
    let correct = Correct::count(&matches, &labels(&query), &labels(&database));
    TaskResult::Evaluation(result(&correct, &matches))
}

fn store(cache: Option<PathBuf>) -> Arc<Store> {
    let storage = Storage { cache, cache_size: LARGE, ..Storage::in_memory(LARGE) };
    Arc::new(Store::open(&storage, "here", EVALUATION_VERSION))
}

fn executor(archive: &Archive, memory: ByteSize, store: &Arc<Store>) -> Arc<Executor> {
    let client = archive.clone().serve();
    // A busy machine must not be taken for a bucket that is slow.
    let waits = archive.bucket.as_ref().is_some_and(|server| server.mode.waits());
    let limit = Duration::from_millis(if waits { 200 } else { 60_000 });
    let patience = Patience {
        trial: limit,
        objects: (limit, Duration::ZERO),
        gain: limit,
        uploads: Duration::from_secs(60),
    };
    let bucket =
        Bucket::new(client.clone(), Access { reads: true, writes: !store.is_shared_read_only() }, patience);
    let blobs = Blobs::new(client, Some(Arc::clone(store)), bucket);
    Arc::new(Executor::new(2, memory, blobs, Arc::clone(store)).unwrap())
}

async fn carry_out(executor: &Arc<Executor>, task: Task) -> TaskResult {
    let result = Arc::clone(executor).carry_out(task).await.unwrap();
    executor.settle().await;
    result
}

/// Carries out training and validation of all descriptors, and compares with the plain evaluations.
async fn check(executor: &Arc<Executor>, archive: &Archive) {
    for parameters in descriptors() {
        for validation in [false, true] {
            let outcome = carry_out(executor, task(archive, parameters, validation)).await;
            assert_eq!(outcome, plain(archive, parameters, validation), "{parameters}, {validation}");
        }
    }
}

/// All files below a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn saved_work_changes_no_bit() {
    let archive = Archive::new();
    let executor = executor(&archive, LARGE, &store(None));
    check(&executor, &archive).await;
    assert_eq!(executor.work().prepared, CLOUDS);
}

#[tokio::test(flavor = "multi_thread")]
async fn only_what_depends_on_the_changed_gene_is_computed() {
    let archive = Archive::new();
    let executor = executor(&archive, LARGE, &store(None));
    let mut before = executor.work();
    let base = [8, 3, 10_000, 30_000, 500_000];
    let both = 2 * SPLIT;
    for (ticks, validation, described, matched) in [
        (base, false, 2 * both, 2),
        ([8, 3, 10_000, 30_000, 250_000], false, 0, 0),
        ([20, 3, 10_000, 30_000, 250_000], false, both, 1),
        ([20, 5, 10_000, 30_000, 250_000], false, both, 1),
        // The database's signatures are there; only the queries are counted.
        (base, true, 2 * SPLIT, 2),
        (base, true, 0, 0),
        ([8, 3, 15_000, 30_000, 500_000], false, 2 * both, 2),
        (base, false, 0, 0),
    ] {
        carry_out(&executor, task(&archive, parameters(ticks), validation)).await;
        let work = executor.work();
        let done = (work.described - before.described, work.matched - before.matched);
        assert_eq!(done, (described, matched), "{ticks:?}, {validation}");
        before = work;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn clouds_that_do_not_fit_are_streamed_with_the_same_results() {
    let (archive, cache) = (Archive::new(), tempfile::tempdir().unwrap());
    let streaming = executor(&archive, SMALL, &store(Some(cache.path().to_owned())));
    check(&streaming, &archive).await;
    let work = streaming.work();
    assert_eq!(work.prepared, CLOUDS);
    assert!(work.loaded > 0, "everything fitted: {work:?}");

    let rebuilding = executor(&archive, SMALL, &store(None));
    check(&rebuilding, &archive).await;
    assert!(rebuilding.work().prepared > CLOUDS, "everything fitted");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_second_worker_prepares_nothing_and_damaged_entries_are_rebuilt() {
    let (archive, cache) = (Archive::new(), tempfile::tempdir().unwrap());
    let start = || executor(&archive, LARGE, &store(Some(cache.path().to_owned())));
    check(&start(), &archive).await;
    let warm = start();
    check(&warm, &archive).await;
    let work = warm.work();
    assert_eq!((work.prepared, work.loaded, warm.matcher.loader.blobs.fetched()), (0, CLOUDS, 0));

    let entries = files(&cache.path().join("derived"));
    assert_eq!(entries.len() as u64, CLOUDS);
    for (index, path) in files(cache.path()).iter().enumerate() {
        let mut bytes = fs::read(path).unwrap();
        let position = index * 977 % bytes.len();
        bytes[position] ^= 0x40;
        fs::write(path, bytes).unwrap();
    }
    let rebuilding = start();
    check(&rebuilding, &archive).await;
    assert_eq!(rebuilding.work().prepared, CLOUDS);
}

#[tokio::test(flavor = "multi_thread")]
async fn entries_deleted_while_in_use_are_made_again() {
    let (archive, cache) = (Archive::new(), tempfile::tempdir().unwrap());
    let streaming = executor(&archive, SMALL, &store(Some(cache.path().to_owned())));
    for parameters in descriptors() {
        fs::remove_dir_all(cache.path()).unwrap();
        fs::create_dir(cache.path()).unwrap();
        let outcome = carry_out(&streaming, task(&archive, parameters, true)).await;
        assert_eq!(outcome, plain(&archive, parameters, true));
    }
    assert!(streaming.work().prepared > CLOUDS);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_disk_that_cannot_be_written_changes_no_result() {
    let (archive, root) = (Archive::new(), tempfile::tempdir().unwrap());
    let cache = root.path().join("file");
    fs::write(&cache, b"").unwrap();
    check(&executor(&archive, LARGE, &store(Some(cache))), &archive).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn workers_of_one_process_prepare_each_cloud_once() {
    let (archive, cache) = (Archive::new(), tempfile::tempdir().unwrap());
    let store = store(Some(cache.path().to_owned()));
    let workers = [(); 3].map(|()| executor(&archive, LARGE, &store));
    futures_util::future::join_all(workers.iter().map(|worker| check(worker, &archive))).await;
    assert_eq!(workers.iter().map(|worker| worker.work().prepared).sum::<u64>(), CLOUDS);
}

#[tokio::test(flavor = "multi_thread")]
async fn workers_of_several_processes_may_prepare_the_same_cloud() {
    let (archive, cache) = (Archive::new(), tempfile::tempdir().unwrap());
    let start = || executor(&archive, LARGE, &store(Some(cache.path().to_owned())));
    let workers = [start(), start()];
    futures_util::future::join_all(workers.iter().map(|worker| check(worker, &archive))).await;
    assert_eq!(files(&cache.path().join("derived")).len() as u64, CLOUDS);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_coordinators_entries_are_used_if_they_are_sound() {
    let (archive, caches) = (Archive::new(), [(); 3].map(|()| tempfile::tempdir().unwrap()));
    let start = |cache: &tempfile::TempDir| executor(&archive, LARGE, &store(Some(cache.path().to_owned())));
    let first = start(&caches[0]);
    check(&first, &archive).await;
    for path in files(&caches[0].path().join("derived")) {
        let name = path.file_name().unwrap().to_str().unwrap();
        let bytes = |at: usize| u8::from_str_radix(&name[at..at + 2], 16).unwrap();
        let key: Vec<u8> = (0..64).step_by(2).map(bytes).collect();
        archive.derived.lock().unwrap().insert(key, fs::read(path).unwrap());
    }
    let second = start(&caches[1]);
    check(&second, &archive).await;
    let work = second.work();
    assert_eq!((work.prepared, work.fetched), (0, CLOUDS));
    assert_eq!(files(&caches[1].path().join("derived")).len() as u64, CLOUDS);

    archive.derived.lock().unwrap().values_mut().for_each(|entry| {
        let middle = entry.len() / 2;
        entry[middle] ^= 1;
    });
    let third = start(&caches[2]);
    check(&third, &archive).await;
    let work = third.work();
    assert_eq!((work.prepared, work.fetched), (CLOUDS, 0));
}

async fn describe_under(executor: &Arc<Executor>, subject: task::Subject, manifest: Digest) -> Vec<u8> {
    match carry_out(executor, Task::Description(Description { subject, manifest, clouds: 0 })).await {
        TaskResult::Description(Described { bytes: Some(bytes), .. }) => bytes.to_vec(),
        result => panic!("{result:?}"),
    }
}

async fn describe(executor: &Arc<Executor>, parameters: Parameters, manifest: Digest) -> Vec<u8> {
    let descriptor = Descriptor::DiskRing(parameters).to_bytes();
    describe_under(executor, subject(&preparation(), descriptor), manifest).await
}

/// Validation as a tile of described shards.
fn tile(archive: &Archive, parameters: Parameters, descriptions: [Digest; 3]) -> Task {
    let evaluation = evaluation(archive, parameters, true);
    let [query, first, second] = descriptions;
    let (query_descriptions, database_descriptions) = (vec![query], vec![first, second]);
    Task::Tile(Tile { evaluation, query_descriptions, database_descriptions })
}

#[tokio::test(flavor = "multi_thread")]
async fn a_tile_is_the_evaluation_whoever_described_its_shards() {
    let mut archive = Archive::new();
    let shards = [2, 0, 1].map(|split| archive.splits[split]);
    let describer = executor(&archive, LARGE, &store(None));
    // None of them has a channel in common with another.
    for parameters in [0, 2, 4].map(|index| descriptors()[index]) {
        let mut descriptions = [Digest([0; 32]); 3];
        for (shard, digest) in shards.iter().zip(&mut descriptions) {
            let bytes = describe(&describer, parameters, *shard).await;
            *digest = Digest::of(&bytes);
        }
        let expected = plain(&archive, parameters, true);
        let done = describer.work().described;
        assert_eq!(carry_out(&describer, tile(&archive, parameters, descriptions)).await, expected);
        assert_eq!((describer.work().described, describer.work().handed), (done, 0), "it has them");

        // The coordinator has none of them: they are made again, and are the same.
        let alone = executor(&archive, LARGE, &store(None));
        assert_eq!(carry_out(&alone, tile(&archive, parameters, descriptions)).await, expected);
        assert_eq!((alone.work().described, alone.work().handed), (2 * CLOUDS, 0));

        for shard in shards {
            let bytes = describe(&describer, parameters, shard).await;
            archive.add(bytes);
        }
        let other = executor(&archive, LARGE, &store(None));
        assert_eq!(carry_out(&other, tile(&archive, parameters, descriptions)).await, expected);
        assert_eq!((other.work().described, other.work().handed, other.work().prepared), (0, 3, 0));
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_wrong_description_is_taken_for_nothing_but_itself() {
    let mut archive = Archive::new();
    let [parameters, ..] = descriptors();
    let shards = [2, 0, 1].map(|split| archive.splits[split]);
    let honest = executor(&archive, LARGE, &store(None));
    let mut descriptions = [Digest([0; 32]); 3];
    for (shard, digest) in shards.iter().zip(&mut descriptions) {
        *digest = Digest::of(&describe(&honest, parameters, *shard).await);
    }
    let mut wrong = describe(&honest, parameters, shards[0]).await;
    wrong.reverse();
    wrong.chunks_exact_mut(4).for_each(|value| value.reverse());
    let named = [Digest::of(&wrong), descriptions[1], descriptions[2]];

    // Where nobody has it any more, it cannot be made: the job fails rather than to answer something else.
    let failed = Arc::clone(&honest).carry_out(tile(&archive, parameters, named)).await.unwrap_err();
    assert!(matches!(failed, EvaluationError::Description { .. }), "{failed}");

    // Where it is to be had, everybody computes the same from it, …
    archive.add(wrong);
    let others = [(); 2].map(|()| executor(&archive, LARGE, &store(None)));
    let [one, two] = others.each_ref().map(|other| carry_out(other, tile(&archive, parameters, named)));
    let (one, two) = (one.await, two.await);
    assert_eq!(one, two);
    // … and goes on with the right ones elsewhere.
    let expected = plain(&archive, parameters, true);
    assert_ne!(one, expected);
    for other in &others {
        assert_eq!(carry_out(other, tile(&archive, parameters, descriptions)).await, expected);
        assert_eq!(carry_out(other, task(&archive, parameters, true)).await, expected);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn distances_that_cannot_be_kept_are_not_computed_and_results_are_the_same() {
    let archive = Archive::new();
    let [pruning, keeping] = [TINY, LARGE].map(|memory| executor(&archive, memory, &store(None)));
    check(&pruning, &archive).await;
    let work = pruning.work();
    assert_eq!((work.matched, work.pruned), (0, 2 * descriptors().len() as u64));
    let mut asked = evaluation(&archive, descriptors()[0], true);
    for scales in [vec![], vec![0.25, 3.0]] {
        for want_matches in [false, true] {
            asked = Evaluation { want_matches, scales: scales.clone(), ..asked };
            let [pruned, kept] =
                [&pruning, &keeping].map(|executor| carry_out(executor, Task::Evaluation(asked.clone())));
            assert_eq!(pruned.await, kept.await);
        }
    }
    assert_eq!((pruning.work().matched, keeping.work().pruned), (0, 0));
}

/// What the descriptors of a cell recognise, one after the other.
fn plain_cell(archive: &Archive, [disk_um, ring_um]: [u32; 2]) -> Vec<u32> {
    let mut counts = Vec::new();
    for shape_bins in [8, 20, 32] {
        for m in [3, 5] {
            for weight in [0, 250_000, 500_000, 750_000, 1_000_000] {
                let descriptor = parameters([shape_bins, m, disk_um, ring_um, weight]);
                let TaskResult::Evaluation(found) = plain(archive, descriptor, true) else { panic!() };
                counts.push(found.object_correct);
            }
        }
    }
    counts
}

/// Disks are described and compared once for cells with the same R1 that follow each other, if there is memory for them: in
/// one batch, and in several.
#[tokio::test(flavor = "multi_thread")]
async fn a_grid_cell_is_its_descriptors() {
    let archive = Archive::new();
    let cells = [[15_000, 40_000], [15_000, 30_000], [10_000, 40_000], [15_000, 50_000]];
    let cells = cells.map(|radii| (radii, plain_cell(&archive, radii)));
    let splits_in_all = archive.splits.len() as u64;
    for (memory, expected_work) in
        [(LARGE, [3 * splits_in_all, 3]), (SMALL, [3 * splits_in_all, 3]), (TINY, [4 * splits_in_all, 0])]
    {
        let executor = executor(&archive, memory, &store(None));
        for (radii_um, expected) in &cells {
            let [query, database] = splits(&archive, true);
            let subject = subject(&preparation(), cell_to_bytes(*radii_um));
            let (queries, database_clouds, descriptors) = (0, 0, 3 * 2 * 5);
            let cell = GridCell { subject, query, database, queries, database_clouds, descriptors };
            let TaskResult::GridCell(counts) = carry_out(&executor, Task::GridCell(cell)).await else {
                panic!("another outcome")
            };
            assert_eq!(counts, *expected);
        }
        let Work { cells, disks_described, disks_compared, .. } = executor.work();
        assert_eq!((cells, [disks_described, disks_compared]), (4, expected_work));
    }
}

/// What each descriptor of another family is, one after the other, from nothing but its definition.
fn plain_of(archive: &Archive, descriptor: &Descriptor) -> TaskResult {
    let preparer = SearchSpace::single(descriptor).unwrap().preparer().unwrap();
    let [train1, train2, validation] = archive.splits[..] else { panic!("three splits") };
    let decode =
        |digest: Digest| Arc::new(Manifest::decode(digest, &archive.blobs[&digest.to_vec()]).unwrap());
    let [query, database] = [vec![decode(validation)], vec![decode(train1), decode(train2)]];
    let prepared = |manifests: &[Arc<Manifest>]| -> Vec<PreparedCloud> {
        let clouds = manifests.iter().flat_map(|manifest| &manifest.clouds);
        let source = |cloud: &manifest::Listed| pcd::read(&archive.blobs[&cloud.digest.to_vec()]).unwrap();
        clouds.map(|cloud| preparer.prepare(&source(cloud), &Preprocess::default()).unwrap()).collect()
    };
    let (channel, weight) = descriptor.channels().remove(0);
    let [asked, known] = [&query, &database]
        .map(|side| channel.extractor(&preparer).unwrap().signatures(&prepared(side)).unwrap());
    let (queries, labels) = (labels(&query), labels(&database));
    let matches = recognise(&[asked], &[known], &[weight], &labels).unwrap();
    let correct = Correct::count(&matches, &queries, &labels);
    TaskResult::Evaluation(result(&correct, &matches))
}

#[tokio::test(flavor = "multi_thread")]
async fn descriptors_of_other_families_are_evaluated_by_the_same_tasks() {
    let archive = Archive::new();
    let (executor, cache) = (executor(&archive, SMALL, &store(None)), tempfile::tempdir().unwrap());
    // Clouds of the search stay in memory meanwhile.
    carry_out(&executor, task(&archive, descriptors()[0], true)).await;
    let kept = self::executor(&archive, LARGE, &store(Some(cache.path().to_owned())));
    let fixed = |kind| Descriptor::Fixed(FixedDescriptor { kind, radius_um: 30_000 });
    let hue = |bins| Descriptor::GlobalHue(GlobalHue::new(bins).unwrap());
    let space = SearchSpace::GlobalHue(Domain { low: 2, step: 1, count: 63 });
    for (descriptor, space) in [
        (hue(7), space.clone()),
        (hue(30), space),
        (
            fixed(FixedKind::ShotColor),
            SearchSpace::Fixed(FixedDescriptor { kind: FixedKind::ShotColor, radius_um: 30_000 }),
        ),
    ] {
        let preparation = Preparation { preprocess: Preprocess::default(), space };
        let (subject, [query, database]) =
            (subject(&preparation, descriptor.to_bytes()), splits(&archive, true));
        let evaluation = Evaluation {
            subject: subject.clone(),
            query,
            database,
            want_matches: true,
            ..Evaluation::sample(0, 0, 0)
        };
        let expected = plain_of(&archive, &descriptor);
        for executor in [&executor, &kept] {
            let outcome = carry_out(executor, Task::Evaluation(evaluation.clone())).await;
            assert_eq!(outcome, expected, "{descriptor}");
            let before = executor.work();
            carry_out(executor, Task::Evaluation(evaluation.clone())).await;
            assert_eq!(executor.work(), before, "computed twice");

            let mut digests = Vec::new();
            for manifest in evaluation.query.iter().chain(&evaluation.database) {
                let bytes = describe_under(executor, subject.clone(), *manifest).await;
                digests.push(Digest::of(&bytes));
            }
            let (database_descriptions, evaluation) = (digests.split_off(1), evaluation.clone());
            let tile = Tile { evaluation, query_descriptions: digests, database_descriptions };
            assert_eq!(carry_out(executor, Task::Tile(tile)).await, expected, "{descriptor}");
        }
    }
    assert!(files(&cache.path().join("derived")).is_empty(), "entries of clouds that are prepared anew");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_descriptor_outside_the_search_space_is_refused() {
    let archive = Archive::new();
    let executor = executor(&archive, LARGE, &store(None));
    for descriptor in [
        Descriptor::DiskRing(Parameters { disk_um: 12_345, ..descriptors()[0] }),
        Descriptor::GlobalHue(GlobalHue::new(8).unwrap()),
    ] {
        let subject = subject(&preparation(), descriptor.to_bytes());
        let evaluation = Evaluation { subject, ..evaluation(&archive, descriptors()[0], true) };
        let refused = Arc::clone(&executor).carry_out(Task::Evaluation(evaluation)).await;
        let outside = matches!(refused, Err(EvaluationError::Invalid(InvalidTask::OutsideSpace { .. })));
        assert!(outside, "{refused:?}");
    }
    let space = SearchSpace::GlobalHue(Domain { low: 2, step: 1, count: 63 });
    let preparation = Preparation { preprocess: Preprocess::default(), space };
    let subject = subject(&preparation, cell_to_bytes([15_000, 40_000]));
    let ([query, database], descriptors) = (splits(&archive, true), 30);
    let cell = GridCell { subject, query, database, queries: 0, database_clouds: 0, descriptors };
    let refused = executor.carry_out(Task::GridCell(cell)).await;
    let of_another_kind = matches!(refused, Err(EvaluationError::Invalid(InvalidTask::Subject)));
    assert!(of_another_kind, "{refused:?}");
}
