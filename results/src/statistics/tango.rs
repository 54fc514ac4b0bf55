//! How far a difference of two shares of the same trials can be trusted, where resampling says nothing: Tango's interval.

use super::wilson::Z;

/// The 95 % interval of (`only_b` − `only_a`) / `of` by Tango's score (T. Tango, Equivalence test and confidence interval
/// for the difference in proportions for the paired-sample design, Statistics in Medicine 17, 1998): of `of` pairs of
/// answers, at least 1, only the first is right in `only_a` and only the second in `only_b`. It holds for independent
/// pairs; clouds of one object are not, so that the truth is less certain still.
pub fn tango(only_a: u32, only_b: u32, of: u32) -> [f64; 2] {
    let (a, b, n) = (f64::from(only_a), f64::from(only_b), f64::from(of));
    let difference = (b - a) / n;
    // The score falls with the difference that it asks of: halved until no number lies between the ends.
    let end = |z: f64, mut inside: f64, mut outside: f64| {
        loop {
            let middle = f64::midpoint(inside, outside);
            if middle == inside || middle == outside {
                return middle;
            }
            if score(a, b, n, middle).abs() < z { inside = middle } else { outside = middle }
        }
    };
    [end(Z, difference, -1.0), end(Z, difference, 1.0)]
}

/// How many standard deviations the difference lies from `delta` if that is the truth.
fn score(a: f64, b: f64, n: f64, delta: f64) -> f64 {
    // The share of pairs in which only the first is right that is the likeliest if `delta` is the truth.
    let linear = (2.0 * n - b + a) * delta - b - a;
    let share =
        ((linear * linear + 8.0 * n * a * delta * (1.0 - delta)).max(0.0).sqrt() - linear) / (4.0 * n);
    let variance = n * (2.0 * share + delta * (1.0 - delta));
    let distance = b - a - n * delta;
    if distance == 0.0 { 0.0 } else { distance / variance.max(0.0).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The share of pairs in which only the first is right that makes these counts the likeliest if `delta` is the truth:
    /// where the derivative of the logarithm of share^a (share + delta)^b (1 - 2 share - delta)^(n - a - b) is 0.
    fn likeliest(a: f64, b: f64, n: f64, delta: f64) -> f64 {
        let part = |count: f64, share: f64| if count == 0.0 { 0.0 } else { count / share };
        let derivative = |share: f64| {
            part(a, share) + part(b, share + delta) - 2.0 * part(n - a - b, 1.0 - 2.0 * share - delta)
        };
        let (mut low, mut high) = ((-delta).max(0.0), (1.0 - delta) / 2.0);
        for _ in 0..100 {
            let middle = f64::midpoint(low, high);
            if derivative(middle) > 0.0 { low = middle } else { high = middle }
        }
        low
    }

    #[test]
    fn the_ends_are_the_differences_from_which_the_counts_are_z_deviations_away() {
        // The definition: |b - a - n d| = z * sqrt(n (2 q + d - d²)), q the likeliest share where only the first is right.
        for (only_a, only_b, of) in [(2, 12, 50), (0, 5, 50), (7, 7, 30), (1, 20, 475), (30, 3, 60)] {
            let [a, b, n] = [only_a, only_b, of].map(f64::from);
            for delta in tango(only_a, only_b, of) {
                let share = likeliest(a, b, n, delta);
                let deviation = (n * (2.0 * share + delta - delta * delta)).sqrt();
                let away = (b - a - n * delta).abs() / deviation;
                assert!((away - Z).abs() < 1e-6, "{only_a}, {only_b} of {of}: {delta} is {away} away");
            }
        }
    }

    #[test]
    fn equal_answers_are_no_proof_that_descriptors_are_equal() {
        // n d / sqrt(n |d| (1 - |d|)) = z where no pair differs: |d| = z² / (n + z²).
        for of in [1, 20, 475] {
            let end = Z * Z / (f64::from(of) + Z * Z);
            let [low, high] = tango(0, 0, of);
            assert!((low + end).abs() < 1e-12 && (high - end).abs() < 1e-12, "{of}: {low} {high}");
        }
    }

    #[test]
    fn the_difference_lies_between_the_ends_and_both_between_minus_one_and_one() {
        for (a, b, of) in [(0, 9, 9), (9, 0, 9), (3, 4, 7), (0, 1, 1), (0, 1, 100_000)] {
            let [low, high] = tango(a, b, of);
            let difference = (f64::from(b) - f64::from(a)) / f64::from(of);
            assert!(-1.0 <= low && low <= difference && difference <= high && high <= 1.0, "{low} {high}");
            let [other_low, other_high] = tango(b, a, of);
            assert!((low + other_high).abs() < 1e-9 && (high + other_low).abs() < 1e-9);
        }
    }
}
