//! A policy that a caller brings along, by the name that it has in the tables.

use super::BoxedPlanner;
use std::fmt;
use std::sync::Arc;

/// Makes the policy anew for every episode.
#[derive(Clone)]
pub struct Own {
    make: Arc<dyn Fn() -> BoxedPlanner<'static> + Send + Sync>,
    /// Says that episodes of the same version need not be run again; without it they always are.
    pub version: Option<String>,
}

impl Own {
    /// Of this version.
    pub fn new(version: Option<String>, make: impl Fn() -> BoxedPlanner<'static> + Send + Sync + 'static) -> Self {
        Self { make: Arc::new(make), version }
    }

    /// For one episode.
    pub fn make(&self) -> BoxedPlanner<'static> {
        (self.make)()
    }
}

impl fmt::Debug for Own {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Own({:?})", self.version)
    }
}

impl PartialEq for Own {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.make, &other.make) && self.version == other.version
    }
}
