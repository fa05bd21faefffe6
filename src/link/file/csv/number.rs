//! Decimals and dates, as integers all the way.

use super::super::text::digits;

/// A second.
pub(super) const SECOND_FS: i128 = 1_000_000_000_000_000;

/// A time or a sample number: femtoseconds, where the column counts in ten to the so manieth.
#[inline(always)]
pub(super) fn stamp(field: &[u8], exponent: i32) -> Option<i128> {
    match field.get(4) {
        Some(b'-') if field.len() > 10 => date(field),
        _ => decimal(field, exponent),
    }
}

/// `-0.00125`, `1,5`, `4.17e-08`, times ten to the `exponent`; rounded towards 0 where it has more digits.
#[inline(always)]
pub(super) fn decimal(field: &[u8], exponent: i32) -> Option<i128> {
    let negative = field.first() == Some(&b'-');
    let from = usize::from(negative || field.first() == Some(&b'+'));
    let (whole, n) = digits(field, from)?;
    let mut at = from + n;
    let (mut part, mut places, mut any) = (0, 0, n > 0);
    if matches!(field.get(at), Some(b'.' | b',')) {
        let (value, n, all) = fraction(field, at + 1)?;
        (part, places) = (value, n as i32);
        any |= all > 0;
        at += 1 + all;
    }
    let mut exponent = exponent;
    if matches!(field.get(at), Some(b'e' | b'E')) && any {
        let sign = field.get(at + 1);
        let skip = usize::from(matches!(sign, Some(b'-' | b'+')));
        let (value, n) = digits(field, at + 1 + skip)?;
        if n == 0 {
            return None;
        }
        let value = i32::try_from(value).ok()?.min(10_000);
        exponent += if sign == Some(&b'-') { -value } else { value };
        at += 1 + skip + n;
    }
    if !any || at != field.len() {
        return None;
    }
    let value = if places == 0 {
        scaled(i128::from(whole), exponent)?
    } else if (0..=15).contains(&exponent) && places <= exponent {
        // Nearly always: nothing is lost, and nothing is too large.
        i128::from(whole) * POWERS[exponent as usize]
            + i128::from(part) * POWERS[(exponent - places) as usize]
    } else {
        let both = i128::from(whole) * scaled(1, places)? + i128::from(part);
        scaled(both, exponent - places)?
    };
    Some(if negative { -value } else { value })
}

const POWERS: [i128; 16] = {
    let mut powers = [1; 16];
    let mut at = 1;
    while at < 16 {
        powers[at] = powers[at - 1] * 10;
        at += 1;
    }
    powers
};

/// Digits behind the point: the value of the first 18, how many those are, and how many there are.
#[inline(always)]
fn fraction(field: &[u8], at: usize) -> Option<(u64, usize, usize)> {
    let all = field.get(at..)?;
    let all = all
        .iter()
        .position(|b| !b.is_ascii_digit())
        .unwrap_or(all.len());
    if all <= 18 {
        let (value, n) = digits(field, at)?;
        return Some((value, n, all));
    }
    let (value, n) = digits(&field[..at + 18], at)?;
    Some((value, n, all))
}

/// Times ten to the `exponent`, rounded towards 0.
fn scaled(value: i128, exponent: i32) -> Option<i128> {
    let n = exponent.unsigned_abs();
    if value == 0 {
        return Some(0);
    }
    match exponent {
        0.. => value.checked_mul(10i128.checked_pow(n)?),
        _ => Some(10i128.checked_pow(n).map_or(0, |power| value / power)),
    }
}

/// `2024-01-31T10:11:12.123456789+01:00`: femtoseconds since 1970.
#[cold]
fn date(field: &[u8]) -> Option<i128> {
    let number = |from: usize, to: usize| -> Option<i64> {
        let digits = field.get(from..to)?;
        let all = digits.iter().all(u8::is_ascii_digit);
        std::str::from_utf8(digits)
            .ok()
            .filter(|_| all)?
            .parse()
            .ok()
    };
    let mark = |at: usize, any: &[u8]| field.get(at).filter(|b| any.contains(b));
    mark(4, b"-").and(mark(7, b"-"))?;
    mark(10, b"Tt ").and(mark(13, b":")).and(mark(16, b":"))?;
    let (year, month, day) = (number(0, 4)?, number(5, 7)?, number(8, 10)?);
    let (hour, minute, second) = (number(11, 13)?, number(14, 16)?, number(17, 19)?);
    let valid = (1..=12).contains(&month)
        && (1..=31).contains(&day)
        && hour < 24
        && minute < 60
        && second <= 60;
    if !valid {
        return None;
    }
    let (part, zone_at) = match mark(19, b".,") {
        Some(_) => {
            let end = field[20..].iter().position(|b| !b.is_ascii_digit());
            let end = end.map_or(field.len(), |n| 20 + n);
            let mut part = b"0.".to_vec();
            part.extend_from_slice(&field[20..end]);
            (decimal(&part, 15).filter(|_| end > 20)?, end)
        }
        None => (0, 19),
    };
    let zone = &field[zone_at..];
    let offset_min = match zone {
        b"" | b"Z" | b"z" => 0,
        [sign @ (b'+' | b'-'), ..] => {
            let colon = usize::from(zone.get(3) == Some(&b':'));
            let hours = number(zone_at + 1, zone_at + 3)?;
            let minutes = match zone.len() {
                3 => 0,
                _ => number(zone_at + 3 + colon, zone_at + 5 + colon)?,
            };
            if zone.len() != 3 && zone.len() != 5 + colon {
                return None;
            }
            let offset = hours * 60 + minutes;
            if *sign == b'-' { -offset } else { offset }
        }
        _ => return None,
    };
    // Days since 1970 in a calendar that begins its years in March.
    let (year, month) = if month < 3 {
        (year - 1, month + 9)
    } else {
        (year, month - 3)
    };
    let days =
        year * 365 + year / 4 - year / 100 + year / 400 + (month * 153 + 2) / 5 + day - 1 - 719_468;
    let seconds = (days * 24 + hour) * 3600 + (minute - offset_min) * 60 + second;
    Some(i128::from(seconds) * SECOND_FS + part)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimals_are_exact() {
        for (text, exponent, fs) in [
            ("0", 15, 0),
            ("-0.000000001", 15, -1_000_000),
            ("7.642110550000000", 15, 7_642_110_550_000_000),
            (
                "12345678901.123456789012345",
                15,
                12_345_678_901_123_456_789_012_345,
            ),
            ("0,000000000000001", 15, 1),
            ("1e-08", 15, 10_000_000),
            ("4.16666666666667E-08", 15, 41_666_666),
            ("1.5e3", 6, 1_500_000_000),
            (".5", 12, 500_000_000_000),
            ("5.", 12, 5_000_000_000_000),
            ("+0.3", 0, 0),
            (
                "0.1000000000000000055511151231257827",
                15,
                100_000_000_000_000,
            ),
            ("18446744073709551615", 15, i128::from(u64::MAX) * SECOND_FS),
            ("1e-400", 15, 0),
            ("0e400", 15, 0),
        ] {
            assert_eq!(decimal(text.as_bytes(), exponent), Some(fs), "{text}");
        }
        for bad in [
            "",
            "-",
            ".",
            "e5",
            "1e",
            "1e+",
            "1.2.3",
            "1 2",
            "0x1",
            "--1",
            "1-",
            "nan",
            "1e99999999999999999999",
            "1e400",
            "18446744073709551616",
        ] {
            assert_eq!(decimal(bad.as_bytes(), 15), None, "{bad}");
        }
    }

    #[test]
    fn random_decimals_equal_their_digits() {
        let seed = fastrand::u64(..);
        println!("seed {seed}");
        let mut rng = fastrand::Rng::with_seed(seed);
        for _ in 0..20_000 {
            let (whole, places) = (rng.u64(..) >> rng.u8(..64), rng.usize(0..=15));
            let part = rng.u64(..10u64.pow(places as u32));
            let digits = format!("{part:0places$}");
            let text = match places {
                0 => whole.to_string(),
                _ => format!("{whole}.{digits}"),
            };
            let want =
                i128::from(whole) * SECOND_FS + i128::from(part) * 10i128.pow(15 - places as u32);
            assert_eq!(decimal(text.as_bytes(), 15), Some(want), "{text}");
            let shift = rng.i32(-9..=0);
            let text = format!("{text}e{shift}");
            let want = want / 10i128.pow(shift.unsigned_abs());
            assert_eq!(decimal(text.as_bytes(), 15), Some(want), "{text}");
        }
    }

    #[test]
    fn dates_are_seconds_since_1970() {
        for (text, seconds) in [
            ("1970-01-01T00:00:00Z", 0),
            ("2000-02-29T23:59:60", 951_868_800),
            ("2024-03-01 00:00:00+00:00", 1_709_251_200),
            ("2024-01-01T01:00:00+01:00", 1_704_067_200),
            ("2023-12-31T19:30:00-0430", 1_704_067_200),
            ("2024-01-01T05:00:00+05", 1_704_067_200),
            ("1969-12-31T23:59:59Z", -1),
        ] {
            assert_eq!(date(text.as_bytes()), Some(seconds * SECOND_FS), "{text}");
        }
        let part = date(b"1970-01-01T00:00:01.123456789+00:00");
        assert_eq!(part, Some(1_123_456_789_000_000));
        for bad in [
            "2024-13-01T00:00:00",
            "2024-01-01T00:00",
            "2024-01-01T00:00:00.",
            "2024-01-01T00:00:00+1",
            "2024-01-01T24:00:00",
            "2024-01-01T00:00:00 UTC",
            "2024/01/01T00:00:00",
        ] {
            assert_eq!(date(bad.as_bytes()), None, "{bad}");
        }
    }
}
