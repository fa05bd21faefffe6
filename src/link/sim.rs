//! `sim`: the bit-bang cycle on a simulated slave and a virtual clock. No hardware, no randomness but the seed's.

use super::bitbang::{Bang, Pins};
use super::bus::Bus;
use super::{Error, Kind, Spec};
use crate::parse::ParseError;
use crate::slave::{Config, Slave};
use crate::unit::Hertz;
use std::str::FromStr;

/// A simulated slave as two pins. Calls take no time; waiting does.
#[derive(Debug)]
pub struct SimPins {
    slave: Slave,
    now_ns: u64,
    changes: Option<Changes>,
}

/// SLO's, since somebody wants them.
#[derive(Debug)]
struct Changes {
    level: bool,
    seen: Vec<(u64, bool)>,
}

impl SimPins {
    /// A slave that has just been switched on.
    pub fn new(config: Config) -> SimPins {
        SimPins {
            slave: Slave::new(config),
            now_ns: 0,
            changes: None,
        }
    }

    /// Steps through what SLO does until now.
    fn follow(&mut self) {
        let Some(changes) = &mut self.changes else {
            return;
        };
        while let Some(at) = self.slave.next_change().filter(|at| *at <= self.now_ns) {
            let level = self.slave.slo(at);
            if level != changes.level {
                changes.level = level;
                changes.seen.push((at, level));
            }
        }
    }

    /// The slave.
    pub fn slave(&self) -> &Slave {
        &self.slave
    }

    /// The slave, to take its CDM bits.
    pub fn slave_mut(&mut self) -> &mut Slave {
        &mut self.slave
    }
}

/// The `sim` link.
pub fn open(config: Config) -> Bang<SimPins> {
    Bang::new(SimPins::new(config))
}

/// `KEY=VAL,…,frame=FORMAT`: what stands behind `sim:`.
impl FromStr for Config {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Config, ParseError> {
        let spec: Spec = format!("sim:{text}").parse()?;
        let Kind::Sim { config, .. } = spec.kind else {
            unreachable!("the text begins with sim:")
        };
        let format = spec
            .frame
            .map_or(config.format.clone(), |frame| frame.format);
        let config = Config { format, ..*config };
        config.chain().map(|_| config)
    }
}

impl Pins for SimPins {
    fn ma(&mut self, high: bool) -> Result<(), Error> {
        self.slave.ma(self.now_ns, high);
        self.follow();
        let pause_ns = self.slave.pause_ns();
        if pause_ns > 0 {
            self.until(self.now_ns + pause_ns);
        }
        Ok(())
    }

    fn sl(&mut self) -> Result<bool, Error> {
        Ok(self.slave.slo(self.now_ns))
    }

    fn has_mo(&self) -> bool {
        self.slave.has_mo()
    }

    fn mo(&mut self, high: bool) -> Result<(), Error> {
        self.slave.mo(self.now_ns, high);
        self.follow();
        Ok(())
    }

    fn now_ns(&self) -> u64 {
        self.now_ns
    }

    fn until(&mut self, ns: u64) {
        self.now_ns = self.now_ns.max(ns);
        self.follow();
    }

    fn slo_changes(&mut self) -> Option<&mut Vec<(u64, bool)>> {
        let changes = self.changes.get_or_insert_with(|| Changes {
            level: self.slave.slo(self.now_ns),
            seen: Vec::new(),
        });
        Some(&mut changes.seen)
    }

    fn cost_ns(&self) -> (u64, u64) {
        (0, 0)
    }

    fn virtual_time(&self) -> bool {
        true
    }
}

/// What an SPI controller makes of what it is asked for.
#[derive(Clone, Copy, Debug)]
pub struct Controller {
    /// The SCLK that it runs at when asked for another.
    pub divide: fn(Hertz) -> Hertz,
    /// How long a call takes beside its bits, half of it before them.
    pub call_ns: u64,
    /// SCLK stands still for so many bits after each byte.
    pub gap_bits: u64,
    /// Where MOSI rests between transfers; `None` leaves it at the last bit.
    pub mosi_rests: Option<bool>,
    /// The MA pair is swapped.
    pub swapped: bool,
}

impl Default for Controller {
    fn default() -> Controller {
        Controller {
            divide: |hz| hz,
            call_ns: 0,
            gap_bits: 0,
            mosi_rests: None,
            swapped: false,
        }
    }
}

/// An SPI controller in mode 0 whose MOSI is a simulated slave's MA and whose MISO is its SLO.
#[derive(Debug)]
pub struct SimBus {
    pins: SimPins,
    controller: Controller,
    /// After this byte of the next transfer SCLK stands still for so long.
    pause: Option<(usize, u64)>,
}

impl SimBus {
    /// A slave that has just been switched on, behind a controller.
    pub fn new(config: Config, controller: Controller) -> SimBus {
        SimBus {
            pins: SimPins::new(config),
            controller,
            pause: None,
        }
    }

    /// Lets SCLK stand still once, after byte number `byte` of the next transfer.
    pub fn pause(&mut self, byte: usize, ns: u64) {
        self.pause = Some((byte, ns));
    }

    /// The slave and its time.
    pub fn pins(&self) -> &SimPins {
        &self.pins
    }

    /// The slave and its time.
    pub fn pins_mut(&mut self) -> &mut SimPins {
        &mut self.pins
    }

    fn mosi(&mut self, high: bool) {
        let now = self.pins.now_ns;
        self.pins.slave.ma(now, high != self.controller.swapped);
    }
}

impl Bus for SimBus {
    fn shift(&mut self, hz: Hertz, out: &[u8], back: &mut [u8]) -> Result<u64, Error> {
        let Controller {
            divide,
            call_ns,
            gap_bits,
            mosi_rests,
            ..
        } = self.controller;
        let began = self.pins.now_ns;
        let start = began + call_ns / 2;
        // Half bits since the start: MOSI moves with the even ones, MISO is sampled with the odd ones.
        let half_hz = 2 * u64::from(divide(hz).0.max(1));
        let pause = self.pause.take();
        let at = |halves: u64| {
            let byte = halves / 16;
            let paused = pause.filter(|(after, _)| byte > *after as u64);
            start + halves * 1_000_000_000 / half_hz + paused.map_or(0, |(_, ns)| ns)
        };
        let bits = 8 * out.len().min(back.len()) as u64;
        for bit in 0..bits {
            let (byte, mask) = ((bit / 8) as usize, 0x80 >> (bit % 8));
            let halves = 2 * (bit + bit / 8 * gap_bits);
            self.pins.until(at(halves));
            self.mosi(out[byte] & mask != 0);
            self.pins.until(at(halves + 1));
            let level = self.pins.sl()?;
            back[byte] = back[byte] & !mask | if level { mask } else { 0 };
        }
        self.pins.until(at(2 * (bits + bits / 8 * gap_bits)));
        if let Some(level) = mosi_rests {
            self.mosi(level);
        }
        self.pins.until(self.pins.now_ns + call_ns.div_ceil(2));
        Ok(began)
    }

    fn now_ns(&self) -> u64 {
        self.pins.now_ns
    }

    fn until(&mut self, ns: u64) {
        self.pins.until(ns);
    }

    fn max_bytes(&self) -> usize {
        4096
    }

    fn name(&self) -> String {
        "the simulated controller".into()
    }

    fn virtual_time(&self) -> bool {
        true
    }
}
