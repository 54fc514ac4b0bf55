//! Members of structures: parts with equal shares of all limits, which evolve side by side.

use crate::structure::StructureSpace;
use crate::structure::check::StructureError;
use crate::structure::genes::DEFAULT_SLOTS;

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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
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
