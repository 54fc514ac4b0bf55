//! Non-dominated sorting and crowding distance (Deb et al., *A fast and elitist multiobjective genetic algorithm:
//! NSGA-II*, 2002).

use std::collections::BTreeSet;

use crate::score::{Objectives, dominates};

/// The non-dominated fronts: the first has the points that none dominates, each further one those that only points of
/// the fronts before it dominate. Points are named by their indices, which ascend in each front.
///
/// Points are taken in lexicographic order, so that none dominates one before it, and go into the first front that does
/// not dominate them (Zhang et al., *An efficient approach to nondominated sorting for evolutionary multiobjective
/// optimization*, 2015): quadratic in time as the original, linear in memory.
pub(crate) fn fronts(points: &[Objectives]) -> Vec<Vec<u32>> {
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    order.sort_by_key(|&index| points[index as usize]);
    let mut fronts: Vec<Vec<u32>> = Vec::new();
    for index in order {
        let point = &points[index as usize];
        // The last ones of a front are the likeliest to dominate.
        let dominated =
            |front: &Vec<u32>| front.iter().rev().any(|&other| dominates(&points[other as usize], point));
        match fronts.iter_mut().find(|front| !dominated(front)) {
            Some(front) => front.push(index),
            None => fronts.push(vec![index]),
        }
    }
    fronts.iter_mut().for_each(|front| front.sort_unstable());
    fronts
}

/// The crowding distance of each point of a front: over the objectives, the distance of its neighbours on both sides
/// as a share of the front's range; infinite at either end of an objective. An objective in which all are equal counts
/// nothing. Of points that are equal in all objectives only the first has a distance, the others 0: they add nothing to
/// the front. (The paper gives them distances as to any neighbours; pymoo has the choice, as `filter_out_duplicates`.)
///
/// Of equal values in one objective, the point that comes first in `front` is the lower.
pub(crate) fn crowding(points: &[Objectives], front: &[u32]) -> Vec<f64> {
    let mut seen = BTreeSet::new();
    let different: Vec<usize> =
        (0..front.len()).filter(|&place| seen.insert(points[front[place] as usize])).collect();
    let mut distances = vec![0.0; front.len()];
    for objective in [0, 1, 2] {
        let value = |&place: &usize| points[front[place] as usize][objective];
        let mut order = different.clone();
        order.sort_by_key(value); // stable: the first stays first
        let (Some(first), Some(last)) = (order.first(), order.last()) else { continue };
        if value(first) == value(last) {
            continue;
        }
        let range = (value(last) - value(first)) as f64;
        distances[*first] = f64::INFINITY;
        distances[*last] = f64::INFINITY;
        for three in order.windows(3) {
            distances[three[1]] += (value(&three[2]) - value(&three[0])) as f64 / range;
        }
    }
    distances
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The fronts by their definition: what no point that is left dominates, again and again.
    fn peeled(points: &[Objectives]) -> Vec<Vec<u32>> {
        let mut left: Vec<u32> = (0..points.len() as u32).collect();
        let mut fronts = Vec::new();
        while !left.is_empty() {
            let is_dominated =
                |a: u32| left.iter().any(|&b| dominates(&points[b as usize], &points[a as usize]));
            let (rest, front): (Vec<u32>, Vec<u32>) = left.iter().partition(|&&a| is_dominated(a));
            fronts.push(front);
            left = rest;
        }
        fronts
    }

    /// The crowding distance of one point by its definition, if all values of each objective are different.
    fn distance(points: &[Objectives], which: usize) -> f64 {
        let of_objective = |objective: usize| {
            let value = points[which][objective];
            let values = || points.iter().map(|point| point[objective]);
            let (low, high) = (values().min().unwrap(), values().max().unwrap());
            let (below, above) =
                (values().filter(|&v| v < value).max(), values().filter(|&v| v > value).min());
            match (below, above) {
                (Some(below), Some(above)) => (above - below) as f64 / (high - low) as f64,
                _ => f64::INFINITY,
            }
        };
        (0..3).map(of_objective).sum()
    }

    #[test]
    fn a_chain_has_a_front_for_each_and_equals_share_one() {
        assert_eq!(fronts(&[[2, 2, 2], [1, 1, 1], [3, 3, 3], [1, 1, 1]]), [vec![1, 3], vec![0], vec![2]]);
        assert_eq!(fronts(&[]), Vec::<Vec<u32>>::new());
    }

    #[test]
    fn the_example_of_two_objectives_has_its_cuboids() {
        // Sides of the cuboids over ranges of 8 and 8: (4 - 0 + 8 - 2) / 8 and (8 - 1 + 5 - 0) / 8.
        let points = [[0, 8, 0], [1, 5, 0], [4, 2, 0], [8, 0, 0]];
        let expected = [f64::INFINITY, (4.0 + 6.0) / 8.0, (7.0 + 5.0) / 8.0, f64::INFINITY];
        assert_eq!(crowding(&points, &[0, 1, 2, 3]), expected);
    }

    #[test]
    fn only_the_first_of_equal_points_has_a_distance_and_constants_count_nothing() {
        let points = [[1, 5, 3], [4, 2, 3], [1, 5, 3], [2, 3, 3]];
        assert_eq!(crowding(&points, &[0, 1, 2, 3]), [f64::INFINITY, f64::INFINITY, 0.0, 2.0]);
        assert_eq!(crowding(&[[7; 3]; 3], &[0, 1, 2]), [0.0; 3]);
        assert_eq!(crowding(&points, &[]), Vec::<f64>::new());
    }

    proptest! {
        #[test]
        fn fronts_are_those_of_the_definition(
            points in prop::collection::vec(prop::array::uniform3(0u64..6), 0..40),
        ) {
            prop_assert_eq!(fronts(&points), peeled(&points));
        }

        #[test]
        fn crowding_is_that_of_the_definition(
            columns in prop::array::uniform3(prop::collection::btree_set(0u64..1000, 12)),
            keys in prop::array::uniform3(prop::collection::vec(any::<u64>(), 12)),
        ) {
            // Each objective's values in an order of its own.
            let column = |objective: usize| {
                let mut values: Vec<(u64, u64)> =
                    keys[objective].iter().copied().zip(columns[objective].iter().copied()).collect();
                values.sort_unstable();
                values
            };
            let columns = [0, 1, 2].map(column);
            let points: Vec<Objectives> = (0..12).map(|row| [0, 1, 2].map(|c| columns[c][row].1)).collect();
            let front: Vec<u32> = (0..12).collect();
            for (which, got) in crowding(&points, &front).into_iter().enumerate() {
                let expected = distance(&points, which);
                prop_assert!(got == expected || (got - expected).abs() < 1e-12, "{got} {expected}");
            }
        }
    }
}
