//! Parity with PCL 1.13: keypoints, normals, histograms and recognition against its recorded values.

use std::fs;
use std::io::Read;
use std::path::Path;

use descriptor::disk_ring::histogram::{colour_rows, shape_rows};
use descriptor::fixed::Histograms;
use descriptor::neighbours::RadiusSearch;
use descriptor::prepare::{Normals, keypoints};
use descriptor::{
    Cloud, Correct, FixedDescriptor, FixedKind, GeneTable, Label, Match, Parameters, Preprocess,
    QuantisedCloud, Quantiser, Signature, Signatures, pcd, recognise,
};
use flate2::read::GzDecoder;
use rayon::prelude::*;

use crate::experiments::shared;

/// Clouds with recorded keypoints and histograms, below the shared folder's `data`.
const CLOUDS: [&str; 6] = [
    "household-rgbd/apple/apple_2/apple_2_1_5.pcd",
    "household-rgbd/bottle/bottle_1/bottle_1_1_5.pcd",
    "household-rgbd/can/can_3/can_3_4_1.pcd",
    "household-rgbd/mug/mug_2/mug_2_4_6.pcd",
    "household-rgbd/orange/orange_1/orange_1_4_3.pcd",
    "uw/banana/banana_1/banana_1_1_1.pcd",
];

fn cloud(path: &Path) -> Cloud {
    let bytes = fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    pcd::read(&bytes).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The words of every line of a gzipped text.
fn reference(shared: &Path, name: &str) -> Vec<Vec<String>> {
    let path = shared.join("reference/pcl-1.13").join(name);
    let file = fs::File::open(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut text = String::new();
    GzDecoder::new(file).read_to_string(&mut text).unwrap();
    text.lines().map(|line| line.split_whitespace().map(str::to_owned).collect()).collect()
}

fn numbers(words: &[String]) -> Vec<f32> {
    words.iter().map(|word| word.parse().unwrap()).collect()
}

fn reference_name(path: &str, what: &str) -> String {
    format!("{}.{what}.txt.gz", path.rsplit('/').next().unwrap())
}

#[test]
fn keypoints_and_normals_are_pcls() {
    let Some(shared) = shared() else { return };
    let preprocess = Preprocess::default();
    for path in CLOUDS {
        let cloud = cloud(&shared.join("data").join(path));
        let keypoints = keypoints(&cloud, &preprocess).unwrap();
        let normals = Normals::new(&cloud, &keypoints, &preprocess).unwrap();
        let expected = reference(&shared, &reference_name(path, "keypoints"));
        assert_eq!(keypoints.len(), expected.len(), "{path}: number of keypoints");
        for (index, line) in expected.iter().enumerate() {
            let values = numbers(line);
            let at = || format!("{path}: keypoint {index}");
            for (ours, theirs) in keypoints.points[index].iter().zip(&values[..3]) {
                assert!((ours - theirs).abs() <= 1e-5, "{}: position {ours}, PCL {theirs}", at());
            }
            let colour = keypoints.colours.as_ref().unwrap()[index];
            assert_eq!(colour.map(f32::from), values[3..6], "{}: colour", at());
            let Some(normal) = normals.keypoints[index] else {
                assert!(values[6].is_nan(), "{}: PCL has a normal here", at());
                continue;
            };
            assert!(!values[6].is_nan(), "{}: PCL has no normal here", at());
            // Chord of 0.02 degrees: the arc cosine of nearly 1 would lose all digits.
            let chord2: f64 = normal
                .iter()
                .zip(&values[6..9])
                .map(|(&ours, &theirs)| {
                    (f64::from(ours) - f64::from(theirs)) * (f64::from(ours) - f64::from(theirs))
                })
                .sum();
            let limit = 0.02f64.to_radians();
            assert!(chord2 <= limit * limit, "{}: normal {normal:?}, PCL {:?}", at(), &values[6..9]);
        }
    }
}

#[test]
fn histograms_are_pcls() {
    let Some(shared) = shared() else { return };
    let preprocess = Preprocess::default();
    let parameters = Parameters::PAPER_BEST;
    let quantiser = Quantiser::new(&GeneTable::paper()).unwrap();
    let binning = quantiser.binning(&parameters).unwrap();
    let (bins, colours) =
        (parameters.shape_bins as usize, (parameters.colour_bins * parameters.colour_bins) as usize);
    let (mut total, mut equal) = (0, 0);
    for path in CLOUDS {
        let cloud = cloud(&shared.join("data").join(path));
        let keypoints = keypoints(&cloud, &preprocess).unwrap();
        let normals = Normals::new(&cloud, &keypoints, &preprocess).unwrap();
        let prepared = QuantisedCloud::describe(&cloud, &keypoints, &normals, &quantiser).unwrap();
        let expected = reference(&shared, &reference_name(path, "ours"));
        assert_eq!(prepared.keypoints(), expected.len(), "{path}: keypoints with a normal");

        let search = RadiusSearch::new(&cloud.points).unwrap();
        let with_normal =
            keypoints.points.iter().zip(&normals.keypoints).filter(|(_, normal)| normal.is_some());
        let shape = shape_rows(&prepared, &binning);
        let colour = colour_rows(&prepared, &binning);
        let rows = shape.chunks_exact(2 * bins).zip(colour.chunks_exact(2 * colours));
        for (index, (((shape, colour), line), (&keypoint, _))) in
            rows.zip(&expected).zip(with_normal).enumerate()
        {
            let region = |radius: f64| {
                let within = search.within(keypoint, radius);
                within.iter().filter(|neighbour| normals.cloud[neighbour.index as usize].is_some()).count()
            };
            let disk = region(parameters.disk_radius());
            let ring = region(parameters.ring_radius()) - disk;
            let values = numbers(line);
            let (shape_values, colour_values) = values.split_at(2 * bins);
            let ours = shape.chunks_exact(bins).chain(colour.chunks_exact(colours));
            let theirs = shape_values.chunks_exact(bins).chain(colour_values.chunks_exact(colours));
            for ((ours, theirs), points) in ours.zip(theirs).zip([disk, ring, disk, ring]) {
                let l1: f32 = ours.iter().zip(theirs).map(|(a, b)| (a - b).abs()).sum();
                total += 1;
                equal += usize::from(l1 < 1e-4);
                // A point that moves to another bin changes two shares by 1/n.
                assert!(
                    l1 * points as f32 <= 4.0 + 1e-2,
                    "{path}: keypoint {index}: L1 {l1} of {points} points"
                );
            }
        }
    }
    println!("{equal} of {total} histograms equal PCL's");
    assert!(equal as f64 >= 0.995 * total as f64, "{equal} of {total} histograms equal PCL's");
}

/// Compares each keypoint's histogram within 5 cm with PCL's, of the clouds that have some recorded: `is_alike` for a
/// share of at least `least` of the rows.
fn check_fixed(kind: FixedKind, clouds: &[&str], least: f64, is_alike: fn(&[f32], &[f32]) -> bool) {
    let Some(shared) = shared() else { return };
    let preprocess = Preprocess::default();
    let (mut total, mut alike) = (0, 0);
    for path in clouds {
        let cloud = cloud(&shared.join("data").join(path));
        let keypoints = keypoints(&cloud, &preprocess).unwrap();
        let normals = Normals::new(&cloud, &keypoints, &preprocess).unwrap();
        let found: Histograms =
            FixedDescriptor { kind, radius_um: 50_000 }.describe(&cloud, &keypoints, &normals).unwrap();
        let expected = reference(&shared, &reference_name(path, kind.name()));
        assert_eq!(found.rows().len(), expected.len(), "{path}: keypoints that {kind} describes");
        for (row, line) in found.rows().zip(&expected) {
            let expected = numbers(line);
            assert_eq!(row.len(), expected.len(), "{path}: values of a row");
            total += 1;
            alike += usize::from(is_alike(row, &expected));
        }
    }
    println!("{kind}: {alike} of {total} rows as PCL's");
    assert!(alike as f64 >= least * total as f64, "{kind}: {alike} of {total} rows as PCL's");
}

#[test]
fn pfhrgb_histograms_are_pcls() {
    // None are recorded for the banana.
    check_fixed(FixedKind::PfhRgb, &CLOUDS[..5], 0.99, |ours, theirs| {
        let l1: f32 = ours.iter().zip(theirs).map(|(a, b)| (a - b).abs()).sum();
        l1 <= 0.01 * theirs.iter().sum::<f32>()
    });
}

#[test]
fn shotcolor_histograms_are_pcls() {
    // A frame's axis may point either way where as many neighbours are on one side as on the other.
    check_fixed(FixedKind::ShotColor, &CLOUDS, 0.95, |ours, theirs| {
        let dot = |a: &[f32], b: &[f32]| -> f64 {
            a.iter().zip(b).map(|(&a, &b)| f64::from(a) * f64::from(b)).sum()
        };
        dot(ours, theirs) >= 0.999 * (dot(ours, ours) * dot(theirs, theirs)).sqrt()
    });
}

/// A split list's clouds in order, each with its label.
struct Split {
    names: Vec<String>,
    described: Vec<[Signature; 2]>,
}

/// The names in some lists, one list after the other.
fn listed(root: &Path, lists: &[&str]) -> Vec<String> {
    let read = |list: &&str| fs::read_to_string(root.join(list)).unwrap();
    lists.iter().map(read).collect::<String>().lines().map(str::to_owned).collect()
}

fn split(root: &Path, lists: &[&str], quantiser: &Quantiser, parameters: &Parameters) -> Split {
    let binning = quantiser.binning(parameters).unwrap();
    let names = listed(root, lists);
    let described = names
        .par_iter()
        .map(|name| {
            let prepared = QuantisedCloud::new(&cloud(&root.join(name)), &Preprocess::default(), quantiser)
                .unwrap_or_else(|error| panic!("{name}: {error}"));
            binning.signature(&prepared)
        })
        .collect();
    Split { names, described }
}

/// Numbers for the category and instance folders of some names.
fn labels(names: &[String], all: &[String]) -> Vec<Label> {
    let number = |name: &str, folders: usize| {
        let prefix = |name: &str| name.split('/').take(folders).collect::<Vec<_>>().join("/");
        all.iter().position(|other| prefix(other) == prefix(name)).unwrap() as u32
    };
    names.iter().map(|name| Label { category: number(name, 1), instance: number(name, 2) }).collect()
}

/// Recognises `queries` in `database` and compares errors and nearest clouds with PCL's.
fn check_recognition(root: &Path, queries: &Split, database: &Split, pcl: &[Vec<String>], pcl_errors: usize) {
    let all: Vec<String> = queries.names.iter().chain(&database.names).cloned().collect();
    let (query_labels, labels) = (labels(&queries.names, &all), labels(&database.names, &all));
    let weight = Parameters::PAPER_BEST.shape_weight();
    let [asked, known] = [queries, database].map(|side| {
        [0, 1].map(|channel| side.described.iter().map(|cloud| &cloud[channel]).collect::<Signatures>())
    });
    let matches: Vec<Match> = recognise(&asked, &known, &[weight, 1.0 - weight], &labels).unwrap();
    let correct = Correct::count(&matches, &query_labels, &labels);
    let errors = correct.queries - correct.object;
    assert_eq!(matches.len(), pcl.len(), "number of queries");
    let (mut agree, mut close) = (0, 0);
    for ((found, name), line) in matches.iter().zip(&queries.names).zip(pcl) {
        assert_eq!(*name, line[0], "order of the queries");
        agree += usize::from(database.names[found.nearest.index as usize] == line[1]);
        let distance: f64 = line[2].parse().unwrap();
        close += usize::from((found.nearest.distance - distance).abs() <= 0.01 * distance);
    }
    println!(
        "{}: {errors} of {} objects wrong (PCL {pcl_errors}), {} categories; \
         nearest cloud as PCL's for {agree}, its distance within 1 % for {close}",
        root.display(),
        correct.queries,
        correct.queries - correct.category
    );
    assert!(errors.abs_diff(pcl_errors) <= 2, "{errors} objects wrong, PCL {pcl_errors}");
    assert!(
        agree as f64 >= 0.98 * matches.len() as f64,
        "nearest cloud as PCL's for {agree} of {}",
        matches.len()
    );
    // PCL fits planes in f32, so a normal from few points, and with it a distance between like clouds, can differ.
    assert!(close as f64 >= 0.9 * matches.len() as f64, "distance as PCL's for {close} of {}", matches.len());
}

#[test]
fn recognition_on_the_household_clouds_is_pcls() {
    let Some(shared) = shared() else { return };
    let root = shared.join("data/household-rgbd");
    let parameters = Parameters::PAPER_BEST;
    let quantiser = Quantiser::new(&GeneTable::single(&parameters).unwrap()).unwrap();
    let split = |lists: &[&str]| split(&root, lists, &quantiser, &parameters);

    let database = split(&["train1.txt", "train2.txt", "validation.txt"]);
    let test = split(&["test.txt"]);
    check_recognition(&root, &test, &database, &reference(&shared, "household-test.nearest.txt.gz"), 99);

    let part = |range: std::ops::Range<usize>| Split {
        names: database.names[range.clone()].to_vec(),
        described: database.described[range].to_vec(),
    };
    let fitness = reference(&shared, "household-fitness.nearest.txt.gz");
    check_recognition(&root, &part(0..352), &part(352..704), &fitness, 104);
}

#[test]
fn recognition_with_shotcolor_is_pcls() {
    let Some(shared) = shared() else { return };
    let root = shared.join("data/household-rgbd");
    let descriptor = FixedDescriptor { kind: FixedKind::ShotColor, radius_um: 50_000 };
    let signature = |name: &String| {
        let histograms = descriptor.histograms(&cloud(&root.join(name)), &Preprocess::default());
        histograms.unwrap_or_else(|error| panic!("{name}: {error}")).signature()
    };
    let names = [&["test.txt"][..], &["train1.txt", "train2.txt", "validation.txt"]]
        .map(|lists| listed(&root, lists));
    let [queries, database]: [Signatures; 2] = names.each_ref().map(|names| {
        let signatures: Vec<Signature> = names.par_iter().map(signature).collect();
        signatures.iter().collect()
    });
    let all = names.concat();
    let [query_labels, labels] = names.each_ref().map(|names| labels(names, &all));
    let matches = recognise(&[queries], &[database], &[1.0], &labels).unwrap();
    let Correct { queries, object, category } = Correct::count(&matches, &query_labels, &labels);
    let (objects, categories) = (queries - object, queries - category);
    println!("{objects} of {queries} objects wrong (PCL 272), {categories} categories (PCL 34)");
    // One percentage point.
    assert!(objects.abs_diff(272) <= 4, "{objects} objects wrong, PCL 272");
    assert!(categories.abs_diff(34) <= 4, "{categories} categories wrong, PCL 34");
}
