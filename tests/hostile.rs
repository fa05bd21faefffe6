//! Recordings that are broken or mean harm: reading them ends, without a panic, and within little memory.
#![allow(clippy::print_stdout, clippy::unwrap_used)]
#![allow(unsafe_code)]

mod common;

use biss::link::{Link, file};
use biss::trace::{Ask, Clocks, Trace, Until};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::io::{Cursor, Read};

thread_local! {
    /// Bytes of this thread, now and at most.
    static LIVE: Cell<usize> = const { Cell::new(0) };
    static PEAK: Cell<usize> = const { Cell::new(0) };
}

fn grows(from: usize, to: usize) {
    let live = LIVE.get().saturating_sub(from) + to;
    LIVE.set(live);
    PEAK.set(PEAK.get().max(live));
}

struct Measuring;

// SAFETY: hands everything through to the system's allocator.
unsafe impl GlobalAlloc for Measuring {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        grows(0, layout.size());
        // SAFETY: the caller's promises are passed on as they are.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        grows(layout.size(), 0);
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // Both may live for a moment.
        grows(0, size);
        grows(layout.size(), 0);
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static MEASURING: Measuring = Measuring;

/// Reads everything: cycles, and what was said at the end.
fn read(input: impl Read + 'static, ma: Option<&str>, slo: Option<&str>) -> (u64, String) {
    let asked = file::Asked {
        ma: ma.map(str::to_owned),
        slo: slo.map(str::to_owned),
        ..file::Asked::new(40_000)
    };
    read_as(file::Input::pipe(input), &asked)
}

fn read_as(input: file::Input, asked: &file::Asked) -> (u64, String) {
    let mut link = match file::open(input, "it", asked) {
        Ok(link) => link,
        Err(error) => return (0, error.to_string()),
    };
    let ask = Ask {
        at_ns: 0,
        clocks: Clocks {
            until: Until::Clocks(1),
            surplus: 0,
            stretch_ns: 0,
            cdm: [false; 2],
            hold_ns: 0,
            ready_ns: None,
            partial: false,
        },
    };
    let mut traces = [Trace::default()];
    let mut cycles = 0;
    loop {
        match link.cycles(&[ask], &mut traces) {
            Ok(1) => cycles += 1,
            Ok(_) => return (cycles, String::new()),
            Err(error) => return (cycles, error.to_string()),
        }
    }
}

/// A beginning, then pieces with their number for `@`, so many bytes.
struct Endless {
    now: Cursor<Vec<u8>>,
    piece: &'static str,
    made: usize,
    left: usize,
}

impl Endless {
    fn new(head: &str, piece: &'static str, bytes: usize) -> Endless {
        Endless {
            now: Cursor::new(head.into()),
            piece,
            made: 0,
            left: bytes,
        }
    }
}

impl Read for Endless {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let n = self.now.read(buffer)?;
        if n > 0 || self.left == 0 {
            return Ok(n);
        }
        let mut next = Vec::new();
        while next.len() < 1 << 16 {
            self.made += 1;
            next.extend_from_slice(self.piece.replace('@', &self.made.to_string()).as_bytes());
        }
        self.left = self.left.saturating_sub(next.len());
        self.now = Cursor::new(next);
        self.now.read(buffer)
    }
}

const VCD: &str =
    "$timescale 1ns $end $var wire 1 ! ma $end $var wire 1 \" slo $end $var wire 9 # v $end ";

#[test]
fn no_input_fills_the_memory() {
    let body = format!("{VCD}$enddefinitions $end\n#0 1! 1\"\n");
    let mb = 1 << 20;
    let bytes = common::size(8) * mb;
    for (head, piece, said, most) in [
        // Headers.
        ("$comment ", "word ", "before `$enddefinitions`", 4 * mb),
        ("$comment ", "word", "more than 1 MiB", 8 * mb),
        ("$timescale ", "1 ", "more than 64 KiB", 4 * mb),
        (
            VCD,
            "$scope module deep@ $end ",
            "nested too deeply",
            4 * mb,
        ),
        (VCD, "$var wire 1 a@ name@ $end ", "more signals", 48 * mb),
        (VCD, "$var wire 2 a@ name@ $end ", "more signals", 48 * mb),
        (VCD, "$var string 1 a@ name@ $end ", "more signals", 48 * mb),
        (
            VCD,
            "$var wire 1 a@ name [@] $end ",
            "more signals",
            48 * mb,
        ),
        (VCD, "\n", "before `$enddefinitions`", 4 * mb),
        ("", "; a comment\n", "no rows", 4 * mb),
        ("", "column,", "more than 1 MiB", 8 * mb),
        (
            "",
            "a,b,c,d,e,f,g,h,i,j,k,l,m,n,o,p,q,r,s,t,u,v,w,x,y,z\nx",
            "unit",
            4 * mb,
        ),
        // What follows.
        (&body, "b", "more than 1 MiB", 8 * mb),
        (&body, " ", "", 8 * mb),
        (&body, "0\"1\"", "more than 1 MiB", 8 * mb),
        (&body, "0\" 1\" ", "", 8 * mb),
        (&body, "#@ bx01 # 0\" ", "", 8 * mb),
        (&body, "#@ 0! #@0 1! ", "backwards", 8 * mb),
        (&body, "$comment ", "without `$end`", 8 * mb),
        ("Time [ns],MA,SLO\n", "@000,0,1\n@500,1,0\n", "", 8 * mb),
        (
            "Time [ns],MA,SLO\n",
            "@00000,0,1\n@00100,1,0\n@00200,0,1\n@00300,1,1\n",
            "",
            8 * mb,
        ),
        ("Time [ns],MA,SLO\n0,1,1\n", "1", "more than 1 MiB", 8 * mb),
        ("Time [ns],MA,SLO\n0,1,1\n", "\n", "", 8 * mb),
        ("; Samplerate: 1 MHz\nMA,SLO\n", "1,1\n", "", 8 * mb),
    ] {
        let before = LIVE.get();
        PEAK.set(before);
        let (cycles, end) = read(Endless::new(head, piece, bytes), None, None);
        let peak = PEAK.get() - before;
        println!("{peak:9} bytes, {cycles} cycles: {piece:?}: {end}");
        assert!(peak < most, "{piece:?}: {peak} bytes");
        let as_said = if said.is_empty() {
            end.is_empty()
        } else {
            end.contains(said)
        };
        assert!(as_said, "{piece:?}: {end}");
    }
}

fn spoil(rng: &mut fastrand::Rng, bytes: &mut Vec<u8>) {
    for _ in 0..rng.usize(1..6) {
        if bytes.is_empty() {
            return;
        }
        let at = rng.usize(..bytes.len());
        match rng.u8(..6) {
            0 => bytes[at] = rng.u8(..),
            1 => bytes[at] = *rng.choice(b"01xb#$,;\t\n\r\".-e @").unwrap(),
            2 => drop(bytes.drain(at..(at + rng.usize(1..20)).min(bytes.len()))),
            3 => bytes.truncate(at),
            4 => bytes.insert(at, *rng.choice(b"09xb#$,;\t\n\r\".-e @").unwrap()),
            _ => {
                let end = (at + rng.usize(1..200)).min(bytes.len());
                let piece = bytes[at..end].to_vec();
                let to = rng.usize(..bytes.len());
                bytes.splice(to..to, piece);
            }
        }
    }
}

#[test]
fn spoiled_recordings_end_in_peace() {
    let mut rng = common::rng();
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/recordings");
    let mut kept: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|f| f.unwrap().path())
        .collect();
    kept.retain(|path| path.extension().is_some_and(|e| e == "csv" || e == "vcd"));
    kept.sort();
    let kept: Vec<Vec<u8>> = kept
        .iter()
        .map(|path| std::fs::read(path).unwrap())
        .collect();
    let (mut good, mut cycles) = (0, 0);
    for _ in 0..common::size(3_000) {
        let mut bytes = rng.choice(&kept).unwrap().clone();
        let whole = bytes.len() as u64;
        spoil(&mut rng, &mut bytes);
        let before = LIVE.get();
        PEAK.set(before);
        let (n, said) = read(Cursor::new(bytes), None, None);
        let peak = PEAK.get() - before;
        // No cycle comes from nothing.
        assert!(n < whole, "{n} cycles: {said}");
        assert!(peak < 8 << 20, "{peak} bytes: {said}");
        good += u64::from(said.is_empty());
        cycles += n;
    }
    println!("{good} read to the end, {cycles} cycles");
}

/// Sessions and samples alone, from a file and from a pipe, with names and without.
#[test]
fn spoiled_samples_end_in_peace() {
    use common::sampled;
    let mut rng = common::rng();
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/recordings");
    let kept = |name: &str| std::fs::read(folder.join(name)).unwrap();
    let raw = kept("far.bin");
    let metadata = sampled::METADATA.replace("RATE", "20 MHz");
    let entries: [(&str, &[u8]); 4] = [
        ("version", b"2"),
        ("metadata", metadata.as_bytes()),
        ("logic-1-1", &raw[..2_000]),
        ("logic-1-2", &raw[2_000..]),
    ];
    let stored = sampled::zip(&entries, zip::CompressionMethod::Stored);
    let noise: Vec<u8> = (0..1 << 15).map(|_| rng.u8(..)).collect();
    let all = [kept("bench.sr"), kept("unnamed.sr"), stored, raw, noise];
    let (mut good, mut cycles) = (0, 0);
    for _ in 0..common::size(300) {
        let kind = if rng.u8(..50) == 0 { 4 } else { rng.usize(..4) };
        let mut bytes = all[kind].clone();
        for _ in 0..rng.usize(..3) {
            spoil(&mut rng, &mut bytes);
        }
        let asked = file::Asked {
            ma: rng.bool().then(|| "0".to_owned()),
            slo: rng.bool().then(|| "1".to_owned()),
            rate: (kind > 2).then_some(biss::unit::Hertz(20_000_000)),
            unit: rng.bool().then(|| rng.u8(1..=8)).filter(|_| kind > 2),
            timeout_max_ns: 40_000,
        };
        let input = Cursor::new(bytes);
        let input = if rng.bool() {
            file::Input::file(input)
        } else {
            file::Input::pipe(input)
        };
        let before = LIVE.get();
        PEAK.set(before);
        let (n, said) = read_as(input, &asked);
        let peak = PEAK.get() - before;
        // What noise does is looked at change by change.
        let most = if kind == 4 { 24 << 20 } else { 8 << 20 };
        assert!(peak < most, "{kind}: {peak} bytes: {said}");
        good += u64::from(said.is_empty());
        cycles += n;
    }
    println!("{good} read to the end, {cycles} cycles");
}

/// A rest that is packed well, in one part and in many.
#[test]
fn a_session_is_read_within_little_memory() {
    use common::sampled;
    let part = vec![3u8; 8 << 20];
    let metadata = sampled::METADATA.replace("RATE", "20 MHz");
    for (parts, size) in [(1, 8 << 20), (16, 4 << 20), (2_000, 1 << 10)] {
        let names: Vec<String> = (1..=parts).map(|n| format!("logic-1-{n}")).collect();
        let mut entries: Vec<(&str, &[u8])> = vec![("metadata", metadata.as_bytes())];
        entries.extend(names.iter().map(|name| (name.as_str(), &part[..size])));
        let bytes = sampled::zip(&entries, zip::CompressionMethod::Deflated);
        for pipe in [false, true] {
            let input = Cursor::new(bytes.clone());
            let input = if pipe {
                file::Input::pipe(input)
            } else {
                file::Input::file(input)
            };
            let before = LIVE.get();
            PEAK.set(before);
            let (cycles, said) = read_as(input, &file::Asked::new(40_000));
            let peak = PEAK.get() - before;
            println!("{parts} parts: {peak} bytes");
            assert_eq!((cycles, said.as_str()), (0, ""));
            assert!(peak < 8 << 20, "{parts} parts: {peak} bytes");
        }
    }
}
