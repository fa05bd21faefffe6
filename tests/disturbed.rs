//! Registers under fire: MA pauses anywhere in an access, for longer than the slave waits. Whatever bits it takes from that,
//! nothing is written that was not to be, and the access recovers.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;
#[path = "common/wire.rs"]
mod wire;

use biss::control::{Access, Control, Failure, REST_FRAMES, Seen};
use biss::frame::BissC;
use biss::link::Error;
use biss::link::bitbang::{Bang, Pins};
use biss::link::sim::SimPins;
use biss::master::Master;
use biss::registers::Registers;
use biss::slave::{Config, Event};
use std::cell::{Cell, RefCell};
use std::rc::Rc;
use wire::Wire;

/// Pins that stand still before certain calls.
struct Halting {
    pins: Rc<RefCell<SimPins>>,
    calls: Rc<Cell<u64>>,
    /// The call, and for how long.
    halts: Rc<RefCell<Vec<(u64, u64)>>>,
}

impl Pins for Halting {
    fn ma(&mut self, high: bool) -> Result<(), Error> {
        let call = self.calls.replace(self.calls.get() + 1);
        let halts = self.halts.borrow();
        let halt = halts.iter().find(|(at, _)| *at == call);
        let mut pins = self.pins.borrow_mut();
        let now = pins.now_ns();
        pins.until(now + halt.map_or(0, |(_, ns)| *ns));
        pins.ma(high)
    }
    fn sl(&mut self) -> Result<bool, Error> {
        self.pins.borrow_mut().sl()
    }
    fn now_ns(&self) -> u64 {
        self.pins.borrow().now_ns()
    }
    fn until(&mut self, ns: u64) {
        self.pins.borrow_mut().until(ns);
    }
    fn cost_ns(&self) -> (u64, u64) {
        (0, 0)
    }
    fn virtual_time(&self) -> bool {
        true
    }
}

struct Bench {
    pins: Rc<RefCell<SimPins>>,
    calls: Rc<Cell<u64>>,
    halts: Rc<RefCell<Vec<(u64, u64)>>>,
    link: Bang<Halting>,
}

fn bench(config: &str) -> Bench {
    let config: Config = config.parse().unwrap_or_else(|e| panic!("{e}"));
    let pins = Rc::new(RefCell::new(SimPins::new(config)));
    let (calls, halts) = (Rc::default(), Rc::default());
    let link = Bang::new(Halting {
        pins: Rc::clone(&pins),
        calls: Rc::clone(&calls),
        halts: Rc::clone(&halts),
    });
    Bench {
        pins,
        calls,
        halts,
        link,
    }
}

/// Where a register can be written, and nothing else is.
const ADDRESS: u8 = 0x50;

/// Runs an access with pauses in its course; returns what the slave has executed, and how the access ended.
fn disturbed(
    config: &str,
    head_only: bool,
    access: Access,
    halts: &[(f64, u64)],
) -> (Vec<Event>, Option<Failure>, u32) {
    let mut bench = bench(config);
    let format = "st12,nE,nW,crc6".parse().unwrap();
    let protocol = match head_only {
        true => BissC::head_only(),
        false => BissC::new(format),
    };
    let mut master = Master::new(&mut bench.link, &protocol, None);
    assert!(master.open().unwrap());
    let mut registers = Registers::new(&mut master);
    let begin = bench.calls.get();
    // A rest and a control frame; the same again undisturbed would take as many calls.
    let calls = (14 + 47) * if head_only { 11 } else { 47 };
    *bench.halts.borrow_mut() = halts
        .iter()
        .map(|(at, ns)| (begin + (at * f64::from(calls)) as u64, *ns))
        .collect();
    bench.pins.borrow_mut().slave_mut().record_events(true);
    let outcome = registers.access(access).unwrap();
    let events = bench.pins.borrow_mut().slave_mut().take_events();
    (events, outcome.failure, outcome.retries)
}

/// Writes with so many pauses in their course; returns how many put a value somewhere that nobody wanted there.
fn writes(rng: &mut fastrand::Rng, pauses: usize, rounds: usize) -> u32 {
    let (mut retried, mut twice, mut wrong) = (0, 0, 0);
    for round in 0..rounds {
        let timeout = *rng
            .choice(&["timeout=20us", "timeout=12500ns", "timeout=40us"])
            .unwrap();
        let config = format!("seed={},{timeout},frame=st12,nE,nW,crc6", rng.u32(..));
        let data: Vec<u8> = (0..rng.usize(1..=2)).map(|_| rng.u8(..)).collect();
        let halts: Vec<(f64, u64)> = (0..pauses)
            .map(|_| (rng.f64(), rng.u64(5_000..150_000)))
            .collect();
        let access = Access::Write {
            slave: 0,
            address: ADDRESS,
            data: data.as_slice().into(),
        };
        let (events, failure, retries) = disturbed(&config, rng.bool(), access, &halts);
        let said =
            || format!("round {round}: {config} {data:x?} {halts:?}: {events:x?} {failure:?}");
        // A slave can take a disturbed header for that of a read.
        let written = events.iter().filter_map(|event| match event {
            Event::Write { address, value, .. } => Some((*address, *value)),
            _ => None,
        });
        let wanted: Vec<(u8, u8)> = (ADDRESS..).zip(data.iter().copied()).collect();
        let others = written
            .clone()
            .filter(|pair| !wanted.contains(pair))
            .count();
        if others > 0 {
            println!("{}", said());
            wrong += 1;
        }
        let done = |pair: &(u8, u8)| written.clone().any(|done| done == *pair);
        assert_eq!(failure, None, "{}", said());
        assert!(
            wanted.iter().all(done),
            "acknowledged, not written: {}",
            said()
        );
        retried += u32::from(retries > 0);
        twice += u32::from(written.count() > data.len());
    }
    println!(
        "{pauses} pauses: {rounds} writes, {retried} retried, {twice} executed more than once, {wrong} wrong"
    );
    assert!(retried > 0);
    wrong
}

/// After one pause the slave is always led out of the byte that was cut. More of them within a dozen frames can leave nothing
/// that is right for every place where the slave may be: then for the likely ones.
#[test]
fn a_disturbed_write_writes_nothing_else() {
    let mut rng = common::rng();
    let rounds = common::size(1_000);
    assert_eq!(writes(&mut rng, 1, rounds), 0);
    for pauses in [2, 4] {
        let wrong = writes(&mut rng, pauses, rounds);
        assert!(wrong as usize <= 2 + rounds / 200, "{wrong}");
    }
}

/// A command is executed once, or not at all; where nobody can know, that is what is said.
#[test]
fn a_disturbed_command_is_executed_once_at_most() {
    let mut rng = common::rng();
    let (mut undecided, mut executed) = (0, 0);
    for _ in 0..common::size(2_000) {
        let config = format!("seed={},frame=st12,nE,nW,crc6", rng.u32(..));
        let (slaves, code) = *rng.choice(&[(0u8, 2u8), (1, 2), (1, 3)]).unwrap();
        let halts: Vec<(f64, u64)> = (0..rng.usize(1..=3))
            .map(|_| (rng.f64(), rng.u64(5_000..150_000)))
            .collect();
        let access = Access::Command {
            slaves,
            code,
            checked: true,
            reduced: false,
        };
        let (events, failure, _) = disturbed(&config, rng.bool(), access, &halts);
        let said = || format!("{config} {slaves} {code} {halts:?}: {events:x?} {failure:?}");
        let right =
            |event: &Event| matches!(event, Event::Command { command, .. } if *command == code);
        assert!(events.iter().all(right), "{}", said());
        assert!(events.len() <= 1, "{}", said());
        match failure {
            None => assert_eq!(events.len(), 1, "{}", said()),
            Some(Failure::Undecided) => undecided += 1,
            Some(_) => assert!(events.is_empty(), "{}", said()),
        }
        executed += events.len();
    }
    println!("{executed} executed, {undecided} undecided");
}

/// Read bytes are the slave's, whatever the pauses.
#[test]
fn a_disturbed_read_reads_what_is_there() {
    let mut rng = common::rng();
    for _ in 0..common::size(1_000) {
        let config = format!("seed={},device=mhm", rng.u32(..));
        let halts: Vec<(f64, u64)> = (0..rng.usize(1..=4))
            .map(|_| (rng.f64(), rng.u64(5_000..150_000)))
            .collect();
        let mut bench = bench(&config);
        let protocol = BissC::head_only();
        let mut master = Master::new(&mut bench.link, &protocol, None);
        assert!(master.open().unwrap());
        let mut registers = Registers::new(&mut master);
        let begin = bench.calls.get();
        *bench.halts.borrow_mut() = halts
            .iter()
            .map(|(at, ns)| (begin + (at * 1_600.0) as u64, *ns))
            .collect();
        let bytes = registers.read(0, 0x78, 8).unwrap();
        assert_eq!(bytes, b"MHM#D\0iC", "{config} {halts:?}");
    }
}

/// A write that is cut at every frame, and every row of bits that a slave can take from that frame for it: what the master sends
/// from there on writes nothing but what was to be written.
#[test]
fn no_cut_write_writes_anything_else() {
    let mut rng = common::rng();
    let rows: Vec<String> = (0..=3)
        .flat_map(|len| (0..1u8 << len).map(move |bits| format!("{bits:08b}")[8 - len..].into()))
        .collect();
    let mut longest = 0;
    for _ in 0..common::size(6) {
        let data = [rng.u8(..), rng.u8(..)];
        for cut in 1..=46 {
            for taken in &rows {
                let frames = cut_write(data, cut, taken);
                longest = longest.max(frames);
            }
        }
    }
    println!("out of it after {longest} frames at most");
    assert!(longest <= 40, "{longest}");
}

/// One such write; returns how many frames it takes to lead the slave out.
fn cut_write(data: [u8; 2], cut: usize, taken: &str) -> usize {
    let mut wire = Wire::new("frame=st2");
    wire.slave.record_events(true);
    let mut control = Control::new(false);
    control.set_retries(0);
    control
        .ask(Access::Write {
            slave: 0,
            address: ADDRESS,
            data: data.as_slice().into(),
        })
        .unwrap();
    let mut frames = 0;
    let mut after = 0;
    while control.is_busy() || !control.rests() {
        // All of this is within one access: reactions beyond it are not looked at.
        assert!(frames < 200);
        let table = control.cdm();
        let seen = if frames == usize::from(REST_FRAMES) + cut {
            wire.control(taken);
            // Three bits are those of a frame that went on to its end: the last of them is what was sent.
            let cdm = table[0];
            if taken.len() == 3 && taken.ends_with('1') != cdm {
                return 0;
            }
            Seen::Cut { cdm: Some(cdm) }
        } else {
            let cds = wire.react(table);
            after += usize::from(frames > usize::from(REST_FRAMES) + cut);
            Seen::Whole {
                cds,
                cdm: table[usize::from(cds)],
            }
        };
        control.seen(frames as u64 * 100_000, seen);
        frames += 1;
    }
    for event in wire.slave.take_events() {
        let wanted = matches!(event, Event::Write { address, value, .. } if (ADDRESS..).zip(data).any(|pair| pair == (address, value)));
        assert!(
            wanted,
            "{data:x?} cut at {cut}, {taken:?} taken: {event:x?}"
        );
    }
    after
}
