//! Codes of pairs of points: which bins a pair is counted in, in both orders.

use pulp::NullaryFnOnce;

use super::super::neighbourhood::{GROUP, Neighbourhood, group};
use super::super::ratio::Ratio;

/// Bins of three features in five parts.
pub(super) const BINS: usize = 125;

/// Values of a histogram: angles, then ratios.
pub(in super::super) const SIZE: usize = 2 * BINS;

/// Codes of a pair's angles, and of its colours: each feature's part in the first order and in the second, five by five.
pub(super) const CODES: usize = BINS * BINS;

/// The code of a pair that does not count: the same point twice, or an offset along a normal.
const NO_PAIR: u16 = CODES as u16;

/// Squares of the edges between the parts of [−1, 1]: ±0.2 and ±0.6.
const INNER: f32 = 0.04;
const OUTER: f32 = 0.36;

/// The edges between the parts of the full turn are ±36° and ±108°. tan² 36° = 5 − 2√5.
const TAN2_36: f32 = 0.527_864_04;
/// tan² 108° = 5 + 2√5.
const TAN2_108: f32 = 9.472_136;

/// The codes of the pairs of the first so many of these points, each with all points after it.
pub(super) struct PairCodes<'a> {
    pub(super) points: &'a Neighbourhood,
    /// Red, green and blue, with [`GROUP`] zeros after the last point, as the points have.
    pub(super) channels: [&'a [u8]; 3],
    pub(super) rows: usize,
    /// Angles in the lower half, colours in the upper, of points `one` and `other` at `one` · [`row_length`] + `other`;
    /// what is not after a row's point is left as it was.
    pub(super) codes: &'a mut [u32],
}

/// Codes from the beginning of one row to that of the next.
pub(super) fn row_length(points: usize) -> usize {
    points + GROUP
}

impl NullaryFnOnce for PairCodes<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let count = self.points.len();
        let Neighbourhood { position, normal, .. } = self.points;
        for (one, row) in self.codes.chunks_exact_mut(row_length(count)).take(self.rows).enumerate() {
            let point = [of_point(position, one), of_point(normal, one)];
            let ratios = self.channels.map(|channel| Ratio::of(channel[one]));
            for start in (one + 1..count).step_by(GROUP) {
                let others = [groups(position, start), groups(normal, start)];
                let angles = angle_codes(point, others);
                let colours =
                    colour_codes(ratios, self.channels.map(|channel| group(channel, start)), &angles);
                for ((code, angles), colours) in row[start..start + GROUP].iter_mut().zip(angles).zip(colours)
                {
                    *code = u32::from(angles) | u32::from(colours) << 16;
                }
            }
        }
    }
}

/// x, y, z of one point. Without `array::map`, which is not inlined here and would be compiled for the baseline.
#[inline(always)]
fn of_point([x, y, z]: &[Vec<f32>; 3], point: usize) -> [f32; 3] {
    [x[point], y[point], z[point]]
}

/// As [`of_point`], of the points from `start` on.
#[inline(always)]
fn groups([x, y, z]: &[Vec<f32>; 3], start: usize) -> [&[f32; GROUP]; 3] {
    [group(x, start), group(y, start), group(z, start)]
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

/// The bins of a pair in both orders.
pub(super) fn bins(code: usize) -> [usize; 2] {
    let digit = |weight: usize| code / weight % 5;
    [digit(1) + 5 * digit(25) + 25 * digit(625), digit(5) + 5 * digit(125) + 25 * digit(3125)]
}
