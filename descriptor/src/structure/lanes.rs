//! Points in groups, value by value, so that a loop over the lanes of a group becomes a vector loop.

use crate::prepare_error::PrepareError;
use crate::structure::channel::StructureChannel;
use crate::structure::cloud::Points;
use crate::structure::colours::values;
use crate::structure::plan::{Column, StructurePlan};

/// Points that are looked at together, each in a lane of its own.
pub(super) const LANES: usize = 64;

/// What is known of a group of points.
#[derive(Clone, Copy)]
pub(super) struct Group {
    /// x, y, z, metres; NaN in a lane without a point, so that no distance to it counts.
    pub(super) position: [[f32; LANES]; 3],
    /// x, y, z; zeros if no feature is made of normals.
    pub(super) normal: [[f32; LANES]; 3],
    /// The columns of the plan; codes as the bits of a float.
    pub(super) columns: [[f32; LANES]; StructureChannel::MAX_AXES],
}

impl Group {
    pub(super) const EMPTY: Self = Self {
        position: [[f32::NAN; LANES]; 3],
        normal: [[0.0; LANES]; 3],
        columns: [[0.0; LANES]; StructureChannel::MAX_AXES],
    };

    /// The group that has one lane of another in all of its lanes.
    #[inline(always)]
    pub(super) fn all_of(other: &Self, lane: usize) -> Self {
        let repeat = |values: &[f32; LANES]| [values[lane]; LANES];
        Self {
            position: other.position.each_ref().map(repeat),
            normal: other.normal.each_ref().map(repeat),
            columns: other.columns.each_ref().map(repeat),
        }
    }

    /// Empties a lane.
    #[inline(always)]
    pub(super) fn clear(&mut self, lane: usize) {
        self.position[0][lane] = f32::NAN;
    }

    /// Takes over what a plan needs of points of other groups, lane by lane.
    #[inline(always)]
    pub(super) fn gather(&mut self, plan: &StructurePlan, points: &Groups, indices: &[u32]) {
        let gather = |values: &mut [f32; LANES], of: fn(&Group) -> &[f32; LANES]| {
            for (value, &index) in values.iter_mut().zip(indices) {
                let (group, lane) = points.find(index as usize);
                *value = of(group)[lane];
            }
        };
        let [x, y, z] = &mut self.position;
        gather(x, |group| &group.position[0]);
        gather(y, |group| &group.position[1]);
        gather(z, |group| &group.position[2]);
        if plan.has_angles {
            let [x, y, z] = &mut self.normal;
            gather(x, |group| &group.normal[0]);
            gather(y, |group| &group.normal[1]);
            gather(z, |group| &group.normal[2]);
        }
        for (column, values) in self.columns.iter_mut().enumerate().take(plan.columns.len()) {
            for (value, &index) in values.iter_mut().zip(indices) {
                let (group, lane) = points.find(index as usize);
                *value = group.columns[column][lane];
            }
        }
    }

    /// Squared distances to a place.
    #[inline(always)]
    pub(super) fn squared_distances(&self, [x, y, z]: [f32; 3]) -> [f32; LANES] {
        let mut d2 = [0.0; LANES];
        for (lane, d2) in d2.iter_mut().enumerate() {
            let [dx, dy, dz] =
                [self.position[0][lane] - x, self.position[1][lane] - y, self.position[2][lane] - z];
            *d2 = dx * dx + dy * dy + dz * dz;
        }
        d2
    }
}

/// The points that a channel can use, group after group.
#[derive(Default)]
pub(super) struct Groups {
    pub(super) groups: Vec<Group>,
    /// Lowest and highest corner of each group.
    boxes: Vec<[[f32; 3]; 2]>,
    /// Number of points: all lanes but some of the last group's.
    pub(super) points: usize,
}

impl Groups {
    /// Takes the points in their order, without those that lack a normal where the channel needs one.
    ///
    /// # Errors
    /// [`PrepareError::NoColours`] if the channel needs colours and there are none.
    pub(super) fn new(plan: &StructurePlan, points: &Points, mean: [i32; 2]) -> Result<Self, PrepareError> {
        let needs_normals = plan.channel.needs_normals();
        let mut groups = Self::default();
        let mut used_colours = Vec::new();
        let colours = match &points.colours {
            Some(colours) => colours.as_slice(),
            None if plan.channel.needs_colour() => return Err(PrepareError::NoColours),
            None => &[],
        };
        for (index, (position, normal)) in points.positions.iter().zip(&points.normals).enumerate() {
            if needs_normals && normal.is_none() {
                continue;
            }
            let lane = groups.points % LANES;
            if lane == 0 {
                groups.groups.push(Group::EMPTY);
            }
            if let Some(group) = groups.groups.last_mut() {
                group.position.iter_mut().zip(position).for_each(|(values, &value)| values[lane] = value);
                let normal = normal.unwrap_or_default();
                group.normal.iter_mut().zip(normal).for_each(|(values, value)| values[lane] = value);
            }
            groups.points += 1;
            used_colours.extend(colours.get(index));
        }
        for (place, column) in plan.columns.iter().enumerate() {
            let values = column.values(&used_colours, mean);
            for (group, values) in groups.groups.iter_mut().zip(values.chunks(LANES)) {
                group.columns[place][..values.len()].copy_from_slice(values);
            }
        }
        groups.boxes = groups.groups.iter().map(bounds).collect();
        Ok(groups)
    }

    /// Some of the points, with what the plan needs of them.
    #[inline(always)]
    pub(super) fn gather(&self, plan: &StructurePlan, points: &[u32]) -> Self {
        let mut gathered = Self { points: points.len(), ..Self::default() };
        for points in points.chunks(LANES) {
            let mut group = Group::EMPTY;
            group.gather(plan, self, points);
            gathered.boxes.push(bounds(&group));
            gathered.groups.push(group);
        }
        gathered
    }

    /// The group of a point and its lane.
    #[inline(always)]
    pub(super) fn find(&self, point: usize) -> (&Group, usize) {
        (&self.groups[point / LANES], point % LANES)
    }

    /// Whether no point of a group can be as near as that.
    #[inline(always)]
    pub(super) fn is_out_of_reach(&self, group: usize, centre: [f32; 3], reach2: f32) -> bool {
        // Rounds like the distances of points: differences and squares never decrease with the distance along an axis.
        let [low, high] = &self.boxes[group];
        let mut d2 = [0.0; 3];
        for axis in 0..3 {
            let outside = centre[axis].clamp(low[axis], high[axis]) - centre[axis];
            d2[axis] = outside * outside;
        }
        d2[0] + d2[1] + d2[2] > reach2
    }
}

fn bounds(group: &Group) -> [[f32; 3]; 2] {
    // Empty lanes are NaN, which neither takes.
    let extreme = |pick: fn(f32, f32) -> f32| {
        group.position.map(|values| values.into_iter().reduce(pick).unwrap_or_default())
    };
    [extreme(f32::min), extreme(f32::max)]
}

impl Column {
    /// The values of points of these colours.
    fn values(&self, colours: &[[u8; 3]], mean: [i32; 2]) -> Vec<f32> {
        let axes = match self {
            Self::Value(feature) => return values(*feature, colours, mean),
            Self::Code(axes) => axes,
        };
        let mut codes = vec![0u32; colours.len()];
        for axis in axes {
            let values = values(axis.feature, colours, mean);
            for &edge in &axis.edges {
                for (code, &value) in codes.iter_mut().zip(&values) {
                    *code += if value >= edge { axis.stride } else { 0 };
                }
            }
        }
        codes.into_iter().map(f32::from_bits).collect()
    }
}
