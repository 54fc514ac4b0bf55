//! Artefacts that are not sound: what was changed, cut, forged or does not fit together is refused with its place.

use std::fs;
use std::path::Path;

use descriptor::synth::{self, SynthSettings};
use descriptor::{Descriptor, Parameters, Preprocess, pcd};
use results::{Database, DatabaseCloud, DatabasePart};
use tempfile::TempDir;

use super::settings::Settings;
use super::{ArtefactError, CloudError, DATABASE, Recogniser, SETTINGS};
use crate::evaluate::Seconds;

/// Few values a cloud.
const DESCRIPTOR: Descriptor =
    Descriptor::DiskRing(Parameters { shape_bins: 8, colour_bins: 3, ..Parameters::PAPER_BEST });
/// Values of a centroid: the bins up to 180 degrees, or hue x saturation, of disk and ring.
const SHAPE: usize = 8;
const COLOUR: usize = 18;

/// Three clouds of two objects.
fn database() -> Database {
    let cloud = |cloud: &str, instance: &str| DatabaseCloud {
        cloud: cloud.to_owned(),
        instance: instance.to_owned(),
        category: "mug".to_owned(),
    };
    let values =
        |bins: usize, phase: usize| (0..3 * bins).map(|i| ((i * 7 + phase) % 11) as f32 / 11.0).collect();
    let part = |bins| DatabasePart { centroids: values(bins, 1), deviations: values(bins, 5) };
    Database {
        clouds: vec![cloud("a.pcd", "mug_1"), cloud("b.pcd", "mug_2"), cloud("c.pcd", "mug_1")],
        shape: part(SHAPE),
        colour: part(COLOUR),
    }
}

/// Writes what recognition needs of an artefact; the settings say what the database is.
fn write(folder: &Path, database: &Database, change: impl FnOnce(&mut Settings)) {
    let digest = results::write_database(folder.join(DATABASE), database).unwrap();
    let mut settings = Settings::sample(&Preprocess::default(), &DESCRIPTOR);
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
    let folder = TempDir::new().unwrap();
    let mut database = database();
    change(&mut database);
    write(folder.path(), &database, |_| {});
    refusal(folder.path()).to_string()
}

#[test]
fn a_flipped_or_missing_byte_of_either_file_is_refused() {
    let folder = TempDir::new().unwrap();
    write(folder.path(), &database(), |_| {});
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

#[test]
fn any_flipped_byte_of_the_settings_is_seen() {
    let text = Settings::sample(&Preprocess::default(), &DESCRIPTOR).seal().unwrap();
    let parse = |text: &str| Settings::parse(text, SETTINGS.into());
    parse(&text).unwrap();
    for place in 0..text.len() {
        for flip in [0x01, 0x04, 0x10] {
            let mut bytes = text.clone().into_bytes();
            bytes[place] ^= flip;
            assert!(parse(&String::from_utf8(bytes).unwrap()).is_err(), "byte {place} ^ {flip}");
        }
    }
}

#[test]
fn values_that_no_histograms_have_are_refused() {
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let said = complaint(|database| database.shape.deviations[3] = value);
        assert!(said.contains("its lists shape_deviation must hold finite numbers"), "{said}");
    }
    for value in [-0.5, 1.5] {
        let said = complaint(|database| database.colour.centroids[3] = value);
        assert!(said.contains(&format!("values must lie between 0 and 1, got {value}")), "{said}");
    }
}

#[test]
fn a_database_of_another_descriptor_or_of_none_is_refused() {
    let said = complaint(|database| {
        database.shape.centroids.truncate(3 * (SHAPE - 1));
        database.shape.deviations.truncate(3 * (SHAPE - 1));
    });
    assert!(said.contains("length must be"), "{said}");
    let said = complaint(|database| database.colour = DatabasePart::default());
    assert!(said.contains("length must be"), "{said}");
    let said = complaint(|database| *database = Database::default());
    assert!(said.contains("database: no cloud to match with"), "{said}");
    let said = complaint(|database| database.clouds[1].instance = "mug\u{1b}[2J".to_owned());
    assert!(said.contains("names must have no control characters, got mug\\u{1b}[2J"), "{said}");
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
    assert!(matches!(nothing, Err(CloudError::Pcd(_))));
}
