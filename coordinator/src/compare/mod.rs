//! Several descriptors on the test clouds of a finished run: the paper's table 1 and figure 3, and how sure one can be.

mod candidate;
mod curve;
mod described;
mod differences;
mod recognition;
mod summary;
mod timing;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use cache::Storage;
use cache::Store;
use descriptor::recognise::RecogniseError;
use descriptor::{Descriptor, Label, SetDistance, SignatureError};
use indicatif::{ProgressBar, ProgressDrawTarget};
use results::{ComparedRow, Counts, LookRow, RunFolder, wilson};

use crate::evaluate::EvaluateError;
use crate::experiment::Overrides;
use crate::reopen::{ReopenError, Reopened, reopen};
use crate::run::progress::Progress;
use crate::run::{Matching, RunError, refuse_other_data, rows};
use crate::session::{Session, listen};
pub use candidate::{Candidate, EVOLVED, Named, candidates};
use cluster::{Client, ClusterNews};
use described::Shards;
use differences::{Level, Outcomes, error_interval, pairs};
use proto::task::{Description, Match};
use recognition::{MAX_PAIRS, Recognition};
pub use summary::Comparison;
use timing::{Timed, time};
use transport::Protection;

/// What is compared, and how.
#[derive(Clone, Debug)]
pub struct Options {
    /// Descriptors; `None`: all that the clouds allow.
    pub descriptors: Option<Vec<Named>>,
    /// Set distances, each descriptor under each.
    pub distances: Vec<SetDistance>,
    /// Radius of the descriptors without genes, micrometres.
    pub radius_um: u32,
    /// Whether times are measured, which takes as long as one thread needs for all of them.
    pub times: bool,
    /// Why the test clouds are looked at.
    pub reason: String,
    /// Where the clouds are now, if they have moved.
    pub data: Option<PathBuf>,
    /// Port and workers, instead of the experiment's.
    pub overrides: Overrides,
    /// How connections from other machines are protected.
    pub protection: Protection,
    /// Where prepared clouds are kept, and memory for the workers of this process.
    pub storage: Storage,
}

/// Why there is no comparison.
#[derive(Debug, thiserror::Error)]
pub enum CompareError {
    /// The run.
    #[error(transparent)]
    Reopen(#[from] ReopenError),
    /// Workers, port, files.
    #[error(transparent)]
    Run(Box<RunError>),
    /// Nothing to compare on.
    #[error("{0}: has no test clouds to compare descriptors on\nlist some in [dataset] and run it again")]
    NoTest(PathBuf),
    /// The winner is not of this program's genes.
    #[error(
        "{0}: best genes: must lie on the genes' grids\nlook whether the run is sound: coordinator verify"
    )]
    Genes(PathBuf),
    /// A descriptor that these clouds do not allow.
    #[error("--descriptor {name}: needs colours, got clouds without\nleave it out")]
    NeedsColour {
        /// Its name.
        name: &'static str,
    },
    /// A worker's answer is no description.
    #[error(transparent)]
    Description(#[from] SignatureError),
    /// Nothing in the database.
    #[error("{label}: {source}")]
    Recognise {
        /// Of the descriptor.
        label: String,
        /// Why.
        source: RecogniseError,
    },
    /// Nothing could be counted.
    #[error("{label}: describes none of the test clouds\nleave it out, or choose a larger --radius-cm")]
    NothingDescribed {
        /// Of the descriptor.
        label: String,
    },
    /// Measuring times.
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    /// Two computations of the same differ.
    #[error(
        "{label}: {what} must be what it was, {then}, got {now}\nlook whether the run is sound: coordinator verify"
    )]
    Contradiction {
        /// Of the descriptor.
        label: String,
        /// What was computed twice.
        what: &'static str,
        /// The first time.
        then: String,
        /// The second.
        now: String,
    },
}

impl From<RunError> for CompareError {
    fn from(error: RunError) -> Self {
        Self::Run(Box::new(error))
    }
}

impl From<results::Error> for CompareError {
    fn from(error: results::Error) -> Self {
        RunError::from(error).into()
    }
}

/// Compares descriptors on the test clouds of a finished run, and writes the tables into its folder.
pub async fn compare(folder: &Path, options: &Options) -> Result<Comparison, CompareError> {
    let mut progress = Progress::quiet();
    let store =
        Arc::new(Store::open(&options.storage, &transport::host_name(), descriptor::EVALUATION_VERSION));
    let Reopened { finished: run, experiment, dataset } =
        &reopen(folder, options.data.as_deref(), options.overrides, &store)?;
    refuse_other_data(folder, &run.row.data_digest, dataset)?;
    if Matching::Test.query_clouds(dataset).is_empty() {
        return Err(CompareError::NoTest(folder.to_owned()));
    }
    let space = experiment.space();
    let evolved = Descriptor::from_values(space.family(), &run.row.best_genes)
        .ok_or_else(|| CompareError::Genes(folder.to_owned()))?;
    let named = choose(options, experiment.preprocess().colour, |line| progress.say(line))?;
    let candidates = candidates(&named, &options.distances, &evolved, options.radius_um);
    let out = RunFolder::create(folder, &rows::gene_columns(space.family()))?;

    let listener = listen(experiment, &options.protection, progress.console()).await?;
    let memory = options.storage.memory;
    let mut session =
        Session::new(experiment, dataset, Arc::clone(&store), memory).map_err(RunError::from)?;
    let mut client = session.cluster.client();
    let settings = experiment.coordinator();
    progress.follow(&session.cluster);
    session.start(listener, settings.local_workers).await;
    let descriptors = distinct(&candidates);
    out.record_look(&LookRow {
        at: SystemTime::now(),
        command: "compare".to_owned(),
        reason: options.reason.clone(),
        descriptors: candidates
            .iter()
            .map(|candidate| candidate.label.as_str())
            .collect::<Vec<_>>()
            .join(" "),
    })?;
    let looks = results::read_table(folder, results::TableName::Looks)?.shape().0;
    session.splits.publish_test(&session.cluster.blobs);
    let question = session.splits.evaluation(&evolved, Matching::Test, false);
    let (preprocess, blobs) = (experiment.preprocess(), &session.cluster.blobs);
    let Some(shards) = Shards::publish(&question, space, &descriptors, preprocess, blobs) else {
        return Err(CompareError::NoTest(folder.to_owned()));
    };
    let clouds = question.queries + question.database_clouds;
    progress.say(&format!("describing {clouds} clouds under {} descriptors", descriptors.len()));
    let tasks = shards.tasks(&descriptors);
    let console = progress.console().clone();
    let described = describe(&mut client, &tasks, &mut progress);
    let answers = session.perform(&console, settings.deadline, described).await?;
    let gathered = shards.gather(&descriptors, &answers)?;
    drop(answers);

    out.begin_comparison()?;
    let (mut compared, mut outcomes) = (Vec::new(), Vec::new());
    for candidate in &candidates {
        let labels = shards.labels();
        let described = descriptors.iter().zip(&gathered).find(|(one, _)| **one == candidate.descriptor);
        let Some((_, described)) = described else { continue }; // `distinct` has them all
        let recognition = Recognition::new(candidate, described, labels)
            .map_err(|source| CompareError::Recognise { label: candidate.label.clone(), source })?;
        if recognition.distances.is_empty() {
            progress.say(&format!(
                "{}: more than {MAX_PAIRS} pairs of clouds: no distances and no curve over all pairs are kept",
                candidate.label
            ));
        }
        let timed = if options.times {
            progress.say(&format!("measuring {}: {clouds} clouds on one thread", candidate.label));
            Some(time(dataset, experiment.preprocess(), candidate)?)
        } else {
            None
        };
        let matches = recognition.matches.iter().map(|&(query, found)| (query, numbered(found)));
        let answers = rows::answers(dataset, Matching::Test, matches);
        if let Some(timed) = &timed {
            agree(candidate, &answers, timed)?;
        }
        let judged = judge(candidate, &recognition, labels);
        let counts = counts(candidate, &judged)?;
        if let (EVOLVED, Some(then)) = (candidate.label.as_str(), run.row.test)
            && then != counts
        {
            let [then, now] =
                [then, counts].map(|counts| format!("{} of {}", counts.object_correct, counts.queries));
            return Err(CompareError::Contradiction {
                label: EVOLVED.to_owned(),
                what: "objects of the final test",
                then,
                now,
            });
        }
        out.write_compared(&candidate.label, &answers, &recognition.curves, &recognition.distances)?;
        compared.push(row(candidate, &recognition, timed, (counts, &judged), (labels[0], run.row.seed)));
        outcomes.push(judged);
    }
    let queries = shards.labels()[0];
    let pairs: Vec<_> =
        Level::ALL.into_iter().flat_map(|level| pairs(&outcomes, level, queries, run.row.seed)).collect();
    out.write_comparison(&compared, &pairs)?;
    Ok(Comparison { name: run.row.name.clone(), rows: compared, pairs, looks, folder: folder.to_owned() })
}

/// Has workers describe shards, and shows how far they are.
async fn describe(
    client: &mut Client,
    shards: &[Description],
    progress: &mut Progress,
) -> Result<Vec<Arc<[u8]>>, RunError> {
    let bar = ProgressBar::with_draw_target(Some(shards.len() as u64), ProgressDrawTarget::stderr());
    let watch = |news: &ClusterNews| {
        bar.suspend(|| progress.news(news));
        bar.inc(news.finished as u64);
    };
    let described = client.describe(shards, watch).await;
    bar.finish_and_clear();
    Ok(described?)
}

/// The descriptors that are to be compared: those that were asked for, or all that clouds with or without colour allow.
fn choose(options: &Options, colour: bool, say: impl Fn(&str)) -> Result<Vec<Named>, CompareError> {
    let mut named = options.descriptors.clone().unwrap_or_else(|| Named::ALL.to_vec());
    let refused = named.iter().find(|one| one.needs_colour() && !colour);
    if let (Some(one), true) = (refused, options.descriptors.is_some()) {
        return Err(CompareError::NeedsColour { name: one.name() });
    }
    if refused.is_some() {
        say("clouds without colours: the paper's descriptor, pfhrgb and shotcolor are left out");
        named.retain(|one| !one.needs_colour());
    }
    Ok(named)
}

/// Each descriptor once, whatever the distances.
fn distinct(candidates: &[Candidate]) -> Vec<Descriptor> {
    let mut descriptors = Vec::new();
    for candidate in candidates {
        if !descriptors.contains(&candidate.descriptor) {
            descriptors.push(candidate.descriptor.clone());
        }
    }
    descriptors
}

fn numbered(found: descriptor::Match) -> Match {
    Match {
        nearest: found.nearest.index,
        distance: found.nearest.distance,
        runner_up: found.runner_up.map(|hit| (hit.index, hit.distance)),
    }
}

/// Refuses answers of workers that this process does not find as well.
fn agree(
    candidate: &Candidate,
    answers: &[results::PredictionRow],
    timed: &Timed,
) -> Result<(), CompareError> {
    let told = answers.iter().map(|row| (&row.cloud, &row.nearest_cloud, row.distance.to_bits()));
    let found = timed.nearest.iter().map(|(query, nearest, distance)| (query, nearest, distance.to_bits()));
    let differs = told.clone().zip(found.clone()).find(|(told, found)| told != found);
    if differs.is_none() && told.len() == found.len() {
        return Ok(());
    }
    let said = |answer: (&String, &String, u64)| {
        format!("{} for {} at {}", answer.1, answer.0, f64::from_bits(answer.2))
    };
    let (then, now) = match differs {
        Some((told, found)) => (said(told), said(found)),
        None => (format!("{} answers", told.len()), format!("{} answers", found.len())),
    };
    let label = candidate.label.clone();
    Err(CompareError::Contradiction { label, what: "what this process finds", then, now })
}

fn judge(candidate: &Candidate, recognition: &Recognition, [queries, database]: [&[Label]; 2]) -> Outcomes {
    let mut right = vec![None; queries.len()];
    for (query, found) in &recognition.matches {
        let (asked, got) = (queries[*query as usize], database[found.nearest.index as usize]);
        right[*query as usize] = Some([asked.instance == got.instance, asked.category == got.category]);
    }
    Outcomes { label: candidate.label.clone(), right }
}

fn counts(candidate: &Candidate, judged: &Outcomes) -> Result<Counts, CompareError> {
    let described = || judged.right.iter().flatten();
    let counts = Counts {
        object_correct: described().filter(|right| right[0]).count() as u32,
        category_correct: described().filter(|right| right[1]).count() as u32,
        queries: described().count() as u32,
    };
    if counts.queries == 0 {
        return Err(CompareError::NothingDescribed { label: candidate.label.clone() });
    }
    Ok(counts)
}

fn row(
    candidate: &Candidate,
    recognition: &Recognition,
    timed: Option<Timed>,
    (counts, judged): (Counts, &Outcomes),
    (queries, seed): (&[Label], u64),
) -> ComparedRow {
    let intervals = |correct: u32, level| {
        let by_wilson = wilson(counts.queries - correct, counts.queries);
        [by_wilson, error_interval(judged, level, queries, seed).unwrap_or(by_wilson)]
    };
    let area =
        |name| recognition.curves.iter().find(|curve| curve.name == name).and_then(results::Curve::area);
    let [object_wilson, object_bootstrap] = intervals(counts.object_correct, Level::Object);
    let [category_wilson, category_bootstrap] = intervals(counts.category_correct, Level::Category);
    ComparedRow {
        descriptor: candidate.label.clone(),
        kind: candidate.descriptor.family().name().to_owned(),
        distance: candidate.distance.name().to_owned(),
        parameters: candidate.descriptor.parameters(),
        size: candidate.descriptor.size() as u32,
        note: candidate.note().map(str::to_owned),
        counts,
        object_wilson,
        category_wilson,
        object_bootstrap,
        category_bootstrap,
        skipped: queries.len() as u32 - counts.queries,
        database: recognition.database,
        keypoints_per_cloud: timed
            .as_ref()
            .map(|timed| timed.keypoints_per_cloud)
            .or(recognition.keypoints_per_cloud),
        times: timed.map(|timed| timed.times),
        area: area("all"),
        nearest_area: area("nearest"),
    }
}
