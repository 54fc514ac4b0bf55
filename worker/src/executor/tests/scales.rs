//! The scale of a channel against its definition, and what an evaluation finds of it.

use descriptor::distance::chi_squared;
use proto::task::{CloudEntry, Failure, FailureReason, Scale, SplitManifest};

use super::*;

const BINS: u32 = 24;

fn hue() -> task::Subject {
    let space = SearchSpace::GlobalHue(Domain { low: 2, step: 1, count: 63 });
    let preparation = Preparation { preprocess: Preprocess::default(), space };
    subject(&preparation, Descriptor::GlobalHue(GlobalHue::new(BINS).unwrap()).to_bytes())
}

fn scale(splits: Vec<Digest>) -> Task {
    Task::Scale(Scale { subject: hue(), splits, clouds: 0, described: Vec::new() })
}

async fn scaled(executor: &Arc<Executor>, splits: Vec<Digest>) -> f64 {
    match carry_out(executor, scale(splits)).await {
        TaskResult::Scale(scale) => scale,
        result => panic!("{result:?}"),
    }
}

/// The distances of all pairs of clouds, sorted.
fn by_definition(archive: &Archive, splits: &[Digest]) -> Vec<f64> {
    let descriptor = Descriptor::GlobalHue(GlobalHue::new(BINS).unwrap());
    let preparer = SearchSpace::single(&descriptor).unwrap().preparer().unwrap();
    let (channel, _) = descriptor.channels().remove(0);
    let extractor = channel.extractor(&preparer).unwrap();
    let mut clouds = Vec::new();
    for split in splits {
        for cloud in SplitManifest::decode(&archive.blobs[&split.to_vec()]).unwrap().clouds {
            let source = pcd::read(&archive.blobs[&cloud.digest.to_vec()]).unwrap();
            let prepared = preparer.prepare(&source, &Preprocess::default()).unwrap();
            clouds.push(extractor.signatures(&[prepared]).unwrap());
        }
    }
    let mut distances = Vec::new();
    for (index, one) in clouds.iter().enumerate() {
        for other in &clouds[..index] {
            let [[centroid, deviation], [of_centroid, of_deviation]] = [one.get(0), other.get(0)];
            distances.push(chi_squared(centroid, of_centroid) + chi_squared(deviation, of_deviation));
        }
    }
    distances.sort_by(f32::total_cmp);
    distances.into_iter().map(f64::from).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_scale_has_a_twentieth_of_all_distances_below_it() {
    let archive = Archive::new();
    let executor = executor(&archive, LARGE, &store(None));
    for (splits, pairs, place) in [
        (archive.splits[..1].to_vec(), 15, 0),
        (archive.splits[..2].to_vec(), 66, 3),
        (archive.splits.clone(), 153, 7),
    ] {
        let distances = by_definition(&archive, &splits);
        assert_eq!((distances.len(), distances[place] > 0.0), (pairs, true));
        assert_eq!(scaled(&executor, splits).await.to_bits(), distances[place].to_bits());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn clouds_that_are_all_alike_or_alone_have_a_scale_of_one() {
    let mut archive = Archive::new();
    let cloud: CloudEntry =
        SplitManifest::decode(&archive.blobs[&archive.splits[0].to_vec()]).unwrap().clouds.remove(0);
    let [none, alone, alike] = [0, 1, 3].map(|count| {
        let clouds = vec![cloud.clone(); count];
        archive.add(SplitManifest { split: "some".to_owned(), clouds }.encode())
    });
    let executor = executor(&archive, LARGE, &store(None));
    for splits in [vec![], vec![none], vec![alone], vec![alike], vec![alone, alike]] {
        assert_eq!(scaled(&executor, splits).await, 1.0);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn scales_and_evaluations_of_the_same_clouds_compute_distances_once() {
    let archive = Archive::new();
    let training = archive.splits[..2].to_vec();
    let (query, database) = (training.clone(), training.clone());
    let evaluation = Evaluation { subject: hue(), query, database, ..Evaluation::sample(0, 0, 0) };
    let evaluation = Task::Evaluation(evaluation);
    for [first, second] in [[scale(training.clone()), evaluation.clone()], [evaluation, scale(training)]] {
        let executor = executor(&archive, LARGE, &store(None));
        carry_out(&executor, first).await;
        let done = executor.work();
        assert_eq!((done.matched, done.described), (1, 2 * SPLIT));
        carry_out(&executor, second).await;
        assert_eq!(executor.work(), done, "computed twice");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_descriptor_of_several_channels_has_no_scale() {
    let archive = Archive::new();
    let executor = executor(&archive, LARGE, &store(None));
    let subject = evaluation(&archive, descriptors()[0], false).subject;
    let task = Task::Scale(Scale {
        subject,
        splits: archive.splits[..1].to_vec(),
        clouds: 6,
        described: Vec::new(),
    });
    let error = executor.carry_out(task).await.unwrap_err();
    assert!(error.to_string().starts_with("scale: the descriptor must have 1 channel, got 2\n"), "{error}");
    assert_eq!(Failure::from(error).reason, FailureReason::InvalidJob);
}
