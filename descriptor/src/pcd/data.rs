//! The points after the header of a PCD file, in its three encodings.

use super::{
    error::PcdError,
    header::{COMPONENTS, Colour, Component, DataEncoding, Header, Packed, Real, Slot},
};
use crate::Cloud;
use crate::header_text::{UNIT, from_unit, shown};

/// The points of a file whose header is read.
pub(super) fn read(header: &Header, bytes: &[u8]) -> Result<Cloud, PcdError> {
    let data = &bytes[header.data_start..];
    match header.data {
        DataEncoding::Ascii => read_ascii(header, data),
        DataEncoding::Binary => read_binary(header, data),
        DataEncoding::BinaryCompressed => read_compressed(header, data),
    }
}

/// Number of points, if that many of `point_bytes` or more can be in `data` with `missing` bytes behind it.
fn points_in(header: &Header, point_bytes: u64, data: &[u8], missing: u64) -> Result<usize, PcdError> {
    let most = data.len() as u64 + missing;
    if header.points.checked_mul(point_bytes).is_none_or(|needed| needed > most) {
        return Err(PcdError::Truncated { points: header.points, point_bytes, available: data.len() });
    }
    // Fits: no larger than the number of bytes, because a point has at least x, y and z.
    Ok(header.points as usize)
}

/// Collects the points whose position is finite.
struct Builder {
    cloud: Cloud,
}

impl Builder {
    fn new(header: &Header, points: usize) -> Self {
        let colours = header.colour.is_some().then(|| Vec::with_capacity(points));
        Self { cloud: Cloud { points: Vec::with_capacity(points), colours, viewpoint: header.viewpoint } }
    }

    fn push(&mut self, point: [f32; 3], colour: Option<[u8; 3]>) {
        self.cloud.points.push(point);
        if let (Some(colours), Some(colour)) = (&mut self.cloud.colours, colour) {
            colours.push(colour);
        }
    }
}

fn is_finite(point: &[f32; 3]) -> bool {
    point.iter().all(|coordinate| coordinate.is_finite())
}

fn read_ascii(header: &Header, data: &[u8]) -> Result<Cloud, PcdError> {
    // A value is a character and a separator at least; the last separator may be missing.
    let points = points_in(header, header.point_values * 2, data, 1)?;
    let mut builder = Builder::new(header, points);
    let mut got = 0;
    for (index, line) in data.split(|&byte| byte == b'\n').enumerate() {
        let line = line.trim_ascii();
        if line.is_empty() || line[0] == b'#' {
            continue;
        }
        got += 1;
        if got <= points {
            read_ascii_point(header, line, header.data_line + index, &mut builder)?;
        }
    }
    if got != points {
        return Err(PcdError::LineCount { expected: points, got });
    }
    Ok(builder.cloud)
}

fn read_ascii_point(
    header: &Header,
    line: &[u8],
    number: usize,
    builder: &mut Builder,
) -> Result<(), PcdError> {
    let mut words: [&[u8]; 6] = [b""; 6];
    let colour = match header.colour {
        None => [usize::MAX; 3],
        Some(Colour::Packed(slot)) => [slot.value, usize::MAX, usize::MAX],
        Some(Colour::Separate(slots)) => slots.map(|slot| slot.value),
    };
    let mut count = 0;
    for word in line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()) {
        for (kept, slot) in words.iter_mut().zip(&header.xyz) {
            if slot.value == count {
                *kept = word;
            }
        }
        for (kept, value) in words[3..].iter_mut().zip(colour) {
            if value == count {
                *kept = word;
            }
        }
        count += 1;
    }
    if count as u64 != header.point_values {
        let expected = header.point_values as usize;
        return Err(PcdError::ValueCount { line: number, expected, got: count });
    }

    let mut point = [0.0; 3];
    for (axis, coordinate) in point.iter_mut().enumerate() {
        // Text is rounded once, also for F8: f32 from the decimal number, not by way of f64.
        *coordinate = parse(words[axis])
            .ok_or_else(|| bad_value(number, ["x", "y", "z"][axis], "a number", words[axis]))?;
    }
    // A point without a position may well have no colour either.
    if !is_finite(&point) {
        return Ok(());
    }
    let colour = match header.colour {
        None => None,
        Some(Colour::Packed(slot)) => Some(unpacked(match slot.of {
            Packed::U4 => parse(words[3])
                .ok_or_else(|| bad_value(number, "rgb", "a whole number below 2^32", words[3]))?,
            // Every NaN is written alike, so its bits are no longer a colour.
            Packed::F4 => parse(words[3])
                .filter(|value: &f32| !value.is_nan())
                .ok_or_else(|| bad_value(number, "rgb", "a number whose bits are the colour", words[3]))?
                .to_bits(),
        })),
        Some(Colour::Separate(slots)) => {
            let mut components = [0; 3];
            for (component, value) in components.iter_mut().enumerate() {
                let (word, name) = (words[3 + component], COMPONENTS[component]);
                *value = match slots[component].of {
                    Component::U1 => parse(word)
                        .ok_or_else(|| bad_value(number, name, "a whole number below 256", word))?,
                    Component::F4 => parse(word)
                        .and_then(|value: f32| from_unit(f64::from(value)))
                        .ok_or_else(|| bad_value(number, name, UNIT, word))?,
                };
            }
            Some(components)
        }
    };
    builder.push(point, colour);
    Ok(())
}

/// Red, green and blue of a packed colour.
fn unpacked(packed: u32) -> [u8; 3] {
    let [_, red, green, blue] = packed.to_be_bytes();
    [red, green, blue]
}

fn parse<T: std::str::FromStr>(word: &[u8]) -> Option<T> {
    str::from_utf8(word).ok()?.parse().ok()
}

fn bad_value(line: usize, name: &'static str, expected: &'static str, word: &[u8]) -> PcdError {
    PcdError::BadValue { line, name, expected, got: shown(&String::from_utf8_lossy(word)) }
}

/// Where the values of one field are in binary data: the first, and the distance to the next.
#[derive(Clone, Copy)]
struct Column {
    start: usize,
    stride: usize,
}

fn read_binary(header: &Header, data: &[u8]) -> Result<Cloud, PcdError> {
    let points = points_in(header, header.point_bytes, data, 0)?;
    let stride = header.point_bytes as usize;
    let (data, rest) = data.split_at(points * stride);
    // PCL up to 1.8 stretches a file by a page of zeros; anything else is points that the header denies.
    if rest.iter().any(|&byte| byte != 0) {
        return Err(PcdError::TooMuchData { points, extra: rest.len() });
    }
    gather(header, data, points, |byte, _| Column { start: byte, stride })
}

fn read_compressed(header: &Header, data: &[u8]) -> Result<Cloud, PcdError> {
    let (Some(sizes), Some(data)) = (data.first_chunk::<8>(), data.get(8..)) else {
        return Err(PcdError::NoSizes { available: data.len() });
    };
    let [a, b, c, d, e, f, g, h] = *sizes;
    let (compressed, uncompressed) = (u32::from_le_bytes([a, b, c, d]), u32::from_le_bytes([e, f, g, h]));
    if compressed as usize > data.len() {
        return Err(PcdError::CompressedTruncated { compressed, available: data.len() });
    }
    // Saturated, it is larger than any size that 32 bits can state.
    let expected = header.points.saturating_mul(header.point_bytes);
    if expected != u64::from(uncompressed) {
        return Err(PcdError::UncompressedSize { expected, got: uncompressed });
    }
    if uncompressed > MOST_UNCOMPRESSED {
        return Err(PcdError::TooLarge { most: MOST_UNCOMPRESSED, got: uncompressed });
    }
    let limit = max_expansion(compressed);
    if u64::from(uncompressed) > limit {
        return Err(PcdError::Expansion { limit, compressed, got: uncompressed });
    }
    // Fits: at least 12 bytes a point, and all of them fit in 32 bits.
    let points = header.points as usize;
    let (data, rest) = data.split_at(compressed as usize);
    if rest.iter().any(|&byte| byte != 0) {
        return Err(PcdError::TooMuchData { points, extra: rest.len() });
    }
    let plain = match uncompressed {
        0 => Vec::new(),
        _ => lzf::decompress(data, uncompressed as usize)
            .ok()
            .filter(|plain| plain.len() == uncompressed as usize)
            .ok_or(PcdError::BadLzf { expected: uncompressed })?,
    };
    // All values of a field together, one field after the other.
    gather(header, &plain, points, |byte, size| Column { start: byte * points, stride: size })
}

/// Most bytes that compressed data may become: 3 MB can claim as many, and each thread reads a file of its own.
const MOST_UNCOMPRESSED: u32 = 256 << 20;

/// The most bytes that LZF can make of `compressed`: the longest copy is 264 bytes, coded in three.
fn max_expansion(compressed: u32) -> u64 {
    u64::from(compressed) * 264 / 3
}

/// Points from binary data, in which every `column` is complete.
fn gather(
    header: &Header,
    data: &[u8],
    points: usize,
    column: impl Fn(usize, usize) -> Column,
) -> Result<Cloud, PcdError> {
    let xyz = header.xyz.map(|slot| {
        let size = match slot.of {
            Real::F4 => 4,
            Real::F8 => 8,
        };
        (slot.of, column(slot.byte, size))
    });
    let colour = |index: usize| -> Result<Option<[u8; 3]>, PcdError> {
        match header.colour {
            None => Ok(None),
            Some(Colour::Packed(slot)) => {
                let Column { start, stride } = column(slot.byte, 4);
                Ok(Some(unpacked(u32::from_le_bytes(little_endian(data, start + index * stride)))))
            }
            Some(Colour::Separate(slots)) => {
                let mut components = [0; 3];
                for ((value, slot), name) in components.iter_mut().zip(slots).zip(COMPONENTS) {
                    *value = component(data, slot, index, &column, name)?;
                }
                Ok(Some(components))
            }
        }
    };
    let mut builder = Builder::new(header, points);
    for index in 0..points {
        let point = xyz.map(|(real, Column { start, stride })| {
            let at = start + index * stride;
            match real {
                Real::F4 => f32::from_le_bytes(little_endian(data, at)),
                Real::F8 => f64::from_le_bytes(little_endian(data, at)) as f32,
            }
        });
        if is_finite(&point) {
            builder.push(point, colour(index)?);
        }
    }
    Ok(builder.cloud)
}

/// One of the separate colour values of the point with that index.
fn component(
    data: &[u8],
    slot: Slot<Component>,
    index: usize,
    column: impl Fn(usize, usize) -> Column,
    name: &'static str,
) -> Result<u8, PcdError> {
    match slot.of {
        Component::U1 => {
            let Column { start, stride } = column(slot.byte, 1);
            Ok(data[start + index * stride])
        }
        Component::F4 => {
            let Column { start, stride } = column(slot.byte, 4);
            let value = f32::from_le_bytes(little_endian(data, start + index * stride));
            from_unit(f64::from(value)).ok_or_else(|| PcdError::BadColour {
                point: index,
                name,
                got: value.to_string(),
            })
        }
    }
}

fn little_endian<const N: usize>(data: &[u8], at: usize) -> [u8; N] {
    let mut bytes = [0; N];
    bytes.copy_from_slice(&data[at..at + N]);
    bytes
}
