//! Point feature histograms with colour: angles and colour ratios of all ordered pairs of a region's points.
//!
//! For a point p with unit normal m and another, q with n, at the offset d = q − p, PCL takes the frame u = m,
//! v = d × u/|d × u|, w = u × v, and bins f₁ = atan2(w·n, u·n), f₂ = v·n and f₃ = u·d/|d|, each in five equal parts
//! of its range (`computeRGBPairFeatures`). With a = m·d, b = n·d, c = m·n and t = (d × m)·n these are
//!
//! ```text
//! f₁ = atan2((b − c·a)/√(d² − a²), c)    f₂ = t/√(d² − a²)    f₃ = a/√d²        of p and q
//! f₁ = atan2((c·b − a)/√(d² − b²), c)    f₂ = t/√(d² − b²)    f₃ = −b/√d²       of q and p
//! ```
//!
//! so that both orders share most of their arithmetic, and each edge of a bin is a comparison of signed squares: no root,
//! no division, no arc tangent. Both are counted as one: the pair's code has the six bins as its digits.

use pulp::NullaryFnOnce;

use super::Radius;
use super::neighbourhood::{GROUP, Neighbourhood, group};
use super::ratio::Ratio;
use crate::prepare::check_regions;
use crate::prepare_error::PrepareError;
use crate::select::BELOW_ALL;
use crate::surface::Surface;
use crate::wide::widest;

/// Values of a histogram: angles, then ratios.
pub(super) const SIZE: usize = 2 * BINS;

/// Neighbours without which a keypoint is not described.
const MIN_NEIGHBOURS: usize = 3;

/// Bins of three features in five parts.
const BINS: usize = 125;

/// Codes of a pair: each feature's part in the first order and in the second, five by five.
const CODES: usize = BINS * BINS;

/// The code of a pair that does not count: the same point twice, or an offset along a normal.
const NO_PAIR: u16 = CODES as u16;

/// Squares of the edges between the parts of [−1, 1]: ±0.2 and ±0.6.
const INNER: f32 = 0.04;
const OUTER: f32 = 0.36;

/// The edges between the parts of the full turn are ±36° and ±108°. tan² 36° = 5 − 2√5.
const TAN2_36: f32 = 0.527_864_04;
/// tan² 108° = 5 + 2√5.
const TAN2_108: f32 = 9.472_136;

/// Refuses a cloud whose pairs would take minutes to count.
pub(super) fn check(
    surface: &Surface,
    keypoints: impl Iterator<Item = [f32; 3]>,
    radius: Radius,
) -> Result<(), PrepareError> {
    let keypoints: Vec<[f32; 3]> = keypoints.collect();
    let mut near = Neighbourhood::default();
    check_regions(surface.indices.len(), keypoints.len(), |keypoint| {
        near.fill(surface, keypoints[keypoint], [BELOW_ALL, radius.squared]);
        near.len()
    })
}

/// The histograms of all keypoints that have enough neighbours, one after the other. The histogram sums to 200 for each
/// part, as PCL counts in per cent of unordered pairs. The time grows with the square of the neighbours.
pub(super) fn rows(
    surface: &Surface,
    colours: &[[u8; 3]],
    keypoints: impl Iterator<Item = ([f32; 3], [u8; 3])>,
    radius: Radius,
) -> Vec<f32> {
    let channels = [0, 1, 2].map(|channel| colours.iter().map(|colour| colour[channel]).collect::<Vec<u8>>());
    let mut near = Neighbourhood::default();
    let mut of_near: [Vec<u8>; 3] = Default::default();
    let mut counts = Counts::default();
    let mut rows = Vec::new();
    for (keypoint, _) in keypoints {
        near.fill(surface, keypoint, [BELOW_ALL, radius.squared]);
        if near.len() < MIN_NEIGHBOURS {
            continue;
        }
        for (values, list) in channels.iter().zip(&mut of_near) {
            near.take(values, list);
        }
        widest(Pairs { near: &near, channels: of_near.each_ref().map(Vec::as_slice), counts: &mut counts });
        let pairs = near.len() as f64 * (near.len() - 1) as f64 / 2.0;
        rows.extend(counts.take().map(|count| (count as f64 * (100.0 / pairs)) as f32));
    }
    rows
}

/// Counts all pairs of a neighbourhood.
struct Pairs<'a> {
    near: &'a Neighbourhood,
    channels: [&'a [u8]; 3],
    counts: &'a mut Counts,
}

impl NullaryFnOnce for Pairs<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let points = self.near.len();
        let Neighbourhood { position, normal, .. } = self.near;
        for one in 0..points {
            let point = [position, normal].map(|values| values.each_ref().map(|values| values[one]));
            let ratios = self.channels.map(|channel| Ratio::of(channel[one]));
            self.counts.make_room(points - one);
            for start in (one + 1..points).step_by(GROUP) {
                let others =
                    [position, normal].map(|values| values.each_ref().map(|list| group(list, start)));
                let angles = angle_codes(point, others);
                let colours =
                    colour_codes(ratios, self.channels.map(|channel| group(channel, start)), &angles);
                let pairs = GROUP.min(points - start);
                self.counts.add(&angles[..pairs], &colours[..pairs]);
            }
        }
    }
}

/// Codes of one point's angles with a group of others.
#[inline(always)]
fn angle_codes([p, m]: [[f32; 3]; 2], [q, n]: [[&[f32; GROUP]; 3]; 2]) -> [u16; GROUP] {
    let mut codes = [0; GROUP];
    for lane in 0..GROUP {
        let [x, y, z] = [0, 1, 2].map(|axis| q[axis][lane] - p[axis]);
        let n = n.map(|values| values[lane]);
        let d2 = x * x + y * y + z * z;
        let a = m[0] * x + m[1] * y + m[2] * z;
        let b = n[0] * x + n[1] * y + n[2] * z;
        let c = m[0] * n[0] + m[1] * n[1] + m[2] * n[2];
        let cross = [y * m[2] - z * m[1], z * m[0] - x * m[2], x * m[1] - y * m[0]];
        let t = cross[0] * n[0] + cross[1] * n[1] + cross[2] * n[2];
        let (across, across_back) = (d2 - a * a, d2 - b * b);
        let code = turn_code(b - c * a, c, across)
            + 5 * turn_code(c * b - a, c, across_back)
            + 25 * part(t, across)
            + 125 * part(t, across_back)
            + 625 * part(a, d2)
            + 3125 * part(-b, d2);
        let counts = (across > 0.0) & (across_back > 0.0);
        codes[lane] = if counts { code as u16 } else { NO_PAIR };
    }
    codes
}

/// Which fifth of [−1, 1] the quotient value/√square is in.
#[inline(always)]
fn part(value: f32, square: f32) -> i32 {
    let signed = value * value.abs();
    let (inner, outer) = (INNER * square, OUTER * square);
    i32::from(signed >= -outer)
        + i32::from(signed >= -inner)
        + i32::from(signed >= inner)
        + i32::from(signed >= outer)
}

/// Which fifth of the turn from −180° the angle atan2(y/√square, x) is in. An angle of 0 from x = y = 0 lies in the
/// middle.
#[inline(always)]
fn turn_code(y: f32, x: f32, square: f32) -> i32 {
    let signed = x * x.abs() * square;
    let y2 = y * y;
    let parts = i32::from(y2 > TAN2_36 * signed) + i32::from(-TAN2_108 * signed > y2);
    2 + if y < 0.0 { -parts } else { parts }
}

/// Codes of one point's colour ratios with a group of others; of pairs that do not count, none.
#[inline(always)]
fn colour_codes(ratios: [Ratio; 3], others: [&[u8; GROUP]; 3], angles: &[u16; GROUP]) -> [u16; GROUP] {
    let mut codes = [0; GROUP];
    for ((ratio, others), weight) in ratios.iter().zip(others).zip([1, 25, 625]) {
        let of_channel = ratio.codes(others);
        for lane in 0..GROUP {
            codes[lane] += weight * u16::from(of_channel[lane]);
        }
    }
    for lane in 0..GROUP {
        codes[lane] = if angles[lane] == NO_PAIR { NO_PAIR } else { codes[lane] };
    }
    codes
}

/// Tables that pairs in turn are counted in: a count that was just stored takes time until it can be loaded again.
const TABLES: usize = 2;

/// Entries of a table: a power of two, so that no index needs a check, and some more, as equal places of tables a
/// multiple of 4096 bytes apart pass for the same address until late.
const TABLE: usize = 16_384;

/// Pairs by code.
type Table = [u32; TABLE + 16];

/// The counts of one neighbourhood.
struct Counts {
    angles: Box<[Table; TABLES]>,
    colours: Box<[Table; TABLES]>,
    /// Pairs in the tables.
    pairs: usize,
    /// Ordered pairs that have left the tables, by bin.
    totals: [u64; SIZE],
}

impl Default for Counts {
    fn default() -> Self {
        let tables = || Box::new([[0; TABLE + 16]; TABLES]);
        Self { angles: tables(), colours: tables(), pairs: 0, totals: [0; SIZE] }
    }
}

impl Counts {
    /// Makes sure that so many pairs more do not overflow a table.
    #[inline(always)]
    fn make_room(&mut self, pairs: usize) {
        self.pairs += pairs;
        if self.pairs > u32::MAX as usize {
            self.empty_tables();
            self.pairs = pairs;
        }
    }

    /// Counts pairs.
    #[inline(always)]
    fn add(&mut self, angles: &[u16], colours: &[u16]) {
        for (tables, codes) in [(&mut self.angles, angles), (&mut self.colours, colours)] {
            let (groups, rest) = codes.as_chunks::<TABLES>();
            for group in groups {
                for (table, &code) in tables.iter_mut().zip(group) {
                    table[usize::from(code) % TABLE] += 1;
                }
            }
            for &code in rest {
                tables[0][usize::from(code) % TABLE] += 1;
            }
        }
    }

    /// The numbers of ordered pairs by bin; empties the counts.
    fn take(&mut self) -> impl Iterator<Item = u64> {
        self.empty_tables();
        self.pairs = 0;
        std::mem::replace(&mut self.totals, [0; SIZE]).into_iter()
    }

    fn empty_tables(&mut self) {
        for (tables, totals) in
            [&mut self.angles, &mut self.colours].into_iter().zip(self.totals.chunks_exact_mut(BINS))
        {
            for code in 0..CODES {
                let count: u32 = tables.iter().map(|table| table[code]).sum();
                if count > 0 {
                    for bin in bins(code) {
                        totals[bin] += u64::from(count);
                    }
                }
            }
            tables.iter_mut().for_each(|table| table.fill(0));
        }
    }
}

/// The bins of a pair in both orders.
fn bins(code: usize) -> [usize; 2] {
    let digit = |weight: usize| code / weight % 5;
    [digit(1) + 5 * digit(25) + 25 * digit(625), digit(5) + 5 * digit(125) + 25 * digit(3125)]
}
