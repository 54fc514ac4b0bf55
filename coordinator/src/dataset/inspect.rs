//! Reading every cloud once: its digest, whether it can be used, how far apart its points are, and where.

use cache::Store;
use descriptor::prepare::usable;
use descriptor::{Cloud, PrepareError, Preprocess, Skip, Unit, cloud_file};
use proto::Message;
use rayon::prelude::*;

use super::error::DatasetError;
use super::findings::{Finding, Findings, Spacing};
use super::images::cloud_bytes;
use super::labelled::Labelled;
use super::leak::Position;
use super::root::Root;

/// Clouds whose point spacing is looked at.
const SPACING_CLOUDS: usize = 20;
/// Distances computed for the spacing of one cloud, at most.
const SPACING_DISTANCES: usize = 5_000_000;
/// Points of a cloud whose nearest neighbour is looked for, at most.
const SPACING_POINTS: usize = 200;
/// Plausible medians, metres. Depth cameras see household objects at 0.5 to 10 mm, desktop scanners down to
/// 0.1 mm; beyond these bounds the unit is wrong, or no neighbourhood of some centimetres has points.
const PLAUSIBLE_SPACING: std::ops::RangeInclusive<f64> = 0.000_05..=0.05;
/// Below this median, metres, clouds of a plausible other unit are refused: a scanner with points 0.02 mm apart, taken
/// for one in metres, would have them 2 cm apart, which is no longer clearly absurd.
const LEAST_SPACING: f64 = 0.000_02;

/// What reading one cloud gave.
pub(super) struct Inspected {
    /// BLAKE3 of the file's bytes and their number; `None` if they could not be read.
    pub file: Option<([u8; 32], u64)>,
    pub state: State,
    /// Measured only where asked for.
    spacing: Spacing,
    /// Only where asked for, and of clouds with points.
    pub position: Option<Position>,
}

/// What is measured of a cloud beside whether it can be used.
#[derive(Clone, Copy)]
struct Measured {
    spacing: bool,
    position: bool,
}

/// Whether a cloud takes part.
pub(super) enum State {
    Usable,
    Skipped(Skip),
    /// Why, in one line.
    Unreadable(String),
    NoColour,
    /// Its neighbourhoods would take minutes; why, in one line.
    TooDense(String),
}

impl Inspected {
    /// What the next start need not find out again.
    fn finding(&self) -> Option<([u8; 32], Finding)> {
        let usable = match self.state {
            State::Usable => Ok(()),
            State::Skipped(skip) => Err(skip),
            State::Unreadable(_) | State::NoColour | State::TooDense(_) => return None,
        };
        let (digest, _) = self.file?;
        Some((digest, Finding { usable, spacing: self.spacing }))
    }
}

/// Reads the clouds in parallel, one a thread in memory; results are in the order given. Files with the bytes of an
/// earlier start are read, but not looked into; the first `positioned` clouds are, for their positions.
pub(super) fn inspect(
    clouds: &[&Labelled],
    positioned: usize,
    root: &Root,
    preprocess: &Preprocess,
    store: Option<&Store>,
) -> Vec<Inspected> {
    let every = clouds.len().div_ceil(SPACING_CLOUDS).max(1);
    let mut known = store.map(|store| Findings::read(store, root.path(), preprocess)).unwrap_or_default();
    let inspected: Vec<Inspected> = clouds
        .par_iter()
        .enumerate()
        .map(|(index, cloud)| {
            let measured = Measured { spacing: index % every == 0, position: index < positioned };
            inspect_one(cloud, root, preprocess, measured, &known)
        })
        .collect();
    if let Some(store) = store
        && known.learn(inspected.iter().filter_map(Inspected::finding))
    {
        known.write(store, root.path(), preprocess);
    }
    inspected
}

fn inspect_one(
    listed: &Labelled,
    root: &Root,
    preprocess: &Preprocess,
    measured: Measured,
    known: &Findings,
) -> Inspected {
    let unreadable = |file, reason| {
        let (state, spacing) = (State::Unreadable(reason), Spacing::NotMeasured);
        Inspected { file, state, spacing, position: None }
    };
    let bytes = match cloud_bytes(&root.path().join(&listed.located.path)) {
        Ok(bytes) => bytes,
        Err(reason) => return unreadable(None, reason),
    };
    let digest = *blake3::hash(&bytes).as_bytes();
    let file = Some((digest, bytes.len() as u64));
    if let Some(Finding { usable, spacing }) = known.get(&digest)
        && !(measured.spacing && *spacing == Spacing::NotMeasured)
        && !measured.position
    {
        let spacing = if measured.spacing { *spacing } else { Spacing::NotMeasured };
        let state = usable.map_or_else(State::Skipped, |()| State::Usable);
        return Inspected { file, state, spacing, position: None };
    }
    let cloud = match cloud_file::read(&bytes) {
        Ok(cloud) => cloud,
        Err(error) => return unreadable(file, Message::of(&error).what),
    };
    let state = match usable(&cloud, preprocess) {
        Ok(()) => State::Usable,
        Err(PrepareError::Skip(skip)) => State::Skipped(skip),
        Err(PrepareError::NoColours) => State::NoColour,
        Err(error @ PrepareError::TooDense { .. }) => State::TooDense(Message::of(&error).what),
        Err(error) => State::Unreadable(Message::of(&error).what),
    };
    let spacing =
        if measured.spacing { median_spacing(&preprocess.in_metres(&cloud)) } else { Spacing::NotMeasured };
    let position = if measured.position { Position::of(&cloud.points) } else { None };
    Inspected { file, state, spacing, position }
}

/// Median, over points spread through the cloud, of the distance to the nearest other position.
fn median_spacing(cloud: &Cloud) -> Spacing {
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
    let nearest = points.iter().step_by(every).filter_map(nearest);
    median(nearest.collect()).map_or(Spacing::None, Spacing::Metres)
}

/// The lower median.
fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len().saturating_sub(1) / 2).copied()
}

/// The clouds whose points' spacing was measured, by that spacing in metres.
fn spaced<'a>(listed: &[&'a Labelled], inspected: &[Inspected]) -> Vec<(f64, &'a Labelled)> {
    let metres = |(cloud, inspected): (&&'a Labelled, &Inspected)| match inspected.spacing {
        Spacing::Metres(metres) => Some((metres, *cloud)),
        Spacing::NotMeasured | Spacing::None => None,
    };
    let mut spaced: Vec<_> = listed.iter().zip(inspected).filter_map(metres).collect();
    spaced.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    spaced
}

/// Refuses clouds of another unit than the one that is declared, where their spacing says so: it is that of no sensor,
/// and would be that of one in the other unit. Normals over a larger radius than usual go with sparser clouds.
pub(super) fn refuse_unit(
    listed: &[&Labelled],
    inspected: &[Inspected],
    preprocess: &Preprocess,
) -> Result<(), DatasetError> {
    let spaced = spaced(listed, inspected);
    let Some((spacing, cloud)) = spaced.get(spaced.len().saturating_sub(1) / 2) else { return Ok(()) };
    let most = PLAUSIBLE_SPACING.end().max(preprocess.normal_radius());
    let (unit, other, factor) = names(preprocess.unit);
    if (LEAST_SPACING..=most).contains(spacing) || !PLAUSIBLE_SPACING.contains(&(spacing * factor)) {
        return Ok(());
    }
    let millimetres = |metres| two_digits(metres * 1000.0);
    Err(DatasetError::Unit {
        cloud: cloud.located.path.clone(),
        clouds: spaced.len(),
        spacing: millimetres(*spacing),
        expected: [LEAST_SPACING, most].map(millimetres),
        unit,
        other,
    })
}

/// A unit's name, the other's, and what a length in metres is multiplied by to be read in the other.
fn names(unit: Unit) -> (&'static str, &'static str, f64) {
    match unit {
        Unit::Metre => ("m", "mm", 0.001),
        Unit::Millimetre => ("mm", "m", 1000.0),
    }
}

/// A number to two significant digits, without an exponent.
fn two_digits(value: f64) -> f64 {
    format!("{value:.1e}").parse().unwrap_or(value)
}

/// A warning if the median point spacing of the clouds is implausible in any unit, or nearly so in its own.
pub(super) fn spacing_warning(listed: &[&Labelled], inspected: &[Inspected], unit: Unit) -> Option<String> {
    let spaced = spaced(listed, inspected);
    let (spacing, cloud) = spaced.get(spaced.len().saturating_sub(1) / 2)?;
    if PLAUSIBLE_SPACING.contains(spacing) {
        return None;
    }
    let (unit, other, factor) = names(unit);
    let advice = if PLAUSIBLE_SPACING.contains(&(spacing * factor)) {
        format!("the clouds are probably in another unit: set dataset.unit = \"{other}\"")
    } else {
        "convert the clouds to metres or millimetres and set dataset.unit".to_owned()
    };
    Some(format!(
        "dataset.unit: points 0.05 to 50 mm apart expected, got {} mm with unit = \"{unit}\" in {}, the median of {} clouds\n{advice}",
        two_digits(spacing * 1000.0),
        cloud.located.path,
        spaced.len(),
    ))
}
