//! The kernel lab's encoder: the library's simulated slave at the far end of `/dev/biss-wire`.
//!
//! `lab-peer MA_LINE SLO_LINE CONFIG [LOG [MO_LINE]]` prints `peer up`, then answers every edge of line `MA_LINE` on line
//! `SLO_LINE` until SIGTERM. `CONFIG` is what a `sim:` link takes. `LOG` receives one line for each latched position (the
//! channels' data words in hex), after it with `MO_LINE` a line `# mo=LEVELS`, MO as it stood at each falling MA edge since
//! the latch before, and ends with `# ma=LEVEL`, the level in which the master left MA.

use std::error::Error;
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Read, Write};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use biss::slave::{Config, Slave};
use signal_hook::consts::SIGTERM;

/// In an order: start the timer. In an event: it ran out.
const TIMER: u32 = 1 << 31;
/// In an order: tell of this line's edges, and no longer of those of all lines.
const WATCH: u32 = 1 << 30;
/// A wire as quiet as this is idle: time to write the log out, and to look whether we should go.
const IDLE_NS: u64 = 10_000_000;
/// Nobody works out what comes later than this: most timeouts are put off by the next edge.
const SOON_NS: u64 = 200_000;

/// The peer's side of the wire module, which describes it. Times are CLOCK_MONOTONIC.
struct Wire(File);

struct Event {
    at_ns: u64,
    line: u32,
    level: bool,
}

impl Wire {
    fn open() -> io::Result<Wire> {
        Ok(Wire(
            OpenOptions::new()
                .read(true)
                .write(true)
                .open("/dev/biss-wire")?,
        ))
    }

    /// Lets the master's last edge return, and waits for the next event.
    fn event(&mut self) -> io::Result<Event> {
        let mut raw = [0; 16];
        self.0.read_exact(&mut raw)?;
        let [a, b, c, d, e, f, g, h, line @ .., l, _, _, _] = raw;
        Ok(Event {
            at_ns: u64::from_ne_bytes([a, b, c, d, e, f, g, h]),
            line: u32::from_ne_bytes(line),
            level: l != 0,
        })
    }

    fn order(&mut self, orders: &[(u64, u32, bool)]) -> io::Result<()> {
        let mut raw = Vec::with_capacity(16 * orders.len());
        for &(at_ns, line, level) in orders {
            raw.extend(at_ns.to_ne_bytes());
            raw.extend(line.to_ne_bytes());
            raw.extend(u32::from(level).to_ne_bytes());
        }
        self.0.write_all(&raw)
    }
}

/// When the slave's SLO leaves `level` if MA stays as it is.
fn next_change(slave: &Slave, level: bool) -> Option<u64> {
    let mut later = slave.clone();
    while let Some(at) = later.next_change() {
        if later.slo(at) != level {
            return Some(at);
        }
    }
    None
}

fn run() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let (ma, slo, config, log, mo) = match &args[..] {
        [ma, slo, config] => (ma, slo, config, None, None),
        [ma, slo, config, log] => (ma, slo, config, Some(log), None),
        [ma, slo, config, log, mo] => (ma, slo, config, Some(log), Some(mo)),
        _ => return Err("usage: lab-peer MA_LINE SLO_LINE CONFIG [LOG [MO_LINE]]".into()),
    };
    let (ma, slo): (u32, u32) = (ma.parse()?, slo.parse()?);
    let mo: Option<u32> = mo.map(|line| line.parse()).transpose()?;
    let config: Config = config.parse()?;
    let mut log = match log {
        Some(path) => Some(BufWriter::with_capacity(1 << 16, File::create(path)?)),
        None => None,
    };
    let ended = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(SIGTERM, Arc::clone(&ended))?;

    let mut slave = Slave::new(config);
    let mut wire = Wire::open()?;
    let mut latches = slave.latches();
    let mut up = false;
    // A line never driven rests high.
    let (mut mo_level, mut mo_levels) = (true, String::new());
    for line in [ma].into_iter().chain(mo) {
        wire.order(&[(0, WATCH | line, false)])?;
    }
    // ask for the present time
    wire.order(&[(0, TIMER | ma, false)])?;
    while !ended.load(Ordering::Relaxed) {
        let event = wire.event()?;
        let timer = event.line & TIMER != 0;
        if event.line == ma {
            slave.ma(event.at_ns, event.level);
            if !event.level {
                mo_levels.push(if mo_level { '1' } else { '0' });
            }
        } else if Some(event.line) == mo {
            mo_level = event.level;
            continue;
        } else if !timer {
            continue;
        }
        let level = slave.slo(event.at_ns);
        let quiet = event.at_ns + IDLE_NS;
        let soon = event.at_ns + SOON_NS;
        let due = slave.next_change().unwrap_or(quiet);
        let next = match due <= soon {
            true => next_change(&slave, level),
            false => None,
        };
        match next {
            // the pin turns at its time by itself; the timer is for what may come after that
            Some(at) => wire.order(&[
                (0, slo, level),
                (at, slo, !level),
                (at.min(quiet), TIMER | ma, false),
            ])?,
            None if due > soon => wire.order(&[
                (0, slo, level),
                ((due - SOON_NS).min(quiet), TIMER | ma, false),
            ])?,
            None => wire.order(&[(0, slo, level), (quiet, TIMER | ma, false)])?,
        }
        if let Some(log) = &mut log {
            if latches != slave.latches() {
                latches = slave.latches();
                let words: Vec<String> = slave
                    .latched()
                    .iter()
                    .map(|word| format!("{word:x}"))
                    .collect();
                writeln!(log, "{}", words.join(" "))?;
                if mo.is_some() {
                    writeln!(log, "# mo={mo_levels}")?;
                    mo_levels.clear();
                }
            }
            if timer {
                log.flush()?;
            }
        }
        if !up {
            up = true;
            writeln!(io::stdout(), "peer up")?;
        }
    }
    if let Some(mut log) = log {
        wire.order(&[(0, TIMER | ma, false)])?;
        let last = loop {
            let event = wire.event()?;
            if event.line & TIMER != 0 {
                break event.level;
            }
        };
        writeln!(log, "# ma={}", u8::from(last))?;
        log.flush()?;
    }
    Ok(())
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            // nobody is left to tell if this fails too
            let _ = writeln!(io::stderr(), "lab-peer: {e}");
            ExitCode::FAILURE
        }
    }
}
