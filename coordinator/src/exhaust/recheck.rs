//! Counts of a finished grid, a sample of them, against the evaluator that runs ask.

use proto::Message;
use std::collections::BTreeMap;
use std::fmt;

use descriptor::{Descriptor, random};
use rand::seq::index;
use results::GridFolder;

use super::grid_spec::GridSpec;
use crate::fitness::Fitness;
use crate::run::RunError;
use crate::session::Session;
use cluster::Client;

/// Problems that are shown.
const SHOWN: usize = 10;
/// Most counts that can be asked for.
pub const MOST: u32 = 1_000_000;
/// Evaluations that are asked for together: few enough for one connection.
const BATCH: usize = 500;

/// What a look at some counts of a grid has found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Recheck {
    /// Counts that were computed again.
    pub recomputed: usize,
    /// Counts that differ, and cells that cannot be read.
    pub problems: Vec<String>,
}

impl fmt::Display for Recheck {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { recomputed, problems } = self;
        if problems.is_empty() {
            return write!(f, "{recomputed} counts, all as the evaluator finds them");
        }
        write!(f, "{recomputed} counts, NOT sound: {} problems", problems.len())?;
        problems.iter().take(SHOWN).try_for_each(|problem| write!(f, "\n{:14}{problem}", ""))
    }
}

/// Has `sample` descriptors of the grid, drawn from all of it without repetition, evaluated one by one, and compares
/// with the cells on the disk. Which ones depends on the spec alone, so that two people see the same.
pub async fn recheck(
    spec: &GridSpec,
    folder: &GridFolder,
    (session, client): (&Session<'_>, &mut Client),
    sample: u32,
    mut say: impl FnMut(&str),
) -> Result<Recheck, RunError> {
    let grid = &spec.grid;
    let descriptors = grid.descriptors() as usize; // at most 2^31
    let mut rng = random::stream(0, &format!("recheck {}", spec.key), &[]);
    let drawn = index::sample(&mut rng, descriptors, descriptors.min(sample as usize));
    let drawn_in_all = drawn.len();
    say(&format!("computing {drawn_in_all} counts again"));
    let mut by_cell: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for place in drawn {
        by_cell.entry(place / grid.cell_len()).or_default().push(place % grid.cell_len());
    }

    let mut recheck = Recheck::default();
    let mut batch = Batch::default();
    let mut told = 0;
    for (cell, places) in by_cell {
        let name = spec.cell_name(cell);
        let read = folder.read_cell(&name).map(|points| points.and_then(|p| spec.counts(cell, p)));
        let counts = match read {
            Ok(Some(counts)) => counts,
            Ok(None) => {
                recheck.problems.push(format!(
                    "cell {name}: must hold the descriptors of this grid; without this file it is computed again"
                ));
                continue;
            }
            Err(error) => {
                recheck.problems.push(Message::of(&error).what);
                continue;
            }
        };
        let descriptors: Vec<_> = grid.places(cell).map(|place| grid.descriptor(place)).collect();
        for place in places {
            batch.descriptors.push(Descriptor::DiskRing(descriptors[place]));
            batch.expected.push(counts[place]);
            if batch.descriptors.len() == BATCH {
                batch.evaluate(session, client, &mut recheck).await?;
            }
        }
        if recheck.recomputed >= told + 10 * BATCH {
            told = recheck.recomputed;
            say(&format!("{told} of {drawn_in_all} counts computed again"));
        }
    }
    batch.evaluate(session, client, &mut recheck).await?;
    Ok(recheck)
}

/// Descriptors that are evaluated together, and what the grid says of them.
#[derive(Default)]
struct Batch {
    descriptors: Vec<Descriptor>,
    expected: Vec<u32>,
}

impl Batch {
    /// Evaluates, compares and empties it.
    async fn evaluate(
        &mut self,
        session: &Session<'_>,
        client: &mut Client,
        recheck: &mut Recheck,
    ) -> Result<(), RunError> {
        let descriptors: Vec<&Descriptor> = self.descriptors.iter().collect();
        let found = session.measure(client, &session.splits, (&Fitness::PAPER, &[1]), &descriptors).await?;
        recheck.recomputed += found.len();
        for ((descriptor, expected), found) in
            self.descriptors.drain(..).zip(self.expected.drain(..)).zip(found)
        {
            let got = found.measured.counts.object_correct;
            if got != expected {
                recheck.problems.push(format!("{descriptor}: the grid has {expected}, got {got}"));
            }
        }
        Ok(())
    }
}
