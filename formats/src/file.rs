//! Whole files into memory: regular ones alone, within what a reader may hold.

use crate::FormatError;
use crate::error::Place;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// The bytes of a regular file. A pipe, a device or a directory, on which reading would wait or never end, is refused
/// at once.
///
/// # Errors
/// What is no regular file or larger than the memory allows, and what the operating system refuses.
pub fn read(path: &Path) -> Result<Vec<u8>, FormatError> {
    let (mut file, size) = open(path)?;
    check_fits(path, size, machine_memory())?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).map_err(|e| FormatError::io(path, "read", e))?;
    Ok(bytes)
}

/// A regular file, open for reading, and its size in bytes.
pub(crate) fn open(path: &Path) -> Result<(File, u64), FormatError> {
    let io = |e| FormatError::io(path, "read", e);
    let kind = std::fs::metadata(path).map_err(io)?;
    if !kind.is_file() {
        let found = if kind.is_dir() { "a directory" } else { "a pipe, socket or device" };
        return Err(FormatError::syntax(path, Place::File, found, "a file: write the data to one first"));
    }
    Ok((File::open(path).map_err(io)?, kind.len()))
}

/// Refuses a file that could not be held in memory together with what is made from it: a cloud takes three times its file at least, its numbers and its
/// points included.
fn check_fits(path: &Path, size: u64, memory: Option<u64>) -> Result<(), FormatError> {
    match memory {
        Some(memory) if size.saturating_mul(3) > memory => {
            let found = format!("{} MiB, which take {} MiB to read", size >> 20, size.saturating_mul(3) >> 20);
            let expected =
                format!("a file that fits the {} MiB of memory here: thin, simplify or split it", memory >> 20);
            Err(FormatError::syntax(path, Place::File, found, expected))
        }
        _ => Ok(()),
    }
}

/// Memory of the machine, or of the container that the program may use, bytes; `None` where it is not told.
fn machine_memory() -> Option<u64> {
    let text = |path: &str| std::fs::read_to_string(path).ok();
    let total = text("/proc/meminfo").and_then(|text| {
        let line = text.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
        line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kib| kib << 10)
    });
    let limits = ["/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"];
    let limits = limits.iter().filter_map(|path| text(path)?.trim().parse::<u64>().ok());
    total.into_iter().chain(limits).min()
}

/// What a reader may hold whatever its file's size, bytes.
const FREE: u64 = 256 << 20;
/// What it may hold for each byte of the file.
const PER_BYTE: u64 = 32;

/// Refuses, before anything is allocated, a packed file of `packed` bytes whose content would take `bytes`.
pub(crate) fn check_unpacked(path: &Path, what: String, bytes: u64, packed: usize) -> Result<(), FormatError> {
    let most = FREE + PER_BYTE * packed as u64;
    if bytes > most {
        return Err(FormatError::TooLarge { path: path.to_owned(), what, found: bytes >> 20, most: most >> 20 });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_regular_files_are_read() {
        let directory = tempfile::tempdir().unwrap();
        let text = |path: &Path| read(path).expect_err("no file").to_string();
        assert!(text(directory.path()).contains("found a directory, expected a file"));
        let absent = text(&directory.path().join("absent"));
        assert!(absent.contains("absent") && absent.contains("cannot read"), "{absent}");
        #[cfg(unix)]
        {
            // Opening either for reading would never end.
            let link = directory.path().join("link.ply");
            std::os::unix::fs::symlink("/dev/zero", &link).unwrap();
            assert!(text(&link).contains("device"));
            let pipe = directory.path().join("pipe.ply");
            let made = std::process::Command::new("mkfifo").arg(&pipe).status();
            if made.is_ok_and(|status| status.success()) {
                assert!(text(&pipe).contains("pipe"));
            }
        }
    }

    #[test]
    fn files_larger_than_the_machine_are_refused_before_they_are_read() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("scan.ply");
        File::create(&path).and_then(|file| file.set_len(1 << 42)).unwrap();
        if let Some(memory) = machine_memory() {
            assert!((64 << 20..1 << 50).contains(&memory), "{memory}");
            let text = read(&path).expect_err("4 TiB").to_string();
            assert!(text.contains("scan.ply") && text.contains("4194304 MiB, which take"), "{text}");
        }
        assert!(check_fits(&path, 1 << 30, Some(3 << 30)).is_ok() && check_fits(&path, 1 << 40, None).is_ok());
        let text = check_fits(&path, (1 << 30) + 1, Some(3 << 30)).expect_err("larger").to_string();
        assert!(text.contains("fits the 3072 MiB of memory here"), "{text}");
    }

    #[test]
    fn small_files_do_not_unpack_to_gigabytes() {
        let error = check_unpacked(Path::new("a.pcd"), "28000000 points".to_owned(), 1 << 30, 1 << 20);
        let text = error.expect_err("too large").to_string();
        assert!(text.contains("a.pcd") && text.contains("28000000 points") && text.contains("1024 MiB"), "{text}");
        assert!(text.contains("288 MiB"), "{text}");
        assert!(check_unpacked(Path::new("a.pcd"), String::new(), 1 << 27, 10).is_ok());
    }
}
