//! A channel made ready to be computed: limits squared, edges of bins found, features sorted by what they are made of.

use crate::disk_ring::quantise::squared_metres;
use crate::neighbours::floor_f32;
use crate::structure::channel::{Axis, Pairs, StructureChannel};
use crate::structure::edges::{Turns, ceil_f32, edges};
use crate::structure::feature::Feature;
use crate::structure::sampling::Draws;
use crate::structure::value_order::{Column, PointAxis, ValueOrder};

/// How the pairs of one channel are found and binned; made once for all clouds.
#[derive(Clone, Debug, PartialEq)]
pub struct StructurePlan {
    pub(super) channel: StructureChannel,
    /// Smallest and largest d² of a pair that counts, square metres.
    pub(super) least2: f32,
    pub(super) most2: f32,
    /// Largest d² in each shell but the last.
    pub(super) shells2: Vec<f32>,
    /// Largest d² of a keypoint's neighbour.
    pub(super) reach2: f32,
    /// Values of a row.
    pub(super) bins: usize,
    /// Values of one shell.
    pub(super) shell_bins: u32,
    /// Values of a shell's first histogram.
    pub(super) histogram_bins: u32,
    /// One of all axes, or one of each.
    pub(super) histograms: Vec<Histogram>,
    /// What is computed of each point's colour beforehand.
    pub(super) columns: Vec<Column>,
    /// How the values of a point are ordered.
    pub(super) order: ValueOrder,
    /// Which pairs are drawn.
    pub(super) draws: Draws,
    /// Whether a feature is made of the normals, and whether of their frame.
    pub(super) has_angles: bool,
    pub(super) has_frame: bool,
}

/// Bins of some axes, of which each combination is counted.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Histogram {
    /// Where it begins in a shell.
    pub(super) first: u32,
    /// The column of what the second point adds to the code, if it adds anything.
    pub(super) code: Option<usize>,
    /// Axes of the pair.
    pub(super) axes: Vec<PairAxis>,
}

/// A feature of both points.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct PairAxis {
    pub(super) bins: PairBins,
    /// By how much the code grows from bin to bin.
    pub(super) stride: u32,
}

/// How the bin of a pair is found.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum PairBins {
    /// ⌊√d² · per_metre⌋, at most `last`.
    Distance { per_metre: f32, last: f32 },
    /// Of the first angle of the Darboux frame.
    Turn(Turns),
    /// The number of edges that a value has reached.
    Edges(Measure, Vec<f32>),
}

/// A value of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Measure {
    /// The negative cosine of the angle between the normals.
    Angle,
    F2,
    F3,
    /// −f2 and −f3, the negative cosines of a2 and a3.
    A2,
    A3,
    /// A column of the second point minus that of the first.
    Difference(usize),
    /// A column of the first point over that of the second, as PCL divides colours.
    Ratio(usize),
}

impl StructurePlan {
    /// The plan of a channel.
    ///
    /// # Panics
    /// If the channel has more than [`StructureChannel::MAX_AXES`] axes, or more bins than fit 31 bits: a programming
    /// error.
    pub fn new(channel: &StructureChannel) -> Self {
        assert!(channel.axes.len() <= StructureChannel::MAX_AXES, "a channel of {} axes", channel.axes.len());
        assert!(channel.bins() <= u64::from(u32::MAX / 2), "a channel of {} bins", channel.bins());
        let last_um = channel.shells_um.last().copied().unwrap_or_default();
        let within = |um: u32| floor_f32(squared_metres(um));
        let (inner, _) = channel.shells_um.split_at(channel.shells_um.len().saturating_sub(1));
        let bins = channel.bins() as usize;
        let mut plan = Self {
            least2: ceil_f32(squared_metres(channel.least_um)),
            most2: within(last_um.min(channel.longest_um())),
            shells2: inner.iter().map(|&um| within(um)).collect(),
            reach2: within(channel.radius_um),
            bins,
            shell_bins: (bins / channel.shells_um.len().max(1)) as u32,
            histogram_bins: 0,
            histograms: Vec::new(),
            columns: Vec::new(),
            order: ValueOrder::default(),
            draws: Draws::new(if channel.pairs.is_sampled() { channel.samples } else { 0 }),
            has_angles: channel.axes.iter().any(|axis| axis.feature.needs_normals()),
            has_frame: channel.axes.iter().any(|axis| axis.feature.needs_frame()),
            channel: channel.clone(),
        };
        let together = if channel.is_joint { channel.axes.len() } else { 1 };
        let mut first = 0;
        for axes in channel.axes.chunks(together.max(1)) {
            plan.add_histogram(first, axes);
            let bins = axes.iter().map(Axis::kept_bins).product::<u32>();
            plan.histogram_bins = if first == 0 { bins } else { plan.histogram_bins };
            first += bins;
        }
        plan.order = ValueOrder::new(&plan.columns, plan.has_angles);
        plan
    }

    /// Adds a histogram of axes, of which the first has the largest stride.
    fn add_histogram(&mut self, first: u32, axes: &[Axis]) {
        let mut stride = axes.iter().map(Axis::kept_bins).product::<u32>();
        let (mut of_point, mut of_pair) = (Vec::new(), Vec::new());
        for axis in axes {
            stride /= axis.kept_bins();
            match self.pair_bins(axis) {
                Some(bins) => of_pair.push(PairAxis { bins, stride }),
                None => {
                    let edges = edges(axis, self.channel.squash_milli);
                    of_point.push(PointAxis { feature: axis.feature, edges, stride });
                }
            }
        }
        let code = (!of_point.is_empty()).then(|| self.add_column(Column::Code(of_point)));
        self.histograms.push(Histogram { first, code, axes: of_pair });
    }

    fn add_column(&mut self, column: Column) -> usize {
        self.columns.push(column);
        self.columns.len() - 1
    }

    /// How a pair is binned; `None` of features of the second point alone.
    fn pair_bins(&mut self, axis: &Axis) -> Option<PairBins> {
        let feature = axis.feature;
        let measure = match feature {
            Feature::Distance => {
                let longest = f64::from(self.channel.longest_um()) / 1e6;
                let per_metre = (f64::from(axis.bins) / longest) as f32;
                return Some(PairBins::Distance { per_metre, last: (axis.bins - 1) as f32 });
            }
            Feature::F1 => return Some(PairBins::Turn(Turns::new(axis.bins))),
            Feature::Angle => Measure::Angle,
            Feature::F2 => Measure::F2,
            Feature::F3 => Measure::F3,
            Feature::A2 => Measure::A2,
            Feature::A3 => Measure::A3,
            Feature::LogRed | Feature::LogGreen | Feature::LogBlue | Feature::O1 | Feature::O2 => {
                Measure::Difference(self.add_column(Column::Difference(feature)))
            }
            Feature::RatioRed | Feature::RatioGreen | Feature::RatioBlue => {
                Measure::Ratio(self.add_column(Column::Ratio(feature)))
            }
            Feature::Hue
            | Feature::Saturation
            | Feature::Value
            | Feature::C1
            | Feature::C2
            | Feature::W1
            | Feature::W2
            | Feature::L
            | Feature::A
            | Feature::B => return None,
        };
        Some(PairBins::Edges(measure, edges(axis, self.channel.squash_milli)))
    }

    /// Whether the grey world's mean is part of a feature.
    pub(super) fn needs_mean(&self) -> bool {
        self.channel.axes.iter().any(|axis| matches!(axis.feature, Feature::W1 | Feature::W2))
    }

    /// Whether pairs are drawn instead of all being taken, among so many points.
    pub(super) fn draws(&self, points: usize) -> bool {
        let pairs = points as u64 * (points as u64).saturating_sub(1);
        self.channel.pairs.is_sampled() && self.channel.samples > 0 && pairs > u64::from(self.channel.samples)
    }

    /// Whether the channel takes only points that have a normal.
    pub(crate) fn needs_normals(&self) -> bool {
        self.channel.needs_normals()
    }

    /// Whether there is one row for the whole cloud.
    pub(super) fn is_of_cloud(&self) -> bool {
        self.channel.pairs == Pairs::Cloud
    }
}
