//! Rows `warm` and `weight`: one more descriptor on prepared clouds, training set 1 against 2, one thread.

use std::time::Instant;

use descriptor::{Correct, Parameters};

use crate::Bench;
use crate::cold;
use crate::peer::Work;
use tests::benches::machine::cores;
use tests::benches::prepared::{Pair, pool, spread};
use tests::benches::table::{Row, Samples, time};

/// Descriptors that are measured after each run of the peer.
const DESCRIPTORS: usize = 15;

/// Measures the rows that are wanted.
pub fn measure(bench: &mut Bench) {
    if !bench.wants(&["warm", "weight"]) {
        return;
    }
    let pair = pool(cores()).install(|| Pair::prepare(&bench.household.root, "train1.txt", "train2.txt"));
    let one_thread = pool(1);
    let correct = one_thread.install(|| pair.evaluate_at_once(&Parameters::PAPER_BEST));
    check_with_program(bench, correct);

    let (mut all_new, mut weight_new) = (AllNew::default(), Samples::default());
    for _ in 0..bench.repetitions {
        bench.peer.run(Work::Fitness);
        one_thread.install(|| {
            if bench.wants(&["warm"]) {
                all_new.measure(&pair, correct);
            }
            if bench.wants(&["weight"]) {
                measure_weights(&pair, correct, &mut weight_new);
            }
        });
    }
    let peer = bench.peer.anchors(Work::Fitness);
    if bench.wants(&["warm"]) {
        bench.table.add(Row {
            name: "warm",
            what: "one new chromosome, all genes new, 352 against 352, one thread".to_owned(),
            own: all_new.spread,
            peer,
            notes: vec![
                format!(
                    "describe {}, match {}",
                    time(all_new.describe.median()),
                    time(all_new.matching.median())
                ),
                format!("the paper's chromosome, which PCL computes here: {}", all_new.paper),
            ],
        });
    }
    if bench.wants(&["weight"]) {
        bench.table.add(Row {
            name: "weight",
            what: "only w new, 352 against 352, one thread".to_owned(),
            own: weight_new,
            peer,
            notes: Vec::new(),
        });
    }
}

/// Times of descriptors of which nothing was known.
#[derive(Default)]
struct AllNew {
    spread: Samples,
    describe: Samples,
    matching: Samples,
    paper: Samples,
}

impl AllNew {
    fn measure(&mut self, pair: &Pair, correct: Correct) {
        for parameters in spread().take(DESCRIPTORS) {
            let new = pair.evaluate(&parameters);
            self.spread.push(new.describe + new.matching);
            self.describe.push(new.describe);
            self.matching.push(new.matching);
            let paper = pair.evaluate(&Parameters::PAPER_BEST);
            assert_eq!(paper.correct, correct, "warm: differs from the evaluation at once");
            self.paper.push(paper.describe + paper.matching);
        }
    }
}

/// Times every w on the distances of the paper's chromosome.
fn measure_weights(pair: &Pair, correct: Correct, times: &mut Samples) {
    let distances = pair.distances(&Parameters::PAPER_BEST);
    for percent in 0..=100 {
        let weight = Parameters { shape_weight_ppm: 10_000 * percent, ..Parameters::PAPER_BEST };
        let clock = Instant::now();
        let found = pair.recognise(&distances, weight.shape_weight());
        times.push(clock.elapsed().as_secs_f64());
        if weight == Parameters::PAPER_BEST {
            assert_eq!(found, correct, "weight: differs from the evaluation at once");
        }
    }
}

/// The library's counts are those of the program, which prepares the clouds for this one descriptor only.
fn check_with_program(bench: &Bench, correct: Correct) {
    let report = cold::evaluate(bench, Work::Fitness.lists());
    let wrong = ["object_wrong", "category_wrong"].map(|count| report[count].as_u64());
    let expected = [correct.object, correct.category].map(|right| Some((correct.queries - right) as u64));
    assert_eq!(wrong, expected, "warm: differs from coordinator evaluate");
}
