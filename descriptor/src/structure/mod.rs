//! The family `structure`: descriptors that are lists of channels, each of which bins features of pairs of points
//! (DESIGN 5b).

mod bytes;
mod channel;
mod cloud;
mod colours;
mod counts;
mod edges;
mod encoding;
mod extract;
mod feature;
mod lanes;
mod pairs;
mod plan;
mod sampling;
mod scale;

#[cfg(test)]
mod oracle;
#[cfg(test)]
mod tests;

pub use channel::{Axis, Pairs, Scale, StructureChannel};
pub use cloud::StructureCloud;
pub use feature::{Feature, Range};
pub use plan::StructurePlan;
pub use scale::scale;

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
}
