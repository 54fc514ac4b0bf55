//! How other machines join: by the commands that `join-command` prints, and by a file that comes late and changes.

use std::fs;
use std::io::Read as _;
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::Command;
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

use crate::experiments::{Experiment, digest, free_address};
use crate::process::{PATIENCE, Running, finish, program, run};

const SHORT: &str = "[ga]\npopulation = 6\n[stop]\ngenerations = 3\nvalidation_patience = \"off\"\n";
const SEARCH: &str = "[ga]\npopulation = 8\n[stop]\ngenerations = 60\nstagnation = \"off\"\n\
    validation_patience = \"off\"\n[coordinator]\nlease_seconds = 2\n";

/// A machine that `ssh` reaches: a home folder on this one, where its commands are carried out by a shell.
fn other_machine(folder: &Path) -> String {
    let (home, ssh) = (folder.join("home"), folder.join("bin/ssh"));
    fs::create_dir_all(&home).unwrap();
    fs::create_dir_all(folder.join("bin")).unwrap();
    fs::write(&ssh, format!("#!/bin/sh\ncd '{}' && exec sh -c \"$2\"\n", home.display())).unwrap();
    fs::set_permissions(&ssh, fs::Permissions::from_mode(0o755)).unwrap();
    format!("{}:{}", folder.join("bin").display(), std::env::var("PATH").unwrap())
}

#[test]
fn the_line_for_ssh_brings_program_and_address_to_a_machine_and_starts_the_worker() {
    let experiment = Experiment::new(SHORT);
    let tls = experiment.path("tls it's"); // a name that a shell would take apart
    let port = free_address().rsplit(':').next().unwrap().to_owned();
    run("coordinator", ["certs", &tls, "--host", "127.0.0.1", "--port", &port]).expect_success();
    let line = run("coordinator", ["join-command", "lab-pc-3", "--tls", &tls]).expect_success().stdout;
    let token = fs::read_to_string(Path::new(&tls).join("token")).unwrap();
    assert!(!line.contains(token.trim()), "{line}");
    assert_eq!(line.lines().count(), 1, "{line}");

    let mut shell = Command::new("sh");
    shell.args(["-c", line.trim()]).env("PATH", other_machine(experiment.folder()));
    let mut worker = Running::spawn(experiment.folder(), "worker", shell);
    let listen = format!("127.0.0.1:{port}");
    let args = experiment.run_args_at("out", &listen);
    finish(program("coordinator").args(args).args(["--tls", &tls])).expect_success();
    let left = worker.wait().expect_success();
    assert!(left.stderr.contains("left: the run has ended"), "{left}");
    let join = experiment.folder().join("home/descry-worker/join");
    assert_eq!(fs::metadata(join).unwrap().permissions().mode() & 0o077, 0, "others can read the token");
}

#[test]
fn the_line_for_ssh_says_where_the_program_is_of_no_use() {
    let experiment = Experiment::new("");
    let args = ["join-command", "robot", "--coordinator", "http://127.0.0.1:7700"];
    let line = run("coordinator", args).expect_success().stdout;
    let path = other_machine(experiment.folder());
    let uname = experiment.folder().join("bin/uname");
    fs::write(&uname, "#!/bin/sh\necho Linux riscv64\n").unwrap();
    fs::set_permissions(&uname, fs::Permissions::from_mode(0o755)).unwrap();
    let mut shell = Command::new("sh");
    let refused = finish(shell.args(["-c", line.trim()]).env("PATH", path)).expect_error();
    assert!(refused.stderr.contains(", this machine is Linux riscv64"), "{refused}");
    assert!(!experiment.folder().join("home/descry-worker").exists());
}

/// An engine that starts the worker as a process, with what it was asked to mount at its place.
const ENGINE: &str = "echo \"$*\" >> \"$HERE/calls\"\n\
    [ \"$1\" = load ] && { echo 'Loaded image: localhost/descry:7'; exit; }\n\
    for word; do case $word in *:/run/descry/join:*) join=${word%%:*};; localhost/descry:7) image=$word;; esac; done\n\
    while [ \"$1\" != \"$image\" ]; do shift; done\n\
    [ \"$2 $3 $4 $5\" = 'worker --coordinator-file /run/descry/join --name' ] || exit 9\n\
    exec \"$WORKER\" --coordinator-file \"$join\" --name \"$6\"\n";

#[test]
fn the_line_for_a_container_brings_image_and_address_and_starts_one_that_may_do_nothing() {
    for engine in ["podman", "docker"] {
        let experiment = Experiment::new(SHORT);
        let tls = experiment.path("tls it's");
        let port = free_address().rsplit(':').next().unwrap().to_owned();
        run("coordinator", ["certs", &tls, "--host", "127.0.0.1", "--port", &port]).expect_success();
        let image = experiment.path("image of it.tar");
        fs::write(&image, "layers").unwrap();
        let args = ["join-command", "lab-pc-3", "--tls", &tls, "--container", engine, "--image", &image];
        let line = run("coordinator", args).expect_success().stdout;
        let token = fs::read_to_string(Path::new(&tls).join("token")).unwrap();
        assert!(!line.contains(token.trim()) && line.lines().count() == 1, "{line}");

        let path = other_machine(experiment.folder());
        let stand_in = experiment.folder().join("bin").join(engine);
        fs::write(&stand_in, format!("#!/bin/sh\nHERE='{}'\n{ENGINE}", experiment.folder().display()))
            .unwrap();
        fs::set_permissions(&stand_in, fs::Permissions::from_mode(0o755)).unwrap();
        let mut shell = Command::new("sh");
        shell.args(["-c", line.trim()]).env("PATH", path).env("WORKER", program("worker").get_program());
        shell.env("DESCRY_CACHE", experiment.path("cache"));
        let mut worker = Running::spawn(experiment.folder(), "worker", shell);
        let args = experiment.run_args_at("out", &format!("127.0.0.1:{port}"));
        finish(program("coordinator").args(args).args(["--tls", &tls])).expect_success();
        let left = worker.wait().expect_success();
        assert!(left.stderr.contains("left: the run has ended"), "{left}");

        let home = experiment.folder().join("home/descry-worker");
        assert_eq!(fs::read_to_string(home.join("image of it.tar")).unwrap(), "layers");
        let mode = fs::metadata(home.join("join")).unwrap().permissions().mode();
        assert_eq!(mode & 0o077, 0, "others can read the token");
        let calls = fs::read_to_string(experiment.folder().join("calls")).unwrap();
        assert!(!calls.contains(token.trim()), "{calls}");
        for option in ["--rm", "--read-only", "--cap-drop=ALL", "--security-opt=no-new-privileges"] {
            assert!(calls.lines().nth(1).unwrap().contains(option), "{calls}");
        }
        // The user of the image, or of the machine, must be able to read a file that is closed to others.
        let readable = if engine == "podman" { ":ro,z,U" } else { "--user " };
        assert!(calls.contains(readable), "{calls}");
    }
}

#[test]
fn join_command_refuses_what_would_show_a_secret_or_reach_nobody() {
    let experiment = Experiment::new("");
    let refused = |args: &[&str], text: &str| {
        let refused = run("coordinator", ["join-command"].iter().chain(args)).expect_error();
        assert!(refused.stderr.contains(text), "{refused}");
    };
    let tls = experiment.path("tls");
    refused(&["--tls", &tls, "lab-pc-3"], "join: ");
    let here = experiment.path("here");
    refused(&["--join-file", &here, "lab-pc-3"], "here: cannot be used");
    let line = run("coordinator", ["join-command", "--join-file", &here, "--over", "slurm"]);
    assert!(line.expect_success().stdout.contains(&format!("--coordinator-file {here} ")));
    run("coordinator", ["certs", &tls, "--host", "127.0.0.1"]).expect_success();
    refused(&["--tls", &tls], "HOST: which machines, got none");
    refused(
        &["--tls", &tls, "--over", "slurm", "lab-pc-3"],
        "HOST: Slurm chooses the machines, got lab-pc-3",
    );
    refused(&["--tls", &tls, "lab-pc-3", "--worker", &experiment.path("nothing")], "nothing: cannot be used");
    let contained = ["--container", "podman", "--image"];
    let nothing = experiment.path("nothing");
    refused(&[&["--tls", &tls, "lab-pc-3"], &contained[..], &[&nothing]].concat(), "nothing: cannot be used");
    let slurm = ["--tls", &tls, "--over", "slurm"];
    refused(
        &[&slurm[..], &contained, &[&tls]].concat(),
        "--container: Slurm starts the program, got an image",
    );
    let colon = experiment.path("here:now");
    fs::write(&colon, "http://127.0.0.1:7700\n").unwrap();
    let args = ["--join-file", &colon, "lab-pc-3"];
    refused(&[&args[..], &contained, &[&tls]].concat(), "must have no colon in its name, got here:now");
    let long =
        run("coordinator", ["join-command", "--tls", &tls, "--over", "slurm", "--minutes", "4294967295"]);
    assert_eq!(long.status.code(), Some(2), "its seconds would not be a number: {long}");
    let secret = fs::read_to_string(Path::new(&tls).join("join")).unwrap();
    refused(
        &["--coordinator", secret.trim(), "lab-pc-3"],
        "must be an address without secrets, got https://127.0.0.1:7700\n",
    );
}

#[test]
fn a_worker_waits_for_its_file_and_follows_a_coordinator_that_is_started_elsewhere() {
    let experiment = Experiment::new(SEARCH);
    let alone = experiment.run("alone", &[]).expect_success();
    let (join, cache) = (experiment.path("join"), experiment.path("cache"));
    let args = ["--coordinator-file", &join, "--name", "follower", "--threads", "1", "--cache", &cache];
    let mut worker = Running::start(experiment.folder(), "follower", "worker", args);
    worker.wait_for("join: is not there");

    let [first, second] = [free_address(), free_address()];
    let args = experiment.run_args_at("out", &first);
    let mut coordinator = Running::start(experiment.folder(), "first", "coordinator", args);
    fs::write(&join, format!("http://{first}\n")).unwrap();
    coordinator.wait_for("generation 2/60");
    coordinator.signal("KILL");
    assert_eq!(coordinator.wait().status.code(), None, "the fault came too late");

    let args = experiment.run_args_at("out", &second);
    let mut coordinator = Running::start(experiment.folder(), "second", "coordinator", args);
    fs::write(&join, format!("http://{second}\n")).unwrap();
    let finished = coordinator.wait().expect_success();
    assert_eq!(digest(&finished), digest(&alone));
    let left = worker.wait().expect_success();
    for address in [first, second] {
        let found = format!("looking for the coordinator at http://{address}");
        assert_eq!(left.stderr.matches(&found).count(), 1, "{left}");
    }
}

#[test]
fn a_worker_says_once_what_keeps_it_from_its_coordinator_and_again_when_that_changes() {
    let experiment = Experiment::new("");
    let [join, cache] = ["join", "cache"].map(|name| experiment.path(name));
    let args = ["--coordinator-file", &join, "--name", "waiting", "--threads", "1", "--cache", &cache];
    let mut worker = Running::start(experiment.folder(), "waiting", "worker", args);
    worker.wait_for("join: is not there");
    fs::write(&join, "http://nowhere.invalid:7700\n").unwrap();
    worker.wait_for("the host name nowhere.invalid cannot be resolved");

    // Hears what it is sent and hangs up; the third call comes when the second is dealt with.
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let (done, thrice) = mpsc::channel();
    thread::spawn(move || {
        for _ in 0..3 {
            let (mut stream, _) = listener.accept().unwrap();
            assert!(stream.read(&mut [0; 1 << 16]).unwrap() > 0);
        }
        drop(listener);
        done.send(()).unwrap();
    });
    fs::write(&join, format!("https://127.0.0.1:{port}#ca={}\n", "0".repeat(64))).unwrap();
    thrice.recv_timeout(PATIENCE).unwrap();
    worker.wait_for("Connection refused");
    worker.signal("TERM");
    let left = worker.wait().expect_success();
    let reasons = left.stderr.lines().filter_map(|line| line.split("coordinator out of reach: ").nth(1));
    let reasons: Vec<&str> = reasons.collect();
    let expected = ["is not there", "cannot be resolved", "it ended the TLS handshake", "Connection refused"];
    assert_eq!(reasons.len(), expected.len(), "{left}");
    for (reason, expected) in reasons.iter().zip(expected) {
        assert!(reason.contains(expected), "{expected}: {left}");
    }
}

/// What a worker says when it looks for a coordinator.
fn looked_at(worker: &str) -> Vec<String> {
    let addresses = worker.lines().filter_map(|line| line.split("looking for the coordinator at ").nth(1));
    addresses.map(str::to_owned).collect()
}

#[test]
fn a_coordinator_says_where_it_is_each_time_that_it_is_started() {
    let experiment = Experiment::new(SEARCH);
    let alone = experiment.run("alone", &[]).expect_success();
    let [tls, join, cache] = ["tls", "here", "cache"].map(|name| experiment.path(name));
    let name = transport::host_name();
    run("coordinator", ["certs", &tls, "--host", "elsewhere", "--host", &name]).expect_success();
    let args = ["--coordinator-file", &join, "--name", "follower", "--threads", "1", "--cache", &cache];
    let mut worker = Running::start(experiment.folder(), "follower", "worker", args);
    worker.wait_for("here: is not there");

    let start = |name: &str| {
        let mut args = experiment.run_args_at("out", "0.0.0.0:0");
        args.extend(["--tls", &tls, "--join-file", &join].map(str::to_owned));
        Running::start(experiment.folder(), name, "coordinator", args)
    };
    let mut first = start("first");
    first.wait_for(&format!("workers may join with: worker --coordinator-file {join}"));
    assert_eq!(fs::metadata(&join).unwrap().permissions().mode() & 0o077, 0, "others can read the token");
    first.wait_for("generation 2/60");
    first.signal("KILL");
    assert_eq!(first.wait().status.code(), None, "the fault came too late");
    let mut second = start("second");
    let finished = second.wait().expect_success();
    assert_eq!(digest(&finished), digest(&alone));
    let left = worker.wait().expect_success();
    let looked = looked_at(&left.stderr);
    let place = |address: &String| address.starts_with(&format!("https://{name}:"));
    assert!(looked.len() == 2 && looked.iter().all(place) && looked[0] != looked[1], "{left}");
    assert!(!finished.stderr.contains("warning: "), "{finished}");
}

#[test]
fn a_coordinator_that_cannot_say_where_it_is_does_not_start_and_one_without_a_certificate_for_it_warns() {
    let experiment = Experiment::new(SHORT);
    let [tls, join] = ["tls", "here"].map(|name| experiment.path(name));
    run("coordinator", ["certs", &tls, "--host", "elsewhere"]).expect_success();
    let nowhere = experiment.path("no/folder");
    let refused = experiment.run("out", &["--tls", &tls, "--join-file", &nowhere]).expect_error();
    assert!(
        refused.stderr.contains("--join-file ") && refused.stderr.contains("cannot be written"),
        "{refused}"
    );
    assert!(!experiment.folder().join("out").exists());

    let finished = experiment.run("out", &["--tls", &tls, "--join-file", &join]).expect_success();
    let warning = "here: names elsewhere, because the certificate is not for";
    assert!(finished.stderr.contains(warning), "{finished}");
    assert!(fs::read_to_string(&join).unwrap().starts_with("https://elsewhere:"));

    fs::remove_file(&join).unwrap();
    let plain = experiment.run("plain", &["--join-file", &join]).expect_success();
    let address = fs::read_to_string(&join).unwrap();
    assert!(address.starts_with("http://127.0.0.1:"), "{plain}");
    assert!(plain.stderr.contains(&format!("worker --coordinator {}", address.trim())), "{plain}");
}

/// Programs that do as Slurm's do, as far as the coordinator calls them; each notes its arguments in `calls`.
const SLURM: [(&str, &str); 4] = [
    (
        "sbatch",
        "case \"$*\" in *--test-only*) exit 0;; esac\n\
         for script; do :; done\n\
         for word; do case $word in --array=1-*) count=${word#--array=1-};; esac; done\n\
         for task in $(seq \"$count\"); do\n\
           sh \"$script\" > \"$HERE/worker-$task.log\" 2>&1 &\n\
           echo \"7_$task $!\" >> \"$HERE/jobs\"\n\
         done\n\
         echo 7\n",
    ),
    (
        "squeue",
        "[ -e \"$HERE/jobs\" ] || exit 0\n\
         while read -r job process; do\n\
           if kill -0 \"$process\" 2> /dev/null; then echo \"$job RUNNING\"; else echo \"$job COMPLETED\"; fi\n\
         done < \"$HERE/jobs\"\n",
    ),
    ("scancel", ""),
    ("srun", "shift; exec \"$@\"\n"),
];

/// A coordinator in a world where Slurm is these programs.
fn under_slurm(experiment: &Experiment, programs: &[(&str, &str)], out: &str, more: &[&str]) -> Command {
    let (bin, here) = (experiment.folder().join("slurm-bin"), experiment.folder());
    fs::create_dir_all(&bin).unwrap();
    for (name, script) in programs {
        let text =
            format!("#!/bin/sh\nHERE='{}'\necho \"{name} $*\" >> \"$HERE/calls\"\n{script}", here.display());
        fs::write(bin.join(name), text).unwrap();
        fs::set_permissions(bin.join(name), fs::Permissions::from_mode(0o755)).unwrap();
    }
    let mut coordinator = program("coordinator");
    coordinator.args(experiment.run_args_at(out, "0.0.0.0:0")).args(["--insecure", "--slurm-workers", "2"]);
    coordinator.args(["--slurm-threads", "1", "--join-file", &experiment.path("here")]).args(more);
    coordinator.env("DESCRY_CACHE", experiment.path("cache"));
    coordinator.env("PATH", format!("{}:{}", bin.display(), std::env::var("PATH").unwrap()));
    coordinator
}

#[test]
fn a_coordinator_asks_slurm_for_workers_and_cancels_those_that_wait_at_its_end() {
    let experiment = Experiment::new(SHORT);
    let alone = experiment.run("alone", &[]).expect_success();
    let more = ["--slurm-args", "--partition='two words' --nice"];
    let finished = finish(&mut under_slurm(&experiment, &SLURM, "out", &more)).expect_success();
    assert_eq!(digest(&finished), digest(&alone));
    assert!(finished.stderr.contains("Slurm: asked for 2 more workers, job 7; logs in "), "{finished}");
    for worker in ["worker-1.log", "worker-2.log"] {
        let log = || fs::read_to_string(experiment.folder().join(worker)).unwrap();
        let begun = Instant::now();
        while !log().contains("left: the run has ended") {
            assert!(begun.elapsed() < PATIENCE, "{}", log());
            thread::sleep(Duration::from_millis(20));
        }
    }
    let calls = fs::read_to_string(experiment.folder().join("calls")).unwrap();
    let calls: Vec<&str> = calls.lines().filter(|call| !call.starts_with("srun ")).collect();
    assert!(calls[0].starts_with("sbatch ") && calls[0].contains("--test-only"), "{calls:#?}");
    assert!(calls[1].starts_with("squeue "), "{calls:#?}");
    let words = ["--array=1-2 ", "--cpus-per-task=1 ", "--partition=two words --nice "];
    assert!(words.iter().all(|words| calls[2].contains(words)), "{calls:#?}");
    let last = calls.last().unwrap();
    assert!(last.starts_with("scancel --name=descry-") && last.ends_with(" --state=PENDING"), "{calls:#?}");
}

#[test]
fn a_coordinator_that_was_killed_finds_the_workers_that_it_has_asked_for() {
    let experiment = Experiment::new(SEARCH);
    let alone = experiment.run("alone", &[]).expect_success();
    let start = |name: &str| {
        let command = under_slurm(&experiment, &SLURM, "out", &[]);
        Running::spawn(experiment.folder(), name, command)
    };
    let mut first = start("first");
    first.wait_for("generation 2/60");
    first.signal("KILL");
    assert_eq!(first.wait().status.code(), None, "the fault came too late");
    let finished = start("second").wait().expect_success();
    assert_eq!(digest(&finished), digest(&alone));
    assert!(
        !finished.stderr.contains("Slurm: asked for"),
        "those that are there were not counted: {finished}"
    );
    let calls = fs::read_to_string(experiment.folder().join("calls")).unwrap();
    let names: std::collections::BTreeSet<&str> =
        calls.split_whitespace().filter(|word| word.starts_with("--name=")).collect();
    assert_eq!(names.len(), 1, "{calls}");
}

#[test]
fn what_slurm_would_not_do_is_said_before_anything_runs() {
    let experiment = Experiment::new(SHORT);
    let refused = |command: &mut Command, text: &str| {
        let refused = finish(command).expect_error();
        assert!(refused.stderr.contains(text), "{refused}");
    };
    let refuses = [("sbatch", "echo 'sbatch: error: invalid partition specified: nowhere' >&2; exit 1\n")];
    let mut coordinator = under_slurm(&experiment, &refuses, "out", &[]);
    refused(&mut coordinator, "Slurm refuses such jobs, got sbatch: error: invalid partition");
    let mut here = program("coordinator");
    let join = experiment.path("here");
    here.args(experiment.run_args("out", &["--slurm-workers", "2", "--join-file", &join]));
    refused(&mut here, "--slurm-workers: needs an address that other machines reach, got 127.0.0.1:");
    let open = ["--slurm-args", "--comment='open"];
    refused(&mut under_slurm(&experiment, &SLURM, "out", &open), "--slurm-args: must be words of a shell");
    let mut nowhere = under_slurm(&experiment, &[], "out", &[]);
    nowhere.env("PATH", experiment.folder());
    refused(&mut nowhere, "sbatch: cannot be started");
    assert!(!experiment.folder().join("out/run.parquet").exists());
}

#[test]
fn a_command_of_slurm_that_hangs_does_not_keep_a_run_from_ending() {
    let experiment = Experiment::new(SHORT);
    let alone = experiment.run("alone", &[]).expect_success();
    // It has started the workers when its controller goes away.
    let hangs = SLURM.map(|(name, script)| {
        let script = if name == "sbatch" {
            script.replace("echo 7\n", "exec sleep 3600\n")
        } else {
            script.to_owned()
        };
        (name, script)
    });
    let hangs: Vec<(&str, &str)> = hangs.iter().map(|(name, script)| (*name, &**script)).collect();
    let finished = finish(&mut under_slurm(&experiment, &hangs, "out", &[])).expect_success();
    assert_eq!(digest(&finished), digest(&alone));
    let calls = fs::read_to_string(experiment.folder().join("calls")).unwrap();
    assert!(calls.lines().last().unwrap().starts_with("scancel --name=descry-"), "{calls}");
}
