//! Clouds that were taken for those of another object, in 3D: as bytes that the page's viewer reads.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use super::escape::escaped;

/// The triples that a report shows at most.
const MOST: usize = 30;
/// Points of a cloud at most: what can be told apart where it is shown.
const MOST_POINTS: usize = 1200;
/// Points of a cloud at least; where there is no room for so many, fewer triples are shown.
const LEAST_POINTS: usize = 300;
/// Bytes of a cloud beside its points, and of a point.
const HEADER: usize = 24;
const POINT: usize = 9;

/// A cloud, as a report shows it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ShownCloud {
    /// Its name, unique in its data set.
    pub name: String,
    /// The object that it shows.
    pub object: String,
    /// Places in metres. The camera looks along +z, y is down.
    pub points: Vec<[f32; 3]>,
    /// Red, green and blue, one for each point.
    pub colours: Vec<[u8; 3]>,
    /// Points that the cloud has in its file.
    pub total: u32,
}

/// A query that was taken for another object.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WrongClouds {
    /// The query.
    pub query: ShownCloud,
    /// The cloud that was nearest.
    pub answer: ShownCloud,
    /// The nearest cloud of the query's own object, if the database has any.
    pub right: Option<ShownCloud>,
    /// Distance of the query to the answer.
    pub answer_distance: f64,
    /// Distance of the query to the right cloud.
    pub right_distance: Option<f64>,
    /// The channel that decided, if there are several.
    pub decided_by: Option<String>,
}

impl WrongClouds {
    fn clouds(&self) -> impl Iterator<Item = (&'static str, &ShownCloud)> {
        let pair = [("query", &self.query), ("answer", &self.answer)];
        pair.into_iter().chain(self.right.iter().map(|right| ("nearest of its own object", right)))
    }
}

/// The triples as a figure each, and the JSON of their clouds, both together of at most so many bytes. The clouds are
/// numbered in the order of the canvases' attribute `data-cloud`.
pub(crate) fn gallery(wrong: &[WrongClouds], room: usize) -> Option<(String, String)> {
    let mut shown = wrong.len().min(MOST);
    while shown > 0 {
        let (clouds, figures) = figures(&wrong[..shown], wrong.len());
        let names: usize = 4 * clouds.len() + figures.len();
        let each = room.saturating_sub(names) / clouds.len().max(1);
        // Base 64 takes four bytes for three.
        let points = ((each / 4 * 3).saturating_sub(HEADER + 8) / POINT).min(MOST_POINTS);
        let most = clouds.iter().map(|cloud| cloud.points.len()).max().unwrap_or(0);
        if points >= LEAST_POINTS.min(most) {
            let cloud = |cloud: &&ShownCloud| format!("\"{}\"", STANDARD.encode(encoded(cloud, points)));
            let json = clouds.iter().map(cloud).collect::<Vec<_>>().join(",\n");
            return Some((figures, format!("[{json}]")));
        }
        shown -= 1;
    }
    None
}

/// A set distance: four digits after the point are more than descriptors differ by.
fn distance_text(distance: f64) -> String {
    format!("{distance:.4}").replacen('-', "−", 1)
}

/// Each cloud once, and the figures of all triples.
fn figures(wrong: &[WrongClouds], all: usize) -> (Vec<&ShownCloud>, String) {
    let mut places: BTreeMap<&str, usize> = BTreeMap::new();
    let mut clouds = Vec::new();
    let mut out = String::new();
    let more =
        if all > wrong.len() { format!("The first {} of {all}. ", wrong.len()) } else { String::new() };
    // Writing to a String cannot fail.
    let _ = writeln!(
        out,
        "<p>Test clouds that the winner took for another object, those first whose own object was furthest behind: \
         the query, the nearest cloud, and the nearest cloud of the query’s own object, with fewer points than in their \
         files. {more}Drag to turn; the three turn together.</p>\n<noscript><p class=\"missing\">Clouds are drawn by a \
         script, which does not run here.</p></noscript>"
    );
    for (number, triple) in (1..).zip(wrong) {
        let _ = writeln!(out, "<figure class=\"triple\" id=\"wrong-{number}\">\n<div class=\"clouds\">");
        for (role, cloud) in triple.clouds() {
            let place = *places.entry(&cloud.name).or_insert_with(|| {
                clouds.push(cloud);
                clouds.len() - 1
            });
            let distance = match role {
                "query" => None,
                "answer" => Some(triple.answer_distance),
                _ => triple.right_distance,
            };
            let distance =
                distance.map_or_else(String::new, |distance| format!(", at {}", distance_text(distance)));
            let (object, name) = (escaped(&cloud.object), escaped(&cloud.name));
            let _ = writeln!(
                out,
                "<div><canvas data-cloud=\"{place}\" data-label=\"{role}: {object}\">{role}: {object}</canvas>\n\
                 <p><b>{role}</b>{distance}<br>{object}<br><small>{name}</small></p></div>"
            );
        }
        let margin = triple.right_distance.map_or_else(
            || " The database has no cloud of its own object.".to_owned(),
            |right| {
                format!(" Its own object is {} further away.", distance_text(right - triple.answer_distance))
            },
        );
        let decided = triple
            .decided_by
            .as_deref()
            .map_or_else(String::new, |channel| format!(" Most of that is of channel {}.", escaped(channel)));
        let _ = writeln!(
            out,
            "</div>\n<figcaption><b>{} taken for {}.</b>{margin}{decided}</figcaption>\n</figure>",
            escaped(&triple.query.object),
            escaped(&triple.answer.object)
        );
    }
    (clouds, out)
}

/// A cloud of at most so many points as the viewer reads it.
fn encoded(cloud: &ShownCloud, most: usize) -> Vec<u8> {
    let finite = |(place, _): &(&[f32; 3], &[u8; 3])| place.iter().all(|part| part.is_finite());
    let all: Vec<(&[f32; 3], &[u8; 3])> = cloud.points.iter().zip(&cloud.colours).filter(finite).collect();
    let kept = (0..all.len().min(most)).map(|index| all[index * all.len() / all.len().min(most)]);
    let (points, colours): (Vec<[f32; 3]>, Vec<[u8; 3]>) =
        kept.map(|(place, colour)| (*place, *colour)).unzip();
    cloud_bytes(&points, &colours, cloud.total)
}

/// Finite points and their colours as the viewer reads them ([`CLOUD_VIEWER`](super::CLOUD_VIEWER)), little endian: u32
/// number of points, u32 number `total` before some were left out; f32 centre in metres (x, y, z), f32 metres per unit;
/// i16 place of each point in units from the centre; u8 red, green and blue of each.
pub fn cloud_bytes(points: &[[f32; 3]], colours: &[[u8; 3]], total: u32) -> Vec<u8> {
    let axis = |axis: usize| {
        let ends = points.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], place| {
            [low.min(place[axis]), high.max(place[axis])]
        });
        if ends[0] <= ends[1] { [ends[0].midpoint(ends[1]), (ends[1] - ends[0]) / 2.0] } else { [0.0; 2] }
    };
    let axes = [axis(0), axis(1), axis(2)];
    let unit = axes.iter().map(|[_, half]| *half).fold(0.0, f32::max).max(1e-6) / f32::from(i16::MAX);
    let mut bytes = Vec::with_capacity(HEADER + POINT * points.len());
    let count = u32::try_from(points.len()).unwrap_or(u32::MAX);
    bytes.extend(count.to_le_bytes());
    bytes.extend(total.max(count).to_le_bytes());
    axes.iter().for_each(|[centre, _]| bytes.extend(centre.to_le_bytes()));
    bytes.extend(unit.to_le_bytes());
    for place in points {
        for (part, [centre, _]) in place.iter().zip(axes) {
            bytes.extend((((part - centre) / unit).round() as i16).to_le_bytes());
        }
    }
    bytes.extend(colours.iter().flatten());
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(name: &str, points: usize) -> ShownCloud {
        let place = |n: usize| [n as f32 / 1000.0, 0.5, -(n as f32) / 500.0];
        ShownCloud {
            name: name.to_owned(),
            object: format!("object of {name}"),
            points: (0..points).map(place).collect(),
            colours: (0..points).map(|n| [n as u8, 2, 3]).collect(),
            total: 9000,
        }
    }

    fn triple(number: usize) -> WrongClouds {
        WrongClouds {
            query: cloud(&format!("q{number}"), 5000),
            answer: cloud("<script>same", 5000),
            right: Some(cloud(&format!("r{number}"), 5000)),
            answer_distance: 0.5,
            right_distance: Some(0.625),
            decided_by: Some("2: <b>".to_owned()),
        }
    }

    #[test]
    fn bytes_have_the_places_to_a_part_of_their_size() {
        let cloud = cloud("a", 100);
        let bytes = encoded(&cloud, 50);
        assert_eq!(bytes.len(), HEADER + 50 * POINT);
        assert_eq!(bytes[..8], [50, 0, 0, 0, 0x28, 0x23, 0, 0]);
        let float = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let part = |n: usize, axis: usize| {
            let at = HEADER + 6 * n + 2 * axis;
            float(8 + 4 * axis) + float(20) * f32::from(i16::from_le_bytes([bytes[at], bytes[at + 1]]))
        };
        for n in 0..50 {
            for axis in 0..3 {
                assert!((part(n, axis) - cloud.points[2 * n][axis]).abs() < 1e-5, "{n} {axis}");
            }
            assert_eq!(bytes[HEADER + 300 + 3 * n], 2 * n as u8);
        }
        assert_eq!(encoded(&ShownCloud::default(), 50).len(), HEADER);
    }

    #[test]
    fn galleries_keep_to_their_room_and_name_what_they_show() {
        let wrong: Vec<WrongClouds> = (0..40).map(triple).collect();
        for room in [100_000, 500_000, 1_900_000] {
            let (figures, json) = gallery(&wrong, room).unwrap();
            assert!(figures.len() + json.len() <= room, "{} of {room}", figures.len() + json.len());
            let shown = figures.matches("class=\"triple\"").count();
            assert!(figures.contains(&format!("The first {shown} of 40.")) && shown <= MOST);
            // Two of each triple, and one that all share.
            assert_eq!(json.matches('"').count() / 2, 2 * shown + 1);
            assert!(!figures.contains("<script>same") && figures.contains("channel 2: &lt;b&gt;"));
        }
        assert!(gallery(&wrong, 5_000).is_none() && gallery(&[], 1_000_000).is_none());
    }
}
