//! A table of text cells, written as Markdown, HTML or CSV.

use std::fmt::Write;

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

    /// As CSV with a header line.
    pub fn to_csv(&self) -> String {
        let cell = |c: &String| {
            if c.contains([',', '"', '\n']) { format!("\"{}\"", c.replace('"', "\"\"")) } else { c.clone() }
        };
        let line = |cells: &Vec<String>| cells.iter().map(cell).collect::<Vec<_>>().join(",") + "\n";
        std::iter::once(&self.header).chain(&self.rows).map(line).collect()
    }
}

/// Text that is safe inside HTML.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

/// A number with this many decimals; a dash where there is none.
pub fn number(value: Option<f64>, decimals: usize) -> String {
    value.filter(|v| v.is_finite()).map_or_else(|| "-".to_owned(), |v| format!("{v:.decimals$}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_forms() {
        let mut table = Table::new("T", "a < b", &["x", "y"]);
        table.rows.push(vec!["p|q".into(), number(Some(1.25), 1)]);
        assert!(table.to_markdown().contains("| p\\|q | 1.2 |"), "{}", table.to_markdown());
        assert!(table.to_html().contains("a &lt; b") && table.to_html().contains("<td>p|q</td>"));
        table.rows.push(vec!["a,b".into(), number(None, 2)]);
        assert_eq!(table.to_csv(), "x,y\np|q,1.2\n\"a,b\",-\n");
    }
}
