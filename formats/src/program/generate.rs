//! Completions for shells and man pages, from the command line's own definition.

use clap::builder::PossibleValuesParser;
use clap::{Arg, ArgMatches, Command};
use clap_complete::Shell;
use std::io::{self, Write};

/// What can be asked for.
const KINDS: [&str; 6] = ["bash", "zsh", "fish", "powershell", "elvish", "man"];

/// The flag, alone on its command line.
pub(super) fn flag() -> Arg {
    Arg::new("generate")
        .long("generate")
        .value_name("KIND")
        .value_parser(PossibleValuesParser::new(KINDS))
        .hide_possible_values(true)
        .exclusive(true)
        .help("Print completions (bash, zsh, fish, powershell, elvish) or the man page (man)")
}

/// Prints what was asked for, if anything was.
///
/// # Errors
/// Output that cannot be written.
pub(super) fn generate(matches: &ArgMatches, mut command: Command, out: &mut dyn Write) -> io::Result<bool> {
    let Some(kind) = matches.get_one::<String>("generate") else { return Ok(false) };
    match kind.parse::<Shell>() {
        Ok(shell) => {
            let name = command.get_name().to_owned();
            let mut text = Vec::new();
            clap_complete::generate(shell, &mut command, name, &mut text);
            out.write_all(&text)?;
        }
        Err(_) => clap_mangen::Man::new(command).render(out)?,
    }
    Ok(true)
}
