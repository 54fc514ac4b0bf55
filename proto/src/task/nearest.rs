//! The nearest clouds of a query, its own class and the others apart, and how those of parts become those of a whole.

use std::cmp::Ordering;

/// The clouds that are nearest to one query, of those that it is compared with: index and set distance. Of equal
/// distances the lowest index counts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Nearest {
    /// The nearest of the query's own object, or of its category if that is the objective; `None` if there is none left.
    pub same: Option<(u32, f64)>,
    /// The nearest of all others; `None` if there is none left.
    pub other: Option<(u32, f64)>,
}

impl Nearest {
    /// Those with two parts of a database together, of those with each. Clouds of the second are numbered from `offset`
    /// on.
    pub fn merge(self, part: Self, offset: u32) -> Self {
        let numbered = |found: Option<(u32, f64)>| found.map(|(index, distance)| (index + offset, distance));
        Self { same: nearer(self.same, numbered(part.same)), other: nearer(self.other, numbered(part.other)) }
    }
}

fn nearer(one: Option<(u32, f64)>, two: Option<(u32, f64)>) -> Option<(u32, f64)> {
    match (one, two) {
        (Some(one), Some(two)) => Some(if is_nearer(two, one) { two } else { one }),
        (one, two) => one.or(two),
    }
}

/// Whether one cloud, by index and distance, is nearer than another: of equal distances the lowest index counts.
pub fn is_nearer(one: (u32, f64), other: (u32, f64)) -> bool {
    one.1.total_cmp(&other.1).then(one.0.cmp(&other.0)) == Ordering::Less
}
