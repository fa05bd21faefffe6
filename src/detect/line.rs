//! What is on the line at all: BiSS-C, SSI, or nothing that lives.

use crate::trace::{Bits, Trace};

/// What the line looks like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// Nothing was seen yet.
    Unseen,
    /// Ack and start bit come as BiSS-C has them.
    Biss,
    /// The first clock carries data already: SSI, with so many bits at least.
    Ssi {
        /// Up to the last one that was ever 1.
        bits: usize,
    },
    /// High all the time: nobody answers.
    StuckHigh,
    /// Low all the time: no power, a short, or a pair swapped.
    StuckLow,
    /// Ack comes and stays: no start bit within the limit.
    NoStart,
    /// High and low without an order: nobody drives the line, or the clock is far too fast.
    Noise,
}

impl Line {
    /// Its name in records.
    pub fn name(self) -> &'static str {
        match self {
            Line::Unseen => "unseen",
            Line::Biss => "biss",
            Line::Ssi { .. } => "ssi",
            Line::StuckHigh => "stuck-high",
            Line::StuckLow => "stuck-low",
            Line::NoStart => "no-start",
            Line::Noise => "noise",
        }
    }
}

/// Counts what frames look like.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Watch {
    frames: u64,
    idle_low: u64,
    /// Low from before the first edge on, or not clocked because of that.
    low: u64,
    /// High at every edge.
    high: u64,
    /// High before the first edge, and low right after it.
    early: u64,
    /// High, low from some edge on, and nothing else.
    falls: u64,
    /// The last quarter of the bits is all alike.
    ends: u64,
    word: usize,
}

impl Watch {
    pub(super) fn see(&mut self, trace: &Trace) {
        let bits = &trace.bits;
        let idle_low = trace.idle == Some(false);
        let find = |at, level| bits.find(at, level);
        self.frames += 1;
        self.idle_low += u64::from(idle_low);
        self.low += u64::from((idle_low || bits.get(0) == Some(false)) && find(0, true).is_none());
        self.high += u64::from(!idle_low && !bits.is_empty() && find(0, false).is_none());
        self.early += u64::from(
            trace.idle == Some(true) && bits.get(0) == Some(false) && find(0, true).is_some(),
        );
        let fall = find(0, false).filter(|at| *at > 0);
        self.falls += u64::from(fall.is_some_and(|at| find(at, true).is_none()));
        let quarter = bits.len() - bits.len() / 4;
        let last = bits.get(bits.len().saturating_sub(1));
        self.ends += u64::from(last.is_some_and(|last| find(quarter, !last).is_none()));
        self.word = self.word.max(word_end(bits));
    }

    /// Where so many frames had an Ack and a start bit.
    pub(super) fn judge(&self, answered: u64) -> Line {
        let most = |count: u64| 10 * count >= 9 * self.frames;
        let some = |count: u64| count >= 2 && 20 * count >= self.frames;
        if self.frames == 0 {
            return Line::Unseen;
        }
        // BiSS-C leaves SL high until the second edge, whatever it sends.
        let calm = most(self.frames - self.idle_low) && most(self.ends);
        if some(self.early) && calm {
            return Line::Ssi { bits: self.word };
        }
        if 2 * answered >= self.frames {
            return Line::Biss;
        }
        match () {
            () if most(self.low) => Line::StuckLow,
            () if most(self.high) => Line::StuckHigh,
            () if most(self.falls) => Line::NoStart,
            () => Line::Noise,
        }
    }
}

/// Up to the last 1 that is followed by a 0.
fn word_end(bits: &Bits) -> usize {
    let zero = (0..bits.len())
        .rev()
        .find(|at| bits.get(*at) == Some(false));
    let one = zero.and_then(|zero| (0..zero).rev().find(|at| bits.get(*at) == Some(true)));
    one.map_or(0, |at| at + 1)
}
