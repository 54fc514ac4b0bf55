//! Evaluations under matching rules against their definition, whole and in tiles.

use descriptor::distance::chi_squared;
use proto::task::{
    CloudEntry, Exclusion, Failure, FailureReason, MatchingRule, Nearest, Objective, SplitManifest,
};

use super::*;

fn rules() -> Vec<MatchingRule> {
    let mut rules = Vec::new();
    for exclude in [Exclusion::None, Exclusion::SameCloud, Exclusion::SameSequence] {
        for objective in [Objective::Object, Objective::Category] {
            rules.extend([false, true].map(|margin| MatchingRule { exclude, objective, margin }));
        }
    }
    rules
}

fn numbered() -> Archive {
    let mut archive = Archive::new();
    archive.number_sequences();
    archive
}

/// Both training sets against both.
fn among_training(archive: &Archive, rule: MatchingRule) -> Evaluation {
    let training = archive.splits[..2].to_vec();
    Evaluation {
        query: training.clone(),
        database: training,
        rule,
        ..evaluation(archive, descriptors()[0], false)
    }
}

fn entries(archive: &Archive, manifests: &[Digest]) -> Vec<CloudEntry> {
    let listed = |digest: &Digest| SplitManifest::decode(&archive.blobs[&digest.to_vec()]).unwrap().clouds;
    manifests.iter().flat_map(listed).collect()
}

/// The evaluation as it is defined: every query with every cloud, one after the other.
fn by_definition(archive: &Archive, asked: &Evaluation) -> EvaluationResult {
    let Ok(Descriptor::DiskRing(parameters)) = Descriptor::from_bytes(asked.subject.descriptor.bytes())
    else {
        panic!("{asked:?}")
    };
    let binning = QUANTISER.binning(&parameters).unwrap();
    let signatures = |cloud: &CloudEntry| binning.signatures(&[&PREPARED[&cloud.digest]]);
    let scale = |channel: usize| asked.scales.get(channel).copied().unwrap_or(1.0);
    let weights = [parameters.shape_weight() / scale(0), (1.0 - parameters.shape_weight()) / scale(1)];
    let distance = |one: &CloudEntry, other: &CloudEntry| {
        let mut sum = 0.0;
        for ((one, other), weight) in signatures(one).iter().zip(&signatures(other)).zip(weights) {
            let [[centroid, deviation], [of_centroid, of_deviation]] = [one.get(0), other.get(0)];
            sum +=
                weight * f64::from(chi_squared(centroid, of_centroid) + chi_squared(deviation, of_deviation));
        }
        sum
    };
    let (queries, database) = (entries(archive, &asked.query), entries(archive, &asked.database));
    let MatchingRule { exclude, objective, margin } = asked.rule;
    let mut result = EvaluationResult { margin: margin.then_some(0.0), ..EvaluationResult::default() };
    for query in &queries {
        let is_left = |cloud: &CloudEntry| match exclude {
            Exclusion::None => true,
            Exclusion::SameCloud => cloud.digest != query.digest,
            Exclusion::SameSequence => cloud.sequence.unwrap() != query.sequence.unwrap(),
        };
        let is_own = |cloud: &CloudEntry| match objective {
            Objective::Object => cloud.label.instance == query.label.instance,
            Objective::Category => cloud.label.category == query.label.category,
        };
        let left = (0u32..).zip(&database).filter(|(_, cloud)| is_left(cloud));
        let mut left: Vec<(f64, u32)> = left.map(|(index, cloud)| (distance(query, cloud), index)).collect();
        left.sort_by(|one, other| one.partial_cmp(other).unwrap());
        let first = |own: bool| {
            let found = left.iter().find(|(_, index)| is_own(&database[*index as usize]) == own);
            found.map(|&(distance, index)| (index, distance))
        };
        let nearest = Nearest { same: first(true), other: first(false) };
        if asked.want_matches {
            result.nearest.push(nearest);
        }
        let Some((_, same)) = nearest.same else { continue };
        let named = database[left[0].1 as usize].label;
        result.queries += 1;
        result.object_correct += u32::from(named.instance == query.label.instance);
        result.category_correct += u32::from(named.category == query.label.category);
        if let Some(margin) = &mut result.margin {
            *margin += match nearest.other {
                Some((_, other)) if other + same > 0.0 => (other - same) / (other + same),
                Some(_) => 0.0,
                None => 1.0,
            };
        }
    }
    result
}

async fn evaluated(executor: &Arc<Executor>, task: Task) -> EvaluationResult {
    match carry_out(executor, task).await {
        TaskResult::Evaluation(result) => result,
        result => panic!("{result:?}"),
    }
}

/// Equal bit for bit.
fn check(result: &EvaluationResult, expected: &EvaluationResult, asked: &Evaluation) {
    let fingerprint = |result: &EvaluationResult| TaskResult::Evaluation(result.clone()).fingerprint();
    assert_eq!(fingerprint(result), fingerprint(expected), "{:?}: {result:?} and {expected:?}", asked.rule);
}

/// Asked for all clouds of its splits, as a coordinator does.
fn counted(archive: &Archive, asked: Evaluation) -> Evaluation {
    let [queries, database_clouds] =
        [&asked.query, &asked.database].map(|side| entries(archive, side).len() as u32);
    Evaluation { queries, database_clouds, ..asked }
}

#[tokio::test(flavor = "multi_thread")]
async fn evaluations_under_every_rule_are_what_they_are_defined_to_be() {
    let archive = numbered();
    let executor = executor(&archive, LARGE, &store(None));
    let mut left_out = 0;
    for rule in rules().into_iter().filter(|rule| !rule.is_default()) {
        for (scales, want_matches) in [(vec![], true), (vec![0.03, 1.7], true), (vec![], false)] {
            let validation = Evaluation { rule, ..evaluation(&archive, descriptors()[2], true) };
            for asked in [among_training(&archive, rule), validation] {
                let asked = counted(&archive, Evaluation { scales: scales.clone(), want_matches, ..asked });
                let result = evaluated(&executor, Task::Evaluation(asked.clone())).await;
                check(&result, &by_definition(&archive, &asked), &asked);
                let task = Task::Evaluation(asked.clone());
                assert_eq!(task.check(&TaskResult::Evaluation(result.clone())), Ok(()));
                if asked.query == asked.database && rule.exclude == Exclusion::None {
                    assert_eq!(result.object_correct, asked.queries, "each is nearest to itself");
                }
                left_out += u32::from(result.queries < asked.queries);
            }
        }
    }
    // Each object is in both sequences and on both sides.
    assert_eq!(left_out, 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn queries_without_a_cloud_of_their_own_are_in_no_count() {
    let mut archive = numbered();
    // The first object in one sequence only, and of the second one cloud alone.
    let all = entries(&archive, &archive.splits[..2]);
    let of = |instance: u32| all.iter().filter(move |cloud| cloud.label.instance == instance);
    let mut clouds: Vec<CloudEntry> = of(0).filter(|cloud| cloud.sequence == Some(0)).cloned().collect();
    clouds.extend(of(1).take(1).cloned());
    clouds.extend(of(2).cloned());
    let split = archive.add(SplitManifest { split: "some".to_owned(), clouds: clouds.clone() }.encode());
    let executor = executor(&archive, LARGE, &store(None));
    for (exclude, counted_queries) in
        [(Exclusion::None, 7), (Exclusion::SameCloud, 6), (Exclusion::SameSequence, 4)]
    {
        let rule = MatchingRule { exclude, margin: true, ..MatchingRule::default() };
        let (query, database) = (vec![split], vec![split]);
        let asked = counted(&archive, Evaluation { query, database, ..among_training(&archive, rule) });
        let result = evaluated(&executor, Task::Evaluation(asked.clone())).await;
        check(&result, &by_definition(&archive, &asked), &asked);
        assert_eq!((asked.queries, result.queries), (7, counted_queries), "{exclude:?}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn tiles_have_the_nearest_clouds_of_their_part() {
    let archive = numbered();
    let executor = executor(&archive, LARGE, &store(None));
    let mut descriptions = Vec::new();
    for split in &archive.splits[..2] {
        descriptions.push(Digest::of(&describe(&executor, descriptors()[0], *split).await));
    }
    for rule in rules().into_iter().filter(|rule| !rule.is_default()) {
        let asked =
            counted(&archive, Evaluation { scales: vec![0.2, 0.3], ..among_training(&archive, rule) });
        let whole = evaluated(&executor, Task::Evaluation(asked.clone())).await;
        let mut merged = vec![Nearest::default(); asked.queries as usize];
        for part in [1, 0] {
            let tile = Tile {
                evaluation: counted(
                    &archive,
                    Evaluation { database: vec![archive.splits[part]], ..asked.clone() },
                ),
                query_descriptions: descriptions.clone(),
                database_descriptions: vec![descriptions[part]],
            };
            let result = evaluated(&executor, Task::Tile(tile.clone())).await;
            check(&result, &by_definition(&archive, &tile.evaluation), &asked);
            assert_eq!(Task::Tile(tile).check(&TaskResult::Evaluation(result.clone())), Ok(()));
            for (merged, part_of_it) in merged.iter_mut().zip(result.nearest) {
                *merged = merged.merge(part_of_it, part as u32 * SPLIT as u32);
            }
        }
        let labels: Vec<_> = entries(&archive, &asked.query).iter().map(|cloud| cloud.label).collect();
        let counts = rule.count(&merged, &labels, &labels);
        check(&EvaluationResult { nearest: merged, ..counts }, &whole, &asked);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn scales_change_nothing_but_weights() {
    let archive = Archive::new();
    let executor = executor(&archive, LARGE, &store(None));
    let [descriptor, ..] = descriptors();
    let asked = |scales| Task::Evaluation(Evaluation { scales, ..evaluation(&archive, descriptor, true) });
    let whole = evaluated(&executor, asked(vec![])).await;
    assert_eq!(TaskResult::Evaluation(whole.clone()), plain(&archive, descriptor, true));
    assert_eq!(evaluated(&executor, asked(vec![1.0, 1.0])).await, whole);
    // By a power of two nothing is rounded.
    let halved = evaluated(&executor, asked(vec![2.0, 2.0])).await;
    assert_ne!(halved.matches, whole.matches);
    for (halved, found) in halved.matches.iter().zip(&whole.matches) {
        assert_eq!((halved.nearest, halved.distance), (found.nearest, found.distance / 2.0));
    }
    // As far apart as scales can be, and distances still are some.
    let done = executor.work();
    let extreme = Evaluation {
        scales: vec![f64::from(f32::MIN_POSITIVE), f64::from(f32::MAX)],
        ..evaluation(&archive, descriptor, true)
    };
    let extreme = counted(&archive, extreme);
    let result = evaluated(&executor, Task::Evaluation(extreme.clone())).await;
    assert_eq!(Task::Evaluation(extreme).check(&TaskResult::Evaluation(result)), Ok(()));
    assert_eq!(executor.work(), done, "the distances in each channel are there");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_rule_about_sequences_needs_all_of_them() {
    let archive = numbered();
    let rule = MatchingRule { exclude: Exclusion::SameSequence, ..MatchingRule::default() };
    let (numbered, unnumbered) = (archive.splits[0], Archive::new().splits[1]);
    let executor = executor(&archive, LARGE, &store(None));
    for [query, database] in
        [[numbered, unnumbered], [unnumbered, numbered]].map(|side| side.map(|one| vec![one]))
    {
        let asked = Evaluation { query, database, ..among_training(&archive, rule) };
        let error = Arc::clone(&executor).carry_out(Task::Evaluation(asked)).await.unwrap_err();
        assert!(error.to_string().contains("must have a sequence"), "{error}");
        assert_eq!(Failure::from(error).reason, FailureReason::InvalidJob);
    }
    assert_eq!(executor.work().described, 0, "nothing is computed before that");
}
