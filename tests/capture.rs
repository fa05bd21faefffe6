//! `biss capture`: what was recorded reads back to the frames that were sent, in every kind of file.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;
#[path = "common/pushed.rs"]
mod pushed;

use biss::frame::BissC;
use biss::link::tap::Tap;
use biss::link::{Link, file, sim};
use biss::master::{Master, Slot};
use biss::record::{self, Head, Kind, Output, usual_rate};
use biss::slave::Config;
use biss::slice::Slicer;
use biss::unit::Hertz;
use biss::waveform::{Change, Waveform};
use common::{biss, json, rng, run, size};
use fastrand::Rng;
use pushed::{Pushed, Words, all_frames, good};
use serde_json::Value;
use std::cell::RefCell;
use std::fs;
use std::io::{self, Cursor, Read, Write};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::rc::Rc;
use std::time::Duration;
use zip::ZipArchive;

/// A folder of this test's own.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Folder {
        let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("capture-{name}"));
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(&path).unwrap();
        Folder(path)
    }

    fn path(&self, name: &str) -> String {
        self.0.join(name).to_str().unwrap().to_owned()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// A pipe whose end is looked at when all is written.
#[derive(Clone, Default)]
struct Pipe(Rc<RefCell<Vec<u8>>>);

impl Write for Pipe {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().write(bytes)
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// What a slave sent, and both wires meanwhile.
struct Taken {
    sent: Words,
    /// When each frame began.
    begun: Vec<u64>,
    changes: Vec<Change>,
    end_ns: u64,
}

/// Frames of a slave that counts, with a rest between them or as close as the slave lets them.
fn take(config: &str, hz: Hertz, frames: usize, gap_ns: u64) -> (Taken, BissC) {
    let config: Config = config.parse().unwrap_or_else(|e| panic!("{config}: {e}"));
    let mut link = sim::open(config.clone());
    link.set_clock(hz).unwrap();
    let tap = Rc::new(RefCell::new(Tap::new(Box::new(link))));
    let mut side = Rc::clone(&tap);
    let protocol = BissC::new(config.format.clone());
    let mut master = Master::new(&mut side, &protocol, Some(0));
    master.open().unwrap();
    tap.borrow_mut().begin().unwrap();
    master.pause(100_000).unwrap();
    let (mut sent, mut begun) = (Vec::new(), Vec::new());
    for _ in 0..frames {
        let at_ns = master.link().now_ns() + gap_ns;
        let slot = master.slot(at_ns, None).unwrap();
        assert_eq!(slot, Slot::Done { tries: 1 });
        sent.push(good(&master).unwrap_or_else(|| panic!("{:?}", master.cycle().fault())));
        begun.push(master.trace().t_ns);
    }
    master.pause(100_000).unwrap();
    let mut tap = tap.borrow_mut();
    tap.waveform(&mut Waveform::default()).unwrap();
    let changes: Vec<Change> = tap.take().collect();
    let zero_ns = changes[0].t_ns;
    let since = |change: &Change| Change {
        t_ns: change.t_ns - zero_ns,
        ..*change
    };
    let taken = Taken {
        sent,
        begun: begun.iter().map(|t_ns| t_ns - zero_ns).collect(),
        changes: changes.iter().map(since).collect(),
        end_ns: tap.now_ns() - zero_ns,
    };
    (taken, protocol)
}

/// As a file of this kind.
fn written(taken: &Taken, kind: Kind, rate: Hertz) -> Vec<u8> {
    let pipe = Pipe::default();
    let head = Head {
        notes: &[],
        format: None,
        rate,
        first: taken.changes[0],
    };
    let output = Output::Stream(Box::new(pipe.clone()));
    let mut recorder = record::begin(kind, output, &head).unwrap();
    for change in &taken.changes[1..] {
        recorder.change(change).unwrap();
    }
    recorder.end(taken.end_ns).unwrap();
    drop(recorder);
    pipe.0.take()
}

/// The samples of a session, all of them, and the metadata.
fn session(bytes: &[u8]) -> (Vec<u8>, String) {
    let mut archive = ZipArchive::new(Cursor::new(bytes)).unwrap();
    let mut text = |name: &str| {
        let mut text = String::new();
        let entry = archive.by_name(name).unwrap();
        entry.take(1 << 16).read_to_string(&mut text).unwrap();
        text
    };
    assert_eq!(text("version"), "2");
    let metadata = text("metadata");
    let mut samples = Vec::new();
    for piece in 1.. {
        let Ok(mut entry) = archive.by_name(&format!("logic-1-{piece}")) else {
            break;
        };
        entry.read_to_end(&mut samples).unwrap();
    }
    (samples, metadata)
}

/// Where samples differ from the one before, and how many there are.
fn edges(samples: &[u8]) -> (Vec<(usize, u8)>, usize) {
    let mut edges: Vec<(usize, u8)> = Vec::new();
    for (index, sample) in samples.iter().enumerate() {
        if edges.last().is_none_or(|(_, last)| last != sample) {
            edges.push((index, *sample));
        }
    }
    (edges, samples.len())
}

/// What a recording of these samples shows that begins with sample `start`.
fn read_samples(
    (edges, end): &(Vec<(usize, u8)>, usize),
    start: usize,
    rate: Hertz,
    protocol: &BissC,
) -> (Words, Vec<String>) {
    let mut slicer = Slicer::new(protocol.timeout_max_ns.into());
    let at = |sample: usize| (sample - start) as u64 * 1_000_000_000 / u64::from(rate.0);
    let first = edges
        .iter()
        .rposition(|(index, _)| *index <= start)
        .unwrap();
    for (index, sample) in &edges[first..] {
        slicer.push(
            at(*index.max(&start)),
            sample & 1 == 1,
            Some(sample & 2 == 2),
        );
    }
    slicer.finish(at(*end));
    all_frames(&mut Pushed(slicer), protocol)
}

fn read_rows(text: &str, protocol: &BissC) -> (Words, Vec<String>) {
    let mut slicer = Slicer::new(protocol.timeout_max_ns.into());
    let mut rows = text.lines();
    assert_eq!(rows.next(), Some("Time [s],MA,SLO"));
    let mut end_ns = 0;
    for row in rows {
        let cells: Vec<&str> = row.split(',').collect();
        let (seconds, ns) = cells[0].split_once('.').unwrap();
        assert_eq!(ns.len(), 9, "{row}");
        let ns: u64 = ns.parse().unwrap();
        end_ns = seconds.parse::<u64>().unwrap() * 1_000_000_000 + ns;
        slicer.push(end_ns, cells[1] == "1", Some(cells[2] == "1"));
    }
    slicer.finish(end_ns);
    all_frames(&mut Pushed(slicer), protocol)
}

fn read_vcd(text: Vec<u8>, protocol: &BissC) -> (Words, Vec<String>) {
    let timeout_ns = protocol.timeout_max_ns.into();
    let mut link = file::open(
        file::Input::pipe(Cursor::new(text)),
        "text",
        &file::Asked::new(timeout_ns),
    )
    .unwrap();
    all_frames(&mut link, protocol)
}

/// One set-up of the grid. The shortest timeout is two clocks and more: less is hardly told from a pause where a recording
/// begins inside a frame.
fn any_case(rng: &mut Rng) -> (String, Hertz, u64) {
    let format = *rng
        .choice(&[
            "st26,nE,nW,crc6",
            "mt12,st20,nE,nW,crc6",
            "st18,crc5",
            "mt12,st24,nE,nW,crc6+mt12,st24,nE,nW,lc6,crc16",
        ])
        .unwrap();
    let clocks = [
        200_000, 250_000, 333_333, 1_000_000, 2_500_000, 7_812_500, 10_000_000,
    ];
    let hz = *rng.choice(&clocks).unwrap();
    let period_ns = 1_000_000_000 / hz;
    // A sample before the 40 us that are allowed, even at the slowest rate.
    let delay_ns = *rng.choice(&[0, 30, 400, 3_300, 12_345, 38_500]).unwrap();
    let most = (30_000 / period_ns).clamp(1, 8);
    let ack = rng.u32(1..=most);
    // In the middle between two edges.
    let busy_ns = rng.u32(0..most) * period_ns + period_ns / 2;
    let timeout = *rng.choice(&["20us", "12.5us", "40us"]).unwrap();
    let config = format!(
        "motion=count,pos={},delay={delay_ns}ns,ack={ack},busy={busy_ns}ns,timeout={timeout},seed={},frame={format}",
        rng.u32(..1 << 18),
        rng.u32(..),
    );
    let gap_ns = *rng.choice(&[0, 90_000, 400_000]).unwrap();
    (config, Hertz(hz), gap_ns)
}

/// Over formats, clocks, line delays, Ack lengths, busy times, gaps and sample rates: every kind of file gives every frame.
#[test]
fn every_kind_reads_back_over_the_grid() {
    let mut rng = rng();
    for _ in 0..size(60) {
        let (config, hz, gap_ns) = any_case(&mut rng);
        let (taken, protocol) = take(&config, hz, 8, gap_ns);
        let rate = match rng.bool() {
            true => usual_rate(hz),
            // Eight samples a clock, on no round number.
            false => Hertz(hz.0 * 8 + rng.u32(0..hz.0)),
        };
        let what = format!("{config} at {hz}, {rate}, gap {gap_ns}");
        let none: Vec<String> = Vec::new();
        let want = (taken.sent.clone(), none);
        assert_eq!(
            read_vcd(written(&taken, Kind::Vcd, rate), &protocol),
            want,
            "{what}"
        );
        let rows = String::from_utf8(written(&taken, Kind::Csv, rate)).unwrap();
        assert_eq!(read_rows(&rows, &protocol), want, "{what}");
        let (samples, metadata) = session(&written(&taken, Kind::Sr, rate));
        assert!(
            metadata.contains("probe1=MA\nprobe2=SLO\nunitsize=1\n"),
            "{metadata}"
        );
        assert_eq!(
            read_samples(&edges(&samples), 0, rate, &protocol),
            want,
            "{what}"
        );
    }
}

/// A recording that begins anywhere in its first two frames gives nothing but frames that were sent, and all that follow on
/// the first whole one.
#[test]
fn every_starting_sample_reads_back() {
    let mut rng = rng();
    let (mut starts, mut begun_late) = (0, 0);
    for _ in 0..size(4) {
        let (config, hz, gap_ns) = any_case(&mut rng);
        let (taken, protocol) = take(&config, hz, 8, gap_ns);
        let rate = match rng.bool() {
            true => usual_rate(hz),
            false => Hertz(hz.0 * 8 + rng.u32(0..hz.0)),
        };
        let (samples, _) = session(&written(&taken, Kind::Sr, rate));
        let samples = edges(&samples);
        let sample =
            |t_ns: u64| (u128::from(t_ns) * u128::from(rate.0)).div_ceil(1_000_000_000) as usize;
        let begun: Vec<usize> = taken.begun.iter().map(|t_ns| sample(*t_ns)).collect();
        for start in begun[0] - 3..begun[2] {
            let (words, others) = read_samples(&samples, start, rate, &protocol);
            let whole = begun.iter().position(|begun| *begun > start).unwrap();
            let what = || {
                format!(
                    "{config} at {hz}, {rate}, gap {gap_ns}, from {start} of {begun:?}: {others:#?}"
                )
            };
            assert!(taken.sent.ends_with(&words), "{words:?} {}", what());
            // The rest before it may be too short for what is left of it.
            let missing = taken.sent.len() - whole - words.len().min(taken.sent.len() - whole);
            assert!(missing <= 1, "{missing} missing, {}", what());
            starts += 1;
            begun_late += missing;
        }
    }
    println!("{starts} starts, the first whole frame was not certain in {begun_late}");
}

/// What was printed while it was captured and what is read from the file is the same, and a second conversion changes nothing.
#[test]
fn the_command_writes_what_it_prints() {
    let folder = Folder::new("prints");
    let (vcd, again) = (folder.path("x.vcd"), folder.path("y.vcd"));
    let format = "st26,nE,nW,crc6";
    let link = format!("sim:delay=2.2us,busy=3.5us,crc-error=10%,error=5%,seed=11,frame={format}");
    let (out, err, _) = run(&format!("capture {link} -n 40 -o json -w {vcd}"));
    assert!(err.contains("\"type\":\"summary\""), "{err}");
    let (read, _, _) = run(&format!("read file:{vcd} -f {format} -o json"));
    let same = |text: &str| -> Vec<Value> {
        let mut records = json(text);
        for record in &mut records {
            let record = record.as_object_mut().unwrap();
            let live = ["tries", "delay_ns", "delay_clk", "bits"];
            let recorded = [
                "busy_ns",
                "clock_hz",
                "timeout_ns",
                "first_clock",
                "last_clock",
            ];
            for key in live.into_iter().chain(recorded) {
                record.remove(key);
            }
        }
        records
    };
    assert_eq!(same(&out).len(), 40);
    assert_eq!(same(&out), same(&read));
    let (_, err, code) = run(&format!("capture file:{vcd} -f {format} -w {again}"));
    assert_eq!(code, Some(1), "{err}");
    let wires = |path: &str| {
        let text = fs::read_to_string(path).unwrap();
        text.split_once("$timescale").unwrap().1.to_owned()
    };
    assert_eq!(wires(&vcd), wires(&again));
}

/// A start that fails leaves what is there, and makes nothing.
#[test]
fn a_failed_start_touches_nothing() {
    let folder = Folder::new("start");
    let (old, new) = (folder.path("old.vcd"), folder.path("new.vcd"));
    fs::write(&old, "old").unwrap();
    for path in [&old, &new] {
        let (_, err, code) = run(&format!("capture gpio:/dev/null,ma=1,slo=2 -w {path}"));
        assert_eq!(code, Some(2), "{err}");
    }
    assert_eq!(fs::read_to_string(&old).unwrap(), "old");
    assert!(!PathBuf::from(&new).exists());
    for (args, want) in [
        ("sim -w x.txt", ".vcd, .sr or .csv"),
        ("sim -w - --as sr", "standard output"),
        ("sim -w - --as vcd -o json", "cannot both"),
        ("sim -w x.vcd --sample-rate 1MHz", "--sample-rate"),
    ] {
        let (out, err, code) = run(&format!("capture {args}"));
        assert_eq!((out.as_str(), code), ("", Some(2)), "{args}: {err}");
        assert!(err.contains(want), "{args}: {err}");
    }
}

/// Fewer samples a clock than a reader needs are refused before anything is written, live or from a recording.
#[test]
fn too_few_samples_are_refused() {
    let folder = Folder::new("rate");
    let (vcd, sr) = (folder.path("x.vcd"), folder.path("x.sr"));
    let format = "st26,nE,nW,crc6";
    let sim = format!("capture sim:frame={format} -c 1MHz -n 3");
    let (_, err, code) = run(&format!("{sim} -w {vcd}"));
    assert_eq!(code, Some(0), "{err}");
    for from in [sim.clone(), format!("capture file:{vcd} -f {format}")] {
        for rate in ["1MHz", "3.9MHz", "7.9MHz"] {
            let (out, err, code) = run(&format!("{from} --sample-rate {rate} -w {sr}"));
            assert_eq!((out.as_str(), code), ("", Some(2)), "{from} {rate}: {err}");
            assert!(
                err.contains("ask for 8MHz at least; 16MHz is usual"),
                "{err}"
            );
            assert!(!PathBuf::from(&sr).exists(), "{from} {rate}");
        }
        let (_, err, code) = run(&format!("{from} --sample-rate 8MHz -w {sr}"));
        assert_eq!(code, Some(0), "{err}");
        let (out, err, code) = run(&format!("read file:{sr} -f {format}"));
        assert_eq!((out.lines().count(), code), (3, Some(0)), "{from}: {err}");
        fs::remove_file(&sr).unwrap();
    }
}

/// A VCD may say that SLO is not known. Files with two levels show no frame then that the VCD does not.
#[test]
fn what_is_not_known_becomes_no_frame() {
    let mut rng = rng();
    let folder = Folder::new("unknown");
    let format = "st6,crc3";
    let vcd = folder.path("x.vcd");
    let capture = format!("capture sim:motion=count,delay=700ns,frame={format} -n 400 -w {vcd}");
    let (_, err, code) = run(&capture);
    assert_eq!(code, Some(0), "{err}");
    let text = fs::read_to_string(&vcd).unwrap();
    let (head, body) = text.split_once("$dumpvars").unwrap();
    let (mut made, mut hidden) = (format!("{head}$dumpvars"), 0);
    for line in body.lines() {
        let hides =
            matches!(line, "0\"" | "1\"") && made.len() > head.len() + 200 && rng.u8(..12) == 0;
        hidden += usize::from(hides);
        made += if hides { "x\"" } else { line };
        made.push('\n');
    }
    fs::write(&vcd, made).unwrap();
    let good = |path: &str| -> Vec<(u64, u64)> {
        let (out, err, _) = run(&format!("read file:{path} -f {format} -o json"));
        let records = json(&out);
        assert!(records.len() > 300, "{err}");
        let good = records.iter().filter(|record| record["ok"] == true);
        let good = good.map(|record| {
            (
                record["t_ns"].as_u64().unwrap(),
                record["pos"].as_u64().unwrap(),
            )
        });
        good.collect()
    };
    let known = good(&vcd);
    assert!(hidden > 100 && known.len() > 50, "{hidden} {}", known.len());
    for end in ["csv", "sr"] {
        let path = folder.path(&format!("x.{end}"));
        let (_, err, code) = run(&format!("capture file:{vcd} -f {format} -w {path}"));
        assert_eq!(code, Some(1), "{err}");
        let read = good(&path);
        assert!(
            read.len() * 10 > known.len() * 9,
            "{} of {}",
            read.len(),
            known.len()
        );
        for (t_ns, pos) in read {
            let same = |(at, known): &(u64, u64)| at.abs_diff(t_ns) < 200 && *known == pos;
            assert!(known.iter().any(same), "{end}: {pos} at {t_ns}");
        }
    }
}

/// An end by a signal, and a disk that is full, leave a file that reads.
#[test]
fn what_is_on_disk_can_be_read() {
    let folder = Folder::new("ends");
    for end in ["vcd", "sr", "csv"] {
        let path = folder.path(&format!("x.{end}"));
        let args = format!("capture sim:fast -n 0 -i 1ms -w {path}");
        let args: Vec<&str> = args.split(' ').collect();
        let mut child = biss(&args).stderr(Stdio::piped()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(300));
        let pid = child.id().to_string();
        assert!(
            Command::new("kill")
                .args(["-INT", &pid])
                .status()
                .unwrap()
                .success()
        );
        assert_eq!(child.wait().unwrap().code(), Some(0), "{end}");
        let bytes = fs::read(&path).unwrap();
        match end {
            "sr" => assert!(!session(&bytes).0.is_empty()),
            _ => assert!(bytes.len() > 10_000 && bytes.ends_with(b"\n"), "{end}"),
        }
        let (_, err, code) = run(&format!("capture sim -n 3 -w /dev/full --as {end}"));
        assert_eq!(code, Some(2), "{err}");
        assert!(err.contains("No space left"), "{err}");
    }
}

/// Pieces of a session stand one behind the other with nothing between them: they read through a pipe as from the file, and
/// those that are whole read where the file ends inside one and has no directory, as after a power cut.
#[test]
fn pieces_of_a_session_read_without_its_directory() {
    let folder = Folder::new("pieces");
    let (whole, cut) = (folder.path("whole.sr"), folder.path("cut.sr"));
    let format = "st26,nE,nW,crc6";
    let capture = format!("capture sim:frame={format} -n 200 --sample-rate 1GHz -w {whole}");
    let (_, err, code) = run(&capture);
    assert_eq!(code, Some(0), "{err}");
    let (all, _, _) = run(&format!("read file:{whole} -f {format}"));
    assert_eq!(all.lines().count(), 200);

    let bytes = fs::read(&whole).unwrap();
    let mut child = biss(&["read", "file:-", "-f", format])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(&bytes).unwrap();
    let out = child.wait_with_output().unwrap();
    assert_eq!(String::from_utf8(out.stdout).unwrap(), all);

    let name = b"logic-1-3";
    let third = bytes.windows(name.len()).position(|at| at == name).unwrap();
    fs::write(&cut, &bytes[..third + 100]).unwrap();
    let (out, err, code) = run(&format!("read file:{cut} -f {format}"));
    assert_eq!(code, Some(2), "{err}");
    // Two pieces of 2²² ns: a rest of 120 µs, then 58.5 µs a frame.
    assert_eq!(out.lines().count(), 141, "{err}");
    assert!(all.starts_with(&out));
}

/// What a recording's end cuts is no fault, wherever it cuts: an answer that had time to come yet is not missing.
#[test]
fn no_end_of_a_recording_is_a_fault() {
    let folder = Folder::new("cut");
    let (whole, cut) = (folder.path("whole.csv"), folder.path("cut.csv"));
    let format = "st12,nE,nW,crc6";
    let capture =
        format!("capture sim:delay=30us,busy=20us,frame={format} -c 5MHz -n 2 -w {whole}");
    let (_, err, code) = run(&capture);
    assert_eq!(code, Some(0), "{err}");
    let (all, _, _) = run(&format!("read file:{whole} -f {format}"));
    let text = fs::read_to_string(&whole).unwrap();
    let rows: Vec<&str> = text.lines().collect();
    for end in (3..rows.len()).step_by(23) {
        fs::write(&cut, rows[..end].join("\n") + "\n").unwrap();
        let (out, err, _) = run(&format!("read file:{cut},ma=MA,slo=SLO -f {format}"));
        assert!(
            all.starts_with(&out),
            "{end} rows of {}: {out}{err}",
            rows.len()
        );
    }
}

/// sigrok sees the levels that were written. The test needs sigrok-cli: without it it says so, and fails where all are to run.
#[test]
fn sigrok_reads_the_same_levels() {
    let there = Command::new("sigrok-cli").arg("--version").output();
    if there.is_err() {
        let all = std::env::var_os("BISS_TEST_ALL").is_some();
        assert!(!all, "sigrok-cli is not installed");
        println!("sigrok-cli is not installed: not run");
        return;
    }
    let folder = Folder::new("sigrok");
    let (sr, vcd) = (folder.path("x.sr"), folder.path("x.vcd"));
    let link = "sim:delay=1.3us,crc-error=30%,seed=4,frame=st8,nE,nW,crc6";
    for path in [&sr, &vcd] {
        let (_, err, code) = run(&format!("capture {link} -n 3 -w {path}"));
        assert_eq!(code, Some(1), "{err}");
    }
    let read = |args: &[&str]| {
        let output = Command::new("sigrok-cli").args(args).output().unwrap();
        assert!(output.status.success(), "{output:?}");
        // Of a VCD it says the rate first, on the same stream.
        let text = output.stdout.starts_with(b"META");
        let line = output.stdout.iter().position(|byte| *byte == b'\n');
        let skip = line.filter(|_| text).map_or(0, |at| at + 1);
        let levels = output.stdout[skip..].iter().map(|sample| sample & 3);
        levels.collect::<Vec<u8>>()
    };
    let samples = session(&fs::read(&sr).unwrap()).0;
    let seen = read(&["-i", &sr, "-O", "binary"]);
    assert!(
        samples.len() > 1_000 && samples == seen,
        "{} {}",
        samples.len(),
        seen.len()
    );
    // A sample a nanosecond, or one more: the same levels, each until a sample of the session later.
    let (fine, _) = edges(&read(&["-i", &vcd, "-I", "vcd", "-O", "binary"]));
    let (coarse, _) = edges(&samples);
    assert_eq!(fine.len(), coarse.len());
    for ((ns, level), (sample, seen)) in fine.iter().zip(&coarse) {
        let late = (*sample as f64 * 62.5 - *ns as f64).abs();
        assert!(level == seen && late <= 63.5, "{ns} {sample}");
    }
}
