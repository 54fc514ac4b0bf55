//! Artefacts: what is taken away from a run answers as the run did.

use std::fs;
use std::path::Path;
use std::process::Stdio;

use artefact::DatabaseParts;
use expect_test::expect;
use results::{PredictionRow, PredictionSplit};
use serde_json::Value;

use crate::experiments::{Experiment, clouds, repository};
use crate::process::{Finished, finish, program, run};

const SHORT: &str = "[ga]\npopulation = 6\n[stop]\ngenerations = 2\nvalidation_patience = \"off\"\n";

/// A search for structures.
const STRUCTURES: &str = "[descriptor]\nfamily = \"structure\"\nmax_bins = 300\n\
    [ga]\npopulation = 8\n[stop]\nevaluations = 24\n[search.fitness]\ncross-sequence = 1\n";

/// A structure file with as many channels as there may be, two of which matter.
fn structure_file() -> String {
    let mut file = "version = 1\n\
        [[channel]]\npairs = \"cloud\"\nfeatures = [\"d 5\", \"c1 6\", \"c2 6\"]\nsquash = 0.3\n\
        radius_cm = 12\nsamples = 1024\nmetric = \"hellinger\"\n\
        [[channel]]\npairs = \"keypoints\"\nfeatures = [\"d 20\", \"hue 40\"]\nside_by_side = true\n\
        radius_cm = 20\ngrid_cm = 1\nscale = \"none\"\nmetric = \"l1\"\nweight = 0.25\n"
        .to_owned();
    for bins in 2..8 {
        file += &format!(
            "[[channel]]\npairs = \"cloud\"\nfeatures = [\"value {bins}\"]\nradius_cm = 20\nsamples = 64\n\
             weight = 0.01\n"
        );
    }
    file
}

/// A run of this structure alone.
fn one_written() -> String {
    let channels =
        structure_file().replace("version = 1\n", "").replace("[[channel]]", "[[descriptor.channel]]");
    format!("[ga]\npopulation = 6\n[stop]\ngenerations = 2\n[descriptor]\nfamily = \"structure\"\n{channels}")
}

/// Recognises clouds of the data root, named as in its lists.
fn recognise(root: &Path, artefact: &str, clouds: &[&str], options: &[&str]) -> Finished {
    let mut command = program("coordinator");
    finish(command.current_dir(root).args(["recognise", artefact]).args(clouds).args(options))
}

/// Values of one answer as JSON has them: equal texts are equal floats.
fn as_json(row: &PredictionRow) -> [(&'static str, Value); 7] {
    let runner_up = row.runner_up.as_ref();
    [
        ("cloud", row.cloud.clone().into()),
        ("nearest_cloud", row.nearest_cloud.clone().into()),
        ("predicted_instance", row.predicted_instance.clone().into()),
        ("predicted_category", row.predicted_category.clone().into()),
        ("distance", row.distance.into()),
        ("runner_up_cloud", runner_up.map(|other| other.cloud.clone()).into()),
        ("runner_up_distance", runner_up.map(|other| other.distance).into()),
    ]
}

/// An artefact's answers to all test clouds are the run's predictions, bit for bit.
#[track_caller]
fn check_answers(run: &str, root: &Path, artefact: &str) {
    let predictions = results::read_predictions(run, PredictionSplit::Test).unwrap();
    assert!(predictions.len() > 10);
    let queries: Vec<&str> = predictions.iter().map(|row| row.cloud.as_str()).collect();
    let finished = recognise(root, artefact, &queries, &["--json"]).expect_success();
    let lines: Vec<&str> = finished.stdout.lines().collect();
    assert_eq!(lines.len(), predictions.len(), "{finished}");
    for (row, line) in predictions.iter().zip(lines) {
        for (key, expected) in as_json(row) {
            // As text: reading a float from JSON may round it.
            let expected = format!("\"{key}\":{expected}");
            assert!(line.contains(&(expected.clone() + ",")), "no {expected} in {line}");
        }
    }
}

#[test]
fn an_artefact_answers_as_its_run_did_in_either_family_with_and_without_colour() {
    let colourless = format!("{SHORT}[descriptor]\ncolour = false\n");
    let colourless_structures = STRUCTURES.replace("[descriptor]\n", "[descriptor]\ncolour = false\n");
    for more in [SHORT, &colourless, STRUCTURES, &colourless_structures, &one_written()] {
        let experiment = Experiment::new(more);
        experiment.run("out", &[]).expect_success();
        let (out, artefact) = (experiment.path("out"), experiment.path("below/artefact"));
        let exported = run("coordinator", ["export", &out, &artefact]).expect_success();
        assert!(exported.stdout.contains(&format!("coordinator recognise {artefact}")), "{exported}");
        check_answers(&out, clouds(), &artefact);
        // Nothing else is made, and nothing of the run or its data is needed.
        assert_eq!(fs::read_dir(experiment.path("below")).unwrap().count(), 1);
        assert_eq!(fs::read_dir(&artefact).unwrap().count(), 5);
        // It is replaced by another, and the paper's descriptor answers, too.
        run("coordinator", ["export", &out, &artefact, "--descriptor", "paper"]).expect_success();
        let example = format!("{artefact}/example.pcd");
        let answer = run("coordinator", ["recognise", &artefact, &example, "--json"]).expect_success();
        let vector: Value =
            serde_json::from_str(&fs::read_to_string(format!("{artefact}/test-vector.json")).unwrap())
                .unwrap();
        let answer: Value = serde_json::from_str(&answer.stdout).unwrap();
        for key in ["predicted_instance", "nearest_cloud", "distance", "runner_up_distance"] {
            assert_eq!(answer[key], vector[key], "{key}");
        }
        let readme = fs::read_to_string(format!("{artefact}/README.md")).unwrap();
        assert!(readme.contains("Not measured"), "{readme}");
    }
}

#[test]
fn clouds_are_answered_one_by_one_and_those_without_an_answer_are_named() {
    let experiment = Experiment::new(SHORT);
    experiment.run("out", &[]).expect_success();
    let (out, artefact) = (experiment.path("out"), experiment.path("artefact"));
    run("coordinator", ["export", &out, &artefact]).expect_success();
    let readme = fs::read_to_string(format!("{artefact}/README.md")).unwrap();
    assert!(readme.contains("95 % interval"), "{readme}");

    let good = results::read_predictions(&out, PredictionSplit::Test).unwrap().remove(0);
    let (broken, empty) = (experiment.path("broken.pcd"), experiment.path("empty.pcd"));
    fs::write(&broken, "FIELDS x y").unwrap();
    fs::write(&empty, "FIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 0\nHEIGHT 1\nPOINTS 0\nDATA ascii\n").unwrap();
    let names = [broken.as_str(), "not there.pcd", &good.cloud, &empty];
    let answered = recognise(clouds(), &artefact, &names, &["--top", "3", "--times"]).expect_error();
    assert_eq!(answered.status.code(), Some(1));
    let answer = format!("{}: {} ({})", good.cloud, good.predicted_instance, good.predicted_category);
    assert!(answered.stdout.starts_with(&answer), "{answered}");
    // The answer, three objects, the times.
    assert_eq!(answered.stdout.lines().count(), 5, "{answered}");
    for (name, reason) in [
        (&*broken, "header"),
        ("not there.pcd", "cannot be read"),
        (&empty, "fewer than 10 usable points, got 0"),
    ] {
        let said = answered.stderr.lines().find(|line| line.starts_with(&format!("error: {name}: ")));
        assert!(said.is_some_and(|line| line.contains(reason)), "{name}: {answered}");
    }

    let input = fs::File::open(clouds().join(&good.cloud)).unwrap();
    let mut command = program("coordinator");
    let piped =
        finish(command.args(["recognise", &artefact, "-"]).stdin(Stdio::from(input))).expect_success();
    assert!(piped.stdout.starts_with(&answer.replace(&good.cloud, "-")), "{piped}");
}

#[test]
fn what_cannot_be_taken_away_is_refused_and_nothing_is_lost() {
    let experiment = Experiment::with(&format!("version = 1\n[dataset]\nroot = \"data\"\n{SHORT}"));
    let data = experiment.path("data");
    run("coordinator", ["synth", &data, "--objects", "2", "--views", "6"]).expect_success();
    let (out, artefact) = (experiment.path("out"), experiment.path("artefact"));
    let refused = |args: &[&str], complaint: &str| {
        let refused = run("coordinator", [&["export"], args].concat()).expect_error();
        let (first, advice) =
            refused.stderr.trim_end().split_once('\n').unwrap_or_else(|| panic!("{refused}"));
        assert!(first.contains(complaint) && !advice.is_empty(), "{complaint}: {refused}");
    };
    refused(&[&out, &artefact], "no such run folder");
    fs::create_dir(&out).unwrap();
    refused(&[&out, &artefact], "run is not finished");
    experiment.run("out", &[]).expect_success();

    // Somebody else's folder, or file.
    let occupied = experiment.path("occupied");
    fs::create_dir(&occupied).unwrap();
    fs::write(format!("{occupied}/README.md"), "mine").unwrap();
    fs::write(format!("{occupied}/thesis.tex"), "mine").unwrap();
    refused(&[&out, &occupied], "must be a new folder or an artefact, got a folder with thesis.tex");
    assert_eq!(fs::read_dir(&occupied).unwrap().count(), 2);
    refused(&[&out, &experiment.path("exp.toml")], "must be a new folder or an artefact, got a file");

    run("coordinator", ["export", &out, &artefact]).expect_success();
    let settings = fs::read_to_string(format!("{artefact}/descriptor.toml")).unwrap();

    // The data set may move, but not change.
    let moved = experiment.path("moved");
    fs::rename(&data, &moved).unwrap();
    refused(&[&out, &artefact], "data");
    run("coordinator", ["export", &out, &artefact, "--data", &moved]).expect_success();
    let list = fs::read_to_string(format!("{moved}/train1.txt")).unwrap();
    let (first, last) = (list.lines().next().unwrap(), list.lines().next_back().unwrap());
    fs::copy(Path::new(&moved).join(last), Path::new(&moved).join(first)).unwrap();
    refused(&[&out, &artefact, "--data", &moved], "data digest must be");

    // Nor may the run.
    let generation = Path::new(&out).join("generations/generation-00001.parquet");
    let mut bytes = fs::read(&generation).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&generation, bytes).unwrap();
    refused(&[&out, &artefact, "--data", &moved], "run must be sound");
    assert_eq!(fs::read_to_string(format!("{artefact}/descriptor.toml")).unwrap(), settings);
}

#[test]
fn a_sweep_has_no_one_winner() {
    let sweep = Experiment::new(&format!("{SHORT}[sweep]\nseeds = [1, 2]\n"));
    sweep.run("out", &[]).expect_success();
    let (out, artefact) = (sweep.path("out"), sweep.path("artefact"));
    let refused = run("coordinator", ["export", &out, &artefact]).expect_error();
    assert!(refused.stderr.contains("must be one run, got a sweep of 2"), "{refused}");
    let member = format!("{out}/seed-2");
    run("coordinator", ["export", &member, &artefact]).expect_success();
    check_answers(&member, clouds(), &artefact);
}

/// Digests in the text cover the database and the test vector, its own the rest: whoever changes one of them changes
/// what every artefact holds.
#[test]
fn artefacts_of_disk_ring_stay_as_they_are() {
    let experiment = Experiment::new(SHORT);
    experiment.run("out", &[]).expect_success();
    let (out, artefact) = (experiment.path("out"), experiment.path("artefact"));
    run("coordinator", ["export", &out, &artefact]).expect_success();
    expect![[r#"
        version = 2
        digest = "3d48e86cfede1ca70184d72cacc1bd7ebd9cad5a3dd8204217aa153cf040700f"
        name = "short"
        evaluation_version = 2
        run_digest = "4f6eb036a7dae89d1af628d2523dddde95e7fe015ce9d1f6d8c12e7a564f5517"
        data_digest = "9614cc87b1d2c8c2613a84481317702bdcbb05509b34ce5a841aa6b7a79e594e"
        set_distance = "chi2"
        unit = "m"

        [preprocess]
        leaf_cm = 2.0
        normal_radius_cm = 1.0
        min_points = 10

        [descriptor]
        colour = true

        [descriptor.genes]
        shape_bins = 35
        m = 5
        R1 = 1.3
        R2 = 2.3
        w = 0.07

        [reject]
        false_rejections = 0.05
        typical_distance = 0.06396173812448978
        coefficients = [1.8742317092116347, -1.1819085639578424, 0.4301406386535541, 0.0]
        least_probability = 0.2521527297993582
        least_margin = 0.005398435369133946

        [database]
        clouds = 48
        digest = "bd58df0999ce9a750234ee9dd479af2d4c84009789598d56ba267ed387495f82"

        [test_vector]
        digest = "8ba49902fd4957572e1ffcc226acff748e1b6fd0d07171ec9243dc23f0d1a651"
    "#]]
    .assert_eq(&fs::read_to_string(format!("{artefact}/descriptor.toml")).unwrap());
}

#[test]
fn an_artefact_of_a_structure_holds_its_channels_and_scales() {
    let experiment = Experiment::new(STRUCTURES);
    experiment.run("out", &[]).expect_success();
    let (out, artefact) = (experiment.path("out"), experiment.path("artefact"));
    run("coordinator", ["export", &out, &artefact]).expect_success();
    let file = format!("{artefact}/descriptor.toml");
    let text = fs::read_to_string(&file).unwrap();
    let channels = text.matches("[[descriptor.channel]]").count();
    let (_, scales) = text.split_once("scales = [").unwrap();
    let scales: Vec<f64> =
        scales.split_once(']').unwrap().0.split(',').map(|scale| scale.trim().parse().unwrap()).collect();
    assert!(channels > 1 && scales.len() == channels, "{text}");
    assert!(scales.iter().all(|&scale| scale > 0.0 && scale != 1.0), "{text}");
    let (database, _) = artefact::read_database(format!("{artefact}/database.parquet")).unwrap();
    let DatabaseParts::Channels(parts) = &database.parts else { panic!("a table of channels") };
    assert_eq!((database.clouds.len(), parts.len()), (48, channels));
    let vector: Value =
        serde_json::from_str(&fs::read_to_string(format!("{artefact}/test-vector.json")).unwrap()).unwrap();
    assert_eq!(vector["channels"].as_array().unwrap().len(), channels);
    assert!(vector.get("shape").is_none(), "{vector}");
    let readme = fs::read_to_string(format!("{artefact}/README.md")).unwrap();
    assert!(readme.contains(&format!(", scale {}\n", scales[0])), "{readme}");

    // Other scales have another digest.
    fs::write(&file, text.replacen("scales = [", "scales = [9", 1)).unwrap();
    let example = format!("{artefact}/example.pcd");
    let refused = run("coordinator", ["recognise", &artefact, &example]).expect_error();
    assert!(refused.stderr.contains("descriptor.toml: digest must be "), "{refused}");
}

/// The nearest cloud of each test cloud of a run, by the artefact of a descriptor that the run has not tested.
#[track_caller]
fn nearest(experiment: &Experiment, descriptor: [&str; 2]) -> Vec<String> {
    let (out, artefact) = (experiment.path("out"), experiment.path("artefact"));
    run("coordinator", ["export", &out, &artefact].into_iter().chain(descriptor)).expect_success();
    let readme = fs::read_to_string(format!("{artefact}/README.md")).unwrap();
    assert!(readme.contains("Not measured"), "{readme}");
    let predictions = results::read_predictions(&out, PredictionSplit::Test).unwrap();
    let queries: Vec<&str> = predictions.iter().map(|row| row.cloud.as_str()).collect();
    assert!(queries.len() > 10);
    let answered = recognise(clouds(), &artefact, &queries, &["--json"]).expect_success();
    let cloud = |line: &str| {
        let answer: Value = serde_json::from_str(line).unwrap();
        answer["nearest_cloud"].as_str().unwrap().to_owned()
    };
    answered.stdout.lines().map(cloud).collect()
}

/// The paper's descriptor as a structure gives the answers of the paper's, any structure those of a run of it: whatever
/// family and keypoints the run has whose clouds are taken.
#[test]
fn a_structure_by_hand_is_taken_with_the_runs_clouds() {
    let of_structures = Experiment::new(STRUCTURES);
    let of_other_leaf = Experiment::new(&format!("{SHORT}[preprocess]\nleaf_cm = 1.5\n"));
    let of_the_file = Experiment::new(&one_written());
    for experiment in [&of_structures, &of_other_leaf, &of_the_file] {
        experiment.run("out", &[]).expect_success();
    }
    let paper = repository().join("experiments/descriptors/paper.toml").display().to_string();
    let expected = nearest(&of_structures, ["--descriptor", "paper"]);
    assert_eq!(nearest(&of_structures, ["--structure", &paper]), expected);
    assert_eq!(nearest(&of_other_leaf, ["--structure", &paper]), expected);

    // Also with the scales that its run has found.
    let file = of_the_file.path("structure.toml");
    fs::write(&file, structure_file()).unwrap();
    nearest(&of_other_leaf, ["--structure", &file]);
    check_answers(&of_the_file.path("out"), clouds(), &of_other_leaf.path("artefact"));
}

/// On few clouds: all pairs of PFHRGB take long.
#[test]
fn shipped_structures_answer_as_evaluated() {
    let experiment = Experiment::with(&format!("version = 1\n[dataset]\nroot = \"data\"\n{SHORT}"));
    let data = experiment.path("data");
    run("coordinator", ["synth", &data, "--objects", "2", "--views", "6"]).expect_success();
    experiment.run("out", &[]).expect_success();
    let (out, artefact, evaluated) =
        (experiment.path("out"), experiment.path("artefact"), experiment.path("nearest.txt"));
    for name in ["paper.toml", "pfhrgb.toml", "cospair.toml"] {
        let file = repository().join("experiments/descriptors").join(name).display().to_string();
        let lists = ["--query", "test.txt", "--database", "train1.txt", "train2.txt", "validation.txt"];
        let args = ["evaluate", "--data", &data, "--nearest", &evaluated, "--structure", &file];
        run("coordinator", args.into_iter().chain(lists)).expect_success();
        run("coordinator", ["export", &out, &artefact, "--structure", &file]).expect_success();
        let evaluated = fs::read_to_string(&evaluated).unwrap();
        let rows: Vec<Vec<&str>> = evaluated.lines().map(|line| line.split(' ').collect()).collect();
        let queries: Vec<&str> = rows.iter().map(|row| row[0]).collect();
        let answered = recognise(data.as_ref(), &artefact, &queries, &["--json"]).expect_success();
        assert!(!rows.is_empty(), "{name}");
        assert_eq!(answered.stdout.lines().count(), rows.len(), "{name}");
        for (row, line) in rows.iter().zip(answered.stdout.lines()) {
            let expected = format!("\"nearest_cloud\":\"{}\"", row[1]);
            let distance = format!("\"distance\":{},", row[2]);
            assert!(line.contains(&expected) && line.contains(&distance), "{name}: {row:?}, {line}");
        }
    }
}

#[test]
fn a_structure_that_cannot_be_taken_is_refused() {
    let plain = Experiment::new(&format!("{SHORT}[descriptor]\ncolour = false\n"));
    plain.run("out", &[]).expect_success();
    let (out, artefact) = (plain.path("out"), plain.path("artefact"));
    let refused = |text: &str, complaint: &str| {
        let file = plain.path("structure.toml");
        fs::write(&file, text).unwrap();
        let refused = run("coordinator", ["export", &out, &artefact, "--structure", &file]).expect_error();
        assert!(refused.stderr.contains(complaint), "{refused}");
        assert!(!Path::new(&artefact).exists());
    };
    let sound = structure_file();
    refused(&sound, "the structure's features need a run with colours, got one without\n");
    let ninth = "[[channel]]\npairs = \"cloud\"\nfeatures = [\"d 5\"]\nradius_cm = 20\n";
    refused(&format!("{sound}{ninth}"), "structure.toml: channel: there must be 1 to 8, got 9\n");
    refused(
        &sound.replace("radius_cm = 12", "radius_cm = -1"),
        "structure.toml: channel 1: radius_cm: must be",
    );
    refused("version = 1\nchannel = 3", "structure.toml: channel: expected a list, got 3\n");
    let both = ["export", &out, &artefact, "--structure", "x.toml", "--descriptor", "paper"];
    let said = run("coordinator", both).expect_error();
    assert!(said.stderr.contains("cannot be used with"), "{said}");
}
