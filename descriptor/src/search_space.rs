//! Search spaces: a family and the values that its genes may take.

use crate::bytes::{self, BytesError, Reader};
use crate::descriptor::{Descriptor, read_fixed};
use crate::disk_ring::{GeneTable, QuantiseError};
use crate::domain::Domain;
use crate::family::Family;
use crate::fixed::FixedDescriptor;
use crate::gene::{GeneError, GeneSpec};
use crate::global_hue::GlobalHue;
use crate::prepared::Preparer;

/// What a search looks through. It travels to workers: clouds are prepared once for all of its descriptors.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum SearchSpace {
    /// The paper's family.
    DiskRing(GeneTable),
    /// One descriptor without genes.
    Fixed(FixedDescriptor),
    /// Numbers of bins, each one that [`GlobalHue::new`] takes.
    GlobalHue(Domain),
}

impl SearchSpace {
    /// The space of these values, one domain for each of [`Family::genes`]; `colour`: whether clouds have colours.
    /// Genes that mean nothing without colour are then fixed or dropped, whatever values are given for them.
    ///
    /// # Errors
    /// If the family has other genes, or may not take these values.
    pub fn new(family: Family, colour: bool, domains: &[Domain]) -> Result<Self, GeneError> {
        let number = || {
            let (expected, got) = (family.genes().len(), domains.len());
            GeneError::Number { family: family.name(), expected, got }
        };
        match family {
            Family::DiskRing => {
                let domains = domains.try_into().map_err(|_| number())?;
                GeneTable::new(domains, colour).map(Self::DiskRing)
            }
            Family::PfhRgb | Family::ShotColor => Err(GeneError::NoGenes { family: family.name() }),
            Family::GlobalHue => {
                let &[bins] = domains else { return Err(number()) };
                GlobalHue::GENE.check(&bins)?;
                colour
                    .then_some(Self::GlobalHue(bins))
                    .ok_or(GeneError::NeedsColour { family: family.name() })
            }
        }
    }

    /// The space of one descriptor.
    ///
    /// # Errors
    /// If no experiment may use the descriptor.
    pub fn single(descriptor: &Descriptor) -> Result<Self, GeneError> {
        Ok(match descriptor {
            Descriptor::DiskRing(parameters) => Self::DiskRing(GeneTable::single(parameters)?),
            Descriptor::Fixed(fixed) => Self::Fixed(*fixed),
            Descriptor::GlobalHue(hue) => Self::GlobalHue(Domain::fixed(hue.bins())),
        })
    }

    /// The family of its descriptors.
    pub fn family(&self) -> Family {
        match self {
            Self::DiskRing(_) => Family::DiskRing,
            Self::Fixed(fixed) => fixed.kind.into(),
            Self::GlobalHue(_) => Family::GlobalHue,
        }
    }

    /// What prepares clouds for its descriptors.
    ///
    /// # Errors
    /// If it has more values than prepared clouds have room for.
    pub fn preparer(&self) -> Result<Preparer, QuantiseError> {
        match self {
            Self::DiskRing(table) => Preparer::quantised(table),
            Self::Fixed(_) => Ok(Preparer::oriented(self.family())),
            Self::GlobalHue(_) => Ok(Preparer::colours(self.family())),
        }
    }

    /// The genes of its chromosomes with their values, in order; those with a single value are among them.
    pub fn genes(&self) -> Vec<(&'static GeneSpec, Domain)> {
        match self {
            Self::DiskRing(table) => table.genes().map(|(spec, domain)| (spec, *domain)).collect(),
            Self::Fixed(_) => Vec::new(),
            Self::GlobalHue(bins) => vec![(&GlobalHue::GENE, *bins)],
        }
    }

    /// The descriptor whose genes have the values at these indices; `None` unless there is one index below the number
    /// of values for each field.
    pub fn decode(&self, indices: &[u32]) -> Option<Descriptor> {
        match self {
            Self::DiskRing(table) => table.at(indices).map(Descriptor::DiskRing),
            Self::Fixed(fixed) => indices.is_empty().then_some(Descriptor::Fixed(*fixed)),
            Self::GlobalHue(bins) => {
                let &[index] = indices else { return None };
                let value = (index < bins.count).then(|| bins.low + index * bins.step)?;
                GlobalHue::new(value).ok().map(Descriptor::GlobalHue)
            }
        }
    }

    /// Undoes [`SearchSpace::decode`]; `None` if the descriptor is not of this space.
    pub fn encode(&self, descriptor: &Descriptor) -> Option<Vec<u32>> {
        match (self, descriptor) {
            (Self::DiskRing(table), Descriptor::DiskRing(parameters)) => table.indices(parameters),
            (Self::Fixed(own), Descriptor::Fixed(fixed)) => (own == fixed).then(Vec::new),
            (Self::GlobalHue(bins), Descriptor::GlobalHue(hue)) => {
                bins.index_of(hue.bins()).map(|index| vec![index])
            }
            _ => None,
        }
    }

    /// Whether the descriptor is of this space.
    pub fn contains(&self, descriptor: &Descriptor) -> bool {
        self.encode(descriptor).is_some()
    }

    /// Number of different descriptors.
    pub fn size(&self) -> u128 {
        self.genes().iter().map(|(_, domain)| u128::from(domain.count)).product()
    }

    /// Its descriptor, if there is only one.
    pub fn only(&self) -> Option<Descriptor> {
        (self.size() == 1).then(|| self.decode(&vec![0; self.genes().len()]))?
    }

    /// Canonical bytes: tag of the family, version, numbers.
    pub fn to_bytes(&self) -> Vec<u8> {
        match self {
            Self::DiskRing(table) => bytes::write(self.family(), table.numbers()),
            Self::Fixed(fixed) => bytes::write(self.family(), [fixed.radius_um]),
            Self::GlobalHue(bins) => bytes::write(self.family(), [bins.low, bins.step, bins.count]),
        }
    }

    /// Undoes [`SearchSpace::to_bytes`].
    ///
    /// # Errors
    /// If the bytes are no search space.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, BytesError> {
        let reader = Reader::new("search space", bytes)?;
        match reader.family {
            Family::DiskRing => GeneTable::from_numbers(reader.numbers()?)
                .map(Self::DiskRing)
                .map_err(|what| reader.refuse(what)),
            Family::PfhRgb | Family::ShotColor => read_fixed(&reader).map(Self::Fixed),
            Family::GlobalHue => {
                let [low, step, count] = reader.numbers()?;
                Self::new(reader.family, true, &[Domain { low, step, count }])
                    .map_err(|error| reader.refuse(error.to_string()))
            }
        }
    }
}
