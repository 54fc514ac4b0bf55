//! Every reader of bytes from outside, with inputs that it accepts: what `tests/fuzz` and `tests/cargo-fuzz` feed.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use artefact::{Database, DatabaseCloud, DatabasePart, DatabaseParts, metadata};
use cache::{ByteSize, Storage, Store};
use descriptor::pcd::{self, DataEncoding};
use descriptor::rgbd::{Camera, Images};
use descriptor::synth::{self, SynthSettings};
use descriptor::{
    Cloud, Descriptor, GeneTable, GlobalHue, Parameters, Preprocess, QuantisedCloud, Quantiser, SearchSpace,
    cloud_file, grid, ply, rgbd,
};
use parquet::basic::{Compression, ZstdLevel};
use parquet::data_type::{ByteArray, ByteArrayType, Int32Type};
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use png::{BitDepth, ColorType};
use prost::Message as _;
use proto::task::{
    CloudEntry, Described, DescribedShard, DescribedSplit, Description, Evaluation, EvaluationResult,
    Exclusion, Failure, FailureReason, GridCell, Label, Match, MatchingRule, Nearest, Objective, Report,
    Scale, SplitManifest, Subject, Task, TaskResult, Tile,
};
use proto::{Digest, JobId, Lease, LeaseNonce, v2};

use crate::ply_files::PlyFormat;

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
    let journal = folder.join("journal.log");
    vec![
        reader("pcd", PCD_WORDS, clouds(&cloud), |bytes| pcd::read(bytes).is_ok()),
        reader("ply", PLY_WORDS, ply_files(&cloud), |bytes| ply::read(bytes).is_ok()),
        reader(
            "cloud file",
            &["ply\n", "ply\r\n", "VERSION 0.7\n", "descry rgb-d 1\r\n"],
            [clouds(&cloud), ply_files(&cloud), images()].concat(),
            |bytes| cloud_file::read(bytes).is_ok(),
        ),
        reader("rgb-d images", &[], images(), |bytes| rgbd::read(bytes).is_ok()),
        reader(
            "camera",
            &["\"cam_K\":", "\"depth_scale\":", "1e308", "-0", "4294967296"],
            vec![
                b"271,189\n".to_vec(),
                br#"{"1":{"cam_K":[500.5,0.0,320.0,0.0,500.5,240.0,0.0,0.0,1.0],"depth_scale":0.1}}"#
                    .to_vec(),
            ],
            coordinator::fuzz_entry::camera,
        ),
        reader(
            "scene objects",
            &["\"obj_id\":", "18446744073709551615", "-1"],
            vec![br#"{"0":[{"obj_id":5,"cam_t_m2c":[0.5,1.0,500.0]},{"obj_id":1}],"17":[]}"#.to_vec()],
            coordinator::fuzz_entry::scene_objects,
        ),
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
            coordinator::fuzz_entry::sample_artefact_settings().map(String::into_bytes).to_vec(),
            move |bytes| coordinator::fuzz_entry::artefact_settings(&text(bytes)),
        ),
        reader(
            "control",
            &["\"action\":\"deny\",\"worker\":", "\"member\":", "\\u202e", "{\"done\":"],
            vec![coordinator::fuzz_entry::sample_request()],
            coordinator::fuzz_entry::control,
        ),
        reader("artefact database", &[], databases(&folder), |bytes| {
            // With the checksum of what the bytes have become, or nothing behind it would be reached.
            let mut bytes = bytes.to_vec();
            let _ = metadata::check(&mut bytes);
            let _ = metadata::seal(&mut bytes);
            artefact::decode_database(bytes, Path::new("database.parquet")).is_ok()
        }),
        reader("manifest table", &[], tables(), coordinator::fuzz_entry::manifest_table),
        reader("poll", &[], vec![poll().encode_to_vec()], coordinator::fuzz_entry::poll),
        reader("fetch", &["..", "/", "prepared-cloud"], fetches(), coordinator::fuzz_entry::fetch),
        reader("reply", &[], vec![reply().encode_to_vec()], worker::fuzz_entry::reply),
        reader("manifest", &["..", "/etc/passwd"], vec![manifest()], worker::fuzz_entry::manifest),
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
                let is_read = coordinator::fuzz_entry::journal_file(&journal);
                let _ = fs::remove_file(journal.with_extension("damaged-1")); // there if it was repaired
                is_read
            },
        ),
    ]
}

/// Parquet files of text and of whole numbers, without compression and with what other programs compress by.
fn tables() -> Vec<Vec<u8>> {
    let schema = "message table { optional binary path (UTF8); required binary category (STRING); optional int32 sequence; }";
    let table = |compression| {
        let properties = WriterProperties::builder().set_compression(compression).build();
        let schema = Arc::new(parse_message_type(schema).expect("a sound schema"));
        let mut writer =
            SerializedFileWriter::new(Vec::new(), schema, Arc::new(properties)).expect("a writer");
        let mut group = writer.next_row_group().expect("a row group");
        let texts = |texts: &[&str]| texts.iter().map(|&text| text.into()).collect::<Vec<ByteArray>>();
        let mut paths = group.next_column().expect("a column").expect("three columns");
        let two = texts(&["a.pcd", "b.pcd"]);
        paths.typed::<ByteArrayType>().write_batch(&two, Some(&[1, 0, 1]), None).expect("three rows");
        paths.close().expect("a whole column");
        let mut categories = group.next_column().expect("a column").expect("three columns");
        categories.typed::<ByteArrayType>().write_batch(&texts(&["cup"; 3]), None, None).expect("three rows");
        categories.close().expect("a whole column");
        let mut sequences = group.next_column().expect("a column").expect("three columns");
        sequences.typed::<Int32Type>().write_batch(&[7, -1], Some(&[1, 1, 0]), None).expect("three rows");
        sequences.close().expect("a whole column");
        group.close().expect("a whole row group");
        writer.into_inner().expect("a whole file")
    };
    let zstd = Compression::ZSTD(ZstdLevel::default());
    [Compression::UNCOMPRESSED, Compression::SNAPPY, zstd].map(table).to_vec()
}

const PCD_WORDS: &[&str] = &[
    "VERSION 0.7\n",
    "FIELDS x y z rgb\n",
    "FIELDS b x y z r g\n",
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
const PLY_WORDS: &[&str] = &[
    "ply\n",
    "format ascii 1.0\n",
    "format binary_little_endian 1.0\n",
    "format binary_big_endian 1.0\r\n",
    "comment \n",
    "element vertex 18446744073709551615\n",
    "element camera 1\n",
    "element face 9999999\n",
    "property list int double ids\n",
    "property ushort diffuse_red\n",
    "property char x\n",
    "property float view_px\n",
    "end_header\n",
    "nan",
    "-1",
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
    let mut files = encodings.map(|encoding| pcd::write(cloud, encoding)).to_vec();
    for (types, row) in
        [("U F U F F U\nSIZE 1 4 1 4 4 1", "9 1 8 2 3 7"), ("F F F F F F\nSIZE 4 4 4 4 4 4", "0 1 1 2 3 0.5")]
    {
        let header =
            format!("FIELDS b x r y z g\nTYPE {types}\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n{row}\n");
        files.push(header.into_bytes());
    }
    files
}

/// The cloud in each format of PLY, with a list in front of the points and a camera behind them.
fn ply_files(cloud: &Cloud) -> Vec<Vec<u8>> {
    [PlyFormat::Ascii, PlyFormat::LittleEndian, PlyFormat::BigEndian]
        .map(|format| format.write(cloud))
        .to_vec()
}

/// Images of two by two pixels, of colour and of grey.
fn images() -> Vec<Vec<u8>> {
    let png = |colour, bits, samples: &[u8]| {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 2, 2);
        encoder.set_color(colour);
        encoder.set_depth(bits);
        let mut writer = encoder.write_header().expect("room for the image");
        writer.write_image_data(samples).expect("samples of four pixels");
        drop(writer);
        bytes
    };
    let depth = png(ColorType::Grayscale, BitDepth::Sixteen, &[3, 232, 0, 0, 7, 208, 4, 0]);
    let mask = png(ColorType::Grayscale, BitDepth::One, &[0b1100_0000, 0b0100_0000]);
    let camera = Camera { focal_length: [570.3; 2], centre: [0.5; 2], depth_unit: 0.001 };
    let colours = [
        png(ColorType::Rgb, BitDepth::Eight, &[9; 12]),
        png(ColorType::Rgba, BitDepth::Sixteen, &[9; 32]),
        png(ColorType::Grayscale, BitDepth::Eight, &[9; 4]),
    ];
    let write = |colour: &Vec<u8>| rgbd::write(&camera, Images { colour, depth: &depth, mask: &mask });
    colours.iter().map(write).collect()
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

fn lease() -> Lease {
    Lease { job: JobId(7), attempt: 2, nonce: LeaseNonce([9; 16]) }
}

fn poll() -> v2::PollRequest {
    let found = Match { nearest: 3, distance: 0.25, runner_up: Some((4, 0.5)) };
    let (queries, object_correct, category_correct) = (9, 5, 6);
    let counts =
        EvaluationResult { queries, object_correct, category_correct, ..EvaluationResult::default() };
    let nearest = Nearest { same: Some((3, 0.25)), other: Some((4, 0.5)) };
    let ruled = EvaluationResult { nearest: vec![nearest; 3], margin: Some(2.5), ..counts.clone() };
    let outcomes = [
        Ok(TaskResult::Evaluation(EvaluationResult { matches: vec![found; 3], ..counts })),
        Ok(TaskResult::Evaluation(ruled)),
        Ok(TaskResult::Scale(0.25)),
        Err(Failure::new(FailureReason::Data, "disk full")),
        Ok(TaskResult::GridCell(vec![1, 2, 3])),
        Ok(TaskResult::Description(Described::new(vec![0; 12]))),
        Ok(TaskResult::Description(Described::made(vec![0; 99]))),
    ];
    let report = |outcome| Report { lease: lease(), run_seconds: 0.5, outcome }.into();
    v2::PollRequest {
        worker_id: vec![1; 16],
        worker_secret: vec![4; 32],
        session_id: vec![2; 16],
        sequence: 3,
        held: vec![lease().into()],
        finished: outcomes.into_iter().map(report).collect(),
        wanted: 2,
        leaving: false,
    }
}

fn reply() -> v2::PollReply {
    let space = SearchSpace::DiskRing(GeneTable::paper());
    let preparation = descriptor::Preparation { preprocess: Preprocess::default(), space }.to_bytes();
    let subject = |descriptor: Vec<u8>| Subject {
        preparation: preparation.clone().into(),
        descriptor: descriptor.into(),
        ..Subject::sample(1)
    };
    let best = subject(Descriptor::DiskRing(Parameters::PAPER_BEST).to_bytes());
    let splits = || vec![Digest([3; 32])];
    let (queries, database_clouds) = (9, 9);
    let evaluation = Evaluation {
        subject: best.clone(),
        query: splits(),
        database: splits(),
        queries,
        database_clouds,
        want_matches: true,
        rule: MatchingRule::default(),
        scales: Vec::new(),
        described: Vec::new(),
    };
    let described = vec![DescribedSplit {
        channel: 0,
        split: Digest([3; 32]),
        shards: vec![DescribedShard { manifest: Digest([3; 32]), description: Digest([4; 32]) }],
    }];
    let rule =
        MatchingRule { exclude: Exclusion::SameSequence, objective: Objective::Category, margin: true };
    let hue = Descriptor::GlobalHue(GlobalHue::default());
    let scaled = descriptor::Preparation {
        preprocess: Preprocess::default(),
        space: SearchSpace::single(&hue).expect("a space of one descriptor"),
    };
    let scaled = Subject {
        preparation: scaled.to_bytes().into(),
        descriptor: hue.to_bytes().into(),
        ..Subject::sample(1)
    };
    let cell = GridCell {
        subject: subject(grid::cell_to_bytes([13_000, 36_000])),
        query: splits(),
        database: splits(),
        queries,
        database_clouds,
        descriptors: 57 * 6 * 101,
    };
    let tasks = [
        Task::Evaluation(evaluation.clone()),
        Task::Evaluation(Evaluation { rule, scales: vec![0.5, 0.25], ..evaluation.clone() }),
        Task::Evaluation(Evaluation { described: described.clone(), ..evaluation.clone() }),
        Task::Scale(Scale { subject: scaled, splits: splits(), clouds: 9, described }),
        Task::GridCell(cell),
        Task::Description(Description { subject: best, manifest: Digest([3; 32]), clouds: 9 }),
        Task::Tile(Tile { evaluation, query_descriptions: splits(), database_descriptions: splits() }),
    ];
    let job = |task| v2::Job { lease: Some(lease().into()), task: Some(v2::Task::from(task)) };
    v2::PollReply {
        acknowledged: vec![lease().into()],
        revoked: vec![lease().into()],
        jobs: tasks.iter().map(job).collect(),
        run_ended: true,
    }
}

fn fetches() -> Vec<Vec<u8>> {
    let blob = v2::FetchBlobRequest { digest: vec![5; 32], takes_lz4: true };
    let entry = v2::FetchDerivedRequest { kind: "prepared-cloud".to_owned(), key: vec![6; 32] };
    vec![blob.encode_to_vec(), entry.encode_to_vec()]
}

fn manifest() -> Vec<u8> {
    let cloud = CloudEntry {
        digest: Digest([4; 32]),
        bytes: 1000,
        label: Label { category: 1, instance: 2 },
        path: "a/a_1/a_1_1_1.pcd".to_owned(),
        sequence: None,
    };
    let numbered = CloudEntry { sequence: Some(2), ..cloud.clone() };
    SplitManifest { split: "train1".to_owned(), clouds: vec![cloud.clone(), cloud, numbered] }.encode()
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

/// Of both forms, with and without what is optional.
fn databases(folder: &Path) -> Vec<Vec<u8>> {
    let cloud = DatabaseCloud {
        cloud: "a/a_1/a_1_1_1.pcd".to_owned(),
        instance: "a_1".to_owned(),
        category: "a".to_owned(),
        sequence: None,
        addition: None,
    };
    let added = DatabaseCloud { sequence: Some("2".to_owned()), addition: Some(1), ..cloud.clone() };
    let part =
        || DatabasePart { centroids: vec![0.25, 0.75, 0.5, 0.5], deviations: vec![0.0, 0.0, 0.1, 0.1] };
    [
        DatabaseParts::ShapeColour([part(), DatabasePart::default()]),
        DatabaseParts::Channels(vec![part(), part()]),
    ]
    .map(|parts| {
        let file = folder.join("database.parquet");
        let database = Database { clouds: vec![cloud.clone(), added.clone()], parts };
        results::write_database(&file, &database).expect("a database that can be written");
        fs::read(file).expect("a file that was written")
    })
    .to_vec()
}

fn join_addresses() -> Vec<Vec<u8>> {
    let address = |host: &str| format!("https://{host}#ca={}&token={}", "ab".repeat(32), "cd".repeat(32));
    [address("gpu-host:7700"), address("[::1]:7700"), "http://127.0.0.1:7700".to_owned()]
        .map(String::into_bytes)
        .to_vec()
}

fn header() -> Vec<u8> {
    br#"{"magic":"descry journal","version":3,"search":"seed = 1\n","experiment":"version = 1\n","data_digest":"00","evaluation_version":2,"session":[7,7,7,7,7,7,7,7,7,7,7,7,7,7,7,7],"secret":[8,8,8,8,8,8,8,8,8,8,8,8,8,8,8,8,8,8,8,8,8,8,8,8,8,8,8,8,8,8,8,8],"started_milliseconds":1700000000123}"#.to_vec()
}

/// As version 3 writes them: evaluations by the paper's rule and by another, a description and a scale.
fn answers() -> Vec<Vec<u8>> {
    use v2::accepted_result::Result;
    let found = v2::Match { nearest: 3, distance: 0.25, runner_up: None };
    let (queries, object_correct, category_correct) = (10, 4, 6);
    let counts =
        v2::EvaluationResult { queries, object_correct, category_correct, ..v2::EvaluationResult::default() };
    let evaluation = v2::EvaluationResult { matches: vec![found], ..counts.clone() };
    let same = Some(v2::Neighbour { index: 3, distance: 0.25 });
    let nearest = vec![v2::Nearest { same, other: None }];
    let ruled = v2::EvaluationResult { nearest, margin: Some(2.5), ..counts };
    let answer = |result| v2::AcceptedResult {
        worker: "rack-3".to_owned(),
        worker_id: vec![3; 16],
        principal: "token 192.0.2.7".to_owned(),
        assurance: v2::Assurance::Audited.into(),
        seconded: Some("coordinator".to_owned()),
        attempt: 2,
        queued_nanoseconds: 1_234_567_891,
        run_seconds: 0.1,
        result: Some(result),
    };
    let description = Result::Description(vec![7; 32]);
    [Result::Evaluation(evaluation), Result::Evaluation(ruled), description, Result::Scale(0.25)]
        .map(|result| answer(result).encode_to_vec())
        .to_vec()
}
