//! Several runs at once: one cluster, one journal, a client and a run folder for each of them.

mod record;
mod summary;
mod verdict;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Instant, SystemTime};

use cache::Store;
use futures_util::future::try_join_all;
use results::RunFolder;

use crate::console::say;
use crate::dataset::{Dataset, Wanted};
use crate::experiment::{Member, Overrides, Plan, Sweep};
use crate::result_cache::{SearchCounts, Wrong};
use crate::run::directory::{chosen, claim, refuse_another};
use crate::run::progress::Progress;
use crate::run::recorded_session::{RecordedSession, Setup};
use crate::run::summary::Summary;
use crate::run::tally::Tally;
use crate::run::{
    Matching, RunDriver, RunError, RunOptions, check_fitness, compare_with_data, finished, open_data,
    refuse_other_data, remove_journal, rows,
};
use crate::session::listen;
use crate::storage;
pub use record::{SWEEP_FILE, recorded_sweep};
pub use summary::SweepSummary;
pub use verdict::{Seed, variant, verdicts};

/// The folder of a sweep: `out`, or one that the same sweep finds again; `fresh`: one that is not there.
pub fn folder(sweep: &Sweep, out: Option<PathBuf>, fresh: bool) -> PathBuf {
    chosen(sweep.base().results_dir(), &sweep.folder_name(), out, fresh)
}

/// The folders of the runs in a folder: of a sweep, those of its members with their names; else the folder itself.
pub fn run_folders(folder: &Path) -> Result<Vec<(String, PathBuf)>, RunError> {
    let Some(record) = recorded_sweep(folder)? else { return Ok(vec![(String::new(), folder.to_owned())]) };
    let Plan::Sweep(sweep) = Plan::from_record(&record, folder, Overrides::default())? else {
        return Err(RunError::NothingToResume { folder: folder.to_owned() });
    };
    let members = sweep.members().into_iter();
    Ok(members.map(|Member { name, .. }| (name.clone(), folder.join(name))).collect())
}

/// Runs all members of a sweep to their stop reasons; those that are finished are only shown again.
pub async fn sweep(sweep: &Sweep, options: &RunOptions) -> Result<SweepSummary, RunError> {
    let (now, started_at, base) = (Instant::now(), SystemTime::now(), sweep.base());
    let store = storage::open(&options.storage);
    let out = folder(sweep, options.out.clone(), options.fresh);
    let members = sweep.members();
    refuse_another(&out, &sweep.search_toml())?;
    if let Some(summaries) = already_finished(&out, sweep, &members, &store)? {
        return Ok(SweepSummary { summaries, out });
    }
    let generations = members.iter().map(|member| member.experiment.stop().generations);
    let mut progress = Progress::new(generations.fold(0, u32::saturating_add));
    let listener = listen(base, &options.port, progress.console()).await?;
    let dataset = open_data(base, Wanted::All, Some(&store), |line| progress.say(line))?;
    let mut notes = BTreeSet::new();
    for member in &members {
        notes.extend(check_fitness(&member.experiment, &dataset)?);
    }
    notes.iter().for_each(|note| progress.say(note));
    let run_folders: Vec<PathBuf> = members.iter().map(|member| out.join(&member.name)).collect();
    for (folder, member) in run_folders.iter().zip(&members) {
        refuse_another(folder, &member.experiment.search_toml())?;
    }
    make_folder(&out, sweep)?;
    let setup = Setup {
        texts: (sweep.search_toml(), sweep.record_toml()),
        experiment: base,
        with_sequences: members.iter().any(|member| member.experiment.fitness().needs_sequences()),
        dataset: &dataset,
        out: &out,
        runs: &run_folders,
    };
    let mut recorded = RecordedSession::open(setup, &store, options, (now, started_at), &progress)?;
    recorded.session.cluster.set_shared();
    let (mut summaries, folders) = open_folders(&out, &members, &dataset, recorded.is_trusted)?;
    let clients: Vec<_> = folders.iter().map(|_| recorded.session.cluster.client()).collect();
    let named = |((place, _), client): (&(usize, RunFolder), &cluster::Client)| {
        (Some(members[*place].name.clone()), client.id())
    };
    let named_clients = folders.iter().zip(&clients).map(named).collect();
    let mut attached = recorded.start(listener, &mut progress).await?;
    let RecordedSession { session, start, .. } = &recorded;
    let cache = |matching| session.splits.count_cache(&store, base.preprocess(), matching);
    let [train_cache, validation_cache] = [Matching::Train, Matching::Validation].map(cache);
    let (known, none) = (SearchCounts::read(&train_cache, &validation_cache), SearchCounts::default());
    let tally = Arc::new(Tally::new(members.len(), summaries.len()));
    let (dataset, start) = (&dataset, *start);
    let driver = |((place, folder), client): ((usize, RunFolder), _)| {
        let Member { name, experiment } = &members[place];
        let remembered = if experiment.remembers_counts(dataset) { &known } else { &none };
        let stop = experiment.stop();
        let progress = progress.of_member(name, stop.generations, &tally).with_budget(stop.evaluations);
        (place, RunDriver { experiment, dataset, session, remembered, client, folder, progress, start })
    };
    let mut runs: Vec<(usize, RunDriver<'_>)> = folders.into_iter().zip(clients).map(driver).collect();
    let shown = (progress.console(), progress.teller());
    let searched = recorded.perform(&mut attached, named_clients, shown, run_all(&mut runs, &tally)).await;
    if searched.is_err() {
        for (_, run) in &runs {
            run.tell_what_happened().await;
        }
    }
    let done = searched?;
    progress.finish();

    // Once, and not for each member.
    let remembers = |member: &Member| member.experiment.remembers_counts(dataset);
    let provenance = recorded.provenance(members.iter().any(remembers)).await?;
    remove_journal(&out);
    for (place, summary, found) in done {
        provenance.note(session, &summary.out, &found);
        summaries.push((place, summary));
        if remembers(&members[place]) {
            provenance.keep(session, &found, [&train_cache, &validation_cache]);
        }
    }
    recorded.end(attached, dataset).await;
    summaries.sort_by_key(|(place, _)| *place);
    let named = |(place, summary): (usize, Summary)| (members[place].name.clone(), summary);
    Ok(SweepSummary { summaries: summaries.into_iter().map(named).collect(), out })
}

/// Something of each member, by its place among them.
type ByPlace<T> = Vec<(usize, T)>;

/// Opens the run folders of all members; gives the summaries of those that are finished. `trusted`: no worker was found
/// to be wrong.
fn open_folders(
    out: &Path,
    members: &[Member],
    dataset: &Dataset,
    trusted: bool,
) -> Result<(ByPlace<Summary>, ByPlace<RunFolder>), RunError> {
    let (mut summaries, mut folders) = (Vec::new(), Vec::new());
    for (place, Member { name, experiment }) in members.iter().enumerate() {
        let mut folder = RunFolder::create(out.join(name), &rows::gene_columns(experiment.space()))?;
        claim(folder.path(), &experiment.search_toml())?;
        // One that was finished before a worker was found to be wrong may rest on what that worker answered.
        if let Some(summary) = finished(folder.path(), experiment)?.filter(|_| trusted) {
            refuse_other_data(folder.path(), &summary.run.data_digest, dataset)?;
            summaries.push((place, summary));
            continue;
        }
        if folder.is_finished() {
            folder.discard()?;
        }
        folders.push((place, folder));
    }
    Ok((summaries, folders))
}

/// A run that is finished: its place among the members, and what its search has seen.
type Done = (usize, Summary, SearchCounts);

/// Runs all of them side by side, and those again that were told answers that turned out to be wrong after they had
/// finished.
async fn run_all(runs: &mut [(usize, RunDriver<'_>)], tally: &Tally) -> Result<Vec<Done>, RunError> {
    let mut done = try_join_all(runs.iter_mut().map(|(place, run)| run_one(*place, run, tally))).await?;
    loop {
        let mut again = Vec::new();
        for (place, run) in &mut *runs {
            let wrong = Wrong::principals(run.session.cluster.quarantined());
            let rests_on = |(finished, _, known): &Done| finished == place && known.rests_on(&wrong);
            if run.client.begins_again()? || done.iter().any(rests_on) {
                run.progress.say("is searched again: answers that it was given were wrong");
                run.folder.discard()?;
                done.retain(|(finished, ..)| finished != place);
                again.push(run_one(*place, run, tally));
            }
        }
        if again.is_empty() {
            return Ok(done);
        }
        done.extend(try_join_all(again).await?);
    }
}

async fn run_one(place: usize, run: &mut RunDriver<'_>, tally: &Tally) -> Result<Done, RunError> {
    let finished = async {
        let outcome = run.search().await?;
        run.client.rest();
        Ok((run.finish(&outcome).await?, outcome.found.counts))
    };
    match finished.await {
        Ok((summary, known)) => {
            tally.run_done();
            run.progress.say(&format!("finished after generation {}", summary.run.generations));
            Ok((place, summary, known))
        }
        Err(error) => {
            run.progress.say("ended with an error"); // which of them, the error itself does not know
            Err(error)
        }
    }
}

/// The summaries of all members, if all are finished.
fn already_finished(
    out: &Path,
    sweep: &Sweep,
    members: &[Member],
    store: &Store,
) -> Result<Option<Vec<(String, Summary)>>, RunError> {
    // A journal is there until the last of them is sure.
    if recorded_sweep(out)?.is_none() || out.join(cluster::journal::JOURNAL_FILE).exists() {
        return Ok(None);
    }
    let mut summaries = Vec::new();
    for Member { name, experiment } in members {
        match finished(&out.join(name), experiment)? {
            Some(summary) => summaries.push(summary),
            None => return Ok(None),
        }
    }
    compare_with_data(&mut summaries, sweep.base(), store)?;
    say(format_args!("{}: this sweep is finished; --fresh starts another", out.display()));
    Ok(Some(members.iter().map(|member| member.name.clone()).zip(summaries).collect()))
}

/// Makes the folder and marks it as this sweep's, unless it is another's.
fn make_folder(out: &Path, sweep: &Sweep) -> Result<(), RunError> {
    fs::create_dir_all(out).map_err(|source| RunError::File { path: out.to_owned(), source })?;
    claim(out, &sweep.search_toml())?;
    let path = out.join(SWEEP_FILE);
    if path.exists() {
        return Ok(());
    }
    atomic::write(&path, sweep.record_toml().as_bytes()).map_err(|source| RunError::File { path, source })
}
