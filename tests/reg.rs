//! `biss reg` and `biss command` as a user types them, on the simulated slave.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;

use common::{biss, json, run, texts};
use serde_json::Value;
use std::fs;
use std::io::Write;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// A folder of its own for each test, removed afterwards.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("biss-reg-{name}-{}", std::process::id()));
        fs::create_dir_all(&path).unwrap();
        Folder(path)
    }

    fn file(&self, name: &str) -> String {
        self.0.join(name).display().to_string()
    }

    fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(&self.0).unwrap();
        let mut names: Vec<String> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        drop(fs::remove_dir_all(&self.0));
    }
}

/// What an iC-MHM showed to an iC-Haus master (AN22, "BiSS Reader Content").
const MHM: &str = "     0  1  2  3  4  5  6  7  8  9  a  b  c  d  e  f    0123456789abcdef
00: 48 44 00 78 80 00 00 00 cf 80 00 00 23 00 00 00    HD.x?...??..#...
10: 00 00 00 8c -- -- -- -- -- -- -- -- -- -- -- --    ...?------------
20: -- -- -- -- -- -- -- -- -- -- -- -- -- -- -- --    ----------------
30: -- -- -- -- -- -- -- -- -- -- -- -- -- -- -- --    ----------------
40: 00 02 62 1e ff ff ff ff 00 00 00 00 00 00 8c ff    .?b?..........?.
50: ff ff ff ff ff ff ff ff ff ff ff ff ff ff ff ff    ................
60: ff ff ff ff ff ff ff ff ff ff ff ff ff ff ff ff    ................
70: 00 01 15 15 -- -- -- -- 4d 48 4d 23 44 00 69 43    .???----MHM#D.iC
";

#[test]
fn registers_are_read() {
    let (stdout, stderr, status) = run("reg sim:device=mhm read 0x78 0x7e..0x7f 5 0b1000000");
    let shown = "0x78  0x4d   77  M\n0x7e  0x69  105  i\n0x7f  0x43   67  C\n0x05  0x00    0\n0x40  0x00    0\n";
    assert_eq!(
        (stdout.as_str(), stderr.as_str(), status),
        (shown, "", Some(0))
    );

    let (stdout, stderr, status) = run("reg sim:device=mhm read 0x78 0x14 0x10 -o json");
    let shown = "\
{\"type\":\"reg\",\"slave\":0,\"addr\":120,\"ok\":true,\"value\":77}
{\"type\":\"reg\",\"slave\":0,\"addr\":20,\"ok\":false,\"fault\":\"refused\",\"detail\":\"the slave refuses register 0x14\"}
{\"type\":\"reg\",\"slave\":0,\"addr\":16,\"ok\":true,\"value\":0}
";
    assert_eq!((stdout.as_str(), status), (shown, Some(1)));
    assert!(
        stderr.contains("reading registers of slave 0: the slave refuses register 0x14\n  "),
        "{stderr}"
    );
    let (_, stderr, status) = run("reg sim:device=mhm read 0x14 -q");
    assert_eq!((stderr.as_str(), status), ("", Some(1)));
}

#[test]
fn a_dump_looks_like_i2cdump() {
    let (stdout, stderr, status) = run("reg sim:device=mhm dump");
    assert_eq!(
        (stdout.as_str(), stderr.as_str(), status),
        (MHM, "", Some(0))
    );
    let (stdout, _, status) = run("reg sim:device=mhm dump 0x72..0x81");
    assert_eq!((stdout.as_str(), status), ("", Some(2)));
    let (stdout, _, status) = run("reg sim:device=mhm dump 0x72..0x79");
    let shown = "     0  1  2  3  4  5  6  7  8  9  a  b  c  d  e  f    0123456789abcdef
70:       15 15 -- -- -- -- 4d 48                        ??----MH
";
    assert_eq!((stdout.as_str(), status), (shown, Some(0)));
    // What cannot be read is not refused, and its neighbours are read all the same.
    let (stdout, stderr, status) = run("reg sim:device=mhm,data-crc=5%,seed=5 --retries 0 dump");
    let cells = |text: &str| -> Vec<String> {
        let rows = text.lines().skip(1).map(|line| line[4..51].to_owned());
        rows.flat_map(|row| row.split(' ').map(str::to_owned).collect::<Vec<_>>())
            .collect()
    };
    let (read, known) = (cells(&stdout), cells(MHM));
    let failed = read.iter().filter(|cell| *cell == "XX").count();
    assert!((1..30).contains(&failed), "{stdout}");
    assert!(
        read.iter()
            .zip(&known)
            .all(|(cell, known)| cell == known || cell == "XX"),
        "{stdout}"
    );
    assert!(stderr.contains("came with CRC"), "{stderr}");
    assert_eq!(status, Some(1));
    // Where nothing can be read it is given up, and said of all.
    let (stdout, _, status) = run("reg sim:data-crc=1 --retries 0 dump -o json");
    let records = json(&stdout);
    assert_eq!((records.len(), status), (128, Some(1)));
    assert_eq!(records[2]["fault"], "data-crc");
    assert_eq!(records[127]["fault"], "not-tried");
}

/// The one promise, for registers: a noisy line costs time, or answers, and never shows a wrong value.
#[test]
fn no_value_is_shown_that_the_slave_did_not_send() {
    let mut rng = common::rng();
    let known: Vec<Value> = json(&run("reg sim:device=mhm dump -o json").0);
    let (mut read, mut failed) = (0, 0);
    for _ in 0..common::size(40) {
        let knob = *rng
            .choice(&[
                "data-crc=20%",
                "w-inverted=5%",
                "no-s=5%",
                "idl-wrong=5%",
                "stop-bit=20%",
                "cds-flip=0.3%",
            ])
            .unwrap();
        let link = format!("sim:device=mhm,{knob},seed={}", rng.u32(..));
        let (stdout, _, _) = run(&format!("reg {link} dump -o json --verify --retries 2"));
        let records = json(&stdout);
        assert_eq!(records.len(), known.len(), "{link}");
        for (record, known) in records.iter().zip(&known) {
            assert_eq!(
                record["ok"] == true,
                record.get("value").is_some(),
                "{record}"
            );
            assert_eq!(
                record["ok"] == false,
                record.get("fault").is_some(),
                "{record}"
            );
            if record["ok"] == true {
                assert_eq!(record["value"], known["value"], "{link}: {record}");
                read += 1;
            } else {
                failed += 1;
            }
        }
    }
    println!("{read} values, {failed} without");
    assert!(read > 100);
}

#[test]
fn writes_show_old_and_new() {
    let (stdout, stderr, status) = run("reg sim write 0x10=0x5a 0x11=1,2 0x50=255");
    let shown = "0x10  0x00 -> 0x5a\n0x11  0x00 -> 0x01\n0x12  0x00 -> 0x02\n0x50  0x00 -> 0xff\n";
    assert_eq!(
        (stdout.as_str(), stderr.as_str(), status),
        (shown, "", Some(0))
    );
    // In their order, the second after the first.
    let (stdout, _, status) = run("reg sim write 0x10=1 0x10=2 -o json");
    let shown = "\
{\"type\":\"reg\",\"slave\":0,\"addr\":16,\"ok\":true,\"value\":1,\"old\":0}
{\"type\":\"reg\",\"slave\":0,\"addr\":16,\"ok\":true,\"value\":2,\"old\":1}
";
    assert_eq!((stdout.as_str(), status), (shown, Some(0)));
    // A bank that was selected by hand shows its own registers, and stays.
    let (stdout, stderr, status) = run("reg sim write 0x10=7 0x40=4 0x10=8");
    let shown = "0x10  0x00 -> 0x07\n0x40  0x00 -> 0x04\n0x10  0x00 -> 0x08\n";
    assert_eq!((stdout.as_str(), status), (shown, Some(0)));
    assert!(
        stderr.starts_with("biss: bank 4 stays selected"),
        "{stderr}"
    );
    let (stdout, stderr, status) = run("reg sim --bank 5 write 0x10=7 -o json");
    let shown =
        "{\"type\":\"reg\",\"slave\":0,\"bank\":5,\"addr\":16,\"ok\":true,\"value\":7,\"old\":0}\n";
    assert_eq!(
        (stdout.as_str(), stderr.as_str(), status),
        (shown, "", Some(0))
    );
}

#[test]
fn a_write_that_fails_says_what_was_written() {
    let (stdout, stderr, status) = run("reg sim:read-only=0x12 write 0x10=1,2,3,4 0x20=5");
    let shown = "\
0x10  0x00 -> 0x01
0x11  0x00 -> 0x02
0x12  0x00  fault refused: the slave refuses register 0x12
0x13  0x00  fault not-tried: left out after what went wrong before
0x20  --  fault not-tried: left out after what went wrong before
";
    assert_eq!((stdout.as_str(), status), (shown, Some(1)));
    let said: Vec<&str> = stderr.lines().collect();
    assert!(
        said[0].starts_with("biss: writing registers of slave 0: the slave refuses register 0x12")
    );
    assert!(said[1].contains("read-only"), "{stderr}");
    assert_eq!(
        said[2..],
        [
            "biss: written: 0x10..0x11",
            "biss: not written: 0x12..0x13, 0x20"
        ]
    );
    let (stdout, _, status) = run("reg sim:read-only=0x12 write 0x11=1,2 0x20=5 -o json");
    let records = json(&stdout);
    assert_eq!((records.len(), status), (3, Some(1)));
    let ok: Vec<&Value> = records.iter().map(|record| &record["ok"]).collect();
    assert_eq!(ok, [true, false, false]);
    assert_eq!(
        (&records[1]["want"], &records[1]["value"]),
        (&Value::from(2), &Value::from(0))
    );
    assert_eq!(
        (&records[2]["want"], &records[2]["fault"]),
        (&Value::from(5), &Value::from("not-tried"))
    );

    // Echoed, and not kept.
    let (stdout, stderr, status) = run("reg sim:write-lost=1 write 0x10=1");
    assert_eq!(status, Some(1));
    assert!(
        stdout.starts_with("0x10  0x00  fault read-back: "),
        "{stdout}"
    );
    assert!(stderr.contains("--unchecked"), "{stderr}");
    let (stdout, stderr, status) = run("reg sim:write-lost=1 write 0x10=1 --unchecked");
    assert_eq!(
        (stdout.as_str(), stderr.as_str(), status),
        ("0x10  0x00 -> 0x01\n", "", Some(0))
    );
    // Kept, and not echoed: it fails, but nobody is told that the register is as it was.
    let (stdout, stderr, status) = run("reg sim:echo-wrong=1 write 0x10=1 0x20=2");
    assert_eq!(status, Some(1));
    assert!(stdout.starts_with("0x10  0x01  fault echo: "), "{stdout}");
    assert!(
        stderr.ends_with("biss: written: 0x10\nbiss: not written: 0x20\n"),
        "{stderr}"
    );
    // A slave of the old kind refuses by silence.
    let (_, stderr, status) = run("reg sim:refusal=silent,read-only=0x11 write 0x10=1,2");
    assert_eq!(status, Some(1));
    assert!(
        stderr.contains("older slaves refuse a write so"),
        "{stderr}"
    );
    assert!(
        stderr.ends_with("biss: written: 0x10\nbiss: not written: 0x11\n"),
        "{stderr}"
    );
}

#[test]
fn whoever_is_not_there_is_named() {
    for (link, fault, words) in [
        (
            "sim:stuck=1",
            "no-ack",
            "looking for an encoder: none answers: no-ack",
        ),
        (
            "sim:stuck=0",
            "not-ready",
            "looking for an encoder: none answers: not-ready",
        ),
        ("sim:device=none", "unheard", "BiSS-C unidirectional"),
        ("sim:cds=0", "unheard", "activate-control --broadcast"),
        ("sim:idl-wrong=1", "unheard", "took an ID"),
        (
            "sim --slave 1",
            "absent",
            "no slave with ID 1: only ID 0 is there",
        ),
        (
            "sim:slaves=each,frame=st12,crc6+st12,crc6 --slave 2",
            "absent",
            "no slave with ID 2: IDs 0 to 1 are there",
        ),
    ] {
        for verb in ["read 0x10..0x11", "write 0x10=1,2"] {
            let (stdout, stderr, status) = run(&format!("reg {link} {verb} -o json"));
            assert_eq!(status, Some(1), "{link}: {stderr}");
            assert!(stderr.contains(words), "{link}: {stderr}");
            assert!(
                stderr.lines().any(|line| line.starts_with("  ")),
                "what to try: {stderr}"
            );
            let records = json(&stdout);
            assert_eq!(records.len(), 2, "{link}: {stdout}");
            assert_eq!(records[0]["fault"], fault, "{link}: {stdout}");
            assert_eq!(records[0]["ok"], false);
            let written = stderr.contains("not written: 0x10..0x11");
            assert_eq!(written, verb.starts_with("write"), "{stderr}");
        }
        let (stdout, _, status) = run(&format!("reg {link} dump"));
        assert_eq!((stdout.as_str(), status), ("", Some(1)), "{link}");
    }
    let (stdout, _, status) =
        run("reg sim:slaves=each,frame=st12,crc6+st12,crc6 --slave 1 read 0x44..0x47 -o json");
    let records = json(&stdout);
    assert!(
        records
            .iter()
            .all(|record| record["slave"] == 1 && record["ok"] == true)
    );
    assert_eq!((records.len(), status), (4, Some(0)));
}

#[test]
fn banks_are_selected() {
    let (stdout, _, status) = run("reg sim:device=mhm --bank 2 read 0x01 0x40 -o json");
    let records = json(&stdout);
    assert_eq!(
        (&records[0]["bank"], &records[0]["value"]),
        (&Value::from(2), &Value::from(1))
    );
    assert_eq!(
        (records[1].get("bank"), &records[1]["value"], status),
        (None, &Value::from(2), Some(0))
    );
    // A dump says which bank it shows.
    let (stdout, _, _) = run("reg sim dump -o json");
    let banks = json(&stdout)
        .iter()
        .filter(|record| record["bank"] == 0)
        .count();
    assert_eq!(banks, 0x40);
    // A slave without banks, and one that does not take this one.
    let (_, stderr, status) = run("reg sim:refuse=0x40 --bank 1 read 0");
    assert_eq!(status, Some(1));
    assert!(
        stderr.contains("selecting bank 1 of slave 0") && stderr.contains("only one bank"),
        "{stderr}"
    );
    let (_, _, status) = run("reg sim:refuse=0x40 --bank 0 read 0");
    assert_eq!(status, Some(0));
    let (_, stderr, status) = run("reg sim:read-only=0x40 --bank 1 read 0");
    assert_eq!(status, Some(1));
    assert!(stderr.contains("selecting bank 1 of slave 0"), "{stderr}");
    let (_, stderr, status) = run("reg sim:write-lost=1 --bank 1 read 0");
    assert_eq!(status, Some(1));
    assert!(stderr.contains("does not select that bank"), "{stderr}");
}

#[test]
fn a_bank_goes_into_a_file_and_back() {
    let folder = Folder::new("bank");
    let file = folder.file("mhm.bank");
    let (stdout, stderr, status) = run(&format!("reg sim:device=mhm save -w {file}"));
    assert_eq!((stdout.as_str(), status), ("", Some(0)));
    assert_eq!(
        stderr,
        format!("biss: 20 registers saved in {file}, 44 refused\n")
    );
    let shown = "\
# Registers of a BiSS-C slave; `biss reg LINK load FILE` writes them back
biss-registers 1
slave 0
device 4d 48 4d 23 44 00
manufacturer 69 43
bank 0
0x00: 48 44 00 78 80 00 00 00 cf 80 00 00 23 00 00 00
0x10: 00 00 00 8c -- -- -- -- -- -- -- -- -- -- -- --
0x20: -- -- -- -- -- -- -- -- -- -- -- -- -- -- -- --
0x30: -- -- -- -- -- -- -- -- -- -- -- -- -- -- -- --
";
    assert_eq!(fs::read_to_string(&file).unwrap(), shown);
    assert_eq!(folder.names(), ["mhm.bank"]);
    assert_eq!(run("reg sim:device=mhm save -w -").0, shown);

    let load = |link: &str, more: &str| run(&format!("reg {link} load {file}{more}"));
    let (stdout, stderr, status) = load("sim:device=mhm", "");
    assert_eq!((stdout.as_str(), status), ("", Some(0)));
    assert_eq!(
        stderr,
        "biss: bank 0: all 20 registers are as in the file\n"
    );

    let edited = shown
        .replace("48 44 00 78", "48 45 01 78")
        .replace("00 00 00 8c", "00 00 00 8d");
    fs::write(&file, &edited).unwrap();
    let (stdout, stderr, status) = load("sim:device=mhm", " --dry-run");
    let differ = "0x01  0x44, the file has 0x45\n0x02  0x00, the file has 0x01\n0x13  0x8c, the file has 0x8d\n";
    assert_eq!((stdout.as_str(), status), (differ, Some(0)));
    assert_eq!(stderr, "biss: bank 0: 3 of 20 registers differ\n");
    let (stdout, _, status) = load("sim:device=mhm", "");
    let written = "0x01  0x44 -> 0x45\n0x02  0x00 -> 0x01\n0x13  0x8c -> 0x8d\n";
    assert_eq!((stdout.as_str(), status), (written, Some(0)));
    let (stdout, _, _) = load("sim:device=mhm", " -o json");
    let first =
        "{\"type\":\"reg\",\"slave\":0,\"bank\":0,\"addr\":1,\"ok\":true,\"value\":69,\"old\":68}";
    assert_eq!(stdout.lines().next(), Some(first));
    let (stdout, _, _) = load("sim:device=mhm", " -o json --dry-run");
    let first =
        "{\"type\":\"reg\",\"slave\":0,\"bank\":0,\"addr\":1,\"ok\":true,\"value\":68,\"want\":69}";
    assert_eq!(stdout.lines().next(), Some(first));

    // Halfway.
    let (stdout, stderr, status) = load("sim:device=mhm,read-only=0x02", "");
    assert_eq!(status, Some(1));
    assert!(
        stdout.starts_with("0x01  0x44 -> 0x45\n0x02  0x00  fault refused: "),
        "{stdout}"
    );
    assert!(
        stderr
            .ends_with("biss: written: 0x01 in bank 0\nbiss: not written: 0x02, 0x13 in bank 0\n"),
        "{stderr}"
    );
    // Echoed and lost: found when all is read again.
    let (stdout, stderr, status) = load("sim:device=mhm,write-lost=1", "");
    assert_eq!(status, Some(1));
    assert!(
        stdout
            .lines()
            .all(|line| line.contains("fault read-back: ")),
        "{stdout}"
    );
    assert!(
        stderr.ends_with("biss: not written: 0x01..0x02, 0x13 in bank 0\n"),
        "{stderr}"
    );
    // What cannot even be read: nothing is begun.
    let (stdout, stderr, status) = load("sim:device=mhm,refuse=0x13", "");
    assert_eq!(status, Some(1));
    assert_eq!(stdout.lines().count(), 3, "{stdout}");
    assert!(
        stderr.ends_with("biss: not written: 0x01..0x02, 0x13 in bank 0\n"),
        "{stderr}"
    );
}

#[test]
fn a_file_is_for_its_device() {
    let folder = Folder::new("device");
    let file = folder.file("a.bank");
    run(&format!("reg sim --bank 4..5 save -w {file} -q"));
    let (stdout, stderr, status) = run(&format!("reg sim:device=mhm load {file}"));
    assert_eq!((stdout.as_str(), status), ("", Some(2)));
    assert!(
        stderr.contains("device 42 49 53 53 49 4d") && stderr.contains("4d 48 4d 23 44 00"),
        "{stderr}"
    );
    assert!(stderr.contains("--force"), "{stderr}");
    let (_, stderr, status) = run(&format!("reg sim:device=mhm load {file} --force"));
    // Which has not these banks.
    assert_eq!(status, Some(1), "{stderr}");
    let (_, stderr, status) = run(&format!("reg sim load {file} --bank 5"));
    assert_eq!(
        (stderr.as_str(), status),
        (
            "biss: bank 5: all 64 registers are as in the file\n",
            Some(0)
        )
    );
    let (_, stderr, status) = run(&format!("reg sim load {file} --bank 6"));
    assert_eq!(status, Some(2));
    assert!(stderr.contains("there is 4, 5"), "{stderr}");

    // The slave is the file's, unless somebody says another.
    let chain = "sim:slaves=each,frame=st12,crc6+st12,crc6";
    run(&format!("reg {chain} --slave 1 save -w {file} -q"));
    let text = fs::read_to_string(&file).unwrap();
    assert!(text.contains("\nslave 1\n"), "{text}");
    fs::write(&file, text.replace("0x00: 00", "0x00: 77")).unwrap();
    for (option, slave) in [("", 1), (" --slave 0", 0)] {
        let (stdout, _, status) = run(&format!("reg {chain} load {file} -o json{option}"));
        let records = json(&stdout);
        assert_eq!((records.len(), status), (1, Some(0)));
        assert_eq!(records[0]["slave"], slave);
    }
}

#[test]
fn nothing_is_half_saved() {
    let folder = Folder::new("half");
    let file = folder.file("a.bank");
    fs::write(&file, "precious").unwrap();
    for link in ["sim:data-crc=1", "sim:stuck=1", "sim:device=none"] {
        let (stdout, stderr, status) = run(&format!("reg {link} --retries 1 save -w {file}"));
        assert_eq!((stdout.as_str(), status), ("", Some(1)), "{stderr}");
        assert_eq!(fs::read_to_string(&file).unwrap(), "precious");
    }
    let (_, stderr, status) = run(&format!("reg sim save -w {}", folder.file("none/a.bank")));
    assert_eq!(status, Some(2));
    assert!(
        stderr.starts_with("biss: writing ") && stderr.contains("\n  "),
        "{stderr}"
    );
    // A link goes on to be one.
    std::os::unix::fs::symlink(&file, folder.file("link.bank")).unwrap();
    let (_, _, status) = run(&format!("reg sim save -w {}", folder.file("link.bank")));
    assert_eq!(status, Some(0));
    assert!(
        fs::symlink_metadata(folder.file("link.bank"))
            .unwrap()
            .is_symlink()
    );
    assert!(
        fs::read_to_string(&file)
            .unwrap()
            .contains("biss-registers 1")
    );
    assert_eq!(folder.names(), ["a.bank", "link.bank"]);
    let (_, _, status) = run("reg sim save -w /dev/null");
    assert_eq!(status, Some(0));
}

#[test]
fn a_file_that_is_none_is_told_with_its_line() {
    let folder = Folder::new("wrong");
    let file = folder.file("a.bank");
    for (text, words) in [
        ("", ":1: the file ends where `biss-registers` should stand"),
        (
            "biss-registers 1\nslave 0\nwhat",
            ":3: `what` stands where `device` should",
        ),
    ] {
        fs::write(&file, text).unwrap();
        // Before the line is touched: there is no such chip.
        let (stdout, stderr, status) = run(&format!("reg gpio:99,ma=1,slo=2 load {file}"));
        assert_eq!((stdout.as_str(), status), ("", Some(2)));
        assert!(
            stderr.starts_with(&format!("biss: {file}{words}\n  ")),
            "{stderr}"
        );
    }
    let (_, stderr, status) = run(&format!("reg sim load {}", folder.file("none")));
    assert_eq!(status, Some(2));
    assert!(
        stderr.starts_with("biss: reading ") && stderr.contains("\n  "),
        "{stderr}"
    );
    // From a pipe.
    let text = run("reg sim save -w -").0;
    let mut child = biss(&["reg", "sim", "load", "-"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    child
        .stdin
        .take()
        .unwrap()
        .write_all(text.as_bytes())
        .unwrap();
    let (_, stderr, status) = texts(child.wait_with_output().unwrap());
    assert_eq!(status, Some(0), "{stderr}");
}

#[test]
fn the_link_stands_before_the_verb_or_in_the_environment() {
    let read = "0x78  0x42   66  B\n";
    for args in [
        "reg sim read 0x78",
        "reg sim --slave 0 read 0x78 -v",
        "reg --slave 0 sim read -q 0x78",
        "reg -c 500kHz sim read 0x78 --verify",
    ] {
        let (stdout, stderr, status) = run(args);
        assert_eq!(
            (stdout.as_str(), status),
            (read, Some(0)),
            "{args}: {stderr}"
        );
    }
    let with = |link: &str, args: &str| {
        let args: Vec<&str> = args.split(' ').collect();
        texts(biss(&args).env("BISS_LINK", link).output().unwrap())
    };
    assert_eq!(with("sim", "reg read 0x78").0, read);
    assert_eq!(
        with("sim:stuck=1", "reg sim read 0x78").0,
        read,
        "typed beats set"
    );
    for args in [
        "command 10 --slave 0",
        "command --slave 0 10",
        "command sim 10 --slave 0",
        "command --slave 0 sim 10",
    ] {
        let (stdout, stderr, status) = with("sim", args);
        let shown = "command 10  slave 0  acknowledged and executed\n";
        assert_eq!(
            (stdout.as_str(), status),
            (shown, Some(0)),
            "{args}: {stderr}"
        );
    }
    let (_, stderr, status) = with("sim", "command --slave 0");
    assert_eq!(status, Some(2));
    assert!(stderr.contains("<CODE>"), "{stderr}");
    let (_, stderr, status) = with("", "reg read 0x78");
    assert_eq!(status, Some(2));
    assert!(stderr.contains("<LINK>"), "{stderr}");
    let (_, stderr, status) = with("smi", "reg read 0x78");
    assert_eq!(status, Some(2));
    assert!(stderr.contains("from BISS_LINK"), "{stderr}");
    let (_, stderr, status) = run("reg read sim 0x78");
    assert_eq!(status, Some(2));
    assert!(stderr.contains("LINK stands before the verb"), "{stderr}");
}

#[test]
fn usage_is_checked_before_anything_is_opened() {
    for (args, words) in [
        ("reg sim", "requires a subcommand"),
        ("reg sim red 0", "similar subcommand exists: 'read'"),
        ("reg sim read", "ADDR"),
        ("reg sim read 0x80", "registers end at 0x7f"),
        ("reg sim read 5..4", "ends before it begins"),
        ("reg sim read 0x10=5", "no number"),
        ("reg sim write 0x10", "write it like 0x10=0x5a"),
        ("reg sim write 0x10=256", "values end at 0xff"),
        ("reg sim write 0x7f=1,2", "beyond register 0x7f"),
        ("reg sim --slave 8 read 0", "8 is not in 0..=7"),
        ("reg sim --bank 256 read 0", "banks end at 0xff"),
        ("reg sim --bank 1,2 read 0", "one bank at a time"),
        (
            "reg sim --bank 1 read 0x78",
            "registers from 0x40 on are in no bank",
        ),
        (
            "reg sim --bank 1 write 0x40=2 0=1",
            "--bank selects with 0x40",
        ),
        ("reg sim save", "--write"),
        ("reg sim save -w - -o json", "both go to standard output"),
        ("reg sim load", "FILE"),
        ("reg spi:0.0 read 0", "wave:0.0"),
        (
            "reg file:none.vcd read 0",
            "nothing can be sent into a recording",
        ),
        ("command spi:1.0 10 --slave 0", "wave:1.0"),
        (
            "command file:none.vcd 10 --slave 0",
            "nothing can be sent into a recording",
        ),
        ("command sim 10", "--slave"),
        (
            "command sim 10 --slave 0 --broadcast",
            "cannot be used with",
        ),
        ("command sim 10 --slave 8", "8 is not in 0..=7"),
        ("command sim 2 --slave 0", "00 01 10 11"),
        (
            "command sim activate-data --broadcast",
            "say --slave instead of --broadcast",
        ),
        (
            "command sim activate-control --slave 0",
            "say --broadcast instead of --slave",
        ),
        ("command sim 10 --slave 0 --reduced", "cannot be used with"),
        (
            "command sim 00 --broadcast --unchecked",
            "cannot be used with",
        ),
    ] {
        let (stdout, stderr, status) = run(args);
        assert_eq!((stdout.as_str(), status), ("", Some(2)), "{args}: {stderr}");
        assert!(
            stderr.starts_with("biss: ") && stderr.contains(words),
            "{args}: {stderr}"
        );
    }
}

#[test]
fn commands_are_acknowledged() {
    let chain = "sim:slaves=each,frame=st12,crc6+st12,crc6+st12,crc6";
    for (args, text, record) in [
        (
            "sim 10 --slave 0",
            "command 10  slave 0  acknowledged and executed\n",
            r#"{"type":"command","slaves":[0],"code":2,"ok":true,"acknowledged":[0]}"#,
        ),
        (
            &format!("{chain} activate-data --slave 2,0"),
            "command 00  slave 0, 2  acknowledged and executed\n",
            r#"{"type":"command","slaves":[0,2],"code":0,"ok":true,"acknowledged":[0,2]}"#,
        ),
        (
            "sim 11 --slave 0 --unchecked",
            "command 11  slave 0  sent\n",
            r#"{"type":"command","slaves":[0],"code":3,"ok":true}"#,
        ),
        (
            "sim activate-control --broadcast",
            "command 01  all slaves  sent\n",
            r#"{"type":"command","broadcast":true,"code":1,"ok":true}"#,
        ),
        (
            "sim 01 --broadcast --reduced",
            "command 01  all slaves  sent\n",
            r#"{"type":"command","broadcast":true,"code":1,"ok":true}"#,
        ),
    ] {
        let (stdout, stderr, status) = run(&format!("command {args}"));
        assert_eq!(
            (stdout.as_str(), stderr.as_str(), status),
            (text, "", Some(0)),
            "{args}"
        );
        let (stdout, _, status) = run(&format!("command {args} -o json"));
        assert_eq!((stdout.trim_end(), status), (record, Some(0)), "{args}");
    }
    for (args, fault, words) in [
        ("sim:ida-wrong=1 10 --slave 0", "acknowledge", "--unchecked"),
        ("sim 10 --slave 3", "absent", "no slave with ID 3"),
        ("sim:device=none 10 --slave 0", "unheard", "unidirectional"),
        (
            "sim:stuck=1 00 --broadcast",
            "no-ack",
            "looking for an encoder: none answers",
        ),
    ] {
        let (stdout, stderr, status) = run(&format!("command {args} -o json"));
        assert_eq!(status, Some(1), "{args}: {stderr}");
        assert_eq!(json(&stdout)[0]["fault"], fault, "{args}: {stdout}");
        assert!(
            stderr.contains(words) && stderr.contains("\n  "),
            "{args}: {stderr}"
        );
    }
    let (stdout, _, _) = run("command sim:ida-wrong=1 10 --slave 0 -o json");
    assert_eq!(json(&stdout)[0]["acknowledged"], Value::Array(Vec::new()));
    // What surprises whoever does not know it.
    for args in [
        "deactivate-control --slave 0",
        "deactivate-data --broadcast",
    ] {
        let (_, stderr, status) = run(&format!("command sim {args}"));
        assert_eq!(status, Some(0));
        assert!(stderr.contains("ends that"), "{stderr}");
        assert_eq!(run(&format!("command sim {args} -q")).1, "");
    }
}

#[test]
fn what_it_took_is_told() {
    // One byte is 33 frames (D2, p. 16); of the 14 before it the master has run ten while it looked for the slaves.
    let (_, stderr, _) = run("reg sim read 0x78 -v");
    assert!(
        stderr.ends_with("biss: 1 register, 0 refused, 37 frames, no control frame repeated\n"),
        "{stderr}"
    );
    let (_, stderr, _) = run("reg sim read 0x78 -v -o json");
    let last = json(stderr.lines().last().unwrap()).remove(0);
    assert_eq!(
        last.to_string(),
        r#"{"frames":37,"refused":0,"registers":1,"retries":0,"type":"summary"}"#
    );
    // Without -v where something had to be repeated. A refusal that is asked for twice is nothing of that kind.
    let (_, stderr, _) = run("reg sim:data-crc=50%,seed=2 read 0x48..0x4f --retries 1000");
    assert!(stderr.contains("control frames repeated"), "{stderr}");
    let (_, stderr, status) = run("reg sim:refuse=0..5 dump 0..9");
    assert_eq!((stderr.as_str(), status), ("", Some(0)));
    let (_, stderr, _) = run("command sim 10 --slave 0 -v");
    assert!(
        stderr.ends_with("frames, no control frame repeated\n"),
        "{stderr}"
    );
}

/// Ctrl-C and SIGTERM end what goes on, and a write that goes on and on.
#[test]
fn signals_end_it() {
    let endless = "--retries 1000000000";
    let read = format!("reg sim:data-crc=1 {endless} read 0x48");
    let write = format!("reg sim:echo-wrong=1 {endless} write 0x48=1");
    let runs = [
        (
            &read,
            "INT",
            Some(1),
            "reading register 0x48 of slave 0: stopped",
        ),
        (&read, "TERM", None, "stopped"),
        (&write, "INT", Some(1), "not known whether written: 0x48"),
    ];
    let children = runs.map(|(args, ..)| {
        let args: Vec<&str> = args.split(' ').collect();
        let child = biss(&args)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn();
        child.unwrap()
    });
    thread::sleep(Duration::from_millis(300));
    for ((_, signal, ..), child) in runs.iter().zip(&children) {
        let signal = format!("-{signal}");
        let killed = Command::new("kill")
            .args([&signal, &child.id().to_string()])
            .status();
        assert!(killed.unwrap().success());
    }
    let began = Instant::now();
    for ((args, signal, code, words), child) in runs.into_iter().zip(children) {
        let (_, stderr, status) = texts(child.wait_with_output().unwrap());
        assert_eq!(status, code, "{args} {signal}: {stderr}");
        assert!(stderr.contains(words), "{args}: {stderr}");
    }
    assert!(began.elapsed() < Duration::from_secs(10));
}

#[test]
fn help_begins_with_the_warning() {
    for args in [
        "reg --help",
        "command --help",
        "reg sim write --help",
        "reg sim load --help",
    ] {
        let (stdout, _, status) = run(args);
        assert!(stdout.starts_with("WARNING: "), "{args}: {stdout}");
        assert!(stdout.contains("for good"), "{stdout}");
        assert_eq!(status, Some(0));
    }
}

#[test]
fn a_reader_who_has_enough_is_no_error() {
    let mut child = biss(&["reg", "sim", "dump", "-o", "json"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let (_, stderr, status) = texts(child.wait_with_output().unwrap());
    assert_eq!((stderr.as_str(), status), ("", Some(0)));
}

/// What a shell has opened for standard output is added to, not replaced.
#[test]
fn a_file_that_is_open_is_not_replaced() {
    let log = std::env::temp_dir().join(format!("biss-log-{}", std::process::id()));
    for target in ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1", "-"] {
        std::fs::write(&log, "what was there\n").unwrap();
        let out = std::fs::OpenOptions::new().append(true).open(&log).unwrap();
        let args = ["reg", "sim", "save", "-w", target, "-q"];
        let status = common::biss(&args).stdout(out).status().unwrap();
        let text = std::fs::read_to_string(&log).unwrap();
        assert_eq!(status.code(), Some(0), "{target}");
        assert!(text.starts_with("what was there\n# "), "{target}: {text}");
        assert!(text.contains("biss-registers 1"), "{target}: {text}");
    }
    std::fs::remove_file(&log).unwrap();
}

/// Records cannot be written, but what the encoder holds now has to be known.
#[test]
fn a_write_that_was_half_done_is_told_without_stdout() {
    let full = std::fs::OpenOptions::new()
        .write(true)
        .open("/dev/full")
        .unwrap();
    let args = ["reg", "sim:read-only=0x12", "write", "0x10=1,2,3,4"];
    let output = common::biss(&args).stdout(full).output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    for words in [
        "written: 0x10..0x11",
        "not written: 0x12..0x13",
        "No space left",
    ] {
        assert!(stderr.contains(words), "{stderr}");
    }
}
