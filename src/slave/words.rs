//! What goes into a data word: where the shaft is, and the check behind it.

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
