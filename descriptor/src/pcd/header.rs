//! The text header of a PCD file: which fields there are, how many points, and where the data starts.

use super::error::PcdError;
use crate::header_text::{MAX_HEADER_BYTES, shown};

/// A point takes fewer bytes than this.
const MAX_POINT_BYTES: u64 = 1 << 31;

/// How the points are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DataEncoding {
    /// Decimal text, a point on each line.
    Ascii,
    /// Little-endian values, point by point.
    Binary,
    /// LZF-compressed little-endian values, field by field.
    BinaryCompressed,
}

impl DataEncoding {
    /// The word after DATA.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ascii => "ascii",
            Self::Binary => "binary",
            Self::BinaryCompressed => "binary_compressed",
        }
    }
}

/// How one coordinate is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Real {
    /// f32.
    F4,
    /// f64.
    F8,
}

/// How a packed colour is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Packed {
    /// The bits of an f32; as text, that number.
    F4,
    /// A u32.
    U4,
}

/// Names of separate colour values.
pub(super) const COMPONENTS: [&str; 3] = ["r", "g", "b"];

/// How one of three separate colour values is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Component {
    /// f32 from 0 to 1.
    F4,
    /// u8.
    U1,
}

/// Where a point's colour is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Colour {
    /// In rgb or rgba.
    Packed(Slot<Packed>),
    /// In r, g and b.
    Separate([Slot<Component>; 3]),
}

/// Where a field stands within a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Slot<T> {
    /// Its type.
    pub of: T,
    /// Bytes before it in a binary point.
    pub byte: usize,
    /// Values before it on an ascii line.
    pub value: usize,
}

/// A header that is consistent in itself. `points` × `point_bytes` is not yet checked against the data.
#[derive(Debug)]
pub(super) struct Header {
    /// Positions of x, y and z.
    pub xyz: [Slot<Real>; 3],
    /// Position of rgb or rgba, or else of r, g and b.
    pub colour: Option<Colour>,
    /// Bytes of one binary point.
    pub point_bytes: u64,
    /// Values of one ascii point.
    pub point_values: u64,
    /// POINTS = WIDTH × HEIGHT.
    pub points: u64,
    /// Translation of VIEWPOINT.
    pub viewpoint: [f32; 3],
    /// DATA.
    pub data: DataEncoding,
    /// First byte of the data.
    pub data_start: usize,
    /// Its line, counted from 1.
    pub data_line: usize,
}

const KEYWORDS: [&str; 10] =
    ["VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA"];

/// The lines of a header as text, by keyword.
struct Lines<'a> {
    rest: [Option<&'a str>; KEYWORDS.len()],
    data_start: usize,
    data_line: usize,
}

impl<'a> Lines<'a> {
    fn read(bytes: &'a [u8]) -> Result<Self, PcdError> {
        let mut lines = Self { rest: [None; KEYWORDS.len()], data_start: 0, data_line: 1 };
        let bounded = &bytes[..bytes.len().min(MAX_HEADER_BYTES)];
        loop {
            let line_start = lines.data_start;
            let unread = &bounded[line_start..];
            // A file without points may end with its DATA line; any other line ends with a line break.
            let length = match unread.iter().position(|&byte| byte == b'\n') {
                Some(length) => length,
                None if bounded.len() == bytes.len() && !unread.is_empty() => unread.len(),
                None => return Err(PcdError::NoDataLine),
            };
            let number = lines.data_line;
            lines.data_start = (line_start + length + 1).min(bytes.len());
            lines.data_line += 1;
            let line = unread[..length].trim_ascii();
            if line.is_empty() || line[0] == b'#' {
                continue;
            }
            let line = str::from_utf8(line).map_err(|_| PcdError::NotText { line: number })?;
            let (word, rest) = line.split_once([' ', '\t']).unwrap_or((line, ""));
            let Some(at) = KEYWORDS.iter().position(|&keyword| keyword == word) else {
                return Err(PcdError::UnknownLine { line: number, got: shown(word) });
            };
            if lines.rest[at].replace(rest.trim()).is_some() {
                return Err(PcdError::RepeatedLine { keyword: KEYWORDS[at], line: number });
            }
            if word == "DATA" {
                return Ok(lines);
            }
        }
    }

    fn optional(&self, keyword: &str) -> Option<&'a str> {
        KEYWORDS.iter().position(|&other| other == keyword).and_then(|at| self.rest[at])
    }

    fn get(&self, keyword: &'static str) -> Result<&'a str, PcdError> {
        self.optional(keyword).ok_or(PcdError::MissingLine { keyword })
    }

    fn count(&self, keyword: &'static str) -> Result<u64, PcdError> {
        let text = self.get(keyword)?;
        text.parse().map_err(|_| PcdError::BadLine {
            keyword,
            expected: "a whole number from 0 to 2^64 - 1 expected",
            got: shown(text),
        })
    }
}

/// One of FIELDS with its SIZE, TYPE and COUNT.
#[derive(Clone, Copy)]
struct Field<'a> {
    name: &'a str,
    size: u64,
    kind: char,
    count: u64,
}

impl Field<'_> {
    fn error(&self, expected: &'static str) -> PcdError {
        let got = format!("{}{} with COUNT {}", self.kind, self.size, self.count);
        PcdError::FieldType { name: self.name.to_owned(), expected, got }
    }

    fn real(&self) -> Result<Real, PcdError> {
        match (self.kind, self.size, self.count) {
            ('F', 4, 1) => Ok(Real::F4),
            ('F', 8, 1) => Ok(Real::F8),
            _ => Err(self.error("F4 or F8 with COUNT 1")),
        }
    }

    fn component(&self) -> Result<Component, PcdError> {
        match (self.kind, self.size, self.count) {
            ('F', 4, 1) => Ok(Component::F4),
            ('U', 1, 1) => Ok(Component::U1),
            _ => Err(self.error("U1 or F4 with COUNT 1")),
        }
    }

    fn packed(&self) -> Result<Packed, PcdError> {
        match (self.kind, self.size, self.count) {
            ('F', 4, 1) => Ok(Packed::F4),
            ('U', 4, 1) => Ok(Packed::U4),
            _ => Err(self.error("F4 or U4 with COUNT 1")),
        }
    }
}

/// The header at the start of a file.
pub(super) fn read(bytes: &[u8]) -> Result<Header, PcdError> {
    let lines = Lines::read(bytes)?;
    if let Some(version) = lines.optional("VERSION")
        && !["0.7", ".7"].contains(&version)
    {
        return Err(PcdError::BadLine { keyword: "VERSION", expected: "0.7 expected", got: shown(version) });
    }
    let data = match lines.get("DATA")? {
        "ascii" => DataEncoding::Ascii,
        "binary" => DataEncoding::Binary,
        "binary_compressed" => DataEncoding::BinaryCompressed,
        other => {
            let expected = "ascii, binary or binary_compressed expected";
            return Err(PcdError::BadLine { keyword: "DATA", expected, got: shown(other) });
        }
    };
    let fields = read_fields(&lines)?;
    let (width, height) = (lines.count("WIDTH")?, lines.count("HEIGHT")?);
    let points = lines.count("POINTS")?;
    if width.checked_mul(height) != Some(points) {
        return Err(PcdError::PointCount { width, height, points });
    }

    let (mut xyz, mut packed, mut separate) = ([None; 3], None, [None; 3]);
    // A single letter may stand for anything, as r for a radius: all three are colours, if nothing else is.
    let has = |name: &&str| fields.iter().any(|field| field.name == *name);
    let is_separate = COMPONENTS.iter().all(has) && !["rgb", "rgba"].iter().any(has);
    let (mut byte, mut value) = (0_u64, 0_u64);
    for field in &fields {
        let (at_byte, at_value) = (byte as usize, value as usize);
        let coordinate = |of| Some(Slot { of, byte: at_byte, value: at_value });
        match field.name {
            "x" => xyz[0] = coordinate(field.real()?),
            "y" => xyz[1] = coordinate(field.real()?),
            "z" => xyz[2] = coordinate(field.real()?),
            "rgb" | "rgba" => {
                let slot = Slot { of: field.packed()?, byte: at_byte, value: at_value };
                if packed.replace(slot).is_some() {
                    return Err(PcdError::TwoColours);
                }
            }
            name if is_separate => {
                if let Some(component) = COMPONENTS.iter().position(|known| *known == name) {
                    separate[component] =
                        Some(Slot { of: field.component()?, byte: at_byte, value: at_value });
                }
            }
            _ => {}
        }
        // Bounded, so that no later sum or product of a few of them overflows.
        let bytes = field.size.checked_mul(field.count).and_then(|bytes| byte.checked_add(bytes));
        byte = bytes.filter(|&bytes| bytes < MAX_POINT_BYTES).ok_or_else(|| PcdError::BadLine {
            keyword: "COUNT",
            expected: "points of less than 2^31 bytes expected",
            got: shown(lines.optional("COUNT").unwrap_or_default()),
        })?;
        value += field.count;
    }
    let colour = match (packed, separate) {
        (Some(slot), _) => Some(Colour::Packed(slot)),
        (None, [Some(red), Some(green), Some(blue)]) => Some(Colour::Separate([red, green, blue])),
        _ => None,
    };
    let need = |slot: Option<Slot<Real>>, name| slot.ok_or(PcdError::MissingField { name });
    Ok(Header {
        xyz: [need(xyz[0], "x")?, need(xyz[1], "y")?, need(xyz[2], "z")?],
        colour,
        point_bytes: byte,
        point_values: value,
        points,
        viewpoint: read_viewpoint(lines.optional("VIEWPOINT"))?,
        data,
        data_start: lines.data_start,
        data_line: lines.data_line,
    })
}

fn read_fields<'a>(lines: &Lines<'a>) -> Result<Vec<Field<'a>>, PcdError> {
    let mut fields: Vec<Field> = lines
        .get("FIELDS")?
        .split_ascii_whitespace()
        .map(|name| Field { name, size: 0, kind: ' ', count: 1 })
        .collect();
    let mut names: Vec<&str> = fields.iter().map(|field| field.name).collect();
    names.sort_unstable();
    // PCL names padding `_`, as often as there is padding.
    if let Some(pair) = names.windows(2).find(|pair| pair[0] == pair[1] && pair[0] != "_") {
        return Err(PcdError::RepeatedField { name: shown(pair[0]) });
    }

    for (field, text) in fields.iter_mut().zip(one_per_field("SIZE", lines.get("SIZE")?, names.len())?) {
        field.size = match text {
            "1" => 1,
            "2" => 2,
            "4" => 4,
            "8" => 8,
            _ => {
                let expected = "1, 2, 4 or 8 bytes expected";
                return Err(PcdError::BadLine { keyword: "SIZE", expected, got: shown(text) });
            }
        };
    }
    for (field, text) in fields.iter_mut().zip(one_per_field("TYPE", lines.get("TYPE")?, names.len())?) {
        field.kind = match text {
            "I" => 'I',
            "U" => 'U',
            "F" => 'F',
            _ => {
                let expected = "I, U or F expected";
                return Err(PcdError::BadLine { keyword: "TYPE", expected, got: shown(text) });
            }
        };
    }
    if let Some(line) = lines.optional("COUNT") {
        for (field, text) in fields.iter_mut().zip(one_per_field("COUNT", line, names.len())?) {
            field.count = text.parse().ok().filter(|&count| count >= 1).ok_or_else(|| PcdError::BadLine {
                keyword: "COUNT",
                expected: "whole numbers from 1 expected",
                got: shown(text),
            })?;
        }
    }
    Ok(fields)
}

fn one_per_field<'a>(
    keyword: &'static str,
    line: &'a str,
    expected: usize,
) -> Result<impl Iterator<Item = &'a str>, PcdError> {
    let got = line.split_ascii_whitespace().count();
    if got != expected {
        return Err(PcdError::FieldCount { keyword, expected, got });
    }
    Ok(line.split_ascii_whitespace())
}

fn read_viewpoint(line: Option<&str>) -> Result<[f32; 3], PcdError> {
    let Some(line) = line else { return Ok([0.0; 3]) };
    let bad = || PcdError::BadLine {
        keyword: "VIEWPOINT",
        expected: "three finite numbers and a quaternion expected",
        got: shown(line),
    };
    let mut words = line.split_ascii_whitespace();
    let mut viewpoint = [0.0; 3];
    for coordinate in &mut viewpoint {
        let value = words.next().and_then(|word| word.parse::<f32>().ok());
        *coordinate = value.filter(|value| value.is_finite()).ok_or_else(bad)?;
    }
    Ok(viewpoint)
}
