//! The hypervolume of a front: how much of the objective space it dominates, exactly.

use crate::score::Objectives;

/// The volume of what at least one of the points dominates up to a reference point: the union of the boxes between each
/// point and the reference. Points that are not below the reference in every objective add nothing. Of two objectives,
/// the third is 0 everywhere and its reference 1.
///
/// The volume is exact below 2¹²⁸ and ends there.
pub fn hypervolume(points: impl IntoIterator<Item = Objectives>, reference: Objectives) -> u128 {
    let below = |point: &Objectives| point.iter().zip(&reference).all(|(value, end)| value < end);
    let mut points: Vec<Objectives> = points.into_iter().filter(below).collect();
    points.sort_unstable_by_key(|&[_, _, third]| third);
    // From one value of the third objective to the next, the same area of the first two is dominated: a staircase of
    // ascending first and descending second objectives.
    let mut stairs: Vec<[u64; 2]> = Vec::new();
    let mut volume = 0u128;
    for (place, &[first, second, third]) in points.iter().enumerate() {
        if !stairs.iter().any(|stair| stair[0] <= first && stair[1] <= second) {
            stairs.retain(|stair| stair[0] < first || stair[1] < second);
            let step = stairs.partition_point(|stair| stair[0] < first);
            stairs.insert(step, [first, second]);
        }
        let next = points.get(place + 1).map_or(reference[2], |next| next[2]);
        if next > third {
            volume = volume.saturating_add(area(&stairs, reference).saturating_mul(u128::from(next - third)));
        }
    }
    volume
}

/// The area between a staircase and the reference.
fn area(stairs: &[[u64; 2]], [first_end, second_end, _]: Objectives) -> u128 {
    let mut area = 0u128;
    for (place, &[first, second]) in stairs.iter().enumerate() {
        let next = stairs.get(place + 1).map_or(first_end, |next| next[0]);
        area = area.saturating_add(u128::from(next - first) * u128::from(second_end - second));
    }
    area
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn boxes_and_their_overlap_are_counted_once() {
        assert_eq!(hypervolume([[1, 2, 3]], [5, 5, 5]), 4 * 3 * 2);
        assert_eq!(hypervolume([[1, 4, 0], [3, 1, 0]], [5, 5, 1]), 4 + 8 - 2);
        assert_eq!(hypervolume([[5, 0, 0], [0, 9, 0]], [5, 5, 5]), 0);
        assert_eq!(hypervolume([], [5, 5, 5]), 0);
    }

    #[test]
    fn the_largest_volumes_do_not_overflow() {
        let end = u64::MAX;
        assert_eq!(hypervolume([[0, 0, 0]], [end, end, 1]), u128::from(end) * u128::from(end));
        assert_eq!(hypervolume([[0, 0, 0], [1, 1, 1]], [end; 3]), u128::MAX);
    }

    proptest! {
        #[test]
        fn it_is_the_number_of_unit_cubes_that_a_point_dominates(
            points in prop::collection::vec(prop::array::uniform3(0u64..9), 0..10),
            reference in prop::array::uniform3(1u64..9),
        ) {
            let [x, y, z] = reference;
            let cubes = (0..x).flat_map(|x| (0..y).flat_map(move |y| (0..z).map(move |z| [x, y, z])));
            let dominated =
                |cube: &Objectives| points.iter().any(|point| point.iter().zip(cube).all(|(p, c)| p <= c));
            let expected = cubes.filter(dominated).count() as u128;
            prop_assert_eq!(hypervolume(points.iter().copied(), reference), expected);
        }
    }
}
