//! Signatures of histograms of orientations with colour: what a keypoint's neighbours look like from its local frame.
//!
//! The sphere about a keypoint is cut into 32 volumes: eight sectors about the frame's z axis, an inner and an outer husk,
//! a lower and an upper half. Each volume has a histogram of the cosine to z and one of the distance in colour to the
//! keypoint. A neighbour votes in its volume and bin, and for each of four directions in the nearer one beside it: the
//! bin, the husk, the half, the sector. At the offset δ from the middle, in units of the width, that vote weighs |δ|, and
//! 1 − |δ| goes to its own bin (PCL: `SHOTColorEstimation::interpolateDoubleChannel`).

use std::f32::consts::{FRAC_2_PI, FRAC_PI_4};

use pulp::NullaryFnOnce;

use super::Radius;
use super::arctangent::arctangent;
use super::frame::Frame;
use super::lab::Lab;
use super::neighbourhood::{GROUP, Neighbourhood, group};
use crate::surface::Surface;
use crate::wide::widest;

/// Values of a histogram.
pub(super) const SIZE: usize = VOLUMES * (SHAPE.bins() + COLOUR.bins());

/// Sector times four, plus two for the outer husk, plus one for the upper half.
const VOLUMES: usize = 32;

/// The histograms of the cosine to the frame's z axis.
const SHAPE: Scale = Scale { first: 0, steps: 10 };

/// The histograms of the distance in colour, after those of the cosine.
const COLOUR: Scale = Scale { first: VOLUMES as i32 * 11, steps: 30 };

/// Cosine and sine of half a sector, 22.5°.
const COS_HALF: f32 = 0.923_879_5;
const SIN_HALF: f32 = 0.382_683_43;

/// The histograms of all keypoints that have a local frame, one after the other, each of length 1.
pub(super) fn rows(
    surface: &Surface,
    colours: &[[u8; 3]],
    keypoints: impl Iterator<Item = ([f32; 3], [u8; 3])>,
    radius: Radius,
) -> Vec<f32> {
    let lab = Lab::tables();
    let of_surface: Vec<[f32; 3]> = colours.iter().map(|&colour| lab.of(colour)).collect();
    let of_surface = [0, 1, 2].map(|part| of_surface.iter().map(|lab| lab[part]).collect::<Vec<f32>>());
    let mut near = Neighbourhood::default();
    let mut of_near: [Vec<f32>; 3] = Default::default();
    let mut rows = Vec::new();
    for (keypoint, colour) in keypoints {
        near.fill(surface, keypoint, [0.0, radius.squared]); // a point at the keypoint itself has no direction
        let Some(frame) = Frame::new(&near, keypoint, radius.metres) else { continue };
        for (values, list) in of_surface.iter().zip(&mut of_near) {
            near.take(values, list);
        }
        let (near, lab, labs) = (&near, lab.of(colour), of_near.each_ref().map(Vec::as_slice));
        let row = widest(Describe { near, labs, keypoint, lab, frame, radius: radius.metres as f32 });
        rows.extend_from_slice(&row[..SIZE]);
    }
    rows
}

/// A direction of bins.
#[derive(Clone, Copy)]
struct Scale {
    /// Place of the first volume's first bin.
    first: i32,
    /// Steps from the first bin to the last.
    steps: i32,
}

impl Scale {
    const fn bins(self) -> usize {
        self.steps as usize + 1
    }

    /// The nearest bin of a value in [0, 1], the offset to it, and the bin beside it on that side.
    ///
    /// PCL takes the remainder of the bin beside by the steps, not by the bins: next to the last but one is the first.
    #[inline(always)]
    fn bin(self, value: f32) -> (i32, f32, i32) {
        let position = value * self.steps as f32;
        let bin = (position + 0.5) as i32;
        let offset = position - bin as f32;
        let next = if bin + 1 == self.steps { 0 } else { bin + 1 };
        let previous = if bin > 0 { bin - 1 } else { 0 };
        (bin, offset, if offset > 0.0 { next } else { previous })
    }

    /// Place of a volume's bin.
    #[inline(always)]
    fn place(self, volume: i32, bin: i32) -> u16 {
        (self.first + volume * (self.steps + 1) + bin) as u16
    }
}

/// Room for a histogram, so that no place needs a check.
const ROOM: usize = 2048;

/// What a group of neighbours votes for: in each histogram its own bin, the bin beside it, and the bin in the other husk,
/// the other half and the sector beside.
struct Votes {
    places: [[[u16; GROUP]; 5]; 2],
    weights: [[[f32; GROUP]; 2]; 2],
    /// The same for both histograms.
    volume_weights: [[f32; GROUP]; 3],
}

/// Describes one keypoint.
struct Describe<'a> {
    near: &'a Neighbourhood,
    /// L, a, b of the neighbours.
    labs: [&'a [f32]; 3],
    keypoint: [f32; 3],
    lab: [f32; 3],
    frame: Frame,
    radius: f32,
}

impl NullaryFnOnce for Describe<'_> {
    type Output = [f32; ROOM];

    #[inline(always)]
    fn call(self) -> [f32; ROOM] {
        let mut row = [0.0f32; ROOM];
        let neighbours = self.near.len();
        for start in (0..neighbours).step_by(GROUP) {
            let votes = self.votes(start);
            for lane in 0..GROUP.min(neighbours - start) {
                // Not by `array::map`, which would copy all lanes for each.
                let [husk, half, sector] = &votes.volume_weights;
                let [husk, half, sector] = [husk[lane], half[lane], sector[lane]];
                for (places, weights) in votes.places.iter().zip(&votes.weights) {
                    let weights = [weights[0][lane], weights[1][lane], husk, half, sector];
                    for (place, weight) in places.iter().zip(weights) {
                        row[usize::from(place[lane]) % ROOM] += weight;
                    }
                }
            }
        }
        let square: f64 = row[..SIZE].iter().map(|&value| f64::from(value * value)).sum();
        let length = square.sqrt() as f32;
        for value in &mut row {
            *value /= length;
        }
        row
    }
}

impl Describe<'_> {
    /// The votes of the group that begins at `start`.
    #[inline(always)]
    fn votes(&self, start: usize) -> Votes {
        let position = self.near.position.each_ref().map(|list| group(list, start));
        let [mut x, mut y, mut z, mut distance] = [[0.0f32; GROUP]; 4];
        for lane in 0..GROUP {
            let offset = [0, 1, 2].map(|axis| position[axis][lane] - self.keypoint[axis]);
            x[lane] = dot(offset, self.frame.x);
            y[lane] = dot(offset, self.frame.y);
            z[lane] = dot(offset, self.frame.z);
            distance[lane] = dot(offset, offset).sqrt();
        }
        let (mut volumes, mut sectors_beside) = ([0i32; GROUP], [0i32; GROUP]);
        let (mut own, mut volume_weights) = ([0.0f32; GROUP], [[0.0f32; GROUP]; 3]);
        for lane in 0..GROUP {
            let (x, y, z) = (x[lane], y[lane], z[lane]);
            let is_outer = distance[lane] > 0.5 * self.radius;
            let (husk, to_husk) = husk(distance[lane] / self.radius, is_outer);
            let (half, to_half) = half(z.abs(), (x * x + y * y).sqrt());
            let (sector, is_odd) = sector(x, y);
            let (to_middle, to_sector, is_next) = from_middle(x.abs(), y.abs(), is_odd);
            let volume = 4 * sector + 2 * i32::from(is_outer) + i32::from(z > 0.0);
            volumes[lane] = volume;
            sectors_beside[lane] = (volume + if is_next { 4 } else { 28 }) % 32;
            own[lane] = husk + half + to_middle;
            volume_weights[0][lane] = to_husk;
            volume_weights[1][lane] = to_half;
            volume_weights[2][lane] = to_sector;
        }
        let normal = self.near.normal.each_ref().map(|list| group(list, start));
        let labs = self.labs.map(|list| group(list, start));
        let mut values = [[0.0f32; GROUP]; 2];
        for lane in 0..GROUP {
            let cosine = dot([normal[0][lane], normal[1][lane], normal[2][lane]], self.frame.z);
            let [l, a, b] = [0, 1, 2].map(|part| (self.lab[part] - labs[part][lane]).abs());
            values[0][lane] = unit((1.0 + cosine) * 0.5);
            values[1][lane] = unit((l + (a + b) * 0.5) / 3.0);
        }
        let mut votes =
            Votes { places: [[[0; GROUP]; 5]; 2], weights: [[[0.0; GROUP]; 2]; 2], volume_weights };
        for (histogram, scale) in [SHAPE, COLOUR].into_iter().enumerate() {
            let (places, weights) = (&mut votes.places[histogram], &mut votes.weights[histogram]);
            for lane in 0..GROUP {
                let (bin, offset, beside) = scale.bin(values[histogram][lane]);
                let volume = volumes[lane];
                places[0][lane] = scale.place(volume, bin);
                places[1][lane] = scale.place(volume, beside);
                places[2][lane] = scale.place(volume ^ 2, bin);
                places[3][lane] = scale.place(volume ^ 1, bin);
                places[4][lane] = scale.place(sectors_beside[lane], bin);
                weights[0][lane] = own[lane] + (1.0 - offset.abs());
                weights[1][lane] = offset.abs();
            }
        }
        votes
    }
}

#[inline(always)]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The value, or the end of [0, 1] that it is beyond.
#[inline(always)]
fn unit(value: f32) -> f32 {
    let value = if value > 0.0 { value } else { 0.0 };
    if value < 1.0 { value } else { 1.0 }
}

/// Weights of a neighbour's own husk and of the other one. The middles of the husks are at a quarter and at three quarters
/// of the radius; nothing is beside them on their far sides.
#[inline(always)]
fn husk(share_of_radius: f32, is_outer: bool) -> (f32, f32) {
    let inwards = if is_outer { 0.75 - share_of_radius } else { share_of_radius - 0.25 };
    let offset = 2.0 * inwards;
    (1.0 - offset.abs(), if offset > 0.0 { offset } else { 0.0 })
}

/// Weights of a neighbour's own half and of the other one, from its height above the plane between them and its distance
/// from the axis. The middles of the halves are 45° off the plane.
#[inline(always)]
fn half(height: f32, from_axis: f32) -> (f32, f32) {
    let offset = FRAC_2_PI * arctangent((from_axis - height) / (from_axis + height));
    (1.0 - offset.abs(), if offset > 0.0 { offset } else { 0.0 })
}

/// The sector of a direction, counted from −x by −y, and whether it is odd: that is where the direction comes nearer to
/// an axis as the angle grows.
#[inline(always)]
fn sector(x: f32, y: f32) -> (i32, bool) {
    let is_left = (y > 0.0) | ((y == 0.0) & (x < 0.0));
    let is_ahead = (x > 0.0) | ((x == 0.0) & (y > 0.0));
    let (dx, dy) = (x.abs(), y.abs());
    let is_odd = if (x * y > 0.0) | (x == 0.0) { dx < dy } else { dx > dy };
    (4 * i32::from(is_left) + 2 * i32::from(is_ahead != is_left) + i32::from(is_odd), is_odd)
}

/// Weights of a neighbour's own sector and of that beside it, and whether the latter is the next. Without a direction both
/// are 0.
#[inline(always)]
fn from_middle(dx: f32, dy: f32, is_odd: bool) -> (f32, f32, bool) {
    let (long, short) = if dx > dy { (dx, dy) } else { (dy, dx) };
    let (along, across) = (long * COS_HALF + short * SIN_HALF, short * COS_HALF - long * SIN_HALF);
    // Off the nearest axis, whichever way that is.
    let offset = arctangent(across / along) / FRAC_PI_4;
    let weight = if offset.abs() < 0.5 { offset.abs() } else { 0.5 };
    let is_next = (offset > 0.0) != is_odd;
    if long > 0.0 { (1.0 - weight, weight, is_next) } else { (0.0, 0.0, is_next) }
}
