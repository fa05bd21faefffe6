//! `exec` links: a slave in another process, in closed loop with the real master, and children that do it wrong.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

#[path = "../examples/slave.rs"]
#[allow(dead_code, unreachable_pub)]
mod slave;

mod common;

use biss::slave::Slave;
use common::{biss, json, rng, size, texts};
use std::fs::File;
use std::io::Read as _;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// What `examples/slave.rs` does, in a process of this test's own: see [`link`].
#[test]
fn child() {
    let Ok(config) = std::env::var("TEST_SLAVE") else {
        return;
    };
    let tick = std::env::var("TEST_TICK").unwrap().parse().unwrap();
    // The harness prints to stdout.
    let slo = File::options().write(true).open("/dev/fd/3").unwrap();
    let slave = Slave::new(config.parse().unwrap());
    slave::serve(slave, tick, std::io::stdin(), slo).unwrap();
}

/// A link to such a slave.
fn link(tick: &str, config: &str) -> String {
    let exe = std::env::current_exe().unwrap();
    let exe = exe.display();
    format!(
        "exec:tick={tick},TEST_TICK={tick} TEST_SLAVE='{config}' exec {exe} --exact child --nocapture 3>&1 >/dev/null"
    )
}

fn read(link: &str, more: &[&str]) -> (String, String, Option<i32>) {
    texts(biss(&["read", link]).args(more).output().unwrap())
}

/// With a tick that all times of the master are multiples of, the closed loop is `sim` to the bit.
#[test]
fn a_slave_elsewhere_sends_what_one_in_process_does() {
    let mut rng = rng();
    let frames = [
        "mt12,st20,nE,nW,crc6",
        "st26,nE,nW,crc6",
        "st32,E,W,crc16",
        "pos12",
    ];
    for _ in 0..size(8) {
        let chain = rng.bool();
        let frame = match chain {
            true => "mt12,st20,nE,nW,crc6+st18,nE,nW,crc6",
            false => frames[rng.usize(..frames.len())],
        };
        let slaves = if chain { ",slaves=each" } else { "" };
        let config = format!(
            "seed={},motion=speed,rpm={},busy=0us..{}us,ack={},delay={}ns,timeout={}us,crc-error={}%,no-ack=2%,null=3%{slaves}",
            rng.u32(1..),
            rng.i32(-6000..6000),
            rng.u32(..20),
            rng.u32(1..4),
            rng.u32(..12_000),
            rng.u32(14..30),
            rng.u32(..30),
        );
        let clock = *rng.choice(&["250kHz", "500kHz", "1MHz", "5MHz"]).unwrap();
        let clocks = ["-f", frame, "-c", clock, "-n", "40", "-o", "json", "-v"];
        let (wanted, _, status) = read(&format!("sim:{config}"), &clocks);
        let (got, said, same) = read(&link("10ns", &format!("{config},frame={frame}")), &clocks);
        assert_eq!(got, wanted, "{config} at {clock}, {frame}\n{said}");
        assert_eq!(same, status, "{config} at {clock}, {frame}\n{said}");
        let records = json(&got);
        assert_eq!(
            records.iter().filter(|r| r["seq"] == 39).count(),
            if records.last().unwrap()["ch"].is_u64() {
                2
            } else {
                1
            }
        );
        let seen = records.iter().filter(|record| record["ack"].is_u64());
        assert!(seen.count() > 0, "{config}: Ack in no frame");
    }
}

#[test]
fn ticks_that_do_not_fit_the_clock_make_it_slower() {
    for (tick, clock, runs) in [
        ("8ns", "1MHz", "a tick is 8 ns, a clock 125 of them"),
        ("8ns", "10MHz", "a tick is 8 ns, a clock 13 of them"),
        ("7ns", "3MHz", "a tick is 7 ns, a clock 48 of them"),
        ("1us", "500kHz", "a tick is 1000 ns, a clock 2 of them"),
    ] {
        let link = link(tick, "motion=still,pos=77,frame=st16,nE,nW,crc6");
        let (out, said, status) = read(&link, &["-f", "st16,nE,nW,crc6", "-c", clock, "-v"]);
        assert!(out.contains("pos 77 "), "{tick}: {out}{said}");
        assert!(said.contains(runs), "{tick}: {said}");
        assert_eq!(status, Some(0), "{tick}: {said}");
    }
    let slow = link("1us", "motion=still,pos=77,frame=st16,nE,nW,crc6");
    let (_, said, status) = read(&slow, &["-f", "st16,nE,nW,crc6", "-c", "1MHz"]);
    assert!(
        said.contains("MA runs at 500kHz (measured): 1MHz is more"),
        "{said}"
    );
    assert_eq!(status, Some(0), "{said}");
}

/// About the longest line that there is.
#[test]
fn a_line_delay_of_many_clocks_is_borne() {
    let link = link(
        "8ns",
        "motion=count,pos=5,delay=39500ns,frame=st16,nE,nW,crc6",
    );
    let (out, said, status) = read(&link, &["-f", "st16,nE,nW,crc6", "-n", "5", "-o", "json"]);
    assert_eq!(status, Some(0), "{out}{said}");
    let records = json(&out);
    let places: Vec<u64> = records.iter().filter_map(|r| r["pos"].as_u64()).collect();
    assert!(
        places.windows(2).all(|two| two[1] == two[0] + 1) && places.len() == 5,
        "{out}"
    );
    assert!(
        records.iter().all(|record| record["delay_clk"] == 39),
        "{out}"
    );
}

#[test]
fn registers_are_read_and_written_through_it() {
    let config = "slaves=each,frame=st16,nE,nW,crc6+st18,nE,nW,crc6";
    let wire = link("100ns", config);
    let on = |verb: &str, args: &[&str]| {
        let run = |link: &str| texts(biss(&[verb, link]).args(args).output().unwrap());
        let (got, wanted) = (run(&wire), run(&format!("sim:{config}")));
        assert_eq!(got, wanted, "{verb} {args:?}");
        assert_eq!(got.2, Some(0), "{verb} {args:?}: {}", got.1);
        got.0
    };
    let shown = on("reg", &["--slave", "1", "read", "0x78..0x7F"]);
    assert!(shown.contains("0x78"), "{shown}");
    on("reg", &["write", "0x48=0x5A", "--verify"]);
    on("command", &["activate-data", "--slave", "0"]);
    let shown = on("info", &[]);
    assert!(shown.contains("st16,nE,nW,crc6"), "{shown}");
    let (out, said, status) = read(&wire, &["-f", "auto"]);
    assert_eq!(status, Some(0), "{out}{said}");
    assert!(said.contains("st16,nE,nW,crc6+st18"), "{said}");
}

/// A child that does it wrong, and what is said of it.
fn fails(command: &str, words: &[&str]) {
    let began = Instant::now();
    let link = format!("exec:silence=300ms,{command}");
    let (out, said, status) = read(&link, &["-f", "st16,nE,nW,crc6"]);
    println!("{said}");
    assert_eq!((out.as_str(), status), ("", Some(2)), "{command}: {said}");
    for word in words.iter().chain(&[command]) {
        assert!(said.contains(word), "no `{word}` for {command}: {said}");
    }
    assert!(said.lines().count() >= 2, "no hint: {said}");
    assert!(began.elapsed() < Duration::from_secs(8), "{command}");
}

#[test]
fn a_child_that_dies_is_named_with_how_it_died() {
    fails(
        "exit 3",
        &["exit status 3", "before its first answer", "printf 1111"],
    );
    fails(
        "/nowhere/slave",
        &["exit status 127", "executable, and in PATH"],
    );
    fails("kill -SEGV $$", &["killed by SIGSEGV"]);
    fails(
        "(exit 139)",
        &["exit status 139 (the shell's word for SIGSEGV)"],
    );
    let slave = link("8ns", "frame=st16,nE,nW,crc6");
    let slave = slave.strip_prefix("exec:tick=8ns,").unwrap();
    // In the middle of a frame: the first ones begin after 5000 ticks of rest.
    let cut = format!("dd bs=1 count=5600 status=none | ({slave})");
    fails(&cut, &["exit status 0 after 5600 ticks"]);
}

#[test]
fn a_child_that_says_nothing_or_too_much_is_named() {
    fails(
        "exec sleep 60",
        &["answered nothing for 300ms", "flush stdout"],
    );
    fails(
        "head -c 100 | tr 0 1; exec sleep 60",
        &["answered nothing for 300ms", "after 100 ticks"],
    );
    fails(
        "echo 'Hello, \"world\"'; cat",
        &[r#"printed "Hello, \"world\"\n" for SLO"#, "stderr"],
    );
    fails(
        "tr 1 x",
        &[r#"printed "xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx…""#],
    );
    fails(r"printf '1\033[2J'; cat", &[r"\x1b[2J", "after 1 tick"]);
    fails(
        "exec tr '\\0' 1 < /dev/zero",
        &["answers more than it was asked"],
    );
    fails("sed 's/./&&/g'", &["answered nothing"]);
    fails("exec <&-; sleep 60", &["closed its stdin"]);
    fails("exec >&-; cat > /dev/null", &["closed its stdout"]);
}

/// A pipe that nobody empties stops neither side: a rest of seconds in one go.
#[test]
fn long_rests_pass_both_ways() {
    let link = link("5us", "motion=still,pos=9,frame=st8,nE,nW,crc6");
    let more = "-f st8,nE,nW,crc6 -c 100kHz -n 3 -i 700ms -o json --timeout 20us";
    let more: Vec<&str> = more.split(' ').collect();
    let (out, said, status) = read(&link, &more);
    assert_eq!(status, Some(0), "{said}");
    let times: Vec<u64> = json(&out)
        .iter()
        .map(|record| record["t_ns"].as_u64().unwrap())
        .collect();
    assert_eq!(times, [0, 700_000_000, 1_400_000_000], "{out}");
}

/// Processes with these words in their command line.
fn running(words: &str) -> Vec<String> {
    let processes = std::fs::read_dir("/proc").unwrap().flatten();
    processes
        .filter_map(|process| std::fs::read_to_string(process.path().join("cmdline")).ok())
        .filter(|line| line.contains(words))
        .collect()
}

#[test]
fn nothing_is_left_running() {
    // Numbers that no other process has.
    let tag = |n: u32| format!("{}.{}", 86_000 + n, std::process::id());
    let left = |n: u32| {
        let words = tag(n);
        let until = Instant::now() + Duration::from_secs(2);
        while !running(&words).is_empty() && Instant::now() < until {
            std::thread::sleep(Duration::from_millis(10));
        }
        assert_eq!(running(&words), [] as [String; 0]);
    };
    let slave = link("8ns", "frame=st16,nE,nW,crc6");
    let slave = slave.strip_prefix("exec:tick=8ns,").unwrap();
    let frame = ["-f", "st16,nE,nW,crc6"];
    // One that goes on beside a slave that ends well, one that does not care for the end of its stdin, one that failed.
    let link = format!("exec:sleep {} & ({slave})", tag(1));
    assert_eq!(read(&link, &frame).2, Some(0));
    left(1);
    let link = format!(
        "exec:({slave}); trap '' TERM; sleep {}; sleep {}",
        tag(2),
        tag(2)
    );
    assert_eq!(read(&link, &frame).2, Some(0));
    left(2);
    let link = format!("exec:silence=200ms,trap '' TERM; sleep {}", tag(3));
    assert_eq!(read(&link, &frame).2, Some(2));
    left(3);
}

/// Sends a signal to a whole process group, as Ctrl-C at a terminal does, once a line was printed.
fn interrupted(
    link: &str,
    more: &[&str],
    signal: &str,
    wait_for_line: bool,
) -> (String, Option<i32>, Duration) {
    use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
    let mut child = biss(&["read", link, "-f", "st16,nE,nW,crc6"])
        .args(more)
        .process_group(0)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdout = child.stdout.take().unwrap();
    if wait_for_line {
        stdout.read_exact(&mut [0; 10]).unwrap();
    } else {
        std::thread::sleep(Duration::from_millis(300));
    }
    let drain = std::thread::spawn(move || std::io::copy(&mut stdout, &mut std::io::sink()));
    let began = Instant::now();
    let group = format!("-{}", child.id());
    let kill = Command::new("sh")
        .args(["-c", &format!("kill -{signal} {group}")])
        .status();
    assert!(kill.unwrap().success());
    let output = child.wait_with_output().unwrap();
    drain.join().unwrap().unwrap();
    let code = output.status.code().or(output.status.signal());
    (
        String::from_utf8(output.stderr).unwrap(),
        code,
        began.elapsed(),
    )
}

#[test]
fn a_signal_ends_the_master_first_and_then_the_child() {
    let slave = link("8ns", "frame=st16,nE,nW,crc6");
    let (_, command) = slave.split_once("TEST_TICK").unwrap();
    // Were it hit by the signal itself, the rest at the end would be missing.
    let folder = std::env::temp_dir().join(format!("biss-exec-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let levels = folder.join("levels");
    let link = format!("exec:tee {} | (TEST_TICK{command})", levels.display());
    let (said, code, took) = interrupted(&link, &["-n", "0"], "INT", true);
    assert!(said.contains("frames"), "{said}");
    assert!(!said.contains("running the slave"), "{said}");
    assert_eq!(code, Some(0), "{said}");
    assert!(took < Duration::from_secs(5), "{took:?}");
    let sent = std::fs::read(&levels).unwrap();
    let rest = sent
        .iter()
        .rev()
        .take_while(|level| **level == b'1')
        .count();
    assert!(rest * 8 >= 40_000, "MA rested for {rest} ticks at the end");
    std::fs::remove_dir_all(&folder).unwrap();
    // A rest of an hour, and a child that never answers.
    let (said, code, took) = interrupted(&slave, &["-n", "0", "-i", "3600s"], "INT", false);
    assert_eq!(code, Some(0), "{said}");
    assert!(took < Duration::from_secs(6), "{took:?}");
    let (said, code, took) = interrupted("exec:exec sleep 60", &[], "TERM", false);
    assert!(
        said.contains("`exec sleep 60`: stopped by a signal"),
        "{said}"
    );
    assert_eq!(code, Some(15), "a death by SIGTERM: {said}");
    assert!(took < Duration::from_secs(3), "{took:?}");
}

#[test]
fn a_variable_runs_nothing() {
    let mark = std::env::temp_dir().join(format!("biss-ran-{}", std::process::id()));
    let link = format!("exec:touch {}", mark.display());
    for verb in [
        &["read", "-f", "st16,nE,nW,crc6"][..],
        &["info"],
        &["reg", "dump"],
        &["command", "activate-data", "--slave", "0"],
    ] {
        let output = biss(verb).env("BISS_LINK", &link).output().unwrap();
        let (out, said, status) = texts(output);
        assert_eq!((out.as_str(), status), ("", Some(2)), "{verb:?}: {said}");
        assert!(said.starts_with("biss: "), "{said}");
        assert!(
            said.contains("BISS_LINK") && said.contains("type it"),
            "{said}"
        );
    }
    assert!(!mark.exists(), "it ran");
    let (_, said, status) = texts(biss(&["loopback", &link]).output().unwrap());
    assert_eq!(status, Some(2), "{said}");
    assert!(!mark.exists(), "it ran");
    // What is typed beats the variable.
    let output = biss(&["read", "sim"]).env("BISS_LINK", &link).output();
    assert_eq!(texts(output.unwrap()).2, Some(0));
}

/// Whether a program of somebody else is there; where all have to be, that it is missing fails.
fn installed(program: &str) -> bool {
    let there = Command::new(program)
        .arg("-V")
        .stdin(Stdio::null())
        .output()
        .is_ok();
    let all = std::env::var_os("BISS_TEST_ALL").is_some();
    assert!(there || !all, "{program} is not installed");
    if !there {
        println!("{program} is not installed: its slave is not tried");
    }
    there
}

/// Those count by 1000 a frame, and their CRC is none of ours.
fn counts(command: &str) {
    let frame = "st16,nE,nW,crc6";
    for clock in ["1MHz", "10MHz"] {
        let link = format!("exec:{command}");
        let args = ["-f", frame, "-c", clock, "-n", "10", "-o", "json"];
        let (out, said, status) = read(&link, &args);
        assert_eq!(status, Some(0), "{command} at {clock}: {out}{said}");
        let places: Vec<u64> = json(&out)
            .iter()
            .map(|r| r["pos"].as_u64().unwrap())
            .collect();
        assert_eq!(places.len(), 10);
        let steps = |two: &[u64]| (two[1] + 65_536 - two[0]) % 65_536;
        assert!(
            places.windows(2).all(|two| steps(two) == 1000),
            "{command} at {clock}: {places:?}"
        );
    }
}

/// The drawing shows when SL rose, not when a rest behind that was over.
#[test]
fn the_timeout_is_drawn_as_it_was_seen() {
    let link = link("10ns", "timeout=20us,frame=st16,nE,nW,crc6");
    let args = ["scope", &link, "-f", "st16,nE,nW,crc6", "-n", "2"];
    let (out, err, code) = texts(biss(&args).output().unwrap());
    assert_eq!(code, Some(0), "{out}{err}");
    // SL is looked at once a quarter of a clock.
    let seen: Vec<f64> = out
        .lines()
        .filter_map(|line| line.strip_prefix("MA 1 MHz")?.split_once("timeout "))
        .map(|(_, rest)| rest.split(' ').next().unwrap().parse().unwrap())
        .collect();
    assert_eq!(seen.len(), 2, "{out}");
    assert!(seen.iter().all(|us| (20.0..20.5).contains(us)), "{out}");
}

#[test]
fn a_slave_in_python_counts() {
    if installed("python3") {
        counts("python3 docs/exec/slave.py");
    }
}

/// Compiles Verilog, if it can be.
fn compiled(name: &str, text: &str) -> Option<String> {
    if !installed("iverilog") || !installed("vvp") {
        return None;
    }
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let (source, made) = (
        folder.join(format!("{name}.v")),
        folder.join(format!("{name}.vvp")),
    );
    std::fs::write(&source, text).unwrap();
    let output = Command::new("iverilog")
        .args(["-g2005", "-Wall", "-o"])
        .args([&made, &source])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && said.is_empty(), "{said}");
    Some(made.display().to_string())
}

const VERILOG: &str = include_str!("../docs/exec/slave.v");

#[test]
fn a_slave_in_verilog_counts() {
    if let Some(made) = compiled("slave", VERILOG) {
        counts(&format!("vvp -n {made}"));
    }
}

/// What the simulator dumps is a recording of what the master saw. Its own messages want another way than SLO's.
#[test]
fn a_dump_of_the_simulator_reads_back() {
    let dump = Path::new(env!("CARGO_TARGET_TMPDIR")).join("dump.vcd");
    let mut text = VERILOG.to_owned();
    for (old, new) in [
        (", STDOUT = 32'h8000_0001;", ";\n  integer STDOUT;"),
        (
            "    ma = 1;\n",
            "    ma = 1;\n    STDOUT = $fopen(\"/dev/fd/3\", \"w\");\n",
        ),
        (
            "  wire ma, slo;\n",
            &format!(
                "  wire ma, slo;\n  initial begin $dumpfile(\"{}\"); $dumpvars(0, bench); end\n",
                dump.display()
            ),
        ),
    ] {
        assert_eq!(text.matches(old).count(), 1, "{old}");
        text = text.replace(old, new);
    }
    let Some(made) = compiled("dump", &text) else {
        return;
    };
    let fields = ["-f", "st16,nE,nW,crc6", "-F", "pos"];
    let link = format!("exec:vvp -n {made} 3>&1 >&2");
    let (live, said, status) = read(&link, &[&fields[..], &["-n", "5"]].concat());
    assert_eq!(status, Some(0), "{said}");
    assert!(said.contains("VCD info"), "{said}");
    let recorded = format!("file:{},ma=bench.ma,slo=bench.slo", dump.display());
    let (all, said, status) = read(&recorded, &fields);
    assert_eq!(status, Some(0), "{said}");
    assert_eq!(live.lines().count(), 5);
    // The frames before them, by which the encoder was learned, are there as well.
    assert!(all.ends_with(&live) && all.lines().count() > 5, "{all}");
}
