//! `biss read`: frames, one after the other or one a slot.

use super::asked::{NO_FRAME, check, choose_frame, fill_in, look, slower, warn_outside};
use super::auto;
use super::beside::Beside;
use super::capture::Sink;
use super::counting::Counting;
use super::line::{self, Line};
use super::overheard::Eavesdropper;
use super::{Ended, Outcome, schedule};
use crate::cli::{self, Wanted};
use crate::output::heard::Overheard;
use crate::output::{Look, Printer, Shot, Summary, note};
use crate::sys::Signals;
use anyhow::{Result, anyhow, bail};
use biss::frame::{BissC, Stall};
use biss::link::{Kind, Link};
use biss::master::{Master, Slot};
use biss::preset::{Frame, Preset};
use biss::trace::{Cut, Trace};
use biss::unit::Nanos;
use std::cell::RefCell;
use std::io;
use std::rc::Rc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

pub(crate) fn run(args: cli::Read, frame_given: bool) -> Result<Ended> {
    let Some(wanted) = choose_frame(args.frame.as_ref(), &args.link, frame_given) else {
        bail!(NO_FRAME);
    };
    check(&args)?;
    match wanted {
        Wanted::Given(frame) => run_given(args, frame, None),
        Wanted::Auto => run_auto(&args),
    }
}

/// Reads frames of a format that was written down, which does not say whose channels they are.
pub(super) fn run_given(mut args: cli::Read, frame: Frame, sink: Option<Sink>) -> Result<Ended> {
    let mut plan = Plan::of(&args, frame, Vec::new(), sink)?;
    if let Some(preset) = plan.frame.preset {
        warn_outside(&args, preset);
        fill_in(&args.link, &mut args.clock, &mut args.timeout, preset);
    }
    schedule(args.cpu, args.rt)?;
    let signals = Signals::catch().map_err(|e| {
        anyhow!("catching signals: {e}\n  is a limit of this process used up (`ulimit -a`)?")
    })?;
    // What was read shall be seen before more of a slow pipe is waited for. Errors come back with the next record.
    let flush = {
        let printer = Rc::clone(&plan.printer);
        move || drop(printer.borrow_mut().flush())
    };
    let line = line(&args, Some(&plan.frame));
    let opened = line.open(&signals, flush);
    let link = match opened {
        // The input ended for the signal: it is not what the error takes it for.
        Err(_) if recorded(&args) && signals.caught().is_some() => {
            return Ok(Ended {
                outcome: Outcome::Bad,
                signal: signals.caught(),
            });
        }
        opened => opened?,
    };
    let link = match &mut plan.sink {
        Some(sink) => sink.tap(link),
        None => link,
    };
    plan.run(&args, link, signals)
}

/// Asks the slaves what they send, and reads that.
fn run_auto(args: &cli::Read) -> Result<Ended> {
    let wire = cli::Wire {
        link: args.link.clone(),
        clock: args.clock,
        timeout: args.timeout,
        ack_limit: args.ack_limit,
        busy_limit: args.busy_limit,
        rt: args.rt,
        cpu: args.cpu,
        quiet: args.quiet,
        verbose: false,
    };
    let answer = match auto::ask_frame(&wire)? {
        Ok(answer) => answer,
        Err(ended) => return Ok(ended),
    };
    let plan = Plan::of(args, answer.frame, answer.slaves, None)?;
    plan.run(args, answer.link, answer.signals)
}

fn line<'a>(args: &'a cli::Read, frame: Option<&'a Frame>) -> Line<'a> {
    Line {
        link: &args.link,
        frame,
        clock: args.clock,
        timeout: args.timeout,
        ack_limit: args.ack_limit,
        busy_limit: args.busy_limit,
        quiet: args.quiet,
    }
}

/// What is read, and how it is counted and shown.
struct Plan {
    frame: Frame,
    /// The slave of each channel; none where nobody has said.
    slaves: Vec<u8>,
    counting: Option<Counting>,
    beside: Option<Beside>,
    /// Where both wires are written to.
    sink: Option<Sink>,
    printer: Rc<RefCell<Printer>>,
}

impl Plan {
    fn of(args: &cli::Read, frame: Frame, slaves: Vec<u8>, sink: Option<Sink>) -> Result<Plan> {
        let counting = Counting::asked(args, &frame.format)?;
        let beside = Beside::asked(args)?;
        let look = match &sink {
            Some(sink) if !sink.prints() => Look::Nothing,
            _ => look(args, &frame.format, !slaves.is_empty(), counting.is_some())?,
        };
        let printer = Printer::new(look, args.time, args.color, args.verbose);
        Ok(Plan {
            frame,
            slaves,
            counting,
            beside,
            sink,
            printer: Rc::new(RefCell::new(printer)),
        })
    }

    fn run(self, args: &cli::Read, mut link: Box<dyn Link>, signals: Signals) -> Result<Ended> {
        let mut protocol = line(args, None).protocol(self.frame.format);
        if let Some(sink) = &self.sink {
            sink.shape(&mut protocol);
        }
        Run {
            args,
            preset: self.frame.preset,
            counting: self.counting,
            beside: self.beside,
            sink: self.sink,
            slaves: self.slaves,
            protocol: &protocol,
            signals,
            printer: self.printer,
            eavesdropper: recorded(args).then(Eavesdropper::default),
        }
        .all(link.as_mut())
    }
}

fn recorded(args: &cli::Read) -> bool {
    matches!(args.link.kind, Kind::File { .. })
}

/// From opening a link to the first slot of an interval.
const FIRST_SLOT_NS: u64 = 200_000;

struct Run<'a> {
    args: &'a cli::Read,
    preset: Option<&'static Preset>,
    counting: Option<Counting>,
    beside: Option<Beside>,
    sink: Option<Sink>,
    /// The slave ID of each channel, or none.
    slaves: Vec<u8>,
    protocol: &'a BissC,
    signals: Signals,
    printer: Rc<RefCell<Printer>>,
    /// Of recordings, which somebody else has made.
    eavesdropper: Option<Eavesdropper>,
}

impl Run<'_> {
    fn all(mut self, link: &mut dyn Link) -> Result<Ended> {
        let live = link.caps().live;
        let stop = self.signals.watch();
        let mut master = Master::new(link, self.protocol, self.args.retries);
        master.stop_when(&stop);
        master.keep_distance(self.distance_ns());
        self.printer.borrow_mut().header().map_err(writing)?;
        if let Err(error) = self.open(&mut master) {
            return self.give_up(error);
        }
        let unix_us = unix_us() - i128::from(master.link().now_ns()) / 1000;
        self.printer.borrow_mut().epoch(unix_us);
        let args = self.args;
        let mut summary = Summary::default();
        // Without a number of frames, as many as registers take.
        let usual = u64::from(live && self.beside.is_none());
        let count = args.count.unwrap_or(usual);
        if let Some(beside) = &mut self.beside {
            beside.go_on(&mut master)?;
        }
        let mut result = Ok(());
        if let Some(sink) = &mut self.sink {
            result = sink.begin(&mut master, self.protocol);
        }
        if result.is_ok() {
            result = self.frames(&mut master, &mut summary, count);
        }
        if let Some(sink) = &mut self.sink {
            // After an error too: what was captured before it shall be whole.
            let ended = sink.end(&mut master, result.is_ok());
            result = result.and(ended);
        }
        let result = result.and_then(|()| self.printer.borrow_mut().flush().map_err(writing));
        let signal = self.signals.caught();
        let gone = result.as_ref().is_err_and(is_broken_pipe);
        if !args.quiet && !gone {
            if !live && signal.is_none() && summary.cycles < count.max(1) {
                note(format_args!(
                    "the recording ended, whole frames in it: {}",
                    summary.cycles
                ));
            }
            if count != 1 || args.verbose {
                summary.print(args.format);
            }
        }
        // Whoever reads may have enough; then what was delivered counts.
        let enough = match result {
            Err(_) if gone => true,
            Err(error) if self.gave_up(&error) => count == 0,
            other => {
                other?;
                count == 0 || summary.cycles >= count
            }
        };
        let registers = self.beside.as_ref().is_none_or(|beside| !beside.is_bad());
        let frames = summary.cycles > 0 && summary.good == summary.cycles && summary.error == 0;
        let good = frames && registers && enough;
        let outcome = if good { Outcome::Good } else { Outcome::Bad };
        Ok(Ended { outcome, signal })
    }

    /// Whether a child that was waited for has been given up for a signal: no failure of the machine.
    fn gave_up(&self, error: &anyhow::Error) -> bool {
        let child = matches!(self.args.link.kind, Kind::Exec(_));
        child && self.signals.caught().is_some() && error.is::<biss::link::Error>()
    }

    /// The end before the first record.
    fn give_up(&self, error: anyhow::Error) -> Result<Ended> {
        if !self.gave_up(&error) {
            return Err(error);
        }
        note(&error);
        Ok(Ended {
            outcome: Outcome::Bad,
            signal: self.signals.caught(),
        })
    }

    /// Back to back is not closer than the encoder bears. An interval below that was asked for, and warned of.
    fn distance_ns(&self) -> u64 {
        let least = self.preset.and_then(|preset| preset.interval);
        let asked = self.args.interval;
        least
            .filter(|least| asked.is_none_or(|asked| asked >= *least))
            .map_or(0, |least| least.0)
    }

    /// Learns the encoder, waits for one when asked to, and says how the link runs.
    fn open(&mut self, master: &mut Master) -> Result<()> {
        const BETWEEN_TRIES_NS: u64 = 10_000_000;
        let power_on = self.preset.and_then(|preset| preset.power_on);
        let wait = self.args.wait.or(power_on).unwrap_or_default();
        let patience = master.link().now_ns().saturating_add(wait.0);
        let mut said = self.args.quiet;
        while !master.open()?
            && master.link().now_ns() < patience
            && self.signals.caught().is_none()
        {
            if !said {
                note(format_args!(
                    "no good frame yet, waiting up to {wait} for one"
                ));
                said = true;
            }
            // Errors come back with the first record.
            drop(self.printer.borrow_mut().flush());
            master.pause(BETWEEN_TRIES_NS)?;
        }
        if self.args.quiet {
            return Ok(());
        }
        if !master.link().caps().live {
            master.link().notes().iter().for_each(note);
            return Ok(());
        }
        let clock = master.link().clock();
        line::unreached(clock, self.args.clock)
            .iter()
            .for_each(note);
        let outside = || {
            self.preset
                .and_then(|preset| slower(preset, self.args.clock, clock.hz))
        };
        line::too_slow(clock).or_else(outside).iter().for_each(note);
        if master.link().caps().times_levels && self.protocol.stall == Stall::Unknown {
            if let Some(stalls) = line::stalls(clock) {
                note(stalls);
            } else if self.args.verbose {
                const LIMITS: &str =
                    "no MA level may exceed 12 us, two clocks and its adaptive timeout";
                match self.preset.and_then(|preset| preset.timeout) {
                    Some(timeout) => note(format_args!(
                        "the encoder's timeout is {timeout}, and nobody says how short it can be: {LIMITS}"
                    )),
                    None => note(format_args!("the encoder's timeout is not known: {LIMITS}")),
                }
            }
        }
        if self.args.verbose {
            note(format_args!("clock {clock}"));
            if let Some((low, high)) = master.learned() {
                let range = if low == high {
                    format!("{}", low + 2)
                } else {
                    format!("{} to {}", low + 2, high + 2)
                };
                note(format_args!("start bit with rising edge {range}"));
            }
            master.link().notes().iter().for_each(note);
        }
        Ok(())
    }

    fn frames(&mut self, master: &mut Master, summary: &mut Summary, count: u64) -> Result<()> {
        let caps = master.link().caps();
        // The slave still has the timeout of the last frame before it.
        let start = master.link().now_ns() + FIRST_SLOT_NS;
        let wall = Instant::now();
        let mut seq = 0u64;
        while (count == 0 || summary.cycles < count)
            && self.signals.caught().is_none()
            && !self.has_registers()
        {
            let (mut at_ns, mut end_ns) = (0, None);
            if let Some(Nanos(interval)) = self.args.interval {
                let now = master.link().now_ns();
                let due = now.saturating_sub(start).div_ceil(interval);
                if summary.cycles > 0 && due > seq {
                    summary.skipped += due - seq;
                }
                seq = due.max(seq);
                at_ns = start.saturating_add(seq.saturating_mul(interval));
                end_ns = Some(at_ns.saturating_add(interval));
                let wait = if caps.virtual_time {
                    self.behind(wall, at_ns - start)
                } else {
                    at_ns - now.min(at_ns)
                };
                self.pace(wait, caps.virtual_time)?;
                if self.signals.caught().is_some() {
                    break;
                }
            }
            let tries = match master.slot(at_ns, end_ns)? {
                Slot::Done { tries } => tries,
                Slot::Piece(cut) => {
                    self.lost(seq, "a frame was not whole")?;
                    self.piece(cut, master.trace());
                    self.capture(master, false)?;
                    continue;
                }
                Slot::Ended => {
                    self.lost(seq, "the recording ended")?;
                    break;
                }
            };
            self.capture(master, true)?;
            if !caps.live && self.signals.caught().is_some() {
                // The input ended for the signal, not for the recording.
                break;
            }
            if let Some(Nanos(interval)) = self.args.interval {
                // A slave that was not ready in time has pushed the frame into a later slot.
                let actual = master.trace().t_ns.saturating_sub(start) / interval;
                summary.skipped += actual.saturating_sub(seq);
                seq = seq.max(actual);
            }
            let cycle = master.cycle();
            let format = &self.protocol.format;
            let t_ns = master.trace().t_ns;
            let counted = self.counting.as_mut();
            let shot = Shot {
                format,
                cycle,
                trace: master.trace(),
                t_ns,
                seq,
                tries: caps.live.then_some(tries),
                counted: counted.map(|counting| counting.next(format, cycle, t_ns)),
                slaves: &self.slaves,
            };
            summary.count(&shot);
            let first = summary.span_ns.map_or(shot.t_ns, |(first, _)| first);
            summary.elapsed_ns = master.link().now_ns().saturating_sub(first);
            self.printer.borrow_mut().shot(&shot).map_err(writing)?;
            self.overhear(seq, master)?;
            seq += 1;
            self.registers(master)?;
        }
        Ok(())
    }

    /// Writes what both wires have done, and of a whole frame what it said.
    fn capture(&mut self, master: &Master, whole: bool) -> Result<()> {
        match &mut self.sink {
            Some(sink) => sink.cycle(master, whole),
            None => Ok(()),
        }
    }

    /// Prints what somebody else's master and slaves have said by the end of this frame.
    fn overhear(&mut self, seq: u64, master: &Master) -> Result<()> {
        let heard = self
            .eavesdropper
            .as_mut()
            .and_then(|ear| ear.frame(seq, master.trace(), master.cycle()));
        self.tell(heard)
    }

    /// `seq` is that of the next frame.
    fn lost(&mut self, seq: u64, why: &str) -> Result<()> {
        let seq = seq.saturating_sub(1);
        let heard = self
            .eavesdropper
            .as_mut()
            .and_then(|ear| ear.lost(seq, why));
        self.tell(heard)
    }

    fn tell(&mut self, heard: Option<Overheard>) -> Result<()> {
        match heard {
            Some(heard) => self.printer.borrow_mut().overheard(&heard).map_err(writing),
            None => Ok(()),
        }
    }

    /// Prints the registers that have come with this frame.
    fn registers(&mut self, master: &mut Master) -> Result<()> {
        if let Some(beside) = &mut self.beside {
            for record in beside.look(master)? {
                self.printer
                    .borrow_mut()
                    .register(&record)
                    .map_err(writing)?;
            }
        }
        Ok(())
    }

    /// Whether all registers have been read, and nothing else was asked for.
    fn has_registers(&self) -> bool {
        let once = self
            .beside
            .as_ref()
            .is_some_and(|beside| beside.rounds() > 0);
        once && self.args.count.is_none()
    }

    /// How far real time is behind a virtual time.
    fn behind(&self, wall: Instant, virtual_ns: u64) -> u64 {
        let fast = matches!(self.args.link.kind, Kind::Sim { fast: true, .. });
        let passed = wall.elapsed().as_nanos() as u64;
        if fast {
            0
        } else {
            virtual_ns.saturating_sub(passed)
        }
    }

    /// Sleeps until shortly before a slot, the rest is the link's; a virtual clock leaves no rest.
    fn pace(&mut self, wait_ns: u64, whole: bool) -> Result<()> {
        const MARGIN_NS: u64 = 1_000_000;
        let wait = if whole {
            wait_ns
        } else {
            wait_ns.saturating_sub(MARGIN_NS)
        };
        if wait > 0 {
            self.printer.borrow_mut().flush().map_err(writing)?;
            if let Some(sink) = &mut self.sink {
                sink.flush()?;
            }
            self.signals.wait(Duration::from_nanos(wait));
        }
        Ok(())
    }

    /// What a recording shows of a cycle that it cuts is no frame, and no fault of the wire.
    fn piece(&self, cut: Cut, trace: &Trace) {
        if !self.args.quiet {
            let place = if cut == Cut::Begin { "begins" } else { "ends" };
            note(format_args!(
                "the recording {place} inside a cycle: {} clocks left out",
                trace.bits.len()
            ));
        }
    }
}

/// Broken pipes are told from other troubles by the error's own kind.
fn writing(error: io::Error) -> anyhow::Error {
    let said = format!("writing records: {error}\n  make room, or write elsewhere");
    anyhow::Error::from(error).context(Said(said))
}

/// A recording that could not be written, in the same way.
pub(super) fn writing_to(name: &str, error: io::Error) -> anyhow::Error {
    let said = format!(
        "writing {name}: {error}\n  make room, or write elsewhere; a file holds what was captured before"
    );
    anyhow::Error::from(error).context(Said(said))
}

/// All three parts of an error in one; what is under it would only repeat the second.
#[derive(Debug)]
struct Said(String);

impl std::fmt::Display for Said {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

pub(super) fn unix_us() -> i128 {
    let since = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default();
    since.as_micros() as i128
}

fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error
        .downcast_ref::<io::Error>()
        .is_some_and(|e| e.kind() == io::ErrorKind::BrokenPipe)
}
