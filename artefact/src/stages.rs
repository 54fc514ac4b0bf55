//! The stages of a cloud on its way to signatures, and the time that each takes.

use std::ops::AddAssign;
use std::time::{Duration, Instant};

use descriptor::prepare::keypoints;
use descriptor::{Cloud, DescribeError, Described, Describer, Preprocess};

/// Time of each stage, added up over clouds and threads; `total` is wall time from the first cloud to the last
/// match of one set distance.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seconds {
    /// Reading and decoding files.
    pub read: Duration,
    /// Keypoints.
    pub keypoints: Duration,
    /// Normals of clouds and keypoints, if the descriptor looks at them, else whether they could be fitted. Those of keypoints
    /// of a structure's own grids belong to the description.
    pub normals: Duration,
    /// Neighbours, histograms and signatures.
    pub describe: Duration,
    /// Distances and nearest clouds.
    pub matching: Duration,
    /// Wall time of everything.
    pub total: Duration,
}

impl AddAssign for Seconds {
    fn add_assign(&mut self, other: Self) {
        self.read += other.read;
        self.keypoints += other.keypoints;
        self.normals += other.normals;
        self.describe += other.describe;
        self.matching += other.matching;
        self.total += other.total;
    }
}

/// The stages of a cloud in metres, each timed: keypoints, the normals that the descriptor needs, and its description.
pub fn stages(
    cloud: &Cloud,
    preprocess: &Preprocess,
    describer: &Describer,
    seconds: &mut Seconds,
) -> Result<Described, DescribeError> {
    let clock = Instant::now();
    let keypoints = keypoints(cloud, preprocess)?;
    seconds.keypoints = clock.elapsed();
    let clock = Instant::now();
    let normals = describer.normals(cloud, &keypoints, preprocess)?;
    seconds.normals = clock.elapsed();
    let clock = Instant::now();
    let described = describer.describe(cloud, &keypoints, &normals, preprocess)?;
    seconds.describe = clock.elapsed();
    Ok(described)
}
