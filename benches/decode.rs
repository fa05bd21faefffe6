//! What a frame costs from the memory it was recorded in, beside the copying of that memory, and from the bytes of an SPI
//! transfer, beside doing it bit by bit. Both sides in turns: `cargo bench --bench decode [-- ROUNDS]`.
//!
//! Instructions, which no neighbour disturbs: `valgrind --tool=callgrind BINARY count fast` and `count naive`, where
//! BINARY is what `cargo bench --bench decode --no-run` names; each decodes the same recording twice as often in `count2`.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

#[path = "../tests/common/plain.rs"]
mod plain;

use biss::cycle::{Cycle, Head};
use biss::format::Format;
use biss::frame::BissC;
use biss::protocol::Protocol;
use biss::scan::{Place, Scanner};
use biss::slave::{Config, Slave};
use biss::slice::Slicer;
use biss::trace::Trace;
use std::hint::black_box;
use std::time::Instant;

const FORMAT: &str = "st26,nE,nW,crc6";
const CONFIG: &str = "motion=count,pos=1000,delay=30ns,timeout=12500ns,frame=st26,nE,nW,crc6";
/// LAT, Ack, start, CDS, 34 bits, stop.
const EDGES: u64 = 39;
/// 100 MHz.
const STEP_NS: u64 = 10;
const SIZE: usize = 256 << 20;
const ROUNDS: usize = 9;

/// A recorder on the wires of a simulated slave, a byte a sample: bit 0 is MA, bit 1 SLO.
fn recording(size: usize, half_ns: u64, every_ns: u64) -> (Vec<u8>, u64) {
    let config: Config = CONFIG.parse().unwrap_or_else(|e| panic!("{e}"));
    let mut slave = Slave::new(config);
    let mut samples = Vec::with_capacity(size + (1 << 16));
    let mut frames = 0;
    let mut begin_ns = 60_000u64;
    let (mut t_ns, mut ma) = (0u64, true);
    let mut until = |samples: &mut Vec<u8>, slave: &mut Slave, ma: bool, end_ns: u64| {
        while t_ns < end_ns {
            samples.push(u8::from(ma) | u8::from(slave.slo(t_ns)) << 1);
            t_ns += STEP_NS;
        }
    };
    while samples.len() < size {
        for edge in 0..EDGES {
            for (half, level) in [(0, false), (1, true)] {
                let at_ns = begin_ns + (2 * edge + half) * half_ns;
                until(&mut samples, &mut slave, ma, at_ns);
                ma = level;
                slave.ma(at_ns, level);
            }
        }
        frames += 1;
        begin_ns += every_ns;
    }
    until(&mut samples, &mut slave, true, begin_ns);
    (samples, frames)
}

/// Frames and the sum of their positions.
type Read = (u64, u64);

fn fast(samples: &[u8]) -> Read {
    with(samples, |scanner| scanner)
}

fn with(samples: &[u8], way: impl Fn(Scanner) -> Scanner) -> Read {
    let protocol = BissC::new(FORMAT.parse::<Format>().unwrap());
    let mut slicer = Slicer::new(40_000);
    let mut scanner = way(Scanner::new(
        STEP_NS * 1_000_000,
        1,
        Place::of(0),
        Place::of(1),
    ));
    let (mut trace, mut cycle) = (Trace::default(), Cycle::default());
    let mut read = (0, 0);
    let mut take = |slicer: &mut Slicer| {
        while slicer.take(&mut trace) {
            protocol.decode(&trace, &mut cycle);
            if let Some(word) = cycle.words().first().and_then(|word| word.good()) {
                read = (read.0 + 1, read.1 + (word >> 2));
            }
        }
    };
    for block in samples.chunks(1 << 17) {
        scanner.scan(block, &mut slicer);
        take(&mut slicer);
    }
    scanner.finish(&mut slicer);
    take(&mut slicer);
    read
}

/// Sample by sample, as a first program would: no stall is noticed, no delay measured, SLO read before each next edge.
fn naive(samples: &[u8]) -> Read {
    let crc = biss::crc::Crc::standard(6).unwrap();
    let (mut last, mut idle, mut bits) = (3u8, 0u32, Vec::with_capacity(64));
    let mut read = (0, 0);
    for sample in samples {
        if sample & 1 == 1 && last & 1 == 0 {
            bits.push(last >> 1 & 1 == 1);
            idle = 0;
        } else {
            idle += 1;
            if idle == 1_250 && !bits.is_empty() {
                bits.push(last >> 1 & 1 == 1);
                if let Some(word) = naive_frame(&bits, &crc) {
                    read = (read.0 + 1, read.1 + (word >> 2));
                }
                bits.clear();
            }
        }
        last = *sample;
    }
    read
}

fn naive_frame(bits: &[bool], crc: &biss::crc::Crc) -> Option<u64> {
    let ack = bits.iter().skip(1).position(|bit| !bit)? + 1;
    let start = bits.iter().skip(ack).position(|bit| *bit)? + ack;
    let word = |at: usize, n: usize| -> Option<u64> {
        let bits = bits.get(at..at + n)?;
        Some(bits.iter().fold(0, |word, bit| word << 1 | u64::from(*bit)))
    };
    let (data, got) = (word(start + 2, 28)?, word(start + 30, 6)?);
    (got == u64::from(crc.of(data, 28))).then_some(data)
}

/// Bytes of SPI transfers, the first bit the idle level: frames of an encoder that turns.
fn transfers(format: &Format) -> Vec<[u8; 8]> {
    let mut bits = biss::trace::Bits::default();
    let made = (0..1000u64).map(|turn| {
        let head = Head {
            delay_clk: 0,
            ack: (1 + turn % 5) as u16,
            cds: turn % 3 == 0,
        };
        let word = (turn * 67_103) & 0x3ff_ffff;
        biss::frame::emit(format, head, &[word << 2 | 0b11], &mut bits);
        let levels = std::iter::once(true).chain(bits.iter());
        let packed = levels.enumerate().fold(0u64, |packed, (at, level)| {
            packed | u64::from(level) << (63 - at)
        });
        packed.to_be_bytes()
    });
    made.collect()
}

/// One SPI transfer's bytes, a word at a time.
fn by_words(protocol: &BissC, bytes: &[u8], trace: &mut Trace, cycle: &mut Cycle) -> u64 {
    trace.idle = bytes.first().map(|byte| byte >> 7 == 1);
    trace.bits.set_behind_first(bytes);
    protocol.decode(trace, cycle);
    let good = |word: &biss::cycle::Word| word.good();
    cycle.words().first().and_then(good).unwrap_or(0)
}

/// The same with one bit after the other, and the same checks: the tests' reference.
fn bit_by_bit(
    protocol: &BissC,
    bytes: &[u8],
    trace: &mut Trace,
    words: &mut Vec<plain::Received>,
) -> u64 {
    trace.bits.clear();
    let mut levels = bytes
        .iter()
        .flat_map(|byte| (0..8).rev().map(move |place| byte >> place & 1 == 1));
    trace.idle = levels.next();
    levels.for_each(|level| trace.bits.push(level));
    match plain::decode(protocol, trace, words) {
        Ok(_) => words
            .iter()
            .find(|(_, _, fault)| fault.is_none())
            .map_or(0, |word| word.0),
        Err(_) => 0,
    }
}

fn frames_from_bytes(rounds: usize) {
    let format: Format = FORMAT.parse().unwrap();
    let protocol = BissC::new(format.clone());
    let transfers = transfers(&format);
    let (mut trace, mut cycle, mut received) = (Trace::default(), Cycle::default(), Vec::new());
    trace.ma_period_ns = Some(100);
    let times = 200;
    let (mut words, mut bits) = (Vec::new(), Vec::new());
    for _ in 0..rounds {
        let (mut by_word, mut by_bit) = (0u64, 0u64);
        words.push(seconds(|| {
            for bytes in (0..times).flat_map(|_| &transfers) {
                by_word += by_words(&protocol, black_box(bytes), &mut trace, &mut cycle);
            }
        }));
        bits.push(seconds(|| {
            for bytes in (0..times).flat_map(|_| &transfers) {
                by_bit += bit_by_bit(&protocol, black_box(bytes), &mut trace, &mut received);
            }
        }));
        assert!(by_word == by_bit && by_word > 0);
    }
    let frames = (times * transfers.len()) as f64;
    let (words, bits) = (median(&mut words), median(&mut bits));
    println!(
        "P6 one frame from SPI bytes: {:.1} ns, bit by bit {:.1} ns: {:.1} x",
        words * 1e9 / frames,
        bits * 1e9 / frames,
        bits / words
    );
}

fn memcpy(to: &mut [u8], from: &[u8]) {
    to.copy_from_slice(from);
    black_box(&to[0]);
}

fn seconds(work: impl FnOnce()) -> f64 {
    let began = Instant::now();
    work();
    began.elapsed().as_secs_f64()
}

fn median(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

fn recordings(rounds: usize) {
    // Ten samples a clock, and ten or eleven.
    let kinds = [
        ("frames every 40 us, MA 10 MHz", 50, 40_000),
        ("back to back, MA 10 MHz", 50, 16_600),
        ("frames every 40 us, MA 9.6 MHz", 52, 40_000),
        ("back to back, MA 9.6 MHz", 52, 16_800),
    ];
    for (name, half_ns, every_ns) in kinds {
        let (samples, frames) = recording(SIZE, half_ns, every_ns);
        let mut copy = vec![0u8; samples.len()];
        assert_eq!(
            naive(&samples[..1 << 22]).1,
            fast(&samples[..1 << 22]).1,
            "{name}"
        );
        let (mut copies, mut decodes) = (Vec::new(), Vec::new());
        for _ in 0..rounds {
            copies.push(seconds(|| memcpy(&mut copy, &samples)));
            decodes.push(seconds(|| {
                let (good, _) = black_box(fast(&samples));
                assert_eq!(good, frames, "{name}: every frame is read");
            }));
        }
        let (copied, decoded) = (median(&mut copies), median(&mut decodes));
        let bytes = samples.len() as f64;
        println!(
            "P1 {name}: memcpy {:.2} GB/s, decode {:.2} GB/s, {:.0} ns a frame: {:.2} x memcpy",
            bytes / copied / 1e9,
            bytes / decoded / 1e9,
            decoded * 1e9 / frames as f64,
            copied / decoded
        );
    }
}

fn main() {
    let args: Vec<String> = std::env::args()
        .skip(1)
        .filter(|arg| arg != "--bench")
        .collect();
    let side = |name: &str| args.iter().any(|arg| arg == name);
    if side("words") {
        return frames_from_bytes(1);
    }
    if side("count") || side("count2") {
        let (samples, _) = recording(4 << 20, 50, 40_000);
        for _ in 0..if side("count2") { 2 } else { 1 } {
            black_box(if side("naive") {
                naive(&samples)
            } else if side("portable") {
                with(&samples, Scanner::portable)
            } else {
                fast(&samples)
            });
        }
        return;
    }
    let rounds = args
        .iter()
        .find_map(|arg| arg.parse().ok())
        .unwrap_or(ROUNDS);
    frames_from_bytes(rounds);
    recordings(rounds);
}
