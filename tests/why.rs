//! Why frames are bad, as the program says it: once on stderr with the next command to type, and in the summary.
#![allow(clippy::unwrap_used)]

mod common;

use common::{json, run};

/// What is said beside the summary.
fn whys(stderr: &str) -> Vec<&str> {
    let summary = |line: &&str| !line.contains(" frames, ") && !line.contains(" frame, ");
    stderr.lines().filter(summary).collect()
}

/// The command a line ends with.
fn next(line: &str) -> &str {
    line.split_once(": biss ").unwrap().1
}

#[test]
fn the_next_command_works() {
    for (typed, mut commands) in [
        ("read sim:busy=110us", 2),
        ("read sim:frame=st26,nE,nW,crc6 -f st22,nE,nW,crc6 -n 4", 1),
        ("read sim:frame=st24,nE,nW,crc8 -f st24,nE,nW,crc6", 1),
        ("read sim:clock-max=700kHz,pos=12345678 -n 4 -c 2MHz", 1),
        ("read sim:timeout=3us -c 100kHz", 1),
        (
            "stats sim:frame=mt12,st20,nE,nW,crc5 -f mt12,st20,nE,nW,crc6 -n 20",
            1,
        ),
    ] {
        let mut args = typed.to_owned();
        while commands > 0 {
            let (_, stderr, code) = run(&args);
            assert_eq!(code, Some(1), "{args}");
            let [why] = whys(&stderr)[..] else {
                panic!("{args}: {stderr}");
            };
            args = next(why).to_owned();
            commands -= 1;
        }
        let (_, stderr, code) = run(&args);
        assert_eq!(code, Some(0), "{typed} came to {args}: {stderr}");
        assert_eq!(whys(&stderr).len(), 0, "{args}: {stderr}");
    }
}

/// An encoder that was called by its name is so in the next command, or by all that its name stands for.
#[test]
fn the_next_command_works_for_a_name() {
    let config = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("why.toml");
    let text = "[encoder.old]\nlink = \"file:tests/recordings/faults.vcd\"\nframe = \"st26,nE,nW,crc6\"\n\
                [encoder.new]\nlink = \"sim:device=none,frame=st24,crc6\"\nclock = \"500kHz\"\n";
    std::fs::write(&config, text).unwrap();
    let config = config.display();
    let (_, stderr, code) = run(&format!("read old --config {config} -o csv"));
    assert_eq!(code, Some(1), "{stderr}");
    let command = next(
        stderr
            .lines()
            .find(|line| line.contains(": biss "))
            .unwrap(),
    );
    assert_eq!(command, format!("scope old --config {config} --fault"));
    let (drawn, stderr, code) = run(command);
    assert_eq!(code, Some(1), "a fault is drawn: {stderr}");
    assert!(drawn.contains("stalled"), "{drawn}");
    let (found, stderr, code) = run(&format!("detect new --config {config}"));
    assert_eq!(code, Some(0), "{stderr}");
    let command = found.lines().last().unwrap().strip_prefix("biss ").unwrap();
    let (_, stderr, code) = run(command);
    assert_eq!(code, Some(0), "{command}: {stderr}");
}

/// What was done already is not to be done again.
#[test]
fn nothing_is_to_be_typed_that_was_typed() {
    let (_, stderr, _) = run("read sim:absent=3600s --wait 30s -n 2");
    let why = whys(&stderr);
    assert!(!why.iter().any(|line| line.contains(": biss ")), "{stderr}");
}

#[test]
fn the_summary_says_the_same() {
    let args = "read sim:stuck=1 -f st26,nE,nW,crc6 -n 3 -o json";
    let (_, stderr, _) = run(args);
    let (why, summary) = stderr.split_once('\n').unwrap();
    let summary = &json(summary)[0];
    let [diagnosis] = summary["diagnosis"].as_array().unwrap().as_slice() else {
        panic!("{summary}")
    };
    assert_eq!(diagnosis["cause"], "no-encoder");
    assert_eq!(diagnosis["count"], 3);
    let command = diagnosis["try"].as_str().unwrap();
    assert_eq!(command, format!("biss {args} --wait 30s"));
    let text = diagnosis["text"].as_str().unwrap();
    assert_eq!(why, format!("biss: {text}; then: {command}"));
}

#[test]
fn nothing_is_said_where_nothing_is_wrong_or_known() {
    for args in [
        "read sim -n 50",
        "read sim:delay=3us,jitter=50ns,busy=0us..9us -n 50",
        "read sim:no-ack=30% -n 20",
        "read sim:crc-error=30% -n 40",
        "read sim:null=30%,error=30% -n 40",
        "stats sim -n 200",
    ] {
        let (_, stderr, _) = run(args);
        assert_eq!(whys(&stderr).len(), 0, "{args}: {stderr}");
    }
    let (_, stderr, _) = run("read sim -n 2 -o json");
    assert_eq!(json(&stderr)[0]["diagnosis"].as_array().unwrap().len(), 0);
}

#[test]
fn quiet_is_quiet() {
    let (stdout, stderr, code) = run("read sim:stuck=1 -q -n 20");
    assert_eq!((stderr.as_str(), code), ("", Some(1)));
    assert_eq!(stdout.lines().count(), 20);
}

/// Once when it is clear, and at the end with all of it.
#[test]
fn a_long_run_says_it_at_once() {
    let (stdout, stderr, _) = run("read sim:fast,stuck=1 -n 100 -i 1ms");
    let whys = whys(&stderr);
    assert_eq!(whys.len(), 2, "{stderr}");
    assert!(whys[0].contains("in 8 of 8 cycles"), "{stderr}");
    assert!(whys[1].contains("in 100 of 100 cycles"), "{stderr}");
    assert_eq!(stdout.lines().count(), 100);
}

#[test]
fn a_recording_says_what_it_shows() {
    let (_, stderr, _) = run("read file:tests/recordings/bench.vcd -f st24,nE,nW,crc6");
    assert!(
        stderr.contains("the frame is 2 bits longer than -f says"),
        "{stderr}"
    );
    let (_, stderr, _) = run("read file:tests/recordings/absent.vcd -f st26,nE,nW,crc6");
    let command = next(whys(&stderr)[0]);
    let (stdout, _, code) = run(command);
    assert!(
        stdout.contains("SLO") && code == Some(1),
        "{command}: {stdout}"
    );
}
