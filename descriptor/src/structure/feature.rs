//! Features: what the channels of structures bin of a pair of points.

use std::fmt;

/// A number that a pair of points, or the second of them, has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Feature {
    /// Distance of the points.
    Distance,
    /// Angle between the normals.
    Angle,
    /// First angle of the Darboux frame whose origin is the first point (PCL: `computePairFeatures`).
    F1,
    /// Its second: the cosine between the frame's v and the second normal.
    F2,
    /// Its third: the cosine between the first normal and the line of the points.
    F3,
    /// acos f2.
    A2,
    /// acos f3.
    A3,
    /// Hue of the second point.
    Hue,
    /// Its saturation.
    Saturation,
    /// Its value: the largest colour channel.
    Value,
    /// Red against green of the second point in log colour, lr − lg.
    C1,
    /// Blue against both, lb − (lr + lg)/2.
    C2,
    /// `C1` minus its mean over the cloud: the same under a light of any colour (grey world).
    W1,
    /// `C2` minus its mean over the cloud.
    W2,
    /// CIELab lightness of the second point, as SHOTCOLOR has it.
    L,
    /// CIELab a.
    A,
    /// CIELab b.
    B,
    /// Log of red, second point minus first.
    LogRed,
    /// Log of green, second minus first.
    LogGreen,
    /// Log of blue, second minus first.
    LogBlue,
    /// `C1`, second minus first.
    O1,
    /// `C2`, second minus first.
    O2,
    /// Ratio of red (PCL: `computeRGBPairFeatures`).
    RatioRed,
    /// Ratio of green.
    RatioGreen,
    /// Ratio of blue.
    RatioBlue,
}

/// Which values a feature has, and so where its bins begin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Range {
    /// Zero to the longest distance of the channel.
    Longest,
    /// 0 to 180 degrees, by the cosine.
    HalfTurn,
    /// −180 to 180 degrees.
    FullTurn,
    /// From the first to the second value.
    Fixed(f32, f32),
    /// Unbounded: squashed to ½ + ½·x/(|x| + s).
    Squashed,
}

impl Feature {
    /// All of them, in the order of their codes in a genome.
    pub const ALL: [Self; 25] = [
        Self::Distance,
        Self::Angle,
        Self::F1,
        Self::F2,
        Self::F3,
        Self::A2,
        Self::A3,
        Self::Hue,
        Self::Saturation,
        Self::Value,
        Self::C1,
        Self::C2,
        Self::W1,
        Self::W2,
        Self::L,
        Self::A,
        Self::B,
        Self::LogRed,
        Self::LogGreen,
        Self::LogBlue,
        Self::O1,
        Self::O2,
        Self::RatioRed,
        Self::RatioGreen,
        Self::RatioBlue,
    ];

    /// How many of [`Feature::ALL`] need no colour: the first.
    pub const COLOURLESS: usize = 7;

    /// Its name in files and in the text of a channel.
    pub fn name(self) -> &'static str {
        match self {
            Self::Distance => "d",
            Self::Angle => "angle",
            Self::F1 => "f1",
            Self::F2 => "f2",
            Self::F3 => "f3",
            Self::A2 => "a2",
            Self::A3 => "a3",
            Self::Hue => "hue",
            Self::Saturation => "saturation",
            Self::Value => "value",
            Self::C1 => "c1",
            Self::C2 => "c2",
            Self::W1 => "w1",
            Self::W2 => "w2",
            Self::L => "L",
            Self::A => "a",
            Self::B => "b",
            Self::LogRed => "lr",
            Self::LogGreen => "lg",
            Self::LogBlue => "lb",
            Self::O1 => "o1",
            Self::O2 => "o2",
            Self::RatioRed => "qr",
            Self::RatioGreen => "qg",
            Self::RatioBlue => "qb",
        }
    }

    /// The feature of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|feature| feature.name() == name)
    }

    /// Its code in a genome: its position in [`Feature::ALL`].
    pub fn code(self) -> u32 {
        self as u32
    }

    /// Whether it is nothing without colours.
    pub fn needs_colour(self) -> bool {
        self.code() as usize >= Self::COLOURLESS
    }

    /// Whether both points need a normal.
    pub fn needs_normals(self) -> bool {
        (Self::Angle..=Self::A3).contains(&self)
    }

    /// Whether it needs a Darboux frame, which points at one place or along the first normal do not have.
    pub fn needs_frame(self) -> bool {
        (Self::F1..=Self::A3).contains(&self)
    }

    /// Whether its values have no bounds, so that a channel with it has a squash.
    pub fn is_squashed(self) -> bool {
        self.range() == Range::Squashed
    }

    /// Which values it has.
    pub fn range(self) -> Range {
        match self {
            Self::Distance => Range::Longest,
            Self::Angle | Self::A2 | Self::A3 => Range::HalfTurn,
            Self::F1 => Range::FullTurn,
            Self::F2 | Self::F3 | Self::RatioRed | Self::RatioGreen | Self::RatioBlue => {
                Range::Fixed(-1.0, 1.0)
            }
            Self::Hue => Range::Fixed(0.0, 360.0),
            // As `HueSaturation` has it: in per cent.
            Self::Saturation => Range::Fixed(0.0, 100.0),
            Self::Value => Range::Fixed(0.0, 255.0),
            // As `Lab` has them.
            Self::L => Range::Fixed(0.0, 1.0),
            Self::A | Self::B => Range::Fixed(-1.0, 1.0),
            Self::C1
            | Self::C2
            | Self::W1
            | Self::W2
            | Self::LogRed
            | Self::LogGreen
            | Self::LogBlue
            | Self::O1
            | Self::O2 => Range::Squashed,
        }
    }
}

impl fmt::Display for Feature {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_positions_and_names_are_unique() {
        for (code, feature) in (0..).zip(Feature::ALL) {
            assert_eq!(feature.code(), code);
            assert_eq!(Feature::named(feature.name()), Some(feature));
        }
        assert_eq!(Feature::named("x"), None);
        assert_eq!(Feature::ALL.into_iter().filter(|feature| !feature.needs_colour()).count(), 7);
    }
}
