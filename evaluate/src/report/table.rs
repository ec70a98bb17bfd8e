//! A table of text cells for readers, written as Markdown or HTML, and rows written as CSV.

use formats::html::escape;
use serde::Serialize;
use std::fmt::Write;

/// A row that knows its columns: `Serialize` names them for programs, this trait for readers.
pub trait Row: Serialize {
    /// Column names for readers; none stands twice.
    const HEADINGS: &'static [&'static str];

    /// Cells for readers, as many as there are headings.
    fn cells(&self) -> Vec<String>;
}

/// Title, note, header and rows; the first column names the row.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    /// Heading.
    pub title: String,
    /// A sentence on how to read it; may be empty.
    pub note: String,
    /// Column names.
    pub header: Vec<String>,
    /// Cells, as many as the header has.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// An empty table.
    pub fn new(title: &str, note: &str, header: &[&str]) -> Self {
        let header = header.iter().map(|h| (*h).to_owned()).collect();
        Self { title: title.to_owned(), note: note.to_owned(), header, rows: Vec::new() }
    }

    /// The table of these rows.
    pub fn of<R: Row>(title: &str, note: &str, rows: &[R]) -> Self {
        Self { rows: rows.iter().map(R::cells).collect(), ..Self::new(title, note, R::HEADINGS) }
    }

    /// As Markdown with a heading of the second level.
    pub fn to_markdown(&self) -> String {
        let mut text = format!("## {}\n\n", self.title);
        if !self.note.is_empty() {
            let _ = writeln!(text, "{}\n", self.note);
        }
        let line = |cells: &[String]| {
            format!("| {} |\n", cells.iter().map(|c| c.replace('|', "\\|")).collect::<Vec<_>>().join(" | "))
        };
        text.push_str(&line(&self.header));
        let _ = writeln!(text, "|---{}|", "|---:".repeat(self.header.len().saturating_sub(1)));
        self.rows.iter().for_each(|row| text.push_str(&line(row)));
        text.push('\n');
        text
    }

    /// As HTML with a heading of the second level.
    pub fn to_html(&self) -> String {
        let line = |cells: &[String], tag: &str| {
            let cells: String = cells.iter().map(|c| format!("<{tag}>{}</{tag}>", escape(c))).collect();
            format!("<tr>{cells}</tr>")
        };
        let rows: String = self.rows.iter().map(|row| line(row, "td")).collect();
        format!(
            "<h2>{}</h2><p>{}</p><div class=\"scroll\"><table><thead>{}</thead><tbody>{rows}</tbody></table></div>\n",
            escape(&self.title),
            escape(&self.note),
            line(&self.header, "th")
        )
    }
}

/// Writes rows as CSV under a line with the names of their fields.
///
/// # Errors
/// What the operating system refuses.
pub fn write_csv<R: Serialize>(w: impl std::io::Write, rows: impl IntoIterator<Item = R>) -> std::io::Result<()> {
    let mut writer = csv::Writer::from_writer(w);
    for row in rows {
        writer.serialize(row)?;
    }
    writer.flush()
}

/// A number with this many decimals; a dash where there is none.
pub fn number(value: Option<f64>, decimals: usize) -> String {
    value.filter(|v| v.is_finite()).map_or_else(|| "-".to_owned(), |v| format!("{v:.decimals$}"))
}

/// An interval with this many decimals; a dash where there is none.
pub fn range(low: Option<f64>, high: Option<f64>, decimals: usize) -> String {
    low.zip(high).map_or_else(|| "-".to_owned(), |(low, high)| format!("[{low:.decimals$}, {high:.decimals$}]"))
}

#[cfg(test)]
mod tests;
