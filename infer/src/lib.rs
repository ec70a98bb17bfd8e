//! The next view for a real scan: from clouds or depth images to a ranked list of camera poses, without a model of
//! the object.
//!
//! ```
//! use geometry::PointCloud;
//! use infer::{InferConfig, Scan, Session};
//! use nalgebra::Point3;
//!
//! # fn main() -> Result<(), infer::SessionError> {
//! let sheet = (0..900).map(|i| Point3::new(f64::from(i % 30) * 0.004, f64::from(i / 30) * 0.004, 0.0)).collect();
//! let cloud = PointCloud { points: sheet, normals: Vec::new() };
//!
//! let config = InferConfig { working_distance_m: 0.8, ..Default::default() };
//! let mut session = Session::new(config, None)?; // or Some(Network::new(planner)) with a model::NetPlanner
//! session.add_scan(Scan::Cloud { cloud, from: Some(Point3::new(0.06, 0.06, 0.8)) })?;
//! let answer = session.next_view()?;
//!
//! let next = answer.next.expect("the sheet has a rim to look beyond");
//! println!("{:?}, expected gain {:.1} %", next.world_from_camera.matrix, 100.0 * answer.stop.expected_gain);
//! # Ok(()) }
//! ```
//!
//! The way of a decision: [`scan`] cleans, thins and gives normals; [`session`] merges and keeps the state;
//! [`choose`] takes the planner that the evidence allows; [`constraints`] rule out what the cell forbids; [`pose`]
//! makes the answer usable; [`answer`] and [`report`] show it. Nothing here reads files: that is the program's part.
//!
//! Candidates move exactly with a rigid motion or a change of unit of the input.

pub mod answer;
pub mod choose;
pub mod config;
pub mod constraints;
pub mod farthest;
pub mod overlap;
pub mod pose;
pub mod report;
pub mod scan;
pub mod session;
pub mod stop;
pub mod thin;

pub use answer::{Answer, Candidate};
pub use choose::{Evidence, Network};
pub use config::{ConfigError, InferConfig, PlannerName};
pub use constraints::{Constraint, ConstraintsConfig};
pub use farthest::FarthestPlanner;
pub use scan::{Scan, ScanReport};
pub use session::{Session, SessionError};
