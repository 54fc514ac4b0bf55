//! The experiment file as written: every key, its type and its default. Meaning is checked in `validate`.
//!
//! The doc comments are the descriptions of the JSON Schema, so they speak to the author of an experiment.

use std::collections::BTreeMap;

use artefact::sections::{RawDescriptor, RawPreprocess};
use descriptor::weigh::Weighing;
use evolution::{Crossover, Encoding, GaSettings, Method, Mutation, Scaling, StopSettings, WinnerRule};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::forms::{NumberOr, RawSeeds, Word};
use super::raw_dataset::RawDataset;
use crate::objectives::SearchObjective;

/// A Descry experiment: which clouds, which descriptors, how to search and when to stop.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, rename = "experiment")]
pub(super) struct RawExperiment {
    /// Version of this format. Always 1.
    #[schemars(range(min = 1, max = 1))]
    pub version: u32,
    /// Name of the run's folder: letters a-z, digits, - and _. Default: the name of the file without `.toml`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "String", regex(pattern = "^[a-z0-9_][a-z0-9_-]*$"), example = &"household")]
    pub name: Option<String>,
    /// Seed of everything random in the search. Same file, seed and clouds: same results, bit for bit.
    #[serde(default = "one")]
    #[schemars(range(min = 0, max = 9_223_372_036_854_775_807_i64))]
    pub seed: u64,
    pub dataset: RawDataset,
    #[serde(default)]
    pub preprocess: RawPreprocess,
    #[serde(default)]
    pub descriptor: RawDescriptor,
    #[serde(default)]
    pub search: RawSearch,
    #[serde(default)]
    pub ga: RawGa,
    #[serde(default)]
    pub stop: RawStop,
    #[serde(default)]
    pub coordinator: RawCoordinator,
    #[serde(default)]
    pub recognition: RawRecognition,
    #[serde(default)]
    pub results: RawResults,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawSweep")]
    pub sweep: Option<RawSweep>,
}

fn one() -> u64 {
    1
}

/// How the best descriptor is searched for.
#[derive(Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default, rename = "search")]
pub(super) struct RawSearch {
    /// How descriptors to evaluate are found.
    pub method: Method,
    /// What is minimised with method = "nsga2": "error", which is 1 - training fitness, and one or both of "cost", the
    /// counted cost of recognising a cloud, and "size", the values kept a cloud. Default: all three; of other methods
    /// the error alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Vec<RawSearchObjective>", length(min = 1, max = 3), example = example_objectives())]
    pub objectives: Option<Vec<RawSearchObjective>>,
    /// Which of the generations' bests wins, the earliest on ties; with method = "nsga2", which point of the front.
    /// Default: of structure "validation", of other families that if stop.validation_patience is on, else "fitness".
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "WinnerRule")]
    pub winner: Option<WinnerRule>,
    /// How values of the winner's signatures get weights when the search is over, learned from the training clouds as
    /// coordinator weigh learns them: the run is then tested with them. Of structures only.
    #[serde(skip_serializing_if = "RawWeighing::is_off")]
    pub weigh: RawWeighing,
    /// What a descriptor's fitness counts. Default: of disk-ring and global-hue the paper's, of structure
    /// cross-sequence.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawFitness")]
    pub fitness: Option<RawFitness>,
    /// Whole weights, 0 to 100, of sets of clouds by the name that the manifest's column set gives them; other sets have
    /// 1. A set of weight 0 has no part in the search and is only tested.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    #[schemars(example = example_sets())]
    pub sets: BTreeMap<String, u32>,
}

fn example_sets() -> BTreeMap<String, u32> {
    BTreeMap::from([("kitchen".to_owned(), 0)])
}

fn example_objectives() -> [&'static str; 3] {
    ["error", "cost", "size"]
}

/// How weights of values are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase", rename = "weighing")]
pub(super) enum RawWeighing {
    /// There are none.
    #[default]
    Off,
    /// Each by itself, for recognisers that learn from the labels of the same clouds.
    Separately,
    /// All together, for the nearest cloud.
    Jointly,
}

impl RawWeighing {
    fn is_off(&self) -> bool {
        *self == Self::Off
    }

    pub(super) fn weighing(self) -> Option<Weighing> {
        match self {
            Self::Off => None,
            Self::Separately => Some(Weighing::Separately),
            Self::Jointly => Some(Weighing::Jointly),
        }
    }
}

/// What is minimised.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase", rename = "search_objective")]
pub(super) enum RawSearchObjective {
    /// 1 - training fitness.
    Error,
    /// Counted cost of recognising a cloud among 1000: about nanoseconds.
    Cost,
    /// Values kept a cloud.
    Size,
}

impl From<RawSearchObjective> for SearchObjective {
    fn from(objective: RawSearchObjective) -> Self {
        match objective {
            RawSearchObjective::Error => Self::Error,
            RawSearchObjective::Cost => Self::Cost,
            RawSearchObjective::Size => Self::Size,
        }
    }
}

/// What a descriptor's fitness counts: a sum over protocols, each times a whole weight. Validation clouds are judged by
/// the same protocols against both training sets. Without any weight the family's default protocols.
#[derive(Clone, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default, rename = "fitness", rename_all = "kebab-case")]
pub(super) struct RawFitness {
    /// Weight of train1 against train2 (paper). It lets a search learn what clouds of one video have in common.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "u32", range(min = 0, max = 100))]
    pub split: Option<u32>,
    /// Weight of each training cloud against those of other sequences. Sequences are compared by name, across objects.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "u32", range(min = 0, max = 100))]
    pub cross_sequence: Option<u32>,
    /// Weight of each training cloud against all others.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "u32", range(min = 0, max = 100))]
    pub leave_one_out: Option<u32>,
    /// What has to be recognised.
    pub objective: RawObjective,
    /// Whether equal counts are told apart by how much nearer the right object is than others. Default: true, but for
    /// the paper's fitness.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "bool")]
    pub margin: Option<bool>,
}

/// What has to be recognised.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase", rename = "objective")]
pub(super) enum RawObjective {
    /// The object.
    #[default]
    Object,
    /// Its category.
    Category,
}

/// The genetic algorithm. Other methods use some of these keys, see search.method. Defaults are the paper's where it has
/// the key. Family structure has its own, which `coordinator check` prints.
#[derive(Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default, rename = "ga")]
pub(super) struct RawGa {
    /// Individuals a generation, of each member where a structure has several.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "u32", range(min = 2, max = 65_536), extend("default" = GaSettings::default().population))]
    pub population: Option<u32>,
    /// Best individuals that are copied unchanged, of each member; fewer than population.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "u32", extend("default" = GaSettings::default().elite))]
    pub elite: Option<u32>,
    /// How parents are chosen.
    pub selection: RawSelection,
    /// How fitness becomes selection weight: "none" is the fitness itself, "linear" lets the best expect twice the
    /// mean, "rank" goes by rank alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Scaling", extend("default" = GaSettings::default().scaling))]
    pub scaling: Option<Scaling>,
    /// How two parents make two children.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Crossover", extend("default" = GaSettings::default().crossover))]
    pub crossover: Option<Crossover>,
    /// Probability that a bit is exchanged; with crossover = "slots" or "any-slots", a slot.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "f64", range(min = 0, max = 1), extend("default" = GaSettings::default().crossover_rate))]
    pub crossover_rate: Option<f64>,
    /// How children are changed.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Mutation", extend("default" = GaSettings::default().mutation))]
    pub mutation: Option<Mutation>,
    /// Probability that a bit between the two points flips, in the first generation; with mutation = "field", that a
    /// gene changes; with "slot", that a gene of that slot does.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "f64", range(min = 0, max = 1), extend("default" = GaSettings::default().mutation_rate))]
    pub mutation_rate: Option<f64>,
    /// Factor on that probability from each generation to the next.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "f64", range(min = 0, max = 1), extend("default" = GaSettings::default().mutation_decay))]
    pub mutation_decay: Option<f64>,
    /// Children that are made for each that is evaluated: those are, of which a model of the last 600 that were evaluated
    /// expects most. 1: all are evaluated. Only with family = "structure".
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "u32", range(min = 1, max = 64), extend("default" = GaSettings::default().preselection))]
    pub preselection: Option<u32>,
    /// How gene values are written as bits.
    pub encoding: Encoding,
}

/// How parents are chosen.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase", rename = "selection")]
pub(super) enum RawSelection {
    /// In proportion to their weight, with replacement.
    #[default]
    Roulette,
}

/// When the search ends: at the first of these. Defaults are the paper's. Family structure has its own,
/// which `coordinator check` prints.
#[derive(Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default, rename = "stop")]
pub(super) struct RawStop {
    /// After this many generations.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "u32", range(min = 1), extend("default" = StopSettings::default().generations))]
    pub generations: Option<u32>,
    /// After this many generations without a better training fitness, or "off".
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "NumberOr<RawOff>", extend("default" = number_or_off(StopSettings::default().stagnation)))]
    pub stagnation: Option<NumberOr<RawOff>>,
    /// When the validation error has risen this many generations in a row, or "off".
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(
        with = "NumberOr<RawOff>",
        extend("default" = number_or_off(StopSettings::default().validation_patience))
    )]
    pub validation_patience: Option<NumberOr<RawOff>>,
    /// When every training query is recognised. With method = "nsga2" false unless it is written.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "bool", extend("default" = StopSettings::default().perfect))]
    pub perfect: Option<bool>,
    /// When this many different descriptors have been evaluated, or "off". Those whose result an earlier run has left
    /// count, too. The generation in which that happens ends with the last of them.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(
        with = "NumberOr<RawOff>",
        extend("default" = number_or_off(StopSettings::default().evaluations))
    )]
    pub evaluations: Option<NumberOr<RawOff>>,
}

fn number_or_off(limit: Option<u32>) -> NumberOr<RawOff> {
    limit.map_or(NumberOr::Word(RawOff::Off), NumberOr::Number)
}

/// Never for this reason.
#[derive(Clone, Copy, Debug, Default, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase", rename = "off")]
pub(super) enum RawOff {
    /// Never for this reason.
    #[default]
    Off,
}

impl Word for RawOff {
    const TEXT: &'static str = "off";
}

/// How work is shared out. Nothing here changes a result.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default, rename = "coordinator")]
pub(super) struct RawCoordinator {
    /// Address and port that other workers are awaited at. Default: 127.0.0.1:7700 (this machine), if it is free.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "String", example = &"127.0.0.1:7700")]
    pub listen: Option<String>,
    /// Workers inside the coordinator: "auto" is one on all cores, a number shares the cores out, 0 leaves all work
    /// to workers that join.
    pub local_workers: NumberOr<RawAuto>,
    /// A worker that was not heard of for this long is given up, and its jobs go to others.
    #[schemars(range(min = 2, max = 3600))]
    pub lease_seconds: u32,
    /// A job without a result for this long is given to another worker, too, and counts as failed once.
    #[schemars(range(min = 1, max = 604_800))]
    pub job_seconds: u32,
    /// A job that failed on this many workers that have computed others, of as many principals or of all that are there,
    /// or this many times and on all workers, stops the run. Workers that are lost do not count.
    #[schemars(range(min = 1, max = 100))]
    pub max_failures: u32,
    /// How long the run waits for another worker after it lost the last one.
    #[schemars(range(min = 0, max = 604_800))]
    pub worker_grace_seconds: u32,
    /// Seconds that the search may take in one start, or "off": then it stops, and the same command goes on with it,
    /// as long again.
    pub deadline_seconds: NumberOr<RawOff>,
    /// Least share of the evaluations that somebody else computes, too, when there is somebody: their answers must be
    /// equal. Of newcomers all first answers are audited, whatever the share. 1 is all of everybody's: where there is
    /// somebody else, nobody alone can then change a result. Also the share that is computed anew of what earlier runs
    /// have left.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub audit: f64,
    /// Into how many shards and tiles an evaluation is cut that few workers would be busy with: "auto" is as many as
    /// there are workers for and as are worth while, a number from 1 (never cut) to 4096 is for tests and experts.
    pub pieces: NumberOr<RawFitting>,
}

impl Default for RawCoordinator {
    fn default() -> Self {
        Self {
            listen: None,
            local_workers: NumberOr::Word(RawAuto::Auto),
            lease_seconds: 30,
            job_seconds: 3600,
            max_failures: 3,
            worker_grace_seconds: 300,
            deadline_seconds: NumberOr::Word(RawOff::Off),
            audit: 0.01,
            pieces: NumberOr::Word(RawFitting::Auto),
        }
    }
}

/// One on all cores.
#[derive(Clone, Copy, Debug, Default, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase", rename = "auto")]
pub(super) enum RawAuto {
    /// One on all cores.
    #[default]
    Auto,
}

impl Word for RawAuto {
    const TEXT: &'static str = "auto";
}

/// As many as are worth while.
#[derive(Clone, Copy, Debug, Default, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase", rename = "fitting")]
pub(super) enum RawFitting {
    /// As many as are worth while.
    #[default]
    Auto,
}

impl Word for RawFitting {
    const TEXT: &'static str = "auto";
}

/// How clouds get their names from the database once the search is over. Changes nothing in the search.
#[derive(Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default, rename = "recognition")]
pub(super) struct RawRecognition {
    /// What is measured beside the nearest cloud at the end of a run, and exported unless --recogniser says otherwise.
    pub method: RawRecogniser,
}

/// How clouds get their names.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case", rename = "recogniser")]
pub(super) enum RawRecogniser {
    /// The name of the nearest cloud.
    #[default]
    Nearest,
    /// A projection to few values in which the objects of the database lie apart.
    Projection,
    /// Kernel ridge regression on distances.
    KernelRidge,
}

/// Where results go.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default, rename = "results")]
pub(super) struct RawResults {
    /// Folder that the run's own folder is made in; a relative path is relative to the folder of the experiment file.
    /// Default: results/runs in the current folder.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "String", example = &"../results/runs")]
    pub dir: Option<String>,
    /// Compare the winner on the test clouds with the paper's descriptor and two histograms of colour over whole clouds,
    /// which anybody has without a search. Changes nothing else.
    pub baselines: bool,
}

impl Default for RawResults {
    fn default() -> Self {
        Self { dir: None, baselines: true }
    }
}

/// Several runs at once, which share the workers: one for each seed, each variant, or each variant with each seed.
#[derive(Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default, rename = "sweep")]
pub(super) struct RawSweep {
    /// Seeds: "1..20" is all from 1 to 20, [1, 5, 9] is these. Default: the experiment's own seed.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawSeeds", example = &"1..20")]
    pub seeds: Option<RawSeeds>,
    /// Variants by name (letters a-z, digits, - and _), each with those keys of [search], [ga] and [stop] that differ
    /// from the experiment's.
    pub variants: BTreeMap<String, RawVariant>,
}

/// How one variant searches. What is not written is the experiment's.
#[derive(Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default, rename = "variant")]
pub(super) struct RawVariant {
    pub search: RawSearch,
    pub ga: RawGa,
    pub stop: RawStop,
}
