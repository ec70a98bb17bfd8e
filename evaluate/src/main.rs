//! `evaluate`: policies against each other on simulated objects.

use std::process::ExitCode;

fn main() -> ExitCode {
    evaluate::program::main(std::env::args_os())
}
