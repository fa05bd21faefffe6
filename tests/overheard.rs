//! Register traffic in recordings: what the program's master has done over wires that were recorded, and what `biss read file:`
//! says that it did.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;
#[path = "common/recorder.rs"]
mod recorder;
#[path = "common/wire.rs"]
mod wire;

use biss::control::{Access, Failure, Heard, Listener, Outcome, REST_FRAMES, Spoken};
use common::{biss, json, rng, size, texts};
use fastrand::Rng;
use recorder::recorded;
use serde_json::{Value, json};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

const ONE: &str = "st3,nE,nW,crc3";

fn written(name: &str, vcd: &str) -> PathBuf {
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("overheard-{name}.vcd"));
    std::fs::write(&file, vcd).unwrap();
    file
}

/// Stdout, stderr and exit status of `biss read` on a recording.
fn read(name: &str, vcd: &str, frame: &str, options: &str) -> (String, String, Option<i32>) {
    let link = format!("file:{}", written(name, vcd).display());
    let mut args = vec!["read", &link, "-f", frame];
    args.extend(options.split(' '));
    texts(biss(&args).output().unwrap())
}

fn records(name: &str, vcd: &str, frame: &str) -> Vec<Value> {
    json(&read(name, vcd, frame, "-o json -q").0)
}

/// Those that are no frames.
fn talk(records: &[Value]) -> impl Iterator<Item = &Value> {
    records.iter().filter(|record| record["type"] != "frame")
}

fn any_access(rng: &mut Rng, slaves: u8) -> Access {
    let slave = rng.u8(..slaves);
    match rng.u8(..5) {
        0 => Access::Command {
            slaves: rng.u8(..) & ((1u16 << slaves) - 1) as u8,
            // Nothing that takes a slave off the line.
            code: rng.u8(2..=3),
            checked: true,
            reduced: false,
        },
        1 | 2 => {
            let address = [0x00, 0x48, 0x70][rng.usize(..3)] + rng.u8(..8);
            let data: Vec<u8> = (0..rng.usize(1..=3)).map(|_| rng.u8(..)).collect();
            Access::Write {
                slave,
                address,
                data: data.as_slice().into(),
            }
        }
        _ => {
            let address = rng.u8(..0x80);
            Access::Read {
                slave,
                address,
                count: rng.u8(1..=(0x80 - address).min(4)),
            }
        }
    }
}

/// What was done, as a recording has to tell it: access, slave, address and value of each byte, commands, and the name of
/// what an access failed with.
fn did(outcomes: &[Outcome]) -> Vec<Value> {
    let mut all = Vec::new();
    for outcome in outcomes {
        let mut bytes = |name: &str, slave: u8, address: u8| {
            for (address, value) in (address..).zip(outcome.bytes.as_slice()) {
                all.push(json!([name, slave, address, value]));
            }
        };
        match outcome.access {
            Access::Read { slave, address, .. } => bytes("read", slave, address),
            Access::Write { slave, address, .. } => bytes("write", slave, address),
            Access::Command { slaves, code, .. } if outcome.failure.is_none() => {
                all.push(json!(["command", slaves, code]));
            }
            Access::Command { .. } => {}
        }
        all.extend(outcome.failure.map(|failure| json!(failure.name())));
    }
    all
}

/// Likewise, of the records. A refusal counts once, however often it was asked for.
fn told(records: &[Value]) -> Vec<Value> {
    let mut all: Vec<Value> = Vec::new();
    for record in talk(records) {
        let of = |key: &str| record[key].clone();
        if record["ok"] == false {
            assert!(record.get("value").is_none(), "{record}");
            if all.last() != Some(&of("fault")) {
                all.push(of("fault"));
            }
        } else if record["type"] == "command" {
            let ids = record["slaves"].as_array().into_iter().flatten();
            let slaves = ids.fold(0u8, |bits, id| bits | 1 << id.as_u64().unwrap());
            all.push(json!(["command", slaves, of("code")]));
        } else {
            all.push(json!([of("access"), of("slave"), of("addr"), of("value")]));
        }
    }
    all
}

#[test]
fn a_recording_says_what_the_master_did() {
    let mut rng = rng();
    let mut bytes = 0;
    for round in 0..size(8) {
        let slaves = rng.u8(1..=3);
        let knobs = [
            "",
            "reg-busy=0us..500us,",
            "read-only=0x04..0x4f,",
            "refuse=0x02..0x60,",
            "delay=2.3us,",
        ];
        let frame = vec![ONE; slaves.into()].join("+");
        let config = format!(
            "seed={},{}slaves=each,frame={frame}",
            rng.u32(..),
            rng.choice(&knobs).unwrap()
        );
        println!("{config}");
        let accesses: Vec<Access> = (0..8).map(|_| any_access(&mut rng, slaves)).collect();
        let (outcomes, vcd) = recorded(&config, &accesses, 20);
        let records = records(&format!("did-{round}"), &vcd, &frame);
        bytes += outcomes
            .iter()
            .map(|outcome| outcome.bytes.as_slice().len())
            .sum::<usize>();
        // A slave that stores a byte does not echo the next one: the master begins anew, and no access fails for it.
        let plain = |mut all: Vec<Value>| {
            all.retain(|one| one != "not-echoed");
            all.dedup_by(|a, b| a == b && a.is_string());
            all
        };
        let (told, did) = (plain(told(&records)), plain(did(&outcomes)));
        assert_eq!(told, did, "{config} {accesses:?}");
        let faults = records.iter().filter(|r| r["type"] == "frame");
        assert!(faults.clone().count() > 200);
        assert!(faults.clone().all(|frame| frame.get("fault").is_none()));
    }
    println!("{bytes} bytes");
    assert!(bytes > 5, "{bytes}");
}

const ACCESSES: [(u8, u8, u8); 2] = [(0, 0x78, 3), (0, 0x42, 2)];

/// A read of three bytes and one of two.
fn reads(config: &str) -> (Vec<Outcome>, String) {
    let accesses = ACCESSES.map(|(slave, address, count)| Access::Read {
        slave,
        address,
        count,
    });
    recorded(&format!("{config}frame={ONE}"), &accesses, 20)
}

/// Each stands behind the frame that ended it, with the time of its first one.
#[test]
fn records_stand_where_they_were_said() {
    let (_, vcd) = reads("");
    let records = records("place", &vcd, ONE);
    let frames: Vec<&Value> = records.iter().filter(|r| r["type"] == "frame").collect();
    let mut seen = 0;
    for (at, record) in records.iter().enumerate() {
        if record["type"] == "frame" {
            continue;
        }
        seen += 1;
        let seq = record["seq"].as_u64().unwrap() as usize;
        assert_eq!(records[at - 1]["seq"], record["seq"], "{record}");
        let first = seq + 1 - record["frames"].as_u64().unwrap() as usize;
        assert_eq!(frames[first]["t_ns"], record["t_ns"], "{record}");
    }
    assert_eq!(seen, 5);
    let lengths: Vec<&Value> = talk(&records).map(|record| &record["frames"]).collect();
    assert_eq!(lengths, [33, 15, 15, 33, 15]);
}

#[test]
fn text_shows_registers_between_positions() {
    let (_, vcd) = reads("reg-busy=100us,");
    let (stdout, ..) = read("text", &vcd, ONE, "-t none");
    let lines: Vec<&str> = stdout
        .lines()
        .filter(|line| line.contains("slave"))
        .collect();
    assert_eq!(lines.len(), 5, "{stdout}");
    assert_eq!(
        lines[0],
        "slave 0  read 0x78  0x42   66  B  (busy for 2 frames)"
    );
    let (timed, ..) = read("text", &vcd, ONE, "-q");
    let line = timed
        .lines()
        .find(|line| line.contains("read 0x78"))
        .unwrap();
    assert!(line.starts_with("  0.000"), "{line}");
    assert_eq!(line[10..12], *"  ", "{line}");
}

/// A table has rows of one kind.
#[test]
fn tables_have_frames_only() {
    let (_, vcd) = reads("");
    let (json, ..) = read("tables", &vcd, ONE, "-o json -q");
    let frames = json
        .lines()
        .filter(|line| line.contains(r#""frame""#))
        .count();
    let (csv, ..) = read("tables", &vcd, ONE, "-o csv -q");
    assert_eq!(csv.lines().count(), frames + 1);
    let columns = csv.lines().next().unwrap().split(',').count();
    assert!(csv.lines().all(|line| line.split(',').count() == columns));
    let (fields, ..) = read("tables", &vcd, ONE, "-F pos -q");
    assert_eq!(fields.lines().count(), frames);
}

/// Without what comes from `t_ns` on.
fn until(vcd: &str, t_ns: u64) -> String {
    let end = vcd
        .lines()
        .scan(0, |at, line| {
            let start = *at;
            *at += line.len() + 1;
            Some((start, line))
        })
        .find(|(_, line)| {
            let t = line.strip_prefix('#').and_then(|t| t.parse::<u64>().ok());
            t.is_some_and(|t| t >= t_ns)
        });
    vcd[..end.map_or(vcd.len(), |(at, _)| at)].into()
}

/// An access that the recording cuts, or a frame that is not whole, is said not to be known.
#[test]
fn what_is_cut_is_said() {
    let (_, vcd) = reads("");
    let whole = records("whole", &vcd, ONE);
    let offset = 50_000;
    let second: Vec<&Value> = talk(&whole).collect();
    let t_ns = second[1]["t_ns"].as_u64().unwrap();
    let seq = second[1]["seq"].as_u64().unwrap() - 5;
    let cut = whole
        .iter()
        .find(|r| r["type"] == "frame" && r["seq"] == seq);
    let end = cut.unwrap()["t_ns"].as_u64().unwrap() + offset;
    let records = records("ended", &until(&vcd, end + 2_000), ONE);
    let said: Vec<&Value> = talk(&records).collect();
    assert_eq!(said[0], second[0]);
    assert_eq!(said.len(), 2, "{said:?}");
    assert_eq!(said[1]["fault"], "cut", "{said:?}");
    assert_eq!(said[1]["t_ns"], t_ns);
    assert_eq!(said[1]["addr"], 0x79);
    assert!(said[1].get("value").is_none(), "{said:?}");
    // One frame in which nobody answers.
    let (outcomes, vcd) = recorded(
        &format!("no-ack=0.004,seed=5,frame={ONE}"),
        &[Access::Read {
            slave: 0,
            address: 0x40,
            count: 64,
        }; 3],
        20,
    );
    let records = self::records("no-ack", &vcd, ONE);
    let aborted = talk(&records).filter(|r| r["fault"] == "no-ack").count();
    assert!(aborted > 0, "nothing was cut");
    let ok = talk(&records).filter(|r| r["ok"] == true).count();
    let bytes: usize = outcomes.iter().map(|o| o.bytes.as_slice().len()).sum();
    println!("{aborted} accesses were cut, {ok} of {bytes} bytes heard");
    assert!(ok <= bytes, "{ok} {bytes}");
}

/// CDM and CDS of each frame of much traffic.
fn bits(rng: &mut Rng, accesses: usize) -> Vec<(bool, bool)> {
    let config = format!("seed={},slaves=each,frame={ONE}+{ONE}", rng.u32(..));
    let accesses: Vec<Access> = (0..accesses).map(|_| any_access(rng, 2)).collect();
    let (_, vcd) = recorded(&config, &accesses, 20);
    let frame = format!("{ONE}+{ONE}");
    let (rows, ..) = read("bits", &vcd, &frame, "-o json -v -q");
    drop(rows);
    let mut slicer = biss::slice::Slicer::new(40_000);
    let (mut t_ns, mut ma, mut slo) = (0u64, true, true);
    for line in vcd.lines().skip_while(|line| !line.starts_with('#')) {
        match line.strip_prefix('#') {
            Some(t) => {
                slicer.push(t_ns, ma, Some(slo));
                t_ns = t.parse().unwrap();
            }
            None if line.ends_with('m') => ma = line.starts_with('1'),
            None => slo = line.starts_with('1'),
        }
    }
    slicer.push(t_ns, ma, Some(slo));
    slicer.finish(t_ns + 100_000);
    let protocol = biss::frame::BissC::new(frame.parse().unwrap());
    let (mut trace, mut cycle) = Default::default();
    let mut bits = Vec::new();
    while slicer.take(&mut trace) {
        biss::protocol::Protocol::decode(&protocol, &trace, &mut cycle);
        if let (Some(cdm), Some(head)) = (trace.cdm, cycle.head()) {
            bits.push((cdm, head.cds));
        }
    }
    bits
}

fn heard(bits: impl Iterator<Item = Option<(bool, bool)>>) -> Vec<Heard> {
    let mut listener = Listener::new();
    let rest = std::iter::repeat_n(Some((false, false)), REST_FRAMES.into());
    rest.chain(bits)
        .enumerate()
        .filter_map(|(frame, bits)| match bits {
            Some((cdm, cds)) => listener.frame(frame as u64, cdm, cds),
            None => listener.lost(),
        })
        .collect()
}

/// What was said and is right in all there is to check.
fn good(heard: &[Heard]) -> impl Iterator<Item = Spoken> {
    let good = heard.iter().filter(|heard| match heard.spoken {
        Spoken::BadHeader { .. } => false,
        Spoken::Command { executed, .. } => executed && heard.failure().is_none(),
        _ => heard.failure().is_none(),
    });
    good.map(|heard| heard.spoken)
}

/// A byte and its CRC are 12 bits, a header 15: errors of one and two bits never pass, of more one in sixteen at most. R, W
/// and S have none, but an echo.
#[test]
fn flipped_bits_make_no_register() {
    let mut rng = rng();
    let bits = bits(&mut rng, 60);
    let clean = heard(bits.iter().copied().map(Some));
    let sent: HashSet<String> = good(&clean).map(|spoken| format!("{spoken:?}")).collect();
    assert!(sent.len() > 30, "{}", sent.len());
    for (one_in, lost) in [(1_000, 0.0), (100, 0.0), (30, 0.0), (200, 0.002)] {
        let (mut right, mut wrong, mut bad) = (0u64, 0u64, 0u64);
        for _ in 0..size(60) {
            let mut flip = |bit: bool| bit != (rng.u32(..one_in) == 0);
            let flipped: Vec<(bool, bool)> = bits.iter().map(|b| (flip(b.0), flip(b.1))).collect();
            let noisy = flipped
                .into_iter()
                .map(|bits| (rng.f64() >= lost).then_some(bits));
            let heard = heard(noisy.collect::<Vec<_>>().into_iter());
            for spoken in good(&heard) {
                match sent.contains(&format!("{spoken:?}")) {
                    true => right += 1,
                    false => wrong += 1,
                }
            }
            let crc = |heard: &&Heard| {
                matches!(heard.spoken, Spoken::Bad { .. } | Spoken::BadHeader { .. })
            };
            bad += heard.iter().filter(crc).count() as u64;
        }
        println!(
            "1 bit in {one_in} flipped, {lost} of frames lost: {right} right, {wrong} wrong, {bad} with a bad CRC"
        );
        assert!(wrong <= 2 + bad / 15, "{wrong} of {bad}");
    }
}

/// Noise that is no talk at all. Of a broadcast only the header has a CRC, and nobody answers it.
#[test]
fn noise_is_no_register() {
    let mut rng = rng();
    let (mut claims, mut registers, mut commands) = (0, 0, 0);
    let frames = size(400_000);
    for ones in [2, 4, 8, 16, 32] {
        for cds in [0, 2, 16] {
            let bits = (0..frames).map(|_| {
                let cdm = rng.u32(..ones) == 0;
                Some((cdm, cds > 0 && rng.u32(..cds) == 0))
            });
            let heard = heard(bits.collect::<Vec<_>>().into_iter());
            let claim = |heard: &&Heard| !matches!(heard.spoken, Spoken::BadHeader { .. });
            claims += heard.iter().filter(claim).count();
            for spoken in good(&heard) {
                match spoken {
                    Spoken::Command { slaves: 0, .. } => commands += 1,
                    _ => registers += 1,
                }
            }
        }
    }
    let all = 15 * frames;
    println!(
        "{all} frames of noise: {claims} headers with a good CRC; all right in {commands} broadcasts and {registers} others"
    );
    assert!(registers <= 1 && commands <= 5 + all / 500_000);
}

/// What a listener makes of these bits behind a rest, CDM and CDS, with frames that are lost.
fn listened(cdm: &str, cds: &str, lost: Option<usize>) -> Vec<Heard> {
    let bits = cdm.chars().zip(cds.chars()).enumerate();
    let bits = bits.map(|(at, (cdm, cds))| (Some(at) != lost).then_some((cdm == '1', cds == '1')));
    heard(bits.collect::<Vec<_>>().into_iter())
}

/// 0x4D is read from register 0x78 of slave 0: as MB4 and TI have it.
const READ: [&str; 2] = [
    "110001111000010110100000000000000",
    "010000000000000001010100110111000",
];

#[test]
fn a_listener_checks_as_a_master_does() {
    let [cdm, cds] = READ;
    let with = |places: &[usize]| -> String {
        let flip = |(at, bit): (usize, char)| match (places.contains(&at), bit) {
            (false, bit) => bit,
            (true, '0') => '1',
            (true, _) => '0',
        };
        cds.chars().enumerate().map(flip).collect()
    };
    let address = 0x78;
    for (flipped, want) in [
        (vec![], None),
        (vec![1], Some(Failure::Unheard)),
        (vec![1, 2], Some(Failure::Garbled { idl: 2 })),
        (vec![3], Some(Failure::Garbled { idl: 5 })),
        (vec![0], Some(Failure::OutOfStep)),
        (vec![12], Some(Failure::OutOfStep)),
        (vec![16], Some(Failure::OutOfStep)),
        (vec![18], Some(Failure::Refused { address })),
        (vec![17], Some(Failure::NoReaction { address })),
        (
            vec![17, 18],
            Some(Failure::Strange {
                address,
                r: false,
                w: true,
            }),
        ),
        (
            vec![31],
            Some(Failure::DataCrc {
                address,
                got: 0xD,
                want: 0xC,
            }),
        ),
    ] {
        let heard = listened(cdm, &with(&flipped), None);
        let failures: Vec<_> = heard.iter().map(Heard::failure).collect();
        assert_eq!(failures, [want], "{flipped:?}");
    }
}

#[test]
fn waiting_is_counted() {
    let [cdm, cds] = READ;
    for busy in 0..5usize {
        let late = |bits: &str, bit: &str| {
            let (before, after) = bits.split_at(19);
            format!("{before}{}{after}", bit.repeat(busy))
        };
        let heard = listened(&late(cdm, "1"), &late(cds, "0"), None);
        let [heard] = heard[..] else {
            panic!("{heard:?}")
        };
        assert_eq!(heard.failure(), None);
        assert_eq!(
            (heard.busy as usize, heard.frames as usize),
            (busy, 33 + busy)
        );
        // A frame is a nanosecond here.
        assert_eq!(heard.waited_ns as usize, busy + 1);
        assert_eq!(heard.t_ns, u64::from(REST_FRAMES));
    }
}

/// What was under way when a frame was lost is said as far as it is known, and nothing is heard of the rest.
#[test]
fn a_lost_frame_ends_what_is_under_way() {
    let [cdm, cds] = READ;
    for lost in 0..cdm.len() {
        let spoken: Vec<Spoken> = listened(cdm, cds, Some(lost))
            .iter()
            .map(|heard| heard.spoken)
            .collect();
        let cut = Spoken::Cut {
            slave: 0,
            address: 0x78,
            write: false,
        };
        match lost {
            0..=17 => assert_eq!(spoken, [], "{lost}"),
            _ => assert_eq!(spoken, [cut], "{lost}"),
        }
    }
    let cdm = format!("1{}00000001", wire::command(&[0], 2));
    let cds = "0100000000000000010000000";
    for lost in 0..cdm.len() {
        let failures: Vec<_> = listened(&cdm, cds, Some(lost))
            .iter()
            .map(Heard::failure)
            .collect();
        match lost {
            0..=16 => assert_eq!(failures, [], "{lost}"),
            17..=23 => assert_eq!(failures, [Some(Failure::Cut)], "{lost}"),
            _ => assert_eq!(failures, [Some(Failure::Undecided)], "{lost}"),
        }
    }
}

/// Masters that do what ours never does.
#[test]
fn a_master_that_checks_nothing_is_told_on() {
    let all = "0000000000000000000000000000000";
    let header = format!("1{}", wire::command(&[0], 2));
    let broken = format!("1{}", wire::register(0, 0x78));
    let broken = format!(
        "{}{}",
        &broken[..15],
        if broken.ends_with('1') { '0' } else { '1' }
    );
    for (name, knobs, cdm, fault, text) in [
        (
            "executed",
            "",
            format!("{header}00000001"),
            None,
            "command 10  slave 0  acknowledged and executed",
        ),
        (
            "left",
            "",
            format!("{header}00000000"),
            Some("not-executed"),
            "command 10  slave 0  fault not-executed: the master did not send the bit that executes it",
        ),
        (
            "forced",
            "ida-wrong=1,",
            format!("{header}00000001"),
            Some("acknowledge"),
            "command 10  slave 0  fault acknowledge: acknowledged by no slave, it was for slave 0, and executed all the same",
        ),
        (
            "broadcast",
            "",
            format!("1{}1", wire::command(&[], 2)),
            None,
            "command 10  all slaves  sent",
        ),
        (
            "header",
            "",
            format!("{broken}101"),
            Some("header-crc"),
            "control frame  fault header-crc: the header does not fit its CRC: a bit error, or the master has given it up",
        ),
        (
            "absent",
            "",
            format!("1{}1011", wire::register(1, 0x78)),
            Some("absent"),
            "slave 1  read 0x78  fault absent: no slave with ID 1: only ID 0 is there",
        ),
    ] {
        let vcd = recorder::dictated(&format!("{knobs}frame={ONE}"), &format!("{cdm}{all}"));
        let records = records(name, &vcd, ONE);
        let said: Vec<&Value> = talk(&records).collect();
        assert_eq!(said.len(), 1, "{name}: {said:?}");
        assert_eq!(said[0]["fault"].as_str(), fault, "{name}");
        assert_eq!(said[0]["ok"], fault.is_none(), "{name}");
        let (stdout, ..) = read(name, &vcd, ONE, "-t none -q");
        let lines: Vec<&str> = stdout
            .lines()
            .filter(|line| !line.starts_with("pos"))
            .collect();
        assert_eq!(lines, [text], "{name}");
    }
}
