//! The control of running runs: an operator's request goes through a file in the run folder to the coordinator at work.
//!
//! `request` writes it and waits for the answer, `watch` is the coordinator's side, `message` what the files say, `folder`
//! where they are.

mod folder;
mod message;
mod request;
mod watch;

pub use folder::{ControlError, Requests};
pub use message::{Request, me};
pub(crate) use message::{reads, sample};
pub use request::{WAIT, request, request_within};
pub use watch::{Operator, resuming};

pub use cluster::events::ControlAction as Action;
