//! Requests answered on the thread that makes them: lines of stdin, services of ROS 2.

use crate::request::{Ask, Body};
use crate::service::{Key, Method, Refusal, Reply, Service, reading};

/// The answer to a request. Over a line, scans may be given as files.
///
/// # Errors
/// Why it is refused.
pub fn answer(
    service: &Service,
    method: Method,
    session: Option<&str>,
    body: Body,
    key: Option<Key>,
) -> Result<Reply, Refusal> {
    let mut patience = service.patience();
    match method {
        Method::Health => return service.health(),
        Method::List => return service.list(),
        Method::Delete => {
            let entry = service.entry(session).ok();
            let mut open = entry.as_ref().map(|entry| entry.open.blocking_lock());
            return service.delete(session.unwrap_or_default(), open.as_deref_mut(), key);
        }
        _ => {}
    }
    let (bytes, may_read_files) = match body {
        Body::Whole(bytes) => (bytes.len(), false),
        Body::Line(bytes) => (bytes.len(), true),
    };
    let mut spare = service.memory().take(bytes + reading(method, bytes))?;
    let ask = Ask::parse(method, body, may_read_files, service.keeps_state())?;
    patience.set(ask.deadline_ms(), service.limits().max_deadline_ms)?;
    if let Ask::Create(request) = ask {
        return service.create(request, key);
    }
    spare.resize(bytes + ask.work())?;
    let entry = service.entry(session)?;
    let mut open = entry.open.blocking_lock();
    service.work(&entry, &mut open, ask, key, &patience, spare)
}
