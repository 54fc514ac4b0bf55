//! Hue and saturation of the hexcone model, their bins, and classes fine enough for all of them (DESIGN 5.6).

/// Hue and saturation of a colour, in f32.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HueSaturation {
    /// Degrees, in [0, 360); 0 for grey.
    pub hue: f32,
    /// 0 to 100, which rounding may exceed by a step; 0 for black.
    pub saturation: f32,
}

impl HueSaturation {
    /// With channels from 0 to 1: S = 100 · (max − min)/max; H = 60° · (g − b)/(max − min) if red is the largest
    /// channel, and so on round the hexagon (Smith, Color gamut transform pairs, 1978).
    ///
    /// A colour can lie exactly on the edge of a bin (hue 45° and m = 8), and such colours are common enough to show
    /// in histograms. Then rounding decides: everything is f32 in the usual order, as a PCL user would write it.
    #[inline(always)]
    pub fn new(colour: [u8; 3]) -> Self {
        let [r, g, b] = [colour[0], colour[1], colour[2]].map(|channel| f32::from(channel) / 255.0);
        // Selects all the way, so that loops over colours become vectors.
        let (most, least) = (if r > g { r } else { g }, if r < g { r } else { g });
        let (max, min) = (if most > b { most } else { b }, if least < b { least } else { b });
        let chroma = max - min;
        let (difference, sextants) = if max == g { (b - r, 2.0) } else { (r - g, 4.0) };
        let (difference, sextants) = if max == r { (g - b, 0.0) } else { (difference, sextants) };
        let hue = 60.0 * (difference / chroma + sextants);
        let hue = if hue < 0.0 { hue + 360.0 } else { hue };
        let saturation = 100.0 * chroma / max;
        let is_grey = chroma == 0.0;
        Self { hue: if is_grey { 0.0 } else { hue }, saturation: if is_grey { 0.0 } else { saturation } }
    }
}

/// A component of a colour that is binned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Component {
    /// Degrees.
    Hue,
    /// 0 to 100.
    Saturation,
}

impl Component {
    fn range(self) -> f32 {
        match self {
            Self::Hue => 360.0,
            Self::Saturation => 100.0,
        }
    }

    /// ⌊value · m/range⌋, at most m − 1, the product and the quotient in f32. Never decreases with the value.
    pub fn bin(self, value: f32, m: u32) -> u32 {
        ((value * m as f32 / self.range()) as u32).min(m - 1)
    }

    /// The smallest f32 in each bin but the first, of all given m, ascending, each once.
    ///
    /// They cut the range into classes, numbered by how many bounds a value has reached; every bin is a union of them.
    pub fn bounds(self, m: impl Iterator<Item = u32>) -> Vec<f32> {
        let first_of = |k: u32, m: u32| {
            let mut first = self.range() * k as f32 / m as f32;
            while self.bin(first, m) >= k {
                first = first.next_down();
            }
            while self.bin(first, m) < k {
                first = first.next_up();
            }
            first
        };
        let mut bounds: Vec<f32> = m.flat_map(|m| (1..m).map(move |k| first_of(k, m))).collect();
        bounds.sort_unstable_by(f32::total_cmp);
        bounds.dedup();
        bounds
    }

    /// The bin of every class of `bounds`, which must hold those of `m`; one class without colour (m = 0).
    pub fn bin_of_class(self, bounds: &[f32], m: u32) -> Vec<u16> {
        if m == 0 {
            return vec![0];
        }
        std::iter::once(0).chain(bounds.iter().map(|&bound| self.bin(bound, m) as u16)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{GeneTable, Parameters, Quantiser, oracle};

    /// Hue over 360 and saturation over 100 as fractions of whole numbers.
    fn exact([r, g, b]: [u8; 3]) -> ((i64, i64), (i64, i64)) {
        let [r, g, b] = [r, g, b].map(i64::from);
        let (max, min) = (r.max(g).max(b), r.min(g).min(b));
        let chroma = max - min;
        if chroma == 0 {
            return ((0, 1), (0, 1));
        }
        let sextants = match max {
            _ if max == r => (g - b).rem_euclid(6 * chroma),
            _ if max == g => 2 * chroma + b - r,
            _ => 4 * chroma + r - g,
        };
        ((sextants, 6 * chroma), (chroma, max))
    }

    /// Every fifth value of each channel and the ends; 148 877 colours.
    fn colours() -> impl Iterator<Item = [u8; 3]> {
        let channel = || (0..=255u8).step_by(5).chain([254]);
        channel().flat_map(move |r| channel().flat_map(move |g| channel().map(move |b| [r, g, b])))
    }

    #[test]
    fn bins_are_the_exact_ones_but_on_an_edge() {
        let mut on_edge = 0;
        for colour in colours() {
            let HueSaturation { hue, saturation } = HueSaturation::new(colour);
            assert!((0.0..360.0).contains(&hue) && (0.0..=100.000_01).contains(&saturation), "{colour:?}");
            let (exact_hue, exact_saturation) = exact(colour);
            for m in 3..=8 {
                for (channel, value, (over, under)) in
                    [(Component::Hue, hue, exact_hue), (Component::Saturation, saturation, exact_saturation)]
                {
                    let bin = i64::from(channel.bin(value, m));
                    let parts = over * i64::from(m);
                    let expected = (parts / under).min(i64::from(m) - 1);
                    let is_edge = parts % under == 0 && parts > 0;
                    on_edge += i64::from(is_edge);
                    assert!(
                        bin == expected || (is_edge && bin == expected - 1),
                        "{channel:?} of {colour:?}, m {m}: {bin}, exactly {over}/{under}"
                    );
                }
            }
        }
        assert!(on_edge > 1000, "edges were met {on_edge} times");
    }

    #[test]
    fn classes_give_the_bins_of_every_m() {
        let quantiser = Quantiser::new(&GeneTable::paper()).unwrap();
        let binnings: Vec<_> = (3..=8)
            .map(|colour_bins| {
                quantiser.binning(&Parameters { colour_bins, ..Parameters::PAPER_BEST }).unwrap()
            })
            .collect();
        for colour in colours() {
            let class = usize::from(quantiser.colour_classes(&[colour])[0]);
            for binning in &binnings {
                let m = binning.parameters().colour_bins;
                assert_eq!(
                    binning.colour.get(class as u16),
                    oracle::colour_bin(colour, m),
                    "{colour:?}, {m}"
                );
            }
        }
    }

    #[test]
    fn known_colours() {
        let hue_saturation = |colour| {
            let HueSaturation { hue, saturation } = HueSaturation::new(colour);
            (hue, saturation)
        };
        assert_eq!(hue_saturation([0, 0, 0]), (0.0, 0.0));
        assert_eq!(hue_saturation([90, 90, 90]), (0.0, 0.0));
        assert_eq!(hue_saturation([255, 0, 0]), (0.0, 100.0));
        assert_eq!(hue_saturation([255, 255, 0]), (60.0, 100.0));
        assert_eq!(hue_saturation([0, 255, 0]), (120.0, 100.0));
        assert_eq!(hue_saturation([0, 255, 255]), (180.0, 100.0));
        assert_eq!(hue_saturation([0, 0, 255]), (240.0, 100.0));
        assert_eq!(hue_saturation([255, 0, 255]), (300.0, 100.0));
    }
}
