//! How many points and pairs are looked at together.

/// Points that are looked at or left out together: as many as the widest vectors hold.
pub(super) const BLOCK: usize = 16;

/// Drawn pairs that are fetched together, and codes that are counted together.
pub(super) const LANES: usize = 4 * BLOCK;
