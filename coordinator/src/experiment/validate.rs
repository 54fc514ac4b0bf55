//! From keys to meaning: the bounds of every setting. Data set and genes have files of their own.

use std::net::SocketAddr;
use std::num::NonZeroU32;
use std::path::Path;
use std::time::Duration;

use descriptor::recogniser::Method as Recogniser;
use descriptor::structure::Structure;
use descriptor::weigh::Weighing;
use descriptor::{Family, SearchSpace};
use evolution::{Crossover, GaSettings, Method, StopSettings};

use super::checks::{checked_name, checked_seed};
use super::defaults::SearchDefaults;
use super::forms::NumberOr;
use super::paths::{self, Lookup};
use super::raw::{RawCoordinator, RawExperiment, RawGa, RawOff, RawRecogniser, RawStop};
use super::validate_dataset::dataset;
use super::validate_fitness::{fitness, set_weights};
use super::validate_objectives::objectives;
use super::{CoordinatorSettings, Experiment, LocalWorkers, MAX_LOCAL_WORKERS, Overrides};
use artefact::sections::{Fault, RawDescriptor, max_cost, preprocess, search_space};
use cluster::sharding::{MAX_SHARDS, ShardCount};

/// Checks the meaning of every key; the first mistake in the order of the file's sections is reported.
pub(super) fn experiment(
    raw: RawExperiment,
    path: &Path,
    overrides: Overrides,
    lookup: Lookup<'_>,
) -> Result<Experiment, Fault> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let defaults = SearchDefaults::of(raw.descriptor.family.into());
    let method = raw.search.method;
    let stop = stop(&raw.stop, &defaults.stop, method)?;
    let winner = raw.search.winner.unwrap_or_else(|| defaults.winner(&stop));
    let space = search_space(&raw.descriptor)?;
    let results_dir =
        raw.results.dir.map(|dir| paths::resolve("results.dir", &dir, folder, lookup)).transpose()?;
    Ok(Experiment {
        path: path.to_owned(),
        name: name(raw.name, path)?,
        seed: match overrides.seed {
            Some(seed) => checked_seed("--seed", seed)?,
            None => checked_seed("seed", raw.seed)?,
        },
        preprocess: preprocess(&raw.preprocess, raw.dataset.unit.into(), &raw.descriptor)?,
        dataset: dataset(raw.dataset, winner.validates(&stop), folder, lookup)?,
        weigh: weighs(raw.search.weigh.weighing(), &space)?,
        max_cost: max_cost(&raw.descriptor, &space)?,
        space,
        method,
        objectives: objectives(raw.search.objectives.as_deref(), method)?,
        winner,
        fitness: fitness(raw.search.fitness.as_ref(), defaults.fitness)?,
        set_weights: set_weights(raw.search.sets)?,
        ga: ga(&raw.ga, &defaults.ga, &raw.descriptor)?,
        encoding: raw.ga.encoding,
        stop,
        coordinator: coordinator(&raw.coordinator, overrides)?,
        recognition: match raw.recognition.method {
            RawRecogniser::Nearest => Recogniser::Nearest,
            RawRecogniser::Projection => Recogniser::Projection,
            RawRecogniser::KernelRidge => Recogniser::KernelRidge,
        },
        baselines: raw.results.baselines,
        results_dir,
    })
}

fn name(given: Option<String>, path: &Path) -> Result<String, Fault> {
    let name = given.unwrap_or_else(|| path.file_stem().unwrap_or_default().to_string_lossy().into_owned());
    checked_name("name", &name)?;
    Ok(name)
}

/// Refuses weights of values where none can be learned, whatever the winner.
fn weighs(asked: Option<Weighing>, space: &SearchSpace) -> Result<Option<Weighing>, Fault> {
    const PLACE: &str = "search.weigh";
    let most = Structure::MAX_VALUE_WEIGHTS as u64;
    match space {
        _ if asked.is_none() => Ok(None),
        // A channel has at most as many deviations as means.
        SearchSpace::Structures(space) if 2 * u64::from(space.max_bins) > most => Err(Fault::new(
            PLACE,
            format!("needs descriptor.max_bins of at most {}, got {}", most / 2, space.max_bins),
            "lower it, or leave search.weigh out",
        )),
        SearchSpace::Structure(structure) if structure.has_value_weights() => Err(Fault::new(
            PLACE,
            "needs channels without value_weights, got some with",
            "leave one of the two out",
        )),
        SearchSpace::Structure(structure) if structure.signature_values() > most => Err(Fault::new(
            PLACE,
            format!("needs channels of at most {most} values, got {}", structure.signature_values()),
            "leave it out, or name channels with fewer bins",
        )),
        SearchSpace::Structures(_) | SearchSpace::Structure(_) => Ok(asked),
        SearchSpace::DiskRing(_) | SearchSpace::Fixed(_) | SearchSpace::GlobalHue(_) => Err(Fault::new(
            PLACE,
            format!("needs structures, got family {}", space.family().name()),
            "leave it out, or set descriptor.family = \"structure\"",
        )),
    }
}

fn ga(raw: &RawGa, defaults: &GaSettings, descriptor: &RawDescriptor) -> Result<GaSettings, Fault> {
    let family = Family::from(descriptor.family);
    // Adding 0 turns the rate -0 into 0: they mean the same and must read the same.
    let rate = |written: Option<f64>, default: f64| written.unwrap_or(default) + 0.0;
    let settings = GaSettings {
        population: raw.population.unwrap_or(defaults.population),
        elite: raw.elite.unwrap_or(defaults.elite),
        scaling: raw.scaling.unwrap_or(defaults.scaling),
        crossover: raw.crossover.unwrap_or(defaults.crossover),
        crossover_rate: rate(raw.crossover_rate, defaults.crossover_rate),
        mutation: raw.mutation.unwrap_or(defaults.mutation),
        mutation_rate: rate(raw.mutation_rate, defaults.mutation_rate),
        mutation_decay: rate(raw.mutation_decay, defaults.mutation_decay),
        preselection: raw.preselection.unwrap_or(defaults.preselection),
    }
    .validate()
    .map_err(|error| Fault::from_message("", &error.to_string()))?;
    if settings.crossover == Crossover::AnySlots && family != Family::Structure {
        return Err(Fault::new(
            "ga.crossover",
            format!("\"any-slots\" needs slots, got family {}", family.name()),
            "set it to \"slots\", which exchanges single genes there, or set descriptor.family = \"structure\"",
        ));
    }
    // The model compares channels: of genes that are one vector it would know little.
    if settings.preselection > 1 && family != Family::Structure {
        return Err(Fault::new(
            "ga.preselection",
            format!("must be 1 with family {}, got {}", family.name(), settings.preselection),
            "leave it out, or set descriptor.family = \"structure\"",
        ));
    }
    if settings.preselection > 1 && descriptor.members.is_some_and(|members| members > 1) {
        return Err(Fault::new(
            "ga.preselection",
            format!("must be 1 beside descriptor.members, got {}", settings.preselection),
            "leave one of the two out",
        ));
    }
    Ok(settings)
}

fn stop(raw: &RawStop, defaults: &StopSettings, method: Method) -> Result<StopSettings, Fault> {
    let limit = |written: Option<NumberOr<RawOff>>, default: Option<u32>| match written {
        Some(NumberOr::Number(limit)) => Some(limit),
        Some(NumberOr::Word(RawOff::Off)) => None,
        None => default,
    };
    StopSettings {
        // Without errors, a descriptor may still become faster or smaller.
        perfect: raw.perfect.unwrap_or(defaults.perfect && method != Method::Nsga2),
        validation_patience: limit(raw.validation_patience, defaults.validation_patience),
        stagnation: limit(raw.stagnation, defaults.stagnation),
        generations: raw.generations.unwrap_or(defaults.generations),
        evaluations: limit(raw.evaluations, defaults.evaluations),
    }
    .validate()
    .map_err(|error| Fault::from_message("", &error.to_string()))
}

fn coordinator(raw: &RawCoordinator, overrides: Overrides) -> Result<CoordinatorSettings, Fault> {
    let between = |key: &str, got: u32, low: u32, high: u32, unit: &str| {
        if (low..=high).contains(&got) {
            return Ok(got);
        }
        Err(Fault::new(
            format!("coordinator.{key}"),
            format!("not between {low} and {high} {unit}, got {got}"),
            "choose a number inside these limits",
        ))
    };
    let listen = match &raw.listen {
        Some(text) => Some(text.parse::<SocketAddr>().map_err(|_| {
            Fault::new(
                "coordinator.listen",
                format!("not an IP address and port, got {text:?}"),
                "write an address such as \"127.0.0.1:7700\", or \"0.0.0.0:7700\" for every network",
            )
        })?),
        None => None,
    };
    let local_workers = match raw.local_workers {
        NumberOr::Word(_) => LocalWorkers::Auto,
        NumberOr::Number(count) => {
            LocalWorkers::Count(between("local_workers", count, 0, MAX_LOCAL_WORKERS, "workers")?)
        }
    };
    Ok(CoordinatorSettings {
        listen: overrides.listen.or(listen),
        local_workers: overrides.local_workers.unwrap_or(local_workers),
        lease: seconds(between("lease_seconds", raw.lease_seconds, 2, 3600, "seconds")?),
        job: seconds(between("job_seconds", raw.job_seconds, 1, 604_800, "seconds")?),
        max_failures: between("max_failures", raw.max_failures, 1, 100, "failures")?,
        worker_grace: seconds(between(
            "worker_grace_seconds",
            raw.worker_grace_seconds,
            0,
            604_800,
            "seconds",
        )?),
        deadline: match raw.deadline_seconds {
            NumberOr::Word(RawOff::Off) => None,
            NumberOr::Number(limit) => {
                Some(seconds(between("deadline_seconds", limit, 1, 31_536_000, "seconds")?))
            }
        },
        audit: share("coordinator.audit", raw.audit)?,
        pieces: match raw.pieces {
            NumberOr::Word(_) => ShardCount::Auto,
            NumberOr::Number(count) => {
                let count = between("pieces", count, 1, MAX_SHARDS, "pieces")?;
                NonZeroU32::new(count).map_or(ShardCount::Auto, ShardCount::Fixed)
            }
        },
    })
}

fn share(key: &str, got: f64) -> Result<f64, Fault> {
    if (0.0..=1.0).contains(&got) {
        return Ok(got + 0.0); // -0 is 0
    }
    Err(Fault::new(
        key,
        format!("not between 0 and 1, got {got}"),
        "choose a share: 0.01 is one in a hundred",
    ))
}

fn seconds(seconds: u32) -> Duration {
    Duration::from_secs(u64::from(seconds))
}
