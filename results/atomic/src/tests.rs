//! Files and folders in their places: whole, replaced whole, with the right permissions, and nothing left beside them.

use std::fs;
use std::io::{self, Write as _};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

use super::*;
use crate::temporary::tests::name_of;

/// Names in a folder, sorted.
fn names(folder: &Path) -> Vec<String> {
    let names = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name());
    let mut names: Vec<String> = names.map(|name| name.into_string().unwrap()).collect();
    names.sort();
    names
}

fn mode(path: &Path) -> u32 {
    fs::metadata(path).unwrap().permissions().mode() & 0o777
}

#[test]
fn a_file_is_replaced_whole_and_leaves_nothing_beside_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    for text in ["first", "second, longer"] {
        write(&path, text.as_bytes()).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), text);
    }
    write_unsynced(&path, &[b"in ", b"pieces"]).unwrap();
    assert_eq!(fs::read_to_string(&path).unwrap(), "in pieces");
    assert_eq!(names(folder.path()), ["file"]);
    remove(&path).unwrap();
    assert_eq!(names(folder.path()), [""; 0]);
    assert_eq!(remove(&path).unwrap_err().kind(), io::ErrorKind::NotFound);
}

#[test]
fn a_file_that_cannot_be_written_leaves_the_former_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    write(&path, b"former").unwrap();
    let half = write_with(&path, |file| {
        file.write_all(b"half")?;
        assert!(names(folder.path()).iter().any(|name| is_temporary(name)));
        Err(io::Error::other("disk is full"))
    });
    assert_eq!(half.unwrap_err().to_string(), "disk is full");
    assert_eq!(fs::read_to_string(&path).unwrap(), "former");
    fs::create_dir(folder.path().join("folder")).unwrap();
    write(&folder.path().join("folder"), b"file").unwrap_err();
    assert_eq!(names(folder.path()), ["file", "folder"]);
}

#[test]
fn files_and_folders_are_as_open_as_any_new_one_and_secrets_are_their_owners() {
    let folder = tempfile::tempdir().unwrap();
    let (plain, plain_folder) = (folder.path().join("plain"), folder.path().join("plain-folder"));
    fs::write(&plain, b"").unwrap();
    fs::create_dir(&plain_folder).unwrap();
    for (name, writer) in [
        ("a", write as fn(&Path, &[u8]) -> io::Result<()>),
        ("b", |path, bytes| write_unsynced(path, &[bytes])),
    ] {
        let path = folder.path().join(name);
        writer(&path, b"").unwrap();
        assert_eq!(mode(&path), mode(&plain), "{name}");
    }
    for (access, expected) in
        [(Access::Umask, [mode(&plain_folder), mode(&plain)]), (Access::Owner, [0o700, 0o600])]
    {
        let place = folder.path().join(format!("{access:?}"));
        let new = NewFolder::beside(&place, access).unwrap();
        assert_eq!(mode(new.path()), expected[0]);
        new.write("file", b"").unwrap();
        new.commit(&place).unwrap();
        assert_eq!([mode(&place), mode(&place.join("file"))], expected);
    }
}

#[test]
fn what_a_killed_process_left_half_made_is_removed_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    // No process has this number: it is above the largest that Linux gives.
    let (mine, gone) = (name_of(std::process::id()), name_of(4_194_305));
    for name in [&gone, &mine, ".tmp-", ".tmp-host-word-xxxxxxxxxxxx", "data"] {
        fs::create_dir(folder.path().join(name)).unwrap();
    }
    fs::write(folder.path().join(name_of(4_194_306)), b"half").unwrap();
    drop(NewFolder::beside(&folder.path().join("place"), Access::Umask).unwrap());
    let mut expected = [&*mine, ".tmp-", ".tmp-host-word-xxxxxxxxxxxx", "data"];
    expected.sort_unstable();
    assert_eq!(names(folder.path()), expected);
}

#[test]
fn a_folder_takes_the_place_of_a_former_one_whole_and_leaves_nothing_beside_it() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("below/place");
    for text in ["first", "second"] {
        let new = NewFolder::beside(&place, Access::Umask).unwrap();
        new.write("both", text.as_bytes()).unwrap();
        new.write(&format!("within/{text}"), b"").unwrap();
        new.replace(&place).unwrap();
        assert_eq!(fs::read_to_string(place.join("both")).unwrap(), text);
        assert_eq!(names(&place), ["both", "within"]);
        assert_eq!(names(&place.join("within")), [text]);
        assert_eq!(names(&folder.path().join("below")), ["place"]);
    }
    drop(NewFolder::beside(&place, Access::Umask).unwrap());
    assert_eq!(names(&folder.path().join("below")), ["place"]);
}

/// On Linux the two change places in one step, on every file system that these tests have met.
#[cfg(target_os = "linux")]
#[test]
fn a_folder_that_is_replaced_is_there_at_any_moment() {
    use std::sync::atomic::{AtomicBool, Ordering};

    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("place");
    let new = || {
        let new = NewFolder::beside(&place, Access::Umask).unwrap();
        new.write("file", b"").unwrap();
        new
    };
    new().replace(&place).unwrap();
    let is_done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let looks = scope.spawn(|| {
            let mut looks = 0;
            while !is_done.load(Ordering::Relaxed) {
                assert!(place.is_dir(), "gone at look {looks}");
                looks += 1;
            }
            looks
        });
        (0..200).for_each(|_| new().replace(&place).unwrap());
        is_done.store(true, Ordering::Relaxed);
        assert!(looks.join().unwrap() > 200, "too few looks");
    });
    assert_eq!(names(&place), ["file"]);
}

#[test]
fn a_place_that_cannot_be_taken_keeps_what_it_has() {
    let folder = tempfile::tempdir().unwrap();
    let (file, full) = (folder.path().join("file"), folder.path().join("full"));
    fs::write(&file, "a file").unwrap();
    fs::create_dir(&full).unwrap();
    fs::write(full.join("kept"), "").unwrap();
    let new = |place| {
        let new = NewFolder::beside(place, Access::Umask).unwrap();
        new.write("a", b"").unwrap();
        new.write("a", b"").unwrap_err();
        new
    };
    new(&file).replace(&file).unwrap_err();
    new(&file).commit(&file).unwrap_err();
    new(&full).commit(&full).unwrap_err();
    assert_eq!(fs::read_to_string(&file).unwrap(), "a file");
    assert_eq!(names(&full), ["kept"]);
    assert_eq!(names(folder.path()), ["file", "full"]);
    fs::remove_file(full.join("kept")).unwrap();
    new(&full).commit(&full).unwrap();
    assert_eq!(names(&full), ["a"], "an empty folder makes room");
}

#[test]
fn a_lock_is_held_by_one_and_waits_for_those_that_only_look() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lock");
    fs::write(&path, "").unwrap();
    let open = || fs::OpenOptions::new().write(true).read(true).open(&path).unwrap();
    let (own, other) = (open(), open());
    assert_eq!(is_locked(&other).unwrap(), Some(false));
    assert_eq!(is_locked(&open()).unwrap(), Some(false), "a look ends with itself");
    // Somebody looks until we have tried.
    let look = open();
    look.try_lock_shared().unwrap();
    std::thread::scope(|scope| {
        let waiting = scope.spawn(|| try_lock(&own));
        look.unlock().unwrap();
        waiting.join().unwrap().unwrap();
    });
    assert_eq!(is_locked(&other).unwrap(), Some(true));
    assert!(matches!(try_lock(&other), Err(fs::TryLockError::WouldBlock)));
    drop(own);
    try_lock(&other).unwrap();
}
