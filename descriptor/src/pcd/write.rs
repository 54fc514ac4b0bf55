//! Writing a cloud as PCD 0.7.

use std::fmt::Write;

use super::header::DataEncoding;
use crate::Cloud;

/// The bytes of a PCD 0.7 file that [`super::read`] turns back into `cloud`, bit for bit.
///
/// Fields are x, y, z (F4) and, with colours, rgb: F4 in binary, as most readers expect it, and U4 in ascii,
/// as PCL writes it, because the float would be a denormal that some readers take for 0. The cloud is
/// unorganised (HEIGHT 1); its rotation is not known and written as none. PCD's 32-bit sizes hold up to
/// 2^28 - 1 compressed points.
pub fn write(cloud: &Cloud, encoding: DataEncoding) -> Vec<u8> {
    let mut bytes = header(cloud, encoding).into_bytes();
    match encoding {
        DataEncoding::Ascii => bytes.extend_from_slice(ascii(cloud).as_bytes()),
        DataEncoding::Binary => {
            for (index, point) in cloud.points.iter().enumerate() {
                bytes.extend(point.iter().flat_map(|coordinate| coordinate.to_le_bytes()));
                if let Some(colours) = &cloud.colours {
                    bytes.extend(packed(colours[index]).to_le_bytes());
                }
            }
        }
        DataEncoding::BinaryCompressed => {
            let plain = by_field(cloud);
            let compressed = compress(&plain);
            bytes.extend((compressed.len() as u32).to_le_bytes());
            bytes.extend((plain.len() as u32).to_le_bytes());
            bytes.extend(compressed);
        }
    }
    bytes
}

fn header(cloud: &Cloud, encoding: DataEncoding) -> String {
    let points = cloud.len();
    let [x, y, z] = cloud.viewpoint;
    let (name, size, kind, count) = match (&cloud.colours, encoding) {
        (None, _) => ("", "", "", ""),
        (Some(_), DataEncoding::Ascii) => (" rgb", " 4", " U", " 1"),
        (Some(_), _) => (" rgb", " 4", " F", " 1"),
    };
    format!(
        "# .PCD v0.7 - Point Cloud Data file format\n\
         VERSION 0.7\n\
         FIELDS x y z{name}\n\
         SIZE 4 4 4{size}\n\
         TYPE F F F{kind}\n\
         COUNT 1 1 1{count}\n\
         WIDTH {points}\n\
         HEIGHT 1\n\
         VIEWPOINT {x} {y} {z} 1 0 0 0\n\
         POINTS {points}\n\
         DATA {}\n",
        encoding.name()
    )
}

fn packed([red, green, blue]: [u8; 3]) -> u32 {
    u32::from_be_bytes([0, red, green, blue])
}

fn ascii(cloud: &Cloud) -> String {
    let mut text = String::new();
    for (index, [x, y, z]) in cloud.points.iter().enumerate() {
        // Writing to a string cannot fail; `{}` prints the shortest text that reads back as the same f32.
        let _ = write!(text, "{x} {y} {z}");
        if let Some(colours) = &cloud.colours {
            let _ = write!(text, " {}", packed(colours[index]));
        }
        text.push('\n');
    }
    text
}

/// All x, then all y, all z and all colours.
fn by_field(cloud: &Cloud) -> Vec<u8> {
    let mut plain = Vec::with_capacity(16 * cloud.len());
    for axis in 0..3 {
        plain.extend(cloud.points.iter().flat_map(|point| point[axis].to_le_bytes()));
    }
    if let Some(colours) = &cloud.colours {
        plain.extend(colours.iter().flat_map(|&colour| packed(colour).to_le_bytes()));
    }
    plain
}

/// LZF, or literal runs (a length less one and up to 32 bytes, which any LZF reader takes) for data that does
/// not shrink.
fn compress(plain: &[u8]) -> Vec<u8> {
    lzf::compress(plain).unwrap_or_else(|_| {
        plain
            .chunks(32)
            .flat_map(|run| std::iter::once(run.len() as u8 - 1).chain(run.iter().copied()))
            .collect()
    })
}
