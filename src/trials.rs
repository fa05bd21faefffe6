//! Frames that are read for their cause alone, when those of a run have left it open.

use crate::diagnose::{Evidence, Trial};
use crate::frame::BissC;
use crate::link::{Error, Link};
use crate::master::{Master, Slot};

/// A clock at which so many frames of a trial are bad is no better one.
const MOST_BAD: u32 = 2;

/// Runs all trials that `evidence` asks for, until one has decided or `stop` says so, and leaves the clock as it was.
///
/// # Errors
/// When the link fails.
pub fn run(
    link: &mut dyn Link,
    protocol: &BissC,
    evidence: &mut Evidence,
    stop: &dyn Fn() -> bool,
) -> Result<(), Error> {
    if !link.caps().live {
        return Ok(());
    }
    let before = link.clock().hz;
    let mut moved = false;
    while let Some(trial) = evidence.next_trial().filter(|_| !stop()) {
        if let Some(hz) = trial.clock {
            moved = true;
            // Some devices cannot run at any clock.
            if link.set_clock(hz).is_err() {
                continue;
            }
        }
        if trial.upside_down {
            if link.turn_ma(true)? {
                let result = one(link, protocol, evidence, &trial, stop);
                // However it went, MA rests high again.
                link.turn_ma(false)?;
                result?;
            }
            continue;
        }
        one(link, protocol, evidence, &trial, stop)?;
    }
    if moved {
        link.set_clock(before)?;
    }
    Ok(())
}

fn one(
    link: &mut dyn Link,
    protocol: &BissC,
    evidence: &mut Evidence,
    trial: &Trial,
    stop: &dyn Fn() -> bool,
) -> Result<(), Error> {
    let protocol = BissC {
        surplus: trial.surplus.or(protocol.surplus),
        ..protocol.clone()
    };
    let mut master = Master::new(link, &protocol, Some(0));
    master.stop_when(stop);
    master.open()?;
    let (mut good, mut bad) = (0, 0);
    while good + bad < trial.frames && !stop() {
        if !matches!(master.slot(0, None)?, Slot::Done { .. }) {
            break;
        }
        if trial.surplus.is_some() {
            evidence.show(master.trace());
        }
        good += u32::from(master.cycle().is_good());
        bad += u32::from(!master.cycle().is_good());
        if (trial.clock.is_some() || trial.upside_down) && bad > MOST_BAD {
            break;
        }
    }
    let hz = master.link().clock().hz;
    evidence.tried(trial, hz, good);
    Ok(())
}
