//! What is wrong with a message.

/// A message that cannot be used, with what would do.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{message}: {place}: found {found}, expected {expected}")]
pub struct MessageError {
    /// Its type.
    pub message: &'static str,
    /// The field.
    pub place: String,
    /// What is there.
    pub found: String,
    /// What would do.
    pub expected: &'static str,
}

impl MessageError {
    pub(crate) fn new(
        message: &'static str,
        place: impl Into<String>,
        found: impl ToString,
        expected: &'static str,
    ) -> Self {
        Self { message, place: place.into(), found: found.to_string(), expected }
    }
}
