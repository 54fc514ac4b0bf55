//! Files that tell how a run went: missing, cut, changed, and looks that were added, changed and cut off.

use std::fs;
use std::path::Path;

use tempfile::{TempDir, tempdir};

use super::comparison::{DISTANCES, curves, pairs, perturbed, rows};
use super::fixture::{self, genes};
use super::tamper::{change, rewrite};
use crate::parquet::decode;
use crate::read::{run_file, table_files};
use crate::*;

/// Problems with a run folder, without its name.
fn problems(run: &Path) -> Vec<String> {
    let problems = verify(run).unwrap().problems;
    let text = |problem: &Problem| problem.to_string().replace(&run.display().to_string(), "FOLDER");
    problems.iter().map(text).collect()
}

/// A run of clouds of two sets.
fn run_of_sets() -> TempDir {
    let folder = tempdir().unwrap();
    let mut out = RunFolder::create(folder.path(), &genes()).unwrap();
    for number in 1..=2 {
        out.write_generation(&fixture::population(number), &fixture::generation(number)).unwrap();
    }
    for split in PredictionSplit::ALL {
        out.write_predictions(split, &fixture::predictions(split)).unwrap();
    }
    out.record_look(&fixture::look()).unwrap();
    out.write_skipped(&fixture::skipped()).unwrap();
    out.write_log(&fixture::log()).unwrap();
    let set = |set: &str| SetRow {
        descriptor: "evolved".to_owned(),
        set: set.to_owned(),
        weight: 1,
        counts: fixture::TEST,
        object_wilson: [0.0, 0.5],
        category_wilson: [0.0, 0.5],
    };
    out.write_sets(&[set("house"), set("office")]).unwrap();
    out.write_run(&fixture::run()).unwrap();
    folder
}

fn look(command: &str) -> LookRow {
    LookRow { command: command.to_owned(), ..fixture::look() }
}

/// Does something to a copy of the folder, and returns the problems that it has then.
fn after(run: &Path, damage: impl FnOnce(&Path)) -> Vec<String> {
    let copy = tempdir().unwrap();
    for table in fs::read_dir(run).unwrap().map(|entry| entry.unwrap()) {
        if table.path().is_dir() {
            let to = copy.path().join(table.file_name());
            fs::create_dir(&to).unwrap();
            for file in fs::read_dir(table.path()).unwrap().map(|entry| entry.unwrap()) {
                fs::copy(file.path(), to.join(file.file_name())).unwrap();
            }
        }
    }
    assert_eq!(problems(copy.path()), [""; 0]);
    damage(copy.path());
    problems(copy.path())
}

#[test]
fn each_file_that_is_missing_cut_or_changed_is_named() {
    let folder = run_of_sets();
    let run = folder.path();
    assert!(verify(run).unwrap().covers_log);
    let cells = [
        (TableName::Evaluations, "run_seconds"),
        (TableName::Generations, "seconds"),
        (TableName::Skipped, "reason"),
        (TableName::Workers, "build"),
        (TableName::Attempts, "reason"),
        (TableName::Events, "message"),
        (TableName::Sets, "set"),
        (TableName::Looks, "reason"),
    ];
    for (table, cell) in cells {
        let file = table_files(run, table).unwrap()[0].strip_prefix(run).unwrap().to_owned();
        let is_said = |what: &str, problems: Vec<String>| {
            let named = problems.iter().any(|problem| problem.contains(table.as_str()));
            assert!(named, "{table} {what}: {problems:?}");
        };
        is_said("missing", after(run, |run| fs::remove_file(run.join(&file)).unwrap()));
        is_said(
            "missing with its folder",
            after(run, |run| fs::remove_dir_all(run.join(table.as_str())).unwrap()),
        );
        is_said(
            "cut off",
            after(run, |run| {
                let bytes = fs::read(run.join(&file)).unwrap();
                fs::write(run.join(&file), &bytes[..bytes.len() / 2]).unwrap();
            }),
        );
        is_said("changed", after(run, |run| change(&run.join(&file), table, cell, 0, false)));
        is_said(
            "without a row",
            after(run, |run| {
                rewrite(&run.join(&file), table, |content| content.frame = content.frame.slice(1, 9));
            }),
        );
        is_said(
            "of a second file",
            after(run, |run| {
                fs::copy(run.join(&file), run.join(&file).with_file_name("look-00007.parquet"))
                    .map(drop)
                    .unwrap();
            }),
        );
        is_said(
            "a folder",
            after(run, |run| {
                fs::remove_file(run.join(&file)).unwrap();
                fs::create_dir(run.join(&file)).unwrap();
            }),
        );
    }
    let row = after(run, |run| change(&run_file(run).unwrap(), TableName::Run, "host", 0, false));
    assert!(row.len() == 1 && row[0].starts_with("run: digest of its row: expected "), "{row:?}");
}

#[test]
fn looks_are_a_chain() {
    let folder = run_of_sets();
    let run = folder.path();
    let out = RunFolder::create(run, &genes()).unwrap();
    for command in ["compare", "compare --perturb noise", "compare again"] {
        out.record_look(&look(command)).unwrap();
    }
    drop(out);
    assert_eq!(problems(run), [""; 0]);
    let file = |run: &Path, number: u32| run.join(format!("looks/look-{number:05}.parquet"));
    let further = |run: &Path| RunFolder::create(run, &genes()).unwrap().record_look(&look("later")).unwrap();
    for number in 1..=4 {
        for is_there_more in [false, true] {
            let what = format!("look {number}, further {is_there_more}");
            let more = |run: &Path| {
                if is_there_more {
                    further(run)
                }
            };
            let gone = after(run, |run| {
                fs::remove_file(file(run, number)).unwrap();
                more(run);
            });
            let changed = after(run, |run| {
                change(&file(run, number), TableName::Looks, "reason", 0, false);
                more(run);
            });
            for problems in [gone, changed] {
                assert!(problems.iter().any(|problem| problem.contains("looks")), "{what}: {problems:?}");
            }
        }
    }
    let all = after(run, |run| fs::remove_dir_all(run.join("looks")).unwrap());
    assert!(all.len() == 1 && all[0].starts_with("looks: head of their chain: "), "{all:?}");
    for head in [None, Some(""), Some("00"), Some(&"0".repeat(64)[..])] {
        for is_there_more in [false, true] {
            let problems = after(run, |run| {
                let path = run.join("looks/head");
                head.map_or_else(|| fs::remove_file(&path), |head| fs::write(&path, head)).unwrap();
                if is_there_more {
                    further(run);
                }
            });
            assert!(problems.iter().any(|problem| problem.contains("looks")), "{head:?}: {problems:?}");
        }
    }
    // The last with the head that stood before it: all of the end was rewritten, which shows in nothing.
    let value = |run: &Path| fs::read_to_string(run.join("looks/head")).unwrap();
    let last = fs::read(file(run, 4)).unwrap();
    let told = decode(last, TableName::Looks, &file(run, 4)).unwrap().text("chain").unwrap().to_owned();
    assert_ne!(value(run).trim(), told);
}

/// As if the process had ended between a look and its head.
#[test]
fn a_head_that_is_one_look_behind_is_moved_by_the_next() {
    let folder = run_of_sets();
    let run = folder.path();
    let head = fs::read(run.join("looks/head")).unwrap();
    let out = RunFolder::create(run, &genes()).unwrap();
    out.record_look(&look("compare")).unwrap();
    fs::write(run.join("looks/head"), &head).unwrap();
    assert_eq!(problems(run), [""; 0]);
    out.record_look(&look("compare")).unwrap();
    assert_eq!(problems(run), [""; 0]);
    // Two behind is none that a process leaves.
    fs::write(run.join("looks/head"), &head).unwrap();
    assert_eq!(problems(run).len(), 1);
    // Nor is one after which the look before was changed.
    let folder = tempdir().unwrap();
    let out = RunFolder::create(folder.path(), &genes()).unwrap();
    out.record_look(&look("run")).unwrap();
    fs::remove_file(folder.path().join("looks/head")).unwrap();
    out.record_look(&look("run")).unwrap();
    drop(out);
    assert_eq!(table_files(folder.path(), TableName::Looks).unwrap().len(), 2);
}

/// A run as an earlier build has left it: no such digest, no chain, no head.
#[test]
fn runs_of_earlier_builds_are_sound_without_and_their_looks_are_chained_from_the_next_on() {
    let folder = run_of_sets();
    let run = folder.path();
    rewrite(&run_file(run).unwrap(), TableName::Run, |content| {
        for column in
            ["evaluations", "generations", "skipped", "workers", "attempts", "events", "sets", "looks", "row"]
        {
            content.frame = content.frame.drop(&format!("{column}_digest")).unwrap();
        }
    });
    let look_1 = run.join("looks/look-00001.parquet");
    rewrite(&look_1, TableName::Looks, |content| content.frame = content.frame.drop("chain").unwrap());
    fs::remove_file(run.join("looks/head")).unwrap();
    let verification = verify(run).unwrap();
    assert!(verification.is_intact() && !verification.covers_log, "{:?}", verification.problems);

    let out = RunFolder::create(run, &genes()).unwrap();
    out.record_look(&look("compare")).unwrap();
    out.record_look(&look("compare")).unwrap();
    drop(out);
    let verification = verify(run).unwrap();
    assert!(verification.is_intact() && !verification.covers_log, "{:?}", verification.problems);
    for number in 1..=3 {
        let path = format!("looks/look-{number:05}.parquet");
        assert_eq!(after(run, |run| fs::remove_file(run.join(&path)).unwrap()).len(), 1, "{number}");
    }
    assert_eq!(
        after(run, |run| change(&run.join("looks/look-00001.parquet"), TableName::Looks, "reason", 0, false))
            .len(),
        1
    );
}

/// A run with a comparison of two descriptors.
fn compared() -> TempDir {
    let folder = run_of_sets();
    let out = RunFolder::create(folder.path(), &genes()).unwrap();
    out.begin_comparison().unwrap();
    for label in ["evolved", "pfhrgb-l1"] {
        let answers = fixture::predictions(PredictionSplit::Test);
        out.write_compared(label, &answers, &curves(), &DISTANCES).unwrap();
    }
    out.write_comparison(&rows(), &pairs()).unwrap();
    out.write_perturbed(&perturbed()).unwrap();
    folder
}

#[test]
fn each_file_of_a_comparison_that_is_missing_or_changed_is_named_also_after_it_was_extended() {
    let folder = compared();
    let run = folder.path();
    assert_eq!(problems(run), [""; 0]);
    let extend = |run: &Path| {
        let out = RunFolder::create(run, &genes()).unwrap();
        out.extend_comparison(&["evolved", "pfhrgb-l1"]).unwrap();
        out.write_compared("shotcolor-l1", &[], &[], &DISTANCES).unwrap();
    };
    assert_eq!(after(run, extend), [""; 0]);
    for (table, cell) in [
        (TableName::Distances, "distance"),
        (TableName::Answers, "cloud"),
        (TableName::RecallPrecision, "curve"),
        (TableName::Pairs, "level"),
        (TableName::Comparison, "descriptor"),
        (TableName::Perturbed, "kind"),
    ] {
        let file = table_files(run, table).unwrap()[0].strip_prefix(run).unwrap().to_owned();
        for extended in [false, true] {
            let gone = after(run, |run| {
                fs::remove_file(run.join(&file)).unwrap();
                if extended {
                    extend(run);
                }
            });
            let changed = after(run, |run| {
                change(&run.join(&file), table, cell, 0, false);
                if extended {
                    extend(run);
                }
            });
            for problems in [gone, changed] {
                assert!(
                    problems.iter().any(|problem| problem.contains(table.as_str())),
                    "{table}: {problems:?}"
                );
            }
        }
    }
    // That of one set of clouds has checksums of its own.
    let of_set = |spoil: fn(&Path)| {
        after(run, |run| {
            let set = run.join("sets/lab");
            for table in ["comparison", "pairs"] {
                fs::create_dir_all(set.join(table)).unwrap();
                for file in fs::read_dir(run.join(table)).unwrap().map(|entry| entry.unwrap().path()) {
                    fs::copy(&file, set.join(table).join(file.file_name().unwrap())).unwrap();
                }
            }
            let sums = fs::read_to_string(set.join("comparison/b3sums")).unwrap();
            let there = sums
                .lines()
                .filter(|line| ["comparison/", "pairs/"].iter().any(|table| line.contains(table)));
            fs::write(
                set.join("comparison/b3sums"),
                there.map(|line| format!("{line}\n")).collect::<String>(),
            )
            .unwrap();
            spoil(&set);
        })
    };
    assert_eq!(of_set(|_| {}), [""; 0]);
    let gone = of_set(|set| fs::remove_file(set.join("pairs/pairs.parquet")).unwrap());
    assert!(gone.len() == 1 && gone[0].contains("sets/lab/pairs/pairs.parquet"), "{gone:?}");
    let without = after(run, |run| fs::remove_file(run.join("comparison/b3sums")).unwrap());
    assert!(
        without.len() == 1 && without[0].contains("comparison/b3sums: not as it was written: it is missing")
    );
    for line in ["nonsense", "00  ../../etc/passwd", "00  comparison/../run.parquet"] {
        assert_eq!(
            after(run, |run| fs::write(run.join("comparison/b3sums"), line).unwrap()).len(),
            1,
            "{line}"
        );
    }
    // Begun anew, and not finished.
    assert_eq!(
        after(run, |run| RunFolder::create(run, &genes()).unwrap().begin_comparison().unwrap()),
        [""; 0]
    );
}
