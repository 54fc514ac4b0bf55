//! Folders of runs with names of all kinds, and with great numbers of things.

use std::path::Path;
use std::time::{Duration, SystemTime};

use results::{
    AttemptRow, ComparedRow, Counts, Curve, CurvePoint, DistanceRow, EvaluationRow, EventRow, GeneColumn,
    GenerationRow, LookRow, PairRow, PredictionRow, PredictionSplit, RunFolder, RunLog, RunRow, SkippedRow,
    Times,
};

/// A name that is a script, an image of elsewhere and a mess.
pub(super) const HOSTILE: &str =
    "<script>document.title='run'</script><img src=http://127.0.0.1:9/x onerror=alert(1)>\"'&\u{1b}größe";

pub(super) fn at(milliseconds: u64) -> SystemTime {
    SystemTime::UNIX_EPOCH + Duration::from_millis(1_700_000_000_000 + milliseconds)
}

/// Writes a run of `generations` generations of `individuals` each with hostile names everywhere; finished if it has predictions.
pub(super) fn write_hostile(
    folder: &Path,
    [generations, individuals]: [u32; 2],
    objects: u32,
    attempts: u64,
) {
    let gene = GeneColumn {
        name: HOSTILE.to_owned(),
        unit: "cm".to_owned(),
        integer: false,
        meaning: HOSTILE.to_owned(),
    };
    let mut out = RunFolder::create(folder, &[gene]).unwrap();
    let counts = Counts { object_correct: 2900, category_correct: 2950, queries: 3000 };
    let individual = |generation, individual: u32| EvaluationRow {
        generation,
        individual,
        chromosome: format!("{individual:012b}"),
        genes: vec![Some(f64::from(individual))],
        // The first is the best; the others have as many errors as can be told apart.
        counts: Counts { object_correct: counts.object_correct - 7919 * individual % 2900, ..counts },
        objective_correct: None,
        margin: None,
        set_errors: None,
        parent_a: (generation > 1).then_some(0),
        parent_b: (generation > 1).then_some(1),
        elite: false,
        computed: None,
    };
    for generation in 1..=generations {
        let row = GenerationRow {
            generation,
            best_so_far_fitness: counts.fitness(),
            validation: None,
            validation_margin: None,
            hypervolume: None,
            mutation_rate: 0.4,
            seconds: 1.0,
        };
        let everybody: Vec<EvaluationRow> =
            (0..individuals).map(|place| individual(generation, place)).collect();
        out.write_generation(&everybody, &row).unwrap();
    }
    let name = |index: u32| format!("{HOSTILE}{index:03}");
    let prediction = |query: u32| PredictionRow {
        query,
        cloud: name(query),
        instance: name(query),
        category: HOSTILE.to_owned(),
        nearest_cloud: name(query + 1),
        predicted_instance: name((query + query % 2) % objects.max(1)),
        predicted_category: HOSTILE.to_owned(),
        distance: 1.0,
        runner_up: None,
    };
    let attempt = |job: u64| AttemptRow {
        job,
        attempt: 1,
        worker: format!("{HOSTILE}{}", job % 80),
        task: HOSTILE.to_owned(),
        handed_out_at: at(10 * job),
        ended_at: at(10 * job + 500),
        end: if job.is_multiple_of(7) { "lost" } else { "answered" }.to_owned(),
        reason: None,
        run_seconds: None,
    };
    let event = EventRow {
        at: at(1),
        event: HOSTILE.to_owned(),
        worker: None,
        generation: None,
        message: HOSTILE.to_owned(),
    };
    if objects == 0 {
        return;
    }
    out.write_predictions(PredictionSplit::Test, &(0..objects).map(prediction).collect::<Vec<_>>()).unwrap();
    let skipped =
        SkippedRow { split: HOSTILE.to_owned(), cloud: HOSTILE.to_owned(), reason: HOSTILE.to_owned() };
    out.write_skipped(&[skipped]).unwrap();
    let attempts = (0..attempts).map(attempt).collect();
    out.write_log(&RunLog { workers: Vec::new(), attempts, events: vec![event] }).unwrap();
    let run = RunRow {
        name: HOSTILE.to_owned(),
        search_config: "seed = 1\n".to_owned(),
        resolved_toml: HOSTILE.to_owned(),
        seed: 1,
        data_digest: "5f".repeat(32),
        evaluation_version: 1,
        program_version: HOSTILE.to_owned(),
        build: HOSTILE.to_owned(),
        host: HOSTILE.to_owned(),
        started_at: at(0),
        finished_at: at(9),
        seconds: 1.0,
        stop_reason: HOSTILE.to_owned(),
        generations,
        evaluations_computed: 0,
        evaluations_remembered: u64::from(generations * individuals),
        winner_generation: generations,
        winner_individual: 0,
        best_chromosome: format!("{:012b}", 0),
        best_genes: vec![Some(0.0)],
        train: counts,
        train_margin: None,
        train_effective: None,
        validation: None,
        validation_effective: None,
        weighted_winner: None,
        weighted_train: None,
        test: Some(Counts { object_correct: objects / 2, category_correct: objects, queries: objects }),
        grid_best_object_correct: Some(2950),
    };
    out.write_run(&run).unwrap();
}

pub(super) const DESCRIPTORS: [&str; 3] = ["evolved", "paper", "pfhrgb"];
/// A descriptor of a comparison on so many queries.
fn compared(descriptor: &str, objects: u32) -> ComparedRow {
    let counts = Counts { object_correct: objects / 2, category_correct: objects, queries: objects };
    ComparedRow {
        descriptor: descriptor.to_owned(),
        kind: "disk-ring".to_owned(),
        distance: "chi2".to_owned(),
        parameters: HOSTILE.to_owned(),
        size: Some(248),
        recogniser: Some("nearest".to_owned()),
        cloud_size: Some(496),
        settings: None,
        database_error: None,
        note: Some(HOSTILE.to_owned()),
        counts,
        object_wilson: [0.4, 0.6],
        category_wilson: [0.0, 0.1],
        object_bootstrap: [0.3, 0.7],
        category_bootstrap: [0.0, 0.2],
        skipped: 0,
        database: 9,
        keypoints_per_cloud: None,
        cloud_seconds: None,
        times: (descriptor == "paper").then(|| Times {
            read: 0.1,
            keypoints: 0.2,
            normals: 0.3,
            describe: 0.4,
            matching: 0.5,
            total: 1.6,
            hardware: HOSTILE.to_owned(),
        }),
        area: Some(0.5),
        nearest_area: None,
        bytes: None,
        file_digest: None,
    }
}

/// Adds a comparison with hostile names to a finished run, and two looks.
pub(super) fn write_comparison(folder: &Path, objects: u32) {
    let out = RunFolder::create(folder, &[]).unwrap();
    for reason in [HOSTILE, "again"] {
        let descriptors = DESCRIPTORS.join(" ");
        let (command, reason) = ("compare".to_owned(), reason.to_owned());
        out.record_look(&LookRow { at: at(0), command, reason, descriptors }).unwrap();
    }
    out.begin_comparison().unwrap();
    let answer = |query: u32| PredictionRow {
        query,
        cloud: HOSTILE.to_owned(),
        instance: format!("{HOSTILE}{query:03}"),
        category: HOSTILE.to_owned(),
        nearest_cloud: HOSTILE.to_owned(),
        predicted_instance: format!("{HOSTILE}{:03}", query / 2 * 2),
        predicted_category: HOSTILE.to_owned(),
        distance: 1.0,
        runner_up: None,
    };
    let answers: Vec<PredictionRow> = (0..objects).map(answer).collect();
    let point = |n: u64| CurvePoint { distance: n as f64, accepted: 3 * n + n % 7 + 1, relevant: n };
    let curve = |name| Curve { name, relevant: 20_000, points: (0..=20_000).map(point).collect() };
    for descriptor in DESCRIPTORS {
        out.write_compared(
            descriptor,
            &answers,
            &[curve("all"), curve("nearest")],
            &[DistanceRow { query: 0, database: 0, distance: 1.0 }],
        )
        .unwrap();
    }
    let pair = PairRow {
        level: "object".to_owned(),
        descriptor_a: "evolved".to_owned(),
        descriptor_b: "paper".to_owned(),
        both_right: 1,
        only_a: 2,
        only_b: 0,
        both_wrong: 3,
        difference_low: -0.5,
        difference_high: 0.1,
        p_value: 0.5,
        p_adjusted: 1.0,
    };
    let rows = DESCRIPTORS.map(|descriptor| compared(descriptor, objects));
    out.write_comparison(&rows, &[pair]).unwrap();
}

/// Adds a comparison of descriptors of these names, whatever they are, without answers.
pub(super) fn write_named(folder: &Path, names: &[&str]) {
    let out = RunFolder::create(folder, &[]).unwrap();
    out.begin_comparison().unwrap();
    let rows: Vec<ComparedRow> = names.iter().map(|name| compared(name, 9)).collect();
    out.write_comparison(&rows, &[]).unwrap();
}
