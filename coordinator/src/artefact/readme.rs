//! `README.md` of an artefact: how to use it, and what its numbers mean.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use descriptor::recogniser::{self, Settings};
use descriptor::structure::Structure;
use descriptor::{Descriptor, Preprocess, Unit};
use results::{Counts, DatabaseCloud, FinishedRun, wilson};

use super::{Chosen, DATABASE, EXAMPLE, SETTINGS, TEST_VECTOR};
use crate::run::progress::percent;

/// Everything the text is made of.
pub(super) struct About<'a> {
    pub finished: &'a FinishedRun,
    pub chosen: &'a Chosen,
    pub descriptor: &'a Descriptor,
    /// Of a structure's channels.
    pub scales: &'a [f64],
    pub preprocess: Preprocess,
    pub clouds: &'a [DatabaseCloud],
    /// Of a recogniser that learns.
    pub learning: Option<recogniser::Chosen>,
}

impl About<'_> {
    /// The text.
    pub(super) fn text(&self) -> String {
        let Self { finished, chosen, descriptor, preprocess, clouds, scales, learning } = self;
        let run = &finished.row;
        let objects: BTreeSet<_> = clouds.iter().map(|row| (&row.category, &row.instance)).collect();
        let categories: BTreeSet<_> = clouds.iter().map(|row| &row.category).collect();
        let which = match chosen {
            Chosen::Evolved => "The descriptor",
            Chosen::Point(point) => &format!("The descriptor that is point {point} of the front"),
            Chosen::Paper => "The paper's own best descriptor, and the reference clouds",
            Chosen::Structure(_) => "A structure written by hand, and the reference clouds",
        };
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
             {which} of run `{digest}` (experiment {name}, seed {seed}), made by descry {version}.\n\
             It recognises {objects} objects of {categories} categories by {how} {clouds} reference clouds: \
             the run's training and validation clouds, no test cloud.\n\n\
             ## Use\n\n\
             ```\n\
             coordinator recognise . {EXAMPLE}\n\
             coordinator recognise . cloud.pcd … --json --top 5\n\
             ```\n\n\
             A cloud is a PCD file of {colours}points in {unit}, one object cut out of its surroundings, with the camera \
             at the viewpoint that the file names. In a Rust program the crate `descriptor` does the same: its \
             documentation begins with an example.\n\n",
            how = match learning {
                Some(_) => "what it learns, whenever it is opened, from the labels of",
                None => "the nearest of",
            },
            name = run.name,
            digest = finished.run_digest,
            seed = run.seed,
            version = env!("CARGO_PKG_VERSION"),
            objects = objects.len(),
            categories = categories.len(),
            clouds = clouds.len(),
        );
        text.push_str("## How well\n\n");
        text.push_str(&self.errors());
        let (sum, kept) = match descriptor {
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
        };
        let _ = write!(
            text,
            "\n## The numbers\n\n\
             {meaning}\n\
             - `margin`: how much farther the {next}. Small margins are the doubtful answers.\n\
             - Neither is a probability, and an object that is not among the {objects} is taken for one of them.\n\n",
            meaning = self.meaning(sum),
            next = match learning {
                Some(_) => "second object is",
                None => "nearest cloud of another object is",
            },
            objects = objects.len(),
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

    /// What names objects, and its distance; `sum` says what a set distance is.
    fn meaning(&self, sum: &str) -> String {
        let Some(chosen) = self.learning else {
            return format!(
                "- `distance`: set distance to the nearest reference cloud, {sum}. 0 is the same cloud."
            );
        };
        let recogniser::Chosen { settings, wrong, asked } = chosen;
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
        format!(
            "- Objects are named by `{}` ({settings}). While these settings were chosen, {wrong} of {asked} reference clouds \
             were wrong by those of other sequences or folds.\n\
             - `distance`: {distance}",
            settings.method().name(),
        )
    }

    /// What the run measured of this descriptor.
    fn errors(&self) -> String {
        let row = &self.finished.row;
        let is_tested = *self.chosen == Chosen::Evolved && self.learning.is_none();
        let Some(test) = row.test.filter(|_| is_tested) else {
            return "Not measured: the run has no test of this descriptor and recogniser. `coordinator compare` makes one.\n"
                .to_owned();
        };
        let Counts { object_correct, category_correct, queries } = test;
        let error = |share: f64, correct: u32| {
            let wrong = queries.saturating_sub(correct);
            let [low, high] = wilson(wrong, queries).map(|end| 100.0 * end);
            format!("{} ({wrong} of {queries}), 95 % interval {low:.1} to {high:.1} %", percent(share))
        };
        format!(
            "Of {queries} test clouds, which the search did not see:\n\n\
             - wrong object: {}\n\
             - wrong category: {}\n\n\
             They show the same objects as the reference clouds. The intervals (Wilson) take the clouds for independent.\n",
            error(test.object_error(), object_correct),
            error(test.category_error(), category_correct),
        )
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
