//! A logic analyser on the wires between the program's own master and the simulated slave.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used)]

use biss::control::{Access, Outcome};
use biss::frame::BissC;
use biss::link::bitbang::{Bang, Pins};
use biss::link::sim::SimPins;
use biss::link::{Error, Link};
use biss::master::Master;
use biss::slave::Config;
use biss::unit::Hertz;
use std::fmt::Write;

/// How long the master takes to see SL. Where MA is let go within a sample of eight a clock from where SL rises nobody can tell
/// whether SL rose for that edge.
const READ_NS: u64 = 400;

pub struct Recorder {
    pins: SimPins,
    text: String,
    t_ns: u64,
    ma: bool,
    slo: bool,
}

impl Recorder {
    pub fn new(config: &str) -> Recorder {
        let config: Config = config.parse().unwrap_or_else(|e| panic!("{config}: {e}"));
        let mut pins = SimPins::new(config);
        let slo = pins.slave_mut().slo(0);
        let text = "$timescale 1 ns $end\n$scope module bench $end\n$var wire 1 m MA $end\n\
                    $var wire 1 s SLO $end\n$upscope $end\n$enddefinitions $end\n";
        let mut recorder = Recorder {
            pins,
            text: text.into(),
            t_ns: u64::MAX,
            ma: true,
            slo,
        };
        recorder.put(0, 'm', true);
        recorder.put(0, 's', slo);
        recorder
    }

    fn put(&mut self, t_ns: u64, id: char, level: bool) {
        if t_ns != self.t_ns {
            self.t_ns = t_ns;
            writeln!(self.text, "#{t_ns}").unwrap();
        }
        writeln!(self.text, "{}{id}", u8::from(level)).unwrap();
    }

    fn look(&mut self, t_ns: u64) {
        let slo = self.pins.slave_mut().slo(t_ns);
        if slo != self.slo {
            self.slo = slo;
            self.put(t_ns, 's', slo);
        }
    }
}

impl Pins for Recorder {
    fn ma(&mut self, high: bool) -> Result<(), Error> {
        let now = self.pins.now_ns();
        self.pins.ma(high)?;
        if high != self.ma {
            self.ma = high;
            self.put(now, 'm', high);
        }
        self.look(now);
        Ok(())
    }

    fn sl(&mut self) -> Result<bool, Error> {
        self.until(self.pins.now_ns() + READ_NS);
        self.pins.sl()
    }

    fn now_ns(&self) -> u64 {
        self.pins.now_ns()
    }

    fn until(&mut self, ns: u64) {
        while let Some(at) = self.pins.slave().next_change().filter(|at| *at <= ns) {
            self.look(at);
        }
        self.pins.until(ns);
    }

    fn cost_ns(&self) -> (u64, u64) {
        (0, READ_NS)
    }

    fn virtual_time(&self) -> bool {
        true
    }
}

/// What the program's master came to with these accesses, one after the other, and the recording of all of it. `pause` frames
/// run behind each.
pub fn recorded(config: &str, accesses: &[Access], pause: usize) -> (Vec<Outcome>, String) {
    let parsed: Config = config.parse().unwrap_or_else(|e| panic!("{config}: {e}"));
    let mut link = Bang::new(Recorder::new(config));
    link.set_clock(Hertz(1_000_000)).unwrap();
    link.idle(50_000).unwrap();
    let protocol = BissC::new(parsed.format);
    let mut master = Master::new(&mut link, &protocol, Some(0));
    let mut outcomes = Vec::new();
    let frames = |master: &mut Master<'_>, count: usize| {
        for _ in 0..count {
            master.slot(0, None).unwrap();
        }
    };
    frames(&mut master, 2);
    for access in accesses {
        master.ask(*access).unwrap();
        let outcome = loop {
            frames(&mut master, 1);
            if let Some(outcome) = master.outcome() {
                break outcome;
            }
        };
        outcomes.push(outcome);
        frames(&mut master, pause);
    }
    drop(master);
    link.idle(100_000).unwrap();
    (outcomes, std::mem::take(&mut link.pins_mut().text))
}

/// The recording of a master that sends these CDM bits behind 16 frames of rest, whatever the slave says.
pub fn dictated(config: &str, cdm: &str) -> String {
    const HALF_NS: u64 = 500;
    let parsed: Config = config.parse().unwrap_or_else(|e| panic!("{config}: {e}"));
    let clocks = 5 + parsed.format.bits();
    let mut wires = Recorder::new(config);
    let wait = |wires: &mut Recorder, ns: u64| wires.until(wires.now_ns() + ns);
    wait(&mut wires, 100_000);
    for bit in "0000000000000000".chars().chain(cdm.chars()) {
        for _ in 0..clocks {
            for level in [false, true] {
                wires.ma(level).unwrap();
                wait(&mut wires, HALF_NS);
            }
        }
        wires.ma(bit == '0').unwrap();
        wait(&mut wires, 45_000);
        wires.ma(true).unwrap();
        wait(&mut wires, 2 * HALF_NS);
    }
    wait(&mut wires, 100_000);
    wires.text
}
