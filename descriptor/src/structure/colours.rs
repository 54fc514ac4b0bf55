//! What features are made of colours: numbers of one point, from tables.

use std::array;
use std::sync::LazyLock;

use pulp::NullaryFnOnce;

use crate::colour::HueSaturation;
use crate::fixed::lab::Lab;
use crate::structure::feature::Feature;
use crate::wide::widest;

/// Logarithms of the values of a colour channel, in 2⁻¹⁶: round(2¹⁶ · ln(c + 2)).
static LOGS: LazyLock<[i32; 256]> = LazyLock::new(|| {
    array::from_fn(|channel| libm::round(65_536.0 * libm::log(channel as f64 + 2.0)) as i32)
});

/// Opponents of the log colour: red against green, and twice blue against both.
#[inline(always)]
fn opponents(logs: &[i32; 256], colour: [u8; 3]) -> [i32; 2] {
    let [r, g, b] = colour.map(|channel| logs[usize::from(channel)]);
    [r - g, 2 * b - r - g]
}

/// Means of the opponents over a cloud, rounded half up: what its light and its paint have in common.
pub(super) fn mean_opponents(colours: &[[u8; 3]]) -> [i32; 2] {
    let logs: &[i32; 256] = &LOGS;
    let mut sums = [0i64; 2];
    for &colour in colours {
        for (sum, opponent) in sums.iter_mut().zip(opponents(logs, colour)) {
            *sum += i64::from(opponent);
        }
    }
    let count = colours.len().max(1) as i64;
    sums.map(|sum| (2 * sum + count).div_euclid(2 * count) as i32)
}

/// Writes the number that a feature is made of, of each colour: the feature itself if it is one of a single point;
/// otherwise what is subtracted (logarithms and opponents) or divided (channels) in a pair.
///
/// Logarithms and what is made of them are whole numbers of 2⁻¹⁶, `c2`, `w2` and `o2` of half that: all are below 2²³ in
/// size, so that f32 holds them and their differences exactly.
pub(super) fn write_values(feature: Feature, colours: &[[u8; 3]], mean: [i32; 2], values: &mut [f32]) {
    widest(WriteValues { feature, colours, mean, values });
}

/// The kernel of [`write_values`].
struct WriteValues<'a> {
    feature: Feature,
    colours: &'a [[u8; 3]],
    mean: [i32; 2],
    values: &'a mut [f32],
}

impl NullaryFnOnce for WriteValues<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let mean = self.mean;
        match self.feature {
            Feature::Hue => self.each(|colour| HueSaturation::new(colour).hue),
            Feature::Saturation => self.each(|colour| HueSaturation::new(colour).saturation),
            Feature::Value => self.each(|[r, g, b]| f32::from(r.max(g).max(b))),
            Feature::C1 | Feature::O1 => self.opponent::<0>(0),
            Feature::C2 | Feature::O2 => self.opponent::<1>(0),
            Feature::W1 => self.opponent::<0>(mean[0]),
            Feature::W2 => self.opponent::<1>(mean[1]),
            Feature::L => self.lab::<0>(),
            Feature::A => self.lab::<1>(),
            Feature::B => self.lab::<2>(),
            Feature::LogRed => self.log::<0>(),
            Feature::LogGreen => self.log::<1>(),
            Feature::LogBlue => self.log::<2>(),
            Feature::RatioRed => self.channel::<0>(),
            Feature::RatioGreen => self.channel::<1>(),
            Feature::RatioBlue => self.channel::<2>(),
            Feature::Distance
            | Feature::Angle
            | Feature::F1
            | Feature::F2
            | Feature::F3
            | Feature::A2
            | Feature::A3 => {} // made of no colour
        }
    }
}

impl WriteValues<'_> {
    #[inline(always)]
    fn channel<const CHANNEL: usize>(self) {
        self.each(|colour| f32::from(colour[CHANNEL]));
    }

    #[inline(always)]
    fn log<const CHANNEL: usize>(self) {
        let logs: &[i32; 256] = &LOGS;
        self.each(|colour| logs[usize::from(colour[CHANNEL])] as f32);
    }

    /// An opponent minus its mean.
    #[inline(always)]
    fn opponent<const WHICH: usize>(self, mean: i32) {
        let logs: &[i32; 256] = &LOGS;
        self.each(|colour| (opponents(logs, colour)[WHICH] - mean) as f32);
    }

    #[inline(always)]
    fn lab<const COMPONENT: usize>(self) {
        let tables = Lab::tables();
        self.each(|colour| tables.of(colour)[COMPONENT]);
    }

    /// Written in place: `collect` may stay a call, without wide vectors.
    #[inline(always)]
    fn each(self, value: impl Fn([u8; 3]) -> f32) {
        for (place, &colour) in self.values.iter_mut().zip(self.colours) {
            *place = value(colour);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_known_colours() {
        let of = |feature, colour: [u8; 3]| {
            let mut values = [f32::NAN; 2];
            write_values(feature, &[colour], [10, -7], &mut values);
            assert!(values[1].is_nan(), "one colour has one value");
            values[0]
        };
        // ln 2, ln 257 and ln 100.
        let [black, white, middle] = [45_426.0, 363_664.0, 301_804.0];
        assert_eq!(of(Feature::LogRed, [0, 255, 98]), black);
        assert_eq!(of(Feature::LogGreen, [0, 255, 98]), white);
        assert_eq!(of(Feature::LogBlue, [0, 255, 98]), middle);
        for (feature, expected) in [
            (Feature::C1, black - white),
            (Feature::O1, black - white),
            (Feature::W1, black - white - 10.0),
            (Feature::C2, 2.0 * middle - black - white),
            (Feature::O2, 2.0 * middle - black - white),
            (Feature::W2, 2.0 * middle - black - white + 7.0),
            (Feature::Value, 255.0),
            (Feature::RatioBlue, 98.0),
        ] {
            assert_eq!(of(feature, [0, 255, 98]), expected, "{feature}");
        }
    }

    #[test]
    fn the_mean_is_rounded_half_up() {
        let grey = [5, 5, 5];
        let of = |colours: &[[u8; 3]]| mean_opponents(colours);
        assert_eq!(of(&[]), [0, 0]);
        assert_eq!(of(&[grey]), [0, 0]);
        let [c1, c2] = opponents(&LOGS, [0, 1, 5]);
        assert!(c1 % 2 != 0 && c1 < 0, "halves show rounding: {c1}");
        assert_eq!(of(&[[0, 1, 5], grey])[0], (c1 + 1) / 2);
        assert_eq!(of(&[[1, 0, 5], grey])[0], (1 - c1) / 2);
        assert_eq!(of(&[[0, 1, 5]; 3]), [c1, c2]);
    }
}
