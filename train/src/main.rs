//! `train`: networks for next-best-view planning from data that `datagen` made.

use std::process::ExitCode;

fn main() -> ExitCode {
    train::program::main(std::env::args_os())
}
