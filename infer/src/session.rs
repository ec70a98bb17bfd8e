//! A robot's loop: add scans, ask for the next view, undo, reset.

use crate::answer::{Answer, Candidate, CloudSummary, Stop, length};
use crate::choose::{ChooseError, Evidence, Network, Planners, choose};
use crate::config::{ConfigError, InferConfig};
use crate::constraints::{Surroundings, count_exclusions};
use crate::pose::{Pose, world_from_camera};
use crate::scan::{MIN_POINTS, PreparedScan, Scan, ScanReport, neighborhoods, prepare};
use crate::{overlap, stop, thin};
use geometry::{
    BoundaryConfig, Neighborhoods, PointCloud, RankedView, ScanState, boundary_among, orient_normals_among, rng,
};
use nalgebra::Point3;
use std::collections::BTreeSet;

/// Neighbours over which the sign of normals is carried where no camera is known (geometry, section 7).
const ORIENTATION_NEIGHBORS: usize = 10;

/// Why no answer can be given.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SessionError {
    /// A setting is out of range.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The planner asked for cannot work.
    #[error(transparent)]
    Choose(#[from] ChooseError),
    /// Nothing to plan on.
    #[error("there is no scan yet: add one first")]
    NoScan,
    /// A scan with too few usable points.
    #[error("too few points to plan on: {}, at least {MIN_POINTS} are needed", .0.describe())]
    TooFewPoints(ScanReport),
    /// Travel is limited or weighed, from nowhere.
    #[error(
        "max_travel_m and travel_weight_per_m need the camera's position: set constraints.current_position_m, \
         or give the position that the last scan was taken from (--from x,y,z)"
    )]
    NoCurrentPosition,
}

/// The scans of one object so far, and the planners' memory of them.
#[derive(Clone, Debug)]
pub struct Session {
    config: InferConfig,
    planners: Planners,
    scans: Vec<PreparedScan>,
    state: ScanState,
}

impl Session {
    /// An empty session. Without a network, `auto` falls back to `farthest` where only clouds are known.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn new(config: InferConfig, network: Option<Network>) -> Result<Self, SessionError> {
        config.check()?;
        let planners = Planners::new(network, &config);
        Ok(Self { config, planners, scans: Vec::new(), state: ScanState::default() })
    }

    /// The settings.
    pub fn config(&self) -> &InferConfig {
        &self.config
    }

    /// Changes the settings; the scans are kept as they were prepared.
    ///
    /// # Errors
    /// A setting out of range: the old ones stay.
    pub fn configure(&mut self, config: InferConfig) -> Result<(), SessionError> {
        config.check()?;
        self.planners = Planners::new(self.planners.network.take(), &config);
        self.config = config;
        self.rebuild(None);
        Ok(())
    }

    /// Adds a scan and says what became of its points.
    ///
    /// # Errors
    /// Too few usable points: the session stays as it was.
    pub fn add_scan(&mut self, scan: Scan) -> Result<ScanReport, SessionError> {
        let (prepared, near) = prepare(scan, &self.config).map_err(SessionError::TooFewPoints)?;
        let report = prepared.report.clone();
        self.scans.push(prepared);
        self.rebuild(Some(near).filter(|_| self.scans.len() == 1));
        Ok(report)
    }

    /// Takes the last scan back; false if there is none.
    pub fn undo(&mut self) -> bool {
        let had_one = self.scans.pop().is_some();
        self.planners.reset();
        self.rebuild(None);
        had_one
    }

    /// Forgets all scans.
    pub fn reset(&mut self) {
        self.scans.clear();
        self.planners.reset();
        self.rebuild(None);
    }

    /// Number of scans.
    pub fn num_scans(&self) -> usize {
        self.scans.len()
    }

    /// Memory that the scans and the neighbours of their points hold, roughly, in bytes.
    pub fn memory(&self) -> usize {
        let depth = |scan: &Scan| match scan {
            // Once here and once in the planners' state.
            Scan::Depth { depth, .. } => 8 * depth.depth.len(),
            Scan::Cloud { .. } => 0,
        };
        let near = self.state.near.as_ref().map_or(0, |near| 8 * near.k() * near.len());
        near + self.scans.iter().map(|s| 96 * s.cloud.len() + depth(&s.scan)).sum::<usize>()
    }

    /// The accumulated cloud that is planned on.
    pub fn cloud(&self) -> &PointCloud {
        &self.state.cloud
    }

    /// What the planners see.
    pub fn state(&self) -> &ScanState {
        &self.state
    }

    /// The next view, with all candidates.
    ///
    /// # Errors
    /// No scan, a planner that cannot work with what is known, or travel limits without a current position.
    pub fn next_view(&mut self) -> Result<Answer, SessionError> {
        if self.scans.is_empty() {
            return Err(SessionError::NoScan);
        }
        let constraints = &self.config.constraints;
        let positions: Vec<Point3<f64>> = self.scans.iter().filter_map(|s| s.scan.camera_position()).collect();
        let last = self.scans.last().and_then(|s| s.scan.camera_position());
        let current = constraints.current_position_m.map(Point3::from).or(last);
        if constraints.needs_current_position() && current.is_none() {
            return Err(SessionError::NoCurrentPosition);
        }
        let evidence = Evidence::of(&self.state);
        let choice = choose(self.config.planner, evidence, self.planners.network.is_some())?;

        let (config, num_scans, planners) = (&self.config, self.scans.len(), &mut self.planners);
        let state = &mut self.state;
        let mut ranked: Vec<(RankedView, f64)> = Vec::new();
        for distance in config.working_distances() {
            // One stream for all distances: the candidates differ by the distance alone.
            let mut rng = rng::stream(config.seed, &format!("infer/view/{num_scans}"));
            state.working_distance = distance;
            let views = planners.rank(choice.planner, state, &mut rng);
            ranked.extend(views.into_iter().map(|view| (view, distance)));
        }
        let boundary = BoundaryConfig::default();
        let near = state.neighborhoods(boundary.neighbors);
        let boundary = boundary_among(&state.cloud, &near, near.mean_distance(), &boundary).len();
        let visited = positions.into_iter().chain(constraints.visited_m.iter().map(|p| Point3::from(*p))).collect();
        let known = Surroundings {
            points: &self.state.cloud.points,
            normals: &self.state.cloud.normals,
            spacing: self.state.grid_size,
            current,
            visited,
        };
        let usual_scan = overlap::usual_scan(&self.state.cloud, self.scans.len());
        let mut candidates: Vec<Candidate> = ranked
            .iter()
            .map(|(ranked, distance)| {
                let view = &ranked.view;
                let overlap = ranked.overlap.or_else(|| {
                    (constraints.min_overlap > 0.0)
                        .then(|| overlap::estimate(&self.state.cloud, view, &self.state.camera, usual_scan))
                });
                Candidate {
                    rank: 0,
                    score: ranked.score - constraints.travel_cost(view, &known),
                    planner_score: ranked.score,
                    target_m: view.target.coords.into(),
                    position_m: view.position.coords.into(),
                    working_distance_m: *distance,
                    world_from_camera: Pose::from(&world_from_camera(view, &self.config.pose, &constraints.up())),
                    expected_gain: ranked.gain,
                    expected_overlap: overlap,
                    objections: constraints.objections(view, overlap, &known),
                }
            })
            .collect();
        // Stable: equal scores stay in the planner's order.
        candidates.sort_by(|a, b| {
            let ruled_out = |c: &Candidate| !c.objections.is_empty();
            ruled_out(a).cmp(&ruled_out(b)).then(b.score.total_cmp(&a.score))
        });
        for (rank, candidate) in candidates.iter_mut().enumerate() {
            candidate.rank = rank;
        }
        let next = candidates.first().filter(|c| c.objections.is_empty()).cloned();
        let stop = self.judge_stop(next.as_ref());
        Ok(Answer {
            stop,
            planner: choice.planner.as_str().to_owned(),
            planner_reason: choice.why,
            evidence,
            cloud: self.summary(boundary),
            excluded: count_exclusions(candidates.iter().map(|c| &c.objections[..])),
            warnings: self.warnings(next.as_ref(), &candidates),
            next,
            candidates,
        })
    }

    fn judge_stop(&self, next: Option<&Candidate>) -> Stop {
        let Some(next) = next else {
            return Stop { expected_gain: 0.0, basis: "no view is left".to_owned(), stop: true };
        };
        let (expected_gain, basis) = stop::expected_gain(next.expected_gain, self.scans.len());
        Stop { expected_gain, basis: basis.to_owned(), stop: expected_gain < self.config.stop_below }
    }

    fn summary(&self, boundary_points: usize) -> CloudSummary {
        let (low, high) = self.state.cloud.bounding_box();
        CloudSummary {
            scans: self.scans.len(),
            points_read: self.scans.iter().map(|s| s.report.read).sum(),
            points_used: self.state.cloud.len(),
            spacing_m: self.state.grid_size,
            bounding_box_m: [low.coords.into(), high.coords.into()],
            boundary_points,
        }
    }

    /// What is odd about sizes and distances.
    fn warnings(&self, next: Option<&Candidate>, candidates: &[Candidate]) -> Vec<String> {
        let mut warnings = Vec::new();
        let reports = || self.scans.iter().map(|s| &s.report);
        let (read, used): (usize, usize) = reports().fold((0, 0), |(r, u), x| (r + x.read, u + x.used));
        if reports().map(|r| r.thinned).sum::<usize>() * 10 > read {
            warnings.push(format!("thinned to {used} of {read} points before planning (max_points)"));
        }
        let outliers: usize = reports().map(|r| r.outliers).sum();
        if outliers > 0 {
            warnings.push(format!("dropped {outliers} points far from all others (outlier_factor)"));
        }
        let (low, high) = self.state.cloud.bounding_box();
        let diagonal = (high - low).norm();
        if diagonal > 50.0 {
            warnings.push(format!("the cloud is {} across: is it in millimetres (--unit mm)?", length(diagonal)));
        } else if diagonal < 0.002 {
            warnings.push(format!("the cloud is {} across: is it in metres (--unit m)?", length(diagonal)));
        }
        let camera = &self.state.camera;
        let image = f64::from(camera.width) / camera.fx;
        let angle = image.min(f64::from(camera.height) / camera.fy);
        // The whole box in the image, seen from in front of its near side.
        let serves = 1.1 * diagonal / angle + 0.5 * diagonal;
        let Some(best) = next.or(candidates.first()) else { return warnings };
        let distance = best.working_distance_m;
        let position = Point3::from(best.position_m);
        let nearest = self.state.cloud.points.iter().map(|p| (p - position).norm()).fold(f64::INFINITY, f64::min);
        if nearest < 0.5 * distance {
            warnings.push(format!(
                "the camera would stand {} from the measured surface, in or near the cloud, which is {} across: \
                 a distance of {} would serve (--distance {serves:.3})",
                length(nearest),
                length(diagonal),
                length(serves)
            ));
        } else if diagonal > distance * angle {
            warnings.push(format!(
                "the cloud is {} across and overflows the image at {}: a distance of {} would serve (--distance {serves:.3})",
                length(diagonal),
                length(distance),
                length(serves)
            ));
        }
        warnings
    }

    /// The state from all scans; cheap, since each is thinned already. `near` are the neighbours in the cloud, where
    /// that is known to be the only scan's.
    fn rebuild(&mut self, near: Option<Neighborhoods>) {
        let grid_size = self.scans.first().map_or(0.0, |scan| scan.spacing);
        let mut cloud = PointCloud::default();
        let mut unoriented = BTreeSet::new();
        for scan in &self.scans {
            if !scan.oriented {
                unoriented.extend(cloud.len()..cloud.len() + scan.cloud.len());
            }
            cloud.points.extend_from_slice(&scan.cloud.points);
            cloud.normals.extend_from_slice(&scan.cloud.normals);
        }
        if self.scans.len() > 1 {
            // As dense as voxel averaging with the grid size would leave it.
            let radius =
                (0.73 * grid_size).max(thin::radius_for(&cloud.points, self.config.max_points, self.config.seed));
            let kept = thin::thin(&cloud.points, radius);
            unoriented.retain(|i| kept.binary_search(i).is_ok());
            cloud = thin::select(&cloud, &kept);
        }
        let near = near.unwrap_or_else(|| neighborhoods(&cloud.points));
        if !unoriented.is_empty() {
            orient_normals_among(&mut cloud, &near, ORIENTATION_NEIGHBORS);
        }
        self.state = ScanState {
            cloud,
            scans: self.scans.iter().filter_map(PreparedScan::past_scan).collect(),
            num_scans: self.scans.len(),
            grid_size,
            working_distance: self.config.working_distance_m,
            tolerance: self.config.tolerance_m,
            camera: self.config.camera.camera(),
            near: Some(near),
        };
    }
}
