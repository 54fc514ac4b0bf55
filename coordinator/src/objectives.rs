//! What a search minimises: the error, and beside it the counted cost of a descriptor or its size, or both.

use descriptor::Descriptor;
use evolution::Front;

/// One thing that a search can minimise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum SearchObjective {
    /// 1 − training fitness.
    Error,
    /// Counted cost of recognising a cloud.
    Cost,
    /// Values kept a cloud.
    Size,
}

impl SearchObjective {
    /// All of them, in the order in which they are written.
    pub const ALL: [Self; 3] = [Self::Error, Self::Cost, Self::Size];

    /// Its name in experiments.
    pub fn name(self) -> &'static str {
        match self {
            Self::Error => "error",
            Self::Cost => "cost",
            Self::Size => "size",
        }
    }
}

/// What a search minimises: the error always.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Objectives {
    cost: bool,
    size: bool,
}

/// Counted cost of the reference point of hypervolumes: about two milliseconds a cloud. What costs as much adds nothing.
pub const REFERENCE_COST: u64 = 2_000_000;

/// Size of the reference point: that of 500 bins with their deviations. What is as large adds nothing.
pub const REFERENCE_SIZE: u64 = 1_000;

impl Objectives {
    /// The error alone.
    pub const ERROR: Self = Self { cost: false, size: false };

    /// All three.
    pub const ALL: Self = Self { cost: true, size: true };

    /// These; `None` without the error.
    pub fn new(objectives: &[SearchObjective]) -> Option<Self> {
        let has = |objective| objectives.contains(&objective);
        has(SearchObjective::Error)
            .then(|| Self { cost: has(SearchObjective::Cost), size: has(SearchObjective::Size) })
    }

    /// Which they are.
    pub fn each(self) -> impl Iterator<Item = SearchObjective> {
        let has = move |objective: &SearchObjective| match objective {
            SearchObjective::Error => true,
            SearchObjective::Cost => self.cost,
            SearchObjective::Size => self.size,
        };
        SearchObjective::ALL.into_iter().filter(has)
    }

    /// Whether there are more than one.
    pub fn are_several(self) -> bool {
        self != Self::ERROR
    }

    /// Those beside the error, as a [`Score`](evolution::Score) has them; what is not minimised is 0. A descriptor that
    /// is too costly to be evaluated is worse in them than all others.
    pub fn further(self, descriptor: &Descriptor, is_affordable: bool) -> [u64; 2] {
        if !self.are_several() {
            return [0; 2];
        }
        if !is_affordable {
            return [u64::MAX; 2];
        }
        [
            if self.cost { descriptor.recognition_cost() } else { 0 },
            if self.size { descriptor.size_of_cloud() } else { 0 },
        ]
    }

    /// The hypervolume of a front as a share of the box between 0 and the reference point: every one of the queries
    /// wrong, [`REFERENCE_COST`], [`REFERENCE_SIZE`]. `None` of one objective.
    pub fn hypervolume(self, front: &Front, queries: u32) -> Option<f64> {
        let reference = [
            u64::from(queries),
            if self.cost { REFERENCE_COST } else { 1 },
            if self.size { REFERENCE_SIZE } else { 1 },
        ];
        let whole: u128 = reference.iter().map(|&end| u128::from(end)).product();
        self.are_several().then(|| front.hypervolume(reference) as f64 / whole.max(1) as f64)
    }
}

#[cfg(test)]
mod tests {
    use descriptor::Family;
    use evolution::{Decompose, Encoding, Field, Genome, Method, Score, Search, StopSettings, WinnerRule};

    use super::*;

    #[test]
    fn the_error_is_always_among_them() {
        use SearchObjective::{Cost, Error, Size};
        assert_eq!(Objectives::new(&[Cost, Size]), None);
        assert_eq!(Objectives::new(&[Size, Cost, Error]), Some(Objectives::ALL));
        assert_eq!(Objectives::new(&[Error]), Some(Objectives::ERROR));
        let two = Objectives::new(&[Size, Error]).unwrap();
        assert_eq!(two.each().collect::<Vec<_>>(), [Error, Size]);
        let descriptor = Descriptor::default_of(Family::DiskRing);
        let (cost, size) = (descriptor.recognition_cost(), descriptor.size_of_cloud());
        assert_eq!(two.further(&descriptor, true), [0, size]);
        assert_eq!(Objectives::ALL.further(&descriptor, true), [cost, size]);
        assert_eq!(two.further(&descriptor, false), [u64::MAX; 2]);
        assert_eq!(Objectives::ERROR.further(&descriptor, false), [0; 2]);
    }

    #[test]
    fn the_hypervolume_is_a_share_of_the_box_below_the_reference_point() {
        let genome = Genome::new(vec![Field::new("one", 1)], Encoding::Binary);
        let strategy = Method::Random
            .strategy(&genome, 1, Default::default(), 1, Decompose::by(|_| None))
            .unwrap()
            .unwrap();
        let mut search = Search::new(strategy, StopSettings::default(), WinnerRule::Fitness);
        search.keep_first(1);
        let further = [REFERENCE_COST / 4, REFERENCE_SIZE / 2];
        search.tell(&[Score { correct: 5, queries: 10, margin: 0.0, further }], None, 1);
        assert_eq!(Objectives::ALL.hypervolume(search.front(), 10), Some(0.5 * 0.75 * 0.5));
        assert_eq!(Objectives::ERROR.hypervolume(search.front(), 10), None);
        let meaning = results::schema_markdown().unwrap();
        assert!(
            meaning.contains(&format!("every query wrong, cost {REFERENCE_COST}, size {REFERENCE_SIZE};"))
        );
    }
}
