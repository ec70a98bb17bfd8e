//! The policies that planning is measured against, by their names on the command line: one file each.
//! `name` reads the names, `build` makes the policies.

pub mod build;
pub mod name;
pub mod oracle;
pub mod own;
#[cfg(feature = "networks")]
pub mod pc_nbv;
pub mod random_boundary;
pub mod random_sphere;
pub mod random_u_sphere;
pub mod recorded;
pub mod refined;
pub mod see;
pub mod sphere;
pub mod table;

use planning::{Planner, ScanState};

pub use build::{PolicyContext, PolicyError, check, make, weights_of};
pub use name::{NameError, PAPER_POLICIES, POLICIES, Policy, RECORDED_POLICIES};
pub use own::Own;

/// How much farther than the working distance the published sphere policies stand from the centre, metres.
const PAPER_OFFSET: f64 = 0.3;
/// Distance from the origin to cameras on a sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Radius {
    /// The working distance: as far as the policies that stand before the surface.
    Working,
    /// The working distance and 0.3 m, as published.
    Paper,
    /// This many metres.
    Fixed(f64),
}

impl Radius {
    /// In metres.
    pub fn metres(self, state: &ScanState) -> f64 {
        match self {
            Radius::Working => state.working_distance,
            Radius::Paper => state.working_distance + PAPER_OFFSET,
            Radius::Fixed(r) => r,
        }
    }
}

/// A policy ready to run.
pub type BoxedPlanner<'a> = Box<dyn Planner + Send + 'a>;
