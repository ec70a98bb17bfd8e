//! The pure part of next-best-view planning: points in, views and scores out.
//!
//! **Frames.** `world_from_camera` maps camera coordinates to world coordinates; the camera frame is
//! +X right, +Y down, +Z forward (OpenCV). **Units** are metres and radians. Nothing here reads files,
//! the clock or global randomness, and nothing fails on valid input: degenerate input (an empty cloud, one
//! point) has a documented answer.

pub mod boundary;
pub mod camera;
pub mod cloud;
pub mod cluster;
pub mod coverage;
pub mod density;
#[cfg(test)]
mod golden;
pub mod lens;
pub mod mesh;
pub mod metrics;
pub mod neighbors;
pub mod normals;
pub mod orientation;
pub mod rank_correlation;
pub mod reconstruction;
pub mod rng;
pub mod sampling;
pub mod sphere;
pub mod undistort;
pub mod view;

pub use boundary::{BoundaryConfig, boundary_points};
pub use camera::{DepthImage, PinholeCamera};
pub use cloud::{PointCloud, VoxelOrigin};
pub use coverage::{ViewScore, coverage, overlap, score_view};
pub use lens::Lens;
pub use mesh::Mesh;
pub use neighbors::{NeighborGrid, Neighborhoods, mean_spacing};
pub use normals::{estimate_normals, orient_normals_along, orient_normals_toward};
pub use orientation::orient_normals_consistent;
pub use reconstruction::{Reconstruction, reconstruct};
pub use undistort::{Undistorted, undistort_depth};
pub use view::View;
