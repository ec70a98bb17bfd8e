//! The YAML that calibrations are written in: maps and lists by indentation or in brackets, plain and quoted scalars, tags passed over,
//! the first document alone. No anchors, no block text. A reader of our own: those to be had are no longer kept, or take far more than
//! these files hold.

use crate::text;

/// A value.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Yaml {
    /// A scalar as it stands; empty where nothing does.
    Text(String),
    /// A list.
    List(Vec<Yaml>),
    /// A map, in the order of the file.
    Map(Vec<(String, Yaml)>),
}

/// What is wrong, and in which line, from 1.
pub(crate) type Fault = (usize, String);

/// Brackets and indentations in each other, at most.
const DEEPEST: usize = 60;

impl Yaml {
    /// What stands under this key.
    pub(crate) fn get(&self, key: &str) -> Option<&Yaml> {
        match self {
            Self::Map(entries) => entries.iter().find(|(k, _)| k == key).map(|(_, v)| v),
            _ => None,
        }
    }

    /// A scalar.
    pub(crate) fn text(&self) -> Option<&str> {
        match self {
            Self::Text(text) => Some(text),
            _ => None,
        }
    }

    /// A number.
    pub(crate) fn number(&self) -> Option<f64> {
        self.text().and_then(text::number)
    }
}

struct Line<'a> {
    number: usize,
    indent: usize,
    text: std::borrow::Cow<'a, str>,
}

/// Reads the first document.
pub(crate) fn parse(text: &str) -> Result<Yaml, Fault> {
    let lines = lines(text)?;
    let Some(first) = lines.first() else { return Ok(Yaml::Map(Vec::new())) };
    let indent = first.indent;
    let mut reader = Reader { lines, at: 0 };
    let value = reader.block(indent, 0)?;
    match reader.lines.get(reader.at) {
        Some(left) => Err((left.number, format!("{:?} at this indentation", clipped(&left.text)))),
        None => Ok(value),
    }
}

fn clipped(text: &str) -> &str {
    text.char_indices().nth(40).map_or(text, |(end, _)| &text[..end])
}

/// Lines with something in them; those within brackets joined.
fn lines(text: &str) -> Result<Vec<Line<'_>>, Fault> {
    let mut lines: Vec<Line> = Vec::new();
    let mut open = 0i64;
    for (number, raw) in text::lines(text) {
        let bare = without_comment(raw).trim_end();
        let content = bare.trim_start();
        if open <= 0 && (content.starts_with('%') || content.is_empty()) {
            continue;
        }
        if open <= 0 && (content == "---" || content == "...") {
            if lines.is_empty() {
                continue;
            }
            break;
        }
        let mut quoted = None;
        for c in content.chars() {
            match (quoted, c) {
                (None, '"' | '\'') => quoted = Some(c),
                (Some(q), c) if q == c => quoted = None,
                (None, '[' | '{') => open += 1,
                (None, ']' | '}') => open -= 1,
                _ => {}
            }
        }
        match lines.last_mut().filter(|l| l.number == 0) {
            Some(joined) => {
                let text = joined.text.to_mut();
                text.push(' ');
                text.push_str(content);
                if open <= 0 {
                    joined.number = number;
                }
            }
            None => {
                // Number 0: the brackets are not closed yet.
                let shown = if open > 0 { 0 } else { number };
                lines.push(Line { number: shown, indent: bare.len() - content.len(), text: content.into() });
            }
        }
        if open < 0 {
            return Err((number, "a bracket that closes nothing".to_owned()));
        }
    }
    match lines.last().filter(|l| l.number == 0) {
        Some(_) => Err((text::lines(text).count(), "a bracket that is never closed".to_owned())),
        None => Ok(lines),
    }
}

fn without_comment(line: &str) -> &str {
    let mut quoted = None;
    let mut before = ' ';
    for (i, c) in line.char_indices() {
        match (quoted, c) {
            (None, '"' | '\'') => quoted = Some(c),
            (Some(q), c) if q == c => quoted = None,
            (None, '#') if before.is_whitespace() => return &line[..i],
            _ => {}
        }
        before = c;
    }
    line
}

struct Reader<'a> {
    lines: Vec<Line<'a>>,
    at: usize,
}

impl Reader<'_> {
    /// The list or map whose lines are indented by `indent`.
    fn block(&mut self, indent: usize, depth: usize) -> Result<Yaml, Fault> {
        let Some(first) = self.lines.get(self.at) else { return Ok(Yaml::Text(String::new())) };
        if depth > DEEPEST {
            return Err((first.number, "too many nested levels".to_owned()));
        }
        if is_item(&first.text) { self.list(indent, depth) } else { self.map(indent, depth) }
    }

    fn list(&mut self, indent: usize, depth: usize) -> Result<Yaml, Fault> {
        let mut items = Vec::new();
        while let Some(line) = self.lines.get(self.at).filter(|l| l.indent == indent && is_item(&l.text)) {
            let (number, text) = (line.number, line.text.clone());
            let rest = text[1..].trim_start();
            if is_item(rest) || key_of(rest).is_some() {
                // What begins behind the dash goes on in the lines below, as far in.
                let inner = indent + text.len() - rest.len();
                self.lines[self.at] = Line { number, indent: inner, text: rest.to_owned().into() };
                items.push(self.block(inner, depth + 1)?);
                continue;
            }
            self.at += 1;
            items.push(if rest.is_empty() { self.below(indent, depth)? } else { flow(rest, number)? });
        }
        Ok(Yaml::List(items))
    }

    fn map(&mut self, indent: usize, depth: usize) -> Result<Yaml, Fault> {
        let mut entries: Vec<(String, Yaml)> = Vec::new();
        while let Some(line) = self.lines.get(self.at).filter(|l| l.indent == indent && !is_item(&l.text)) {
            let (number, text) = (line.number, line.text.clone());
            self.at += 1;
            let (key, rest) = match key_of(&text) {
                Some(found) => found,
                // Brackets alone are a document, too.
                None if entries.is_empty() && text.starts_with(['{', '[']) => {
                    return flow(&text, number);
                }
                None => return Err((number, format!("{:?}, no key: value", clipped(&text)))),
            };
            if entries.iter().any(|(k, _)| *k == key) {
                return Err((number, format!("key {key:?} a second time")));
            }
            let rest = without_tag(rest);
            let value = if rest.is_empty() { self.below(indent, depth)? } else { flow(rest, number)? };
            entries.push((key, value));
        }
        Ok(Yaml::Map(entries))
    }

    /// What is indented farther than a key; a list may be as far.
    fn below(&mut self, indent: usize, depth: usize) -> Result<Yaml, Fault> {
        match self.lines.get(self.at) {
            Some(next) if next.indent > indent => self.block(next.indent, depth + 1),
            Some(next) if next.indent == indent && is_item(&next.text) => match self.lines.get(self.at - 1) {
                Some(own) if is_item(&own.text) => Ok(Yaml::Text(String::new())),
                _ => self.block(indent, depth + 1),
            },
            _ => Ok(Yaml::Text(String::new())),
        }
    }
}

fn is_item(text: &str) -> bool {
    text == "-" || text.starts_with("- ")
}

fn without_tag(text: &str) -> &str {
    match text.strip_prefix('!') {
        Some(tag) => tag.find(char::is_whitespace).map_or("", |end| tag[end..].trim_start()),
        None => text,
    }
}

/// A key before its colon, and what follows.
fn key_of(text: &str) -> Option<(String, &str)> {
    if text.starts_with(['[', '{']) {
        return None;
    }
    if let Some(quote) = text.chars().next().filter(|c| matches!(c, '"' | '\'')) {
        let end = text[1..].find(quote)? + 1;
        let rest = text[end + 1..].strip_prefix(':')?;
        return Some((text[1..end].to_owned(), rest.trim()));
    }
    let end = text.find(": ").or_else(|| text.ends_with(':').then(|| text.len() - 1))?;
    Some((text[..end].trim().to_owned(), text[end + 1..].trim()))
}

/// A value on one line.
fn flow(text: &str, number: usize) -> Result<Yaml, Fault> {
    let mut rest = text;
    let value = flow_value(&mut rest, number, 0)?;
    match rest.trim() {
        "" => Ok(value),
        left => Err((number, format!("{:?} behind a value", clipped(left)))),
    }
}

fn flow_value(rest: &mut &str, number: usize, depth: usize) -> Result<Yaml, Fault> {
    if depth > DEEPEST {
        return Err((number, "too many nested levels".to_owned()));
    }
    *rest = without_tag(rest.trim_start());
    let first = rest.chars().next();
    match first {
        Some('[') => {
            let mut items = Vec::new();
            enclosed(rest, ']', number, |rest| {
                items.push(flow_value(rest, number, depth + 1)?);
                Ok(())
            })?;
            Ok(Yaml::List(items))
        }
        Some('{') => {
            let mut entries = Vec::new();
            enclosed(rest, '}', number, |rest| {
                let end = rest.find(':').ok_or_else(|| (number, "an entry without a colon".to_owned()))?;
                let key = rest[..end].trim().trim_matches(['"', '\'']).to_owned();
                *rest = &rest[end + 1..];
                entries.push((key, flow_value(rest, number, depth + 1)?));
                Ok(())
            })?;
            Ok(Yaml::Map(entries))
        }
        Some(quote @ ('"' | '\'')) => {
            let end = rest[1..].find(quote).ok_or_else(|| (number, "a quote that is never closed".to_owned()))?;
            let text = rest[1..=end].to_owned();
            *rest = &rest[end + 2..];
            Ok(Yaml::Text(text))
        }
        Some('&' | '*' | '|' | '>') if depth == 0 => {
            Err((number, format!("{:?}: anchors and block text", clipped(rest))))
        }
        _ => {
            let end = if depth == 0 { rest.len() } else { rest.find([',', ']', '}']).unwrap_or(rest.len()) };
            let text = rest[..end].trim().to_owned();
            *rest = &rest[end..];
            Ok(Yaml::Text(if matches!(text.as_str(), "~" | "null") { String::new() } else { text }))
        }
    }
}

/// Entries with commas between, up to a bracket.
fn enclosed(
    rest: &mut &str,
    close: char,
    number: usize,
    mut entry: impl FnMut(&mut &str) -> Result<(), Fault>,
) -> Result<(), Fault> {
    *rest = &rest[1..];
    loop {
        *rest = rest.trim_start();
        if let Some(after) = rest.strip_prefix(close) {
            *rest = after;
            return Ok(());
        }
        entry(rest)?;
        *rest = rest.trim_start();
        match rest.strip_prefix(',') {
            Some(after) => *rest = after,
            None if rest.starts_with(close) => {}
            None => return Err((number, format!("{:?}, no comma or {close}", clipped(rest)))),
        }
    }
}
