//! `coordinator evaluate`: one descriptor, no evolution.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context as _;
use artefact::read_structure;
use clap::Args;
use descriptor::{
    COST_DATABASE, Descriptor, Domain, Family, FixedDescriptor, FixedKind, Preprocess, SearchSpace,
    SetDistance, Unit,
};
use serde_json::json;

use super::layout::{LayoutArgs, LayoutName};
use super::look::{LookArgs, noted};
use crate::console::say;
use crate::dataset::Listing;
use crate::evaluate::{DescribedClouds, Report, Request, check_units, compared_by};
use crate::experiment::name_advice;
use crate::lines::{percent, wrapped};
use crate::looks::Look;
use crate::run::summary;

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
    /// Family of the descriptor: the paper's, one that it is compared with, as PCL computes it, or a histogram of hue,
    /// for example shotcolor
    #[arg(long, value_name = "NAME", default_value = Family::DiskRing.name(), value_parser = Family::ALL.map(Family::name))]
    descriptor: String,
    /// A gene's value, for example R1=1.3; repeatable. The others keep the family's default: of disk-ring the paper's best
    #[arg(long, value_name = "gene=value")]
    set: Vec<String>,
    /// File of a structure, channel by channel, instead of a family, for example experiments/descriptors/pfhrgb.toml
    #[arg(long, value_name = "TOML", conflicts_with_all = ["descriptor", "set", "radius_cm"])]
    structure: Option<PathBuf>,
    /// Radius of the region of pfhrgb and shotcolor in centimetres, 5 if not given, for example 3
    #[arg(long, value_name = "CM")]
    radius_cm: Option<f64>,
    /// How the centroids and deviations of two clouds are compared, for example l1
    #[arg(long, value_name = "NAME", default_value = "chi2", value_parser = SetDistance::ALL.map(SetDistance::name))]
    distance: String,
    /// Threads, for example 1; all cores by default. Seconds of a stage are added up over clouds and threads
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Edge of a keypoint voxel in centimetres, 2 if not given, for example 3; not of structures, whose channels have grids of
    /// their own
    #[arg(long, value_name = "CM", conflicts_with = "structure")]
    leaf_cm: Option<f64>,
    /// Radius of a normal's neighbourhood in centimetres, for example 1
    #[arg(long, value_name = "CM", default_value_t = 1.0)]
    normal_radius_cm: f64,
    /// Unit of the clouds: m or mm, for example mm
    #[arg(long, value_name = "m|mm", default_value = "m", value_parser = unit)]
    unit: Unit,
    /// Shape only, for example for clouds without colour
    #[arg(long)]
    no_colour: bool,
    #[command(flatten)]
    layout: LayoutArgs,
    #[command(flatten)]
    look: LookArgs,
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
            leaf_um: match self.leaf_cm {
                Some(leaf_cm) => super::micrometres("--leaf-cm", leaf_cm)?,
                None => Preprocess::default().leaf_um,
            },
            normal_radius_um: super::micrometres("--normal-radius-cm", self.normal_radius_cm)?,
            colour: !self.no_colour,
            unit: self.unit,
            ..Preprocess::default()
        };
        let descriptor = self.descriptor()?;
        let label = self.label();
        let place =
            |lists: &[PathBuf]| -> Vec<_> { lists.iter().map(|list| list_file(&self.data, list)).collect() };
        let threads = self.threads.map_or_else(
            || std::thread::available_parallelism().map_or(1, std::num::NonZeroUsize::get),
            usize::from,
        );
        let layout = self.layout.or(LayoutName::Folders);
        let distance = SetDistance::named(&self.distance).unwrap_or_default();
        let request = Request {
            listing: Listing::load(&self.data, &layout, &place(&self.query), &place(&self.database))?,
            preprocess,
            descriptor: descriptor.clone(),
            threads,
            scaled_by: None,
        };
        check_units(&request.listing, &preprocess)?;
        let note = |look: Look| -> anyhow::Result<(Look, usize)> {
            let files: Vec<&Path> = request.listing.clouds.iter().map(|cloud| &*cloud.file).collect();
            let test_clouds = look.note(&files, &label)?;
            Ok((look, test_clouds))
        };
        let looked = self.look.look("evaluate").map(note).transpose()?;
        let described = DescribedClouds::new(&request, &|| ())?;
        for channel in described.empty_channels() {
            say(format_args!(
                "warning: channel {channel}: pairs of points in some cloud expected, got none\nit tells nothing apart: \
                 raise its radius_cm, lower its least_cm, or leave it out"
            ));
        }
        let report = described.report(distance)?;
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
            json(&descriptor, distance, &report, looked.as_ref())
        } else {
            text(&descriptor, distance, &report, looked.as_ref())
        };
        super::print(&text)?;
        Ok(ExitCode::SUCCESS)
    }

    /// What the descriptor is called in table looks, where a space ends a name: by its file, else by its family.
    fn label(&self) -> String {
        let file = self.structure.as_deref().and_then(Path::file_name);
        let name = |file: &OsStr| file.to_string_lossy().replace(char::is_whitespace, "_");
        file.map_or_else(|| self.descriptor.clone(), name)
    }

    fn descriptor(&self) -> anyhow::Result<Descriptor> {
        if let Some(file) = &self.structure {
            let descriptor = Descriptor::Structure(read_structure(file)?);
            let needs_colour = descriptor.needs_colour() && self.no_colour;
            anyhow::ensure!(
                !needs_colour,
                "--no-colour: {} needs colours, got none\nleave it out, or name a file without features of colour",
                file.display()
            );
            return Ok(descriptor);
        }
        let family = Family::named(&self.descriptor).unwrap_or(Family::DiskRing); // checked by clap
        if let Some(kind) = FixedKind::named(&self.descriptor) {
            let choose = format!("leave it out, or choose --descriptor {}", Family::DiskRing);
            let set = self.set.join(" ");
            anyhow::ensure!(self.set.is_empty(), "--set: {family} has no genes, got {set}\n{choose}");
            anyhow::ensure!(!self.no_colour, "--no-colour: {family} needs colours, got none\n{choose}");
            let radius_um = match self.radius_cm {
                Some(radius_cm) => super::micrometres("--radius-cm", radius_cm)?,
                None => FixedDescriptor::DEFAULT_RADIUS_UM,
            };
            return Ok(Descriptor::Fixed(FixedDescriptor { kind, radius_um }));
        }
        if let Some(radius_cm) = self.radius_cm {
            anyhow::bail!(
                "--radius-cm: {family} has no region of one radius, got {radius_cm}\nleave it out, or choose --descriptor {}",
                FixedKind::PfhRgb.name()
            );
        }
        if family == Family::Structure {
            let files = "name a file of channels: --structure experiments/descriptors/pfhrgb.toml";
            let set = self.set.join(" ");
            anyhow::ensure!(self.set.is_empty(), "--set: {family} has no genes to set, got {set}\n{files}");
            if let Some(leaf_cm) = self.leaf_cm {
                anyhow::bail!(
                    "--leaf-cm: channels of {family} have their own grids, got {leaf_cm}\nleave it out"
                );
            }
            let default = Descriptor::default_of(family);
            anyhow::ensure!(!self.no_colour, "--no-colour: {default} needs colours, got none\n{files}");
            return Ok(default);
        }
        let domains = domains(family, &self.set, !self.no_colour)?;
        let space = SearchSpace::new(family, !self.no_colour, &domains);
        let space = space.map_err(|error| anyhow::anyhow!("--set: {error}"))?;
        space.only().context("--set: must give each gene one value, got more")
    }
}

/// A list is looked for in the current folder, then below the data root.
pub(super) fn list_file(root: &Path, list: &Path) -> PathBuf {
    if list.exists() { list.to_owned() } else { root.join(list) }
}

/// The values of a family's genes: those of its default descriptor, but for those that are set.
fn domains(family: Family, set: &[String], colour: bool) -> anyhow::Result<Vec<Domain>> {
    let genes = family.genes();
    let default = SearchSpace::single(&Descriptor::default_of(family))?.genes();
    let mut domains: Vec<Domain> = default.into_iter().map(|(_, domain)| domain).collect();
    let mut seen: Vec<&str> = Vec::new();
    for assignment in set {
        let (name, value) = assignment.split_once('=').with_context(|| {
            format!("--set: must be gene=value, got {assignment}\nwrite for example R1=1.3")
        })?;
        let place =
            genes.iter().position(|spec| spec.name.eq_ignore_ascii_case(name)).with_context(|| {
                let names: Vec<&str> = genes.iter().map(|spec| spec.name).collect();
                format!("--set: unknown gene, got {name}\n{}", name_advice(name, &names, "genes are"))
            })?;
        let spec = &genes[place];
        let number: f64 = value.parse().with_context(|| {
            format!("--set {name}: must be a number, got {value}\nwrite for example R1=1.3")
        })?;
        anyhow::ensure!(
            !seen.contains(&spec.name),
            "--set {name}: given twice, got {value}\nset each gene once"
        );
        seen.push(spec.name);
        anyhow::ensure!(
            colour || !spec.needs_colour,
            "--set {name}: has no meaning without colour, got {value}\nleave it out, or leave out --no-colour"
        );
        let (low, high) = spec.limits;
        anyhow::ensure!(
            (spec.value(low)..=spec.value(high)).contains(&number),
            "--set {name}: must be from {} to {}, got {value}\nchoose a value inside these limits",
            spec.value(low),
            spec.text(high)
        );
        let ticks = spec.ticks(number).with_context(|| {
            format!("--set {name}: must be a multiple of {}, got {value}\nround the value", spec.text(1))
        })?;
        domains[place] = Domain::fixed(ticks);
    }
    Ok(domains)
}

fn json(
    descriptor: &Descriptor,
    distance: SetDistance,
    report: &Report,
    looked: Option<&(Look, usize)>,
) -> String {
    let Report { correct, seconds, .. } = report;
    let error = |right: usize| (correct.queries - right) as f64 / correct.queries as f64;
    let family = descriptor.family();
    let told = match family {
        Family::DiskRing => summary::genes_json(family, &descriptor.values()),
        _ => named_json(descriptor),
    };
    let skipped: Vec<_> =
        report.skipped.iter().map(|(path, reason)| json!({ "path": path, "reason": reason })).collect();
    let value = json!({
        "descriptor": told,
        "distance": compared_by(descriptor, distance),
        "counted_cost": descriptor.recognition_cost(),
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
        "test_clouds": looked.map(|(_, test_clouds)| test_clouds),
    });
    format!("{value}\n")
}

/// A descriptor of another family than the paper's: the family's name, then the values with their units.
fn named_json(descriptor: &Descriptor) -> serde_json::Map<String, serde_json::Value> {
    let family = descriptor.family();
    let mut values = summary::genes_json(family, &descriptor.values());
    let named = family.columns().into_iter().filter_map(|column| {
        let key = match column.unit {
            "" => column.name.to_owned(),
            unit => format!("{}_{unit}", column.name),
        };
        Some((key, values.remove(column.name)?))
    });
    std::iter::once(("name".to_owned(), json!(family.name()))).chain(named).collect()
}

/// In lines that fit a terminal, without the last line's end.
fn fitting(line: &str) -> String {
    wrapped(line, 16).trim_end().to_owned()
}

fn text(
    descriptor: &Descriptor,
    distance: SetDistance,
    report: &Report,
    looked: Option<&(Look, usize)>,
) -> String {
    let Report { correct, seconds, .. } = report;
    let share = |part: usize| percent(part as f64 / correct.queries as f64);
    let (object, category) = (correct.queries - correct.object, correct.queries - correct.category);
    let by = compared_by(descriptor, distance);
    let told = format!("{descriptor} ({} values), by {by}", descriptor.size());
    let mut lines = vec![
        fitting(&format!("descriptor      {told}")),
        format!("counted cost    {} a cloud among {COST_DATABASE}", descriptor.recognition_cost()),
        format!("object error    {} ({object} of {})", share(object), correct.queries),
        format!("category error  {} ({category} of {})", share(category), correct.queries),
        fitting(&format!(
            "outcomes        {} right object, {} other object of the category, {category} other category",
            correct.object,
            correct.category - correct.object
        )),
        format!("database        {} clouds", report.database),
        format!("keypoints       {}", report.keypoints),
        format!("skipped         {}", report.skipped.len()),
    ];
    lines.extend(report.skipped.iter().map(|(path, reason)| format!("                {path}: {reason}")));
    let time = |name: &str, time: std::time::Duration| format!("{name} {:.3}", time.as_secs_f64());
    lines.push(fitting(&format!(
        "seconds         {}, {}, {}, {}, {}, {}",
        time("read", seconds.read),
        time("keypoints", seconds.keypoints),
        time("normals", seconds.normals),
        time("describe", seconds.describe),
        time("match", seconds.matching),
        time("total", seconds.total)
    )));
    if let Some((look, test_clouds)) = looked {
        lines.push(fitting(&format!("look            {}", noted(look, *test_clouds))));
    }
    lines.push(String::new());
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use descriptor::structure::Structure;

    use super::*;

    #[test]
    fn values_have_the_names_of_their_genes() {
        let mut structure = Structure::default();
        structure.channels[0].weight_ppm = 2_500_000;
        let named = named_json(&Descriptor::Structure(structure));
        // Neighbours o1 8, o2 8 (s 0.5), 3 cm, 256 pairs, grid 2 cm: there is no third feature.
        let expected = [
            ("name", json!("structure")),
            ("s1_feature_1", json!(20)),
            ("s1_feature_2", json!(21)),
            ("s1_bins_1", json!(8)),
            ("s1_bins_2", json!(8)),
            ("s1_squash", json!(0.5)),
            ("s1_R_cm", json!(3.0)),
            ("s1_grid_cm", json!(2.0)),
            ("s1_samples", json!(256)),
            ("s1_weight", json!(2.5)),
            ("s2_pairs", json!(3)),
            ("s2_R_cm", json!(12.0)),
        ];
        for (key, value) in expected {
            assert_eq!(named.get(key), Some(&value), "{key}: {named:?}");
        }
        assert!(["s1_feature_3", "s1_bins_3", "s2_grid_cm"].iter().all(|key| !named.contains_key(*key)));
    }
}
