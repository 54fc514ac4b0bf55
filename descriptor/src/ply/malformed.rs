//! Damaged PLY files: each is refused with a message, before memory is asked for.

use proptest::prelude::*;

use super::read;

const HEADER: &str = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty double y\nproperty float z\n\
                      property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n\
                      property list uchar int vertex_indices\nend_header\n";
const ROWS: &str = "0 0 1 255 0 0\n0 0 2 0 9 0\n3 0 1 0\n";

/// The rows in binary, the lowest byte first.
fn binary_rows() -> Vec<u8> {
    let mut bytes = Vec::new();
    for (z, colour) in [(1.0_f32, [255, 0, 0]), (2.0, [0, 9, 0])] {
        bytes.extend([0; 12]);
        bytes.extend(z.to_le_bytes());
        bytes.extend(colour);
    }
    bytes.push(3);
    bytes.extend([0_i32, 1, 0].iter().flat_map(|index| index.to_le_bytes()));
    bytes
}

fn message(bytes: &[u8]) -> String {
    read(bytes).unwrap_err().to_string()
}

#[test]
fn edits_of_a_valid_file() {
    let again = "or write the file again as PLY 1.0";
    let line = format!("correct the line, {again}");
    let write = "correct the value, or write the file again";
    let count = "the file is cut off or the counts of its elements are wrong: copy or write it again";
    let known = "format, comment, obj_info, element, property or end_header expected";
    for (from, to, what, advice) in [
        ("ply\n", "ply 1.0\n", "ply header: line 1: ply alone expected, got ply 1.0", &*line),
        (
            "1.0\n",
            "1.1\n",
            "ply header: line 2: one format and its version 1.0 expected, got format ascii 1.1",
            &line,
        ),
        (
            "format ascii 1.0\n",
            "",
            "ply header: format: line expected, got none",
            "add it after the first line, or write the file again as PLY 1.0",
        ),
        (
            "format ascii",
            "format binary",
            "ply header: line 2: format ascii, binary_little_endian or binary_big_endian expected, got binary",
            &line,
        ),
        (
            "element face",
            "elements face",
            &format!("ply header: line 10: {known}, got elements face 1"),
            &line,
        ),
        (
            "element face",
            "\u{202e}face",
            &format!("ply header: line 10: {known}, got \\u{{202e}}face 1"),
            &line,
        ),
        (
            "vertex 2",
            "vertex -2",
            "ply header: line 3: a whole number from 0 to 2^64 - 1 expected, got -2",
            &line,
        ),
        ("vertex 2", "vertex", &format!("ply header: line 3: {known}, got element vertex"), &line),
        (
            "element vertex 2\n",
            "",
            "ply header: line 3: an element before its properties expected, got property float x",
            &line,
        ),
        (
            "element vertex",
            "element point",
            "ply header: element vertex: line expected, got none",
            "write the points as the element vertex with the properties x, y and z",
        ),
        (
            "element face",
            "element vertex",
            "ply header: line 10: each name once expected, got vertex again",
            "remove or rename one of them",
        ),
        (
            "green",
            "red",
            "ply header: line 8: each name once expected, got red again",
            "remove or rename one of them",
        ),
        (
            "property list uchar int vertex_indices\n",
            "",
            "ply header: element face: properties expected, got none",
            "remove the element, or write the file again",
        ),
        (
            "float z",
            "float w",
            "ply header: element vertex: property z expected, got none",
            "write the points with x, y and z, and colours with all three of their properties, or none",
        ),
        (
            "uchar blue",
            "uchar alpha",
            "ply header: element vertex: property blue expected, got none",
            "write the points with x, y and z, and colours with all three of their properties, or none",
        ),
        (
            "uchar red\n",
            "uchar red\nproperty uchar r\nproperty uchar g\nproperty uchar b\n",
            "ply header: element vertex: colours once expected, got red and r",
            "remove one of them",
        ),
        (
            "uchar red",
            "int red",
            "ply header: property red: uchar, ushort, float or double expected, got int",
            "write the property with that type",
        ),
        (
            "float x",
            "list uchar float x",
            "ply header: property x: a number expected, got list uchar float",
            "write the property with that type",
        ),
        ("float x", "half x", "ply header: line 4: a type of PLY 1.0 expected, got half", &line),
        (
            "list uchar",
            "list float",
            "ply header: line 11: a type of PLY 1.0 expected, got list float int",
            &line,
        ),
        (
            "element face 1\nproperty list uchar int vertex_indices",
            "element camera 2\nproperty int view_px\nproperty int view_py\nproperty int view_pz",
            "ply header: element camera: at most 1 expected, got 2",
            "remove the element: the viewpoint is then the origin",
        ),
        (
            "vertex 2",
            "vertex 18446744073709551615",
            "ply data: 18446744073709551615 of element vertex of at least 12 bytes expected, got 34 bytes",
            count,
        ),
        (
            "face 1",
            "face 1099511627776",
            "ply data: 1099511627776 of element face of at least 2 bytes expected, got 8 bytes",
            count,
        ),
        ("face 1", "face 2", "ply data: element face: 2 expected, got 1", count),
        (
            "face 1",
            "face 0",
            "ply data: end of file after the last element expected, got 8 bytes more",
            "the counts or the properties of its elements are wrong: correct the header or write the file again",
        ),
        (
            "0 0 2 0 9 0",
            "0 0 2 0 9",
            "ply data: line 14: 6 values expected, got 5",
            "correct the line, or write the file again",
        ),
        (
            "0 0 2 0 9 0",
            "0 0 2 0 9 0 7",
            "ply data: line 14: 6 values expected, got 7",
            "correct the line, or write the file again",
        ),
        ("0 0 2 0 9 0", "0 1,5 2 0 9 0", "ply data: line 14: y: a number expected, got 1,5", write),
        ("255", "256", "ply data: line 13: red: a whole number below 256 expected, got 256", write),
    ] {
        let valid = format!("{HEADER}{ROWS}");
        assert!(read(valid.as_bytes()).is_ok() && valid.contains(from), "{from}");
        assert_eq!(message(valid.replacen(from, to, 1).as_bytes()), format!("{what}\n{advice}"), "{to}");
    }
}

#[test]
fn headers_without_an_end() {
    let expected = "ply header: end_header: line expected within the first 65536 bytes, got none\n\
                    the header is cut off, or its lines do not end with a line feed: copy or write the file again";
    assert_eq!(message(b"ply\n"), expected);
    assert_eq!(message(&HEADER.as_bytes()[..70]).lines().count(), 2);
    assert_eq!(message(("ply\n".to_owned() + &"comment no end\n".repeat(1 << 16)).as_bytes()), expected);
    assert_eq!(message(&[b"ply\n", &vec![b' '; 1 << 20][..]].concat()), expected);
    assert!(
        message(b"ply\r\xff\n").starts_with("ply header: line 1: UTF-8 text expected, got other bytes\n")
    );
}

#[test]
fn values_that_are_out_of_range() {
    let floats = HEADER.replace("uchar red", "float red").replace("ascii", "binary_little_endian");
    let mut bytes = floats.into_bytes();
    bytes.extend([0; 16]);
    bytes.extend(1.5_f32.to_le_bytes());
    bytes.extend([0; 64]);
    assert_eq!(
        message(&bytes),
        "ply data: row 0: red: a number from 0 to 1 expected, got 1.5\ncorrect the value, or write the file again"
    );
    let text = format!("{HEADER}{ROWS}").replace("uchar red", "double red");
    assert!(message(text.as_bytes()).contains("line 13: red: a number from 0 to 1 expected, got 255\n"));
    assert!(message(text.replace("255", "nan").as_bytes()).contains("got nan\n"));

    let header = HEADER.replace("ascii", "binary_little_endian").replace("list uchar", "list char");
    let mut negative = [header.as_bytes(), &binary_rows()].concat();
    let at = negative.len() - 13;
    negative[at] = 0xff;
    assert!(
        message(&negative).starts_with("ply data: row 0: vertex_indices: a count from 0 expected, got -1\n")
    );
    let huge = [
        HEADER.replace("ascii", "binary_little_endian").replace("list uchar", "list uint").as_bytes(),
        &binary_rows(),
    ]
    .concat();
    assert!(message(&huge).starts_with("ply data: element face: 1 expected, got 0\n"));
}

#[test]
fn lists_of_points_that_are_longer_than_their_line() {
    let header = HEADER.replace("uchar blue\n", "uchar blue\nproperty list uint int ids\n");
    let file = |row: &str| format!("{header}{row}\n0 0 2 0 9 0 0\n0\n");
    assert!(read(file("0 0 1 255 0 0 2 5 5").as_bytes()).is_ok());
    for (row, expected, got) in [
        ("0 0 1 255 0 0 3 5 5", "9", 9),
        ("0 0 1 255 0 0 18446744073709551615 5", "18446744073709551615", 8),
        ("0 0 1 255 0 0 1 5 5", "8", 9),
    ] {
        let expected = if expected == "9" { "10" } else { expected };
        assert!(
            message(file(row).as_bytes())
                .starts_with(&format!("ply data: line 14: {expected} values expected, got {got}\n")),
            "{}",
            message(file(row).as_bytes())
        );
    }
    assert!(
        message(file("0 0 1 255 0 0 -1").as_bytes())
            .contains("ids: a count from 0 to 2^64 - 1 expected, got -1")
    );
}

/// Reads what may be anything: no panic, and no more memory than the input's size allows.
fn read_anything(bytes: &[u8]) {
    if let Ok(cloud) = read(bytes) {
        let colours = cloud.colours.as_ref();
        assert!(colours.is_none_or(|colours| colours.len() == cloud.len()));
        assert!(
            cloud.points.iter().flatten().chain(&cloud.viewpoint).all(|coordinate| coordinate.is_finite())
        );
        let memory = cloud.points.capacity() * 12 + colours.map_or(0, |colours| colours.capacity() * 3);
        assert!(memory <= bytes.len() * 10, "{memory} bytes for {}", bytes.len());
    }
}

fn samples() -> [Vec<u8>; 3] {
    let binary = [HEADER.replace("ascii", "binary_little_endian").as_bytes(), &binary_rows()].concat();
    let big = [HEADER.replace("ascii", "binary_big_endian").as_bytes(), &binary_rows()].concat();
    [format!("{HEADER}{ROWS}").into_bytes(), binary, big]
}

#[test]
fn every_cut_of_a_file_is_refused_and_every_changed_byte_is_survived() {
    for (sample, is_text) in samples().into_iter().zip([true, false, false]) {
        // Text may lose the end of its last row, whose values are not looked at.
        let last = sample.len() - if is_text { 7 } else { 0 };
        let is_big = sample.windows(10).any(|window| window == b"big_endian");
        assert!(read(&sample).is_ok(), "a sample is valid");
        for length in 0..sample.len() {
            assert!(length >= last || read(&sample[..length]).is_err(), "cut at {length}, big {is_big}");
            read_anything(&sample[..length]);
        }
        for at in 0..sample.len() {
            for byte in [0, b'\n', b' ', b'9', b'-', 0x7f, 0xff] {
                let mut changed = sample.clone();
                changed[at] = byte;
                read_anything(&changed);
            }
        }
    }
}

/// Header lines and data as a fuzzer would put them together, valid often enough to reach the data.
fn any_file() -> impl Strategy<Value = Vec<u8>> {
    let count = || prop_oneof![4 => 0_u64..9, 1 => any::<u64>(), 1 => Just(1 << 28)];
    let points = prop_oneof![
        Just("property float x\nproperty float y\nproperty float z\n"),
        Just("property char x\nproperty short y\nproperty double z\nproperty list int char ids\n"),
        Just(
            "property uint x\nproperty uchar y\nproperty int z\nproperty float r\nproperty float g\nproperty double b\n"
        ),
    ];
    let other = prop_oneof![
        Just("element face 2\nproperty list uchar ushort ids\n"),
        Just("element camera 1\nproperty float view_px\nproperty char view_py\nproperty char view_pz\n"),
        Just("element big 18446744073709551615\nproperty char x\n"),
        Just(""),
    ];
    let format = prop_oneof![Just("ascii"), Just("binary_little_endian"), Just("binary_big_endian")];
    let body = proptest::collection::vec(
        prop_oneof![any::<u8>(), Just(0), Just(b'1'), Just(b' '), Just(b'\n')],
        0..300,
    );
    (points, other, any::<bool>(), count(), format, body).prop_map(
        |(points, other, first, count, format, body)| {
            let vertex = format!("element vertex {count}\n{points}");
            let elements = if first { format!("{vertex}{other}") } else { format!("{other}{vertex}") };
            [format!("ply\nformat {format} 1.0\n{elements}end_header\n").as_bytes(), &body].concat()
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn arbitrary_bytes_are_survived(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        read_anything(&[b"ply\n", &bytes[..]].concat());
    }

    #[test]
    fn arbitrary_data_behind_a_header_is_survived(file in any_file()) {
        read_anything(&file);
    }
}
