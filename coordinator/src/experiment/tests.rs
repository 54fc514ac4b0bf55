//! Tests of the experiment file as a whole: files that ship, samples that stay readable, the schema.

mod members;
mod messages;
mod objectives;
mod texts;
mod values;
mod weigh;

use std::collections::BTreeSet;
use std::env::VarError;
use std::net::SocketAddr;
use std::path::Path;
use std::time::Duration;

use descriptor::structure::StructureSpace;
use descriptor::{Descriptor, Domain, Family, GeneTable, Preprocess, SearchSpace, SetDistance, Unit};
use evolution::{Crossover, Mutation, Scaling};
use expect_test::expect;
use proto::task::Objective;

use super::*;
use crate::dataset::{Layout, SplitRule};

const DEMO: &str = include_str!("../../../experiments/demo.toml");
const PAPER: &str = include_str!("../../../experiments/paper.toml");
const HOUSEHOLD: &str = include_str!("../../../experiments/household.toml");
const SWEEP: &str = include_str!("../../../experiments/sweep.toml");
const SAMPLE: &str = include_str!("../../testdata/experiment-v1.toml");
const SAMPLE_PATTERN: &str = include_str!("../../testdata/experiment-v1-pattern.toml");
const SAMPLE_SYNTHETIC: &str = include_str!("../../testdata/experiment-v1-synthetic.toml");
const SAMPLE_SWEEP: &str = include_str!("../../testdata/experiment-v1-sweep.toml");
const SAMPLE_FAMILY: &str = include_str!("../../testdata/experiment-v1-family.toml");
const SAMPLE_SEARCH: &str = include_str!("../../testdata/experiment-v1-search.toml");
const SAMPLE_STRUCTURE: &str = include_str!("../../testdata/experiment-v1-structure.toml");

/// The smallest experiment.
const LEAST: &str = "version = 1\ndataset.root = 'clouds'\n";

fn no_variables(_: &str) -> Result<String, VarError> {
    Err(VarError::NotPresent)
}

/// Reads a text as the file `exp/x.toml`, with no variable set.
fn parse(text: &str) -> Result<Experiment, ConfigError> {
    Experiment::parse(text, Path::new("exp/x.toml"), Overrides::default(), &no_variables)
}

#[test]
fn what_is_not_written_is_the_papers() {
    let experiment = parse(LEAST).unwrap();
    assert_eq!((experiment.name(), experiment.seed()), ("x", 1));
    assert_eq!(experiment.space(), &SearchSpace::DiskRing(GeneTable::paper()));
    assert_eq!(experiment.preprocess(), &Preprocess::default());
    assert_eq!(experiment.ga(), &GaSettings::default());
    assert_eq!(experiment.stop(), &StopSettings::default());
    assert_eq!((experiment.winner(), experiment.validates()), (WinnerRule::Validation, true));
    assert_eq!(experiment.dataset().root, Path::new("exp/clouds"));
    assert_eq!(experiment.dataset().layout, Layout::Uw);
    let SplitRule::Lists([train1, ..]) = &experiment.dataset().splits else { panic!("lists") };
    assert_eq!(train1, &[Path::new("exp/clouds/train1.txt")]);
    assert_eq!(experiment.results_dir(), Path::new("results/runs"));
}

#[test]
fn shipped_experiments_are_the_papers_search() {
    for (name, text, stops_by_validation) in
        [("demo", DEMO, false), ("paper", PAPER, true), ("household", HOUSEHOLD, false)]
    {
        let path = Path::new("experiments").join(name).with_extension("toml");
        let experiment = Experiment::parse(text, &path, Overrides::default(), &no_variables).unwrap();
        assert_eq!(experiment.name(), name);
        assert_eq!(experiment.space(), &SearchSpace::DiskRing(GeneTable::paper()));
        assert_eq!(experiment.preprocess(), &Preprocess::default());
        assert_eq!(experiment.ga(), &GaSettings::default());
        assert_eq!(experiment.stop().validation_patience.is_some(), stops_by_validation);
        assert_eq!(experiment.dataset().synthetic.is_some(), name == "demo");
    }
    let paper = parse(PAPER).unwrap();
    assert_eq!(paper.stop(), &StopSettings::default());
    assert_eq!(paper.dataset().root, Path::new("exp/../../rgbd-dataset"));
    let SplitRule::Seeded(splits) = &paper.dataset().splits else { panic!("a draw") };
    let clouds = splits.shares.map(|share| (share * 943.0).round());
    assert_eq!(clouds, [352.0, 352.0, 239.0, 0.0]);
    let household = parse(HOUSEHOLD).unwrap();
    assert_eq!(household.dataset().root, Path::new("exp/../../shared/data/household-rgbd"));
}

#[test]
fn a_split_may_have_several_lists_and_validation_none() {
    let written = format!(
        "{LEAST}search.winner = 'fitness'\nstop.validation_patience = 'off'\n\
         [dataset.splits]\ntrain2 = ['train2.txt', '${{MORE:-more}}.txt']\nvalidation = []\ntest = ['a.txt']\n"
    );
    let experiment = parse(&written).unwrap();
    let list = |name: &str| Path::new("exp/clouds").join(name);
    let lists =
        [vec![list("train1.txt")], vec![list("train2.txt"), list("more.txt")], vec![], vec![list("a.txt")]];
    assert_eq!(experiment.dataset().splits, SplitRule::Lists(lists));
    let resolved = experiment.resolved_toml();
    assert!(resolved.contains("train2 = [\"train2.txt\", \"more.txt\"]\nvalidation = []\n"), "{resolved}");
    assert_eq!(parse(&resolved).unwrap().dataset(), experiment.dataset());
}

#[test]
fn the_first_version_of_the_file_stays_readable() {
    let lookup = |name: &str| match name {
        "CLOUDS" => Ok("/data".to_owned()),
        _ => Err(VarError::NotPresent),
    };
    let sample = Experiment::parse(SAMPLE, Path::new("exp/old.toml"), Overrides::default(), &lookup).unwrap();
    assert_eq!((sample.name(), sample.seed()), ("sample", 7));
    assert_eq!(sample.path(), Path::new("exp/old.toml"));
    let dataset = sample.dataset();
    assert_eq!(dataset.root, Path::new("/data/all"));
    assert_eq!(dataset.layout, Layout::Manifest { file: "/data/all/clouds.csv".into() });
    let list = |name: &str| Path::new("/data/all/lists").join(name);
    assert_eq!(
        dataset.splits,
        SplitRule::Lists(
            ["train1.txt", "train2.txt", "validation.txt", "test.txt"].map(|name| vec![list(name)])
        )
    );
    assert!(dataset.skip_unreadable && dataset.synthetic.is_none());
    assert_eq!(sample.method(), Method::Random);
    let preprocess = Preprocess {
        leaf_um: 15_000,
        normal_radius_um: 8_000,
        min_points: 20,
        colour: true,
        unit: Unit::Millimetre,
    };
    assert_eq!(sample.preprocess(), &preprocess);
    let values: Vec<Vec<f64>> = sample
        .space()
        .genes()
        .into_iter()
        .map(|(spec, domain)| domain.values().map(|ticks| spec.value(ticks)).collect())
        .collect();
    let expected: [&[f64]; 5] = [
        &[10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 55.0, 60.0],
        &[8.0],
        &[0.5, 0.75, 1.0, 1.25, 1.5],
        &[2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0],
        &[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9],
    ];
    assert_eq!(values, expected);
    let ga = GaSettings {
        population: 20,
        elite: 2,
        scaling: Scaling::Rank,
        crossover: Crossover::Uniform,
        crossover_rate: 0.6,
        mutation: Mutation::InOrder,
        mutation_rate: 0.3,
        mutation_decay: 0.95,
        preselection: 1,
    };
    assert_eq!((sample.ga(), sample.encoding()), (&ga, Encoding::Gray));
    let stop = StopSettings {
        generations: 100,
        stagnation: Some(25),
        validation_patience: None,
        perfect: false,
        evaluations: None,
    };
    assert_eq!((sample.stop(), sample.winner()), (&stop, WinnerRule::Fitness));
    let coordinator = CoordinatorSettings {
        listen: Some(SocketAddr::from(([127, 0, 0, 1], 7701))),
        local_workers: LocalWorkers::Count(2),
        lease: Duration::from_secs(20),
        job: Duration::from_secs(900),
        max_failures: 5,
        worker_grace: Duration::from_secs(60),
        deadline: Some(Duration::from_secs(86_400)),
        audit: 0.25,
        pieces: ShardCount::Fixed(8.try_into().unwrap()),
    };
    assert_eq!(sample.coordinator(), &coordinator);
    assert_eq!(sample.results_dir(), Path::new("exp/out"));

    let synthetic = parse(SAMPLE_SYNTHETIC).unwrap();
    assert_eq!(synthetic.stop().stagnation, None);
    assert_eq!(synthetic.coordinator().local_workers, LocalWorkers::Auto);
    let made = synthetic.dataset().synthetic.unwrap();
    assert_eq!((made.objects, made.views, made.seed), (6, 8, 3));
    let SplitRule::Seeded(splits) = &synthetic.dataset().splits else { panic!("a draw") };
    assert_eq!((splits.seed, splits.shares, splits.stratified), (2, [0.4, 0.3, 0.3, 0.0], false));
    assert_eq!(splits.test_sequences, ["2", "4"]);

    let pattern = parse(SAMPLE_PATTERN).unwrap();
    let Layout::Pattern(read) = &pattern.dataset().layout else { panic!("a pattern") };
    assert_eq!(read.to_string(), "{category}_{instance}_{sequence}_{any}.pcd");
    assert_eq!(parse(&pattern.resolved_toml()), Ok(pattern));

    let search = parse(SAMPLE_SEARCH).unwrap();
    let ga = GaSettings {
        crossover: Crossover::Slots,
        mutation: Mutation::Field,
        mutation_rate: 0.1,
        ..GaSettings::default()
    };
    let stop = StopSettings { validation_patience: None, evaluations: Some(500), ..StopSettings::default() };
    assert_eq!((search.ga(), search.stop()), (&ga, &stop));
    assert_eq!((search.winner(), search.validates()), (WinnerRule::Validation, true));
}

/// Every dotted key of a table.
fn keys_of(value: &toml::Table, prefix: &str, keys: &mut BTreeSet<String>) {
    for (key, value) in value {
        let path = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
        match value {
            toml::Value::Table(table)
                if !path.starts_with("descriptor.genes.") && path != "sweep.variants" =>
            {
                keys_of(table, &path, keys);
            }
            _ => {
                keys.insert(path);
            }
        }
    }
}

/// Every dotted key that the schema knows; `sections` collects those that are tables.
fn schema_keys(
    root: &serde_json::Value,
    node: &serde_json::Value,
    prefix: &str,
    keys: &mut BTreeSet<String>,
    sections: &mut BTreeSet<String>,
) {
    if let Some(reference) = node["$ref"].as_str() {
        schema_keys(root, root.pointer(&reference[1..]).unwrap(), prefix, keys, sections);
    }
    for form in node["anyOf"].as_array().into_iter().flatten() {
        schema_keys(root, form, prefix, keys, sections);
    }
    let Some(properties) = node["properties"].as_object() else {
        if !prefix.is_empty() && node.get("$ref").is_none() && node.get("anyOf").is_none() {
            keys.insert(prefix.to_owned());
        }
        return;
    };
    assert_eq!(node["additionalProperties"], false, "{prefix}");
    sections.insert(prefix.to_owned());
    for (key, property) in properties {
        let path = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
        if path.starts_with("descriptor.genes.") {
            keys.insert(path);
        } else {
            schema_keys(root, property, &path, keys, sections);
        }
    }
}

#[test]
fn the_samples_use_every_key_of_the_schema_and_no_other() {
    let mut sampled = BTreeSet::new();
    let of_search = [SAMPLE_SEARCH, SAMPLE_STRUCTURE, members::SAMPLE, objectives::SAMPLE, weigh::SAMPLE];
    for sample in
        [SAMPLE, SAMPLE_PATTERN, SAMPLE_SYNTHETIC, SAMPLE_SWEEP, SAMPLE_FAMILY].into_iter().chain(of_search)
    {
        keys_of(&sample.parse().unwrap(), "", &mut sampled);
    }
    let schema = json_schema();
    let (mut known, mut sections) = (BTreeSet::new(), BTreeSet::new());
    schema_keys(&schema, &schema, "", &mut known, &mut sections);
    assert!(sections.remove(""));
    // Its keys are the names that a manifest has.
    assert!(known.remove("search.sets") && sections.insert("search.sets".to_owned()));
    known.insert("search.sets.kitchen".to_owned());
    assert_eq!(sections, syntax::SECTIONS.map(str::to_owned).into());
    // It may also be one word, "manifest".
    assert!(known.remove("dataset.splits"));
    assert_eq!(sampled, known);
    // The genes of structures cannot be fixed.
    let fixable = Family::ALL.into_iter().filter(|&family| family != Family::Structure);
    for spec in fixable.flat_map(Family::genes) {
        assert!(known.contains(&format!("descriptor.genes.{}", spec.name)));
    }
}

#[test]
fn the_schema_describes_keys_and_gives_defaults() {
    let schema = json_schema();
    assert_eq!(schema["required"], serde_json::json!(["version", "dataset"]));
    let ga = &schema["$defs"]["ga"]["properties"];
    expect![[r#"
        {
          "type": "integer",
          "format": "uint32",
          "minimum": 2,
          "description": "Individuals a generation, of each member where a structure has several.",
          "maximum": 65536,
          "default": 10
        }"#]]
    .assert_eq(&serde_json::to_string_pretty(&ga["population"]).unwrap());
    expect![[r##"
        {
          "$ref": "#/$defs/Scaling",
          "description": "How fitness becomes selection weight: \"none\" is the fitness itself, \"linear\" lets the best expect twice the\nmean, \"rank\" goes by rank alone.",
          "default": "none"
        }"##]].assert_eq(&serde_json::to_string_pretty(&ga["scaling"]).unwrap());
    expect![[r##"
        {
          "$ref": "#/$defs/number_or_off",
          "description": "When the validation error has risen this many generations in a row, or \"off\".",
          "default": 1
        }"##]]
    .assert_eq(
        &serde_json::to_string_pretty(&schema["$defs"]["stop"]["properties"]["validation_patience"]).unwrap(),
    );
    expect![[r##"
        {
          "anyOf": [
            {
              "type": "number",
              "format": "double"
            },
            {
              "$ref": "#/$defs/interval"
            }
          ],
          "description": "A fixed value, or an interval."
        }"##]]
    .assert_eq(&serde_json::to_string_pretty(&schema["$defs"]["gene"]).unwrap());
    expect![[r#"
        {
          "type": "string",
          "description": "Folder that holds the clouds; a relative path is relative to the folder of the experiment file.",
          "examples": [
            "${UW_RGBD:-../../rgbd-dataset}"
          ]
        }"#]]
    .assert_eq(&serde_json::to_string_pretty(&schema["$defs"]["dataset"]["properties"]["root"]).unwrap());
    // TOML has no null: an editor must not offer one.
    assert!(!schema.to_string().contains("null"));
}

#[test]
fn the_command_line_goes_before_the_file() {
    let overrides = Overrides {
        seed: Some(9),
        listen: Some(SocketAddr::from(([0, 0, 0, 0], 1))),
        local_workers: Some("4".parse().unwrap()),
    };
    let experiment = Experiment::parse(SAMPLE, Path::new("x.toml"), overrides, &no_variables).unwrap();
    assert_eq!(experiment.seed(), 9);
    assert_eq!(experiment.coordinator().listen, overrides.listen);
    assert_eq!(experiment.coordinator().local_workers, LocalWorkers::Count(4));
    assert_eq!("auto".parse(), Ok(LocalWorkers::Auto));
    for wrong in ["", "Auto", "-1", "1025", "2.5"] {
        assert!(wrong.parse::<LocalWorkers>().unwrap_err().contains(&format!("got {wrong:?}\n")));
    }
}

#[test]
fn the_seed_and_the_name_make_another_folder_and_the_place_does_not() {
    let folder = |text: &str, path: &str| {
        Experiment::parse(text, Path::new(path), Overrides::default(), &no_variables)
            .unwrap()
            .run_folder_name()
    };
    let least = folder(LEAST, "a/x.toml");
    assert!(least.starts_with("x-") && least.len() == 2 + 12);
    assert!(least[2..].bytes().all(|c| c.is_ascii_digit() || (b'a'..=b'f').contains(&c)));
    assert_eq!(least, folder(LEAST, "b/x.toml"));
    assert_eq!(least[2..], folder(LEAST, "y.toml")[2..]);
    assert_ne!(least[2..], folder(&format!("{LEAST}seed = 2"), "x.toml")[2..]);
}

#[test]
fn a_sweep_is_each_variant_with_each_seed_and_reads_back_as_the_same() {
    let path = Path::new("exp/x.toml");
    let read = |text: &str| Plan::parse(text, path, Overrides::default(), &no_variables).unwrap();
    let Plan::Sweep(sweep) = read(SAMPLE_SWEEP) else { panic!("one run") };
    let members = sweep.members();
    let shown: Vec<_> = members
        .iter()
        .map(|Member { name, experiment }| {
            let (ga, stop) = (experiment.ga(), experiment.stop());
            (name.as_str(), experiment.seed(), ga.population, ga.elite, stop.generations)
        })
        .collect();
    let (whole, small) = ((10, 2, 200), (6, 2, 9));
    let member = |name, seed, (population, elite, generations)| (name, seed, population, elite, generations);
    assert_eq!(
        shown,
        [
            member("blind-seed-3", 3, whole),
            member("blind-seed-4", 4, whole),
            member("blind-seed-5", 5, whole),
            member("small-seed-3", 3, small),
            member("small-seed-4", 4, small),
            member("small-seed-5", 5, small),
        ]
    );
    assert_eq!(
        [members[0].experiment.method(), members[3].experiment.method()],
        [Method::Random, Method::Ga]
    );
    // Neither how it is written nor the seed that no run has makes another sweep.
    let other =
        SAMPLE_SWEEP.replace("\"3..5\"", "[3, 4, 5]").replace("version = 1\n", "version = 1\nseed = 9\n");
    let Plan::Sweep(other) = read(&other) else { panic!("one run") };
    assert_eq!((other.search_toml(), other.folder_name()), (sweep.search_toml(), sweep.folder_name()));
    let Plan::Sweep(again) = read(&Plan::Sweep(sweep.clone()).resolved_toml()) else { panic!("one run") };
    assert_eq!(again.members(), members);
    assert_ne!(read(&SAMPLE_SWEEP.replace("3..5", "3..6")), Plan::Sweep(sweep));
}

/// What is written of a variant is read over what its base has written.
#[test]
fn variants_may_differ_in_every_key_of_the_search_and_read_back_as_the_same() {
    let path = Path::new("exp/x.toml");
    let read = |text: &str| Plan::parse(text, path, Overrides::default(), &no_variables).unwrap();
    let variants = "[sweep.variants.blind]\nstop = { evaluations = 'off', validation_patience = 'off' }\n\
        [sweep.variants.fit]\nsearch.winner = 'fitness'\n\
        [sweep.variants.patient.stop]\nvalidation_patience = 3\n\
        [sweep.variants.plain]\nsearch.winner = 'validation'\n\
        ga = { crossover = 'uniform', mutation = 'in-order' }\nstop.evaluations = 'off'\n\
        [sweep.variants.short]\nstop = { evaluations = 7 }\n";
    for base in [
        "",
        "search.winner = 'fitness'\n",
        "search.winner = 'validation'\nga = { crossover = 'slots', mutation = 'field' }\nstop.evaluations = 90\n",
        "stop = { validation_patience = 'off', evaluations = 90 }\n",
    ] {
        let plan = read(&format!("{LEAST}{base}{variants}"));
        let Plan::Sweep(sweep) = &plan else { panic!("one run") };
        let Plan::Sweep(again) = read(&plan.resolved_toml()) else { panic!("one run") };
        assert_eq!((again.members(), again.base()), (sweep.members(), sweep.base()), "{base}");
        assert_eq!(again.search_toml(), sweep.search_toml());
        let members = sweep.members();
        let [blind, fit, _, plain, short] =
            &members.iter().map(|one| &one.experiment).collect::<Vec<_>>()[..]
        else {
            panic!("five variants")
        };
        assert_eq!((blind.stop().evaluations, short.stop().evaluations), (None, Some(7)));
        assert_eq!((fit.winner(), plain.winner()), (WinnerRule::Fitness, WinnerRule::Validation));
        assert_eq!((plain.ga(), plain.stop().evaluations), (&GaSettings::default(), None));
    }
}

#[test]
fn structures_have_keys_of_their_own_and_defaults_for_the_search() {
    let sample = parse(SAMPLE_STRUCTURE).unwrap();
    let space =
        StructureSpace { colour: true, slots: 3, members: 1, max_bins: 400, metric: SetDistance::Hellinger };
    assert_eq!((sample.space(), sample.max_cost()), (&SearchSpace::Structures(space), Some(900_000)));
    let fitness = Fitness::new([1, 2, 3], Objective::Category, false);
    assert_eq!(Some(*sample.fitness()), fitness);
    assert_eq!(parse(&sample.resolved_toml()), Ok(sample.clone()));
    expect![[r#"

        normal_radius_cm = 1.0
        min_points = 10

        [descriptor]
        family = "structure"
        colour = true
        slots = 3
        max_bins = 400
        metric = "hellinger"
        max_cost = 900000

        [search]
        method = "ga"
        winner = "validation"

        [search.fitness]
        split = 1
        cross-sequence = 2
        leave-one-out = 3
        objective = "category"
        margin = false

        [ga]
        population = 60
        elite = 4
        selection = "roulette"
        scaling = "rank"
        crossover = "slots"
        crossover_rate = 0.5
        mutation = "field"
        mutation_rate = 0.03
        mutation_decay = 1.0
        preselection = 8
        encoding = "binary"

        [stop]
        generations = 200
        stagnation = "off"
        validation_patience = "off"
        perfect = true
        evaluations = 3000
    "#]]
    .assert_eq(sample.search_toml().split_once("[preprocess]").unwrap().1);

    // A key that came later enters only where it says something.
    let all = SAMPLE_STRUCTURE.replace("[ga]\npreselection = 8\n", "");
    let [one, none] = [all.replace("[recognition]", "[ga]\npreselection = 1\n[recognition]"), all]
        .map(|text| parse(&text).unwrap());
    assert_eq!((sample.ga().preselection, none.ga().preselection), (8, 1));
    assert_eq!(none.search_toml(), sample.search_toml().replace("preselection = 8\n", ""));
    assert_eq!(one.search_toml(), none.search_toml());
    let read =
        |text: &str| Plan::parse(text, Path::new("exp/x.toml"), Overrides::default(), &no_variables).unwrap();
    let sweep =
        format!("{SAMPLE_STRUCTURE}[sweep.variants.all]\nga.preselection = 1\n[sweep.variants.chosen]\n");
    let (Plan::Sweep(sweep), Plan::Sweep(again)) = (read(&sweep), read(&read(&sweep).resolved_toml())) else {
        panic!("one run")
    };
    assert_eq!(again.members(), sweep.members());
    let preselections: Vec<u32> =
        again.members().iter().map(|member| member.experiment.ga().preselection).collect();
    assert_eq!(preselections, [1, 8]);

    let least = parse(&format!("{LEAST}descriptor.family = 'structure'\n")).unwrap();
    assert_eq!(least.space(), &SearchSpace::Structures(StructureSpace::default()));
    assert_eq!((*least.fitness(), least.stop().evaluations), (Fitness::CROSS_SEQUENCE, Some(3000)));
    assert_eq!((least.winner(), least.validates()), (WinnerRule::Validation, true));
    // The fitness that is not the default enters the text of other families, too.
    let paper = parse(&format!("{LEAST}search.fitness.split = 1\n")).unwrap();
    assert_eq!(paper.search_toml(), parse(LEAST).unwrap().search_toml());
    let across = parse(&format!("{LEAST}search.fitness.cross-sequence = 1\n")).unwrap();
    assert_ne!(across.search_toml(), paper.search_toml());
    assert_eq!(parse(&across.resolved_toml()), Ok(across));
}

#[test]
fn one_structure_can_be_written_out() {
    let channel = "[[descriptor.channel]]\npairs = 'neighbours'\nfeatures = ['o1 8', 'o2 8']\nsquash = 0.5\n\
        radius_cm = 3\nsamples = 256\nweight = 0.25\nshells_cm = [1.5, 6.0]\n";
    let text = format!("{LEAST}[descriptor]\nfamily = 'structure'\n{channel}");
    let one = parse(&text).unwrap();
    let Some(Descriptor::Structure(structure)) = one.space().only() else { panic!("one structure") };
    assert_eq!(structure.channels[0].weight_ppm, 250_000);
    let again = parse(&one.resolved_toml()).unwrap();
    assert_eq!((&again, again.search_toml()), (&one, one.search_toml()));
    assert!(one.search_toml().contains("[[descriptor.channel]]\npairs = \"neighbours\"\n"));
    let colourless = text.replace("family = ", "colour = false\nfamily = ");
    let refused = parse(&colourless).unwrap_err().to_string();
    assert!(refused.contains("descriptor.colour: needed by channel 1, got false\n"), "{refused}");
    let both = text.replace("family = ", "slots = 2\nfamily = ");
    let refused = parse(&both).unwrap_err().to_string();
    assert!(refused.contains("descriptor.slots: no use beside channels"), "{refused}");
}

#[test]
fn another_family_has_its_own_genes_and_a_search_text_of_its_own() {
    let sample = parse(SAMPLE_FAMILY).unwrap();
    let bins = Domain { low: 8, step: 8, count: 4 };
    assert_eq!(sample.space(), &SearchSpace::new(Family::GlobalHue, true, &[bins]).unwrap());
    assert_eq!(parse(&sample.resolved_toml()), Ok(sample.clone()));
    let text = sample.search_toml();
    assert!(
        text.contains("[descriptor]\nfamily = \"global-hue\"\ncolour = true\n\n[descriptor.genes]\nbins = {"),
        "{text}"
    );
    // The default, written or not, is what it was before there was a choice.
    let written = parse(&format!("{LEAST}descriptor.family = 'disk-ring'\n")).unwrap();
    assert_eq!(written, parse(LEAST).unwrap());
    assert!(!written.search_toml().contains("family"));
}
