//! One slave of a chain: what it makes of its SLI and its own data (D2, p. 10-12).
//!
//! SLI is the SLO of the slave before it, read with each falling MA edge; SLO changes with the rising ones. So a start
//! bit, and all that follows, takes a clock for each slave.

use super::Events;
use super::config::{Config, Device as Image};
use super::control::{Around, Control};
use super::image;
use super::registers::Registers;
use std::collections::VecDeque;
use std::ops::Range;

/// What SLO has come to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    /// Ack, until it has something to say.
    Head,
    /// Start is out, CDS is next.
    Cds,
    /// Own data, then SLI's.
    Data,
}

/// What SLI has come to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Heard {
    Rest,
    Ack,
    Start,
}

/// A slave of a chain.
#[derive(Clone, Debug)]
pub(super) struct Device {
    /// Counted from the farthest.
    place: usize,
    /// Its channels in the format.
    pub(super) channels: Range<usize>,
    /// What it does not take part in it does not know.
    fixed: Option<bool>,
    /// SLI was 0 when the frame began: nobody is before it.
    first: bool,
    part: Part,
    heard: Heard,
    /// Own bits still to be sent, the next one last.
    pub(super) bits: Vec<bool>,
    /// SLI since its start bit.
    behind: VecDeque<bool>,
    /// Processing time of this frame.
    pub(super) busy_ns: u64,
    pub(super) slo: bool,
    control: Control,
    /// Made when somebody asks.
    registers: Option<Box<Registers>>,
}

impl Device {
    pub(super) fn new(config: &Config, place: usize, channels: Range<usize>, slo: bool) -> Device {
        let bits = config.format.channels()[channels.clone()]
            .iter()
            .map(|channel| usize::from(channel.data_bits()) + usize::from(channel.crc_bits()))
            .sum();
        Device {
            place,
            channels,
            fixed: match config.device {
                Image::None => Some(false),
                _ => config.cds,
            },
            first: true,
            part: Part::Head,
            heard: Heard::Rest,
            bits: Vec::with_capacity(bits),
            behind: VecDeque::new(),
            busy_ns: 0,
            slo,
            control: Control::new(config, place),
            registers: None,
        }
    }

    /// The falling edge that begins a frame.
    pub(super) fn arm(&mut self, sli: bool) {
        self.first = !sli;
        self.part = Part::Head;
        self.heard = Heard::Rest;
        self.behind.clear();
    }

    /// A falling edge within a frame.
    pub(super) fn fall(&mut self, sli: bool) {
        match self.heard {
            _ if self.first => {}
            Heard::Rest if !sli => self.heard = Heard::Ack,
            Heard::Ack if sli => self.heard = Heard::Start,
            Heard::Start => self.behind.push_back(sli),
            _ => {}
        }
    }

    /// Rising edge 2 or a later one; `ready` when nothing of its own holds the start bit back.
    pub(super) fn rise(&mut self, ready: bool, config: &Config) {
        self.slo = match self.part {
            Part::Head => {
                let starts = ready && (self.first || self.heard == Heard::Start);
                if starts {
                    self.part = Part::Cds;
                }
                starts
            }
            Part::Cds => {
                self.part = Part::Data;
                let sli = self.behind.pop_front().unwrap_or(false);
                match self.fixed {
                    Some(level) => level,
                    None => self.control.cds(sli, config),
                }
            }
            Part::Data => match self.bits.pop() {
                Some(bit) => bit,
                None => self.behind.pop_front().unwrap_or(false),
            },
        };
    }

    /// Its timeout has passed: it is ready when its SLI is.
    pub(super) fn rest(&mut self, sli: bool) {
        self.slo = self.first || sli;
    }

    /// SLI moves while it rests. It has waited for a 1; a 0 means nothing before the next frame.
    pub(super) fn follow(&mut self, sli: bool) {
        self.slo |= sli;
    }

    /// CDM, which it reads when its timeout has passed. Returns what it read.
    pub(super) fn hear(
        &mut self,
        cdm: bool,
        t_ns: u64,
        config: &Config,
        events: &mut Events,
    ) -> bool {
        if self.fixed.is_some() {
            return cdm;
        }
        let cdm = self.control.read(cdm, config);
        if !self.control.rests(cdm) {
            let registers = self
                .registers
                .get_or_insert_with(|| made(config, self.place, &self.channels));
            let mut around = Around {
                config,
                t_ns,
                place: self.place,
                registers,
                events,
            };
            self.control.clock(cdm, &mut around);
        }
        cdm
    }

    /// Whether its data channels are switched on.
    pub(super) fn data_active(&self) -> bool {
        self.control.data_active()
    }

    /// Whether it takes part in control communication.
    pub(super) fn control_active(&self) -> bool {
        self.fixed.is_none() && self.control.active()
    }

    pub(super) fn peek(&self, config: &Config, bank: u8, address: u8) -> Option<u8> {
        match &self.registers {
            Some(registers) => registers.peek(bank, address),
            None => made(config, self.place, &self.channels).peek(bank, address),
        }
    }

    pub(super) fn poke(&mut self, config: &Config, bank: u8, address: u8, value: u8) -> bool {
        self.registers
            .get_or_insert_with(|| made(config, self.place, &self.channels))
            .poke(bank, address, value)
    }
}

fn made(config: &Config, place: usize, channels: &Range<usize>) -> Box<Registers> {
    let channels = &config.format.channels()[channels.clone()];
    Box::new(image::build(config, place, channels))
}
