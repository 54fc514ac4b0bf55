//! A cloud with its labels, wherever they are from.

use super::error::Place;
use super::root::Located;

/// A cloud with its labels, not yet read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Labelled {
    pub located: Located,
    pub category: String,
    pub instance: String,
    /// Name of its sequence, if the layout knows one.
    pub sequence: Option<String>,
    /// Name of its split, if the manifest says one.
    pub split: Option<String>,
    /// Name of its set, if the manifest has sets.
    pub set: Option<String>,
    pub place: Place,
}
