//! What a recording shows of registers and commands: its frames carry the talk of somebody else's master.

use crate::output::heard::Overheard;
use crate::output::reg::{Bad, whom};
use biss::control::{Failure, Heard, Listener, MAX_IDS, Spoken};
use biss::cycle::{Cycle, Fault};
use biss::trace::Trace;

/// Listens to the frames of a recording, whoever reads them.
#[derive(Debug, Default)]
pub(super) struct Eavesdropper {
    listener: Listener,
}

impl Eavesdropper {
    /// The next frame, and what was said when it was over. A channel with a wrong CRC is a whole frame: CDS and what it
    /// carries have checks of their own.
    pub(super) fn frame(&mut self, seq: u64, trace: &Trace, cycle: &Cycle) -> Option<Overheard> {
        let fault = cycle.fault();
        let heard = match (fault, cycle.head(), trace.cdm) {
            (None, Some(head), Some(cdm)) => self.listener.frame(trace.t_ns, cdm, head.cds),
            _ => self.listener.lost(),
        };
        heard.map(|heard| Overheard {
            seq,
            bad: verdict(&heard, fault),
            heard,
        })
    }

    /// A frame is missing, or all that come: what was under way is over. `seq` is that of the last frame.
    pub(super) fn lost(&mut self, seq: u64, why: &str) -> Option<Overheard> {
        self.listener.lost().map(|heard| Overheard {
            seq,
            bad: Some(match heard.failure() {
                Some(Failure::Undecided) | None => Bad::new(Failure::Undecided, None),
                Some(failure) => Bad::said(failure.name(), why),
            }),
            heard,
        })
    }
}

/// What is wrong with it, as a master that checks everything would say.
fn verdict(heard: &Heard, fault: Option<Fault>) -> Option<Bad> {
    match (heard.spoken, heard.failure()) {
        (Spoken::BadHeader { .. }, _) => Some(Bad::said(
            "header-crc",
            "the header does not fit its CRC: a bit error, or the master has given it up",
        )),
        (
            Spoken::Command {
                slaves,
                acknowledged,
                executed: true,
                ..
            },
            Some(failure @ Failure::Acknowledge { .. }),
        ) => Some(Bad::said(
            failure.name(),
            format!(
                "acknowledged by {}, it was for {}, and executed all the same",
                who(acknowledged),
                who(slaves)
            ),
        )),
        (
            Spoken::Command {
                executed: false, ..
            },
            None,
        ) => Some(Bad::said(
            "not-executed",
            "the master did not send the bit that executes it",
        )),
        // Nothing is wrong with the byte, but nobody should have sent it.
        (Spoken::Read { value, .. } | Spoken::Written { value, .. }, Some(failure)) => {
            Some(Bad::said(
                failure.name(),
                format!("{failure}; {value:#04x} came with a good CRC all the same"),
            ))
        }
        (_, failure) => failure.map(|failure| Bad::new(failure, fault)),
    }
}

fn who(bits: u8) -> String {
    let list: Vec<u8> = (0..MAX_IDS).filter(|id| bits >> id & 1 == 1).collect();
    match list.is_empty() {
        true => "no slave".into(),
        false => whom(&list),
    }
}
