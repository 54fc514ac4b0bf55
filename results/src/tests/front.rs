//! The front of a search of several objectives: written, read, and covered by the run digest.

use std::fs;
use std::path::Path;

use tempfile::tempdir;

use super::fixture::{self, genes};
use super::tamper::{change, each_change_of};
use crate::*;

/// Two points of the fixture's run, of which its winner is one.
pub fn front() -> Vec<FrontRow> {
    let point = |point, individual: EvaluationRow, winner| FrontRow {
        point,
        generation: individual.generation,
        individual: individual.individual,
        chromosome: individual.chromosome,
        genes: individual.genes,
        train: individual.counts,
        objective_correct: individual.objective_correct,
        train_margin: individual.margin,
        validation: Some(fixture::VALIDATION),
        validation_margin: None,
        cost: u64::MAX,
        size: 248,
        winner,
    };
    vec![point(1, fixture::individual(2, 1), true), point(2, fixture::individual(1, 2), false)]
}

/// Writes the fixture's run with a front.
fn write(folder: &Path) -> String {
    let mut out = RunFolder::create(folder, &genes()).unwrap();
    for number in 1..=2 {
        let row = GenerationRow { hypervolume: Some(0.25), ..fixture::generation(number) };
        out.write_generation(&fixture::population(number), &row).unwrap();
    }
    out.write_front(&front()).unwrap();
    for split in PredictionSplit::ALL {
        out.write_predictions(split, &fixture::predictions(split)).unwrap();
    }
    out.write_run(&fixture::run()).unwrap().to_string()
}

#[test]
fn a_front_is_read_as_it_was_written_and_other_runs_have_none() {
    let folder = tempdir().unwrap();
    let digest = write(folder.path());
    assert_eq!(read_front(folder.path()).unwrap(), front());
    let verification = verify(folder.path()).unwrap();
    assert!(verification.is_intact(), "{:?}", verification.problems);
    assert_eq!(verification.computed_run_digest.unwrap().to_string(), digest);
    let plain = tempdir().unwrap();
    assert_ne!(fixture::write(plain.path()), digest);
    assert_eq!(read_front(plain.path()).unwrap(), []);

    let mut out = RunFolder::create(folder.path(), &genes()).unwrap();
    assert!(matches!(out.write_front(&front()), Err(Error::Finished(_))));
    out.discard().unwrap();
    assert_eq!(read_front(folder.path()).unwrap(), []);
}

#[test]
fn a_changed_cell_is_noticed_and_changes_the_run_digest_if_it_is_covered() {
    let folder = tempdir().unwrap();
    let digest = write(folder.path());
    let mut covered = 0;
    each_change_of(&TableName::FRONT, folder.path(), |name, column, file, row, null| {
        let before = fs::read(file).unwrap();
        change(file, name, &column.name, row, null);
        let changed = run_digest(folder.path()).unwrap().to_string() != digest;
        let noticed = verify(folder.path()).map_or(true, |verification| !verification.is_intact());
        fs::write(file, before).unwrap();
        assert_eq!(changed, column.in_digest, "{name}.{} row {row}, null {null}", column.name);
        assert!(noticed, "{name}.{} row {row}, null {null}", column.name);
        covered += u32::from(changed);
    });
    assert!(covered > 24, "{covered}");
    fs::remove_file(folder.path().join("front/front.parquet")).unwrap();
    let problems = verify(folder.path()).unwrap().problems;
    assert!(
        problems[0].to_string().contains("front: digest: expected") && problems.len() == 2,
        "{problems:?}"
    );
}

#[test]
fn what_cannot_be_a_front_is_refused() {
    let folder = tempdir().unwrap();
    let out = RunFolder::create(folder.path(), &genes()).unwrap();
    let refused = |rows: &[FrontRow]| out.write_front(rows).unwrap_err().to_string();
    let [first, second] = front().try_into().unwrap();
    let lonely = FrontRow { point: 1, ..second.clone() };
    assert!(refused(&[second]).contains("row 0, point: expected 1, got 2"));
    assert!(refused(&[lonely]).contains("row 0, winner: expected one winner, got 0"));
    let impossible = Counts { object_correct: 4, ..fixture::TEST };
    let row = FrontRow { validation: Some(impossible), ..first };
    assert!(refused(&[row]).contains("validation_object_correct"));
}
