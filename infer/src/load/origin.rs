//! Where a cloud was measured from.

use crate::args::numbers;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

/// Where a cloud was measured from, in the unit of its numbers.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(
    untagged,
    expecting = "the camera's position, [x, y, z], or two points of a line scanner's path, [[x, y, z], [x, y, z]]"
)]
pub enum Origin {
    /// The camera's position.
    Point([f64; 3]),
    /// Two points of the straight path of a line scanner.
    Path([[f64; 3]; 2]),
}

impl Origin {
    /// `x,y,z`, or `x,y,z..x,y,z`.
    ///
    /// # Errors
    /// What was expected.
    pub fn parse(text: &str) -> Result<Self, String> {
        match text.split_once("..") {
            None => Ok(Self::Point(numbers(text)?)),
            Some((first, last)) if first.trim() == last.trim() => Err("a path needs two different points".to_owned()),
            Some((first, last)) => Ok(Self::Path([numbers(first)?, numbers(last)?])),
        }
    }

    /// The position, or the middle of the path, metres.
    pub fn middle(&self, metres_per_unit: f64) -> Point3<f64> {
        match self {
            Self::Point(p) => Point3::from(*p) * metres_per_unit,
            Self::Path([a, b]) => nalgebra::center(&Point3::from(*a), &Point3::from(*b)) * metres_per_unit,
        }
    }

    /// The path, metres.
    pub fn path(&self, metres_per_unit: f64) -> Option<[Point3<f64>; 2]> {
        match self {
            Self::Point(_) => None,
            Self::Path(path) => Some(path.map(|p| Point3::from(p) * metres_per_unit)),
        }
    }

    /// Every position in it.
    pub fn positions(&self) -> &[[f64; 3]] {
        match self {
            Self::Point(p) => std::slice::from_ref(p),
            Self::Path(path) => path,
        }
    }
}
