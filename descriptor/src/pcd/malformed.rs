//! Damaged PCD files: each is refused with a message, before memory is asked for.

use expect_test::{Expect, expect};
use proptest::prelude::*;

use super::{DataEncoding, PcdError, read, write};
use crate::Cloud;

const HEADER: &str = "VERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 2\n\
                      HEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA ascii\n";
const POINTS: &str = "0 0 1 255\n0 0 2 65280\n";

fn check(bytes: &[u8], expected: Expect) {
    expected.assert_eq(&read(bytes).unwrap_err().to_string());
}

/// A valid ascii file with `from` replaced by `to`.
fn check_edit(from: &str, to: &str, expected: Expect) {
    let file = format!("{HEADER}{POINTS}");
    assert!(read(file.as_bytes()).is_ok() && file.contains(from));
    check(file.replacen(from, to, 1).as_bytes(), expected);
}

/// A valid binary_compressed file of two points with its two sizes replaced.
fn with_sizes(header: &str, compressed: u32, uncompressed: u32, lzf: &[u8]) -> Vec<u8> {
    let header = header.replace("DATA ascii", "DATA binary_compressed");
    [header.as_bytes(), &compressed.to_le_bytes(), &uncompressed.to_le_bytes(), lzf].concat()
}

#[test]
fn files_that_are_no_pcd_files() {
    let no_data_line = expect![[r#"
        pcd header: DATA: line expected within the first 65536 bytes, got none
        the file is not a PCD file, or its header is cut off"#]];
    no_data_line.assert_eq(&read(b"").unwrap_err().to_string());
    no_data_line.assert_eq(&read(&HEADER.as_bytes()[..60]).unwrap_err().to_string());
    no_data_line.assert_eq(&read(&vec![b'#'; 1 << 20]).unwrap_err().to_string());
    no_data_line.assert_eq(&read("# no end\n".repeat(1 << 16).as_bytes()).unwrap_err().to_string());
    check(
        b"\x89PNG\r\n\x1a\n",
        expect![[r#"
            pcd header: line 1: UTF-8 text expected, got other bytes
            the file is not a PCD file, or it is damaged: write it again"#]],
    );
    check(
        b"# a mesh\nply\nformat ascii 1.0\n",
        expect![[r#"
            pcd header: line 2: one of VERSION, FIELDS, SIZE, TYPE, COUNT, WIDTH, HEIGHT, VIEWPOINT, POINTS, DATA expected, got ply
            remove the line or put # in front of it"#]],
    );
}

#[test]
fn header_lines_with_wrong_values() {
    let correct = "correct the line, or write the file again as PCD 0.7";
    for (from, to, message) in [
        ("VERSION 0.7", "VERSION 0.5", "pcd header: VERSION: 0.7 expected, got 0.5"),
        ("DATA ascii", "DATA", "pcd header: DATA: ascii, binary or binary_compressed expected, got nothing"),
        ("SIZE 4 4", "SIZE 4 3", "pcd header: SIZE: 1, 2, 4 or 8 bytes expected, got 3"),
        ("SIZE 4 4", "SIZE 4", "pcd header: SIZE: 4 values expected, one for each of FIELDS, got 3"),
        ("TYPE F F", "TYPE F D", "pcd header: TYPE: I, U or F expected, got D"),
        ("TYPE F F", "TYPE F F F", "pcd header: TYPE: 4 values expected, one for each of FIELDS, got 5"),
        ("COUNT 1 1", "COUNT 1 0", "pcd header: COUNT: whole numbers from 1 expected, got 0"),
        ("COUNT 1 1", "COUNT 1 -1", "pcd header: COUNT: whole numbers from 1 expected, got -1"),
        ("COUNT 1 1", "COUNT 1", "pcd header: COUNT: 4 values expected, one for each of FIELDS, got 3"),
        ("WIDTH 2", "WIDTH -2", "pcd header: WIDTH: a whole number from 0 to 2^64 - 1 expected, got -2"),
        ("HEIGHT 1", "HEIGHT one", "pcd header: HEIGHT: a whole number from 0 to 2^64 - 1 expected, got one"),
        (
            "VIEWPOINT 0 0 0 1 0 0 0",
            "VIEWPOINT 0 0",
            "pcd header: VIEWPOINT: three finite numbers and a quaternion expected, got 0 0",
        ),
        (
            "VIEWPOINT 0 0 0",
            "VIEWPOINT 0 nan 0",
            "pcd header: VIEWPOINT: three finite numbers and a quaternion expected, got 0 nan 0 1 0 0 0",
        ),
    ] {
        let file = format!("{HEADER}{POINTS}").replacen(from, to, 1);
        assert_eq!(read(file.as_bytes()).unwrap_err().to_string(), format!("{message}\n{correct}"));
    }
    let long = format!("WIDTH {}\u{1b}[2J", "9".repeat(50));
    check_edit(
        "WIDTH 2",
        &long,
        expect![[r#"
            pcd header: WIDTH: a whole number from 0 to 2^64 - 1 expected, got 9999999999999999999999999999999999999999…
            correct the line, or write the file again as PCD 0.7"#]],
    );
}

#[test]
fn header_lines_missing_or_repeated() {
    for keyword in ["FIELDS", "SIZE", "TYPE", "WIDTH", "HEIGHT", "POINTS"] {
        let file = format!("{HEADER}{POINTS}").replacen(keyword, "# ", 1);
        assert_eq!(read(file.as_bytes()), Err(PcdError::MissingLine { keyword }));
    }
    check_edit(
        "SIZE 4 4 4 4",
        "",
        expect![[r#"
            pcd header: SIZE: line expected, got none
            add it, or write the file again as PCD 0.7"#]],
    );
    check_edit(
        "POINTS 2",
        "WIDTH 2",
        expect![[r#"
            pcd header: WIDTH: one line expected, got another at line 9
            keep the right one"#]],
    );
}

#[test]
fn fields_that_cannot_be_used() {
    check_edit(
        "FIELDS x y z",
        "FIELDS x y range",
        expect![[r#"
            pcd header: FIELDS: x, y and z expected, got no z
            write the cloud with its positions"#]],
    );
    check_edit(
        "FIELDS x y z rgb",
        "FIELDS x y z x",
        expect![[r#"
            pcd header: FIELDS: each name once expected, got x twice
            remove or rename one of them"#]],
    );
    let two = format!("{HEADER}{POINTS}").replace("rgb", "rgb rgba").replace("4 4\n", "4 4 4\n");
    check(
        two.replace("F U\n", "F U U\n").replace("1 1 1 1\n", "1 1 1 1 1\n").as_bytes(),
        expect![[r#"
            pcd header: FIELDS: rgb or rgba expected, got both
            remove one of them"#]],
    );
    check_edit(
        "TYPE F F F",
        "TYPE F I F",
        expect![[r#"
            pcd header: y: F4 or F8 with COUNT 1 expected, got I4 with COUNT 1
            write the field with that size, type and count"#]],
    );
    check_edit(
        "COUNT 1 1 1 1",
        "COUNT 1 1 1 3",
        expect![[r#"
            pcd header: rgb: F4 or U4 with COUNT 1 expected, got U4 with COUNT 3
            write the field with that size, type and count"#]],
    );
    for count in ["600000000", "18446744073709551615"] {
        let file = HEADER.replace("rgb", "map").replace("COUNT 1 1 1 1", &format!("COUNT 1 1 1 {count}"));
        let error = read(file.as_bytes()).unwrap_err();
        assert!(matches!(error, PcdError::BadLine { keyword: "COUNT", .. }), "{error}");
    }
}

#[test]
fn counts_that_the_data_denies() {
    check_edit(
        "WIDTH 2",
        "WIDTH 3",
        expect![[r#"
            pcd header: POINTS: WIDTH × HEIGHT = 3 × 1 expected, got 2
            correct the wrong one of the three"#]],
    );
    let huge = |points: u64| {
        HEADER.replace("WIDTH 2", &format!("WIDTH {points}")).replace("POINTS 2", &format!("POINTS {points}"))
    };
    // The product of the true sizes is 2^64 and would be 0 in 64 bits.
    let overflow = HEADER.replace("WIDTH 2", "WIDTH 4294967296").replace("HEIGHT 1", "HEIGHT 4294967296");
    let error = read(overflow.replace("POINTS 2", "POINTS 0").as_bytes()).unwrap_err();
    assert!(matches!(error, PcdError::PointCount { points: 0, .. }), "{error}");
    for points in [3, 1 << 40, 1 << 60, u64::MAX] {
        for encoding in ["ascii", "binary"] {
            let file = huge(points).replace("DATA ascii", &format!("DATA {encoding}")) + POINTS;
            let error = read(file.as_bytes()).unwrap_err();
            assert!(matches!(error, PcdError::Truncated { .. }), "{error}");
        }
        let error = read(&with_sizes(&huge(points), 4, 32, &[0; 4])).unwrap_err();
        assert!(matches!(error, PcdError::UncompressedSize { got: 32, .. }), "{error}");
    }
    check(
        (huge(1 << 40).replace("ascii", "binary") + POINTS).as_bytes(),
        expect![[r#"
            pcd data: 1099511627776 points of at least 16 bytes expected, got 22 bytes
            the file is cut off or its WIDTH, HEIGHT and POINTS are wrong: copy or write it again"#]],
    );
}

#[test]
fn ascii_data_that_does_not_fit_the_header() {
    check_edit(
        "0 0 1 255\n",
        "",
        expect![[r#"
            pcd data: 2 points of at least 8 bytes expected, got 12 bytes
            the file is cut off or its WIDTH, HEIGHT and POINTS are wrong: copy or write it again"#]],
    );
    check_edit(
        "0 0 1 255\n",
        "# 0 0 1 255\n",
        expect![[r#"
            pcd data: 2 points expected, got 1
            the file is cut off or its WIDTH, HEIGHT and POINTS are wrong: copy or write it again"#]],
    );
    check_edit(
        "0 0 1 255\n",
        "0 0 1 255\n0 0 3 0\n",
        expect![[r#"
            pcd data: 2 points expected, got 3
            the file is cut off or its WIDTH, HEIGHT and POINTS are wrong: copy or write it again"#]],
    );
    check_edit(
        "2 65280",
        "2",
        expect![[r#"
            pcd data: line 12: 4 values expected, got 3
            correct the line, or write the file again"#]],
    );
    check_edit(
        "\n0 0 1 2",
        "\n0 1,5 1 2",
        expect![[r#"
            pcd data: line 11: y: a number expected, got 1,5
            correct the value, or write the file again"#]],
    );
    check_edit(
        "255",
        "4294967296",
        expect![[r#"
            pcd data: line 11: rgb: a whole number below 2^32 expected, got 4294967296
            correct the value, or write the file again"#]],
    );
    check(
        format!("{HEADER}{POINTS}").replace("F U", "F F").replace("255", "-nan").as_bytes(),
        expect![[r#"
            pcd data: line 11: rgb: a number whose bits are the colour expected, got -nan
            correct the value, or write the file again"#]],
    );
}

#[test]
fn binary_data_that_does_not_fit_the_header() {
    let header = HEADER.replace("ascii", "binary");
    check(
        &[header.as_bytes(), &[1; 31]].concat(),
        expect![[r#"
            pcd data: 2 points of at least 16 bytes expected, got 31 bytes
            the file is cut off or its WIDTH, HEIGHT and POINTS are wrong: copy or write it again"#]],
    );
    check(
        &[header.as_bytes(), &[1; 48]].concat(),
        expect![[r#"
            pcd data: end of file after 2 points expected, got 16 bytes more
            WIDTH, HEIGHT and POINTS or the fields are wrong: correct the header or write the file again"#]],
    );
}

#[test]
fn compressed_data_that_does_not_fit_the_header() {
    check(
        &with_sizes(HEADER, 0, 32, &[])[..HEADER.len() + "binary_compressed".len() - "ascii".len() + 7],
        expect![[r#"
            pcd data: compressed and uncompressed size (8 bytes) expected, got 7 bytes
            the file is cut off: copy or write it again"#]],
    );
    check(
        &with_sizes(HEADER, 5, 32, &[0; 4]),
        expect![[r#"
            pcd data: 5 compressed bytes expected, got 4
            the file is cut off or damaged: copy or write it again"#]],
    );
    check(
        &with_sizes(HEADER, 4, 33, &[0; 4]),
        expect![[r#"
            pcd data: uncompressed size 32 expected from the header, got 33
            WIDTH, HEIGHT and POINTS or the fields are wrong: correct the header or write the file again"#]],
    );
    let many = HEADER.replace("WIDTH 2", "WIDTH 268435455").replace("POINTS 2", "POINTS 268435455");
    check(
        &with_sizes(&many, 4, 4294967280, &[0; 4]),
        expect![[r#"
            pcd data: at most 268435456 uncompressed bytes expected, got 4294967280
            cut out the object, or thin the cloud"#]],
    );
    let damaged = expect![[r#"
        pcd data: 32 bytes of LZF data expected, got damaged ones
        copy or write the file again"#]];
    // Too short a result, too long a one, a copy from before the start, a literal run cut off.
    for lzf in [[0, 7, 0, 7, 0, 7], [0, 7, 0xe0, 40, 0, 9], [0, 7, 0x20, 9, 0, 7], [31, 7, 7, 7, 7, 7]] {
        damaged.assert_eq(&read(&with_sizes(HEADER, 6, 32, &lzf)).unwrap_err().to_string());
    }
    check(
        &with_sizes(HEADER, 6, 32, &[0, 0, 0xe0, 22, 0, 0, 1]),
        expect![[r#"
            pcd data: end of file after 2 points expected, got 1 bytes more
            WIDTH, HEIGHT and POINTS or the fields are wrong: correct the header or write the file again"#]],
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
        assert!(memory <= bytes.len() * 110, "{memory} bytes for {}", bytes.len());
    }
}

fn sample(encoding: DataEncoding) -> Vec<u8> {
    let points: Vec<[f32; 3]> =
        (0..40_u8).map(|index| [f32::from(index) / 64.0, f32::from(index % 7), 1.0]).collect();
    let colours = Some((0..40).map(|index| [index, 2 * index, 200]).collect());
    write(&Cloud { points, colours, viewpoint: [0.0, 0.5, 0.0] }, encoding)
}

#[test]
fn every_cut_of_a_file_is_refused_and_every_changed_byte_is_survived() {
    for encoding in [DataEncoding::Ascii, DataEncoding::Binary, DataEncoding::BinaryCompressed] {
        let whole = sample(encoding);
        // An ascii file may lose the end of its last number.
        let last = whole.len() - if encoding == DataEncoding::Ascii { 7 } else { 0 };
        for length in 0..whole.len() {
            assert!(length >= last || read(&whole[..length]).is_err(), "{encoding:?} cut at {length}");
            read_anything(&whole[..length]);
        }
        for at in 0..whole.len() {
            for byte in [0, b'\n', b' ', b'9', b'-', 0x1f, 0x20, 0x7f, 0xe0, 0xff] {
                let mut changed = whole.clone();
                changed[at] = byte;
                read_anything(&changed);
            }
        }
    }
}

/// Header lines and data as a fuzzer would put them together, valid often enough to reach the data.
fn any_file() -> impl Strategy<Value = Vec<u8>> {
    let number = || prop_oneof![4 => 0_u64..9, 1 => any::<u64>(), 1 => Just(1 << 28)];
    let fields = prop_oneof![
        Just("FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\n"),
        Just("FIELDS rgb x y z\nSIZE 4 8 8 8\nTYPE U F F F\n"),
        Just("FIELDS x _ y _ z rgba\nSIZE 4 1 4 8 4 4\nTYPE F I F U F F\n"),
    ];
    let data = prop_oneof![Just("ascii"), Just("binary"), Just("binary_compressed")];
    let body = proptest::collection::vec(prop_oneof![any::<u8>(), Just(0), Just(b'1'), Just(b' ')], 0..300);
    (fields, number(), number(), data, body).prop_map(|(fields, width, height, data, body)| {
        let points = width.wrapping_mul(height);
        let header = format!("{fields}WIDTH {width}\nHEIGHT {height}\nPOINTS {points}\nDATA {data}\n");
        [header.as_bytes(), &body].concat()
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn arbitrary_bytes_are_survived(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        read_anything(&bytes);
    }

    #[test]
    fn arbitrary_data_behind_a_header_is_survived(file in any_file()) {
        read_anything(&file);
    }

    #[test]
    fn arbitrary_lzf_is_survived(points in 0_u32..600, lzf in proptest::collection::vec(any::<u8>(), 0..200)) {
        let header = HEADER.replace("WIDTH 2", &format!("WIDTH {points}"));
        let header = header.replace("POINTS 2", &format!("POINTS {points}"));
        read_anything(&with_sizes(&header, lzf.len() as u32, points * 16, &lzf));
    }
}
