//! `coordinator export`: a run's descriptor as a folder of its own.

use std::path::PathBuf;
use std::process::ExitCode;

use artefact::{FALSE_REJECTIONS, FILES, read_structure};
use cache::StorageArgs;
use clap::{Args, ValueEnum};
use descriptor::recogniser::Method;
use worker::names::Names;

use crate::export::{self, DescriptorChoice};
use crate::lines::labelled;

use super::rejection::{rate, reject_lines};
use super::sign::{Sign, sign};

/// Take a finished run's descriptor away: a folder with which coordinator recognise names objects
///
/// Example: coordinator export results/runs/demo-0123456789ab objects
#[derive(Debug, Args)]
pub struct Export {
    /// The folder of a finished run, for example results/runs/demo-0123456789ab
    #[arg(value_name = "RUN")]
    run: PathBuf,
    /// The folder to be made, for example objects; an artefact that is there is replaced
    #[arg(value_name = "DIR")]
    out: PathBuf,
    /// Which descriptor, for example paper: the paper's best one, on the run's clouds
    #[arg(long, value_name = "NAME", default_value = "evolved")]
    descriptor: Which,
    /// File of a structure instead, on the run's clouds, for example experiments/descriptors/pfhrgb.toml
    #[arg(long, value_name = "TOML", conflicts_with = "descriptor")]
    structure: Option<PathBuf>,
    /// A point of the front of a run of several objectives instead, by its number, for example 3
    #[arg(long, value_name = "N", conflicts_with_all = ["descriptor", "structure"])]
    point: Option<u32>,
    /// How objects are named: nearest, the name of the nearest cloud; projection and kernel-ridge learn from the labels
    /// of the reference clouds, for example kernel-ridge. Settings are chosen inside these clouds. By default as the
    /// section recognition of the run's experiment says
    #[arg(long, value_name = "NAME", value_parser = Method::ALL.map(Method::name))]
    recogniser: Option<String>,
    /// Share of the reference clouds whose answer may be rejected as unknown, 0 to 0.5, for example 0.01; the bound is found
    /// inside these clouds [default: 0.05]
    #[arg(long, value_name = "SHARE", value_parser = rate)]
    false_rejections: Option<f64>,
    /// Take the clouds of this set, where the run's clouds are of several, for example kitchen
    #[arg(long, value_name = "NAME")]
    set: Option<String>,
    /// Another place of the data set, for example /data/rgbd; by default the one the run used
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    #[command(flatten)]
    sign: Sign,
    #[command(flatten)]
    storage: StorageArgs,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Which {
    Evolved,
    Paper,
}

impl Export {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let key = self.sign.key()?;
        let which = match (&self.structure, self.point, self.descriptor) {
            (Some(file), ..) => DescriptorChoice::Structure(read_structure(file)?),
            (_, Some(point), _) => DescriptorChoice::Point(point),
            (.., Which::Evolved) => DescriptorChoice::Evolved,
            (.., Which::Paper) => DescriptorChoice::Paper,
        };
        let storage = self.storage.resolve();
        let recogniser = self.recogniser.as_deref().and_then(Method::named);
        let exported = export::export(
            &self.run,
            (which, recogniser),
            self.false_rejections.unwrap_or(FALSE_REJECTIONS),
            (self.data.as_deref(), self.set.as_deref()),
            &self.out,
            &storage,
        )?;
        sign(key.as_ref(), &self.out, &FILES)?;
        let out = self.out.display();
        let descriptor = labelled("descriptor", 14, &exported.descriptor.to_string());
        // What a reader who has not asked for it must know is that there is none.
        let is_told = self.false_rejections.is_some() || exported.reject.calibration.is_err();
        let reject = if is_told { reject_lines(&exported.reject) } else { String::new() };
        let program = Names::of_this_process().coordinator();
        let note = exported.note.as_ref().map_or_else(String::new, |note| {
            let run = self.run.display();
            let told = format!(
                "{note}; to have them: {program} weigh {run} FILE.toml --how separately, and here --structure FILE.toml"
            );
            labelled("note", 14, &told)
        });
        super::print(&format!(
            "{descriptor}\
             recogniser    {}\n\
             database      {} clouds\n\
             {reject}\
             example       {}: nearest is {}\n\
             artefact      {out}, {:.1} MB\n\
             to use it     {program} recognise {out} CLOUD.pcd\n\
             {note}",
            exported.recogniser,
            exported.clouds,
            exported.example,
            exported.answer,
            exported.bytes as f64 / 1e6,
        ))?;
        Ok(ExitCode::SUCCESS)
    }
}
