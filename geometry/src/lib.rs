//! The pure part of next-best-view planning: points in, views and scores out.
//!
//! **Frames.** `world_from_camera` maps camera coordinates to world coordinates; the camera frame is
//! +X right, +Y down, +Z forward (OpenCV). **Units** are metres and radians. Nothing here reads files,
//! the clock or global randomness, and nothing fails on valid input: degenerate input (an empty cloud, one
//! point) has a documented answer.

pub mod camera;
pub mod cloud;
pub mod mesh;
pub mod planner;
pub mod rng;
pub mod view;

pub use camera::{DepthImage, PinholeCamera};
pub use cloud::PointCloud;
pub use mesh::Mesh;
pub use planner::{CandidateView, Misses, Observation, PastScan, Planner, RankedView, ScanState, Seen};
pub use view::View;
