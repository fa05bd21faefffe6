//! `biss stats`: many frames in a few numbers.

use super::Ended;
use super::auto::Answer;
use super::line::Line;
use super::poll::{self, Audience, Gap, Poll, Turn, is_broken_pipe, writing};
use crate::cli::{self, ReportFormat, STATS_FRAMES};
use crate::output::stats::Report;
use crate::output::{Summary, answer};
use anyhow::Result;
use biss::master::Master;
use biss::measure::{number, scales};
use biss::stats::{Due, Stats};

pub(crate) fn run(mut args: cli::Stats, frame_given: bool) -> Result<Ended> {
    let frame = args.framed.frame.take();
    match poll::start(&mut args.wire, &args.polling, frame.as_ref(), frame_given)? {
        Ok(answer) => measure(&args, answer),
        Err(ended) => Ok(ended),
    }
}

fn measure(args: &cli::Stats, start: Answer) -> Result<Ended> {
    let Answer {
        frame,
        slaves,
        mut link,
        signals,
    } = start;
    let protocol = Line::of(&args.wire, None).protocol(frame.format);
    let live = link.caps().live;
    let cli::Measure { resolution, unit } = args.measure;
    let scales = scales(&protocol.format, unit, resolution)?;
    let channels = protocol.format.channels().iter();
    let numbers = channels.map(|channel| number(channel, resolution));
    let numbers: Vec<_> = numbers.collect::<Result<_, _>>()?;
    let usual = if live { STATS_FRAMES } else { 0 };
    let asked = (&args.wire, &args.polling);
    let mut poll = Poll::new(asked, frame.preset, &protocol, signals, usual);
    let stop = poll.signals.watch();
    let mut master = poll.master(link.as_mut(), &stop);
    let mut meter = Meter {
        report: Report {
            stats: Stats::of(numbers.into_iter()),
            format: protocol.format.clone(),
            slaves,
            scales,
            interval: args.polling.interval,
            clock_limit: frame.preset.and_then(|preset| preset.clock_max),
            margin_eighths: None,
        },
        wanted: args.format,
    };
    if let Err(error) = poll.open(&mut master, &mut meter) {
        return poll.give_up(error);
    }
    // Before the frames, as it runs some of its own; an absent encoder has none.
    if master.learned().is_some() {
        meter.report.margin_eighths = master.margin()?;
    }
    let result = poll.frames(&mut master, &mut meter);
    drop(master);
    poll.explain(link.as_mut(), result.is_ok());
    // After an error too: what was measured before it has been measured.
    let mut told = Ok(());
    if result.is_ok() || poll.summary.cycles > 0 {
        let text = meter.report.render(&poll.summary, args.format)?;
        told = answer(&text).map_err(writing);
    }
    let result = result.and(told);
    if !result.as_ref().is_err_and(is_broken_pipe) {
        poll.say_ended(live);
    }
    poll.ended(result)
}

/// Counts and measures.
struct Meter {
    report: Report,
    wanted: ReportFormat,
}

impl Audience for Meter {
    fn cycle(&mut self, turn: &Turn, _: &Summary, master: &mut Master) -> Result<()> {
        let interval = self.report.interval;
        let due = turn.due_ns.zip(interval).map(|(at_ns, interval)| Due {
            at_ns,
            interval_ns: interval.0,
        });
        let (trace, cycle) = (master.trace(), master.cycle());
        self.report.stats.add(trace, cycle, master.format(), due);
        Ok(())
    }

    fn gap(&mut self, _seq: u64, _gap: Gap, _master: &Master) -> Result<()> {
        self.report.stats.gap();
        Ok(())
    }

    fn flush(&mut self) -> Result<()> {
        Ok(())
    }

    fn report(&mut self, summary: &Summary) {
        self.report.say(summary, self.wanted);
    }
}
