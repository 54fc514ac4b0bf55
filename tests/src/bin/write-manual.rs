//! Writes man pages and completions of both programs into a folder, for packages.

use std::fs;
use std::io;
use std::path::PathBuf;

use clap::Parser;

/// Write man pages (man1) and completions (bash, zsh, fish) into a folder
#[derive(Debug, Parser)]
struct Arguments {
    /// The folder, for example manual
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// The commit that the pages name, for example 8a079ccf2
    #[arg(long, default_value = worker::version::NO_COMMIT)]
    commit: String,
    /// The date that the pages show, for example 2026-11-26
    #[arg(long)]
    date: String,
}

fn main() -> io::Result<()> {
    let Arguments { folder, commit, date } = Arguments::parse();
    for (path, bytes) in tests::manual::files(&commit, &date)? {
        let path = folder.join(path);
        fs::create_dir_all(path.parent().unwrap_or(&folder))?;
        fs::write(path, bytes)?;
    }
    Ok(())
}
