//! `file`: a VCD recording of MA and SLO as a link that is not live.

use super::{Caps, Clock, Error, Known, Link};
use crate::slice::Slicer;
use crate::trace::{Ask, Trace};
use crate::unit::Hertz;
use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::path::Path;
use vcd::{Command, IdCode, Parser, ScopeItem, Value, Var};

/// A recording, read as it is used.
pub struct Recording {
    parser: Parser<Box<dyn BufRead>>,
    name: String,
    ma_id: IdCode,
    slo_id: IdCode,
    /// One tick is so many femtoseconds.
    tick_fs: u64,
    slicer: Slicer,
    /// The levels that hold from `tick` on, to be pushed when the next time comes.
    tick: u64,
    ma: Option<bool>,
    slo: Option<bool>,
    now_ns: u64,
    ended: bool,
    damage: Option<Error>,
}

const HINT: &str =
    "biss reads VCD files, as PulseView, GTKWave, sigrok-cli -O vcd and HDL simulators write them";

/// Opens a VCD file, `-` for standard input, and finds MA and SLO in it by name. `timeout_max_ns` is the
/// longest timeout of the slave.
///
/// # Errors
/// When the file cannot be read, is no VCD, or has no such signals.
pub fn open(
    path: &Path,
    ma: Option<&str>,
    slo: Option<&str>,
    timeout_max_ns: u64,
) -> Result<Recording, Error> {
    let name = path.display().to_string();
    let opening = || format!("opening the recording {name}");
    let reader: Box<dyn BufRead> = if path.as_os_str() == "-" {
        Box::new(BufReader::new(io::stdin()))
    } else {
        let file = File::open(path).map_err(|e| {
            Error::new(opening(), e, "check the path; a comma in it is written \\,")
        })?;
        Box::new(BufReader::new(file))
    };
    Recording::new(reader, name, ma, slo, timeout_max_ns)
}

impl Recording {
    fn new(
        reader: Box<dyn BufRead>,
        name: String,
        ma: Option<&str>,
        slo: Option<&str>,
        timeout_max_ns: u64,
    ) -> Result<Recording, Error> {
        let doing = format!("reading the header of {name}");
        let mut parser = Parser::new(reader);
        let header = parser
            .parse_header()
            .map_err(|e| Error::new(&doing, format!("line {}: {e}", parser.line()), HINT))?;
        let (count, unit) = header
            .timescale
            .ok_or_else(|| Error::new(&doing, "it has no $timescale", HINT))?;
        let mut wires = Vec::new();
        collect(&header.items, "", &mut wires);
        let ma_id = find(
            &wires,
            ma,
            &["ma", "ma+", "ma_p", "clk", "clock", "mao"],
            "ma",
            &doing,
        )?;
        let slo_id = find(
            &wires,
            slo,
            &["slo", "sl", "slo+", "sl+", "slo_p", "sl_p", "data"],
            "slo",
            &doing,
        )?;
        if ma_id == slo_id {
            return Err(Error::new(
                doing,
                "ma and slo name the same signal",
                "give both: file:PATH,ma=NAME,slo=NAME",
            ));
        }
        Ok(Recording {
            parser,
            name,
            ma_id,
            slo_id,
            tick_fs: u64::from(count) * (1_000_000_000_000_000 / unit.divisor()),
            slicer: Slicer::new(timeout_max_ns),
            tick: 0,
            ma: None,
            slo: None,
            now_ns: 0,
            ended: false,
            damage: None,
        })
    }

    fn ns(&self, tick: u64) -> u64 {
        u64::try_from(u128::from(tick) * u128::from(self.tick_fs) / 1_000_000).unwrap_or(u64::MAX)
    }

    /// Hands the levels of the tick that is over to the slicer.
    fn flush(&mut self) {
        // Before MA is known there is nothing to time.
        if let Some(ma) = self.ma {
            self.slicer.push(self.ns(self.tick), ma, self.slo);
        }
    }

    /// Reads one more command. False at the end.
    fn step(&mut self) -> bool {
        match self.parser.next() {
            Some(Ok(Command::Timestamp(tick))) if tick != self.tick => {
                self.flush();
                if tick < self.tick {
                    self.spoiled("time goes backwards".into());
                    return false;
                }
                self.tick = tick;
            }
            Some(Ok(Command::ChangeScalar(id, value))) => self.change(id, value),
            Some(Ok(Command::ChangeVector(id, values))) => {
                // A wire of one bit, written as a vector of one.
                if let Some(value) = values.get(values.len().wrapping_sub(1)) {
                    self.change(id, value);
                }
            }
            Some(Ok(_)) => {}
            Some(Err(error)) => {
                self.spoiled(error.to_string());
                return false;
            }
            None => return false,
        }
        true
    }

    fn spoiled(&mut self, said: String) {
        let line = self.parser.line();
        self.damage = Some(Error::new(
            format!("reading the recording {}", self.name),
            format!("line {line}: {said}"),
            "everything before this line was delivered",
        ));
    }

    fn change(&mut self, id: IdCode, value: Value) {
        let level = match value {
            Value::V0 => Some(false),
            Value::V1 => Some(true),
            Value::X | Value::Z => None,
        };
        if id == self.ma_id {
            // An edge of MA is one that was seen: x and z leave it where it was.
            self.ma = level.or(self.ma);
        }
        if id == self.slo_id {
            self.slo = level;
        }
    }

    fn next_trace(&mut self, trace: &mut Trace) -> bool {
        loop {
            if self.slicer.take(trace) {
                self.now_ns = trace.t_ns;
                return true;
            }
            if self.ended {
                return false;
            }
            if !self.step() {
                self.ended = true;
                self.flush();
                self.slicer.finish(self.ns(self.tick));
            }
        }
    }
}

/// All one-bit signals with their scopes.
fn collect<'a>(items: &'a [ScopeItem], scope: &str, wires: &mut Vec<(String, &'a Var)>) {
    for item in items {
        match item {
            ScopeItem::Scope(inner) => collect(
                &inner.items,
                &format!("{scope}{}.", inner.identifier),
                wires,
            ),
            ScopeItem::Var(var) if var.size == 1 => {
                wires.push((format!("{scope}{}", var.reference), var))
            }
            _ => {}
        }
    }
}

fn find(
    wires: &[(String, &Var)],
    asked: Option<&str>,
    usual: &[&str],
    key: &str,
    doing: &str,
) -> Result<IdCode, Error> {
    let by_name = |name: &str| {
        let matches = |(path, var): &&(String, &Var)| path == name || var.reference == name;
        let exact = wires.iter().find(matches);
        exact.or_else(|| {
            wires
                .iter()
                .find(|(_, var)| var.reference.eq_ignore_ascii_case(name))
        })
    };
    let found = match asked {
        Some(name) => by_name(name),
        None => usual.iter().find_map(|name| by_name(name)),
    };
    let names: Vec<&str> = wires.iter().map(|(path, _)| path.as_str()).collect();
    let list = if names.is_empty() {
        "none".to_owned()
    } else {
        names.join(", ")
    };
    found.map(|(_, var)| var.code).ok_or_else(|| {
        let what = match asked {
            Some(name) => format!("no signal `{name}`"),
            None => format!("no signal that looks like {}", key.to_uppercase()),
        };
        Error::new(
            doing,
            format!("{what}; one-bit signals are: {list}"),
            format!("say which: file:PATH,{key}=NAME"),
        )
    })
}

impl std::fmt::Debug for Recording {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Recording")
            .field("name", &self.name)
            .finish_non_exhaustive()
    }
}

impl Link for Recording {
    fn caps(&self) -> Caps {
        Caps {
            live: false,
            reacts: false,
            cdm: false,
            sees_idle: true,
            times_levels: true,
            phases: &[],
            virtual_time: true,
            burst: 1,
        }
    }

    fn now_ns(&self) -> u64 {
        self.now_ns
    }

    fn clock(&self) -> Clock {
        Clock {
            hz: Hertz(0),
            known: Known::Measured,
        }
    }

    fn set_clock(&mut self, _: Hertz) -> Result<Clock, Error> {
        let doing = format!("setting the clock of {}", self.name);
        Err(Error::new(
            doing,
            "a recording has the clock it was made with",
            "leave --clock away",
        ))
    }

    fn idle(&mut self, _: u64) -> Result<Option<bool>, Error> {
        Ok(None)
    }

    fn cycles(&mut self, asks: &[Ask], out: &mut [Trace]) -> Result<usize, Error> {
        let wanted = asks.len().min(out.len());
        for (done, trace) in out.iter_mut().take(wanted).enumerate() {
            if !self.next_trace(trace) {
                return match self.damage.take() {
                    Some(damage) if done == 0 => Err(damage),
                    damage => {
                        self.damage = damage;
                        Ok(done)
                    }
                };
            }
        }
        Ok(wanted)
    }
}
