//! The channels of a winner that is a structure: which pairs of points each looks at, and in how many bins.

use crate::report::figure::{Axis, Colour, Dash, Figure, Numbers, Panel, Series, Symbol};
use crate::report::table::TableBlock;

/// A channel of a structure, as a report shows it.
#[derive(Clone, Debug, PartialEq)]
pub struct WinnerChannel {
    /// What it does, in a line.
    pub text: String,
    /// Which pairs it looks at.
    pub pairs: ChannelPairs,
    /// What it bins, and into how many bins each.
    pub features: Vec<(String, u32)>,
    /// Values of a row.
    pub values: u64,
    /// What its distances are multiplied by.
    pub weight: f64,
    /// Radius of a keypoint's neighbourhood, centimetres; above 0.
    pub radius_cm: f64,
    /// Outer bounds of the shells by pair distance, centimetres, ascending; at least one.
    pub shells_cm: Vec<f64>,
    /// Smallest distance of a pair, centimetres.
    pub least_cm: f64,
    /// Edge of the keypoint grid, centimetres; 0 without keypoints.
    pub grid_cm: f64,
}

/// Which pairs a channel looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChannelPairs {
    /// A keypoint and a point.
    KeypointNeighbour,
    /// Two points near a keypoint.
    Neighbours,
    /// Two keypoints.
    Keypoints,
    /// Any two points.
    Cloud,
}

/// Width and height of a panel: its axes are a square.
pub(super) const SIDE: u32 = 354;
/// Points that a schematic has of a cloud.
const POINTS: usize = 160;
/// Keypoints across a radius, at most.
const KEYPOINTS: f64 = 7.0;
/// Pairs that it shows.
const PAIRS: usize = 14;
/// How much of the surroundings it shows, in radii.
const VIEW: f64 = 1.2;
/// Cosine and sine of the golden angle: points turned by it lie evenly.
const GOLDEN: [f64; 2] = [-0.737_368_878_078_320_1, 0.675_490_294_261_524];
/// Cosine and sine of 3 degrees, the step of circles.
const STEP: [f64; 2] = [0.998_629_534_754_573_8, 0.052_335_956_242_943_83];
/// Steps in a turn.
const STEPS: usize = 120;
/// Steps of the shortest piece of a circle that is worth a line.
const SHORTEST: usize = 8;

type Point = [f64; 2];

/// A panel a channel, its pairs to scale.
pub(crate) fn pairs(channels: &[WinnerChannel]) -> Figure {
    let panels = (1..).zip(channels).map(|(number, channel)| panel(number, channel)).collect();
    let caption = "Which pairs of points each channel of the winner counts, to scale, with points that stand for any \
                   cloud. Pairs are those of one point with others, whose distances lie between the smallest and the \
                   outermost bound; each shell is a histogram of its own. Keypoints lie as far apart as their grid, or \
                   further where they would be too many to see.";
    Figure {
        id: "channels".to_owned(),
        title: "Pairs of the winner’s channels".to_owned(),
        caption: caption.to_owned(),
        panels,
        columns: 2,
        numbers: Numbers::Below,
    }
}

/// The bins of each feature, channel by channel.
pub(crate) fn bins(channels: &[WinnerChannel]) -> Figure {
    let (mut names, mut series) = (Vec::new(), Vec::new());
    for (number, channel) in channels.iter().enumerate() {
        let first = names.len();
        names.extend(channel.features.iter().map(|(feature, _)| format!("{}: {feature}", number + 1)));
        let bar = |(row, (_, bins)): (usize, &(String, u32))| {
            let row = (first + row) as f64;
            [[0.0, row], [f64::from(*bins), row]]
        };
        let name = format!("channel {}: {} values", number + 1, channel.values);
        let bars = channel.features.iter().enumerate().map(bar).collect();
        series.push(Series::segments(&name, Colour::nth(number), 11, bars));
    }
    let height = 90 + 22 * u32::try_from(names.len()).unwrap_or(0);
    let (x, y) = (Axis::numbers("bins", "").including(0.0), Axis::names("feature", names));
    let panel = Panel { title: String::new(), x, y, series, height };
    let caption = "How finely each channel of the winner bins what it looks at. Joint features have a bin for each \
                   combination of theirs.";
    Figure::single("channel-bins", "Bins of the winner’s channels", caption, panel)
}

/// What each channel does, in words.
pub(crate) fn table(channels: &[WinnerChannel]) -> TableBlock {
    let row = |(number, channel): (usize, &WinnerChannel)| {
        vec![
            number.to_string(),
            channel.text.clone(),
            channel.values.to_string(),
            format!("{:.3}", channel.weight),
        ]
    };
    TableBlock {
        caption: "The winner’s channels. A distance of two clouds is the sum of the channels’, each times its weight and \
                  divided by its scale."
            .to_owned(),
        head: ["channel", "what it counts", "values", "weight"].map(str::to_owned).to_vec(),
        rows: (1..).zip(channels).map(row).collect(),
        texts: 2,
    }
}

/// What is drawn of a channel, in centimetres about a keypoint, or about a place of the cloud.
struct Sketch {
    points: Vec<Point>,
    keypoints: Vec<Point>,
    /// The point whose pairs are drawn.
    first: Point,
    pairs: Vec<[Point; 2]>,
    /// Half of the side of what is seen.
    view: f64,
}

impl Sketch {
    fn new(channel: &WinnerChannel) -> Self {
        let radius = channel.radius_cm;
        let view = VIEW * radius;
        let spread = spread(view);
        let keypoints = || lattice(view, channel.grid_cm.max(radius / KEYPOINTS));
        let from = |first: Point, others: &[Point], is_near: &dyn Fn(Point) -> bool| -> Vec<[Point; 2]> {
            let met: Vec<[Point; 2]> = others
                .iter()
                .filter(|&&other| is_near(other) && channel.counts(first, other))
                .map(|&other| [first, other])
                .collect();
            // Evenly from the nearest to the furthest: the points are in the order of their distance from the middle.
            let every = met.len().div_ceil(PAIRS).max(1);
            met.into_iter().step_by(every).collect()
        };
        let origin = [0.0; 2];
        match channel.pairs {
            ChannelPairs::KeypointNeighbour => {
                let pairs = from(origin, &spread, &|other| distance(origin, other) <= radius);
                Self { points: spread, keypoints: keypoints(), first: origin, pairs, view }
            }
            ChannelPairs::Neighbours => {
                let first = spread[POINTS / 7];
                let pairs = from(first, &spread, &|other| distance(origin, other) <= radius);
                Self { points: spread, keypoints: vec![origin], first, pairs, view }
            }
            ChannelPairs::Keypoints => {
                let keypoints = keypoints();
                let pairs = from(origin, &keypoints, &|_| true);
                Self { points: Vec::new(), keypoints, first: origin, pairs, view }
            }
            ChannelPairs::Cloud => {
                let pairs = from(origin, &spread, &|_| true);
                Self { points: spread, keypoints: Vec::new(), first: origin, pairs, view }
            }
        }
    }
}

impl WinnerChannel {
    fn counts(&self, first: Point, second: Point) -> bool {
        let (apart, longest) =
            (distance(first, second), self.shells_cm.last().copied().unwrap_or(self.radius_cm));
        apart > 0.0 && (self.least_cm..=longest).contains(&apart)
    }
}

fn panel(number: usize, channel: &WinnerChannel) -> Panel {
    let Sketch { points, keypoints, first, pairs, view } = Sketch::new(channel);
    let mut series = vec![
        Series::points("points", Colour::Grey, Symbol::Dot, points),
        Series::segments("pairs", Colour::Sky, 1, pairs),
    ];
    let mut circles = |name: &str, colour, dash, centre, radius| {
        let arcs = arcs(centre, radius, view).into_iter();
        series.extend(arcs.map(|arc| Series::dashed(name, colour, dash, arc)));
    };
    if channel.pairs == ChannelPairs::Neighbours {
        circles("radius about a keypoint", Colour::Black, Dash::Solid, [0.0; 2], channel.radius_cm);
    }
    for &bound in &channel.shells_cm {
        circles("bounds of shells", Colour::Blue, Dash::Dashed, first, bound);
    }
    if channel.least_cm > 0.0 {
        circles("smallest distance", Colour::Vermillion, Dash::Dotted, first, channel.least_cm);
    }
    series.push(Series::points("keypoints", Colour::Black, Symbol::Triangle, keypoints));
    let axis = || Axis::numbers("offset", "cm").including(-view).including(view);
    let features: Vec<String> =
        channel.features.iter().map(|(feature, bins)| format!("{feature} {bins}")).collect();
    let title = format!("{number}: {}, weight {:.3}", features.join(" · "), channel.weight);
    Panel { title, x: axis(), y: axis(), series, height: SIDE }
}

fn distance(a: Point, b: Point) -> f64 {
    let [x, y] = [a[0] - b[0], a[1] - b[1]];
    (x * x + y * y).sqrt()
}

fn turned([x, y]: Point, [cos, sin]: [f64; 2]) -> Point {
    [x * cos - y * sin, x * sin + y * cos]
}

/// Points that fill a disk evenly, from its middle outwards.
fn spread(radius: f64) -> Vec<Point> {
    let mut direction = [1.0, 0.0];
    let point = |index: usize| {
        direction = turned(direction, GOLDEN);
        let away = radius * ((index as f64 + 0.5) / POINTS as f64).sqrt();
        direction.map(|part| part * away)
    };
    (0..POINTS).map(point).collect()
}

/// The places of a square lattice about the origin, as far as they are seen, those in the middle first.
fn lattice(view: f64, edge: f64) -> Vec<Point> {
    let most = (view / edge).floor() as i32;
    let places = (-most..=most).flat_map(|y| (-most..=most).map(move |x| [x, y]));
    let mut points: Vec<Point> = places.map(|place| place.map(|part| f64::from(part) * edge)).collect();
    points.sort_by(|a, b| distance([0.0; 2], *a).total_cmp(&distance([0.0; 2], *b)));
    points
}

/// A circle, as far as it is seen: the pieces of it.
pub(super) fn arcs(centre: Point, radius: f64, view: f64) -> Vec<Vec<Point>> {
    let mut direction = [radius, 0.0];
    let mut arcs: Vec<Vec<Point>> = vec![Vec::new()];
    for _ in 0..=STEPS {
        let point = [centre[0] + direction[0], centre[1] + direction[1]];
        let is_seen = point.iter().all(|part| part.abs() <= view);
        match arcs.last_mut() {
            Some(arc) if is_seen => arc.push(point),
            Some(arc) if !arc.is_empty() => arcs.push(Vec::new()),
            _ => {}
        }
        direction = turned(direction, STEP);
    }
    arcs.retain(|arc| arc.len() >= SHORTEST);
    arcs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::figure::Marks;

    fn channel(pairs: ChannelPairs) -> WinnerChannel {
        WinnerChannel {
            text: "some".to_owned(),
            pairs,
            features: vec![("d".to_owned(), 5), ("hue".to_owned(), 7)],
            values: 70,
            weight: 0.5,
            radius_cm: 4.0,
            shells_cm: if pairs == ChannelPairs::Neighbours { vec![4.0, 8.0] } else { vec![2.0, 4.0] },
            least_cm: 1.0,
            grid_cm: if pairs == ChannelPairs::Cloud { 0.0 } else { 1.5 },
        }
    }

    const ALL: [ChannelPairs; 4] = [
        ChannelPairs::KeypointNeighbour,
        ChannelPairs::Neighbours,
        ChannelPairs::Keypoints,
        ChannelPairs::Cloud,
    ];

    #[test]
    fn pairs_are_as_long_as_the_channel_allows_and_end_where_they_may() {
        for pairs in ALL {
            let of = channel(pairs);
            let sketch = Sketch::new(&of);
            assert!((5..=PAIRS).contains(&sketch.pairs.len()), "{pairs:?}: {} pairs", sketch.pairs.len());
            for &[first, second] in &sketch.pairs {
                let apart = distance(first, second);
                let longest = if pairs == ChannelPairs::Neighbours { 8.0 } else { 4.0 };
                assert!((1.0..=longest).contains(&apart), "{pairs:?}: {apart}");
                let (is_point, is_keypoint) = (
                    |place: &Point| sketch.points.contains(place),
                    |place: &Point| sketch.keypoints.contains(place),
                );
                match pairs {
                    ChannelPairs::KeypointNeighbour => assert!(is_keypoint(&first) && is_point(&second)),
                    ChannelPairs::Keypoints => assert!(is_keypoint(&first) && is_keypoint(&second)),
                    ChannelPairs::Cloud => assert!(is_point(&second)),
                    ChannelPairs::Neighbours => {
                        assert!(is_point(&first) && is_point(&second));
                        assert!([first, second].iter().all(|&place| distance(place, [0.0; 2]) <= 4.0));
                    }
                }
            }
        }
    }

    #[test]
    fn circles_have_their_radius_and_end_where_nothing_is_seen() {
        let [whole] = &arcs([0.0; 2], 2.0, 4.0)[..] else { panic!("one circle") };
        assert_eq!(whole.len(), STEPS + 1);
        assert!(whole.iter().all(|&point| (distance(point, [0.0; 2]) - 2.0).abs() < 1e-9));
        assert!(distance(whole[0], whole[STEPS]) < 1e-9, "a whole turn");
        let cut = arcs([3.0, 0.0], 2.0, 4.0);
        let seen: usize = cut.iter().map(Vec::len).sum();
        assert!(seen > STEPS / 2 && seen < STEPS, "{seen} points");
        assert!(cut.iter().flatten().all(|point| point[0] <= 4.0));
        assert!(arcs([0.0; 2], 9.0, 4.0).is_empty());
    }

    #[test]
    fn keypoints_lie_as_far_apart_as_their_grid_unless_they_would_be_too_many() {
        let near = |channel: &WinnerChannel| {
            let keypoints = Sketch::new(channel).keypoints;
            let others = keypoints.iter().skip(1).map(|&point| distance(keypoints[0], point));
            (others.fold(f64::INFINITY, f64::min), keypoints.len())
        };
        assert_eq!(near(&channel(ChannelPairs::Keypoints)).0, 1.5);
        let (apart, count) = near(&WinnerChannel { grid_cm: 0.1, ..channel(ChannelPairs::Keypoints) });
        assert!(apart > 0.5 && count < 400, "{count} keypoints {apart} apart");
    }

    #[test]
    fn there_is_a_panel_a_channel_and_a_bar_a_feature() {
        let channels = ALL.map(channel);
        let figure = pairs(&channels);
        assert_eq!(figure.panels.len(), 4);
        assert_eq!(figure.panels[1].title, "2: d 5 · hue 7, weight 0.500");
        let figure = bins(&channels);
        let ends = figure.panels[0].series.iter().flat_map(|series| match &series.marks {
            Marks::Segments { ends, .. } => ends.clone(),
            other => panic!("{other:?}"),
        });
        let ends: Vec<[Point; 2]> = ends.collect();
        assert_eq!(ends.len(), 8);
        assert_eq!(ends[3], [[0.0, 3.0], [7.0, 3.0]]);
        assert_eq!(table(&channels).rows[3], ["4", "some", "70", "0.500"]);
        assert!(pairs(&[]).is_empty() && bins(&[]).is_empty());
    }
}
