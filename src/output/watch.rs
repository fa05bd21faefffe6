//! What `biss watch` shows, on all of a terminal or as plain lines.

use super::text::symbol;
use super::{Summary, colored, on_terminal, raw, terminal_size, utf8_locale};
use crate::cli::ColorWhen;
use anstyle::{AnsiColor, Style};
use biss::cycle::Word;
use biss::format::{Channel, Format, Kind};
use biss::link::Clock;
use biss::master::Master;
use biss::measure::Scale;
use biss::place::{Count, Counter, Number, Zero};
use biss::unit::Nanos;
use std::collections::VecDeque;
use std::io::{self, Write};
use std::time::Duration;

/// Faults that are remembered with their time.
const FAULTS: usize = 5;

/// Points of the jitter line, one for each time that it is painted.
const POINTS: usize = 60;

/// Rate and speed are means over so long.
const OVER_NS: u64 = 1_000_000_000;

/// So long without a fault, and why there were some is history.
const CALM_NS: u64 = 2_000_000_000;

/// Speeds over less are steps of single counts.
const SPEED_OVER_NS: u64 = 200_000_000;

/// All that is known about the encoder now.
pub(crate) struct View {
    format: Format,
    interval: Nanos,
    clock: Option<Clock>,
    channels: Vec<Show>,
    /// Time of the last cycle.
    now_ns: u64,
    first_ns: Option<u64>,
    /// Start and number of cycles, so far back as the rate looks.
    starts: VecDeque<(u64, u64)>,
    cycles: u64,
    last_ns: Option<u64>,
    last_period_ns: Option<u64>,
    /// The largest jitter since it was painted last, and those before.
    jitter_ns: u64,
    jitters: VecDeque<u64>,
    late_ns: u64,
    ack_clk: Option<u16>,
    delay: Option<Delay>,
    faults: VecDeque<(u64, String)>,
    /// Why they are.
    why: Option<String>,
    /// Counters from which this view counts.
    base: Summary,
}

#[derive(Clone, Copy)]
enum Delay {
    Clocks(u16),
    Nanos(u32),
}

/// How a channel's position is counted and measured.
#[derive(Clone)]
pub(crate) struct Way {
    pub(crate) number: Number,
    pub(crate) scale: Option<Scale>,
    /// What counts as 0 until somebody counts from where it is.
    pub(crate) zero: Zero,
    pub(crate) reverse: bool,
}

impl Way {
    fn counter(&self, unwrap: bool, zero: Zero) -> Counter {
        let count = Count {
            unwrap,
            zero,
            reverse: self.reverse,
        };
        Counter::of(self.number.clone(), count)
    }
}

/// One channel.
struct Show {
    channel: Channel,
    slave: Option<u8>,
    /// None without a position.
    way: Option<Way>,
    /// Where it is within its range.
    place: Option<Counter>,
    /// Follows the position past its rollover, from a zero.
    counter: Option<Counter>,
    /// The last good word, its counts from zero, and when it came.
    last: Option<Last>,
    /// The last cycle had a good word.
    good: bool,
    /// Places of a while, for the speed.
    places: VecDeque<(u64, i128)>,
}

#[derive(Clone, Copy)]
struct Last {
    t_ns: u64,
    data: u64,
    /// From zero; none where the position is beyond its turn.
    counts: Option<i128>,
    /// The same within the range of the encoder's number.
    place: Option<i128>,
}

impl Show {
    fn take(&mut self, t_ns: u64, word: Option<Word>) {
        let sound = word.and_then(|word| word.good());
        self.good = sound.is_some();
        let Some(data) = sound else {
            if let Some(counter) = &mut self.counter {
                counter.miss();
            }
            return;
        };
        let (mut counts, mut place) = (None, None);
        if let (Some(counter), Some(within)) = (&mut self.counter, &mut self.place) {
            if counter.number().is_within(data) {
                let (moved, _) = counter.next(data, t_ns);
                (counts, place) = (Some(moved), Some(within.next(data, t_ns).0));
                self.places.push_back((t_ns, moved));
                while self.places.len() > 2 && t_ns - self.places[0].0 > SPEED_OVER_NS {
                    self.places.pop_front();
                }
            } else {
                counter.miss();
            }
        }
        self.last = Some(Last {
            t_ns,
            data,
            counts,
            place,
        });
    }

    fn zero(&mut self) {
        self.counter = self.way.as_ref().map(|way| way.counter(true, Zero::Here));
        self.places.clear();
        if let (Some(last), Some(counter)) = (&mut self.last, &mut self.counter) {
            if last.counts.is_some() {
                counter.next(last.data, last.t_ns);
                last.counts = Some(0);
            }
        }
    }

    /// Counts a second.
    fn speed(&self) -> Option<f64> {
        let (&(from_ns, from), &(to_ns, to)) = (self.places.front()?, self.places.back()?);
        let seconds = to_ns.saturating_sub(from_ns) as f64 / 1e9;
        (seconds > 0.0).then(|| (to - from) as f64 / seconds)
    }

    fn scale(&self) -> Option<&Scale> {
        self.way.as_ref()?.scale.as_ref()
    }
}

impl View {
    pub(crate) fn new(
        format: &Format,
        slaves: &[u8],
        interval: Nanos,
        ways: Vec<Option<Way>>,
    ) -> View {
        let channels = format.channels().iter().zip(ways).enumerate();
        let channels = channels.map(|(index, (channel, way))| Show {
            // Without a zero of its own it counts from where it is first.
            counter: way.as_ref().map(|way| {
                let here = way.zero == Zero::At(0);
                way.counter(true, if here { Zero::Here } else { way.zero })
            }),
            place: way.as_ref().map(|way| way.counter(false, way.zero)),
            way,
            channel: channel.clone(),
            slave: slaves.get(index).copied(),
            last: None,
            good: false,
            places: VecDeque::new(),
        });
        View {
            channels: channels.collect(),
            format: format.clone(),
            interval,
            clock: None,
            now_ns: 0,
            first_ns: None,
            starts: VecDeque::new(),
            cycles: 0,
            last_ns: None,
            last_period_ns: None,
            jitter_ns: 0,
            jitters: VecDeque::new(),
            late_ns: 0,
            ack_clk: None,
            delay: None,
            faults: VecDeque::new(),
            why: None,
            base: Summary::default(),
        }
    }

    /// How the link runs.
    pub(crate) fn say_how(&mut self, master: &Master) {
        self.clock = Some(master.link().clock());
    }

    /// The cycle that was run last.
    pub(crate) fn take(&mut self, due_ns: Option<u64>, master: &Master) {
        let (trace, cycle) = (master.trace(), master.cycle());
        let t_ns = trace.t_ns;
        self.now_ns = t_ns;
        let first_ns = *self.first_ns.get_or_insert(t_ns);
        self.time(t_ns, due_ns);
        let whole = cycle.fault().is_none();
        for (index, show) in self.channels.iter_mut().enumerate() {
            let word = cycle.words().get(index).filter(|_| whole);
            show.take(t_ns, word.copied());
        }
        if let Some(head) = cycle.head().filter(|_| cycle.is_good()) {
            self.ack_clk = Some(head.ack);
            let clocks = Delay::Clocks(head.delay_clk);
            self.delay = Some(trace.delay_ns.map_or(clocks, Delay::Nanos));
        }
        let words = cycle.words().iter().filter_map(Word::fault);
        for fault in cycle.fault().into_iter().chain(words) {
            self.faults
                .push_back((t_ns - first_ns, format!("fault {fault}")));
            if self.faults.len() > FAULTS {
                self.faults.pop_front();
            }
        }
    }

    /// Why frames are bad.
    pub(crate) fn why(&mut self, why: &str) {
        self.why = Some(why.to_owned());
    }

    fn time(&mut self, t_ns: u64, due_ns: Option<u64>) {
        self.cycles += 1;
        self.starts.push_back((t_ns, self.cycles));
        while self.starts.len() > 2 && t_ns - self.starts[0].0 > OVER_NS {
            self.starts.pop_front();
        }
        if let Some(last) = self.last_ns.replace(t_ns) {
            let period = t_ns.saturating_sub(last);
            if let Some(before) = self.last_period_ns.replace(period) {
                self.jitter_ns = self.jitter_ns.max(period.abs_diff(before));
            }
        }
        if let Some(due_ns) = due_ns {
            self.late_ns = self.late_ns.max(t_ns.saturating_sub(due_ns));
        }
    }

    /// The next point of the jitter line.
    fn point(&mut self) {
        self.jitters.push_back(std::mem::take(&mut self.jitter_ns));
        if self.jitters.len() > POINTS {
            self.jitters.pop_front();
        }
    }

    /// Counts from where every channel is.
    pub(crate) fn zero(&mut self) {
        self.channels.iter_mut().for_each(Show::zero);
    }

    /// Counters and faults begin anew.
    pub(crate) fn begin_anew(&mut self, summary: &Summary) {
        self.base = summary.clone();
        self.faults.clear();
        self.why = None;
        self.late_ns = 0;
        self.jitters.clear();
    }

    fn rate_hz(&self) -> Option<f64> {
        let (&(from_ns, from), &(to_ns, to)) = (self.starts.front()?, self.starts.back()?);
        let seconds = to_ns.saturating_sub(from_ns) as f64 / 1e9;
        (seconds > 0.0).then(|| (to - from) as f64 / seconds)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Tone {
    Plain,
    Bold,
    Faint,
    Good,
    Warning,
    Bad,
}

/// Runs of text of one tone.
#[derive(Default)]
struct Line(Vec<(String, Tone)>);

/// As many lines as it needs, broken between words where they are not longer than a line.
fn wrapped(text: &str, width: usize) -> impl Iterator<Item = String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let line = lines.last_mut().filter(|line| {
            let used = line.chars().count();
            used == 0 || used + 1 + word.chars().count() <= width
        });
        match line {
            Some(line) if line.is_empty() => line.push_str(word),
            Some(line) => {
                line.push(' ');
                line.push_str(word);
            }
            None => lines.push(format!("  {word}")),
        }
    }
    lines.into_iter()
}

impl Line {
    fn plain(text: impl Into<String>) -> Line {
        Line(vec![(text.into(), Tone::Plain)])
    }

    fn add(&mut self, text: impl Into<String>, tone: Tone) {
        self.0.push((text.into(), tone));
    }

    /// No longer than this.
    fn write(&self, out: &mut String, width: usize, color: bool) {
        let mut left = width;
        for (text, tone) in &self.0 {
            let text: String = text.chars().take(left).collect();
            left -= text.chars().count();
            let style = match tone {
                Tone::Plain => None,
                Tone::Bold => Some(Style::new().bold()),
                Tone::Faint => Some(Style::new().dimmed()),
                Tone::Good => Some(AnsiColor::Green.on_default()),
                Tone::Warning => Some(AnsiColor::Yellow.on_default()),
                Tone::Bad => Some(AnsiColor::Red.on_default()),
            };
            match style.filter(|_| color && !text.is_empty()) {
                Some(style) => out.push_str(&format!("{style}{text}{style:#}")),
                None => out.push_str(&text),
            }
        }
    }
}

/// How it is drawn.
#[derive(Clone, Copy)]
struct Look {
    width: usize,
    unicode: bool,
}

impl Look {
    fn symbol(self, scale: &Scale) -> &'static str {
        symbol(scale.unit(), if self.unicode { "°" } else { " deg" })
    }
}

impl View {
    fn lines(&self, summary: &Summary, look: Look) -> Vec<Line> {
        let mut lines = Vec::new();
        let mut head = Line::default();
        head.add(format!("{}", self.format), Tone::Bold);
        if let Some(clock) = self.clock {
            head.add(format!("  MA {clock}"), Tone::Plain);
        }
        lines.push(head);
        lines.push(Line::default());
        for (index, show) in self.channels.iter().enumerate() {
            self.channel(index, show, look, &mut lines);
        }
        self.timing(summary, look, &mut lines);
        self.counters(summary, &mut lines);
        if !self.faults.is_empty() {
            lines.push(Line::default());
        }
        for (since_ns, fault) in self.faults.iter().rev() {
            let mut line = Line::plain(format!("{:10.3} s  ", *since_ns as f64 / 1e9));
            line.add(fault.as_str(), Tone::Bad);
            lines.push(line);
        }
        self.reasons(look, &mut lines);
        let mut keys = Line::default();
        keys.add("z count from here   r counters anew   q end", Tone::Faint);
        lines.extend([Line::default(), keys]);
        lines
    }

    /// What was seen, and what to do about it; and whether that is over.
    fn reasons(&self, look: Look, lines: &mut Vec<Line>) {
        let Some(why) = &self.why else {
            return;
        };
        let last_ns = self.faults.back().map_or(0, |(since_ns, _)| *since_ns);
        let good_ns = self
            .now_ns
            .saturating_sub(self.first_ns.unwrap_or(0))
            .saturating_sub(last_ns);
        let over = good_ns >= CALM_NS;
        if over {
            let good_s = good_ns / 1_000_000_000;
            lines.push(Line::plain(format!("no fault for {good_s} s; it was:")));
        }
        let tone = if over { Tone::Faint } else { Tone::Plain };
        for part in why.split("; ") {
            lines.extend(wrapped(part, look.width).map(|text| Line(vec![(text, tone)])));
        }
    }

    fn channel(&self, index: usize, show: &Show, look: Look, lines: &mut Vec<Line>) {
        let mut line = Line::default();
        if self.channels.len() > 1 {
            line.add(format!("ch {index}  "), Tone::Plain);
        }
        if let Some(slave) = show.slave.filter(|_| self.channels.len() > 1) {
            line.add(format!("slave {slave}  "), Tone::Plain);
        }
        let Some(last) = show.last else {
            line.add("no good frame yet", Tone::Bad);
            lines.extend([line, Line::default()]);
            return;
        };
        let tone = if show.good { Tone::Bold } else { Tone::Faint };
        for field in show.channel.fields() {
            let value = field.get(last.data);
            match field.kind() {
                Kind::Turn => line.add(format!("turn {value}  "), tone),
                Kind::SingleTurn | Kind::Position => line.add(format!("pos {value}  "), tone),
                Kind::Data(name) => line.add(format!("{name} {value}  "), tone),
                _ => {}
            }
        }
        if let (Some(scale), Some(place)) = (show.scale(), last.place) {
            let (value, digits) = scale.value(place, false);
            line.add(format!("{value:.digits$}{}  ", look.symbol(scale)), tone);
        }
        match show.good {
            false => {
                let ago = self.now_ns.saturating_sub(last.t_ns) as f64 / 1e9;
                line.add(format!("last good one {ago:.1} s ago"), Tone::Bad);
            }
            true if show.channel.error(last.data) == Some(true) => line.add("error", Tone::Bad),
            true if show.channel.warning(last.data) == Some(true) => {
                line.add("warning", Tone::Warning);
            }
            true => line.add("ok", Tone::Good),
        }
        lines.push(line);
        if let Some(way) = &show.way {
            lines.push(Line::plain(bar(show, &way.number, last.data, look)));
            lines.push(speed(show, last, look));
        }
        lines.push(Line::default());
    }

    fn timing(&self, summary: &Summary, look: Look, lines: &mut Vec<Line>) {
        let asked = 1e9 / self.interval.0.max(1) as f64;
        let mut line = Line::plain(format!("rate {:.1} of ", self.rate_hz().unwrap_or(0.0)));
        line.add(format!("{asked:.1} frames/s"), Tone::Plain);
        let skipped = summary.skipped - self.base.skipped;
        line.add(
            format!("   skipped {skipped}"),
            if skipped > 0 {
                Tone::Warning
            } else {
                Tone::Plain
            },
        );
        line.add(format!("   latest {}", short(self.late_ns)), Tone::Plain);
        lines.push(line);
        let most = self.jitters.iter().copied().max().unwrap_or(0);
        let mut line = Line::plain("jitter ");
        line.add(spark(&self.jitters, most, look), Tone::Good);
        line.add(format!("  {} at most", short(most)), Tone::Plain);
        lines.push(line);
        let mut line = Line::default();
        if let Some(ack) = self.ack_clk {
            line.add(format!("ack {ack} clk   "), Tone::Plain);
        }
        match self.delay {
            Some(Delay::Clocks(clocks)) => {
                line.add(format!("line delay {clocks} clk"), Tone::Plain)
            }
            Some(Delay::Nanos(ns)) => line.add(format!("line delay {ns} ns"), Tone::Plain),
            None => {}
        }
        lines.push(line);
    }

    fn counters(&self, summary: &Summary, lines: &mut Vec<Line>) {
        let since = summary.since(&self.base);
        let mut line = Line::plain(match since.cycles {
            1 => format!("1 frame, {} good", since.good),
            cycles => format!("{cycles} frames, {} good", since.good),
        });
        for (name, count) in since.kinds() {
            line.add(format!(", {count} {name}"), Tone::Bad);
        }
        for (count, name, tone) in [
            (since.error, "error", Tone::Bad),
            (since.warning, "warning", Tone::Warning),
            (since.retries, "retries", Tone::Plain),
        ] {
            if count > 0 {
                line.add(format!(", {count} {name}"), tone);
            }
        }
        lines.push(line);
    }

    /// For whoever reads it later.
    fn line(&self, summary: &Summary) -> String {
        let since_ns = self.now_ns - self.first_ns.unwrap_or(self.now_ns);
        let mut line = format!("{:10.3}", since_ns as f64 / 1e9);
        let several = self.channels.len() > 1;
        for (index, show) in self.channels.iter().enumerate() {
            if several {
                line.push_str(&format!("  ch {index}"));
            }
            let Some(last) = show.last.filter(|_| show.good) else {
                line.push_str("  bad");
                continue;
            };
            for field in show.channel.fields() {
                match field.kind() {
                    Kind::Turn => line.push_str(&format!("  turn {}", field.get(last.data))),
                    Kind::SingleTurn | Kind::Position => {
                        line.push_str(&format!("  pos {}", field.get(last.data)));
                    }
                    _ => {}
                }
            }
            if let Some(speed) = show.speed() {
                line.push_str(&format!("  {speed:.0} counts/s"));
            }
        }
        format!("{line}  {summary}\n")
    }
}

/// Where in its range a position is.
fn bar(show: &Show, number: &Number, data: u64, look: Look) -> String {
    let (value, most) = match show.channel.position() {
        Some(field) if *field.kind() == Kind::SingleTurn => {
            let turns = number.of_one_turn();
            (turns.get(data), turns.most())
        }
        _ => (number.get(data), number.most()),
    };
    let room = look.width.saturating_sub(4).clamp(4, 72);
    let at = (u128::from(value) * room as u128 / (u128::from(most) + 1)) as usize;
    let (rail, mark) = if look.unicode {
        ("─", "●")
    } else {
        ("-", "#")
    };
    let (before, after) = (rail.repeat(at), rail.repeat(room - at - 1));
    let (left, right) = if look.unicode {
        ("├", "┤")
    } else {
        ("|", "|")
    };
    format!("{left}{before}{mark}{after}{right}")
}

fn speed(show: &Show, last: Last, look: Look) -> Line {
    let speed = show.speed().unwrap_or(0.0);
    let mut line = Line::plain(format!("speed {speed:+.0} counts/s"));
    let scale = show.scale();
    match scale.map(|scale| (scale, scale.turn())) {
        Some((_, Some(turn))) => line.add(format!("  {:+.3} turns/s", speed / turn), Tone::Plain),
        Some((scale, None)) => {
            let rate = scale.of_counts(speed);
            line.add(format!("  {rate:+.3}{}/s", look.symbol(scale)), Tone::Plain);
        }
        None => {}
    }
    let Some(counts) = last.counts else {
        return line;
    };
    line.add(format!("   from zero {counts:+}"), Tone::Plain);
    if let Some(scale) = scale {
        let (value, digits) = scale.value(counts, true);
        let symbol = look.symbol(scale);
        line.add(format!("  {value:+.digits$}{symbol}"), Tone::Plain);
    }
    line
}

/// A time with the digits that fit.
fn short(ns: u64) -> String {
    match ns {
        0..1_000 => format!("{ns} ns"),
        1_000..1_000_000 => format!("{:.1} us", ns as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} ms", ns as f64 / 1e6),
        _ => format!("{:.1} s", ns as f64 / 1e9),
    }
}

/// The newest point is on the right.
fn spark(points: &VecDeque<u64>, most: u64, look: Look) -> String {
    const STEPS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    const ASCII: [char; 8] = ['_', '.', ',', '-', '=', '+', '*', '#'];
    let steps = if look.unicode { STEPS } else { ASCII };
    let room = look.width.saturating_sub(28).clamp(1, POINTS);
    let from = points.len().saturating_sub(room);
    let step = |ns: &u64| match most {
        0 => steps[0],
        most => steps[(u128::from(*ns) * 7 / u128::from(most)) as usize],
    };
    points.range(from..).map(step).collect()
}

/// What begins and ends a picture on all of the terminal: its other screen, without a cursor.
const BEGIN: &str = "\x1b[?1049h\x1b[?25l";
const END: &[u8] = b"\x1b[?25h\x1b[?1049l";

/// Paints it, or prints it line by line.
pub(crate) struct Painter {
    out: Box<dyn Write>,
    screen: bool,
    color: bool,
    unicode: bool,
}

impl Painter {
    /// On all of the terminal where there is one.
    pub(crate) fn new(ascii: bool, color: ColorWhen) -> Painter {
        Painter {
            out: raw(),
            screen: on_terminal(),
            color: colored(color),
            unicode: !ascii && utf8_locale(),
        }
    }

    /// Undoes [`Painter::begin`].
    pub(crate) const END: &'static [u8] = END;

    /// Takes the other screen.
    pub(crate) fn begin(&mut self) -> io::Result<()> {
        self.out.write_all(BEGIN.as_bytes())?;
        self.out.flush()
    }

    pub(crate) fn is_screen(&self) -> bool {
        self.screen
    }

    /// From one picture to the next.
    pub(crate) fn period(&self) -> Duration {
        match self.screen {
            true => Duration::from_millis(100),
            false => Duration::from_secs(1),
        }
    }

    pub(crate) fn paint(&mut self, view: &mut View, summary: &Summary) -> io::Result<()> {
        view.point();
        if !self.screen {
            self.out.write_all(view.line(summary).as_bytes())?;
            return self.out.flush();
        }
        let (width, height) = terminal_size();
        let look = Look {
            width,
            unicode: self.unicode,
        };
        let mut text = String::from("\x1b[H");
        for (index, line) in view.lines(summary, look).iter().take(height).enumerate() {
            if index > 0 {
                text.push_str("\r\n");
            }
            line.write(&mut text, width, self.color);
            text.push_str("\x1b[K");
        }
        text.push_str("\x1b[J");
        self.out.write_all(text.as_bytes())?;
        self.out.flush()
    }
}
