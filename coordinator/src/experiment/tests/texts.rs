//! The two texts an experiment is written out to: equal for equal meaning, different for any other.

use expect_test::expect;
use proptest::prelude::*;

use super::*;

/// Keys that determine the search: section, key, and values, each in several spellings ("" is: not written).
const RELEVANT: &[(&str, &str, &[&[&str]])] = &[
    (
        "",
        "seed",
        &[&["", "1", "0x1", "+1"], &["2", "0b10"], &["9223372036854775807", "9_223_372_036_854_775_807"]],
    ),
    ("dataset", "layout", &[&["", "\"uw\"", "'uw'", "\"\\u0075w\""], &["\"folders\""]]),
    ("dataset", "unit", &[&["", "\"m\""], &["\"mm\""]]),
    ("dataset", "skip_unreadable", &[&["", "false"], &["true"]]),
    (
        "dataset",
        "splits",
        &[
            &["", "{}", "{ train1 = 'other.txt' }", "{ test = '/lists/test.txt', train2 = 'b' }"],
            &[
                "{ seeded = {} }",
                "{ seeded = { test = 0.33, seed = 1, train1 = 0.250 } }",
                "{ seeded.train1 = 25e-2 }",
            ],
            &["{ seeded = { seed = 2 } }"],
            &["{ seeded = { train1 = 0.2 } }", "{ seeded = { train1 = 0.2, test = 0.38 } }"],
            &["{ seeded = { train1 = 0.2, test = 0.33 } }"],
            &["{ seeded = { train2 = 0.2 } }"],
            &["{ seeded = { validation = 0.18 } }"],
            &["{ seeded = { stratified = false } }"],
        ],
    ),
    ("preprocess", "leaf_cm", &[&["", "2.0", "2", "20e-1"], &["2.0001"]]),
    ("preprocess", "normal_radius_cm", &[&["", "1.0", "1"], &["0.9", "0.90"]]),
    ("preprocess", "min_points", &[&["", "10"], &["11"]]),
    (
        "descriptor.genes",
        "shape_bins",
        &[
            &["", "{}", "{ min = 8, max = 64, step = 1 }", "{ max = 64.0 }"],
            &["8", "8.0", "{ max = 8 }", "{ min = 8, max = 8, step = 5 }"],
            &["{ step = 2 }", "{ min = 8, step = 2, max = 64 }"],
            &["{ min = 9 }"],
            &["{ max = 63 }"],
        ],
    ),
    ("descriptor.genes", "m", &[&["", "{ min = 3 }"], &["3"], &["8"]]),
    ("descriptor.genes", "R1", &[&["", "{ step = 0.10 }"], &["1.3", "13e-1"], &["{ max = 1.9 }"]]),
    ("descriptor.genes", "R2", &[&["", "{ min = 2.1, max = 5 }"], &["3.6"], &["{ step = 0.05 }"]]),
    (
        "descriptor.genes",
        "w",
        &[&["", "{ min = -0.0, max = 1 }"], &["0", "0.0", "-0.0"], &["0.67"], &["0.670001"]],
    ),
    ("ga", "population", &[&["", "10"], &["12"]]),
    ("ga", "elite", &[&["", "1"], &["0"]]),
    ("ga", "scaling", &[&["", "'none'"], &["'linear'"], &["'rank'"]]),
    ("ga", "crossover", &[&["", "'uniform'"], &["'slots'"]]),
    ("ga", "crossover_rate", &[&["", "0.5", "5e-1"], &["0.50000000000000011"]]),
    ("ga", "mutation", &[&["", "'in-order'"], &["'field'"], &["'slot'"]]),
    ("ga", "mutation_rate", &[&["", "0.40", "0.4"], &["0", "0.0", "-0.0"], &["1", "1.0"]]),
    ("ga", "mutation_decay", &[&["", "0.97"], &["1"]]),
    ("ga", "encoding", &[&["", "'binary'"], &["'gray'"]]),
    ("stop", "generations", &[&["", "200"], &["20"]]),
    ("stop", "stagnation", &[&["", "40"], &["'off'"], &["41"]]),
    ("stop", "validation_patience", &[&["", "1"], &["\"off\"", "'off'"], &["2"]]),
    ("stop", "perfect", &[&["", "true"], &["false"]]),
    ("stop", "evaluations", &[&["", "'off'"], &["1"], &["3000", "3_000"]]),
];

/// Keys that do not, with values of different meaning.
const IRRELEVANT: &[(&str, &str, &[&str])] = &[
    ("", "name", &["", "'other'"]),
    ("dataset", "root", &["'clouds'", "'/elsewhere'", "'${ROOT:-here}'"]),
    ("ga", "selection", &["", "'roulette'"]),
    ("ga", "preselection", &["", "1"]), // of this family
    ("coordinator", "listen", &["", "'127.0.0.1:7700'", "'[::1]:0'"]),
    ("coordinator", "local_workers", &["", "0", "3", "'auto'"]),
    ("coordinator", "lease_seconds", &["", "10"]),
    ("coordinator", "job_seconds", &["", "60"]),
    ("coordinator", "max_failures", &["", "1"]),
    ("coordinator", "worker_grace_seconds", &["", "0"]),
    ("coordinator", "deadline_seconds", &["", "'off'", "60"]),
    ("coordinator", "audit", &["", "0", "0.5", "1"]),
    ("coordinator", "pieces", &["", "'auto'", "1", "4096"]),
    ("recognition", "method", &["", "'nearest'", "'projection'", "'kernel-ridge'"]),
    ("results", "dir", &["", "'out'", "'/out'"]),
    ("results", "baselines", &["", "true", "false"]),
];

/// How a file is written: what has no part in its meaning.
#[derive(Clone, Debug)]
struct Style {
    spellings: Vec<usize>,
    irrelevant: Vec<usize>,
    /// Order of keys and of sections.
    order: Vec<u8>,
    /// Whether a section has a header, or dotted keys.
    headers: bool,
    comments: bool,
}

fn styles() -> impl Strategy<Value = Style> {
    let many = |length| prop::collection::vec(0usize..60, length);
    let order = prop::collection::vec(any::<u8>(), RELEVANT.len() + IRRELEVANT.len());
    (many(RELEVANT.len()), many(IRRELEVANT.len()), order, any::<bool>(), any::<bool>()).prop_map(
        |(spellings, irrelevant, order, headers, comments)| Style {
            spellings,
            irrelevant,
            order,
            headers,
            comments,
        },
    )
}

/// Which value each relevant key has.
fn meanings() -> impl Strategy<Value = Vec<usize>> {
    prop::collection::vec(0usize..840, RELEVANT.len()).prop_map(|picks| {
        picks.iter().zip(RELEVANT).map(|(pick, (.., values))| pick % values.len()).collect()
    })
}

fn write(meaning: &[usize], style: &Style) -> String {
    let relevant =
        RELEVANT.iter().zip(meaning).zip(&style.spellings).map(|(((section, key, values), value), pick)| {
            let spellings = values[*value];
            (*section, *key, spellings[pick % spellings.len()])
        });
    let irrelevant = IRRELEVANT
        .iter()
        .zip(&style.irrelevant)
        .map(|((section, key, values), pick)| (*section, *key, values[pick % values.len()]));
    let mut keys: Vec<_> =
        relevant.chain(irrelevant).zip(&style.order).filter(|((.., value), _)| !value.is_empty()).collect();
    keys.sort_by_key(|(_, order)| **order);
    let mut sections: Vec<&str> = Vec::new();
    for ((section, ..), _) in &keys {
        if !sections.contains(section) && (style.headers || section.is_empty()) {
            sections.push(section);
        }
    }
    // Top-level keys come before any header.
    sections.sort_by_key(|section| !section.is_empty());
    let comment = if style.comments { " # why" } else { "" };
    let mut text = format!("version = 1{comment}\n");
    if style.headers {
        for section in sections {
            if !section.is_empty() {
                text += &format!("{comment}\n[{section}]\n");
            }
            for ((_, key, value), _) in keys.iter().filter(|((of, ..), _)| *of == section) {
                text += &format!("{key} = {value}{comment}\n");
            }
        }
    } else {
        for ((section, key, value), _) in &keys {
            let dot = if section.is_empty() { "" } else { "." };
            text += &format!("{section}{dot}{key} = {value}{comment}\n");
        }
    }
    text
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn the_search_text_depends_on_meaning_alone(meaning in meanings(), one in styles(), other in styles()) {
        let [one, other] = [one, other].map(|style| parse(&write(&meaning, &style)).unwrap());
        prop_assert_eq!(one.search_toml(), other.search_toml());
    }

    #[test]
    fn every_change_of_meaning_changes_the_search_text(
        meaning in meanings(),
        style in styles(),
        key in 0..RELEVANT.len(),
        pick in 1usize..20,
    ) {
        let values = RELEVANT[key].2.len();
        let mut changed = meaning.clone();
        changed[key] = (changed[key] + 1 + pick % (values - 1)) % values;
        let [one, other] = [meaning, changed].map(|meaning| parse(&write(&meaning, &style)).unwrap());
        prop_assert_ne!(one.search_toml(), other.search_toml());
    }

    #[test]
    fn the_resolved_text_reads_back_as_the_same_experiment(meaning in meanings(), style in styles()) {
        let experiment = parse(&write(&meaning, &style)).unwrap();
        let resolved = experiment.resolved_toml();
        prop_assert_eq!(&parse(&resolved).unwrap(), &experiment);
        prop_assert_eq!(parse(&resolved).unwrap().resolved_toml(), resolved);
    }

    #[test]
    fn any_text_gives_an_experiment_or_a_message_of_two_lines(text in "\\PC{0,200}") {
        if let Err(error) = parse(&format!("{LEAST}{text}")) {
            prop_assert_eq!(error.to_string().lines().count(), 2, "{}", error);
        }
    }
}

#[test]
fn other_labels_and_synthetic_clouds_change_the_search_text() {
    let texts = [
        "",
        "layout = 'manifest'\nmanifest = 'a.csv'",
        "layout = 'manifest'\nmanifest = 'a.csv'\nsplits = {}",
        "synthetic = {}",
        "synthetic = { objects = 6 }",
        "synthetic = { views = 6 }",
        "synthetic = { seed = 6 }",
        "splits.seeded = { test_sequences = ['2'] }",
        "splits.seeded = { test_sequences = ['2', '4'] }",
        "splits.seeded = { test_sequences = ['2, 4'] }",
    ]
    .map(|keys| parse(&format!("version = 1\n[dataset]\nroot = 'clouds'\n{keys}")).unwrap().search_toml());
    let different: BTreeSet<&String> = texts.iter().collect();
    assert_eq!(different.len(), texts.len());
    let equal = |one: &str, other: &str| {
        let [one, other] = [one, other].map(|keys| {
            parse(&format!("version = 1\n[dataset]\nroot = 'clouds'\n{keys}")).unwrap().search_toml()
        });
        assert_eq!(one, other);
    };
    equal(
        "layout = 'manifest'\nmanifest = 'a.csv'",
        "layout = 'manifest'\nmanifest = 'b'\nsplits = 'manifest'",
    );
    equal("splits.seeded.test_sequences = ['4', '2', '4']", "splits.seeded.test_sequences = ['2', '4']");
    equal("synthetic = {}", "synthetic = { objects = 18, views = 24, seed = 1 }");
}

#[test]
fn the_winner_changes_the_search_text_where_it_is_not_what_the_stop_rule_implies() {
    let text = |patience: &str, winner: &str| {
        let lines = format!("{LEAST}stop.validation_patience = {patience}\n{winner}");
        let experiment = parse(&lines).unwrap();
        assert_eq!(parse(&experiment.resolved_toml()), Ok(experiment.clone()));
        experiment.search_toml()
    };
    let [validation, fitness] = ["search.winner = 'validation'", "search.winner = 'fitness'"];
    for (patience, implied, other, line) in [
        ("1", validation, fitness, "\n[search]\nmethod = \"ga\"\nwinner = \"fitness\"\n\n"),
        ("'off'", fitness, validation, "\n[search]\nmethod = \"ga\"\nwinner = \"validation\"\n\n"),
    ] {
        let plain = text(patience, "");
        assert_eq!(text(patience, implied), plain);
        assert!(!plain.contains("winner"), "{plain}");
        let with = text(patience, other);
        assert_eq!(with.replace(line, "\n[search]\nmethod = \"ga\"\n\n"), plain);
        assert_ne!(with, plain);
    }
}

#[test]
fn line_ends_and_byte_order_marks_mean_nothing() {
    let windows = format!("\u{feff}{}", SAMPLE_SYNTHETIC.replace('\n', "\r\n"));
    assert_eq!(parse(&windows), parse(SAMPLE_SYNTHETIC));
}

#[test]
fn without_colour_the_dropped_genes_mean_nothing() {
    let text = |genes: &str| format!("{LEAST}[descriptor]\ncolour = false\n[descriptor.genes]\n{genes}");
    let [one, other] = ["", "m = 4\nw = 0.5"].map(|genes| parse(&text(genes)).unwrap());
    assert_eq!(one, other);
    assert_eq!(parse(&one.resolved_toml()).unwrap(), one);
    assert_ne!(one.search_toml(), parse(LEAST).unwrap().search_toml());
}

#[test]
fn odd_paths_survive_being_written_out() {
    for root in
        [r"'.'", r#""a\"b\\c""#, r"'exp'", r"'/exp/x'", r"'../x'", r"'${NONE:-}~x'", r"'./~/x'", r"'ü#'"]
    {
        for file in ["exp/x.toml", "x.toml", "/data/x.toml"] {
            let read =
                |text: &str| Experiment::parse(text, Path::new(file), Overrides::default(), &no_variables);
            let experiment = read(&format!("version = 1\ndataset.root = {root}")).unwrap();
            assert_eq!(read(&experiment.resolved_toml()), Ok(experiment), "{root} {file}");
        }
    }
}

#[test]
fn the_resolved_text_has_every_default() {
    expect![[r#"
        version = 1
        name = "x"
        seed = 1

        [dataset]
        root = "clouds"
        layout = "uw"
        unit = "m"
        skip_unreadable = false

        [dataset.splits]
        train1 = "train1.txt"
        train2 = "train2.txt"
        validation = "validation.txt"
        test = "test.txt"

        [preprocess]
        leaf_cm = 2.0
        normal_radius_cm = 1.0
        min_points = 10

        [descriptor]
        colour = true

        [descriptor.genes]
        shape_bins = { min = 8, max = 64, step = 1 }
        m = { min = 3, max = 8, step = 1 }
        R1 = { min = 0.5, max = 2.0, step = 0.1 }
        R2 = { min = 2.1, max = 5.0, step = 0.1 }
        w = { min = 0.0, max = 1.0, step = 0.01 }

        [search]
        method = "ga"

        [ga]
        population = 10
        elite = 1
        selection = "roulette"
        scaling = "none"
        crossover = "uniform"
        crossover_rate = 0.5
        mutation = "in-order"
        mutation_rate = 0.4
        mutation_decay = 0.97
        encoding = "binary"

        [stop]
        generations = 200
        stagnation = 40
        validation_patience = 1
        perfect = true

        [coordinator]
        # listen is not set: 127.0.0.1:7700 if it is free
        local_workers = "auto"
        lease_seconds = 30
        job_seconds = 3600
        max_failures = 3
        worker_grace_seconds = 300
        deadline_seconds = "off"
        audit = 0.01
        pieces = "auto"

        [recognition]
        method = "nearest"

        [results]
        # dir is not set: results/runs in the current folder
        baselines = true
    "#]]
    .assert_eq(&parse(LEAST).unwrap().resolved_toml());
    let synthetic = parse(SAMPLE_SYNTHETIC).unwrap();
    assert_eq!(parse(&synthetic.resolved_toml()), Ok(synthetic));
    let sample = parse(SAMPLE).unwrap();
    expect![[r#"
        version = 1
        name = "sample"
        seed = 7

        [dataset]
        root = "clouds/all"
        manifest = "clouds.csv"
        layout = "manifest"
        unit = "mm"
        skip_unreadable = true

        [dataset.splits]
        train1 = "lists/train1.txt"
        train2 = "lists/train2.txt"
        validation = "lists/validation.txt"
        test = "lists/test.txt"

        [preprocess]
        leaf_cm = 1.5
        normal_radius_cm = 0.8
        min_points = 20

        [descriptor]
        colour = true

        [descriptor.genes]
        shape_bins = { min = 10, max = 60, step = 5 }
        m = 8
        R1 = { min = 0.5, max = 1.5, step = 0.25 }
        R2 = { min = 2.0, max = 5.0, step = 0.5 }
        w = { min = 0.1, max = 0.9, step = 0.1 }

        [search]
        method = "random"

        [ga]
        population = 20
        elite = 2
        selection = "roulette"
        scaling = "rank"
        crossover = "uniform"
        crossover_rate = 0.6
        mutation = "in-order"
        mutation_rate = 0.3
        mutation_decay = 0.95
        encoding = "gray"

        [stop]
        generations = 100
        stagnation = 25
        validation_patience = "off"
        perfect = false

        [coordinator]
        listen = "127.0.0.1:7701"
        local_workers = 2
        lease_seconds = 20
        job_seconds = 900
        max_failures = 5
        worker_grace_seconds = 60
        deadline_seconds = 86400
        audit = 0.25
        pieces = 8

        [recognition]
        method = "nearest"

        [results]
        dir = "out"
        baselines = true
    "#]]
    .assert_eq(&sample.resolved_toml());
    assert_eq!(parse(&sample.resolved_toml()), Ok(sample));
}

#[test]
fn the_search_text_is_pinned() {
    // Run digests and folder names are made from these bytes.
    expect![[r#"
        version = 1
        seed = 1

        [dataset]
        layout = "uw"
        unit = "m"
        skip_unreadable = false

        [dataset.splits.seeded]
        seed = 2
        train1 = 0.4
        train2 = 0.3
        validation = 0.3
        test = 0.0
        stratified = false
        test_sequences = ["2", "4"]

        [dataset.synthetic]
        objects = 6
        views = 8
        seed = 3

        [preprocess]
        leaf_cm = 2.0
        normal_radius_cm = 1.0
        min_points = 10

        [descriptor]
        colour = true

        [descriptor.genes]
        shape_bins = { min = 8, max = 64, step = 1 }
        m = { min = 3, max = 8, step = 1 }
        R1 = { min = 0.5, max = 2.0, step = 0.1 }
        R2 = { min = 2.1, max = 5.0, step = 0.1 }
        w = { min = 0.0, max = 1.0, step = 0.01 }

        [search]
        method = "ga"

        [ga]
        population = 10
        elite = 1
        selection = "roulette"
        scaling = "none"
        crossover = "uniform"
        crossover_rate = 0.5
        mutation = "in-order"
        mutation_rate = 0.4
        mutation_decay = 0.97
        encoding = "binary"

        [stop]
        generations = 200
        stagnation = "off"
        validation_patience = 1
        perfect = true
    "#]]
    .assert_eq(&parse(SAMPLE_SYNTHETIC).unwrap().search_toml());
    let text = parse(SAMPLE_SEARCH).unwrap().search_toml();
    let searches = text.split_once("[search]").map(|(_, searches)| searches);
    expect![[r#"

        method = "ga"
        winner = "validation"

        [search.sets]
        kitchen = 0

        [ga]
        population = 10
        elite = 1
        selection = "roulette"
        scaling = "none"
        crossover = "slots"
        crossover_rate = 0.5
        mutation = "field"
        mutation_rate = 0.1
        mutation_decay = 0.97
        encoding = "binary"

        [stop]
        generations = 200
        stagnation = 40
        validation_patience = "off"
        perfect = true
        evaluations = 500
    "#]]
    .assert_eq(searches.unwrap());
}

/// The digest of the search text is in the names of folders, which documents show.
#[test]
fn the_folders_of_shipped_experiments_are_pinned() {
    let folder = |name: &str, text: &str| {
        let path = Path::new(name);
        match Plan::parse(text, path, Overrides::default(), &no_variables).unwrap() {
            Plan::Run(experiment) => experiment.run_folder_name(),
            Plan::Sweep(sweep) => sweep.folder_name(),
        }
    };
    expect!["demo-9c8cd1e943e6"].assert_eq(&folder("demo.toml", DEMO));
    expect!["household-b50d1935cfb3"].assert_eq(&folder("household.toml", HOUSEHOLD));
    expect!["paper-c8f262f6e092"].assert_eq(&folder("paper.toml", PAPER));
    expect!["sweep-sweep-42d72c3a8cad"].assert_eq(&folder("sweep.toml", SWEEP));
}
