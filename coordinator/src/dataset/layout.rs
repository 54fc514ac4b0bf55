//! From folders, lists and manifests to labelled clouds.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use super::error::{DatasetError, Place};
use super::found::no_clouds;
use super::labelled::Labelled;
use super::manifest;
use super::pattern::{PathLabels, Pattern};
use super::root::{Located, Root, read_text};
use super::scenes::{SceneCloud, Scenes};
use super::settings::Layout;
use descriptor::cloud_file;

const UW_FORM: &str = "<category>/<instance>/<instance>_<video>_<frame>.pcd, .ply or _crop.png";
const FOLDERS_FORM: &str = "<category>/<instance>/<file>";
/// Where the layouts that search folders find clouds.
const FOUND_FORM: &str = "<category>/<instance>/<name>.pcd, .ply or _crop.png";
const BOP_FORM: &str = "<scene>/mask_visib/<image>_<object>.png, of an object in scene_gt.json,";

/// What a layout knows before any cloud is asked for.
pub(super) enum Labels {
    Uw,
    Folders,
    Manifest { file: PathBuf, clouds: Vec<Labelled>, by_file: HashMap<PathBuf, usize> },
    Pattern(Pattern),
    Bop(Scenes),
}

impl Labels {
    /// Reads the manifest, or what is in the scenes, if the layout has any.
    pub(super) fn read(layout: &Layout, root: &Root) -> Result<Self, DatasetError> {
        Ok(match layout {
            Layout::Uw => Self::Uw,
            Layout::Folders => Self::Folders,
            Layout::Pattern(pattern) => Self::Pattern(pattern.clone()),
            Layout::Bop => Self::Bop(Scenes::read(root.path(), |folder| entries(root.path(), folder))?),
            Layout::Manifest { file } => {
                let clouds = manifest::read(file, root)?;
                let mut by_file = HashMap::new();
                for (index, cloud) in clouds.iter().enumerate() {
                    if let Some(first) = by_file.insert(cloud.located.file.clone(), index) {
                        return Err(DatasetError::Twice {
                            path: cloud.located.path.clone(),
                            first: clouds[first].place.clone(),
                            second: cloud.place.clone(),
                        });
                    }
                }
                Self::Manifest { file: file.clone(), clouds, by_file }
            }
        })
    }

    /// The cloud that a list names.
    fn label(&self, located: Located, place: Place) -> Result<Labelled, DatasetError> {
        let form = match self {
            Self::Uw => UW_FORM,
            Self::Folders => FOLDERS_FORM,
            Self::Pattern(pattern) => return by_pattern(pattern, located, place),
            Self::Bop(scenes) => return of_scene(scenes, located, place),
            Self::Manifest { file, clouds, by_file } => {
                return match by_file.get(&located.file) {
                    Some(&index) => Ok(Labelled { located, place, ..clouds[index].clone() }),
                    None => {
                        let (path, manifest) = (located.path, file.clone());
                        Err(DatasetError::NotInManifest { place, path, manifest })
                    }
                };
            }
        };
        let parts: Vec<&str> = located.path.split('/').collect();
        let sequence = match (&parts[..], self) {
            ([_, instance, name], Self::Uw) => uw_video(instance, name).map(Some),
            ([_, _, _], _) => Some(None),
            _ => None,
        };
        let Some(sequence) = sequence else {
            return Err(DatasetError::NoLabel { place, expected: form, path: located.path });
        };
        let (category, instance) = (parts[0].to_owned(), parts[1].to_owned());
        Ok(Labelled { located, category, instance, sequence, split: None, set: None, place })
    }

    /// The clouds of a list, in its order.
    pub(super) fn list(&self, file: &Path, root: &Root) -> Result<Vec<Labelled>, DatasetError> {
        let text = read_text(file)?;
        let mut clouds = Vec::new();
        for (index, line) in text.lines().enumerate() {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let place = Place::Line { file: file.to_owned(), line: index as u64 + 1 };
            clouds.push(self.label(root.locate(line, &place)?, place)?);
        }
        Ok(clouds)
    }

    /// Every cloud that the layout finds, by path (in a manifest, by row). In the UW layout, which has other
    /// files beside the clouds, the paths of clouds with other names are added to `ignored`.
    pub(super) fn all(&self, root: &Root, ignored: &mut Vec<String>) -> Result<Vec<Labelled>, DatasetError> {
        if let Self::Manifest { clouds, .. } = self {
            return Ok(clouds.clone());
        }
        match self {
            Self::Pattern(pattern) => return found_by_pattern(pattern, root),
            Self::Bop(scenes) => return found_in_scenes(scenes, root),
            Self::Uw | Self::Folders | Self::Manifest { .. } => {}
        }
        let mut clouds = Vec::new();
        for category in entries(root.path(), "")? {
            if !root.path().join(&category).is_dir() {
                continue;
            }
            for instance in entries(root.path(), &category)? {
                if !root.path().join(&instance).is_dir() {
                    continue;
                }
                let mut found = entries(root.path(), &instance)?;
                found.retain(|path| cloud_file::has_ending(path));
                refuse_two_formats(&found)?;
                for path in found {
                    let place = Place::Found { path: path.clone() };
                    match self.label(root.locate(&path, &place)?, place) {
                        Ok(cloud) => clouds.push(cloud),
                        Err(DatasetError::NoLabel { .. }) => ignored.push(path),
                        Err(error) => return Err(error),
                    }
                }
            }
        }
        if clouds.is_empty() && ignored.is_empty() {
            return Err(no_clouds(root.path(), FOUND_FORM));
        }
        Ok(clouds)
    }
}

/// The cloud at a path that a pattern reads.
fn by_pattern(pattern: &Pattern, located: Located, place: Place) -> Result<Labelled, DatasetError> {
    let Some(PathLabels { category, instance, sequence }) = pattern.labels(&located.path) else {
        return Err(DatasetError::NoMatch { place, pattern: pattern.clone(), path: located.path });
    };
    Ok(Labelled { located, category, instance, sequence, split: None, set: None, place })
}

/// The cloud that a mask of a scene stands for.
fn of_scene(scenes: &Scenes, located: Located, place: Place) -> Result<Labelled, DatasetError> {
    let Some(SceneCloud { instance, sequence }) = scenes.cloud(&located.path) else {
        return Err(DatasetError::NoLabel { place, expected: BOP_FORM, path: located.path });
    };
    let (category, sequence) = (instance.clone(), Some(sequence));
    Ok(Labelled { located, category, instance, sequence, split: None, set: None, place })
}

/// Every object in every image of every scene.
fn found_in_scenes(scenes: &Scenes, root: &Root) -> Result<Vec<Labelled>, DatasetError> {
    let label = |path: String| {
        let place = Place::Found { path: path.clone() };
        of_scene(scenes, root.locate(&path, &place)?, place)
    };
    let clouds: Vec<Labelled> = scenes.masks().map(label).collect::<Result<_, _>>()?;
    if clouds.is_empty() {
        return Err(no_clouds(root.path(), BOP_FORM));
    }
    Ok(clouds)
}

/// Every cloud in the folders that a pattern names, by path. One that the pattern does not read is refused: it would be
/// missed without a word.
fn found_by_pattern(pattern: &Pattern, root: &Root) -> Result<Vec<Labelled>, DatasetError> {
    let (mut folders, mut found) = (vec![String::new()], Vec::new());
    while let Some(folder) = folders.pop() {
        for path in entries(root.path(), &folder)? {
            if root.path().join(&path).is_dir() {
                if pattern.enters(&path) {
                    folders.push(path);
                }
            } else if cloud_file::has_ending(&path) {
                found.push(path);
            }
        }
    }
    if found.is_empty() {
        return Err(no_clouds(root.path(), &pattern.to_string()));
    }
    found.sort_unstable();
    let label = |path: String| {
        let place = Place::Found { path: path.clone() };
        by_pattern(pattern, root.locate(&path, &place)?, place)
    };
    found.into_iter().map(label).collect()
}

/// Refuses a cloud that is there in two formats: a query would meet itself in the database.
fn refuse_two_formats(paths: &[String]) -> Result<(), DatasetError> {
    let mut stems = HashMap::new();
    for path in paths {
        let lower = path.to_ascii_lowercase();
        let ending = cloud_file::ENDINGS.iter().find(|ending| lower.ends_with(**ending)).unwrap_or(&"");
        let (stem, ending) = path.split_at(path.len() - ending.len());
        if let Some((first, other)) = stems.insert(stem, (path, ending))
            && !ending.eq_ignore_ascii_case(other)
        {
            return Err(DatasetError::TwoFormats { first: first.clone(), second: path.clone() });
        }
    }
    Ok(())
}

/// The video in the name of a UW cloud.
fn uw_video(instance: &str, name: &str) -> Option<String> {
    let rest = name.strip_prefix(instance)?.strip_prefix('_')?;
    let rest = cloud_file::ENDINGS.iter().find_map(|ending| rest.strip_suffix(ending))?;
    let (video, frame) = rest.split_once('_')?;
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    (is_number(video) && is_number(frame)).then(|| video.to_owned())
}

/// Paths relative to the root of what a folder holds, sorted, without hidden files.
fn entries(root: &Path, folder: &str) -> Result<Vec<String>, DatasetError> {
    let path = root.join(folder);
    let error = |reason: String| DatasetError::Folder { path: path.clone(), reason };
    let mut entries = Vec::new();
    for entry in fs::read_dir(&path).map_err(|source| error(source.to_string()))? {
        let name = entry.map_err(|source| error(source.to_string()))?.file_name();
        let Some(name) = name.to_str() else {
            return Err(error(format!("a file name that is not UTF-8, {}", name.to_string_lossy())));
        };
        if !name.starts_with('.') {
            entries.push(if folder.is_empty() { name.to_owned() } else { format!("{folder}/{name}") });
        }
    }
    entries.sort_unstable();
    Ok(entries)
}
