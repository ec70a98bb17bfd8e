//! `infer`: the next view for a real scan.

use std::process::ExitCode;

fn main() -> ExitCode {
    infer::program::main(std::env::args_os())
}
