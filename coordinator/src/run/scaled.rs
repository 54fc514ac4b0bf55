//! A descriptor as it is evaluated: with what its channels' distances are divided by.

use cluster::FoundScale;
use descriptor::Descriptor;

/// A descriptor with the scale of each of its channels.
#[derive(Clone, Debug)]
pub struct Scaled<'a> {
    /// The descriptor.
    pub descriptor: &'a Descriptor,
    /// One a channel; none in families without scales.
    pub scales: Vec<ChannelScale<'a>>,
}

/// What a channel's distances are divided by.
#[derive(Clone, Copy, Debug)]
pub enum ChannelScale<'a> {
    /// Nothing: it has no scale of its own.
    One,
    /// This.
    Found(&'a FoundScale),
    /// It is asked for with the evaluation, and has this index there.
    Awaited(usize),
}

impl<'a> From<&'a Descriptor> for Scaled<'a> {
    /// Of a family without scales.
    fn from(descriptor: &'a Descriptor) -> Self {
        Self { descriptor, scales: Vec::new() }
    }
}
