//! The waist: what MA shall do for one cycle, and what SLO said.
//!
//! Numbering, once and for all: bit 0 of a [`Trace`] is the SL level set by rising MA edge 1 (LAT), so a frame
//! reads `1 0…0 1 CDS data… CRC 0`. Edges count from 1. The level before the first edge is a field of its own.

use crate::waveform::Waveform;
use std::fmt;

/// Most rising edges one cycle can hold: eight full channels, both search limits at 10 MHz, and room.
pub const MAX_CLOCKS: usize = 2048;

const WORDS: usize = MAX_CLOCKS / 64;

/// A bit string of at most [`MAX_CLOCKS`] bits that never allocates. Bit 0 is the first on the wire.
#[derive(Clone, Debug)]
pub struct Bits {
    words: [u64; WORDS],
    len: u16,
}

impl Default for Bits {
    fn default() -> Bits {
        Bits {
            words: [0; WORDS],
            len: 0,
        }
    }
}

impl Bits {
    /// Forgets all bits.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Number of bits.
    pub fn len(&self) -> usize {
        usize::from(self.len)
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Adds a bit at the end; beyond [`MAX_CLOCKS`] it is dropped.
    pub fn push(&mut self, bit: bool) {
        let at = self.len();
        if at == MAX_CLOCKS {
            return;
        }
        let mask = 1u64 << (63 - at % 64);
        if bit {
            self.words[at / 64] |= mask
        } else {
            self.words[at / 64] &= !mask
        }
        self.len += 1;
    }

    /// The bit at `at`, `None` past the end.
    pub fn get(&self, at: usize) -> Option<bool> {
        (at < self.len()).then(|| self.words[at / 64] >> (63 - at % 64) & 1 == 1)
    }

    /// `n` (0 to 64) bits from `at`, the first one most significant; `None` past the end.
    pub fn word(&self, at: usize, n: usize) -> Option<u64> {
        if n > 64 || at + n > self.len() {
            return None;
        }
        if n == 0 {
            return Some(0);
        }
        let (word, offset) = (at / 64, at % 64);
        let high = self.words[word] << offset;
        let low = match offset {
            0 => 0,
            _ if word + 1 < WORDS => self.words[word + 1] >> (64 - offset),
            _ => 0,
        };
        Some((high | low) >> (64 - n))
    }

    /// The first bit at or after `at` that is `level`.
    pub fn find(&self, mut at: usize, level: bool) -> Option<usize> {
        while at < self.len() {
            let n = (self.len() - at).min(64);
            let chunk = self.word(at, n)? << (64 - n);
            let run = if level {
                chunk.leading_zeros()
            } else {
                chunk.leading_ones()
            } as usize;
            if run < n {
                return Some(at + run);
            }
            at += n;
        }
        None
    }

    /// All bits, first to last.
    pub fn iter(&self) -> impl Iterator<Item = bool> + '_ {
        (0..self.len()).filter_map(|at| self.get(at))
    }
}

impl fmt::Display for Bits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.iter()
            .try_for_each(|bit| f.write_str(if bit { "1" } else { "0" }))
    }
}

impl Extend<bool> for Bits {
    fn extend<T: IntoIterator<Item = bool>>(&mut self, bits: T) {
        bits.into_iter().for_each(|bit| self.push(bit));
    }
}

/// How many clocks, decided while they run where the link can, planned where it cannot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Until {
    /// Exactly so many rising edges.
    Clocks(u16),
    /// Search Ack, then start, then clock on.
    Frame {
        /// Most clocks from edge 2 to the edge that sets Ack.
        ack: u16,
        /// Most clocks from the Ack edge to the start edge.
        start: u16,
        /// Rising edges after the start edge, the stop bit's included.
        then: u16,
    },
}

/// One clocked cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clocks {
    /// When to stop.
    pub until: Until,
    /// Clocks that must be sampled after the frame, on links that plan their clocks.
    pub surplus: u16,
    /// First low, high and low level together; 0 leaves them as long as all others. Only for slaves known to
    /// be adaptive.
    pub stretch_ns: u32,
    /// CDM as a function of the CDS of this very frame: `cdm[cds]`. Equal entries are decided beforehand.
    pub cdm: [bool; 2],
    /// How long MA keeps CDM = 1: until SL = 1, at most this long.
    pub hold_ns: u32,
    /// How long SL = 1 is awaited before the first edge, counted from the last MA edge; `None` does not look
    /// (INIT). Links that cannot see SL wait that long.
    pub ready_ns: Option<u32>,
    /// The frame is left before its stop bit, so SL = 1 after it may be a data bit that is still under way.
    pub partial: bool,
}

/// When, on the link's own clock, and what.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ask {
    /// Not before this time.
    pub at_ns: u64,
    /// The cycle.
    pub clocks: Clocks,
}

/// An MA level or a rise-to-rise time, bounded from above, and the rising edge that ended it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Level {
    /// Upper bound of its length.
    pub ns: u32,
    /// The rising edge that ended it, or the last one before it where none did.
    pub edge: u16,
}

/// What came back from one cycle. Caller-owned and reused; `None` means the link cannot know.
#[derive(Clone, Debug, Default)]
pub struct Trace {
    /// Start of the cycle on the link's clock.
    pub t_ns: u64,
    /// SL levels; bit 0 belongs to rising edge 1. Empty when the cycle did not run because SL stayed 0.
    /// A link that does not sample LAT repeats the idle level there.
    pub bits: Bits,
    /// SL before the first edge.
    pub idle: Option<bool>,
    /// How long SL had been awaited when the cycle started or was given up.
    pub waited_ns: Option<u64>,
    /// CDM as sent, or as seen in a recording.
    pub cdm: Option<bool>,
    /// MA period: measured where edges are timed, else the link's clock.
    pub ma_period_ns: Option<u32>,
    /// Longest MA level or rise-to-rise time.
    pub longest: Option<Level>,
    /// With a line delay of whole clocks, bits are under way while MA goes on: by how much the latest sample came later
    /// after the edge that had set its bit than it should, and the rising edge before the sample.
    pub late: Option<Level>,
    /// Lower bound of first falling to second rising edge, what an adaptive slave takes for its timeout.
    pub reference_ns: Option<u32>,
    /// Second rising MA edge to SL falling.
    pub delay_ns: Option<u32>,
    /// Last MA edge to SL = 1.
    pub ready_ns: Option<u32>,
    /// What answered may have answered an earlier cycle, whose clocks paused for so long
    /// before its Ack came.
    pub misplaced_ns: Option<u32>,
    /// Where it begins is likely, not certain: a recording's first cycles after a piece of one, whose line delay no other
    /// cycle confirms.
    pub unconfirmed: bool,
    /// [`Clocks::surplus`], where the link plans its clocks.
    pub surplus: u16,
    /// A recording that does not show the whole cycle.
    pub cut: Option<Cut>,
    /// Both wires, change by change, for those who have put one here before the cycle.
    pub wave: Option<Box<Waveform>>,
}

/// Where a recording begins or ends inside a cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cut {
    /// What came before is not known, so no bit of it has a place.
    Begin,
    /// There may be bits missing.
    End,
}

impl Trace {
    /// Forgets everything, keeps the memory.
    pub fn reset(&mut self) {
        self.bits.clear();
        let bits = std::mem::take(&mut self.bits);
        let mut wave = self.wave.take();
        if let Some(wave) = &mut wave {
            wave.clear();
        }
        *self = Trace {
            bits,
            wave,
            ..Trace::default()
        };
    }

    /// Notes a level; the longest one stays.
    pub fn level(&mut self, ns: u64, edge: u16) {
        let ns = u32::try_from(ns).unwrap_or(u32::MAX);
        if self.longest.is_none_or(|longest| ns > longest.ns) {
            self.longest = Some(Level { ns, edge });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_and_runs_equal_the_bits() {
        let seed = fastrand::u64(..);
        println!("seed {seed}");
        let mut rng = fastrand::Rng::with_seed(seed);
        for _ in 0..2_000 {
            let mut bits = Bits::default();
            let plain: Vec<bool> = (0..rng.usize(0..300)).map(|_| rng.u8(0..8) > 0).collect();
            bits.extend(plain.iter().copied());
            assert!(bits.iter().eq(plain.iter().copied()));
            let (at, n) = (rng.usize(0..300), rng.usize(0..66));
            let want = plain
                .get(at..at + n)
                .filter(|_| n <= 64)
                .map(|s| s.iter().fold(0u64, |w, b| w << 1 | u64::from(*b)));
            assert_eq!(bits.word(at, n), want, "{at} {n}");
            for level in [false, true] {
                let want = (at..plain.len()).find(|i| plain[*i] == level);
                assert_eq!(bits.find(at, level), want);
            }
        }
    }

    #[test]
    fn never_grows_past_its_room() {
        let mut bits = Bits::default();
        bits.extend((0..MAX_CLOCKS + 10).map(|i| i % 3 == 0));
        assert_eq!(bits.len(), MAX_CLOCKS);
        assert_eq!(bits.word(MAX_CLOCKS - 3, 3), bits.word(MAX_CLOCKS - 6, 3));
        assert_eq!(bits.word(MAX_CLOCKS - 3, 4), None);
    }
}
