//! Which structures any experiment may use: one check for those that are read from bytes, files and tables.

use std::ops::RangeInclusive;

use crate::structure::{Axis, Feature, Pairs, Structure, StructureChannel, Weighted};

/// Why something is no structure, or no space of structures.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{place}: {what}\n{advice}")]
pub struct StructureError {
    /// Which value: a key of structure files, after the channel that it is of, such as `channel 2: squash`.
    pub place: String,
    /// What is wrong, ending in the value that was found.
    pub what: String,
    /// What to do about it.
    pub advice: &'static str,
}

impl StructureError {
    pub(super) fn new(place: impl Into<String>, what: impl Into<String>, advice: &'static str) -> Self {
        Self { place: place.into(), what: what.into(), advice }
    }

    /// The same, in a channel, counted from 1.
    pub(super) fn in_channel(self, number: usize) -> Self {
        Self { place: format!("channel {number}: {}", self.place), ..self }
    }
}

/// Micrometres in a metre.
const METRE: u32 = 1_000_000;

/// Radii of a channel, micrometres.
pub(super) const RADIUS: RangeInclusive<u32> = 1..=METRE;
/// Edges of the grid, micrometres.
pub(super) const GRID: RangeInclusive<u32> = 1_000..=METRE;
/// Bounds of shells, micrometres: both points of a pair are within a radius.
pub(super) const SHELL: RangeInclusive<u32> = 1..=2 * METRE;
/// Smallest distances of a pair, micrometres.
pub(super) const LEAST: RangeInclusive<u32> = 0..=2 * METRE;
/// s of the squash, thousandths.
pub(super) const SQUASH: RangeInclusive<u32> = 1..=10_000;
/// Weights of a channel, millionths.
pub(super) const WEIGHT: RangeInclusive<u32> = 1..=Weighted::MAX_WEIGHT_PPM;

/// Micrometres as centimetres.
pub(super) fn centimetres(um: u32) -> f64 {
    f64::from(um) / 1e4
}

/// Ticks as a value in the unit of which there are so many.
fn in_units(ticks: u32, per_unit: u32) -> f64 {
    f64::from(ticks) / f64::from(per_unit)
}

fn within(
    key: &'static str,
    ticks: u32,
    per_unit: u32,
    limits: RangeInclusive<u32>,
) -> Result<(), StructureError> {
    if limits.contains(&ticks) {
        Ok(())
    } else {
        Err(outside(key, in_units(ticks, per_unit), per_unit, limits))
    }
}

/// That a value is not within limits, which are given in ticks.
pub(super) fn outside(
    key: &'static str,
    value: f64,
    per_unit: u32,
    limits: RangeInclusive<u32>,
) -> StructureError {
    let [low, high] = [*limits.start(), *limits.end()].map(|ticks| in_units(ticks, per_unit));
    // One of hundreds of digits would fill the screen.
    let got = if value.abs() < 1e12 { value.to_string() } else { format!("{value:e}") };
    StructureError::new(
        key,
        format!("must be {low} to {high}, got {got}"),
        "choose a value inside these limits",
    )
}

impl Structure {
    /// Refuses what no experiment may use.
    ///
    /// # Errors
    /// The first thing that is wrong with it.
    pub fn check(&self) -> Result<(), StructureError> {
        let (most, got) = (Self::MAX_CHANNELS, self.channels.len());
        if !(1..=most).contains(&got) {
            let what = format!("there must be 1 to {most}, got {got}");
            return Err(StructureError::new("channel", what, "write one [[channel]] for each"));
        }
        let mut numbered = (1..).zip(&self.channels);
        numbered
            .try_for_each(|(number, weighted)| weighted.check().map_err(|error| error.in_channel(number)))?;
        let weights: usize = self.channels.iter().map(|one| one.channel.value_weights.len()).sum();
        if weights > Self::MAX_VALUE_WEIGHTS {
            let what = format!(
                "must be at most {} in all channels together, got {weights}",
                Self::MAX_VALUE_WEIGHTS
            );
            return Err(StructureError::new("value_weights", what, "leave those of the largest channel out"));
        }
        Ok(())
    }
}

impl Weighted {
    fn check(&self) -> Result<(), StructureError> {
        self.channel.check()?;
        within("weight", self.weight_ppm, 1_000_000, WEIGHT)
    }
}

impl StructureChannel {
    /// Most shells of a channel.
    pub const MAX_SHELLS: usize = 8;

    /// Most values of a row.
    pub const MAX_ROW: u64 = 16_384;

    /// Numbers of bins that a feature may have.
    pub(super) const BINS: RangeInclusive<u32> = 2..=64;

    /// Refuses what no experiment may use. Of several ways to say the same only one is allowed, so that equal channels are
    /// equal values.
    ///
    /// # Errors
    /// The first thing that is wrong with it.
    pub fn check(&self) -> Result<(), StructureError> {
        self.check_features()?;
        self.check_squash()?;
        within("radius_cm", self.radius_um, 10_000, RADIUS)?;
        self.check_shells()?;
        self.check_points()?;
        self.check_value_weights()?;
        if self.bins() > Self::MAX_ROW {
            let what = format!("must make at most {} values a row, got {}", Self::MAX_ROW, self.bins());
            return Err(StructureError::new("features", what, "take fewer bins, features or shells"));
        }
        Ok(())
    }

    fn check_value_weights(&self) -> Result<(), StructureError> {
        let wrong = |what: String, advice| Err(StructureError::new("value_weights", what, advice));
        let weights = &self.value_weights;
        if weights.is_empty() {
            return Ok(());
        }
        let (values, got) = (self.values(), weights.len());
        if got as u64 != values {
            let what = format!("there must be {values}, one for each value, got {got}");
            return wrong(what, "count the bins, twice where there is a deviation, or leave them out");
        }
        if weights.iter().all(|&weight| weight == Self::FULL) {
            return wrong(format!("must not all be 1, got {got} such"), "leave them out");
        }
        match weights.iter().max() {
            Some(&Self::FULL) => Ok(()),
            largest => {
                let what = format!(
                    "the largest must be 1, got {}",
                    in_units(largest.map_or(0, |&weight| weight.into()), Self::FULL.into())
                );
                wrong(what, "divide them by the largest, and multiply weight by it")
            }
        }
    }

    fn check_features(&self) -> Result<(), StructureError> {
        let wrong = |what: String, advice| Err(StructureError::new("features", what, advice));
        let axes = &self.axes;
        if !(1..=Self::MAX_AXES).contains(&axes.len()) {
            let what = format!("must be 1 to {}, got {}", Self::MAX_AXES, axes.len());
            return wrong(what, "name what is binned, such as \"hue 6\"");
        }
        for (place, &Axis { feature, bins, full_turn }) in axes.iter().enumerate() {
            if axes[..place].iter().any(|axis| axis.feature == feature) {
                return wrong(format!("must differ, got {feature} twice"), "write each feature once");
            }
            if !Self::BINS.contains(&bins) {
                let (least, most) = Self::BINS.into_inner();
                let what = format!("must have {least} to {most} bins, got {bins} of {feature}");
                return wrong(what, "choose a number inside these limits");
            }
            if full_turn && feature != Feature::Angle {
                let what = format!("only bins of angle may be over 360 degrees, got {feature}");
                return wrong(what, "write its bins alone");
            }
        }
        if axes.len() == 1 && !self.is_joint {
            let what = "must be false for a single feature, got true";
            return Err(StructureError::new("side_by_side", what, "leave it out"));
        }
        Ok(())
    }

    fn check_squash(&self) -> Result<(), StructureError> {
        let squashed = self.axes.iter().map(|axis| axis.feature).find(|feature| feature.is_squashed());
        match (squashed, self.squash_milli) {
            (None, 0) => Ok(()),
            (None, got) => {
                let what = format!("needed by no feature, got {}", in_units(got, 1000));
                Err(StructureError::new("squash", what, "leave it out"))
            }
            (Some(feature), 0) => {
                let what = format!("needed by {feature}, got none");
                Err(StructureError::new("squash", what, "write one, such as 0.3"))
            }
            (Some(_), got) => within("squash", got, 1000, SQUASH),
        }
    }

    fn check_shells(&self) -> Result<(), StructureError> {
        let wrong = |what: String, advice| Err(StructureError::new("shells_cm", what, advice));
        let shells = &self.shells_um;
        if !(1..=Self::MAX_SHELLS).contains(&shells.len()) {
            let what = format!("must be 1 to {}, got {}", Self::MAX_SHELLS, shells.len());
            return wrong(what, "write the outer bound of each");
        }
        let mut inner = 0;
        for &outer in shells {
            if outer <= inner {
                let what = format!(
                    "must ascend from above 0, got {} after {}",
                    centimetres(outer),
                    centimetres(inner)
                );
                return wrong(what, "write outer bounds from the smallest to the largest");
            }
            inner = outer;
        }
        if inner > self.longest_um() {
            let (longest, got) = (centimetres(self.longest_um()), centimetres(inner));
            let what = format!("must be at most {longest}, the longest distance of a pair, got {got}");
            return wrong(what, "lower it or raise the radius");
        }
        if !self.has_pairs() {
            let (last, got) = (centimetres(inner), centimetres(self.least_um));
            let what = format!("must be below {last}, where the last shell ends, got {got}");
            return Err(StructureError::new("least_cm", what, "lower it, so that there are pairs"));
        }
        Ok(())
    }

    /// The points that are paired.
    fn check_points(&self) -> Result<(), StructureError> {
        let pairs = self.pairs.name();
        if self.pairs != Pairs::Cloud {
            within("grid_cm", self.grid_um, 10_000, GRID)?;
        } else if self.grid_um != 0 {
            let what = format!("pairs of a cloud have no keypoints, got {}", centimetres(self.grid_um));
            return Err(StructureError::new("grid_cm", what, "leave it out"));
        }
        let most = if self.pairs.is_sampled() { 65_536 } else { 0 };
        if self.samples > most {
            let error = |what: String, advice| Err(StructureError::new("samples", what, advice));
            return match most {
                0 => error(format!("all {pairs} pairs are taken, got {}", self.samples), "leave it out"),
                _ => error(
                    format!("must be 1 to {most}, got {}", self.samples),
                    "lower it, or leave it out for all",
                ),
            };
        }
        let needing = self.axes.iter().find(|axis| axis.feature.needs_normals());
        if let Some(axis) = needing.filter(|_| self.oriented) {
            let what = format!("implied by {}, got true", axis.feature);
            return Err(StructureError::new("normals_only", what, "leave it out"));
        }
        let of_keypoints = |what: &str| Err(StructureError::new("all_keypoints", what, "leave it out"));
        match self.all_keypoints {
            true if self.pairs != Pairs::Neighbours => {
                of_keypoints(&format!("only of neighbours, got true of {pairs}"))
            }
            true if !self.needs_normals() => of_keypoints("implied where points need no normal, got true"),
            _ => Ok(()),
        }
    }
}
