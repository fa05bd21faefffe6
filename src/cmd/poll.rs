//! Frame after frame, back to back or one a slot, whoever looks at them: opening, pacing, counting, and how it ends.

use super::asked::{NO_FRAME, check, choose_frame, fill_in, slower, warn_outside};
use super::auto::{self, Answer};
use super::line::{self, Line};
use super::{Ended, Outcome, schedule};
use crate::cli::{self, Wanted};
use crate::output::{Summary, note};
use crate::sys::Signals;
use anyhow::{Result, anyhow, bail};
use biss::diagnose::Evidence;
use biss::frame::{BissC, Stall};
use biss::link::{Kind, Link};
use biss::master::{Master, Slot};
use biss::preset::{Frame, Preset};
use biss::trace::{Cut, Trace};
use biss::unit::Nanos;
use std::io;
use std::time::{Duration, Instant};

/// Whoever looks at the frames.
pub(super) trait Audience {
    /// A cycle was run and judged. It began slot `turn.seq`.
    ///
    /// # Errors
    /// What ends it all.
    fn cycle(&mut self, turn: &Turn, summary: &Summary, master: &mut Master) -> Result<()>;

    /// Something between the last cycle and the next one was no frame: a piece of one, or the recording has ended.
    ///
    /// # Errors
    /// As [`Audience::cycle`].
    fn gap(&mut self, seq: u64, gap: Gap, master: &Master) -> Result<()>;

    /// Before a wait.
    ///
    /// # Errors
    /// As [`Audience::cycle`].
    fn flush(&mut self) -> Result<()>;

    /// Somebody has asked how it goes.
    fn report(&mut self, summary: &Summary);

    /// Why frames are bad, in a line.
    fn why(&mut self, why: &str) {
        note(why);
    }

    /// Called in a long wait, each [`Audience::patience`].
    ///
    /// # Errors
    /// As [`Audience::cycle`].
    fn waiting(&mut self, _summary: &Summary) -> Result<()> {
        Ok(())
    }

    /// After so long a wait something else is to be looked at.
    fn patience(&self) -> Duration {
        Duration::MAX
    }

    /// Nothing more is wanted.
    fn enough(&self) -> bool {
        false
    }
}

/// Why no frame came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Gap {
    /// A recording begins or ends inside one.
    Piece,
    /// The recording is over.
    Ended,
}

/// A cycle's place among the others.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turn {
    /// The slot.
    pub(super) seq: u64,
    /// When it began, on the link's clock.
    pub(super) due_ns: Option<u64>,
    /// Cycles it took; none for a recording.
    pub(super) tries: Option<u32>,
}

/// Whether this is a recording, which somebody else has made.
pub(super) fn recorded(wire: &cli::Wire) -> bool {
    matches!(wire.link.kind, Kind::File { .. })
}

/// An open line, and the signals that end what is done on it.
pub(super) type Opened = (Box<dyn Link>, Signals);

/// Takes from the preset what the user has not said, and opens the line. `flush` is called before a slow recording is waited for.
/// An input that ends for a signal before anything could be told from it ends it all.
///
/// # Errors
/// When the machine fails, or the link cannot be opened.
pub(super) fn open(
    wire: &mut cli::Wire,
    interval: Option<Nanos>,
    frame: &Frame,
    flush: impl Fn() + 'static,
) -> Result<Result<Opened, Ended>> {
    if let Some(preset) = frame.preset {
        warn_outside(wire, interval, preset);
        fill_in(wire, preset);
    }
    open_as(wire, Some(frame), flush)
}

/// The same with nothing filled in. A simulated slave may send `frame`.
///
/// # Errors
/// As [`open`].
pub(super) fn open_as(
    wire: &cli::Wire,
    frame: Option<&Frame>,
    flush: impl Fn() + 'static,
) -> Result<Result<Opened, Ended>> {
    schedule(wire.cpu, wire.rt)?;
    let signals = Signals::catch().map_err(|e| {
        anyhow!("catching signals: {e}\n  is a limit of this process used up (`ulimit -a`)?")
    })?;
    match Line::of(wire, frame).open(&signals, flush) {
        // The input ended for the signal: it is not what the error takes it for.
        Err(_) if recorded(wire) && signals.caught().is_some() => Ok(Err(Ended {
            outcome: Outcome::Bad,
            signal: signals.caught(),
        })),
        opened => Ok(Ok((opened?, signals))),
    }
}

/// An open line, and what comes over it: as it was written down, or as the slaves say themselves.
///
/// # Errors
/// As [`open`], and when nobody says what the encoder sends.
pub(super) fn start(
    wire: &mut cli::Wire,
    polling: &cli::Polling,
    frame: Option<&Wanted>,
    frame_given: bool,
) -> Result<Result<Answer, Ended>> {
    let Some(wanted) = choose_frame(frame, &wire.link, frame_given) else {
        bail!(NO_FRAME);
    };
    check(wire, polling)?;
    let frame = match wanted {
        Wanted::Given(frame) => frame,
        Wanted::Auto => return auto::ask_frame(wire),
    };
    let opened = open(wire, polling.interval, &frame, || {})?;
    Ok(opened.map(|(link, signals)| Answer {
        frame,
        slaves: Vec::new(),
        link,
        signals,
    }))
}

/// From opening a link to the first slot of an interval.
const FIRST_SLOT_NS: u64 = 200_000;

/// What is polled, and what it came to.
pub(super) struct Poll<'a> {
    pub(super) wire: &'a cli::Wire,
    polling: &'a cli::Polling,
    pub(super) preset: Option<&'static Preset>,
    pub(super) protocol: &'a BissC,
    pub(super) signals: Signals,
    usual: u64,
    pub(super) summary: Summary,
    /// Why frames are bad, once the line is open.
    pub(super) evidence: Option<Evidence>,
}

impl<'a> Poll<'a> {
    /// Nothing has been read yet. `usual` frames are, where the user has not said how many; 0 for no end.
    pub(super) fn new(
        (wire, polling): (&'a cli::Wire, &'a cli::Polling),
        preset: Option<&'static Preset>,
        protocol: &'a BissC,
        signals: Signals,
        usual: u64,
    ) -> Poll<'a> {
        Poll {
            wire,
            polling,
            preset,
            protocol,
            signals,
            usual,
            summary: Summary::default(),
            evidence: None,
        }
    }

    /// Who reads them, until `stop` says that it is time to end.
    pub(super) fn master<'m>(
        &self,
        link: &'m mut dyn Link,
        stop: &'m dyn Fn() -> bool,
    ) -> Master<'m>
    where
        'a: 'm,
    {
        let mut master = Master::new(link, self.protocol, self.polling.retries);
        master.stop_when(stop);
        master.keep_distance(self.distance_ns());
        master
    }

    /// How many frames are wanted, 0 for no end.
    pub(super) fn count(&self) -> u64 {
        self.polling.count.unwrap_or(self.usual)
    }

    /// Back to back is not closer than the encoder bears. An interval below that was asked for, and warned of.
    fn distance_ns(&self) -> u64 {
        let least = self.preset.and_then(|preset| preset.interval);
        let asked = self.polling.interval;
        least
            .filter(|least| asked.is_none_or(|asked| asked >= *least))
            .map_or(0, |least| least.0)
    }

    /// Learns the encoder, waits for one when asked to, and says how the link runs.
    ///
    /// # Errors
    /// When the link fails.
    pub(super) fn open(&mut self, master: &mut Master, audience: &mut dyn Audience) -> Result<()> {
        const BETWEEN_TRIES_NS: u64 = 10_000_000;
        self.signals.answer_quit().map_err(|e| {
            anyhow!("catching SIGQUIT: {e}\n  is a limit of this process used up (`ulimit -a`)?")
        })?;
        let power_on = self.preset.and_then(|preset| preset.power_on);
        let wait = self.polling.wait.or(power_on).unwrap_or_default();
        let patience = master.link().now_ns().saturating_add(wait.0);
        let mut said = self.wire.quiet;
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
            drop(audience.flush());
            master.pause(BETWEEN_TRIES_NS)?;
        }
        if !self.wire.quiet {
            self.say_how(master);
        }
        self.evidence = self.gather(master);
        Ok(())
    }

    fn say_how(&self, master: &Master) {
        if !master.link().caps().live {
            master.link().notes().iter().for_each(note);
            return;
        }
        let clock = master.link().clock();
        line::unreached(clock, self.wire.clock)
            .iter()
            .for_each(note);
        let outside = || {
            self.preset
                .and_then(|preset| slower(preset, self.wire.clock, clock.hz))
        };
        line::too_slow(clock).or_else(outside).iter().for_each(note);
        if master.link().caps().times_levels && self.protocol.stall == Stall::Unknown {
            if let Some(stalls) = line::stalls(clock) {
                note(stalls);
            } else if self.wire.verbose {
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
        if self.wire.verbose {
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
    }

    /// All frames that are wanted.
    ///
    /// # Errors
    /// When the link fails, or whoever looks at them.
    pub(super) fn frames(
        &mut self,
        master: &mut Master,
        audience: &mut dyn Audience,
    ) -> Result<()> {
        let count = self.count();
        let caps = master.link().caps();
        // The slave still has the timeout of the last frame before it.
        let start = master.link().now_ns() + FIRST_SLOT_NS;
        let wall = Instant::now();
        // What is over soon says at its end why frames are bad.
        let lasts = caps.live && (count == 0 || self.polling.interval.is_some());
        let (mut seq, mut phase) = (0u64, master.phase());
        while (count == 0 || self.summary.cycles < count)
            && self.signals.caught().is_none()
            && !audience.enough()
        {
            let (mut due_ns, mut end_ns) = (None, None);
            if let Some(Nanos(interval)) = self.polling.interval {
                let now = master.link().now_ns();
                let due = now.saturating_sub(start).div_ceil(interval);
                if self.summary.cycles > 0 && due > seq {
                    self.summary.skipped += due - seq;
                }
                seq = due.max(seq);
                let at_ns = start.saturating_add(seq.saturating_mul(interval));
                (due_ns, end_ns) = (Some(at_ns), Some(at_ns.saturating_add(interval)));
                let wait = if caps.virtual_time {
                    self.behind(wall, at_ns - start)
                } else {
                    at_ns - now.min(at_ns)
                };
                self.pace(wait, caps.virtual_time, audience)?;
                if self.signals.caught().is_some() || audience.enough() {
                    break;
                }
            }
            let tries = match master.slot(due_ns.unwrap_or(0), end_ns)? {
                Slot::Done { tries } => tries,
                Slot::Piece(cut) => {
                    self.piece(cut, master.trace());
                    audience.gap(seq, Gap::Piece, master)?;
                    continue;
                }
                Slot::Ended => {
                    audience.gap(seq, Gap::Ended, master)?;
                    if !self.wire.quiet {
                        let advice = master.link().advice(self.summary.good > 0);
                        advice.iter().for_each(note);
                    }
                    break;
                }
            };
            if !caps.live && self.signals.caught().is_some() {
                // The input ended for the signal, not for the recording.
                break;
            }
            if let Some(Nanos(interval)) = self.polling.interval {
                // A slave that was not ready in time has pushed the frame into a later slot.
                let actual = master.trace().t_ns.saturating_sub(start) / interval;
                self.summary.skipped += actual.saturating_sub(seq);
                seq = seq.max(actual);
            }
            let turn = Turn {
                seq,
                due_ns: self
                    .polling
                    .interval
                    .map(|interval| start + seq * interval.0),
                tries: caps.live.then_some(tries),
            };
            self.summary
                .count(master.format(), master.cycle(), master.trace().t_ns, tries);
            let (first, _) = self.summary.span_ns.unwrap_or_default();
            self.summary.elapsed_ns = master.link().now_ns().saturating_sub(first);
            let due = self.evidence.as_mut().is_some_and(|evidence| {
                evidence.cycle(master.trace(), master.cycle());
                if master.phase() != phase {
                    phase = master.phase();
                    evidence.resampled();
                }
                lasts && evidence.is_due()
            });
            audience.cycle(&turn, &self.summary, master)?;
            if due {
                self.say_why(audience)?;
            }
            self.answer(audience);
            seq += 1;
        }
        Ok(())
    }

    /// What the cycles so far have shown, behind their records.
    #[cold]
    fn say_why(&mut self, audience: &mut dyn Audience) -> Result<()> {
        let news = self.reasons(false);
        if !news.is_empty() {
            audience.flush()?;
        }
        news.iter().for_each(|why| audience.why(why));
        Ok(())
    }

    /// How far real time is behind a virtual time.
    fn behind(&self, wall: Instant, virtual_ns: u64) -> u64 {
        let fast = matches!(self.wire.link.kind, Kind::Sim { fast: true, .. });
        let passed = wall.elapsed().as_nanos() as u64;
        if fast {
            0
        } else {
            virtual_ns.saturating_sub(passed)
        }
    }

    /// Sleeps until shortly before a slot, the rest is the link's; a virtual clock leaves no rest.
    fn pace(&mut self, wait_ns: u64, whole: bool, audience: &mut dyn Audience) -> Result<()> {
        const MARGIN_NS: u64 = 1_000_000;
        let wait = if whole {
            wait_ns
        } else {
            wait_ns.saturating_sub(MARGIN_NS)
        };
        if wait > 0 {
            self.wait(Duration::from_nanos(wait), audience)?;
        }
        Ok(())
    }

    fn wait(&mut self, time: Duration, audience: &mut dyn Audience) -> Result<()> {
        let end = Instant::now() + time;
        loop {
            audience.flush()?;
            let left = end.saturating_duration_since(Instant::now());
            self.signals.wait(left.min(audience.patience()));
            self.answer(audience);
            audience.waiting(&self.summary)?;
            let over = self.signals.caught().is_some() || audience.enough();
            if over || Instant::now() >= end {
                return Ok(());
            }
        }
    }

    fn answer(&self, audience: &mut dyn Audience) {
        if self.signals.was_asked() {
            audience.report(&self.summary);
        }
    }

    /// What a recording shows of a cycle that it cuts is no frame, and no fault of the wire.
    fn piece(&self, cut: Cut, trace: &Trace) {
        if !self.wire.quiet {
            let place = if cut == Cut::Begin { "begins" } else { "ends" };
            note(format_args!(
                "the recording {place} inside a cycle: {} clocks left out",
                trace.bits.len()
            ));
        }
    }

    /// That a recording had less in it than was asked for.
    pub(super) fn say_ended(&self, live: bool) {
        let few = self.summary.cycles < self.count().max(1);
        if !live && self.signals.caught().is_none() && few && !self.wire.quiet {
            note(format_args!(
                "the recording ended, whole frames in it: {}",
                self.summary.cycles
            ));
        }
    }

    /// What the shell is told, after all frames or the error that has ended them. Whoever reads may have enough; then
    /// what was delivered counts.
    ///
    /// # Errors
    /// The one that has ended it, where it is one.
    pub(super) fn ended(&self, result: Result<()>) -> Result<Ended> {
        let count = self.count();
        let enough = match result {
            Err(error) if is_broken_pipe(&error) => true,
            Err(error) if self.gave_up(&error) => count == 0,
            other => {
                other?;
                count == 0 || self.summary.cycles >= count
            }
        };
        let summary = &self.summary;
        let frames = summary.cycles > 0 && summary.good == summary.cycles && summary.error == 0;
        Ok(Ended {
            outcome: match frames && enough {
                true => Outcome::Good,
                false => Outcome::Bad,
            },
            signal: self.signals.caught(),
        })
    }

    /// The end before the first record.
    ///
    /// # Errors
    /// The one that has ended it, unless a signal has.
    pub(super) fn give_up(&self, error: anyhow::Error) -> Result<Ended> {
        if !self.gave_up(&error) {
            return Err(error);
        }
        note(&error);
        Ok(Ended {
            outcome: Outcome::Bad,
            signal: self.signals.caught(),
        })
    }

    /// Whether a child that was waited for has been given up for a signal: no failure of the machine.
    fn gave_up(&self, error: &anyhow::Error) -> bool {
        let child = matches!(self.wire.link.kind, Kind::Exec(_));
        child && self.signals.caught().is_some() && error.is::<biss::link::Error>()
    }
}

/// Whether whoever reads our output has gone.
pub(super) fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error
        .downcast_ref::<io::Error>()
        .is_some_and(|e| e.kind() == io::ErrorKind::BrokenPipe)
}

/// Broken pipes are told from other troubles by the error's own kind.
pub(super) fn writing(error: io::Error) -> anyhow::Error {
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
