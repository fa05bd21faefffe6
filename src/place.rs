//! Where the encoder is, as its user counts: from a zero of his own, in his direction, past the rollover.
//!
//! A word's turns and position together are one number, turns first, that rolls over. What comes out of here is
//! arithmetic on numbers that were sent; it never takes their place.

use crate::format::{Channel, Field, Kind};
use crate::parse::ParseError;
use std::str::FromStr;

/// How to count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Count {
    /// Follow the rollover.
    pub unwrap: bool,
    /// What counts as 0, as the encoder sends it.
    pub zero: Zero,
    /// Count against the encoder's direction.
    pub reverse: bool,
}

/// What counts as 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Zero {
    /// This number.
    At(u64),
    /// Where the encoder is first.
    Here,
}

impl FromStr for Zero {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Zero, ParseError> {
        let digits = !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
        match text.parse() {
            _ if text == "here" => Ok(Zero::Here),
            Ok(counts) if digits => Ok(Zero::At(counts)),
            _ => Err(ParseError::usage(
                text,
                &format!("`{text}` is no position"),
                "write it in counts, such as 524288, or here for where the encoder is first",
            )),
        }
    }
}

/// How far the encoder moved since the word before, the shorter way round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Less than a quarter of the range.
    Clear,
    /// Less than half of it: soon too fast to be followed.
    Fast,
    /// Half of it: which way is not known, it is counted upwards.
    Unknown,
}

/// A channel's number: turns, if it has them, and position.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Number {
    turn: Option<Field>,
    position: Field,
}

impl Number {
    /// None for a channel without a position.
    pub fn of(channel: &Channel) -> Option<Number> {
        Some(Number {
            turn: channel.find(|kind| *kind == Kind::Turn).cloned(),
            position: channel.position()?.clone(),
        })
    }

    /// Its width, 1 to 64.
    pub fn bits(&self) -> u32 {
        let turn = self.turn.as_ref().map_or(0, Field::bits);
        u32::from(turn) + u32::from(self.position.bits())
    }

    /// The largest it can be.
    pub fn most(&self) -> u64 {
        u64::MAX >> (64 - self.bits().clamp(1, 64))
    }

    /// Its value in a data word.
    pub fn get(&self, data: u64) -> u64 {
        let turn = self.turn.as_ref().map_or(0, |turn| turn.get(data));
        let above = turn
            .checked_shl(self.position.bits().into())
            .unwrap_or_default();
        above | self.position.get(data)
    }
}

/// One channel, counted from word to word.
#[derive(Clone, Debug)]
pub struct Counter {
    number: Number,
    count: Count,
    zero: Option<u64>,
    /// The last number, and where the rollovers so far have taken it.
    last: Option<(u64, i128)>,
}

impl Counter {
    /// None for a channel without a position.
    pub fn new(channel: &Channel, count: Count) -> Option<Counter> {
        let zero = match count.zero {
            Zero::At(number) => Some(number),
            Zero::Here => None,
        };
        Some(Counter {
            number: Number::of(channel)?,
            count,
            zero,
            last: None,
        })
    }

    /// The counts of the next word that passed every check, and how far it is from the one before.
    pub fn next(&mut self, data: u64) -> (i128, Step) {
        let number = self.number.get(data);
        let zero = *self.zero.get_or_insert(number);
        let (place, step) = self.follow(number);
        self.last = Some((number, place));
        let away = if self.count.unwrap {
            place - i128::from(zero)
        } else {
            i128::from(number) - i128::from(zero)
        };
        let counts = if self.count.reverse { -away } else { away };
        if self.count.unwrap {
            (counts, step)
        } else {
            (counts & i128::from(self.number.most()), Step::Clear)
        }
    }

    /// The shorter way from the last number to this one.
    fn follow(&self, number: u64) -> (i128, Step) {
        let Some((last, place)) = self.last else {
            return (number.into(), Step::Clear);
        };
        let most = self.number.most();
        let half = most / 2 + 1;
        let up = number.wrapping_sub(last) & most;
        let down = last.wrapping_sub(number) & most;
        let way = up.min(down);
        let step = match way {
            way if way == half => Step::Unknown,
            way if way > 0 && way >= half / 2 => Step::Fast,
            _ => Step::Clear,
        };
        if up <= half {
            (place + i128::from(up), step)
        } else {
            (place - i128::from(down), step)
        }
    }
}

/// More decimals than a 64-bit float can tell apart.
const MOST_DIGITS: i32 = 15;

/// Enough for the turns of 128 bits, in degrees.
const MOST_POWER: i32 = 42;

/// An angle of `counts`, of which a turn has 2 to the power of `bits`, and as many decimals as that resolution needs.
/// Within a turn unless `turns` asks for all of it.
pub fn degrees(counts: i128, bits: u8, turns: bool) -> (f64, usize) {
    let range = 2f64.powi(bits.into());
    let (whole, rest) = (counts >> bits, counts & ((1 << bits) - 1));
    let whole = if turns { whole as f64 * 360.0 } else { 0.0 };
    // Digits before the point take their share, three at least.
    let power = |from: i32, enough: &dyn Fn(f64) -> bool| {
        let found = (from..=MOST_POWER).find(|n| enough(10f64.powi(*n)));
        found.unwrap_or(MOST_POWER)
    };
    let before = power(3, &|power| power > whole.abs());
    let needed = power(-1, &|power| power >= range / 360.0) + 1;
    let digits = needed.min(MOST_DIGITS + 1 - before).max(0);
    let scale = 10f64.powi(digits);
    let scaled = (rest as f64 / range * 360.0 * scale).round();
    if turns {
        return ((whole * scale + scaled).round() / scale, digits as usize);
    }
    // Cut off, not rounded, where rounding would make a full turn of it.
    (scaled.min(360.0 * scale - 1.0) / scale, digits as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::Format;

    fn channel(text: &str) -> Channel {
        let format: Format = text.parse().unwrap_or_else(|e| panic!("{e}"));
        format.channels()[0].clone()
    }

    /// A word whose turns and position make `number`, whatever else is in it.
    fn word(channel: &Channel, number: u64, noise: u64) -> u64 {
        let position = channel.position().unwrap();
        let noise = noise >> (64 - u32::from(channel.data_bits()));
        let word = position.set(noise, number);
        match channel.find(|kind| *kind == Kind::Turn) {
            Some(turn) => turn.set(
                word,
                number.checked_shr(position.bits().into()).unwrap_or(0),
            ),
            None => word,
        }
    }

    fn any_channel(rng: &mut fastrand::Rng) -> Channel {
        let bits = rng.u8(1..=64);
        let place = if rng.bool() { "st" } else { "pos" };
        let turns = rng.u8(0..bits);
        let mut fields = vec![format!("{place}{}", bits - turns)];
        if turns > 0 {
            fields.push(format!("mt{turns}"));
        }
        for more in ["nE", "pad3", "W"] {
            let taken: u8 = if more == "pad3" { 3 } else { 1 };
            if rng.bool() && bits + 6 + taken <= 64 {
                fields.push(more.into());
            }
        }
        rng.shuffle(&mut fields);
        channel(&fields.join(","))
    }

    /// A shaft that really turns, in numbers without end, and what its encoder makes of it.
    #[test]
    fn counts_are_where_the_shaft_is() {
        let seed = fastrand::u64(..);
        println!("seed {seed}");
        let mut rng = fastrand::Rng::with_seed(seed);
        let mut wraps = [0u32; 2];
        for _ in 0..2_000 {
            let channel = any_channel(&mut rng);
            let range = 1i128 << Number::of(&channel).unwrap().bits();
            let here = rng.bool();
            let zero = rng.u64(..=(range - 1) as u64);
            let count = Count {
                unwrap: rng.bool(),
                zero: if here { Zero::Here } else { Zero::At(zero) },
                reverse: rng.bool(),
            };
            let mut counter = Counter::new(&channel, count).unwrap();
            let mut shaft = i128::from(rng.u64(..=(range - 1) as u64));
            let zero = if here { shaft } else { zero.into() };
            // Fast and slow, mostly one way.
            let (low, high) = match rng.u8(..3) {
                0 => (0, range / 2 - 1),
                1 => (-(range / 2) + 1, 0),
                _ => (-(range / 2) + 1, range / 2 - 1),
            };
            for _ in 0..40 {
                let number = (shaft & (range - 1)) as u64;
                let (counts, step) = counter.next(word(&channel, number, rng.u64(..)));
                let away = shaft - zero;
                let mut want = if count.reverse { -away } else { away };
                if !count.unwrap {
                    want = want.rem_euclid(range);
                }
                assert_eq!(counts, want, "{channel} {count:?} at {shaft}");
                assert_ne!(step, Step::Unknown);
                let moved = if low < high { rng.i128(low..=high) } else { 0 };
                wraps[0] += u32::from((shaft + moved).div_euclid(range) > shaft.div_euclid(range));
                wraps[1] += u32::from((shaft + moved).div_euclid(range) < shaft.div_euclid(range));
                shaft += moved;
            }
        }
        assert!(wraps.iter().all(|count| *count > 1_000), "{wraps:?}");
    }

    #[test]
    fn what_cannot_be_followed_is_said() {
        let count = Count {
            unwrap: true,
            zero: Zero::At(0),
            reverse: false,
        };
        for (from, to, counts, step) in [
            (0, 0, 0, Step::Clear),
            (0, 255, 255, Step::Clear),
            (0, 256, 256, Step::Fast),
            (0, 511, 511, Step::Fast),
            (0, 512, 512, Step::Unknown),
            (512, 0, 1024, Step::Unknown),
            (0, 513, -511, Step::Fast),
            (0, 769, -255, Step::Clear),
            (1023, 0, 1024, Step::Clear),
            (0, 1023, -1, Step::Clear),
        ] {
            let mut counter = Counter::new(&channel("st10"), count).unwrap();
            assert_eq!(counter.next(from), (from.into(), Step::Clear));
            assert_eq!(counter.next(to), (counts, step), "{from} {to}");
        }
        // Half of one bit is all of it.
        let mut counter = Counter::new(&channel("st1"), count).unwrap();
        assert_eq!(counter.next(1), (1, Step::Clear));
        assert_eq!(counter.next(1), (1, Step::Clear));
        assert_eq!(counter.next(0), (2, Step::Unknown));
        assert!(Counter::new(&channel("data8,mt4"), count).is_none());
    }

    #[test]
    fn degrees_have_the_digits_of_their_resolution() {
        for (counts, bits, turns, text) in [
            (0, 10, false, "0.00"),
            (512, 10, false, "180.00"),
            (1023, 10, false, "359.65"),
            (1024 + 512, 10, false, "180.00"),
            (-1, 10, false, "359.65"),
            (1024 + 512, 10, true, "540.00"),
            (-1, 10, true, "-0.35"),
            (-1024, 10, true, "-360.00"),
            // One count less than a turn stays below it, unless turns are counted.
            (i128::from(u64::MAX), 64, false, "359.9999999999999"),
            (1 << 63, 64, false, "180.0000000000000"),
            (1, 1, false, "180"),
            (3, 2, false, "270"),
            (-3, 1, true, "-540"),
            (1 << 20, 20, true, "360.00000"),
            // Digits that a float does not have are not shown.
            (1_000_000_000_001 << 20, 20, true, "360000000000360.0"),
        ] {
            let (degrees, digits) = degrees(counts, bits, turns);
            assert_eq!(format!("{degrees:.digits$}"), text, "{counts} of {bits}");
        }
        let seed = fastrand::u64(..);
        println!("seed {seed}");
        let mut rng = fastrand::Rng::with_seed(seed);
        for _ in 0..10_000 {
            let bits = rng.u8(1..=40);
            let counts = rng.i128(-(1 << 45)..1 << 45);
            let (angle, digits) = degrees(counts, bits, true);
            let exact = counts as f64 / (1u64 << bits) as f64 * 360.0;
            let last = 10f64.powi(-(digits as i32));
            assert!(
                (angle - exact).abs() <= last * 0.5001 + exact.abs() * 1e-15,
                "{counts} {bits}: {angle} {exact}"
            );
            let (within, _) = degrees(counts, bits, false);
            assert!((0.0..360.0).contains(&within), "{counts} {bits}: {within}");
        }
    }

    #[test]
    fn a_zero_is_a_number_or_here() {
        assert_eq!("here".parse(), Ok(Zero::Here));
        assert_eq!("18446744073709551615".parse(), Ok(Zero::At(u64::MAX)));
        for bad in [
            "",
            "-1",
            "+1",
            "1.5",
            "Here",
            "18446744073709551616",
            "0x10",
        ] {
            assert!(bad.parse::<Zero>().is_err(), "{bad}");
        }
    }
}
