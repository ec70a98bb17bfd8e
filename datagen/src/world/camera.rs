//! What takes the scans of an episode: the simulated camera, or a recording.

use crate::episode::EpisodeConfig;
use crate::pose_error::PoseError;
use crate::recording::Recording;
use crate::registration::Displacements;
use crate::scene::{RenderScratch, Scene};
use geometry::{DepthImage, PinholeCamera, View};
use nalgebra::{Isometry3, Point3};

/// What stands before the planner.
#[allow(clippy::large_enum_variant, reason = "one per episode")]
pub(crate) enum ScanCamera<'a> {
    /// A camera in its scene.
    Simulated {
        scene: &'a Scene,
        config: &'a EpisodeConfig,
        scratch: RenderScratch,
        pose_error: Option<PoseError>,
        displacements: Option<Displacements>,
    },
    /// Scans that were recorded; each is taken once.
    Recorded { recording: &'a Recording, taken: Vec<bool> },
}

/// What the camera saw, and from where, as far as is known.
pub(crate) struct Shot {
    pub camera: PinholeCamera,
    pub depth: DepthImage,
    pub world_from_camera: Isometry3<f64>,
    /// Where it really was.
    pub actual: Isometry3<f64>,
    pub points: Vec<Point3<f64>>,
    /// Which scan of a recording it is.
    pub recorded: Option<usize>,
    /// Where the turntable stood, degrees.
    pub table_deg: Option<f64>,
}

impl Shot {
    /// Its points where they really are.
    pub fn true_points(&self) -> Vec<Point3<f64>> {
        let back = self.actual * self.world_from_camera.inverse();
        self.points.iter().map(|p| back * p).collect()
    }
}

impl ScanCamera<'_> {
    /// What comes is the first scan, which defines the frame.
    pub fn restart(&mut self) {
        if let Self::Simulated { pose_error, displacements, .. } = self {
            pose_error.iter_mut().for_each(PoseError::restart);
            displacements.iter_mut().for_each(Displacements::restart);
        }
    }

    /// Whether there is a scan from this view.
    pub fn can_take(&self, view: &View) -> bool {
        match self {
            Self::Simulated { .. } => true,
            Self::Recorded { .. } => self.recorded_from(view).is_some(),
        }
    }

    /// The first scan from this view that was not taken yet.
    fn recorded_from(&self, view: &View) -> Option<usize> {
        let Self::Recorded { recording, taken } = self else { return None };
        (0..taken.len()).find(|&i| !taken[i] && recording.views()[i] == *view)
    }

    /// A view, the camera at that pose. Nothing is seen from a degenerate one, and of a recording from where nothing is left.
    pub fn take(&mut self, view: &View, pose: &Isometry3<f64>) -> Shot {
        let index = self.recorded_from(view);
        match self {
            Self::Simulated { scene, config, scratch, pose_error, displacements } => {
                let camera = config.image.camera();
                let (actual, believed) = match pose_error {
                    Some(error) => error.poses(pose),
                    None => (*pose, *pose),
                };
                let world_from_camera = displacements.as_mut().map_or(believed, |d| d.next() * believed);
                let depth = match view.is_valid() {
                    true => scene.render(&camera, &actual, &config.render, scratch).clone(),
                    false => DepthImage::default(),
                };
                let points = depth.to_points(&camera, &world_from_camera);
                Shot { camera, depth, world_from_camera, actual, points, recorded: None, table_deg: None }
            }
            Self::Recorded { recording, taken } => {
                let Some(index) = index else {
                    let world_from_camera = *pose;
                    let (camera, depth) = Default::default();
                    let (actual, points) = (world_from_camera, Vec::new());
                    return Shot { camera, depth, world_from_camera, actual, points, recorded: None, table_deg: None };
                };
                taken[index] = true;
                let scan = recording.scan(index);
                let (camera, depth) = scan.image.clone().unwrap_or_default();
                let (world_from_camera, points) = (scan.world_from_camera, scan.points.clone());
                Shot {
                    camera,
                    depth,
                    world_from_camera,
                    actual: world_from_camera,
                    points,
                    recorded: Some(index),
                    table_deg: None,
                }
            }
        }
    }
}
