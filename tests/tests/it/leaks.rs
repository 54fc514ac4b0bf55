//! What `check` says of clouds whose objects stand where the test puts them.

use std::fs;

use descriptor::Cloud;
use descriptor::pcd::{self, DataEncoding};

use crate::experiments::Experiment;
use crate::process::{Finished, run};

const OBJECTS: u8 = 10;
const SPLITS: [&str; 4] = ["train1", "train2", "validation", "test"];

/// A flat square of 10 cm, as any two of these objects are; a corner pixel tells the files apart.
pub fn square(place: [f32; 3], number: u8) -> Cloud {
    let step = |index: u16| f32::from(index) * 0.005;
    let point = |index: u16| [place[0] + step(index % 20), place[1] + step(index / 20), 0.5 + place[2]];
    let mut colours = vec![[128; 3]; 400];
    colours[0] = [number; 3];
    Cloud { points: (0..400).map(point).collect(), colours: Some(colours), viewpoint: [0.0; 3] }
}

/// What `check` prints for a cloud of each object, sequence (1 and 2) and split, where `place` (metres) puts it.
fn check(layout: &str, place: impl Fn(u8, u8) -> [f32; 3]) -> Finished {
    check_search(layout, "", place)
}

/// The same for an experiment with these sections.
fn check_search(layout: &str, sections: &str, place: impl Fn(u8, u8) -> [f32; 3]) -> Finished {
    let toml = format!("version = 1\n[dataset]\nroot = \"data\"\nlayout = \"{layout}\"\n{sections}");
    let experiment = Experiment::with(&toml);
    let (data, mut lists, mut number) = (experiment.folder().join("data"), [const { String::new() }; 4], 0);
    for (object, sequence) in (0..OBJECTS).flat_map(|object| [(object, 1), (object, 2)]) {
        let folder = format!("tile/tile_{object}");
        fs::create_dir_all(data.join(&folder)).unwrap();
        for (split, list) in lists.iter_mut().enumerate() {
            number += 1;
            let path = format!("{folder}/tile_{object}_{sequence}_{split}.pcd");
            let [x, y, z] = place(object, sequence);
            let cloud = square([x, y, z + 0.001 * split as f32], number);
            fs::write(data.join(&path), pcd::write(&cloud, DataEncoding::Binary)).unwrap();
            list.push_str(&format!("{path}\n"));
        }
    }
    for (name, list) in SPLITS.into_iter().zip(lists) {
        fs::write(data.join(format!("{name}.txt")), list).unwrap();
    }
    run("coordinator", ["check", &experiment.path("exp.toml")]).expect_success()
}

/// The lines about it, each of which a terminal shows whole.
fn leak(checked: &Finished) -> Vec<&str> {
    let lines = checked.stdout.lines().skip_while(|line| !line.starts_with("# clouds whose object raw"));
    let lines: Vec<&str> = lines.take_while(|line| !line.starts_with("# search")).collect();
    assert!(lines.iter().all(|line| line.chars().count() <= 80), "{checked}");
    lines
}

#[test]
fn places_of_one_sequence_are_warned_of_and_the_protocol_that_hides_them_is_named() {
    // Ten places half a metre apart; in the second sequence each object is where its neighbour was, but higher.
    let checked = check("uw", |object, sequence| {
        [0.5 * f32::from((object + sequence) % OBJECTS), 0.1 * f32::from(sequence), 0.0]
    });
    assert_eq!(
        leak(&checked),
        [
            "# clouds whose object raw camera coordinates give away:",
            "#   train1 against train2               100.00 %  of 20  chance 10.00 %",
            "#   validation against train1 + train2  100.00 %  of 20  chance 10.00 %",
            "#   train1 + train2 across sequences      0.00 %  of 40  chance 10.00 %",
        ]
    );
    assert!(checked.stderr.contains("warning: split train1: "), "{checked}");
    assert!(checked.stderr.contains("got 20 of 20 clouds"), "{checked}");
    assert!(checked.stderr.contains("write [search.fitness] cross-sequence = 1"), "{checked}");
    // What is printed is still an experiment.
    assert!(checked.stdout.parse::<toml::Table>().is_ok(), "{checked}");
}

#[test]
fn objects_at_one_place_are_not_warned_of() {
    let checked = check("uw", |_, _| [0.0; 3]);
    assert!(leak(&checked)[1].ends_with("10.00 %  of 20  chance 10.00 %"), "{checked}");
    assert!(!checked.stderr.contains("warning"), "{checked}");
}

#[test]
fn places_kept_through_all_sequences_are_told_from_those_that_a_protocol_hides() {
    let checked = check("uw", |object, _| [0.5 * f32::from(object), 0.0, 0.0]);
    assert!(leak(&checked)[3].contains("across sequences    100.00 %"), "{checked}");
    assert!(checked.stderr.contains("no protocol keeps it from that"), "{checked}");
    assert!(!checked.stderr.contains("cross-sequence"), "{checked}");
}

#[test]
fn a_search_across_sequences_is_warned_of_places_that_are_kept_and_of_no_others() {
    let across = "[search.fitness]\ncross-sequence = 1\n";
    let kept = check_search("uw", across, |object, _| [0.5 * f32::from(object), 0.0, 0.0]);
    assert!(kept.stderr.contains("in other sequences expected, got 40 of 40 clouds"), "{kept}");
    assert!(kept.stderr.contains("no protocol keeps it from that"), "{kept}");
    let moved = check_search("uw", across, |object, sequence| {
        [0.5 * f32::from((object + sequence) % OBJECTS), 0.1 * f32::from(sequence), 0.0]
    });
    assert!(!moved.stderr.contains("warning"), "{moved}");
}

#[test]
fn without_sequences_it_says_how_to_name_them() {
    let checked = check("folders", |object, _| [0.5 * f32::from(object), 0.0, 0.0]);
    let lines = leak(&checked).join("\n");
    assert!(lines.contains("across sequences: not measured, 40 clouds have none"), "{checked}");
    assert!(lines.contains("tile/tile_0/tile_0_1_0.pcd"), "{checked}");
    assert!(checked.stderr.contains("column sequence of a manifest"), "{checked}");
}
