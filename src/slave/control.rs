//! Control communication as a slave sees it: a CDM bit at each timeout, a CDS bit in the next frame (D2, p. 13-19).
//!
//! ```text
//! frame      0    1     2 … 9    10 … 15        16   17   18   19 … 26   27 … 30   31   32
//! CDM        S    CTS   ID, ADR or IDS, CRC     R    W    S    data      CRC       P    S …
//! CDS             IDL0  IDL1 … IDL8                  R    W    S    data      CRC       P
//! ```

use super::config::Config;
use super::random::Random;
use super::registers::{DIRECT, LAST, Registers};
use super::words::CrcBits;
use super::{Event, Events};

/// So many CDM bits of 0 end whatever was going on.
const RESET: u8 = 14;
/// Longest sequence of bytes (D2, p. 15).
const MOST_BYTES: u8 = 64;
/// The last CDM bit of the CRC behind the header.
const HEADER_END: u8 = 15;
/// IDs 0 to 7 can be said.
const IDS: u8 = 8;

/// What CDS is in the next frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Answer {
    /// What SLI has.
    Forward,
    /// This.
    Send(bool),
    /// IDL of this number: 1 where SLI has 0, unless an ID was taken before.
    Take(u8),
}
use Answer::{Forward, Send, Take};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// The next 1 is the S of a control frame.
    Idle,
    /// Up to the CRC.
    Header,
    /// R and W of an access to this slave.
    ReadWrite,
    /// S of a byte.
    Start,
    /// A byte on its way to the master.
    Read,
    /// A byte on its way from the master.
    Write,
    /// S, IDA and EX of a command.
    Command,
    /// Nothing more until the reset.
    Deaf,
}

/// What goes wrong in the running control frame.
#[derive(Clone, Copy, Debug, Default)]
struct Faults {
    idl_wrong: bool,
    ida_wrong: bool,
    w_inverted: bool,
    no_s: bool,
    stop_bit: bool,
}

/// What the machine works on and is told by.
pub(super) struct Around<'a> {
    pub(super) config: &'a Config,
    pub(super) t_ns: u64,
    /// Of the slave, counted from the farthest.
    pub(super) place: usize,
    pub(super) registers: &'a mut Registers,
    pub(super) events: &'a mut Events,
}

/// The control communication of one slave.
#[derive(Clone, Debug)]
pub(super) struct Control {
    random: Random,
    faults: Faults,
    state: State,
    answer: Answer,
    /// CDM bits of 0 in a row.
    zeros: u8,
    /// CDM bits since the control frame, or this byte, began with its S.
    step: u8,
    /// These bits, the latest lowest.
    bits: u16,
    id: Option<u8>,
    write: bool,
    address: u8,
    /// Bytes of this access that are done.
    count: u8,
    /// When the register is ready, and whether that has been set for this byte.
    ready_ns: u64,
    fetching: bool,
    /// The byte that was written is in its register.
    stored: bool,
    /// This bit of the echo is wrong.
    wrong_bit: Option<u8>,
    /// Takes part in control communication.
    active: bool,
    data_active: bool,
}

impl Control {
    /// Chance of its own, so that a register access moves nothing else.
    pub(super) fn new(config: &Config, place: usize) -> Control {
        Control {
            random: Random(config.seed.wrapping_mul(31) ^ (place as u64 + 1) << 48),
            faults: Faults::default(),
            state: State::Idle,
            answer: Forward,
            zeros: 0,
            step: 0,
            bits: 0,
            id: None,
            write: false,
            address: 0,
            count: 0,
            ready_ns: 0,
            fetching: false,
            stored: false,
            wrong_bit: None,
            active: true,
            data_active: true,
        }
    }

    pub(super) fn active(&self) -> bool {
        self.active
    }

    pub(super) fn data_active(&self) -> bool {
        self.data_active
    }

    /// CDM as this slave reads it.
    pub(super) fn read(&mut self, cdm: bool, config: &Config) -> bool {
        cdm ^ self.random.hit(config.rates.cdm_flip)
    }

    /// Nothing is going on, and this bit changes nothing.
    pub(super) fn rests(&self, cdm: bool) -> bool {
        self.state == State::Idle && !cdm
    }

    /// The CDS bit of this frame, SLI's being `sli`.
    pub(super) fn cds(&mut self, sli: bool, config: &Config) -> bool {
        let level = match self.answer {
            Forward => sli,
            Send(level) => level,
            Take(slot) if self.active && self.id.is_none() && !sli => {
                self.id = Some(slot);
                !self.faults.idl_wrong
            }
            Take(_) => sli,
        };
        level ^ self.random.hit(config.rates.cds_flip)
    }

    /// The CDM bit of a frame that has timed out.
    pub(super) fn clock(&mut self, cdm: bool, around: &mut Around<'_>) {
        self.zeros = if cdm { 0 } else { self.zeros.saturating_add(1) };
        self.step = self.step.saturating_add(1);
        self.answer = if self.zeros >= RESET {
            self.state = State::Idle;
            Forward
        } else {
            match self.state {
                State::Idle if cdm => self.begin(around.config),
                State::Idle | State::Deaf => Forward,
                State::Header => self.header(cdm),
                State::ReadWrite => self.read_write(cdm, around),
                State::Start => self.start(cdm, around),
                State::Read => self.read_on(),
                State::Write => self.write_on(cdm, around),
                State::Command => self.command(cdm, around),
            }
        };
    }

    fn deaf(&mut self, last: Answer) -> Answer {
        self.state = State::Deaf;
        last
    }

    fn begin(&mut self, config: &Config) -> Answer {
        let rates = config.rates;
        let mut hit = |parts| self.random.hit(parts);
        self.faults = Faults {
            idl_wrong: hit(rates.idl_wrong),
            ida_wrong: hit(rates.ida_wrong),
            w_inverted: hit(rates.w_inverted),
            no_s: hit(rates.no_s),
            stop_bit: hit(rates.stop_bit),
        };
        self.state = State::Header;
        (self.step, self.bits, self.id) = (0, 0, None);
        Take(0)
    }

    /// CTS to CRC.
    fn header(&mut self, cdm: bool) -> Answer {
        self.bits = self.bits << 1 | u16::from(cdm);
        if self.step <= IDS {
            return Take(self.step);
        }
        if self.step < HEADER_END {
            return Forward;
        }
        let (header, crc) = (self.bits >> 4, self.bits & 0xF);
        let register = header >> 10 == 1;
        let addressed = self.id == Some((header >> 7 & 7) as u8);
        self.state = match (crc == check(header, 11), register) {
            (true, true) if addressed => State::ReadWrite,
            (true, false) => State::Command,
            _ => State::Deaf,
        };
        self.address = (header & 0x7F) as u8;
        Forward
    }

    fn read_write(&mut self, cdm: bool, around: &mut Around<'_>) -> Answer {
        if self.step == HEADER_END + 1 {
            self.bits = u16::from(cdm);
            return Send(cdm);
        }
        self.write = cdm;
        let both_or_none = self.write == (self.bits == 1);
        let refused = both_or_none || !around.registers.allows(self.address, self.write);
        if self.faults.w_inverted || refused && !around.config.refuses_silently {
            return self.deaf(Send(!cdm));
        }
        if refused || self.faults.no_s {
            return self.deaf(Send(cdm));
        }
        self.state = State::Start;
        self.count = 0;
        // The first byte may be fetched as soon as its address is known; those behind it when they are asked for.
        self.fetching = !self.write;
        if self.fetching {
            self.take_time(around);
        }
        Send(cdm)
    }

    /// A register is at work from now on.
    fn take_time(&mut self, around: &Around<'_>) {
        let busy = &around.config.reg_busy;
        self.ready_ns = around.t_ns + self.random.between(busy.start().0, busy.end().0);
    }

    /// S, echoed when the register is ready for its byte: a first one to write always is (D2, p. 17).
    fn start(&mut self, cdm: bool, around: &mut Around<'_>) -> Answer {
        if !cdm {
            return Send(false);
        }
        if !self.write && !self.fetching {
            self.fetching = true;
            self.take_time(around);
        }
        let waits = !self.write || self.count > 0;
        if waits && around.t_ns < self.ready_ns {
            return Send(false);
        }
        self.fetching = false;
        self.step = 0;
        self.bits = 0;
        if self.write {
            self.state = State::Write;
            let wrong = self.random.hit(around.config.rates.echo_wrong);
            self.wrong_bit = wrong.then(|| self.random.between(1, 8) as u8);
        } else {
            self.state = State::Read;
            self.load(around);
        }
        Send(true)
    }

    /// The byte, its CRC and P, as they go out.
    fn load(&mut self, around: &mut Around<'_>) {
        let bank = around.registers.selected();
        let value = around.registers.peek(bank, self.address).unwrap_or(0);
        around.events.add(Event::Read {
            id: around.place,
            bank,
            address: self.address,
            value,
        });
        let wrong = self.random.hit(around.config.rates.data_crc);
        let crc = check(value.into(), 8) ^ u16::from(wrong);
        let stop = self.next(around);
        self.bits = u16::from(value) << 5 | crc << 1 | u16::from(stop);
    }

    /// On to the next address; true where this byte was the last.
    fn next(&mut self, around: &Around<'_>) -> bool {
        self.count += 1;
        let crosses = [DIRECT - 1, LAST].contains(&self.address);
        self.address += 1;
        crosses
            || self.count == MOST_BYTES
            || self.faults.stop_bit
            || !around.registers.allows(self.address, self.write)
    }

    fn read_on(&mut self) -> Answer {
        const P: u8 = 13;
        let bit = self.bits >> P.saturating_sub(self.step) & 1 == 1;
        if self.step == P {
            self.state = if bit { State::Deaf } else { State::Start };
        }
        Send(bit)
    }

    fn write_on(&mut self, cdm: bool, around: &mut Around<'_>) -> Answer {
        const CRC_END: u8 = 12;
        if self.step <= CRC_END {
            self.bits = self.bits << 1 | u16::from(cdm);
            if self.step == CRC_END {
                self.stored = self.store(around);
            }
            return Send(cdm ^ (self.wrong_bit == Some(self.step)));
        }
        let stop = !self.stored || self.next(around);
        self.state = if stop { State::Deaf } else { State::Start };
        Send(stop)
    }

    /// Takes a byte whose CRC is right.
    fn store(&mut self, around: &mut Around<'_>) -> bool {
        let (value, crc) = (self.bits >> 4, self.bits & 0xF);
        if crc != check(value, 8) {
            return false;
        }
        self.take_time(around);
        if !self.random.hit(around.config.rates.write_lost) {
            let bank = around.registers.selected();
            around.registers.poke(bank, self.address, value as u8);
            around.events.add(Event::Write {
                id: around.place,
                bank,
                address: self.address,
                value: value as u8,
            });
        }
        true
    }

    /// From S on. IDA of slave k is in CDS 17 + k; EX in CDM 17 to all, in CDM 24 to those addressed.
    fn command(&mut self, cdm: bool, around: &mut Around<'_>) -> Answer {
        const S: u8 = HEADER_END + 1;
        let ids = self.bits >> 6 & 0xFF;
        let broadcast = ids == 0;
        let named = |id: u8| id < IDS && ids >> (7 - id) & 1 == 1;
        if self.step == S && !cdm {
            return self.deaf(Forward);
        }
        if self.step == if broadcast { S + 1 } else { S + IDS } {
            if cdm && (broadcast || self.id.is_some_and(named)) {
                self.execute((self.bits >> 4 & 3) as u8, broadcast, around);
            }
            return self.deaf(Forward);
        }
        match self.id {
            Some(id) if !broadcast && id == self.step - S => {
                Send(named(id) ^ self.faults.ida_wrong)
            }
            _ => Forward,
        }
    }

    fn execute(&mut self, command: u8, broadcast: bool, around: &mut Around<'_>) {
        match (broadcast, command) {
            (true, 0) => self.data_active = false,
            (false, 0) => self.data_active = true,
            (true, 1) => self.active = true,
            (false, 1) => self.active = false,
            // A bus coupler's, the manufacturer's or nobody's: nothing to be seen from outside.
            _ => {}
        }
        around.events.add(Event::Command {
            id: around.place,
            command,
            broadcast,
        });
    }
}

/// CRC-4 of the control channel as it is sent (D2, p. 14): 0x13, start value 0, inverted.
fn check(value: u16, bits: u32) -> u16 {
    const CRC4: CrcBits = CrcBits {
        bits: 4,
        poly: 0x13,
        init: 0,
        inverted: true,
    };
    let register = (0..bits).rev().fold(CRC4.init, |register, place| {
        CRC4.shift(register, value >> place & 1 == 1)
    });
    (register as u16 & 0xF) ^ 0xF
}
