//! The header of a PLY file: its elements and their properties in order, whatever their names.

use crate::FormatError;
use crate::error::Place;
use std::path::Path;

/// How the body is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Text,
    Little,
    Big,
}

/// A type of number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Scalar {
    fn named(word: &str) -> Option<Self> {
        Some(match word.to_ascii_lowercase().as_str() {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "int64" | "long" | "longlong" => Self::I64,
            "uint64" | "ulong" | "ulonglong" => Self::U64,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    pub(super) fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }
}

/// What a property holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Scalar(Scalar),
    List { count: Scalar, item: Scalar },
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) kind: Kind,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
}

impl Element {
    /// Where a property stands: the name as spelled first, else in any case.
    pub(super) fn find(&self, name: &str) -> Option<usize> {
        let at = |same: &dyn Fn(&str) -> bool| self.properties.iter().position(|p| same(&p.name));
        at(&|n| n == name).or_else(|| at(&|n| n.eq_ignore_ascii_case(name)))
    }

    /// Where three numbers stand.
    pub(super) fn find_all(&self, names: [&str; 3]) -> Option<[usize; 3]> {
        let at = |name| self.find(name).filter(|&i| matches!(self.properties[i].kind, Kind::Scalar(_)));
        let [a, b, c] = names.map(at);
        Some([a?, b?, c?])
    }

    /// The least bytes that a row takes in the body.
    pub(super) fn least_bytes(&self, encoding: Encoding) -> u64 {
        let size = |p: &Property| match p.kind {
            Kind::Scalar(scalar) | Kind::List { count: scalar, .. } => scalar.size() as u64,
        };
        match encoding {
            Encoding::Text => u64::from(!self.properties.is_empty()), // its line break
            _ => self.properties.iter().map(size).sum(),
        }
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    /// First byte of the body.
    pub(super) body: usize,
    /// Line of a text body's first byte.
    pub(super) line: usize,
}

const EXPECTED: &str = "a PLY header (ply, format, element ..., end_header)";

/// Reads the header, in any line ends and with comments in any encoding.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Header, FormatError> {
    let mut lines = Lines { bytes, at: 0, number: 0, lone_return: false };
    let refuse =
        |line: usize, found: String, expected: &str| FormatError::syntax(path, Place::Line(line), found, expected);
    match lines.next() {
        Some(first) if first.trim().eq_ignore_ascii_case("ply") => {}
        first => return Err(refuse(1, format!("{:?}", first.unwrap_or_default()), EXPECTED)),
    }
    let mut encoding = None;
    let mut elements: Vec<Element> = vec![];
    loop {
        let Some(line) = lines.next() else {
            return Err(FormatError::truncated(path, Place::Line(lines.number), "end_header"));
        };
        let number = lines.number;
        let words: Vec<&str> = line.split_whitespace().collect();
        let keyword = words.first().map(|w| w.to_ascii_lowercase()).unwrap_or_default();
        match (keyword.as_str(), &words[..]) {
            ("" | "comment" | "obj_info", _) => {}
            ("end_header", _) => break,
            ("format", [_, kind, ..]) => {
                encoding = Some(match kind.to_ascii_lowercase().as_str() {
                    "ascii" => Encoding::Text,
                    "binary_little_endian" => Encoding::Little,
                    "binary_big_endian" => Encoding::Big,
                    _ => {
                        let expected = "ascii, binary_little_endian or binary_big_endian";
                        return Err(refuse(number, format!("the format {kind:?}"), expected));
                    }
                });
            }
            ("element", [_, name, count]) => {
                let count = count.parse().map_err(|_| refuse(number, format!("{count:?}"), "a number of rows"))?;
                if elements.iter().any(|e| e.name == *name) {
                    return Err(refuse(number, format!("element {name:?} a second time"), "every element once"));
                }
                elements.push(Element { name: (*name).to_owned(), count, properties: vec![] });
            }
            ("property", [_, rest @ ..]) => {
                let expected = "property TYPE NAME or property list TYPE TYPE NAME after an element";
                let wrong = || refuse(number, format!("{:?}", line.trim()), expected);
                let scalar = |word: &str| {
                    Scalar::named(word).ok_or_else(|| {
                        let expected = "char, uchar, short, ushort, int, uint, int64, uint64, float or double";
                        refuse(number, format!("the type {word:?}"), expected)
                    })
                };
                let element = elements.last_mut().ok_or_else(wrong)?;
                let (kind, name) = match rest {
                    [list, count, item, name @ ..] if list.eq_ignore_ascii_case("list") => {
                        let (count, item) = (scalar(count)?, scalar(item)?);
                        if !count.is_integer() {
                            return Err(refuse(number, "a list whose length is not an integer".to_owned(), expected));
                        }
                        (Kind::List { count, item }, name)
                    }
                    [kind, name @ ..] => (Kind::Scalar(scalar(kind)?), name),
                    [] => return Err(wrong()),
                };
                let name = name.join(" ");
                if name.is_empty() {
                    return Err(wrong());
                }
                if element.properties.iter().any(|p| p.name == name) {
                    let found = format!("property {name:?} of element {:?} a second time", element.name);
                    return Err(refuse(number, found, "every property once: rename one"));
                }
                element.properties.push(Property { name, kind });
            }
            _ => return Err(refuse(number, format!("{:?}", line.trim()), EXPECTED)),
        }
    }
    let encoding = encoding.ok_or_else(|| refuse(lines.number, "no format".to_owned(), EXPECTED))?;
    Ok(Header { encoding, elements, body: lines.at, line: lines.number + 1 })
}

/// Lines of the header and how far they reach.
struct Lines<'a> {
    bytes: &'a [u8],
    at: usize,
    number: usize,
    /// Lines end in a carriage return alone: a line feed that follows belongs to the body.
    lone_return: bool,
}

impl<'a> Lines<'a> {
    fn next(&mut self) -> Option<std::borrow::Cow<'a, str>> {
        let rest = self.bytes.get(self.at..).filter(|rest| !rest.is_empty())?;
        self.number += 1;
        let end = rest.iter().position(|&b| b == b'\n' || b == b'\r').unwrap_or(rest.len());
        let both = rest[end..].starts_with(b"\r\n");
        if self.number == 1 {
            self.lone_return = rest[end..].starts_with(b"\r") && !both;
        }
        let width = if both && !self.lone_return { 2 } else { 1 };
        self.at += (end + width).min(rest.len());
        Some(String::from_utf8_lossy(&rest[..end]))
    }
}

#[cfg(test)]
mod tests;
