//! What everything outside this crate relies on: bytes, columns, fields and channels of every family.

use proptest::prelude::*;

use crate::recognise::recognise_from;
use crate::structure::{Structure, StructureSpace};
use crate::testing::{set_distance, sheet};
use crate::{
    BytesError, ChannelError, Describer, Descriptor, Domain, Family, FixedDescriptor, FixedKind, GENES,
    GeneError, GeneTable, GlobalHue, Label, Parameters, PreparedCloud, Preprocess, SearchSpace, SetDistance,
    Signature, Signatures,
};

/// Search spaces of every family.
fn spaces() -> Vec<SearchSpace> {
    let colourless = Parameters { colour_bins: 0, shape_weight_ppm: 1_000_000, ..Parameters::PAPER_BEST };
    let mut spaces = vec![
        SearchSpace::DiskRing(GeneTable::paper()),
        SearchSpace::DiskRing(GeneTable::single(&colourless).unwrap()),
        SearchSpace::DiskRing(GeneTable::single(&Parameters::PAPER_BEST).unwrap()),
        SearchSpace::new(Family::GlobalHue, true, &[GlobalHue::GENE.default_domain()]).unwrap(),
        SearchSpace::GlobalHue(Domain { low: 4, step: 6, count: 10 }),
    ];
    let fixed = |kind| SearchSpace::Fixed(FixedDescriptor { kind, radius_um: 50_000 });
    spaces.extend(FixedKind::ALL.map(fixed));
    spaces.push(SearchSpace::Structures(StructureSpace::default()));
    spaces.push(SearchSpace::Structures(StructureSpace {
        colour: false,
        slots: 2,
        members: 1,
        max_bins: 120,
        metric: SetDistance::Hellinger,
    }));
    spaces.push(SearchSpace::Structures(StructureSpace {
        slots: 6,
        members: 3,
        ..StructureSpace::default()
    }));
    spaces.push(SearchSpace::Structure(Structure::default()));
    spaces
}

/// A space, indices into its fields, and what they stand for.
fn descriptors() -> impl Strategy<Value = (SearchSpace, Vec<u32>, Descriptor)> {
    prop::sample::select(spaces()).prop_flat_map(|space| {
        let index: Vec<_> = space.genes().into_iter().map(|(_, domain)| 0..domain.count).collect();
        (Just(space), index).prop_map(|(space, indices)| {
            let descriptor = space.decode(&indices).unwrap();
            (space, indices, descriptor)
        })
    })
}

proptest! {
    #[test]
    fn descriptors_are_read_as_they_are_written((space, indices, descriptor) in descriptors()) {
        let bytes = descriptor.to_bytes();
        prop_assert_eq!(Descriptor::from_bytes(&bytes), Ok(descriptor.clone()));
        for length in 0..bytes.len() {
            prop_assert!(Descriptor::from_bytes(&bytes[..length]).is_err());
        }
        prop_assert!(Descriptor::from_bytes(&[bytes.as_slice(), &[0]].concat()).is_err());

        let encoded = space.encode(&descriptor).unwrap();
        if !matches!(space, SearchSpace::Structures(_)) {
            prop_assert_eq!(&encoded, &indices);
        }
        // Several chromosomes may stand for one structure.
        prop_assert_eq!(space.decode(&encoded), Some(descriptor.clone()));
        prop_assert!(space.contains(&descriptor));
        prop_assert!(SearchSpace::single(&descriptor).unwrap().contains(&descriptor));
        prop_assert_eq!(descriptor.family(), space.family());

        let values = space.values(&descriptor);
        prop_assert_eq!(space.columns().len(), values.len());
        prop_assert_eq!(Descriptor::from_values(space.family(), &values[1..]), None);
        prop_assert_eq!(space.from_values(&values), Some(descriptor.clone()));
        prop_assert_eq!(space.from_values(&descriptor.values()), Some(descriptor));
    }

    #[test]
    fn bytes_of_anything_are_refused_or_written_again(
        tag in 0u8..7,
        version in 0u8..3,
        numbers in prop_oneof![
            prop::collection::vec(prop_oneof![0u32..70, any::<u32>()], 0..17),
            prop::collection::vec(prop_oneof![Just(1u32), 2u32..70, 5_000u32..60_000], 16),
        ],
    ) {
        let mut bytes = vec![tag, version];
        bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
        if let Ok(descriptor) = Descriptor::from_bytes(&bytes) {
            prop_assert_eq!(descriptor.to_bytes(), bytes.clone());
            prop_assert!(SearchSpace::single(&descriptor).is_ok());
        }
        if let Ok(space) = SearchSpace::from_bytes(&bytes) {
            prop_assert_eq!(space.to_bytes(), bytes);
            let highest: Vec<u32> = space.genes().iter().map(|(_, domain)| domain.count - 1).collect();
            let descriptor = space.decode(&highest).unwrap();
            prop_assert_eq!(Descriptor::from_bytes(&descriptor.to_bytes()), Ok(descriptor));
        }
    }
}

#[test]
fn canonical_bytes_are_these() {
    let paper = Descriptor::DiskRing(Parameters::PAPER_BEST);
    let expected: Vec<u8> =
        [60, 8, 13_000, 36_000, 670_000u32].iter().flat_map(|number| number.to_le_bytes()).collect();
    assert_eq!(paper.to_bytes(), [&[1, 1], expected.as_slice()].concat());
    let shot = Descriptor::Fixed(FixedDescriptor { kind: FixedKind::ShotColor, radius_um: 50_000 });
    assert_eq!(shot.to_bytes(), [3, 1, 0x50, 0xc3, 0, 0]);
    assert_eq!(Descriptor::GlobalHue(GlobalHue::new(16).unwrap()).to_bytes(), [4, 1, 16, 0, 0, 0]);
}

#[test]
fn search_spaces_are_read_as_they_are_written() {
    for space in spaces() {
        let bytes = space.to_bytes();
        assert_eq!(SearchSpace::from_bytes(&bytes).as_ref(), Ok(&space));
        for length in 0..bytes.len() {
            assert!(SearchSpace::from_bytes(&bytes[..length]).is_err(), "{length} bytes");
        }
        let counts: Vec<u32> = space.genes().iter().map(|(_, domain)| domain.count).collect();
        let product = counts.iter().try_fold(1u128, |product, &count| product.checked_mul(count.into()));
        assert_eq!(space.size(), product);
        assert_eq!(space.only().is_some(), counts.iter().all(|&count| count == 1));
        let beyond = counts.clone();
        assert_eq!(space.decode(&beyond).is_none(), !beyond.is_empty());
        assert_eq!(space.decode(&vec![0; counts.len() + 1]), None);
        assert_eq!(Family::named(space.family().name()), Some(space.family()));
    }
    assert_eq!(SearchSpace::DiskRing(GeneTable::paper()).size(), Some(16_580_160));
}

#[test]
fn foreign_bytes_are_refused_by_what_is_wrong_with_them() {
    let of = |bytes: &[u8]| Descriptor::from_bytes(bytes).unwrap_err();
    assert!(matches!(of(&[]), BytesError::TooShort { got: 0, .. }));
    assert!(matches!(of(&[9, 1]), BytesError::Family { got: 9, .. }));
    assert!(matches!(of(&[4, 2, 16, 0, 0, 0]), BytesError::Version { got: 2, .. }));
    assert!(matches!(of(&[4, 1, 16, 0, 0]), BytesError::Length { expected: 4, got: 3, .. }));
    expect_test::expect![[r#"
        descriptor: values of global-hue expected, got bins: value outside 2 to 64, got 65
        choose values inside these limits"#]]
    .assert_eq(&of(&[4, 1, 65, 0, 0, 0]).to_string());
}

#[test]
fn tables_have_the_columns_of_the_genes() {
    let names = |descriptor: &Descriptor| {
        let name = |(column, value): (crate::Column, Option<f64>)| format!("{} {value:?}", column.name);
        let columns = descriptor.family().columns().into_iter().zip(descriptor.values());
        columns.map(name).collect::<Vec<_>>().join(", ")
    };
    let colourless = Parameters { colour_bins: 0, shape_weight_ppm: 1_000_000, ..Parameters::PAPER_BEST };
    for (descriptor, expected, name) in [
        (
            Descriptor::DiskRing(Parameters::PAPER_BEST),
            "shape_bins Some(60.0), m Some(8.0), R1 Some(1.3), R2 Some(3.6), w Some(0.67)",
            "shape_bins=60 m=8 R1=1.3 cm R2=3.6 cm w=0.67",
        ),
        (
            Descriptor::DiskRing(colourless),
            "shape_bins Some(60.0), m None, R1 Some(1.3), R2 Some(3.6), w Some(1.0)",
            "shape_bins=60 R1=1.3 cm R2=3.6 cm w=1",
        ),
        (
            Descriptor::Fixed(FixedDescriptor { kind: FixedKind::PfhRgb, radius_um: 50_000 }),
            "radius Some(5.0)",
            "pfhrgb radius=5 cm",
        ),
        (Descriptor::GlobalHue(GlobalHue::new(16).unwrap()), "bins Some(16.0)", "global-hue bins=16"),
    ] {
        assert_eq!(names(&descriptor), expected);
        assert_eq!(descriptor.to_string(), name);
    }
    for (column, spec) in Family::DiskRing.columns().iter().zip(&GENES) {
        assert_eq!((column.name, column.unit, column.integer), (spec.name, spec.unit, spec.is_integer()));
    }
}

/// Clouds prepared for a descriptor, and their signatures in each channel.
fn describe(descriptor: &Descriptor, seeds: std::ops::Range<u64>) -> Vec<Signatures> {
    describe_by(&Preprocess::default(), descriptor, seeds)
}

fn describe_by(
    preprocess: &Preprocess,
    descriptor: &Descriptor,
    seeds: std::ops::Range<u64>,
) -> Vec<Signatures> {
    let preparer = SearchSpace::single(descriptor).unwrap().preparer().unwrap();
    let prepare = |seed| preparer.prepare(&sheet(seed, 300), preprocess).unwrap();
    let clouds: Vec<PreparedCloud> = seeds.map(prepare).collect();
    let signatures = |(channel, _): (crate::Channel, f64)| {
        channel.extractor(&preparer).unwrap().signatures(&clouds).unwrap()
    };
    descriptor.channels().into_iter().map(signatures).collect()
}

fn one(signatures: &Signatures, cloud: usize) -> Signature {
    let [centroid, deviation] = signatures.get(cloud).map(<[f32]>::to_vec);
    Signature { centroid, deviation }
}

#[test]
fn the_set_distance_is_the_weighted_sum_of_shape_and_colour_bit_for_bit() {
    for weight in [0, 10_000, 670_000, 1_000_000] {
        let parameters = Parameters { shape_weight_ppm: weight, ..Parameters::PAPER_BEST };
        let descriptor = Descriptor::DiskRing(parameters);
        let (queries, database) = (describe(&descriptor, 0..3), describe(&descriptor, 3..8));
        let distances: Vec<_> = descriptor
            .channels()
            .iter()
            .enumerate()
            .map(|(i, (channel, weight))| (channel.distances(&queries[i], &database[i]), *weight))
            .collect();
        let labels: Vec<Label> = (0..5).map(|instance| Label { category: 0, instance }).collect();
        let found = recognise_from(3, &distances, &labels).unwrap();
        let (mut sums, weight) = (Vec::new(), parameters.shape_weight());
        for (query, found) in found.iter().enumerate() {
            crate::distance::set_distances(&distances, query, &mut sums);
            for (cloud, sum) in sums.iter().enumerate() {
                let [a, b] = [(&queries, query), (&database, cloud)]
                    .map(|(side, cloud)| [one(&side[0], cloud), one(&side[1], cloud)]);
                assert_eq!(sum.to_bits(), set_distance(&a, &b, weight).to_bits());
            }
            let nearest = found.nearest;
            assert_eq!(nearest.distance.to_bits(), sums[nearest.index as usize].to_bits());
        }
    }
}

#[test]
fn descriptors_that_differ_in_one_gene_share_the_other_channel() {
    let channels = |change: fn(&mut Parameters)| {
        let mut parameters = Parameters::PAPER_BEST;
        change(&mut parameters);
        let [shape, colour] = <[_; 2]>::try_from(Descriptor::DiskRing(parameters).channels()).unwrap();
        [shape.0, colour.0]
    };
    let [shape, colour] = channels(|_| {});
    assert_eq!(channels(|it| it.shape_weight_ppm = 0), [shape.clone(), colour.clone()]);
    let [other, same] = channels(|it| it.shape_bins = 20);
    assert!(other != shape && same == colour && other.to_bytes() != shape.to_bytes());
    let [same, other] = channels(|it| it.colour_bins = 3);
    assert!(same == shape && other != colour && other.to_bytes() != colour.to_bytes());
    let [a, b] = channels(|it| it.ring_um = 40_000);
    assert!(a != shape && b != colour && shape.to_bytes() != colour.to_bytes());
}

#[test]
fn a_channel_of_another_family_has_no_signatures_of_prepared_clouds() {
    let spaces = spaces();
    for space in &spaces {
        let preparer = space.preparer().unwrap();
        let lowest = space.decode(&vec![0; space.genes().len()]).unwrap();
        assert!(lowest.channels().iter().all(|(channel, _)| channel.extractor(&preparer).is_ok()));
        let is_fixed = |family| matches!(family, Family::PfhRgb | Family::ShotColor);
        for other in spaces.iter().filter(|other| other.family() != space.family()) {
            if is_fixed(other.family()) && is_fixed(space.family()) {
                continue; // both are computed from points with normals
            }
            let foreign = other.decode(&vec![0; other.genes().len()]).unwrap();
            let refused = foreign.channels()[0].0.extractor(&preparer).unwrap_err();
            assert!(matches!(refused, ChannelError::Family { .. }), "{refused}");
        }
    }
    let preparer =
        SearchSpace::single(&Descriptor::DiskRing(Parameters::PAPER_BEST)).unwrap().preparer().unwrap();
    let other = Parameters { shape_bins: 20, ..Parameters::PAPER_BEST };
    let [(shape, _), (colour, _)] = <[_; 2]>::try_from(Descriptor::DiskRing(other).channels()).unwrap();
    assert!(matches!(shape.extractor(&preparer), Err(ChannelError::Quantise(_))));
    assert!(colour.extractor(&preparer).is_ok());
}

#[test]
fn global_hue_is_compared_by_its_only_histogram() {
    let descriptor = Descriptor::GlobalHue(GlobalHue::new(12).unwrap());
    let [signatures] = <[Signatures; 1]>::try_from(describe(&descriptor, 0..4)).unwrap();
    assert_eq!((signatures.clouds(), signatures.bins(), signatures.keypoints()), (4, 12, None));
    let matrix = descriptor.channels()[0].0.distances(&signatures, &signatures);
    for a in 0..4 {
        for b in 0..4 {
            let pairs = signatures.get(a)[0].iter().zip(signatures.get(b)[0]);
            let terms = pairs.filter(|(x, y)| *x + *y > 0.0).map(|(&x, &y)| {
                let (x, y) = (f64::from(x), f64::from(y));
                (x - y) * (x - y) / (2.0 * (x + y))
            });
            let expected: f64 = terms.sum();
            assert!((f64::from(matrix.row(a)[b]) - expected).abs() <= 1e-6, "{a} {b}");
        }
    }
}

#[test]
fn costs_are_in_proportion_to_clouds_and_pairs() {
    for space in spaces() {
        let descriptor = space.decode(&vec![0; space.genes().len()]).unwrap();
        let [cloud, pairs] = [descriptor.cost(1, 0), descriptor.cost(0, 3000)];
        assert!(cloud > 0 && pairs > 0, "{descriptor}");
        assert_eq!(descriptor.cost(1000, 0), 1000 * cloud);
        assert_eq!(descriptor.cost(0, 3_000_000), 1000 * pairs);
        assert_eq!(descriptor.cost(7, 6000), 7 * cloud + 2 * pairs);
        assert_eq!(descriptor.cost(u64::MAX, u64::MAX), u64::MAX);
    }
    // One cloud takes about as long as a thousand pairs of clouds.
    let paper = Descriptor::DiskRing(Parameters::PAPER_BEST);
    let ratio = paper.cost(1000, 0) as f64 / paper.cost(0, 1000) as f64;
    assert!((800.0..1250.0).contains(&ratio), "{ratio}");
    let cost = |kind| Descriptor::Fixed(FixedDescriptor { kind, radius_um: 50_000 }).cost(1, 0);
    let hue = Descriptor::GlobalHue(GlobalHue::new(16).unwrap()).cost(1, 0);
    let all = [hue, paper.cost(1, 0), cost(FixedKind::ShotColor), cost(FixedKind::PfhRgb)];
    assert!(all.is_sorted_by(|a, b| 2 * a < *b), "{all:?}");
}

#[test]
fn search_spaces_are_made_of_what_an_experiment_says() {
    let defaults =
        |family: Family| family.genes().iter().map(crate::GeneSpec::default_domain).collect::<Vec<_>>();
    for family in Family::ALL {
        let space = SearchSpace::new(family, true, &defaults(family));
        match family.fixed_kind() {
            _ if family == Family::Structure => {
                assert_eq!(space, Err(GeneError::NoGenes { family: family.name() }));
                let all = SearchSpace::Structures(StructureSpace::default());
                // Its weights are round numbers, which no genome has; its channels are searched.
                for alone in Descriptor::default_of(family).scaled_channels() {
                    assert!(all.contains(&alone.unwrap()));
                }
            }
            Some(_) => assert_eq!(space, Err(GeneError::NoGenes { family: family.name() })),
            None => {
                let space = space.unwrap();
                assert_eq!(space.family(), family);
                assert!(space.contains(&Descriptor::default_of(family)));
                let domains: Vec<Domain> = space.genes().into_iter().map(|(_, domain)| domain).collect();
                assert_eq!(domains, defaults(family));
                assert!(matches!(SearchSpace::new(family, true, &[]), Err(GeneError::Number { .. })));
            }
        }
        assert_eq!(SearchSpace::single(&Descriptor::default_of(family)).unwrap().family(), family);
    }
    let paper = defaults(Family::DiskRing);
    assert_eq!(
        SearchSpace::new(Family::DiskRing, true, &paper),
        Ok(SearchSpace::DiskRing(GeneTable::paper()))
    );
    let grey = SearchSpace::new(Family::GlobalHue, false, &defaults(Family::GlobalHue));
    assert_eq!(grey, Err(GeneError::NeedsColour { family: "global-hue" }));
    let bins = |low, step, count| SearchSpace::new(Family::GlobalHue, true, &[Domain { low, step, count }]);
    for (low, step, count) in [(1, 1, 3), (2, 1, 64), (2, u32::MAX, u32::MAX), (5, 1, 0), (5, 0, 2)] {
        assert!(bins(low, step, count).is_err(), "{low} {step} {count}");
    }
    assert_eq!(bins(16, 1, 1).unwrap().only(), Some(Descriptor::GlobalHue(GlobalHue::new(16).unwrap())));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    /// Two ways from a cloud to its signatures, one for each use: they must not drift apart. Alone, a cloud gets normals
    /// only if the descriptor looks at them.
    #[test]
    fn a_cloud_alone_is_described_as_among_prepared_ones(
        (_, _, descriptor) in descriptors(),
        seed in 0u64..50,
        leaf_um in prop::sample::select(vec![15_000, 20_000, 25_000]),
        normal_radius_um in prop::sample::select(vec![10_000, 14_000]),
    ) {
        let preprocess = Preprocess { leaf_um, normal_radius_um, ..Preprocess::default() };
        let expected = describe_by(&preprocess, &descriptor, seed..seed + 1);
        let expected: Vec<Signature> = expected.iter().map(|channel| one(channel, 0)).collect();
        let describer = Describer::new(&descriptor).unwrap();
        let cloud = sheet(seed, 300);
        let keypoints = crate::prepare::keypoints(&cloud, &preprocess).unwrap();
        let all = crate::prepare::Normals::new(&cloud, &keypoints, &preprocess).unwrap();
        let needed = describer.normals(&cloud, &keypoints, &preprocess).unwrap();
        for normals in [&all, &needed] {
            let described = describer.describe(&cloud, &keypoints, normals, &preprocess).unwrap();
            prop_assert_eq!(&described.signatures, &expected);
            prop_assert!(described.keypoints > 0);
        }
        let are_needed = match &descriptor {
            Descriptor::GlobalHue(_) => false,
            Descriptor::Structure(structure) => structure.channels.iter().any(|one| one.channel.needs_normals()),
            _ => true,
        };
        prop_assert_eq!(needed.cloud.iter().any(Option::is_some), are_needed);
    }
}
