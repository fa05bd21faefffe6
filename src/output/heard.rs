//! Register traffic that a recording shows, between its frames.

use super::reg::{Bad, Direction, bad_entries, shown_value, whom};
use super::{Printer, Time, json, text};
use biss::control::{Heard, MAX_IDS, Spoken};
use serde::ser::{Serialize, SerializeMap, Serializer};
use std::io::{self, Write};

/// Something that master and slaves have said to each other, told with the frame it ended with.
pub(crate) struct Overheard {
    pub(crate) seq: u64,
    pub(crate) heard: Heard,
    /// Why it did not come to what it was for.
    pub(crate) bad: Option<Bad>,
}

/// An overheard record and how it shows its time.
struct Line<'a> {
    time: Time,
    it: &'a Overheard,
}

impl Printer {
    /// Writes what was overheard; tables have no place for it.
    pub(crate) fn overheard(&mut self, overheard: &Overheard) -> io::Result<()> {
        let record = Line {
            time: self.stamp.of(overheard.heard.t_ns),
            it: overheard,
        };
        self.line.clear();
        match self.look {
            super::Look::Text => record.text(&mut self.line, self.color)?,
            super::Look::Json => serde_json::to_writer(&mut self.line, &record)?,
            super::Look::Csv(_) | super::Look::Fields(_) | super::Look::Nothing => return Ok(()),
        }
        self.line.push(b'\n');
        self.out.write_all(&self.line)?;
        self.flush_in_time()
    }
}

/// A register, and whether it was to be written.
fn register(spoken: Spoken) -> Option<(u8, u8, Direction)> {
    let direction = |write: bool| match write {
        true => Direction::Write,
        false => Direction::Read,
    };
    match spoken {
        Spoken::Read { slave, address, .. } => Some((slave, address, Direction::Read)),
        Spoken::Written { slave, address, .. } => Some((slave, address, Direction::Write)),
        Spoken::Bad {
            slave,
            address,
            cdm,
            ..
        } => Some((slave, address, direction(cdm.is_some()))),
        Spoken::Refused {
            slave,
            address,
            write,
            ..
        }
        | Spoken::Silent {
            slave,
            address,
            write,
        }
        | Spoken::Cut {
            slave,
            address,
            write,
        } => Some((slave, address, direction(write))),
        Spoken::Command { .. } | Spoken::CutCommand { .. } | Spoken::BadHeader { .. } => None,
    }
}

fn ids(bits: u16) -> Vec<u8> {
    (0..=MAX_IDS).filter(|id| bits >> id & 1 == 1).collect()
}

impl Line<'_> {
    /// Only what is right in all there is to check.
    fn value(&self) -> Option<u8> {
        match self.it.heard.spoken {
            Spoken::Read { value, .. } | Spoken::Written { value, .. } if self.it.bad.is_none() => {
                Some(value)
            }
            _ => None,
        }
    }

    fn text(&self, out: &mut Vec<u8>, color: bool) -> io::Result<()> {
        text::time(out, self.time)?;
        text::separate(out);
        match self.it.heard.spoken {
            Spoken::Command { slaves, code, .. } | Spoken::CutCommand { slaves, code, .. } => {
                write!(out, "command {code:02b}  {}", whom(&ids(slaves.into())))?;
                if self.it.bad.is_none() {
                    out.extend(match slaves {
                        0 => b"  sent".as_slice(),
                        _ => b"  acknowledged and executed",
                    });
                }
            }
            Spoken::BadHeader { .. } => out.extend(b"control frame"),
            spoken => {
                if let Some((slave, address, direction)) = register(spoken) {
                    write!(out, "slave {slave}  {} {address:#04x}", direction.name())?;
                }
                if let Some(value) = self.value() {
                    write!(out, "{}", shown_value(value))?;
                }
            }
        }
        if let Some(bad) = &self.it.bad {
            text::separate(out);
            text::red(out, color, bad)?;
        }
        match self.it.heard.busy {
            0 => Ok(()),
            1 => write!(out, "  (busy for 1 frame)"),
            busy => write!(out, "  (busy for {busy} frames)"),
        }
    }
}

impl Serialize for Line<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        let spoken = self.it.heard.spoken;
        let kind = match spoken {
            Spoken::Command { .. } | Spoken::CutCommand { .. } => "command",
            Spoken::BadHeader { .. } => "control",
            _ => "reg",
        };
        map.serialize_entry("type", kind)?;
        json::time(&mut map, self.time)?;
        map.serialize_entry("seq", &self.it.seq)?;
        map.serialize_entry("frames", &self.it.heard.frames)?;
        match spoken {
            Spoken::Command { slaves, code, .. } | Spoken::CutCommand { slaves, code, .. } => {
                match slaves {
                    0 => map.serialize_entry("broadcast", &true)?,
                    _ => map.serialize_entry("slaves", &ids(slaves.into()))?,
                }
                map.serialize_entry("code", &code)?;
            }
            spoken => {
                if let Some((slave, address, direction)) = register(spoken) {
                    map.serialize_entry("slave", &slave)?;
                    map.serialize_entry("addr", &address)?;
                    map.serialize_entry("access", direction.name())?;
                }
            }
        }
        map.serialize_entry("ok", &self.it.bad.is_none())?;
        self.content(&mut map)?;
        bad_entries(self.it.bad.as_ref(), &mut map)?;
        map.end()
    }
}

impl Line<'_> {
    fn content<M: SerializeMap>(&self, map: &mut M) -> Result<(), M::Error> {
        let heard = &self.it.heard;
        if let Some(value) = self.value() {
            map.serialize_entry("value", &value)?;
        }
        if let Some(want) = heard.sent() {
            if self.it.bad.is_some() {
                map.serialize_entry("want", &want)?;
            }
        }
        if let Some(bits) = heard.came() {
            map.serialize_entry("crc_ok", &heard.crc_ok())?;
            map.serialize_entry("came", &format!("{bits:03x}"))?;
        }
        match heard.spoken {
            Spoken::Command {
                slaves,
                acknowledged,
                executed,
                ..
            } => {
                if slaves != 0 {
                    map.serialize_entry("acknowledged", &ids(acknowledged.into()))?;
                }
                map.serialize_entry("executed", &executed)
            }
            Spoken::BadHeader { header } => map.serialize_entry("header", &format!("{header:04x}")),
            Spoken::Read { .. }
            | Spoken::Written { .. }
            | Spoken::Bad { .. }
            | Spoken::Silent { .. } => map.serialize_entry("busy", &heard.busy),
            _ => Ok(()),
        }
    }
}
