//! Answers and workers as bytes, and back. Numbers are little-endian; every length is checked before it is believed.

use std::time::Duration;

use proto::{Digest, JobId, MAX_NAME_BYTES};
use serde::{Deserialize, Serialize};

use super::{Accepted, Member};
use crate::evaluation::{EvaluationResult, Match};
use crate::scheduler::Introduction;
use crate::shard::Described;
use crate::task::TaskResult;

/// Longest text of a worker, bytes: a name with the suffix that makes it unique.
const MAX_TEXT_BYTES: usize = 2 * MAX_NAME_BYTES;

/// Bytes of an answer; its job is the key under which they are kept. `None` of one that is not kept.
pub(super) fn encode_accepted(accepted: &Accepted) -> Option<Vec<u8>> {
    let Accepted { job: _, result, worker, attempt, queued, run_seconds, settled: _ } = accepted;
    let mut bytes = Vec::with_capacity(128);
    bytes.extend(attempt.to_le_bytes());
    bytes.extend((queued.as_nanos() as u64).to_le_bytes());
    bytes.extend(run_seconds.to_le_bytes());
    bytes.extend((worker.len() as u32).to_le_bytes());
    bytes.extend(worker.as_bytes());
    match result {
        TaskResult::Evaluation(result) => encode_result(&mut bytes, result),
        TaskResult::Description(described) => bytes.extend(described.digest.0),
        TaskResult::GridCell(_) => return None,
    }
    Some(bytes)
}

fn encode_result(bytes: &mut Vec<u8>, result: &EvaluationResult) {
    for number in
        [result.queries, result.object_correct, result.category_correct, result.matches.len() as u32]
    {
        bytes.extend(number.to_le_bytes());
    }
    for found in &result.matches {
        bytes.extend(found.nearest.to_le_bytes());
        bytes.extend(found.distance.to_le_bytes());
        bytes.push(u8::from(found.runner_up.is_some()));
        if let Some((index, distance)) = found.runner_up {
            bytes.extend(index.to_le_bytes());
            bytes.extend(distance.to_le_bytes());
        }
    }
}

/// The inverse of [`encode_accepted`] for evaluations; `None` if it cannot have written these bytes.
pub(super) fn decode_accepted(job: JobId, bytes: &[u8]) -> Option<Accepted> {
    decode(job, bytes, |rest| Some(TaskResult::Evaluation(decode_result(rest)?)))
}

/// The inverse of [`encode_accepted`] for descriptions; `None` if it cannot have written these bytes.
pub(super) fn decode_described(job: JobId, bytes: &[u8]) -> Option<Accepted> {
    decode(job, bytes, |rest| Some(TaskResult::Description(Described::named(Digest(rest.take()?)))))
}

fn decode(
    job: JobId,
    bytes: &[u8],
    result: impl FnOnce(&mut Reader<'_>) -> Option<TaskResult>,
) -> Option<Accepted> {
    let mut rest = Reader(bytes);
    let attempt = rest.u32()?;
    let queued = Duration::from_nanos(u64::from_le_bytes(rest.take()?));
    let run_seconds = rest.f64()?;
    let length = rest.u32()? as usize;
    let worker = String::from_utf8(rest.bytes(length)?.to_vec()).ok()?;
    let result = result(&mut rest)?;
    let sound = rest.0.is_empty() && run_seconds >= 0.0 && worker.len() <= MAX_TEXT_BYTES;
    // Nothing else is kept.
    sound.then_some(Accepted { job, result, worker, attempt, queued, run_seconds, settled: true })
}

fn decode_result(rest: &mut Reader<'_>) -> Option<EvaluationResult> {
    let [queries, object_correct, category_correct, count] =
        [rest.u32()?, rest.u32()?, rest.u32()?, rest.u32()?];
    // Nothing is reserved on the word of `count`: each match has to be there first.
    let matches = (0..count).map(|_| rest.found()).collect::<Option<Vec<Match>>>()?;
    Some(EvaluationResult { queries, object_correct, category_correct, matches })
}

/// Bytes that have not been read yet.
struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn bytes(&mut self, length: usize) -> Option<&'a [u8]> {
        let (head, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some(head)
    }

    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*head)
    }

    fn u32(&mut self) -> Option<u32> {
        Some(u32::from_le_bytes(self.take()?))
    }

    fn f64(&mut self) -> Option<f64> {
        Some(f64::from_le_bytes(self.take()?)).filter(|number| number.is_finite())
    }

    fn found(&mut self) -> Option<Match> {
        let (nearest, distance) = (self.u32()?, self.f64()?);
        let runner_up = match self.take()? {
            [0] => None,
            [1] => Some((self.u32()?, self.f64()?)),
            _ => return None,
        };
        Some(Match { nearest, distance, runner_up })
    }
}

/// A worker as it is kept.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct MemberForm {
    label: String,
    name: String,
    threads: u32,
    build: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    credential: Option<String>,
}

/// Bytes of a worker; its id is the key under which they are kept.
pub(super) fn encode_member(member: &Member) -> Result<Vec<u8>, serde_json::Error> {
    let Member { label, introduction } = member.clone();
    let Introduction { name, threads, build, credential } = introduction;
    serde_json::to_vec(&MemberForm { label, name, threads, build, credential })
}

/// The inverse of [`encode_member`].
pub(super) fn decode_member(bytes: &[u8]) -> Option<Member> {
    let MemberForm { label, name, threads, build, credential } = serde_json::from_slice(bytes).ok()?;
    let is_sound = |text: &String| text.len() <= MAX_TEXT_BYTES && !text.chars().any(char::is_control);
    let sound = [&label, &name, &build].into_iter().chain(&credential).all(is_sound);
    sound.then_some(Member { label, introduction: Introduction { name, threads, build, credential } })
}
