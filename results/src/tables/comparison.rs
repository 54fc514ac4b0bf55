//! Rows of the tables that compare descriptors on a run's test clouds.

use crate::record::record;
use crate::statistics::ErrorRate;
use crate::tables::run::Counts;

record! {
    /// Seconds of each stage on one thread, queries and database together.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Times {
        read as "seconds_read": f64, "s",
            "reading and decoding, one thread, queries and database; null if not measured";
        keypoints as "seconds_keypoints": f64, "s",
            "keypoints, one thread, queries and database; null if not measured";
        normals as "seconds_normals": f64, "s",
            "normals, one thread, queries and database; null if not measured";
        describe as "seconds_describe": f64, "s",
            "histograms and their summaries, one thread, queries and database; null if not measured";
        matching as "seconds_match": f64, "s",
            "distances and nearest clouds, one thread, queries and database; null if not measured";
        total as "seconds_total": f64, "s",
            "wall time from the first read to the last match, one thread, queries and database; null if not measured";
        hardware: String, "", "processor on which the times were measured; null as they";
    }
}

impl Times {
    /// Seconds from the clouds to their signatures: of keypoints, normals and histograms.
    pub fn signatures(&self) -> f64 {
        self.keypoints + self.normals + self.describe
    }
}

record! {
    /// One descriptor on the test clouds.
    #[derive(Clone, Debug, PartialEq)]
    pub struct ComparedRow {
        /// Unique in the comparison:
        descriptor: String, "", "label of the descriptor, such as evolved, paper-projection, shotcolor-l1";
        kind: String, "", "family of the descriptor, for example disk-ring or pfhrgb; foreign: computed elsewhere";
        distance: String, "",
            "set distance: chi2 or l1; of a structure, for chi2, the metric of its channels; foreign: that of vectors, or given";
        parameters: String, "", "values of its genes, or its radius; foreign: what its file has";
        size: Option<u32>, "values", "real values of one keypoint's descriptor; null of foreign ones";
        recogniser: Option<String>, "",
            "nearest, projection or kernel-ridge; null in tables of earlier releases, where it is nearest";
        cloud_size: Option<u32>, "values",
            "values kept of a cloud, with a projection after it; null in tables of earlier releases, and of given distances";
        settings: Option<String>, "", "what the recogniser chose inside the database; null of nearest";
        database_error: Option<f64>, "share",
            "clouds of the database not recognised by others, a sequence or fold left out at a time, with these settings; null of \
             nearest, and where none could be asked";
        note: Option<String>, "", "what more there is to say";
        counts as "": Counts, "", "test clouds";
        object_wilson as "object_error": [f64; 2], "share",
            "object_error, by Wilson, as if clouds were independent";
        category_wilson as "category_error": [f64; 2], "share", "category_error, by Wilson";
        object_bootstrap as "object_error_instances": [f64; 2], "share",
            "object_error, by the bootstrap over objects; by Wilson where all objects have the same error";
        category_bootstrap as "category_error_instances": [f64; 2], "share",
            "category_error, by the bootstrap over objects; by Wilson where all objects have the same error";
        skipped: u32, "clouds", "queries that this descriptor cannot describe";
        database: u32, "clouds", "clouds that queries are matched with";
        keypoints_per_cloud: Option<f64>, "", "mean over queries and database; null if not measured";
        cloud_seconds as "seconds_cloud": Option<f64>, "s",
            "keypoints, normals and histograms of a cloud, one thread: median of some test clouds; null if not measured";
        times as "": Option<Times>, "", "null if not measured";
        area: Option<f64>, "",
            "mean precision over recall, all pairs: area between the curve and 1 - precision = 1; null if they are too many, if none shows the same object, and of recognisers that learn";
        nearest_area: Option<f64>, "", "the same of the curve of answers only: of the nearest clouds, or of the objects with the highest scores";
        bytes: Option<String>, "",
            "canonical bytes of the descriptor, hexadecimal: by them a later comparison has it again; null of foreign ones";
        file_digest: Option<String>, "", "BLAKE3 of the file that a foreign descriptor was given in, hexadecimal";
    }
}

impl ComparedRow {
    /// Milliseconds from a cloud's points to its signatures, where they were measured: the median of some, as at the end
    /// of a run, or else the mean of all.
    pub fn milliseconds_of_a_cloud(&self) -> Option<f64> {
        self.cloud_seconds.or_else(|| self.mean_seconds()).map(|seconds| 1000.0 * seconds)
    }

    fn mean_seconds(&self) -> Option<f64> {
        let clouds = f64::from(self.counts.queries + self.database);
        self.times.as_ref().map(|times| times.signatures() / clouds)
    }

    /// How many times as long as `other` it takes from a cloud's points to its signatures, in the mean over all clouds;
    /// `None` where that was not measured of both on the same processor.
    pub fn mean_time_beside(&self, other: &Self) -> Option<f64> {
        let hardware = |row: &Self| row.times.as_ref().map(|times| times.hardware.clone());
        if hardware(self) != hardware(other) {
            return None;
        }
        ratio(self.mean_seconds()?, other.mean_seconds()?)
    }

    /// The same, or else by the medians, which are measured of all descriptors in one go as a run ends.
    pub fn time_beside(&self, other: &Self) -> Option<f64> {
        let by_medians = || ratio(self.cloud_seconds?, other.cloud_seconds?);
        self.mean_time_beside(other).or_else(by_medians)
    }
}

fn ratio(seconds: f64, other: f64) -> Option<f64> {
    (other > 0.0).then(|| seconds / other)
}

record! {
    /// One descriptor on perturbed test clouds, matched with the database as it is.
    #[derive(Clone, Debug, PartialEq)]
    pub struct PerturbedRow {
        descriptor: String, "", "label of the descriptor";
        kind: String, "", "noise, density, occlusion or light";
        strength: f64, "the column unit's", "how strong the perturbation is; 0: none";
        unit: String, "", "mm, % removed or % gain";
        counts as "": Counts, "", "test clouds";
        unusable: u32, "clouds",
            "test clouds that the descriptor describes as they are, but not when perturbed: they count as wrong";
        object_wilson as "object_error": [f64; 2], "share",
            "object_error, by Wilson, as if clouds were independent";
        category_wilson as "category_error": [f64; 2], "share", "category_error, by Wilson";
        object_bootstrap as "object_error_instances": [f64; 2], "share",
            "object_error, by the bootstrap over objects; by Wilson where all objects have the same error";
        category_bootstrap as "category_error_instances": [f64; 2], "share",
            "category_error, by the bootstrap over objects; by Wilson where all objects have the same error";
    }
}

record! {
    /// One descriptor on the test clouds of one set, each matched with clouds of the same set.
    #[derive(Clone, Debug, PartialEq)]
    pub struct SetRow {
        descriptor: String, "", "label of the descriptor";
        set: String, "", "name of the set";
        weight: u32, "", "of the set in the fitness; 0: the search has not seen the set";
        counts as "": Counts, "", "test clouds";
        object_wilson as "object_error": [f64; 2], "share",
            "object_error, by Wilson, as if clouds were independent";
        category_wilson as "category_error": [f64; 2], "share", "category_error, by Wilson";
    }
}

record! {
    /// Two descriptors on the same test clouds.
    #[derive(Clone, Debug, PartialEq)]
    pub struct PairRow {
        level: String, "", "object or category";
        descriptor_a: String, "", "label of one descriptor";
        descriptor_b: String, "", "label of a later one";
        => queries: u32, "clouds", "test clouds that both descriptors describe" = |pair, _| pair.queries();
        both_right: u32, "clouds", "recognised by both";
        only_a: u32, "clouds", "recognised by the first only";
        only_b: u32, "clouds", "recognised by the second only";
        both_wrong: u32, "clouds", "recognised by neither";
        => error_difference: f64, "share", "error of the first minus error of the second"
            = |pair, _| pair.error_difference();
        difference_low: f64, "share", "lower end of its 95 % interval, bootstrap over objects; by Tango over clouds where all objects have the same difference";
        difference_high: f64, "share", "upper end of it";
        => odds_ratio: Option<f64>, "", "only_a / only_b; null if only_b is 0" = |pair, _| pair.odds_ratio();
        p_value: f64, "", "McNemar's exact test, two-sided";
        p_adjusted: f64, "", "the same after Holm, over all pairs of the level";
    }
}

impl PairRow {
    /// Queries that both describe.
    pub fn queries(&self) -> u32 {
        self.both_right + self.only_a + self.only_b + self.both_wrong
    }

    /// What either has wrong of these, the first first.
    pub fn errors(&self) -> [ErrorRate; 2] {
        [self.only_a, self.only_b].map(|only| ErrorRate::new(self.both_right + only, self.queries()))
    }

    /// Error of the first minus error of the second.
    pub fn error_difference(&self) -> f64 {
        (f64::from(self.only_b) - f64::from(self.only_a)) / f64::from(self.queries())
    }

    /// Odds that a query which only one recognises is recognised by the first.
    pub fn odds_ratio(&self) -> Option<f64> {
        (self.only_b > 0).then(|| f64::from(self.only_a) / f64::from(self.only_b))
    }
}

record! {
    /// The set distance of a query and a database cloud.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct DistanceRow {
        query: u32, "", "index of the query in the test split, from 0";
        database: u32, "", "index of the database cloud: train1, train2, validation in order";
        distance: f32, "", "set distance";
    }
}

record! {
    /// A point of a curve.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct CurvePoint {
        distance: f64, "", "pairs up to this set distance are accepted";
        accepted: u64, "pairs", "how many these are";
        relevant as "relevant_accepted": u64, "pairs", "how many of them show the same object";
        => recall: f64, "share", "relevant_accepted / all relevant (nearest: all queries)"
            = |point, file| point.relevant as f64 / file.relevant as f64;
        => one_minus_precision: f64, "share", "1 - relevant_accepted / accepted"
            = |point, _| (point.accepted - point.relevant) as f64 / point.accepted as f64;
    }
}

/// A descriptor's recall against 1 − precision.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// `all` or `nearest`.
    pub name: &'static str,
    /// What recall is a share of; at least 1.
    pub relevant: u64,
    /// One for each distinct distance, ascending.
    pub points: Vec<CurvePoint>,
}

impl Curve {
    /// Area between the curve and 1 − precision = 1: precision times the step of recall, summed. `None` if nothing is
    /// relevant.
    pub fn area(&self) -> Option<f64> {
        let mut before = 0;
        let mut area = 0.0;
        for point in &self.points {
            let precision = point.relevant as f64 / point.accepted as f64;
            area += precision * (point.relevant - before) as f64;
            before = point.relevant;
        }
        (self.relevant > 0).then(|| area / self.relevant as f64)
    }
}
