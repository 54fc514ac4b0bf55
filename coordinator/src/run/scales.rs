//! What the distances of channels are divided by, as far as a run has found out.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use cluster::scheduler::Finished;
use cluster::{Client, ClusterError, ClusterNews, FoundScale};
use descriptor::Descriptor;
use proto::task::{DescriptorBytes, Scale};

use crate::run::scaled::{ChannelScale, Scaled};
use crate::run::splits::SplitBlobs;
use crate::tasks;

/// Scales by set of clouds and channel, each as the descriptor of this channel alone.
#[derive(Clone, Debug, Default)]
pub struct Scales(BTreeMap<u32, BTreeMap<Descriptor, FoundScale>>);

/// Scales that are not known, to be asked for.
#[derive(Default)]
pub struct MissingScales {
    /// A task for each.
    pub tasks: Vec<Scale>,
    /// The descriptors that need them.
    pub needed_by: Vec<DescriptorBytes>,
    /// Channel and set of each, with its index.
    channels: BTreeMap<(Descriptor, u32), usize>,
}

impl Scales {
    /// Has the scales of these descriptors' channels in some sets computed that are not known yet.
    pub async fn complete(
        &mut self,
        descriptors: &[&Descriptor],
        sets: &[u32],
        splits: &SplitBlobs<'_>,
        client: &mut Client,
        watch: impl FnMut(&ClusterNews),
    ) -> Result<(), ClusterError> {
        let missing = self.missing(descriptors, sets, splits);
        if missing.tasks.is_empty() {
            return Ok(());
        }
        let found = client.scales(missing.tasks.clone(), &missing.needed_by, watch).await?;
        self.add((missing, found));
        Ok(())
    }

    /// The scales of these descriptors' channels in some sets that are not known yet, those of long tasks first: one that
    /// is begun last leaves all other workers waiting for it.
    pub fn missing(
        &self,
        descriptors: &[&Descriptor],
        sets: &[u32],
        splits: &SplitBlobs<'_>,
    ) -> MissingScales {
        let channels = descriptors.iter().flat_map(|descriptor| descriptor.scaled_channels()).flatten();
        let in_sets = channels.flat_map(|channel| sets.iter().map(move |&set| (channel.clone(), set)));
        let is_known = |(channel, set): &(Descriptor, u32)| {
            self.0.get(set).is_some_and(|known| known.contains_key(channel))
        };
        let missing: BTreeSet<(Descriptor, u32)> = in_sets.filter(|one| !is_known(one)).collect();
        let mut missing: Vec<(Descriptor, u32)> = missing.into_iter().collect();
        missing.sort_by_key(|(channel, _)| Reverse(channel.cost(1, 0)));
        let tasks = missing.iter().map(|(channel, set)| splits.scale(*set, channel)).collect();
        let needed_by = descriptors.iter().map(|descriptor| tasks::descriptor_bytes(descriptor)).collect();
        MissingScales { tasks, needed_by, channels: missing.into_iter().zip(0..).collect() }
    }

    /// Takes in the scales that were missing, in their order.
    pub fn add(&mut self, (missing, found): (MissingScales, Vec<Finished<FoundScale>>)) {
        for ((channel, set), index) in missing.channels {
            self.0.entry(set).or_default().insert(channel, found[index].result.clone());
        }
    }

    /// A descriptor with its scales in a set, of which some are `missing` still.
    ///
    /// # Panics
    /// If one is neither known nor missing: a programming error.
    pub fn of<'a>(&'a self, set: u32, descriptor: &'a Descriptor, missing: &MissingScales) -> Scaled<'a> {
        let channels = descriptor.scaled_channels();
        if channels.iter().all(Option::is_none) {
            return Scaled::from(descriptor);
        }
        let scale = |channel: Option<Descriptor>| match channel {
            None => ChannelScale::One,
            Some(channel) => match self.0.get(&set).and_then(|known| known.get(&channel)) {
                Some(found) => ChannelScale::Found(found),
                None => ChannelScale::Awaited(missing.channels[&(channel, set)]),
            },
        };
        Scaled { descriptor, scales: channels.into_iter().map(scale).collect() }
    }
}
