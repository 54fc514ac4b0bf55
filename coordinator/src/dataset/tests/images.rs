//! Clouds in images: what belongs together, labels, and the message of each set of files that is no cloud.

use std::fs;

use descriptor::rgbd::{self, Images};
use descriptor::{Preprocess, cloud_file};
use expect_test::{Expect, expect};
use png::{BitDepth, ColorType, Encoder};

use super::super::{Dataset, DatasetSettings, Layout, SeededSplit, SplitRule, Wanted, cloud_bytes};
use super::Fixture;

/// Images of 20 by 20 pixels of one colour, half a metre away.
fn png(colour: ColorType, bits: BitDepth, pixel: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, 20, 20);
    encoder.set_color(colour);
    encoder.set_depth(bits);
    encoder.write_header().unwrap().write_image_data(&pixel.repeat(400)).unwrap();
    bytes
}

fn colour(tone: u8) -> Vec<u8> {
    png(ColorType::Rgb, BitDepth::Eight, &[tone, 128, 9])
}

fn depth(units: u16) -> Vec<u8> {
    png(ColorType::Grayscale, BitDepth::Sixteen, &units.to_be_bytes())
}

fn mask() -> Vec<u8> {
    png(ColorType::Grayscale, BitDepth::Eight, &[255])
}

/// A cloud as the RGB-D Object Dataset has it.
fn write_crop(fixture: &Fixture, stem: &str, tone: u8) {
    fixture.write(&format!("{stem}_crop.png"), colour(tone));
    fixture.write(&format!("{stem}_depthcrop.png"), depth(500));
    fixture.write(&format!("{stem}_maskcrop.png"), mask());
    fixture.write(&format!("{stem}_loc.txt"), "311, 231\n");
}

/// A scene of BOP with two objects in each of four images.
fn write_scene(fixture: &Fixture, scene: &str, tone: u8) {
    let mut cameras = Vec::new();
    let mut objects = Vec::new();
    for image in 7..11 {
        fixture.write(&format!("{scene}/rgb/{image:06}.png"), colour(tone + image));
        fixture.write(&format!("{scene}/depth/{image:06}.png"), depth(5000));
        for object in 0..2 {
            fixture.write(&format!("{scene}/mask_visib/{image:06}_{object:06}.png"), mask());
        }
        let matrix = "[400.0, 0.0, 10.0, 0.0, 200.0, 12.5, 0.0, 0.0, 1.0]";
        cameras
            .push(format!("\"{image}\": {{\"cam_K\": {matrix}, \"depth_scale\": 0.1, \"view_level\": 2}}"));
        objects
            .push(format!("\"{image}\": [{{\"obj_id\": 12, \"cam_t_m2c\": [0, 0, 1]}}, {{\"obj_id\": 3}}]"));
    }
    fixture.write(&format!("{scene}/scene_camera.json"), format!("{{{}}}", cameras.join(", ")));
    fixture.write(&format!("{scene}/scene_gt.json"), format!("{{{}}}", objects.join(", ")));
}

fn settings(fixture: &Fixture, layout: Layout) -> DatasetSettings {
    let rule = SeededSplit { seed: 1, shares: [0.25; 4], stratified: true, test_sequences: Vec::new() };
    DatasetSettings { splits: SplitRule::Seeded(rule), layout, ..fixture.settings() }
}

fn load(fixture: &Fixture, layout: Layout) -> Dataset {
    Dataset::load(&settings(fixture, layout), &Preprocess::default(), Wanted::All, None).unwrap()
}

#[test]
fn a_crop_has_the_camera_of_its_data_set_and_the_digest_of_all_its_images() {
    let mut fixture = Fixture::empty();
    for frame in 1..=8 {
        write_crop(&fixture, &format!("cup/cup_1/cup_1_2_{frame}"), frame);
    }
    fixture.cloud("cup/cup_1/cup_1_3_1.pcd");
    let dataset = load(&fixture, Layout::Uw);
    assert_eq!(
        (dataset.clouds.entries.len(), &*dataset.clouds.sequences),
        (9, &["2".to_owned(), "3".to_owned()][..])
    );
    let entry =
        dataset.clouds.entries.iter().find(|cloud| cloud.path.ends_with("cup_1_2_4_crop.png")).unwrap();
    let bytes = cloud_bytes(&dataset.clouds.file(entry)).unwrap();
    assert_eq!(entry.digest, *blake3::hash(&bytes).as_bytes());
    let cloud = cloud_file::read(&bytes).unwrap();
    assert_eq!(cloud.len(), 400);
    // The crop's first pixel is at column 311 and row 231 from 1; the axis at 320 and 240.
    let z = 500.0 * 0.001;
    let corner = [-9.0 * z / 570.3, -9.0 * z / 570.3, z].map(|coordinate| coordinate as f32);
    assert_eq!((cloud.points[0], cloud.colours.unwrap()[0]), (corner, [4, 128, 9]));
    assert_eq!(cloud.points[399][0], (10.0 * z / 570.3) as f32);
    // Each file counts.
    for other in ["cup_1_2_4_depthcrop.png", "cup_1_2_4_maskcrop.png", "cup_1_2_4_loc.txt"] {
        let file = fixture.root().join("cup/cup_1").join(other);
        let before = fs::read(&file).unwrap();
        let other = if other.ends_with("txt") { b"312,231\n".to_vec() } else { depth(501) };
        fs::write(&file, other).unwrap();
        assert_ne!(cloud_bytes(&dataset.clouds.file(entry)).unwrap(), bytes);
        fs::write(&file, before).unwrap();
    }
}

#[test]
fn a_scene_has_an_object_a_mask_and_is_a_sequence() {
    for (root, scenes) in [("", ["000001", "000048"]), ("test/", ["test/000001", "test/000048"])] {
        let fixture = Fixture::empty();
        write_scene(&fixture, &format!("{root}000001"), 10);
        write_scene(&fixture, &format!("{root}000048"), 40);
        fixture.write("models/obj_000003.ply", "");
        let dataset = load(&fixture, Layout::Bop);
        assert_eq!(dataset.clouds.entries.len(), 16);
        assert_eq!(dataset.clouds.sequences, scenes);
        assert_eq!(dataset.clouds.categories, ["obj_000003", "obj_000012"]);
        let path = format!("{}/mask_visib/000009_000001.png", scenes[1]);
        let entry = dataset.clouds.entries.iter().find(|cloud| cloud.path == path).unwrap();
        assert_eq!(dataset.clouds.instances[entry.instance as usize].name, "obj_000003");
        let bytes = cloud_bytes(&dataset.clouds.file(entry)).unwrap();
        let cloud = cloud_file::read(&bytes).unwrap();
        let z = 5000.0 * (0.1 * 0.001);
        let corner = [-10.0 * z / 400.0, -12.5 * z / 200.0, z].map(|coordinate| coordinate as f32);
        assert_eq!((cloud.points[0], cloud.colours.unwrap()[0]), (corner, [49, 128, 9]));
        assert_eq!(entry.digest, *blake3::hash(&bytes).as_bytes());
        let camera =
            rgbd::Camera { focal_length: [400.0, 200.0], centre: [10.0, 12.5], depth_unit: 0.1 * 0.001 };
        let images = Images { colour: &colour(49), depth: &depth(5000), mask: &mask() };
        assert_eq!(bytes, rgbd::write(&camera, images));
    }
}

/// Damages a good data set of either layout.
fn check(layout: Layout, damage: impl FnOnce(&Fixture), expected: Expect) {
    let fixture = Fixture::empty();
    for frame in 1..=4 {
        write_crop(&fixture, &format!("cup/cup_1/cup_1_2_{frame}"), frame);
    }
    write_scene(&fixture, "000001", 10);
    damage(&fixture);
    let error =
        Dataset::load(&settings(&fixture, layout), &Preprocess::default(), Wanted::All, None).unwrap_err();
    expected.assert_eq(&fixture.text(&error));
}

#[test]
fn crops_that_are_no_clouds() {
    let file = |fixture: &Fixture, ending: &str| {
        fixture.root().join("cup/cup_1/cup_1_2_3").to_str().unwrap().to_owned() + ending
    };
    check(
        Layout::Uw,
        |fixture| fs::remove_file(file(fixture, "_depthcrop.png")).unwrap(),
        expect![[r#"
        cup/cup_1/cup_1_2_3_crop.png: cloud file expected, got cup/cup_1/cup_1_2_3_crop.png (cup/cup_1/cup_1_2_3_depthcrop.png: No such file or directory (os error 2))
        correct the line, or put the cloud below dataset.root"#]],
    );
    check(
        Layout::Uw,
        |fixture| fs::write(file(fixture, "_loc.txt"), "3 4\n").unwrap(),
        expect![[r#"
        dataset: readable clouds expected, got 1 unreadable
        cup/cup_1/cup_1_2_3_crop.png: cup/cup_1/cup_1_2_3_loc.txt: column,row expected, got 3 4
        repair them, remove them from their lists, or set dataset.skip_unreadable = true to leave them out"#]],
    );
    check(
        Layout::Uw,
        |fixture| fs::write(file(fixture, "_loc.txt"), "0,4\n").unwrap(),
        expect![[r#"
        dataset: readable clouds expected, got 1 unreadable
        cup/cup_1/cup_1_2_3_crop.png: cup/cup_1/cup_1_2_3_loc.txt: numbers from 1 to 16777216 expected, got 0
        repair them, remove them from their lists, or set dataset.skip_unreadable = true to leave them out"#]],
    );
    check(
        Layout::Uw,
        |fixture| fs::write(file(fixture, "_maskcrop.png"), "no").unwrap(),
        expect![[r#"
        dataset: readable clouds expected, got 1 unreadable
        cup/cup_1/cup_1_2_3_crop.png: mask image: PNG expected, got: unexpected end of file
        repair them, remove them from their lists, or set dataset.skip_unreadable = true to leave them out"#]],
    );
    check(
        Layout::Uw,
        |fixture| fs::write(file(fixture, "_depthcrop.png"), mask()).unwrap(),
        expect![[r#"
            dataset: readable clouds expected, got 1 unreadable
            cup/cup_1/cup_1_2_3_crop.png: depth image: 16 bits of grey a pixel expected, got 8 bits of grey
            repair them, remove them from their lists, or set dataset.skip_unreadable = true to leave them out"#]],
    );
    check(
        Layout::Uw,
        |fixture| fixture.write("cup/cup_1/cup_1_2_3.pcd", "VERSION 0.7"),
        expect![[r#"
        cup/cup_1/cup_1_2_3.pcd: each cloud in one file expected, got cup/cup_1/cup_1_2_3_crop.png beside it
        move one of the two out of the data root"#]],
    );
}

#[cfg(unix)]
#[test]
fn an_image_of_a_crop_that_lies_elsewhere_is_not_read() {
    let elsewhere = tempfile::tempdir().unwrap();
    let target = elsewhere.path().join("depth.png");
    fs::write(&target, depth(500)).unwrap();
    check(
        Layout::Uw,
        |fixture| {
            let link = fixture.root().join("cup/cup_1/cup_1_2_3_depthcrop.png");
            fs::remove_file(&link).unwrap();
            std::os::unix::fs::symlink(&target, link).unwrap();
        },
        expect![[r#"
            cup/cup_1/cup_1_2_3_crop.png: path below the data root expected, got cup/cup_1/cup_1_2_3_crop.png (a symbolic link of an image beside it leads out)
            name clouds relative to dataset.root, and copy what lies outside into it"#]],
    );
}

#[test]
fn scenes_that_are_no_clouds() {
    let rewrite = |name: &'static str, from: &'static str, to: &'static str| {
        move |fixture: &Fixture| {
            let file = fixture.root().join("000001").join(name);
            fs::write(&file, fs::read_to_string(&file).unwrap().replacen(from, to, 1)).unwrap();
        }
    };
    check(
        Layout::Bop,
        rewrite("scene_gt.json", "obj_id", "object"),
        expect![[r#"
        000001/scene_gt.json: obj_id of each object of each image expected, got missing field `obj_id` at line 1 column 45
        copy the scene again, or move it out of the data root"#]],
    );
    check(
        Layout::Bop,
        rewrite("scene_camera.json", "depth_scale", "scale"),
        expect![[r#"
        dataset: readable clouds expected, got 8 unreadable
        000001/mask_visib/000007_000001.png: 000001/scene_camera.json: cam_K and depth_scale of each image expected, got: missing field `depth_scale` at line 1 column 99
        000001/mask_visib/000008_000000.png: 000001/scene_camera.json: cam_K and depth_scale of each image expected, got: missing field `depth_scale` at line 1 column 99
        000001/mask_visib/000007_000000.png: 000001/scene_camera.json: cam_K and depth_scale of each image expected, got: missing field `depth_scale` at line 1 column 99
        000001/mask_visib/000008_000001.png: 000001/scene_camera.json: cam_K and depth_scale of each image expected, got: missing field `depth_scale` at line 1 column 99
        000001/mask_visib/000009_000000.png: 000001/scene_camera.json: cam_K and depth_scale of each image expected, got: missing field `depth_scale` at line 1 column 99
        000001/mask_visib/000010_000001.png: 000001/scene_camera.json: cam_K and depth_scale of each image expected, got: missing field `depth_scale` at line 1 column 99
        000001/mask_visib/000009_000001.png: 000001/scene_camera.json: cam_K and depth_scale of each image expected, got: missing field `depth_scale` at line 1 column 99
        000001/mask_visib/000010_000000.png: 000001/scene_camera.json: cam_K and depth_scale of each image expected, got: missing field `depth_scale` at line 1 column 99
        repair them, remove them from their lists, or set dataset.skip_unreadable = true to leave them out"#]],
    );
    check(
        Layout::Bop,
        rewrite("scene_camera.json", "\"7\"", "\"77\""),
        expect![[r#"
        dataset: readable clouds expected, got 2 unreadable
        000001/mask_visib/000007_000001.png: 000001/scene_camera.json: image 7 expected, got 4 others
        000001/mask_visib/000007_000000.png: 000001/scene_camera.json: image 7 expected, got 4 others
        repair them, remove them from their lists, or set dataset.skip_unreadable = true to leave them out"#]],
    );
    check(
        Layout::Bop,
        rewrite("scene_camera.json", "400.0, 0.0", "400.0, 0.5"),
        expect![[r#"
        dataset: readable clouds expected, got 2 unreadable
        000001/mask_visib/000007_000001.png: 000001/scene_camera.json: cam_K of image 7 as fx, 0, cx, 0, fy, cy, 0, 0, 1 expected, got [400.0, 0.5, 10.0, 0.0, 200.0, 12.5, 0.0, 0.0, 1.0]
        000001/mask_visib/000007_000000.png: 000001/scene_camera.json: cam_K of image 7 as fx, 0, cx, 0, fy, cy, 0, 0, 1 expected, got [400.0, 0.5, 10.0, 0.0, 200.0, 12.5, 0.0, 0.0, 1.0]
        repair them, remove them from their lists, or set dataset.skip_unreadable = true to leave them out"#]],
    );
    check(
        Layout::Bop,
        rewrite("scene_camera.json", "400.0", "-400.0"),
        expect![[r#"
        dataset: readable clouds expected, got 2 unreadable
        000001/mask_visib/000007_000001.png: rgb-d camera: focal length: finite number greater than 0 expected, got -400
        000001/mask_visib/000007_000000.png: rgb-d camera: focal length: finite number greater than 0 expected, got -400
        repair them, remove them from their lists, or set dataset.skip_unreadable = true to leave them out"#]],
    );
    check(
        Layout::Bop,
        |fixture| fs::remove_dir_all(fixture.root().join("000001/rgb")).unwrap(),
        expect![[r#"
            000001/mask_visib/000007_000000.png: cloud file expected, got 000001/mask_visib/000007_000000.png (000001/rgb/000007.png: No such file or directory (os error 2))
            correct the line, or put the cloud below dataset.root"#]],
    );
    check(
        Layout::Bop,
        |fixture| fs::remove_file(fixture.root().join("000001/scene_gt.json")).unwrap(),
        expect![[r#"
            <root>: clouds at <scene>/mask_visib/<image>_<object>.png, of an object in scene_gt.json, expected, got 28 .png, 4 .txt, 1 .json
            clouds are read from PCD, PLY and RGB-D images: of images, those of layouts "uw" (_crop.png, _depthcrop.png, _maskcrop.png, _loc.txt) and "bop"; of others Open3D makes clouds with geometry.PointCloud.create_from_rgbd_image, and io.write_point_cloud writes them"#]],
    );
    let list = |path: &str| {
        let fixture = Fixture::empty();
        write_scene(&fixture, "000001", 10);
        fixture.write("000001/mask_visib/000007_000002.png", mask());
        for split in ["train1", "train2", "validation", "test"] {
            fixture.write(&format!("{split}.txt"), format!("{path}\n"));
        }
        let settings = DatasetSettings { layout: Layout::Bop, ..fixture.settings() };
        fixture.text(&Dataset::load(&settings, &Preprocess::default(), Wanted::All, None).unwrap_err())
    };
    // An object that scene_gt.json does not have, and an image that is no mask.
    expect![[r#"
        train1.txt, line 1: <scene>/mask_visib/<image>_<object>.png, of an object in scene_gt.json, expected, got 000001/mask_visib/000007_000002.png
        move the cloud, or set dataset.layout to what the folders are (a manifest can describe any)"#]].assert_eq(&list("000001/mask_visib/000007_000002.png"));
    expect![[r#"
        train1.txt, line 1: <scene>/mask_visib/<image>_<object>.png, of an object in scene_gt.json, expected, got 000001/rgb/000007.png
        move the cloud, or set dataset.layout to what the folders are (a manifest can describe any)"#]].assert_eq(&list("000001/rgb/000007.png"));
}
