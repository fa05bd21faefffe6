//! Records as rows of columns: CSV, and the fields that were asked for.

use super::{Place, Record, Scd, Time};
use crate::cli::TimeStyle;
use biss::ParseError;
use biss::format::{Channel, Format, Kind};
use biss::measure::{Scale, Unit};
use std::io::{self, Write};

/// A column, in the order of the keys in JSON.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Column {
    Time(&'static str),
    Seq,
    Ch,
    Slave,
    Ok,
    Turn,
    Pos,
    Data(String),
    Life,
    Counts,
    Measure(Unit),
    Error,
    Warning,
    Fault,
    Detail,
    Tries,
    Ack,
    DelayNs,
    DelayClocks,
    BusyNs,
    ClockHz,
    TimeoutNs,
    Cds,
    Crc,
    Unprotected,
    Scd,
    Bits,
}

/// What decides which columns there are.
pub(crate) struct Shape<'a> {
    pub(crate) format: &'a Format,
    pub(crate) time: TimeStyle,
    /// Slave IDs are known.
    pub(crate) slaves: bool,
    /// The user has a way of counting of his own.
    pub(crate) counted: bool,
    /// How positions are measured.
    pub(crate) scales: &'a [Option<Scale>],
    /// Not a recording.
    pub(crate) live: bool,
    /// Line delay is known in clocks.
    pub(crate) delay_clk: bool,
    /// Line delay is known in nanoseconds.
    pub(crate) delay_ns: bool,
}

impl Column {
    /// As in the header, and as in JSON.
    pub(crate) fn name(&self) -> &str {
        match self {
            Column::Time(name) => name,
            Column::Data(name) => name,
            Column::Seq => "seq",
            Column::Ch => "ch",
            Column::Slave => "slave",
            Column::Ok => "ok",
            Column::Turn => "turn",
            Column::Pos => "pos",
            Column::Life => "lc",
            Column::Counts => "counts",
            Column::Measure(unit) => unit.name(),
            Column::Error => "error",
            Column::Warning => "warning",
            Column::Fault => "fault",
            Column::Detail => "detail",
            Column::Tries => "tries",
            Column::Ack => "ack",
            Column::DelayNs => "delay_ns",
            Column::DelayClocks => "delay_clk",
            Column::BusyNs => "busy_ns",
            Column::ClockHz => "clock_hz",
            Column::TimeoutNs => "timeout_ns",
            Column::Cds => "cds",
            Column::Crc => "crc",
            Column::Unprotected => "unprotected",
            Column::Scd => "scd",
            Column::Bits => "bits",
        }
    }
}

/// Every column that a record of this shape can fill, known before the first one.
pub(crate) fn columns(shape: &Shape) -> Vec<Column> {
    let channels = shape.format.channels();
    let any = |want: &dyn Fn(&Channel) -> bool| channels.iter().any(want);
    let has = |want: fn(&Kind) -> bool| any(&|channel| channel.find(want).is_some());
    let time = match shape.time {
        TimeStyle::Zero => Some("t_ns"),
        TimeStyle::Delta => Some("dt_ns"),
        TimeStyle::Unix => Some("t_unix_us"),
        TimeStyle::None => None,
    };
    let mut names: Vec<Column> = Vec::new();
    for field in channels.iter().flat_map(Channel::fields) {
        if let Kind::Data(name) = field.kind() {
            let column = Column::Data(name.clone());
            if !names.contains(&column) {
                names.push(column);
            }
        }
    }
    let place = has(|kind| matches!(kind, Kind::SingleTurn | Kind::Position));
    // Channels that are measured have one unit.
    let unit = shape.scales.iter().flatten().map(Scale::unit).next();
    let before = [
        (Column::Time(time.unwrap_or_default()), time.is_some()),
        (Column::Seq, true),
        (Column::Ch, channels.len() > 1),
        (Column::Slave, shape.slaves),
        (Column::Ok, true),
        (Column::Turn, has(|kind| *kind == Kind::Turn)),
        (Column::Pos, place),
    ];
    let after = [
        (Column::Life, has(|kind| *kind == Kind::Life)),
        (Column::Counts, place && shape.counted),
        (Column::Measure(unit.unwrap_or(Unit::None)), unit.is_some()),
        (Column::Error, any(&|channel| channel.error(0).is_some())),
        (
            Column::Warning,
            any(&|channel| channel.warning(0).is_some()),
        ),
        (Column::Fault, true),
        (Column::Detail, true),
        (Column::Tries, shape.live),
        (Column::Ack, true),
        (Column::DelayNs, shape.delay_ns),
        (Column::DelayClocks, shape.delay_clk),
        (Column::BusyNs, !shape.live),
        (Column::ClockHz, !shape.live),
        (Column::TimeoutNs, !shape.live),
        (Column::Cds, true),
        (Column::Crc, any(&|channel| channel.crc().is_some())),
        (Column::Unprotected, any(&|channel| channel.crc().is_none())),
        (Column::Scd, true),
        (Column::Bits, true),
    ];
    let there = |list: Vec<(Column, bool)>| {
        let there = list.into_iter().filter(|(_, there)| *there);
        there.map(|(column, _)| column).collect::<Vec<_>>()
    };
    [there(before.into()), names, there(after.into())].concat()
}

/// The columns of `list`, comma-separated names, out of those that are there.
pub(crate) fn choose(list: &str, there: &[Column]) -> Result<Vec<Column>, ParseError> {
    const ELSEWHERE: [&str; 22] = [
        "t_ns",
        "dt_ns",
        "t_unix_us",
        "ch",
        "slave",
        "turn",
        "pos",
        "lc",
        "counts",
        "deg",
        "rad",
        "turns",
        "mm",
        "um",
        "error",
        "warning",
        "tries",
        "delay_ns",
        "delay_clk",
        "busy_ns",
        "clock_hz",
        "timeout_ns",
    ];
    let good = |column: &&Column| !matches!(column, Column::Fault | Column::Detail);
    let mut chosen = Vec::new();
    let mut at = 0;
    for name in list.split(',') {
        let found = there.iter().filter(good).find(|c| c.name() == name);
        let Some(column) = found else {
            let what = match name {
                "" => "a name is missing".into(),
                "fault" | "detail" => {
                    format!("good records have no `{name}`, and only they are printed")
                }
                name if ELSEWHERE.contains(&name) || ["crc", "unprotected"].contains(&name) => {
                    format!("no `{name}` in records of this frame, link and options")
                }
                name => format!("no record has a `{name}`"),
            };
            let names: Vec<&str> = there.iter().filter(good).map(Column::name).collect();
            let hint = format!("there are {}", names.join(" "));
            return Err(ParseError::new(list, at..at + name.len(), what, hint));
        };
        chosen.push(column.clone());
        at += name.len() + 1;
    }
    Ok(chosen)
}

impl Record<'_> {
    /// One value a column, nothing where it does not apply.
    pub(super) fn row(&self, columns: &[Column], between: u8, out: &mut Vec<u8>) -> io::Result<()> {
        for (index, column) in columns.iter().enumerate() {
            if index > 0 {
                out.push(between);
            }
            self.put(column, out)?;
        }
        Ok(())
    }

    fn put(&self, column: &Column, out: &mut Vec<u8>) -> io::Result<()> {
        let good = self.good();
        let error = good.as_ref().and_then(|good| good.channel.error(good.data));
        let field = |out: &mut Vec<u8>, want: &dyn Fn(&Kind) -> bool| {
            let value = good
                .as_ref()
                .and_then(|good| Some(good.channel.find(want)?.get(good.data)));
            write(out, value)
        };
        match column {
            Column::Time(_) => match self.time {
                Time::Zero(ns) | Time::Delta(ns) => write!(out, "{ns}"),
                Time::Unix(us) => write!(out, "{us}"),
                Time::None => Ok(()),
            },
            Column::Seq => write!(out, "{}", self.shot.seq),
            Column::Ch => match self.ch {
                Some(Place { index, shown: true }) => write!(out, "{index}"),
                _ => Ok(()),
            },
            Column::Slave => write(out, self.slave()),
            Column::Ok => write!(out, "{}", good.is_some() && error != Some(true)),
            Column::Turn => field(out, &|kind| *kind == Kind::Turn),
            Column::Pos => field(out, &|kind| {
                matches!(kind, Kind::SingleTurn | Kind::Position)
            }),
            Column::Data(name) => field(out, &|kind| matches!(kind, Kind::Data(n) if n == name)),
            Column::Life => field(out, &|kind| *kind == Kind::Life),
            Column::Counts => write(out, good.and_then(|good| good.counts)),
            Column::Measure(_) => match good.and_then(|good| good.measured()) {
                Some((_, value, digits)) => write!(out, "{value:.digits$}"),
                None => Ok(()),
            },
            Column::Error => write(out, error),
            Column::Warning => write(out, good.and_then(|good| good.channel.warning(good.data))),
            _ => self.put_rest(column, out),
        }
    }

    /// What does not depend on a good word.
    fn put_rest(&self, column: &Column, out: &mut Vec<u8>) -> io::Result<()> {
        let head = self.shot.cycle.head();
        let word = self.channel();
        let fault = self.fault();
        match column {
            Column::Fault => write(out, fault.map(|fault| fault.name())),
            Column::Detail => {
                let numbers = fault.iter().flat_map(biss::cycle::Fault::numbers);
                for (index, (name, number)) in numbers.enumerate() {
                    let space = if index > 0 { " " } else { "" };
                    write!(out, "{space}{name}={number}")?;
                }
                match self.clocks() {
                    Some((first, last)) => {
                        // A null value has no numbers of its own.
                        let bare = fault.is_none_or(|fault| fault.numbers().next().is_none());
                        let space = if bare { "" } else { " " };
                        write!(out, "{space}first_clock={first} last_clock={last}")
                    }
                    None => Ok(()),
                }
            }
            Column::Tries => write(out, self.shot.tries),
            Column::Ack => write(out, head.map(|head| head.ack)),
            Column::DelayNs => write(out, self.shot.trace.delay_ns),
            Column::DelayClocks => {
                let clocks = head.filter(|_| self.shot.trace.delay_ns.is_none());
                write(out, clocks.map(|head| head.delay_clk))
            }
            Column::BusyNs => write(out, self.measured().busy_ns),
            Column::ClockHz => write(out, self.measured().clock_hz),
            Column::TimeoutNs => write(out, self.measured().timeout_ns),
            Column::Cds => write(out, head.map(|head| u8::from(head.cds))),
            Column::Crc => {
                let protected = word.filter(|(channel, _)| channel.crc().is_some());
                write(out, protected.map(|(_, word)| word.raw().1))
            }
            Column::Unprotected => {
                let bare = word.filter(|(channel, _)| channel.crc().is_none());
                write(out, bare.map(|_| true))
            }
            Column::Scd => {
                if let Some((channel, word)) = word {
                    Scd(channel, word).put(out);
                }
                Ok(())
            }
            _ => write!(out, "{}", self.shot.trace.bits),
        }
    }
}

fn write(out: &mut Vec<u8>, value: Option<impl std::fmt::Display>) -> io::Result<()> {
    match value {
        Some(value) => write!(out, "{value}"),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use biss::measure::scales;

    fn shape(format: &Format) -> Vec<Column> {
        columns(&Shape {
            format,
            time: TimeStyle::Zero,
            slaves: true,
            counted: true,
            scales: &scales(format, None, None).unwrap_or_default(),
            live: true,
            delay_clk: true,
            delay_ns: true,
        })
    }

    #[test]
    fn every_column_can_be_chosen_in_any_order() {
        let format = "mt4,st12,data3=temp,lc6,nE,nW,crc6+pos8,data3=temp,E";
        let there = shape(&format.parse().unwrap_or_else(|e| panic!("{e}")));
        let good = |column: &&Column| !matches!(column, Column::Fault | Column::Detail);
        let mut wanted: Vec<Column> = there.iter().filter(good).cloned().collect();
        assert_eq!(wanted.len(), 22, "{wanted:?}");
        fastrand::shuffle(&mut wanted);
        let names: Vec<&str> = wanted.iter().map(Column::name).collect();
        assert_eq!(choose(&names.join(","), &there), Ok(wanted));
    }

    #[test]
    fn no_list_panics() {
        let seed = fastrand::u64(..);
        println!("seed {seed}");
        let mut rng = fastrand::Rng::with_seed(seed);
        let there = shape(&"st8,crc6".parse().unwrap_or_else(|e| panic!("{e}")));
        let parts = ["pos", ",", "deg", "é", "fault", " ", "t_ns", "turn", "crc"];
        for _ in 0..5_000 {
            let list: String = (0..rng.usize(0..7))
                .map(|_| parts[rng.usize(..parts.len())])
                .collect();
            if let Err(error) = choose(&list, &there) {
                assert!(list.get(error.span()).is_some(), "{list}");
                assert!(error.to_string().contains('^'), "{list}");
            }
        }
    }
}
