//! What packages contain beside the programs: names, man pages, completions, services.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::Command;

use results::TableName;
use tempfile::TempDir;
use tests::manual;

use crate::experiments::{Experiment, copy_folder, repository, run_demo};
use crate::http::get;
use crate::process::{Finished, Running, finish, program, run};

/// The programs under the names that they have once installed.
struct Installed(TempDir);

impl Installed {
    fn new() -> Self {
        let folder = TempDir::new().unwrap();
        for (name, installed) in [("coordinator", "descry"), ("worker", "descry-worker")] {
            let built = program(name).get_program().to_owned();
            let there = folder.path().join(installed);
            // No symbolic link: a program asks the system where it is.
            fs::hard_link(&built, &there).or_else(|_| fs::copy(&built, &there).map(drop)).unwrap();
        }
        Self(folder)
    }

    fn program(&self, name: &str, args: &[&str]) -> Command {
        let mut command = Command::new(self.0.path().join(name));
        command.args(args).current_dir(self.0.path()).env("COLUMNS", "400");
        command
    }

    fn run(&self, name: &str, args: &[&str]) -> Finished {
        finish(&mut self.program(name, args))
    }
}

/// A command and all below it, as arguments.
fn commands(command: &clap::Command) -> Vec<Vec<String>> {
    let mut all = vec![Vec::new()];
    for subcommand in command.get_subcommands() {
        let name = subcommand.get_name().to_owned();
        all.extend(commands(subcommand).into_iter().map(|rest| [vec![name.clone()], rest].concat()));
    }
    all
}

fn read(path: &str) -> String {
    fs::read_to_string(repository().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

#[test]
fn a_version_names_the_program_its_commit_and_what_it_computes() {
    let what = format!("(commit unknown, evaluation version {})", descriptor::EVALUATION_VERSION);
    let release = env!("CARGO_PKG_VERSION");
    let installed = Installed::new();
    for (built, name) in [("coordinator", "descry"), ("worker", "descry-worker")] {
        assert_eq!(run(built, ["--version"]).expect_success().stdout, format!("{built} {release} {what}\n"));
        let version = installed.run(name, &["--version"]).expect_success().stdout;
        assert_eq!(version, format!("{name} {release} {what}\n"));
    }
}

#[test]
fn installed_programs_name_themselves_in_what_they_say_to_type() {
    let installed = Installed::new();
    let [coordinator, _] = manual::commands("1");
    let mut texts = vec![installed.run("descry-worker", &["--help"]).expect_success().stdout];
    for command in commands(&coordinator) {
        // `control` wants to know which run before an order.
        let mut args: Vec<&str> = command.iter().map(String::as_str).collect();
        if args.first() == Some(&"control") && args.len() > 1 {
            args.insert(1, "RUN");
        }
        args.push("--help");
        texts.push(installed.run("descry", &args).expect_success().stdout);
    }
    assert!(texts.len() > 22, "{}", texts.len());
    for text in &texts {
        assert!(text.contains("Example: descry"), "{text}");
        for built in ["coordinator run", "coordinator certs", "`coordinator ", ": worker --", "`worker`"] {
            assert!(!text.contains(built), "{built}: {text}");
        }
    }

    let refused = installed.run("descry", &["resume", "nothing"]).expect_error();
    assert!(refused.stderr.ends_with("or start one: descry run EXP.toml\n"), "{refused}");
    let refused = installed.run("descry-worker", &["--coordinator", "ftp://nowhere"]).expect_error();
    assert!(refused.stderr.contains("`descry certs`"), "{refused}");
    let made = installed.run("descry", &["certs", "tls", "--host", "localhost"]).expect_success();
    assert!(made.stderr.contains("tls/join: descry-worker --coordinator-file join\n"), "{made}");
    let line = installed.run("descry", &["join-command", "host", "--tls", "tls"]).expect_success().stdout;
    assert!(line.contains(" descry-worker -C ") && line.contains("exec ./descry-worker --"), "{line}");
}

#[test]
fn pages_of_installed_programs_say_what_can_be_typed_there() {
    let (installed, demo) = (Installed::new(), Experiment::with(""));
    copy_folder(run_demo().folder(), demo.folder());
    let run = demo.folder().join("results/runs/demo");
    fs::remove_dir_all(run.join(TableName::Comparison.as_str())).unwrap();
    let [run, page] = [run, demo.folder().join("page.html")].map(|path| path.display().to_string());

    let report = ["report", &run, "--out", &page];
    let mut built = program("coordinator");
    built.args(report);
    for (mut command, expected) in
        [(built, "coordinator compare RUN"), (installed.program("descry", &report), "descry compare RUN")]
    {
        finish(&mut command).expect_success();
        let written = fs::read_to_string(&page).unwrap();
        let found = written.split('>').filter_map(|text| text.split('<').next());
        let found: Vec<&str> = found.filter(|text| text.ends_with(" compare RUN")).collect();
        assert!(!found.is_empty() && found.iter().all(|text| *text == expected), "{found:?}");
    }

    let command = installed.program("descry", &["dashboard", &run, "--listen", "127.0.0.1:0"]);
    let mut dashboard = Running::spawn(demo.folder(), "dashboard", command);
    let line = dashboard.wait_for("dashboard: http://");
    let at = line.split("http://").nth(1).unwrap().trim_end_matches('/');
    let script = get(at, "/view-runs.js").text();
    assert!(
        script.contains("with descry run, for example descry run ") && !script.contains("coordinator run")
    );
}

#[test]
fn every_command_has_a_page_that_man_shows_without_a_warning() {
    let folder = TempDir::new().unwrap();
    let mut pages = BTreeSet::new();
    for (path, text) in manual::files("1", "2026-11-26").unwrap() {
        let Ok(name) = path.strip_prefix("man1") else { continue };
        let file = folder.path().join(name);
        fs::write(&file, &text).unwrap();
        pages.insert(name.display().to_string());
        let text = String::from_utf8(text).unwrap();
        assert!(text.contains(".SH SYNOPSIS") && text.contains("Example: descry"), "{}", name.display());
        if !is_there("man") {
            continue;
        }
        let mut man = Command::new("man");
        man.args(["--warnings", "-E", "UTF-8", "-l"])
            .arg(file)
            .envs([("LC_ALL", "C.UTF-8"), ("MANWIDTH", "100")]);
        let shown = finish(&mut man).expect_success();
        assert_eq!(shown.stderr, "", "{shown}");
        assert!(shown.stdout.lines().count() > 10, "{shown}");
    }
    let named = |command: clap::Command| -> Vec<String> {
        let name = command.get_name().to_owned();
        commands(&command)
            .into_iter()
            .map(|rest| [vec![name.clone()], rest].concat().join("-") + ".1")
            .collect()
    };
    let expected: BTreeSet<String> = manual::commands("1").into_iter().flat_map(named).collect();
    assert!(expected.len() > 25 && expected.contains("descry-control-pause.1"), "{expected:?}");
    assert_eq!(pages, expected);
}

fn is_there(program: &str) -> bool {
    Command::new(program).arg("--version").output().is_ok()
}

#[test]
fn a_shell_completes_commands_and_options() {
    let folder = TempDir::new().unwrap();
    for (path, text) in manual::files("1", "2026-11-26").unwrap() {
        let file = folder.path().join(&path);
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(file, text).unwrap();
    }
    for (name, words, expected) in [
        ("descry", "descry resu", "resume"),
        ("descry", "descry run --see", "--seed"),
        ("descry-worker", "descry-worker --coordinator-f", "--coordinator-file"),
    ] {
        // As bash would call what the script has registered.
        let script = "source \"$1\"; COMP_WORDS=($3); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); \
                      function=$(complete -p $2 | sed 's/.* -F \\([^ ]*\\).*/\\1/'); \
                      $function $2 \"${COMP_WORDS[-1]}\" \"${COMP_WORDS[-2]}\"; echo \"${COMPREPLY[@]}\"";
        let mut bash = Command::new("bash");
        bash.args(["-c", script, "bash"]).arg(folder.path().join("bash").join(name)).args([name, words]);
        assert_eq!(finish(&mut bash).expect_success().stdout, format!("{expected}\n"), "{words}");
    }
    for file in ["zsh/_descry", "zsh/_descry-worker", "fish/descry.fish", "fish/descry-worker.fish"] {
        let text = fs::read_to_string(folder.path().join(file)).unwrap();
        assert!(text.contains("cache-size"), "{file}");
    }
}

const UNITS: &str = "deploy/systemd";

/// The settings of a unit, in order.
fn settings(unit: &str) -> Vec<(String, String)> {
    let text = read(&format!("{UNITS}/{unit}"));
    let lines = text.lines().filter(|line| !line.starts_with(['#', '[']) && !line.is_empty());
    let setting =
        |line: &str| line.split_once('=').map(|(name, value)| (name.to_owned(), value.to_owned())).unwrap();
    lines.map(setting).collect()
}

fn values(settings: &[(String, String)], name: &str) -> Vec<String> {
    settings.iter().filter(|(key, _)| key == name).map(|(_, value)| value.clone()).collect()
}

const COORDINATOR: &str = "descry-coordinator@.service";
const WORKER: &str = "descry-worker@.service";

#[test]
fn services_call_the_programs_as_they_can_be_called() {
    let installed = Installed::new();
    for (unit, help) in [(COORDINATOR, vec!["run", "--help"]), (WORKER, vec!["--help"])] {
        let settings = settings(unit);
        let [start] = &values(&settings, "ExecStart")[..] else { panic!("{unit}: one ExecStart") };
        let program = Path::new(start.split(' ').next().unwrap()).file_name().unwrap().to_str().unwrap();
        let help = installed.run(program, &help).expect_success().stdout;
        let options = start.split(' ').filter(|word| word.starts_with("--"));
        assert!(options.clone().count() > 0, "{unit}: {start}");
        for option in options {
            assert!(help.contains(&format!("  {option}")), "{unit}: {option}: {help}");
        }
        // What is set in files must be what is passed on, and options that comments show must be there.
        let file = values(&settings, "EnvironmentFile").remove(0);
        let file = read(&format!("{UNITS}/{}", file.strip_prefix("-/etc/descry/").unwrap()));
        for line in file.lines().filter(|line| line.contains('=')) {
            let (name, options) = line.trim_start_matches('#').split_once('=').unwrap();
            assert!(start.ends_with(&format!(" ${name}")), "{unit}: {line}");
            for option in options.split(' ').filter(|word| word.starts_with("--")) {
                assert!(help.contains(&format!("  {option}")), "{unit}: {option}: {help}");
            }
        }
    }
}

#[test]
fn services_start_again_after_what_that_mends() {
    let page = read("docs/src/reference/exit-codes.md");
    let rows = page.lines().filter_map(|line| line.strip_prefix("| ")?.split_once(" |"));
    let codes: BTreeSet<u8> = rows.filter_map(|(code, _)| code.parse().ok()).collect();
    let settings = settings(COORDINATOR);
    let listed = |name: &str| -> BTreeSet<u8> {
        let values = values(&settings, name);
        values.iter().flat_map(|value| value.split(' ')).map(|code| code.parse().unwrap()).collect()
    };
    let (prevented, successes) = (listed("RestartPreventExitStatus"), listed("SuccessExitStatus"));
    assert_eq!(values(&settings, "Restart"), ["on-failure"]);
    let final_codes: BTreeSet<u8> = prevented.union(&successes).copied().collect();
    assert!(final_codes.is_subset(&codes), "{final_codes:?} {codes:?}");
    let restarting: Vec<u8> = codes.difference(&final_codes).copied().filter(|&code| code != 0).collect();
    assert_eq!(restarting, [3, 6], "a code of its own must be in one of the three lists of {COORDINATOR}");
}

/// What a unit may touch is a page's claim: neither may grow unnoticed.
#[test]
fn services_may_touch_little() {
    let hardening = |unit: &str| {
        let settings = settings(unit);
        let from = settings.iter().position(|(name, _)| name == "ProtectSystem").unwrap();
        settings[from..].to_vec()
    };
    assert_eq!(hardening(COORDINATOR), hardening(WORKER));
    if !is_there("systemd-analyze") {
        return;
    }
    for unit in [COORDINATOR, WORKER] {
        let mut analyze = Command::new("systemd-analyze");
        let file = repository().join(UNITS).join(unit);
        // 1.5 of 10.
        analyze.args(["security", "--no-pager", "--offline=true", "--threshold=15"]).arg(file);
        finish(&mut analyze).expect_success();
    }
}
