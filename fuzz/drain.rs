//! Reads a recording to its end, as `biss read` does: no panic, no endless loop, bounded memory. `README.md` says how to run it.

use biss::control::Listener;
use biss::frame::BissC;
use biss::link::file::{self, Asked, Input};
use biss::master::{Master, Slot};
use std::alloc::{GlobalAlloc, Layout, System};
use std::io::Cursor;
use std::sync::atomic::{AtomicUsize, Ordering};

/// What a reader may need, the recording itself included. The tables of libFuzzer do not count.
const HEAP_LIMIT: usize = 64 << 20;

/// Counts what is allocated, and has no more to give at the limit: the stack of who has asked for it says where.
struct Counted;

#[global_allocator]
static HEAP: Counted = Counted;
static USED: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

// SAFETY: everything is passed on to the system's allocator as it came.
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let used = USED.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        if used > HEAP_LIMIT {
            USED.fetch_sub(layout.size(), Ordering::Relaxed);
            return std::ptr::null_mut();
        }
        PEAK.fetch_max(used, Ordering::Relaxed);
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        USED.fetch_sub(layout.size(), Ordering::Relaxed);
        unsafe { System.dealloc(at, layout) }
    }
}

/// Says when an input has needed clearly more than all before it.
fn tell_peak() {
    static TOLD: AtomicUsize = AtomicUsize::new(0);
    let (peak, told) = (PEAK.load(Ordering::Relaxed), TOLD.load(Ordering::Relaxed));
    if peak > told + told / 16 {
        TOLD.store(peak, Ordering::Relaxed);
        eprintln!("heap: {} KiB at most", peak >> 10);
    }
}

/// `head` before the rest of `data` where its first byte is odd, so that both heads and what follows them are fuzzed.
pub fn with_head(head: &[u8], data: &[u8]) -> Vec<u8> {
    let (first, rest) = data.split_first().unwrap_or((&0, &[]));
    let head = if first % 2 == 1 { head } else { b"" };
    [head, rest].concat()
}

/// From a file and from a pipe, one channel.
pub fn drain(bytes: &[u8], asked: impl Fn(&mut Asked)) {
    drain_as(bytes, "st12,nE,nW,crc6", asked);
}

/// From a file and from a pipe.
pub fn drain_as(bytes: &[u8], format: &str, asked: impl Fn(&mut Asked)) {
    let protocol = BissC::new(format.parse().expect("a format"));
    for pipe in [false, true] {
        let bytes = Cursor::new(bytes.to_vec());
        let input = if pipe { Input::pipe(bytes) } else { Input::file(bytes) };
        let mut how = Asked::new(40_000);
        asked(&mut how);
        let Ok(mut link) = file::open(input, "fuzzed", &how) else {
            continue;
        };
        let mut master = Master::new(&mut link, &protocol, None);
        if pipe {
            master.keep_waveform();
        }
        let mut listener = Listener::default();
        while let Ok(slot @ (Slot::Done { .. } | Slot::Piece(_))) = master.slot(0, None) {
            let (trace, cycle) = (master.trace(), master.cycle());
            match (slot, cycle.fault(), cycle.head(), trace.cdm) {
                (Slot::Done { .. }, None, Some(head), Some(cdm)) => {
                    listener.frame(trace.t_ns, cdm, head.cds)
                }
                _ => listener.lost(),
            };
        }
    }
    tell_peak();
}
