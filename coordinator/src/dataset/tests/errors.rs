//! Each way in which a data set can be wrong, and the message it gets.

use std::fs;

use descriptor::pcd::{self, DataEncoding};
use descriptor::{Cloud, Preprocess};
use expect_test::{Expect, expect};

use super::super::{Dataset, DatasetError, DatasetSettings, Layout, Wanted};
use super::{Fixture, patch};

/// Loads the usual fixture after a change to it.
fn check(change: impl FnOnce(&mut Fixture), expected: Expect) {
    let mut fixture = Fixture::new();
    change(&mut fixture);
    expected.assert_eq(&fixture.text(&fixture.load().unwrap_err()));
}

fn check_manifest(rows: &str, expected: Expect) {
    let mut fixture = Fixture::empty();
    for name in ["a", "b", "c", "d"] {
        fixture.cloud(&format!("{name}.pcd"));
    }
    fixture.write("clouds.csv", rows);
    let error =
        Dataset::load(&fixture.manifest_settings(), &Preprocess::default(), Wanted::All, None).unwrap_err();
    expected.assert_eq(&fixture.text(&error));
}

#[test]
fn roots_that_are_no_folders() {
    let fixture = Fixture::new();
    for (root, expected) in [
        (
            "nowhere",
            expect![[r#"
            dataset.root: readable folder expected, got nowhere (No such file or directory (os error 2))
            correct the path (relative paths start at the experiment's folder) or make the data set there"#]],
        ),
        (
            "test.txt",
            expect![[r#"
            dataset.root: readable folder expected, got test.txt (not a folder)
            correct the path (relative paths start at the experiment's folder) or make the data set there"#]],
        ),
    ] {
        let settings = DatasetSettings { root: fixture.root().join(root), ..fixture.settings() };
        expected.assert_eq(
            &fixture.text(&Dataset::load(&settings, &Preprocess::default(), Wanted::All, None).unwrap_err()),
        );
    }
}

#[test]
fn lists_that_are_no_text() {
    check(
        |fixture| fs::remove_file(fixture.root().join("train2.txt")).unwrap(),
        expect![[r#"
            dataset.splits.train2: readable UTF-8 text file expected, got train2.txt (No such file or directory (os error 2))
            write the list, or set dataset.splits: to other lists (relative paths start at dataset.root), or to a draw, for example `splits = { seeded = {} }`"#]],
    );
    check(
        |fixture| fixture.write("train2.txt", b"# one\nball/\xff.pcd\n"),
        expect![[r#"
            dataset.splits.train2: readable UTF-8 text file expected, got train2.txt (other bytes in line 2)
            write the list, or set dataset.splits: to other lists (relative paths start at dataset.root), or to a draw, for example `splits = { seeded = {} }`"#]],
    );
    check(
        |fixture| {
            fs::remove_file(fixture.root().join("train2.txt")).unwrap();
            fs::create_dir(fixture.root().join("train2.txt")).unwrap();
        },
        expect![[r#"
            dataset.splits.train2: readable UTF-8 text file expected, got train2.txt (something that is no file)
            write the list, or set dataset.splits: to other lists (relative paths start at dataset.root), or to a draw, for example `splits = { seeded = {} }`"#]],
    );
}

#[test]
fn listed_files_that_are_not_there() {
    check(
        |fixture| fixture.append("test.txt", "\ncup/cup_1/cup_1_1_9.pcd"),
        expect![[r#"
            test.txt, line 6: cloud file expected, got cup/cup_1/cup_1_1_9.pcd (No such file or directory (os error 2))
            correct the line, or put the cloud below dataset.root"#]],
    );
    check(
        |fixture| fixture.append("test.txt", "cup/cup_1"),
        expect![[r#"
            test.txt, line 5: cloud file expected, got cup/cup_1 (not a regular file)
            correct the line, or put the cloud below dataset.root"#]],
    );
}

#[test]
fn names_that_would_disturb_a_terminal() {
    check(
        |fixture| fixture.append("test.txt", "cup/\u{1b}[2J.pcd"),
        expect![[r#"
            test.txt, line 5: cloud file expected, got cup/\u{1b}[2J.pcd (control character)
            correct the line, or put the cloud below dataset.root"#]],
    );
    check_manifest(
        "path,category,instance,split\na.pcd,fr\u{7}uit,pear,train1\n",
        expect![[r#"
            clouds.csv, line 2: category without control characters expected, got fr\u{7}uit
            write CSV or Parquet with the columns path, category and instance, and sequence, split and set if wanted"#]],
    );
    check_manifest(
        "path,category,instance,sequence,split\na.pcd,fruit,pear,1\u{1b}[2J,train1\n",
        expect![[r#"
            clouds.csv, line 2: sequence without control characters expected, got 1\u{1b}[2J
            write CSV or Parquet with the columns path, category and instance, and sequence, split and set if wanted"#]],
    );
}

#[test]
fn paths_that_leave_the_root() {
    check(
        |fixture| fixture.append("validation.txt", "../outside/a/b.pcd"),
        expect![[r#"
            validation.txt, line 5: path below the data root expected, got ../outside/a/b.pcd (it goes up with `..`)
            name clouds relative to dataset.root, and copy what lies outside into it"#]],
    );
    check(
        |fixture| fixture.append("validation.txt", "cup/../ball/ball_1/ball_1_1_1.pcd"),
        expect![[r#"
            validation.txt, line 5: path below the data root expected, got cup/../ball/ball_1/ball_1_1_1.pcd (it goes up with `..`)
            name clouds relative to dataset.root, and copy what lies outside into it"#]],
    );
    check(
        |fixture| fixture.append("validation.txt", "/cup/cup_1/cup_1_1_1.pcd"),
        expect![[r#"
            validation.txt, line 5: path below the data root expected, got /cup/cup_1/cup_1_1_1.pcd (it is absolute)
            name clouds relative to dataset.root, and copy what lies outside into it"#]],
    );
}

#[cfg(unix)]
#[test]
fn symbolic_links_may_not_lead_out_and_name_the_file_they_lead_to() {
    use std::os::unix::fs::symlink;

    let mut outside = Fixture::empty();
    outside.cloud("cup_3/cup_3_1_1.pcd");
    check(
        |fixture| {
            symlink(outside.root().join("cup_3"), fixture.root().join("cup/cup_3")).unwrap();
            fixture.append("train1.txt", "cup/cup_3/cup_3_1_1.pcd");
        },
        expect![[r#"
            train1.txt, line 5: path below the data root expected, got cup/cup_3/cup_3_1_1.pcd (a symbolic link leads out)
            name clouds relative to dataset.root, and copy what lies outside into it"#]],
    );
    check(
        |fixture| {
            let folder = fixture.root().join("cup/cup_1");
            symlink(folder.join("cup_1_1_1.pcd"), folder.join("cup_1_7_7.pcd")).unwrap();
            fixture.append("test.txt", "cup/cup_1/cup_1_7_7.pcd");
        },
        expect![[r#"
            test.txt, line 5: cloud of one split expected, got cup/cup_1/cup_1_7_7.pcd in test and in train1 (train1.txt, line 3)
            remove it from one of them: a query that is in its own database is always recognised. Where validation clouds are to be training clouds, write `validation = []`"#]],
    );
}

#[test]
fn a_cloud_may_be_listed_once() {
    check(
        |fixture| fixture.append("train1.txt", "./ball/ball_2//ball_2_1_1.pcd"),
        expect![[r#"
            train1.txt, line 5: each cloud once expected, got ball/ball_2/ball_2_1_1.pcd again after train1.txt, line 2
            remove one of the two"#]],
    );
    let splits = ["train1", "train2", "validation", "test"];
    for (first, second) in (0..4).flat_map(|second| (0..second).map(move |first| (first, second))) {
        let fixture = Fixture::new();
        let path = format!("cup/cup_2/cup_2_1_{}.pcd", first + 1);
        fixture.append(&format!("{}.txt", splits[second]), &path);
        let error = fixture.load().unwrap_err();
        let DatasetError::Overlap { path: found, first_split, second_split, .. } = &error else {
            panic!("{error}");
        };
        assert_eq!((found, *first_split, *second_split), (&path, splits[first], splits[second]));
    }
}

#[test]
fn labels_that_contradict_or_miss() {
    check(
        |fixture| {
            fixture.cloud("bowl/cup_1/cup_1_1_9.pcd");
            fixture.append("train2.txt", "bowl/cup_1/cup_1_1_9.pcd");
        },
        expect![[r#"
            train2.txt, line 5: instance of one category expected, got cup_1 in bowl and in cup (train1.txt, line 3)
            rename one of them or correct its category"#]],
    );
    for path in
        ["cup_5_1_1.pcd", "cup_5/cup_5_1_1.pcd", "a/cup/cup_5/cup_5_1_1.pcd", "cup/cup_5/cup_6_1_1.pcd"]
    {
        let mut fixture = Fixture::new();
        fixture.cloud(path);
        fixture.append("train1.txt", path);
        let error = fixture.load().unwrap_err();
        assert!(matches!(&error, DatasetError::NoLabel { path: found, .. } if found == path), "{error}");
    }
    check(
        |fixture| {
            fixture.cloud("cup_5/cup_5_1_1.pcd");
            fixture.append("train1.txt", "cup_5/cup_5_1_1.pcd");
        },
        expect![[r#"
            train1.txt, line 5: <category>/<instance>/<instance>_<video>_<frame>.pcd, .ply or _crop.png expected, got cup_5/cup_5_1_1.pcd
            move the cloud, or set dataset.layout to what the folders are (a manifest can describe any)"#]],
    );
}

#[test]
fn splits_without_a_cloud() {
    check(
        |fixture| fixture.write("validation.txt", "# nothing yet\n"),
        expect![[r#"
            split validation: at least one usable cloud expected, got none of 0 listed
            assign clouds to it"#]],
    );
    check(
        |fixture| {
            let empty = pcd::write(&Cloud { colours: Some(vec![]), ..Cloud::default() }, DataEncoding::Ascii);
            for path in fs::read_to_string(fixture.root().join("train2.txt")).unwrap().lines() {
                fixture.write(path, &empty);
            }
        },
        expect![[r#"
            split train2: at least one usable cloud expected, got none of 4 listed
            list other clouds, or mend these:
              ball/ball_1/ball_1_1_2.pcd: fewer than 10 usable points, got 0
              ball/ball_2/ball_2_1_2.pcd: fewer than 10 usable points, got 0
              cup/cup_1/cup_1_1_2.pcd: fewer than 10 usable points, got 0
              cup/cup_2/cup_2_1_2.pcd: fewer than 10 usable points, got 0"#]],
    );
}

#[test]
fn clouds_that_cannot_be_read_or_have_no_colour() {
    check(
        |fixture| {
            let path = "cup/cup_1/cup_1_1_2.pcd";
            let bytes = fs::read(fixture.root().join(path)).unwrap();
            fixture.write(path, &bytes[..bytes.len() - 1]);
        },
        expect![[r#"
            dataset: readable clouds expected, got 1 unreadable
            cup/cup_1/cup_1_1_2.pcd: pcd data: 400 points of at least 16 bytes expected, got 6399 bytes
            repair them, remove them from their lists, or set dataset.skip_unreadable = true to leave them out"#]],
    );
    let all = |fixture: &mut Fixture, bytes: &[u8]| {
        for split in ["train1", "train2", "validation", "test"] {
            for path in fs::read_to_string(fixture.root().join(format!("{split}.txt"))).unwrap().lines() {
                fixture.write(path, bytes);
            }
        }
    };
    check(
        |fixture| all(fixture, b""),
        expect![[r#"
            dataset: readable clouds expected, got 16 unreadable
            ball/ball_1/ball_1_1_1.pcd: pcd header: DATA: line expected within the first 65536 bytes, got none
            ball/ball_2/ball_2_1_1.pcd: pcd header: DATA: line expected within the first 65536 bytes, got none
            cup/cup_1/cup_1_1_1.pcd: pcd header: DATA: line expected within the first 65536 bytes, got none
            cup/cup_2/cup_2_1_1.pcd: pcd header: DATA: line expected within the first 65536 bytes, got none
            ball/ball_1/ball_1_1_2.pcd: pcd header: DATA: line expected within the first 65536 bytes, got none
            ball/ball_2/ball_2_1_2.pcd: pcd header: DATA: line expected within the first 65536 bytes, got none
            cup/cup_1/cup_1_1_2.pcd: pcd header: DATA: line expected within the first 65536 bytes, got none
            cup/cup_2/cup_2_1_2.pcd: pcd header: DATA: line expected within the first 65536 bytes, got none
            ball/ball_1/ball_1_1_3.pcd: pcd header: DATA: line expected within the first 65536 bytes, got none
            ball/ball_2/ball_2_1_3.pcd: pcd header: DATA: line expected within the first 65536 bytes, got none
            repair them, remove them from their lists, or set dataset.skip_unreadable = true to leave them out"#]],
    );
    check(
        |fixture| {
            let colourless = Cloud { colours: None, ..patch(0.002, 0) };
            fixture.write("cup/cup_2/cup_2_1_4.pcd", pcd::write(&colourless, DataEncoding::BinaryCompressed));
        },
        expect![[r#"
            dataset: clouds with colours expected, got 1 without
            cup/cup_2/cup_2_1_4.pcd
            set descriptor.colour = false for descriptors of shape alone, or add the colours"#]],
    );
    let mut fixture = Fixture::new();
    all(&mut fixture, &pcd::write(&Cloud { colours: None, ..patch(0.002, 0) }, DataEncoding::Binary));
    let colourless = Preprocess { colour: false, ..Preprocess::default() };
    assert_eq!(
        Dataset::load(&fixture.settings(), &colourless, Wanted::All, None).unwrap().clouds.entries.len(),
        16
    );
}

#[test]
fn manifests_that_cannot_be_used() {
    let columns = "path,category,instance,split\n";
    check_manifest(
        "path,instance\na.pcd,x\n",
        expect![[r#"
            clouds.csv, line 1: column category expected, got path,instance
            write CSV or Parquet with the columns path, category and instance, and sequence, split and set if wanted"#]],
    );
    check_manifest(
        "path,category,instance,path\na.pcd,x,y,b.pcd\n",
        expect![[r#"
            clouds.csv, line 1: each column once expected, got path twice
            write CSV or Parquet with the columns path, category and instance, and sequence, split and set if wanted"#]],
    );
    check_manifest(
        &format!("{columns}a.pcd,x,y\n"),
        expect![[r#"
            clouds.csv, line 2: CSV with the same number of fields in each row expected, got CSV error: record 1 (line: 2, byte: 29): found record with 3 fields, but the previous record has 4 fields
            write CSV or Parquet with the columns path, category and instance, and sequence, split and set if wanted"#]],
    );
    check_manifest(
        &format!("{columns}a.pcd,fruit,pear,train1\nb.pcd, ,pear,train2\n"),
        expect![[r#"
            clouds.csv, line 3: category expected, got nothing
            fill the field: every cloud needs a path, a category and an instance, and a set where there is such a column"#]],
    );
    check_manifest(
        &format!("{columns}a.pcd,fruit,pear,training\n"),
        expect![[r#"
            clouds.csv, line 2: split train1, train2, validation, test or nothing expected, got training
            write CSV or Parquet with the columns path, category and instance, and sequence, split and set if wanted"#]],
    );
    check_manifest(
        &format!("{columns}a.pcd,fruit,pear,train1\n./a.pcd,fruit,pear,test\n"),
        expect![[r#"
            clouds.csv, line 3: each cloud once expected, got a.pcd again after clouds.csv, line 2
            remove one of the two"#]],
    );
    check_manifest(
        &format!(
            "{columns}a.pcd,fruit,pear,train1\nb.pcd,fruit,pear,train2\nc.pcd,vase,pear,validation\nd.pcd,vase,urn,test\n"
        ),
        expect![[r#"
            clouds.csv, line 4: instance of one category expected, got pear in vase and in fruit (clouds.csv, line 2)
            rename one of them or correct its category"#]],
    );
    check_manifest(
        &format!("{columns}../a.pcd,fruit,pear,train1\n"),
        expect![[r#"
            clouds.csv, line 2: path below the data root expected, got ../a.pcd (it goes up with `..`)
            name clouds relative to dataset.root, and copy what lies outside into it"#]],
    );
}

#[test]
fn a_listed_cloud_that_the_manifest_does_not_know() {
    let fixture = Fixture::new();
    fixture.write("clouds.csv", "path,category,instance\nball/ball_1/ball_1_1_1.pcd,ball,ball_1\n");
    let layout = Layout::Manifest { file: fixture.root().join("clouds.csv") };
    let settings = DatasetSettings { layout, ..fixture.settings() };
    let error = Dataset::load(&settings, &Preprocess::default(), Wanted::All, None).unwrap_err();
    expect![[r#"
        train1.txt, line 2: cloud of the manifest expected, got ball/ball_2/ball_2_1_1.pcd
        add a row with its category and instance to clouds.csv"#]]
    .assert_eq(&fixture.text(&error));
}
