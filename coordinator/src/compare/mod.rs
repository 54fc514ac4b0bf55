//! Several descriptors on the test clouds of a finished run: the paper's table 1 and figure 3, and how sure one can be.

pub mod baselines;
mod candidate;
mod curve;
mod described;
mod describing;
mod difference;
mod earlier;
mod error;
mod foreign;
mod given;
mod global;
mod kept;
mod pairs;
mod perturbed;
mod progress;
mod recognition;
mod summary;
mod tables;
mod timing;
mod verdict;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use cache::Storage;
use descriptor::recogniser::Method;
use descriptor::{Descriptor, Family, Perturbation, Preprocess, SetDistance, VectorMetric};
use results::{ComparedRow, LookRow, PairRow, PerturbedRow, RunFolder, TableName};

use crate::experiment::Overrides;
use crate::reopen::{Reopened, reopen, winner_of};
use crate::result_cache::finished_runs;
use crate::run::scaled::Scaled;
use crate::run::splits::ONLY_SET;
use crate::run::{Matching, RunError, choose_set, rows, sets};
use crate::session::{Session, listen, scale};
use crate::slurm::SlurmWorkers;
use crate::storage;
pub use candidate::{Candidate, Choice, EVOLVED, Named, PAPER, label};
use described::{Described, Shards};
use describing::Describing;
pub use difference::{Difference, differences};
use earlier::{Earlier, Measured};
pub use error::CompareError;
pub use foreign::ForeignSource;
use foreign::{ForeignCandidate, ForeignDescriptor, ForeignEntry};
use given::Own;
pub use given::{Source, Sources};
use kept::KeptDescriptions;
pub use pairs::Level;
use perturbed::{PerturbedClouds, PerturbedDescriptor, Subject};
use progress::Display;
use recognition::MAX_PAIRS;
pub use summary::Comparison;
pub use tables::descriptor_of;
use tables::{Compared, Tables};
#[cfg(test)]
pub use timing::listing as test_listing;
use timing::time;
use transport::Port;
pub use verdict::{verdict, verdict_of_run};

/// What is compared, and how.
#[derive(Clone, Debug)]
pub struct Options {
    /// Descriptors that every comparison knows; `None`: all of these that the clouds allow.
    pub descriptors: Option<Vec<Named>>,
    /// What is compared beside them.
    pub given: Sources,
    /// Files of what other programs computed of the clouds.
    pub foreign: Vec<ForeignSource>,
    /// How vectors of these are compared.
    pub foreign_metric: VectorMetric,
    /// Set distances, each descriptor under each.
    pub distances: Vec<SetDistance>,
    /// Recognisers, each descriptor under each set distance by each.
    pub recognisers: Vec<Method>,
    /// Radius of the descriptors without genes, micrometres; `None`: that of the comparison in the run folder, or else
    /// the default.
    pub radius_um: Option<u32>,
    /// Begin anew instead of adding to the comparison in the run folder.
    pub replace: bool,
    /// Whether times are measured that the comparison in the run folder does not have, which takes as long as one thread
    /// needs for all of them.
    pub times: bool,
    /// Kinds of perturbations that errors are measured under which the comparison in the run folder does not have.
    pub perturbations: Vec<Perturbation>,
    /// The set whose clouds are compared; needed where there are several.
    pub set: Option<String>,
    /// Why the test clouds are looked at.
    pub reason: String,
    /// Where the clouds are now, if they have moved.
    pub data: Option<PathBuf>,
    /// Port and workers, instead of the experiment's.
    pub overrides: Overrides,
    /// How workers of other machines reach the command.
    pub port: Port,
    /// Workers that Slurm is asked for, if any.
    pub slurm: Option<SlurmWorkers>,
    /// Where descriptions and prepared clouds are kept, and memory for the workers of this process.
    pub storage: Storage,
    /// Whether another comparison of the same command follows: workers stay for it.
    pub another_follows: bool,
}

/// A descriptor, whatever the set distance, and its name.
struct NamedDescriptor {
    name: String,
    descriptor: Descriptor,
}

/// Compares descriptors on the test clouds of a finished run, with those that were compared before, and writes the tables
/// into its folder.
pub async fn compare(folder: &Path, options: &Options) -> Result<Comparison, CompareError> {
    let store = storage::open(&options.storage);
    let reopened = reopen(folder, options.data.as_deref(), options.overrides, &store)?;
    reopened.refuse_other_data(folder)?;
    let Reopened { finished: mut run, experiment, dataset } = reopened;
    let mut display = Display::new();
    let (experiment, dataset) = (&experiment, &choose_set("compare", options.set.as_deref(), dataset)?);
    let place = match &options.set {
        None => folder.to_owned(),
        Some(set) => {
            run.row.test = sets::counts(&results::read_sets(folder)?, EVOLVED, set);
            folder.join(TableName::Sets.as_str()).join(set)
        }
    };
    if Matching::Test.query_clouds(dataset).is_empty() {
        return Err(CompareError::NoTest(folder.to_owned()));
    }
    let (space, preprocess) = (experiment.space(), experiment.preprocess());
    let evolved = winner_of(space, &run.row)
        .map_err(|source| CompareError::Winner { run: folder.to_owned(), source })?;
    let own = Own { folder, space, data_digest: &run.row.data_digest, preprocess };
    let given = options.given.read(&own)?.into_iter().map(Named::Given).collect();
    if options.perturbations.contains(&Perturbation::Light) && !preprocess.colour {
        return Err(CompareError::NeedsColour { name: "--perturb light".to_owned() });
    }
    let asked = choose(options, given, preprocess.colour, |line| display.say(line))?;
    let columns = rows::gene_columns(space);
    let in_run = RunFolder::create(folder, &columns)?;
    let of_set = options.set.as_ref().map(|_| RunFolder::create(&place, &columns)).transpose()?;
    let out = of_set.as_ref().unwrap_or(&in_run);
    let front = results::read_front(folder)?;
    let earlier = if options.replace { Earlier::default() } else { Earlier::read(&place)? };
    let candidates = earlier.candidates(&place, &asked, &evolved, options.radius_um)?;
    let read = |source| ForeignDescriptor::read(source, options.foreign_metric, dataset);
    let foreign: Vec<ForeignDescriptor> = options.foreign.iter().map(read).collect::<Result<_, _>>()?;
    let mut of_files: Vec<ForeignCandidate<'_>> = Vec::new();
    for one in &foreign {
        of_files.extend(one.candidates(&options.recognisers, |line| display.say(line))?);
    }
    let foreign = foreign::entries(folder, earlier.foreign(), &of_files, &candidates)?;

    let listener = listen(experiment, &options.port, display.console()).await?;
    let memory = options.storage.memory;
    let mut session =
        Session::new(experiment, dataset, Arc::clone(&store), memory).map_err(RunError::from)?;
    let mut client = session.cluster.client();
    let settings = experiment.coordinator();
    display.follow(&session.cluster);
    in_run.record_look(&LookRow {
        at: SystemTime::now(),
        command: command(&options.perturbations),
        reason: options.reason.clone(),
        descriptors: candidates
            .iter()
            .map(|candidate| candidate.label.as_str())
            .chain(foreign.iter().map(ForeignEntry::label))
            .collect::<Vec<_>>()
            .join(" "),
    })?;
    let looks = results::read_table(folder, results::TableName::Looks)?.shape().0;
    session.splits.publish_test(&session.cluster.blobs);
    let question = session.splits.evaluation(ONLY_SET, &Scaled::from(&evolved), Matching::Test, false);
    let named = distinct(&candidates);
    let descriptors: Vec<Descriptor> = named.iter().map(|one| one.descriptor.clone()).collect();
    let blobs = &session.cluster.blobs;
    let Some(shards) = Shards::publish(&question, space, &descriptors, preprocess, blobs) else {
        return Err(CompareError::NoTest(folder.to_owned()));
    };
    let tasks = shards.tasks(&descriptors);
    let kept = KeptDescriptions::new(&store, preprocess, &tasks, session.cluster.session);
    let names: Vec<&str> = named.iter().map(|one| one.name.as_str()).collect();
    let mut describing = Describing::new(&tasks, &kept, &names, &session.cluster, &display);
    if !describing.is_complete() {
        let scaling =
            scale(options.slurm.as_ref(), (experiment, folder), &session.cluster, display.console())?;
        session.start(listener, settings.local_workers).await;
        describing.complete(&session, &mut client, settings.deadline, &kept, &display).await?;
        drop(scaling); // those that wait for an allocation would find nobody
        if !options.another_follows {
            session.cluster.dismiss_workers().await;
        }
    }
    let answerers = session.cluster.answerers().map_err(RunError::from)?;
    finished_runs::note_comparison(&store, folder, answerers, describing.sources());
    let gathered = shards.gather(&descriptors, &describing.into_descriptions())?;

    let tables = Tables { run: &run.row, dataset, labels: shards.labels(), out };
    let comparing = Comparing {
        tables,
        candidates: &candidates,
        foreign: &foreign,
        descriptors: &named,
        display: &display,
    };
    let compared = comparing.tabulate(&gathered, &earlier).and_then(|mut tabulated| {
        if options.times {
            comparing.measure(&mut tabulated, &asked, preprocess)?;
        }
        let of_files = foreign.iter().filter(|_| !options.perturbations.is_empty());
        for entry in of_files {
            display.say(&format!("{}: a file says nothing of perturbed clouds", entry.label()));
        }
        for &kind in &options.perturbations {
            comparing.perturb(&mut tabulated, &gathered, &asked, (preprocess, kind))?;
        }
        Ok(tabulated)
    });
    if let Err(CompareError::Contradiction { .. }) = &compared {
        kept.forget_all();
        out.begin_comparison()?;
    }
    let Tabulated { rows, pairs, perturbed, .. } = compared?;
    let name = run.row.name.clone();
    Ok(Comparison { name, level: Level::of(&run.row), rows, pairs, front, perturbed, looks, folder: place })
}

/// How the record of looks names what is done.
fn command(perturbations: &[Perturbation]) -> String {
    let kinds: Vec<&str> = perturbations.iter().map(|kind| kind.name()).collect();
    if kinds.is_empty() { "compare".to_owned() } else { format!("compare --perturb {}", kinds.join(",")) }
}

/// What is asked for: each descriptor that was named, or all that clouds with or without colour allow, and those that
/// are given; under each distance.
fn choose(
    options: &Options,
    given: Vec<Named>,
    colour: bool,
    say: impl Fn(&str),
) -> Result<Vec<Choice>, CompareError> {
    let is_refused = |one: &&Named| one.needs_colour() && !colour;
    let refused =
        |option: &str, one: &Named| CompareError::NeedsColour { name: format!("{option} {}", one.name()) };
    if let Some(one) = options.descriptors.iter().flatten().find(is_refused) {
        return Err(refused("--descriptor", one));
    }
    if let Some(one) = given.iter().find(is_refused) {
        return Err(refused("descriptor", one));
    }
    let mut named = options.descriptors.clone().unwrap_or_else(|| Named::ALL.to_vec());
    if named.iter().any(|one| is_refused(&one)) {
        say("clouds without colours: all but the evolved descriptor and those that are given are left out");
        named.retain(|one| !is_refused(&one));
    }
    let named = named.iter().chain(&given);
    let choices = named.flat_map(Choice::of).filter(|choice| {
        options.distances.contains(&choice.distance) && options.recognisers.contains(&choice.recogniser)
    });
    Ok(choices.collect())
}

/// Each descriptor once, whatever the distances.
fn distinct(candidates: &[Candidate]) -> Vec<NamedDescriptor> {
    let mut distinct: Vec<NamedDescriptor> = Vec::new();
    for Candidate { name, descriptor, .. } in candidates {
        if distinct.iter().all(|one| one.descriptor != *descriptor) {
            distinct.push(NamedDescriptor { name: name.clone(), descriptor: descriptor.clone() });
        }
    }
    distinct
}

/// A comparison from descriptions on.
struct Comparing<'a> {
    tables: Tables<'a>,
    candidates: &'a [Candidate],
    foreign: &'a [ForeignEntry<'a>],
    descriptors: &'a [NamedDescriptor],
    display: &'a Display,
}

/// What was written: of each candidate its answers and its row, those of files after the others, and all pairs.
struct Tabulated {
    compared: Vec<Compared>,
    rows: Vec<ComparedRow>,
    pairs: Vec<PairRow>,
    perturbed: Vec<PerturbedRow>,
}

impl Comparing<'_> {
    /// Writes the tables, with the times that were measured before.
    fn tabulate(&self, gathered: &[Described], earlier: &Earlier) -> Result<Tabulated, CompareError> {
        let Tables { out, .. } = self.tables;
        match earlier.labels() {
            none if none.is_empty() => out.begin_comparison()?,
            labels => out.extend_comparison(&labels)?,
        }
        let mut compared = Vec::new();
        for candidate in self.candidates {
            let mut described = self.descriptors.iter().zip(gathered);
            let described = described.find(|(one, _)| one.descriptor == candidate.descriptor);
            let Some((_, described)) = described else { continue }; // `distinct` has them all
            compared.push(self.tables.add(candidate, described)?);
        }
        for entry in self.foreign {
            compared.push(match entry {
                ForeignEntry::Given(candidate) => self.tables.add_foreign(candidate)?,
                ForeignEntry::Kept(row) => self.tables.keep(row)?,
            });
        }
        for one in compared.iter().filter(|one| one.is_abridged) {
            self.display.say(&format!(
                "{}: more than {MAX_PAIRS} pairs of clouds: no distances and no curve over all pairs are kept",
                one.row.descriptor
            ));
        }
        let row = |one: &Compared| {
            let row = ComparedRow { cloud_seconds: earlier.cloud_seconds(&one.row), ..one.row.clone() };
            match earlier.measured(&one.row) {
                Some(measured) => with_times(row, measured),
                None => row,
            }
        };
        let rows: Vec<ComparedRow> = compared.iter().map(row).collect();
        let pairs = self.tables.pairs(&compared);
        out.write_comparison(&rows, &pairs)?;
        let perturbed = results::read_perturbed(out.path()).map_err(CompareError::Earlier)?;
        Ok(Tabulated { compared, rows, pairs, perturbed })
    }

    /// Measures the times that are asked for and missing, each descriptor once, and adds them to the table as soon as
    /// they are there.
    fn measure(
        &self,
        tabulated: &mut Tabulated,
        asked: &[Choice],
        preprocess: &Preprocess,
    ) -> Result<(), CompareError> {
        let Tabulated { compared, rows, pairs, .. } = tabulated;
        let is_asked = |label: &str| asked.iter().any(|choice| choice.label() == label);
        for NamedDescriptor { name, descriptor } in self.descriptors {
            let missing = self.candidates.iter().enumerate().filter(|(index, candidate)| {
                candidate.descriptor == *descriptor
                    && candidate.recogniser == Method::Nearest
                    && rows[*index].times.is_none()
                    && is_asked(&candidate.label)
            });
            let missing: Vec<(usize, SetDistance)> =
                missing.map(|(index, candidate)| (index, candidate.distance)).collect();
            if missing.is_empty() {
                continue;
            }
            let clouds = self.tables.labels.iter().map(|side| side.len() as u32).sum();
            self.display.say(&format!("measuring {name}: {clouds} clouds on one thread"));
            self.display.begin("measured", std::iter::once(name.clone()), clouds);
            let distances: Vec<SetDistance> = missing.iter().map(|(_, distance)| *distance).collect();
            let watch = || self.display.add(0, 1);
            let timed = time(self.tables.dataset, preprocess, descriptor, &distances, &watch)?;
            for ((index, _), timed) in missing.into_iter().zip(timed) {
                timed.confirm(&self.candidates[index].label, &compared[index].answers)?;
                // Channels of structures have keypoints of their own, or none.
                let is_structure = descriptor.family() == Family::Structure;
                let keypoints_per_cloud = (!is_structure).then_some(timed.keypoints_per_cloud);
                let measured = Measured { times: timed.times, keypoints_per_cloud };
                rows[index] = with_times(rows[index].clone(), measured);
            }
            self.tables.out.write_comparison(rows, pairs)?;
        }
        Ok(())
    }

    /// Measures the errors under one kind of perturbation that are asked for and missing, and adds them to the table.
    fn perturb(
        &self,
        tabulated: &mut Tabulated,
        gathered: &[Described],
        asked: &[Choice],
        (preprocess, kind): (&Preprocess, Perturbation),
    ) -> Result<(), CompareError> {
        let Tabulated { compared, rows, perturbed, .. } = tabulated;
        let of_kind = |row: &&PerturbedRow| row.kind == kind.name();
        let is_missing = |row: &ComparedRow| {
            let there = perturbed.iter().filter(of_kind).filter(|one| one.descriptor == row.descriptor);
            let strengths: Vec<f64> = there.clone().map(|one| one.strength).collect();
            let is_same = there.clone().any(|one| one.strength == 0.0 && one.counts == row.counts);
            !is_same || kind.strengths().iter().any(|strength| !strengths.contains(strength))
        };
        let mut descriptors = Vec::new();
        for (NamedDescriptor { descriptor, .. }, described) in self.descriptors.iter().zip(gathered) {
            let own = self.candidates.iter().zip(compared.iter()).filter(|(candidate, one)| {
                let is_asked = asked.iter().any(|choice| choice.label() == candidate.label);
                candidate.descriptor == *descriptor && is_asked && is_missing(&one.row)
            });
            let subjects: Vec<Subject<'_>> = own
                .map(|(candidate, one)| Subject {
                    row: &one.row,
                    answers: &one.answers,
                    distance: candidate.distance,
                    learned: one.learned.as_ref(),
                })
                .collect();
            if !subjects.is_empty() {
                descriptors.push(PerturbedDescriptor { descriptor, described, subjects });
            }
        }
        if descriptors.is_empty() {
            return Ok(());
        }
        let Tables { run, dataset, labels, out } = self.tables;
        let clouds = PerturbedClouds { dataset, preprocess, labels, seed: run.seed, display: self.display };
        let more = clouds.rows(kind, &descriptors)?;
        let is_new = |row: &PerturbedRow| {
            more.iter().any(|new| new.kind == row.kind && new.descriptor == row.descriptor)
        };
        perturbed.retain(|row| !is_new(row));
        perturbed.extend(more);
        // As descriptors are shown, kinds as they are listed; strengths ascend.
        let place = |row: &PerturbedRow| {
            (rows.iter().position(|one| one.descriptor == row.descriptor), Perturbation::named(&row.kind))
        };
        perturbed.sort_by(|a, b| place(a).cmp(&place(b)).then(a.strength.total_cmp(&b.strength)));
        Ok(out.write_perturbed(perturbed)?)
    }
}

fn with_times(row: ComparedRow, measured: Measured) -> ComparedRow {
    let keypoints_per_cloud = measured.keypoints_per_cloud.or(row.keypoints_per_cloud);
    ComparedRow { times: Some(measured.times), keypoints_per_cloud, ..row }
}
