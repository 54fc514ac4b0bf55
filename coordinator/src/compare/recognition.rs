//! What a candidate makes of the test clouds: from the parts of clouds to matches, distances and curves.

use descriptor::distance::set_distances;
use descriptor::recognise::{Hit, RecogniseError, recognise_from};
use descriptor::{Label, Match};
use results::{Curve, DistanceRow};

use super::candidate::Candidate;
use super::curve::curve;
use super::described::Described;

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
    /// Of all pairs, if they are not too many, and of nearest clouds.
    pub curves: Vec<Curve>,
    /// Query, database cloud and their distance; empty if they are too many.
    pub distances: Vec<DistanceRow>,
}

impl Recognition {
    /// Matches queries with the database, by the current rayon pool. The first `trained` clouds of the database are those
    /// that a run's scales are found by.
    ///
    /// # Errors
    /// If nothing of the database is described.
    pub fn new(
        candidate: &Candidate,
        described: &Described,
        [query_labels, database_labels]: [&[Label]; 2],
        trained: u32,
    ) -> Result<Self, RecogniseError> {
        let [queries, database] = &described.clouds;
        let labels: Vec<Label> = database.iter().map(|&index| database_labels[index as usize]).collect();
        let count = queries.len();
        let known = database.iter().take_while(|&&cloud| cloud < trained).count();
        let distances = candidate.descriptor.distances(candidate.distance, &described.channels, known);
        let found = recognise_from(count, &distances, &labels)?;
        let number = |hit: Hit| Hit { index: database[hit.index as usize], ..hit };
        let numbered = found
            .into_iter()
            .map(|found| Match { nearest: number(found.nearest), runner_up: found.runner_up.map(number) });
        let matches: Vec<(u32, Match)> = queries.iter().copied().zip(numbered).collect();
        let same = |query: u32, database: u32| {
            query_labels[query as usize].instance == database_labels[database as usize].instance
        };

        let (mut pairs, mut of_query) = (Vec::new(), Vec::new());
        if count * labels.len() <= MAX_PAIRS {
            for (row, &query) in queries.iter().enumerate() {
                set_distances(&distances, row, &mut of_query);
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
            curves.push(curve("all", judged, relevant));
        }
        let nearest = matches.iter().map(|(query, found)| {
            let hit = found.nearest;
            (hit.distance, same(*query, hit.index))
        });
        curves.push(curve("nearest", nearest.collect(), count as u64));
        Ok(Self {
            database: labels.len() as u32,
            keypoints_per_cloud: described.keypoints.map(|all| all as f64 / (count + labels.len()) as f64),
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
        })
    }
}
