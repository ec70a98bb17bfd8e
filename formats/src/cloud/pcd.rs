//! PCD: text, binary and compressed. Own code: `pcd-rs` 0.13 refuses comments in Latin-1 and padding of COUNT 0, and makes
//! several vectors of each point.

use super::{CloudFile, lzf};
use crate::FormatError;
use crate::error::Place;
use crate::text;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use std::borrow::Cow;
use std::path::Path;

/// A field of a point: `count` numbers of `size` bytes.
struct Field {
    name: String,
    size: u64,
    kind: u8,
    count: u64,
}

struct Header {
    fields: Vec<Field>,
    width: u64,
    height: u64,
    points: u64,
    viewpoint: Option<Isometry3<f64>>,
    /// A viewpoint that is no pose, as it stands there.
    no_pose: Option<String>,
    data: Data,
    /// First byte and line of the body.
    body: usize,
    line: usize,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Data {
    Text,
    Binary,
    Compressed,
}

pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<CloudFile, FormatError> {
    let decoded = match bytes {
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => Cow::Owned(text::decode(bytes).into_owned().into_bytes()),
        _ => Cow::Borrowed(text::without_mark(bytes)),
    };
    let bytes = decoded.as_ref();
    let header = parse_header(path, bytes)?;
    if header.points == 0 {
        return CloudFile::gather(path, std::iter::empty(), None);
    }
    let find = |names: [&str; 3]| {
        let at = |name: &str| header.fields.iter().position(|f| f.name.eq_ignore_ascii_case(name));
        let [a, b, c] = names.map(at);
        Some([a?, b?, c?])
    };
    let Some(xyz) = find(["x", "y", "z"]) else {
        let names: Vec<&str> = header.fields.iter().map(|f| f.name.as_str()).collect();
        let part = Place::Part("FIELDS".to_owned());
        return Err(FormatError::syntax(path, part, names.join(" "), "x y z among them"));
    };
    let body = &bytes[header.body..];
    if header.numbers() > body.len() as u64 * 90 {
        return Err(too_many(path, "numbers per point", header.numbers(), body.len() as u64));
    }
    if let Some(&i) = xyz.iter().find(|&&i| header.fields[i].count != 1) {
        let found = format!("{} of COUNT {}", header.fields[i].name, header.fields[i].count);
        return Err(FormatError::syntax(
            path,
            Place::Part("COUNT".to_owned()),
            found,
            "one number for each of x, y, z",
        ));
    }
    let normal = find(["normal_x", "normal_y", "normal_z"]).or_else(|| find(["nx", "ny", "nz"]));
    let normal = normal.filter(|at| at.iter().all(|&i| header.fields[i].count == 1));
    let wanted: Vec<usize> = xyz.into_iter().chain(normal.into_iter().flatten()).collect();

    let mut notes = header.notes();
    let rows = match header.data {
        Data::Text => text_rows(path, &header, body, &wanted, &mut notes)?,
        Data::Binary => binary_rows(path, &header, body, &wanted, &mut notes)?,
        Data::Compressed => compressed_rows(path, &header, body, &wanted)?,
    };
    let rows = rows.into_iter().map(|[x, y, z, nx, ny, nz]| ([x, y, z], normal.map(|_| [nx, ny, nz])));
    let organised = header.height > 1 && header.width.checked_mul(header.height) == Some(header.points);
    let size = organised.then_some((header.width as usize, header.height as usize));
    let mut file = CloudFile::gather(path, rows, size)?.with_notes(notes);
    file.viewpoint = header.viewpoint;
    Ok(file)
}

/// Points that the header at the beginning of these bytes declares; `None` where it is none.
pub(crate) fn declared_points(head: &[u8]) -> Option<u64> {
    parse_header(Path::new(""), text::without_mark(head)).ok().map(|header| header.points)
}

fn parse_header(path: &Path, bytes: &[u8]) -> Result<Header, FormatError> {
    let lone_return = bytes.iter().find(|b| matches!(b, b'\n' | b'\r')) == Some(&b'\r')
        && bytes.windows(2).find(|w| w[0] == b'\r').is_none_or(|w| w[1] != b'\n');
    let (mut body, mut line) = (0, 0);
    let mut lists: [Option<Vec<String>>; 4] = [const { None }; 4];
    let [mut width, mut height, mut points] = [None; 3];
    let (mut viewpoint, mut no_pose) = (None, None);
    let mut seen: Vec<String> = vec![];
    let data = loop {
        let Some(rest) = bytes.get(body..).filter(|rest| !rest.is_empty()) else {
            return Err(FormatError::syntax(path, Place::Part("header".to_owned()), "no DATA", "a PCD header"));
        };
        line += 1;
        let end = rest.iter().position(|&b| b == b'\n' || b == b'\r').unwrap_or(rest.len());
        let both = !lone_return && rest[end..].starts_with(b"\r\n");
        body += (end + if both { 2 } else { 1 }).min(rest.len());
        let content = String::from_utf8_lossy(&rest[..end]);
        let mut words = content.split_whitespace().map(str::to_owned);
        let Some(keyword) = words.next().filter(|w| !w.starts_with('#')) else { continue };
        let words: Vec<String> = words.collect();
        let refuse = |expected: &str| FormatError::syntax(path, Place::Line(line), format!("{content:?}"), expected);
        let number = || words.first().and_then(|w| w.parse::<u64>().ok()).ok_or_else(|| refuse("a number"));
        let keyword = keyword.to_ascii_uppercase().replace("COLUMNS", "FIELDS");
        if seen.contains(&keyword) {
            return Err(refuse("every line of the header once"));
        }
        seen.push(keyword.clone());
        let slot = match keyword.as_str() {
            "VERSION" => continue,
            "FIELDS" => &mut lists[0],
            "SIZE" => &mut lists[1],
            "TYPE" => &mut lists[2],
            "COUNT" => &mut lists[3],
            "WIDTH" => {
                width = Some(number()?);
                continue;
            }
            "HEIGHT" => {
                height = Some(number()?);
                continue;
            }
            "POINTS" => {
                points = Some(number()?);
                continue;
            }
            "VIEWPOINT" => {
                match pose(&words).ok_or_else(|| refuse("VIEWPOINT and seven numbers"))? {
                    Some(pose) => viewpoint = Some(pose).filter(|pose| *pose != Isometry3::identity()),
                    None => no_pose = Some(words.join(" ")),
                }
                continue;
            }
            "DATA" => match words.first().map(|w| w.to_ascii_lowercase()).as_deref() {
                Some("ascii") => break Data::Text,
                Some("binary") => break Data::Binary,
                Some("binary_compressed") => break Data::Compressed,
                _ => return Err(refuse("DATA ascii, binary or binary_compressed")),
            },
            _ => return Err(refuse("a line of a PCD header of version 0.5 to 0.7")),
        };
        *slot = Some(words);
    };
    let [names, sizes, kinds, counts] = lists;
    let refuse = |part: &str, found: String, expected: &str| {
        FormatError::syntax(path, Place::Part(format!("header, {part}")), found, expected)
    };
    let names = names.ok_or_else(|| refuse("FIELDS", "no line".to_owned(), "the fields' names"))?;
    let all_ones = vec!["1".to_owned(); names.len()];
    let mut fields: Vec<Field> = vec![];
    let lists = [("SIZE", sizes), ("TYPE", kinds), ("COUNT", counts.or(Some(all_ones)))];
    let lists = lists.map(|(part, list)| (part, list.unwrap_or_default()));
    for (part, list) in &lists {
        if list.len() != names.len() {
            return Err(refuse(
                part,
                format!("{} entries for {} fields", list.len(), names.len()),
                "one for each field",
            ));
        }
    }
    let [(_, sizes), (_, kinds), (_, counts)] = lists;
    for (i, name) in names.into_iter().enumerate() {
        let kind = kinds[i].to_ascii_uppercase();
        let known = matches!((kind.as_str(), sizes[i].as_str()), ("F", "4" | "8") | ("I" | "U", "1" | "2" | "4" | "8"));
        let count = counts[i].parse().ok().filter(|_| known);
        let Some(count) = count else {
            let found = format!("field {name:?} of TYPE {}, SIZE {}, COUNT {}", kinds[i], sizes[i], counts[i]);
            return Err(refuse("FIELDS", found, "F of 4 or 8 bytes, I or U of 1, 2, 4 or 8"));
        };
        if name != "_" && fields.iter().any(|f| f.name == name) {
            return Err(refuse("FIELDS", format!("{name:?} a second time"), "every field once: rename one"));
        }
        fields.push(Field { name, size: sizes[i].parse().unwrap_or(1), kind: kind.as_bytes()[0], count });
    }
    let (width, height) = (width.unwrap_or(0), height.unwrap_or(1));
    let points = points.unwrap_or(width.saturating_mul(height));
    Ok(Header { fields, width, height, points, viewpoint, no_pose, data, body, line: line + 1 })
}

/// The sensor's pose, which is the identity where writers know nothing; `None` inside for seven numbers that are no pose.
fn pose(words: &[String]) -> Option<Option<Isometry3<f64>>> {
    let numbers: Vec<f64> = words.iter().map(|w| text::number(w)).collect::<Option<_>>()?;
    let [x, y, z, w, qx, qy, qz] = numbers[..] else { return None };
    let rotation = UnitQuaternion::try_new(Quaternion::new(w, qx, qy, qz), 1e-9);
    let pose = rotation.map(|rotation| Isometry3::from_parts(Translation3::new(x, y, z), rotation));
    Some(pose.filter(|p| p.translation.vector.iter().all(|x| x.is_finite())))
}

impl Header {
    /// What it says that was not used.
    fn notes(&self) -> Vec<String> {
        let Self { width, height, points, .. } = self;
        let unused = self.no_pose.as_ref().map(|found| format!("VIEWPOINT {found} is no pose and was not used"));
        let other = (width.checked_mul(*height) != Some(*points) && *width > 0).then(|| {
            format!("WIDTH {width} and HEIGHT {height} are not POINTS {points}: {points} points without rows were read")
        });
        unused.into_iter().chain(other).collect()
    }

    fn numbers(&self) -> u64 {
        self.fields.iter().fold(0, |n, f| n.saturating_add(f.count))
    }

    /// Bytes of a point in a binary body, `None` where no body holds one.
    fn record(&self) -> Option<u64> {
        self.fields.iter().try_fold(0u64, |sum, f| sum.checked_add(f.size.checked_mul(f.count)?))
    }

    /// Bytes from a point's start to a field.
    fn offset(&self, field: usize) -> u64 {
        self.fields[..field].iter().map(|f| f.size * f.count).sum()
    }
}

fn too_many(path: &Path, what: &str, found: u64, most: u64) -> FormatError {
    let place = Place::Part("header".to_owned());
    FormatError::Count { path: path.to_owned(), place, what: what.to_owned(), found, most }
}

/// Refuses what the body has no room for: points of `least` bytes each.
fn check_room(path: &Path, header: &Header, least: Option<u64>, room: u64) -> Result<u64, FormatError> {
    let numbers = header.numbers();
    let Some(least) = least.filter(|_| numbers <= room) else {
        return Err(too_many(path, "numbers per point", numbers, room));
    };
    let most = (room + 1) / least.max(1);
    if header.points > most {
        return Err(too_many(path, "points", header.points, most));
    }
    Ok(least)
}

fn text_rows(
    path: &Path,
    header: &Header,
    body: &[u8],
    wanted: &[usize],
    notes: &mut Vec<String>,
) -> Result<Vec<[f64; 6]>, FormatError> {
    let numbers = header.numbers() as usize;
    check_room(path, header, Some(2 * numbers as u64), body.len() as u64)?; // a digit and a blank
    let places: Vec<usize> =
        wanted.iter().map(|&i| header.fields[..i].iter().map(|f| f.count).sum::<u64>() as usize).collect();
    let text = String::from_utf8_lossy(body);
    let mut lines = text::lines(&text).filter(|(_, line)| !line.trim().is_empty());
    let mut rows = vec![];
    let mut last = header.line;
    for i in 0..header.points {
        let Some((number, line)) = lines.next() else {
            let expected = format!("point {i} of {}", header.points);
            return Err(FormatError::truncated(path, Place::Line(last), expected));
        };
        last = header.line + number - 1;
        let words: Vec<&str> = line.split_whitespace().collect();
        if words.len() != numbers {
            let found = format!("{} numbers", words.len());
            return Err(FormatError::syntax(path, Place::Line(last), found, format!("{numbers}, as the fields say")));
        }
        let mut row = [0.0; 6];
        for (value, &place) in row.iter_mut().zip(&places) {
            *value = text::number(words[place]).ok_or_else(|| {
                FormatError::syntax(
                    path,
                    Place::Line(last),
                    format!("{:?}", words[place]),
                    format!("a number of point {i}"),
                )
            })?;
        }
        rows.push(row);
    }
    let left = lines.count();
    if left > 0 {
        notes.push(format!("{left} lines follow after the {} declared points and were not read", header.points));
    }
    Ok(rows)
}

fn binary_rows(
    path: &Path,
    header: &Header,
    body: &[u8],
    wanted: &[usize],
    notes: &mut Vec<String>,
) -> Result<Vec<[f64; 6]>, FormatError> {
    let record = check_room(path, header, header.record(), body.len() as u64)?;
    let size = header.points * record;
    if size > body.len() as u64 {
        return Err(too_many(path, "points", header.points, body.len() as u64 / record.max(1)));
    }
    let fields: Vec<_> = wanted.iter().map(|&i| (header.offset(i) as usize, &header.fields[i])).collect();
    let row = |point: &[u8]| {
        let mut row = [0.0; 6];
        for (value, (at, field)) in row.iter_mut().zip(&fields) {
            *value = number(&point[*at..], field);
        }
        row
    };
    let (points, left) = body.split_at(size as usize);
    if text::was_transferred_as_text(body, left.len()) {
        let place = Place::Part("binary points".to_owned());
        return Err(FormatError::syntax(path, place, text::ONLY_PAIRS, text::TRANSFERRED_AS_TEXT));
    }
    let left = left.trim_ascii_end().len();
    if left > 0 {
        notes.push(format!("{left} bytes follow after the {} declared points and were not read", header.points));
    }
    Ok(points.chunks_exact(record.max(1) as usize).map(row).collect())
}

/// One field after the other, packed together.
fn compressed_rows(path: &Path, header: &Header, body: &[u8], wanted: &[usize]) -> Result<Vec<[f64; 6]>, FormatError> {
    // 264 bytes from three are the most that LZF makes.
    let record = check_room(path, header, header.record(), (body.len() as u64).saturating_mul(90))?;
    let size = |at: usize| body.get(at..at + 4).map(|b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])));
    let (Some(packed), Some(unpacked)) = (size(0), size(4)) else {
        return Err(FormatError::truncated(path, Place::File, "the two sizes of a compressed block"));
    };
    let room = body.len() as u64 - 8;
    if packed > room {
        return Err(too_many(path, "compressed bytes", packed, room));
    }
    let (expected, points) = (record * header.points, header.points as usize);
    let block = |found: String| {
        let place = Place::Part("compressed block".to_owned());
        FormatError::syntax(path, place, found, format!("{expected} bytes for {points} points"))
    };
    if unpacked != expected || unpacked > packed * 90 {
        return Err(block(format!("{packed} bytes that become {unpacked}")));
    }
    // Unpacked, as rows, and as points.
    let held = unpacked + header.points * (48 + 24);
    crate::file::check_unpacked(path, format!("{points} points"), held, body.len())?;
    let bytes = lzf::unpack(&body[8..8 + packed as usize], unpacked as usize)
        .ok_or_else(|| block("damaged compressed bytes".to_owned()))?;
    let mut rows = vec![[0.0; 6]; points];
    for (slot, &i) in wanted.iter().enumerate() {
        let field = &header.fields[i];
        let start = header.offset(i) as usize * points;
        for (row, bytes) in rows.iter_mut().zip(bytes[start..].chunks_exact(field.size as usize)) {
            row[slot] = number(bytes, field);
        }
    }
    Ok(rows)
}

fn number(bytes: &[u8], field: &Field) -> f64 {
    let mut little = [0; 8];
    let size = field.size as usize;
    little[..size].copy_from_slice(&bytes[..size]);
    let raw = u64::from_le_bytes(little);
    let unused = 64 - 8 * size as u32;
    match (field.kind, size) {
        (b'F', 4) => f64::from(f32::from_bits(raw as u32)),
        (b'F', _) => f64::from_bits(raw),
        (b'I', _) => ((raw << unused) as i64 >> unused) as f64,
        _ => raw as f64,
    }
}

#[cfg(test)]
mod tests;
