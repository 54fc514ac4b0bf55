//! Runs and artefacts that are signed, and what tells how a run went when somebody has changed it.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

use crate::experiments::Experiment;
use crate::process::{Finished, run};

const SEARCH: &str =
    "[ga]\npopulation = 4\n[stop]\ngenerations = 3\nstagnation = \"off\"\nvalidation_patience = \"off\"\n";

fn verify(folder: &str, key: &str) -> Finished {
    run("coordinator", ["verify", folder, "--sample", "2", "--key", key])
}

#[test]
fn a_signed_run_is_its_signers_as_long_as_nothing_in_it_is_changed() {
    let experiment = Experiment::new(SEARCH);
    let [key, other, out] = ["signer", "other", "out"].map(|name| experiment.path(name));
    let made = run("coordinator", ["keygen", &key]).expect_success();
    let public = made.stdout.trim().to_owned();
    assert_eq!(fs::metadata(&key).unwrap().permissions().mode() & 0o777, 0o600);
    let secret = fs::read_to_string(&key).unwrap().split_whitespace().nth(1).unwrap().to_owned();
    run("coordinator", ["keygen", &key]).expect_error();
    run("coordinator", ["keygen", &other]).expect_success();

    let refused = experiment.run("out", &["--sign-key", &experiment.path("none")]).expect_error();
    assert!(refused.stderr.contains("none: cannot be used"), "{refused}");
    assert!(!Path::new(&out).exists(), "before anything is spent");
    experiment.run("out", &[]).expect_success();
    let unsigned = verify(&out, &public);
    assert!(unsigned.stdout.contains("signature: cannot be read"), "{unsigned}");
    assert!(unsigned.stdout.contains("NOT sound"), "{unsigned}");
    let signed = experiment.run("out", &["--sign-key", &key]).expect_success();
    for given in [&public, &format!("{key}.pub")] {
        let sound = verify(&out, given).expect_success();
        assert!(sound.stdout.contains(&format!("signed by {public}")), "{sound}");
        assert!(!format!("{made}{signed}{sound}").contains(&secret));
    }
    let stranger = verify(&out, &format!("{other}.pub"));
    assert!(stranger.stdout.contains("must be by") && stranger.stdout.contains("NOT sound"), "{stranger}");

    // Each table that tells how it went.
    for table in ["workers", "attempts", "events", "skipped", "looks", "comparison"] {
        let file = fs::read_dir(format!("{out}/{table}")).unwrap().map(|entry| entry.unwrap().path());
        let file =
            file.into_iter().find(|path| path.extension().is_some_and(|end| end == "parquet")).unwrap();
        let whole = fs::read(&file).unwrap();
        fs::remove_file(&file).unwrap();
        let found = run("coordinator", ["verify", &out, "--sample", "0"]);
        assert!(found.stdout.contains(table) && found.stdout.contains("NOT sound"), "{table}: {found}");
        fs::write(&file, whole).unwrap();
    }
    verify(&out, &public).expect_success();
    // Looks and comparisons that follow leave the signature as it is.
    let args = ["compare", &out, "--no-times", "--descriptor", "paper", "--listen", "127.0.0.1:0"];
    run("coordinator", args).expect_success();
    verify(&out, &public).expect_success();
}

#[test]
fn a_signed_artefact_is_its_signers_as_long_as_nothing_in_it_is_changed() {
    let experiment = Experiment::new(SEARCH);
    let [key, out, artefact] = ["signer", "out", "artefact"].map(|name| experiment.path(name));
    run("coordinator", ["keygen", &key]).expect_success();
    let public = format!("{key}.pub");
    experiment.run("out", &[]).expect_success();
    for _ in 0..2 {
        // The second replaces the first.
        run("coordinator", ["export", &out, &artefact, "--sign-key", &key]).expect_success();
        let sound = verify(&artefact, &public).expect_success();
        assert!(sound.stdout.starts_with("sound: artefact, signed by "), "{sound}");
    }
    fs::write(format!("{artefact}/README.md"), "Trust me.").unwrap();
    let changed = verify(&artefact, &public);
    assert_eq!(changed.status.code(), Some(1), "{changed}");
    assert!(changed.stdout.contains("signature: is not of these files"), "{changed}");
    run("coordinator", ["export", &out, &artefact]).expect_success();
    assert!(verify(&artefact, &public).stdout.contains("signature: cannot be read"));
}
