//! A stretch of samples as bits: what happens from one rest of the wires to the next.

use super::step::Step;
use super::wide::Wide;
use crate::slice::{Line, mean_period};

/// Samples in a block, the first one least significant.
pub(super) const BLOCK: usize = 64;

/// Blocks in a region: no cycle that is worth the trouble is longer.
pub(super) const ROOM: usize = 256;
// `Moves` counts them with a byte.
const _: () = assert!(ROOM == 1 << u8::BITS);

/// Both wires for a block's time, and where they move.
#[derive(Clone, Copy)]
pub(super) struct Block {
    pub(super) ma: u64,
    pub(super) slo: u64,
    ma_moves: u64,
    slo_moves: u64,
}

impl Block {
    /// After `before`, 0 or 1 for each wire.
    #[inline(always)]
    pub(super) fn new(ma: u64, slo: u64, before: (u64, u64)) -> Block {
        Block {
            ma,
            slo,
            ma_moves: ma ^ (ma << 1 | before.0),
            slo_moves: slo ^ (slo << 1 | before.1),
        }
    }

    /// Where one of them moves.
    #[inline(always)]
    pub(super) fn moves(&self) -> u64 {
        self.ma_moves | self.slo_moves
    }

    /// Both at its end.
    #[inline(always)]
    pub(super) fn last(&self) -> (u64, u64) {
        (self.ma >> 63, self.slo >> 63)
    }
}

/// A block's first sample, in samples from the region's first one, and where in it something moves.
#[derive(Clone, Copy, Debug, Default)]
struct Moved {
    places: u64,
    base: u32,
}

/// Consecutive blocks. Before them both wires were 1.
#[derive(Clone, Debug)]
pub(super) struct Region {
    ma: [u64; ROOM],
    /// One more, so that a window may end behind the last block.
    slo: [u64; ROOM + 1],
    /// Blocks in which SLO moves, and where.
    moved: [Moved; ROOM],
    /// Where and when MA rises, if that was asked.
    edges: Vec<u32>,
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
    /// MA's first falling edge.
    fall: u32,
    /// Blocks in which SLO moves.
    moved: usize,
    /// SLO has risen since the last edge of MA, and both wires are 1.
    over: bool,
}

impl Region {
    pub(super) fn new() -> Box<Region> {
        Box::new(Region {
            ma: [0; ROOM],
            slo: [0; ROOM + 1],
            moved: [Moved::default(); ROOM],
            edges: Vec::with_capacity(64 * WORDS + BLOCK),
            rises_ns: Vec::with_capacity(64 * WORDS + BLOCK),
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
    pub(super) fn push(&mut self, first: u64, block: Block) {
        let Block {
            ma,
            slo,
            ma_moves,
            slo_moves,
        } = block;
        let seen = &mut self.seen;
        let base = (self.len * BLOCK) as u32;
        if base == 0 {
            self.first = first;
            seen.fall = ma_moves.trailing_zeros();
        }
        // There is room: said so that nothing has to look once more.
        debug_assert!(self.len < ROOM);
        let at = self.len % ROOM;
        (self.ma[at], self.slo[at]) = (ma, slo);
        self.len = at + 1;
        if ma_moves != 0 {
            seen.clocked = self.len;
        }
        if slo_moves != 0 {
            self.moved[seen.moved % ROOM] = Moved {
                places: slo_moves,
                base,
            };
            seen.moved += 1;
        }
        // The highest one of SLO's is higher than all of MA's.
        let later = slo_moves & !ma_moves > ma_moves;
        seen.over = (ma & slo) >> 63 == 1 && later;
    }

    /// Blocks in which nothing moves, as many of so many as there is room for.
    #[inline(always)]
    pub(super) fn push_quiet(&mut self, blocks: usize) {
        let blocks = blocks.min(ROOM - self.len);
        let (ma, slo) = self.last();
        let new = self.len..self.len + blocks;
        self.ma[new.clone()].fill(ma.wrapping_neg());
        self.slo[new].fill(slo.wrapping_neg());
        self.len += blocks;
    }

    /// Where MA falls in the block that comes next, if SLO has risen before, and MA has rested for a block at least.
    #[inline(always)]
    pub(super) fn begins_anew(&self, block: Block) -> Option<u32> {
        if self.seen.clocked == self.len || block.ma_moves == 0 {
            return None;
        }
        let fall = block.ma_moves.trailing_zeros();
        if block.ma >> fall & 1 == 1 {
            return None;
        }
        let moves = block.slo_moves & ((1 << fall) - 1);
        let rises = moves & block.slo != 0 && moves & (moves - 1) == 0;
        (self.seen.over && moves == 0 || rises).then_some(fall)
    }

    /// Every change, in order: sample number and both levels.
    pub(super) fn changes(&self) -> impl Iterator<Item = (u64, bool, bool)> + '_ {
        let mut before = (1, 1);
        let blocks = (0..self.len).flat_map(move |index| {
            let block = Block::new(self.ma[index], self.slo[index], before);
            before = block.last();
            places(block.moves()).map(move |at| (index, at))
        });
        blocks.map(|(index, at)| {
            let sample = self.first + (index * BLOCK) as u64 + u64::from(at);
            let level = |word: u64| word >> at & 1 == 1;
            (sample, level(self.ma[index]), level(self.slo[index]))
        })
    }
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

/// Words of bits.
const WORDS: usize = 4;

/// Clocks that a steady cycle may have.
const MOST_CLOCKS: u32 = 64 * WORDS as u32;

/// The least samples in a clock for which all that is said here holds.
const LEAST_GAP: u32 = 8;

/// MA's rising edges, places in samples from the region's first one.
struct Clock {
    first: u32,
    second: u32,
    last: u32,
}

/// Where SLO moves, in samples from the region's first one.
struct Answer<'a> {
    /// It falls for Ack, and rises for start.
    ack: u32,
    behind: u32,
    /// All but the last.
    moves: Moves<'a>,
    /// SL = 1.
    end: u32,
}

/// What SLO said with each clock.
struct Said {
    bits: Bits,
    /// Samples from one rising edge to the next, rounded.
    gap: u32,
    /// All are so long.
    steady: bool,
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
        let Said { bits, gap, steady } = self.said::<W>(&clock, step)?;
        let Answer {
            ack, behind, end, ..
        } = self.answer()?;
        let first = self.first;
        let ns = |place: u32| step.ns(first + u64::from(place));
        let (fall_ns, risen_ns, end_ns) = (ns(self.seen.fall), ns(clock.last), ns(end));
        let (first_ns, second_ns) = (ns(clock.first), ns(clock.second));
        // So late that the cycle was over before.
        let late = end_ns - risen_ns > timeout_ns || first_ns - fall_ns > timeout_ns;
        // Channels out of step by a sample could still have MA rise with it.
        let rests = fell || self.len * BLOCK - end as usize > gap as usize / 8 + 2;
        if late || !rests || bits.len < 4 {
            return None;
        }
        let gap_ns = self.longest_gap(gap, steady, step);
        let low_ns = first_ns - fall_ns;
        let (longest_ns, longest_edge) = if gap_ns.0 > low_ns {
            gap_ns
        } else {
            (low_ns, 1)
        };
        let spans = u64::from(bits.len - 1);
        let small = |ns: u64| u32::try_from(ns).ok();
        Some(Regular {
            t_ns: fall_ns,
            bits: bits.words,
            clocks: bits.len as u16,
            period_ns: small((risen_ns - first_ns + spans / 2) / spans)?,
            delay_ns: small(ns(ack) - second_ns)?,
            busy_ns: small(ns(behind) - ns(ack))?,
            reference_ns: small(second_ns - fall_ns)?,
            longest_ns: small(longest_ns)?,
            longest_edge,
            risen_ns,
            ready_ns: end_ns - risen_ns,
        })
    }

    /// Each bit, where it is sure.
    #[inline(always)]
    fn said<W: Wide>(&mut self, clock: &Clock, step: Step) -> Option<Said> {
        let gap = clock.second - clock.first;
        if gap < LEAST_GAP {
            return None;
        }
        let Some(clocks) = self.steady(clock, gap) else {
            return self.bits_by_edges(clock, step);
        };
        let answer = self.answer().filter(|answer| answer.fits(clock, gap))?;
        let quiet = Quiet::new(gap, answer.ack - clock.second);
        let early = answer.end - clock.last <= quiet.early + quiet.still;
        if early || clocks > MOST_CLOCKS {
            return None;
        }
        let bits = if W::GATHERS {
            self.bits_at_rises::<W>(clocks, quiet)?
        } else {
            bits_between_moves(answer, clock.first, gap, clocks, quiet)?
        };
        Some(Said {
            bits,
            gap,
            steady: true,
        })
    }

    /// At least Ack, start, and SL = 1.
    #[inline(always)]
    fn answer(&self) -> Option<Answer<'_>> {
        let last = self.moved[self.seen.moved.checked_sub(1)?];
        let end = last.base + 63 - last.places.leading_zeros();
        let moves = Moves {
            moved: &self.moved,
            at: 0,
            left: self.moved[0].places,
            end,
        };
        let mut first = moves.clone();
        let (ack, behind) = (first.next()?, first.next()?);
        Some(Answer {
            ack,
            behind,
            moves,
            end,
        })
    }

    /// MA falls and rises, and rests high.
    #[inline(always)]
    fn clock(&self) -> Option<Clock> {
        let mut blocks = Rises::new(&self.ma[..self.seen.clocked]).enumerate();
        let mut word = 0;
        let mut base = 0;
        let mut next = || {
            while word == 0 {
                let (index, rises) = blocks.next()?;
                (base, word) = ((index * BLOCK) as u32, rises);
            }
            let at = word.trailing_zeros();
            word &= word - 1;
            Some(base + at)
        };
        let (first, second) = (next()?, next()?);
        // The last edge is a rising one, as MA is high behind it: the last 0 is before it.
        let (block, ma) = (self.seen.clocked - 1, *self.ma.get(self.seen.clocked - 1)?);
        let last = (block * BLOCK) as u32 + BLOCK as u32 - (!ma).leading_zeros();
        Some(Clock {
            first,
            second,
            last,
        })
    }

    /// How often MA rises, if each time one gap behind the last one, and without a level as short as a sample.
    #[inline(always)]
    fn steady(&self, clock: &Clock, gap: u32) -> Option<u32> {
        let mut pace = Pace::new(clock, gap);
        let (mut high, mut moved, mut short) = (1, 0, 0);
        for (index, ma) in self.ma[..self.seen.clocked].iter().enumerate() {
            let moves = ma ^ (ma << 1 | high);
            short |= moves & (moves << 1 | moved);
            if !pace.keeps(index, moves & ma) {
                return None;
            }
            (high, moved) = (ma >> 63, moves >> 63);
        }
        (short == 0).then(|| (clock.last - clock.first) / gap + 1)
    }

    /// The bits of `clocks` rising edges, many edges at a time.
    #[inline(always)]
    fn bits_at_rises<W: Wide>(&mut self, clocks: u32, quiet: Quiet) -> Option<Bits> {
        let clocked = self.seen.clocked;
        let early = Window::new(&self.slo, quiet.early, clocked)?;
        let late = Window::new(&self.slo, quiet.early + quiet.still, clocked)?;
        let mut bits = Bits::default();
        let mut unsure = 0;
        for (index, rises) in Rises::new(&self.ma[..clocked]).enumerate() {
            let slo = early.at(index);
            unsure |= (slo ^ late.at(index)) & rises;
            bits.push(W::gather(slo, rises), rises.count_ones());
        }
        bits.most_significant_first();
        let moved = &self.moved[..self.seen.moved];
        let moves: u32 = moved.iter().map(|block| block.places.count_ones()).sum();
        // The last move is SL = 1. Where there are no more moves than bits need, SLO stays as it is from each early place
        // to the late one.
        let as_needed = !bits.last() && bits.changes() + 1 == moves;
        (unsure == 0 && as_needed && bits.len == clocks).then_some(bits)
    }

    /// The same where clocks differ by a sample, each bit where the slicer samples it.
    fn bits_by_edges(&mut self, clock: &Clock, step: Step) -> Option<Said> {
        self.note_rises(step);
        let clocks = self.edges.len() as u32;
        if clocks > MOST_CLOCKS || self.has_short() {
            return None;
        }
        let gaps = self.edges.windows(2).map(|pair| pair[1] - pair[0]);
        let (least, most) = gaps.fold((u32::MAX, 0), |(least, most), gap| {
            (least.min(gap), most.max(gap))
        });
        if least < LEAST_GAP || most > least + 1 {
            return None;
        }
        let spans = clocks - 1;
        let gap = (clock.last - clock.first + spans / 2) / spans;
        let answer = self.answer().filter(|answer| answer.fits(clock, gap))?;
        let line = Line::through(&self.rises_ns);
        let first = self.first;
        let (ack_ns, second_ns) = (
            step.ns(first + u64::from(answer.ack)),
            *self.rises_ns.get(1)?,
        );
        let half_ns = mean_period(&self.rises_ns)? / 2;
        let prompt = is_prompt(gap, answer.ack - clock.second);
        let mut moves = answer.moves.clone().peekable();
        let mut bits = Bits::default();
        let mut place = 0;
        for (index, (edge, rise_ns)) in self.edges.iter().zip(&self.rises_ns).enumerate() {
            let middle_ns = match line {
                Some(line) => line.middle(&self.rises_ns, index, Some(ack_ns)),
                None => rise_ns + (ack_ns - second_ns) + half_ns,
            };
            place = step.sample(middle_ns, first, place.max(*edge));
            if let Some(moved) = moves.next_if(|moved| *moved <= place) {
                // Shortly before, or ahead of its edge.
                if moved > place - least / 4 || prompt && moved < *edge {
                    return None;
                }
                bits.turn(index as u32);
            }
            if moves.peek().is_some_and(|moved| *moved <= place) {
                return None;
            }
        }
        bits.len = clocks;
        bits.turns_to_levels();
        (moves.next().is_none() && !bits.last()).then_some(Said {
            bits,
            gap,
            steady: false,
        })
    }

    /// Whether a level of MA lasted for one sample.
    fn has_short(&self) -> bool {
        let (mut high, mut moved) = (1, 0);
        self.ma[..self.seen.clocked].iter().any(|ma| {
            let moves = ma ^ (ma << 1 | high);
            let short = moves & (moves << 1 | moved);
            (high, moved) = (ma >> 63, moves >> 63);
            short != 0
        })
    }

    /// The longest time from rising edge to rising edge, and the edge that first ended so long a one.
    #[inline(always)]
    fn longest_gap(&mut self, gap: u32, steady: bool, step: Step) -> (u64, u16) {
        match step.whole_ns() {
            Some(step_ns) if steady => return (u64::from(gap) * step_ns, 2),
            None if steady => self.note_rises(step),
            _ => {}
        }
        let mut longest = (0, 0);
        for (edge, pair) in (2..).zip(self.rises_ns.windows(2)) {
            let gap_ns = pair[1] - pair[0];
            if gap_ns > longest.0 {
                longest = (gap_ns, edge);
            }
        }
        longest
    }

    /// Where and when MA rises, as often as a steady cycle may have it rise, and a little more.
    fn note_rises(&mut self, step: Step) {
        self.edges.clear();
        let rises = Rises::new(&self.ma[..self.seen.clocked]);
        for (base, word) in (0..).step_by(BLOCK).zip(rises) {
            if self.edges.len() > MOST_CLOCKS as usize {
                break;
            }
            self.edges.extend(places(word).map(|at| base + at));
        }
        let first = self.first;
        let ns = |edge: &u32| step.ns(first + u64::from(*edge));
        self.rises_ns.clear();
        self.rises_ns.extend(self.edges.iter().map(ns));
    }
}

impl Answer<'_> {
    /// Whether SLO falls for an Ack behind the second edge, and rises when the cycle is over, and not earlier.
    #[inline(always)]
    fn fits(&self, clock: &Clock, gap: u32) -> bool {
        // What is shorter than half a clock is a spike, and no Ack.
        let spike = 2 * (self.behind - self.ack) < gap + 3;
        if spike || self.ack < clock.second || self.end < clock.last {
            return false;
        }
        let delay = self.ack - clock.second;
        self.end - clock.last > delay + (3 * gap).div_ceil(4) + 1
    }
}

/// Where SLO has to be quiet for its bit to be sure: in the middle, where all clocks are as long, as the line through all
/// edges is then the edges themselves, but for a rounding; and up to the next edge, when it could move ahead of that.
#[derive(Clone, Copy)]
struct Quiet {
    /// From so many samples behind the edge on.
    early: u32,
    /// For so many more.
    still: u32,
}

impl Quiet {
    #[inline(always)]
    fn new(gap: u32, delay: u32) -> Quiet {
        /// Rounding, of samples and of nanoseconds.
        const MARGIN: u32 = 2;
        let early = delay + gap / 2 - MARGIN;
        // With each rising edge SLO still shows the bit before, unless the line delay is long enough to hide that.
        let still = if is_prompt(gap, delay) {
            (gap - 1 - early).max(2 * MARGIN)
        } else {
            2 * MARGIN
        };
        Quiet { early, still }
    }
}

/// The bits of `clocks` rising edges, one gap apart from the first one on, move by move. None may be where it should be quiet,
/// and one at most between two bits.
#[inline(always)]
fn bits_between_moves(
    answer: Answer,
    first: u32,
    gap: u32,
    clocks: u32,
    quiet: Quiet,
) -> Option<Bits> {
    // A move counts for the first bit whose early place is not before it.
    let origin = first + quiet.early + 1;
    let (per_gap, mut least) = ((1 << 32) / u64::from(gap) + 1, 0);
    let mut bits = Bits::default();
    for place in answer.moves {
        let behind = place + gap - origin;
        // Exact, as both are less than 2^15.
        let bit = ((u64::from(behind) * per_gap) >> 32) as u32;
        if bit < least || behind - bit * gap < quiet.still {
            return None;
        }
        bits.turn(bit);
        least = bit + 1;
    }
    bits.len = clocks;
    bits.turns_to_levels();
    (least <= clocks && !bits.last()).then_some(bits)
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

/// Places in many blocks, lowest first, as far as the end. Where one block is over and the next one begins is data like any
/// other: a branch on it would be guessed wrong for most blocks.
#[derive(Clone)]
struct Moves<'a> {
    moved: &'a [Moved; ROOM],
    /// Wraps around behind the last block that there may be, where nothing is looked at any more.
    at: u8,
    /// Those of this block that are still to come.
    left: u64,
    end: u32,
}

impl Iterator for Moves<'_> {
    type Item = u32;

    #[inline(always)]
    fn next(&mut self) -> Option<u32> {
        let place = self.moved[usize::from(self.at)].base + self.left.trailing_zeros();
        if place == self.end {
            return None;
        }
        self.left &= self.left.wrapping_sub(1);
        let over = self.left == 0;
        self.at = self.at.wrapping_add(over.into());
        self.left |= self.moved[usize::from(self.at)].places & u64::from(over).wrapping_neg();
        Some(place)
    }
}

/// Where MA rises, block by block; it was 1 before.
#[derive(Clone)]
struct Rises<'a> {
    ma: std::slice::Iter<'a, u64>,
    high: u64,
}

impl Rises<'_> {
    #[inline(always)]
    fn new(ma: &[u64]) -> Rises<'_> {
        Rises {
            ma: ma.iter(),
            high: 1,
        }
    }
}

impl Iterator for Rises<'_> {
    type Item = u64;

    #[inline(always)]
    fn next(&mut self) -> Option<u64> {
        let ma = *self.ma.next()?;
        let rises = ma & !(ma << 1 | self.high);
        self.high = ma >> 63;
        Some(rises)
    }
}

/// Whether SLO could move so long ahead of its own edge that the slicer takes it for the end of the cycle.
#[inline(always)]
fn is_prompt(gap: u32, delay: u32) -> bool {
    delay < gap / 4 + 2
}

/// Follows rising edges that should all be one gap apart.
struct Pace {
    gap: u32,
    /// The first edge, which has none before it.
    block: usize,
    alone: u64,
    /// Edges of the block before.
    previous: u64,
    /// Where the next one is due, for gaps longer than a block.
    due: u32,
}

impl Pace {
    #[inline(always)]
    fn new(clock: &Clock, gap: u32) -> Pace {
        Pace {
            gap,
            block: clock.first as usize / BLOCK,
            alone: 1 << (clock.first % BLOCK as u32),
            previous: 0,
            due: clock.first,
        }
    }

    /// Ones are at least four apart, so none can hide between two others: it would have to be a gap behind one more itself.
    #[inline(always)]
    fn keeps(&mut self, index: usize, rises: u64) -> bool {
        if self.gap < BLOCK as u32 {
            let behind = rises << self.gap | self.previous >> (BLOCK as u32 - self.gap);
            let odd = rises & !behind;
            self.previous = rises;
            return odd == if index == self.block { self.alone } else { 0 };
        }
        let mut keeps = true;
        for at in places(rises) {
            keeps &= (index * BLOCK) as u32 + at == self.due;
            self.due += self.gap;
        }
        keeps
    }
}

/// A bit for each clock, most significant first.
#[derive(Default)]
struct Bits {
    words: [u64; WORDS],
    len: u32,
}

impl Bits {
    /// More bits, which come least significant first.
    #[inline(always)]
    fn push(&mut self, bits: u64, count: u32) {
        let (word, place) = (self.len as usize / 64 % WORDS, self.len % 64);
        self.words[word] |= bits << place;
        if place + count > 64 {
            self.words[(word + 1) % WORDS] |= bits >> (64 - place);
        }
        self.len += count;
    }

    #[inline(always)]
    fn most_significant_first(&mut self) {
        for word in self.used() {
            *word = word.reverse_bits();
        }
    }

    #[inline(always)]
    fn used(&mut self) -> impl Iterator<Item = &mut u64> {
        self.words.iter_mut().take(self.len.div_ceil(64) as usize)
    }

    /// How often they change after a 1 before them.
    #[inline(always)]
    fn changes(&self) -> u32 {
        let (mut changes, mut before) = (0, 1 << 63);
        let used = self.len.div_ceil(64) as usize;
        for (index, word) in self.words[..used.min(WORDS)].iter().enumerate() {
            let here = (self.len - 64 * index as u32).min(64);
            let moves = word ^ (word >> 1 | before);
            changes += (moves >> (64 - here)).count_ones();
            before = word << 63;
        }
        changes
    }

    /// Each bit once: from this one on they are others.
    #[inline(always)]
    fn turn(&mut self, bit: u32) {
        self.words[bit as usize / 64 % WORDS] ^= 1 << (63 - bit % 64);
    }

    /// What was 1 before becomes what it is behind all turns.
    #[inline(always)]
    fn turns_to_levels(&mut self) {
        let mut before = !0;
        for word in self.used() {
            for by in [1, 2, 4, 8, 16, 32] {
                *word ^= *word >> by;
            }
            *word ^= before;
            before = (*word & 1).wrapping_neg();
        }
    }

    #[inline(always)]
    fn last(&self) -> bool {
        let last = self.len.saturating_sub(1);
        self.words[last as usize / 64 % WORDS] >> (63 - last % 64) & 1 == 1
    }
}
