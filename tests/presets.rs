//! Presets as typed, and as documented.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;

use biss::Format;
use biss::preset::{self, Preset};
use common::{biss, json, run, texts};

/// The page and the code say the same, number by number.
#[test]
fn the_page_lists_what_the_code_has() {
    let page = std::fs::read_to_string("docs/presets.md").unwrap();
    let or = |text: Option<String>| text.unwrap_or_else(|| "-".into());
    let clock = |preset: &Preset| match (preset.clock_min, preset.clock_max) {
        (Some(min), Some(max)) => format!("{min}..{max}"),
        (None, Some(max)) => format!("up to {max}"),
        (Some(min), None) => format!("from {min}"),
        (None, None) => "-".into(),
    };
    let mut rows = 0;
    for preset in preset::all() {
        let row = format!(
            "| `{}` | {} | `{}` | {} | {} | {} | {} | {} |",
            preset.name,
            preset.about,
            preset.format,
            clock(preset),
            or(preset.timeout.map(|timeout| timeout.to_string())),
            or(preset.interval.map(|time| time.to_string())),
            or(preset.power_on.map(|time| time.to_string())),
            preset.source,
        );
        assert!(page.contains(&row), "docs/presets.md has no row\n{row}");
        assert!(
            preset.note.is_empty() || page.contains(preset.note),
            "docs/presets.md does not say: {}",
            preset.note
        );
        rows += 1;
    }
    let shown = page.lines().filter(|line| line.starts_with("| `")).count();
    assert_eq!(shown, rows, "docs/presets.md has rows of its own");
}

#[test]
fn every_preset_is_read_by_name_and_plays_itself() {
    for preset in preset::all() {
        let name = preset.name;
        let by_name = run(&format!("read sim -f {name} -n 20 -o json"));
        assert_eq!(by_name.2, Some(0), "{name}: {}{}", by_name.0, by_name.1);
        assert_eq!(json(&by_name.0).len(), 20);
        let in_link = run(&format!("read sim:frame={name} -n 20 -o json"));
        assert_eq!(by_name, in_link, "{name}");
        let environment = biss(&["read", "sim", "-n", "20", "-o", "json"])
            .env("BISS_FRAME", name)
            .output()
            .unwrap();
        assert_eq!(by_name, texts(environment), "{name}");
        // The encoder's own format, said in full, is the same frame.
        let format: Format = preset.format.parse().unwrap();
        let in_full = run(&format!("read sim:frame={name} -f {format} -n 3 -q"));
        assert_eq!(in_full.2, Some(0), "{name}");
    }
}

#[test]
fn frames_keep_their_distance_and_no_slots() {
    let times = |args: &str| -> Vec<(u64, u64)> {
        let records = json(&run(args).0);
        let pair = |r: &serde_json::Value| {
            let number = |key: &str| r[key].as_u64().unwrap();
            (number("t_ns"), number("seq"))
        };
        records.iter().map(pair).collect()
    };
    // A frame of 31 clocks takes 3 us; the timeout is played by the slave of a plain format, and is short.
    let link = "sim:timeout=13us,frame=st18,nE,nW,crc6";
    let near = times(&format!("read {link} -f resolute-18 -c 10MHz -n 5 -o json"));
    let want = [(0, 0), (40_000, 1), (80_000, 2), (120_000, 3), (160_000, 4)];
    assert_eq!(near, want);
    let without = times(&format!(
        "read {link} -f st18,nE,nW,crc6 -c 10MHz -n 5 -o json"
    ));
    assert!(without[4].0 < 160_000, "{without:?}");
    // Repetitions keep it too.
    let bad = "sim:timeout=13us,crc-error=50%,seed=3,frame=pos25,nE,nW,crc6";
    let tried = format!(
        "read {bad} -f siko-msa213c -c 10MHz --timeout 12us..13us -n 20 -q -o json --retries 99"
    );
    let records = json(&run(&tried).0);
    assert!(records.iter().all(|r| r["ok"] == true));
    for pair in records.windows(2) {
        let t = |r: &serde_json::Value| r["t_ns"].as_u64().unwrap();
        let tries = pair[1]["tries"].as_u64().unwrap();
        assert!(t(&pair[1]) - t(&pair[0]) >= tries * 50_000, "{pair:?}");
    }
    // An interval of the user's own is his to choose.
    let asked = times(&format!(
        "read {link} -f resolute-18 -c 10MHz -n 3 -i 20us -o json"
    ));
    assert_eq!(asked, [(0, 0), (20_000, 1), (40_000, 2)]);
}

#[test]
fn what_is_outside_the_published_limits_is_said_once() {
    for (args, words) in [
        (
            "-f resolute-26 -c 100kHz",
            "MA at 100kHz is below the least that resolute-26 is made for, 250kHz (Renishaw",
        ),
        (
            "-f faulhaber-aemt -c 3MHz",
            "MA at 3MHz is above the most that faulhaber-aemt is made for, 2MHz (Faulhaber",
        ),
        (
            "-f resolute-26 -i 30us",
            "frames every 30us are closer than resolute-26 is made for, 40us (Renishaw",
        ),
        (
            "-f lenz-irs --timeout 20us",
            "--timeout does not fit lenz-irs, whose timeout is 12.6us..13.2us (Lenz",
        ),
        (
            "-f siko-msa213c --timeout 20us",
            "whose timeout is adaptive (Siko",
        ),
        (
            "-f resolute-26 --timeout adaptive",
            "whose timeout is 40us from the start of the frame (Ren",
        ),
        (
            "-f faulhaber-aemt --timeout 30us",
            "whose timeout is about 20us (Faulhaber",
        ),
    ] {
        let (_, stderr, status) = run(&format!("read sim:fast {args} -n 3"));
        assert_eq!(stderr.matches(words).count(), 1, "{args}: {stderr}");
        assert_eq!(stderr.lines().count(), 2, "{args}: {stderr}");
        assert!(status != Some(2), "{args}: {stderr}");
        let (_, stderr, _) = run(&format!("read sim:fast {args} -n 3 -q"));
        assert_eq!(stderr, "", "{args}");
    }
    for inside in [
        "-f resolute-26 -c 250kHz -i 1ms",
        "-f lenz-irs -c 5MHz -i 1ms --timeout 12us..20us",
        "-f siko-msa213c --timeout adaptive",
        "-f lika-sma1 -c 10MHz --timeout 1us",
    ] {
        let (_, stderr, _) = run(&format!("read sim:fast {inside} -n 3"));
        assert_eq!(stderr.lines().count(), 1, "{inside}: {stderr}");
    }
    let bench = "read file:tests/recordings/bench.vcd -f resolute-26";
    let (stdout, stderr, status) = run(bench);
    assert_eq!((stdout.lines().count(), stderr.lines().count()), (5, 1));
    assert_eq!(status, Some(0));
}

#[test]
fn a_name_nobody_has_published_lists_those_that_are() {
    for args in [
        "read sim -f aksim-2",
        "read sim:frame=aksim-2",
        "read spi:0.0 -f aksim-2",
    ] {
        let (stdout, stderr, status) = run(args);
        assert_eq!((stdout.as_str(), status), ("", Some(2)));
        for word in ["`aksim-2` is neither", "^^^^^^^", "mtN stN", "lenz-irs"] {
            assert!(stderr.contains(word), "{args}: no {word} in {stderr}");
        }
    }
    let (_, stderr, _) = run("read spi:0.0");
    assert!(stderr.contains("or another preset"), "{stderr}");
}

/// An encoder that needs time after power-on gets it, unless the user says how long to wait.
#[test]
fn power_on_takes_its_time() {
    let status = |args: &str| run(&format!("read sim:absent=200ms{args} -q")).2;
    assert_eq!(status(" -f siko-msa213c"), Some(0));
    assert_eq!(status(" -f siko-msa213c --wait 100ms"), Some(1));
    assert_eq!(status(" -f resolute-26"), Some(1));
}
