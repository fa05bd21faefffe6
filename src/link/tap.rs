//! A look at both wires of a link while something else runs it: of every cycle, those that are repeated and those that learn
//! about the encoder too, and of what is between them.

use super::{Caps, Clock, Error, Link, Phase};
use crate::trace::{Ask, Trace};
use crate::unit::Hertz;
use crate::waveform::{Change, Waveform};

/// A link, and the changes on its wires since [`Tap::begin`] that nobody has taken yet.
pub struct Tap {
    link: Box<dyn Link>,
    wave: Waveform,
    on: bool,
}

impl Tap {
    /// Passes everything on and keeps nothing yet.
    pub fn new(link: Box<dyn Link>) -> Tap {
        Tap {
            link,
            wave: Waveform::default(),
            on: false,
        }
    }

    /// Keeps the changes from now on; the levels as they are come first.
    ///
    /// # Errors
    /// When SL cannot be read.
    pub fn begin(&mut self) -> Result<(), Error> {
        self.on = true;
        self.link.waveform(&mut self.wave)
    }

    /// Takes the changes so far, in order of time. Without [`Link::waveform`] what came after the last cycle is missing.
    pub fn take(&mut self) -> impl Iterator<Item = Change> + '_ {
        self.wave.changes.drain(..)
    }

    fn keep(&mut self, out: &[Trace]) {
        for wave in out.iter().filter_map(|trace| trace.wave.as_deref()) {
            for change in &wave.changes {
                self.wave.note(change.t_ns, change.ma, change.slo);
            }
        }
    }
}

impl std::fmt::Debug for Tap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Tap")
            .field("on", &self.on)
            .finish_non_exhaustive()
    }
}

impl Link for Tap {
    fn caps(&self) -> Caps {
        self.link.caps()
    }
    fn now_ns(&self) -> u64 {
        self.link.now_ns()
    }
    fn clock(&self) -> Clock {
        self.link.clock()
    }
    fn set_clock(&mut self, hz: Hertz) -> Result<Clock, Error> {
        self.link.set_clock(hz)
    }
    fn measure_clock(&mut self) -> Result<Clock, Error> {
        self.link.measure_clock()
    }
    fn set_phase(&mut self, phase: Phase) -> Result<(), Error> {
        self.link.set_phase(phase)
    }
    fn idle(&mut self, ns: u64) -> Result<Option<bool>, Error> {
        self.link.idle(ns)
    }
    fn cycles(&mut self, asks: &[Ask], out: &mut [Trace]) -> Result<usize, Error> {
        if !self.on {
            return self.link.cycles(asks, out);
        }
        // What is left in there from before belongs to nobody.
        for trace in out.iter_mut() {
            trace.wave.get_or_insert_default().clear();
        }
        let ran = self.link.cycles(asks, out);
        self.keep(out);
        ran
    }
    fn ahead(&mut self, index: usize, trace: &mut Trace) -> bool {
        self.link.ahead(index, trace)
    }
    fn waveform(&mut self, wave: &mut Waveform) -> Result<(), Error> {
        let from = wave.changes.len();
        self.link.waveform(wave)?;
        for change in &wave.changes[from..] {
            self.wave.note(change.t_ns, change.ma, change.slo);
        }
        Ok(())
    }
    fn notes(&self) -> Vec<String> {
        self.link.notes()
    }
    fn advice(&self, any_good: bool) -> Option<String> {
        self.link.advice(any_good)
    }
}
