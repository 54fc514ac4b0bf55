//! What a request says and what it is answered, as JSON of bounded size: neither side believes the other's bytes.

use serde::{Deserialize, Serialize};

use cluster::events::ControlAction;
use cluster::scheduler::MAX_PRIORITY;

/// Version of the files.
const VERSION: u32 = 1;
/// A file that is longer is not read.
pub(super) const MAX_BYTES: u64 = 8 << 10;
/// Characters of a reason, a name or a label.
const MAX_CHARS: usize = 200;

/// What an operator wants.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Request {
    /// What is to be done.
    pub action: ControlAction,
    /// Why: 1 to 200 printable characters.
    pub reason: String,
    /// Who wants it: see [`me`].
    pub by: String,
}

/// A request as it is written.
#[derive(Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Written {
    version: u32,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    member: Option<String>,
    by: String,
    reason: String,
    #[serde(flatten)]
    action: ControlAction,
}

/// An answer: what was done, or why nothing was.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Answer {
    /// It was done.
    Done(String),
    /// It was not.
    Error(String),
}

impl Request {
    /// Whether it can be carried out at all: `of_member` by a run of a sweep; what is wrong, if not.
    pub(super) fn check(&self, of_member: bool) -> Result<(), String> {
        text("--reason", &self.reason)?;
        text("by", &self.by)?;
        if let Some(worker) = self.action.worker() {
            text("worker", worker)?;
        }
        match self.action {
            ControlAction::Priority { priority } if !(1..=MAX_PRIORITY).contains(&priority) => {
                Err(format!("priority: must be from 1 to {MAX_PRIORITY}, got {priority}\n1 is that of all at first"))
            }
            ControlAction::Priority { .. } if !of_member => Err(
                "priority: must be of one run of a sweep, got all runs of the coordinator\nname the folder of the run that is to get more of the workers"
                    .to_owned(),
            ),
            ControlAction::Stop if of_member => Err(
                "stop: must be of a whole sweep, got one of its runs\nname the sweep's folder, or pause this run"
                    .to_owned(),
            ),
            _ => Ok(()),
        }
    }

    /// The bytes of a file.
    pub(super) fn encode(&self, member: Option<&str>) -> Vec<u8> {
        let Self { action, reason, by } = self.clone();
        let written = Written { version: VERSION, member: member.map(str::to_owned), by, reason, action };
        serde_json::to_vec(&written).unwrap_or_default() // strings and numbers can always be written
    }

    /// What a file says, and of which member of a sweep; what is wrong with it, if anything is.
    pub(super) fn decode(bytes: &[u8]) -> Result<(Self, Option<String>), String> {
        #[derive(Deserialize)]
        struct Versioned {
            version: u32,
        }
        let invalid = |error: serde_json::Error| {
            format!("request: must be one of this program, got {error}\nuse coordinator control")
        };
        let Versioned { version } = serde_json::from_slice(bytes).map_err(invalid)?;
        if version != VERSION {
            return Err(format!(
                "request: version must be {VERSION}, got {version}\nuse the coordinator's release"
            ));
        }
        let Written { member, by, reason, action, .. } = serde_json::from_slice(bytes).map_err(invalid)?;
        let request = Self { action, reason, by };
        if let Some(member) = &member {
            text("member", member)?;
        }
        request.check(member.is_some())?;
        Ok((request, member))
    }
}

impl Answer {
    pub(super) fn encode(&self) -> Vec<u8> {
        serde_json::to_vec(self).unwrap_or_default() // strings can always be written
    }

    pub(super) fn decode(bytes: &[u8]) -> Result<Self, String> {
        serde_json::from_slice(bytes).map_err(|error| error.to_string())
    }
}

/// Whether these bytes are a request or an answer.
pub fn reads(bytes: &[u8]) -> bool {
    Request::decode(bytes).is_ok() || Answer::decode(bytes).is_ok()
}

/// A request as a file has it.
pub fn sample() -> Vec<u8> {
    let action = ControlAction::Priority { priority: 4 };
    Request { action, reason: "deadline".to_owned(), by: "jo@lab".to_owned() }.encode(Some("seed-1"))
}

fn text(what: &str, text: &str) -> Result<(), String> {
    let count = text.chars().count();
    if text.trim().is_empty() || count > MAX_CHARS || !text.chars().all(proto::is_printable) {
        let shown: String = proto::printable(text).chars().take(40).collect();
        return Err(format!(
            "{what}: must be 1 to {MAX_CHARS} printable characters, got {count}: {shown:?}\nwrite a short line"
        ));
    }
    Ok(())
}

/// Who runs this program, as user@host.
pub fn me() -> String {
    let user = ["USER", "LOGNAME", "USERNAME"].iter().find_map(|name| std::env::var(name).ok());
    let user = user.filter(|user| !user.is_empty()).unwrap_or_else(|| "unknown".to_owned());
    let name = format!("{user}@{}", transport::host_name());
    name.chars().filter(|c| proto::is_printable(*c)).take(MAX_CHARS).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn request(action: ControlAction) -> Request {
        Request { action, reason: "the room gets too warm".to_owned(), by: "jo@lab".to_owned() }
    }

    #[test]
    fn requests_are_read_as_they_were_written() {
        let worker = || "lab-1".to_owned();
        for (action, member) in [
            (ControlAction::Pause, None),
            (ControlAction::Pause, Some("seed-1")),
            (ControlAction::Resume { worker: None }, None),
            (ControlAction::Resume { worker: Some(worker()) }, None),
            (ControlAction::Stop, None),
            (ControlAction::Priority { priority: 100 }, Some("seed-1")),
            (ControlAction::Drain { worker: worker() }, None),
            (ControlAction::Deny { worker: worker() }, Some("seed-1")),
        ] {
            let written = request(action).encode(member);
            let (read, of) = Request::decode(&written).unwrap();
            assert_eq!((read.encode(of.as_deref()), of.as_deref()), (written, member));
        }
    }

    #[test]
    fn what_no_request_can_say_is_an_error_that_says_what_to_do() {
        let pause = r#""action":"pause""#;
        for (bytes, expected) in [
            (String::new(), "must be one of this program, got EOF"),
            ("[1]".to_owned(), "must be one of this program, got invalid"),
            (format!(r#"{{"version":2,{pause}}}"#), "version must be 1, got 2"),
            (format!(r#"{{"version":1,{pause},"by":"a"}}"#), "missing field `reason`"),
            (format!(r#"{{"version":1,{pause},"by":"a","reason":""}}"#), "--reason: must be 1 to 200"),
            (format!(r#"{{"version":1,{pause},"by":"a","reason":"b\u0007"}}"#), "--reason: must be 1 to 200"),
            (format!(r#"{{"version":1,{pause},"by":"\u202e","reason":"b"}}"#), "by: must be 1 to 200"),
            (
                format!(r#"{{"version":1,{pause},"by":"a","reason":"{}"}}"#, "x".repeat(201)),
                "--reason: must be 1 to 200",
            ),
            (r#"{"version":1,"action":"explode","by":"a","reason":"b"}"#.to_owned(), "unknown variant"),
            (r#"{"version":1,"action":"drain","by":"a","reason":"b"}"#.to_owned(), "missing field `worker`"),
            (
                r#"{"version":1,"action":"deny","worker":"\n","by":"a","reason":"b"}"#.to_owned(),
                "worker: must be 1 to 200",
            ),
            (
                r#"{"version":1,"action":"priority","priority":0,"member":"s","by":"a","reason":"b"}"#
                    .to_owned(),
                "priority: must be from 1 to 100, got 0",
            ),
            (
                r#"{"version":1,"action":"priority","priority":2,"by":"a","reason":"b"}"#.to_owned(),
                "priority: must be of one run of a sweep",
            ),
            (
                r#"{"version":1,"action":"stop","member":"s","by":"a","reason":"b"}"#.to_owned(),
                "stop: must be of a whole sweep",
            ),
        ] {
            let error = Request::decode(bytes.as_bytes()).unwrap_err();
            assert!(error.contains(expected) && error.contains('\n'), "{bytes}: {error}");
        }
    }

    #[test]
    fn whoever_runs_this_may_ask() {
        let asked = Request { by: me(), ..request(ControlAction::Pause) };
        asked.check(false).unwrap();
        assert!(asked.by.contains('@'), "{}", asked.by);
    }

    proptest! {
        #[test]
        fn no_bytes_panic(bytes in prop::collection::vec(any::<u8>(), 0..200), json in "\\{(\"(version|action|by|reason|member|worker)\":(1|\"pause\"|\"stop\"|\\[\\]|null),?)*\\}") {
            for bytes in [&bytes[..], json.as_bytes()] {
                let _ = Request::decode(bytes);
                let _ = Answer::decode(bytes);
            }
        }
    }
}
