//! Follows a page in a folder of its own, as a reader in a clone of the repository would.

use std::fs;
use std::path::Path;
use std::process::Command;

use super::page::{Action, Page};
use crate::experiments::{copy_folder, free_address, repository, run_demo};
use crate::process::{finish, program};
use tempfile::TempDir;

/// What came of a command.
pub struct Outcome {
    /// Standard output and standard error, as they came.
    pub output: String,
    /// Its exit code.
    pub code: i32,
}

/// The outcome of each step that is a command which ended.
pub type Transcript = Vec<Option<Outcome>>;

/// Stands in the shell's output where a command has ended, before its number and exit code.
const MARK: char = '\u{1e}';
/// Pages show commands as they are given on the machines that they speak of.
const HOST: (&str, &str) = ("gpu-host", "localhost");
const PORT: &str = ":7700";
/// Commands that await workers.
const LISTENERS: [&str; 4] =
    ["coordinator run", "coordinator resume", "coordinator compare", "coordinator exhaust"];
/// Commands that go on until they are told to stop.
const SERVERS: [&str; 2] = ["worker ", "coordinator dashboard "];
/// Far more than a page takes on a slow machine.
const LIMIT_SECONDS: &str = "900";

/// Follows a page.
pub fn transcript(page: &Page) -> Transcript {
    let folder = TempDir::new().unwrap();
    let clone = folder.path().join("clone");
    copy_folder(&repository().join("experiments"), &clone.join("experiments"));
    let port = free_address().rsplit_once(':').unwrap().1.to_owned();
    programs(folder.path(), &port);

    let mut script = String::from("exec 2>&1\n");
    let mut add = |line: String| script.extend([line, "\n".to_owned()]);
    let log = |index: usize| folder.path().join(format!("{index}.log")).display().to_string();
    let is_server = |command: &str| SERVERS.iter().any(|server| command.starts_with(server));
    // The commands that go on beside others.
    let mut started: Vec<(usize, &str)> = Vec::new();
    for (index, step) in page.steps.iter().enumerate() {
        match &step.action {
            Action::GivenDemo => copy_folder(&run_demo().folder().join("results"), &clone.join("results")),
            Action::Write { file, text } => {
                // Copied where the page has it: an earlier command may need what it replaces.
                let source = folder.path().join(format!("{index}.toml"));
                fs::write(&source, text).unwrap();
                add(format!("cp {} {file}", source.display()));
            }
            Action::Run(command) | Action::Silent(command) => {
                // There is one port for all coordinators of a page.
                if LISTENERS.iter().any(|listener| command.starts_with(listener)) {
                    let coordinators = started.iter().filter(|(_, command)| !is_server(command));
                    coordinators.for_each(|(index, _)| add(format!("wait $started_{index}")));
                }
                add(format!("{}\n{}; (exit $code)", here(command, &port), ended(index)));
            }
            Action::Start(command) => {
                add(format!("{} >{} 2>&1 & started_{index}=$!", here(command, &port), log(index)));
                started.push((index, command));
            }
        }
    }
    started.sort_by_key(|(_, command)| is_server(command));
    for (index, command) in started {
        if is_server(command) {
            let log = log(index);
            // What has said nothing yet may not know what to do when it is told.
            add(format!("while [ ! -s {log} ] && kill -0 $started_{index}; do sleep 0.05; done"));
            add(format!("kill -TERM $started_{index}"));
        }
        add(format!("wait $started_{index}\n{}; cat {}", ended(index), log(index)));
    }
    let file = folder.path().join("page.sh");
    fs::write(&file, script).unwrap();
    let mut bash = Command::new("timeout");
    bash.arg(LIMIT_SECONDS).arg("bash").arg(&file).current_dir(&clone);
    for (name, value) in program("coordinator").get_envs() {
        match value {
            Some(value) => bash.env(name, value),
            None => bash.env_remove(name),
        };
    }
    let path = std::env::var("PATH").unwrap_or_default();
    bash.env("PATH", format!("{}:{path}", folder.path().join("bin").display()));
    bash.env("HOME", folder.path()).env("COLUMNS", "100").env("LC_ALL", "C.UTF-8");
    let finished = finish(&mut bash);

    let mut transcript: Transcript = page.steps.iter().map(|_| None).collect();
    // Output, then what marks its end; of a command that went on beside others, the other way round.
    let mut parts = finished.stdout.split(MARK);
    let mut output = parts.next().unwrap_or_default();
    while let (Some(end), Some(next)) = (parts.next(), parts.next()) {
        let (index, code) = end.split_once(' ').unwrap();
        let index: usize = index.parse().unwrap();
        let is_beside = matches!(page.steps[index].action, Action::Start(_));
        let output =
            as_shown(if is_beside { next } else { std::mem::replace(&mut output, next) }, &clone, &port);
        transcript[index] = Some(Outcome { output, code: code.parse().unwrap() });
    }
    transcript
}

/// Marks the end of a command in the output.
fn ended(index: usize) -> String {
    format!("code=$?; printf '\\036%s %s\\036' {index} $code")
}

/// A command as it is given on this machine.
fn here(command: &str, port: &str) -> String {
    let command = command.replace("cargo run --release --bin coordinator --", "coordinator");
    // Nobody has to reach a page's dashboard or metrics, and another page may have their ports.
    let command = command.replace("0.0.0.0:7780", "127.0.0.1:0").replace("0.0.0.0:7790", "0.0.0.0:0");
    command.replace(HOST.0, HOST.1).replace(&format!("0.0.0.0{PORT}"), &format!("127.0.0.1:{port}"))
}

/// Output as the page's own machines would have it.
fn as_shown(output: &str, clone: &Path, port: &str) -> String {
    let clone = format!("{}/", fs::canonicalize(clone).unwrap().display());
    output.replace(&format!(":{port}"), PORT).replace(HOST.1, HOST.0).replace(&clone, "")
}

/// The programs under their own names, on a port that nobody else has.
fn programs(folder: &Path, port: &str) {
    fs::create_dir_all(folder.join("bin")).unwrap();
    let script = |name: &str, arguments: &str| {
        let path = folder.join("bin").join(name);
        let program = program(name).get_program().to_str().unwrap().to_owned();
        let text = format!("#!/bin/bash\n{arguments}exec -a {name} {program} \"$@\"\n");
        fs::write(&path, text).unwrap();
        assert!(Command::new("chmod").arg("+x").arg(path).status().unwrap().success());
    };
    script("worker", "");
    script(
        "coordinator",
        &format!(
            "case \" $* \" in\n*\" --help \"* | *\" --listen \"* | \" control \"*) ;;\n\
             \" run \"* | \" resume \"* | \" compare \"* | \" exhaust \"*) set -- \"$@\" --listen 127.0.0.1:{port} ;;\n\
             \" dashboard \"*) set -- \"$@\" --listen 127.0.0.1:0 ;;\n\
             \" certs \"*) set -- \"$@\" --port {port} ;;\nesac\n"
        ),
    );
}
