//! What an unknown encoder sends, for people and for scripts.

use crate::cli::ReportFormat;
use biss::cycle::Fault;
use biss::detect::{Answer, Findings, Line, Range, Seen, TELL};
use biss::format::Format;
use biss::link::Phase;
use biss::unit::{Hertz, Nanos};
use serde::Serialize;
use std::fmt::Write;

/// What the slaves' registers said.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Told {
    /// The link cannot ask them.
    Unasked,
    /// Nobody there has any.
    Silent,
    /// This, which frames have passed; whether it is among what frames alone say.
    Frame { format: Format, fits: bool },
    /// No frame follows from them, and why.
    Nothing(String),
}

/// What was measured on a live link.
#[derive(Clone, Debug, Default)]
pub(crate) struct Measured {
    /// The clock it was measured at.
    pub(crate) clock: Option<Hertz>,
    pub(crate) timeout_ns: Option<Range>,
    /// The shortest time from the last edge to SL = 1 that was awaited: the timeout is not longer.
    pub(crate) waited_ns: Option<u64>,
    /// The shortest from start to start.
    pub(crate) interval_ns: Option<u64>,
    pub(crate) slowest: Option<Hertz>,
    pub(crate) fastest: Option<Hertz>,
    pub(crate) fastest_because: Limited,
    pub(crate) phases: Vec<PhaseTrial>,
}

/// Why no faster clock was found to work.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Limited {
    /// Nobody has looked.
    #[default]
    Unknown,
    /// The link does none.
    Link,
    /// Frames were bad.
    Encoder,
    /// BiSS-C has none.
    Standard,
}

impl Limited {
    fn name(self) -> Option<&'static str> {
        match self {
            Limited::Unknown => None,
            Limited::Link => Some("link"),
            Limited::Encoder => Some("encoder"),
            Limited::Standard => Some("standard"),
        }
    }

    fn said(self) -> &'static str {
        match self {
            Limited::Unknown => "",
            Limited::Link => ", this link does no more",
            Limited::Encoder => ", with the next one frames were bad",
            Limited::Standard => ", BiSS-C has no more",
        }
    }
}

/// Frames at one sampling phase.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PhaseTrial {
    pub(crate) phase: Phase,
    pub(crate) good: u32,
    pub(crate) frames: u32,
}

impl PhaseTrial {
    /// As it stands in an spi link.
    fn number(&self) -> u8 {
        if self.phase == Phase::Half { 2 } else { 3 }
    }
}

/// All that is told.
pub(crate) struct Report<'a> {
    pub(crate) findings: &'a Findings,
    pub(crate) told: &'a Told,
    pub(crate) measured: &'a Measured,
    pub(crate) command: Option<String>,
    pub(crate) live: bool,
}

impl Report<'_> {
    pub(crate) fn render(&self, format: ReportFormat) -> serde_json::Result<String> {
        match format {
            ReportFormat::Text => {
                let mut out = String::new();
                // Writing to a string does not fail.
                let _ = self.text(&mut out);
                Ok(out)
            }
            ReportFormat::Json => serde_json::to_string(&Object::of(self)).map(|text| text + "\n"),
        }
    }

    fn text(&self, out: &mut String) -> std::fmt::Result {
        let found = self.findings;
        writeln!(out, "{}", line(found.line))?;
        self.frames(out)?;
        if found.line == Line::Biss {
            self.heads(out)?;
        }
        self.answers(out)?;
        self.registers(out)?;
        self.measured(out)?;
        self.advice(out)?;
        match &self.command {
            Some(command) if found.line == Line::Biss => writeln!(out, "{command}"),
            _ => Ok(()),
        }
    }

    fn frames(&self, out: &mut String) -> std::fmt::Result {
        let found = self.findings;
        write!(out, "{}", count(found.frames, "frame"))?;
        if found.answered < found.frames {
            write!(out, ", {} with Ack and start bit", found.answered)?;
        }
        if found.answered > 0 {
            match found.alike() && found.answered > 1 {
                true => write!(out, ", all the same")?,
                false => write!(out, ", {} different", found.different)?,
            }
        }
        for (name, times) in Fault::NAMES
            .iter()
            .zip(found.faults)
            .filter(|(_, times)| *times > 0)
        {
            write!(out, ", {times} {name}")?;
        }
        writeln!(out)
    }

    fn heads(&self, out: &mut String) -> std::fmt::Result {
        let heads = &self.findings.heads;
        let mut parts = Vec::new();
        parts.extend(heads.ack.map(|range| format!("Ack {} clk", span(range))));
        parts.extend(heads.busy_ns.map(|range| format!("busy {}", times(range))));
        let delay = heads.delay_ns.map(times);
        let delay = delay.or(heads.delay_clk.map(|range| format!("{} clk", span(range))));
        parts.extend(delay.map(|delay| format!("line delay {delay}")));
        writeln!(out, "{}", parts.join(", "))
    }

    fn answers(&self, out: &mut String) -> std::fmt::Result {
        /// What stands below that is only counted.
        const SHOWN: usize = 12;
        let found = self.findings;
        for (index, answer) in found.answers.iter().take(SHOWN).enumerate() {
            writeln!(
                out,
                "{} {}  fits {} of {}",
                percent(answer.probability),
                answer.format,
                answer.good,
                count(answer.frames, "frame")
            )?;
            if index == 0 {
                details(out, answer)?;
            }
        }
        let hidden = found.answers.iter().skip(SHOWN);
        let more = hidden.clone().count() + found.unlikely;
        let share =
            hidden.map(|answer| answer.probability).sum::<f64>() + found.unlikely_probability;
        if more > 0 && !found.answers.is_empty() && share >= TELL {
            writeln!(out, "{} one of {more} less likely ones", percent(share))?;
        }
        if !found.answers.is_empty() && found.none_probability >= TELL {
            writeln!(out, "{} none of these", percent(found.none_probability))?;
        }
        Ok(())
    }

    fn registers(&self, out: &mut String) -> std::fmt::Result {
        match self.told {
            Told::Unasked | Told::Silent => Ok(()),
            Told::Frame { format, fits: true } => {
                writeln!(out, "registers: the slaves say {format} too")
            }
            Told::Frame {
                format,
                fits: false,
            } => writeln!(
                out,
                "registers: the slaves say {format}, which is not what these frames show"
            ),
            Told::Nothing(why) => writeln!(out, "registers: {}", why.lines().next().unwrap_or(why)),
        }
    }

    fn measured(&self, out: &mut String) -> std::fmt::Result {
        let measured = self.measured;
        for trial in &measured.phases {
            let (phase, good, frames) = (trial.number(), trial.good, trial.frames);
            writeln!(out, "phase {phase}: {good} of {frames} frames good")?;
        }
        if let Some(range) = measured.timeout_ns.or(self.findings.heads.timeout_ns) {
            writeln!(out, "timeout {}", times(range))?;
        } else if let Some(waited) = measured.waited_ns {
            writeln!(out, "timeout at most {}", Nanos(waited))?;
        }
        if let (Some(interval), Some(clock)) = (measured.interval_ns, measured.clock) {
            writeln!(out, "shortest interval {} at {clock}", Nanos(interval))?;
        }
        if let (Some(slowest), Some(fastest)) = (measured.slowest, measured.fastest) {
            let why = measured.fastest_because.said();
            writeln!(out, "clock {slowest} to {fastest} works{why}")?;
        }
        Ok(())
    }

    /// What to do about what is missing.
    fn advice(&self, out: &mut String) -> std::fmt::Result {
        let found = self.findings;
        let said = match found.line {
            Line::Unseen => "there is no whole frame in it",
            Line::StuckHigh => {
                "check the encoder's power and the MA pair: swapped, cut, or not reaching it; some need seconds after power-on"
            }
            Line::StuckLow => {
                "check the encoder's power and the SLO pair: swapped, shorted, or without a pull-up on its receiver"
            }
            Line::NoStart => {
                "it stays busy: allow more with --busy-limit, or take a slower clock with -c"
            }
            Line::Noise => {
                "check that something drives SLO, ground and termination; take a slower clock with -c"
            }
            Line::Ssi { .. } => "this program reads BiSS-C only",
            Line::Biss if found.answers.is_empty() && found.alike() => {
                "no known CRC fits: move the encoder and ask again, so that others can be found"
            }
            Line::Biss if found.answers.is_empty() => {
                "no CRC fits: the clock may be too fast (try a slower -c), the frame may have none, or it may be SSI"
            }
            Line::Biss if found.only().is_some() => return Ok(()),
            Line::Biss if self.live => {
                "several formats fit: move the encoder while it is asked, and see more of it with -n"
            }
            Line::Biss => {
                "several formats fit: a recording in which the encoder moves more would tell them apart"
            }
        };
        writeln!(out, "{said}")
    }
}

/// What is known of the likeliest format.
fn details(out: &mut String, answer: &Answer) -> std::fmt::Result {
    let several = answer.channels.len() > 1;
    for (index, seen) in answer.channels.iter().enumerate() {
        let name = if several {
            format!("channel {index}: ")
        } else {
            String::new()
        };
        let Seen { crc, rank, .. } = seen;
        let inverted = if crc.inverted() {
            "inverted"
        } else {
            "not inverted"
        };
        writeln!(
            out,
            "       {name}CRC of {} bits, {:#X}, start value {:#X}, {inverted}; by chance 1 in 2^{}",
            crc.bits(),
            crc.poly(),
            crc.init(),
            u32::from(crc.bits()) * (rank + 1),
        )?;
        let mut parts = Vec::new();
        if seen.still >= seen.data_bits {
            parts.push("no data bit ever moved".to_owned());
        } else if seen.still > 0 {
            parts.push(format!(
                "the first {} of {} data bits never moved",
                seen.still, seen.data_bits
            ));
        }
        if seen.zeros > 0 {
            parts.push(format!(
                "the last {} of the position were always 0",
                seen.zeros
            ));
        }
        if seen.against {
            parts.push("turns count against the position".into());
        }
        if !parts.is_empty() {
            writeln!(out, "       {name}{}", parts.join(", "))?;
        }
    }
    Ok(())
}

fn line(line: Line) -> String {
    match line {
        Line::Unseen => "nothing was seen".into(),
        Line::Biss => "BiSS-C".into(),
        Line::Ssi { bits } => format!(
            "SSI, it seems: the first clock brings data already, {bits} bits at least; BiSS-C leaves SL high until the second"
        ),
        Line::StuckHigh => "nobody answers: SL stays high".into(),
        Line::StuckLow => "SL is low all the time".into(),
        Line::NoStart => "Ack comes, and no start bit".into(),
        Line::Noise => "noise: SL goes up and down without an order".into(),
    }
}

fn count(n: u64, what: &str) -> String {
    match n {
        1 => format!("1 {what}"),
        _ => format!("{n} {what}s"),
    }
}

fn span(range: Range) -> String {
    match range.min == range.max {
        true => range.min.to_string(),
        false => format!("{} to {}", range.min, range.max),
    }
}

fn times(range: Range) -> String {
    match range.min == range.max {
        true => Nanos(range.min).to_string(),
        false => format!("{} to {}", Nanos(range.min), Nanos(range.max)),
    }
}

/// Rounded down where it is nearly certain, as 100 % is never reached.
fn percent(share: f64) -> String {
    let percent = 100.0 * share;
    match percent {
        99.95.. => ">99.9%".into(),
        _ => format!("{percent:5.1}%"),
    }
}

#[derive(Serialize)]
struct Object<'a> {
    r#type: &'static str,
    line: &'static str,
    certain: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    ssi_bits: Option<usize>,
    frames: u64,
    answered: u64,
    different: usize,
    faults: serde_json::Map<String, serde_json::Value>,
    #[serde(skip_serializing_if = "Option::is_none")]
    ack_clk: Option<Span>,
    #[serde(skip_serializing_if = "Option::is_none")]
    busy_ns: Option<Span>,
    #[serde(skip_serializing_if = "Option::is_none")]
    delay_clk: Option<Span>,
    #[serde(skip_serializing_if = "Option::is_none")]
    delay_ns: Option<Span>,
    answers: Vec<Fitting>,
    unlikely: usize,
    unlikely_probability: f64,
    none_probability: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    registers: Option<Registers>,
    #[serde(skip_serializing_if = "Option::is_none")]
    phase: Option<u8>,
    #[serde(skip_serializing_if = "Option::is_none")]
    timeout_ns: Option<Span>,
    #[serde(skip_serializing_if = "Option::is_none")]
    timeout_max_ns: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    interval_ns: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    clock_hz: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    clock_min_hz: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    clock_max_hz: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    clock_limit: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    command: Option<&'a str>,
}

#[derive(Serialize)]
struct Span {
    min: u64,
    max: u64,
}

#[derive(Serialize)]
struct Fitting {
    format: String,
    probability: f64,
    good: u64,
    frames: u64,
    channels: Vec<Channel>,
}

#[derive(Serialize)]
struct Channel {
    data_bits: u8,
    crc_bits: u8,
    poly: u32,
    init: u16,
    inverted: bool,
    crc_of_zeros: u16,
    rank: u32,
    still_bits: u8,
    zero_bits: u8,
}

#[derive(Serialize)]
struct Registers {
    #[serde(skip_serializing_if = "Option::is_none")]
    format: Option<String>,
    fits: bool,
}

impl<'a> Object<'a> {
    fn of(report: &'a Report) -> Object<'a> {
        let (found, measured) = (report.findings, report.measured);
        let heads = &found.heads;
        let span = |range: Option<Range>| range.map(|Range { min, max }| Span { min, max });
        let faults = Fault::NAMES
            .iter()
            .zip(found.faults)
            .filter(|(_, times)| *times > 0);
        let best = measured.phases.iter().rev().max_by_key(|trial| trial.good);
        let timeout_ns = measured.timeout_ns.or(heads.timeout_ns);
        Object {
            r#type: "detect",
            line: found.line.name(),
            certain: found.only().is_some(),
            ssi_bits: match found.line {
                Line::Ssi { bits } => Some(bits),
                _ => None,
            },
            frames: found.frames,
            answered: found.answered,
            different: found.different,
            faults: faults
                .map(|(name, times)| ((*name).into(), times.into()))
                .collect(),
            ack_clk: span(heads.ack),
            busy_ns: span(heads.busy_ns),
            delay_clk: span(heads.delay_clk),
            delay_ns: span(heads.delay_ns),
            answers: found.answers.iter().map(Fitting::of).collect(),
            unlikely: found.unlikely,
            unlikely_probability: found.unlikely_probability,
            none_probability: found.none_probability,
            registers: match report.told {
                Told::Frame { format, fits } => Some(Registers {
                    format: Some(format.to_string()),
                    fits: *fits,
                }),
                Told::Nothing(_) => Some(Registers {
                    format: None,
                    fits: false,
                }),
                Told::Unasked | Told::Silent => None,
            },
            phase: best.map(PhaseTrial::number),
            timeout_ns: span(timeout_ns),
            timeout_max_ns: measured.waited_ns.filter(|_| timeout_ns.is_none()),
            interval_ns: measured.interval_ns,
            clock_hz: measured.clock.map(|clock| clock.0),
            clock_min_hz: measured.slowest.map(|clock| clock.0),
            clock_max_hz: measured.fastest.map(|clock| clock.0),
            clock_limit: measured.fastest_because.name(),
            command: report
                .command
                .as_deref()
                .filter(|_| found.line == Line::Biss),
        }
    }
}

impl Fitting {
    fn of(answer: &Answer) -> Fitting {
        let channel = |seen: &Seen| Channel {
            data_bits: seen.data_bits,
            crc_bits: seen.crc.bits(),
            poly: seen.crc.poly(),
            init: seen.crc.init(),
            inverted: seen.crc.inverted(),
            crc_of_zeros: seen.crc.of(0, seen.data_bits),
            rank: seen.rank,
            still_bits: seen.still,
            zero_bits: seen.zeros,
        };
        Fitting {
            format: answer.format.to_string(),
            probability: answer.probability,
            good: answer.good,
            frames: answer.frames,
            channels: answer.channels.iter().map(channel).collect(),
        }
    }
}
