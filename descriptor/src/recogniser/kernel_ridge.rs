//! Kernel ridge regression on set distances: each cloud of the database votes for every object (DESIGN 5b).

use nalgebra::{Cholesky, DMatrix};

use super::matrix::{Matrix, dot};
use super::{Classes, LearnError, Vote, ranked};
use crate::structure::quantile;

/// Clouds of a database that are learned from at most: their kernel takes 512 MB.
pub const MAX_CLOUDS: usize = 8192;

/// γ that are tried.
const WIDTHS: [f64; 3] = [1.0, 3.0, 10.0];
/// λ that are tried. DESIGN 5b begins at 0.001, which was always chosen: databases of hundreds of clouds want less.
const RIDGES: [f64; 5] = [0.00001, 0.0001, 0.001, 0.01, 0.1];

/// What kernel ridge regression may be set to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KernelRidgeSettings {
    /// γ of the kernel exp(−d / (γ·scale)), where d is a set distance and scale the twentieth part of those among the
    /// database, sorted.
    pub width: f64,
    /// λ of K + λ·n·I, n clouds.
    pub ridge: f64,
}

impl KernelRidgeSettings {
    /// Those that are tried, the first of equally good ones is taken.
    pub const ALL: [Self; WIDTHS.len() * RIDGES.len()] = {
        let mut all = [Self { width: 0.0, ridge: 0.0 }; WIDTHS.len() * RIDGES.len()];
        let mut place = 0;
        while place < all.len() {
            all[place] = Self { width: WIDTHS[place / RIDGES.len()], ridge: RIDGES[place % RIDGES.len()] };
            place += 1;
        }
        all
    };
}

/// Kernel ridge regression from the distances to a database to its objects.
#[derive(Clone, Debug, PartialEq)]
pub struct KernelRidge {
    classes: Classes,
    /// γ·scale.
    width: f64,
    /// Of each object (row) the weight of each cloud.
    weights: Matrix,
    /// Of each object its share of the clouds: what centred targets leave out.
    shares: Vec<f64>,
}

impl KernelRidge {
    /// Whether it can learn from clouds that show these objects.
    pub(super) fn check(objects: &[u32]) -> Result<Classes, LearnError> {
        let got = objects.len();
        if got > MAX_CLOUDS {
            return Err(LearnError::Clouds { got, most: MAX_CLOUDS });
        }
        Classes::new(objects)
    }

    /// Learns from the distances among the clouds of a database, and what they show.
    ///
    /// # Errors
    /// [`LearnError`] if there are fewer than two objects or too many clouds.
    pub fn learn(
        distances: &Matrix,
        objects: &[u32],
        settings: &KernelRidgeSettings,
    ) -> Result<Self, LearnError> {
        let classes = Self::check(objects)?;
        let clouds = objects.len();
        let mut pairs: Vec<f64> =
            (0..clouds).flat_map(|cloud| &distances.row(cloud)[cloud + 1..]).copied().collect();
        let scale = quantile(&mut pairs, f64::total_cmp).filter(|&scale| scale > 0.0).unwrap_or(1.0);
        let width = settings.width * scale;
        let ridge = settings.ridge * clouds as f64;
        let values = distances.values().iter().map(|&distance| kernel(distance, width));
        let mut system = DMatrix::from_iterator(clouds, clouds, values);
        (0..clouds).for_each(|cloud| system[(cloud, cloud)] += ridge);
        let shares: Vec<f64> =
            (0..classes.len()).map(|class| classes.members(class) as f64 / clouds as f64).collect();
        let targets = DMatrix::from_fn(clouds, classes.len(), |cloud, class| {
            f64::from(u8::from(classes.of(cloud) == class)) - shares[class]
        });
        // No set distance has been shown to make a kernel without negative eigenvalues: a ridge this small may not do.
        let Some(factor) = Cholesky::new(system) else { return Err(LearnError::Singular) };
        // Column by column, which is object by object.
        let weights = Matrix::new(clouds, factor.solve(&targets).as_slice().to_vec());
        Ok(Self { classes, width, weights, shares })
    }

    /// What speaks for each object, best first, from the distances of a cloud to those of the database.
    pub fn votes(&self, distances: &[f64]) -> Vec<Vote> {
        let kernel: Vec<f64> = distances.iter().map(|&distance| kernel(distance, self.width)).collect();
        let score = |class: usize| dot(self.weights.row(class), &kernel) + self.shares[class];
        // Of each object the nearest of its clouds stands for it.
        let mut nearest: Vec<Option<(f64, u32)>> = vec![None; self.classes.len()];
        for (cloud, &distance) in distances.iter().enumerate() {
            let best = &mut nearest[self.classes.of(cloud)];
            if best.is_none_or(|(least, _)| distance.total_cmp(&least).is_lt()) {
                *best = Some((distance, cloud as u32));
            }
        }
        ranked(nearest.iter().enumerate().map(|(class, cloud)| {
            let cloud = cloud.map_or(0, |(_, cloud)| cloud);
            (score(class), cloud)
        }))
    }
}

fn kernel(distance: f64, width: f64) -> f64 {
    libm::exp(-distance / width)
}

#[cfg(test)]
mod tests {
    use super::super::testing::{Sample, distances, sample};
    use super::*;

    #[test]
    fn weights_solve_the_equations() {
        let Sample { values, objects } = sample(4, 7, 12);
        let distances = distances(&values);
        let clouds = objects.len();
        let mut sorted: Vec<f64> =
            (0..clouds).flat_map(|a| (0..a).map(move |b| (a, b))).map(|(a, b)| distances.row(a)[b]).collect();
        sorted.sort_by(f64::total_cmp);
        let scale = sorted[sorted.len() / 20];
        for settings in KernelRidgeSettings::ALL {
            let learned = KernelRidge::learn(&distances, &objects, &settings).unwrap();
            for cloud in 0..clouds {
                for object in 0..4 {
                    // Row of (K + λ·n·I)·α against the centred target.
                    let weights = learned.weights.row(object);
                    let kernel =
                        |other: usize| libm::exp(-distances.row(cloud)[other] / (settings.width * scale));
                    let sum: f64 = (0..clouds).map(|other| kernel(other) * weights[other]).sum();
                    let ridge = settings.ridge * clouds as f64 * weights[cloud];
                    let target = f64::from(u8::from(objects[cloud] as usize == object)) - 7.0 / 28.0;
                    assert!((sum + ridge - target).abs() < 1e-9, "{settings:?} {cloud} {object}");
                }
                let [best, second, ..] = learned.votes(distances.row(cloud))[..] else {
                    panic!("four objects")
                };
                assert_eq!((best.cloud as usize, objects[best.cloud as usize]), (cloud, objects[cloud]));
                assert!(objects[second.cloud as usize] != objects[cloud] && second.score < best.score);
            }
        }
    }

    #[test]
    fn clouds_that_are_all_alike_get_a_name_and_too_many_are_refused() {
        let settings = KernelRidgeSettings::ALL[0];
        let alike = Matrix::new(3, vec![0.0; 9]);
        let learned = KernelRidge::learn(&alike, &[5, 3, 3], &settings).unwrap();
        let [best, second] = learned.votes(&[0.0; 3])[..] else { panic!("two objects") };
        assert_eq!((best.cloud, second.cloud), (1, 0), "the object with most clouds");
        let nothing = Matrix::default();
        assert_eq!(KernelRidge::learn(&nothing, &[1, 1], &settings), Err(LearnError::Objects { got: 1 }));
        let many: Vec<u32> = (0..MAX_CLOUDS as u32 + 1).collect();
        let refused = LearnError::Clouds { got: MAX_CLOUDS + 1, most: MAX_CLOUDS };
        assert_eq!(KernelRidge::learn(&nothing, &many, &settings), Err(refused));
    }

    #[test]
    fn settings_are_all_pairs_narrow_first() {
        let pairs = KernelRidgeSettings::ALL.map(|KernelRidgeSettings { width, ridge }| (width, ridge));
        assert_eq!((pairs[0], pairs[7], pairs[14]), ((1.0, 0.00001), (3.0, 0.001), (10.0, 0.1)));
    }
}
