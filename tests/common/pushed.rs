//! Waveforms read without a file between.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used)]

use biss::frame::BissC;
use biss::link::{Caps, Clock, Error, Known, Link};
use biss::master::{Master, Slot};
use biss::slice::Slicer;
use biss::trace::{Ask, Trace};
use biss::unit::Hertz;

/// A slicer as a link.
pub struct Pushed(pub Slicer);

impl Link for Pushed {
    fn caps(&self) -> Caps {
        Caps {
            live: false,
            reacts: false,
            cdm: false,
            sees_idle: true,
            times_levels: true,
            phases: &[],
            virtual_time: true,
            burst: 1,
        }
    }
    fn now_ns(&self) -> u64 {
        0
    }
    fn clock(&self) -> Clock {
        Clock {
            hz: Hertz(0),
            known: Known::Measured,
        }
    }
    fn set_clock(&mut self, _: Hertz) -> Result<Clock, Error> {
        Ok(self.clock())
    }
    fn idle(&mut self, _: u64) -> Result<Option<bool>, Error> {
        Ok(None)
    }
    fn cycles(&mut self, _: &[Ask], out: &mut [Trace]) -> Result<usize, Error> {
        Ok(usize::from(self.0.take(&mut out[0])))
    }
}

/// The words of each good frame.
pub type Words = Vec<Vec<u64>>;

/// The good frames of a recording, and what else there is.
pub fn all_frames(link: &mut dyn Link, protocol: &BissC) -> (Words, Vec<String>) {
    let mut master = Master::new(link, protocol, None);
    master.open().unwrap();
    let (mut words, mut others) = (Vec::new(), Vec::new());
    loop {
        match master.slot(0, None).unwrap() {
            Slot::Ended => return (words, others),
            Slot::Piece(cut) => {
                others.push(format!("{cut:?}: {}", shown(master.trace())));
                continue;
            }
            Slot::Done { .. } => {}
        }
        match good(&master) {
            Some(good) => words.push(good),
            None => {
                let fault = master.cycle().fault();
                others.push(format!("{fault:?}: {}", shown(master.trace())));
            }
        }
    }
}

/// The words of the last cycle, if all is well with it.
pub fn good(master: &Master) -> Option<Vec<u64>> {
    let cycle = master.cycle();
    let words = cycle.words().iter().map(|word| word.good());
    words
        .collect::<Option<Vec<u64>>>()
        .filter(|_| cycle.is_good())
}

fn shown(trace: &Trace) -> String {
    format!(
        "{} {} {:?} {:?} {:?}",
        trace.t_ns, trace.bits, trace.longest, trace.delay_ns, trace.ready_ns
    )
}
