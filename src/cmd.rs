//! The verbs.

mod asked;
mod counting;
mod line;
pub(crate) mod list;
pub(crate) mod loopback;
pub(crate) mod read;

use crate::sys;
use anyhow::{Result, anyhow};

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

/// Where and how urgently this process runs.
pub(crate) fn schedule(cpu: Option<usize>, rt: Option<u8>) -> Result<()> {
    if let Some(cpu) = cpu {
        let said = |e| {
            anyhow!(
                "running on processor {cpu} only: {e}\n  `nproc` says how many there are, counted from 0"
            )
        };
        sys::pin_to_cpu(cpu).map_err(said)?;
    }
    if let Some(priority) = rt {
        let hint =
            format!("run as root, or allow it: `ulimit -r {priority}` and `ulimit -l unlimited`");
        let said = |e| anyhow!("asking for real-time priority {priority}: {e}\n  {hint}");
        sys::real_time(priority).map_err(said)?;
    }
    Ok(())
}
