//! Eigenvectors of symmetric 3×3 matrices from + − × ÷ √ alone, so that every target computes the same bits.

/// Matrices that are solved at once, each in a lane of its own.
pub(crate) const LANES: usize = 16;

/// Steps towards the smallest eigenvalue; three or four are enough unless two eigenvalues are nearly equal.
const STEPS: u32 = 6;

/// Share of the trace: a last step that is longer than this has not arrived.
const ARRIVED: f64 = 1e-11;

/// Share of the square of the trace: the product of the distances from the smallest eigenvalue to the other two must
/// exceed it. Below it the rounding of a matrix in f32 turns the eigenvector by more than some 1e-5.
const LEAST_GAPS: f64 = 0.05;

/// Unit eigenvectors of the smallest eigenvalues of [`LANES`] matrices, each as [`smallest_eigenvector`] takes it; of
/// either sign. A lane without an answer (eigenvalues that are nearly equal against the largest) holds NaN.
///
/// The smallest root of the characteristic polynomial by Laguerre's method, which approaches it from 0 without passing
/// it, as all roots are real and none of a covariance is negative; then the longest row of the adjugate of A − λI. In a
/// rounded matrix a root that is next to 0 may lie below it, and the method may then end at another one: that is no
/// answer either.
#[inline(always)]
pub(crate) fn smallest_eigenvectors(matrices: &[[f64; LANES]; 6]) -> [[f64; LANES]; 3] {
    // Stage by stage, each over all lanes, with nothing but numbers inside: such loops become vectors.
    let [xx, xy, xz, yy, yz, zz] = matrices;
    let [mut trace, mut minors, mut determinant] = [[0.0f64; LANES]; 3];
    for i in 0..LANES {
        trace[i] = xx[i] + yy[i] + zz[i];
        minors[i] = (xx[i] * yy[i] - xy[i] * xy[i])
            + (xx[i] * zz[i] - xz[i] * xz[i])
            + (yy[i] * zz[i] - yz[i] * yz[i]);
        determinant[i] = xx[i] * (yy[i] * zz[i] - yz[i] * yz[i]) - xy[i] * (xy[i] * zz[i] - yz[i] * xz[i])
            + xz[i] * (xy[i] * yz[i] - yy[i] * xz[i]);
    }
    let [mut root, mut step] = [[0.0f64; LANES]; 2];
    for _ in 0..STEPS {
        for i in 0..LANES {
            let value = ((root[i] - trace[i]) * root[i] + minors[i]) * root[i] - determinant[i];
            let slope = (3.0 * root[i] - 2.0 * trace[i]) * root[i] + minors[i];
            let bend = 6.0 * root[i] - 2.0 * trace[i];
            let square = 4.0 * slope * slope - 6.0 * value * bend;
            step[i] = -3.0 * value / (slope + square.max(0.0).sqrt());
            root[i] += step[i];
        }
    }
    let [mut x, mut y, mut z] = [[0.0f64; LANES]; 3];
    for i in 0..LANES {
        let (a, b, c) = (xx[i] - root[i], yy[i] - root[i], zz[i] - root[i]);
        // The adjugate: cross products of the rows of A − λI.
        let (dxx, dyy, dzz) = (b * c - yz[i] * yz[i], a * c - xz[i] * xz[i], a * b - xy[i] * xy[i]);
        let (dxy, dxz, dyz) =
            (yz[i] * xz[i] - xy[i] * c, xy[i] * yz[i] - b * xz[i], xy[i] * xz[i] - a * yz[i]);
        let first = dxx * dxx + dxy * dxy + dxz * dxz;
        let second = dxy * dxy + dyy * dyy + dyz * dyz;
        let third = dxz * dxz + dyz * dyz + dzz * dzz;
        let (most, vx, vy, vz) =
            if second > first { (second, dxy, dyy, dyz) } else { (first, dxx, dxy, dxz) };
        let (most, vx, vy, vz) = if third > most { (third, dxz, dyz, dzz) } else { (most, vx, vy, vz) };
        // The slope of the polynomial at its root. It is positive at the largest root as well, but only the smallest one
        // is below a third of their sum.
        let gaps = (3.0 * root[i] - 2.0 * trace[i]) * root[i] + minors[i];
        let is_sure = (step[i].abs() <= ARRIVED * trace[i])
            & (gaps > LEAST_GAPS * (trace[i] * trace[i]))
            & (3.0 * root[i] < trace[i]);
        let length = if is_sure { most.sqrt() } else { f64::NAN };
        (x[i], y[i], z[i]) = (vx / length, vy / length, vz / length);
    }
    [x, y, z]
}

/// Sweeps after which the iteration ends in any case; four or five are enough in practice.
const MAX_SWEEPS: u32 = 16;

/// The iteration ends when this share of the sum of squares is left beside the diagonal: the eigenvector is then well
/// within the rounding of an f32 normal.
const LEFT: f64 = 1e-28;

/// Unit eigenvector of the smallest eigenvalue of the symmetric matrix
///
/// ```text
/// xx xy xz
/// xy yy yz
/// xz yz zz
/// ```
///
/// given as `[xx, xy, xz, yy, yz, zz]`; of equal eigenvalues the first in the order of the axes. Its sign is
/// arbitrary but fixed. Cyclic Jacobi (Golub & Van Loan, Matrix Computations, 8.5): rotations in the planes xy, xz,
/// yz in turn, until hardly anything is left beside the diagonal.
pub fn smallest_eigenvector(matrix: [f64; 6]) -> [f64; 3] {
    let (values, rows) = diagonalise(matrix);
    let mut smallest = 0;
    for axis in 1..3 {
        if values[axis] < values[smallest] {
            smallest = axis;
        }
    }
    unit(rows[smallest])
}

/// Unit eigenvectors of the smallest and of the largest eigenvalue of a matrix as [`smallest_eigenvector`] takes it, at
/// right angles even where eigenvalues are equal; of either sign.
pub fn extreme_eigenvectors(matrix: [f64; 6]) -> [[f64; 3]; 2] {
    let (values, rows) = diagonalise(matrix);
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    [unit(rows[order[0]]), unit(rows[order[2]])]
}

/// Eigenvalues, and in the same order eigenvectors of about unit length.
fn diagonalise([xx, xy, xz, yy, yz, zz]: [f64; 6]) -> ([f64; 3], [[f64; 3]; 3]) {
    // The upper triangle; the rest is never read.
    let mut matrix = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    // Row i turns into the eigenvector of the i-th diagonal entry.
    let mut rows = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    // Rotations keep the sum of squares.
    let total = xx * xx + yy * yy + zz * zz + 2.0 * (xy * xy + xz * xz + yz * yz);
    for _ in 0..MAX_SWEEPS {
        let [xy, xz, yz] = [matrix[0][1], matrix[0][2], matrix[1][2]];
        if xy * xy + xz * xz + yz * yz <= LEFT * total {
            break;
        }
        rotate(&mut matrix, &mut rows, (0, 1), (0, 2), (1, 2));
        rotate(&mut matrix, &mut rows, (0, 2), (0, 1), (1, 2));
        rotate(&mut matrix, &mut rows, (1, 2), (0, 1), (0, 2));
    }
    ([matrix[0][0], matrix[1][1], matrix[2][2]], rows)
}

fn unit([x, y, z]: [f64; 3]) -> [f64; 3] {
    let length = (x * x + y * y + z * z).sqrt();
    [x / length, y / length, z / length]
}

/// One Jacobi rotation in the plane of the axes (p, q), which makes that entry zero. `pr` and `qr` are the places of
/// the entries of p and of q with the third axis.
#[inline(always)]
fn rotate(
    matrix: &mut [[f64; 3]; 3],
    rows: &mut [[f64; 3]; 3],
    (p, q): (usize, usize),
    pr: (usize, usize),
    qr: (usize, usize),
) {
    let entry = matrix[p][q];
    if entry == 0.0 {
        return;
    }
    // The smaller root of t² + 2θt − 1, in the form that does not cancel.
    let theta = (matrix[q][q] - matrix[p][p]) / (2.0 * entry);
    let root = (theta * theta + 1.0).sqrt();
    // By sign bit, not by branch: the signs are random, and a wrong guess costs as much as the division.
    let tangent = 1.0f64.copysign(theta) / (theta.abs() + root);
    let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
    let sine = tangent * cosine;
    matrix[p][p] -= tangent * entry;
    matrix[q][q] += tangent * entry;
    matrix[p][q] = 0.0;
    let (a, b) = (matrix[pr.0][pr.1], matrix[qr.0][qr.1]);
    matrix[pr.0][pr.1] = cosine * a - sine * b;
    matrix[qr.0][qr.1] = sine * a + cosine * b;
    let (a, b) = (rows[p], rows[q]);
    rows[p] = [0, 1, 2].map(|axis| cosine * a[axis] - sine * b[axis]);
    rows[q] = [0, 1, 2].map(|axis| sine * a[axis] + cosine * b[axis]);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// Sums of a few outer products, some of them much smaller than the others, and rounding of either sign.
        #[test]
        fn lanes_are_sure_only_of_the_smallest_eigenvalue(
            vectors in prop::collection::vec((prop::array::uniform3(-1.0f64..1.0), -9i32..1), 1..5),
            rounding in prop::array::uniform6(-1.0f64..1.0),
            size in prop::sample::select(vec![0.0, 1e-16, 1e-8, 1e-7]),
        ) {
            let mut matrix = [0.0f64; 6];
            for ([x, y, z], exponent) in vectors {
                let scale = (0..-exponent).fold(1.0, |scale, _| scale / 10.0);
                for (entry, product) in matrix.iter_mut().zip([x * x, x * y, x * z, y * y, y * z, z * z]) {
                    *entry += scale * product;
                }
            }
            let trace = matrix[0] + matrix[3] + matrix[5];
            for (entry, rounding) in matrix.iter_mut().zip(rounding) {
                *entry += size * trace * rounding;
            }
            let lanes = smallest_eigenvectors(&matrix.map(|entry| [entry; LANES]));
            let found = lanes.map(|values| values[3]);
            let expected = smallest_eigenvector(matrix);
            let cosine: f64 = found.iter().zip(expected).map(|(a, b)| a * b).sum();
            prop_assert!(found[0].is_nan() || cosine.abs() > 1.0 - 1e-9, "{found:?}, expected {expected:?}");
        }
    }
}
