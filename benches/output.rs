//! Decode and JSON to a pipe: the program's own writer against `println!`, both on the same frames, in turns:
//! `cargo bench --bench output [ROUNDS]`.
//!
//! Frames are made once, and decoded again for each record: what a simulated encoder costs is not measured. The bench is
//! its own child, so that both sides differ in nothing but the writer; what they write is compared byte by byte.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

/// The writer of `biss read -o json`, as it is.
#[allow(dead_code, unused_imports, unreachable_pub)]
#[path = "../src"]
mod src {
    pub(crate) mod output;
}

/// What the writer takes from the command line.
#[allow(dead_code)]
mod cli {
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub(crate) enum ReportFormat {
        Text,
        Json,
    }
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub(crate) enum OutputFormat {
        Text,
        Json,
        Csv,
    }
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub(crate) enum TimeStyle {
        Zero,
        Delta,
        Unix,
        None,
    }
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub(crate) enum ColorWhen {
        Auto,
        Always,
        Never,
    }
}

use biss::cycle::{Cycle, Head};
use biss::format::{Format, Kind};
use biss::frame::{BissC, emit};
use biss::measure::scales;
use biss::protocol::Protocol;
use biss::trace::Trace;
use src::output::{Look, Printer, Shot};
use std::io::{self, Read};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const RECORDS: u64 = 200_000;
const ROUNDS: usize = 20;
const FORMAT: &str = "st26,nE,nW,crc6";
/// Told to the child.
const SIDE: &str = "BISS_BENCH_SIDE";

/// A thousand frames of an encoder that turns.
fn traces(format: &Format) -> Vec<Trace> {
    let head = Head {
        delay_clk: 0,
        ack: 1,
        cds: false,
    };
    let made = (0..1000u64).map(|turn| {
        let mut trace = Trace::default();
        let word = ((turn * 67_103) & 0x3ff_ffff) << 2 | 0b11;
        emit(format, head, &[word], &mut trace.bits);
        (trace.ma_period_ns, trace.delay_ns) = (Some(1000), Some(112));
        trace
    });
    made.collect()
}

/// Decodes a frame a record and hands it to `write`.
fn records(mut write: impl FnMut(Shot) -> io::Result<()>) {
    let format: Format = FORMAT.parse().unwrap();
    let protocol = BissC::new(format.clone());
    let traces = traces(&format);
    let scales = scales(&format, None, None).unwrap();
    let mut cycle = Cycle::default();
    for (seq, trace) in (0..RECORDS).zip(traces.iter().cycle()) {
        protocol.decode(trace, &mut cycle);
        write(Shot {
            format: &format,
            cycle: &cycle,
            trace,
            t_ns: seq * 100_000,
            seq,
            tries: None,
            counted: None,
            scales: &scales,
            slaves: &[],
        })
        .unwrap();
    }
}

fn with_writer() {
    let (style, color) = (cli::TimeStyle::Zero, cli::ColorWhen::Never);
    let mut printer = Printer::new(Look::Json, style, color, false);
    records(|shot| printer.shot(&shot));
    printer.flush().unwrap();
}

/// As a first program would.
fn with_println() {
    records(|shot| {
        let (channel, word) = (&shot.format.channels()[0], shot.cycle.words()[0]);
        let (data, crc) = word.raw();
        let head = shot.cycle.head().unwrap();
        let pos = channel.find(|k| *k == Kind::SingleTurn).unwrap().get(data);
        let degrees = (pos as f64 / f64::from(1 << 26) * 360.0 * 1e7).round() / 1e7;
        println!(
            "{{\"type\":\"frame\",\"t_ns\":{},\"seq\":{},\"ok\":true,\"pos\":{pos},\"deg\":{degrees:?},\"error\":{},\
             \"warning\":{},\"ack\":{},\"delay_ns\":{},\"clock_hz\":{},\"cds\":{},\"crc\":{crc},\"scd\":\"{:09x}\"}}",
            shot.t_ns,
            shot.seq,
            channel.error(data).unwrap(),
            channel.warning(data).unwrap(),
            head.ack,
            shot.trace.delay_ns.unwrap(),
            1_000_000_000 / shot.trace.ma_period_ns.unwrap(),
            u8::from(head.cds),
            data << 6 | u64::from(crc),
        );
        Ok(())
    });
}

/// From start to the end of what it writes, which is read through a pipe and handed to `look`.
fn time(side: &str, look: &mut dyn FnMut(&[u8])) -> Duration {
    let program = std::env::current_exe().unwrap();
    let began = Instant::now();
    let mut child = Command::new(program)
        .env(SIDE, side)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut pipe = child.stdout.take().unwrap();
    let mut block = vec![0; 1 << 16];
    loop {
        let n = pipe.read(&mut block).unwrap();
        if n == 0 {
            break;
        }
        look(&block[..n]);
    }
    assert!(child.wait().unwrap().success());
    began.elapsed()
}

fn main() {
    match std::env::var(SIDE).as_deref() {
        Ok("writer") => return with_writer(),
        Ok("println") => return with_println(),
        _ => {}
    }
    let rounds = std::env::args()
        .skip(1)
        .find_map(|arg| arg.parse().ok())
        .unwrap_or(ROUNDS);
    let sides = ["writer", "println"];
    let [writer, println] = sides.map(|side| {
        let mut text = Vec::new();
        time(side, &mut |block| text.extend_from_slice(block));
        text
    });
    let first = |text: &[u8]| {
        String::from_utf8_lossy(text)
            .lines()
            .next()
            .map(str::to_owned)
    };
    assert!(
        writer == println,
        "{:?} {:?}",
        first(&writer),
        first(&println)
    );
    let mut times = [const { Vec::new() }; 2];
    for _ in 0..rounds {
        for (side, times) in sides.iter().zip(&mut times) {
            times.push(time(side, &mut |_| ()));
        }
    }
    println!(
        "{rounds} runs each of {RECORDS} records, {} bytes, in turns: median, least to most",
        writer.len()
    );
    let [writer, println] = [0, 1].map(|side: usize| {
        let (side, times) = (sides[side], &mut times[side]);
        times.sort();
        let ns = |at: usize| times[at].as_secs_f64() * 1e9 / RECORDS as f64;
        let median = ns(rounds / 2);
        println!(
            "{side:8} {median:6.0} ns a record  {:6.0} to {:6.0}",
            ns(0),
            ns(rounds - 1)
        );
        median
    });
    println!(
        "P7 decode and JSON to a pipe: {:.2} x println!",
        println / writer
    );
}
