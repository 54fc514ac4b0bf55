//! Signatures of clouds: the pairs of each row, found and counted.

use pulp::{NullaryFnOnce, Scalar512b, Simd, WithSimd};

use crate::prepare::check_regions;
use crate::prepare_error::PrepareError;
use crate::signature::{MeanAndDeviation, Signature};
use crate::structure::block::{BLOCK, LANES};
use crate::structure::channel::{Pairs, StructureChannel};
use crate::structure::cloud::StructureCloud;
use crate::structure::colours::mean_opponents;
use crate::structure::counts::Counts;
use crate::structure::group::Group;
use crate::structure::pairs::{OfGroups, WithBlock, count};
use crate::structure::plan::StructurePlan;
use crate::structure::quads::Quads;
use crate::structure::table::Table;
use crate::wide::widest;

impl StructureChannel {
    /// A cloud in this channel; for many clouds, make a [`StructurePlan`] once.
    ///
    /// # Errors
    /// As [`StructurePlan::signature`].
    pub fn signature(&self, cloud: &StructureCloud) -> Result<Signature, PrepareError> {
        StructurePlan::new(self).signature(cloud)
    }
}

impl StructurePlan {
    /// A cloud in this channel: centroid and deviation of its rows, zeros if it has none; of `Cloud` the only row, and no
    /// deviation. Each value times its weight, if the channel has any.
    ///
    /// # Errors
    /// [`PrepareError::NoColours`] if the channel needs colours that the cloud does not have,
    /// [`PrepareError::CellRange`] if a cell of a grid that is not kept cannot be counted, and
    /// [`PrepareError::TooManyPairs`] if the channel takes all pairs and they are too many.
    pub fn signature(&self, cloud: &StructureCloud) -> Result<Signature, PrepareError> {
        if self.bins == 0 {
            return Ok(Signature::default());
        }
        let rows = self.prepare(cloud)?;
        Ok(self.channel.weighted(widest(Describe { plan: self, rows })))
    }

    /// Finds what the rows of a cloud are made of.
    pub(super) fn prepare(&self, cloud: &StructureCloud) -> Result<Rows, PrepareError> {
        let colours = cloud.points.colours.as_deref().unwrap_or_default();
        let mean = if self.needs_mean() { mean_opponents(colours) } else { [0; 2] };
        let keypoints = if self.is_of_cloud() {
            Table::default()
        } else {
            let normals_only = self.channel.needs_normals_of_keypoints();
            Table::new(self, &*cloud.keypoints(self)?, normals_only, mean)?
        };
        let points = if self.channel.pairs == Pairs::Keypoints {
            Table::default()
        } else {
            Table::new(self, &cloud.points, self.needs_normals(), mean)?
        };
        let rows = Rows { keypoints, points };
        if self.channel.pairs.is_sampled() && self.channel.samples == 0 {
            self.check_pairs(&rows)?;
        }
        Ok(rows)
    }

    /// Refuses rows whose pairs, of which none is left out, would take minutes to count.
    fn check_pairs(&self, rows: &Rows) -> Result<(), PrepareError> {
        let Rows { keypoints, points } = rows;
        let (mut blocks, mut near) = (Vec::new(), Vec::new());
        // Without wide vectors: it is asked only of channels that take all pairs.
        check_regions(points.points, rows.len(self), |row| {
            if self.is_of_cloud() {
                return points.points;
            }
            let centre = keypoints.position(row);
            points.blocks_within(Scalar512b, centre, self.reach2, &mut blocks);
            points.points_within(Scalar512b, centre, self.reach2, &blocks, &mut near);
            near.len()
        })
    }
}

/// What the rows of a cloud are made of.
pub(super) struct Rows {
    /// None of `Cloud`.
    keypoints: Table,
    /// None of `Keypoints`.
    points: Table,
}

impl Rows {
    /// Number of rows.
    pub(super) fn len(&self, plan: &StructurePlan) -> usize {
        if plan.is_of_cloud() { 1 } else { self.keypoints.points }
    }
}

/// Counts the pairs of rows.
pub(super) struct Counter<'a> {
    plan: &'a StructurePlan,
    rows: &'a Rows,
    /// The values of the first point of pairs.
    one: Vec<f32>,
    first: Group,
    second: Group,
    /// The second minus the first.
    apart: Group,
    blocks: Vec<u32>,
    near: Vec<u32>,
    /// The values of the near points.
    of_near: Quads,
    /// Those of the row that was counted last.
    pub(super) counts: Counts,
}

impl<'a> Counter<'a> {
    pub(super) fn new(plan: &'a StructurePlan, rows: &'a Rows) -> Self {
        let [first, second, apart] = [Group::EMPTY; 3];
        let (one, blocks, near, of_near) = Default::default();
        Self { plan, rows, one, first, second, apart, blocks, near, of_near, counts: Counts::new(plan.bins) }
    }

    /// Counts a row.
    #[inline(always)]
    pub(super) fn count<S: Simd>(&mut self, simd: S, row: usize) {
        let Self { plan, rows: Rows { keypoints, points }, .. } = *self;
        let is_among = plan.channel.pairs != Pairs::KeypointNeighbour;
        if plan.channel.pairs.is_sampled() {
            self.find_near(simd, row);
            if plan.draws(self.near.len()) {
                return self.draw(simd, points);
            }
        }
        let near;
        let (points, of_row, others) = match plan.channel.pairs {
            Pairs::KeypointNeighbour => (keypoints, row..row + 1, points),
            Pairs::Keypoints => (keypoints, row..row + 1, keypoints),
            Pairs::Neighbours | Pairs::Cloud => {
                near = points.gather(plan, &self.near);
                (&near, 0..near.points, &near)
            }
        };
        for point in of_row {
            self.about(simd, points, point, others, is_among);
        }
    }

    /// Finds the points whose pairs are a row's.
    #[inline(always)]
    fn find_near<S: Simd>(&mut self, simd: S, row: usize) {
        let Self { plan, rows: Rows { keypoints, points }, blocks, near, .. } = self;
        if plan.is_of_cloud() {
            near.clear();
            near.extend(0..points.points as u32);
        } else {
            let centre = keypoints.position(row);
            points.blocks_within(simd, centre, plan.reach2, blocks);
            points.points_within(simd, centre, plan.reach2, blocks, near);
        }
    }

    /// Counts the pairs of a point with all others within reach; but itself, if it is one of them.
    #[inline(always)]
    fn about<S: Simd>(&mut self, simd: S, points: &Table, point: usize, others: &Table, is_among: bool) {
        let Self { plan, one, blocks, counts, .. } = self;
        one.clear();
        one.extend(points.values_of(point));
        others.blocks_within(simd, points.position(point), plan.most2, blocks);
        for &block in &*blocks {
            let block = block as usize;
            let mut x = *others.block(0, block);
            if is_among && block == point / BLOCK {
                x[point % BLOCK] = f32::NAN;
            }
            for vector in 0..BLOCK / S::F32_LANES {
                let pairs = WithBlock { first: one, points: others, block, x: &x, vector };
                count(simd, plan, &pairs, counts);
            }
        }
    }

    /// Counts the ordered pairs that are drawn among the near points.
    #[inline(always)]
    fn draw<S: Simd>(&mut self, simd: S, points: &Table) {
        let plan = self.plan;
        let Self { first, second, apart, near, of_near, counts, .. } = self;
        let is_all = plan.is_of_cloud();
        // Few points are copied together first: each is drawn several times.
        let are_copied = !is_all && near.len() < 2 * plan.channel.samples as usize;
        if are_copied {
            of_near.take(plan.order.values, &points.quads, near);
        }
        let quads = if are_copied { &*of_near } else { &points.quads };
        for group in 0..plan.draws.groups() {
            let (mut drawn, is_pair) = plan.draws.group(group, near.len() as u32);
            if !is_all && !are_copied {
                for index in drawn.as_flattened_mut() {
                    *index = near[*index as usize];
                }
            }
            let order = &plan.order;
            apart.gather_differences(second, order, quads, &drawn);
            first.gather(order.of_both.clone(), quads, &drawn[0]);
            second.gather(order.of_both.start..order.values, quads, &drawn[1]);
            for (x, is_pair) in apart.values[0].iter_mut().zip(is_pair) {
                *x = if is_pair { *x } else { f32::NAN };
            }
            for vector in 0..LANES / S::F32_LANES {
                count(simd, plan, &OfGroups { first, second, apart, vector }, counts);
            }
        }
    }
}

/// The kernel of [`StructurePlan::signature`].
struct Describe<'a> {
    plan: &'a StructurePlan,
    rows: Rows,
}

impl WithSimd for Describe<'_> {
    type Output = Signature;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Signature {
        let plan = self.plan;
        let width = plan.bins;
        let [shell_bins, histogram_bins] = [plan.shell_bins, plan.histogram_bins].map(|bins| bins as usize);
        let mut rows = Vec::new();
        let mut counter = Counter::new(plan, &self.rows);
        for row in 0..self.rows.len(plan) {
            counter.count(simd, row);
            counter.counts.take_shares(shell_bins, histogram_bins, &mut rows);
        }
        if plan.is_of_cloud() {
            return Signature { centroid: rows, deviation: Vec::new() };
        }
        if rows.is_empty() {
            return Signature { centroid: vec![0.0; width], deviation: vec![0.0; width] };
        }
        MeanAndDeviation { rows: &rows, width }.call()
    }
}
