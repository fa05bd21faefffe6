//! Sessions of sigrok: a zip with `metadata` and the samples in `logic-1-1`, `logic-1-2`…, or all of them in `logic-1`.
//!
//! Source: libsigrok `src/output/srzip.c`, `src/session_file.c` and `src/session_driver.c` (0.5.2).

mod archive;
mod metadata;

use super::raw::BLOCK;
use super::source::{Channel, Damage, Source, step_fs};
use super::tape::Disk;
use crate::scan::{Place, Scanner};
use crate::slice::Slicer;
use archive::{Archive, Body, Entry, Wrong};
use metadata::Metadata;
use std::io::{Read, Seek};

pub(super) const MAGIC: &[u8] = b"PK\x03\x04";

/// Samples are handed over when their checksum was right, as far as they fit in here. sigrok writes 4 MiB at once.
const HELD: usize = 4 << 20;

/// A session as it is read.
pub(super) struct Sr {
    archive: Archive,
    metadata: Metadata,
    rate_hz: u64,
    channels: Vec<Channel>,
    scanner: Option<Scanner>,
    body: Option<Body>,
    /// What has come of it, how much that is, and how much of it was handed over.
    held: Vec<u8>,
    filled: usize,
    given: usize,
    /// All of it is good; and what is wrong behind it.
    good: bool,
    after: Option<Damage>,
    /// Number of the next chunk; `None` when there is only one, and that has begun.
    next: Option<u64>,
    /// What is wrong at the end of the file.
    broken: Option<String>,
    /// From here on samples are handed over whose checksum has not come yet.
    doubtful_ns: Option<u64>,
}

impl Sr {
    /// Reads what a file says of itself.
    pub(super) fn open(mut disk: Disk, rate_hz: Option<u64>) -> Result<Sr, String> {
        let (disk, mut entries) = match Archive::listed(disk.clone()) {
            Ok(listed) => listed,
            Err(broken) => {
                // Cut short it has no directory, but its beginning.
                disk.rewind().map_err(|e| e.to_string())?;
                let sr = Sr::stream(disk, rate_hz).map_err(|said| format!("{said}; {broken}"))?;
                return Ok(Sr {
                    broken: Some(broken),
                    ..sr
                });
            }
        };
        let named = |name: &str| entries.iter().find(|entry| entry.name == name).cloned();
        if named("metadata").is_none() && named("header").is_some() {
            return Err("it is a session of DSView: export it as CSV or VCD".to_owned());
        }
        let first: Vec<Entry> = ["metadata", "version"]
            .into_iter()
            .filter_map(named)
            .collect();
        let archive = Archive::Listed(disk.clone(), first);
        let (_, metadata) = begin(archive)?;
        let number = |entry: &Entry| chunk_number(&metadata.capture, &entry.name);
        entries.retain(|entry| number(entry).is_some());
        if entries.iter().any(|entry| number(entry) == Some(0)) {
            entries.retain(|entry| number(entry) == Some(0));
        }
        entries.sort_by_key(|entry| std::cmp::Reverse(number(entry)));
        Sr::new(Archive::Listed(disk, entries), metadata, rate_hz)
    }

    /// Reads what a pipe says of itself.
    pub(super) fn stream(input: impl Read + 'static, rate_hz: Option<u64>) -> Result<Sr, String> {
        let (archive, metadata) = begin(Archive::streamed(input))?;
        Sr::new(archive, metadata, rate_hz)
    }

    fn new(archive: Archive, metadata: Metadata, asked_hz: Option<u64>) -> Result<Sr, String> {
        let rate_hz = match (metadata.rate_hz, asked_hz) {
            (Some(own), Some(asked)) if own != asked => {
                return Err(format!(
                    "it says itself that it has {own} samples a second: leave rate= out"
                ));
            }
            (own, asked) => own
                .or(asked)
                .ok_or("its `metadata` have no samplerate: say it, as in file:PATH,rate=24MHz")?,
        };
        let channels = metadata.probes.iter().map(|(bit, name)| Channel {
            name: name.clone(),
            path: name.clone(),
            id: *bit,
        });
        Ok(Sr {
            channels: channels.collect(),
            archive,
            metadata,
            rate_hz,
            scanner: None,
            body: None,
            held: Vec::new(),
            filled: 0,
            given: 0,
            good: false,
            after: None,
            next: Some(1),
            broken: None,
            doubtful_ns: None,
        })
    }

    /// Goes to the next entry with samples. False when there is none.
    fn chunk(&mut self) -> Result<bool, Damage> {
        loop {
            let next = self.archive.next();
            let entry = next.map_err(|wrong| self.between(wrong.said()))?;
            let Some(entry) = entry else {
                return match self.broken.take() {
                    Some(broken) => Err(self.between(broken)),
                    None => Ok(false),
                };
            };
            let Some(number) = chunk_number(&self.metadata.capture, &entry.name) else {
                let skipped = self.archive.skip(&entry);
                skipped.map_err(|wrong| damage(&entry, 0, wrong.said()))?;
                continue;
            };
            match self.next {
                Some(1) if number == 0 => self.next = None,
                Some(next) if number == next => self.next = Some(next + 1),
                _ => {
                    let listed = matches!(self.archive, Archive::Listed(..));
                    let hint = if listed {
                        ""
                    } else {
                        ", or comes later: save it to a file, and read that"
                    };
                    let said = format!("it is missing, `{}` comes in its place{hint}", entry.name);
                    return Err(self.between(said));
                }
            }
            // All at once: grown bit by bit it would take twice as much.
            let room = BLOCK + usize::try_from(entry.size).map_or(HELD, |size| size.min(HELD));
            if self.held.len() < room {
                self.held = Vec::new();
                self.held = vec![0; room];
            }
            self.doubtful_ns = None;
            if entry.size > HELD as u64 && !self.check(&entry)? {
                self.doubtful_ns = Some(self.now_ns());
            }
            self.body = Some(Body::new(entry));
            return Ok(true);
        }
    }

    /// Looks through an entry that is too large to be held, and returns. False where there is no way back.
    fn check(&mut self, entry: &Entry) -> Result<bool, Damage> {
        let damage = |wrong: Wrong, at| damage(entry, at, wrong.said());
        if !self
            .archive
            .again(entry)
            .map_err(|wrong| damage(wrong, 0))?
        {
            return Ok(false);
        }
        let mut body = Body::new(entry.clone());
        loop {
            match body.read(self.archive.input(), &mut self.held) {
                Ok(0) => break,
                Ok(_) => {}
                // Up to there it is good.
                Err(Wrong::Short(_)) => break,
                Err(wrong) => return Err(damage(wrong, body.out)),
            }
        }
        let again = self.archive.again(entry);
        again.map_err(|wrong| damage(wrong, 0))
    }

    /// With what was delivered before that could be known.
    fn with_doubt(&self, said: String) -> String {
        match self.doubtful_ns {
            Some(ns) => format!(
                "{said}; through a pipe that shows too late: all records that end after {:.6} s of the recording are in doubt",
                ns as f64 / 1e9
            ),
            None => said,
        }
    }

    /// Damage where the next chunk should be.
    fn between(&self, said: String) -> Damage {
        let capture = &self.metadata.capture;
        let place = match self.next {
            Some(number) => format!("`{capture}-{number}`"),
            None => format!("behind `{capture}`"),
        };
        Damage { place, said }
    }

    /// Hands over a block of what is held and good.
    fn give(&mut self, slicer: &mut Slicer) -> Result<bool, Damage> {
        let end = self.filled.min(self.given + BLOCK);
        let used = match &mut self.scanner {
            Some(scanner) => scanner.scan(&self.held[self.given..end], slicer),
            None => 0,
        };
        self.given += used;
        if self.filled - self.given < self.metadata.unit {
            (self.filled, self.given, self.good) = (0, 0, false);
            if let Some(damage) = self.after.take() {
                return Err(damage);
            }
        }
        Ok(true)
    }

    /// Hands over what has come, but for a sample that is not whole.
    fn give_at_once(&mut self, slicer: &mut Slicer) {
        if let Some(scanner) = &mut self.scanner {
            let used = scanner.scan(&self.held[..self.filled], slicer);
            self.held.copy_within(used..self.filled, 0);
            self.filled -= used;
        }
    }
}

impl Source for Sr {
    fn channels(&self) -> &[Channel] {
        &self.channels
    }

    fn numbered(&self, number: usize) -> Option<Channel> {
        self.channels.iter().find(|c| c.id == number).cloned()
    }

    fn select(&mut self, ma: usize, slo: usize) {
        let (ma, slo, unit) = (Place::of(ma), Place::of(slo), self.metadata.unit);
        self.scanner = Some(Scanner::new(step_fs(self.rate_hz), unit, ma, slo));
    }

    fn read(&mut self, slicer: &mut Slicer) -> Result<bool, Damage> {
        if self.good {
            return self.give(slicer);
        }
        let Some(mut body) = self.body.take() else {
            return self.chunk();
        };
        let room = &mut self.held[self.filled..self.filled + BLOCK];
        match body.read(self.archive.input(), room) {
            Ok(0) => {
                self.good = true;
                let rest = body.out % self.metadata.unit as u64;
                if rest > 0 {
                    let unit = self.metadata.unit;
                    let said = format!("{rest} bytes are left, and a sample has {unit}");
                    self.after = Some(damage(&body.entry, body.out - rest, said));
                }
            }
            Ok(n) => {
                self.filled += n;
                if body.entry.size > HELD as u64 {
                    self.give_at_once(slicer);
                }
                self.body = Some(body);
            }
            Err(Wrong::Short(said)) => {
                self.good = true;
                self.after = Some(damage(&body.entry, body.out, said));
            }
            Err(Wrong::Bad(said)) => {
                let said = self.with_doubt(said);
                return Err(damage(&body.entry, body.out, said));
            }
        }
        Ok(true)
    }

    fn now_ns(&self) -> u64 {
        self.scanner.as_ref().map_or(0, Scanner::now_ns)
    }

    fn finish(&mut self, slicer: &mut Slicer) {
        if let Some(scanner) = &mut self.scanner {
            scanner.finish(slicer);
        }
    }
}

fn damage(entry: &Entry, at: u64, said: String) -> Damage {
    Damage {
        place: format!("byte {at} of `{}`", entry.name),
        said,
    }
}

/// Which chunk of samples this is; 0 is all of them.
fn chunk_number(capture: &str, name: &str) -> Option<u64> {
    match name.strip_prefix(capture)? {
        "" => Some(0),
        rest => rest.strip_prefix('-')?.parse().ok().filter(|n| *n > 0),
    }
}

/// Reads as far as `metadata`.
fn begin(mut archive: Archive) -> Result<(Archive, Metadata), String> {
    loop {
        let entry = archive.next().map_err(Wrong::said)?;
        let entry = entry.ok_or("a zip without `metadata`: it is no session of sigrok")?;
        match entry.name.as_str() {
            "metadata" => {
                let text = text(&mut archive, entry)?;
                return Ok((archive, Metadata::parse(&text)?));
            }
            "version" => {
                let text = text(&mut archive, entry)?;
                if !matches!(text.trim(), "1" | "2") {
                    let version = text.trim().escape_debug().take(20).collect::<String>();
                    return Err(format!("a session of version {version}: 1 and 2 are known"));
                }
            }
            name if name.starts_with("logic-") => {
                return Err(format!(
                    "`{name}` comes before `metadata`, which say how to read it: save it to a file, and read that"
                ));
            }
            _ => archive.skip(&entry).map_err(Wrong::said)?,
        }
    }
}

/// A small entry, whole.
fn text(archive: &mut Archive, entry: Entry) -> Result<String, String> {
    /// sigrok's have some hundred bytes.
    const LONGEST: usize = 256 << 10;
    let mut body = Body::new(entry);
    let mut bytes = vec![0; LONGEST];
    let mut n = 0;
    loop {
        let name = &body.entry.name;
        if n == bytes.len() {
            return Err(format!("`{name}` has more than {LONGEST} bytes"));
        }
        let name = name.clone();
        match body.read(archive.input(), &mut bytes[n..]) {
            Ok(0) => break,
            Ok(more) => n += more,
            Err(wrong) => return Err(format!("`{name}`: {}", wrong.said())),
        }
    }
    Ok(String::from_utf8_lossy(&bytes[..n]).into_owned())
}
