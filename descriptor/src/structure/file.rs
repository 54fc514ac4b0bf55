//! Structures as TOML that people write: keys as they stand in a file, and what they mean.

use serde::{Deserialize, Serialize, Serializer};

use crate::distance::SetDistance;
use std::ops::RangeInclusive;

use crate::structure::check::{
    GRID, LEAST, RADIUS, SHELL, SQUASH, StructureError, WEIGHT, centimetres, outside,
};
use crate::structure::{Axis, Feature, Pairs, Scale, Structure, StructureChannel, Weighted};

/// A structure file, not yet checked.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct StructureFile {
    /// Version of this format: 1.
    pub version: u32,
    /// The channels, in the order in which their distances are added up.
    #[serde(rename = "channel", default)]
    pub channels: Vec<ChannelFile>,
}

/// A channel of a structure file.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ChannelFile {
    /// Which pairs of points: `keypoint-neighbour`, `neighbours`, `keypoints` or `cloud`.
    pub pairs: String,
    /// What is binned, and into how many bins: `hue 6`, or `angle 60 over 360`.
    pub features: Vec<String>,
    /// One histogram for each feature, side by side, instead of one bin for each combination of their bins.
    #[serde(default, skip_serializing_if = "is_false")]
    pub side_by_side: bool,
    /// s of the squash of unbounded features; only with one, and then needed.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "shortest_of")]
    pub squash: Option<f64>,
    /// Radius of the neighbourhood; for `keypoints` and `cloud` the longest distance of a pair.
    #[serde(serialize_with = "shortest")]
    pub radius_cm: f64,
    /// Shells by the distance of a pair, so many of equal width. Default: 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shells: Option<u32>,
    /// Their outer bounds, instead.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "all_shortest")]
    pub shells_cm: Option<Vec<f64>>,
    /// Smallest distance of a pair. Default: 0.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "shortest_of")]
    pub least_cm: Option<f64>,
    /// Edge of the voxels whose centroids are the keypoints; not for `cloud`, which has none. Default: 2.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "shortest_of")]
    pub grid_cm: Option<f64>,
    /// Pairs that are drawn at each keypoint (`neighbours`) or of the cloud (`cloud`). Default: all of them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples: Option<u32>,
    /// Leave out points without a normal although no feature needs one.
    #[serde(default, skip_serializing_if = "is_false")]
    pub normals_only: bool,
    /// Keep keypoints without a normal where points without one are left out; only for `neighbours`.
    #[serde(default, skip_serializing_if = "is_false")]
    pub all_keypoints: bool,
    /// How rows are compared. Default: `chi2`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metric: Option<String>,
    /// What each value of a signature is multiplied by, 0 to 1, the largest 1: of the mean row in the order of its bins,
    /// then, but for `cloud`, of the deviation; `coordinator weigh` finds them. Default: all 1.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "all_shortest")]
    pub value_weights: Option<Vec<f64>>,
    /// What the channel's distances are multiplied by. Default: 1.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "shortest_of")]
    pub weight: Option<f64>,
    /// What they are divided by before: `quantile`, the distance below which a twentieth of those between labelled
    /// clouds lie, or `none`. Default: `quantile`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<String>,
}

/// Edge of the keypoint grid where none is written, centimetres.
const GRID_CM: f64 = 2.0;

fn is_false(value: &bool) -> bool {
    !value
}

/// A whole number without a point, as people write it.
fn shortest<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    Number(*value).serialize(serializer)
}

fn shortest_of<S: Serializer>(value: &Option<f64>, serializer: S) -> Result<S::Ok, S::Error> {
    value.map(Number).serialize(serializer)
}

fn all_shortest<S: Serializer>(values: &Option<Vec<f64>>, serializer: S) -> Result<S::Ok, S::Error> {
    let numbers = values.as_ref().map(|values| values.iter().map(|&value| Number(value)).collect::<Vec<_>>());
    numbers.serialize(serializer)
}

struct Number(f64);

impl Serialize for Number {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let whole = self.0.fract() == 0.0 && self.0.abs() < 1e9;
        if whole { serializer.serialize_i64(self.0 as i64) } else { serializer.serialize_f64(self.0) }
    }
}

impl StructureFile {
    /// What the file means.
    ///
    /// # Errors
    /// The first thing in it that no structure can have.
    pub fn structure(&self) -> Result<Structure, StructureError> {
        if self.version != 1 {
            let what = format!("must be 1, got {}", self.version);
            return Err(StructureError::new(
                "version",
                what,
                "use a program of the release that wrote the file",
            ));
        }
        let channels = (1..).zip(&self.channels);
        let channels =
            channels.map(|(number, channel)| channel.weighted().map_err(|error| error.in_channel(number)));
        let structure = Structure { channels: channels.collect::<Result<_, _>>()? };
        structure.check()?;
        Ok(structure)
    }
}

impl From<&Structure> for StructureFile {
    /// The file of which [`StructureFile::structure`] makes the structure. What has its default is left out.
    fn from(structure: &Structure) -> Self {
        Self { version: 1, channels: structure.channels.iter().map(ChannelFile::from).collect() }
    }
}

impl ChannelFile {
    fn weighted(&self) -> Result<Weighted, StructureError> {
        let pairs = named("pairs", &self.pairs, Pairs::ALL, Pairs::name)?;
        let axes = self.features.iter().map(|text| axis(text)).collect::<Result<Vec<_>, _>>()?;
        let needs_normals = axes.iter().any(|axis| axis.feature.needs_normals());
        let grid_cm = self.grid_cm.unwrap_or(if pairs == Pairs::Cloud { 0.0 } else { GRID_CM });
        let scale = self.scale.as_deref().map(|name| named("scale", name, Scale::ALL, Scale::name));
        let metric =
            self.metric.as_deref().map(|name| named("metric", name, SetDistance::ALL, SetDistance::name));
        if self.squash == Some(0.0) {
            return Err(StructureError::new("squash", "must be above 0, got 0", "write one, such as 0.3"));
        }
        if self.samples == Some(0) {
            return Err(StructureError::new(
                "samples",
                "must be above 0, got 0",
                "leave it out for all pairs",
            ));
        }
        let mut channel = StructureChannel {
            pairs,
            is_joint: !self.side_by_side || axes.len() == 1,
            axes,
            squash_milli: self.squash.map_or(Ok(0), |value| ticks("squash", value, 1000, SQUASH))?,
            radius_um: micrometres("radius_cm", self.radius_cm, RADIUS)?,
            shells_um: Vec::new(),
            least_um: micrometres("least_cm", self.least_cm.unwrap_or(0.0), LEAST)?,
            grid_um: micrometres("grid_cm", grid_cm, GRID)?,
            samples: self.samples.unwrap_or(0),
            oriented: self.normals_only && !needs_normals,
            all_keypoints: self.all_keypoints,
            metric: metric.transpose()?.unwrap_or_default(),
            value_weights: self.value_weights()?,
        };
        channel.shells_um = self.shells_um(&channel)?;
        Ok(Weighted {
            channel,
            weight_ppm: ticks("weight", self.weight.unwrap_or(1.0), 1_000_000, WEIGHT)?,
            scale: scale.transpose()?.unwrap_or_default(),
        })
    }

    fn value_weights(&self) -> Result<Vec<u16>, StructureError> {
        let full = StructureChannel::FULL;
        let weight = |&value: &f64| {
            let weight = ticks("value_weights", value, full.into(), 0..=full.into())?;
            u16::try_from(weight).ok().filter(|&weight| weight <= full).ok_or_else(|| {
                let what = format!("must be 0 to 1, got {value}");
                StructureError::new("value_weights", what, "divide them by the largest")
            })
        };
        match self.value_weights.as_deref() {
            None => Ok(Vec::new()),
            Some([]) => {
                let what = "there must be one for each value, got none";
                Err(StructureError::new("value_weights", what, "leave them out"))
            }
            Some(weights) => weights.iter().map(weight).collect(),
        }
    }

    fn shells_um(&self, channel: &StructureChannel) -> Result<Vec<u32>, StructureError> {
        let most = StructureChannel::MAX_SHELLS as u32;
        match (self.shells, &self.shells_cm) {
            (Some(_), Some(_)) => {
                let what = "not beside shells_cm, got both";
                Err(StructureError::new("shells", what, "write one of them"))
            }
            (None, Some(bounds)) => {
                bounds.iter().map(|&bound| micrometres("shells_cm", bound, SHELL)).collect()
            }
            (Some(shells), None) if !(1..=most).contains(&shells) => {
                let what = format!("must be 1 to {most}, got {shells}");
                Err(StructureError::new("shells", what, "choose a number inside these limits"))
            }
            (shells, None) => Ok(channel.equal_shells(shells.unwrap_or(1))),
        }
    }
}

impl From<&Weighted> for ChannelFile {
    fn from(weighted: &Weighted) -> Self {
        let Weighted { channel, weight_ppm, scale } = weighted;
        let shells = channel.shells_um.len() as u32;
        let is_equal = channel.has_equal_shells();
        let bounds = || channel.shells_um.iter().map(|&um| centimetres(um)).collect();
        Self {
            pairs: channel.pairs.name().to_owned(),
            features: channel.axes.iter().map(Axis::to_string).collect(),
            side_by_side: !channel.is_joint,
            squash: (channel.squash_milli > 0).then(|| f64::from(channel.squash_milli) / 1000.0),
            radius_cm: centimetres(channel.radius_um),
            shells: (is_equal && shells > 1).then_some(shells),
            shells_cm: (!is_equal).then(bounds),
            least_cm: (channel.least_um > 0).then(|| centimetres(channel.least_um)),
            grid_cm: (channel.pairs != Pairs::Cloud).then(|| centimetres(channel.grid_um)),
            samples: (channel.samples > 0).then_some(channel.samples),
            normals_only: channel.oriented,
            all_keypoints: channel.all_keypoints,
            metric: (channel.metric != SetDistance::default()).then(|| channel.metric.name().to_owned()),
            value_weights: (!channel.value_weights.is_empty()).then(|| {
                let full = f64::from(StructureChannel::FULL);
                channel.value_weights.iter().map(|&weight| f64::from(weight) / full).collect()
            }),
            weight: Some(f64::from(*weight_ppm) / 1e6),
            scale: (*scale != Scale::default()).then(|| scale.name().to_owned()),
        }
    }
}

/// The value of that name.
fn named<T: Copy, const N: usize>(
    key: &'static str,
    name: &str,
    values: [T; N],
    name_of: fn(T) -> &'static str,
) -> Result<T, StructureError> {
    let unknown = || {
        let what = format!("one of {} expected, got {}", values.map(name_of).join(", "), quoted(name));
        StructureError::new(key, what, "write one of these names")
    };
    values.into_iter().find(|&value| name_of(value) == name).ok_or_else(unknown)
}

/// What is binned, from a text such as `hue 6` or `angle 60 over 360`.
fn axis(text: &str) -> Result<Axis, StructureError> {
    let words: Vec<&str> = text.split_ascii_whitespace().take(5).collect();
    let (name, bins, full_turn) = match words[..] {
        [name, bins] => (name, bins, false),
        [name, bins, "over", "360"] => (name, bins, true),
        _ => ("", "", false),
    };
    // More bins than a number holds are refused like others.
    let is_number = !bins.is_empty() && bins.bytes().all(|byte| byte.is_ascii_digit());
    let Some(bins) = is_number.then(|| bins.parse().unwrap_or(u32::MAX)) else {
        let what = format!("name and number of bins expected, got {}", quoted(text));
        return Err(StructureError::new(
            "features",
            what,
            "write them as \"hue 6\" or \"angle 60 over 360\"",
        ));
    };
    Ok(Axis { feature: named("features", name, Feature::ALL, Feature::name)?, bins, full_turn })
}

fn micrometres(key: &'static str, value: f64, limits: RangeInclusive<u32>) -> Result<u32, StructureError> {
    ticks(key, value, 10_000, limits)
}

/// A value as ticks, of which there are so many in its unit. That they are within the limits, in ticks, is checked with the
/// structure; what no ticks can be is refused here.
fn ticks(
    key: &'static str,
    value: f64,
    per_unit: u32,
    limits: RangeInclusive<u32>,
) -> Result<u32, StructureError> {
    let ticks = value * f64::from(per_unit);
    let rounded = ticks.round();
    if !(0.0..=f64::from(u32::MAX)).contains(&rounded) {
        return Err(outside(key, value, per_unit, limits));
    }
    // A decimal is no exact double.
    if (ticks - rounded).abs() > 1e-6 * rounded.max(1.0) {
        let what = format!("must be a multiple of {}, got {value}", 1.0 / f64::from(per_unit));
        return Err(StructureError::new(key, what, "round it"));
    }
    Ok(rounded as u32)
}

/// What a file says, for a message: bounded and on one line.
fn quoted(text: &str) -> String {
    let short: String = text.chars().take(40).collect();
    if short.len() < text.len() { format!("{short:?}…") } else { format!("{short:?}") }
}

#[cfg(test)]
mod tests;
