//! What live links write down of both wires is what was on them, and reads back to the frames that were read.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;
#[path = "common/pushed.rs"]
mod pushed;

use biss::frame::{BissC, Stall};
use biss::link::bitbang::{Bang, Pins};
use biss::link::sim::{Controller, SimBus, SimPins};
use biss::link::tap::Tap;
use biss::link::wave::{Options, Wave};
use biss::link::{Error, Link, sim};
use biss::master::{Master, Slot};
use biss::slave::{Config, Slave};
use biss::slice::Slicer;
use biss::unit::Hertz;
use biss::waveform::{Change, Waveform};
use common::{rng, size};
use fastrand::Rng;
use pushed::{Pushed, Words, all_frames, good};
use std::cell::RefCell;
use std::rc::Rc;

fn config(text: &str) -> Config {
    text.parse().unwrap_or_else(|e| panic!("{text}: {e}"))
}

/// What came of it: the words of every good frame, and all changes on the wires meanwhile.
struct Run {
    words: Words,
    /// Frames that were not good.
    bad: usize,
    /// Frames that were read again.
    repeated: usize,
    changes: Vec<Change>,
    end_ns: u64,
}

/// Reads frames and takes down the wires from the link's first moment, or from its first frame on.
fn run(link: Box<dyn Link>, protocol: &BissC, frames: usize, all: bool) -> Run {
    let tap = Rc::new(RefCell::new(Tap::new(link)));
    let mut side = Rc::clone(&tap);
    if all {
        tap.borrow_mut().begin().unwrap();
    }
    let mut master = Master::new(&mut side, protocol, Some(0));
    master.open().unwrap();
    if !all {
        tap.borrow_mut().begin().unwrap();
    }
    master.pause(100_000).unwrap();
    let (mut words, mut bad, mut repeated) = (Vec::new(), 0, 0);
    for _ in 0..frames {
        let Slot::Done { tries } = master.slot(0, None).unwrap() else {
            panic!("the link is live");
        };
        repeated += tries as usize - 1;
        match good(&master) {
            Some(good) => words.push(good),
            None => bad += 1,
        }
    }
    master.pause(100_000).unwrap();
    let mut tap = tap.borrow_mut();
    let mut rest = Waveform::default();
    tap.waveform(&mut rest).unwrap();
    let end_ns = tap.now_ns();
    let changes: Vec<Change> = tap.take().collect();
    for pair in changes.windows(2) {
        assert!(pair[0].t_ns < pair[1].t_ns, "{pair:?}");
        let differ = pair[0].ma != pair[1].ma || pair[0].slo != pair[1].slo;
        assert!(differ, "{pair:?}");
    }
    Run {
        words,
        bad,
        repeated,
        changes,
        end_ns,
    }
}

/// The good frames of what was taken down, and what else there is.
fn read_back(run: &Run, protocol: &BissC) -> (Words, Vec<String>) {
    let mut slicer = Slicer::new(protocol.timeout_max_ns.into());
    for change in &run.changes {
        slicer.push(change.t_ns, change.ma, change.slo);
    }
    slicer.finish(run.end_ns);
    all_frames(&mut Pushed(slicer), protocol)
}

/// The same slave once more, clocked as MA was: its SLO must change when and as the waveform says, and not else.
fn replay(config: &Config, run: &Run) {
    let mut slave = Slave::new(config.clone());
    let (mut ma, mut slo) = (true, slave.slo(0));
    let mut changes = run.changes.iter().peekable();
    let first = changes.next().unwrap();
    assert_eq!((first.t_ns, first.ma, first.slo), (0, ma, Some(slo)));
    loop {
        let asked = changes.peek().map(|change| change.t_ns);
        let moves = slave.next_change().filter(|at| *at <= run.end_ns);
        let Some(t_ns) = asked.into_iter().chain(moves).min() else {
            break;
        };
        let before = slo;
        slo = slave.slo(t_ns);
        let change = changes.next_if(|change| change.t_ns == t_ns);
        if let Some(change) = change.filter(|change| change.ma != ma) {
            ma = change.ma;
            slave.ma(t_ns, ma);
            slo = slave.slo(t_ns);
        }
        assert_eq!(change.is_some_and(|c| c.slo != Some(before)), slo != before);
        assert!(
            change.is_none_or(|change| change.slo == Some(slo)),
            "{t_ns}"
        );
    }
    assert_eq!(changes.next(), None);
}

/// `sim` shows every change of both wires at its own time: between cycles, in INIT and at rest too.
#[test]
fn sim_takes_down_what_the_slave_did() {
    let mut rng = rng();
    for round in 0..size(40) {
        let delay = rng.u32(0..40_000);
        let power_up = ["high", "low"][round % 2];
        let text = format!(
            "power-up={power_up},delay={delay}ns,jitter={}ns,busy=0us..{}us,timeout={},seed={round},\
             no-ack=3%,no-start=3%,crc-error=5%,frame={}",
            rng.u32(0..80),
            rng.u32(0..20),
            rng.choice(["20us", "adaptive", "12.5us", "40us"]).unwrap(),
            common::format(&mut rng),
        );
        let config = config(&text);
        let mut link = sim::open(config.clone());
        link.set_clock(Hertz(rng.u32(100_000..5_000_000))).unwrap();
        let protocol = BissC::new(config.format.clone());
        println!("{text}");
        let run = run(Box::new(link), &protocol, 20, true);
        assert!(run.words.len() + run.bad == 20);
        replay(&config, &run);
    }
}

/// Nothing changes for whoever reads when somebody looks on.
#[test]
fn a_look_changes_nothing() {
    let text = "jitter=50ns,busy=0us..9us,crc-error=10%,no-ack=5%,delay=2.3us,seed=9";
    let protocol = BissC::new(config(text).format);
    let (mut plain, mut watched) = (sim::open(config(text)), sim::open(config(text)));
    let mut seen = [Vec::new(), Vec::new()];
    for (look, link) in [&mut plain, &mut watched].into_iter().enumerate() {
        let mut master = Master::new(link, &protocol, None);
        if look == 1 {
            master.keep_waveform();
        }
        master.open().unwrap();
        for _ in 0..200 {
            master.slot(0, None).unwrap();
            let trace = master.trace();
            seen[look].push((trace.t_ns, trace.bits.to_string(), trace.waited_ns));
            assert_eq!(trace.wave.is_some(), look == 1);
        }
    }
    assert_eq!(seen[0], seen[1]);
}

/// Pins whose calls take time, one or two pauses in a hundred of them.
struct Slow {
    pins: SimPins,
    rng: Rng,
    set_ns: u64,
    get_ns: u64,
    /// Longest pause in or after a call, and how often in 10000.
    pause_ns: u64,
    pauses: u32,
    /// What the slave has latched.
    sent: Rc<RefCell<Vec<u64>>>,
}

impl Slow {
    fn call(&mut self, usual_ns: u64) -> (u64, u64) {
        let now = self.pins.now_ns();
        let mut at = now + usual_ns / 2 + self.rng.u64(0..=usual_ns / 8);
        let mut end = at + usual_ns / 2;
        if self.rng.u32(..10_000) < self.pauses {
            let pause_ns = self.rng.u64(0..=self.pause_ns);
            end += pause_ns;
            // Before the line moved, or after.
            at += if self.rng.bool() { pause_ns } else { 0 };
        }
        (at, end)
    }
}

impl Pins for Slow {
    fn ma(&mut self, high: bool) -> Result<(), Error> {
        let (at, end) = self.call(self.set_ns);
        self.pins.until(at);
        let latches = self.pins.slave().latches();
        self.pins.ma(high)?;
        if self.pins.slave().latches() > latches {
            let word = self.pins.slave().latched()[0];
            self.sent.borrow_mut().push(word);
        }
        self.pins.until(end);
        Ok(())
    }
    fn sl(&mut self) -> Result<bool, Error> {
        let (at, end) = self.call(self.get_ns);
        self.pins.until(at);
        let level = self.pins.sl()?;
        self.pins.until(end);
        Ok(level)
    }
    fn now_ns(&self) -> u64 {
        self.pins.now_ns()
    }
    fn until(&mut self, ns: u64) {
        self.pins.until(ns);
    }
    fn cost_ns(&self) -> (u64, u64) {
        (self.set_ns, self.get_ns)
    }
    fn virtual_time(&self) -> bool {
        true
    }
}

/// All frames come back as they were read; those that the master repeated are there too.
fn comes_back(run: &Run, protocol: &BissC) {
    let (words, others) = read_back(run, protocol);
    if run.repeated == 0 {
        assert_eq!(words, run.words, "{others:#?}");
        assert_eq!(others.len(), run.bad, "{others:#?}");
    }
    let mut read = words.iter();
    for word in &run.words {
        assert!(read.any(|read| read == word), "{word:?} {others:#?}");
    }
    assert!(words.len() <= run.words.len() + run.repeated);
}

const FORMAT: &str = "mt12,st20,nE,nW,crc6";

#[test]
fn pins_read_back() {
    let mut rng = rng();
    let (rounds, mut good, mut missing) = (size(150), 0, 0);
    for round in 0..rounds {
        let pauses = [0, 60][round % 2];
        let text = format!(
            "motion=count,delay={}ns,ack={},timeout={},frame={FORMAT}",
            rng.u32(0..40_000),
            rng.u32(1..=6),
            rng.choice(["20us", "adaptive", "12.5us", "40us"]).unwrap(),
        );
        let sent = Rc::new(RefCell::new(Vec::new()));
        let pins = Slow {
            pins: SimPins::new(config(&text)),
            rng: Rng::with_seed(rng.u64(..)),
            set_ns: rng.u64(50..600),
            get_ns: rng.u64(50..600),
            pause_ns: rng.u64(0..30_000),
            pauses,
            sent: Rc::clone(&sent),
        };
        let calls_ns = 6 * (2 * pins.set_ns + pins.get_ns);
        let mut link = Bang::new(pins);
        // Room for the calls, and for SL to be sampled away from where it changes.
        let hz = rng.u32(90_000..(1_000_000_000 / calls_ns).min(400_000) as u32);
        link.set_clock(Hertz(hz)).unwrap();
        println!("{text} {hz}");
        let protocol = BissC::new(FORMAT.parse().unwrap());
        let run = run(Box::new(link), &protocol, 30, false);
        // A recording may show as good what the master could not be sure of, but only what was sent.
        let (words, others) = read_back(&run, &protocol);
        let sent = sent.borrow();
        for word in words.iter().filter(|word| !run.words.contains(word)) {
            assert!(sent.contains(&word[0]), "{word:?}: {others:#?}");
        }
        let lost = run.words.iter().filter(|word| !words.contains(word));
        let lost = lost.count();
        assert!(pauses > 0 || lost == 0, "{lost} lost: {others:#?}");
        good += run.words.len();
        missing += lost;
    }
    // A slave that began anew in a pause may hide the frames after it.
    assert!(100 * missing <= good, "{missing} of {good} lost");
    // At some clocks the calls leave no room for a bit.
    assert!(good > 20 * rounds, "{good} in {rounds} rounds");
}

#[test]
fn patterns_read_back() {
    let mut rng = rng();
    let (rounds, mut good) = (size(60), 0);
    for round in 0..rounds {
        let text = format!(
            "motion=count,delay={}ns,ack={},timeout=20us,frame={FORMAT}",
            rng.u32(0..40_000),
            rng.u32(1..=6),
        );
        let bus = SimBus::new(config(&text), Controller::default());
        let options = Options {
            invert: round % 3 == 1,
            ..Options::default()
        };
        let hz = Hertz(rng.u32(100_000..5_000_000));
        let controller = Controller {
            swapped: options.invert,
            ..Controller::default()
        };
        let bus = match options.invert {
            true => SimBus::new(config(&text), controller),
            false => bus,
        };
        let link = Wave::new(bus, options, Some(hz)).unwrap();
        println!("{text} {hz}");
        let mut protocol = BissC::new(FORMAT.parse().unwrap());
        protocol.stall = Stall::Static { min_ns: 20_000 };
        let run = run(Box::new(link), &protocol, 20, false);
        good += run.words.len();
        comes_back(&run, &protocol);
    }
    assert!(good > 15 * rounds, "{good} in {rounds} rounds");
}
