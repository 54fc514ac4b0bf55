//! The front of a finished run: its points as descriptors.

use std::path::{Path, PathBuf};

use descriptor::{Descriptor, SearchSpace};

/// Why there is no such point.
#[derive(Debug, thiserror::Error)]
pub enum FrontError {
    /// The table.
    #[error(transparent)]
    Results(#[from] results::Error),
    /// The search had one objective.
    #[error(
        "{run}: must be a run with a front, got one of a single objective\nname a run of search.method = \"nsga2\"",
        run = .0.display()
    )]
    NoFront(PathBuf),
    /// The front is shorter.
    #[error("{run}: point must be 1 to {points}, got {got}\ntable front lists them", run = .run.display())]
    NoPoint {
        /// The run.
        run: PathBuf,
        /// Points of its front.
        points: usize,
        /// What was asked for.
        got: u32,
    },
    /// The genes are not this program's.
    #[error("{run}: genes of point {point}: must lie on the genes' grids\nlook whether the run is sound: coordinator verify", run = .run.display())]
    Genes {
        /// The run.
        run: PathBuf,
        /// Which point.
        point: u32,
    },
}

/// Point `point`, from 1, of the front of the run in a folder.
///
/// # Errors
/// If there is none.
pub fn point(run: &Path, space: &SearchSpace, point: u32) -> Result<Descriptor, FrontError> {
    let front = results::read_front(run)?;
    if front.is_empty() {
        return Err(FrontError::NoFront(run.to_owned()));
    }
    let Some(row) = front.iter().find(|row| row.point == point) else {
        return Err(FrontError::NoPoint { run: run.to_owned(), points: front.len(), got: point });
    };
    space.from_values(&row.genes).ok_or_else(|| FrontError::Genes { run: run.to_owned(), point })
}
