//! Descriptions of all shards: from the store where it has them, from workers otherwise.

use std::sync::Arc;
use std::time::Duration;

use cluster::{Client, DescriptionAnswer};
use proto::task::Description;

use super::kept::KeptDescriptions;
use super::progress::Display;
use crate::run::RunError;
use crate::session::Session;

/// What is to be described, and what is described already.
pub struct Describing<'a> {
    shards: &'a [Description],
    /// Of each shard its description, if it is there.
    found: Vec<Option<Arc<[u8]>>>,
    /// How many of the shards are one descriptor's; they lie together.
    of_descriptor: usize,
}

impl<'a> Describing<'a> {
    /// Looks up shards, as many for each of the descriptors with these names, in the store.
    pub fn new(
        shards: &'a [Description],
        kept: &KeptDescriptions<'_>,
        names: &[&str],
        display: &Display,
    ) -> Self {
        let of_descriptor = (shards.len() / names.len().max(1)).max(1);
        let found = kept.recall();
        let each: u32 = shards.iter().take(of_descriptor).map(|shard| shard.clouds).sum();
        let all = names.len() as u64 * u64::from(each);
        let there = shards.iter().zip(&found).filter(|(_, found)| found.is_some());
        let there: u64 = there.map(|(shard, _)| u64::from(shard.clouds)).sum();
        let descriptors = if names.len() == 1 { "descriptor" } else { "descriptors" };
        let begun = format!("describing {each} clouds under {} {descriptors}", names.len());
        display.say(&match there {
            0 => begun,
            _ => format!("{begun}: {there} of {all} descriptions are there already"),
        });
        display.begin("described", names.iter().map(|&name| name.to_owned()), each);
        for (place, (shard, _)) in
            shards.iter().zip(&found).enumerate().filter(|(_, (_, found))| found.is_some())
        {
            display.found(place / of_descriptor, shard.clouds);
        }
        Self { shards, found, of_descriptor }
    }

    /// Whether nobody needs to be asked.
    pub fn is_complete(&self) -> bool {
        self.found.iter().all(Option::is_some)
    }

    /// Has workers describe what is missing, and keeps it as it arrives.
    ///
    /// # Errors
    /// As [`Session::perform`] and [`Client::describe`]; what has arrived stays.
    pub async fn complete(
        &mut self,
        session: &Session<'_>,
        client: &mut Client,
        deadline: Option<Duration>,
        kept: &mut KeptDescriptions<'_>,
        display: &Display,
    ) -> Result<(), RunError> {
        let missing: Vec<usize> =
            (0..self.shards.len()).filter(|&place| self.found[place].is_none()).collect();
        let asked: Vec<Description> = missing.iter().map(|&place| self.shards[place].clone()).collect();
        let mut shown = vec![false; asked.len()];
        let watch = |mut answers: Vec<DescriptionAnswer>| {
            display.news();
            for answer in &mut answers {
                // One that was corrected comes again.
                let is_first = !std::mem::replace(&mut shown[answer.place], true);
                answer.place = missing[answer.place];
                if is_first {
                    display.add(answer.place / self.of_descriptor, self.shards[answer.place].clouds);
                }
            }
            kept.take(&answers, session.cluster.is_trusted());
        };
        let describe = async { Ok(client.describe(&asked, watch).await?) };
        let described = session.perform(display.console(), deadline, describe).await?;
        let answers = missing.iter().copied().zip(described.iter().map(|bytes| &**bytes));
        kept.complete(answers, session.cluster.is_trusted());
        for (&place, bytes) in missing.iter().zip(described) {
            self.found[place] = Some(bytes);
        }
        Ok(())
    }

    /// The descriptions in the order of the shards, once all are there.
    pub fn into_descriptions(self) -> Vec<Arc<[u8]>> {
        self.found.into_iter().flatten().collect()
    }
}
