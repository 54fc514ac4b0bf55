//! The meaning of `[preprocess]`: lengths in whole micrometres, inside their bounds.

use descriptor::{Preprocess, Unit};

use super::error::Fault;
use super::raw::{RawDescriptor, RawFamily, RawPreprocess};
use crate::text::number;

/// Keypoints and normals of clouds in this unit. `Err` names the first key that means nothing.
pub fn preprocess(raw: &RawPreprocess, unit: Unit, descriptor: &RawDescriptor) -> Result<Preprocess, Fault> {
    if let Some(leaf_cm) = raw.leaf_cm.filter(|_| descriptor.family == RawFamily::Structure) {
        return Err(Fault::new(
            "preprocess.leaf_cm",
            format!("not for family structure, whose channels have grids of their own, got {leaf_cm}"),
            "remove it",
        ));
    }
    if !(1..=1_000_000).contains(&raw.min_points) {
        return Err(Fault::new(
            "preprocess.min_points",
            format!("not between 1 and 1000000, got {}", raw.min_points),
            "write a number of points such as 10",
        ));
    }
    Ok(Preprocess {
        leaf_um: match raw.leaf_cm {
            Some(leaf_cm) => length_um("preprocess.leaf_cm", leaf_cm)?,
            None => Preprocess::default().leaf_um,
        },
        normal_radius_um: length_um("preprocess.normal_radius_cm", raw.normal_radius_cm)?,
        min_points: raw.min_points,
        colour: descriptor.colour,
        unit,
    })
}

/// Whole micrometres from centimetres; `None` beyond 1 µm to 1 m, or between two micrometres.
pub fn micrometres(cm: f64) -> Option<u32> {
    let um = cm * 1e4;
    ((1.0..=1e6).contains(&um) && (um - um.round()).abs() < 1e-6).then(|| um.round() as u32)
}

/// Whole micrometres from centimetres between 0.01 and 100.
fn length_um(place: &str, cm: f64) -> Result<u32, Fault> {
    micrometres(cm).filter(|um| *um >= 100).ok_or_else(|| {
        Fault::new(
            place,
            format!("not between 0.01 and 100 cm with at most four decimals, got {}", number(cm)),
            "write a length in centimetres, such as 2.0",
        )
    })
}
