//! Names above a table of poses: `# timestamp tx ty tz qw qx qy qz`, or EuRoC's `#timestamp [ns], p_RS_R_x [m], ..., q_RS_w [], ...`.

use crate::cloud::{Unit, has_marks, names, with_unit};
use nalgebra::Isometry3;
use planning::pose::from_quaternion;

/// What is expected of a row under names.
pub(super) const EXPECTED: &str = "the columns that the names above say: x y z and a unit quaternion qx qy qz qw";

/// The names above the first row.
pub(super) struct Header {
    /// The line that they stand in.
    pub line: usize,
    count: usize,
    /// What they name; what is wrong with them.
    named: Result<Named, String>,
}

struct Named {
    /// Places of x, y, z.
    position: [usize; 3],
    /// Places of x, y, z, w.
    quaternion: [usize; 4],
    metres_per_unit: f64,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Position,
    Quaternion,
    /// An axis alone.
    Bare,
}

impl Header {
    /// The last line above the first row that names the columns of poses, in a comment or not.
    pub fn above(text: &str) -> Option<Self> {
        let mut header = None;
        for (number, line) in crate::text::lines(text) {
            let content = crate::text::without_comment(line).trim();
            let found = match content.is_empty() {
                true => Self::of(number, line),
                false if super::numbers(content).is_some() => break,
                // Other words are told where rows are read.
                false => Some(Self::of(number, content)?),
            };
            header = found.or(header);
        }
        header
    }

    /// What a line names; `None` where it does not seem to name the columns of poses.
    fn of(line: usize, text: &str) -> Option<Self> {
        let text = text.trim_matches(|c: char| c.is_whitespace() || "#/%".contains(c));
        let cells: Vec<_> = names(text, !has_marks(text, true)).iter().map(|cell| with_unit(cell)).collect();
        let meanings: Vec<_> = cells.iter().map(|(name, _)| meaning(name)).collect();
        let only = |kind: Kind, axis: char| {
            let mut places = (0..meanings.len()).filter(|&i| meanings[i] == Some((kind, axis)));
            places.next().filter(|_| places.next().is_none())
        };
        let three = |kind| Some([only(kind, 'x')?, only(kind, 'y')?, only(kind, 'z')?]);
        let four = |kind| three(kind).and_then(|[x, y, z]| Some([x, y, z, only(kind, 'w')?]));
        let quaternion = four(Kind::Quaternion);
        let position = three(Kind::Position);
        // `tx ty tz x y z w`, and `x y z qx qy qz qw`.
        let (position, quaternion) = match position {
            Some(_) => (position, quaternion.or_else(|| four(Kind::Bare))),
            None => (three(Kind::Bare), quaternion),
        };
        // Of rows of eight numbers.
        let eight = cells.len() == 8;
        let named = match (position, quaternion) {
            (Some(position), Some(quaternion)) => {
                let with = |metres_per_unit| Named { position, quaternion, metres_per_unit };
                unit(position.map(|i| &cells[i].1)).map(with)
            }
            (Some([1, 2, 3]), None) if eight => Err("x, y, z, but no qx, qy, qz, qw, are named".to_owned()),
            (None, Some(quaternion)) if eight && quaternion != [4, 5, 6, 7] => {
                Err("qx, qy, qz, qw, but no x, y, z, are named".to_owned())
            }
            _ => return None,
        };
        Some(Self { line, count: cells.len(), named })
    }

    /// Whether a row of so many numbers is one of the table.
    pub fn is_of(&self, numbers: usize) -> bool {
        numbers == self.count || numbers == 8
    }

    /// The pose of a row; what is wrong with it or the names.
    pub fn pose(&self, values: &[f64]) -> Result<Isometry3<f64>, String> {
        let Self { line, count, named } = self;
        let Named { position, quaternion, metres_per_unit } =
            named.as_ref().map_err(|found| format!("names in line {line}: {found}"))?;
        let places = || position.iter().chain(quaternion).copied();
        let (first, last) = (places().min().unwrap_or(0), places().max().unwrap_or(0));
        // Often the time has no name, or other words stand before and behind the names.
        let (from, to) = match values.len() {
            length if length == *count => (0, 0),
            8 if last - first == 6 => (first, 1),
            length => return Err(format!("{length} numbers under {count} names in line {line}")),
        };
        let value = |i: usize| values[i - from + to];
        from_quaternion(quaternion.map(value), position.map(|i| metres_per_unit * value(i)))
    }
}

/// Metres per unit of positions, by what stands with their names.
fn unit(named: [&Option<Unit>; 3]) -> Result<f64, String> {
    match named {
        // `x y z [m]`
        [None, None, Some(Unit::Metres(metres))] => Ok(*metres),
        [x, y, z] if x != y || x != z => Err("different units of x, y and z".to_owned()),
        [Some(Unit::Unknown(found)), ..] => Err(format!("the unit {found:?}, which is not known")),
        [Some(Unit::Metres(metres)), ..] => Ok(*metres),
        [None, ..] => Ok(1.0),
    }
}

/// What is called so: `qw`, `q_RS_w`, `tx`, `pose.position.x`, `x`.
fn meaning(name: &str) -> Option<(Kind, char)> {
    const QUATERNION: [&str; 6] = ["q", "quat", "quaternion", "orientation", "rot", "rotation"];
    const POSITION: [&str; 6] = ["p", "t", "pos", "position", "trans", "translation"];
    let words: Vec<&str> = name.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).collect();
    let (last, before) = words.split_last()?;
    let axis = last.chars().next_back().filter(|c| matches!(c, 'w' | 'x' | 'y' | 'z'))?;
    let own = [&last[..last.len() - 1]];
    let said: &[&str] = if own[0].is_empty() { before } else { &own };
    match said {
        [] => Some((Kind::Bare, axis)),
        _ if said.iter().any(|word| QUATERNION.contains(word)) => Some((Kind::Quaternion, axis)),
        _ if said.iter().any(|word| POSITION.contains(word)) => Some((Kind::Position, axis)),
        _ => None,
    }
}
