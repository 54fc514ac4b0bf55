//! What a coordinator's journal keeps of results and workers, as the messages of `descry/v2/journal.proto`, and back.

use std::time::Duration;

use prost::Message as _;

use crate::introduction::Introduction;
use crate::principal::Principal;
use crate::task::{Described, TaskResult, is_scale};
use crate::v2::accepted_result::Result as Kept;
use crate::{Digest, MAX_NAME_BYTES, WorkerId, printable, truncate, v2};

/// Longest text of a worker, bytes: a name with the suffix that makes it unique.
const MAX_WORKER_TEXT_BYTES: usize = 2 * MAX_NAME_BYTES;

/// An accepted result, with who gave it and when; its job is the key under which it is kept.
#[derive(Clone, Debug, PartialEq)]
pub struct AcceptedResult {
    /// Of an evaluation, a tile or a scale whole, of a description its digest.
    pub result: TaskResult,
    /// The worker that gave it.
    pub worker_id: WorkerId,
    /// Its label.
    pub worker: String,
    /// Who answers for it.
    pub principal: Principal,
    /// Another principal that gave the same result.
    pub seconded: Option<Principal>,
    /// Why it is believed.
    pub assurance: Assurance,
    /// Which attempt it was.
    pub attempt: u32,
    /// From submission to lease.
    pub queued: Duration,
    /// Seconds on the worker's clock.
    pub run_seconds: f64,
}

/// Why an accepted result is believed, from least to most.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Assurance {
    /// One answer, and an audit is due as soon as another principal is there.
    Owed,
    /// One answer of a principal with earned trust, or of the only one there was.
    Unaudited,
    /// Two principals gave the same answer.
    Audited,
    /// The coordinator's own process computed it.
    Own,
}

impl From<Assurance> for v2::Assurance {
    fn from(assurance: Assurance) -> Self {
        match assurance {
            Assurance::Owed => Self::Owed,
            Assurance::Unaudited => Self::Unaudited,
            Assurance::Audited => Self::Audited,
            Assurance::Own => Self::Own,
        }
    }
}

impl Assurance {
    fn decode(number: i32) -> Option<Self> {
        match v2::Assurance::try_from(number).ok()? {
            v2::Assurance::Unspecified => None,
            v2::Assurance::Owed => Some(Self::Owed),
            v2::Assurance::Unaudited => Some(Self::Unaudited),
            v2::Assurance::Audited => Some(Self::Audited),
            v2::Assurance::Own => Some(Self::Own),
        }
    }
}

impl AcceptedResult {
    /// Its bytes; `None` if no such result is kept.
    pub fn encode(&self) -> Option<Vec<u8>> {
        let result = match &self.result {
            TaskResult::Evaluation(result) => Kept::Evaluation(result.clone().into()),
            TaskResult::Description(described) => Kept::Description(described.digest.to_vec()),
            TaskResult::Scale(scale) => Kept::Scale(*scale),
            TaskResult::GridCell(_) => return None,
        };
        let message = v2::AcceptedResult {
            worker: self.worker.clone(),
            worker_id: self.worker_id.to_vec(),
            attempt: self.attempt,
            queued_nanoseconds: self.queued.as_nanos() as u64,
            run_seconds: self.run_seconds,
            result: Some(result),
            principal: self.principal.to_string(),
            assurance: v2::Assurance::from(self.assurance).into(),
            seconded: self.seconded.map(|principal| principal.to_string()),
        };
        Some(message.encode_to_vec())
    }

    /// The inverse of [`AcceptedResult::encode`]; `None` if it cannot have written these bytes.
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        let message = v2::AcceptedResult::decode(bytes).ok()?;
        let result = match message.result? {
            Kept::Evaluation(result) => TaskResult::Evaluation(result.into()),
            Kept::Description(digest) => {
                TaskResult::Description(Described::named(Digest::try_from(&digest[..]).ok()?))
            }
            Kept::Scale(scale) => TaskResult::Scale(scale),
        };
        let accepted = Self {
            result,
            worker_id: WorkerId::try_from(&message.worker_id[..]).ok()?,
            worker: message.worker,
            principal: message.principal.parse().ok()?,
            seconded: message.seconded.map(|principal| principal.parse()).transpose().ok()?,
            assurance: Assurance::decode(message.assurance)?,
            attempt: message.attempt,
            queued: Duration::from_nanos(message.queued_nanoseconds),
            run_seconds: message.run_seconds,
        };
        // Decoding passes over what it does not know; a journal of this version has nothing of the kind.
        let sound = accepted.is_sound() && accepted.encode()? == bytes;
        sound.then_some(accepted)
    }

    fn is_sound(&self) -> bool {
        let finite = match &self.result {
            TaskResult::Evaluation(result) => {
                result.named().map(|(_, distance)| distance).chain(result.margin).all(f64::is_finite)
            }
            TaskResult::Scale(scale) => is_scale(*scale),
            TaskResult::GridCell(_) | TaskResult::Description(_) => true,
        };
        let sound_time = self.run_seconds.is_finite() && self.run_seconds >= 0.0;
        finite && sound_time && self.worker.len() <= MAX_WORKER_TEXT_BYTES
    }
}

/// A worker that had not left; its id is the key under which it is kept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Member {
    /// Its unique label.
    pub label: String,
    /// How it introduced itself.
    pub introduction: Introduction,
}

impl Member {
    /// Its bytes.
    pub fn encode(&self) -> Vec<u8> {
        let Self { label, introduction } = self.clone();
        let Introduction { name, threads, build, principal } = introduction;
        let principal = principal.to_string();
        v2::Member { label, name, threads, build, credential: None, principal }.encode_to_vec()
    }

    /// The inverse of [`Member::encode`], its texts as [`printable`] has them, as earlier releases let more characters in;
    /// `None` of bytes that no worker can have.
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        let v2::Member { label, name, threads, build, principal, .. } = v2::Member::decode(bytes).ok()?;
        let is_sound =
            |text: &String| text.len() <= MAX_WORKER_TEXT_BYTES && !text.chars().any(char::is_control);
        let sound = [&label, &name, &build].into_iter().all(is_sound);
        let shown = |text: String| truncate(&printable(&text), MAX_WORKER_TEXT_BYTES).to_owned();
        let [label, name, build] = [label, name, build].map(shown);
        let principal = principal.parse().ok()?;
        sound.then_some(Self { label, introduction: Introduction { name, threads, build, principal } })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::task::{EvaluationResult, Match, Nearest};

    fn accepted(matches: u32) -> AcceptedResult {
        let found = |index: u32| Match {
            nearest: index,
            distance: 0.1 + f64::from(index),
            runner_up: (index % 2 == 1).then_some((9, 0.3)),
        };
        let matches = (0..matches).map(found).collect();
        let (queries, object_correct, category_correct) = (10, 4, 6);
        let result =
            EvaluationResult { queries, object_correct, category_correct, matches, ..Default::default() };
        AcceptedResult {
            result: TaskResult::Evaluation(result),
            worker_id: WorkerId([3; 16]),
            worker: "rack-3".to_owned(),
            principal: Principal::Coordinator,
            seconded: None,
            assurance: Assurance::Own,
            attempt: 2,
            queued: Duration::from_nanos(1_234_567_891),
            run_seconds: 0.1,
        }
    }

    #[test]
    fn results_and_workers_come_back_from_their_bytes_and_unsound_ones_do_not() {
        let named = TaskResult::Description(Described::named(Digest([7; 32])));
        let scale = |scale| AcceptedResult { result: TaskResult::Scale(scale), ..accepted(0) };
        let under_a_rule = |distance, margin| {
            let nearest = vec![Nearest { same: Some((3, distance)), other: None }, Nearest::default()];
            let result = EvaluationResult { queries: 1, nearest, margin, ..EvaluationResult::default() };
            AcceptedResult { result: TaskResult::Evaluation(result), ..accepted(0) }
        };
        for accepted in [
            accepted(0),
            accepted(3),
            AcceptedResult { result: named, ..accepted(0) },
            scale(0.25),
            under_a_rule(0.5, None),
            under_a_rule(0.5, Some(0.0)),
        ] {
            assert_eq!(AcceptedResult::decode(&accepted.encode().unwrap()), Some(accepted));
        }
        let cell = AcceptedResult { result: TaskResult::GridCell(vec![1]), ..accepted(0) };
        assert_eq!(cell.encode(), None);
        for unsound in [
            scale(0.0),
            scale(f64::NAN),
            under_a_rule(f64::NAN, None),
            under_a_rule(0.5, Some(f64::INFINITY)),
            AcceptedResult { run_seconds: -1.0, ..accepted(0) },
            AcceptedResult { run_seconds: f64::NAN, ..accepted(0) },
            AcceptedResult { worker: "x".repeat(MAX_WORKER_TEXT_BYTES + 1), ..accepted(0) },
        ] {
            assert_eq!(AcceptedResult::decode(&unsound.encode().unwrap()), None, "{unsound:?}");
        }

        let member = |name: &str| Member {
            label: "rack-2".to_owned(),
            introduction: Introduction { threads: 4, ..Introduction::sample(name, 1) },
        };
        assert_eq!(Member::decode(&member("rack").encode()), Some(member("rack")));
        for unsound in ["a\nb", &"x".repeat(MAX_WORKER_TEXT_BYTES + 1)] {
            assert_eq!(Member::decode(&member(unsound).encode()), None, "{unsound:?}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(500))]

        #[test]
        fn arbitrary_bytes_are_refused_or_make_sense(
            head in prop::collection::vec(any::<u8>(), 0..60),
            spoilt in 0usize..200,
            value in any::<u8>(),
        ) {
            let mut bytes = accepted(3).encode().unwrap();
            let place = spoilt % bytes.len();
            bytes[place] = value;
            for bytes in [head, bytes] {
                if let Some(read) = AcceptedResult::decode(&bytes) {
                    prop_assert_eq!(read.encode(), Some(bytes));
                }
            }
        }
    }

    #[test]
    fn a_length_that_no_bytes_follow_reserves_nothing() {
        let mut bytes = accepted(0).encode().unwrap();
        for end in 0..bytes.len() {
            assert_eq!(AcceptedResult::decode(&bytes[..end]), None);
        }
        // Field 5, the evaluation, of 4 GiB.
        let place = bytes.iter().rposition(|&byte| byte == 5 << 3 | 2).unwrap();
        bytes.truncate(place + 1);
        bytes.extend([0xff, 0xff, 0xff, 0xff, 0x0f]);
        assert_eq!(AcceptedResult::decode(&bytes), None);
    }
}
