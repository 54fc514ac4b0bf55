//! Descriptions of all shards: from the store where it has them, from workers otherwise.

use std::sync::Arc;
use std::time::Duration;

use cluster::scheduler::Basis;
use cluster::{Client, Cluster, ClusterError, DescriptionAnswer};
use proto::task::{Description, Task};

use super::kept::{KeptDescriptions, Recalled};
use super::progress::Display;
use crate::result_cache::{Source, Wrong};
use crate::run::RunError;
use crate::session::Session;

/// What is to be described, and what is described already.
pub struct Describing<'a> {
    shards: &'a [Description],
    /// Of each shard its description, if the store has it, and where it comes from.
    found: Vec<Option<Recalled>>,
    /// Of each shard its description, if workers have made it.
    described: Vec<Option<Arc<[u8]>>>,
    /// The shards that are there and described again, to compare.
    checked: Vec<usize>,
    /// How many of the shards are one descriptor's; they lie together.
    of_descriptor: usize,
}

impl<'a> Describing<'a> {
    /// Looks up shards, as many for each of the descriptors with these names, in the store.
    pub fn new(
        shards: &'a [Description],
        kept: &KeptDescriptions<'_>,
        names: &[&str],
        cluster: &Cluster,
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
        let is_checked = |place: &usize| {
            found[*place].is_some() && cluster.spot_checks(&Task::Description(shards[*place].clone()))
        };
        let checked = (0..shards.len()).filter(is_checked).collect();
        Self { shards, found, described: vec![None; shards.len()], checked, of_descriptor }
    }

    /// Whether nobody needs to be asked.
    pub fn is_complete(&self) -> bool {
        self.checked.is_empty() && self.found.iter().all(Option::is_some)
    }

    /// Has workers describe what is missing and what is to be checked, and keeps it as it arrives.
    ///
    /// # Errors
    /// As [`Session::perform`] and [`Client::describe`]; what has arrived stays. [`RunError::WrongDescription`].
    pub async fn complete(
        &mut self,
        session: &Session<'_>,
        client: &mut Client,
        deadline: Option<Duration>,
        kept: &KeptDescriptions<'_>,
        display: &Display,
    ) -> Result<(), RunError> {
        let mut shown = vec![false; self.shards.len()];
        let completed = async {
            loop {
                self.describe(session, client, kept, &mut shown, display).await?;
                let wrong = match self.wrong(session, client).await {
                    // What was described now was wrong: it is described again.
                    Err(RunError::Cluster(ClusterError::Corrected(_))) => continue,
                    wrong => wrong?,
                };
                if wrong.is_empty() {
                    return Ok(());
                }
                session.forget(&wrong, display.console());
                let is_wrong = |found: &mut Recalled| wrong.concerns(&found.0);
                self.found.iter_mut().for_each(|found| drop(found.take_if(is_wrong)));
            }
        };
        session.perform(display.console(), deadline, completed).await
    }

    /// Asks for what is missing and what is to be checked; what was described before comes at once.
    async fn describe(
        &mut self,
        session: &Session<'_>,
        client: &mut Client,
        kept: &KeptDescriptions<'_>,
        shown: &mut [bool],
        display: &Display,
    ) -> Result<(), RunError> {
        let is_asked = |place: &usize| self.found[*place].is_none() || self.checked.contains(place);
        let asked: Vec<usize> = (0..self.shards.len()).filter(is_asked).collect();
        let shards: Vec<Description> = asked.iter().map(|&place| self.shards[place].clone()).collect();
        let mut is_kept = vec![false; asked.len()];
        let watch = |answers: Vec<DescriptionAnswer>| {
            display.news();
            for DescriptionAnswer { place, bytes, provenance } in answers {
                is_kept[place] = bytes.is_some() && provenance.is_some();
                let place = asked[place];
                // One that was corrected comes again.
                if !std::mem::replace(&mut shown[place], true) && self.found[place].is_none() {
                    display.add(place / self.of_descriptor, self.shards[place].clouds);
                }
                bytes.iter().for_each(|bytes| kept.keep(place, bytes, provenance.clone()));
            }
        };
        let described = client.describe(&shards, watch).await?;
        for ((place, bytes), is_kept) in asked.into_iter().zip(described).zip(is_kept) {
            // Of the others one or the other was audited after it had come.
            if !is_kept {
                let task = Task::Description(self.shards[place].clone());
                kept.keep(place, &bytes, session.cluster.provenance(&task));
            }
            self.described[place] = Some(bytes);
        }
        Ok(())
    }

    /// Who is to blame for descriptions that the store had and that are not what was described now.
    async fn wrong(&self, session: &Session<'_>, client: &mut Client) -> Result<Wrong, RunError> {
        let differs = |&&place: &&usize| {
            let both = self.found[place].as_ref().zip(self.described[place].as_ref());
            both.is_some_and(|((_, before), now)| before != now)
        };
        let differing: Vec<usize> = self.checked.iter().filter(differs).copied().collect();
        for &place in &differing {
            client.confirm(&self.shards[place].subject.descriptor);
        }
        client.confirmed(|_| {}).await?;
        let mut wrong = Wrong::default();
        for place in differing {
            let shard = &self.shards[place];
            let provenance = session.cluster.provenance(&Task::Description(shard.clone()));
            if provenance.is_none_or(|provenance| provenance.basis < Basis::Audited) {
                return Err(RunError::WrongDescription { manifest: shard.manifest });
            }
            wrong.principals.extend(self.found[place].iter().flat_map(|(source, _)| source.suspects()));
        }
        Ok(wrong)
    }

    /// Where those come from that the store had.
    pub fn sources(&self) -> impl Iterator<Item = Source> {
        self.found.iter().flatten().map(|(source, _)| source.clone())
    }

    /// The descriptions in the order of the shards, once all are there.
    pub fn into_descriptions(self) -> Vec<Arc<[u8]>> {
        let found = self.found.into_iter().map(|found| found.map(|(_, bytes)| bytes));
        self.described.into_iter().zip(found).filter_map(|(described, found)| described.or(found)).collect()
    }
}
