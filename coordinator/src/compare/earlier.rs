//! The comparison that a run folder has already: what a further one adds to.

use std::path::Path;

use descriptor::{Descriptor, FixedDescriptor};
use results::{ComparedRow, Times};

use super::candidate::{Candidate, Choice, Named};
use super::error::CompareError;
use super::foreign::FOREIGN;
use super::tables::descriptor_of;

/// Times of a descriptor, and its mean number of keypoints, which is counted with them.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    /// Seconds of each stage.
    pub times: Times,
    /// Mean number of keypoints that are described.
    pub keypoints_per_cloud: Option<f64>,
}

/// The rows of a comparison of the same run.
#[derive(Clone, Debug, Default)]
pub struct Earlier {
    rows: Vec<(Choice, ComparedRow)>,
    /// Those of files.
    foreign: Vec<ComparedRow>,
}

impl Earlier {
    /// What the folder has; nothing if there is no comparison, or none that is whole.
    ///
    /// # Errors
    /// If it cannot be read, or has a descriptor that this program does not know.
    pub fn read(folder: &Path) -> Result<Self, CompareError> {
        let rows = results::read_comparison(folder).map_err(CompareError::Earlier)?;
        let (foreign, rows): (Vec<_>, Vec<_>) = rows.into_iter().partition(|row| row.kind == FOREIGN);
        let known = |row: ComparedRow| match Choice::labelled(&row.descriptor, descriptor_of(&row)) {
            Some(choice) => Ok((choice, row)),
            None => {
                Err(CompareError::UnknownEarlier { folder: folder.to_owned(), label: row.descriptor.clone() })
            }
        };
        Ok(Self { rows: rows.into_iter().map(known).collect::<Result<_, _>>()?, foreign })
    }

    /// The labels of its descriptors.
    pub fn labels(&self) -> Vec<&str> {
        let rows = self.rows.iter().map(|(_, row)| row).chain(&self.foreign);
        rows.map(|row| row.descriptor.as_str()).collect()
    }

    /// The rows of descriptors from files.
    pub fn foreign(&self) -> &[ComparedRow] {
        &self.foreign
    }

    /// What was measured of a descriptor when it was the same.
    pub fn measured(&self, now: &ComparedRow) -> Option<Measured> {
        let row = self.same(now)?;
        Some(Measured { times: row.times.clone()?, keypoints_per_cloud: row.keypoints_per_cloud })
    }

    /// Seconds that it took to describe one cloud, where they were measured of the same descriptor.
    pub fn cloud_seconds(&self, now: &ComparedRow) -> Option<f64> {
        self.same(now)?.cloud_seconds
    }

    fn same(&self, now: &ComparedRow) -> Option<&ComparedRow> {
        let mut rows = self.rows.iter().map(|(_, row)| row);
        rows.find(|row| row.descriptor == now.descriptor && row.counts == now.counts)
    }

    /// Those that were asked for and those that are there, in the order in which they are shown. All descriptors
    /// without genes have one radius: that of the table, unless none is there. What is given under a name stays what it
    /// was.
    ///
    /// # Errors
    /// If one that is there has other parameters now.
    pub fn candidates(
        &self,
        folder: &Path,
        asked: &[Choice],
        evolved: &Descriptor,
        radius_um: Option<u32>,
    ) -> Result<Vec<Candidate>, CompareError> {
        let radius_um = radius_um.or_else(|| self.radius_um()).unwrap_or(FixedDescriptor::DEFAULT_RADIUS_UM);
        for (choice, row) in &self.rows {
            let mut same_name = asked.iter().filter(|asked| asked.named.name() == choice.named.name());
            let other = same_name.find(|asked| asked.named != choice.named).unwrap_or(choice);
            let now = other.candidate(evolved, radius_um).descriptor;
            let is_same = match descriptor_of(row) {
                Some(then) => then == now,
                None => row.parameters == now.parameters(), // a table of an earlier release
            };
            if !is_same {
                let (folder, label) = (folder.to_owned(), row.descriptor.clone());
                let advice = match choice.named {
                    Named::Given(_) => "give it another name, NAME=PATH",
                    _ => "leave --radius-cm out to add to the table",
                };
                return Err(CompareError::OtherEarlier {
                    folder,
                    label,
                    then: row.parameters.clone(),
                    now: now.parameters(),
                    advice,
                });
            }
        }
        let there = self.rows.iter().map(|(choice, _)| choice);
        let mut wanted: Vec<&Choice> = asked.iter().chain(there).collect();
        wanted.sort_by(|a, b| a.rank().cmp(&b.rank()));
        wanted.dedup();
        Ok(wanted.into_iter().map(|choice| choice.candidate(evolved, radius_um)).collect())
    }

    /// The radius of its first descriptor without genes.
    fn radius_um(&self) -> Option<u32> {
        self.rows.iter().find_map(|(choice, row)| {
            let Named::Fixed(kind) = choice.named else { return None };
            // The text that `Descriptor::parameters` makes.
            let cm: f64 = row.parameters.strip_prefix("radius=")?.strip_suffix(" cm")?.parse().ok()?;
            FixedDescriptor::new(kind, (cm * 1e4).round() as u32).ok().map(|fixed| fixed.radius_um)
        })
    }
}

#[cfg(test)]
mod tests {
    use descriptor::recogniser::Method;
    use descriptor::structure::{Structure, Weighted};
    use descriptor::{Family, FixedKind, SetDistance};
    use results::Counts;

    use super::super::candidate::Given;
    use super::*;

    const PFHRGB: Named = Named::Fixed(FixedKind::PfhRgb);

    fn evolved() -> Descriptor {
        Descriptor::default_of(Family::DiskRing)
    }

    fn chi2(named: Named) -> Choice {
        Choice { named, distance: SetDistance::ChiSquared, recogniser: Method::Nearest }
    }

    fn row(choice: &Choice, radius_um: u32, times: Option<Times>) -> ComparedRow {
        let Candidate { label, descriptor, distance, .. } = choice.candidate(&evolved(), radius_um);
        ComparedRow {
            descriptor: label,
            kind: descriptor.family().name().to_owned(),
            distance: distance.name().to_owned(),
            parameters: descriptor.parameters(),
            size: Some(descriptor.size() as u32),
            recogniser: None,
            cloud_size: None,
            settings: None,
            database_error: None,
            note: None,
            counts: Counts { object_correct: 3, category_correct: 4, queries: 5 },
            object_wilson: [0.0, 1.0],
            category_wilson: [0.0, 1.0],
            object_bootstrap: [0.0, 1.0],
            category_bootstrap: [0.0, 1.0],
            skipped: 0,
            database: 9,
            keypoints_per_cloud: times.as_ref().map(|_| 7.5),
            cloud_seconds: None,
            times,
            area: None,
            nearest_area: None,
            bytes: matches!(choice.named, Named::Given(_)).then(|| proto::hex(&descriptor.to_bytes())),
            file_digest: None,
        }
    }

    fn times() -> Times {
        Times {
            read: 1.0,
            keypoints: 1.0,
            normals: 1.0,
            describe: 1.0,
            matching: 1.0,
            total: 5.0,
            hardware: "some".to_owned(),
        }
    }

    fn with(choices: &[Choice], radius_um: u32) -> Earlier {
        Earlier {
            rows: choices.iter().map(|choice| (choice.clone(), row(choice, radius_um, None))).collect(),
            foreign: Vec::new(),
        }
    }

    fn labels(candidates: Result<Vec<Candidate>, CompareError>) -> Vec<String> {
        candidates.unwrap().into_iter().map(|candidate| candidate.label).collect()
    }

    #[test]
    fn what_is_there_and_what_is_asked_for_are_compared_in_one_order_whichever_came_first() {
        let (folder, evolved) = (Path::new("run"), evolved());
        let all: Vec<Choice> = Choice::all().collect();
        let in_one_call = labels(Earlier::default().candidates(folder, &all, &evolved, None));
        assert_eq!(in_one_call.len(), all.len());
        for cut in 0..=all.len() {
            let (asked, there) = all.split_at(cut);
            assert_eq!(labels(with(there, 50_000).candidates(folder, asked, &evolved, None)), in_one_call);
        }
        let again = with(&[chi2(PFHRGB)], 50_000).candidates(folder, &[chi2(PFHRGB)], &evolved, None);
        assert_eq!(labels(again), ["pfhrgb"]);
    }

    #[test]
    fn the_radius_is_the_tables_and_another_is_refused() {
        let (folder, evolved) = (Path::new("run"), evolved());
        for radius_um in [1, 24_999, 25_000, 50_000, 1_000_000] {
            let there = with(&[chi2(Named::Evolved), chi2(PFHRGB)], radius_um);
            let shot = [chi2(Named::Fixed(FixedKind::ShotColor))];
            for radius in [None, Some(radius_um)] {
                let added = there.candidates(folder, &shot, &evolved, radius).unwrap();
                assert_eq!(added[2].descriptor, shot[0].named.descriptor(&evolved, radius_um));
            }
            let refused = there.candidates(folder, &shot, &evolved, Some(radius_um ^ 1)).unwrap_err();
            assert!(refused.to_string().contains("--replace"), "{refused}");
        }
        // Nothing that is there has a radius.
        let there = with(&[chi2(Named::Evolved)], 50_000);
        let added = there.candidates(folder, &[chi2(PFHRGB)], &evolved, Some(7)).unwrap();
        assert_eq!(added[1].descriptor, PFHRGB.descriptor(&evolved, 7));
        let other = Descriptor::default_of(Family::GlobalHue);
        let refused = there.candidates(folder, &[], &other, None).unwrap_err();
        assert!(matches!(refused, CompareError::OtherEarlier { .. }), "{refused}");
    }

    #[test]
    fn what_was_given_is_there_again_under_its_name_only() {
        let (folder, evolved) = (Path::new("run"), evolved());
        let structure = Structure::default();
        let heavier = |one: &Weighted| Weighted { weight_ppm: 7, ..one.clone() };
        let other = Structure { channels: structure.channels.iter().map(heavier).collect() };
        let named = |name: &str, structure: &Structure| {
            Named::Given(Given::new(name, Descriptor::Structure(structure.clone())).unwrap())
        };
        let all: Vec<Choice> = Choice::all()
            .chain(Choice::of(&named("chroma", &structure)))
            .chain(Choice::of(&named("hue", &other)))
            .collect();
        // Whoever comes first, and as a table is read.
        for cut in 0..=all.len() {
            let (there, asked) = all.split_at(cut);
            let rows = there.iter().map(|choice| row(choice, 50_000, None));
            let again =
                rows.map(|row| (Choice::labelled(&row.descriptor, descriptor_of(&row)).unwrap(), row));
            let earlier = Earlier { rows: again.collect(), foreign: Vec::new() };
            assert_eq!(
                earlier.rows.iter().map(|(choice, _)| choice).collect::<Vec<_>>(),
                there.iter().collect::<Vec<_>>()
            );
            let added = earlier.candidates(folder, asked, &evolved, None).unwrap();
            let expected: Vec<Candidate> =
                all.iter().map(|choice| choice.candidate(&evolved, 50_000)).collect();
            assert_eq!(added, expected);
        }
        let earlier = with(&all, 50_000);
        let named = named("chroma", &other);
        let asked = Choice { named, distance: SetDistance::L1, recogniser: Method::Projection };
        let refused = earlier.candidates(folder, &[asked], &evolved, None).unwrap_err().to_string();
        assert!(refused.contains("chroma must be of") && refused.contains("NAME=PATH"), "{refused}");
    }

    #[test]
    fn times_stay_where_the_answers_are_the_same() {
        let choice = chi2(PFHRGB);
        let rows = vec![(choice.clone(), row(&choice, 50_000, Some(times())))];
        let earlier = Earlier { rows, foreign: Vec::new() };
        let now = row(&choice, 50_000, None);
        let measured = Measured { times: times(), keypoints_per_cloud: Some(7.5) };
        assert_eq!(earlier.measured(&now), Some(measured));
        let other_counts = Counts { object_correct: 2, ..now.counts };
        assert_eq!(earlier.measured(&ComparedRow { counts: other_counts, ..now }), None);
        assert_eq!(earlier.measured(&row(&chi2(Named::Paper), 50_000, None)), None);
        assert_eq!(with(std::slice::from_ref(&choice), 50_000).measured(&row(&choice, 50_000, None)), None);
    }
}
