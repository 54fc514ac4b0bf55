//! One PNG file, decoded.

use std::io::Cursor;

use png::{BitDepth, ColorType, Decoder, Limits, Transformations};

use super::error::RgbdError;

/// Pixels of an image at most: those of 4096 by 4096.
const MAX_PIXELS: u64 = 1 << 24;

/// Bytes that the decoder may keep beside its output.
const MAX_DECODER_BYTES: usize = 64 << 20;

/// What an image shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Colour,
    Depth,
    Mask,
}

impl Kind {
    pub fn name(self) -> &'static str {
        match self {
            Self::Colour => "colour",
            Self::Depth => "depth",
            Self::Mask => "mask",
        }
    }

    /// How pixels are wanted: depth as it is, the others as whole bytes; of colours the upper byte.
    fn transformations(self) -> Transformations {
        match self {
            Self::Colour => Transformations::EXPAND | Transformations::STRIP_16,
            Self::Depth => Transformations::IDENTITY,
            Self::Mask => Transformations::EXPAND,
        }
    }
}

/// Pixels, row by row.
pub(super) struct Image {
    pub kind: Kind,
    /// Width and height.
    pub size: [u32; 2],
    samples: Vec<u8>,
    colour: ColorType,
    /// Bytes of a pixel, and those of them that are no transparency.
    pixel_bytes: usize,
    shown_bytes: usize,
}

impl Image {
    pub fn decode(kind: Kind, bytes: &[u8]) -> Result<Self, RgbdError> {
        let image = kind.name();
        let broken = |error: png::DecodingError| RgbdError::Png { image, got: error.to_string() };
        let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), Limits { bytes: MAX_DECODER_BYTES });
        decoder.set_transformations(kind.transformations());
        decoder.set_ignore_text_chunk(true);
        decoder.set_ignore_iccp_chunk(true);
        let header = decoder.read_header_info().map_err(broken)?;
        let size = [header.width, header.height];
        if u64::from(size[0]) * u64::from(size[1]) > MAX_PIXELS {
            return Err(RgbdError::TooLarge { image, size, most: MAX_PIXELS });
        }
        let mut reader = decoder.read_info().map_err(broken)?;
        let (colour, bits) = reader.output_color_type();
        if kind == Kind::Depth && (colour, bits) != (ColorType::Grayscale, BitDepth::Sixteen) {
            let got = format!("{} bits of {}", bits as u8, name(colour));
            return Err(RgbdError::Depth { got });
        }
        let sample_bytes = if bits == BitDepth::Sixteen { 2 } else { 1 };
        let (samples, shown) = match colour {
            ColorType::Grayscale | ColorType::Indexed => (1, 1),
            ColorType::GrayscaleAlpha => (2, 1),
            ColorType::Rgb => (3, 3),
            ColorType::Rgba => (4, 3),
        };
        let (pixel_bytes, shown_bytes) = (samples * sample_bytes, shown * sample_bytes);
        let pixels = size[0] as usize * size[1] as usize;
        // Of fewer bits than a byte, rows are padded: none of the transformations leaves any.
        if reader.output_buffer_size() != Some(pixels * pixel_bytes) {
            let got = format!("{} bits of {}", bits as u8, name(colour));
            return Err(RgbdError::Png { image, got });
        }
        let mut samples = vec![0; pixels * pixel_bytes];
        reader.next_frame(&mut samples).map_err(broken)?;
        // What is cut off behind the pixels is cut off all the same.
        reader.finish().map_err(broken)?;
        Ok(Self { kind, size, samples, colour, pixel_bytes, shown_bytes })
    }

    pub fn pixels(&self) -> usize {
        self.samples.len() / self.pixel_bytes
    }

    fn pixel(&self, pixel: usize) -> &[u8] {
        &self.samples[pixel * self.pixel_bytes..][..self.shown_bytes]
    }

    /// Of a mask.
    pub fn is_set(&self, pixel: usize) -> bool {
        self.pixel(pixel).iter().any(|&byte| byte != 0)
    }

    /// Of a depth image, which has two bytes a pixel.
    pub fn depth(&self, pixel: usize) -> u16 {
        self.pixel(pixel).iter().fold(0, |depth, &byte| depth << 8 | u16::from(byte))
    }

    pub fn has_colours(&self) -> bool {
        matches!(self.colour, ColorType::Rgb | ColorType::Rgba)
    }

    /// Of a colour image; `None` of one of grey.
    pub fn colour(&self, pixel: usize) -> Option<[u8; 3]> {
        self.pixel(pixel).try_into().ok()
    }
}

fn name(colour: ColorType) -> &'static str {
    match colour {
        ColorType::Grayscale => "grey",
        ColorType::GrayscaleAlpha => "grey with transparency",
        ColorType::Rgb => "colour",
        ColorType::Rgba => "colour with transparency",
        ColorType::Indexed => "a palette",
    }
}
