//! Clouds that others have prepared: right ones are used, a wrong one ends the work of whoever finds it.

use super::*;
use crate::PREPARED_CLOUD;

/// A store with a folder of its own that shares another.
fn sharing(cache: &Path, shared: &Path) -> Arc<Store> {
    let shared = Some(shared.to_owned());
    let storage =
        Storage { cache: Some(cache.to_owned()), shared, cache_size: LARGE, ..Storage::in_memory(LARGE) };
    Arc::new(Store::open(&storage, "here", EVALUATION_VERSION))
}

/// An executor that prepares again whatever others have prepared.
fn checking(archive: &Archive, store: &Arc<Store>) -> Arc<Executor> {
    let executor = executor(archive, LARGE, store);
    executor.set_audit(1.0);
    executor
}

#[tokio::test(flavor = "multi_thread")]
async fn a_cloud_that_others_have_prepared_wrongly_ends_the_work_of_whoever_finds_it() {
    let archive = Archive::new();
    let [first, second, third, shared] = [(); 4].map(|()| tempfile::tempdir().unwrap());
    check(&executor(&archive, LARGE, &sharing(first.path(), shared.path())), &archive).await;
    let honest = checking(&archive, &sharing(second.path(), shared.path()));
    check(&honest, &archive).await;
    assert_eq!((honest.work().prepared, honest.work().loaded), (0, CLOUDS), "the right ones are used");

    // A sound entry with another cloud in it.
    let cache = PreparationCache::new(&preparation(), LARGE).unwrap();
    let keys: Vec<Digest> = PREPARED.keys().map(|&cloud| cache.entry_key(cloud).unwrap()).collect();
    let liar = sharing(first.path(), shared.path());
    let payload = liar.get(PREPARED_CLOUD, keys[0]).unwrap();
    assert_ne!(liar.get(PREPARED_CLOUD, keys[1]).unwrap(), payload);
    liar.put(PREPARED_CLOUD, keys[1], &payload);
    let store = sharing(third.path(), shared.path());
    let misled = checking(&archive, &store);
    let mut refused = Vec::new();
    for validation in [false, true, false] {
        let outcome = Arc::clone(&misled).carry_out(task(&archive, descriptors()[0], validation)).await;
        refused.extend(outcome.err().map(|failure| failure.to_string()));
    }
    // Which of the two evaluations has that cloud depends on its key; from then on none is answered.
    assert!(
        refused.len() >= 2 && refused.iter().all(|what| what.contains("must be what its source gives")),
        "{refused:?}"
    );
    assert_eq!(store.local_keys(PREPARED_CLOUD), []);
    assert_eq!(store.get(PREPARED_CLOUD, keys[1]), None, "it is gone from the shared folder");
}

#[tokio::test(flavor = "multi_thread")]
async fn clouds_of_the_coordinator_are_checked_as_well() {
    let archive = Archive::new();
    let [first, second] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let source = store(Some(first.path().to_owned()));
    check(&executor(&archive, LARGE, &source), &archive).await;
    let cache = PreparationCache::new(&preparation(), LARGE).unwrap();
    let entry = |cloud: &Digest| {
        let key = cache.entry_key(*cloud).unwrap();
        (key.to_vec(), source.entry(PREPARED_CLOUD, key).unwrap())
    };
    archive.derived.lock().unwrap().extend(PREPARED.keys().map(entry));
    let honest = checking(&archive, &store(Some(second.path().to_owned())));
    check(&honest, &archive).await;
    assert_eq!((honest.work().prepared, honest.work().fetched), (0, CLOUDS));
}
