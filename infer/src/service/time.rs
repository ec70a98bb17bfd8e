//! How long a request may take, and when the service stops.

use super::Refusal;
use planning::{Budget, Left};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Set once, seen by all who share it.
#[derive(Clone, Debug, Default)]
pub struct Flag(Arc<AtomicBool>);

impl Flag {
    /// Sets it.
    pub fn set(&self) {
        self.0.store(true, Ordering::SeqCst);
    }

    /// Whether it is set.
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::SeqCst)
    }

    /// Sets it when what is returned is dropped.
    pub fn set_on_drop(&self) -> SetOnDrop {
        SetOnDrop(self.clone())
    }
}

/// [`Flag::set_on_drop`].
pub struct SetOnDrop(Flag);

impl Drop for SetOnDrop {
    fn drop(&mut self) {
        self.0.set();
    }
}

/// What to do when the deadline passes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OnDeadline {
    /// Refuse.
    #[default]
    Error,
    /// Answer with the best view of those scored so far.
    Best,
}

/// A request's time.
#[derive(Clone, Debug)]
pub struct Patience {
    arrived: Instant,
    end: Instant,
    /// The client has hung up.
    pub gone: Flag,
    /// The service waits for nothing any longer.
    pub halted: Flag,
}

impl Patience {
    /// From now on for so long.
    pub fn new(time: Duration, halted: &Flag) -> Self {
        let arrived = Instant::now();
        Self { arrived, end: arrived + time, gone: Flag::default(), halted: halted.clone() }
    }

    /// As the request asks, counted from its arrival.
    ///
    /// # Errors
    /// A time out of range.
    pub fn set(&mut self, asked_ms: Option<u64>, most_ms: u64) -> Result<(), Refusal> {
        let Some(asked) = asked_ms else { return Ok(()) };
        if !(1..=most_ms).contains(&asked) {
            return Err(Refusal::new(400, "bad_deadline", format!("deadline_ms = {asked}: expected 1 to {most_ms}")));
        }
        self.end = self.arrived + Duration::from_millis(asked);
        Ok(())
    }

    /// When it ends.
    pub fn end(&self) -> Instant {
        self.end
    }

    /// For the planners.
    pub fn budget(&self, on_deadline: OnDeadline) -> Budget {
        let Self { end, gone, halted, .. } = self.clone();
        let budget = Budget::new(move || match () {
            () if gone.is_set() || halted.is_set() => Left::Nobody,
            () if Instant::now() >= end => Left::Nothing,
            () => Left::Time,
        });
        if on_deadline == OnDeadline::Best { budget.or_best() } else { budget }
    }
}
