//! Mutated files for a reader, and the memory that it takes.

use geometry::rng;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Counts what each thread holds.
struct Counting;

thread_local! {
    static HELD: Cell<isize> = const { Cell::new(0) };
    static PEAK: Cell<isize> = const { Cell::new(0) };
}

fn count(bytes: isize) {
    let held = HELD.get() + bytes;
    HELD.set(held);
    PEAK.set(PEAK.get().max(held));
}

// SAFETY: every call is handed to the system's allocator unchanged; the counters are plain thread-local cells that
// allocate nothing.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        // SAFETY: as the caller promises.
        unsafe { System.alloc_zeroed(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(-(layout.size() as isize));
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Bytes a reader may hold per byte of the file, beside a constant. A text PLY vertex of two bytes is a row of 100,
/// an LZF block grows 90 times, a PNG 1032 times: the constant covers those of the small files used here.
const PER_BYTE: isize = 512;
const CONSTANT: isize = 16 << 20;

fn mutate(seed: &[u8], other: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    const WORDS: [&str; 16] = [
        "1000000000000",
        "-1",
        "0",
        "nan",
        "inf",
        "1e999",
        "18446744073709551615",
        "9223372036854775807",
        " ",
        "\n",
        "/",
        "#",
        "4294967295",
        "-9223372036854775808",
        "\u{e9}",
        "\\\n",
    ];
    let mut bytes = seed.to_vec();
    for _ in 0..rng.random_range(1..8) {
        let at = rng.random_range(0..=bytes.len());
        let end = (at + rng.random_range(0..24)).min(bytes.len());
        match rng.random_range(0..8) {
            0 if at < bytes.len() => bytes[at] = rng.random(),
            1 if at < bytes.len() => bytes[at] ^= 1 << rng.random_range(0..8),
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(at..end)),
            4 => {
                let word = WORDS[rng.random_range(0..WORDS.len())];
                let end = if rng.random() { at } else { end };
                bytes.splice(at..end, word.bytes());
            }
            5 => {
                let number: u64 = [u64::MAX, 1 << 40, u64::from(u32::MAX), 0x7fff_ffff, 0][rng.random_range(0..5)];
                let width = [1, 2, 4, 8][rng.random_range(0..4)];
                for (slot, byte) in bytes[at..].iter_mut().zip(&number.to_le_bytes()[..width]) {
                    *slot = *byte;
                }
            }
            6 => {
                let copy = bytes[at..end].to_vec();
                let to = rng.random_range(0..=bytes.len());
                bytes.splice(to..to, copy);
            }
            _ if !other.is_empty() => {
                let from = rng.random_range(0..other.len());
                let until = (from + rng.random_range(0..64)).min(other.len());
                bytes.splice(at..end, other[from..until].iter().copied());
            }
            _ => {}
        }
    }
    bytes
}

/// Feeds mutations of the seeds to a reader; `read` says whether it took the file.
pub(crate) fn fuzz(name: &str, seeds: &[(PathBuf, Vec<u8>)], mut read: impl FnMut(&Path, &[u8]) -> bool) {
    let seconds = std::env::var("FUZZ_SECONDS").ok().and_then(|s| s.parse().ok()).unwrap_or(0.5);
    let end = Instant::now() + Duration::from_secs_f64(seconds);
    let mut rng = rng::stream(1, &format!("fuzz/{name}"));
    let (mut runs, mut taken, mut worst) = (0u64, 0u64, 0isize);
    for (path, bytes) in seeds {
        assert!(read(path, bytes), "{name}: the unchanged {path:?} must be read");
    }
    while Instant::now() < end {
        let (path, seed) = &seeds[rng.random_range(0..seeds.len())];
        let other = &seeds[rng.random_range(0..seeds.len())].1;
        let bytes = mutate(seed, other, &mut rng);
        let before = HELD.get();
        PEAK.set(before);
        let result = catch_unwind(AssertUnwindSafe(|| read(path, &bytes)));
        let used = PEAK.get() - before;
        let allowed = CONSTANT + PER_BYTE * bytes.len() as isize;
        if result.is_err() || used > allowed {
            let kept = Path::new(env!("CARGO_TARGET_TMPDIR"))
                .join(format!("fuzz-{name}-{runs}.{}", path.extension().unwrap().display()));
            std::fs::write(&kept, &bytes).unwrap();
            panic!("{name}: run {runs} panicked or held {used} of {allowed} bytes; input kept as {kept:?}");
        }
        runs += 1;
        taken += u64::from(result.unwrap_or(false));
        worst = worst.max(used);
    }
    println!("{name}: {runs} files in {seconds} s, {taken} of them readable, {} kB held at most", worst / 1000);
    assert!(runs > 20, "{name}: too few runs to mean anything");
}

/// Small files made here, and those of `../shared/data/awkward` with this ending where present.
pub(crate) fn seeds(extension: &str, made: Vec<Vec<u8>>) -> Vec<(PathBuf, Vec<u8>)> {
    let mut seeds: Vec<_> = made.into_iter().map(|bytes| (PathBuf::from(format!("made.{extension}")), bytes)).collect();
    let directory = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/awkward"));
    let mut real: Vec<PathBuf> =
        std::fs::read_dir(directory).into_iter().flatten().map(|e| e.unwrap().path()).collect();
    real.sort();
    for path in real.into_iter().filter(|p| p.extension().is_some_and(|e| e == extension)) {
        let bytes = std::fs::read(&path).unwrap();
        if bytes.len() < 20_000 {
            seeds.push((path, bytes));
        }
    }
    seeds
}

pub(crate) fn only_readable(
    seeds: Vec<(PathBuf, Vec<u8>)>,
    read: impl Fn(&Path, &[u8]) -> bool,
) -> Vec<(PathBuf, Vec<u8>)> {
    seeds.into_iter().filter(|(path, bytes)| read(path, bytes)).collect()
}
