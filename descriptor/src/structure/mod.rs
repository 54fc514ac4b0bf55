//! The family `structure`: descriptors that are lists of channels, each of which bins features of pairs of points
//! (DESIGN 5b).

mod balance;
mod block;
mod bytes;
mod channel;
mod check;
mod cloud;
mod colours;
mod columns;
mod counts;
mod edges;
mod encoding;
mod extract;
mod feature;
mod file;
mod genes;
mod genome;
mod group;
mod least_cost;
mod members;
mod pairs;
mod plan;
mod quads;
mod sampling;
mod scale;
mod shells;
mod table;
mod text;
mod value_order;
mod vector;

#[cfg(test)]
mod oracle;
#[cfg(test)]
mod shipped;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;

pub use channel::{Axis, Pairs, Scale, StructureChannel};
pub use check::StructureError;
pub use cloud::StructureCloud;
pub use feature::{Feature, Range};
pub use file::{ChannelFile, StructureFile};
pub use genome::StructureSpace;
pub use plan::StructurePlan;
pub(crate) use scale::quantile;
pub use scale::{scale, scale_among};

use crate::distance::SetDistance;

/// A descriptor of the family: its channels, in the order in which their distances are added up.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Structure {
    /// 1 to [`Structure::MAX_CHANNELS`].
    pub channels: Vec<Weighted>,
}

/// A channel with what its distances are multiplied by.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Weighted {
    /// The channel.
    pub channel: StructureChannel,
    /// Weight, millionths; above 0.
    pub weight_ppm: u32,
    /// What distances are divided by before.
    pub scale: Scale,
}

impl Structure {
    /// Most channels that a structure may have.
    pub const MAX_CHANNELS: usize = 8;

    /// Most weights of values in all channels together: a task has room for 4 KiB of a descriptor.
    pub const MAX_VALUE_WEIGHTS: usize = 1000;

    /// Bins of all channels together.
    pub fn bins(&self) -> u64 {
        self.channels.iter().fold(0, |sum, one| sum.saturating_add(one.channel.bins()))
    }

    /// Values of a cloud's signatures in all channels together.
    pub fn signature_values(&self) -> u64 {
        self.channels.iter().fold(0, |sum, one| sum.saturating_add(one.channel.values()))
    }

    /// Whether values of some channel have weights of their own.
    pub fn has_value_weights(&self) -> bool {
        self.channels.iter().any(|one| !one.channel.value_weights.is_empty())
    }

    /// Whether it has a structure's only channel.
    pub(crate) fn has_channel(&self, single: &Self) -> bool {
        let [Weighted { channel, .. }] = single.channels.as_slice() else { return false };
        self.channels.iter().any(|own| own.channel == *channel)
    }
}

impl Default for Structure {
    /// A channel that no colour of the light changes, and one of absolute colour.
    fn default() -> Self {
        let axis = |feature, bins| Axis { feature, bins, full_turn: false };
        let channel = |pairs, axes, squash_milli, radius_um, samples| StructureChannel {
            pairs,
            axes,
            is_joint: true,
            squash_milli,
            radius_um,
            shells_um: Vec::new(),
            least_um: 0,
            grid_um: if pairs == Pairs::Cloud { 0 } else { 20_000 },
            samples,
            oriented: false,
            all_keypoints: false,
            metric: SetDistance::ChiSquared,
            value_weights: Vec::new(),
        };
        let opponents = vec![axis(Feature::O1, 8), axis(Feature::O2, 8)];
        let colours = vec![axis(Feature::Distance, 5), axis(Feature::C1, 6), axis(Feature::C2, 6)];
        let channels = [
            channel(Pairs::Neighbours, opponents, 500, 30_000, 256),
            channel(Pairs::Cloud, colours, 300, 120_000, 8192),
        ];
        let weighted = |mut channel: StructureChannel| {
            channel.shells_um.push(channel.longest_um());
            Weighted { channel, weight_ppm: Weighted::UNIT_PPM, scale: Scale::Quantile }
        };
        Self { channels: channels.map(weighted).to_vec() }
    }
}

impl Weighted {
    /// A weight of 1.
    pub const UNIT_PPM: u32 = 1_000_000;

    /// Largest weight, millionths.
    pub const MAX_WEIGHT_PPM: u32 = 1_000_000_000;

    /// What the channel's distances are multiplied by.
    pub fn weight(&self) -> f64 {
        f64::from(self.weight_ppm) / f64::from(Self::UNIT_PPM)
    }
}
