//! `file`: a VCD recording of MA and SLO as a link that is not live.

use super::{Caps, Clock, Error, Known, Link};
use crate::slice::Slicer;
use crate::trace::{Ask, Trace};
use crate::unit::Hertz;
use std::io::{self, BufRead, BufReader, Read};
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
    /// MA has changed in this tick, and changed again.
    ma_moved: bool,
    coarse: bool,
    now_ns: u64,
    ended: bool,
    damage: Option<Error>,
}

const HINT: &str =
    "biss reads VCD files, as PulseView, GTKWave, sigrok-cli -O vcd and HDL simulators write them";

/// Reads a VCD recording and finds MA and SLO in it by name. `name` is for messages, `timeout_max_ns` is the longest
/// timeout of the slave.
///
/// # Errors
/// When it cannot be read, is no VCD, or has no such signals.
pub fn open(
    input: impl Read + 'static,
    name: &str,
    ma: Option<&str>,
    slo: Option<&str>,
    timeout_max_ns: u64,
) -> Result<Recording, Error> {
    // The parser wants whitespace behind the last word, and keeps a word of any length.
    let whole = Bounded {
        inner: input,
        unbroken: 0,
    }
    .chain(&b"\n"[..]);
    let reader: Box<dyn BufRead> = Box::new(BufReader::with_capacity(1 << 16, whole));
    Recording::new(reader, name.to_owned(), ma, slo, timeout_max_ns)
}

/// Refuses what no VCD has, so that a broken input cannot fill the memory.
struct Bounded<R> {
    inner: R,
    /// Bytes since the last end of a line.
    unbroken: usize,
}

const LONGEST_LINE: usize = 1 << 20;

impl<R: Read> Read for Bounded<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let n = self.inner.read(buffer)?;
        self.unbroken = match buffer[..n].iter().rposition(|byte| *byte == b'\n') {
            Some(end) => n - end - 1,
            None => self.unbroken + n,
        };
        if self.unbroken > LONGEST_LINE {
            return Err(io::Error::new(
                io::ErrorKind::InvalidData,
                "a line of more than 1 MiB",
            ));
        }
        Ok(n)
    }
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
            .map_err(|e| Error::new(&doing, complaint(&e), HINT))?;
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
            tick_fs: u64::from(count).saturating_mul(1_000_000_000_000_000 / unit.divisor()),
            slicer: Slicer::new(timeout_max_ns),
            tick: 0,
            ma: None,
            slo: None,
            ma_moved: false,
            coarse: false,
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
        let t_ns = self.ns(self.tick);
        match self.ma {
            Some(ma) => self.slicer.push(t_ns, ma, self.slo),
            // Before MA is known there is nothing to time, and no edge can be told after it was lost.
            None => self.slicer.gap(t_ns),
        }
        self.ma_moved = false;
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
                if self.coarse {
                    self.spoiled(
                        "MA changes twice within one tick: the time scale is too coarse for it"
                            .into(),
                    );
                    return false;
                }
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
                self.spoiled(complaint(&error));
                return false;
            }
            None => return false,
        }
        true
    }

    fn spoiled(&mut self, said: String) {
        let doing = format!(
            "reading the recording {}, line {}",
            self.name,
            self.parser.line()
        );
        self.damage = Some(Error::new(
            doing,
            said,
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
            if self.ma_moved && level.is_some() && level != self.ma {
                self.coarse = true;
            }
            self.ma_moved |= level != self.ma;
            self.ma = level;
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

/// What is wrong with the text of a file is told from trouble in reading it.
fn complaint(error: &io::Error) -> String {
    match error
        .get_ref()
        .and_then(|inner| inner.downcast_ref::<vcd::ParseError>())
    {
        Some(parse) => format!("this is no VCD: {parse}"),
        None => error.to_string(),
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
    let say = format!("say which: file:PATH,{key}=NAME");
    let by_name = |name: &str| -> Vec<&(String, &Var)> {
        let exact: Vec<_> = wires
            .iter()
            .filter(|(path, var)| path == name || var.reference == name)
            .collect();
        let alike = || {
            wires
                .iter()
                .filter(|(_, var)| var.reference.eq_ignore_ascii_case(name))
                .collect()
        };
        if exact.is_empty() { alike() } else { exact }
    };
    let found = match asked {
        Some(name) => by_name(name),
        None => usual
            .iter()
            .map(|name| by_name(name))
            .find(|found| !found.is_empty())
            .unwrap_or_default(),
    };
    let list = |wires: &mut dyn Iterator<Item = &str>| wires.collect::<Vec<_>>().join(", ");
    let Some((_, first)) = found.first() else {
        let what = match asked {
            Some(name) => format!("no signal `{name}`"),
            None => format!("no signal that looks like {}", key.to_uppercase()),
        };
        let names = list(&mut wires.iter().map(|(path, _)| path.as_str()));
        let names = if names.is_empty() {
            "none".to_owned()
        } else {
            names
        };
        return Err(Error::new(
            doing,
            format!("{what}; one-bit signals are: {names}"),
            say,
        ));
    };
    // The same signal under several names is one signal.
    if found.iter().any(|(_, var)| var.code != first.code) {
        let names = list(&mut found.iter().map(|(path, _)| path.as_str()));
        return Err(Error::new(
            doing,
            format!("several signals could be {}: {names}", key.to_uppercase()),
            say,
        ));
    }
    Ok(first.code)
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
            "leave --clock out",
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
