//! Answers kept for repetition: a request whose answer was lost on the way is sent again with the same key, and gets the same
//! bytes, without being done twice.

use super::{Fingerprint, Method, Refusal, Reply};
use serde::{Deserialize, Serialize};
use serde_json::json;
use sha2::{Digest, Sha256};
use std::collections::VecDeque;

/// Answers kept at most; older ones are forgotten.
const ANSWERS: usize = 64;
/// The same in bytes; the newest is kept whatever its size.
const BYTES: usize = 4 << 20;
/// Larger answers are not kept on disk, bytes: views are, unlike scans, not harmed by being asked for again.
const ON_DISK: usize = 4 << 10;
/// Characters of a key at most.
const KEY: usize = 128;

/// What distinguishes a repeated request from a new one.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Key {
    name: String,
    /// SHA-256 of all that was asked, in hexadecimal digits; what older programs wrote is another hash, and the same as none of these.
    asked: String,
}

/// An answer on disk.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Kept {
    key: Key,
    status: u16,
    body: String,
}

impl Kept {
    /// An answer with its key.
    pub fn new(key: Key, reply: &Reply) -> Self {
        Self { key, status: reply.status, body: String::from_utf8_lossy(&reply.body).into_owned() }
    }
}

impl Key {
    /// A key as the client gives it, of this request with this body.
    ///
    /// # Errors
    /// No name.
    pub fn new(name: &str, method: Method, session: Option<&str>, body: &Fingerprint) -> Result<Self, Refusal> {
        let printable = name.bytes().all(|b| b.is_ascii_graphic());
        if name.is_empty() || name.len() > KEY || !printable {
            let message = format!("the idempotency key: expected 1 to {KEY} visible ASCII characters");
            return Err(Refusal::new(400, "bad_key", message));
        }
        let asked = Sha256::new().chain_update(json!([method, session]).to_string()).chain_update(body.bytes());
        Ok(Self { name: name.to_owned(), asked: format!("{:x}", asked.finalize()) })
    }
}

/// The newest answers with keys.
#[derive(Debug, Default)]
pub struct Answers {
    kept: VecDeque<(Key, Result<Reply, Refusal>)>,
    bytes: usize,
}

fn size(answer: &Result<Reply, Refusal>) -> usize {
    256 + answer.as_ref().map_or_else(|r| r.message.len(), |r| r.body.len())
}

impl Answers {
    /// Memory held, bytes.
    pub fn memory(&self) -> usize {
        self.bytes
    }

    /// The answer that this request got before.
    pub fn find(&self, key: Option<&Key>) -> Option<Result<Reply, Refusal>> {
        let key = key?;
        let (known, answer) = self.kept.iter().find(|(known, _)| known.name == key.name)?;
        if known.asked != key.asked {
            let message = format!("the key {:?} was used for another request: use a new one", key.name);
            return Some(Err(Refusal::new(409, "key_reused", message)));
        }
        Some(answer.clone())
    }

    /// The answers as they go to disk: small ones, of requests that changed something.
    pub fn to_disk(&self) -> Vec<Kept> {
        let small = |(key, answer): &(Key, Result<Reply, Refusal>)| {
            let reply = answer.as_ref().ok().filter(|reply| reply.body.len() <= ON_DISK)?;
            Some(Kept::new(key.clone(), reply))
        };
        self.kept.iter().filter_map(small).collect()
    }

    /// Answers that were on disk.
    pub fn from_disk(kept: Vec<Kept>) -> Self {
        let mut answers = Self::default();
        for Kept { key, status, body } in kept {
            answers.keep(Some(key), &Ok(Reply::new(status, body)));
        }
        answers
    }

    /// Keeps an answer, unless asking again may bring another.
    pub fn keep(&mut self, key: Option<Key>, answer: &Result<Reply, Refusal>) {
        let Some(key) = key else { return };
        if answer.as_ref().is_err_and(Refusal::is_passing) {
            return;
        }
        self.bytes += size(answer);
        self.kept.push_back((key, answer.clone()));
        while self.kept.len() > ANSWERS || (self.bytes > BYTES && self.kept.len() > 1) {
            self.bytes -= self.kept.pop_front().map_or(0, |(_, answer)| size(&answer));
        }
    }
}

#[cfg(test)]
mod tests;
