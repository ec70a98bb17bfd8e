//! One account of what requests, sessions and answers hold together.

use super::Refusal;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::sleep;

/// How often who waits for memory looks for it.
const LOOK: Duration = Duration::from_millis(5);

/// The account, in KiB.
#[derive(Clone, Debug)]
pub struct Memory {
    free: Arc<Semaphore>,
    total_kib: usize,
}

/// A part of the account, given back when dropped.
#[derive(Debug)]
pub struct Held {
    memory: Memory,
    permit: Option<OwnedSemaphorePermit>,
}

impl Memory {
    /// Nothing held yet.
    pub fn new(mib: usize) -> Self {
        let total_kib = mib << 10;
        Self { free: Arc::new(Semaphore::new(total_kib)), total_kib }
    }

    /// What is held, bytes.
    pub fn used(&self) -> usize {
        (self.total_kib - self.free.available_permits()) << 10
    }

    /// A part of no size.
    pub fn nothing(&self) -> Held {
        Held { memory: self.clone(), permit: None }
    }

    /// A part of this size.
    ///
    /// # Errors
    /// There is not so much left.
    pub fn take(&self, bytes: usize) -> Result<Held, Refusal> {
        let mut held = self.nothing();
        held.resize(bytes)?;
        Ok(held)
    }

    /// Why nothing more is lent.
    pub fn full(&self) -> Refusal {
        let message = format!(
            "requests and sessions hold {} of {} MiB (service.memory_mib): delete finished sessions, or try again",
            self.used() >> 20,
            self.total_kib >> 10
        );
        Refusal::new(507, "memory_full", message)
    }
}

impl Held {
    /// Bytes.
    pub fn size(&self) -> usize {
        self.permit.as_ref().map_or(0, |p| p.num_permits() << 10)
    }

    fn missing(&self, bytes: usize) -> u32 {
        u32::try_from(bytes.div_ceil(1024).saturating_sub(self.size() >> 10)).unwrap_or(u32::MAX >> 4)
    }

    fn add(&mut self, more: OwnedSemaphorePermit) {
        match &mut self.permit {
            Some(permit) => permit.merge(more),
            None => self.permit = Some(more),
        }
    }

    /// Makes it this large.
    ///
    /// # Errors
    /// There is not so much left: the size stays.
    pub fn resize(&mut self, bytes: usize) -> Result<(), Refusal> {
        let more = self.missing(bytes);
        if more > 0 {
            let more = self.memory.free.clone().try_acquire_many_owned(more).map_err(|_| self.memory.full())?;
            self.add(more);
        }
        self.shrink(bytes);
        Ok(())
    }

    /// At least this large.
    ///
    /// # Errors
    /// There is not so much left: the size stays.
    pub fn cover(&mut self, bytes: usize) -> Result<(), Refusal> {
        if self.missing(bytes) > 0 { self.resize(bytes) } else { Ok(()) }
    }

    /// At least this large, as soon as others have given back enough. Nobody queues: who needs little passes by who waits for
    /// much.
    pub async fn grow(&mut self, bytes: usize) {
        while self.cover(bytes).is_err() {
            sleep(LOOK).await;
        }
    }

    /// At most this large.
    pub fn shrink(&mut self, bytes: usize) {
        let (size, wanted) = (self.size() >> 10, bytes.div_ceil(1024));
        if let Some(permit) = &mut self.permit {
            drop(permit.split(size.saturating_sub(wanted)));
        }
    }

    /// Takes over what another holds.
    pub fn absorb(&mut self, mut other: Self) {
        if let Some(more) = other.permit.take() {
            self.add(more);
        }
    }
}

#[cfg(test)]
mod tests;
