//! Registers of one slave, read and written: a record each, and nothing half written that nobody knows of.

use super::session::Hold;
use crate::cli::Span;
use crate::output::reg::{Bad, Register, list};
use biss::control::{Access, Failure};
use biss::cycle::Fault;
use biss::link::Error;
use biss::registers::{BANK_SELECT, Cell, Registers, Trouble};

/// A register as far as it could be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Reading {
    Byte(u8),
    /// Or why not.
    Not(Bad),
}

impl Reading {
    /// It was read, or the slave has said that it cannot be.
    pub(super) fn is_answer(&self) -> bool {
        match self {
            Reading::Byte(_) => true,
            Reading::Not(bad) => bad.is_refusal(),
        }
    }

    pub(super) fn byte(&self) -> Option<u8> {
        match self {
            Reading::Byte(byte) => Some(*byte),
            Reading::Not(_) => None,
        }
    }
}

/// Failed registers in a row after which the others are not tried.
const MOST_IN_ROW: usize = 3;

/// The registers of a slave, and what came of them so far.
pub(super) struct Talk<'t, 'm, 'a> {
    registers: &'t mut Registers<'m, 'a>,
    hold: Hold,
    slave: u8,
    /// The selected bank, where it is known.
    bank: Option<u8>,
    pub(super) told: Told,
}

/// What is to be told.
#[derive(Debug, Default)]
pub(super) struct Told {
    pub(super) records: Vec<Register>,
    /// What was being done, in case that it fails.
    pub(super) doing: String,
    pub(super) notes: Vec<String>,
}

/// `register 0x10 of slave 0`, `registers 0x10..0x1f of slave 0`.
fn named(span: Span, slave: u8) -> String {
    let plural = if span.first == span.last { "" } else { "s" };
    format!(
        "register{plural} {} of slave {slave}",
        list(span.addresses())
    )
}

impl<'t, 'm, 'a> Talk<'t, 'm, 'a> {
    pub(super) fn new(registers: &'t mut Registers<'m, 'a>, hold: Hold, slave: u8) -> Self {
        Talk {
            registers,
            hold,
            slave,
            bank: None,
            told: Told::default(),
        }
    }

    /// Whose registers they are.
    pub(super) fn slave(&self) -> u8 {
        self.slave
    }

    /// Keeps signals waiting.
    pub(super) fn hold(&self) -> Hold {
        self.hold.clone()
    }

    /// A record of a register that was to be read.
    pub(super) fn record(&self, address: u8, reading: Reading) -> Register {
        let (value, bad) = match reading {
            Reading::Byte(byte) => (Some(byte), None),
            Reading::Not(bad) => (None, Some(bad)),
        };
        Register {
            value,
            bad,
            ..Register::untouched(self.slave, self.bank, address)
        }
    }

    /// Reads registers, a record each.
    pub(super) fn read(&mut self, span: Span) -> Result<(), Trouble> {
        let readings = self.readings(span)?;
        for (address, reading) in span.addresses().zip(readings) {
            let record = self.record(address, reading);
            self.told.records.push(record);
        }
        Ok(())
    }

    /// Reads registers, each with its own verdict.
    pub(super) fn readings(&mut self, span: Span) -> Result<Vec<Reading>, Trouble> {
        self.told.doing = format!("reading {}", named(span, self.slave));
        let wanted = span.addresses().len();
        let mut all = Vec::new();
        let mut failed_in_row = 0;
        while all.len() < wanted && failed_in_row < MOST_IN_ROW {
            let at = u16::from(span.first) + all.len() as u16;
            let cells = self
                .registers
                .cells(self.slave, at..u16::from(span.last) + 1)?;
            for cell in cells {
                let failed = matches!(cell, Cell::Failed(_));
                failed_in_row = if failed { failed_in_row + 1 } else { 0 };
                if cell == Cell::Failed(Failure::Cut) {
                    failed_in_row = MOST_IN_ROW;
                }
                let address = span.first + all.len() as u8;
                all.push(self.reading(address, cell));
            }
        }
        all.resize(wanted, Reading::Not(Bad::untried()));
        Ok(all)
    }

    fn reading(&mut self, address: u8, cell: Cell) -> Reading {
        let (failure, fault) = match cell {
            Cell::Byte(byte) => return Reading::Byte(byte),
            Cell::Refused => (Failure::Refused { address }, None),
            Cell::Failed(failure) => (failure, self.fault_behind(failure)),
        };
        Reading::Not(Bad::new(failure, fault))
    }

    fn fault_behind(&mut self, failure: Failure) -> Option<Fault> {
        let fault = self.registers.master().cycle().fault();
        fault.filter(|_| failure == Failure::Cut)
    }

    /// Which bank the slave shows, as far as it says so.
    pub(super) fn learn_bank(&mut self) -> Result<(), Trouble> {
        let select = Span {
            first: BANK_SELECT,
            last: BANK_SELECT,
        };
        let readings = self.readings(select)?;
        self.bank = readings.first().and_then(Reading::byte);
        Ok(())
    }

    /// The selected bank, where it is known.
    pub(super) fn bank(&self) -> Option<u8> {
        self.bank
    }

    /// Does something with a bank selected, and selects the one before again whatever came of it.
    pub(super) fn within<T>(
        &mut self,
        bank: u8,
        work: impl FnOnce(&mut Self) -> Result<T, Trouble>,
    ) -> Result<T, Trouble> {
        self.told.doing = format!("selecting bank {bank} of slave {}", self.slave);
        let selected = self.registers.select(self.slave, bank)?;
        let known = self.bank.replace(bank);
        let result = work(self);
        self.bank = known;
        let Err(trouble) = self.registers.restore(selected) else {
            return result;
        };
        let doing = format!(
            "selecting the bank of slave {} again that was selected before; bank {bank} still is",
            self.slave
        );
        match result {
            Ok(_) => self.told.doing = doing,
            // What has gone wrong first is told first.
            Err(first) => {
                self.told.notes.push(format!("{doing}: {trouble}"));
                return Err(first);
            }
        }
        Err(trouble)
    }

    /// Writes registers that follow each other, and reads them back where `check` says so, or something has gone wrong.
    /// A record each; whether each holds what it should. No signal comes in between.
    pub(super) fn write(&mut self, first: u8, values: &[u8], check: bool) -> Result<bool, Trouble> {
        let span = Span {
            first,
            last: first + values.len() as u8 - 1,
        };
        let old = self.readings(span)?;
        self.hold
            .clone()
            .during(|| self.overwrite(span, values, &old, check))
    }

    /// Likewise, with what they hold read before.
    pub(super) fn overwrite(
        &mut self,
        span: Span,
        values: &[u8],
        old: &[Reading],
        check: bool,
    ) -> Result<bool, Trouble> {
        let doing = format!("writing {}", named(span, self.slave));
        self.told.doing.clone_from(&doing);
        let mut puts = self.puts(span, values, old);
        let outcome = self.registers.access(Access::Write {
            slave: self.slave,
            address: span.first,
            data: values.into(),
        });
        let failed = match outcome {
            Err(trouble) => return Err(self.unknown(puts, &doing, trouble)),
            Ok(outcome) => {
                let done = outcome.bytes.as_slice().len();
                puts.iter_mut().take(done).for_each(Put::echoed);
                if let Some((failure, put)) = outcome.failure.zip(puts.get_mut(done)) {
                    put.failed(failure, self.fault_behind(failure));
                }
                outcome.failure.is_some()
            }
        };
        if check || failed {
            if let Err(error) = self.look_back(span, &mut puts, check) {
                return Err(self.unknown(puts, &doing, error.into()));
            }
            self.told.doing = doing;
        }
        let good = puts.iter().all(|put| put.record.bad.is_none());
        self.push(puts);
        Ok(good)
    }

    /// Registers that are going to be written, nothing being known about them yet.
    fn puts(&self, span: Span, values: &[u8], old: &[Reading]) -> Vec<Put> {
        let wanted = span.addresses().zip(values).zip(old);
        wanted
            .map(|((address, want), old)| Put {
                record: Register {
                    old: old.byte(),
                    want: Some(*want),
                    bad: Some(Bad::untried()),
                    write: true,
                    ..Register::untouched(self.slave, self.bank, address)
                },
                want: *want,
                mute: false,
            })
            .collect()
    }

    /// Reads what has been written. Only the machine's failures are errors.
    fn look_back(&mut self, span: Span, puts: &mut [Put], check: bool) -> Result<(), Error> {
        match self.readings(span) {
            Ok(now) => {
                for (put, now) in puts.iter_mut().zip(now) {
                    put.read_back(now, check);
                }
            }
            Err(Trouble::Link(error)) => return Err(error),
            // The slave is not there any more: what is known is what it has echoed.
            Err(trouble) => puts
                .iter_mut()
                .for_each(|put| put.unread(Bad::of(&trouble))),
        }
        Ok(())
    }

    fn push(&mut self, puts: Vec<Put>) {
        let mute = list(
            puts.iter()
                .filter(|put| put.mute)
                .map(|put| put.record.address),
        );
        if !mute.is_empty() {
            self.told.notes.push(format!(
                "{mute} cannot be read back: that it was written is what the slave has echoed"
            ));
        }
        self.told
            .records
            .extend(puts.into_iter().map(|put| put.record));
    }

    /// The machine has failed: nobody can be asked what was written.
    fn unknown(&mut self, mut puts: Vec<Put>, doing: &str, trouble: Trouble) -> Trouble {
        puts.iter_mut()
            .for_each(|put| put.unknown(Bad::of(&trouble)));
        self.push(puts);
        self.told.doing = doing.into();
        trouble
    }
}

/// A register that is being written.
struct Put {
    record: Register,
    want: u8,
    /// It was echoed, and cannot be read.
    mute: bool,
}

impl Put {
    fn echoed(&mut self) {
        self.record.sent = true;
        self.record.value = Some(self.want);
        (self.record.want, self.record.bad) = (None, None);
    }

    fn failed(&mut self, failure: Failure, fault: Option<Fault>) {
        let heard_no_byte = matches!(
            failure,
            Failure::Unheard
                | Failure::Absent { .. }
                | Failure::Garbled { .. }
                | Failure::Refused { .. }
                | Failure::NoReaction { .. }
                | Failure::Strange { .. }
        );
        self.record.sent = !heard_no_byte;
        self.record.bad = Some(Bad::new(failure, fault));
    }

    /// What it holds now.
    fn read_back(&mut self, now: Reading, check: bool) {
        if self.record.bad.is_some() {
            self.record.value = now.byte();
            return;
        }
        match now {
            Reading::Byte(byte) if check && byte != self.want => {
                self.record.value = Some(byte);
                self.spoil(Bad::new(
                    Failure::ReadBack {
                        address: self.record.address,
                        want: self.want,
                        got: byte,
                    },
                    None,
                ));
            }
            Reading::Byte(_) => {}
            Reading::Not(bad) if bad.is_refusal() => self.mute = true,
            Reading::Not(bad) => self.unread(bad),
        }
    }

    /// It was echoed, if it was, and what it holds is not known.
    fn unread(&mut self, bad: Bad) {
        self.record.value = None;
        if self.record.bad.is_none() {
            self.spoil(bad.but_echoed());
        }
    }

    /// Nothing is known about it.
    fn unknown(&mut self, bad: Bad) {
        (self.record.value, self.record.sent) = (None, true);
        self.spoil(bad);
    }

    fn spoil(&mut self, bad: Bad) {
        (self.record.want, self.record.bad) = (Some(self.want), Some(bad));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::reg::Written;
    use biss::frame::BissC;
    use biss::link::Link;
    use biss::link::bitbang::Bang;
    use biss::link::sim::{self, Controller, SimBus, SimPins};
    use biss::link::wave::{Options, Wave};
    use biss::master::Master;
    use biss::unit::Hertz;
    use std::cell::RefCell;
    use std::rc::Rc;

    type Sim = Rc<RefCell<Bang<SimPins>>>;

    /// Talks to a simulated slave, and gives it back to be looked at.
    fn talk<T>(config: &str, work: impl FnOnce(&mut Talk, &Sim) -> T) -> (T, Sim) {
        let link: Sim = Rc::new(RefCell::new(sim::open(config.parse().unwrap())));
        let mut shared = Rc::clone(&link);
        let result = over(&mut shared, |talk| work(talk, &link));
        (result, link)
    }

    fn over<T>(link: &mut dyn Link, work: impl FnOnce(&mut Talk) -> T) -> T {
        let protocol = BissC::head_only();
        let mut master = Master::new(link, &protocol, None);
        // A frame that is lost on purpose is no absent encoder.
        assert!((0..4).any(|_| master.open().unwrap()));
        master.set_access_retries(1);
        let mut registers = Registers::new(&mut master);
        work(&mut Talk::new(&mut registers, Hold::default(), 0))
    }

    fn holds(link: &Sim, bank: u8, address: u8) -> Option<u8> {
        link.borrow_mut().pins_mut().slave().peek(0, bank, address)
    }

    #[test]
    fn the_bank_before_comes_back_whatever_happens() {
        let span = |first, last| Span { first, last };
        let ((), link) = talk("", |talk, link| {
            talk.within(5, |talk| {
                assert_eq!(holds(link, 0, BANK_SELECT), Some(5));
                assert!(talk.write(0x10, &[7, 8], true)?);
                talk.read(span(0x10, 0x11))
            })
            .unwrap();
            assert!(
                talk.told
                    .records
                    .iter()
                    .all(|record| record.bank == Some(5))
            );
            // An error, a refusal, and a bank within a bank.
            let failed: Result<(), Trouble> = talk.within(4, |_| Err(Trouble::Stopped));
            assert!(matches!(failed, Err(Trouble::Stopped)));
            assert_eq!(holds(link, 0, BANK_SELECT), Some(0));
            talk.within(4, |talk| {
                talk.within(5, |talk| talk.read(span(0, 0)))?;
                assert_eq!(holds(link, 0, BANK_SELECT), Some(4));
                talk.within(77, |talk| talk.read(span(0, 3)))
            })
            .unwrap();
            let refused = talk.told.records.iter().rev().take(4);
            assert!(
                refused
                    .map(|r| r.bad.as_ref().unwrap())
                    .all(Bad::is_refusal)
            );
        });
        assert_eq!(holds(&link, 0, BANK_SELECT), Some(0));
        assert_eq!(
            (holds(&link, 5, 0x10), holds(&link, 5, 0x11)),
            (Some(7), Some(8))
        );
        assert_eq!(
            (holds(&link, 0, 0x10), holds(&link, 4, 0x10)),
            (Some(0), Some(0))
        );
    }

    /// Where CDM is laid out before CDS is seen, and the line is long.
    #[test]
    fn a_wave_link_does_it_too() {
        for (config, hz) in [
            ("device=mhm", 1_000_000),
            ("device=mhm,delay=7300ns", 2_000_000),
            ("device=mhm,busy=0us..9us,delay=300ns", 500_000),
            ("device=mhm,reg-busy=0us..2ms,timeout=adaptive", 4_000_000),
            ("device=mhm,power-up=low", 250_000),
        ] {
            let bus = SimBus::new(config.parse().unwrap(), Controller::default());
            let mut link = Wave::new(bus, Options::default(), Some(Hertz(hz))).unwrap();
            over(&mut link, |talk| {
                talk.read(Span::ALL).unwrap();
                assert!(talk.write(0x01, &[0x5A, 0xA5], true).unwrap(), "{config}");
                assert!(!talk.write(0x13, &[1, 2], true).unwrap(), "{config}");
                talk.within(2, |talk| talk.read(Span { first: 1, last: 1 }))
                    .unwrap();
                let slave = sim::open("device=mhm".parse().unwrap());
                check(config, &talk.told.records, slave);
            });
            let slave = link.bus_mut().pins().slave();
            let held = [0x01, 0x02, 0x13, 0x40].map(|address| slave.peek(0, 0, address));
            assert_eq!(held, [0x5A, 0xA5, 0x01, 0x00].map(Some), "{config}");
        }
    }

    fn check(config: &str, records: &[Register], mut slave: Bang<SimPins>) {
        let (read, rest) = records.split_at(0x80);
        for record in read {
            let held = slave.pins_mut().slave().peek(0, 0, record.address);
            assert_eq!(record.value, held, "{config}: {record:?}");
            assert!(record.is_answer(), "{config}: {record:?}");
        }
        let told: Vec<_> = rest
            .iter()
            .map(|r| (r.old, r.value, r.bad.is_none()))
            .collect();
        let written = (Some(0x8C), Some(1), true);
        let wanted = [
            (Some(0x44), Some(0x5A), true),
            (Some(0x00), Some(0xA5), true),
            written,
            (None, None, false),
            (None, Some(1), true),
        ];
        assert_eq!(told, wanted, "{config}");
    }

    /// What is told of a write that went wrong is what the slave holds.
    #[test]
    fn what_is_told_of_writes_is_so() {
        for config in [
            "read-only=0x13",
            "refuse=0x12..0x13",
            "refusal=silent,read-only=0x11",
            "echo-wrong=30%",
            "write-lost=30%",
            "stop-bit=40%",
            "cds-flip=1%",
            "cdm-flip=1%",
            "no-ack=1%",
            "data-crc=30%",
        ] {
            let (mut yes, mut no, mut unknown) = (0, 0, 0);
            for seed in 0..40 {
                let config = format!("{config},seed={seed}");
                let (records, link) = talk(&config, |talk, link| {
                    talk.registers.verify(true);
                    for address in 0x10..0x16 {
                        link.borrow_mut().pins_mut().slave_mut().poke(
                            0,
                            0,
                            address,
                            0xA0 + address,
                        );
                    }
                    // A slave that is gone for good is told elsewhere.
                    drop(talk.write(0x10, &[1, 2, 3, 4, 5, 6], true));
                    std::mem::take(&mut talk.told.records)
                });
                for record in records {
                    let want = record.address - 0x0F;
                    let written = holds(&link, 0, record.address) == Some(want);
                    match record.written() {
                        Written::Yes => assert!(written, "{config}: {record:?}"),
                        Written::No => assert!(!written, "{config}: {record:?}"),
                        Written::Unknown => {}
                    }
                    match record.written() {
                        Written::Yes => yes += 1,
                        Written::No => no += 1,
                        Written::Unknown => unknown += 1,
                    }
                }
            }
            assert!(yes > 0, "{config}: {yes} {no} {unknown}");
            println!("{config}: {yes} written, {no} not, {unknown} not known");
        }
    }
}
