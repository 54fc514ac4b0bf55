//! How far numbers can be trusted: intervals, tests of differences, corrections for many of them.

mod bootstrap;
mod error_rate;
mod holm;
mod mcnemar;
mod rank_sum;
mod tango;
mod wilson;

pub use bootstrap::{Cluster, bootstrap};
pub use error_rate::ErrorRate;
pub use holm::holm;
pub use mcnemar::mcnemar;
pub use rank_sum::{RankSum, rank_sum};
pub use tango::tango;
pub use wilson::wilson;
