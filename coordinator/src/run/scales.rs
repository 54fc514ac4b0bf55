//! What the distances of channels are divided by, as far as a run has found out.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use cluster::{Client, ClusterError, ClusterNews};
use descriptor::Descriptor;

use crate::run::scaled::Scaled;
use crate::run::splits::SplitBlobs;

/// Scales by set of clouds and channel, each as the descriptor of this channel alone.
#[derive(Clone, Debug, Default)]
pub struct Scales(BTreeMap<u32, BTreeMap<Descriptor, f64>>);

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
        let channels = descriptors.iter().flat_map(|descriptor| descriptor.scaled_channels()).flatten();
        let in_sets = channels.flat_map(|channel| sets.iter().map(move |&set| (channel.clone(), set)));
        let is_known = |(channel, set): &(Descriptor, u32)| {
            self.0.get(set).is_some_and(|known| known.contains_key(channel))
        };
        let missing: BTreeSet<(Descriptor, u32)> = in_sets.filter(|one| !is_known(one)).collect();
        if missing.is_empty() {
            return Ok(());
        }
        // Long ones first: a long one that is begun last leaves all other workers waiting for it.
        let mut missing: Vec<(Descriptor, u32)> = missing.into_iter().collect();
        missing.sort_by_key(|(channel, _)| Reverse(channel.cost(1, 0)));
        let asked = missing.iter().map(|(channel, set)| splits.scale(*set, channel)).collect();
        let found = client.scales(asked, watch).await?;
        for ((channel, set), finished) in missing.into_iter().zip(found) {
            self.0.entry(set).or_default().insert(channel, finished.result);
        }
        Ok(())
    }

    /// A descriptor with its scales in a set, which [`Scales::complete`] has found.
    ///
    /// # Panics
    /// If it has not: a programming error.
    pub fn of<'a>(&self, set: u32, descriptor: &'a Descriptor) -> Scaled<'a> {
        let channels = descriptor.scaled_channels();
        let scale =
            |channel: &Option<Descriptor>| channel.as_ref().map_or(1.0, |channel| self.0[&set][channel]);
        let has_scales = channels.iter().any(Option::is_some);
        let scales = if has_scales { channels.iter().map(scale).collect() } else { Vec::new() };
        Scaled { descriptor, scales }
    }
}
