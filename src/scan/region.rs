//! A stretch of samples as bits: what happens from one rest of the wires to the next.

use super::step::Step;
use super::wide::Wide;
use crate::slice::{Line, mean_period};

/// Samples in a block, the first one least significant.
pub(super) const BLOCK: usize = 64;

/// Blocks in a region: no cycle that is worth the trouble is longer.
pub(super) const ROOM: usize = 256;

/// Consecutive blocks. Before them both wires were 1.
#[derive(Clone, Debug)]
pub(super) struct Region {
    ma: [u64; ROOM],
    /// Two more, so that a window may end behind the last block.
    slo: [u64; ROOM + 2],
    /// Where MA rises.
    rises: [u64; ROOM],
    /// How often; up to MA's last edge.
    counts: [u8; ROOM],
    /// When, for those who need to know.
    rises_ns: Vec<u64>,
    len: usize,
    /// Number of the first sample.
    first: u64,
    seen: Seen,
}

/// What has been seen of a region while it came. Places are in samples from its first one.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    /// Blocks until the last edge of MA.
    clocked: usize,
    rises: u32,
    /// MA's first falling edge.
    fall: u32,
    /// Levels of MA that lasted for one sample.
    short: u64,
    /// Where MA moves in the block before.
    moved_before: u64,
    /// Changes of SLO, where the first two are and the last one.
    changes: u32,
    ack: u32,
    behind: u32,
    end: u32,
    /// SLO has risen since the last edge of MA, and both wires are 1.
    over: bool,
}

impl Region {
    pub(super) fn new() -> Box<Region> {
        Box::new(Region {
            ma: [0; ROOM],
            slo: [0; ROOM + 2],
            rises: [0; ROOM],
            counts: [0; ROOM],
            rises_ns: Vec::with_capacity(64 * WORDS),
            len: 0,
            first: 0,
            seen: Seen::default(),
        })
    }

    pub(super) fn is_empty(&self) -> bool {
        self.len == 0
    }

    pub(super) fn is_full(&self) -> bool {
        self.len == ROOM
    }

    /// Whether a cycle may be over: nothing has moved since SLO rose.
    pub(super) fn is_over(&self) -> bool {
        self.seen.over
    }

    pub(super) fn clear(&mut self) {
        self.len = 0;
        self.seen = Seen::default();
    }

    /// Both wires at the end.
    #[inline(always)]
    fn last(&self) -> (u64, u64) {
        match self.len.checked_sub(1) {
            Some(last) => (self.ma[last] >> 63, self.slo[last] >> 63),
            None => (1, 1),
        }
    }

    /// A block in which something moves, with MA falling first where it is the first one. `first` is the number of its
    /// first sample.
    #[inline(always)]
    pub(super) fn push(&mut self, first: u64, ma: u64, slo: u64) {
        let (ma_before, slo_before) = self.last();
        let ma_moves = ma ^ (ma << 1 | ma_before);
        let slo_moves = slo ^ (slo << 1 | slo_before);
        let seen = &mut self.seen;
        let base = (self.len * BLOCK) as u32;
        if self.len == 0 {
            self.first = first;
            seen.fall = ma_moves.trailing_zeros();
        }
        let rises = ma_moves & ma;
        (self.ma[self.len], self.slo[self.len]) = (ma, slo);
        self.rises[self.len] = rises;
        self.len += 1;
        self.counts[self.len - 1] = 0;
        if ma_moves != 0 {
            seen.clocked = self.len;
            let count = rises.count_ones();
            self.counts[self.len - 1] = count as u8;
            seen.rises += count;
        }
        seen.short |= ma_moves & (ma_moves << 1 | seen.moved_before >> 63);
        seen.moved_before = ma_moves;
        if slo_moves != 0 {
            if seen.changes < 2 {
                let mut places = places(slo_moves).map(|at| base + at);
                if seen.changes == 0 {
                    seen.ack = places.next().unwrap_or(0);
                }
                seen.behind = places.next().unwrap_or(0);
            }
            seen.changes += slo_moves.count_ones();
            seen.end = base + 63 - slo_moves.leading_zeros();
        }
        let later = slo_moves.leading_zeros() < ma_moves.leading_zeros();
        seen.over = ma >> 63 == 1 && slo >> 63 == 1 && later;
    }

    /// Blocks in which nothing moves, as many of so many as there is room for.
    #[inline(always)]
    pub(super) fn push_quiet(&mut self, blocks: usize) {
        let blocks = blocks.min(ROOM - self.len);
        let (ma, slo) = self.last();
        let new = self.len..self.len + blocks;
        self.ma[new.clone()].fill(ma.wrapping_neg());
        self.slo[new.clone()].fill(slo.wrapping_neg());
        self.rises[new.clone()].fill(0);
        self.counts[new].fill(0);
        self.len += blocks;
        self.seen.moved_before = 0;
    }

    /// Where MA falls in the block that comes next, if SLO has risen before, and MA has rested for a block at least.
    #[inline(always)]
    pub(super) fn begins_anew(&self, ma: u64, slo: u64) -> Option<u32> {
        let last = self.len - 1;
        let rests = self.seen.clocked < self.len && self.ma[last] >> 63 == 1;
        let fall = (!ma).trailing_zeros();
        if !rests || fall > 63 {
            return None;
        }
        let before = (1u64 << fall) - 1;
        let moves = (slo ^ (slo << 1 | self.slo[last] >> 63)) & before;
        let rises = moves & slo != 0 && moves & (moves - 1) == 0;
        (self.seen.over && moves == 0 || rises).then_some(fall)
    }

    /// Every change, in order: sample number and both levels.
    pub(super) fn changes(&self) -> impl Iterator<Item = (u64, bool, bool)> + '_ {
        let (mut ma_before, mut slo_before) = (1, 1);
        let blocks = (0..self.len).flat_map(move |index| {
            let (ma, slo) = (self.ma[index], self.slo[index]);
            let moves = moves(ma, slo, ma_before, slo_before);
            (ma_before, slo_before) = (ma >> 63, slo >> 63);
            places(moves).map(move |at| (index, at))
        });
        blocks.map(|(index, at)| {
            let sample = self.first + (index * BLOCK) as u64 + u64::from(at);
            let level = |word: u64| word >> at & 1 == 1;
            (sample, level(self.ma[index]), level(self.slo[index]))
        })
    }
}

/// Where one of two wires moves.
pub(super) fn moves(ma: u64, slo: u64, ma_before: u64, slo_before: u64) -> u64 {
    ma ^ (ma << 1 | ma_before) | slo ^ (slo << 1 | slo_before)
}

/// The places of ones, lowest first.
pub(super) fn places(mut word: u64) -> impl Iterator<Item = u32> {
    std::iter::from_fn(move || {
        let at = word.trailing_zeros();
        word &= word.wrapping_sub(1);
        (at < 64).then_some(at)
    })
}

/// A cycle at a steady clock, as a [`crate::slice::Slicer`] would find it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Regular {
    pub(crate) t_ns: u64,
    /// Most significant first, [`Regular::clocks`] of them.
    pub(crate) bits: [u64; WORDS],
    pub(crate) clocks: u16,
    pub(crate) period_ns: u32,
    pub(crate) delay_ns: u32,
    pub(crate) busy_ns: u32,
    pub(crate) reference_ns: u32,
    /// The longest level, and the rising edge that ended it.
    pub(crate) longest_ns: u32,
    pub(crate) longest_edge: u16,
    /// MA's last rising edge, and SL = 1.
    pub(crate) risen_ns: u64,
    pub(crate) ready_ns: u64,
}

/// Words of bits: clocks that a steady cycle may have.
const WORDS: usize = 4;

/// The least samples in a clock for which all that is said here holds.
const LEAST_GAP: u32 = 8;

/// MA's rising edges, places in samples from the region's first one.
struct Clock {
    first: u32,
    second: u32,
    last: u32,
    clocks: u32,
    /// Samples from one to the next, rounded.
    gap: u32,
}

impl Region {
    /// Whether this is one whole cycle at a steady clock in which nothing is out of the ordinary, CDM = 0, that ended
    /// with SL = 1. What is said of it is exactly what the slicer makes of the same changes, where it knows that a cycle
    /// begins: each condition here keeps one of its rules out of the way. `timeout_ns` is the slave's longest; `fell`
    /// says that MA falls with the sample behind the region.
    #[inline(always)]
    pub(super) fn regular<W: Wide>(
        &mut self,
        step: Step,
        timeout_ns: u64,
        fell: bool,
    ) -> Option<Regular> {
        let clock = self.clock()?;
        let Seen { fall, ack, end, .. } = self.seen;
        // What is shorter than half a clock is a spike, and no Ack.
        if ack < clock.second || 2 * (self.seen.behind - ack) < clock.gap + 3 {
            return None;
        }
        let delay = ack - clock.second;
        let steady = steady(&self.rises[..self.seen.clocked], &clock);
        let slow = clock.gap >= BLOCK as u32 && is_prompt(&clock, delay);
        let bits = if steady && !slow {
            self.bits::<W>(&clock, delay)?
        } else {
            self.bits_by_edges(&clock, step)?
        };
        let ns = |place: u32| step.ns(self.first + u64::from(place));
        let (fall_ns, risen_ns, end_ns) = (ns(fall), ns(clock.last), ns(end));
        let (first_ns, second_ns) = (ns(clock.first), ns(clock.second));
        // Neither too early to be SL = 1, nor so late that the cycle was over before.
        let early = end - clock.last <= delay + (3 * clock.gap).div_ceil(4) + 1;
        let late = end_ns - risen_ns > timeout_ns || first_ns - fall_ns > timeout_ns;
        // Channels out of step by a sample could still have MA rise with it.
        let rests = fell || self.len * BLOCK - end as usize > clock.gap as usize / 8 + 2;
        if early || late || !rests {
            return None;
        }
        let gap_ns = self.longest_gap(&clock, steady, step);
        let low_ns = first_ns - fall_ns;
        let (longest_ns, longest_edge) = if gap_ns.0 > low_ns {
            gap_ns
        } else {
            (low_ns, 1)
        };
        let spans = u64::from(clock.clocks - 1);
        let small = |ns: u64| u32::try_from(ns).ok();
        Some(Regular {
            t_ns: fall_ns,
            bits: bits.map(u64::reverse_bits),
            clocks: clock.clocks as u16,
            period_ns: small((risen_ns - first_ns + spans / 2) / spans)?,
            delay_ns: small(ns(ack) - second_ns)?,
            busy_ns: small(ns(self.seen.behind) - ns(ack))?,
            reference_ns: small(second_ns - fall_ns)?,
            longest_ns: small(longest_ns)?,
            longest_edge,
            risen_ns,
            ready_ns: end_ns - risen_ns,
        })
    }

    /// MA falls and rises, and rests high. No level is as short as a sample.
    #[inline(always)]
    fn clock(&self) -> Option<Clock> {
        let Seen {
            clocked,
            rises: clocks,
            short,
            ..
        } = self.seen;
        // MA is high before and behind, so it has fallen as often.
        if short != 0 || !(4..=64 * WORDS as u32).contains(&clocks) {
            return None;
        }
        let rises = &self.rises[..clocked];
        let (first, rest) = next(rises, 0, !0)?;
        let (second, _) = next(rises, first as usize / BLOCK, rest)?;
        // The last edge is a rising one, as MA is high behind it.
        let last = (clocked * BLOCK) as u32 - 1 - rises.last()?.leading_zeros();
        let gap = (last - first + (clocks - 1) / 2) / (clocks - 1);
        (gap >= LEAST_GAP).then_some(Clock {
            first,
            second,
            last,
            clocks,
            gap,
        })
    }

    /// SLO in the middle of each bit, the first one least significant, where all clocks are as long: the line through all
    /// edges is then the edges themselves, but for a rounding. Nothing is said where SLO is close to a change, moves ahead
    /// of its own edge, or moves more often than the bits need.
    #[inline(always)]
    fn bits<W: Wide>(&mut self, clock: &Clock, delay: u32) -> Option<[u64; WORDS]> {
        /// Rounding, of samples and of nanoseconds.
        const MARGIN: u32 = 2;
        let Seen {
            clocked, changes, ..
        } = self.seen;
        let middle = delay + clock.gap / 2;
        // SLO stays 1 behind the region, as far as the last windows reach.
        self.slo[self.len..self.len + 2].fill(!0);
        let windows = [middle - MARGIN, middle, middle + MARGIN]
            .map(|offset| Window::new(&self.slo, offset, clocked));
        let [early, sampled, late] = [windows[0]?, windows[1]?, windows[2]?];
        let mut bits = Gathered::default();
        let (mut unsure, mut before) = (0, !0);
        // With each rising edge SLO still shows the bit before, unless the line delay is long enough to hide that.
        let prompt = is_prompt(clock, delay);
        let back = clock.gap.wrapping_sub(middle) % BLOCK as u32;
        let blocks = self.rises[..clocked].iter().zip(&self.counts);
        for (index, (rises, count)) in blocks.enumerate() {
            let slo = sampled.at(index);
            unsure |= (slo ^ early.at(index) | slo ^ late.at(index)) & rises;
            bits.push(W::gather(slo, *rises), u32::from(*count));
            if prompt {
                let slo = self.slo[index];
                let shown = slo << 1 | before >> 63;
                let bit_before = slo << back | before >> (BLOCK as u32 - back);
                before = slo;
                unsure |= (shown ^ bit_before) & rises;
            }
        }
        let as_needed = bits.last() == 0 && bits.changes() + 1 == changes;
        (unsure == 0 && as_needed).then_some(bits.words)
    }

    /// The same where clocks differ by a sample, each bit where the slicer samples it.
    fn bits_by_edges(&mut self, clock: &Clock, step: Step) -> Option<[u64; WORDS]> {
        let Seen {
            clocked,
            changes,
            ack,
            ..
        } = self.seen;
        let first = self.first;
        self.rises_ns.clear();
        let (mut least, mut most, mut before) = (u32::MAX, 0, clock.first);
        for (index, word) in self.rises[..clocked].iter().enumerate() {
            for at in places(*word) {
                let place = (index * BLOCK) as u32 + at;
                self.rises_ns.push(step.ns(first + u64::from(place)));
                if place > clock.first {
                    (least, most) = (least.min(place - before), most.max(place - before));
                }
                before = place;
            }
        }
        if least < LEAST_GAP || most > least + 1 {
            return None;
        }
        let line = Line::through(&self.rises_ns);
        let (ack_ns, second_ns) = (step.ns(first + u64::from(ack)), *self.rises_ns.get(1)?);
        let half_ns = mean_period(&self.rises_ns)? / 2;
        let prompt = is_prompt(clock, ack - clock.second);
        let mut bits = Gathered::default();
        let (mut unsure, mut place) = (false, 0);
        let mut rises = self.rises[..clocked].iter().enumerate();
        let (mut block, mut word) = rises.next()?;
        let mut left = *word;
        for (index, rise_ns) in self.rises_ns.iter().enumerate() {
            while left == 0 {
                (block, word) = rises.next()?;
                left = *word;
            }
            let edge = (block * BLOCK) as u32 + left.trailing_zeros();
            left &= left - 1;
            let middle_ns = match line {
                Some(line) => line.middle(&self.rises_ns, index, Some(ack_ns)),
                None => rise_ns + (ack_ns - second_ns) + half_ns,
            };
            place = step.sample(middle_ns, first, place.max(edge));
            let level = self.slo(place);
            // Nothing has moved shortly before.
            unsure |= self.slo(place - least / 4) != level;
            unsure |= prompt && self.slo(edge - 1) != bits.last();
            bits.push(level, 1);
        }
        let as_needed = bits.last() == 0 && bits.changes() + 1 == changes;
        (!unsure && as_needed).then_some(bits.words)
    }

    /// SLO at one sample; it stays as it is behind the region.
    #[inline(always)]
    fn slo(&self, place: u32) -> u64 {
        let block = place as usize / BLOCK;
        if block >= self.len {
            return 1;
        }
        self.slo[block] >> (place % BLOCK as u32) & 1
    }

    /// The longest time from rising edge to rising edge, and the edge that first ended so long a one.
    #[inline(always)]
    fn longest_gap(&self, clock: &Clock, steady: bool, step: Step) -> (u64, u16) {
        if let Some(step_ns) = step.whole_ns().filter(|_| steady) {
            return (u64::from(clock.gap) * step_ns, 2);
        }
        let (mut longest, mut before) = ((0, 0), None);
        let all = self.rises[..self.seen.clocked].iter().enumerate();
        let all = all.flat_map(|(index, word)| places(*word).map(move |at| (index, at)));
        for (edge, (index, at)) in all.enumerate() {
            let ns = step.ns(self.first + (index * BLOCK) as u64 + u64::from(at));
            if let Some(before) = before.replace(ns) {
                if ns - before > longest.0 {
                    longest = (ns - before, edge as u16 + 1);
                }
            }
        }
        longest
    }
}

/// The first one at or behind block `from`, of which only `mask` counts; and the mask for the next one.
#[inline(always)]
fn next(words: &[u64], from: usize, mask: u64) -> Option<(u32, u64)> {
    let mut mask = mask;
    for (index, word) in words.iter().enumerate().skip(from) {
        let word = word & mask;
        if word != 0 {
            let at = word.trailing_zeros();
            let rest = (!0u64).checked_shl(at + 1).unwrap_or(0);
            return Some(((index * BLOCK) as u32 + at, rest));
        }
        mask = !0;
    }
    None
}

/// Whether SLO could move so long ahead of its own edge that the slicer takes it for the end of the cycle.
#[inline(always)]
fn is_prompt(clock: &Clock, delay: u32) -> bool {
    delay < clock.gap / 4 + 2
}

/// Whether all rising edges are one gap apart. Ones are at least four apart, so none can hide between two others: it would
/// have to be a gap behind one more itself.
#[inline(always)]
fn steady(rises: &[u64], clock: &Clock) -> bool {
    let mut strange = 0;
    if clock.gap < BLOCK as u32 {
        let mut previous = 0u64;
        // The first one has none before it.
        let (block, alone) = (clock.first as usize / BLOCK, 1 << (clock.first % 64));
        for (index, word) in rises.iter().enumerate() {
            let behind = word << clock.gap | previous >> (BLOCK as u32 - clock.gap);
            let odd = word & !behind;
            strange |= if index == block { odd ^ alone } else { odd };
            previous = *word;
        }
        return strange == 0;
    }
    let (mut strange, mut due) = (0, clock.first);
    for (index, word) in rises.iter().enumerate() {
        for at in places(*word) {
            strange |= ((index * BLOCK) as u32 + at) ^ due;
            due += clock.gap;
        }
    }
    strange == 0
}

/// SLO so many samples behind each block.
#[derive(Clone, Copy)]
struct Window<'a> {
    words: &'a [u64],
    shift: u32,
}

impl Window<'_> {
    #[inline(always)]
    fn new(slo: &[u64], offset: u32, blocks: usize) -> Option<Window<'_>> {
        let block = offset as usize / BLOCK;
        Some(Window {
            words: slo.get(block..=block + blocks)?,
            shift: offset % BLOCK as u32,
        })
    }

    #[inline(always)]
    fn at(self, index: usize) -> u64 {
        // In two steps, as a shift by 64 is none.
        self.words[index] >> self.shift | self.words[index + 1] << 1 << (63 - self.shift)
    }
}

/// Bits side by side, the first one least significant.
#[derive(Default)]
struct Gathered {
    words: [u64; WORDS],
    have: u32,
}

impl Gathered {
    #[inline(always)]
    fn push(&mut self, bits: u64, count: u32) {
        let (word, place) = ((self.have / 64) as usize % WORDS, self.have % 64);
        self.words[word] |= bits << place;
        if place + count > 64 {
            self.words[(word + 1) % WORDS] |= bits >> (64 - place);
        }
        self.have += count;
    }

    /// The last one; 1 before the first.
    #[inline(always)]
    fn last(&self) -> u64 {
        match self.have.checked_sub(1) {
            Some(last) => self.words[(last / 64) as usize % WORDS] >> (last % 64) & 1,
            None => 1,
        }
    }

    /// How often they change after a 1 before them.
    #[inline(always)]
    fn changes(&self) -> u32 {
        let (mut changes, mut before) = (0, 1);
        let used = self.have.div_ceil(64) as usize;
        for (index, word) in self.words[..used.min(WORDS)].iter().enumerate() {
            let here = (self.have - 64 * index as u32).min(64);
            let unused = !0u64 << 1 << (here - 1);
            changes += ((word ^ (word << 1 | before)) & !unused).count_ones();
            before = word >> 63;
        }
        changes
    }
}
