//! Next-best-view planning: scans in, ranked views out. Every program is a shell around this crate.
//!
//! ```
//! use geometry::PointCloud;
//! use nalgebra::Point3;
//! use planning::{Scan, Session, SessionConfig};
//!
//! # fn main() -> Result<(), planning::SessionError> {
//! let sheet = (0..900).map(|i| Point3::new(f64::from(i % 30) * 0.004, f64::from(i / 30) * 0.004, 0.0)).collect();
//! let cloud = PointCloud { points: sheet, normals: Vec::new() };
//!
//! let config = SessionConfig { working_distance_m: 0.8, ..Default::default() };
//! let mut session = Session::new(config, None)?; // or Some(Network::new(planner)) with a model::NetPlanner
//! session.add_scan(Scan::Cloud { cloud, from: Some(Point3::new(0.06, 0.06, 0.8)) })?;
//! let answer = session.next_view()?;
//!
//! let next = answer.next.expect("the sheet has a rim to look beyond");
//! println!("{:?}, expected gain {:.1} %", next.world_from_camera.matrix, 100.0 * answer.stop.expected_gain.unwrap_or_default());
//! # Ok(()) }
//! ```
//!
//! A decision takes this path: [`scan`] cleans and thins a scan and gives it normals; [`accumulate`] merges it into the
//! cloud; [`session`] keeps the [`state`]; a [`planner`] ranks views, [`planners::auto`] taking the one that the evidence
//! allows; [`constraints`] rule out what the cell forbids; [`pose`] and [`answer`] make the result usable.
//!
//! Nothing here reads files or the clock. Candidates move exactly with a rigid motion or a change of unit of the input.

pub mod accumulate;
pub mod answer;
pub mod budget;
pub mod candidates;
pub mod config;
pub mod constraints;
pub mod doubt;
pub mod estimate;
#[cfg(test)]
#[allow(dead_code)]
#[path = "../../geometry/src/golden.rs"]
mod golden;
mod normals;
pub mod overlap;
pub mod planner;
pub mod planners;
pub mod pose;
pub mod reach;
pub mod registration;
pub mod scan;
pub mod sensor;
pub mod session;
pub mod state;
pub mod stop;
pub mod support;
pub mod thin;
pub mod turntable;

pub use accumulate::Accumulate;
pub use answer::{Answer, Candidate};
pub use budget::{Budget, Left, Stopped};
pub use candidates::{Angles, CandidateConfig, CandidateView, Observation, candidate_views};
pub use config::{ConfigError, PlannerName, RankBy, SessionConfig};
pub use constraints::{Constraint, ConstraintsConfig};
#[cfg(test)]
use geometry::PointCloud;
pub use planner::{PlanError, Planner, RankedView};
pub use planners::auto::{AutoPlanner, Evidence, Network};
pub use planners::farthest::FarthestPlanner;
pub use planners::volumetric::{
    Allowed, ExpectedPoint, Forecasts, Hole, Surface, Unseen, ViewForecast, VolumetricConfig, VolumetricPlanner,
    Workspace,
};
pub use reach::{Reach, Reached, RobotConfig};
pub use scan::{Reading, Scan, ScanReport};
pub use sensor::SensorConfig;
pub use session::{Session, SessionError};
pub use state::{CameraPose, NoReturn, PastScan, ScanState, Seen};
pub use stop::{Missing, Stop};
pub use support::{Plane, Support};
pub use turntable::{TableStop, TurntableConfig};
