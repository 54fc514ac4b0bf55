//! Clouds that lie in images: which files belong to the one that stands for the cloud, and all of them as one byte string.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use descriptor::rgbd::{self, Camera, Images};
use serde::Deserialize;

use super::file::read_file;

/// How the RGB-D Object Dataset ends the name of a colour image that stands for a cloud.
const CROP: &str = "_crop.png";

/// Its camera, by the authors' `depthToCloud.m`: focal length in pixels, column and row of the optical axis in the whole
/// image, both counted from 1, metres that 1 in a depth image stands for.
const CROP_FOCAL_LENGTH: f64 = 570.3;
const CROP_CENTRE: [f64; 2] = [320.0, 240.0];
const CROP_DEPTH_UNIT: f64 = 0.001;

/// Names of the folders of masks in a BOP scene: of visible pixels, and of all that the object covers.
const MASKS: [&str; 2] = ["mask_visib", "mask"];

/// Millimetres are what BOP's `depth_scale` makes of depths.
const MILLIMETRE: f64 = 0.001;

/// Largest corner of a crop: of an image of more pixels than is read.
const MAX_CORNER: u32 = 1 << 24;

/// The files of a cloud in images.
enum Files {
    /// `<name>_crop.png`, `<name>_depthcrop.png`, `<name>_maskcrop.png`, `<name>_loc.txt`.
    Crop { colour: PathBuf, depth: PathBuf, mask: PathBuf, corner: PathBuf },
    /// `rgb/<image>.png`, `depth/<image>.png`, `mask_visib/<image>_<object>.png`, `scene_camera.json` of a BOP scene.
    Scene { colour: PathBuf, depth: PathBuf, mask: PathBuf, camera: PathBuf, image: u64 },
}

/// The files of the cloud that one of them stands for; `None` of a file that is a cloud by itself.
fn files(file: &Path) -> Option<Files> {
    let (folder, name) = (file.parent()?, file.file_name()?.to_str()?);
    if let Some(stem) = name.strip_suffix(CROP) {
        let beside = |ending: &str| folder.join(format!("{stem}{ending}"));
        return Some(Files::Crop {
            colour: file.to_owned(),
            depth: beside("_depthcrop.png"),
            mask: beside("_maskcrop.png"),
            corner: beside("_loc.txt"),
        });
    }
    let is_mask = MASKS.iter().any(|name| folder.file_name().is_some_and(|folder| folder == *name));
    let (image, _) = mask_numbers(name).filter(|_| is_mask)?;
    let scene = folder.parent()?;
    let of_image = format!("{}.png", name.split_once('_')?.0);
    Some(Files::Scene {
        colour: scene.join("rgb").join(&of_image),
        depth: scene.join("depth").join(&of_image),
        mask: file.to_owned(),
        camera: scene.join("scene_camera.json"),
        image,
    })
}

/// The numbers of image and object in the name of a mask.
pub(super) fn mask_numbers(name: &str) -> Option<(u64, u64)> {
    let (image, object) = name.strip_suffix(".png")?.split_once('_')?;
    let number = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit()).then(|| text.parse().ok())?;
    Some((number(image)?, number(object)?))
}

/// Other files that belong to the cloud of a file.
pub(super) fn others(file: &Path) -> Vec<PathBuf> {
    match files(file) {
        Some(Files::Crop { depth, mask, corner, .. }) => vec![depth, mask, corner],
        Some(Files::Scene { colour, depth, camera, .. }) => vec![colour, depth, camera],
        None => Vec::new(),
    }
}

/// The bytes of the cloud that a file stands for, or in a line why there are none: of PCD and PLY those of the file, of
/// images those that [`rgbd::write`] makes of all of them. They are what the cloud's digest covers, and what workers get.
pub(crate) fn cloud_bytes(file: &Path) -> Result<Vec<u8>, String> {
    let Some(files) = files(file) else { return read_file(file) };
    // A line about a file that belongs to the cloud; the cloud is named before it.
    let of = |file: &Path, reason: String| format!("{}: {reason}", file.display());
    let read = |file: &Path| read_file(file).map_err(|reason| of(file, reason));
    let (camera, [colour, depth, mask]) = match files {
        Files::Crop { colour, depth, mask, corner } => {
            let camera = crop_camera(&read(&corner)?).map_err(|reason| of(&corner, reason))?;
            (camera, [colour, depth, mask])
        }
        Files::Scene { colour, depth, mask, camera: file, image } => {
            let camera = scene_camera(&read(&file)?, image).map_err(|reason| of(&file, reason))?;
            (camera, [colour, depth, mask])
        }
    };
    let (colour, depth, mask) = (read(&colour)?, read(&depth)?, read(&mask)?);
    Ok(rgbd::write(&camera, Images { colour: &colour, depth: &depth, mask: &mask }))
}

/// The camera of a crop, whose upper left corner a text names: its column and row in the whole image, from 1.
fn crop_camera(bytes: &[u8]) -> Result<Camera, String> {
    let text = String::from_utf8_lossy(bytes);
    let numbers = text.trim().split_once(',').map(|(column, row)| [column, row]);
    let numbers = numbers.map(|numbers| numbers.map(|number| number.trim().parse::<u32>().ok()));
    let Some([Some(column), Some(row)]) = numbers else {
        let got: String = text.trim().chars().take(40).collect();
        return Err(format!("column,row expected, got {}", got.escape_debug()));
    };
    if let Some(got) = [column, row].into_iter().find(|&number| number == 0 || number > MAX_CORNER) {
        return Err(format!("numbers from 1 to {MAX_CORNER} expected, got {got}"));
    }
    let [cx, cy] = CROP_CENTRE;
    Ok(Camera {
        focal_length: [CROP_FOCAL_LENGTH; 2],
        // Columns of the crop are counted from 0.
        centre: [cx - f64::from(column), cy - f64::from(row)],
        depth_unit: CROP_DEPTH_UNIT,
    })
}

/// What `scene_camera.json` says of an image.
#[derive(Deserialize)]
struct SceneCamera {
    /// The matrix of the camera, row by row.
    #[serde(rename = "cam_K")]
    matrix: [f64; 9],
    /// What a depth is multiplied by to be in millimetres.
    depth_scale: f64,
}

/// The camera of an image by the text of its scene.
fn scene_camera(bytes: &[u8], image: u64) -> Result<Camera, String> {
    let cameras: HashMap<u64, SceneCamera> = serde_json::from_slice(bytes)
        .map_err(|error| format!("cam_K and depth_scale of each image expected, got: {error}"))?;
    let Some(SceneCamera { matrix, depth_scale }) = cameras.get(&image) else {
        return Err(format!("image {image} expected, got {} others", cameras.len()));
    };
    let [fx, skew, cx, zero, fy, cy, last @ ..] = *matrix;
    if [skew, zero] != [0.0; 2] || last != [0.0, 0.0, 1.0] {
        return Err(format!(
            "cam_K of image {image} as fx, 0, cx, 0, fy, cy, 0, 0, 1 expected, got {matrix:?}"
        ));
    }
    Ok(Camera { focal_length: [fx, fy], centre: [cx, cy], depth_unit: depth_scale * MILLIMETRE })
}

/// Whether a text names the corner of a crop, or a camera of the image 1.
pub(crate) fn reads_camera(bytes: &[u8]) -> bool {
    crop_camera(bytes).is_ok() || scene_camera(bytes, 1).is_ok()
}
