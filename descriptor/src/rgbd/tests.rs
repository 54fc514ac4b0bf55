//! Clouds of images against the formula, whatever the kind of PNG, and the message of each bad one.

use expect_test::{Expect, expect};
use png::{BitDepth, ColorType, Encoder};
use proptest::prelude::*;

use super::{Camera, Images, RgbdError, read, write};
use crate::{Cloud, cloud_file};

const CAMERA: Camera = Camera { focal_length: [500.0, 250.0], centre: [1.5, -2.0], depth_unit: 0.001 };

/// A PNG file of samples as they are stored.
fn png(size: [u32; 2], colour: ColorType, bits: BitDepth, samples: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, size[0], size[1]);
    encoder.set_color(colour);
    encoder.set_depth(bits);
    if colour == ColorType::Indexed {
        encoder.set_palette(vec![10, 20, 30, 40, 50, 60]);
    }
    encoder.write_header().unwrap().write_image_data(samples).unwrap();
    bytes
}

fn depth(size: [u32; 2], depths: &[u16]) -> Vec<u8> {
    let samples: Vec<u8> = depths.iter().flat_map(|depth| depth.to_be_bytes()).collect();
    png(size, ColorType::Grayscale, BitDepth::Sixteen, &samples)
}

/// Images of 3 by 2 pixels.
struct Files {
    colour: Vec<u8>,
    depth: Vec<u8>,
    mask: Vec<u8>,
}

impl Files {
    fn new() -> Self {
        let colours: Vec<u8> = (0..18).collect();
        Self {
            colour: png([3, 2], ColorType::Rgb, BitDepth::Eight, &colours),
            depth: depth([3, 2], &[1000, 0, 2000, 500, 65535, 1]),
            mask: png([3, 2], ColorType::Grayscale, BitDepth::Eight, &[255, 255, 1, 0, 7, 255]),
        }
    }

    fn bytes(&self) -> Vec<u8> {
        let Self { colour, depth, mask } = self;
        write(&CAMERA, Images { colour, depth, mask })
    }
}

#[test]
fn each_measured_pixel_of_the_mask_is_a_point() {
    let cloud = read(&Files::new().bytes()).unwrap();
    // Columns and rows 0 0, 2 0, 1 1 and 2 1: 1 0 has no depth, 0 1 is not in the mask.
    let point = |u: f64, v: f64, d: f64| {
        let z = d * 0.001;
        [((u - 1.5) * z / 500.0) as f32, ((v + 2.0) * z / 250.0) as f32, z as f32]
    };
    let points = vec![
        point(0.0, 0.0, 1000.0),
        point(2.0, 0.0, 2000.0),
        point(1.0, 1.0, 65535.0),
        point(2.0, 1.0, 1.0),
    ];
    let colours = Some(vec![[0, 1, 2], [6, 7, 8], [12, 13, 14], [15, 16, 17]]);
    assert_eq!(points[0], [-0.003, 0.008, 1.0]);
    assert_eq!(cloud, Cloud { points, colours, viewpoint: [0.0; 3] });
    assert_eq!(cloud_file::read(&Files::new().bytes()).unwrap(), cloud);
}

#[test]
fn a_part_of_an_image_gives_the_points_of_the_whole() {
    let camera = |column: f64, row: f64| Camera { centre: [3.0 - column, 1.0 - row], ..CAMERA };
    let whole: Vec<u16> = (0..20).map(|pixel| 800 + 7 * pixel).collect();
    let is_in = |pixel: usize| (2..4).contains(&(pixel % 5)) && pixel / 5 >= 1;
    let mask: Vec<u8> = (0..20).map(|pixel| u8::from(is_in(pixel))).collect();
    let of = |size: [u32; 2], depths: &[u16], mask: &[u8], camera| {
        let grey = png(size, ColorType::Grayscale, BitDepth::Eight, mask);
        write(&camera, Images { colour: &grey, depth: &depth(size, depths), mask: &grey })
    };
    let cut: Vec<u16> = (0..20).filter(|&pixel| is_in(pixel)).map(|pixel| whole[pixel]).collect();
    let all = read(&of([5, 4], &whole, &mask, camera(0.0, 0.0))).unwrap();
    assert_eq!(all, read(&of([2, 3], &cut, &[1; 6], camera(2.0, 1.0))).unwrap());
    assert_eq!((all.len(), all.colours), (6, None));
}

#[test]
fn kinds_of_png() {
    let colours = |colour: Vec<u8>| read(&Files { colour, ..Files::new() }.bytes()).unwrap().colours;
    let all = |samples: usize, each: usize| -> Vec<u8> { (0..samples).map(|at| (at / each) as u8).collect() };
    let grey = png([3, 2], ColorType::Grayscale, BitDepth::Eight, &all(6, 1));
    assert_eq!(colours(grey), None);
    // Each pixel has 9 times its number; of 16 bits the upper byte counts.
    let rgba: Vec<u8> = (0..6).flat_map(|pixel| [9 * pixel, 1, 2, 77]).collect();
    let rgba = png([3, 2], ColorType::Rgba, BitDepth::Eight, &rgba);
    assert_eq!(colours(rgba), Some(vec![[0, 1, 2], [18, 1, 2], [36, 1, 2], [45, 1, 2]]));
    let deep: Vec<u8> = (0..6).flat_map(|pixel| [9 * pixel, 255, 1, 255, 2, 255]).collect();
    let deep = png([3, 2], ColorType::Rgb, BitDepth::Sixteen, &deep);
    assert_eq!(colours(deep), Some(vec![[0, 1, 2], [18, 1, 2], [36, 1, 2], [45, 1, 2]]));
    // Four pixels a byte, each row in bytes of its own: 0 1 1, 1 0 1.
    let indexed = png([3, 2], ColorType::Indexed, BitDepth::Two, &[0b0001_0100, 0b0100_0100]);
    assert_eq!(colours(indexed), Some(vec![[10, 20, 30], [40, 50, 60], [10, 20, 30], [40, 50, 60]]));
    let masked = |mask: Vec<u8>| read(&Files { mask, ..Files::new() }.bytes()).unwrap().len();
    assert_eq!(masked(png([3, 2], ColorType::Grayscale, BitDepth::One, &[0b0010_0000, 0b1110_0000])), 4);
    // 1 in the lower byte only.
    let lower: Vec<u8> = [0, 1].repeat(6);
    assert_eq!(masked(png([3, 2], ColorType::Grayscale, BitDepth::Sixteen, &lower)), 5);
    // Transparency is no object.
    assert_eq!(masked(png([3, 2], ColorType::GrayscaleAlpha, BitDepth::Eight, &[0, 255].repeat(6))), 0);
}

fn check(bytes: &[u8], expected: Expect) {
    expected.assert_eq(&read(bytes).unwrap_err().to_string());
}

#[test]
fn what_makes_no_cloud() {
    let good = Files::new();
    let images = Images { colour: &good.colour, depth: &good.depth, mask: &good.mask };
    check(
        &good.bytes()[..90],
        expect![[r#"
        rgb-d images: whole images expected, got 90 bytes that do not fit
        copy the images again"#]],
    );
    check(
        &[good.bytes(), vec![0]].concat(),
        expect![[r#"
        rgb-d images: whole images expected, got 310 bytes that do not fit
        copy the images again"#]],
    );
    check(
        &write(&Camera { focal_length: [500.0, 0.0], ..CAMERA }, images),
        expect![[r#"
        rgb-d camera: focal length: finite number greater than 0 expected, got 0
        correct it in the file that describes the camera"#]],
    );
    check(
        &write(&Camera { depth_unit: f64::INFINITY, ..CAMERA }, images),
        expect![[r#"
        rgb-d camera: depth unit: finite number greater than 0 expected, got inf
        correct it in the file that describes the camera"#]],
    );
    check(
        &write(&Camera { centre: [f64::NAN, 1.0], ..CAMERA }, images),
        expect![[r#"
        rgb-d camera: centre: finite number expected, got NaN
        correct it in the file that describes the camera"#]],
    );
    check(
        &write(&CAMERA, Images { depth: b"GIF89a", ..images }),
        expect![[r#"
        depth image: PNG expected, got: Invalid PNG signature.
        copy the image again, or convert it to PNG"#]],
    );
    check(
        &write(&CAMERA, Images { mask: &good.mask[..good.mask.len() - 20], ..images }),
        expect![[r#"
        mask image: PNG expected, got: unexpected end of file
        copy the image again, or convert it to PNG"#]],
    );
    check(
        &write(&CAMERA, Images { depth: &good.mask, ..images }),
        expect![[r#"
        depth image: 16 bits of grey a pixel expected, got 8 bits of grey
        write distances as 16-bit grey PNG"#]],
    );
    check(
        &write(&CAMERA, Images { depth: &good.colour, ..images }),
        expect![[r#"
        depth image: 16 bits of grey a pixel expected, got 8 bits of colour
        write distances as 16-bit grey PNG"#]],
    );
    check(
        &write(&CAMERA, Images { depth: &depth([2, 3], &[1; 6]), ..images }),
        expect![[r#"
        depth image: the size of the colour image expected, 3 x 2, got 2 x 3
        name images of the same view"#]],
    );
    // The size is refused by the header: nothing behind it is looked at.
    let mut large = png([3, 2], ColorType::Grayscale, BitDepth::Eight, &[0; 6]);
    large[16..24].copy_from_slice(&[0, 0, 0x10, 0x01, 0, 0, 0x10, 0]);
    let crc = crc32(&large[12..29]);
    large[29..33].copy_from_slice(&crc.to_be_bytes());
    check(
        &write(&CAMERA, Images { colour: &large, ..images }),
        expect![[r#"
        colour image: at most 16777216 pixels expected, got 4097 x 4096
        cut out the object, or scale all images of the cloud"#]],
    );
}

/// The checksum of PNG (ISO 15948, annex D).
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc, &byte| {
        (0..8).fold(
            crc ^ u32::from(byte),
            |crc, _| if crc & 1 == 1 { 0xedb8_8320 ^ (crc >> 1) } else { crc >> 1 },
        )
    })
}

proptest! {
    #[test]
    fn no_cut_and_no_other_byte_panics(cut in 0_usize..400, at in 0_usize..400, byte: u8) {
        let mut bytes = Files::new().bytes();
        let at = at % bytes.len();
        bytes[at] = byte;
        let _ = read(&bytes);
        bytes.truncate(cut);
        if cut < Files::new().bytes().len() {
            let is_refused = matches!(read(&bytes), Err(RgbdError::Damaged { .. } | RgbdError::Png { .. }));
            prop_assert!(is_refused);
        }
    }
}
