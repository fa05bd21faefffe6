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
    /// One more than bits need, so that a word may be read across the end.
    words: [u64; WORDS + 1],
    len: u16,
}

impl PartialEq for Bits {
    fn eq(&self, other: &Bits) -> bool {
        self.len == other.len && self.iter().eq(other.iter())
    }
}

impl Eq for Bits {}

impl Default for Bits {
    fn default() -> Bits {
        Bits {
            words: [0; WORDS + 1],
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

    /// Takes over all bits of `bytes` but the first one, most significant ones first: as many as there is room for.
    #[inline]
    pub fn set_behind_first(&mut self, bytes: &[u8]) {
        let len = (8 * bytes.len()).saturating_sub(1).min(MAX_CLOCKS);
        self.len = len as u16;
        if let Ok(eight) = bytes.try_into() {
            self.words[0] = u64::from_be_bytes(eight) << 1;
            return;
        }
        let word = |bytes: &[u8]| match bytes.try_into() {
            Ok(eight) => u64::from_be_bytes(eight),
            Err(_) => bytes.iter().zip(0..).fold(0, |word, (byte, at)| {
                word | u64::from(*byte) << (56 - 8 * at)
            }),
        };
        let mut eights = bytes.chunks(8).map(word);
        let mut here = eights.next().unwrap_or(0);
        for slot in self.words.iter_mut().take(len.div_ceil(64)) {
            let next = eights.next().unwrap_or(0);
            *slot = here << 1 | next >> 63;
            here = next;
        }
    }

    /// Takes over the first `len` bits of `words`, the most significant one first.
    pub(crate) fn set(&mut self, words: &[u64], len: u16) {
        self.words[..words.len()].copy_from_slice(words);
        self.len = len.min(64 * words.len() as u16);
    }

    /// The bit at `at`, `None` past the end.
    pub fn get(&self, at: usize) -> Option<bool> {
        (at < self.len()).then(|| self.words[at / 64] >> (63 - at % 64) & 1 == 1)
    }

    /// `n` (0 to 64) bits from `at`, the first one most significant; `None` past the end.
    #[inline]
    pub fn word(&self, at: usize, n: usize) -> Option<u64> {
        if n > 64 || at + n > self.len() {
            return None;
        }
        if n == 0 {
            return Some(0);
        }
        Some(self.chunk(at) >> (64 - n))
    }

    /// 64 bits from `at` on, the first one most significant; those past the end mean nothing.
    #[inline]
    pub(crate) fn chunk(&self, at: usize) -> u64 {
        let (word, offset) = (at / 64 % WORDS, at % 64);
        // In two steps, as a shift by 64 is none.
        self.words[word] << offset | self.words[word + 1] >> 1 >> (63 - offset)
    }

    /// The first bit at or after `at` that is `level`.
    #[inline]
    pub fn find(&self, mut at: usize, level: bool) -> Option<usize> {
        let same = if level { 0 } else { !0u64 };
        while at < self.len() {
            let run = (self.chunk(at) ^ same).leading_zeros() as usize;
            at += run;
            if run < 64 {
                return (at < self.len()).then_some(at);
            }
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
#[derive(Clone, Debug, Default, PartialEq, Eq)]
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
    /// SL falling after the second rising MA edge to SL rising again: Ack to start, where every change of SL is seen.
    pub busy_ns: Option<u32>,
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
        // Each for itself: the bits are a quarter of a kilobyte that nobody needs to move.
        let Trace {
            t_ns,
            bits,
            idle,
            waited_ns,
            cdm,
            ma_period_ns,
            longest,
            late,
            reference_ns,
            delay_ns,
            busy_ns,
            ready_ns,
            misplaced_ns,
            unconfirmed,
            surplus,
            cut,
            wave,
        } = self;
        bits.clear();
        (*t_ns, *idle, *waited_ns, *cdm) = (0, None, None, None);
        (*ma_period_ns, *longest, *late) = (None, None, None);
        (*reference_ns, *delay_ns, *busy_ns, *ready_ns) = (None, None, None, None);
        (*misplaced_ns, *unconfirmed, *surplus, *cut) = (None, false, 0, None);
        if let Some(wave) = wave {
            wave.clear();
        }
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
    fn bytes_equal_their_bits() {
        let seed = fastrand::u64(..);
        println!("seed {seed}");
        let mut rng = fastrand::Rng::with_seed(seed);
        for _ in 0..2_000 {
            let bytes: Vec<u8> = (0..rng.usize(0..300)).map(|_| rng.u8(..)).collect();
            let plain = bytes
                .iter()
                .flat_map(|byte| (0..8).rev().map(move |at| byte >> at & 1 == 1));
            let mut bits = Bits::default();
            bits.set_behind_first(&bytes);
            assert!(bits.iter().eq(plain.skip(1).take(MAX_CLOCKS)), "{bytes:x?}");
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
