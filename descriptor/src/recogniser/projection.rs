//! A discriminant projection: few values a cloud, in which clouds of one object lie together (DESIGN 5b).

use nalgebra::{Cholesky, DMatrix, DVector, SymmetricEigen};
use rayon::prelude::*;

use super::matrix::{Matrix, dot};
use super::{Classes, LearnError, Vote, ranked};

/// Principal components at most.
pub const MAX_COMPONENTS: usize = 300;
/// Numbers of principal components that are tried.
const COMPONENTS: [usize; 3] = [100, 200, MAX_COMPONENTS];
/// Shrinkages that are tried.
const SHRINKAGES: [f64; 3] = [0.01, 0.05, 0.2];
/// Of the largest eigenvalue, the share at which smaller ones are taken for zero.
const NEGLIGIBLE: f64 = 1e-10;

/// What a cloud is compared with after projection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reference {
    /// Each cloud of the database.
    Cloud,
    /// The mean of each object's clouds.
    Object,
}

/// What a projection may be set to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProjectionSettings {
    /// Principal components that discriminants are found among, at most.
    pub components: usize,
    /// s of S_w ← (1 − s)·S_w + s·(tr S_w / p)·I, where S_w is the scatter within objects in p components.
    pub shrinkage: f64,
    /// What a cloud is compared with.
    pub reference: Reference,
}

impl ProjectionSettings {
    /// Those that are tried, the first of equally good ones is taken.
    pub fn all() -> Vec<Self> {
        let of = |components| {
            SHRINKAGES.into_iter().flat_map(move |shrinkage| {
                [Reference::Cloud, Reference::Object].map(|reference| Self {
                    components,
                    shrinkage,
                    reference,
                })
            })
        };
        COMPONENTS.into_iter().flat_map(of).collect()
    }
}

/// Principal components of a database, from which projections of any settings are learned.
pub struct Components {
    classes: Classes,
    mean: Vec<f64>,
    /// Orthonormal rows, by falling variance.
    basis: Matrix,
    /// The clouds in them.
    clouds: Matrix,
}

/// A projection to at most one value less than there are objects, and the database in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Projection {
    classes: Classes,
    /// What is taken from a cloud's values.
    mean: Vec<f64>,
    /// A row for each value after projection.
    basis: Matrix,
    reference: Reference,
    /// Projected clouds of the database, of unit length.
    clouds: Matrix,
    /// Means of the objects' projected clouds, of unit length.
    means: Matrix,
}

impl Components {
    /// Of a database's values, a row a cloud, which shows `objects`.
    ///
    /// # Errors
    /// [`LearnError`] if there are fewer than two objects or nothing varies.
    pub fn new(values: &Matrix, objects: &[u32]) -> Result<Self, LearnError> {
        let classes = Classes::new(objects)?;
        let mean = values.mean_row();
        let centred = values.clone().less(&mean);
        let basis = if centred.columns() <= centred.rows() {
            eigenvectors(&centred.transposed().gram(), MAX_COMPONENTS).1
        } else {
            // As many eigenvalues as there are clouds at most: XXᵀ has the same ones as XᵀX, and Xᵀu/√λ are its vectors.
            let (variances, vectors) = eigenvectors(&centred.gram(), MAX_COMPONENTS);
            let columns = centred.transposed();
            let values = vectors.times_transposed(&columns);
            let row = |row: usize| values.row(row).iter().map(move |value| (row, value));
            let scaled = (0..values.rows()).flat_map(row).map(|(row, value)| value / variances[row].sqrt());
            Matrix::new(values.columns(), scaled.collect())
        };
        if basis.rows() == 0 {
            return Err(LearnError::Alike);
        }
        let clouds = centred.times_transposed(&basis);
        Ok(Self { classes, mean, basis, clouds })
    }

    /// The discriminants among the first of the components.
    ///
    /// # Errors
    /// [`LearnError`] if clouds of different objects have the same mean.
    pub fn projection(&self, settings: &ProjectionSettings) -> Result<Projection, LearnError> {
        let Self { classes, mean, .. } = self;
        let components = settings.components.min(self.basis.rows());
        let clouds = self.clouds.first_columns(components);
        let [within, between] = scatter(&clouds, classes);
        let trace: f64 = (0..components).map(|at| within.row(at)[at]).sum();
        let ridge = settings.shrinkage * trace / components as f64;
        let shrunk = DMatrix::from_fn(components, components, |row, column| {
            let diagonal = if row == column { ridge } else { 0.0 };
            (1.0 - settings.shrinkage) * within.row(row)[column] + diagonal
        });
        let Some(factor) = Cholesky::new(shrunk) else { return Err(LearnError::Singular) };
        let lower = factor.l();
        // Of L·Lᵀ = S_w and B·Bᵀ = S_b the discriminants are L⁻ᵀv, with v the eigenvectors of L⁻¹B·(L⁻¹B)ᵀ.
        let whitened = (0..between.rows()).flat_map(|class| {
            let mean = DVector::from_column_slice(between.row(class));
            // No element of the diagonal is 0: the factor exists.
            lower.solve_lower_triangular(&mean).map_or_else(Vec::new, |white| white.as_slice().to_vec())
        });
        let whitened = Matrix::new(components, whitened.collect());
        let (variances, vectors) = eigenvectors(&whitened.gram(), classes.len() - 1);
        let columns = whitened.transposed();
        let directions = (0..vectors.rows()).flat_map(|row| {
            let length = variances[row].sqrt();
            let values = (0..components).map(|at| dot(vectors.row(row), columns.row(at)) / length);
            let direction = DVector::from_vec(values.collect());
            lower
                .tr_solve_lower_triangular(&direction)
                .map_or_else(Vec::new, |found| found.as_slice().to_vec())
        });
        let directions = Matrix::new(components, directions.collect());
        if directions.rows() == 0 {
            return Err(LearnError::Alike);
        }
        let first = Matrix::new(
            self.basis.columns(),
            self.basis.values()[..components * self.basis.columns()].to_vec(),
        );
        let basis = directions.times_transposed(&first.transposed());
        let projected = clouds.times_transposed(&directions);
        Ok(Projection {
            classes: classes.clone(),
            mean: mean.clone(),
            basis,
            reference: settings.reference,
            means: of_unit_length(class_means(&projected, classes)),
            clouds: of_unit_length(projected),
        })
    }
}

impl Projection {
    /// Values of a cloud after projection.
    pub fn size(&self) -> usize {
        self.basis.rows()
    }

    /// A cloud's values after projection.
    pub fn project(&self, values: &[f64]) -> Vec<f64> {
        let centred: Vec<f64> = values.iter().zip(&self.mean).map(|(value, mean)| value - mean).collect();
        (0..self.basis.rows()).map(|row| dot(self.basis.row(row), &centred)).collect()
    }

    /// What speaks for each object, best first, from the values of a cloud.
    pub fn votes(&self, values: &[f64]) -> Vec<Vote> {
        let projected = &self.project(values)[..];
        let length = dot(projected, projected).sqrt();
        let cosine = |other: &[f64]| if length > 0.0 { dot(projected, other) / length } else { 0.0 };
        // Of each object the cloud that is most like it stands for it.
        let mut best: Vec<Option<(f64, u32)>> = vec![None; self.classes.len()];
        for cloud in 0..self.clouds.rows() {
            let score = cosine(self.clouds.row(cloud));
            let of_class = &mut best[self.classes.of(cloud)];
            if of_class.is_none_or(|(most, _)| score.total_cmp(&most).is_gt()) {
                *of_class = Some((score, cloud as u32));
            }
        }
        ranked(best.into_iter().enumerate().map(|(class, best)| {
            let (of_cloud, cloud) = best.unwrap_or((-1.0, 0));
            match self.reference {
                Reference::Cloud => (of_cloud, cloud),
                Reference::Object => (cosine(self.means.row(class)), cloud),
            }
        }))
    }
}

/// The eigenvectors of a symmetric matrix with the largest eigenvalues, as rows, and these values; at most so many, and
/// none of those whose values are nothing beside the largest.
fn eigenvectors(matrix: &Matrix, most: usize) -> (Vec<f64>, Matrix) {
    let size = matrix.columns();
    if size == 0 {
        return (Vec::new(), Matrix::default());
    }
    let SymmetricEigen { eigenvalues, eigenvectors } =
        SymmetricEigen::new(DMatrix::from_column_slice(size, size, matrix.values()));
    let mut order: Vec<usize> = (0..size).collect();
    order.sort_by(|&a, &b| eigenvalues[b].total_cmp(&eigenvalues[a])); // stable: ties by place
    let least = NEGLIGIBLE * eigenvalues[order[0]];
    order.retain(|&place| eigenvalues[place] > least.max(0.0));
    order.truncate(most);
    let values = order.iter().map(|&place| eigenvalues[place]).collect();
    let vectors =
        order.iter().flat_map(|&place| eigenvectors.column(place).iter().copied().collect::<Vec<_>>());
    (values, Matrix::new(size, vectors.collect()))
}

/// The scatter within objects, over the number of clouds, and a factor of that between them: of each object (row) the
/// difference of its mean from that of all, times the root of its share of the clouds.
fn scatter(clouds: &Matrix, classes: &Classes) -> [Matrix; 2] {
    let (count, mean) = (clouds.rows() as f64, clouds.mean_row());
    let means = class_means(clouds, classes);
    let residuals = (0..clouds.rows()).flat_map(|cloud| {
        let of_class = means.row(classes.of(cloud));
        clouds.row(cloud).iter().zip(of_class).map(move |(value, mean)| (value - mean) / count.sqrt())
    });
    let residuals = Matrix::new(clouds.columns(), residuals.collect());
    let between = (0..classes.len()).flat_map(|class| {
        let share = (classes.members(class) as f64 / count).sqrt();
        means.row(class).iter().zip(&mean).map(move |(value, mean)| share * (value - mean))
    });
    let between = Matrix::new(clouds.columns(), between.collect());
    [residuals.transposed().gram(), between]
}

/// Of each object (row) the mean of its clouds.
fn class_means(clouds: &Matrix, classes: &Classes) -> Matrix {
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); classes.len()];
    (0..clouds.rows()).for_each(|cloud| members[classes.of(cloud)].push(cloud));
    let means = members.iter().flat_map(|members| clouds.select(members).mean_row());
    Matrix::new(clouds.columns(), means.collect())
}

fn of_unit_length(matrix: Matrix) -> Matrix {
    let rows: Vec<Vec<f64>> = (0..matrix.rows())
        .into_par_iter()
        .map(|row| {
            let row = matrix.row(row);
            let length = dot(row, row).sqrt();
            row.iter().map(|value| if length > 0.0 { value / length } else { 0.0 }).collect()
        })
        .collect();
    Matrix::new(matrix.columns(), rows.concat())
}

#[cfg(test)]
mod tests {
    use super::super::testing::{Sample, sample};
    use super::*;

    /// a·b of all pairs of rows is 1 of a row with itself and else 0.
    fn assert_orthonormal(rows: &Matrix, tolerance: f64) {
        let products = rows.gram();
        for row in 0..rows.rows() {
            for (column, &product) in products.row(row).iter().enumerate() {
                let expected = if row == column { 1.0 } else { 0.0 };
                assert!((product - expected).abs() < tolerance, "{row} {column}: {product}");
            }
        }
    }

    #[test]
    fn components_are_uncorrelated_by_falling_variance_and_keep_all_of_it() {
        // More clouds than values, and fewer.
        for Sample { values, objects } in [sample(6, 12, 20), sample(4, 6, 60)] {
            let components = Components::new(&values, &objects).unwrap();
            assert_eq!(components.basis.rows(), values.columns().min(values.rows() - 1));
            assert_orthonormal(&components.basis, 1e-10);
            let products = components.clouds.transposed().gram();
            let variances: Vec<f64> = (0..products.rows()).map(|at| products.row(at)[at]).collect();
            assert!(variances.is_sorted_by(|a, b| a >= b));
            for row in 0..products.rows() {
                for column in (0..products.columns()).filter(|&column| column != row) {
                    assert!(products.row(row)[column].abs() < 1e-9 * variances[0]);
                }
            }
            let centred = values.clone().less(&values.mean_row());
            let all: f64 = centred.values().iter().map(|value| value * value).sum();
            assert!((variances.iter().sum::<f64>() - all).abs() < 1e-9 * all);
        }
    }

    #[test]
    fn discriminants_solve_the_generalised_eigenproblem() {
        let Sample { values, objects } = sample(5, 9, 30);
        let components = Components::new(&values, &objects).unwrap();
        for settings in ProjectionSettings::all() {
            let projection = components.projection(&settings).unwrap();
            assert_eq!(projection.size(), 4, "objects - 1");
            let kept = components.basis.rows().min(settings.components);
            let directions = projection.basis.times_transposed(&components.basis); // orthonormal: as they were
            // By the definition: sums over clouds, one object at a time.
            let clouds = components.clouds.first_columns(kept);
            let mut within = vec![vec![0.0; kept]; kept];
            let mut between = vec![vec![0.0; kept]; kept];
            for object in 0..5 {
                let members: Vec<usize> = (0..objects.len()).filter(|&at| objects[at] == object).collect();
                let mean = clouds.select(&members).mean_row();
                for row in 0..kept {
                    for column in 0..kept {
                        between[row][column] +=
                            members.len() as f64 / objects.len() as f64 * mean[row] * mean[column];
                        for &cloud in &members {
                            let [a, b] = [row, column].map(|at| clouds.row(cloud)[at] - mean[at]);
                            within[row][column] += a * b / objects.len() as f64;
                        }
                    }
                }
            }
            let trace: f64 = (0..kept).map(|at| within[at][at]).sum();
            for (row, values) in within.iter_mut().enumerate() {
                values.iter_mut().for_each(|value| *value *= 1.0 - settings.shrinkage);
                values[row] += settings.shrinkage * trace / kept as f64;
            }
            let product = |matrix: &[Vec<f64>], a: &[f64], b: &[f64]| -> f64 {
                (0..kept).map(|row| a[row] * (0..kept).map(|at| matrix[row][at] * b[at]).sum::<f64>()).sum()
            };
            let mut before = f64::INFINITY;
            for a in 0..4 {
                for b in 0..4 {
                    let [within, between] = [&within, &between]
                        .map(|matrix| product(matrix, directions.row(a), directions.row(b)));
                    if a == b {
                        assert!((within - 1.0).abs() < 1e-8 && between <= before, "{within} {between}");
                        before = between;
                    } else {
                        assert!(within.abs() < 1e-8 && between.abs() < 1e-8 * before.max(1.0));
                    }
                }
            }
        }
    }

    #[test]
    fn clouds_of_the_database_are_most_like_themselves_and_means_like_their_object() {
        let Sample { values, objects } = sample(5, 9, 30);
        let components = Components::new(&values, &objects).unwrap();
        for settings in ProjectionSettings::all() {
            let projection = components.projection(&settings).unwrap();
            for (cloud, &object) in objects.iter().enumerate() {
                let [best, second, ..] = projection.votes(values.row(cloud))[..] else {
                    panic!("five objects")
                };
                assert_eq!(objects[best.cloud as usize], object, "{settings:?}");
                assert!(objects[second.cloud as usize] != object && second.score <= best.score);
                if settings.reference == Reference::Cloud {
                    assert!(best.cloud as usize == cloud && (best.score - 1.0).abs() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn what_does_not_vary_is_refused() {
        let values = Matrix::new(3, vec![0.5; 12]);
        assert_eq!(Components::new(&values, &[0, 0, 1, 1]).err(), Some(LearnError::Alike));
        let values = Matrix::new(2, vec![0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0]);
        // Objects whose means are the same.
        let components = Components::new(&values, &[0, 0, 1, 1]).unwrap();
        assert_eq!(components.projection(&ProjectionSettings::all()[0]), Err(LearnError::Alike));
        assert_eq!(Components::new(&values, &[2; 4]).err(), Some(LearnError::Objects { got: 1 }));
        assert_eq!(Components::new(&Matrix::default(), &[]).err(), Some(LearnError::Objects { got: 0 }));
        // Without scatter within objects there is nothing to divide by.
        let apart = Components::new(&values, &[0, 1, 0, 1]).unwrap();
        assert_eq!(apart.projection(&ProjectionSettings::all()[0]), Err(LearnError::Singular));
    }
}
