//! Records on stdout, everything else on stderr. The only place that prints.

mod columns;
pub(crate) mod detect;
pub(crate) mod heard;
pub(crate) mod info;
mod json;
pub(crate) mod list;
pub(crate) mod loopback;
mod progress;
pub(crate) mod reg;
pub(crate) mod scope;
pub(crate) mod stats;
mod summary;
mod text;
pub(crate) mod watch;

pub(crate) use columns::{Column, Shape, choose, columns};
pub(crate) use progress::Progress;
pub(crate) use summary::{Summary, Why};

use crate::cli::{ColorWhen, ReportFormat, TimeStyle};
use biss::cycle::{Cycle, Fault, Word};
use biss::format::{Channel, Format};
use biss::measure::{Scale, Unit};
use biss::trace::Trace;
use std::fmt::Display;
use std::io::{self, IsTerminal, Write};
use std::time::{Duration, Instant};

/// Says something on stderr.
pub(crate) fn note(text: impl Display) {
    say(&format!("biss: {text}"));
}

fn say(line: &str) {
    // Nobody is left to tell when stderr is gone.
    let line = format!("{}{line}\n", progress::gone());
    let _ = io::stderr().lock().write_all(line.as_bytes());
}

/// Stdout for something that is no record.
pub(crate) fn raw() -> Box<dyn Write> {
    Box::new(io::stdout())
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
    /// What the user's own way of counting makes of it, where he has one.
    pub(crate) counted: Option<Counted<'a>>,
    /// How each channel's position is measured; none where it is not.
    pub(crate) scales: &'a [Option<Scale>],
    /// The ID of the slave that each channel belongs to; empty where nobody has asked them.
    pub(crate) slaves: &'a [u8],
}

/// Positions as the user counts.
#[derive(Clone, Copy)]
pub(crate) struct Counted<'a> {
    /// One a channel; none where it is not known.
    pub(crate) counts: &'a [Option<i128>],
    /// They go on past the rollover.
    pub(crate) unwrapped: bool,
}

/// How records look.
pub(crate) enum Look {
    /// For people.
    Text,
    /// JSON Lines.
    Json,
    /// Comma-separated, a header first.
    Csv(Vec<Column>),
    /// Tab-separated, good records only.
    Fields(Vec<Column>),
    /// Not at all.
    Nothing,
}

/// Writes records that all look the same.
pub(crate) struct Printer {
    out: io::BufWriter<io::Stdout>,
    line: Vec<u8>,
    look: Look,
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
    /// For records of one look.
    pub(crate) fn new(look: Look, style: TimeStyle, color: ColorWhen, verbose: bool) -> Printer {
        let color = matches!(look, Look::Text) && colored(color);
        Printer {
            out: io::BufWriter::with_capacity(1 << 16, io::stdout()),
            line: Vec::with_capacity(1 << 12),
            look,
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

    /// What stands above the records.
    pub(crate) fn header(&mut self) -> io::Result<()> {
        if let Look::Csv(columns) = &self.look {
            let names: Vec<&str> = columns.iter().map(Column::name).collect();
            writeln!(self.out, "{}", names.join(","))?;
        }
        Ok(())
    }

    /// One record a channel, or one for a cycle that is a fault as a whole.
    pub(crate) fn shot(&mut self, shot: &Shot) -> io::Result<()> {
        if matches!(self.look, Look::Nothing) {
            return Ok(());
        }
        let time = self.stamp.next(shot.t_ns);
        for record in Record::all(shot, time, self.verbose) {
            self.record(&record)?;
        }
        self.flush_in_time()
    }

    /// Writes a register that was read beside the frames.
    pub(crate) fn register(&mut self, register: &reg::Register) -> io::Result<()> {
        let format = match self.look {
            Look::Text => ReportFormat::Text,
            _ => ReportFormat::Json,
        };
        self.out.write_all(register.render(format)?.as_bytes())?;
        self.flush_in_time()
    }

    fn flush_in_time(&mut self) -> io::Result<()> {
        match self.flushed.elapsed() >= FLUSH_EVERY {
            true => self.flush(),
            false => Ok(()),
        }
    }

    fn record(&mut self, record: &Record) -> io::Result<()> {
        self.line.clear();
        let line = &mut self.line;
        match &self.look {
            Look::Text => record.text(line, self.color, self.degree)?,
            Look::Json => record.json(line)?,
            Look::Csv(columns) => record.row(columns, b',', line)?,
            Look::Fields(_) if record.good().is_none() => return Ok(()),
            Look::Fields(columns) => record.row(columns, b'\t', line)?,
            Look::Nothing => return Ok(()),
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

impl Stamp {
    /// The time of something that is no frame and moves no clock: where times count from the record before there is none.
    fn of(&self, t_ns: u64) -> Time {
        match self.style {
            TimeStyle::Zero => Time::Zero(t_ns.saturating_sub(self.first_ns.unwrap_or(t_ns))),
            TimeStyle::Unix => Time::Unix(self.unix_us + i128::from(t_ns) / 1000),
            TimeStyle::Delta | TimeStyle::None => Time::None,
        }
    }
}

/// Whether what goes to stdout has colours.
fn colored(when: ColorWhen) -> bool {
    match when {
        ColorWhen::Always => true,
        ColorWhen::Never => false,
        ColorWhen::Auto => {
            anstream::AutoStream::choice(&io::stdout()) != anstream::ColorChoice::Never
        }
    }
}

/// Columns of the terminal, or of one as terminals usually are.
fn terminal_width() -> usize {
    const USUAL_WIDTH: usize = 80;
    let terminal = || terminal_size::terminal_size().map(|(width, _)| usize::from(width.0));
    let columns = std::env::var("COLUMNS").ok();
    let columns = columns.and_then(|columns| columns.parse().ok());
    let width: usize = columns.or_else(terminal).unwrap_or(USUAL_WIDTH);
    width.max(1)
}

/// Whether records go to a terminal.
fn on_terminal() -> bool {
    io::stdout().is_terminal()
}

/// Columns and lines of the terminal.
fn terminal_size() -> (usize, usize) {
    let size = terminal_size::terminal_size();
    size.map_or((80, 24), |(width, height)| {
        (usize::from(width.0), usize::from(height.0))
    })
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

/// What the edges of a recorded cycle measure.
#[derive(Clone, Copy, Debug, Default)]
struct Measured {
    /// Ack edge to start edge; takes both wires.
    busy_ns: Option<u64>,
    /// MA's rising edges.
    clock_hz: Option<u32>,
    /// Last MA edge to SL = 1, as the slave saw them.
    timeout_ns: Option<u32>,
}

/// A good word, field by field.
struct Good<'a> {
    channel: &'a Channel,
    data: u64,
    counted: bool,
    counts: Option<i128>,
    unwrapped: bool,
    scale: Option<&'a Scale>,
}

impl Good<'_> {
    /// The position in its unit, and as many decimals as its resolution needs.
    fn measured(&self) -> Option<(Unit, f64, usize)> {
        let scale = self.scale?;
        let counts = if self.counted {
            self.counts?
        } else {
            scale.number(self.data)?.into()
        };
        let (value, digits) = scale.value(counts, self.unwrapped);
        Some((scale.unit(), value, digits))
    }
}

impl<'a> Record<'a> {
    /// One a channel, or one for a cycle that is a fault as a whole.
    fn all(shot: &'a Shot<'a>, time: Time, verbose: bool) -> impl Iterator<Item = Record<'a>> {
        let several = shot.format.channels().len() > 1;
        let whole = shot.cycle.fault().map(|_| None);
        let words = (0..shot.cycle.words().len()).map(move |index| {
            Some(Place {
                index,
                shown: several,
            })
        });
        whole.into_iter().chain(words).map(move |ch| Record {
            shot,
            time,
            ch,
            verbose,
        })
    }

    fn channel(&self) -> Option<(&'a Channel, Word)> {
        let place = self.ch?;
        let channel = self.shot.format.channels().get(place.index)?;
        Some((channel, *self.shot.cycle.words().get(place.index)?))
    }

    fn slave(&self) -> Option<u8> {
        self.shot.slaves.get(self.ch?.index).copied()
    }

    /// What only a recording shows, as somebody else has made its clock.
    fn measured(&self) -> Measured {
        let trace = self.shot.trace;
        if self.shot.tries.is_some() {
            return Measured::default();
        }
        let head = self.shot.cycle.head();
        let busy_ns = head.and(trace.busy_ns).map(u64::from);
        let period = trace.ma_period_ns.filter(|ns| *ns > 0);
        let ready = trace.ready_ns.zip(trace.delay_ns);
        Measured {
            busy_ns,
            clock_hz: period.map(|ns| (1_000_000_000 + ns / 2) / ns),
            timeout_ns: ready.and_then(|(ready, delay)| ready.checked_sub(delay)),
        }
    }

    /// The rising edges whose bits are those of a bad channel, first and last; of recordings, where one may look there.
    fn clocks(&self) -> Option<(u32, u32)> {
        let (channel, word) = self.channel()?;
        let head = self.shot.cycle.head()?;
        if self.shot.tries.is_some() || word.fault().is_none() {
            return None;
        }
        let bits =
            |channel: &Channel| u32::from(channel.data_bits()) + u32::from(channel.crc_bits());
        let before = self.shot.format.channels().iter().take(self.ch?.index);
        // LAT, the Ack edge, the start edge and CDS go before.
        let first = 4 + u32::from(head.clocks()) + before.map(bits).sum::<u32>();
        Some((first, first + bits(channel).saturating_sub(1)))
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
        let index = self.ch.map_or(0, |place| place.index);
        let counts = self
            .shot
            .counted
            .and_then(|counted| *counted.counts.get(index)?);
        Some(Good {
            channel,
            data,
            counted: self.shot.counted.is_some(),
            counts,
            unwrapped: self.shot.counted.is_some_and(|counted| counted.unwrapped),
            scale: self.shot.scales.get(index).and_then(Option::as_ref),
        })
    }
}

/// Data, then CRC, in hex, with all digits of the channel.
struct Scd<'a>(&'a Channel, Word);

impl Scd<'_> {
    fn put(&self, out: &mut Vec<u8>) {
        let Scd(channel, word) = self;
        let (data, crc) = word.raw();
        let bits = u32::from(channel.data_bits()) + u32::from(channel.crc_bits());
        let scd = u128::from(data) << channel.crc_bits() | u128::from(crc);
        let digits = (0..bits.div_ceil(4)).rev();
        out.extend(digits.map(|digit| b"0123456789abcdef"[(scd >> (4 * digit)) as usize & 0xf]));
    }
}

/// In decimal, a good deal faster than `write!`.
fn number(out: &mut Vec<u8>, value: impl itoa::Integer) {
    out.extend_from_slice(itoa::Buffer::new().format(value).as_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;
    use biss::cycle::Head;
    use biss::frame::{BissC, emit};
    use biss::measure::scales;
    use biss::protocol::Protocol;

    /// Text, JSON and all columns of each record of a frame, as a printer without colours makes them.
    fn records(format: &str, data: &[u64], slaves: &[u8]) -> Vec<[String; 3]> {
        let format: Format = format.parse().unwrap_or_else(|e| panic!("{e}"));
        let (mut trace, mut cycle) = (Trace::default(), Cycle::default());
        let head = Head {
            delay_clk: 0,
            ack: 1,
            cds: false,
        };
        emit(&format, head, data, &mut trace.bits);
        BissC::new(format.clone()).decode(&trace, &mut cycle);
        let scales = scales(&format, None, None).unwrap_or_default();
        let shot = Shot {
            format: &format,
            cycle: &cycle,
            trace: &trace,
            t_ns: 0,
            seq: 7,
            tries: None,
            counted: None,
            scales: &scales,
            slaves,
        };
        let columns = columns(&Shape {
            format: &format,
            time: TimeStyle::None,
            slaves: !slaves.is_empty(),
            counted: false,
            scales: &scales,
            live: false,
            delay_clk: false,
            delay_ns: false,
        });
        let several = format.channels().len() > 1;
        let places = (0..cycle.words().len()).map(|index| {
            Some(Place {
                index,
                shown: several,
            })
        });
        let whole = cycle.fault().map(|_| None);
        let record = |ch| {
            let record = Record {
                shot: &shot,
                time: Time::None,
                ch,
                verbose: false,
            };
            let (mut text, mut row) = (Vec::new(), Vec::new());
            let names: Vec<&str> = columns.iter().map(Column::name).collect();
            row.extend(format!("{} ", names[..3].join(",")).bytes());
            record.text(&mut text, false, "deg").unwrap_or_default();
            record.row(&columns, b',', &mut row).unwrap_or_default();
            let mut json = Vec::new();
            record.json(&mut json).unwrap_or_default();
            [text, json, row].map(|bytes| String::from_utf8(bytes).unwrap_or_default())
        };
        whole.into_iter().chain(places).map(record).collect()
    }

    #[test]
    fn slaves_stand_behind_their_channels_where_they_are_known() {
        let starts = |format: &str, data: &[u64], slaves: &[u8], want: &[[&str; 3]]| {
            let found = records(format, data, slaves);
            assert_eq!(found.len(), want.len(), "{found:?}");
            for (found, want) in found.iter().zip(want) {
                for (found, want) in found.iter().zip(want) {
                    assert!(found.starts_with(want), "{found}\n{want}");
                }
            }
        };
        let chain = "st8,nE,nW,crc6+data8=temp,crc5+st8,nE,nW,crc6";
        starts(
            chain,
            &[5 << 2 | 3, 40, 0],
            &[1, 1, 0],
            &[
                [
                    "ch 0  slave 1  pos 5  ",
                    r#"{"type":"frame","seq":7,"ch":0,"slave":1,"ok":true,"pos":5,"#,
                    "seq,ch,slave 7,0,1,true,5,",
                ],
                [
                    "ch 1  slave 1  temp 40  ",
                    r#"{"type":"frame","seq":7,"ch":1,"slave":1,"ok":true,"temp":40,"#,
                    "seq,ch,slave 7,1,1,true,,40",
                ],
                [
                    "ch 2  slave 0  fault null",
                    r#"{"type":"frame","seq":7,"ch":2,"slave":0,"ok":false,"fault":"null","#,
                    "seq,ch,slave 7,2,0,false,,",
                ],
            ],
        );
        starts(
            "st8,crc6",
            &[5],
            &[0],
            &[[
                "pos 5  ",
                r#"{"type":"frame","seq":7,"slave":0,"ok":true,"pos":5,"#,
                "seq,slave,ok 7,0,true,5,",
            ]],
        );
        starts(
            "st8,crc6+st8,crc6",
            &[5, 6],
            &[],
            &[
                [
                    "ch 0  pos 5  ",
                    r#"{"type":"frame","seq":7,"ch":0,"ok":true,"#,
                    "seq,ch,ok 7,0,true,5,",
                ],
                [
                    "ch 1  pos 6  ",
                    r#"{"type":"frame","seq":7,"ch":1,"ok":true,"#,
                    "seq,ch,ok 7,1,true,6,",
                ],
            ],
        );
        // A fault of the whole frame is no slave's.
        starts(
            "st8,crc6",
            &[],
            &[0],
            &[[
                "fault short",
                r#"{"type":"frame","seq":7,"ok":false,"#,
                "seq,slave,ok 7,,false,",
            ]],
        );
    }
}
