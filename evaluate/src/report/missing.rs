//! What a run lacks of what was asked for.

use std::fmt;

/// How much of an interrupted run is still to be run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unfinished {
    /// Episodes that are not run yet.
    pub left: usize,
    /// Episodes that were asked for, of all policies and objects.
    pub asked: usize,
}

impl fmt::Display for Unfinished {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "unfinished: {} of {} episodes left", self.left, self.asked)
    }
}

/// What a run lacks, beside episodes that could not be run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Missing {
    /// What is left, if it was interrupted.
    pub unfinished: Option<Unfinished>,
    /// Objects that cannot be used, and why.
    pub unusable: Vec<(String, String)>,
    /// Objects that were asked for.
    pub objects: usize,
}

impl Missing {
    /// How many objects cannot be used; `None`: all can.
    pub fn unusable_objects(&self) -> Option<String> {
        let count = self.unusable.len();
        (count > 0).then(|| format!("{count} of {} objects could not be used", self.objects))
    }

    /// How the run ended, as `run.toml` says it.
    pub fn outcome(&self) -> String {
        let parts = match self.unfinished {
            None => [Some("finished".to_owned()), None, self.unusable_objects(), None],
            Some(unfinished) => [
                Some("stopped".to_owned()),
                Some(unfinished.to_string()),
                self.unusable_objects(),
                Some("the same command resumes".to_owned()),
            ],
        };
        parts.into_iter().flatten().collect::<Vec<_>>().join("; ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_end_of_a_run_says_what_it_lacks() {
        let unusable = vec![("a".to_owned(), "empty".to_owned()), ("b".to_owned(), "no file".to_owned())];
        let mut missing = Missing { unusable, objects: 4, ..Missing::default() };
        assert_eq!(missing.outcome(), "finished; 2 of 4 objects could not be used");
        missing.unfinished = Some(Unfinished { left: 3, asked: 9 });
        let stopped =
            "stopped; unfinished: 3 of 9 episodes left; 2 of 4 objects could not be used; the same command resumes";
        assert_eq!(missing.outcome(), stopped);
        assert_eq!(Missing::default().outcome(), "finished");
    }
}
