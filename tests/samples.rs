//! Recordings made of samples: sessions of sigrok and samples alone, and which of their channels are MA and SLO.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;

use common::sampled::{METADATA, csv, samples, session, zip};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use zip::CompressionMethod::{self, Deflated, Stored};

const FRAME: &str = "st26,nE,nW,crc6";

fn kept(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/recordings")
        .join(name)
}

fn text(name: &str) -> String {
    std::fs::read_to_string(kept(name)).unwrap()
}

fn write(name: &str, bytes: &[u8]) -> String {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::write(&path, bytes).unwrap();
    path.display().to_string()
}

/// Records, messages, exit status.
type Read = (String, String, Option<i32>);

fn read(link: &str, frame: &str, input: Option<&[u8]>) -> Read {
    let mut child = Command::new(env!("CARGO_BIN_EXE_biss"))
        .args(["read", link, "-f", frame, "-o", "json"])
        .env_remove("BISS_FRAME")
        .stdin(if input.is_some() {
            Stdio::piped()
        } else {
            Stdio::null()
        })
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    if let (Some(mut stdin), Some(input)) = (child.stdin.take(), input) {
        let input = input.to_vec();
        // It may have seen enough.
        std::thread::spawn(move || drop(stdin.write_all(&input)));
    }
    let output = child.wait_with_output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (
        text(output.stdout),
        text(output.stderr),
        output.status.code(),
    )
}

/// From a file, and from a pipe.
fn both(name: &str, options: &str, bytes: &[u8]) -> [Read; 2] {
    let path = write(name, bytes);
    [
        read(&format!("file:{path}{options}"), FRAME, None),
        read(&format!("file:-{options}"), FRAME, Some(bytes)),
    ]
}

#[test]
fn one_recording_reads_the_same_in_every_kind() {
    for name in [
        "bench", "cut", "flags", "far", "faults", "noise", "safety", "absent",
    ] {
        let pair = "mt12,st24,nE,nW,crc6+mt12,st24,nE,nW,lc6,crc16";
        let frame = if name == "safety" { pair } else { FRAME };
        // What begins later begins at 0 as samples.
        let vcd = text(&format!("{name}.vcd"));
        let begins = vcd.split_once("\n#").unwrap().1.lines().next().unwrap();
        let begins: u64 = begins.parse().unwrap();
        let samples = samples(&vcd, 1);
        let rate = "1 GHz";
        let vcd = format!(
            "$timescale 1ns $end $var wire 1 ! MA $end $var wire 1 \" SLO $end $enddefinitions $end\n{}",
            changes(&samples)
        );
        let sr = session(&samples, rate, samples.len());
        let chunks = session(&samples, rate, 99_991);
        let metadata = METADATA.replace("RATE", rate);
        let old = zip(
            &[
                ("version", b"1"),
                ("metadata", metadata.as_bytes()),
                ("logic-1", &samples),
            ],
            Stored,
        );
        let wide: Vec<u8> = samples.iter().flat_map(|s| [0xFF, 0, s << 6]).collect();
        // The next command names the recording.
        let told = |link: &str, input: Option<&[u8]>| {
            let (stdout, stderr, status) = read(link, frame, input);
            (stdout, stderr.replace(link, "file:same"), status)
        };
        let link = format!("file:{}", write("same.vcd", vcd.as_bytes()));
        let want = told(&link, None);
        assert!(!want.0.is_empty());
        if begins == 0 {
            assert_eq!(want.0, text(&format!("{name}.json")), "{name}");
        }
        for (kind, bytes, options) in [
            ("csv", csv(&samples, 1).into_bytes(), ""),
            ("sr", sr, ""),
            ("chunks.sr", chunks, ""),
            ("old.sr", old, ""),
            ("bin", samples.clone(), ",rate=1GHz,ma=0,slo=1"),
            ("wide.bin", wide, ",rate=1000MHz,ma=22,slo=23"),
        ] {
            let path = write(&format!("same.{kind}"), &bytes);
            let file = told(&format!("file:{path}{options}"), None);
            assert_eq!(file, want, "{name}.{kind}");
            let pipe = told(&format!("file:-{options}"), Some(&bytes));
            assert_eq!(pipe, want, "{name}.{kind} from a pipe");
        }
    }
}

fn changes(samples: &[u8]) -> String {
    let mut text = String::new();
    let mut last = None;
    for (at, levels) in samples.iter().enumerate() {
        if last != Some(levels) {
            text.push_str(&format!("#{at} {}! {}\"\n", levels & 1, levels >> 1));
        }
        last = Some(levels);
    }
    format!("{text}#{}\n", samples.len())
}

/// Files of the project's own, from the same frames as their VCD. BISS_BLESS=1 writes them.
#[test]
fn kept_recordings_are_what_their_vcd_is() {
    let bench = samples(&text("bench.vcd"), 2);
    let far = samples(&text("far.vcd"), 50);
    let unnamed: Vec<u8> = bench.iter().map(|levels| levels << 3).collect();
    let metadata = METADATA
        .replace("RATE", "500 MHz")
        .replace("probe1=MA", "probe4=D3")
        .replace("probe2=SLO", "probe5=D4\nprobe8=D7")
        .replace("probes=2", "probes=8");
    let entries: [(&str, &[u8]); 3] = [
        ("version", b"2"),
        ("metadata", metadata.as_bytes()),
        ("logic-1-1", &unnamed),
    ];
    for (name, bytes) in [
        ("bench.sr", session(&bench, "500 MHz", 1 << 18)),
        ("unnamed.sr", zip(&entries, Deflated)),
        ("far.bin", far),
    ] {
        if std::env::var_os("BISS_BLESS").is_some() {
            std::fs::write(kept(name), &bytes).unwrap();
        }
        let kept = std::fs::read(kept(name)).unwrap();
        assert!(kept.len() < 20_000, "{name}: {}", kept.len());
        // Another version of the library may pack otherwise.
        let same = if name.ends_with(".sr") {
            unpacked(&kept) == unpacked(&bytes)
        } else {
            kept == bytes
        };
        assert!(same, "{name} differs");
    }
    for (link, json) in [
        ("bench.sr", "bench"),
        ("unnamed.sr", "bench"),
        ("far.bin,rate=20MHz,ma=0,slo=1", "far"),
        ("far.bin,rate=20MHz", "far"),
    ] {
        let link = format!("file:{}", kept(link).display());
        let (records, said, status) = read(&link, FRAME, None);
        assert_eq!(records, text(&format!("{json}.json")), "{link}");
        assert_eq!(status, Some(0), "{link}: {said}");
    }
}

fn unpacked(bytes: &[u8]) -> Vec<(String, Vec<u8>)> {
    let mut archive = zip::ZipArchive::new(std::io::Cursor::new(bytes)).unwrap();
    let entry = |at| {
        let mut file = archive.by_index(at).unwrap();
        let mut bytes = Vec::new();
        std::io::copy(&mut file, &mut bytes).unwrap();
        (file.name().to_owned(), bytes)
    };
    (0..3).map(entry).collect()
}

/// What is printed is the beginning of what the whole recording says.
#[test]
fn a_session_cut_short_delivers_what_came_before() {
    let good = text("bench.json");
    let whole = std::fs::read(kept("bench.sr")).unwrap();
    let samples = samples(&text("bench.vcd"), 2);
    let stored: Vec<(String, &[u8])> = samples
        .chunks(200_000)
        .enumerate()
        .map(|(at, chunk)| (format!("logic-1-{}", at + 1), chunk))
        .collect();
    let metadata = METADATA.replace("RATE", "500 MHz");
    let mut entries: Vec<(&str, &[u8])> =
        vec![("version", b"2"), ("metadata", metadata.as_bytes())];
    entries.extend(stored.iter().map(|(name, chunk)| (name.as_str(), *chunk)));
    let stored = zip(&entries, Stored);
    let mut most = 0;
    for bytes in [&whole, &stored] {
        for part in 1..16 {
            let bytes = &bytes[..bytes.len() * part / 16];
            for (records, said, status) in both("short.sr", "", bytes) {
                if records == good && status == Some(0) {
                    // From a pipe nobody misses the directory at its end.
                    continue;
                }
                assert_eq!(status, Some(2), "{part}: {said}");
                // Where it is cut before SL = 1 nobody has seen how long the slave waits.
                let frames = |text: &str| text.replace(",\"timeout_ns\":20000", "");
                let begins = frames(&good).starts_with(&frames(&records));
                assert!(begins, "{part}: {records}");
                assert!(said.contains("cut short"), "{part}: {said}");
                most = most.max(records.lines().count());
            }
        }
    }
    assert!(most >= 3, "{most}");
}

#[test]
fn wrong_sessions_say_what_is_wrong() {
    let samples = samples(&text("bench.vcd"), 50);
    let m = METADATA.replace("RATE", "20 MHz");
    let m = m.as_bytes();
    let half = samples.len() / 2;
    let (one, two) = samples.split_at(half);
    let with = |from: &str, to: &str| METADATA.replace("RATE", "20 MHz").replace(from, to);
    let analog = with("capturefile=logic-1\ntotal probes=2\n", "").replace("analog=0", "analog=1");
    let no_rate = with("samplerate=20 MHz\n", "");
    let wide = with("unitsize=1", "unitsize=12");
    let v: (&str, &[u8]) = ("version", b"2");
    type Entries<'a> = &'a [(&'a str, &'a [u8])];
    let cases: [(Entries<'_>, &str, CompressionMethod); 10] = [
        (&[v, ("logic-1-1", &samples)], "metadata", Deflated),
        (&[v, ("readme", b"?")], "no session of sigrok", Stored),
        (&[("version", b"3"), ("metadata", m)], "version 3", Stored),
        (
            &[v, ("metadata", analog.as_bytes())],
            "analog channels only",
            Stored,
        ),
        (&[v, ("metadata", no_rate.as_bytes())], "rate=24MHz", Stored),
        (&[v, ("metadata", wide.as_bytes())], "12 bytes", Stored),
        (
            &[v, ("metadata", m), ("logic-1-2", &samples)],
            "`logic-1-1`: it is missing, `logic-1-2`",
            Stored,
        ),
        (
            &[v, ("metadata", m), ("logic-1-1", one), ("logic-1-3", two)],
            "`logic-1-2`: it is missing",
            Deflated,
        ),
        (
            &[("header", b"[version]"), ("L-0/0", one)],
            "DSView",
            Stored,
        ),
        (&[v, ("metadata", m), ("logic-1-1", &[])], "", Stored),
    ];
    for (entries, words, method) in cases {
        let bytes = zip(entries, method);
        let [file, pipe] = both("wrong.sr", "", &bytes);
        assert!(file.1.contains(words), "{words}: {}", file.1);
        assert_eq!(
            file.2,
            Some(if words.is_empty() { 1 } else { 2 }),
            "{words}"
        );
        assert_eq!(pipe.2, file.2, "{words}: {}", pipe.1);
    }
    // In any order from a file; a pipe does not come back.
    let entries = [("logic-1-1", samples.as_slice()), ("metadata", m), v];
    let [file, pipe] = both("late.sr", "", &zip(&entries, Deflated));
    assert_eq!((file.0.lines().count(), file.2), (5, Some(0)), "{}", file.1);
    assert!(
        pipe.1.contains("save it to a file") && pipe.2 == Some(2),
        "{}",
        pipe.1
    );
    let entries = [v, ("metadata", no_rate.as_bytes()), ("logic-1", &samples)];
    let [file, pipe] = both("rate.sr", ",rate=20MHz", &zip(&entries, Deflated));
    assert_eq!((file.0.lines().count(), file.2), (5, Some(0)), "{}", file.1);
    assert_eq!(file, pipe);
    let bytes = session(&samples, "20 MHz", 1 << 20);
    let [file, pipe] = both("rate.sr", ",rate=24MHz", &bytes);
    assert!(
        file.1.contains("leave rate= out") && file.2 == Some(2),
        "{}",
        file.1
    );
    assert_eq!(file.2, pipe.2);
}

/// `logic-1-10` comes after `logic-1-9`.
#[test]
fn chunks_are_read_in_the_order_of_their_numbers() {
    let samples = samples(&text("bench.vcd"), 50);
    let metadata = METADATA.replace("RATE", "20 MHz");
    let chunks = samples.chunks(samples.len() / 12).enumerate();
    let mut chunks: Vec<(String, &[u8])> = chunks
        .map(|(at, chunk)| (format!("logic-1-{}", at + 1), chunk))
        .collect();
    chunks.sort();
    assert_eq!(chunks[1].0, "logic-1-10");
    let mut entries: Vec<(&str, &[u8])> = vec![("metadata", metadata.as_bytes())];
    entries.extend(chunks.iter().map(|(name, chunk)| (name.as_str(), *chunk)));
    let [file, pipe] = both("order.sr", "", &zip(&entries, Deflated));
    assert_eq!((file.0.lines().count(), file.2), (5, Some(0)), "{}", file.1);
    assert!(
        pipe.1.contains("`logic-1-2`: it is missing, `logic-1-10`"),
        "{}",
        pipe.1
    );
}

#[test]
fn a_wrong_checksum_delivers_no_doubtful_position() {
    let samples = samples(&text("bench.vcd"), 50);
    let chunk = samples.len() / 2;
    let metadata = METADATA.replace("RATE", "20 MHz");
    let entries = [
        ("metadata", metadata.as_bytes()),
        ("logic-1-1", &samples[..chunk]),
        ("logic-1-2", &samples[chunk..]),
    ];
    let mut bytes = zip(&entries, Stored);
    let second = bytes.len() - 1000;
    bytes[second] ^= 2;
    for (records, said, status) in both("sum.sr", "", &bytes) {
        assert_eq!(status, Some(2));
        assert!(
            said.contains("of `logic-1-2`: its checksum is wrong"),
            "{said}"
        );
        assert_eq!(records.lines().count(), 3, "{records}");
        assert!(text("bench.json").lines().next().unwrap()[..40] == records[..40]);
    }
}

/// A part of more than 4 MiB is looked through first where there is a way back. Through a pipe it is not: then the error says
/// what is in doubt.
#[test]
fn a_wrong_checksum_behind_what_was_delivered_says_what_is_in_doubt() {
    let samples = samples(&text("bench.vcd"), 50);
    let chunk = samples.len() / 2;
    let metadata = METADATA.replace("RATE", "20 MHz");
    let long = [&samples[chunk..], &[3; 5 << 20]].concat();
    let entries = [
        ("metadata", metadata.as_bytes()),
        ("logic-1-1", &samples[..chunk]),
        ("logic-1-2", &long),
    ];
    let good = zip(&entries, Stored);
    for (records, said, status) in both("long.sr", "", &good) {
        assert_eq!((records.lines().count(), status), (5, Some(0)), "{said}");
    }
    let mut bytes = good;
    // Of another channel, behind all frames.
    let late = bytes.len() - 1000;
    bytes[late] ^= 0x80;
    let [file, pipe] = both("long.sr", "", &bytes);
    for ((records, said, status), count) in [(&file, 3), (&pipe, 5)] {
        assert_eq!(*status, Some(2), "{said}");
        assert!(
            said.contains("of `logic-1-2`: its checksum is wrong"),
            "{said}"
        );
        assert_eq!(records.lines().count(), count, "{said}");
    }
    let since = format!(
        "after {:.6} s of the recording are in doubt",
        chunk as f64 / 20e6
    );
    assert!(pipe.1.contains(&since), "{}", pipe.1);
    assert!(!file.1.contains("in doubt"), "{}", file.1);
}

#[test]
fn samples_alone_need_a_rate_and_whole_samples() {
    let samples = samples(&text("bench.vcd"), 50);
    for (options, words) in [
        (
            "",
            "it is no recording of a kind that biss knows: it begins with 03 03 03",
        ),
        (",unit=1", "need rate="),
        (
            ",rate=20MHz,unit=3,ma=0,slo=1",
            "2 bytes are left, and a sample has 3",
        ),
        (",rate=20MHz,ma=64,slo=1", "no channel 64"),
        (",rate=20MHz,ma=9,slo=1,unit=1", "no signal `9`"),
        (",rate=20MHz,ma=A,slo=1", "no signal `A`"),
    ] {
        let cut = &samples[..samples.len() / 3 * 3 - 1];
        for (_, said, status) in both("alone.bin", options, cut) {
            assert!(said.contains(words), "{options}: {said}");
            assert_eq!(status, Some(2), "{options}: {said}");
        }
    }
    let [empty, _] = both("empty.bin", ",rate=20MHz", b"");
    assert!(
        empty.1.contains("it is empty") && empty.2 == Some(2),
        "{}",
        empty.1
    );
    // Bits 2, 3 and 5 while nothing happens: a comma. Bits 0 and 3: a tab.
    for (rest, ma, slo) in [(0x2Cu8, 2, 3), (0x09, 0, 3), (0x24, 5, 2)] {
        let like_text: Vec<u8> = samples
            .iter()
            .map(|levels| rest & !(1 << ma | 1 << slo) | (levels & 1) << ma | (levels >> 1) << slo)
            .collect();
        let long: Vec<u8> = [vec![rest; 10_000], like_text].concat();
        for (records, said, _) in both("text.bin", &format!(",rate=20MHz,ma={ma},slo={slo}"), &long)
        {
            assert_eq!(records.lines().count(), 5, "{rest:02x}: {said}");
        }
    }
    let vcd = text("bench.vcd");
    let [file, _] = both("rate.vcd", ",rate=1MHz", vcd.as_bytes());
    assert!(
        file.1.contains("leave rate= out") && file.2 == Some(2),
        "{}",
        file.1
    );
}

/// A wire, sample by sample.
type Wire = Vec<bool>;

/// MA and SLO of an encoder that is read now and then, so many samples, from anywhere in a frame on.
fn encoder(rng: &mut fastrand::Rng, step_ns: u64, count: usize) -> [Wire; 2] {
    let half_ns = step_ns * rng.u64(4..=25);
    let timeout_ns = 20_000.max(5 * half_ns);
    let delay_ns = if rng.bool() { 0 } else { rng.u64(..3_000) };
    let (pos, timeout_us) = (rng.u32(..1 << 26), timeout_ns.div_ceil(1000));
    let config = format!(
        "motion=speed,rpm={},pos={pos},timeout={timeout_us}us,delay={delay_ns}ns,frame={FRAME}",
        rng.u32(1..20_000)
    );
    let config: biss::slave::Config = config.parse().unwrap_or_else(|e| panic!("{e}"));
    let mut slave = biss::slave::Slave::new(config);
    // LAT, Ack, start, CDS, data, CRC, stop, and what is under way.
    let clocks = 39 + delay_ns / (2 * half_ns) + rng.u64(1..4);
    let least_ns = 2 * timeout_ns + delay_ns;
    let mut next_ns = rng.u64(least_ns..2 * least_ns);
    let (mut level, mut left) = (true, 2 * clocks);
    let skipped = rng.usize(..count / 2);
    let (mut ma, mut slo) = (Wire::new(), Wire::new());
    for at in 0..skipped + count {
        let t_ns = at as u64 * step_ns;
        if t_ns >= next_ns {
            level = !level;
            slave.ma(t_ns, level);
            left -= 1;
            next_ns = t_ns + half_ns;
            if left == 0 {
                left = 2 * clocks;
                next_ns = t_ns + rng.u64(least_ns..2 * least_ns);
            }
        }
        ma.push(level);
        slo.push(slave.slo(t_ns));
    }
    [ma, slo].map(|wire| wire[skipped..].to_vec())
}

/// Something else, on one wire or two.
fn other(rng: &mut fastrand::Rng, count: usize, ma: &Wire) -> Vec<Wire> {
    let wire = |level: &mut dyn FnMut(usize) -> bool| (0..count).map(level).collect::<Wire>();
    match rng.u8(..6) {
        0 => {
            let level = rng.bool();
            vec![wire(&mut |_| level)]
        }
        1 => {
            let (half, from) = (rng.usize(2..60), rng.usize(..60));
            vec![
                wire(&mut |at| (at + from) / half % 2 == 1),
                wire(&mut |at| (at + from) / half % 4 > 1),
            ]
        }
        2 => {
            let mut level = rng.bool();
            let rare = rng.usize(2..400);
            vec![wire(&mut |_| {
                level ^= rng.usize(..rare) == 0;
                level
            })]
        }
        // The other wire of its pair.
        3 => vec![ma.iter().map(|level| !level).collect()],
        4 => {
            // An I²C or SPI bus: a clock that rests high, data with its falling edges.
            let half = rng.usize(4..20);
            let (mut clock, mut data) = (Wire::new(), Wire::new());
            while clock.len() < count {
                let rest = rng.usize(40 * half..200 * half);
                clock.extend(std::iter::repeat_n(true, rest));
                data.extend(std::iter::repeat_n(true, rest));
                for _ in 0..8 * rng.usize(1..6) {
                    let bit = rng.bool();
                    for level in [false, true] {
                        clock.extend(std::iter::repeat_n(level, half));
                        data.extend(std::iter::repeat_n(bit, half));
                    }
                }
            }
            clock.truncate(count);
            data.truncate(count);
            vec![clock, data]
        }
        // A trigger with each frame.
        _ => {
            let mut until = 0;
            vec![wire(&mut |at| {
                if !ma[at] && at >= until {
                    until = at + 2000;
                }
                at + 1950 < until
            })]
        }
    }
}

#[test]
fn ma_and_slo_are_found_among_others() {
    use biss::link::{Link, file};
    let mut rng = common::rng();
    let (mut alone, mut twice, mut doubtful) = (0, 0, 0);
    for round in 0..common::size(60) {
        let step_ns = rng.u64(10..50);
        let count = 1_200_000 / step_ns as usize;
        let [ma, slo] = encoder(&mut rng, step_ns, count);
        let second = rng.u8(..5) == 0;
        let mut wires = vec![ma.clone(), slo];
        if second {
            wires.extend(encoder(&mut rng, step_ns, count));
        }
        while wires.len() < 8 {
            wires.extend(other(&mut rng, count, &ma));
        }
        wires.truncate(8);
        let mut places: Vec<usize> = (0..8).collect();
        rng.shuffle(&mut places);
        let sample = |at: usize| {
            let bit = |(wire, place): (&Wire, &usize)| u8::from(wire[at]) << place;
            wires
                .iter()
                .zip(&places)
                .map(bit)
                .fold(0, |all, bit| all | bit)
        };
        let samples: Vec<u8> = (0..count).map(sample).collect();
        let asked = file::Asked {
            rate: Some(biss::unit::Hertz((1_000_000_000 / step_ns) as u32)),
            unit: Some(1),
            ..file::Asked::new(40_000.max(step_ns * 25 * 8))
        };
        let input = file::Input::pipe(std::io::Cursor::new(samples));
        let found = file::open(input, "it", &asked);
        let pair = |ma: usize, slo: usize| (places[ma], places[slo]);
        let first = pair(0, 1);
        match found {
            Ok(link) if !second => {
                let want = format!("MA is `{}`, SLO is `{}`, by behaviour", first.0, first.1);
                assert_eq!(link.notes(), [want], "{round}");
                alone += 1;
            }
            Err(error) if second => {
                for (ma, slo) in [first, pair(2, 3)] {
                    let words = format!("{ma} and {slo}");
                    assert!(error.said().contains(&words), "{round}: {words}: {error}");
                }
                assert!(
                    error.said().starts_with("several pairs"),
                    "{round}: {error}"
                );
                twice += 1;
            }
            // By chance another pair may look like one: then both are named, and none is guessed.
            Err(error) if error.said().starts_with("several pairs") => {
                let words = format!("{} and {}", first.0, first.1);
                assert!(error.said().contains(&words), "{round}: {words}: {error}");
                doubtful += 1;
            }
            Ok(link) => panic!("{round}: {first:?} of two: {:?}", link.notes()),
            Err(error) => panic!("{round}: {first:?}: {error}"),
        }
    }
    println!("{alone} found, {twice} left open, {doubtful} by chance");
    assert!(doubtful <= 2 + alone / 20, "{doubtful} of {alone}");
}
