//! `coordinator split`: lists of clouds for a data set that has none.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, ValueEnum};

use super::layout::{LayoutArgs, LayoutName};
use crate::console::say;
use crate::dataset::{Fold, Folds, Protocol, SPLITS};

/// Write the lists train1, train2, validation and test by a protocol of the field
///
/// The same clouds and seed give the same lists. No frame is in two of them: clouds whose bytes are those of another are
/// left out.
///
/// Example: coordinator split results/data/demo --out results/data/splits --protocol leave-sequence-out
#[derive(Debug, Args)]
pub struct Split {
    /// Folder that holds the clouds, for example my-objects
    #[arg(value_name = "DATA")]
    data: PathBuf,
    /// Folder to make, with one folder of lists for each fold, for example results/data/splits
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// What is held out for the test, for example leave-sequence-out
    #[arg(long, value_enum)]
    protocol: Held,
    /// Number of folds of k-fold, for example 5
    #[arg(long, value_name = "K", default_value_t = 5)]
    folds: u32,
    /// Seed of what is drawn, for example 7
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    layout: LayoutArgs,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Held {
    /// A third of each object's clouds, in the proportions of the paper's data set: one fold
    Paper,
    /// Each sequence in turn (in the uw layout the video), of all objects
    LeaveSequenceOut,
    /// One object of each category in turn: what is recognised is the category
    LeaveInstanceOut,
    /// Each of K equal parts in turn
    KFold,
}

impl Split {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let protocol = match self.protocol {
            Held::Paper => Protocol::Paper,
            Held::LeaveSequenceOut => Protocol::Sequences,
            Held::LeaveInstanceOut => Protocol::Instances,
            Held::KFold => Protocol::Folds(self.folds),
        };
        let layout = self.layout.or(LayoutName::Uw);
        let Folds { folds, ignored, copies, lone_categories } =
            protocol.folds(&self.data, &layout, self.seed)?;
        for (paths, what) in [
            (&ignored, "files whose names do not fit the layout are left out"),
            (&copies, "clouds are copies of others and left out"),
            (&lone_categories, "categories have one object only, which is never held out"),
        ] {
            if let Some(first) = paths.first() {
                say(format_args!("{} {what}, for example {first}", paths.len()));
            }
        }
        write_folds(&self.out, &folds)?;
        let mut text = String::new();
        for Fold { name, splits } in &folds {
            let counts: Vec<String> =
                SPLITS.iter().zip(splits).map(|(split, paths)| format!("{split} {}", paths.len())).collect();
            text.push_str(&format!("{}: {}\n", self.out.join(name).display(), counts.join(", ")));
        }
        super::print(&text)?;
        Ok(ExitCode::SUCCESS)
    }
}

/// Writes the lists of all folds into a new folder.
fn write_folds(out: &Path, folds: &[Fold]) -> anyhow::Result<()> {
    let failed = |error: io::Error| {
        let (out, advice) = (out.display(), "choose another --out, or check permissions and free space");
        anyhow::anyhow!("--out {out}: must be a folder that can be made, got {error}\n{advice}")
    };
    let parent = out.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    fs::create_dir_all(parent).and_then(|()| fs::create_dir(out)).map_err(failed)?;
    let write = |Fold { name, splits }: &Fold| {
        let folder = out.join(name);
        fs::create_dir(&folder)?;
        SPLITS.iter().zip(splits).try_for_each(|(split, paths)| {
            fs::write(folder.join(format!("{split}.txt")), paths.join("\n") + "\n")
        })
    };
    folds.iter().try_for_each(write).map_err(|error| {
        let _ = fs::remove_dir_all(out); // lists that are not whole look like lists
        failed(error)
    })
}
