//! The verbs.

mod counting;
pub(crate) mod list;
pub(crate) mod read;

/// How a command ended, as the shell sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// Everything asked for was delivered.
    Good,
    /// The wire answered badly, or not at all.
    Bad,
}

/// A command's end, and the signal that brought it about.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ended {
    pub(crate) outcome: Outcome,
    pub(crate) signal: Option<i32>,
}
