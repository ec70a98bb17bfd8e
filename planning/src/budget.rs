//! How long a request may take, and whether anybody still waits for its answer.

use std::sync::Arc;

/// What is left of a request's time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Left {
    /// Some.
    Time,
    /// None: the deadline has passed.
    Nothing,
    /// Nobody waits any longer.
    Nobody,
}

/// Asked between scans, views and candidates whether to continue. Unlimited by default. The clock is the caller's.
#[derive(Clone, Default)]
pub struct Budget {
    left: Option<Arc<dyn Fn() -> Left + Send + Sync>>,
    best: bool,
}

impl std::fmt::Debug for Budget {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Budget({:?})", self.left())
    }
}

impl Budget {
    /// As `left` says whenever it is asked, which is often.
    pub fn new(left: impl Fn() -> Left + Send + Sync + 'static) -> Self {
        Self { left: Some(Arc::new(left)), best: false }
    }

    /// The same, where at the deadline the best so far is an answer.
    #[must_use]
    pub fn or_best(self) -> Self {
        Self { best: true, ..self }
    }

    fn left(&self) -> Left {
        self.left.as_ref().map_or(Left::Time, |left| left())
    }

    /// Whether it can end at all.
    pub fn is_limited(&self) -> bool {
        self.left.is_some()
    }

    /// Whether to stop looking for more.
    pub fn is_spent(&self) -> bool {
        self.left() != Left::Time
    }

    /// Whether what there is may be answered: with time left, and after that where the best so far will do and there is one.
    ///
    /// # Errors
    /// Why not.
    pub fn allows(&self, has_some: bool) -> Result<(), Stopped> {
        match self.left() {
            Left::Time => Ok(()),
            Left::Nothing if self.best && has_some => Ok(()),
            Left::Nothing => Err(Stopped::Late),
            Left::Nobody => Err(Stopped::Cancelled),
        }
    }
}

/// Why work ended before it was done; nothing came of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Stopped {
    /// It took too long.
    #[error(
        "the deadline passed before the answer was found: allow more time, or ask for less (fewer max_points, fewer \
         working_distance_steps)"
    )]
    Late,
    /// Nobody waits for it.
    #[error("cancelled")]
    Cancelled,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_late_and_not_empty_is_the_best_so_far() {
        let of = |left| Budget::new(move || left);
        assert_eq!(Budget::default().allows(false), Ok(()), "unlimited");
        assert_eq!(of(Left::Time).allows(false), Ok(()));
        assert_eq!(of(Left::Nothing).allows(true), Err(Stopped::Late), "not asked for the best so far");
        assert_eq!(of(Left::Nothing).or_best().allows(true), Ok(()));
        assert_eq!(of(Left::Nothing).or_best().allows(false), Err(Stopped::Late), "there is none");
        assert_eq!(of(Left::Nobody).or_best().allows(true), Err(Stopped::Cancelled), "nobody waits for it");
    }
}
