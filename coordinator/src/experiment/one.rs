//! One descriptor and the settings before it, in the keys of an experiment.

use std::path::Path;

use descriptor::{GENES, GeneKind, Parameters, Preprocess, Unit};

use super::ExperimentError;
use super::error::Fault;
use super::forms::RawGene;
use super::raw::{RawDescriptor, RawGenes, RawPreprocess, RawUnit};
use super::{validate, validate_genes};

/// Sections `[preprocess]` and `[descriptor]` that mean this.
pub(crate) fn of_one(preprocess: &Preprocess, parameters: &Parameters) -> (RawPreprocess, RawDescriptor) {
    let gene = |kind| Some(RawGene::Fixed(parameters.value(kind)));
    let genes = RawGenes {
        shape_bins: gene(GeneKind::ShapeBins),
        m: gene(GeneKind::ColourBins).filter(|_| parameters.has_colour()),
        disk: gene(GeneKind::DiskRadius),
        ring: gene(GeneKind::RingRadius),
        w: gene(GeneKind::ShapeWeight),
    };
    let Preprocess { leaf_um, normal_radius_um, min_points, colour, unit: _ } = *preprocess;
    let raw = RawPreprocess {
        leaf_cm: f64::from(leaf_um) / 1e4,
        normal_radius_cm: f64::from(normal_radius_um) / 1e4,
        min_points,
    };
    (raw, RawDescriptor { colour, genes })
}

/// What these sections of `file` mean, if every gene has one value.
pub(crate) fn one(
    raw: &RawPreprocess,
    unit: Unit,
    descriptor: &RawDescriptor,
    file: &Path,
) -> Result<(Preprocess, Parameters), ExperimentError> {
    resolve(raw, unit, descriptor).map_err(|fault| fault.in_file(file))
}

fn resolve(
    raw: &RawPreprocess,
    unit: Unit,
    descriptor: &RawDescriptor,
) -> Result<(Preprocess, Parameters), Fault> {
    let unit = match unit {
        Unit::Metre => RawUnit::M,
        Unit::Millimetre => RawUnit::Mm,
    };
    let preprocess = validate::preprocess(raw, unit, descriptor.colour)?;
    let table = validate_genes::genes(descriptor)?;
    let mut ticks = [0; GENES.len()];
    for (spec, domain) in table.genes() {
        if domain.count != 1 {
            return Err(Fault::new(
                format!("descriptor.genes.{}", spec.name),
                format!("must have one value, got {}", domain.count),
                format!("write a number: {} = …", spec.name),
            ));
        }
        ticks[spec.kind as usize] = domain.low;
    }
    Ok((preprocess, Parameters::from_ticks(ticks)))
}
