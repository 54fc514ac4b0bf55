//! What a candidate makes of the test clouds: from the signatures of clouds to matches, distances and curves.

use descriptor::distance::{DistanceMatrix, set_distances};
use descriptor::recognise::{Hit, RecogniseError, nearest, recognise_from};
use descriptor::recogniser::{ChosenSettings, LabelledClouds, LearnedRecogniser, Method};
use descriptor::{Label, Match, Signatures};
use rayon::prelude::*;
use results::{Curve, DistanceRow};

use super::candidate::Candidate;
use super::curve::curve;
use super::described::Described;
use super::error::CompareError;
use super::foreign::ForeignCandidate;

/// Pairs of clouds of which distances and curve are kept: 350 MB while they are counted, 44 bytes each.
pub const MAX_PAIRS: usize = 8_000_000;

/// The answers of one candidate.
pub struct Recognition {
    /// Queries that it describes, as indices into the test split, with their matches, which number the database.
    pub matches: Vec<(u32, Match)>,
    /// Clouds of the database that it describes.
    pub database: u32,
    /// Mean number of keypoints of a cloud, where descriptions tell it.
    pub keypoints_per_cloud: Option<f64>,
    /// Of all pairs, if they are not too many and some show the same object, and of nearest clouds.
    pub curves: Vec<Curve>,
    /// Query, database cloud and their distance; empty if they are too many, and of recognisers that learn.
    pub distances: Vec<DistanceRow>,
    /// Whether distances and the curve of all pairs are left out, because they are too many.
    pub is_abridged: bool,
    /// What has been learned from the database; `None` by the nearest cloud.
    pub learned: Option<Learned>,
}

/// What a recogniser has learned from the database.
pub struct Learned {
    /// The recogniser; `None` of what is given in a file.
    pub recogniser: Option<LearnedRecogniser>,
    /// Values that are kept of a cloud if they are others than those of its description.
    pub size: Option<usize>,
    /// What it chose.
    pub settings: String,
    /// Share of the clouds of the database that were not recognised by the others; `None` if none was asked.
    pub error: Option<f64>,
}

impl Learned {
    fn of_signatures(recogniser: LearnedRecogniser, chosen: &ChosenSettings) -> Self {
        let (size, settings, error) = (recogniser.size(), chosen.settings.to_string(), chosen.error());
        Self { recogniser: Some(recogniser), size, settings, error }
    }
}

impl Recognition {
    /// From the answers of an evaluation, which tell of each query the nearest cloud only.
    pub fn of_matches(matches: Vec<(u32, Match)>, [queries, database]: [&[Label]; 2]) -> Self {
        let same =
            |query: u32, cloud: u32| queries[query as usize].instance == database[cloud as usize].instance;
        Self {
            database: database.len() as u32,
            keypoints_per_cloud: None,
            curves: vec![nearest_curve(&matches, same)],
            distances: Vec::new(),
            matches,
            is_abridged: true,
            learned: None,
        }
    }

    /// Matches queries with the database, by the current rayon pool. The first `trained` clouds of the database are those
    /// that a run's scales are found by; `sequences` are those of its clouds.
    ///
    /// # Errors
    /// If nothing of the database is described, or nothing can be learned from it.
    pub fn new(
        candidate: &Candidate,
        described: &Described,
        [query_labels, database_labels]: [&[Label]; 2],
        (trained, sequences): (u32, &[Option<u32>]),
    ) -> Result<Self, CompareError> {
        let [queries, database] = &described.clouds;
        let labels: Vec<Label> = database.iter().map(|&index| database_labels[index as usize]).collect();
        let known = database.iter().take_while(|&&cloud| cloud < trained).count();
        let failed = |source| CompareError::Recognise { label: candidate.label.clone(), source };
        let clouds = queries.len() + database.len();
        let keypoints_per_cloud = described.keypoints.map(|all| all as f64 / clouds as f64);
        // Without all distances: they are not kept, and nothing is learned from them.
        if candidate.recogniser == Method::Nearest && queries.len() * database.len() > MAX_PAIRS {
            let [asked, of_database] =
                [0, 1].map(|side| described.channels.iter().map(|both| &both[side]).collect::<Vec<_>>());
            let pruned = candidate.descriptor.pruned(candidate.distance, &of_database, &labels, known);
            let (found, _) = pruned.map_err(failed)?.recognise(&asked, true);
            let found =
                Self::of(found, [queries, database], [query_labels, database_labels], None, |_, _| ());
            return Ok(Self { keypoints_per_cloud, ..found });
        }
        let distances = candidate.descriptor.distances(candidate.distance, &described.channels, known);
        let learned = learn(candidate, described, &distances, database_labels, sequences)?;
        let found = match &learned {
            Some((recogniser, _)) => {
                let queries: Vec<&Signatures> =
                    described.channels.iter().map(|[queries, _]| queries).collect();
                recogniser.recognise(&queries, &distances)
            }
            None => recognise_from(queries.len(), &distances, &labels).map_err(failed)?,
        };
        let of_query = |query: usize, sums: &mut Vec<f64>| set_distances(&distances, query, sums);
        let learned = learned.map(|(recogniser, chosen)| Learned::of_signatures(recogniser, &chosen));
        let found = Self::of(found, [queries, database], [query_labels, database_labels], learned, of_query);
        Ok(Self { keypoints_per_cloud, ..found })
    }

    /// Matches queries with the database by what a file says of them.
    ///
    /// # Errors
    /// If nothing can be learned from it.
    pub fn of_foreign(
        candidate: &ForeignCandidate<'_>,
        labels: [&[Label]; 2],
        sequences: &[Option<u32>],
    ) -> Result<Self, CompareError> {
        let clouds = labels.map(|side| (0..side.len() as u32).collect::<Vec<u32>>());
        let foreign = candidate.descriptor;
        let objects: Vec<u32> = labels[1].iter().map(|label| label.instance).collect();
        let learned = foreign.learn(candidate.recogniser, &objects, sequences);
        let learned =
            learned.map_err(|source| CompareError::Learn { label: candidate.label.clone(), source })?;
        let matched = |query: usize| {
            if let Some(recogniser) = &learned {
                return Ok(foreign.recognise(recogniser, query));
            }
            nearest(&foreign.distances(query), labels[1]).ok_or_else(|| CompareError::Recognise {
                label: candidate.label.clone(),
                source: RecogniseError::EmptyDatabase,
            })
        };
        let found = (0..foreign.queries()).into_par_iter().map(matched).collect::<Result<_, _>>()?;
        let of_query = |query: usize, sums: &mut Vec<f64>| *sums = foreign.distances(query);
        let learned = learned.map(|recogniser| Learned {
            recogniser: None,
            size: recogniser.size(),
            settings: recogniser.chosen.settings.to_string(),
            error: recogniser.chosen.error(),
        });
        Ok(Self::of(found, [&clouds[0], &clouds[1]], labels, learned, of_query))
    }

    /// What follows from the matches of these clouds, which number them anew, and from the distances of each query.
    fn of(
        found: Vec<Match>,
        [queries, database]: [&[u32]; 2],
        [query_labels, database_labels]: [&[Label]; 2],
        learned: Option<Learned>,
        distances: impl Fn(usize, &mut Vec<f64>),
    ) -> Self {
        let count = queries.len();
        let number = |hit: Hit| Hit { index: database[hit.index as usize], ..hit };
        let numbered = found
            .into_iter()
            .map(|found| Match { nearest: number(found.nearest), runner_up: found.runner_up.map(number) });
        let matches: Vec<(u32, Match)> = queries.iter().copied().zip(numbered).collect();
        let same = |query: u32, database: u32| {
            query_labels[query as usize].instance == database_labels[database as usize].instance
        };

        let (mut pairs, mut of_query) = (Vec::new(), Vec::new());
        let is_abridged = count * database.len() > MAX_PAIRS;
        // What has been learned recognises by other values than these distances.
        if !is_abridged && learned.is_none() {
            for (row, &query) in queries.iter().enumerate() {
                distances(row, &mut of_query);
                pairs.extend(
                    database.iter().zip(&of_query).map(|(&cloud, &distance)| (query, cloud, distance)),
                );
            }
        }
        let mut curves = Vec::new();
        if !pairs.is_empty() {
            let judged: Vec<(f64, bool)> =
                pairs.iter().map(|&(query, cloud, distance)| (distance, same(query, cloud))).collect();
            let relevant = judged.iter().filter(|pair| pair.1).count() as u64;
            // Of objects of which the database has no cloud, as leave-instance-out leaves them, recall is a share of
            // nothing.
            if relevant > 0 {
                curves.push(curve("all", judged, relevant));
            }
        }
        curves.push(nearest_curve(&matches, same));
        Self {
            database: database.len() as u32,
            keypoints_per_cloud: None,
            curves,
            distances: pairs
                .into_iter()
                .map(|(query, cloud, distance)| DistanceRow {
                    query,
                    database: cloud,
                    distance: distance as f32,
                })
                .collect(),
            matches,
            is_abridged,
            learned,
        }
    }
}

/// Recall against 1 − precision of nearest clouds only; `same` says whether query and database cloud show the same object.
fn nearest_curve(matches: &[(u32, Match)], same: impl Fn(u32, u32) -> bool) -> Curve {
    let judged = matches.iter().map(|(query, Match { nearest, .. })| {
        let is_same = same(*query, nearest.index);
        (nearest.distance, is_same)
    });
    curve("nearest", judged.collect(), matches.len() as u64)
}

/// What the candidate's recogniser learns from the clouds of the database that are described.
fn learn(
    candidate: &Candidate,
    described: &Described,
    distances: &[(DistanceMatrix, f64)],
    labels: &[Label],
    sequences: &[Option<u32>],
) -> Result<Option<(LearnedRecogniser, ChosenSettings)>, CompareError> {
    let [_, database] = &described.clouds;
    let channels = candidate.descriptor.channels().into_iter().zip(&described.channels).zip(distances);
    let channels: Vec<_> = channels
        .map(|(((channel, _), [_, known]), (_, factor))| {
            (known, channel.metric_or(candidate.distance), *factor)
        })
        .collect();
    let objects: Vec<u32> = database.iter().map(|&cloud| labels[cloud as usize].instance).collect();
    let sequences: Vec<Option<u32>> = database.iter().map(|&cloud| sequences[cloud as usize]).collect();
    let known = LabelledClouds { channels: &channels, objects: &objects };
    let failed = |source| CompareError::Learn { label: candidate.label.clone(), source };
    let chosen = ChosenSettings::new(candidate.recogniser, &known, &sequences).map_err(failed)?;
    let Some(chosen) = chosen else { return Ok(None) };
    let learned = LearnedRecogniser::new(&chosen.settings, &known).map_err(failed)?;
    Ok(Some((learned, chosen)))
}
