//! Where the channels of a descriptor look on one cloud: regions about a keypoint in its middle, and pairs they count.

use descriptor::keypoints::Keypoints;
use descriptor::structure::{Pairs, StructureChannel};
use descriptor::{Cloud, Descriptor, PrepareError, Preprocess};
use results::{SeenChannel, SeenCloud, SeenPairs, SeenRegion, ShownCloud};

use super::points::DecimatedCloud;

/// Points that are drawn of a cloud, and about its keypoint.
const POINTS: usize = 1200;
/// Pairs that are drawn of a channel.
const PAIRS: usize = 40;
/// Pairs that are looked at for each that is drawn.
const TRIES: usize = 200;
/// How far what is drawn about the keypoint reaches, in radii of the outermost region.
const AROUND: f64 = 2.0;

/// What the channels of a descriptor look at on a cloud (in metres), which is called `name` and shows `object`.
///
/// # Errors
/// If keypoints cannot be placed on it.
pub(super) fn reach(
    descriptor: &Descriptor,
    preprocess: &Preprocess,
    cloud: &Cloud,
    [name, object]: [&str; 2],
) -> Result<SeenCloud, PrepareError> {
    let structure: &[_] = match descriptor {
        Descriptor::Structure(structure) => &structure.channels,
        _ => &[],
    };
    // Of a structure, channels have grids of their own: the regions of all are drawn about one keypoint.
    let leaf_um = structure.iter().map(|weighted| weighted.channel.grid_um).find(|&um| um > 0);
    let keypoints = keypoints(cloud, preprocess, leaf_um.unwrap_or(preprocess.leaf_um))?;
    let keypoint = middle(&keypoints).unwrap_or_default();
    let away = |place: &[f32; 3]| 100.0 * distance(*place, keypoint);
    let mut channels = Vec::new();
    for (index, layout) in descriptor.layouts().into_iter().enumerate() {
        let region = |region: descriptor::Region| {
            let descriptor::Region { name, inner_cm, outer_cm } = region;
            let mut seen = SeenRegion { name, inner_cm, outer_cm, points: 0 };
            let points = cloud.points.iter().filter(|place| seen.holds(away(place))).count();
            seen.points = u32::try_from(points).unwrap_or(u32::MAX);
            seen
        };
        let regions = layout.regions.into_iter().map(region).collect();
        let pairs = match structure.get(index) {
            Some(weighted) => pairs(&weighted.channel, preprocess, cloud, keypoint)?,
            None => None,
        };
        channels.push(SeenChannel { name: layout.name, regions, pairs });
    }
    let outermost = channels.iter().flat_map(|channel| &channel.regions).map(|region| region.outer_cm);
    let around = AROUND * outermost.fold(0.0, f64::max);
    let shown = |cloud: &Cloud, total: usize| {
        let DecimatedCloud { points, colours, .. } = DecimatedCloud::new(cloud, POINTS);
        let (name, object) = (name.to_owned(), object.to_owned());
        ShownCloud { name, object, points, colours, total: u32::try_from(total).unwrap_or(u32::MAX) }
    };
    let near = part(cloud, |place| away(place) <= around);
    Ok(SeenCloud { cloud: shown(cloud, cloud.len()), near: shown(&near, cloud.len()), keypoint, channels })
}

/// Some of the pairs that a channel counts, if they are not those of the keypoint with each point of its regions.
fn pairs(
    channel: &StructureChannel,
    preprocess: &Preprocess,
    cloud: &Cloud,
    keypoint: [f32; 3],
) -> Result<Option<SeenPairs>, PrepareError> {
    let metres = |um: u32| f64::from(um) / 1e6;
    let longest = channel.shells_um.last().copied().unwrap_or_else(|| channel.longest_um());
    let bounds = [metres(channel.least_um), metres(longest.min(channel.longest_um()))];
    let counts = |[a, b]: [[f32; 3]; 2]| {
        let apart = distance(a, b);
        apart > 0.0 && (bounds[0]..=bounds[1]).contains(&apart)
    };
    let (of, keypoints, some) = match channel.pairs {
        Pairs::KeypointNeighbour => return Ok(None),
        Pairs::Neighbours => {
            let near = part(cloud, |place| distance(*place, keypoint) <= metres(channel.radius_um));
            ("neighbours", Vec::new(), spread_pairs(&near.points, counts))
        }
        Pairs::Keypoints => {
            let all = keypoints(cloud, preprocess, channel.grid_um)?;
            let first = middle(&all).unwrap_or_default();
            let some = all.iter().map(|&other| [first, other]).filter(|&pair| counts(pair)).collect();
            ("keypoints", all, every(some))
        }
        Pairs::Cloud => ("points", Vec::new(), spread_pairs(&cloud.points, counts)),
    };
    let within_cm = bounds.map(|metres| 100.0 * metres);
    Ok(Some(SeenPairs { of: of.to_owned(), within_cm, keypoints, some }))
}

/// Keypoints of a voxel grid, if there are points enough to place any.
fn keypoints(cloud: &Cloud, preprocess: &Preprocess, leaf_um: u32) -> Result<Vec<[f32; 3]>, PrepareError> {
    Ok(Keypoints::new(cloud, Preprocess { leaf_um, ..*preprocess }.leaf())?.points)
}

/// The place that is nearest to the mean of all.
fn middle(places: &[[f32; 3]]) -> Option<[f32; 3]> {
    let sums = places.iter().fold([0.0; 3], |sums: [f64; 3], place| {
        std::array::from_fn(|axis| sums[axis] + f64::from(place[axis]))
    });
    let mean = sums.map(|sum| (sum / places.len().max(1) as f64) as f32);
    places.iter().copied().min_by(|&a, &b| distance(a, mean).total_cmp(&distance(b, mean)))
}

/// Pairs of places all over the cloud that are counted: by steps that never come round to the same place soon.
fn spread_pairs(places: &[[f32; 3]], counts: impl Fn([[f32; 3]; 2]) -> bool) -> Vec<[[f32; 3]; 2]> {
    // Odd numbers near the golden section of 2^32, and of its root: remainders by either are spread evenly.
    let place = |step: u32, of: u32| places[step.wrapping_mul(of) as usize % places.len()];
    let tries = if places.is_empty() { 0 } else { (PAIRS * TRIES) as u32 };
    let tried = (1..=tries).map(|step| [place(step, 2_654_435_769), place(step, 3_242_174_889)]);
    tried.filter(|&pair| counts(pair)).take(PAIRS).collect()
}

/// At most [`PAIRS`] of them, evenly chosen.
fn every<T>(all: Vec<T>) -> Vec<T> {
    let step = all.len().div_ceil(PAIRS).max(1);
    all.into_iter().step_by(step).collect()
}

/// The points of a cloud for which something holds.
fn part(cloud: &Cloud, holds: impl Fn(&[f32; 3]) -> bool) -> Cloud {
    let kept: Vec<usize> = (0..cloud.points.len()).filter(|&index| holds(&cloud.points[index])).collect();
    let colours = cloud.colours.as_ref().map(|colours| kept.iter().map(|&index| colours[index]).collect());
    Cloud {
        points: kept.iter().map(|&index| cloud.points[index]).collect(),
        colours,
        viewpoint: cloud.viewpoint,
    }
}

/// Metres.
fn distance(a: [f32; 3], b: [f32; 3]) -> f64 {
    let along = |axis: usize| f64::from(a[axis]) - f64::from(b[axis]);
    [0, 1, 2].map(|axis| along(axis) * along(axis)).iter().sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use descriptor::Family;
    use descriptor::structure::Structure;

    use super::*;

    /// A sheet of 60 by 60 points, 2 mm apart, half a metre before the camera.
    fn sheet() -> Cloud {
        let place = |n: u16| [f32::from(n % 60) * 0.002, f32::from(n / 60) * 0.002, 0.5];
        let colours = (0..3600_u16).map(|n| [n as u8, (n >> 8) as u8, 9]).collect();
        Cloud { points: (0..3600).map(place).collect(), colours: Some(colours), viewpoint: [0.0; 3] }
    }

    fn seen(descriptor: &Descriptor) -> SeenCloud {
        reach(descriptor, &Preprocess::default(), &sheet(), ["a/1.pcd", "a"]).unwrap()
    }

    #[test]
    fn points_of_the_disk_and_the_ring_are_those_of_the_whole_cloud_within_their_radii() {
        let descriptor = Descriptor::default_of(Family::DiskRing);
        let seen = seen(&descriptor);
        assert_eq!((seen.cloud.total, seen.channels.len()), (3600, 2));
        assert!(seen.cloud.points.len() <= POINTS && seen.near.points.len() > seen.cloud.points.len() / 3);
        for channel in &seen.channels {
            assert!(channel.pairs.is_none());
            let [disk, ring] = &channel.regions[..] else { panic!("{:?}", channel.regions) };
            let inside = |least: f64, most: f64| {
                let squared = |place: &[f32; 3]| {
                    let along = |axis: usize| f64::from(place[axis] - seen.keypoint[axis]);
                    along(0) * along(0) + along(1) * along(1) + along(2) * along(2)
                };
                sheet()
                    .points
                    .iter()
                    .filter(|place| (least * least..=most * most).contains(&squared(place)))
                    .count()
            };
            assert_eq!(disk.points as usize, inside(0.0, disk.outer_cm / 100.0));
            assert_eq!(ring.points as usize, inside(disk.outer_cm / 100.0 + 1e-9, ring.outer_cm / 100.0));
            assert!(disk.points > 10 && ring.points > disk.points);
        }
    }

    #[test]
    fn pairs_of_each_kind_of_channel_are_as_long_as_it_allows_and_lie_where_it_looks() {
        let mut structure = Structure::default();
        let base = structure.channels[0].clone();
        structure.channels = Pairs::ALL
            .into_iter()
            .map(|pairs| {
                let mut weighted = base.clone();
                weighted.channel.pairs = pairs;
                weighted.channel.radius_um = 40_000;
                weighted.channel.shells_um = vec![30_000];
                weighted.channel.least_um = 5_000;
                weighted.channel.grid_um = if pairs == Pairs::Cloud { 0 } else { 10_000 };
                weighted
            })
            .collect();
        let seen = seen(&Descriptor::Structure(structure));
        let pairs: Vec<Option<&SeenPairs>> =
            seen.channels.iter().map(|channel| channel.pairs.as_ref()).collect();
        assert!(pairs[0].is_none() && !seen.channels[0].regions.is_empty());
        for (kind, pairs) in Pairs::ALL.into_iter().zip(pairs).skip(1) {
            let pairs = pairs.unwrap();
            assert!((PAIRS / 2..=PAIRS).contains(&pairs.some.len()), "{kind:?}: {}", pairs.some.len());
            assert_eq!(pairs.keypoints.is_empty(), kind != Pairs::Keypoints);
            for &[a, b] in &pairs.some {
                assert!((0.005..=0.03).contains(&distance(a, b)), "{kind:?}: {}", distance(a, b));
                match kind {
                    Pairs::Neighbours => {
                        assert!([a, b].iter().all(|&end| distance(end, seen.keypoint) <= 0.04))
                    }
                    Pairs::Keypoints => assert!(pairs.keypoints.contains(&a) && pairs.keypoints.contains(&b)),
                    _ => assert!(sheet().points.contains(&a) && sheet().points.contains(&b)),
                }
            }
        }
        // All over the cloud, not in one corner of it.
        let ends: Vec<[f32; 3]> =
            seen.channels[3].pairs.iter().flat_map(|pairs| &pairs.some).flatten().copied().collect();
        for axis in 0..2 {
            let (low, high) = (
                ends.iter().map(|end| end[axis]).fold(1.0, f32::min),
                ends.iter().map(|end| end[axis]).fold(0.0, f32::max),
            );
            assert!(low < 0.03 && high > 0.09, "{low} to {high}");
        }
    }

    #[test]
    fn a_cloud_without_points_is_described_by_none() {
        let empty = Cloud { points: Vec::new(), colours: Some(Vec::new()), viewpoint: [0.0; 3] };
        let descriptor = Descriptor::default_of(Family::DiskRing);
        let seen = reach(&descriptor, &Preprocess::default(), &empty, ["", ""]).unwrap();
        assert!(seen.cloud.points.is_empty() && seen.channels[0].regions[1].points == 0);
    }
}
