//! Man pages and completions of both programs under the names that they have once installed.

use std::io;
use std::path::PathBuf;

use clap::Command;
use clap_complete::{Shell, generate};
use clap_mangen::Man;
use worker::names::Names;

/// What packages contain of it: paths, relative to a folder, and contents.
pub type Files = Vec<(PathBuf, Vec<u8>)>;

/// The command lines of programs that are built from this commit.
pub fn commands(commit: &str) -> [Command; 2] {
    let names = Names::Installed;
    [coordinator::cli::command(names, commit), worker::cli::command(names, commit)]
}

/// All files; pages show the date, as in 2026-11-26.
///
/// # Errors
/// If a page cannot be rendered.
pub fn files(commit: &str, date: &str) -> io::Result<Files> {
    let mut files = Files::new();
    for mut command in commands(commit) {
        let mut documented = without_help(command.clone());
        documented.build();
        add_pages(&documented, date, &mut files)?;
        let name = command.get_name().to_owned();
        for (shell, path) in [
            (Shell::Bash, format!("bash/{name}")),
            (Shell::Zsh, format!("zsh/_{name}")),
            (Shell::Fish, format!("fish/{name}.fish")),
        ] {
            let mut script = Vec::new();
            generate(shell, &mut command, &name, &mut script);
            files.push((path.into(), script));
        }
    }
    files.sort();
    Ok(files)
}

/// A command line whose `help` has no pages: it shows those that are there.
fn without_help(command: Command) -> Command {
    command.disable_help_subcommand(true).mut_subcommands(without_help)
}

/// The page of a command and those of its subcommands: `descry-run.1`.
fn add_pages(command: &Command, date: &str, files: &mut Files) -> io::Result<()> {
    let release = concat!("Descry ", env!("CARGO_PKG_VERSION"));
    let man = Man::new(command.clone()).date(date).source(release).manual("Descry");
    let mut page = Vec::new();
    man.render(&mut page)?;
    files.push((PathBuf::from("man1").join(man.get_filename()), page));
    command.get_subcommands().try_for_each(|subcommand| add_pages(subcommand, date, files))
}
