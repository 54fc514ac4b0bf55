//! `test-vector.json`: one cloud with its summary and its answer, for whoever computes the same in another program.

use descriptor::{Described, Family, Signature};
use serde::Serialize;

use crate::EXAMPLE;
use crate::error::CloudError;
use crate::recogniser::Recogniser;
use crate::stages::Seconds;

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
    /// Keypoints with a normal; of a structure, whose channels have grids of their own, those of the 2 cm grid.
    keypoints: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    shape: Option<Part<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    colour: Option<Part<'a>>,
    /// Of a structure, in the order of its channels.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    channels: Vec<Part<'a>>,
    predicted_instance: &'a str,
    predicted_category: &'a str,
    nearest_cloud: &'a str,
    distance: f64,
    runner_up_cloud: Option<&'a str>,
    runner_up_distance: Option<f64>,
    /// That the object is one of the database; of artefacts that reject.
    #[serde(skip_serializing_if = "Option::is_none")]
    known_probability: Option<f64>,
}

#[derive(Clone, Copy, Serialize)]
struct Part<'a> {
    centroid: &'a [f32],
    deviation: &'a [f32],
}

impl<'a> From<&'a Signature> for Part<'a> {
    fn from(signature: &'a Signature) -> Self {
        Self { centroid: &signature.centroid, deviation: &signature.deviation }
    }
}

/// The example cloud: where it comes from, what it shows, and its bytes.
#[derive(Clone)]
pub struct Example {
    pub cloud: String,
    pub instance: String,
    pub category: String,
    pub bytes: Vec<u8>,
}

/// What a test vector says in the end.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
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

/// The text of the file, and what it says in the end, of a descriptor of this family.
pub fn test_vector(
    recogniser: &Recogniser,
    family: Family,
    example: &Example,
) -> Result<(String, Verdict), CloudError> {
    let described = recogniser.describe(&example.bytes, &mut Seconds::default())?;
    let answer = recogniser.answer(&described, 2);
    let (nearest, runner_up) = (answer.nearest(), answer.runner_up());
    let Described { signatures, keypoints } = &described;
    let parts: Vec<Part> = signatures.iter().map(Part::from).collect();
    let (shape, colour, channels) = match (family, parts.as_slice()) {
        (Family::DiskRing, &[shape, colour]) => (Some(shape), Some(colour), Vec::new()),
        _ => (None, None, parts),
    };
    let vector = TestVector {
        version: VERSION,
        file: EXAMPLE,
        digest: blake3::hash(&example.bytes).to_hex().to_string(),
        cloud: &example.cloud,
        instance: &example.instance,
        category: &example.category,
        keypoints: *keypoints,
        shape,
        colour,
        channels,
        predicted_instance: nearest.instance,
        predicted_category: nearest.category,
        nearest_cloud: nearest.cloud,
        distance: nearest.distance,
        runner_up_cloud: runner_up.map(|other| other.cloud),
        runner_up_distance: runner_up.map(|other| other.distance),
        known_probability: answer.known.map(|known| known.probability),
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
