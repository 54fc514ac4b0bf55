//! Descriptors that whoever compares gives and names: those of structure files, and winners of other runs.

use std::path::{Path, PathBuf};

use artefact::{StructureFileError, read_structure};
use descriptor::{Descriptor, Preprocess, SearchSpace, Unit};

use super::candidate::{Given, check_no_point, point_name};
use crate::experiment::{ConfigError, Experiment, Overrides};
use crate::front::{self, FrontError};
use crate::names::is_name;
use crate::reopen::{WinnerError, winner_of};

/// Where a given descriptor comes from: `PATH`, or `NAME=PATH`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Source {
    /// Its name; `None`: that of the file or of the run's experiment.
    pub name: Option<String>,
    /// A structure file or a run folder.
    pub path: PathBuf,
}

/// What is compared beside the descriptors that every comparison knows.
#[derive(Clone, Debug, Default)]
pub struct Sources {
    /// Structure files.
    pub structures: Vec<Source>,
    /// Folders of finished runs on the same clouds.
    pub runs: Vec<Source>,
    /// Points of the run's own front.
    pub points: Vec<u32>,
}

/// Why a descriptor cannot be given.
#[derive(Debug, thiserror::Error)]
pub enum GivenError {
    /// The structure file.
    #[error(transparent)]
    Structure(#[from] StructureFileError),
    /// The other run's folder.
    #[error(transparent)]
    Results(#[from] results::Error),
    /// The run's own front.
    #[error(transparent)]
    Front(#[from] FrontError),
    /// The other run's experiment.
    #[error(transparent)]
    Experiment(#[from] ConfigError),
    /// The other run's winner is not of this program's genes.
    #[error("{run}: {source}\nlook whether the run is sound: coordinator verify", run = .run.display())]
    Winner {
        /// The run.
        run: PathBuf,
        /// What is wrong with its winner.
        source: WinnerError,
    },
    /// The other run may have learned from the clouds that this one tests with, or has seen others.
    #[error("{path}: must be of {expected}, got {got}\nname a run on the same clouds, prepared alike")]
    OtherRun {
        /// Its folder.
        path: PathBuf,
        /// What this run has.
        expected: String,
        /// What the other has.
        got: String,
    },
    /// A name that it cannot have.
    #[error("{option} {path}: {what}, got {name:?}\nname it otherwise: {option} NAME={path}", path = path.display())]
    Name {
        /// The option.
        option: &'static str,
        /// What it names.
        path: PathBuf,
        /// What is wrong with the name.
        what: &'static str,
        /// The name.
        name: String,
    },
}

/// The option that names structure files.
pub const STRUCTURE: &str = "--structure";
/// The option that names other runs.
pub const WITH_RUN: &str = "--with-run";
/// The option that names points of the run's own front.
const POINT: &str = "--point";

impl From<&str> for Source {
    fn from(text: &str) -> Self {
        match text.split_once('=') {
            Some((name, path)) if is_name(name) => Self { name: Some(name.to_owned()), path: path.into() },
            _ => Self { name: None, path: text.into() },
        }
    }
}

impl Sources {
    /// Reads them all; `own` is the run that they are compared with.
    ///
    /// # Errors
    /// What is wrong with a file, a run or a name.
    pub fn read(&self, own: &Own<'_>) -> Result<Vec<Given>, GivenError> {
        let mut given: Vec<Given> = Vec::new();
        let mut add = |option, source: &Source, own_name: String, descriptor| {
            let name = source.name.clone().unwrap_or(own_name);
            let wrong =
                |what| GivenError::Name { option, path: source.path.clone(), what, name: name.clone() };
            if option != POINT {
                check_no_point(&name).map_err(wrong)?;
            }
            let one = Given::new(&name, descriptor).map_err(wrong)?;
            match given.iter().find(|other| other.name == one.name) {
                Some(other) if *other != one => Err(wrong("name must be that of one descriptor")),
                Some(_) => Ok(()),
                None => {
                    given.push(one);
                    Ok(())
                }
            }
        };
        for source in &self.structures {
            let stem = source.path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            add(STRUCTURE, source, stem, Descriptor::Structure(read_structure(&source.path)?))?;
        }
        for source in &self.runs {
            let (name, winner) = own.winner_of(&source.path)?;
            add(WITH_RUN, source, name, winner)?;
        }
        for &point in &self.points {
            let source = Source { name: None, path: own.folder.to_owned() };
            add(POINT, &source, point_name(point), front::point(own.folder, own.space, point)?)?;
        }
        Ok(given)
    }
}

/// The run whose test clouds descriptors are compared on.
pub struct Own<'a> {
    /// Its folder.
    pub folder: &'a Path,
    /// What it searched.
    pub space: &'a SearchSpace,
    /// The digest of its clouds.
    pub data_digest: &'a str,
    /// How they are prepared.
    pub preprocess: &'a Preprocess,
}

impl Own<'_> {
    /// The winner of another run, and the name of its experiment.
    fn winner_of(&self, folder: &Path) -> Result<(String, Descriptor), GivenError> {
        let row = results::read_run(folder)?.row;
        let experiment = Experiment::from_record(&row.resolved_toml, folder, None, Overrides::default())?;
        let other = |expected, got| GivenError::OtherRun { path: folder.to_owned(), expected, got };
        if row.data_digest != self.data_digest {
            let digest = |digest: &str| format!("data digest {digest}");
            return Err(other(digest(self.data_digest), digest(&row.data_digest)));
        }
        if experiment.preprocess() != self.preprocess {
            return Err(other(said(self.preprocess), said(experiment.preprocess())));
        }
        let winner = winner_of(experiment.space(), &row)
            .map_err(|source| GivenError::Winner { run: folder.to_owned(), source })?;
        Ok((row.name, winner))
    }
}

/// As experiments have it.
fn said(preprocess: &Preprocess) -> String {
    let &Preprocess { leaf_um, normal_radius_um, min_points, colour, unit } = preprocess;
    let [leaf_cm, normal_radius_cm] = [leaf_um, normal_radius_um].map(|um| f64::from(um) / 1e4);
    let unit = if unit == Unit::Metre { "m" } else { "mm" };
    format!(
        "leaf_cm = {leaf_cm}, normal_radius_cm = {normal_radius_cm}, min_points = {min_points}, colour = {colour}, unit {unit}"
    )
}

#[cfg(test)]
mod tests {
    use descriptor::structure::StructureSpace;

    use super::*;

    #[test]
    fn a_source_has_a_name_only_before_its_first_equals_sign() {
        let named =
            |name: Option<&str>, path: &str| Source { name: name.map(str::to_owned), path: path.into() };
        assert_eq!(Source::from("a/b.toml"), named(None, "a/b.toml"));
        assert_eq!(Source::from("c=a/b.toml"), named(Some("c"), "a/b.toml"));
        assert_eq!(Source::from("c=a=b.toml"), named(Some("c"), "a=b.toml"));
        // Nobody may be called so: it is a path.
        assert_eq!(Source::from("a/b=c.toml"), named(None, "a/b=c.toml"));
    }

    #[test]
    fn a_name_stands_for_one_descriptor() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, feature: &str| {
            let path = folder.path().join(name);
            let text = format!(
                "version = 1\n[[channel]]\npairs = \"cloud\"\nfeatures = [\"{feature} 4\"]\nradius_cm = 9\n"
            );
            std::fs::write(&path, text).unwrap();
            path
        };
        let (hue, value) = (write("one.toml", "hue"), write("other.toml", "value"));
        let space = SearchSpace::Structures(StructureSpace::default());
        let own =
            Own { folder: folder.path(), space: &space, data_digest: "", preprocess: &Preprocess::default() };
        let read = |structures: &[(Option<&str>, &Path)]| {
            let source = |(name, path): &(Option<&str>, &Path)| Source {
                name: name.map(str::to_owned),
                path: path.to_path_buf(),
            };
            Sources { structures: structures.iter().map(source).collect(), ..Sources::default() }.read(&own)
        };
        let names = |given: Vec<Given>| given.into_iter().map(|one| one.name).collect::<Vec<_>>();
        assert_eq!(names(read(&[(None, &hue), (None, &value), (None, &hue)]).unwrap()), ["one", "other"]);
        let refused = read(&[(None, &hue), (Some("one"), &value)]).unwrap_err().to_string();
        assert!(
            refused.contains("other.toml: name must be that of one descriptor, got \"one\"\n"),
            "{refused}"
        );
        assert!(refused.contains("--structure NAME="), "{refused}");
        let refused = read(&[(Some("paper"), &hue)]).unwrap_err().to_string();
        assert!(refused.contains("must be none of evolved, paper, "), "{refused}");
        let refused = read(&[(Some("point-3"), &hue)]).unwrap_err().to_string();
        assert!(refused.contains("must not be that of a point of the front, got \"point-3\""), "{refused}");
        assert_eq!(
            names(read(&[(Some("point-a"), &hue), (Some("point-"), &value)]).unwrap()),
            ["point-a", "point-"]
        );
    }
}
