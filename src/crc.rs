//! CRC over bit strings of any length, on top of crate `crc`, which knows whole bytes only.
//!
//! With start value 0, leading zeros change nothing, so a bit string is padded with zeros on the left.
//! Any other start value is linear: it is XORed into the first bits of the message (see [`Crc::of`]).

use crate::parse::ParseError;
use std::fmt;
use std::str::FromStr;
use std::sync::{Mutex, PoisonError};

/// A cyclic redundancy check of 1 to 16 bits over up to 64 data bits, most significant bit first.
#[derive(Clone)]
pub struct Crc {
    bits: u8,
    poly: u32,
    init: u16,
    inverted: bool,
    /// Bits that are sent the other way round.
    turned: u16,
    table: &'static Table,
}

/// The polynomials a width alone stands for. 4: control channel (D2, p. 14); 5: universal profile BP0 and iC-MD; 6: standard
/// encoder profile BP3 (BiSS Safety Concept A5, p. 4), what nearly all encoders use; 16: safety profile BP3S (same); 3, 7
/// and 8: chosen by length in iC-MB4 and in NXP's driver.
const DEFAULTS: [(u8, u32); 7] = [
    (3, 0xB),
    (4, 0x13),
    (5, 0x25),
    (6, 0x43),
    (7, 0x89),
    (8, 0x12F),
    (16, 0x190D9),
];

impl Crc {
    /// `poly` with its leading term (`0x43` for x⁶+x+1), `init` as the start value of the register.
    ///
    /// # Errors
    /// What is wrong with the numbers, in words: a width outside 1 to 16, a polynomial whose highest term is
    /// not x^`bits`, or a start value that does not fit.
    pub fn new(bits: u8, poly: u32, init: u16, inverted: bool) -> Result<Crc, String> {
        if !(1..=16).contains(&bits) {
            return Err(format!("a CRC has 1 to 16 bits, not {bits}"));
        }
        let (low, high) = (1u32 << bits, (2u32 << bits) - 1);
        if !(low..=high).contains(&poly) {
            return Err(format!(
                "a {bits}-bit polynomial is written with its leading term: {low:#X} to {high:#X}, not {poly:#X}"
            ));
        }
        if u32::from(init) >= low {
            return Err(format!(
                "a {bits}-bit start value is at most {:#X}, not {init:#X}",
                low - 1
            ));
        }
        Ok(Crc {
            bits,
            poly,
            init,
            inverted,
            turned: if inverted { (low - 1) as u16 } else { 0 },
            table: table(bits, (poly ^ low) as u16),
        })
    }

    /// The usual CRC of this width: start value 0, sent inverted.
    pub fn standard(bits: u8) -> Option<Crc> {
        let poly = default_poly(bits)?;
        Crc::new(bits, poly, 0, true).ok()
    }

    /// Number of CRC bits on the wire, 1 to 16.
    pub fn bits(&self) -> u8 {
        self.bits
    }

    /// The polynomial with its leading term.
    pub fn poly(&self) -> u32 {
        self.poly
    }

    /// The start value of the register.
    pub fn init(&self) -> u16 {
        self.init
    }

    /// Whether the CRC is sent inverted, as BiSS does.
    pub fn inverted(&self) -> bool {
        self.inverted
    }

    /// The CRC as it is sent after the `len` (at most 64) lowest bits of `data`.
    pub fn of(&self, data: u64, len: u8) -> u16 {
        debug_assert!(len <= 64);
        let unused = 64u32.saturating_sub(len.into());
        self.of_all(data & u64::MAX.checked_shr(unused).unwrap_or(0), len)
    }

    /// The same where `data` has no more bits than `len`.
    #[inline]
    pub(crate) fn of_all(&self, data: u64, len: u8) -> u16 {
        let sum = if self.init == 0 {
            self.table.checksum(data)
        } else {
            self.begun(data, len)
        };
        sum ^ self.turned
    }

    /// What the register holds where it began with a start value.
    fn begun(&self, data: u64, len: u8) -> u16 {
        let mask = ((1u32 << self.bits) - 1) as u16;
        let init = u64::from(self.init);
        // The register starts as `init`: its first bits meet the first bits of the message. What a message
        // shorter than the register does not meet is shifted up and stays.
        let (first, rest) = match len.checked_sub(self.bits) {
            Some(below) => (init << below, 0),
            None => {
                let unmet = self.bits - len;
                (init >> unmet, (self.init << len) & mask)
            }
        };
        self.table.checksum(data ^ first) ^ rest
    }
}

fn default_poly(bits: u8) -> Option<u32> {
    DEFAULTS
        .iter()
        .find(|(width, _)| *width == bits)
        .map(|(_, poly)| *poly)
}

/// What each byte of a message adds to the CRC, by its place from the end: they meet in one exclusive or, and none waits
/// for another as in a register.
struct Table {
    bits: u8,
    poly: u16,
    bytes: [[u16; 256]; 8],
}

impl Table {
    /// From what crate `crc` says of messages with a single 1.
    fn new(bits: u8, poly: u16) -> Table {
        let algorithm = crc::Algorithm {
            width: bits,
            poly,
            init: 0,
            refin: false,
            refout: false,
            xorout: 0,
            check: 0,
            residue: 0,
        };
        // It wants to keep what it is given for ever; so few bytes are no loss.
        let crc = crc::Crc::<u16, crc::NoTable>::new(Box::leak(Box::new(algorithm)));
        let mut bytes = [[0; 256]; 8];
        for (place, sums) in bytes.iter_mut().enumerate() {
            for byte in 1..256usize {
                let lowest = byte & byte.wrapping_neg();
                sums[byte] = if byte == lowest {
                    crc.checksum(&((byte as u64) << (8 * place)).to_be_bytes())
                } else {
                    sums[byte ^ lowest] ^ sums[lowest]
                };
            }
        }
        Table { bits, poly, bytes }
    }

    #[inline]
    fn checksum(&self, data: u64) -> u16 {
        let [a, b, c, d, e, f, g, h] = data.to_le_bytes().map(usize::from);
        let t = &self.bytes;
        let low = t[0][a] ^ t[1][b] ^ t[2][c] ^ t[3][d];
        // Most words are short.
        if data >> 32 == 0 {
            return low;
        }
        low ^ t[4][e] ^ t[5][f] ^ t[6][g] ^ t[7][h]
    }
}

/// Each polynomial's table is made once and kept.
fn table(bits: u8, poly: u16) -> &'static Table {
    static TABLES: Mutex<Vec<&'static Table>> = Mutex::new(Vec::new());
    let mut tables = TABLES.lock().unwrap_or_else(PoisonError::into_inner);
    let known = |t: &&&Table| t.bits == bits && t.poly == poly;
    if let Some(table) = tables.iter().find(known) {
        return table;
    }
    let table = &*Box::leak(Box::new(Table::new(bits, poly)));
    tables.push(table);
    table
}

impl PartialEq for Crc {
    fn eq(&self, other: &Crc) -> bool {
        (self.bits, self.poly, self.init, self.inverted)
            == (other.bits, other.poly, other.init, other.inverted)
    }
}

impl Eq for Crc {}

impl fmt::Debug for Crc {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Crc({self})")
    }
}

impl fmt::Display for Crc {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "crc{}", self.bits)?;
        let usual = self.init == 0 && self.inverted && default_poly(self.bits) == Some(self.poly);
        if !usual {
            write!(f, ":{:#X}", self.poly)?;
        }
        if self.init != 0 {
            write!(f, ":init={:#X}", self.init)?;
        }
        if !self.inverted {
            f.write_str(":plain")?;
        }
        Ok(())
    }
}

/// A number as C writes it, decimal or `0x…`.
fn number<T: TryFrom<u64>>(text: &str) -> Option<T> {
    let digits = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"));
    let unsigned = |s: &str| s.bytes().all(|b| b.is_ascii_alphanumeric());
    let value = match digits {
        Some(hex) if unsigned(hex) => u64::from_str_radix(hex, 16).ok()?,
        None if unsigned(text) => text.parse().ok()?,
        _ => return None,
    };
    T::try_from(value).ok()
}

/// `crcN[:POLY[:init=X][:plain]]`.
impl FromStr for Crc {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Crc, ParseError> {
        let hint = "write crcN[:POLY[:init=X][:plain]], such as crc6 or crc8:0x197:init=0xff:plain";
        let wrong = |at: usize, part: &str, what: String| {
            ParseError::new(text, at..at + part.len(), what, hint)
        };
        let mut parts = crate::parse::split_at(text, ':');
        let (_, name) = parts.next().unwrap_or((0, text));
        let bits = match name.strip_prefix("crc").map(number::<u8>) {
            Some(Some(bits)) if (1..=16).contains(&bits) => bits,
            _ => {
                return Err(wrong(
                    0,
                    name,
                    format!("`{name}` is not a CRC of 1 to 16 bits"),
                ));
            }
        };
        let (mut poly, mut init, mut inverted) = (default_poly(bits), 0, true);
        let (mut poly_at, mut init_at) = ((0, name), (0, name));
        for (index, (at, part)) in parts.enumerate() {
            if part == "plain" && inverted {
                inverted = false;
            } else if let (Some(value), true) = (part.strip_prefix("init="), init_at == (0, name)) {
                init_at = (at, part);
                init = number(value)
                    .ok_or_else(|| wrong(at, part, format!("`{value}` is not a start value")))?;
            } else if index == 0 {
                poly_at = (at, part);
                poly = Some(
                    number(part)
                        .ok_or_else(|| wrong(at, part, format!("`{part}` is not a polynomial")))?,
                );
            } else {
                return Err(wrong(
                    at,
                    part,
                    format!("`{part}` does not belong to a CRC"),
                ));
            }
        }
        let Some(poly) = poly else {
            return Err(wrong(
                0,
                name,
                format!("a CRC of {bits} bits has no usual polynomial: say which"),
            ));
        };
        Crc::new(bits, poly, init, inverted).map_err(|what| {
            let (at, part) = if what.contains("start value") {
                init_at
            } else {
                poly_at
            };
            wrong(at, part, what)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The definition, one bit at a time: the register shifts, and its top bit decides.
    fn bit_by_bit(bits: u8, poly: u32, init: u16, data: u64, len: u8) -> u16 {
        let mut register = u32::from(init);
        for bit in (0..len).rev() {
            let top = register >> (bits - 1) & 1 ^ (data >> bit & 1) as u32;
            register <<= 1;
            if top == 1 {
                register ^= poly;
            }
            register &= (1 << bits) - 1;
        }
        register as u16
    }

    #[test]
    fn every_length_and_start_value_equals_the_definition() {
        let mut rng = fastrand::Rng::with_seed(6);
        for _ in 0..40_000 {
            let bits = rng.u8(1..=16);
            let poly = 1 << bits | rng.u32(..1 << bits);
            let init = rng.u16(..) & ((1u32 << bits) - 1) as u16;
            let len = rng.u8(0..=64);
            let data = if len == 64 {
                rng.u64(..)
            } else {
                rng.u64(..1 << len)
            };
            let plain = Crc::new(bits, poly, init, false).unwrap();
            let want = bit_by_bit(bits, poly, init, data, len);
            assert_eq!(
                plain.of(data, len),
                want,
                "{plain} over {len} bits of {data:#x}"
            );
            let inverted = Crc::new(bits, poly, init, true).unwrap();
            assert_eq!(inverted.of(data, len), want ^ ((1u32 << bits) - 1) as u16);
        }
    }

    /// AN21 "CRC in BiSS" p. 3-4, AN22 capture of an iC-MHM, and the log of hpm_sdk's bissc sample.
    #[test]
    fn published_values() {
        let crc6 = Crc::standard(6).unwrap();
        assert_eq!(crc6.of(0b0100_1101_0101, 12), 0x1C, "iC-Haus AN21");
        assert_eq!(
            crc6.of(0xD67, 30),
            0x31,
            "iC-Haus AN22, 30-bit SCD of an iC-MHM"
        );
        assert_eq!(
            Crc::standard(16).unwrap().of(0xD9_CFE0_C0DA, 40),
            0x5F29,
            "iC-Haus AN21"
        );
        let hpm = [
            (0xFA5, 0x19),
            (0xFA6, 0x0D),
            (0xFA7, 0x01),
            (0xFA8, 0x06),
            (0xFA9, 0x0A),
            (0xFAA, 0x1E),
            (0xFAB, 0x12),
            (0xFAC, 0x36),
            (0xFAD, 0x3A),
            (0xFAE, 0x2E),
            (0xFAF, 0x22),
            (0xFB0, 0x20),
            (0xFB1, 0x2C),
            (0xFB2, 0x38),
            (0xFB3, 0x34),
            (0xFB4, 0x10),
            (0xFBF, 0x27),
            (0xFC0, 0x3B),
            (0xFC7, 0x1F),
        ];
        for (st, crc) in hpm {
            assert_eq!(
                crc6.of(0xA5A << 14 | st << 2 | 0b11, 26),
                crc,
                "hpm_sdk, ST {st:#x}"
            );
        }
    }

    /// The first 64 bits of "123456789" fed as such, the ninth byte by the definition's own linearity.
    #[test]
    fn check_values_over_nine_bytes() {
        let text = u64::from_be_bytes(*b"12345678");
        for (spec, plain) in [
            ("crc3:plain", 0x3),
            ("crc4:plain", 0xE),
            ("crc5:plain", 0x16),
            ("crc6:plain", 0x11),
            ("crc7:plain", 0x75),
            ("crc8:plain", 0x3E),
            ("crc8:0x197:plain", 0x94),
            ("crc16:plain", 0x913A),
        ] {
            let crc: Crc = spec.parse().unwrap();
            let after_eight = crc.of(text, 64);
            let last = Crc::new(crc.bits, crc.poly, after_eight, false).unwrap();
            assert_eq!(last.of(u64::from(b'9'), 8), plain, "{spec}");
        }
    }

    #[test]
    fn prints_and_reads_back() {
        for text in [
            "crc6",
            "crc16",
            "crc8:0x197",
            "crc6:0x43:init=0x33:plain",
            "crc12:0x180F",
            "crc1:0x3",
            "crc5:0x25:plain",
        ] {
            assert_eq!(text.parse::<Crc>().unwrap().to_string(), text);
        }
        assert_eq!("crc6:0x43".parse::<Crc>().unwrap().to_string(), "crc6");
        assert_eq!(
            "crc6:plain".parse::<Crc>().unwrap().to_string(),
            "crc6:0x43:plain"
        );
    }

    #[test]
    fn errors_mark_the_place() {
        for (text, place, words) in [
            ("crc6:0x03", 5..9, "leading term"),
            ("crc6:0x43:init=0x40", 10..19, "start value"),
            ("crc9", 0..4, "no usual polynomial"),
            ("crc17", 0..5, "1 to 16 bits"),
            ("crc6:0x43:upside", 10..16, "does not belong"),
            ("crc6:0x43:plain:plain", 16..21, "does not belong"),
            ("crc6:0xzz", 5..9, "not a polynomial"),
            ("crc6:+67", 5..8, "not a polynomial"),
        ] {
            let error = text.parse::<Crc>().unwrap_err();
            assert_eq!(error.span(), place, "{error}");
            assert!(error.to_string().contains(words), "{error}");
        }
    }
}
