//! The experiment written out again: everything for the record, or only what determines the search.

use std::fmt::{Display, Write};
use std::path::Path;

use descriptor::preprocess::Unit;
use descriptor::structure::{Structure, StructureFile};
use descriptor::weigh::Weighing;
use descriptor::{Family, GeneSpec, SearchSpace};
use serde_json::Value;

use evolution::{Crossover, Encoding, GaSettings, Mutation, Scaling, WinnerRule};

use super::defaults::SearchDefaults;
use super::{DEFAULT_RESULTS_DIR, Experiment, LocalWorkers};
use crate::dataset::{Layout, SPLITS, SeededSplit, SplitRule};
use crate::fitness::Fitness;
use cluster::sharding::ShardCount;
use proto::task::Objective;

/// Every key; see [`Experiment::resolved_toml`].
pub(super) fn resolved_toml(experiment: &Experiment) -> String {
    let mut toml = Toml::default();
    toml.key("version", 1);
    toml.key("name", quoted(&experiment.name));
    toml.key("seed", experiment.seed);
    let folder = experiment.path.parent().unwrap_or(Path::new(""));
    let dataset = &experiment.dataset;
    toml.section("dataset");
    toml.key("root", path(&dataset.root, folder));
    if let Layout::Manifest { file } = &dataset.layout {
        toml.key("manifest", path(file, &dataset.root));
    }
    dataset_labels(&mut toml, experiment);
    match &dataset.splits {
        SplitRule::Manifest => toml.key("splits", quoted("manifest")),
        SplitRule::Lists(lists) => {
            toml.section("dataset.splits");
            for (key, lists) in SPLITS.iter().zip(lists) {
                let paths: Vec<String> = lists.iter().map(|list| path(list, &dataset.root)).collect();
                match &paths[..] {
                    [one] => toml.key(key, one),
                    several => toml.key(key, format!("[{}]", several.join(", "))),
                }
            }
        }
        SplitRule::Seeded(seeded) => seeded_split(&mut toml, seeded),
    }
    search_sections(&mut toml, experiment);

    let coordinator = &experiment.coordinator;
    toml.section("coordinator");
    match coordinator.listen {
        Some(listen) => toml.key("listen", quoted(&listen.to_string())),
        None => toml.comment("listen is not set: 127.0.0.1:7700 if it is free"),
    }
    match coordinator.local_workers {
        LocalWorkers::Auto => toml.key("local_workers", quoted("auto")),
        LocalWorkers::Count(count) => toml.key("local_workers", count),
    }
    toml.key("lease_seconds", coordinator.lease.as_secs());
    toml.key("job_seconds", coordinator.job.as_secs());
    toml.key("max_failures", coordinator.max_failures);
    toml.key("worker_grace_seconds", coordinator.worker_grace.as_secs());
    match coordinator.deadline {
        Some(deadline) => toml.key("deadline_seconds", deadline.as_secs()),
        None => toml.key("deadline_seconds", quoted("off")),
    }
    toml.key("audit", float(coordinator.audit));
    match coordinator.pieces {
        ShardCount::Auto => toml.key("pieces", quoted("auto")),
        ShardCount::Fixed(count) => toml.key("pieces", count),
    }
    toml.section("recognition");
    toml.key("method", quoted(experiment.recognition.name()));
    toml.section("results");
    match &experiment.results_dir {
        Some(dir) => toml.key("dir", path(dir, folder)),
        None => toml.comment(&format!("dir is not set: {DEFAULT_RESULTS_DIR} in the current folder")),
    }
    toml.key("baselines", experiment.baselines);
    toml.text
}

/// What determines the search; see [`Experiment::search_toml`]. Its bytes are hashed: whatever is changed here
/// changes the digest of every run.
pub(super) fn search_toml(experiment: &Experiment) -> String {
    let mut toml = Toml::default();
    toml.key("version", 1);
    toml.key("seed", experiment.seed);
    toml.section("dataset");
    dataset_labels(&mut toml, experiment);
    match &experiment.dataset.splits {
        // Lists are paths; what they say is covered by the data digest.
        SplitRule::Lists(_) => toml.key("splits", quoted("lists")),
        SplitRule::Manifest => toml.key("splits", quoted("manifest")),
        SplitRule::Seeded(seeded) => seeded_split(&mut toml, seeded),
    }
    search_sections(&mut toml, experiment);
    toml.text
}

/// What determines the value of every descriptor; see [`Experiment::space_toml`]. Its bytes are hashed, too.
pub(super) fn space_toml(experiment: &Experiment) -> String {
    let mut toml = Toml::default();
    toml.key("unit", quoted(unit(experiment)));
    space_sections(&mut toml, experiment);
    toml.text
}

fn unit(experiment: &Experiment) -> &'static str {
    match experiment.preprocess.unit {
        Unit::Metre => "m",
        Unit::Millimetre => "mm",
    }
}

/// The keys of `[dataset]` that are no paths.
fn dataset_labels(toml: &mut Toml, experiment: &Experiment) {
    let dataset = &experiment.dataset;
    let layout = match &dataset.layout {
        Layout::Uw => "uw",
        Layout::Folders => "folders",
        Layout::Bop => "bop",
        Layout::Manifest { .. } => "manifest",
        Layout::Pattern(_) => "pattern",
    };
    toml.key("layout", quoted(layout));
    if let Layout::Pattern(pattern) = &dataset.layout {
        toml.key("pattern", quoted(&pattern.to_string()));
    }
    toml.key("unit", quoted(unit(experiment)));
    toml.key("skip_unreadable", dataset.skip_unreadable);
}

fn seeded_split(toml: &mut Toml, seeded: &SeededSplit) {
    toml.section("dataset.splits.seeded");
    toml.key("seed", seeded.seed);
    for (key, share) in ["train1", "train2", "validation", "test"].iter().zip(seeded.shares) {
        toml.key(key, float(share));
    }
    toml.key("stratified", seeded.stratified);
    let sequences: Vec<String> = seeded.test_sequences.iter().map(|sequence| quoted(sequence)).collect();
    toml.key("test_sequences", format!("[{}]", sequences.join(", ")));
}

/// The sections that are equal in both texts.
fn search_sections(toml: &mut Toml, experiment: &Experiment) {
    if let Some(synthetic) = &experiment.dataset.synthetic {
        toml.section("dataset.synthetic");
        toml.key("objects", synthetic.objects);
        toml.key("views", synthetic.views);
        toml.key("seed", synthetic.seed);
    }
    space_sections(toml, experiment);
    method_sections(toml, "", experiment, Later::of(experiment));
}

/// The part of a sweep, below the experiment `base` that its runs are variants of; see [`Sweep`](super::Sweep).
pub(super) fn sweep_section(
    seeds: Option<&[u64]>,
    base: &Experiment,
    variants: &[(String, Experiment)],
) -> String {
    let mut toml = Toml::default();
    toml.section("sweep");
    if let Some(seeds) = seeds {
        let seeds: Vec<String> = seeds.iter().map(u64::to_string).collect();
        toml.key("seeds", format!("[{}]", seeds.join(", ")));
    }
    for (name, experiment) in variants {
        // What the base has written, a variant must undo.
        let (own, bases) = (Later::of(experiment), Later::of(base));
        let later = Later {
            winner: own.winner || bases.winner,
            evaluations: own.evaluations || bases.evaluations,
            objectives: own.objectives || bases.objectives,
            sets: own.sets || bases.sets,
            preselection: own.preselection || bases.preselection,
            weigh: own.weigh || bases.weigh,
        };
        method_sections(&mut toml, &format!("sweep.variants.{name}."), experiment, later);
    }
    toml.text
}

/// Which of the keys are written that came later than others; see [`SearchDefaults::hashes_every_key`].
#[derive(Clone, Copy)]
struct Later {
    winner: bool,
    evaluations: bool,
    objectives: bool,
    sets: bool,
    preselection: bool,
    weigh: bool,
}

impl Later {
    fn of(experiment: &Experiment) -> Self {
        let defaults = SearchDefaults::of(experiment.space.family());
        let every = defaults.hashes_every_key;
        Self {
            winner: every || experiment.winner != defaults.winner(&experiment.stop),
            evaluations: every || experiment.stop.evaluations != defaults.stop.evaluations,
            // Only searches of several have a choice.
            objectives: experiment.objectives.are_several(),
            sets: !experiment.set_weights.is_empty(),
            preselection: experiment.ga.preselection != GaSettings::default().preselection,
            weigh: experiment.weigh.is_some(),
        }
    }
}

/// The sections that say how is searched, and when the search ends, below `parent`.
fn method_sections(toml: &mut Toml, parent: &str, experiment: &Experiment, later: Later) {
    toml.section(&format!("{parent}search"));
    toml.key("method", quoted(experiment.method.as_str()));
    if later.objectives {
        let objectives = experiment.objectives.each().map(|objective| quoted(objective.name()));
        toml.key("objectives", format!("[{}]", objectives.collect::<Vec<_>>().join(", ")));
    }
    if later.winner {
        let winner = match experiment.winner {
            WinnerRule::Validation => "validation",
            WinnerRule::Fitness => "fitness",
        };
        toml.key("winner", quoted(winner));
    }
    if later.weigh {
        toml.key("weigh", quoted(experiment.weigh.map_or("off", Weighing::name)));
    }
    fitness_section(toml, parent, experiment);
    if later.sets {
        toml.section(&format!("{parent}search.sets"));
        for (name, weight) in &experiment.set_weights {
            toml.key(name, weight);
        }
    }
    let ga = &experiment.ga;
    toml.section(&format!("{parent}ga"));
    toml.key("population", ga.population);
    toml.key("elite", ga.elite);
    toml.key("selection", quoted("roulette"));
    let scaling = match ga.scaling {
        Scaling::None => "none",
        Scaling::Linear => "linear",
        Scaling::Rank => "rank",
    };
    toml.key("scaling", quoted(scaling));
    let crossover = match ga.crossover {
        Crossover::Uniform => "uniform",
        Crossover::Slots => "slots",
        Crossover::AnySlots => "any-slots",
    };
    toml.key("crossover", quoted(crossover));
    toml.key("crossover_rate", float(ga.crossover_rate));
    let mutation = match ga.mutation {
        Mutation::InOrder => "in-order",
        Mutation::Field => "field",
        Mutation::Slot => "slot",
    };
    toml.key("mutation", quoted(mutation));
    toml.key("mutation_rate", float(ga.mutation_rate));
    toml.key("mutation_decay", float(ga.mutation_decay));
    if later.preselection {
        toml.key("preselection", ga.preselection);
    }
    let encoding = match experiment.encoding {
        Encoding::Binary => "binary",
        Encoding::Gray => "gray",
    };
    toml.key("encoding", quoted(encoding));
    let stop = &experiment.stop;
    toml.section(&format!("{parent}stop"));
    toml.key("generations", stop.generations);
    toml.key("stagnation", limit(stop.stagnation));
    toml.key("validation_patience", limit(stop.validation_patience));
    toml.key("perfect", stop.perfect);
    if later.evaluations {
        toml.key("evaluations", limit(stop.evaluations));
    }
}

/// The sections that say which descriptors there are and what is computed once for each cloud.
fn space_sections(toml: &mut Toml, experiment: &Experiment) {
    let preprocess = &experiment.preprocess;
    toml.section("preprocess");
    let family = experiment.space.family();
    if family != Family::Structure {
        toml.key("leaf_cm", float(f64::from(preprocess.leaf_um) / 1e4));
    }
    toml.key("normal_radius_cm", float(f64::from(preprocess.normal_radius_um) / 1e4));
    toml.key("min_points", preprocess.min_points);
    toml.section("descriptor");
    // The default is left out: runs of before there was a choice keep their digests.
    if family != Family::DiskRing {
        toml.key("family", quoted(family.name()));
    }
    toml.key("colour", preprocess.colour);
    match &experiment.space {
        SearchSpace::Structures(space) => {
            toml.key("slots", space.slots);
            // The default is left out: runs of before there was a choice keep their digests.
            if space.members > 1 {
                toml.key("members", space.members);
            }
            toml.key("max_bins", space.max_bins);
            toml.key("metric", quoted(space.metric.name()));
            if let Some(max_cost) = experiment.max_cost {
                toml.key("max_cost", max_cost);
            }
            return;
        }
        SearchSpace::Structure(structure) => {
            toml.text += &channels(structure);
            return;
        }
        SearchSpace::DiskRing(_) | SearchSpace::Fixed(_) | SearchSpace::GlobalHue(_) => {}
    }
    toml.section("descriptor.genes");
    for (spec, domain) in experiment.space.genes() {
        let low = gene_value(spec, domain.low);
        if domain.count == 1 {
            toml.key(spec.name, low);
        } else {
            let (high, step) = (gene_value(spec, domain.high()), gene_value(spec, domain.step));
            toml.key(spec.name, format!("{{ min = {low}, max = {high}, step = {step} }}"));
        }
    }
}

/// `[search.fitness]`. The paper's of other families than structure is left out: runs of before there was a choice keep
/// their digests.
fn fitness_section(toml: &mut Toml, parent: &str, experiment: &Experiment) {
    let fitness = &experiment.fitness;
    if *fitness == Fitness::PAPER && experiment.space.family() != Family::Structure {
        return;
    }
    toml.section(&format!("{parent}search.fitness"));
    for (protocol, weight) in fitness.protocols() {
        toml.key(protocol.name(), weight);
    }
    let objective = match fitness.objective() {
        Objective::Object => "object",
        Objective::Category => "category",
    };
    toml.key("objective", quoted(objective));
    toml.key("margin", fitness.has_margin());
}

/// A value of a channel.
fn plain(value: &Value) -> String {
    match value {
        Value::String(text) => quoted(text),
        Value::Array(values) => {
            let values: Vec<String> = values.iter().map(plain).collect();
            format!("[{}]", values.join(", "))
        }
        Value::Number(number) if number.is_f64() => float(number.as_f64().unwrap_or_default()),
        other => other.to_string(),
    }
}

/// The channels of one structure.
fn channels(structure: &Structure) -> String {
    let mut toml = Toml::default();
    for channel in StructureFile::from(structure).channels {
        toml.section("[descriptor.channel]");
        // Only the keys come from serde, and their order.
        let channel = serde_json::to_value(&channel).expect("a channel is a struct of plain values");
        for (key, value) in channel.as_object().into_iter().flatten() {
            toml.key(key, plain(value));
        }
    }
    toml.text
}

fn limit(limit: Option<u32>) -> String {
    limit.map_or_else(|| quoted("off"), |times| times.to_string())
}

fn gene_value(spec: &GeneSpec, ticks: u32) -> String {
    if spec.is_integer() { ticks.to_string() } else { float(spec.value(ticks)) }
}

/// The shortest decimal that reads back as the same number, never with an exponent, always with a point.
fn float(value: f64) -> String {
    let text = value.to_string();
    if text.contains('.') { text } else { text + ".0" }
}

/// A path below `base` relative to it, another as it is: what its reader will join with `base` again.
fn path(path: &Path, base: &Path) -> String {
    let text = path.strip_prefix(base).unwrap_or(path).to_string_lossy();
    match text.as_ref() {
        "" => quoted("."),
        // A folder that is really called ~.
        home if home == "~" || home.starts_with("~/") => quoted(&format!("./{home}")),
        other => quoted(other),
    }
}

/// A basic string of TOML.
fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            c if c.is_control() => quoted.push_str(&format!("\\u{:04X}", u32::from(c))),
            c => quoted.push(c),
        }
    }
    quoted + "\""
}

/// TOML under construction: one key a line, a blank line before each section. Written by hand because its bytes
/// are hashed and must not follow the taste of a library's next version.
#[derive(Default)]
struct Toml {
    text: String,
}

impl Toml {
    fn section(&mut self, name: &str) {
        self.line(format_args!("\n[{name}]"));
    }

    fn key(&mut self, key: &str, value: impl Display) {
        self.line(format_args!("{key} = {value}"));
    }

    fn comment(&mut self, text: &str) {
        self.line(format_args!("# {text}"));
    }

    fn line(&mut self, line: std::fmt::Arguments<'_>) {
        // Writing to a String cannot fail.
        let _ = writeln!(self.text, "{line}");
    }
}
