//! `biss command`: slaves are told to do something.

use super::session::{LOOKING, Session, explain};
use super::{Ended, Outcome};
use crate::cli;
use crate::output::{note, reg};
use anyhow::{Result, bail};
use biss::control::{Access, Failure, MAX_IDS};
use biss::registers::{Registers, Trouble};

/// Slaves that take no ID (D2, p. 19).
const DEACTIVATE_CONTROL: u8 = 0b01;
/// As a broadcast.
const DEACTIVATE_DATA: u8 = 0b00;

pub(crate) fn run(args: cli::Send) -> Result<Ended> {
    fits(&args)?;
    let slaves = args.slave.iter().fold(0u8, |all, id| all | 1 << id);
    let access = Access::Command {
        slaves,
        code: args.code.code,
        checked: !args.broadcast && !args.unchecked,
        reduced: args.reduced,
    };
    let mut session = Session::open(&args.wire, args.stubborn.retries)?;
    let (ended, effort) = send(&mut session, access)?;
    let record = reg::Command {
        slaves: ids(slaves),
        code: args.code.code,
        acknowledged: acknowledged(access, &ended),
        bad: ended.as_ref().err().map(reg::Bad::of),
    };
    super::deliver(&record.render(args.format)?)?;
    let looking = effort.is_none();
    super::sum_up(&args.wire, args.format, effort, ended.is_ok());
    let doing = format!(
        "sending command {:02b} to {}",
        args.code.code,
        reg::whom(&record.slaves)
    );
    let doing = if looking { LOOKING } else { &doing };
    match ended {
        Ok(()) => {
            if !args.wire.quiet {
                aftermath(&args, &record.slaves).iter().for_each(note);
            }
            Ok(session.end(Outcome::Good))
        }
        Err(Trouble::Slave { failure, fault }) => {
            if !args.wire.quiet {
                note(explain(doing, failure, fault));
            }
            Ok(session.end(Outcome::Bad))
        }
        Err(trouble) => session.fail(doing, trouble),
    }
}

/// A name belongs to one of the two ways of addressing.
fn fits(args: &cli::Send) -> Result<()> {
    match args.code.named {
        Some((name, true)) if !args.broadcast => {
            bail!("{name} is a broadcast\n  say --broadcast instead of --slave")
        }
        Some((name, false)) if args.broadcast => {
            bail!("{name} is for slaves, and not a broadcast\n  say --slave instead of --broadcast")
        }
        _ => Ok(()),
    }
}

type Sent = (Result<(), Trouble>, Option<reg::Effort>);

/// Sends it. Once it is under way no signal ends it: whether it was executed would be known to nobody.
fn send(session: &mut Session, access: Access) -> Result<Sent> {
    let hold = session.hold();
    let mut master = match session.master() {
        Ok(master) => master,
        Err(trouble) => return Ok((Err(trouble), None)),
    };
    let late = !master.link().caps().reacts;
    if let Err(said) = access.check(late) {
        bail!("{said}\n  --unchecked executes it whoever acknowledges it");
    }
    let Access::Command {
        slaves,
        code,
        checked,
        reduced,
    } = access
    else {
        return Ok((Ok(()), None));
    };
    let mut registers = Registers::new(&mut master);
    let ended = hold.during(|| registers.command(slaves, code, checked, reduced));
    let effort = reg::Effort {
        registers: None,
        frames: registers.frames(),
        retries: registers.retries(),
    };
    let rested = hold.during(|| registers.rest());
    Ok((ended.map(drop).and(rested), Some(effort)))
}

fn ids(bits: u8) -> Vec<u8> {
    (0..MAX_IDS).filter(|id| bits >> id & 1 == 1).collect()
}

/// Who has acknowledged it, where that is known.
fn acknowledged(access: Access, ended: &Result<(), Trouble>) -> Option<Vec<u8>> {
    let Access::Command {
        slaves,
        checked: true,
        ..
    } = access
    else {
        return None;
    };
    match ended {
        Ok(()) => Some(ids(slaves)),
        Err(Trouble::Slave {
            failure: Failure::Acknowledge { got, .. },
            ..
        }) => Some(ids(*got)),
        Err(_) => None,
    }
}

/// What will surprise whoever does not know it.
fn aftermath(args: &cli::Send, slaves: &[u8]) -> Option<String> {
    let whom = reg::whom(slaves);
    match (args.broadcast, args.code.code) {
        (false, DEACTIVATE_CONTROL) => Some(format!(
            "{whom} takes no ID any more, and those nearer move up: `biss command LINK activate-control --broadcast` ends that"
        )),
        (true, DEACTIVATE_DATA) => Some(
            "no data channel sends any more: `biss command LINK activate-data --slave ID,…` ends that".into(),
        ),
        _ => None,
    }
}
