//! Where the channels of a winner look on one cloud: regions about a keypoint, and pairs of points.

use crate::report::figure::{Axis, Colour, Dash, Figure, Numbers, Panel, Series, Symbol};
use crate::report::palette::Rgb;
use crate::report::table::TableBlock;
use crate::report::wrong::ShownCloud;

use super::channels::{SIDE, arcs};

/// A cloud with what the channels of a descriptor look at. Places are in metres; the camera looks along +z, y is down.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SeenCloud {
    /// The cloud, with points few enough to be drawn.
    pub cloud: ShownCloud,
    /// The same about the keypoint, closer: with more of the points that lie there.
    pub near: ShownCloud,
    /// The keypoint whose regions are drawn.
    pub keypoint: [f32; 3],
    /// The channels, in their order.
    pub channels: Vec<SeenChannel>,
}

/// What one channel looks at.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SeenChannel {
    /// Its name.
    pub name: String,
    /// The regions about the keypoint; none: it looks at all of the cloud.
    pub regions: Vec<SeenRegion>,
    /// The pairs that it counts, if it counts others than those of the keypoint with the points of its regions.
    pub pairs: Option<SeenPairs>,
}

/// A region about a keypoint.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SeenRegion {
    /// Its name.
    pub name: String,
    /// Distance from the keypoint at which it begins, centimetres.
    pub inner_cm: f64,
    /// Where it ends, centimetres.
    pub outer_cm: f64,
    /// Points of the whole cloud that lie in it.
    pub points: u32,
}

/// Pairs of places.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SeenPairs {
    /// What they are pairs of.
    pub of: String,
    /// Smallest and longest distance of a pair, centimetres.
    pub within_cm: [f64; 2],
    /// The keypoints that they may be of, metres; none if they are of points.
    pub keypoints: Vec<[f32; 3]>,
    /// Some of them, metres.
    pub some: Vec<[[f32; 3]; 2]>,
}

impl SeenRegion {
    /// Whether a point so far from the keypoint, in centimetres, lies in it: beyond its beginning, if that is not the
    /// keypoint itself, and not beyond its end.
    pub fn holds(&self, distance_cm: f64) -> bool {
        (self.inner_cm == 0.0 || distance_cm > self.inner_cm) && distance_cm <= self.outer_cm
    }
}

/// Shares of a colour: so few that points of nearly one colour are drawn together.
const LEVELS: u32 = 8;
/// The darkest and the lightest share: no colour is that of paper or ink, which are others on dark pages.
const DARKEST: u32 = 9;
const LIGHTEST: u32 = 247;
/// How much is seen of points that lie in no region, beside such that do.
const FAINT: f64 = 0.6;
/// How much of the surroundings of the regions is seen where it is looked at closely.
const CLOSE: f64 = 1.3;

type Point = [f64; 2];

/// A panel for each channel that looks elsewhere than those before it.
pub(crate) fn regions(seen: &SeenCloud) -> Figure {
    let groups = groups(&seen.channels);
    let whole = Window::of(&seen.cloud, seen.keypoint);
    let mut panels: Vec<Panel> = groups
        .iter()
        .map(|(names, channel)| panel(names, channel, &seen.cloud, seen.keypoint, whole))
        .collect();
    if let [(names, channel)] = &groups[..]
        && let Some(outermost) = outermost(channel)
    {
        let close = Window { centre: [0.0; 2], half: CLOSE * outermost };
        panels.push(panel(&format!("{names}, closer"), channel, &seen.near, seen.keypoint, close));
    }
    let caption = format!(
        "Where the winner looks, on the training cloud {} ({}), as its camera saw it, with {} of its {} points. Circles end \
         the regions about one keypoint, points in them have a rim of the region’s colour, and the others are faint. Where \
         pairs of other points are counted, lines join some of them.",
        seen.cloud.name,
        seen.cloud.object,
        seen.cloud.points.len(),
        seen.cloud.total
    );
    Figure {
        id: "channels-on-cloud".to_owned(),
        title: "The winner’s channels on a cloud".to_owned(),
        caption,
        panels,
        columns: 2,
        numbers: Numbers::Elsewhere,
    }
}

/// Regions and pairs in numbers.
pub(crate) fn table(seen: &SeenCloud) -> TableBlock {
    let mut rows = Vec::new();
    for channel in &seen.channels {
        let row = |what: &str, [from, to]: [f64; 2], points: String| {
            vec![channel.name.clone(), what.to_owned(), format!("{from:.2}"), format!("{to:.2}"), points]
        };
        for region in &channel.regions {
            rows.push(row(&region.name, [region.inner_cm, region.outer_cm], region.points.to_string()));
        }
        if let Some(pairs) = &channel.pairs {
            rows.push(row(&format!("pairs of {}", pairs.of), pairs.within_cm, String::new()));
        }
        if channel.regions.is_empty() && channel.pairs.is_none() {
            let all = seen.cloud.total.to_string();
            rows.push(vec![channel.name.clone(), "all points".to_owned(), String::new(), String::new(), all]);
        }
    }
    let head = ["channel", "looks at", "from (cm)", "to (cm)", "points"];
    TableBlock {
        caption: "What the winner’s channels look at about that keypoint: distances from the keypoint, or, of pairs, from \
                  each other, and how many points of the cloud lie there."
            .to_owned(),
        head: head.map(str::to_owned).to_vec(),
        rows,
        texts: 2,
    }
}

/// Channels that look at the same, with their names together.
fn groups(channels: &[SeenChannel]) -> Vec<(String, &SeenChannel)> {
    let mut groups: Vec<(String, &SeenChannel)> = Vec::new();
    for channel in channels {
        let is_alike = |(_, other): &&mut (String, &SeenChannel)| {
            (&other.regions, &other.pairs) == (&channel.regions, &channel.pairs)
        };
        match groups.iter_mut().find(is_alike) {
            Some((names, _)) => names.push_str(&format!(", {}", channel.name)),
            None => groups.push((channel.name.clone(), channel)),
        }
    }
    groups
}

/// Where the last region ends, centimetres.
fn outermost(channel: &SeenChannel) -> Option<f64> {
    channel.regions.iter().map(|region| region.outer_cm).reduce(f64::max)
}

/// What is seen: a square, in centimetres from the keypoint.
#[derive(Clone, Copy, Debug)]
struct Window {
    centre: Point,
    half: f64,
}

impl Window {
    /// All of a cloud.
    fn of(cloud: &ShownCloud, keypoint: [f32; 3]) -> Self {
        let ends = |axis: usize| {
            let places = cloud.points.iter().map(|&place| flat(place, keypoint)[axis]);
            let ends =
                places.filter(|place| place.is_finite()).fold(None, |ends: Option<[f64; 2]>, place| {
                    Some(ends.map_or([place; 2], |[low, high]| [low.min(place), high.max(place)]))
                });
            ends.unwrap_or([-1.0, 1.0])
        };
        let ends = [ends(0), ends(1)];
        let half = ends.map(|[low, high]| (high - low) / 2.0);
        Self { centre: ends.map(|[low, high]| (low + high) / 2.0), half: half[0].max(half[1]).max(0.1) }
    }

    fn axis(self, which: usize) -> [f64; 2] {
        [self.centre[which] - self.half, self.centre[which] + self.half]
    }
}

/// A place as the camera sees it, in centimetres to the right of the keypoint and above it.
fn flat(place: [f32; 3], keypoint: [f32; 3]) -> Point {
    let part = |axis: usize| 100.0 * (f64::from(place[axis]) - f64::from(keypoint[axis]));
    [part(0), -part(1)]
}

/// How far a place is from a keypoint, centimetres.
fn distance_cm(place: [f32; 3], keypoint: [f32; 3]) -> f64 {
    let squares = place
        .iter()
        .zip(keypoint)
        .map(|(a, b)| (f64::from(*a) - f64::from(b)) * (f64::from(*a) - f64::from(b)));
    100.0 * squares.sum::<f64>().sqrt()
}

/// The nearest of the colours that points are drawn in.
fn level(rgb: [u8; 3]) -> Rgb {
    rgb.map(|part| {
        let step = (u32::from(part) * (LEVELS - 1) + 127) / 255;
        u8::try_from(DARKEST + step * (LIGHTEST - DARKEST) / (LEVELS - 1)).unwrap_or(u8::MAX)
    })
}

/// Points of a cloud with their colours, those of one colour together.
fn painted(mut points: Vec<(Point, Rgb)>, opacity: f64) -> Series {
    points.sort_by_key(|(_, rgb)| *rgb);
    let (points, colours) = points.into_iter().unzip();
    Series::cloud(points, colours, opacity)
}

fn panel(
    names: &str,
    channel: &SeenChannel,
    cloud: &ShownCloud,
    keypoint: [f32; 3],
    window: Window,
) -> Panel {
    let regions = &channel.regions;
    let region_of = |place: [f32; 3]| {
        let away = distance_cm(place, keypoint);
        regions.iter().position(|region| region.holds(away))
    };
    let (mut within, mut beyond) = (vec![Vec::new(); regions.len()], Vec::new());
    for (&place, &rgb) in cloud.points.iter().zip(&cloud.colours) {
        let point = (flat(place, keypoint), level(rgb));
        match region_of(place) {
            Some(region) => within[region].push(point),
            None => beyond.push(point),
        }
    }
    let mut series = vec![painted(beyond, if regions.is_empty() { 1.0 } else { FAINT })];
    for (index, (region, points)) in regions.iter().zip(&within).enumerate() {
        let name = format!("{}, {} to {} cm", region.name, region.inner_cm, region.outer_cm);
        let places = points.iter().map(|(place, _)| *place).collect();
        series.push(Series::points(&name, Colour::nth(index), Symbol::Circle, places));
    }
    series.push(painted(within.into_iter().flatten().collect(), 1.0));
    if let Some(pairs) = &channel.pairs {
        let ends = pairs.some.iter().map(|pair| pair.map(|place| flat(place, keypoint))).collect();
        series.push(Series::segments("some of the pairs", Colour::Black, 1, ends));
        let others = pairs.keypoints.iter().map(|&place| flat(place, keypoint)).collect();
        series.push(Series::points("keypoints", Colour::Green, Symbol::Triangle, others));
    }
    for (index, region) in regions.iter().enumerate() {
        let circle = arcs([0.0; 2], region.outer_cm, f64::INFINITY).into_iter();
        series.extend(circle.map(|arc| Series::dashed("", Colour::nth(index), Dash::nth(index), arc)));
    }
    if !regions.is_empty() || channel.pairs.as_ref().is_some_and(|pairs| !pairs.keypoints.is_empty()) {
        series.push(Series::points("the keypoint", Colour::Black, Symbol::Triangle, vec![[0.0; 2]]));
    }
    let x = Axis::within("to the right", "cm", window.axis(0));
    let y = Axis::within("upwards", "cm", window.axis(1));
    Panel { title: names.to_owned(), x, y, series, height: SIDE }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::figure::Marks;
    use crate::report::palette::class;

    /// A sheet of 21 by 21 points, 1 cm apart, that faces the camera, about a keypoint in its middle.
    fn seen(channels: Vec<SeenChannel>) -> SeenCloud {
        let place = |n: u16| [f32::from(n % 21) / 100.0, f32::from(n / 21) / 100.0, 0.5];
        let cloud = ShownCloud {
            name: "a/<b>".to_owned(),
            object: "a".to_owned(),
            points: (0..441).map(place).collect(),
            colours: (0..441_u16).map(|n| [n as u8, 0, 255]).collect(),
            total: 9000,
        };
        SeenCloud { near: cloud.clone(), cloud, keypoint: [0.1, 0.1, 0.5], channels }
    }

    fn ring(name: &str) -> SeenChannel {
        let region = |name: &str, inner_cm, outer_cm| SeenRegion {
            name: name.to_owned(),
            inner_cm,
            outer_cm,
            points: 7,
        };
        let regions = vec![region("disk", 0.0, 1.2), region("ring", 1.2, 2.1)];
        SeenChannel { name: name.to_owned(), regions, pairs: None }
    }

    fn points_of<'a>(panel: &'a Panel, name: &str) -> &'a [Point] {
        let found = panel.series.iter().find_map(|series| match &series.marks {
            Marks::Points { points, .. } if series.name.starts_with(name) => Some(points.as_slice()),
            _ => None,
        });
        found.unwrap_or_else(|| panic!("{name}"))
    }

    #[test]
    fn channels_with_the_same_regions_share_a_panel_which_is_drawn_closer_once_more() {
        let figure = regions(&seen(vec![ring("shape"), ring("colour")]));
        let titles: Vec<&str> = figure.panels.iter().map(|panel| &*panel.title).collect();
        assert_eq!(titles, ["shape, colour", "shape, colour, closer"]);
        // Of a grid 1 cm wide, 5 points are within 1.2 cm and 8 more within 2.1 cm.
        for panel in &figure.panels {
            assert_eq!((points_of(panel, "disk, 0 to 1.2 cm").len(), points_of(panel, "ring").len()), (5, 8));
            for [x, y] in points_of(panel, "ring") {
                assert!((1.2..2.1).contains(&(x * x + y * y).sqrt()), "{x} {y}");
            }
            let [x, y] = panel.ranges();
            assert!((x[1] - x[0] - (y[1] - y[0])).abs() < 1e-9, "a circle is a circle");
            let drawn = panel.series.iter().map(|series| match &series.marks {
                Marks::Cloud { points, colours, .. } => {
                    assert_eq!(points.len(), colours.len());
                    points.len()
                }
                _ => 0,
            });
            let drawn: usize = drawn.sum();
            assert_eq!(drawn, 441, "every point once, in its own colour");
        }
        assert!(figure.panels[1].ranges()[0][1] < figure.panels[0].ranges()[0][1]);
    }

    #[test]
    fn pairs_are_lines_and_what_lies_below_the_camera_is_drawn_below() {
        let pairs = SeenPairs {
            of: "points".to_owned(),
            within_cm: [1.0, 30.0],
            keypoints: Vec::new(),
            some: vec![[[0.1, 0.1, 0.5], [0.1, 0.2, 0.5]]],
        };
        let whole = SeenChannel { name: "2: d".to_owned(), regions: Vec::new(), pairs: Some(pairs) };
        let of = seen(vec![ring("1: hue"), whole]);
        let figure = regions(&of);
        assert_eq!(figure.panels.len(), 2);
        let lines = figure.panels[1].series.iter().find_map(|series| match &series.marks {
            Marks::Segments { ends, .. } => Some(ends.clone()),
            _ => None,
        });
        let [[from, to]] = lines.unwrap()[..] else { panic!("one pair") };
        assert_eq!(from, [0.0, 0.0]);
        assert!(to[0].abs() < 1e-6 && (to[1] + 10.0).abs() < 1e-5, "{to:?}");
        let rows = table(&of).rows;
        assert_eq!(rows[1], ["1: hue", "ring", "1.20", "2.10", "7"]);
        assert_eq!(rows[2], ["2: d", "pairs of points", "1.00", "30.00", ""]);
    }

    #[test]
    fn no_colour_of_a_cloud_is_one_that_pages_turn_into_another() {
        let shares = (0..=255_u8).step_by(5);
        for (r, g, b) in shares.clone().flat_map(|r| [(r, r, r), (r, 0, 255), (0, r, 90), (86, 180, r)]) {
            let near = level([r, g, b]);
            assert_eq!(class(near), None, "{near:?}");
            for (part, whole) in near.into_iter().zip([r, g, b]) {
                assert!(part.abs_diff(whole) <= 26, "{part} for {whole}");
            }
        }
    }

    #[test]
    fn a_cloud_without_points_or_channels_is_no_picture() {
        assert!(regions(&SeenCloud::default()).is_empty());
        let none = seen(Vec::new());
        assert!(regions(&none).is_empty() && table(&none).rows.is_empty());
    }
}
