//! Files that are whole or absent, and run directories that say how they were made.

use crate::{ConfigError, FormatError};
use serde::Serialize;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Writes a file so that it is whole or absent (or still the old one), whatever happens: a temporary sibling,
/// synced, renamed. Parent directories are made. A link is followed, not replaced; a device or pipe (`/dev/stdout`,
/// `/dev/null`) is written to as it is.
///
/// # Errors
/// What the operating system refuses (no space, no permission); the temporary file is then removed.
pub fn atomic_write(path: &Path, bytes: &[u8]) -> Result<(), FormatError> {
    atomic_write_with(path, |w| w.write_all(bytes))
}

/// [`atomic_write`] for content that is made while it is written.
///
/// # Errors
/// As [`atomic_write`].
pub fn atomic_write_with(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> Result<(), FormatError> {
    if std::fs::metadata(path).is_ok_and(|kind| !kind.is_file() && !kind.is_dir()) {
        return write_into(path, write).map_err(|e| FormatError::io(path, "write", e));
    }
    let path = &behind_links(path);
    let parent = parent(path);
    std::fs::create_dir_all(parent).map_err(|e| FormatError::io(parent, "make the directory", e))?;
    (|| {
        let mut builder = tempfile::Builder::new();
        #[cfg(unix)]
        let builder = {
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(std::fs::Permissions::from_mode(0o666)) // the umask takes its share
        };
        let temporary = builder.prefix(&temporary_prefix(path)).suffix(TEMPORARY).tempfile_in(parent);
        // Its message has the temporary name, which nobody knows.
        let temporary = temporary.map_err(|e| std::io::Error::from(e.kind()))?;
        let mut buffered = BufWriter::with_capacity(1 << 20, temporary.as_file());
        write(&mut buffered)?;
        buffered.flush()?;
        drop(buffered);
        temporary.as_file().sync_all()?;
        temporary.persist(path).map_err(|e| e.error)?;
        std::fs::File::open(parent)?.sync_all()
    })()
    .map_err(|e| FormatError::io(path, "write", e))
}

/// Writes to a device or pipe, which cannot be replaced: there would be a file in its place.
fn write_into(path: &Path, write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> std::io::Result<()> {
    let mut buffered = BufWriter::new(std::fs::File::options().write(true).open(path)?);
    write(&mut buffered)?;
    buffered.flush()
}

/// The file that links lead to, there or not; where they lead in a circle, one of them.
fn behind_links(path: &Path) -> PathBuf {
    const MOST: usize = 40;
    let follow = |link: &PathBuf| Some(parent(link).join(std::fs::read_link(link).ok()?));
    std::iter::successors(Some(path.to_owned()), follow).take(MOST).last().unwrap_or_else(|| path.to_owned())
}

/// Ending of the temporary siblings that [`atomic_write`] makes; a killed process may leave one behind.
pub const TEMPORARY: &str = ".tmp";

/// Removes the temporary siblings of `path` that a killed process left behind.
pub fn remove_temporaries(path: &Path) {
    let prefix = temporary_prefix(path);
    for entry in std::fs::read_dir(parent(path)).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with(&prefix) && name.ends_with(TEMPORARY) {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// What the names of the temporary siblings of `path` begin with: its own name, cut where that is so long that nothing could
/// be added to it.
fn temporary_prefix(path: &Path) -> String {
    const LONGEST: usize = 200;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let end = (0..=LONGEST.min(name.len())).rev().find(|&i| name.is_char_boundary(i)).unwrap_or(0);
    format!(".{}.", &name[..end])
}

fn parent(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// How a run came about; `run.toml` in its directory.
#[derive(Clone, Debug, Serialize)]
pub struct Provenance {
    /// The command line; what is no Unicode in it is replaced.
    pub command: Vec<String>,
    /// Program and version.
    pub program: String,
    /// Commit that the program was built from.
    pub commit: String,
    /// Host name.
    pub host: String,
    /// Processor architecture and operating system.
    pub platform: String,
    /// Number of threads the machine offers.
    pub threads: usize,
    /// Other versions of the program that worked in this directory before.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub earlier: Vec<String>,
    /// Start, UTC.
    pub started: String,
    /// End, UTC; absent while the run is active, and after a kill.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ended: Option<String>,
    /// How it ended.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outcome: Option<String>,
}

impl Provenance {
    /// Of this process, now, by a program that was built from this commit.
    pub fn now(program: &str, commit: &str) -> Self {
        Self {
            command: std::env::args_os().map(|word| word.to_string_lossy().into_owned()).collect(),
            program: format!("{program} {}", env!("CARGO_PKG_VERSION")),
            commit: commit.to_owned(),
            host: std::fs::read_to_string("/proc/sys/kernel/hostname")
                .map(|s| s.trim().to_owned())
                .or_else(|_| std::env::var("HOSTNAME"))
                .unwrap_or_else(|_| "unknown".to_owned()),
            platform: format!("{} {}", std::env::consts::ARCH, std::env::consts::OS),
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            earlier: Vec::new(),
            started: utc(SystemTime::now()),
            ended: None,
            outcome: None,
        }
    }

    /// Program, version and commit, as messages have them.
    fn version(&self) -> String {
        named(&self.program, &self.commit)
    }
}

fn named(program: &str, commit: &str) -> String {
    format!("{program} ({commit})")
}

/// The versions that worked in a directory, as its note tells; what an older program did not note is unknown.
fn noted(note: &Path) -> Vec<String> {
    let Ok(bytes) = std::fs::read(note) else { return Vec::new() };
    let table: toml::Table = String::from_utf8_lossy(&bytes).parse().unwrap_or_default();
    let text = |key: &str| table.get(key).and_then(toml::Value::as_str);
    let earlier = table.get("earlier").and_then(toml::Value::as_array).into_iter().flatten();
    let last = match text("program") {
        Some(program) => named(program, text("commit").unwrap_or("unknown")),
        None => "an unknown version".to_owned(),
    };
    earlier.filter_map(toml::Value::as_str).map(str::to_owned).chain([last]).collect()
}

/// A directory that holds all that is needed to repeat a run: `config.toml` (resolved) and `run.toml`.
#[derive(Debug)]
pub struct RunDir {
    path: PathBuf,
    provenance_name: String,
    provenance: Provenance,
}

/// Why a run directory cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// A file cannot be written.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// The settings cannot be written.
    #[error(transparent)]
    Config(#[from] ConfigError),
}

impl RunDir {
    /// Makes the directory if need be and writes `config.toml` and `run.toml`.
    ///
    /// # Errors
    /// What the operating system refuses.
    pub fn create<T: Serialize>(path: &Path, program: &str, commit: &str, config: &T) -> Result<Self, RunError> {
        Self::create_part(path, program, commit, config, "run.toml")
    }

    /// [`RunDir::create`] for one of several processes that share the directory: each has a provenance file of
    /// its own. Versions that a file of this name tells of stay noted ([`Provenance::earlier`]).
    ///
    /// # Errors
    /// What the operating system refuses.
    pub fn create_part<T: Serialize>(
        path: &Path,
        program: &str,
        commit: &str,
        config: &T,
        provenance_name: &str,
    ) -> Result<Self, RunError> {
        atomic_write(&path.join("config.toml"), &crate::config::to_stored(config)?)?;
        let mut provenance = Provenance::now(program, commit);
        let now = provenance.version();
        for version in noted(&path.join(provenance_name)).into_iter().filter(|version| *version != now) {
            if !provenance.earlier.contains(&version) {
                provenance.earlier.push(version);
            }
        }
        let run = Self { path: path.to_owned(), provenance_name: provenance_name.to_owned(), provenance };
        run.write_provenance()?;
        Ok(run)
    }

    /// The directory.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// How the run came about.
    pub fn provenance(&self) -> &Provenance {
        &self.provenance
    }

    /// What to tell a user whose directory has work (`episodes`, say) that other versions of the program did, and that this one
    /// is about to add to; `None` if only this version worked there.
    pub fn mixture(&self, work: &str) -> Option<String> {
        let earlier = &self.provenance.earlier;
        (!earlier.is_empty()).then(|| {
            format!(
                "{:?}: {work} were made here by {}, and this is {}: different versions may give different results, which are \
                 not comparable; give another --out to make all of them with this version",
                self.path,
                earlier.join(", "),
                self.provenance.version()
            )
        })
    }

    /// Notes the end of the run.
    ///
    /// # Errors
    /// What the operating system refuses.
    pub fn finish(&mut self, outcome: &str) -> Result<(), RunError> {
        self.provenance.ended = Some(utc(SystemTime::now()));
        self.provenance.outcome = Some(outcome.to_owned());
        self.write_provenance()
    }

    fn write_provenance(&self) -> Result<(), RunError> {
        let text = crate::config::to_toml(&self.provenance)?;
        Ok(atomic_write(&self.path.join(&self.provenance_name), text.as_bytes())?)
    }
}

/// Path of a new run: `<base>/<UTC time>`, e.g. `runs/train/2026-01-31T12-00-00`, with a number appended where
/// that exists.
pub fn new_run_path(base: &Path) -> PathBuf {
    let name = utc(SystemTime::now()).replace(':', "-");
    let name = name.trim_end_matches('Z');
    let first = base.join(name);
    if !first.exists() {
        return first;
    }
    (2..).map(|i| base.join(format!("{name}-{i}"))).find(|p| !p.exists()).unwrap_or(first)
}

/// The directory under `base` (one level, or `base` itself) whose file `marker` is newest.
pub fn newest(base: &Path, marker: &str) -> Option<PathBuf> {
    let children = std::fs::read_dir(base).ok()?.flatten().map(|e| e.path());
    let dated = |p: PathBuf| Some((std::fs::metadata(p.join(marker)).ok()?.modified().ok()?, p));
    children.chain([base.to_owned()]).filter_map(dated).max().map(|(_, p)| p)
}

/// UTC time as `2026-01-31T12:00:00Z` (civil-from-days, H. Hinnant).
pub fn utc(time: SystemTime) -> String {
    let seconds = time.duration_since(UNIX_EPOCH).unwrap_or(Duration::ZERO).as_secs();
    let (days, rest) = (seconds / 86_400 + 719_468, seconds % 86_400);
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted_month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted_month + 2) / 5 + 1;
    let month = if shifted_month < 10 { shifted_month + 3 } else { shifted_month - 9 };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02}T{:02}:{:02}:{:02}Z", rest / 3600, rest / 60 % 60, rest % 60)
}

#[cfg(test)]
mod tests;
