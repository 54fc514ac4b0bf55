//! The store as a whole: tiers, faults, writers at the same time.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Barrier};
use std::time::{Duration, SystemTime};

use proto::Digest;

use crate::log_capture::warnings;
use crate::*;

const KIND: &str = "test entry";
const VERSION: u32 = 7;

fn storage(cache: &Path) -> Storage {
    Storage { cache: Some(cache.to_owned()), cache_size: ByteSize::mib(1), ..nothing() }
}

fn nothing() -> Storage {
    Storage::in_memory(ByteSize::mib(1))
}

fn open(cache: &Path) -> Store {
    Store::open(&storage(cache), "here", VERSION)
}

fn key() -> Digest {
    KeyBuilder::new(KIND, VERSION).number(1).finish()
}

fn path(root: &Path) -> PathBuf {
    root.join(layout::derived(KIND, key()).unwrap())
}

#[test]
fn what_is_kept_is_found_by_another_store() {
    let root = tempfile::tempdir().unwrap();
    let cache = root.path().join("not/there/yet");
    assert_eq!(open(&cache).get(KIND, key()), None);
    assert!(!cache.exists());
    open(&cache).put(KIND, key(), b"payload");
    assert_eq!(open(&cache).get(KIND, key()).as_deref(), Some(&b"payload"[..]));
    assert_eq!(open(&cache).get("other kind", key()), None);
    assert_eq!(open(&cache).get(KIND, Digest::of(b"other")), None);
    Store::open(&nothing(), "here", VERSION).put(KIND, key(), b"payload");
}

#[test]
fn a_damaged_entry_is_dropped_with_one_warning() {
    let root = tempfile::tempdir().unwrap();
    let store = open(root.path());
    store.put(KIND, key(), b"payload");
    let path = path(root.path());
    let sound = fs::read(&path).unwrap();
    let mut flipped = sound.clone();
    *flipped.last_mut().unwrap() ^= 1;
    for damage in [&sound[..sound.len() - 1], &flipped, b"", &[&sound[..], b"!"].concat()] {
        fs::write(&path, damage).unwrap();
        let store = open(root.path());
        let (found, warnings) = warnings(|| [store.get(KIND, key()), store.get(KIND, key())]);
        assert_eq!(found, [None, None]);
        assert!(!path.exists());
        assert_eq!(warnings.len(), 1, "{warnings:?}");
        assert!(
            warnings[0].starts_with("cache /") && warnings[0].contains(&key().to_string()),
            "{warnings:?}"
        );
        store.put(KIND, key(), b"payload");
        assert_eq!(fs::read(&path).unwrap(), sound);
    }
}

#[test]
fn entries_of_another_evaluation_version_are_left_to_releases_of_that_version() {
    let (disk, shared) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let both = Storage { shared: Some(shared.path().to_owned()), ..storage(disk.path()) };
    let [earlier, later] = [7, 8].map(|version| Store::open(&both, "here", version));
    earlier.put(KIND, key(), b"payload");
    let ((), told) = warnings(|| {
        assert_eq!(later.get(KIND, key()), None);
        assert_eq!(later.get_local(KIND, key()), None);
        assert_eq!(later.entry(KIND, key()), None);
    });
    assert!(told.is_empty(), "{told:?}");
    assert_eq!(later.reads().0.unwrap().damaged, 0);
    for root in [disk.path(), shared.path()] {
        assert!(path(root).exists());
    }
    assert_eq!(earlier.get(KIND, key()).as_deref(), Some(&b"payload"[..]));
}

#[test]
fn of_many_damaged_entries_a_few_are_told() {
    let root = tempfile::tempdir().unwrap();
    let store = open(root.path());
    let keys: Vec<Digest> =
        (0..10).map(|number| KeyBuilder::new(KIND, VERSION).number(number).finish()).collect();
    for &key in &keys {
        store.put(KIND, key, b"payload");
        fs::write(root.path().join(layout::derived(KIND, key).unwrap()), b"damaged").unwrap();
    }
    let (found, warnings) = warnings(|| keys.iter().filter(|&&key| store.get(KIND, key).is_some()).count());
    assert_eq!((found, warnings.len()), (0, 4), "{warnings:?}");
    assert!(warnings[3].ends_with("making it again; 8 entries so far"), "{warnings:?}");
    assert!(keys.iter().all(|&key| !root.path().join(layout::derived(KIND, key).unwrap()).exists()));
}

#[test]
fn an_oversized_file_is_dropped_without_being_read_whole() {
    let root = tempfile::tempdir().unwrap();
    let store = open(root.path());
    store.put(KIND, key(), b"payload");
    let file = fs::File::options().write(true).open(path(root.path())).unwrap();
    file.set_len(1 << 40).unwrap(); // sparse: takes no room
    let (found, warnings) = warnings(|| store.get(KIND, key()));
    assert_eq!(found, None);
    assert!(warnings[0].contains("is too long"), "{warnings:?}");
    assert!(!path(root.path()).exists());
}

#[test]
fn links_and_folders_in_place_of_entries_are_not_followed() {
    let (root, elsewhere) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    open(elsewhere.path()).put(KIND, key(), b"payload");
    let (store, path) = (open(root.path()), path(root.path()));
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::os::unix::fs::symlink(self::path(elsewhere.path()), &path).unwrap();
    assert_eq!(store.get(KIND, key()), None);
    store.put(KIND, key(), b"payload");
    assert!(fs::symlink_metadata(&path).unwrap().is_file());
    fs::remove_file(&path).unwrap();
    fs::create_dir(&path).unwrap();
    assert_eq!(store.get(KIND, key()), None);
    let ((), warnings) = warnings(|| (0..3).for_each(|_| store.put(KIND, key(), b"payload")));
    assert_eq!(warnings.len(), 1, "{warnings:?}");
}

#[test]
fn a_disk_that_cannot_be_written_costs_one_warning() {
    let root = tempfile::tempdir().unwrap();
    // Where a folder should be, there is a file: every write fails, for root as well.
    let cache = root.path().join("cache");
    fs::write(&cache, b"").unwrap();
    let store = open(&cache);
    let ((), warnings) = warnings(|| {
        for number in 0..10 {
            let key = KeyBuilder::new(KIND, VERSION).number(number).finish();
            store.put(KIND, key, b"payload");
            assert_eq!(store.get(KIND, key), None);
            store.put_blob(key, b"blob");
            assert_eq!(store.blob(key), None);
        }
    });
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    let end = "; going on in memory\nfree some space or choose another --cache";
    let start = format!("cache {}: cannot keep entries, got ", cache.display());
    assert!(warnings[0].starts_with(&start) && warnings[0].ends_with(end), "{warnings:?}");
}

#[test]
fn an_entry_deleted_while_it_is_read_is_whole_or_absent() {
    let root = tempfile::tempdir().unwrap();
    let store = open(root.path());
    let payload = vec![7; 100_000];
    let start = Barrier::new(2);
    let ((), warnings) = warnings(|| {
        std::thread::scope(|scope| {
            scope.spawn(|| {
                start.wait();
                for _ in 0..200 {
                    store.put(KIND, key(), &payload);
                    let _ = fs::remove_file(path(root.path()));
                }
            });
            start.wait();
            for _ in 0..200 {
                assert!(store.get(KIND, key()).is_none_or(|found| found == payload));
            }
        });
    });
    assert_eq!(warnings, [""; 0]);
}

#[test]
fn writers_of_the_same_entry_do_not_disturb_each_other() {
    let root = tempfile::tempdir().unwrap();
    let payload: Arc<[u8]> = vec![7; 50_000].into();
    let start = Arc::new(Barrier::new(4));
    let threads: Vec<_> = (0..4)
        .map(|_| {
            let (store, payload, start) = (open(root.path()), Arc::clone(&payload), Arc::clone(&start));
            std::thread::spawn(move || {
                start.wait();
                for _ in 0..50 {
                    store.put(KIND, key(), &payload);
                    // Once it is there, it is never half there.
                    assert_eq!(store.get(KIND, key()).as_deref(), Some(&*payload));
                }
            })
        })
        .collect();
    threads.into_iter().for_each(|thread| thread.join().unwrap());
    let folder = path(root.path());
    let names: Vec<_> = fs::read_dir(folder.parent().unwrap()).unwrap().map(|e| e.unwrap().path()).collect();
    assert_eq!(names, [folder], "temporary files are left");
}

#[test]
fn the_cache_stays_within_its_limit_and_keeps_what_is_used() {
    let root = tempfile::tempdir().unwrap();
    let limit = ByteSize(100_000);
    let store = Store::open(&Storage { cache_size: limit, ..storage(root.path()) }, "here", VERSION);
    let old = std::time::SystemTime::UNIX_EPOCH;
    let keys: Vec<Digest> =
        (0..30).map(|number| KeyBuilder::new(KIND, VERSION).number(number).finish()).collect();
    for (&key, payload) in keys.iter().zip((0u8..).map(|byte| vec![byte; 9_000])) {
        store.put(KIND, key, &payload);
        let path = root.path().join(layout::derived(KIND, key).unwrap());
        fs::File::options().write(true).open(path).unwrap().set_modified(old).unwrap();
        assert!(store.get(KIND, keys[0]).is_some(), "what is used all the time was evicted");
        let kept = keys.iter().filter(|&&key| root.path().join(layout::derived(KIND, key).unwrap()).exists());
        assert!(kept.count() * 9_000 <= 100_000);
    }
    store.put(KIND, Digest::of(b"large"), &[0; 100_001]);
    assert!(store.get(KIND, keys[0]).is_some(), "an entry that never fits evicted others");
    store.put_blob(Digest::of(&[1; 99_000]), &[1; 99_000]);
    assert_eq!(store.get(KIND, keys[0]), None, "blobs count as well");
}

#[test]
fn the_shared_folder_is_read_and_written_through() {
    let (one, two, shared) =
        (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let sharing = |cache: &Path| {
        Store::open(&Storage { shared: Some(shared.path().to_owned()), ..storage(cache) }, "here", VERSION)
    };
    sharing(one.path()).put(KIND, key(), b"payload");
    assert_eq!(sharing(two.path()).get(KIND, key()).as_deref(), Some(&b"payload"[..]));
    assert_eq!(open(two.path()).get(KIND, key()).as_deref(), Some(&b"payload"[..]));

    // Damage in the shared folder reaches nobody.
    fs::remove_dir_all(two.path().join(layout::DERIVED)).unwrap();
    fs::write(path(shared.path()), b"damaged").unwrap();
    assert_eq!(sharing(two.path()).get(KIND, key()), None);
    assert!(!path(shared.path()).exists());
}

#[test]
fn a_shared_folder_that_is_read_only_is_read_and_never_changed() {
    let (cache, shared) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    open(shared.path()).put(KIND, key(), b"payload");
    let long_ago = SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000_000);
    fs::File::open(path(shared.path())).unwrap().set_modified(long_ago).unwrap();
    let read_only =
        Storage { shared: Some(shared.path().to_owned()), shared_read_only: true, ..storage(cache.path()) };
    let store = Store::open(&read_only, "here", VERSION);
    assert_eq!(store.get(KIND, key()).as_deref(), Some(&b"payload"[..]));
    let modified = fs::metadata(path(shared.path())).unwrap().modified().unwrap();
    assert_eq!(modified, long_ago, "not even the time of use is written");
    store.put(KIND, Digest::of(b"another"), b"payload");
    assert_eq!(open(shared.path()).get(KIND, Digest::of(b"another")), None);

    // Something damaged stays for its owner, and reaches nobody.
    fs::remove_dir_all(cache.path().join(layout::DERIVED)).unwrap();
    fs::write(path(shared.path()), b"damaged").unwrap();
    let (found, warned) = warnings(|| store.get(KIND, key()));
    assert_eq!((found, warned.len()), (None, 1), "{warned:?}");
    assert!(path(shared.path()).exists());
    store.distrust(KIND, key(), "wrong".to_owned(), &[]);
    assert!(path(shared.path()).exists());
}

#[test]
fn a_local_entry_neither_goes_to_the_shared_folder_nor_comes_from_there() {
    let (cache, shared) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let storage = Storage { shared: Some(shared.path().to_owned()), ..storage(cache.path()) };
    let store = Store::open(&storage, "here", VERSION);
    store.put_local(KIND, key(), b"local");
    assert!(!path(shared.path()).exists());
    assert_eq!(store.get_local(KIND, key()).as_deref(), Some(&b"local"[..]));
    store.remove_local(KIND, key());
    assert_eq!(store.get_local(KIND, key()), None);
    let ((), warned) = warnings(|| store.remove_local(KIND, key()));
    assert!(warned.is_empty(), "it is gone already: {warned:?}");
    store.put_local(KIND, key(), b"local");
    fs::remove_file(path(cache.path())).unwrap();
    open(shared.path()).put(KIND, key(), b"of others");
    assert_eq!(store.get_local(KIND, key()), None);
    assert_eq!(store.get(KIND, key()).as_deref(), Some(&b"of others"[..]));
}

#[test]
fn the_entries_of_a_kind_are_listed() {
    let (cache, shared) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let storage = Storage { shared: Some(shared.path().to_owned()), ..storage(cache.path()) };
    let store = Store::open(&storage, "here", VERSION);
    assert_eq!(store.local_keys(KIND), []);
    let keys: BTreeSet<Digest> = [b"one", b"two", b"six"].map(|name| Digest::of(name)).into();
    keys.iter().for_each(|&key| store.put_local(KIND, key, b"payload"));
    store.put_local("other kind", Digest::of(b"other"), b"payload");
    open(shared.path()).put(KIND, Digest::of(b"elsewhere"), b"payload");
    fs::write(path(cache.path()).with_file_name("foreign"), b"").unwrap_or_default();
    assert_eq!(store.local_keys(KIND).into_iter().collect::<BTreeSet<_>>(), keys);
    assert_eq!(store.local_keys("../blobs"), []);
    assert_eq!(Store::open(&nothing(), "here", VERSION).local_keys(KIND), []);
}

#[test]
fn a_shared_folder_out_of_reach_costs_one_warning_and_is_not_made() {
    let root = tempfile::tempdir().unwrap();
    let missing = root.path().join("not-mounted");
    let storage = Storage { shared: Some(missing.clone()), ..storage(&root.path().join("cache")) };
    let store = Store::open(&storage, "here", VERSION);
    let (found, warnings) = warnings(|| {
        for _ in 0..3 {
            store.put(KIND, key(), b"payload");
        }
        store.get(KIND, key())
    });
    assert_eq!(found.as_deref(), Some(&b"payload"[..]));
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(warnings[0].contains("not-mounted: cannot be used, got "), "{warnings:?}");
    assert!(!missing.exists());
}

#[test]
fn an_entry_from_another_machine_is_checked_before_it_is_kept() {
    let (one, two) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    open(one.path()).put(KIND, key(), b"payload");
    let bytes = open(one.path()).entry(KIND, key()).unwrap();
    let store = open(two.path());
    for position in 0..bytes.len() {
        let mut flipped = bytes.clone();
        flipped[position] ^= 0x10;
        assert!(store.adopt(KIND, key(), &flipped).is_err(), "{position}");
    }
    assert!(!path(two.path()).exists());
    assert_eq!(store.adopt(KIND, key(), &bytes).unwrap(), b"payload");
    assert_eq!(store.entry(KIND, key()), Some(bytes));
}

#[test]
fn a_kept_blob_is_read_and_a_damaged_one_is_dropped() {
    let root = tempfile::tempdir().unwrap();
    let store = open(root.path());
    let digest = Digest::of(b"cloud");
    store.put_blob(digest, b"cloud");
    assert_eq!(store.blob(digest).as_deref(), Some(&b"cloud"[..]));
    let path = root.path().join(layout::blob(digest));
    for damage in [&b"clo"[..], b"clouD", b"", b"clouds"] {
        fs::write(&path, damage).unwrap();
        assert_eq!(store.blob(digest), None);
        assert!(!path.exists());
    }
}

/// Entries that earlier releases have kept are found and read.
#[test]
fn the_committed_entry_is_read() {
    let sample = include_bytes!("../testdata/prepared-cloud.entry");
    let key = Digest(sample[16..48].try_into().unwrap());
    assert_eq!(key.to_string(), "37f4d0de10f8ce1214f0207185e78e9d3bda4518ffc54da85fbbb4f979228d9e");
    let root = tempfile::tempdir().unwrap();
    let path = root.path().join(format!("derived/prepared-cloud-2/{}/{key}", &key.to_string()[..2]));
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(&path, sample).unwrap();
    let payload = Store::open(&storage(root.path()), "here", 2).get("prepared cloud 2", key).unwrap();
    assert_eq!(
        Digest::of(&payload).to_string(),
        "fa78bed78acffd5064605f5ac03f7f5f5832f3d296afbfa9506269450d91bd49"
    );
}
