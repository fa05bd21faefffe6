//! Links that cannot see SL while they clock, as spidev: how many clocks are planned, where SL is sampled, and what
//! a restart that nobody saw can do.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;
#[path = "common/controller.rs"]
mod controller;

use biss::cycle::Fault;
use biss::frame::BissC;
use biss::link::Phase;
use biss::master::{Master, Slot};
use controller::Planned;
use std::rc::Rc;

const FORMAT: &str = "st26,nE,nW,crc6";

fn protocol() -> BissC {
    BissC::new(FORMAT.parse().unwrap())
}

/// Faults and good frames of some slots.
fn run(master: &mut Master, slots: usize) -> Vec<Option<Fault>> {
    (0..slots)
        .map(|_| {
            assert!(matches!(master.slot(0, None).unwrap(), Slot::Done { .. }));
            master
                .cycle()
                .fault()
                .or_else(|| master.cycle().words().iter().find_map(|w| w.fault()))
        })
        .collect()
}

#[test]
fn the_clocks_follow_what_the_encoder_needs() {
    let mut rng = common::rng();
    for _ in 0..common::size(300) {
        let hz = rng.u32(250_000..10_000_000);
        let (delay, busy) = (rng.u32(..35_000), rng.u32(..35_000));
        let config =
            format!("motion=count,delay={delay}ns,busy={busy}ns,timeout=20us,frame={FORMAT}");
        let mut link = Planned::new(&config, hz);
        let (pins, lengths) = (Rc::clone(&link.pins), Rc::clone(&link.lengths));
        let protocol = protocol();
        let mut master = Master::new(&mut link, &protocol, None);
        master.open().unwrap();
        lengths.borrow_mut().clear();
        for _ in 0..5 {
            let fault = run(&mut master, 1);
            assert_eq!(fault, [None], "{config} at {hz} Hz");
            let word = master.cycle().words()[0].good();
            assert_eq!(
                word,
                Some(pins.borrow().slave().latched()[0]),
                "{config} at {hz} Hz"
            );
        }
        let period = 1_000_000_000 / hz as usize;
        let needed = 39 + (delay as usize + busy as usize) / period;
        let most = lengths.borrow().iter().copied().max().unwrap();
        assert!(
            most <= needed + 4 + 2 + 8,
            "{most} clocks where {needed} do: {config} at {hz} Hz"
        );
    }
}

/// A frame with fewer than two surplus clocks is asked for again with more.
#[test]
fn two_surplus_clocks_at_least_are_checked() {
    for ack in 1..60 {
        let mut link = Planned::new(&format!("motion=count,ack={ack},frame={FORMAT}"), 1_000_000);
        let protocol = protocol();
        let mut master = Master::new(&mut link, &protocol, None);
        master.open().unwrap();
        let faults = run(&mut master, 3);
        if ack > 40 {
            assert!(
                faults
                    .iter()
                    .all(|f| matches!(f, Some(Fault::NoStart { clocks: 40 }))),
                "{ack}: {faults:?}"
            );
            continue;
        }
        assert_eq!(faults, [None; 3], "{ack}");
        let head = master.cycle().head().unwrap();
        let frame = 2 + usize::from(head.clocks()) + 34 + 3;
        assert!(master.trace().bits.len() > frame, "{ack}");
    }
}

#[test]
fn a_dead_line_is_named_and_left_behind() {
    for (stuck, ready) in [("stuck=1", false), ("stuck=0", true)] {
        let mut link = Planned::new(&format!("{stuck},frame={FORMAT}"), 1_000_000);
        let protocol = protocol();
        let mut master = Master::new(&mut link, &protocol, None);
        assert!(!master.open().unwrap());
        let faults = run(&mut master, 20);
        let named = |f: &Option<Fault>| match f {
            Some(Fault::NotReady { .. }) => ready,
            Some(Fault::NoAck { .. }) => !ready,
            _ => false,
        };
        assert!(faults.iter().all(named), "{faults:?}");
    }
    // Not answering for a while, then well: the clocks shrink again to what is needed.
    let mut link = Planned::new(&format!("no-ack=60%,seed=8,frame={FORMAT}"), 1_000_000);
    let lengths = Rc::clone(&link.lengths);
    let protocol = protocol();
    let mut master = Master::new(&mut link, &protocol, None);
    master.open().unwrap();
    let faults = run(&mut master, 200);
    assert!(faults.iter().filter(|f| f.is_none()).count() > 50);
    assert_eq!(lengths.borrow().iter().min(), Some(&48));
}

/// SL changes just where one of the two modes samples: the other one is taken, and its frames are steady.
#[test]
fn the_steadier_phase_is_taken() {
    for (delay, phase) in [
        // With mode 2 sampling just there, mode 3 is as far from it as can be.
        ("480ns", Phase::Whole),
        ("990ns", Phase::Half),
        ("20ns", Phase::Whole),
        ("300ns", Phase::Whole),
    ] {
        let config = format!("motion=speed,delay={delay},jitter=40ns,frame={FORMAT}");
        // The rising edge comes half a period after the falling one with which mode 2 samples.
        let mut link = Planned::new(&config, 1_000_000);
        let protocol = protocol();
        let good = {
            let mut master = Master::new(&mut link, &protocol, None);
            assert!(master.open().unwrap(), "{delay}");
            run(&mut master, 100).iter().filter(|f| f.is_none()).count()
        };
        assert_eq!(good, 100, "{delay}");
        assert_eq!(link.phase, phase, "{delay}");
    }
}

/// A gap in the clock that spidev cannot see, in mid-frame, at random: what CRC-6, stop, surplus bits and the learned
/// start bit let pass. At most 0.2 % may; the figure is printed.
#[test]
fn restarts_that_nobody_sees_hardly_pass() {
    let mut rng = common::rng();
    let rounds = common::size(40_000);
    let (mut restarts, mut wrong) = (0, 0);
    let mut round = 0;
    while round < rounds {
        let seed = rng.u32(..);
        let config = format!(
            "motion=speed,rpm=1234.5,pos={},seed={seed},timeout=20us,frame={FORMAT}",
            rng.u32(..1 << 26)
        );
        let mut link = Planned::new(&config, 2_000_000);
        let (pins, gap) = (Rc::clone(&link.pins), Rc::clone(&link.gap));
        let protocol = protocol();
        let mut master = Master::new(&mut link, &protocol, Some(0));
        assert!(master.open().unwrap());
        for _ in 0..400 {
            round += 1;
            *gap.borrow_mut() = Some((rng.usize(3..39), rng.u64(21_000..60_000)));
            let latches = pins.borrow().slave().latches();
            master.slot(0, None).unwrap();
            // A doubtful frame is read again, without a gap: then nothing has restarted.
            let pins = pins.borrow();
            restarts += u64::from(pins.slave().latches() > latches + 1);
            if let Some(word) = master.cycle().words().first().and_then(|w| w.good()) {
                wrong += u64::from(word != pins.slave().latched()[0]);
            }
        }
    }
    let percent = wrong as f64 / restarts as f64 * 100.0;
    println!("{wrong} of {restarts} restarted frames gave a wrong position: {percent:.3} %");
    assert!(restarts > rounds as u64 / 2);
    assert!(percent < 0.2, "{percent:.3} %");
}
