//! How far numbers can be trusted: intervals, tests of differences, corrections for many of them.

mod bootstrap;
mod holm;
mod mcnemar;
mod wilson;

pub use bootstrap::{Cluster, bootstrap};
pub use holm::holm;
pub use mcnemar::mcnemar;
pub use wilson::wilson;
