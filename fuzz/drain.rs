//! Reads a recording to its end, as `biss read` does: no panic, no endless loop, bounded memory.
//!
//! ```sh
//! cargo install cargo-fuzz
//! cargo +nightly fuzz run vcd -- -max_total_time=300 -rss_limit_mb=64
//! ```

use biss::frame::BissC;
use biss::link::file::{self, Asked, Input};
use biss::master::{Master, Slot};
use std::io::Cursor;

/// `head` before the rest of `data` where its first byte is odd, so that both heads and what follows them are fuzzed.
pub fn with_head(head: &[u8], data: &[u8]) -> Vec<u8> {
    let (first, rest) = data.split_first().unwrap_or((&0, &[]));
    let head = if first % 2 == 1 { head } else { b"" };
    [head, rest].concat()
}

/// From a file and from a pipe.
pub fn drain(bytes: &[u8], asked: impl Fn(&mut Asked)) {
    for pipe in [false, true] {
        let bytes = Cursor::new(bytes.to_vec());
        let input = if pipe { Input::pipe(bytes) } else { Input::file(bytes) };
        let mut how = Asked::new(40_000);
        asked(&mut how);
        let Ok(mut link) = file::open(input, "fuzzed", &how) else {
            continue;
        };
        let protocol = BissC::new("st12,nE,nW,crc6".parse().expect("a format"));
        let mut master = Master::new(&mut link, &protocol, None);
        while let Ok(Slot::Done { .. } | Slot::Piece(_)) = master.slot(0, None) {}
    }
}
