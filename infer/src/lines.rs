//! The service over stdin and stdout: one JSON request per line, one JSON answer per line, in order. A request may ask to be asked
//! itself: which of its views its client can take.

use crate::check::{Answered, LOOK as ANSWER_LOOK, question, shown};
use crate::direct;
use crate::request::{Body, Object};
use crate::service::{BoundedJson, Fingerprint, Key, Method, Refusal, Reply, Service};
use planning::Budget;
use planning::session::{AskedView, Verdict, ViewCheck};
use serde::Deserialize;
use serde::de::IntoDeserializer;
use serde::de::value::Error as NameError;
use serde_json::Value;
use std::io::{BufRead, Error, Read, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

/// How often the service looks whether it shall stop.
const LOOK: Duration = Duration::from_millis(50);

/// A request without what `params`, the body that HTTP would carry, says.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Line {
    #[serde(default)]
    id: BoundedJson,
    method: String,
    session: Option<String>,
    /// The same again is answered as before and not done twice.
    request_id: Option<String>,
    #[serde(default)]
    params: Fingerprint,
}

/// What a line that is no request may still say.
#[derive(Deserialize)]
struct Id {
    id: BoundedJson,
}

/// A line, or that it was longer than allowed.
type Received = Result<Vec<u8>, usize>;

/// Who writes requests and reads answers.
pub struct Client {
    talk: Mutex<Talk>,
    limit: usize,
}

struct Talk {
    received: Receiver<Result<Received, Error>>,
    /// A line that came where an answer was expected.
    put_back: Option<Received>,
    output: Box<dyn Write + Send>,
    /// Questions so far.
    asked: u64,
}

impl Client {
    /// With lines of at most `limit` bytes.
    pub fn new(input: impl BufRead + Send + 'static, output: impl Write + Send + 'static, limit: usize) -> Self {
        // Reading waits for the client, and the client may not write for hours: it is left behind when the service stops.
        let (lines, received) = sync_channel(0);
        thread::spawn(move || {
            let mut input = input;
            while let Some(line) = read_line(&mut input, limit).transpose() {
                if lines.send(line).is_err() {
                    return;
                }
            }
        });
        let talk = Talk { received, put_back: None, output: Box::new(output), asked: 0 };
        Self { talk: Mutex::new(talk), limit }
    }

    fn talk(&self) -> MutexGuard<'_, Talk> {
        self.talk.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Its word on views, where a request wants that asked.
    pub fn check(self: &Arc<Self>) -> ViewCheck {
        let client = Arc::clone(self);
        ViewCheck::new(move |views, budget| client.talk().ask(views, budget))
    }

    fn write(&self, id: &Value, answer: Result<Reply, Refusal>) -> Result<(), Error> {
        let output = &mut self.talk().output;
        write!(output, "{{\"id\":{id},")?;
        match answer {
            Ok(reply) => {
                output.write_all(b"\"result\":")?;
                output.write_all(&reply.body)?;
            }
            Err(refusal) => write!(output, "\"error\":{}", refusal.to_json()["error"])?,
        }
        output.write_all(b"}\n")?;
        output.flush()
    }
}

impl Talk {
    fn next(&mut self, wait: Duration) -> Result<Result<Received, Error>, RecvTimeoutError> {
        self.put_back.take().map_or_else(|| self.received.recv_timeout(wait), |line| Ok(Ok(line)))
    }

    /// Asks of views, and waits for the answer, which is the next line.
    fn ask(&mut self, views: &[AskedView], budget: &Budget) -> Result<Vec<Verdict>, String> {
        self.asked += 1;
        let line = question(self.asked, views);
        self.output.write_all(&line).and_then(|()| self.output.flush()).map_err(|e| format!("stdout: {e}"))?;
        while !budget.is_spent() {
            let line = match self.next(ANSWER_LOOK) {
                Ok(Ok(line)) => line,
                Ok(Err(error)) => return Err(format!("stdin: {error}")),
                Err(RecvTimeoutError::Timeout) => continue,
                Err(RecvTimeoutError::Disconnected) => {
                    return Err("the client closed its end instead of answering".to_owned());
                }
            };
            match line.as_deref().ok().and_then(Answered::parse) {
                Some(answered) if answered.number == self.asked => return answered.verdicts(views.len()),
                // To a question that was given up.
                Some(answered) if answered.number < self.asked => {}
                _ if line.as_ref().is_ok_and(|line| line.iter().all(u8::is_ascii_whitespace)) => {}
                _ => {
                    let text = line.as_ref().map_or_else(
                        |limit| format!("a line of more than {} MiB", limit >> 20),
                        |line| format!("{:?}", shown(&String::from_utf8_lossy(&line[..line.len().min(1000)]))),
                    );
                    // It is answered in its turn.
                    self.put_back = Some(line);
                    let id = self.asked;
                    return Err(format!(
                        "the answer to check_views was expected, {{\"id\": \"check-{id}\", \"result\": [...]}}, and {text} came"
                    ));
                }
            }
        }
        Err("no time is left to answer".to_owned())
    }
}

/// Answers until the input ends or `stop` is set; what runs then is answered first, as far as it takes no longer than
/// `service.stop_ms`. A line that is not a request is answered with an error, and its id where it has one.
///
/// # Errors
/// The input cannot be read or the output not written.
pub fn serve(service: &Service, client: &Client, stop: &'static AtomicBool) -> Result<(), Error> {
    let halted = service.halted.clone();
    let grace = Duration::from_millis(service.limits().stop_ms);
    thread::spawn(move || {
        while !stop.load(Ordering::SeqCst) {
            thread::sleep(LOOK);
        }
        thread::sleep(grace);
        halted.set();
    });
    while !stop.load(Ordering::SeqCst) {
        let line = match client.talk().next(LOOK) {
            Ok(line) => line?,
            Err(RecvTimeoutError::Timeout) => continue,
            Err(RecvTimeoutError::Disconnected) => return Ok(()),
        };
        let (id, answer) = match line {
            Ok(line) if line.iter().all(u8::is_ascii_whitespace) => continue,
            // To a question that was given up.
            Ok(line) if Answered::parse(&line).is_some() => continue,
            Ok(line) => answer_line(service, &line),
            Err(_) => {
                let message = format!(
                    "the line is longer than {} MiB: thin the scan, or raise service.body_mib",
                    client.limit >> 20
                );
                (Value::Null, Err(Refusal::new(413, "too_large", message)))
            }
        };
        client.write(&id, answer)?;
    }
    Ok(())
}

fn answer_line(service: &Service, line: &[u8]) -> (Value, Result<Reply, Refusal>) {
    let request: Line = match serde_json::from_slice(line) {
        Ok(Object(request)) => request,
        Err(error) => {
            let id = serde_json::from_slice::<Object<Id>>(line).map_or(Value::Null, |id| id.0.id.0);
            return (id, Err(Refusal::new(400, "bad_request", format!("the line is not a request: {error}"))));
        }
    };
    // The service's locks recover from a panic; only this request is lost.
    let outcome = catch_unwind(AssertUnwindSafe(|| handle(service, &request, line)));
    (request.id.0, outcome.unwrap_or_else(|_| Err(Refusal::internal())))
}

fn handle(service: &Service, request: &Line, line: &[u8]) -> Result<Reply, Refusal> {
    let named = Method::deserialize(IntoDeserializer::<NameError>::into_deserializer(request.method.as_str()));
    let method = named.map_err(|e| Refusal::new(400, "bad_request", format!("method: {e}")))?;
    let session = request.session.as_deref();
    let key = request.request_id.as_ref().map(|name| Key::new(name, method, session, &request.params)).transpose()?;
    direct::answer(service, method, session, Body::Line(line), key)
}

/// The next line; `None` at the end of the input.
fn read_line(input: &mut impl BufRead, limit: usize) -> Result<Option<Received>, Error> {
    let mut line = Vec::new();
    if input.by_ref().take(limit as u64 + 1).read_until(b'\n', &mut line)? == 0 {
        return Ok(None);
    }
    if line.len() > limit && line.last() != Some(&b'\n') {
        drop(line);
        skip_line(input)?;
        return Ok(Some(Err(limit)));
    }
    Ok(Some(Ok(line)))
}

fn skip_line(input: &mut impl BufRead) -> Result<(), Error> {
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
