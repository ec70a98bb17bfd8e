//! Text clouds: one point per line, numbers apart by blanks, tabulators, commas or semicolons. No crate reads them.

use super::CloudFile;
use super::columns::{Columns, cells, has_marks, names};
use crate::FormatError;
use crate::error::Place;
use crate::text;
use std::path::Path;

/// Columns go by the names above them, in a comment or not; without names, the first three are positions, and columns four to
/// six normals where all of them have unit length, else colours or intensities, which are ignored as all further ones are.
/// `#`, `//` and, at the beginning of a line, `%` begin comments; one line of words may stand above the numbers, and one with a lone count.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<CloudFile, FormatError> {
    let text = text::decode(bytes);
    let mut head = Head::default();
    let mut table =
        Table { path, columns: Columns::by_place(), named_in: 0, commas: None, numbers: None, rows: vec![] };
    for (number, line) in text::lines(&text) {
        let content = text::without_comment(line).split("//").next().unwrap_or("").trim_matches('\u{feff}');
        let content = if content.trim_start().starts_with('%') { "" } else { content };
        if !table.rows.is_empty() {
            if !content.trim().is_empty() {
                table.push(number, content)?;
            }
        } else if content.trim().is_empty() {
            head.take_comment(number, line);
        } else if !head.takes(path, number, content)? {
            if let Some((line, columns)) = head.columns_of(path, content)? {
                (table.named_in, table.columns) = (line, columns);
            }
            table.push(number, content)?;
        }
    }
    table.finish(head)
}

/// The lines above the points.
#[derive(Default)]
struct Head {
    /// Names of columns, with their line.
    columns: Option<(usize, Columns)>,
    /// The same in a comment: a guess.
    comment: Option<(usize, Columns)>,
    /// A line of words that names no positions, unless `columns` are guessed right from it.
    title: Option<(usize, String)>,
    /// A lone number.
    count: Option<u64>,
}

impl Head {
    fn take_comment(&mut self, number: usize, line: &str) {
        let names = line.trim_matches(|c: char| c.is_whitespace() || "#/%".contains(c));
        if let Ok(Some(columns)) = Columns::named(names) {
            self.comment = Some((number, columns));
        }
    }

    /// Whether a line still stands above the points.
    fn takes(&mut self, path: &Path, number: usize, content: &str) -> Result<bool, FormatError> {
        // Excel's: what stands between the cells shows by itself.
        if number == 1 && content.trim().to_ascii_lowercase().starts_with("sep=") {
            return Ok(true);
        }
        let cells = cells(content, true, true);
        let is_number = |cell: &&str| cell.is_empty() || decimal(cell).is_some();
        if let ([count], None) = (&cells[..], self.count) {
            self.count = count.parse().ok();
            return Ok(self.count.is_some());
        }
        if cells.iter().take(3).all(is_number) || self.columns.is_some() || self.title.is_some() {
            return Ok(false);
        }
        let refuse =
            |found: String| FormatError::syntax(path, Place::Line(number), found, "every column once, in one unit");
        let columns = Columns::named(content).map_err(refuse)?;
        if columns.as_ref().is_none_or(|columns| columns.is_guess(content)) {
            self.title = Some((number, content.trim().to_owned()));
        }
        self.columns = columns.map(|columns| (number, columns));
        Ok(true)
    }

    /// The names of the columns above the first point; those in a comment, or guessed, only where there are as many. As many
    /// others, with marks between them, say that the columns are no positions.
    fn columns_of(&self, path: &Path, content: &str) -> Result<Option<(usize, Columns)>, FormatError> {
        let commas = commas_part(content);
        let count = |cells: &[&str]| cells.iter().rposition(|c| !c.is_empty()).map_or(0, |last| last + 1);
        let whole = count(&cells(content, commas, !has_marks(content, commas)));
        let fits = |(_, columns): &(usize, Columns)| columns.count == count(&columns.cells(content, commas));
        let named = self.columns.clone().filter(|columns| self.title.is_none() || fits(columns));
        match &self.title {
            Some((line, title)) if named.is_none() && has_marks(title, true) && names(title, false).len() == whole => {
                let expected = "x, y and z, or easting, northing and height, among the names of the columns";
                Err(FormatError::syntax(path, Place::Line(*line), format!("{title:?}"), expected))
            }
            _ => Ok(named.or_else(|| self.comment.clone().filter(fits))),
        }
    }
}

struct Table<'a> {
    path: &'a Path,
    columns: Columns,
    /// Line of the columns' names; 0 without.
    named_in: usize,
    /// Whether commas part cells (else they are decimal marks); unknown before the first line with one.
    commas: Option<bool>,
    /// Numbers per line where no names say it.
    numbers: Option<usize>,
    /// Positions, and what may be normals.
    rows: Vec<([f64; 3], Option<[f64; 3]>)>,
}

impl Table<'_> {
    fn push(&mut self, line: usize, content: &str) -> Result<(), FormatError> {
        let refuse = |found: String, expected: &str| FormatError::syntax(self.path, Place::Line(line), found, expected);
        if content.contains(',') {
            if let Some(word) = content.split_whitespace().find(|word| has_thousands(word)) {
                return Err(refuse(format!("{word:?}"), "numbers without thousands separators"));
            }
            self.commas.get_or_insert_with(|| commas_part(content));
        }
        let mut cells = self.columns.cells(content, self.commas.unwrap_or(true));
        while self.named_in > 0 && cells.len() > self.columns.count && cells.last() == Some(&"") {
            cells.pop();
        }
        let numbers = cells.iter().take_while(|cell| decimal(cell).is_some()).count();
        if self.named_in > 0 {
            if cells.len() != self.columns.count {
                let expected = format!("{}, as line {} names columns", self.columns.count, self.named_in);
                return Err(refuse(format!("{} values", cells.len()), &expected));
            }
        } else if numbers >= 3 && numbers != *self.numbers.get_or_insert(numbers) {
            let expected = format!("{}, as in the lines before", self.numbers.unwrap_or_default());
            return Err(refuse(format!("{numbers} numbers"), &expected));
        }
        let coordinate = |i: usize| match cells.get(i).copied() {
            None => Err(refuse(format!("{} numbers", cells.len()), "three coordinates")),
            Some("") => Err(refuse(format!("an empty cell in column {}", i + 1), "a coordinate")),
            Some(cell) if self.commas == Some(true) && is_padded(cell) => {
                let expected = "numbers with decimal points, since commas separate columns here (or semicolons or spaces between numbers with decimal commas)";
                Err(refuse(format!("{cell:?}"), expected))
            }
            Some(cell) => decimal(cell).ok_or_else(|| refuse(format!("{cell:?}"), "three coordinates")),
        };
        let [x, y, z] = self.columns.position;
        let position = [coordinate(x)?, coordinate(y)?, coordinate(z)?];
        let three = |at: [usize; 3]| {
            let [a, b, c] = at.map(|i| decimal(cells.get(i)?));
            Some([a?, b?, c?])
        };
        let other = match self.columns.normal {
            // By name: an empty cell or a word is a normal that is missing.
            Some(at) => Some(three(at).unwrap_or([f64::NAN; 3])),
            None if self.named_in == 0 => three([3, 4, 5]),
            None => None,
        };
        self.rows.push((position, other));
        Ok(())
    }

    /// Whether four columns or more, without names, begin with one that says 0, 1, 2, 3 ... or 1, 2, 3, 4 ...
    fn counts_lines(&self) -> bool {
        let first = self.rows.first().map_or(2.0, |(position, _)| position[0]);
        self.named_in == 0
            && self.numbers.is_some_and(|numbers| numbers > 3)
            && self.rows.len() >= 10
            && (first == 0.0 || first == 1.0)
            && self.rows.iter().enumerate().all(|(i, (position, _))| position[0] == first + i as f64)
    }

    fn finish(self, head: Head) -> Result<CloudFile, FormatError> {
        let mut notes = vec![];
        let six = !self.rows.is_empty() && self.rows.iter().all(|(_, other)| other.is_some());
        let normals =
            six && (self.named_in > 0 || super::are_normals(self.rows.iter().filter_map(|(_, n)| n.as_ref())));
        if six && !normals {
            notes.push(super::columns_ignored());
        }
        if let Some((line, title)) = head.title.filter(|_| self.named_in == 0) {
            notes.push(format!("line {line}, {title:?}, names no x, y and z: the first three columns were used"));
        }
        if self.counts_lines() {
            notes.push(
                "column 1 counts the lines and was taken for x: if it is a number of the point, name the columns in a line above (id x y z)"
                    .to_owned(),
            );
        }
        if self.commas == Some(false) {
            notes.push("commas were read as decimal separators".to_owned());
        }
        let read = self.rows.len() as u64;
        if let Some(count) = head.count.filter(|&count| count != read) {
            notes.push(format!("a line above the points says {count}, but there are {read}: all were read"));
        }
        let rows = self.rows.into_iter().map(|(position, other)| (position, other.filter(|_| normals)));
        let mut file = CloudFile::gather(self.path, rows, None)?.with_notes(notes);
        file.metres_per_unit = self.columns.metres_per_unit;
        file.unknown_unit = self.columns.unknown_unit;
        Ok(file)
    }
}

/// A number with a decimal point or one decimal comma.
fn decimal(cell: &str) -> Option<f64> {
    match cell.matches(',').count() {
        0 => text::number(cell),
        1 if !cell.contains('.') => text::number(&cell.replace(',', ".")),
        _ => None,
    }
}

/// Digits behind a zero: the part of a number behind its decimal comma.
fn is_padded(cell: &str) -> bool {
    let digits = cell.trim_start_matches(['+', '-']);
    digits.len() > 1 && digits.starts_with('0') && digits.bytes().all(|b| b.is_ascii_digit())
}

/// `1,234.5` and `1.234,5`.
fn has_thousands(word: &str) -> bool {
    let digits = word.trim_start_matches(['+', '-']);
    let marks: Vec<&str> = digits.split([',', '.']).collect();
    let groups = marks.len() == 3 && (1..=3).contains(&marks[0].len()) && marks[1].len() == 3;
    let numbers = marks.iter().all(|m| !m.is_empty() && m.bytes().all(|b| b.is_ascii_digit()));
    groups && numbers && digits.contains(',') && digits.contains('.')
}

/// Whether the commas of a line part cells; else they are decimal marks, of three numbers that other things part.
fn commas_part(line: &str) -> bool {
    let words = cells(line, false, true);
    let whole = |word: &&str| !word.starts_with(',') && !word.ends_with(',') && decimal(word).is_some();
    words.len() < 3 || !words.iter().take(3).all(whole)
}

#[cfg(test)]
mod tests;
