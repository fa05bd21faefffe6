//! Asks the slaves on a line who they are, and finds the frame they send: their registers suggest formats, live frames
//! decide.

use crate::control::Failure;
use crate::cycle::Fault;
use crate::format::{Channel, Format};
use crate::frame::BissC;
use crate::identity::{self, Candidate, Known};
use crate::link::{Error, Link};
use crate::master::{Master, Slot};
use crate::registers::{Bank, Cell, Registers, Trouble};

/// What the slaves on a line say about themselves.
#[derive(Clone, Debug)]
pub struct Bus {
    /// Slaves that took an ID; 9 stands for nine or more, of which the ninth and later cannot be asked.
    pub present: u8,
    /// One for each ID.
    pub devices: Vec<Known>,
    /// What would have been read with another bank selected.
    pub left_out: Vec<identity::Read>,
    /// What could not be read to its end, and why.
    pub failed: Vec<(identity::Read, Failure)>,
}

/// Asks every slave that takes an ID. Nothing is written but the bank selection, and that only where `write` allows it; it
/// is restored.
///
/// # Errors
/// When no slave answers to control frames, a bank cannot be restored, or the link fails.
pub fn ask(registers: &mut Registers<'_, '_>, write: bool) -> Result<Bus, Trouble> {
    let mut bus = Bus {
        present: 0,
        devices: Vec::new(),
        left_out: Vec::new(),
        failed: Vec::new(),
    };
    for slave in 0..crate::control::MAX_IDS {
        if slave > 0 && slave >= bus.present {
            break;
        }
        match ask_one(registers, slave, write, &mut bus) {
            Ok(known) => bus.devices.push(known),
            Err(trouble) if slave > 0 && is_absent(&trouble) => {
                // Bit errors have made an ID more, or hidden one.
                bus.present = registers.count()?;
                if bus.present > slave {
                    return Err(trouble);
                }
                break;
            }
            Err(trouble) => return Err(trouble),
        }
        bus.present = bus.present.max(registers.count()?);
    }
    Ok(bus)
}

fn is_absent(trouble: &Trouble) -> bool {
    let Trouble::Slave { failure, .. } = trouble else {
        return false;
    };
    matches!(failure, Failure::Absent { .. })
}

fn ask_one(
    registers: &mut Registers<'_, '_>,
    slave: u8,
    write: bool,
    bus: &mut Bus,
) -> Result<Known, Trouble> {
    let mut known = Known::new(slave);
    let mut selected: Option<Bank> = None;
    let result = ask_all(registers, &mut known, write, bus, &mut selected);
    let restored = selected.map_or(Ok(()), |bank| registers.restore(bank));
    result?;
    restored?;
    Ok(known)
}

fn ask_all(
    registers: &mut Registers<'_, '_>,
    known: &mut Known,
    write: bool,
    bus: &mut Bus,
    selected: &mut Option<Bank>,
) -> Result<(), Trouble> {
    while let Some(read) = known.wanted() {
        if let Some(number) = read.bank {
            if !write && registers.bank(read.slave)? != Some(number) {
                bus.left_out.push(read);
                known.store(&read, &[]);
                continue;
            }
            match registers.select(read.slave, number) {
                // The first one that changed anything knows what was selected before all of them.
                Ok(bank) if bank.changes() => drop(selected.get_or_insert(bank)),
                Ok(_) => {}
                Err(Trouble::Slave { failure, .. }) => {
                    bus.failed.push((read, failure));
                    known.store(&read, &[]);
                    continue;
                }
                Err(other) => return Err(other),
            }
        }
        let addresses = u16::from(read.first)..u16::from(read.last) + 1;
        let cells = registers.cells(read.slave, addresses)?;
        let failed = cells.iter().find_map(|cell| match cell {
            Cell::Failed(failure) => Some(*failure),
            _ => None,
        });
        bus.failed.extend(failed.map(|failure| (read, failure)));
        let cells: Vec<identity::Cell> = cells.into_iter().map(known_as).collect();
        known.store(&read, &cells);
    }
    Ok(())
}

fn known_as(cell: Cell) -> identity::Cell {
    match cell {
        Cell::Byte(byte) => identity::Cell::Byte(byte),
        Cell::Refused => identity::Cell::Refused,
        Cell::Failed(_) => identity::Cell::Unread,
    }
}

/// Frames that a format is tried on at first.
const FRAMES: u32 = 16;

/// Frames that formats are tried on again when several have passed: a position that moves decides between them.
const MORE_FRAMES: u32 = 128;

/// Clocks behind the stop bit, as many as a whole channel has: one that the registers do not speak of shows there.
const SURPLUS: u16 = 80;

/// After so many frames without a good one nothing better is expected of a format that taught nothing.
const HOPELESS: u32 = 8;

/// What live frames said to a format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trial {
    /// Frames run.
    pub frames: u32,
    /// Of these, with every CRC, the stop bit and the surplus clocks right.
    pub good: u32,
    /// What was wrong with the last other one.
    pub fault: Option<Fault>,
    /// All of these carried the same data: then one wrong format in 64 passes as well, with CRC-6.
    pub alike: bool,
}

impl Trial {
    /// Three of four frames are right: noise takes single ones. A wrong format passes one frame in 64 with CRC-6.
    pub fn passes(&self) -> bool {
        self.frames > 0 && self.good >= self.frames - self.frames / 4
    }
}

/// Tries formats on live frames. One trial for each, none for those that no frame can confirm because a channel has no CRC.
/// Where formats of different bits pass they are tried on more frames, so that few or one is left.
///
/// # Errors
/// When the link fails.
pub fn prove(
    link: &mut dyn Link,
    candidates: &[Candidate],
    protocol: &dyn Fn(Format) -> BissC,
    stop: &dyn Fn() -> bool,
) -> Result<Vec<Option<Trial>>, Error> {
    let mut trials: Vec<Option<Trial>> = Vec::with_capacity(candidates.len());
    for candidate in candidates {
        let twin = candidates[..trials.len()]
            .iter()
            .position(|before| same_trial(&before.format, &candidate.format));
        trials.push(match twin {
            Some(twin) => trials[twin],
            None => attempt(link, &candidate.format, protocol, stop, FRAMES)?,
        });
    }
    let passing = |trials: &[Option<Trial>]| different(candidates, trials);
    let open = passing(&trials);
    if open.len() > 1 {
        for index in open {
            let format = &candidates[index].format;
            let more = attempt(link, format, protocol, stop, MORE_FRAMES)?;
            for (trial, candidate) in trials.iter_mut().zip(candidates) {
                if same_trial(&candidate.format, format) {
                    *trial = more;
                }
            }
        }
    }
    Ok(trials)
}

/// The formats that pass, the first one for each way to cut the frame into channels and CRCs: what the fields in a channel
/// mean no frame can tell, so the likeliest stands for all.
pub fn different(candidates: &[Candidate], trials: &[Option<Trial>]) -> Vec<usize> {
    let mut found: Vec<usize> = Vec::new();
    for (index, trial) in trials.iter().enumerate() {
        let passes = trial.is_some_and(|trial| trial.passes());
        let format = &candidates[index].format;
        let known = |at: &usize| same_bits(&candidates[*at].format, format);
        if passes && !found.iter().any(known) {
            found.push(index);
        }
    }
    found
}

/// Whether two formats are the same but for what fields mean.
fn same_bits(a: &Format, b: &Format) -> bool {
    let bits = |channel: &Channel| (channel.data_bits(), channel.crc().cloned());
    a.channels()
        .iter()
        .map(bits)
        .eq(b.channels().iter().map(bits))
}

/// Whether no frame can tell two formats apart: it can where one has a sign of life, which has to count.
fn same_trial(a: &Format, b: &Format) -> bool {
    let life = |channel: &Channel| {
        channel
            .find(|kind| *kind == crate::format::Kind::Life)
            .cloned()
    };
    same_bits(a, b)
        && a.channels()
            .iter()
            .map(life)
            .eq(b.channels().iter().map(life))
}

fn attempt(
    link: &mut dyn Link,
    format: &Format,
    protocol: &dyn Fn(Format) -> BissC,
    stop: &dyn Fn() -> bool,
    frames: u32,
) -> Result<Option<Trial>, Error> {
    if format
        .channels()
        .iter()
        .any(|channel| channel.crc().is_none())
    {
        return Ok(None);
    }
    let protocol = BissC {
        surplus: Some(SURPLUS),
        ..protocol(format.clone())
    };
    let mut master = Master::new(link, &protocol, None);
    master.stop_when(stop);
    let mut trial = Trial {
        frames: 0,
        good: 0,
        fault: None,
        alike: true,
    };
    let mut first: Option<Vec<u64>> = None;
    // An encoder whose busy time wanders need not have shown two frames that agree by now.
    let learned = master.open()?;
    for _ in 0..frames {
        let hopeless = !learned && trial.good == 0 && trial.frames >= HOPELESS;
        if hopeless || stop() || master.slot(0, None)? == Slot::Ended {
            break;
        }
        trial.frames += 1;
        match fault(&master) {
            // The encoder's own word for no valid data: its CRC is right.
            None | Some(Fault::Null) => {
                let data = || master.cycle().words().iter().map(|word| word.raw().0);
                trial.good += 1;
                match &first {
                    Some(first) => trial.alike &= first.iter().copied().eq(data()),
                    None => first = Some(data().collect()),
                }
            }
            // Everything is right but where the start bit stands, which is no matter of the format.
            Some(Fault::Mismatch { .. } | Fault::Delay { .. }) => trial.good += 1,
            wrong => trial.fault = wrong,
        }
    }
    Ok(Some(trial))
}

fn fault(master: &Master<'_>) -> Option<Fault> {
    let cycle = master.cycle();
    let word = || cycle.words().iter().find_map(|word| word.fault());
    cycle.fault().or_else(word)
}
