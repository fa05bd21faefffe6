//! `biss reg`: registers of one slave.

use super::session::{LOOKING, Session, explain};
use super::talk::{Talk, Told};
use super::{Ended, Outcome, bank, deliver, sum_up};
use crate::cli::{self, Assign, RegVerb, ReportFormat, Span};
use crate::output::note;
use crate::output::reg::{self, Bad, Effort, Register, Written};
use anyhow::{Error, Result, bail};
use biss::registers::{BANK_SELECT, Registers, Trouble};

/// Why the work did not come to its end.
#[derive(Debug)]
pub(super) enum Halt {
    /// The slave, the link, or a signal.
    Trouble(Trouble),
    /// What the user wants does not fit what was found.
    Usage(Error),
}

impl From<Trouble> for Halt {
    fn from(trouble: Trouble) -> Halt {
        Halt::Trouble(trouble)
    }
}

pub(crate) fn run(args: cli::Reg) -> Result<Ended> {
    let banks = args.bank.as_ref().map_or(&[][..], |banks| &banks.0);
    match &args.verb {
        RegVerb::Read { spans } => {
            let bank = one_bank(banks, spans.iter().map(|span| span.first))?;
            let asked: Vec<Asked> = spans
                .iter()
                .flat_map(|span| span.addresses())
                .map(reading)
                .collect();
            work(&args, &asked, |talk| {
                perhaps_within(talk, bank, |talk| {
                    spans.iter().try_for_each(|span| talk.read(*span))
                })?;
                Ok(all_good(talk))
            })
        }
        RegVerb::Dump { span } => {
            let span = span.unwrap_or(Span::ALL);
            let bank = one_bank(banks, [span.first].into_iter())?;
            let asked: Vec<Asked> = span.addresses().map(reading).collect();
            work(&args, &asked, |talk| {
                perhaps_within(talk, bank, |talk| {
                    if bank.is_none() && span.first < BANK_SELECT {
                        talk.learn_bank()?;
                    }
                    talk.read(span)
                })?;
                // That a register is not there is what one wants to know.
                Ok(talk.told.records.iter().all(Register::is_answer))
            })
        }
        RegVerb::Write { assigns, unchecked } => {
            let bank = one_bank(banks, assigns.iter().map(|assign| assign.address))?;
            write(&args, bank, assigns, !unchecked)
        }
        RegVerb::Save { write } => bank::save(&args, banks, write),
        RegVerb::Load {
            file,
            dry_run,
            force,
        } => bank::load(&args, banks, file, *dry_run, *force),
    }
}

/// A register, and what is to be written there, if anything.
type Asked = (u8, Option<u8>);

fn reading(address: u8) -> Asked {
    (address, None)
}

/// The bank that was asked for, which must be one, and show something.
fn one_bank(banks: &[u8], addresses: impl Iterator<Item = u8>) -> Result<Option<u8>> {
    match banks {
        [] => Ok(None),
        [_] if addresses.min() >= Some(BANK_SELECT) => {
            bail!(
                "--bank has no meaning here: registers from 0x40 on are in no bank\n  leave it out"
            )
        }
        [bank] => Ok(Some(*bank)),
        _ => bail!("one bank at a time\n  only save and load take several"),
    }
}

fn perhaps_within(
    talk: &mut Talk,
    bank: Option<u8>,
    work: impl FnOnce(&mut Talk) -> Result<(), Trouble>,
) -> Result<(), Trouble> {
    match bank {
        Some(bank) => talk.within(bank, work),
        None => work(talk),
    }
}

fn all_good(talk: &Talk) -> bool {
    talk.told.records.iter().all(|record| record.bad.is_none())
}

/// Assignments to registers that follow each other, in one; 0x40 changes what those before it are.
fn joined(assigns: &[Assign]) -> Vec<Assign> {
    let mut all: Vec<Assign> = Vec::new();
    for assign in assigns {
        let behind = |last: &Assign| usize::from(last.address) + last.values.len();
        match all.last_mut() {
            Some(last)
                if behind(last) == usize::from(assign.address) && assign.address != BANK_SELECT =>
            {
                last.values.extend(&assign.values);
            }
            _ => all.push(assign.clone()),
        }
    }
    all
}

fn write(args: &cli::Reg, bank: Option<u8>, assigns: &[Assign], check: bool) -> Result<Ended> {
    let groups = joined(assigns);
    let mut asked: Vec<Asked> = Vec::new();
    for group in &groups {
        let puts = (group.address..).zip(group.values.iter().copied().map(Some));
        asked.extend(puts);
    }
    let selects = asked.iter().any(|(address, _)| *address == BANK_SELECT);
    if selects && bank.is_some() {
        bail!("--bank selects with 0x40, and brings it back\n  write 0x40, or say --bank");
    }
    work(args, &asked, |talk| {
        perhaps_within(talk, bank, |talk| {
            for group in &groups {
                if !talk.write(group.address, &group.values, check)? {
                    break;
                }
            }
            Ok(())
        })?;
        let selected = |record: &&Register| record.address == BANK_SELECT && record.bad.is_none();
        if let Some(bank) = talk
            .told
            .records
            .iter()
            .rfind(selected)
            .and_then(|r| r.value)
        {
            let said = format!("bank {bank} stays selected; --bank N brings back the one before");
            talk.told.notes.push(said);
        }
        Ok(all_good(talk) && talk.told.records.len() == asked.len())
    })
}

/// Opens the line, works with the slave's registers, and tells what came of it. `asked` are the registers that there is to
/// be a record of, in their order, as far as that is known before.
pub(super) fn work(
    args: &cli::Reg,
    asked: &[Asked],
    work: impl FnOnce(&mut Talk) -> Result<bool, Halt>,
) -> Result<Ended> {
    let slave = args.slave.unwrap_or(0);
    work_on(args, slave, asked, work)
}

/// Likewise, with the slave known from elsewhere.
pub(super) fn work_on(
    args: &cli::Reg,
    slave: u8,
    asked: &[Asked],
    work: impl FnOnce(&mut Talk) -> Result<bool, Halt>,
) -> Result<Ended> {
    let mut session = Session::open(&args.wire, args.stubborn.retries)?;
    let (told, effort, result) = run_work(&mut session, args, slave, work);
    let told = completed(told, args, slave, asked, &result);
    let quiet = args.wire.quiet;
    // A write that was half done has to be told wherever it can be.
    let delivered = deliver(&rendered(&told.records, args)?);
    let noted = told.notes.iter().filter(|_| !quiet);
    noted.for_each(note);
    sum_up(&args.wire, args.format, effort, result.is_ok());
    let ended = match result {
        Ok(true) if delivered.is_ok() => return Ok(session.end(Outcome::Good)),
        Ok(true) => Ok(session.end(Outcome::Bad)),
        Ok(false) => {
            let complaint = complaint(args, &told.records);
            complaint.iter().filter(|_| !quiet).for_each(note);
            Ok(session.end(Outcome::Bad))
        }
        Err(Halt::Trouble(trouble)) => session.fail(&told.doing, trouble),
        Err(Halt::Usage(error)) => Err(error),
    };
    if !quiet {
        tell_written(&told.records);
    }
    delivered.and(ended)
}

type Worked = (Told, Option<Effort>, Result<bool, Halt>);

fn run_work(
    session: &mut Session,
    args: &cli::Reg,
    slave: u8,
    work: impl FnOnce(&mut Talk) -> Result<bool, Halt>,
) -> Worked {
    let hold = session.hold();
    let mut master = match session.master() {
        Ok(master) => master,
        Err(trouble) => {
            let told = Told {
                doing: LOOKING.into(),
                ..Told::default()
            };
            return (told, None, Err(trouble.into()));
        }
    };
    let mut registers = Registers::new(&mut master);
    registers.verify(args.verify);
    let mut talk = Talk::new(&mut registers, hold.clone(), slave);
    let result = work(&mut talk);
    let told = talk.told;
    let refusal = |record: &&Register| record.bad.as_ref().is_some_and(Bad::is_refusal);
    let refused = told.records.iter().filter(refusal).count();
    let effort = Effort {
        registers: Some((told.records.len(), refused)),
        frames: registers.frames(),
        retries: registers.retries(),
    };
    // A slave that was written to waits for another byte until then.
    let rested = hold.during(|| registers.rest());
    let result = result.and_then(|good| Ok(rested.map(|()| good)?));
    (told, Some(effort), result)
}

/// Scripts find a record of every register that was asked for.
fn completed(
    mut told: Told,
    args: &cli::Reg,
    slave: u8,
    asked: &[Asked],
    result: &Result<bool, Halt>,
) -> Told {
    let write = matches!(args.verb, RegVerb::Write { .. });
    if args.format == ReportFormat::Text && !write {
        return told;
    }
    let bad = match result {
        Err(Halt::Trouble(trouble)) if told.records.is_empty() => Bad::of(trouble),
        _ => Bad::untried(),
    };
    let bank = args.bank.as_ref().and_then(|banks| banks.0.first());
    for (address, want) in asked.iter().skip(told.records.len()) {
        told.records.push(Register {
            write,
            want: *want,
            bad: Some(bad.clone()),
            ..Register::untouched(slave, bank.copied(), *address)
        });
    }
    told
}

fn rendered(records: &[Register], args: &cli::Reg) -> Result<String> {
    match (&args.verb, args.format) {
        (RegVerb::Dump { .. }, ReportFormat::Text) => return Ok(reg::table(records)),
        (RegVerb::Save { .. }, ReportFormat::Text) => return Ok(String::new()),
        _ => {}
    }
    let lines = records.iter().map(|record| record.render(args.format));
    Ok(lines.collect::<Result<String, _>>()?)
}

/// What went wrong first, and what to try.
fn complaint(args: &cli::Reg, records: &[Register]) -> Option<String> {
    let dump = matches!(args.verb, RegVerb::Dump { .. } | RegVerb::Save { .. });
    let bad = |record: &Register| {
        let bad = record
            .bad
            .as_ref()
            .filter(|bad| !(dump && bad.is_refusal()))?;
        let (failure, fault) = bad.failure()?;
        let doing = if record.write { "writing" } else { "reading" };
        let doing = format!("{doing} registers of slave {}", record.slave);
        Some(explain(&doing, failure, fault))
    };
    records.iter().find_map(bad)
}

/// After a write that was not all good nobody shall have to guess.
fn tell_written(records: &[Register]) {
    let mut banks: Vec<Option<u8>> = Vec::new();
    for record in records.iter().filter(|record| record.write) {
        if !banks.contains(&record.bank) {
            banks.push(record.bank);
        }
    }
    for bank in banks {
        for (how, what) in [
            (Written::Yes, "written"),
            (Written::No, "not written"),
            (Written::Unknown, "not known whether written"),
        ] {
            let these = records
                .iter()
                .filter(|record| record.write && record.bank == bank && record.written() == how);
            let these = reg::list(these.map(|record| record.address));
            match bank {
                _ if these.is_empty() => {}
                Some(bank) => note(format_args!("{what}: {these} in bank {bank}")),
                None => note(format_args!("{what}: {these}")),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_follows_each_other_goes_in_one_sequence() {
        let assigns = |text: &str| -> Vec<Assign> {
            text.split(' ').map(|word| word.parse().unwrap()).collect()
        };
        for (text, wanted) in [
            ("1=1 2=2 3=3,4 5=5", "1=1,2,3,4,5"),
            ("1=1 3=3", "1=1 3=3"),
            ("2=2 1=1", "2=2 1=1"),
            ("1=1 1=2", "1=1 1=2"),
            ("0x3f=1 0x40=2 0x41=3", "0x3f=1 0x40=2,3"),
        ] {
            assert_eq!(joined(&assigns(text)), assigns(wanted), "{text}");
        }
    }
}
