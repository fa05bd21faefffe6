//! The promise, through a file: what a paused master recorded gives no frame that was not good live.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;
#[path = "common/paused.rs"]
mod paused;

use biss::cycle::{Cycle, Fault};
use biss::frame::{BissC, Stall};
use biss::link::bitbang::Bang;
use biss::link::sim::SimPins;
use biss::link::tap::Tap;
use biss::link::{Link, file};
use biss::master::{Master, Role, Slot, Try};
use biss::record::journal::{Entry, Journal};
use biss::record::{self, Head, Kind, Output, usual_rate};
use biss::unit::Hertz;
use biss::waveform::{Change, Waveform};
use common::{rng, size};
use fastrand::Rng;
use paused::Paused;
use std::cell::RefCell;
use std::io::{self, Cursor, Write};
use std::rc::Rc;

const SLOTS: usize = 40;
const KINDS: [Kind; 3] = [Kind::Vcd, Kind::Sr, Kind::Csv];

/// A file whose bytes are looked at when all is written.
#[derive(Clone, Default)]
struct Pipe(Rc<RefCell<Vec<u8>>>);

impl Write for Pipe {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().write(bytes)
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A frame as it was live.
#[derive(Debug)]
struct Frame {
    t_ns: u64,
    /// Its word, where it was good.
    word: Option<u64>,
    doubted: bool,
    fault: Option<Fault>,
}

/// What was captured.
struct Capture {
    frames: Vec<Frame>,
    /// For each kind of file.
    entries: [Vec<Entry>; 3],
    /// As a VCD that shows stalled frames as they were seen.
    plain: Vec<Entry>,
    rate: Hertz,
    end_ns: u64,
    /// Cycles that looked for a better place to sample.
    learning: usize,
}

fn word(cycle: &Cycle) -> Option<u64> {
    cycle.words().first().and_then(|word| word.good())
}

/// Slots of a slave whose master is paused up to so often in each.
fn capture(slave: &str, protocol: &BissC, pauses: usize, rng: &mut Rng) -> Capture {
    let pins = Rc::new(RefCell::new(SimPins::new(slave.parse().unwrap())));
    let plan = Rc::new(RefCell::new(Vec::new()));
    let call_ns = rng.u64(50..750);
    let mut link = Bang::new(Paused {
        pins,
        rng: Rng::with_seed(rng.u64(..)),
        call_ns,
        plan: Rc::clone(&plan),
        paused: Rc::default(),
    });
    if rng.bool() {
        let fastest = (1_000_000_000 / (5 * call_ns)) as u32;
        let hz = rng.u32(100_000..fastest.min(400_000));
        link.set_clock(Hertz(hz)).unwrap();
    }
    let tap = Rc::new(RefCell::new(Tap::new(Box::new(link))));
    let mut side = Rc::clone(&tap);
    let frames = RefCell::new(Vec::new());
    let journals = RefCell::new(KINDS.map(|kind| Journal::new(kind, true)));
    let plain = RefCell::new(Journal::new(Kind::Vcd, false));
    let on = RefCell::new(false);
    let learning = RefCell::new(0);
    let hear = |tried: &Try| {
        if !*on.borrow() {
            return;
        }
        let changes: Vec<Change> = tap.borrow_mut().take().collect();
        for journal in &mut *journals.borrow_mut() {
            journal.tell(changes.iter().copied(), tried);
        }
        plain.borrow_mut().tell(changes.iter().copied(), tried);
        *learning.borrow_mut() += usize::from(tried.role == Role::Learning);
        if tried.role == Role::Frame {
            let good = word(tried.cycle).filter(|_| tried.doubt.is_none());
            frames.borrow_mut().push(Frame {
                t_ns: tried.trace.t_ns,
                word: good,
                doubted: tried.doubt.is_some(),
                fault: tried.cycle.fault().or(tried.doubt),
            });
        }
    };
    let mut master = Master::new(&mut side, protocol, None);
    master.show_tries(&hear);
    master.open().unwrap();
    tap.borrow_mut().begin().unwrap();
    *on.borrow_mut() = true;
    let rate = match rng.bool() {
        true => usual_rate(master.link().clock().hz),
        false => {
            let least = master.link().clock().hz.0 * (record::LEAST_SAMPLES + 1);
            Hertz(least + rng.u32(..1_000_000))
        }
    };
    journals.borrow_mut()[1].sampled(rate);
    master.pause(200_000).unwrap();
    for _ in 0..SLOTS {
        for _ in 0..rng.usize(..=pauses) {
            plan.borrow_mut().push(rng.u32(1..125));
        }
        let at_ns = master.link().now_ns() + rng.u64(..2) * rng.u64(..100_000);
        assert!(matches!(
            master.slot(at_ns, None).unwrap(),
            Slot::Done { .. }
        ));
    }
    master.pause(200_000).unwrap();
    tap.borrow_mut().waveform(&mut Waveform::default()).unwrap();
    let changes: Vec<Change> = tap.borrow_mut().take().collect();
    let entries = journals.into_inner().map(|mut journal| {
        journal.rest(changes.iter().copied());
        journal.take().collect()
    });
    let end_ns = tap.borrow().now_ns();
    Capture {
        frames: frames.take(),
        entries,
        plain: plain.borrow_mut().take().collect(),
        rate,
        end_ns,
        learning: learning.take(),
    }
}

/// The good frames of a file of this kind: when they began, and their words.
fn read_back(
    capture: &Capture,
    kind: Kind,
    entries: &[Entry],
    protocol: &BissC,
    faults: &mut [usize; 10],
) -> Vec<(u64, u64)> {
    let pipe = Pipe::default();
    let first = *entries[0].change().unwrap();
    let head = Head {
        notes: &[],
        format: Some(&protocol.format),
        rate: capture.rate,
        first,
    };
    let output = Output::Stream(Box::new(pipe.clone()));
    let mut recorder = record::begin(kind, output, &head).unwrap();
    for entry in entries {
        match entry {
            Entry::Change(change) => recorder.change(change).unwrap(),
            Entry::Frame(t_ns, cycle) => recorder.frame(*t_ns, cycle).unwrap(),
        }
    }
    recorder.end(capture.end_ns).unwrap();
    drop(recorder);
    let bytes = pipe.0.take();
    let stalled = |frame: &Frame| matches!(frame.fault, Some(Fault::Stalled { .. }));
    if kind == Kind::Vcd && capture.frames.iter().any(stalled) {
        let said = String::from_utf8_lossy(&bytes);
        assert!(said.contains("\nsstalled:MA_stood"), "{said}");
    }
    let asked = file::Asked::new(protocol.timeout_max_ns.into());
    let input = file::Input::file(Cursor::new(bytes));
    let mut link = file::open(input, "captured", &asked).unwrap();
    let mut master = Master::new(&mut link, protocol, None);
    let mut good = Vec::new();
    // Samples begin with the recording.
    let zero_ns = if kind == Kind::Sr { first.t_ns } else { 0 };
    while master.slot(0, None).unwrap() != Slot::Ended {
        let of_word = || master.cycle().words().first().and_then(|word| word.fault());
        if let Some(fault) = master.cycle().fault().or_else(of_word) {
            faults[fault.index()] += 1;
        }
        if let Some(word) = word(master.cycle()) {
            good.push((zero_ns + master.trace().t_ns, word));
        }
    }
    good
}

#[derive(Default, Debug)]
struct Tally {
    live: usize,
    stalled: usize,
    doubted: usize,
    good: usize,
    read: [usize; 3],
    faults: [[usize; 10]; 3],
    /// Frames that would have read as good and were not.
    hidden: usize,
    plain: usize,
}

fn campaign(slave: &str, stall: Option<Stall>, rng: &mut Rng, tally: &mut Tally) {
    let delay = format!(
        "delay={}ns,busy=0us..{}ns",
        rng.u32(..15_000),
        rng.u32(..20_000)
    );
    let slave = slave.replace("any-delay", &delay);
    let slave = format!(
        "{slave},motion=count,seed={},frame=st26,nE,nW,crc6",
        rng.u32(..)
    );
    let mut protocol = BissC::new("st26,nE,nW,crc6".parse().unwrap());
    protocol.stall = stall.unwrap_or(protocol.stall);
    let capture = capture(&slave, &protocol, 2, rng);
    let frames = &capture.frames;
    tally.live += frames.len();
    let stalled = |frame: &&Frame| matches!(frame.fault, Some(Fault::Stalled { .. }));
    tally.stalled += frames.iter().filter(stalled).count();
    tally.doubted += frames.iter().filter(|frame| frame.doubted).count();
    let good = |frame: &&Frame| frame.word.is_some();
    tally.good += frames.iter().filter(good).count();
    // An edge stands as late in the file as it can have come.
    let sample_ns = 1_000_000_000 / u64::from(capture.rate.0) + 1;
    let begun = |t_ns: u64| frames.partition_point(|frame| frame.t_ns <= t_ns + sample_ns);
    let plain = read_back(&capture, Kind::Vcd, &capture.plain, &protocol, &mut [0; 10]);
    let was = |(t_ns, _): &(u64, u64)| frames[begun(*t_ns) - 1].word;
    tally.plain += plain.len();
    tally.hidden += plain
        .iter()
        .filter(|frame| was(frame) != Some(frame.1))
        .count();
    for (kind, entries) in capture.entries.iter().enumerate() {
        let faults = &mut tally.faults[kind];
        let read = read_back(&capture, KINDS[kind], entries, &protocol, faults);
        tally.read[kind] += read.len();
        for (t_ns, word) in read {
            let after = begun(t_ns);
            let what = || {
                format!(
                    "{slave}, {:?} at {}, {t_ns}: {word:#x}",
                    KINDS[kind], capture.rate
                )
            };
            let frame = after.checked_sub(1).map(|at| &frames[at]);
            let frame = frame.unwrap_or_else(|| panic!("no frame was sent: {}", what()));
            assert_eq!(frame.word, Some(word), "{frame:x?}, {}", what());
        }
    }
}

#[test]
fn no_frame_of_a_file_was_not_good_live() {
    let mut rng = rng();
    let campaigns = size(6);
    let mut tally = Tally::default();
    let adaptive = Some(Stall::Adaptive);
    for (slave, stall) in [
        ("timeout=12.5us", None),
        ("timeout=20us", None),
        ("timeout=40us", None),
        ("timeout=12.5us,timer=rising", None),
        ("timeout=adaptive", adaptive),
        ("timeout=adaptive,tclk=100ns", None),
        ("timeout=12.5us,crc-error=20%,any-delay", None),
        ("timeout=12.5us,timer=rising,any-delay", None),
        ("timeout=adaptive,any-delay", None),
        ("timeout=adaptive,any-delay", adaptive),
        ("timeout=20us,any-delay,jitter=100ns", None),
    ] {
        for _ in 0..campaigns {
            campaign(slave, stall, &mut rng, &mut tally);
        }
    }
    println!("{tally:?}");
    assert!(
        tally.stalled > 100 * campaigns && tally.hidden > 10 * campaigns,
        "the campaign shows nothing"
    );
    for read in tally.read {
        assert!(read * 10 > tally.good * 9, "good frames are lost");
    }
}

/// After three faults in a row the master looks for a better place to sample. No cycle of that is in the file, all others are.
#[test]
fn what_learns_is_left_out() {
    let mut rng = rng();
    let slave = "crc-error=60%,motion=count,delay=1.2us,seed=7,frame=st26,nE,nW,crc6";
    let protocol = BissC::new("st26,nE,nW,crc6".parse().unwrap());
    let capture = capture(slave, &protocol, 0, &mut rng);
    assert!(capture.learning > 20, "{} cycles", capture.learning);
    let good = capture.frames.iter().filter(|frame| frame.word.is_some());
    let good = good.count();
    for (kind, entries) in capture.entries.iter().enumerate() {
        let mut faults = [0; 10];
        let read = read_back(&capture, KINDS[kind], entries, &protocol, &mut faults);
        let all = read.len() + faults.iter().sum::<usize>();
        assert_eq!(
            (read.len(), all),
            (good, capture.frames.len()),
            "{faults:?}"
        );
    }
}
