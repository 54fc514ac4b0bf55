//! Evaluations with everything that saves work give what plain evaluations give, and do not do work twice.

mod coordinator;

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use descriptor::bytes::{cell_to_bytes, preparation_to_bytes};
use descriptor::genes::Domain;
use descriptor::{Descriptor, GeneTable, PreparedCloud, Preprocess, Quantiser, pcd, recognise, summarise};
use proto::task;

use super::*;
use crate::storage::Storage;
use coordinator::{Archive, CLOUDS, SPLIT};

const LARGE: Size = Size::from_bytes(1 << 30);
const SMALL: Size = Size::from_bytes(1 << 20);

fn preparation() -> Preparation {
    let domain = |low, step, count| Domain { low, step, count };
    let domains = [
        domain(8, 12, 3),
        domain(3, 2, 2),
        domain(10_000, 5_000, 2),
        domain(30_000, 10_000, 3),
        domain(0, 250_000, 5),
    ];
    Preparation { preprocess: Preprocess::default(), genes: GeneTable::new(domains, true).unwrap() }
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

fn subject(descriptor: Vec<u8>) -> task::Subject {
    let Preparation { preprocess, genes } = preparation();
    task::Subject {
        preparation: preparation_to_bytes(&preprocess, &genes).into(),
        descriptor: descriptor.into(),
        facts: task::Facts::default(),
    }
}

fn evaluation(archive: &Archive, parameters: Parameters, validation: bool) -> Evaluation {
    let [query, database] = splits(archive, validation);
    let subject = subject(Descriptor::DiskRing(parameters).to_bytes());
    Evaluation { subject, query, database, queries: 0, database_clouds: 0, want_matches: true }
}

fn task(archive: &Archive, parameters: Parameters, validation: bool) -> Task {
    Task::Evaluation(evaluation(archive, parameters, validation))
}

static QUANTISER: LazyLock<Quantiser> = LazyLock::new(|| Quantiser::new(&preparation().genes).unwrap());

/// All clouds as the library prepares them.
static PREPARED: LazyLock<HashMap<Digest, PreparedCloud>> = LazyLock::new(|| {
    let archive = Archive::new();
    let clouds =
        archive.blobs.iter().filter(|(digest, _)| !archive.splits.iter().any(|s| s.0[..] == digest[..]));
    let prepared = |bytes: &[u8]| {
        let cloud = pcd::read(bytes).unwrap();
        PreparedCloud::new(&cloud, &preparation().preprocess, &QUANTISER).unwrap()
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
    let summaries = |manifests: &[Arc<Manifest>]| {
        let prepared = |cloud: &manifest::Listed| &PREPARED[&cloud.digest];
        let clouds: Vec<_> = manifests.iter().flat_map(|manifest| &manifest.clouds).map(prepared).collect();
        summarise(&clouds, &binning)
    };
    let [query, database] = splits(archive, validation);
    let (query, database) = (manifests(&query), manifests(&database));
    let weight = parameters.shape_weight();
    let matches = recognise(&summaries(&query), &summaries(&database), &labels(&database), weight).unwrap();
    let correct = Correct::count(&matches, &labels(&query), &labels(&database));
    TaskResult::Evaluation(result(&correct, &matches))
}

fn store(cache: Option<PathBuf>) -> Arc<Store> {
    let storage = Storage { cache, cache_size: LARGE, ..Storage::in_memory(LARGE) };
    Arc::new(Store::open(&storage, "here"))
}

fn workshop(archive: &Archive, memory: Size, store: &Arc<Store>) -> Arc<Workshop> {
    let blobs = Blobs::new(archive.clone().serve(), Some(Arc::clone(store)));
    Arc::new(Workshop::new(2, memory, blobs, Arc::clone(store)).unwrap())
}

async fn carry_out(workshop: &Arc<Workshop>, task: Task) -> TaskResult {
    Arc::clone(workshop).carry_out(task).await.unwrap()
}

/// Carries out training and validation of all descriptors, and compares with the plain evaluations.
async fn check(workshop: &Arc<Workshop>, archive: &Archive) {
    for parameters in descriptors() {
        for validation in [false, true] {
            let outcome = carry_out(workshop, task(archive, parameters, validation)).await;
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
    let workshop = workshop(&archive, LARGE, &store(None));
    check(&workshop, &archive).await;
    assert_eq!(workshop.work().prepared, CLOUDS);
}

#[tokio::test(flavor = "multi_thread")]
async fn only_what_depends_on_the_changed_gene_is_computed() {
    let archive = Archive::new();
    let workshop = workshop(&archive, LARGE, &store(None));
    let mut before = workshop.work();
    let base = [8, 3, 10_000, 30_000, 500_000];
    let both = 2 * SPLIT;
    for (ticks, validation, described, matched) in [
        (base, false, 2 * both, 2),
        ([8, 3, 10_000, 30_000, 250_000], false, 0, 0),
        ([20, 3, 10_000, 30_000, 250_000], false, both, 1),
        ([20, 5, 10_000, 30_000, 250_000], false, both, 1),
        // The database's parts are there; only the queries are counted.
        (base, true, 2 * SPLIT, 2),
        (base, true, 0, 0),
        ([8, 3, 15_000, 30_000, 500_000], false, 2 * both, 2),
        (base, false, 0, 0),
    ] {
        carry_out(&workshop, task(&archive, parameters(ticks), validation)).await;
        let work = workshop.work();
        let done = (work.described - before.described, work.matched - before.matched);
        assert_eq!(done, (described, matched), "{ticks:?}, {validation}");
        before = work;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn clouds_that_do_not_fit_are_streamed_with_the_same_results() {
    let (archive, cache) = (Archive::new(), tempfile::tempdir().unwrap());
    let streaming = workshop(&archive, SMALL, &store(Some(cache.path().to_owned())));
    check(&streaming, &archive).await;
    let work = streaming.work();
    assert_eq!(work.prepared, CLOUDS);
    assert!(work.loaded > 0, "everything fitted: {work:?}");

    let rebuilding = workshop(&archive, SMALL, &store(None));
    check(&rebuilding, &archive).await;
    assert!(rebuilding.work().prepared > CLOUDS, "everything fitted");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_second_worker_prepares_nothing_and_damaged_entries_are_rebuilt() {
    let (archive, cache) = (Archive::new(), tempfile::tempdir().unwrap());
    let start = || workshop(&archive, LARGE, &store(Some(cache.path().to_owned())));
    check(&start(), &archive).await;
    let warm = start();
    check(&warm, &archive).await;
    let work = warm.work();
    assert_eq!((work.prepared, work.loaded, warm.supply.blobs.fetched()), (0, CLOUDS, 0));

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
    let streaming = workshop(&archive, SMALL, &store(Some(cache.path().to_owned())));
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
    check(&workshop(&archive, LARGE, &store(Some(cache))), &archive).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn workers_of_one_process_prepare_each_cloud_once() {
    let (archive, cache) = (Archive::new(), tempfile::tempdir().unwrap());
    let store = store(Some(cache.path().to_owned()));
    let workers = [(); 3].map(|()| workshop(&archive, LARGE, &store));
    futures_util::future::join_all(workers.iter().map(|worker| check(worker, &archive))).await;
    assert_eq!(workers.iter().map(|worker| worker.work().prepared).sum::<u64>(), CLOUDS);
}

#[tokio::test(flavor = "multi_thread")]
async fn workers_of_several_processes_may_prepare_the_same_cloud() {
    let (archive, cache) = (Archive::new(), tempfile::tempdir().unwrap());
    let start = || workshop(&archive, LARGE, &store(Some(cache.path().to_owned())));
    let workers = [start(), start()];
    futures_util::future::join_all(workers.iter().map(|worker| check(worker, &archive))).await;
    assert_eq!(files(&cache.path().join("derived")).len() as u64, CLOUDS);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_coordinators_entries_are_used_if_they_are_sound() {
    let (archive, caches) = (Archive::new(), [(); 3].map(|()| tempfile::tempdir().unwrap()));
    let start = |cache: &tempfile::TempDir| workshop(&archive, LARGE, &store(Some(cache.path().to_owned())));
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

async fn describe(workshop: &Arc<Workshop>, parameters: Parameters, manifest: Digest) -> Vec<u8> {
    let subject = subject(Descriptor::DiskRing(parameters).to_bytes());
    match carry_out(workshop, Task::Description(Description { subject, manifest, clouds: 0 })).await {
        TaskResult::Description(Described { bytes: Some(bytes), .. }) => bytes.to_vec(),
        result => panic!("{result:?}"),
    }
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
    let describer = workshop(&archive, LARGE, &store(None));
    // None of them has parts in common with another.
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
        let alone = workshop(&archive, LARGE, &store(None));
        assert_eq!(carry_out(&alone, tile(&archive, parameters, descriptions)).await, expected);
        assert_eq!((alone.work().described, alone.work().handed), (2 * CLOUDS, 0));

        for shard in shards {
            let bytes = describe(&describer, parameters, shard).await;
            archive.add(bytes);
        }
        let other = workshop(&archive, LARGE, &store(None));
        assert_eq!(carry_out(&other, tile(&archive, parameters, descriptions)).await, expected);
        assert_eq!((other.work().described, other.work().handed, other.work().prepared), (0, 3, 0));
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_wrong_description_is_taken_for_nothing_but_itself() {
    let mut archive = Archive::new();
    let [parameters, ..] = descriptors();
    let shards = [2, 0, 1].map(|split| archive.splits[split]);
    let honest = workshop(&archive, LARGE, &store(None));
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
    let others = [(); 2].map(|()| workshop(&archive, LARGE, &store(None)));
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
async fn a_grid_cell_is_its_descriptors() {
    let archive = Archive::new();
    for memory in [LARGE, SMALL] {
        let workshop = workshop(&archive, memory, &store(None));
        let ([query, database], subject) = (splits(&archive, true), subject(cell_to_bytes([15_000, 40_000])));
        let (queries, database_clouds, descriptors) = (0, 0, 3 * 2 * 5);
        let cell = GridCell { subject, query, database, queries, database_clouds, descriptors };
        let TaskResult::GridCell(counts) = carry_out(&workshop, Task::GridCell(cell)).await else {
            panic!("another outcome")
        };
        let mut expected = Vec::new();
        for shape_bins in [8, 20, 32] {
            for m in [3, 5] {
                for weight in [0, 250_000, 500_000, 750_000, 1_000_000] {
                    let descriptor = parameters([shape_bins, m, 15_000, 40_000, weight]);
                    let TaskResult::Evaluation(found) = plain(&archive, descriptor, true) else { panic!() };
                    expected.push(found.object_correct);
                }
            }
        }
        assert_eq!(counts, expected);
        assert_eq!(workshop.work().cells, 1);
    }
}
