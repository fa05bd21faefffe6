//! The program as a user types it, on the simulated slave.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;

use common::{biss, json, run, texts};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

#[test]
fn text_is_what_the_design_shows() {
    let (stdout, stderr, status) = run(
        "read sim:turn=3,pos=524288,rpm=3,warning=30%,seed=4,frame=mt12,st20,nE,nW,crc6 -n 3 -i 1ms",
    );
    let lines: Vec<&str> = stdout.lines().collect();
    assert_eq!(lines.len(), 3);
    for (index, line) in lines.iter().enumerate() {
        assert!(
            line.starts_with(&format!("  0.00{index}000  turn 3  pos 524")),
            "{line}"
        );
        assert!(line.contains("  180.0") && line.contains('°'), "{line}");
        assert!(
            line.ends_with("  ok") || line.ends_with("  warning"),
            "{line}"
        );
    }
    assert_eq!(stderr.lines().count(), 1, "{stderr}");
    assert!(
        stderr.starts_with("biss: 3 frames, 3 good, 0 faults"),
        "{stderr}"
    );
    assert_eq!(status, Some(0), "a warning does not change the status");
}

#[test]
fn one_frame_is_one_line_and_nothing_else() {
    let (stdout, stderr, status) = run("read sim");
    assert_eq!(
        (stdout.lines().count(), stderr.as_str(), status),
        (1, "", Some(0))
    );
}

#[test]
fn keys_come_in_their_order() {
    let (stdout, _, _) =
        run("read sim:cds=1,frame=mt4,st12,data8=temp,lc6,nE,nW,crc6+pos8,E -n 2 -o json -v");
    let keys = |line: &str| -> Vec<String> {
        let mut keys = Vec::new();
        let mut rest = line;
        while let Some((before, after)) = rest.split_once("\":") {
            keys.push(before.rsplit_once('"').unwrap().1.to_owned());
            rest = after;
        }
        keys
    };
    let lines: Vec<&str> = stdout.lines().collect();
    assert_eq!(lines.len(), 4, "a record a channel");
    let first = "type t_ns seq ch ok turn pos temp lc deg error warning tries ack delay_clk cds crc scd bits";
    assert_eq!(keys(lines[0]).join(" "), first);
    assert_eq!(
        keys(lines[1]).join(" "),
        "type t_ns seq ch ok pos error tries ack delay_clk cds unprotected scd bits"
    );
    let records = json(&stdout);
    assert_eq!(records[0]["t_ns"], records[1]["t_ns"]);
    assert_eq!(records[0]["seq"], records[1]["seq"]);
    let (stdout, _, _) = run("read sim:crc-error=1 -o json");
    let wanted = "type t_ns seq ok fault got want tries ack delay_clk cds crc scd";
    assert_eq!(keys(stdout.trim_end()).join(" "), wanted);
}

/// A data field must not take the name of anything else in a record.
#[test]
fn no_field_can_be_named_like_a_key() {
    let mut keys = std::collections::BTreeSet::new();
    for args in [
        "read sim:frame=mt4,st12,lc6,nE,nW,crc6+pos8,E -n 2 -o json -v",
        "read sim -t delta -o json",
        "read sim -t unix -o json",
        "read sim:stuck=0 -o json",
        "read sim:stuck=1 -o json",
        "read sim:no-start=1 -o json",
        "read sim:crc-error=1 -o json",
        "read sim -c 50kHz -o json -q",
        "read sim:frame=st26,nE,nW,crc6 -f st20,nE,nW,crc6 -n 20 -o json -q",
        "read file:tests/recordings/faults.vcd -f st26,nE,nW,crc6 -o json -q",
        "read file:tests/recordings/flags.vcd -f st26,nE,nW,crc6 -o json -q",
        "read sim --unwrap -o json",
        "read sim --unit rad -o json",
        "read sim --unit turns -o json",
        "read sim --resolution 50nm -o json",
        "read sim --resolution 50nm --unit um -o json",
    ] {
        for record in json(&run(args).0) {
            keys.extend(record.as_object().unwrap().keys().cloned());
        }
    }
    let header = run("read sim -o csv -v").0;
    let header = header.lines().next().unwrap();
    keys.extend(header.split(',').map(str::to_owned));
    assert!(keys.len() > 30, "{keys:?}");
    for key in keys {
        let error = format!("data8={key}")
            .parse::<biss::Format>()
            .expect_err(&key)
            .to_string();
        assert!(error.contains("something else in a record"), "{error}");
    }
}

/// The promise, at the last place where it could be broken: no record with a fault has a position of any name.
#[test]
fn a_record_with_a_fault_has_no_position() {
    let mut rng = common::rng();
    let mut kinds = std::collections::BTreeSet::new();
    let rounds = common::size(60).max(60);
    for round in 0..10 * rounds {
        // A stop bit in the wrong place is rarer than the others.
        if round >= rounds && kinds.contains("stop") {
            break;
        }
        let format = common::format(&mut rng);
        let link = format!(
            "sim:crc-error=20%,no-ack=10%,no-start=10%,null=20%,flip=0.2%,busy=0us..9us,seed={},frame={format}",
            rng.u32(..)
        );
        // Now and then the master expects another format than the slave sends.
        let expected = if rng.u8(..4) == 0 {
            common::format(&mut rng)
        } else {
            format.clone()
        };
        let (stdout, stderr, status) = texts(
            biss(&[
                "read", &link, "-f", &expected, "-n", "40", "-o", "json", "-q",
            ])
            .output()
            .unwrap(),
        );
        assert!(stderr.is_empty() && status != Some(2), "{link}: {stderr}");
        let mut bad = false;
        for record in json(&stdout) {
            let Some(fault) = record.get("fault") else {
                bad |= record.get("error") == Some(&Value::Bool(true));
                continue;
            };
            bad = true;
            kinds.insert(fault.as_str().unwrap().to_owned());
            assert_eq!(record["ok"], false);
            for key in [
                "turn", "pos", "deg", "temp", "data", "lc", "error", "warning",
            ] {
                assert!(record.get(key).is_none(), "{key} in {record}");
            }
        }
        assert_eq!(status, Some(i32::from(bad)), "{link} {expected}\n{stdout}");
        let (text, ..) = texts(
            biss(&["read", &link, "-f", &expected, "-n", "40", "-q"])
                .output()
                .unwrap(),
        );
        for line in text.lines().filter(|line| line.contains("fault")) {
            assert!(
                !line.contains("pos ") && !line.contains('°') && !line.contains("turn "),
                "{line}"
            );
        }
    }
    for kind in ["crc", "no-ack", "no-start", "null", "stop"] {
        assert!(
            kinds.contains(kind),
            "{kind} never happened, only {kinds:?}"
        );
    }
}

#[test]
fn exit_status_says_what_happened() {
    for (args, want) in [
        ("read sim -n 5", 0),
        ("read sim:warning=1 -n 5", 0),
        ("read sim:error=1 -n 5", 1),
        ("read sim:stuck=1", 1),
        ("read sim:stuck=0", 1),
        ("read sim:crc-error=1", 1),
        ("read sim:null=1", 1),
        ("read sim:frame=st26,nE,nW,crc6 -f st20,nE,nW,crc6 -n 20", 1),
        ("read sim:power-up=low -n 3", 0),
        ("read", 2),
        ("read sim -i 40", 2),
        ("read sim -i 0us", 2),
        ("read sim -c 2", 2),
        ("read sim -f st26,nF", 2),
        ("read sim:dellay=1us", 2),
        ("read sim --frobnicate", 2),
        ("read spi:9.9", 2),
        ("read spi:9.9 -f st26", 2),
        ("read gpio:99,ma=1,slo=2 -f st26", 2),
        ("read file:no/such.vcd -f st26", 2),
        ("read file:tests/recordings/bench.vcd", 2),
        (
            "read file:tests/recordings/bench.vcd -f st26,nE,nW,crc6 -c 1MHz",
            2,
        ),
        (
            "read file:tests/recordings/bench.vcd -f st26,nE,nW,crc6 -i 1ms",
            2,
        ),
        ("read file:tests/recordings/bench.vcd -f st26,nE,nW,crc6", 0),
        (
            "read file:tests/recordings/bench.vcd -f st26,nE,nW,crc6 -n 2",
            0,
        ),
        (
            "read file:tests/recordings/bench.vcd -f st26,nE,nW,crc6 -n 9",
            1,
        ),
        ("read file:Cargo.toml -f st26", 2),
    ] {
        let (stdout, stderr, status) = run(args);
        assert_eq!(status, Some(want), "{args}\n{stdout}{stderr}");
        if want == 2 {
            assert!(
                stderr.starts_with("biss: ") && stdout.is_empty(),
                "{args}: {stderr}"
            );
        }
    }
}

#[test]
fn errors_say_what_to_try() {
    for (args, words) in [
        ("read spi:9.9 -f st26", ["/dev/spidev9.9", "dtparam=spi=on"]),
        (
            "read gpio:99,ma=1,slo=2 -f st26",
            ["/dev/gpiochip99", "number, name, label or path"],
        ),
        ("read spi:0.0", ["no frame format", "-f st26,nE,nW,crc6"]),
        (
            "read gpio:99,ma=1,slo=2,mo=3,uapi=v2 -f st26",
            ["/dev/gpiochip99", "number, name, label or path"],
        ),
        (
            "read gpio:0,ma=1,slo=2,uapi=3 -f st26",
            ["uapi is v1 or v2", "[,uapi=v1|v2]"],
        ),
        (
            "read gpio:0,ma=1,slo=2,mo=1 -f st26",
            ["three different lines", "[,mo=LINE]"],
        ),
        (
            "read gpio:0,ma=1,slo=2,up=3 -f st26",
            ["no option `up`", "known are ma= slo= mo= uapi= frame="],
        ),
        ("read sim -i 40", ["no unit", "40us"]),
        ("read sim:dellay=1us", ["no `dellay`", "delay=TIME"]),
        ("read sim -f st26,nF", ["unknown field `nF`", "^^"]),
        ("read sim --time noon", ["noon", "unix"]),
    ] {
        let (_, stderr, _) = run(args);
        for word in words {
            assert!(stderr.contains(word), "{args}: no `{word}` in {stderr}");
        }
    }
}

#[test]
fn the_same_seed_prints_the_same_bytes() {
    let args =
        "read sim:fast,seed=9,crc-error=5%,flip=0.1%,jitter=100ns,busy=1us..5us -n 500 -o json";
    let first = run(args);
    assert_eq!(first, run(args));
    assert_ne!(first.0, run(&args.replace("seed=9", "seed=8")).0);
}

#[test]
fn environment_is_the_weakest() {
    let with = |args: &[&str], link: Option<&str>, frame: Option<&str>| {
        let mut command = biss(args);
        link.map(|link| command.env("BISS_LINK", link));
        frame.map(|frame| command.env("BISS_FRAME", frame));
        texts(command.output().unwrap())
    };
    assert_eq!(with(&["read"], Some("sim:stuck=1"), None).2, Some(1));
    assert_eq!(with(&["read", "sim"], Some("sim:stuck=1"), None).2, Some(0));
    assert!(
        with(&["read", "sim"], None, Some("mt4,st8,crc5"))
            .0
            .contains("turn 0")
    );
    assert!(
        !with(&["read", "sim:frame=pos8,crc5"], None, Some("mt4,st8,crc5"))
            .0
            .contains("turn")
    );
    // Nobody looks for a mistake in what he has not typed.
    for (args, link, frame, words) in [
        (
            &["read"][..],
            Some("sim:x"),
            None,
            "'<LINK>' from BISS_LINK: ",
        ),
        (&["read", "sim"], None, Some("st0"), "' from BISS_FRAME: "),
        (&["read", "sim:x"], Some("sim"), None, "'<LINK>': "),
        (&["read", "sim", "-fst0"], None, Some("st8"), "auto>': "),
        (&["read", "sim", "-n", "st0"], None, Some("st0"), "<N>': "),
    ] {
        let (stdout, stderr, status) = with(args, link, frame);
        assert_eq!((stdout.as_str(), status), ("", Some(2)));
        let first = stderr.lines().next().unwrap();
        assert!(first.contains(words), "{first}");
        assert_eq!(first.contains("BISS"), words.contains("BISS"), "{first}");
    }
    // Set to nothing is not set.
    let (stdout, stderr, status) = with(&["read", "sim", "-q"], Some(""), Some(""));
    assert_eq!((stdout, stderr, status), run("read sim -q"));
    let missing = with(&["read"], Some(""), None);
    assert!(missing.1.contains("not provided"), "{}", missing.1);
    assert_eq!(missing.2, Some(2));
    let flag = with(
        &["read", "sim:frame=pos8,crc5", "-f", "pos8,crc4"],
        None,
        None,
    );
    assert_eq!(
        flag.2,
        Some(1),
        "the flag beats the link, so the CRC does not fit: {}",
        flag.0
    );
}

#[test]
fn slots_are_absolute_and_missed_ones_counted() {
    let (stdout, stderr, _) = run("read sim:fast -n 4 -i 1ms -o json");
    let times: Vec<_> = json(&stdout)
        .iter()
        .map(|r| (r["t_ns"].as_u64().unwrap(), r["seq"].as_u64().unwrap()))
        .collect();
    assert_eq!(
        times,
        [(0, 0), (1_000_000, 1), (2_000_000, 2), (3_000_000, 3)]
    );
    assert_eq!(json(&stderr)[0]["rate_hz"], 1000.0);
    // A frame takes 65 us of its 20 us slots.
    let (stdout, stderr, _) = run("read sim:fast -n 4 -i 20us -o json");
    let records = json(&stdout);
    let skipped = json(&stderr)[0]["skipped"].as_u64().unwrap();
    let last = records[3]["seq"].as_u64().unwrap();
    assert!(skipped > 0);
    assert_eq!(last, 3 + skipped, "{stdout}{stderr}");
    for record in &records {
        let (t, seq) = (
            record["t_ns"].as_u64().unwrap(),
            record["seq"].as_u64().unwrap(),
        );
        assert!(t.abs_diff(seq * 20_000) < 20_000, "{record}");
    }
}

#[test]
fn an_interval_keeps_real_time_on_sim_and_fast_does_not() {
    let timed = |args: &str| {
        let start = Instant::now();
        run(args);
        start.elapsed()
    };
    assert!(timed("read sim -n 6 -i 50ms -q") >= Duration::from_millis(240));
    assert!(timed("read sim:fast -n 100 -i 1s -q") < Duration::from_secs(50));
}

#[test]
fn time_styles() {
    let (stdout, ..) = run("read sim -n 3 -i 1ms -t delta -o json -q");
    let deltas: Vec<_> = json(&stdout).iter().map(|r| r["dt_ns"].clone()).collect();
    assert_eq!(deltas, [0, 1_000_000, 1_000_000]);
    let (stdout, ..) = run("read sim -t none -o json -q");
    assert!(
        !stdout.contains("t_ns") && stdout.starts_with("{\"type\":\"frame\",\"seq\":0"),
        "{stdout}"
    );
    let (stdout, ..) = run("read sim -t none -q");
    assert!(stdout.starts_with("turn 0"), "{stdout}");
    let now = std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .unwrap()
        .as_micros() as u64;
    let (stdout, ..) = run("read sim -t unix -o json -q");
    let unix = json(&stdout)[0]["t_unix_us"].as_u64().unwrap();
    assert!(unix.abs_diff(now) < 60_000_000, "{unix} {now}");
}

#[test]
fn waits_for_an_encoder_only_so_long() {
    let (stdout, _, status) = run("read sim:no-ack=97%,seed=2 --wait 60s -q");
    // The first good frames come late; what is read then may be a fault again, but it was waited for.
    assert!(!stdout.is_empty() && status != Some(2));
    let (stdout, _, status) = run("read sim:stuck=1 --wait 1s -q");
    assert_eq!((stdout.lines().count(), status), (1, Some(1)));
}

#[test]
fn waits_until_an_encoder_appears_and_says_so_once() {
    const SAYS: &str = "no good frame yet, waiting up to 1s for one";
    for link in ["sim:absent=200ms", "sim:absent=200ms,power-up=low"] {
        let (stdout, stderr, status) = run(&format!("read {link} --wait 1s -n 3"));
        assert_eq!(stdout.matches("  ok").count(), 3, "{stdout}");
        assert_eq!(stderr.matches(SAYS).count(), 1, "{stderr}");
        assert_eq!((stderr.lines().count(), status), (2, Some(0)));
        let quiet = run(&format!("read {link} --wait 1s -n 3 -q"));
        assert_eq!((quiet.1.as_str(), quiet.2), ("", Some(0)));
    }
    // Not there in time: the fault is the record.
    let (stdout, stderr, status) = run("read sim:absent=2s --wait 1s");
    assert!(stdout.contains("fault no-ack"), "{stdout}");
    assert_eq!(stderr.matches(SAYS).count(), 1, "{stderr}");
    assert!(stderr.contains("no encoder") && stderr.lines().count() == 2);
    assert_eq!(status, Some(1));
    assert_eq!(run("read sim:absent=1us -q").2, Some(0));
    // Who is there at once is not waited for.
    assert_eq!(run("read sim --wait 1s").1, "");
    let (_, stderr, status) = run("read file:tests/recordings/bench.vcd -f st26 --wait 1s");
    assert!(stderr.contains("no meaning on a recording") && status == Some(2));
}

#[test]
fn ctrl_c_ends_the_wait() {
    // More virtual time than any machine lets pass while a test runs.
    let args = ["read", "sim:stuck=1", "--wait", "86400s", "-o", "csv"];
    let (mut child, mut stdout) = spawn(&args);
    let mut stderr = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    stderr.read_line(&mut line).unwrap();
    assert!(line.contains("waiting up to 86400s"), "{line}");
    stdout.read_line(&mut line).unwrap();
    assert!(line.contains("t_ns,seq,ok"), "the header does not wait");
    signal(&child, "INT");
    assert_eq!(child.wait().unwrap().code(), Some(1), "nothing was read");
    let mut rest = String::new();
    stdout.read_to_string(&mut rest).unwrap();
    assert_eq!(rest, "");
}

#[test]
fn retries_repeat_a_bad_frame() {
    let (stdout, stderr, _) = run("read sim:crc-error=50%,seed=3 -n 50 --retries 20 -o json");
    let records = json(&stdout);
    assert!(records.iter().all(|r| r["ok"] == true), "{stdout}");
    let tries: u64 = records.iter().map(|r| r["tries"].as_u64().unwrap()).sum();
    let summary = &json(&stderr)[0];
    assert_eq!(summary["retries"], tries - 50);
    assert!(tries > 60);
}

/// The wait for a slot is no part of a frame's own time.
#[test]
fn retries_have_room_in_a_long_slot() {
    let (stdout, ..) = run("read sim:fast,no-ack=30%,seed=3 -n 30 -i 1ms --retries 9 -o json -q");
    let records = json(&stdout);
    assert!(records.iter().all(|r| r["ok"] == true), "{stdout}");
    assert!(records.iter().any(|r| r["tries"] != 1), "{stdout}");
    for (slot, record) in records.iter().enumerate() {
        assert_eq!(record["seq"], slot);
    }
}

fn spawn(args: &[&str]) -> (Child, BufReader<std::process::ChildStdout>) {
    let mut child = biss(args)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let stdout = BufReader::new(child.stdout.take().unwrap());
    (child, stdout)
}

fn signal(child: &Child, name: &str) {
    let kill = format!("kill -{name} {}", child.id());
    assert!(
        Command::new("sh")
            .args(["-c", &kill])
            .status()
            .unwrap()
            .success()
    );
}

#[test]
fn ctrl_c_ends_after_the_cycle_with_a_summary() {
    for (link, want) in [("sim", 0), ("sim:error=1", 1)] {
        let (mut child, mut stdout) = spawn(&["read", link, "-n", "0", "-i", "5ms", "-o", "json"]);
        let mut line = String::new();
        stdout.read_line(&mut line).unwrap();
        signal(&child, "INT");
        let mut rest = String::new();
        stdout.read_to_string(&mut rest).unwrap();
        let mut stderr = String::new();
        child
            .stderr
            .take()
            .unwrap()
            .read_to_string(&mut stderr)
            .unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(want));
        let records = json(&(line + &rest)).len() as u64;
        assert_eq!(json(&stderr)[0]["good"], records, "{stderr}");
    }
}

#[test]
fn ctrl_c_wakes_a_long_wait() {
    let (mut child, mut stdout) = spawn(&["read", "sim", "-n", "0", "-i", "3600s"]);
    stdout.read_line(&mut String::new()).unwrap();
    let start = Instant::now();
    signal(&child, "INT");
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert!(start.elapsed() < Duration::from_secs(30));
}

#[test]
fn sigterm_and_sighup_are_what_it_dies_of() {
    use std::os::unix::process::ExitStatusExt;
    for (name, number) in [("TERM", 15), ("HUP", 1)] {
        let (mut child, mut stdout) = spawn(&["read", "sim", "-n", "0", "-i", "5ms"]);
        stdout.read_line(&mut String::new()).unwrap();
        signal(&child, name);
        let mut rest = String::new();
        stdout.read_to_string(&mut rest).unwrap();
        assert!(
            rest.is_empty() || rest.ends_with('\n'),
            "a whole number of lines: {rest:?}"
        );
        assert_eq!(child.wait().unwrap().signal(), Some(number));
    }
}

#[test]
fn a_broken_pipe_is_a_quiet_end() {
    let (mut child, mut stdout) = spawn(&["read", "sim", "-n", "0"]);
    stdout.read_line(&mut String::new()).unwrap();
    drop(stdout);
    let mut stderr = String::new();
    child
        .stderr
        .take()
        .unwrap()
        .read_to_string(&mut stderr)
        .unwrap();
    assert_eq!(
        (stderr.as_str(), child.wait().unwrap().code()),
        ("", Some(0))
    );
}

#[test]
fn colours_follow_the_environment_unless_told() {
    let coloured = |color: &str, set: &[(&str, &str)]| {
        let mut command = biss(&["read", "sim", "--color", color]);
        command
            .env_remove("NO_COLOR")
            .env_remove("CLICOLOR")
            .env_remove("CLICOLOR_FORCE")
            .envs(set.iter().copied());
        texts(command.output().unwrap()).0.contains('\x1b')
    };
    let (no, force) = (("NO_COLOR", "1"), ("CLICOLOR_FORCE", "1"));
    for (color, set, want) in [
        ("auto", &[][..], false),
        ("auto", &[force], true),
        ("auto", &[no], false),
        ("auto", &[no, force], false),
        ("always", &[no], true),
        ("never", &[force], false),
    ] {
        assert_eq!(coloured(color, set), want, "{color} {set:?}");
    }
}

#[test]
fn colours_only_when_asked_for() {
    assert!(!run("read sim --color auto").0.contains('\x1b'));
    assert!(run("read sim --color always").0.contains("\x1b[32mok"));
    assert!(!run("read sim --color always -o json").0.contains('\x1b'));
    let ascii = biss(&["read", "sim"]).env("LC_ALL", "C").output().unwrap();
    assert!(String::from_utf8(ascii.stdout).unwrap().contains("deg  ok"));
}

#[test]
fn pinning_to_a_processor_and_refusing_one_that_is_not_there() {
    assert_eq!(run("read sim --cpu 0 -q").2, Some(0));
    let (_, stderr, status) = run("read sim --cpu 1000 -q");
    assert_eq!(status, Some(2));
    assert!(stderr.contains("processor 1000"), "{stderr}");
    assert_eq!(run("read sim --rt 100 -q").2, Some(2));
}

/// A pipe that is slow, or stays open for ever, holds nothing back and does not keep biss from ending.
#[test]
fn a_slow_pipe_is_followed_and_left() {
    use std::io::Write;
    let vcd = std::fs::read_to_string("tests/recordings/bench.vcd").unwrap();
    let args = ["read", "file:-", "-f", "st26,nE,nW,crc6", "-n", "0"];
    let mut child = biss(&args)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdin = child.stdin.take().unwrap();
    stdin.write_all(vcd.as_bytes()).unwrap();
    let mut stdout = BufReader::new(child.stdout.take().unwrap());
    for _ in 0..4 {
        stdout.read_line(&mut String::new()).unwrap();
    }
    signal(&child, "INT");
    let mut stderr = String::new();
    child
        .stderr
        .take()
        .unwrap()
        .read_to_string(&mut stderr)
        .unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(0), "{stderr}");
    assert!(stderr.contains(" good, 0 faults"), "{stderr}");
}

/// Until the process catches signals, and waits.
fn wait_asleep(child: &Child) {
    const CAUGHT: u64 = 1 << 0 | 1 << 1 | 1 << 14;
    let file = format!("/proc/{}/status", child.id());
    let asleep = || {
        let status = std::fs::read_to_string(&file).unwrap();
        let field = |name| status.lines().find_map(|line| line.strip_prefix(name));
        let caught = field("SigCgt:").map(|mask| u64::from_str_radix(mask.trim(), 16).unwrap());
        let state = field("State:").unwrap().trim();
        assert!(!state.starts_with('Z'), "it has ended by itself");
        let sleeps = state.starts_with('S');
        sleeps && caught.unwrap() & CAUGHT == CAUGHT
    };
    while !asleep() {
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Who ends biss before a recording has come does not read that it was a bad one.
#[test]
fn a_recording_that_has_not_come_is_left() {
    use std::os::unix::process::ExitStatusExt;
    let pipe = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("never-written");
    let _ = std::fs::remove_file(&pipe);
    let made = Command::new("mkfifo").arg(&pipe).status().unwrap();
    assert!(made.success());
    let named = format!("file:{}", pipe.display());
    for link in ["file:-", &named] {
        for (name, died) in [("INT", None), ("TERM", Some(15)), ("HUP", Some(1))] {
            let mut child = biss(&["read", link, "-f", "st8", "-o", "csv"])
                .stdin(Stdio::piped())
                .stdout(Stdio::piped())
                .stderr(Stdio::piped())
                .spawn()
                .unwrap();
            wait_asleep(&child);
            signal(&child, name);
            let status = child.wait().unwrap();
            let output = child.wait_with_output().unwrap();
            let ended = (status.code(), status.signal());
            assert_eq!(ended, (died.is_none().then_some(1), died), "{link} {name}");
            assert_eq!(output.stderr, b"", "{link} {name}");
        }
    }
}

#[test]
fn a_broken_recording_does_not_fill_the_memory() {
    let file = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("endless.vcd");
    let vcd = std::fs::read_to_string("tests/recordings/bench.vcd").unwrap();
    std::fs::write(&file, vcd + "b" + &"1".repeat(3 << 20)).unwrap();
    let (_, stderr, status) = run(&format!("read file:{} -f st26,nE,nW,crc6", file.display()));
    assert_eq!(status, Some(2));
    assert!(stderr.contains("more than 1 MiB"), "{stderr}");
}

#[test]
fn a_last_line_without_an_end_is_read() {
    let file = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("no-newline.vcd");
    let vcd = std::fs::read_to_string("tests/recordings/bench.vcd").unwrap();
    std::fs::write(&file, vcd.trim_end()).unwrap();
    assert_eq!(
        run(&format!(
            "read file:{} -f st26,nE,nW,crc6 -q",
            file.display()
        ))
        .2,
        Some(0)
    );
}

#[test]
fn what_cannot_be_written_is_an_error() {
    let full = std::fs::File::options()
        .write(true)
        .open("/dev/full")
        .unwrap();
    let output = biss(&["read", "sim"]).stdout(full).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(
        stderr.contains("writing records") && stderr.contains("No space left"),
        "{stderr}"
    );
}

/// A slave that is not ready has its say in its own slot.
#[test]
fn a_slave_that_is_not_ready_keeps_the_slots() {
    let (stdout, ..) = run("read sim:stuck=0,fast -n 5 -i 10ms -o json -q");
    for (slot, record) in json(&stdout).iter().enumerate() {
        assert_eq!(record["fault"], "not-ready");
        let t = record["t_ns"].as_u64().unwrap();
        assert!(t.abs_diff(slot as u64 * 10_000_000) < 300_000, "{record}");
    }
}

#[test]
fn a_recording_on_standard_input() {
    let vcd = std::fs::File::open("tests/recordings/bench.vcd").unwrap();
    let output = biss(&[
        "read",
        "file:-",
        "-f",
        "st26,nE,nW,crc6",
        "-o",
        "json",
        "-q",
    ])
    .stdin(vcd)
    .output()
    .unwrap();
    let expected = std::fs::read_to_string("tests/recordings/bench.json").unwrap();
    assert_eq!(texts(output), (expected, String::new(), Some(0)));
}

/// SL comes back in a later slot than the one that was due: the record has the number of the slot it was run in, and
/// every slot between counts as skipped.
#[test]
fn a_frame_that_is_pushed_into_a_later_slot_has_its_number() {
    let (stdout, said, _) = run("read sim:timeout=40us,fast -i 20us -n 6 -o json --clock 1MHz");
    let records = json(&stdout);
    let t = |r: &Value| r["t_ns"].as_u64().unwrap();
    let seq = |r: &Value| r["seq"].as_u64().unwrap();
    let frames: Vec<&Value> = records.iter().collect();
    for pair in frames.windows(2) {
        let slots = (t(pair[1]) - t(pair[0])) as f64 / 20_000.0;
        let numbers = (seq(pair[1]) - seq(pair[0])) as f64;
        assert!((slots - numbers).abs() < 1.0, "{slots} {numbers}");
    }
    let summary: Value = serde_json::from_str(said.lines().last().unwrap()).unwrap();
    let missed = seq(frames[frames.len() - 1]) - seq(frames[0]) + 1 - frames.len() as u64;
    assert_eq!(summary["skipped"].as_u64(), Some(missed), "{summary}");
}

/// Repeating ends with the slot.
#[test]
fn retries_end_with_their_slot() {
    let (stdout, ..) =
        run("read sim:crc-error=100%,fast -i 400us -n 3 -o json --clock 1MHz --retries 1000");
    let records = json(&stdout);
    let frames: Vec<&Value> = records.iter().collect();
    let numbers: Vec<u64> = frames.iter().map(|r| r["seq"].as_u64().unwrap()).collect();
    assert_eq!(numbers, [0, 1, 2], "{frames:?}");
    assert!(
        frames
            .iter()
            .all(|r| (2..6).contains(&r["tries"].as_u64().unwrap())),
        "{frames:?}"
    );
}

/// Whatever machine this is, `list` can look, and says something about both kinds of pins.
#[test]
fn list_looks_and_never_fails_for_what_it_finds() {
    let (stdout, stderr, status) = run("list");
    assert_eq!((stderr.as_str(), status), ("", Some(0)));
    let titles: Vec<&str> = stdout.lines().filter(|line| !line.is_empty()).collect();
    assert!(titles[0].contains(", Linux "), "{stdout}");
    assert!(
        titles.contains(&"GPIO") && titles.contains(&"SPI"),
        "{stdout}"
    );

    let (stdout, stderr, status) = run("list -o json");
    assert_eq!((stderr.as_str(), status), ("", Some(0)));
    let records = json(&stdout);
    assert_eq!(records[0]["type"], "list-board");
    let of = |what: &str, thing: &str| {
        records
            .iter()
            .any(|record| record["type"] == thing || record["what"] == what)
    };
    assert!(
        of("gpio", "list-chip") && of("spi", "list-spidev"),
        "{stdout}"
    );

    let (stdout, stderr, status) = run("list sim");
    assert_eq!((stdout.as_str(), status), ("", Some(2)));
    assert!(
        stderr.starts_with("biss: unexpected argument 'sim'"),
        "{stderr}"
    );
}

#[test]
fn list_says_when_it_cannot_write() {
    let full = std::fs::File::options()
        .write(true)
        .open("/dev/full")
        .unwrap();
    let output = biss(&["list"]).stdout(full).output().unwrap();
    let (_, stderr, status) = texts(output);
    assert_eq!(status, Some(2));
    assert!(
        stderr.starts_with("biss: writing the list: No space left"),
        "{stderr}"
    );

    let (reader, writer) = std::os::unix::net::UnixStream::pair().unwrap();
    drop(reader);
    let writer = std::os::fd::OwnedFd::from(writer);
    let output = biss(&["list"]).stdout(writer).output().unwrap();
    let (_, stderr, status) = texts(output);
    assert_eq!(
        (stderr.as_str(), status),
        ("", Some(0)),
        "a broken pipe is quiet"
    );
}

#[test]
fn a_loopback_in_process_needs_no_hardware() {
    let (stdout, stderr, status) = run("loopback -n 50");
    assert_eq!(status, Some(0), "{stderr}");
    assert_eq!(stdout.lines().count(), 8);
    assert!(
        stdout
            .lines()
            .all(|line| line.contains("50 of 50 frames as sent")),
        "{stdout}"
    );
    assert!(stderr.starts_with("biss: every position"), "{stderr}");

    let (stdout, stderr, status) = run("loopback sim:stuck=1 -c 1MHz -o json -q");
    assert_eq!((status, stderr.as_str()), (Some(1), ""));
    for step in json(&stdout) {
        assert_eq!(step["ok"], false);
        // Nothing works, so nobody waits for all of them.
        assert_eq!(step["frames"], 8);
        assert_eq!(step["faults"]["no-ack"], 8);
    }

    let (stdout, _, status) = run("loopback sim:crc-error=50%,seed=9 -n 200 -o json -q");
    assert_eq!(status, Some(1));
    for step in json(&stdout) {
        let (good, bad) = (step["as_sent"].as_u64(), step["faults"]["crc"].as_u64());
        assert_eq!(good.unwrap() + bad.unwrap(), 200, "{step}");
        assert_eq!(step["wrong"], 0);
    }

    // Without a CRC a flipped bit is a position that was never sent.
    let (stdout, _, status) = run("loopback sim:flip=2%,frame=st12,nE,nW -c 1MHz -n 100 -o json");
    assert_eq!(status, Some(1));
    for step in json(&stdout) {
        let (good, wrong) = (step["as_sent"].as_u64(), step["wrong"].as_u64());
        assert_eq!(step["ok"], false);
        assert!(wrong > Some(0), "{step}");
        assert_eq!(good.unwrap() + wrong.unwrap(), 100, "{step}");
    }
}

#[test]
fn a_loopback_says_what_it_needs() {
    for (args, words) in [
        ("loopback spi:0.0", "biss loopback wave:0.0"),
        ("loopback file:x.vcd", "needs no hardware"),
        ("loopback gpio:0,ma=17,slo=27", "ma-in=22,slo-out=23"),
        ("loopback gpio:0,ma=17,slo=27,ma-in=22", "slo-out=LINE"),
        (
            "loopback gpio:0,ma=17,slo=27,mo=22,ma-in=23,slo-out=24",
            "leave mo= out",
        ),
        ("loopback -n 0", "1.."),
        ("loopback --search 4,18", "--search looks"),
        ("loopback wave:0.0 -f st12", "--frame has no meaning"),
        (
            "read gpio:0,ma=17,slo=27,ma-in=22,slo-out=23 -f st8",
            "far ends of jumpers",
        ),
        (
            "read wave:0.0,idle=low -f st8 --timeout adaptive",
            "MA rests low",
        ),
    ] {
        let (stdout, stderr, status) = run(args);
        assert_eq!((stdout.as_str(), status), ("", Some(2)), "{args}");
        assert!(stderr.contains(words), "{args}: {stderr}");
    }
}
