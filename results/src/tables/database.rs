//! Rows of an artefact's database.

use crate::record::record;

record! {
    /// What a reference cloud shows.
    pub(crate) struct CloudCells {
        cloud: String, "", "path below the data root";
        instance: String, "", "the cloud's object";
        category: String, "", "the cloud's category";
        sequence: Option<String>, "", "the cloud's sequence; null if it is not known";
        addition: Option<u32>, "", "which call of coordinator learn has added it, from 1; null of the run's own";
    }
}

record! {
    /// A reference cloud and its summaries.
    pub(crate) struct DatabaseRow {
        cloud as "": CloudCells, "", "what it shows";
        shape_centroid: Vec<f32>, "share",
            "mean of the keypoints' shape histograms: the bins of the disk up to 180 degrees, then those of the ring";
        shape_deviation: Vec<f32>, "share", "their standard deviation (N - 1), bin by bin";
        colour_centroid: Vec<f32>, "share",
            "mean of the keypoints' colour histograms: the m x m bins of the disk (hue by hue), then those of the ring; empty without colour";
        colour_deviation: Vec<f32>, "share", "their standard deviation (N - 1), bin by bin";
    }
}

record! {
    /// A part of a reference cloud's summary.
    pub(crate) struct PartCells {
        centroid: Vec<f32>, "share", "mean of {of}, value by value; null where the descriptor has no such channel";
        deviation: Vec<f32>, "share",
            "their standard deviation (N - 1); empty in a channel of one row a cloud, null as {prefix}centroid";
    }
}

record! {
    /// A reference cloud and its summaries, channel by channel.
    pub(crate) struct ChannelsRow {
        cloud as "": CloudCells, "", "what it shows";
        channel_1 as "channel_1_": Option<PartCells>, "", "the rows of channel 1";
        channel_2 as "channel_2_": Option<PartCells>, "", "the rows of channel 2";
        channel_3 as "channel_3_": Option<PartCells>, "", "the rows of channel 3";
        channel_4 as "channel_4_": Option<PartCells>, "", "the rows of channel 4";
        channel_5 as "channel_5_": Option<PartCells>, "", "the rows of channel 5";
        channel_6 as "channel_6_": Option<PartCells>, "", "the rows of channel 6";
        channel_7 as "channel_7_": Option<PartCells>, "", "the rows of channel 7";
        channel_8 as "channel_8_": Option<PartCells>, "", "the rows of channel 8";
    }
}

impl ChannelsRow {
    /// With the first channels, so many as there are.
    pub(crate) fn new(cloud: CloudCells, mut channels: impl Iterator<Item = PartCells>) -> Self {
        Self {
            cloud,
            channel_1: channels.next(),
            channel_2: channels.next(),
            channel_3: channels.next(),
            channel_4: channels.next(),
            channel_5: channels.next(),
            channel_6: channels.next(),
            channel_7: channels.next(),
            channel_8: channels.next(),
        }
    }
}
