//! The genome of structures: what a search looks through, and the mapping between value indices and structures.

use crate::distance::SetDistance;
use crate::gene::{FieldSpec, GeneSpec};
use crate::structure::balance::balance;
use crate::structure::check::StructureError;
use crate::structure::genes::{
    CATEGORIES, DEFAULT_SLOTS, FEATURES, FIELDS, GENES, GRIDS, LEAST_DISTANCES, SHELLS, SLOTS, SQUASHES,
    WEIGHTS, radii, samples,
};
use crate::structure::{Axis, Feature, Pairs, Scale, Structure, StructureChannel, Weighted};

/// Fewest bins of a feature.
pub(super) const MIN_BINS: u32 = 3;

/// Numbers of bins that a feature may have, and that a lone `d` may have.
const BINS: u32 = 11;
const LONE_BINS: u32 = 28;

/// Values of a field whose code has 5 bits.
const CODES: u32 = 32;

/// The structures that a search looks through.
///
/// Where there are several *members*, each has an equal number of consecutive slots and an equal share of the bins, and its
/// weights are shifted so that they add up to about 1: a member of which some index is not 0 adds the same
/// channels to whatever other members are there.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct StructureSpace {
    /// Whether features of colour are among them.
    pub colour: bool,
    /// Most channels, 1 to 8.
    pub slots: u32,
    /// Parts that evolve side by side; 1: the structure evolves as a whole.
    pub members: u32,
    /// Most bins of all channels together: [`StructureChannel::bins`] added up.
    pub max_bins: u32,
    /// How rows are compared, in all channels.
    pub metric: SetDistance,
}

impl Default for StructureSpace {
    fn default() -> Self {
        Self {
            colour: true,
            slots: DEFAULT_SLOTS as u32,
            members: 1,
            max_bins: 500,
            metric: SetDistance::default(),
        }
    }
}

impl Structure {
    /// The genes of all slots: [`StructureSpace::fields`] of a space with fewer are the first of them.
    pub fn genes() -> &'static [GeneSpec] {
        GENES.as_flattened()
    }
}

impl StructureSpace {
    /// Refuses a space that no experiment may search.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn check(&self) -> Result<(), StructureError> {
        let &Self { slots, max_bins, .. } = self;
        if !(1..=SLOTS as u32).contains(&slots) {
            let what = format!("must be 1 to {SLOTS}, got {slots}");
            return Err(StructureError::new("slots", what, "choose the largest number of channels"));
        }
        self.check_members()?;
        // Every genome must fit: three features in two shells, in every slot.
        let least = slots * SHELLS[1] * MIN_BINS.pow(FEATURES as u32);
        if max_bins < least {
            let slots = if slots == 1 { "1 slot".to_owned() } else { format!("{slots} slots") };
            let what = format!("must be at least {least} for {slots}, got {max_bins}");
            return Err(StructureError::new("max_bins", what, "raise it, or search with fewer slots"));
        }
        Ok(())
    }

    /// The fields of its chromosomes, slot after slot.
    pub fn fields(&self) -> Vec<FieldSpec> {
        let slots = GENES.iter().take(self.slots as usize);
        let values =
            [2, 4, self.features().len() as u32, CODES, CODES, CODES, CODES, CODES, 6, 8, 2, 4, 4, 4, CODES];
        let of_slot = |(slot, genes): (u32, &'static [GeneSpec; FIELDS])| {
            let numbered = (0..).zip(genes).zip(values);
            numbered.map(move |((field, gene), values)| FieldSpec {
                gene,
                values,
                slot: Some(slot),
                is_ordered: !CATEGORIES.contains(&field),
            })
        };
        (0..).zip(slots).flat_map(of_slot).collect()
    }

    /// The features that channels may have, in the order of their codes.
    fn features(&self) -> &'static [Feature] {
        if self.colour { &Feature::ALL } else { &Feature::ALL[..Feature::COLOURLESS] }
    }

    /// The structure whose fields have the values at these indices; `None` unless there is one index below the number
    /// of values for each of [`StructureSpace::fields`].
    ///
    /// If no slot of a member is active, the first is. A feature that a channel already has drops out with its bins. A
    /// channel whose smallest distance leaves no pair adds nothing to any distance and drops out; if no other of the
    /// member is left, its first stays, with all its pairs. Of several members those drop out whose indices are all 0, but
    /// for the first if there is no other.
    pub fn decode(&self, indices: &[u32]) -> Option<Structure> {
        self.check().ok()?;
        let fields = self.fields();
        let fit = |(index, field): (&u32, &FieldSpec)| *index < field.values;
        if indices.len() != fields.len() || !indices.iter().zip(&fields).all(fit) {
            return None;
        }
        let (slots, _) = indices.as_chunks::<FIELDS>();
        let mut members: Vec<&[[u32; FIELDS]]> = slots.chunks(self.slots_of_member()).collect();
        let first = members[0];
        members.retain(|slots| slots.as_flattened().iter().any(|&index| index > 0));
        if members.is_empty() {
            members.push(first);
        }
        let members: Option<Vec<_>> = members.into_iter().map(|slots| self.member(slots)).collect();
        Some(Structure { channels: members?.concat() })
    }

    /// The channels of a member with these slots.
    fn member(&self, slots: &[[u32; FIELDS]]) -> Option<Vec<Weighted>> {
        let mut active: Vec<&[u32; FIELDS]> = slots.iter().filter(|slot| slot[0] == 1).collect();
        if active.is_empty() {
            active.extend(slots.first());
        }
        let mut channels: Vec<Weighted> =
            active.into_iter().map(|slot| self.channel(slot)).collect::<Option<_>>()?;
        reduce(&mut channels, self.max_bins / self.members)?;
        if !channels.iter().any(|it| it.channel.has_pairs()) {
            channels.truncate(1);
            channels.iter_mut().for_each(|it| it.channel.least_um = LEAST_DISTANCES[0]);
        }
        channels.retain(|it| it.channel.has_pairs());
        if self.members > 1 {
            balance(&mut channels);
        }
        Some(channels)
    }

    /// The channel of a slot, before bins are taken from it.
    fn channel(&self, slot: &[u32; FIELDS]) -> Option<Weighted> {
        let &[_, pairs, feature_1, feature_2, feature_3, bins_1, bins_2, bins_3, rest @ ..] = slot;
        let [squash, radius, shells, least, grid, sample, weight] = rest.map(|index| index as usize);
        let pairs = *Pairs::ALL.get(pairs as usize)?;
        let mut axes: Vec<Axis> = Vec::new();
        for (code, bins) in [(feature_1, bins_1), (feature_2, bins_2), (feature_3, bins_3)] {
            let Some(&feature) = self.features().get(code as usize) else { continue };
            if axes.iter().all(|axis| axis.feature != feature) {
                axes.push(Axis { feature, bins, full_turn: false });
            }
        }
        let choices = choices_of_bins(&axes);
        axes.iter_mut().for_each(|axis| axis.bins = bins_at(axis.bins, choices));
        let mut channel = StructureChannel {
            pairs,
            axes,
            is_joint: true,
            squash_milli: 0,
            radius_um: *radii(pairs).get(radius)?,
            shells_um: Vec::new(),
            least_um: *LEAST_DISTANCES.get(least)?,
            grid_um: if pairs == Pairs::Cloud { 0 } else { *GRIDS.get(grid)? },
            samples: *samples(pairs).get(sample)?,
            oriented: false,
            all_keypoints: false,
            metric: self.metric,
            value_weights: Vec::new(),
        };
        if channel.is_squashed() {
            channel.squash_milli = *SQUASHES.get(squash)?;
        }
        channel.shells_um = channel.equal_shells(*SHELLS.get(shells)?);
        Some(Weighted { channel, weight_ppm: *WEIGHTS.get(weight)?, scale: Scale::Quantile })
    }

    /// Undoes [`StructureSpace::decode`]: indices that stand for the structure, of each member in its first slots; `None`
    /// if it is not of this space.
    pub fn encode(&self, structure: &Structure) -> Option<Vec<u32>> {
        self.check().ok()?;
        let slots: Vec<[u32; FIELDS]> = structure.channels.iter().map(slot_of).collect::<Option<_>>()?;
        self.place(structure, &slots, &mut Vec::new())
    }

    /// Indices that begin with those `placed`, followed by these slots, and stand for the structure: whose member a channel
    /// is is not known, so that all divisions are tried.
    fn place(
        &self,
        structure: &Structure,
        slots: &[[u32; FIELDS]],
        placed: &mut Vec<[u32; FIELDS]>,
    ) -> Option<Vec<u32>> {
        let of_member = self.slots_of_member();
        let left = self.slots as usize - placed.len();
        if slots.len() > left {
            return None;
        }
        if left == 0 {
            let indices = placed.as_flattened();
            return (self.decode(indices).as_ref() == Some(structure)).then(|| indices.to_vec());
        }
        let before = placed.len();
        for count in (0..=of_member.min(slots.len())).rev() {
            placed.extend(&slots[..count]);
            placed.resize(before + of_member, [0; FIELDS]);
            let found = self.place(structure, &slots[count..], placed);
            placed.truncate(before);
            if found.is_some() {
                return found;
            }
        }
        None
    }

    /// Whether some structure of this space has a structure's only channel, whatever the channel weighs.
    pub(crate) fn has_channel(&self, single: &Structure) -> bool {
        let [Weighted { channel, .. }] = single.channels.as_slice() else { return false };
        let searched = Weighted { channel: channel.clone(), weight_ppm: WEIGHTS[0], scale: Scale::Quantile };
        let Some(slot) = slot_of(&searched) else { return false };
        let mut indices = slot.to_vec();
        indices.resize(self.slots as usize * FIELDS, 0);
        self.decode(&indices).is_some_and(|it| it.channels.len() == 1 && it.channels[0].channel == *channel)
    }
}

/// Takes bins until there are at most so many: one at a time from the feature with most, of equals the first of the lowest
/// slot. `None` if they cannot be that few.
fn reduce(channels: &mut [Weighted], max_bins: u32) -> Option<()> {
    let total = |channels: &[Weighted]| channels.iter().map(|it| it.channel.bins()).sum::<u64>();
    while total(channels) > u64::from(max_bins) {
        let axes = channels.iter_mut().flat_map(|it| &mut it.channel.axes);
        // Of equals `max_by_key` takes the last.
        let axes = axes.rev().filter(|axis| axis.bins > MIN_BINS);
        axes.max_by_key(|axis| axis.bins)?.bins -= 1;
    }
    Some(())
}

/// The fields of a slot that may stand for the channel.
fn slot_of(weighted: &Weighted) -> Option<[u32; FIELDS]> {
    let Weighted { channel, weight_ppm, .. } = weighted;
    let index = |values: &[u32], value: u32| Some(values.iter().position(|it| *it == value)? as u32);
    // Codes after the last feature are none.
    let (mut codes, mut bins) = ([CODES - 1; FEATURES], [0; FEATURES]);
    if channel.axes.len() > FEATURES {
        return None;
    }
    let choices = choices_of_bins(&channel.axes);
    for ((axis, code), bins) in channel.axes.iter().zip(&mut codes).zip(&mut bins) {
        *code = axis.feature.code();
        *bins = (0..CODES).find(|&index| bins_at(index, choices) == axis.bins)?;
    }
    let pairs = Pairs::ALL.iter().position(|pairs| *pairs == channel.pairs)? as u32;
    let squash = if channel.is_squashed() { index(&SQUASHES, channel.squash_milli)? } else { 0 };
    let grid = if channel.pairs == Pairs::Cloud { 0 } else { index(&GRIDS, channel.grid_um)? };
    let ([feature_1, feature_2, feature_3], [bins_1, bins_2, bins_3]) = (codes, bins);
    Some([
        1,
        pairs,
        feature_1,
        feature_2,
        feature_3,
        bins_1,
        bins_2,
        bins_3,
        squash,
        index(radii(channel.pairs), channel.radius_um)?,
        index(&SHELLS, channel.shells_um.len() as u32)?,
        index(&LEAST_DISTANCES, channel.least_um)?,
        grid,
        index(samples(channel.pairs), channel.samples)?,
        index(&WEIGHTS, *weight_ppm)?,
    ])
}

/// How many numbers of bins each of these features may have.
fn choices_of_bins(axes: &[Axis]) -> u32 {
    match axes {
        [Axis { feature: Feature::Distance, .. }] => LONE_BINS,
        _ => BINS,
    }
}

/// The number of bins at an index below [`CODES`], of so many.
fn bins_at(index: u32, choices: u32) -> u32 {
    MIN_BINS + index * choices / CODES
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::structure::testing::{point, structure};

    /// Indices of a slot that is a channel of one feature, `d`, and the least of all else.
    const SLOT: [u32; FIELDS] = [1, 0, 0, 31, 31, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];

    fn space(slots: u32, max_bins: u32) -> StructureSpace {
        StructureSpace { slots, max_bins, ..StructureSpace::default() }
    }

    /// The channels of these slots, in a space with room for all of their bins.
    fn channels<const N: usize>(slots: [[u32; FIELDS]; N]) -> Vec<Weighted> {
        space(N as u32, 100_000).decode(slots.as_flattened()).unwrap().channels
    }

    /// One slot, `SLOT` but for these fields.
    fn with(changes: &[(usize, u32)]) -> [u32; FIELDS] {
        let mut slot = SLOT;
        changes.iter().for_each(|&(field, index)| slot[field] = index);
        slot
    }

    fn bins(weighted: &Weighted) -> Vec<u32> {
        weighted.channel.axes.iter().map(|axis| axis.bins).collect()
    }

    #[test]
    fn a_slot_has_51_bits() {
        let bits = |space: StructureSpace| -> u32 {
            space.fields().iter().map(|field| field.values.next_power_of_two().trailing_zeros()).sum()
        };
        assert_eq!(bits(StructureSpace::default()), 204);
        assert_eq!(bits(space(1, 500)), 51);
        assert_eq!(bits(StructureSpace { colour: false, ..space(1, 500) }), 49);
        let fields = space(2, 500).fields();
        let names: Vec<&str> = fields.iter().map(|field| field.gene.name).collect();
        assert_eq!((names[0], names[15], names.len()), ("s1_active", "s2_active", 30));
        for (field, gene) in fields.iter().zip(Structure::genes()) {
            assert_eq!(field.gene, gene);
        }
    }

    #[test]
    fn indices_are_positions_in_the_table() {
        let of = |changes: &[(usize, u32)]| channels([with(changes)])[0].clone();
        let plain = of(&[]);
        let expected = StructureChannel {
            pairs: Pairs::KeypointNeighbour,
            axes: vec![Axis { feature: Feature::Distance, bins: 3, full_turn: false }],
            is_joint: true,
            squash_milli: 0,
            radius_um: 10_000,
            shells_um: vec![10_000],
            least_um: 0,
            grid_um: 10_000,
            samples: 0,
            oriented: false,
            all_keypoints: false,
            metric: SetDistance::ChiSquared,
            value_weights: Vec::new(),
        };
        let expected = Weighted { channel: expected, weight_ppm: 50_000, scale: Scale::Quantile };
        assert_eq!(plain, expected);

        let neighbours = of(&[(1, 1), (9, 5), (10, 1), (11, 3), (12, 1), (13, 2), (14, 31)]);
        let channel = StructureChannel {
            pairs: Pairs::Neighbours,
            radius_um: 35_000,
            shells_um: vec![35_000, 70_000],
            least_um: 20_000,
            grid_um: 15_000,
            samples: 256,
            ..expected.channel.clone()
        };
        assert_eq!(neighbours, Weighted { channel, weight_ppm: 5_000_000, scale: Scale::Quantile });

        let cloud = of(&[(1, 3), (2, 10), (8, 4), (9, 6), (10, 1), (12, 3), (13, 3), (14, 16)]);
        let channel = StructureChannel {
            pairs: Pairs::Cloud,
            axes: vec![Axis { feature: Feature::C1, bins: 3, full_turn: false }],
            squash_milli: 800,
            radius_um: 200_000,
            shells_um: vec![100_000, 200_000],
            grid_um: 0,
            samples: 8192,
            ..expected.channel
        };
        assert_eq!(cloud, Weighted { channel, weight_ppm: 538_553, scale: Scale::Quantile });
    }

    #[test]
    fn bins_spread_over_their_codes() {
        let of = |second: u32, index: u32| bins(&channels([with(&[(3, second), (5, index)])])[0])[0];
        let lone: Vec<u32> = (0..32).map(|index| of(31, index)).collect();
        let one_of_two: Vec<u32> = (0..32).map(|index| of(1, index)).collect();
        for index in 0..32 {
            assert_eq!(lone[index as usize], 3 + index * 28 / 32);
            assert_eq!(one_of_two[index as usize], 3 + index * 11 / 32);
        }
        assert_eq!((lone[31], one_of_two[31]), (30, 13));
        // A lone feature that is not d.
        assert_eq!(bins(&channels([with(&[(2, 1), (5, 31)])])[0]), [13]);
    }

    #[test]
    fn a_feature_that_is_there_drops_out_with_its_bins() {
        let of = |codes: [u32; 3]| {
            let [first, second, third] = codes;
            let slot = with(&[(2, first), (3, second), (4, third), (5, 0), (6, 31), (7, 16)]);
            let channel = channels([slot])[0].channel.clone();
            channel.axes.iter().map(|axis| (axis.feature.code(), axis.bins)).collect::<Vec<_>>()
        };
        assert_eq!(of([1, 1, 2]), [(1, 3), (2, 8)]);
        assert_eq!(of([1, 2, 2]), [(1, 3), (2, 13)]);
        assert_eq!(of([1, 25, 2]), [(1, 3), (2, 8)]);
        assert_eq!(of([2, 1, 31]), [(2, 3), (1, 13)]);
        assert_eq!(of([3, 3, 3]), [(3, 3)]);
        // What is left is a lone d: other numbers of bins.
        assert_eq!(bins(&channels([with(&[(3, 0), (4, 30), (5, 31)])])[0]), [30]);
    }

    #[test]
    fn without_colour_other_codes_are_none() {
        let space = StructureSpace { colour: false, ..space(1, 500) };
        for code in 0..32 {
            let structure = space.decode(&with(&[(3, code)])).unwrap();
            let features = if (1..7).contains(&code) { 2 } else { 1 };
            assert_eq!(structure.channels[0].channel.axes.len(), features, "{code}");
        }
        assert_eq!(space.decode(&with(&[(2, 7)])), None);
    }

    #[test]
    fn the_first_slot_is_active_if_none_is() {
        let none = [with(&[(0, 0), (2, 3)]), with(&[(0, 0)])];
        let first = [with(&[(2, 3)]), with(&[(0, 0)])];
        assert_eq!(channels(none), channels(first));
        assert_eq!(channels([with(&[(0, 0)]), with(&[(2, 3)])]), channels([with(&[(2, 3)])]));
    }

    #[test]
    fn a_channel_without_pairs_drops_out() {
        // 1 cm, and from 1 or 2 cm on; pairs of neighbours may be 2 cm apart.
        let (empty, other) = (with(&[(11, 2)]), with(&[(2, 3)]));
        assert_eq!(channels([empty, other]), channels([other]));
        assert_eq!(channels([other, with(&[(11, 3)])]), channels([other]));
        assert_eq!(channels([with(&[(1, 1), (11, 2)]), other]).len(), 2);
        assert_eq!(channels([with(&[(1, 1), (11, 3)]), other]).len(), 1);
        assert_eq!(channels([empty, empty]), channels([SLOT]));
        // Bins are taken as if it were there.
        let wide = with(&[(3, 1), (4, 2), (5, 31), (6, 31), (7, 31), (11, 2)]);
        let space = space(2, 216);
        let beside = space.decode(&[wide, with(&[(5, 31)])].concat()).unwrap();
        assert_eq!(bins(&beside.channels[0]), [6]);
    }

    #[test]
    fn the_least_max_bins_is_what_every_genome_fits() {
        assert_eq!(
            space(4, 100).check().unwrap_err().to_string(),
            "max_bins: must be at least 216 for 4 slots, got 100\nraise it, or search with fewer slots"
        );
        assert_eq!(
            space(1, 53).check().unwrap_err().to_string(),
            "max_bins: must be at least 54 for 1 slot, got 53\nraise it, or search with fewer slots"
        );
        for slots in [0, 9, u32::MAX] {
            let error = space(slots, u32::MAX).check().unwrap_err().to_string();
            assert_eq!(
                error,
                format!("slots: must be 1 to 8, got {slots}\nchoose the largest number of channels")
            );
        }
        let widest = with(&[(1, 3), (3, 1), (4, 2), (5, 31), (6, 31), (7, 31), (10, 1)]);
        let structure = space(4, 216).decode(&[widest; 4].concat()).unwrap();
        assert!(structure.channels.iter().all(|it| bins(it) == [3; 3] && it.channel.bins() == 54));
        assert_eq!(space(4, 215).decode(&[widest; 4].concat()), None);
        assert_eq!(space(4, 215).encode(&structure), None);
    }

    #[test]
    fn what_is_no_genome_decodes_to_nothing() {
        let space = space(1, 500);
        assert_eq!(space.decode(&SLOT[..14]), None);
        assert_eq!(space.decode(&[SLOT, SLOT].concat()), None);
        for (place, field) in space.fields().iter().enumerate() {
            assert_eq!(space.decode(&with(&[(place, field.values)])), None, "{}", field.gene.name);
            assert!(space.decode(&with(&[(place, field.values - 1)])).is_some(), "{}", field.gene.name);
        }
    }

    /// The number of bins after each step of the definition, from those of the features of each slot, in its shells.
    fn reduced(mut slots: Vec<(Vec<u32>, u32)>, max_bins: u32) -> Vec<Vec<u32>> {
        while slots.iter().map(|(bins, shells)| bins.iter().product::<u32>() * shells).sum::<u32>() > max_bins
        {
            let most = slots.iter().flat_map(|(bins, _)| bins).copied().max().unwrap();
            let first = slots.iter_mut().flat_map(|(bins, _)| bins).find(|bins| **bins == most).unwrap();
            *first -= 1;
        }
        slots.into_iter().map(|(bins, _)| bins).collect()
    }

    proptest! {
        #[test]
        fn every_genome_is_a_structure_of_its_space((space, indices) in point()) {
            let structure = space.decode(&indices).unwrap();
            prop_assert_eq!(structure.check(), Ok(()));
            let total: u64 = structure.channels.iter().map(|it| it.channel.bins()).sum();
            prop_assert!(total <= u64::from(space.max_bins));
            prop_assert!(structure.channels.len() <= space.slots as usize);
            prop_assert!(structure.channels.iter().all(|it| it.channel.metric == space.metric));
            prop_assert!(space.colour || !structure.channels.iter().any(|it| it.channel.needs_colour()));

            let encoded = space.encode(&structure).unwrap();
            prop_assert!(encoded.iter().zip(space.fields()).all(|(index, field)| *index < field.values));
            prop_assert_eq!(space.decode(&encoded), Some(structure.clone()));
            prop_assert!(space.encode(&structure).is_some());

            let mut other = structure.clone();
            other.channels[0].weight_ppm += 1;
            prop_assert!(space.encode(&other).is_none());
            let mut other = structure;
            other.channels[0].channel.oriented = true;
            prop_assert!(space.encode(&other).is_none());
        }

        #[test]
        fn structures_of_a_space_are_those_that_it_decodes(
            (space, indices) in point(), structure in structure(),
        ) {
            if let Some(indices) = space.encode(&structure) {
                prop_assert_eq!(space.decode(&indices), Some(structure));
            }
            // Of another space: more of everything.
            let larger = StructureSpace { colour: true, slots: 8, members: 1, max_bins: 40_000, ..space };
            let structure = space.decode(&indices).unwrap();
            prop_assert!(larger.encode(&structure).is_some());
        }

        #[test]
        fn bins_are_taken_from_the_feature_with_most((space, indices) in point()) {
            let space = StructureSpace { members: 1, ..space };
            let room = StructureSpace { max_bins: u32::MAX, ..space.clone() };
            // Each has pairs, so that all are there before and after.
            let mut indices = indices;
            indices.chunks_exact_mut(FIELDS).for_each(|slot| slot[11] = 0);
            let before = room.decode(&indices).unwrap().channels;
            let before = before.iter().map(|it| (bins(it), it.channel.shells_um.len() as u32)).collect();
            let after: Vec<Vec<u32>> = space.decode(&indices).unwrap().channels.iter().map(bins).collect();
            prop_assert_eq!(after, reduced(before, space.max_bins));
        }
    }
}
