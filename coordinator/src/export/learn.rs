//! Objects, or further clouds of objects, added to an artefact without the run that it was made from.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use artefact::{
    Contents, Database, DatabaseCloud, DatabasePart, EXAMPLE, Example, FALSE_REJECTIONS, Learned, Recogniser,
    TEST_VECTOR, channels, names_objects_by, signatures,
};
use descriptor::Signature;

use super::error::LearnError;
use super::held::HeldClouds;
use super::readme::{About, Origin};
use super::reject::{self, Reject};
use super::write::{Draft, Written, refuse_occupied};
use super::{describe_all, none_usable};
use crate::dataset::{Layout, NamedCloud, read_file};
use crate::reference_clouds::part_of;

/// What was added.
#[derive(Clone, Debug)]
pub struct Addition {
    /// Clouds that were added.
    pub clouds: usize,
    /// Objects that they show.
    pub objects: usize,
    /// Clouds that cannot be used, and why.
    pub skipped: Vec<(String, String)>,
    /// Clouds whose names the layout does not know.
    pub ignored: usize,
    /// The artefact before.
    pub before: Sized,
    /// The artefact with them.
    pub after: Sized,
    /// What names objects.
    pub recogniser: String,
    /// When answers are not believed.
    pub reject: Reject,
    /// All files together.
    pub bytes: u64,
}

/// How much an artefact holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sized {
    /// Reference clouds.
    pub clouds: usize,
    /// Objects that they show.
    pub objects: usize,
    /// Values of a cloud after projection; `None` of other recognisers.
    pub values: Option<usize>,
}

/// Adds the clouds that `layout` finds below the folder `new` to an artefact, and writes the artefact `out`, which may be
/// the same: whole, or not at all. `false_rejections` is as the artefact has it if it is `None`.
///
/// # Errors
/// [`LearnError`]; the artefact is then as it was.
pub fn learn(
    artefact: &Path,
    new: &Path,
    layout: &Layout,
    false_rejections: Option<f64>,
    out: &Path,
) -> Result<Addition, LearnError> {
    refuse_occupied(out)?;
    let contents = Contents::read(artefact)?;
    let example = example(artefact, &contents.settings.test_vector.digest)?;
    if let Err(error) = fs::read_dir(new) {
        return Err(LearnError::Folder { folder: new.to_owned(), reason: error.to_string() });
    }
    let (found, ignored) = NamedCloud::found(new, layout)?;
    check_names(&found, &contents.database.clouds)?;

    let Contents { settings, preprocess, descriptor, recognition, reject: rule, database } = contents;
    let scales = settings.database.scales.clone();
    let held = Learned { scales: scales.as_deref(), recognition: recognition.as_ref(), reject: rule };
    let together = |what: String| LearnError::Together { folder: artefact.to_owned(), what };
    let former = Recogniser::new(preprocess, &descriptor, held, database.clone()).map_err(together)?;
    let (added, skipped) = describe_all(&former, &found);
    if added.is_empty() {
        return Err(LearnError::NoCloud { folder: new.to_owned(), got: none_usable(&skipped) });
    }
    let reference = signatures(&descriptor, &database).map_err(together)?;
    check_contents(HeldClouds::new(&database.clouds, &reference), &added)?;

    let before = sized(&database.clouds, &former);
    let database = with(database, &added);
    let reference = signatures(&descriptor, &database).map_err(together)?;
    let channels = channels(&descriptor, scales.as_deref(), &reference);
    let false_rejections = false_rejections
        .or(settings.reject.map(|reject| reject.false_rejections))
        .unwrap_or(FALSE_REJECTIONS);
    let reject = reject::calibrate(recognition.as_ref(), &channels, &database.clouds, false_rejections);
    let rule = reject.calibration.as_ref().ok().map(|found| found.rule);
    let held = Learned { scales: scales.as_deref(), recognition: recognition.as_ref(), reject: rule };
    let recogniser = Recogniser::new(preprocess, &descriptor, held, database.clone()).map_err(together)?;
    let about = About {
        name: &settings.name,
        run_digest: &settings.run_digest,
        origin: Origin::Artefact,
        descriptor: &descriptor,
        scales: scales.as_deref().unwrap_or_default(),
        preprocess,
        clouds: &database.clouds,
        recognition: recognition.as_ref(),
        reject: &reject,
    };
    let readme = about.text();
    let mut settings = settings;
    settings.reject = reject.settings();
    let draft = Draft {
        settings,
        family: descriptor.family(),
        database: &database,
        recogniser: &recogniser,
        example: &example,
        readme,
    };
    let Written { bytes, .. } = draft.write(out, None)?;
    let objects: BTreeSet<&str> = added.iter().map(|(cloud, _)| &*cloud.instance).collect();
    Ok(Addition {
        clouds: added.len(),
        objects: objects.len(),
        skipped,
        ignored,
        before,
        after: sized(&database.clouds, &recogniser),
        recogniser: names_objects_by(recognition.as_ref()),
        reject,
        bytes,
    })
}

/// The example of an artefact and what it shows, which no answer needs: checked only here.
fn example(artefact: &Path, digest: &str) -> Result<Example, LearnError> {
    let path = artefact.join(TEST_VECTOR);
    let wrong = |path: &Path, what: String| LearnError::Example { path: path.to_owned(), what };
    let bytes = read_file(&path).map_err(|reason| wrong(&path, reason))?;
    if blake3::hash(&bytes).to_hex().as_str() != digest {
        return Err(wrong(&path, "another content".to_owned()));
    }
    let vector: serde_json::Value =
        serde_json::from_slice(&bytes).map_err(|error| wrong(&path, error.to_string()))?;
    let text = |key: &str| {
        let text = vector[key].as_str().map(str::to_owned);
        text.ok_or_else(|| wrong(&path, format!("no {key}")))
    };
    let (cloud, instance, category) = (text("cloud")?, text("instance")?, text("category")?);
    let (expected, path) = (text("digest")?, artefact.join(EXAMPLE));
    let bytes = read_file(&path).map_err(|reason| wrong(&path, reason))?;
    if blake3::hash(&bytes).to_hex().as_str() != expected {
        return Err(wrong(&path, "another content".to_owned()));
    }
    Ok(Example { cloud, instance, category, bytes })
}

/// Refuses an object of another category than its reference clouds, and the path of one of these.
fn check_names(found: &[NamedCloud], reference: &[DatabaseCloud]) -> Result<(), LearnError> {
    let categories: BTreeMap<&str, &str> =
        reference.iter().map(|cloud| (&*cloud.instance, &*cloud.category)).collect();
    let paths: BTreeSet<&str> = reference.iter().map(|cloud| &*cloud.cloud).collect();
    for NamedCloud { path, category, instance, .. } in found {
        if let Some(expected) = categories.get(&**instance).filter(|expected| **expected != category) {
            return Err(LearnError::Category {
                cloud: path.clone(),
                instance: instance.clone(),
                expected: (*expected).to_owned(),
                got: category.clone(),
            });
        }
        if paths.contains(&**path) {
            return Err(LearnError::SameName { cloud: path.clone() });
        }
    }
    Ok(())
}

/// Refuses clouds that have the content of another.
fn check_contents<'a>(
    mut held: HeldClouds<'a>,
    added: &'a [(&NamedCloud, Vec<Signature>)],
) -> Result<(), LearnError> {
    let mut same = Vec::new();
    for (cloud, signatures) in added {
        if let Some(of) = held.add(signatures, &cloud.path) {
            same.push((cloud.path.clone(), of.to_owned()));
        }
    }
    let count = same.len();
    match same.into_iter().next() {
        Some((first, of)) => Err(LearnError::SameContent { count, first, of }),
        None => Ok(()),
    }
}

/// A database with further clouds behind those that it has.
fn with(mut database: Database, added: &[(&NamedCloud, Vec<Signature>)]) -> Database {
    let last = database.clouds.iter().filter_map(|cloud| cloud.addition).max().unwrap_or(0);
    let row = |(cloud, _): &(&NamedCloud, Vec<Signature>)| DatabaseCloud {
        cloud: cloud.path.clone(),
        instance: cloud.instance.clone(),
        category: cloud.category.clone(),
        sequence: cloud.sequence.clone(),
        addition: Some(last + 1),
    };
    database.clouds.extend(added.iter().map(row));
    let described: Vec<Vec<Signature>> = added.iter().map(|(_, signatures)| signatures.clone()).collect();
    for (channel, part) in database.parts.as_mut_slice().iter_mut().enumerate() {
        let DatabasePart { centroids, deviations } = part_of(&described, channel);
        part.centroids.extend(centroids);
        part.deviations.extend(deviations);
    }
    database
}

fn sized(clouds: &[DatabaseCloud], recogniser: &Recogniser) -> Sized {
    let objects: BTreeSet<_> = clouds.iter().map(|row| (&row.category, &row.instance)).collect();
    Sized { clouds: clouds.len(), objects: objects.len(), values: recogniser.size() }
}
