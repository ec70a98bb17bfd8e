//! The XML that URDF is: elements with attributes; text, comments and declarations are passed over.

/// An element.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Element {
    pub name: String,
    attributes: Vec<(String, String)>,
    pub children: Vec<Element>,
}

impl Element {
    pub fn attribute(&self, key: &str) -> Option<&str> {
        self.attributes.iter().find(|(k, _)| k == key).map(|(_, v)| v.as_str())
    }

    pub fn child(&self, name: &str) -> Option<&Element> {
        self.children.iter().find(|c| c.name == name)
    }

    pub fn children_named(&self, name: &str) -> impl Iterator<Item = &Element> {
        self.children.iter().filter(move |c| c.name == name)
    }

    /// Whether its name, or that of an attribute or of an element in it, begins like this.
    pub fn has_name(&self, beginning: &str) -> bool {
        self.name.starts_with(beginning)
            || self.attributes.iter().any(|(key, _)| key.starts_with(beginning))
            || self.children.iter().any(|child| child.has_name(beginning))
    }
}

/// Elements in each other, at most.
const DEEPEST: usize = 64;

/// The root element; what is wrong, with its line, else.
pub(super) fn parse(text: &str) -> Result<Element, (usize, String)> {
    let mut open: Vec<Element> = Vec::new();
    let mut rest = text;
    let line = |rest: &str| text[..text.len() - rest.len()].matches('\n').count() + 1;
    while let Some(start) = rest.find('<') {
        rest = &rest[start..];
        let wrong = |found: String| (line(rest), found);
        for (begin, end) in [("<!--", "-->"), ("<?", "?>"), ("<![CDATA[", "]]>"), ("<!", ">")] {
            if rest.starts_with(begin) {
                let close = rest.find(end).ok_or_else(|| wrong(format!("{begin} that is never closed")))?;
                rest = &rest[close + end.len()..];
                break;
            }
        }
        if !rest.starts_with('<') || rest.starts_with("<!") || rest.starts_with("<?") {
            continue;
        }
        let wrong = |found: String| (line(rest), found);
        let close = end_of_tag(rest).ok_or_else(|| wrong("a tag that is never closed".to_owned()))?;
        let tag = rest[1..close].trim();
        let mut done = None;
        if let Some(name) = tag.strip_prefix('/') {
            let element = open.pop().filter(|e| e.name == name.trim());
            done = Some(element.ok_or_else(|| wrong(format!("</{}> without its beginning", name.trim())))?);
        } else {
            let (tag, alone) = tag.strip_suffix('/').map_or((tag, false), |tag| (tag, true));
            let element = element(tag).map_err(wrong)?;
            if alone {
                done = Some(element);
            } else if open.len() >= DEEPEST {
                return Err(wrong("elements nested too deeply".to_owned()));
            } else {
                open.push(element);
            }
        }
        rest = &rest[close + 1..];
        if let Some(element) = done {
            match open.last_mut() {
                Some(parent) => parent.children.push(element),
                None => return Ok(element),
            }
        }
    }
    match open.last() {
        Some(element) => Err((line(""), format!("<{}> that is never closed", element.name))),
        None => Err((1, "no element".to_owned())),
    }
}

/// Where a tag ends, quotes passed over.
fn end_of_tag(text: &str) -> Option<usize> {
    let mut quoted = None;
    text.char_indices().find_map(|(i, c)| {
        match (quoted, c) {
            (None, '"' | '\'') => quoted = Some(c),
            (Some(q), c) if q == c => quoted = None,
            (None, '>') => return Some(i),
            _ => {}
        }
        None
    })
}

fn element(tag: &str) -> Result<Element, String> {
    let name = tag.split(char::is_whitespace).next().unwrap_or_default();
    let mut element = Element { name: name.to_owned(), ..Element::default() };
    let mut rest = tag[name.len()..].trim_start();
    while !rest.is_empty() {
        let odd = || format!("{:?} in <{name}>", rest.chars().take(30).collect::<String>());
        let (key, after) = rest.split_once('=').ok_or_else(odd)?;
        let after = after.trim_start();
        let quote = after.chars().next().filter(|c| matches!(c, '"' | '\'')).ok_or_else(odd)?;
        let end = after[1..].find(quote).ok_or_else(odd)? + 1;
        element.attributes.push((key.trim().to_owned(), after[1..end].to_owned()));
        rest = after[end + 1..].trim_start();
    }
    Ok(element)
}
