//! The objects: categories of household things, each with look-alike instances.

use super::SynthSettings;
use super::draw::Draw;
use super::shape::{Profile, Shape};
use super::texture::{Hsv, Pattern, Texture};

/// One object (instance) that can be seen.
#[derive(Clone, Debug, PartialEq)]
pub struct SynthObject {
    /// Its place in the catalogue, part of the key of its random streams.
    pub index: u32,
    /// Its class.
    pub category: &'static str,
    /// Its own name: `<category>_<n>`, n from 1.
    pub instance: String,
    /// Its surface with its size.
    pub shape: Shape,
    /// Its colours.
    pub texture: Texture,
}

/// Names of the categories. Two neighbours share a palette, so that colour alone does not tell them apart.
const CATEGORIES: [&str; 6] = ["mug", "can", "bottle", "cone", "box", "ball"];

/// How far instances of a category differ from its prototype, up and down: enough to be told apart in clean views,
/// and less than what light and noise do to one view.
mod spread {
    /// Relative change of each size.
    pub const SIZE: f64 = 0.034;
    /// Change of hue, degrees.
    pub const HUE: f64 = 5.5;
    /// Relative change of saturation.
    pub const SATURATION: f64 = 0.08;
    /// Relative change of value.
    pub const VALUE: f64 = 0.07;
    /// Relative change of the pattern's measures.
    pub const PATTERN: f64 = 0.08;
}

/// Every object of the data set, in the order of its index.
///
/// There are as many categories, at most six, as give each three or more instances; instances of a category have
/// one shape and pattern with small changes of size, colour and measures.
pub fn catalogue(settings: &SynthSettings) -> Vec<SynthObject> {
    let categories = (settings.objects() / 3).clamp(2, CATEGORIES.len() as u32);
    (0..settings.objects())
        .map(|index| {
            let (category, rank) = (index % categories, index / categories);
            let alike = (settings.objects() - category).div_ceil(categories);
            let seed = settings.seed();
            let mut maker = Maker {
                prototype: Draw::new(seed, "synth category", &[u64::from(category)]),
                palette: Draw::new(seed, "synth palette", &[u64::from(category / 2)]),
                change: Change { seed, category, rank, alike, measures: 0 },
            };
            let name = CATEGORIES[category as usize];
            let (shape, texture) = (maker.shape(name), maker.texture());
            SynthObject { index, category: name, instance: format!("{name}_{}", rank + 1), shape, texture }
        })
        .collect()
}

/// How one instance differs from its category's prototype, measure by measure.
struct Change {
    seed: u64,
    category: u32,
    /// Which instance of its category, from 0.
    rank: u32,
    /// Number of instances of the category.
    alike: u32,
    /// Measures changed so far.
    measures: u64,
}

impl Change {
    /// The change of the next measure, within `spread` up and down. The interval has one part for each instance,
    /// dealt out at random at the same place of each, so that no two instances agree in a measure.
    fn next(&mut self, spread: f64) -> f64 {
        let key = [u64::from(self.category), self.measures];
        self.measures += 1;
        let mut draw = Draw::new(self.seed, "synth instance", &key);
        let mut parts: Vec<u32> = (0..self.alike).collect();
        draw.shuffle(&mut parts);
        let part = f64::from(parts[self.rank as usize]) + draw.between(0.25, 0.75);
        spread * (2.0 * part / f64::from(self.alike) - 1.0)
    }
}

/// Makes one instance: the same draws for all of its category, changed for itself.
struct Maker {
    prototype: Draw,
    palette: Draw,
    change: Change,
}

impl Maker {
    fn size(&mut self, low: f64, high: f64) -> f64 {
        self.prototype.between(low, high) * (1.0 + self.change.next(spread::SIZE))
    }

    fn measure(&mut self, low: f64, high: f64) -> f64 {
        self.prototype.between(low, high) * (1.0 + self.change.next(spread::PATTERN))
    }

    fn shape(&mut self, category: &str) -> Shape {
        match category {
            "mug" => {
                let (radius, height) = (self.size(0.033, 0.042), self.size(0.075, 0.095));
                let ring = 0.3 * height;
                let cup = Profile::cup(0.95 * radius, radius, height, 0.004);
                Shape::Mug { cup, reach: 0.95 * radius, ring, grip: 0.006 }
            }
            "can" => {
                let radius = self.size(0.028, 0.036);
                Shape::Revolution(Profile::cone(radius, radius, self.size(0.08, 0.11)))
            }
            "bottle" => {
                let (body, height) = (self.size(0.025, 0.034), self.size(0.12, 0.16));
                let (neck, shoulder) = (self.size(0.38, 0.5) * body, self.size(0.5, 0.6));
                Shape::Revolution(Profile::bottle(body, neck, height, shoulder))
            }
            "cone" => {
                let (bottom, top) = (self.size(0.035, 0.045), self.size(0.008, 0.016));
                Shape::Revolution(Profile::cone(bottom, top, self.size(0.09, 0.12)))
            }
            "box" => {
                let half = [self.size(0.028, 0.045), self.size(0.018, 0.028), self.size(0.04, 0.06)];
                Shape::Box { half, edge: 0.002 }
            }
            _ => Shape::Sphere { radius: self.size(0.03, 0.04) },
        }
    }

    fn texture(&mut self) -> Texture {
        let hue = self.palette.between(0.0, 360.0);
        // The second colour is clearly another one.
        let other = hue + self.palette.between(60.0, 300.0);
        let (ground, figure) = (self.colour(hue), self.colour(other));
        let (low, high) = (self.measure(0.15, 0.35), self.measure(0.6, 0.75));
        let (share, cell) = (self.measure(0.3, 0.5), self.measure(0.012, 0.02));
        let count = self.measure(2.0, 5.0);
        let pattern = match self.pattern() {
            0 => Pattern::Plain,
            1 => Pattern::Bands { count, share },
            2 => Pattern::Sectors { count: (2.0 * count).floor(), share },
            3 => Pattern::Label { low, high, block: cell / 2.0 },
            _ => Pattern::Patches { cell, share },
        };
        Texture { ground, figure, pattern, mottle: 0.06, key: self.prototype.bits() }
    }

    /// The category's pattern: neighbours differ, and every seed has each kind.
    fn pattern(&self) -> u32 {
        let mut kinds = [0, 1, 2, 3, 4];
        Draw::new(self.change.seed, "synth patterns", &[]).shuffle(&mut kinds);
        kinds[self.change.category as usize % kinds.len()]
    }

    fn colour(&mut self, hue: f64) -> Hsv {
        let (saturation, value) = (self.palette.between(0.4, 0.75), self.palette.between(0.5, 0.85));
        let saturation = saturation * (1.0 + self.change.next(spread::SATURATION));
        let value = value * (1.0 + self.change.next(spread::VALUE));
        Hsv { hue: hue + self.change.next(spread::HUE), saturation, value }
    }
}
