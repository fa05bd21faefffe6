//! Encoders by name, as a user types them.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;

use common::{biss, json, texts};
use serde_json::Value;
use std::fs;
use std::path::PathBuf;

/// A user who has a configuration.
struct User(PathBuf);

const CONFIG: &str = "\
[encoder.spindle]
link = \"sim:turn=3,pos=524288,motion=still\"
frame = \"mt12,st20,nE,nW,crc6\"
clock = \"2MHz\"
interval = \"2ms\"
zero = 524288
reverse = true

[encoder.axis]
link = \"sim:motion=count,pos=1000\"
frame = \"pos24,nE,nW,crc6\"
resolution = \"1um\"

[encoder.table]
link = \"sim:pos=900,rpm=6\"
frame = \"st10,nE,nW,crc6\"
resolution = 1000

[encoder.gone]
link = \"sim:stuck=1,frame=st8,crc6\"

[encoder.asked]
link = \"sim\"
frame = \"auto\"

[encoder.bench]
link = \"file:tests/recordings/faults.vcd\"
frame = \"st26,nE,nW,crc6\"
";

impl User {
    fn new(name: &str, config: &str) -> User {
        let home = std::env::temp_dir().join(format!("biss-user-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&home);
        fs::create_dir_all(home.join("biss")).unwrap();
        fs::write(home.join("biss/config.toml"), config).unwrap();
        User(home)
    }

    fn run(&self, args: &str) -> (String, String, Option<i32>) {
        self.run_with(args, &[])
    }

    fn run_with(&self, args: &str, env: &[(&str, &str)]) -> (String, String, Option<i32>) {
        let args: Vec<&str> = args.split(' ').collect();
        let mut command = biss(&args);
        command
            .env("XDG_CONFIG_HOME", &self.0)
            .envs(env.iter().copied());
        texts(command.output().unwrap())
    }

    fn json(&self, args: &str) -> Vec<Value> {
        let (stdout, stderr, _) = self.run(&format!("{args} -o json"));
        let records = json(&stdout);
        assert!(!records.is_empty(), "{args}: {stderr}");
        records
    }
}

impl Drop for User {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

#[test]
fn a_name_stands_for_all_that_was_typed() {
    let user = User::new("all", CONFIG);
    let records = user.json("read spindle -n 3");
    let first = &records[0];
    assert_eq!(
        (&first["turn"], &first["pos"]),
        (&Value::from(3), &Value::from(524_288))
    );
    // From zero it is three whole turns, the other way.
    let counts = (1u64 << 32) - (3 << 20);
    assert_eq!(first["counts"], Value::from(counts), "{first}");
    assert_eq!(first["deg"], Value::from(0.0));
    assert_eq!(
        records[2]["t_ns"],
        Value::from(4_000_000),
        "the file's interval"
    );
    let (_, stderr, _) = user.run("read spindle -v");
    assert!(stderr.contains("clock 2MHz"), "{stderr}");
    let typed = "read sim:turn=3,pos=524288,motion=still -f mt12,st20,nE,nW,crc6 -c 2MHz -i 2ms --zero 524288 --reverse -n 3";
    assert_eq!(user.run("read spindle -n 3"), user.run(typed));
}

#[test]
fn what_is_typed_beats_the_file_and_the_file_beats_the_environment() {
    let user = User::new("beats", CONFIG);
    let (_, stderr, _) = user.run("read spindle -v -c 500kHz");
    assert!(stderr.contains("clock 500kHz"), "{stderr}");
    let record = &user.json("read spindle -n 2 -i 7ms")[1];
    assert_eq!(record["t_ns"], Value::from(7_000_000));
    let record = &user.json("read spindle -n 2 -i 0s")[1];
    assert!(
        record["t_ns"].as_u64() < Some(1_000_000),
        "back to back: {record}"
    );
    let record = &user.json("read spindle --zero 0 --no-reverse")[0];
    assert_eq!(record["counts"], Value::from((3 << 20) + 524_288));
    // The simulated slave sends what was typed.
    let record = &user.json("read spindle -f st24,nE,nW,crc6 --zero 0")[0];
    assert_eq!(
        (record["ok"].as_bool(), record.get("turn")),
        (Some(true), None)
    );
    let (stdout, ..) = user.run_with("read spindle", &[("BISS_FRAME", "st8,crc6")]);
    assert!(stdout.contains("turn 3"), "{stdout}");
    let (stdout, ..) = user.run_with("read", &[("BISS_LINK", "spindle")]);
    assert!(stdout.contains("turn 3"), "{stdout}");
    let (_, stderr, status) = user.run_with("read", &[("BISS_LINK", "spindel")]);
    assert!(
        stderr.contains("from BISS_LINK: unknown link `spindel`"),
        "{stderr}"
    );
    assert_eq!(status, Some(2));
}

#[test]
fn every_verb_that_takes_a_link_takes_a_name() {
    let user = User::new("verbs", CONFIG);
    let file = user.0.join("x.vcd").display().to_string();
    for (args, words) in [
        ("read spindle", "turn 3"),
        ("stats spindle -n 5", "5 frames, 5 good"),
        ("watch spindle -n 3", "turn 3"),
        ("stats axis -n 50", " mm)"),
        ("stats axis -n 50 -o json", "\"mm_per_s\":"),
        ("stats axis -n 50 --unit um", " um/s)"),
        ("stats table -n 50 -i 10ms", "(0.1020 turns/s)"),
        ("stats table -n 50 -i 10ms", "travel 50 (18.000000 deg)"),
        ("watch axis -n 3", "counts/s"),
        ("scope axis --width 100", " mm  ok"),
        ("scope spindle --width 100", "mt12,st20,nE,nW,crc6"),
        ("info spindle", "BISSIM"),
        ("reg spindle read 0x78", "0x42"),
        ("command spindle 00 --slave 0", "executed"),
        ("loopback spindle -n 5", "5 of 5 frames"),
        ("read asked", "pos "),
        ("stats asked -n 5", "5 frames, 5 good"),
        ("read bench -n 1", "pos "),
        (&format!("capture spindle -o text -w {file}"), "counts"),
    ] {
        let (stdout, stderr, status) = user.run(args);
        assert!(stdout.contains(words), "{args}: {stdout}{stderr}");
        assert_eq!(status, Some(0), "{args}: {stderr}");
    }
    let (stdout, _, status) = user.run("read gone");
    assert!(stdout.contains("no-ack") && status == Some(1), "{stdout}");
}

#[test]
fn errors_name_file_line_and_key() {
    let user = User::new(
        "errors",
        "[encoder.x]\nlink = \"sim\"\n\n[encoder.y]\nlink = \"sim\"\nclok = \"1MHz\"\n",
    );
    let path = user.0.join("biss/config.toml").display().to_string();
    let fails = |args: &str, words: &str| {
        let (stdout, stderr, status) = user.run(args);
        assert_eq!((stdout.as_str(), status), ("", Some(2)), "{args}");
        assert!(
            stderr.contains(words) && stderr.starts_with("biss: "),
            "{args}: {stderr}"
        );
    };
    let wrong = format!("biss: {path}:6: encoder.y.clok: no such key, `clock` is meant\n");
    for verb in ["read", "stats", "watch", "scope", "info", "loopback"] {
        fails(&format!("{verb} x"), &wrong);
    }
    fails("capture x -w /dev/null --as vcd", &wrong);
    fails("reg x read 0", &wrong);
    fails("command x 00 --slave 0", &wrong);
    fails(
        "read x --config /nowhere/biss.toml",
        "reading /nowhere/biss.toml: No such file",
    );
    // What is no name needs no configuration.
    assert_eq!(user.run("read sim").2, Some(0));
    fails("read spy:0.0", "unknown link `spy`");
    fs::write(&path, CONFIG).unwrap();
    fails("read spindel", "`spindle` is the nearest");
    fails(
        "read nothing-like-it",
        "are spindle axis table gone asked bench",
    );
    fails(
        "read spindle -i 0s -n 1 -f st8,crc6",
        "--zero 524288 is never reached",
    );
    fs::write(&path, "[encoder.x]\nlink = \"exec:touch /tmp/never\"\n").unwrap();
    fails("read x", ":2: encoder.x.link: an exec: link runs a command");
    let broken: [(&[u8], &str); 4] = [
        (&[0xFF; 64], ":1: no UTF-8"),
        (&[b'['; 200_000], "biss: "),
        (&[b'x'; 300_000], ":1: more than"),
        (b"a.a.a.a", ":1: "),
    ];
    for (bytes, words) in broken {
        fs::write(&path, bytes).unwrap();
        fails("read x", words);
    }
}

#[test]
fn another_file_takes_the_place_of_all() {
    let user = User::new("config", CONFIG);
    let other = user.0.join("other.toml");
    fs::write(
        &other,
        "[encoder.axis]\nlink = \"sim\"\nframe = \"pos8,crc6\"\n",
    )
    .unwrap();
    let other = other.display();
    assert_eq!(user.run(&format!("read axis --config {other}")).2, Some(0));
    let (_, stderr, status) = user.run(&format!("read spindle --config {other}"));
    assert!(stderr.contains("are axis") && status == Some(2), "{stderr}");
    // Without a folder of its own the user has one below his home.
    fs::create_dir_all(user.0.join(".config/biss")).unwrap();
    fs::copy(
        user.0.join("biss/config.toml"),
        user.0.join(".config/biss/config.toml"),
    )
    .unwrap();
    let home = user.0.display().to_string();
    let env = [("HOME", home.as_str()), ("XDG_CONFIG_HOME", "")];
    assert_eq!(user.run_with("read spindle", &env).2, Some(0));
    let env = [("HOME", home.as_str()), ("XDG_CONFIG_HOME", "relative")];
    assert_eq!(user.run_with("read spindle", &env).2, Some(0));
}

#[test]
fn list_shows_them() {
    let user = User::new("list", CONFIG);
    let (stdout, _, _) = user.run("list");
    assert!(
        stdout.contains("\nEncoders, by name\n  asked    sim -f auto\n"),
        "{stdout}"
    );
    let (stdout, _, _) = user.run("list -v");
    assert!(
        stdout.contains(" -c 2MHz -i 2ms --zero 524288 --reverse\n    from "),
        "{stdout}"
    );
    let records = user.json("list");
    let encoders: Vec<&Value> = records
        .iter()
        .filter(|record| record["type"] == "list-encoder")
        .collect();
    assert_eq!(encoders.len(), 6);
    let spindle = encoders
        .iter()
        .find(|encoder| encoder["name"] == "spindle")
        .unwrap();
    assert_eq!(spindle["link"], "sim:turn=3,pos=524288,motion=still");
    assert_eq!(spindle["clock_hz"], 2_000_000);
    assert_eq!(spindle["interval_ns"], 2_000_000);
    assert_eq!(spindle["reverse"], true);
    assert_eq!(
        spindle["file"],
        user.0.join("biss/config.toml").display().to_string()
    );
    fs::write(user.0.join("biss/config.toml"), "[encoder.x]\n").unwrap();
    let (stdout, _, status) = user.run("list");
    assert!(
        stdout.contains("config.toml:1: encoder.x: no link\n    fix: "),
        "{stdout}"
    );
    assert_eq!(status, Some(0));
    let broken = user.json("list");
    let missing = broken
        .iter()
        .find(|record| record["what"] == "config")
        .unwrap();
    assert_eq!(missing["type"], "list-missing");
}
