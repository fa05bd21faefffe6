//! Registers and commands, one call each: runs frames until an access has ended, checks what was read and written, and
//! leaves banks as it found them.

use crate::control::{ADDRESSES, Access, Failure, Outcome};
use crate::cycle::Fault;
use crate::link::Error;
use crate::master::{Master, Slot};
use std::fmt;
use std::ops::Range;

/// Bank select: which bank the addresses 0x00 to 0x3F show (D2, p. 20).
pub const BANK_SELECT: u8 = 0x40;

/// How often a register is read at most until it gives the same twice.
const READINGS: u32 = 5;

/// Why there is no answer.
#[derive(Debug)]
pub enum Trouble {
    /// The machine failed.
    Link(Error),
    /// The slave did something else than was asked.
    Slave {
        /// What.
        failure: Failure,
        /// What was wrong with the last frame, where that was the reason.
        fault: Option<Fault>,
    },
    /// It was time to end.
    Stopped,
}

impl From<Error> for Trouble {
    fn from(error: Error) -> Trouble {
        Trouble::Link(error)
    }
}

impl fmt::Display for Trouble {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Trouble::Link(error) => error.fmt(f),
            Trouble::Slave {
                failure,
                fault: Some(fault),
            } => write!(f, "{failure}: {fault}"),
            Trouble::Slave { failure, .. } => failure.fmt(f),
            Trouble::Stopped => f.write_str("stopped"),
        }
    }
}

impl std::error::Error for Trouble {}

/// A register as it was read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cell {
    /// Its content.
    Byte(u8),
    /// The slave refuses it.
    Refused,
    /// It could not be read.
    Failed(Failure),
}

impl Cell {
    /// Its content.
    pub fn byte(self) -> Option<u8> {
        match self {
            Cell::Byte(byte) => Some(byte),
            _ => None,
        }
    }
}

/// How a bank is left.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use = "the bank has to be restored"]
pub struct Bank {
    slave: u8,
    /// What was selected before, where it is not anyway.
    before: Option<u8>,
}

impl Bank {
    /// Whether another one was selected before.
    pub fn changes(&self) -> bool {
        self.before.is_some()
    }
}

/// The registers of the slaves behind a master.
#[derive(Debug)]
pub struct Registers<'m, 'a> {
    master: &'m mut Master<'a>,
    /// Read everything twice.
    verify: bool,
    /// What has to be brought to its end is, though it is time to end.
    finishing: bool,
    late: bool,
    /// IDs taken, and those of the last control frame, which one bit error can make others.
    idl: Option<u16>,
    idl_seen: Option<u16>,
    /// They are the same.
    agree: bool,
    retries: u64,
    frames: u64,
}

impl<'m, 'a> Registers<'m, 'a> {
    /// Over a master that is open.
    pub fn new(master: &'m mut Master<'a>) -> Registers<'m, 'a> {
        Registers {
            late: !master.link().caps().reacts,
            master,
            verify: false,
            finishing: false,
            idl: None,
            idl_seen: None,
            agree: false,
            retries: 0,
            frames: 0,
        }
    }

    /// Reads every register twice at least, until two readings agree: CRC-4 lets 17 of 220 triple bit errors pass. Bytes
    /// for which the slave had to be waited for are always read so.
    pub fn verify(&mut self, verify: bool) {
        self.verify = verify;
    }

    /// Slaves that took an ID, as the last two control frames that agree have shown; 9 stands for nine or more.
    pub fn present(&self) -> u8 {
        self.idl.map_or(0, |idl| idl.trailing_ones() as u8)
    }

    /// No CRC protects IDL: it is believed when it comes twice in a row.
    fn took_ids(&mut self, idl: u16) {
        self.agree = self.idl_seen.replace(idl) == Some(idl);
        if self.agree || self.idl.is_none() {
            self.idl = Some(idl);
        }
    }

    /// [`Registers::present`], after reading until two control frames agree.
    ///
    /// # Errors
    /// When the link fails, or it is time to end.
    pub fn count(&mut self) -> Result<u8, Trouble> {
        for _ in 0..READINGS {
            if self.agree {
                break;
            }
            self.access(Access::Read {
                slave: 0,
                address: BANK_SELECT,
                count: 1,
            })?;
        }
        Ok(self.present())
    }

    /// Control frames given up and repeated so far.
    pub fn retries(&self) -> u64 {
        self.retries
    }

    /// Frames run so far.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// The master.
    pub fn master(&mut self) -> &mut Master<'a> {
        self.master
    }

    /// Runs an access to its end, whatever that is.
    ///
    /// # Errors
    /// When the link fails, or it is time to end: then the slave has been led out of the access.
    pub fn access(&mut self, access: Access) -> Result<Outcome, Trouble> {
        self.master.ask(access)?;
        loop {
            if !self.finishing && self.master.stops() {
                self.rest()?;
                return Err(Trouble::Stopped);
            }
            self.frame()?;
            if let Some(outcome) = self.master.outcome() {
                self.retries += u64::from(outcome.retries);
                let nobody = outcome.failure == Some(Failure::Unheard);
                if nobody || outcome.idl != 0 {
                    self.took_ids(outcome.idl);
                }
                return Ok(outcome);
            }
        }
    }

    fn frame(&mut self) -> Result<(), Trouble> {
        self.frames += 1;
        match self.master.slot(0, None)? {
            Slot::Ended => Err(Trouble::Stopped),
            Slot::Done { .. } | Slot::Piece(_) => Ok(()),
        }
    }

    /// Leads the slaves out of an access, and runs frames until they wait for nothing more. After the last access, too: until
    /// then a slave that was written to waits for another byte.
    ///
    /// # Errors
    /// When the link fails.
    pub fn rest(&mut self) -> Result<(), Trouble> {
        /// The longest rest of a byte, and room for disturbed frames.
        const FRAMES: u32 = 100;
        self.master.give_up();
        for _ in 0..FRAMES {
            if self.master.rests() {
                break;
            }
            self.frame()?;
        }
        Ok(())
    }

    fn slave_did(&self, failure: Failure) -> Trouble {
        let cut = matches!(failure, Failure::Cut | Failure::Undecided);
        Trouble::Slave {
            failure,
            fault: self.master.cycle().fault().filter(|_| cut),
        }
    }

    fn whole(&self, outcome: Outcome) -> Result<Outcome, Trouble> {
        match outcome.failure {
            None => Ok(outcome),
            Some(failure) => Err(self.slave_did(failure)),
        }
    }

    /// Registers one after the other.
    ///
    /// # Errors
    /// When one of them cannot be read.
    pub fn read(&mut self, slave: u8, address: u8, count: u8) -> Result<Vec<u8>, Trouble> {
        let end = u16::from(address) + u16::from(count);
        let cells = self.cells(slave, address.into()..end)?;
        let bytes = cells
            .into_iter()
            .zip(address..)
            .map(|(cell, address)| match cell {
                Cell::Byte(byte) => Ok(byte),
                Cell::Refused => Err(self.slave_did(Failure::Refused { address })),
                Cell::Failed(failure) => Err(self.slave_did(failure)),
            });
        bytes.collect()
    }

    /// Registers one after the other, each with its own verdict. Stops at the first one that is not just refused: what
    /// comes after it is missing.
    ///
    /// # Errors
    /// When nobody is there at all, or the link fails.
    pub fn cells(&mut self, slave: u8, addresses: Range<u16>) -> Result<Vec<Cell>, Trouble> {
        reaches(addresses.start.into(), addresses.len())?;
        let mut cells = Vec::new();
        loop {
            let start = addresses.start.saturating_add(cells.len() as u16);
            if start >= addresses.end || matches!(cells.last(), Some(Cell::Failed(_))) {
                return Ok(cells);
            }
            let mut doubtful = Vec::new();
            let mut part = self.cells_once(slave, start..addresses.end, &mut doubtful)?;
            if self.verify {
                doubtful = (0..part.len()).collect();
            }
            self.read_again(slave, start, doubtful, &mut part)?;
            // What could not be read at first may have been later: then there is more behind it.
            cells.append(&mut part);
        }
    }

    /// Reads once. What needs a second reading is added to `doubtful`, counted from the first address.
    fn cells_once(
        &mut self,
        slave: u8,
        addresses: Range<u16>,
        doubtful: &mut Vec<usize>,
    ) -> Result<Vec<Cell>, Trouble> {
        let mut cells = Vec::new();
        let mut at = addresses.start;
        while at < addresses.end {
            let outcome = self.access(Access::Read {
                slave,
                address: at as u8,
                count: (addresses.end - at) as u8,
            })?;
            let had = cells.len();
            doubtful.extend(
                (0..128)
                    .filter(|byte| outcome.waited >> byte & 1 == 1)
                    .map(|byte| had + byte),
            );
            cells.extend(
                outcome
                    .bytes
                    .as_slice()
                    .iter()
                    .map(|byte| Cell::Byte(*byte)),
            );
            at = addresses.start + cells.len() as u16;
            match outcome.failure {
                None => {}
                Some(Failure::Refused { .. } | Failure::Silent { .. }) => {
                    cells.push(Cell::Refused);
                    at += 1;
                }
                Some(failure @ (Failure::Unheard | Failure::Absent { .. })) => {
                    return Err(self.slave_did(failure));
                }
                Some(failure) => {
                    cells.push(Cell::Failed(failure));
                    break;
                }
            }
        }
        Ok(cells)
    }

    /// Reads until two readings of each register agree.
    fn read_again(
        &mut self,
        slave: u8,
        start: u16,
        mut open: Vec<usize>,
        cells: &mut [Cell],
    ) -> Result<(), Trouble> {
        for reading in 1..READINGS {
            let last = reading == READINGS - 1;
            let mut differ = Vec::new();
            for run in runs(&open) {
                let addresses = start + run.start as u16..start + run.end as u16;
                let again = self.cells_once(slave, addresses, &mut Vec::new())?;
                for (at, index) in run.enumerate() {
                    let (before, now) = (cells[index], again.get(at).copied());
                    if now == Some(before) {
                        continue;
                    }
                    differ.push(index);
                    let address = (start + index as u16) as u8;
                    match (now, again.last()) {
                        (_, Some(end)) if last => {
                            cells[index] = unsettled(address, before, now.unwrap_or(*end));
                        }
                        (Some(now), _) => cells[index] = now,
                        // Behind one that could not be read nothing was: what was there is still to be confirmed.
                        (None, _) => {}
                    }
                }
            }
            open = differ;
        }
        Ok(())
    }

    /// Writes registers one after the other, and reads each back where `check` says so, or the link is one that lays CDM out
    /// before it sees CDS.
    ///
    /// # Errors
    /// When a byte was not echoed as it was sent, or reads otherwise. Those before it have been written; the one named may
    /// have been.
    pub fn write(
        &mut self,
        slave: u8,
        address: u8,
        data: &[u8],
        check: bool,
    ) -> Result<(), Trouble> {
        reaches(address.into(), data.len())?;
        let outcome = self.access(Access::Write {
            slave,
            address,
            data: data.into(),
        })?;
        self.whole(outcome)?;
        if !check && !self.late {
            return Ok(());
        }
        let back = self.read(slave, address, data.len() as u8)?;
        let pairs = data.iter().zip(&back).zip(address..);
        let differs = pairs.into_iter().find(|((want, got), _)| want != got);
        match differs {
            None => Ok(()),
            Some(((want, got), address)) => Err(self.slave_did(Failure::ReadBack {
                address,
                want: *want,
                got: *got,
            })),
        }
    }

    /// Sends a command. Returns which slaves have acknowledged it; none for a broadcast.
    ///
    /// # Errors
    /// When it was not executed, or nobody can say whether it was.
    pub fn command(
        &mut self,
        slaves: u8,
        code: u8,
        checked: bool,
        reduced: bool,
    ) -> Result<Outcome, Trouble> {
        let outcome = self.access(Access::Command {
            slaves,
            code,
            checked,
            reduced,
        })?;
        self.whole(outcome)
    }

    /// The selected bank; none where the slave refuses to say: then it has only one.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn bank(&mut self, slave: u8) -> Result<Option<u8>, Trouble> {
        let address = u16::from(BANK_SELECT);
        let cells = self.cells(slave, address..address + 1)?;
        match cells.first() {
            Some(Cell::Byte(bank)) => Ok(Some(*bank)),
            Some(Cell::Failed(failure)) => Err(self.slave_did(*failure)),
            Some(Cell::Refused) | None => Ok(None),
        }
    }

    /// Selects a bank. [`Registers::restore`] brings the one before back.
    ///
    /// # Errors
    /// When the slave has only one bank and another is wanted, or does not select it. Then the one before is selected again,
    /// as far as the slave lets itself be talked to.
    pub fn select(&mut self, slave: u8, bank: u8) -> Result<Bank, Trouble> {
        let before = self.bank(slave)?;
        match before {
            Some(before) if before != bank => {}
            None if bank != 0 => {
                return Err(self.slave_did(Failure::Refused {
                    address: BANK_SELECT,
                }));
            }
            _ => {
                return Ok(Bank {
                    slave,
                    before: None,
                });
            }
        }
        let selected = Bank { slave, before };
        match self.write(slave, BANK_SELECT, &[bank], true) {
            Ok(()) => Ok(selected),
            Err(trouble) => {
                // What has gone wrong first is what the user has to know.
                let _ = self.restore(selected);
                Err(trouble)
            }
        }
    }

    /// Selects the bank again that was selected before, even when it is time to end.
    ///
    /// # Errors
    /// When the slave does not; its other bank stays selected then.
    pub fn restore(&mut self, bank: Bank) -> Result<(), Trouble> {
        let Some(before) = bank.before else {
            return Ok(());
        };
        let finishing = std::mem::replace(&mut self.finishing, true);
        let result = self.write(bank.slave, BANK_SELECT, &[before], true);
        self.finishing = finishing;
        result
    }

    /// Does something with a bank selected, and selects the one before again, whatever came of it.
    ///
    /// # Errors
    /// What went wrong first.
    pub fn within<T>(
        &mut self,
        slave: u8,
        bank: u8,
        work: impl FnOnce(&mut Self) -> Result<T, Trouble>,
    ) -> Result<T, Trouble> {
        let selected = self.select(slave, bank)?;
        let result = work(self);
        let restored = self.restore(selected);
        let result = result?;
        restored.map(|()| result)
    }
}

/// Whether so many registers are there, before their number is cut to what a control frame can say.
fn reaches(address: usize, count: usize) -> Result<(), Error> {
    let end = address + count;
    if end <= usize::from(ADDRESSES) {
        return Ok(());
    }
    let said = format!("registers end at 0x7f, not at {:#04x}", end - 1);
    Err(Error::new(
        "talking to the slave's registers",
        said,
        "look at the addresses",
    ))
}

/// What two readings come to that do not agree.
fn unsettled(address: u8, before: Cell, now: Cell) -> Cell {
    Cell::Failed(match (before, now) {
        (_, Cell::Failed(failure)) | (Cell::Failed(failure), _) => failure,
        (Cell::Byte(first), Cell::Byte(second)) => Failure::Unsteady {
            address,
            first,
            second,
        },
        (Cell::Refused, _) | (_, Cell::Refused) => Failure::Refused { address },
    })
}

/// Numbers in order as ranges without gaps.
fn runs(numbers: &[usize]) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for number in numbers {
        match runs.last_mut() {
            Some(run) if run.end == *number => run.end += 1,
            _ => runs.push(*number..number + 1),
        }
    }
    runs
}
