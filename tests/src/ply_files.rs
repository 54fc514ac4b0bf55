//! Clouds as PLY files, as no program here writes them: for tests and fuzz drivers.

use descriptor::Cloud;

/// How the values of a PLY file are stored.
#[derive(Clone, Copy, Debug)]
pub enum PlyFormat {
    /// Text.
    Ascii,
    /// The lowest byte of a value first.
    LittleEndian,
    /// The highest byte of a value first.
    BigEndian,
}

impl PlyFormat {
    /// A file with a list of an element in front of the points, the colours before the positions, and the viewpoint
    /// as PCL's element `camera` behind them.
    pub fn write(self, cloud: &Cloud) -> Vec<u8> {
        let colours = cloud.colours.as_ref();
        let name = match self {
            Self::Ascii => "ascii",
            Self::LittleEndian => "binary_little_endian",
            Self::BigEndian => "binary_big_endian",
        };
        let channels = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
        let mut bytes = format!(
            "ply\nformat {name} 1.0\ncomment of a test\nelement face 1\nproperty list uchar int vertex_indices\n\
             element vertex {}\n{}property float x\nproperty float y\nproperty float z\nelement camera 1\n\
             property float view_px\nproperty float view_py\nproperty float view_pz\nend_header\n",
            cloud.len(),
            colours.map_or("", |_| channels),
        )
        .into_bytes();
        self.row(&mut bytes, &[2], &[7, -1], &[]);
        for (index, point) in cloud.points.iter().enumerate() {
            self.row(&mut bytes, colours.map_or(&[], |colours| &colours[index]), &[], point);
        }
        self.row(&mut bytes, &[], &[], &cloud.viewpoint);
        bytes
    }

    fn row(self, bytes: &mut Vec<u8>, small: &[u8], whole: &[i32], real: &[f32]) {
        match self {
            Self::Ascii => {
                let words = small.iter().map(u8::to_string).chain(whole.iter().map(i32::to_string));
                let words: Vec<String> = words.chain(real.iter().map(f32::to_string)).collect();
                bytes.extend(format!("{}\n", words.join(" ")).into_bytes());
            }
            Self::LittleEndian => {
                bytes.extend(small);
                bytes.extend(whole.iter().flat_map(|value| value.to_le_bytes()));
                bytes.extend(real.iter().flat_map(|value| value.to_le_bytes()));
            }
            Self::BigEndian => {
                bytes.extend(small);
                bytes.extend(whole.iter().flat_map(|value| value.to_be_bytes()));
                bytes.extend(real.iter().flat_map(|value| value.to_be_bytes()));
            }
        }
    }
}
