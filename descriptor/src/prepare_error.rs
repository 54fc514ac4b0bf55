//! Why a cloud cannot be prepared.

/// Why a cloud takes no part in an evaluation, neither as query nor in the database (DESIGN 5.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum Skip {
    /// Not enough points.
    #[error("fewer than {least} usable points, got {points}")]
    TooFewPoints { least: u32, points: usize },
    /// No keypoint has enough neighbours for a normal.
    #[error("no keypoint with a normal, got {keypoints} keypoints")]
    NoKeypointWithNormal { keypoints: usize },
}

/// Why a cloud could not be prepared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PrepareError {
    /// The cloud is sound but of no use.
    #[error(transparent)]
    Skip(#[from] Skip),
    /// Colour is wanted and the cloud has none.
    #[error(
        "cloud: must have colours, got none\nuse clouds with an rgb field, or a descriptor of shape alone (descriptor.colour = false in an experiment, evaluate --no-colour)"
    )]
    NoColours,
    /// There is not one colour for each point.
    #[error(
        "cloud: number of colours differs from the {points} points, got {colours}\ngive every point a colour"
    )]
    ColourCount { points: usize, colours: usize },
    /// A voxel's index does not fit 32 bits.
    #[error(
        "cloud: coordinate beyond 2147483648 voxels of {leaf} m, got {coordinate} m\ncheck the unit of the clouds or choose a larger leaf"
    )]
    CellRange { coordinate: f32, leaf: f32 },
    /// Finding the neighbours of all points would take minutes, or hours.
    #[error(
        "cloud: at most {most} pairs of points in the same cells of {radius} m or more expected, got {pairs}, and {points} points in one cell\nremove points that are all alike (invalid ones at the origin) and outliers far away, thin it out, or choose a smaller preprocess.normal_radius_cm"
    )]
    TooDense { most: u64, radius: f64, pairs: u64, points: u32 },
    /// Counting all pairs of the regions about keypoints would take minutes, or hours.
    #[error(
        "cloud: at most {most} pairs of points in all regions expected, got {pairs} in those of {keypoints} keypoints\nthin it out, choose a smaller radius, or a descriptor that samples pairs"
    )]
    TooManyPairs { most: u64, pairs: u64, keypoints: usize },
    /// Describing all keypoints would take gigabytes.
    #[error(
        "cloud: at most {most} keypoints expected, got {keypoints} with a grid of {leaf} m\ncut out the object, or choose a larger leaf or grid"
    )]
    TooManyKeypoints { most: usize, keypoints: usize, leaf: f32 },
    /// Looking for the neighbours of all keypoints, or counting them, would take minutes.
    #[error(
        "cloud: at most {most} neighbours of all keypoints expected, got more of {points} points about {keypoints} keypoints\nthin it out, or choose smaller radii or a larger leaf"
    )]
    TooManyNeighbours { most: u64, points: usize, keypoints: usize },
    /// Points cannot be counted in 32 bits.
    #[error("cloud: more than 4294967295 points, got {points}\nsplit the cloud")]
    TooManyPoints { points: usize },
}
