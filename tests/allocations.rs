//! No heap allocation a frame: a counting allocator around the whole master.
#![allow(clippy::print_stdout, clippy::unwrap_used)]
#![allow(unsafe_code)]

use biss::frame::BissC;
use biss::link::{Link, sim};
use biss::master::Master;
use biss::slave::Config;
use biss::unit::Hertz;
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicU64, Ordering};

static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);

struct Counting;

// SAFETY: hands everything through to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller's promises are passed on as they are.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

#[test]
fn a_frame_allocates_nothing() {
    let pair = "mt12,st24,nE,nW,crc6+mt12,st24,nE,nW,lc6,crc16";
    let config: Config = format!("delay=3.3us,busy=2us..6us,crc-error=5%,frame={pair}")
        .parse()
        .unwrap();
    let protocol = BissC::new(config.format.clone());
    let mut link = sim::open(config);
    link.set_clock(Hertz(2_000_000)).unwrap();
    let mut master = Master::new(&mut link, &protocol, Some(1));
    master.open().unwrap();
    let mut run = |frames: u64| {
        let before = ALLOCATIONS.load(Ordering::Relaxed);
        let good = (0..frames)
            .filter(|_| {
                master
                    .slot(0, None)
                    .map(|_| master.cycle().is_good())
                    .unwrap()
            })
            .count();
        (ALLOCATIONS.load(Ordering::Relaxed) - before, good)
    };
    run(100);
    let (allocations, good) = run(1000);
    assert!(good > 900, "{good}");
    assert_eq!(allocations, 0, "in 1000 frames");
}
