//! The verbs.

mod asked;
mod auto;
mod bank;
mod beside;
pub(crate) mod capture;
pub(crate) mod command;
mod counting;
pub(crate) mod detect;
pub(crate) mod info;
mod line;
pub(crate) mod list;
pub(crate) mod loopback;
mod overheard;
mod poll;
pub(crate) mod read;
pub(crate) mod reg;
mod saved;
pub(crate) mod scope;
mod session;
pub(crate) mod stats;
mod talk;
pub(crate) mod watch;
mod why;

use crate::cli::{self, ReportFormat};
use crate::output::answer;
use crate::output::reg::Effort;
use crate::sys;
use anyhow::{Result, anyhow};
use std::io::ErrorKind;

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

/// As a shell takes it for one word.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "_./:=,+%@-".contains(c);
    match !word.is_empty() && word.chars().all(plain) {
        true => word.into(),
        false => format!("'{}'", word.replace('\'', r"'\''")),
    }
}

/// Writes records. Whoever reads may have enough.
fn deliver(text: &str) -> Result<()> {
    match answer(text) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(anyhow!(
            "writing records: {error}\n  make room, or write elsewhere"
        )),
        _ => Ok(()),
    }
}

/// What it took, where somebody wants to know it, or ought to.
fn sum_up(wire: &cli::Wire, format: ReportFormat, effort: Option<Effort>, answered: bool) {
    let tells = |effort: &Effort| wire.verbose || answered && effort.is_uneven();
    if let Some(effort) = effort.filter(|effort| !wire.quiet && tells(effort)) {
        effort.print(format);
    }
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

#[cfg(test)]
mod tests {
    use super::quoted;

    #[test]
    fn a_link_is_one_word_for_a_shell() {
        assert_eq!(
            quoted("sim:ack=3,frame=st8,crc6:0x43:plain"),
            "sim:ack=3,frame=st8,crc6:0x43:plain"
        );
        assert_eq!(quoted("exec:vvp x.vvp"), "'exec:vvp x.vvp'");
        assert_eq!(quoted("file:it's"), r"'file:it'\''s'");
    }
}
