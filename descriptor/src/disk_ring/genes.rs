//! The table of genes: names, units, bounds and the mapping between value indices and values.
//!
//! Everything that speaks of genes reads this table: validation, decoding, Parquet columns and reports.

use std::fmt;

use crate::domain::Domain;
use crate::gene::{GeneError, GeneSpec};

/// What a gene sets (paper, section 3: the five evolved parameters).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum GeneKind {
    /// Bins of one shape histogram over 360 degrees.
    ShapeBins,
    /// Bins a side of one hue × saturation histogram.
    ColourBins,
    /// Radius of the disk.
    DiskRadius,
    /// Outer radius of the ring.
    RingRadius,
    /// Weight of shape against colour in the set distance.
    ShapeWeight,
}

impl GeneKind {
    /// All of them, in chromosome order.
    pub const ALL: [Self; GENES.len()] =
        [Self::ShapeBins, Self::ColourBins, Self::DiskRadius, Self::RingRadius, Self::ShapeWeight];

    /// What is fixed about the gene.
    pub fn spec(self) -> &'static GeneSpec {
        &GENES[self as usize]
    }
}

/// The genes in chromosome order (DESIGN 5.8; paper, table of parameters).
pub static GENES: [GeneSpec; 5] = [
    GeneSpec {
        name: "shape_bins",
        unit: "",
        meaning: "bins of a shape histogram over 360 degrees",
        needs_colour: false,
        ticks_per_unit: 1,
        limits: (2, 512),
        default: (8, 64, 1),
    },
    GeneSpec {
        name: "m",
        unit: "",
        meaning: "bins a side of a hue x saturation histogram",
        needs_colour: true,
        ticks_per_unit: 1,
        limits: (1, 32),
        default: (3, 8, 1),
    },
    GeneSpec {
        name: "R1",
        unit: "cm",
        meaning: "radius of the disk",
        needs_colour: false,
        ticks_per_unit: 10_000,
        limits: (1, 1_000_000),
        default: (5_000, 20_000, 1_000),
    },
    GeneSpec {
        name: "R2",
        unit: "cm",
        meaning: "outer radius of the ring",
        needs_colour: false,
        ticks_per_unit: 10_000,
        limits: (1, 1_000_000),
        default: (21_000, 50_000, 1_000),
    },
    GeneSpec {
        name: "w",
        unit: "",
        meaning: "weight of shape against colour",
        needs_colour: true,
        ticks_per_unit: 1_000_000,
        limits: (0, 1_000_000),
        default: (0, 1_000_000, 10_000),
    },
];

/// The search space of one experiment: a domain for every gene.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct GeneTable {
    domains: [Domain; 5],
    colour: bool,
}

impl GeneTable {
    /// Checks the domains, given in the order of [`GENES`]. Without colour, m is dropped and w is fixed at 1.
    ///
    /// # Errors
    /// If a domain leaves its gene's limits, or a ring could lie inside its disk.
    pub fn new(mut domains: [Domain; 5], colour: bool) -> Result<Self, GeneError> {
        if !colour {
            domains[GeneKind::ColourBins as usize] = Domain::fixed(0);
            domains[GeneKind::ShapeWeight as usize] = Domain::fixed(GeneKind::ShapeWeight.spec().limits.1);
        }
        let table = Self { domains, colour };
        table.genes().try_for_each(|(spec, domain)| spec.check(domain))?;
        let [disk, ring] =
            [domains[GeneKind::DiskRadius as usize].high(), domains[GeneKind::RingRadius as usize].low];
        if disk < ring {
            return Ok(table);
        }
        let centimetres = |um| GeneKind::DiskRadius.spec().value(um);
        Err(GeneError::RingInsideDisk { disk: centimetres(disk), ring: centimetres(ring) })
    }

    /// The paper's search space: 57 · 6 · 16 · 30 · 101 descriptors.
    pub fn paper() -> Self {
        Self { domains: GENES.each_ref().map(GeneSpec::default_domain), colour: true }
    }

    /// The one-point space of one descriptor.
    ///
    /// # Errors
    /// If no experiment may use the descriptor.
    pub fn single(parameters: &Parameters) -> Result<Self, GeneError> {
        Self::new(parameters.all_ticks().map(Domain::fixed), parameters.has_colour())
    }

    /// Whether descriptors of this table have colour.
    pub fn has_colour(&self) -> bool {
        self.colour
    }

    /// The gene's domain; `None` for m without colour.
    pub fn domain(&self, kind: GeneKind) -> Option<&Domain> {
        (self.colour || kind != GeneKind::ColourBins).then(|| &self.domains[kind as usize])
    }

    /// The genes of the chromosome in order, with their domains. Fixed genes are in it with 0 bits.
    pub fn genes(&self) -> impl Iterator<Item = (&'static GeneSpec, &Domain)> {
        self.kinds().map(|kind| (kind.spec(), &self.domains[kind as usize]))
    }

    /// Number of different descriptors.
    pub fn size(&self) -> u128 {
        self.genes().map(|(_, domain)| u128::from(domain.count)).product()
    }

    /// Whether a chromosome of this table can stand for the descriptor.
    pub fn contains(&self, parameters: &Parameters) -> bool {
        self.indices(parameters).is_some()
    }

    /// The genes of the chromosome in order, by what they set.
    pub fn kinds(&self) -> impl Iterator<Item = GeneKind> + use<> {
        let colour = self.colour;
        GeneKind::ALL.into_iter().filter(move |kind| colour || *kind != GeneKind::ColourBins)
    }

    /// For each gene which of its values the descriptor has; `None` if it is not of this table.
    pub fn indices(&self, parameters: &Parameters) -> Option<Vec<u32>> {
        let index = |kind: GeneKind| self.domains[kind as usize].index_of(parameters.ticks(kind));
        (parameters.has_colour() == self.colour).then(|| self.kinds().map(index).collect())?
    }

    /// The descriptor whose genes have the values at these indices; `None` unless there is one for each gene.
    pub fn at(&self, indices: &[u32]) -> Option<Parameters> {
        let mut ticks = [0; GENES.len()];
        let mut rest = indices.iter();
        for kind in self.kinds() {
            let domain = &self.domains[kind as usize];
            let index = *rest.next().filter(|index| **index < domain.count)?;
            ticks[kind as usize] = domain.low + index * domain.step;
        }
        rest.next().is_none().then(|| Parameters::from_ticks(ticks))
    }

    /// Whether genes have colour (0 or 1), then lowest value, step and number of values of each: the canonical numbers.
    pub(crate) fn numbers(&self) -> impl Iterator<Item = u32> {
        let of_domain = |domain: &Domain| [domain.low, domain.step, domain.count];
        std::iter::once(u32::from(self.colour)).chain(self.domains.iter().flat_map(of_domain))
    }

    /// Undoes [`GeneTable::numbers`]; `Err` says what is wrong.
    pub(crate) fn from_numbers(numbers: [u32; 1 + 3 * GENES.len()]) -> Result<Self, String> {
        let [colour @ (0 | 1), domains @ ..] = numbers else {
            return Err(format!("colour: must be 0 or 1, got {}", numbers[0]));
        };
        let mut given =
            domains.as_chunks::<3>().0.iter().map(|&[low, step, count]| Domain { low, step, count });
        let domains = [(); GENES.len()].map(|()| given.next().unwrap_or(Domain::fixed(0)));
        let table = Self::new(domains, colour == 1).map_err(|error| error.to_string())?;
        // Without colour m and w are fixed: what was written says so, too.
        if table.domains == domains {
            Ok(table)
        } else {
            Err("m, w: must be 0 and 1 without colour, got others".to_owned())
        }
    }
}

/// The five parameters of one descriptor, in exact units: equal descriptors are equal values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Parameters {
    /// Bins of one shape histogram over 360 degrees.
    pub shape_bins: u32,
    /// Bins a side of one colour histogram (m); 0 for a descriptor without colour.
    pub colour_bins: u32,
    /// Radius of the disk (R1), micrometres.
    pub disk_um: u32,
    /// Outer radius of the ring (R2), micrometres.
    pub ring_um: u32,
    /// Weight of shape (w), millionths.
    pub shape_weight_ppm: u32,
}

impl Parameters {
    /// The best chromosome that the paper reports (table 1): 60, 8, 1.3 cm, 3.6 cm, 0.67.
    pub const PAPER_BEST: Self =
        Self { shape_bins: 60, colour_bins: 8, disk_um: 13_000, ring_um: 36_000, shape_weight_ppm: 670_000 };

    /// From ticks in the order of [`GENES`].
    pub fn from_ticks(ticks: [u32; 5]) -> Self {
        let [shape_bins, colour_bins, disk_um, ring_um, shape_weight_ppm] = ticks;
        Self { shape_bins, colour_bins, disk_um, ring_um, shape_weight_ppm }
    }

    /// From the values of all genes in their units; `None` if one lies on none of its gene's ticks.
    pub fn from_values(values: &[Option<f64>]) -> Option<Self> {
        let mut ticks = [0; GENES.len()];
        for ((spec, value), ticks) in GENES.iter().zip(values).zip(&mut ticks) {
            *ticks = value.map_or(Some(0), |value| spec.ticks(value))?;
        }
        (values.len() == GENES.len()).then(|| Self::from_ticks(ticks))
    }

    /// One parameter in ticks.
    pub fn ticks(&self, kind: GeneKind) -> u32 {
        match kind {
            GeneKind::ShapeBins => self.shape_bins,
            GeneKind::ColourBins => self.colour_bins,
            GeneKind::DiskRadius => self.disk_um,
            GeneKind::RingRadius => self.ring_um,
            GeneKind::ShapeWeight => self.shape_weight_ppm,
        }
    }

    /// All parameters in ticks, in the order of [`GENES`].
    pub fn all_ticks(&self) -> [u32; GENES.len()] {
        GeneKind::ALL.map(|kind| self.ticks(kind))
    }

    /// One parameter in its gene's unit (centimetres for radii).
    pub fn value(&self, kind: GeneKind) -> f64 {
        kind.spec().value(self.ticks(kind))
    }

    /// Whether the descriptor has colour.
    pub fn has_colour(&self) -> bool {
        self.colour_bins > 0
    }

    /// Refuses what no experiment may use.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn check(&self) -> Result<(), String> {
        let table = GeneTable::single(self).map_err(|error| error.to_string())?;
        let is_itself = table.contains(self);
        if is_itself { Ok(()) } else { Err("w: must be 1 without colour, got another".to_owned()) }
    }

    /// Radius of the disk, metres.
    pub fn disk_radius(&self) -> f64 {
        f64::from(self.disk_um) / 1e6
    }

    /// Outer radius of the ring, metres.
    pub fn ring_radius(&self) -> f64 {
        f64::from(self.ring_um) / 1e6
    }

    /// Weight of the shape distance, 0 to 1.
    pub fn shape_weight(&self) -> f64 {
        f64::from(self.shape_weight_ppm) / 1e6
    }

    /// Values of a centroid in shape and in colour: bins of two regions, without those of shape beyond 180 degrees.
    pub(crate) fn channel_bins(&self) -> [u64; 2] {
        let reachable = u64::from(self.shape_bins).saturating_sub(1) / 2 + 1;
        let m = u64::from(self.colour_bins);
        [2 * reachable, m.saturating_mul(m).saturating_mul(2)]
    }

    /// Values of one keypoint's descriptor: 2·shape_bins + 2m².
    pub fn size(&self) -> usize {
        2 * self.shape_bins as usize + 2 * (self.colour_bins * self.colour_bins) as usize
    }
}

impl fmt::Display for Parameters {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut separator = "";
        for kind in
            GeneKind::ALL.into_iter().filter(|kind| self.has_colour() || *kind != GeneKind::ColourBins)
        {
            let spec = kind.spec();
            write!(f, "{separator}{}={}", spec.name, spec.text(self.ticks(kind)))?;
            separator = " ";
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {

    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_papers_space_has_the_published_size() {
        assert_eq!(GeneTable::paper().size(), 57 * 6 * 16 * 30 * 101);
    }

    #[test]
    fn the_indices_of_each_gene_are_its_grid_values_in_order_and_nothing_else() {
        let table = GeneTable::paper();
        let domains: Vec<_> = table.genes().collect();
        for (gene, (spec, domain)) in domains.iter().enumerate() {
            let mut indices = [0; GENES.len()];
            for (index, ticks) in (0..).zip(domain.values()) {
                indices[gene] = index;
                let parameters = table.at(&indices).unwrap();
                assert_eq!(parameters.ticks(GeneKind::ALL[gene]), ticks);
                assert_eq!(spec, &GeneKind::ALL[gene].spec());
                assert_eq!(table.indices(&parameters).unwrap(), indices);
            }
            indices[gene] = domain.count;
            assert_eq!(table.at(&indices), None);
        }
        assert_eq!(table.at(&[0; 4]), None);
        assert_eq!(table.at(&[0; 6]), None);
    }

    #[test]
    fn decimal_values_are_the_nearest_doubles() {
        assert_eq!(Parameters::PAPER_BEST.value(GeneKind::DiskRadius), 1.3);
        assert_eq!(Parameters::PAPER_BEST.disk_radius(), 0.013);
        assert_eq!(Parameters::PAPER_BEST.shape_weight(), 0.67);
        assert_eq!(Parameters::PAPER_BEST.size(), 248);
        assert_eq!(GENES[2].ticks(1.3), Some(13_000));
        assert_eq!(GENES[2].ticks(1.300_05), None);
        assert_eq!(GENES[0].ticks(-1.0), None);
        assert_eq!(GENES[0].ticks(f64::NAN), None);
    }

    #[test]
    fn a_ring_that_could_lie_inside_the_disk_is_refused() {
        let mut domains = GENES.each_ref().map(|spec| Domain::fixed(spec.default.0));
        domains[2] = Domain { low: 5_000, step: 1_000, count: 17 }; // up to 2.1 cm
        let error = GeneTable::new(domains, true).unwrap_err();
        assert_eq!(error, GeneError::RingInsideDisk { disk: 2.1, ring: 2.1 });
    }

    #[test]
    fn without_colour_m_is_dropped_and_w_is_one() {
        let paper = GeneTable::paper();
        let table = GeneTable::new(paper.domains, false).unwrap();
        let parameters = table.at(&[56, 15, 29, 0]).unwrap();
        assert_eq!((parameters.colour_bins, parameters.shape_weight()), (0, 1.0));
        assert_eq!(parameters.to_string(), "shape_bins=64 R1=2 cm R2=5 cm w=1");
    }

    proptest! {
        #[test]
        fn any_domain_decodes_inside_itself(count in 1u32..300, step in 1u32..50, number in any::<u32>()) {
            let domain = Domain { low: 7, step, count };
            let table = GeneTable { domains: [domain; 5], colour: true };
            let parameters = table.at(&[number % count; 5]).unwrap();
            prop_assert!(table.contains(&parameters));
            prop_assert_eq!(table.indices(&parameters), Some(vec![number % count; 5]));
            let outside = Parameters { shape_bins: domain.high() + 1, ..parameters };
            prop_assert!(!table.contains(&outside));
            prop_assert_eq!(table.indices(&outside), None);
            let ticks = parameters.ticks(GeneKind::ShapeBins);
            prop_assert!(domain.values().any(|value| value == ticks));
        }
    }
}
