//! Coordinators that are killed and started again: nothing that was accepted is lost, nothing is computed twice.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;
use std::time::Duration;
use std::{fs, thread};

use descriptor::random;
use rand::RngExt as _;

use crate::experiments::{Experiment, begun, digest, free_address, summary};
use crate::process::{Finished, Running, finish, kill_at, program, run};

/// Long enough to be killed many times, short enough to run often.
const SEARCH: &str = "[ga]\npopulation = 8\n[stop]\ngenerations = 60\nstagnation = \"off\"\n\
    validation_patience = \"off\"\n";

/// Newcomers only are audited, and one worker alone by nobody.
const NO_AUDIT: &str = "[coordinator]\naudit = 0\n";

const JOURNAL: &str = "journal.log";

/// A run of one in-process worker, killed after its second generation.
fn killed(experiment: &Experiment, out: &str) {
    let args = experiment.run_args(out, &["--local-workers", "1"]);
    kill_at("coordinator", args, "generation 2/60");
}

#[test]
fn a_coordinator_killed_at_any_moment_goes_on_and_its_worker_computes_no_job_twice() {
    const KILLS: u32 = 18;
    // More to evaluate than a worker comes to between the kills, however fast it is: nothing is asked twice at random.
    let search = SEARCH.replace("generations = 60", "generations = 200");
    let experiment = Experiment::new(&format!("[search]\nmethod = \"random\"\n{search}{NO_AUDIT}"));
    let undisturbed = experiment.run("undisturbed", &["--local-workers", "1"]).expect_success();

    let address = free_address();
    let args = experiment.run_args_at("out", &address);
    let mut worker = experiment.worker("steady", &address);
    let jobs = |log: &str| log.matches(": begun\n").count();
    let mut rng = random::stream(11, "moments of kills", &[]);
    for kill in 0..KILLS {
        let name = format!("start-{kill}");
        let before = jobs(&worker.log());
        let mut coordinator = Running::start(experiment.folder(), &name, "coordinator", args.clone());
        // Every third is killed while it starts, the others while their worker works.
        let longest = if kill % 3 == 0 { 250 } else { 80 };
        if kill % 3 > 0 {
            worker.wait_until("given a job", |log| jobs(log) > before + 2);
        }
        thread::sleep(Duration::from_millis(rng.random_range(0..longest)));
        assert!(coordinator.is_running(), "the fault came too late:\n{}", coordinator.log());
        coordinator.signal("KILL");
        assert_eq!(coordinator.wait().status.code(), None);
        assert!(worker.is_running(), "{}", worker.log());
    }
    let mut last = Running::start(experiment.folder(), "last", "coordinator", args.clone());
    let finished = last.wait().expect_success();
    assert_eq!(digest(&finished), digest(&undisturbed));
    assert!(!Path::new(&experiment.path("out")).join(JOURNAL).exists());

    // One worker and one session from the first start to the last; the winner is measured three times at the end, each of
    // three baselines once.
    worker.signal("TERM");
    let log = worker.wait().expect_success();
    assert_eq!(log.stderr.matches("joined as steady").count(), 1, "{log}");
    let begun = begun(&worker.log());
    let twice: Vec<_> = begun.iter().filter(|(_, times)| **times > 1).collect();
    assert!(twice.is_empty(), "{twice:?}\n{log}");
    assert_eq!(begun.len() as u64, summary(&finished)["evaluations_computed"].as_u64().unwrap() + 6);
    // The same command still serves: it shows the result.
    assert_eq!(digest(&run("coordinator", &args).expect_success()), digest(&undisturbed));
}

#[test]
fn a_coordinator_killed_under_several_workers_goes_on_with_all_of_them_and_tells_of_every_start() {
    /// Generations at which it is killed.
    const KILLS: [u32; 3] = [5, 20, 40];
    let experiment = Experiment::new(&format!("[search]\nmethod = \"random\"\n{SEARCH}{NO_AUDIT}"));
    let address = free_address();
    let args = experiment.run_args_at("out", &address);
    let names = ["one", "two", "three"];
    let mut workers = names.map(|name| experiment.worker(name, &address));
    for generation in KILLS {
        let name = format!("until-{generation}");
        let mut coordinator = Running::start(experiment.folder(), &name, "coordinator", args.clone());
        coordinator.wait_for(&format!("generation {generation}/60"));
        coordinator.signal("KILL");
        assert_eq!(coordinator.wait().status.code(), None, "the fault came too late");
    }
    let finished = Running::start(experiment.folder(), "last", "coordinator", args).wait().expect_success();
    let undisturbed = experiment.run("undisturbed", &["--local-workers", "1"]).expect_success();
    assert_eq!(digest(&finished), digest(&undisturbed));
    for (worker, name) in workers.iter_mut().zip(names) {
        worker.signal("TERM");
        let log = worker.wait().expect_success();
        assert_eq!(log.stderr.matches(&format!("joined as {name}")).count(), 1, "{log}");
    }

    // One row a worker, who was there from the first start to the last, and an answer to everything that was asked.
    let out = experiment.path("out");
    let rows = results::read_table(&out, results::TableName::Workers).unwrap();
    let named: BTreeSet<&str> = rows.column("worker").unwrap().str().unwrap().iter().flatten().collect();
    assert_eq!((rows.height(), named), (3, names.into()));
    let attempts = results::read_table(&out, results::TableName::Attempts).unwrap();
    let ends = attempts.column("end").unwrap().str().unwrap().clone();
    let jobs = attempts.column("job").unwrap().u64().unwrap().clone();
    let answers = jobs
        .iter()
        .zip(ends.iter())
        .filter(|(_, end)| end.is_some_and(|end| ["answered", "late"].contains(&end)));
    // A job that was given up and handed out again may have an answer of each.
    let answered = answers.map(|(job, _)| job).collect::<BTreeSet<_>>().len() as u64;
    // The winner is measured three times at the end, each of three baselines once. Where a kill comes between an answer and
    // its row, it is told by neither start: at most the two jobs that each worker holds.
    let asked = summary(&finished)["evaluations_computed"].as_u64().unwrap() + 6;
    let unsaid = (KILLS.len() * workers.len() * 2) as u64;
    assert!((asked - unsaid..=asked).contains(&answered), "{answered} of {asked}");
}

#[test]
fn a_run_with_workers_of_its_own_goes_on_by_resume_and_keeps_who_computed_what() {
    let experiment = Experiment::new(&format!("{SEARCH}{NO_AUDIT}"));
    let out = experiment.path("out");
    killed(&experiment, "out");
    let kept = fs::read(Path::new(&out).join("evaluations/generation-00002.parquet")).unwrap();
    let journal = Path::new(&out).join(JOURNAL);
    let unfinished = fs::read(&journal).unwrap();

    // While it runs, nobody else may write into its folder.
    let args = ["resume", &out, "--listen", "127.0.0.1:0", "--json"];
    let mut resumed = Running::start(experiment.folder(), "resumed", "coordinator", args);
    resumed.wait_for(": joined, ");
    let second = experiment.run("out", &[]).expect_error();
    assert!(second.stderr.contains("in use"), "{second}");
    for (signal, code) in [("INT", 130), ("TERM", 143)] {
        resumed.signal(signal);
        let interrupted = resumed.wait().expect_error();
        assert_eq!(interrupted.status.code(), Some(code), "{interrupted}");
        let advice = format!(
            "error: interrupted\ngo on: the same command again, or coordinator resume {out} with the same options"
        );
        assert!(interrupted.stderr.contains(&advice), "{interrupted}");
        resumed = Running::start(experiment.folder(), signal, "coordinator", args);
        resumed.wait_for("unfinished, goes on with");
    }
    let finished = resumed.wait().expect_success();
    // A generation that was whole is left alone.
    assert_eq!(fs::read(Path::new(&out).join("evaluations/generation-00002.parquet")).unwrap(), kept);
    run("coordinator", ["verify", &out]).expect_success();

    let undisturbed = experiment.run("undisturbed", &["--local-workers", "1"]).expect_success();
    assert_eq!(digest(&finished), digest(&undisturbed));
    for key in ["evaluations_computed", "evaluations_remembered", "generations"] {
        assert_eq!(summary(&finished)[key], summary(&undisturbed)[key], "{key}");
    }
    assert!(!journal.exists());
    // As if it had been killed between finishing the run and removing the journal.
    fs::write(&journal, unfinished).unwrap();
    let again = run("coordinator", args).expect_success();
    assert!(again.stderr.contains("this run is finished"), "{again}");
    assert_eq!(digest(&again), digest(&undisturbed));
    assert!(!journal.exists());
}

#[test]
fn a_run_whose_journal_is_damaged_goes_on_with_what_is_sound_to_the_same_digest() {
    let experiment = Experiment::new(SEARCH);
    killed(&experiment, "out");
    let journal = Path::new(&experiment.path("out")).join(JOURNAL);
    let whole = fs::read(&journal).unwrap();
    let undisturbed = experiment.run("undisturbed", &[]).expect_success();
    let page = |number: usize| {
        let mut bytes = whole.clone();
        bytes[number * 4096..][..4096].fill(0);
        assert_ne!(bytes, whole);
        bytes
    };
    let mut flipped = whole.clone();
    flipped[whole.len() - 100] ^= 1;
    let last = whole.len() / 4096 - 1;
    let cut = whole[..whole.len() - 1].to_vec();
    let damaged = [page(0), page(last), flipped, cut, b"".to_vec(), vec![7; 9000]];
    for (number, bytes) in damaged.into_iter().enumerate() {
        let name = format!("out-{number}");
        let (out, from) = (Path::new(&experiment.path(&name)).to_owned(), experiment.path("out"));
        assert!(Command::new("cp").args(["-r", &from]).arg(&out).status().unwrap().success());
        fs::write(out.join(JOURNAL), &bytes).unwrap();
        if number > 3 {
            // Nothing says any more what the experiment was.
            let refused = run("coordinator", ["resume", &experiment.path(&name)]).expect_error();
            assert!(refused.stderr.contains("journal.log: damaged, got "), "{refused}");
            assert!(refused.stderr.contains("go on by the command that has begun this run"), "{refused}");
            assert_eq!(fs::read(out.join(JOURNAL)).unwrap(), bytes);
        }
        let finished = experiment.run(&name, &[]).expect_success();
        assert_eq!(digest(&finished), digest(&undisturbed), "{number}");
        // Part of a record is what a process leaves that was killed while it wrote.
        let said = if number == 3 { "and is left out" } else { "journal.log: damaged: " };
        assert!(finished.stderr.contains(said), "{number}: {finished}");
        if number != 3 {
            assert_eq!(fs::read(out.join("journal.damaged-1")).unwrap(), bytes, "{number}");
        }
        run("coordinator", ["verify", &experiment.path(&name), "--sample", "4"]).expect_success();
    }
}

#[test]
fn a_journal_of_another_run_or_an_earlier_build_is_refused_and_left_as_it_is() {
    let experiment = Experiment::new(SEARCH);
    killed(&experiment, "out");
    let journal = Path::new(&experiment.path("out")).join(JOURNAL);
    let whole = fs::read(&journal).unwrap();
    // The journal of another search.
    let other = Experiment::new(&SEARCH.replace("population = 8", "population = 9"));
    killed(&other, "out");
    fs::copy(Path::new(&other.path("out")).join(JOURNAL), &journal).unwrap();
    let refused = experiment.run("out", &[]).expect_error();
    assert!(refused.stderr.contains("  - population = 9\n  + population = 8"), "{refused}");

    let earlier = journal.with_extension("redb");
    fs::rename(&journal, &earlier).unwrap();
    let out = experiment.path("out");
    for refused in [experiment.run("out", &[]), run("coordinator", ["resume", &out])] {
        let refused = refused.expect_error();
        assert!(refused.stderr.contains("journal.redb: version must be 3, got 2"), "{refused}");
    }
    fs::remove_file(&earlier).unwrap();

    fs::write(&journal, &whole).unwrap();
    let finished = experiment.run("out", &[]).expect_success();
    let undisturbed = experiment.run("undisturbed", &[]).expect_success();
    assert_eq!(digest(&finished), digest(&undisturbed));
}

/// A limit on the size of files stands in for a disk that fills up: what is written then is cut in the middle.
#[test]
fn a_disk_that_fills_up_ends_the_run_with_whole_tables_and_with_space_again_it_goes_on() {
    let experiment = Experiment::new(SEARCH);
    let mut limited = Command::new("sh");
    limited.args(["-c", "trap '' XFSZ; exec \"$@\"", "sh"]).arg(program("coordinator").get_program());
    limited.args(experiment.run_args("out", &["--local-workers", "1", "--no-cache"]));
    let mut running = Running::spawn(experiment.folder(), "full", limited);
    running.wait_for("generation 2/60");
    let process = running.id().to_string();
    let limit = Command::new("prlimit").args(["--pid", &process, "--fsize=65536"]).status();
    assert!(limit.unwrap().success(), "the fault came too late:\n{}", running.log());
    let full = running.wait().expect_error();
    assert!(full.stderr.contains("cannot be used, got I/O error: File too large"), "{full}");

    let finished = experiment.run("out", &[]).expect_success();
    assert!(finished.stderr.contains("unfinished, goes on with"), "{finished}");
    let undisturbed = experiment.run("undisturbed", &[]).expect_success();
    assert_eq!(digest(&finished), digest(&undisturbed));
}

/// Memory for no more than a few entries has most of what a run meets in files, before it is killed and after.
#[test]
fn a_run_that_outgrows_memory_has_the_digest_of_one_that_does_not() {
    let experiment = Experiment::new(SEARCH);
    let undisturbed = experiment.run("undisturbed", &[]).expect_success();
    let args = experiment.run_args("out", &["--local-workers", "1", "--no-cache"]);
    let spilling = |name: &str| {
        let mut coordinator = program("coordinator");
        coordinator.args(&args).env("DESCRY_SPILL_ABOVE", "500").env("DESCRY_LOG", "info");
        Running::spawn(experiment.folder(), name, coordinator)
    };
    let mut killed = spilling("killed");
    killed.wait_for("generation 2/60");
    killed.signal("KILL");
    killed.wait();
    assert!(
        killed.log().contains("more than 500 bytes of what the run meets go to a temporary file"),
        "{}",
        killed.log()
    );

    let mut last = spilling("last");
    let finished = last.wait().expect_success();
    assert!(finished.stderr.contains("of what the run meets go to a temporary file"), "{finished}");
    assert_eq!(digest(&finished), digest(&undisturbed));
    run("coordinator", ["verify", &experiment.path("out")]).expect_success();
    let files = |out: &str| {
        let entries = Path::new(&experiment.path(out)).read_dir().unwrap();
        entries.map(|entry| entry.unwrap().file_name()).collect::<BTreeSet<_>>()
    };
    assert_eq!(files("out"), files("undisturbed"));

    let mut wrong = program("coordinator");
    wrong.args(experiment.run_args("wrong", &[])).env("DESCRY_SPILL_ABOVE", "8 MiB");
    let wrong = finish(&mut wrong).expect_error();
    assert!(wrong.stderr.contains("DESCRY_SPILL_ABOVE: a number of bytes expected, got 8 MiB"), "{wrong}");
}

#[test]
fn an_unfinished_run_of_other_clouds_is_refused() {
    let experiment = Experiment::with(&format!("version = 1\n[dataset]\nroot = \"data\"\n{SEARCH}"));
    let data = experiment.path("data");
    run("coordinator", ["synth", &data, "--objects", "6", "--views", "12"]).expect_success();
    killed(&experiment, "out");
    let list = Path::new(&data).join("test.txt");
    let text = fs::read_to_string(&list).unwrap();
    fs::write(&list, text.split_once('\n').unwrap().1).unwrap();
    let refused = experiment.run("out", &[]).expect_error();
    assert!(refused.stderr.contains("is a run of other clouds"), "{refused}");
    fs::write(&list, text).unwrap();
    experiment.run("out", &[]).expect_success();
}

#[test]
fn there_is_nothing_to_resume_where_no_run_is() {
    let experiment = Experiment::new(SEARCH);
    for folder in [experiment.path("nowhere"), experiment.path(".")] {
        let refused = run("coordinator", ["resume", &folder]).expect_error();
        assert_eq!(refused.status.code(), Some(1), "{refused}");
        assert!(refused.stderr.contains("holds no run to go on with\nname the folder"), "{refused}");
    }
}

#[test]
fn a_run_that_reaches_its_deadline_goes_on_at_the_next_start() {
    let experiment = Experiment::new(&format!("{SEARCH}[coordinator]\ndeadline_seconds = 1\n"));
    let late = |ended: Finished| {
        let late = ended.expect_error();
        assert_eq!(late.status.code(), Some(5), "{late}");
        assert!(late.stderr.contains("coordinator.deadline_seconds: reached"), "{late}");
    };
    // Nobody works.
    late(experiment.run("out", &["--local-workers", "0"]));
    let mut starts = 0;
    let finished = loop {
        starts += 1;
        assert!(starts < 200, "no start comes further than the one before");
        let ended = experiment.run("out", &["--local-workers", "1"]);
        if ended.status.success() {
            break ended;
        }
        late(ended);
    };
    let without = Experiment::new(SEARCH).run("out", &[]).expect_success();
    assert_eq!(digest(&finished), digest(&without));
}

#[test]
fn a_run_that_lost_its_last_worker_ends_with_a_code_of_its_own_and_goes_on() {
    let limits = "[coordinator]\nlease_seconds = 2\nworker_grace_seconds = 1\n";
    let experiment = Experiment::new(&format!("{SEARCH}{limits}"));
    let address = free_address();
    let args = experiment.run_args_at("out", &address);
    let mut coordinator = Running::start(experiment.folder(), "first", "coordinator", args.clone());
    let lonely = experiment.worker("lonely", &address);
    coordinator.wait_for("generation 2/60");
    drop(lonely);
    let ended = coordinator.wait().expect_error();
    assert_eq!(ended.status.code(), Some(3), "{ended}");
    assert!(ended.stderr.contains("start workers, then run the same command again"), "{ended}");

    let mut again = Running::start(experiment.folder(), "again", "coordinator", args);
    let _second = experiment.worker("second", &address);
    let finished = again.wait().expect_success();
    assert!(finished.stderr.contains("unfinished, goes on with"), "{finished}");
    let undisturbed = experiment.run("undisturbed", &[]).expect_success();
    assert_eq!(digest(&finished), digest(&undisturbed));
}

#[test]
fn a_run_whose_job_fails_for_good_ends_with_a_code_of_its_own_and_goes_on_when_the_cause_is_gone() {
    let experiment = Experiment::with(&format!("version = 1\n[dataset]\nroot = \"data\"\n{SEARCH}"));
    let data = experiment.path("data");
    run("coordinator", ["synth", &data, "--objects", "6", "--views", "12"]).expect_success();
    let address = free_address();
    let args = experiment.run_args_at("out", &address);
    let mut coordinator = Running::start(experiment.folder(), "first", "coordinator", args.clone());
    coordinator.wait_for("waiting for a worker");
    let list = fs::read_to_string(Path::new(&data).join("train1.txt")).unwrap();
    let cloud = Path::new(&data).join(list.lines().next().unwrap());
    let away = cloud.with_extension("away");
    fs::rename(&cloud, &away).unwrap();
    let _worker = experiment.worker("steady", &address);
    let ended = coordinator.wait().expect_error();
    assert_eq!(ended.status.code(), Some(4), "{ended}");
    assert!(ended.stderr.contains("failed 3 times, got\n  steady: data: "), "{ended}");

    fs::rename(&away, &cloud).unwrap();
    let mut again = Running::start(experiment.folder(), "again", "coordinator", args);
    let finished = again.wait().expect_success();
    let undisturbed = experiment.run("undisturbed", &[]).expect_success();
    assert_eq!(digest(&finished), digest(&undisturbed));
}
