//! Files of structures: what they mean, what is wrong with them, and that they give back what was written.

use proptest::prelude::*;

use super::*;
use crate::Parameters;
use crate::structure::testing::{point, structure};

fn read(text: &str) -> Result<Structure, StructureError> {
    toml::from_str::<StructureFile>(text).unwrap().structure()
}

/// The text of a file with one channel, sound but for these lines.
fn error(lines: &str) -> String {
    let key = |line: &str| line.split(' ').next().unwrap_or_default().to_owned();
    let changed: Vec<String> = lines.lines().map(key).collect();
    let sound = ["pairs = \"keypoint-neighbour\"", "features = [\"hue 6\"]", "radius_cm = 5"];
    let sound = sound.into_iter().filter(|line| !changed.contains(&key(line)));
    let channel = sound.chain(lines.lines()).collect::<Vec<_>>().join("\n");
    read(&format!("version = 1\n[[channel]]\n{channel}\n")).unwrap_err().to_string()
}

#[test]
fn the_papers_best_is_a_file() {
    let Parameters { shape_bins, colour_bins, disk_um, ring_um, shape_weight_ppm } = Parameters::PAPER_BEST;
    let colour = StructureChannel {
        pairs: Pairs::KeypointNeighbour,
        axes: [Feature::Hue, Feature::Saturation]
            .map(|feature| Axis { feature, bins: colour_bins, full_turn: false })
            .to_vec(),
        is_joint: true,
        squash_milli: 0,
        radius_um: ring_um,
        shells_um: vec![disk_um, ring_um],
        least_um: 0,
        grid_um: 20_000,
        samples: 0,
        oriented: true,
        all_keypoints: false,
        metric: SetDistance::ChiSquared,
        value_weights: Vec::new(),
    };
    let shape = StructureChannel {
        axes: vec![Axis { feature: Feature::Angle, bins: shape_bins, full_turn: true }],
        oriented: false,
        ..colour.clone()
    };
    assert_eq!([shape.bins(), colour.bins()], Parameters::PAPER_BEST.channel_bins());
    let weighted = |channel, weight_ppm| Weighted { channel, weight_ppm, scale: Scale::None };
    let channels = vec![weighted(shape, shape_weight_ppm), weighted(colour, 1_000_000 - shape_weight_ppm)];
    assert_eq!(
        read(include_str!("../../../../experiments/descriptors/paper.toml")),
        Ok(Structure { channels })
    );
}

#[test]
fn ready_made_files_are_these() {
    let pfhrgb = read(include_str!("../../../../experiments/descriptors/pfhrgb.toml")).unwrap();
    assert_eq!(
        pfhrgb.to_string(),
        "neighbours f1 5·f2 5·f3 5, 5 cm, all pairs, grid 2 cm, all keypoints, unscaled, weight 1.0 + \
         neighbours qr 5·qg 5·qb 5, 5 cm, all pairs, grid 2 cm, normals only, all keypoints, unscaled, weight 1.0"
    );
    assert!(pfhrgb.channels.iter().all(|it| it.channel.bins() == 125));
    let cospair = read(include_str!("../../../../experiments/descriptors/cospair.toml")).unwrap();
    assert_eq!(
        cospair.to_string(),
        "keypoint-neighbour f1 9 | a2 9 | a3 9 | L 9 | a 9 | b 9, 5 cm, 7 shells, grid 2 cm, unscaled, weight 1.0"
    );
    let channel = &cospair.channels[0].channel;
    assert_eq!(channel.bins(), 7 * 6 * 9);
    assert_eq!(channel.shells_um, [7_143, 14_286, 21_429, 28_571, 35_714, 42_857, 50_000]);
}

#[test]
fn what_is_not_written_has_its_default() {
    let structure =
        read("version = 1\n[[channel]]\npairs = \"neighbours\"\nfeatures = [\"f1 5\"]\nradius_cm = 5\n");
    let channel = StructureChannel {
        pairs: Pairs::Neighbours,
        axes: vec![Axis { feature: Feature::F1, bins: 5, full_turn: false }],
        is_joint: true,
        squash_milli: 0,
        radius_um: 50_000,
        shells_um: vec![100_000],
        least_um: 0,
        grid_um: 20_000,
        samples: 0,
        oriented: false,
        all_keypoints: false,
        metric: SetDistance::ChiSquared,
        value_weights: Vec::new(),
    };
    let weighted = Weighted { channel, weight_ppm: 1_000_000, scale: Scale::Quantile };
    assert_eq!(structure, Ok(Structure { channels: vec![weighted] }));
}

#[test]
fn redundant_switches_say_nothing() {
    let of = |line: &str| {
        read(&format!(
            "version = 1\n[[channel]]\npairs = \"neighbours\"\nfeatures = [\"f1 5\"]\nradius_cm = 5\n{line}\n"
        ))
    };
    assert_eq!(of("normals_only = true"), of(""));
    assert_eq!(of("side_by_side = true"), of(""));
    assert_eq!(of("shells_cm = [10]"), of(""));
    assert_ne!(of("shells_cm = [5]"), of(""));
    assert_ne!(of("all_keypoints = true"), of(""));
}

#[test]
fn mistakes_are_told_with_channel_and_key() {
    for (lines, message) in [
        (
            "pairs = \"points\"",
            "pairs: one of keypoint-neighbour, neighbours, keypoints, cloud expected, got \"points\"\nwrite one of these names",
        ),
        ("features = []", "features: must be 1 to 8, got 0\nname what is binned, such as \"hue 6\""),
        (
            "features = [\"hue\"]",
            "features: name and number of bins expected, got \"hue\"\nwrite them as \"hue 6\" or \"angle 60 over 360\"",
        ),
        (
            "features = [\"hue 65\"]",
            "features: must have 2 to 64 bins, got 65 of hue\nchoose a number inside these limits",
        ),
        (
            "features = [\"hue 6\", \"d 5\", \"hue 7\"]",
            "features: must differ, got hue twice\nwrite each feature once",
        ),
        (
            "features = [\"hue 6 over 360\"]",
            "features: only bins of angle may be over 360 degrees, got hue\nwrite its bins alone",
        ),
        (
            "features = [\"d 64\", \"hue 64\", \"a 5\"]",
            "features: must make at most 16384 values a row, got 20480\ntake fewer bins, features or shells",
        ),
        ("features = [\"c1 6\"]", "squash: needed by c1, got none\nwrite one, such as 0.3"),
        ("squash = 0.3", "squash: needed by no feature, got 0.3\nleave it out"),
        ("features = [\"c1 6\"]\nsquash = 0", "squash: must be above 0, got 0\nwrite one, such as 0.3"),
        (
            "features = [\"c1 6\"]\nsquash = 11",
            "squash: must be 0.001 to 10, got 11\nchoose a value inside these limits",
        ),
        ("radius_cm = 0", "radius_cm: must be 0.0001 to 100, got 0\nchoose a value inside these limits"),
        ("radius_cm = 101", "radius_cm: must be 0.0001 to 100, got 101\nchoose a value inside these limits"),
        ("radius_cm = nan", "radius_cm: must be 0.0001 to 100, got NaN\nchoose a value inside these limits"),
        ("radius_cm = -1", "radius_cm: must be 0.0001 to 100, got -1\nchoose a value inside these limits"),
        ("radius_cm = 1.23456", "radius_cm: must be a multiple of 0.0001, got 1.23456\nround it"),
        ("shells_cm = []", "shells_cm: must be 1 to 8, got 0\nwrite the outer bound of each"),
        (
            "shells_cm = [2, 2]",
            "shells_cm: must ascend from above 0, got 2 after 2\nwrite outer bounds from the smallest to the largest",
        ),
        (
            "shells_cm = [2, 6]",
            "shells_cm: must be at most 5, the longest distance of a pair, got 6\nlower it or raise the radius",
        ),
        ("shells = 9", "shells: must be 1 to 8, got 9\nchoose a number inside these limits"),
        ("shells = 2\nshells_cm = [1]", "shells: not beside shells_cm, got both\nwrite one of them"),
        (
            "least_cm = 5",
            "least_cm: must be below 5, where the last shell ends, got 5\nlower it, so that there are pairs",
        ),
        ("grid_cm = 0.05", "grid_cm: must be 0.1 to 100, got 0.05\nchoose a value inside these limits"),
        (
            "pairs = \"cloud\"\ngrid_cm = 2",
            "grid_cm: pairs of a cloud have no keypoints, got 2\nleave it out",
        ),
        ("samples = 64", "samples: all keypoint-neighbour pairs are taken, got 64\nleave it out"),
        ("pairs = \"cloud\"\nsamples = 0", "samples: must be above 0, got 0\nleave it out for all pairs"),
        (
            "pairs = \"cloud\"\nsamples = 65537",
            "samples: must be 1 to 65536, got 65537\nlower it, or leave it out for all",
        ),
        (
            "pairs = \"cloud\"\nall_keypoints = true",
            "all_keypoints: only of neighbours, got true of cloud\nleave it out",
        ),
        (
            "pairs = \"neighbours\"\nall_keypoints = true",
            "all_keypoints: implied where points need no normal, got true\nleave it out",
        ),
        ("metric = \"l2\"", "metric: one of "),
        ("scale = \"1\"", "scale: one of quantile, none expected, got \"1\"\nwrite one of these names"),
        ("value_weights = []", "value_weights: there must be one for each value, got none\nleave them out"),
        (
            "value_weights = [1, 0.5]",
            "value_weights: there must be 12, one for each value, got 2\ncount the bins, twice where there is a deviation, or leave them out",
        ),
        (
            "pairs = \"cloud\"\nfeatures = [\"hue 2\"]\nvalue_weights = [1, 1]",
            "value_weights: must not all be 1, got 2 such\nleave them out",
        ),
        (
            "pairs = \"cloud\"\nfeatures = [\"hue 2\"]\nvalue_weights = [0.5, 0.25]",
            "value_weights: the largest must be 1, got 0.5\ndivide them by the largest, and multiply weight by it",
        ),
        ("value_weights = [1.5]", "value_weights: must be 0 to 1, got 1.5\ndivide them by the largest"),
        (
            "value_weights = [nan]",
            "value_weights: must be 0 to 1, got NaN\nchoose a value inside these limits",
        ),
        ("value_weights = [0.00001]", "value_weights: must be a multiple of 0.0001, got 0.00001\nround it"),
        ("weight = 0", "weight: must be 0.000001 to 1000, got 0\nchoose a value inside these limits"),
        ("weight = 1001", "weight: must be 0.000001 to 1000, got 1001\nchoose a value inside these limits"),
    ] {
        let (message, got) = (format!("channel 1: {message}"), error(lines));
        assert!(
            got == message || message.ends_with("one of ") && got.starts_with(&message),
            "{got}\nnot\n{message}"
        );
    }
    let long = error(&format!("pairs = \"{}\"", "x\\n".repeat(100)));
    assert!(long.contains(&format!("got \"{}\"…\n", "x\\n".repeat(20))), "{long}");

    let second = "version = 1\n[[channel]]\npairs = \"cloud\"\nfeatures = [\"d 5\"]\nradius_cm = 20\n\
                  [[channel]]\npairs = \"cloud\"\nfeatures = [\"c1 6\"]\nradius_cm = 20\n";
    let message = "channel 2: squash: needed by c1, got none\nwrite one, such as 0.3";
    assert_eq!(read(second).unwrap_err().to_string(), message);
    assert_eq!(
        read("version = 1").unwrap_err().to_string(),
        "channel: there must be 1 to 8, got 0\nwrite one [[channel]] for each"
    );
    assert_eq!(
        read("version = 2").unwrap_err().to_string(),
        "version: must be 1, got 2\nuse a program of the release that wrote the file"
    );
    for unknown in ["version = 1\nchannels = 1", "version = 1\n[[channel]]\nradius = 1"] {
        let error = toml::from_str::<StructureFile>(unknown).unwrap_err().to_string();
        assert!(error.contains("unknown field"), "{error}");
    }
}

#[test]
fn files_are_written_as_people_write_them() {
    let text = include_str!("../../../../experiments/descriptors/cospair.toml");
    let written = toml::to_string(&StructureFile::from(&read(text).unwrap())).unwrap();
    assert_eq!(
        written,
        "version = 1\n\n[[channel]]\npairs = \"keypoint-neighbour\"\n\
         features = [\"f1 9\", \"a2 9\", \"a3 9\", \"L 9\", \"a 9\", \"b 9\"]\nside_by_side = true\n\
         radius_cm = 5\nshells = 7\ngrid_cm = 2\nweight = 1\nscale = \"none\"\n"
    );
}

fn is_given_back(structure: &Structure) -> Result<(), TestCaseError> {
    let text = toml::to_string(&StructureFile::from(structure)).unwrap();
    prop_assert_eq!(&read(&text), &Ok(structure.clone()), "{}", text);
    Ok(())
}

proptest! {
    #[test]
    fn a_file_gives_its_structure_back(structure in structure()) {
        is_given_back(&structure)?;
    }

    #[test]
    fn a_file_gives_a_searched_structure_back((space, indices) in point()) {
        is_given_back(&space.decode(&indices).unwrap())?;
    }
}
