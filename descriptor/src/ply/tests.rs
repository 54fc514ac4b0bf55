//! What PLY files mean: written by hand from the format's definition, in each of its formats and by other programs.

use super::{is_ply, read};
use crate::{Cloud, cloud_file, pcd};

/// Three points, of which the second has no position, as the types of their properties demand.
const POINTS: [[f64; 6]; 3] = [
    [0.5, -1.0, 2.0, 255.0, 0.0, 128.0],
    [f64::NAN, 0.0, 0.0, 1.0, 2.0, 3.0],
    [0.1, 1e-3, -4.25, 7.0, 51.0, 204.0],
];

fn cloud() -> Cloud {
    Cloud {
        points: vec![[0.5, -1.0, 2.0], [0.1, 1e-3, -4.25]],
        colours: Some(vec![[255, 0, 128], [7, 51, 204]]),
        viewpoint: [0.0; 3],
    }
}

/// A value as bytes of its type.
fn bytes_of(kind: &str, value: f64, big: bool) -> Vec<u8> {
    let mut bytes = match kind {
        "char" | "int8" => (value as i8).to_le_bytes().to_vec(),
        "uchar" | "uint8" => vec![value as u8],
        "short" | "int16" => (value as i16).to_le_bytes().to_vec(),
        "ushort" | "uint16" => (value as u16).to_le_bytes().to_vec(),
        "int" | "int32" => (value as i32).to_le_bytes().to_vec(),
        "uint" | "uint32" => (value as u32).to_le_bytes().to_vec(),
        "float" | "float32" => (value as f32).to_le_bytes().to_vec(),
        _ => value.to_le_bytes().to_vec(),
    };
    if big {
        bytes.reverse();
    }
    bytes
}

/// A file of three vertices with a further property and, in front of and behind them, lists.
fn file(format: &str, number: &str, names: [&str; 3], colour: &str, scale: f64, line_end: &str) -> Vec<u8> {
    let [red, green, blue] = names;
    let header = format!(
        "ply\nformat {format} 1.0\ncomment caf\u{e9} end_header\nobj_info made by hand\nelement patch 2\n\
         property list uchar short ids\nproperty uchar kind\nelement vertex 3\nproperty {colour} {blue}\n\
         property {number} z\nproperty {number} x\nproperty char quality\nproperty {number} y\n\
         property {colour} {green}\nproperty {colour} {red}\nelement face 1\nproperty list int uint vertex_indices\n\
         end_header\n"
    );
    let mut bytes = header.replace('\n', line_end).into_bytes();
    let rows: Vec<Vec<(&str, f64)>> = std::iter::once(vec![("uchar", 0.0), ("uchar", 9.0)])
        .chain([vec![("uchar", 2.0), ("short", -1.0), ("short", 300.0), ("uchar", 8.0)]])
        .chain(POINTS.map(|[x, y, z, red, green, blue]| {
            let [red, green, blue] = [red, green, blue].map(|value| (colour, value * scale));
            vec![blue, (number, z), (number, x), ("char", -7.0), (number, y), green, red]
        }))
        .chain([vec![("int", 3.0), ("uint", 0.0), ("uint", 1.0), ("uint", 2.0)]])
        .collect();
    for row in rows {
        if format == "ascii" {
            // As the type holds it, so that text is not more exact than the others.
            let words = row.iter().map(|&(kind, value)| match kind {
                "float" | "float32" => (value as f32).to_string(),
                _ => value.to_string(),
            });
            bytes.extend(words.collect::<Vec<_>>().join(" ").into_bytes());
            bytes.extend(line_end.as_bytes());
        } else {
            let big = format == "binary_big_endian";
            bytes.extend(row.iter().flat_map(|&(kind, value)| bytes_of(kind, value, big)));
        }
    }
    bytes
}

#[test]
fn the_same_points_are_the_same_cloud_in_every_format_and_type() {
    const NAMES: [[&str; 3]; 3] =
        [["red", "green", "blue"], ["diffuse_red", "diffuse_green", "diffuse_blue"], ["r", "g", "b"]];
    const COLOURS: [(&str, f64); 6] = [
        ("uchar", 1.0),
        ("uint8", 1.0),
        ("ushort", 257.0),
        ("uint16", 257.0),
        ("float32", 1.0 / 255.0),
        ("double", 1.0 / 255.0),
    ];
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        for number in ["float", "float32", "double", "float64"] {
            for (names, (colour, scale)) in NAMES.into_iter().cycle().zip(COLOURS) {
                for line_end in ["\n", "\r\n"] {
                    let bytes = file(format, number, names, colour, scale, line_end);
                    assert!(is_ply(&bytes));
                    assert_eq!(
                        read(&bytes),
                        Ok(cloud()),
                        "{format} {number} {names:?} {colour} {line_end:?}"
                    );
                }
            }
        }
    }
}

/// A file of one point in text.
fn one(properties: &str, values: &str) -> String {
    let properties = properties.split(", ").map(|property| format!("property {property}\n"));
    format!(
        "ply\nformat ascii 1.0\nelement vertex 1\n{}end_header\n{values}\n",
        properties.collect::<String>()
    )
}

#[test]
fn whole_numbers_are_positions() {
    for kind in ["char", "short", "int", "int8", "int16", "int32"] {
        let properties = format!("{kind} x, {kind} y, {kind} z");
        let point = read(one(&properties, "-3 0 120").as_bytes()).unwrap().points;
        assert_eq!(point, [[-3.0, 0.0, 120.0]], "{kind}");
    }
    // 2^24 + 1 lies between two f32 and is rounded to the even one, in text as in binary.
    let text = one("int x, uint y, uint z", "16777217 4294967295 0");
    let (header, _) = text.split_once("16777217").unwrap();
    let mut binary = header.replace("ascii", "binary_little_endian").into_bytes();
    binary.extend([16_777_217_u32, u32::MAX, 0].iter().flat_map(|value| value.to_le_bytes()));
    for bytes in [text.as_bytes(), &binary] {
        assert_eq!(read(bytes).unwrap().points, [[16_777_216.0, 4_294_967_296.0, 0.0]]);
    }
}

#[test]
fn colours_are_the_nearest_of_256_steps() {
    let red = |kind: &str, value: &str| {
        let properties = format!("float x, float y, float z, {kind} red, {kind} green, {kind} blue");
        read(one(&properties, &format!("0 0 0 {value} 0 0")).as_bytes()).unwrap().colours.unwrap()[0][0]
    };
    for value in 0..=255_u8 {
        let unit = f64::from(value) / 255.0;
        assert_eq!(red("float", &(unit as f32).to_string()), value);
        assert_eq!(red("double", &unit.to_string()), value);
        assert_eq!(red("ushort", &(u16::from(value) * 257).to_string()), value);
        assert_eq!(red("uchar", &value.to_string()), value);
    }
    assert_eq!(["128", "129", "65406", "65407"].map(|value| red("ushort", value)), [0, 1, 254, 255]);
    assert_eq!(["0.00196", "0.00197", "1"].map(|value| red("double", value)), [0, 1, 255]);
}

#[test]
fn a_file_without_colours_has_none() {
    let none = read(one("float x, float y, float z", "1 2 3").as_bytes()).unwrap();
    assert_eq!(none, Cloud { points: vec![[1.0, 2.0, 3.0]], colours: None, viewpoint: [0.0; 3] });
    // A radius is no red.
    assert_eq!(read(one("float x, float y, float z, float r", "1 2 3 4").as_bytes()), Ok(none));
}

#[test]
fn lists_of_points_are_skipped() {
    let properties = "list uchar int ids, float x, float y, list char double weights, float z";
    let text = one(properties, "3 9 9 9 1 2 0 3");
    assert_eq!(read(text.as_bytes()).unwrap().points, [[1.0, 2.0, 3.0]]);
    for big in [false, true] {
        let format = if big { "binary_big_endian" } else { "binary_little_endian" };
        let mut binary = text.replace("ascii", format).replace("3 9 9 9 1 2 0 3\n", "").into_bytes();
        let values = [("uchar", 2.0), ("int", 9.0), ("int", -9.0), ("float", 1.0), ("float", 2.0)];
        let rest = [("char", 1.0), ("double", 0.5), ("float", 3.0)];
        binary.extend(values.into_iter().chain(rest).flat_map(|(kind, value)| bytes_of(kind, value, big)));
        assert_eq!(read(&binary).unwrap().points, [[1.0, 2.0, 3.0]], "{format}");
    }
}

#[test]
fn the_camera_of_pcl_is_the_viewpoint() {
    // The header of pcl::PLYWriter, shortened by the properties between.
    let header = "ply\nformat ascii 1.0\ncomment PCL generated\nelement vertex 1\nproperty float x\nproperty float y\n\
                  property float z\nelement camera 1\nproperty float view_px\nproperty float view_py\n\
                  property float view_pz\nproperty float x_axisx\nproperty int viewportx\nend_header\n";
    let text = format!("{header}1 2 3\n0.5 -1 0.25 1 640\n");
    let expected = Cloud { points: vec![[1.0, 2.0, 3.0]], colours: None, viewpoint: [0.5, -1.0, 0.25] };
    assert_eq!(read(text.as_bytes()), Ok(expected.clone()));
    let mut binary = header.replace("ascii", "binary_little_endian").into_bytes();
    binary.extend([1.0, 2.0, 3.0, 0.5, -1.0, 0.25, 1.0].iter().flat_map(|value: &f32| value.to_le_bytes()));
    binary.extend(640_i32.to_le_bytes());
    assert_eq!(read(&binary), Ok(expected));
    for other in [text.replace("view_pz", "view_p"), text.replace("\n0.5", "\nnan")] {
        assert_eq!(read(other.as_bytes()).unwrap().viewpoint, [0.0; 3]);
    }
}

#[test]
fn a_cloud_without_points_is_valid() {
    let header = "ply\nformat binary_big_endian 1.0\nelement vertex 0\nproperty float x\nproperty float y\n\
                  property float z\nelement nothing 0\nend_header";
    for end in ["", "\n", "\r\n", "\n\0\0\0"] {
        assert_eq!(read(format!("{header}{end}").as_bytes()), Ok(Cloud::default()), "{end:?}");
    }
}

#[test]
fn the_content_says_which_format_a_file_has() {
    let ply = file("binary_big_endian", "float", ["red", "green", "blue"], "uchar", 1.0, "\r\n");
    let pcd = pcd::write(&cloud(), pcd::DataEncoding::Binary);
    assert_eq!(cloud_file::read(&ply), Ok(cloud()));
    assert_eq!(cloud_file::read(&pcd), Ok(cloud()));
    assert!(!is_ply(&pcd) && !is_ply(b"plywood") && is_ply(b"ply\r\n") && is_ply(b"ply"));
    let error = |bytes: &[u8]| cloud_file::read(bytes).unwrap_err().to_string();
    assert!(error(b"ply\nformat ascii 2.0\n").starts_with("ply header: line 2: "));
    assert!(error(b"solid model\n").starts_with("pcd header: line 1: "));
}
