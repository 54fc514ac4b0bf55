//! Splits that were described before, channel by channel: results are those of clouds that are described here.

use proto::task::{DescribedShard, DescribedSplit, Failure, FailureReason, Scale, SplitManifest};

use super::signature_files::structure_evaluation;
use super::*;

/// The evaluation, and for each of its channels the subject of the descriptor that has this channel alone.
fn asked(archive: &Archive) -> (Evaluation, Vec<task::Subject>) {
    let evaluation = Evaluation { want_matches: true, ..structure_evaluation(archive) };
    let descriptor = Descriptor::from_bytes(evaluation.subject.descriptor.bytes()).unwrap();
    let alone = |(channel, _)| {
        let alone = Descriptor::of_channel(&channel).unwrap().to_bytes();
        task::Subject { descriptor: alone.into(), ..evaluation.subject.clone() }
    };
    (evaluation.clone(), descriptor.channels().into_iter().map(alone).collect())
}

/// Manifests of a split in shards of so many clouds, of which the last may have fewer.
fn shards(archive: &mut Archive, split: Digest, clouds: usize) -> Vec<Digest> {
    let all = SplitManifest::decode(&archive.blobs[&split.to_vec()]).unwrap().clouds;
    let shard = |clouds: &[_]| SplitManifest { split: String::new(), clouds: clouds.to_vec() }.encode();
    all.chunks(clouds).map(|clouds| archive.add(shard(clouds))).collect()
}

/// Has a split described in a channel, in these shards; returns the descriptions as well.
async fn describe_split(
    executor: &Arc<Executor>,
    alone: &task::Subject,
    (channel, split): (u32, Digest),
    shards: Vec<Digest>,
) -> (DescribedSplit, Vec<Vec<u8>>) {
    let (mut described, mut descriptions) = (Vec::new(), Vec::new());
    for manifest in shards {
        let bytes = describe_under(executor, alone.clone(), manifest).await;
        described.push(DescribedShard { manifest, description: Digest::of(&bytes) });
        descriptions.push(bytes);
    }
    (DescribedSplit { channel, split, shards: described }, descriptions)
}

async fn scale_of(executor: &Arc<Executor>, scale: Scale) -> f64 {
    match carry_out(executor, Task::Scale(scale)).await {
        TaskResult::Scale(scale) => scale,
        result => panic!("{result:?}"),
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn whoever_described_splits_evaluations_and_scales_are_the_same() {
    let mut archive = Archive::new();
    let (evaluation, alone) = asked(&archive);
    let plain = executor(&archive, LARGE, &store(None));
    let expected = carry_out(&plain, Task::Evaluation(evaluation.clone())).await;

    // One split whole, the other in shards of which the last is short.
    let [whole, divided] = [evaluation.query[0], evaluation.database[0]];
    let manifests = [(whole, vec![whole]), (divided, shards(&mut archive, divided, 4))];
    let describer = executor(&archive, LARGE, &store(None));
    let (mut described, mut blobs) = (Vec::new(), Vec::new());
    for (split, manifests) in manifests {
        for (channel, alone) in (0..).zip(&alone) {
            let (one, bytes) = describe_split(&describer, alone, (channel, split), manifests.clone()).await;
            described.push(one);
            blobs.extend(bytes);
        }
    }
    let shard_count = blobs.len() as u64;
    let asked = Task::Evaluation(Evaluation { described: described.clone(), ..evaluation.clone() });

    // The coordinator has none of the descriptions: they are made again, and are the same.
    let without = executor(&archive, LARGE, &store(None));
    assert_eq!(carry_out(&without, asked.clone()).await, expected);
    assert_eq!((without.work().described, without.work().handed), (alone.len() as u64 * 2 * SPLIT, 0));

    for bytes in blobs {
        archive.add(bytes);
    }
    for (memory, compresses) in [(LARGE, false), (TINY, true)] {
        archive.compresses = compresses;
        let other = executor(&archive, memory, &store(None));
        assert_eq!(carry_out(&other, asked.clone()).await, expected);
        assert_eq!((other.work().described, other.work().prepared), (0, 0));
        assert_eq!(other.work().handed, shard_count);
    }

    // What is not described by others is described here.
    let (first, _): (Vec<_>, Vec<_>) = described.iter().cloned().partition(|one| one.channel == 0);
    let partly = Task::Evaluation(Evaluation { described: first.clone(), ..evaluation.clone() });
    let other = executor(&archive, LARGE, &store(None));
    assert_eq!(carry_out(&other, partly).await, expected);
    assert_eq!(other.work().described, (alone.len() as u64 - 1) * 2 * SPLIT);

    let splits = vec![whole, divided];
    let subject = alone[0].clone();
    let scale = Scale { subject, splits, clouds: 0, described: Vec::new() };
    let expected = scale_of(&plain, scale.clone()).await;
    let other = executor(&archive, LARGE, &store(None));
    let got = scale_of(&other, Scale { described: first, ..scale }).await;
    assert_eq!((got.to_bits(), other.work().described), (expected.to_bits(), 0));
}

#[tokio::test(flavor = "multi_thread")]
async fn wrong_descriptions_of_a_split_are_taken_for_nothing_but_themselves() {
    let mut archive = Archive::new();
    let (evaluation, alone) = asked(&archive);
    let honest = executor(&archive, LARGE, &store(None));
    let expected = carry_out(&honest, Task::Evaluation(evaluation.clone())).await;
    let split = evaluation.query[0];
    let (right, mut bytes) = describe_split(&honest, &alone[0], (0, split), vec![split]).await;
    let mut wrong = bytes.remove(0);
    archive.add(wrong.clone());
    wrong.reverse();
    wrong.chunks_exact_mut(4).for_each(|value| value.reverse());
    let with = |described: &DescribedSplit| {
        Task::Evaluation(Evaluation { described: vec![described.clone()], ..evaluation.clone() })
    };
    let mut named = right.clone();
    named.shards[0].description = Digest::of(&wrong);

    // Where nobody has it any more, it cannot be made: the job fails rather than to answer something else.
    let failed = Arc::clone(&honest).carry_out(with(&named)).await.unwrap_err();
    assert!(matches!(failed, EvaluationError::Description { .. }), "{failed}");

    archive.add(wrong);
    let others = [(); 2].map(|()| executor(&archive, LARGE, &store(None)));
    let [one, two] = others.each_ref().map(|other| carry_out(other, with(&named)));
    let (one, two) = (one.await, two.await);
    assert_eq!(one, two);
    assert_ne!(one, expected);
    for other in &others {
        assert_eq!(carry_out(other, with(&right)).await, expected);
        assert_eq!(carry_out(other, Task::Evaluation(evaluation.clone())).await, expected);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn shards_of_other_clouds_or_channels_are_refused() {
    let mut archive = Archive::new();
    let (evaluation, alone) = asked(&archive);
    let [split, other] = [evaluation.query[0], evaluation.database[0]];
    let in_two = shards(&mut archive, split, 4);
    let executor = executor(&archive, LARGE, &store(None));
    let (right, _) = describe_split(&executor, &alone[0], (0, split), vec![split]).await;
    let bad = |change: &dyn Fn(&mut DescribedSplit)| {
        let mut described = right.clone();
        change(&mut described);
        let described = vec![described];
        Arc::clone(&executor).carry_out(Task::Evaluation(Evaluation { described, ..evaluation.clone() }))
    };
    let shard = |manifest| DescribedShard { manifest, description: Digest([1; 32]) };
    for (change, channel) in [
        (&(|one: &mut DescribedSplit| one.channel = 2) as &dyn Fn(&mut DescribedSplit), 2),
        (&|one: &mut DescribedSplit| one.channel = u32::MAX, u32::MAX),
        (&|one: &mut DescribedSplit| one.shards.clear(), 0),
        (&|one: &mut DescribedSplit| one.shards = vec![shard(other)], 0),
        (&|one: &mut DescribedSplit| one.shards = vec![shard(in_two[0])], 0),
        (&|one: &mut DescribedSplit| one.shards = vec![shard(in_two[1]), shard(in_two[0])], 0),
        (&|one: &mut DescribedSplit| one.shards.push(shard(in_two[1])), 0),
    ] {
        let error = bad(change).await.unwrap_err();
        let expected = format!("got others in channel {channel}\n");
        assert!(error.to_string().contains(&expected), "{error}");
        assert_eq!(Failure::from(error).reason, FailureReason::InvalidJob);
    }
}
