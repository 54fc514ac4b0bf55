//! The leak of a split: how well raw camera coordinates alone recognise objects.
//!
//! Frames of one recording show an object at one place, so that a query may be recognised by where its object stood. A
//! search that is rewarded for it finds descriptors of places, which are worth nothing in the next recording.

use rayon::prelude::*;

use super::{CloudEntry, Dataset, SequencesMissing};

/// Where the points of a cloud are in the camera's frame, in the unit of the file: mean, least and largest x, y, z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Position([f64; 9]);

impl Position {
    /// `None` without points.
    pub(super) fn of(points: &[[f32; 3]]) -> Option<Self> {
        let first = points.first()?.map(f64::from);
        let (mut sum, mut least, mut largest) = ([0.0; 3], first, first);
        for point in points {
            for (axis, value) in point.iter().map(|&value| f64::from(value)).enumerate() {
                sum[axis] += value;
                least[axis] = value.min(least[axis]);
                largest[axis] = value.max(largest[axis]);
            }
        }
        let mut position = [0.0; 9];
        for axis in 0..3 {
            position[axis] = sum[axis] / points.len() as f64;
            position[3 + axis] = least[axis];
            position[6 + axis] = largest[axis];
        }
        Some(Self(position))
    }

    /// Square of the Euclidean distance.
    fn distance2(&self, other: &Self) -> f64 {
        self.0.iter().zip(&other.0).map(|(a, b)| (a - b) * (a - b)).sum()
    }
}

/// How many queries the nearest position of a database names the object of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Recognised {
    /// Queries whose nearest cloud is of their object.
    pub correct: u32,
    /// Queries whose object has a cloud to be compared with.
    pub queries: u32,
    /// Share that would be correct if the nearest cloud was drawn from those compared.
    pub chance: f64,
}

/// How well positions recognise objects under different protocols; test clouds have no part in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Leak {
    /// train1 against train2.
    pub split: Recognised,
    /// Each cloud of train1 and train2 against those of other sequences, unless some have none.
    pub across: Result<Recognised, SequencesMissing>,
    /// validation against train1 and train2.
    pub validation: Recognised,
}

/// What a search can learn of positions, and what keeps it from that.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Positions tell little.
    Small,
    /// Positions tell much within sequences, and less than half as much across them.
    WithinSequences,
    /// Positions tell much across sequences, too: objects stood at the same places, or differ in size.
    Everywhere,
    /// Positions tell much; whether across sequences, too, cannot be measured.
    Unknown,
}

/// Share of what chance leaves from which on positions tell much. It is no share of all queries, because with few
/// objects guesses alone make a large one. Positions at random are at 0; a search can do better by appearance than by
/// positions below a fifth, because useful descriptors recognise well over half of such queries.
const MUCH: f64 = 0.2;
/// Standard deviations of guesses by which it must exceed chance, so that a handful of lucky queries is no leak.
const DEVIATIONS: f64 = 3.0;

impl Recognised {
    /// Share of the queries; 0 without any.
    pub fn share(&self) -> f64 {
        if self.queries == 0 { 0.0 } else { f64::from(self.correct) / f64::from(self.queries) }
    }

    /// Share of what chance leaves: 0 for guesses, 1 if all are correct.
    fn beyond_chance(&self) -> f64 {
        if self.chance < 1.0 { (self.share() - self.chance) / (1.0 - self.chance) } else { 0.0 }
    }

    /// Whether positions tell much: beyond chance, more than guesses may.
    pub fn is_much(&self) -> bool {
        let deviation = (self.chance * (1.0 - self.chance) / f64::from(self.queries.max(1))).sqrt();
        self.beyond_chance() > MUCH && self.share() - self.chance > DEVIATIONS * deviation
    }
}

impl Leak {
    /// Measures it; `positions` are of the data set's usable clouds.
    pub(super) fn measure(dataset: &Dataset, positions: &[Option<Position>]) -> Self {
        let clouds = |split: usize| {
            let placed = |&index: &u32| {
                let cloud = &dataset.clouds.entries[index as usize];
                positions[index as usize].map(|position| Placed { position, cloud })
            };
            dataset.splits.all()[split].iter().filter_map(placed)
        };
        let [train1, train2, validation] = [0, 1, 2].map(|split| clouds(split).collect::<Vec<_>>());
        let training = [&train1[..], &train2].concat();
        let any = |_: &Placed, _: &Placed| true;
        let of_another_sequence = |a: &Placed, b: &Placed| a.cloud.sequence != b.cloud.sequence;
        Self {
            split: recognise(&train1, &train2, any),
            across: match dataset.sequences_missing(&[0, 1]) {
                Some(missing) => Err(missing),
                None => Ok(recognise(&training, &training, of_another_sequence)),
            },
            validation: recognise(&validation, &training, any),
        }
    }

    /// What positions tell between train1 and train2, and what is left of it across sequences.
    pub fn verdict(&self) -> Verdict {
        match &self.across {
            _ if !self.split.is_much() => Verdict::Small,
            Ok(across) if across.queries == 0 => Verdict::Unknown,
            Ok(across) if across.beyond_chance() < self.split.beyond_chance() / 2.0 => {
                Verdict::WithinSequences
            }
            Ok(_) => Verdict::Everywhere,
            Err(_) => Verdict::Unknown,
        }
    }
}

/// A cloud and where its points are.
#[derive(Clone, Copy)]
struct Placed<'a> {
    position: Position,
    cloud: &'a CloudEntry,
}

/// Names each query's object by the nearest position, the first in the database on ties, among the clouds that it may
/// be compared with. A query whose object is not among them has no part.
fn recognise(
    queries: &[Placed],
    database: &[Placed],
    may_compare: impl Fn(&Placed, &Placed) -> bool + Sync,
) -> Recognised {
    let outcome = |query: &Placed| {
        let (mut all, mut same, mut nearest) = (0_u32, 0_u32, (f64::INFINITY, false));
        for other in database.iter().filter(|other| may_compare(query, other)) {
            let is_same = query.cloud.instance == other.cloud.instance;
            (all, same) = (all + 1, same + u32::from(is_same));
            let distance2 = query.position.distance2(&other.position);
            if distance2 < nearest.0 {
                nearest = (distance2, is_same);
            }
        }
        (same > 0).then(|| (nearest.1, f64::from(same) / f64::from(all)))
    };
    let outcomes: Vec<(bool, f64)> = queries.par_iter().filter_map(outcome).collect();
    let correct = outcomes.iter().filter(|(correct, _)| *correct).count();
    let chances: f64 = outcomes.iter().map(|(_, chance)| chance).sum();
    Recognised {
        correct: correct as u32,
        queries: outcomes.len() as u32,
        chance: if outcomes.is_empty() { 0.0 } else { chances / outcomes.len() as f64 },
    }
}

#[cfg(test)]
mod tests {
    use descriptor::random::stream;
    use proptest::prelude::*;
    use rand::RngExt;

    use super::*;

    fn cloud(instance: u32, sequence: u32) -> CloudEntry {
        CloudEntry {
            path: String::new(),
            category: 0,
            instance,
            sequence: Some(sequence),
            set: 0,
            digest: [0; 32],
            bytes: 0,
        }
    }

    #[test]
    fn a_position_is_mean_least_and_largest_of_each_coordinate() {
        let points = [[0.0, 4.0, 1.0], [1.0, -2.0, 1.0], [2.0, 1.0, 1.0]];
        assert_eq!(Position::of(&points), Some(Position([1.0, 1.0, 1.0, 0.0, -2.0, 1.0, 2.0, 4.0, 1.0])));
        assert_eq!(Position::of(&[]), None);
    }

    #[test]
    fn random_places_recognise_as_many_as_chance() {
        let mut rng = stream(1, "places", &[]);
        let entries: Vec<CloudEntry> = (0..1600).map(|index| cloud(index % 20, 0)).collect();
        let mut place = || Position(std::array::from_fn(|_| rng.random_range(0.0..1.0)));
        let placed: Vec<Placed> = entries.iter().map(|cloud| Placed { position: place(), cloud }).collect();
        let (queries, database) = placed.split_at(800);
        let Recognised { correct, queries, chance } = recognise(queries, database, |_, _| true);
        assert_eq!(queries, 800);
        assert!((chance - 0.05).abs() < 1e-12, "{chance}");
        // Binomial: 40 are expected, with a standard deviation of 6.2; five of them on either side.
        assert!((9..=71).contains(&correct), "{correct}");
    }

    #[test]
    fn a_few_lucky_queries_are_no_leak() {
        let recognised = |correct, queries, chance| Recognised { correct, queries, chance };
        assert!(!recognised(2, 4, 0.1).is_much(), "lucky: a deviation of 0.15");
        assert!(recognised(4, 4, 0.1).is_much());
        assert!(!recognised(0, 0, 0.0).is_much());
        assert!(!recognised(9, 9, 1.0).is_much(), "there is one object only");
        assert!(!recognised(270, 1000, 0.1).is_much(), "below a fifth of the 900 that chance leaves");
        assert!(recognised(290, 1000, 0.1).is_much());
    }

    proptest! {
        /// Against the definition, by sorting; small integers, so that there are ties.
        #[test]
        fn the_nearest_cloud_names_the_object(
            clouds in prop::collection::vec((prop::array::uniform9(0..3_u8), 0..3_u32, 0..2_u32), 0..12)
        ) {
            let entries: Vec<CloudEntry> = clouds.iter().map(|&(_, object, sequence)| cloud(object, sequence)).collect();
            let placed: Vec<Placed> = clouds
                .iter()
                .zip(&entries)
                .map(|((place, ..), cloud)| Placed { position: Position(place.map(f64::from)), cloud })
                .collect();
            let (mut correct, mut queries, mut chance) = (0, 0, 0.0);
            for query in &placed {
                let mut others: Vec<&Placed> =
                    placed.iter().filter(|other| other.cloud.sequence != query.cloud.sequence).collect();
                let same = others.iter().filter(|other| other.cloud.instance == query.cloud.instance).count();
                if same == 0 {
                    continue;
                }
                others.sort_by(|a, b| query.position.distance2(&a.position).total_cmp(&query.position.distance2(&b.position)));
                correct += u32::from(others[0].cloud.instance == query.cloud.instance);
                queries += 1;
                chance += same as f64 / others.len() as f64;
            }
            let got = recognise(&placed, &placed, |a, b| a.cloud.sequence != b.cloud.sequence);
            prop_assert_eq!((got.correct, got.queries), (correct, queries));
            prop_assert!((got.chance * f64::from(queries) - chance).abs() < 1e-9);
        }
    }
}
