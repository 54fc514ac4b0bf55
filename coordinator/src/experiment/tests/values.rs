//! What a value without meaning is answered with.

use expect_test::expect;

use super::messages::{check, check_file};
use super::*;

#[test]
fn name_and_seed() {
    check(
        &[
            "name = \"Über Exp\"",
            "name = \"../x\"",
            "name = \"-\"",
            &format!("name = \"{}\"", "a".repeat(100_000)),
            &format!("name = \"{}\"", "a".repeat(65)),
            "seed = 9223372036854775808",
        ],
        expect![[r#"
            name = \"Über Exp\"
              name: not 1 to 64 letters a-z, digits, - and _, beginning without -, got "Über Exp"
              write `name = "ber-exp"`
            name = \"../x\"
              name: not 1 to 64 letters a-z, digits, - and _, beginning without -, got "../x"
              write `name = "x"`
            name = \"-\"
              name: not 1 to 64 letters a-z, digits, - and _, beginning without -, got "-"
              write `name = "experiment"`
            name = \"aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa
              name: not 1 to 64 letters a-z, digits, - and _, beginning without -, got "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa…
              write `name = "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"`
            name = \"aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa\"
              name: not 1 to 64 letters a-z, digits, - and _, beginning without -, got "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"
              write `name = "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"`
            seed = 9223372036854775808
              seed: not between 0 and 9223372036854775807, got 9223372036854775808
              choose a smaller number: integers of TOML end there
        "#]],
    );
    let overrides = Overrides { seed: Some(u64::MAX), ..Overrides::default() };
    let error = Experiment::parse(LEAST, Path::new("x.toml"), overrides, &no_variables).unwrap_err();
    expect![[r#"
        x.toml: --seed: not between 0 and 9223372036854775807, got 18446744073709551615
        choose a smaller number: integers of TOML end there"#]]
    .assert_eq(&error.to_string());
    let error =
        Experiment::parse(LEAST, Path::new("My Exp.toml"), Overrides::default(), &no_variables).unwrap_err();
    expect![[r#"
        My Exp.toml: name: not 1 to 64 letters a-z, digits, - and _, beginning without -, got "My Exp"
        write `name = "my-exp"`"#]]
    .assert_eq(&error.to_string());
}

#[test]
fn dataset() {
    check_file(
        &["version = 1\ndataset.root = '${CLOUDS}/x'", "version = 1\ndataset.root = '${CLOUDS'"],
        expect![[r#"
            version = 1\ndataset.root = \'${CLOUDS}/x\'
              dataset.root: environment variable not set, got ${CLOUDS}
              set CLOUDS, or write ${CLOUDS:-default}
            version = 1\ndataset.root = \'${CLOUDS\'
              dataset.root: `${` without `}`, got "${CLOUDS"
              write ${NAME} or ${NAME:-default}
        "#]],
    );
    check(
        &[
            "dataset.layout = 'manifest'",
            "dataset.manifest = 'a.csv'",
            "dataset.layout = 'pattern'",
            "dataset.pattern = '{instance}.pcd'",
            "dataset.layout = 'pattern'\ndataset.pattern = '{object}.pcd'",
            "dataset.layout = 'pattern'\ndataset.pattern = '{instance}.pcd'\ndataset.splits = 'manifest'",
            "dataset.layout = 'pattern'\ndataset.pattern = '{instance}.pcd'\ndataset.splits.seeded.test_sequences = ['2']",
            "dataset.layout = 'wu'",
            "dataset.unit = 'cm'",
            "dataset.splits = 'manifest'",
            "dataset.splits.test = '${LIST}'",
            "[dataset.splits]\ntrain1 = 'a.txt'\nseeded = {}",
            "[dataset.splits]\ntrain1 = ['a.txt', 'b.txt']\nseeded = {}",
            "dataset.splits.train1 = ['a.txt', '']",
            "dataset.splits.train1 = []",
            "dataset.splits.train1 = 1",
            "dataset.splits.train1 = [1]",
            "dataset.splits.validation = []",
            "dataset.splits.test = []\nsearch.winner = 'fitness'\nstop.validation_patience = 'off'",
            "dataset.splits.seeded.train1 = 1.5",
            "dataset.splits.seeded.train1 = nan",
            "dataset.splits.seeded.train2 = 0",
            "dataset.splits.seeded.train2 = 0.3333333333",
            "dataset.splits.seeded.validation = 0",
            "dataset.splits.seeded.validation = 0\nsearch.winner = 'validation'\nstop.validation_patience = 'off'",
            "dataset.splits.seeded.train2 = 0.9",
            "dataset.splits.seeded.test = 0",
            "dataset.splits.seeded.train2 = 0.58",
            "dataset.splits.seeded.test = 0.4",
            "dataset.splits.seeded = { test = 0.1, test_sequences = ['2'] }",
            "dataset.splits.seeded.seed = 9223372036854775808",
            "dataset.layout = 'folders'\ndataset.splits.seeded.test_sequences = ['2']",
            "dataset.synthetic.objects = 1",
            "dataset.synthetic.views = 3",
            "dataset.layout = 'folders'\ndataset.synthetic = {}",
            "dataset.unit = 'mm'\ndataset.synthetic = {}",
        ],
        expect![[r#"
            dataset.layout = \'manifest\'
              dataset.manifest: required key missing for layout = "manifest", got none
              add `manifest = "clouds.csv"`
            dataset.manifest = \'a.csv\'
              dataset.manifest: not used by this layout, got "a.csv"
              remove it, or write `layout = "manifest"`
            dataset.layout = \'pattern\'
              dataset.pattern: required key missing for layout = "pattern", got none
              add `pattern = "{category}_{instance}_{sequence}_{any}.pcd"`
            dataset.pattern = \'{instance}.pcd\'
              dataset.pattern: not used by this layout, got "{instance}.pcd"
              remove it, or write `layout = "pattern"`
            dataset.layout = \'pattern\'\ndataset.pattern = \'{object}.pcd\'
              dataset.pattern: {category}, {instance}, {sequence} and {any}, and no other braces, expected, got {object}.pcd
              write a pattern such as {category}_{instance}_{sequence}_{any}.pcd
            dataset.layout = \'pattern\'\ndataset.pattern = \'{instance}.pcd\'\ndataset.spli
              dataset.splits: there is no manifest in this layout, got "manifest"
              write `layout = "manifest"`, or name lists or a seeded draw in [dataset.splits]
            dataset.layout = \'pattern\'\ndataset.pattern = \'{instance}.pcd\'\ndataset.spli
              dataset.splits.seeded.test_sequences: the pattern has no {sequence}, got ["2"]
              remove them, or use layout "uw", "bop" or "manifest", or a pattern with {sequence}
            dataset.layout = \'wu\'
              dataset.layout: unknown word, got 'wu'
              did you mean `uw`? known words here: uw, folders, bop, manifest, pattern
            dataset.unit = \'cm\'
              dataset.unit: unknown word, got 'cm'
              known words here: m, mm
            dataset.splits = \'manifest\'
              dataset.splits: there is no manifest in this layout, got "manifest"
              write `layout = "manifest"`, or name lists or a seeded draw in [dataset.splits]
            dataset.splits.test = \'${LIST}\'
              dataset.splits.test: environment variable not set, got ${LIST}
              set LIST, or write ${LIST:-default}
            [dataset.splits]\ntrain1 = \'a.txt\'\nseeded = {}
              dataset.splits.train1: a list beside a seeded draw, got "a.txt"
              remove the list, or remove `seeded`
            [dataset.splits]\ntrain1 = [\'a.txt\', \'b.txt\']\nseeded = {}
              dataset.splits.train1: a list beside a seeded draw, got ["a.txt", "b.txt"]
              remove the list, or remove `seeded`
            dataset.splits.train1 = [\'a.txt\', \'\']
              dataset.splits.train1: empty path, got ""
              name a file or folder, `.` for the folder of this file
            dataset.splits.train1 = []
              dataset.splits.train1: a split without lists, got []
              name a list
            dataset.splits.train1 = 1
              dataset.splits.train1: expected the path of a list, or paths of several such as ["train2.txt", "more.txt"], got 1
              write one of these
            dataset.splits.train1 = [1]
              dataset.splits.train1: expected text, got 1
              put the text in quotes
            dataset.splits.validation = []
              dataset.splits.validation: the search needs validation clouds, got []
              name a list, or set stop.validation_patience = "off" and search.winner = "fitness"
            dataset.splits.test = []\nsearch.winner = \'fitness\'\nstop.validation_patience 
              dataset.splits.test: a split without lists, got []
              name a list
            dataset.splits.seeded.train1 = 1.5
              dataset.splits.seeded.train1: not between 0 and 1 with at most six decimals, got 1.5
              write a share of all clouds, such as 0.25
            dataset.splits.seeded.train1 = nan
              dataset.splits.seeded.train1: not between 0 and 1 with at most six decimals, got NaN
              write a share of all clouds, such as 0.25
            dataset.splits.seeded.train2 = 0
              dataset.splits.seeded.train2: a split without clouds, got 0
              write a share above 0 (validation may be 0 with stop.validation_patience = "off" and search.winner = "fitness")
            dataset.splits.seeded.train2 = 0.3333333333
              dataset.splits.seeded.train2: not between 0 and 1 with at most six decimals, got 0.3333333333
              write a share of all clouds, such as 0.25
            dataset.splits.seeded.validation = 0
              dataset.splits.seeded.validation: a split without clouds, got 0
              write a share above 0 (validation may be 0 with stop.validation_patience = "off" and search.winner = "fitness")
            dataset.splits.seeded.validation = 0\nsearch.winner = \'validation\'\nstop.valid
              dataset.splits.seeded.validation: a split without clouds, got 0
              write a share above 0 (validation may be 0 with stop.validation_patience = "off" and search.winner = "fitness")
            dataset.splits.seeded.train2 = 0.9
              dataset.splits.seeded: shares add up to more than 1, got 1.32
              lower train1, train2, validation or test
            dataset.splits.seeded.test = 0
              dataset.splits.seeded.test: a split without clouds, got 0
              write a share above 0 and lower the others, or name test_sequences
            dataset.splits.seeded.train2 = 0.58
              dataset.splits.seeded.test: a split without clouds, got 0
              write a share above 0 and lower the others, or name test_sequences
            dataset.splits.seeded.test = 0.4
              dataset.splits.seeded: shares add up to more than 1, got 1.07
              lower train1, train2, validation or test
            dataset.splits.seeded = { test = 0.1, test_sequences = [\'2\'] }
              dataset.splits.seeded.test: a share beside test_sequences, got 0.1
              remove it: the test split is exactly the clouds of these sequences
            dataset.splits.seeded.seed = 9223372036854775808
              dataset.splits.seeded.seed: not between 0 and 9223372036854775807, got 9223372036854775808
              choose a smaller number: integers of TOML end there
            dataset.layout = \'folders\'\ndataset.splits.seeded.test_sequences = [\'2\']
              dataset.splits.seeded.test_sequences: layout "folders" has no sequences, got ["2"]
              remove them, or use layout "uw", "bop" or "manifest", or a pattern with {sequence}
            dataset.synthetic.objects = 1
              dataset.synthetic.objects: number outside 2 to 1000, got 1
              choose a number inside these limits
            dataset.synthetic.views = 3
              dataset.synthetic.views: number outside 4 to 1000, got 3
              choose a number inside these limits
            dataset.layout = \'folders\'\ndataset.synthetic = {}
              dataset.layout: synthetic clouds are laid out as "uw", got another layout
              write `layout = "uw"` or remove [dataset.synthetic]
            dataset.unit = \'mm\'\ndataset.synthetic = {}
              dataset.unit: synthetic clouds are in metres, got "mm"
              write `unit = "m"` or remove [dataset.synthetic]
        "#]],
    );
}

#[test]
fn preprocess() {
    check(
        &[
            "preprocess.leaf_cm = 0",
            "preprocess.leaf_cm = nan",
            "preprocess.leaf_cm = 2.00001",
            "preprocess.normal_radius_cm = 1000",
            "preprocess.min_points = 0",
        ],
        expect![[r#"
            preprocess.leaf_cm = 0
              preprocess.leaf_cm: not between 0.01 and 100 cm with at most four decimals, got 0
              write a length in centimetres, such as 2.0
            preprocess.leaf_cm = nan
              preprocess.leaf_cm: not between 0.01 and 100 cm with at most four decimals, got NaN
              write a length in centimetres, such as 2.0
            preprocess.leaf_cm = 2.00001
              preprocess.leaf_cm: not between 0.01 and 100 cm with at most four decimals, got 2.00001
              write a length in centimetres, such as 2.0
            preprocess.normal_radius_cm = 1000
              preprocess.normal_radius_cm: not between 0.01 and 100 cm with at most four decimals, got 1000
              write a length in centimetres, such as 2.0
            preprocess.min_points = 0
              preprocess.min_points: not between 1 and 1000000, got 0
              write a number of points such as 10
        "#]],
    );
}

#[test]
fn genes() {
    check(
        &[
            "descriptor.genes.shape_bins = { min = 64, max = 8 }",
            "descriptor.genes.shape_bins = { min = 65 }",
            "descriptor.genes.m = { step = 0 }",
            "descriptor.genes.m = { step = 2 }",
            "descriptor.genes.m = { step = 6 }",
            "descriptor.genes.m = { min = 30, max = 32, step = 3 }",
            "descriptor.genes.R1 = { min = 0.5, max = 1.98 }",
            "descriptor.genes.R1 = { min = 0.5, max = 1.92 }",
            "descriptor.genes.m = 2.5",
            "descriptor.genes.m = 0",
            "descriptor.genes.m = -3",
            "descriptor.genes.R1 = 1.00001",
            "descriptor.genes.R1 = 0",
            "descriptor.genes.R2 = inf",
            "descriptor.genes.R2 = { step = nan }",
            "descriptor.genes.w = 1.01",
            "descriptor.genes.w = { step = 0.000001 }",
            "descriptor.genes.R1 = { max = 2.1 }",
            "[descriptor.genes]\nR1 = 1.3\nR2 = 1.3",
        ],
        expect![[r#"
            descriptor.genes.shape_bins = { min = 64, max = 8 }
              descriptor.genes.shape_bins: min above max, got min = 64, max = 8
              write min below max; what is not written has its default
            descriptor.genes.shape_bins = { min = 65 }
              descriptor.genes.shape_bins: min above max, got min = 65, max = 64
              write min below max; what is not written has its default
            descriptor.genes.m = { step = 0 }
              descriptor.genes.m.step: not at least 1, got 0
              write a step such as 1, or a fixed value `m = …`
            descriptor.genes.m = { step = 2 }
              descriptor.genes.m.max: not min plus a whole number of steps, got min = 3, max = 8, step = 2
              the nearest max is 7
            descriptor.genes.m = { step = 6 }
              descriptor.genes.m.max: not min plus a whole number of steps, got min = 3, max = 8, step = 6
              the nearest max is 9
            descriptor.genes.m = { min = 30, max = 32, step = 3 }
              descriptor.genes.m.max: not min plus a whole number of steps, got min = 30, max = 32, step = 3
              the nearest max is 30
            descriptor.genes.R1 = { min = 0.5, max = 1.98 }
              descriptor.genes.R1.max: not min plus a whole number of steps, got min = 0.5, max = 1.98, step = 0.1
              the nearest max is 2
            descriptor.genes.R1 = { min = 0.5, max = 1.92 }
              descriptor.genes.R1.max: not min plus a whole number of steps, got min = 0.5, max = 1.92, step = 0.1
              the nearest max is 1.9
            descriptor.genes.m = 2.5
              descriptor.genes.m: not a whole number, got 2.5
              round it
            descriptor.genes.m = 0
              descriptor.genes.m: not between 1 and 32, got 0
              choose the bins a side of a hue x saturation histogram inside these limits
            descriptor.genes.m = -3
              descriptor.genes.m: not between 1 and 32, got -3
              choose the bins a side of a hue x saturation histogram inside these limits
            descriptor.genes.R1 = 1.00001
              descriptor.genes.R1: not a multiple of 0.0001 cm, got 1.00001
              round it
            descriptor.genes.R1 = 0
              descriptor.genes.R1: not between 0.0001 and 100 cm, got 0
              choose the radius of the disk inside these limits
            descriptor.genes.R2 = inf
              descriptor.genes.R2: not between 0.0001 and 100 cm, got inf
              choose the outer radius of the ring inside these limits
            descriptor.genes.R2 = { step = nan }
              descriptor.genes.R2.step: not between 0.0001 and 100 cm, got NaN
              choose the outer radius of the ring inside these limits
            descriptor.genes.w = 1.01
              descriptor.genes.w: not between 0 and 1, got 1.01
              choose the weight of shape against colour inside these limits
            descriptor.genes.w = { step = 0.000001 }
              descriptor.genes.w: number of values outside 1 to 65536, got 1000001
              choose a larger step or a smaller interval
            descriptor.genes.R1 = { max = 2.1 }
              descriptor.genes.R2: every value must be larger than every value of R1, got R1 up to 2.1 cm and R2 from 2.1 cm
              raise R2's min or lower R1's max
            [descriptor.genes]\nR1 = 1.3\nR2 = 1.3
              descriptor.genes.R2: every value must be larger than every value of R1, got R1 up to 1.3 cm and R2 from 1.3 cm
              raise R2's min or lower R1's max
        "#]],
    );
}

#[test]
fn families() {
    check(
        &[
            "descriptor.family = 'shotcolor'",
            "descriptor.family = 'disk-rings'",
            "descriptor.genes.bins = 5",
            "descriptor.family = 'global-hue'\ndescriptor.genes.R1 = 1.0",
            "descriptor.family = 'global-hue'\ndescriptor.genes.bins = 65",
            "descriptor.family = 'global-hue'\ndescriptor.colour = false",
        ],
        expect![[r#"
            descriptor.family = \'shotcolor\'
              descriptor.family: unknown word, got 'shotcolor'
              known words here: disk-ring, global-hue, structure
            descriptor.family = \'disk-rings\'
              descriptor.family: unknown word, got 'disk-rings'
              did you mean `disk-ring`? known words here: disk-ring, global-hue, structure
            descriptor.genes.bins = 5
              descriptor.genes: no gene of family disk-ring, got `bins`
              its genes: shape_bins, m, R1, R2, w
            descriptor.family = \'global-hue\'\ndescriptor.genes.R1 = 1.0
              descriptor.genes: no gene of family global-hue, got `R1`
              its genes: bins
            descriptor.family = \'global-hue\'\ndescriptor.genes.bins = 65
              descriptor.genes.bins: not between 2 and 64, got 65
              choose the bins of the histogram of hue inside these limits
            descriptor.family = \'global-hue\'\ndescriptor.colour = false
              descriptor.family global-hue: needs colours, got none
              set colour = true, or choose disk-ring
        "#]],
    );
}

#[test]
fn search_and_stop() {
    check(
        &[
            "ga.population = 0",
            "ga.elite = 10",
            "ga.crossover_rate = 1.5",
            "ga.mutation_rate = nan",
            "ga.mutation_decay = -inf",
            "ga.preselection = 0",
            "ga.preselection = 65",
            "ga.preselection = 8",
            "stop.generations = 0",
            "stop.stagnation = 0",
            "stop.validation_patience = 0",
            "stop.evaluations = 0",
            "stop.evaluations = 'of'",
            "stop.evaluations = -1",
            "ga.crossover = 'slot'",
            "ga.crossover = 'any-slots'",
            "ga.mutation = 'gene'",
            "search.winner = 'test'",
            "search.winner = true",
        ],
        expect![[r#"
            ga.population = 0
              ga.population: not between 2 and 65536, got 0
              set it to the individuals a generation, such as 10
            ga.elite = 10
              ga.elite: not below ga.population = 10, got 10
              set it to the individuals copied unchanged, such as 1
            ga.crossover_rate = 1.5
              ga.crossover_rate: not between 0 and 1, got 1.5
              set it to a probability or factor in this range
            ga.mutation_rate = nan
              ga.mutation_rate: not between 0 and 1, got NaN
              set it to a probability or factor in this range
            ga.mutation_decay = -inf
              ga.mutation_decay: not between 0 and 1, got -inf
              set it to a probability or factor in this range
            ga.preselection = 0
              ga.preselection: not between 1 and 64, got 0
              set it to the children to choose each from, such as 8, or 1 to evaluate all
            ga.preselection = 65
              ga.preselection: not between 1 and 64, got 65
              set it to the children to choose each from, such as 8, or 1 to evaluate all
            ga.preselection = 8
              ga.preselection: must be 1 with family disk-ring, got 8
              leave it out, or set descriptor.family = "structure"
            stop.generations = 0
              stop.generations: not at least 1, got 0
              set it to a number of generations from 1
            stop.stagnation = 0
              stop.stagnation: not at least 1, got 0
              set it to a number of generations from 1
            stop.validation_patience = 0
              stop.validation_patience: not at least 1, got 0
              set it to a number of generations from 1
            stop.evaluations = 0
              stop.evaluations: not at least 1, got 0
              set it to a number of evaluations from 1
            stop.evaluations = \'of\'
              stop.evaluations: expected a whole number from 0 to 4294967295 or "off", got 'of'
              write one of these
            stop.evaluations = -1
              stop.evaluations: expected a whole number from 0 to 4294967295 or "off", got -1
              write one of these
            ga.crossover = \'slot\'
              ga.crossover: unknown word, got 'slot'
              did you mean `slots`? known words here: uniform, slots, any-slots
            ga.crossover = \'any-slots\'
              ga.crossover: "any-slots" needs slots, got family disk-ring
              set it to "slots", which exchanges single genes there, or set descriptor.family = "structure"
            ga.mutation = \'gene\'
              ga.mutation: unknown word, got 'gene'
              known words here: in-order, field, slot
            search.winner = \'test\'
              search.winner: unknown word, got 'test'
              known words here: validation, fitness
            search.winner = true
              search.winner: expected a word, got true
              write a word in quotes
        "#]],
    );
}

#[test]
fn coordinator_and_results() {
    check(
        &[
            "coordinator.listen = 'localhost'",
            "coordinator.local_workers = 1025",
            "coordinator.lease_seconds = 1",
            "coordinator.job_seconds = 0",
            "coordinator.max_failures = 0",
            "coordinator.worker_grace_seconds = 604801",
            "coordinator.audit = 1.5",
            "coordinator.audit = nan",
            "coordinator.pieces = 0",
            "results.dir = ''",
            "results.dir = '~/runs'",
        ],
        expect![[r#"
            coordinator.listen = \'localhost\'
              coordinator.listen: not an IP address and port, got "localhost"
              write an address such as "127.0.0.1:7700", or "0.0.0.0:7700" for every network
            coordinator.local_workers = 1025
              coordinator.local_workers: not between 0 and 1024 workers, got 1025
              choose a number inside these limits
            coordinator.lease_seconds = 1
              coordinator.lease_seconds: not between 2 and 3600 seconds, got 1
              choose a number inside these limits
            coordinator.job_seconds = 0
              coordinator.job_seconds: not between 1 and 604800 seconds, got 0
              choose a number inside these limits
            coordinator.max_failures = 0
              coordinator.max_failures: not between 1 and 100 failures, got 0
              choose a number inside these limits
            coordinator.worker_grace_seconds = 604801
              coordinator.worker_grace_seconds: not between 0 and 604800 seconds, got 604801
              choose a number inside these limits
            coordinator.audit = 1.5
              coordinator.audit: not between 0 and 1, got 1.5
              choose a share: 0.01 is one in a hundred
            coordinator.audit = nan
              coordinator.audit: not between 0 and 1, got NaN
              choose a share: 0.01 is one in a hundred
            coordinator.pieces = 0
              coordinator.pieces: not between 1 and 4096 pieces, got 0
              choose a number inside these limits
            results.dir = \'\'
              results.dir: empty path, got ""
              name a file or folder, `.` for the folder of this file
            results.dir = \'~/runs\'
              results.dir: `~` is not expanded, got "~/runs"
              write "${HOME}/runs"
        "#]],
    );
}
