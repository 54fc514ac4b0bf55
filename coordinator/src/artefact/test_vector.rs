//! `test-vector.json`: one cloud with its summary and its answer, for whoever computes the same in another program.

use descriptor::{Described, Signature};
use serde::Serialize;

use super::EXAMPLE;
use super::error::CloudError;
use super::recogniser::Recogniser;
use crate::evaluate::Seconds;

/// The format's version.
const VERSION: u32 = 1;

/// The file. Floats are written with as many digits as tell them from their neighbours.
#[derive(Serialize)]
struct TestVector<'a> {
    version: u32,
    /// File of the cloud, beside this one.
    file: &'static str,
    /// BLAKE3 of that file.
    digest: String,
    /// Its path below the data root.
    cloud: &'a str,
    instance: &'a str,
    category: &'a str,
    /// Keypoints with a normal.
    keypoints: usize,
    shape: Part<'a>,
    colour: Part<'a>,
    predicted_instance: &'a str,
    predicted_category: &'a str,
    nearest_cloud: &'a str,
    distance: f64,
    runner_up_cloud: Option<&'a str>,
    runner_up_distance: Option<f64>,
}

#[derive(Clone, Copy, Serialize)]
struct Part<'a> {
    centroid: &'a [f32],
    deviation: &'a [f32],
}

/// The example cloud: where it comes from, what it shows, and its bytes.
#[derive(Clone)]
pub(super) struct Example {
    pub cloud: String,
    pub instance: String,
    pub category: String,
    pub bytes: Vec<u8>,
}

/// What a test vector says in the end.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Verdict {
    pub nearest_cloud: String,
    pub distance: f64,
    pub runner_up: Option<(String, f64)>,
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} at {:?}", self.nearest_cloud, self.distance)?;
        match &self.runner_up {
            Some((cloud, distance)) => write!(f, " before {cloud} at {distance:?}"),
            None => Ok(()),
        }
    }
}

/// The text of the file, and what it says in the end.
pub(super) fn test_vector(
    recogniser: &Recogniser,
    example: &Example,
) -> Result<(String, Verdict), CloudError> {
    let described = recogniser.describe(&example.bytes, &mut Seconds::default())?;
    let answer = recogniser.answer(&described, 2);
    let (nearest, runner_up) = (answer.nearest(), answer.runner_up());
    let Described { signatures, keypoints } = &described;
    // Of disk-ring, as all artefacts are: shape, then colour.
    let no_part = Part { centroid: &[], deviation: &[] };
    let part = |channel: usize| {
        let signature: Option<&Signature> = signatures.get(channel);
        signature.map_or(no_part, |it| Part { centroid: &it.centroid, deviation: &it.deviation })
    };
    let vector = TestVector {
        version: VERSION,
        file: EXAMPLE,
        digest: blake3::hash(&example.bytes).to_hex().to_string(),
        cloud: &example.cloud,
        instance: &example.instance,
        category: &example.category,
        keypoints: *keypoints,
        shape: part(0),
        colour: part(1),
        predicted_instance: nearest.instance,
        predicted_category: nearest.category,
        nearest_cloud: nearest.cloud,
        distance: nearest.distance,
        runner_up_cloud: runner_up.map(|other| other.cloud),
        runner_up_distance: runner_up.map(|other| other.distance),
    };
    let verdict = Verdict {
        nearest_cloud: nearest.cloud.to_owned(),
        distance: nearest.distance,
        runner_up: runner_up.map(|other| (other.cloud.to_owned(), other.distance)),
    };
    // Texts and finite floats always have a JSON.
    let mut text = serde_json::to_string_pretty(&vector).unwrap_or_default();
    text.push('\n');
    Ok((text, verdict))
}
