//! `biss stats`, and the numbers under it.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;

use biss::cycle::Cycle;
use biss::cycle::Head;
use biss::format::Format;
use biss::frame::{BissC, emit};
use biss::protocol::Protocol;
use biss::stats::{Distribution, Due, Stats};
use biss::trace::Trace;
use common::{biss, json, rng, run, size};
use fastrand::Rng;
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

#[test]
fn shares_are_those_of_the_values() {
    let mut rng = rng();
    for _ in 0..size(200) {
        let top = 1u64 << rng.u32(1..44);
        let mut values: Vec<u64> = (0..rng.usize(1..400)).map(|_| rng.u64(0..top)).collect();
        let mut distribution = Distribution::default();
        values.iter().for_each(|value| distribution.add(*value));
        values.sort_unstable();
        let spread = distribution.spread().unwrap();
        assert_eq!(
            (spread.min, spread.max),
            (values[0], values[values.len() - 1])
        );
        let sum: u128 = values.iter().map(|value| u128::from(*value)).sum();
        let mean = sum as f64 / values.len() as f64;
        assert!(
            (spread.mean - mean).abs() <= mean * 1e-9,
            "{} {mean}",
            spread.mean
        );
        for (share, found) in [(0.5, spread.p50), (0.99, spread.p99)] {
            let at = (share * values.len() as f64).ceil() as usize;
            let want = values[at.max(1) - 1];
            // Four significant digits.
            assert!(found.abs_diff(want) <= want / 10_000 + 1, "{found} {want}");
        }
        for bins in [1, 10] {
            let found = distribution.bins(bins);
            assert!(found.len() as u64 <= bins + 1);
            let counted: u64 = found.iter().map(|bin| bin.count).sum();
            assert_eq!(counted, values.len() as u64);
            assert!(found.windows(2).all(|pair| pair[0].to == pair[1].from));
        }
    }
}

/// Cycles as a link hands them over, judged by nobody but the decoder.
struct Feed {
    format: Format,
    stats: Stats,
    trace: Trace,
    cycle: Cycle,
}

impl Feed {
    fn new(format: &str) -> Feed {
        let format: Format = format.parse().unwrap();
        Feed {
            stats: Stats::new(&format),
            format,
            trace: Trace::default(),
            cycle: Cycle::default(),
        }
    }

    fn frame(&mut self, t_ns: u64, data: u64, due: Option<Due>) {
        self.trace.reset();
        self.trace.t_ns = t_ns;
        let head = Head {
            delay_clk: 0,
            ack: 1,
            cds: false,
        };
        emit(&self.format, head, &[data], &mut self.trace.bits);
        self.add(due);
    }

    /// Nobody answers.
    fn fault(&mut self, t_ns: u64) {
        self.trace.reset();
        self.trace.t_ns = t_ns;
        self.trace.bits.extend([true; 40]);
        self.add(None);
    }

    fn add(&mut self, due: Option<Due>) {
        BissC::new(self.format.clone()).decode(&self.trace, &mut self.cycle);
        self.stats.add(&self.trace, &self.cycle, &self.format, due);
    }
}

/// A sum of twelve even ones: as normal as it has to be.
fn normal(rng: &mut Rng) -> f64 {
    (0..12).map(|_| rng.f64()).sum::<f64>() - 6.0
}

/// Whatever the speed, the times between frames and the place of the rollover.
#[test]
fn noise_and_speed_are_those_of_the_encoder() {
    let mut rng = rng();
    for _ in 0..size(20) {
        let (bits, noise) = (24, 3.0 + rng.f64() * 40.0);
        let speed = (rng.f64() - 0.5) * 2e7;
        let mut feed = Feed::new("st24,crc6");
        let (mut t_ns, start) = (1_000, rng.f64() * 2f64.powi(bits));
        let first_ns = t_ns;
        for _ in 0..4_000 {
            let place = start + speed * t_ns as f64 / 1e9 + noise * normal(&mut rng);
            let counts = (place.round() as i64).rem_euclid(1 << bits) as u64;
            feed.frame(t_ns, counts, None);
            t_ns += rng.u64(50_000..150_000);
        }
        let motion = feed.stats.motions[0].as_ref().unwrap();
        let found = motion.noise().unwrap();
        assert!((found - noise).abs() < noise * 0.1, "{found} {noise}");
        let found = motion.speed().unwrap();
        let seconds = (t_ns - first_ns) as f64 / 1e9;
        let slack = 12.0 * noise / seconds + speed.abs() * 1e-3;
        assert!((found.mean - speed).abs() < slack, "{found:?} {speed}");
        assert!(found.min <= found.mean && found.mean <= found.max);
        let travel = motion.travel().unwrap() as f64;
        let want = speed.abs() * seconds;
        assert!(
            (travel - want).abs() < 12.0 * noise + want * 1e-3,
            "{travel} {want}"
        );
    }
}

#[test]
fn an_encoder_that_stands_still_has_no_noise() {
    let mut feed = Feed::new("st24,nE,nW,crc6");
    for slot in 0..100 {
        feed.frame(slot * 1_000, 0xabc_def3, None);
    }
    let motion = feed.stats.motions[0].as_ref().unwrap();
    assert_eq!((motion.noise(), motion.travel()), (Some(0.0), Some(0)));
    assert_eq!(motion.speed().map(|speed| speed.mean), Some(0.0));
}

/// A frame that is missing is no noise, and its neighbours' distance is no step of one frame.
#[test]
fn bad_frames_and_gaps_measure_nothing() {
    let mut feed = Feed::new("st24,crc6");
    for slot in 0..300u64 {
        match slot % 5 {
            4 => feed.fault(slot * 1_000_000),
            _ => feed.frame(slot * 1_000_000, slot * slot % 3, None),
        }
    }
    assert_eq!(feed.stats.ack_clk.len(), 240);
    assert_eq!(feed.stats.period_ns.spread().unwrap().max, 1_000_000);
    feed.stats.gap();
    feed.frame(10_000_000_000, 1, None);
    assert_eq!(feed.stats.period_ns.spread().unwrap().max, 1_000_000);
    // Neighbours on both sides of a gap are no three in a row.
    let mut feed = Feed::new("st24,crc6");
    for (slot, counts) in [0, 1, 2, 0, 9_000, 9_001, 9_002].into_iter().enumerate() {
        match slot {
            3 => feed.fault(3_000_000),
            _ => feed.frame(slot as u64 * 1_000_000, counts, None),
        }
    }
    let motion = feed.stats.motions[0].as_ref().unwrap();
    assert_eq!(motion.noise(), Some(0.0));
    // An encoder that says itself that it is wrong says nothing about how it moves.
    let mut feed = Feed::new("st8,nE,crc6");
    for slot in 0..10 {
        feed.frame(slot * 1_000, slot << 4, None);
    }
    let motion = feed.stats.motions[0].as_ref().unwrap();
    assert_eq!((motion.travel(), motion.noise()), (None, None));
}

#[test]
fn slots_are_late_from_a_tenth_on() {
    let mut feed = Feed::new("st24,crc6");
    for (slot, late_ns) in [0, 99, 100, 2_000].into_iter().enumerate() {
        let due = Due {
            at_ns: slot as u64 * 1_000,
            interval_ns: 1_000,
        };
        feed.frame(due.at_ns + late_ns, 1, Some(due));
    }
    assert_eq!(feed.stats.late, 2);
    let spread = feed.stats.late_ns.spread().unwrap();
    assert_eq!((spread.min, spread.max), (0, 2_000));
}

/// The line of a simulated encoder, as a wave link or a recording sees it.
#[test]
fn margins_follow_the_line_delay() {
    let mut stats = Stats::new(&"st24,crc6".parse().unwrap());
    assert_eq!((stats.margin_ns(), stats.steady_up_to_hz(1)), (None, None));
    stats.clock_hz.add(1_000_000);
    stats.delay_ns.add(120);
    assert_eq!(stats.margin_ns(), Some(880));
    assert_eq!(stats.cable_m(), Some(12.0));
    assert_eq!(stats.steady_up_to_hz(10_000_000), Some(10_000_000));
    // 25 % of a clock to either side (D2, Table 10).
    stats.delay_ns.add(320);
    assert_eq!(stats.steady_up_to_hz(10_000_000), Some(2_500_000));
    assert_eq!(stats.margin_ns(), Some(680));
    // Beyond a clock a bit may come too early as well.
    let mut stats = Stats::new(&"st24,crc6".parse().unwrap());
    stats.clock_hz.add(1_000_000);
    stats.delay_ns.add(3_050);
    assert_eq!(stats.margin_ns(), Some(50));
}

fn object(args: &str) -> (Value, String, Option<i32>) {
    let (stdout, stderr, status) = run(args);
    assert_eq!(stdout.lines().count(), 1, "{stdout}");
    (json(&stdout).remove(0), stderr, status)
}

#[test]
fn the_simulated_encoder_is_told_as_it_is() {
    let link = "sim:delay=300ns,busy=3us,motion=speed,rpm=60,frame=mt12,st20,nE,nW,crc6";
    let (stats, stderr, status) = object(&format!("stats {link} -n 500 -i 200us -o json"));
    assert_eq!((stderr.as_str(), status), ("", Some(0)));
    assert_eq!(stats["type"], "stats");
    assert_eq!(stats["format"], "mt12,st20,nE,nW,crc6");
    for (key, value) in [
        ("frames", 500),
        ("good", 500),
        ("interval_ns", 200_000),
        ("late", 0),
        ("skipped", 0),
    ] {
        assert_eq!(stats[key], value, "{key}");
    }
    assert_eq!(stats["period_ns"]["mean"], 200_000.0);
    assert_eq!(stats["jitter_ns"]["max"], 0);
    assert_eq!(stats["rate_hz"], 5000.0);
    assert_eq!(stats["delay_clk"]["max"], 0);
    // Busy for 3 us after LAT, edge 1: the start bit comes with edge 4, not 3.
    assert_eq!(stats["ack_clk"]["p50"], 2);
    let speed = stats["channels"][0]["turns_per_s"].as_f64().unwrap();
    assert!((speed - 1.0).abs() < 0.01, "{speed}");
    // SL changes in the second quarter, so five eighths later it is sampled, and half a clock are sure.
    assert_eq!(stats["margin_clk"], 0.5);
}

#[test]
fn a_recording_shows_both_wires() {
    let (stats, _, status) =
        object("stats file:tests/recordings/bench.vcd -f st26,nE,nW,crc6 -o json");
    assert_eq!(status, Some(0));
    assert_eq!(stats["frames"], 5);
    assert_eq!(stats["delay_ns"]["p50"], 112);
    assert_eq!(stats["timeout_ns"]["p50"], 20_000);
    assert_eq!(stats["margin_ns"], 888);
    assert_eq!(stats["clock_max_hz"], 10_000_000);
    assert!(stats.get("late").is_none() && stats.get("delay_clk").is_none());
    let (_, stderr, status) =
        run("stats file:tests/recordings/bench.vcd -f st26,nE,nW,crc6 -i 1ms");
    assert_eq!(status, Some(2));
    assert!(stderr.contains("--interval has no meaning"), "{stderr}");
}

#[test]
fn faults_are_counted_and_end_with_1() {
    let (stats, _, status) = object("stats sim:crc-error=70%,seed=4 -n 200 -o json");
    assert_eq!(status, Some(1));
    let crc = stats["faults"]["crc"].as_u64().unwrap();
    assert!((100..180).contains(&crc), "{crc}");
    assert_eq!(stats["good"].as_u64(), Some(200 - crc));
    assert!(stats.get("margin_clk").is_none(), "noise is no margin");
    let (stats, _, status) = object("stats sim:absent=3600s -n 5 -o json");
    assert_eq!(
        (stats["faults"]["no-ack"].as_u64(), status),
        (Some(5), Some(1))
    );
    assert!(stats.get("ack_clk").is_none() && stats.get("margin_clk").is_none());
}

#[test]
fn the_table_has_the_names_of_the_object() {
    let (text, _, status) = run("stats sim:busy=1us..3us,seed=3 -n 300 -i 1ms");
    assert_eq!(status, Some(0));
    assert!(
        text.starts_with("300 frames, 300 good, 0 faults, "),
        "{text}"
    );
    assert!(
        text.contains("asked for 1000.0 frames/s, 0 of 300 slots late"),
        "{text}"
    );
    for name in ["period", "jitter", "late", "clock", "ack", "delay", "level"] {
        assert!(text.lines().any(|line| line.starts_with(name)), "{name}");
    }
    // What has more than one value has a histogram.
    assert!(text.contains("\nack from, clk\n"), "{text}");
    assert!(!text.contains("\nclock from"), "{text}");
    let ascii = biss(&["stats", "sim:busy=1us..3us,seed=3", "-n", "300"])
        .env("LC_ALL", "C")
        .output()
        .unwrap();
    let ascii = String::from_utf8(ascii.stdout).unwrap();
    assert!(ascii.is_ascii() && ascii.contains("  ##"), "{ascii}");
}

/// What is good before the damage counts.
#[test]
fn a_damaged_recording_is_measured_as_far_as_it_goes() {
    let mut text = std::fs::read_to_string("tests/recordings/bench.vcd").unwrap();
    text.push_str("#1300000\n?!\n");
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR"));
    let path = folder.join("stats-damaged.vcd");
    std::fs::write(&path, text).unwrap();
    let args = format!("stats file:{} -f st26,nE,nW,crc6 -o json", path.display());
    let (stdout, stderr, status) = run(&args);
    assert_eq!(status, Some(2), "{stderr}");
    assert_eq!(json(&stdout)[0]["good"], 5, "{stdout}");
    assert!(stderr.contains("stats-damaged.vcd"), "{stderr}");
}

#[test]
fn ctrl_c_ends_with_what_was_measured() {
    let mut child = biss(&["stats", "sim", "-n", "0", "-i", "1ms"])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    std::thread::sleep(std::time::Duration::from_millis(300));
    let pid = child.id().to_string();
    let kill = Command::new("kill").args(["-INT", &pid]).status();
    assert!(kill.unwrap().success());
    let mut text = String::new();
    let mut stdout = child.stdout.take().unwrap();
    std::io::Read::read_to_string(&mut stdout, &mut text).unwrap();
    assert!(text.contains(" good, 0 faults"), "{text}");
    assert_eq!(child.wait().unwrap().code(), Some(0));
}

/// SIGQUIT asks, and ends nothing.
#[test]
fn who_asks_is_told_how_it_goes() {
    for (verb, begins) in [
        ("stats", r#"{"type":"stats""#),
        ("read", r#"{"type":"summary""#),
    ] {
        let mut child = biss(&[verb, "sim", "-n", "0", "-i", "20ms", "-o", "json"])
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let pid = child.id().to_string();
        let kill = |signal: &str| {
            let status = Command::new("kill").args([signal, &pid]).status();
            assert!(status.unwrap().success());
        };
        let mut stderr = BufReader::new(child.stderr.take().unwrap());
        let mut line = String::new();
        // Whoever asks before anybody listens ends the program, as SIGQUIT does.
        std::thread::sleep(std::time::Duration::from_millis(300));
        kill("-QUIT");
        stderr.read_line(&mut line).unwrap();
        assert!(line.starts_with(begins), "{line}");
        kill("-QUIT");
        line.clear();
        stderr.read_line(&mut line).unwrap();
        assert!(line.starts_with(begins), "{line}");
        kill("-INT");
        assert!(child.wait().is_ok());
    }
}
