//! Point feature histograms with colour: angles and colour ratios of all ordered pairs of a region's points.
//!
//! For a point p with unit normal m and another, q with n, at the offset d = q − p, PCL takes the frame u = m,
//! v = d × u/|d × u|, w = u × v, and bins f₁ = atan2(w·n, u·n), f₂ = v·n and f₃ = u·d/|d|, each in five equal parts
//! of its range (`computeRGBPairFeatures`). With a = m·d, b = n·d, c = m·n and t = (d × m)·n these are
//!
//! ```text
//! f₁ = atan2((b − c·a)/√(d² − a²), c)    f₂ = t/√(d² − a²)    f₃ = a/√d²        of p and q
//! f₁ = atan2((c·b − a)/√(d² − b²), c)    f₂ = t/√(d² − b²)    f₃ = −b/√d²       of q and p
//! ```
//!
//! so that both orders share most of their arithmetic, and each edge of a bin is a comparison of signed squares: no root,
//! no division, no arc tangent. Both are counted as one: the pair's code has the six bins as its digits.

mod codes;
mod counts;

use std::ops::Range;

pub(super) use codes::SIZE;

use codes::{PairCodes, row_length};
use counts::Counts;

use super::Radius;
use super::neighbourhood::{Neighbourhood, find};
use crate::prepare::check_regions;
use crate::prepare_error::PrepareError;
use crate::select::BELOW_ALL;
use crate::surface::Surface;
use crate::wide::widest;

/// Neighbours without which a keypoint is not described.
const MIN_NEIGHBOURS: usize = 3;

/// Codes of pairs that are kept at once, 16 MB: those of a cloud of 2000 points. One point with all of a larger region is
/// the least.
const CODES_AT_ONCE: usize = 1 << 22;

/// Most neighbours, and most keypoints, of what is described at once: 16 MB of places, 2 MB of counts.
const NEIGHBOURS_AT_ONCE: usize = 1 << 22;
const KEYPOINTS_AT_ONCE: usize = 1 << 10;

/// Refuses a cloud whose pairs would take minutes to count.
pub(super) fn check(
    surface: &Surface,
    keypoints: impl Iterator<Item = [f32; 3]>,
    radius: Radius,
) -> Result<(), PrepareError> {
    let keypoints: Vec<[f32; 3]> = keypoints.collect();
    let mut places = Vec::new();
    check_regions(surface.indices.len(), keypoints.len(), |keypoint| {
        find(surface, keypoints[keypoint], [BELOW_ALL, radius.squared], &mut places);
        places.len()
    })
}

/// The histograms of all keypoints that have enough neighbours, one after the other. The histogram sums to 200 for each
/// part, as PCL counts in per cent of unordered pairs. The time grows with the square of the neighbours.
pub(super) fn rows(
    surface: &Surface,
    colours: &[[u8; 3]],
    keypoints: impl Iterator<Item = ([f32; 3], [u8; 3])>,
    radius: Radius,
) -> Vec<f32> {
    let keypoints = keypoints.map(|(keypoint, _)| keypoint);
    rows_in_parts(surface, colours, keypoints, radius, [CODES_AT_ONCE, NEIGHBOURS_AT_ONCE])
}

/// [`rows`] with so many codes and neighbours at once, which do not change them.
pub(super) fn rows_in_parts(
    surface: &Surface,
    colours: &[[u8; 3]],
    keypoints: impl Iterator<Item = [f32; 3]>,
    radius: Radius,
    [codes_at_once, neighbours_at_once]: [usize; 2],
) -> Vec<f32> {
    let mut counter = Counter::new(surface, colours, codes_at_once);
    let (mut regions, mut places, mut rows) = (Regions::default(), Vec::new(), Vec::new());
    for keypoint in keypoints {
        find(surface, keypoint, [BELOW_ALL, radius.squared], &mut places);
        if places.len() < MIN_NEIGHBOURS {
            continue;
        }
        regions.push(&places);
        if regions.places.len() >= neighbours_at_once || regions.ends.len() == KEYPOINTS_AT_ONCE {
            counter.rows(&std::mem::take(&mut regions), &mut rows);
        }
    }
    counter.rows(&regions, &mut rows);
    rows
}

/// The neighbours of several keypoints, by their places on the surface, ascending.
#[derive(Default)]
struct Regions {
    places: Vec<u32>,
    /// Where the neighbours of each keypoint end.
    ends: Vec<usize>,
}

impl Regions {
    fn push(&mut self, places: &[u32]) {
        self.places.extend(places);
        self.ends.push(self.places.len());
    }

    fn iter(&self) -> impl Iterator<Item = &[u32]> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, &end)| &self.places[start..end])
    }
}

/// Counts the pairs of regions.
///
/// Regions of keypoints that are near to each other share most of their pairs, whose codes depend on nothing else: codes
/// are computed once for all regions, a block of points with all after them at a time, and then only counted.
struct Counter<'a> {
    surface: &'a Surface,
    /// Red, green and blue of the surface's points.
    channels: [Vec<u8>; 3],
    codes_at_once: usize,
    /// The points that codes are of.
    points: Neighbourhood,
    of_points: [Vec<u8>; 3],
    codes: Vec<u32>,
    /// Which of the points of several regions each point of the surface is.
    numbers: Vec<u32>,
    counts: Counts,
}

impl<'a> Counter<'a> {
    fn new(surface: &'a Surface, colours: &[[u8; 3]], codes_at_once: usize) -> Self {
        Self {
            surface,
            channels: [0, 1, 2].map(|channel| colours.iter().map(|colour| colour[channel]).collect()),
            codes_at_once,
            points: Neighbourhood::default(),
            of_points: Default::default(),
            codes: Vec::new(),
            numbers: vec![0; colours.len()],
            counts: Counts::default(),
        }
    }

    /// Appends the histograms of regions.
    fn rows(&mut self, regions: &Regions, rows: &mut Vec<f32>) {
        let mut totals = vec![[0; SIZE]; regions.ends.len()];
        for block in self.blocks(regions) {
            self.add_block(regions, block, &mut totals);
        }
        for (region, totals) in regions.iter().zip(totals) {
            let pairs = region.len() as f64 * (region.len() - 1) as f64 / 2.0;
            rows.extend(totals.map(|count: u64| (count as f64 * (100.0 / pairs)) as f32));
        }
    }

    /// Blocks of the surface's points with about as many codes as are kept at once, if regions that share a point have
    /// no more than sixteen times as many points as the largest: on a plane, four regions side by side each way.
    fn blocks(&self, regions: &Regions) -> impl Iterator<Item = Range<u32>> + use<> {
        let places = || regions.places.iter().copied();
        let first = places().min().unwrap_or(0) as usize;
        let end = places().max().map_or(0, |last| last as usize + 1);
        let largest = regions.iter().map(<[u32]>::len).max().unwrap_or(0);
        let length = self.codes_at_once / (end - first).min(16 * largest).max(1);
        let length = length.clamp(1, (end - first).max(1));
        (first..end).step_by(length).map(move |first| first as u32..(first + length).min(end) as u32)
    }

    /// Counts the pairs whose first point is in a block.
    fn add_block(&mut self, regions: &Regions, block: Range<u32>, totals: &mut [[u64; SIZE]]) {
        let from_block =
            regions.iter().map(|region| &region[region.partition_point(|&place| place < block.start)..]);
        let in_block = |part: &[u32]| part.partition_point(|&place| place < block.end);
        let parts: Vec<(usize, &[u32])> =
            from_block.enumerate().filter(|(_, part)| in_block(part) > 0).collect();
        if parts.is_empty() {
            return;
        }
        let union = self.number(&parts);
        let of_union = in_block(&union) * union.len();
        let of_parts: usize = parts.iter().map(|(_, part)| in_block(part) * part.len()).sum();
        let mut numbers: Vec<u32> = Vec::new();
        // Regions that share little have fewer pairs one by one than all of their points have together.
        if of_union <= of_parts.min(self.codes_at_once) {
            self.compute_codes(in_block(&union), union);
            for (region, part) in parts {
                numbers.clear();
                numbers.extend(part.iter().map(|&place| self.numbers[place as usize]));
                self.count(&numbers, in_block(part));
                self.counts.move_to(&mut totals[region]);
            }
        } else {
            for (region, part) in parts {
                self.compute_codes(in_block(part), part.to_vec());
                for one in 0..in_block(part) {
                    let row = codes_of(&self.codes, &self.points, one);
                    self.counts.add_all(&row[one + 1..part.len()]);
                }
                self.counts.move_to(&mut totals[region]);
            }
        }
    }

    /// The places of all points of these parts of regions, ascending, and where among them each is.
    fn number(&mut self, parts: &[(usize, &[u32])]) -> Vec<u32> {
        const NONE: u32 = u32::MAX;
        let first = parts.iter().filter_map(|(_, part)| part.first()).min().copied().unwrap_or(0);
        let last = parts.iter().filter_map(|(_, part)| part.last()).max().copied().unwrap_or(0);
        let numbers = &mut self.numbers[first as usize..=last as usize];
        numbers.fill(NONE);
        for &place in parts.iter().flat_map(|(_, part)| *part) {
            numbers[(place - first) as usize] = 0;
        }
        let mut places = Vec::new();
        for (place, number) in (first..).zip(numbers).filter(|(_, number)| **number != NONE) {
            *number = places.len() as u32;
            places.push(place);
        }
        places
    }

    /// Computes the codes of so many of the points at these places, each with those after it.
    fn compute_codes(&mut self, rows: usize, places: Vec<u32>) {
        self.points.copy(self.surface, places);
        for (values, list) in self.channels.iter().zip(&mut self.of_points) {
            self.points.take(values, list);
        }
        self.codes.resize(self.codes.len().max(rows * row_length(self.points.len())), 0);
        widest(PairCodes {
            points: &self.points,
            channels: self.of_points.each_ref().map(Vec::as_slice),
            rows,
            codes: &mut self.codes,
        });
    }

    /// Counts the pairs of a region's points, by their numbers, whose first is one of the first so many.
    fn count(&mut self, numbers: &[u32], rows: usize) {
        for (index, &one) in numbers[..rows].iter().enumerate() {
            let row = codes_of(&self.codes, &self.points, one as usize);
            self.counts.add(row, &numbers[index + 1..]);
        }
    }
}

/// The row of one of these points.
fn codes_of<'a>(codes: &'a [u32], points: &Neighbourhood, one: usize) -> &'a [u32] {
    let length = row_length(points.len());
    &codes[one * length..][..length]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Cloud;
    use crate::prepare::Normals;
    use crate::random::stream;
    use crate::surface::SORTED_ABOVE;
    use rand::seq::SliceRandom;

    /// Small regions that share nothing, of a cloud whose order says nothing about where its points are: codes of all of a
    /// block's regions together would take hundreds of times as much.
    #[test]
    fn no_more_codes_are_kept_than_asked_for() {
        let place = |index: u32| [0.002 * (index % 120) as f32, 0.002 * (index / 120) as f32, 0.5];
        let mut points: Vec<[f32; 3]> = (0..120 * 120).map(place).collect();
        points.shuffle(&mut stream(1, "test", &[]));
        let keypoints: Vec<[f32; 3]> =
            (0..24 * 24).map(|index| [0.01 * (index % 24) as f32, 0.01 * (index / 24) as f32, 0.5]).collect();
        let normals = Normals { cloud: vec![Some([0.0, 0.0, -1.0]); points.len()], keypoints: Vec::new() };
        let colours = vec![[1, 2, 3]; points.len()];
        let cloud = Cloud { points, colours: None, viewpoint: [0.0; 3] };
        let surface = Surface::new(&cloud, &normals, 0.005, SORTED_ABOVE).unwrap();
        let (mut regions, mut places) = (Regions::default(), Vec::new());
        for keypoint in keypoints {
            find(&surface, keypoint, [BELOW_ALL, 0.005 * 0.005], &mut places);
            assert!(places.len() >= MIN_NEIGHBOURS);
            regions.push(&places);
        }
        for codes_at_once in [1 << 14, CODES_AT_ONCE] {
            let mut counter = Counter::new(&surface, &colours, codes_at_once);
            counter.rows(&regions, &mut Vec::new());
            // Rows are longer by what a kernel may write beyond their end.
            assert!(counter.codes.len() <= 3 * codes_at_once, "{} of {codes_at_once}", counter.codes.len());
        }
    }
}
