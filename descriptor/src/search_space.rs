//! Search spaces: a family and the values that its genes may take.

use crate::bytes::{self, BytesError, Reader};
use crate::column::Column;
use crate::descriptor::{Descriptor, read_fixed};
use crate::disk_ring::{GeneTable, QuantiseError};
use crate::domain::Domain;
use crate::family::Family;
use crate::fixed::FixedDescriptor;
use crate::gene::{FieldSpec, GeneError, GeneSpec};
use crate::global_hue::GlobalHue;
use crate::prepared::Preparer;
use crate::structure::{Structure, StructureSpace};

/// What a search looks through. It travels to workers: clouds are prepared once for all of its descriptors.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum SearchSpace {
    /// The paper's family.
    DiskRing(GeneTable),
    /// One descriptor without genes.
    Fixed(FixedDescriptor),
    /// Numbers of bins, each one that [`GlobalHue::new`] takes.
    GlobalHue(Domain),
    /// Structures of a few channels.
    Structures(StructureSpace),
    /// One structure, which may be in no space that is searched.
    Structure(Structure),
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
            // Structures have a space of their own, which no domains describe.
            Family::PfhRgb | Family::ShotColor | Family::Structure => {
                Err(GeneError::NoGenes { family: family.name() })
            }
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
            Descriptor::Structure(structure) => Self::Structure(structure.clone()),
            Descriptor::GlobalHue(hue) => Self::GlobalHue(Domain::fixed(hue.bins())),
        })
    }

    /// The family of its descriptors.
    pub fn family(&self) -> Family {
        match self {
            Self::DiskRing(_) => Family::DiskRing,
            Self::Fixed(fixed) => fixed.kind.into(),
            Self::GlobalHue(_) => Family::GlobalHue,
            Self::Structures(_) | Self::Structure(_) => Family::Structure,
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
            Self::Structures(_) | Self::Structure(_) => Ok(Preparer::structure(self.family())),
        }
    }

    /// The genes of its chromosomes with their values, in order; those with a single value are among them. Of structures
    /// the values are codes, from 0, not ticks.
    pub fn genes(&self) -> Vec<(&'static GeneSpec, Domain)> {
        match self {
            Self::DiskRing(table) => table.genes().map(|(spec, domain)| (spec, *domain)).collect(),
            Self::Fixed(_) => Vec::new(),
            Self::GlobalHue(bins) => vec![(&GlobalHue::GENE, *bins)],
            Self::Structures(space) => {
                let codes = |field: FieldSpec| (field.gene, Domain { low: 0, step: 1, count: field.values });
                space.fields().into_iter().map(codes).collect()
            }
            Self::Structure(_) => Vec::new(),
        }
    }

    /// The columns that its descriptors have in tables. Those of structures go by the slots of the space.
    pub fn columns(&self) -> Vec<Column> {
        let mut columns = self.family().columns();
        if let Self::Structures(_) | Self::Structure(_) = self {
            columns.truncate(Structure::columns_of_slots(self.slots()));
        }
        columns
    }

    /// What a descriptor has in these columns; nothing in any of them if they cannot hold it.
    pub fn values(&self, descriptor: &Descriptor) -> Vec<Option<f64>> {
        match descriptor {
            Descriptor::Structure(structure) => structure.values_of_slots(self.slots()),
            other => other.values(),
        }
    }

    /// Slots of a genome of structures, whose number tables have columns for; none of one structure alone, which are as they
    /// always were.
    fn slots(&self) -> usize {
        if let Self::Structures(space) = self { space.slots as usize } else { 0 }
    }

    /// The fields of its genome, a gene each, in chromosome order.
    pub fn fields(&self) -> Vec<FieldSpec> {
        if let Self::Structures(space) = self {
            return space.fields();
        }
        let field = |(gene, domain): (_, Domain)| FieldSpec {
            gene,
            values: domain.count,
            slot: None,
            is_ordered: true,
        };
        self.genes().into_iter().map(field).collect()
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
            Self::Structures(space) => space.decode(indices).map(Descriptor::Structure),
            Self::Structure(structure) => {
                indices.is_empty().then(|| Descriptor::Structure(structure.clone()))
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
            (Self::Structures(space), Descriptor::Structure(structure)) => space.encode(structure),
            (Self::Structure(own), Descriptor::Structure(structure)) => (own == structure).then(Vec::new),
            _ => None,
        }
    }

    /// Whether the descriptor is of this space, or has one of its channels alone.
    pub fn contains(&self, descriptor: &Descriptor) -> bool {
        let has_channel = || match (self, descriptor) {
            (Self::Structures(space), Descriptor::Structure(structure)) => space.has_channel(structure),
            (Self::Structure(own), Descriptor::Structure(structure)) => own.has_channel(structure),
            _ => false,
        };
        self.encode(descriptor).is_some() || has_channel()
    }

    /// The descriptor that has these values in the columns of its family; `None` if there is none. It need not be of
    /// this space, but what no column says is as here.
    pub fn from_values(&self, values: &[Option<f64>]) -> Option<Descriptor> {
        match self {
            Self::Structures(space) => {
                Structure::from_values(values, space.metric).map(Descriptor::Structure)
            }
            // Its values may say less than the structure, but there is no other.
            Self::Structure(structure) => {
                let own = Descriptor::Structure(structure.clone());
                (self.values(&own) == values).then_some(own)
            }
            _ => Descriptor::from_values(self.family(), values),
        }
    }

    /// Number of chromosomes that mean different genes; `None` if 128 bits do not hold it.
    pub fn size(&self) -> Option<u128> {
        let mut counts = self.genes().into_iter().map(|(_, domain)| u128::from(domain.count));
        counts.try_fold(1, u128::checked_mul)
    }

    /// Its descriptor, if there is only one.
    pub fn only(&self) -> Option<Descriptor> {
        (self.size() == Some(1)).then(|| self.decode(&vec![0; self.genes().len()]))?
    }

    /// What a descriptor of the space costs at least where costs are limited: [`StructureSpace::least_cost`], and 0 of other
    /// families.
    pub fn least_cost(&self) -> u64 {
        match self {
            Self::Structures(space) => space.least_cost(),
            Self::Structure(structure) => Descriptor::Structure(structure.clone()).recognition_cost(),
            Self::DiskRing(_) | Self::Fixed(_) | Self::GlobalHue(_) => 0,
        }
    }

    /// Canonical bytes: tag of the family, version, numbers.
    pub fn to_bytes(&self) -> Vec<u8> {
        match self {
            Self::DiskRing(table) => bytes::write(self.family(), table.numbers()),
            Self::Fixed(fixed) => bytes::write(self.family(), [fixed.radius_um]),
            Self::GlobalHue(bins) => bytes::write(self.family(), [bins.low, bins.step, bins.count]),
            Self::Structures(space) => bytes::write(self.family(), [0].into_iter().chain(space.numbers())),
            Self::Structure(structure) => {
                bytes::write(self.family(), [1].into_iter().chain(structure.numbers()))
            }
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
            Family::Structure => {
                let numbers = reader.all_numbers()?;
                let read = match numbers.split_first() {
                    Some((0, space)) => StructureSpace::from_numbers(space).map(Self::Structures),
                    Some((1, structure)) => Structure::from_numbers(structure).map(Self::Structure),
                    _ => return Err(reader.refuse("neither a space nor a structure")),
                };
                read.map_err(|error| reader.refuse(error.to_string()))
            }
        }
    }
}
