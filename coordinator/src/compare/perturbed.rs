//! Errors on test clouds that are perturbed, in this process on all its cores; the database stays as it is.

use descriptor::prepare::keypoints;
use descriptor::recognise::recognise_from;
use descriptor::recogniser::LearnedRecogniser;
use descriptor::{
    DescribeError, Describer, Descriptor, Label, Perturbation, PrepareError, Preprocess, SetDistance,
    Signature, Signatures,
};
use rayon::prelude::*;
use results::{ComparedRow, PerturbedRow, PredictionRow};

use super::described::Described;
use super::error::CompareError;
use super::pairs::{Level, Outcomes};
use super::progress::Display;
use crate::dataset::Dataset;
use crate::evaluate::{EvaluateError, read_cloud};
use crate::run::Matching;

/// Of one descriptor all that takes part: how its clouds are described once, and what recognises them.
pub struct PerturbedDescriptor<'a> {
    /// The descriptor.
    pub descriptor: &'a Descriptor,
    /// Its clouds as they are.
    pub described: &'a Described,
    /// What is made of them.
    pub subjects: Vec<Subject<'a>>,
}

/// A descriptor under a set distance and recogniser.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    /// Its row of the comparison.
    pub row: &'a ComparedRow,
    /// Its answers to the clouds as they are.
    pub answers: &'a [PredictionRow],
    /// How clouds are compared.
    pub distance: SetDistance,
    /// What names them; `None`: the nearest cloud.
    pub learned: Option<&'a LearnedRecogniser>,
}

/// What is the same for all of them.
pub struct PerturbedClouds<'a> {
    /// The clouds.
    pub dataset: &'a Dataset,
    /// How they are prepared.
    pub preprocess: &'a Preprocess,
    /// What queries and database show.
    pub labels: [&'a [Label]; 2],
    /// The run's.
    pub seed: u64,
    /// Shows how far it is.
    pub display: &'a Display,
}

impl PerturbedClouds<'_> {
    /// The rows of one kind, ascending by strength from 0 on for each subject.
    ///
    /// # Errors
    /// If a cloud cannot be read, or the clouds as they are give other answers than those of the comparison.
    pub fn rows(
        &self,
        kind: Perturbation,
        descriptors: &[PerturbedDescriptor<'_>],
    ) -> Result<Vec<PerturbedRow>, CompareError> {
        let strengths: Vec<f64> = std::iter::once(0.0).chain(kind.strengths()).collect();
        let clouds = Matching::Test.query_clouds(self.dataset).len() as u32;
        let all = clouds * strengths.len() as u32;
        self.display.begin("perturbed", std::iter::once(kind.name().to_owned()), all);
        let mut rows = Vec::new();
        for &strength in &strengths {
            let found = self.described(kind, strength, descriptors, &|| self.display.add(0, 1))?;
            for (one, signatures) in descriptors.iter().zip(found) {
                for subject in &one.subjects {
                    rows.push(self.row((kind, strength), one, subject, &signatures)?);
                }
            }
        }
        Ok(rows)
    }

    /// Of each descriptor the signatures of all test clouds, `None` of those that it cannot describe.
    fn described(
        &self,
        kind: Perturbation,
        strength: f64,
        descriptors: &[PerturbedDescriptor<'_>],
        watch: &(dyn Fn() + Sync),
    ) -> Result<Vec<Vec<Option<Vec<Signature>>>>, CompareError> {
        let describers: Vec<Describer> = descriptors
            .iter()
            .map(|one| Describer::new(one.descriptor))
            .collect::<Result<_, _>>()
            .map_err(EvaluateError::from)?;
        // Normals are fitted once for all of them, if any looks at them.
        let needing = describers.iter().find(|describer| describer.needs_normals());
        let Some(sharing) = needing.or(describers.first()) else { return Ok(Vec::new()) };
        let of_cloud = |&index: &u32| -> Result<Vec<Option<Vec<Signature>>>, EvaluateError> {
            let cloud = &self.dataset.clouds.entries[index as usize];
            let points = read_cloud(&cloud.path, &self.dataset.clouds.file(cloud), self.preprocess)?;
            let perturbed = kind.apply(strength, &points, self.seed, &cloud.digest);
            let prepared = keypoints(&perturbed, self.preprocess).and_then(|keypoints| {
                let normals = sharing.normals(&perturbed, &keypoints, self.preprocess)?;
                Ok((keypoints, normals))
            });
            let of_descriptor = |describer: &Describer| {
                let described =
                    prepared.clone().map_err(DescribeError::from).and_then(|(keypoints, normals)| {
                        describer.describe(&perturbed, &keypoints, &normals, self.preprocess)
                    });
                match described {
                    Ok(described) => Ok(Some(described.signatures)),
                    Err(
                        DescribeError::Prepare(PrepareError::Skip(_))
                        | DescribeError::NothingDescribed { .. },
                    ) => Ok(None),
                    Err(error) => {
                        Err(EvaluateError::Cloud { path: cloud.path.clone(), what: error.to_string() })
                    }
                }
            };
            let found = describers.iter().map(of_descriptor).collect();
            watch();
            found
        };
        let queries = Matching::Test.query_clouds(self.dataset);
        let by_cloud: Vec<Vec<Option<Vec<Signature>>>> =
            queries.par_iter().map(of_cloud).collect::<Result<_, _>>()?;
        let mut by_descriptor: Vec<Vec<Option<Vec<Signature>>>> = vec![Vec::new(); descriptors.len()];
        for cloud in by_cloud {
            by_descriptor.iter_mut().zip(cloud).for_each(|(all, one)| all.push(one));
        }
        Ok(by_descriptor)
    }

    fn row(
        &self,
        (kind, strength): (Perturbation, f64),
        PerturbedDescriptor { descriptor, described, .. }: &PerturbedDescriptor<'_>,
        subject: &Subject<'_>,
        signatures: &[Option<Vec<Signature>>],
    ) -> Result<PerturbedRow, CompareError> {
        let [asked, database] = &described.clouds;
        // Clouds that it does not describe as they are have no part in the error without perturbation either.
        let usable: Vec<(u32, &Vec<Signature>)> =
            asked.iter().filter_map(|&query| Some((query, signatures[query as usize].as_ref()?))).collect();
        let channel = |(index, [_, known]): (usize, &[Signatures; 2])| {
            let queries: Signatures = usable.iter().map(|(_, cloud)| &cloud[index]).collect();
            [queries, known.clone()]
        };
        let channels: Vec<[Signatures; 2]> = described.channels.iter().enumerate().map(channel).collect();
        let trained = self.dataset.splits.trained();
        let known = database.iter().take_while(|&&cloud| (cloud as usize) < trained).count();
        let mut right = vec![None; self.labels[0].len()];
        asked.iter().for_each(|&query| right[query as usize] = Some([false; 2]));
        let label = &subject.row.descriptor;
        if !usable.is_empty() {
            let distances = descriptor.distances(subject.distance, &channels, known);
            let shown: Vec<Label> = database.iter().map(|&cloud| self.labels[1][cloud as usize]).collect();
            let found = match subject.learned {
                Some(recogniser) => {
                    let queries: Vec<&Signatures> = channels.iter().map(|[queries, _]| queries).collect();
                    recogniser.recognise(&queries, &distances)
                }
                None => recognise_from(usable.len(), &distances, &shown)
                    .map_err(|source| CompareError::Recognise { label: label.clone(), source })?,
            };
            for ((query, _), found) in usable.iter().zip(&found) {
                let (asked, got) = (self.labels[0][*query as usize], shown[found.nearest.index as usize]);
                right[*query as usize] =
                    Some([asked.instance == got.instance, asked.category == got.category]);
            }
            if strength == 0.0 {
                let nearest = found
                    .iter()
                    .map(|found| (database[found.nearest.index as usize], found.nearest.distance));
                self.confirm(subject, nearest)?;
            }
        }
        let outcomes = Outcomes { label: format!("{label} {} {strength}", kind.name()), right };
        let [[object_wilson, object_bootstrap], [category_wilson, category_bootstrap]] =
            Level::ALL.map(|level| outcomes.intervals(level, self.labels[0], self.seed));
        Ok(PerturbedRow {
            descriptor: label.clone(),
            kind: kind.name().to_owned(),
            strength,
            unit: kind.unit().to_owned(),
            counts: outcomes.counts(),
            unusable: (asked.len() - usable.len()) as u32,
            object_wilson,
            category_wilson,
            object_bootstrap,
            category_bootstrap,
        })
    }

    /// Refuses clouds as they are that are recognised otherwise than by the comparison.
    fn confirm(
        &self,
        subject: &Subject<'_>,
        nearest: impl Iterator<Item = (u32, f64)>,
    ) -> Result<(), CompareError> {
        let database = Matching::Test.database_clouds(self.dataset);
        let path = |cloud: u32| &self.dataset.clouds.entries[database[cloud as usize] as usize].path;
        let told = subject.answers.iter().map(|answer| (&answer.nearest_cloud, answer.distance));
        let mut found = nearest.map(|(cloud, distance)| (path(cloud), distance));
        for told in told {
            let now = found.next();
            if now != Some(told) {
                let said = |(cloud, distance): (&String, f64)| format!("{cloud} at {distance}");
                return Err(CompareError::Contradiction {
                    label: subject.row.descriptor.clone(),
                    what: "what this process finds of the clouds as they are",
                    then: said(told),
                    now: now.map_or_else(|| "nothing".to_owned(), said),
                });
            }
        }
        Ok(())
    }
}
