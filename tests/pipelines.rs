//! Pipelines of docs/pipelines.md that need more than a shell: a broker, a service manager.
//! With BISS_TEST_ALL=1 the programs must be there; else what is missing is said.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;

use common::json;
use std::fs;
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

fn there(program: &str) -> bool {
    let path = std::env::var("PATH").unwrap();
    let folders = path.split(':').chain(["/usr/sbin"]);
    let found = folders
        .map(Path::new)
        .any(|folder| folder.join(program).is_file());
    if !found {
        assert!(
            std::env::var_os("BISS_TEST_ALL").is_none(),
            "{program} is not installed"
        );
        println!("{program} is not installed: nothing is tried with it");
    }
    found
}

/// A program that goes with the test.
struct Ends(Child);

impl Drop for Ends {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn shell(command: &str) -> Command {
    let biss = Path::new(env!("CARGO_BIN_EXE_biss")).parent().unwrap();
    let path = std::env::var("PATH").unwrap();
    let mut shell = Command::new("sh");
    shell
        .args(["-c", command])
        .env("PATH", format!("{}:{path}:/usr/sbin", biss.display()))
        .env_remove("BISS_LINK")
        .env_remove("BISS_FRAME");
    shell
}

#[test]
fn a_broker_gets_every_record() {
    if !["mosquitto", "mosquitto_pub", "mosquitto_sub"]
        .iter()
        .all(|program| there(program))
    {
        return;
    }
    // Free a moment ago; nobody else is likely to take it.
    let port = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap()
        .port();
    let broker = shell(&format!("exec mosquitto -p {port}"))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    let _broker = Ends(broker.unwrap());
    let end = Instant::now() + Duration::from_secs(20);
    while TcpStream::connect(("127.0.0.1", port)).is_err() {
        assert!(Instant::now() < end, "the broker does not answer");
        sleep(Duration::from_millis(20));
    }
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let (got, ready) = (folder.join("mqtt.json"), folder.join("mqtt.log"));
    let _ = fs::remove_file(&ready);
    let subscriber = shell(&format!(
        "exec stdbuf -oL mosquitto_sub -p {port} -t axis/1 -C 50 -W 30 -d -q 1 > {} 2>&1",
        ready.display()
    ));
    let mut subscriber = Ends({ subscriber }.spawn().unwrap());
    while !fs::read_to_string(&ready)
        .unwrap_or_default()
        .contains("SUBACK")
    {
        assert!(Instant::now() < end, "the subscriber does not get through");
        sleep(Duration::from_millis(20));
    }
    let published = shell(&format!(
        "biss read sim -n 50 -i 1ms -o json -q | tee {} | mosquitto_pub -p {port} -t axis/1 -q 1 -l",
        got.display()
    ))
    .status();
    assert!(published.unwrap().success());
    assert!(subscriber.0.wait().unwrap().success());
    let said = fs::read_to_string(&ready).unwrap();
    let records: Vec<&str> = said.lines().filter(|line| line.starts_with('{')).collect();
    assert_eq!(
        records.join("\n"),
        fs::read_to_string(&got).unwrap().trim_end()
    );
    assert_eq!(json(&records.join("\n")).len(), 50);
}

/// The unit as the page shows it, but for the place of the program.
#[test]
fn the_unit_is_one_that_systemd_takes() {
    if !there("systemd-analyze") {
        return;
    }
    let page = fs::read_to_string("docs/pipelines.md").unwrap();
    let (_, unit) = page.split_once("```ini\n").unwrap();
    let (unit, _) = unit.split_once("```").unwrap();
    let biss = env!("CARGO_BIN_EXE_biss");
    let unit = unit.replace("/usr/bin/biss", biss);
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("unit");
    fs::create_dir_all(&folder).unwrap();
    let path = folder.join("biss@x.service");
    fs::write(&path, &unit).unwrap();
    let verified = Command::new("systemd-analyze")
        .args(["verify", "--man=no"])
        .arg(&path)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&verified.stderr).into_owned();
    // Other units of the machine may have troubles of their own.
    let ours: Vec<&str> = said
        .lines()
        .filter(|line| line.contains("biss@x"))
        .collect();
    assert!(ours.is_empty(), "{said}");
    // What it starts, with a link and a format from the environment, ended as systemd ends it.
    let (_, start) = unit.split_once("ExecStart=").unwrap();
    let start = start.lines().next().unwrap();
    let mut child = shell(&format!("exec {start}"))
        .env("BISS_LINK", "sim")
        .env("BISS_FRAME", "mt12,st20,nE,nW,crc6")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    sleep(Duration::from_millis(500));
    let pid = child.id().to_string();
    assert!(
        Command::new("kill")
            .args(["-TERM", &pid])
            .status()
            .unwrap()
            .success()
    );
    let status = std::os::unix::process::ExitStatusExt::signal(&child.wait().unwrap());
    assert_eq!(status, Some(15), "a death by SIGTERM is an ordinary stop");
    let mut records = String::new();
    std::io::Read::read_to_string(&mut child.stdout.take().unwrap(), &mut records).unwrap();
    let records = json(&records);
    assert!(records.len() > 10 && records.iter().all(|record| record["ok"] == true));
    assert!(records[0]["t_unix_us"].as_u64() > Some(1_700_000_000_000_000));
}
