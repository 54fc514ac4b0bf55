//! CIELab colours as SHOT compares them.

use std::array;
use std::sync::LazyLock;

/// Steps of the table of cube roots.
const STEPS: usize = 4000;

/// L*/100, a*/120 and b*/120 of sRGB colours under daylight, from the tables that PCL uses
/// (`SHOTColorEstimation::RGB2CIELAB`, `RGB2sRGB_LUT`, `XYZ2LAB_LUT`).
pub(crate) struct Lab {
    /// Light of each value of a channel, 0 to 1.
    light: [f32; 256],
    /// Cube root of i/[`STEPS`], linear near 0.
    root: [f32; STEPS],
}

impl Lab {
    /// The tables; powers and roots are the pure-Rust libm's, the same on every target.
    pub(crate) fn tables() -> &'static Self {
        static TABLES: LazyLock<Lab> = LazyLock::new(|| Lab {
            light: array::from_fn(|channel| light(channel as f32 / 255.0)),
            root: array::from_fn(|step| root(step as f32 / STEPS as f32)),
        });
        &TABLES
    }

    /// One colour.
    #[inline(always)]
    pub(crate) fn of(&self, colour: [u8; 3]) -> [f32; 3] {
        let [r, g, b] = colour.map(|channel| self.light[usize::from(channel)]);
        let x = r * 0.412_453 + g * 0.357_58 + b * 0.180_423;
        let y = r * 0.212_671 + g * 0.715_16 + b * 0.072_169;
        let z = r * 0.019_334 + g * 0.119_193 + b * 0.950_227;
        // White is one step beyond PCL's table.
        let [x, y, z] = [x / 0.950_47, y, z / 1.088_83]
            .map(|light| self.root[((light * STEPS as f32) as usize).min(STEPS - 1)]);
        let (lightness, a, b) = (116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z));
        [lightness.min(100.0) / 100.0, a.clamp(-120.0, 120.0) / 120.0, b.clamp(-120.0, 120.0) / 120.0]
    }
}

fn light(channel: f32) -> f32 {
    if channel > 0.040_45 {
        libm::pow(f64::from((channel + 0.055) / 1.055), 2.4) as f32
    } else {
        channel / 12.92
    }
}

fn root(light: f32) -> f32 {
    if light > 0.008_856 { libm::cbrt(f64::from(light)) as f32 } else { 7.87 * light + 16.0 / 116.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_colours() {
        for (colour, expected) in [
            ([0, 0, 0], [0.0, 0.0, 0.0]),
            ([255, 255, 255], [1.0, 0.0, 0.0]),
            ([128, 128, 128], [0.535_9, 0.0, 0.0]),
            ([255, 0, 0], [0.532_3, 80.11 / 120.0, 67.22 / 120.0]),
            ([0, 0, 255], [0.323_0, 79.20 / 120.0, -107.86 / 120.0]),
        ] {
            let found = Lab::tables().of(colour);
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected).abs() < 0.003, "{colour:?}: {found}, expected {expected}");
            }
        }
    }
}
