//! Which clouds of a database are left out together while the settings of a recogniser are chosen (DESIGN 5b).

use std::collections::{BTreeMap, BTreeSet};

/// Folds where sequences are not known, and at most where they are.
const FOLDS: usize = 5;

/// The fold of each cloud of a database, from 0. `objects` and `sequences` are those of the clouds. Clouds of one sequence
/// are left out together, so that no cloud is recognised by another of its own video; of more than five sequences every
/// fifth is in the same fold. Where a cloud has no sequence, or all have the same, there are five folds by the position of
/// a cloud among those of its object.
pub fn folds(objects: &[u32], sequences: &[Option<u32>]) -> Vec<usize> {
    let known: Option<Vec<u32>> = sequences.iter().copied().collect();
    let names: BTreeSet<u32> = known.iter().flatten().copied().collect();
    match known {
        Some(known) if names.len() > 1 => {
            let place: BTreeMap<u32, usize> = names.into_iter().zip(0..).collect();
            known.iter().map(|sequence| place[sequence] % FOLDS).collect()
        }
        _ => {
            let mut seen: BTreeMap<u32, usize> = BTreeMap::new();
            let position = |object: &u32| {
                let next = seen.entry(*object).or_default();
                *next += 1;
                (*next - 1) % FOLDS
            };
            objects.iter().map(position).collect()
        }
    }
}

/// For each setting how many clouds are not recognised by what is learned from the other folds, and of how many;
/// `learn_and_judge` is given the clouds that are learned from, those that are asked, and returns for each setting
/// the number of wrong answers, or `None` if nothing can be learned from them by any. A setting of which it has none has
/// recognised no cloud of the fold. A cloud whose object is not among those that are learned from is not asked.
pub fn cross_validate(
    objects: &[u32],
    folds: &[usize],
    settings: usize,
    mut learn_and_judge: impl FnMut(&[usize], &[usize]) -> Option<Vec<Option<u32>>>,
) -> (Vec<u32>, u32) {
    let (mut wrong, mut asked) = (vec![0; settings], 0);
    for fold in 0..folds.iter().max().map_or(0, |last| last + 1) {
        let (queries, known): (Vec<usize>, Vec<usize>) =
            (0..objects.len()).partition(|&cloud| folds[cloud] == fold);
        let there: BTreeSet<u32> = known.iter().map(|&cloud| objects[cloud]).collect();
        let queries: Vec<usize> =
            queries.into_iter().filter(|&cloud| there.contains(&objects[cloud])).collect();
        let Some(of_fold) = learn_and_judge(&known, &queries) else { continue };
        asked += queries.len() as u32;
        let all_wrong = queries.len() as u32;
        wrong.iter_mut().zip(of_fold).for_each(|(all, of_fold)| *all += of_fold.unwrap_or(all_wrong));
    }
    (wrong, asked)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sequences_are_left_out_together() {
        let sequences = [Some(4), Some(1), Some(4), Some(9)];
        assert_eq!(folds(&[0, 0, 1, 1], &sequences), [1, 0, 1, 2]);
        let many: Vec<Option<u32>> = (0..12).map(Some).collect();
        assert_eq!(folds(&[0; 12], &many), [0, 1, 2, 3, 4, 0, 1, 2, 3, 4, 0, 1]);
    }

    #[test]
    fn without_sequences_positions_decide() {
        let objects = [7, 3, 7, 7, 3, 7, 7, 7];
        let expected = [0, 0, 1, 2, 1, 3, 4, 0];
        assert_eq!(folds(&objects, &[None; 8]), expected);
        assert_eq!(folds(&objects, &[Some(2); 8]), expected, "one sequence is none");
        let mut one_missing = [Some(1); 8];
        one_missing[2..].fill(Some(2));
        one_missing[0] = None;
        assert_eq!(folds(&objects, &one_missing), expected);
    }

    #[test]
    fn every_cloud_is_asked_once_by_the_others() {
        let (objects, folds) = ([0, 0, 1, 2, 1, 0], [0, 1, 0, 0, 1, 1]);
        let mut met = Vec::new();
        let (wrong, asked) = cross_validate(&objects, &folds, 2, |known, queries| {
            met.push((known.to_vec(), queries.to_vec()));
            Some(vec![Some(1), None])
        });
        // Object 2 has no other cloud.
        assert_eq!(met, [(vec![1, 4, 5], vec![0, 2]), (vec![0, 2, 3], vec![1, 4, 5])]);
        assert_eq!((wrong, asked), (vec![2, 5], 5));
        let (wrong, asked) = cross_validate(&objects, &folds, 1, |_, _| None);
        assert_eq!((wrong, asked), (vec![0], 0));
    }
}
