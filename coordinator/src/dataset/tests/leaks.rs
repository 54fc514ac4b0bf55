//! What positions give away, on data sets whose objects stand where the test puts them.

use descriptor::Preprocess;
use descriptor::pcd::{self, DataEncoding};

use super::super::{Dataset, Layout, Leak, Recognised, SequencesMissing, Verdict, Wanted};
use super::{Fixture, patch};
use crate::storage::store_in;

const OBJECTS: u8 = 8;

/// A cloud of each object, sequence (1 and 2) and split, where `place` (metres) puts it.
fn stand(place: impl Fn(u8, u8, usize) -> [f32; 3]) -> Fixture {
    let mut fixture = Fixture::empty();
    for (object, sequence) in (0..OBJECTS).flat_map(|object| [(object, 1), (object, 2)]) {
        for (split, name) in super::super::SPLITS.into_iter().enumerate() {
            fixture.clouds += 1;
            let path = format!("cup/cup_{object}/cup_{object}_{sequence}_{split}.pcd");
            let mut cloud = patch(0.002, fixture.clouds);
            for point in &mut cloud.points {
                let moved = place(object, sequence, split);
                *point = [0, 1, 2].map(|axis| point[axis] + moved[axis]);
            }
            fixture.write(&path, pcd::write(&cloud, DataEncoding::Binary));
            fixture.append(&format!("{name}.txt"), &format!("{path}\n"));
        }
    }
    fixture
}

fn load(fixture: &Fixture, layout: Layout) -> Dataset {
    let settings = super::DatasetSettings { layout, ..fixture.settings() };
    Dataset::load(&settings, &Preprocess::default(), Wanted::AllAndLeak, None).unwrap()
}

fn leak(fixture: &Fixture) -> Leak {
    load(fixture, Layout::Uw).leak.unwrap()
}

/// Of 8 objects with as many clouds each.
fn recognised(correct: u32, queries: u32) -> Recognised {
    Recognised { correct, queries, chance: 0.125 }
}

/// A place of its own for each number, with a few millimetres between frames.
fn position(number: u8, split: usize) -> [f32; 3] {
    [0.1 * f32::from(number), 0.0, 0.002 * split as f32]
}

#[test]
fn objects_at_places_of_their_own_are_recognised_everywhere() {
    let leak = leak(&stand(|object, _, split| position(object, split)));
    let (split, across) = (recognised(16, 16), Ok(recognised(32, 32)));
    assert_eq!(leak, Leak { split, across, validation: recognised(16, 16) });
    assert_eq!(leak.verdict(), Verdict::Everywhere);
}

#[test]
fn objects_that_change_places_between_sequences_are_recognised_within_them_only() {
    // In the second sequence each stands where another was, a centimetre aside.
    let leak = leak(&stand(|object, sequence, split| {
        let [x, y, z] = position((object + sequence) % OBJECTS, split);
        [x, y + 0.01 * f32::from(sequence), z]
    }));
    let (split, across) = (recognised(16, 16), Ok(recognised(0, 32)));
    assert_eq!(leak, Leak { split, across, validation: recognised(16, 16) });
    assert_eq!(leak.verdict(), Verdict::WithinSequences);
}

#[test]
fn objects_at_one_place_are_recognised_by_chance() {
    // All positions are equal: the first cloud of the database is the nearest of every query.
    let leak = leak(&stand(|_, _, _| [0.0; 3]));
    assert_eq!(leak.split, recognised(2, 16));
    assert_eq!(leak.validation, recognised(2, 16));
    assert_eq!(leak.verdict(), Verdict::Small);
}

#[test]
fn test_clouds_have_no_part() {
    let everywhere = |object: u8, sequence: u8, split: usize| position(object + 16 * sequence, split);
    let moved = stand(|object, sequence, split| match split {
        3 => [0.3, 0.1, f32::from(object)],
        _ => everywhere(object, sequence, split),
    });
    assert_eq!(leak(&moved), leak(&stand(everywhere)));
}

#[test]
fn without_sequences_only_the_split_is_measured() {
    let fixture = stand(|object, _, split| position(object, split));
    let dataset = load(&fixture, Layout::Folders);
    let leak = dataset.leak.as_ref().unwrap();
    let missing = SequencesMissing { count: 32, first: "cup/cup_0/cup_0_1_0.pcd".to_owned() };
    assert_eq!((leak.split, &leak.across), (recognised(16, 16), &Err(missing.clone())));
    assert_eq!(leak.verdict(), Verdict::Unknown);
    assert_eq!(dataset.sequences_missing(&[0, 1]), Some(missing));
}

#[test]
fn one_sequence_leaves_nothing_to_compare_with() {
    let fixture = stand(|object, _, split| position(object, split));
    let mut rows = "path,category,instance,sequence,split\n".to_owned();
    for split in super::super::SPLITS {
        let list = std::fs::read_to_string(fixture.root().join(format!("{split}.txt"))).unwrap();
        for path in list.lines() {
            rows += &format!("{path},cup,{},monday,{split}\n", path.split('/').nth(1).unwrap());
        }
    }
    fixture.write("clouds.csv", rows);
    let settings = fixture.manifest_settings();
    let dataset = Dataset::load(&settings, &Preprocess::default(), Wanted::AllAndLeak, None).unwrap();
    let leak = dataset.leak.unwrap();
    assert_eq!(leak.across, Ok(Recognised { correct: 0, queries: 0, chance: 0.0 }));
    assert_eq!(leak.verdict(), Verdict::Unknown);
}

#[test]
fn the_leak_is_measured_only_if_wanted_and_whatever_is_remembered() {
    let fixture = stand(|object, _, split| position(object, split));
    let folder = tempfile::tempdir().unwrap();
    let store = store_in(folder.path());
    let load =
        |wanted| Dataset::load(&fixture.settings(), &Preprocess::default(), wanted, Some(&store)).unwrap();
    let without = load(Wanted::All);
    assert_eq!((&without.leak, &load(Wanted::Training).leak), (&None, &None));
    let with = load(Wanted::AllAndLeak);
    assert_eq!(with.leak, Some(leak(&fixture)));
    assert_eq!(Dataset { leak: None, ..with }, without);
}
