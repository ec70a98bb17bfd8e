//! LZF, the compression of PCD files.

/// The bytes of a compressed block, `size` of them; `None` where it is damaged.
pub(super) fn unpack(block: &[u8], size: usize) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(size);
    let mut at = 0;
    let mut next = || {
        let byte = block.get(at).copied();
        at += 1;
        byte.map(usize::from)
    };
    while let Some(control) = next() {
        if control < 32 {
            for _ in 0..=control {
                out.push(next()? as u8);
            }
        } else {
            let length = match control >> 5 {
                7 => 7 + next()?,
                length => length,
            } + 2;
            let from = out.len().checked_sub(((control & 31) << 8) + next()? + 1)?;
            if out.len() + length > size {
                return None;
            }
            // The copy may overlap what it makes.
            for k in from..from + length {
                out.push(out[k]);
            }
        }
        if out.len() > size {
            return None;
        }
    }
    (out.len() == size).then_some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_copies_and_damage() {
        // "abc", then 9 bytes from 3 back, then 2 + 7 + 1 from 1 back.
        let block = [2, b'a', b'b', b'c', 0b1110_0000, 0, 2, 0b1110_0000, 1, 0];
        let text = b"abcabcabcabccccccccccc";
        assert_eq!(unpack(&block, text.len()).as_deref(), Some(&text[..]));
        assert_eq!(unpack(&block, text.len() - 1), None, "too long");
        assert_eq!(unpack(&block, text.len() + 1), None, "too short");
        assert_eq!(unpack(&block[..9], text.len()), None, "cut off");
        assert_eq!(unpack(&[0, b'a', 0b0010_0000, 5], 4), None, "from before the start");
    }
}
