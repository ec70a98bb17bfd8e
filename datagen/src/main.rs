//! `datagen`: from meshes to training shards.

use std::process::ExitCode;

fn main() -> ExitCode {
    datagen::program::main(std::env::args_os())
}
