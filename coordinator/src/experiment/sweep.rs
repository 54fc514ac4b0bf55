//! A sweep: several runs of one experiment that differ in their seed and in how they search.

use std::collections::BTreeSet;
use std::path::Path;

use evolution::Method;

use super::checks::{checked_name, checked_seed};
use super::forms::RawSeeds;
use super::paths::Lookup;
use super::{ConfigError, Experiment, Overrides, read_bounded, resolved, syntax, validate};
use artefact::sections::Fault;

/// Most runs of one sweep: each has a folder of its own and keeps its population in memory.
pub const MAX_MEMBERS: usize = 1000;

/// What an experiment file asks for.
#[derive(Clone, Debug, PartialEq)]
pub enum Plan {
    /// One run.
    Run(Box<Experiment>),
    /// Several.
    Sweep(Box<Sweep>),
}

/// Several runs over the same clouds and workers: each seed, each variant, or each variant with each seed.
#[derive(Clone, Debug, PartialEq)]
pub struct Sweep {
    base: Experiment,
    /// `None`: the experiment's own.
    seeds: Option<Vec<u64>>,
    /// By name. Empty: the experiment as it is.
    variants: Vec<(String, Experiment)>,
}

/// One run of a sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct Member {
    /// Unique in its sweep, and fit to be the name of a folder.
    pub name: String,
    /// As if it were run alone.
    pub experiment: Experiment,
}

impl Plan {
    /// Reads and checks an experiment file, see [`Experiment::read`].
    pub fn read(path: &Path, overrides: Overrides) -> Result<Self, ConfigError> {
        let text = read_bounded(path).map_err(|fault| fault.in_file(path))?;
        Self::parse(&text, path, overrides, &|name| std::env::var(name))
    }

    /// The plan of a record; `origin` names it in messages.
    pub fn from_record(text: &str, origin: &Path, overrides: Overrides) -> Result<Self, ConfigError> {
        Self::parse(text, origin, overrides, &|name| std::env::var(name))
    }

    pub(super) fn parse(
        text: &str,
        path: &Path,
        overrides: Overrides,
        lookup: Lookup<'_>,
    ) -> Result<Self, ConfigError> {
        let plan = || {
            let mut raw = syntax::parse(text)?;
            let sweep = raw.sweep.take();
            let read = |raw| validate::experiment(raw, path, overrides, lookup);
            let base = read(raw)?;
            let Some(sweep) = sweep else { return Ok(Self::Run(Box::new(base))) };
            if let Some(seed) = overrides.seed {
                return Err(Fault::new(
                    "--seed",
                    format!("a sweep names the seeds of its runs, got {seed}"),
                    "leave it out, or change sweep.seeds",
                ));
            }
            let seeds = sweep.seeds.map(seeds).transpose()?;
            let variants = syntax::parse_variants(text)?.into_iter().map(|(name, raw)| {
                let place = format!("sweep.variants.{name}");
                checked_name(&place, &name)?;
                let experiment = read(raw).map_err(|fault| fault.within(&place))?;
                Ok((name, experiment))
            });
            Sweep { base, seeds, variants: variants.collect::<Result<_, Fault>>()? }
                .checked()
                .map(Self::Sweep)
        };
        plan().map_err(|fault| fault.in_file(path))
    }

    /// The experiment; of a sweep, the one that its runs are variants of.
    pub fn base(&self) -> &Experiment {
        match self {
            Self::Run(experiment) => experiment,
            Self::Sweep(sweep) => &sweep.base,
        }
    }

    /// As [`Experiment::resolved_toml`], with the sweep.
    pub fn resolved_toml(&self) -> String {
        match self {
            Self::Run(experiment) => experiment.resolved_toml(),
            Self::Sweep(sweep) => sweep.base.resolved_toml() + &sweep.section(),
        }
    }
}

impl Sweep {
    fn checked(mut self) -> Result<Box<Self>, Fault> {
        if self.seeds.is_none() && self.variants.is_empty() {
            return Err(Fault::new(
                "sweep",
                "neither seeds nor variants, got none",
                "write `seeds = \"1..20\"`, or a section [sweep.variants.NAME]",
            ));
        }
        let runs = self.seeds.as_ref().map_or(1, Vec::len).saturating_mul(self.variants.len().max(1));
        if runs > MAX_MEMBERS {
            return Err(Fault::new(
                "sweep",
                format!("more than {MAX_MEMBERS} runs, got {runs}"),
                "name fewer seeds or variants",
            ));
        }
        let named =
            self.variants.iter().map(|(name, experiment)| (format!("sweep.variants.{name}."), experiment));
        for (place, experiment) in named.chain([(String::new(), &self.base)]) {
            if experiment.method == Method::Exhaustive {
                let others = Method::ALL.iter().filter(|method| **method != Method::Exhaustive);
                let others: Vec<String> = others.map(|method| format!("\"{method}\"")).collect();
                return Err(Fault::new(
                    format!("{place}search.method"),
                    "an exhaustive search has neither seed nor variants, got one in a sweep",
                    format!("write {}, or remove [sweep]", others.join(" or ")),
                ));
            }
            if experiment.dataset != self.base.dataset {
                return Err(Fault::new(
                    format!("{place}stop.validation_patience"),
                    "changes which clouds are used, got other ones than those of the experiment",
                    "the runs of a sweep share their clouds: name all four splits in [dataset.splits]",
                ));
            }
        }
        // Of several seeds, none is the experiment's own: the text of the sweep must not depend on it.
        if let Some(&[first, ..]) = self.seeds.as_deref() {
            self.base.seed = first;
            self.variants.iter_mut().for_each(|(_, experiment)| experiment.seed = first);
        }
        Ok(Box::new(self))
    }

    /// The experiment that the runs are variants of.
    pub fn base(&self) -> &Experiment {
        &self.base
    }

    /// All runs, variant by variant, in the order of their seeds.
    pub fn members(&self) -> Vec<Member> {
        let unnamed = [(String::new(), self.base.clone())];
        let variants = if self.variants.is_empty() { &unnamed[..] } else { &self.variants };
        let mut members = Vec::new();
        for (variant, experiment) in variants {
            match &self.seeds {
                None => members.push(Member { name: variant.clone(), experiment: experiment.clone() }),
                Some(seeds) => members.extend(seeds.iter().map(|&seed| {
                    let name = match variant.as_str() {
                        "" => format!("seed-{seed}"),
                        variant => format!("{variant}-seed-{seed}"),
                    };
                    Member { name, experiment: Experiment { seed, ..experiment.clone() } }
                })),
            }
        }
        members
    }

    /// What determines the results of all runs, as [`Experiment::search_toml`] does for one.
    pub fn search_toml(&self) -> String {
        self.base.search_toml() + &self.section()
    }

    /// As [`Experiment::record_toml`], with the sweep.
    pub fn record_toml(&self) -> String {
        self.base.record_toml() + &self.section()
    }

    /// `<name>-sweep-<12 hex digits>`: the same command finds its sweep again.
    pub fn folder_name(&self) -> String {
        let digest = blake3::hash(self.search_toml().as_bytes()).to_hex();
        format!("{}-sweep-{}", self.base.name, &digest[..12])
    }

    fn section(&self) -> String {
        resolved::sweep_section(self.seeds.as_deref(), &self.base, &self.variants)
    }
}

/// The seeds of a sweep, each once.
fn seeds(raw: RawSeeds) -> Result<Vec<u64>, Fault> {
    let fault = |what: String, advice: &str| Err(Fault::new("sweep.seeds", what, advice));
    let seeds = match raw {
        RawSeeds::Range(text) => {
            let ends = text.split_once("..").and_then(|(first, last)| {
                Some((first.trim().parse::<u64>().ok()?, last.trim().parse::<u64>().ok()?))
            });
            let Some((first, last)) = ends else {
                let advice = "write \"1..20\" for all from 1 to 20, or a list such as [1, 5, 9]";
                return fault(format!("not two seeds with `..` between, got {text:?}"), advice);
            };
            if first > last {
                return fault(
                    format!("ends before it begins, got {text:?}"),
                    &format!("write \"{last}..{first}\""),
                );
            }
            if last - first >= MAX_MEMBERS as u64 {
                return fault(format!("more than {MAX_MEMBERS} seeds, got {text:?}"), "name fewer seeds");
            }
            (first..=last).collect()
        }
        RawSeeds::List(seeds) => seeds,
    };
    if seeds.is_empty() {
        return fault("no seed, got []".to_owned(), "write \"1..20\", or a list such as [1, 5, 9]");
    }
    let mut met = BTreeSet::new();
    for &seed in &seeds {
        checked_seed("sweep.seeds", seed)?;
        if !met.insert(seed) {
            return fault(format!("must be different, got {seed} twice"), "name each seed once");
        }
    }
    Ok(seeds)
}
