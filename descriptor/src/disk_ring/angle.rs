//! Exact classes of angles: where the shape bins of all descriptors of a gene table begin (DESIGN 5.5).

use std::cmp::Ordering;
use std::f64::consts::TAU;

/// An angle as a reduced fraction of a full turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Turn {
    /// Numerator.
    pub over: u32,
    /// Denominator, not 0.
    pub under: u32,
}

impl Turn {
    /// `over / under`, reduced, so that equal angles have one cosine.
    pub fn new(over: u32, under: u32) -> Self {
        let (mut divisor, mut rest) = (under, over);
        while rest != 0 {
            (divisor, rest) = (rest, divisor % rest);
        }
        Self { over: over / divisor, under: under / divisor }
    }

    /// Its cosine, from the pure-Rust libm: the same on every target.
    pub fn cosine(self) -> f64 {
        libm::cos(TAU * f64::from(self.over) / f64::from(self.under))
    }

    /// ⌊turn · parts⌋.
    fn of(self, parts: u32) -> u32 {
        (u64::from(self.over) * u64::from(parts) / u64::from(self.under)) as u32
    }

    fn order(&self, other: &Self) -> Ordering {
        (u64::from(self.over) * u64::from(other.under)).cmp(&(u64::from(other.over) * u64::from(self.under)))
    }
}

/// Where the bins of all given histogram sizes begin, up to half a turn, ascending, each once.
///
/// With n = shape_bins − 1, bin k begins at k/n of a turn (paper, eq. 2: ⌊angle·n/360⌋). The bounds cut the half turn
/// into classes, numbered by how many bounds an angle has reached; every bin is a union of them.
pub fn bounds(shape_bins: impl Iterator<Item = u32>) -> Vec<Turn> {
    let mut bounds: Vec<Turn> =
        shape_bins.flat_map(|bins| (1..=(bins - 1) / 2).map(move |k| Turn::new(k, bins - 1))).collect();
    bounds.sort_unstable_by(Turn::order);
    bounds.dedup();
    bounds
}

/// The shape bin of every class of `bounds`, which must hold those of `shape_bins`.
pub fn bin_of_class(bounds: &[Turn], shape_bins: u32) -> Vec<u16> {
    std::iter::once(0).chain(bounds.iter().map(|bound| bound.of(shape_bins - 1) as u16)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::stream;
    use crate::testing::unit;
    use crate::{GeneTable, Quantiser, oracle};

    #[test]
    fn bounds_are_every_fraction_once() {
        let thirds_and_quarters = bounds([4, 5, 9].into_iter());
        let expected = [(1, 8), (1, 4), (1, 3), (3, 8), (1, 2)].map(|(over, under)| Turn { over, under });
        assert_eq!(thirds_and_quarters, expected);
        assert_eq!(bin_of_class(&thirds_and_quarters, 5), [0, 0, 1, 1, 1, 2]);
        assert_eq!(bounds([2].into_iter()), []);
    }

    #[test]
    fn classes_give_the_bins_of_equation_2() {
        let quantiser = Quantiser::new(&GeneTable::paper()).unwrap();
        let bounds = bounds(8..=64);
        let bins: Vec<(u32, Vec<u16>)> = (8..=64).map(|n| (n, bin_of_class(&bounds, n))).collect();
        let mut rng = stream(1, "cosines", &[]);
        let small = [1.0, 1.000_000_1, 1.5, 0.999_999_9, 0.999, -0.999];
        let cosines = (0..20_000).map(|_| unit(&mut rng) * 2.0 - 1.0).chain(small);
        for cosine in cosines {
            let class = usize::from(quantiser.angle_class(cosine));
            for (n, bin_of_class) in &bins {
                assert_eq!(usize::from(bin_of_class[class]), oracle::shape_bin(cosine, *n), "{cosine}, {n}");
            }
        }
    }

    #[test]
    fn an_angle_on_the_edge_begins_the_bin() {
        let quantiser = Quantiser::new(&GeneTable::paper()).unwrap();
        let bounds = bounds(8..=64);
        for (cosine, degrees) in
            [(1.0f32, 0), (0.5, 60), (0.0, 90), (-0.5, 120), (-1.0, 180), (-1.000_000_1, 180)]
        {
            for n in 8..=64 {
                let bin = bin_of_class(&bounds, n)[usize::from(quantiser.angle_class(cosine))];
                assert_eq!(u32::from(bin), degrees * (n - 1) / 360, "{degrees} degrees, {n}");
            }
        }
    }
}
