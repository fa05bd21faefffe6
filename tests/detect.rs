//! `biss detect`, and what is under it.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;

use biss::crc::Crc;
use biss::cycle::Head;
use biss::detect::{Answer, Detector, Findings, Line, Listen, same_cut};
use biss::format::{Channel, Format};
use biss::frame::{BissC, emit};
use biss::link::Link;
use biss::link::sim::{self, Controller, SimBus};
use biss::link::wave::{Options, Wave};
use biss::master::Master;
use biss::trace::Trace;
use biss::unit::Hertz;
use common::{biss, json, run, texts};
use fastrand::Rng;
use serde_json::Value;
use std::time::Instant;

fn format(text: &str) -> Format {
    text.parse().unwrap_or_else(|e| panic!("{e}"))
}

/// Frames of a link a millisecond apart, until one format is left or there are `most` of them.
fn detect(link: &mut dyn Link, most: u64) -> Findings {
    let mut limits = BissC::new(Format::default());
    limits.busy_limit_ns = 80_000;
    let listen = Listen::new(limits.clone());
    let mut detector = Detector::new(limits);
    let mut master = Master::new(link, &listen, Some(0));
    master.open().unwrap();
    let mut next = 16;
    loop {
        let at_ns = master.trace().t_ns + 1_000_000;
        master.slot(at_ns, None).unwrap();
        detector.add(master.trace());
        listen.expect(detector.longest());
        if detector.frames() == next || detector.frames() == most {
            next *= 2;
            let findings = detector.find();
            if findings.only().is_some() || detector.frames() == most {
                return findings;
            }
        }
    }
}

fn detect_sim(config: &str, most: u64) -> Findings {
    let mut link = sim::open(config.parse().unwrap_or_else(|e| panic!("{e}")));
    link.set_clock(Hertz(1_000_000)).unwrap();
    detect(&mut link, most)
}

/// What frames say that were put together one by one.
fn detect_traces(traces: impl IntoIterator<Item = Trace>) -> Findings {
    let mut detector = Detector::new(BissC::new(Format::default()));
    traces.into_iter().for_each(|trace| detector.add(&trace));
    detector.find()
}

fn trace(bits: &str) -> Trace {
    let mut trace = Trace {
        idle: Some(true),
        ..Trace::default()
    };
    trace.bits.extend(bits.bytes().map(|bit| bit == b'1'));
    trace
}

/// A frame, and zeros behind it.
fn frame(format: &Format, data: &[u64]) -> Trace {
    let head = Head {
        delay_clk: 0,
        ack: 1,
        cds: false,
    };
    let mut trace = trace("");
    emit(format, head, data, &mut trace.bits);
    trace.bits.extend([false; 40]);
    trace
}

fn place_of(findings: &Findings, right: &Format) -> Option<usize> {
    let fits = |answer: &Answer| same_cut(&answer.format, right);
    findings.answers.iter().position(fits)
}

const TABLE: [&str; 8] = [
    "crc3:0xB",
    "crc4:0x13",
    "crc5:0x25",
    "crc6:0x43",
    "crc7:0x89",
    "crc8:0x12F",
    "crc8:0x197",
    "crc16:0x190D9",
];

/// 50 polynomials of 3 to 16 bits. Not xⁿ+1: that repeats data bits instead of checking them, and where they stand still
/// the frame seems to end earlier.
fn polynomials(rng: &mut Rng) -> Vec<String> {
    let mut all: Vec<String> = TABLE.iter().map(ToString::to_string).collect();
    while all.len() < TABLE.len() + 50 {
        let bits = rng.u32(3..=16);
        let poly = 1 << bits | rng.u32(..1 << bits) | 1;
        if poly != 1 << bits | 1 {
            all.push(format!("crc{bits}:{poly:#x}"));
        }
    }
    all
}

/// 8 to 48 data bits, nE and nW among them.
fn channel(rng: &mut Rng, polys: &[String]) -> String {
    let flags = if rng.bool() { ",nE,nW" } else { "" };
    let bits = rng.u8(8..=48).max(8 + flags.len() as u8 / 3) - flags.len() as u8 / 3;
    let turn = if bits > 16 && rng.bool() {
        rng.u8(1..=bits - 12)
    } else {
        0
    };
    let place = match turn {
        0 => format!("st{bits}"),
        _ => format!("mt{turn},st{}", bits - turn),
    };
    let crc = rng.choice(polys).unwrap();
    let init = match rng.u8(..8) {
        0 => format!(":init={:#x}", rng.u32(1..8)),
        _ => String::new(),
    };
    let plain = if rng.bool() { ":plain" } else { "" };
    format!("{place}{flags},{crc}{init}{plain}")
}

/// Whether frames can have told an encoder from others: by chance each of its CRCs fits once in 2^20 at most, and no other
/// format is exactly as likely.
fn tellable(answer: &Answer, all: &[Answer]) -> bool {
    let bits = |crc: &Crc, rank: u32| u32::from(crc.bits()) * rank;
    let as_likely = |other: &&Answer| (other.probability / answer.probability - 1.0).abs() < 1e-3;
    if all
        .iter()
        .filter(as_likely)
        .any(|other| !same_cut(&other.format, &answer.format))
    {
        return false;
    }
    answer
        .channels
        .iter()
        .all(|seen| bits(&seen.crc, seen.rank) >= 20)
}

/// nE and nW, where the lowest bits of the position move: where they stand still nobody can tell.
fn flags_told(right: &Channel, answer: &Channel) -> bool {
    right.has_null() == answer.has_null()
}

/// The campaign: `BISS_TEST_SIZE=4200 cargo test --test detect random -- --nocapture` tries 500.
#[test]
fn random_encoders_are_found() {
    let mut rng = common::rng();
    let polys = polynomials(&mut rng);
    let rounds = common::size(12);
    let began = Instant::now();
    let (mut among, mut told, mut first, mut certain, mut alone) = (0, 0, 0, 0, 0);
    let (mut flags, mut flags_right, mut looked) = (0, 0, Vec::new());
    for _ in 0..rounds {
        let channels: Vec<String> = (0..rng.usize(1..=3))
            .map(|_| channel(&mut rng, &polys))
            .collect();
        let frame = channels.join("+");
        let flip = *rng.choice(&["0", "0.0001", "0.001"]).unwrap();
        let motion = *rng
            .choice(&["speed,rpm=60", "speed,rpm=-7", "sine"])
            .unwrap();
        let config = format!(
            "device=none,seed={},motion={motion},pos={},turn={},ack={},flip={flip},frame={frame}",
            rng.u16(..),
            rng.u8(..),
            rng.u8(..),
            rng.u8(1..=40)
        );
        let findings = detect_sim(&config, 1_024);
        let right = format(&frame);
        let place = place_of(&findings, &right);
        let found = place.map(|place| &findings.answers[place]);
        looked.push(findings.frames);
        among += usize::from(place.is_some());
        let tellable = found.is_none_or(|found| tellable(found, &findings.answers));
        told += usize::from(tellable);
        first += usize::from(tellable && place == Some(0));
        alone += usize::from(findings.only().is_some());
        certain += usize::from(findings.only().is_some() && place == Some(0));
        if place != Some(0) {
            println!(
                "sim:{config}\n  {place:?} of {}, tellable: {tellable}",
                findings.answers.len()
            );
            for answer in findings.answers.iter().take(4) {
                println!(
                    "  {:.5} {} of {}: {}",
                    answer.probability, answer.good, answer.frames, answer.format
                );
            }
        }
        // Channels with more bits than the first one end in zeros.
        if let (Some(0), Some(answer), 1) =
            (place, findings.answers.first(), right.channels().len())
        {
            flags += 1;
            flags_right += usize::from(flags_told(
                &right.channels()[0],
                &answer.format.channels()[0],
            ));
        }
    }
    looked.sort_unstable();
    println!(
        "{rounds} encoders in {:.1?}: {among} among those reported; of {told} that frames can tell apart {first} named first; \
         {alone} left alone, {certain} of them rightly; nE and nW right in {flags_right} of {flags} with one channel",
        began.elapsed()
    );
    println!(
        "frames used: median {}, nine of ten at most {}",
        looked[looked.len() / 2],
        looked[looked.len() * 9 / 10]
    );
    assert_eq!(
        among, rounds,
        "the right format is always among those reported"
    );
    assert!(
        100 * first >= 99 * told || first + 1 == told && rounds < 100,
        "{first} of {told}"
    );
    assert!(
        100 * certain >= 99 * alone || certain + 1 == alone && rounds < 100,
        "{certain} of {alone}"
    );
    assert!(
        100 * flags_right >= 97 * flags || flags_right + 1 == flags,
        "{flags_right} of {flags}"
    );
}

/// MT 0xA5A, ST 0xFB0, nE = nW = 1 from the log of hpm_sdk's `bissc` sample (samples/drivers/sei/master/bissc): CRC-6 0x20
/// fits 32 bits. So do other CRCs at other lengths, as the frame ends in zeros.
#[test]
fn a_published_word_fits_at_several_lengths() {
    let word = frame(&format("mt12,st12,nE,nW,crc6"), &[0xA5A_FB0 << 2 | 3]);
    let findings = detect_traces([word]);
    assert_eq!(findings.line, Line::Biss);
    assert!(findings.only().is_none(), "{:?}", findings.answers);
    let lengths: Vec<u16> = findings
        .answers
        .iter()
        .map(|answer| answer.format.bits())
        .collect();
    assert!(
        lengths.contains(&32) && lengths.iter().any(|bits| *bits != 32),
        "{lengths:?}"
    );
    let right = format("st24,nE,nW,crc6");
    assert_eq!(
        findings.answers[0].format, right,
        "the usual one is likeliest"
    );
    let sum: f64 = findings
        .answers
        .iter()
        .map(|answer| answer.probability)
        .sum();
    let whole = sum + findings.unlikely_probability + findings.none_probability;
    assert!((whole - 1.0).abs() < 1e-9, "{whole}");
    // Three more published words of the same encoder leave one.
    let more = [
        0xA5A_FB0u64,
        0xA5A_FA5,
        0xA5A_FBF,
        0xA5A_FC7,
        0xA5A_FA8,
        0xA5A_FB1,
        0xA5A_FAC,
        0xA5A_FB4,
    ];
    let traces = more.map(|word| frame(&format("mt12,st12,nE,nW,crc6"), &[word << 2 | 3]));
    let findings = detect_traces(traces);
    assert_eq!(findings.only().map(|answer| &answer.format), Some(&right));
}

/// At one length start value and inversion make one constant.
#[test]
fn start_value_and_inversion_are_one_constant() {
    let findings = detect_sim(
        "device=none,frame=st26,nE,nW,crc6:0x43:init=0x33:plain",
        256,
    );
    // protocol: 28 bits with start value 0 and inverted equal start value 0x33 and plain.
    assert_eq!(findings.answers[0].format.to_string(), "st26,nE,nW,crc6");
    assert!(same_cut(
        &format("st28,crc6"),
        &format("st26,nE,nW,crc6:0x43:init=0x33:plain")
    ));
    assert!(!same_cut(
        &format("st28,crc6"),
        &format("st28,crc6:0x43:plain")
    ));
    let odd = "st20,nE,nW,crc8:0x12F:init=0x5A";
    let findings = detect_sim(&format!("device=none,frame={odd}"), 256);
    assert_eq!(findings.answers[0].format.to_string(), odd);
}

#[test]
fn links_that_plan_their_clocks_find_the_same() {
    let config = "device=none,busy=1us..6us,delay=700ns,frame=mt5,st16,nE,nW,crc6+st12,nE,nW,crc5";
    let bus = SimBus::new(config.parse().unwrap(), Controller::default());
    let mut link = Wave::new(bus, Options::default(), Some(Hertz(1_000_000))).unwrap();
    let findings = detect(&mut link, 256);
    let only = findings.only().map(|answer| answer.format.to_string());
    assert_eq!(
        only.as_deref(),
        Some("st21,nE,nW,crc6+st12,nE,nW,crc5"),
        "{:?}",
        findings.answers
    );
    let delay = findings.heads.delay_ns.unwrap();
    assert!(delay.min >= 600 && delay.max <= 800, "{delay:?}");
    let ack = findings.heads.ack.unwrap();
    assert!(ack.max > ack.min, "{ack:?}");
}

/// Flags that change are flags all the same, and a position's lowest bits are none.
#[test]
fn error_and_warning_bits() {
    for (rates, frame, want) in [
        (
            "error=20%,warning=20%",
            "st18,nE,nW,crc6",
            "st18,nE,nW,crc6",
        ),
        ("error=0%", "st18,E,W,crc6", "st18,E,W,crc6"),
        ("warning=10%", "st18,E,W,crc6", "st18,E,W,crc6"),
        ("error=0%", "st18,crc6", "st18,crc6"),
        ("error=0%", "st18,nE,crc6", "st18,nE,crc6"),
        ("error=0%", "st18,pad4,nE,nW,crc6", "st18,pad4,nE,nW,crc6"),
    ] {
        let findings = detect_sim(&format!("device=none,{rates},frame={frame}"), 512);
        assert_eq!(
            findings.answers[0].format.to_string(),
            want,
            "{rates} {:?}",
            findings.answers
        );
    }
}

/// Steps that are all multiples of eight leave low bits at 0 that are no padding: what is sent must be what is read.
#[test]
fn even_steps_are_no_padding() {
    let plain = format("st16,nE,nW,crc6");
    let traces = (0..64u64).map(|step| frame(&plain, &[((step * 1_000 % 65_536) << 2) | 3]));
    let findings = detect_traces(traces);
    assert_eq!(findings.answers[0].format, plain, "{:?}", findings.answers);
}

#[test]
fn a_sign_of_life_counts() {
    let safety = "st24,nE,nW,crc6+st24,nE,nW,lc6,crc16";
    let findings = detect_sim(&format!("device=none,frame={safety}"), 256);
    assert_eq!(findings.answers[0].format.to_string(), safety);
    // A position may count like one, but carries.
    let findings = detect_sim("device=none,motion=count,frame=st24,crc16", 256);
    assert_eq!(findings.answers[0].format.to_string(), "st24,crc16");
}

/// Where turns and position are not one seamless number.
#[test]
fn turns_show_where_they_can() {
    let turning = |position: u64| 4_321 + position;
    for (name, range, pad, want) in [
        ("bits between", 4_096, 3, "mt6,pad3,st12,nE,nW,crc6"),
        ("3600 counts a turn", 3_600, 0, "mt6,st12,nE,nW,crc6"),
        ("seamless", 4_096, 0, "st18,nE,nW,crc6"),
    ] {
        let plain = format(&format!("data{},crc6", 20 + pad));
        let traces = (0..200).map(|step| {
            let counts = turning(step * 211);
            let word = ((counts / range % 64) << (12 + pad)) | (counts % range);
            frame(&plain, &[word << 2 | 3])
        });
        let findings = detect_traces(traces);
        assert_eq!(
            findings.answers[0].format.to_string(),
            want,
            "{name}: {:?}",
            findings.answers
        );
    }
}

#[test]
fn what_is_no_biss_is_told_apart() {
    let mut rng = common::rng();
    let zeros = "0".repeat(40);
    // SSI: the first bit with the first clock, low while the monoflop runs, then high.
    let ssi = (0..64u32).map(|step| {
        trace(&format!(
            "{:013b}{zeros}{}",
            4_000 + step * 3,
            "1".repeat(20)
        ))
    });
    assert_eq!(detect_traces(ssi).line, Line::Ssi { bits: 13 });
    // Its most significant bit may be 1 for a while, and look like LAT.
    let ssi = (0..64u32).map(|step| trace(&format!("{:013b}{zeros}", (step * 211) % 8_192)));
    assert!(matches!(
        detect_traces(ssi).line,
        Line::Ssi { bits: 12 | 13 }
    ));
    let noise: Vec<Trace> = (0..64)
        .map(|_| {
            let bits: String = (0..90)
                .map(|_| if rng.bool() { '1' } else { '0' })
                .collect();
            Trace {
                idle: Some(rng.bool()),
                ..trace(&bits)
            }
        })
        .collect();
    let findings = detect_traces(noise);
    assert_eq!(findings.line, Line::Noise);
    assert!(findings.only().is_none());
    let low = Trace {
        idle: Some(false),
        ..trace(&zeros)
    };
    assert_eq!(detect_traces([low.clone(), low]).line, Line::StuckLow);
    assert_eq!(
        detect_traces([trace(&"1".repeat(60))]).line,
        Line::StuckHigh
    );
    assert_eq!(
        detect_traces([trace(&format!("1{}", "0".repeat(60)))]).line,
        Line::NoStart
    );
    assert_eq!(detect_traces([]).line, Line::Unseen);
}

/// Random bits behind a good head have no CRC: nothing may be made of them.
#[test]
fn random_words_fit_nothing() {
    let mut rng = common::rng();
    for _ in 0..common::size(10) {
        let bits = rng.u8(20..=60);
        let plain = format(&format!("data{bits}"));
        let words: Vec<u64> = (0..64).map(|_| common::word(&mut rng, bits)).collect();
        let findings = detect_traces(words.iter().map(|word| frame(&plain, &[*word])));
        assert!(
            findings.only().is_none(),
            "{bits} bits: {:?}",
            findings.answers
        );
        assert!(
            findings.none_probability > 0.99,
            "{bits} bits: {:?}",
            findings.answers
        );
    }
}

/// Frames as long as they can be, with bits of any share of ones, alike or not.
#[test]
fn nonsense_ends_soon() {
    let mut rng = common::rng();
    for _ in 0..common::size(2) {
        let (share, frames) = (rng.u8(1..=7), rng.usize(1..=4));
        let began = Instant::now();
        let random = |rng: &mut Rng| -> String {
            let bits = (0..2_040).map(|_| if rng.u8(..8) < share { '1' } else { '0' });
            format!("101{}", bits.collect::<String>())
        };
        let traces: Vec<Trace> = (0..frames).map(|_| trace(&random(&mut rng))).collect();
        let findings = detect_traces(traces);
        assert!(findings.only().is_none());
        let took = began.elapsed();
        assert!(
            took.as_secs() < 60,
            "{share} of 8, {frames} frames: {took:?}"
        );
    }
}

/// A position that stands still is waited for as long as was asked for. Motion ends it: two counts a second are enough.
#[test]
fn motion_is_waited_for() {
    let (found, stderr, status) = object("sim:device=none,motion=still,pos=700", &["--wait", "2s"]);
    assert_eq!(status, Some(1));
    assert!(stderr.contains("turn the encoder"), "{stderr}");
    let frames = found["frames"].as_u64().unwrap();
    assert!((2_900..3_100).contains(&frames), "{frames}");
    let slow = "sim:device=none,motion=speed,rpm=0.0001,pos=700,frame=st20,nE,nW,crc6";
    let (found, _, status) = object(slow, &["--wait", "60s"]);
    assert_eq!(
        (&found["answers"][0]["format"], status),
        (&"st20,nE,nW,crc6".into(), Some(0))
    );
    let frames = found["frames"].as_u64().unwrap();
    assert!((1_001..40_000).contains(&frames), "{frames}");
}

fn object(link: &str, more: &[&str]) -> (Value, String, Option<i32>) {
    let args = [&["detect", link, "-o", "json"], more].concat();
    let (stdout, stderr, status) = texts(biss(&args).output().unwrap());
    let mut records = json(&stdout);
    assert!(records.len() <= 1, "{stdout}");
    (records.pop().unwrap_or(Value::Null), stderr, status)
}

/// The last line is a command that reads the encoder.
#[test]
fn what_is_found_can_be_typed() {
    for link in [
        "sim:device=none,frame=st19,nE,nW,crc5",
        "sim:frame=mt12,st20,nE,nW,crc6",
        "sim:device=none,ack=40,frame=pos26,nE,nW,crc6",
        "file:tests/recordings/bench.vcd",
    ] {
        let (stdout, stderr, status) = run(&format!("detect {link}"));
        assert_eq!((stderr.as_str(), status), ("", Some(0)), "{link}: {stdout}");
        let command = stdout.lines().last().unwrap();
        assert!(
            command.starts_with(&format!("biss read {link} -f ")),
            "{command}"
        );
        let (records, stderr, status) = run(command.strip_prefix("biss ").unwrap());
        assert_eq!(status, Some(0), "{command}: {records}{stderr}");
    }
}

#[test]
fn what_stands_still_stays_ambiguous() {
    let (found, stderr, status) = object("sim:device=none,motion=still,pos=700", &[]);
    assert_eq!((stderr.as_str(), status), ("", Some(1)));
    assert_eq!(
        (&found["different"], &found["certain"]),
        (&1.into(), &false.into())
    );
    let answers = found["answers"].as_array().unwrap();
    assert!(answers.len() > 1);
    assert_eq!(answers[0]["format"], "st32,nE,nW,crc6");
    let (stdout, _, _) = run("detect sim:device=none,motion=still,pos=700");
    assert!(stdout.contains("move the encoder"), "{stdout}");
    // Enough motion, and too few frames of it.
    let (_, _, status) = object("sim:device=none", &[]);
    assert_eq!(status, Some(0));
    let (found, _, status) = object("sim:device=none", &["-n", "2"]);
    assert_eq!((&found["frames"], status), (&2.into(), Some(1)));
}

#[test]
fn a_line_without_an_encoder_is_described() {
    for (link, line, words) in [
        ("sim:stuck=1", "stuck-high", "nobody answers"),
        ("sim:stuck=0", "stuck-low", "low all the time"),
        ("sim:no-start=1", "no-start", "no start bit"),
        (
            "file:tests/recordings/absent.vcd",
            "stuck-high",
            "nobody answers",
        ),
    ] {
        let (found, stderr, status) = object(link, &[]);
        assert_eq!((stderr.as_str(), status), ("", Some(1)), "{link}");
        assert_eq!(
            (&found["line"], found.get("command")),
            (&line.into(), None),
            "{link}"
        );
        let (stdout, _, _) = run(&format!("detect {link}"));
        assert!(stdout.contains(words), "{stdout}");
    }
}

#[test]
fn recordings_say_what_they_are_of() {
    for (file, first) in [
        ("bench.vcd", "st26,nE,nW,crc6"),
        ("bench.sr", "st26,nE,nW,crc6"),
        ("far.vcd", "st26,nE,nW,crc6"),
        ("table.vcd", "st12,nE,nW,crc6"),
        ("registers.vcd", "st3,nE,nW,crc3"),
    ] {
        let (found, stderr, _) = object(&format!("file:tests/recordings/{file}"), &[]);
        assert_eq!(stderr, "", "{file}");
        assert_eq!(found["answers"][0]["format"], first, "{file}");
        assert!(
            found["answers"][0]["probability"].as_f64() > Some(0.95),
            "{file}"
        );
    }
    // Few frames, with flags that change in each, or with a sign of life.
    for (file, among) in [
        ("flags.vcd", "st26,nE,nW,crc6"),
        ("safety.vcd", "st36,nE,nW,crc6+st36,nE,nW,lc6,crc16"),
    ] {
        let (found, _, status) = object(&format!("file:tests/recordings/{file}"), &[]);
        let answers = found["answers"].as_array().unwrap();
        assert!(
            answers.iter().any(|answer| answer["format"] == among),
            "{file}: {found}"
        );
        assert_eq!(status, Some(1), "{file}");
    }
}

/// Registers name the fields; without them, or when they must not be asked in other banks, frames still say the rest.
#[test]
fn registers_name_the_fields() {
    let (found, _, status) = object("sim", &[]);
    assert_eq!(status, Some(0));
    assert_eq!(found["answers"][0]["format"], "mt12,st20,nE,nW,crc6");
    assert_eq!(found["registers"]["fits"], true);
    let (found, _, status) = object("sim:device=mhm", &[]);
    assert_eq!(
        (&found["answers"][0]["format"], status),
        (&"mt12,st16,nE,nW,crc6".into(), Some(0))
    );
    // EDS in another bank.
    let (found, stderr, status) = object("sim:frame=pos30,nE,nW,crc8", &["--no-write"]);
    assert_eq!(status, Some(0), "{stderr}");
    let format = found["answers"][0]["format"].as_str().unwrap();
    assert!(
        same_cut(
            &format.parse().unwrap(),
            &"pos30,nE,nW,crc8".parse().unwrap()
        ),
        "{format}"
    );
    let (found, _, _) = object("sim:device=none", &[]);
    assert_eq!(found.get("registers"), None);
}

/// Measured on the simulated slave, whose timeout is known, and never faster than BiSS-C goes.
#[test]
fn what_the_encoder_bears_is_measured() {
    let (found, _, _) = object(
        "sim:device=none,timeout=17us,delay=300ns",
        &["-c", "500kHz"],
    );
    let timeout = found["timeout_max_ns"].as_u64().unwrap();
    assert!((17_000..18_500).contains(&timeout), "{timeout}");
    assert_eq!(found["clock_hz"], 500_000);
    let interval = found["interval_ns"].as_u64().unwrap();
    // 45 clocks, the timeout, and a clock of rest.
    assert!((105_000..115_000).contains(&interval), "{interval}");
    assert_eq!(found["clock_min_hz"], 100_000);
    let most = found["clock_max_hz"].as_u64().unwrap();
    assert!((1_000_000..=10_000_000).contains(&most), "{most}");
    let (found, _, _) = object("file:tests/recordings/bench.vcd", &[]);
    assert_eq!(
        (found.get("clock_max_hz"), &found["timeout_ns"]["max"]),
        (None, &20_000.into())
    );
}

#[test]
fn mistakes_are_usage_errors() {
    for (args, words) in [
        (
            "detect file:tests/recordings/bench.vcd -c 1MHz",
            "no meaning on a recording",
        ),
        (
            "detect file:tests/recordings/bench.vcd --no-write",
            "no meaning on a recording",
        ),
        ("detect sim -n 0", "0"),
        ("detect sim -n 5 --wait 1s", "--wait"),
        ("detect file:nowhere.vcd", "opening the recording"),
        ("detect", "LINK"),
    ] {
        let (stdout, stderr, status) = run(args);
        assert_eq!((stdout.as_str(), status), ("", Some(2)), "{args}");
        assert!(stderr.contains(words), "{args}: {stderr}");
    }
    let (_, stderr, status) = run("read file:tests/recordings/bench.vcd");
    assert_eq!(status, Some(2));
    assert!(stderr.contains("biss detect"), "{stderr}");
}

/// A folder of its own, and a configuration in it.
fn shelf(name: &str, text: &str) -> std::path::PathBuf {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("config.toml");
    std::fs::write(&path, text).unwrap();
    path
}

#[test]
fn what_is_certain_is_saved_under_a_name() {
    let text = "# mine\n[encoder.axis]\nlink = \"sim:stuck=1\"\nframe = \"st8,crc6\"\nzero = 7\n";
    let path = shelf("detect-save", text);
    let config = path.display();
    let link = "sim:device=none,frame=st22,nE,nW,crc6";
    let (found, stderr, code) = run(&format!(
        "detect {link} -c 500kHz --config {config} --save axis"
    ));
    assert_eq!(code, Some(0), "{stderr}");
    assert!(found.ends_with("-c 500kHz\n"), "{found}");
    assert!(
        stderr.ends_with("config.toml: biss read axis\n"),
        "{stderr}"
    );
    let text = std::fs::read_to_string(&path).unwrap();
    for line in [
        "# mine",
        "link = \"sim:device=none\"",
        "frame = \"st22,nE,nW,crc6\"",
        "clock = \"500kHz\"",
        "zero = 7",
    ] {
        assert!(text.lines().any(|known| known == line), "{line}: {text}");
    }
    let (read, stderr, code) = run(&format!("read axis --config {config} -o json -q"));
    assert_eq!(code, Some(0), "{stderr}");
    assert!(json(&read)[0]["counts"].is_number(), "{read}");
    // Its own link is known by its name.
    let (_, stderr, code) = run(&format!("detect axis --config {config} --save other -q"));
    assert_eq!(code, Some(0), "{stderr}");
    let (_, stderr, code) = run(&format!("read other --config {config} -q"));
    assert_eq!(code, Some(0), "{stderr}");
}

#[test]
fn what_is_not_certain_is_not_saved() {
    let path = shelf("detect-unsaved", "# nothing\n");
    let config = path.display();
    let still = "sim:device=none,motion=still,pos=700 -n 20";
    for (args, status, says) in [
        (
            format!("{still} --save axis"),
            1,
            "nothing is saved as axis",
        ),
        (
            "sim:stuck=0 --save axis".into(),
            1,
            "nothing is saved as axis",
        ),
        ("exec:cat --save axis".into(), 2, "no file can name it"),
        ("sim --save sim".into(), 2, "a kind of link"),
        ("sim --save a/b".into(), 2, "no name for an encoder"),
    ] {
        let (_, stderr, code) = run(&format!("detect {args} --config {config}"));
        assert_eq!(code, Some(status), "{args}: {stderr}");
        assert!(stderr.contains(says), "{args}: {stderr}");
        assert_eq!(
            std::fs::read_to_string(&path).unwrap(),
            "# nothing\n",
            "{args}"
        );
    }
    let folder = path.parent().unwrap().display();
    let link = "sim:device=none,frame=st22,nE,nW,crc6";
    let (found, stderr, code) = run(&format!("detect {link} --config {folder} --save axis"));
    assert_eq!(code, Some(2), "{stderr}");
    assert!(
        found.contains("st22,nE,nW,crc6"),
        "what was found is told all the same"
    );
    assert!(stderr.contains("saving axis in"), "{stderr}");
}
