//! The front of a search: its individuals that no other dominates.

use crate::hypervolume::hypervolume;
use crate::individual::Individual;
use crate::score::{Objectives, Score, dominates};
use crate::winner::Found;

/// Of all individuals that a search has met, those that none dominates: in ascending order of their objectives, so that
/// the fewest errors come first.
///
/// It has each vector of objectives once. Of the individuals that share one it has that with the greatest margin, of
/// equal margins the first that was found: they differ in nothing else that a search minimises.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Front {
    points: Vec<Found>,
}

impl Front {
    /// Its points.
    pub fn points(&self) -> &[Found] {
        &self.points
    }

    /// The volume of what it dominates up to a reference point, see [`hypervolume`].
    pub fn hypervolume(&self, reference: Objectives) -> u128 {
        hypervolume(self.points.iter().map(|point| point.score.objectives()), reference)
    }

    /// Adds an individual, number `index` of its generation, unless one that is there dominates or equals it, and drops
    /// those that it dominates.
    pub fn add(&mut self, generation: u32, index: u32, individual: &Individual, score: Score) {
        let objectives = score.objectives();
        let is_beaten = |point: &Found| {
            let there = point.score.objectives();
            dominates(&there, &objectives) || (there == objectives && point.score.margin >= score.margin)
        };
        if self.points.iter().any(is_beaten) {
            return;
        }
        self.points.retain(|point| {
            let there = point.score.objectives();
            there != objectives && !dominates(&objectives, &there)
        });
        let place = self.points.partition_point(|point| point.score.objectives() < objectives);
        let individual = individual.clone();
        self.points.insert(place, Found { generation, index, individual, score, validation: None });
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::score::tests::score;

    fn individual() -> Individual {
        Individual { chromosome: vec![], values: vec![], parents: [None, None], elite: false }
    }

    #[test]
    fn of_equal_objectives_the_greatest_margin_stays_and_of_equal_margins_the_first() {
        let mut front = Front::default();
        for (index, (correct, margin)) in
            [(5, 0.1), (5, 0.3), (5, 0.3), (5, 0.2), (4, 0.9)].into_iter().enumerate()
        {
            front.add(1, index as u32, &individual(), Score { margin, ..score(correct, 9) });
        }
        assert_eq!(front.points().iter().map(|point| point.index).collect::<Vec<_>>(), [1]);
    }

    proptest! {
        #[test]
        fn it_is_what_none_dominates_in_order_and_its_hypervolume_never_falls(
            table in prop::collection::vec((0u32..6, prop::array::uniform2(0u64..6)), 1..40),
        ) {
            let scores: Vec<Score> =
                table.iter().map(|&(correct, further)| Score { further, ..score(correct, 6) }).collect();
            let (mut front, mut before) = (Front::default(), 0);
            for (index, &score) in scores.iter().enumerate() {
                front.add(1 + index as u32 / 5, index as u32 % 5, &individual(), score);
                let volume = front.hypervolume([7; 3]);
                prop_assert!(volume >= before);
                before = volume;
            }
            let all: Vec<Objectives> = scores.iter().map(Score::objectives).collect();
            let mut expected: Vec<Objectives> =
                all.iter().filter(|a| !all.iter().any(|b| dominates(b, a))).copied().collect();
            expected.sort_unstable();
            expected.dedup();
            let got: Vec<Objectives> = front.points().iter().map(|point| point.score.objectives()).collect();
            prop_assert_eq!(got, expected);
            prop_assert_eq!(before, hypervolume(all.iter().copied(), [7; 3]));
            // Each was found where it is said to be, first of its equals.
            for point in front.points() {
                let index = 5 * (point.generation as usize - 1) + point.index as usize;
                prop_assert_eq!(all.iter().position(|o| *o == point.score.objectives()), Some(index));
            }
        }
    }
}
