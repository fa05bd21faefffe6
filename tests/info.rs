//! `biss info`, `-f auto` and registers beside frames, as a user types them.
#![allow(clippy::unwrap_used)]

mod common;

use common::{biss, json, run, texts};
use serde_json::Value;

fn info(link: &str) -> (Vec<Value>, String, Option<i32>) {
    let (stdout, stderr, status) = texts(biss(&["info", link, "-o", "json"]).output().unwrap());
    (json(&stdout), stderr, status)
}

/// The last record: all slaves together.
fn line(link: &str) -> (Value, String, Option<i32>) {
    let (mut records, stderr, status) = info(link);
    (records.pop().unwrap_or(Value::Null), stderr, status)
}

fn field<'a>(slave: &'a Value, name: &str) -> &'a Value {
    let fields = slave["fields"].as_array().unwrap();
    fields.iter().find(|field| field["name"] == name).unwrap()
}

/// iC-Haus AN22: the registers of a real iC-MHM.
#[test]
fn an_ic_mhm_says_who_it_is() {
    let (records, stderr, status) = info("sim:device=mhm");
    assert_eq!((records.len(), stderr.as_str(), status), (2, "", Some(0)));
    let slave = &records[0];
    assert_eq!(slave["dev_id"], "4d484d234400");
    assert_eq!(slave["dev_id_text"], "MHM#D");
    assert_eq!(
        (&slave["mfr_id"], &slave["mfr"]),
        (&0x6943.into(), &"iC-Haus".into())
    );
    assert_eq!(slave.get("dev_sn"), None, "FF FF FF FF is none");
    assert_eq!(
        (&slave["profile"], &slave["data_bits"]),
        (&"BP3".into(), &30.into())
    );
    let bp_id = field(slave, "BP_ID");
    assert_eq!(
        (&bp_id["addr"], &bp_id["raw"]),
        (&0x42.into(), &"621E".into())
    );
    let all = &records[1];
    assert_eq!(
        (&all["slaves"], &all["channels"]),
        (&1.into(), &serde_json::json!([0]))
    );
    assert_eq!(all["frame"], "mt12,st16,nE,nW,crc6");
    assert_eq!(all["tried"][0]["good"], all["tried"][0]["frames"]);
}

/// Each slave by its own registers; the farthest is 0, and the nearest one's channel comes first.
#[test]
fn a_chain_is_asked_slave_by_slave() {
    let chain = "mt12,st20,nE,nW,crc6+st14,nE,nW,crc5+pos32,nE,nW,crc8+data9,crc4";
    let (records, stderr, status) = info(&format!("sim:slaves=each,frame={chain}"));
    assert_eq!((stderr.as_str(), status), ("", Some(0)));
    let ids: Vec<_> = records.iter().filter_map(|r| r["slave"].as_u64()).collect();
    assert_eq!(ids, [0, 1, 2, 3]);
    let serials: Vec<_> = records
        .iter()
        .filter_map(|r| r["dev_sn"].as_u64())
        .collect();
    assert!(
        serials.windows(2).all(|pair| pair[0] != pair[1]),
        "{serials:?}"
    );
    let all = records.last().unwrap();
    assert_eq!(all["frame"], chain);
    assert_eq!(all["channels"], serde_json::json!([3, 2, 1, 0]));
}

/// What the simulated encoder says of itself is found out again, whatever it sends.
#[test]
fn auto_reads_what_the_registers_say() {
    for frame in [
        "mt12,st20,nE,nW,crc6",
        "st26,nE,nW,crc6",
        "pos32,nE,nW,crc6",
        "mt4,st12,nE,nW,crc8",
        "mt12,st24,nE,nW,crc6+mt12,st24,nE,nW,lc6,crc16",
        "st18,nE,nW,crc6+data16,crc5",
        "st12,nE,nW,crc6:0x43:init=0x5",
    ] {
        for slaves in ["", "slaves=each,"] {
            let link = format!("sim:{slaves}frame={frame}");
            let args = ["read", &link, "-f", "auto", "-n", "5", "-o", "json"];
            let (stdout, stderr, status) = texts(biss(&args).output().unwrap());
            assert_eq!(status, Some(0), "{link}: {stderr}");
            assert!(
                stderr.contains(&format!("-f {frame}\n")),
                "{link}: {stderr}"
            );
            let channels = frame.split('+').count();
            let records = json(&stdout);
            assert_eq!(records.len(), 5 * channels);
            for (index, record) in records.iter().enumerate() {
                let slave = match slaves {
                    "" => 0,
                    _ => channels - 1 - index % channels,
                };
                assert_eq!(
                    (&record["ok"], &record["slave"]),
                    (&true.into(), &slave.into())
                );
            }
        }
    }
}

/// The same positions as with the format written down.
#[test]
fn auto_changes_nothing_about_the_positions() {
    let (by_hand, _, _) = run("read sim:motion=still,pos=70000 -n 2 -F turn,pos,error,crc");
    let (found, _, _) =
        run("read sim:motion=still,pos=70000 -n 2 -F turn,pos,error,crc -f auto -q");
    assert_eq!(by_hand, found);
    assert!(found.contains("70000"));
}

#[test]
fn the_bank_is_restored_or_not_even_touched() {
    // The knob makes every bank but the selected one unreadable for a master that may not select.
    let (all, stderr, status) = {
        let args = ["info", "sim", "--no-write", "-o", "json"];
        let (stdout, stderr, status) = texts(biss(&args).output().unwrap());
        (json(&stdout), stderr, status)
    };
    assert_eq!(status, Some(0));
    assert!(
        stderr.contains("in bank 2") && stderr.contains("--no-write"),
        "{stderr}"
    );
    assert_eq!(all[1]["left_out"][0]["bank"], 2);
    let banks: Vec<_> = all[0]["fields"]
        .as_array()
        .unwrap()
        .iter()
        .filter_map(|f| f.get("bank"))
        .collect();
    assert!(banks.is_empty(), "{banks:?}");
    // BP_ID alone suggests a frame without turns.
    assert_eq!(all[1]["frame"], "st32,nE,nW,crc6");
    assert!(!all[1]["doubts"].as_array().unwrap().is_empty());
}

#[test]
fn what_cannot_be_known_is_said() {
    let (_, stderr, status) = line("sim:device=none");
    assert_eq!(status, Some(1));
    assert!(stderr.contains("no slave took an ID"), "{stderr}");
    let (_, stderr, status) = line("sim:stuck=1");
    assert_eq!(status, Some(1));
    assert!(stderr.contains("none answers: no-ack"), "{stderr}");
    // Registers that say nothing are an answer, but no frame.
    let (all, stderr, status) = line("sim:refuse=0x41..0x43");
    assert_eq!((all.get("frame"), status), (None, Some(0)));
    assert!(
        stderr.contains("slave 0 do not say what it sends"),
        "{stderr}"
    );
    // Nine slaves, eight of which have an ID.
    let nine = "st8,crc6+st8,crc6+st8,crc6+st8,crc6+st8,crc6+st8,crc6+st8,crc6+st8,crc6";
    let (all, stderr, status) = line(&format!("sim:slaves=0:1:1:1:1:1:1:1:1,frame={nine}"));
    assert_eq!(
        (&all["slaves"], all.get("frame"), status),
        (&9.into(), None, Some(0))
    );
    assert!(stderr.contains("more than eight slaves"), "{stderr}");
    // The encoder does not send what its registers say.
    let args = "read sim:device=mhm,frame=st20,nE,nW,crc6 -f auto";
    let (stdout, stderr, status) = run(args);
    assert_eq!((stdout.as_str(), status), ("", Some(1)));
    assert!(stderr.contains("no frame fits"), "{stderr}");
    let (_, stderr, status) = run("info sim:device=mhm,frame=st20,nE,nW,crc6");
    assert_eq!(status, Some(1), "{stderr}");
}

#[test]
fn nothing_is_asked_where_nothing_can_be_sent() {
    for (args, words) in [
        ("info spi:0.0", "wave:0.0"),
        ("read spi:0.0 -f auto", "wave:0.0"),
        ("read spi:0.0 -f st12,crc6 --registers 0x42", "wave:0.0"),
        ("info file:x.vcd", "recording"),
        ("read file:x.vcd -f auto", "recording"),
        ("read sim --registers 0x42 -o csv", "--registers"),
        ("read sim --registers 0x42 -F pos", "--registers"),
        ("read sim --registers 0x80", "0x7f"),
        ("read sim --slave 1", "--registers"),
        ("info sim:frame=auto", "auto"),
    ] {
        let (stdout, stderr, status) = run(args);
        assert_eq!((stdout.as_str(), status), ("", Some(2)), "{args}: {stderr}");
        assert!(stderr.contains(words), "{args}: {stderr}");
    }
}

/// Frames go on while registers are read: none is lost, and none comes twice.
#[test]
fn registers_come_between_frames() {
    let count = "sim:motion=count,pos=5,frame=st20,nE,nW,crc6";
    let args = format!("read {count} --registers 0x78..0x7b,0x70,0x42 -n 200 -o json");
    let (stdout, _, status) = run(&args);
    // 0x70 is refused, and everything else is there.
    assert_eq!(status, Some(1));
    let records = json(&stdout);
    let (registers, frames): (Vec<_>, Vec<_>) = records.iter().partition(|r| r["type"] == "reg");
    assert_eq!(frames.len(), 200);
    let first = frames[0]["pos"].as_u64().unwrap();
    for (index, frame) in frames.iter().enumerate() {
        assert_eq!(frame["pos"], first + index as u64);
        assert_eq!(frame["seq"], index);
    }
    let seen = |address: u64| registers.iter().find(|r| r["addr"] == address).unwrap();
    for (address, value) in (0x78..).zip(*b"BISS") {
        assert_eq!(seen(address)["value"], value);
    }
    assert_eq!(seen(0x70)["fault"], "refused");
    assert_eq!(seen(0x42)["value"], 0x62);
    // Alone, they end with the first round.
    let (stdout, _, status) = run("read sim --registers 0x78,0x7a -o json");
    let records = json(&stdout);
    assert_eq!(status, Some(0));
    assert_eq!(records.last().unwrap()["addr"], 0x7A);
    let frames = records.iter().filter(|r| r["type"] == "frame").count();
    assert!((66..=80).contains(&frames), "{frames}");
}

/// Of a busy slave, what S had to be repeated for is believed only when it comes again.
#[test]
fn a_byte_that_was_waited_for_comes_twice_before_it_counts() {
    let busy = "sim:reg-busy=300us,motion=count,frame=st20,nE,nW,crc6";
    let (stdout, _, status) = run(&format!(
        "read {busy} --registers 0x78..0x79 -o json -n 400"
    ));
    assert_eq!(status, Some(0));
    let records = json(&stdout);
    let values: Vec<_> = records.iter().filter(|r| r["type"] == "reg").collect();
    assert!(!values.is_empty());
    for register in values {
        let want = b"BI"[register["addr"].as_u64().unwrap() as usize - 0x78];
        assert_eq!(register["value"], want);
    }
}

/// An encoder that stands still shows the same frame again and again.
#[test]
fn a_position_that_does_not_move_confirms_little() {
    let (all, _, status) = line("sim:motion=still,pos=5");
    assert_eq!(
        (&all["frame"], status),
        (&"mt12,st20,nE,nW,crc6".into(), Some(0))
    );
    let doubts = all["doubts"].to_string();
    assert!(doubts.contains("move the encoder"), "{doubts}");
    let (_, stderr, _) = run("read sim:motion=still,pos=5 -f auto");
    assert!(stderr.contains("move the encoder"), "{stderr}");
    let (all, _, _) = line("sim");
    assert_eq!(all.get("doubts"), None);
}

#[test]
fn text_marks_what_is_doubtful() {
    let (stdout, stderr, status) = run("info sim");
    assert_eq!((stderr.as_str(), status), ("", Some(0)));
    assert!(
        stdout.contains("  0x78  DEV_ID    42 49 53 53 49 4D  \"BISSIM\"\n"),
        "{stdout}"
    );
    assert!(
        stdout.contains("? with or without the constant term: not published"),
        "{stdout}"
    );
    assert!(stdout.contains("frame mt12,st20,nE,nW,crc6\n"), "{stdout}");
    assert!(
        stdout.contains("  confirmed by 16 of 16 frames\n"),
        "{stdout}"
    );
    assert!(!stdout.contains("not used"), "{stdout}");
    let (all, _, _) = run("info sim -v");
    assert!(all.contains("not used") && all.lines().count() > stdout.lines().count());
}

/// The registers speak of the first channel only, and the second one begins with a dozen zeros.
#[test]
fn a_channel_that_the_registers_do_not_speak_of_is_seen() {
    let chain = "mt14,st14,nE,nW,crc6+mt16,st23,nE,nW,crc6";
    for link in ["", "rpm=600,"] {
        let link = format!("sim:{link}device=mhm,frame={chain}");
        let (stdout, stderr, status) = run(&format!("read {link} -f auto"));
        assert_eq!((stdout.as_str(), status), ("", Some(1)), "{stderr}");
        assert!(stderr.contains("no frame fits"), "{stderr}");
    }
}

#[test]
fn every_key_is_explained() {
    let page = include_str!("../docs/output.md");
    let mut keys = std::collections::BTreeSet::new();
    fn collect(value: &Value, keys: &mut std::collections::BTreeSet<String>) {
        match value {
            Value::Object(map) => map.iter().for_each(|(key, value)| {
                keys.insert(key.clone());
                collect(value, keys);
            }),
            Value::Array(list) => list.iter().for_each(|value| collect(value, keys)),
            _ => {}
        }
    }
    for args in [
        vec!["info", "sim", "-o", "json"],
        vec!["info", "sim:device=mhm,frame=st20,nE,nW,crc6", "-o", "json"],
        vec!["info", "sim:motion=still", "--no-write", "-o", "json"],
    ] {
        let (stdout, _, _) = texts(biss(&args).output().unwrap());
        json(&stdout)
            .iter()
            .for_each(|record| collect(record, &mut keys));
    }
    assert!(keys.len() > 20, "{keys:?}");
    for key in keys {
        assert!(page.contains(&format!("`{key}`")), "{key}");
    }
}

/// Every register is there at the end, however often the slave let itself be waited for.
#[test]
fn registers_are_all_there_before_it_ends() {
    for seed in 1..=40 {
        let args = format!(
            "read sim:reg-busy=0us..200us,seed={seed} --registers 0x78,0x79,0x7a -q -o json"
        );
        let (stdout, _, status) = run(&args);
        assert_eq!(status, Some(0), "{args}");
        let records = json(&stdout);
        for (address, value) in (0x78..).zip(*b"BIS") {
            let found = records.iter().find(|record| record["addr"] == address);
            assert_eq!(found.unwrap()["value"], value, "{args}");
        }
    }
}

/// A start bit that stands elsewhere in each frame is no reason to doubt the format.
#[test]
fn a_busy_time_that_wanders_hides_no_format() {
    for seed in 1..=10 {
        let (all, stderr, status) = line(&format!("sim:busy=0us..40us,seed={seed}"));
        assert_eq!(
            (&all["frame"], status),
            (&"mt12,st20,nE,nW,crc6".into(), Some(0)),
            "seed {seed}: {stderr}"
        );
    }
}
