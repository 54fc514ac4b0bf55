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
        "cloud: no colours where colour is wanted\nuse clouds with an rgb field, or do without colour (descriptor.colour = false, --no-colour)"
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
    /// Points cannot be counted in 32 bits.
    #[error("cloud: more than 4294967295 points, got {points}\nsplit the cloud")]
    TooManyPoints { points: usize },
}
