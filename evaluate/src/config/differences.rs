//! Settings that differ, by their dotted keys.

use super::EvaluateConfig;
use std::collections::BTreeSet;
use std::fmt;
use toml::{Table, Value};

/// A setting, or a table of settings that only one side has.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Difference {
    /// Its dotted key.
    pub key: String,
    there: Option<Value>,
    now: Option<Value>,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (mark, value) in [("there:", &self.there), ("now:  ", &self.now)] {
            match value {
                Some(value) => writeln!(f, "  {mark} {} = {value}", self.key)?,
                None => writeln!(f, "  {mark} no {}", self.key)?,
            }
        }
        Ok(())
    }
}

/// What differs, by key.
pub(crate) fn between(there: &EvaluateConfig, now: &EvaluateConfig) -> Vec<Difference> {
    let mut found = Vec::new();
    if let (Ok(there), Ok(now)) = (Table::try_from(there), Table::try_from(now)) {
        compare(&there, &now, "", &mut found);
    }
    found
}

fn compare(there: &Table, now: &Table, prefix: &str, found: &mut Vec<Difference>) {
    let keys: BTreeSet<&String> = there.keys().chain(now.keys()).collect();
    for key in keys {
        let name = format!("{prefix}{key}");
        match (there.get(key), now.get(key)) {
            (a, b) if a == b => {}
            (Some(Value::Table(a)), Some(Value::Table(b))) => compare(a, b, &format!("{name}."), found),
            (a, b) => found.push(Difference { key: name, there: a.cloned(), now: b.cloned() }),
        }
    }
}
