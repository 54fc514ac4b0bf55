//! What recognisers that learn are set to.

use std::fmt;

use super::{KernelRidgeSettings, Method, ProjectionSettings, Reference};

/// What a recogniser that learns is set to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Settings {
    /// Of a projection.
    Projection(ProjectionSettings),
    /// Of kernel ridge regression.
    KernelRidge(KernelRidgeSettings),
}

impl Settings {
    /// Whose settings they are.
    pub fn method(&self) -> Method {
        match self {
            Self::Projection(_) => Method::Projection,
            Self::KernelRidge(_) => Method::KernelRidge,
        }
    }
}

impl fmt::Display for Settings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Projection(ProjectionSettings { components, shrinkage, reference }) => {
                let reference = match reference {
                    Reference::Cloud => "cloud",
                    Reference::Object => "object",
                };
                write!(f, "{components} components, shrinkage {shrinkage}, nearest {reference}")
            }
            Self::KernelRidge(KernelRidgeSettings { width, ridge }) => {
                write!(f, "kernel width {width}, ridge {ridge}")
            }
        }
    }
}
