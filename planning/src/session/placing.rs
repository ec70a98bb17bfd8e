//! A planner's views as candidates: where the camera stands in the cell, where a turntable stops, and what speaks against each.

use super::checking::Considered;
use super::registering::unregistrable;
use super::{SAME_PLACE, Session};
use crate::answer::Candidate;
use crate::config::{PlannerName, SessionConfig};
use crate::constraints::{Box3, Constraint, ConstraintsConfig, Objection, Surroundings};
use crate::overlap;
use crate::pose::{CameraRoll, Pose, world_from_camera};
use crate::reach::{Hindrance, Obstacles, Reach, Reached};
use crate::registration::Frame;
use crate::registration::registrability::Demand;
use crate::scan::PreparedScan;
use crate::turntable::{TableStop, TurntableConfig, turn_between_deg};
use crate::{Plane, RankedView, ScanState, Seen};
use geometry::{NeighborGrid, View};
use nalgebra::{Isometry3, Point3, Vector3};
use std::borrow::Cow;

/// A given view at a place scanned from is another one if it looks elsewhere by more than this, degrees. Robots come back to a pose within
/// tenths of a degree, and of an image 40 degrees wide that is turned by less, only about an eighth is new.
const SAME_WAY_DEG: f64 = 5.0;

/// What the views of one decision are held against.
pub(super) struct Cell<'a> {
    pub config: &'a SessionConfig,
    pub state: &'a ScanState,
    /// Where the camera may go: the settings', or those that hold in the end.
    pub limits: ConstraintsConfig,
    pub known: Surroundings<'a>,
    /// Where scans were taken from, where views are given.
    scanned: Vec<TakenFrom>,
    /// The table's angle at the last scan, degrees.
    pub table_deg: f64,
    pub support: Option<Plane>,
    /// What was measured of it, which is not in the cloud.
    stood_on: Vec<Point3<f64>>,
    pub arm: Option<Armed<'a>>,
    /// Whether the planner predicts what a view sees.
    pub predicts: bool,
    pub scans: usize,
    /// What registration asks of views, with the object's frame; `None` where it asks nothing.
    pub demand: Option<(Demand, Frame)>,
    /// Cameras whose scans could not be registered onto the cloud as it is.
    pub unregistered: Vec<Point3<f64>>,
}

/// A view in the cell.
#[derive(Clone, Debug, Default)]
pub struct Placed {
    /// Where the turntable stops for it.
    pub table: Option<TableStop>,
    /// The arm there.
    pub reached: Option<Reached>,
    /// What speaks against it.
    pub objections: Vec<Objection>,
    /// Taken off its score.
    pub cost: f64,
    /// Where the object stands then.
    pub cell_from_object: Isometry3<f64>,
    /// The camera's pose in the object's frame.
    pub world_from_camera: Isometry3<f64>,
}

impl Session {
    /// Where a view would be taken from, and what speaks against it: the cell's limits and the arm, not what it would see. Asked of a
    /// session without scans, whether the first one can be taken from there. Of given views that differ in roll alone, the one is placed that
    /// least speaks against.
    pub fn place(&self, view: &View) -> Placed {
        let planner = self.planners.choose(&self.state).map_or(PlannerName::Farthest, |choice| choice.planner);
        let cell = self.cell(None, planner);
        let same = self.state.given().into_iter().enumerate().filter(|(_, given)| given == view);
        let mut given: Vec<Option<usize>> = same.map(|(i, _)| Some(i)).collect();
        if given.is_empty() {
            given.push(None);
        }
        let places = given.into_iter().flat_map(|given| cell.places(view, None, given));
        places.min_by_key(|place| place.objections.len()).unwrap_or_default()
    }

    /// How the camera is turned at views that are not given, as the object sees it: at the stop nearest to where the table stands, which comes
    /// first of those that allow a view.
    pub(super) fn roll(&self) -> CameraRoll {
        let stops = self.config.turntable.iter().flat_map(TurntableConfig::stops);
        let at = self.table_deg();
        let turn = |stop: &f64| turn_between_deg(*stop, at);
        self.roll_at(stops.min_by(|a, b| turn(a).total_cmp(&turn(b))).unwrap_or_default())
    }

    /// The pose, in the object's frame, that a scan at a view is taken with: of a given one as it is given, else turned as answers turn it,
    /// with the table at this stop.
    pub fn camera_pose(&self, view: &View, stop_deg: Option<f64>) -> Isometry3<f64> {
        let given = self.state.given().iter().position(|given| given == view);
        let as_given = given.map(|i| self.state.given_views[i]);
        as_given.unwrap_or_else(|| self.roll_at(stop_deg.unwrap_or_default()).world_from_camera(view))
    }

    fn roll_at(&self, table_deg: f64) -> CameraRoll {
        CameraRoll::new(&self.config.pose, &self.config.up_in_object(table_deg))
    }

    /// The pose that a candidate is answered with, in the object's frame; of one that is not given, to the last bit as forecasts have it.
    pub(super) fn camera_at(&self, candidate: &Candidate) -> Isometry3<f64> {
        let stop = candidate.table.as_ref().map(|table| table.stop_deg);
        match candidate.given {
            Some(_) => candidate.pose(),
            None => self.roll_at(stop.unwrap_or_default()).world_from_camera(&candidate.view()),
        }
    }

    /// The cell as it is now, the camera being at `current` (cell's frame).
    pub(super) fn cell(&self, current: Option<Point3<f64>>, planner: PlannerName) -> Cell<'_> {
        let (config, state) = (&self.config, &self.state);
        let positions: Vec<Point3<f64>> = self.scans.iter().filter_map(PreparedScan::camera_position).collect();
        let taken = self.scans.iter().filter_map(TakenFrom::of);
        let scanned = if state.given_views.is_empty() { Vec::new() } else { taken.collect() };
        let visited = config.constraints.visited_m.iter().map(|p| Point3::from(*p));
        let (low, high) = state.cloud.bounding_box();
        let avoid = config.robot.as_ref().is_some_and(|r| r.avoid_unknown);
        let expected = if avoid { self.planners.expected_surface(planner) } else { Vec::new() };
        let expected = expected.into_iter().map(|(point, _)| point).collect();
        Cell {
            config,
            state,
            limits: config.constraints.clone(),
            known: Surroundings {
                bounds: [low, high],
                points: &state.cloud.points,
                normals: &state.cloud.normals,
                spacing: state.grid_size,
                current,
                visited: positions.into_iter().chain(visited).collect(),
            },
            scanned,
            table_deg: self.table_deg(),
            support: self.support,
            stood_on: self.stood_on(),
            arm: self.reach.as_deref().map(|reach| Armed::new(reach, self.touchable(), expected)),
            predicts: planner == PlannerName::Volumetric,
            scans: self.scans.len(),
            demand: Demand::on(state, &config.registration),
            unregistered: self.unregistered(),
        }
    }
}

impl Cell<'_> {
    /// The views, one by one.
    pub fn considered<'b>(&'b self, ranked: &'b [(RankedView, f64)]) -> impl Iterator<Item = Considered> + 'b {
        let usual_scan = overlap::usual_scan(&self.state.cloud, self.scans);
        ranked.iter().map(move |(ranked, distance)| {
            let (view, given) = (&ranked.view, ranked.given);
            let pose = self.state.pose(view, given);
            let demand = self.demand.as_ref().map(|(demand, _)| demand);
            let needs_overlap = self.limits.min_overlap > 0.0 || demand.is_some_and(Demand::needs_overlap);
            let estimate = || overlap::estimate(self.state, view, &pose, usual_scan);
            let overlap = ranked.overlap.or_else(|| needs_overlap.then(estimate));
            let [least, cautious] =
                [overlap, ranked.cautious_overlap.or(overlap)].map(|o| o.map(|o| o - overlap::margin(self.scans)));
            let expect = |(demand, frame): &(Demand, Frame)| demand.predict_from(self.state, view, &pose, frame);
            let registration = self.demand.as_ref().map(expect);
            let as_given = given.map(|i| self.as_given(i));
            let mut places = self.places(view, cautious, given);
            let mut others = Vec::new();
            if self.scanned.iter().any(|taken| taken.is_from(&pose, SAME_PLACE * distance)) {
                places[0].objections = vec![Objection::scanned()];
            } else {
                others.extend(Objection::of_sensor(&self.config.sensor, ranked, self.predicts));
                let registration = registration.as_ref();
                others.extend(unregistrable(view, &self.unregistered, least, registration, demand));
            }
            places[0].objections.extend(others);
            let allowed = |place: &Placed| place.objections.is_empty();
            let free = if allowed(&places[0]) { places.iter().filter(|p| allowed(p)).count() } else { 1 };
            // Those that nothing speaks against come first.
            places.truncate(free);
            let candidate = Candidate {
                rank: 0,
                score: ranked.score,
                planner_score: ranked.score,
                target_m: view.target.coords.into(),
                position_m: view.position.coords.into(),
                working_distance_m: *distance,
                world_from_camera: Pose::from(&places[0].world_from_camera),
                table: None,
                reached: None,
                expected_gain: ranked.gain,
                expected_overlap: overlap,
                objections: Vec::new(),
                given: as_given,
                registration,
                bridges_to: None,
            };
            Considered { candidate, places, at: 0, refused: None }
        })
    }

    /// Which of the poses that were given the i-th view is, each being one for every stop of a table; of a camera that stands still, the stop.
    fn as_given(&self, i: usize) -> usize {
        let table = self.config.turntable.as_ref().filter(|table| table.cell_from_camera.is_none());
        table.map_or(i, |table| i % (self.state.given_views.len() / table.stops().len().max(1)).max(1))
    }

    /// The camera's pose at a view, in the object's frame, with the table at this angle: upright in the cell, where it is not given.
    fn pose(&self, view: &View, given: Option<usize>, table_deg: f64) -> Isometry3<f64> {
        match given {
            Some(i) => self.state.given_views[i],
            None => world_from_camera(view, &self.config.pose, &self.config.up_in_object(table_deg)),
        }
    }

    /// Where a view can be taken from, `overlap` being the least that can be expected of it; one place at least, best first: the stop that
    /// nothing, or least, speaks against; of those the one that costs least, and then the nearest to where the table stands.
    pub fn places(&self, view: &View, overlap: Option<f64>, given: Option<usize>) -> Vec<Placed> {
        let Some(table) = &self.config.turntable else {
            let pose = self.pose(view, given, self.table_deg);
            let placed = self.place_in_cell(view, view, &pose, &Isometry3::identity(), overlap);
            return vec![Placed { world_from_camera: pose, ..placed }];
        };
        let stops = table.stops();
        // Given views are of one stop each, the stops in their order.
        let own = given.map(|i| i * stops.len() / self.state.given_views.len().max(1));
        let turn = |stop: f64| turn_between_deg(stop, self.table_deg);
        let mut stops: Vec<f64> = match own {
            Some(i) => vec![stops[i]],
            None => stops,
        };
        stops.sort_by(|a, b| turn(*a).total_cmp(&turn(*b)));
        let placed = stops.into_iter().map(|stop_deg| {
            let cell_from_object = table.cell_from_object(stop_deg);
            let world_from_camera = self.pose(view, given, stop_deg);
            let pose = cell_from_object * world_from_camera;
            let in_cell = View { target: cell_from_object * view.target, position: cell_from_object * view.position };
            let placed = self.place_in_cell(view, &in_cell, &pose, &cell_from_object, overlap);
            let table = Some(TableStop { stop_deg, cell_from_camera: Pose::from(&pose) });
            Placed { table, world_from_camera, ..placed }
        });
        let order = |a: &Placed, b: &Placed| {
            let against = |p: &Placed| p.objections.len();
            against(a).cmp(&against(b)).then(a.cost.total_cmp(&b.cost))
        };
        let mut placed: Vec<Placed> = placed.collect();
        // Of equal ones the nearest stop stays first.
        placed.sort_by(order);
        placed
    }

    fn place_in_cell(
        &self,
        view: &View,
        in_cell: &View,
        cell_from_camera: &Isometry3<f64>,
        cell_from_object: &Isometry3<f64>,
        overlap: Option<f64>,
    ) -> Placed {
        // A camera that stands still does not travel.
        let moves = self.config.turntable.as_ref().is_none_or(|t| t.cell_from_camera.is_none());
        let mut objections = self.limits.objections_in_cell(view, in_cell, overlap, &self.known);
        if let Some(height) = self.support.map(|plane| plane.height(&view.position)).filter(|h| *h <= 0.0) {
            let reason = format!("camera {:.3} m below the plane that the object stands on", -height);
            objections.push(Objection { constraint: Constraint::Support, reason });
        } else {
            let beside = self.stood_on.iter().map(|p| (p - view.position).norm()).fold(f64::INFINITY, f64::min);
            if beside < self.limits.clearance(view) {
                let reason = format!("{beside:.3} m from what the object stands on");
                objections.push(Objection { constraint: Constraint::Clearance, reason });
            }
        }
        let mut cost = if moves { self.limits.travel_cost(in_cell, &self.known) } else { 0.0 };
        let mut reached = None;
        // An arm is not asked about what is ruled out already.
        if let Some(arm) = self.arm.as_ref().filter(|_| objections.is_empty()) {
            let floor = self.limits.floor_height_m.map(|height| (self.limits.up(), height));
            match arm.to(cell_from_camera, cell_from_object, &self.limits.keep_out_m, floor) {
                Ok(found) => {
                    cost += arm.reach.cost(&found);
                    reached = Some(found);
                }
                Err(hindrance) => objections.push(Objection::of_arm(&hindrance)),
            }
        }
        Placed { reached, objections, cost, cell_from_object: *cell_from_object, ..Placed::default() }
    }
}

/// Where a scan was taken from, as the robot told it: object's frame.
struct TakenFrom {
    position: Point3<f64>,
    /// Which way it looked; `None` of a cloud, of which the position alone is told.
    axis: Option<Vector3<f64>>,
}

impl TakenFrom {
    fn of(scan: &PreparedScan) -> Option<Self> {
        let image = scan.past.first().filter(|past| matches!(past.seen, Seen::Depth { .. }));
        let moved = scan.report.registration.as_ref().filter(|_| scan.moved);
        let axis = image.map(|past| past.world_from_camera * Vector3::z());
        let axis = axis.map(|axis| moved.map_or(axis, |found| found.correction.inverse() * axis));
        Some(Self { position: scan.position_given()?, axis })
    }

    /// Whether a camera at `pose` looks the same way from a place at most so far away.
    fn is_from(&self, pose: &Isometry3<f64>, away: f64) -> bool {
        let same_way = |axis: Vector3<f64>| axis.dot(&(pose * Vector3::z())) >= SAME_WAY_DEG.to_radians().cos();
        (self.position.coords - pose.translation.vector).norm() <= away && self.axis.is_none_or(same_way)
    }
}

/// An arm among what it may touch, in the object's frame.
pub(super) struct Armed<'a> {
    pub reach: &'a Reach,
    measured: Cow<'a, [Point3<f64>]>,
    expected: Vec<Point3<f64>>,
    grids: [NeighborGrid; 2],
}

impl<'a> Armed<'a> {
    /// With the measured points, and those where surface is expected in unknown space.
    pub fn new(reach: &'a Reach, measured: Cow<'a, [Point3<f64>]>, expected: Vec<Point3<f64>>) -> Self {
        /// About as wide as the balls that links are made of.
        const CELL_M: f64 = 0.05;
        let grids = [NeighborGrid::new(&measured, CELL_M), NeighborGrid::new(&expected, CELL_M)];
        Self { reach, measured, expected, grids }
    }

    fn to(
        &self,
        cell_from_camera: &Isometry3<f64>,
        cell_from_object: &Isometry3<f64>,
        boxes: &[Box3],
        floor: Option<(Vector3<f64>, f64)>,
    ) -> Result<Reached, Hindrance> {
        let obstacles = Obstacles {
            measured: Some((&self.measured[..], &self.grids[0])).filter(|_| !self.measured.is_empty()),
            expected: Some((&self.expected[..], &self.grids[1])).filter(|_| !self.expected.is_empty()),
            boxes,
            floor,
        };
        self.reach.to(cell_from_camera, &obstacles, cell_from_object)
    }
}

impl Objection {
    fn of_arm(hindrance: &Hindrance) -> Self {
        let constraint = match hindrance {
            Hindrance::Unreached(_) => Constraint::Reach,
            Hindrance::Collision(..) => Constraint::Collision,
        };
        Self { constraint, reason: hindrance.describe() }
    }
}

#[cfg(test)]
mod tests;
