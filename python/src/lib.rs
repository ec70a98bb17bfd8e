//! The Python package `benbv`: a thin layer over the other crates, without logic. What is here takes arrays and
//! answers with arrays and JSON; `python/benbv` beside it gives both names, types and help.

mod arrays;
mod benchmark;
mod episode;
mod fault;
mod files;
mod overhead;
mod policy;
mod programs;
mod scene;
mod session;
mod shards;
mod state;

use pyo3::prelude::*;

/// The native half of `benbv`.
#[pymodule]
fn _benbv(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("PlanError", module.py().get_type::<fault::PlanError>())?;
    module.add("VERSION", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<session::RobotSession>()?;
    module.add_class::<state::State>()?;
    module.add_class::<scene::Scene>()?;
    module.add_class::<episode::Episode>()?;
    module.add_function(wrap_pyfunction!(files::read_cloud, module)?)?;
    module.add_function(wrap_pyfunction!(files::read_file, module)?)?;
    module.add_function(wrap_pyfunction!(files::read_depth, module)?)?;
    module.add_function(wrap_pyfunction!(files::read_mesh, module)?)?;
    module.add_function(wrap_pyfunction!(files::read_arm, module)?)?;
    module.add_function(wrap_pyfunction!(files::read_camera, module)?)?;
    module.add_function(wrap_pyfunction!(files::read_poses, module)?)?;
    module.add_function(wrap_pyfunction!(state::look_at, module)?)?;
    module.add_function(wrap_pyfunction!(scene::scan, module)?)?;
    module.add_function(wrap_pyfunction!(scene::depth_to_points, module)?)?;
    module.add_function(wrap_pyfunction!(scene::coverage, module)?)?;
    module.add_function(wrap_pyfunction!(scene::overlap, module)?)?;
    module.add_function(wrap_pyfunction!(scene::distances, module)?)?;
    module.add_function(wrap_pyfunction!(benchmark::benchmark, module)?)?;
    module.add_function(wrap_pyfunction!(overhead::rust_seconds, module)?)?;
    module.add_class::<shards::Shards>()?;
    module.add_function(wrap_pyfunction!(programs::run_program, module)?)?;
    Ok(())
}
