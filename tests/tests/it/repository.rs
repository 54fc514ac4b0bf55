//! The rules of this repository, as tests that name the file and the rule.

use std::collections::BTreeSet;
use std::fs;
use std::process::Command;

use serde_json::Value;
use toml::Table;

use crate::circles::{tokens, without_tests};
use crate::experiments::repository;

/// Which crate of the workspace may depend on which (DESIGN 2).
const MAY_DEPEND_ON: [(&str, &[&str]); 13] = [
    ("artefact", &["descriptor", "proto"]),
    ("proto", &[]),
    ("descriptor", &[]),
    ("results/atomic", &[]),
    ("results", &["artefact", "atomic"]),
    ("worker/cache", &["atomic", "proto"]),
    ("worker", &["cache", "proto", "descriptor"]),
    ("coordinator/bucket", &["cache", "proto", "worker"]),
    ("coordinator/evolution", &["descriptor"]),
    ("coordinator/cluster", &["atomic", "cache", "proto", "descriptor"]),
    ("coordinator/transport", &["atomic", "proto", "cluster"]),
    (
        "coordinator",
        &[
            "artefact",
            "atomic",
            "bucket",
            "cache",
            "proto",
            "descriptor",
            "results",
            "worker",
            "cluster",
            "evolution",
            "transport",
        ],
    ),
    (
        "tests",
        &[
            "artefact",
            "cache",
            "proto",
            "descriptor",
            "results",
            "worker",
            "cluster",
            "evolution",
            "transport",
            "coordinator",
        ],
    ),
];

fn read(path: &str) -> String {
    fs::read_to_string(repository().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

fn cargo(args: &[&str]) -> String {
    let output = Command::new(env!("CARGO"))
        .args(args)
        .args(["--offline", "--locked"])
        .current_dir(repository())
        .output();
    let output = output.unwrap();
    assert!(output.status.success(), "cargo {args:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// Every file of such a name that git tracks or would.
fn tracked(pattern: &str) -> Vec<String> {
    let output = Command::new("git")
        .args(["ls-files", "--cached", "--others", "--exclude-standard", pattern])
        .current_dir(repository())
        .output()
        .unwrap();
    assert!(output.status.success(), "git ls-files: {}", String::from_utf8_lossy(&output.stderr));
    let files = String::from_utf8(output.stdout).unwrap();
    files.lines().filter(|file| repository().join(file).exists()).map(str::to_owned).collect()
}

/// Every Rust source.
fn sources() -> Vec<String> {
    let files = tracked("*.rs");
    assert!(files.len() > 50, "only {} sources found", files.len());
    files
}

fn manifest(path: &str) -> Table {
    read(path).parse().unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// The crate in a folder of the workspace.
fn crate_name(folder: &str) -> &str {
    folder.rsplit('/').next().unwrap_or(folder)
}

/// Folders of the crates.
pub fn members() -> Vec<String> {
    let members = manifest("Cargo.toml")["workspace"]["members"].clone();
    members.as_array().unwrap().iter().map(|member| member.as_str().unwrap().to_owned()).collect()
}

#[test]
fn sources_say_what_they_are_for_and_stay_short() {
    for file in sources() {
        let text = read(&file);
        assert!(
            text.starts_with("//! "),
            "{file}: the first line must be `//!` and say what the file is for"
        );
        let lines = text.lines().count();
        assert!(lines <= 600, "{file}: at most 600 lines, got {lines}: split it");
        assert!(!text.contains(concat!("#[", "ignore")), "{file}: no ignored tests: fix or remove the test");
    }
}

/// Whoever renames a file by hand forgets to sync it or its folder.
#[test]
fn only_the_crate_atomic_moves_files_to_their_place() {
    for file in sources() {
        let text = read(&file);
        let production = text.split("#[cfg(test)]").next().unwrap_or_default();
        let is_test = file.starts_with("tests/") || file.contains("/tests");
        for by_hand in [concat!("fs::", "rename("), concat!(".per", "sist(")] {
            let is_allowed = is_test || file.starts_with("results/atomic/") || !production.contains(by_hand);
            assert!(is_allowed, "{file}: {by_hand}…): write and move files with the crate `atomic`");
        }
    }
}

/// These panic where standard output or error is a full volume or a closed pipe, and take a run with them.
#[test]
fn no_program_ends_because_a_line_cannot_be_printed() {
    for file in sources() {
        let is_run_by_programs = !file.starts_with("tests/")
            && !["/tests", "/examples/", "/simulation/", "build.rs"].iter().any(|place| file.contains(place));
        let text = read(&file);
        let production = text.split("#[cfg(test)]").next().unwrap_or_default();
        let code = || production.lines().filter(|line| !line.trim_start().starts_with("//"));
        for print in [concat!("print", "!("), concat!("print", "ln!(")] {
            let is_allowed = !is_run_by_programs || !code().any(|line| line.contains(print));
            assert!(is_allowed, "{file}: {print}…): use `console::say` or `cli::print`");
        }
        let subscribes = concat!("tracing_", "subscriber::fmt()");
        let is_safe =
            !code().any(|line| line.contains(subscribes)) || text.contains("log_internal_errors(false)");
        assert!(is_safe, "{file}: {subscribes} without log_internal_errors(false)");
    }
}

#[test]
fn architecture_md_names_every_crate_and_no_other() {
    let text = read("ARCHITECTURE.md");
    let named: BTreeSet<&str> =
        text.lines().filter_map(|line| line.strip_prefix("### `")?.strip_suffix("/`")).collect();
    let members = members();
    let members: BTreeSet<&str> = members.iter().map(String::as_str).collect();
    assert_eq!(named, members, "ARCHITECTURE.md has one section `### `name/`` for each crate");
}

/// What a crate reaches along dependencies.
fn reached<'a>(from: &'a str, edges: &BTreeSet<(&'a str, &'a str)>) -> BTreeSet<&'a str> {
    let mut reached = BTreeSet::new();
    let mut open = vec![from];
    while let Some(at) = open.pop() {
        let next = edges.iter().filter(|(origin, _)| *origin == at).map(|(_, target)| *target);
        open.extend(next.filter(|target| reached.insert(*target)));
    }
    reached
}

#[test]
fn the_picture_in_architecture_md_is_what_the_manifests_say() {
    let text = read("ARCHITECTURE.md");
    let (_, picture) = text.split_once("```mermaid\nflowchart").unwrap();
    let (picture, _) = picture.split_once("```").unwrap();
    let drawn: BTreeSet<(&str, &str)> =
        picture.lines().filter_map(|line| line.trim().split_once(" --> ")).collect();

    let members: Vec<String> = members().into_iter().filter(|folder| folder != "tests").collect();
    let manifests: Vec<Table> =
        members.iter().map(|folder| manifest(&format!("{folder}/Cargo.toml"))).collect();
    let names: BTreeSet<&str> = members.iter().map(|folder| crate_name(folder)).collect();
    let mut built = BTreeSet::new();
    for (folder, manifest) in members.iter().zip(&manifests) {
        let dependencies = manifest.get("dependencies").and_then(|section| section.as_table());
        let targets = dependencies.into_iter().flat_map(|section| section.keys());
        let targets = targets.filter_map(|target| names.get(target.as_str()));
        built.extend(targets.map(|target| (crate_name(folder), *target)));
    }
    for &name in &names {
        assert_eq!(reached(name, &drawn), reached(name, &built), "ARCHITECTURE.md: what {name} depends on");
    }
    for edge in &drawn {
        let others = drawn.iter().filter(|other| *other != edge).copied().collect();
        assert!(!reached(edge.0, &others).contains(edge.1), "ARCHITECTURE.md: {edge:?} follows from others");
    }
}

#[test]
fn crates_depend_only_downwards() {
    let members: BTreeSet<String> = members().into_iter().collect();
    assert_eq!(members, MAY_DEPEND_ON.iter().map(|(name, _)| (*name).to_owned()).collect());
    let crates: BTreeSet<&str> = members.iter().map(|folder| crate_name(folder)).collect();
    for (folder, allowed) in MAY_DEPEND_ON {
        let name = crate_name(folder);
        let manifest = manifest(&format!("{folder}/Cargo.toml"));
        assert_eq!(manifest["package"]["name"].as_str(), Some(name), "folder name = crate name");
        for section in ["dependencies", "dev-dependencies", "build-dependencies"] {
            let Some(dependencies) = manifest.get(section) else { continue };
            for (dependency, value) in dependencies.as_table().unwrap() {
                // Which features of a crate of this workspace it turns on is its own affair.
                let free = |key: &str| {
                    key == "optional" || key == "features" && crates.contains(dependency.as_str())
                };
                let keys = value.as_table().unwrap().keys().map(String::as_str);
                assert_eq!(
                    keys.filter(|key| !free(key)).collect::<Vec<_>>(),
                    ["workspace"],
                    "{name}: {dependency}: version and features belong in [workspace.dependencies]"
                );
                if crates.contains(dependency.as_str()) {
                    assert!(allowed.contains(&dependency.as_str()), "{name} must not depend on {dependency}");
                }
            }
        }
        assert_eq!(manifest["lints"]["workspace"].as_bool(), Some(true), "{name}: lints.workspace = true");
    }
}

/// What changes with the protocol is changed in one place of each program.
#[test]
fn one_file_a_side_names_generated_types() {
    let sides = ["coordinator/", "worker/"];
    let is_production = |file: &str| {
        sides.iter().any(|side| file.starts_with(side)) && file.contains("/src/") && !file.contains("/tests")
    };
    let names_them = |file: &str| {
        let tokens = without_tests(&tokens(&read(file)));
        tokens.iter().any(|token| ["v1", "v2"].contains(&token.as_str()))
    };
    let files = sources();
    let found = files.iter().map(String::as_str).filter(|file| is_production(file) && names_them(file));
    assert_eq!(
        found.collect::<Vec<_>>(),
        ["coordinator/transport/src/wire.rs", "worker/src/wire.rs"],
        "only these name `proto::v1` or `proto::v2`: let them convert to types of the program's own, and back"
    );
}

/// A descriptor is a value to everybody but its family, so that another family is another file in `descriptor`.
#[test]
fn only_the_grid_of_the_papers_family_names_its_genes() {
    let genes = ["Parameters", "GeneTable", "GeneKind", "GENES", "Quantiser", "QuantisedCloud"];
    let knows = |file: &str| {
        // Cells of one R1 and one R2 are what only this family can be counted by.
        let may = ["descriptor/", "coordinator/src/exhaust/", "worker/src/executor/decoded.rs", "tests/"];
        let tokens = without_tests(&tokens(&read(file)));
        let is_test = file.contains("/tests/") || file.contains("/tests.rs");
        !is_test
            && !may.iter().any(|may| file.starts_with(may))
            && tokens.iter().any(|it| genes.contains(&it.as_str()))
    };
    let found: Vec<String> = sources().into_iter().filter(|file| knows(file)).collect();
    assert!(found.is_empty(), "these must not know the genes of disk-ring: {found:?}");
}

/// Names of the packages that a crate links, tests aside.
fn linked(package: &str) -> BTreeSet<String> {
    let tree = cargo(&["tree", "-p", package, "-e", "normal", "--prefix", "none", "-f", "{p}"]);
    tree.lines().filter_map(|line| line.split(' ').next()).map(str::to_owned).collect()
}

#[test]
fn workers_link_no_polars_and_nobody_links_an_http_client_or_a_second_tls() {
    let worker = linked("worker");
    assert!(worker.contains("kiddo") && worker.contains("tonic"));
    assert!(!worker.iter().any(|name| name.starts_with("polars")), "worker must not link polars");
    for package in ["evolution", "cluster", "transport", "cache"] {
        let polars = linked(package).into_iter().find(|name| name.starts_with("polars"));
        assert_eq!(polars, None, "{package} must not link polars");
    }
    let cluster = linked("cluster");
    for foreign in ["tonic", "descriptor", "worker"] {
        assert!(!cluster.contains(foreign), "cluster must not link {foreign}");
    }
    let transport = linked("transport");
    for foreign in ["descriptor", "worker"] {
        assert!(!transport.contains(foreign), "transport must not link {foreign}");
    }
    let descriptor = linked("descriptor");
    for impure in ["tokio", "tonic", "prost", "polars"] {
        assert!(!descriptor.contains(impure), "descriptor must not link {impure}");
    }
    // It stands in programs of others: small, and without a runtime of its own.
    let artefact = linked("artefact");
    for heavy in ["tokio", "tonic", "polars", "evolution", "worker"] {
        assert!(!artefact.contains(heavy), "artefact must not link {heavy}");
    }
    let evolution = linked("evolution");
    for impure in ["tokio", "tonic", "prost", "polars", "results"] {
        assert!(!evolution.contains(impure), "evolution must not link {impure}");
    }
    let coordinator = linked("coordinator");
    for unwanted in ["reqwest", "aws-lc-rs", "aws-lc-sys", "openssl", "native-tls"] {
        assert!(!coordinator.contains(unwanted), "nothing may link {unwanted}");
    }
}

/// Every package that a command builds, with each set of its features: `name version|features`.
///
/// A package that build scripts and macros need, too, may be built once more for them.
fn resolved(selection: &[&str], edges: &str) -> BTreeSet<String> {
    let mut args = vec!["tree", "-e", edges, "--prefix", "none", "-f", "{p}|{f}"];
    args.extend(selection);
    let tree = cargo(&args);
    let packages = tree.lines().map(|line| line.trim_end_matches(" (*)").replace(" (proc-macro)", ""));
    packages.filter(|package| package.contains('|')).collect()
}

/// Otherwise the second command builds again what the first has built. `cargo run --bin coordinator` resolves the
/// features of the whole workspace, tests aside; `-p worker` those of one crate and all below it.
#[test]
fn the_readmes_commands_resolve_the_same_features() {
    for (kind, edges, edges_of_tests) in [
        ("all", "normal,build", "normal,build,dev"),
        ("linked", "no-build,no-dev,no-proc-macro", "no-build,no-proc-macro"),
    ] {
        let run = resolved(&["--workspace"], edges);
        assert!(run.len() > 200, "only {} packages", run.len());
        for program in ["worker", "coordinator"] {
            let alone = resolved(&["-p", program], edges);
            assert!(alone.len() > 100, "{program}: only {} packages", alone.len());
            let again: Vec<&String> = alone.difference(&run).collect();
            assert!(
                again.is_empty(),
                "{kind}: `cargo build -p {program}` would build again: {again:#?}\n\
                 give them their missing features in [workspace.dependencies] and let {program} depend on them"
            );
        }
        let test = resolved(&["--workspace"], edges_of_tests);
        let again: Vec<&String> = run.difference(&test).collect();
        assert!(
            again.is_empty(),
            "{kind}: `cargo test` would build again: {again:#?}\n\
             move the dev-dependency that adds features to them to the crate `tests`"
        );
    }
}

#[test]
fn the_readme_has_the_commands_that_ci_runs() {
    let (readme, ci) = (read("README.md"), read(".ci/run"));
    let demo = "cargo run --release --bin coordinator -- run experiments/demo.toml";
    for command in [demo, "cargo test --release --workspace"] {
        let has = readme.lines().any(|line| line.trim().trim_start_matches("$ ") == command);
        assert!(has, "README.md: no line `{command}`");
        assert!(ci.contains(command), ".ci/run: does not run `{command}`");
    }
}

#[test]
fn the_books_rust_example_is_the_one_that_is_compiled() {
    let (example, page) = (read("results/examples/best_fitness.rs"), "docs/src/how-to/polars.md");
    let (_, code) = example.split_once('\n').unwrap();
    assert!(read(page).contains(&format!("```rust\n{code}```")), "{page}: the example has changed:\n{code}");
}

#[test]
fn the_books_library_example_is_the_one_that_is_run() {
    let library = read("descriptor/src/lib.rs");
    let example = library.lines().skip_while(|line| *line != "//! ```").skip(1);
    let code: String = example
        .take_while(|line| *line != "//! ```")
        .map(|line| line.strip_prefix("//!").unwrap().trim_start_matches(' ').to_owned() + "\n")
        .filter(|line| !line.starts_with('#'))
        .collect();
    assert!(code.lines().count() > 10, "{code}");
    let unindented =
        |text: &str| text.lines().map(|line| line.trim_start().to_owned() + "\n").collect::<String>();
    let page = "docs/src/how-to/recognise.md";
    assert!(unindented(&read(page)).contains(&code), "{page}: the example has changed:\n{code}");
}

#[test]
fn the_rust_answers_of_results_readme_are_those_that_are_compiled() {
    let (page, example) = (read("results/README.md"), read("results/examples/questions.rs"));
    let answers: Vec<&str> = page
        .split("```rust\n")
        .skip(1)
        .filter_map(|text| text.split_once("```").map(|(code, _)| code))
        .collect();
    assert!(answers.len() >= 3, "results/README.md: at least three answers in Rust, got {}", answers.len());
    for answer in answers {
        assert!(example.contains(answer), "results/README.md: an answer has changed:\n{answer}");
    }
}

#[test]
fn documents_name_no_machine_and_committed_files_are_small() {
    let output = Command::new("git").args(["ls-files"]).current_dir(repository()).output().unwrap();
    let files = String::from_utf8(output.stdout).unwrap();
    assert!(files.lines().count() > 50, "git ls-files: {}", String::from_utf8_lossy(&output.stderr));
    for file in files.lines() {
        let path = repository().join(file);
        let Ok(metadata) = fs::metadata(&path) else { continue };
        assert!(metadata.len() < 1 << 20, "{file}: over 1 MiB");
        let Ok(text) = fs::read_to_string(&path) else { continue };
        for machine in [concat!("/wo", "rk/"), concat!("/ro", "ot/"), concat!("/ho", "me/")] {
            assert!(!text.contains(machine), "{file}: names a path of one machine, {machine}");
        }
    }
}

/// Outputs change from run to run, and show folders of whoever ran the notebook.
#[test]
fn notebooks_are_committed_without_outputs() {
    let files = tracked("*.ipynb");
    assert!(!files.is_empty());
    for file in files {
        let text = read(&file);
        let notebook: Value = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{file}: {error}"));
        for cell in notebook["cells"].as_array().unwrap() {
            let id = &cell["id"];
            assert!(
                cell["cell_type"] != "code"
                    || cell["outputs"] == Value::Array(Vec::new()) && cell["execution_count"].is_null(),
                "{file}: cell {id} must have no outputs and no number: clear all outputs"
            );
            assert_eq!(cell["metadata"], serde_json::json!({}), "{file}: cell {id} must have no metadata");
        }
        for machine in ["/tmp/", "/Users/", "C:\\\\"] {
            assert!(!text.contains(machine), "{file}: names a path of one machine, {machine}");
        }
    }
}

#[test]
fn who_is_believed_is_said_with_tests_that_exist() {
    let page = read("docs/src/explanation/trust.md");
    let names: Vec<&str> = page.split('`').filter(|name| name.matches('_').count() > 2).collect();
    assert!(names.len() > 8, "{names:?}");
    let sources: Vec<String> = sources().iter().map(|path| read(path)).collect();
    for name in names {
        let is_it = |source: &String| source.contains(&format!("fn {name}("));
        assert!(sources.iter().any(is_it), "docs/src/explanation/trust.md: {name} is no test");
    }
}

#[test]
fn cargo_metadata_has_no_duplicate_binary_names() {
    let metadata: Value =
        serde_json::from_str(&cargo(&["metadata", "--no-deps", "--format-version", "1"])).unwrap();
    let mut names = BTreeSet::new();
    for package in metadata["packages"].as_array().unwrap() {
        for target in package["targets"].as_array().unwrap() {
            if target["kind"][0] == "bin" {
                let name = target["name"].as_str().unwrap();
                assert!(
                    names.insert(name.to_owned()),
                    "two programs are called {name}: `--bin {name}` is ambiguous"
                );
            }
        }
    }
    assert!(names.contains("coordinator") && names.contains("worker"));
}

/// cargo-fuzz has a binary a target, and a manifest that nothing else reads.
#[test]
fn every_reader_of_bytes_from_outside_is_a_target_of_cargo_fuzz() {
    let folder = tempfile::TempDir::new().unwrap();
    let readers = tests::readers::all(folder.path().to_owned());
    let readers: BTreeSet<String> = readers.iter().map(|reader| reader.name.replace(' ', "-")).collect();
    let manifest = manifest("tests/cargo-fuzz/Cargo.toml");
    let names =
        manifest["bin"].as_array().unwrap().iter().map(|bin| bin["name"].as_str().unwrap().to_owned());
    assert_eq!(names.collect::<BTreeSet<_>>(), readers);
}
