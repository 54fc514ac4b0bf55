//! From wire types to the coordinator's own and back: the only file here that knows both.

use descriptor::{Descriptor, FixedDescriptor, FixedKind, Parameters};
use proto::{Digest, Lease, MAX_POLL_ITEMS, SessionId, WorkerId, v1};
use tonic::Status;

use cluster::evaluation::{Evaluation, EvaluationResult, Match};
use cluster::scheduler::{Answer, Poll, Report};
use cluster::shard::{Described, Description, Tile};
use cluster::task::{GridCell, Task, TaskResult};

fn job(lease: Lease, task: &Task, preparation: &v1::Preparation) -> v1::Job {
    let mut job = v1::Job { lease: Some(lease.into()), ..v1::Job::default() };
    match task {
        Task::Evaluation(evaluation) => job.evaluation = Some(self::evaluation(evaluation, preparation)),
        Task::GridCell(cell) => job.grid_cell = Some(grid_cell(cell, preparation)),
        Task::Description(shard) => job.description = Some(description(shard, preparation)),
        Task::Tile(tile) => job.tile = Some(self::tile(tile, preparation)),
    }
    job
}

fn description(shard: &Description, preparation: &v1::Preparation) -> v1::Description {
    v1::Description {
        preparation: Some(preparation.clone()),
        parameters: match &shard.descriptor {
            Descriptor::DiskRing(descriptor) => Some(parameters(descriptor)),
            Descriptor::Fixed(_) => None,
        },
        manifest: shard.manifest.to_vec(),
        fixed: match &shard.descriptor {
            Descriptor::DiskRing(_) => None,
            Descriptor::Fixed(descriptor) => Some(fixed(descriptor)),
        },
    }
}

fn fixed(descriptor: &FixedDescriptor) -> v1::FixedDescriptor {
    let kind = match descriptor.kind {
        FixedKind::PfhRgb => v1::FixedKind::Pfhrgb,
        FixedKind::ShotColor => v1::FixedKind::Shotcolor,
    };
    v1::FixedDescriptor { kind: kind.into(), radius_um: descriptor.radius_um }
}

fn tile(tile: &Tile, preparation: &v1::Preparation) -> v1::Tile {
    v1::Tile {
        evaluation: Some(evaluation(&tile.evaluation, preparation)),
        query_parts: digests(&tile.query_parts),
        database_parts: digests(&tile.database_parts),
    }
}

fn parameters(p: &Parameters) -> v1::Parameters {
    v1::Parameters {
        shape_bins: p.shape_bins,
        colour_bins: p.colour_bins,
        disk_um: p.disk_um,
        ring_um: p.ring_um,
        shape_weight_ppm: p.shape_weight_ppm,
    }
}

fn evaluation(evaluation: &Evaluation, preparation: &v1::Preparation) -> v1::Evaluation {
    v1::Evaluation {
        preparation: Some(preparation.clone()),
        parameters: Some(parameters(&evaluation.parameters)),
        query: digests(&evaluation.query),
        database: digests(&evaluation.database),
        want_matches: evaluation.want_matches,
    }
}

fn grid_cell(cell: &GridCell, preparation: &v1::Preparation) -> v1::GridCell {
    v1::GridCell {
        preparation: Some(preparation.clone()),
        disk_um: cell.disk_um,
        ring_um: cell.ring_um,
        query: digests(&cell.query),
        database: digests(&cell.database),
    }
}

fn digests(digests: &[Digest]) -> Vec<Vec<u8>> {
    digests.iter().map(|digest| digest.to_vec()).collect()
}

/// A reply to a poll.
pub fn reply(answer: Answer, preparation: &v1::Preparation) -> v1::PollReply {
    v1::PollReply {
        acknowledged: answer.acknowledged.into_iter().map(Into::into).collect(),
        revoked: answer.revoked.into_iter().map(Into::into).collect(),
        jobs: answer.jobs.iter().map(|(lease, task)| job(*lease, task, preparation)).collect(),
    }
}

/// An id from the wire.
pub fn id<T: for<'a> TryFrom<&'a [u8], Error = proto::InvalidId>>(bytes: &[u8]) -> Result<T, Status> {
    T::try_from(bytes).map_err(|error| Status::invalid_argument(error.to_string()))
}

/// Who polls in which session, and what it says.
pub fn poll(request: v1::PollRequest) -> Result<(WorkerId, SessionId, Poll), Status> {
    let worker = id(&request.worker_id)?;
    let session = id(&request.session_id)?;
    for (what, items) in [("held", request.held.len()), ("finished", request.finished.len())] {
        if items > MAX_POLL_ITEMS {
            return Err(Status::invalid_argument(format!(
                "{what}: at most {MAX_POLL_ITEMS} items, got {items}"
            )));
        }
    }
    let poll = Poll {
        sequence: request.sequence,
        held: request.held.into_iter().map(Into::into).collect(),
        finished: request.finished.into_iter().map(report).collect::<Result<_, _>>()?,
        wanted: (request.wanted as usize).min(MAX_POLL_ITEMS),
        leaving: request.leaving,
    };
    Ok((worker, session, poll))
}

fn report(report: v1::JobReport) -> Result<Report, Status> {
    let lease = report.lease.ok_or_else(|| Status::invalid_argument("report: lease is missing"))?.into();
    let run_seconds = report.run_seconds;
    let run_seconds = if run_seconds.is_finite() && run_seconds >= 0.0 { run_seconds } else { 0.0 };
    let outcome = match report.outcome {
        Some(v1::job_report::Outcome::Result(result)) => self::result(result).map(TaskResult::Evaluation),
        Some(v1::job_report::Outcome::GridCell(result)) => Ok(TaskResult::GridCell(result.object_correct)),
        Some(v1::job_report::Outcome::Description(result)) => {
            Ok(TaskResult::Description(Described::new(result.parts)))
        }
        Some(v1::job_report::Outcome::Failure(failure)) => {
            let kind = match failure.reason() {
                v1::FailureReason::Unspecified => "failed",
                v1::FailureReason::Data => "data",
                v1::FailureReason::Panic => "panic",
                v1::FailureReason::InvalidJob => "invalid job",
                v1::FailureReason::Cloud => "cloud",
                v1::FailureReason::Description => "description",
            };
            // It goes to a terminal: no control characters but line ends.
            let message = proto::truncate(&failure.message, proto::MAX_TEXT_BYTES);
            let message: String = message.chars().filter(|c| *c == '\n' || !c.is_control()).collect();
            Err(format!("{kind}: {message}"))
        }
        None => Err("the report has no outcome".to_owned()),
    };
    Ok(Report { lease, run_seconds, outcome })
}

fn result(result: v1::EvaluationResult) -> Result<EvaluationResult, String> {
    let matches = result.matches.into_iter().map(|found| {
        let runner_up = match (found.runner_up, found.runner_up_distance) {
            (Some(index), Some(distance)) => Some((index, distance)),
            (None, None) => None,
            _ => return Err("match: runner-up must have both index and distance".to_owned()),
        };
        Ok(Match { nearest: found.nearest, distance: found.distance, runner_up })
    });
    Ok(EvaluationResult {
        queries: result.queries,
        object_correct: result.object_correct,
        category_correct: result.category_correct,
        matches: matches.collect::<Result<_, _>>()?,
    })
}

/// Kind and key of a derived entry that is asked for.
pub fn derived_key(request: &v1::FetchDerivedRequest) -> Result<(&str, Digest), Status> {
    Ok((&request.kind, id(&request.key)?))
}

/// The digest a blob is asked for by.
pub fn blob_digest(request: &v1::FetchBlobRequest) -> Result<Digest, Status> {
    id(&request.digest)
}
