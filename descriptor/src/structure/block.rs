//! How many points and pairs are computed together.

/// Points that are looked at or left out together: as many as the widest vectors hold.
pub(super) const BLOCK: usize = 16;

/// Pairs that are computed together, each in a lane of its own.
pub(super) const LANES: usize = 4 * BLOCK;
