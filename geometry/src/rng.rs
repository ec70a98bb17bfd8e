//! Named random streams: every random number of a run comes from one.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// The stream of this name, e.g. `stream(seed, "object/bunny/scan/3")`. Same seed and name, same numbers, on
/// any platform; different names give independent streams.
pub fn stream(seed: u64, name: &str) -> ChaCha8Rng {
    // FNV-1a, twice with different offsets: 128 bits of name beside 64 of seed in ChaCha's 256-bit key.
    let hash = |offset: u64| name.bytes().fold(offset, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01b3));
    let mut key = [0; 32];
    key[..8].copy_from_slice(&seed.to_le_bytes());
    key[8..16].copy_from_slice(&hash(0xcbf2_9ce4_8422_2325).to_le_bytes());
    key[16..24].copy_from_slice(&hash(0x6c62_272e_07bb_0142).to_le_bytes());
    key[24..].copy_from_slice(&(name.len() as u64).to_le_bytes());
    ChaCha8Rng::from_seed(key)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::Rng;

    #[test]
    fn streams_depend_on_seed_and_name() {
        let first = |seed, name: &str| stream(seed, name).next_u64();
        assert_eq!(first(1, "a"), first(1, "a"), "a stream must repeat");
        assert_ne!(first(1, "a"), first(2, "a"), "the seed must matter");
        assert_ne!(first(1, "a"), first(1, "b"), "the name must matter");
        assert_ne!(first(42, "a"), first(298, "a"), "all bits of the seed must matter");
    }
}
