//! Where the encoder is, as its user counts: from a zero of his own, in his direction, past the rollover.
//!
//! A word's turns and position together are one number, turns first, that rolls over. What comes out of here is
//! arithmetic on numbers that were sent; it never takes their place.

use crate::format::{Channel, Field, Kind};
use crate::parse::ParseError;
use std::fmt;
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

impl fmt::Display for Zero {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Zero::At(number) => write!(f, "{number}"),
            Zero::Here => f.write_str("here"),
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
    /// Less, but words are missing before it, and at the speed seen last it may have been a quarter or more.
    Lost,
}

/// A channel's number: turns, if it has them, and position.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Number {
    turn: Option<Field>,
    position: Field,
    /// Counts of a turn, where they are fewer than the position could hold.
    counts: Option<u64>,
    /// It does not roll over.
    line: bool,
}

impl Number {
    /// None for a channel without a position.
    pub fn of(channel: &Channel) -> Option<Number> {
        Some(Number {
            turn: channel.find(|kind| *kind == Kind::Turn).cloned(),
            position: channel.position()?.clone(),
            counts: None,
            line: false,
        })
    }

    /// The same, with turns of so many counts, which must not be more than the position can hold.
    #[must_use]
    pub fn of_turns(self, counts: u64) -> Number {
        let most = u64::MAX >> (64 - u32::from(self.position.bits()));
        Number {
            counts: (counts > 0 && counts <= most).then_some(counts),
            ..self
        }
    }

    /// The same without the turns.
    #[must_use]
    pub fn of_one_turn(&self) -> Number {
        Number {
            turn: None,
            ..self.clone()
        }
    }

    /// The same on a line, where what comes before 0 is below it and not the largest number.
    #[must_use]
    pub fn on_a_line(self) -> Number {
        Number { line: true, ..self }
    }

    /// How many numbers there are.
    pub fn range(&self) -> u128 {
        let turns = 1u128 << self.turn.as_ref().map_or(0, Field::bits);
        let counts = self.counts.map(u128::from);
        turns * counts.unwrap_or(1 << self.position.bits())
    }

    /// The largest it can be.
    pub fn most(&self) -> u64 {
        (self.range() - 1) as u64
    }

    /// Whether the position of a data word is within a turn, as it is of every word where a turn is all that it can hold.
    pub fn is_within(&self, data: u64) -> bool {
        self.counts
            .is_none_or(|counts| self.position.get(data) < counts)
    }

    /// Its value in a data word; of a position beyond its turn the last one of that turn.
    pub fn get(&self, data: u64) -> u64 {
        let turn = self.turn.as_ref().map_or(0, |turn| turn.get(data));
        let position = self.position.get(data);
        match self.counts {
            Some(counts) => turn * counts + position.min(counts - 1),
            None => {
                let above = turn.checked_shl(self.position.bits().into());
                above.unwrap_or_default() | position
            }
        }
    }
}

/// One channel, counted from word to word.
#[derive(Clone, Debug)]
pub struct Counter {
    number: Number,
    count: Count,
    zero: Option<u64>,
    last: Option<Last>,
    /// The last step and the time it took, in nanoseconds.
    pace: Option<(u64, u64)>,
    /// A word since the last one had no number.
    missed: bool,
}

/// The last number, where the rollovers so far have taken it, and when it was.
#[derive(Clone, Copy, Debug)]
struct Last {
    number: u64,
    place: i128,
    t_ns: u64,
}

impl Counter {
    /// None for a channel without a position.
    pub fn new(channel: &Channel, count: Count) -> Option<Counter> {
        Number::of(channel).map(|number| Counter::of(number, count))
    }

    /// Counts such numbers.
    pub fn of(number: Number, count: Count) -> Counter {
        let zero = match count.zero {
            Zero::At(number) => Some(number),
            Zero::Here => None,
        };
        Counter {
            number,
            count,
            zero,
            last: None,
            pace: None,
            missed: false,
        }
    }

    /// What it counts.
    pub fn number(&self) -> &Number {
        &self.number
    }

    /// The next word has no number to count.
    pub fn miss(&mut self) {
        self.missed = true;
    }

    /// The counts of the next word that passed every check, latched at `t_ns`, and how far it is from the one before.
    pub fn next(&mut self, data: u64, t_ns: u64) -> (i128, Step) {
        let number = self.number.get(data);
        let zero = *self.zero.get_or_insert(number);
        let (place, step) = self.follow(number, t_ns);
        self.last = Some(Last {
            number,
            place,
            t_ns,
        });
        self.missed = false;
        let away = if self.count.unwrap {
            place - i128::from(zero)
        } else {
            i128::from(number) - i128::from(zero)
        };
        let counts = if self.count.reverse { -away } else { away };
        if self.count.unwrap {
            (counts, step)
        } else if self.number.line {
            (counts, Step::Clear)
        } else {
            (counts.rem_euclid(self.number.range() as i128), Step::Clear)
        }
    }

    /// The shorter way from the last number to this one.
    fn follow(&mut self, number: u64, t_ns: u64) -> (i128, Step) {
        let Some(last) = self.last else {
            return (number.into(), Step::Clear);
        };
        let range = self.number.range() as i128;
        let up = (i128::from(number) - i128::from(last.number)).rem_euclid(range);
        let down = (range - up) % range;
        let way = up.min(down);
        let quarter = range / 4;
        let ns = t_ns.saturating_sub(last.t_ns);
        let step = match way {
            way if way > 0 && way * 2 == range => Step::Unknown,
            way if way > 0 && way >= quarter => Step::Fast,
            _ if self.lost(ns, quarter as u64) => Step::Lost,
            _ => Step::Clear,
        };
        self.pace = Some((way as u64, ns));
        let place = match up <= down {
            true => last.place + up,
            false => last.place - down,
        };
        (place, step)
    }

    /// Whether it may have moved so far in a gap of so many nanoseconds. What stands still may have moved by less than
    /// can be seen.
    fn lost(&self, ns: u64, far: u64) -> bool {
        let Some((way, took_ns)) = self.pace else {
            return self.missed;
        };
        let gap = self.missed || ns / 2 >= took_ns;
        let seen = u128::from(way.max(1)) * u128::from(ns);
        gap && seen >= u128::from(far) * u128::from(took_ns)
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
    fn word(channel: &Channel, number: u64, turn: u64, noise: u64) -> u64 {
        let position = channel.position().unwrap();
        let noise = noise >> (64 - u32::from(channel.data_bits()));
        // All of 64 bits is one turn.
        let (turns, rest) = match turn {
            0 => (0, number),
            _ => (number / turn, number % turn),
        };
        let word = position.set(noise, rest);
        match channel.find(|kind| *kind == Kind::Turn) {
            Some(field) => field.set(word, turns),
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
            let mut number = Number::of(&channel).unwrap();
            let turn = 1u128 << channel.position().unwrap().bits();
            if rng.bool() && turn > 3 && turn < 1 << 63 {
                number = number.of_turns(rng.u64(3..=turn as u64));
            }
            let turn = number.counts.map_or(turn, u128::from) as u64;
            let range = number.range() as i128;
            let here = rng.bool();
            let zero = rng.u64(..=(range - 1) as u64);
            let count = Count {
                unwrap: rng.bool(),
                zero: if here { Zero::Here } else { Zero::At(zero) },
                reverse: rng.bool(),
            };
            let mut counter = Counter::of(number, count);
            let mut shaft = i128::from(rng.u64(..=(range - 1) as u64));
            let zero = if here { shaft } else { zero.into() };
            // Fast and slow, mostly one way.
            let (low, high) = match rng.u8(..3) {
                0 => (0, range / 2 - 1),
                1 => (-(range / 2) + 1, 0),
                _ => (-(range / 2) + 1, range / 2 - 1),
            };
            for t_ns in (0..40).map(|slot| slot * 1000) {
                let number = shaft.rem_euclid(range) as u64;
                let word = word(&channel, number, turn, rng.u64(..));
                let (counts, step) = counter.next(word, t_ns);
                let away = shaft - zero;
                let mut want = if count.reverse { -away } else { away };
                if !count.unwrap {
                    want = want.rem_euclid(range);
                }
                assert_eq!(counts, want, "{channel} {count:?} at {shaft}");
                assert!(!matches!(step, Step::Unknown | Step::Lost), "{step:?}");
                let moved = if low < high { rng.i128(low..=high) } else { 0 };
                wraps[0] += u32::from((shaft + moved).div_euclid(range) > shaft.div_euclid(range));
                wraps[1] += u32::from((shaft + moved).div_euclid(range) < shaft.div_euclid(range));
                shaft += moved;
            }
        }
        assert!(wraps.iter().all(|count| *count > 1_000), "{wraps:?}");
    }

    #[test]
    fn a_line_does_not_roll_over() {
        let number = Number::of(&channel("pos8")).unwrap().on_a_line();
        for (reverse, counts) in [(false, -20), (true, 20)] {
            let count = Count {
                unwrap: false,
                zero: Zero::At(100),
                reverse,
            };
            let mut counter = Counter::of(number.clone(), count);
            assert_eq!(counter.next(80, 0), (counts, Step::Clear));
            assert_eq!(counter.next(255, 1).0, if reverse { -155 } else { 155 });
        }
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
            assert_eq!(counter.next(from, 0), (from.into(), Step::Clear));
            assert_eq!(counter.next(to, 1), (counts, step), "{from} {to}");
        }
        // Half of one bit is all of it.
        let mut counter = Counter::new(&channel("st1"), count).unwrap();
        assert_eq!(counter.next(1, 0), (1, Step::Clear));
        assert_eq!(counter.next(1, 1), (1, Step::Clear));
        assert_eq!(counter.next(0, 2), (2, Step::Unknown));
        assert!(Counter::new(&channel("data8,mt4"), count).is_none());
    }

    /// A shaft that turned on while nothing was heard of it looks as if it had not.
    #[test]
    fn a_gap_is_followed_no_further_than_the_speed_before_it_allows() {
        let count = Count {
            unwrap: true,
            zero: Zero::At(0),
            reverse: false,
        };
        let counter = Counter::new(&channel("st10,nE"), count).unwrap();
        let word = |number: u64| number << 1;
        // 50 counts a microsecond, so a quarter of the range in 5.12 us.
        for (pause_ns, missed, step) in [
            (1_000, false, Step::Clear),
            (5_000, true, Step::Clear),
            (5_200, false, Step::Lost),
            (5_200, true, Step::Lost),
            (20_480, true, Step::Lost),
        ] {
            let mut counter = counter.clone();
            assert_eq!(counter.next(word(0), 0), (0, Step::Clear));
            assert_eq!(counter.next(word(50), 1_000), (50, Step::Clear));
            if missed {
                counter.miss();
            }
            let (_, got) = counter.next(word(60), 1_000 + pause_ns);
            assert_eq!(got, step, "{pause_ns} {missed}");
            let (_, after) = counter.next(word(60), 2_000 + pause_ns);
            assert_eq!(after, Step::Clear, "once a gap");
        }
        // What stands still may have moved one count at a time, and before the second number nothing is known.
        for (pause_ns, step) in [(200_000, Step::Clear), (256_000, Step::Lost)] {
            let mut counter = counter.clone();
            counter.next(word(7), 0);
            counter.next(word(7), 1_000);
            assert_eq!(counter.next(word(7), 1_000 + pause_ns), (7, step));
        }
        let mut counter = counter.clone();
        counter.miss();
        assert_eq!(counter.next(word(7), 0), (7, Step::Clear));
        counter.miss();
        assert_eq!(counter.next(word(7), 1), (7, Step::Lost));
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
