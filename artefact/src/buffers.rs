//! A cloud from arrays of coordinates and colours, as programs in other languages have them.

use descriptor::Cloud;

/// Most points of a cloud: as many as a file of 256 MiB can have.
pub const MAX_POINTS: usize = (256 << 20) / 12;

/// Why arrays are no cloud.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BufferError {
    /// A coordinate is missing.
    #[error("xyz: must hold three coordinates a point, got {0} numbers\ngive an array of shape (n, 3)")]
    Coordinates(usize),
    /// Colours that are not one a point.
    #[error(
        "rgb: must hold three bytes for each of {points} points, got {got} bytes\ngive an array of shape (n, 3), or none"
    )]
    Colours {
        /// Points.
        points: usize,
        /// Bytes.
        got: usize,
    },
    /// More points than any cloud may have.
    #[error("xyz: must hold at most {MAX_POINTS} points, got {0}\ncut out the object, or thin the cloud")]
    TooMany(usize),
    /// Nobody can look from there.
    #[error("viewpoint: must be finite, got {0}\ngive the position of the camera, by default 0 0 0")]
    Viewpoint(f32),
}

/// The cloud of points `xyz`, three numbers each, with colours `rgb`, three bytes each, seen from `viewpoint`: lengths in
/// one unit, whichever it is. Points with a coordinate that is not finite are left out, as in files.
///
/// # Errors
/// [`BufferError`] if the lengths do not fit together.
pub fn cloud_of(xyz: &[f32], rgb: Option<&[u8]>, viewpoint: [f32; 3]) -> Result<Cloud, BufferError> {
    let (points, rest) = xyz.as_chunks::<3>();
    if !rest.is_empty() {
        return Err(BufferError::Coordinates(xyz.len()));
    }
    if points.len() > MAX_POINTS {
        return Err(BufferError::TooMany(points.len()));
    }
    if let Some(&wrong) = viewpoint.iter().find(|coordinate| !coordinate.is_finite()) {
        return Err(BufferError::Viewpoint(wrong));
    }
    let is_finite = |point: &[f32; 3]| point.iter().all(|coordinate| coordinate.is_finite());
    let colours = match rgb.map(|rgb| (rgb.as_chunks::<3>().0, rgb.len())) {
        None => None,
        Some((colours, got)) if got == xyz.len() => {
            let pairs = points.iter().zip(colours);
            Some(pairs.filter(|(point, _)| is_finite(point)).map(|(_, colour)| *colour).collect())
        }
        Some((_, got)) => return Err(BufferError::Colours { points: points.len(), got }),
    };
    let points = points.iter().copied().filter(is_finite).collect();
    Ok(Cloud { points, colours, viewpoint })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_that_are_not_finite_are_left_out_with_their_colours() {
        let xyz = [1.0, 2.0, 3.0, f32::NAN, 0.0, 0.0, 4.0, 5.0, 6.0, 0.0, f32::INFINITY, 0.0];
        let rgb: Vec<u8> = (0..12).collect();
        let cloud = cloud_of(&xyz, Some(&rgb), [0.5, 0.0, 0.0]).unwrap();
        assert_eq!(cloud.points, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        assert_eq!(cloud.colours, Some(vec![[0, 1, 2], [6, 7, 8]]));
        assert_eq!(cloud.viewpoint, [0.5, 0.0, 0.0]);
        assert!(cloud_of(&[], None, [0.0; 3]).unwrap().is_empty());
    }

    #[test]
    fn arrays_that_do_not_fit_together_are_refused() {
        assert_eq!(cloud_of(&[1.0; 4], None, [0.0; 3]), Err(BufferError::Coordinates(4)));
        for got in [0, 3, 5, 9] {
            let rgb = vec![0; got];
            let refused = cloud_of(&[1.0; 6], Some(&rgb), [0.0; 3]);
            assert_eq!(refused, Err(BufferError::Colours { points: 2, got }));
        }
        assert!(matches!(cloud_of(&[], None, [0.0, f32::NAN, 0.0]), Err(BufferError::Viewpoint(_))));
    }
}
