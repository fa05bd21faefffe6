//! Single bit errors: which bit, and whether noise has turned it.

use crate::cycle::{Cycle, Fault};
use crate::format::{Channel, Format, Kind};

/// Evidence is counted in 1/16 bit.
const SIXTEENTHS: f64 = 16.0;

/// So much evidence, and so many places, make noise of what could be chance.
const CERTAIN: u64 = 20 * 16;
const PLACES: u32 = 3;

/// A word that failed its CRC, until the good one behind it has come.
#[derive(Clone, Copy, Debug)]
struct Failed {
    channel: usize,
    got: (u64, u16),
    before: u64,
}

/// Words that failed among good ones.
#[derive(Clone, Debug, Default)]
pub(super) struct Flips {
    failed: Option<Failed>,
    /// Words that one bit makes good, and near to their neighbours.
    pub(super) single: u64,
    /// Of these, the bits that have two of their channel beside them.
    inner: u64,
    /// Words of which that cannot be said.
    pub(super) other: u64,
    /// Wrong bits that are like neither of their neighbours: a sample taken too early or too late is like one of them.
    lone: u64,
    /// Places of the wrong bits in their channels.
    places: u128,
    evidence: u64,
}

impl Flips {
    /// A cycle in which a word failed its CRC; `before` are the words of the last good one.
    pub(super) fn failed(&mut self, cycle: &Cycle, before: &[u64]) {
        let mut bad = cycle.words().iter().enumerate().filter(|(_, word)| {
            let fault = word.fault();
            matches!(fault, Some(Fault::Crc { .. }))
        });
        let (Some((channel, word)), None) = (bad.next(), bad.next()) else {
            (self.failed, self.other) = (None, self.other + 1);
            return;
        };
        self.failed = before.get(channel).map(|before| Failed {
            channel,
            got: word.raw(),
            before: *before,
        });
    }

    /// Whether the next good cycle is waited for.
    pub(super) fn waits(&self) -> bool {
        self.failed.is_some()
    }

    /// The good cycle behind it.
    pub(super) fn good(&mut self, format: &Format, after: &Cycle) {
        let Some(failed) = self.failed.take() else {
            return;
        };
        let channel = format.channels().get(failed.channel);
        let after = after.words().get(failed.channel);
        let (Some(channel), Some(after)) = (channel, after.and_then(|word| word.good())) else {
            return;
        };
        match flipped(channel, &failed, after) {
            Some(flip) => {
                self.single += 1;
                self.inner += u64::from(flip.lone.is_some());
                self.lone += u64::from(flip.lone == Some(true));
                self.places |= 1u128 << flip.place.min(127);
                self.evidence += flip.evidence;
            }
            None => self.other += 1,
        }
    }

    /// All that failed did so by a bit here and there, as noise does it.
    pub(super) fn are_noise(&self) -> bool {
        self.scattered() && self.noisier() > 2.5
    }

    /// All that failed did so by a bit that was sampled too early or too late.
    pub(super) fn are_late(&self) -> bool {
        self.places() && self.single >= 2 * self.other && self.noisier() < -2.5
    }

    /// The same where nothing else says so.
    pub(super) fn are_surely_late(&self) -> bool {
        self.places() && self.single >= self.other && self.noisier() < -6.0
    }

    /// How much more likely noise is than samples beside their bit, as a logarithm: a quarter of what noise turns is like
    /// neither neighbour, and hardly any of the others.
    fn noisier(&self) -> f64 {
        const OF_NOISE: f64 = 0.25;
        const OF_OTHERS: f64 = 0.03;
        let lone = self.lone as f64 * (OF_NOISE / OF_OTHERS).ln();
        let beside = (self.inner - self.lone) as f64;
        lone + beside * ((1.0 - OF_NOISE) / (1.0 - OF_OTHERS)).ln()
    }

    fn scattered(&self) -> bool {
        self.places() && self.evidence >= CERTAIN && self.single >= 2 * self.other
    }

    /// It is not always the same bit.
    fn places(&self) -> bool {
        self.places.count_ones() >= PLACES
    }
}

struct Flip {
    /// In its channel.
    place: u32,
    /// Like neither of those beside it, where there are two.
    lone: Option<bool>,
    evidence: u64,
}

/// The one bit that makes the word good and puts it near its neighbours.
fn flipped(channel: &Channel, failed: &Failed, after: u64) -> Option<Flip> {
    let crc = channel.crc()?;
    let (data_bits, crc_bits) = (u32::from(channel.data_bits()), u32::from(crc.bits()));
    let (data, check) = failed.got;
    let word = u128::from(data) << crc_bits | u128::from(check);
    let bits = data_bits + crc_bits;
    let near = Near::of(channel, failed.before, after);
    let place = (0..bits).find(|place| {
        let word = word ^ 1u128 << (bits - 1 - place);
        let data = (word >> crc_bits) as u64;
        let check = word as u16 & (u16::MAX >> (16 - crc_bits));
        crc.of(data, channel.data_bits()) == check && near.holds(channel, data)
    })?;
    // At its ends other things than its own bits stand beside it.
    let right = word ^ 1u128 << (bits - 1 - place);
    let around = right >> (bits - 1 - place).saturating_sub(1) & 7;
    let inner = (1..bits - 1).contains(&place);
    let lone = inner.then_some(around == 0 || around == 7);
    // That chance makes as much of a word: that one of so many bits fits its CRC, and that it is as near.
    let chance = f64::from(bits) / f64::from((1u32 << crc_bits) - 1) * near.share();
    let evidence = (-chance.min(1.0).log2() * SIXTEENTHS) as u64;
    Some(Flip {
        place,
        lone,
        evidence,
    })
}

/// Where the position of a good word can be, between two good ones.
struct Near {
    before: u64,
    /// On the way there, and as far again on either side.
    reach: u64,
    bits: u32,
    turns: Option<(u64, u64)>,
}

impl Near {
    fn of(channel: &Channel, before: u64, after: u64) -> Near {
        let turn = channel.find(|kind| *kind == Kind::Turn);
        let turns = turn.map(|field| (field.get(before), field.get(after)));
        let Some(field) = channel.position() else {
            return Near {
                before: 0,
                reach: 0,
                bits: 0,
                turns,
            };
        };
        let bits = u32::from(field.bits());
        let way = distance(field.get(before), field.get(after), bits);
        Near {
            before: field.get(before),
            reach: way.saturating_mul(2).saturating_add(4),
            bits,
            turns,
        }
    }

    fn holds(&self, channel: &Channel, data: u64) -> bool {
        let turn = channel.find(|kind| *kind == Kind::Turn);
        let turns = turn.zip(self.turns).is_none_or(|(field, (before, after))| {
            let turn = field.get(data);
            turn == before || turn == after
        });
        let place = channel
            .position()
            .is_none_or(|field| distance(self.before, field.get(data), self.bits) <= self.reach);
        turns && place
    }

    /// Of all positions.
    fn share(&self) -> f64 {
        let all = 2f64.powi(self.bits as i32);
        ((2.0 * self.reach as f64 + 1.0) / all).min(1.0)
    }
}

/// The shorter way round.
fn distance(a: u64, b: u64, bits: u32) -> u64 {
    let mask = u64::MAX >> (64 - bits.clamp(1, 64));
    let up = b.wrapping_sub(a) & mask;
    up.min(up.wrapping_neg() & mask)
}
