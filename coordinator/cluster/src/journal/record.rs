//! Accepted results and workers as the messages of `descry/v2/journal.proto`, and back.

use std::time::Duration;

use prost::Message as _;
use proto::task::{Described, TaskResult};
use proto::v2::accepted_result::Result as Kept;
use proto::{Digest, JobId, MAX_NAME_BYTES, WorkerId, v2};

use super::{Accepted, Member};
use crate::events::Introduction;

/// Longest text of a worker, bytes: a name with the suffix that makes it unique.
const MAX_TEXT_BYTES: usize = 2 * MAX_NAME_BYTES;

/// Bytes of an accepted result; its job is the key under which they are kept. `None` of one that is not kept.
pub(super) fn encode_accepted(accepted: &Accepted) -> Option<Vec<u8>> {
    let result = match &accepted.result {
        TaskResult::Evaluation(result) => Kept::Evaluation(result.clone().into()),
        TaskResult::Description(described) => Kept::Description(described.digest.to_vec()),
        TaskResult::GridCell(_) => return None,
    };
    let message = v2::AcceptedResult {
        worker: accepted.worker.clone(),
        worker_id: accepted.worker_id.to_vec(),
        attempt: accepted.attempt,
        queued_nanoseconds: accepted.queued.as_nanos() as u64,
        run_seconds: accepted.run_seconds,
        result: Some(result),
    };
    Some(message.encode_to_vec())
}

/// The inverse of [`encode_accepted`]; `None` if it cannot have written these bytes.
pub(super) fn decode_accepted(job: JobId, bytes: &[u8]) -> Option<Accepted> {
    let message = v2::AcceptedResult::decode(bytes).ok()?;
    let result = match message.result? {
        Kept::Evaluation(result) => TaskResult::Evaluation(result.into()),
        Kept::Description(digest) => {
            TaskResult::Description(Described::named(Digest::try_from(&digest[..]).ok()?))
        }
    };
    let accepted = Accepted {
        job,
        result,
        worker_id: WorkerId::try_from(&message.worker_id[..]).ok()?,
        worker: message.worker,
        attempt: message.attempt,
        queued: Duration::from_nanos(message.queued_nanoseconds),
        run_seconds: message.run_seconds,
        settled: true, // nothing else is kept
    };
    // Decoding passes over what it does not know; a journal of this version has nothing of the kind.
    let sound = is_sound(&accepted) && encode_accepted(&accepted)? == bytes;
    sound.then_some(accepted)
}

fn is_sound(accepted: &Accepted) -> bool {
    let finite = match &accepted.result {
        TaskResult::Evaluation(result) => result.matches.iter().all(|found| {
            found.distance.is_finite() && found.runner_up.is_none_or(|(_, distance)| distance.is_finite())
        }),
        TaskResult::GridCell(_) | TaskResult::Description(_) => true,
    };
    let run_seconds = accepted.run_seconds;
    finite && run_seconds.is_finite() && run_seconds >= 0.0 && accepted.worker.len() <= MAX_TEXT_BYTES
}

/// Bytes of a worker; its id is the key under which they are kept.
pub(super) fn encode_member(member: &Member) -> Vec<u8> {
    let Member { label, introduction } = member.clone();
    let Introduction { name, threads, build, credential } = introduction;
    v2::Member { label, name, threads, build, credential }.encode_to_vec()
}

/// The inverse of [`encode_member`].
pub(super) fn decode_member(bytes: &[u8]) -> Option<Member> {
    let v2::Member { label, name, threads, build, credential } = v2::Member::decode(bytes).ok()?;
    let is_sound = |text: &String| text.len() <= MAX_TEXT_BYTES && !text.chars().any(char::is_control);
    let sound = [&label, &name, &build].into_iter().chain(&credential).all(is_sound);
    sound.then_some(Member { label, introduction: Introduction { name, threads, build, credential } })
}
