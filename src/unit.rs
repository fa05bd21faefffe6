//! Quantities as users write them: `500kHz`, `40us`, `12us..40us`, `50nm`, `1%`.
//!
//! A bare number is an error: whether `40` means microseconds or milliseconds is not for us to guess.

use crate::parse::ParseError;
use std::fmt;
use std::str::FromStr;

/// A frequency in Hz, 1 Hz to 4.29 GHz.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Hertz(pub u32);

/// A span of time in nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Nanos(pub u64);

/// A length in femtometres, above 0 and up to 18 km.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Femtometres(pub u64);

impl Hertz {
    /// The length of one period, rounded to a nanosecond and never 0.
    pub fn period_ns(self) -> u64 {
        let hz = u64::from(self.0.max(1));
        ((1_000_000_000 + hz / 2) / hz).max(1)
    }
}

impl Nanos {
    /// `12us` or `12us..40us`, the second time not before the first.
    ///
    /// # Errors
    /// What is wrong with either time, or with their order.
    pub fn range(text: &str) -> Result<(Nanos, Option<Nanos>), ParseError> {
        let Some((low, high)) = text.split_once("..") else {
            return Ok((text.parse()?, None));
        };
        let from: Nanos = low.parse().map_err(|e: ParseError| e.within(text, 0))?;
        let to: Nanos = high
            .parse()
            .map_err(|e: ParseError| e.within(text, low.len() + 2))?;
        if from > to {
            let what = format!("`{text}` ends before it begins");
            return Err(ParseError::new(
                text,
                0..text.len(),
                what,
                "write the shorter time first",
            ));
        }
        Ok((from, Some(to)))
    }
}

/// Nothing here takes longer than a day, and sums of such times stay far from overflowing.
const LONGEST_NS: u64 = 86_400_000_000_000;

const HERTZ: [(&str, u64); 4] = [
    ("Hz", 1),
    ("kHz", 1_000),
    ("MHz", 1_000_000),
    ("GHz", 1_000_000_000),
];
const NANOS: [(&str, u64); 6] = [
    ("ns", 1),
    ("us", 1_000),
    ("µs", 1_000),
    ("μs", 1_000),
    ("ms", 1_000_000),
    ("s", 1_000_000_000),
];

const FEMTOMETRES: [(&str, u64); 8] = [
    ("fm", 1),
    ("pm", 1_000),
    ("nm", 1_000_000),
    ("um", 1_000_000_000),
    ("µm", 1_000_000_000),
    ("μm", 1_000_000_000),
    ("mm", 1_000_000_000_000),
    ("m", 1_000_000_000_000_000),
];

/// `digits[.digits]` times `scale`, exact or `None`.
fn scaled(number: &str, scale: u64) -> Option<u64> {
    let (whole, fraction) = number.split_once('.').unwrap_or((number, ""));
    let digits = |s: &str| s.bytes().all(|b| b.is_ascii_digit());
    if (whole.is_empty() && fraction.is_empty()) || !digits(whole) || !digits(fraction) {
        return None;
    }
    let mut value = if whole.is_empty() {
        0
    } else {
        whole.parse::<u64>().ok()?.checked_mul(scale)?
    };
    let mut place = scale;
    for digit in fraction.bytes() {
        if place % 10 != 0 && digit != b'0' {
            return None;
        }
        place /= 10;
        value = value.checked_add(u64::from(digit - b'0') * place)?;
    }
    Some(value)
}

fn quantity(text: &str, units: &[(&str, u64)], examples: &str) -> Result<u64, ParseError> {
    let wrong = |what: String| {
        Err(ParseError::new(
            text,
            0..text.len(),
            what,
            format!("write it like {examples}"),
        ))
    };
    let end = text
        .find(|c: char| !c.is_ascii_digit() && c != '.')
        .unwrap_or(text.len());
    let (number, unit) = (&text[..end], text[end..].trim_start());
    if number.is_empty() {
        return wrong(format!("`{text}` is not a quantity"));
    }
    if unit.is_empty() {
        return wrong(format!("`{text}` has no unit"));
    }
    let Some(&(_, scale)) = units
        .iter()
        .find(|(name, _)| name.eq_ignore_ascii_case(unit))
    else {
        return wrong(format!("unknown unit `{unit}`"));
    };
    match scaled(number, scale) {
        Some(value) => Ok(value),
        None => wrong(format!(
            "`{text}` is out of range or finer than this unit can be counted"
        )),
    }
}

impl FromStr for Hertz {
    type Err = ParseError;
    fn from_str(text: &str) -> Result<Self, ParseError> {
        let examples = "500kHz or 2MHz";
        let hz = quantity(text, &HERTZ, examples)?;
        match u32::try_from(hz) {
            Ok(hz) if hz > 0 => Ok(Hertz(hz)),
            _ => Err(ParseError::new(
                text,
                0..text.len(),
                "the clock is out of range",
                format!("write it like {examples}"),
            )),
        }
    }
}

impl FromStr for Nanos {
    type Err = ParseError;
    fn from_str(text: &str) -> Result<Self, ParseError> {
        let examples = "500ns, 40us, 1ms or 2s";
        let ns = quantity(text, &NANOS, examples)?;
        if ns > LONGEST_NS {
            let what = format!("`{text}` is longer than a day");
            return Err(ParseError::new(
                text,
                0..text.len(),
                what,
                format!("write it like {examples}"),
            ));
        }
        Ok(Nanos(ns))
    }
}

impl FromStr for Femtometres {
    type Err = ParseError;
    fn from_str(text: &str) -> Result<Self, ParseError> {
        let examples = "50nm, 1.25um or 0.001mm";
        match quantity(text, &FEMTOMETRES, examples)? {
            0 => Err(ParseError::usage(
                text,
                "a length of 0",
                &format!("write it like {examples}"),
            )),
            fm => Ok(Femtometres(fm)),
        }
    }
}

impl fmt::Display for Hertz {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        print(f, u64::from(self.0), &HERTZ)
    }
}

impl fmt::Display for Nanos {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ascii = [NANOS[0], NANOS[1], NANOS[4], NANOS[5]];
        print(f, self.0, &ascii)
    }
}

impl fmt::Display for Femtometres {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [fm, pm, nm, um, _, _, mm, m] = FEMTOMETRES;
        print(f, self.0, &[fm, pm, nm, um, mm, m])
    }
}

/// In the largest unit that is not larger than the value, exactly.
fn print(f: &mut fmt::Formatter<'_>, value: u64, units: &[(&str, u64)]) -> fmt::Result {
    let (name, scale) = *units
        .iter()
        .rev()
        .find(|(_, scale)| value >= *scale)
        .unwrap_or(&units[0]);
    write!(f, "{}", value / scale)?;
    let mut rest = value % scale;
    if rest > 0 {
        f.write_str(".")?;
        let mut place = scale;
        while rest > 0 {
            place /= 10;
            write!(f, "{}", rest / place)?;
            rest %= place;
        }
    }
    f.write_str(name)
}

/// `0.01`, `1%` or `1`: how often something happens, 0 to 1, in parts per billion.
pub(crate) fn probability(text: &str) -> Result<u32, ParseError> {
    const ONE: u64 = 1_000_000_000;
    let parsed = match text.strip_suffix('%') {
        Some(percent) => scaled(percent, ONE / 100),
        None => scaled(text, ONE),
    };
    match parsed {
        Some(parts) if parts <= ONE => Ok(parts as u32),
        _ => Err(ParseError::new(
            text,
            0..text.len(),
            format!("`{text}` is not a probability"),
            "write 0.01 or 1%, from 0 to 1",
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_what_people_write() {
        for (text, ns) in [
            ("40us", 40_000),
            ("40µs", 40_000),
            ("40 μs", 40_000),
            ("12.5us", 12_500),
            ("1ms", 1_000_000),
            ("2s", 2_000_000_000),
            ("7ns", 7),
            ("0us", 0),
            (".5ms", 500_000),
        ] {
            assert_eq!(text.parse::<Nanos>().unwrap(), Nanos(ns), "{text}");
        }
        for (text, hz) in [
            ("500kHz", 500_000),
            ("2MHz", 2_000_000),
            ("2mhz", 2_000_000),
            ("1.25MHz", 1_250_000),
            ("50Hz", 50),
        ] {
            assert_eq!(text.parse::<Hertz>().unwrap(), Hertz(hz), "{text}");
        }
        assert_eq!(probability("1%").unwrap(), 10_000_000);
        assert_eq!(probability("0.25").unwrap(), 250_000_000);
        assert_eq!(probability("1").unwrap(), 1_000_000_000);
    }

    #[test]
    fn a_bare_number_names_the_units() {
        let error = "40".parse::<Nanos>().unwrap_err().to_string();
        assert!(
            error.contains("no unit") && error.contains("40us"),
            "{error}"
        );
        for bad in [
            "",
            "us",
            "-1us",
            "1e3us",
            "1.5ns",
            "40usx",
            "99999999999999999999s",
            "1..2us",
        ] {
            assert!(bad.parse::<Nanos>().is_err(), "{bad}");
        }
        for bad in ["1", "0Hz", "5GHz", "5000MHz", "1us"] {
            assert!(bad.parse::<Hertz>().is_err(), "{bad}");
        }
        for bad in ["", "2", "101%", "-1", "x"] {
            assert!(probability(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn prints_what_it_reads() {
        for ns in [
            0,
            1,
            999,
            1_000,
            12_500,
            40_000,
            1_000_000,
            1_234_567_891,
            60_000_000_000,
        ] {
            assert_eq!(Nanos(ns).to_string().parse::<Nanos>().unwrap(), Nanos(ns));
        }
        assert_eq!(Nanos(12_500).to_string(), "12.5us");
        assert_eq!(Hertz(1_250_000).to_string(), "1.25MHz");
        for (text, fm) in [
            ("50nm", 50_000_000),
            ("244.140625nm", 244_140_625),
            ("1.25um", 1_250_000_000),
            ("1pm", 1_000),
            ("2mm", 2_000_000_000_000),
            ("1m", 1_000_000_000_000_000),
        ] {
            assert_eq!(text.parse::<Femtometres>().unwrap(), Femtometres(fm));
            assert_eq!(Femtometres(fm).to_string(), text);
        }
        for bad in ["50", "0nm", "1km", "0.1fm", "nm", "-1nm", "99999m", "1e3nm"] {
            assert!(bad.parse::<Femtometres>().is_err(), "{bad}");
        }
    }
}
