//! No heap allocation a frame: a counting allocator around the whole master.
#![allow(clippy::print_stdout, clippy::unwrap_used)]
#![allow(unsafe_code)]

use biss::control::Access;
use biss::frame::BissC;
use biss::link::sim::{Controller, SimBus};
use biss::link::wave::{Options, Wave};
use biss::link::{Link, sim};
use biss::master::Master;
use biss::slave::Config;
use biss::unit::Hertz;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    /// Of this thread: the one that runs the tests allocates too, whenever it wakes.
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

fn count() {
    ALLOCATIONS.set(ALLOCATIONS.get() + 1);
}

struct Counting;

// SAFETY: hands everything through to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's promises are passed on as they are.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

const PAIR: &str = "mt12,st24,nE,nW,crc6+mt12,st24,nE,nW,lc6,crc16";

/// Allocations of 1000 frames after the first ones, most of which are good. With registers, some are read all the time.
fn allocations(link: &mut dyn Link, registers: bool) -> u64 {
    let protocol = BissC::new(PAIR.parse().unwrap());
    let mut master = Master::new(link, &protocol, Some(1));
    master.open().unwrap();
    let access = Access::Read {
        slave: 0,
        address: 0x40,
        count: 8,
    };
    let mut read = 0;
    let mut run = |frames: u64| {
        if registers {
            master.ask(access).unwrap();
        }
        let before = ALLOCATIONS.get();
        let good = (0..frames)
            .filter(|_| {
                let good = master
                    .slot(0, None)
                    .map(|_| master.cycle().is_good())
                    .unwrap();
                if let Some(outcome) = master.outcome() {
                    assert_eq!(outcome.failure, None);
                    read += 1;
                    master.ask(access).unwrap();
                }
                good
            })
            .count();
        (ALLOCATIONS.get() - before, good)
    };
    run(100);
    let (allocations, good) = run(1000);
    assert!(good > 900, "{good}");
    assert_eq!(read > 5, registers, "{read} accesses");
    allocations
}

#[test]
fn a_frame_allocates_nothing() {
    let before = ALLOCATIONS.get();
    std::hint::black_box(Box::new(1));
    assert_eq!(ALLOCATIONS.get(), before + 1, "nothing is counted");
    let config = |text: &str| -> Config { format!("{text},frame={PAIR}").parse().unwrap() };
    let mut link = sim::open(config("delay=3.3us,busy=2us..6us,crc-error=5%"));
    link.set_clock(Hertz(2_000_000)).unwrap();
    assert_eq!(allocations(&mut link, false), 0, "edge by edge");
    let mut link = sim::open(config("busy=2us..6us,crc-error=5%"));
    assert_eq!(allocations(&mut link, true), 0, "with registers");
    let mut link = sim::open(config("slaves=each,sli=mo,busy=2us..6us,crc-error=5%"));
    link.set_clock(Hertz(2_000_000)).unwrap();
    assert_eq!(allocations(&mut link, false), 0, "a chain");
    let bus = SimBus::new(config("delay=3.3us,crc-error=5%"), Controller::default());
    let mut link = Wave::new(bus, Options::default(), Some(Hertz(2_000_000))).unwrap();
    assert_eq!(
        allocations(&mut link, true),
        0,
        "as a pattern, with registers"
    );
}
