//! What the tables have of each candidate: from its descriptions to answers, curves and a row.

use descriptor::recognise::Hit;
use descriptor::{Descriptor, Label, Match};
use proto::task::{self, EvaluationResult};
use results::{ComparedRow, Counts, PairRow, PredictionRow, RunFolder, RunRow, wilson};

use super::candidate::{Candidate, EVOLVED};
use super::described::Described;
use super::differences::{Level, Outcomes, error_interval, pairs};
use super::error::CompareError;
use super::recognition::Recognition;
use crate::dataset::Dataset;
use crate::evaluate::compared_by;
use crate::run::{Matching, rows};

/// What is the same for all candidates.
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
    outcomes: Outcomes,
}

impl Tables<'_> {
    /// Matches a candidate's clouds and writes answers, curves and distances.
    ///
    /// # Errors
    /// If it describes nothing, differs from the run's own final test, or cannot be written.
    pub fn add(&self, candidate: &Candidate, described: &Described) -> Result<Compared, CompareError> {
        let database = Matching::Test.database_clouds(self.dataset);
        let sequence = |&cloud: &u32| self.dataset.clouds.entries[cloud as usize].sequence;
        let sequences: Vec<Option<u32>> = database.iter().map(sequence).collect();
        let known = (self.dataset.splits.trained() as u32, &sequences[..]);
        let recognition = Recognition::new(candidate, described, self.labels, known)?;
        let outcomes = judge(candidate, &recognition, self.labels);
        let counts = counts(&outcomes);
        if counts.queries == 0 {
            return Err(CompareError::NothingDescribed { label: candidate.label.clone() });
        }
        self.confirm(candidate, counts)?;
        Ok(self.write(candidate, &recognition, outcomes)?)
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
        let outcomes = judge(candidate, &recognition, self.labels);
        self.write(candidate, &recognition, outcomes)
    }

    fn write(
        &self,
        candidate: &Candidate,
        recognition: &Recognition,
        outcomes: Outcomes,
    ) -> Result<Compared, results::Error> {
        let matches = recognition.matches.iter().map(|&(query, found)| (query, numbered(found)));
        let answers = rows::answers(self.dataset, Matching::Test, matches);
        let (curves, distances) = (&recognition.curves, &recognition.distances);
        self.out.write_compared(&candidate.label, &answers, curves, distances)?;
        let queries = (self.labels[0], self.run.seed);
        let row = row(candidate, recognition, &outcomes, queries);
        Ok(Compared { row, answers, is_abridged: recognition.is_abridged, outcomes })
    }

    /// Refuses counts of the evolved descriptor that differ from those of the run's final test.
    fn confirm(&self, candidate: &Candidate, counts: Counts) -> Result<(), CompareError> {
        let then = self.run.test.filter(|then| candidate.label == EVOLVED && *then != counts);
        let Some(then) = then else { return Ok(()) };
        let [then, now] =
            [then, counts].map(|counts| format!("{} of {}", counts.object_correct, counts.queries));
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

fn numbered(found: Match) -> task::Match {
    task::Match {
        nearest: found.nearest.index,
        distance: found.nearest.distance,
        runner_up: found.runner_up.map(|hit| (hit.index, hit.distance)),
    }
}

fn judge(candidate: &Candidate, recognition: &Recognition, [queries, database]: [&[Label]; 2]) -> Outcomes {
    let mut right = vec![None; queries.len()];
    for (query, found) in &recognition.matches {
        let (asked, got) = (queries[*query as usize], database[found.nearest.index as usize]);
        right[*query as usize] = Some([asked.instance == got.instance, asked.category == got.category]);
    }
    Outcomes { label: candidate.label.clone(), right }
}

fn counts(judged: &Outcomes) -> Counts {
    let described = || judged.right.iter().flatten();
    Counts {
        object_correct: described().filter(|right| right[0]).count() as u32,
        category_correct: described().filter(|right| right[1]).count() as u32,
        queries: described().count() as u32,
    }
}

fn row(
    candidate: &Candidate,
    recognition: &Recognition,
    judged: &Outcomes,
    (queries, seed): (&[Label], u64),
) -> ComparedRow {
    let counts = counts(judged);
    let intervals = |correct: u32, level| {
        let by_wilson = wilson(counts.queries - correct, counts.queries);
        [by_wilson, error_interval(judged, level, queries, seed).unwrap_or(by_wilson)]
    };
    let area =
        |name| recognition.curves.iter().find(|curve| curve.name == name).and_then(results::Curve::area);
    let learned = recognition.learned.as_ref();
    let cloud_size = learned
        .and_then(|(recogniser, _)| recogniser.size())
        .unwrap_or_else(|| candidate.descriptor.size_of_cloud() as usize);
    let [object_wilson, object_bootstrap] = intervals(counts.object_correct, Level::Object);
    let [category_wilson, category_bootstrap] = intervals(counts.category_correct, Level::Category);
    ComparedRow {
        descriptor: candidate.label.clone(),
        kind: candidate.descriptor.family().name().to_owned(),
        distance: compared_by(&candidate.descriptor, candidate.distance).to_owned(),
        parameters: candidate.descriptor.parameters(),
        size: candidate.descriptor.size() as u32,
        recogniser: Some(candidate.recogniser.name().to_owned()),
        cloud_size: Some(cloud_size as u32),
        settings: learned.map(|(_, chosen)| chosen.settings.to_string()),
        database_error: learned.map(|(_, chosen)| chosen.error()),
        note: candidate.note().map(str::to_owned),
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
        bytes: Some(hexadecimal(&candidate.descriptor.to_bytes())),
    }
}

/// Bytes as the tables have them.
pub fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The descriptor that a row is of; `None` if that cannot be told, as in tables of earlier releases.
pub fn descriptor_of(row: &ComparedRow) -> Option<Descriptor> {
    let text = row.bytes.as_deref()?.as_bytes();
    let byte = |digits: &[u8]| u8::from_str_radix(str::from_utf8(digits).ok()?, 16).ok();
    let bytes: Vec<u8> = text.chunks(2).map(byte).collect::<Option<_>>()?;
    Descriptor::from_bytes(&bytes)
        .ok()
        .filter(|descriptor| hexadecimal(&descriptor.to_bytes()).as_bytes() == text)
}
