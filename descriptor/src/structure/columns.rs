//! Structures in the columns of tables: the physical values of their genes.

use crate::distance::SetDistance;
use crate::structure::genes::{DEFAULT_SLOTS, FEATURES, FIELDS, GENES, SLOTS};
use crate::structure::{Axis, Feature, Pairs, Scale, Structure, StructureChannel, Weighted};

impl Structure {
    /// What it has in the columns of the genes of so many slots ([`Structure::genes`]), channel after channel; `None` for
    /// what nothing reads, in all columns of a slot without a channel but the first. `None` altogether for a structure
    /// that the columns cannot hold, such as one with more channels than slots, or with features side by side.
    pub fn values(&self, slots: usize) -> Option<Vec<Option<f64>>> {
        let empty = [Some(0)].into_iter().chain([None; FIELDS - 1]).collect::<Vec<Option<u32>>>();
        let mut ticks = self.channels.iter().map(ticks_of).collect::<Option<Vec<_>>>()?;
        if ticks.len() > slots || slots > SLOTS {
            return None;
        }
        ticks.resize(slots, empty);
        let ticks = ticks.into_iter().flatten();
        let values =
            GENES.as_flattened().iter().zip(ticks).map(|(spec, ticks)| ticks.map(|it| spec.value(it)));
        let values: Vec<Option<f64>> = values.collect();
        let metric = self.channels.first()?.channel.metric;
        (Self::from_values(&values, metric).as_ref() == Some(self)).then_some(values)
    }

    /// How many columns a table has for structures of so many slots.
    pub(crate) fn columns_of_slots(slots: usize) -> usize {
        slots.max(DEFAULT_SLOTS) * FIELDS
    }

    /// As [`Structure::values`], of at least four slots; nothing at all of what these columns cannot hold, as may be where a
    /// structure is written by hand.
    pub(crate) fn values_of_slots(&self, slots: usize) -> Vec<Option<f64>> {
        let slots = slots.max(DEFAULT_SLOTS);
        self.values(slots).unwrap_or_else(|| vec![None; slots * FIELDS])
    }

    /// Each channel by the ticks of its genes but the weight, as in [`Structure::values`], and its weight. Of a channel with
    /// more features than columns, the columns have none.
    pub fn channel_genes(&self) -> Vec<(Vec<Option<u32>>, f64)> {
        let genes = |one: &Weighted| {
            let mut ticks = ticks_of(one).unwrap_or_else(|| vec![None; FIELDS]);
            ticks.truncate(FIELDS - 1);
            (ticks, one.weight())
        };
        self.channels.iter().map(genes).collect()
    }

    /// Undoes [`Structure::values`] of any number of slots from 4, for structures whose channels compare rows by `metric`,
    /// which no column says; `None` if no structure has these values.
    pub fn from_values(values: &[Option<f64>], metric: SetDistance) -> Option<Self> {
        let (slots, rest) = values.as_chunks::<FIELDS>();
        if !rest.is_empty() || !(DEFAULT_SLOTS..=SLOTS).contains(&slots.len()) {
            return None;
        }
        let mut channels = Vec::new();
        for (specs, values) in GENES.iter().zip(slots) {
            let mut ticks = [None; FIELDS];
            for ((ticks, spec), value) in ticks.iter_mut().zip(specs).zip(values) {
                *ticks = value.map(|value| spec.ticks(value).ok_or(())).transpose().ok()?;
            }
            match ticks {
                [Some(0), rest @ ..] => rest.iter().all(Option::is_none).then_some(())?,
                [Some(1), ..] => channels.push(weighted_of(ticks, metric)?),
                _ => return None,
            }
        }
        let structure = Self { channels };
        structure.check().is_ok().then_some(structure)
    }
}

/// A channel in the columns of a slot; `None` if it has too many features.
fn ticks_of(weighted: &Weighted) -> Option<Vec<Option<u32>>> {
    let Weighted { channel, weight_ppm, .. } = weighted;
    let read = |ticks: u32, is_read: bool| is_read.then_some(ticks);
    let of_axes = |ticks: fn(&Axis) -> u32| {
        let mut axes = channel.axes.iter().map(ticks);
        [(); FEATURES].map(|()| axes.next())
    };
    let before = [Some(1), Some(channel.pairs as u32)];
    let after = [
        read(channel.squash_milli, channel.is_squashed()),
        Some(channel.radius_um),
        Some(channel.shells_um.len() as u32),
        Some(channel.least_um),
        read(channel.grid_um, channel.pairs != Pairs::Cloud),
        read(channel.samples, channel.pairs.is_sampled() && channel.samples > 0),
        Some(*weight_ppm),
    ];
    let axes = [of_axes(|axis| axis.feature.code()), of_axes(|axis| axis.bins)];
    let columns = before.into_iter().chain(axes.into_iter().flatten()).chain(after);
    (channel.axes.len() <= FEATURES).then(|| columns.collect())
}

/// The channel with these columns, not yet checked.
fn weighted_of(ticks: [Option<u32>; FIELDS], metric: SetDistance) -> Option<Weighted> {
    let [_, pairs, features @ .., squash, radius, shells, least, grid, samples, weight] = ticks;
    let [codes @ .., bins_1, bins_2, bins_3] = features;
    let mut axes = Vec::new();
    for axis in codes.into_iter().zip([bins_1, bins_2, bins_3]) {
        match axis {
            (Some(code), Some(bins)) => {
                axes.push(Axis { feature: *Feature::ALL.get(code as usize)?, bins, full_turn: false });
            }
            (None, None) => {}
            _ => return None,
        }
    }
    let mut channel = StructureChannel {
        pairs: *Pairs::ALL.get(pairs? as usize)?,
        axes,
        is_joint: true,
        squash_milli: squash.unwrap_or(0),
        radius_um: radius?,
        shells_um: Vec::new(),
        least_um: least?,
        grid_um: grid.unwrap_or(0),
        samples: samples.unwrap_or(0),
        oriented: false,
        all_keypoints: false,
        metric,
        value_weights: Vec::new(),
    };
    channel.shells_um = channel.equal_shells(shells.filter(|shells| (1..=2).contains(shells))?);
    Some(Weighted { channel, weight_ppm: weight?, scale: Scale::Quantile })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::structure::testing::{point, structure};

    #[test]
    fn known_values() {
        let channel = StructureChannel {
            pairs: Pairs::Neighbours,
            axes: vec![
                Axis { feature: Feature::O1, bins: 8, full_turn: false },
                Axis { feature: Feature::O2, bins: 9, full_turn: false },
            ],
            is_joint: true,
            squash_milli: 500,
            radius_um: 35_000,
            shells_um: vec![35_000, 70_000],
            least_um: 5_000,
            grid_um: 15_000,
            samples: 256,
            oriented: false,
            all_keypoints: false,
            metric: SetDistance::L1,
            value_weights: Vec::new(),
        };
        let structure =
            Structure { channels: vec![Weighted { channel, weight_ppm: 58_008, scale: Scale::Quantile }] };
        let values = structure.values(4).unwrap();
        let slot =
            [1.0, 1.0, 20.0, 21.0, f64::NAN, 8.0, 9.0, f64::NAN, 0.5, 3.5, 2.0, 0.5, 1.5, 256.0, 0.058008];
        let slot = slot.map(|value| Some(value).filter(|value| !value.is_nan()));
        let empty = [&[Some(0.0)][..], &[None; 14]].concat();
        assert_eq!(values, [&slot[..], &empty, &empty, &empty].concat());
        let six = structure.values(6).unwrap();
        assert_eq!(six, [&values[..], &empty, &empty].concat());
        assert_eq!([0, 9].map(|slots| structure.values(slots)), [None, None]);

        let genes = structure.channel_genes();
        let ticks = [1, 1, 20, 21, u32::MAX, 8, 9, u32::MAX, 500, 35_000, 2, 5_000, 15_000, 256];
        let ticks = ticks.map(|ticks| Some(ticks).filter(|&ticks| ticks < u32::MAX));
        assert_eq!(genes, [(ticks.to_vec(), 0.058008)]);

        let from_values = |values: &[_]| Structure::from_values(values, SetDistance::L1);
        assert_eq!(from_values(&values), Some(structure.clone()));
        assert_eq!(from_values(&six), Some(structure));
        assert_eq!([45, 59, 89].map(|count| from_values(&six[..count])), [None, None, None]);
        assert_eq!(from_values(&[&six[..], &empty, &empty, &empty].concat()), None);
        for (place, value) in [
            (0, None),
            (0, Some(2.0)),   // neither a channel nor none
            (1, Some(4.0)),   // no pairs
            (2, Some(25.0)),  // no feature
            (5, None),        // a feature without bins
            (7, Some(8.0)),   // bins without a feature
            (8, None),        // no squash
            (9, Some(1e-5)),  // between ticks
            (10, Some(1e9)),  // more shells than there are
            (11, Some(7.0)),  // no pairs left
            (14, Some(-1.0)), // no weight
            (20, Some(1.0)),  // of a slot without a channel
        ] {
            let mut values = values.clone();
            values[place] = value;
            assert_eq!(from_values(&values), None, "{place}: {value:?}");
        }
    }

    proptest! {
        #[test]
        fn values_give_searched_structures_back((space, indices) in point()) {
            let structure = space.decode(&indices).unwrap();
            let slots = DEFAULT_SLOTS.max(space.slots as usize);
            let values = structure.values(slots).unwrap();
            prop_assert_eq!(values.len(), slots * FIELDS);
            prop_assert_eq!(Structure::from_values(&values, space.metric), Some(structure));
        }

        #[test]
        fn values_give_others_back_or_there_are_none(structure in structure()) {
            if let Some(values) = structure.values(SLOTS) {
                let metric = structure.channels[0].channel.metric;
                prop_assert_eq!(Structure::from_values(&values, metric), Some(structure));
            }
        }
    }
}
