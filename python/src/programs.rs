//! The four programs, for the scripts that a wheel installs: one copy of the network serves them all.

use crate::fault::Fault;
use pyo3::prelude::*;
use std::ffi::OsString;
use std::process::ExitCode;

/// Runs a program with this command line, its own name first, and answers with its exit code. A command line that cannot be
/// meant ends the process with code 2.
#[pyfunction]
pub fn run_program(py: Python<'_>, name: &str, words: Vec<OsString>) -> PyResult<u8> {
    let main = match name {
        "datagen" => datagen::program::main,
        "train" => train::program::main,
        "infer" => infer::program::main,
        "evaluate" => evaluate::program::main,
        _ => return Err(Fault::Value(format!("no program {name:?}")).into()),
    } as fn(std::vec::IntoIter<OsString>) -> ExitCode;
    let code = py.detach(|| main(words.into_iter()));
    // The number is not to be had from a code, but equal codes are.
    Ok((0..=u8::MAX).find(|number| ExitCode::from(*number) == code).unwrap_or(1))
}
