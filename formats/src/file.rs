//! Whole files into memory: regular ones alone, within what a reader may hold.

use crate::FormatError;
use crate::error::Place;
use std::path::Path;

/// The bytes of a regular file. A pipe, a device or a directory, on which reading would wait or never end, is refused
/// at once.
///
/// # Errors
/// What is no regular file, and what the operating system refuses.
pub fn read(path: &Path) -> Result<Vec<u8>, FormatError> {
    let kind = std::fs::metadata(path).map_err(|e| FormatError::io(path, "read", e))?;
    if !kind.is_file() {
        let found = if kind.is_dir() { "a directory" } else { "a pipe, socket or device" };
        return Err(FormatError::syntax(path, Place::File, found, "a file: write the data to one first"));
    }
    std::fs::read(path).map_err(|e| FormatError::io(path, "read", e))
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
    fn small_files_do_not_unpack_to_gigabytes() {
        let error = check_unpacked(Path::new("a.pcd"), "28000000 points".to_owned(), 1 << 30, 1 << 20);
        let text = error.expect_err("too large").to_string();
        assert!(text.contains("a.pcd") && text.contains("28000000 points") && text.contains("1024 MiB"), "{text}");
        assert!(text.contains("288 MiB"), "{text}");
        assert!(check_unpacked(Path::new("a.pcd"), String::new(), 1 << 27, 10).is_ok());
    }
}
