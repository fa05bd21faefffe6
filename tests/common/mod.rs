//! Shared by the integration tests.
#![allow(dead_code, unreachable_pub, clippy::print_stdout, clippy::unwrap_used)]

pub mod sampled;

use fastrand::Rng;
use serde_json::Value;
use std::process::{Command, Output};

/// A generator whose seed is printed, and taken from BISS_TEST_SEED when a failure is to be repeated.
pub fn rng() -> Rng {
    let seed = match std::env::var("BISS_TEST_SEED") {
        Ok(text) => text.parse().expect("BISS_TEST_SEED is a number"),
        Err(_) => fastrand::u64(..),
    };
    println!("BISS_TEST_SEED={seed}");
    Rng::with_seed(seed)
}

/// Size of a campaign, `usual` unless BISS_TEST_SIZE says otherwise in percent.
pub fn size(usual: usize) -> usize {
    let percent = match std::env::var("BISS_TEST_SIZE") {
        Ok(text) => text.parse().expect("BISS_TEST_SIZE is a percentage"),
        Err(_) => 100,
    };
    let size = usual * percent / 100;
    println!("{size} rounds");
    size
}

/// Any frame format: 1 to 8 channels, every kind of field, every width of CRC.
pub fn format(rng: &mut Rng) -> String {
    let channels: Vec<String> = (0..rng.usize(1..=8)).map(|_| channel(rng)).collect();
    channels.join("+")
}

pub fn channel(rng: &mut Rng) -> String {
    let mut room = rng.u8(1..=64);
    let mut fields = Vec::new();
    let mut take = |rng: &mut Rng, fields: &mut Vec<String>, name: &str, most: u8| {
        let bits = rng.u8(1..=most.min(room.max(1)));
        if room >= bits {
            room -= bits;
            fields.push(format!("{name}{bits}"));
        }
    };
    if rng.bool() {
        take(rng, &mut fields, "mt", 24);
    }
    let place = if rng.bool() { "st" } else { "pos" };
    take(rng, &mut fields, place, 64);
    if rng.u8(..4) == 0 {
        take(rng, &mut fields, "pad", 8);
    }
    if rng.u8(..4) == 0 {
        take(rng, &mut fields, "lc", 8);
    }
    if rng.u8(..4) == 0 {
        take(rng, &mut fields, "data", 16);
        if let Some(last) = fields.last_mut().filter(|f| f.starts_with("data")) {
            last.push_str("=temp");
        }
    }
    for flag in ["nE", "nW", "E", "W"] {
        if room > 0 && rng.u8(..3) == 0 {
            room -= 1;
            fields.push(flag.into());
        }
    }
    rng.shuffle(&mut fields);
    if rng.u8(..8) > 0 {
        fields.push(crc(rng));
    }
    fields.join(",")
}

pub fn crc(rng: &mut Rng) -> String {
    if rng.bool() {
        return (*rng
            .choice(&["crc3", "crc4", "crc5", "crc6", "crc7", "crc8", "crc16"])
            .unwrap())
        .into();
    }
    let bits = rng.u8(1..=16);
    let poly = 1u32 << bits | rng.u32(..1 << bits) | 1;
    let mut text = format!("crc{bits}:{poly:#x}");
    if rng.bool() {
        text.push_str(&format!(":init={}", rng.u32(..1 << bits)));
    }
    if rng.bool() {
        text.push_str(":plain");
    }
    text
}

/// A random word of so many bits.
pub fn word(rng: &mut Rng, bits: u8) -> u64 {
    rng.u64(..) >> (64 - u32::from(bits))
}

/// The program under test, without what the environment might say.
pub fn biss(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_biss"));
    command
        .args(args)
        .env_remove("BISS_LINK")
        .env_remove("BISS_FRAME")
        .env("XDG_CONFIG_HOME", "/nonexistent")
        .env("LC_ALL", "C.UTF-8")
        .env("NO_COLOR", "1");
    command
}

/// Stdout, stderr and exit status.
pub fn run(args: &str) -> (String, String, Option<i32>) {
    let args: Vec<&str> = args.split(' ').collect();
    texts(biss(&args).output().unwrap())
}

pub fn texts(output: Output) -> (String, String, Option<i32>) {
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (
        text(output.stdout),
        text(output.stderr),
        output.status.code(),
    )
}

/// One value a line.
pub fn json(text: &str) -> Vec<Value> {
    text.lines()
        .map(|line| serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}")))
        .collect()
}
