//! What the structures of a space cost at least: a lower limit of cost leaves nothing to search for.

use crate::Descriptor;
use crate::distance::SetDistance;
use crate::structure::genes::{GRIDS, radii, samples};
use crate::structure::genome::MIN_BINS;
use crate::structure::{Axis, Feature, Pairs, Scale, Structure, StructureChannel, StructureSpace, Weighted};

impl StructureSpace {
    /// The least that a structure of the space costs, as [`Descriptor::recognition_cost`] counts it, times its
    /// [`StructureSpace::shares`] of the limit.
    pub fn least_cost(&self) -> u64 {
        let channel = cheapest_channels().map(cost).min().unwrap_or_default();
        // Of so many channels, each costs at least as much.
        let of = |channels: u32| u64::from(channels * self.shares(channels as usize)) * channel;
        (1..=self.slots).map(of).min().unwrap_or_default()
    }
}

fn cost(channel: StructureChannel) -> u64 {
    let channel = Weighted { channel, weight_ppm: 1_000_000, scale: Scale::Quantile };
    Descriptor::Structure(Structure { channels: vec![channel] }).recognition_cost()
}

/// Channels that any space has, one of which no other costs less than: of one feature that needs neither colours nor normals,
/// in as few bins as there can be.
fn cheapest_channels() -> impl Iterator<Item = StructureChannel> {
    let lengths =
        |pairs| radii(pairs).iter().flat_map(|&radius_um| GRIDS.map(|grid_um| (radius_um, grid_um)));
    let places = Pairs::ALL.into_iter().flat_map(move |pairs| lengths(pairs).map(move |at| (pairs, at)));
    places.flat_map(|(pairs, (radius_um, grid_um))| {
        samples(pairs).iter().map(move |&samples| {
            let channel = StructureChannel {
                pairs,
                axes: vec![Axis { feature: Feature::Distance, bins: MIN_BINS, full_turn: false }],
                is_joint: true,
                squash_milli: 0,
                radius_um,
                shells_um: Vec::new(),
                least_um: 0,
                grid_um: if pairs == Pairs::Cloud { 0 } else { grid_um },
                samples,
                oriented: false,
                all_keypoints: false,
                metric: SetDistance::ChiSquared,
                value_weights: Vec::new(),
            };
            StructureChannel { shells_um: channel.equal_shells(1), ..channel }
        })
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::structure::genes::FIELDS;
    use crate::structure::testing::point;

    fn one_slot() -> StructureSpace {
        StructureSpace { slots: 1, ..StructureSpace::default() }
    }

    /// What is compared with a limit.
    fn limited(space: &StructureSpace, structure: Structure) -> u64 {
        let shares = space.shares(structure.channels.len());
        Descriptor::Structure(structure).recognition_cost() * u64::from(shares)
    }

    /// `keypoints d 3` within 4 cm on the grid of 3 cm. 23 keypoints of the nominal cloud (53·4/9), each with 8 of the
    /// others (23·560/1650); of each pair the feature and its distance; 6 values a keypoint, which are summed in two halves;
    /// and 6 values compared with each of 1000 clouds, of which 6 take as long as one count.
    #[test]
    fn of_one_slot_it_is_that_of_keypoints_on_the_coarsest_grid() {
        assert_eq!(one_slot().least_cost(), 23 * 8 * 2 + 23 * 6 + 1000);
    }

    #[test]
    fn no_channel_costs_less() {
        let space = one_slot();
        let mut found = u64::MAX;
        let [pairs, features] = [1, 2].map(|field| 0..space.fields()[field].values);
        for pairs in pairs {
            for feature in features.clone() {
                for place in 0..8 * 4 * 4 {
                    let mut slot = [0; FIELDS];
                    slot[1..5].copy_from_slice(&[pairs, feature, 31, 31]);
                    [slot[9], slot[12], slot[13]] = [place / 16, place / 4 % 4, place % 4];
                    found = found.min(limited(&space, space.decode(&slot).unwrap()));
                }
            }
        }
        assert_eq!(found, space.least_cost());
    }

    #[test]
    fn joined_members_are_limited_by_what_they_cost_together() {
        let channel = one_slot().least_cost();
        for (slots, members, factor) in [(8, 1, 1), (2, 2, 2), (3, 3, 2), (6, 3, 3), (8, 4, 3), (8, 8, 2)] {
            let space = StructureSpace { slots, members, ..StructureSpace::default() };
            assert_eq!(space.least_cost(), factor * channel, "{members} members of {slots} slots");
        }
    }

    proptest! {
        #[test]
        fn no_structure_costs_less((space, mut indices) in point(), absent in any::<u8>()) {
            let of_member = indices.len() / space.members as usize;
            for (member, fields) in indices.chunks_mut(of_member).enumerate() {
                if absent & 1 << member > 0 {
                    fields.fill(0);
                }
            }
            prop_assert!(limited(&space, space.decode(&indices).unwrap()) >= space.least_cost());
        }
    }
}
