//! `biss detect`: what an unknown encoder sends, and what it bears.

use super::asked::live_only;
use super::auto::Found;
use super::line::{self, Line};
use super::poll::open_as;
use super::session::{Session, can_send};
use super::{Ended, Outcome, deliver, quoted};
use crate::cli::{self, DETECT_FRAMES, Wanted};
use crate::named::{self, Files};
use crate::output::detect::{Limited, Measured, PhaseTrial, Report, Told};
use crate::output::note;
use anyhow::{Result, anyhow, bail};
use biss::config::{self, Encoder};
use biss::control::RETRIES;
use biss::cycle::Fault;
use biss::detect::{self, Detector, Findings, Listen, Range};
use biss::format::Format;
use biss::frame::BissC;
use biss::limits::{self, BUSY_MAX_NS};
use biss::link::{Kind, Link, Phase};
use biss::master::{Master, Slot};
use biss::preset::Frame;
use biss::registers::Trouble;
use biss::unit::{Hertz, Nanos};
use std::path::PathBuf;

/// From frame to frame: long enough for motion to show.
const SPACING_NS: u64 = 1_000_000;
/// Frames before the first look, and on a line where nobody answers.
const FIRST_LOOK: u64 = 64;
const UNANSWERED: u64 = 64;
/// How long motion is waited for.
const WAIT: Nanos = Nanos(10_000_000_000);
/// Frames at each clock and phase.
const TRIAL: u32 = 16;
/// Clocks that are tried, slowest first: from where no level lasts 12 us up to the fastest of BiSS-C.
const CLOCKS: [u32; 13] = [
    100_000, 150_000, 250_000, 400_000, 600_000, 1_000_000, 1_500_000, 2_000_000, 3_000_000,
    4_000_000, 5_000_000, 7_500_000, 10_000_000,
];

pub(crate) fn run(args: cli::Detect) -> Result<Ended> {
    let wire = &args.wire;
    live_only(
        wire,
        &[
            ("--clock", wire.clock.is_some()),
            ("--wait", args.wait.is_some()),
            ("--no-write", args.no_write),
        ],
    )?;
    let shelf = match &args.save {
        Some(name) => Some(Shelf::of(wire, name)?),
        None => None,
    };
    let mut told = Told::Unasked;
    let (mut link, signals) = if can_send(&wire.link).is_ok() {
        let mut session = Session::open(wire, RETRIES)?;
        match Found::on(&mut session, !args.no_write) {
            Ok(found) => told = heard(&found),
            // Nobody answers, or nobody there has registers: frames say more.
            Err((_, Trouble::Slave { .. })) => told = Told::Silent,
            Err((doing, trouble)) => return session.fail(doing, trouble),
        }
        session.into_parts()
    } else {
        match open_as(wire, None, || {})? {
            Ok(opened) => opened,
            Err(ended) => return Ok(ended),
        }
    };
    let stop = signals.watch();
    let collector = Collector {
        args: &args,
        stop: &stop,
    };
    let mut findings = collector.collect(link.as_mut())?;
    if let Told::Frame { format, fits } = &mut told {
        *fits = findings.hear(format);
    }
    let best = findings
        .answers
        .first()
        .filter(|answer| answer.probability > 0.5);
    let measured = match best {
        Some(best) if link.caps().live && !stop() => {
            collector.measure(link.as_mut(), &best.format)?
        }
        _ => Measured::default(),
    };
    let report = Report {
        told: &told,
        measured: &measured,
        command: command(wire, &findings),
        live: link.caps().live,
        findings: &findings,
    };
    deliver(&report.render(args.format)?)?;
    if let Some(shelf) = shelf {
        shelf.save(wire, &findings)?;
    }
    let outcome = match findings.only() {
        Some(_) => Outcome::Good,
        None => Outcome::Bad,
    };
    Ok(Ended {
        outcome,
        signal: signals.caught(),
    })
}

/// Where what is found is kept.
struct Shelf<'a> {
    name: &'a str,
    path: PathBuf,
}

impl Shelf<'_> {
    /// Whether it can be kept is known before anything is asked.
    fn of<'a>(wire: &cli::Wire, name: &'a str) -> Result<Shelf<'a>> {
        if matches!(wire.link.kind, Kind::Exec(_)) {
            bail!(
                "--save: an exec: link runs a command, so no file can name it\n  leave --save out"
            );
        }
        let path = named::to_write(wire.config.as_deref());
        let path = path.ok_or_else(|| {
            anyhow!("--save: neither XDG_CONFIG_HOME nor HOME says where a configuration of yours would be\n  name a file with --config")
        })?;
        Ok(Shelf { name, path })
    }

    /// Only what is certain. What else stands under that name stays: zero, unit and all that nobody can detect.
    fn save(&self, wire: &cli::Wire, findings: &Findings) -> Result<()> {
        let Some(answer) = findings.only() else {
            note(format_args!(
                "nothing is saved as {}: only what is certain would be",
                self.name
            ));
            return Ok(());
        };
        let before = Files::of(Some(&self.path)).find(self.name);
        let written = wire
            .named
            .as_ref()
            .map_or(&wire.written, |named| &named.link);
        let frame = Frame {
            format: answer.format.clone(),
            preset: None,
        };
        let encoder = Encoder {
            link: without_frame(written).to_owned(),
            frame: Some(Wanted::Given(frame)),
            clock: wire.clock,
            ..before.unwrap_or_default()
        };
        config::save(&self.path, self.name, &encoder)?;
        if !wire.quiet {
            let path = self.path.display();
            note(format_args!("saved in {path}: biss read {}", self.name));
        }
        Ok(())
    }
}

/// A link without its frame, which takes the rest of it.
fn without_frame(link: &str) -> &str {
    let marks = [",frame=", ":frame="];
    let at = marks.iter().filter_map(|mark| link.find(mark)).min();
    at.map_or(link, |at| &link[..at])
}

/// What the registers say, where frames have passed it.
fn heard(found: &Found) -> Told {
    match found.format() {
        Ok(index) => Told::Frame {
            format: found.candidates[index].format.clone(),
            fits: false,
        },
        Err(_) if found.bus.devices.is_empty() => Told::Silent,
        Err(unknown) => Told::Nothing(unknown.explain(&found.candidates)),
    }
}

struct Collector<'a> {
    args: &'a cli::Detect,
    stop: &'a dyn Fn() -> bool,
}

impl Collector<'_> {
    /// With room above the usual limit, so that an encoder beyond it is found and told of.
    fn protocol(&self, format: Format) -> BissC {
        let mut protocol = Line::of(&self.args.wire, None).protocol(format);
        if u64::from(protocol.busy_limit_ns) == BUSY_MAX_NS {
            protocol.busy_limit_ns *= 2;
        }
        protocol
    }

    /// Frames, as many as it takes.
    fn collect(&self, link: &mut dyn Link) -> Result<Findings> {
        let caps = link.caps();
        let limits = self.protocol(Format::default());
        let listen = Listen::new(limits.clone());
        let mut detector = Detector::new(limits);
        let mut master = Master::new(link, &listen, None);
        master.stop_when(self.stop);
        master.open()?;
        self.say_how(&master);
        let most = self.args.count.or(caps.live.then_some(DETECT_FRAMES));
        let patient = caps.live && !caps.virtual_time && self.args.count.is_none();
        let patience = self
            .args
            .wait
            .or(patient.then_some(WAIT))
            .unwrap_or_default();
        let mut until: Option<u64> = None;
        let (mut next_look, mut changes) = (FIRST_LOOK, 0);
        loop {
            match master.slot(self.next_slot(&master), None)? {
                Slot::Ended => break,
                Slot::Piece(_) => continue,
                Slot::Done { .. } => detector.add(master.trace()),
            }
            listen.expect(detector.longest());
            let (frames, answered) = (detector.frames(), detector.answered());
            if (self.stop)()
                || answered == 0 && frames >= UNANSWERED.min(most.unwrap_or(UNANSWERED))
            {
                break;
            }
            let full = most.is_some_and(|most| frames >= most);
            if full && until.is_none() {
                let findings = detector.find();
                let asks = !findings.answers.is_empty() && findings.only().is_none();
                if !asks || patience.0 == 0 {
                    return Ok(findings);
                }
                if !self.args.wire.quiet {
                    note(
                        "several formats fit what was seen so far: turn the encoder, by hand and slowly is enough",
                    );
                }
                until = Some(master.link().now_ns() + patience.0);
                next_look = frames + FIRST_LOOK;
                changes = detector.changes();
            }
            if until.is_some_and(|until| master.link().now_ns() >= until) {
                break;
            }
            if frames >= next_look {
                next_look = match until {
                    None => 2 * frames,
                    Some(_) => frames + 4 * FIRST_LOOK,
                };
                // Nothing new was seen while waiting.
                if until.is_some() && detector.changes() == changes {
                    continue;
                }
                changes = detector.changes();
                let findings = detector.find();
                if findings.only().is_some() {
                    return Ok(findings);
                }
            }
        }
        Ok(detector.find())
    }

    fn next_slot(&self, master: &Master) -> u64 {
        // A simulator in another process works for every tick.
        match self.args.wire.link.kind {
            Kind::File { .. } | Kind::Exec(_) => 0,
            _ => master.trace().t_ns + SPACING_NS,
        }
    }

    fn say_how(&self, master: &Master) {
        let wire = &self.args.wire;
        // Whoever asked the registers has said it.
        if wire.quiet || !master.link().caps().live || can_send(&wire.link).is_ok() {
            return;
        }
        let clock = master.link().clock();
        line::unreached(clock, wire.clock).iter().for_each(note);
        line::too_slow(clock).iter().for_each(note);
        if wire.verbose {
            note(format_args!("clock {clock}"));
            master.link().notes().iter().for_each(note);
        }
    }

    /// What the encoder bears, with frames of a format that is known by now. Leaves the clock as it was.
    fn measure(&self, link: &mut dyn Link, format: &Format) -> Result<Measured> {
        let protocol = self.protocol(format.clone());
        let clock = link.clock().hz;
        let mut measured = Measured {
            phases: self.phases(link, &protocol)?,
            ..Measured::default()
        };
        let usual = self.trial(link, &protocol, 2 * TRIAL)?;
        measured.clock = Some(clock);
        measured.interval_ns = usual.interval_ns;
        measured.timeout_ns = usual.timeout_ns;
        measured.waited_ns = usual.waited_ns.filter(|_| link.caps().sees_idle);
        if usual.passes() && !(self.stop)() {
            let up = CLOCKS.iter().filter(|hz| **hz > clock.0);
            (measured.fastest, measured.fastest_because) =
                self.range(link, &protocol, clock, up)?;
            let down = CLOCKS.iter().rev().filter(|hz| **hz < clock.0);
            (measured.slowest, _) = self.range(link, &protocol, clock, down)?;
            link.set_clock(clock)?;
        }
        Ok(measured)
    }

    /// The last clock that works, one after the other, and why none beyond does.
    fn range<'c>(
        &self,
        link: &mut dyn Link,
        protocol: &BissC,
        from: Hertz,
        clocks: impl Iterator<Item = &'c u32>,
    ) -> Result<(Option<Hertz>, Limited)> {
        let mut good = from;
        for hz in clocks {
            // Refused, or divided down to one that was tried: that is all the link can do.
            let reached = match link.set_clock(Hertz(*hz)) {
                Ok(clock) if clock.hz.0.abs_diff(*hz) <= *hz / 5 => clock.hz,
                _ => return Ok((Some(good), Limited::Link)),
            };
            let trial = self.trial(link, protocol, TRIAL)?;
            if (self.stop)() {
                return Ok((Some(good), Limited::Unknown));
            }
            if !trial.passes() {
                return Ok((Some(good), Limited::Encoder));
            }
            good = reached;
        }
        Ok((Some(good), Limited::Standard))
    }

    /// Frames back to back.
    fn trial(&self, link: &mut dyn Link, protocol: &BissC, frames: u32) -> Result<Trial> {
        let mut master = Master::new(link, protocol, None);
        master.stop_when(self.stop);
        master.open()?;
        let mut trial = Trial::default();
        let mut before = None;
        for _ in 0..frames {
            if (self.stop)() || master.slot(0, None)? == Slot::Ended {
                break;
            }
            let trace = master.trace();
            trial.frames += 1;
            let good = passes(&master);
            trial.good += u32::from(good);
            if let Some(before) = before.filter(|_| good) {
                let interval = trace.t_ns.saturating_sub(before);
                trial.interval_ns = Some(
                    trial
                        .interval_ns
                        .map_or(interval, |least| least.min(interval)),
                );
                let waited = trial.waited_ns.into_iter().chain(trace.waited_ns);
                trial.waited_ns = waited.min();
            }
            if let Some(timeout) = detect::timeout_ns(trace) {
                Range::widen(&mut trial.timeout_ns, timeout.into());
            }
            before = good.then_some(trace.t_ns);
        }
        Ok(trial)
    }

    /// Frames at each sampling phase, where there is a choice of SPI modes. Leaves the better one.
    fn phases(&self, link: &mut dyn Link, protocol: &BissC) -> Result<Vec<PhaseTrial>> {
        let phases = link.caps().phases;
        if phases.len() != 2 {
            return Ok(Vec::new());
        }
        let mut trials = Vec::new();
        for phase in phases {
            link.set_phase(*phase)?;
            trials.push(self.phase(link, protocol, *phase)?);
        }
        // Of equal ones the usual place, which comes first.
        let best = trials
            .iter()
            .rev()
            .max_by_key(|trial| trial.good)
            .map(|trial| trial.phase);
        if let Some(best) = best {
            link.set_phase(best)?;
        }
        Ok(trials)
    }

    fn phase(&self, link: &mut dyn Link, protocol: &BissC, phase: Phase) -> Result<PhaseTrial> {
        /// A master that sees more looks for another phase itself.
        const PATIENCE: u32 = 2;
        let mut master = Master::new(link, protocol, Some(0));
        master.stop_when(self.stop);
        let (mut good, mut bad) = (0, 0);
        while good + bad < TRIAL && bad < PATIENCE && !(self.stop)() {
            master.slot(0, None)?;
            match passes(&master) {
                true => good += 1,
                false => bad += 1,
            }
        }
        Ok(PhaseTrial {
            phase,
            good,
            frames: TRIAL,
        })
    }
}

/// The encoder's own word for no valid data has a good CRC too.
fn passes(master: &Master) -> bool {
    let cycle = master.cycle();
    let fine =
        |fault: Option<Fault>| matches!(fault, None | Some(Fault::Null | Fault::Pair { .. }));
    cycle.fault().is_none() && cycle.words().iter().all(|word| fine(word.fault()))
}

#[derive(Clone, Copy, Debug, Default)]
struct Trial {
    frames: u32,
    good: u32,
    interval_ns: Option<u64>,
    timeout_ns: Option<Range>,
    waited_ns: Option<u64>,
}

impl Trial {
    /// Noise takes single frames.
    fn passes(&self) -> bool {
        self.frames > 0 && self.good >= self.frames - self.frames / 4
    }
}

/// What to type to read the encoder.
fn command(wire: &cli::Wire, findings: &Findings) -> Option<String> {
    let best = findings.answers.first()?;
    let mut words = vec!["biss read".to_owned(), quoted(&wire.written)];
    let config = wire.config.as_ref().filter(|_| wire.named.is_some());
    words.extend(config.map(|path| {
        let path = path.to_string_lossy();
        format!("--config {}", quoted(&path))
    }));
    words.push(format!("-f {}", best.format));
    words.extend(wire.clock.map(|clock| format!("-c {clock}")));
    let asked = |limit: Nanos| Some(limit).filter(|limit| limit.0 != BUSY_MAX_NS);
    words.extend(asked(wire.ack_limit).map(|limit| format!("--ack-limit {limit}")));
    let busy = asked(wire.busy_limit).or(busy_beyond(findings));
    words.extend(busy.map(|limit| format!("--busy-limit {limit}")));
    Some(words.join(" "))
}

/// Where the start bit comes later than BiSS-C allows: a limit that lets it pass.
fn busy_beyond(findings: &Findings) -> Option<Nanos> {
    let (ack, period) = (findings.heads.ack?, findings.heads.period_ns?);
    let clocks = (ack.max + 1).max(limits::BUSY_CLOCKS.into());
    let ns = clocks.saturating_mul(period.max).next_multiple_of(1_000);
    let usual = clocks > limits::BUSY_CLOCKS.into() && ns > BUSY_MAX_NS;
    usual.then_some(Nanos(ns))
}
