//! Views checked by who knows the arm, a motion planner: JSON lines to a program of `--check-with`, or to the client of stdin and stdout.

mod process;

pub use process::program;

use planning::session::{AskedView, Verdict};
use serde::Deserialize;
use serde_json::{Value, json};
use std::time::Duration;

/// How often who waits for a reply looks whether he still may.
pub const LOOK: Duration = Duration::from_millis(20);

/// What ids of questions begin with.
const OURS: &str = "check-";

/// One question, as a line.
pub fn question(number: u64, views: &[AskedView]) -> Vec<u8> {
    let line = json!({ "id": format!("{OURS}{number}"), "method": "check_views", "params": { "views": views } });
    format!("{line}\n").into_bytes()
}

/// A line that answers a question.
pub struct Answered {
    /// Which.
    pub number: u64,
    /// What it says.
    pub said: Result<Value, Value>,
}

impl Answered {
    /// `None` of a line that is anything else.
    ///
    /// ```ignore
    /// {"id": "check-7", "result": [{"reachable": true, "cost": 0.3}, {"reachable": false, "reason": "elbow in the wall"}]}
    /// {"id": "check-7", "error": {"message": "the planning scene is not known yet"}}
    /// ```
    pub fn parse(line: &[u8]) -> Option<Self> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Line {
            id: String,
            result: Option<Value>,
            error: Option<Value>,
        }
        let Line { id, result, error } = serde_json::from_slice(line).ok()?;
        let said = match (result, error) {
            (Some(result), None) => Ok(result),
            (None, Some(error)) => Err(error),
            _ => return None,
        };
        Some(Self { number: id.strip_prefix(OURS)?.parse().ok()?, said })
    }

    /// One verdict for each of so many views.
    ///
    /// # Errors
    /// What it says is wrong, or what is wrong with it.
    pub fn verdicts(self, views: usize) -> Result<Vec<Verdict>, String> {
        let result = self.said.map_err(|error| match error.get("message").unwrap_or(&error) {
            Value::String(message) => shown(message),
            other => shown(&other.to_string()),
        })?;
        let Value::Array(said) = result else {
            return Err(format!(
                "the result is {}, expected a list with one object per view",
                shown(&result.to_string())
            ));
        };
        if said.len() != views {
            return Err(format!("the result has {} entries for {views} views: one is expected for each", said.len()));
        }
        said.into_iter().enumerate().map(|(i, said)| verdict(said).map_err(|e| format!("result[{i}]: {e}"))).collect()
    }
}

fn verdict(said: Value) -> Result<Verdict, String> {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Said {
        reachable: bool,
        #[serde(default)]
        cost: Option<f64>,
        #[serde(default)]
        reason: Option<String>,
    }
    if !said.is_object() {
        return Err(format!("{}, expected an object with \"reachable\"", shown(&said.to_string())));
    }
    let Said { reachable, cost, reason } = serde_json::from_value(said).map_err(|e| e.to_string())?;
    Ok(match reachable {
        true => Verdict::Reachable { cost: cost.unwrap_or(0.0) },
        false => {
            Verdict::Unreachable { reason: reason.map_or_else(|| "not reachable".to_owned(), |reason| shown(&reason)) }
        }
    })
}

/// The beginning of what somebody wrote, on one line.
pub fn shown(text: &str) -> String {
    const MOST: usize = 200;
    let clean: String = text.trim().chars().map(|c| if c.is_control() { ' ' } else { c }).take(MOST + 1).collect();
    match clean.chars().count() > MOST {
        true => clean.chars().take(MOST).chain("...".chars()).collect(),
        false => clean,
    }
}

#[cfg(test)]
mod tests;
