//! The descriptors that a search has met, of which there may be millions.

use std::path::Path;

use cluster::ClusterError;
use cluster::spill::SpillMap;
use descriptor::Descriptor;

use crate::tasks::descriptor_bytes;
use proto::task::DescriptorBytes;

/// What a search notes of the descriptors that it has met.
pub struct Met {
    /// The generation in which each came first.
    generations: SpillMap,
    /// Of those that were evaluated on several sets the error in each.
    set_errors: SpillMap,
    /// Their number is what a budget of evaluations is spent on, whatever earlier runs have left.
    count: u64,
}

impl Met {
    /// Nothing yet, of a run with this folder.
    pub fn new(folder: &Path) -> Self {
        Self { generations: SpillMap::new(Some(folder)), set_errors: SpillMap::new(Some(folder)), count: 0 }
    }

    /// How many there are.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// In which generation a descriptor came first, if it was met.
    ///
    /// # Errors
    /// [`ClusterError::Spill`], here and below, if what has outgrown memory cannot be read any more.
    pub fn generation(&self, descriptor: &DescriptorBytes) -> Result<Option<u32>, ClusterError> {
        let bytes = self.generations.get(descriptor.bytes()).map_err(ClusterError::Spill)?;
        Ok(bytes.and_then(|bytes| bytes.first_chunk().map(|bytes| u32::from_le_bytes(*bytes))))
    }

    /// Whether a descriptor was met.
    pub fn contains(&self, descriptor: &Descriptor) -> Result<bool, ClusterError> {
        self.generations.contains(descriptor_bytes(descriptor).bytes()).map_err(ClusterError::Spill)
    }

    /// Notes that a descriptor that was not met comes in a generation.
    pub fn insert(&mut self, descriptor: &Descriptor, generation: u32) {
        self.generations.insert(descriptor_bytes(descriptor).bytes(), generation.to_le_bytes().to_vec());
        self.count += 1;
    }

    /// The error of a descriptor in each set, where there are several.
    pub fn set_errors(&self, descriptor: &Descriptor) -> Result<Option<Vec<f32>>, ClusterError> {
        let bytes = self.set_errors.get(descriptor_bytes(descriptor).bytes()).map_err(ClusterError::Spill)?;
        let errors =
            |bytes: Vec<u8>| bytes.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
        Ok(bytes.map(errors))
    }

    /// Notes the error of a descriptor in each set.
    pub fn insert_set_errors(&mut self, descriptor: &Descriptor, errors: &[f32]) {
        let bytes = errors.iter().flat_map(|error| error.to_le_bytes()).collect();
        self.set_errors.insert(descriptor_bytes(descriptor).bytes(), bytes);
    }
}
