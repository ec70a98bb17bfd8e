//! The simulated cell of an episode: its camera, what the planner is told, and what is true.

use crate::episode::{EpisodeConfig, EpisodeEvidence};
use crate::pose_error::PoseError;
use crate::scene::{RenderScratch, Scene};
use geometry::{DepthImage, PinholeCamera, PointCloud, View, coverage};
use nalgebra::{Isometry3, Point3};
use planning::accumulate::{averaged, reference_surface};
use planning::config::CameraConfig;
use planning::{Accumulate, Misses, Scan, Session, SessionConfig};

/// The camera in its scene.
pub(crate) struct ScanCamera<'a> {
    pub scene: &'a Scene,
    pub config: &'a EpisodeConfig,
    pub scratch: RenderScratch,
    pub pose_error: Option<PoseError>,
}

/// What the camera saw, and from where, as far as is known.
pub(crate) struct Shot {
    camera: PinholeCamera,
    depth: DepthImage,
    world_from_camera: Isometry3<f64>,
    pub points: Vec<Point3<f64>>,
}

impl ScanCamera<'_> {
    /// Nothing is seen from a degenerate view.
    pub fn take(&mut self, view: &View) -> Shot {
        let camera = self.config.image.camera();
        let commanded = view.world_from_camera();
        let (actual, world_from_camera) = match &mut self.pose_error {
            Some(error) => error.poses(&commanded),
            None => (commanded, commanded),
        };
        let depth = match view.is_valid() {
            true => self.scene.render(&camera, &actual, &self.config.render, &mut self.scratch).clone(),
            false => DepthImage::default(),
        };
        let points = depth.to_points(&camera, &world_from_camera);
        Shot { camera, depth, world_from_camera, points }
    }
}

/// The planner's session beside the truth.
pub(crate) struct World<'a> {
    pub session: Session,
    config: &'a EpisodeConfig,
    samples: &'a [Point3<f64>],
    reference: Vec<Point3<f64>>,
    /// What metrics are taken of: the points measured, averaged, whatever the planner sees. Empty where it sees the same.
    measured: PointCloud,
    /// Voxel edge of what is measured, metres: the spacing of the first scan.
    pub grid_size: f64,
    first: bool,
    /// All points, for [`EpisodeEvidence::Merged`].
    all: Vec<Point3<f64>>,
    /// Share of the reference surface that is covered.
    pub covered: f64,
    /// Points of the first scan.
    pub first_points: usize,
}

impl<'a> World<'a> {
    pub fn new(session: Session, config: &'a EpisodeConfig, samples: &'a [Point3<f64>]) -> Self {
        Self {
            session,
            config,
            samples,
            reference: Vec::new(),
            measured: PointCloud::default(),
            grid_size: 0.0,
            first: true,
            all: Vec::new(),
            covered: 0.0,
            first_points: 0,
        }
    }

    /// The averaged samples of the true surface.
    pub fn reference(&self) -> &[Point3<f64>] {
        match self.config.accumulate {
            Accumulate::Matched => self.session.reference(),
            _ => &self.reference,
        }
    }

    /// What metrics are taken of.
    pub fn cloud(&self) -> &PointCloud {
        if self.sees_what_is_measured() { self.session.cloud() } else { &self.measured }
    }

    fn sees_what_is_measured(&self) -> bool {
        self.config.accumulate != Accumulate::Thinned && self.config.evidence != EpisodeEvidence::Merged
    }

    /// Lets `with` decide: the session, the reference surface, and the share of it that is covered.
    pub fn decide<T>(&mut self, with: impl FnOnce(&mut Session, &[Point3<f64>], f64) -> T) -> T {
        match self.config.accumulate {
            Accumulate::Matched => {
                let reference = self.session.reference().to_vec();
                with(&mut self.session, &reference, self.covered)
            }
            _ => with(&mut self.session, &self.reference, self.covered),
        }
    }

    /// Starts over with a first scan.
    pub fn begin(&mut self, shot: Shot) {
        self.session.reset();
        self.measured = PointCloud::default();
        self.all.clear();
        self.first = true;
        self.first_points = shot.points.len();
        self.add(shot);
    }

    /// Adds a scan. One without points tells planners what is empty.
    pub fn add(&mut self, shot: Shot) {
        let empty = shot.points.is_empty();
        let points = if self.sees_what_is_measured() { Vec::new() } else { shot.points.clone() };
        let scan = match self.config.evidence {
            EpisodeEvidence::DepthWithBackground => depth_scan(shot, Misses::Free),
            EpisodeEvidence::Depth => depth_scan(shot, Misses::Unknown),
            EpisodeEvidence::CameraPositions => {
                let from = Some(Point3::from(shot.world_from_camera.translation.vector));
                cloud_scan(shot.points, from)
            }
            EpisodeEvidence::Clouds => cloud_scan(shot.points, None),
            EpisodeEvidence::Merged => {
                self.session.reset();
                self.all.extend_from_slice(&shot.points);
                cloud_scan(self.all.clone(), None)
            }
        };
        // The settings refuse no scan.
        let _ = self.session.add_scan(scan);
        if self.first {
            self.first = false;
            self.grid_size = self.session.state().grid_size;
            if self.config.accumulate != Accumulate::Matched {
                self.reference = reference_surface(self.samples, self.grid_size, self.config.accumulate);
            }
        }
        if empty {
            return;
        }
        if !self.sees_what_is_measured() {
            let scan = PointCloud { points, normals: Vec::new() };
            self.measured = averaged(&self.measured, &scan, self.grid_size, self.config.accumulate.voxel_origin());
        }
        self.covered = match self.config.accumulate {
            Accumulate::Matched => self.cloud().len() as f64 / self.reference().len().max(1) as f64,
            _ => coverage(&self.cloud().points, &self.reference, self.config.tolerance_m),
        };
    }
}

fn depth_scan(shot: Shot, misses: Misses) -> Scan {
    Scan::Depth { camera: shot.camera, depth: shot.depth, world_from_camera: shot.world_from_camera, misses }
}

fn cloud_scan(points: Vec<Point3<f64>>, from: Option<Point3<f64>>) -> Scan {
    Scan::Cloud { cloud: PointCloud { points, normals: Vec::new() }, from }
}

/// The session of an episode: a robot's where scans are thinned; else with all points of every scan.
pub(crate) fn episode_session(config: &EpisodeConfig, samples: &[Point3<f64>]) -> Session {
    let image = &config.image;
    let camera =
        CameraConfig { width: image.width, height: image.height, fov_y_deg: image.fov_y_deg, intrinsics: None };
    let robot = SessionConfig {
        working_distance_m: config.working_distance_m,
        tolerance_m: config.tolerance_m,
        accumulate: config.accumulate,
        min_points: 0,
        camera,
        ..SessionConfig::default()
    };
    let all_points = SessionConfig { max_points: 0, outlier_factor: 0.0, ..robot.clone() };
    match config.accumulate {
        Accumulate::Matched => Session::matching(all_points, samples.into()),
        Accumulate::Averaged => Session::unchecked(all_points),
        Accumulate::Thinned => Session::unchecked(robot),
    }
}
