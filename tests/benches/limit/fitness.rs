//! A fitness value of a descriptor that shares no gene with those before, on prepared clouds: training set 1 against 2.

use std::path::Path;

use descriptor::{Descriptor, Parameters};
use tests::benches::household::listed;
use tests::benches::prepared::{Pair, spread};

use crate::cold::{Prepared, values};
use crate::count::Counts;
use crate::stage::Stage;
use crate::work::{Element, Work};

/// Descriptors whose mean is taken.
const DESCRIPTORS: u64 = 8;
const LISTS: [&str; 2] = ["train1.txt", "train2.txt"];

/// The clouds, and the stages.
pub struct Fitness {
    pair: Pair,
    pub stages: [Stage; 2],
}

fn descriptors() -> impl Iterator<Item = Parameters> {
    spread().take(DESCRIPTORS as usize)
}

impl Fitness {
    /// Prepares the training clouds on the current pool; all clouds of the set are known already.
    pub fn new(root: &Path, all: &[Prepared]) -> Self {
        let pair = Pair::prepare(root, LISTS[0], LISTS[1]);
        let lists = LISTS.map(|list| listed(root, &[list]));
        let is_training = |cloud: &&Prepared| lists.iter().any(|list| list.contains(&cloud.path));
        let counts: Counts = all.iter().filter(is_training).map(|cloud| cloud.counts).sum();
        assert_eq!(pair.keypoints_and_records(), [counts.described, counts.within(50_000)], "counts differ");

        let [queries, clouds] = lists.map(|list| list.len() as u64);
        let [mut records, mut row_values, mut terms] = [0; 3];
        for parameters in descriptors() {
            let (means, values) = values(&Descriptor::DiskRing(parameters), &all[0]);
            assert!(means.iter().all(|&bins| bins / 2 <= 64), "more bins than are counted in vectors");
            records += counts.within(parameters.ring_um);
            row_values += counts.described * means.iter().sum::<u64>();
            terms += queries * clouds * values;
        }
        let [records, row_values, terms] = [records, row_values, terms].map(|sum| sum / DESCRIPTORS);
        // A record is a byte of angle and one of colour.
        let describe = Work::given([(counts.described, "keypoints"), (records, "records in their regions")])
            .and_increments(2 * records, 64)
            .and_rows(row_values, 1)
            .and(2 * records, Element::MemoryByte);
        let matching = Work::given([(queries, "queries"), (clouds, "clouds")]).and(terms, Element::Term);
        let stages = [
            Stage::new("fitness: describe, all genes new", describe),
            Stage::new("fitness: match, all genes new", matching),
        ];
        Self { pair, stages }
    }

    /// Times the mean descriptor once more, on the current pool.
    pub fn sample(&mut self) {
        let [mut describe, mut matching] = [0.0; 2];
        for parameters in descriptors() {
            let evaluated = self.pair.evaluate(&parameters);
            describe += evaluated.describe;
            matching += evaluated.matching;
        }
        let seconds = [describe, matching].map(|sum| sum / DESCRIPTORS as f64);
        self.stages.iter_mut().zip(seconds).for_each(|(stage, seconds)| stage.times.push(seconds));
    }
}
