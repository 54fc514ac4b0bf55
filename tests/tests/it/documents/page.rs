//! A page of the documents: its commands and the output that it shows.

use super::output;
use super::shell::{Outcome, Transcript};

/// The line by which a page asks for a finished run of the demo.
const DEMO_FIRST: &str =
    "Before you start, run the demo: `coordinator run experiments/demo.toml --out results/runs/demo`.";

/// A page.
pub struct Page {
    /// Path, relative to the root of the repository.
    pub path: String,
    text: String,
    /// In the page's order.
    pub steps: Vec<Step>,
}

/// Something that happens when a page is followed.
pub struct Step {
    /// What it is.
    pub action: Action,
    /// Line of the page, from 0.
    line: usize,
    /// Lines of output that the page shows after it.
    output: std::ops::Range<usize>,
}

/// What a step does.
#[derive(Debug, PartialEq, Eq)]
pub enum Action {
    /// Runs a command to its end.
    Run(String),
    /// Starts a command that goes on beside those that follow.
    Start(String),
    /// Runs a command that the page does not show.
    Silent(String),
    /// Begins with the folders of a finished run of the demo.
    GivenDemo,
    /// Writes a file.
    Write { file: String, text: String },
}

/// A fenced block: its info string, the line of its fence and the lines inside.
struct Block<'a> {
    info: &'a str,
    line: usize,
    lines: Vec<&'a str>,
}

fn fenced(text: &str) -> Vec<Block<'_>> {
    let mut blocks: Vec<Block<'_>> = Vec::new();
    let mut is_open = false;
    for (line, content) in text.lines().enumerate() {
        match content.strip_prefix("```") {
            Some(_) if is_open => is_open = false,
            Some(info) => {
                is_open = true;
                blocks.push(Block { info, line, lines: Vec::new() });
            }
            None if is_open => blocks.last_mut().unwrap().lines.push(content),
            None => {}
        }
    }
    blocks
}

impl Page {
    /// Reads a page.
    pub fn parse(path: &str, text: &str) -> Self {
        let mut steps = Vec::new();
        for block in fenced(text) {
            if let Some(mode) = block.info.strip_prefix("console") {
                assert!(["", ",background"].contains(&mode), "{path}:{}: `{}`", block.line + 1, block.info);
                commands(&block, mode == ",background", &mut steps);
            } else if let Some(file) = block.lines.first().and_then(|line| named(line, block.info)) {
                let text = block.lines.join("\n") + "\n";
                let action = Action::Write { file: file.to_owned(), text };
                steps.push(Step { action, line: block.line, output: 0..0 });
            }
        }
        for (line, content) in text.lines().enumerate() {
            let silent = content.strip_prefix("<!-- run: ").and_then(|rest| rest.strip_suffix(" -->"));
            let action = match silent {
                Some(command) => Action::Silent(command.to_owned()),
                None if content == DEMO_FIRST => Action::GivenDemo,
                None => continue,
            };
            steps.push(Step { action, line, output: 0..0 });
        }
        steps.sort_by_key(|step| step.line);
        Self { path: path.to_owned(), text: text.to_owned(), steps }
    }

    /// Whether anything is to be run.
    pub fn has_commands(&self) -> bool {
        self.steps.iter().any(|step| matches!(step.action, Action::Run(_) | Action::Start(_)))
    }

    /// Line (from 1) and text of the blocks in a language.
    pub fn blocks(&self, language: &str) -> Vec<(usize, String)> {
        let blocks = fenced(&self.text).into_iter().filter(|block| block.info == language);
        blocks.map(|block| (block.line + 1, block.lines.join("\n") + "\n")).collect()
    }

    fn shown(&self, step: &Step) -> Vec<&str> {
        self.text.lines().skip(step.output.start).take(step.output.len()).collect()
    }

    fn is_as_shown(&self, step: &Step, outcome: &Outcome) -> bool {
        output::matches(&self.shown(step), &outcome.output.lines().collect::<Vec<_>>())
    }

    /// Where what happened is not what the page shows.
    pub fn differences(&self, transcript: &Transcript) -> Vec<String> {
        let mut faults = Vec::new();
        for (index, (step, outcome)) in self.steps.iter().zip(transcript).enumerate() {
            let (Action::Run(command) | Action::Start(command) | Action::Silent(command)) = &step.action
            else {
                continue;
            };
            let at = format!("{}:{}: {command}", self.path, step.line + 1);
            let Some(outcome) = outcome else {
                faults.push(format!("{at}\nwas not run to its end"));
                continue;
            };
            // Shown with its exit code, a command may fail.
            let next = self.steps.get(index + 1).map(|step| &step.action);
            let may_fail = matches!(next, Some(Action::Run(next)) if next == "echo $?");
            if outcome.code != 0 && !may_fail {
                faults.push(format!("{at}\nexit code {}\n{}", outcome.code, outcome.output));
            } else if !matches!(step.action, Action::Silent(_)) && !self.is_as_shown(step, outcome) {
                let shown = self.shown(step).join("\n");
                faults.push(format!("{at}\n--- shown\n{shown}\n--- printed\n{}", outcome.output));
            }
        }
        faults
    }

    /// The page with the output of a transcript where it shows another.
    pub fn with_output(&self, transcript: &Transcript) -> String {
        let mut lines: Vec<&str> = self.text.lines().collect();
        for (step, outcome) in self.steps.iter().zip(transcript).rev() {
            let (Action::Run(_) | Action::Start(_), Some(outcome)) = (&step.action, outcome) else {
                continue;
            };
            if !self.is_as_shown(step, outcome) {
                lines.splice(step.output.clone(), outcome.output.lines());
            }
        }
        lines.join("\n") + "\n"
    }
}

/// The file that the first line of a block in some language names.
fn named<'a>(line: &'a str, language: &str) -> Option<&'a str> {
    let name = line.strip_prefix("# ")?;
    let end = match language {
        "toml" => ".toml",
        "python" => ".py",
        _ => return None,
    };
    (name.ends_with(end) && !name.contains([' ', '/'])).then_some(name)
}

fn commands(block: &Block<'_>, is_background: bool, steps: &mut Vec<Step>) {
    let first = block.line + 1;
    let mut lines = block.lines.iter().enumerate().peekable();
    while let Some((index, line)) = lines.next() {
        let Some(command) = line.strip_prefix("$ ") else {
            panic!("line {}: output without a command: {line}", first + index + 1);
        };
        let mut command = command.to_owned();
        while let Some((_, more)) = lines.next_if(|(_, line)| line.starts_with("> ")) {
            command = command + "\n" + &more[2..];
        }
        let begin = lines.peek().map_or(block.lines.len(), |(next, _)| *next);
        while lines.next_if(|(_, line)| !line.starts_with("$ ")).is_some() {}
        let end = lines.peek().map_or(block.lines.len(), |(next, _)| *next);
        let action = if is_background { Action::Start(command) } else { Action::Run(command) };
        steps.push(Step { action, line: first + index, output: first + begin..first + end });
    }
}

/// Targets of the links and images of a page, outside of code.
pub fn links(text: &str) -> impl Iterator<Item = String> {
    let mut prose = String::new();
    let mut is_code = false;
    for line in text.lines() {
        if line.starts_with("```") {
            is_code = !is_code;
        } else if !is_code {
            // What stands between backticks is no link.
            prose.extend(line.split('`').step_by(2));
            prose.push('\n');
        }
    }
    let targets = prose.split("](").skip(1).filter_map(|rest| rest.split_once(')'));
    targets.map(|(target, _)| target.to_owned()).collect::<Vec<_>>().into_iter()
}

/// What links into a page may name, as GitHub and mdBook make it from headings.
pub fn anchors(text: &str) -> impl Iterator<Item = String> {
    text.lines().filter(|line| line.starts_with('#')).map(|line| {
        let heading = line.trim_start_matches('#').trim().to_lowercase();
        let kept = heading.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
        kept.map(|c| if c == ' ' { '-' } else { c }).collect()
    })
}
