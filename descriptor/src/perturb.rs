//! Clouds as a worse camera, a greater distance, something in front of the object or another light would give them.
//!
//! What is drawn follows from the seed, the kind and the cloud's digest, not from the strength: a stronger perturbation of a
//! cloud goes further in the same way, so that points removed by a weak one are also removed by a stronger one.

use rand::RngExt;

use crate::cloud::Cloud;
use crate::random::stream;

/// A kind of perturbation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Perturbation {
    /// A normal deviate is added to each coordinate of each point; strength: its deviation, millimetres.
    Noise,
    /// Points drawn at random are removed; strength: how many of them, per cent.
    Density,
    /// The points beyond a plane are removed, whose direction is drawn from the sphere; strength: how many of them, per
    /// cent.
    Occlusion,
    /// Each channel of the colours is multiplied by a gain of its own, one for the cloud: with s the strength in per cent
    /// and u drawn from −1 to 1, 1 + u·s/100 or, for a u below 0, 1 / (1 − u·s/100).
    Light,
}

impl Perturbation {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Noise, Self::Density, Self::Occlusion, Self::Light];

    /// Its name on the command line and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Noise => "noise",
            Self::Density => "density",
            Self::Occlusion => "occlusion",
            Self::Light => "light",
        }
    }

    /// The one of this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// The unit of its strengths.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Noise => "mm",
            Self::Density | Self::Occlusion => "% removed",
            Self::Light => "% gain",
        }
    }

    /// Strengths that are measured, ascending; 0 would leave a cloud as it is.
    pub fn strengths(self) -> [f64; 4] {
        match self {
            Self::Noise => [0.5, 1.0, 2.0, 4.0],
            Self::Density => [25.0, 50.0, 75.0, 88.0],
            Self::Occlusion => [10.0, 25.0, 40.0, 60.0],
            Self::Light => [10.0, 25.0, 50.0, 100.0],
        }
    }

    /// The cloud, perturbed; its points stay in their order. In metres.
    pub fn apply(self, strength: f64, cloud: &Cloud, seed: u64, digest: &[u8; 32]) -> Cloud {
        if strength == 0.0 {
            return cloud.clone();
        }
        let mut draw = Draw::new(seed, self, digest);
        let share = strength / 100.0;
        match self {
            Self::Noise => {
                let deviation = strength / 1000.0;
                let mut moved = |coordinate: f32| (f64::from(coordinate) + deviation * draw.normal()) as f32;
                let points = cloud.points.iter().map(|point| point.map(&mut moved)).collect();
                Cloud { points, ..cloud.clone() }
            }
            Self::Density => {
                let order: Vec<u64> = cloud.points.iter().map(|_| draw.stream.random::<u64>()).collect();
                without_last(cloud, share, |point| order[point])
            }
            Self::Occlusion => {
                let [x, y, z] = [(); 3].map(|()| draw.normal());
                let along = |point: usize| {
                    let [a, b, c] = cloud.points[point].map(f64::from);
                    in_order(x * a + y * b + z * c)
                };
                without_last(cloud, share, along)
            }
            Self::Light => {
                let gains = [(); 3].map(|()| {
                    let u = draw.centred();
                    if u < 0.0 { 1.0 / (1.0 - u * share) } else { 1.0 + u * share }
                });
                let colours = cloud.colours.as_ref().map(|colours| {
                    let lit = |colour: &[u8; 3]| {
                        let of = |channel: usize| {
                            let value = f64::from(colour[channel]) * gains[channel] + 0.5;
                            if value < 255.0 { value as u8 } else { 255 }
                        };
                        [of(0), of(1), of(2)]
                    };
                    colours.iter().map(lit).collect()
                });
                Cloud { colours, ..cloud.clone() }
            }
        }
    }
}

/// A float as an integer of the same order.
fn in_order(value: f64) -> u64 {
    let bits = value.to_bits();
    if bits >> 63 == 1 { !bits } else { bits | 1 << 63 }
}

/// The cloud without the points that come last by some order, of equal ones the later; their number is the share of all,
/// rounded half up.
fn without_last(cloud: &Cloud, share: f64, order: impl Fn(usize) -> u64) -> Cloud {
    let count = cloud.points.len();
    let kept = count - ((count as f64 * share + 0.5) as usize).min(count);
    let mut sorted: Vec<(u64, usize)> = (0..count).map(|point| (order(point), point)).collect();
    sorted.sort_unstable();
    let mut points: Vec<usize> = sorted[..kept].iter().map(|&(_, point)| point).collect();
    points.sort_unstable();
    Cloud {
        points: points.iter().map(|&point| cloud.points[point]).collect(),
        colours: cloud.colours.as_ref().map(|colours| points.iter().map(|&point| colours[point]).collect()),
        viewpoint: cloud.viewpoint,
    }
}

struct Draw {
    stream: chacha20::ChaCha8Rng,
    /// The second of two deviates.
    next: Option<f64>,
}

impl Draw {
    fn new(seed: u64, kind: Perturbation, digest: &[u8; 32]) -> Self {
        let (words, _) = digest.as_chunks::<8>();
        let words: Vec<u64> = words.iter().map(|&word| u64::from_le_bytes(word)).collect();
        Self { stream: stream(seed, &format!("perturb {}", kind.name()), &words), next: None }
    }

    /// From −1 to 1, neither of which it is.
    fn centred(&mut self) -> f64 {
        (2.0 * f64::from(self.stream.random::<u32>()) + 1.0) / 4_294_967_296.0 - 1.0
    }

    /// Mean 0, deviation 1, by Marsaglia's polar method.
    fn normal(&mut self) -> f64 {
        if let Some(next) = self.next.take() {
            return next;
        }
        loop {
            let (u, v) = (self.centred(), self.centred());
            let s = u * u + v * v;
            if s > 0.0 && s < 1.0 {
                let factor = (-2.0 * libm::log(s) / s).sqrt();
                self.next = Some(v * factor);
                return u * factor;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::sheet;

    const POINTS: usize = 10_000;

    fn perturbed(kind: Perturbation, strength: f64, digest: u8) -> (Cloud, Cloud) {
        let cloud = sheet(3, POINTS);
        let perturbed = kind.apply(strength, &cloud, 7, &[digest; 32]);
        assert_eq!(perturbed.viewpoint, cloud.viewpoint);
        assert_eq!(perturbed.colours.as_ref().map(Vec::len), Some(perturbed.len()));
        (cloud, perturbed)
    }

    #[test]
    fn a_strength_of_nothing_changes_nothing_and_the_rest_follows_from_seed_cloud_and_kind() {
        for kind in Perturbation::ALL {
            let (cloud, same) = perturbed(kind, 0.0, 1);
            assert_eq!(cloud, same);
            let strength = kind.strengths()[1];
            let once = perturbed(kind, strength, 1).1;
            assert_eq!(once, perturbed(kind, strength, 1).1);
            assert_ne!(once, perturbed(kind, strength, 2).1);
            assert_ne!(once, kind.apply(strength, &cloud, 8, &[1; 32]));
            assert_ne!(once, cloud);
            assert!(kind.strengths().is_sorted() && kind.strengths()[0] > 0.0);
            assert_eq!(Perturbation::named(kind.name()), Some(kind));
            let nothing = kind.apply(strength, &Cloud::default(), 1, &[1; 32]);
            assert_eq!(nothing, Cloud::default());
        }
    }

    #[test]
    fn noise_has_the_moments_of_a_normal_distribution_along_each_axis() {
        for sigma in Perturbation::Noise.strengths() {
            let (cloud, moved) = perturbed(Perturbation::Noise, sigma, 1);
            assert_eq!(moved.colours, cloud.colours);
            for axis in 0..3 {
                let differences: Vec<f64> = cloud
                    .points
                    .iter()
                    .zip(&moved.points)
                    .map(|(a, b)| 1000.0 * (f64::from(b[axis]) - f64::from(a[axis])) / sigma)
                    .collect();
                let moment = |power: u32| {
                    let powers = differences.iter().map(|x| (0..power).fold(1.0, |product, _| product * x));
                    powers.sum::<f64>() / POINTS as f64
                };
                // Standard errors of these are 0.01, 0.014, 0.04 and 0.1 for so many.
                assert!(moment(1).abs() < 0.04, "{} {}", sigma, moment(1));
                assert!((moment(2) - 1.0).abs() < 0.06, "{} {}", sigma, moment(2));
                assert!(moment(3).abs() < 0.16, "{} {}", sigma, moment(3));
                assert!((moment(4) - 3.0).abs() < 0.4, "{} {}", sigma, moment(4));
            }
        }
    }

    /// Whether points are those of the other cloud, in its order, some left out.
    fn is_part(part: &Cloud, whole: &Cloud) -> bool {
        let mut rest = whole.points.iter().zip(whole.colours.iter().flatten());
        let points = part.points.iter().zip(part.colours.iter().flatten());
        points.into_iter().all(|point| rest.any(|other| other == point))
    }

    #[test]
    fn points_are_removed_by_their_share_and_stronger_ones_remove_more_of_the_same() {
        for kind in [Perturbation::Density, Perturbation::Occlusion] {
            let mut before = sheet(3, POINTS);
            for strength in kind.strengths() {
                let (_, kept) = perturbed(kind, strength, 1);
                assert_eq!(kept.len(), (POINTS as f64 * (1.0 - strength / 100.0)).round() as usize);
                assert!(is_part(&kept, &before), "{kind:?} {strength}");
                before = kept;
            }
            assert!(perturbed(kind, 100.0, 1).1.is_empty());
        }
    }

    #[test]
    fn an_occlusion_is_one_side_of_a_plane_and_a_lower_density_is_not() {
        // Each coordinate of what is left against that of all: a plane shifts the mean, chance does not.
        let shift = |kind: Perturbation, digest: u8| {
            let (cloud, kept) = perturbed(kind, 40.0, digest);
            let mean = |cloud: &Cloud, axis: usize| {
                cloud.points.iter().map(|point| f64::from(point[axis])).sum::<f64>() / cloud.len() as f64
            };
            (0..2).map(|axis| (mean(&kept, axis) - mean(&cloud, axis)).abs()).fold(0.0, f64::max)
        };
        let mean = |kind| (0..8).map(|digest| shift(kind, digest)).sum::<f64>() / 8.0;
        // The sheet is 12 cm wide: cut across, its middle moves by 2.4 cm.
        assert!(mean(Perturbation::Occlusion) > 0.008, "{}", mean(Perturbation::Occlusion));
        assert!(mean(Perturbation::Density) < 0.002, "{}", mean(Perturbation::Density));
        // Of a line of points in any direction one end goes.
        let points: Vec<[f32; 3]> = (0..100u16).map(|n| [f32::from(n), 2.0 * f32::from(n), 0.0]).collect();
        let line = Cloud { points, ..Cloud::default() };
        let kept = Perturbation::Occlusion.apply(25.0, &line, 1, &[5; 32]);
        assert_eq!(kept.len(), 75);
        assert!(kept.points == line.points[..75] || kept.points == line.points[25..]);
    }

    #[test]
    fn a_light_multiplies_each_channel_by_one_gain_within_its_bounds_and_clamps() {
        let shades = |value: u8| [value; 3];
        let colours: Vec<[u8; 3]> = (0..=255).map(shades).collect();
        let cloud = Cloud { points: vec![[0.0; 3]; 256], colours: Some(colours), viewpoint: [0.0; 3] };
        let mut clamped = 0;
        for strength in Perturbation::Light.strengths() {
            for digest in 0..20 {
                let lit = Perturbation::Light.apply(strength, &cloud, 1, &[digest; 32]);
                assert_eq!(lit.points, cloud.points);
                let colours = lit.colours.unwrap();
                for channel in 0..3 {
                    let values: Vec<f64> = colours.iter().map(|colour| f64::from(colour[channel])).collect();
                    let most = 1.0 + strength / 100.0;
                    // Each value bounds the gain from both sides, unless it is clamped.
                    let [mut low, mut high] = [1.0 / most, most];
                    for (value, lit) in (1..=255).map(f64::from).zip(&values[1..]) {
                        low = low.max((lit - 0.5) / value);
                        if *lit < 255.0 {
                            high = high.min((lit + 0.5) / value);
                        } else {
                            clamped += 1;
                        }
                    }
                    assert!(low <= high + 1e-12, "{strength} {low} {high}");
                    assert_eq!(values[0], 0.0);
                }
            }
        }
        assert!(clamped > 1000, "{clamped}");
        let colourless = Cloud { colours: None, ..cloud };
        assert_eq!(Perturbation::Light.apply(50.0, &colourless, 1, &[1; 32]), colourless);
    }

    #[test]
    fn bits_are_those_of_every_machine() {
        let digests = Perturbation::ALL.map(|kind| {
            let (_, cloud) = perturbed(kind, kind.strengths()[2], 9);
            let mut hasher = blake3::Hasher::new();
            for value in cloud.points.iter().flatten() {
                hasher.update(&value.to_le_bytes());
            }
            for colour in cloud.colours.iter().flatten() {
                hasher.update(colour);
            }
            hasher.finalize().to_hex()[..16].to_owned()
        });
        assert_eq!(digests, ["be8b5527e0bee80b", "bd07dad0802f2a9c", "ff61de39e10d9ed5", "1744b9ee993d240d"]);
    }
}
