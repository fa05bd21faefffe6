//! Text, a block at a time: what the readers of VCD and CSV stand on.

use super::source::Damage;
use std::io::{ErrorKind, Read};

/// Read at once.
const BLOCK: usize = 256 << 10;
/// A word or a line that is longer is none: a broken input shall not fill the memory.
const LONGEST: usize = 1 << 20;
/// Behind the text, so that whole words can be loaded from its last byte on. A power of two.
pub(super) const SLACK: usize = 32;

/// A window on the text.
pub(super) struct Text {
    input: Box<dyn Read>,
    bytes: Vec<u8>,
    /// What has been used of it.
    pub(super) at: usize,
    /// Behind the last one of its lines, or words, that has come whole.
    whole: usize,
    /// Behind the last byte that was read.
    end: usize,
    ended: bool,
    /// Ends of lines before the window.
    lines: u64,
}

impl Text {
    pub(super) fn new(input: impl Read + 'static) -> Text {
        Text {
            input: Box::new(input),
            bytes: vec![0; BLOCK + SLACK],
            at: 0,
            whole: 0,
            end: 0,
            ended: false,
            lines: 0,
        }
    }

    /// The text up to the end of the last part that is whole, and [`SLACK`] behind it.
    pub(super) fn window(&self) -> &[u8] {
        &self.bytes[..self.whole + SLACK]
    }

    /// What of the window is text.
    pub(super) fn len(&self) -> usize {
        self.whole
    }

    /// Reads on when all has been used, until a part is whole: it ends with a byte for which `ends` holds. False at the
    /// end of the text, whose last part counts as whole, with an end of line behind it.
    ///
    /// # Errors
    /// What the system said, or that the part, `what`, is too long.
    pub(super) fn more(&mut self, what: &str, ends: fn(u8) -> bool) -> Result<bool, String> {
        if self.at < self.whole {
            return Ok(true);
        }
        if self.ended {
            return Ok(false);
        }
        self.lines += newlines(&self.bytes[..self.at]);
        self.bytes.copy_within(self.at..self.end, 0);
        (self.end, self.at, self.whole) = (self.end - self.at, 0, 0);
        while !self.ended {
            let before = self.end;
            if before + SLACK == self.bytes.len() {
                if before > LONGEST {
                    return Err(format!("{what} of more than 1 MiB"));
                }
                self.bytes.resize((2 * before) + SLACK, 0);
            }
            let room = self.bytes.len() - SLACK;
            let n = match self.input.read(&mut self.bytes[before..room]) {
                Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                read => read.map_err(|error| error.to_string())?,
            };
            self.end += n;
            if n == 0 {
                self.ended = true;
            } else if let Some(last) = self.bytes[before..self.end].iter().rposition(|b| ends(*b)) {
                self.whole = before + last + 1;
                return Ok(true);
            }
        }
        if self.end == 0 {
            return Ok(false);
        }
        // There is room: a read of nothing found some.
        self.bytes[self.end] = b'\n';
        self.end += 1;
        self.whole = self.end;
        Ok(true)
    }

    /// The number of the line in which a byte of the window stands.
    pub(super) fn line(&self, at: usize) -> u64 {
        self.lines + newlines(&self.bytes[..at.min(self.end)]) + 1
    }

    /// Damage at a byte of the window.
    pub(super) fn damage(&self, at: usize, said: impl Into<String>) -> Damage {
        Damage {
            place: format!("line {}", self.line(at)),
            said: said.into(),
        }
    }
}

/// Ends of lines, counted a vector at a time.
fn newlines(bytes: &[u8]) -> u64 {
    let count = |chunk: &[u8]| chunk.iter().map(|b| u8::from(*b == b'\n')).sum::<u8>();
    bytes.chunks(255).map(|chunk| u64::from(count(chunk))).sum()
}

/// Eight bytes, the first one lowest; 0 behind the end.
#[inline(always)]
pub(super) fn load(bytes: &[u8], at: usize) -> u64 {
    match bytes.get(at..at + 8).map(<[u8; 8]>::try_from) {
        Some(Ok(eight)) => u64::from_le_bytes(eight),
        _ => load_last(bytes, at),
    }
}

fn load_last(bytes: &[u8], at: usize) -> u64 {
    let last = bytes.get(at..).unwrap_or_default();
    last.iter()
        .rev()
        .take(8)
        .fold(0, |word, b| word << 8 | u64::from(*b))
}

const POWERS: [u64; 9] = [
    1,
    10,
    100,
    1_000,
    10_000,
    100_000,
    1_000_000,
    10_000_000,
    100_000_000,
];

/// For each byte that is a digit its value, and the highest bit of the first one that is none.
#[inline(always)]
fn decode(bytes: &[u8], at: usize) -> (u64, u64) {
    let digits = load(bytes, at) ^ 0x3030_3030_3030_3030;
    // The lowest byte above 9 sets its highest bit; what a carry does above it does not matter.
    let others = digits.wrapping_add(0x7676_7676_7676_7676) | digits;
    (digits, others & 0x8080_8080_8080_8080)
}

/// The value of eight digits, the first one lowest.
#[inline(always)]
fn value(digits: u64) -> u64 {
    let pairs = digits.wrapping_mul(2561) >> 8 & 0x00ff_00ff_00ff_00ff;
    let fours = pairs.wrapping_mul(6_553_601) >> 16 & 0x0000_ffff_0000_ffff;
    fours.wrapping_mul(42_949_672_960_001) >> 32
}

/// The value of eight digits, when there are so many.
#[inline(always)]
pub(super) fn all_eight(bytes: &[u8], at: usize) -> Option<u64> {
    let (digits, others) = decode(bytes, at);
    (others == 0).then(|| value(digits))
}

/// Up to eight digits: their value and how many.
#[inline(always)]
fn eight_digits(bytes: &[u8], at: usize) -> (u64, usize) {
    let (digits, others) = decode(bytes, at);
    let n = (others.trailing_zeros() / 8) as usize;
    if n == 0 {
        return (0, 0);
    }
    (value(digits << (64 - 8 * n)), n)
}

/// Digits, as many as there are: their value and how many. `None` beyond 64 bits.
#[inline(always)]
pub(super) fn digits(bytes: &[u8], at: usize) -> Option<(u64, usize)> {
    let (high, n) = eight_digits(bytes, at);
    if n < 8 {
        return Some((high, n));
    }
    let (low, more) = eight_digits(bytes, at + 8);
    let value = high * POWERS[more] + low;
    if more < 8 {
        return Some((value, 8 + more));
    }
    many_digits(bytes, at + 16, value)
}

#[cold]
fn many_digits(bytes: &[u8], mut at: usize, mut value: u64) -> Option<(u64, usize)> {
    let mut n = 16;
    while let Some(digit) = bytes.get(at).filter(|byte| byte.is_ascii_digit()) {
        value = value
            .checked_mul(10)?
            .checked_add(u64::from(digit - b'0'))?;
        (at, n) = (at + 1, n + 1);
    }
    Some((value, n))
}
