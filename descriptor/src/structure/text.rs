//! Structures as text for people: a line that says what each channel does.

use std::fmt;

use crate::distance::SetDistance;
use crate::structure::check::centimetres;
use crate::structure::{Axis, Pairs, Scale, Structure, StructureChannel, Weighted};

impl fmt::Display for Axis {
    /// Feature and bins, as structure files have them: `hue 6`, or `angle 60 over 360`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.feature, self.bins)?;
        if self.full_turn { f.write_str(" over 360") } else { Ok(()) }
    }
}

impl fmt::Display for StructureChannel {
    /// Such as `neighbours f1 5·f2 5·f3 5, 5 cm, all pairs, grid 2 cm`. Between joint features is a dot, between those
    /// side by side a bar. What has its plain value is left out: a single shell up to the longest distance, pairs from 0,
    /// points without a normal where they do no harm, keypoints without one where they do, χ².
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.pairs.name())?;
        let mut before = " ";
        for axis in &self.axes {
            write!(f, "{before}{axis}")?;
            before = if self.is_joint { "·" } else { " | " };
        }
        if self.squash_milli > 0 {
            write!(f, " (s {})", f64::from(self.squash_milli) / 1000.0)?;
        }
        write!(f, ", {} cm", centimetres(self.radius_um))?;
        match self.shells_um.as_slice() {
            [only] if *only == self.longest_um() => {}
            shells if shells.len() > 1 && self.has_equal_shells() => write!(f, ", {} shells", shells.len())?,
            shells => {
                let bounds: Vec<String> = shells.iter().map(|&um| centimetres(um).to_string()).collect();
                let (plural, bounds) = (if shells.len() == 1 { "" } else { "s" }, bounds.join(" "));
                write!(f, ", shell{plural} to {bounds} cm")?;
            }
        }
        if self.least_um > 0 {
            write!(f, ", from {} cm", centimetres(self.least_um))?;
        }
        match self.samples {
            0 if self.pairs.is_sampled() => f.write_str(", all pairs")?,
            0 => {}
            samples => write!(f, ", {samples} pairs")?,
        }
        if self.pairs != Pairs::Cloud {
            write!(f, ", grid {} cm", centimetres(self.grid_um))?;
        }
        if self.oriented {
            f.write_str(", normals only")?;
        }
        if self.all_keypoints {
            f.write_str(", all keypoints")?;
        }
        if self.metric != SetDistance::default() {
            write!(f, ", {}", self.metric.name())?;
        }
        if !self.value_weights.is_empty() {
            // They are too many to be told; other weights have another digest.
            let bytes: Vec<u8> = self.value_weights.iter().flat_map(|weight| weight.to_le_bytes()).collect();
            let digest = blake3::hash(&bytes).to_hex();
            write!(f, ", values weighted {}", &digest[..8])?;
        }
        Ok(())
    }
}

impl fmt::Display for Weighted {
    /// The channel, `unscaled` if its distances are, and its weight.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.channel)?;
        if self.scale == Scale::None {
            f.write_str(", unscaled")?;
        }
        let weight = f64::from(self.weight_ppm) / 1e6;
        // With a point, so that a weight does not look like a count.
        if weight.fract() == 0.0 { write!(f, ", weight {weight:.1}") } else { write!(f, ", weight {weight}") }
    }
}

impl fmt::Display for Structure {
    /// Its channels, in order.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut before = "";
        for weighted in &self.channels {
            write!(f, "{before}{weighted}")?;
            before = " + ";
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use proptest::sample::Index;

    use super::*;
    use crate::structure::Feature;
    use crate::structure::testing::{altered, structure};

    fn axes(axes: &[(Feature, u32)]) -> Vec<Axis> {
        axes.iter().map(|&(feature, bins)| Axis { feature, bins, full_turn: false }).collect()
    }

    #[test]
    fn a_line_says_what_a_channel_does() {
        let cloud = StructureChannel {
            pairs: Pairs::Cloud,
            axes: axes(&[(Feature::Distance, 5), (Feature::C1, 6), (Feature::C2, 6)]),
            is_joint: true,
            squash_milli: 300,
            radius_um: 200_000,
            shells_um: vec![200_000],
            least_um: 0,
            grid_um: 0,
            samples: 8192,
            oriented: false,
            all_keypoints: false,
            metric: SetDistance::ChiSquared,
            value_weights: Vec::new(),
        };
        let near = StructureChannel {
            pairs: Pairs::KeypointNeighbour,
            axes: axes(&[(Feature::Hue, 6), (Feature::Saturation, 6)]),
            squash_milli: 0,
            radius_um: 50_000,
            shells_um: vec![25_000, 50_000],
            grid_um: 20_000,
            samples: 0,
            ..cloud.clone()
        };
        let side_by_side = StructureChannel {
            pairs: Pairs::Neighbours,
            axes: [
                axes(&[(Feature::L, 9)]),
                vec![Axis { feature: Feature::Angle, bins: 60, full_turn: true }],
            ]
            .concat(),
            is_joint: false,
            shells_um: vec![13_000, 36_000],
            least_um: 5_000,
            metric: SetDistance::L1,
            ..near.clone()
        };
        let short = StructureChannel { shells_um: vec![30_000], oriented: true, ..near.clone() };
        for (channel, text) in [
            (&cloud, "cloud d 5·c1 6·c2 6 (s 0.3), 20 cm, 8192 pairs"),
            (&near, "keypoint-neighbour hue 6·saturation 6, 5 cm, 2 shells, grid 2 cm"),
            (
                &side_by_side,
                "neighbours L 9 | angle 60 over 360, 5 cm, shells to 1.3 3.6 cm, from 0.5 cm, all pairs, grid 2 cm, l1",
            ),
            (&short, "keypoint-neighbour hue 6·saturation 6, 5 cm, shell to 3 cm, grid 2 cm, normals only"),
        ] {
            assert_eq!(channel.to_string(), text);
        }
        let structure = Structure {
            channels: vec![
                Weighted { channel: cloud, weight_ppm: 1_000_000, scale: Scale::Quantile },
                Weighted { channel: near, weight_ppm: 400_000, scale: Scale::None },
            ],
        };
        assert_eq!(
            structure.to_string(),
            "cloud d 5·c1 6·c2 6 (s 0.3), 20 cm, 8192 pairs, weight 1.0 + keypoint-neighbour hue 6·saturation 6, 5 cm, \
             2 shells, grid 2 cm, unscaled, weight 0.4"
        );
    }

    proptest! {
        #[test]
        fn other_structures_have_other_texts(
            structure in structure(), place in any::<Index>(), by in 0u32..8, to in any::<u32>(),
        ) {
            if let Ok(other) = Structure::from_numbers(&altered(structure.numbers(), place, by, to)) {
                prop_assert_ne!(other.to_string(), structure.to_string());
            }
        }
    }
}
