//! The meaning of `[descriptor]`: fixed values and intervals as exact ticks inside each gene's limits.

use descriptor::genes::Domain;
use descriptor::{GENES, GeneKind, GeneSpec, GeneTable};

use super::error::Fault;
use super::forms::{RawGene, RawInterval};
use super::raw::RawDescriptor;

/// Checks every gene and builds the search space; a gene that is not written is the paper's.
pub(super) fn genes(raw: &RawDescriptor) -> Result<GeneTable, Fault> {
    let written = &raw.genes;
    let mut domains = [Domain::fixed(0); 5];
    for (domain, spec) in domains.iter_mut().zip(&GENES) {
        let gene = match spec.kind {
            GeneKind::ShapeBins => written.shape_bins,
            GeneKind::ColourBins => written.m,
            GeneKind::DiskRadius => written.disk,
            GeneKind::RingRadius => written.ring,
            GeneKind::ShapeWeight => written.w,
        };
        *domain = self::domain(spec, gene)?;
        if spec.kind == GeneKind::ColourBins && !raw.colour {
            // Checked and dropped: experiments that differ in it only are equal.
            *domain = Domain::fixed(0);
        }
    }
    GeneTable::new(domains, raw.colour)
        .map_err(|error| Fault::from_message("descriptor.genes.", &error.to_string()))
}

fn domain(spec: &GeneSpec, gene: Option<RawGene>) -> Result<Domain, Fault> {
    let key = format!("descriptor.genes.{}", spec.name);
    let (low, high, step) = spec.paper;
    let interval = match gene {
        Some(RawGene::Fixed(value)) => return value_ticks(spec, &key, value).map(Domain::fixed),
        Some(RawGene::Interval(interval)) => interval,
        None => RawInterval::default(),
    };
    let low = interval.min.map_or(Ok(low), |value| value_ticks(spec, &format!("{key}.min"), value))?;
    let high = interval.max.map_or(Ok(high), |value| value_ticks(spec, &format!("{key}.max"), value))?;
    let step = interval.step.map_or(Ok(step), |value| grid_ticks(spec, &format!("{key}.step"), value))?;
    let text = |ticks| spec.value(ticks).to_string();
    if step == 0 {
        return Err(Fault::new(
            format!("{key}.step"),
            "not above 0, got 0",
            format!("write a step such as {}, or a fixed value `{} = …`", text(spec.paper.2), spec.name),
        ));
    }
    if low > high {
        return Err(Fault::new(
            key,
            format!("min above max, got min = {}, max = {}", text(low), text(high)),
            "write min below max; what is not written is the paper's",
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
                format!("not a whole number, got {value}")
            } else {
                format!("not a multiple of {}{unit}, got {value}", spec.value(1))
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
        format!("not between {low} and {high}{unit}, got {value}"),
        format!("choose the {} inside these limits", spec.meaning),
    )
}
