//! What a report shows of a run that the run's tables do not say.

use super::figures::channels::WinnerChannel;
use super::figures::on_cloud::SeenCloud;
use super::wrong::WrongClouds;

/// What is known of a run that its tables do not say.
#[derive(Clone, Debug, Default)]
pub struct Told {
    /// The channels of its winner, if that is a structure, which tables have as codes.
    pub channels: Vec<WinnerChannel>,
    /// Where its winner looks on one of its training clouds.
    pub seen: Option<SeenCloud>,
    /// Why there is no such cloud, where that needs to be said.
    pub not_seen: Option<String>,
    /// How its winner compares with other descriptors, in sentences, the most important one first.
    pub verdict: Vec<String>,
    /// Test clouds that its winner took for others, those first that are furthest from right.
    pub wrong: Vec<WrongClouds>,
    /// Why there are no such clouds to see, where that needs to be said.
    pub no_clouds: Option<String>,
}
