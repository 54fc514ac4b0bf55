//! The points about one keypoint, copied together so that loops over them, and over pairs of them, are dense.

use pulp::{Simd, WithSimd};

use crate::select::select;
use crate::surface::{BLOCK, Surface, block};
use crate::wide::widest;

/// Neighbours that a kernel looks at together, each in a lane of its own.
pub(super) const GROUP: usize = 32;

/// The neighbours of one keypoint, in the order of the surface; kept to be filled again.
///
/// The lists go on for [`GROUP`] zeros after the last neighbour, so that a whole group begins at every neighbour.
#[derive(Default)]
pub(super) struct Neighbourhood {
    /// x, y, z, metres.
    pub(super) position: [Vec<f32>; 3],
    /// x, y, z of the normals.
    pub(super) normal: [Vec<f32>; 3],
    /// Where the neighbours are on the surface.
    places: Vec<u32>,
}

impl Neighbourhood {
    /// Fills it with the points whose d² to `centre` is above `beyond` and at most `limit`, square metres.
    pub(super) fn fill(&mut self, surface: &Surface, centre: [f32; 3], limits: [f32; 2]) {
        let mut places = std::mem::take(&mut self.places);
        find(surface, centre, limits, &mut places);
        self.copy(surface, places);
    }

    /// Fills it with the points at these places.
    pub(super) fn copy(&mut self, surface: &Surface, places: Vec<u32>) {
        self.places = places;
        for axis in 0..3 {
            copy(&self.places, &surface.position[axis], &mut self.position[axis]);
            copy(&self.places, &surface.normal[axis], &mut self.normal[axis]);
        }
    }

    /// Number of neighbours.
    pub(super) fn len(&self) -> usize {
        self.places.len()
    }

    /// Fills a list with the neighbours' values out of those of the whole surface.
    pub(super) fn take<T: Copy + Default>(&self, of_surface: &[T], list: &mut Vec<T>) {
        copy(&self.places, of_surface, list);
    }
}

/// Fills a list with the places of the points whose d² to `centre` is above `beyond` and at most `limit`, square metres,
/// ascending.
pub(super) fn find(surface: &Surface, centre: [f32; 3], limits: [f32; 2], places: &mut Vec<u32>) {
    widest(Select { surface, centre, limits, places });
}

fn copy<T: Copy + Default>(places: &[u32], from: &[T], list: &mut Vec<T>) {
    list.clear();
    list.extend(places.iter().map(|&place| from[place as usize]));
    list.resize(places.len() + GROUP, T::default());
}

/// The group of a list that begins at `start`.
#[inline(always)]
pub(super) fn group<T>(list: &[T], start: usize) -> &[T; GROUP] {
    &list[start..start + GROUP].as_chunks().0[0]
}

/// The kernel of [`find`].
struct Select<'a> {
    surface: &'a Surface,
    centre: [f32; 3],
    limits: [f32; 2],
    places: &'a mut Vec<u32>,
}

impl WithSimd for Select<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let ([cx, cy, cz], [_, limit]) = (self.centre, self.limits);
        let (mut d2, mut count) = ([0.0; BLOCK], 0);
        self.places.resize(self.surface.room(), 0);
        for number in 0..self.surface.blocks() {
            if self.surface.is_out_of_reach(number, self.centre, limit) {
                continue;
            }
            let [x, y, z] = self.surface.position.each_ref().map(|values| block(values, number));
            for (((d2, &x), &y), &z) in d2.iter_mut().zip(x).zip(y).zip(z) {
                let (x, y, z) = (x - cx, y - cy, z - cz);
                *d2 = x * x + y * y + z * z;
            }
            count = select(simd, &d2, self.limits, (number * BLOCK) as u32, self.places, count);
        }
        self.places.truncate(count);
    }
}
