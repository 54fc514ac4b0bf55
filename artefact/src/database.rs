//! The database of an artefact: what reference clouds show, and the summaries of them.

/// What a reference cloud shows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DatabaseCloud {
    /// Path below the data root.
    pub cloud: String,
    /// The cloud's object.
    pub instance: String,
    /// The cloud's category.
    pub category: String,
    /// The cloud's sequence; `None` if it is not known.
    pub sequence: Option<String>,
    /// Which call of coordinator learn has added it, from 1; `None` of the run's own.
    pub addition: Option<u32>,
}

/// One part of the descriptor of all reference clouds: shares, cloud after cloud, equally many of each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DatabasePart {
    /// Means over the rows, value by value; of a channel whose values have weights, times these, as are deviations.
    pub centroids: Vec<f32>,
    /// Standard deviations over the rows, value by value; none in a part that has one row a cloud.
    pub deviations: Vec<f32>,
}

/// The parts of a descriptor; which they are decides on the table.
#[derive(Clone, Debug, PartialEq)]
pub enum DatabaseParts {
    /// Shape and colour, the latter without values where the descriptor has none: table `database`.
    ShapeColour([DatabasePart; 2]),
    /// Channels, at most [`MAX_CHANNELS`]: table `channels`.
    Channels(Vec<DatabasePart>),
}

/// Most channels that a database has columns for.
pub const MAX_CHANNELS: usize = 8;

/// The reference clouds of an artefact.
#[derive(Clone, Debug, PartialEq)]
pub struct Database {
    /// What they show. The first of equally near clouds counts.
    pub clouds: Vec<DatabaseCloud>,
    /// Their summaries.
    pub parts: DatabaseParts,
}

impl DatabaseParts {
    /// Part by part.
    pub fn as_slice(&self) -> &[DatabasePart] {
        match self {
            Self::ShapeColour(parts) => parts,
            Self::Channels(channels) => channels,
        }
    }

    /// Part by part, to be changed.
    pub fn as_mut_slice(&mut self) -> &mut [DatabasePart] {
        match self {
            Self::ShapeColour(parts) => parts,
            Self::Channels(channels) => channels,
        }
    }

    /// What the columns of a part begin with.
    pub fn name(&self, part: usize) -> String {
        match (self, part) {
            (Self::Channels(_), _) => format!("channel_{}", part + 1),
            (_, 0) => "shape".to_owned(),
            (..) => "colour".to_owned(),
        }
    }
}
