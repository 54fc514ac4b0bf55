//! The arc tangent from + and × alone, for lanes.

/// Abramowitz & Stegun, Handbook of Mathematical Functions, 4.4.49, from x⁹ down to x³ over x.
const COEFFICIENTS: [f32; 8] = [
    0.002_866_225_7,
    -0.016_165_737,
    0.042_909_61,
    -0.075_289_64,
    0.106_562_64,
    -0.142_089,
    0.199_935_51,
    -0.333_331_45,
];

/// The arc tangent of a number in [−1, 1], radians, to about 1e-7: with the same bits on every target and in every lane.
#[inline(always)]
pub(super) fn arctangent(value: f32) -> f32 {
    let square = value * value;
    let series = COEFFICIENTS.iter().fold(0.0, |sum, coefficient| (sum + coefficient) * square);
    value + value * series
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_libms() {
        for step in -10_000i16..=10_000 {
            let value = f32::from(step) / 10_000.0;
            let expected = libm::atan(f64::from(value));
            assert!((f64::from(arctangent(value)) - expected).abs() < 1.5e-7, "{value}");
        }
    }
}
