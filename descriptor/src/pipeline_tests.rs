//! From cloud to match: skips, re-binned histograms, signatures and recognition against their definitions.

use expect_test::expect;
use proptest::prelude::*;
use rand::RngExt;

use crate::Domain;
use crate::disk_ring::histogram::{colour_rows, shape_rows};
use crate::prepare::{Normals, keypoints, usable};
use crate::random::stream;
use crate::recognise::{Hit, RecogniseError, recognise_from};
use crate::signature::{Signature, Signatures};
use crate::testing::{by_channel, of_bits, set_distance, sheet};
use crate::{
    Cloud, Correct, DistanceMatrix, GENES, GeneTable, Label, Match, Parameters, PrepareError, Preprocess,
    QuantiseError, QuantisedCloud, Quantiser, Skip, Unit, oracle, recognise,
};

fn paper() -> Quantiser {
    Quantiser::new(&GeneTable::paper()).unwrap()
}

/// Prepares the cloud, and says the same as [`usable`] and as who needs no normals.
fn prepare(cloud: &Cloud, preprocess: &Preprocess) -> Result<QuantisedCloud, PrepareError> {
    let prepared = QuantisedCloud::new(cloud, preprocess, &paper());
    assert_eq!(usable(cloud, preprocess).err(), prepared.as_ref().err().cloned());
    let cloud = preprocess.in_metres(cloud);
    let bare =
        keypoints(&cloud, preprocess).and_then(|keypoints| Normals::none(&cloud, &keypoints, preprocess));
    assert_eq!(bare.err(), prepared.as_ref().err().cloned());
    prepared
}

fn check_refusal(cloud: &Cloud, expected: &expect_test::Expect) {
    expected.assert_eq(&prepare(cloud, &Preprocess::default()).unwrap_err().to_string());
}

#[test]
fn small_clouds_are_skipped() {
    check_refusal(&sheet(1, 7), &expect!["fewer than 10 usable points, got 7"]);
    check_refusal(&sheet(1, 0), &expect!["fewer than 10 usable points, got 0"]);
    let lenient = Preprocess { min_points: 0, ..Preprocess::default() };
    assert_eq!(
        prepare(&sheet(1, 0), &lenient),
        Err(PrepareError::Skip(Skip::NoKeypointWithNormal { keypoints: 0 }))
    );
}

#[test]
fn clouds_without_a_normal_are_skipped() {
    // Every voxel of 2 cm holds two points at most, and none is near a third.
    let mut cloud = sheet(1, 40);
    for (index, point) in cloud.points.iter_mut().enumerate() {
        *point = [index as f32 * 0.05, 0.0, 0.5];
    }
    check_refusal(&cloud, &expect!["no keypoint with a normal, got 40 keypoints"]);
    cloud.points[1] = cloud.points[0];
    check_refusal(&cloud, &expect!["no keypoint with a normal, got 39 keypoints"]);
    cloud.points[2] = cloud.points[0];
    assert_eq!(prepare(&cloud, &Preprocess::default()).unwrap().keypoints(), 1);
    // One keypoint alone, wherever it is.
    for alone in 0..38 {
        for (index, point) in cloud.points.iter_mut().enumerate() {
            let beside = if (alone..alone + 3).contains(&index) { alone } else { index };
            *point = [beside as f32 * 0.05, 0.0, 0.5];
        }
        assert_eq!(prepare(&cloud, &Preprocess::default()).unwrap().keypoints(), 1, "{alone}");
    }
    // Points near each other, but none near the centroid of their voxel: normals for points, none for keypoints.
    for (index, point) in cloud.points.iter_mut().enumerate() {
        let corner = if index % 2 == 0 { 0.0 } else { 0.019 };
        *point = [corner, corner, corner];
    }
    check_refusal(&cloud, &expect!["no keypoint with a normal, got 1 keypoints"]);
}

#[test]
fn clouds_that_cannot_be_used_are_refused() {
    let mut cloud = sheet(1, 30);
    cloud.points[3][2] = 1e12;
    check_refusal(
        &cloud,
        &expect![[r#"
            cloud: coordinate beyond 2147483648 voxels of 0.02 m, got 1000000000000 m
            check the unit of the clouds or choose a larger leaf"#]],
    );
    let mut cloud = sheet(1, 30);
    cloud.colours.as_mut().unwrap().pop();
    check_refusal(
        &cloud,
        &expect![[r#"
            cloud: number of colours differs from the 30 points, got 29
            give every point a colour"#]],
    );
    cloud.colours = None;
    check_refusal(
        &cloud,
        &expect![[r#"
            cloud: must have colours, got none
            use clouds with an rgb field, or a descriptor of shape alone (descriptor.colour = false in an experiment, evaluate --no-colour)"#]],
    );
    let uncoloured = Preprocess { colour: false, ..Preprocess::default() };
    assert_eq!(QuantisedCloud::new(&cloud, &uncoloured, &paper()), Err(PrepareError::NoColours));
}

#[test]
fn tables_that_records_cannot_hold_are_refused() {
    let domains = |kind: usize, domain: Domain| {
        let mut domains = GENES.each_ref().map(|spec| Domain::fixed(spec.default.0));
        domains[kind] = domain;
        GeneTable::new(domains, true).unwrap()
    };
    let colours = domains(1, Domain { low: 1, step: 1, count: 32 });
    assert!(matches!(Quantiser::new(&colours), Err(QuantiseError::TooManyColours { got: 65_537.. })));
    let radii = domains(3, Domain { low: 21_000, step: 1, count: 5000 });
    assert_eq!(Quantiser::new(&radii).unwrap_err(), QuantiseError::TooManyRadii { got: 5001 });
    let angles = domains(0, Domain { low: 2, step: 1, count: 511 });
    assert!(Quantiser::new(&angles).is_ok());
    let other = Parameters { disk_um: 13_500, ..Parameters::PAPER_BEST };
    let error = paper().binning(&other).unwrap_err();
    expect![[r#"
        R1: not a value of the gene table the clouds were prepared for, got 1.35
        prepare them with a table that holds it"#]]
    .assert_eq(&error.to_string());
    assert!(paper().binning(&Parameters { colour_bins: 0, ..Parameters::PAPER_BEST }).is_err());
}

/// Compares rows from records with the definition, for one cloud and descriptor.
fn check_rows(cloud: &Cloud, quantiser: &Quantiser, parameters: &Parameters) {
    let preprocess = Preprocess { colour: parameters.has_colour(), ..Preprocess::default() };
    let keypoints = keypoints(cloud, &preprocess).unwrap();
    let normals = Normals::new(cloud, &keypoints, &preprocess).unwrap();
    let prepared = QuantisedCloud::describe(cloud, &keypoints, &normals, quantiser).unwrap();
    assert_eq!(prepared, QuantisedCloud::new(cloud, &preprocess, quantiser).unwrap());
    let sorted = QuantisedCloud::describe_sorted(cloud, &keypoints, &normals, quantiser, 0).unwrap();
    let binning = quantiser.binning(parameters).unwrap();
    let (shape, colour) = oracle::rows(cloud, &keypoints, &normals.cloud, &normals.keypoints, parameters);
    for prepared in [&prepared, &sorted] {
        assert_eq!(shape_rows(prepared, &binning), shape, "shape, {parameters}");
        assert_eq!(colour_rows(prepared, &binning), colour, "colour, {parameters}");
    }
    let direct = binning.signature_of(cloud, &keypoints, &normals, quantiser).unwrap();
    assert_eq!(direct, binning.signature(&prepared), "{parameters}");
    let features = if quantiser.has_colour() { 2 } else { 1 };
    assert!(prepared.bytes() > features * prepared.records());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn rebinned_records_are_the_definition(seed in 0u64..10_000, points in 60usize..700, bits in prop::collection::vec(any::<bool>(), 25)) {
        let parameters = of_bits(&bits);
        check_rows(&sheet(seed, points), &paper(), &parameters);
    }
}

#[test]
fn one_descriptor_alone_and_one_without_colour_are_the_definition() {
    let cloud = sheet(3, 600);
    let only = GeneTable::single(&Parameters::PAPER_BEST).unwrap();
    check_rows(&cloud, &Quantiser::new(&only).unwrap(), &Parameters::PAPER_BEST);
    let colourless = Parameters { colour_bins: 0, shape_weight_ppm: 1_000_000, ..Parameters::PAPER_BEST };
    let only = GeneTable::single(&colourless).unwrap();
    let quantiser = Quantiser::new(&only).unwrap();
    check_rows(&cloud, &quantiser, &colourless);
    check_rows(&Cloud { colours: None, ..cloud }, &quantiser, &colourless);
}

#[test]
fn tables_of_few_radii_and_of_many_are_the_definition() {
    let cloud = sheet(4, 600);
    for disks in 1..=6 {
        let mut domains = Parameters::PAPER_BEST.all_ticks().map(Domain::fixed);
        domains[crate::GeneKind::DiskRadius as usize] = Domain { low: 9_000, step: 2_000, count: disks };
        let quantiser = Quantiser::new(&GeneTable::new(domains, true).unwrap()).unwrap();
        let disk_um = 9_000 + 2_000 * (disks - 1);
        check_rows(&cloud, &quantiser, &Parameters { disk_um, ..Parameters::PAPER_BEST });
    }
}

#[test]
fn millimetres_are_metres() {
    let mut cloud = sheet(5, 500);
    // Coordinates whose thousandfold and back are exact enough to stay in their voxel.
    let millimetres = Cloud {
        points: cloud.points.iter().map(|point| point.map(|c| c * 1000.0)).collect(),
        viewpoint: cloud.viewpoint.map(|c| c * 1000.0),
        ..cloud.clone()
    };
    cloud = millimetres.clone().in_metres(0.001);
    let stored = Preprocess { unit: Unit::Millimetre, ..Preprocess::default() };
    assert_eq!(prepare(&millimetres, &stored), prepare(&cloud, &Preprocess::default()));
}

#[test]
fn a_signature_is_mean_and_deviation() {
    let rows = [0.1f32, 0.9, 0.3, 0.7, 0.8, 0.2];
    let signature = Signature::of_rows(&rows, 2);
    let close = |found: f32, expected: f64| (f64::from(found) - expected).abs() < 1e-7;
    assert!(close(signature.centroid[0], 0.4) && close(signature.centroid[1], 0.6));
    // Differences −0.3, −0.1, 0.4: squares sum to 0.26, over N − 1 = 2.
    assert!(close(signature.deviation[0], 0.13f64.sqrt()) && close(signature.deviation[1], 0.13f64.sqrt()));
    assert_eq!(
        Signature::of_rows(&rows[..2], 2),
        Signature { centroid: vec![0.1, 0.9], deviation: vec![0.0, 0.0] }
    );
    assert_eq!(Signature::of_rows(&[], 0), Signature::default());
}

fn described(seeds: std::ops::Range<u64>) -> Vec<[Signature; 2]> {
    let clouds: Vec<QuantisedCloud> =
        seeds.map(|seed| prepare(&sheet(seed, 300), &Preprocess::default()).unwrap()).collect();
    let binning = paper().binning(&Parameters::PAPER_BEST).unwrap();
    let one_by_one: Vec<[Signature; 2]> = clouds.iter().map(|cloud| binning.signature(cloud)).collect();
    assert_eq!(binning.signatures(&clouds), by_channel(&one_by_one));
    one_by_one
}

#[test]
fn set_distance_is_symmetric_and_zero_to_itself() {
    let all = described(0..5);
    for a in &all {
        assert_eq!(set_distance(a, a, 0.67), 0.0);
        for b in &all {
            assert_eq!(set_distance(a, b, 0.67).to_bits(), set_distance(b, a, 0.67).to_bits());
            assert_eq!(set_distance(a, b, 1.0), f64::from(a[0].distance(&b[0])));
            assert_eq!(set_distance(a, b, 0.0), f64::from(a[1].distance(&b[1])));
            assert!(std::ptr::eq(a, b) || set_distance(a, b, 0.67) > 0.0);
        }
    }
}

/// A cloud whose shape distance to another depends on one number.
fn point(share: f32) -> [Signature; 2] {
    let shape = Signature { centroid: vec![share, 1.0 - share], deviation: vec![0.0; 2] };
    [shape, Signature::default()]
}

/// The definition: every database cloud of another object is looked at.
fn plain_match(query: &[Signature; 2], database: &[[Signature; 2]], labels: &[Label], weight: f64) -> Match {
    let hits: Vec<Hit> = (0..database.len())
        .map(|i| Hit { index: i as u32, distance: set_distance(query, &database[i], weight) })
        .collect();
    let least = |hits: &mut dyn Iterator<Item = &Hit>| {
        hits.copied().min_by(|a, b| a.distance.total_cmp(&b.distance).then(a.index.cmp(&b.index)))
    };
    let nearest = least(&mut hits.iter()).unwrap();
    let object = labels[nearest.index as usize].instance;
    let runner_up = least(&mut hits.iter().filter(|hit| labels[hit.index as usize].instance != object));
    Match { nearest, runner_up }
}

#[test]
fn recognition_is_brute_force_with_ties_to_the_lowest_index() {
    let mut rng = stream(1, "recognition", &[]);
    for round in 0..200 {
        // Few different values, so that most distances tie.
        let mut draw = |count: usize| -> Vec<[Signature; 2]> {
            (0..count).map(|_| point((rng.random::<u32>() % 4) as f32 / 4.0)).collect()
        };
        let (queries, database) = (draw(6), draw(1 + round % 9));
        let labels: Vec<Label> = (0..database.len())
            .map(|_| rng.random::<u32>() % 3)
            .map(|instance| Label { category: instance / 2, instance })
            .collect();
        let (asked, known): ([Signatures; 2], _) = (by_channel(&queries), by_channel(&database));
        let weights = [0.7, 1.0 - 0.7];
        let matches = recognise(&asked, &known, &weights, &labels).unwrap();
        let expected: Vec<Match> =
            queries.iter().map(|query| plain_match(query, &database, &labels, 0.7)).collect();
        assert_eq!(matches, expected);

        let channels = [0, 1].map(|i| (DistanceMatrix::new(&asked[i], &known[i]), weights[i]));
        assert_eq!(recognise_from(queries.len(), &channels, &labels).unwrap(), matches);
    }
}

#[test]
fn correct_counts_objects_and_categories() {
    let label = |category, instance| Label { category, instance };
    let database = [label(0, 0), label(0, 1), label(1, 2)];
    let found = |index| Match { nearest: Hit { index, distance: 0.5 }, runner_up: None };
    let queries = [label(0, 0), label(0, 0), label(0, 0), label(1, 2)];
    let correct = Correct::count(&[found(0), found(1), found(2), found(2)], &queries, &database);
    assert_eq!(correct, Correct { queries: 4, object: 2, category: 3 });
}

#[test]
fn an_empty_database_is_an_error() {
    let (one, none) = (by_channel(&[point(0.5)]), by_channel(&[]));
    assert_eq!(recognise(&one, &none, &[0.5, 0.5], &[]), Err(RecogniseError::EmptyDatabase));
    assert_eq!(recognise(&none, &none, &[0.5, 0.5], &[]), Ok(vec![]));
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let all = described(0..12);
            let labels: Vec<Label> = (0..8).map(|i| Label { category: i / 4, instance: i / 2 }).collect();
            let [queries, database] = [&all[8..], &all[..8]].map(by_channel);
            let matches = recognise(&queries, &database, &[0.67, 1.0 - 0.67], &labels).unwrap();
            (all, matches)
        })
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(5));
}
