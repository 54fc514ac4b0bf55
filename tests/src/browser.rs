//! A browser without a window, for the pages that programs write.

use std::path::Path;
use std::process::Command;

use crate::process::Running;

/// A page as the browser has it after its scripts have run.
pub struct Opened {
    /// The document.
    pub dom: String,
    /// What it has written to the console: errors, refused requests, messages of scripts.
    pub console: Vec<String>,
}

/// Opens a file in Chromium; `folder` takes its profile and logs. `None` if there is no Chromium and there need not be
/// (`DESCRY_REQUIRE_CHROMIUM` is not 1).
#[track_caller]
pub fn open(folder: &Path, page: &Path) -> Option<Opened> {
    if Command::new("chromium").arg("--version").output().is_err() {
        let required = std::env::var_os("DESCRY_REQUIRE_CHROMIUM").is_some_and(|value| value == "1");
        assert!(!required, "no program chromium");
        eprintln!("SKIPPED: no program chromium");
        return None;
    }
    let name = page.file_stem()?.to_string_lossy().into_owned();
    let mut command = Command::new("chromium");
    command.args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]);
    // Without a graphics processor clouds are drawn by software; its remarks on speed are none of the page's.
    command.arg("--enable-unsafe-swiftshader");
    command.args(["--disable-background-networking", "--disable-component-update", "--disable-sync"]);
    command.arg(format!("--user-data-dir={}", folder.join(format!("{name}-profile")).display()));
    // Waits until nothing is left to do, however long that takes by the clock.
    command.args(["--virtual-time-budget=30000", "--dump-dom", "--enable-logging=stderr", "--v=0"]);
    command.arg(format!("file://{}", page.display())).stdin(std::process::Stdio::null());
    let finished = Running::spawn(folder, &name, command).wait().expect_success();
    let of_page = |line: &&str| line.contains("CONSOLE") && !line.contains("GL Driver Message");
    let console = finished.stderr.lines().filter(of_page).map(str::to_owned);
    Some(Opened { console: console.collect(), dom: finished.stdout })
}
