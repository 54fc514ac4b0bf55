//! What an operator orders while a run goes on.

use std::fmt;

use serde::{Deserialize, Serialize};

/// An order. In JSON, its fields stand beside its name `action`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "action", rename_all = "snake_case")]
pub enum ControlAction {
    /// No more jobs are handed out; those in hand end.
    Pause,
    /// Jobs are handed out again: of a run, or to a worker.
    Resume {
        /// Label of the worker that was drained; `None`: the run that was paused.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        worker: Option<String>,
    },
    /// The run ends as by an interrupt, and can be resumed.
    Stop,
    /// Another weight of a sweep's member among those that compete for workers.
    Priority {
        /// From 1.
        priority: u32,
    },
    /// A worker gets no more jobs; it ends those in hand, and stays.
    Drain {
        /// Its label.
        worker: String,
    },
    /// A worker is removed and let in no more.
    Deny {
        /// Its label.
        worker: String,
    },
}

impl ControlAction {
    /// One word for what was done by it.
    pub fn as_done(&self) -> &'static str {
        match self {
            Self::Pause => "paused",
            Self::Resume { .. } => "resumed",
            Self::Stop => "stopped",
            Self::Priority { .. } => "priority",
            Self::Drain { .. } => "drained",
            Self::Deny { .. } => "denied",
        }
    }

    /// Label of the worker that it is about.
    pub fn worker(&self) -> Option<&String> {
        match self {
            Self::Drain { worker } | Self::Deny { worker } => Some(worker),
            Self::Resume { worker } => worker.as_ref(),
            Self::Pause | Self::Stop | Self::Priority { .. } => None,
        }
    }
}

/// An order that was carried out.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Controlled {
    /// What was ordered.
    #[serde(flatten)]
    pub action: ControlAction,
    /// The member of a sweep that it is about; `None`: all of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub member: Option<String>,
    /// Why.
    pub reason: String,
    /// Who ordered it.
    pub by: String,
}

impl Controlled {
    /// Who ordered it and why.
    pub fn because(&self) -> String {
        format!("by {}: {}", self.by, self.reason)
    }
}

impl fmt::Display for Controlled {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(member) = &self.member {
            write!(f, "{member}: ")?;
        }
        if let Some(worker) = self.action.worker() {
            write!(f, "worker {worker}: ")?;
        }
        f.write_str(self.action.as_done())?;
        if let ControlAction::Priority { priority } = self.action {
            write!(f, " {priority}")?;
        }
        write!(f, " {}", self.because())
    }
}
