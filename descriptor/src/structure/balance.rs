//! The weights of a member of a structure: members count alike.

use crate::structure::Weighted;
use crate::structure::genes::WEIGHTS;

/// Shifts the weights of a member in their list, all by as much as far as it goes, so that they add up to nearly 1: members
/// count alike, as their distances are in the scale of those among the training clouds.
pub(super) fn balance(channels: &mut [Weighted]) {
    let last = WEIGHTS.len() as i32 - 1;
    let place =
        |it: &Weighted| WEIGHTS.iter().position(|weight| *weight == it.weight_ppm).map(|at| at as i32);
    let Some(places) = channels.iter().map(place).collect::<Option<Vec<i32>>>() else { return };
    let shifted =
        |shift: i32| places.iter().map(move |place| WEIGHTS[(place + shift).clamp(0, last) as usize]);
    let distance = |shift: &i32| shifted(*shift).sum::<u32>().abs_diff(Weighted::UNIT_PPM);
    // The smallest of several that are as good: what is balanced stays.
    let Some(best) = (-last..=last).min_by_key(|shift| (distance(shift), shift.abs())) else { return };
    channels.iter_mut().zip(shifted(best)).for_each(|(it, weight_ppm)| it.weight_ppm = weight_ppm);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::structure::Structure;

    #[test]
    fn weights_of_a_member_keep_their_ratios_and_add_up_to_one() {
        let structure = Structure::default();
        let balanced = |places: &[usize]| {
            let weighted =
                |&place: &usize| Weighted { weight_ppm: WEIGHTS[place], ..structure.channels[0].clone() };
            let mut channels: Vec<Weighted> = places.iter().map(weighted).collect();
            balance(&mut channels);
            channels.iter().map(|it| it.weight_ppm).collect::<Vec<_>>()
        };
        // 0.05·100^(20/31) = 0.976 and 0.05·100^(21/31) = 1.132.
        for place in 0..32 {
            assert_eq!(balanced(&[place]), [WEIGHTS[20]], "{place}");
        }
        for (places, shifted) in [([16, 16], [15, 15]), ([31, 29], [16, 14]), ([3, 10], [11, 18])] {
            assert_eq!(balanced(&places), shifted.map(|place| WEIGHTS[place]), "{places:?}");
            let total: u32 = balanced(&places).iter().sum();
            assert!((920_000..1_080_000).contains(&total), "{places:?}: {total}");
        }
        // As far as the list goes.
        assert_eq!(balanced(&[31, 0]), [WEIGHTS[20], WEIGHTS[0]]);
    }
}
