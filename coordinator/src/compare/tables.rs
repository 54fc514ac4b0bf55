//! What the tables have of each candidate: from its descriptions to answers, curves and a row.

use descriptor::recognise::Hit;
use descriptor::recogniser::{LearnedRecogniser, Method};
use descriptor::{Descriptor, Label, Match};
use proto::task::{self, EvaluationResult};
use results::{ComparedRow, Counts, PairRow, PredictionRow, RunFolder, RunRow};

use super::candidate::{Candidate, EVOLVED};
use super::described::Described;
use super::error::CompareError;
use super::foreign::{FOREIGN, ForeignCandidate};
use super::pairs::{Level, Outcomes, pairs};
use super::recognition::Recognition;
use crate::dataset::Dataset;
use crate::evaluate::compared_by;
use crate::reference_clouds::sequences;
use crate::run::{Matching, rows};

/// What is the same for all candidates.
#[derive(Clone, Copy)]
pub struct Tables<'a> {
    /// The run's row.
    pub run: &'a RunRow,
    /// Its clouds.
    pub dataset: &'a Dataset,
    /// What test queries and their database show.
    pub labels: [&'a [Label]; 2],
    /// Where tables are written.
    pub out: &'a RunFolder,
}

/// One candidate's answers.
pub struct Compared {
    /// Its row, without times.
    pub row: ComparedRow,
    /// Its nearest clouds.
    pub answers: Vec<PredictionRow>,
    /// Whether distances and the curve of all pairs are left out, because they are too many.
    pub is_abridged: bool,
    /// What has been learned from the database; `None` by the nearest cloud, and where it is not at hand.
    pub learned: Option<LearnedRecogniser>,
    outcomes: Outcomes,
}

impl Tables<'_> {
    /// Matches a candidate's clouds and writes answers, curves and distances.
    ///
    /// # Errors
    /// If it describes nothing, differs from the run's own final test, or cannot be written.
    pub fn add(&self, candidate: &Candidate, described: &Described) -> Result<Compared, CompareError> {
        let sequences = sequences(self.dataset);
        let known = (self.dataset.splits.trained() as u32, &sequences[..]);
        let recognition = Recognition::new(candidate, described, self.labels, known)?;
        let recognised = self.recognised(&candidate.label, recognition)?;
        Ok(self.write(About::of(candidate), recognised)?)
    }

    /// Writes the answers of an evaluation, one a query: of all pairs of clouds they tell nothing.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn add_evaluated(
        &self,
        candidate: &Candidate,
        result: &EvaluationResult,
    ) -> Result<Compared, results::Error> {
        let hit = |(index, distance)| Hit { index, distance };
        let found = |found: &task::Match| Match {
            nearest: hit((found.nearest, found.distance)),
            runner_up: found.runner_up.map(hit),
        };
        let matches = (0..).zip(result.matches.iter().map(found)).collect();
        let recognition = Recognition::of_matches(matches, self.labels);
        let outcomes = judge(&candidate.label, &recognition, self.labels);
        self.write(About::of(candidate), (recognition, outcomes))
    }

    /// The same of a descriptor from a file.
    ///
    /// # Errors
    /// If nothing can be learned from it, or it cannot be written.
    pub fn add_foreign(&self, candidate: &ForeignCandidate<'_>) -> Result<Compared, CompareError> {
        let recognition = Recognition::of_foreign(candidate, self.labels, &sequences(self.dataset))?;
        let foreign = candidate.descriptor;
        let about = About {
            label: &candidate.label,
            kind: FOREIGN,
            distance: foreign.distance(),
            parameters: foreign.parameters(),
            size: None,
            recogniser: candidate.recogniser,
            cloud_size: foreign.size(),
            note: None,
            bytes: None,
            file_digest: Some(foreign.digest.clone()),
        };
        let recognised = self.recognised(&candidate.label, recognition)?;
        Ok(self.write(about, recognised)?)
    }

    /// A descriptor from a file that is not given again: its row and its answers, as an earlier comparison has them.
    ///
    /// # Errors
    /// If its answers cannot be read, or are not those of the row.
    pub fn keep(&self, row: &ComparedRow) -> Result<Compared, CompareError> {
        let label = row.descriptor.clone();
        let answers = results::read_answers(self.out.path(), &label).map_err(CompareError::Earlier)?;
        let mut right = vec![None; self.labels[0].len()];
        for answer in &answers {
            if let Some(right) = right.get_mut(answer.query as usize) {
                *right = Some([
                    answer.predicted_instance == answer.instance,
                    answer.predicted_category == answer.category,
                ]);
            }
        }
        let outcomes = Outcomes { label, right };
        let now = outcomes.counts();
        if now != row.counts {
            let [then, now] = [row.counts, now].map(told);
            let label = outcomes.label;
            return Err(CompareError::Contradiction { label, what: "its answers", then, now });
        }
        Ok(Compared { row: row.clone(), answers, is_abridged: false, learned: None, outcomes })
    }

    /// Refuses a recognition of nothing, and one of the evolved descriptor that differs from the run's.
    fn recognised(
        &self,
        label: &str,
        recognition: Recognition,
    ) -> Result<(Recognition, Outcomes), CompareError> {
        let outcomes = judge(label, &recognition, self.labels);
        let counts = outcomes.counts();
        if counts.queries == 0 {
            return Err(CompareError::NothingDescribed { label: label.to_owned() });
        }
        self.confirm(label, counts)?;
        Ok((recognition, outcomes))
    }

    fn write(
        &self,
        about: About<'_>,
        (recognition, outcomes): (Recognition, Outcomes),
    ) -> Result<Compared, results::Error> {
        let label = about.label;
        let matches = recognition.matches.iter().map(|&(query, found)| (query, numbered(found)));
        let answers = rows::answers(self.dataset, Matching::Test, matches);
        let (curves, distances) = (&recognition.curves, &recognition.distances);
        self.out.write_compared(label, &answers, curves, distances)?;
        let queries = (self.labels[0], self.run.seed);
        let row = row(about, &recognition, &outcomes, queries);
        let is_abridged = recognition.is_abridged;
        let learned = recognition.learned.and_then(|learned| learned.recogniser);
        Ok(Compared { row, answers, is_abridged, learned, outcomes })
    }

    /// Refuses counts of the evolved descriptor that differ from those of the run's final test.
    fn confirm(&self, label: &str, counts: Counts) -> Result<(), CompareError> {
        let then = self.run.test.filter(|then| label == EVOLVED && *then != counts);
        let Some(then) = then else { return Ok(()) };
        let [then, now] = [then, counts].map(told);
        let label = EVOLVED.to_owned();
        Err(CompareError::Contradiction { label, what: "objects of the final test", then, now })
    }

    /// Every pair of candidates, objects first.
    pub fn pairs(&self, all: &[Compared]) -> Vec<PairRow> {
        let outcomes: Vec<&Outcomes> = all.iter().map(|one| &one.outcomes).collect();
        let of = |level| pairs(&outcomes, level, self.labels[0], self.run.seed);
        Level::ALL.into_iter().flat_map(of).collect()
    }
}

fn told(counts: Counts) -> String {
    format!("{} of {}", counts.object_correct, counts.queries)
}

/// What a row has of a descriptor before anything is recognised.
struct About<'a> {
    label: &'a str,
    kind: &'a str,
    distance: &'a str,
    parameters: String,
    size: Option<u32>,
    recogniser: Method,
    cloud_size: Option<u32>,
    note: Option<&'a str>,
    bytes: Option<String>,
    file_digest: Option<String>,
}

impl<'a> About<'a> {
    fn of(candidate: &'a Candidate) -> Self {
        let descriptor = &candidate.descriptor;
        Self {
            label: &candidate.label,
            kind: descriptor.family().name(),
            distance: compared_by(descriptor, candidate.distance),
            parameters: descriptor.parameters(),
            size: Some(descriptor.size() as u32),
            recogniser: candidate.recogniser,
            cloud_size: Some(descriptor.size_of_cloud() as u32),
            note: candidate.note(),
            bytes: Some(proto::hex(&descriptor.to_bytes())),
            file_digest: None,
        }
    }
}

fn numbered(found: Match) -> task::Match {
    task::Match {
        nearest: found.nearest.index,
        distance: found.nearest.distance,
        runner_up: found.runner_up.map(|hit| (hit.index, hit.distance)),
    }
}

fn judge(label: &str, recognition: &Recognition, [queries, database]: [&[Label]; 2]) -> Outcomes {
    let mut right = vec![None; queries.len()];
    for (query, found) in &recognition.matches {
        let (asked, got) = (queries[*query as usize], database[found.nearest.index as usize]);
        right[*query as usize] = Some([asked.instance == got.instance, asked.category == got.category]);
    }
    Outcomes { label: label.to_owned(), right }
}

fn row(
    about: About<'_>,
    recognition: &Recognition,
    judged: &Outcomes,
    (queries, seed): (&[Label], u64),
) -> ComparedRow {
    let counts = judged.counts();
    let area =
        |name| recognition.curves.iter().find(|curve| curve.name == name).and_then(results::Curve::area);
    let learned = recognition.learned.as_ref();
    let cloud_size =
        learned.and_then(|learned| learned.size).map_or(about.cloud_size, |size| Some(size as u32));
    let [[object_wilson, object_bootstrap], [category_wilson, category_bootstrap]] =
        Level::ALL.map(|level| judged.intervals(level, queries, seed));
    ComparedRow {
        descriptor: about.label.to_owned(),
        kind: about.kind.to_owned(),
        distance: about.distance.to_owned(),
        parameters: about.parameters,
        size: about.size,
        recogniser: Some(about.recogniser.name().to_owned()),
        cloud_size,
        settings: learned.map(|learned| learned.settings.clone()),
        database_error: learned.and_then(|learned| learned.error),
        note: about.note.map(str::to_owned),
        counts,
        object_wilson,
        category_wilson,
        object_bootstrap,
        category_bootstrap,
        skipped: queries.len() as u32 - counts.queries,
        database: recognition.database,
        keypoints_per_cloud: recognition.keypoints_per_cloud,
        cloud_seconds: None,
        times: None,
        area: area("all"),
        nearest_area: area("nearest"),
        bytes: about.bytes,
        file_digest: about.file_digest,
    }
}

/// The descriptor that a row is of; `None` if that cannot be told, as in tables of earlier releases.
pub fn descriptor_of(row: &ComparedRow) -> Option<Descriptor> {
    let text = row.bytes.as_deref()?.as_bytes();
    let byte = |digits: &[u8]| u8::from_str_radix(str::from_utf8(digits).ok()?, 16).ok();
    let bytes: Vec<u8> = text.chunks(2).map(byte).collect::<Option<_>>()?;
    Descriptor::from_bytes(&bytes)
        .ok()
        .filter(|descriptor| proto::hex(&descriptor.to_bytes()).as_bytes() == text)
}
