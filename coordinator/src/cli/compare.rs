//! `coordinator compare`: the run's descriptor and others on its test clouds.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use descriptor::recogniser::Method;
use descriptor::{Perturbation, SetDistance, VectorMetric};

use super::run::{Afterwards, Manner, Observers};
use crate::compare::{ForeignSource, Named, Options, Source, Sources, compare};
use crate::experiment::Plan;
use crate::{run, sweep};

/// Compare the evolved descriptor with the paper's, PFHRGB, SHOT with colour and others on the test clouds of a run
///
/// Table 1 and figure 3 of the paper: errors with their intervals, sizes, times on one thread, recall against
/// 1 - precision; and whether the differences may be chance. All of it becomes tables in the run folder; each use is
/// a look at the test clouds and is noted there. Of an experiment, the run is made first if it is not finished.
///
/// A further comparison adds to the tables: descriptors that are there stay, with their times. Stopped at any moment,
/// the same command goes on: descriptions are kept in the cache as they arrive, times in the table.
///
/// Example: coordinator compare experiments/demo.toml
#[derive(Debug, Args)]
pub struct Compare {
    /// An experiment, or the folder of a finished run or sweep, for example results/runs/demo-0123456789ab
    #[arg(value_name = "EXP.toml|RUN")]
    subject: PathBuf,
    /// Only this one of evolved, paper, pfhrgb, shotcolor and two histograms of a whole cloud, global-chroma and
    /// global-hue-saturation, for example paper; repeatable
    #[arg(long, value_name = "NAME", value_parser = Named::names())]
    descriptor: Vec<String>,
    /// File of a structure, channel by channel, to compare as well, under the file's name without .toml or another, for
    /// example experiments/descriptors/cospair.toml; repeatable
    #[arg(long, value_name = "[NAME=]TOML")]
    structure: Vec<Source>,
    /// Folder of another finished run on the same clouds, whose winner to compare as well, under the name of its
    /// experiment or another, for example random=results/runs/demo-random; repeatable
    #[arg(long, value_name = "[NAME=]RUN")]
    with_run: Vec<Source>,
    /// Parquet file of what another program computed of the test and database clouds, to compare as well: vectors (columns
    /// cloud and values) or distances (columns query, cloud and distance), with paths of clouds relative to the root of the
    /// data set; for example fpfh=fpfh.parquet; repeatable
    #[arg(long, value_name = "NAME=FILE.parquet")]
    foreign: Vec<ForeignSource>,
    /// How vectors of --foreign are compared, for example cosine, which is 1 less the cosine; l2 by default; chi2
    /// refuses negative values
    #[arg(long, value_name = "NAME", value_parser = VectorMetric::ALL.map(VectorMetric::name))]
    foreign_metric: Option<String>,
    /// Point of the run's front to compare as well, by its number, under the name point-N, for example 3; repeatable
    #[arg(long, value_name = "N")]
    point: Vec<u32>,
    /// How centroids and deviations of two clouds are compared: chi2 (the default; in structures it stands for the
    /// channels' own metrics) or l1; repeatable, for example --distance chi2 --distance l1
    #[arg(long, value_name = "NAME", value_parser = ["chi2", "l1"])]
    distance: Vec<String>,
    /// How clouds get their names: nearest (the default), the name of the nearest cloud; projection, to few values in
    /// which objects lie apart; kernel-ridge, a regression on distances. The last two learn from the labels of the
    /// database, their settings chosen inside it; repeatable, for example --recogniser nearest --recogniser projection
    #[arg(long, value_name = "NAME", value_parser = Method::ALL.map(Method::name))]
    recogniser: Vec<String>,
    /// Radius of the region of pfhrgb and shotcolor in centimetres, for example 2.5; by default that of the comparison
    /// in the run folder, or else 5. One comparison has one radius: another is refused without --replace
    #[arg(long, value_name = "CM")]
    radius_cm: Option<f64>,
    /// Begin the comparison anew instead of adding to the one in the run folder, for example to measure times again
    #[arg(long)]
    replace: bool,
    /// Measure no times, for example where only errors are wanted: PFHRGB takes a tenth of a second a cloud. Otherwise
    /// those that the table does not have are measured
    #[arg(long)]
    no_times: bool,
    /// Errors on perturbed test clouds as well, by strength, on all cores of this machine; the database stays as it is.
    /// noise: normal, along each axis; density: points are removed at random; occlusion: those beyond a plane are; light: a
    /// gain of each channel of the colours; for example --perturb noise,light
    #[arg(long, value_name = "KIND", value_delimiter = ',', value_parser = Perturbation::ALL.map(Perturbation::name))]
    perturb: Vec<String>,
    /// Compare on the clouds of this set, where the run's clouds are of several, for example kitchen; the tables are in
    /// the folder sets/NAME of the run
    #[arg(long, value_name = "NAME")]
    set: Option<String>,
    /// Why the test clouds are looked at, for example "table 1 of the paper"; kept in table looks
    #[arg(long, value_name = "TEXT", default_value = "comparison of descriptors")]
    reason: String,
    /// Another place of the data set, for example /data/rgbd; by default the one the run used
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    #[command(flatten)]
    manner: Manner,
}

impl Compare {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let Self {
            subject,
            descriptor,
            foreign,
            foreign_metric,
            distance,
            recogniser,
            radius_cm,
            replace,
            no_times,
            perturb,
            set,
            reason,
            data,
            manner,
            ..
        } = self;
        let given = Sources { structures: self.structure, runs: self.with_run, points: self.point };
        let radius_um = radius_cm.map(|cm| super::micrometres("--radius-cm", cm)).transpose()?;
        let port = manner.workers.port();
        let folder = if subject.is_file() {
            let plan = Plan::read(&subject, manner.workers.overrides(None))?;
            let out = match &plan {
                Plan::Run(experiment) => run::folder(experiment, None, false),
                Plan::Sweep(sweep) => sweep::folder(sweep, None, false),
            };
            manner.run(&plan, out.clone(), (&port, Observers::default()), Afterwards::COMPARISON)?;
            out
        } else {
            subject
        };
        let mut distances: Vec<_> = distance.iter().filter_map(|name| SetDistance::named(name)).collect();
        if distances.is_empty() {
            distances.push(SetDistance::default());
        }
        let mut recognisers: Vec<_> = recogniser.iter().filter_map(|name| Method::named(name)).collect();
        if recognisers.is_empty() {
            recognisers.push(Method::default());
        }
        let is_asked = |kind: &Perturbation| perturb.iter().any(|name| name == kind.name());
        let perturbations: Vec<Perturbation> = Perturbation::ALL.into_iter().filter(is_asked).collect();
        let asked = |one: &Named| descriptor.iter().any(|name| name == one.name());
        let named: Vec<Named> = Named::ALL.into_iter().filter(asked).collect();
        let mut options = Options {
            descriptors: (!named.is_empty()).then_some(named),
            given,
            foreign,
            foreign_metric: foreign_metric.as_deref().and_then(VectorMetric::named).unwrap_or_default(),
            distances,
            recognisers,
            radius_um,
            replace,
            times: !no_times,
            perturbations,
            set,
            reason,
            data,
            overrides: manner.workers.overrides(None),
            port,
            slurm: manner.workers.slurm()?,
            storage: manner.workers.storage()?,
            another_follows: true,
        };
        let folders = sweep::run_folders(&folder)?;
        for (place, (member, folder)) in folders.iter().enumerate() {
            options.another_follows = place + 1 < folders.len();
            let comparison = super::block_on("go on: the same command again", async {
                Ok(compare(folder, &options).await?)
            })?;
            let title = if member.is_empty() { String::new() } else { format!("{member}\n") };
            super::print(&if manner.json {
                format!("{}\n", comparison.json())
            } else {
                format!("{title}{}", comparison.text())
            })?;
        }
        Ok(ExitCode::SUCCESS)
    }
}
