//! Frames that began anew between two bytes of a transfer, where nobody sees MA stand still.

use super::samples::Sample;
use crate::cycle::Head;
use crate::format::Format;
use crate::frame;
use crate::trace::Bits;

/// So much evidence is no chance.
const CERTAIN_BITS: u32 = 30;

/// What is compared behind the start bit at most: CDS, and the high bits of a position that has hardly moved.
const BEHIND: usize = 8;

/// Frames that failed, and those of them that began anew.
#[derive(Clone, Debug, Default)]
pub(super) struct Restarts {
    pub(super) frames: u64,
    evidence: u32,
    /// The first byte before which one did.
    pub(super) byte: usize,
}

impl Restarts {
    /// A frame that failed, and what the one before it said if it was good.
    pub(super) fn look(&mut self, sample: &Sample, format: &Format, good: Option<(Head, &[u64])>) {
        let Some(start_at) = sample.start_at() else {
            return;
        };
        // As sampled: the idle level, then the bits.
        let level = |at: usize| match at {
            0 => sample.idle,
            _ => sample.bits.get(at - 1),
        };
        let expected = good.map(|(head, words)| {
            let mut bits = Bits::default();
            frame::emit(format, head, words, &mut bits);
            bits
        });
        let head = start_at + 2;
        let samples = sample.bits.len() + 1;
        let (mut evidence, mut everywhere) = (0, samples >= 32);
        for begin in (8..samples).step_by(8) {
            let long = begin.min(samples - begin).min(head + BEHIND);
            let again = (0..long).all(|at| level(begin + at) == level(at));
            // Data that only look so would have done so in the good frame.
            let looks = expected
                .as_ref()
                .is_some_and(|bits| (0..long).all(|at| bits.get(begin + at - 1) == level(at)));
            everywhere &= again || long < head;
            if long >= head && again && !looks {
                // That there are several places takes some of it away.
                let places = (samples / 8).max(1).ilog2() + 1;
                evidence += (long as u32).saturating_sub(places);
                if self.byte == 0 {
                    self.byte = begin / 8;
                }
            }
        }
        // Without a good frame to compare with, only what all bytes do alike is no matter of the data.
        if evidence > 0 && (expected.is_some() || everywhere) {
            self.frames += 1;
            self.evidence = self.evidence.saturating_add(evidence);
        }
    }

    /// They are so often and so clear, among so many that failed, that it is no chance.
    pub(super) fn are_certain(&self, failed: u64) -> bool {
        let ways = (failed.max(self.frames) as f64 / self.frames.max(1) as f64).log2() + 1.5;
        let chance = self.frames as f64 * ways;
        self.frames >= 3 && f64::from(self.evidence) >= f64::from(CERTAIN_BITS) + chance
    }
}
