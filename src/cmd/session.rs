//! Talking to slaves: the line, the master and the signals that end it, for all commands that do more than listen.

use super::line::{self, Line};
use super::{Ended, Outcome, schedule};
use crate::cli;
use crate::output::note;
use crate::sys::Signals;
use anyhow::{Result, anyhow, bail};
use biss::control::Failure;
use biss::cycle::Fault;
use biss::format::Format;
use biss::frame::{BissC, Stall};
use biss::link::{Kind, Link, Spec};
use biss::master::Master;
use biss::registers::{BANK_SELECT, Trouble};
use std::cell::Cell;
use std::rc::Rc;
use std::time::{Duration, Instant};

/// An open line to slaves that can be talked to. Of the frames on it the head is read only, so their format need not be
/// known.
pub(super) struct Session<'w> {
    wire: &'w cli::Wire,
    /// Of control frames.
    retries: u32,
    signals: Signals,
    hold: Hold,
    stop: Box<dyn Fn() -> bool>,
    link: Box<dyn Link>,
    protocol: BissC,
}

impl Session<'_> {
    /// Opens the line.
    ///
    /// # Errors
    /// When the machine fails, or nothing can be sent over such a link.
    pub(super) fn open(wire: &cli::Wire, retries: u32) -> Result<Session<'_>> {
        can_send(&wire.link)?;
        schedule(wire.cpu, wire.rt)?;
        let signals = Signals::catch().map_err(|e| {
            anyhow!("catching signals: {e}\n  is a limit of this process used up (`ulimit -a`)?")
        })?;
        let line = Line::of(wire, None);
        let link = line.open(&signals, || {})?;
        let hold = Hold::default();
        let (caught, held) = (signals.watch(), hold.clone());
        Ok(Session {
            wire,
            retries,
            signals,
            hold,
            stop: Box::new(move || caught() && !held.bears()),
            link,
            protocol: BissC {
                head_only: true,
                ..line.protocol(Format::default())
            },
        })
    }

    /// The master over it, once an encoder has answered.
    ///
    /// # Errors
    /// When none does, the machine fails, or it is time to end.
    pub(super) fn master(&mut self) -> Result<Master<'_>, Trouble> {
        /// One bad frame, where it is the last one, is no absent encoder.
        const ATTEMPTS: u32 = 4;
        let mut master = Master::new(self.link.as_mut(), &self.protocol, None);
        master.set_access_retries(self.retries);
        master.stop_when(&self.stop);
        for _ in 0..ATTEMPTS {
            let answers = master.open()?;
            if master.stops() {
                return Err(Trouble::Stopped);
            }
            if answers {
                say_how(self.wire, &self.protocol, &master);
                return Ok(master);
            }
        }
        Err(Trouble::Slave {
            failure: Failure::Cut,
            fault: master.cycle().fault(),
        })
    }

    /// How heads of frames are read.
    pub(super) fn protocol(&self) -> &BissC {
        &self.protocol
    }

    /// The link, and what says that it is time to end.
    pub(super) fn parts(&mut self) -> (&mut dyn Link, &dyn Fn() -> bool) {
        (self.link.as_mut(), &self.stop)
    }

    /// The link and the signals, to read whole frames.
    pub(super) fn into_parts(self) -> (Box<dyn Link>, Signals) {
        (self.link, self.signals)
    }

    /// A child that is waited for is given up for a signal: no failure of the machine.
    fn gave_up(&self) -> bool {
        self.signals.caught().is_some() && matches!(self.wire.link.kind, Kind::Exec(_))
    }

    /// Keeps signals waiting.
    pub(super) fn hold(&self) -> Hold {
        self.hold.clone()
    }

    /// The end of the command.
    pub(super) fn end(&self, outcome: Outcome) -> Ended {
        Ended {
            outcome,
            signal: self.signals.caught(),
        }
    }

    /// The end of the command because of a trouble, which is told.
    ///
    /// # Errors
    /// When it is the machine's.
    pub(super) fn fail(&self, doing: &str, trouble: Trouble) -> Result<Ended> {
        match trouble {
            Trouble::Link(_) if self.gave_up() => note(format_args!("{doing}: stopped")),
            Trouble::Link(error) => return Err(error.into()),
            Trouble::Slave { failure, fault } => note(explain(doing, failure, fault)),
            Trouble::Stopped => note(format_args!("{doing}: stopped")),
        }
        Ok(self.end(Outcome::Bad))
    }
}

/// While somebody holds it signals wait, as an access that is ended in the middle leaves behind what nobody knows of. Not
/// for ever: with enough --retries an access may never end.
#[derive(Clone, Debug, Default)]
pub(super) struct Hold(Rc<Held>);

#[derive(Debug, Default)]
struct Held {
    holders: Cell<u32>,
    /// When a signal was first seen to wait.
    since: Cell<Option<Instant>>,
}

/// Longer than 64 registers take, each with the longest processing time there is.
const PATIENCE: Duration = Duration::from_secs(2);

impl Hold {
    /// Does something that no signal shall end.
    pub(super) fn during<T>(&self, work: impl FnOnce() -> T) -> T {
        let holders = &self.0.holders;
        holders.set(holders.get() + 1);
        let result = work();
        holders.set(holders.get() - 1);
        result
    }

    /// Whether a signal that has come has to wait.
    fn bears(&self) -> bool {
        if self.0.holders.get() == 0 {
            return false;
        }
        let since = self.0.since.get().unwrap_or_else(Instant::now);
        self.0.since.set(Some(since));
        since.elapsed() < PATIENCE
    }
}

/// Whether CDM can be sent over such a link at all.
pub(super) fn can_send(link: &Spec) -> Result<()> {
    match &link.kind {
        Kind::File { .. } => bail!(
            "nothing can be sent into a recording\n  name the link that the encoder is on; `biss read` reads recordings"
        ),
        Kind::Spi { path, .. } => {
            let device = path.display().to_string();
            let device = device.trim_start_matches("/dev/spidev");
            bail!(
                "an spi link cannot talk to registers: SCLK always rests high, and CDM = 1 is MA held low after a frame\n  \
                 connect MA to MOSI and take wave:{device}, or MA and SLO to two GPIO lines and take gpio:"
            )
        }
        Kind::Gpio { .. } | Kind::Wave { .. } | Kind::Sim { .. } | Kind::Exec(_) => Ok(()),
    }
}

/// What the user should know about the line, and what he has asked to know.
fn say_how(wire: &cli::Wire, protocol: &BissC, master: &Master) {
    if wire.quiet {
        return;
    }
    let clock = master.link().clock();
    line::unreached(clock, wire.clock).iter().for_each(note);
    line::too_slow(clock).iter().for_each(note);
    if master.link().caps().times_levels && protocol.stall == Stall::Unknown {
        line::stalls(clock).iter().for_each(note);
    }
    if wire.verbose {
        note(format_args!("clock {clock}"));
        master.link().notes().iter().for_each(note);
    }
}

/// What [`Session::master`] does first.
pub(super) const LOOKING: &str = "looking for an encoder";

/// What was being done, what the slave did, and what to try.
pub(super) fn explain(doing: &str, failure: Failure, fault: Option<Fault>) -> String {
    let said = match (failure, fault) {
        (Failure::Cut, Some(fault)) if doing == LOOKING => format!("none answers: {fault}"),
        (failure, Some(fault)) => format!("{failure}: {fault}"),
        (failure, None) => failure.to_string(),
    };
    format!("{doing}: {said}\n  {}", advice(failure, fault))
}

/// Whether there is an encoder at all.
fn answers(fault: Fault) -> bool {
    !matches!(
        fault,
        Fault::NoAck { .. } | Fault::NoStart { .. } | Fault::NotReady { .. }
    )
}

fn advice(failure: Failure, fault: Option<Fault>) -> &'static str {
    match failure {
        Failure::Unheard => {
            "an encoder that only sends (BiSS-C unidirectional) has no registers for us; else its control communication may be \
             switched off: `biss command LINK activate-control --broadcast`"
        }
        Failure::Absent { .. } => {
            "IDs count from the slave farthest away; a slave whose control communication is off takes none: \
             `biss command LINK activate-control --broadcast`"
        }
        Failure::Garbled { .. } => {
            "bits are lost on the line, or slaves disagree: try a slower -c, check termination and ground"
        }
        Failure::Refused {
            address: BANK_SELECT,
        } => "a slave without register 0x40 has only one bank: leave --bank out",
        Failure::ReadBack {
            address: BANK_SELECT,
            ..
        } => {
            "the slave does not select that bank: it has none of that number, or is locked; the data sheet knows"
        }
        Failure::Refused { .. } => {
            "it is not there, or not for this purpose: read-only, write-only or locked; the data sheet knows"
        }
        Failure::Silent { .. } => {
            "registers that take longer than 20 ms are outside BiSS-C; older slaves refuse so; the data sheet knows"
        }
        Failure::NoReaction { .. }
        | Failure::Strange { .. }
        | Failure::DataCrc { .. }
        | Failure::Echo { .. }
        | Failure::Unsteady { .. }
        | Failure::OutOfStep => {
            "bits are lost on the line: try a slower -c, more --retries, check termination and ground"
        }
        Failure::NotEchoed { .. } => {
            "older slaves refuse a write so: the register is not there, or read-only; else bits are lost: try a slower -c"
        }
        Failure::Acknowledge { .. } => {
            "a slave that does not know the command does not acknowledge it; --unchecked executes it all the same"
        }
        Failure::ReadBack { .. } => {
            "a command or status register need not keep what is written: --unchecked does not look; else the data sheet knows \
             what locks it"
        }
        Failure::Undecided => "look at what the command changes before it is sent again",
        Failure::Cut => match fault {
            Some(Fault::Stalled { .. }) => {
                "the machine was too slow for the encoder: try another -c, --rt 50, or --timeout if the data sheet says more"
            }
            Some(fault) if !answers(fault) => {
                "check power, wiring and the polarity of the pairs; `biss read LINK` shows what comes"
            }
            _ => "try a slower -c, check the wiring; `biss read LINK` shows what comes",
        },
    }
}
