//! The cell of an episode, simulated or recorded: its camera, what the planner may know, and the truth.

mod camera;

use crate::episode::{EpisodeConfig, EpisodeEvidence, Stage};
use crate::recording::Recording;
use crate::registration::{EpisodeRegistration, Placed, RegistrationOutcome};
use geometry::{PointCloud, View, coverage, overlap};
use nalgebra::{Isometry3, Point3};
use planning::accumulate::{averaged, reference_surface};
use planning::config::CameraConfig;
use planning::{Accumulate, Budget, NoReturn, Reading, Scan, ScanReport, Session, SessionConfig, SessionError};
use std::borrow::Cow;

pub(crate) use camera::{ScanCamera, Shot};

/// The planner's session beside the truth.
pub(crate) struct World<'a> {
    pub session: Session,
    config: &'a EpisodeConfig,
    /// What the session may know about a scan; `None`: nothing at all.
    evidence: Option<EpisodeEvidence>,
    truth: Truth<'a>,
    /// Voxel edge of what is measured, metres: the spacing of the first scan.
    pub grid_size: f64,
    first: bool,
    /// Where the scans really are, where they have to be registered.
    placed: Option<Placed>,
    /// All points, for [`EpisodeEvidence::Merged`].
    all: Vec<Point3<f64>>,
    /// Share of the reference surface that is covered.
    pub covered: f64,
    /// Points of the first scan.
    pub first_points: usize,
}

/// What coverage is measured by.
enum Truth<'a> {
    /// The surface of an object.
    Surface {
        samples: &'a [Point3<f64>],
        /// Samples averaged like what is measured.
        reference: Vec<Point3<f64>>,
        /// What metrics are taken of: the points measured, averaged, whatever the planner sees. Empty where it sees the same.
        measured: PointCloud,
    },
    /// The union of recorded scans, and which of its points are covered.
    Recorded { recording: &'a Recording, covered: Vec<bool> },
}

impl<'a> World<'a> {
    pub fn new(session: Session, config: &'a EpisodeConfig, stage: &Stage<'a>) -> Self {
        let simulated = matches!(stage, Stage::Simulated { .. });
        let (truth, evidence) = match *stage {
            Stage::Simulated { samples, .. } => {
                let (reference, measured) = Default::default();
                (Truth::Surface { samples, reference, measured }, Some(config.evidence))
            }
            Stage::Recorded { recording, evidence, .. } => {
                (Truth::Recorded { recording, covered: vec![false; recording.reference().len()] }, evidence)
            }
        };
        Self {
            session,
            config,
            evidence,
            truth,
            grid_size: 0.0,
            first: true,
            placed: (config.registration.is_some() && simulated).then(Placed::default),
            all: Vec::new(),
            covered: 0.0,
            first_points: 0,
        }
    }

    /// The surface that coverage is a share of.
    pub fn reference(&self) -> &[Point3<f64>] {
        match &self.truth {
            Truth::Surface { .. } if self.config.accumulate == Accumulate::Matched => self.session.reference(),
            Truth::Surface { reference, .. } => reference,
            Truth::Recorded { recording, .. } => recording.reference(),
        }
    }

    /// What metrics are taken of; of a recording what is covered of its surface.
    pub fn cloud(&self) -> Cow<'_, PointCloud> {
        match &self.truth {
            Truth::Surface { .. } if self.sees_what_is_measured() => Cow::Borrowed(self.session.cloud()),
            Truth::Surface { measured, .. } => Cow::Borrowed(measured),
            Truth::Recorded { recording, covered } => {
                let points = recording.reference().iter().zip(covered).filter(|(_, c)| **c).map(|(p, _)| *p).collect();
                Cow::Owned(PointCloud { points, normals: Vec::new() })
            }
        }
    }

    /// The view that was looked at connects a scan that waits.
    pub fn bridges(&mut self) {
        self.placed.iter_mut().for_each(Placed::bridges);
    }

    /// Share of a scan from `view` that was seen before; `None` for an empty one.
    pub fn overlap(&mut self, view: &View, shot: &Shot) -> Option<f64> {
        if let Some(placed) = &mut self.placed {
            return placed.look(view, shot, self.session.state(), &self.session.config().registration);
        }
        match (&self.truth, shot.recorded) {
            (Truth::Surface { .. }, _) => {
                overlap(&self.above_support(shot.points[..].into()), &self.cloud().points, self.config.tolerance_m)
            }
            (Truth::Recorded { recording, covered }, Some(scan)) => {
                let covers = recording.covered_by(scan);
                let again = covers.iter().filter(|&&i| covered[i as usize]).count();
                (!covers.is_empty()).then(|| again as f64 / covers.len() as f64)
            }
            (Truth::Recorded { .. }, None) => None,
        }
    }

    /// Points of the object, not of what it stands on, as far as the session knows that.
    fn above_support<'p>(&self, points: Cow<'p, [Point3<f64>]>) -> Cow<'p, [Point3<f64>]> {
        let Some(plane) = self.session.support() else { return points };
        let margin = self.session.config().support_margin_m;
        points.iter().copied().filter(|p| plane.height(p) > margin).collect()
    }

    fn sees_what_is_measured(&self) -> bool {
        self.config.accumulate != Accumulate::Thinned && self.evidence != Some(EpisodeEvidence::Merged)
    }

    /// Lets `with` decide: the session, the reference surface, and the share of it that is covered.
    pub fn decide<T>(&mut self, with: impl FnOnce(&mut Session, &[Point3<f64>], f64) -> T) -> T {
        match &self.truth {
            Truth::Surface { .. } if self.config.accumulate == Accumulate::Matched => {
                let reference = self.session.reference().to_vec();
                with(&mut self.session, &reference, self.covered)
            }
            Truth::Surface { reference, .. } => with(&mut self.session, reference, self.covered),
            Truth::Recorded { recording, .. } => with(&mut self.session, recording.reference(), self.covered),
        }
    }

    /// Starts over with a first scan.
    ///
    /// # Errors
    /// As [`World::add`].
    pub fn begin(&mut self, shot: Shot) -> Result<(), SessionError> {
        self.session.reset();
        match &mut self.truth {
            Truth::Surface { measured, .. } => *measured = PointCloud::default(),
            Truth::Recorded { covered, .. } => covered.fill(false),
        }
        self.all.clear();
        self.first = true;
        self.first_points = shot.points.len();
        self.add(shot)
    }

    /// Takes a view, with the table where the session turns it to.
    pub fn shoot(&self, camera: &mut ScanCamera, view: &View) -> Shot {
        let turns = self.session.config().turntable.is_some();
        let table_deg = turns.then(|| self.session.place(view).table.map(|table| table.stop_deg)).flatten();
        let pose = self.session.camera_pose(view, table_deg);
        Shot { table_deg, ..camera.take(view, &pose) }
    }

    /// Adds a scan. A scan without points shows planners what is empty.
    ///
    /// # Errors
    /// A recorded scan that the session refuses.
    pub fn add(&mut self, shot: Shot) -> Result<(), SessionError> {
        let (empty, recorded) = (shot.points.is_empty(), shot.recorded);
        let simulated = matches!(self.truth, Truth::Surface { .. });
        let keep = simulated && !self.sees_what_is_measured();
        let points = if keep || self.placed.is_some() { shot.points.clone() } else { Vec::new() };
        let camera = Point3::from(shot.actual.translation.vector);
        let told = self.tell(shot);
        let first = self.first;
        if std::mem::take(&mut self.first) {
            self.grid_size = self.session.state().grid_size;
            if let Truth::Surface { samples, reference, .. } = &mut self.truth
                && self.config.accumulate != Accumulate::Matched
            {
                *reference = reference_surface(samples, self.grid_size, self.config.accumulate);
            }
        }
        let points = match &mut self.placed {
            None => points,
            Some(placed) if first => {
                placed.begin(points.clone(), &camera, self.grid_size);
                points
            }
            Some(_) if empty => points,
            Some(placed) => {
                let found = told.as_ref().ok().and_then(|report| report.as_ref()?.registration.as_ref());
                let waits = found.and_then(|found| found.refused.as_ref());
                let lost = match &told {
                    Err(SessionError::Unregistered { why }) => Some(why),
                    _ => None,
                };
                if let Some(why) = lost.or(waits) {
                    placed.refuse(why, waits.map(|_| (self.session.num_scans(), points)));
                    return Ok(());
                }
                let correction = found.map_or_else(Isometry3::identity, |found| found.correction);
                let number = self.session.num_scans();
                let points = placed.add(number, &points, &correction, self.grid_size, self.config.tolerance_m);
                placed.take_in(|number| self.session.correction(number), self.grid_size, self.config.tolerance_m);
                placed.follow(self.session.corrections(), self.grid_size, self.config.tolerance_m);
                points
            }
        };
        let points = self.above_support(points.into()).into_owned();
        let refused = told.err();
        match &mut self.truth {
            // The settings of an episode refuse no scan; those of `infer --object` one that shows nothing.
            Truth::Surface { .. } if empty => return Ok(()),
            Truth::Surface { measured, .. } if keep => {
                let scan = PointCloud { points, normals: Vec::new() };
                *measured = averaged(measured, &scan, self.grid_size, self.config.accumulate.voxel_origin());
            }
            Truth::Surface { .. } => {}
            Truth::Recorded { recording, covered } => {
                let covers = recorded.map_or(&[][..], |scan| recording.covered_by(scan));
                covers.iter().for_each(|&i| covered[i as usize] = true);
                self.covered = covered.iter().filter(|c| **c).count() as f64 / covered.len().max(1) as f64;
                return refused.map_or(Ok(()), Err);
            }
        }
        self.covered = match self.config.accumulate {
            _ if self.placed.is_some() => coverage(self.sound(), self.reference(), self.config.tolerance_m),
            Accumulate::Matched => self.cloud().len() as f64 / self.reference().len().max(1) as f64,
            _ => coverage(&self.cloud().points, self.reference(), self.config.tolerance_m),
        };
        Ok(())
    }

    /// Points that are where they should be, where scans have to be registered.
    fn sound(&self) -> &[Point3<f64>] {
        self.placed.as_ref().map_or(&[], |placed| &placed.sound.points)
    }

    /// How the scans were registered, if they had to be.
    pub fn registration(&self) -> Option<RegistrationOutcome> {
        self.placed.as_ref().map(Placed::outcome)
    }

    /// Passes the session what it may know about a scan; `None` if that is nothing.
    fn tell(&mut self, shot: Shot) -> Result<Option<ScanReport>, SessionError> {
        let table_angle_deg = shot.table_deg;
        let scan = match self.evidence {
            None => return Ok(None),
            Some(EpisodeEvidence::DepthWithBackground) => depth_scan(shot, NoReturn::Free),
            Some(EpisodeEvidence::Depth) => depth_scan(shot, NoReturn::Unknown),
            Some(EpisodeEvidence::CameraPositions) => {
                let from = Some(Point3::from(shot.world_from_camera.translation.vector));
                cloud_scan(shot.points, from)
            }
            Some(EpisodeEvidence::Clouds) => cloud_scan(shot.points, None),
            Some(EpisodeEvidence::Merged) => {
                self.session.reset();
                self.all.extend_from_slice(&shot.points);
                cloud_scan(self.all.clone(), None)
            }
        };
        // As a cell gives it: in its own frame, with the angle of the table.
        let turned = self.session.config().turntable.as_ref().zip(table_angle_deg);
        let scan = match turned {
            Some((table, angle)) => scan.moved(&table.cell_from_object(angle)),
            None => scan,
        };
        let reading = Reading { table_angle_deg, ..Reading::default() };
        self.session.add_scan_within(scan, reading, &Budget::default()).map(Some)
    }
}

fn depth_scan(shot: Shot, misses: NoReturn) -> Scan {
    Scan::Depth { camera: shot.camera, depth: shot.depth, world_from_camera: shot.world_from_camera, misses }
}

fn cloud_scan(points: Vec<Point3<f64>>, from: Option<Point3<f64>>) -> Scan {
    Scan::Cloud { cloud: PointCloud { points, normals: Vec::new() }, from }
}

/// The session of an episode: a robot's where scans are thinned; else with all points of every scan.
pub fn episode_session(config: &EpisodeConfig, samples: &[Point3<f64>]) -> Session {
    let image = &config.image;
    let camera =
        CameraConfig { width: image.width, height: image.height, fov_y_deg: image.fov_y_deg, intrinsics: None };
    let robot = SessionConfig {
        working_distance_m: config.working_distance_m,
        tolerance_m: config.tolerance_m,
        accumulate: config.accumulate,
        min_points: 0,
        camera,
        registration: config.registration.as_ref().map(EpisodeRegistration::session).unwrap_or_default(),
        ..SessionConfig::default()
    };
    let all_points = SessionConfig { max_points: 0, outlier_factor: 0.0, ..robot.clone() };
    match config.accumulate {
        Accumulate::Matched => Session::matching(all_points, samples.into()),
        Accumulate::Averaged => Session::unchecked(all_points),
        Accumulate::Thinned => Session::unchecked(robot),
    }
}
