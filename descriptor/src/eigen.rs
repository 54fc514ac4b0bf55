//! Eigenvector of a symmetric 3×3 matrix from + − × ÷ √ alone, so that every target computes the same bits.

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
pub fn smallest_eigenvector([xx, xy, xz, yy, yz, zz]: [f64; 6]) -> [f64; 3] {
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
    let mut smallest = 0;
    for axis in 1..3 {
        if matrix[axis][axis] < matrix[smallest][smallest] {
            smallest = axis;
        }
    }
    let [x, y, z] = rows[smallest];
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
