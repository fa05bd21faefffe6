//! What a frame carries after CDS: `mt12,st20,nE,nW,crc6` as text and as a [`Format`].
//!
//! Channels are joined by `+` in the order they arrive: the slave nearest the master comes first
//! (BiSS C protocol description D2, p. 11-14).

use crate::crc::Crc;
use crate::parse::{ParseError, split_at};
use std::fmt;
use std::str::FromStr;

/// Most channels in one frame; what the specification asks of a full master.
pub const MAX_CHANNELS: usize = 8;
/// Most data bits in one channel (D2, p. 9).
pub const MAX_DATA_BITS: u32 = 64;

/// The layout of a frame: 1 to 8 channels. The default one has none, as in a frame of which only the head is read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Format {
    channels: Vec<Channel>,
    bits: u16,
}

/// One data channel: 1 to 64 data bits, most significant first, then its CRC if it has one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    fields: Vec<Field>,
    data_bits: u8,
    crc: Option<Crc>,
}

/// A run of data bits with a meaning.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    kind: Kind,
    bits: u8,
    shift: u8,
    spelled: &'static str,
}

/// What a field means.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Multi-turn counter.
    Turn,
    /// Position within a turn; the whole range is 360 degrees.
    SingleTurn,
    /// Position that is no angle.
    Position,
    /// Bits without meaning.
    Padding,
    /// Anything else, by name.
    Data(String),
    /// Sign-of-life counter.
    Life,
    /// Error bit; `active_low` for nE, whose 0 means error.
    Error {
        /// The level that means trouble.
        active_low: bool,
    },
    /// Warning bit; `active_low` for nW.
    Warning {
        /// The level that means trouble.
        active_low: bool,
    },
}

impl Field {
    /// What it means.
    pub fn kind(&self) -> &Kind {
        &self.kind
    }

    /// Its width, 1 to 64.
    pub fn bits(&self) -> u8 {
        self.bits
    }

    /// Its value within a channel's data word.
    pub fn get(&self, data: u64) -> u64 {
        data >> self.shift & mask(self.bits)
    }

    /// `data` with this field set to the lowest bits of `value`.
    pub fn set(&self, data: u64, value: u64) -> u64 {
        let mask = mask(self.bits);
        data & !(mask << self.shift) | (value & mask) << self.shift
    }
}

fn mask(bits: u8) -> u64 {
    u64::MAX >> (64 - u32::from(bits.clamp(1, 64)))
}

impl Channel {
    /// The fields in wire order.
    pub fn fields(&self) -> &[Field] {
        &self.fields
    }

    /// Data bits, CRC excluded: 1 to 64.
    pub fn data_bits(&self) -> u8 {
        self.data_bits
    }

    /// The check behind the data; `None` leaves the channel unprotected.
    pub fn crc(&self) -> Option<&Crc> {
        self.crc.as_ref()
    }

    /// CRC bits, 0 to 16.
    pub fn crc_bits(&self) -> u8 {
        self.crc.as_ref().map_or(0, Crc::bits)
    }

    /// The first field for which `want` holds.
    pub fn find(&self, want: impl Fn(&Kind) -> bool) -> Option<&Field> {
        self.fields.iter().find(|f| want(&f.kind))
    }

    /// The position field, single-turn or linear.
    pub fn position(&self) -> Option<&Field> {
        self.find(|k| matches!(k, Kind::SingleTurn | Kind::Position))
    }

    /// Whether an all-zero word means "no valid data": only where nE or nW tells it from a position of
    /// zero (D2, p. 13).
    pub fn has_null(&self) -> bool {
        let low = |k: &Kind| {
            matches!(
                k,
                Kind::Error { active_low: true } | Kind::Warning { active_low: true }
            )
        };
        self.find(low).is_some()
    }

    /// Whether the error bits of `data` are set, `None` without such a bit.
    pub fn error(&self, data: u64) -> Option<bool> {
        self.flag(data, |k| match k {
            Kind::Error { active_low } => Some(*active_low),
            _ => None,
        })
    }

    /// Whether the warning bits of `data` are set, `None` without such a bit.
    pub fn warning(&self, data: u64) -> Option<bool> {
        self.flag(data, |k| match k {
            Kind::Warning { active_low } => Some(*active_low),
            _ => None,
        })
    }

    fn place_fields(&mut self) {
        let mut shift = self.data_bits;
        for field in &mut self.fields {
            shift -= field.bits;
            field.shift = shift;
        }
    }

    fn flag(&self, data: u64, polarity: impl Fn(&Kind) -> Option<bool>) -> Option<bool> {
        let mut set = None;
        for field in &self.fields {
            if let Some(active_low) = polarity(&field.kind) {
                let active = (field.get(data) == 1) != active_low;
                set = Some(set == Some(true) || active);
            }
        }
        set
    }
}

impl Format {
    /// The channels in the order they arrive.
    pub fn channels(&self) -> &[Channel] {
        &self.channels
    }

    /// Data and CRC bits of all channels together.
    pub fn bits(&self) -> u16 {
        self.bits
    }

    /// The same with so many data bits and another CRC in one channel. The position gives or takes the bits, else the widest
    /// field; `None` where it cannot.
    pub fn altered(&self, channel: usize, data_bits: u8, crc: Option<Crc>) -> Option<Format> {
        let mut channels = self.channels.clone();
        let altered = channels.get_mut(channel)?;
        let more = i16::from(data_bits) - i16::from(altered.data_bits);
        let gives = |field: &&mut Field| {
            let place = matches!(field.kind, Kind::SingleTurn | Kind::Position);
            (place, field.bits)
        };
        let field = altered.fields.iter_mut().max_by_key(gives)?;
        let bits = u8::try_from(i16::from(field.bits) + more).ok()?;
        let wide = matches!(field.kind, Kind::Error { .. } | Kind::Warning { .. }) && more != 0;
        if bits == 0 || wide || u32::from(data_bits) > MAX_DATA_BITS {
            return None;
        }
        field.bits = bits;
        altered.data_bits = data_bits;
        altered.crc = crc;
        altered.place_fields();
        Some(Format::new(channels))
    }

    fn new(channels: Vec<Channel>) -> Format {
        let bits = |c: &Channel| u16::from(c.data_bits) + u16::from(c.crc_bits());
        let bits = channels.iter().map(bits).sum();
        Format { channels, bits }
    }
}

const FIELDS: &str =
    "fields are mtN stN posN padN dataN[=NAME] lcN nE nW E W and last crcN[:POLY[:init=X][:plain]]";
/// Keys of a record that a named field must not take over.
const RESERVED: [&str; 53] = [
    "type",
    "t_ns",
    "t_unix_us",
    "dt_ns",
    "seq",
    "ch",
    "slave",
    "ok",
    "turn",
    "pos",
    "lc",
    "counts",
    "deg",
    "rad",
    "turns",
    "rev",
    "mm",
    "um",
    "error",
    "warning",
    "fault",
    "detail",
    "tries",
    "ack",
    "delay_clk",
    "delay_ns",
    "busy_ns",
    "clock_hz",
    "timeout_ns",
    "cds",
    "crc",
    "unprotected",
    "scd",
    "bits",
    "got",
    "want",
    "clock",
    "clocks",
    "first_clock",
    "last_clock",
    "level_ns",
    "limit_ns",
    "edge",
    "have_bits",
    "want_bits",
    "waited_ns",
    "head_clk",
    "min_clk",
    "max_clk",
    "learned_ns",
    "cpw",
    "spw",
    "acc_bits",
];

impl FromStr for Format {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Format, ParseError> {
        let mut channels = Vec::new();
        for (at, part) in split_at(text, '+') {
            if channels.len() == MAX_CHANNELS {
                return Err(ParseError::new(
                    text,
                    at..text.len(),
                    "more than 8 channels",
                    "a frame has 1 to 8 channels",
                ));
            }
            channels.push(channel(part).map_err(|e| e.within(text, at))?);
        }
        Ok(Format::new(channels))
    }
}

fn channel(text: &str) -> Result<Channel, ParseError> {
    let wrong = |at: usize, item: &str, what: String| {
        ParseError::new(text, at..at + item.len(), what, FIELDS)
    };
    let mut parsed = Channel {
        fields: Vec::new(),
        data_bits: 0,
        crc: None,
    };
    let mut ended = false;
    let mut bits = 0u32;
    for (at, item) in split_at(text, ',') {
        if ended {
            return Err(wrong(
                at,
                item,
                format!("`{item}` stands behind the CRC, which is last in a channel"),
            ));
        }
        if item == "crc0" {
            ended = true;
        } else if item.starts_with("crc") {
            parsed.crc = Some(item.parse::<Crc>().map_err(|e| e.within(text, at))?);
            ended = true;
        } else {
            let field = field(item).map_err(|e| e.within(text, at))?;
            if let Some(twin) = parsed
                .fields
                .iter()
                .find(|f| collides(&f.kind, &field.kind))
            {
                let what = format!(
                    "`{item}` stands beside another `{}` in one channel",
                    twin.spelled
                );
                return Err(ParseError::new(
                    text,
                    at..at + item.len(),
                    what,
                    "at most one mt, st or pos, lc, and one field of a name",
                ));
            }
            bits += u32::from(field.bits);
            if bits > MAX_DATA_BITS {
                return Err(wrong(
                    at,
                    item,
                    format!("{bits} data bits: a channel has at most 64"),
                ));
            }
            parsed.fields.push(field);
        }
    }
    if bits == 0 {
        return Err(wrong(0, text, "a channel without data bits".into()));
    }
    parsed.data_bits = bits as u8;
    parsed.place_fields();
    Ok(parsed)
}

/// Whether one channel cannot have both, as both would be printed under one name.
fn collides(a: &Kind, b: &Kind) -> bool {
    use Kind::{Data, Life, Position, SingleTurn, Turn};
    match (a, b) {
        (Turn, Turn) | (Life, Life) => true,
        (SingleTurn | Position, SingleTurn | Position) => true,
        (Data(a), Data(b)) => a == b,
        _ => false,
    }
}

fn field(item: &str) -> Result<Field, ParseError> {
    let wrong = |what: String| ParseError::new(item, 0..item.len(), what, FIELDS);
    let one = |kind, spelled| {
        Ok(Field {
            kind,
            bits: 1,
            shift: 0,
            spelled,
        })
    };
    match item {
        "nE" => return one(Kind::Error { active_low: true }, "nE"),
        "nW" => return one(Kind::Warning { active_low: true }, "nW"),
        "E" => return one(Kind::Error { active_low: false }, "E"),
        "W" => return one(Kind::Warning { active_low: false }, "W"),
        _ => {}
    }
    let digit = item
        .find(|c: char| c.is_ascii_digit())
        .unwrap_or(item.len());
    let (name, width) = item.split_at(digit);
    let (width, label) = match width.split_once('=') {
        Some((width, label)) => (width, Some(label)),
        None => (width, None),
    };
    let (kind, spelled) = match name {
        "mt" => (Kind::Turn, "mt"),
        "st" => (Kind::SingleTurn, "st"),
        "pos" => (Kind::Position, "pos"),
        "pad" => (Kind::Padding, "pad"),
        "lc" => (Kind::Life, "lc"),
        "data" => (Kind::Data(label.unwrap_or("data").to_owned()), "data"),
        _ => return Err(wrong(format!("unknown field `{item}`"))),
    };
    if let Some(label) = label {
        if name != "data" {
            return Err(wrong(format!(
                "only data fields have names, `{item}` is none"
            )));
        }
        let plain = label
            .bytes()
            .all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_');
        if !plain || !label.starts_with(|c: char| c.is_ascii_lowercase()) {
            return Err(wrong(format!(
                "`{label}` is not a field name: a-z, then a-z, 0-9 and _"
            )));
        }
        if RESERVED.contains(&label) {
            return Err(wrong(format!(
                "`{label}` is the name of something else in a record"
            )));
        }
    }
    let digits = !width.is_empty() && width.bytes().all(|b| b.is_ascii_digit());
    match width.parse::<u8>() {
        Ok(bits @ 1..=64) if digits => Ok(Field {
            kind,
            bits,
            shift: 0,
            spelled,
        }),
        _ => Err(wrong(format!("`{item}` needs a width of 1 to 64 bits"))),
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, channel) in self.channels.iter().enumerate() {
            if i > 0 {
                f.write_str("+")?;
            }
            write!(f, "{channel}")?;
        }
        Ok(())
    }
}

impl fmt::Display for Channel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, field) in self.fields.iter().enumerate() {
            if i > 0 {
                f.write_str(",")?;
            }
            f.write_str(field.spelled)?;
            if !matches!(field.kind, Kind::Error { .. } | Kind::Warning { .. }) {
                write!(f, "{}", field.bits)?;
            }
            match &field.kind {
                Kind::Data(name) if name != "data" => write!(f, "={name}")?,
                _ => {}
            }
        }
        match &self.crc {
            Some(crc) => write!(f, ",{crc}"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn format(text: &str) -> Format {
        text.parse().unwrap_or_else(|e| panic!("{e}"))
    }

    #[test]
    fn the_position_gives_and_takes_bits() {
        let crc = |text: &str| Some(text.parse().unwrap());
        for (text, channel, bits, check, want) in [
            (
                "st26,nE,nW,crc6",
                0,
                26,
                crc("crc6"),
                Some("st24,nE,nW,crc6"),
            ),
            (
                "mt12,st20,nE,nW,crc6+st8,crc6",
                0,
                36,
                crc("crc8"),
                Some("mt12,st22,nE,nW,crc8+st8,crc6"),
            ),
            (
                "data16=temp,nE,crc5",
                0,
                16,
                crc("crc5"),
                Some("data15=temp,nE,crc5"),
            ),
            ("st2,nE,nW,crc6", 0, 2, crc("crc6"), None),
            ("nE,crc6", 0, 2, crc("crc6"), None),
            ("st60,nE,crc6", 0, 65, crc("crc6"), None),
            ("st60,nE,crc6", 1, 60, crc("crc6"), None),
        ] {
            let altered = format(text).altered(channel, bits, check);
            let again = want.map(format);
            assert_eq!(altered, again, "{text}");
        }
    }

    #[test]
    fn prints_and_reads_back() {
        for text in [
            "st26,nE,nW,crc6",
            "mt12,st20,nE,nW,crc6",
            "mt12,st24,nE,nW,crc6+mt12,st24,nE,nW,lc6,crc16",
            "pad4,pos28,E,W,crc6",
            "data16=temp,crc5",
            "data16",
            "st64",
            "st14,crc8:0x197:init=0xFF:plain",
        ] {
            assert_eq!(format(text).to_string(), text);
        }
        assert_eq!(format("st14,crc0").to_string(), "st14");
    }

    #[test]
    fn no_text_panics() {
        let seed = fastrand::u64(..);
        println!("seed {seed}");
        let mut rng = fastrand::Rng::with_seed(seed);
        let parts = [
            "st", "mt", "nE", "crc", "6", "64", "99999", ":", "0x43", "init=", "plain", "+", ",",
            "=", "é", "data", "lc", " ", "-1",
        ];
        for _ in 0..20_000 {
            let text: String = (0..rng.usize(0..9))
                .map(|_| *rng.choice(&parts).unwrap())
                .collect();
            if let Err(error) = text.parse::<Format>() {
                assert!(
                    text.get(error.span()).is_some(),
                    "{text}: {:?}",
                    error.span()
                );
                assert!(error.to_string().contains('^'));
            }
        }
    }

    #[test]
    fn fields_sit_where_the_wire_puts_them() {
        let f = format("mt12,st13,nE,nW,crc6");
        let c = &f.channels()[0];
        let data = 0x123 << 15 | 0xABC << 2 | 0b10;
        assert_eq!(c.find(|k| *k == Kind::Turn).unwrap().get(data), 0x123);
        assert_eq!(c.position().unwrap().get(data), 0xABC);
        assert_eq!((c.error(data), c.warning(data)), (Some(false), Some(true)));
        assert_eq!((c.data_bits(), c.crc_bits(), f.bits()), (27, 6, 33));
        assert!(c.has_null());
        let c = &format("st14,E,crc6").channels()[0].clone();
        assert_eq!(
            (c.error(1), c.error(0), c.warning(0), c.has_null()),
            (Some(true), Some(false), None, false)
        );
        assert_eq!(
            format("st64").channels()[0]
                .position()
                .unwrap()
                .get(u64::MAX),
            u64::MAX
        );
    }

    #[test]
    fn errors_mark_the_place() {
        for (text, place, words) in [
            ("mt12,sx12,nE", 5..9, "unknown field `sx12`"),
            ("st26,nE,nW,crc6:0x03", 16..20, "leading term"),
            ("st26,crc6,nE", 10..12, "behind the CRC"),
            ("st12,pos4", 5..9, "another `st`"),
            ("st40,mt25", 5..9, "65 data bits"),
            ("st0", 0..3, "1 to 64"),
            ("st", 0..2, "1 to 64"),
            ("", 0..0, "unknown field"),
            ("crc6", 0..4, "without data bits"),
            ("st8+", 4..4, "unknown field"),
            ("st8+mt4,xx", 8..10, "unknown field"),
            ("data8=pos", 0..9, "something else"),
            ("data8=Temp", 0..10, "not a field name"),
            ("data8,data4", 6..11, "another `data`"),
            ("mt4=turns,st4", 0..9, "only data fields"),
            ("st1+st1+st1+st1+st1+st1+st1+st1+st1", 32..35, "more than 8"),
        ] {
            let error = text.parse::<Format>().unwrap_err();
            assert_eq!(error.span(), place, "{error}");
            assert!(error.to_string().contains(words), "{error}");
        }
    }
}
