//! Who is on the line and what they send: the slaves' registers say, live frames decide.

use super::session::{LOOKING, Session};
use super::{Ended, Outcome};
use crate::cli;
use crate::output::info::Shape;
use crate::output::note;
use crate::sys::Signals;
use anyhow::Result;
use biss::format::Format;
use biss::frame::BissC;
use biss::identify::{self, Bus, Trial};
use biss::identity::{self, Candidate, Known, Limit};
use biss::link::Link;
use biss::master::Master;
use biss::preset::Frame;
use biss::registers::{Registers, Trouble};

/// What was found.
pub(super) struct Found {
    pub(super) bus: Bus,
    /// Formats that the registers suggest.
    pub(super) candidates: Vec<Candidate>,
    /// What live frames said to each.
    pub(super) trials: Vec<Option<Trial>>,
}

/// What the slaves on a line send, and the line.
pub(super) struct Answer {
    pub(super) frame: Frame,
    /// The slave of each channel.
    pub(super) slaves: Vec<u8>,
    pub(super) link: Box<dyn Link>,
    pub(super) signals: Signals,
}

/// `-f auto`: asks the slaves what they send, and says why that is believed. No answer ends the command.
///
/// # Errors
/// When the machine fails.
pub(super) fn ask_frame(wire: &cli::Wire) -> Result<Result<Answer, Ended>> {
    let mut session = Session::open(wire, biss::control::RETRIES)?;
    let found = match Found::on(&mut session, true) {
        Ok(found) => found,
        Err((doing, trouble)) => return session.fail(doing, trouble).map(Err),
    };
    let index = match found.format() {
        Ok(index) => index,
        Err(unknown) => {
            note(unknown.explain(&found.candidates));
            return Ok(Err(session.end(Outcome::Bad)));
        }
    };
    let candidate = &found.candidates[index];
    if !wire.quiet {
        let why = std::iter::once(candidate.reason.as_str());
        let why: Vec<&str> = why.chain(found.doubts(index)).collect();
        note(format_args!(
            "-f {}\n  {}",
            candidate.format,
            why.join("\n  ")
        ));
    }
    let frame = Frame {
        format: candidate.format.clone(),
        preset: None,
    };
    let slaves = candidate.slaves.clone();
    let (link, signals) = session.into_parts();
    Ok(Ok(Answer {
        frame,
        slaves,
        link,
        signals,
    }))
}

/// Why no format was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Unknown {
    /// The registers of these slaves do not say what they send.
    Unsaid(Vec<u8>),
    /// There are slaves without an ID, so nobody knows what all of them send.
    TooMany,
    /// Live frames contradict what the registers say.
    Contradicted,
    /// Several formats pass, and the position does not move enough to tell them apart.
    Ambiguous(Vec<usize>),
    /// What the registers say has no CRC that frames could confirm.
    Unconfirmed,
}

impl Found {
    /// Asks everybody, then tries what they say. A trouble comes with what was being done.
    pub(super) fn on(
        session: &mut Session<'_>,
        write: bool,
    ) -> Result<Found, (&'static str, Trouble)> {
        let bus = {
            let mut master = session.master().map_err(|trouble| (LOOKING, trouble))?;
            ask(&mut master, write)
                .map_err(|trouble| ("asking the slaves who they are", trouble))?
        };
        Found::of(session, bus).map_err(|trouble| ("trying what the slaves say", trouble))
    }

    /// Tries what the slaves say.
    fn of(session: &mut Session<'_>, bus: Bus) -> Result<Found, Trouble> {
        let candidates = match bus.present {
            9.. => Vec::new(),
            _ => identity::candidates(&bus.devices),
        };
        let heads = session.protocol().clone();
        let protocol = |format: Format| BissC {
            format,
            head_only: false,
            ..heads.clone()
        };
        let (link, stop) = session.parts();
        let trials = identify::prove(link, &candidates, &protocol, stop)?;
        if stop() {
            return Err(Trouble::Stopped);
        }
        Ok(Found {
            bus,
            candidates,
            trials,
        })
    }

    /// The one format that fits, or why there is none.
    pub(super) fn format(&self) -> Result<usize, Unknown> {
        let passing = identify::different(&self.candidates, &self.trials);
        match passing[..] {
            [only] => Ok(only),
            [] => Err(self.why_none()),
            _ => Err(Unknown::Ambiguous(passing)),
        }
    }

    /// What frames have not shown about a format that fits.
    pub(super) fn doubts(&self, index: usize) -> Vec<&'static str> {
        const STILL: &str = "all frames carried the same data, which a wrong format fits too, 1 in 64 with CRC-6: move the encoder and ask again";
        let alike = self.trials[index].is_some_and(|trial| trial.alike);
        let doubts = self.candidates[index].doubts.iter().copied();
        doubts.chain(alike.then_some(STILL)).collect()
    }

    /// What limits clock and times on this line: of each slave, and every one only once.
    fn limits(&self) -> Vec<Limit> {
        let mut limits: Vec<Limit> = Vec::new();
        for limit in self.bus.devices.iter().flat_map(Known::limits) {
            if !limits.contains(&limit) {
                limits.push(limit);
            }
        }
        limits
    }

    fn why_none(&self) -> Unknown {
        if self.bus.present > 8 {
            return Unknown::TooMany;
        }
        if self.candidates.is_empty() {
            return Unknown::Unsaid(identity::unexplained(&self.bus.devices));
        }
        match self.trials.iter().any(Option::is_some) {
            true => Unknown::Contradicted,
            false => Unknown::Unconfirmed,
        }
    }

    /// Everything for output.
    pub(super) fn shape(&self) -> Shape<'_> {
        let chosen = self.format().ok();
        Shape {
            present: self.bus.present,
            devices: &self.bus.devices,
            left_out: &self.bus.left_out,
            failed: &self.bus.failed,
            candidates: &self.candidates,
            trials: &self.trials,
            chosen,
            doubts: chosen.map(|index| self.doubts(index)).unwrap_or_default(),
            limits: self.limits(),
        }
    }
}

fn ask(master: &mut Master<'_>, write: bool) -> Result<Bus, Trouble> {
    master.reset_bus()?;
    identify::ask(&mut Registers::new(master), write)
}

impl Unknown {
    /// What is wrong, and what to try.
    pub(super) fn explain(&self, candidates: &[Candidate]) -> String {
        const ELSE: &str = "the data sheet says what it sends: give that with -f";
        match self {
            Unknown::Unsaid(slaves) => {
                let ids: Vec<String> = slaves.iter().map(ToString::to_string).collect();
                format!(
                    "the registers of slave {} do not say what it sends\n  {ELSE}",
                    ids.join(", ")
                )
            }
            Unknown::TooMany => format!(
                "there are more than eight slaves, and those without an ID cannot be asked\n  \
                 switch the control communication of some off: `biss command LINK deactivate-control --slave 0,1`, or\n  {ELSE}"
            ),
            Unknown::Contradicted => format!(
                "no frame fits what the registers say: {}\n  try a slower -c; `biss info` shows what was tried; {ELSE}",
                candidates[0].format
            ),
            Unknown::Ambiguous(passing) => {
                let formats: Vec<String> = passing
                    .iter()
                    .map(|index| candidates[*index].format.to_string())
                    .collect();
                format!(
                    "several formats fit all frames: {}\n  move the encoder while it is being asked, or say which with -f",
                    formats.join(" and ")
                )
            }
            Unknown::Unconfirmed => format!(
                "what the registers say has no CRC, so no frame can confirm it: {}\n  {ELSE}",
                candidates[0].format
            ),
        }
    }
}
