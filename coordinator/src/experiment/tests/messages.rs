//! What a mistake in the file is answered with: no text, no TOML, unknown keys, wrong types.

use expect_test::{Expect, expect};

use super::*;

/// Checks the messages about whole files; each is shown under its file.
pub(super) fn check_file(texts: &[&str], expected: Expect) {
    check_messages(texts, "", expected);
}

/// Checks the messages about lines that are added to a valid file.
pub(super) fn check(lines: &[&str], expected: Expect) {
    check_messages(lines, LEAST, expected);
}

fn check_messages(texts: &[&str], before: &str, expected: Expect) {
    let mut shown = String::new();
    for text in texts {
        let message = parse(&format!("{before}{text}")).unwrap_err().to_string();
        let message = message.strip_prefix("exp/x.toml: ").unwrap();
        assert_eq!(message.lines().count(), 2, "{message}");
        let text: String = text.escape_debug().take(80).collect();
        shown += &format!("{text}\n  {}\n", message.replace('\n', "\n  "));
    }
    expected.assert_eq(&shown);
}

#[test]
fn a_message_names_the_file_the_place_and_the_remedy() {
    let error = parse(&format!("{LEAST}ga.population = 1")).unwrap_err();
    expect![[r#"
        exp/x.toml: ga.population: not between 2 and 65536, got 1
        set it to the individuals a generation, such as 10"#]]
    .assert_eq(&error.to_string());
}

#[test]
fn syntax() {
    check(
        &[
            "[ga]\npopulation = = 3",
            "[ga]\npopulation = 10\npopulation = 12",
            "[ga]\nelite = 1\n[ga]\npopulation = 12",
            "[ga\n",
            "name = \"demo",
            "name = demo",
            "stop.generations = 1 000",
            "name = \"ü\u{7}\"",
            &format!("a = {}", "[".repeat(100_000)),
        ],
        expect![[r#"
            [ga]\npopulation = = 3
              line 4, column 14: extra `=`, expected nothing, got `population = = 3`
              a line is `key = value` or `[section]`; a value is a number, true, false, "text", [ list ] or { table }
            [ga]\npopulation = 10\npopulation = 12
              line 5, column 1: duplicate key, got `population = 12`
              keep one of the two and delete the other
            [ga]\nelite = 1\n[ga]\npopulation = 12
              line 5, column 2: duplicate key, got `[ga]`
              keep one of the two and delete the other
            [ga\n
              line 3, column 4: unclosed table, expected `]`, got `[ga`
              a line is `key = value` or `[section]`; a value is a number, true, false, "text", [ list ] or { table }
            name = \"demo
              line 3, column 13: invalid basic string, expected `"`, got `name = "demo`
              a line is `key = value` or `[section]`; a value is a number, true, false, "text", [ list ] or { table }
            name = demo
              line 3, column 8: string values must be quoted, expected literal string, got `name = demo`
              a line is `key = value` or `[section]`; a value is a number, true, false, "text", [ list ] or { table }
            stop.generations = 1 000
              line 3, column 20: string values must be quoted, expected literal string, got `stop.generations = 1 000`
              a line is `key = value` or `[section]`; a value is a number, true, false, "text", [ list ] or { table }
            name = \"ü\u{7}\"
              line 3, column 10: invalid basic string, expected non-double-quote visible characters, `\`, got `name = "ü�"`
              a line is `key = value` or `[section]`; a value is a number, true, false, "text", [ list ] or { table }
            a = [[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[
              line 3, column 85: cannot recurse further; max recursion depth met, got `a = [[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[…`
              a line is `key = value` or `[section]`; a value is a number, true, false, "text", [ list ] or { table }
        "#]],
    );
}

#[test]
fn version() {
    check_file(
        &[
            "",
            "version = 2\n[dataset]\nnew_key = 1",
            "version = 0",
            "version = \"1\"",
            "version = 1.0",
            "version = 99999999999999999999",
        ],
        expect![[r#"

              version: required key missing, got none
              add a first line `version = 1`
            version = 2\n[dataset]\nnew_key = 1
              version: newer than this program, which reads version 1, got 2
              update the program on this machine
            version = 0
              version: unknown version, got 0
              write `version = 1`
            version = \"1\"
              version: unknown version, got "1"
              write `version = 1`
            version = 1.0
              version: unknown version, got 1.0
              write `version = 1`
            version = 99999999999999999999
              version: unknown version, got 99999999999999999999
              write `version = 1`
        "#]],
    );
}

#[test]
fn keys() {
    check_file(
        &[
            "version = 1",
            "version = 1\n[dataset]",
            "version = 1\n[dataset.synthetic]\nobjects = 6",
            "version = 1\n[dataste]\nroot = 'clouds'",
            "version = 1\n[dataset]\n[dataste]\nroot = 'clouds'",
            "version = 1\n[splits]\ntrain1 = 'a.txt'",
            "version = 1\n[dataset.splits.seedde]\nseed = 1",
            "version = 1\n[colours]\nseed = 1",
        ],
        expect![[r#"
            version = 1
              top level: required key missing, got no `dataset`
              add a section [dataset] with `root = "…"`, the folder of the clouds
            version = 1\n[dataset]
              dataset: required key missing, got no `root`
              add `root = …`
            version = 1\n[dataset.synthetic]\nobjects = 6
              dataset: required key missing, got no `root`
              add `root = …`
            version = 1\n[dataste]\nroot = \'clouds\'
              top level: unknown section, got [dataste]
              did you mean [dataset]? sections are: [dataset], [dataset.splits], [dataset.splits.seeded], [dataset.synthetic], [preprocess], [descriptor], [descriptor.genes], [search], [search.fitness], [search.sets], [ga], [stop], [coordinator], [recognition], [results], [sweep]
            version = 1\n[dataset]\n[dataste]\nroot = \'clouds\'
              top level: unknown section, got [dataste]
              did you mean [dataset]? sections are: [dataset], [dataset.splits], [dataset.splits.seeded], [dataset.synthetic], [preprocess], [descriptor], [descriptor.genes], [search], [search.fitness], [search.sets], [ga], [stop], [coordinator], [recognition], [results], [sweep]
            version = 1\n[splits]\ntrain1 = \'a.txt\'
              top level: unknown section, got [splits]
              did you mean [dataset.splits]? sections are: [dataset], [dataset.splits], [dataset.splits.seeded], [dataset.synthetic], [preprocess], [descriptor], [descriptor.genes], [search], [search.fitness], [search.sets], [ga], [stop], [coordinator], [recognition], [results], [sweep]
            version = 1\n[dataset.splits.seedde]\nseed = 1
              dataset.splits: unknown section, got [dataset.splits.seedde]
              did you mean [dataset.splits.seeded]? sections are: [dataset], [dataset.splits], [dataset.splits.seeded], [dataset.synthetic], [preprocess], [descriptor], [descriptor.genes], [search], [search.fitness], [search.sets], [ga], [stop], [coordinator], [recognition], [results], [sweep]
            version = 1\n[colours]\nseed = 1
              top level: unknown section, got [colours]
              sections are: [dataset], [dataset.splits], [dataset.splits.seeded], [dataset.synthetic], [preprocess], [descriptor], [descriptor.genes], [search], [search.fitness], [search.sets], [ga], [stop], [coordinator], [recognition], [results], [sweep]
        "#]],
    );
    check(
        &[
            "[ga]\npopulaton = 10",
            "ga.crossover_raet = 0.5",
            "sede = 1",
            "[descriptor.genes]\nr1 = 1.0",
            "[descriptor.genes]\nR1 = { mni = 1.0 }",
            "temperature = 1",
            "ga.\"odd `key`, expected `x`\" = 1",
            "dataset.splits.tset = 'a'",
            "dataset.splits.seeded.train = 0.5",
        ],
        expect![[r#"
            [ga]\npopulaton = 10
              ga: unknown key, got `populaton`
              did you mean `population`? known keys here: population, elite, selection, scaling, crossover, crossover_rate, mutation, mutation_rate, mutation_decay, preselection, encoding
            ga.crossover_raet = 0.5
              ga: unknown key, got `crossover_raet`
              did you mean `crossover_rate`? known keys here: population, elite, selection, scaling, crossover, crossover_rate, mutation, mutation_rate, mutation_decay, preselection, encoding
            sede = 1
              top level: unknown key, got `sede`
              did you mean `seed`? known keys here: version, name, seed, dataset, preprocess, descriptor, search, ga, stop, coordinator, recognition, results, sweep
            [descriptor.genes]\nr1 = 1.0
              descriptor.genes: unknown key, got `r1`
              did you mean `R1`? known keys here: shape_bins, m, R1, R2, w, bins
            [descriptor.genes]\nR1 = { mni = 1.0 }
              descriptor.genes.R1: unknown key, got `mni`
              did you mean `min`? known keys here: min, max, step
            temperature = 1
              top level: unknown key, got `temperature`
              known keys here: version, name, seed, dataset, preprocess, descriptor, search, ga, stop, coordinator, recognition, results, sweep
            ga.\"odd `key`, expected `x`\" = 1
              ga: unknown key, got `odd `key`, expected `x``
              known keys here: population, elite, selection, scaling, crossover, crossover_rate, mutation, mutation_rate, mutation_decay, preselection, encoding
            dataset.splits.tset = \'a\'
              dataset.splits: unknown key, got `tset`
              did you mean `test`? known keys here: train1, train2, validation, test, seeded
            dataset.splits.seeded.train = 0.5
              dataset.splits.seeded: unknown key, got `train`
              did you mean `train1`? known keys here: seed, train1, train2, validation, test, stratified, test_sequences
        "#]],
    );
}

#[test]
fn types() {
    check(
        &[
            "ga.population = \"ten\"",
            "ga.population = 10.0",
            "ga.population = -1",
            "ga.population = 4294967296",
            "ga.population = 99999999999999999999999999999999999999999",
            "ga.mutation_rate = \"high\"",
            "ga.mutation_rate = 1e999",
            "ga = 10",
            "[[ga]]\npopulation = 10",
            "results = [\"out\"]",
            "descriptor.genes = [8]",
            "coordinator.local_workers = \"4\"",
            "stop.perfect = 1",
            "name = 5",
            "name = 1979-05-27",
            "seed = -1",
            "ga.scaling = \"lineer\"",
            "ga.scaling = 1",
            "search.method = \"sweep\"",
            "ga.selection = \"tournament\"",
            "stop.validation_patience = \"of\"",
            "stop.validation_patience = -1",
            "stop.stagnation = 4.5",
            "coordinator.local_workers = 'all'",
            "descriptor.genes.m = \"8\"",
            "descriptor.genes.m = { min = \"3\" }",
            "descriptor.genes.m = [3, 8]",
            "dataset.splits = 'random'",
            "dataset.splits = 1",
            "dataset.splits.seeded.test_sequences = [2]",
            "dataset.splits.seeded.test_sequences = '2'",
            &format!("ga.population = '{}\u{1b}'", "9".repeat(500)),
            &format!("ga.population = '{}\t'", "9".repeat(500)),
        ],
        expect![[r#"
            ga.population = \"ten\"
              ga.population: expected a whole number from 0 to 4294967295, got "ten"
              write a number without quotes and decimal point
            ga.population = 10.0
              ga.population: expected a whole number from 0 to 4294967295, got 10.0
              write a number without quotes and decimal point
            ga.population = -1
              ga.population: expected a whole number from 0 to 4294967295, got -1
              write a number without quotes and decimal point
            ga.population = 4294967296
              ga.population: expected a whole number from 0 to 4294967295, got 4294967296
              write a number without quotes and decimal point
            ga.population = 99999999999999999999999999999999999999999
              ga.population: integer number overflowed, got 99999999999999999999999999999999999999999
              correct the value
            ga.mutation_rate = \"high\"
              ga.mutation_rate: expected a number, got "high"
              write a number without quotes
            ga.mutation_rate = 1e999
              ga.mutation_rate: floating-point number overflowed, got 1e999
              correct the value
            ga = 10
              ga: expected a table, got 10
              write a section [name] or { key = value, … }
            [[ga]]\npopulation = 10
              ga: expected a table, got [[ga]]
              write a section [name] or { key = value, … }
            results = [\"out\"]
              results: expected a table, got ["out"]
              write a section [name] or { key = value, … }
            descriptor.genes = [8]
              descriptor.genes: expected a table, got [8]
              write a section [name] or { key = value, … }
            coordinator.local_workers = \"4\"
              coordinator.local_workers: expected a whole number from 0 to 4294967295 or "auto", got "4"
              write one of these
            stop.perfect = 1
              stop.perfect: expected true or false, got 1
              write true or false without quotes
            name = 5
              name: expected text, got 5
              put the text in quotes
            name = 1979-05-27
              name: expected text, got 1979-05-27
              put the text in quotes
            seed = -1
              seed: expected a whole number from 0 to 9223372036854775807, got -1
              write a number without quotes and decimal point
            ga.scaling = \"lineer\"
              ga.scaling: unknown word, got "lineer"
              did you mean `linear`? known words here: none, linear, rank
            ga.scaling = 1
              ga.scaling: expected a word, got 1
              write a word in quotes
            search.method = \"sweep\"
              search.method: unknown word, got "sweep"
              known words here: ga, random, exhaustive, hill-climb, nsga2
            ga.selection = \"tournament\"
              ga.selection: unknown word, got "tournament"
              known words here: roulette
            stop.validation_patience = \"of\"
              stop.validation_patience: expected a whole number from 0 to 4294967295 or "off", got "of"
              write one of these
            stop.validation_patience = -1
              stop.validation_patience: expected a whole number from 0 to 4294967295 or "off", got -1
              write one of these
            stop.stagnation = 4.5
              stop.stagnation: expected a whole number from 0 to 4294967295 or "off", got 4.5
              write one of these
            coordinator.local_workers = \'all\'
              coordinator.local_workers: expected a whole number from 0 to 4294967295 or "auto", got 'all'
              write one of these
            descriptor.genes.m = \"8\"
              descriptor.genes.m: expected a number, or a table such as { min = 1, max = 2, step = 1 }, got "8"
              write one of these
            descriptor.genes.m = { min = \"3\" }
              descriptor.genes.m.min: expected a number, got "3"
              write a number without quotes
            descriptor.genes.m = [3, 8]
              descriptor.genes.m: expected a number, or a table such as { min = 1, max = 2, step = 1 }, got [3, 8]
              write one of these
            dataset.splits = \'random\'
              dataset.splits: unknown word, got 'random'
              known words here: manifest
            dataset.splits = 1
              dataset.splits: expected "manifest", or a table of lists, or a table with `seeded`, got 1
              write one of these
            dataset.splits.seeded.test_sequences = [2]
              dataset.splits.seeded.test_sequences: expected text, got 2
              put the text in quotes
            dataset.splits.seeded.test_sequences = \'2\'
              dataset.splits.seeded.test_sequences: expected a list, got '2'
              write values in brackets, with commas between them
            ga.population = \'99999999999999999999999999999999999999999999999999999999999999
              line 3, column 518: invalid literal string, expected non-single-quote visible characters, got `ga.population = '9999999999999999999999999999999999999999999…`
              a line is `key = value` or `[section]`; a value is a number, true, false, "text", [ list ] or { table }
            ga.population = \'99999999999999999999999999999999999999999999999999999999999999
              ga.population: expected a whole number from 0 to 4294967295, got '99999999999999999999999999999999999999999999999999999999999…
              write a number without quotes and decimal point
        "#]],
    );
}

#[test]
fn files_that_are_no_text() {
    let folder = tempfile::tempdir().unwrap();
    let check = |name: &str, bytes: Option<&[u8]>, expected: Expect| {
        let path = folder.path().join(name);
        if let Some(bytes) = bytes {
            std::fs::write(&path, bytes).unwrap();
        }
        let message = Experiment::read(&path, Overrides::default()).unwrap_err().to_string();
        expected.assert_eq(&message.replace(&folder.path().display().to_string(), "exp"));
    };
    check(
        "none.toml",
        None,
        expect![[r#"
        exp/none.toml: file: not readable, got No such file or directory (os error 2)
        name an experiment file (.toml)"#]],
    );
    check(
        "",
        None,
        expect![[r#"
            exp/: file: not readable, got something that is no file
            name an experiment file (.toml)"#]],
    );
    check(
        "latin.toml",
        Some(b"version = 1 # \xfc"),
        expect![[r#"
        exp/latin.toml: file: not UTF-8, got another byte at offset 14
        save it as UTF-8"#]],
    );
    check(
        "large.toml",
        Some(&vec![b'#'; 1 << 20 | 1]),
        expect![[r#"
        exp/large.toml: file: larger than 1048576 bytes, got 1048577 or more
        name an experiment file (.toml)"#]],
    );
    let largest = [LEAST.as_bytes(), &vec![b'#'; (1 << 20) - LEAST.len()]].concat();
    let path = folder.path().join("largest.toml");
    std::fs::write(&path, largest).unwrap();
    assert_eq!(Experiment::read(&path, Overrides::default()).unwrap().name(), "largest");
}

#[test]
fn sweeps() {
    let show = |lines: &str| {
        let path = Path::new("exp/x.toml");
        let plan = Plan::parse(&format!("{LEAST}{lines}"), path, Overrides::default(), &no_variables);
        let message = plan.unwrap_err().to_string();
        format!("{lines:?}\n  {}\n", message.strip_prefix("exp/x.toml: ").unwrap().replace('\n', "\n  "))
    };
    let shown: String = [
        "[sweep]",
        "sweep = []",
        "[sweep]\nseeds = \"20..1\"",
        "[sweep]\nseeds = \"1-20\"",
        "[sweep]\nseeds = \"1..100000\"",
        "[sweep]\nseeds = []",
        "[sweep]\nseeds = [1, 2, 1]",
        "[sweep]\nseeds = [1, -2]",
        "[sweep]\nseeds = 3",
        "[sweep]\nseed = 3",
        "[sweep]\nseeds = \"1..500\"\n[sweep.variants.a]\n[sweep.variants.b]\n[sweep.variants.c]",
        "[sweep.variants.\"pop 20\"]\nga.population = 20",
        "[sweep.variants.x]\nga.populaton = 20",
        "[sweep.variants.x]\nga.population = 1",
        "[sweep.variants.x]\nga.elite = 20",
        "[sweep.variants.x]\npreprocess.leaf_cm = 1.0",
        "[sweep.variants.x]\nsearch.method = \"exhaustive\"",
        "search.method = \"exhaustive\"\nsweep.seeds = [1, 2]",
    ]
    .into_iter()
    .map(show)
    .collect();
    expect![[r#"
        "[sweep]"
          sweep: neither seeds nor variants, got none
          write `seeds = "1..20"`, or a section [sweep.variants.NAME]
        "sweep = []"
          sweep: expected a table, got []
          write a section [name] or { key = value, … }
        "[sweep]\nseeds = \"20..1\""
          sweep.seeds: ends before it begins, got "20..1"
          write "1..20"
        "[sweep]\nseeds = \"1-20\""
          sweep.seeds: not two seeds with `..` between, got "1-20"
          write "1..20" for all from 1 to 20, or a list such as [1, 5, 9]
        "[sweep]\nseeds = \"1..100000\""
          sweep.seeds: more than 1000 seeds, got "1..100000"
          name fewer seeds
        "[sweep]\nseeds = []"
          sweep.seeds: no seed, got []
          write "1..20", or a list such as [1, 5, 9]
        "[sweep]\nseeds = [1, 2, 1]"
          sweep.seeds: must be different, got 1 twice
          name each seed once
        "[sweep]\nseeds = [1, -2]"
          sweep.seeds: expected a whole number from 0 to 9223372036854775807, got -2
          write a number without quotes and decimal point
        "[sweep]\nseeds = 3"
          sweep.seeds: expected two seeds such as "1..20", or a list of seeds, got 3
          write one of these
        "[sweep]\nseed = 3"
          sweep: unknown key, got `seed`
          did you mean `seeds`? known keys here: seeds, variants
        "[sweep]\nseeds = \"1..500\"\n[sweep.variants.a]\n[sweep.variants.b]\n[sweep.variants.c]"
          sweep: more than 1000 runs, got 1500
          name fewer seeds or variants
        "[sweep.variants.\"pop 20\"]\nga.population = 20"
          sweep.variants.pop 20: not 1 to 64 letters a-z, digits, - and _, beginning without -, got "pop 20"
          call it `pop-20`
        "[sweep.variants.x]\nga.populaton = 20"
          sweep.variants.x.ga: unknown key, got `populaton`
          did you mean `population`? known keys here: population, elite, selection, scaling, crossover, crossover_rate, mutation, mutation_rate, mutation_decay, preselection, encoding
        "[sweep.variants.x]\nga.population = 1"
          sweep.variants.x.ga.population: not between 2 and 65536, got 1
          set it to the individuals a generation, such as 10
        "[sweep.variants.x]\nga.elite = 20"
          sweep.variants.x.ga.elite: not below ga.population = 10, got 20
          set it to the individuals copied unchanged, such as 1
        "[sweep.variants.x]\npreprocess.leaf_cm = 1.0"
          sweep.variants.x: unknown key, got `preprocess`
          known keys here: search, ga, stop
        "[sweep.variants.x]\nsearch.method = \"exhaustive\""
          sweep.variants.x.search.method: an exhaustive search has neither seed nor variants, got one in a sweep
          write "ga" or "random" or "hill-climb" or "nsga2", or remove [sweep]
        "search.method = \"exhaustive\"\nsweep.seeds = [1, 2]"
          search.method: an exhaustive search has neither seed nor variants, got one in a sweep
          write "ga" or "random" or "hill-climb" or "nsga2", or remove [sweep]
    "#]].assert_eq(&shown);
}
