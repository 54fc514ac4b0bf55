//! The reference of cloud files: every kind of file that is refused, with its message.

use descriptor::cloud_file;
use descriptor::rgbd::{self, Camera, Images};
use png::{BitDepth, ColorType};

/// What is wrong, and a file in which it is.
type Refused = (&'static str, Vec<u8>);

const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
                   property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n\
                   property list uchar int vertex_indices\nend_header\n0 0 1 255 0 0\n0 0 2 0 9 0\n3 0 1 0\n";
const PCD: &str = "VERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 2\nHEIGHT 1\n\
                   VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA ascii\n0 0 1 255\n0 0 2 65280\n";

/// A valid file with `from` replaced by `to`.
fn edited(valid: &str, from: &str, to: &str) -> Vec<u8> {
    cloud_file::read(valid.as_bytes()).unwrap();
    assert!(valid.contains(from), "{from}");
    valid.replacen(from, to, 1).into_bytes()
}

fn ply_files() -> Vec<Refused> {
    let (head, data) = PLY.split_at(PLY.find("end_header").unwrap());
    [
        ("the header is cut off", data, ""),
        ("another version", "ascii 1.0", "ascii 1.1"),
        ("no format", "format ascii 1.0\n", ""),
        ("no points", "element vertex", "element point"),
        ("a property twice", "green", "red"),
        ("an element without properties", "property list uchar int vertex_indices\n", ""),
        ("a position or colour that is not whole", "uchar blue", "uchar alpha"),
        ("colours twice", "uchar red\n", "uchar red\nproperty uchar r\nproperty uchar g\nproperty uchar b\n"),
        ("colours of a type that none has", "uchar red", "int red"),
        (
            "several cameras",
            "element face 1\nproperty list uchar int vertex_indices",
            "element camera 2\nproperty int view_px\nproperty int view_py\nproperty int view_pz",
        ),
        ("more points than the file can hold", "vertex 2", "vertex 2000"),
        ("rows that are missing", "face 1", "face 2"),
        ("rows that nobody has announced", "face 1", "face 0"),
        ("a line with a value too few or too many", "0 0 2 0 9 0", "0 0 2 0 9"),
        ("a value that is no number", "0 0 2 0", "0 0,5 2 0"),
        ("a colour out of range", "255", "256"),
    ]
    .map(|(what, from, to)| (what, edited(&format!("{head}{data}"), from, to)))
    .into()
}

/// A PCD file with other data, of another encoding.
fn with_data(header: &str, encoding: &str, data: &[u8]) -> Vec<u8> {
    let (header, _) = header.split_once("DATA ").unwrap();
    [format!("{header}DATA {encoding}\n").as_bytes(), data].concat()
}

/// A PCD file of compressed data that begins with its two sizes.
fn compressed(header: &str, sizes: [u32; 2], data: &[u8]) -> Vec<u8> {
    with_data(header, "binary_compressed", &[&sizes.map(u32::to_le_bytes).concat(), data].concat())
}

/// Points of 16 bytes, one more than 256 MiB hold.
const HUGE: u32 = (256 << 20) / 16 + 1;

fn pcd_files() -> Vec<Refused> {
    let many = PCD.replace("WIDTH 2", "WIDTH 2000").replace("POINTS 2", "POINTS 2000");
    let [width, points] = ["WIDTH", "POINTS"].map(|key| (format!("{key} 2"), format!("{key} {HUGE}")));
    let huge = PCD.replace(&width.0, &width.1).replace(&points.0, &points.1);
    let two = PCD.replace("rgb", "rgb rgba").replace("4 4\n", "4 4 4\n").replace("U\n", "U U\n");
    let separate = PCD
        .replace("rgb", "r g b")
        .replace("4 4\n", "4 4 4 4\n")
        .replace("U\n", "F F F\n")
        .replace("1 1\n", "1 1 1 1\n");
    let edits = [
        ("the header is cut off", &PCD[PCD.find("DATA").unwrap()..], ""),
        ("another version", "VERSION 0.7", "VERSION 0.5"),
        ("a line of the header twice", "POINTS 2", "WIDTH 2"),
        ("a line of the header missing", "SIZE 4 4 4 4\n", ""),
        ("more or fewer types than fields", "SIZE 4 4", "SIZE 4"),
        ("no position", "FIELDS x y z", "FIELDS x y range"),
        ("a field twice", "FIELDS x y z rgb", "FIELDS x y z x"),
        ("a field of a type that none has", "TYPE F F F", "TYPE F I F"),
        ("counts that contradict each other", "WIDTH 2", "WIDTH 3"),
        ("a point too few or too many", "0 0 1 255\n", "# 0 0 1 255\n"),
        ("a line with a value too few or too many", "2 65280", "2"),
        ("a value that is no number", "\n0 0 1 2", "\n0 0,5 1 2"),
    ];
    let mut files: Vec<Refused> = vec![
        ("another kind of file", b"0.25 0.5 1\n0.5 0.5 1\n".to_vec()),
        ("a picture", b"\x89PNG\r\n\x1a\n".to_vec()),
    ];
    files.extend(edits.map(|(what, from, to)| (what, edited(PCD, from, to))));
    files.extend([
        ("colours twice", two.replace("1 1\n", "1 1 1\n").into_bytes()),
        ("more points than the file can hold", with_data(&many, "binary", &[0; 32])),
        ("more data than points", with_data(PCD, "binary", &[1; 48])),
        ("a colour out of range", with_data(&separate, "binary", &1.5_f32.to_le_bytes().repeat(12))),
        ("compressed data without its sizes", with_data(PCD, "binary_compressed", &[0; 7])),
        ("compressed data that is cut off", compressed(PCD, [5, 32], &[0; 4])),
        ("compressed data of another size", compressed(PCD, [4, 33], &[0; 4])),
        ("compressed data of a cloud that is too large", compressed(&huge, [4, 16 * HUGE], &[0; 4])),
        ("a size that cannot be", compressed(&many, [4, 32_000], &[0; 4])),
        ("compressed data that is damaged", compressed(PCD, [6, 32], &[0, 7, 0, 7, 0, 7])),
    ]);
    files
}

/// A PNG file without a mark on it.
fn png([width, height]: [u32; 2], bits: BitDepth) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(ColorType::Grayscale);
    encoder.set_depth(bits);
    let samples = vec![1; (width * height) as usize * (bits as usize / 8)];
    encoder.write_header().unwrap().write_image_data(&samples).unwrap();
    bytes
}

fn image_files() -> Vec<Refused> {
    let (image, depth) = (png([2, 2], BitDepth::Eight), png([2, 2], BitDepth::Sixteen));
    let good = Camera { focal_length: [570.3; 2], centre: [0.5; 2], depth_unit: 0.001 };
    let images = Images { colour: &image, depth: &depth, mask: &image };
    let valid = rgbd::write(&good, images);
    cloud_file::read(&valid).unwrap();
    let (large, wide) = (png([4097, 4096], BitDepth::Eight), png([3, 2], BitDepth::Eight));
    let of = |images| rgbd::write(&good, images);
    vec![
        ("images that were cut off on their way", valid[..valid.len() - 1].to_vec()),
        ("a camera that sees nothing", rgbd::write(&Camera { focal_length: [0.0; 2], ..good }, images)),
        ("an image of another format", of(Images { colour: b"\xff\xd8\xff\xe0", ..images })),
        ("an image that is too large", of(Images { mask: &large, ..images })),
        ("depth of 8 bits", of(Images { depth: &image, ..images })),
        ("images of different views", of(Images { mask: &wide, ..images })),
    ]
}

/// The tables, and the names of the errors in them, as `Debug` writes them: of PLY files, of PCD files and of images.
pub fn refused() -> (String, [Vec<String>; 3]) {
    let mut page = String::new();
    let names =
        [("PLY", ply_files()), ("PCD", pcd_files()), ("Images", image_files())].map(|(format, files)| {
            page += &format!("\n### {format}\n\n| file | message | what to do |\n|---|---|---|\n");
            let row = |(what, file): Refused| {
                let error = cloud_file::read(&file).expect_err(what);
                let text = error.to_string().replace('|', "\\|");
                let (message, advice) = text.split_once('\n').unwrap();
                page += &format!("| {what} | `{message}` | {advice} |\n");
                // Pcd(NotText { … })
                let name = format!("{error:?}");
                name.split(['(', ' ', ')']).nth(1).unwrap().to_owned()
            };
            files.into_iter().map(row).collect()
        });
    (page, names)
}
