//! Synthetic data: seeded virtual RGB-D views of household-like objects, laid out as a real data set.

mod camera;
mod catalogue;
mod draw;
mod shape;
mod texture;

#[cfg(test)]
mod tests;

use camera::{Light, Occluder, Pose, Scene, Sensor};
pub use catalogue::{SynthObject, catalogue};
use draw::Draw;
pub use shape::{Profile, Shape};
pub use texture::{Hsv, Pattern, Texture};

use crate::Cloud;

/// Raised whenever the same settings would give other clouds, names or splits.
pub const GENERATOR_VERSION: u32 = 1;

/// Which synthetic data set: equal settings give equal files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SynthSettings {
    objects: u32,
    views: u32,
    seed: u64,
}

/// Why settings make no data set.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SynthError {
    /// One object cannot be mistaken for another; a million clouds are no test set any more.
    #[error("objects: number outside 2 to 1000, got {0}\nchoose a number inside these limits")]
    Objects(u32),
    /// Each object needs a view in each of four splits.
    #[error("views: number outside 4 to 1000, got {0}\nchoose a number inside these limits")]
    Views(u32),
}

impl SynthSettings {
    /// Checks the limits: 2 to 1000 objects, 4 to 1000 views of each. Any seed is valid.
    pub fn new(objects: u32, views: u32, seed: u64) -> Result<Self, SynthError> {
        if !(2..=1000).contains(&objects) {
            return Err(SynthError::Objects(objects));
        }
        if !(4..=1000).contains(&views) {
            return Err(SynthError::Views(views));
        }
        Ok(Self { objects, views, seed })
    }

    /// Number of objects (instances).
    pub fn objects(&self) -> u32 {
        self.objects
    }

    /// Number of views of each object.
    pub fn views(&self) -> u32 {
        self.views
    }

    /// The seed that everything is drawn from.
    pub fn seed(&self) -> u64 {
        self.seed
    }
}

impl Default for SynthSettings {
    /// 18 objects, 24 views of each: made and searched within a minute.
    fn default() -> Self {
        Self { objects: 18, views: 24, seed: 1 }
    }
}

/// Videos of each object: their number and the camera's height, degrees above the level. Numbers and heights are
/// those of the UW RGB-D Object Dataset.
const VIDEOS: [(u32, f64); 3] = [(1, 30.0), (2, 45.0), (4, 60.0)];

/// The video whose views are for the final test, as in the paper.
const TEST_VIDEO: u32 = 2;

/// Number and camera height of the video that the view belongs to, and its frame, from 1.
fn place(view: u32) -> (u32, f64, u32) {
    let (video, elevation) = VIDEOS[view as usize % VIDEOS.len()];
    (video, elevation, view / VIDEOS.len() as u32 + 1)
}

impl SynthObject {
    /// Path of one view below the data set's root: `<category>/<instance>/<instance>_<video>_<frame>.pcd`.
    pub fn path(&self, view: u32) -> String {
        let (video, _, frame) = place(view);
        format!("{}/{}/{}_{video}_{frame}.pcd", self.category, self.instance, self.instance)
    }
}

/// One view of one object, seen by a Kinect-like camera at 0.7 to 1.2 m: coloured points in metres in the camera's
/// frame (x right, y down, z forward, the viewpoint at 0). The same settings, object and view give the same bits.
pub fn render(settings: &SynthSettings, object: &SynthObject, view: u32) -> Cloud {
    let indices = [u64::from(object.index), u64::from(view)];
    scene(settings, object, view).shoot(&mut Draw::new(settings.seed, "synth sensor", &indices))
}

/// The picture behind a view. Pose, light and occluder have streams of their own, so that each can be changed alone.
fn scene<'a>(settings: &SynthSettings, object: &'a SynthObject, view: u32) -> Scene<'a> {
    let (_, elevation, frame) = place(view);
    let indices = [u64::from(object.index), u64::from(view)];
    let draw = |purpose| Draw::new(settings.seed, purpose, &indices);
    let mut pose_draw = draw("synth pose");
    let frames = settings.views.div_ceil(VIDEOS.len() as u32);
    let turn = 360.0 * (f64::from(frame - 1) + pose_draw.between(-0.3, 0.3)) / f64::from(frames);
    let pose = Pose::around(elevation, turn, &mut pose_draw);
    Scene {
        shape: &object.shape,
        texture: &object.texture,
        light: Light::random(&mut draw("synth light")),
        occluder: Occluder::random(&pose, object.shape.bound(), &mut draw("synth occlusion")),
        pose,
        sensor: Sensor::KINECT,
    }
}

/// Paths of all views, each in one of four lists.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SynthSplits {
    /// Queries of the training fitness.
    pub train1: Vec<String>,
    /// Database of the training fitness.
    pub train2: Vec<String>,
    /// Queries of the validation.
    pub validation: Vec<String>,
    /// Queries of the final test.
    pub test: Vec<String>,
}

/// The four lists, in the order of the catalogue: video 2 is the test; of the other videos' views of each object,
/// drawn at random, a quarter is for validation and the rest is halved.
pub fn splits(settings: &SynthSettings) -> SynthSplits {
    let mut splits = SynthSplits::default();
    for object in catalogue(settings) {
        let (test, mut rest): (Vec<u32>, Vec<u32>) =
            (0..settings.views).partition(|&view| place(view).0 == TEST_VIDEO);
        Draw::new(settings.seed, "synth splits", &[u64::from(object.index)]).shuffle(&mut rest);
        // Four views or more leave three or more here: no part is empty.
        let (validation, train) = rest.split_at((rest.len() / 4).max(1));
        let (train1, train2) = train.split_at(train.len().div_ceil(2));
        for (list, views) in [
            (&mut splits.train1, train1),
            (&mut splits.train2, train2),
            (&mut splits.validation, validation),
            (&mut splits.test, &test[..]),
        ] {
            let mut views = views.to_vec();
            views.sort_unstable();
            list.extend(views.iter().map(|&view| object.path(view)));
        }
    }
    splits
}
