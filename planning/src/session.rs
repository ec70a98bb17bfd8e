//! A robot's loop: add scans, ask for the next view, undo, reset.

mod adjusting;
mod aside;
mod bounds;
mod bridging;
mod checking;
mod decline;
mod doubts;
mod error;
mod merging;
mod mesh;
mod missing;
mod placing;
mod ranking;
pub mod registering;
mod request;
mod scan_plan;
mod table;
mod warnings;

use crate::answer::{Answer, Candidate, CloudSummary, EstimatedCamera};
use crate::config::SessionConfig;
use crate::constraints::count_exclusions;
use crate::doubt::Offset;
use crate::planners::auto::{AutoPlanner, Choice, Network};
use crate::scan::{PreparedScan, Reading, Scan, ScanReport, prepare};
use crate::stop::Stop;
use crate::{Accumulate, Budget, Evidence, Plane, Planner, Reach, ScanState};
use checking::Considered;
use geometry::PointCloud;
use nalgebra::{Isometry3, Point3};
use ranking::Ranking;
use std::sync::Arc;

pub use checking::{AskedView, Verdict, ViewCheck};
pub use error::SessionError;
pub use placing::Placed;
pub use request::Request;
pub use scan_plan::{PlannedView, ScanPlan};

/// A camera within this share of the working distance of a given view has scanned from there: robots report a taught pose a millimetre or two
/// off.
const SAME_PLACE: f64 = 5e-3;

/// The scans of one object so far, and the planners' memory of them.
///
/// ```
/// use geometry::PointCloud;
/// use nalgebra::Point3;
/// use planning::{Scan, Session, SessionConfig};
///
/// # fn main() -> Result<(), planning::SessionError> {
/// let points = (0..900).map(|i| Point3::new(0.004 * f64::from(i % 30), 0.004 * f64::from(i / 30), 0.0)).collect();
/// let cloud = PointCloud { points, normals: Vec::new() };
/// let mut session = Session::new(SessionConfig::default(), None)?;
/// session.add_scan(Scan::Cloud { cloud, from: Some(Point3::new(0.06, 0.06, 1.2)) })?;
/// assert_eq!(session.num_scans(), 1);
/// let answer = session.next_view()?;
/// println!("{}", answer.to_text());
/// assert!(session.undo() && session.num_scans() == 0);
/// # Ok(()) }
/// ```
#[derive(Clone, Debug)]
pub struct Session {
    config: SessionConfig,
    planners: AutoPlanner,
    scans: Vec<PreparedScan>,
    state: ScanState,
    /// What the planner said of the state as it is: requests that differ in where the camera may go ask once.
    ranking: Option<Ranking>,
    given_views: Arc<[Isometry3<f64>]>,
    /// As they were given: in the cell's frame, where there is a turntable.
    taught: Arc<[Isometry3<f64>]>,
    /// How far each scan lies off those before it, as far as it was asked.
    offsets: Vec<Option<Offset>>,
    /// Where scans were taken that could not be registered onto the cloud as it is now, and are lost.
    unregistered: Vec<Point3<f64>>,
    /// Scans that could not be registered yet, and wait.
    aside: Vec<PreparedScan>,
    truth: Option<Truth>,
    /// What the object stands on: as it was given, or once it is found.
    support: Option<Plane>,
    /// The arm, made ready.
    reach: Option<Arc<Reach>>,
}

/// Samples of the true surface, for [`Accumulate::Matched`] alone.
#[derive(Clone, Debug)]
struct Truth {
    samples: Arc<[Point3<f64>]>,
    reference: Vec<Point3<f64>>,
}

impl Session {
    /// An empty session. Without a network, `auto` falls back to `farthest` where only clouds are known.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn new(config: SessionConfig, network: Option<Network>) -> Result<Self, SessionError> {
        config.check()?;
        Ok(Self::empty(config, network, None))
    }

    /// A session whose cloud consists, as published, of the samples of the true surface that were matched so far: for
    /// simulations of the publication only.
    pub fn matching(config: SessionConfig, samples: Arc<[Point3<f64>]>) -> Self {
        let config = SessionConfig { accumulate: Accumulate::Matched, ..config };
        Self::empty(config, None, Some(Truth { samples, reference: Vec::new() }))
    }

    /// A session without a network whose settings are the program's own and known to be in range.
    pub fn unchecked(config: SessionConfig) -> Self {
        Self::empty(config, None, None)
    }

    fn empty(config: SessionConfig, network: Option<Network>, truth: Option<Truth>) -> Self {
        let planners = AutoPlanner::new(network, &config);
        let mut session = Self {
            config,
            planners,
            scans: Vec::new(),
            state: ScanState::default(),
            ranking: None,
            given_views: Arc::default(),
            taught: Arc::default(),
            offsets: Vec::new(),
            unregistered: Vec::new(),
            aside: Vec::new(),
            truth,
            support: None,
            reach: None,
        };
        session.support = session.known_support(&session.config);
        session.place_views();
        session.rebuild();
        session
    }

    /// The settings.
    pub fn config(&self) -> &SessionConfig {
        &self.config
    }

    /// Changes the settings; the scans are kept as they were prepared, and planners keep what they know where the
    /// settings that it depends on stay.
    ///
    /// # Errors
    /// A setting out of range: the old ones stay.
    pub fn configure(&mut self, config: SessionConfig) -> Result<(), SessionError> {
        config.check()?;
        if self.config == config {
            return Ok(());
        }
        self.ranking = None;
        let old = &self.config;
        let stands = old.support == config.support;
        let voxels = old.tolerance_m == config.tolerance_m
            && old.working_distances() == config.working_distances()
            && old.camera == config.camera;
        if !(stands && voxels) {
            self.planners.reset();
            self.offsets.clear();
        }
        if !stands {
            self.support = self.known_support(&config);
            self.state.support = self.support;
        }
        self.planners.configure(&config);
        let merge = |c: &SessionConfig| (c.accumulate, c.max_points, c.seed);
        let merged_alike = merge(&self.config) == merge(&config);
        self.config = config;
        self.place_views();
        if merged_alike {
            self.state.working_distance = self.config.working_distance_m;
            self.state.reach += self.config.tolerance_m - self.state.tolerance;
            self.state.tolerance = self.config.tolerance_m;
            self.state.camera = self.config.camera.camera();
            self.state.sensor = self.config.sensor;
        } else {
            self.rebuild();
        }
        Ok(())
    }

    /// Adds a scan and reports what was done with its points.
    ///
    /// # Errors
    /// Too few usable points, or a scan that is to be registered and does not fit: the session stays as it was.
    pub fn add_scan(&mut self, scan: Scan) -> Result<ScanReport, SessionError> {
        self.add_scan_within(scan, Reading::default(), &Budget::default())
    }

    /// [`Session::add_scan`] in limited time, of a scan that was a file: what there is to say of that stands in the answers.
    ///
    /// # Errors
    /// As [`Session::add_scan`], or it takes too long.
    pub fn add_scan_within(
        &mut self,
        scan: Scan,
        reading: Reading,
        budget: &Budget,
    ) -> Result<ScanReport, SessionError> {
        let scan = self.on_table(scan, &reading)?;
        let least = self.config.min_points;
        let refused = |refusal| SessionError::refused(refusal, least, &reading);
        let (mut prepared, near) = prepare(scan, &self.config, self.support.as_ref(), budget).map_err(refused)?;
        let support = self.support.or(prepared.shows_support);
        prepared.reading = reading;
        let number = self.num_scans() + 1;
        (prepared.number, prepared.merged_with) = (number, number);
        let merges = self.register(&mut prepared)?;
        self.support = support;
        let report = prepared.report.clone();
        if !merges {
            self.ranking = None;
            self.aside.push(prepared);
            return Ok(report);
        }
        self.unregistered.clear();
        self.scans.push(prepared);
        self.take_in(self.scans.len() - 1);
        if let Some(near) = near.filter(|near| self.scans.len() == 1 && near.len() == self.state.cloud.len()) {
            self.state.near = near.into();
        }
        self.try_again(number);
        self.adjust(number);
        Ok(report)
    }

    /// Takes the last scan back; false if there is none.
    pub fn undo(&mut self) -> bool {
        let scans = self.num_scans();
        self.keep_first(scans.saturating_sub(1));
        self.rebuild();
        scans > 0
    }

    /// Forgets all scans.
    pub fn reset(&mut self) {
        self.scans.clear();
        self.aside.clear();
        self.support = self.known_support(&self.config);
        self.offsets.clear();
        self.unregistered.clear();
        self.planners.reset();
        self.rebuild();
    }

    /// Number of scans that came, with those that wait to be registered.
    pub fn num_scans(&self) -> usize {
        self.scans.len() + self.aside.len()
    }

    /// The accumulated cloud that is planned on.
    pub fn cloud(&self) -> &PointCloud {
        &self.state.cloud
    }

    /// What the planners see.
    pub fn state(&self) -> &ScanState {
        &self.state
    }

    /// The averaged samples of the true surface ([`Session::matching`]); empty otherwise.
    pub fn reference(&self) -> &[Point3<f64>] {
        self.truth.as_ref().map_or(&[], |truth| &truth.reference)
    }

    /// The next view, with all candidates, where the camera may go by the settings.
    ///
    /// # Errors
    /// No scan, a planner that cannot work with what is known or fails, travel limits without a current position, or no
    /// answer in time.
    pub fn next_view(&mut self) -> Result<Answer, SessionError> {
        self.next_view_for(&Request::default())
    }

    /// [`Session::next_view`] for one request: what it says holds for this answer alone.
    ///
    /// # Errors
    /// As [`Session::next_view`].
    pub fn next_view_for(&mut self, request: &Request) -> Result<Answer, SessionError> {
        if self.scans.is_empty() {
            return Err(SessionError::NoScan);
        }
        self.compare_scans();
        let current = self.camera_now(request.current_position_m);
        if self.config.constraints.needs_current_position() && current.is_none() {
            let doubted = self.latest().and_then(|scan| Some((scan.number, scan.doubt.clone()?)));
            let doubted = doubted.map(|(number, why)| SessionError::DoubtedPosition { number, why });
            return Err(doubted.unwrap_or(SessionError::NoCurrentPosition));
        }
        let choice = self.planners.choose(&self.state)?;
        self.state.budget = request.budget.clone();
        let asks = self.ranking.is_none() && request.budget.is_limited();
        let before = asks.then(|| self.planners.clone());
        let answer = self.ranked(choice.planner).and_then(|ranking| {
            let answer = self.answer(&ranking, choice, current, request);
            self.ranking = Some(ranking).filter(|ranking| ranking.complete);
            answer
        });
        // Where time did not suffice, what the planners remember stays as it was: the next answer is the one that would have been given had
        // nobody asked before.
        if let Some(before) = before.filter(|_| self.ranking.is_none()) {
            self.planners = before;
        }
        answer
    }

    /// The planner's views as candidates, and what there is to say about them.
    fn answer(
        &self,
        ranking: &Ranking,
        choice: Choice,
        current: Option<Point3<f64>>,
        request: &Request,
    ) -> Result<Answer, SessionError> {
        let budget = &request.budget;
        let cell = self.cell(current, choice.planner);
        let mut views: Vec<_> = cell.considered(&ranking.views).take_while(|_| budget.allows(true).is_ok()).collect();
        budget.allows(true)?;
        let mut gives_way = None;
        loop {
            if let Some(check) = &request.check {
                check.judge(&mut views, self.reach.as_deref(), budget)?;
            }
            if views.iter().any(Considered::is_open) {
                break;
            }
            gives_way = cell.most_overlapping(&mut views);
            if gives_way.is_none() {
                break;
            }
        }
        let mut candidates: Vec<Candidate> = views.into_iter().map(Considered::candidate).collect();
        let travel = |c: &Candidate| current.map_or(0.0, |from| (c.position_in_cell() - from).norm());
        // Of given views that are equally good the nearer. Stable: equal ones stay in the planner's order.
        self.mark_bridge(&mut candidates);
        candidates.sort_by(|a, b| {
            let ruled_out = |c: &Candidate| !c.objections.is_empty();
            let nearer = a.given.and(b.given).map_or(std::cmp::Ordering::Equal, |_| travel(a).total_cmp(&travel(b)));
            let first = |c: &Candidate| c.bridges_to.is_none();
            ruled_out(a).cmp(&ruled_out(b)).then(first(a).cmp(&first(b))).then(b.score.total_cmp(&a.score)).then(nearer)
        });
        for (rank, candidate) in candidates.iter_mut().enumerate() {
            candidate.rank = rank;
        }
        let (found, doubt) = self.missing(choice.planner, &mut candidates, cell);
        let (mut missing, surface) = found.unzip();
        let known = self.planners.surface(choice.planner);
        let added = ranking.lately_added.map(|share| share.zip(known).map(|(share, known)| share * known.covered()));
        let raised = added[0].is_some_and(|added| decline::heed(&mut candidates, missing.as_mut(), added));
        let next = candidates.first().filter(|c| c.objections.is_empty()).cloned();
        let mut stop = Stop::judge(&candidates, self.config.stop_below, raised, added, missing.as_ref());
        // Of some views nothing follows for the others.
        stop.stop &= ranking.complete;
        if let (Some(why), None) = (&doubt, stop.expected_gain) {
            stop.basis = format!("unknown: {why}");
        }
        Ok(Answer {
            stop,
            planner: choice.planner.as_str().to_owned(),
            planner_reason: choice.why,
            evidence: Evidence::of(&self.state),
            estimated_cameras: self.state.scans.iter().filter_map(|scan| EstimatedCamera::of(scan)).collect(),
            registrations: self.registrations(),
            cloud: self.summary(ranking.boundary),
            surface,
            missing,
            support: self.support,
            complete: ranking.complete,
            excluded: count_exclusions(candidates.iter().map(|c| &c.objections[..])),
            warnings: self.warnings(next.as_ref(), &candidates).into_iter().chain(gives_way).chain(doubt).collect(),
            next,
            candidates,
        })
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
}

#[cfg(test)]
mod tests;
