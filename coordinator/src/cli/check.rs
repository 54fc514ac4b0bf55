//! `coordinator check`: what an experiment would do, without doing it.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use crate::console::say;
use crate::dataset::{Leak, Recognised, SequencesMissing, Verdict, Wanted};
use crate::exhaust::grid::Grid;
use crate::experiment::{Experiment, Member, Overrides, Plan};
use crate::fitness::FitnessProtocol;
use crate::lines;
use crate::lines::percent;
use crate::run;
use crate::run::search_space;

/// Validate an experiment and its data; print what would be run
///
/// Example: coordinator check experiments/demo.toml
#[derive(Debug, Args)]
pub struct Check {
    /// The experiment, for example experiments/demo.toml
    #[arg(value_name = "EXP.toml")]
    experiment: PathBuf,
}

impl Check {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let plan = Plan::read(&self.experiment, Overrides::default())?;
        let experiment = plan.base();
        let dataset = run::open_data(experiment, Wanted::AllAndLeak, None, |line| say(line))?;
        let experiments = match &plan {
            Plan::Run(experiment) => vec![(**experiment).clone()],
            Plan::Sweep(sweep) => sweep.members().into_iter().map(|member| member.experiment).collect(),
        };
        let mut notes = BTreeSet::new();
        for experiment in &experiments {
            notes.extend(run::check_fitness(experiment, &dataset)?);
        }
        notes.iter().for_each(say);
        let mut text = plan.resolved_toml();
        if !text.ends_with('\n') {
            text.push('\n');
        }
        let splits = &dataset.splits;
        text.push_str(&format!(
            "\n# clouds: train1 {}, train2 {}, validation {}, test {}; skipped {}\n",
            splits.train1.len(),
            splits.train2.len(),
            splits.validation.len(),
            splits.test.len(),
            dataset.clouds.skipped.len()
        ));
        text.push_str(&format!(
            "# objects: {} instances in {} categories\n",
            dataset.clouds.instances.len(),
            dataset.clouds.categories.len()
        ));
        text.push_str(&format!("# data digest: {}\n", proto::Digest(dataset.clouds.digest)));
        if let Some(leak) = &dataset.leak {
            text.push_str(&leak_lines(leak));
            for warning in leak_warnings(leak, &experiments) {
                say(format_args!("warning: {warning}"));
            }
        }
        let descriptors = experiment.space().size();
        text.push_str(&format!(
            "# search space: {} descriptors, {} bits\n",
            descriptors.map_or_else(|| "over 10^38".to_owned(), |count| count.to_string()),
            search_space::genome(experiment.space(), experiment.encoding()).bits()
        ));
        match &plan {
            Plan::Run(experiment) => text.push_str(&format!("# search: {}\n", search(experiment)?)),
            Plan::Sweep(sweep) => {
                for Member { name, experiment } in sweep.members() {
                    text.push_str(&format!("# search of {name}: {}\n", search(&experiment)?));
                }
            }
        }
        super::print(&text)?;
        Ok(ExitCode::SUCCESS)
    }
}

/// The method and what it evaluates.
fn search(experiment: &Experiment) -> anyhow::Result<String> {
    let (method, generations) = (experiment.method(), experiment.stop().generations);
    Ok(match search_space::strategy(experiment)? {
        Some(strategy) => {
            let largest = strategy.largest_generation();
            let most = u64::from(largest) * u64::from(generations);
            let budget = experiment.stop().evaluations.map_or_else(String::new, |budget| {
                format!(", or until {budget} different descriptors are evaluated")
            });
            format!("{method}, at most {most} individuals in {generations} generations of {largest}{budget}")
        }
        None => {
            let grid = Grid::new(experiment.space())?;
            let (descriptors, cells) = (grid.descriptors(), grid.cells());
            format!("{method}, all {descriptors} descriptors in {cells} grid cells")
        }
    })
}

/// How well positions alone recognise objects, as comments of a TOML.
fn leak_lines(leak: &Leak) -> String {
    let across = leak.across.as_ref().ok();
    let measured = [
        ("train1 against train2", Some(&leak.split)),
        ("validation against train1 + train2", Some(&leak.validation)),
        ("train1 + train2 across sequences", across),
    ];
    let row = |(name, recognised): (&str, Option<&Recognised>)| {
        let recognised = recognised.filter(|recognised| recognised.queries > 0)?;
        Some(vec![
            format!("#   {name}"),
            percent(recognised.share()),
            format!("of {}", recognised.queries),
            format!("chance {}", percent(recognised.chance)),
        ])
    };
    let rows: Vec<Vec<String>> = measured.into_iter().filter_map(row).collect();
    let unknown = match &leak.across {
        Ok(Recognised { queries: 0, .. }) => {
            "#   across sequences: not measured, no object was recorded in two of them\n".to_owned()
        }
        Ok(_) => String::new(),
        Err(SequencesMissing { count, first }) => format!(
            "#   across sequences: not measured, {count} clouds have none, such as\n\
             #   {first}: name sequences in a manifest, or as the\n\
             #   layout \"uw\" does\n"
        ),
    };
    format!("# clouds whose object raw camera coordinates give away:\n{}{unknown}", lines::table(&rows))
}

/// That searches can gain from positions, and which protocol keeps them from that: what is matched within sequences from
/// where objects stood, what is matched across them from places that objects keep.
fn leak_warnings(leak: &Leak, experiments: &[Experiment]) -> Vec<String> {
    const AT_OTHER_PLACES: &str =
        "no protocol keeps it from that: unless objects differ in size, record each of them at other places";
    let protocols = || experiments.iter().flat_map(|experiment| experiment.fitness().protocols());
    let is_across = |protocol| protocol == FitnessProtocol::CrossSequence;
    let within = match leak.verdict() {
        _ if protocols().all(|(protocol, _)| is_across(protocol)) => None,
        Verdict::Small => None,
        Verdict::WithinSequences => Some(
            "write [search.fitness] cross-sequence = 1 alone: across sequences coordinates give little away",
        ),
        Verdict::Everywhere => Some(AT_OTHER_PLACES),
        Verdict::Unknown => Some(
            "record each object in several sequences, name these (layout \"uw\", or column sequence of a manifest) and \
             write [search.fitness] cross-sequence = 1",
        ),
    };
    let is_matched_across = protocols().any(|(protocol, _)| is_across(protocol));
    let across = leak
        .across
        .as_ref()
        .ok()
        .filter(|across| is_matched_across && across.is_much() && within != Some(AT_OTHER_PLACES));
    let warning = |split: &str, database: &str, found: &Recognised, advice: &str| {
        format!(
            "split {split}: objects that only a descriptor recognises in {database} expected, got {} of {} clouds that raw \
             camera coordinates recognise\na search can learn where objects stood instead of what they are: {advice}",
            found.correct, found.queries
        )
    };
    let within = within.map(|advice| warning("train1", "train2", &leak.split, advice));
    let across = across.map(|found| warning("train1 and train2", "other sequences", found, AT_OTHER_PLACES));
    within.into_iter().chain(across).collect()
}
