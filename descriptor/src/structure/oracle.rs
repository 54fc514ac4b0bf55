//! Structures written straight from their definition (DESIGN 5b): one pair after the other, in f64.

use std::f64::consts::PI;

use crate::fixed::lab::Lab;
use crate::neighbours::squared_distance;
use crate::oracle::hue;
use crate::structure::channel::{Axis, Pairs, StructureChannel};
use crate::structure::cloud::{Points, StructureCloud};
use crate::structure::feature::Feature;
use crate::structure::plan::StructurePlan;
use crate::structure::sampling::lowbias32;

/// A point with all that a feature can be made of.
#[derive(Clone, Copy, Debug)]
struct Point {
    position: [f32; 3],
    normal: Option<[f32; 3]>,
    colour: [u8; 3],
}

/// A row as far as rounding does not decide.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Row {
    /// Pairs in each bin that are far enough from its edges.
    pub(super) clear: Vec<u64>,
    /// Other pairs, in each of the histograms of a shell.
    pub(super) unclear: Vec<u64>,
}

/// Where a value lies in bins of size 1 that begin at 0, and how far from an edge it must be for its bin to be clear.
struct Place {
    at: f64,
    slack: f64,
}

fn exactly(at: f64) -> Place {
    Place { at, slack: 1e-9 }
}

/// The rows of a cloud, whose colours may be any if the channel needs none.
pub(super) fn rows(channel: &StructureChannel, cloud: &StructureCloud) -> Vec<Row> {
    let usable = |points: &Points, needs_normals: bool| -> Vec<Point> {
        let point = |index: usize| Point {
            position: points.positions[index],
            normal: points.normals[index],
            colour: points.colours.as_ref().map_or([0; 3], |colours| colours[index]),
        };
        let points = (0..points.positions.len()).map(point);
        points.filter(|point| !needs_normals || point.normal.is_some()).collect()
    };
    let points = usable(&cloud.points, channel.needs_normals());
    let mean = mean(&cloud.points);
    let row = |pairs: &[[Point; 2]]| row(channel, pairs, mean);
    if channel.pairs == Pairs::Cloud {
        return vec![row(&drawn(channel, &points))];
    }
    let keypoints = cloud.keypoints(&StructurePlan::new(channel)).unwrap();
    let keypoints = usable(&keypoints, channel.needs_normals() && !channel.all_keypoints);
    let near = |centre: Point, points: &[Point]| -> Vec<Point> {
        points.iter().copied().filter(|point| is_within(centre, *point, channel.radius_um)).collect()
    };
    let pairs = |index: usize| -> Vec<[Point; 2]> {
        let keypoint = keypoints[index];
        match channel.pairs {
            Pairs::KeypointNeighbour => {
                near(keypoint, &points).iter().map(|&other| [keypoint, other]).collect()
            }
            Pairs::Keypoints => {
                let others = [&keypoints[..index], &keypoints[index + 1..]].concat();
                near(keypoint, &others).iter().map(|&other| [keypoint, other]).collect()
            }
            _ => drawn(channel, &near(keypoint, &points)),
        }
    };
    (0..keypoints.len()).map(|index| row(&pairs(index))).collect()
}

/// Whether the distance is at most so many micrometres.
fn is_within(one: Point, other: Point, um: u32) -> bool {
    let metres = f64::from(um) / 1e6;
    f64::from(squared_distance(one.position, other.position)) <= metres * metres
}

/// All ordered pairs, or those that are drawn.
fn drawn(channel: &StructureChannel, points: &[Point]) -> Vec<[Point; 2]> {
    let n = points.len() as u64;
    let indices: Vec<[u64; 2]> =
        if channel.samples == 0 || n * n.saturating_sub(1) <= u64::from(channel.samples) {
            (0..n).flat_map(|one| (0..n).map(move |other| [one, other])).collect()
        } else {
            let index = |place: u32| (u64::from(lowbias32(place)) * n) >> 32;
            (0..channel.samples).map(|t| [index(2 * t), index(2 * t + 1)]).collect()
        };
    let different = indices.into_iter().filter(|[one, other]| one != other);
    different.map(|pair| pair.map(|index| points[index as usize])).collect()
}

fn row(channel: &StructureChannel, pairs: &[[Point; 2]], mean: [f64; 2]) -> Row {
    let histograms = if channel.is_joint { 1 } else { channel.axes.len() };
    let mut row = Row { clear: vec![0; channel.bins() as usize], unclear: vec![0; histograms] };
    let in_shell = row.clear.len() / channel.shells_um.len();
    for &[one, other] in pairs {
        let longest = channel.longest_um();
        let is_too_near = channel.least_um > 0 && is_within(one, other, channel.least_um) && {
            let least = f64::from(channel.least_um) / 1e6;
            f64::from(squared_distance(one.position, other.position)) < least * least
        };
        let shell = channel.shells_um.iter().position(|&um| is_within(one, other, um.min(longest)));
        let Some(shell) = shell.filter(|_| !is_too_near) else { continue };
        let needs_frame = channel.axes.iter().any(|axis| axis.feature.needs_frame());
        let sine = if needs_frame { sine(one, other) } else { 1.0 };
        if sine == 0.0 {
            continue;
        }
        if sine < 1e-4 {
            row.unclear.iter_mut().for_each(|count| *count += 1);
            continue;
        }
        let bins: Vec<Option<usize>> = channel
            .axes
            .iter()
            .map(|axis| bin(channel, axis, place(channel, axis, one, other, mean)))
            .collect();
        let mut first = shell * in_shell;
        if channel.is_joint {
            let code = channel
                .axes
                .iter()
                .zip(&bins)
                .try_fold(0, |code, (axis, bin)| bin.map(|bin| code * axis.kept_bins() as usize + bin));
            match code {
                Some(code) => row.clear[first + code] += 1,
                None => row.unclear[0] += 1,
            }
            continue;
        }
        for ((axis, bin), unclear) in channel.axes.iter().zip(bins).zip(&mut row.unclear) {
            match bin {
                Some(bin) => row.clear[first + bin] += 1,
                None => *unclear += 1,
            }
            first += axis.kept_bins() as usize;
        }
    }
    row
}

/// The bin of a place, unless rounding decides.
fn bin(channel: &StructureChannel, axis: &Axis, place: Place) -> Option<usize> {
    let nearest = place.at.round();
    // The first edge and the last are none, but where a turn closes.
    let is_edge = (1.0..f64::from(axis.bins)).contains(&nearest) || axis.feature == Feature::F1;
    assert!(place.at > -1e-3 && place.at < f64::from(axis.bins) + 1e-3, "{} of {channel:?}", place.at);
    let is_clear = !is_edge || (place.at - nearest).abs() > place.slack;
    is_clear.then(|| (place.at.max(0.0) as usize).min(axis.bins as usize - 1))
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn length(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

fn offset(one: Point, other: Point) -> [f64; 3] {
    [0, 1, 2].map(|axis| f64::from(other.position[axis]) - f64::from(one.position[axis]))
}

/// Sine of the angle between the offset and the first normal; 0 without an offset.
fn sine(one: Point, other: Point) -> f64 {
    let d = offset(one, other);
    if length(d) == 0.0 { 0.0 } else { length(cross(d, one.normal.unwrap().map(f64::from))) / length(d) }
}

/// f1, f2, f3, and how far each may be off.
fn darboux(one: Point, other: Point) -> ([f64; 3], [f64; 3]) {
    let d = offset(one, other);
    let [u, n] = [one, other].map(|point| point.normal.unwrap().map(f64::from));
    let v = cross(d, u);
    let v = v.map(|component| component / length(v));
    let w = cross(u, v);
    let (y, x) = (dot(w, n), dot(u, n));
    let slack = 4e-6 / sine(one, other);
    (
        [libm::atan2(y, x), dot(v, n), dot(u, d) / length(d)],
        [slack / libm::hypot(x, y).max(1e-9), slack, 4e-6],
    )
}

fn place(channel: &StructureChannel, axis: &Axis, one: Point, other: Point, mean: [f64; 2]) -> Place {
    let bins = f64::from(axis.bins);
    let [r, g, b] = other.colour.map(f64::from);
    let between = |value: f64, low: f64, high: f64, slack: f64| {
        let per_unit = bins / (high - low);
        Place { at: (value - low) * per_unit, slack: (slack * per_unit).max(1e-9) }
    };
    // The bins of an angle by its cosine, which rounding moves by no more than `slack`.
    let by_cosine = |cosine: f64, parts: f64, slack: f64| {
        let angle = libm::acos(cosine.clamp(-1.0, 1.0));
        let at = angle / PI * parts;
        let to_edge = (cosine - libm::cos(at.round() / parts * PI)).abs();
        Place { at, slack: if to_edge > slack { 0.0 } else { f64::INFINITY } }
    };
    let squashed = |value: f64| {
        let s = f64::from(channel.squash_milli) / 1000.0;
        exactly((0.5 + 0.5 * value / (value.abs() + s)) * bins)
    };
    let difference = |of: &dyn Fn(Point) -> f64| squashed(of(other) - of(one));
    let ratio = |which: usize| {
        let [one, other] = [one, other].map(|point| f64::from(point.colour[which]));
        let ratio = if other == 0.0 { 1.0 } else { one / other };
        between(if ratio > 1.0 { -1.0 / ratio } else { ratio }, -1.0, 1.0, 1e-6)
    };
    let lab = |which: usize| f64::from(Lab::tables().of(other.colour)[which]);
    match axis.feature {
        Feature::Distance => {
            between(length(offset(one, other)), 0.0, f64::from(channel.longest_um()) / 1e6, 1e-7)
        }
        Feature::Angle => {
            let [m, n] = [one, other].map(|point| point.normal.unwrap().map(f64::from));
            let parts = if axis.full_turn { f64::from(axis.bins - 1) / 2.0 } else { bins };
            by_cosine(dot(m, n), parts, 1e-6)
        }
        Feature::F1 => {
            let ([f1, ..], [slack, ..]) = darboux(one, other);
            between(f1, -PI, PI, slack)
        }
        Feature::F2 => {
            let ([_, f2, _], [_, slack, _]) = darboux(one, other);
            between(f2, -1.0, 1.0, slack)
        }
        Feature::F3 => {
            let ([.., f3], [.., slack]) = darboux(one, other);
            between(f3, -1.0, 1.0, slack)
        }
        Feature::A2 => {
            let ([_, f2, _], [_, slack, _]) = darboux(one, other);
            by_cosine(f2, bins, slack)
        }
        Feature::A3 => {
            let ([.., f3], [.., slack]) = darboux(one, other);
            by_cosine(f3, bins, slack)
        }
        Feature::Hue => between(hue(other.colour), 0.0, 360.0, 1e-4),
        Feature::Saturation => {
            let most = r.max(g).max(b);
            let chroma = most - r.min(g).min(b);
            between(if most > 0.0 { chroma / most } else { 0.0 }, 0.0, 1.0, 1e-6)
        }
        Feature::Value => between(r.max(g).max(b), 0.0, 255.0, 0.0),
        Feature::C1 => squashed(c1(other)),
        Feature::C2 => squashed(c2(other)),
        Feature::W1 => squashed(c1(other) - mean[0]),
        Feature::W2 => squashed(c2(other) - mean[1]),
        Feature::L => between(lab(0), 0.0, 1.0, 0.0),
        Feature::A => between(lab(1), -1.0, 1.0, 0.0),
        Feature::B => between(lab(2), -1.0, 1.0, 0.0),
        Feature::LogRed => difference(&|point| log(point.colour[0])),
        Feature::LogGreen => difference(&|point| log(point.colour[1])),
        Feature::LogBlue => difference(&|point| log(point.colour[2])),
        Feature::O1 => difference(&c1),
        Feature::O2 => difference(&c2),
        Feature::RatioRed => ratio(0),
        Feature::RatioGreen => ratio(1),
        Feature::RatioBlue => ratio(2),
    }
}

/// The logarithm that is counted with: a whole number of 2⁻¹⁶.
fn log(channel: u8) -> f64 {
    libm::round(65_536.0 * libm::log(f64::from(channel) + 2.0)) / 65_536.0
}

fn c1(point: Point) -> f64 {
    log(point.colour[0]) - log(point.colour[1])
}

fn c2(point: Point) -> f64 {
    log(point.colour[2]) - (log(point.colour[0]) + log(point.colour[1])) / 2.0
}

/// Means of `c1` and `c2` over all points, rounded half up to whole units: 2⁻¹⁶ and half of it.
fn mean(points: &Points) -> [f64; 2] {
    let colours = points.colours.as_deref().unwrap_or_default();
    [(c1 as fn(Point) -> f64, 65_536.0), (c2, 131_072.0)].map(|(of, units)| {
        let value = |&colour| of(Point { position: [0.0; 3], normal: None, colour });
        let sum: f64 = colours.iter().map(value).sum();
        (sum / colours.len().max(1) as f64 * units + 0.5).floor() / units
    })
}
