//! `coordinator evaluate`: one descriptor, no evolution.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context as _;
use clap::Args;
use descriptor::{
    Descriptor, Family, FixedDescriptor, FixedKind, GENES, GeneKind, GeneTable, Parameters, Preprocess,
    SetDistance, Unit,
};
use serde_json::json;

use crate::dataset::{Layout, Listing};
use crate::evaluate::{Report, Request, evaluate};
use crate::experiment::name_advice;
use crate::run::progress::percent;
use crate::run::{rows, summary};

/// Evaluate one descriptor on lists of clouds
///
/// Example: coordinator evaluate --data results/data/demo --query test.txt
/// --database train1.txt --database train2.txt --database validation.txt --set shape_bins=60 --set R1=1.3
#[derive(Debug, Args)]
pub struct Evaluate {
    /// Folder of the clouds, for example data/rgbd
    #[arg(long, value_name = "ROOT")]
    data: PathBuf,
    /// List of queries, a path below ROOT on each line, for example test.txt; repeatable
    #[arg(long, value_name = "LIST", required = true, num_args = 1..)]
    query: Vec<PathBuf>,
    /// List of database clouds, for example train1.txt; repeatable
    #[arg(long, value_name = "LIST", required = true, num_args = 1..)]
    database: Vec<PathBuf>,
    /// The paper's descriptor, or one that it is compared with, as PCL computes it, for example shotcolor
    #[arg(long, value_name = "NAME", default_value = Family::DiskRing.name(), value_parser = [Family::DiskRing.name(), "pfhrgb", "shotcolor"])]
    descriptor: String,
    /// A gene's value, for example R1=1.3; repeatable. The others keep the values of the paper's best descriptor
    #[arg(long, value_name = "gene=value")]
    set: Vec<String>,
    /// Radius of the region of pfhrgb and shotcolor in centimetres, for example 5
    #[arg(long, value_name = "CM", default_value_t = 5.0)]
    radius_cm: f64,
    /// How the centroids and deviations of two clouds are compared, for example l1
    #[arg(long, value_name = "NAME", default_value = "chi2", value_parser = ["chi2", "l1"])]
    distance: String,
    /// Threads, for example 1; all cores by default. Seconds of a stage are added up over clouds and threads
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Edge of a keypoint voxel in centimetres, for example 2
    #[arg(long, value_name = "CM", default_value_t = 2.0)]
    leaf_cm: f64,
    /// Radius of a normal's neighbourhood in centimetres, for example 1
    #[arg(long, value_name = "CM", default_value_t = 1.0)]
    normal_radius_cm: f64,
    /// Unit of the clouds: m or mm, for example mm
    #[arg(long, value_name = "m|mm", default_value = "m", value_parser = unit)]
    unit: Unit,
    /// Shape only, for example for clouds without colour
    #[arg(long)]
    no_colour: bool,
    /// CSV of path, category, instance for data that is in no category/instance folders, for example labels.csv
    #[arg(long, value_name = "CSV")]
    manifest: Option<PathBuf>,
    /// Write each query's nearest cloud to a file (query, nearest, distance), for example nearest.txt
    #[arg(long, value_name = "FILE")]
    nearest: Option<PathBuf>,
    /// Print one JSON object on standard output, for example for jq
    #[arg(long)]
    json: bool,
}

fn unit(text: &str) -> Result<Unit, String> {
    match text {
        "m" => Ok(Unit::Metre),
        "mm" => Ok(Unit::Millimetre),
        _ => Err("must be m or mm".to_owned()),
    }
}

impl Evaluate {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let preprocess = Preprocess {
            leaf_um: super::micrometres("--leaf-cm", self.leaf_cm)?,
            normal_radius_um: super::micrometres("--normal-radius-cm", self.normal_radius_cm)?,
            colour: !self.no_colour,
            unit: self.unit,
            ..Preprocess::default()
        };
        let descriptor = self.descriptor(super::micrometres("--radius-cm", self.radius_cm)?)?;
        let place =
            |lists: &[PathBuf]| -> Vec<_> { lists.iter().map(|list| list_file(&self.data, list)).collect() };
        let threads = self.threads.map_or_else(
            || std::thread::available_parallelism().map_or(1, std::num::NonZeroUsize::get),
            usize::from,
        );
        let layout = self.manifest.map_or(Layout::Folders, |file| Layout::Manifest { file });
        let distance = SetDistance::named(&self.distance).unwrap_or_default();
        let request = Request {
            listing: Listing::load(&self.data, &layout, &place(&self.query), &place(&self.database))?,
            preprocess,
            descriptor: descriptor.clone(),
            distance,
            threads,
        };
        let report = evaluate(&request)?;
        if let Some(file) = &self.nearest {
            let lines: String = report
                .matches
                .iter()
                .map(|(query, nearest, found)| format!("{query} {nearest} {}\n", found.nearest.distance))
                .collect();
            std::fs::write(file, lines).map_err(|error| {
                anyhow::anyhow!(
                    "--nearest {}: cannot be written, got {error}\nchoose another file",
                    file.display()
                )
            })?;
        }
        let text = if self.json {
            json(&descriptor, distance, &report)
        } else {
            text(&descriptor, distance, &report)
        };
        super::print(&text)?;
        Ok(ExitCode::SUCCESS)
    }

    fn descriptor(&self, radius_um: u32) -> anyhow::Result<Descriptor> {
        let Some(kind) = FixedKind::named(&self.descriptor) else {
            return Ok(Descriptor::DiskRing(parameters(&self.set, !self.no_colour)?));
        };
        let name = &self.descriptor;
        anyhow::ensure!(
            self.set.is_empty(),
            "--set: {name} has no genes, got {}\nleave it out, or choose --descriptor {}",
            self.set.join(" "),
            Family::DiskRing.name()
        );
        anyhow::ensure!(
            !self.no_colour,
            "--no-colour: {name} needs colours, got none\nleave it out, or choose --descriptor {}",
            Family::DiskRing.name()
        );
        Ok(Descriptor::Fixed(FixedDescriptor { kind, radius_um }))
    }
}

/// A list is looked for in the current folder, then below the data root.
fn list_file(root: &Path, list: &Path) -> PathBuf {
    if list.exists() { list.to_owned() } else { root.join(list) }
}

fn parameters(set: &[String], colour: bool) -> anyhow::Result<Parameters> {
    let best = Parameters::PAPER_BEST;
    let mut ticks = GENES.each_ref().map(|spec| best.ticks(spec.kind));
    let mut seen: Vec<&str> = Vec::new();
    for assignment in set {
        let (name, value) = assignment.split_once('=').with_context(|| {
            format!("--set: must be gene=value, got {assignment}\nwrite for example R1=1.3")
        })?;
        let spec = GENES.iter().find(|spec| spec.name.eq_ignore_ascii_case(name)).with_context(|| {
            let names = GENES.each_ref().map(|spec| spec.name);
            format!("--set: unknown gene, got {name}\n{}", name_advice(name, &names, "genes are"))
        })?;
        let number: f64 = value.parse().with_context(|| {
            format!("--set {name}: must be a number, got {value}\nwrite for example R1=1.3")
        })?;
        anyhow::ensure!(
            !seen.contains(&spec.name),
            "--set {name}: given twice, got {value}\nset each gene once"
        );
        seen.push(spec.name);
        let is_of_colour = matches!(spec.kind, GeneKind::ColourBins | GeneKind::ShapeWeight);
        anyhow::ensure!(
            colour || !is_of_colour,
            "--set {name}: has no meaning without colour, got {value}\nleave it out, or leave out --no-colour"
        );
        let (low, high) = (spec.value(spec.limits.0), spec.value(spec.limits.1));
        anyhow::ensure!(
            number >= low && number <= high,
            "--set {name}: must be from {low} to {high} {}, got {value}\nchoose a value inside these limits",
            spec.unit
        );
        ticks[spec.kind as usize] = spec.ticks(number).with_context(|| {
            let finest = spec.value(1);
            format!(
                "--set {name}: must be a multiple of {finest} {}, got {value}\nround the value",
                spec.unit
            )
        })?;
    }
    if !colour {
        ticks[GeneKind::ColourBins as usize] = 0;
        ticks[GeneKind::ShapeWeight as usize] = GENES[GeneKind::ShapeWeight as usize].limits.1;
    }
    let parameters = Parameters::from_ticks(ticks);
    GeneTable::single(&parameters).map_err(|error| anyhow::anyhow!("--set: {error}"))?;
    Ok(parameters)
}

fn json(descriptor: &Descriptor, distance: SetDistance, report: &Report) -> String {
    let Report { correct, seconds, .. } = report;
    let error = |right: usize| (correct.queries - right) as f64 / correct.queries as f64;
    let told = match descriptor {
        Descriptor::DiskRing(parameters) => {
            serde_json::Value::Object(summary::genes_json(&rows::gene_values(parameters)))
        }
        Descriptor::Fixed(fixed) => json!({
            "name": fixed.kind.name(),
            "radius_cm": fixed.radius() * 100.0,
        }),
        Descriptor::GlobalHue(hue) => json!({
            "name": descriptor.family().name(),
            "bins": hue.bins(),
        }),
    };
    let skipped: Vec<_> =
        report.skipped.iter().map(|(path, reason)| json!({ "path": path, "reason": reason })).collect();
    let value = json!({
        "descriptor": told,
        "distance": distance.name(),
        "object_error": error(correct.object),
        "category_error": error(correct.category),
        "object_wrong": correct.queries - correct.object,
        "category_wrong": correct.queries - correct.category,
        "queries": correct.queries,
        "database": report.database,
        "skipped": skipped,
        "keypoints": report.keypoints,
        "seconds": {
            "read": seconds.read.as_secs_f64(),
            "keypoints": seconds.keypoints.as_secs_f64(),
            "normals": seconds.normals.as_secs_f64(),
            "describe": seconds.describe.as_secs_f64(),
            "match": seconds.matching.as_secs_f64(),
            "total": seconds.total.as_secs_f64(),
        },
    });
    format!("{value}\n")
}

fn text(descriptor: &Descriptor, distance: SetDistance, report: &Report) -> String {
    let Report { correct, seconds, .. } = report;
    let share = |part: usize| percent(part as f64 / correct.queries as f64);
    let (object, category) = (correct.queries - correct.object, correct.queries - correct.category);
    let by = distance.name();
    let told = format!("{descriptor} ({} values), by {by}", descriptor.size());
    let mut lines = vec![
        format!("descriptor      {told}"),
        format!("object error    {} ({object} of {})", share(object), correct.queries),
        format!("category error  {} ({category} of {})", share(category), correct.queries),
        format!(
            "outcomes        {} right object, {} other object of the category, {category} other category",
            correct.object,
            correct.category - correct.object
        ),
        format!("database        {} clouds", report.database),
        format!("keypoints       {}", report.keypoints),
        format!("skipped         {}", report.skipped.len()),
    ];
    lines.extend(report.skipped.iter().map(|(path, reason)| format!("                {path}: {reason}")));
    let time = |name: &str, time: std::time::Duration| format!("{name} {:.3}", time.as_secs_f64());
    lines.push(format!(
        "seconds         {}, {}, {}, {}, {}, {}",
        time("read", seconds.read),
        time("keypoints", seconds.keypoints),
        time("normals", seconds.normals),
        time("describe", seconds.describe),
        time("match", seconds.matching),
        time("total", seconds.total)
    ));
    lines.push(String::new());
    lines.join("\n")
}
