//! The meaning of `[descriptor]`: fixed values and intervals as exact ticks inside each gene's limits.

use descriptor::structure::{Structure, StructureError, StructureFile, StructureSpace};
use descriptor::{Domain, Family, GeneError, GeneSpec, SearchSpace, SetDistance};

use super::error::Fault;
use super::forms::{RawGene, RawInterval};
use super::raw::RawDescriptor;
use super::suggest;
use crate::text::number;

/// Checks every gene and builds the search space; a gene that is not written has its default values.
pub fn search_space(raw: &RawDescriptor) -> Result<SearchSpace, Fault> {
    let family = Family::from(raw.family);
    let mut written = raw.genes.clone();
    let written = written.by_name();
    let has = |name: &str| family.genes().iter().any(|spec| spec.name == name);
    if let Some((foreign, _)) = written.iter().find(|(name, gene)| gene.is_some() && !has(name)) {
        if family == Family::Structure {
            let what = format!("family structure has none that can be fixed, got `{foreign}`");
            return Err(Fault::new("descriptor.genes", what, "remove the section"));
        }
        let known: Vec<&str> = family.genes().iter().map(|spec| spec.name).collect();
        let what = format!("no gene of family {family}, got `{foreign}`");
        return Err(Fault::new("descriptor.genes", what, suggest::advice(foreign, &known, "its genes")));
    }
    let structure_only = [
        ("slots", raw.slots.is_some()),
        ("members", raw.members.is_some()),
        ("max_bins", raw.max_bins.is_some()),
        ("metric", raw.metric.is_some()),
        ("max_cost", raw.max_cost.is_some()),
        ("channel", !raw.channel.is_empty()),
    ];
    if let Some((key, _)) =
        structure_only.iter().find(|(_, is_written)| *is_written && family != Family::Structure)
    {
        let what = format!("only of family structure, got family {family}");
        return Err(Fault::new(
            format!("descriptor.{key}"),
            what,
            "remove it, or write `family = \"structure\"`",
        ));
    }
    if family == Family::Structure {
        return structures(raw);
    }
    let domain = |spec: &GeneSpec| {
        let gene = written.iter().find(|(name, _)| *name == spec.name).and_then(|(_, gene)| **gene);
        domain(spec, gene)
    };
    let domains = family.genes().iter().map(domain).collect::<Result<Vec<Domain>, _>>()?;
    SearchSpace::new(family, raw.colour, &domains).map_err(|error| {
        let section = match error {
            GeneError::Number { .. } | GeneError::NoGenes { .. } | GeneError::NeedsColour { .. } => {
                "descriptor."
            }
            _ => "descriptor.genes.",
        };
        Fault::from_message(section, &error.to_string())
    })
}

/// The space of structures, or the one structure that is written out.
fn structures(raw: &RawDescriptor) -> Result<SearchSpace, Fault> {
    let fault = |error: StructureError| Fault::from_message("descriptor.", &error.to_string());
    if !raw.channel.is_empty() {
        let searched = [
            ("slots", raw.slots.is_some()),
            ("members", raw.members.is_some()),
            ("max_bins", raw.max_bins.is_some()),
            ("metric", raw.metric.is_some()),
            ("max_cost", raw.max_cost.is_some()),
        ];
        if let Some((key, _)) = searched.iter().find(|(_, is_written)| *is_written) {
            return Err(Fault::new(
                format!("descriptor.{key}"),
                "no use beside channels that are written out, got both",
                "remove it, or remove the channels to search for some",
            ));
        }
        let file = StructureFile { version: 1, channels: raw.channel.clone() };
        let structure = file.structure().map_err(fault)?;
        let needs_colour = structure.channels.iter().position(|one| one.channel.needs_colour());
        if let Some(channel) = needs_colour.filter(|_| !raw.colour) {
            return Err(Fault::new(
                "descriptor.colour",
                format!("needed by channel {}, got false", channel + 1),
                "set it to true, or choose features without colour",
            ));
        }
        return Ok(SearchSpace::Structure(structure));
    }
    let default = StructureSpace::default();
    let members = raw.members.unwrap_or(default.members);
    if !(1..=Structure::MAX_CHANNELS as u32).contains(&members) {
        return Err(Fault::new(
            "descriptor.members",
            format!("must be 1 to {}, got {members}", Structure::MAX_CHANNELS),
            "choose how many evolve side by side",
        ));
    }
    let space = StructureSpace {
        colour: raw.colour,
        slots: raw.slots.unwrap_or(StructureSpace::default_slots(members)),
        members,
        max_bins: raw.max_bins.unwrap_or(default.max_bins),
        metric: raw.metric.map_or(default.metric, SetDistance::from),
    };
    space.check().map_err(fault)?;
    Ok(SearchSpace::Structures(space))
}

/// The largest counted cost, which the cheapest descriptor of the space must not exceed.
pub fn max_cost(raw: &RawDescriptor, space: &SearchSpace) -> Result<Option<u64>, Fault> {
    match raw.max_cost {
        Some(got) if got < space.least_cost() => {
            let what = format!("not at least {}, what the cheapest costs, got {got}", space.least_cost());
            Err(Fault::new("descriptor.max_cost", what, "raise it, or remove it"))
        }
        max_cost => Ok(max_cost),
    }
}

fn domain(spec: &GeneSpec, gene: Option<RawGene>) -> Result<Domain, Fault> {
    let key = format!("descriptor.genes.{}", spec.name);
    let (low, high, step) = spec.default;
    let interval = match gene {
        Some(RawGene::Fixed(value)) => return value_ticks(spec, &key, value).map(Domain::fixed),
        Some(RawGene::Interval(interval)) => interval,
        None => RawInterval::default(),
    };
    let low = interval.min.map_or(Ok(low), |value| value_ticks(spec, &format!("{key}.min"), value))?;
    let high = interval.max.map_or(Ok(high), |value| value_ticks(spec, &format!("{key}.max"), value))?;
    let (step, given) = match interval.step {
        Some(value) => (grid_ticks(spec, &format!("{key}.step"), value)?, value),
        None => (step, spec.value(step)),
    };
    let text = |ticks| spec.value(ticks).to_string();
    if step == 0 {
        return Err(Fault::new(
            format!("{key}.step"),
            format!("not at least {}, got {}", text(1), number(given)),
            format!("write a step such as {}, or a fixed value `{} = …`", text(spec.default.2), spec.name),
        ));
    }
    if low > high {
        return Err(Fault::new(
            key,
            format!("min above max, got min = {}, max = {}", text(low), text(high)),
            "write min below max; what is not written has its default",
        ));
    }
    let rest = (high - low) % step;
    if rest != 0 {
        let below = high - rest;
        let above = below.checked_add(step).filter(|above| *above <= spec.limits.1);
        // A fixed value is written without an interval, so min itself is no useful maximum.
        let nearest = match above {
            Some(above) if below == low || step - rest < rest => above,
            _ => below,
        };
        return Err(Fault::new(
            format!("{key}.max"),
            format!(
                "not min plus a whole number of steps, got min = {}, max = {}, step = {}",
                text(low),
                text(high),
                text(step)
            ),
            format!("the nearest max is {}", text(nearest)),
        ));
    }
    // One value is one value, whatever the step was.
    let count = (high - low) / step + 1;
    Ok(if count == 1 { Domain::fixed(low) } else { Domain { low, step, count } })
}

/// A value of a gene in ticks, inside the gene's limits.
fn value_ticks(spec: &GeneSpec, place: &str, value: f64) -> Result<u32, Fault> {
    let (low, high) = spec.limits;
    let ticks = grid_ticks(spec, place, value)?;
    if !(low..=high).contains(&ticks) {
        return Err(outside(spec, place, value));
    }
    Ok(ticks)
}

/// A value or step of a gene in ticks.
fn grid_ticks(spec: &GeneSpec, place: &str, value: f64) -> Result<u32, Fault> {
    spec.ticks(value).ok_or_else(|| {
        if !(0.0..=spec.value(spec.limits.1)).contains(&value) {
            return outside(spec, place, value);
        }
        let unit = if spec.unit.is_empty() { String::new() } else { format!(" {}", spec.unit) };
        Fault::new(
            place,
            if spec.is_integer() {
                format!("not a whole number, got {}", number(value))
            } else {
                format!("not a multiple of {}{unit}, got {}", spec.value(1), number(value))
            },
            "round it",
        )
    })
}

fn outside(spec: &GeneSpec, place: &str, value: f64) -> Fault {
    let [low, high] = [spec.limits.0, spec.limits.1].map(|ticks| spec.value(ticks));
    let unit = if spec.unit.is_empty() { String::new() } else { format!(" {}", spec.unit) };
    Fault::new(
        place,
        format!("not between {low} and {high}{unit}, got {}", number(value)),
        format!("choose the {} inside these limits", spec.meaning),
    )
}
