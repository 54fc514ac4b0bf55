//! Evaluations that are asked for with their scales: they begin as soon as these are found, and are the same tasks as if
//! the scales had been known.

use super::*;

/// Scales of so many channels, of the clouds of two splits.
fn scales(splits: &[Digest], clouds: u32, count: u32) -> Vec<Scale> {
    let scale = |number| Scale {
        subject: Subject::sample(100 + number),
        splits: splits.to_vec(),
        clouds,
        described: vec![],
    };
    (0..count).map(scale).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn what_awaits_scales_is_asked_for_as_if_they_had_been_known(
        splits in prop::collection::vec(toys(9), 2..4),
        channels in prop::collection::vec([0usize..8, 0usize..8], 1..6),
        count in 1u32..20,
        seed in any::<u64>(),
    ) {
        let world = World::default();
        let clouds: Vec<u32> = splits.iter().map(|split| split.len() as u32).collect();
        let splits: Vec<Digest> =
            splits.iter().enumerate().map(|(index, split)| world.publish(&index.to_string(), split)).collect();
        // Of splits beyond the second nothing is matched: what was described of them is not named.
        let scales = scales(&splits, clouds.iter().sum(), 8);
        let evaluation = |number: usize| Evaluation {
            subject: Subject::sample(number as u32),
            query: vec![splits[0]],
            database: vec![splits[1], splits[0]],
            scales: vec![1.0, 1.0],
            ..Evaluation::sample(0, clouds[0], clouds[0] + clouds[1])
        };
        let awaiting = channels.iter().enumerate().map(|(number, [first, second])| AwaitingScales {
            evaluation: evaluation(number),
            awaited: vec![(0, *first), (1, *second)],
        });
        let awaiting: Vec<AwaitingScales> = awaiting.collect();
        let mut planner = Planner::default();
        planner.set_shard_count(ShardCount::Fixed(count.try_into().unwrap()));
        let mut jobs = JobStore::default();
        let ((done, found), _) = carry_out_with(&world, (&awaiting, &scales), &planner, &mut jobs, seed);

        let known: Vec<Evaluation> = channels.iter().enumerate().map(|(number, places)| {
            let mut known = evaluation(number);
            for (place, &scale) in places.iter().enumerate().rev() {
                found[scale].result.scale(place as u32, &mut known);
            }
            known
        }).collect();
        for (known, places) in known.iter().zip(&channels) {
            prop_assert_eq!(&known.scales, &places.map(|scale| world.scale(&scales[scale])));
            let named: Vec<(u32, Digest)> = known.described.iter().map(|one| (one.channel, one.split)).collect();
            let shared = if count == 1 { vec![] } else {
                let mut matched = [splits[0], splits[1]];
                matched.sort();
                let matched: BTreeSet<Digest> = matched.into();
                [0, 1].into_iter().flat_map(|place| matched.iter().map(move |&split| (place, split))).collect()
            };
            prop_assert_eq!(named, shared);
        }
        let (again, _) = carry_out(&world, &known, &planner, &mut jobs, !seed);
        for (done, again) in done.iter().zip(&again) {
            prop_assert_eq!(done.job, again.job);
            prop_assert_eq!(&done.result, &again.result);
        }
    }
}

#[test]
fn an_evaluation_begins_with_the_last_of_its_scales_whatever_others_wait_for() {
    let awaiting = |number, awaited: &[(u32, usize)]| AwaitingScales {
        evaluation: Evaluation { scales: vec![1.0; 3], ..Evaluation::sample(number, 2, 3) },
        awaited: awaited.to_vec(),
    };
    // The third channel of the first has a scale that is known, the last awaits nothing.
    let asked = [awaiting(1, &[(0, 0), (1, 1)]), awaiting(2, &[(2, 1), (0, 1)]), awaiting(3, &[])];
    let mut batch = Batch::new(asked.to_vec());
    let pairs = |count: u64| Waiting { evaluations: count as usize, pairs_cost: count * 6 * 60 };
    assert_eq!(batch.waiting(), pairs(3));
    let begin = |batch: &mut Batch| -> Vec<Task> {
        let ready = batch.take_ready();
        ready.into_iter().flat_map(|(index, evaluation)| batch.begin(index, (evaluation, None))).collect()
    };
    let subjects = |tasks: &[Task]| tasks.iter().map(|task| task.subject().clone()).collect::<Vec<_>>();
    assert_eq!(subjects(&begin(&mut batch)), [Subject::sample(3)]);
    let scales = scales(&[], 0, 2).into_iter().map(|scale| (scale, None)).collect();
    let tasks = batch.begin_scales(scales);
    assert_eq!((tasks.len(), batch.waiting()), (2, pairs(2)));

    let take = |batch: &mut Batch, place: usize, scale: f64| {
        let answer = finished(tasks[place - 1].job(0), TaskResult::Scale(scale), "one");
        assert_eq!(batch.take(place, answer), []);
        begin(batch)
    };
    let [begun] = &take(&mut batch, 2, 0.5)[..] else { panic!("the second evaluation") };
    let Task::Evaluation(evaluation) = begun else { panic!("{begun}") };
    assert_eq!((&evaluation.subject, &evaluation.scales[..]), (&Subject::sample(2), &[0.5, 1.0, 0.5][..]));
    assert_eq!(take(&mut batch, 2, 0.7), [], "it was answered before");
    let [begun] = &take(&mut batch, 1, 0.25)[..] else { panic!("the first evaluation") };
    let Task::Evaluation(evaluation) = begun else { panic!("{begun}") };
    assert_eq!((&evaluation.subject, &evaluation.scales[..]), (&Subject::sample(1), &[0.25, 0.5, 1.0][..]));
    assert_eq!(batch.waiting(), Waiting::default());
}

#[test]
#[should_panic(expected = "scale 3")]
fn a_scale_that_nobody_asks_for_is_not_awaited_for_ever() {
    let evaluation = Evaluation { scales: vec![1.0], ..Evaluation::sample(1, 2, 3) };
    Batch::new(vec![AwaitingScales { evaluation, awaited: vec![(0, 3)] }]).begin_scales(Vec::new());
}
