//! What the programs share: flags, messages, threads, printing, stopping and exit codes.

mod generate;

use crate::config::{ConfigError, Flag};
use clap::error::ErrorKind;
use clap::{ArgMatches, Args, Command, Parser};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::error::Error;
use std::ffi::OsString;
use std::fmt::Display;
use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use tracing_subscriber::EnvFilter;

/// The exit code of a run that was asked to stop; what it had done is kept.
pub const STOPPED: u8 = 130;

/// What the exit codes mean, in every program; the end of every `--help`.
pub const EXIT_CODES: &str = "Exit codes: 0 success; 1 error, one line on stderr; 2 invalid command line; 3 no view is \
                              left (infer); 130 stopped by Ctrl-C or SIGTERM, work so far is kept.";

/// Threads per core that `--jobs` may ask for.
const JOBS_PER_CORE: usize = 4;

/// Flags that every program has.
#[derive(Args, Clone, Debug, Default)]
pub struct CommonArgs {
    /// Settings from a TOML file; configs/ lists every setting
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// One setting, e.g. --set seed=3; repeatable
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Random seed [default: 0]
    #[arg(long, value_name = "NUMBER", value_parser = seed)]
    pub seed: Option<u64>,
    /// Number of threads; 0 means one per core
    #[arg(long, value_name = "COUNT", default_value_t = 0, value_parser = jobs)]
    pub jobs: usize,
    /// More messages; -vv for all of them
    #[arg(short, long, action = clap::ArgAction::Count)]
    pub verbose: u8,
}

impl CommonArgs {
    /// The settings: defaults, then `--config`, then `--set`, then these flags and `--seed`.
    ///
    /// # Errors
    /// As [`crate::config::load`].
    pub fn settings<T>(&self, flags: impl IntoIterator<Item = Option<Flag>>) -> Result<T, ConfigError>
    where
        T: Serialize + DeserializeOwned + Default,
    {
        let flags: Vec<Flag> = flags.into_iter().flatten().chain(self.seed_flag()).collect();
        crate::config::load(self.config.as_deref(), &self.set, &flags)
    }

    /// `--seed` as a layer of settings.
    pub fn seed_flag(&self) -> Option<Flag> {
        Flag::given("--seed", "seed", self.seed.map(u64::cast_signed))
    }

    /// Starts messages on stderr at the first of these levels; each `-v` takes the next. `RUST_LOG` overrides both.
    pub fn start_messages(&self, levels: [&str; 3]) {
        let given = std::env::var(EnvFilter::DEFAULT_ENV).ok().filter(|text| !text.trim().is_empty());
        let filter = given.and_then(|text| match text.parse::<EnvFilter>() {
            Ok(filter) => Some(filter),
            Err(e) => {
                complain("warning", &format!("{} is {text:?}: {e}; taking the default", EnvFilter::DEFAULT_ENV));
                None
            }
        });
        let filter = filter.unwrap_or_else(|| EnvFilter::new(levels[usize::from(self.verbose.min(2))]));
        let colours = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty());
        tracing_subscriber::fmt()
            .with_env_filter(filter)
            .with_writer(std::io::stderr)
            .with_ansi(colours)
            .with_target(false)
            .init();
    }

    /// Starts as many threads as `--jobs` says; without it they start automatically, one per core.
    ///
    /// # Errors
    /// The system refuses to start the threads.
    pub fn start_threads(&self) -> Result<(), ProgramError> {
        match self.jobs {
            0 => Ok(()),
            n => rayon::ThreadPoolBuilder::new()
                .num_threads(n)
                .build_global()
                .map_err(|source| ProgramError::Threads { jobs: n, cause: source }),
        }
    }
}

/// Why a program cannot start or continue.
#[derive(Debug, thiserror::Error)]
pub enum ProgramError {
    /// The threads do not start.
    #[error("--jobs {jobs}: cannot start the threads: {cause}")]
    Threads {
        /// As given.
        jobs: usize,
        /// Why not.
        cause: rayon::ThreadPoolBuildError,
    },
    /// No handler for signals.
    #[error("cannot watch for Ctrl-C: {0}")]
    Signals(#[from] ctrlc::Error),
    /// Nothing can be printed.
    #[error("cannot write to stdout: {0}")]
    Stdout(#[from] std::io::Error),
}

/// What a flag's value must be.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FlagError {
    /// Not a seed.
    #[error("expected a whole number from 0 to {max}", max = i64::MAX)]
    Seed,
    /// Not a length.
    #[error("expected a length above 0, in metres")]
    Length,
    /// Not a share.
    #[error("expected a share from 0 to 1")]
    Share,
    /// Not a number of threads.
    #[error(
        "expected a number of threads from 1 to {most}, {JOBS_PER_CORE} per core of this machine, or 0 for one per core"
    )]
    Jobs {
        /// The largest.
        most: usize,
    },
}

/// Reads a seed: a number that TOML, whose numbers are signed, can keep as well.
///
/// # Errors
/// Anything else.
pub fn seed(text: &str) -> Result<u64, FlagError> {
    text.parse().ok().filter(|seed| i64::try_from(*seed).is_ok()).ok_or(FlagError::Seed)
}

/// Reads a number of threads: 0 for one per core, and no more than the machine can use.
///
/// # Errors
/// Anything else.
pub fn jobs(text: &str) -> Result<usize, FlagError> {
    let most = JOBS_PER_CORE * std::thread::available_parallelism().map_or(1, usize::from);
    text.parse().ok().filter(|jobs| *jobs <= most).ok_or(FlagError::Jobs { most })
}

/// Prints to stdout; a reader that went away (`| head`) is no error.
///
/// # Errors
/// Anything else that the system refuses.
pub fn print(text: impl Display) -> Result<(), ProgramError> {
    print_to(&mut std::io::stdout().lock(), text)
}

/// [`print()`] with an end of line.
///
/// # Errors
/// As [`print()`].
pub fn print_line(text: impl Display) -> Result<(), ProgramError> {
    print(format_args!("{text}\n"))
}

fn print_to(out: &mut impl Write, text: impl Display) -> Result<(), ProgramError> {
    match write!(out, "{text}").and_then(|()| out.flush()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(e.into()),
        _ => Ok(()),
    }
}

/// A line on stderr; where that is closed, none.
pub fn complain(kind: &str, message: &dyn Display) {
    let _ = writeln!(std::io::stderr(), "{kind}: {message}");
}

/// The exit code of a program: its own, or 1 and the message that says why.
pub fn finish<E: Into<Box<dyn Error + Send + Sync>>>(result: Result<ExitCode, E>) -> ExitCode {
    result.unwrap_or_else(|error| {
        complain("error", &with_causes(&*error.into()));
        ExitCode::FAILURE
    })
}

/// An error with its causes, each said once: most errors say their cause themselves.
pub fn with_causes(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut next = error.source();
    while let Some(cause) = next {
        let words = cause.to_string();
        if !text.contains(&words) {
            text.push_str(": ");
            text.push_str(&words);
        }
        next = cause.source();
    }
    text
}

/// Reads a command line, the program's name first. A number below zero is taken as the value of its flag, whose check says what
/// is wrong with it. Where completions or a man page are asked for, they are printed, and the program ends.
///
/// # Errors
/// An invalid command line.
pub fn parse_from<C: Parser>(words: impl IntoIterator<Item = OsString>) -> Result<C, clap::Error> {
    let (mut command, matches) = matches::<C>(words)?;
    match generate::generate(&matches, command.clone(), &mut std::io::stdout().lock()) {
        Ok(false) => C::from_arg_matches(&matches).map_err(|error| error.format(&mut command)),
        // A reader that goes away is no error.
        Ok(true) | Err(_) => std::process::exit(0),
    }
}

fn matches<C: Parser>(words: impl IntoIterator<Item = OsString>) -> Result<(Command, ArgMatches), clap::Error> {
    fn with_numbers(command: Command) -> Command {
        let command = command.mut_args(|arg| match arg.get_action().takes_values() {
            true => arg.allow_negative_numbers(true),
            false => arg,
        });
        command.mut_subcommands(with_numbers)
    }
    let mut command = with_numbers(C::command()).arg(generate::flag());
    let matches = command.try_get_matches_from_mut(words.into_iter().map(negative))?;
    Ok((command, matches))
}

/// A word that is one number below zero, or several with commas between, as the parser takes it for a value: it knows `-1.5`, and
/// takes `-1e-3`, `-.5` and `-1,0,2` for flags, which none of ours is.
fn negative(word: OsString) -> OsString {
    let Some(text) = word.to_str().filter(|text| text.starts_with('-') && !text.starts_with("--")) else { return word };
    match text.parse::<f64>() {
        // Without an exponent.
        Ok(number) if number.is_finite() => number.to_string().into(),
        // Who reads several trims each.
        Err(_) if !text.contains(',') && !text.contains("..") => word,
        _ => format!(" {text}").into(),
    }
}

/// Ends the program with code 2, as the parser of the command line does: for flags whose sense depends on settings.
pub fn misuse<C: Parser>(message: &str) -> ! {
    C::command().error(ErrorKind::ArgumentConflict, message).exit()
}

/// Reads a length in metres.
///
/// # Errors
/// Anything else than a finite number above 0.
pub fn length(text: &str) -> Result<f64, FlagError> {
    text.parse().ok().filter(|x: &f64| *x > 0.0 && x.is_finite()).ok_or(FlagError::Length)
}

/// Reads a share.
///
/// # Errors
/// Anything else than a number from 0 to 1.
pub fn share(text: &str) -> Result<f64, FlagError> {
    text.parse().ok().filter(|x| (0.0..=1.0).contains(x)).ok_or(FlagError::Share)
}

/// Becomes true when the program is asked to stop (Ctrl-C, SIGTERM); `message` says what happens next. Asked a second
/// time, the program ends at once.
///
/// # Errors
/// A system that takes no handler.
pub fn stop_when_asked(message: &'static str) -> Result<&'static AtomicBool, ProgramError> {
    static STOP: AtomicBool = AtomicBool::new(false);
    ctrlc::set_handler(move || {
        if STOP.swap(true, Ordering::SeqCst) {
            std::process::exit(i32::from(STOPPED));
        }
        let _ = writeln!(std::io::stderr(), "{message}");
    })?;
    Ok(&STOP)
}

#[cfg(test)]
mod tests;
