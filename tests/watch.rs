//! `biss watch` on a terminal of the test's own, and without one.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;

use common::{biss, run};
use nix::pty::{OpenptyResult, Winsize, openpty};
use nix::sys::termios::{LocalFlags, tcgetattr};
use std::fs::File;
use std::io::{Read, Write};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// A terminal with biss on it.
struct Bench {
    keys: File,
    slave: File,
    child: Child,
    screen: JoinHandle<String>,
}

/// Everything that matters to whoever uses the terminal next.
fn settings(terminal: &File) -> String {
    format!("{:?}", tcgetattr(terminal).unwrap().local_flags)
}

impl Bench {
    fn start(args: &[&str], columns: u16) -> Bench {
        let size = Winsize {
            ws_row: 30,
            ws_col: columns,
            ws_xpixel: 0,
            ws_ypixel: 0,
        };
        let OpenptyResult { master, slave } = openpty(Some(&size), None).unwrap();
        let (mut master, slave) = (File::from(master), File::from(slave));
        let stdio = || Stdio::from(slave.try_clone().unwrap());
        let child = biss(args)
            .env("LC_ALL", "C.UTF-8")
            .env_remove("COLUMNS")
            .stdin(stdio())
            .stdout(stdio())
            .stderr(stdio())
            .spawn()
            .unwrap();
        let keys = master.try_clone().unwrap();
        let screen = thread::spawn(move || {
            let mut all = Vec::new();
            let mut block = [0; 4096];
            // The end of a terminal is an error.
            while let Ok(n @ 1..) = master.read(&mut block) {
                all.extend_from_slice(&block[..n]);
            }
            String::from_utf8(all).unwrap()
        });
        Bench {
            keys,
            slave,
            child,
            screen,
        }
    }

    /// Waits until it has taken the terminal.
    fn taken(&self) {
        let end = Instant::now() + Duration::from_secs(10);
        while tcgetattr(&self.slave)
            .unwrap()
            .local_flags
            .contains(LocalFlags::ECHO)
        {
            assert!(Instant::now() < end, "it never took the terminal");
            thread::sleep(Duration::from_millis(5));
        }
        thread::sleep(Duration::from_millis(250));
    }

    fn kill(&self, signal: &str) {
        let pid = self.child.id().to_string();
        let status = Command::new("kill").args([signal, &pid]).status();
        assert!(status.unwrap().success());
    }

    /// What was on the screen, how it ended, and how the terminal was left.
    fn end(self) -> (String, ExitStatus, String) {
        let Bench {
            keys,
            slave,
            mut child,
            screen,
        } = self;
        let status = child.wait().unwrap();
        let after = settings(&slave);
        // The last ones who hold it.
        drop(slave);
        let screen = screen.join().unwrap();
        drop(keys);
        (screen, status, after)
    }
}

const BEGIN: &str = "\x1b[?1049h\x1b[?25l";
const END: &str = "\x1b[?25h\x1b[?1049l";

#[test]
fn every_way_out_gives_the_terminal_back() {
    let ways: [(&str, &[&str]); 5] = [
        ("q", &[]),
        ("", &["-INT"]),
        ("", &["-INT", "-INT", "-INT"]),
        ("", &["-TERM"]),
        ("", &["-HUP"]),
    ];
    for (keys, signals) in ways {
        let mut bench = Bench::start(&["watch", "sim"], 100);
        bench.taken();
        bench.keys.write_all(keys.as_bytes()).unwrap();
        signals.iter().for_each(|signal| bench.kill(signal));
        let what = format!("{keys}{signals:?}");
        let (screen, status, after) = bench.end();
        assert!(
            after.contains("ECHO |") && after.contains("ICANON"),
            "{what} {after}"
        );
        assert_eq!(screen.matches(BEGIN).count(), 1, "{what}");
        assert_eq!(screen.matches(END).count(), 1, "{what} {screen:?}");
        let (_, behind) = screen.split_once(END).unwrap();
        assert!(
            !behind.contains("\x1b["),
            "{what} paints afterwards: {behind:?}"
        );
        match signals {
            ["-TERM"] | ["-HUP"] => assert!(!status.success(), "{what} {status}"),
            // A second one ends it at once, if it comes in time.
            ["-INT", _, _] => {}
            _ => assert!(status.success(), "{what} {status}"),
        }
    }
}

/// Keys are heard between frames that are far apart.
#[test]
fn a_long_interval_does_not_make_it_deaf() {
    let mut bench = Bench::start(&["watch", "sim", "-i", "60s"], 100);
    bench.taken();
    let began = Instant::now();
    bench.keys.write_all(b"q").unwrap();
    let (screen, status, _) = bench.end();
    assert!(began.elapsed() < Duration::from_secs(20), "deaf");
    assert!(
        status.success() && screen.contains("1 frame, 1 good"),
        "{screen}"
    );
}

/// What a picture shows, without its colours.
fn picture(screen: &str) -> Vec<String> {
    let pictures = screen.split(END).next().unwrap();
    let last = pictures.rsplit("\x1b[H").next().unwrap();
    let last = last.split("\x1b[J").next().unwrap();
    let plain = |line: &str| {
        let mut text = String::new();
        let mut rest = line;
        while let Some((before, after)) = rest.split_once('\x1b') {
            text.push_str(before);
            rest = after
                .split_once(|c: char| c.is_ascii_alphabetic())
                .map_or("", |(_, rest)| rest);
        }
        text + rest
    };
    last.split("\r\n")
        .map(|line| plain(line.trim_end_matches('\r')))
        .collect()
}

#[test]
fn a_picture_says_how_it_is() {
    let link =
        "sim:motion=speed,rpm=60,delay=300ns,crc-error=30%,seed=1,frame=mt12,st20,nE,nW,crc6";
    for columns in [100, 31] {
        let mut bench = Bench::start(&["watch", link, "-n", "60", "--color", "always"], columns);
        bench.taken();
        bench.keys.write_all(b"z").unwrap();
        let (screen, status, _) = bench.end();
        assert_eq!(status.code(), Some(1));
        let lines = picture(&screen);
        for line in &lines {
            assert!(line.chars().count() <= usize::from(columns), "{line}");
        }
        let all = lines.join("\n");
        for words in [
            "pos ",
            "├",
            "speed +10",
            "rate ",
            "jitter ",
            "ack 1 clk",
            "60 frames",
            "fault crc",
        ] {
            assert!(all.contains(words), "{words} {all}");
        }
        if columns == 100 {
            assert!(
                all.contains("+1.000 turns/s") && all.contains("from zero +"),
                "{all}"
            );
            assert!(all.contains("rate 100.0 of 100.0 frames/s"), "{all}");
        }
        // Its summary stands where it was called from.
        let (_, behind) = screen.split_once(END).unwrap();
        assert!(behind.contains("biss: 60 frames, "), "{behind}");
    }
}

/// A position is never shown as if the encoder had sent it just now.
#[test]
fn a_line_that_went_bad_shows_since_when() {
    let bench = Bench::start(&["watch", "sim:absent=3600s", "-n", "30"], 100);
    let (screen, status, _) = bench.end();
    assert_eq!(status.code(), Some(1));
    let all = picture(&screen).join("\n");
    assert!(
        all.contains("no good frame yet") && !all.contains("pos "),
        "{all}"
    );
    let bench = Bench::start(&["watch", "sim:no-ack=60%,seed=3", "-n", "80"], 100);
    let (screen, _, _) = bench.end();
    assert!(screen.contains("last good one 0.0 s ago"), "{screen}");
}

/// Why frames were bad is told whole, however narrow the terminal is, and as what it was once they are good again.
#[test]
fn what_is_over_is_told_as_over() {
    let link = "sim:motion=speed,rpm=60,absent=700ms";
    for (frames, columns, over) in [("60", 34, false), ("300", 100, true)] {
        let bench = Bench::start(&["watch", link, "-n", frames, "-i", "10ms"], columns);
        let (screen, _, _) = bench.end();
        let lines = picture(&screen);
        let all = lines.join(" ");
        for line in &lines {
            assert!(line.chars().count() <= usize::from(columns), "{line}");
        }
        assert_eq!(all.contains("no fault for 2 s; it was:"), over, "{all}");
        // The last words of the diagnosis, which no line of 34 has room for behind the others.
        let words: Vec<&str> = all.split_whitespace().collect();
        let all = words.join(" ");
        assert!(all.contains("SL is high and never moves"), "{all}");
        assert!(
            all.contains("no encoder, no power, or MA does not arrive"),
            "{all}"
        );
    }
}

#[test]
fn without_a_terminal_lines_are_plain() {
    let (stdout, stderr, status) = run("watch sim:frame=mt12,st20,crc6+st8,crc6 -n 150");
    assert_eq!(status, Some(0));
    assert!(
        stdout.lines().count() >= 2 && !stdout.contains('\x1b'),
        "{stdout}"
    );
    for line in stdout.lines() {
        assert!(
            line.contains("  ch 0  turn ") && line.contains("  ch 1  pos "),
            "{line}"
        );
        assert!(line.contains(" good, 0 faults in "), "{line}");
    }
    assert!(stderr.starts_with("biss: 150 frames, 150 good"), "{stderr}");
    let (stdout, stderr, status) = run("watch file:tests/recordings/bench.vcd -f st26,nE,nW,crc6");
    assert_eq!((stdout.as_str(), status), ("", Some(2)));
    assert!(stderr.contains("nothing to watch"), "{stderr}");
}
