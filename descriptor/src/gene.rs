//! What is fixed about a gene, whatever the experiment: name, unit, limits, and the interval that is searched by default.

use crate::column::Column;
use crate::domain::Domain;

/// A gene of a family.
#[derive(Debug, PartialEq)]
pub struct GeneSpec {
    /// Its name in TOML, on the command line, in Parquet and in reports.
    pub name: &'static str,
    /// Unit of its values, empty for a pure number.
    pub unit: &'static str,
    /// What it is, in a few words.
    pub meaning: &'static str,
    /// Whether it means nothing in a descriptor without colour.
    pub needs_colour: bool,
    /// Ticks a unit: values are held as whole ticks, so that a decimal step is exact.
    pub ticks_per_unit: u32,
    /// Smallest and largest tick that any experiment may use.
    pub limits: (u32, u32),
    /// What an experiment searches unless it says otherwise, in ticks: lowest, highest, step. The paper's, where it has
    /// the gene.
    pub default: (u32, u32, u32),
}

/// A field of a search space's genome: a gene, and what a search has to know of its values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldSpec {
    /// The gene.
    pub gene: &'static GeneSpec,
    /// Number of values.
    pub values: u32,
    /// The slot that the gene is of, in families whose genes come in slots.
    pub slot: Option<u32>,
    /// Whether neighbouring values are alike.
    pub is_ordered: bool,
}

/// Most values of one gene: an index into them has 16 bits.
const MAX_VALUES: u32 = 65_536;

impl GeneSpec {
    /// A value in the gene's unit from ticks: 13 000 µm are 1.3 cm, rounded once.
    pub fn value(&self, ticks: u32) -> f64 {
        f64::from(ticks) / f64::from(self.ticks_per_unit)
    }

    /// A value with its unit, for people.
    pub fn text(&self, ticks: u32) -> String {
        let space = if self.unit.is_empty() { "" } else { " " };
        format!("{}{space}{}", self.value(ticks), self.unit)
    }

    /// Ticks from a value in the gene's unit, or `None` if it is not finite, negative, too large or between ticks.
    pub fn ticks(&self, value: f64) -> Option<u32> {
        let ticks = value * f64::from(self.ticks_per_unit);
        let rounded = ticks.round();
        let on_tick = (ticks - rounded).abs() <= 1e-6 * rounded.abs().max(1.0);
        (on_tick && rounded >= 0.0 && rounded <= f64::from(u32::MAX)).then_some(rounded as u32)
    }

    /// Its column in tables.
    pub fn column(&self) -> Column {
        let &Self { name, unit, meaning, .. } = self;
        Column { name, unit, integer: self.is_integer(), meaning }
    }

    /// Whether values are whole numbers.
    pub fn is_integer(&self) -> bool {
        self.ticks_per_unit == 1
    }

    /// The values that an experiment searches unless it says otherwise.
    pub fn default_domain(&self) -> Domain {
        let (low, high, step) = self.default;
        Domain { low, step, count: (high - low) / step + 1 }
    }

    /// Refuses values that the gene may not take.
    ///
    /// # Errors
    /// If there are none, too many, or some beyond its limits.
    pub(crate) fn check(&self, domain: &Domain) -> Result<(), GeneError> {
        if !(1..=MAX_VALUES).contains(&domain.count) {
            return Err(GeneError::Count { gene: self.name, got: domain.count });
        }
        if domain.step == 0 && domain.count > 1 {
            return Err(GeneError::Step { gene: self.name, values: domain.count });
        }
        let (low, high) = self.limits;
        let end = u64::from(domain.low) + u64::from(domain.count - 1) * u64::from(domain.step);
        if domain.low >= low && end <= u64::from(high) {
            return Ok(());
        }
        let got = if domain.low < low { domain.low } else { u32::try_from(end).unwrap_or(u32::MAX) };
        Err(GeneError::OutOfLimits {
            gene: self.name,
            low: self.value(low).to_string(),
            high: self.text(high),
            got: self.value(got).to_string(),
        })
    }
}

/// Why these values of genes are no search space.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GeneError {
    /// A value outside what the gene can mean.
    #[error("{gene}: value outside {low} to {high}, got {got}\nchoose values inside these limits")]
    OutOfLimits {
        /// Which gene.
        gene: &'static str,
        /// Its smallest value.
        low: String,
        /// Its largest value, with its unit.
        high: String,
        /// The value.
        got: String,
    },
    /// No value, or so many that indices overflow.
    #[error(
        "{gene}: number of values outside 1 to {MAX_VALUES}, got {got}\nchoose a larger step or a smaller interval"
    )]
    Count {
        /// Which gene.
        gene: &'static str,
        /// How many values it would have.
        got: u32,
    },
    /// Many times the same value.
    #[error("{gene}: step must be above 0, got 0 for {values} values\nchoose a step, or one value")]
    Step {
        /// Which gene.
        gene: &'static str,
        /// How many values it would have.
        values: u32,
    },
    /// The ring could be empty or inside out.
    #[error(
        "R2: every value must be larger than every value of R1, got R1 up to {disk} cm and R2 from {ring} cm\nraise R2's min or lower R1's max"
    )]
    RingInsideDisk {
        /// Largest R1.
        disk: f64,
        /// Smallest R2.
        ring: f64,
    },
    /// More or fewer genes than the family has.
    #[error(
        "family {family}: must have values for {expected} genes, got {got}\ngive one set of values for each"
    )]
    Number {
        /// The family.
        family: &'static str,
        /// How many genes it has.
        expected: usize,
        /// How many there are values for.
        got: usize,
    },
    /// Nothing to search.
    #[error("family {family}: has no genes to search, got it as a search space\nchoose a family with genes")]
    NoGenes {
        /// The family.
        family: &'static str,
    },
    /// A family that is nothing without colours.
    #[error("family {family}: needs colours, got none\nset colour = true, or choose disk-ring")]
    NeedsColour {
        /// The family.
        family: &'static str,
    },
}
