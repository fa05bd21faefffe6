//! A link that plans its clocks, as spidev, to a simulated slave.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used)]

use biss::link::bitbang::Pins;
use biss::link::sim::SimPins;
use biss::link::{Caps, Clock, Error, Known, Link, Phase};
use biss::trace::{Ask, Trace, Until};
use biss::unit::Hertz;
use std::cell::RefCell;
use std::rc::Rc;

/// What an SPI controller in mode 3 or 2 does to a simulated slave.
pub struct Planned {
    pub pins: Rc<RefCell<SimPins>>,
    pub hz: Hertz,
    pub phase: Phase,
    pub last_end_ns: u64,
    /// Rising edges of each transfer.
    pub lengths: Rc<RefCell<Vec<usize>>>,
    /// A gap in the clock before this edge of the next transfer.
    pub gap: Rc<RefCell<Option<(usize, u64)>>>,
    /// A gap in the clock after each byte.
    pub byte_gap_ns: u64,
    pub phases: &'static [Phase],
}

impl Planned {
    pub fn new(config: &str, hz: u32) -> Planned {
        let pins = SimPins::new(config.parse().unwrap_or_else(|e| panic!("{e}")));
        Planned {
            pins: Rc::new(RefCell::new(pins)),
            hz: Hertz(hz),
            phase: Phase::Whole,
            last_end_ns: 0,
            lengths: Rc::default(),
            gap: Rc::default(),
            byte_gap_ns: 0,
            phases: &[Phase::Whole, Phase::Half],
        }
    }

    pub fn transfer(&mut self, bits: usize) -> Vec<bool> {
        let mut pins = self.pins.borrow_mut();
        let (period, half) = (self.hz.period_ns(), self.hz.period_ns() / 2);
        let mut t = pins.now_ns();
        let gap = self.gap.borrow_mut().take();
        let mut read = Vec::with_capacity(bits);
        for bit in 0..bits {
            if bit > 0 && bit % 8 == 0 {
                t += self.byte_gap_ns;
            }
            t += gap.filter(|(at, _)| *at == bit).map_or(0, |(_, ns)| ns);
            pins.until(t);
            // Mode 2 samples with the falling edge, mode 3 with the rising one, before it does anything.
            if self.phase == Phase::Half {
                read.push(pins.sl().unwrap());
            }
            pins.ma(false).unwrap();
            pins.until(t + half);
            if self.phase == Phase::Whole {
                read.push(pins.sl().unwrap());
            }
            pins.ma(true).unwrap();
            t += period;
        }
        pins.until(t);
        self.last_end_ns = pins.now_ns();
        self.lengths.borrow_mut().push(bits);
        read
    }
}

impl Link for Planned {
    fn caps(&self) -> Caps {
        Caps {
            live: true,
            reacts: false,
            cdm: false,
            sees_idle: false,
            times_levels: false,
            phases: self.phases,
            virtual_time: true,
            burst: 1,
        }
    }
    fn now_ns(&self) -> u64 {
        self.pins.borrow().now_ns()
    }
    fn clock(&self) -> Clock {
        Clock {
            hz: self.hz,
            known: Known::Asked,
        }
    }
    fn set_clock(&mut self, hz: Hertz) -> Result<Clock, Error> {
        self.hz = hz;
        Ok(self.clock())
    }
    fn set_phase(&mut self, phase: Phase) -> Result<(), Error> {
        self.phase = phase;
        Ok(())
    }
    fn idle(&mut self, ns: u64) -> Result<Option<bool>, Error> {
        let mut pins = self.pins.borrow_mut();
        let until = pins.now_ns() + ns;
        pins.until(until);
        Ok(None)
    }
    fn cycles(&mut self, asks: &[Ask], out: &mut [Trace]) -> Result<usize, Error> {
        for (ask, trace) in asks.iter().zip(out.iter_mut()) {
            let Until::Clocks(clocks) = ask.clocks.until else {
                panic!("asked to react")
            };
            let rest = ask.clocks.ready_ns.map_or(0, u64::from);
            self.pins
                .borrow_mut()
                .until(ask.at_ns.max(self.last_end_ns + rest));
            trace.reset();
            trace.t_ns = self.now_ns();
            trace.ma_period_ns = Some(self.hz.period_ns() as u32);
            trace.surplus = ask.clocks.surplus;
            let read = self.transfer((usize::from(clocks) + 1).div_ceil(8) * 8);
            trace.idle = Some(read[0]);
            trace.bits.extend(read[1..].iter().copied());
        }
        Ok(asks.len())
    }
}
