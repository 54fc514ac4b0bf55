//! The descriptors without genes by their definitions: one neighbour and one pair after the other, in f64.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

use super::frame::Frame;
use super::lab::Lab;
use super::ratio::bin;

/// A neighbour.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    pub(super) position: [f32; 3],
    pub(super) normal: [f32; 3],
    pub(super) colour: [u8; 3],
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn offset(from: [f32; 3], to: [f32; 3]) -> [f64; 3] {
    [0, 1, 2].map(|axis| f64::from(to[axis] - from[axis]))
}

/// PFHRGB of a region.
pub(super) fn pfhrgb(near: &[Point]) -> Vec<f64> {
    let mut row = vec![0.0; 250];
    let n = near.len() as f64;
    let share = 100.0 / (n * (n - 1.0) / 2.0);
    let fifth = |value: f64| ((5.0 * value).floor() as i64).clamp(0, 4) as usize;
    for (index, one) in near.iter().enumerate() {
        for (_, other) in near.iter().enumerate().filter(|&(other, _)| other != index) {
            let d = offset(one.position, other.position);
            let (u, n) = (one.normal.map(f64::from), other.normal.map(f64::from));
            let distance = dot(d, d).sqrt();
            let v = cross(d, u);
            let length = dot(v, v).sqrt();
            if distance == 0.0 || length == 0.0 {
                continue;
            }
            let v = v.map(|component| component / length);
            let w = cross(u, v);
            let features = [
                fifth((libm::atan2(dot(w, n), dot(u, n)) + PI) / TAU),
                fifth((dot(v, n) + 1.0) / 2.0),
                fifth((dot(u, d) / distance + 1.0) / 2.0),
            ];
            let ratios =
                [0, 1, 2].map(|channel| usize::from(bin(one.colour[channel], other.colour[channel])));
            for (first, [a, b, c]) in [(0, features), (125, ratios)] {
                row[first + a + 5 * b + 25 * c] += share;
            }
        }
    }
    row
}

/// SHOT with colour of a region about a keypoint, given its frame.
pub(super) fn shotcolor(
    near: &[Point],
    keypoint: [f32; 3],
    colour: [u8; 3],
    frame: Frame,
    radius: f64,
) -> Vec<f64> {
    let mut row = vec![0.0; 1344];
    let lab = |colour| Lab::tables().of(colour).map(f64::from);
    for point in near {
        let d = offset(keypoint, point.position);
        let distance = dot(d, d).sqrt();
        let [x, y, z] = [frame.x, frame.y, frame.z].map(|axis| dot(d, axis.map(f64::from)));
        // How far the point is from the middle of its cell, counted in cells, and whether there is one beside it.
        let azimuth = (libm::atan2(y, x) + PI) / FRAC_PI_4;
        let sector = (azimuth.floor() as i64).clamp(0, 7);
        let beside = |cell: i64, offset: f64| cell + if offset > 0.0 { 1 } else { -1 };
        let to_sector = azimuth - (sector as f64 + 0.5);
        let outer = i64::from(distance > radius / 2.0);
        let to_husk = distance / (radius / 2.0) - (outer as f64 + 0.5);
        let upper = i64::from(z > 0.0);
        let to_half = (PI - libm::acos(z / distance)) / FRAC_PI_2 - (upper as f64 + 0.5);
        let volume = |sector: i64, outer: i64, upper: i64| {
            let inside = (0..2).contains(&outer) && (0..2).contains(&upper);
            inside.then(|| (4 * sector.rem_euclid(8) + 2 * outer + upper) as usize)
        };
        let own = 3.0 - to_sector.abs() - to_husk.abs() - to_half.abs();

        let cosine = dot(point.normal.map(f64::from), frame.z.map(f64::from)).clamp(-1.0, 1.0);
        let (here, there) = (lab(colour), lab(point.colour));
        let [l, a, b] = [0, 1, 2].map(|part| (here[part] - there[part]).abs());
        for (first, steps, value) in
            [(0, 10, (1.0 + cosine) / 2.0), (352, 30, ((l + (a + b) / 2.0) / 3.0).min(1.0))]
        {
            let position = value * steps as f64;
            let bin = (position + 0.5).floor();
            let to_bin = position - bin;
            let bin_beside = (bin as i64 + steps + if to_bin > 0.0 { 1 } else { -1 }) % steps;
            let mut vote = |volume: Option<usize>, bin: i64, weight: f64| {
                if let Some(volume) = volume {
                    row[first + volume * (steps as usize + 1) + bin as usize] += weight;
                }
            };
            let bin = bin as i64;
            vote(volume(sector, outer, upper), bin, own + 1.0 - to_bin.abs());
            vote(volume(sector, outer, upper), bin_beside, to_bin.abs());
            vote(volume(beside(sector, to_sector), outer, upper), bin, to_sector.abs());
            vote(volume(sector, beside(outer, to_husk), upper), bin, to_husk.abs());
            vote(volume(sector, outer, beside(upper, to_half)), bin, to_half.abs());
        }
    }
    let length = row.iter().map(|value| value * value).sum::<f64>().sqrt();
    row.iter().map(|value| value / length).collect()
}
