//! A sampled recording, looked through for edges: 64 samples at a time, and most of them are passed over.
//!
//! A cycle at a steady clock in which nothing is out of the ordinary is read as a whole, from words of 64 samples each
//! (`scan/region.rs`). Everything else goes through the [`Slicer`] change by change, and what the first way
//! says is what the second one would have said: [`Scanner::plain`] takes the second one always, and tests compare them.

mod region;
mod step;
mod wide;

pub(crate) use region::Regular;

use crate::slice::Slicer;
use region::{BLOCK, Block, Region, places};
use step::Step;
use wide::{Job, Wide};

/// Where a channel stands in a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// From the first byte of a sample.
    pub byte: usize,
    /// 0 is the least significant.
    pub bit: u8,
}

impl Place {
    /// Channel number `channel` of samples whose channels are counted from the first byte's least significant bit.
    pub fn of(channel: usize) -> Place {
        Place {
            byte: channel / 8,
            bit: (channel % 8) as u8,
        }
    }

    fn level(self, sample: &[u8]) -> bool {
        sample[self.byte] >> self.bit & 1 == 1
    }
}

/// Finds the cycles in samples that come piece by piece, for a [`Slicer`].
#[derive(Clone, Debug)]
pub struct Scanner {
    step: Step,
    unit: usize,
    ma: Place,
    slo: Place,
    /// Samples that were looked through.
    samples: u64,
    /// Both levels there; none before the first one.
    levels: Option<(bool, bool)>,
    /// Samples that do not make a block yet.
    rest: Vec<u8>,
    region: Box<Region>,
    way: Way,
    /// Cycles that were read as a whole.
    wholes: u64,
}

/// How a scanner works.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Way {
    Widest,
    Portable,
    Plain,
}

impl Scanner {
    /// For samples of `unit` bytes, one every `step_fs` femtoseconds.
    ///
    /// # Panics
    /// Where a channel stands outside a sample.
    pub fn new(step_fs: u64, unit: usize, ma: Place, slo: Place) -> Scanner {
        assert!(ma.byte < unit && slo.byte < unit && ma.bit < 8 && slo.bit < 8);
        Scanner {
            step: Step::fs(step_fs),
            unit,
            ma,
            slo,
            samples: 0,
            levels: None,
            rest: Vec::with_capacity(BLOCK * unit),
            region: Region::new(),
            way: Way::Widest,
            wholes: 0,
        }
    }

    /// Without instructions that only some processors have.
    pub fn portable(self) -> Scanner {
        Scanner {
            way: Way::Portable,
            ..self
        }
    }

    /// Every change goes through the slicer: what the fast way is measured by.
    pub fn plain(self) -> Scanner {
        Scanner {
            way: Way::Plain,
            ..self
        }
    }

    /// How many cycles were read as a whole so far, and not change by change.
    pub fn wholes(&self) -> u64 {
        self.wholes
    }

    /// The time of the next sample.
    pub fn now_ns(&self) -> u64 {
        let rest = self.rest.len() / self.unit;
        self.step.ns(self.samples + rest as u64)
    }

    /// Looks through whole samples; returns how many bytes that were.
    pub fn scan(&mut self, bytes: &[u8], slicer: &mut Slicer) -> usize {
        let whole = bytes.len() - bytes.len() % self.unit;
        let mut bytes = &bytes[..whole];
        let block = BLOCK * self.unit;
        if !self.rest.is_empty() {
            let more = bytes.len().min(block - self.rest.len());
            self.rest.extend_from_slice(&bytes[..more]);
            bytes = &bytes[more..];
            if self.rest.len() < block {
                return whole;
            }
            let rest = std::mem::take(&mut self.rest);
            self.blocks(&rest, slicer);
            self.rest = rest;
            self.rest.clear();
        }
        let blocks = bytes.len() - bytes.len() % block;
        self.blocks(&bytes[..blocks], slicer);
        self.rest.extend_from_slice(&bytes[blocks..]);
        whole
    }

    /// The samples are over.
    pub fn finish(&mut self, slicer: &mut Slicer) {
        self.replay(slicer);
        let rest = std::mem::take(&mut self.rest);
        self.one_by_one(&rest, slicer);
        slicer.finish(self.now_ns());
    }

    fn blocks(&mut self, bytes: &[u8], slicer: &mut Slicer) {
        if self.way == Way::Plain || slicer.keeps_waveform() {
            // Somebody may have asked for the waveform in the middle of a cycle.
            self.replay(slicer);
            return self.one_by_one(bytes, slicer);
        }
        if bytes.is_empty() {
            return;
        }
        if self.levels.is_none() {
            self.one_by_one(&bytes[..self.unit], slicer);
            // Seen again below, as no change.
            self.samples = 0;
        }
        let way = self.way;
        let scan = Blocks {
            scanner: self,
            bytes,
            slicer,
        };
        match way {
            Way::Widest => wide::widest(scan),
            _ => wide::portable(scan),
        }
    }

    /// Sample by sample.
    fn one_by_one(&mut self, bytes: &[u8], slicer: &mut Slicer) {
        for sample in bytes.chunks_exact(self.unit) {
            let levels = (self.ma.level(sample), self.slo.level(sample));
            if self.levels != Some(levels) {
                slicer.push(self.step.ns(self.samples), levels.0, Some(levels.1));
                self.levels = Some(levels);
            }
            self.samples += 1;
        }
    }

    /// Hands the changes of the region to the slicer after all.
    fn replay(&mut self, slicer: &mut Slicer) {
        for (sample, ma, slo) in self.region.changes() {
            slicer.push(self.step.ns(sample), ma, Some(slo));
        }
        self.region.clear();
    }
}

/// Blocks of samples, to be looked through.
struct Blocks<'a> {
    scanner: &'a mut Scanner,
    bytes: &'a [u8],
    slicer: &'a mut Slicer,
}

impl Job for Blocks<'_> {
    #[inline(always)]
    fn run<W: Wide>(self) {
        match self.scanner.unit {
            1 => self.all::<W, 1>(),
            2 => self.all::<W, 2>(),
            _ => self.all::<W, 0>(),
        }
    }
}

impl Blocks<'_> {
    /// `UNIT` is the size of a sample, 0 that of the scanner.
    #[inline(always)]
    fn all<W: Wide, const UNIT: usize>(self) {
        let Blocks {
            scanner,
            bytes,
            slicer,
        } = self;
        let unit = if UNIT == 0 { scanner.unit } else { UNIT };
        let size = BLOCK * unit;
        let mut reader = Reader::new(scanner);
        let mut rest = bytes;
        // Where something has moved, something is likely to move on.
        let mut likely = false;
        while rest.len() >= size {
            let quiet = if likely {
                0
            } else {
                reader.quiet::<W>(rest, unit)
            };
            if quiet > 0 {
                if !scanner.region.is_empty() {
                    scanner.rests::<W>(quiet, slicer);
                }
                scanner.samples += (quiet * BLOCK) as u64;
                rest = &rest[quiet * size..];
                continue;
            }
            let (bytes, behind) = rest.split_at(size);
            W::ahead(bytes);
            let (ma, slo) = reader.levels::<W>(bytes, unit);
            let before = reader.levels;
            let block = Block::new(ma, slo, before);
            likely = block.moves() != 0;
            if !likely {
                continue;
            }
            scanner.moves::<W>(before, block, slicer);
            reader.levels = block.last();
            scanner.samples += BLOCK as u64;
            rest = behind;
        }
        scanner.levels = Some((reader.levels.0 == 1, reader.levels.1 == 1));
    }
}

impl Scanner {
    /// Nothing has moved for so many blocks.
    #[inline(always)]
    fn rests<W: Wide>(&mut self, blocks: usize, slicer: &mut Slicer) {
        if !self.region.is_full() {
            self.region.push_quiet(blocks);
            let more = !self.region.is_over() && !self.region.is_full();
            if more || self.region.is_over() && self.whole::<W>(false, slicer) {
                return;
            }
        }
        self.replay(slicer);
    }

    /// Whether the region is one ordinary cycle; then it is handed over. `fell` says that MA falls with the next sample.
    #[inline(always)]
    fn whole<W: Wide>(&mut self, fell: bool, slicer: &mut Slicer) -> bool {
        let regular = self
            .region
            .regular::<W>(self.step, slicer.timeout_ns(), fell);
        if let Some(regular) = regular {
            slicer.accept(regular);
            self.region.clear();
            self.wholes += 1;
        }
        regular.is_some()
    }

    /// Something has moved.
    #[inline(always)]
    fn moves<W: Wide>(&mut self, mut before: (u64, u64), mut block: Block, slicer: &mut Slicer) {
        if !self.region.is_empty() {
            if self.region.is_full() {
                self.replay(slicer);
            } else if let Some(fall) = self.region.begins_anew(block) {
                // What is before that belongs to the cycle that is over.
                let Block { ma, slo, .. } = block;
                let ones = !0 << fall;
                let until = Block::new(!0, slo | ones, before);
                self.region.push(self.samples, until);
                if !self.whole::<W>(true, slicer) {
                    self.replay(slicer);
                }
                before = (1, 1);
                block = Block::new(ma, slo | !ones, before);
            } else {
                self.region.push(self.samples, block);
                return;
            }
        }
        let Block { ma, slo, .. } = block;
        let moved = block.moves();
        let first_ns = self
            .step
            .ns(self.samples + u64::from(moved.trailing_zeros()));
        if before == (1, 1) && slicer.is_calm(first_ns) {
            self.region.push(self.samples, block);
            return;
        }
        for at in places(moved) {
            let t_ns = self.step.ns(self.samples + u64::from(at));
            slicer.push(t_ns, ma >> at & 1 == 1, Some(slo >> at & 1 == 1));
        }
    }
}

/// Takes both wires out of blocks of samples.
struct Reader {
    ma: Place,
    slo: Place,
    levels: (u64, u64),
}

impl Reader {
    fn new(scanner: &Scanner) -> Reader {
        Reader {
            ma: scanner.ma,
            slo: scanner.slo,
            levels: scanner
                .levels
                .map_or((1, 1), |(ma, slo)| (ma.into(), slo.into())),
        }
    }

    /// For how many blocks both wires stay as they are.
    #[inline(always)]
    fn quiet<W: Wide>(&self, bytes: &[u8], unit: usize) -> usize {
        let (ma, slo) = (1 << self.ma.bit, 1 << self.slo.bit);
        let size = BLOCK * unit;
        if unit == 1 {
            let level =
                (self.levels.0 as u8) << self.ma.bit | (self.levels.1 as u8) << self.slo.bit;
            return W::quiet(bytes, level, ma | slo);
        }
        let strange = |sample: &[u8]| {
            let levels = (
                u64::from(sample[self.ma.byte] & ma != 0),
                u64::from(sample[self.slo.byte] & slo != 0),
            );
            u8::from(levels != self.levels)
        };
        let quiet = |block: &&[u8]| {
            let samples = block.chunks_exact(unit);
            samples.fold(0, |all, sample| all | strange(sample)) == 0
        };
        bytes.chunks_exact(size).take_while(quiet).count()
    }

    /// Both wires, sample by sample, the first one least significant.
    #[inline(always)]
    fn levels<W: Wide>(&self, bytes: &[u8], unit: usize) -> (u64, u64) {
        if let (1, Ok(block)) = (unit, bytes.try_into()) {
            return (W::pick(block, self.ma.bit), W::pick(block, self.slo.bit));
        }
        let (mut ma, mut slo) = (0, 0);
        for (at, sample) in bytes.chunks_exact(unit).enumerate() {
            ma |= u64::from(self.ma.level(sample)) << at;
            slo |= u64::from(self.slo.level(sample)) << at;
        }
        (ma, slo)
    }
}
