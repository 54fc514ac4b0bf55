//! The runs that a dashboard shows, looked for again from time to time.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::error::DashboardError;
use super::folders::{Found, Kind, find};
use super::shown::Shown;
use crate::exhaust::is_landscape_of;
use crate::lock::lock;

/// Folders are not looked through again before this.
const EVERY: Duration = Duration::from_secs(2);
/// How long a list holds.
const LISTED: Duration = Duration::from_millis(900);
/// Share of a core that looking may take, as one over it.
const SPARING: u32 = 20;

/// All runs of some folders.
pub struct RunIndex {
    roots: Vec<PathBuf>,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    next_look: Option<Instant>,
    runs: BTreeMap<String, Arc<Shown>>,
    /// All of them in short, as JSON, and when that was found out.
    list: Option<(Instant, Arc<str>)>,
}

impl RunIndex {
    /// Of the runs in these folders.
    pub fn new(roots: Vec<PathBuf>) -> Self {
        Self { roots, state: Mutex::default() }
    }

    /// Looks for runs that have come or gone, if it is time. Blocks.
    fn look(&self) {
        let begun = Instant::now();
        if self.state().next_look.is_some_and(|next| begun < next) {
            return;
        }
        let found = find(&self.roots);
        let mut state = self.state();
        let mut before = std::mem::take(&mut state.runs);
        for one in found {
            let shown = before.remove(&one.id).filter(|shown| *shown.found() == one);
            let shown = shown.unwrap_or_else(|| Arc::new(Shown::new(&one)));
            state.runs.insert(one.id, shown);
        }
        state.next_look = Some(Instant::now() + EVERY.max(SPARING * begun.elapsed()));
    }

    /// The run of this id. Blocks.
    ///
    /// # Errors
    /// [`DashboardError::UnknownRun`].
    pub fn run(&self, id: &str) -> Result<Arc<Shown>, DashboardError> {
        self.look();
        let found = self.state().runs.get(id).cloned();
        found.ok_or_else(|| DashboardError::UnknownRun { id: id.escape_debug().take(200).collect() })
    }

    /// All runs in short, as JSON; for many viewers, made once a second. Blocks.
    pub fn list(&self) -> Arc<str> {
        self.look();
        let begun = Instant::now();
        if let Some((at, list)) = &self.state().list
            && begun.duration_since(*at) < LISTED
        {
            return Arc::clone(list);
        }
        let runs: Vec<Arc<Shown>> = self.state().runs.values().cloned().collect();
        let list: Vec<Value> = runs.iter().map(|shown| shown.run()).collect();
        let list: Arc<str> = json!(list).to_string().into();
        self.state().list = Some((begun, Arc::clone(&list)));
        list
    }

    /// The errors of all descriptors by the values of two genes, from a grid of a run's search space and clouds. Blocks.
    ///
    /// # Errors
    /// [`DashboardError::NoLandscape`] if there is no such grid.
    pub fn landscape(&self, id: &str, a: &str, b: &str) -> Result<Value, DashboardError> {
        let run = self.run(id)?;
        let experiment = run.experiment()?;
        let grids: Vec<Arc<Shown>> = self.state().runs.values().cloned().collect();
        for grid in grids.iter().filter(|shown| shown.found().kind == Kind::Grid) {
            let Found { folder, .. } = grid.found();
            if is_landscape_of(folder, &experiment, run.train_queries())
                && let Some(landscape) = super::detail::landscape(folder, a, b)?
            {
                return Ok(landscape);
            }
        }
        Err(DashboardError::NoLandscape { run: id.to_owned() })
    }

    /// Where they are looked for.
    pub fn roots(&self) -> Value {
        let roots: Vec<String> = self.roots.iter().map(|root| root.display().to_string()).collect();
        json!(roots.join(", "))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        lock(&self.state)
    }
}
