//! What happened, as a stream: typed events in an append-only log that any number of observers follow.

mod control;
mod event;
mod log;
mod serde_forms;

pub use control::{ControlAction, Controlled};
pub use event::{Attempt, AttemptEnd, Departure, Event, EventKind};
pub use log::{EventCursor, EventLog, MAX_KEPT, Omitted};
