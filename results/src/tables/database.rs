//! Rows of an artefact's database.

use crate::record::record;

record! {
    /// What a reference cloud shows.
    #[derive(Clone, Debug, PartialEq, Eq)]
    pub struct DatabaseCloud {
        cloud: String, "", "path below the data root";
        instance: String, "", "the cloud's object";
        category: String, "", "the cloud's category";
    }
}

record! {
    /// A reference cloud and its summaries.
    pub(crate) struct DatabaseRow {
        cloud as "": DatabaseCloud, "", "what it shows";
        shape_centroid: Vec<f32>, "share",
            "mean of the keypoints' shape histograms: the bins of the disk up to 180 degrees, then those of the ring";
        shape_deviation: Vec<f32>, "share", "their standard deviation (N - 1), bin by bin";
        colour_centroid: Vec<f32>, "share",
            "mean of the keypoints' colour histograms: the m x m bins of the disk (hue by hue), then those of the ring; empty without colour";
        colour_deviation: Vec<f32>, "share", "their standard deviation (N - 1), bin by bin";
    }
}
