//! Text as programs in the field write it: any byte-order mark, any line end, numbers of any printer.

use std::borrow::Cow;

/// The text of a file: UTF-8 or UTF-16 by its byte-order mark, which is left out; bytes that are no UTF-8 (Latin-1
/// comments) become replacement characters.
pub(crate) fn decode(bytes: &[u8]) -> Cow<'_, str> {
    let wide = |unit: fn([u8; 2]) -> u16| {
        let units = bytes[2..].chunks_exact(2).map(|b| unit([b[0], b[1]]));
        char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect::<String>()
    };
    match bytes {
        [0xff, 0xfe, ..] => Cow::Owned(wide(u16::from_le_bytes)),
        [0xfe, 0xff, ..] => Cow::Owned(wide(u16::from_be_bytes)),
        _ => String::from_utf8_lossy(without_mark(bytes)),
    }
}

/// The bytes behind a UTF-8 byte-order mark.
pub(crate) fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)
}

/// Lines with their numbers from 1; they end in a line feed, a carriage return, or both.
pub(crate) fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut rest = Some(text);
    let next = move || {
        let text = rest.filter(|t| !t.is_empty())?;
        let Some(end) = text.bytes().position(|b| b == b'\n' || b == b'\r') else {
            rest = None;
            return Some(text);
        };
        let width = if text[end..].starts_with("\r\n") { 2 } else { 1 };
        rest = Some(&text[end + width..]);
        Some(&text[..end])
    };
    std::iter::from_fn(next).enumerate().map(|(i, line)| (i + 1, line))
}

/// The line without a comment: from a `#` on, unless that belongs to a number (`1.#QNAN`).
pub(crate) fn without_comment(line: &str) -> &str {
    let mut from = 0;
    while let Some(at) = line[from..].find('#').map(|at| from + at) {
        if !line[..at].ends_with("1.") {
            return &line[..at];
        }
        from = at + 1;
    }
    line
}

/// Whether bytes that should be binary, and are `left` too many, went through a transfer of text, which writes a carriage return before
/// each line feed: what was read of them is shifted.
pub(crate) fn was_transferred_as_text(bytes: &[u8], left: usize) -> bool {
    let feeds = || (0..bytes.len()).filter(|&i| bytes[i] == b'\n');
    // A last line break may have stood behind the data.
    let data_behind = !bytes[bytes.len() - left..].trim_ascii().is_empty();
    data_behind
        && (left.saturating_sub(2).max(1)..=left).contains(&feeds().count())
        && feeds().all(|i| i > 0 && bytes[i - 1] == b'\r')
}

/// The way out of it.
pub(crate) const TRANSFERRED_AS_TEXT: &str = "binary data as they were written: copy the file again without conversion of line ends \
                                               (FTP in binary mode, no git autocrlf)";

/// What is found then.
pub(crate) const ONLY_PAIRS: &str = "a carriage return before every line feed";

/// A number as any printer writes it: Rust's forms, `1.#QNAN`, `-nan(ind)` and `1.#INF`, and Fortran's `1.5D-02`.
pub(crate) fn number(word: &str) -> Option<f64> {
    if let Ok(value) = word.parse() {
        return Some(value);
    }
    let plain = word.trim_start_matches(['+', '-']).to_ascii_lowercase();
    if plain.starts_with("1.#inf") {
        return Some(f64::INFINITY);
    }
    if plain.starts_with("1.#") || plain.starts_with("nan(") || plain == "n/a" || plain == "na" {
        return Some(f64::NAN);
    }
    let exponent =
        word.find(['d', 'D']).filter(|&at| word[..at].ends_with(|c: char| c.is_ascii_digit() || c == '.'))?;
    format!("{}e{}", &word[..exponent], &word[exponent + 1..]).parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_and_line_ends_of_any_system() {
        let wide: Vec<u8> = [0xff, 0xfe].into_iter().chain("1 2\n".encode_utf16().flat_map(u16::to_le_bytes)).collect();
        let swapped: Vec<u8> =
            [0xfe, 0xff].into_iter().chain("1 2\n".encode_utf16().flat_map(u16::to_be_bytes)).collect();
        for bytes in [b"1 2\n".as_slice(), b"\xef\xbb\xbf1 2\n", &wide, &swapped] {
            assert_eq!(decode(bytes), "1 2\n");
        }
        let all: Vec<_> = lines("a\rb\r\n\nc").collect();
        assert_eq!(all, [(1, "a"), (2, "b"), (3, ""), (4, "c")]);
        assert_eq!(lines("a\n").count(), 1);
    }

    #[test]
    fn numbers_of_any_printer() {
        for (word, value) in
            [("-.5", -0.5), ("5.", 5.0), ("+1e-2", 0.01), ("1.5D-02", 0.015), ("1.#INF", f64::INFINITY)]
        {
            assert_eq!(number(word), Some(value), "{word}");
        }
        for word in ["nan", "-nan", "-1.#IND", "1.#QNAN0", "-nan(ind)", "nan(snan)"] {
            assert!(number(word).is_some_and(f64::is_nan), "{word}");
        }
        for word in ["", "x", "0,5", "d5", "1.2.3", "red"] {
            assert_eq!(number(word), None, "{word}");
        }
        assert_eq!(without_comment("1 1.#IND 2 # three"), "1 1.#IND 2 ");
    }

    #[test]
    fn line_feeds_of_binary_data_that_became_pairs_are_found() {
        let data: Vec<u8> = (0..400u32).flat_map(|i| (i * 7).to_le_bytes()).collect();
        let feeds = data.iter().filter(|b| **b == b'\n').count();
        assert!(feeds > 2);
        let sent: Vec<u8> = data.iter().flat_map(|b| if *b == b'\n' { vec![b'\r', b'\n'] } else { vec![*b] }).collect();
        assert!(was_transferred_as_text(&sent, feeds));
        assert!(was_transferred_as_text(&[&sent[..], b"\r\n"].concat(), feeds + 2), "with a line break at the end");
        for behind in [&b""[..], b"\n", b"\r\n\r\n", b"made by hand\r\n", &[0; 5]] {
            assert!(!was_transferred_as_text(&[&data[..], behind].concat(), behind.len()), "{behind:?}");
            assert!(!was_transferred_as_text(&[&[7; 60], behind].concat(), behind.len()), "{behind:?}, no line feed");
        }
    }
}
