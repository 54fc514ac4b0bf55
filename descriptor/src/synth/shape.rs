//! Surfaces of the objects as signed distances, and the ray that finds them.

/// A vector in an object's or a camera's frame, metres.
pub(super) type Vec3 = [f64; 3];

pub(super) fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `a + s·b`.
pub(super) fn along(a: Vec3, s: f64, b: Vec3) -> Vec3 {
    [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]]
}

/// The vector with length 1; the zero vector stays what it is.
pub(super) fn unit(a: Vec3) -> Vec3 {
    let length = dot(a, a).sqrt();
    if length > 0.0 { [a[0] / length, a[1] / length, a[2] / length] } else { a }
}

/// A closed surface in its own frame: origin at the centre of its height, z up, lengths in metres.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A box with rounded edges.
    Box {
        /// Half of width, depth and height, edges included.
        half: [f64; 3],
        /// Radius of the edges, smaller than every half.
        edge: f64,
    },
    /// A ball.
    Sphere {
        /// Its radius.
        radius: f64,
    },
    /// A body of revolution about the z axis: cylinder, cone, bottle, cup.
    Revolution(Profile),
    /// A cup with a handle: half a torus beside the wall.
    Mug {
        /// The cup.
        cup: Profile,
        /// Distance of the handle's centre from the axis; the handle's ring stands upright there.
        reach: f64,
        /// Radius of the ring's centre line.
        ring: f64,
        /// Radius of the handle's cross-section.
        grip: f64,
    },
}

/// The outline of a body of revolution: a closed polygon of (radius, height), its first and last vertex on the
/// axis, without an edge that crosses another.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile(Vec<[f64; 2]>);

impl Profile {
    /// The outline through the vertices, moved so that the middle of its height is 0.
    fn centred(mut vertices: Vec<[f64; 2]>) -> Self {
        let low = vertices.iter().fold(f64::INFINITY, |low, v| low.min(v[1]));
        let high = vertices.iter().fold(f64::NEG_INFINITY, |high, v| high.max(v[1]));
        for vertex in &mut vertices {
            vertex[1] -= (low + high) / 2.0;
        }
        Self(vertices)
    }

    /// A truncated cone: radius `bottom` below and `top` above; a cylinder if they are equal.
    pub(super) fn cone(bottom: f64, top: f64, height: f64) -> Self {
        Self::centred(vec![[0.0, 0.0], [bottom, 0.0], [top, height], [0.0, height]])
    }

    /// An open cup, its wall and floor `wall` thick.
    pub(super) fn cup(bottom: f64, top: f64, height: f64, wall: f64) -> Self {
        Self::centred(vec![
            [0.0, 0.0],
            [bottom, 0.0],
            [top, height],
            [top - wall, height],
            [bottom - wall, wall],
            [0.0, wall],
        ])
    }

    /// A bottle: body, shoulder, neck and a cap a little wider than the neck. `shoulder` is the share of the
    /// height where the body ends.
    pub(super) fn bottle(body: f64, neck: f64, height: f64, shoulder: f64) -> Self {
        let (start, end) = (height * shoulder, height * (0.35 + 0.65 * shoulder));
        let mut vertices = vec![[0.0, 0.0], [body * 0.94, 0.0], [body, body * 0.1]];
        // Smoothstep from the body's radius to the neck's.
        for step in 0..=6 {
            let t = f64::from(step) / 6.0;
            let ease = t * t * (3.0 - 2.0 * t);
            vertices.push([body + (neck - body) * ease, start + (end - start) * t]);
        }
        let cap = height * 0.9;
        vertices.extend([[neck, cap], [neck * 1.15, cap], [neck * 1.15, height], [0.0, height]]);
        Self::centred(vertices)
    }

    /// Signed distance of (radius, height) to the outline, negative inside; exact outside.
    fn distance(&self, radius: f64, height: f64) -> f64 {
        let mut nearest = f64::INFINITY;
        let mut inside = false;
        let mut previous = self.0[self.0.len() - 1];
        for &vertex in &self.0 {
            let edge = [previous[0] - vertex[0], previous[1] - vertex[1]];
            let to = [radius - vertex[0], height - vertex[1]];
            let share = ((to[0] * edge[0] + to[1] * edge[1]) / (edge[0] * edge[0] + edge[1] * edge[1]))
                .clamp(0.0, 1.0);
            let off = [to[0] - edge[0] * share, to[1] - edge[1] * share];
            nearest = nearest.min(off[0] * off[0] + off[1] * off[1]);
            // The ray towards larger radii crosses this edge.
            if (vertex[1] > height) != (previous[1] > height)
                && radius < vertex[0] + edge[0] * (height - vertex[1]) / edge[1]
            {
                inside = !inside;
            }
            previous = vertex;
        }
        if inside { -nearest.sqrt() } else { nearest.sqrt() }
    }

    /// Largest distance of the outline from the origin.
    fn reach(&self) -> f64 {
        self.0.iter().fold(0.0, |reach: f64, v| reach.max((v[0] * v[0] + v[1] * v[1]).sqrt()))
    }

    /// Vertices of the outline: (radius, height) in metres.
    pub fn vertices(&self) -> &[[f64; 2]] {
        &self.0
    }

    fn half_height(&self) -> f64 {
        self.0.iter().fold(0.0, |half: f64, v| half.max(v[1]))
    }
}

/// A ray that came this near, metres, has hit; well below the sensor's resolution.
pub(super) const HIT: f64 = 1e-5;

/// Steps after which a ray that creeps along the surface counts as a miss.
const STEPS: u32 = 160;

impl Shape {
    /// Signed distance to the surface, metres: outside never more than the true distance, and 0 just on it.
    pub fn distance(&self, p: [f64; 3]) -> f64 {
        match self {
            Self::Box { half, edge } => {
                let q: Vec3 = std::array::from_fn(|axis| p[axis].abs() - half[axis] + edge);
                let outside: Vec3 = q.map(|c| c.max(0.0));
                dot(outside, outside).sqrt() + q[0].max(q[1]).max(q[2]).min(0.0) - edge
            }
            Self::Sphere { radius } => dot(p, p).sqrt() - radius,
            Self::Revolution(profile) => profile.distance((p[0] * p[0] + p[1] * p[1]).sqrt(), p[2]),
            Self::Mug { cup, reach, ring, grip } => {
                let axial = (p[0] * p[0] + p[1] * p[1]).sqrt();
                let (beside, up) = (p[0] - reach, p[2]);
                let off = (beside * beside + up * up).sqrt() - ring;
                let torus = (off * off + p[1] * p[1]).sqrt() - grip;
                // Only the part of the ring outside the wall is there.
                cup.distance(axial, p[2]).min(torus.max(reach - axial))
            }
        }
    }

    /// Radius of a ball around the origin that holds the whole surface, metres.
    pub fn bound(&self) -> f64 {
        match self {
            Self::Box { half, .. } => dot(*half, *half).sqrt(),
            Self::Sphere { radius } => *radius,
            Self::Revolution(profile) => profile.reach(),
            Self::Mug { cup, reach, ring, grip } => cup.reach().max(reach + ring + grip),
        }
    }

    /// Half of the height, metres.
    pub fn half_height(&self) -> f64 {
        match self {
            Self::Box { half, .. } => half[2],
            Self::Sphere { radius } => *radius,
            Self::Revolution(profile) => profile.half_height(),
            Self::Mug { cup, .. } => cup.half_height(),
        }
    }

    /// Unit normal at a point of the surface: the gradient of the distance, by central differences.
    pub(super) fn normal(&self, p: Vec3) -> Vec3 {
        const H: f64 = 1e-6;
        unit(std::array::from_fn(|axis| {
            let (mut low, mut high) = (p, p);
            low[axis] -= H;
            high[axis] += H;
            self.distance(high) - self.distance(low)
        }))
    }

    /// Distance from `origin` along the unit vector `direction` to the surface (sphere tracing), if it is hit.
    pub(super) fn trace(&self, origin: Vec3, direction: Vec3) -> Option<f64> {
        // Enter and leave the bounding ball, a little larger so that a surface that touches it is inside.
        let bound = self.bound() + 1e-3;
        let closest = -dot(origin, direction);
        let half2 = bound * bound - (dot(origin, origin) - closest * closest);
        if half2 <= 0.0 {
            return None;
        }
        let mut s = (closest - half2.sqrt()).max(0.0);
        let leave = closest + half2.sqrt();
        for _ in 0..STEPS {
            let distance = self.distance(along(origin, s, direction));
            if distance < HIT {
                return Some(s);
            }
            s += distance;
            if s > leave {
                return None;
            }
        }
        None
    }
}
