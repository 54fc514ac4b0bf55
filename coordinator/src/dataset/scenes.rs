//! Scenes of the BOP benchmark: which objects are in which images, by `scene_gt.json`.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use super::error::DatasetError;
use super::file::read_file;
use super::images::mask_numbers;

/// What a folder is a scene by.
const OBJECTS: &str = "scene_gt.json";

/// Scenes lie in the root, or in folders of it.
const MAX_DEPTH: usize = 2;

/// Objects of each image, in the order of the file.
type Objects = BTreeMap<u64, Vec<SceneObject>>;

#[derive(Debug, Deserialize)]
struct SceneObject {
    #[serde(rename = "obj_id")]
    number: u64,
}

/// The scenes below a root, by their paths.
#[derive(Debug)]
pub(super) struct Scenes(BTreeMap<String, Objects>);

/// What is known of a cloud of a scene.
pub(super) struct SceneCloud {
    /// The object, which is a category of its own.
    pub instance: String,
    /// The scene, which was recorded in one go.
    pub sequence: String,
}

impl Scenes {
    /// Reads what is in each scene. `entries` lists a folder of the root, by paths relative to it.
    pub fn read(
        root: &Path,
        entries: impl Fn(&str) -> Result<Vec<String>, DatasetError>,
    ) -> Result<Self, DatasetError> {
        let (mut folders, mut scenes) = (vec![(String::new(), 0)], BTreeMap::new());
        while let Some((folder, depth)) = folders.pop() {
            for path in entries(&folder)? {
                let full = root.join(&path);
                if !full.is_dir() {
                    continue;
                }
                let file = full.join(OBJECTS);
                if file.is_file() {
                    scenes.insert(path, objects(&file)?);
                } else if depth + 1 < MAX_DEPTH {
                    folders.push((path, depth + 1));
                }
            }
        }
        Ok(Self(scenes))
    }

    /// The paths of all masks of visible pixels, scene by scene, image by image.
    pub fn masks(&self) -> impl Iterator<Item = String> {
        let of_image = |scene: &str, image: u64, objects: usize| {
            let scene = scene.to_owned();
            (0..objects).map(move |object| format!("{scene}/mask_visib/{image:06}_{object:06}.png"))
        };
        let of_scene = move |(scene, images): (&String, &Objects)| {
            let masks = images.iter().flat_map(|(&image, objects)| of_image(scene, image, objects.len()));
            masks.collect::<Vec<_>>()
        };
        self.0.iter().flat_map(of_scene)
    }

    /// What is known of the cloud that a mask stands for; `None` if no scene has it.
    pub fn cloud(&self, path: &str) -> Option<SceneCloud> {
        let (scene, name) = path.split_once("/mask_visib/").or_else(|| path.split_once("/mask/"))?;
        let (image, object) = mask_numbers(name)?;
        let SceneObject { number } = self.0.get(scene)?.get(&image)?.get(usize::try_from(object).ok()?)?;
        Some(SceneCloud { instance: format!("obj_{number:06}"), sequence: scene.to_owned() })
    }
}

fn objects(file: &Path) -> Result<Objects, DatasetError> {
    let read = read_file(file).and_then(|bytes| from_json(&bytes).map_err(|error| error.to_string()));
    read.map_err(|got| DatasetError::Scene { file: file.to_owned(), got })
}

fn from_json(bytes: &[u8]) -> serde_json::Result<Objects> {
    serde_json::from_slice(bytes)
}

/// Whether a text names the objects of images.
pub(crate) fn reads_objects(bytes: &[u8]) -> bool {
    from_json(bytes).is_ok()
}
