//! Structures, channels and spaces as numbers: the canonical bytes without tag and version.

use std::slice;

use crate::distance::SetDistance;
use crate::structure::check::StructureError;
use crate::structure::{Axis, Feature, Pairs, Scale, Structure, StructureChannel, StructureSpace, Weighted};

impl Structure {
    /// The canonical numbers: how many channels there are, then weight, scale and [`StructureChannel::numbers`] of each.
    /// Equal for equal structures only.
    pub fn numbers(&self) -> Vec<u32> {
        let mut numbers = vec![self.channels.len() as u32];
        for Weighted { channel, weight_ppm, scale } in &self.channels {
            numbers.extend([*weight_ppm, *scale as u32]);
            numbers.extend(channel.numbers());
        }
        numbers
    }

    /// Undoes [`Structure::numbers`].
    ///
    /// # Errors
    /// If the numbers are no structure that any experiment may use.
    pub fn from_numbers(numbers: &[u32]) -> Result<Self, StructureError> {
        let mut rest = Numbers(numbers.iter());
        let count = rest.count("channel", Self::MAX_CHANNELS)?;
        let channels = (1..=count).map(|number| rest.weighted().map_err(|error| error.in_channel(number)));
        let structure = Self { channels: channels.collect::<Result<_, _>>()? };
        rest.end()?;
        structure.check()?;
        Ok(structure)
    }
}

impl StructureChannel {
    /// The canonical numbers. Equal for equal channels only, and none begins with those of another.
    pub fn numbers(&self) -> Vec<u32> {
        let mut numbers = vec![self.pairs as u32, self.axes.len() as u32];
        for Axis { feature, bins, full_turn } in &self.axes {
            numbers.extend([feature.code(), *bins, u32::from(*full_turn)]);
        }
        let has_weights = !self.value_weights.is_empty();
        numbers.push(u32::from(self.is_joint) + 2 * u32::from(has_weights));
        numbers.extend([self.squash_milli, self.radius_um]);
        numbers.push(self.shells_um.len() as u32);
        numbers.extend(&self.shells_um);
        numbers.extend([self.least_um, self.grid_um, self.samples]);
        let normals = u32::from(self.oriented) + 2 * u32::from(self.all_keypoints);
        numbers.extend([normals, metric_code(self.metric)]);
        if has_weights {
            // Two a number: a task has room for 4 KiB of a descriptor.
            numbers.push(self.value_weights.len() as u32);
            let second = |two: &[u16]| two.get(1).map_or(0, |&weight| u32::from(weight) << 16);
            numbers.extend(self.value_weights.chunks(2).map(|two| u32::from(two[0]) | second(two)));
        }
        numbers
    }
}

impl StructureSpace {
    /// The canonical numbers. Equal for equal spaces only.
    pub fn numbers(&self) -> Vec<u32> {
        let &Self { colour, slots, members, max_bins, metric } = self;
        // One member adds nothing: spaces of before there was a choice keep their bytes.
        let first = u32::from(colour) + 2 * (members.max(1) - 1);
        vec![first, slots, max_bins, metric_code(metric)]
    }

    /// Undoes [`StructureSpace::numbers`].
    ///
    /// # Errors
    /// If the numbers are no space that an experiment may search.
    pub fn from_numbers(numbers: &[u32]) -> Result<Self, StructureError> {
        let mut rest = Numbers(numbers.iter());
        let first = rest.next("colour")?;
        let space = Self {
            colour: first % 2 == 1,
            slots: rest.next("slots")?,
            members: first / 2 + 1,
            max_bins: rest.next("max_bins")?,
            metric: rest.choice("metric", SetDistance::ALL)?,
        };
        rest.end()?;
        space.check()?;
        Ok(space)
    }
}

/// Position among all set distances.
fn metric_code(metric: SetDistance) -> u32 {
    metric as u32
}

const SAME_RELEASE: &str = "use programs of the same release";

/// Numbers that are still to be read.
struct Numbers<'a>(slice::Iter<'a, u32>);

impl Numbers<'_> {
    fn next(&mut self, key: &'static str) -> Result<u32, StructureError> {
        let missing = || StructureError::new(key, "a number expected, got the end", SAME_RELEASE);
        self.0.next().copied().ok_or_else(missing)
    }

    /// One of these values, by its position.
    fn choice<T: Copy, const N: usize>(
        &mut self,
        key: &'static str,
        values: [T; N],
    ) -> Result<T, StructureError> {
        let code = self.next(key)?;
        let unknown =
            || StructureError::new(key, format!("a code below {N} expected, got {code}"), SAME_RELEASE);
        values.get(code as usize).copied().ok_or_else(unknown)
    }

    /// How many there are of something, at most so many.
    fn count(&mut self, key: &'static str, most: usize) -> Result<usize, StructureError> {
        let got = self.next(key)? as usize;
        let too_many =
            || StructureError::new(key, format!("at most {most} expected, got {got}"), SAME_RELEASE);
        (got <= most).then_some(got).ok_or_else(too_many)
    }

    fn weighted(&mut self) -> Result<Weighted, StructureError> {
        Ok(Weighted {
            weight_ppm: self.next("weight")?,
            scale: self.choice("scale", Scale::ALL)?,
            channel: self.channel()?,
        })
    }

    fn channel(&mut self) -> Result<StructureChannel, StructureError> {
        let (has_weights, all_keypoints);
        let mut channel = StructureChannel {
            pairs: self.choice("pairs", Pairs::ALL)?,
            axes: {
                let axes = self.count("features", StructureChannel::MAX_AXES)?;
                (0..axes).map(|_| self.axis()).collect::<Result<_, _>>()?
            },
            is_joint: {
                let choices = [(false, false), (true, false), (false, true), (true, true)];
                let (is_joint, weights) = self.choice("side_by_side", choices)?;
                has_weights = weights;
                is_joint
            },
            squash_milli: self.next("squash")?,
            radius_um: self.next("radius_cm")?,
            shells_um: {
                let shells = self.count("shells_cm", StructureChannel::MAX_SHELLS)?;
                (0..shells).map(|_| self.next("shells_cm")).collect::<Result<_, _>>()?
            },
            least_um: self.next("least_cm")?,
            grid_um: self.next("grid_cm")?,
            samples: self.next("samples")?,
            oriented: {
                let choices = [(false, false), (true, false), (false, true), (true, true)];
                let (oriented, all) = self.choice("normals_only", choices)?;
                all_keypoints = all;
                oriented
            },
            all_keypoints,
            metric: self.choice("metric", SetDistance::ALL)?,
            value_weights: Vec::new(),
        };
        if has_weights {
            channel.value_weights = self.value_weights()?;
        }
        Ok(channel)
    }

    /// At least one; the second of the last number is 0 if there is none.
    fn value_weights(&mut self) -> Result<Vec<u16>, StructureError> {
        let wrong = |what: String| Err(StructureError::new("value_weights", what, SAME_RELEASE));
        let count = self.count("value_weights", Structure::MAX_VALUE_WEIGHTS)?;
        if count == 0 {
            return wrong("at least 1 expected, got 0".to_owned());
        }
        let mut weights = Vec::with_capacity(count + 1);
        for _ in 0..count.div_ceil(2) {
            let two = self.next("value_weights")?;
            weights.extend([two as u16, (two >> 16) as u16]);
        }
        match weights.get(count) {
            Some(&got) if got > 0 => wrong(format!("0 after the last expected, got {got}")),
            _ => {
                weights.truncate(count);
                Ok(weights)
            }
        }
    }

    fn axis(&mut self) -> Result<Axis, StructureError> {
        Ok(Axis {
            feature: self.choice("features", Feature::ALL)?,
            bins: self.next("features")?,
            full_turn: self.choice("features", [false, true])?,
        })
    }

    /// That nothing is left.
    fn end(&self) -> Result<(), StructureError> {
        let got = self.0.len();
        let what = || format!("the end of the numbers expected, got {got} more");
        if got == 0 { Ok(()) } else { Err(StructureError::new("channel", what(), SAME_RELEASE)) }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use proptest::sample::Index;

    use super::*;
    use crate::structure::testing::{altered, point, space, structure};

    #[test]
    fn codes_are_positions() {
        for (code, metric) in (0..).zip(SetDistance::ALL) {
            assert_eq!(metric_code(metric), code);
        }
        for (code, scale) in (0..).zip(Scale::ALL) {
            assert_eq!(scale as u32, code);
        }
        for (code, pairs) in (0..).zip(Pairs::ALL) {
            assert_eq!(pairs as u32, code);
        }
    }

    #[test]
    fn known_numbers() {
        let channel = StructureChannel {
            pairs: Pairs::Cloud,
            axes: vec![
                Axis { feature: Feature::Distance, bins: 5, full_turn: false },
                Axis { feature: Feature::Angle, bins: 60, full_turn: true },
            ],
            is_joint: false,
            squash_milli: 0,
            radius_um: 200_000,
            shells_um: vec![100_000, 200_000],
            least_um: 5_000,
            grid_um: 0,
            samples: 8192,
            oriented: false,
            all_keypoints: false,
            metric: SetDistance::L1,
            value_weights: Vec::new(),
        };
        let numbers = vec![3, 2, 0, 5, 0, 1, 60, 1, 0, 0, 200_000, 2, 100_000, 200_000, 5_000, 0, 8192, 0, 1];
        assert_eq!(channel.numbers(), numbers);
        let weighted = StructureChannel { value_weights: vec![10_000, 0, 7], ..channel.clone() };
        let mut with_weights = numbers.clone();
        with_weights[8] = 2;
        with_weights.extend([3, 10_000, 7]);
        assert_eq!(weighted.numbers(), with_weights);
        let structure = Structure { channels: vec![Weighted { channel, weight_ppm: 7, scale: Scale::None }] };
        assert_eq!(structure.numbers(), [vec![1, 7, 1], numbers].concat());
        assert_eq!(StructureSpace::default().numbers(), [1, 4, 500, 0]);
        let of_members = StructureSpace { slots: 8, members: 4, ..StructureSpace::default() };
        assert_eq!(of_members.numbers(), [7, 8, 500, 0]);
    }

    /// Of 4 KiB, which a task has room for (`MAX_DESCRIPTOR_BYTES` of crate `proto`).
    #[test]
    fn the_largest_structure_fits_a_task() {
        let axes = Feature::ALL.map(|feature| Axis { feature, bins: 2, full_turn: false });
        let mut channel = StructureChannel {
            pairs: Pairs::Neighbours,
            axes: axes[..StructureChannel::MAX_AXES].to_vec(),
            is_joint: false,
            squash_milli: 0,
            radius_um: 80_000,
            shells_um: (1..=8).map(|shell| shell * 20_000).collect(),
            least_um: 1,
            grid_um: 20_000,
            samples: 1,
            oriented: false,
            all_keypoints: false,
            metric: SetDistance::L1,
            value_weights: Vec::new(),
        };
        channel.squash_milli = if channel.is_squashed() { 300 } else { 0 };
        let weighted = |values: usize| {
            let mut value_weights = vec![StructureChannel::FULL; values];
            value_weights[0] = 0;
            let channel = StructureChannel { value_weights, ..channel.clone() };
            Weighted { channel, weight_ppm: 1, scale: Scale::None }
        };
        // Three channels of 256 values, one of 224, and four without weights.
        let plain = Weighted { channel: channel.clone(), weight_ppm: 1, scale: Scale::None };
        let mut few = weighted(224);
        few.channel.axes.pop();
        let mut structure = Structure { channels: vec![weighted(256), weighted(256), weighted(256), few] };
        structure.channels.resize(8, plain);
        assert_eq!(structure.check(), Ok(()));
        let weights: usize = structure.channels.iter().map(|one| one.channel.value_weights.len()).sum();
        assert_eq!(weights, 992);
        assert!(4 * structure.numbers().len() + 2 <= 4 << 10, "{} numbers", structure.numbers().len());
        structure.channels[4] = weighted(256);
        assert_eq!(
            structure.check().unwrap_err().to_string(),
            "value_weights: must be at most 1000 in all channels together, got 1248\nleave those of the largest channel out"
        );
    }

    #[test]
    fn what_is_wrong_is_told_with_its_channel() {
        let structure = Structure::from_numbers(&[1, 7, 1, 9]);
        assert_eq!(
            structure.unwrap_err().to_string(),
            "channel 1: pairs: a code below 4 expected, got 9\nuse programs of the same release"
        );
        assert_eq!(
            Structure::from_numbers(&[9]).unwrap_err().to_string(),
            "channel: at most 8 expected, got 9\nuse programs of the same release"
        );
        assert_eq!(
            Structure::from_numbers(&[0]).unwrap_err().to_string(),
            "channel: there must be 1 to 8, got 0\nwrite one [[channel]] for each"
        );
        assert_eq!(
            StructureSpace::from_numbers(&[1, 4, 100, 0]).unwrap_err().to_string(),
            "max_bins: must be at least 216 for 4 slots, got 100\nraise it, or search with fewer slots"
        );
        assert!(Structure::from_numbers(&[]).is_err());
    }

    proptest! {
        #[test]
        fn numbers_give_the_structure_back(structure in structure()) {
            let numbers = structure.numbers();
            prop_assert_eq!(Structure::from_numbers(&numbers), Ok(structure));
            for length in 0..numbers.len() {
                prop_assert!(Structure::from_numbers(&numbers[..length]).is_err(), "cut to {}", length);
            }
            prop_assert!(Structure::from_numbers(&[numbers.as_slice(), &[0]].concat()).is_err());
        }

        #[test]
        fn numbers_of_searched_structures_do_so_too((space, indices) in point()) {
            let structure = space.decode(&indices).unwrap();
            prop_assert_eq!(Structure::from_numbers(&structure.numbers()), Ok(structure));
        }

        #[test]
        fn other_numbers_are_refused_or_another_structure(
            structure in structure(), place in any::<Index>(), by in 0u32..8, to in any::<u32>(),
        ) {
            let numbers = altered(structure.numbers(), place, by, to);
            if let Ok(other) = Structure::from_numbers(&numbers) {
                prop_assert_eq!(other.check(), Ok(()));
                prop_assert_eq!(other.numbers(), numbers);
                prop_assert_ne!(other, structure);
            }
        }

        #[test]
        fn any_numbers_are_refused_or_canonical(numbers in prop::collection::vec(prop_oneof![0u32..9, any::<u32>()], 0..60)) {
            if let Ok(structure) = Structure::from_numbers(&numbers) {
                prop_assert_eq!(structure.numbers(), numbers);
            }
        }

        #[test]
        fn numbers_give_the_space_back(
            space in space(), place in any::<Index>(), by in 0u32..8, to in any::<u32>(),
        ) {
            let numbers = space.numbers();
            prop_assert_eq!(StructureSpace::from_numbers(&numbers), Ok(space.clone()));
            for length in 0..numbers.len() {
                prop_assert!(StructureSpace::from_numbers(&numbers[..length]).is_err());
            }
            prop_assert!(StructureSpace::from_numbers(&[numbers.as_slice(), &[0]].concat()).is_err());
            let numbers = altered(numbers, place, by, to);
            if let Ok(other) = StructureSpace::from_numbers(&numbers) {
                prop_assert_eq!(other.numbers(), numbers);
                prop_assert_ne!(other, space);
            }
        }
    }
}
