//! The results that a start finds are those that hold, whoever reads them when.

use std::io::{Seek as _, SeekFrom, Write as _};

use proptest::prelude::*;

use super::*;
use crate::store::Grounds;

/// What may happen to the result of a job.
#[derive(Clone, Debug)]
enum Step {
    Accepted(u64, AcceptedResult),
    Assured(u64, Assurance, Option<Principal>),
    Retracted(u64),
    Quarantined(Principal),
}

fn assurance() -> impl Strategy<Value = Assurance> {
    prop_oneof![
        Just(Assurance::Owed),
        Just(Assurance::Unaudited),
        Just(Assurance::Audited),
        Just(Assurance::Own)
    ]
}

fn step() -> impl Strategy<Value = Step> {
    let principals = || (3u8..6).prop_map(principal);
    let seconded = || prop::option::of(principals());
    let result = (0..9usize, 0..3u8, principals(), seconded(), assurance()).prop_map(
        |(matches, worker, principal, seconded, assurance)| AcceptedResult {
            worker_id: WorkerId([worker; 16]),
            worker: format!("rack-{worker}"),
            principal,
            seconded,
            assurance,
            ..accepted(matches)
        },
    );
    prop_oneof![
        8 => (0..12u64, result).prop_map(|(job, result)| Step::Accepted(job, result)),
        3 => (0..12u64, assurance(), seconded()).prop_map(|(job, why, second)| Step::Assured(job, why, second)),
        2 => (0..12u64).prop_map(Step::Retracted),
        1 => principals().prop_map(Step::Quarantined),
    ]
}

/// The results that hold, and who was quarantined.
#[derive(Default)]
struct Model {
    results: BTreeMap<JobId, Box<AcceptedResult>>,
    quarantined: BTreeSet<Principal>,
}

impl Model {
    /// Takes a step; `None` if a coordinator never takes it, as nobody who is quarantined is believed.
    fn take(&mut self, step: &Step) -> Option<Entry> {
        let is_believed = |result: &AcceptedResult| {
            let grounds = Grounds::of_accepted(result);
            !self.quarantined.iter().any(|principal| grounds.rest_on(*principal))
        };
        match step.clone() {
            Step::Accepted(job, result) => {
                let result = Some(Box::new(result)).filter(|result| is_believed(result))?;
                self.results.insert(JobId(job), result.clone());
                Some(Entry::Accepted(JobId(job), result))
            }
            Step::Assured(job, assurance, seconded) => {
                if let Some(result) = self.results.get(&JobId(job)) {
                    let result = AcceptedResult { assurance, seconded, ..AcceptedResult::clone(result) };
                    let result = Some(Box::new(result)).filter(|result| is_believed(result))?;
                    self.results.insert(JobId(job), result);
                }
                Some(Entry::Assured(JobId(job), assurance, seconded))
            }
            Step::Retracted(job) => {
                self.results.remove(&JobId(job));
                Some(Entry::Retracted(JobId(job)))
            }
            Step::Quarantined(principal) => {
                self.quarantined.insert(principal);
                self.results.retain(|_, result| !Grounds::of_accepted(result).rest_on(principal));
                Some(Entry::Quarantined(principal))
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn what_holds_after_any_history_is_found_with_who_gave_it(
        groups in prop::collection::vec((prop::collection::vec(step(), 0..12), any::<bool>()), 0..8),
    ) {
        let (_folder, path) = journal(&[]);
        let mut file = JournalFile::open(&path).unwrap().0;
        let mut model = Model::default();
        for (steps, starts_again) in groups {
            file.commit(&steps.iter().filter_map(|step| model.take(step)).collect::<Vec<_>>()).unwrap();
            if starts_again {
                drop(file);
                file = JournalFile::open(&path).unwrap().0;
            }
        }
        drop(file);
        let found = JournalFile::open(&path).unwrap().2.accepted;
        let expected = model.results;
        let mut attributed: BTreeMap<_, usize> = BTreeMap::new();
        for result in expected.values() {
            let grounds = Grounds::of_accepted(result);
            *attributed.entry((result.worker_id, result.worker.clone(), grounds)).or_default() += 1;
        }
        let attributions = found.attributions().map(|(one, results)| {
            ((one.worker_id, one.worker.clone(), one.grounds), results)
        });
        prop_assert_eq!(attributions.collect::<BTreeMap<_, _>>(), attributed);
        prop_assert_eq!((found.len(), found.jobs().collect::<Vec<_>>()), (expected.len(), expected.keys().copied().collect()));
        prop_assert_eq!(found.all(), expected);
    }
}

#[test]
fn results_are_read_from_the_file_that_had_them_also_when_another_has_replaced_it_or_nobody_has_it_open() {
    let (_folder, path) = journal(&[answer(5, 2), answer(6, 3)]);
    let (file, _, first) = JournalFile::open(&path).unwrap();
    file.commit(&[answer(7, 4), Entry::Retracted(JobId(5))]).unwrap();
    drop(file);
    // Whoever only reads results keeps nobody from going on.
    let (_file, _, second) = JournalFile::open(&path).unwrap();
    assert_eq!(first.accepted.all(), [(JobId(5), accepted(2)), (JobId(6), accepted(3))].map(boxed).into());
    assert_eq!(second.accepted.all(), [(JobId(6), accepted(3)), (JobId(7), accepted(4))].map(boxed).into());
}

#[test]
fn a_result_that_was_damaged_since_is_an_error_and_the_others_are_not() {
    let (_folder, path) = journal(&[answer(5, 2), answer(6, 3)]);
    let results = JournalFile::open(&path).unwrap().2.accepted;
    let bytes = fs::read(&path).unwrap();
    let label = bytes.windows(6).position(|window| window == b"rack-3").unwrap();
    let mut file = File::options().write(true).open(&path).unwrap();
    file.seek(SeekFrom::Start(label as u64)).unwrap();
    file.write_all(b"rack-4").unwrap();
    assert_eq!(results.get(JobId(5)).unwrap_err().kind(), io::ErrorKind::Other);
    assert_eq!(results.get(JobId(6)).unwrap(), Some(accepted(3)));
    assert_eq!(results.get(JobId(7)).unwrap(), None);
}
