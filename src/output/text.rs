//! Records for people.

use super::{Good, Place, Record, Time, number};
use anstyle::{AnsiColor, Style};
use biss::format::Kind;
use biss::measure::Unit;
use biss::unit::{Hertz, Nanos};
use std::fmt::Display;
use std::io::{self, Write};

impl Record<'_> {
    pub(super) fn text(&self, out: &mut Vec<u8>, color: bool, degree: &str) -> io::Result<()> {
        time(out, self.time)?;
        if let Some(Place { index, shown: true }) = self.ch {
            separate(out);
            write!(out, "ch {index}")?;
        }
        let several = matches!(self.ch, Some(Place { shown: true, .. }));
        if let Some(slave) = self.slave().filter(|_| several) {
            separate(out);
            write!(out, "slave {slave}")?;
        }
        if let Some(good) = self.good() {
            good.text(out, color, degree)?;
        } else if let Some(fault) = self.fault() {
            separate(out);
            paint(out, color, AnsiColor::Red, format_args!("fault {fault}"))?;
            if let Some((first, last)) = self.clocks().filter(|_| self.verbose) {
                write!(out, " (clocks {first} to {last})")?;
            }
        }
        if let Some(tries) = self.shot.tries.filter(|tries| *tries > 1) {
            write!(out, "  ({tries} tries)")?;
        }
        if self.verbose {
            self.measured_text(out)?;
            separate(out);
            write!(out, "{}", self.shot.trace.bits)?;
        }
        Ok(())
    }

    fn measured_text(&self, out: &mut Vec<u8>) -> io::Result<()> {
        let measured = self.measured();
        let delay_ns = self
            .shot
            .trace
            .delay_ns
            .filter(|_| self.shot.tries.is_none());
        for (name, ns) in [
            ("delay", delay_ns.map(u64::from)),
            ("busy", measured.busy_ns),
            ("timeout", measured.timeout_ns.map(u64::from)),
        ] {
            if let Some(ns) = ns {
                separate(out);
                write!(out, "{name} {}", Nanos(ns))?;
            }
        }
        if let Some(hz) = measured.clock_hz {
            separate(out);
            write!(out, "clock {}", Hertz(hz))?;
        }
        Ok(())
    }
}

pub(super) fn time(out: &mut Vec<u8>, time: Time) -> io::Result<()> {
    match time {
        Time::Zero(ns) | Time::Delta(ns) => write!(
            out,
            "{:3}.{:06}",
            ns / 1_000_000_000,
            ns % 1_000_000_000 / 1000
        ),
        Time::Unix(us) => write!(out, "{}.{:06}", us / 1_000_000, us % 1_000_000),
        Time::None => Ok(()),
    }
}

pub(super) fn separate(out: &mut Vec<u8>) {
    if !out.is_empty() {
        out.extend(b"  ");
    }
}

pub(super) fn red(out: &mut Vec<u8>, color: bool, text: impl Display) -> io::Result<()> {
    paint(out, color, AnsiColor::Red, text)
}

/// What stands behind a value. A locale that has no degree sign has no µ.
pub(super) fn symbol(unit: Unit, degree: &str) -> &str {
    match unit {
        Unit::Degrees => degree,
        Unit::Radians => " rad",
        Unit::Turns => " turns",
        Unit::Millimetres => " mm",
        Unit::Micrometres if degree == "°" => " µm",
        Unit::Micrometres => " um",
        Unit::None => "",
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
            out.extend_from_slice(name.as_bytes());
            out.push(b' ');
            number(out, value);
        }
        if let Some(counts) = self.counts {
            separate(out);
            write!(out, "counts {counts}")?;
        }
        if let Some((unit, value, digits)) = self.measured() {
            separate(out);
            write!(out, "{value:.digits$}{}", symbol(unit, degree))?;
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
}
