//! Where the channels of a descriptor look, and how their values are divided.

use crate::descriptor::Descriptor;
use crate::disk_ring::Parameters;
use crate::structure::{Pairs, StructureChannel};
use serde::Serialize;

/// A channel as people are shown it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChannelLayout {
    /// Its name.
    pub name: String,
    /// How its values are divided: one part after the other.
    #[serde(rename = "layout")]
    pub parts: Vec<Part>,
    /// Where it looks, around a keypoint; none: at the whole cloud.
    pub regions: Vec<Region>,
}

/// Values that belong together.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Part {
    /// What they are of.
    pub name: String,
    /// Bins of each feature, of which the first varies slowest.
    pub bins: Vec<u32>,
}

/// A region around a keypoint.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Region {
    /// Its name.
    pub name: String,
    /// Distance from the keypoint at which it begins, cm.
    pub inner_cm: f64,
    /// Where it ends, cm.
    pub outer_cm: f64,
}

impl Descriptor {
    /// Its channels as people are shown them, in their order.
    pub fn layouts(&self) -> Vec<ChannelLayout> {
        match self {
            Self::DiskRing(parameters) => disk_ring(parameters),
            Self::Fixed(fixed) => vec![ChannelLayout {
                name: fixed.kind.name().to_owned(),
                parts: vec![Part { name: "keypoints".to_owned(), bins: vec![fixed.kind.size() as u32] }],
                regions: vec![ball("neighbourhood", 0, fixed.radius_um)],
            }],
            Self::GlobalHue(hue) => vec![ChannelLayout {
                name: "hue".to_owned(),
                parts: vec![Part { name: "cloud".to_owned(), bins: vec![hue.bins()] }],
                regions: Vec::new(),
            }],
            Self::Structure(structure) => {
                let channels = (1..).zip(&structure.channels);
                channels.map(|(number, weighted)| of_channel(number, &weighted.channel)).collect()
            }
        }
    }
}

fn disk_ring(parameters: &Parameters) -> Vec<ChannelLayout> {
    let Parameters { shape_bins, colour_bins, disk_um, ring_um, .. } = *parameters;
    let regions = vec![ball("disk", 0, disk_um), ball("ring", disk_um, ring_um)];
    let channel = |name: &str, bins: Vec<u32>| ChannelLayout {
        name: name.to_owned(),
        parts: regions.iter().map(|region| Part { name: region.name.clone(), bins: bins.clone() }).collect(),
        regions: regions.clone(),
    };
    // Angles beyond 180 degrees do not occur.
    let shape = channel("shape", vec![shape_bins.saturating_sub(1) / 2 + 1]);
    vec![shape, channel("colour", vec![colour_bins, colour_bins])]
}

fn of_channel(number: usize, channel: &StructureChannel) -> ChannelLayout {
    let features: Vec<(&str, u32)> =
        channel.axes.iter().map(|axis| (axis.feature.name(), axis.kept_bins())).collect();
    let names: Vec<&str> = features.iter().map(|(name, _)| *name).collect();
    let names = names.join(" × ");
    let is_split = channel.shells_um.len() > 1;
    let mut parts = Vec::new();
    for shell in 1..=channel.shells_um.len() {
        let of_shell = |what: &str| if is_split { format!("shell {shell}: {what}") } else { what.to_owned() };
        if channel.is_joint {
            let bins = features.iter().map(|(_, bins)| *bins).collect();
            parts.push(Part { name: of_shell(&names), bins });
        } else {
            parts
                .extend(features.iter().map(|&(name, bins)| Part { name: of_shell(name), bins: vec![bins] }));
        }
    }
    let regions = match channel.pairs {
        Pairs::KeypointNeighbour => {
            let inner = std::iter::once(channel.least_um).chain(channel.shells_um.iter().copied());
            let shells = inner.zip(channel.shells_um.iter().copied()).enumerate();
            shells
                .map(|(shell, (inner, outer))| ball(&format!("shell {}", shell + 1), inner, outer))
                .collect()
        }
        Pairs::Neighbours => vec![ball("neighbourhood", 0, channel.radius_um)],
        Pairs::Keypoints | Pairs::Cloud => Vec::new(),
    };
    ChannelLayout { name: format!("{number}: {names}"), parts, regions }
}

fn ball(name: &str, inner_um: u32, outer_um: u32) -> Region {
    let centimetres = |um: u32| f64::from(um) / 1e4;
    Region { name: name.to_owned(), inner_cm: centimetres(inner_um), outer_cm: centimetres(outer_um) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_of_the_papers_descriptor_are_its_disk_and_ring() {
        let layouts = Descriptor::DiskRing(Parameters::PAPER_BEST).layouts();
        let regions: Vec<(&str, f64, f64)> = layouts[0]
            .regions
            .iter()
            .map(|region| (&*region.name, region.inner_cm, region.outer_cm))
            .collect();
        assert_eq!(regions, [("disk", 0.0, 1.3), ("ring", 1.3, 3.6)]);
    }
}
