//! Whether descriptors differ: every pair of them on the same test clouds.

use std::borrow::Borrow;
use std::collections::BTreeMap;

use descriptor::{Label, random};
use rand::RngExt as _;
use results::{Cluster, Counts, ErrorRate, PairRow, RunRow, bootstrap, holm, mcnemar, tango};

/// A p-value below it, after Holm, is evidence of a difference.
pub const SIGNIFICANCE: f64 = 0.05;

/// Resamples of the bootstrap.
const RESAMPLES: usize = 10_000;

/// What is to be recognised.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// The very object.
    Object,
    /// One of its category.
    Category,
}

impl Level {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Object, Self::Category];

    /// What a run's fitness counts.
    pub fn of(run: &RunRow) -> Self {
        if run.counts_categories() { Self::Category } else { Self::Object }
    }

    /// What a cloud is called of which it is not recognised.
    pub fn wrong(self) -> &'static str {
        match self {
            Self::Object => "wrong",
            Self::Category => "taken for another category",
        }
    }

    /// What is wrong at this level.
    pub fn errors(self, counts: Counts) -> ErrorRate {
        match self {
            Self::Object => counts.object_errors(),
            Self::Category => counts.category_errors(),
        }
    }

    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Object => "object",
            Self::Category => "category",
        }
    }
}

/// Which queries a descriptor recognises.
pub struct Outcomes {
    /// The descriptor.
    pub label: String,
    /// For each query whether object and category are right; `None` of those that it cannot describe.
    pub right: Vec<Option<[bool; 2]>>,
}

impl Outcomes {
    fn at(&self, level: Level, query: usize) -> Option<bool> {
        self.right[query].map(|right| right[level as usize])
    }

    /// How many queries are described, and how many of them recognised.
    pub fn counts(&self) -> Counts {
        let correct = |level: usize| self.right.iter().flatten().filter(|right| right[level]).count() as u32;
        let [object_correct, category_correct] = [correct(0), correct(1)];
        Counts { object_correct, category_correct, queries: self.right.iter().flatten().count() as u32 }
    }

    /// The 95 % intervals of the error: Wilson's, and that of the bootstrap over objects, or Wilson's again where that says
    /// nothing.
    pub fn intervals(&self, level: Level, queries: &[Label], seed: u64) -> [[f64; 2]; 2] {
        let counts = self.counts();
        let by_wilson = level.errors(counts).interval();
        [by_wilson, error_interval(self, level, queries, seed).unwrap_or(by_wilson)]
    }
}

/// The 95 % interval of a descriptor's error by the bootstrap over objects; `None` if it says nothing, as [`resampled`].
fn error_interval(outcomes: &Outcomes, level: Level, queries: &[Label], seed: u64) -> Option<[f64; 2]> {
    let wrong = |query| outcomes.at(level, query).map(|right| f64::from(u8::from(!right)));
    resampled(&clusters(queries, wrong), &format!("error of {} {}", level.name(), outcomes.label), seed)
}

/// Every pair of descriptors, on the queries that both describe.
pub fn pairs(all: &[impl Borrow<Outcomes>], level: Level, queries: &[Label], seed: u64) -> Vec<PairRow> {
    let mut rows = Vec::new();
    for (index, a) in all.iter().enumerate() {
        for b in &all[index + 1..] {
            rows.extend(pair([a.borrow(), b.borrow()], level, queries, seed));
        }
    }
    let adjusted = holm(&rows.iter().map(|row| row.p_value).collect::<Vec<f64>>());
    for (row, adjusted) in rows.iter_mut().zip(adjusted) {
        row.p_adjusted = adjusted;
    }
    rows
}

/// `None` if no query is described by both.
fn pair([a, b]: [&Outcomes; 2], level: Level, queries: &[Label], seed: u64) -> Option<PairRow> {
    let both = |query| a.at(level, query).zip(b.at(level, query));
    let mut outcomes = [0; 4];
    for (a, b) in (0..queries.len()).filter_map(both) {
        outcomes[2 * usize::from(!a) + usize::from(!b)] += 1;
    }
    let difference = |query| both(query).map(|(a, b)| f64::from(i8::from(b) - i8::from(a)));
    let purpose = format!("difference of {} {} {}", level.name(), a.label, b.label);
    let [both_right, only_a, only_b, both_wrong] = outcomes;
    let of: u32 = outcomes.iter().sum();
    if of == 0 {
        return None;
    }
    let [difference_low, difference_high] = resampled(&clusters(queries, difference), &purpose, seed)
        .unwrap_or_else(|| tango(only_a, only_b, of));
    let p_value = mcnemar(only_a, only_b);
    Some(PairRow {
        level: level.name().to_owned(),
        descriptor_a: a.label.clone(),
        descriptor_b: b.label.clone(),
        both_right,
        only_a,
        only_b,
        both_wrong,
        difference_low,
        difference_high,
        p_value,
        p_adjusted: p_value,
    })
}

/// A p-value as people write it.
pub fn probability(p: f64) -> String {
    if p < 0.0001 { "< 0.0001".to_owned() } else { format!("{p:.4}") }
}

/// The sum of `of` over the queries of each object.
fn clusters(queries: &[Label], of: impl Fn(usize) -> Option<f64>) -> Vec<Cluster> {
    let mut objects: BTreeMap<u32, Cluster> = BTreeMap::new();
    for (query, label) in queries.iter().enumerate() {
        if let Some(value) = of(query) {
            let object = objects.entry(label.instance).or_insert(Cluster { sum: 0.0, clouds: 0 });
            object.sum += value;
            object.clouds += 1;
        }
    }
    objects.into_values().collect()
}

/// The 95 % interval of the mean over clouds, by the bootstrap over objects; `None` if there is no cloud, and if all objects
/// have the same mean, as where none or all clouds are wrong, or where there is one object: then resamples are all the
/// same, and say nothing of how sure that is.
fn resampled(objects: &[Cluster], purpose: &str, seed: u64) -> Option<[f64; 2]> {
    let first = objects.first()?;
    let is_as_first =
        |other: &Cluster| other.sum * f64::from(first.clouds) == first.sum * f64::from(other.clouds);
    if objects.iter().all(is_as_first) {
        return None;
    }
    let mut rng = random::stream(seed, purpose, &[]);
    bootstrap(objects, RESAMPLES, |below| rng.random_range(0..below as u64) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 60 queries of 6 objects; `right` decides by query.
    fn outcomes(label: &str, right: impl Fn(usize) -> Option<bool>) -> Outcomes {
        let right = (0..60).map(|query| right(query).map(|right| [right, true])).collect();
        Outcomes { label: label.to_owned(), right }
    }

    fn labels() -> Vec<Label> {
        (0..60).map(|query| Label { category: 0, instance: query / 10 }).collect()
    }

    #[test]
    fn a_pair_counts_the_queries_that_both_describe() {
        let a = outcomes("a", |query| (query != 59).then_some(query % 3 != 0));
        let b = outcomes("b", |query| (query != 0).then_some(query % 2 != 0));
        let [row] = &pairs(&[a, b], Level::Object, &labels(), 1)[..] else { panic!("one pair") };
        // Of 1 ..= 58: multiples of 3 are wrong under a, even ones under b, multiples of 6 under both.
        let count = |which: fn(usize) -> bool| (1..59).filter(|&query| which(query)).count() as u32;
        let expected = [
            count(|q| q % 3 != 0 && q % 2 != 0),
            count(|q| q % 3 != 0 && q % 2 == 0),
            count(|q| q % 3 == 0 && q % 2 != 0),
            count(|q| q % 6 == 0),
        ];
        assert_eq!([row.both_right, row.only_a, row.only_b, row.both_wrong], expected);
        assert_eq!(row.queries(), 58);
        assert_eq!(row.p_value, mcnemar(expected[1], expected[2]));
        let difference = row.error_difference();
        assert!(row.difference_low <= difference && difference <= row.difference_high);
        // Both always name the category.
        let all = [outcomes("a", |_| Some(false)), outcomes("b", |_| Some(true))];
        let [row] = &pairs(&all, Level::Category, &labels(), 1)[..] else { panic!("one pair") };
        assert_eq!((row.both_right, row.only_a, row.only_b, row.both_wrong), (60, 0, 0, 0));
        // Which is no proof that they are equal.
        assert_eq!((row.p_value, [row.difference_low, row.difference_high]), (1.0, tango(0, 0, 60)));
    }

    #[test]
    fn an_error_that_sits_in_one_object_is_less_certain_than_one_that_is_spread() {
        let one_object = outcomes("a", |query| Some(query >= 10));
        let spread = outcomes("b", |query| Some(query % 6 != 0));
        let width = |of: &Outcomes| {
            let [low, high] = error_interval(of, Level::Object, &labels(), 7).unwrap();
            assert!(low <= 1.0 / 6.0 && 1.0 / 6.0 <= high, "{low} {high}");
            high - low
        };
        assert!(width(&one_object) > 2.0 * width(&spread));
        assert_eq!(error_interval(&outcomes("c", |_| None), Level::Object, &labels(), 7), None);
    }

    #[test]
    fn seed_and_purpose_decide_what_is_drawn() {
        // Sums so different that no two samples have the same ends.
        let objects: Vec<Cluster> =
            (0..20).map(|object| Cluster { sum: f64::from(object * object) / 7.0, clouds: 60 }).collect();
        let by = |purpose, seed| resampled(&objects, purpose, seed).unwrap();
        assert_eq!(by("error of a", 7), by("error of a", 7));
        assert_ne!(by("error of a", 7), by("error of a", 8));
        assert_ne!(by("error of a", 7), by("error of b", 7));
    }

    #[test]
    fn an_error_of_nothing_or_all_has_no_interval_by_resampling() {
        let interval = |right: fn(usize) -> bool| {
            error_interval(&outcomes("a", |query| Some(right(query))), Level::Object, &labels(), 1)
        };
        assert_eq!([interval(|_| true), interval(|_| false)], [None; 2]);
        // One cloud that is wrong, or right: resamples differ.
        assert!(interval(|query| query != 3).unwrap()[1] > 0.0);
        assert!(interval(|query| query == 3).unwrap()[0] < 1.0);
        // One of ten clouds of each object: all resamples have the same error.
        assert_eq!(interval(|query| query % 10 != 0), None);
        // Whole objects that are wrong are not all.
        assert_eq!(interval(|query| query < 30).map(|[low, high]| low < 0.5 && high > 0.5), Some(true));
    }

    #[test]
    fn a_difference_that_resampling_says_nothing_of_has_an_interval_all_the_same() {
        let pair = |right: fn(usize) -> bool| {
            let all = [outcomes("a", |_| Some(true)), outcomes("b", |query| Some(right(query)))];
            pairs(&all, Level::Object, &labels(), 1).remove(0)
        };
        // The same answers; one cloud of each object; all clouds.
        for (row, only_a) in [(pair(|_| true), 0), (pair(|query| query % 10 != 0), 6), (pair(|_| false), 60)]
        {
            let interval = [row.difference_low, row.difference_high];
            assert_eq!((interval, row.only_a), (tango(only_a, 0, 60), only_a));
            assert!(interval[0] < interval[1], "{interval:?}");
        }
        // No query that both describe.
        let none = [
            outcomes("a", |query| (query < 30).then_some(true)),
            outcomes("b", |query| (query >= 30).then_some(true)),
        ];
        assert_eq!(pairs(&none, Level::Object, &labels(), 1), []);
    }

    #[test]
    fn values_are_corrected_for_all_pairs_of_a_level() {
        let all = [
            outcomes("a", |_| Some(true)),
            outcomes("b", |query| Some(query >= 8)),
            outcomes("c", |query| Some(query >= 9)),
        ];
        let rows = pairs(&all, Level::Object, &labels(), 1);
        let adjusted: Vec<f64> = rows.iter().map(|row| row.p_adjusted).collect();
        assert_eq!(adjusted, holm(&rows.iter().map(|row| row.p_value).collect::<Vec<_>>()));
        assert!(rows.len() == 3 && adjusted[0] == 2.0 * rows[0].p_value);
    }
}
