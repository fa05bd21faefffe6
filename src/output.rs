//! Records on stdout, everything else on stderr. The only place that prints.

pub(crate) mod list;

use crate::cli::{ColorWhen, OutputFormat, TimeStyle};
use anstyle::{AnsiColor, Style};
use biss::cycle::{Cycle, Fault, Word};
use biss::format::{Channel, Format, Kind};
use biss::trace::Trace;
use serde::ser::{Serialize, SerializeMap, Serializer};
use std::fmt::Display;
use std::io::{self, Write};
use std::time::{Duration, Instant};

/// Says something on stderr.
pub(crate) fn note(text: impl Display) {
    let line = format!("biss: {text}\n");
    // Nobody is left to tell when stderr is gone.
    let _ = io::stderr().lock().write_all(line.as_bytes());
}

/// Writes a whole answer to stdout.
pub(crate) fn answer(text: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    out.write_all(text.as_bytes())?;
    out.flush()
}

/// What a record is made of.
#[derive(Clone, Copy)]
pub(crate) struct Shot<'a> {
    pub(crate) format: &'a Format,
    pub(crate) cycle: &'a Cycle,
    pub(crate) trace: &'a Trace,
    /// Time of the cycle on the link's clock.
    pub(crate) t_ns: u64,
    pub(crate) seq: u64,
    /// Cycles it took; none for a recording.
    pub(crate) tries: Option<u32>,
}

/// Writes records in one format.
pub(crate) struct Printer {
    out: io::BufWriter<io::Stdout>,
    line: Vec<u8>,
    format: OutputFormat,
    stamp: Stamp,
    color: bool,
    degree: &'static str,
    /// Add the bits to each record.
    verbose: bool,
    flushed: Instant,
}

/// How records show their time.
#[derive(Clone, Copy, Debug)]
struct Stamp {
    style: TimeStyle,
    first_ns: Option<u64>,
    last_ns: u64,
    /// Microseconds since 1970 at link time 0.
    unix_us: i128,
}

#[derive(Clone, Copy, Debug)]
enum Time {
    Zero(u64),
    Delta(u64),
    Unix(i128),
    None,
}

/// Records reach a reader this fast even when frames come without a pause.
const FLUSH_EVERY: Duration = Duration::from_millis(50);

impl Printer {
    /// For records of one format.
    pub(crate) fn new(
        format: OutputFormat,
        style: TimeStyle,
        color: ColorWhen,
        verbose: bool,
    ) -> Printer {
        let color = format == OutputFormat::Text
            && match color {
                ColorWhen::Always => true,
                ColorWhen::Never => false,
                ColorWhen::Auto => {
                    anstream::AutoStream::choice(&io::stdout()) != anstream::ColorChoice::Never
                }
            };
        Printer {
            out: io::BufWriter::with_capacity(1 << 16, io::stdout()),
            line: Vec::with_capacity(1 << 12),
            format,
            stamp: Stamp {
                style,
                first_ns: None,
                last_ns: 0,
                unix_us: 0,
            },
            color,
            degree: if utf8_locale() { "°" } else { "deg" },
            verbose,
            flushed: Instant::now(),
        }
    }

    /// Time 0 of the link's clock, in microseconds since 1970.
    pub(crate) fn epoch(&mut self, unix_us: i128) {
        self.stamp.unix_us = unix_us;
    }

    /// One record a channel, or one for a cycle that is a fault as a whole.
    pub(crate) fn shot(&mut self, shot: &Shot) -> io::Result<()> {
        let time = self.stamp.next(shot.t_ns);
        let several = shot.format.channels().len() > 1;
        if shot.cycle.fault().is_some() {
            self.record(&Record {
                shot,
                time,
                ch: None,
                verbose: self.verbose,
            })?;
        }
        for (ch, _) in shot.cycle.words().iter().enumerate() {
            let ch = Place {
                index: ch,
                shown: several,
            };
            self.record(&Record {
                shot,
                time,
                ch: Some(ch),
                verbose: self.verbose,
            })?;
        }
        if self.flushed.elapsed() >= FLUSH_EVERY {
            self.flush()?;
        }
        Ok(())
    }

    fn record(&mut self, record: &Record) -> io::Result<()> {
        self.line.clear();
        match self.format {
            OutputFormat::Text => record.text(&mut self.line, self.color, self.degree)?,
            OutputFormat::Json => serde_json::to_writer(&mut self.line, record)?,
        }
        self.line.push(b'\n');
        self.out.write_all(&self.line)
    }

    /// Before waiting, and at the end.
    pub(crate) fn flush(&mut self) -> io::Result<()> {
        self.flushed = Instant::now();
        self.out.flush()
    }
}

impl Stamp {
    fn next(&mut self, t_ns: u64) -> Time {
        let first = *self.first_ns.get_or_insert(t_ns);
        let last = std::mem::replace(&mut self.last_ns, t_ns);
        match self.style {
            TimeStyle::Zero => Time::Zero(t_ns.saturating_sub(first)),
            TimeStyle::Delta if t_ns == first => Time::Delta(0),
            TimeStyle::Delta => Time::Delta(t_ns.saturating_sub(last)),
            TimeStyle::Unix => Time::Unix(self.unix_us + i128::from(t_ns) / 1000),
            TimeStyle::None => Time::None,
        }
    }
}

fn utf8_locale() -> bool {
    let set = |name| std::env::var(name).ok().filter(|value| !value.is_empty());
    let locale = set("LC_ALL")
        .or_else(|| set("LC_CTYPE"))
        .or_else(|| set("LANG"))
        .unwrap_or_default();
    let locale = locale.to_ascii_lowercase();
    locale.contains("utf-8") || locale.contains("utf8")
}

#[derive(Clone, Copy)]
struct Place {
    index: usize,
    shown: bool,
}

struct Record<'a> {
    shot: &'a Shot<'a>,
    time: Time,
    ch: Option<Place>,
    verbose: bool,
}

/// A good word, field by field.
struct Good<'a> {
    channel: &'a Channel,
    data: u64,
}

impl<'a> Record<'a> {
    fn channel(&self) -> Option<(&'a Channel, Word)> {
        let place = self.ch?;
        let channel = self.shot.format.channels().get(place.index)?;
        Some((channel, *self.shot.cycle.words().get(place.index)?))
    }

    fn fault(&self) -> Option<Fault> {
        self.shot
            .cycle
            .fault()
            .or_else(|| self.channel().and_then(|(_, word)| word.fault()))
    }

    /// Only what passed every check has fields.
    fn good(&self) -> Option<Good<'a>> {
        let (channel, word) = self.channel()?;
        let data = word.good().filter(|_| self.shot.cycle.fault().is_none())?;
        Some(Good { channel, data })
    }

    fn text(&self, out: &mut Vec<u8>, color: bool, degree: &str) -> io::Result<()> {
        match self.time {
            Time::Zero(ns) | Time::Delta(ns) => write!(
                out,
                "{:3}.{:06}",
                ns / 1_000_000_000,
                ns % 1_000_000_000 / 1000
            )?,
            Time::Unix(us) => write!(out, "{}.{:06}", us / 1_000_000, us % 1_000_000)?,
            Time::None => {}
        }
        if let Some(Place { index, shown: true }) = self.ch {
            separate(out);
            write!(out, "ch {index}")?;
        }
        if let Some(good) = self.good() {
            good.text(out, color, degree)?;
        } else if let Some(fault) = self.fault() {
            separate(out);
            paint(out, color, AnsiColor::Red, format_args!("fault {fault}"))?;
        }
        if let Some(tries) = self.shot.tries.filter(|tries| *tries > 1) {
            write!(out, "  ({tries} tries)")?;
        }
        if self.verbose {
            separate(out);
            write!(out, "{}", self.shot.trace.bits)?;
        }
        Ok(())
    }
}

fn separate(out: &mut Vec<u8>) {
    if !out.is_empty() {
        out.extend(b"  ");
    }
}

fn paint(out: &mut Vec<u8>, color: bool, shade: AnsiColor, text: impl Display) -> io::Result<()> {
    if color {
        let style = Style::new().fg_color(Some(shade.into()));
        write!(out, "{style}{text}{style:#}")
    } else {
        write!(out, "{text}")
    }
}

impl Good<'_> {
    fn text(&self, out: &mut Vec<u8>, color: bool, degree: &str) -> io::Result<()> {
        for field in self.channel.fields() {
            let value = field.get(self.data);
            let name = match field.kind() {
                Kind::Turn => "turn",
                Kind::SingleTurn | Kind::Position => "pos",
                Kind::Data(name) => name,
                Kind::Life => "lc",
                Kind::Padding | Kind::Error { .. } | Kind::Warning { .. } => continue,
            };
            separate(out);
            write!(out, "{name} {value}")?;
        }
        if let Some((degrees, digits)) = self.degrees() {
            separate(out);
            write!(out, "{degrees:.digits$}{degree}")?;
        }
        separate(out);
        match (
            self.channel.error(self.data),
            self.channel.warning(self.data),
        ) {
            (Some(true), Some(true)) => paint(out, color, AnsiColor::Red, "error warning")?,
            (Some(true), _) => paint(out, color, AnsiColor::Red, "error")?,
            (_, Some(true)) => paint(out, color, AnsiColor::Yellow, "warning")?,
            _ => paint(out, color, AnsiColor::Green, "ok")?,
        }
        if self.channel.crc().is_none() {
            out.extend(b"  unprotected");
        }
        Ok(())
    }

    /// The angle of a single-turn position and as many decimals as its resolution needs.
    fn degrees(&self) -> Option<(f64, usize)> {
        /// More than a 64-bit float can tell apart in 360 degrees.
        const MOST: i32 = 13;
        let field = self.channel.find(|kind| *kind == Kind::SingleTurn)?;
        let range = 2f64.powi(field.bits().into());
        let digits = ((range / 360.0).log10().ceil().max(-1.0) as i32 + 1).min(MOST);
        let scale = 10f64.powi(digits);
        // Cut off, not rounded, where rounding would make a full turn of it.
        let scaled = field.get(self.data) as f64 / range * 360.0 * scale;
        let scaled = scaled.round().min(360.0 * scale - 1.0);
        Some((scaled / scale, digits.max(0) as usize))
    }
}

impl Serialize for Record<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("type", "frame")?;
        match self.time {
            Time::Zero(ns) => map.serialize_entry("t_ns", &ns)?,
            Time::Delta(ns) => map.serialize_entry("dt_ns", &ns)?,
            Time::Unix(us) => map.serialize_entry("t_unix_us", &us)?,
            Time::None => {}
        }
        map.serialize_entry("seq", &self.shot.seq)?;
        if let Some(Place { index, shown: true }) = self.ch {
            map.serialize_entry("ch", &index)?;
        }
        let good = self.good();
        let error = good.as_ref().and_then(|good| good.channel.error(good.data));
        map.serialize_entry("ok", &(good.is_some() && error != Some(true)))?;
        if let Some(good) = &good {
            good.entries(&mut map)?;
        } else if let Some(fault) = self.fault() {
            map.serialize_entry("fault", fault.name())?;
            for (name, number) in fault.numbers() {
                map.serialize_entry(name, &number)?;
            }
        }
        if let Some(tries) = self.shot.tries {
            map.serialize_entry("tries", &tries)?;
        }
        self.head_entries(&mut map)?;
        self.raw_entries(&mut map)?;
        map.end()
    }
}

impl Good<'_> {
    fn entries<M: SerializeMap>(&self, map: &mut M) -> Result<(), M::Error> {
        for want in [Kind::Turn, Kind::SingleTurn, Kind::Position] {
            if let Some(field) = self.channel.find(|kind| *kind == want) {
                let name = if want == Kind::Turn { "turn" } else { "pos" };
                map.serialize_entry(name, &field.get(self.data))?;
            }
        }
        for field in self.channel.fields() {
            if let Kind::Data(name) = field.kind() {
                map.serialize_entry(name, &field.get(self.data))?;
            }
        }
        if let Some(field) = self.channel.find(|kind| *kind == Kind::Life) {
            map.serialize_entry("lc", &field.get(self.data))?;
        }
        if let Some((degrees, _)) = self.degrees() {
            map.serialize_entry("deg", &degrees)?;
        }
        if let Some(error) = self.channel.error(self.data) {
            map.serialize_entry("error", &error)?;
        }
        if let Some(warning) = self.channel.warning(self.data) {
            map.serialize_entry("warning", &warning)?;
        }
        Ok(())
    }
}

impl Record<'_> {
    fn head_entries<M: SerializeMap>(&self, map: &mut M) -> Result<(), M::Error> {
        let head = self.shot.cycle.head();
        if let Some(head) = head {
            map.serialize_entry("ack", &head.ack)?;
        }
        match (self.shot.trace.delay_ns, head) {
            (Some(ns), _) => map.serialize_entry("delay_ns", &ns)?,
            (None, Some(head)) => map.serialize_entry("delay_clk", &head.delay_clk)?,
            (None, None) => {}
        }
        if let Some(head) = head {
            map.serialize_entry("cds", &u8::from(head.cds))?;
        }
        Ok(())
    }

    fn raw_entries<M: SerializeMap>(&self, map: &mut M) -> Result<(), M::Error> {
        if let Some((channel, word)) = self.channel() {
            let (data, crc) = word.raw();
            match channel.crc() {
                Some(_) => map.serialize_entry("crc", &crc)?,
                None => map.serialize_entry("unprotected", &true)?,
            }
            let bits = u32::from(channel.data_bits()) + u32::from(channel.crc_bits());
            let scd = u128::from(data) << channel.crc_bits() | u128::from(crc);
            let digits = bits.div_ceil(4) as usize;
            map.serialize_entry("scd", &Shown(format_args!("{scd:0digits$x}")))?;
        }
        if self.verbose || self.ch.is_none() {
            map.serialize_entry("bits", &Shown(format_args!("{}", self.shot.trace.bits)))?;
        }
        Ok(())
    }
}

/// Text made while it is written.
struct Shown<'a>(std::fmt::Arguments<'a>);

impl Serialize for Shown<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&self.0)
    }
}

/// What a run came to.
#[derive(Clone, Debug, Default)]
pub(crate) struct Summary {
    /// Cycles with every channel good.
    pub(crate) good: u64,
    /// By [`Fault::index`].
    pub(crate) faults: [u64; Fault::NAMES.len()],
    pub(crate) error: u64,
    pub(crate) warning: u64,
    pub(crate) skipped: u64,
    pub(crate) retries: u64,
    pub(crate) elapsed_ns: u64,
    /// All cycles.
    pub(crate) cycles: u64,
    /// Start of the first and of the last cycle.
    pub(crate) span_ns: Option<(u64, u64)>,
}

impl Summary {
    pub(crate) fn count(&mut self, shot: &Shot) {
        self.cycles += 1;
        let (first, _) = self.span_ns.unwrap_or((shot.t_ns, shot.t_ns));
        self.span_ns = Some((first, shot.t_ns));
        self.good += u64::from(shot.cycle.is_good());
        self.retries += u64::from(shot.tries.unwrap_or(1)) - 1;
        let words = shot.cycle.words().iter();
        for fault in shot
            .cycle
            .fault()
            .into_iter()
            .chain(words.clone().filter_map(Word::fault))
        {
            self.faults[fault.index()] += 1;
        }
        for (channel, word) in shot.format.channels().iter().zip(words) {
            if let Some(data) = word.good() {
                self.error += u64::from(channel.error(data) == Some(true));
                self.warning += u64::from(channel.warning(data) == Some(true));
            }
        }
    }

    /// Cycles a second, from start to start; none where there is no second start.
    fn rate_hz(&self) -> Option<f64> {
        let (first, last) = self.span_ns?;
        let seconds = last.saturating_sub(first) as f64 / 1e9;
        (seconds > 0.0).then(|| ((self.cycles - 1) as f64 / seconds * 10.0).round() / 10.0)
    }

    fn kinds(&self) -> impl Iterator<Item = (&'static str, u64)> {
        Fault::NAMES
            .into_iter()
            .zip(self.faults)
            .filter(|(_, count)| *count > 0)
    }

    /// On stderr, so that stdout stays records only.
    pub(crate) fn print(&self, format: OutputFormat) {
        match format {
            OutputFormat::Text => note(self),
            OutputFormat::Json => {
                let mut line = serde_json::to_vec(self).unwrap_or_default();
                line.push(b'\n');
                // As with every note.
                let _ = io::stderr().lock().write_all(&line);
            }
        }
    }
}

impl Display for Summary {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let faults: u64 = self.faults.iter().sum();
        let plural = |count: u64| if count == 1 { "" } else { "s" };
        write!(
            f,
            "{} frame{}, {} good, ",
            self.cycles,
            plural(self.cycles),
            self.good
        )?;
        write!(f, "{faults} fault{}", plural(faults))?;
        let mut before = " (";
        for (name, count) in self.kinds() {
            write!(f, "{before}{count} {name}")?;
            before = ", ";
        }
        if faults > 0 {
            f.write_str(")")?;
        }
        for (count, name) in [
            (self.error, "error"),
            (self.warning, "warning"),
            (self.skipped, "skipped"),
            (self.retries, "retries"),
        ] {
            if count > 0 {
                write!(f, ", {count} {name}")?;
            }
        }
        write!(f, " in {:.3} s", self.elapsed_ns as f64 / 1e9)?;
        match self.rate_hz() {
            Some(rate) => write!(f, ", {rate:.1} frames/s"),
            None => Ok(()),
        }
    }
}

impl Serialize for Summary {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        struct Kinds<'a>(&'a Summary);
        impl Serialize for Kinds<'_> {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.collect_map(self.0.kinds())
            }
        }
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("type", "summary")?;
        map.serialize_entry("frames", &self.cycles)?;
        map.serialize_entry("good", &self.good)?;
        map.serialize_entry("faults", &Kinds(self))?;
        map.serialize_entry("error", &self.error)?;
        map.serialize_entry("warning", &self.warning)?;
        map.serialize_entry("skipped", &self.skipped)?;
        map.serialize_entry("retries", &self.retries)?;
        map.serialize_entry("elapsed_ns", &self.elapsed_ns)?;
        map.serialize_entry("rate_hz", &self.rate_hz())?;
        map.end()
    }
}
