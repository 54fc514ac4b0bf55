//! Artefacts that are not sound: what was changed, cut, forged or does not fit together is refused with its place.

use std::fs;
use std::path::Path;

use artefact::{
    ArtefactError, CloudError, DATABASE, Database, DatabaseCloud, DatabasePart, DatabaseParts, Recogniser,
    RejectSettings, SETTINGS, Settings,
};
use descriptor::synth::{self, SynthSettings};
use descriptor::{Descriptor, Family, Parameters, Preprocess, pcd};
use tempfile::TempDir;

use crate::evaluate::Seconds;

/// Few values a cloud.
const DESCRIPTOR: Descriptor =
    Descriptor::DiskRing(Parameters { shape_bins: 8, colour_bins: 3, ..Parameters::PAPER_BEST });
/// Values of a centroid: the bins up to 180 degrees, or hue x saturation, of disk and ring.
const SHAPE: usize = 8;
const COLOUR: usize = 18;

/// Values of all clouds.
fn values(bins: usize, phase: usize) -> Vec<f32> {
    (0..3 * bins).map(|i| ((i * 7 + phase) % 11) as f32 / 11.0).collect()
}

fn part(bins: usize) -> DatabasePart {
    DatabasePart { centroids: values(bins, 1), deviations: values(bins, 5) }
}

/// Three clouds of two objects.
fn of_parts(parts: DatabaseParts) -> Database {
    let cloud = |cloud: &str, instance: &str| DatabaseCloud {
        cloud: cloud.to_owned(),
        instance: instance.to_owned(),
        category: "mug".to_owned(),
        sequence: None,
        addition: None,
    };
    let clouds = vec![cloud("a.pcd", "mug_1"), cloud("b.pcd", "mug_2"), cloud("c.pcd", "mug_1")];
    Database { clouds, parts }
}

fn database() -> Database {
    of_parts(DatabaseParts::ShapeColour([part(SHAPE), part(COLOUR)]))
}

/// Shape and colour.
fn parts(database: &mut Database) -> &mut [DatabasePart; 2] {
    match &mut database.parts {
        DatabaseParts::ShapeColour(parts) => parts,
        DatabaseParts::Channels(_) => panic!("shape and colour"),
    }
}

/// Two channels, of which the second has one row a cloud.
fn structure() -> Descriptor {
    Descriptor::default_of(Family::Structure)
}

/// Three clouds in the channels of [`structure`].
fn channels() -> Database {
    let one_row = DatabasePart { centroids: values(180, 2), deviations: Vec::new() };
    of_parts(DatabaseParts::Channels(vec![part(64), one_row]))
}

/// Writes what recognition needs of an artefact; the settings say what the database is.
fn write(folder: &Path, database: &Database, change: impl FnOnce(&mut Settings)) {
    write_of(folder, &DESCRIPTOR, database, change);
}

/// As [`write`], of any descriptor.
fn write_of(folder: &Path, descriptor: &Descriptor, database: &Database, change: impl FnOnce(&mut Settings)) {
    let digest = results::write_database(folder.join(DATABASE), database).unwrap();
    let mut settings = Settings::sample(&Preprocess::default(), descriptor);
    settings.database.clouds = database.clouds.len() as u32;
    settings.database.digest = digest.to_hex().to_string();
    change(&mut settings);
    fs::write(folder.join(SETTINGS), settings.seal().unwrap()).unwrap();
}

#[track_caller]
fn refusal(folder: &Path) -> ArtefactError {
    let Err(error) = Recogniser::open(folder) else { panic!("an artefact that is not sound was opened") };
    let text = error.to_string();
    assert!(text.starts_with(&folder.display().to_string()), "no file: {text}");
    assert_eq!(text.lines().count(), 2, "no advice: {text}");
    error
}

/// What is said of an artefact with this database.
#[track_caller]
fn complaint(change: impl FnOnce(&mut Database)) -> String {
    let mut database = database();
    change(&mut database);
    complaint_of(&DESCRIPTOR, &database, |_| {})
}

/// What is said of this artefact.
#[track_caller]
fn complaint_of(descriptor: &Descriptor, database: &Database, change: impl FnOnce(&mut Settings)) -> String {
    let folder = TempDir::new().unwrap();
    write_of(folder.path(), descriptor, database, change);
    refusal(folder.path()).to_string()
}

#[test]
fn a_flipped_or_missing_byte_of_either_file_is_refused() {
    let folder = TempDir::new().unwrap();
    for (descriptor, database) in [(DESCRIPTOR, database()), (structure(), channels())] {
        write_of(folder.path(), &descriptor, &database, |_| {});
        Recogniser::open(folder.path()).unwrap();
        for name in [SETTINGS, DATABASE] {
            let file = folder.path().join(name);
            let sound = fs::read(&file).unwrap();
            for place in (0..sound.len()).step_by(61) {
                let mut bytes = sound.clone();
                bytes[place] ^= 0x04;
                fs::write(&file, &bytes).unwrap();
                refusal(folder.path());
            }
            for length in (0..sound.len() - 1).step_by(61) {
                fs::write(&file, &sound[..length]).unwrap();
                refusal(folder.path());
            }
            fs::remove_file(&file).unwrap();
            refusal(folder.path());
            fs::write(&file, &sound).unwrap();
        }
        Recogniser::open(folder.path()).unwrap();
    }
}

#[test]
fn any_flipped_byte_of_the_settings_is_seen() {
    let parse = |text: &str| Settings::parse(text, SETTINGS.into());
    for descriptor in [DESCRIPTOR, structure()] {
        let text = Settings::sample(&Preprocess::default(), &descriptor).seal().unwrap();
        parse(&text).unwrap();
        for place in 0..text.len() {
            for flip in [0x01, 0x04, 0x10] {
                let mut bytes = text.clone().into_bytes();
                bytes[place] ^= flip;
                assert!(parse(&String::from_utf8(bytes).unwrap()).is_err(), "byte {place} ^ {flip}");
            }
        }
    }
}

#[test]
fn values_that_no_histograms_have_are_refused() {
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let said = complaint(|database| parts(database)[0].deviations[3] = value);
        assert!(said.contains("its lists shape_deviation must hold finite numbers"), "{said}");
    }
    for value in [-0.5, 1.5] {
        let said = complaint(|database| parts(database)[1].centroids[3] = value);
        assert!(said.contains(&format!("values must lie between 0 and 1, got {value}")), "{said}");
    }
}

#[test]
fn a_database_of_another_descriptor_or_of_none_is_refused() {
    let said = complaint(|database| {
        let shape = &mut parts(database)[0];
        shape.centroids.truncate(3 * (SHAPE - 1));
        shape.deviations.truncate(3 * (SHAPE - 1));
    });
    assert!(said.contains("length must be"), "{said}");
    let said = complaint(|database| parts(database)[1] = DatabasePart::default());
    assert!(said.contains("length must be"), "{said}");
    let said = complaint(|database| {
        database.clouds.clear();
        *parts(database) = [DatabasePart::default(), DatabasePart::default()];
    });
    assert!(said.contains("database: no cloud to match with"), "{said}");
    let said = complaint(|database| database.clouds[1].instance = "mug\u{1b}[2J".to_owned());
    assert!(said.contains("names must have no control characters, got mug\\u{1b}[2J"), "{said}");
}

#[test]
fn channels_that_are_not_the_descriptors_are_refused() {
    let of = |parts: Vec<DatabasePart>| {
        complaint_of(&structure(), &of_parts(DatabaseParts::Channels(parts)), |_| {})
    };
    let DatabaseParts::Channels(sound) = channels().parts else { panic!("channels") };
    for (wrong, complaint) in [
        (vec![], "length must be"),
        (sound[..1].to_vec(), "length must be"),
        (vec![sound[0].clone(), sound[1].clone(), part(1)], "length must be"),
        (vec![sound[1].clone(), sound[0].clone()], "length must be"),
        // A channel of one row a cloud has no deviation.
        (vec![sound[0].clone(), part(180)], "length must be"),
        (vec![DatabasePart { deviations: Vec::new(), ..part(64) }, sound[1].clone()], "length must be"),
        (vec![DatabasePart { centroids: vec![1.5; 3 * 64], ..part(64) }, sound[1].clone()], "got 1.5"),
    ] {
        let said = of(wrong);
        assert!(said.contains(complaint), "{complaint}: {said}");
    }
    let said = complaint_of(&structure(), &database(), |_| {});
    assert!(said.contains("columns must be those of family structure, got others"), "{said}");
    // Even if they are as long as those of shape and colour.
    let same = of_parts(DatabaseParts::Channels(vec![part(SHAPE), part(COLOUR)]));
    let said = complaint_of(&DESCRIPTOR, &same, |_| {});
    assert!(said.contains("columns must be those of family disk-ring, got others"), "{said}");
}

/// Whoever forges the digest, too, meets the checks of scales.
#[test]
fn scales_that_are_not_the_descriptors_are_refused() {
    for (scales, complaint) in [
        (None, "got no database.scales"),
        (Some(vec![0.5]), "got database.scales of 1 channels where the descriptor has 2"),
        (Some(vec![0.5; 3]), "got database.scales of 3 channels where the descriptor has 2"),
        (Some(vec![0.5, 0.0]), "got database.scales with 0 for channel 2"),
        (Some(vec![f64::INFINITY, 0.5]), "got database.scales with inf for channel 1"),
        (Some(vec![f64::NAN, 0.5]), "got database.scales with NaN for channel 1"),
    ] {
        let said = complaint_of(&structure(), &channels(), |settings| settings.database.scales = scales);
        assert!(said.contains(complaint), "{complaint}: {said}");
    }
    let said =
        complaint_of(&DESCRIPTOR, &database(), |settings| settings.database.scales = Some(vec![1.0; 2]));
    assert!(said.contains("got database.scales beside family disk-ring"), "{said}");
}

/// A rule that rejects whatever is farther away than the runner-up is from nothing.
fn reject(least_probability: f64) -> RejectSettings {
    let text = format!(
        "false_rejections = 0.05\ntypical_distance = 0.5\ncoefficients = [0.0, -1.0, 2.0, 0.0]\n\
         least_probability = {least_probability}\nleast_margin = 0.01\n"
    );
    toml::from_str(&text).unwrap()
}

#[test]
fn an_artefact_with_a_rule_says_what_is_unknown_and_names_the_same_cloud_as_one_without() {
    let folder = TempDir::new().unwrap();
    let settings = SynthSettings::default();
    let cloud = synth::render(&settings, &synth::catalogue(&settings)[0], 0);
    let bytes = pcd::write(&cloud, pcd::DataEncoding::Binary);
    let answer = |rule: Option<f64>| {
        write(folder.path(), &database(), |settings| settings.reject = rule.map(reject));
        let text = fs::read_to_string(folder.path().join(SETTINGS)).unwrap();
        // Earlier builds refuse what they do not know, and nothing else.
        assert!(text.starts_with(if rule.is_some() { "version = 2\n" } else { "version = 1\n" }), "{text}");
        let recogniser = Recogniser::open(folder.path()).unwrap();
        let answer = recogniser.recognise(&bytes, 2, &mut Seconds::default()).unwrap();
        (answer.nearest().cloud.to_owned(), answer.margin(), answer.known, answer.is_unknown())
    };
    let (nearest, margin, known, is_unknown) = answer(None);
    assert!(known.is_none() && !is_unknown);
    for (least, rejects) in [(0.0, false), (1.0, true)] {
        let (again, again_margin, known, is_unknown) = answer(Some(least));
        assert_eq!((&again, again_margin, is_unknown), (&nearest, margin, rejects));
        assert_eq!(known.unwrap().is_accepted, !rejects);
        assert!((0.0..1.0).contains(&known.unwrap().probability));
    }
    // Other versions than the sections need, and rules that can be none.
    write(folder.path(), &database(), |settings| settings.reject = Some(reject(0.5)));
    let file = folder.path().join(SETTINGS);
    let sound = fs::read_to_string(&file).unwrap();
    fs::write(&file, sound.replacen("version = 2", "version = 1", 1)).unwrap();
    assert!(refusal(folder.path()).to_string().contains("version must be 2, got 1"));
    fs::write(&file, sound.replacen("least_probability = 0.5", "least_probability = 0.4", 1)).unwrap();
    assert!(matches!(refusal(folder.path()), ArtefactError::Digest { .. }));
    let said = complaint_of(&DESCRIPTOR, &database(), |settings| settings.reject = Some(reject(1.5)));
    assert!(said.contains("got reject.least_probability 1.5 instead of 0 to 1"), "{said}");
}

#[test]
fn files_that_do_not_belong_together_are_refused() {
    let folder = TempDir::new().unwrap();
    write(folder.path(), &database(), |settings| settings.database.digest = "00".repeat(32));
    assert!(matches!(refusal(folder.path()), ArtefactError::Digest { .. }));
    write(folder.path(), &database(), |settings| settings.database.clouds = 4);
    assert!(matches!(refusal(folder.path()), ArtefactError::Settings { .. }));
    write(folder.path(), &database(), |settings| settings.evaluation_version += 1);
    assert!(matches!(refusal(folder.path()), ArtefactError::EvaluationVersion { .. }));
}

#[test]
fn clouds_without_an_answer_say_why_and_others_have_one() {
    let folder = TempDir::new().unwrap();
    write(folder.path(), &database(), |_| {});
    let recogniser = Recogniser::open(folder.path()).unwrap();
    let settings = SynthSettings::default();
    let mut cloud = synth::render(&settings, &synth::catalogue(&settings)[0], 0);
    let ask = |cloud: &descriptor::Cloud| {
        let bytes = pcd::write(cloud, pcd::DataEncoding::Binary);
        let answer = recogniser.recognise(&bytes, 0, &mut Seconds::default());
        answer.map(|answer| answer.ranking.len())
    };
    assert_eq!(ask(&cloud).unwrap(), 1, "as if one had been asked for");
    let colours = cloud.colours.take();
    assert!(matches!(ask(&cloud), Err(CloudError::Describe(_))));
    cloud.colours = colours.map(|colours| colours[..9].to_vec());
    cloud.points.truncate(9);
    let said = ask(&cloud).unwrap_err().to_string();
    assert!(said.starts_with("fewer than 10 usable points, got 9\n"), "{said}");
    let nothing = recogniser.recognise(b"no cloud", 1, &mut Seconds::default());
    assert!(matches!(nothing, Err(CloudError::File(_))));
}
