//! Every reader of bytes from outside, with inputs that it accepts: what `tests/fuzz` and `tests/cargo-fuzz` feed.

use std::fs;
use std::path::PathBuf;

use cache::Store;
use cache::{ByteSize, Storage};
use descriptor::genes::Domain;
use descriptor::pcd::{self, DataEncoding};
use descriptor::synth::{self, SynthSettings};
use descriptor::{Cloud, Descriptor, GENES, GeneTable, Parameters, Preprocess, QuantisedCloud, Quantiser};
use prost::Message as _;
use proto::{Digest, v1};

/// Of the descriptions that are fed: few bytes a cloud.
const DESCRIPTOR: Descriptor =
    Descriptor::DiskRing(Parameters { shape_bins: 8, colour_bins: 3, ..Parameters::PAPER_BEST });

type Feed = Box<dyn Fn(&[u8]) -> bool>;

/// One reader.
pub struct Reader {
    /// Its name, in words.
    pub name: &'static str,
    /// Inputs that it accepts.
    pub seeds: Vec<Vec<u8>>,
    /// Words that mean something to it.
    pub words: &'static [&'static str],
    /// Whether it accepts an input.
    pub feed: Feed,
}

fn reader(
    name: &'static str,
    words: &'static [&'static str],
    seeds: Vec<Vec<u8>>,
    feed: impl Fn(&[u8]) -> bool + 'static,
) -> Reader {
    Reader { name, seeds, words, feed: Box::new(feed) }
}

/// All of them. Files go to `folder`.
pub fn all(folder: PathBuf) -> Vec<Reader> {
    let cloud = cloud();
    let quantiser = Quantiser::new(&GeneTable::paper()).expect("the paper's table");
    let prepared =
        QuantisedCloud::new(&cloud, &Preprocess::default(), &quantiser).expect("a sound cloud").encode();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let journal = folder.join("journal.redb");
    vec![
        reader("pcd", PCD_WORDS, clouds(&cloud), |bytes| pcd::read(bytes).is_ok()),
        reader("prepared cloud", &[], vec![prepared], move |bytes| {
            let Ok(read) = QuantisedCloud::decode(bytes, &quantiser) else { return false };
            assert_eq!(read.encode(), bytes, "what is accepted is what would be written");
            true
        }),
        reader("description", &[], vec![vec![0; DESCRIPTOR.signature_bytes(2) as usize]], |bytes| {
            let Ok(read) = DESCRIPTOR.decode_signatures(bytes, 2) else { return false };
            assert_eq!(
                DESCRIPTOR.encode_signatures(&read),
                bytes,
                "what is accepted is what would be written"
            );
            true
        }),
        reader("experiment", TOML_WORDS, experiments(), move |bytes| {
            coordinator::fuzz_entry::experiment(&text(bytes))
        }),
        reader(
            "artefact settings",
            TOML_WORDS,
            vec![coordinator::fuzz_entry::sample_artefact_settings().into_bytes()],
            move |bytes| coordinator::fuzz_entry::artefact_settings(&text(bytes)),
        ),
        reader("poll", &[], vec![poll().encode_to_vec()], coordinator::fuzz_entry::poll),
        reader("fetch", &["..", "/", "prepared-cloud"], fetches(), coordinator::fuzz_entry::fetch),
        reader("reply", &[], vec![reply().encode_to_vec()], worker::fuzz_entry::reply),
        reader(
            "manifest",
            &["..", "/etc/passwd"],
            vec![manifest().encode_to_vec()],
            worker::fuzz_entry::manifest,
        ),
        entry(folder),
        reader("join address", JOIN_WORDS, join_addresses(), move |bytes| {
            let Ok(address) = text(bytes).parse::<proto::JoinAddress>() else { return false };
            let again = address.reveal().parse::<proto::JoinAddress>().expect("an address that was printed");
            assert_eq!(again.reveal(), address.reveal());
            true
        }),
        reader("journal header", &["\"version\":", "18446744073709551616"], vec![header()], |bytes| {
            coordinator::fuzz_entry::journal_header(bytes)
        }),
        reader("journal answer", &[], answers(), coordinator::fuzz_entry::journal_answer),
        reader(
            "journal file",
            &[],
            coordinator::fuzz_entry::sample_journal(&journal).into_iter().collect(),
            move |bytes| {
                fs::write(&journal, bytes).expect("room for the journal");
                coordinator::fuzz_entry::journal_file(&journal)
            },
        ),
    ]
}

const PCD_WORDS: &[&str] = &[
    "VERSION 0.7\n",
    "FIELDS x y z rgb\n",
    "SIZE 4 4 4 4\n",
    "TYPE F F F F\n",
    "COUNT 1 1 1 1\n",
    "WIDTH 4294967295\n",
    "HEIGHT 0\n",
    "POINTS 99999999\n",
    "DATA ascii\n",
    "DATA binary\n",
    "DATA binary_compressed\n",
    "nan",
    "1e39",
    "-0",
];
const TOML_WORDS: &[&str] = &[
    "[dataset]\n",
    "[genes]\n",
    "root = \"../..\"\n",
    "= -1\n",
    "= 1e999\n",
    "= \"off\"\n",
    "${HOME}",
    "[[",
    "]]",
    "version = 2\n",
    "18446744073709551616",
    "\u{0}",
];
const JOIN_WORDS: &[&str] =
    &["https://", "http://", "#ca=", "&token=", "[::1]", ":65536", "user@", "%00", "\n"];

fn cloud() -> Cloud {
    let settings = SynthSettings::default();
    let objects = synth::catalogue(&settings);
    let mut cloud = synth::render(&settings, &objects[0], 0);
    cloud.points.truncate(60);
    if let Some(colours) = &mut cloud.colours {
        colours.truncate(60);
    }
    cloud
}

fn clouds(cloud: &Cloud) -> Vec<Vec<u8>> {
    let encodings = [DataEncoding::Ascii, DataEncoding::Binary, DataEncoding::BinaryCompressed];
    encodings.map(|encoding| pcd::write(cloud, encoding)).to_vec()
}

fn experiments() -> Vec<Vec<u8>> {
    [
        include_str!("../../experiments/demo.toml"),
        include_str!("../../experiments/household.toml"),
        include_str!("../../experiments/paper.toml"),
        include_str!("../../coordinator/testdata/experiment-v1.toml"),
    ]
    .map(|text| text.as_bytes().to_vec())
    .to_vec()
}

fn lease() -> Option<v1::Lease> {
    Some(v1::Lease { job: 7, attempt: 2 })
}

fn poll() -> v1::PollRequest {
    let found = v1::Match { nearest: 3, distance: 0.25, runner_up: Some(4), runner_up_distance: Some(0.5) };
    let result =
        v1::EvaluationResult { queries: 9, object_correct: 5, category_correct: 6, matches: vec![found; 3] };
    let failure = v1::JobFailure { reason: 1, message: "disk full".to_owned() };
    let report = |outcome| v1::JobReport { lease: lease(), run_seconds: 0.5, outcome: Some(outcome) };
    v1::PollRequest {
        worker_id: vec![1; 16],
        session_id: vec![2; 16],
        sequence: 9,
        held: lease().into_iter().collect(),
        finished: vec![
            report(v1::job_report::Outcome::Result(result)),
            report(v1::job_report::Outcome::Failure(failure)),
            report(v1::job_report::Outcome::GridCell(v1::GridCellResult { object_correct: vec![1, 2, 3] })),
            report(v1::job_report::Outcome::Description(v1::DescriptionResult { parts: vec![0; 12] })),
        ],
        wanted: 2,
        leaving: false,
    }
}

fn reply() -> v1::PollReply {
    let domain = |domain: &Domain| v1::Domain { low: domain.low, step: domain.step, count: domain.count };
    let table = GeneTable::paper();
    let preparation = v1::Preparation {
        leaf_um: 20_000,
        normal_radius_um: 10_000,
        min_points: 10,
        colour: true,
        unit: v1::LengthUnit::Metre.into(),
        domains: GENES.iter().filter_map(|spec| table.domain(spec.kind)).map(domain).collect(),
    };
    let parameters = v1::Parameters {
        shape_bins: 60,
        colour_bins: 8,
        disk_um: 13_000,
        ring_um: 36_000,
        shape_weight_ppm: 670_000,
    };
    let splits = || vec![vec![3; 32]];
    let evaluation = v1::Evaluation {
        preparation: Some(preparation.clone()),
        parameters: Some(parameters),
        query: splits(),
        database: splits(),
        want_matches: true,
    };
    let cell = v1::GridCell {
        preparation: Some(preparation),
        disk_um: 13_000,
        ring_um: 36_000,
        query: splits(),
        database: splits(),
    };
    let description = v1::Description {
        preparation: evaluation.preparation.clone(),
        parameters: Some(parameters),
        manifest: vec![3; 32],
        fixed: None,
    };
    let tile =
        v1::Tile { evaluation: Some(evaluation.clone()), query_parts: splits(), database_parts: splits() };
    let job = v1::Job { lease: lease(), ..v1::Job::default() };
    v1::PollReply {
        acknowledged: lease().into_iter().collect(),
        revoked: lease().into_iter().collect(),
        jobs: vec![
            v1::Job { evaluation: Some(evaluation), ..job.clone() },
            v1::Job { grid_cell: Some(cell), ..job.clone() },
            v1::Job { description: Some(description), ..job.clone() },
            v1::Job { tile: Some(tile), ..job },
        ],
    }
}

fn fetches() -> Vec<Vec<u8>> {
    let blob = v1::FetchBlobRequest { digest: vec![5; 32] };
    let entry = v1::FetchDerivedRequest { kind: "prepared-cloud".to_owned(), key: vec![6; 32] };
    vec![blob.encode_to_vec(), entry.encode_to_vec()]
}

fn manifest() -> v1::SplitManifest {
    let cloud = v1::ManifestCloud {
        digest: vec![4; 32],
        bytes: 1000,
        category: 1,
        instance: 2,
        path: "a/a_1/a_1_1_1.pcd".to_owned(),
    };
    v1::SplitManifest { split: "train1".to_owned(), clouds: vec![cloud; 3] }
}

/// An entry that another machine has written, as it lies in a store.
fn entry(folder: PathBuf) -> Reader {
    let (kind, key) = ("fuzz", Digest([7; 32]));
    let storage = Storage {
        cache: Some(folder.join("store")),
        cache_size: ByteSize::mib(1),
        ..Storage::in_memory(ByteSize::mib(1))
    };
    let store = Store::open(&storage, "fuzz", descriptor::EVALUATION_VERSION);
    store.put(kind, key, b"what was derived");
    let seed = store.entry(kind, key).expect("an entry that was put");
    reader("cache entry", &[], vec![seed], move |bytes| worker::fuzz_entry::entry(&store, kind, key, bytes))
}

fn join_addresses() -> Vec<Vec<u8>> {
    let address = |host: &str| format!("https://{host}#ca={}&token={}", "ab".repeat(32), "cd".repeat(32));
    [address("gpu-host:7700"), address("[::1]:7700"), "http://127.0.0.1:7700".to_owned()]
        .map(String::into_bytes)
        .to_vec()
}

fn header() -> Vec<u8> {
    br#"{"magic":"descry journal","version":2,"search":"seed = 1\n","experiment":"version = 1\n","data_digest":"00","evaluation_version":2,"session":[7,7,7,7,7,7,7,7,7,7,7,7,7,7,7,7],"started_milliseconds":1700000000123}"#.to_vec()
}

/// As version 1 writes them: attempt, nanoseconds, seconds, label, counts, matches.
fn answers() -> Vec<Vec<u8>> {
    let mut bytes = Vec::new();
    bytes.extend(2u32.to_le_bytes());
    bytes.extend(1_234_567_891u64.to_le_bytes());
    bytes.extend(0.1f64.to_le_bytes());
    bytes.extend(6u32.to_le_bytes());
    bytes.extend(b"rack-3");
    for number in [10u32, 4, 6, 1, 3] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend(0.25f64.to_le_bytes());
    bytes.push(0);
    vec![bytes]
}
