//! `README.md` of an artefact: how to use it, and what its numbers mean.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use artefact::{DATABASE, DatabaseCloud, EXAMPLE, SETTINGS, TEST_VECTOR};
use descriptor::recogniser::{Calibration, ChosenSettings, Settings};
use descriptor::structure::Structure;
use descriptor::{Descriptor, Preprocess, Unit};
use proto::Message;
use results::{ErrorRate, RunRow};

use super::DescriptorChoice;
use super::reject::{FoldsBy, Reject};
use crate::lines::percent;

/// Everything the text is made of.
pub(super) struct About<'a> {
    /// Of the experiment.
    pub name: &'a str,
    pub run_digest: &'a str,
    pub origin: Origin<'a>,
    pub descriptor: &'a Descriptor,
    /// Of a structure's channels.
    pub scales: &'a [f64],
    pub preprocess: Preprocess,
    pub clouds: &'a [DatabaseCloud],
    /// Of a recogniser that learns.
    pub recognition: Option<&'a Settings>,
    pub reject: &'a Reject,
}

/// What the artefact is made from.
pub(super) enum Origin<'a> {
    /// A run.
    Run {
        row: &'a RunRow,
        which: &'a DescriptorChoice,
        /// How the settings of a recogniser that learns were chosen.
        learning: Option<ChosenSettings>,
    },
    /// An artefact that clouds were added to.
    Artefact,
}

impl About<'_> {
    /// The text.
    pub(super) fn text(&self) -> String {
        let Self { name, run_digest, descriptor, preprocess, clouds, scales, .. } = self;
        let objects: BTreeSet<_> = clouds.iter().map(|row| (&row.category, &row.instance)).collect();
        let categories: BTreeSet<_> = clouds.iter().map(|row| &row.category).collect();
        let (which, experiment) = self.which();
        let (unit, length) = match preprocess.unit {
            Unit::Metre => ("metres", "m"),
            Unit::Millimetre => ("millimetres", "mm"),
        };
        let colours = if preprocess.colour { "coloured " } else { "" };
        // Written by hand as Markdown; writing to a String cannot fail.
        let mut text = String::new();
        let _ = write!(
            text,
            "# {name}\n\n\
             {which} of run `{run_digest}` ({experiment}), made by descry {version}.\n\
             It recognises {objects} objects of {categories} categories by {how} {clouds} reference clouds: \
             {sources}\n\n\
             ## Use\n\n\
             ```\n\
             coordinator recognise . {EXAMPLE}\n\
             coordinator recognise . cloud.pcd … --json --top 5\n\
             ```\n\n\
             A cloud is a PCD file of {colours}points in {unit}, one object cut out of its surroundings, with the camera \
             at the viewpoint that the file names. In a Rust program the crate `descriptor` does the same: its \
             documentation begins with an example.\n\n",
            sources = self.sources(),
            how = match self.recognition {
                Some(_) => "what it learns, whenever it is opened, from the labels of",
                None => "the nearest of",
            },
            version = env!("CARGO_PKG_VERSION"),
            objects = objects.len(),
            categories = categories.len(),
            clouds = clouds.len(),
        );
        text.push_str("## How well\n\n");
        text.push_str(&self.errors());
        let (sum, kept) = set_distance(descriptor);
        let _ = write!(
            text,
            "\n## The numbers\n\n\
             {meaning}\n\
             - `margin`: how much farther the {next}. Small margins are the doubtful answers.\n\
             {unknown}\n\n",
            meaning = self.meaning(sum),
            unknown = self.unknown(objects.len()),
            next = match self.recognition {
                Some(_) => "second object is",
                None => "nearest cloud of another object is",
            },
        );
        match descriptor {
            Descriptor::Structure(Structure { channels }) => {
                for ((number, channel), scale) in (1..).zip(channels).zip(*scales) {
                    let _ = writeln!(text, "{number}. `{channel}`, scale {scale}");
                }
            }
            _ => text.push_str(&genes(descriptor)),
        }
        let _ = write!(
            text,
            "\n## Files\n\n\
             - `{SETTINGS}`: the descriptor, what is done to a cloud before it (coordinates in {length}), and the digests \
             (BLAKE3) of the others.\n\
             - `{DATABASE}`: a row a reference cloud: its labels, and {kept}. The columns are described in the file's \
             metadata, `descry.columns`.\n\
             - `{TEST_VECTOR}`: the same of `{EXAMPLE}`, and what it is recognised as: another implementation should \
             come to these numbers.\n",
        );
        text
    }

    /// What was exported, and of which experiment.
    fn which(&self) -> (String, String) {
        match self.origin {
            Origin::Run { row, which, .. } => {
                let which = match which {
                    DescriptorChoice::Evolved | DescriptorChoice::Searched => "The descriptor".to_owned(),
                    DescriptorChoice::Point(point) => {
                        format!("The descriptor that is point {point} of the front")
                    }
                    DescriptorChoice::Paper => {
                        "The paper's own best descriptor, and the reference clouds".to_owned()
                    }
                    DescriptorChoice::Structure(_) => {
                        "A structure from a file, and the reference clouds".to_owned()
                    }
                };
                (which, format!("experiment {}, seed {}", self.name, row.seed))
            }
            Origin::Artefact => ("The artefact".to_owned(), format!("experiment {}", self.name)),
        }
    }

    /// Where the reference clouds come from.
    fn sources(&self) -> String {
        let additions: BTreeSet<u32> = self.clouds.iter().filter_map(|cloud| cloud.addition).collect();
        let of = |addition: Option<u32>| -> Vec<_> {
            self.clouds.iter().filter(|cloud| cloud.addition == addition).collect()
        };
        if additions.is_empty() {
            return "the run's training and validation clouds, no test cloud.".to_owned();
        }
        let mut text = format!(
            "{} of the run, its training and validation clouds, no test cloud, and those that were added.\n",
            of(None).len()
        );
        for addition in additions {
            let clouds = of(Some(addition));
            let objects: BTreeSet<&str> = clouds.iter().map(|cloud| &*cloud.instance).collect();
            let objects: Vec<&str> = objects.into_iter().collect();
            let _ = write!(
                text,
                "\n- Addition {addition}, clouds: {}; objects: {}.",
                clouds.len(),
                objects.join(", ")
            );
        }
        text
    }

    /// What names objects, and its distance; `sum` says what a set distance is.
    fn meaning(&self, sum: &str) -> String {
        let Some(settings) = self.recognition else {
            return format!(
                "- `distance`: set distance to the nearest reference cloud, {sum}. 0 is the same cloud."
            );
        };
        let distance = match settings {
            Settings::Projection(_) => {
                "1 less the cosine between a cloud and what it is most like after projection. 0 is the same direction."
                    .to_owned()
            }
            Settings::KernelRidge(_) => format!(
                "1 less the value of the regression for the object, whose target is 1. The regression is one on set \
                 distances to the reference clouds: {sum}."
            ),
        };
        let chosen = match self.origin {
            Origin::Run { learning: Some(ChosenSettings { asked: 0, .. }), .. } => {
                "The settings are the first there are: no reference cloud could be asked.".to_owned()
            }
            Origin::Run { learning: Some(ChosenSettings { wrong, asked, .. }), .. } => format!(
                "While these settings were chosen, {wrong} of {asked} reference clouds were wrong by those of other \
                 sequences or folds."
            ),
            _ => "The settings are those of the artefact before clouds were added.".to_owned(),
        };
        format!(
            "- Objects are named by `{}` ({settings}). {chosen}\n- `distance`: {distance}",
            settings.method().name(),
        )
    }

    /// What becomes of objects that no reference cloud shows.
    fn unknown(&self, objects: usize) -> String {
        let Reject { false_rejections, calibration, folds } = self.reject;
        let found = match calibration {
            Ok(found) => found,
            Err(reason) => {
                return format!(
                    "- Neither is a probability, and an object that is not among the {objects} is taken for one of them: \
                     there is no rule for unknown ones. {}.",
                    Message::of(reason).what
                );
            }
        };
        let Calibration { rule, known, unknown, rejected, rejected_by_margin } = found;
        let without = match folds {
            FoldsBy::Sequences { sequences, .. } => {
                format!("without the clouds of its sequence ({sequences} in all)")
            }
            FoldsBy::Positions => "without a fifth of the clouds of each object".to_owned(),
        };
        format!(
            "- `known_probability`: that the object is among the {objects} at all, if half of what is asked is. Below \
             {:.4} the answer is `unknown`.\n\n\
             That bound is such that at most {} of the reference clouds are rejected. Each was asked {without}: {} of {known} \
             were rejected, and {} of {unknown} when the clouds of its object were left out, too. A bound on the margin alone \
             would reject {} and {}. `coordinator assess` measures this on other clouds.",
            rule.least_probability,
            percent(*false_rejections),
            rejected[0],
            rejected[1],
            rejected_by_margin[0],
            rejected_by_margin[1],
        )
    }

    /// What the run measured of this descriptor and recogniser.
    fn errors(&self) -> String {
        let Origin::Run { row, which, .. } = self.origin else {
            return "Not measured: clouds were added after the run. `coordinator assess` measures it on clouds of yours.\n"
                .to_owned();
        };
        let is_tested = *which == DescriptorChoice::Evolved && self.recognition.is_none();
        let Some(test) = row.test.filter(|_| is_tested) else {
            return "Not measured: the run has no test of this descriptor and recogniser. `coordinator compare` makes one.\n"
                .to_owned();
        };
        let error = |rate: ErrorRate| {
            let ErrorRate { wrong, queries } = rate;
            let [low, high] = rate.interval().map(|end| 100.0 * end);
            format!("{} ({wrong} of {queries}), 95 % interval {low:.1} to {high:.1} %", percent(rate.share()))
        };
        format!(
            "Of {} test clouds, which the search did not see:\n\n\
             - wrong object: {}\n\
             - wrong category: {}\n\n\
             They show the same objects as the reference clouds, and no answer was rejected. The intervals (Wilson) take the \
             clouds for independent.\n",
            test.queries,
            error(test.object_errors()),
            error(test.category_errors()),
        )
    }
}

/// How the signatures of two clouds are compared, and what is kept of a cloud.
fn set_distance(descriptor: &Descriptor) -> (&'static str, &'static str) {
    match descriptor {
        Descriptor::Structure(structure) if structure.has_value_weights() => (
            "the sum over the channels of weight / scale times the distance, χ² unless the channel names another, of \
             the centroids plus that of the standard deviations of its rows, both times value_weights where a channel \
             has some",
            "centroid and standard deviation of its rows in each channel, times its value_weights",
        ),
        Descriptor::Structure(_) => (
            "the sum over the channels of weight / scale times the distance, χ² unless the channel names another, of \
             the centroids plus that of the standard deviations of its rows",
            "centroid and standard deviation of its rows in each channel",
        ),
        _ => (
            "w · shape + (1 − w) · colour, each the χ² distance \
                 of the centroids plus that of the standard deviations of all keypoints' histograms",
            "centroid and standard deviation of its shape and colour histograms",
        ),
    }
}

/// The descriptor's genes as a table.
fn genes(descriptor: &Descriptor) -> String {
    let mut text = "| gene | value | meaning |\n|---|---|---|\n".to_owned();
    for (column, value) in descriptor.family().columns().iter().zip(descriptor.values()) {
        let Some(value) = value else { continue };
        let value = format!("{value} {}", column.unit);
        let _ = writeln!(text, "| {} | {} | {} |", column.name, value.trim_end(), column.meaning);
    }
    text
}
