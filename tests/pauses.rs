//! The promise, under fire: MA is paused before, inside and after the calls that move it, and no pause that made
//! the slave time out ends as a position.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;
#[path = "common/paused.rs"]
mod paused;

use biss::frame::BissC;
use biss::link::bitbang::{Bang, Pins};
use biss::link::sim::SimPins;
use biss::link::{Error, Link};
use biss::master::{Master, Slot};
use biss::slave::Config;
use biss::unit::Hertz;
use common::{rng, size};
use fastrand::Rng;
use paused::Paused;
use std::cell::RefCell;
use std::rc::Rc;

#[derive(Default, Debug)]
struct Tally {
    good: u64,
    faults: u64,
    restarted: u64,
    paused: u64,
}

/// `frames` frames, one or two pauses in most of them.
fn campaign(slave: &str, stall: Option<biss::frame::Stall>, frames: usize, rng: &mut Rng) -> Tally {
    let delay = format!(
        "delay={}ns,busy=0us..{}ns",
        rng.u32(..15_000),
        rng.u32(..20_000)
    );
    let slave = &slave.replace("any-delay", &delay);
    let config: Config = format!(
        "{slave},motion=count,seed={},frame=st26,nE,nW,crc6",
        rng.u32(..)
    )
    .parse()
    .unwrap();
    let pins = Rc::new(RefCell::new(SimPins::new(config)));
    let plan = Rc::new(RefCell::new(Vec::new()));
    let paused = Rc::new(RefCell::new(0));
    let call_ns = rng.u64(50..750);
    let mut link = Bang::new(Paused {
        pins: Rc::clone(&pins),
        rng: Rng::with_seed(rng.u64(..)),
        call_ns,
        plan: Rc::clone(&plan),
        paused: Rc::clone(&paused),
    });
    if rng.bool() {
        // Four calls a period, else an adaptive slave's timeout cannot be kept for certain.
        let fastest = (1_000_000_000 / (5 * call_ns)) as u32;
        link.set_clock(Hertz(rng.u32(100_000..fastest.min(400_000))))
            .unwrap();
    }
    let mut protocol = BissC::new("st26,nE,nW,crc6".parse().unwrap());
    protocol.stall = stall.unwrap_or(protocol.stall);
    let mut master = Master::new(&mut link, &protocol, Some(0));
    // A wandering busy time may need more frames than opening spends; the slots go on learning.
    master.open().unwrap();
    let mut tally = Tally::default();
    for _ in 0..frames {
        for _ in 0..rng.usize(..3) {
            plan.borrow_mut().push(rng.u32(1..125));
        }
        let timeouts = pins.borrow().slave().timeouts();
        assert!(matches!(master.slot(0, None).unwrap(), Slot::Done { .. }));
        let pins = pins.borrow();
        // The frame before ends with a timeout too, unless it was cut.
        tally.restarted += u64::from(pins.slave().timeouts() > timeouts + 1);
        match master.cycle().words().first().and_then(|word| word.good()) {
            Some(word) => {
                tally.good += 1;
                let trace = master.trace();
                let bits: String = trace
                    .bits
                    .iter()
                    .map(|b| if b { '1' } else { '0' })
                    .collect();
                assert_eq!(
                    word,
                    pins.slave().latched()[0],
                    "{slave}: a position that was not latched for this frame: {bits} {:?}, calls of {call_ns} ns, \
                     {} latches, {trace:?}, {:?}",
                    master.cycle().head(),
                    pins.slave().latches(),
                    master.link().notes(),
                );
            }
            None => tally.faults += 1,
        }
    }
    tally.paused = *paused.borrow();
    tally
}

#[test]
fn no_pause_yields_a_position() {
    let mut rng = rng();
    let adaptive = Some(biss::frame::Stall::Adaptive);
    let mut total = Tally::default();
    let campaigns = size(100);
    for (slave, stall) in [
        ("timeout=12.5us", None),
        ("timeout=20us", None),
        ("timeout=40us", None),
        ("timeout=12.5us,timer=rising", None),
        ("timeout=adaptive", None),
        ("timeout=adaptive", adaptive),
        ("timeout=adaptive,tclk=100ns", None),
        ("timeout=adaptive,tclk=100ns,timer=rising", None),
        ("timeout=request", None),
        ("timeout=12.5us,any-delay", None),
        ("timeout=12.5us,timer=rising,any-delay", None),
        ("timeout=adaptive,any-delay", None),
        ("timeout=adaptive,any-delay", adaptive),
        ("timeout=20us,any-delay,jitter=100ns", None),
    ] {
        let mut here = Tally::default();
        for _ in 0..campaigns {
            let tally = campaign(slave, stall, 120, &mut rng);
            here.good += tally.good;
            here.faults += tally.faults;
            here.restarted += tally.restarted;
            here.paused += tally.paused;
        }
        println!("{slave} {stall:?}: {here:?}");
        assert!(
            here.good > here.faults / 2 && here.restarted > 100,
            "{slave}: the campaign shows nothing"
        );
        total.paused += here.paused;
    }
    println!("{} pauses", total.paused);
    assert!(
        total.paused > 1_000 * campaigns as u64,
        "too few pauses: {}",
        total.paused
    );
}

/// Pins of a machine that is busy for a while: hardly a frame is not paused somewhere.
struct Busy {
    pins: SimPins,
    rng: Rng,
    busy: Rc<RefCell<bool>>,
}

impl Busy {
    fn pass(&mut self) {
        let pause = *self.busy.borrow() && self.rng.u32(..80) == 0;
        let ns = if pause {
            self.rng.u64(200..20_000)
        } else {
            100
        };
        self.pins.until(self.pins.now_ns() + ns);
    }
}

impl Pins for Busy {
    fn ma(&mut self, high: bool) -> Result<(), Error> {
        self.pass();
        self.pins.ma(high)
    }
    fn sl(&mut self) -> Result<bool, Error> {
        self.pass();
        self.pins.sl()
    }
    fn now_ns(&self) -> u64 {
        self.pins.now_ns()
    }
    fn until(&mut self, ns: u64) {
        self.pins.until(ns);
    }
    fn cost_ns(&self) -> (u64, u64) {
        (100, 100)
    }
    fn virtual_time(&self) -> bool {
        true
    }
}

/// With a line delay of whole clocks SL changes just where it is sampled first. The place to sample is looked for when a
/// link is opened, and must be found however busy the machine is then.
#[test]
fn the_place_to_sample_is_found_on_a_busy_machine() {
    let mut rng = rng();
    let (mut opened, mut faults) = (0usize, 0usize);
    for round in 0..size(1_000) {
        let clocks = rng.u32(1..=9);
        let config = format!(
            "motion=count,delay={}us,jitter=200ns,seed={round},frame=st26,nE,nW,crc6",
            4 * clocks
        );
        let busy = Rc::new(RefCell::new(true));
        let mut link = Bang::new(Busy {
            pins: SimPins::new(config.parse().unwrap()),
            rng: Rng::with_seed(rng.u64(..)),
            busy: Rc::clone(&busy),
        });
        let protocol = BissC::new("st26,nE,nW,crc6".parse().unwrap());
        let mut master = Master::new(&mut link, &protocol, None);
        // Where the start bit stands may need more frames than opening spends; the slots go on learning.
        master.open().unwrap();
        opened += 1;
        *busy.borrow_mut() = false;
        for _ in 0..10 {
            master.slot(0, None).unwrap();
            faults += usize::from(!master.cycle().is_good());
        }
    }
    println!("{faults} bad frames after {opened} openings");
    assert!(faults * 10 < opened, "{faults} of {opened}");
}

/// On a machine that is never anything but busy, pauses too short to restart the slave still move samples. Where a line
/// delay of whole clocks has several bits under way, that is what the CRC is left with.
#[test]
fn a_busy_machine_reads_next_to_nothing_wrong() {
    const SLOTS: usize = 100;
    let mut rng = rng();
    let (mut good, mut wrong) = (0usize, 0usize);
    let rounds = size(100);
    for round in 0..rounds {
        let delay_ns = match rng.bool() {
            true => 4_000 * rng.u32(1..=9),
            false => rng.u32(..38_000),
        };
        let pos = rng.u64(..1 << 26);
        let config = format!(
            "motion=count,pos={pos},delay={delay_ns}ns,jitter=200ns,seed={round},frame=st26,nE,nW,crc6"
        );
        let link = Rc::new(RefCell::new(Bang::new(Busy {
            pins: SimPins::new(config.parse().unwrap()),
            rng: Rng::with_seed(rng.u64(..)),
            busy: Rc::new(RefCell::new(true)),
        })));
        let protocol = BissC::new("st26,nE,nW,crc6".parse().unwrap());
        let mut shared = Rc::clone(&link);
        let mut master = Master::new(&mut shared, &protocol, None);
        master.open().unwrap();
        for _ in 0..SLOTS {
            let latches = || link.borrow_mut().pins_mut().pins.slave().latches();
            let before = latches();
            master.slot(0, None).unwrap();
            if let Some(word) = master.cycle().words().first().and_then(|word| word.good()) {
                let sent = (before..latches()).any(|n| (pos + n) % (1 << 26) == word >> 2);
                good += usize::from(sent && word & 3 == 3);
                wrong += usize::from(!sent || word & 3 != 3);
            }
        }
    }
    let slots = rounds * SLOTS;
    println!("{wrong} wrong positions and {good} good ones in {slots} slots");
    assert!(good * 10 > slots, "{good}: too busy to show anything");
    assert!(wrong * 10_000 <= slots, "{wrong} of {slots}");
}
