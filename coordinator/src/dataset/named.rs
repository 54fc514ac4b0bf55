//! Clouds with their names, whether from lists or all that a layout finds, in no split and not yet read.

use std::path::{Path, PathBuf};

use super::check::{check_labels, check_overlap};
use super::error::DatasetError;
use super::labelled::Labelled;
use super::layout::Labels;
use super::root::Root;
use super::settings::Layout;

/// A cloud that is there and has names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedCloud {
    /// Relative to the root, with `/`.
    pub path: String,
    /// Where it is.
    pub file: PathBuf,
    /// Its category.
    pub category: String,
    /// Its instance.
    pub instance: String,
    /// Its sequence, if the layout knows one.
    pub sequence: Option<String>,
}

impl NamedCloud {
    /// The clouds of lists below a root, list after list.
    ///
    /// # Errors
    /// [`DatasetError`]: as for an experiment, a cloud that is listed twice and an instance of two categories are refused.
    pub fn listed(root: &Path, layout: &Layout, lists: &[PathBuf]) -> Result<Vec<Self>, DatasetError> {
        let root = Root::open(root)?;
        let labels = Labels::read(layout, &root).map_err(|error| error.of_option("manifest"))?;
        let mut clouds = Vec::new();
        for file in lists {
            clouds.extend(labels.list(file, &root).map_err(|error| error.of_option("query"))?);
        }
        Self::checked("query", &root, clouds)
    }

    /// Every cloud that the layout finds below a root, by path; of a manifest by row. Also how many clouds have names that
    /// the layout does not know.
    ///
    /// # Errors
    /// As [`NamedCloud::listed`].
    pub fn found(root: &Path, layout: &Layout) -> Result<(Vec<Self>, usize), DatasetError> {
        let root = Root::open(root)?;
        let labels = Labels::read(layout, &root).map_err(|error| error.of_option("manifest"))?;
        let mut ignored = Vec::new();
        let clouds = labels.all(&root, &mut ignored)?;
        Ok((Self::checked("clouds", &root, clouds)?, ignored.len()))
    }

    fn checked(side: &'static str, root: &Root, clouds: Vec<Labelled>) -> Result<Vec<Self>, DatasetError> {
        let lists = [clouds];
        check_overlap(&[side], &lists)?;
        let [clouds] = lists;
        check_labels(clouds.iter())?;
        let named = |cloud: Labelled| Self {
            file: root.path().join(&cloud.located.path),
            path: cloud.located.path,
            category: cloud.category,
            instance: cloud.instance,
            sequence: cloud.sequence,
        };
        Ok(clouds.into_iter().map(named).collect())
    }
}
