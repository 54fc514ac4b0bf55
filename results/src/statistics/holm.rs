//! Correction of p-values for the number of comparisons.

/// P-values adjusted so that the chance of calling any true null hypothesis false stays below the level they are
/// compared with (S. Holm, A simple sequentially rejective multiple test procedure, 1979): the k-th smallest of n times
/// n − k + 1, not below its predecessors, at most 1. In the order in which they were given.
pub fn holm(p_values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p_values.len()).collect();
    order.sort_by(|&a, &b| p_values[a].total_cmp(&p_values[b]));
    let mut adjusted = vec![0.0; p_values.len()];
    let mut least: f64 = 0.0;
    for (rank, &index) in order.iter().enumerate() {
        let hypotheses = (p_values.len() - rank) as f64;
        least = least.max((hypotheses * p_values[index]).min(1.0));
        adjusted[index] = least;
    }
    adjusted
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The procedure as Holm states it: reject in ascending order while p is at most level / (hypotheses left).
    fn rejected(p_values: &[f64], level: f64) -> Vec<bool> {
        let mut order: Vec<usize> = (0..p_values.len()).collect();
        order.sort_by(|&a, &b| p_values[a].total_cmp(&p_values[b]));
        let mut rejected = vec![false; p_values.len()];
        for (rank, &index) in order.iter().enumerate() {
            if p_values[index] > level / (p_values.len() - rank) as f64 {
                break;
            }
            rejected[index] = true;
        }
        rejected
    }

    #[test]
    fn an_adjusted_value_is_below_a_level_where_the_procedure_rejects() {
        let cases: [&[f64]; 5] =
            [&[0.01, 0.04, 0.03, 0.005], &[0.5], &[0.2, 0.2, 0.2], &[1.0, 0.0, 0.6, 0.013, 0.024], &[]];
        for p_values in cases {
            let adjusted = holm(p_values);
            for level in [0.001, 0.0203, 0.05, 0.0601, 0.1, 0.3, 0.61] {
                let found: Vec<bool> = adjusted.iter().map(|&p| p <= level).collect();
                assert_eq!(found, rejected(p_values, level), "{p_values:?} at {level}: {adjusted:?}");
            }
            assert!(adjusted.iter().all(|p| (0.0..=1.0).contains(p)));
        }
    }
}
