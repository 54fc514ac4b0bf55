//! Kernels: what stages consist of, each alone and on data in the first cache.
//!
//! Lanes are as many as are quickest on the processor, so that one kernel comes in several widths.

use pulp::NullaryFnOnce;

/// Points, or pairs of points, that one call goes through.
pub const POINTS: usize = 512;

/// Data that begins with a line of the cache, so that no vector lies in two.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub struct Aligned<T>(pub T);

/// Numbers of [`POINTS`] points.
pub type Column<T = f32> = Aligned<[T; POINTS]>;

/// x, y, z of points.
pub type Columns = [Column; 3];

/// Squared distances of points to a query, of which those up to a limit are counted.
pub struct Distances<'a> {
    pub points: &'a Columns,
    pub query: [f32; 3],
    pub limit: f32,
}

impl NullaryFnOnce for Distances<'_> {
    type Output = u32;

    #[inline(always)]
    fn call(self) -> u32 {
        let [qx, qy, qz] = self.query;
        let [Aligned(x), Aligned(y), Aligned(z)] = self.points;
        let mut count = 0;
        for i in 0..POINTS {
            let (x, y, z) = (x[i] - qx, y[i] - qy, z[i] - qz);
            count += u32::from(x * x + y * y + z * z <= self.limit);
        }
        count
    }
}

/// Dot products of vectors with one vector.
pub struct DotProducts<'a> {
    pub vectors: &'a Columns,
    pub axis: [f32; 3],
    pub products: &'a mut Column,
}

impl NullaryFnOnce for DotProducts<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let [ax, ay, az] = self.axis;
        let [Aligned(x), Aligned(y), Aligned(z)] = self.vectors;
        for i in 0..POINTS {
            self.products.0[i] = ax * x[i] + ay * y[i] + az * z[i];
        }
    }
}

/// What a plane is fitted to: of the points up to a limit from each of `L` queries the number, three sums of offsets and
/// six of their products.
pub struct Sums<'a, const L: usize> {
    pub points: &'a [[f32; 3]; POINTS],
    pub queries: &'a [[f32; L]; 3],
    pub limit: f32,
}

impl<const L: usize> NullaryFnOnce for Sums<'_, L> {
    type Output = ([u32; L], [[f32; L]; 9]);

    #[inline(always)]
    fn call(self) -> Self::Output {
        let [qx, qy, qz] = self.queries;
        let mut count = [0u32; L];
        let [mut sx, mut sy, mut sz] = [[0.0f32; L]; 3];
        let [mut sxx, mut sxy, mut sxz, mut syy, mut syz, mut szz] = [[0.0f32; L]; 6];
        for &[px, py, pz] in self.points {
            for lane in 0..L {
                let (x, y, z) = (px - qx[lane], py - qy[lane], pz - qz[lane]);
                // By bits: a select of floats would be taken for a branch.
                let mask = if x * x + y * y + z * z <= self.limit { u32::MAX } else { 0 };
                let only = |value: f32| f32::from_bits(value.to_bits() & mask);
                let (x, y, z) = (only(x), only(y), only(z));
                count[lane] += mask & 1;
                sx[lane] += x;
                sy[lane] += y;
                sz[lane] += z;
                sxx[lane] += x * x;
                sxy[lane] += x * y;
                sxz[lane] += x * z;
                syy[lane] += y * y;
                syz[lane] += y * z;
                szz[lane] += z * z;
            }
        }
        (count, [sx, sy, sz, sxx, sxy, sxz, syy, syz, szz])
    }
}

/// A division and a square root in f64 each.
pub struct Roots<'a> {
    pub values: &'a [Column<f64>; 2],
    pub roots: &'a mut Column<f64>,
}

impl NullaryFnOnce for Roots<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let [Aligned(a), Aligned(b)] = self.values;
        for i in 0..POINTS {
            self.roots.0[i] = (a[i] / b[i]).sqrt();
        }
    }
}

/// Counts as shares: divisions in f32.
pub struct Shares<'a> {
    pub counts: &'a Column<u32>,
    pub total: f32,
    pub shares: &'a mut Column,
}

impl NullaryFnOnce for Shares<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for i in 0..POINTS {
            self.shares.0[i] = self.counts.0[i] as f32 / self.total;
        }
    }
}

/// Bins up to which counts are kept in vectors.
pub const FEW: usize = 64;

/// Counts of a byte each, eight a word.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub struct Bytes([u64; FEW / 8]);

impl Bytes {
    pub const ZERO: Self = Self([0; FEW / 8]);

    /// A one in each bin.
    pub fn units() -> [Self; FEW] {
        std::array::from_fn(|bin| {
            let mut unit = Self::ZERO;
            unit.0[bin / 8] = 1 << (bin % 8 * 8);
            unit
        })
    }

    /// By index: through iterators the sums would stay in memory.
    #[inline(always)]
    fn add(&mut self, other: &Self) {
        for word in 0..FEW / 8 {
            self.0[word] = self.0[word].wrapping_add(other.0[word]);
        }
    }
}

/// Increments of up to [`FEW`] bins: adds the vector of each code.
pub struct FewBins<'a> {
    /// Four codes a word, each below [`FEW`].
    pub codes: &'a Aligned<[u32; POINTS / 4]>,
    /// [`Bytes::units`]. Of a length that the compiler does not know: without its check the loop would gather words from
    /// many vectors at once.
    pub units: &'a [Bytes],
}

impl NullaryFnOnce for FewBins<'_> {
    type Output = [Bytes; 4];

    #[inline(always)]
    fn call(self) -> [Bytes; 4] {
        let mut sums = [Bytes::ZERO; 4];
        for &codes in &self.codes.0 {
            sums[0].add(&self.units[codes as usize & 0xff]);
            sums[1].add(&self.units[(codes >> 8) as usize & 0xff]);
            sums[2].add(&self.units[(codes >> 16) as usize & 0xff]);
            sums[3].add(&self.units[(codes >> 24) as usize & 0xff]);
        }
        sums
    }
}

/// Bins of a table of [`ManyBins`].
pub const BINS: usize = 1024;

/// Increments of tables that take codes in rotation; a few entries more than bins, or equal bins of two tables would
/// pass for the same address.
pub struct ManyBins<'a> {
    pub codes: &'a Column<u16>,
    pub tables: &'a mut [[u32; BINS + 16]; 4],
}

impl NullaryFnOnce for ManyBins<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let [a, b, c, d] = self.tables;
        for &codes in self.codes.0.as_chunks::<4>().0 {
            let codes = codes.map(|code| usize::from(code) % BINS);
            a[codes[0]] += 1;
            b[codes[1]] += 1;
            c[codes[2]] += 1;
            d[codes[3]] += 1;
        }
    }
}

/// Pairs of bins of a query that is compared by χ².
pub const PAIRS: usize = 64;

/// χ² terms of a query and `L` clouds, two over one denominator.
pub struct Terms<'a, const L: usize> {
    pub query: &'a [[f32; 2]; PAIRS],
    pub clouds: &'a Aligned<[[[f32; L]; 2]; PAIRS]>,
}

impl<const L: usize> NullaryFnOnce for Terms<'_, L> {
    type Output = [f32; L];

    #[inline(always)]
    fn call(self) -> [f32; L] {
        let at_least = |sum: f32| if sum > 1e-18 { sum } else { 1e-18 };
        let mut sums = [0.0f32; L];
        for (a, b) in self.query.iter().zip(&self.clouds.0) {
            for lane in 0..L {
                let (x, y) = (a[0] - b[0][lane], a[1] - b[1][lane]);
                let (s, t) = (at_least(a[0] + b[0][lane]), at_least(a[1] + b[1][lane]));
                sums[lane] += (x * x * t + y * y * s) / (s * t);
            }
        }
        sums
    }
}

/// Values of a row of [`Moments`].
pub const WIDTH: usize = 128;

/// Sums of rows, then sums of squared differences from their means, in f64.
pub struct Moments<'a> {
    pub rows: &'a [Aligned<[f32; WIDTH]>],
}

impl NullaryFnOnce for Moments<'_> {
    type Output = [f64; WIDTH];

    #[inline(always)]
    fn call(self) -> [f64; WIDTH] {
        let count = self.rows.len() as f64;
        let mut means = [0.0f64; WIDTH];
        for row in self.rows {
            for i in 0..WIDTH {
                means[i] += f64::from(row.0[i]);
            }
        }
        for mean in &mut means {
            *mean /= count;
        }
        let mut squares = [0.0f64; WIDTH];
        for row in self.rows {
            for i in 0..WIDTH {
                let difference = f64::from(row.0[i]) - means[i];
                squares[i] += difference * difference;
            }
        }
        squares
    }
}

/// Bins of the differences of values: one linear function, bounded and rounded.
pub struct Features<'a> {
    pub values: &'a [Column; 2],
    pub scale: f32,
    pub last: f32,
    pub bins: &'a mut Column<u32>,
}

impl NullaryFnOnce for Features<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        // From here to twice as far, floats are whole numbers.
        const WHOLE: f32 = (1u32 << 23) as f32;
        let [Aligned(a), Aligned(b)] = self.values;
        for i in 0..POINTS {
            let at = (b[i] - a[i]) * self.scale;
            let at = if at > 0.0 { at } else { 0.0 };
            let at = if at < self.last { at } else { self.last };
            self.bins.0[i] = (at + WHOLE).to_bits() - WHOLE.to_bits();
        }
    }
}

/// What is known of a point, fetched by its index.
pub type Record = [f32; 8];

/// Fetches the records of points.
pub struct Fetches<'a> {
    pub records: &'a [Record],
    pub indices: &'a Column<u32>,
    pub found: &'a mut Column<Record>,
}

impl NullaryFnOnce for Fetches<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for (found, &index) in self.found.0.iter_mut().zip(&self.indices.0) {
            *found = self.records[index as usize];
        }
    }
}

/// Reads memory.
pub struct Read<'a> {
    pub words: &'a [u64],
}

impl NullaryFnOnce for Read<'_> {
    type Output = u64;

    #[inline(always)]
    fn call(self) -> u64 {
        self.words.iter().fold(0, |sum, &word| sum ^ word)
    }
}
