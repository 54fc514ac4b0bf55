//! `coordinator learn`: objects that are added to an artefact.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use crate::console::say;
use crate::export::{self, Sized};
use crate::lines::labelled;

use super::layout::{LayoutArgs, LayoutName};
use super::rejection::{count, folds_line, rate, reject_lines};

/// Add objects, or further clouds of objects, to an artefact of coordinator export, without the run
///
/// Example: coordinator learn objects new-clouds
#[derive(Debug, Args)]
#[command(
    after_help = "Exit code: 0 if clouds were added, also where others were skipped, 1 if none was: the artefact is then as it was."
)]
pub struct Learn {
    /// The folder that coordinator export has made, for example objects
    #[arg(value_name = "ARTEFACT")]
    artefact: PathBuf,
    /// Folder of the new clouds, for example new-clouds
    #[arg(value_name = "NEW")]
    new: PathBuf,
    #[command(flatten)]
    layout: LayoutArgs,
    /// Write another artefact and leave this one as it is, for example more-objects
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Share of the reference clouds whose answer may be rejected as unknown, 0 to 0.5, for example 0.01; by default the
    /// artefact's
    #[arg(long, value_name = "SHARE", value_parser = rate)]
    false_rejections: Option<f64>,
}

impl Learn {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let out = self.out.as_ref().unwrap_or(&self.artefact);
        let layout = self.layout.or(LayoutName::Folders);
        let added = export::learn(&self.artefact, &self.new, &layout, self.false_rejections, out)?;
        for (cloud, reason) in &added.skipped {
            say(format_args!("skipped {cloud}: {reason}"));
        }
        if added.ignored > 0 {
            say(format_args!(
                "ignored {} clouds with other names than <instance>_<video>_<frame>.pcd, .ply or _crop.png",
                added.ignored
            ));
        }
        let Sized { clouds, objects, values } = added.before;
        let new_objects = added.after.objects - objects;
        let (of, objects_added) = (count(added.clouds, "cloud"), count(added.objects, "object"));
        let told = format!("{of} of {objects_added}, {new_objects} of them new");
        let mut text = labelled("added", 14, &told);
        let told = format!(
            "{} of {}; before {clouds} of {objects}",
            count(added.after.clouds, "cloud"),
            count(added.after.objects, "object"),
        );
        text += &labelled("database", 14, &told);
        text += &labelled("recogniser", 14, &added.recogniser);
        if let (Some(before), Some(after)) = (values, added.after.values) {
            let told = format!(
                "{after} values a cloud, before {before}; the axes are learned anew: distances of before and after cannot \
                 be compared"
            );
            text += &labelled("projection", 14, &told);
        }
        text += &reject_lines(&added.reject);
        text += &folds_line(added.reject.folds);
        text += &format!("artefact      {}, {:.1} MB\n", out.display(), added.bytes as f64 / 1e6);
        super::print(&text)?;
        Ok(ExitCode::SUCCESS)
    }
}
