//! What an object's surface looks like under white light: two colours in a pattern.

/// Reflectance of red, green and blue, each 0 to 1.
pub(super) type Rgb = [f64; 3];

/// The look of one object's surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Colour of the ground.
    pub ground: Hsv,
    /// Colour of the pattern.
    pub figure: Hsv,
    /// Where the pattern is.
    pub pattern: Pattern,
    /// Relative strength of the fine random variation of brightness, 0 for none.
    pub mottle: f64,
    /// Key of everything random in the texture.
    pub key: u32,
}

/// A colour as hue in degrees, saturation and value, both 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hsv {
    /// Degrees; any real number, 360 is one turn.
    pub hue: f64,
    /// 0 is grey.
    pub saturation: f64,
    /// 0 is black.
    pub value: f64,
}

/// Where a texture's second colour is. Heights are shares of the object's height, 0 at the bottom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pattern {
    /// Nowhere.
    Plain,
    /// On level bands.
    Bands {
        /// Bands over the whole height.
        count: f64,
        /// Share of each period that is covered.
        share: f64,
    },
    /// On upright sectors around the axis.
    Sectors {
        /// Sectors in a whole turn.
        count: f64,
        /// Share of each period that is covered.
        share: f64,
    },
    /// On a label around the middle, with blocks of the ground's colour on it like print.
    Label {
        /// Lower end of the label.
        low: f64,
        /// Upper end of the label.
        high: f64,
        /// Edge of a block, metres.
        block: f64,
    },
    /// On random cells of a lattice.
    Patches {
        /// Edge of a cell, metres.
        cell: f64,
        /// Share of the cells that are covered.
        share: f64,
    },
}

impl Hsv {
    /// The colour as reflectances (hexcone).
    pub(super) fn rgb(self) -> Rgb {
        let turn = self.hue / 60.0;
        [5.0, 3.0, 1.0].map(|offset| {
            let k = turn + offset;
            let k = k - 6.0 * (k / 6.0).floor();
            let dip = k.min(4.0 - k).clamp(0.0, 1.0);
            self.value * (1.0 - self.saturation * dip)
        })
    }
}

impl Texture {
    /// Reflectance at `p` (object frame, metres) of an object of the given half height.
    pub(super) fn reflectance(&self, p: [f64; 3], half_height: f64) -> Rgb {
        let colour = if self.is_figure(p, half_height) { self.figure } else { self.ground };
        let gain = 1.0 + self.mottle * (2.0 * self.random(p, 0.004, 1) - 1.0);
        colour.rgb().map(|channel| (channel * gain).clamp(0.0, 1.0))
    }

    fn is_figure(&self, p: [f64; 3], half_height: f64) -> bool {
        let height = (p[2] + half_height) / (2.0 * half_height);
        match self.pattern {
            Pattern::Plain => false,
            Pattern::Bands { count, share } => fraction(height * count) < share,
            Pattern::Sectors { count, share } => {
                let turn = libm::atan2(p[1], p[0]) / std::f64::consts::TAU;
                fraction(turn * count) < share
            }
            Pattern::Label { low, high, block } => {
                height > low && height < high && self.random(p, block, 0) < 0.7
            }
            Pattern::Patches { cell, share } => self.random(p, cell, 0) < share,
        }
    }

    /// A random number in [0, 1) for the lattice cell of edge `cell` that holds `p`.
    fn random(&self, p: [f64; 3], cell: f64, layer: u64) -> f64 {
        // Finalizer of SplitMix64 over the cell's indices, one after the other.
        let mut hash = u64::from(self.key) << 8 | layer;
        for coordinate in p {
            hash = (hash ^ (coordinate / cell).floor() as i64 as u64).wrapping_add(0x9e37_79b9_7f4a_7c15);
            hash = (hash ^ (hash >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            hash = (hash ^ (hash >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            hash ^= hash >> 31;
        }
        (hash >> 32) as f64 / 4_294_967_296.0
    }
}

fn fraction(x: f64) -> f64 {
    x - x.floor()
}
