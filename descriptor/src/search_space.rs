//! Search spaces: a family and the values that its genes may take.

use crate::bytes::{self, BytesError, Reader};
use crate::column::Column;
use crate::descriptor::{Descriptor, read_fixed};
use crate::disk_ring::genes::GeneError;
use crate::disk_ring::{GENES, GeneSpec, GeneTable, Parameters, QuantiseError};
use crate::domain::Domain;
use crate::family::Family;
use crate::fixed::FixedDescriptor;
use crate::global_hue::GlobalHue;
use crate::prepared::Preparer;

/// What a search looks through. It travels to workers: clouds are prepared once for all of its descriptors.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum SearchSpace {
    /// The paper's family.
    DiskRing(GeneTable),
    /// One descriptor without genes.
    Fixed(FixedDescriptor),
    /// Numbers of bins, as [`GlobalHue::space`] allows them.
    GlobalHue(Domain),
}

/// One gene of a genome.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Its name in TOML and tables.
    pub name: &'static str,
    /// How many values it has.
    pub values: u32,
}

impl SearchSpace {
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

    /// The genes of a genome, in order; those with a single value are among them.
    pub fn fields(&self) -> Vec<Field> {
        match self {
            Self::DiskRing(table) => {
                let field =
                    |(spec, domain): (&GeneSpec, &Domain)| Field { name: spec.name, values: domain.count };
                table.genes().map(field).collect()
            }
            Self::Fixed(_) => Vec::new(),
            Self::GlobalHue(bins) => vec![Field { name: GlobalHue::COLUMN.name, values: bins.count }],
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
        self.fields().iter().map(|field| u128::from(field.values)).product()
    }

    /// The columns that genes have in tables. There may be more than fields: a gene that an experiment does not use has
    /// a column of nulls.
    pub fn columns(&self) -> Vec<Column> {
        match self {
            Self::DiskRing(_) => GENES.iter().map(GeneSpec::column).collect(),
            Self::Fixed(_) => vec![FixedDescriptor::COLUMN],
            Self::GlobalHue(_) => vec![GlobalHue::COLUMN],
        }
    }

    /// The descriptor with these values in its columns, of this space or not; `None` if there is none.
    pub fn of_values(&self, values: &[Option<f64>]) -> Option<Descriptor> {
        match self {
            Self::DiskRing(_) => Parameters::from_values(values).map(Descriptor::DiskRing),
            Self::Fixed(fixed) => {
                let &[Some(radius)] = values else { return None };
                FixedDescriptor::from_value(fixed.kind, radius).map(Descriptor::Fixed)
            }
            Self::GlobalHue(_) => {
                let &[Some(bins)] = values else { return None };
                let is_whole = bins.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&bins);
                is_whole.then(|| GlobalHue::new(bins as u32).ok())?.map(Descriptor::GlobalHue)
            }
        }
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
                let bins = GlobalHue::space(Domain { low, step, count });
                bins.map(Self::GlobalHue).map_err(|what| reader.refuse(what))
            }
        }
    }
}
