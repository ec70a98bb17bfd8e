//! What `infer` shows a person: the answer as a page. Planning itself is the crate `planning`.

pub mod report;
