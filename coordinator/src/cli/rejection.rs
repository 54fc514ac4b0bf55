//! What commands say of unknown objects that make or measure artefacts.

use artefact::MOST_FALSE_REJECTIONS;
use descriptor::recogniser::Calibration;
use proto::Message;

use crate::export::{FoldsBy, Reject};
use crate::lines::{labelled, percent};

/// A share of false rejections.
pub(super) fn rate(text: &str) -> Result<f64, String> {
    let rate = text.parse().ok().filter(|rate| (0.0..=MOST_FALSE_REJECTIONS).contains(rate));
    rate.ok_or_else(|| format!("must be a share from 0 to {MOST_FALSE_REJECTIONS}"))
}

/// When answers are rejected, and how that was found.
pub(super) fn reject_lines(reject: &Reject) -> String {
    let told = match &reject.calibration {
        Ok(Calibration { known, unknown, rejected, rejected_by_margin, .. }) => {
            let share = |count: u32, all: u32| percent(f64::from(count) / f64::from(all));
            format!(
                "inside the database {} of {known} answers about known objects, {} of {unknown} about those left out; \
                 by the margin alone {}",
                share(rejected[0], *known),
                share(rejected[1], *unknown),
                share(rejected_by_margin[1], *unknown),
            )
        }
        Err(reason) => format!("none: {}", Message::of(reason).what),
    };
    labelled("reject", 14, &told)
}

/// What was left out while that was found.
pub(super) fn folds_line(folds: FoldsBy) -> String {
    let told = match folds {
        FoldsBy::Sequences { sequences, additions: 0 } => format!("each of {sequences} sequences"),
        FoldsBy::Sequences { sequences, additions: 1 } => {
            format!("each of {sequences} sequences (one is an addition without any)")
        }
        FoldsBy::Sequences { sequences, additions } => {
            format!("each of {sequences} sequences ({additions} are additions without any)")
        }
        FoldsBy::Positions => "a fifth of each object's clouds (not all have a sequence)".to_owned(),
    };
    labelled("", 14, &format!("found without {told} and without objects in turn"))
}

/// A number of things.
pub(super) fn count(number: usize, thing: &str) -> String {
    format!("{number} {thing}{}", if number == 1 { "" } else { "s" })
}
