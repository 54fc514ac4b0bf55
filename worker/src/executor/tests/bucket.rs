//! A bucket that machines share saves them work; whatever is wrong with it costs them time at most.

use proto::task::Described;
use proto::{BLOB_KIND, MIN_SHARED_DESCRIPTION_BYTES};
use ring::digest;
use tempfile::tempdir;

use super::bucket_server::{BucketServer, Mode};
use super::*;
use crate::PREPARED_CLOUD;

/// An executor of a machine of its own, which the coordinator tells of a bucket.
fn machine(archive: &Archive, cache: &Path, server: &BucketServer, read_only: bool) -> Arc<Executor> {
    let archive = Archive { bucket: Some(server.clone()), ..archive.clone() };
    let storage = Storage {
        cache: Some(cache.to_owned()),
        cache_size: LARGE,
        shared_read_only: read_only,
        ..Storage::in_memory(LARGE)
    };
    let store = Arc::new(Store::open(&storage, "here", EVALUATION_VERSION));
    let executor = executor(&archive, LARGE, &store);
    executor.offer_bucket(true);
    executor
}

/// Evaluates the training and validation splits with it, and compares the answers with their definition; all clouds are
/// asked for.
async fn work_through(executor: &Arc<Executor>, archive: &Archive) -> Work {
    for validation in [false, true] {
        let parameters = descriptors()[0];
        let answer = carry_out(executor, task(archive, parameters, validation)).await;
        assert_eq!(answer, plain(archive, parameters, validation));
    }
    let work = executor.work();
    assert_eq!(work.prepared + work.loaded + work.fetched, CLOUDS);
    work
}

/// A bucket into which one machine has put everything that it had.
async fn filled(archive: &Archive) -> BucketServer {
    let (server, cache) = (BucketServer::start(Mode::Well).await, tempdir().unwrap());
    let first = machine(archive, cache.path(), &server, false);
    assert_eq!(work_through(&first, archive).await.prepared, CLOUDS);
    // Each cloud as it came and prepared, and three manifests.
    assert_eq!(server.objects.lock().unwrap().len() as u64, 2 * CLOUDS + 3);
    server
}

#[tokio::test(flavor = "multi_thread")]
async fn what_one_machine_has_prepared_or_fetched_no_other_does() {
    let archive = Archive::new();
    let server = filled(&archive).await;
    let cache = tempdir().unwrap();
    let second = machine(&archive, cache.path(), &server, false);
    let work = work_through(&second, &archive).await;
    assert_eq!((work.prepared, work.fetched), (0, CLOUDS));
    let blobs = &second.matcher.loader.blobs;
    assert_eq!(blobs.fetched(), 0, "the coordinator gave nothing, not even a manifest");
    // Where only sources are left, they are not fetched from the coordinator either.
    server.objects.lock().unwrap().retain(|path, _| !path.contains("prepared"));
    let cache = tempdir().unwrap();
    let third = machine(&archive, cache.path(), &server, false);
    assert_eq!(work_through(&third, &archive).await.prepared, CLOUDS);
    assert_eq!(third.matcher.loader.blobs.fetched(), 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn whatever_is_wrong_with_a_bucket_no_result_depends_on_it() {
    let archive = Archive::new();
    let objects = filled(&archive).await.objects;
    let everything = 2 * CLOUDS as u32 + 3; // prepared clouds, their sources and three manifests
    for (mode, reads) in [
        (Mode::Hung, 1..=1),
        (Mode::Stalls, 2..=everything),
        (Mode::Forbidden, 1..=1),
        // Three damaged objects in a row, and what was asked for at once with the third.
        (Mode::Truncating, 3..=18),
        (Mode::Corrupt, 3..=18),
        (Mode::TooLarge, 1..=1),
        (Mode::Gone, 0..=0),
    ] {
        let (server, cache) = (BucketServer::with(mode, Arc::clone(&objects)).await, tempdir().unwrap());
        let executor = machine(&archive, cache.path(), &server, true);
        let work = work_through(&executor, &archive).await;
        assert_eq!((work.prepared, work.fetched), (CLOUDS, 0), "{mode:?}");
        let [read, written] = server.asked();
        assert!(reads.contains(&read), "{mode:?}: {read} reads");
        assert_eq!(written, 0, "{mode:?}: it is read only");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_bucket_that_takes_nothing_is_asked_once() {
    let archive = Archive::new();
    for mode in [Mode::Full, Mode::Forbidden] {
        let (server, cache) = (BucketServer::start(mode).await, tempdir().unwrap());
        let executor = machine(&archive, cache.path(), &server, false);
        assert_eq!(work_through(&executor, &archive).await.prepared, CLOUDS, "{mode:?}");
        assert_eq!(server.asked()[1], 1, "{mode:?}");
        assert!(server.objects.lock().unwrap().is_empty());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_damaged_in_a_bucket_is_replaced() {
    let archive = Archive::new();
    let server = filled(&archive).await;
    let sound = server.objects.lock().unwrap().clone();
    for bytes in server.objects.lock().unwrap().values_mut() {
        bytes[0] ^= 1;
    }
    let cache = tempdir().unwrap();
    let second = machine(&archive, cache.path(), &server, false);
    assert_eq!(work_through(&second, &archive).await.prepared, CLOUDS);
    assert!(*server.objects.lock().unwrap() == sound);
    let cache = tempdir().unwrap();
    let third = machine(&archive, cache.path(), &server, false);
    assert_eq!(work_through(&third, &archive).await.prepared, 0);
}

/// A sound entry with another cloud in it, as somebody would store it who knows how entries are made, in place of the right one.
fn forge_an_entry(archive: &Archive, server: &BucketServer) {
    let (preparing, forger) = (PreparationCache::new(&preparation(), LARGE).unwrap(), store(None));
    let [query, _] = splits(archive, false);
    let manifest = Manifest::decode(query[0], &archive.blobs[&query[0].to_vec()]).unwrap();
    let [one, another] = [0, 1].map(|index: usize| &manifest.clouds[index]);
    let prepared = preparing.prepare(another, &archive.blobs[&another.digest.to_vec()]).unwrap();
    let payload = preparing.preparer.encode(&prepared).unwrap();
    let key = preparing.entry_key(one.digest).unwrap();
    let forged = forger.as_entry(PREPARED_CLOUD, key, &payload);
    server.objects.lock().unwrap().insert(format!("/lab/prepared-cloud-2/{key}"), forged).unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn entries_of_a_bucket_are_checked_as_all_that_others_have_made() {
    let archive = Archive::new();
    let server = filled(&archive).await;
    forge_an_entry(&archive, &server);
    let cache = tempdir().unwrap();
    let second = machine(&archive, cache.path(), &server, false);
    second.set_audit(1.0);
    let wrong = Arc::clone(&second).carry_out(task(&archive, descriptors()[0], false)).await;
    assert!(matches!(wrong, Err(EvaluationError::Distrusted(_))), "{wrong:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn no_other_content_is_used_than_the_coordinator_vouches_for() {
    let archive = Archive::new();
    let server = filled(&archive).await;
    let sum = |bytes: &Vec<u8>| digest::digest(&digest::SHA256, bytes).as_ref().to_vec();
    let known =
        server.objects.lock().unwrap().iter().map(|(path, bytes)| (path.clone(), sum(bytes))).collect();
    *server.known.lock().unwrap() = known;
    let cache = tempdir().unwrap();
    let second = machine(&archive, cache.path(), &server, true);
    assert_eq!(work_through(&second, &archive).await.prepared, 0);
    forge_an_entry(&archive, &server);
    let cache = tempdir().unwrap();
    let third = machine(&archive, cache.path(), &server, true);
    assert_eq!(work_through(&third, &archive).await.prepared, 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn large_descriptions_are_given_to_others_by_the_bucket() {
    let archive = Archive::new();
    let (server, cache) = (BucketServer::start(Mode::Well).await, tempdir().unwrap());
    let first = machine(&archive, cache.path(), &server, false);
    let described = |bytes| Described::new(vec![7; bytes]);
    let large = described(MIN_SHARED_DESCRIPTION_BYTES);
    let blobs = &first.matcher.loader.blobs;
    blobs.share(&large);
    blobs.share(&described(MIN_SHARED_DESCRIPTION_BYTES - 1));
    blobs.bucket.settle().await;
    assert_eq!(server.objects.lock().unwrap().len(), 1);
    let cache = tempdir().unwrap();
    let second = machine(&archive, cache.path(), &server, false);
    let blobs = &second.matcher.loader.blobs;
    let given = blobs.given(large.digest).await.expect("the coordinator of this test has none");
    assert_eq!((Digest::of(&given), blobs.fetched()), (large.digest, 0));
}

#[tokio::test]
async fn what_is_put_during_a_trial_is_stored_once_it_has_ended_well() {
    let archive = Archive::new();
    let (server, cache) = (BucketServer::start(Mode::Well).await, tempdir().unwrap());
    let bucket = &machine(&archive, cache.path(), &server, false).matcher.loader.blobs.bucket;
    let put = |bytes: Vec<u8>| bucket.put(BLOB_KIND, vec![(Digest::of(&bytes), bytes)]);
    // On one thread, no upload begins before the first two are on their way, and the answer to the trial is not heard of
    // before the third is.
    put(vec![1]);
    put(vec![2]);
    while server.asked()[1] == 0 {
        tokio::task::yield_now().await;
    }
    put(vec![3]);
    bucket.settle().await;
    assert_eq!(server.objects.lock().unwrap().len(), 3);
}

#[tokio::test(flavor = "multi_thread")]
async fn what_the_coordinator_has_prepared_the_bucket_has_from_then_on() {
    let archive = Archive::new();
    let folder = tempdir().unwrap();
    let source = store(Some(folder.path().to_owned()));
    carry_out(&executor(&archive, LARGE, &source), task(&archive, descriptors()[0], true)).await;
    let cache = PreparationCache::new(&preparation(), LARGE).unwrap();
    let entry = |cloud: &Digest| {
        let key = cache.entry_key(*cloud).unwrap();
        (key.to_vec(), source.entry(PREPARED_CLOUD, key).unwrap())
    };
    archive.derived.lock().unwrap().extend(PREPARED.keys().map(entry));
    let (server, cache) = (BucketServer::start(Mode::Well).await, tempdir().unwrap());
    let second = machine(&archive, cache.path(), &server, false);
    assert_eq!(work_through(&second, &archive).await.fetched, CLOUDS);
    archive.derived.lock().unwrap().clear();
    let cache = tempdir().unwrap();
    let third = machine(&archive, cache.path(), &server, false);
    let work = work_through(&third, &archive).await;
    assert_eq!((work.prepared, work.fetched), (0, CLOUDS));
}
