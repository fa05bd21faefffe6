//! One shot against a Rust hello world, from start to exit, in turns: `cargo bench --bench start [ROUNDS]`.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const ROUNDS: usize = 200;

/// What any Rust program costs: optimised and linked as biss is.
fn hello() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let (source, program) = (folder.join("hello.rs"), folder.join("hello"));
    std::fs::write(&source, "fn main() { println!(\"hello, world\"); }\n").unwrap();
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let status = Command::new(rustc)
        .args([
            "--edition=2024",
            "-Copt-level=3",
            "-Clto",
            "-Ccodegen-units=1",
            "-o",
        ])
        .args([&program, &source])
        .status()
        .unwrap();
    assert!(status.success(), "rustc: {status}");
    program
}

fn time(program: &Path, args: &[&str]) -> Duration {
    let began = Instant::now();
    let status = Command::new(program)
        .args(args)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .status()
        .unwrap();
    let took = began.elapsed();
    assert!(status.success(), "{} {args:?}: {status}", program.display());
    took
}

fn main() {
    let rounds = std::env::args()
        .skip(1)
        .find_map(|arg| arg.parse().ok())
        .unwrap_or(ROUNDS);
    let hello = hello();
    let biss = Path::new(env!("CARGO_BIN_EXE_biss"));
    let runs: [(&str, &Path, &[&str]); 3] = [
        ("hello, world", &hello, &[]),
        ("biss --version", biss, &["--version"]),
        ("biss read sim -q", biss, &["read", "sim", "-q"]),
    ];
    let mut times = [const { Vec::new() }; 3];
    for (_, program, args) in &runs {
        time(program, args);
    }
    for _ in 0..rounds {
        for ((_, program, args), times) in runs.iter().zip(&mut times) {
            times.push(time(program, args));
        }
    }
    let mut base = None;
    println!("{rounds} runs each, in turns: median, least to most");
    for ((name, ..), times) in runs.iter().zip(&mut times) {
        times.sort();
        let ms = |at: usize| times[at].as_secs_f64() * 1e3;
        let median = ms(rounds / 2);
        let ratio = median / *base.get_or_insert(median);
        println!(
            "{name:18} {median:6.3} ms  {:6.3} to {:6.3}  {ratio:5.2}x",
            ms(0),
            ms(rounds - 1)
        );
    }
}
