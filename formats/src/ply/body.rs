//! The rows of a PLY file's elements: the numbers asked for, in the order asked for.

use super::header::{Element, Encoding, Header, Kind, Scalar};
use crate::FormatError;
use crate::error::Place;
use crate::text;
use std::borrow::Cow;
use std::path::Path;

/// Which properties of an element are read.
pub(super) struct Wanted {
    /// Properties of one number each, at most six.
    pub(super) scalars: Vec<usize>,
    /// A property that is a list of integers.
    pub(super) list: Option<usize>,
}

/// Reads on from element to element.
pub(super) struct Body<'a> {
    path: &'a Path,
    encoding: Encoding,
    bytes: &'a [u8],
    at: usize,
    /// Lines of a text body with their numbers, blank ones left out.
    lines: Box<dyn Iterator<Item = (usize, &'a str)> + 'a>,
    line: usize,
    wide: Option<usize>,
}

/// The text of a text body.
pub(super) fn text_of<'a>(header: &Header, bytes: &'a [u8]) -> Cow<'a, str> {
    match header.encoding {
        Encoding::Text => String::from_utf8_lossy(&bytes[header.body..]),
        _ => Cow::Borrowed(""),
    }
}

impl<'a> Body<'a> {
    pub(super) fn new(path: &'a Path, header: &Header, bytes: &'a [u8], text: &'a str) -> Self {
        let first = header.line;
        let lines = text::lines(text).map(move |(i, line)| (first + i - 1, line)).filter(|(_, l)| !l.trim().is_empty());
        Self {
            path,
            encoding: header.encoding,
            bytes,
            at: header.body,
            lines: Box::new(lines),
            line: first,
            wide: None,
        }
    }

    /// Calls `row` with the numbers and the list of every row of an element.
    pub(super) fn each(
        &mut self,
        element: &Element,
        wanted: &Wanted,
        mut row: impl FnMut(&[f64; 6], &[i64]) -> Result<(), FormatError>,
    ) -> Result<(), FormatError> {
        self.check_count(element)?;
        let fixed = element.properties.iter().all(|p| matches!(p.kind, Kind::Scalar(_)));
        match (self.encoding, fixed) {
            (Encoding::Text, _) => self.each_of_text(element, wanted, row),
            (_, true) => self.each_of_one_size(element, wanted, |values| row(values, &[])),
            (_, false) => self.each_with_lists(element, wanted, row),
        }
    }

    /// What stands behind the last element, in words.
    ///
    /// # Errors
    /// So much that the rows were no rows.
    pub(super) fn left_over(self, header: &Header) -> Result<Vec<String>, FormatError> {
        let mut notes = vec![];
        if let Some(line) = self.wide {
            notes.push(format!("line {line} has more values than the header declares; the first ones were read"));
        }
        let behind = &self.bytes[self.at..];
        let left = match self.encoding {
            Encoding::Text => (self.lines.count(), "lines"),
            _ if text::was_transferred_as_text(&self.bytes[header.body..], behind.len()) => {
                let place = Place::Part("binary rows".to_owned());
                return Err(FormatError::syntax(self.path, place, text::ONLY_PAIRS, text::TRANSFERRED_AS_TEXT));
            }
            _ => (behind.trim_ascii_end().len(), "bytes"),
        };
        if left.0 > 0 {
            notes.push(format!(
                "{} {} follow after the rows that the header declares and were not read",
                left.0, left.1
            ));
        }
        Ok(notes)
    }

    fn check_count(&self, element: &Element) -> Result<(), FormatError> {
        let room = (self.bytes.len() - self.at) as u64;
        // The last line may lack its break.
        let most = room.checked_div(element.least_bytes(self.encoding));
        let most = most.map_or(0, |rows| rows + u64::from(self.encoding == Encoding::Text));
        if element.count > most {
            let (path, place) = (self.path.to_owned(), Place::Part("header".to_owned()));
            let what = format!("rows of element {:?}", element.name);
            return Err(FormatError::Count { path, place, what, found: element.count, most });
        }
        Ok(())
    }

    fn each_of_text(
        &mut self,
        element: &Element,
        wanted: &Wanted,
        mut row: impl FnMut(&[f64; 6], &[i64]) -> Result<(), FormatError>,
    ) -> Result<(), FormatError> {
        let slots = slots(element, wanted);
        let mut values = [0.0; 6];
        let mut list = vec![];
        for index in 0..element.count {
            let Some((number, line)) = self.lines.next() else {
                let expected = format!("row {index} of {} of element {:?}", element.count, element.name);
                return Err(FormatError::truncated(self.path, Place::Line(self.line), expected));
            };
            self.line = number;
            let refuse = |found: String, name: &str, what: &str| {
                let expected = format!("{what} of {name:?} in row {index} of element {:?}", element.name);
                FormatError::syntax(self.path, Place::Line(number), found, expected)
            };
            let mut words = line.split_whitespace();
            for (property, slot) in element.properties.iter().zip(&slots) {
                let word =
                    words.next().ok_or_else(|| refuse("too few values".to_owned(), &property.name, "a value"))?;
                let wrong = |word: &str| refuse(format!("{word:?}"), &property.name, "a number");
                match property.kind {
                    Kind::Scalar(_) => {
                        if let Some(slot) = *slot {
                            values[slot] = text::number(word).ok_or_else(|| wrong(word))?;
                        }
                    }
                    Kind::List { .. } => {
                        let count: usize = word.parse().map_err(|_| wrong(word))?;
                        let keep = slot.is_some();
                        if keep {
                            list.clear();
                        }
                        for _ in 0..count {
                            let word = words
                                .next()
                                .ok_or_else(|| refuse("too few values".to_owned(), &property.name, "a value"))?;
                            if keep {
                                list.push(word.parse().map_err(|_| wrong(word))?);
                            }
                        }
                    }
                }
            }
            if words.next().is_some() {
                self.wide = self.wide.or(Some(number));
            }
            row(&values, &list)?;
        }
        Ok(())
    }

    fn each_of_one_size(
        &mut self,
        element: &Element,
        wanted: &Wanted,
        mut row: impl FnMut(&[f64; 6]) -> Result<(), FormatError>,
    ) -> Result<(), FormatError> {
        let mut fields = vec![];
        let mut size = 0;
        for (property, slot) in element.properties.iter().zip(slots(element, wanted)) {
            if let Kind::Scalar(scalar) = property.kind {
                fields.extend(slot.map(|slot| (slot, size, scalar.size(), reader(scalar, self.encoding))));
                size += scalar.size();
            }
        }
        // The count was checked: the rows are there.
        let end = self.at + element.count as usize * size;
        let mut values = [0.0; 6];
        for bytes in self.bytes[self.at..end].chunks_exact(size.max(1)) {
            for &(slot, at, size, read) in &fields {
                values[slot] = read(&bytes[at..at + size]);
            }
            row(&values)?;
        }
        self.at = end;
        Ok(())
    }

    fn each_with_lists(
        &mut self,
        element: &Element,
        wanted: &Wanted,
        mut row: impl FnMut(&[f64; 6], &[i64]) -> Result<(), FormatError>,
    ) -> Result<(), FormatError> {
        let slots = slots(element, wanted);
        let mut values = [0.0; 6];
        let mut list = vec![];
        for index in 0..element.count {
            for (property, slot) in element.properties.iter().zip(&slots) {
                match property.kind {
                    Kind::Scalar(scalar) => {
                        let value = reader(scalar, self.encoding)(self.take(scalar.size() as u64, element, index)?);
                        if let Some(slot) = *slot {
                            values[slot] = value;
                        }
                    }
                    Kind::List { count, item } => {
                        let count = integer(self.take(count.size() as u64, element, index)?, count, self.encoding);
                        let count = u64::try_from(count).unwrap_or(u64::MAX);
                        let bytes = self.take(count.saturating_mul(item.size() as u64), element, index)?;
                        if slot.is_some() {
                            list.clear();
                            list.extend(bytes.chunks_exact(item.size()).map(|b| integer(b, item, self.encoding)));
                        }
                    }
                }
            }
            row(&values, &list)?;
        }
        Ok(())
    }

    fn take(&mut self, size: u64, element: &Element, index: u64) -> Result<&'a [u8], FormatError> {
        let end = usize::try_from(size).ok().and_then(|size| self.at.checked_add(size));
        let bytes = end.and_then(|end| self.bytes.get(self.at..end)).ok_or_else(|| {
            let expected = format!("row {index} of {} of element {:?}", element.count, element.name);
            FormatError::truncated(self.path, Place::Byte(self.at as u64), expected)
        })?;
        self.at += bytes.len();
        Ok(bytes)
    }
}

/// Per property, where its value goes: a scalar's slot; 0 for the list that is wanted.
fn slots(element: &Element, wanted: &Wanted) -> Vec<Option<usize>> {
    let slot = |i: usize| match element.properties[i].kind {
        Kind::Scalar(_) => wanted.scalars.iter().position(|&w| w == i),
        Kind::List { .. } => (wanted.list == Some(i)).then_some(0),
    };
    (0..element.properties.len()).map(slot).collect()
}

/// How bytes become a number.
fn reader(scalar: Scalar, encoding: Encoding) -> fn(&[u8]) -> f64 {
    macro_rules! read {
        ($type:ty) => {
            match encoding {
                Encoding::Big => |b| <$type>::from_be_bytes(b.try_into().unwrap_or_default()) as f64,
                _ => |b| <$type>::from_le_bytes(b.try_into().unwrap_or_default()) as f64,
            }
        };
    }
    match scalar {
        Scalar::I8 => read!(i8),
        Scalar::U8 => read!(u8),
        Scalar::I16 => read!(i16),
        Scalar::U16 => read!(u16),
        Scalar::I32 => read!(i32),
        Scalar::U32 => read!(u32),
        Scalar::I64 => read!(i64),
        Scalar::U64 => read!(u64),
        Scalar::F32 => read!(f32),
        Scalar::F64 => read!(f64),
    }
}

/// An index or a length; -1 marks the end of a strip.
fn integer(bytes: &[u8], scalar: Scalar, encoding: Encoding) -> i64 {
    match scalar {
        Scalar::U64 | Scalar::I64 => {
            let bytes: [u8; 8] = bytes.try_into().unwrap_or_default();
            match encoding {
                Encoding::Big => i64::from_be_bytes(bytes),
                _ => i64::from_le_bytes(bytes),
            }
        }
        _ => reader(scalar, encoding)(bytes) as i64,
    }
}
