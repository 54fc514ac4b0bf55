//! How many clouds the counts of a fitness are worth, where some count more often than others.

use crate::dataset::Dataset;
use crate::fitness::Fitness;
use crate::run::matching::Matching;

/// The effective sample size of so many counted queries of a matching: (Σ w)² / Σ w², where w is how often a cloud counts
/// (L. Kish, Survey Sampling, 1965, 11.7). It takes what one cloud counts under several protocols for one answer, so that
/// intervals are rather too wide. Where some clouds are not counted, all weights are thought to lose the same share. `None`
/// where each cloud counts once: then it is their number.
pub fn effective_queries(
    dataset: &Dataset,
    (fitness, set_weights): (&Fitness, &[u32]),
    matching: Matching,
    queries: u32,
) -> Option<f64> {
    let parts = fitness.parts(matching);
    let mut clouds_of_weight: Vec<(u64, u64)> = Vec::new();
    for (set, &set_weight) in (0..).zip(set_weights) {
        for (split, indices) in dataset.splits.all().into_iter().enumerate() {
            let asked = parts.iter().filter(|part| part.query.contains(&split));
            let weight = u64::from(set_weight) * asked.map(|part| u64::from(part.weight)).sum::<u64>();
            clouds_of_weight.push((weight, dataset.clouds.of_set(indices, set).count() as u64));
        }
    }
    clouds_of_weight.retain(|&(weight, clouds)| weight > 0 && clouds > 0);
    effective_size(&clouds_of_weight, queries)
}

/// Of so many clouds with each weight.
fn effective_size(clouds_of_weight: &[(u64, u64)], queries: u32) -> Option<f64> {
    if clouds_of_weight.iter().all(|&(weight, _)| weight == 1) {
        return None;
    }
    let sum =
        |power| clouds_of_weight.iter().map(|&(weight, clouds)| weight.pow(power) * clouds).sum::<u64>();
    // (Σ w)² / Σ w², times the share of Σ w that is counted.
    Some(f64::from(queries) * sum(1) as f64 / sum(2) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clouds_that_count_alike_are_worth_their_number_however_often_they_count() {
        assert_eq!(effective_size(&[], 0), None);
        assert_eq!(effective_size(&[(1, 216), (1, 84)], 300), None);
        assert_eq!(effective_size(&[(100, 216)], 21_600), Some(216.0));
        assert_eq!(effective_size(&[(7, 100), (7, 50)], 1050), Some(150.0));
        // Of these, 30 clouds are not counted.
        assert_eq!(effective_size(&[(7, 100), (7, 50)], 840), Some(120.0));
    }

    #[test]
    fn clouds_that_count_more_than_others_are_worth_fewer() {
        // By the definition, cloud by cloud.
        let weights = [[2.0; 110].as_slice(), &[1.0; 106]].concat();
        let (sum, squares): (f64, f64) = (weights.iter().sum(), weights.iter().map(|w| w * w).sum());
        let worth = effective_size(&[(2, 110), (1, 106)], 326).unwrap();
        assert!((worth - sum * sum / squares).abs() < 1e-9, "{worth}");
        // One that counts for nearly all is worth little more than one.
        assert!(effective_size(&[(100, 1), (1, 10)], 110).is_some_and(|worth| (1.0..1.3).contains(&worth)));
    }
}
