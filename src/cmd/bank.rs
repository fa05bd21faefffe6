//! `biss reg save` and `biss reg load`: banks of registers in a file, and back.

use super::Ended;
use super::reg::{Halt, work, work_on};
use super::saved::{BANK, Bank, Cells, Identity, Saved};
use super::talk::{Reading, Talk};
use crate::cli::{self, Span};
use crate::output::reg::{Bad, Register};
use anyhow::{Error, Result, anyhow, bail};
use biss::control::Failure;
use biss::registers::Trouble;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// A whole bank.
const WINDOW: Span = Span {
    first: 0x00,
    last: 0x3F,
};

/// What a slave is known by.
const IDENTITY: Span = Span {
    first: 0x78,
    last: 0x7F,
};

fn is_stream(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// Saves banks, the selected one where none is named.
pub(super) fn save(args: &cli::Reg, banks: &[u8], path: &Path) -> Result<Ended> {
    if is_stream(path) && args.format == cli::ReportFormat::Json {
        bail!("-o json and -w - would both go to standard output\n  leave one of them out");
    }
    work(args, &[], |talk| {
        let Some(identity) = identity(talk)? else {
            return Ok(false);
        };
        talk.learn_bank()?;
        match banks {
            [] => talk.read(WINDOW)?,
            _ => banks
                .iter()
                .try_for_each(|bank| talk.within(*bank, |talk| talk.read(WINDOW)))?,
        }
        let records = &talk.told.records;
        if !records.iter().all(Register::is_answer) {
            let said = "nothing was saved: load would take what is missing for refused";
            talk.told.notes.push(said.into());
            return Ok(false);
        }
        // A slave with only one bank refuses to say which it is.
        let selected = [talk.bank().unwrap_or(0)];
        let numbers = if banks.is_empty() { &selected } else { banks };
        let windows = numbers.iter().zip(records.chunks(BANK));
        let saved = Saved {
            slave: talk.slave(),
            identity,
            banks: windows
                .map(|(number, records)| Bank {
                    number: *number,
                    cells: held(records),
                })
                .collect(),
        };
        store(path, &saved.to_string()).map_err(Halt::Usage)?;
        let held = records.iter().filter(|record| record.bad.is_none()).count();
        let said = format!(
            "{held} registers saved in {}, {} refused",
            shown(path),
            records.len() - held
        );
        if !is_stream(path) {
            talk.told.notes.push(said);
        }
        Ok(true)
    })
}

fn held(records: &[Register]) -> Cells<BANK> {
    let mut cells = [None; BANK];
    for (cell, record) in cells.iter_mut().zip(records) {
        *cell = record.value;
    }
    cells
}

fn shown(path: &Path) -> String {
    match is_stream(path) {
        true => "standard input".into(),
        false => path.display().to_string(),
    }
}

/// Who the slave is; none, and a record of what failed, where it does not say so and does not refuse to.
fn identity(talk: &mut Talk) -> Result<Option<Identity>, Trouble> {
    let readings = talk.readings(IDENTITY)?;
    if let Some(index) = readings.iter().position(|reading| !reading.is_answer()) {
        let address = IDENTITY.first + index as u8;
        let record = talk.record(address, readings[index].clone());
        talk.told.records.push(record);
        return Ok(None);
    }
    let cell = |index: usize| readings.get(index).and_then(Reading::byte);
    Ok(Some(Identity {
        device: std::array::from_fn(cell),
        manufacturer: std::array::from_fn(|index| cell(6 + index)),
    }))
}

/// Puts a file in the place of what is there at once, so that nobody ever sees half of it.
pub(super) fn store(path: &Path, text: &str) -> Result<()> {
    let said = |e: io::Error| {
        anyhow!(
            "writing {}: {e}\n  is there room, and may you write there?",
            path.display()
        )
    };
    if is_stream(path) || path == Path::new("/dev/stdout") {
        return super::deliver(text);
    }
    // An open file by its number: what is in it belongs to whoever has opened it.
    if ["/dev/fd", "/dev/stderr", "/proc"]
        .iter()
        .any(|open| path.starts_with(open))
    {
        let mut file = OpenOptions::new().append(true).open(path).map_err(said)?;
        return file.write_all(text.as_bytes()).map_err(said);
    }
    // A device or a pipe is written to, not replaced; and a link goes on to lead where it does.
    let path = &fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    if fs::metadata(path).is_ok_and(|there| !there.is_file()) {
        let mut file = OpenOptions::new().write(true).open(path).map_err(said)?;
        return file.write_all(text.as_bytes()).map_err(said);
    }
    let beside = beside(path);
    let written = write_new(&beside, path, text);
    written.map_err(|error| {
        // Its own error would only hide the first one.
        let _ = fs::remove_file(&beside);
        said(error)
    })
}

/// A name of our own in the same folder.
fn beside(path: &Path) -> PathBuf {
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(format!(".{}", std::process::id()));
    path.with_file_name(name)
}

fn write_new(beside: &Path, path: &Path, text: &str) -> io::Result<()> {
    let mut file = File::create_new(beside)?;
    file.write_all(text.as_bytes())?;
    if let Ok(there) = fs::metadata(path) {
        file.set_permissions(there.permissions())?;
    }
    file.sync_all()?;
    fs::rename(beside, path)
}

/// A register that is to be written.
struct Difference {
    address: u8,
    want: u8,
    now: Reading,
}

/// Writes what differs from a file.
pub(super) fn load(
    args: &cli::Reg,
    banks: &[u8],
    path: &Path,
    dry_run: bool,
    force: bool,
) -> Result<Ended> {
    let saved = fetch(path)?;
    let chosen = choose(&saved, banks, path)?;
    let slave = args.slave.unwrap_or(saved.slave);
    work_on(args, slave, &[], |talk| {
        if !force && !is_same_device(talk, &saved, path)? {
            return Ok(false);
        }
        let mut plan = Vec::new();
        for bank in chosen {
            let differ = talk.within(bank.number, |talk| compare(talk, bank))?;
            let all = bank.cells.iter().flatten().count();
            let number = bank.number;
            talk.told.notes.push(match differ.len() {
                0 if all == 0 => format!("bank {number}: the file has nothing for it"),
                0 => format!("bank {number}: all {all} registers are as in the file"),
                some => format!("bank {number}: {some} of {all} registers differ"),
            });
            plan.push((bank, differ));
        }
        if dry_run {
            show(talk, &plan);
            return Ok(talk.told.records.iter().all(|record| record.bad.is_none()));
        }
        let readable = |(_, differ): &(&Bank, Vec<Difference>)| {
            differ.iter().all(|register| register.now.byte().is_some())
        };
        let result = match plan.iter().all(readable) {
            true => replace_all(talk, &plan),
            false => Ok(false),
        };
        complete(talk, &plan);
        Ok(result?)
    })
}

fn fetch(path: &Path) -> Result<Saved> {
    /// All banks there can be take less than that.
    const MOST: u64 = 1 << 20;
    let name = shown(path);
    let said = |e: io::Error| {
        anyhow!("reading {name}: {e}\n  name a file that `biss reg LINK save` has written")
    };
    let mut text = String::new();
    let read = match is_stream(path) {
        true => io::stdin().lock().take(MOST).read_to_string(&mut text),
        false => File::open(path).and_then(|file| file.take(MOST).read_to_string(&mut text)),
    };
    read.map_err(said)?;
    Saved::parse(&text).map_err(|wrong| anyhow!("{name}:{}: {wrong}", wrong.line))
}

/// The banks of the file that were asked for.
fn choose<'a>(saved: &'a Saved, banks: &[u8], path: &Path) -> Result<Vec<&'a Bank>> {
    let find = |number: &u8| {
        let found = saved.banks.iter().find(|bank| bank.number == *number);
        found.ok_or_else(|| {
            let there: Vec<String> = saved.banks.iter().map(|bank| bank.number.to_string()).collect();
            let (name, there) = (shown(path), there.join(", "));
            anyhow!("--bank {number}: {name} has no such bank\n  there is {there}; to write a bank into another one, edit the file")
        })
    };
    match banks {
        [] => Ok(saved.banks.iter().collect()),
        _ => banks.iter().map(find).collect(),
    }
}

fn is_same_device(talk: &mut Talk, saved: &Saved, path: &Path) -> Result<bool, Halt> {
    let Some(identity) = identity(talk)? else {
        return Ok(false);
    };
    if identity == saved.identity {
        return Ok(true);
    }
    Err(Halt::Usage(Error::msg(format!(
        "{} was saved from another device: {}; this one is {identity}\n  nothing was written; --force does not ask who it is",
        shown(path),
        saved.identity
    ))))
}

/// Registers without a gap between them, of those that are wanted.
fn spans(wanted: impl Iterator<Item = u8>) -> Vec<Span> {
    let mut spans: Vec<Span> = Vec::new();
    for address in wanted {
        match spans.last_mut() {
            Some(span) if span.last + 1 == address => span.last = address,
            _ => spans.push(Span {
                first: address,
                last: address,
            }),
        }
    }
    spans
}

/// What each register of a bank should hold, as far as the file says so.
fn wanted(bank: &Bank) -> Vec<(u8, u8)> {
    let cells = (0u8..).zip(bank.cells);
    cells
        .filter_map(|(address, cell)| Some((address, cell?)))
        .collect()
}

/// What each of them holds.
fn holds(talk: &mut Talk, bank: &Bank) -> Result<Vec<Difference>, Trouble> {
    let wanted = wanted(bank);
    let mut readings = Vec::new();
    for span in spans(wanted.iter().map(|(address, _)| *address)) {
        readings.extend(talk.readings(span)?);
    }
    let pairs = wanted.into_iter().zip(readings);
    let held = pairs.map(|((address, want), now)| Difference { address, want, now });
    Ok(held.collect())
}

fn compare(talk: &mut Talk, bank: &Bank) -> Result<Vec<Difference>, Trouble> {
    let mut all = holds(talk, bank)?;
    all.retain(|register| register.now.byte() != Some(register.want));
    Ok(all)
}

fn show(talk: &mut Talk, plan: &[(&Bank, Vec<Difference>)]) {
    for (bank, differ) in plan {
        for register in differ {
            let record = talk.record(register.address, register.now.clone());
            talk.told.records.push(Register {
                bank: Some(bank.number),
                want: Some(register.want),
                ..record
            });
        }
    }
}

/// Bank after bank, as long as all goes well.
fn replace_all(talk: &mut Talk, plan: &[(&Bank, Vec<Difference>)]) -> Result<bool, Trouble> {
    for (bank, differ) in plan.iter().filter(|(_, differ)| !differ.is_empty()) {
        // A bank is written whole or not at all, as far as signals go.
        let hold = talk.hold();
        let replaced = talk.within(bank.number, |talk| {
            hold.during(|| replace(talk, bank, differ))
        });
        if !replaced? {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Writes what differs, then reads all that is in the file.
fn replace(talk: &mut Talk, bank: &Bank, differ: &[Difference]) -> Result<bool, Trouble> {
    let mut rest = differ;
    for span in spans(differ.iter().map(|register| register.address)) {
        let (these, behind) = rest.split_at(span.addresses().len());
        rest = behind;
        let values: Vec<u8> = these.iter().map(|register| register.want).collect();
        let old: Vec<Reading> = these.iter().map(|register| register.now.clone()).collect();
        if !talk.overwrite(span, &values, &old, false)? {
            return Ok(false);
        }
    }
    let held = match holds(talk, bank) {
        Ok(held) => held,
        Err(trouble) => {
            let bad = Bad::of(&trouble);
            spoil(talk, bank.number, |_| {
                Some((None, bad.clone().but_echoed()))
            });
            return Err(trouble);
        }
    };
    let others: Vec<&Difference> = held
        .iter()
        .filter(|register| register.now.byte() != Some(register.want))
        .collect();
    spoil(talk, bank.number, |address| {
        let other = others.iter().find(|register| register.address == address)?;
        Some((other.now.byte(), other.verdict()))
    });
    // What was as it should be, and is not any more.
    for other in &others {
        if differ
            .iter()
            .all(|register| register.address != other.address)
        {
            let record = talk.record(other.address, other.now.clone());
            talk.told.records.push(Register {
                old: Some(other.want),
                want: Some(other.want),
                bad: Some(other.verdict()),
                write: true,
                ..record
            });
        }
    }
    Ok(others.is_empty())
}

impl Difference {
    /// Why it is not as it should be after it was written.
    fn verdict(&self) -> Bad {
        match &self.now {
            Reading::Byte(got) => Bad::new(
                Failure::ReadBack {
                    address: self.address,
                    want: self.want,
                    got: *got,
                },
                None,
            ),
            Reading::Not(bad) => bad.clone().but_echoed(),
        }
    }
}

/// Takes back what records of a bank say, where what was read says otherwise.
fn spoil(talk: &mut Talk, bank: u8, read: impl Fn(u8) -> Option<(Option<u8>, Bad)>) {
    for record in &mut talk.told.records {
        let here = record.bank == Some(bank) && record.write && record.bad.is_none();
        if let Some((value, bad)) = here.then(|| read(record.address)).flatten() {
            // Written means that it was echoed: so it held that once.
            record.want = record.value;
            (record.value, record.bad) = (value, Some(bad));
        }
    }
}

/// A record of each register that was to be written and was not.
fn complete(talk: &mut Talk, plan: &[(&Bank, Vec<Difference>)]) {
    for (bank, differ) in plan {
        for register in differ {
            let same = |record: &Register| {
                record.bank == Some(bank.number) && record.address == register.address
            };
            if talk.told.records.iter().any(same) {
                continue;
            }
            let record = talk.record(register.address, register.now.clone());
            let bad = record.bad.unwrap_or_else(Bad::untried);
            talk.told.records.push(Register {
                bank: Some(bank.number),
                old: record.value,
                want: Some(register.want),
                write: true,
                bad: Some(bad),
                ..record
            });
        }
    }
}
