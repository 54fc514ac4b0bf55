//! Digests of everything computed from a cloud: they change only together with [`EVALUATION_VERSION`].

use blake3::Hasher;

use crate::disk_ring::histogram::{colour_rows, shape_rows};
use crate::prepare::{Normals, keypoints};
use crate::signature::Signature;
use crate::testing::{by_channel, set_distance, sheet};
use crate::{
    EVALUATION_VERSION, GeneTable, Label, Parameters, Preprocess, QuantisedCloud, Quantiser, recognise,
};

/// The version that the digests below belong to.
const GOLDEN_VERSION: u32 = 2;

const GOLDEN: [(&str, &str); 6] = [
    ("keypoints", "9a16bc93bd6992a3"),
    ("normals", "4c91f5c2f568ad85"),
    ("histograms", "e8822038ab7f19b0"),
    ("signatures", "3b78f3c9b5db90ff"),
    ("distances", "f3876d30d39c9e69"),
    ("matches", "565dd720456ba12e"),
];

fn floats<'a>(hasher: &mut Hasher, values: impl IntoIterator<Item = &'a f32>) {
    for value in values {
        hasher.update(&value.to_bits().to_le_bytes());
    }
}

fn signature(hasher: &mut Hasher, signature: &Signature) {
    floats(hasher, &signature.centroid);
    floats(hasher, &signature.deviation);
}

/// Digests of all stages over twelve clouds and three descriptors.
fn digests() -> [String; 6] {
    let mut hashers: [Hasher; 6] = Default::default();
    let [keypoint_bits, normal_bits, histogram_bits, signature_bits, distance_bits, match_bits] =
        &mut hashers;
    let preprocess = Preprocess::default();
    let quantiser = Quantiser::new(&GeneTable::paper()).unwrap();
    let mut prepared = Vec::new();
    for seed in 0..12 {
        let cloud = sheet(seed, 350 + 40 * seed as usize);
        let keypoints = keypoints(&cloud, &preprocess).unwrap();
        let normals = Normals::new(&cloud, &keypoints, &preprocess).unwrap();
        floats(keypoint_bits, keypoints.points.iter().flatten());
        keypoint_bits.update(keypoints.colours.as_ref().unwrap().as_flattened());
        for normal in normals.cloud.iter().chain(&normals.keypoints) {
            normal_bits.update(&[u8::from(normal.is_some())]);
            floats(normal_bits, normal.iter().flatten());
        }
        prepared.push(QuantisedCloud::describe(&cloud, &keypoints, &normals, &quantiser).unwrap());
    }
    let labels: Vec<Label> = (0..8).map(|index| Label { category: index / 4, instance: index / 2 }).collect();
    for parameters in [
        Parameters::PAPER_BEST,
        Parameters {
            shape_bins: 8,
            colour_bins: 3,
            disk_um: 5_000,
            ring_um: 50_000,
            shape_weight_ppm: 110_000,
        },
        Parameters {
            shape_bins: 33,
            colour_bins: 5,
            disk_um: 20_000,
            ring_um: 21_000,
            shape_weight_ppm: 1_000_000,
        },
    ] {
        let binning = quantiser.binning(&parameters).unwrap();
        for cloud in &prepared {
            floats(histogram_bits, &shape_rows(cloud, &binning));
            floats(histogram_bits, &colour_rows(cloud, &binning));
        }
        let described: Vec<[Signature; 2]> = prepared.iter().map(|cloud| binning.signature(cloud)).collect();
        let weight = parameters.shape_weight();
        for cloud in &described {
            cloud.iter().for_each(|one| signature(signature_bits, one));
            for other in &described {
                let distance = set_distance(cloud, other, weight);
                distance_bits.update(&distance.to_bits().to_le_bytes());
            }
        }
        let (database, queries) = described.split_at(labels.len());
        let (database, queries) = (by_channel(database), by_channel(queries));
        for found in recognise(&queries, &database, &[weight, 1.0 - weight], &labels).unwrap() {
            for hit in [Some(found.nearest), found.runner_up].into_iter().flatten() {
                match_bits.update(&hit.index.to_le_bytes());
                match_bits.update(&hit.distance.to_bits().to_le_bytes());
            }
        }
    }
    hashers.map(|hasher| hasher.finalize().to_hex()[..16].to_owned())
}

#[test]
fn outputs_are_those_of_the_evaluation_version() {
    assert_eq!(
        EVALUATION_VERSION,
        GOLDEN_VERSION,
        "the evaluation version was raised: set GOLDEN_VERSION and replace the digests by {:#?}",
        digests()
    );
    for ((stage, expected), found) in GOLDEN.into_iter().zip(digests()) {
        assert_eq!(
            found,
            expected,
            "{stage}: outputs changed. If that is meant, raise EVALUATION_VERSION: results of both must never mix.\n\
             All digests: {:#?}",
            digests()
        );
    }
}
