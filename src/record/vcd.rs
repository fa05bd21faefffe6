//! VCD: both wires, and beside them what each frame said, as signals that change where it began.
//!
//! sigrok makes a channel of every bit and none of strings; types that it does not know it takes for damage.

use super::{Head, Lines, Recorder};
use crate::cycle::{Cycle, Fault};
use crate::format::{Channel, Kind};
use crate::waveform::Change;
use std::io;

/// What a signal shows of a frame.
enum Shows {
    /// A field of the data.
    Field(crate::format::Field),
    Error,
    Warning,
}

/// A signal beside the wires.
struct Signal {
    id: String,
    name: String,
    ch: usize,
    bits: u8,
    shows: Shows,
    /// As it was written last.
    now: Option<u64>,
}

pub(super) struct Vcd {
    lines: Lines,
    t_ns: u64,
    last: Change,
    channels: Vec<Channel>,
    signals: Vec<Signal>,
    /// As it was written last; sigrok stumbles over strings, so there is none until something is wrong.
    fault: Option<Fault>,
    tells: bool,
}

const FAULT: &str = "%";

impl Vcd {
    pub(super) fn begin(lines: Lines, head: &Head) -> io::Result<Vcd> {
        let channels = head.format.map(|format| format.channels().to_vec());
        let channels = channels.unwrap_or_default();
        let mut vcd = Vcd {
            lines,
            t_ns: head.first.t_ns,
            last: head.first,
            signals: signals(&channels),
            channels,
            fault: None,
            tells: head.format.is_some(),
        };
        vcd.head(head)?;
        vcd.lines.pass()?;
        Ok(vcd)
    }

    fn head(&mut self, head: &Head) -> io::Result<()> {
        let lines = &mut self.lines;
        lines.add(format_args!(
            "$version biss {} $end\n",
            env!("CARGO_PKG_VERSION")
        ))?;
        if !head.notes.is_empty() {
            lines.add(format_args!("$comment\n"))?;
            for note in head.notes {
                // A dollar sign may be the end of the comment.
                lines.add(format_args!("  {}\n", note.replace('$', "")))?;
            }
            lines.add(format_args!("$end\n"))?;
        }
        lines.add(format_args!(
            "$timescale 1 ns $end\n\
             $scope module biss $end\n\
             $var wire 1 ! MA $end\n\
             $var wire 1 \" SLO $end\n"
        ))?;
        if head.format.is_some() {
            lines.add(format_args!("$var string 1 {FAULT} fault $end\n"))?;
        }
        let several = self.channels.len() > 1;
        for (ch, _) in self.channels.iter().enumerate() {
            if several {
                lines.add(format_args!("$scope module ch{ch} $end\n"))?;
            }
            for signal in self.signals.iter().filter(|signal| signal.ch == ch) {
                let Signal { id, name, bits, .. } = signal;
                match bits {
                    1 => lines.add(format_args!("$var reg 1 {id} {name} $end\n"))?,
                    _ => lines.add(format_args!(
                        "$var reg {bits} {id} {name} [{}:0] $end\n",
                        bits - 1
                    ))?,
                }
            }
            if several {
                lines.add(format_args!("$upscope $end\n"))?;
            }
        }
        lines.add(format_args!(
            "$upscope $end\n$enddefinitions $end\n#{}\n$dumpvars\n",
            self.t_ns
        ))?;
        lines.add(format_args!("{}!\n", u8::from(head.first.ma)))?;
        lines.add(format_args!("{}\"\n", level(head.first.slo)))?;
        for signal in &self.signals {
            write(lines, signal, None)?;
        }
        lines.add(format_args!("$end\n"))
    }

    fn at(&mut self, t_ns: u64) -> io::Result<()> {
        if t_ns <= self.t_ns {
            return Ok(());
        }
        self.t_ns = t_ns;
        self.lines.add(format_args!("#{t_ns}\n"))
    }
}

fn level(slo: Option<bool>) -> char {
    match slo {
        Some(true) => '1',
        Some(false) => '0',
        None => 'x',
    }
}

fn write(lines: &mut Lines, signal: &Signal, value: Option<u64>) -> io::Result<()> {
    let id = &signal.id;
    match (signal.bits, value) {
        (1, Some(value)) => lines.add(format_args!("{value}{id}\n")),
        (1, None) => lines.add(format_args!("x{id}\n")),
        (_, Some(value)) => lines.add(format_args!("b{value:b} {id}\n")),
        (_, None) => lines.add(format_args!("bx {id}\n")),
    }
}

/// What stands beside the wires, named as in records.
fn signals(channels: &[Channel]) -> Vec<Signal> {
    let mut signals: Vec<Signal> = Vec::new();
    for (ch, channel) in channels.iter().enumerate() {
        let mut add = |name: &str, bits, shows| {
            signals.push(Signal {
                id: id(signals.len()),
                name: name.into(),
                ch,
                bits,
                shows,
                now: None,
            });
        };
        let flag = |wanted: fn(&Kind) -> bool| channel.find(wanted).is_some();
        for field in channel.fields() {
            let name = match field.kind() {
                Kind::Turn => "turn",
                Kind::SingleTurn | Kind::Position => "pos",
                Kind::Life => "lc",
                Kind::Data(name) => name,
                _ => continue,
            };
            // A single bit must not be taken for MA or SLO, whatever it is called.
            let name = match field.bits() {
                1 => format!("{name}_bit"),
                _ => name.to_owned(),
            };
            add(&name, field.bits(), Shows::Field(field.clone()));
        }
        if flag(|kind| matches!(kind, Kind::Error { .. })) {
            add("error", 1, Shows::Error);
        }
        if flag(|kind| matches!(kind, Kind::Warning { .. })) {
            add("warning", 1, Shows::Warning);
        }
    }
    signals
}

/// `A`, `B` … `Z`, `AA` …: none looks like a value.
fn id(mut index: usize) -> String {
    let mut id = Vec::new();
    loop {
        id.insert(0, b'A' + (index % 26) as u8);
        match index / 26 {
            0 => return String::from_utf8_lossy(&id).into_owned(),
            more => index = more - 1,
        }
    }
}

impl Recorder for Vcd {
    fn change(&mut self, change: &Change) -> io::Result<()> {
        self.at(change.t_ns)?;
        if change.ma != self.last.ma {
            self.lines.add(format_args!("{}!\n", u8::from(change.ma)))?;
        }
        if change.slo != self.last.slo {
            self.lines.add(format_args!("{}\"\n", level(change.slo)))?;
        }
        self.last = *change;
        self.lines.pass()
    }

    fn frame(&mut self, t_ns: u64, cycle: &Cycle) -> io::Result<()> {
        self.at(t_ns)?;
        let word = |ch: usize| cycle.words().get(ch).filter(|_| cycle.fault().is_none());
        let of_word = || cycle.words().iter().find_map(|word| word.fault());
        let fault = cycle.fault().or_else(of_word).filter(|_| self.tells);
        if self.fault != fault {
            // A value has no blanks.
            let said = fault.map_or("ok".into(), |fault| fault.to_string());
            let said = said.replace(": ", ":").replace(", ", ",").replace(' ', "_");
            self.lines.add(format_args!("s{said} {FAULT}\n"))?;
            self.fault = fault;
        }
        for signal in &mut self.signals {
            let (channel, data) = (
                &self.channels[signal.ch],
                word(signal.ch).and_then(|word| word.good()),
            );
            let flag = |flag: Option<bool>| flag.map(u64::from);
            let value = data.and_then(|data| match &signal.shows {
                Shows::Field(field) => Some(field.get(data)),
                Shows::Error => flag(channel.error(data)),
                Shows::Warning => flag(channel.warning(data)),
            });
            if signal.now != value {
                write(&mut self.lines, signal, value)?;
                signal.now = value;
            }
        }
        self.lines.pass()
    }

    fn flush(&mut self) -> io::Result<()> {
        self.lines.write()
    }

    fn end(&mut self, t_ns: u64) -> io::Result<()> {
        self.at(t_ns)?;
        self.lines.write()
    }
}
