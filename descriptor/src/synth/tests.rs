//! The generator against its definitions: geometry without noise, bounds of the noise, splits, and difficulty.

use std::collections::{BTreeMap, BTreeSet};

use expect_test::expect;
use proptest::prelude::*;
use rand::RngExt;
use rayon::prelude::*;

use super::camera::{CENTRE, FOCAL};
use super::shape::{HIT, Vec3, along, dot, unit};
use super::*;
use crate::testing::of_bits;
use crate::{
    Correct, GeneTable, Label, Parameters, Preprocess, QuantisedCloud, Quantiser, Signatures, random,
    recognise,
};

const IDEAL: Sensor =
    Sensor { disparity_noise: 0.0, disparity_step: 0.0, missing: 0.0, grazing: 0.0, colour_noise: 0.0 };

fn settings(objects: u32, views: u32, seed: u64) -> SynthSettings {
    SynthSettings::new(objects, views, seed).unwrap()
}

/// One object of each category.
fn one_of_each() -> (SynthSettings, Vec<SynthObject>) {
    let settings = settings(18, 24, 7);
    let mut objects = catalogue(&settings);
    objects.truncate(6);
    (settings, objects)
}

fn shoot(scene: &Scene<'_>) -> Cloud {
    scene.shoot(&mut Draw::new(1, "test", &[]))
}

fn object_frame(scene: &Scene<'_>, cloud: &Cloud) -> Vec<Vec3> {
    cloud.points.iter().map(|p| scene.pose.to_object(p.map(f64::from))).collect()
}

fn pixel(point: &[f32; 3]) -> [f64; 2] {
    let [x, y, z] = point.map(f64::from);
    [CENTRE[0] + FOCAL * x / z, CENTRE[1] + FOCAL * y / z]
}

fn digest(clouds: &[Cloud]) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new();
    for cloud in clouds {
        hasher.update(&(cloud.len() as u64).to_le_bytes());
        for coordinate in cloud.points.iter().flatten() {
            hasher.update(&coordinate.to_bits().to_le_bytes());
        }
        hasher.update(cloud.colours.as_ref().unwrap().as_flattened());
    }
    hasher.finalize()
}

fn all_clouds(settings: &SynthSettings) -> Vec<Cloud> {
    let objects = catalogue(settings);
    let render = |object| (0..settings.views()).map(move |view| render(settings, object, view));
    objects.par_iter().flat_map_iter(render).collect()
}

#[test]
fn every_bit_is_what_version_1_gives() {
    assert_eq!(GENERATOR_VERSION, 1, "with a new version, bless the digests below");
    let all_categories = settings(18, 4, 1);
    expect!["e141a77312d5a051fabfba925476701ec031c9726ea1b692b8f29602fe5c3c72"]
        .assert_eq(&digest(&all_clouds(&all_categories)).to_string());
    let splits = splits(&settings(6, 4, 1));
    expect![[r#"
        mug/mug_1/mug_1_1_2.pcd
        can/can_1/can_1_4_1.pcd
        mug/mug_2/mug_2_1_1.pcd
        can/can_2/can_2_1_2.pcd
        mug/mug_3/mug_3_4_1.pcd
        can/can_3/can_3_4_1.pcd"#]]
    .assert_eq(&splits.train1.join("\n"));
}

#[test]
fn a_seed_decides_everything_and_threads_nothing() {
    let small = settings(6, 4, 1);
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        digest(&pool.install(|| all_clouds(&small)))
    };
    assert_eq!(on(1), on(3));
    assert_ne!(on(1), digest(&all_clouds(&settings(6, 4, 2))));
    let objects = catalogue(&small);
    assert_ne!(render(&small, &objects[0], 0).points, render(&small, &objects[0], 1).points);
    assert_ne!(splits(&settings(6, 20, 1)), splits(&settings(6, 20, 2)));
}

#[test]
fn clouds_are_finite_in_range_and_of_useful_size() {
    let demo = SynthSettings::default();
    for object in catalogue(&demo) {
        for view in [0, 7, 14] {
            let cloud = render(&demo, &object, view);
            assert_eq!(cloud.colours.as_ref().unwrap().len(), cloud.len());
            assert!((200..6000).contains(&cloud.len()), "{}: {} points", object.path(view), cloud.len());
            for &[x, y, z] in &cloud.points {
                assert!(x.abs() < 0.25 && y.abs() < 0.25 && (0.7..1.2).contains(&z), "{x} {y} {z}");
            }
        }
    }
}

#[test]
fn points_without_noise_lie_on_the_surface() {
    let (settings, objects) = one_of_each();
    for object in &objects {
        let scene = Scene { sensor: IDEAL, occluder: None, ..scene(&settings, object, 3) };
        let cloud = shoot(&scene);
        assert!(cloud.len() > 300);
        for p in object_frame(&scene, &cloud) {
            // A float at one metre is exact to a tenth of a micrometre.
            assert!(object.shape.distance(p).abs() < HIT + 1e-6, "{}: {p:?}", object.category);
            // Nothing stands between the point and the camera.
            let to_camera = unit(along(scene.pose.position, -1.0, p));
            let normal = object.shape.normal(p);
            assert!(dot(normal, to_camera) > -0.05, "{}: seen from behind", object.category);
        }
    }
}

#[test]
fn points_without_noise_satisfy_the_textbook_surfaces() {
    let (settings, objects) = one_of_each();
    let shapes = [
        Shape::Sphere { radius: 0.04 },
        Shape::Revolution(Profile::cone(0.03, 0.03, 0.1)),
        Shape::Revolution(Profile::cone(0.04, 0.01, 0.1)),
        Shape::Box { half: [0.03, 0.02, 0.05], edge: 0.0 },
    ];
    for (kind, shape) in shapes.iter().enumerate() {
        let scene = Scene { shape, sensor: IDEAL, occluder: None, ..scene(&settings, &objects[0], 5) };
        let cloud = shoot(&scene);
        assert!(cloud.len() > 300);
        for [x, y, z] in object_frame(&scene, &cloud) {
            let axial = (x * x + y * y).sqrt();
            let cap = (z.abs() - 0.05).abs();
            let error = match kind {
                0 => ((x * x + y * y + z * z).sqrt() - 0.04).abs(),
                1 => (axial - 0.03).abs().min(cap),
                // From 4 cm below to 1 cm above, along 10 cm.
                2 => (axial - (0.025 - 0.3 * z)).abs().min(cap),
                _ => (x.abs() - 0.03).abs().min((y.abs() - 0.02).abs()).min(cap),
            };
            assert!(error < 2.0 * HIT, "shape {kind}: off by {error}");
        }
    }
}

/// Points all over a surface: the profile's outline turned about the axis, and the handle's ring.
fn samples(shape: &Shape) -> Vec<Vec3> {
    let turned = |radius: f64, z: f64, step: u32| {
        let angle = f64::from(step) * std::f64::consts::TAU / 96.0;
        [radius * libm::cos(angle), radius * libm::sin(angle), z]
    };
    let outline = |profile: &Profile| -> Vec<Vec3> {
        let edges = profile.vertices().windows(2);
        edges
            .flat_map(|edge| (0..=20).map(|k| f64::from(k) / 20.0).map(|t| along2(edge[0], edge[1], t)))
            .flat_map(|[radius, z]| (0..96).map(move |step| turned(radius, z, step)))
            .collect()
    };
    match shape {
        Shape::Revolution(profile) => outline(profile),
        Shape::Mug { cup, reach, ring, grip } => {
            let mut points = outline(cup);
            for around in 0..96 {
                for across in 0..96 {
                    let [out, y, _] = turned(*grip, 0.0, across);
                    let [x, z, _] = turned(ring + out, 0.0, around);
                    if x > 0.0 {
                        points.push([reach + x, y, z]);
                    }
                }
            }
            points
        }
        _ => unreachable!("only shapes with a profile"),
    }
}

fn along2(a: [f64; 2], b: [f64; 2], t: f64) -> [f64; 2] {
    [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]
}

#[test]
fn distances_agree_with_a_dense_sample_of_the_surface() {
    let (_, objects) = one_of_each();
    for object in objects.iter().filter(|o| matches!(o.shape, Shape::Revolution(_) | Shape::Mug { .. })) {
        let surface = samples(&object.shape);
        // The handle's ends lie inside the wall; everything else is where the distance is 0.
        assert!(surface.iter().all(|&p| object.shape.distance(p) < 1e-9));
        let mut draw = Draw::new(5, "test", &[]);
        for _ in 0..60 {
            let p: Vec3 = std::array::from_fn(|_| draw.between(-0.12, 0.12));
            let distance = object.shape.distance(p);
            let off = surface.iter().map(|&s| along(p, -1.0, s)).map(|d| dot(d, d)).fold(f64::MAX, f64::min);
            if distance > 0.0 {
                assert!(distance <= off.sqrt() + 1e-9, "{}: a ray could jump through", object.category);
                // Samples are up to 5 mm apart; the cut at the handle's ends makes the bound loose there.
                assert!(off.sqrt() - distance < 0.005, "{}: {distance} for {off}", object.category);
            }
            assert!(dot(p, p).sqrt() <= object.shape.bound() || distance > 0.0);
        }
    }
}

#[test]
fn points_project_to_their_pixels() {
    let (settings, objects) = one_of_each();
    for object in &objects {
        let cloud = render(&settings, object, 2);
        let mut seen = BTreeSet::new();
        for [u, v] in cloud.points.iter().map(pixel) {
            assert!((u - u.round()).abs() < 1e-3 && (v - v.round()).abs() < 1e-3, "{u} {v}");
            assert!(seen.insert((v.round() as i64, u.round() as i64)), "two points in one pixel");
        }
    }
}

#[test]
fn the_camera_looks_at_the_object_from_its_videos_height() {
    let (settings, objects) = one_of_each();
    for view in 0..settings.views() {
        let pose = scene(&settings, &objects[0], view).pose;
        for (a, b) in [(pose.right, pose.down), (pose.down, pose.forward), (pose.forward, pose.right)] {
            assert!(dot(a, b).abs() < 1e-12 && (dot(a, a) - 1.0).abs() < 1e-12);
        }
        assert!(pose.down[2] < 0.0, "the picture is upside down");
        let [x, y, z] = pose.to_camera([0.0; 3]);
        assert!(x.abs() < 0.06 && y.abs() < 0.06 && z > 0.7);
        let sine = -pose.forward[2];
        let degrees = libm::asin(sine).to_degrees();
        assert!((degrees - place(view).1).abs() < 3.001, "view {view}: {degrees}");
        let p = [0.01, -0.02, 0.03];
        let back = along(pose.to_object(pose.to_camera(p)), -1.0, p);
        assert!(dot(back, back) < 1e-24);
    }
}

#[test]
fn depth_errors_stay_in_bounds_and_grow_with_the_square_of_depth() {
    let deviation = |z: f64| {
        let mut draw = Draw::new(3, "test", &[]);
        let sensor = Sensor { disparity_step: 0.0, ..Sensor::KINECT };
        let errors: Vec<f64> = (0..4000).map(|_| sensor.depth(z, &mut draw) - z).collect();
        (errors.iter().map(|e| e * e).sum::<f64>() / 4000.0).sqrt()
    };
    assert!((0.001..0.002).contains(&deviation(1.0)), "{}", deviation(1.0));
    assert!((deviation(1.4) / deviation(0.7) - 4.0).abs() < 0.1);

    let (settings, objects) = one_of_each();
    let mut largest: f64 = 0.0;
    for object in &objects {
        let scene = scene(&settings, object, 4);
        for point in &shoot(&scene).points {
            let ray = point.map(f64::from).map(|c| c / f64::from(point[2]));
            let length = dot(ray, ray).sqrt();
            let direction = unit(along(scene.pose.to_object(ray), -1.0, scene.pose.position));
            // The rounded point's ray may just miss the silhouette.
            let Some(s) = object.shape.trace(scene.pose.position, direction) else { continue };
            let error = (f64::from(point[2]) - s / length).abs();
            assert!(error < Sensor::KINECT.depth_bound(s / length) + 0.001, "{error}");
            largest = largest.max(error);
        }
    }
    assert!(largest > 0.002, "there is no noise");
}

#[test]
fn disparities_lie_on_the_sensors_steps() {
    let mut draw = Draw::new(4, "test", &[]);
    for z in [0.71, 0.83, 0.97, 1.1] {
        let steps = 0.075 * FOCAL / Sensor::KINECT.depth(z, &mut draw) * 8.0;
        assert!((steps - steps.round()).abs() < 1e-9);
    }
}

#[test]
fn occlusion_removes_exactly_what_is_behind() {
    let (settings, objects) = one_of_each();
    let mut present = 0;
    for (object, view) in
        objects.iter().flat_map(|object| (0..settings.views()).map(move |view| (object, view)))
    {
        let with = scene(&settings, object, view);
        let Some(occluder) = with.occluder else { continue };
        present += 1;
        if view > 8 {
            continue;
        }
        let left = shoot(&with);
        let all = shoot(&Scene { occluder: None, ..with });
        let hidden = |point: &&[f32; 3]| {
            let [u, v] = pixel(point);
            let off = [u - occluder.middle[0], v - occluder.middle[1]];
            (off[0] * off[0] + off[1] * off[1]).sqrt() < occluder.radius
        };
        let kept: Vec<[f32; 3]> = all.points.iter().filter(|p| !hidden(p)).copied().collect();
        assert_eq!(kept, left.points);
        assert!(left.len() > 100, "{}: {} of {}", object.path(view), left.len(), all.len());
    }
    // 144 views at 35 %: six deviations on either side.
    assert!((16..85).contains(&present), "{present}");
}

#[test]
fn light_changes_colours_and_no_geometry() {
    let (settings, objects) = one_of_each();
    let object = &objects[1];
    let dim = Light { towards: [0.0, 0.0, 1.0], ambient: [0.3; 3], lamp: [0.2; 3] };
    let bright = Light { towards: dim.towards, ambient: [0.6; 3], lamp: [0.4; 3] };
    let side = Light { towards: [1.0, 0.0, 0.0], ..dim.clone() };
    let [dim, bright, side] = [dim, bright, side].map(|light| {
        let quiet = Sensor { colour_noise: 0.0, ..Sensor::KINECT };
        shoot(&Scene { light, sensor: quiet, ..scene(&settings, object, 0) })
    });
    assert_eq!(dim.points, bright.points);
    assert_eq!(dim.points, side.points);
    assert_ne!(dim.colours, side.colours);
    // Twice the light, twice the value, up to rounding.
    for (dim, bright) in dim.colours.unwrap().iter().zip(bright.colours.unwrap()) {
        assert!(
            (0..3).all(|c| (2 * i32::from(dim[c]) - i32::from(bright[c])).abs() <= 1),
            "{dim:?} {bright:?}"
        );
    }
    assert_ne!(scene(&settings, object, 0).light, scene(&settings, object, 1).light);
}

#[test]
fn pixels_go_missing_at_random_and_at_grazing_angles() {
    let (settings, objects) = one_of_each();
    let base = || Scene { occluder: None, ..scene(&settings, &objects[5], 0) };
    let count = |missing, grazing| {
        shoot(&Scene { sensor: Sensor { missing, grazing, ..Sensor::KINECT }, ..base() }).len() as f64
    };
    let all = count(0.0, 0.0);
    let half = count(0.5, 0.0) / all;
    assert!((0.4..0.6).contains(&half), "{half}");
    // Of a ball's disk, a cosine above c leaves the share 1 − c², seen from far away.
    let share = count(0.0, 0.6) / all;
    assert!((share - 0.64).abs() < 0.03, "{share}");
}

#[test]
fn look_alikes_share_their_category_and_pattern_and_differ_a_little() {
    let objects = catalogue(&settings(20, 4, 3));
    let mut categories: BTreeMap<&str, Vec<&SynthObject>> = BTreeMap::new();
    for object in &objects {
        categories.entry(object.category).or_default().push(object);
    }
    assert_eq!(categories.len(), 6);
    let names: BTreeSet<_> = objects.iter().map(|object| &object.instance).collect();
    assert_eq!(names.len(), 20);
    for alike in categories.values() {
        assert!(alike.len() >= 3);
        let kind = |object: &SynthObject| {
            (std::mem::discriminant(&object.shape), std::mem::discriminant(&object.texture.pattern))
        };
        for (a, b) in alike.iter().flat_map(|a| alike.iter().map(move |b| (a, b))) {
            assert_eq!(kind(a), kind(b));
            if a.instance != b.instance {
                assert_ne!(a.shape, b.shape);
                assert_ne!(a.texture.ground.hue, b.texture.ground.hue);
            }
            let ratio = a.shape.half_height() / b.shape.half_height();
            assert!((ratio - 1.0).abs() < 0.08, "{ratio}");
            assert!((a.texture.ground.hue - b.texture.ground.hue).abs() < 12.0);
        }
    }
}

#[test]
fn paths_are_named_as_in_the_uw_data_set() {
    let objects = catalogue(&settings(6, 7, 1));
    let paths: Vec<String> = (0..7).map(|view| objects[2].path(view)).collect();
    expect![[r#"
        mug/mug_2/mug_2_1_1.pcd
        mug/mug_2/mug_2_2_1.pcd
        mug/mug_2/mug_2_4_1.pcd
        mug/mug_2/mug_2_1_2.pcd
        mug/mug_2/mug_2_2_2.pcd
        mug/mug_2/mug_2_4_2.pcd
        mug/mug_2/mug_2_1_3.pcd"#]]
    .assert_eq(&paths.join("\n"));
}

#[test]
fn settings_out_of_limits_are_refused() {
    expect!["objects: number outside 2 to 1000, got 1\nchoose a number inside these limits"]
        .assert_eq(&SynthSettings::new(1, 24, 1).unwrap_err().to_string());
    expect!["views: number outside 4 to 1000, got 1001\nchoose a number inside these limits"]
        .assert_eq(&SynthSettings::new(2, 1001, 1).unwrap_err().to_string());
    let default = SynthSettings::default();
    assert_eq!(SynthSettings::new(default.objects(), default.views(), default.seed()), Ok(default));
}

#[test]
fn hexcone_corners() {
    let rgb = |hue, saturation, value| Hsv { hue, saturation, value }.rgb();
    assert_eq!(rgb(0.0, 1.0, 1.0), [1.0, 0.0, 0.0]);
    assert_eq!(rgb(60.0, 1.0, 1.0), [1.0, 1.0, 0.0]);
    assert_eq!(rgb(-240.0, 1.0, 0.5), [0.0, 0.5, 0.0]);
    assert_eq!(rgb(600.0, 0.5, 1.0), [0.5, 0.5, 1.0]);
    assert_eq!(rgb(77.0, 0.0, 0.25), [0.25; 3]);
}

/// Errors, in percent, of a descriptor over the training sets and of the final test.
fn errors(settings: &SynthSettings, chromosomes: &[Parameters]) -> Vec<[f64; 2]> {
    let quantiser = Quantiser::new(&GeneTable::paper()).unwrap();
    let splits = splits(settings);
    let objects = catalogue(settings);
    let categories: Vec<&str> =
        objects.iter().map(|object| object.category).collect::<BTreeSet<_>>().into_iter().collect();
    let mut views = BTreeMap::new();
    for object in &objects {
        let category = categories.binary_search(&object.category).unwrap() as u32;
        let label = Label { category, instance: object.index };
        views.extend((0..settings.views()).map(|view| (object.path(view), (object, view, label))));
    }
    let load = |list: &[String]| -> (Vec<QuantisedCloud>, Vec<Label>) {
        list.par_iter()
            .map(|path| {
                let (object, view, label) = views[path];
                let cloud = render(settings, object, view);
                (QuantisedCloud::new(&cloud, &Preprocess::default(), &quantiser).unwrap(), label)
            })
            .unzip()
    };
    let database = [splits.train2, splits.train1, splits.validation].map(|list| load(&list));
    let test = load(&splits.test);
    chromosomes
        .iter()
        .map(|parameters| {
            let binning = quantiser.binning(parameters).unwrap();
            let [train2, train1, validation] =
                database.each_ref().map(|(clouds, _)| binning.signatures(clouds));
            let weights = [parameters.shape_weight(), 1.0 - parameters.shape_weight()];
            let error =
                |queries: &[Signatures], labels: &[Label], database: &[Signatures], names: &[Label]| {
                    let found = recognise(queries, database, &weights, names).unwrap();
                    let correct = Correct::count(&found, labels, names);
                    100.0 * (1.0 - correct.object as f64 / correct.queries as f64)
                };
            let training = error(&train1, &database[1].1, &train2, &database[0].1);
            let mut all = train2;
            for more in [train1, validation] {
                all.iter_mut().zip(&more).for_each(|(all, more)| all.append(more));
            }
            let names = [&database[0].1[..], &database[1].1, &database[2].1].concat();
            [training, error(&binning.signatures(&test.0), &test.1, &all, &names)]
        })
        .collect()
}

#[test]
fn the_demo_is_neither_easy_nor_hopeless_and_its_descriptors_differ() {
    let mut rng = random::stream(1, "test", &[]);
    let mut chromosomes = vec![Parameters::PAPER_BEST];
    for _ in 0..8 {
        let bits: Vec<bool> = (0..25).map(|_| rng.random::<u32>() & 1 == 1).collect();
        chromosomes.push(of_bits(&bits));
    }
    let errors = errors(&SynthSettings::default(), &chromosomes);
    let [training, test] = errors[0];
    assert!((10.0..=40.0).contains(&training) && (10.0..=40.0).contains(&test), "{training} {test}");
    let low = errors.iter().fold(f64::INFINITY, |low, error| low.min(error[0]));
    let high = errors.iter().fold(0.0, |high: f64, error| high.max(error[0]));
    assert!(high - low > 10.0, "evolution has nothing to gain: {low} to {high}");
}

proptest! {
    #[test]
    fn splits_hold_every_view_once_and_each_object_in_every_list(objects in 2u32..30, views in 4u32..40, seed: u64) {
        let settings = settings(objects, views, seed);
        let objects = catalogue(&settings);
        let splits = splits(&settings);
        let lists = [&splits.train1, &splits.train2, &splits.validation, &splits.test];
        let all: Vec<String> = objects.iter().flat_map(|o| (0..views).map(|view| o.path(view))).collect();
        let placed: BTreeSet<&String> = lists.iter().copied().flatten().collect();
        prop_assert_eq!(&placed, &all.iter().collect());
        prop_assert_eq!(lists.iter().map(|list| list.len()).sum::<usize>(), all.len());
        for object in &objects {
            let folder = format!("{}/{}/", object.category, object.instance);
            let of_object = |list: &&Vec<String>| list.iter().filter(|path| path.starts_with(&folder)).count();
            let [train1, train2, validation, test] = lists.each_ref().map(of_object);
            prop_assert!(train1 >= train2 && train1 <= train2 + 1 && train2 >= validation.min(train2));
            prop_assert!(train2 > 0 && validation > 0 && test > 0);
        }
        let is_test = |path: &&String| path.rsplit('_').nth(1) == Some("2");
        prop_assert!(splits.test.iter().all(|path| is_test(&path)));
        prop_assert!(!placed.iter().any(|path| is_test(path) && !splits.test.contains(path)));
    }

    #[test]
    fn hexcone_extremes_are_value_and_value_times_what_is_left(
        hue in -720.0..720.0f64, saturation in 0.0..1.0f64, value in 0.0..1.0f64
    ) {
        let rgb = Hsv { hue, saturation, value }.rgb();
        let high = rgb[0].max(rgb[1]).max(rgb[2]);
        let low = rgb[0].min(rgb[1]).min(rgb[2]);
        prop_assert!((high - value).abs() < 1e-12);
        prop_assert!((low - value * (1.0 - saturation)).abs() < 1e-12);
    }
}
