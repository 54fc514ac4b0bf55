//! What workers may have of the bucket, and who is found out.

use std::collections::HashMap;
use std::sync::atomic::{AtomicU32, Ordering};

use cluster::scheduler::{Audit, Limits};
use descriptor::synth::{self, SynthSettings};
use descriptor::{GeneTable, Preprocess, SearchSpace, pcd};
use proto::Origin;
use proto::task::Described;
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
    assert_eq!(given("signatures 2", key(train)), [false, false]);
    assert_eq!(given(BLOB_KIND, Digest::of(b"forgotten")), [true, true]);
    let described = |bytes| {
        let described = Described::new(vec![7; bytes]);
        blobs.publish_description(&described);
        given(BLOB_KIND, described.digest)
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

/// Objects by key, and how often somebody has looked.
struct Server {
    mode: Mode,
    objects: Arc<Mutex<HashMap<Digest, Vec<u8>>>>,
    reads: Arc<AtomicU32>,
    swap: Swap,
}

/// An object, and what takes its place once its size was asked for.
type Swap = Arc<Mutex<Option<(Digest, Vec<u8>)>>>;

impl Server {
    fn answer<T: Send + 'static>(&self, answer: T) -> BoxFuture<'static, Result<T, String>> {
        let mode = self.mode;
        let answer = async move {
            match mode {
                Mode::Well => Ok(answer),
                Mode::Hung => std::future::pending().await,
                Mode::Forbidden => Err("403 Forbidden".to_owned()),
            }
        };
        answer.boxed()
    }
}

impl Objects for Server {
    fn size(&self, key: Digest) -> BoxFuture<'static, Result<Option<u64>, String>> {
        self.reads.fetch_add(1, Ordering::Relaxed);
        let mut objects = self.objects.lock().unwrap();
        let size = objects.get(&key).map(|bytes| bytes.len() as u64);
        objects.extend(self.swap.lock().unwrap().take_if(|(swapped, _)| *swapped == key));
        self.answer(size)
    }

    fn read(&self, key: Digest, most: u64) -> BoxFuture<'static, Result<Option<Vec<u8>>, String>> {
        let bytes = self.objects.lock().unwrap().get(&key).cloned();
        assert!(
            bytes.as_ref().is_none_or(|bytes| bytes.len() as u64 <= most),
            "what is larger is not asked for"
        );
        self.answer(bytes)
    }
}

/// A bucket for the prepared clouds of a run.
struct Bench {
    entries: Arc<Entries>,
    keys: Vec<Digest>,
    objects: Arc<Mutex<HashMap<Digest, Vec<u8>>>>,
    reads: Arc<AtomicU32>,
    swap: Swap,
    _folder: TempDir,
}

/// Entries of an author that are checked before others are given.
const FIRST: u32 = 3;
const CLOUDS: usize = 8;
/// For what is never answered.
const SHORT: Duration = Duration::from_millis(10);

impl Bench {
    fn new(share: f64, mode: Mode) -> Self {
        Self::patient(share, mode, PATIENCE)
    }

    fn patient(share: f64, mode: Mode, patience: (Duration, Duration)) -> Self {
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
        let swap = Swap::default();
        let (at, counted) = (Arc::clone(&objects), Arc::clone(&reads));
        let server = Server { mode, objects: at, reads: counted, swap: Arc::clone(&swap) };
        let entries = Entries::new(Arc::new(prepared), cluster, Box::new(server));
        let entries = Arc::new(Entries { patience, ..entries });
        Self { entries, keys, objects, reads, swap, _folder: folder }
    }

    /// The entry of one cloud, with what another is when prepared.
    fn entry(&self, index: usize, source: usize) -> Vec<u8> {
        let prepared = &self.entries.prepared;
        let payload = prepared.prepare(self.keys[source], &self.entries.cluster.blobs).unwrap();
        store_in(self._folder.path()).as_entry(PREPARED_CLOUD, self.keys[index], &payload)
    }

    /// A worker asks to store an entry: whether it was let.
    async fn sign(&self, index: usize, bytes: &[u8], principal: Principal) -> bool {
        let object = ObjectRequest { key: self.keys[index], sha256: Some(sha256_of(bytes)) };
        let mut given = [Given::Anything];
        self.entries.admit(principal, &[object], &mut given).await.unwrap();
        given[0] != Given::Withheld
    }

    /// A worker stores an entry: whether it was let.
    async fn store(&self, index: usize, bytes: Vec<u8>, principal: Principal) -> bool {
        let is_signed = self.sign(index, &bytes, principal).await;
        if is_signed {
            self.put(index, bytes);
        }
        is_signed
    }

    /// An entry is there, whoever has stored it.
    fn put(&self, index: usize, bytes: Vec<u8>) {
        self.objects.lock().unwrap().insert(self.keys[index], bytes);
    }

    /// What a worker gets of the entries.
    async fn get(&self, principal: Principal) -> Result<Vec<Given>, String> {
        let object = |key: &Digest| ObjectRequest { key: *key, sha256: None };
        let objects: Vec<_> = self.keys.iter().map(object).collect();
        let mut given = vec![Given::Anything; objects.len()];
        self.entries.admit(principal, &objects, &mut given).await?;
        Ok(given)
    }

    /// Which entries a worker gets.
    async fn is_given(&self, principal: Principal) -> Vec<bool> {
        let given = self.get(principal).await.unwrap();
        given.into_iter().map(|given| given != Given::Withheld).collect()
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
    assert_eq!(bench.is_given(principal(9)).await, [[true; 4], [false; 4]].concat());
    assert!(bench.entries.cluster.is_quarantined(&principal(2)));
    assert!(!bench.entries.cluster.is_quarantined(&principal(1)));
    // What another makes instead is given again.
    for index in 4..CLOUDS {
        assert!(bench.store(index, bench.entry(index, index), principal(1)).await);
    }
    assert_eq!(bench.is_given(principal(9)).await, [true; CLOUDS]);
}

#[tokio::test]
async fn whoever_adds_to_a_wrong_cloud_more_bytes_than_one_has_is_quarantined_too() {
    let bench = Bench::new(1.0, Mode::Well);
    let mut padded = bench.entry(0, 1);
    padded.resize(1 << 20, 0);
    assert!(bench.store(0, padded, principal(2)).await);
    for index in 1..CLOUDS {
        bench.store(index, bench.entry(index, index), principal(1)).await;
    }
    assert_eq!(bench.is_given(principal(9)).await, [[false].as_slice(), &[true; CLOUDS - 1]].concat());
    assert_eq!(bench.entries.cluster.quarantined(), [principal(2)].into());
}

#[tokio::test]
async fn whoever_stores_a_right_cloud_is_not_blamed_for_what_was_there_before() {
    let bench = Bench::new(1.0, Mode::Well);
    let mut padded = bench.entry(0, 1);
    padded.resize(1 << 20, 0);
    bench.put(0, padded);
    let right = bench.entry(0, 0);
    assert!(bench.sign(0, &right, principal(1)).await);
    *bench.swap.lock().unwrap() = Some((bench.keys[0], right));
    for index in 1..CLOUDS {
        bench.store(index, bench.entry(index, index), principal(1)).await;
    }
    assert_eq!(bench.is_given(principal(9)).await, [true; CLOUDS]);
    assert!(bench.swap.lock().unwrap().is_none(), "it has taken its place in the middle of a check");
    assert!(bench.entries.cluster.quarantined().is_empty());
}

#[tokio::test]
async fn who_lies_after_it_has_earned_trust_is_found_by_the_share_that_is_checked() {
    let bench = Bench::new(1.0, Mode::Well);
    for index in 0..CLOUDS {
        let source = if index < 7 { index } else { 0 };
        bench.store(index, bench.entry(index, source), principal(1)).await;
    }
    assert_eq!(bench.is_given(principal(9)).await, [[true; 7].as_slice(), &[false]].concat());
    assert!(bench.entries.cluster.is_quarantined(&principal(1)));
}

#[tokio::test]
async fn whoever_is_quarantined_for_an_answer_has_stored_nothing_to_be_believed() {
    let bench = Bench::new(0.0, Mode::Well);
    let right: Vec<Vec<u8>> = (0..CLOUDS).map(|index| bench.entry(index, index)).collect();
    for (index, bytes) in right.iter().enumerate() {
        bench.store(index, bytes.clone(), principal(1)).await;
    }
    assert_eq!(bench.is_given(principal(9)).await, [true; CLOUDS]);
    bench.entries.cluster.quarantine(principal(1));
    (0..CLOUDS).for_each(|index| bench.put(index, bench.entry(index, (index + 1) % CLOUDS)));
    // Of those that were looked at, the content that was there then; the others are looked at now.
    let given = bench.get(principal(9)).await.unwrap();
    let is_right = |(given, bytes): &(&Given, &Vec<u8>)| **given == Given::Content(sha256_of(bytes));
    assert_eq!(given.iter().zip(&right).filter(is_right).count(), FIRST as usize);
    assert_eq!(given.iter().filter(|given| **given == Given::Withheld).count(), CLOUDS - FIRST as usize);
    assert_eq!(bench.reads(), CLOUDS as u32);
}

#[tokio::test]
async fn what_earlier_runs_have_stored_is_looked_at_once() {
    let bench = Bench::new(0.0, Mode::Well);
    assert_eq!(bench.is_given(principal(8)).await, [false; CLOUDS], "nothing is there");
    assert_eq!(bench.reads(), CLOUDS as u32);
    let bench = Bench::new(0.0, Mode::Well);
    (0..CLOUDS).for_each(|index| bench.put(index, bench.entry(index, index)));
    for _ in 0..3 {
        assert_eq!(bench.is_given(principal(9)).await, [true; CLOUDS]);
        assert_eq!(bench.reads(), FIRST);
    }
}

#[tokio::test]
async fn wrong_clouds_of_earlier_runs_are_used_by_nobody() {
    // Nor if somebody who is trusted asks to store right ones in their place, and does not.
    for is_signed in [false, true] {
        let bench = Bench::new(0.0, Mode::Well);
        (0..CLOUDS).for_each(|index| bench.put(index, bench.entry(index, (index + 1) % CLOUDS)));
        let right: Vec<Vec<u8>> = (0..CLOUDS).map(|index| bench.entry(index, index)).collect();
        for (index, bytes) in right.iter().enumerate().filter(|_| is_signed) {
            assert!(bench.sign(index, bytes, Principal::Coordinator).await);
        }
        let given = bench.get(principal(9)).await.unwrap();
        for (given, bytes) in given.iter().zip(&right) {
            let expected = if is_signed { Given::Content(sha256_of(bytes)) } else { Given::Withheld };
            assert_eq!(*given, expected);
        }
        let looks = if is_signed { 0 } else { CLOUDS as u32 };
        assert_eq!(bench.reads(), looks, "each is looked at, as none may be believed");
        assert_eq!(bench.entries.cluster.quarantined().len(), 0);
    }
}

#[tokio::test]
async fn a_damaged_entry_is_made_again_and_blames_nobody() {
    let bench = Bench::new(1.0, Mode::Well);
    for index in 0..CLOUDS {
        bench.store(index, bench.entry(index, index), principal(1)).await;
    }
    let (mut damaged, mut larger) = (bench.entry(0, 0), bench.entry(1, 1));
    *damaged.last_mut().unwrap() ^= 1;
    larger.resize(1 << 20, 0);
    bench.put(0, damaged);
    bench.put(1, larger);
    assert_eq!(bench.is_given(principal(9)).await, [[false; 2].as_slice(), &[true; CLOUDS - 2]].concat());
    for index in [0, 1] {
        assert!(bench.store(index, bench.entry(index, index), principal(9)).await);
    }
    assert_eq!(bench.is_given(principal(8)).await, [true; CLOUDS]);
    assert!(bench.entries.cluster.quarantined().is_empty());
}

#[tokio::test]
async fn what_takes_long_to_check_is_withheld_until_it_was() {
    let bench = Bench::patient(1.0, Mode::Well, (SHORT, SHORT));
    for index in 0..CLOUDS {
        bench.store(index, bench.entry(index, index), principal(1)).await;
    }
    // Somebody else is busy with all checks that can be made at once.
    let places = bench.entries.at_once.acquire_many(CHECKS_AT_ONCE as u32).await.unwrap();
    assert_eq!(bench.is_given(principal(9)).await, [false; CLOUDS]);
    assert_eq!(bench.reads(), 0);
    drop(places);
    let looks: Vec<Look> = lock(&bench.entries.looks).values().cloned().collect();
    futures_util::future::join_all(looks).await;
    assert_eq!(bench.is_given(principal(9)).await, [true; CLOUDS]);
    assert_eq!(bench.reads(), CLOUDS as u32, "nobody looks twice");
}

#[tokio::test]
async fn an_entry_that_is_asked_for_a_thousand_times_is_looked_at_once() {
    let bench = Bench::new(1.0, Mode::Well);
    bench.store(0, bench.entry(0, 0), principal(1)).await;
    let objects = vec![ObjectRequest { key: bench.keys[0], sha256: None }; 1000];
    let mut given = vec![Given::Anything; 1000];
    bench.entries.admit(principal(9), &objects, &mut given).await.unwrap();
    assert!(given.iter().all(|given| matches!(given, Given::Content(_))));
    assert_eq!(bench.reads(), 1);
}

#[tokio::test]
async fn a_bucket_that_cannot_be_checked_holds_nobody_up_twice() {
    for (mode, expected) in [(Mode::Hung, "waited 10ms"), (Mode::Forbidden, "403 Forbidden")] {
        let bench = Bench::patient(0.0, mode, (SHORT, 100 * SHORT));
        let error = bench.get(principal(8)).await.unwrap_err();
        assert!(error.contains(expected), "{error}");
        let reads = bench.reads();
        assert_eq!(bench.get(principal(9)).await.unwrap_err(), error);
        assert_eq!(bench.reads(), reads);
    }
}
