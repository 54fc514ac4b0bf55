//! Members of structures: parts with equal shares of all limits, which evolve side by side.

use crate::structure::check::StructureError;
use crate::structure::genes::{DEFAULT_SLOTS, WEIGHTS};
use crate::structure::{StructureSpace, Weighted};

impl StructureSpace {
    /// Slots of a space with so many members unless an experiment says otherwise: two for each where that is possible, else
    /// one.
    pub fn default_slots(members: u32) -> u32 {
        match members {
            0 | 1 => DEFAULT_SLOTS as u32,
            3 | 4 => 2 * members,
            _ => members,
        }
    }

    /// Whether slots can be divided among the members.
    pub(super) fn check_members(&self) -> Result<(), StructureError> {
        let &Self { slots, members, .. } = self;
        if !(1..=slots).contains(&members) || !slots.is_multiple_of(members) {
            let what = format!("must divide the number of slots, {slots}, got {members}");
            return Err(StructureError::new("members", what, "change one of the two"));
        }
        // Otherwise some structures could be a member as well as joined members, which may cost more.
        if members > 1 && slots / members >= members {
            let what = format!(
                "must be more than the slots of each, {}, got {members} with {slots}",
                slots / members
            );
            return Err(StructureError::new("members", what, "use more members, or fewer slots"));
        }
        Ok(())
    }

    /// Slots that each member has.
    pub(super) fn slots_of_member(&self) -> usize {
        (self.slots / self.members) as usize
    }

    /// In how many parts limits are divided for a structure with so many channels: a member has its share of them.
    pub fn shares(&self, channels: usize) -> u32 {
        if channels <= self.slots_of_member() { self.members } else { 1 }
    }
}

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
    use proptest::prelude::*;

    use super::*;
    use crate::structure::Structure;
    use crate::structure::genes::FIELDS;
    use crate::structure::testing::{DIVISIONS, point};

    fn space(slots: u32, members: u32) -> StructureSpace {
        StructureSpace { slots, members, ..StructureSpace::default() }
    }

    #[test]
    fn members_divide_the_slots_and_are_more_than_each_has() {
        let valid: Vec<[u32; 2]> = (1..=8)
            .flat_map(|slots| (2..=8).map(move |members| [slots, members]))
            .filter(|&[slots, members]| space(slots, members).check().is_ok())
            .collect();
        assert_eq!(valid, DIVISIONS);
        let error = |slots, members| space(slots, members).check().unwrap_err().to_string();
        assert_eq!(error(4, 3), "members: must divide the number of slots, 4, got 3\nchange one of the two");
        assert_eq!(error(4, 0), "members: must divide the number of slots, 4, got 0\nchange one of the two");
        assert_eq!(
            error(8, 2),
            "members: must be more than the slots of each, 4, got 2 with 8\nuse more members, or fewer slots"
        );
        for members in 1..=8 {
            let slots = StructureSpace::default_slots(members);
            assert_eq!(space(slots, members).check(), Ok(()), "{members}");
        }
        assert_eq!([0, 1, 2, 3, 4, 5].map(StructureSpace::default_slots), [4, 4, 2, 6, 8, 5]);
    }

    #[test]
    fn what_has_as_many_channels_as_a_member_has_its_share() {
        assert_eq!([1, 2, 3, 6].map(|channels| space(6, 3).shares(channels)), [3, 3, 1, 1]);
        assert_eq!([1, 4].map(|channels| space(4, 1).shares(channels)), [1, 1]);
    }

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

    proptest! {
        #[test]
        fn joined_members_have_the_channels_of_each((space, indices) in point()) {
            let of_member = space.slots_of_member() * FIELDS;
            let mut alone = Vec::new();
            for number in 0..space.members as usize {
                let place = number * of_member..(number + 1) * of_member;
                if space.members > 1 && indices[place.clone()].iter().all(|&index| index == 0) {
                    continue;
                }
                let mut own = vec![0; indices.len()];
                own[place.clone()].copy_from_slice(&indices[place]);
                let member = space.decode(&own).unwrap();
                prop_assert!(member.channels.len() <= space.slots_of_member());
                prop_assert!(member.bins() <= u64::from(space.max_bins / space.members));
                prop_assert_eq!(space.shares(member.channels.len()), space.members);
                alone.extend(member.channels);
            }
            let joined = space.decode(&indices).unwrap();
            if joined.channels.len() > space.slots_of_member() {
                prop_assert_eq!(space.shares(joined.channels.len()), 1);
            }
            prop_assert_eq!(joined.channels, alone);
        }
    }
}
