//! SHA-256 of a file inside that file: over all of its bytes, with the 64 digits themselves taken as zeros. So a file
//! carries its own checksum, and no second file has to be kept beside it.

use crate::FormatError;
use sha2::{Digest, Sha256};
use std::ops::Range;
use std::path::Path;

/// What stands in place of the digits while they are not known.
pub const UNKNOWN: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// SHA-256 in lower-case hexadecimal digits.
pub fn sha256(bytes: &[u8]) -> String {
    format!("{:x}", Sha256::digest(bytes))
}

/// Fills in the digits after the first `key` in `bytes`; whether there is such a place.
pub fn seal(bytes: &mut [u8], key: &[u8]) -> bool {
    let Some(at) = digits(bytes, key) else { return false };
    let sum = sum(bytes, &at);
    bytes[at].copy_from_slice(sum.as_bytes());
    true
}

/// Holds the bytes of a file against the digits after the first `key`; `way_out` says what to do about damage.
///
/// # Errors
/// No digits, or those of other bytes.
pub fn check(path: &Path, bytes: &[u8], key: &[u8], way_out: &'static str) -> Result<(), FormatError> {
    let at = digits(bytes, key);
    let found = at.as_ref().map_or_else(|| "none".to_owned(), |at| sum(bytes, at));
    let expected = at.map_or_else(|| "one".to_owned(), |at| String::from_utf8_lossy(&bytes[at]).into_owned());
    match found == expected {
        true => Ok(()),
        false => Err(FormatError::Damaged { path: path.to_owned(), found, expected, way_out }),
    }
}

fn digits(bytes: &[u8], key: &[u8]) -> Option<Range<usize>> {
    let start = bytes.windows(key.len()).position(|window| window == key)? + key.len();
    (start + UNKNOWN.len() <= bytes.len()).then_some(start..start + UNKNOWN.len())
}

fn sum(bytes: &[u8], digits: &Range<usize>) -> String {
    let mut sum = Sha256::new();
    sum.update(&bytes[..digits.start]);
    sum.update(UNKNOWN);
    sum.update(&bytes[digits.end..]);
    format!("{:x}", sum.finalize())
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use rand::RngExt;

    /// Flips one bit after another, at random places, and expects the reader to refuse each.
    pub(crate) fn every_flip_is_noticed(good: &[u8], flips: usize, read: impl Fn(&[u8]) -> Result<(), String>) {
        read(good).expect("undamaged");
        let mut rng = geometry::rng::stream(1, "test/flips");
        for _ in 0..flips {
            let (byte, bit) = (rng.random_range(0..good.len()), rng.random_range(0..8));
            let mut bad = good.to_vec();
            bad[byte] ^= 1 << bit;
            let error = read(&bad).expect_err(&format!("bit {bit} of byte {byte} of {}", good.len()));
            assert!(!error.is_empty());
        }
    }

    #[test]
    fn a_sealed_file_knows_its_bytes() {
        let key = b"sum=";
        let path = Path::new("a.txt");
        let mut bytes = format!("before sum={UNKNOWN} after").into_bytes();
        assert!(seal(&mut bytes, key));
        check(path, &bytes, key, "").expect("as written");
        for bit in 0..bytes.len() * 8 {
            let mut bad = bytes.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            assert!(check(path, &bad, key, "").is_err(), "bit {bit}");
        }
        assert!(!seal(&mut b"no key".to_vec(), key) && !seal(&mut b"sum=00".to_vec(), key));
        assert_eq!(sha256(b"abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }
}
