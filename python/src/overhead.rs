//! What planning takes without Python around it, for the table in docs/python.md.

use crate::arrays;
use crate::fault::detached;
use geometry::PointCloud;
use planning::{Scan, SessionConfig};
use pyo3::prelude::*;
use std::time::Instant;

/// Seconds that adding a cloud takes, and seconds of the decision after it, from Rust's own arrays on.
#[pyfunction]
pub fn rust_seconds(py: Python<'_>, points: &Bound<'_, PyAny>, origin: &Bound<'_, PyAny>) -> PyResult<(f64, f64)> {
    let (points, from) = (arrays::points("points", points)?, arrays::position("origin", origin)?);
    detached(py, || {
        let network = infer::weights::network(None, infer::weights::CPU)?;
        let mut session = planning::Session::new(SessionConfig::default(), Some(network))?;
        let scan = Scan::Cloud { cloud: PointCloud { points, normals: Vec::new() }, from: Some(from) };
        let clock = Instant::now();
        session.add_scan(scan)?;
        let added = clock.elapsed().as_secs_f64();
        let clock = Instant::now();
        session.next_view()?;
        Ok((added, clock.elapsed().as_secs_f64()))
    })
}
