//! Recordings of the project's own making, and what `biss read file:` says of them.
//!
//! Each is made by the simulated slave and a master written here, edge by edge. BISS_BLESS=1 writes them and their
//! expected records anew; otherwise both must be as they are.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

#[path = "common/recorder.rs"]
mod recorder;

use biss::control::Access;
use biss::slave::{Config, Slave};
use recorder::recorded;
use std::path::{Path, PathBuf};
use std::process::Command;
use vcd::{IdCode, TimescaleUnit, Value, Writer};

/// A master's MA, a slave's SLO, and a logic analyser on both.
struct Bench {
    slave: Slave,
    writer: Writer<Vec<u8>>,
    ma_id: IdCode,
    slo_id: IdCode,
    t_ns: u64,
    slo: bool,
    half_ns: u64,
}

impl Bench {
    fn new(config: &str, half_ns: u64) -> Bench {
        let config: Config = config.parse().unwrap_or_else(|e| panic!("{e}"));
        let mut slave = Slave::new(config);
        let mut writer = Writer::new(Vec::new());
        writer.timescale(1, TimescaleUnit::NS).unwrap();
        writer.add_module("bench").unwrap();
        let ma_id = writer.add_wire(1, "MA").unwrap();
        let slo_id = writer.add_wire(1, "SLO").unwrap();
        writer.upscope().unwrap();
        writer.enddefinitions().unwrap();
        writer.timestamp(0).unwrap();
        writer.change_scalar(ma_id, Value::V1).unwrap();
        let slo = slave.slo(0);
        writer.change_scalar(slo_id, slo).unwrap();
        Bench {
            slave,
            writer,
            ma_id,
            slo_id,
            t_ns: 0,
            slo,
            half_ns,
        }
    }

    fn look(&mut self, t_ns: u64) {
        let slo = self.slave.slo(t_ns);
        if slo != self.slo {
            self.slo = slo;
            self.writer.timestamp(t_ns).unwrap();
            self.writer.change_scalar(self.slo_id, slo).unwrap();
        }
    }

    fn rest(&mut self, ns: u64) -> &mut Bench {
        let end = self.t_ns + ns;
        while let Some(at) = self.slave.next_change().filter(|at| *at <= end) {
            self.look(at);
        }
        self.t_ns = end;
        self
    }

    fn ma(&mut self, level: bool) -> &mut Bench {
        self.slave.ma(self.t_ns, level);
        self.writer.timestamp(self.t_ns).unwrap();
        self.writer.change_scalar(self.ma_id, level).unwrap();
        self.look(self.t_ns);
        self
    }

    fn clocks(&mut self, edges: usize) -> &mut Bench {
        let half_ns = self.half_ns;
        for _ in 0..edges {
            self.ma(false).rest(half_ns);
            self.ma(true).rest(half_ns);
        }
        self
    }

    /// Takes MA low for CDM = 1 until the slave is ready, then lets it go.
    fn cdm(&mut self, ns: u64) -> &mut Bench {
        self.ma(false).rest(ns);
        let period_ns = 2 * self.half_ns;
        self.ma(true).rest(period_ns)
    }

    fn vcd(&mut self) -> String {
        self.writer.timestamp(self.t_ns).unwrap();
        String::from_utf8(self.writer.writer().clone()).unwrap()
    }
}

const FRAME: &str = "st26,nE,nW,crc6";
/// LAT, Ack, start, CDS, 34 bits, stop.
const EDGES: usize = 39;

/// Without what came before `tick` or after `end`, as a trigger cuts it.
fn cut(vcd: &str, tick: u64, end: u64) -> String {
    let (header, body) = vcd.split_once("#0\n").expect("the recording begins at 0");
    let mut text = header.to_owned();
    let mut levels: Vec<&str> = Vec::new();
    let mut now = 0;
    let mut begun = false;
    for line in body.lines() {
        if let Some(t) = line.strip_prefix('#') {
            now = t.parse().expect("a time");
            if now >= tick && !begun {
                begun = true;
                text.push_str(&format!("#{tick}\n{}\n", levels.join("\n")));
            }
            if now > end {
                break;
            }
        }
        if begun {
            text.push_str(line);
            text.push('\n');
        } else if !line.starts_with('#') {
            levels.retain(|old| old[1..] != line[1..]);
            levels.push(line);
        }
    }
    assert!(begun && now > tick);
    text
}

fn recordings() -> Vec<(&'static str, &'static str, i32, String)> {
    let plain = "motion=speed,pos=1000000,timeout=20us,delay=112ns";
    let mut bench = Bench::new(&format!("{plain},frame={FRAME}"), 500);
    bench.rest(50_000);
    for _ in 0..5 {
        bench.clocks(EDGES).rest(211_000);
    }
    let bench_vcd = bench.vcd();

    let mut slow_start = Bench::new(
        &format!("{plain},busy=1us..4us,seed=3,warning=40%,error=20%,frame={FRAME}"),
        500,
    );
    slow_start.rest(50_000);
    for _ in 0..6 {
        slow_start.clocks(EDGES + 3).rest(60_000);
    }

    // Three and a bit clocks of delay, a control bit in each gap, which is shorter than three timeouts.
    let far = format!("motion=count,pos=5,timeout=adaptive,delay=1.6us,cds=1,frame={FRAME}");
    let mut far = Bench::new(&far, 250);
    far.rest(50_000);
    for _ in 0..4 {
        far.clocks(EDGES + 4).cdm(4_000);
    }
    far.clocks(EDGES + 4).rest(50_000);

    let mut faults = Bench::new(&format!("motion=count,pos=77,frame={FRAME}"), 500);
    faults.rest(50_000);
    // Good; a level of 14 µs; a pause in which the slave times out; too few clocks; good.
    faults.clocks(EDGES).rest(50_000);
    faults
        .clocks(20)
        .rest(14_000)
        .clocks(EDGES - 20)
        .rest(50_000);
    faults
        .clocks(20)
        .rest(30_000)
        .clocks(EDGES - 20)
        .rest(50_000);
    faults.clocks(EDGES - 3).rest(50_000);
    faults.clocks(EDGES).rest(50_000);

    let mut noise = Bench::new(
        &format!("motion=count,crc-error=25%,null=25%,no-ack=20%,seed=3,frame={FRAME}"),
        500,
    );
    noise.rest(50_000);
    for _ in 0..8 {
        noise.clocks(EDGES).rest(60_000);
    }

    let pair = "mt12,st24,nE,nW,crc6+mt12,st24,nE,nW,lc6,crc16";
    let mut safety = Bench::new(&format!("motion=speed,turn=7,frame={pair}"), 50);
    safety.rest(50_000);
    for _ in 0..3 {
        safety.clocks(5 + 44 + 60).rest(31_250);
    }

    let mut absent = Bench::new(&format!("stuck=1,frame={FRAME}"), 500);
    absent.rest(50_000);
    for _ in 0..2 {
        absent.clocks(48).rest(30_000);
    }

    // What a master says to a slave and hears from it, beside the shortest of frames.
    let small = "st3,nE,nW,crc3";
    let accesses = [
        Access::Read {
            slave: 0,
            address: 0x78,
            count: 3,
        },
        Access::Write {
            slave: 0,
            address: 0x10,
            data: [0x5A, 0xC3].as_slice().into(),
        },
        // Read-only.
        Access::Write {
            slave: 0,
            address: 0x20,
            data: [1].as_slice().into(),
        },
        Access::Command {
            slaves: 1,
            code: 2,
            checked: true,
            reduced: false,
        },
    ];
    let knobs = "motion=count,reg-busy=40us..90us,read-only=0x20";
    let (_, registers) = recorded(&format!("{knobs},frame={small}"), &accesses, 0);

    vec![
        ("registers", small, 0, registers),
        ("bench", FRAME, 0, bench_vcd.clone()),
        ("cut", FRAME, 0, cut(&bench_vcd, 60_700, 1_070_000)),
        ("flags", FRAME, 1, slow_start.vcd()),
        ("far", FRAME, 0, far.vcd()),
        ("faults", FRAME, 1, faults.vcd()),
        ("noise", FRAME, 1, noise.vcd()),
        ("safety", pair, 0, safety.vcd()),
        ("absent", FRAME, 1, absent.vcd()),
    ]
}

fn path(name: &str, kind: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/recordings")
        .join(format!("{name}.{kind}"))
}

fn compare(path: &Path, made: &str) {
    if std::env::var_os("BISS_BLESS").is_some() {
        std::fs::write(path, made).unwrap();
    }
    let kept = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    assert!(
        kept == made,
        "{} differs; made now:\n{made}",
        path.display()
    );
}

#[test]
fn recordings_decode_to_their_records() {
    for (name, frame, status, vcd) in recordings() {
        compare(&path(name, "vcd"), &vcd);
        let link = format!("file:{}", path(name, "vcd").display());
        let output = Command::new(env!("CARGO_BIN_EXE_biss"))
            .args(["read", &link, "-f", frame, "-o", "json", "-q"])
            .env_remove("BISS_FRAME")
            .output()
            .unwrap();
        let records = String::from_utf8(output.stdout).unwrap();
        assert!(
            output.stderr.is_empty(),
            "{name}: {}",
            String::from_utf8_lossy(&output.stderr)
        );
        compare(&path(name, "json"), &records);
        assert_eq!(output.status.code(), Some(status), "{name}: {records}");
    }
}

/// The positions that the slave latched, not what an earlier run printed.
#[test]
fn the_expected_records_are_true() {
    let read = |name: &str| std::fs::read_to_string(path(name, "json")).unwrap();
    let values = |name: &str, key: &str| -> Vec<serde_json::Value> {
        let parse = |line: &str| serde_json::from_str::<serde_json::Value>(line).unwrap();
        read(name)
            .lines()
            .map(parse)
            .filter_map(|r| r.get(key).cloned())
            .collect()
    };
    assert_eq!(values("far", "pos"), [5, 6, 7, 8, 9]);
    assert_eq!(values("far", "delay_ns"), [1600; 5]);
    assert_eq!(values("far", "cds"), [1; 5]);
    assert_eq!(values("bench", "delay_ns"), [112; 5]);
    assert_eq!(values("bench", "clock_hz"), [1_000_000; 5]);
    assert_eq!(values("bench", "timeout_ns"), [20_000; 5]);
    // An adaptive timeout of one clock and a half, at 2 MHz.
    assert_eq!(values("far", "timeout_ns"), [750; 5]);
    assert_eq!(
        values("bench", "t_ns"),
        [0, 250_000, 500_000, 750_000, 1_000_000]
    );
    // One revolution a second, latched half a clock after each start.
    let pos = |t_ns: f64| 1_000_000 + ((t_ns + 500.0) / 1e9 * 67_108_864.0) as u64;
    let want: Vec<u64> = (0..5)
        .map(|i| pos(50_000.0 + 250_000.0 * f64::from(i)))
        .collect();
    assert_eq!(values("bench", "pos"), want);
    assert_eq!(values("cut", "pos"), want[1..4]);
    assert!(
        values("cut", "fault").is_empty(),
        "what the recording cuts is no fault of the wire"
    );
    assert_eq!(values("faults", "pos"), [77, 82]);
    assert_eq!(
        values("faults", "fault"),
        ["stalled", "short", "short", "short"]
    );
    assert_eq!(values("absent", "fault"), ["no-ack", "no-ack"]);
    assert_eq!(values("safety", "lc"), [1, 2, 3]);
    let registers = [0x78, 0x79, 0x7A, 0x10, 0x11, 0x20, 0x20];
    assert_eq!(values("registers", "addr"), registers);
    assert_eq!(values("registers", "value"), [0x42, 0x49, 0x53, 0x5A, 0xC3]);
    assert_eq!(values("registers", "busy"), [2, 2, 3, 0, 0]);
    assert_eq!(values("safety", "turn"), [7; 6]);
}

#[test]
fn damaged_files_name_the_line_after_what_was_good() {
    let vcd = std::fs::read_to_string(path("bench", "vcd")).unwrap();
    let lines: Vec<&str> = vcd.lines().collect();
    let middle = lines.len() / 2;
    let damaged = format!(
        "{}\nwhat?\n{}",
        lines[..middle].join("\n"),
        lines[middle..].join("\n")
    );
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join("damaged.vcd");
    std::fs::write(&file, damaged).unwrap();
    let run = |text: &str| {
        let output = Command::new(env!("CARGO_BIN_EXE_biss"))
            .args(["read", text, "-f", FRAME, "-o", "json", "-q"])
            .output()
            .unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        (
            text(output.stdout),
            text(output.stderr),
            output.status.code(),
        )
    };
    let (stdout, stderr, status) = run(&format!("file:{}", file.display()));
    assert_eq!(status, Some(2));
    assert!(stderr.contains(&format!("line {}", middle + 1)), "{stderr}");
    let expected = std::fs::read_to_string(path("bench", "json")).unwrap();
    let records: Vec<&str> = stdout.lines().collect();
    assert_eq!(records[..2], expected.lines().collect::<Vec<_>>()[..2]);
    assert_eq!(
        records.len(),
        2,
        "the frame that was cut is no record: {stdout}"
    );
}

#[test]
fn pieces_are_said_and_do_not_count() {
    let link = format!("file:{}", path("cut", "vcd").display());
    let output = Command::new(env!("CARGO_BIN_EXE_biss"))
        .args(["read", &link, "-f", FRAME])
        .output()
        .unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    let lines: Vec<&str> = stderr.lines().collect();
    assert_eq!(
        lines[0],
        "biss: the recording begins inside a cycle: 28 clocks left out"
    );
    assert_eq!(
        lines[1],
        "biss: the recording ends inside a cycle: 19 clocks left out"
    );
    assert!(lines[2].starts_with("biss: 3 frames, 3 good"), "{stderr}");
}

#[test]
fn signals_are_found_by_name_or_listed() {
    let vcd = std::fs::read_to_string(path("bench", "vcd")).unwrap();
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join("renamed.vcd");
    let named = |ma: &str, slo: &str| {
        let vcd = vcd.replace(" MA ", &format!(" {ma} "));
        std::fs::write(&file, vcd.replace(" SLO ", &format!(" {slo} "))).unwrap();
    };
    let run = |options: &str| {
        let link = format!("file:{}{options}", file.display());
        let output = Command::new(env!("CARGO_BIN_EXE_biss"))
            .args(["read", &link, "-f", FRAME])
            .output()
            .unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        (output.status.code(), said)
    };
    named("D0", "D1");
    let (status, said) = run("");
    assert_eq!(status, Some(0), "{said}");
    let note = "biss: MA is `bench.D0`, SLO is `bench.D1`, by behaviour\n";
    assert!(said.starts_with(note), "{said}");
    for options in [",ma=D0,slo=bench.D1", ",ma=0,slo=1", ",ma=bench.D0,slo=1"] {
        let (status, said) = run(options);
        assert!(said.starts_with("biss: 5 frames"), "{said}");
        assert_eq!(status, Some(0));
    }
    let (status, said) = run(",slo=d1");
    assert!(said.starts_with(note) && status == Some(0), "{said}");
    for (options, words) in [
        (",ma=D0,slo=D0", "the same signal"),
        (
            ",ma=D1",
            "no signal looks or behaves like SLO; one-bit signals are: bench.D0, bench.D1",
        ),
        (",slo=D0", "file:PATH,ma=NAME"),
        (
            ",ma=D2",
            "no signal `D2`; one-bit signals are: bench.D0, bench.D1",
        ),
        (",ma=2", "no signal `2`"),
    ] {
        let (status, said) = run(options);
        assert!(said.contains(words), "{options}: {said}");
        assert_eq!(status, Some(2));
    }
    // A name counts before a number.
    named("1", "0");
    assert!(run(",ma=0").1.contains("behaves like SLO"));
    assert!(run(",ma=1,slo=0").1.starts_with("biss: 5 frames"));
    named("clk", "SLO");
    let (_, said) = run("");
    assert!(
        said.starts_with("biss: MA is `bench.clk`, by name\n"),
        "{said}"
    );
}

/// What `biss read file:` says of a recording: records, messages, exit status.
fn read_vcd(name: &str, vcd: &str, frame: &str) -> (Vec<serde_json::Value>, String, Option<i32>) {
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.vcd"));
    std::fs::write(&file, vcd).unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_biss"))
        .args([
            "read",
            &format!("file:{}", file.display()),
            "-f",
            frame,
            "-o",
            "json",
        ])
        .env_remove("BISS_FRAME")
        .output()
        .unwrap();
    let stdout = String::from_utf8(output.stdout).unwrap();
    let records = stdout
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    (
        records,
        String::from_utf8(output.stderr).unwrap(),
        output.status.code(),
    )
}

fn positions(records: &[serde_json::Value]) -> Vec<u64> {
    records
        .iter()
        .filter_map(|r| r.get("pos")?.as_u64())
        .collect()
}

/// One frame of zeros and one that follows, as lines of VCD; `change` may write more at one edge of the first.
fn changed(at_edge: usize, change: impl Fn(&mut Bench)) -> String {
    let mut bench = Bench::new(
        &format!("motion=count,pos=0,timeout=20us,frame={FRAME}"),
        500,
    );
    bench
        .rest(50_000)
        .clocks(EDGES)
        .rest(50_000)
        .clocks(at_edge);
    change(&mut bench);
    bench
        .clocks(EDGES - at_edge)
        .rest(50_000)
        .clocks(EDGES)
        .rest(50_000);
    bench.vcd()
}

#[test]
fn nothing_is_guessed_where_slo_is_not_known() {
    let vcd = changed(12, |bench| {
        bench.writer.timestamp(bench.t_ns).unwrap();
        bench.writer.change_scalar(bench.slo_id, Value::X).unwrap();
        bench.rest(20);
    });
    let (records, ..) = read_vcd("slo-x", &vcd, FRAME);
    assert_eq!(positions(&records), [0, 2], "{records:?}");
}

#[test]
fn a_frame_in_which_ma_is_not_known_is_none() {
    // MA is not known for a moment, in which it may have moved.
    let vcd = changed(12, |bench| {
        bench.rest(10);
        for value in [Value::X, Value::V1] {
            bench.writer.timestamp(bench.t_ns).unwrap();
            bench.writer.change_scalar(bench.ma_id, value).unwrap();
            bench.rest(20);
        }
    });
    let (records, said, _) = read_vcd("ma-x", &vcd, FRAME);
    assert_eq!(positions(&records), [0, 2], "{records:?} {said}");
}

#[test]
fn a_time_scale_that_hides_edges_is_an_error() {
    let vcd = changed(12, |bench| {
        bench.rest(10);
        bench.writer.timestamp(bench.t_ns).unwrap();
        for value in [Value::V0, Value::V1] {
            bench.writer.change_scalar(bench.ma_id, value).unwrap();
        }
        bench.rest(20);
    });
    let (records, said, status) = read_vcd("coarse", &vcd, FRAME);
    assert_eq!(positions(&records), [0], "{records:?}");
    assert!(
        status == Some(2) && said.contains("too coarse"),
        "{status:?} {said}"
    );
}

#[test]
fn time_that_goes_backwards_is_an_error() {
    let vcd = changed(12, |bench| {
        bench.writer.timestamp(bench.t_ns - 700).unwrap();
    });
    let (records, said, status) = read_vcd("backwards", &vcd, FRAME);
    assert_eq!(positions(&records), [0], "{records:?}");
    assert!(
        status == Some(2) && said.contains("backwards"),
        "{status:?} {said}"
    );
}

#[test]
fn a_recording_without_a_frame_is_no_success() {
    let mut bench = Bench::new(&format!("frame={FRAME}"), 500);
    let vcd = bench.rest(500_000).vcd();
    let (records, said, status) = read_vcd("empty", &vcd, FRAME);
    assert!(
        records.is_empty() && status == Some(1),
        "{records:?} {said} {status:?}"
    );
}

/// When SLO fell and rose first in each cycle, out of the text of the recording.
fn ack_and_start(vcd: &str) -> Vec<(u64, u64)> {
    let slo = vcd
        .lines()
        .find(|line| line.contains(" SLO "))
        .and_then(|line| line.split(' ').nth(3))
        .unwrap();
    let (mut t_ns, mut quiet_since, mut fell) = (0u64, 0u64, None);
    let mut found = Vec::new();
    for line in vcd.lines().skip_while(|line| !line.starts_with('#')) {
        if let Some(t) = line.strip_prefix('#') {
            t_ns = t.parse().unwrap();
            continue;
        }
        // MA has rested: a new cycle.
        if line[1..] != *slo {
            if t_ns - quiet_since > 10_000 {
                fell = None;
            }
            quiet_since = t_ns;
        } else if line == format!("0{slo}") && fell.is_none() {
            fell = Some((t_ns, false));
        } else if let (Some((t, false)), true) = (fell, line == format!("1{slo}")) {
            found.push((t, t_ns));
            fell = Some((t, true));
        }
    }
    found
}

/// Busy times are those of the edges on SLO: the clock is not the same all the time.
#[test]
fn busy_times_are_measured_on_slo() {
    let config = "motion=count,busy=3us..9us,seed=4,delay=112ns,timeout=20us";
    let mut bench = Bench::new(&format!("{config},frame={FRAME}"), 500);
    bench.rest(50_000);
    for half_ns in [500, 520, 480, 430, 560, 510] {
        bench.half_ns = half_ns;
        bench.clocks(3);
        bench.half_ns = half_ns + 40;
        bench.clocks(3);
        bench.half_ns = half_ns;
        bench.clocks(EDGES + 6).rest(60_000);
    }
    let vcd = bench.vcd();
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join("busy.vcd");
    std::fs::write(&file, &vcd).unwrap();
    let run = |options: &str| {
        let link = format!("file:{}", file.display());
        let mut args = vec!["read", &link, "-f", FRAME];
        args.extend(options.split(' '));
        let output = Command::new(env!("CARGO_BIN_EXE_biss"))
            .args(args)
            .env_remove("BISS_FRAME")
            .output()
            .unwrap();
        String::from_utf8(output.stdout).unwrap()
    };
    let records: Vec<serde_json::Value> = run("-o json -v")
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let want: Vec<u64> = ack_and_start(&vcd).iter().map(|(a, b)| b - a).collect();
    let found: Vec<u64> = records
        .iter()
        .filter_map(|r| r["busy_ns"].as_u64())
        .collect();
    assert_eq!(found, want);
    assert_eq!(want.len(), 6);
    let counted = |record: &serde_json::Value| {
        let clock = record["clock_hz"].as_f64().unwrap();
        (record["ack"].as_f64().unwrap() * 1e9 / clock) as u64
    };
    let apart = records.iter().map(counted).zip(&want);
    assert!(apart.filter(|(a, b)| a.abs_diff(**b) > 20).count() > 2);
    assert!(run("-o csv").contains(",busy_ns,clock_hz,timeout_ns,"));
    let fields: Vec<String> = records
        .iter()
        .filter(|r| r["ok"] == true)
        .map(|r| r["busy_ns"].to_string())
        .collect();
    assert_eq!(run("-F busy_ns").lines().collect::<Vec<_>>(), fields);
    let text = run("-t none -v");
    assert!(text.contains("  delay 112ns  busy "), "{text}");
    assert!(text.contains("  timeout 20us  clock "), "{text}");
    assert!(!run("-t none").contains("timeout"));
}

/// A fault says where it is: its clock, or the clocks of its channel.
#[test]
fn every_fault_has_a_place() {
    let mut kinds = std::collections::BTreeSet::new();
    for (name, ..) in recordings() {
        for line in std::fs::read_to_string(path(name, "json")).unwrap().lines() {
            let record: serde_json::Value = serde_json::from_str(line).unwrap();
            let Some(fault) = record["fault"]
                .as_str()
                .filter(|_| record["type"] == "frame")
            else {
                continue;
            };
            kinds.insert(fault.to_owned());
            let has = |key: &str| record.get(key).is_some();
            let places = [
                "clock",
                "clocks",
                "edge",
                "have_bits",
                "head_clk",
                "first_clock",
            ];
            assert!(has("t_ns") && places.iter().any(|key| has(key)), "{line}");
        }
    }
    let kinds: Vec<&str> = kinds.iter().map(String::as_str).collect();
    assert_eq!(
        kinds,
        ["crc", "mismatch", "no-ack", "null", "short", "stalled"]
    );
}

/// Of several channels each has its own clocks: those of `-f`, behind the start bit of this very frame.
#[test]
fn the_clocks_of_a_bad_channel_are_its_own() {
    let frame = "st10,crc6+data7=temp,crc5";
    let config = format!("motion=count,busy=4us,crc-error=60%,seed=1,frame={frame}");
    let mut bench = Bench::new(&config, 500);
    bench.rest(50_000);
    for _ in 0..12 {
        bench.clocks(40).rest(60_000);
    }
    let (records, ..) = read_vcd("clocks", &bench.vcd(), frame);
    let mut seen = [0, 0];
    for record in records.iter().filter(|record| record["fault"] == "crc") {
        let ch = record["ch"].as_u64().unwrap();
        // LAT, then as many clocks as Ack takes, start and CDS.
        let first = record["ack"].as_u64().unwrap() + 4 + ch * 16;
        assert_eq!(record["first_clock"], first, "{record}");
        assert_eq!(record["last_clock"], first + [15, 11][ch as usize]);
        seen[ch as usize] += 1;
    }
    assert!(seen[0] > 0 && seen[1] > 0, "{seen:?}");
}

/// The clocks of a first cycle are answered only during a second one, after a pause: what is read then was latched
/// for the first.
#[test]
fn an_answer_to_an_earlier_cycle_is_a_stall() {
    let frame = "st8,crc6";
    for pauses in 1..=3 {
        let mut bench = Bench::new(
            &format!("motion=count,pos=165,delay=39us,timeout=20us,frame={frame}"),
            100,
        );
        bench.rest(90_000);
        bench.clocks(19);
        for _ in 0..pauses {
            bench.rest(800).clocks(19);
        }
        bench.clocks(300).rest(90_000);
        let (records, said, _) = read_vcd("late-ack", &bench.vcd(), frame);
        assert!(positions(&records).is_empty(), "{records:?} {said}");
        let last = records.last().unwrap();
        assert!(
            last["fault"] == "stalled" && last["edge"] == 0,
            "{records:?}"
        );
    }
}

/// MA at rest for a little, SL high with a data bit: no beginning of a frame.
#[test]
fn a_recording_that_begins_in_a_pause_begins_inside_a_cycle() {
    for (half_ns, rest) in [
        (500, 3_000),
        (500, 11_000),
        (5_000, 3_000),
        (5_000, 14_000),
        (500, 1_000),
    ] {
        let mut bench = Bench::new(
            &format!("motion=still,pos=67108863,timeout=20us,frame={FRAME}"),
            half_ns,
        );
        bench.rest(90_000).clocks(12);
        let from = bench.t_ns + 1;
        bench
            .rest(rest)
            .clocks(EDGES - 12)
            .rest(90_000)
            .clocks(EDGES)
            .rest(90_000);
        let vcd = cut(&bench.vcd(), from, u64::MAX);
        let (records, said, _) = read_vcd("pause", &vcd, FRAME);
        assert!(
            said.contains("begins inside a cycle"),
            "{half_ns} {rest}: {records:?} {said}"
        );
        assert_eq!(records.len(), 1, "{half_ns} {rest}: {records:?}");
    }
}

/// MA comes back in mid-frame, with SL = 1: what follows is a piece, as at the beginning of a recording.
#[test]
fn after_a_gap_a_cycle_has_no_beginning() {
    let mut bench = Bench::new(
        &format!("motion=still,pos=67108863,timeout=20us,frame={FRAME}"),
        500,
    );
    bench.rest(50_000).clocks(EDGES).rest(90_000);
    bench.writer.timestamp(bench.t_ns).unwrap();
    bench.writer.change_scalar(bench.ma_id, Value::X).unwrap();
    for _ in 0..12 {
        for level in [false, true] {
            bench.slave.ma(bench.t_ns, level);
            bench.look(bench.t_ns);
            bench.rest(500);
        }
    }
    bench.writer.timestamp(bench.t_ns).unwrap();
    bench.writer.change_scalar(bench.ma_id, Value::V1).unwrap();
    bench
        .rest(500)
        .clocks(EDGES - 12)
        .rest(90_000)
        .clocks(EDGES)
        .rest(90_000);
    let (records, said, _) = read_vcd("gap", &bench.vcd(), FRAME);
    assert!(said.contains("begins inside a cycle"), "{records:?} {said}");
    assert!(
        records.len() == 2 && positions(&records).len() == 2,
        "{records:?} {said}"
    );
}

/// A pause that may be shorter than the timeout stays in its cycle, whatever SL is: it does not begin a new one.
#[test]
fn a_pause_below_the_longest_timeout_is_one_stalled_cycle() {
    for (at, rest) in [(20, 30_000), (20, 38_000), (8, 21_000)] {
        let mut bench = Bench::new(
            &format!("motion=still,pos=67108863,timeout=40us,frame={FRAME}"),
            500,
        );
        bench
            .rest(90_000)
            .clocks(at)
            .rest(rest)
            .clocks(EDGES - at)
            .rest(90_000);
        let (records, said, _) = read_vcd("long-pause", &bench.vcd(), FRAME);
        assert!(
            records.len() == 1 && records[0]["fault"] == "stalled",
            "{at} {rest}: {records:?} {said}"
        );
    }
}

#[test]
fn nothing_after_an_unknown_level_is_a_bit() {
    let mut slicer = biss::slice::Slicer::new(40_000);
    slicer.push(0, true, Some(true));
    for edge in 0..10u64 {
        let slo = if edge == 6 { None } else { Some(edge < 2) };
        slicer.push(100_000 + edge * 1000, false, slo);
        slicer.push(100_500 + edge * 1000, true, slo);
    }
    slicer.finish(200_000);
    let mut trace = biss::trace::Trace::default();
    assert!(slicer.take(&mut trace));
    assert_eq!(trace.bits.len(), 5);
}
