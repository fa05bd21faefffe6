//! What an unknown encoder sends, from its frames alone: where channels and CRCs lie, which CRC, error and warning bits,
//! and how sure that is.
//!
//! A [`Detector`] is fed traces and asked, as often as one likes, what still fits. Nothing is hidden: all formats that fit
//! come back, each with its probability, and so does the probability that it is none of them.
//!
//! How they are weighed. A CRC of n bits fits by chance once in 2ⁿ for every independent difference between frames, so each
//! of these counts n bits for it; bits of the CRC that never change count nothing. Against that stands how likely an
//! encoder is to have such a format at all: by its polynomial (0x43 62 %, other published ones 2 to 6 %, all others
//! together 11 %), its start value and inversion (0 and inverted 88 %), its number of channels (one 78 %), and, for the
//! meaning of bits, whether nE and nW stand before the CRC (82 %) and how they usually stand (both 1, 93 %). A bit more
//! in the frame costs one bit, as it has to be explained. None of them at all is given 1 % from the start.
//!
//! At a fixed length start value and inversion together add one constant to the CRC: frames of that length show the
//! constant only, so the most usual pair that makes it stands for all.

mod chain;
mod fields;
mod gf2;
mod line;
mod listen;

pub use line::Line;
pub use listen::Listen;

use crate::crc::Crc;
use crate::cycle::{Cycle, Fault, Head};
use crate::format::{Channel, Format};
use crate::frame::BissC;
use crate::protocol::Protocol;
use crate::trace::{Bits, Cut, Trace};
use chain::{Chain, Fit, Frames, Group};
use fields::{Reading, Split, Words};
use std::collections::HashMap;
use std::fmt::Write;

/// Formats that are less likely are not told of one by one.
pub const TELL: f64 = 0.001;
/// And one that is the only one left is the answer from here on.
const SURE: f64 = 0.99;
/// Frames that are kept.
const MOST_FRAMES: usize = 4_096;
/// log2 of the odds against the likeliest from which on something is not looked at closely, and how much is.
const FAR: f64 = 13.0;
const NEAR: usize = 64;
/// Answers that are told of.
const MOST_ANSWERS: usize = 64;
/// Of the frames, how many may rest earlier than the others, in percent.
const EARLY: usize = 10;

/// Collects frames and finds what they are.
#[derive(Debug)]
pub struct Detector {
    judge: BissC,
    /// What came behind CDS, in order; nothing where a frame was bad.
    bodies: Vec<Bits>,
    heads: Spreads,
    faults: [u64; Fault::NAMES.len()],
    frames: u64,
    changes: u64,
    longest: usize,
    line: line::Watch,
    cycle: Cycle,
}

/// What the bits of a channel mean, and of all channels, with log2 of the odds.
type Meaning = (Reading, Option<Split>);
type Weighed = (f64, Vec<Meaning>);

/// Least and most of something.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Range {
    /// The least.
    pub min: u64,
    /// The most.
    pub max: u64,
}

impl Range {
    /// Widens a range that may be empty yet.
    pub fn widen(range: &mut Option<Range>, value: u64) {
        let known = range.get_or_insert(Range {
            min: value,
            max: value,
        });
        known.min = known.min.min(value);
        known.max = known.max.max(value);
    }
}

/// What the heads of the frames took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Spreads {
    /// Clocks from Ack to the start bit.
    pub ack: Option<Range>,
    /// The same as time, where both wires are seen.
    pub busy_ns: Option<Range>,
    /// Whole clocks of line delay.
    pub delay_clk: Option<Range>,
    /// Line delay, where it is measured.
    pub delay_ns: Option<Range>,
    /// MA period.
    pub period_ns: Option<Range>,
    /// From the last MA edge to SL = 1 at the slave, where that was seen.
    pub timeout_ns: Option<Range>,
}

/// Everything that was found.
#[derive(Clone, Debug)]
pub struct Findings {
    /// What is on the line at all.
    pub line: Line,
    /// Frames looked at.
    pub frames: u64,
    /// Of these, with Ack and start bit.
    pub answered: u64,
    /// The others, by the index of [`Fault`].
    pub faults: [u64; Fault::NAMES.len()],
    /// Of those that answered, how many different ones.
    pub different: usize,
    /// What their heads took.
    pub heads: Spreads,
    /// All formats that fit, likeliest first.
    pub answers: Vec<Answer>,
    /// How many more fit that are less likely than [`TELL`].
    pub unlikely: usize,
    /// How likely it is one of these.
    pub unlikely_probability: f64,
    /// How likely it is none of all: no CRC, or one that is not looked for.
    pub none_probability: f64,
}

/// A format that fits.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// It.
    pub format: Format,
    /// How likely it is the right one.
    pub probability: f64,
    /// Frames that fit.
    pub good: u64,
    /// Of so many.
    pub frames: u64,
    /// What was seen of each channel.
    pub channels: Vec<Seen>,
}

/// What was seen of a channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Seen {
    /// The CRC.
    pub crc: Crc,
    /// Data bits.
    pub data_bits: u8,
    /// Independent differences between frames: by chance a CRC of n bits fits once in 2 to the power of n times so many.
    pub rank: u32,
    /// Leading data bits that never changed.
    pub still: u8,
    /// Bits of the position at its end that were always 0 while others moved.
    pub zeros: u8,
    /// Turns count against the position.
    pub against: bool,
}

impl Findings {
    /// The only format that fits, if there is only one.
    pub fn only(&self) -> Option<&Answer> {
        match &self.answers[..] {
            [only] if self.line == Line::Biss && self.none_probability < TELL => {
                // Many unlikely ones may be likely together.
                Some(only).filter(|only| only.probability > SURE)
            }
            _ => None,
        }
    }

    /// Hears from the slaves' registers that they send `format`: frames have passed it, so what it says of their bits is
    /// believed. Whether it is among those that fit.
    pub fn hear(&mut self, format: &Format) -> bool {
        /// Registers are wrong once in so many times.
        const RARELY_WRONG: f64 = 10_000.0;
        let same = |answer: &Answer| same_cut(&answer.format, format);
        let Some(first) = self.answers.iter().find(|answer| same(answer)).cloned() else {
            return false;
        };
        let share: f64 = self
            .answers
            .iter()
            .filter(|answer| same(answer))
            .map(|answer| answer.probability)
            .sum();
        self.answers.retain(|answer| !same(answer));
        let sum = share * RARELY_WRONG + (1.0 - share);
        self.answers
            .iter_mut()
            .for_each(|answer| answer.probability /= sum);
        self.none_probability /= sum;
        self.unlikely_probability /= sum;
        self.answers.insert(
            0,
            Answer {
                format: format.clone(),
                probability: share * RARELY_WRONG / sum,
                ..first
            },
        );
        self.leave_out_unlikely();
        true
    }

    /// Tells of likely ones only, likeliest first.
    fn leave_out_unlikely(&mut self) {
        let answers = &mut self.answers;
        answers.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        let told = answers
            .iter()
            .take_while(|answer| answer.probability >= TELL)
            .count();
        for unlikely in answers.drain(told.min(MOST_ANSWERS)..) {
            self.unlikely += 1;
            self.unlikely_probability += unlikely.probability;
        }
    }

    /// All frames that answered were the same, so nothing was seen to move.
    pub fn alike(&self) -> bool {
        self.different <= 1
    }
}

impl Detector {
    /// Reads Ack, start and CDS as `judge` does, whatever its format.
    pub fn new(judge: BissC) -> Detector {
        Detector {
            judge: BissC {
                head_only: true,
                ..judge
            },
            bodies: Vec::new(),
            heads: Spreads::default(),
            faults: [0; Fault::NAMES.len()],
            frames: 0,
            changes: 0,
            longest: 0,
            line: line::Watch::default(),
            cycle: Cycle::default(),
        }
    }

    /// Frames looked at.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Frames that had Ack and start bit.
    pub fn answered(&self) -> u64 {
        self.frames - self.faults.iter().sum::<u64>()
    }

    /// Frames that differ from the one before.
    pub fn changes(&self) -> u64 {
        self.changes
    }

    /// Bits behind CDS up to the last 1 that was ever seen there.
    pub fn longest(&self) -> usize {
        self.longest
    }

    /// Takes one more frame. Pieces of a recording are none.
    pub fn add(&mut self, trace: &Trace) {
        if trace.cut == Some(Cut::Begin) || trace.unconfirmed {
            return;
        }
        self.judge.decode(trace, &mut self.cycle);
        let fault = self.cycle.fault();
        if matches!(fault, Some(Fault::Short { .. })) && trace.cut.is_some() {
            return;
        }
        self.frames += 1;
        self.line.see(trace);
        let mut body = Bits::default();
        match (fault, self.cycle.head()) {
            (None, Some(head)) => {
                self.heads.add(head, trace);
                let from = usize::from(3 + head.clocks());
                body.extend(trace.bits.iter().skip(from));
            }
            (fault, _) => {
                if let Some(fault) = fault {
                    self.faults[fault.index()] += 1;
                }
            }
        }
        self.longest = self.longest.max(ones_end(&body));
        let same = self.bodies.last() == Some(&body);
        self.changes += u64::from(!same);
        // Whoever stands still for long has moving frames to come.
        let room = if same { MOST_FRAMES / 4 } else { MOST_FRAMES };
        if self.bodies.len() < room {
            self.bodies.push(body);
        }
    }

    /// What the frames so far say.
    pub fn find(&self) -> Findings {
        let len = self.common_len();
        let (frames, different) = self.group(len);
        let (chains, none) = match frames.groups.is_empty() {
            true => (Vec::new(), 0.0),
            false => chain::search(&frames),
        };
        let mut findings = Findings {
            line: self.line.judge(self.answered()),
            frames: self.frames,
            answered: self.answered(),
            faults: self.faults,
            different,
            heads: self.heads,
            answers: Vec::new(),
            unlikely: 0,
            unlikely_probability: 0.0,
            none_probability: 1.0,
        };
        if !chains.is_empty() {
            self.weigh(len, chains, none, &mut findings);
        }
        findings
    }

    /// Bits that nearly all frames have, up to where nearly all rest: a slave may time out while MA goes on.
    fn common_len(&self) -> usize {
        let answered = || self.bodies.iter().filter(|body| !body.is_empty());
        let mut lens: Vec<usize> = answered().map(Bits::len).collect();
        lens.sort_unstable();
        // As many bits of as many frames as there are.
        let area = |(shorter, len): (usize, usize)| (len * (lens.len() - shorter), len);
        let largest = lens.iter().copied().enumerate().map(area).max();
        let len = largest.map_or(0, |(_, len)| len);
        let long = answered().filter(|body| body.len() >= len);
        let rest = low_share(long.map(|body| rests_from(body, len)).collect(), EARLY);
        rest.filter(|rest| *rest > 1).unwrap_or(len)
    }

    /// Frames whose first `len` bits are alike together, the most common ones; and how many different ones there are.
    fn group(&self, len: usize) -> (Frames, usize) {
        let mut groups: Vec<Group> = Vec::new();
        let mut known: HashMap<Vec<u64>, usize> = HashMap::new();
        let whole = self
            .bodies
            .iter()
            .filter(|body| !body.is_empty() && body.len() >= len);
        for body in whole {
            let key = (0..len)
                .step_by(64)
                .map(|at| body.word(at, 64.min(len - at)).unwrap_or(0));
            let index = *known.entry(key.collect()).or_insert_with(|| {
                let mut bits = Bits::default();
                bits.extend(body.iter().take(len));
                groups.push(Group {
                    count: 0,
                    ones_end: ones_end(&bits),
                    bits,
                });
                groups.len() - 1
            });
            groups[index].count += 1;
        }
        let different = groups.len();
        if different > chain::MAX_GROUPS {
            // Of those that came equally often from everywhere, as neighbours differ in few bits.
            let mixed = |index: usize| (index as u32).wrapping_mul(0x9E37_79B1);
            let mut order: Vec<usize> = (0..different).collect();
            order.sort_by_key(|index| (std::cmp::Reverse(groups[*index].count), mixed(*index)));
            order.truncate(chain::MAX_GROUPS);
            groups = order.iter().map(|index| groups[*index].clone()).collect();
        }
        let total = groups.iter().map(|group| group.count).sum();
        (Frames { groups, total, len }, different)
    }

    fn weigh(&self, len: usize, chains: Vec<Chain>, none: f64, findings: &mut Findings) {
        let best = chains.first().map_or(0.0, |chain| chain.score);
        let mut near = chains;
        let close = near
            .iter()
            .take_while(|chain| chain.score > best - FAR)
            .count();
        let far = near.split_off(close.min(NEAR));
        let mut found: Vec<(f64, Answer)> = Vec::new();
        for chain in near {
            found.extend(self.answers(len, &chain));
        }
        let top = found.iter().map(|(score, _)| *score).fold(none, f64::max);
        let share = |score: f64| (score - top).exp2();
        let rest: f64 = far.iter().map(|chain| share(chain.score)).sum();
        let sum: f64 =
            found.iter().map(|(score, _)| share(*score)).sum::<f64>() + share(none) + rest;
        findings.none_probability = share(none) / sum;
        findings.unlikely = far.len();
        findings.unlikely_probability = rest / sum;
        for (score, mut answer) in found {
            answer.probability = share(score) / sum;
            let answers = &mut findings.answers;
            let twin = answers
                .iter_mut()
                .find(|known| known.format == answer.format);
            match twin {
                Some(twin) => twin.probability += answer.probability,
                None => answers.push(answer),
            }
        }
        findings.leave_out_unlikely();
    }
}

impl Detector {
    /// A chain with every reading of its bits, and log2 of the odds of each.
    fn answers(&self, len: usize, chain: &Chain) -> Vec<(f64, Answer)> {
        /// Readings of one channel that are looked at, and of all together.
        const EACH: usize = 4;
        const ALL: usize = 64;
        let end = chain.fits.last().map_or(0, Fit::end);
        let fits = |body: &Bits| {
            let stops = body.find(end, true).is_none_or(|one| one >= len);
            body.len() >= len && stops && chain.fits.iter().all(|fit| fit.fits(body))
        };
        let good: Vec<bool> = self.bodies.iter().map(fits).collect();
        let words: Vec<Words> = chain
            .fits
            .iter()
            .map(|fit| self.words(&good, fit))
            .collect();
        let mut combined: Vec<Weighed> = vec![(chain.score, Vec::new())];
        for (fit, words) in chain.fits.iter().zip(&words) {
            let mut readings = words.readings(fit.crc_bits == 16);
            let top = readings.first().map_or(0.0, |reading| reading.score);
            let sum: f64 = readings
                .iter()
                .map(|reading| (reading.score - top).exp2())
                .sum();
            let all = top + sum.log2();
            // Usual flags speak for a channel, and unusual ones against it, but not as much as checks do.
            let plain = all.clamp(-3.0, 2.0);
            readings.truncate(EACH);
            readings.retain(|reading| reading.score > top - FAR);
            let readings: Vec<Meaning> = readings
                .into_iter()
                .map(|reading| (reading, words.split(&reading)))
                .collect();
            let mut next: Vec<Weighed> = Vec::new();
            for (score, before) in &combined {
                for reading in &readings {
                    let chosen = before.iter().copied().chain([*reading]).collect();
                    next.push((score + reading.0.score - all + plain, chosen));
                }
            }
            next.sort_by(|a, b| b.0.total_cmp(&a.0));
            next.truncate(ALL);
            combined = next;
        }
        let all = self
            .bodies
            .iter()
            .filter(|body| !body.is_empty() && body.len() >= len);
        let (good, frames) = (good.iter().filter(|good| **good).count(), all.count());
        let answer = |(score, readings): Weighed| {
            let answer = put_together(chain, &words, &readings)?;
            let (good, frames) = (good as u64, frames as u64);
            Some((
                score,
                Answer {
                    good,
                    frames,
                    ..answer
                },
            ))
        };
        combined.into_iter().filter_map(answer).collect()
    }

    /// The data words of a channel in the order they came.
    fn words(&self, good: &[bool], fit: &Fit) -> Words {
        let word = |(body, good): (&Bits, &bool)| {
            let word = body.word(fit.from, fit.data_bits.into());
            word.filter(|_| *good)
        };
        Words {
            bits: fit.data_bits,
            words: self.bodies.iter().zip(good).map(word).collect(),
        }
    }
}

impl Spreads {
    fn add(&mut self, head: Head, trace: &Trace) {
        Range::widen(&mut self.ack, head.ack.into());
        Range::widen(&mut self.delay_clk, head.delay_clk.into());
        let widen = |range: &mut Option<Range>, value: Option<u32>| {
            value
                .into_iter()
                .for_each(|value| Range::widen(range, value.into()));
        };
        widen(&mut self.busy_ns, trace.busy_ns);
        widen(&mut self.delay_ns, trace.delay_ns);
        widen(&mut self.period_ns, trace.ma_period_ns);
        widen(&mut self.timeout_ns, timeout_ns(trace));
    }
}

/// From the last MA edge to SL = 1 as the slave saw both.
pub fn timeout_ns(trace: &Trace) -> Option<u32> {
    let ready = trace.ready_ns?;
    Some(ready.saturating_sub(trace.delay_ns.unwrap_or(0)))
}

/// Whether two formats are the same but for what the bits in front of the CRCs mean: channels of the same length, with the
/// same CRC as far as frames of that length can tell.
pub fn same_cut(a: &Format, b: &Format) -> bool {
    let cut = |channel: &Channel| {
        let data_bits = channel.data_bits();
        let crc = channel.crc().map(|crc| (crc.poly(), crc.of(0, data_bits)));
        (data_bits, crc)
    };
    a.channels()
        .iter()
        .map(cut)
        .eq(b.channels().iter().map(cut))
}

/// The value that `percent` of all are below.
fn low_share(mut values: Vec<usize>, percent: usize) -> Option<usize> {
    values.sort_unstable();
    values.get(values.len() * percent / 100).copied()
}

fn ones_end(bits: &Bits) -> usize {
    (0..bits.len())
        .rev()
        .find(|at| bits.get(*at) == Some(true))
        .map_or(0, |at| at + 1)
}

/// Where the ones begin that a body of `len` bits ends with.
fn rests_from(body: &Bits, len: usize) -> usize {
    (0..len)
        .rev()
        .find(|at| body.get(*at) == Some(false))
        .map_or(0, |at| at + 1)
}

/// A chain with a reading of each channel.
fn put_together(chain: &Chain, words: &[Words], readings: &[Meaning]) -> Option<Answer> {
    let mut text = String::new();
    let mut channels = Vec::new();
    for (index, (fit, (reading, split))) in chain.fits.iter().zip(readings).enumerate() {
        let crc = fit.crc()?;
        if index > 0 {
            text.push('+');
        }
        fields(&mut text, index, fit.data_bits, reading, *split);
        // Writing to a string does not fail.
        let _ = write!(text, ",{crc}");
        let moving = words[index].moving();
        channels.push(Seen {
            crc,
            data_bits: fit.data_bits,
            rank: fit.rank,
            still: (moving.leading_zeros() as u8).saturating_sub(64 - fit.data_bits),
            zeros: reading.zeros,
            against: split.is_some_and(|split| split.against),
        });
    }
    Some(Answer {
        format: text.parse().ok()?,
        probability: 0.0,
        good: 0,
        frames: 0,
        channels,
    })
}

/// The fields of a channel as they stand in a format. What has no flags behind the first channel need be no position.
fn fields(text: &mut String, index: usize, data_bits: u8, reading: &Reading, split: Option<Split>) {
    let left = data_bits - reading.flags.bits() - reading.life;
    let zeros = reading.zeros.min(left.saturating_sub(1));
    let position = left - zeros;
    let is_position = index == 0 || !reading.flags.names().is_empty();
    let name = if is_position { "st" } else { "data" };
    let _ = match split.filter(|split| is_position && split.turn_bits + split.between < position) {
        Some(split) => {
            let st = position - split.turn_bits - split.between;
            let pad = match split.between {
                0 => String::new(),
                bits => format!("pad{bits},"),
            };
            write!(text, "mt{},{pad}st{st}", split.turn_bits)
        }
        None => write!(text, "{name}{position}"),
    };
    if zeros > 0 {
        let _ = write!(text, ",pad{zeros}");
    }
    for flag in reading.flags.names() {
        let _ = write!(text, ",{flag}");
    }
    if reading.life > 0 {
        let _ = write!(text, ",lc{}", reading.life);
    }
}
