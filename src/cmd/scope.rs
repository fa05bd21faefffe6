//! `biss scope`: cycles as engineers draw them, in the terminal or as SVG.

use super::asked::{choose_frame, fill_in};
use super::line::{self, Line};
use super::poll::{open_as, recorded};
use super::{Ended, Outcome, auto, bank, deliver};
use crate::cli::{self, Wanted};
use crate::output::{Progress, note, scope};
use crate::sys::Signals;
use anyhow::{Result, bail};
use biss::cycle::Cycle;
use biss::diagram::Diagram;
use biss::format::Format;
use biss::frame::BissC;
use biss::link::tap::Tap;
use biss::link::{Kind, Link};
use biss::master::{Master, Slot};
use biss::measure::{Scale, scales};
use biss::protocol::{Ability, Protocol};
use biss::trace::{Clocks, Cut, Trace};
use biss::waveform::Change;
use std::cell::RefCell;
use std::path::Path;
use std::rc::Rc;

/// Longer than the longest timeout and line delay.
const VIRTUAL_REST_NS: u64 = 100_000;

/// Cycles of a live link that may be left out: three hours at a kilohertz.
const MOST_SKIPPED: u64 = 10_000_000;

/// Live cycles that are looked at for a fault.
const WITHIN: u64 = 10_000;

pub(crate) fn run(mut args: cli::Scope, frame_given: bool) -> Result<Ended> {
    check(&args)?;
    let wanted = choose_frame(args.frame.as_ref(), &args.wire.link, frame_given);
    if wanted == Some(Wanted::Auto) {
        return match auto::ask_frame(&args.wire)? {
            Ok(answer) => draw(
                &args,
                Some(answer.frame.format),
                answer.link,
                &answer.signals,
            ),
            Err(ended) => Ok(ended),
        };
    }
    let frame = match wanted {
        Some(Wanted::Given(frame)) => Some(frame),
        _ => None,
    };
    if let Some(preset) = frame.as_ref().and_then(|frame| frame.preset) {
        fill_in(&mut args.wire, preset);
    }
    match open_as(&args.wire, frame.as_ref(), || {})? {
        Ok((link, signals)) => draw(&args, frame.map(|frame| frame.format), link, &signals),
        Err(ended) => Ok(ended),
    }
}

/// What the name of a picture ends with that is no SVG.
fn other_picture(path: &Path) -> Option<String> {
    const OTHERS: [&str; 12] = [
        "png", "jpg", "jpeg", "gif", "bmp", "webp", "tif", "tiff", "pdf", "eps", "ps", "ico",
    ];
    let end = path.extension()?.to_str()?.to_ascii_lowercase();
    OTHERS.contains(&end.as_str()).then_some(end)
}

fn check(args: &cli::Scope) -> Result<()> {
    if recorded(&args.wire) && args.wire.clock.is_some() {
        bail!("--clock has no meaning on a recording\n  leave it out");
    }
    let picture = args.write.as_deref().and_then(other_picture);
    if let (Some(path), Some(end)) = (&args.write, picture) {
        bail!(
            "writing {}: scope draws SVG, and no .{end}\n  say -w {}; a browser, or rsvg-convert, makes others of it",
            path.display(),
            path.with_extension("svg").display()
        );
    }
    if !recorded(&args.wire) && args.skip > MOST_SKIPPED {
        bail!(
            "--skip {}: more than {MOST_SKIPPED} cycles take a live link hours\n  leave out fewer, or `biss capture` them and draw from the recording",
            args.skip
        );
    }
    Ok(())
}

/// Frames of an encoder that nobody has described: the head is decoded, and a whole channel is clocked behind it.
struct Unknown {
    head: BissC,
    room: BissC,
}

impl Unknown {
    fn new(limits: BissC) -> Unknown {
        #[allow(clippy::unwrap_used)] // a constant of ours
        let format = "data64,crc16".parse().unwrap();
        Unknown {
            room: BissC {
                format,
                ..limits.clone()
            },
            head: BissC {
                head_only: true,
                ..limits
            },
        }
    }
}

impl Protocol for Unknown {
    fn format(&self) -> &Format {
        self.head.format()
    }
    fn request(&self, ability: &Ability) -> Clocks {
        self.room.request(ability)
    }
    fn init(&self) -> Option<Clocks> {
        self.head.init()
    }
    fn decode(&self, trace: &Trace, cycle: &mut Cycle) {
        self.head.decode(trace, cycle);
    }
}

/// As the encoder's name says. Its zero and direction are not those of the wire, which is drawn: then nothing is measured.
fn measured(args: &cli::Scope, format: &Format) -> Result<Vec<Option<Scale>>> {
    let named = args.wire.named.as_deref();
    if named.is_some_and(|named| named.zero.is_some() || named.reverse) {
        return Ok(Vec::new());
    }
    let measure = named.map_or_else(cli::Measure::default, cli::Measure::of);
    Ok(scales(format, measure.unit, measure.resolution)?)
}

fn draw(
    args: &cli::Scope,
    format: Option<Format>,
    link: Box<dyn Link>,
    signals: &Signals,
) -> Result<Ended> {
    let scales = match &format {
        Some(format) => measured(args, format)?,
        None => Vec::new(),
    };
    let line = Line::of(&args.wire, None);
    let protocol: Box<dyn Protocol> = match &format {
        Some(format) => Box::new(line.protocol(format.clone())),
        None => Box::new(Unknown::new(line.protocol(Format::default()))),
    };
    let stop = signals.watch();
    // A slot may take several cycles: what comes behind one is seen by none of them alone.
    let tap = Rc::new(RefCell::new(Tap::new(link)));
    let mut tapped = Rc::clone(&tap);
    let mut master = Master::new(&mut tapped, protocol.as_ref(), Some(0));
    master.stop_when(&stop);
    master.open()?;
    say_how(args, &master);
    tap.borrow_mut().begin()?;
    let mut found = Search::new(args, format.as_ref(), &tap);
    let result = found.run(&mut master, &stop);
    // What came before the damage of a recording is drawn all the same.
    let sheet = scope::Sheet {
        scales: &scales,
        pictures: &found.pictures,
        format: format.as_ref(),
    };
    if !found.pictures.is_empty() {
        match &args.write {
            Some(path) => bank::store(path, &scope::svg(&sheet))?,
            None => {
                let wish = scope::Wish {
                    width: args.width,
                    ascii: args.ascii,
                    color: args.color,
                };
                deliver(&scope::text(&sheet, wish))?;
            }
        }
    }
    result?;
    let signal = signals.caught();
    if !args.wire.quiet {
        match signal {
            None => found.explain(&stop),
            Some(_) if found.pictures.is_empty() => note(format_args!(
                "stopped, cycles looked at: {}, drawn: none",
                found.seen
            )),
            Some(_) => {}
        }
    }
    let good = match found.pictures.is_empty() {
        true => args.fault && found.bad == 0 && found.seen > 0,
        false => found.bad == 0 && found.chosen == args.count,
    };
    let outcome = if good { Outcome::Good } else { Outcome::Bad };
    Ok(Ended { outcome, signal })
}

fn say_how(args: &cli::Scope, master: &Master) {
    if args.wire.quiet || !master.link().caps().live {
        return;
    }
    let clock = master.link().clock();
    line::unreached(clock, args.wire.clock)
        .iter()
        .for_each(note);
    line::too_slow(clock).iter().for_each(note);
    if args.wire.verbose {
        note(format_args!("clock {clock}"));
        master.link().notes().iter().for_each(note);
    }
}

/// A cycle that is to be drawn, until it is known what came behind it.
struct Pending {
    trace: Trace,
    cycle: Cycle,
    seq: u64,
    cut: Option<Cut>,
}

/// Looks for the cycles that were asked for.
struct Search<'a> {
    args: &'a cli::Scope,
    format: Option<&'a Format>,
    tap: &'a RefCell<Tap>,
    pictures: Vec<scope::Picture>,
    pending: Option<Pending>,
    /// What a recording has where it has no whole cycle.
    piece: Option<Pending>,
    /// Cycles looked at, and begun to be drawn.
    seen: u64,
    chosen: u64,
    /// Of those that are drawn, how many are not good.
    bad: u64,
    first_ns: Option<u64>,
    ended: bool,
}

impl<'a> Search<'a> {
    fn new(args: &'a cli::Scope, format: Option<&'a Format>, tap: &'a RefCell<Tap>) -> Search<'a> {
        Search {
            args,
            format,
            tap,
            pictures: Vec::new(),
            pending: None,
            piece: None,
            seen: 0,
            chosen: 0,
            bad: 0,
            first_ns: None,
            ended: false,
        }
    }

    fn run(&mut self, master: &mut Master, stop: &dyn Fn() -> bool) -> Result<()> {
        let live = master.link().caps().live;
        let limit = self.args.within.or(live.then_some(WITHIN));
        let total = match (self.args.at, self.args.fault) {
            (Some(_), _) => None,
            (None, true) => limit.map(|limit| limit.saturating_add(self.args.skip)),
            (None, false) => Some(self.args.skip.saturating_add(self.args.count)),
        };
        // How far a recording has been read is shown by its link.
        let mut progress = Progress::cycles(total, self.args.wire.quiet || !live);
        loop {
            if self.chosen == 0
                && self.args.fault
                && limit.is_some_and(|most| self.looked() >= most)
            {
                return Ok(());
            }
            // Simulated slaves get a rest in which the end of a cycle shows; others are polled for SL = 1 instead.
            let rest_ns = match self.args.wire.link.kind {
                Kind::Sim { .. } => VIRTUAL_REST_NS,
                _ => 0,
            };
            let slot = master.slot(master.link().now_ns() + rest_ns, None);
            let mut seen: Vec<Change> = self.tap.borrow_mut().take().collect();
            if !master.link().caps().sees_idle {
                // It saw SL = 1 with the next cycle, and not when it came.
                seen.clear();
            }
            if stop() && !live {
                self.settle(&seen);
                return Ok(());
            }
            let slot = match slot {
                Ok(slot) => slot,
                Err(error) => {
                    self.settle(&seen);
                    return Err(error.into());
                }
            };
            match slot {
                Slot::Ended => {
                    self.ended = true;
                    self.settle(&seen);
                    if self.seen == 0 {
                        self.pending = self.piece.take();
                        self.settle(&[]);
                    }
                    return Ok(());
                }
                // What it begins with is what came behind the one before.
                Slot::Piece(cut) => {
                    self.settle(&seen);
                    self.piece.get_or_insert_with(|| Pending {
                        trace: master.trace().clone(),
                        cycle: master.cycle().clone(),
                        seq: 0,
                        cut: Some(cut),
                    });
                }
                Slot::Done { .. } => {
                    self.settle(&seen);
                    if self.chosen == self.args.count {
                        return Ok(());
                    }
                    self.look(master);
                    progress.add(1);
                }
            }
            if stop() {
                self.settle(&[]);
                return Ok(());
            }
        }
    }

    /// Cycles that were asked to be looked at.
    fn looked(&self) -> u64 {
        self.seen.saturating_sub(self.args.skip)
    }

    /// Takes the cycle if it is one of those that are to be drawn.
    fn look(&mut self, master: &Master) {
        let (trace, cycle) = (master.trace(), master.cycle());
        let first_ns = *self.first_ns.get_or_insert(trace.t_ns);
        let seq = self.seen;
        self.seen += 1;
        let early = self
            .args
            .at
            .is_some_and(|at| trace.t_ns.saturating_sub(first_ns) < at.0);
        let passed = self.args.fault && cycle.is_good();
        if self.chosen == 0 && (seq < self.args.skip || early || passed) {
            return;
        }
        self.chosen += 1;
        self.bad += u64::from(!cycle.is_good() || self.says_error(cycle));
        self.pending = Some(Pending {
            trace: trace.clone(),
            cycle: cycle.clone(),
            seq,
            cut: None,
        });
    }

    fn says_error(&self, cycle: &Cycle) -> bool {
        let channels = self.format.map_or(&[][..], Format::channels);
        let mut words = channels.iter().zip(cycle.words());
        words.any(|(channel, word)| {
            let error = word.good().and_then(|data| channel.error(data));
            error == Some(true)
        })
    }

    fn settle(&mut self, behind: &[Change]) {
        let Some(Pending {
            mut trace,
            cycle,
            seq,
            cut,
        }) = self.pending.take()
        else {
            return;
        };
        // A simulated slave shows when SLO changes, though its link samples it with the clock.
        let exact = matches!(self.args.wire.link.kind, Kind::Sim { .. });
        if exact && trace.delay_ns.is_none() {
            trace.delay_ns = Diagram::line_delay_ns(&trace, &cycle);
        }
        let diagram = Diagram::of(&trace, &cycle, self.format, behind);
        let since_ns = trace.t_ns - self.first_ns.unwrap_or(0).min(trace.t_ns);
        self.pictures.push(scope::Picture {
            trace,
            cycle,
            seq,
            cut,
            since_ns,
            diagram,
        });
    }

    /// What the drawing does not say.
    fn explain(&self, stop: &dyn Fn() -> bool) {
        let cycles = |n: u64| match n {
            1 => "1 cycle".to_owned(),
            _ => format!("{n} cycles"),
        };
        if stop() {
            return;
        }
        if self.pictures.is_empty() {
            let seen = cycles(self.seen);
            match (self.args.fault, self.ended) {
                (true, true) => note(format_args!("no fault in this recording: {seen}")),
                (true, false) => note(format_args!(
                    "no fault in {}; --within looks at more",
                    cycles(self.looked())
                )),
                (false, _) => note(format_args!(
                    "the recording ended before that cycle: it has {seen}"
                )),
            }
        } else if self.ended && self.seen > 0 && self.chosen < self.args.count {
            note(format_args!(
                "the recording ended, cycles drawn: {}",
                self.pictures.len()
            ));
        }
        if self.format.is_none() && !self.pictures.is_empty() {
            note("no frame format: fields and values take one, such as -f st26,nE,nW,crc6");
        }
    }
}
