//! Reading every cloud once: its digest, whether it can be used, how far apart its points are, and where.

use cache::Store;
use descriptor::prepare::usable;
use descriptor::spacing::{PLAUSIBLE_SPACING, check_spacing, median_spacing, millimetres};
use descriptor::{PrepareError, Preprocess, Skip, Unit, cloud_file};
use proto::Message;
use rayon::prelude::*;

use super::error::DatasetError;
use super::findings::{Finding, Findings, Spacing};
use super::images::cloud_bytes;
use super::labelled::Labelled;
use super::leak::Position;
use super::root::Root;

/// Clouds whose point spacing is looked at.
pub(crate) const SPACING_CLOUDS: usize = 20;
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
        Err(error @ (PrepareError::TooDense { .. } | PrepareError::TooManyKeypoints { .. })) => {
            State::TooDense(Message::of(&error).what)
        }
        Err(error) => State::Unreadable(Message::of(&error).what),
    };
    let spacing = match measured.spacing {
        true => median_spacing(&preprocess.in_metres(&cloud).points).map_or(Spacing::None, Spacing::Metres),
        false => Spacing::NotMeasured,
    };
    let position = if measured.position { Position::of(&cloud.points) } else { None };
    Inspected { file, state, spacing, position }
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

/// Refuses clouds of another unit than the one that is declared, where their spacing says so.
pub(super) fn refuse_unit(
    listed: &[&Labelled],
    inspected: &[Inspected],
    preprocess: &Preprocess,
) -> Result<(), DatasetError> {
    let spaced = spaced(listed, inspected);
    let Some((spacing, cloud)) = spaced.get(spaced.len().saturating_sub(1) / 2) else { return Ok(()) };
    check_spacing(*spacing, preprocess).map_err(|wrong| DatasetError::Unit {
        cloud: cloud.located.path.clone(),
        clouds: spaced.len(),
        wrong,
    })
}

/// A warning if the median point spacing of the clouds is implausible in any unit, or nearly so in its own.
pub(super) fn spacing_warning(listed: &[&Labelled], inspected: &[Inspected], unit: Unit) -> Option<String> {
    let spaced = spaced(listed, inspected);
    let (spacing, cloud) = spaced.get(spaced.len().saturating_sub(1) / 2)?;
    if PLAUSIBLE_SPACING.contains(spacing) {
        return None;
    }
    let advice = if PLAUSIBLE_SPACING.contains(&unit.in_other(*spacing)) {
        format!("the clouds are probably in another unit: set dataset.unit = \"{}\"", unit.other())
    } else {
        "convert the clouds to metres or millimetres and set dataset.unit".to_owned()
    };
    Some(format!(
        "dataset.unit: points 0.05 to 50 mm apart expected, got {} mm with unit = \"{unit}\" in {}, the median of {} clouds\n{advice}",
        millimetres(*spacing),
        cloud.located.path,
        spaced.len(),
    ))
}
