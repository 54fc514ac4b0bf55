//! The family `structure`: descriptors that are lists of channels, each of which bins features of pairs of points
//! (DESIGN 5b).

mod bytes;
mod channel;
mod check;
mod columns;
mod feature;
mod file;
mod genes;
mod genome;
mod shells;
#[cfg(test)]
mod testing;
mod text;

pub use channel::{Axis, Pairs, Scale, StructureChannel};
pub use check::StructureError;
pub use feature::{Feature, Range};
pub use file::{ChannelFile, StructureFile};
pub use genome::{FieldSpec, StructureSpace};

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
