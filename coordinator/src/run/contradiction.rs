//! Two counts of one descriptor that differ: which of them is wrong, and what follows.

use cluster::Cluster;
use cluster::scheduler::Basis;
use descriptor::Descriptor;
use results::Counts;

use crate::result_cache::{SearchCounts, Source, Wrong};
use crate::run::RunError;
use crate::run::matching::Matching;
use crate::tasks;

/// Counts that an earlier run has left and that differ from those that were computed now, after all that can be confirmed
/// of these was. Where the own process or two principals stand for them, the others are wrong.
pub fn remembered_wrongly(
    cluster: &Cluster,
    descriptor: &Descriptor,
    matching: Matching,
    (held, source): (&Counts, &Source),
    computed: &Counts,
) -> RunError {
    let [remembered, computed] = [held, computed].map(counts_text);
    let provenance = match cluster.provenance_about(&tasks::descriptor_bytes(descriptor)) {
        Ok(provenance) => provenance,
        Err(error) => return error.into(),
    };
    let matching = name(matching);
    if provenance.is_some_and(|provenance| provenance.basis >= Basis::Audited) {
        let what = format!("{descriptor}: {matching}: must be {computed}, got {remembered}");
        return RunError::WronglyRemembered { wrong: Wrong::principals(source.suspects()), what };
    }
    RunError::Contradiction { descriptor: descriptor.clone(), matching, computed, remembered }
}

/// Refuses counts of earlier runs that this one has used and that rest on a principal found to be wrong since.
///
/// # Errors
/// [`RunError::WronglyRemembered`].
pub fn check_used(cluster: &Cluster, known: &SearchCounts) -> Result<(), RunError> {
    let wrong = Wrong::principals(cluster.quarantined());
    if !known.rests_on(&wrong) {
        return Ok(());
    }
    let what = "were used, and a worker whose principal has left them was wrong".to_owned();
    Err(RunError::WronglyRemembered { wrong, what })
}

/// Two answers to this run that differ.
pub fn contradicted(
    descriptor: &Descriptor,
    matching: Matching,
    held: &Counts,
    computed: &Counts,
) -> RunError {
    let [held, computed] = [held, computed].map(counts_text);
    RunError::Disagreement { descriptor: descriptor.clone(), matching: name(matching), computed, held }
}

fn name(matching: Matching) -> &'static str {
    match matching {
        Matching::Train => "training",
        Matching::Validation => "validation",
        Matching::Test => "test",
    }
}

/// Counts in words, for messages.
pub fn counts_text(counts: &Counts) -> String {
    let Counts { object_correct, category_correct, queries } = counts;
    format!("{object_correct} objects and {category_correct} categories of {queries}")
}
