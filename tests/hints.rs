//! What a recording itself shows to be wrong with how it is read is said in one line, and nothing where all is well.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;

use common::run;
use std::path::Path;

const FRAME: &str = "st26,nE,nW,crc6";

fn said(link: &str, frame: &str) -> (String, Option<i32>) {
    let (_, stderr, status) = run(&format!("read {link} -f {frame}"));
    (stderr, status)
}

fn hints(stderr: &str) -> Vec<&str> {
    let is_one = |line: &&str| line.contains("swap ma= and slo=") || line.contains("right?");
    stderr.lines().filter(is_one).collect()
}

fn recordings(kind: &str) -> Vec<String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/recordings");
    let files = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = files
        .map(|file| file.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.ends_with(kind))
        .collect();
    names.sort();
    names
}

#[test]
fn swapped_wires_are_told_from_all_else() {
    let mut found = 0;
    for name in recordings(".vcd") {
        let (stderr, _) = said(&format!("file:tests/recordings/{name}"), FRAME);
        assert!(hints(&stderr).is_empty(), "{name}: {stderr}");
        let swapped = format!("file:tests/recordings/{name},ma=SLO,slo=MA");
        let (stderr, status) = said(&swapped, FRAME);
        // Nobody answers, so nothing tells one wire from the other.
        let wanted = usize::from(name != "absent.vcd");
        assert_eq!(hints(&stderr).len(), wanted, "{name}: {stderr}");
        assert_eq!(status, Some(1), "{name}");
        found += wanted;
    }
    assert!(found > 5);
    for link in ["bench.sr,ma=SLO,slo=MA", "far.bin,rate=20MHz,ma=1,slo=0"] {
        let (stderr, _) = said(&format!("file:tests/recordings/{link}"), FRAME);
        assert!(stderr.contains("MA like SLO: swap"), "{link}: {stderr}");
        let (stderr, _) = said(&format!("file:tests/recordings/{link} -q"), FRAME);
        assert_eq!(stderr, "");
    }
    // Another format spoils every frame as well.
    let (stderr, _) = said("file:tests/recordings/bench.vcd", "st25,nE,nW,crc6");
    assert!(
        stderr.contains("0 good") && hints(&stderr).is_empty(),
        "{stderr}"
    );
}

/// The recording has MA at 2 MHz, sampled at 20 MHz.
#[test]
fn a_wrong_rate_shows_in_the_clock() {
    for (rate, clock) in [
        ("20MHz", None),
        ("100MHz", None),
        ("1MHz", None),
        ("400MHz", Some("MA runs at 40.0 MHz")),
        ("2GHz", Some("MA runs at 200.0 MHz")),
        ("20kHz", Some("MA runs at 2.00 kHz")),
        ("1kHz", Some("MA runs at 0.10 kHz")),
    ] {
        let link = format!("file:tests/recordings/far.bin,rate={rate},ma=0,slo=1");
        let (stderr, _) = said(&link, FRAME);
        let found = hints(&stderr);
        assert_eq!(
            found.len(),
            usize::from(clock.is_some()),
            "{rate}: {stderr}"
        );
        if let Some(clock) = clock {
            let whole = found[0].contains(clock) && found[0].contains("is rate= right?");
            assert!(whole, "{rate}: {stderr}");
        }
    }
    let vcd = std::fs::read_to_string("tests/recordings/bench.vcd").unwrap();
    let wrong = vcd.replacen("1 ns", "1 us", 1).replacen("1ns", "1us", 1);
    assert_ne!(vcd, wrong);
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("scale.vcd");
    std::fs::write(&path, wrong).unwrap();
    let (stderr, _) = said(&format!("file:{}", path.display()), FRAME);
    assert!(stderr.contains("is its time scale right?"), "{stderr}");
}

#[test]
fn what_does_not_fit_is_said_as_it_is() {
    for (link, words, hint) in [
        (
            "tests/recordings",
            "it is a folder",
            "tests/recordings/NAME.sr",
        ),
        (
            "tests/recordings/bench.sr,unit=2",
            "a session of sigrok",
            "leave unit= out",
        ),
        (
            "tests/recordings/bench.sr,unit=2,rate=20MHz",
            "a session of sigrok",
            "leave unit= out",
        ),
        (
            "tests/recordings/bench.vcd,unit=1",
            "it is a VCD",
            "leave unit= out",
        ),
        (
            "tests/recordings/saleae-logic2.csv,unit=1",
            "it is CSV",
            "leave unit= out",
        ),
        (
            "tests/recordings/bench.vcd,rate=1MHz",
            "it is a VCD",
            "leave rate= out",
        ),
        (
            "tests/recordings/far.bin,unit=1",
            "need rate= too",
            "rate=100MHz",
        ),
    ] {
        let (stderr, status) = said(&format!("file:{link}"), FRAME);
        assert_eq!(status, Some(2), "{link}: {stderr}");
        let lines: Vec<&str> = stderr.lines().collect();
        let fits = lines.len() == 2 && lines[0].contains(words) && lines[1].contains(hint);
        assert!(fits, "{link}: {stderr}");
    }
}
