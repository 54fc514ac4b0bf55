//! Matching with and without pruning: the clouds of a set, perturbed, as a database of 20 000.

use std::borrow::Cow;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use descriptor::prepare::{Normals, keypoints};
use descriptor::recognise::recognise_from;
use descriptor::structure::StructureFile;
use descriptor::{
    Cloud, Describer, Descriptor, DistanceMatrix, Label, Match, Parameters, Perturbation, Preprocess,
    PrunedDatabase, SetDistance, Signature, Signatures, pcd,
};
use rayon::prelude::*;

use tests::benches::household::Household;
use tests::benches::prepared::pool;
use tests::benches::table::{Samples, time};
use tests::experiments::repository;

/// Clouds of the database.
const CLOUDS: usize = 20_000;
/// Queries are matched so many at a time, in full and with pruning by turns.
const TURN: usize = 25;
/// Clouds that scales are found by.
const SCALED_BY: usize = 1000;

/// Queries, or the database.
struct Side {
    channels: Vec<Signatures>,
    labels: Vec<Label>,
}

/// What matching takes, in full and with pruning.
#[derive(Default)]
struct Cost {
    terms: [u64; 2],
    seconds: [f64; 2],
}

/// Measures both descriptors on both sets and prints a table.
pub fn measure(household: &Household) {
    println!(
        "\n| set | descriptor | values a cloud | queries | database | wanted | terms in full | terms with pruning | ratio | in full, a query | with pruning, a query | ratio | made in |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|"
    );
    for set in ["household-rgbd", "tabletop-rgbd"] {
        let root = household.root.with_file_name(set);
        for (name, descriptor) in descriptors() {
            let describer = Describer::new(&descriptor).unwrap();
            let database = Side::database(&root, &describer);
            let queries = Side::of(&root, &describer, &["test.txt"], |cloud, _| vec![cloud]);
            for clouds in [CLOUDS, 5000, 1000] {
                compare(&format!("{set} | {name}"), &descriptor, &queries, &database.spread(clouds));
            }
        }
    }
}

fn descriptors() -> [(&'static str, Descriptor); 2] {
    let path = repository().join("tests/benches/speed/evolved.toml");
    let text = fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let evolved: StructureFile = toml::from_str(&text).unwrap();
    [
        ("the paper's", Descriptor::DiskRing(Parameters::PAPER_BEST)),
        ("evolved", Descriptor::Structure(evolved.structure().unwrap())),
    ]
}

/// Matches all queries in both ways, on one thread, and prints a row for each kind of answer.
fn compare(name: &str, descriptor: &Descriptor, queries: &Side, database: &Side) {
    let scales = descriptor.scales(SetDistance::ChiSquared, &database.channels, SCALED_BY);
    let channels: Vec<(SetDistance, f64)> = descriptor
        .channels()
        .into_iter()
        .zip(scales)
        .map(|((channel, weight), scale)| (channel.metric(), weight / scale))
        .collect();
    let own = database.channels.iter().zip(&channels);
    let own: Vec<_> = own.map(|(known, &(metric, weight))| (Cow::Borrowed(known), metric, weight)).collect();
    let mut made = Vec::new();
    for _ in 0..3 {
        let clock = Instant::now();
        let _made = PrunedDatabase::new(own.clone(), &database.labels).unwrap();
        made.push(clock.elapsed().as_secs_f64());
    }
    let pruned = PrunedDatabase::new(own, &database.labels).unwrap();
    let (values, count) = (pruned.terms_in_full() as usize / database.labels.len(), queries.labels.len());
    for (wanted, runner_up) in [("nearest", false), ("and runner-up", true)] {
        let mut cost = Cost::default();
        cost.terms[1] = pruned.terms();
        for first in (0..count).step_by(TURN) {
            let asked: Vec<Signatures> =
                queries.channels.iter().map(|channel| part(channel, first, TURN)).collect();
            pool(1).install(|| turn(&asked, database, &channels, &pruned, runner_up, &mut cost));
        }
        let [full, with_pruning] = cost.terms;
        let [in_full, pruned_in] = cost.seconds.map(|seconds| seconds / count as f64);
        println!(
            "| {name} | {values} | {count} | {} | {wanted} | {full} | {with_pruning} | 1/{:.1} | {} | {} | 1/{:.1} | {} |",
            database.labels.len(),
            full as f64 / with_pruning as f64,
            time(in_full),
            time(pruned_in),
            in_full / pruned_in,
            time(made.iter().copied().collect::<Samples>().median()),
        );
    }
}

fn turn(
    asked: &[Signatures],
    database: &Side,
    channels: &[(SetDistance, f64)],
    pruned: &PrunedDatabase<'_>,
    runner_up: bool,
    cost: &mut Cost,
) {
    let clock = Instant::now();
    let matrices: Vec<(DistanceMatrix, f64)> = channels
        .iter()
        .zip(asked.iter().zip(&database.channels))
        .map(|(&(metric, weight), (asked, known))| (DistanceMatrix::by(metric, asked, known), weight))
        .collect();
    let expected = recognise_from(asked[0].clouds(), &matrices, &database.labels).unwrap();
    cost.seconds[0] += clock.elapsed().as_secs_f64();
    cost.terms[0] += asked[0].clouds() as u64 * pruned.terms_in_full();
    let clock = Instant::now();
    let (found, terms) = pruned.recognise(&asked.iter().collect::<Vec<_>>(), runner_up);
    cost.seconds[1] += clock.elapsed().as_secs_f64();
    cost.terms[1] += terms;
    let of = |found: &Match| Match { runner_up: found.runner_up.filter(|_| runner_up), ..*found };
    assert_eq!(found, expected.iter().map(of).collect::<Vec<_>>());
}

fn part(channel: &Signatures, first: usize, count: usize) -> Signatures {
    let signature = |cloud: usize| {
        let [centroid, deviation] = channel.get(cloud).map(<[f32]>::to_vec);
        Signature { centroid, deviation }
    };
    let signatures: Vec<Signature> = (first..(first + count).min(channel.clouds())).map(signature).collect();
    signatures.iter().collect()
}

impl Side {
    /// All clouds but those of the test list: as they are, and perturbed in each way and strength, with one seed and then with
    /// others.
    fn database(root: &Path, describer: &Describer) -> Self {
        let lists = ["train1.txt", "train2.txt", "validation.txt", "unused.txt"];
        Self::of(root, describer, &lists, |cloud, digest| {
            let ways = (1..=2u64).flat_map(|seed| {
                let strengths = (0..4).flat_map(|step| Perturbation::ALL.map(|kind| (kind, step)));
                strengths.map(move |(kind, step)| (kind, kind.strengths()[step], seed))
            });
            let perturbed =
                ways.take(20).map(|(kind, strength, seed)| kind.apply(strength, &cloud, seed, digest));
            let mut all: Vec<Cloud> = perturbed.collect();
            all.insert(0, cloud);
            all
        })
        .spread(CLOUDS)
    }

    /// Describes what is made of each cloud in some lists.
    fn of(
        root: &Path,
        describer: &Describer,
        lists: &[&str],
        made: impl Fn(Cloud, &[u8; 32]) -> Vec<Cloud> + Sync,
    ) -> Self {
        let read = |list: &&str| -> Vec<String> {
            let path: PathBuf = root.join(list);
            let text =
                fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
            text.lines().filter(|line| !line.is_empty()).map(str::to_owned).collect()
        };
        let names: Vec<String> = lists.iter().flat_map(read).collect();
        let mut objects: Vec<&str> = names.iter().map(|name| object(name)).collect();
        objects.sort_unstable();
        objects.dedup();
        let describe = |name: &String| -> Vec<(Label, Vec<Signature>)> {
            let bytes = fs::read(root.join(name)).unwrap();
            let clouds = made(pcd::read(&bytes).unwrap(), blake3::hash(&bytes).as_bytes());
            let instance = objects.iter().position(|other| *other == object(name)).unwrap() as u32;
            let described = clouds.iter().filter_map(|cloud| describe(describer, cloud));
            described.map(|signatures| (Label { category: 0, instance }, signatures)).collect()
        };
        let described: Vec<(Label, Vec<Signature>)> =
            names.par_iter().map(describe).collect::<Vec<_>>().into_iter().flatten().collect();
        let channels = (0..described[0].1.len())
            .map(|channel| described.iter().map(|(_, signatures)| &signatures[channel]).collect());
        Self { channels: channels.collect(), labels: described.iter().map(|(label, _)| *label).collect() }
    }

    /// So many of the clouds, all over the lists.
    fn spread(&self, count: usize) -> Self {
        let clouds: Vec<usize> =
            (0..count.min(self.labels.len())).map(|cloud| cloud * self.labels.len() / count).collect();
        let channel = |channel: &Signatures| -> Signatures {
            let one = |&cloud: &usize| {
                let [centroid, deviation] = channel.get(cloud).map(<[f32]>::to_vec);
                Signature { centroid, deviation }
            };
            clouds.iter().map(one).collect::<Vec<_>>().iter().collect()
        };
        Self {
            channels: self.channels.iter().map(channel).collect(),
            labels: clouds.iter().map(|&cloud| self.labels[cloud]).collect(),
        }
    }
}

/// The object that a path names.
fn object(name: &str) -> &str {
    name.split('/').nth(1).unwrap()
}

/// `None` of a cloud that takes no part.
fn describe(describer: &Describer, cloud: &Cloud) -> Option<Vec<Signature>> {
    let preprocess = Preprocess::default();
    let keypoints = keypoints(cloud, &preprocess).ok()?;
    let normals = Normals::new(cloud, &keypoints, &preprocess).ok()?;
    Some(describer.describe(cloud, &keypoints, &normals, &preprocess).ok()?.signatures)
}
