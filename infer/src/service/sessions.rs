//! The sessions by name, created and ended. Who does that waits for the disk, and nobody else for him.

use super::answers::Kept;
use super::store::{Record, StoreError};
use super::{Answers, Entry, Key, Open, Refusal, Reply, Service, Store, check, lock, unknown};
use crate::request::{CreateRequest, over};
use serde_json::json;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// The open sessions.
#[derive(Default)]
pub struct Sessions {
    /// The last name that was given.
    last: u64,
    /// By name.
    pub open: BTreeMap<u64, Arc<Entry>>,
    /// To those who opened or ended a session.
    answers: Answers,
}

impl Sessions {
    /// None yet, where there were some.
    pub fn known(last: u64, answers: Answers) -> Self {
        Self { last, open: BTreeMap::new(), answers }
    }

    /// Names, in the order in which they were opened.
    pub fn names(&self) -> Vec<String> {
        self.open.keys().map(u64::to_string).collect()
    }

    /// Refuses one more than `most`.
    fn room(&self, most: usize) -> Result<(), Refusal> {
        if self.open.len() < most {
            return Ok(());
        }
        let longest = self.open.iter().map(|(id, e)| (*lock(&e.used), id)).min();
        let longest = longest
            .map_or(String::new(), |(used, id)| format!(" (longest unused: {id}, for {} s)", used.elapsed().as_secs()));
        let message = format!("{most} sessions are open, which is the maximum: delete finished ones{longest}");
        Err(Refusal::new(429, "too_many_sessions", message))
    }
}

impl Service {
    /// A new session.
    ///
    /// # Errors
    /// Bad settings, or too many sessions.
    pub fn create(&self, request: CreateRequest, key: Option<Key>) -> Result<Reply, Refusal> {
        self.create_with(request, key, Store::create)
    }

    fn create_with(
        &self,
        request: CreateRequest,
        key: Option<Key>,
        write: impl FnOnce(&Store, u64, &Record, Vec<Kept>) -> Result<(), StoreError>,
    ) -> Result<Reply, Refusal> {
        let _turn = lock(&self.turn);
        if let Some(known) = lock(&self.sessions).answers.find(key.as_ref()) {
            return known;
        }
        let answer = self.open(request, key.as_ref(), write);
        lock(&self.sessions).answers.keep(key, &answer);
        answer
    }

    /// Opens a session, in the caller's turn.
    fn open(
        &self,
        request: CreateRequest,
        key: Option<&Key>,
        write: impl FnOnce(&Store, u64, &Record, Vec<Kept>) -> Result<(), StoreError>,
    ) -> Result<Reply, Refusal> {
        let config = over(&self.config, request.config)?;
        check(&config)?;
        lock(&self.sessions).room(self.limits.sessions)?;
        let open = Open::empty(config, self.network.clone(), &self.memory)?;
        let (id, answers) = {
            let mut sessions = lock(&self.sessions);
            sessions.last += 1;
            (sessions.last, sessions.answers.to_disk())
        };
        let reply = Reply { status: 201, ..Reply::of(&json!({ "session": id.to_string() }))? };
        let open = open.created_by(key.map(|key| Kept::new(key.clone(), &reply)));
        if let Some(store) = &self.store {
            write(store, id, &open.record(), answers)?;
        }
        let mut sessions = lock(&self.sessions);
        sessions.open.insert(id, Arc::new(Entry::new(id, open, 0)));
        self.count.store(sessions.open.len(), Ordering::Relaxed);
        Ok(reply)
    }

    /// The session that was opened first; a new one where there is none.
    ///
    /// # Errors
    /// As [`Service::create`].
    pub fn first(&self) -> Result<Arc<Entry>, Refusal> {
        let first = || lock(&self.sessions).open.values().next().cloned();
        if let Some(first) = first() {
            return Ok(first);
        }
        let _turn = lock(&self.turn);
        if first().is_none() {
            self.open(CreateRequest::default(), None, Store::create)?;
        }
        first().ok_or_else(Refusal::internal)
    }

    /// Ends a session, whose lock the caller holds: who worked on it has ended his request, and who waits for it finds it gone.
    /// `open` is none where there is no such session: then the request may be one that was answered before.
    ///
    /// # Errors
    /// There is none of this name, or it cannot be removed from disk.
    pub fn delete(&self, name: &str, open: Option<&mut Open>, key: Option<Key>) -> Result<Reply, Refusal> {
        self.delete_with(name, open, key, |store, id, answers| match answers {
            Some((last, answers)) => store.delete(id, last, answers),
            None => store.remove(id),
        })
    }

    /// `remove` takes a session from the disk, with the last name that was given and all answers where there is one to keep.
    fn delete_with(
        &self,
        name: &str,
        open: Option<&mut Open>,
        key: Option<Key>,
        remove: impl FnOnce(&Store, u64, Option<(u64, Vec<Kept>)>) -> Result<(), StoreError>,
    ) -> Result<Reply, Refusal> {
        let _turn = lock(&self.turn);
        let (id, last, mut answers) = {
            let sessions = lock(&self.sessions);
            if let Some(known) = sessions.answers.find(key.as_ref()) {
                return known;
            }
            let id = name.parse::<u64>().ok().filter(|id| sessions.open.contains_key(id));
            (id, sessions.last, sessions.answers.to_disk())
        };
        let answer = id.zip(open).ok_or_else(|| unknown(name)).and_then(|(id, open)| {
            let reply = Reply::of(&json!({ "deleted": name }))?;
            if let Some(store) = &self.store {
                let told = key.as_ref().map(|key| {
                    answers.push(Kept::new(key.clone(), &reply));
                    (last, answers)
                });
                remove(store, id, told)?;
            }
            open.end();
            let mut sessions = lock(&self.sessions);
            sessions.open.remove(&id);
            self.count.store(sessions.open.len(), Ordering::Relaxed);
            Ok(reply)
        });
        lock(&self.sessions).answers.keep(key, &answer);
        answer
    }
}

#[cfg(test)]
mod tests;
