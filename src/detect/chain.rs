//! How the bits behind CDS can be cut into channels, each with a CRC that fits.
//!
//! In a window that ends with a CRC the difference (exclusive or) of any two frames is divisible by the generator,
//! whatever start value and inversion are: they add the same constant to every frame of that length. So known generators
//! are tried, and others are the greatest common divisor of differences. Windows chain from CDS to the stop bit.

use super::gf2;
use crate::crc::Crc;
use crate::format::{MAX_CHANNELS, MAX_DATA_BITS};
use crate::trace::Bits;

/// Different frames that are looked at.
pub(super) const MAX_GROUPS: usize = 128;
/// Generators of fewer bits than that are not looked for.
pub(super) const MIN_CRC: u32 = 3;
const MAX_CRC: u32 = 16;
/// An unknown generator takes so many independent differences: fewer are divisible by too much. A usual start value is one
/// more thing that has to fit.
const MIN_RANK: u32 = 3;
const MIN_RANK_USUAL: u32 = 1;
/// Ways to go on that are kept at each bit.
const BEAM: usize = 64;
/// log2 of the odds against the likeliest way to a bit from which on others are given up.
const BEHIND: f64 = 24.0;
/// log2 of the odds below which a channel is not worth going on with.
const HOPELESS: f64 = -16.0;
/// log2 of the odds within which chains compete by the frames that they lose, and what each frame too many costs.
const RIVAL: f64 = 120.0;
const LOSS: f64 = 5.0;
/// Of the frames, how many in the end have to fit, in percent.
const LEAST_GOOD: u32 = 60;

/// Polynomials that stand in data sheets, and how likely each is met: 0x43 is that of the standard encoder profile.
pub(super) const KNOWN: [(u32, f64); 8] = [
    (0x43, 0.62),
    (0x25, 0.06),
    (0x190D9, 0.06),
    (0x12F, 0.05),
    (0x197, 0.03),
    (0x13, 0.03),
    (0xB, 0.02),
    (0x89, 0.02),
];
/// All others together; each width gets the same share.
const UNKNOWN: f64 = 0.11;

/// How likely a frame has 1, 2, 3 … channels.
const CHANNELS: [f64; MAX_CHANNELS] = [0.78, 0.15, 0.04, 0.015, 0.006, 0.004, 0.003, 0.002];

/// Which start value and inversion a constant stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Constant {
    /// Start value 0, inverted, as BiSS has it.
    Usual,
    /// Start value 0, not inverted.
    Plain,
    /// All ones, inverted.
    Ones,
    /// All ones, not inverted.
    PlainOnes,
    /// Something else.
    Other,
}

impl Constant {
    fn likelihood(self) -> f64 {
        match self {
            Constant::Usual => 0.88,
            Constant::Plain => 0.05,
            Constant::PlainOnes => 0.01,
            Constant::Ones => 0.01,
            Constant::Other => 0.05,
        }
    }
}

/// A set of frames, by their index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Set([u64; MAX_GROUPS / 64]);

impl Set {
    const NONE: Set = Set([0; MAX_GROUPS / 64]);

    fn add(&mut self, index: usize) {
        self.0[index / 64] |= 1 << (index % 64);
    }

    fn has(&self, index: usize) -> bool {
        self.0[index / 64] >> (index % 64) & 1 == 1
    }

    fn and(mut self, other: &Set) -> Set {
        self.0.iter_mut().zip(other.0).for_each(|(a, b)| *a &= b);
        self
    }
}

/// Frames that are alike.
#[derive(Clone, Debug)]
pub(super) struct Group {
    /// What comes behind CDS.
    pub(super) bits: Bits,
    /// How many of them.
    pub(super) count: u32,
    /// How many bits up to the last 1.
    pub(super) ones_end: usize,
}

/// All that is looked at.
#[derive(Clone, Debug, Default)]
pub(super) struct Frames {
    pub(super) groups: Vec<Group>,
    pub(super) total: u32,
    /// Bits that are known of each.
    pub(super) len: usize,
}

/// A channel that fits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fit {
    pub(super) from: usize,
    pub(super) data_bits: u8,
    pub(super) crc_bits: u8,
    pub(super) poly: u32,
    /// What the frames have in common behind the division.
    pub(super) constant: u16,
    /// Independent differences between frames.
    pub(super) rank: u32,
    /// Frames that fit.
    good: Set,
    /// log2 of its odds against bits without a check.
    pub(super) score: f64,
}

impl Fit {
    /// Whether this frame fits.
    pub(super) fn fits(&self, bits: &Bits) -> bool {
        let window = window(bits, self.from, self.end() - self.from);
        gf2::remainder(window, self.poly.into()) == u128::from(self.constant)
    }

    pub(super) fn end(&self) -> usize {
        self.from + usize::from(self.data_bits) + usize::from(self.crc_bits)
    }

    /// Whether its CRC is not known.
    pub(super) fn is_opaque(&self) -> bool {
        self.poly == 0
    }

    /// A CRC of that constant; of several, all of which are the same at this length, the most usual one.
    pub(super) fn crc(&self) -> Option<Crc> {
        let mask = ((1u32 << self.crc_bits) - 1) as u16;
        let make = |init, inverted| Crc::new(self.crc_bits, self.poly, init, inverted).ok();
        match class(self.poly, self.crc_bits, self.data_bits, self.constant) {
            Constant::Usual => make(0, true),
            Constant::Plain => make(0, false),
            Constant::Ones => make(mask, true),
            Constant::PlainOnes => make(mask, false),
            Constant::Other => {
                let wanted = self.constant ^ mask;
                make(start_value(self.poly, self.data_bits, wanted), true)
            }
        }
    }
}

/// Shifts a register back over `len` zeros: the start value that leaves `wanted` behind them.
fn start_value(poly: u32, len: u8, wanted: u16) -> u16 {
    let back = |register: u32, _| match register & 1 {
        1 => (register ^ poly) >> 1,
        _ => register >> 1,
    };
    (0..len).fold(u32::from(wanted), back) as u16
}

fn class(poly: u32, crc_bits: u8, data_bits: u8, constant: u16) -> Constant {
    let mask = ((1u32 << crc_bits) - 1) as u16;
    let ones = |constant| start_value(poly, data_bits, constant) == mask;
    match constant {
        _ if constant == mask => Constant::Usual,
        0 => Constant::Plain,
        _ if ones(constant) => Constant::PlainOnes,
        _ if ones(constant ^ mask) => Constant::Ones,
        _ => Constant::Other,
    }
}

/// Channels one after the other up to the stop bit.
#[derive(Clone, Debug)]
pub(super) struct Chain {
    pub(super) fits: Vec<Fit>,
    /// How many frames fit.
    pub(super) weight: u32,
    /// log2 of its odds, up to a constant that all have in common.
    pub(super) score: f64,
}

/// All ways that are worth telling, the likeliest first; and log2 of the odds that it is none of them.
pub(super) fn search(frames: &Frames) -> (Vec<Chain>, f64) {
    let search = Search::new(frames);
    let is_opaque = |chain: &Chain| chain.fits.iter().any(Fit::is_opaque);
    let (opaque, mut found): (Vec<Chain>, Vec<Chain>) =
        search.chains().into_iter().partition(is_opaque);
    let opaque = opaque.iter().map(|chain| chain.score);
    let none = opaque.fold(search.none(), sum);
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    // Noise takes frames from the right one as from all others, and a few less from one that checks less. What loses far more
    // than another that is about as well checked is wrong.
    if let Some(best) = found.first().map(|chain| chain.score) {
        let lost = |chain: &Chain| frames.total - chain.weight;
        let rivals = found.iter().filter(|chain| chain.score > best - RIVAL);
        let borne = 2 * rivals.map(lost).min().unwrap_or(0) + 2;
        for chain in &mut found {
            chain.score -= LOSS * f64::from(lost(chain).saturating_sub(borne));
        }
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
    }
    (found, none)
}

/// The odds of either, as logarithms.
fn sum(a: f64, b: f64) -> f64 {
    let (least, most) = (a.min(b), a.max(b));
    most + (1.0 + (least - most).exp2()).log2()
}

struct Search<'a> {
    frames: &'a Frames,
    known: Vec<(Crc, f64)>,
    /// Groups that independent differences are counted in, by their index.
    sample: Vec<usize>,
    /// A few frames by chance: what fits fits most of them.
    glance: Vec<usize>,
    /// Small samples, among which some have no frame with a bit error.
    samples: Vec<Vec<usize>>,
    /// Smaller ones: where no differences of these have a divisor, there is none.
    screens: Vec<Vec<usize>>,
}

const GLANCE: usize = 16;
const SAMPLES: usize = 36;
const SCREENS: usize = 9;
/// Divisors of differences that are tried: where the lowest bits of a position count, they may all be multiples of one
/// polynomial with many.
const DIVISORS: usize = 256;

/// Frames of which independent differences are counted. Of thousands, bit errors that a short CRC lets pass would be
/// among them, and count for the short one.
const SAMPLE: usize = 64;

/// Ways to a bit, until it is known what follows.
struct Partial {
    fits: Vec<Fit>,
    good: Set,
    weight: u32,
    score: f64,
}

impl<'a> Search<'a> {
    fn new(frames: &'a Frames) -> Search<'a> {
        let known = KNOWN.iter().filter_map(|(poly, share)| {
            let crc = Crc::new(poly.ilog2() as u8, *poly, 0, false).ok()?;
            Some((crc, *share))
        });
        let mut random = Random(0);
        let groups = frames.groups.iter().enumerate();
        let tickets: Vec<usize> = groups
            .flat_map(|(index, group)| std::iter::repeat_n(index, group.count as usize))
            .collect();
        let mut draw = |size: usize| -> Vec<usize> {
            let one = |_| tickets[(random.next() % tickets.len() as u64) as usize];
            (0..size).map(one).collect()
        };
        let mut sample: Vec<usize> = (0..frames.groups.len()).collect();
        if tickets.len() > SAMPLE {
            sample = draw(SAMPLE);
            sample.sort_unstable();
            sample.dedup();
        }
        Search {
            frames,
            known: known.collect(),
            sample,
            glance: draw(GLANCE),
            screens: (0..SCREENS).map(|_| draw(4)).collect(),
            samples: (0..SAMPLES)
                .map(|sample| draw([6, 12, 24][sample % 3]))
                .collect(),
        }
    }

    fn weight(&self, set: &Set) -> u32 {
        let counts = self.frames.groups.iter().enumerate();
        let within = counts.filter(|(index, _)| set.has(*index));
        within.map(|(_, group)| group.count).sum()
    }

    fn enough(&self, weight: u32) -> bool {
        weight > 0 && 100 * u64::from(weight) >= u64::from(LEAST_GOOD * self.frames.total)
    }

    /// Frames with nothing but zeros from `end` on.
    fn ended_by(&self, end: usize) -> Set {
        let mut set = Set::NONE;
        for (index, group) in self.frames.groups.iter().enumerate() {
            if group.ones_end <= end {
                set.add(index);
            }
        }
        set
    }

    /// Of no check at all.
    fn none(&self) -> f64 {
        let ends = (0..self.frames.len).find(|end| self.enough(self.weight(&self.ended_by(*end))));
        0.01f64.log2() - 6.0 - ends.unwrap_or(self.frames.len) as f64
    }

    fn chains(&self) -> Vec<Chain> {
        let mut at: Vec<Vec<Partial>> = Vec::new();
        at.resize_with(self.frames.len + 1, Vec::new);
        at[0].push(Partial {
            fits: Vec::new(),
            good: self.all(),
            weight: self.frames.total,
            score: 0.0,
        });
        let mut found = Vec::new();
        for bit in 0..at.len() {
            let mut here = std::mem::take(&mut at[bit]);
            self.leave_likely(&mut here);
            if here.is_empty() {
                continue;
            }
            let ended = self.ended_by(bit);
            // The stop bit has to be seen.
            if bit > 0 && bit < self.frames.len {
                found.extend(
                    here.iter()
                        .filter_map(|way| self.finished(way, &ended, bit)),
                );
            }
            let goes_on = !self.enough(self.weight(&ended))
                || self.weight(&ended) * 4 < self.frames.total * 3;
            here.retain(|way| way.fits.len() < MAX_CHANNELS);
            if here.is_empty() || !goes_on {
                continue;
            }
            for fit in self.fits(bit) {
                for way in &here {
                    // Two of them explain anything.
                    if fit.is_opaque() && way.fits.iter().any(Fit::is_opaque) {
                        continue;
                    }
                    let good = way.good.and(&fit.good);
                    let score = way.score + fit.score;
                    let there = &mut at[fit.end()];
                    let weight = self.weight(&good);
                    if self.enough(weight) {
                        let fits = way.fits.iter().copied().chain([fit]).collect();
                        there.push(Partial {
                            fits,
                            good,
                            weight,
                            score,
                        });
                    }
                    if there.len() > 4 * BEAM {
                        self.leave_likely(there);
                    }
                }
            }
        }
        found
    }

    /// Of the ways to one bit the likeliest, by what they check and what they lose.
    fn leave_likely(&self, ways: &mut Vec<Partial>) {
        let lost = |way: &Partial| self.frames.total - way.weight;
        let closed = |way: &&Partial| !way.fits.iter().any(Fit::is_opaque);
        let borne = 2 * ways.iter().filter(closed).map(lost).min().unwrap_or(0) + 2;
        let worth = |way: &Partial| way.score - LOSS * f64::from(lost(way).saturating_sub(borne));
        ways.sort_by(|a, b| worth(b).total_cmp(&worth(a)));
        ways.truncate(BEAM);
        if let Some(best) = ways.first().map(worth) {
            ways.retain(|way| worth(way) > best - BEHIND);
        }
    }

    fn finished(&self, way: &Partial, ended: &Set, end: usize) -> Option<Chain> {
        let good = way.good.and(ended);
        let weight = self.weight(&good);
        let channels = CHANNELS.get(way.fits.len().wrapping_sub(1))?;
        // Every bit behind the end has to be 0, one in the frame may be anything.
        let score = way.score + channels.log2() - end as f64;
        self.enough(weight).then(|| Chain {
            fits: way.fits.clone(),
            weight,
            score,
        })
    }

    /// Channels that can begin there.
    fn fits(&self, from: usize) -> Vec<Fit> {
        let mut found = Vec::new();
        let longest = (MAX_DATA_BITS + MAX_CRC) as usize;
        for len in MIN_CRC as usize + 1..=longest {
            if from + len >= self.frames.len {
                break;
            }
            let windows: Vec<u128> = self
                .frames
                .groups
                .iter()
                .map(|group| window(&group.bits, from, len))
                .collect();
            found.extend(self.opaque(from, len, &windows));
            let mut add = |poly: u32, share: f64, rest: &dyn Fn(u128) -> u16| {
                found.extend(self.fit(from, len, &windows, poly, share, rest));
            };
            for (crc, share) in &self.known {
                let bits = crc.bits();
                let mask = (1u128 << bits) - 1;
                let rest = |window: u128| {
                    let data_bits = (len - usize::from(bits)) as u8;
                    crc.of((window >> bits) as u64, data_bits) ^ (window & mask) as u16
                };
                if len > usize::from(bits) && len - usize::from(bits) <= MAX_DATA_BITS as usize {
                    add(crc.poly(), *share, &rest);
                }
            }
            for poly in self.unknown(&windows) {
                let bits = poly.ilog2();
                let share =
                    UNKNOWN / f64::from(MAX_CRC - MIN_CRC + 1) / f64::from(1u32 << (bits - 1));
                let rest = |window| gf2::remainder(window, poly.into()) as u16;
                if len > bits as usize && len - bits as usize <= MAX_DATA_BITS as usize {
                    add(poly, share, &rest);
                }
            }
        }
        found
    }

    fn fit(
        &self,
        from: usize,
        len: usize,
        windows: &[u128],
        poly: u32,
        share: f64,
        rest: &dyn Fn(u128) -> u16,
    ) -> Option<Fit> {
        let mut few: Vec<u16> = self
            .glance
            .iter()
            .map(|index| rest(windows[*index]))
            .collect();
        few.sort_unstable();
        let most = few.chunk_by(|a, b| a == b).map(<[u16]>::len).max();
        if most < Some(GLANCE / 4) {
            return None;
        }
        let rests: Vec<u16> = windows.iter().map(|window| rest(*window)).collect();
        let constant = self.majority(&rests)?;
        let mut good = Set::NONE;
        let mut weight = 0;
        for (index, rest) in rests.iter().enumerate() {
            if *rest == constant {
                good.add(index);
                weight += self.frames.groups[index].count;
            }
        }
        if !self.enough(weight) {
            return None;
        }
        let mut fitting = self
            .sample
            .iter()
            .filter(|index| good.has(**index))
            .map(|index| windows[*index]);
        let first = fitting.next()?;
        let differences: Vec<u128> = fitting.map(|window| window ^ first).collect();
        let ever = differences.iter().fold(0, |ever, one| ever | one);
        // A place where nothing ever is, is no channel.
        if first == 0 && ever == 0 {
            return None;
        }
        let rank = gf2::rank(differences.into_iter());
        let known = KNOWN.iter().any(|(known, _)| *known == poly);
        let crc_bits = poly.ilog2() as u8;
        let data_bits = (len - usize::from(crc_bits)) as u8;
        let class = class(poly, crc_bits, data_bits, constant);
        let least = match (known, class) {
            (true, Constant::Other) => 1,
            (true, _) => 0,
            (false, Constant::Other) => MIN_RANK,
            (false, _) => MIN_RANK_USUAL,
        };
        if rank < least {
            return None;
        }
        let moving = (ever & ((1 << crc_bits) - 1)).count_ones();
        let set = match class {
            Constant::Other => 0,
            _ => crc_bits,
        };
        let width = if data_bits < 8 {
            1.0 / 512.0
        } else {
            1.0 / 64.0
        };
        let prior = share * class.likelihood() * width;
        let score = prior.log2() + f64::from(rank * moving) + f64::from(set);
        (score > HOPELESS).then_some(Fit {
            from,
            data_bits,
            crc_bits,
            poly,
            constant,
            rank,
            good,
            score,
        })
    }

    /// Of the generators that divide a divisor of few differences those that leave what a usual start value does: 0 plain,
    /// all ones inverted.
    fn with_usual_start(&self, divisor: u128, windows: &[u128]) -> Vec<u32> {
        const EACH: usize = 8;
        let mut found = Vec::new();
        for frame in self.glance.iter().take(2).map(|index| windows[*index]) {
            let plain = gf2::gcd(divisor, frame);
            found.extend(gf2::divisors(plain, MIN_CRC, MAX_CRC, EACH));
            for bits in MIN_CRC..=MAX_CRC {
                let inverted = gf2::odd(gf2::gcd(divisor, frame ^ ((1 << bits) - 1)));
                if inverted >= 1 << bits {
                    found.extend(gf2::divisors(inverted, bits, bits, EACH));
                }
            }
        }
        found
    }

    fn rank(&self, windows: &[u128]) -> u32 {
        let first = self.sample.first().map_or(0, |index| windows[*index]);
        gf2::rank(self.sample.iter().map(|index| windows[*index] ^ first))
    }

    /// A channel that moves too little to show its CRC, if it has an unknown one.
    fn opaque(&self, from: usize, len: usize, windows: &[u128]) -> Option<Fit> {
        const LEAST: usize = 8 + MIN_CRC as usize;
        let first = self.sample.first().map(|index| windows[*index])?;
        let rank = self.rank(windows);
        (len >= LEAST && first != 0 && rank < MIN_RANK).then(|| Fit {
            from,
            data_bits: (len - MIN_CRC as usize).min(MAX_DATA_BITS as usize) as u8,
            crc_bits: (len - (len - MIN_CRC as usize).min(MAX_DATA_BITS as usize)) as u8,
            poly: 0,
            constant: 0,
            rank,
            good: self.all(),
            // While others move it rarely stands quite still.
            score: match rank == 0 && self.frames.groups.len() > 1 {
                true => (UNKNOWN / 64.0 / 8.0).log2(),
                false => (UNKNOWN / 64.0).log2(),
            },
        })
    }

    fn all(&self) -> Set {
        let mut all = Set::NONE;
        (0..self.frames.groups.len()).for_each(|index| all.add(index));
        all
    }

    /// What more than half of the frames have, if there is such a thing.
    fn majority(&self, rests: &[u16]) -> Option<u16> {
        let (mut leader, mut lead) = (None, 0);
        for (rest, group) in rests.iter().zip(&self.frames.groups) {
            if leader == Some(*rest) {
                lead += group.count;
            } else if group.count > lead {
                (leader, lead) = (Some(*rest), group.count - lead);
            } else {
                lead -= group.count;
            }
        }
        leader
    }

    /// Generators that divide the differences of the windows: of small samples, so that some have no bit errors in them.
    fn unknown(&self, windows: &[u128]) -> Vec<u32> {
        const AGREE: usize = 3;
        if windows.len() < 2 {
            return Vec::new();
        }
        let divides = |sample: &Vec<usize>| common_divisor(windows, sample) >= 1 << MIN_CRC;
        if !self.screens.iter().any(divides) {
            return Vec::new();
        }
        let mut common: Vec<(u128, usize)> = Vec::new();
        for sample in &self.samples {
            let found = common_divisor(windows, sample);
            if gf2::degree(found).is_none_or(|degree| degree < MIN_CRC) {
                continue;
            }
            match common.iter_mut().find(|(known, _)| *known == found) {
                Some((_, times)) => *times += 1,
                None => common.push((found, 1)),
            }
            if common.iter().any(|(_, times)| *times >= AGREE) {
                break;
            }
        }
        let few = self.rank(windows) < MIN_RANK;
        let mut polys: Vec<u32> = Vec::new();
        for (divisor, _) in common {
            let found = match few {
                true => self.with_usual_start(divisor, windows),
                false => gf2::divisors(divisor, MIN_CRC, MAX_CRC, DIVISORS),
            };
            for poly in found {
                let known = KNOWN.iter().any(|(known, _)| *known == poly);
                if !known && !polys.contains(&poly) {
                    polys.push(poly);
                }
            }
        }
        polys
    }
}

/// Of the differences between the frames of a sample.
fn common_divisor(windows: &[u128], sample: &[usize]) -> u128 {
    let Some((first, others)) = sample.split_first() else {
        return 0;
    };
    let first = windows[*first];
    let mut divisor = 0;
    for other in others {
        divisor = gf2::gcd(divisor, windows[*other] ^ first);
        if divisor != 0 && gf2::odd(divisor) < 1 << MIN_CRC {
            return 0;
        }
    }
    gf2::odd(divisor)
}

/// Chance that repeats (SplitMix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ z >> 31
    }
}

/// `len` bits from `from` on, at most 128, the first one most significant.
pub(super) fn window(bits: &Bits, from: usize, len: usize) -> u128 {
    let word = |at, n| u128::from(bits.word(at, n).unwrap_or(0));
    match len {
        0..=64 => word(from, len),
        _ => word(from, 64) << (len - 64) | word(from + 64, len - 64),
    }
}
