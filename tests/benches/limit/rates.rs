//! How many elements of each kind the processor does a second, on one thread.

use descriptor::wide::widest;
use std::fs::{self, File};
use std::hint::black_box;
use std::io::Read as _;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use pulp::NullaryFnOnce;
use rand::rngs::StdRng;
use rand::{RngExt as _, SeedableRng as _};
use tests::benches::table::Samples;

use crate::kernels::{
    Aligned, BINS, Bytes, Column, Columns, Distances, DotProducts, FEW, Features, Fetches, FewBins, ManyBins,
    Moments, PAIRS, POINTS, Read, Record, Roots, Shares, Sums, Terms, WIDTH,
};
use crate::work::{Element, Rates};

/// What one sample of a rate takes at least.
const SAMPLE: Duration = Duration::from_millis(4);
/// Bytes that are read from memory and from a file: more than fit the last cache, and few enough for it.
const MEMORY: usize = 256 << 20;
const FILE: usize = 8 << 20;
/// Bytes that are copied at once.
const COPY: usize = 8 << 10;
/// Keys of an array, rows of a cloud and its points: those of the mean cloud.
const KEYS: usize = 53;
/// Arrays of keys in turn: no processor learns what to do with so many.
const ARRAYS: usize = 256;
const RECORDS: usize = 1660;

/// What kernels work on, and the rates so far.
pub struct Processor {
    /// One that is opened.
    file: PathBuf,
    large_file: tempfile::NamedTempFile,
    memory: Vec<u64>,
    points: Columns,
    rows_of_points: [[f32; 3]; POINTS],
    rows: Vec<Aligned<[f32; WIDTH]>>,
    doubles: [Column<f64>; 2],
    counts: Column<u32>,
    /// Four a word.
    codes: Aligned<[u32; POINTS / 4]>,
    many_codes: Column<u16>,
    keys: Vec<[u64; KEYS]>,
    records: Vec<Record>,
    indices: Column<u32>,
    /// One for each element, and each width or way.
    samples: [Vec<Samples>; Element::ALL.len()],
}

/// Repeats what does so many elements until it can be timed: elements a second.
fn rate(elements: usize, mut once: impl FnMut()) -> f64 {
    let mut repetitions = 1;
    loop {
        let clock = Instant::now();
        for _ in 0..repetitions {
            once();
        }
        let taken = clock.elapsed();
        if taken >= SAMPLE {
            return (elements * repetitions) as f64 / taken.as_secs_f64();
        }
        repetitions *= 2;
    }
}

/// Increments in tables.
fn in_tables(codes: &Column<u16>) -> f64 {
    let mut tables = Box::new([[0; BINS + 16]; 4]);
    rate(POINTS, || run(ManyBins { codes, tables: &mut tables }))
}

/// Runs a kernel whose input the compiler may know nothing of.
fn run<K: NullaryFnOnce>(kernel: K) {
    black_box(widest(black_box(kernel)));
}

impl Processor {
    /// With random data.
    pub fn new() -> Self {
        let mut random = StdRng::seed_from_u64(1);
        let mut unit = || random.random_range(0.01f32..1.0);
        let points = [(); 3].map(|()| Aligned(std::array::from_fn(|_| unit())));
        let rows_of_points = std::array::from_fn(|_| std::array::from_fn(|_| unit()));
        let rows = (0..KEYS).map(|_| Aligned(std::array::from_fn(|_| unit()))).collect();
        let records = (0..RECORDS).map(|_| std::array::from_fn(|_| unit())).collect();
        let doubles = [(); 2].map(|()| Aligned(std::array::from_fn(|_| f64::from(unit()))));
        let large_file = tempfile::NamedTempFile::new().unwrap();
        fs::write(&large_file, vec![1u8; FILE]).unwrap();
        Self {
            file: std::env::current_exe().unwrap(),
            large_file,
            memory: (0..MEMORY as u64 / 8).collect(),
            points,
            rows_of_points,
            rows,
            doubles,
            counts: Aligned(std::array::from_fn(|_| random.random_range(0..300))),
            codes: Aligned(std::array::from_fn(|_| {
                u32::from_le_bytes(std::array::from_fn(|_| {
                    // Half of the neighbours on a smooth surface fall into one bin.
                    if random.random() { 7 } else { random.random_range(0..FEW as u8) }
                }))
            })),
            many_codes: Aligned(std::array::from_fn(|_| random.random_range(0..BINS as u16))),
            keys: (0..ARRAYS).map(|_| std::array::from_fn(|_| random.random())).collect(),
            records,
            indices: Aligned(std::array::from_fn(|_| random.random_range(0..RECORDS as u32))),
            samples: Default::default(),
        }
    }

    /// Measures every rate once more.
    pub fn sample(&mut self) {
        for element in Element::ALL {
            let rates = self.rates_of(element);
            let samples = &mut self.samples[element as usize];
            samples.resize(rates.len(), Samples::default());
            samples.iter_mut().zip(rates).for_each(|(samples, rate)| samples.push(rate));
        }
    }

    /// Medians, each of the quickest width or way.
    pub fn rates(&self) -> Rates {
        let best =
            |widths: &Vec<Samples>| widths.iter().map(Samples::median).fold(0.0, |a: f64, b: f64| a.max(b));
        Rates(self.samples.each_ref().map(best))
    }

    /// In each width or way that there is.
    fn rates_of(&self, element: Element) -> Vec<f64> {
        let one = |elements, once: &mut dyn FnMut()| vec![rate(elements, once)];
        let mut values = Aligned([0.0f32; POINTS]);
        match element {
            Element::File => one(1, &mut || {
                black_box(File::open(&self.file).unwrap().metadata().unwrap());
            }),
            Element::FileByte => {
                let mut buffer = vec![0; 64 << 10];
                one(FILE, &mut || {
                    let mut file = File::open(&self.large_file).unwrap();
                    while file.read(black_box(&mut buffer)).unwrap() > 0 {}
                })
            }
            Element::CopiedByte => {
                let [from, mut to] = [vec![1u8; COPY], vec![0; COPY]];
                one(COPY, &mut || black_box(&mut to).copy_from_slice(black_box(&from)))
            }
            Element::Feature => {
                let [a, b, _] = self.points;
                let mut bins = Aligned([0; POINTS]);
                one(POINTS, &mut || {
                    run(Features { values: &[a, b], scale: black_box(9.0), last: 7.0, bins: &mut bins })
                })
            }
            Element::Key => one(ARRAYS * KEYS, &mut || {
                for keys in &self.keys {
                    let mut keys = *black_box(keys);
                    keys.sort_unstable();
                    black_box(keys);
                }
            }),
            Element::Distance => one(POINTS, &mut || {
                run(Distances { points: &self.points, query: [0.5; 3], limit: black_box(0.1) })
            }),
            Element::DotProduct => one(POINTS, &mut || {
                let axis = black_box([0.1, 0.2, 0.3]);
                run(DotProducts { vectors: &self.points, axis, products: &mut values });
            }),
            Element::Neighbour => vec![self.sums::<4>(), self.sums::<8>(), self.sums::<16>()],
            Element::Root => {
                let mut roots = Aligned([0.0; POINTS]);
                one(POINTS, &mut || run(Roots { values: &self.doubles, roots: &mut roots }))
            }
            Element::FewBins => {
                let (units, mut codes) = (Bytes::units(), Aligned([0; POINTS]));
                let bytes = self.codes.0.iter().flat_map(|codes| codes.to_le_bytes());
                codes.0.iter_mut().zip(bytes).for_each(|(code, byte)| *code = u16::from(byte));
                let in_vectors = rate(POINTS, || run(FewBins { codes: &self.codes, units: &units }));
                vec![in_vectors, in_tables(&codes)]
            }
            Element::ManyBins => vec![in_tables(&self.many_codes)],
            Element::Share => one(POINTS, &mut || {
                run(Shares { counts: &self.counts, total: black_box(300.0), shares: &mut values })
            }),
            Element::Value => one(KEYS * WIDTH, &mut || run(Moments { rows: &self.rows })),
            Element::Term => {
                vec![self.terms::<4>(), self.terms::<8>(), self.terms::<16>(), self.terms::<32>()]
            }
            Element::Fetch => {
                let mut found = Aligned([[0.0; 8]; POINTS]);
                one(POINTS, &mut || {
                    run(Fetches { records: &self.records, indices: &self.indices, found: &mut found })
                })
            }
            Element::MemoryByte => one(MEMORY, &mut || run(Read { words: &self.memory })),
        }
    }

    fn sums<const L: usize>(&self) -> f64 {
        let queries = [0, 1, 2].map(|axis| std::array::from_fn(|lane| self.rows_of_points[lane][axis]));
        rate(L * POINTS, || {
            run(Sums::<L> { points: &self.rows_of_points, queries: &queries, limit: black_box(0.1) });
        })
    }

    fn terms<const L: usize>(&self) -> f64 {
        let value = |pair: usize, of: usize, lane: usize| self.rows[lane].0[2 * pair + of];
        let query = std::array::from_fn(|pair| [0, 1].map(|of| value(pair, of, KEYS - 1)));
        let clouds =
            std::array::from_fn(|pair| [0, 1].map(|of| std::array::from_fn(|lane| value(pair, of, lane))));
        let clouds = Aligned(clouds);
        rate(2 * PAIRS * L, || run(Terms::<L> { query: &query, clouds: &clouds }))
    }
}

const _: () = assert!(WIDTH == 2 * PAIRS && KEYS > 32 && FEW == 64);
