//! What workers may have of the bucket, and who is found out.

use std::collections::HashMap;
use std::sync::atomic::{AtomicU32, Ordering};

use cluster::scheduler::{Audit, Limits};
use descriptor::synth::{self, SynthSettings};
use descriptor::{GeneTable, Preprocess, SearchSpace, pcd};
use proto::Origin;
use tempfile::TempDir;
use worker::prepared_cloud_key;

use super::*;
use crate::dataset::CloudEntry;
use crate::storage::store_in;

#[test]
fn test_clouds_are_given_in_no_form_before_they_are_released() {
    let folder = tempfile::tempdir().unwrap();
    let (preprocess, blobs) = (Preprocess::default(), BlobStore::default());
    let preparer = SearchSpace::DiskRing(GeneTable::paper()).preparer().unwrap();
    let (train, test) = (blobs.publish_bytes(b"train".to_vec()), Digest::of(b"test"));
    let cloud = |source: Digest| {
        let path = "a/a_1/a_1_1_1.pcd".to_owned();
        CloudEntry { path, category: 0, instance: 0, sequence: None, set: 0, digest: source.0, bytes: 5 }
    };
    let store = Arc::new(store_in(folder.path()));
    let clouds = [cloud(train), cloud(test)];
    let prepared = PreparedClouds::new(store, &preprocess, std::slice::from_ref(&preparer), &clouds);
    let key = |source| prepared_cloud_key(&preprocess, &preparer, source).unwrap();
    let given =
        |kind: &str, key| [false, true].map(|is_write| is_given(kind, key, is_write, (&prepared, &blobs)));
    assert_eq!(given(BLOB_KIND, train), [true, true]);
    assert_eq!(given(PREPARED_CLOUD, key(train)), [true, true]);
    assert_eq!(given(BLOB_KIND, test), [false, true], "who has it may store it, nobody gets it");
    assert_eq!(given(PREPARED_CLOUD, key(test)), [false, false]);
    assert_eq!(given(PREPARED_CLOUD, train), [false, false], "of no cloud of this run");
    assert_eq!(given("signatures 1", key(train)), [false, false]);
    assert_eq!(given(BLOB_KIND, Digest::of(b"forgotten")), [true, true]);
    let described = |bytes| {
        let parts: Arc<[u8]> = vec![7; bytes].into();
        blobs.publish_description(Digest::of(&parts), &parts);
        given(BLOB_KIND, Digest::of(&parts))
    };
    assert_eq!(described(MIN_SHARED_DESCRIPTION_BYTES), [true, true]);
    assert_eq!(described(MIN_SHARED_DESCRIPTION_BYTES - 1), [false, true], "nobody has stored it");
    blobs.publish_bytes(b"test".to_vec());
    assert_eq!(given(BLOB_KIND, test), [true, true]);
    assert_eq!(given(PREPARED_CLOUD, key(test)), [true, true]);
}

/// How the server answers.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Mode {
    Well,
    Hung,
    Forbidden,
}

/// A bucket for the prepared clouds of a run.
struct Bench {
    entries: Entries,
    keys: Vec<Digest>,
    objects: Arc<Mutex<HashMap<Digest, Vec<u8>>>>,
    reads: Arc<AtomicU32>,
    _folder: TempDir,
}

/// Entries of an author that are checked before others are given.
const FIRST: u32 = 3;
const CLOUDS: usize = 8;

impl Bench {
    fn new(share: f64, mode: Mode) -> Self {
        let limits = Limits { audit: Audit { share, first: FIRST }, ..Limits::SAMPLE };
        let (cluster, folder) = (Cluster::new(limits), tempfile::tempdir().unwrap());
        let settings = SynthSettings::default();
        let object = &synth::catalogue(&settings)[0];
        let publish = |view| {
            let cloud = synth::render(&settings, object, view);
            cluster.blobs.publish_bytes(pcd::write(&cloud, pcd::DataEncoding::Binary))
        };
        let sources: Vec<Digest> = (0..CLOUDS as u32).map(publish).collect();
        let entry = |source: &Digest| {
            let path = "a/a_1/a_1_1_1.pcd".to_owned();
            CloudEntry { path, category: 0, instance: 0, sequence: None, set: 0, digest: source.0, bytes: 5 }
        };
        let clouds: Vec<CloudEntry> = sources.iter().map(entry).collect();
        let preprocess = Preprocess::default();
        let preparer = SearchSpace::DiskRing(GeneTable::paper()).preparer().unwrap();
        let keys = sources.iter().map(|source| prepared_cloud_key(&preprocess, &preparer, *source).unwrap());
        let keys = keys.collect();
        let store = Arc::new(store_in(folder.path()));
        let prepared = PreparedClouds::new(store, &preprocess, std::slice::from_ref(&preparer), &clouds);
        let (objects, reads) =
            (Arc::<Mutex<HashMap<Digest, Vec<u8>>>>::default(), Arc::<AtomicU32>::default());
        let (source, count) = (Arc::clone(&objects), Arc::clone(&reads));
        let read = move |key| {
            count.fetch_add(1, Ordering::Relaxed);
            let object = source.lock().unwrap().get(&key).cloned();
            let answer = async move {
                match mode {
                    Mode::Well => Ok(object),
                    Mode::Hung => std::future::pending().await,
                    Mode::Forbidden => Err("403 Forbidden".to_owned()),
                }
            };
            answer.boxed()
        };
        let entries = Entries::new(Arc::new(prepared), cluster, Box::new(read));
        Self { entries, keys, objects, reads, _folder: folder }
    }

    /// The entry of one cloud, with what another is when prepared.
    fn entry(&self, index: usize, source: usize) -> Vec<u8> {
        let prepared = &self.entries.prepared;
        let payload = prepared.prepare(self.keys[source], &self.entries.cluster.blobs).unwrap();
        store_in(self._folder.path()).as_entry(PREPARED_CLOUD, self.keys[index], &payload)
    }

    /// A worker stores an entry: whether it was let.
    async fn store(&self, index: usize, bytes: Vec<u8>, principal: Principal) -> bool {
        let mut sha256 = [0; 32];
        sha256.copy_from_slice(digest::digest(&digest::SHA256, &bytes).as_ref());
        let object = ObjectRequest { key: self.keys[index], sha256: Some(sha256) };
        let mut given = [true];
        self.entries.admit(principal, &[object], &mut given).await.unwrap();
        self.objects.lock().unwrap().insert(self.keys[index], bytes);
        given[0]
    }

    /// Which entries a worker gets.
    async fn get(&self, principal: Principal) -> Result<Vec<bool>, String> {
        let object = |key: &Digest| ObjectRequest { key: *key, sha256: None };
        let objects: Vec<_> = self.keys.iter().map(object).collect();
        let mut given = vec![true; objects.len()];
        self.entries.admit(principal, &objects, &mut given).await?;
        Ok(given)
    }

    fn reads(&self) -> u32 {
        self.reads.load(Ordering::Relaxed)
    }
}

fn principal(byte: u8) -> Principal {
    Principal::Anonymous(Origin::of([192, 0, 2, byte].into()))
}

#[tokio::test]
async fn whoever_stores_wrong_clouds_is_quarantined_before_anybody_gets_one() {
    let bench = Bench::new(0.0, Mode::Well);
    for index in 0..CLOUDS {
        let source = if index < 4 { index } else { 0 };
        let author = if index < 4 { principal(1) } else { principal(2) };
        assert!(bench.store(index, bench.entry(index, source), author).await);
    }
    assert_eq!(bench.get(principal(9)).await.unwrap(), [[true; 4], [false; 4]].concat());
    assert!(bench.entries.cluster.is_quarantined(&principal(2)));
    assert!(!bench.entries.cluster.is_quarantined(&principal(1)));
    // What another makes instead is given again.
    for index in 4..CLOUDS {
        bench.store(index, bench.entry(index, index), principal(1)).await;
    }
    assert_eq!(bench.get(principal(9)).await.unwrap()[..4], [true; 4]);
}

#[tokio::test]
async fn who_lies_after_it_has_earned_trust_is_found_by_the_share_that_is_checked() {
    let bench = Bench::new(1.0, Mode::Well);
    for index in 0..CLOUDS {
        let source = if index < 7 { index } else { 0 };
        bench.store(index, bench.entry(index, source), principal(1)).await;
    }
    assert_eq!(bench.get(principal(9)).await.unwrap(), [[true; 7].as_slice(), &[false]].concat());
    assert!(bench.entries.cluster.is_quarantined(&principal(1)));
}

#[tokio::test]
async fn what_earlier_runs_have_stored_is_looked_at_once() {
    let bench = Bench::new(0.0, Mode::Well);
    assert_eq!(bench.get(principal(8)).await.unwrap(), [false; CLOUDS], "nothing is there");
    assert_eq!(bench.reads(), CLOUDS as u32);
    let bench = Bench::new(0.0, Mode::Well);
    let all = (0..CLOUDS).map(|index| (bench.keys[index], bench.entry(index, index)));
    bench.objects.lock().unwrap().extend(all.collect::<Vec<_>>());
    for _ in 0..3 {
        assert_eq!(bench.get(principal(9)).await.unwrap(), [true; CLOUDS]);
        assert_eq!(bench.reads(), FIRST);
    }
}

#[tokio::test]
async fn wrong_clouds_of_earlier_runs_are_used_by_nobody() {
    let bench = Bench::new(0.0, Mode::Well);
    let all =
        (0..CLOUDS).map(|index| (bench.keys[index], bench.entry(index, if index == 1 { 0 } else { index })));
    bench.objects.lock().unwrap().extend(all.collect::<Vec<_>>());
    let given = bench.get(principal(9)).await.unwrap();
    assert!(!given[1] && given[2], "{given:?}");
    assert_eq!(bench.reads(), CLOUDS as u32, "each is looked at, as none may be believed");
    assert_eq!(bench.entries.cluster.quarantined().len(), 0);
}

#[tokio::test]
async fn a_damaged_entry_is_made_again_and_blames_nobody() {
    let bench = Bench::new(0.0, Mode::Well);
    for index in 0..CLOUDS {
        bench.store(index, bench.entry(index, index), principal(1)).await;
    }
    *bench.objects.lock().unwrap().get_mut(&bench.keys[0]).unwrap().last_mut().unwrap() ^= 1;
    let given = bench.get(principal(9)).await.unwrap();
    assert_eq!(given, [[false].as_slice(), &[true; CLOUDS - 1]].concat());
    bench.store(0, bench.entry(0, 0), principal(9)).await;
    assert!(bench.get(principal(8)).await.unwrap()[0]);
    assert!(bench.entries.cluster.quarantined().is_empty());
}

#[tokio::test]
async fn a_bucket_that_cannot_be_checked_holds_nobody_up_twice() {
    for (mode, expected) in [(Mode::Hung, "waited 10ms"), (Mode::Forbidden, "403 Forbidden")] {
        let mut bench = Bench::new(0.0, mode);
        bench.entries.patience = Duration::from_millis(10);
        let error = bench.get(principal(8)).await.unwrap_err();
        assert!(error.contains(expected), "{error}");
        let reads = bench.reads();
        assert_eq!(bench.get(principal(9)).await.unwrap_err(), error);
        assert_eq!(bench.reads(), reads);
    }
}
