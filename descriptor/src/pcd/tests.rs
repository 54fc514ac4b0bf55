//! What PCD files mean: written by hand from the format's definition, by other programs, and by this one.

use std::path::PathBuf;

use proptest::prelude::*;

use super::{DataEncoding, read, write};
use crate::Cloud;

const ENCODINGS: [DataEncoding; 3] =
    [DataEncoding::Ascii, DataEncoding::Binary, DataEncoding::BinaryCompressed];

/// The shared data folder, or `None` with a word about it where it may be missing.
fn shared(folder: &str) -> Option<PathBuf> {
    let default = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared");
    let root = std::env::var("DESCRY_SHARED").unwrap_or_else(|_| default.to_owned());
    let folder = PathBuf::from(root).join(folder);
    if folder.is_dir() {
        return Some(folder);
    }
    let required = std::env::var("DESCRY_REQUIRE_SHARED").is_ok_and(|value| value == "1");
    assert!(!required, "{} is missing; set DESCRY_SHARED", folder.display());
    eprintln!("SKIPPED: {} is missing; set DESCRY_SHARED to run this test", folder.display());
    None
}

/// LZF without compression: runs of up to 32 literal bytes, each after its length less one.
fn literal_lzf(plain: &[u8]) -> Vec<u8> {
    plain.chunks(32).flat_map(|run| [&[run.len() as u8 - 1], run].concat()).collect()
}

#[test]
fn ascii_takes_any_field_order_extra_fields_comments_blank_lines_and_crlf() {
    let text = "# made by hand\r\n\r\nVERSION .7\r\nFIELDS normal rgb z _ y _ x\r\nSIZE 4 4 4 1 8 2 4\r\n\
                TYPE F U F U F I F\r\n# caf\u{e9}\r\nCOUNT 3 1 1 2 1 1 1\r\nWIDTH 2\r\nHEIGHT 1\r\n\
                VIEWPOINT 0.5 -1 2e0 1 0 0 0\r\nPOINTS 2\r\nDATA ascii\r\n\
                9 9 9 4278190335 3 0 0 2 -7 1\r\n\r\n # half way\r\n\t9 9 9  65280 0.25 0 0 -0.5 -7 1e-3";
    let expected = Cloud {
        points: vec![[1.0, 2.0, 3.0], [0.001, -0.5, 0.25]],
        colours: Some(vec![[0, 0, 255], [0, 255, 0]]), // 0xff0000ff and 0x0000ff00
        viewpoint: [0.5, -1.0, 2.0],
    };
    assert_eq!(read(text.as_bytes()), Ok(expected));
}

/// Two points with x, y as F8, three I2 between, z as F4 and rgba as U4; point by point and field by field.
fn two_points() -> (String, Vec<u8>, Vec<u8>, Cloud) {
    let header = "VERSION 0.7\nFIELDS x y tag z rgba\nSIZE 8 8 2 4 4\nTYPE F F I F U\nCOUNT 1 1 3 1 1\n\
                  WIDTH 1\nHEIGHT 2\nPOINTS 2\n";
    let (xs, ys, zs) = ([0.1_f64, -4.0], [0.2_f64, 5.0], [0.3_f32, 6.0]);
    let (tags, rgba) = ([[1_i16, -2, 3], [4, 5, -6]], [0x80_01_02_03_u32, 0xff_fe_fd_fc]);
    let columns = |i: usize| {
        [
            xs[i].to_le_bytes().to_vec(),
            ys[i].to_le_bytes().to_vec(),
            tags[i].iter().flat_map(|tag| tag.to_le_bytes()).collect(),
            zs[i].to_le_bytes().to_vec(),
            rgba[i].to_le_bytes().to_vec(),
        ]
    };
    let by_point = [columns(0).concat(), columns(1).concat()].concat();
    let by_field = (0..5).flat_map(|field| [columns(0)[field].clone(), columns(1)[field].clone()].concat());
    let cloud = Cloud {
        points: vec![[0.1, 0.2, 0.3], [-4.0, 5.0, 6.0]],
        colours: Some(vec![[1, 2, 3], [0xfe, 0xfd, 0xfc]]),
        viewpoint: [0.0; 3],
    };
    (header.to_owned(), by_point.clone(), by_field.collect(), cloud)
}

#[test]
fn binary_is_point_by_point_and_may_be_padded_with_zeros() {
    let (header, by_point, _, cloud) = two_points();
    let mut bytes = format!("{header}DATA binary\n").into_bytes();
    bytes.extend(by_point);
    assert_eq!(read(&bytes), Ok(cloud.clone()));
    bytes.extend([0; 4096]);
    assert_eq!(read(&bytes), Ok(cloud));
}

#[test]
fn compressed_is_field_by_field() {
    let (header, _, by_field, cloud) = two_points();
    let lzf = literal_lzf(&by_field);
    let mut bytes = format!("{header}DATA binary_compressed\n").into_bytes();
    bytes.extend((lzf.len() as u32).to_le_bytes());
    bytes.extend((by_field.len() as u32).to_le_bytes());
    bytes.extend(lzf);
    assert_eq!(read(&bytes), Ok(cloud));
}

#[test]
fn a_float_colour_is_its_bits_also_when_denormal() {
    let colour = |text: &str| {
        let file = format!(
            "FIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n0 0 0 {text}\n"
        );
        read(file.as_bytes()).unwrap().colours.unwrap()[0]
    };
    // The smallest normal f32 is 2^-126, bits 0x00800000; below it a unit of 2^-149 is one step of blue.
    assert_eq!(colour("1.17549435e-38"), [0x80, 0, 0]);
    assert_eq!(colour("1.4e-45"), [0, 0, 1]);
    assert_eq!(colour("0"), [0, 0, 0]);
    // 0x00ffffff = (2 - 2^-23) × 2^-126 and the same with alpha 1, that is twice as much.
    assert_eq!(colour("2.35098856e-38"), [255, 255, 255]);
    assert_eq!(colour("4.70197712e-38"), [0x7f, 255, 255]);
    for packed in (0..1 << 24).step_by(4099) {
        let [_, red, green, blue] = u32::to_be_bytes(packed);
        assert_eq!(colour(&format!("{:.8e}", f32::from_bits(packed))), [red, green, blue]);
    }
}

/// Two points with the colours 1 2 3 and 255 0 204 in fields of their own, of a type that `word` writes as text and
/// `bytes` in binary; between them is a radius.
fn separate(kind: &str, word: fn(u8) -> String, bytes: fn(u8) -> Vec<u8>) -> [Vec<u8>; 3] {
    let (size, letter) = (&kind[1..], &kind[..1]);
    let header = format!(
        "FIELDS b x r y radius z g\nSIZE {size} 4 {size} 4 2 4 {size}\nTYPE {letter} F {letter} F U F {letter}\n\
         WIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA "
    );
    let colours = [[1, 2, 3], [255, 0, 204]];
    let text = colours.map(|[red, green, blue]| {
        let [red, green, blue] = [red, green, blue].map(word);
        format!("{blue} 1 {red} 2 7 3 {green}\n")
    });
    let columns = |[red, green, blue]: [u8; 3]| {
        let real = |value: f32| value.to_le_bytes().to_vec();
        [bytes(blue), real(1.0), bytes(red), real(2.0), vec![7, 0], real(3.0), bytes(green)]
    };
    let [first, second] = colours.map(columns);
    let by_field: Vec<u8> =
        first.iter().zip(&second).flat_map(|(first, second)| [&first[..], second].concat()).collect();
    let lzf = literal_lzf(&by_field);
    let sizes = [lzf.len() as u32, by_field.len() as u32].map(u32::to_le_bytes).concat();
    [
        [header.as_bytes(), b"ascii\n", text.concat().as_bytes()].concat(),
        [header.as_bytes(), b"binary\n", &first.concat(), &second.concat()].concat(),
        [header.as_bytes(), b"binary_compressed\n", &sizes, &lzf].concat(),
    ]
}

#[test]
fn separate_colours_are_colours() {
    let whole = separate("U1", |value| value.to_string(), |value| vec![value]);
    let real = separate(
        "F4",
        |value| (f32::from(value) / 255.0).to_string(),
        |value| (f32::from(value) / 255.0).to_le_bytes().to_vec(),
    );
    let points = vec![[1.0, 2.0, 3.0]; 2];
    let cloud = Cloud { points, colours: Some(vec![[1, 2, 3], [255, 0, 204]]), viewpoint: [0.0; 3] };
    for file in whole.iter().chain(&real) {
        assert_eq!(read(file), Ok(cloud.clone()));
    }

    let text = str::from_utf8(&whole[0]).unwrap();
    // A single letter is something else, and packed colours come before separate ones.
    assert_eq!(read(text.replace(" g\n", " green\n").as_bytes()).unwrap().colours, None);
    let packed = text.replace("radius", "rgb").replace("4 2 4", "4 4 4");
    assert_eq!(read(packed.as_bytes()).unwrap().colours, Some(vec![[0, 0, 7]; 2]));
    for (file, message) in [
        (text.replace("255", "256"), "pcd data: line 9: r: a whole number below 256 expected, got 256\n"),
        (
            text.replace("TYPE U", "TYPE I"),
            "pcd header: b: U1 or F4 with COUNT 1 expected, got I1 with COUNT 1\n",
        ),
    ] {
        let error = read(file.as_bytes()).unwrap_err().to_string();
        assert!(error.starts_with(message), "{error}");
    }
    let bright = separate("F4", |value| value.to_string(), |value| f32::from(value).to_le_bytes().to_vec());
    assert_eq!(
        read(&bright[0]).unwrap_err().to_string().lines().next(),
        Some("pcd data: line 8: g: a number from 0 to 1 expected, got 2")
    );
    let error = "pcd data: point 0: g: a number from 0 to 1 expected, got 2\ndivide colours by 255, or write them as U1";
    for file in &bright[1..] {
        assert_eq!(read(file).unwrap_err().to_string(), error);
    }
}

#[test]
fn points_that_are_not_finite_are_dropped_with_their_colour() {
    let text = "FIELDS x y z rgb\nSIZE 4 4 8 4\nTYPE F F F F\nWIDTH 6\nHEIGHT 1\nPOINTS 6\nDATA ascii\n\
                nan nan nan nan\n1 2 3 0\n-inf 0 0 0\n0 NaN 0 0\n0 0 1e39 0\n4 5 6 1.4e-45\n";
    let cloud = read(text.as_bytes()).unwrap();
    assert_eq!(cloud.points, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
    assert_eq!(cloud.colours.unwrap(), [[0, 0, 0], [0, 0, 1]]);

    let nan = Cloud { points: vec![[f32::NAN; 3]; 3], colours: None, viewpoint: [1.0, 0.0, 0.0] };
    for encoding in ENCODINGS {
        let read = read(&write(&nan, encoding)).unwrap();
        assert_eq!(read, Cloud { points: vec![], ..nan.clone() }, "{encoding:?}");
    }
}

#[test]
fn a_cloud_without_points_is_valid() {
    for colours in [None, Some(vec![])] {
        let cloud = Cloud { colours, ..Cloud::default() };
        for encoding in ENCODINGS {
            assert_eq!(read(&write(&cloud, encoding)), Ok(cloud.clone()), "{encoding:?}");
        }
    }
    let header = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 0\nHEIGHT 1\nPOINTS 0\nDATA ascii";
    assert_eq!(read(header.as_bytes()), Ok(Cloud::default()));
}

#[test]
fn clouds_of_other_writers_are_the_same_in_every_encoding() {
    let Some(folder) = shared("data/household-rgbd") else { return };
    let list = std::fs::read_to_string(folder.join("formats/list.txt")).unwrap();
    assert_eq!(list.lines().count(), 12);
    for path in list.lines() {
        let original = read(&std::fs::read(folder.join(path)).unwrap()).unwrap();
        assert!(original.len() > 100 && original.colours.is_some());
        let name = path.rsplit('/').next().unwrap();
        for encoding in ["ascii", "binary"] {
            let other = std::fs::read(folder.join("formats").join(encoding).join(name)).unwrap();
            assert_eq!(read(&other).unwrap(), original, "{encoding} {name}");
        }
        for encoding in ENCODINGS {
            assert_eq!(read(&write(&original, encoding)).unwrap(), original, "{encoding:?} {name}");
        }
    }
}

#[test]
fn a_cloud_of_the_uw_object_dataset_reads() {
    let Some(folder) = shared("data/uw/banana") else { return };
    let mut folders = vec![folder];
    let mut files = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "pcd") {
                files.push(path);
            }
        }
    }
    assert_eq!(files.len(), 1);
    let bytes = std::fs::read(&files[0]).unwrap();
    let lines = str::from_utf8(&bytes).unwrap().lines().skip_while(|line| !line.starts_with("DATA")).skip(1);
    let finite: Vec<Vec<&str>> = lines
        .map(|line| line.split(' ').collect::<Vec<_>>())
        .filter(|words| words[..3].iter().all(|word| word.parse::<f32>().unwrap().is_finite()))
        .collect();
    let cloud = read(&bytes).unwrap();
    assert_eq!((cloud.len(), finite.len()), (3534, 3534));
    let colours = cloud.colours.unwrap();
    for ((words, point), colour) in finite.iter().zip(&cloud.points).zip(&colours) {
        assert_eq!(
            point.map(|coordinate| coordinate.to_string()),
            [0, 1, 2].map(|axis| { words[axis].parse::<f32>().unwrap().to_string() })
        );
        // The packed colour times 2^-149 is the number in the file, here to the digits given.
        let packed = f64::from(u32::from_be_bytes([0, colour[0], colour[1], colour[2]]));
        let number: f64 = words[3].parse().unwrap();
        let unit = f64::from(f32::from_bits(1));
        assert!((packed * unit / number - 1.0).abs() < 1e-7, "{colour:?} {number:e}");
    }
    // A banana: more red and green than blue on the whole.
    let sums = colours.iter().fold([0_u32; 3], |sums, colour| {
        [0, 1, 2].map(|component| sums[component] + u32::from(colour[component]))
    });
    assert!(sums[0] > sums[2] && sums[1] > sums[2], "{sums:?}");
}

/// Finite clouds with any bits, smooth ones that compress well, and empty ones.
fn any_cloud() -> impl Strategy<Value = Cloud> {
    use proptest::num::f32::{NEGATIVE, NORMAL, POSITIVE, SUBNORMAL, ZERO};
    let any_finite = POSITIVE | NEGATIVE | NORMAL | SUBNORMAL | ZERO;
    let number = prop_oneof![any_finite, (0_u8..4).prop_map(|value| f32::from(value) / 100.0)];
    let point = proptest::array::uniform3(number);
    let entry = (point.clone(), any::<[u8; 3]>());
    (proptest::collection::vec(entry, 0..300), any::<bool>(), point).prop_map(
        |(entries, coloured, viewpoint)| {
            let (points, colours): (Vec<_>, Vec<_>) = entries.into_iter().unzip();
            Cloud { points, colours: coloured.then_some(colours), viewpoint }
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn what_is_written_reads_back_bit_for_bit(cloud in any_cloud()) {
        for encoding in ENCODINGS {
            let back = read(&write(&cloud, encoding)).unwrap();
            // As text, which tells -0 from 0 and is otherwise exact.
            prop_assert_eq!(format!("{back:?}"), format!("{cloud:?}"), "{:?}", encoding);
        }
    }
}
