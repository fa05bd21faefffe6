//! Positions as angles and lengths: degrees, radians, turns, millimetres, micrometres.
//!
//! What comes out of here is worked out from numbers that were sent, and stands beside them.

use crate::format::{Channel, Format, Kind};
use crate::parse::ParseError;
use crate::place::{self, Number};
use crate::unit::Femtometres;
use std::f64::consts::TAU;
use std::fmt;
use std::str::FromStr;

/// What a position is measured in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Degrees.
    Degrees,
    /// Radians.
    Radians,
    /// Turns, those of a multi-turn counter too.
    Turns,
    /// Millimetres.
    Millimetres,
    /// Micrometres.
    Micrometres,
    /// Nothing: counts only.
    None,
}

const UNITS: [Unit; 6] = [
    Unit::Degrees,
    Unit::Radians,
    Unit::Turns,
    Unit::Millimetres,
    Unit::Micrometres,
    Unit::None,
];

const UNIT_NAMES: &str = "units are deg rad turns mm um, and none for counts alone";

impl Unit {
    /// As users write it, and as the key in a record.
    pub fn name(self) -> &'static str {
        match self {
            Unit::Degrees => "deg",
            Unit::Radians => "rad",
            Unit::Turns => "turns",
            Unit::Millimetres => "mm",
            Unit::Micrometres => "um",
            Unit::None => "none",
        }
    }

    fn is_angle(self) -> bool {
        matches!(self, Unit::Degrees | Unit::Radians | Unit::Turns)
    }
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Unit {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Unit, ParseError> {
        if let Some(unit) = UNITS.into_iter().find(|unit| unit.name() == text) {
            return Ok(unit);
        }
        match text {
            "turn" => Ok(Unit::Turns),
            "µm" | "μm" => Ok(Unit::Micrometres),
            _ => Err(ParseError::usage(
                text,
                &format!("unknown unit `{text}`"),
                UNIT_NAMES,
            )),
        }
    }
}

/// How much a count is: `8192` to a turn, `50nm` each, or `2mm/8192`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Resolution {
    /// So many counts are a turn.
    Turn(u64),
    /// So many counts are so long.
    Length {
        /// How long they are together.
        length: Femtometres,
        /// How many they are.
        counts: u32,
    },
}

impl FromStr for Resolution {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Resolution, ParseError> {
        const HINT: &str = "counts of a turn, such as 8192, or the measuring step of a linear encoder, such as 50nm or 2mm/8192";
        let wrong = |what: String| ParseError::usage(text, &what, HINT);
        let digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
        if digits(text) {
            return match text.parse() {
                Ok(counts) if counts > 0 => Ok(Resolution::Turn(counts)),
                _ => Err(wrong(format!("a turn does not have {text} counts"))),
            };
        }
        let (length, counts) = text.split_once('/').unwrap_or((text, "1"));
        let counts = match counts.parse() {
            Ok(number) if number > 0 && digits(counts) => number,
            _ => return Err(wrong(format!("`{counts}` is no number of counts"))),
        };
        let length = length
            .parse()
            .map_err(|error: ParseError| wrong(error.what().to_owned()))?;
        Ok(Resolution::Length { length, counts })
    }
}

impl fmt::Display for Resolution {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Resolution::Turn(counts) => write!(f, "{counts}"),
            Resolution::Length { length, counts: 1 } => write!(f, "{length}"),
            Resolution::Length { length, counts } => write!(f, "{length}/{counts}"),
        }
    }
}

/// Why positions of a format cannot be measured so.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Misfit(String);

impl fmt::Display for Misfit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Misfit {}

/// How the positions of a channel are measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Scale {
    unit: Unit,
    number: Number,
    /// Counts of a turn, 0 of a length.
    turn: i128,
    /// A count is so many units divided by `divisor`; radians count turns here.
    factor: u64,
    divisor: i128,
    /// Decimals that tell two counts apart.
    digits: usize,
    /// Degrees of a turn of so many bits.
    bits: Option<u8>,
}

/// How every channel of a format is measured; none where it is not. Without a unit and a resolution that is degrees, of
/// single-turn positions.
///
/// # Errors
/// When unit, resolution and format do not fit together.
pub fn scales(
    format: &Format,
    unit: Option<Unit>,
    resolution: Option<Resolution>,
) -> Result<Vec<Option<Scale>>, Misfit> {
    let channels = format.channels();
    let scale = |channel| Scale::of(channel, unit, resolution);
    let scales: Vec<Option<Scale>> = channels.iter().map(scale).collect::<Result<_, _>>()?;
    let asked = unit.map(|unit| format!("unit {unit}"));
    let asked = asked.or_else(|| Some(format!("resolution {}", resolution?)));
    let (Some(asked), true) = (asked, scales.iter().all(Option::is_none)) else {
        return Ok(scales);
    };
    if channels.iter().all(|channel| channel.position().is_none()) {
        return Err(Misfit(format!(
            "{asked} measures a position, and `{format}` has none\n  it would be stN or posN"
        )));
    }
    match unit {
        Some(Unit::None) => Ok(scales),
        _ => Err(Misfit(format!(
            "{asked}: a pos field is no angle by itself, and `{format}` has no other\n  \
             say how many counts a turn has: resolution 8192"
        ))),
    }
}

impl Scale {
    /// None for a channel without a position, and where it is not measured.
    fn of(
        channel: &Channel,
        unit: Option<Unit>,
        resolution: Option<Resolution>,
    ) -> Result<Option<Scale>, Misfit> {
        let Some(number) = number(channel, resolution)? else {
            return Ok(None);
        };
        let field = channel.find(|kind| *kind == Kind::SingleTurn);
        let unit = unit.or(match resolution {
            Some(Resolution::Turn(_)) => Some(Unit::Degrees),
            Some(Resolution::Length { .. }) => Some(Unit::Millimetres),
            None => field.map(|_| Unit::Degrees),
        });
        let Some(unit) = unit.filter(|unit| *unit != Unit::None) else {
            return Ok(None);
        };
        let angle = |turn: i128| {
            let factor = if unit == Unit::Degrees { 360 } else { 1 };
            Scale::new(unit, number.clone(), turn, factor, turn)
        };
        match (unit.is_angle(), resolution) {
            (true, Some(Resolution::Turn(counts))) => Ok(Some(angle(counts.into()))),
            (true, None) => Ok(field.map(|field| angle(1 << field.bits()))),
            (false, Some(Resolution::Length { length, counts })) => {
                let femtometres = match unit {
                    Unit::Micrometres => 1_000_000_000,
                    _ => 1_000_000_000_000,
                };
                let divisor = femtometres * i128::from(counts);
                let scale = Scale::new(unit, number, 0, length.0, divisor);
                Ok(Some(scale))
            }
            (false, _) => Err(Misfit(format!(
                "unit {unit} takes the measuring step of the encoder\n  \
                 say it as a length: resolution 50nm, or 2mm/8192"
            ))),
            (true, Some(resolution)) => Err(Misfit(format!(
                "unit {unit} is an angle, and resolution {resolution} a length\n  \
                 take unit mm, or say how many counts a turn has"
            ))),
        }
    }

    fn new(unit: Unit, number: Number, turn: i128, factor: u64, divisor: i128) -> Scale {
        let common = gcd(factor.into(), divisor);
        let (factor, divisor) = ((i128::from(factor) / common) as u64, divisor / common);
        Scale {
            unit,
            number,
            turn,
            factor,
            divisor,
            digits: decimals(unit, factor, divisor),
            bits: (unit == Unit::Degrees && turn & (turn - 1) == 0 && turn >= 64)
                .then_some(turn.trailing_zeros() as u8),
        }
    }

    /// What values are in.
    pub fn unit(&self) -> Unit {
        self.unit
    }

    /// The number that a word's position is, turns included; none where the position is beyond its turn.
    pub fn number(&self, data: u64) -> Option<u64> {
        self.number.is_within(data).then(|| self.number.get(data))
    }

    /// The value of so many counts, and as many decimals as their resolution needs. Degrees and radians are within a turn
    /// unless `unwrapped` asks for all of them.
    pub fn value(&self, counts: i128, unwrapped: bool) -> (f64, usize) {
        if let Some(bits) = self.bits {
            return place::degrees(counts, bits, unwrapped);
        }
        let within = matches!(self.unit, Unit::Degrees | Unit::Radians) && !unwrapped;
        let counts = match within {
            true => counts.rem_euclid(self.turn),
            false => counts,
        };
        let rough = counts as f64 / self.divisor as f64 * self.factor();
        let digits = shown(self.digits, rough);
        let scale = 10f64.powi(digits as i32);
        let exact = self.exact(counts, digits);
        let mut scaled = exact.map_or((rough * scale).round(), |scaled| scaled as f64);
        // Cut off, not rounded, where rounding would make the first count of the next round of it.
        if let Some(full) = self.full().filter(|_| !unwrapped) {
            scaled = scaled.min((full * scale).ceil() - 1.0);
        }
        (scaled / scale, digits)
    }

    /// The value in units of its last digit, as far as 128 bits reach.
    fn exact(&self, counts: i128, digits: usize) -> Option<i128> {
        if self.unit == Unit::Radians {
            return None;
        }
        let power = 10i128.checked_pow(digits as u32)?;
        let twice = counts
            .checked_mul(2)?
            .checked_mul(self.factor.into())?
            .checked_mul(power)?;
        let away = twice.abs().checked_add(self.divisor)? / (2 * self.divisor);
        Some(away * twice.signum())
    }

    /// The value of a difference or a speed in counts, which no round takes anything from.
    pub fn of_counts(&self, counts: f64) -> f64 {
        counts / self.divisor as f64 * self.factor()
    }

    /// Counts of a turn; none of lengths.
    pub fn turn(&self) -> Option<f64> {
        (self.turn > 0).then_some(self.turn as f64)
    }

    fn factor(&self) -> f64 {
        match self.unit {
            Unit::Radians => TAU,
            _ => self.factor as f64,
        }
    }

    /// Where values begin anew.
    fn full(&self) -> Option<f64> {
        match self.unit {
            Unit::Degrees => Some(360.0),
            Unit::Radians => Some(TAU),
            Unit::Turns => Some(self.number.range() as f64 / self.turn as f64),
            _ => None,
        }
    }
}

/// A channel's number: on a line with a measuring step, else of turns that may have fewer counts than their field could hold.
///
/// # Errors
/// When they would have more.
pub fn number(channel: &Channel, resolution: Option<Resolution>) -> Result<Option<Number>, Misfit> {
    let Some(number) = Number::of(channel) else {
        return Ok(None);
    };
    if let Some(Resolution::Length { .. }) = resolution {
        return Ok(Some(number.on_a_line()));
    }
    let field = channel.find(|kind| *kind == Kind::SingleTurn);
    let (Some(field), Some(Resolution::Turn(counts))) = (field, resolution) else {
        return Ok(Some(number));
    };
    let bits = field.bits();
    match u128::from(counts) > 1 << bits {
        true => Err(Misfit(format!(
            "resolution {counts}: st{bits} counts from 0 to {}, a turn cannot have more\n  \
             a position that goes on over several turns is written pos{bits}",
            (1u128 << bits) - 1
        ))),
        false => Ok(Some(number.of_turns(counts))),
    }
}

fn gcd(a: i128, b: i128) -> i128 {
    match b {
        0 => a.max(1),
        _ => gcd(b, a % b),
    }
}

/// More decimals than a 64-bit float can tell apart.
const MOST_DIGITS: usize = 15;

/// As many decimals as tell two counts apart, and one more where no number of them is the step itself.
fn decimals(unit: Unit, factor: u64, divisor: i128) -> usize {
    let size = match unit {
        Unit::Radians => TAU,
        _ => factor as f64,
    };
    let (mut digits, mut power) = (0, 1i128);
    while digits < MOST_DIGITS && power as f64 * size < divisor as f64 {
        digits += 1;
        power *= 10;
    }
    let exact = unit != Unit::Radians && i128::from(factor) * power % divisor == 0;
    if exact { digits } else { digits + 1 }
}

/// Digits before the point take their share, three at least.
fn shown(digits: usize, value: f64) -> usize {
    let fits = |before: &usize| 10f64.powi(*before as i32) > value.abs();
    let before = (3..=MOST_DIGITS).find(fits).unwrap_or(MOST_DIGITS + 1);
    digits.min(MOST_DIGITS + 1 - before)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn format(text: &str) -> Format {
        text.parse().unwrap_or_else(|e| panic!("{e}"))
    }

    fn scale(frame: &str, unit: &str, resolution: &str) -> Result<Scale, String> {
        let unit = (!unit.is_empty()).then(|| unit.parse().unwrap());
        let resolution = (!resolution.is_empty()).then(|| resolution.parse().unwrap());
        let all = scales(&format(frame), unit, resolution).map_err(|misfit| misfit.to_string())?;
        all.into_iter()
            .next()
            .flatten()
            .ok_or_else(|| "none".into())
    }

    #[test]
    fn values_have_the_digits_of_their_resolution() {
        for (frame, unit, resolution, counts, unwrapped, text) in [
            ("st10", "", "", 512, false, "180.00 deg"),
            ("st10", "", "", 1024 + 512, false, "180.00 deg"),
            ("st10", "deg", "", -1, false, "359.65 deg"),
            ("st10", "deg", "", -1, true, "-0.35 deg"),
            ("st10", "rad", "", 512, false, "3.1416 rad"),
            ("st10", "rad", "", 1023, false, "6.2770 rad"),
            ("st10", "turn", "", 512, false, "0.50000 turns"),
            ("st10", "turns", "", 1023, false, "0.99902 turns"),
            (
                "mt4,st10",
                "turn",
                "",
                3 << 10 | 512,
                false,
                "3.50000 turns",
            ),
            ("mt4,st10", "deg", "", 3 << 10 | 512, false, "180.00 deg"),
            ("mt4,st10", "deg", "", 3 << 10 | 512, true, "1260.00 deg"),
            ("st16", "", "50000", 12_500, false, "90.0000 deg"),
            ("st16", "", "36000", 35_999, false, "359.99 deg"),
            ("st16", "turn", "1000", 1, false, "0.001 turns"),
            ("pos8", "", "10", 1, false, "36 deg"),
            ("pos8", "", "16", 1, false, "22.5 deg"),
            ("st4", "", "", 1, false, "22.5 deg"),
            ("pos24", "deg", "2000", 2_500, false, "90.00 deg"),
            ("pos24", "turn", "2000", 2_500, false, "1.2500 turns"),
            ("pos24", "", "50nm", 20_000, false, "1.00000 mm"),
            ("pos24", "um", "50nm", 1, false, "0.05 um"),
            ("pos24", "um", "5um", 3, false, "15 um"),
            ("pos24", "mm", "244.140625nm", 4096, false, "1.00000 mm"),
            ("pos24", "mm", "2mm/8192", 8191, false, "1.99976 mm"),
            ("pos24", "mm", "1um", -1, true, "-0.001 mm"),
            ("st26", "mm", "1nm", 67_108_863, false, "67.108863 mm"),
            ("mt2,pos8", "um", "1um", 0x3FF, false, "1023 um"),
            // One count less than all of it stays below it, and digits that a float does not have are not shown.
            (
                "st64",
                "deg",
                "",
                i128::from(u64::MAX),
                false,
                "359.9999999999999 deg",
            ),
            (
                "st64",
                "rad",
                "",
                i128::from(u64::MAX),
                false,
                "6.2831853071795 rad",
            ),
            (
                "st64",
                "turn",
                "",
                i128::from(u64::MAX),
                false,
                "0.9999999999999 turns",
            ),
            (
                "pos64",
                "mm",
                "1fm",
                i128::from(u64::MAX),
                false,
                "18446744.07370955 mm",
            ),
        ] {
            let scale = scale(frame, unit, resolution).unwrap_or_else(|e| panic!("{e}"));
            let (value, digits) = scale.value(counts, unwrapped);
            let name = scale.unit();
            assert_eq!(
                format!("{value:.digits$} {name}"),
                text,
                "{frame} {unit} {resolution} {counts}"
            );
        }
    }

    /// Against integers: the last digit is the nearest one.
    #[test]
    fn values_are_rounded_from_the_exact_ones() {
        let seed = fastrand::u64(..);
        println!("seed {seed}");
        let mut rng = fastrand::Rng::with_seed(seed);
        for _ in 0..20_000 {
            let (counts, per) = (rng.i128(-(1 << 40)..1 << 40), rng.u32(1..1 << 24));
            let (unit, resolution, factor, divisor) = match rng.u8(..3) {
                0 => ("deg", per.to_string(), 360, i128::from(per)),
                1 => ("turn", per.to_string(), 1, i128::from(per)),
                _ => {
                    let nm = rng.u32(1..100_000);
                    let divisor = i128::from(per) * 1_000_000;
                    ("mm", format!("{nm}nm/{per}"), i128::from(nm), divisor)
                }
            };
            let scale = scale("pos48", unit, &resolution).unwrap();
            let (value, digits) = scale.value(counts, true);
            let power = 10i128.pow(digits as u32);
            let shown = format!("{value:.digits$}").replace(['.', '-'], "");
            let shown: i128 = shown.parse().unwrap();
            // Twice the error in last digits, times the divisor.
            let off = 2 * (shown * divisor - counts.abs() * factor * power).abs();
            // The last of sixteen digits is more than a float has.
            assert!(
                off <= divisor + divisor / 4,
                "{counts} {resolution} {unit}: {value}"
            );
        }
    }

    #[test]
    fn a_turn_may_have_fewer_counts_than_its_field() {
        let scale = scale("mt4,st16,nE,crc6", "turn", "50000").unwrap();
        let word = |turn: u64, position: u64| (turn << 16 | position) << 1 | 1;
        assert_eq!(scale.number(word(3, 25_000)), Some(175_000));
        assert_eq!(scale.number(word(15, 49_999)), Some(799_999));
        assert_eq!(scale.value(175_000, false).0, 3.5);
        assert_eq!(scale.number(word(3, 50_000)), None, "beyond the turn");
    }

    #[test]
    fn what_does_not_fit_together_is_said() {
        for (frame, unit, resolution, words) in [
            ("pos24", "deg", "", "say how many counts a turn has"),
            ("pos24", "mm", "", "takes the measuring step"),
            ("st24", "mm", "1000", "takes the measuring step"),
            ("st24", "rad", "50nm", "is an angle"),
            ("st12", "", "4097", "st12 counts from 0 to 4095"),
            ("data8", "deg", "", "`data8` has none"),
            ("data8", "", "50nm", "resolution 50nm measures a position"),
            ("st12", "none", "", "none"),
            ("pos12", "", "", "none"),
        ] {
            let said = scale(frame, unit, resolution).unwrap_err();
            assert!(said.contains(words), "{frame} {unit} {resolution}: {said}");
        }
        let both = scales(&format("st12+pos8+data4"), Some(Unit::Radians), None).unwrap();
        assert_eq!(
            both.iter().map(Option::is_some).collect::<Vec<_>>(),
            [true, false, false]
        );
    }

    #[test]
    fn resolutions_print_as_they_are_read() {
        for text in [
            "8192",
            "50nm",
            "2mm/8192",
            "244.140625nm",
            "18446744073709551615",
        ] {
            assert_eq!(text.parse::<Resolution>().unwrap().to_string(), text);
        }
        for bad in [
            "",
            "0",
            "-1",
            "1.5",
            "18446744073709551616",
            "0nm",
            "50 km",
            "2mm/0",
            "2mm/",
            "/4",
            "2mm/4/4",
            "2mm/+4",
            "nm",
            "2mm/é",
        ] {
            let error = bad.parse::<Resolution>().expect_err(bad);
            assert!(error.to_string().contains("such as 8192"), "{bad}: {error}");
        }
        for unit in UNITS {
            assert_eq!(unit.name().parse(), Ok(unit));
        }
        assert_eq!("µm".parse(), Ok(Unit::Micrometres));
        assert!(
            "inch"
                .parse::<Unit>()
                .unwrap_err()
                .to_string()
                .contains("mm um")
        );
    }
}
