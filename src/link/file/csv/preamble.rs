//! What stands in a CSV before its rows: comments of a program, and the names of the columns.

use super::super::text::Text;
use super::number::{decimal, stamp};
use super::{BOM, Clock, Layout, UTF_16, field, is_aside, is_line_end, level, line_end, quoted};

const COLUMNS_MAX: usize = 4096;

/// What stands before the first row.
#[derive(Debug, Default)]
pub(super) struct Preamble {
    /// From libsigrok's comments.
    rate_hz: Option<u64>,
    names: Vec<String>,
    separator: Option<u8>,
    /// The first line that is no comment.
    first: Vec<String>,
    first_line: u64,
    /// It is a header, and not a row.
    header: bool,
}

impl Preamble {
    /// Stops before the first row.
    pub(super) fn read(text: &mut Text) -> Result<Preamble, String> {
        let mut found = Preamble::default();
        let mut begun = false;
        while text.more("a line", is_line_end)? {
            let at = text.at;
            let end = line_end(text.window(), at);
            let mut line = &text.window()[at..end];
            if !begun {
                if UTF_16.iter().any(|mark| line.starts_with(mark)) {
                    return Err("this is UTF-16: export or save it as UTF-8".into());
                }
                line = line.strip_prefix(BOM).unwrap_or(line);
                begun = true;
            }
            let line = String::from_utf8_lossy(line.trim_ascii_end()).into_owned();
            // Counted only where it is told.
            let place = |text: &Text, said: String| format!("line {}: {said}", text.line(at));
            let next = end + 1;
            if line.is_empty() {
                text.at = next;
            } else if is_aside(line.as_bytes(), found.separator.unwrap_or(0)) {
                found.comment(&line).map_err(|said| place(text, said))?;
                text.at = next;
            } else if let [b's', b'e', b'p', b'=', separator] = line.as_bytes() {
                // Excel's.
                (found.separator, text.at) = (Some(*separator), next);
            } else {
                found.first_line = text.line(at);
                found.row(&line).map_err(|said| place(text, said))?;
                if found.header {
                    text.at = next;
                    // Rows, by which times can be told from sample numbers.
                    text.more("a line", is_line_end)?;
                }
                return Ok(found);
            }
        }
        Err("it has no rows".into())
    }

    fn comment(&mut self, line: &str) -> Result<(), String> {
        let lower = line.to_ascii_lowercase();
        let after = |key: &str| lower.find(key).map(|at| line[at + key.len()..].trim());
        if let Some(text) = after("samplerate:").or(after("sample rate:")) {
            let rate = rate(text).ok_or_else(|| format!("`{text}` is no sample rate"))?;
            self.rate_hz = Some(rate);
        } else if lower.contains("channels (") {
            if let Some((_, names)) = line.split_once("):") {
                self.names = names
                    .split(',')
                    .map(|name| name.trim().to_owned())
                    .collect();
            }
        }
        Ok(())
    }

    /// The first line that is no comment.
    fn row(&mut self, line: &str) -> Result<(), String> {
        let separator = self.separator.unwrap_or_else(|| separator(line));
        self.separator = Some(separator);
        let mut bytes = line.as_bytes().to_vec();
        bytes.push(b'\n');
        let mut at = 0;
        while at < bytes.len() {
            let (range, next) = field(&bytes, at, separator);
            self.first
                .push(String::from_utf8_lossy(&bytes[range]).into_owned());
            if self.first.len() > COLUMNS_MAX {
                return Err(format!("more than {COLUMNS_MAX} columns"));
            }
            at = next + 1;
        }
        if self.first.len() < 2 {
            return Err(format!("{} has no columns", quoted(line.as_bytes())));
        }
        let value = |f: &String| level(f.as_bytes()).is_some() || stamp(f.as_bytes(), 15).is_some();
        self.header = !self.first.iter().all(value) || self.first == self.names;
        Ok(())
    }

    pub(super) fn layout(self, text: &Text, asked_hz: Option<u64>) -> Result<Layout, String> {
        let separator = self.separator.unwrap_or(b',');
        let mut names: Vec<String> = match self.header {
            true => self.first.clone(),
            false => vec![String::new(); self.first.len()],
        };
        let rows = Rows::of(text, separator);
        let column = match self.header {
            true => time_column(&names),
            // Without a header: what is no level, or what is more than there are channels.
            false if names.len() == self.names.len() + 1 && !self.names.is_empty() => {
                Some((0, Unit::Open))
            }
            false if rows.fractions => Some((0, Unit::Open)),
            false if rows.numbers => Some((0, Unit::Samples)),
            false => None,
        };
        let time_at = column.map(|(at, _)| at);
        // What libsigrok calls them, then their place.
        let from = usize::from(time_at == Some(0));
        for (place, name) in names.iter_mut().skip(from).enumerate() {
            if ["logic", ""].contains(&name.as_str()) {
                let known = self.names.get(place).filter(|name| !name.is_empty());
                *name = known.cloned().unwrap_or_else(|| place.to_string());
            }
        }
        let rate = || {
            let rate = asked_hz.or(self.rate_hz);
            rate.ok_or_else(|| {
                "it has neither times nor a sample rate: say it, as in file:PATH,rate=24MHz"
                    .to_owned()
            })
        };
        let clock = match column {
            None => Clock::Rows { rate_hz: rate()? },
            Some((at, Unit::Samples)) => Clock::Numbers {
                at,
                rate_hz: rate()?,
            },
            Some(_) if asked_hz.is_some() => {
                return Err("it has times of its own: leave rate= out".into());
            }
            Some((at, Unit::Known(exponent))) => Clock::Column { at, exponent },
            Some((at, Unit::Open)) => {
                let exponent = match self.rate_hz {
                    Some(hz) => sigrok_exponent(hz),
                    None if rows.fractions || rows.count < 2 => 15,
                    None => {
                        let (name, line) = (&names[at], self.first_line);
                        return Err(format!(
                            "line {line}: the column `{name}` does not say its unit: name it `{name} [ns]`, or as it is"
                        ));
                    }
                };
                Clock::Column { at, exponent }
            }
        };
        Ok(Layout {
            separator,
            names,
            clock,
        })
    }
}

/// What the first column of the rows that are there is made of.
#[derive(Debug, Default)]
struct Rows {
    count: usize,
    /// A point, an exponent, a date.
    fractions: bool,
    /// Neither 0 nor 1.
    numbers: bool,
}

impl Rows {
    fn of(text: &Text, separator: u8) -> Rows {
        let mut found = Rows::default();
        let (bytes, mut at) = (text.window(), text.at);
        while at < text.len() && found.count < 1000 {
            let (range, _) = field(bytes, at, separator);
            let word = &bytes[range];
            found.count += usize::from(!word.is_empty());
            found.fractions |= word.iter().skip(1).any(|b| b".,eE-".contains(b));
            found.numbers |= level(word).is_none();
            at = line_end(bytes, at) + 1;
        }
        found
    }
}

/// Of a time column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Unit {
    /// Ten to the so manieth femtoseconds.
    Known(i32),
    /// The header does not say.
    Open,
    /// It counts samples.
    Samples,
}

/// The first column that is called as times are, else one of sample numbers.
fn time_column(names: &[String]) -> Option<(usize, Unit)> {
    let units = names.iter().map(|name| unit(name));
    let mut all = units.enumerate().filter_map(|(at, unit)| Some((at, unit?)));
    let numbers = all
        .clone()
        .find(|(at, unit)| *at == 0 && *unit == Unit::Samples);
    all.find(|(_, unit)| *unit != Unit::Samples).or(numbers)
}

/// What a column's name says of time: `Time [s]`, `t_us`, `nanoseconds`.
fn unit(name: &str) -> Option<Unit> {
    let name = name.to_lowercase();
    let parts = name.split(|c: char| !c.is_alphanumeric() && c != 'µ' && c != 'μ');
    let parts: Vec<&str> = parts.filter(|part| !part.is_empty()).collect();
    let exponent = |unit: &str| match unit {
        "s" | "sec" | "secs" | "second" | "seconds" => Some(15),
        "ms" | "msec" | "millisecond" | "milliseconds" => Some(12),
        "us" | "µs" | "μs" | "usec" | "microsecond" | "microseconds" => Some(9),
        "ns" | "nsec" | "nanosecond" | "nanoseconds" => Some(6),
        "ps" | "picosecond" | "picoseconds" => Some(3),
        "fs" | "femtosecond" | "femtoseconds" => Some(0),
        _ => None,
    };
    match parts[..] {
        ["time" | "t" | "times" | "timestamp" | "timestamps"] | ["time", "stamp"] => {
            Some(Unit::Open)
        }
        ["time" | "t" | "times" | "timestamp" | "timestamps", unit] => {
            exponent(unit).map(Unit::Known)
        }
        ["sample" | "samples" | "index" | "n"]
        | ["sample" | "samples", "number" | "no" | "index" | "nr"] => Some(Unit::Samples),
        // Longer than one letter: `s` may be a signal.
        [unit] if unit.len() > 2 => exponent(unit).map(Unit::Known),
        _ => None,
    }
}

/// libsigrok counts time in the first of ms, us, ns… that has more of them a second than the sample rate.
fn sigrok_exponent(rate_hz: u64) -> i32 {
    let mut exponent = 15;
    let mut scale = 1u64;
    while scale < rate_hz && exponent > 0 {
        (scale, exponent) = (scale.saturating_mul(1000), exponent - 3);
    }
    exponent
}

/// `24 MHz`, `1.5 GHz`, `1000000`.
fn rate(text: &str) -> Option<u64> {
    let at = text
        .find(|c: char| !c.is_ascii_digit() && c != '.')
        .unwrap_or(text.len());
    let exponent = match text[at..].trim().to_ascii_lowercase().as_str() {
        "" | "hz" => 0,
        "khz" => 3,
        "mhz" => 6,
        "ghz" => 9,
        _ => return None,
    };
    let hz = decimal(&text.as_bytes()[..at], exponent)?;
    u64::try_from(hz).ok().filter(|hz| *hz > 0)
}

/// The one of the usual separators that stands in this line, outside quotes.
fn separator(line: &str) -> u8 {
    let mut inside = false;
    let outside = |byte: &u8| {
        inside ^= *byte == b'"';
        !inside
    };
    let bytes: Vec<u8> = line.bytes().filter(outside).collect();
    let there = |byte: &&u8| bytes.contains(*byte);
    b"\t;,".iter().find(there).copied().unwrap_or(b',')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_known_by_their_names() {
        for (name, known) in [
            ("Time [s]", Some(Unit::Known(15))),
            ("Time(s)", Some(Unit::Known(15))),
            ("time_us", Some(Unit::Known(9))),
            ("Time (\u{b5}s)", Some(Unit::Known(9))),
            ("t/ms", Some(Unit::Known(12))),
            ("nanoseconds", Some(Unit::Known(6))),
            ("Time", Some(Unit::Open)),
            ("Time Stamp", Some(Unit::Open)),
            ("Sample Number", Some(Unit::Samples)),
            ("S", None),
            ("Time [V]", None),
            ("SLO", None),
        ] {
            assert_eq!(unit(name), known, "{name}");
        }
    }
}
