//! `biss read`: frames, one after the other or one a slot.

use super::asked::{NO_FRAME, check, choose_frame, live_only, look};
use super::auto;
use super::beside::Beside;
use super::capture::Sink;
use super::counting::{Counting, Measuring};
use super::line::Line;
use super::overheard::Eavesdropper;
use super::poll::{self, Audience, Gap, Poll, Turn, is_broken_pipe, recorded, writing};
use super::{Ended, Outcome};
use crate::cli::{self, Wanted};
use crate::output::heard::Overheard;
use crate::output::{Look, Printer, Shot, Summary};
use crate::sys::Signals;
use anyhow::{Result, bail};
use biss::link::Link;
use biss::master::{Master, Try};
use biss::preset::Frame;
use std::cell::RefCell;
use std::rc::Rc;
use std::time::{SystemTime, UNIX_EPOCH};

pub(crate) fn run(args: cli::Read, frame_given: bool) -> Result<Ended> {
    let Some(wanted) = choose_frame(args.framed.frame.as_ref(), &args.wire.link, frame_given)
    else {
        bail!(NO_FRAME);
    };
    check(&args.wire, &args.polling)?;
    let unix = args.time == cli::TimeStyle::Unix;
    live_only(&args.wire, &[("--time unix", unix)])?;
    match wanted {
        Wanted::Given(frame) => run_given(args, frame, None),
        Wanted::Auto => run_auto(&args),
    }
}

/// Reads frames of a format that was written down, which does not say whose channels they are.
pub(super) fn run_given(mut args: cli::Read, frame: Frame, sink: Option<Sink>) -> Result<Ended> {
    let mut plan = Plan::of(&args, frame, Vec::new(), sink)?;
    // What was read shall be seen before more of a slow pipe is waited for. Errors come back with the next record.
    let flush = {
        let printer = Rc::clone(&plan.printer);
        move || drop(printer.borrow_mut().flush())
    };
    let interval = args.polling.interval;
    let (link, signals) = match poll::open(&mut args.wire, interval, &plan.frame, flush)? {
        Ok(opened) => opened,
        Err(ended) => return Ok(ended),
    };
    let link = match &mut plan.sink {
        Some(sink) => sink.tap(link),
        None => link,
    };
    plan.run(&args, link, signals)
}

/// Asks the slaves what they send, and reads that.
fn run_auto(args: &cli::Read) -> Result<Ended> {
    let answer = match auto::ask_frame(&args.wire)? {
        Ok(answer) => answer,
        Err(ended) => return Ok(ended),
    };
    let plan = Plan::of(args, answer.frame, answer.slaves, None)?;
    plan.run(args, answer.link, answer.signals)
}

/// What is read, and how it is counted and shown.
struct Plan {
    frame: Frame,
    /// The slave of each channel; none where nobody has said.
    slaves: Vec<u8>,
    counting: Option<Counting>,
    measuring: Measuring,
    beside: Option<Beside>,
    /// Where both wires are written to.
    sink: Option<Sink>,
    printer: Rc<RefCell<Printer>>,
}

impl Plan {
    fn of(args: &cli::Read, frame: Frame, slaves: Vec<u8>, sink: Option<Sink>) -> Result<Plan> {
        let counting = Counting::asked(args, &frame.format)?;
        let measuring = Measuring::asked(args, &frame.format)?;
        let beside = Beside::asked(args)?;
        let look = match &sink {
            Some(sink) if !sink.prints() => Look::Nothing,
            _ => look(
                args,
                &frame.format,
                !slaves.is_empty(),
                counting.is_some(),
                measuring.scales(),
            )?,
        };
        let printer = Printer::new(look, args.time, args.color, args.wire.verbose);
        Ok(Plan {
            frame,
            slaves,
            counting,
            measuring,
            beside,
            sink,
            printer: Rc::new(RefCell::new(printer)),
        })
    }

    fn run(self, args: &cli::Read, mut link: Box<dyn Link>, signals: Signals) -> Result<Ended> {
        let mut protocol = Line::of(&args.wire, None).protocol(self.frame.format);
        if let Some(sink) = &self.sink {
            sink.shape(&mut protocol);
        }
        let live = link.caps().live;
        // Without a number of frames, as many as registers take.
        let usual = u64::from(live && self.beside.is_none());
        let poll = Poll::new(
            (&args.wire, &args.polling),
            self.frame.preset,
            &protocol,
            signals,
            usual,
        );
        let run = Run {
            format: args.format,
            once: self.beside.is_some() && args.polling.count.is_none(),
            beside: self.beside,
            sink: self.sink,
            out: Out {
                counting: self.counting,
                measuring: self.measuring,
                slaves: self.slaves,
                printer: self.printer,
                eavesdropper: recorded(&args.wire).then(Eavesdropper::default),
            },
        };
        run.all(args, poll, link.as_mut())
    }
}

/// Everybody who looks at the frames.
struct Run {
    beside: Option<Beside>,
    /// How a summary looks.
    format: cli::OutputFormat,
    /// All registers once, and nothing else was asked for.
    once: bool,
    sink: Option<Sink>,
    out: Out,
}

impl Run {
    fn all(mut self, args: &cli::Read, mut poll: Poll, link: &mut dyn Link) -> Result<Ended> {
        let live = link.caps().live;
        let stop = poll.signals.watch();
        let ear = self.sink.as_ref().and_then(Sink::ear);
        let hear = |tried: &Try| ear.iter().for_each(|ear| ear.hear(tried));
        let mut master = poll.master(link, &stop);
        if ear.is_some() {
            master.show_tries(&hear);
        }
        let printer = Rc::clone(&self.out.printer);
        printer.borrow_mut().header().map_err(writing)?;
        if let Err(error) = poll.open(&mut master, &mut self) {
            return poll.give_up(error);
        }
        let unix_us = unix_us() - i128::from(master.link().now_ns()) / 1000;
        printer.borrow_mut().epoch(unix_us);
        if let Some(beside) = &mut self.beside {
            beside.go_on(&mut master)?;
        }
        let mut result = Ok(());
        if let Some(sink) = &mut self.sink {
            result = sink.begin(&mut master, poll.protocol);
        }
        if result.is_ok() {
            result = poll.frames(&mut master, &mut self);
        }
        if let Some(sink) = &mut self.sink {
            // After an error too: what was captured before it shall be whole.
            let ended = sink.end(&mut master, result.is_ok());
            result = result.and(ended);
        }
        let result = result.and_then(|()| printer.borrow_mut().flush().map_err(writing));
        if !result.as_ref().is_err_and(is_broken_pipe) {
            poll.say_ended(live);
            // What is captured shall be what was asked for.
            let well = result.is_ok() && self.sink.is_none();
            drop(master);
            poll.explain(link, well);
            if !args.wire.quiet && (poll.count() != 1 || args.wire.verbose) {
                poll.summary.print(args.format);
            }
        }
        let mut ended = poll.ended(result)?;
        if self.beside.is_some_and(|beside| beside.is_bad()) {
            ended.outcome = Outcome::Bad;
        }
        Ok(ended)
    }
}

impl Audience for Run {
    fn cycle(&mut self, turn: &Turn, _: &Summary, master: &mut Master) -> Result<()> {
        if let Some(sink) = &mut self.sink {
            sink.cycle(master)?;
        }
        self.out.shot(turn, master)?;
        self.out.overhear(turn.seq, master)?;
        if let Some(beside) = &mut self.beside {
            for record in beside.look(master)? {
                let mut printer = self.out.printer.borrow_mut();
                printer.register(&record).map_err(writing)?;
            }
        }
        Ok(())
    }

    fn gap(&mut self, seq: u64, gap: Gap, master: &Master) -> Result<()> {
        match gap {
            Gap::Piece => {
                self.out.lost(seq, "a frame was not whole")?;
                match &mut self.sink {
                    Some(sink) => sink.cycle(master),
                    None => Ok(()),
                }
            }
            Gap::Ended => self.out.lost(seq, "the recording ended"),
        }
    }

    fn flush(&mut self) -> Result<()> {
        self.out.printer.borrow_mut().flush().map_err(writing)?;
        match &mut self.sink {
            Some(sink) => sink.flush(),
            None => Ok(()),
        }
    }

    fn report(&mut self, summary: &Summary) {
        summary.print(self.format);
    }

    fn enough(&self) -> bool {
        let rounds = self.beside.as_ref().map_or(0, Beside::rounds);
        self.once && rounds > 0
    }
}

/// Where frames become records.
struct Out {
    counting: Option<Counting>,
    measuring: Measuring,
    /// The slave ID of each channel, or none.
    slaves: Vec<u8>,
    printer: Rc<RefCell<Printer>>,
    /// Of recordings, which somebody else has made.
    eavesdropper: Option<Eavesdropper>,
}

impl Out {
    fn shot(&mut self, turn: &Turn, master: &Master) -> Result<()> {
        let (format, cycle, trace) = (master.format(), master.cycle(), master.trace());
        self.measuring.look(cycle);
        let counted = self.counting.as_mut();
        let shot = Shot {
            format,
            cycle,
            trace,
            t_ns: trace.t_ns,
            seq: turn.seq,
            tries: turn.tries,
            counted: counted.map(|counting| counting.next(format, cycle, trace.t_ns)),
            scales: self.measuring.scales(),
            slaves: &self.slaves,
        };
        self.printer.borrow_mut().shot(&shot).map_err(writing)
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
}

pub(super) fn unix_us() -> i128 {
    let since = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default();
    since.as_micros() as i128
}
