//! The names under which people have the programs: `coordinator` and `worker` as they are built, `descry` and
//! `descry-worker` once installed, where a name must say whose it is.

use std::borrow::Cow;
use std::path::Path;
use std::sync::OnceLock;

use clap::Command;
use clap::builder::{Resettable, StyledStr};

/// Commands of the coordinator: with its name before them, they are something to type.
const COMMANDS: [&str; 23] = [
    "assess",
    "certs",
    "check",
    "compare",
    "control",
    "dashboard",
    "evaluate",
    "exhaust",
    "export",
    "join-command",
    "keygen",
    "learn",
    "prune",
    "query",
    "recognise",
    "report",
    "resume",
    "run",
    "schema",
    "split",
    "synth",
    "verify",
    "weigh",
];

/// What the programs are called.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Names {
    /// `coordinator` and `worker`.
    Built,
    /// `descry` and `descry-worker`.
    Installed,
}

impl Names {
    /// What whoever has started this process calls it.
    pub fn of_this_process() -> Self {
        static NAMES: OnceLock<Names> = OnceLock::new();
        *NAMES.get_or_init(|| std::env::args_os().next().map_or(Self::Built, |name| Self::of(name.as_ref())))
    }

    /// By the path of one of the programs.
    fn of(program: &Path) -> Self {
        let name = program.file_stem().unwrap_or_default();
        if name == Self::Installed.coordinator() || name == Self::Installed.worker() {
            Self::Installed
        } else {
            Self::Built
        }
    }

    /// The program that runs experiments.
    pub const fn coordinator(self) -> &'static str {
        match self {
            Self::Built => "coordinator",
            Self::Installed => "descry",
        }
    }

    /// The program for further machines.
    pub const fn worker(self) -> &'static str {
        match self {
            Self::Built => "worker",
            Self::Installed => "descry-worker",
        }
    }

    /// A text for people, which names the programs as they are built: what it says to type can be typed.
    ///
    /// Here and not where texts are written: they come from every crate, some from the other side, whose programs may have
    /// other names.
    pub fn in_text(self, text: &str) -> Cow<'_, str> {
        if self == Self::Built {
            return Cow::Borrowed(text);
        }
        let mut renamed = String::with_capacity(text.len());
        let mut rest = text;
        while let Some((at, built, installed)) = self.next_name(text, text.len() - rest.len()) {
            renamed.push_str(&text[text.len() - rest.len()..at]);
            renamed.push_str(installed);
            rest = &text[at + built.len()..];
        }
        renamed.push_str(rest);
        Cow::Owned(renamed)
    }

    /// The next command in a text: where, the program's name in it, and what it is called.
    fn next_name(self, text: &str, from: usize) -> Option<(usize, &'static str, &'static str)> {
        let found = [(Self::Built.coordinator(), self.coordinator()), (Self::Built.worker(), self.worker())]
            .into_iter()
            .filter_map(|(built, installed)| {
                let is_command =
                    |&(at, _): &(usize, &str)| is_typed(&text[..at], built, &text[at + built.len()..]);
                let (at, _) =
                    text[from..].match_indices(built).map(|(at, name)| (from + at, name)).find(is_command)?;
                Some((at, built, installed))
            });
        found.min_by_key(|(at, ..)| *at)
    }

    /// A command line with its help, under its name.
    pub fn in_command(self, command: Command) -> Command {
        if self == Self::Built {
            return command;
        }
        let renamed = |text: String| self.in_text(&text).into_owned();
        let texts = [
            command.get_about(),
            command.get_long_about(),
            command.get_after_help(),
            command.get_after_long_help(),
        ];
        let [about, long_about, after_help, after_long_help] =
            texts.map(|text| text.map(|text| renamed(text.to_string())));
        let shown = |text: Option<String>| Resettable::from(text.map(StyledStr::from));
        let command = command.mut_args(|argument| {
            let help = argument.get_help().map(|help| renamed(help.to_string()));
            let long_help = argument.get_long_help().map(|help| renamed(help.to_string()));
            argument.help(shown(help)).long_help(shown(long_help))
        });
        let command = command
            .about(shown(about))
            .long_about(shown(long_about))
            .after_help(shown(after_help))
            .after_long_help(shown(after_long_help));
        command.mut_subcommands(|subcommand| self.in_command(subcommand))
    }
}

/// Whether a program's name between these texts is something to type: in backquotes, or with a command or an option behind
/// it, and neither part of a path nor of another word.
fn is_typed(before: &str, name: &str, after: &str) -> bool {
    let is_word = |c: char| c.is_alphanumeric() || "-_./".contains(c);
    if before.chars().next_back().is_some_and(is_word) {
        return false;
    }
    if before.ends_with('`') && after.starts_with('`') {
        return true;
    }
    let Some(after) = after.strip_prefix(' ') else { return false };
    let command = after.split(|c: char| !c.is_ascii_lowercase() && c != '-').next().unwrap_or_default();
    let is_option = command.starts_with("--");
    is_option || name == Names::Built.coordinator() && COMMANDS.contains(&command)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_can_be_typed_is_renamed_and_nothing_else() {
        for (built, installed) in [
            (
                "go on: the same command again, or coordinator resume out with",
                "go on: the same command again, or descry resume out with",
            ),
            ("make one with `coordinator keygen`", "make one with `descry keygen`"),
            (
                "workers may join with: worker --coordinator http://a:1",
                "workers may join with: descry-worker --coordinator http://a:1",
            ),
            (
                "`coordinator certs DIR --worker NAME`, then worker --tls NAME",
                "`descry certs DIR --worker NAME`, then descry-worker --tls NAME",
            ),
            ("coordinator run a\ncoordinator run b", "descry run a\ndescry run b"),
            ("0 to wait for `worker`s of `coordinator`", "0 to wait for `descry-worker`s of `descry`"),
            ("start the coordinator with --tls", "start the coordinator with --tls"),
            ("a worker needs the coordinator, which runs", "a worker needs the coordinator, which runs"),
            (
                "results/coordinator run, test-coordinator run, coordinator running",
                "results/coordinator run, test-coordinator run, coordinator running",
            ),
            ("cargo build --release -p worker; or --worker", "cargo build --release -p worker; or --worker"),
            ("ä coordinator", "ä coordinator"),
            ("", ""),
        ] {
            assert_eq!(Names::Installed.in_text(built), installed);
            assert_eq!(Names::Built.in_text(built), built);
        }
    }

    #[test]
    fn a_program_is_called_what_it_was_started_as() {
        for (path, names) in [
            ("descry", Names::Installed),
            ("/usr/bin/descry", Names::Installed),
            ("./descry-worker", Names::Installed),
            ("target/release/coordinator", Names::Built),
            ("worker", Names::Built),
            ("descry/worker", Names::Built),
            ("", Names::Built),
        ] {
            assert_eq!(Names::of(path.as_ref()), names, "{path}");
        }
    }
}
