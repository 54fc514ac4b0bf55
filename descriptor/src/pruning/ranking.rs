//! The nearest objects found so far, whatever the order in which clouds are looked at.

use crate::recognise::Hit;

/// The nearest cloud of each of the nearest objects, at most so many, nearest first; of equal distances the lowest index
/// counts.
///
/// An object that is dropped is farther than as many others as are asked for. It comes back only with a cloud that is
/// nearer than all of its own before, so that what is kept of an object is always its nearest cloud.
#[derive(Debug)]
pub(super) struct Nearest {
    most: usize,
    found: Vec<(u32, Hit)>,
}

impl Nearest {
    /// Of nothing yet.
    pub(super) fn new(most: usize) -> Self {
        Self { most, found: Vec::with_capacity(most + 1) }
    }

    /// Whether there are as many objects as are asked for.
    pub(super) fn is_full(&self) -> bool {
        self.found.len() >= self.most
    }

    /// The objects and their distances, nearest first.
    pub(super) fn objects(&self) -> impl Iterator<Item = (u32, f64)> {
        self.found.iter().map(|(object, hit)| (*object, hit.distance))
    }

    /// A cloud that is farther away than this changes nothing, whatever its object.
    pub(super) fn limit(&self) -> f64 {
        let last = self.found.last().filter(|_| self.is_full());
        last.map_or(f64::INFINITY, |(_, hit)| hit.distance)
    }

    /// A cloud of this object that is farther away than this changes nothing.
    pub(super) fn limit_of(&self, object: u32) -> f64 {
        let known = self.found.iter().find(|(other, _)| *other == object);
        known.map_or_else(|| self.limit(), |(_, hit)| hit.distance)
    }

    /// Looks at a cloud.
    pub(super) fn offer(&mut self, object: u32, hit: Hit) {
        let is_nearer =
            |other: &Hit| hit.distance.total_cmp(&other.distance).then(hit.index.cmp(&other.index)).is_lt();
        if let Some(known) = self.found.iter().position(|(other, _)| *other == object) {
            if !is_nearer(&self.found[known].1) {
                return;
            }
            self.found.remove(known);
        }
        let place = self.found.iter().position(|(_, other)| is_nearer(other)).unwrap_or(self.found.len());
        self.found.insert(place, (object, hit));
        self.found.truncate(self.most);
    }

    /// What was found.
    pub(super) fn into_hits(self) -> Vec<Hit> {
        self.found.into_iter().map(|(_, hit)| hit).collect()
    }
}
