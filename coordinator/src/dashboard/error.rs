//! Why a dashboard cannot answer.

use axum::http::StatusCode;

use crate::control::ControlError;
use crate::examine::ExamineError;
use crate::reopen::WinnerError;

/// Why a dashboard cannot answer.
#[derive(Debug, thiserror::Error)]
pub enum DashboardError {
    /// No run has this id.
    #[error("{id}: no run of this name\nlook at the list of runs")]
    UnknownRun {
        /// What was asked for.
        id: String,
    },
    /// A parameter of the address.
    #[error("{name}: {expected} expected, got {got}\ncorrect the address")]
    Parameter {
        /// Its name.
        name: &'static str,
        /// What it must be.
        expected: &'static str,
        /// What it is.
        got: String,
    },
    /// There are no such answers.
    #[error(
        "{run}: no answers of {of}\nthey are there when the run has finished; coordinator compare adds those of other descriptors"
    )]
    NoAnswers {
        /// The run.
        run: String,
        /// What was asked for.
        of: String,
    },
    /// What the run was started with is not known.
    #[error("{run}: the experiment cannot be read\nuse the release that made the run")]
    NoExperiment {
        /// The run.
        run: String,
    },
    /// A compared descriptor whose channels cannot be known.
    #[error(
        "{descriptor}: its channels cannot be known: {reason}\nlook at the winner's, for the same two clouds, under Descriptor"
    )]
    NoChannels {
        /// Its name in the comparison.
        descriptor: String,
        /// Why.
        reason: &'static str,
    },
    /// There is no such individual.
    #[error("{run}: no such individual\nwait for the first generation, or take one of the population")]
    NoIndividual {
        /// The run.
        run: String,
    },
    /// The winner cannot be known.
    #[error("{run}: {source}\nlook whether the run is sound: coordinator verify")]
    Winner {
        /// The run.
        run: String,
        /// What is wrong with it.
        source: WinnerError,
    },
    /// No grid of the same search space is among the folders.
    #[error(
        "{run}: no landscape of these genes is known\ncoordinator exhaust finds it; show its folder, too"
    )]
    NoLandscape {
        /// The run.
        run: String,
    },
    /// Nobody sees test clouds before the search ends.
    #[error("{path}: a test cloud, and the search has not ended\nwait for the end of the run")]
    Hidden {
        /// The cloud.
        path: String,
    },
    /// A body that is no order.
    #[error(
        "order: an action with a reason expected, got {got}\nreload the page: the program may be another"
    )]
    Order {
        /// What is wrong with it.
        got: String,
    },
    /// An order that was not carried out.
    #[error(transparent)]
    Control(#[from] ControlError),
    /// The run folder.
    #[error(transparent)]
    Results(#[from] results::Error),
    /// The clouds.
    #[error(transparent)]
    Examine(#[from] ExamineError),
}

impl DashboardError {
    /// The status that goes with it.
    pub fn status(&self) -> StatusCode {
        match self {
            Self::Parameter { .. } | Self::Order { .. } => StatusCode::BAD_REQUEST,
            Self::Hidden { .. } => StatusCode::FORBIDDEN,
            Self::Control(_) | Self::Results(results::Error::InUse(_)) => StatusCode::CONFLICT,
            Self::Results(_) => StatusCode::INTERNAL_SERVER_ERROR,
            _ => StatusCode::NOT_FOUND,
        }
    }
}
