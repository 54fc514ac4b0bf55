//! Decodes messages of gRPC, and refuses before that what would take far more memory than it has bytes.
//!
//! An entry of a list takes two bytes if it says nothing, and up to 128 once it is decoded.

use std::any::TypeId;

use prost::Message;
use prost::bytes::Buf as _;
use prost::encoding::{DecodeContext, WireType, decode_key, decode_varint, skip_field};
use tonic::Status;
use tonic::codec::{BufferSettings, Codec, DecodeBuf, Decoder};
use tonic_prost::ProstCodec;

use crate::MAX_MESSAGE_BYTES;
use crate::v2::{Job, JobReport, Lease, Match, Nearest, Object, PollReply, PollRequest, PresignUrlsRequest};

/// Most memory that the lists of one message may take once it is decoded, bytes.
const MAX_LIST_BYTES: usize = 4 * MAX_MESSAGE_BYTES;

/// The codec of prost, with a bound to what a message takes in memory.
#[derive(Debug)]
pub struct BoundedCodec<T, U>(ProstCodec<T, U>);

impl<T, U> Default for BoundedCodec<T, U> {
    fn default() -> Self {
        Self(ProstCodec::default())
    }
}

impl<T, U> Codec for BoundedCodec<T, U>
where
    T: Message + Send + 'static,
    U: Message + Default + Send + 'static,
{
    type Encode = T;
    type Decode = U;
    type Encoder = <ProstCodec<T, U> as Codec>::Encoder;
    type Decoder = BoundedDecoder<<ProstCodec<T, U> as Codec>::Decoder>;

    fn encoder(&mut self) -> Self::Encoder {
        self.0.encoder()
    }

    fn decoder(&mut self) -> Self::Decoder {
        BoundedDecoder(self.0.decoder())
    }
}

/// A decoder that looks at a message before it decodes it.
#[derive(Debug)]
pub struct BoundedDecoder<D>(D);

impl<D: Decoder<Error = Status>> Decoder for BoundedDecoder<D>
where
    D::Item: 'static,
{
    type Item = D::Item;
    type Error = Status;

    fn decode(&mut self, buf: &mut DecodeBuf<'_>) -> Result<Option<Self::Item>, Status> {
        check(lists_of(TypeId::of::<D::Item>()), buf.chunk())?;
        self.0.decode(buf)
    }

    fn buffer_settings(&self) -> BufferSettings {
        self.0.buffer_settings()
    }
}

/// A field whose values are messages: how much memory each takes, and such fields within it.
struct Field {
    number: u32,
    bytes: usize,
    within: &'static [Field],
}

const fn list<T>(number: u32, within: &'static [Field]) -> Field {
    Field { number, bytes: size_of::<T>(), within }
}

/// A message that is a part of another.
const fn part(number: u32, within: &'static [Field]) -> Field {
    Field { number, bytes: 0, within }
}

static EVALUATION: [Field; 2] = [list::<Match>(4, &[]), list::<Nearest>(5, &[])];
static RESULT: [Field; 1] = [part(1, &EVALUATION)];
static REPORT: [Field; 1] = [part(3, &RESULT)];
static POLL: [Field; 2] = [list::<Lease>(4, &[]), list::<JobReport>(5, &REPORT)];
static POLL_REPLY: [Field; 3] = [list::<Lease>(1, &[]), list::<Lease>(2, &[]), list::<Job>(3, &[])];
static PRESIGN: [Field; 1] = [list::<Object>(2, &[])];

/// The lists of a message of this type.
fn lists_of(message: TypeId) -> &'static [Field] {
    match message {
        poll if poll == TypeId::of::<PollRequest>() => &POLL,
        reply if reply == TypeId::of::<PollReply>() => &POLL_REPLY,
        presign if presign == TypeId::of::<PresignUrlsRequest>() => &PRESIGN,
        _ => &[],
    }
}

fn check(lists: &[Field], message: &[u8]) -> Result<(), Status> {
    let mut left = MAX_LIST_BYTES;
    match lists.is_empty() || fits(lists, message, &mut left) {
        true => Ok(()),
        false => Err(Status::invalid_argument(format!(
            "message: lists must take at most {} MiB of memory, got more",
            MAX_LIST_BYTES >> 20
        ))),
    }
}

/// Whether the lists of a message take no more memory than is left, of which they are taken. What is wrong with a message,
/// whoever decodes it says.
fn fits(lists: &[Field], mut message: &[u8], left: &mut usize) -> bool {
    while !message.is_empty() {
        let Ok((number, wire_type)) = decode_key(&mut message) else { return true };
        let field = lists.iter().find(|field| field.number == number);
        let Some(field) = field.filter(|_| wire_type == WireType::LengthDelimited) else {
            if skip_field(wire_type, number, &mut message, DecodeContext::default()).is_err() {
                return true;
            }
            continue;
        };
        let Ok(length) = decode_varint(&mut message) else { return true };
        let Some((value, rest)) = message.split_at_checked(length as usize) else { return true };
        message = rest;
        match left.checked_sub(field.bytes) {
            Some(after) => *left = after,
            None => return false,
        }
        if !fits(field.within, value, left) {
            return false;
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::v2::{EvaluationResult, Neighbour, TaskResult, job_report, task_result};

    fn poll(reports: usize, matches: usize, nearest: usize) -> PollRequest {
        let neighbour = Neighbour { index: 7, distance: 0.5 };
        let one = Match { nearest: 9, distance: 0.25, runner_up: Some(neighbour) };
        let evaluation = EvaluationResult {
            matches: vec![one; matches],
            nearest: vec![Nearest::default(); nearest],
            ..EvaluationResult::default()
        };
        let result = TaskResult { result: Some(task_result::Result::Evaluation(evaluation)) };
        let report = JobReport {
            lease: Some(Lease { job: 1, attempt: 2, nonce: vec![3; 16] }),
            run_seconds: 0.5,
            outcome: Some(job_report::Outcome::Result(result)),
        };
        PollRequest {
            finished: vec![report; reports],
            held: vec![Lease::default(); 256],
            ..Default::default()
        }
    }

    fn is_refused(message: &[u8]) -> bool {
        check(lists_of(TypeId::of::<PollRequest>()), message).is_err()
    }

    #[test]
    fn what_a_worker_may_say_is_decoded() {
        // The largest that fits in a message.
        for request in [poll(256, 1800, 0), poll(1, 480_000, 0), poll(0, 0, 0)] {
            let bytes = request.encode_to_vec();
            assert!(bytes.len() <= MAX_MESSAGE_BYTES && !is_refused(&bytes), "{}", bytes.len());
        }
    }

    #[test]
    fn a_message_of_empty_entries_is_refused_wherever_they_are() {
        let entries = |key: u8| [key, 0].repeat(4_000_000);
        let [held, finished] = [4, 5].map(|number: u8| entries(number << 3 | 2));
        assert!(is_refused(&held) && is_refused(&finished));
        assert!(is_refused(&poll(1, 0, 4_000_000).encode_to_vec()));
        assert!(is_refused(&poll(250, 0, 16_000).encode_to_vec()), "added up over all reports");
        // Behind a group, which decoders pass over.
        assert!(is_refused(&[&[15 << 3 | 3, 15 << 3 | 4], &finished[..]].concat()));
        for list in 1..=3 {
            let reply = entries(list << 3 | 2);
            assert!(check(lists_of(TypeId::of::<PollReply>()), &reply).is_err(), "list {list} of a reply");
        }
        let objects = entries(2 << 3 | 2);
        assert!(check(lists_of(TypeId::of::<PresignUrlsRequest>()), &objects).is_err());
        assert!(check(lists_of(TypeId::of::<Lease>()), &finished).is_ok(), "a message without lists");
    }

    proptest! {
        #[test]
        fn what_is_counted_is_what_the_lists_take(
            (reports, matches, nearest) in (0usize..5, 0usize..9, 0usize..9),
            left in 0usize..20_000,
        ) {
            let request = poll(reports, matches, nearest);
            let of_report = size_of::<JobReport>() + matches * size_of::<Match>() + nearest * size_of::<Nearest>();
            let taken = request.held.len() * size_of::<Lease>() + reports * of_report;
            let mut rest = left;
            prop_assert_eq!(fits(&POLL, &request.encode_to_vec(), &mut rest), taken <= left);
            prop_assert!(taken > left || rest == left - taken);
        }

        #[test]
        fn arbitrary_bytes_are_no_reason_to_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            fits(&POLL, &bytes, &mut 1000);
        }
    }
}
