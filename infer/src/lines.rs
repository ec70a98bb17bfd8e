//! The service over stdin and stdout: one JSON request per line, one JSON answer per line, in order.

use crate::service::{Body, Method, Refusal, Service};
use serde::Deserialize;
use serde_json::{Value, json};
use std::io::{BufRead, Read, Write};

/// A request; `params` is the body that HTTP would carry.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Line {
    #[serde(default)]
    id: Value,
    method: Method,
    session: Option<String>,
    #[serde(default)]
    params: Value,
}

/// Answers until the input ends. A line that is not a request is answered with an error and `"id": null`.
///
/// # Errors
/// The input cannot be read or the output not written.
pub fn serve(service: &Service, mut input: impl BufRead, mut output: impl Write) -> std::io::Result<()> {
    let limit = service.limits().body;
    let mut line = Vec::new();
    loop {
        line.clear();
        if input.by_ref().take(limit as u64 + 1).read_until(b'\n', &mut line)? == 0 {
            return Ok(());
        }
        let answer = if line.len() > limit && line.last() != Some(&b'\n') {
            skip_line(&mut input)?;
            let message = format!("the line is longer than {} MiB", limit >> 20);
            with_id(Value::Null, Err(Refusal::new(413, "too_large", message)))
        } else if line.iter().all(u8::is_ascii_whitespace) {
            continue;
        } else {
            answer_line(service, &line)
        };
        serde_json::to_writer(&mut output, &answer)?;
        output.write_all(b"\n")?;
        output.flush()?;
    }
}

fn answer_line(service: &Service, line: &[u8]) -> Value {
    let request: Line = match serde_json::from_slice(line) {
        Ok(request) => request,
        Err(error) => {
            let refusal = Refusal::new(400, "bad_request", format!("the line is not a request: {error}"));
            return with_id(Value::Null, Err(refusal));
        }
    };
    // The service's locks recover from a panic; only this request is lost.
    let body = Body::Value(request.params);
    let handle = || service.handle(request.method, request.session.as_deref(), body, true);
    let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(handle)).unwrap_or_else(|_| {
        Err(Refusal::new(500, "internal", "this request failed inside the service; others are not affected"))
    });
    with_id(request.id, outcome)
}

fn with_id(id: Value, outcome: Result<Value, Refusal>) -> Value {
    match outcome {
        Ok(result) => json!({ "id": id, "result": result }),
        Err(refusal) => json!({ "id": id, "error": refusal.to_json()["error"] }),
    }
}

fn skip_line(input: &mut impl BufRead) -> std::io::Result<()> {
    loop {
        let buffer = input.fill_buf()?;
        let (used, done) = match buffer.iter().position(|b| *b == b'\n') {
            Some(end) => (end + 1, true),
            None => (buffer.len(), buffer.is_empty()),
        };
        input.consume(used);
        if done {
            return Ok(());
        }
    }
}
