//! Registers and commands, for people and for scripts.

use crate::cli::ReportFormat;
use biss::control::Failure;
use biss::cycle::Fault;
use biss::registers::{BANK_SELECT, Trouble};
use serde::ser::{Serialize, SerializeMap, Serializer};
use std::fmt::{self, Display};
use std::ops::RangeInclusive;

/// Why a register or a command did not come to what was asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Bad {
    name: &'static str,
    detail: String,
    failure: Option<(Failure, Option<Fault>)>,
}

const UNTRIED: &str = "not-tried";

impl Bad {
    /// The slave did something else; or, where a frame was not whole, what was wrong with that.
    pub(crate) fn new(failure: Failure, fault: Option<Fault>) -> Bad {
        let (name, detail) = match (failure, fault) {
            (Failure::Cut, Some(fault)) => (fault.name(), words(fault)),
            _ => (failure.name(), failure.to_string()),
        };
        Bad {
            name,
            detail,
            failure: Some((failure, fault)),
        }
    }

    /// Because of what stopped everything.
    pub(crate) fn of(trouble: &Trouble) -> Bad {
        let (name, detail) = match trouble {
            Trouble::Slave { failure, fault } => return Bad::new(*failure, *fault),
            // What the machine said is on stderr.
            Trouble::Link(_) => ("machine", "the link failed"),
            Trouble::Stopped => ("stopped", "a signal came first"),
        };
        Bad {
            name,
            detail: detail.into(),
            failure: None,
        }
    }

    /// What a recording shows, and no master has said.
    pub(crate) fn said(name: &'static str, detail: impl Into<String>) -> Bad {
        Bad {
            name,
            detail: detail.into(),
            failure: None,
        }
    }

    /// Nobody has tried.
    pub(crate) fn untried() -> Bad {
        Bad {
            name: UNTRIED,
            detail: "left out after what went wrong before".into(),
            failure: None,
        }
    }

    /// What it is, but the slave has echoed the byte before.
    pub(crate) fn but_echoed(self) -> Bad {
        let name = if self.name == UNTRIED {
            "not-read"
        } else {
            self.name
        };
        Bad {
            name,
            detail: format!("echoed, but not read back: {}", self.detail),
            ..self
        }
    }

    /// What the slave did, and what was wrong with the frame.
    pub(crate) fn failure(&self) -> Option<(Failure, Option<Fault>)> {
        self.failure
    }

    /// The slave refused.
    pub(crate) fn is_refusal(&self) -> bool {
        matches!(self.failure, Some((Failure::Refused { .. }, _)))
    }
}

/// What is wrong with a frame, without its name.
fn words(fault: Fault) -> String {
    let text = fault.to_string();
    let words = text.trim_start_matches(fault.name());
    words.trim_start_matches(": ").into()
}

impl Display for Bad {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "fault {}: {}", self.name, self.detail)
    }
}

/// A register, and what came of it. Every value in it has come with its CRC, or is the user's own.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Register {
    pub(crate) slave: u8,
    /// Where it is in one, and which is known.
    pub(crate) bank: Option<u8>,
    pub(crate) address: u8,
    /// What it holds.
    pub(crate) value: Option<u8>,
    /// What it held before it was written.
    pub(crate) old: Option<u8>,
    /// What it does not hold, and should.
    pub(crate) want: Option<u8>,
    /// It was to be written.
    pub(crate) write: bool,
    /// Something may have gone there.
    pub(crate) sent: bool,
    pub(crate) bad: Option<Bad>,
}

/// Whether a register holds what was to be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Written {
    Yes,
    No,
    Unknown,
}

impl Register {
    /// Nothing has come of it yet.
    pub(crate) fn untouched(slave: u8, bank: Option<u8>, address: u8) -> Register {
        Register {
            slave,
            bank: bank.filter(|_| address < BANK_SELECT),
            address,
            value: None,
            old: None,
            want: None,
            write: false,
            sent: false,
            bad: None,
        }
    }

    /// It was read, or the slave has said that it cannot be.
    pub(crate) fn is_answer(&self) -> bool {
        self.bad.as_ref().is_none_or(Bad::is_refusal)
    }

    /// Whether it holds what was to be written.
    pub(crate) fn written(&self) -> Written {
        match &self.bad {
            None => Written::Yes,
            Some(_) if self.value.is_some() && self.value == self.want => Written::Yes,
            Some(_) if self.value.is_some() || !self.sent => Written::No,
            Some(_) => Written::Unknown,
        }
    }

    /// As one line of text, or of JSON.
    pub(crate) fn render(&self, format: ReportFormat) -> Result<String, serde_json::Error> {
        line(self, format)
    }
}

fn line<R: Display + Serialize>(
    record: &R,
    format: ReportFormat,
) -> Result<String, serde_json::Error> {
    let mut text = match format {
        ReportFormat::Text => record.to_string(),
        ReportFormat::Json => serde_json::to_string(record)?,
    };
    text.push('\n');
    Ok(text)
}

/// A byte as a character, where it is one that shows.
fn character(byte: u8) -> Option<char> {
    Some(char::from(byte)).filter(char::is_ascii_graphic)
}

/// A byte in hexadecimal and decimal, and as a character.
pub(super) fn shown_value(byte: u8) -> String {
    let character = character(byte).map(|shown| format!("  {shown}"));
    format!("  {byte:#04x}  {byte:3}{}", character.unwrap_or_default())
}

/// What an access was for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Direction {
    Read,
    Write,
}

impl Direction {
    pub(super) fn name(self) -> &'static str {
        match self {
            Direction::Read => "read",
            Direction::Write => "write",
        }
    }
}

impl Display for Register {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:#04x}", self.address)?;
        let held = |f: &mut fmt::Formatter<'_>, byte: Option<u8>| match byte {
            Some(byte) => write!(f, "  {byte:#04x}"),
            None => f.write_str("  --"),
        };
        match (&self.bad, self.value) {
            (Some(bad), value) => {
                if self.write {
                    held(f, value)?;
                }
                write!(f, "  {bad}")
            }
            (None, value) if self.want.is_some() => {
                held(f, value)?;
                f.write_str(", the file has")?;
                self.want.map_or(Ok(()), |want| write!(f, " {want:#04x}"))
            }
            (None, value) if self.write => {
                held(f, self.old)?;
                f.write_str(" ->")?;
                value.map_or(Ok(()), |value| write!(f, " {value:#04x}"))
            }
            (None, Some(byte)) => f.write_str(&shown_value(byte)),
            (None, None) => Ok(()),
        }
    }
}

impl Serialize for Register {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("type", "reg")?;
        map.serialize_entry("slave", &self.slave)?;
        if let Some(bank) = self.bank {
            map.serialize_entry("bank", &bank)?;
        }
        map.serialize_entry("addr", &self.address)?;
        map.serialize_entry("ok", &self.bad.is_none())?;
        let numbers = [
            ("value", self.value),
            ("old", self.old),
            ("want", self.want),
        ];
        for (name, number) in numbers {
            if let Some(number) = number {
                map.serialize_entry(name, &number)?;
            }
        }
        bad_entries(self.bad.as_ref(), &mut map)?;
        map.end()
    }
}

pub(super) fn bad_entries<M: SerializeMap>(bad: Option<&Bad>, map: &mut M) -> Result<(), M::Error> {
    let Some(bad) = bad else { return Ok(()) };
    map.serialize_entry("fault", bad.name)?;
    map.serialize_entry("detail", &bad.detail)
}

/// Registers as a table, in the manner of i2cdump: what does not show is `?`, 0x00 and 0xff are dots.
pub(crate) fn table(registers: &[Register]) -> String {
    const WIDTH: u8 = 16;
    let Some((first, last)) = registers.first().zip(registers.last()) else {
        return String::new();
    };
    let at = |address: u8| registers.iter().find(|known| known.address == address);
    let mut text = String::from("   ");
    (0..WIDTH).for_each(|column| text.push_str(&format!("  {column:x}")));
    text.push_str("    0123456789abcdef\n");
    for row in first.address / WIDTH..=last.address / WIDTH {
        let cells: Vec<Option<&Register>> = (0..WIDTH).map(|c| at(row * WIDTH + c)).collect();
        text.push_str(&format!("{:02x}:", row * WIDTH));
        cells.iter().for_each(|cell| text.push_str(&hex(*cell)));
        text.push_str("    ");
        text.extend(cells.iter().map(|cell| shown(*cell)));
        text.truncate(text.trim_end().len());
        text.push('\n');
    }
    text
}

fn hex(cell: Option<&Register>) -> String {
    match cell.map(|cell| (cell.value, &cell.bad)) {
        None => "   ".into(),
        Some((Some(byte), _)) => format!(" {byte:02x}"),
        Some((None, Some(bad))) if bad.is_refusal() => " --".into(),
        Some(_) => " XX".into(),
    }
}

fn shown(cell: Option<&Register>) -> char {
    match cell.map(|cell| (cell.value, &cell.bad)) {
        None => ' ',
        Some((Some(0x00 | 0xFF), _)) => '.',
        Some((Some(b' '), _)) => ' ',
        Some((Some(byte), _)) => character(byte).unwrap_or('?'),
        Some((None, Some(bad))) if bad.is_refusal() => '-',
        Some(_) => 'X',
    }
}

/// Addresses as `0x10, 0x12..0x14`.
pub(crate) fn list(addresses: impl IntoIterator<Item = u8>) -> String {
    let mut runs: Vec<RangeInclusive<u8>> = Vec::new();
    for address in addresses {
        match runs.last_mut() {
            Some(run) if run.end() + 1 == address => *run = *run.start()..=address,
            _ => runs.push(address..=address),
        }
    }
    let run = |run: RangeInclusive<u8>| match run.start() == run.end() {
        true => format!("{:#04x}", run.start()),
        false => format!("{:#04x}..{:#04x}", run.start(), run.end()),
    };
    runs.into_iter().map(run).collect::<Vec<_>>().join(", ")
}

/// A command, and what came of it.
pub(crate) struct Command {
    /// For whom; none is a broadcast.
    pub(crate) slaves: Vec<u8>,
    pub(crate) code: u8,
    /// Who has acknowledged it, where that was looked at.
    pub(crate) acknowledged: Option<Vec<u8>>,
    pub(crate) bad: Option<Bad>,
}

impl Command {
    /// As one line of text, or of JSON.
    pub(crate) fn render(&self, format: ReportFormat) -> Result<String, serde_json::Error> {
        line(self, format)
    }
}

/// `slave 0, 2`, or all of them.
pub(crate) fn whom(slaves: &[u8]) -> String {
    let numbers: Vec<String> = slaves.iter().map(u8::to_string).collect();
    match numbers.is_empty() {
        true => "all slaves".into(),
        false => format!("slave {}", numbers.join(", ")),
    }
}

impl Display for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "command {:02b}  {}  ", self.code, whom(&self.slaves))?;
        match (&self.bad, &self.acknowledged) {
            (Some(bad), _) => bad.fmt(f),
            (None, Some(_)) => f.write_str("acknowledged and executed"),
            (None, None) => f.write_str("sent"),
        }
    }
}

impl Serialize for Command {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("type", "command")?;
        match self.slaves.is_empty() {
            true => map.serialize_entry("broadcast", &true)?,
            false => map.serialize_entry("slaves", &self.slaves)?,
        }
        map.serialize_entry("code", &self.code)?;
        map.serialize_entry("ok", &self.bad.is_none())?;
        if let Some(slaves) = &self.acknowledged {
            map.serialize_entry("acknowledged", slaves)?;
        }
        bad_entries(self.bad.as_ref(), &mut map)?;
        map.end()
    }
}

/// What it took.
pub(crate) struct Effort {
    /// How many records there are, and how many of these are refusals; a command has none of these numbers.
    pub(crate) registers: Option<(usize, usize)>,
    pub(crate) frames: u64,
    pub(crate) retries: u64,
}

impl Effort {
    /// Whether something on the line had to be repeated. A refusal is believed when it comes twice.
    pub(crate) fn is_uneven(&self) -> bool {
        let refused = self.registers.map_or(0, |(_, refused)| refused);
        self.retries > refused as u64
    }

    /// On stderr.
    pub(crate) fn print(&self, format: ReportFormat) {
        match format {
            ReportFormat::Text => super::note(self),
            ReportFormat::Json => {
                if let Ok(text) = serde_json::to_string(self) {
                    super::say(&text);
                }
            }
        }
    }
}

impl Display for Effort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some((all, refused)) = self.registers {
            write!(
                f,
                "{}, {refused} refused, ",
                counted(all as u64, "register")
            )?;
        }
        let frames = counted(self.frames, "frame");
        match self.retries {
            0 => write!(f, "{frames}, no control frame repeated"),
            1 => write!(f, "{frames}, 1 control frame repeated"),
            more => write!(f, "{frames}, {more} control frames repeated"),
        }
    }
}

/// `1 frame`, `2 frames`.
fn counted(number: u64, what: &str) -> String {
    match number {
        1 => format!("1 {what}"),
        more => format!("{more} {what}s"),
    }
}

impl Serialize for Effort {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("type", "summary")?;
        if let Some((all, refused)) = self.registers {
            map.serialize_entry("registers", &all)?;
            map.serialize_entry("refused", &refused)?;
        }
        map.serialize_entry("frames", &self.frames)?;
        map.serialize_entry("retries", &self.retries)?;
        map.end()
    }
}
