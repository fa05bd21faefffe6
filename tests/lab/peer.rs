//! The kernel lab's encoder: the library's simulated slave at the far end of `/dev/biss-wire`, or of two lines of gpio-sim.
//!
//! `lab-peer MA_LINE SLO_LINE CONFIG [LOG [MO_LINE]]` prints `peer up`, then answers every edge of line `MA_LINE` on line
//! `SLO_LINE` until SIGTERM. Lines are numbers, or of gpio-sim the folders of two lines, such as `…/sim_gpio17`: such a
//! wire waits for nobody, so its MA has to be slow. `CONFIG` is what a `sim:` link takes; with `sli=mo` the farthest slave
//! listens to `MO_LINE`. `LOG` receives
//!
//! * one line for each latched position, the channels' data words in hex;
//! * after it with `MO_LINE` a line `# mo=LEVELS`, MO as it stood at each falling MA edge since the latch before;
//! * where a slave did what it was told to, `# wrote ID BANK ADDRESS VALUE`, `-` for BANK from 0x40 on, and
//!   `# did ID COMMAND` or, as a broadcast, `# all did ID COMMAND`;
//! * at the end `# bank ID BANK`, the selected one of each slave that has banks, and `# ma=LEVEL`, the level in which the
//!   master left MA.

use std::error::Error;
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Read, Write};
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant};

use biss::registers::BANK_SELECT;
use biss::slave::{Config, Event as Did, Slave};
use signal_hook::consts::SIGTERM;

/// In an order: start the timer. In an event: it ran out.
const TIMER: u32 = 1 << 31;
/// In an order: tell of this line's edges, and no longer of those of all lines.
const WATCH: u32 = 1 << 30;
/// A wire as quiet as this is idle: time to write the log out, and to look whether we should go.
const IDLE_NS: u64 = 10_000_000;
/// Nobody works out what comes later than this: most timeouts are put off by the next edge.
const SOON_NS: u64 = 200_000;

struct Event {
    at_ns: u64,
    line: u32,
    level: bool,
}

/// When, on which line or [`TIMER`] or [`WATCH`], and which level.
type Order = (u64, u32, bool);

/// What MA, SLO and perhaps MO are wired to.
trait Wire {
    /// Waits for the next event.
    fn event(&mut self) -> io::Result<Event>;
    /// Does what was ordered, each at its time.
    fn order(&mut self, orders: &[Order]) -> io::Result<()>;
}

/// The peer's side of the wire module, which describes it. Times are CLOCK_MONOTONIC.
struct Module(File);

impl Module {
    fn open() -> io::Result<Module> {
        Ok(Module(
            OpenOptions::new()
                .read(true)
                .write(true)
                .open("/dev/biss-wire")?,
        ))
    }
}

impl Wire for Module {
    /// Lets the master's last edge return too.
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

    fn order(&mut self, orders: &[Order]) -> io::Result<()> {
        let mut raw = Vec::with_capacity(16 * orders.len());
        for &(at_ns, line, level) in orders {
            raw.extend(at_ns.to_ne_bytes());
            raw.extend(line.to_ne_bytes());
            raw.extend(u32::from(level).to_ne_bytes());
        }
        self.0.write_all(&raw)
    }
}

/// Two lines of gpio-sim, looked at now and then.
struct Sim {
    since: Instant,
    ma: File,
    slo: File,
    ma_level: bool,
    ahead: Option<(u64, bool)>,
    timer_ns: Option<u64>,
}

/// Its lines.
const SIM_MA: u32 = 0;
const SIM_SLO: u32 = 1;

impl Sim {
    /// Between two looks.
    const LOOK: Duration = Duration::from_micros(50);

    fn open(ma: &Path, slo: &Path) -> io::Result<Sim> {
        let mut sim = Sim {
            since: Instant::now(),
            ma: File::open(ma.join("value"))?,
            slo: OpenOptions::new().write(true).open(slo.join("pull"))?,
            ma_level: true,
            ahead: None,
            timer_ns: None,
        };
        sim.ma_level = sim.looked()?;
        Ok(sim)
    }

    fn looked(&self) -> io::Result<bool> {
        let mut text = [0];
        self.ma.read_exact_at(&mut text, 0)?;
        Ok(text == *b"1")
    }

    fn drive(&self, level: bool) -> io::Result<()> {
        let pull: &[u8] = if level { b"pull-up" } else { b"pull-down" };
        self.slo.write_all_at(pull, 0)
    }
}

impl Wire for Sim {
    fn event(&mut self) -> io::Result<Event> {
        loop {
            let at_ns = self.since.elapsed().as_nanos() as u64;
            let due = |at: &mut u64| *at <= at_ns;
            if let Some((_, level)) = self.ahead.take_if(|(at, _)| due(at)) {
                self.drive(level)?;
            }
            let level = self.looked()?;
            if level != self.ma_level {
                self.ma_level = level;
                let line = SIM_MA;
                return Ok(Event { at_ns, line, level });
            }
            if self.timer_ns.take_if(due).is_some() {
                let line = TIMER | SIM_MA;
                return Ok(Event { at_ns, line, level });
            }
            sleep(Sim::LOOK);
        }
    }

    fn order(&mut self, orders: &[Order]) -> io::Result<()> {
        for &(at_ns, line, level) in orders {
            match line {
                SIM_SLO if at_ns == 0 => {
                    self.ahead = None;
                    self.drive(level)?;
                }
                SIM_SLO => self.ahead = Some((at_ns, level)),
                _ if line & TIMER != 0 => self.timer_ns = Some(at_ns),
                _ => {}
            }
        }
        Ok(())
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

/// What slaves did, reads left out.
fn note_events(slave: &mut Slave, log: &mut impl Write) -> io::Result<()> {
    for event in slave.take_events() {
        match event {
            Did::Read { .. } => {}
            Did::Write {
                id,
                bank,
                address,
                value,
            } => {
                write!(log, "# wrote {id} ")?;
                match address {
                    BANK_SELECT.. => write!(log, "-")?,
                    _ => write!(log, "{bank}")?,
                }
                writeln!(log, " {address:#04x} {value:#04x}")?;
            }
            Did::Command {
                id,
                command,
                broadcast,
            } => {
                let all = if broadcast { "all " } else { "" };
                writeln!(log, "# {all}did {id} {command:02b}")?;
            }
        }
    }
    Ok(())
}

/// Which bank each slave was left with.
fn note_banks(slave: &Slave, log: &mut impl Write) -> io::Result<()> {
    for id in 0..slave.devices() {
        if let Some(bank) = slave.peek(id, 0, BANK_SELECT) {
            writeln!(log, "# bank {id} {bank}")?;
        }
    }
    Ok(())
}

fn run() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let (ma, slo, config, log, mo) = match &args[..] {
        [ma, slo, config] => (ma, slo, config, None, None),
        [ma, slo, config, log] => (ma, slo, config, Some(log), None),
        [ma, slo, config, log, mo] => (ma, slo, config, Some(log), Some(mo)),
        _ => return Err("usage: lab-peer MA_LINE SLO_LINE CONFIG [LOG [MO_LINE]]".into()),
    };
    let module: Result<(u32, u32), _> = ma.parse().and_then(|ma| slo.parse().map(|slo| (ma, slo)));
    let sim = (Path::new(ma), Path::new(slo));
    let (ma, slo) = module.clone().unwrap_or((SIM_MA, SIM_SLO));
    let mo: Option<u32> = mo.map(|line| line.parse()).transpose()?;
    let config: Config = config.parse()?;
    let mut log = match log {
        Some(path) => Some(BufWriter::with_capacity(1 << 16, File::create(path)?)),
        None => None,
    };
    let ended = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(SIGTERM, Arc::clone(&ended))?;

    let mut slave = Slave::new(config);
    slave.record_events(log.is_some());
    let mut wire: Box<dyn Wire> = match module {
        Ok(_) => Box::new(Module::open()?),
        Err(_) => Box::new(Sim::open(sim.0, sim.1)?),
    };
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
            if !slave.has_mo() {
                continue;
            }
            slave.mo(event.at_ns, event.level);
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
            note_events(&mut slave, log)?;
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
                slave.slo(event.at_ns);
                break event.level;
            }
        };
        note_events(&mut slave, &mut log)?;
        note_banks(&slave, &mut log)?;
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
