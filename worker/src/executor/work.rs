//! What a worker has done so far, for its log and for tests of what is not done twice.

/// Counts since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Clouds prepared from their source.
    pub prepared: u64,
    /// Prepared clouds read from this machine's disk or the shared folder.
    pub loaded: u64,
    /// Prepared clouds that came from the coordinator.
    pub fetched: u64,
    /// Signatures computed: shape and colour of one cloud are two.
    pub described: u64,
    /// Signatures read from this machine's disk.
    pub restored: u64,
    /// Encoded signatures of shards that came from the coordinator.
    pub handed: u64,
    /// Distance matrices computed.
    pub matched: u64,
    /// Evaluations matched by pruning, without distance matrices.
    pub pruned: u64,
    /// Splits whose disks were described for grid cells.
    pub disks_described: u64,
    /// Grid cells whose disk distances were computed, to be kept for others.
    pub disks_compared: u64,
    /// Grid cells computed.
    pub cells: u64,
}
