//! A descriptor as it is evaluated: with what its channels' distances are divided by.

use descriptor::Descriptor;
use proto::task::DescribedSplit;

/// A descriptor with the scale of each of its channels; without any in families that have none.
#[derive(Clone, Debug)]
pub struct Scaled<'a> {
    /// The descriptor.
    pub descriptor: &'a Descriptor,
    /// One a channel, or none: then all are 1.
    pub scales: Vec<f64>,
    /// What was described for them.
    pub described: Vec<DescribedSplit>,
}

impl<'a> From<&'a Descriptor> for Scaled<'a> {
    /// With scales of 1.
    fn from(descriptor: &'a Descriptor) -> Self {
        Self { descriptor, scales: Vec::new(), described: Vec::new() }
    }
}
