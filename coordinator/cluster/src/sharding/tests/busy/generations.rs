//! What is asked for, generation after generation.

use proto::Digest;
use proto::task::{DescriptorBytes, Evaluation, Facts, Scale};

use super::worker::STAND_IN;
use crate::scheduler::Finished;
use crate::sharding::{AwaitingScales, FoundScale};

/// Clouds of either side of an evaluation.
pub const CLOUDS: u32 = 360;

/// A source of generations, which may depend on the scales that were found before.
pub trait Generations {
    /// The next generation, of clouds that are on these sides.
    fn next(&mut self, sides: [Digest; 2]) -> Asked;
    /// What is certain of the generation after that once a part of it is evaluated.
    fn foresee(&mut self, part: usize, sides: [Digest; 2]) -> Option<Asked>;
    /// The scales of the last one, in their order.
    fn found(&mut self, scales: Vec<Finished<FoundScale>>);
}

/// What is asked for together.
pub struct Asked {
    pub evaluations: Vec<AwaitingScales>,
    /// The part that each belongs to.
    pub parts: Vec<usize>,
    pub scales: Vec<Scale>,
    /// The descriptors that need the scales.
    pub needed_by: Vec<DescriptorBytes>,
}

/// Evaluations that have nothing in common but their clouds.
#[derive(Clone, Copy, Debug)]
pub struct Unrelated {
    /// Evaluations of a generation, …
    pub evaluations: u32,
    /// … and seconds that describing all clouds of one takes, and as many that matching them takes, …
    pub half: f64,
    /// … times a factor from one over this to this: evaluations differ in cost, as counted.
    pub spread: f64,
    /// Evaluations so far.
    pub asked: u32,
}

impl Unrelated {
    /// How many times the mean an evaluation costs.
    fn factor(&self, number: u32) -> f64 {
        let (count, place) = (self.evaluations, number % self.evaluations);
        let more = self.spread * self.spread - 1.0;
        let share = (f64::from(place * 7 % count) + 0.5) / f64::from(count);
        (1.0 + more * share) / (1.0 + more / 2.0) // 1 on average
    }

    /// The evaluation of this number in all generations. A unit of cost takes a nanosecond.
    fn evaluation(&self, number: u32, sides: [Digest; 2]) -> Evaluation {
        let mut evaluation = Evaluation::sample(number, CLOUDS, CLOUDS);
        (evaluation.query, evaluation.database) = (vec![sides[0]], vec![sides[1]]);
        let units = self.factor(number) * self.half * 1e9;
        evaluation.subject.facts = Facts {
            description_bytes: STAND_IN,
            cloud_cost: (units / f64::from(2 * CLOUDS)) as u64,
            pair_cost: (units / f64::from(CLOUDS * CLOUDS)) as u64,
            ..evaluation.subject.facts
        };
        evaluation
    }
}

impl Generations for Unrelated {
    fn next(&mut self, sides: [Digest; 2]) -> Asked {
        let first = self.asked;
        self.asked += self.evaluations;
        let evaluations = (first..self.asked).map(|number| self.evaluation(number, sides).into()).collect();
        let parts = vec![0; self.evaluations as usize];
        Asked { evaluations, parts, scales: Vec::new(), needed_by: Vec::new() }
    }

    fn foresee(&mut self, _: usize, _: [Digest; 2]) -> Option<Asked> {
        None
    }

    fn found(&mut self, _: Vec<Finished<FoundScale>>) {}
}
