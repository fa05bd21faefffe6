//! Reading a VCD: our reader against crate `vcd` on the same file, and in memory, then `biss read` against sigrok-cli, which
//! merely reads the same file; and `biss read` of samples against a loop that reads them. All sides in turns:
//! `cargo bench --bench recordings [-- ROUNDS [MB]]`, where MB is how much of samples is read.
//!
//! The VCD is of a master that asks a simulated encoder every 100 µs at 1 MHz. Both readers hand each change of MA and
//! SLO to the same sink, which must come to the same sum.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

use biss::slave::{Config, Slave};
use std::fmt::Write as _;
use std::fs::File;
use std::hint::black_box;
use std::io::{BufRead, BufReader, Cursor, Write as _};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use vcd::{Parser, ScopeItem, Value};

/// The reader, with what it stands on.
#[path = "../src/link/file"]
#[allow(dead_code, private_interfaces, unreachable_pub)]
mod file {
    mod source;
    mod text;
    mod vcd;

    use crate::slice::Slicer;
    use source::Source;
    use std::io::Read;

    pub(crate) fn read_vcd(input: impl Read + 'static) -> Slicer {
        let mut source = vcd::Vcd::open(input).unwrap();
        let find = |name| {
            source
                .channels()
                .iter()
                .find(|c| c.name == name)
                .unwrap()
                .id
        };
        let (ma, slo) = (find("MA"), find("SLO"));
        source.select(ma, slo);
        let mut slicer = Slicer::default();
        while source.read(&mut slicer).unwrap() {}
        slicer
    }
}

/// What changes are handed to: it adds them up.
mod slice {
    #[derive(Debug, Default, PartialEq, Eq)]
    pub(crate) struct Slicer {
        sum: u64,
        last: Option<(bool, Option<bool>)>,
    }

    impl Slicer {
        #[inline(always)]
        pub(crate) fn push(&mut self, t_ns: u64, ma: bool, slo: Option<bool>) {
            if self.last != Some((ma, slo)) {
                self.last = Some((ma, slo));
                self.sum = self.sum.rotate_left(1) ^ t_ns;
            }
        }

        pub(crate) fn gap(&mut self, _: u64) {
            self.last = None;
        }
    }
}

const ROUNDS: usize = 10;
/// Of samples.
const MEGABYTES: usize = 512;
const CYCLES: u64 = 40_000;
const FRAME: &str = "st26,nE,nW,crc6";
const EDGES: u64 = 39;

/// So many cycles, as `sigrok-cli -O vcd` writes a change: its time and what changed in one line.
fn recording(cycles: u64) -> String {
    let config: Config = format!("motion=speed,delay=112ns,frame={FRAME}")
        .parse()
        .unwrap();
    let mut slave = Slave::new(config);
    let mut text = String::from(
        "$timescale 1 ns $end\n$scope module libsigrok $end\n$var wire 1 ! MA $end\n$var wire 1 \" SLO $end\n\
         $upscope $end\n$enddefinitions $end\n#0 1! 1\"\n",
    );
    let mut slo = true;
    let mut look = |slave: &mut Slave, text: &mut String, t_ns: u64| {
        let level = slave.slo(t_ns);
        if level != slo {
            slo = level;
            writeln!(text, "#{t_ns} {}\"", u8::from(level)).unwrap();
        }
    };
    for cycle in 1..=cycles {
        for edge in 0..2 * EDGES {
            let t_ns = cycle * 100_000 + edge * 500;
            while let Some(at) = slave.next_change().filter(|at| *at < t_ns) {
                look(&mut slave, &mut text, at);
            }
            let ma = edge % 2 == 1;
            slave.ma(t_ns, ma);
            writeln!(text, "#{t_ns} {}!", u8::from(ma)).unwrap();
            look(&mut slave, &mut text, t_ns);
        }
    }
    while let Some(at) = slave.next_change() {
        look(&mut slave, &mut text, at);
    }
    writeln!(text, "#{}", (cycles + 2) * 100_000).unwrap();
    text
}

/// As biss read VCD before it had a reader of its own.
fn read_with_crate(text: impl BufRead) -> slice::Slicer {
    let mut parser = Parser::new(text);
    let header = parser.parse_header().unwrap();
    assert_eq!(header.timescale, Some((1, vcd::TimescaleUnit::NS)));
    let ScopeItem::Scope(scope) = &header.items[0] else {
        panic!("no scope");
    };
    let code = |name: &str| {
        let named = scope.items.iter().find_map(|item| match item {
            ScopeItem::Var(var) if var.reference == name => Some(var.code),
            _ => None,
        });
        named.unwrap()
    };
    let (ma_code, slo_code) = (code("MA"), code("SLO"));
    let level = |value| match value {
        Value::V0 => Some(false),
        Value::V1 => Some(true),
        Value::X | Value::Z => None,
    };
    let mut slicer = slice::Slicer::default();
    let (mut tick, mut ma, mut slo) = (0, None, None);
    for command in parser {
        match command.unwrap() {
            vcd::Command::Timestamp(next) if next != tick => {
                match ma {
                    Some(ma) => slicer.push(tick, ma, slo),
                    None => slicer.gap(tick),
                }
                tick = next;
            }
            vcd::Command::ChangeScalar(code, value) if code == ma_code => ma = level(value),
            vcd::Command::ChangeScalar(code, value) if code == slo_code => slo = level(value),
            _ => {}
        }
    }
    if let Some(ma) = ma {
        slicer.push(tick, ma, slo);
    }
    slicer
}

/// A recorder on the wires of a simulated encoder, a byte a sample at 100 MHz: MA 10 MHz, a frame every 40 us.
fn samples(cycles: u64) -> Vec<u8> {
    const STEP_NS: u64 = 10;
    let config: Config = format!("motion=speed,delay=30ns,timeout=12500ns,frame={FRAME}")
        .parse()
        .unwrap();
    let mut slave = Slave::new(config);
    let mut samples = Vec::new();
    let mut ma = true;
    for at_ns in (0..cycles * 40_000).step_by(STEP_NS as usize) {
        let level = match (at_ns % 40_000).checked_sub(20_000) {
            Some(since) if since < EDGES * 100 => since % 100 >= 50,
            _ => true,
        };
        if level != ma {
            ma = level;
            slave.ma(at_ns, ma);
        }
        samples.push(u8::from(ma) | u8::from(slave.slo(at_ns)) << 1);
    }
    samples
}

/// Runs all sides in turns and prints their medians, and the ratio of each to the first.
fn compare(rounds: usize, bytes: usize, sides: &mut [(&str, &mut dyn FnMut())]) -> Vec<f64> {
    let mut times: Vec<Vec<Duration>> = vec![Vec::new(); sides.len()];
    for round in 0..=rounds {
        for ((_, run), times) in sides.iter_mut().zip(&mut times) {
            let began = Instant::now();
            run();
            // The first round warms up.
            if round > 0 {
                times.push(began.elapsed());
            }
        }
    }
    let mut medians = Vec::new();
    for ((name, _), times) in sides.iter().zip(&mut times) {
        times.sort();
        let ms = |at: usize| times[at].as_secs_f64() * 1e3;
        let median = ms(rounds / 2);
        medians.push(median);
        let ratio = median / medians[0];
        println!(
            "{name:32} {median:9.2} ms  {:9.2} to {:9.2}  {:6.0} MB/s  {ratio:6.1}x",
            ms(0),
            ms(rounds - 1),
            bytes as f64 / 1e3 / median,
        );
    }
    medians
}

fn main() {
    let mut numbers = std::env::args().filter_map(|arg| arg.parse().ok());
    let rounds = numbers.next().unwrap_or(ROUNDS);
    let megabytes = numbers.next().unwrap_or(MEGABYTES);
    raw(rounds, megabytes);
    let text = recording(CYCLES).into_bytes();
    println!(
        "{CYCLES} cycles, {} bytes of VCD, {rounds} rounds in turns: median, least to most",
        text.len()
    );
    let copy = text.clone();
    assert_eq!(
        file::read_vcd(Cursor::new(copy)),
        read_with_crate(&text[..])
    );
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join("bench.vcd");
    std::fs::write(&file, &text).unwrap();
    // Our reader wants its input to live as long as the program.
    let leaked: &'static [u8] = text.leak();
    println!("a VCD in memory to changes");
    compare(
        rounds,
        leaked.len(),
        &mut [
            ("ours", &mut || {
                black_box(file::read_vcd(leaked));
            }),
            ("crate vcd", &mut || {
                black_box(read_with_crate(leaked));
            }),
        ],
    );
    println!("P5: a VCD file to changes");
    compare(
        rounds,
        leaked.len(),
        &mut [
            ("ours", &mut || {
                black_box(file::read_vcd(File::open(&file).unwrap()));
            }),
            ("crate vcd in a BufReader", &mut || {
                let input = BufReader::new(File::open(&file).unwrap());
                black_box(read_with_crate(input));
            }),
            ("crate vcd as biss had it", &mut || {
                let input = BufReader::with_capacity(1 << 16, File::open(&file).unwrap());
                black_box(read_with_crate(Box::new(input) as Box<dyn BufRead>));
            }),
        ],
    );
    sigrok(rounds, &file, leaked.len());
}

/// Runs a program of which only the time matters; false where there is none.
fn run(program: &str, args: &[&str]) -> bool {
    let status = Command::new(program)
        .args(args)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    status.is_ok_and(|status| status.success())
}

/// Samples in the page cache to records, against a program that merely reads them.
fn raw(rounds: usize, megabytes: usize) {
    let piece = samples(1000);
    let pieces = (megabytes * 1_000_000).div_ceil(piece.len());
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join("bench.raw");
    let mut out = File::create(&file).unwrap();
    for _ in 0..pieces {
        out.write_all(&piece).unwrap();
    }
    let link = format!("file:{},rate=100MHz,ma=0,slo=1", file.to_str().unwrap());
    let from = format!("if={}", file.to_str().unwrap());
    let biss = env!("CARGO_BIN_EXE_biss");
    println!("P2: samples to records, against a loop of read()");
    let medians = compare(
        rounds,
        pieces * piece.len(),
        &mut [
            ("dd bs=256k", &mut || {
                assert!(run("dd", &[&from, "of=/dev/null", "bs=256k"]));
            }),
            ("biss read", &mut || {
                assert!(run(biss, &["read", &link, "-f", FRAME, "-q"]));
            }),
            ("biss read -o json", &mut || {
                assert!(run(biss, &["read", &link, "-f", FRAME, "-o", "json", "-q"]));
            }),
        ],
    );
    println!(
        "P2: text {:.2} x, JSON {:.2} x dd",
        medians[0] / medians[1],
        medians[0] / medians[2]
    );
    std::fs::remove_file(&file).unwrap();
}

/// The same in two programs.
fn sigrok(rounds: usize, file: &Path, bytes: usize) {
    let file = file.to_str().unwrap();
    if !run("sigrok-cli", &["--version"]) {
        println!("P3: sigrok-cli is not installed");
        return;
    }
    println!("P3: a VCD file to JSON records, against sigrok-cli that merely reads it");
    let link = format!("file:{file}");
    let biss = env!("CARGO_BIN_EXE_biss");
    compare(
        rounds.min(5),
        bytes,
        &mut [
            ("biss read -o json", &mut || {
                assert!(run(biss, &["read", &link, "-f", FRAME, "-o", "json", "-q"]));
            }),
            ("sigrok-cli -I vcd -O binary", &mut || {
                assert!(run(
                    "sigrok-cli",
                    &["-i", file, "-I", "vcd", "-O", "binary"]
                ));
            }),
        ],
    );
}
