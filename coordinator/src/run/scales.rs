//! What the distances of channels are divided by, as far as a run has found out.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use cluster::{Client, ClusterError, ClusterNews};
use descriptor::Descriptor;

use crate::run::scaled::Scaled;
use crate::run::splits::SplitBlobs;

/// Scales by channel, each as the descriptor of this channel alone.
#[derive(Clone, Debug, Default)]
pub struct Scales(BTreeMap<Descriptor, f64>);

impl Scales {
    /// Has the scales of these descriptors' channels computed that are not known yet.
    pub async fn complete(
        &mut self,
        descriptors: &[&Descriptor],
        splits: &SplitBlobs<'_>,
        client: &mut Client,
        watch: impl FnMut(&ClusterNews),
    ) -> Result<(), ClusterError> {
        let channels = descriptors.iter().flat_map(|descriptor| descriptor.scaled_channels()).flatten();
        let missing: BTreeSet<Descriptor> =
            channels.filter(|channel| !self.0.contains_key(channel)).collect();
        if missing.is_empty() {
            return Ok(());
        }
        // Long ones first: a long one that is begun last leaves all other workers waiting for it.
        let mut missing: Vec<Descriptor> = missing.into_iter().collect();
        missing.sort_by_key(|channel| Reverse(channel.cost(1, 0)));
        let asked = missing.iter().map(|channel| splits.scale(channel)).collect();
        let found = client.scales(asked, watch).await?;
        self.0.extend(missing.into_iter().zip(found.into_iter().map(|finished| finished.result)));
        Ok(())
    }

    /// A descriptor with its scales, which [`Scales::complete`] has found.
    ///
    /// # Panics
    /// If it has not: a programming error.
    pub fn of<'a>(&self, descriptor: &'a Descriptor) -> Scaled<'a> {
        let channels = descriptor.scaled_channels();
        let scale = |channel: &Option<Descriptor>| channel.as_ref().map_or(1.0, |channel| self.0[channel]);
        let has_scales = channels.iter().any(Option::is_some);
        let scales = if has_scales { channels.iter().map(scale).collect() } else { Vec::new() };
        Scaled { descriptor, scales }
    }
}
