//! What a viewer may have done with a run that goes on.

use serde::Deserialize;

use super::error::DashboardError;
use super::shown::Shown;
use crate::control::{Action, Request, me, request};

/// The body of a request.
#[derive(Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Order {
    /// Id of the run.
    pub id: String,
    action: String,
    #[serde(default)]
    worker: Option<String>,
    #[serde(default)]
    priority: Option<u32>,
    reason: String,
}

impl Order {
    /// From the bytes of a body.
    ///
    /// # Errors
    /// [`DashboardError::Order`] if they are none.
    pub fn read(body: &[u8]) -> Result<Self, DashboardError> {
        serde_json::from_slice(body).map_err(|error| DashboardError::Order { got: error.to_string() })
    }

    /// Has the coordinator at work on a run carry it out; gives a line for people. Blocks for some seconds.
    ///
    /// # Errors
    /// If it says nothing that could be done, or is not carried out.
    pub fn carry_out(self, shown: &Shown) -> Result<String, DashboardError> {
        let action = self.action()?;
        let wanted = Request { action, reason: self.reason, by: format!("{}, in a dashboard", me()) };
        Ok(request(&shown.found().folder, &wanted)?)
    }

    fn action(&self) -> Result<Action, DashboardError> {
        let lacks = |what: &str| DashboardError::Order { got: format!("{} without {what}", self.action) };
        let worker = || self.worker.clone().ok_or_else(|| lacks("a worker"));
        Ok(match self.action.as_str() {
            "pause" => Action::Pause,
            "resume" => Action::Resume { worker: self.worker.clone() },
            "stop" => Action::Stop,
            "priority" => Action::Priority { priority: self.priority.ok_or_else(|| lacks("a priority"))? },
            "drain" => Action::Drain { worker: worker()? },
            "deny" => Action::Deny { worker: worker()? },
            other => {
                let got: String = other.escape_debug().take(40).collect();
                return Err(DashboardError::Order { got });
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_are_read_in_full_or_refused() {
        let action = |body: &str| Order::read(body.as_bytes()).and_then(|order| order.action());
        let worker = "host".to_owned();
        for (body, expected) in [
            (r#"{"id":"a","action":"pause","reason":"r"}"#, Action::Pause),
            (r#"{"id":"a","action":"resume","reason":"r"}"#, Action::Resume { worker: None }),
            (r#"{"id":"a","action":"drain","worker":"host","reason":"r"}"#, Action::Drain { worker }),
            (r#"{"id":"a","action":"priority","priority":7,"reason":"r"}"#, Action::Priority { priority: 7 }),
        ] {
            assert_eq!(action(body).unwrap(), expected, "{body}");
        }
        for body in [
            "",
            "[]",
            r#"{"id":"a","action":"pause"}"#,
            r#"{"id":"a","action":"pause","reason":"r","more":1}"#,
            r#"{"id":"a","action":"deny","reason":"r"}"#,
            r#"{"id":"a","action":"priority","priority":-1,"reason":"r"}"#,
            r#"{"id":"a","action":"halt\n","reason":"r"}"#,
        ] {
            let refused = action(body).unwrap_err();
            assert!(matches!(refused, DashboardError::Order { .. }), "{body}: {refused}");
        }
    }
}
