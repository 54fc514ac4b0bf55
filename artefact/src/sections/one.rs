//! One descriptor and the settings before it, in the keys of an experiment.

use std::path::Path;

use descriptor::structure::{Structure, StructureFile};
use descriptor::{Descriptor, GeneError, Preprocess, SearchSpace, Unit};

use super::error::{ConfigError, Fault};
use super::forms::RawGene;
use super::genes::search_space;
use super::preprocess::preprocess;
use super::raw::{RawDescriptor, RawFamily, RawGenes, RawPreprocess};

/// Sections `[preprocess]` and `[descriptor]` that mean this.
///
/// # Errors
/// If no experiment can ask for the descriptor.
pub fn of_one(
    preprocess: &Preprocess,
    descriptor: &Descriptor,
) -> Result<(RawPreprocess, RawDescriptor), GeneError> {
    let family = descriptor.family();
    let family = RawFamily::of(family).ok_or(GeneError::NoGenes { family: family.name() })?;
    let mut genes = RawGenes::default();
    for (spec, domain) in SearchSpace::single(descriptor)?.genes() {
        let place = genes.by_name().into_iter().find(|(name, _)| *name == spec.name);
        if let Some((_, gene)) = place {
            *gene = Some(RawGene::Fixed(spec.value(domain.low)));
        }
    }
    let Preprocess { leaf_um, normal_radius_um, min_points, colour, unit: _ } = *preprocess;
    let raw = RawPreprocess {
        leaf_cm: (family != RawFamily::Structure).then_some(f64::from(leaf_um) / 1e4),
        normal_radius_cm: f64::from(normal_radius_um) / 1e4,
        min_points,
    };
    let channel = match descriptor {
        Descriptor::Structure(structure) => StructureFile::from(structure).channels,
        _ => Vec::new(),
    };
    Ok((raw, RawDescriptor { family, colour, genes, channel, ..RawDescriptor::default() }))
}

/// What these sections of `file` mean, if every gene has one value.
pub fn one(
    raw: &RawPreprocess,
    unit: Unit,
    descriptor: &RawDescriptor,
    file: &Path,
) -> Result<(Preprocess, Descriptor), ConfigError> {
    resolve(raw, unit, descriptor).map_err(|fault| fault.in_file(file))
}

fn resolve(
    raw: &RawPreprocess,
    unit: Unit,
    descriptor: &RawDescriptor,
) -> Result<(Preprocess, Descriptor), Fault> {
    let preprocess = preprocess(raw, unit, descriptor)?;
    let space = search_space(descriptor)?;
    if let SearchSpace::Structures(_) = space {
        let what = format!("there must be 1 to {}, got 0", Structure::MAX_CHANNELS);
        return Err(Fault::new("descriptor.channel", what, "write one [[descriptor.channel]] for each"));
    }
    let genes = space.genes();
    let many = genes.iter().find(|(_, domain)| domain.count != 1);
    match (many, space.only()) {
        (None, Some(only)) => Ok((preprocess, only)),
        (many, _) => {
            let (name, got) = many.map_or(("", 0), |(spec, domain)| (spec.name, domain.count));
            Err(Fault::new(
                format!("descriptor.genes.{name}"),
                format!("must have one value, got {got}"),
                format!("write a number: {name} = …"),
            ))
        }
    }
}
