//! `file`: a recording of MA and SLO as a link that is not live.

mod csv;
mod source;
mod text;
mod vcd;

use super::{Caps, Clock, Error, Known, Link};
use crate::slice::Slicer;
use crate::trace::{Ask, Trace};
use crate::unit::Hertz;
use crate::waveform::Waveform;
use csv::Csv;
use source::{Channel, Source};
use std::io::{self, Cursor, Read};
use vcd::Vcd;

/// A recording, read as it is used.
pub struct Recording {
    source: Box<dyn Source>,
    name: String,
    slicer: Slicer,
    now_ns: u64,
    ended: bool,
    damage: Option<Error>,
}

const HINT: &str = "biss reads VCD, as PulseView, GTKWave, sigrok-cli -O vcd and HDL simulators write it, and CSV of logic analysers";

/// Reads a recording, VCD or CSV, and finds MA and SLO in it by name. `name` is for messages, `timeout_max_ns` is the longest
/// timeout of the slave.
///
/// # Errors
/// When it cannot be read, is neither, or has no such signals.
pub fn open(
    mut input: impl Read + 'static,
    name: &str,
    ma: Option<&str>,
    slo: Option<&str>,
    timeout_max_ns: u64,
) -> Result<Recording, Error> {
    let doing = format!("reading the header of {name}");
    let error = |said: String| Error::new(&doing, said, HINT);
    let head = head(&mut input).map_err(|e| error(e.to_string()))?;
    let csv = !vcd::looks_like(&head) && csv::looks_like(&head);
    let input = Cursor::new(head).chain(input);
    let source: Box<dyn Source> = if csv {
        Box::new(Csv::open(input, None).map_err(error)?)
    } else {
        Box::new(Vcd::open(input).map_err(error)?)
    };
    Recording::new(source, name.to_owned(), ma, slo, timeout_max_ns)
}

/// What tells one kind from another: the first line that is more than nothing.
fn head(input: &mut impl Read) -> io::Result<Vec<u8>> {
    let mut head = vec![0; 4096];
    let mut n = 0;
    while n < head.len() && !head[..n].trim_ascii_start().contains(&b'\n') {
        match input.read(&mut head[n..]) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Ok(0) => break,
            read => n += read?,
        }
    }
    head.truncate(n);
    Ok(head)
}

impl Recording {
    fn new(
        mut source: Box<dyn Source>,
        name: String,
        ma: Option<&str>,
        slo: Option<&str>,
        timeout_max_ns: u64,
    ) -> Result<Recording, Error> {
        let doing = format!("reading the header of {name}");
        let mut named = |name: Option<&str>| name.map_or(Vec::new(), |name| source.named(name));
        let (bits_ma, bits_slo) = (named(ma), named(slo));
        let ma = find(
            source.channels(),
            &bits_ma,
            ma,
            &["ma", "ma+", "ma_p", "clk", "clock", "mao"],
            "ma",
            &doing,
        )?;
        let slo = find(
            source.channels(),
            &bits_slo,
            slo,
            &["slo", "sl", "slo+", "sl+", "slo_p", "sl_p", "data"],
            "slo",
            &doing,
        )?;
        if ma == slo {
            return Err(Error::new(
                doing,
                "ma and slo name the same signal",
                "give both: file:PATH,ma=NAME,slo=NAME",
            ));
        }
        source.select(ma, slo);
        Ok(Recording {
            source,
            name,
            slicer: Slicer::new(timeout_max_ns),
            now_ns: 0,
            ended: false,
            damage: None,
        })
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
            let read = self.source.read(&mut self.slicer);
            if read == Ok(true) {
                continue;
            }
            self.ended = true;
            self.slicer.finish(self.source.now_ns());
            self.damage = read.err().map(|damage| {
                Error::new(
                    format!("reading the recording {}, {}", self.name, damage.place),
                    damage.said,
                    "everything before this place was delivered",
                )
            });
        }
    }
}

fn find(
    channels: &[Channel],
    bits: &[Channel],
    asked: Option<&str>,
    usual: &[&str],
    key: &str,
    doing: &str,
) -> Result<usize, Error> {
    let say = format!("say which: file:PATH,{key}=NAME");
    let by_name = |name: &str| -> Vec<&Channel> {
        let exact: Vec<_> = channels
            .iter()
            .filter(|channel| channel.path == name || channel.name == name)
            .collect();
        let alike = || {
            channels
                .iter()
                .filter(|channel| channel.name.eq_ignore_ascii_case(name))
                .collect()
        };
        if exact.is_empty() { alike() } else { exact }
    };
    let found = match asked {
        Some(name) => match by_name(name) {
            none if none.is_empty() => bits.iter().collect(),
            found => found,
        },
        None => usual
            .iter()
            .map(|name| by_name(name))
            .find(|found| !found.is_empty())
            .unwrap_or_default(),
    };
    let list = |found: &mut dyn Iterator<Item = &Channel>| {
        let paths: Vec<&str> = found.map(|channel| channel.path.as_str()).collect();
        paths.join(", ")
    };
    let Some(first) = found.first() else {
        let what = match asked {
            Some(name) => format!("no signal `{name}`"),
            None => format!("no signal that looks like {}", key.to_uppercase()),
        };
        let names = list(&mut channels.iter());
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
    if found.iter().any(|channel| channel.id != first.id) {
        let names = list(&mut found.iter().copied());
        return Err(Error::new(
            doing,
            format!("several signals could be {}: {names}", key.to_uppercase()),
            say,
        ));
    }
    Ok(first.id)
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
        if out.iter().any(|trace| trace.wave.is_some()) {
            self.slicer.keep_waveform();
        }
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

    fn waveform(&mut self, wave: &mut Waveform) -> Result<(), Error> {
        self.slicer.keep_waveform();
        self.slicer.rest(wave);
        if self.ended {
            self.now_ns = self.source.now_ns();
        }
        Ok(())
    }
}
