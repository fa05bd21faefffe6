//! What goes into a data word: where the shaft is, and the check behind it.

use super::{Motion, Slave};
use crate::format::{Channel, Field, Kind};

impl Slave {
    /// The data word of each channel for the position at the latch.
    pub(super) fn measure(&mut self) {
        let rates = self.config.rates;
        let (error, warning) = (self.random.hit(rates.error), self.random.hit(rates.warning));
        let null = self.random.hit(rates.null);
        if !self.random.hit(rates.life_stuck) {
            self.life += 1;
        }
        let differs = self.random.hit(rates.pair_differs);
        self.words.clear();
        let mut places = 0;
        for channel in self.config.format.channels() {
            let (turn, mut position) = self.place(channel);
            places += u32::from(channel.position().is_some());
            if differs && places == 2 {
                position = position.wrapping_add(quarter(channel));
            }
            let mut word = 0;
            for field in channel.fields() {
                let value = match field.kind() {
                    Kind::Turn => turn,
                    Kind::SingleTurn | Kind::Position => position,
                    Kind::Padding => 0,
                    Kind::Data(_) => position,
                    Kind::Life => self.life_in(field),
                    Kind::Error { active_low } => u64::from(error != *active_low),
                    Kind::Warning { active_low } => u64::from(warning != *active_low),
                };
                word = field.set(word, value);
            }
            self.words.push(if null { 0 } else { word });
        }
    }

    /// The sign of life as it fits a field.
    fn life_in(&self, field: &Field) -> u64 {
        match field.get(u64::MAX) {
            most if self.config.life_skips_zero && self.life > 0 => (self.life - 1) % most + 1,
            _ => self.life,
        }
    }

    /// Turn and position of a channel now. Channels that have a position show the same angle, the first one's, with as
    /// many bits as each has.
    fn place(&self, channel: &Channel) -> (u64, u64) {
        let bits = channel.position().map(|f| u32::from(f.bits()));
        let channels = self.config.format.channels();
        let first = channels.iter().find_map(Channel::position);
        let first = first.map(|f| u32::from(f.bits()));
        match (bits, first) {
            (Some(bits), Some(first)) if bits != first => {
                let (turn, position) = self.place_in(first);
                let as_wide = position.checked_shl(bits.saturating_sub(first));
                (turn, as_wide.unwrap_or(0) >> first.saturating_sub(bits))
            }
            _ => self.place_in(bits.unwrap_or(16)),
        }
    }

    /// Turn and position now, in counts of which a turn has 2 to the power of `bits`.
    fn place_in(&self, bits: u32) -> (u64, u64) {
        let range = 2f64.powi(bits as i32);
        let seconds = self.latch_ns as f64 / 1e9;
        let moved: i128 = match self.config.motion {
            Motion::Still => 0,
            Motion::Count => i128::from(self.latches),
            Motion::Speed(rpm) => (rpm / 60.0 * seconds * range) as i128,
            Motion::Sine { degrees, period } => {
                let turns = self.latch_ns as f64 / period.0 as f64;
                (degrees / 360.0 * range * sine(turns)) as i128
            }
        };
        let start =
            (i128::from(self.config.turn) << bits).wrapping_add(i128::from(self.config.position));
        let whole = start.wrapping_add(moved);
        (
            (whole >> bits) as u64,
            (whole & ((1i128 << bits) - 1)) as u64,
        )
    }

    /// The bits of each slave: its channels one by one, each with its CRC.
    pub(super) fn load(&mut self) {
        let rates = self.config.rates;
        let spoiled = self.random.hit(rates.crc_error);
        for member in self.members.iter_mut().rev() {
            member.bits.clear();
            if !member.data_active() {
                continue;
            }
            let channels = &self.config.format.channels()[member.channels.clone()];
            let words = &self.words[member.channels.clone()];
            for (channel, word) in channels.iter().zip(words) {
                let spec = channel.crc().map(CrcBits::new);
                let mut register = spec.as_ref().map_or(0, |s| s.init);
                for place in (0..channel.data_bits()).rev() {
                    let bit = word >> place & 1 == 1;
                    if let Some(spec) = &spec {
                        register = spec.shift(register, bit);
                    }
                    member.bits.push(bit ^ self.random.hit(rates.flip));
                }
                if let Some(spec) = &spec {
                    for place in (0..spec.bits).rev() {
                        let bit = (register >> place & 1 == 1) ^ spec.inverted;
                        let wrong = spoiled && place == 0;
                        member.bits.push(bit ^ wrong ^ self.random.hit(rates.flip));
                    }
                }
            }
            member.bits.reverse();
        }
    }
}

/// A quarter of what a channel's position can be.
fn quarter(channel: &Channel) -> u64 {
    let bits = channel.position().map_or(0, Field::bits);
    (1 << bits.saturating_sub(1)) / 2
}

/// Sine of so many turns, by its series: the same digits on every machine, and no library of mathematics to load for it.
pub(super) fn sine(turns: f64) -> f64 {
    let turns = match turns.fract() {
        turn if turn > 0.75 => turn - 1.0,
        turn if turn > 0.25 => 0.5 - turn,
        turn => turn,
    };
    let angle = turns * std::f64::consts::TAU;
    let term = |rest: f64, n: u32| 1.0 - angle * angle / f64::from(2 * n * (2 * n + 1)) * rest;
    angle * (1..=11).rev().fold(1.0, term)
}

/// A CRC as a shift register: parameters of the format, arithmetic of its own.
pub(super) struct CrcBits {
    pub(super) bits: u32,
    pub(super) poly: u32,
    pub(super) init: u32,
    pub(super) inverted: bool,
}

impl CrcBits {
    pub(super) fn new(crc: &crate::crc::Crc) -> CrcBits {
        CrcBits {
            bits: u32::from(crc.bits()),
            poly: crc.poly(),
            init: u32::from(crc.init()),
            inverted: crc.inverted(),
        }
    }

    pub(super) fn shift(&self, register: u32, bit: bool) -> u32 {
        let top = register >> (self.bits - 1) & 1 == 1;
        let shifted = register << 1 & ((1 << self.bits) - 1);
        if top != bit {
            shifted ^ (self.poly & ((1 << self.bits) - 1))
        } else {
            shifted
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_series_is_the_sine() {
        for step in 0..=4000 {
            let turns = f64::from(step) / 1000.0;
            let want = (turns * std::f64::consts::TAU).sin();
            assert!((sine(turns) - want).abs() < 4e-15, "{turns}");
        }
    }
}
