//! Accepted results by the descriptors they are about: a search asks for those of its best descriptor in every generation,
//! while nothing else is decided, so that this must not take longer the more results there are.

use std::collections::BTreeSet;

use proto::task::{Description, DescriptorBytes, Scale, Task};
use proto::{Digest, JobId};

use super::archive::Archive;
use crate::scheduler::{Channel, ChannelsOf, Finished};
use crate::spill::{SpillError, SpillMap};

/// Which jobs may be about a descriptor. A job is never taken out: what is found is looked at.
pub(super) struct AcceptedIndex {
    channels_of: ChannelsOf,
    /// Jobs after the start of a digest of their descriptor, and those about its channels after the number of the first: 16
    /// bytes for each, as there may be millions.
    jobs: SpillMap,
}

impl AcceptedIndex {
    pub(super) fn new(channels_of: ChannelsOf, jobs: SpillMap) -> Self {
        Self { channels_of, jobs }
    }

    /// Why some of it cannot be read any more, if so: see [`Archive::failure`].
    pub(super) fn failure(&self) -> Option<&SpillError> {
        self.jobs.failure()
    }

    pub(super) fn insert(&mut self, job: JobId, task: &Task) {
        self.jobs.insert(&key(number(&task.subject().descriptor), job), Vec::new());
        if let Some(first) = self.channels(task).first() {
            self.jobs.insert(&key(first.number, job), Vec::new());
        }
    }

    /// Of the results in the archive, those whose task is about a descriptor, or about nothing but channels of it, by job.
    pub(super) fn find(&self, descriptor: &DescriptorBytes, archive: &Archive) -> Vec<(Task, Finished)> {
        let channels = (self.channels_of)(descriptor);
        let is_about = |task: &Task| {
            let of_task = self.channels(task);
            let is_of_channels = || of_task.iter().all(|channel| channels.contains(channel));
            task.subject().descriptor == *descriptor || !of_task.is_empty() && is_of_channels()
        };
        let numbers = channels.iter().map(|channel| channel.number).chain([number(descriptor)]);
        let jobs: BTreeSet<JobId> = numbers.flat_map(|number| self.with_number(number)).collect();
        archive.select(&jobs, is_about).into_values().collect()
    }

    fn with_number(&self, number: u64) -> impl Iterator<Item = JobId> {
        let keys = self.jobs.keys(&key(number, JobId(0)), &key(number, JobId(u64::MAX)));
        keys.unwrap_or_default()
            .into_iter()
            .filter_map(|key| Some(JobId(u64::from_be_bytes(*key.last_chunk()?))))
    }

    /// The channels that a task is about, whichever descriptors have them.
    fn channels(&self, task: &Task) -> Vec<Channel> {
        match task {
            Task::Scale(Scale { subject, .. }) | Task::Description(Description { subject, .. }) => {
                (self.channels_of)(&subject.descriptor)
            }
            Task::Evaluation(_) | Task::Tile(_) | Task::GridCell(_) => Vec::new(),
        }
    }
}

/// Jobs of one number lie together.
fn key(number: u64, JobId(job): JobId) -> [u8; 16] {
    (u128::from(number) << 64 | u128::from(job)).to_be_bytes()
}

fn number(descriptor: &DescriptorBytes) -> u64 {
    let Digest(bytes) = Digest::of(descriptor.bytes());
    bytes.first_chunk().map_or(0, |start| u64::from_le_bytes(*start))
}
