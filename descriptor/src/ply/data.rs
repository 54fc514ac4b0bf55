//! The rows after the header of a PLY file, as text and as binary.

use super::error::PlyError;
use super::header::{Element, Format, Header, Kind, Scalar, Slot, Wanted};
use crate::Cloud;
use crate::header_text::{UNIT, from_unit, shown};

/// The points of a file whose header is read.
pub(super) fn read(header: &Header, bytes: &[u8]) -> Result<Cloud, PlyError> {
    let mut rest = Rest { data: &bytes[header.data_start..], line: header.data_line };
    let (mut points, mut cameras) = (Rows::default(), Rows::default());
    for (index, element) in header.elements.iter().enumerate() {
        let wanted = match &header.camera {
            _ if index == header.vertex => Some((&header.points, &mut points)),
            Some((camera, wanted)) if index == *camera => Some((wanted, &mut cameras)),
            _ => None,
        };
        match header.format {
            Format::Ascii => rest.read_ascii(element, wanted)?,
            binary => rest.read_binary(element, wanted, binary == Format::BigEndian)?,
        }
    }
    let is_padding: fn(&u8) -> bool = match header.format {
        Format::Ascii => u8::is_ascii_whitespace,
        Format::LittleEndian | Format::BigEndian => |&byte| byte == 0,
    };
    if !rest.data.iter().all(is_padding) {
        return Err(PlyError::TooMuchData { extra: rest.data.len() });
    }
    // A camera at no place is none.
    let viewpoint = cameras.positions.first().copied().unwrap_or_default();
    Ok(Cloud { points: points.positions, colours: points.colours, viewpoint })
}

/// What is read of an element: rows whose position is finite.
#[derive(Default)]
struct Rows {
    positions: Vec<[f32; 3]>,
    colours: Option<Vec<[u8; 3]>>,
}

impl Rows {
    fn reserve(&mut self, rows: usize, wanted: &Wanted) {
        self.positions.reserve_exact(rows);
        self.colours = wanted.colour.map(|_| Vec::with_capacity(rows));
    }

    /// Adds a row; the colour is not asked for if the position is not finite, as it may then be none either.
    fn push(
        &mut self,
        position: [f32; 3],
        colour: impl FnOnce() -> Result<[u8; 3], PlyError>,
    ) -> Result<(), PlyError> {
        if position.iter().all(|coordinate| coordinate.is_finite()) {
            if let Some(colours) = &mut self.colours {
                colours.push(colour()?);
            }
            self.positions.push(position);
        }
        Ok(())
    }
}

/// 0 to 65535 to the nearest of 0 to 255: 257 of one is one of the other.
fn from_u16(value: u16) -> u8 {
    ((u32::from(value) + 128) / 257) as u8
}

/// What is not read yet.
struct Rest<'a> {
    data: &'a [u8],
    /// The first line of it, counted from 1.
    line: usize,
}

impl<'a> Rest<'a> {
    /// Number of rows, if that many of `row_bytes` or more can be in the data with `missing` bytes behind it.
    fn rows(&self, element: &Element, row_bytes: usize, missing: usize) -> Result<usize, PlyError> {
        let most = (self.data.len() + missing) as u64;
        if element.count.checked_mul(row_bytes as u64).is_none_or(|needed| needed > most) {
            return Err(PlyError::Truncated {
                element: shown(&element.name),
                rows: element.count,
                row_bytes: row_bytes as u64,
                available: self.data.len(),
            });
        }
        // Fits: no larger than the number of bytes, because only elements without rows have no properties.
        Ok(element.count as usize)
    }

    fn next_line(&mut self) -> Option<(usize, &'a [u8])> {
        while !self.data.is_empty() {
            let length = self.data.iter().position(|&byte| byte == b'\n');
            let (line, rest) = match length {
                Some(length) => (&self.data[..length], &self.data[length + 1..]),
                None => (self.data, &[][..]),
            };
            let number = self.line;
            (self.data, self.line) = (rest, number + 1);
            let line = line.trim_ascii();
            if !line.is_empty() {
                return Some((number, line));
            }
        }
        None
    }

    fn read_ascii(
        &mut self,
        element: &Element,
        mut wanted: Option<(&Wanted, &mut Rows)>,
    ) -> Result<(), PlyError> {
        // A value is a character and a separator at least; the last separator may be missing.
        let rows = self.rows(element, element.properties.len() * 2, 1)?;
        if let Some((wanted, read)) = &mut wanted {
            read.reserve(rows, wanted);
        }
        for row in 0..rows {
            let (number, line) = self.next_line().ok_or_else(|| PlyError::RowCount {
                element: shown(&element.name),
                rows: element.count,
                got: row as u64,
            })?;
            if let Some((wanted, read)) = &mut wanted {
                read_line(element, wanted, number, line, read)?;
            }
        }
        Ok(())
    }

    fn read_binary(
        &mut self,
        element: &Element,
        mut wanted: Option<(&Wanted, &mut Rows)>,
        big: bool,
    ) -> Result<(), PlyError> {
        let least = element.least_bytes();
        let rows = self.rows(element, least, 0)?;
        if let Some((wanted, read)) = &mut wanted {
            read.reserve(rows, wanted);
        }
        if wanted.is_none() && element.is_fixed() {
            self.data = &self.data[rows * least..];
            return Ok(());
        }
        let mut starts = starts_of_fixed(element);
        for row in 0..rows {
            let length = match element.is_fixed() {
                true => least,
                false => walk(element, self.data, big, row, &mut starts)?,
            };
            let (bytes, rest) = self.data.split_at(length);
            if let Some((wanted, read)) = &mut wanted {
                let binary = Binary { bytes, starts: &starts, big };
                read.push(wanted.position.map(|slot| binary.number(slot) as f32), || {
                    let slots = wanted.colour.unwrap_or(wanted.position);
                    let [red, green, blue] = slots.map(|slot| binary.colour(slot, element, row));
                    Ok([red?, green?, blue?])
                })?;
            }
            self.data = rest;
        }
        Ok(())
    }
}

/// Where each property starts in a row without lists.
fn starts_of_fixed(element: &Element) -> Vec<usize> {
    let mut at = 0;
    let start = |property: &super::header::Property| {
        let start = at;
        at += property.kind.least_bytes();
        start
    };
    element.properties.iter().map(start).collect()
}

/// Finds where each property starts in the row at the start of the data, and the row's length.
fn walk(
    element: &Element,
    data: &[u8],
    big: bool,
    row: usize,
    starts: &mut [usize],
) -> Result<usize, PlyError> {
    let cut = || PlyError::RowCount { element: shown(&element.name), rows: element.count, got: row as u64 };
    let mut at = 0;
    for (start, property) in starts.iter_mut().zip(&element.properties) {
        *start = at;
        let mut end = at + property.kind.least_bytes();
        if end > data.len() {
            return Err(cut());
        }
        if let Kind::List { count, item } = property.kind {
            let count = number(&data[at..end], count, big);
            if count < 0.0 {
                return Err(PlyError::BadValue {
                    place: format!("row {row}"),
                    name: shown(&property.name),
                    expected: "a count from 0",
                    got: count.to_string(),
                });
            }
            // A count has 32 bits at most.
            let items = (count as u64) * item.size() as u64;
            if items > (data.len() - end) as u64 {
                return Err(cut());
            }
            end += items as usize;
        }
        at = end;
    }
    Ok(at)
}

/// A row of binary data.
struct Binary<'a> {
    bytes: &'a [u8],
    starts: &'a [usize],
    big: bool,
}

impl Binary<'_> {
    fn number(&self, slot: Slot) -> f64 {
        let start = self.starts[slot.property];
        number(&self.bytes[start..start + slot.of.size()], slot.of, self.big)
    }

    fn colour(&self, slot: Slot, element: &Element, row: usize) -> Result<u8, PlyError> {
        let value = self.number(slot);
        match slot.of {
            Scalar::F4 | Scalar::F8 => from_unit(value).ok_or_else(|| PlyError::BadValue {
                place: format!("row {row}"),
                name: shown(&element.properties[slot.property].name),
                expected: UNIT,
                got: value.to_string(),
            }),
            Scalar::U2 => Ok(from_u16(value as u16)),
            _ => Ok(value as u8),
        }
    }
}

/// A value that takes all of `bytes`. Every value of every type is an f64.
fn number(bytes: &[u8], of: Scalar, big: bool) -> f64 {
    let mut little = [0; 8];
    little[..bytes.len()].copy_from_slice(bytes);
    if big {
        little[..bytes.len()].reverse();
    }
    let [a, b, c, d, ..] = little;
    match of {
        Scalar::I1 => f64::from(i8::from_le_bytes([a])),
        Scalar::U1 => f64::from(a),
        Scalar::I2 => f64::from(i16::from_le_bytes([a, b])),
        Scalar::U2 => f64::from(u16::from_le_bytes([a, b])),
        Scalar::I4 => f64::from(i32::from_le_bytes([a, b, c, d])),
        Scalar::U4 => f64::from(u32::from_le_bytes([a, b, c, d])),
        Scalar::F4 => f64::from(f32::from_le_bytes([a, b, c, d])),
        Scalar::F8 => f64::from_le_bytes(little),
    }
}

/// One row of text, all of whose values are counted.
fn read_line(
    element: &Element,
    wanted: &Wanted,
    line: usize,
    text: &[u8],
    read: &mut Rows,
) -> Result<(), PlyError> {
    let colour = wanted.colour.unwrap_or(wanted.position);
    let [x, y, z] = wanted.position;
    let [red, green, blue] = colour;
    let slots = [x, y, z, red, green, blue];
    let mut kept: [&[u8]; 6] = [b""; 6];
    let mut words = words(text);
    for (index, property) in element.properties.iter().enumerate() {
        let Some(word) = words.next() else { return Err(value_count(element, line, text)) };
        for (kept, slot) in kept.iter_mut().zip(slots) {
            if slot.property == index {
                *kept = word;
            }
        }
        if let Kind::List { .. } = property.kind {
            let count: u64 = parse(word)
                .ok_or_else(|| bad_value(line, &property.name, "a count from 0 to 2^64 - 1", word))?;
            // Ends with the line, however large the count.
            for _ in 0..count {
                if words.next().is_none() {
                    return Err(value_count(element, line, text));
                }
            }
        }
    }
    if words.next().is_some() {
        return Err(value_count(element, line, text));
    }

    let name = |slot: Slot| element.properties[slot.property].name.as_str();
    let mut position = [0.0; 3];
    for ((coordinate, slot), word) in position.iter_mut().zip(wanted.position).zip(kept) {
        // Text is rounded once, also for a double: f32 from the decimal number, not by way of f64.
        *coordinate = parse(word).ok_or_else(|| bad_value(line, name(slot), "a number", word))?;
    }
    read.push(position, || {
        let mut channels = [0; 3];
        for ((channel, slot), word) in channels.iter_mut().zip(colour).zip(&kept[3..]) {
            let (value, expected) = match slot.of {
                Scalar::F4 => (parse(word).and_then(|value: f32| from_unit(f64::from(value))), UNIT),
                Scalar::F8 => (parse(word).and_then(from_unit), UNIT),
                Scalar::U2 => (parse(word).map(from_u16), "a whole number below 2^16"),
                _ => (parse(word), "a whole number below 256"),
            };
            *channel = value.ok_or_else(|| bad_value(line, name(slot), expected, word))?;
        }
        Ok(channels)
    })
}

fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

/// Counts the values of a line that has too few or too many.
fn value_count(element: &Element, line: usize, text: &[u8]) -> PlyError {
    let (mut expected, mut all) = (0_u64, words(text));
    for property in &element.properties {
        let word = all.next();
        expected = expected.saturating_add(1);
        if let Kind::List { .. } = property.kind {
            let count: u64 = word.and_then(parse).unwrap_or(0);
            expected = expected.saturating_add(count);
            if count > 0 {
                // No more than the line has.
                let skipped = count.min(text.len() as u64) as usize;
                all.nth(skipped - 1);
            }
        }
    }
    PlyError::ValueCount { line, expected, got: words(text).count() as u64 }
}

fn parse<T: std::str::FromStr>(word: &[u8]) -> Option<T> {
    str::from_utf8(word).ok()?.parse().ok()
}

fn bad_value(line: usize, name: &str, expected: &'static str, word: &[u8]) -> PlyError {
    PlyError::BadValue {
        place: format!("line {line}"),
        name: shown(name),
        expected,
        got: shown(&String::from_utf8_lossy(word)),
    }
}
