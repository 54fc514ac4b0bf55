//! Reading every cloud once: its digest, whether it can be used, and how far apart its points are.

use descriptor::prepare::usable;
use descriptor::{Cloud, PrepareError, Preprocess, Skip, Unit, pcd};
use rayon::prelude::*;

use super::layout::Labelled;
use super::root::read_file;

/// Clouds whose point spacing is looked at.
const SPACING_CLOUDS: usize = 20;
/// Distances computed for the spacing of one cloud, at most.
const SPACING_DISTANCES: usize = 5_000_000;
/// Points of a cloud whose nearest neighbour is looked for, at most.
const SPACING_POINTS: usize = 200;
/// Plausible medians, metres. Depth cameras see household objects at 0.5 to 10 mm, desktop scanners down to
/// 0.1 mm; beyond these bounds the unit is wrong, or no neighbourhood of some centimetres has points.
const PLAUSIBLE_SPACING: std::ops::RangeInclusive<f64> = 0.000_05..=0.05;

/// What reading one cloud gave.
pub(super) struct Inspected {
    /// BLAKE3 of the file's bytes and their number; `None` if they could not be read.
    pub file: Option<([u8; 32], u64)>,
    pub state: State,
    /// Median distance from a point to its nearest neighbour, metres; only where asked for.
    spacing: Option<f64>,
}

/// Whether a cloud takes part.
pub(super) enum State {
    Usable,
    Skipped(Skip),
    /// Why, in one line.
    Unreadable(String),
    NoColour,
}

/// Reads the clouds in parallel, one a thread in memory; results are in the order given.
pub(super) fn inspect(clouds: &[&Labelled], preprocess: &Preprocess) -> Vec<Inspected> {
    let every = clouds.len().div_ceil(SPACING_CLOUDS).max(1);
    clouds
        .par_iter()
        .enumerate()
        .map(|(index, cloud)| inspect_one(cloud, preprocess, index % every == 0))
        .collect()
}

fn inspect_one(listed: &Labelled, preprocess: &Preprocess, wants_spacing: bool) -> Inspected {
    let bytes = match read_file(&listed.located.file) {
        Ok(bytes) => bytes,
        Err(reason) => return Inspected { file: None, state: State::Unreadable(reason), spacing: None },
    };
    let file = Some((*blake3::hash(&bytes).as_bytes(), bytes.len() as u64));
    let cloud = match pcd::read(&bytes) {
        Ok(cloud) => cloud,
        Err(error) => return Inspected { file, state: State::Unreadable(first_line(&error)), spacing: None },
    };
    let state = match usable(&cloud, preprocess) {
        Ok(()) => State::Usable,
        Err(PrepareError::Skip(skip)) => State::Skipped(skip),
        Err(PrepareError::NoColours) => State::NoColour,
        Err(error) => State::Unreadable(first_line(&error)),
    };
    let spacing = if wants_spacing { median_spacing(&preprocess.in_metres(&cloud)) } else { None };
    Inspected { file, state, spacing }
}

/// What went wrong without what to do: the data set's own message says that once for all clouds.
fn first_line(error: &impl std::fmt::Display) -> String {
    error.to_string().lines().next().unwrap_or_default().to_owned()
}

/// Median, over points spread through the cloud, of the distance to the nearest other position.
fn median_spacing(cloud: &Cloud) -> Option<f64> {
    let points = &cloud.points;
    let wanted = SPACING_POINTS.min((SPACING_DISTANCES / points.len().max(1)).max(1));
    let every = points.len().div_ceil(wanted).max(1);
    let nearest = |point: &[f32; 3]| {
        let squared = points.iter().map(|other| {
            let [x, y, z] = [0, 1, 2].map(|axis| f64::from(point[axis]) - f64::from(other[axis]));
            x * x + y * y + z * z
        });
        squared.filter(|&d2| d2 > 0.0).min_by(f64::total_cmp).map(f64::sqrt)
    };
    median(points.iter().step_by(every).filter_map(nearest).collect())
}

/// The lower median.
fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len().saturating_sub(1) / 2).copied()
}

/// A warning if the median point spacing of the clouds is implausible, naming the likely remedy.
pub(super) fn spacing_warning(inspected: &[Inspected], unit: Unit) -> Option<String> {
    let spacing = median(inspected.iter().filter_map(|cloud| cloud.spacing).collect())?;
    if PLAUSIBLE_SPACING.contains(&spacing) {
        return None;
    }
    let (name, other, factor) = match unit {
        Unit::Metre => ("m", "mm", 0.001),
        Unit::Millimetre => ("mm", "m", 1000.0),
    };
    let advice = if PLAUSIBLE_SPACING.contains(&(spacing * factor)) {
        format!("the clouds are probably in another unit: set dataset.unit = \"{other}\"")
    } else {
        "convert the clouds to metres or millimetres and set dataset.unit".to_owned()
    };
    Some(format!(
        "dataset.unit: median point spacing of 0.05 mm to 5 cm expected, got {:.1e} mm with unit \"{name}\"\n{advice}",
        spacing * 1000.0
    ))
}
