//! Advisory locks on output directories: two processes must not write into one. The operating system lets go of a lock
//! when its holder ends, however it ends.

use crate::FormatError;
use std::fs::{File, TryLockError};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

/// Name of the lock of a whole directory.
pub const LOCK: &str = ".lock";

/// A lock; let go of when it is dropped, or the process ends.
#[derive(Debug)]
pub struct Lock(#[allow(dead_code, reason = "held, never read")] File);

/// A lock whose file goes with it.
#[derive(Debug)]
pub struct PassingLock {
    path: PathBuf,
    #[allow(dead_code, reason = "held, never read")]
    lock: Lock,
}

impl Drop for PassingLock {
    fn drop(&mut self) {
        // While it is held. Who opened it before finds out that it is gone.
        let _ = std::fs::remove_file(&self.path);
    }
}

/// The lock of one file or directory that is written as a whole, without waiting: beside it, and gone afterwards.
///
/// # Errors
/// As [`try_lock`].
pub fn try_lock_of(output: &Path, holder: &str) -> Result<PassingLock, LockError> {
    let parent = output.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let name = format!(".{}.lock", output.file_name().unwrap_or_default().to_string_lossy());
    let path = parent.join(&name);
    loop {
        let lock = try_lock(parent, &name, holder).map_err(|error| match error {
            LockError::Busy { holder, .. } => LockError::Busy { directory: output.to_owned(), holder },
            other => other,
        })?;
        if is_still_there(&lock.0, &path) {
            return Ok(PassingLock { path, lock });
        }
    }
}

/// Whether a file that was opened is the one of that name now.
#[cfg(unix)]
fn is_still_there(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let same = |a: std::fs::Metadata, b: std::fs::Metadata| (a.dev(), a.ino()) == (b.dev(), b.ino());
    file.metadata().ok().zip(std::fs::metadata(path).ok()).is_some_and(|(a, b)| same(a, b))
}

/// Elsewhere no file is removed that is open.
#[cfg(not(unix))]
fn is_still_there(_: &File, _: &Path) -> bool {
    true
}

/// Why a lock cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum LockError {
    /// Another process has it.
    #[error("{directory:?} is in use by another process ({holder}); wait until it ends, or name another place")]
    Busy {
        /// The directory.
        directory: PathBuf,
        /// What the holder says of itself.
        holder: String,
    },
    /// The lock's file cannot be had.
    #[error(transparent)]
    Format(#[from] FormatError),
}

/// Takes the lock of a directory, which is made if need be, without waiting. `name` tells locks of one directory apart
/// ([`LOCK`] for all of it); `holder` is reported to other processes. On file systems without locks there is only a warning.
///
/// # Errors
/// Another process holds it; a directory that cannot be made or written.
pub fn try_lock(directory: &Path, name: &str, holder: &str) -> Result<Lock, LockError> {
    let (path, mut file) = open(directory, name)?;
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            let text = std::fs::read_to_string(&path).unwrap_or_default();
            let holder = text.lines().next().filter(|line| !line.is_empty()).unwrap_or("which does not say its name");
            return Err(LockError::Busy { directory: directory.to_owned(), holder: holder.to_owned() });
        }
        Err(TryLockError::Error(e)) if e.kind() == ErrorKind::Unsupported => no_locks(&path),
        Err(TryLockError::Error(e)) => return Err(FormatError::io(&path, "lock", e).into()),
    }
    // For people alone: a disk too full for it is no reason to stop.
    let _ = file.set_len(0).and_then(|()| writeln!(file, "{holder}, process {}", std::process::id()));
    Ok(Lock(file))
}

/// [`try_lock`], waiting for the holder to let go: for locks that are held for a moment only.
///
/// # Errors
/// A directory that cannot be made or written.
pub fn wait_for(directory: &Path, name: &str) -> Result<Lock, FormatError> {
    let (path, file) = open(directory, name)?;
    match file.lock() {
        Ok(()) => {}
        Err(e) if e.kind() == ErrorKind::Unsupported => no_locks(&path),
        Err(e) => return Err(FormatError::io(&path, "lock", e)),
    }
    Ok(Lock(file))
}

fn open(directory: &Path, name: &str) -> Result<(PathBuf, File), FormatError> {
    std::fs::create_dir_all(directory).map_err(|e| FormatError::io(directory, "make the directory", e))?;
    let path = directory.join(name);
    let file = File::options().create(true).append(true).open(&path);
    let file = file.map_err(|e| FormatError::io(&path, "open", e))?;
    Ok((path, file))
}

fn no_locks(path: &Path) {
    tracing::warn!("{path:?}: this file system has no locks; make sure that only one process at a time writes here");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_holder_at_a_time_and_the_error_names_it() {
        let home = tempfile::tempdir().unwrap();
        let directory = home.path().join("runs/a");
        let held = try_lock(&directory, LOCK, "evaluate --out runs/a").unwrap();
        let text = try_lock(&directory, LOCK, "another").expect_err("held").to_string();
        let process = format!("evaluate --out runs/a, process {}", std::process::id());
        assert!(text.contains("runs/a\" is in use") && text.contains(&process), "{text}");
        let part = try_lock(&directory, ".lock-0-of-2", "part").expect("another name is another lock");
        drop(held);
        let again = try_lock(&directory, LOCK, "train").unwrap();
        let text = try_lock(&directory, LOCK, "x").expect_err("held").to_string();
        assert!(text.contains("(train, process") && !text.contains("evaluate"), "{text}");
        drop((again, part));
        drop(wait_for(&directory, LOCK).unwrap());
    }

    #[test]
    fn the_lock_of_an_output_is_beside_it_and_gone_afterwards() {
        let home = tempfile::tempdir().unwrap();
        let output = home.path().join("net.safetensors");
        let held = try_lock_of(&output, "train convert").unwrap();
        let text = try_lock_of(&output, "another").expect_err("held").to_string();
        assert!(text.contains("net.safetensors\" is in use by another process (train convert, process"), "{text}");
        let other = try_lock_of(&home.path().join("net"), "train convert").expect("another output");
        drop((held, other));
        assert_eq!(std::fs::read_dir(home.path()).unwrap().count(), 0, "nothing is left behind");
        drop(try_lock_of(&output, "again").unwrap());
        // Removed and made anew between opening and locking: the old one is no lock.
        let path = home.path().join(".net.safetensors.lock");
        let file = File::create(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        assert!(!is_still_there(&file, &path));
        assert!(is_still_there(&File::create(&path).unwrap(), &path));
    }
}
