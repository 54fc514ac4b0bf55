//! A virtual depth camera: where it stands, what light there is, what stands in the way, and what it measures.

use super::draw::Draw;
use super::shape::{Shape, Vec3, along, cross, dot, unit};
use super::texture::{Rgb, Texture};
use crate::Cloud;

/// Focal length of the Kinect's images, pixels.
pub(super) const FOCAL: f64 = 525.0;
/// Principal point, pixels.
pub(super) const CENTRE: [f64; 2] = [319.5, 239.5];
/// Width and height of the image, pixels.
const IMAGE: [f64; 2] = [640.0, 480.0];
/// Distance of the Kinect's projector from its camera, metres: depth is base · focal length / disparity.
const BASE: f64 = 0.075;

/// What the sensor does to a perfect picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sensor {
    /// Standard deviation of the disparity, pixels: the error of depth grows with its square.
    pub disparity_noise: f64,
    /// Step of the disparity, pixels; 0 for none.
    pub disparity_step: f64,
    /// Share of pixels without depth.
    pub missing: f64,
    /// Below this cosine between normal and ray there is no depth.
    pub grazing: f64,
    /// Standard deviation of each colour channel, of 255.
    pub colour_noise: f64,
}

impl Sensor {
    /// About a Kinect at one metre: 1.5 mm of noise, steps of 3 mm.
    pub(super) const KINECT: Self =
        Self { disparity_noise: 0.06, disparity_step: 0.125, missing: 0.04, grazing: 0.2, colour_noise: 5.0 };

    /// Depth as measured for the true depth, metres. Draws one number, whatever the settings.
    pub(super) fn depth(&self, z: f64, draw: &mut Draw) -> f64 {
        let noise = self.disparity_noise * draw.gaussian();
        if self.disparity_noise == 0.0 && self.disparity_step == 0.0 {
            return z;
        }
        let mut disparity = BASE * FOCAL / z + noise;
        if self.disparity_step > 0.0 {
            disparity = (disparity / self.disparity_step + 0.5).floor() * self.disparity_step;
        }
        BASE * FOCAL / disparity
    }

    /// Largest error of a depth, metres, at the true depth z.
    #[cfg(test)]
    pub(super) fn depth_bound(&self, z: f64) -> f64 {
        let error = self.disparity_noise * super::draw::REACH + self.disparity_step / 2.0;
        BASE * FOCAL / (BASE * FOCAL / z - error) - z
    }
}

/// The camera's place in the object's frame: x right, y down, z forward.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Pose {
    pub position: Vec3,
    pub right: Vec3,
    pub down: Vec3,
    pub forward: Vec3,
}

impl Pose {
    /// Looks at an object on a turntable from the given height (degrees above the level) and turn (degrees), with
    /// small random changes of distance, aim and roll.
    pub(super) fn around(elevation: f64, turn: f64, draw: &mut Draw) -> Self {
        let elevation = (elevation + draw.between(-3.0, 3.0)).to_radians();
        let turn = turn.to_radians();
        let distance = draw.between(0.85, 1.0);
        let aim: Vec3 = std::array::from_fn(|_| draw.between(-0.03, 0.03));
        let roll = draw.between(-3.0, 3.0).to_radians();
        let level = libm::cos(elevation);
        let outward = [level * libm::cos(turn), level * libm::sin(turn), libm::sin(elevation)];
        let forward = outward.map(|c| -c);
        // Heights stay below 90 degrees, so up and forward span a plane.
        let right = unit(cross(forward, [0.0, 0.0, 1.0]));
        let down = cross(forward, right);
        let (cos, sin) = (libm::cos(roll), libm::sin(roll));
        let rolled: Vec3 = std::array::from_fn(|axis| cos * right[axis] + sin * down[axis]);
        Self { position: along(aim, distance, outward), right: rolled, down: cross(forward, rolled), forward }
    }

    /// A point of the object's frame in the camera's frame.
    pub(super) fn to_camera(&self, p: Vec3) -> Vec3 {
        let off = along(p, -1.0, self.position);
        [dot(self.right, off), dot(self.down, off), dot(self.forward, off)]
    }

    /// A point of the camera's frame in the object's frame.
    pub(super) fn to_object(&self, p: Vec3) -> Vec3 {
        along(along(along(self.position, p[0], self.right), p[1], self.down), p[2], self.forward)
    }
}

/// One far lamp and an even light from everywhere.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Light {
    /// Unit vector towards the lamp, object frame.
    pub towards: Vec3,
    /// Light from everywhere, of all three colours.
    pub ambient: Rgb,
    /// Light of the lamp, of all three colours.
    pub lamp: Rgb,
}

impl Light {
    /// The light of one view: another brightness, tint and direction each time.
    pub(super) fn random(draw: &mut Draw) -> Self {
        let turn = draw.between(0.0, 360.0).to_radians();
        let height = draw.between(0.35, 0.95);
        let level = (1.0 - height * height).sqrt();
        let gain = draw.between(0.75, 1.15);
        let even = draw.between(0.45, 0.65);
        let tint: Rgb = std::array::from_fn(|_| gain * draw.between(0.92, 1.08));
        Self {
            towards: [level * libm::cos(turn), level * libm::sin(turn), height],
            ambient: tint.map(|channel| channel * even),
            lamp: tint.map(|channel| channel * (1.0 - even)),
        }
    }

    /// Light that a surface of the given normal sends back (Lambert).
    fn shade(&self, reflectance: Rgb, normal: Vec3) -> Rgb {
        let fall = dot(normal, self.towards).max(0.0);
        std::array::from_fn(|c| reflectance[c] * (self.ambient[c] + fall * self.lamp[c]))
    }
}

/// A disk in the picture behind which nothing is seen: something round that stands nearer to the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Occluder {
    /// Its middle, pixels.
    pub middle: [f64; 2],
    /// Its radius, pixels.
    pub radius: f64,
}

impl Occluder {
    /// In some views, a disk over one side of an object whose bounding ball has the radius `bound`. Its edge stays
    /// off the object's middle, so that something is always left.
    pub(super) fn random(pose: &Pose, bound: f64, draw: &mut Draw) -> Option<Self> {
        let present = draw.chance(0.35);
        let turn = draw.between(0.0, 360.0).to_radians();
        let (radius, gap) = (draw.between(0.5, 1.0), draw.between(0.05, 0.4));
        let [x, y, z] = pose.to_camera([0.0; 3]);
        let scale = FOCAL * bound / z;
        let away = (radius + gap) * scale;
        let middle = [
            CENTRE[0] + FOCAL * x / z + away * libm::cos(turn),
            CENTRE[1] + FOCAL * y / z + away * libm::sin(turn),
        ];
        present.then_some(Self { middle, radius: radius * scale })
    }

    fn covers(&self, pixel: [f64; 2]) -> bool {
        let off = [pixel[0] - self.middle[0], pixel[1] - self.middle[1]];
        off[0] * off[0] + off[1] * off[1] < self.radius * self.radius
    }
}

/// One picture to take.
pub(super) struct Scene<'a> {
    pub shape: &'a Shape,
    pub texture: &'a Texture,
    pub pose: Pose,
    pub light: Light,
    pub occluder: Option<Occluder>,
    pub sensor: Sensor,
}

impl Scene<'_> {
    /// The object's points in the camera's frame, in order of rows and columns. `draw` gives the sensor's noise: the
    /// same numbers for a pixel whatever light and occluder are.
    pub(super) fn shoot(&self, draw: &mut Draw) -> Cloud {
        let half_height = self.shape.half_height();
        let (columns, rows) = (self.pixels(0), self.pixels(1));
        let mut points = Vec::new();
        let mut colours = Vec::new();
        for row in rows.0..rows.1 {
            for column in columns.0..columns.1 {
                let pixel = [f64::from(column), f64::from(row)];
                let ray = [(pixel[0] - CENTRE[0]) / FOCAL, (pixel[1] - CENTRE[1]) / FOCAL, 1.0];
                let length = dot(ray, ray).sqrt();
                let direction = along(self.pose.to_object(ray), -1.0, self.pose.position).map(|c| c / length);
                let Some(s) = self.shape.trace(self.pose.position, direction) else { continue };
                let hit = along(self.pose.position, s, direction);
                let normal = self.shape.normal(hit);

                let z = self.sensor.depth(s / length, draw);
                let missing = draw.chance(self.sensor.missing);
                let noise: Rgb = std::array::from_fn(|_| self.sensor.colour_noise * draw.gaussian());
                let grazing = -dot(normal, direction) < self.sensor.grazing;
                let hidden = self.occluder.is_some_and(|occluder| occluder.covers(pixel));
                if missing || grazing || hidden {
                    continue;
                }
                let seen = self.light.shade(self.texture.reflectance(hit, half_height), normal);
                points.push([(ray[0] * z) as f32, (ray[1] * z) as f32, z as f32]);
                // Casting from float to integer saturates at 0 and 255.
                colours.push(std::array::from_fn(|c| (255.0 * seen[c] + noise[c] + 0.5).floor() as u8));
            }
        }
        Cloud { points, colours: Some(colours), viewpoint: [0.0; 3] }
    }

    /// Pixels, first and one past the last, between which the object's bounding ball is, on axis 0 (columns) or 1 (rows).
    fn pixels(&self, axis: usize) -> (u32, u32) {
        let bound = self.shape.bound();
        let middle = self.pose.to_camera([0.0; 3]);
        let (near, far) = (middle[2] - bound, middle[2] + bound);
        let (low, high) = (middle[axis] - bound, middle[axis] + bound);
        let low = CENTRE[axis] + FOCAL * (low / near).min(low / far);
        let high = CENTRE[axis] + FOCAL * (high / near).max(high / far);
        (low.clamp(0.0, IMAGE[axis]).floor() as u32, (high + 1.0).clamp(0.0, IMAGE[axis]).ceil() as u32)
    }
}
