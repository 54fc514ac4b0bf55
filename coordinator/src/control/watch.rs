//! The coordinator's side: looks for requests while it works, and carries them out.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use cluster::Cluster;
use cluster::events::{ControlAction, Controlled};
use cluster::scheduler::ClientId;
use proto::{Message, Principal};
use tokio::task::spawn_blocking;
use tokio::time::MissedTickBehavior;

use super::folder::{Requests, Taken};
use super::message::{Answer, Request};
use crate::run::RunError;

/// How often it looks.
const LOOK: Duration = Duration::from_millis(500);

/// Keeps an order that was carried out.
pub type Keep<'a> = &'a dyn Fn(&Controlled) -> Result<(), results::Error>;

/// Carries out requests of operators.
pub struct Operator<'a> {
    /// Where they come from.
    pub requests: Requests,
    /// Who computes.
    pub cluster: Arc<Cluster>,
    /// The run's client; of a sweep, those of its runs that are not finished, with their names.
    pub clients: Vec<(Option<String>, ClientId)>,
    /// How to go on with what is stopped, for messages.
    pub go_on: String,
    /// Keeps orders where no journal does.
    pub keep: Option<Keep<'a>>,
    /// The folder of certificates and deny list, if there is one.
    pub tls: Option<PathBuf>,
}

/// How to go on with the run or sweep in a folder.
pub fn resuming(folder: &Path) -> String {
    format!("the same command again, or coordinator resume {} with the same options", folder.display())
}

impl Operator<'_> {
    /// Does `work`, and meanwhile what operators request; `tell` is called when something was done.
    ///
    /// # Errors
    /// Those of the work, and that an operator has stopped it.
    pub async fn during<T>(
        self,
        tell: impl Fn(),
        work: impl Future<Output = Result<T, RunError>>,
    ) -> Result<T, RunError> {
        let requests = self.requests.clone();
        let done = tokio::select! {
            done = work => done,
            stopped = self.watch(tell) => Err(stopped),
        };
        requests.end();
        done
    }

    /// Carries out requests until one of them stops the run.
    async fn watch(mut self, tell: impl Fn()) -> RunError {
        let mut looks = tokio::time::interval(LOOK);
        looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            looks.tick().await;
            let mut requests = self.requests.clone();
            // On a thread of its own: a network file system may be slow.
            let Ok((requests, taken)) = spawn_blocking(move || {
                let taken = requests.take();
                (requests, taken)
            })
            .await
            else {
                continue; // the runtime ends
            };
            self.requests = requests;
            for taken in taken {
                if let Some(stopped) = self.answer(taken).await {
                    tell();
                    return stopped;
                }
                tell();
            }
        }
    }

    /// Carries out one request, and answers it; gives how the run ends, if it does.
    async fn answer(&self, taken: Taken) -> Option<RunError> {
        let Taken { request, answer } = taken;
        let (done, stopped) = match request {
            Err(error) => (Err(error), None),
            Ok((request, member)) => {
                let done = self.carry_out(&request, member.as_deref());
                let stops = request.action == ControlAction::Stop && done.is_ok();
                let Request { by, reason, .. } = request;
                (done, stops.then(|| RunError::Stopped { go_on: self.go_on.clone(), by, reason }))
            }
        };
        if stopped.is_some() {
            // What the run ends with says why it ended.
            let _ = self.cluster.flush().await; // a disk that has failed ends the run with its own error next time
        }
        // On a thread of its own, as a network file system may be slow; and all at once, so that whoever waits is told even
        // if the run ends meanwhile.
        let told = spawn_blocking(move || {
            answer.send(&match done {
                Ok(Done { text, keep_out }) => {
                    Answer::Done(text + &keep_out.map_or_else(String::new, KeepOut::carry_out))
                }
                Err(error) => Answer::Error(error),
            });
        });
        let _ = told.await; // the runtime ends
        stopped
    }

    fn carry_out(&self, request: &Request, member: Option<&str>) -> Result<Done, String> {
        let Request { action, reason, by } = request.clone();
        // Workers are those of the whole sweep.
        let member = member.filter(|_| action.worker().is_none());
        let its = |(name, _): &&(Option<String>, ClientId)| member.is_none() || name.as_deref() == member;
        let clients: Vec<ClientId> = self.clients.iter().filter(its).map(|(_, client)| *client).collect();
        if clients.is_empty() {
            return Err(format!(
                "member: must be a run of this sweep that is not finished, got {}\nname the folder of one that goes on",
                member.unwrap_or_default()
            ));
        }
        let denied = match &action {
            ControlAction::Deny { worker } => Some(self.cluster.principal_of(worker)),
            _ => None,
        };
        let order = Controlled { action, member: member.map(str::to_owned), reason, by };
        let keep_out =
            denied.map(|principal| KeepOut { tls: self.tls.clone(), principal, because: order.because() });
        let done = self.cluster.control(order.clone(), &clients).map_err(|refusal| refusal.to_string())?;
        let kept = self.keep.map_or(Ok(()), |keep| keep(&order));
        let prefix = member.map_or_else(String::new, |member| format!("{member}: "));
        let lost = kept.err().map_or_else(String::new, |error| {
            format!("; table events does not have it: {}", Message::of(&error).what)
        });
        Ok(Done { text: format!("{prefix}{done}{lost}"), keep_out })
    }
}

/// What was done.
struct Done {
    /// For people.
    text: String,
    /// What is left to be done for a denied worker.
    keep_out: Option<KeepOut>,
}

/// How a denied worker is kept out.
struct KeepOut {
    /// The folder of certificates and deny list, if there is one.
    tls: Option<PathBuf>,
    /// Who answers for the worker, if that is known.
    principal: Option<Principal>,
    /// Why, for the deny list.
    because: String,
}

impl KeepOut {
    /// Puts the worker's certificate onto the deny list, if there are both; says how it is kept out. Blocks.
    fn carry_out(self) -> String {
        let session = "; it is let in no more as long as this coordinator is at work";
        let (Some(tls), Some(Principal::Certificate(certificate))) = (self.tls, self.principal) else {
            return session.to_owned();
        };
        match transport::deny(&tls, &certificate, &self.because) {
            Ok(list) => format!("; {} has its certificate now", list.display()),
            Err(error) => format!("{session}: {}", Message::of(&error).what),
        }
    }
}
