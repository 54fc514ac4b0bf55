//! The search space as a grid of descriptors, in cells of one R1 and one R2 each.

use descriptor::{Family, GENES, GeneKind, GeneTable, Parameters, SearchSpace};
use proto::MAX_CELL;

use crate::experiment::Experiment;
use crate::fitness::Fitness;

/// Most descriptors of a grid, some days of work.
const MAX_DESCRIPTORS: u128 = 1 << 31;
/// Most cells of a grid: each is a job and a file.
const MAX_CELLS: u128 = 1 << 20;
/// Most values of all genes together: the landscape has a histogram for each.
const MAX_VALUES: u128 = 1 << 16;
/// Most pairs of values of two genes: the landscape has a row for each.
const MAX_PAIRS: u128 = 1 << 24;

/// Why a search space is not evaluated exhaustively.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GridError {
    /// It is too large.
    #[error(
        "descriptor.genes: grid must have at most {most} {what}, got {got}\nchoose larger steps or smaller intervals, or search.method = \"ga\""
    )]
    TooLarge {
        /// What is counted.
        what: &'static str,
        /// How many there may be.
        most: u128,
        /// How many there are.
        got: u128,
    },
    /// Only descriptors with disk and ring are counted cell by cell.
    #[error(
        "descriptor.family: an exhaustive search needs disk-ring, got {got}\nchoose search.method = \"ga\", \"random\" or \"hill-climb\""
    )]
    Family {
        /// The family.
        got: Family,
    },
    /// A grid counts what the paper's fitness counts: it says nothing of what is best by another.
    #[error(
        "search.fitness: an exhaustive search counts objects of train1 among those of train2, got {got}\nremove [search.fitness], or choose search.method = \"ga\", \"random\" or \"hill-climb\""
    )]
    Fitness {
        /// The fitness as its keys.
        got: Fitness,
    },
}

/// Every descriptor of a gene table, by index along each gene.
#[derive(Clone, Debug)]
pub struct Grid {
    table: GeneTable,
    /// The values of every gene, in ticks, in the order of [`GENES`]; only 0 for m without colour.
    axes: [Vec<u32>; GENES.len()],
}

impl Grid {
    /// The grid of an experiment's search space.
    ///
    /// # Errors
    /// As [`Grid::new`], and if the experiment's fitness counts anything else than the grid.
    pub fn of(experiment: &Experiment) -> Result<Self, GridError> {
        let grid = Self::new(experiment.space())?;
        let fitness = *experiment.fitness();
        if fitness.counts_as_the_paper() { Ok(grid) } else { Err(GridError::Fitness { got: fitness }) }
    }

    /// The grid of a gene table.
    ///
    /// # Errors
    /// Before anything is allocated: [`GridError`].
    pub fn new(space: &SearchSpace) -> Result<Self, GridError> {
        let SearchSpace::DiskRing(table) = space else {
            return Err(GridError::Family { got: space.family() });
        };
        let count = |kind| table.domain(kind).map_or(1, |domain| u128::from(domain.count));
        let cells = count(GeneKind::DiskRadius) * count(GeneKind::RingRadius);
        let (mut values, mut pairs) = (0, 0);
        for (_, domain) in table.genes() {
            pairs += values * u128::from(domain.count);
            values += u128::from(domain.count);
        }
        for (what, most, got) in [
            ("descriptors with the same R1 and R2", MAX_CELL.into(), table.size() / cells),
            ("pairs of R1 and R2", MAX_CELLS, cells),
            ("descriptors", MAX_DESCRIPTORS, table.size()),
            ("values of all genes together", MAX_VALUES, values),
            ("pairs of values of two genes", MAX_PAIRS, pairs),
        ] {
            if got > most {
                return Err(GridError::TooLarge { what, most, got });
            }
        }
        let values = |kind| table.domain(kind).map_or_else(|| vec![0], |domain| domain.values().collect());
        Ok(Self { table: table.clone(), axes: GeneKind::ALL.map(values) })
    }

    /// The gene table.
    pub fn table(&self) -> &GeneTable {
        &self.table
    }

    /// The values of one gene, in ticks, ascending.
    pub fn axis(&self, gene: GeneKind) -> &[u32] {
        &self.axes[gene as usize]
    }

    /// Number of cells.
    pub fn cells(&self) -> usize {
        self.axis(GeneKind::DiskRadius).len() * self.axis(GeneKind::RingRadius).len()
    }

    /// Number of descriptors in each cell.
    pub fn cell_len(&self) -> usize {
        use GeneKind::{ColourBins, ShapeBins, ShapeWeight};
        [ShapeBins, ColourBins, ShapeWeight].map(|kind| self.axis(kind).len()).iter().product()
    }

    /// Number of descriptors.
    pub fn descriptors(&self) -> u64 {
        self.cells() as u64 * self.cell_len() as u64
    }

    /// R1 and R2 of a cell, micrometres; cells are numbered with R2 fastest.
    pub fn radii(&self, cell: usize) -> (u32, u32) {
        let (disk, ring) = self.radius_places(cell);
        (self.axis(GeneKind::DiskRadius)[disk], self.axis(GeneKind::RingRadius)[ring])
    }

    fn radius_places(&self, cell: usize) -> (usize, usize) {
        let rings = self.axis(GeneKind::RingRadius).len();
        (cell / rings, cell % rings)
    }

    /// The places of a cell's descriptors along the axes, in the order shape_bins, m, w, w fastest.
    pub fn places(&self, cell: usize) -> impl Iterator<Item = [usize; GENES.len()]> + use<> {
        let (disk, ring) = self.radius_places(cell);
        let [shapes, colours, _, _, weights] = self.axes.each_ref().map(Vec::len);
        (0..shapes).flat_map(move |shape| {
            (0..colours)
                .flat_map(move |colour| (0..weights).map(move |weight| [shape, colour, disk, ring, weight]))
        })
    }

    /// The descriptor at a place.
    pub fn descriptor(&self, place: [usize; GENES.len()]) -> Parameters {
        Parameters::from_ticks(std::array::from_fn(|gene| self.axes[gene][place[gene]]))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::collections::BTreeSet;

    use descriptor::Domain;

    use super::*;

    /// A grid of so many values a gene.
    pub fn grid(counts: [u32; 5], colour: bool) -> Grid {
        let lows = [8, 3, 5_000, 21_000, 100_000];
        let steps = [2, 1, 1_000, 1_000, 10_000];
        let domain = |gene: usize| Domain { low: lows[gene], step: steps[gene], count: counts[gene] };
        let table = GeneTable::new(std::array::from_fn(domain), colour).unwrap();
        Grid::new(&SearchSpace::DiskRing(table)).unwrap()
    }

    fn refused(domains: [Domain; 5]) -> GridError {
        let table = GeneTable::new(domains, true).unwrap();
        Grid::new(&SearchSpace::DiskRing(table)).map(|_| ()).unwrap_err()
    }

    #[test]
    fn a_family_without_disk_and_ring_is_refused() {
        let space =
            SearchSpace::new(Family::GlobalHue, true, &[Domain { low: 2, step: 1, count: 9 }]).unwrap();
        let error = Grid::new(&space).map(|_| ()).unwrap_err().to_string();
        assert!(
            error.starts_with("descriptor.family: an exhaustive search needs disk-ring, got global-hue\n")
        );
    }

    #[test]
    fn the_papers_grid_has_480_cells_that_cover_it() {
        let grid = Grid::new(&SearchSpace::DiskRing(GeneTable::paper())).unwrap();
        assert_eq!((grid.cells(), grid.cell_len(), grid.descriptors()), (480, 57 * 6 * 101, 16_580_160));
        assert_eq!(grid.radii(0), (5_000, 21_000));
        assert_eq!(grid.radii(479), (20_000, 50_000));
    }

    #[test]
    fn every_descriptor_is_in_one_cell_and_in_order_there() {
        for colour in [true, false] {
            let grid = grid([3, 2, 2, 4, 3], colour);
            let mut all = BTreeSet::new();
            for cell in 0..grid.cells() {
                let descriptors: Vec<Parameters> =
                    grid.places(cell).map(|place| grid.descriptor(place)).collect();
                assert_eq!(descriptors.len(), grid.cell_len());
                assert!(descriptors.is_sorted());
                for descriptor in descriptors {
                    assert_eq!((descriptor.disk_um, descriptor.ring_um), grid.radii(cell));
                    assert!(grid.table().contains(&descriptor));
                    all.insert(descriptor);
                }
            }
            assert_eq!(all.len() as u64, grid.descriptors());
            assert_eq!(u128::from(grid.descriptors()), grid.table().size());
        }
    }

    #[test]
    fn grids_that_would_never_end_are_refused() {
        let wide = |gene: usize, low, count| {
            let mut domains =
                GENES.each_ref().map(|spec| Domain { low: spec.default.0, step: spec.default.2, count: 1 });
            domains[0].count = 57;
            domains[1].count = 6;
            domains[gene] = Domain { low, step: 1, count };
            refused(domains).to_string()
        };
        assert!(wide(4, 0, 60_000).starts_with(
            "descriptor.genes: grid must have at most 1048576 descriptors with the same R1 and R2, got 20520000\n"
        ));
        let radii = |shape_bins, m, count, w| {
            let (disk, ring) = (Domain { low: 1, step: 1, count }, Domain { low: 21_000, step: 1, count });
            refused([shape_bins, m, disk, ring, w])
        };
        assert_eq!(
            radii(Domain::fixed(8), Domain::fixed(3), 2_000, Domain::fixed(0)),
            GridError::TooLarge { what: "pairs of R1 and R2", most: 1 << 20, got: 4_000_000 }
        );
        let many = |low, count| Domain { low, step: 1, count };
        assert_eq!(
            radii(many(8, 100), many(3, 30), 100, many(0, 100)),
            GridError::TooLarge { what: "descriptors", most: 1 << 31, got: 3_000_000_000 }
        );
        let disks_and_weights = |disks, weights| {
            let (disk, ring) = (many(1, disks), Domain::fixed(21_000));
            let domains = [Domain::fixed(8), Domain::fixed(3), disk, ring, many(0, weights)];
            refused(domains)
        };
        assert_eq!(
            disks_and_weights(6_000, 60_000),
            GridError::TooLarge { what: "values of all genes together", most: 1 << 16, got: 66_003 }
        );
        assert_eq!(
            disks_and_weights(10_000, 10_000),
            GridError::TooLarge { what: "pairs of values of two genes", most: 1 << 24, got: 100_060_003 }
        );
    }
}
