//! The cache of both programs: what was fetched or computed once, by content, in memory, on this machine's disk and in a
//! folder that machines share. A tier may fail, be slow, full or wrong: that costs time, never a result.

mod bucket_url;
mod entry;
mod evictor;
mod key;
mod layout;
mod listing;
mod lru;
mod memory;
mod options;
mod single_flight;
mod size;
mod store;
mod tier;

pub use bucket_url::{BucketUrl, InvalidBucketUrl, Pruned};
pub use bytesize::ByteSize;
pub use entry::{Damage, MAX_ENTRY_BYTES};
pub use key::KeyBuilder;
pub use lru::Lru;
pub use memory::held_memory;
pub use options::{Storage, StorageArgs, default_memory};
pub use single_flight::Claim;
pub use size::parse_size;
pub use store::Store;
pub use tier::TierReads;

#[cfg(test)]
mod log_capture;
#[cfg(test)]
mod tests;
