//! What the columns of a text cloud are, by the names above them.

/// Where positions and normals stand.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Columns {
    pub(super) position: [usize; 3],
    pub(super) normal: Option<[usize; 3]>,
    /// The unit named with the positions, metres.
    pub(super) metres_per_unit: Option<f64>,
    /// A unit named with them that is not known.
    pub(super) unknown_unit: Option<String>,
    /// Number of names.
    pub(super) count: usize,
    /// Whether blanks part names, rather than belonging to them between commas, semicolons or tabulators.
    blanks_part: bool,
}

/// Spellings of the three axes, from the likeliest: letters, survey coordinates, and how programs number vectors.
const POSITIONS: [[&[&str]; 3]; 5] = [
    [&["x"], &["y"], &["z"]],
    [
        &["px", "posx", "positionx", "pointx", "coordx", "coordinatex", "xcoord", "xcoordinate", "xpos", "xposition"],
        &["py", "posy", "positiony", "pointy", "coordy", "coordinatey", "ycoord", "ycoordinate", "ypos", "yposition"],
        &["pz", "posz", "positionz", "pointz", "coordz", "coordinatez", "zcoord", "zcoordinate", "zpos", "zposition"],
    ],
    // `X axis [mm]`, `X in mm`, `X value`.
    [
        &["xaxis", "xin", "xvalue", "xachse", "xwert"],
        &["yaxis", "yin", "yvalue", "yachse", "ywert"],
        &["zaxis", "zin", "zvalue", "zachse", "zwert"],
    ],
    [
        &["easting", "east", "e", "x", "rechtswert", "ost"],
        &["northing", "north", "n", "y", "hochwert", "nord"],
        &["height", "elevation", "altitude", "elev", "alt", "h", "up", "u", "z", "hohe", "hoehe"],
    ],
    [
        &["points0", "coordinates0", "position0"],
        &["points1", "coordinates1", "position1"],
        &["points2", "coordinates2", "position2"],
    ],
];

const NORMALS: [&[&str]; 3] = [
    &["nx", "normalx", "xnormal", "normals0", "normal0", "normx"],
    &["ny", "normaly", "ynormal", "normals1", "normal1", "normy"],
    &["nz", "normalz", "znormal", "normals2", "normal2", "normz"],
];

impl Columns {
    /// The first three columns, without names.
    pub(super) fn by_place() -> Self {
        Self {
            position: [0, 1, 2],
            normal: None,
            metres_per_unit: None,
            unknown_unit: None,
            count: 0,
            blanks_part: true,
        }
    }

    /// By a line of names; `None` where they tell no position, an error where they contradict each other.
    pub(super) fn named(line: &str) -> Result<Option<Self>, String> {
        let blanks_part = !has_marks(line, true);
        match Self::of(&names(line, blanks_part), blanks_part)? {
            // `X Y Z, R G B`
            None if !blanks_part => Self::of(&names(line, true), true),
            columns => Ok(columns),
        }
    }

    fn of(cells: &[String], blanks_part: bool) -> Result<Option<Self>, String> {
        let names: Vec<(String, Option<Unit>)> = cells.iter().map(|cell| plain(cell)).collect();
        let find = |axis: &[&str]| axis.iter().find_map(|&name| names.iter().position(|(n, _)| n == name));
        let all = |axes: &[&[&str]; 3]| {
            let [a, b, c] = axes.map(find);
            Some([a?, b?, c?])
        };
        let Some(position) = POSITIONS.iter().find_map(all) else { return Ok(None) };
        let normal = all(&NORMALS);
        for &i in position.iter().chain(normal.iter().flatten()) {
            if names.iter().filter(|(name, _)| *name == names[i].0).count() > 1 {
                return Err(format!("the column {:?} twice", cells[i].trim()));
            }
        }
        let [unit, others @ ..] = position.map(|i| &names[i].1);
        if others.iter().any(|other| *other != unit) {
            return Err(format!("different units of {}", position.map(|i| cells[i].trim()).join(", ")));
        }
        let (metres_per_unit, unknown_unit) = match unit {
            None => (None, None),
            Some(Unit::Metres(metres)) => (Some(*metres), None),
            Some(Unit::Unknown(found)) => (None, Some(found.clone())),
        };
        Ok(Some(Self { position, normal, metres_per_unit, unknown_unit, count: cells.len(), blanks_part }))
    }

    /// Whether blanks were taken to part the names of this line although marks stand between them.
    pub(super) fn is_guess(&self, line: &str) -> bool {
        self.blanks_part && has_marks(line, true)
    }

    /// The cells of a row under these names; blanks part those of a row without any mark (`# x, y, z` above `1 2 3`).
    pub(super) fn cells<'a>(&self, row: &'a str, commas_part: bool) -> Vec<&'a str> {
        cells(row, commas_part, self.blanks_part || !has_marks(row, commas_part))
    }
}

/// The unit that stands with a name.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Unit {
    /// How long it is.
    Metres(f64),
    /// As it is written.
    Unknown(String),
}

/// A name in lower-case letters and digits, and the unit that stands with it.
fn plain(cell: &str) -> (String, Option<Unit>) {
    let (name, unit) = with_unit(cell);
    (name.chars().filter(|c| c.is_alphanumeric()).collect(), unit)
}

/// A name in lower case, and the unit that stands with it in brackets or behind a last `_`.
pub(crate) fn with_unit(cell: &str) -> (String, Option<Unit>) {
    let cell = cell.trim_matches(|c: char| c.is_whitespace() || "\"'/#".contains(c)).to_lowercase();
    let (name, bracketed) = match cell.find(BRACKETS) {
        Some(at) => (&cell[..at], in_brackets(&cell[at..])),
        None => (&cell[..], None),
    };
    let behind = name.trim().rsplit_once(['_', ' ']).and_then(|(before, last)| Some((before, metres(last)?)));
    match behind.filter(|_| bracketed.is_none()) {
        Some((before, metres)) => (before.to_owned(), Some(Unit::Metres(metres))),
        None => (name.to_owned(), bracketed),
    }
}

const BRACKETS: [char; 8] = ['[', ']', '(', ')', '<', '>', '{', '}'];

/// The unit among words in brackets, or the first of these words.
fn in_brackets(text: &str) -> Option<Unit> {
    let is_edge = |c: char| !c.is_alphanumeric() && c != char::REPLACEMENT_CHARACTER;
    let words: Vec<&str> = text.split(BRACKETS).map(|word| word.trim_matches(is_edge)).collect();
    match words.iter().find_map(|word| metres(word)) {
        Some(metres) => Some(Unit::Metres(metres)),
        None => words.iter().find(|word| word.contains(char::is_alphabetic)).map(|word| Unit::Unknown((*word).into())),
    }
}

fn metres(unit: &str) -> Option<f64> {
    // A mu that is no UTF-8.
    let after_mu = unit.trim_start_matches(char::REPLACEMENT_CHARACTER);
    if after_mu.len() < unit.len() {
        return (after_mu == "m").then_some(1e-6);
    }
    Some(match unit {
        "m" | "metre" | "metres" | "meter" | "meters" => 1.0,
        "mm" | "millimetre" | "millimetres" | "millimeter" | "millimeters" => 0.001,
        "cm" | "centimetre" | "centimetres" | "centimeter" | "centimeters" => 0.01,
        "dm" => 0.1,
        "km" => 1000.0,
        "um" | "\u{b5}m" | "\u{3bc}m" | "micron" | "microns" => 1e-6,
        "micrometre" | "micrometres" | "micrometer" | "micrometers" => 1e-6,
        "nm" | "nanometre" | "nanometres" | "nanometer" | "nanometers" => 1e-9,
        "in" | "inch" | "inches" => 0.0254,
        "ft" | "foot" | "feet" => 0.3048,
        "yd" | "yard" | "yards" => 0.9144,
        _ => return None,
    })
}

/// Whether a line has marks between its cells other than blanks.
pub(crate) fn has_marks(line: &str, commas_part: bool) -> bool {
    line.trim().contains(|c: char| is_mark(c, commas_part))
}

fn is_mark(c: char, commas_part: bool) -> bool {
    matches!(c, ';' | '\t') || (c == ',' && commas_part)
}

/// Cells of a line: tabulators, semicolons and (unless they are decimal marks) commas part them, between which a cell may be
/// empty, and blanks if `blanks_part`. Quotes keep a cell together.
pub(super) fn cells(line: &str, commas_part: bool, blanks_part: bool) -> Vec<&str> {
    let mut cells = vec![];
    let mut rest = line.trim_start_matches(' ');
    let mut open = true; // a cell is due, be it empty
    while let Some(first) = rest.chars().next() {
        let parts = |c: char| is_mark(c, commas_part);
        if parts(first) {
            if open {
                cells.push("");
            }
            open = true;
            rest = rest[1..].trim_start_matches(' ');
            continue;
        }
        let (cell, behind) = match first {
            '"' | '\'' => match rest[1..].find(first) {
                Some(end) => (&rest[1..1 + end], &rest[end + 2..]),
                None => (&rest[1..], ""),
            },
            _ => rest.split_at(rest.find(|c| (c == ' ' && blanks_part) || parts(c)).unwrap_or(rest.len())),
        };
        if !cell.is_empty() || first == '"' || first == '\'' {
            cells.push(cell.trim());
        }
        open = false;
        rest = behind.trim_start_matches(' ');
    }
    if open && !cells.is_empty() {
        cells.push("");
    }
    cells
}

/// Cells of a line of names: units in brackets of their own (`X [m] Y [m]`) go with the name before.
pub(crate) fn names(line: &str, blanks_part: bool) -> Vec<String> {
    let mut names: Vec<String> = vec![];
    for cell in cells(line, true, blanks_part) {
        match names.last_mut().filter(|_| cell.starts_with(['[', '(', '<', '{'])) {
            Some(name) => name.push_str(cell),
            None => names.push(cell.to_owned()),
        }
    }
    while names.last().is_some_and(String::is_empty) {
        names.pop();
    }
    names
}

#[cfg(test)]
mod tests;
