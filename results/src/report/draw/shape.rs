//! Lines and areas as far as they lie in a rectangle, and as finely as they can be seen.

/// A place, pixels.
pub(super) type Point = [f64; 2];

/// Left and right, top and bottom.
pub(super) type Bounds = [[f64; 2]; 2];

/// Points of a line that lie in one column of this width are told apart by their heights only.
const COLUMN: f64 = 0.5;

/// Whether a point lies in a rectangle.
pub(super) fn contains(bounds: Bounds, point: Point) -> bool {
    point.iter().zip(bounds).all(|(part, [low, high])| (low..=high).contains(part))
}

/// The pieces of a line that lie in a rectangle.
pub(super) fn clipped_line(points: &[Point], bounds: Bounds) -> Vec<Vec<Point>> {
    let mut pieces: Vec<Vec<Point>> = Vec::new();
    let mut end = None;
    for pair in points.windows(2) {
        let Some([from, to]) = clipped_segment([pair[0], pair[1]], bounds) else {
            end = None;
            continue;
        };
        match pieces.last_mut() {
            Some(piece) if end == Some(from) => piece.push(to),
            _ => pieces.push(vec![from, to]),
        }
        end = Some(to);
    }
    pieces
}

/// The part of a segment that lies in a rectangle (Liang and Barsky).
fn clipped_segment([from, to]: [Point; 2], bounds: Bounds) -> Option<[Point; 2]> {
    let (mut first, mut last) = (0.0_f64, 1.0_f64);
    for axis in 0..2 {
        let ([low, high], start, along) = (bounds[axis], from[axis], to[axis] - from[axis]);
        if along == 0.0 {
            if !(low..=high).contains(&start) {
                return None;
            }
            continue;
        }
        let [a, b] = [(low - start) / along, (high - start) / along];
        first = first.max(a.min(b));
        last = last.min(a.max(b));
    }
    let at = |share: f64, exact: Point| match share {
        0.0 | 1.0 => exact,
        share => [from[0] + share * (to[0] - from[0]), from[1] + share * (to[1] - from[1])],
    };
    (first <= last).then(|| [at(first, from), at(last, to)])
}

/// The part of a polygon that lies in a rectangle (Sutherland and Hodgman).
pub(super) fn clipped_area(corners: Vec<Point>, bounds: Bounds) -> Vec<Point> {
    let sides =
        [(0, bounds[0][0], 1.0), (0, bounds[0][1], -1.0), (1, bounds[1][0], 1.0), (1, bounds[1][1], -1.0)];
    sides.into_iter().fold(corners, |corners, (axis, limit, sign): (usize, f64, f64)| {
        let depth = |point: Point| sign * (point[axis] - limit);
        let mut kept = Vec::with_capacity(corners.len());
        for (index, &to) in corners.iter().enumerate() {
            let from = corners[(index + corners.len() - 1) % corners.len()];
            if (depth(from) >= 0.0) != (depth(to) >= 0.0) {
                let share = depth(from) / (depth(from) - depth(to));
                kept.push([from[0] + share * (to[0] - from[0]), from[1] + share * (to[1] - from[1])]);
            }
            if depth(to) >= 0.0 {
                kept.push(to);
            }
        }
        kept
    })
}

/// The points of a line that can be told apart: of those that follow each other in one column of pixels the first, the
/// highest, the lowest and the last.
pub(super) fn seen_line(points: &[Point]) -> Vec<Point> {
    let column = |point: &Point| (point[0] / COLUMN).floor();
    let mut seen = Vec::new();
    for column in points.chunk_by(|a, b| column(a) == column(b)) {
        let ends = [column.first(), column.last()];
        let by_height = |a: &&Point, b: &&Point| a[1].total_cmp(&b[1]);
        let extremes = [column.iter().min_by(by_height), column.iter().max_by(by_height)];
        if column.len() <= 4 {
            seen.extend_from_slice(column);
        } else if let ([Some(first), Some(last)], [Some(top), Some(bottom)]) = (ends, extremes) {
            seen.extend([*first, *top, *bottom, *last]);
        }
    }
    seen
}

/// The corners of a line that holds each value to the next.
pub(super) fn steps(points: &[Point]) -> Vec<Point> {
    let corners = points.windows(2).flat_map(|pair| [pair[0], [pair[1][0], pair[0][1]]]);
    corners.chain(points.last().copied()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOUNDS: Bounds = [[0.0, 10.0], [0.0, 5.0]];

    #[test]
    fn lines_end_at_the_bounds_and_go_on_where_they_come_back() {
        let line = [[-5.0, 2.5], [5.0, 2.5], [5.0, 10.0], [7.0, 10.0], [7.0, 2.0]];
        let pieces = clipped_line(&line, BOUNDS);
        assert_eq!(pieces, [vec![[0.0, 2.5], [5.0, 2.5], [5.0, 5.0]], vec![[7.0, 5.0], [7.0, 2.0]]]);
        assert!(clipped_line(&[[-1.0, -1.0], [11.0, -2.0]], BOUNDS).is_empty());
        let within = [[1.0, 1.0], [2.0, 4.0], [9.0, 3.0]];
        assert_eq!(clipped_line(&within, BOUNDS), [within.to_vec()]);
    }

    #[test]
    fn areas_are_cut_at_the_bounds() {
        let area = |corners: &[Point]| {
            let pairs = corners.iter().zip(corners.iter().cycle().skip(1));
            pairs.map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum::<f64>().abs() / 2.0
        };
        let square = vec![[-1.0, -1.0], [4.0, -1.0], [4.0, 4.0], [-1.0, 4.0]];
        let cut = clipped_area(square, BOUNDS);
        assert!(
            (area(&cut) - 16.0).abs() < 1e-9 && cut.iter().all(|&point| contains(BOUNDS, point)),
            "{cut:?}"
        );
        let all = clipped_area(vec![[-99.0, -99.0], [99.0, -99.0], [99.0, 99.0], [-99.0, 99.0]], BOUNDS);
        assert!((area(&all) - 50.0).abs() < 1e-9);
        assert!(clipped_area(vec![[-3.0, 1.0], [-1.0, 1.0], [-1.0, 2.0]], BOUNDS).is_empty());
        assert!(clipped_area(Vec::new(), BOUNDS).is_empty());
    }

    #[test]
    fn a_long_line_keeps_its_extremes() {
        let line: Vec<Point> =
            (0..100_000).map(|n| [f64::from(n) / 1000.0, f64::from(n * 7919 % 1000)]).collect();
        let seen = seen_line(&line);
        assert!(seen.len() <= 800, "{}", seen.len());
        assert_eq!((seen[0], seen[seen.len() - 1]), (line[0], line[99_999]));
        for column in 0..200 {
            let heights = |points: &[Point]| {
                let of = points.iter().filter(|point| (point[0] / COLUMN).floor() == f64::from(column));
                of.fold([f64::INFINITY, 0.0], |[low, high], point| [point[1].min(low), point[1].max(high)])
            };
            assert_eq!(heights(&line), heights(&seen), "{column}");
        }
        assert_eq!(seen_line(&line[..3]), line[..3]);
    }

    #[test]
    fn steps_hold_each_value_to_the_next() {
        let points = steps(&[[1.0, 9.0], [2.0, 7.0], [4.0, 6.0]]);
        assert_eq!(points, [[1.0, 9.0], [2.0, 9.0], [2.0, 7.0], [4.0, 7.0], [4.0, 6.0]]);
        assert!(steps(&[]).is_empty());
    }
}
