//! The images of a cloud, and the camera's numbers, as one byte string.

use super::error::RgbdError;

/// How the byte string begins: as no PCD, PLY or image file does.
const MAGIC: &[u8; 16] = b"descry rgb-d 1\r\n";

/// Numbers of a camera in the byte string, and images.
const NUMBERS: usize = 5;
const IMAGES: usize = 3;

/// Bytes before the first image.
const HEADER: usize = MAGIC.len() + 8 * (NUMBERS + IMAGES);

/// A pinhole camera without distortion, for the images as they are: those that were cut out of larger ones have a centre of
/// their own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Focal length along rows and columns, pixels; greater than 0.
    pub focal_length: [f64; 2],
    /// Column and row of the pixel on the optical axis, from 0, which may lie outside the image.
    pub centre: [f64; 2],
    /// Metres that 1 in the depth image stands for; greater than 0.
    pub depth_unit: f64,
}

/// PNG files of one size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Images<'a> {
    /// Of colour or grey.
    pub colour: &'a [u8],
    /// Of grey, 16 bits a pixel; 0 where nothing was measured.
    pub depth: &'a [u8],
    /// Not 0 where the object is.
    pub mask: &'a [u8],
}

/// Whether bytes begin as [`write`] begins.
pub fn is_rgbd(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// One byte string of a camera and images: a line of 16 bytes; focal lengths, centre and depth unit as f64; lengths of the
/// images as u64; the images. Numbers are little endian.
pub fn write(camera: &Camera, images: Images<'_>) -> Vec<u8> {
    let Camera { focal_length: [fx, fy], centre: [cx, cy], depth_unit } = *camera;
    let images = [images.colour, images.depth, images.mask];
    let mut bytes = Vec::with_capacity(HEADER + images.iter().map(|image| image.len()).sum::<usize>());
    bytes.extend_from_slice(MAGIC);
    bytes.extend([fx, fy, cx, cy, depth_unit].into_iter().flat_map(f64::to_le_bytes));
    bytes.extend(images.iter().flat_map(|image| (image.len() as u64).to_le_bytes()));
    images.into_iter().for_each(|image| bytes.extend_from_slice(image));
    bytes
}

/// What [`write`] was given.
pub(super) fn parts(bytes: &[u8]) -> Result<(Camera, Images<'_>), RgbdError> {
    let damaged = || RgbdError::Damaged { bytes: bytes.len() };
    let rest = bytes.strip_prefix(MAGIC).ok_or_else(damaged)?;
    let (header, mut rest) = rest.split_at_checked(HEADER - MAGIC.len()).ok_or_else(damaged)?;
    let mut words = header.as_chunks::<8>().0.iter();
    let mut numbers = [0.0; NUMBERS];
    for (number, word) in numbers.iter_mut().zip(words.by_ref()) {
        *number = f64::from_le_bytes(*word);
    }
    let mut images = [&bytes[..0]; IMAGES];
    for (image, word) in images.iter_mut().zip(words) {
        let length = usize::try_from(u64::from_le_bytes(*word)).map_err(|_| damaged())?;
        (*image, rest) = rest.split_at_checked(length).ok_or_else(damaged)?;
    }
    if !rest.is_empty() {
        return Err(damaged());
    }
    let [fx, fy, cx, cy, depth_unit] = numbers;
    for (what, number) in [("focal length", fx), ("focal length", fy), ("depth unit", depth_unit)] {
        if !(number > 0.0 && number.is_finite()) {
            return Err(RgbdError::Camera { what, expected: "finite number greater than 0", got: number });
        }
    }
    if let Some(got) = [cx, cy].into_iter().find(|number| !number.is_finite()) {
        return Err(RgbdError::Camera { what: "centre", expected: "finite number", got });
    }
    let [colour, depth, mask] = images;
    let camera = Camera { focal_length: [fx, fy], centre: [cx, cy], depth_unit };
    Ok((camera, Images { colour, depth, mask }))
}
