//! `biss watch`: a live view for the bench.

use super::Ended;
use super::auto::Answer;
use super::line::Line;
use super::poll::{self, Audience, Gap, Poll, Turn, is_broken_pipe, recorded, writing};
use crate::cli::{self, OutputFormat};
use crate::output::watch::{Painter, View, Way};
use crate::output::{Summary, note};
use crate::sys::Terminal;
use anyhow::{Result, anyhow, bail};
use biss::format::Format;
use biss::master::Master;
use biss::measure::{number, scales};
use biss::place::Zero;
use biss::unit::Nanos;
use std::time::{Duration, Instant};

/// Where the user has not said another one: smooth to look at, and little to do.
const INTERVAL: Nanos = Nanos(10_000_000);

pub(crate) fn run(mut args: cli::Watch, frame_given: bool) -> Result<Ended> {
    if recorded(&args.wire) {
        bail!(
            "a recording is over at once, there is nothing to watch\n  \
             biss read prints its frames, biss stats sums them up, biss scope draws them"
        );
    }
    args.polling.interval.get_or_insert(INTERVAL);
    let frame = args.framed.frame.take();
    match poll::start(&mut args.wire, &args.polling, frame.as_ref(), frame_given)? {
        Ok(answer) => watch(&args, answer),
        Err(ended) => Ok(ended),
    }
}

fn watch(args: &cli::Watch, answer: Answer) -> Result<Ended> {
    let Answer {
        frame,
        slaves,
        mut link,
        signals,
    } = answer;
    let protocol = Line::of(&args.wire, None).protocol(frame.format);
    let ways = ways(args, &protocol.format)?;
    let asked = (&args.wire, &args.polling);
    let mut poll = Poll::new(asked, frame.preset, &protocol, signals, 0);
    let stop = poll.signals.watch();
    let mut master = poll.master(link.as_mut(), &stop);
    let interval = args.polling.interval.unwrap_or(INTERVAL);
    let mut eye = Eye {
        view: View::new(&protocol.format, &slaves, interval, ways),
        painter: Painter::new(args.ascii, args.color),
        terminal: None,
        due: Instant::now(),
        painted: 0,
        over: false,
    };
    if let Err(error) = poll.open(&mut master, &mut eye) {
        return poll.give_up(error);
    }
    eye.view.say_how(&master);
    eye.begin()?;
    let result = poll.frames(&mut master, &mut eye);
    let result = result.and_then(|()| match eye.painted == poll.summary.cycles {
        true => Ok(()),
        false => eye.paint(&poll.summary),
    });
    // Gives the terminal back, before anything else is said.
    eye.terminal = None;
    if !result.as_ref().is_err_and(is_broken_pipe) && !args.wire.quiet {
        poll.reasons(true).iter().for_each(note);
        poll.summary.print(OutputFormat::Text);
    }
    poll.ended(result)
}

/// How every channel is counted and measured.
fn ways(args: &cli::Watch, format: &Format) -> Result<Vec<Option<Way>>> {
    let cli::Measure { resolution, unit } = args.measure;
    let named = args.wire.named.as_deref();
    let scales = scales(format, unit, resolution)?;
    let channels = format.channels().iter().zip(scales);
    let way = |(channel, scale)| {
        let number = number(channel, resolution)?;
        Ok(number.map(|number| Way {
            number,
            scale,
            zero: named.and_then(|named| named.zero).unwrap_or(Zero::At(0)),
            reverse: named.is_some_and(|named| named.reverse),
        }))
    };
    channels.map(way).collect()
}

/// Looks at all frames, and paints now and then.
struct Eye {
    view: View,
    painter: Painter,
    /// Where it paints on all of one.
    terminal: Option<Terminal>,
    due: Instant,
    /// As many cycles were counted when it was painted last.
    painted: u64,
    /// Whoever looks has seen enough.
    over: bool,
}

impl Eye {
    fn begin(&mut self) -> Result<()> {
        if self.painter.is_screen() {
            let terminal = Terminal::take(Painter::END).map_err(|e| {
                anyhow!("taking the terminal: {e}\n  `biss watch … | cat` prints plain lines")
            })?;
            self.terminal = Some(terminal);
            self.painter.begin().map_err(writing)?;
        }
        Ok(())
    }

    fn paint(&mut self, summary: &Summary) -> Result<()> {
        self.due = Instant::now() + self.painter.period();
        self.painted = summary.cycles;
        if let Some(terminal) = &self.terminal {
            while let Some(key) = terminal.key() {
                match key {
                    b'q' => self.over = true,
                    b'z' => self.view.zero(),
                    b'r' => self.view.begin_anew(summary),
                    _ => {}
                }
            }
            if !terminal.is_taken() {
                // It belongs to somebody else again.
                return Ok(());
            }
            if terminal.stop_if_asked() {
                self.painter.begin().map_err(writing)?;
            }
        }
        self.painter.paint(&mut self.view, summary).map_err(writing)
    }
}

impl Audience for Eye {
    fn cycle(&mut self, turn: &Turn, summary: &Summary, master: &mut Master) -> Result<()> {
        self.view.take(turn.due_ns, master);
        match Instant::now() >= self.due {
            true => self.paint(summary),
            false => Ok(()),
        }
    }

    fn gap(&mut self, _seq: u64, _gap: Gap, _master: &Master) -> Result<()> {
        Ok(())
    }

    fn flush(&mut self) -> Result<()> {
        Ok(())
    }

    fn report(&mut self, summary: &Summary) {
        if self.terminal.is_none() {
            note(summary);
        }
    }

    fn why(&mut self, why: &str) {
        match self.terminal {
            Some(_) => self.view.why(why),
            None => note(why),
        }
    }

    fn waiting(&mut self, summary: &Summary) -> Result<()> {
        match Instant::now() >= self.due && self.terminal.is_some() {
            true => self.paint(summary),
            false => Ok(()),
        }
    }

    fn patience(&self) -> Duration {
        self.painter.period()
    }

    fn enough(&self) -> bool {
        self.over
    }
}
