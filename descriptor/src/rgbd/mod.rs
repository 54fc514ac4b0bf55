//! Clouds from images: the points that a depth image shows of one object, with the colours of a colour image.
//!
//! The images of a cloud, and what is known of the camera, are one byte string, as a cloud file is, so that they have one
//! digest and travel together. [`write`] makes it of PNG files as they are, [`read`] decodes them. Bytes come from outside:
//! the size of an image is bounded before memory is asked for.

mod container;
mod error;
mod image;

#[cfg(test)]
mod tests;

pub use container::{Camera, Images, is_rgbd, write};
pub use error::RgbdError;

use crate::Cloud;
use container::parts;
use image::{Image, Kind};

/// The cloud of a byte string that [`write`] has made, in metres, in the camera's frame: x to the right, y down, z forward.
///
/// Row by row, each pixel that the mask names and whose depth is not 0 becomes a point. With u, the pixel's column, and v,
/// its row, both from 0, and d, its depth, the point is z = d · depth unit, x = (u − cx) · z / fx and y = (v − cy) · z / fy,
/// computed in f64 and rounded once to f32. Colour images of more than 8 bits a sample lose the lower bits; those of grey
/// make a cloud without colours. The viewpoint is the origin.
///
/// # Errors
/// Each is an [`RgbdError`] with two lines of text; the caller puts the cloud's name in front.
pub fn read(bytes: &[u8]) -> Result<Cloud, RgbdError> {
    let (camera, Images { colour, depth, mask }) = parts(bytes)?;
    let colour = Image::decode(Kind::Colour, colour)?;
    let depth = Image::decode(Kind::Depth, depth)?;
    let mask = Image::decode(Kind::Mask, mask)?;
    for other in [&depth, &mask] {
        if other.size != colour.size {
            return Err(RgbdError::Sizes { image: other.kind.name(), got: other.size, colour: colour.size });
        }
    }
    let (mut points, mut colours) = (Vec::new(), Vec::new());
    let width = colour.size[0] as usize;
    for pixel in (0..depth.pixels()).filter(|&pixel| mask.is_set(pixel)) {
        let depth = depth.depth(pixel);
        if depth == 0 {
            continue;
        }
        let [u, v] = [pixel % width, pixel / width].map(|at| at as f64);
        let z = f64::from(depth) * camera.depth_unit;
        let [cx, cy] = camera.centre;
        let [fx, fy] = camera.focal_length;
        let point = [(u - cx) * z / fx, (v - cy) * z / fy, z].map(|coordinate| coordinate as f32);
        if point.iter().all(|coordinate| coordinate.is_finite()) {
            points.push(point);
            colours.extend(colour.colour(pixel));
        }
    }
    let colours = colour.has_colours().then_some(colours);
    Ok(Cloud { points, colours, viewpoint: [0.0; 3] })
}
