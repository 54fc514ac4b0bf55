//! The text header of a PLY file: which elements there are, of what properties, and where the data starts.

use super::error::PlyError;
use crate::header_text::{MAX_HEADER_BYTES, shown};

/// How the elements are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    /// Decimal text, a row on each line.
    Ascii,
    /// Values one after the other, the lowest byte of each first.
    LittleEndian,
    /// The same with the highest byte first.
    BigEndian,
}

/// Type of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I1,
    U1,
    I2,
    U2,
    I4,
    U4,
    F4,
    F8,
}

impl Scalar {
    /// By either of its names.
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I1,
            "uchar" | "uint8" => Self::U1,
            "short" | "int16" => Self::I2,
            "ushort" | "uint16" => Self::U2,
            "int" | "int32" => Self::I4,
            "uint" | "uint32" => Self::U4,
            "float" | "float32" => Self::F4,
            "double" | "float64" => Self::F8,
            _ => return None,
        })
    }

    fn name(self) -> &'static str {
        match self {
            Self::I1 => "char",
            Self::U1 => "uchar",
            Self::I2 => "short",
            Self::U2 => "ushort",
            Self::I4 => "int",
            Self::U4 => "uint",
            Self::F4 => "float",
            Self::F8 => "double",
        }
    }

    /// Bytes of a value.
    pub(super) fn size(self) -> usize {
        match self {
            Self::I1 | Self::U1 => 1,
            Self::I2 | Self::U2 => 2,
            Self::I4 | Self::U4 | Self::F4 => 4,
            Self::F8 => 8,
        }
    }

    fn is_float(self) -> bool {
        matches!(self, Self::F4 | Self::F8)
    }
}

/// Type of a property.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// One value.
    One(Scalar),
    /// A count and that many values.
    List { count: Scalar, item: Scalar },
}

impl Kind {
    /// Bytes that it takes at least.
    pub(super) fn least_bytes(self) -> usize {
        match self {
            Self::One(scalar) | Self::List { count: scalar, .. } => scalar.size(),
        }
    }

    fn name(self) -> String {
        match self {
            Self::One(scalar) => scalar.name().to_owned(),
            Self::List { count, item } => format!("list {} {}", count.name(), item.name()),
        }
    }
}

/// A property of an element.
#[derive(Clone, Debug)]
pub(super) struct Property {
    pub name: String,
    pub kind: Kind,
}

/// An element: `count` rows of its properties.
#[derive(Clone, Debug)]
pub(super) struct Element {
    pub name: String,
    pub count: u64,
    pub properties: Vec<Property>,
}

impl Element {
    /// Whether all rows take the same number of bytes.
    pub(super) fn is_fixed(&self) -> bool {
        self.properties.iter().all(|property| matches!(property.kind, Kind::One(_)))
    }

    /// Bytes that a binary row takes at least. A header is so short that no sum overflows.
    pub(super) fn least_bytes(&self) -> usize {
        self.properties.iter().map(|property| property.kind.least_bytes()).sum()
    }

    fn position(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|property| property.name == name)
    }

    /// The position and type of a property that is there and no list.
    fn slot(&self, name: &'static str, expected: &'static str) -> Result<Option<Slot>, PlyError> {
        let Some(property) = self.position(name) else { return Ok(None) };
        match self.properties[property].kind {
            Kind::One(of) => Ok(Some(Slot { property, of })),
            list => Err(PlyError::PropertyType { name, expected, got: list.name() }),
        }
    }
}

/// Which property of an element holds a value, and its type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Slot {
    pub property: usize,
    pub of: Scalar,
}

/// What is read of an element's rows: three numbers, and three more in points with colours.
#[derive(Clone, Debug)]
pub(super) struct Wanted {
    /// Position of the point or of the camera.
    pub position: [Slot; 3],
    /// Red, green and blue.
    pub colour: Option<[Slot; 3]>,
}

/// A header that is consistent in itself. Counts are not yet checked against the data.
#[derive(Debug)]
pub(super) struct Header {
    pub format: Format,
    /// In the order of their data.
    pub elements: Vec<Element>,
    /// Which of them has the points.
    pub vertex: usize,
    /// What is read of a point.
    pub points: Wanted,
    /// Which of them is a camera, if there is one, and what is read of it.
    pub camera: Option<(usize, Wanted)>,
    /// First byte of the data.
    pub data_start: usize,
    /// Its line, counted from 1.
    pub data_line: usize,
}

const COLOURS: [[&str; 3]; 3] =
    [["red", "green", "blue"], ["diffuse_red", "diffuse_green", "diffuse_blue"], ["r", "g", "b"]];

/// The header at the start of a file.
pub(super) fn read(bytes: &[u8]) -> Result<Header, PlyError> {
    let bounded = &bytes[..bytes.len().min(MAX_HEADER_BYTES)];
    let (mut format, mut elements) = (None, Vec::<Element>::new());
    let (mut start, mut number) = (0, 0);
    loop {
        let unread = &bounded[start..];
        // A file without points may end with its header; any other line ends with a line feed.
        let length = match unread.iter().position(|&byte| byte == b'\n') {
            Some(length) => length,
            None if bounded.len() == bytes.len() && !unread.is_empty() => unread.len(),
            None => return Err(PlyError::NoEnd),
        };
        number += 1;
        start = (start + length + 1).min(bytes.len());
        let bad = |expected, got: &str| PlyError::BadLine { line: number, expected, got: shown(got) };
        let line = unread[..length].trim_ascii();
        // Comments are in whatever encoding their writer had.
        if number > 1 && (line.is_empty() || line.starts_with(b"comment") || line.starts_with(b"obj_info")) {
            continue;
        }
        let line = str::from_utf8(line).map_err(|_| bad("UTF-8 text expected", "other bytes"))?;
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match (&words[..], number) {
            (["ply"], 1) => {}
            (_, 1) => return Err(bad("ply alone expected", line)),
            (["format", name, "1.0"], _) if format.is_none() => {
                format = Some(match *name {
                    "ascii" => Format::Ascii,
                    "binary_little_endian" => Format::LittleEndian,
                    "binary_big_endian" => Format::BigEndian,
                    _ => {
                        return Err(bad(
                            "format ascii, binary_little_endian or binary_big_endian expected",
                            name,
                        ));
                    }
                });
            }
            (["format", ..], _) => return Err(bad("one format and its version 1.0 expected", line)),
            (["element", name, count], _) => {
                let count =
                    count.parse().map_err(|_| bad("a whole number from 0 to 2^64 - 1 expected", count))?;
                if elements.iter().any(|other| other.name == *name) {
                    return Err(PlyError::Repeated { line: number, name: shown(name) });
                }
                elements.push(Element { name: (*name).to_owned(), count, properties: Vec::new() });
            }
            (["property", kind @ .., name], _) if !kind.is_empty() => {
                let kind =
                    read_kind(kind).ok_or_else(|| bad("a type of PLY 1.0 expected", &kind.join(" ")))?;
                let element = elements
                    .last_mut()
                    .ok_or_else(|| bad("an element before its properties expected", line))?;
                if element.position(name).is_some() {
                    return Err(PlyError::Repeated { line: number, name: shown(name) });
                }
                element.properties.push(Property { name: (*name).to_owned(), kind });
            }
            (["end_header"], _) => break,
            _ => {
                return Err(bad("format, comment, obj_info, element, property or end_header expected", line));
            }
        }
    }
    complete(format, elements, start, number + 1)
}

fn read_kind(words: &[&str]) -> Option<Kind> {
    match words {
        [one] => Some(Kind::One(Scalar::named(one)?)),
        ["list", count, item] => {
            let count = Scalar::named(count).filter(|count| !count.is_float())?;
            Some(Kind::List { count, item: Scalar::named(item)? })
        }
        _ => None,
    }
}

/// Finds what is read among the elements.
fn complete(
    format: Option<Format>,
    elements: Vec<Element>,
    data_start: usize,
    data_line: usize,
) -> Result<Header, PlyError> {
    let format = format.ok_or(PlyError::NoFormat)?;
    for element in &elements {
        // Rows of nothing would be counted without an end.
        if element.properties.is_empty() && element.count > 0 {
            return Err(PlyError::NoProperties { element: shown(&element.name) });
        }
    }
    let vertex = elements.iter().position(|element| element.name == "vertex").ok_or(PlyError::NoVertex)?;
    let points = wanted_of_points(&elements[vertex])?;
    let camera = match elements.iter().position(|element| element.name == "camera") {
        None => None,
        Some(camera) => {
            let element = &elements[camera];
            match three(element, ["view_px", "view_py", "view_pz"], "a number")? {
                Some(position) if element.count == 1 => Some((camera, Wanted { position, colour: None })),
                Some(_) if element.count > 1 => return Err(PlyError::Cameras { got: element.count }),
                _ => None,
            }
        }
    };
    Ok(Header { format, elements, vertex, points, camera, data_start, data_line })
}

/// Three properties, or `None` unless all are there.
fn three(
    element: &Element,
    names: [&'static str; 3],
    expected: &'static str,
) -> Result<Option<[Slot; 3]>, PlyError> {
    let [a, b, c] = names;
    Ok(match [element.slot(a, expected)?, element.slot(b, expected)?, element.slot(c, expected)?] {
        [Some(a), Some(b), Some(c)] => Some([a, b, c]),
        _ => None,
    })
}

fn wanted_of_points(element: &Element) -> Result<Wanted, PlyError> {
    const POSITION: [&str; 3] = ["x", "y", "z"];
    const COLOUR: &str = "uchar, ushort, float or double";
    let missing = |names: [&'static str; 3]| {
        let name = names.into_iter().find(|name| element.position(name).is_none());
        PlyError::MissingProperty { name: name.unwrap_or(names[0]) }
    };
    let position = three(element, POSITION, "a number")?.ok_or_else(|| missing(POSITION))?;
    let mut colour: Option<([Slot; 3], &'static str)> = None;
    for names in COLOURS {
        if !names.iter().any(|name| element.position(name).is_some()) {
            continue;
        }
        // A single letter may stand for anything, as r for a radius.
        let is_sure = names[0].len() > 1 || names.iter().all(|name| element.position(name).is_some());
        if !is_sure {
            continue;
        }
        let slots = three(element, names, COLOUR)?.ok_or_else(|| missing(names))?;
        for (slot, name) in slots.iter().zip(names) {
            if !matches!(slot.of, Scalar::U1 | Scalar::U2 | Scalar::F4 | Scalar::F8) {
                let got = slot.of.name().to_owned();
                return Err(PlyError::PropertyType { name, expected: COLOUR, got });
            }
        }
        if let Some((_, first)) = colour.replace((slots, names[0])) {
            return Err(PlyError::TwoColours { first, second: names[0] });
        }
    }
    Ok(Wanted { position, colour: colour.map(|(slots, _)| slots) })
}
