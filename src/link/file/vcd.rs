//! VCD, as PulseView, GTKWave, sigrok-cli and HDL simulators write it.

use super::source::{Channel, Damage, Source};
use crate::slice::Slicer;
use std::io::{self, BufRead, BufReader, Read};
use vcd::{Command, IdCode, Parser, ScopeItem, Value};

/// A VCD file.
pub(super) struct Vcd {
    parser: Parser<Box<dyn BufRead>>,
    channels: Vec<Channel>,
    /// By [`Channel::id`].
    codes: Vec<IdCode>,
    ma_id: Option<IdCode>,
    slo_id: Option<IdCode>,
    /// One tick is so many femtoseconds.
    tick_fs: u64,
    /// The levels that hold from `tick` on, to be pushed when the next time comes.
    tick: u64,
    ma: Option<bool>,
    slo: Option<bool>,
    /// MA has changed in this tick, and changed again.
    ma_moved: bool,
    coarse: bool,
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

impl Vcd {
    /// Reads the header.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(super) fn open(input: impl Read + 'static) -> Result<Vcd, String> {
        // The parser wants whitespace behind the last word, and keeps a word of any length.
        let whole = Bounded {
            inner: input,
            unbroken: 0,
        }
        .chain(&b"\n"[..]);
        let reader: Box<dyn BufRead> = Box::new(BufReader::with_capacity(1 << 16, whole));
        let mut parser = Parser::new(reader);
        let header = parser.parse_header().map_err(|e| complaint(&e))?;
        let (count, unit) = header.timescale.ok_or("it has no $timescale")?;
        let (mut channels, mut codes) = (Vec::new(), Vec::new());
        collect(&header.items, "", &mut channels, &mut codes);
        Ok(Vcd {
            parser,
            channels,
            codes,
            ma_id: None,
            slo_id: None,
            tick_fs: u64::from(count).saturating_mul(1_000_000_000_000_000 / unit.divisor()),
            tick: 0,
            ma: None,
            slo: None,
            ma_moved: false,
            coarse: false,
        })
    }

    fn ns(&self, tick: u64) -> u64 {
        u64::try_from(u128::from(tick) * u128::from(self.tick_fs) / 1_000_000).unwrap_or(u64::MAX)
    }

    /// Hands the levels of the tick that is over to the slicer.
    fn flush(&mut self, slicer: &mut Slicer) {
        let t_ns = self.ns(self.tick);
        match self.ma {
            Some(ma) => slicer.push(t_ns, ma, self.slo),
            // Before MA is known there is nothing to time, and no edge can be told after it was lost.
            None => slicer.gap(t_ns),
        }
        self.ma_moved = false;
    }

    /// Reads one more command. False at the end.
    fn step(&mut self, slicer: &mut Slicer) -> Result<bool, Damage> {
        match self.parser.next() {
            Some(Ok(Command::Timestamp(tick))) if tick != self.tick => {
                self.flush(slicer);
                if tick < self.tick {
                    return Err(self.spoiled("time goes backwards".into()));
                }
                self.tick = tick;
                if self.coarse {
                    return Err(self.spoiled(
                        "MA changes twice within one tick: the time scale is too coarse for it"
                            .into(),
                    ));
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
            Some(Err(error)) => return Err(self.spoiled(complaint(&error))),
            None => return Ok(false),
        }
        Ok(true)
    }

    fn spoiled(&self, said: String) -> Damage {
        Damage {
            place: format!("line {}", self.parser.line()),
            said,
        }
    }

    fn change(&mut self, id: IdCode, value: Value) {
        let level = match value {
            Value::V0 => Some(false),
            Value::V1 => Some(true),
            Value::X | Value::Z => None,
        };
        if Some(id) == self.ma_id {
            if self.ma_moved && level.is_some() && level != self.ma {
                self.coarse = true;
            }
            self.ma_moved |= level != self.ma;
            self.ma = level;
        }
        if Some(id) == self.slo_id {
            self.slo = level;
        }
    }
}

impl Source for Vcd {
    fn channels(&self) -> &[Channel] {
        &self.channels
    }

    fn select(&mut self, ma: usize, slo: usize) {
        self.ma_id = self.codes.get(ma).copied();
        self.slo_id = self.codes.get(slo).copied();
    }

    fn read(&mut self, slicer: &mut Slicer) -> Result<bool, Damage> {
        let more = self.step(slicer);
        if !matches!(more, Ok(true)) {
            self.flush(slicer);
        }
        more
    }

    fn now_ns(&self) -> u64 {
        self.ns(self.tick)
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
fn collect(items: &[ScopeItem], scope: &str, channels: &mut Vec<Channel>, codes: &mut Vec<IdCode>) {
    for item in items {
        match item {
            ScopeItem::Scope(inner) => {
                let scope = format!("{scope}{}.", inner.identifier);
                collect(&inner.items, &scope, channels, codes);
            }
            ScopeItem::Var(var) if var.size == 1 => {
                let known = codes.iter().position(|code| *code == var.code);
                let id = known.unwrap_or_else(|| {
                    codes.push(var.code);
                    codes.len() - 1
                });
                channels.push(Channel {
                    name: var.reference.clone(),
                    path: format!("{scope}{}", var.reference),
                    id,
                });
            }
            _ => {}
        }
    }
}
