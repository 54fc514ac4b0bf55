//! A coloured point cloud as the descriptor sees it: finite points in metres.

/// One view of one object. Points are finite and in metres; `colours`, if present, has one entry a point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cloud {
    /// Positions in the camera's frame, metres.
    pub points: Vec<[f32; 3]>,
    /// Red, green, blue of each point, or `None` for a cloud without colour.
    pub colours: Option<Vec<[u8; 3]>>,
    /// Position of the camera in the same frame, metres: normals are turned towards it.
    pub viewpoint: [f32; 3],
}

impl Cloud {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether the cloud has no point at all.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// The cloud with every length multiplied by `metres_per_unit` (0.001 for a cloud stored in millimetres).
    pub fn in_metres(mut self, metres_per_unit: f32) -> Self {
        if metres_per_unit != 1.0 {
            for coordinate in self.points.iter_mut().flatten().chain(self.viewpoint.iter_mut()) {
                *coordinate *= metres_per_unit;
            }
        }
        self
    }
}
