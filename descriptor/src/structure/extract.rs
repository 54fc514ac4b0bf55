//! Signatures of clouds: the pairs of each row, found and counted.

use pulp::NullaryFnOnce;

use crate::prepare_error::PrepareError;
use crate::signature::{MeanAndDeviation, Signature};
use crate::structure::channel::{Pairs, StructureChannel};
use crate::structure::cloud::StructureCloud;
use crate::structure::colours::mean_opponents;
use crate::structure::counts::Counts;
use crate::structure::lanes::{Group, Groups, LANES};
use crate::structure::pairs::count;
use crate::structure::plan::StructurePlan;
use crate::structure::sampling::draw;
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
    /// deviation.
    ///
    /// # Errors
    /// [`PrepareError::NoColours`] if the channel needs colours that the cloud does not have, and
    /// [`PrepareError::CellRange`] if a cell of a grid that is not kept cannot be counted.
    pub fn signature(&self, cloud: &StructureCloud) -> Result<Signature, PrepareError> {
        if self.bins == 0 {
            return Ok(Signature::default());
        }
        let rows = self.prepare(cloud)?;
        Ok(widest(Describe { plan: self, rows }))
    }

    /// Finds what the rows of a cloud are made of.
    pub(super) fn prepare(&self, cloud: &StructureCloud) -> Result<Rows, PrepareError> {
        let colours = cloud.points.colours.as_deref().unwrap_or_default();
        let mean = if self.needs_mean() { mean_opponents(colours) } else { [0; 2] };
        let keypoints = if self.is_of_cloud() {
            Groups::default()
        } else {
            Groups::new(self, &*cloud.keypoints(self.channel.grid_um)?, mean)?
        };
        let points = if self.channel.pairs == Pairs::Keypoints {
            Groups::default()
        } else {
            Groups::new(self, &cloud.points, mean)?
        };
        Ok(Rows { keypoints, points })
    }
}

/// What the rows of a cloud are made of, in the order of the cloud and of its grid.
pub(super) struct Rows {
    /// None of `Cloud`.
    keypoints: Groups,
    /// None of `Keypoints`.
    points: Groups,
}

impl Rows {
    /// Counts row after row and hands each of them on.
    #[inline(always)]
    pub(super) fn count(&self, plan: &StructurePlan, mut end: impl FnMut(&mut Counts)) {
        let Self { keypoints, points } = self;
        let mut counts = Counts::new(plan.bins);
        let mut near = Vec::new();
        if plan.is_of_cloud() {
            near.extend(0..points.points as u32);
            among(plan, points, &near, &mut counts);
            end(&mut counts);
        }
        for keypoint in 0..keypoints.points {
            let (group, lane) = keypoints.find(keypoint);
            let first = Group::all_of(group, lane);
            match plan.channel.pairs {
                Pairs::KeypointNeighbour => about(plan, &first, points, None, &mut counts),
                Pairs::Keypoints => about(plan, &first, keypoints, Some(keypoint), &mut counts),
                Pairs::Neighbours => {
                    let centre = group.position.map(|values| values[lane]);
                    find(points, centre, plan.reach2, &mut near);
                    among(plan, points, &near, &mut counts);
                }
                Pairs::Cloud => {}
            }
            end(&mut counts);
        }
    }
}

/// Counts the pairs of one point, in all lanes of `first`, with the others but itself that can be within reach.
#[inline(always)]
fn about(plan: &StructurePlan, first: &Group, others: &Groups, itself: Option<usize>, counts: &mut Counts) {
    let centre = first.position.map(|values| values[0]);
    for (place, group) in others.groups.iter().enumerate() {
        if others.is_out_of_reach(place, centre, plan.most2) {
            continue;
        }
        match itself {
            Some(itself) if itself / LANES == place => {
                let mut group = *group;
                group.clear(itself % LANES);
                count(plan, [first, &group], counts);
            }
            _ => count(plan, [first, group], counts),
        }
    }
}

/// Finds the points within reach of a place, in their order.
#[inline(always)]
fn find(points: &Groups, centre: [f32; 3], reach2: f32, near: &mut Vec<u32>) {
    near.clear();
    for (place, group) in points.groups.iter().enumerate() {
        if points.is_out_of_reach(place, centre, reach2) {
            continue;
        }
        let d2 = group.squared_distances(centre);
        // Free of branches: some of the points are neighbours, in no pattern a processor could predict.
        let mut found = [0; LANES];
        let mut count = 0;
        for (lane, d2) in d2.into_iter().enumerate() {
            found[count % LANES] = (place * LANES + lane) as u32;
            count += usize::from(d2 <= reach2);
        }
        near.extend_from_slice(&found[..count]);
    }
}

/// Counts ordered pairs among some of the points: those that are drawn, or all.
#[inline(always)]
fn among(plan: &StructurePlan, points: &Groups, near: &[u32], counts: &mut Counts) {
    if !plan.draws(near.len()) {
        let near = points.gather(plan, near);
        for index in 0..near.points {
            let (group, lane) = near.find(index);
            about(plan, &Group::all_of(group, lane), &near, Some(index), counts);
        }
        return;
    }
    let [mut first, mut second] = [Group::EMPTY; 2];
    let samples = plan.channel.samples;
    for start in (0..samples).step_by(LANES) {
        let [mut ones, mut others] = [[0; LANES]; 2];
        for ((number, one), other) in (start..).zip(&mut ones).zip(&mut others) {
            [*one, *other] = draw(number, near.len() as u32).map(|index| near[index as usize]);
        }
        first.gather(plan, points, &ones);
        second.gather(plan, points, &others);
        for (lane, (one, other)) in ones.into_iter().zip(others).enumerate() {
            if (one == other) | (lane as u32 >= samples - start) {
                second.clear(lane);
            }
        }
        count(plan, [&first, &second], counts);
    }
}

/// The kernel of [`StructurePlan::signature`].
struct Describe<'a> {
    plan: &'a StructurePlan,
    rows: Rows,
}

impl NullaryFnOnce for Describe<'_> {
    type Output = Signature;

    #[inline(always)]
    fn call(self) -> Signature {
        let plan = self.plan;
        let width = plan.bins;
        let [shell_bins, histogram_bins] = [plan.shell_bins, plan.histogram_bins].map(|bins| bins as usize);
        let mut rows = Vec::new();
        self.rows.count(plan, |counts| counts.take_shares(shell_bins, histogram_bins, &mut rows));
        if plan.is_of_cloud() {
            return Signature { centroid: rows, deviation: Vec::new() };
        }
        if rows.is_empty() {
            return Signature { centroid: vec![0.0; width], deviation: vec![0.0; width] };
        }
        MeanAndDeviation { rows: &rows, width }.call()
    }
}
