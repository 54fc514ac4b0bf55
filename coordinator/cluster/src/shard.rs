//! Pieces of an evaluation: what is asked of a worker, and what it may answer.

use std::sync::Arc;

use descriptor::Descriptor;
use proto::Digest;

use crate::evaluation::Evaluation;

/// Describe the clouds of one shard.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Description {
    /// The descriptor.
    pub descriptor: Descriptor,
    /// The shard: a split manifest.
    pub manifest: Digest,
    /// Clouds in it.
    pub clouds: u32,
}

/// What describing a shard gives.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Described {
    /// Names the description.
    pub digest: Digest,
    /// The description itself; `None` of one that is remembered by its name.
    pub parts: Option<Arc<[u8]>>,
}

/// Match some shards whose clouds were described before.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tile {
    /// Of these shards.
    pub evaluation: Evaluation,
    /// For each shard of the queries its description.
    pub query_parts: Vec<Digest>,
    /// For each shard of the database its description.
    pub database_parts: Vec<Digest>,
}

impl Description {
    /// Refuses an answer that cannot be the shard's description.
    pub fn check(&self, described: &Described) -> Result<(), String> {
        let Some(parts) = &described.parts else { return Ok(()) };
        self.descriptor.check_description(parts, self.clouds).map_err(|error| error.to_string())
    }
}

impl Described {
    /// A description that a worker has made.
    pub fn new(parts: Vec<u8>) -> Self {
        Self { digest: Digest::of(&parts), parts: Some(parts.into()) }
    }

    /// Its name alone.
    pub fn named(digest: Digest) -> Self {
        Self { digest, parts: None }
    }
}

#[cfg(test)]
mod tests {
    use descriptor::Parameters;

    use super::*;

    #[test]
    fn what_cannot_be_a_shards_description_is_refused() {
        let descriptor = Descriptor::DiskRing(Parameters::PAPER_BEST);
        let shard = Description { descriptor, manifest: Digest([1; 32]), clouds: 3 };
        let length = descriptor.description_length(3) as usize;
        assert_eq!(shard.check(&Described::new(vec![0; length])), Ok(()));
        assert_eq!(shard.check(&Described::named(Digest([2; 32]))), Ok(()));
        assert!(shard.check(&Described::new(vec![0; length - 4])).is_err());
        assert!(shard.check(&Described::new(vec![0xff; length])).is_err(), "no numbers");
    }
}
