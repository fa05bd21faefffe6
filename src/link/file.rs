//! `file`: a recording of MA and SLO as a link that is not live.

mod advice;
mod behaviour;
mod csv;
mod names;
mod raw;
mod source;
mod sr;
mod tape;
mod text;
mod vcd;

pub use tape::{Blocks, Input};

use super::{Caps, Clock, Error, Known, Link};
use crate::slice::Slicer;
use crate::trace::{Ask, Trace};
use crate::unit::Hertz;
use crate::waveform::Waveform;
use advice::Clocks;
use csv::Csv;
use names::{MA, Picked, SLO, list, pick};
use raw::Raw;
use source::{Channel, Source};
use sr::Sr;
use std::collections::VecDeque;
use tape::{Disk, Tape};
use vcd::Vcd;

/// What is known of a recording that is not in it, and what the slave is known to do.
#[derive(Clone, Debug)]
pub struct Asked {
    /// Name or number of MA.
    pub ma: Option<String>,
    /// Name or number of SLO.
    pub slo: Option<String>,
    /// Samples a second, where it does not say so.
    pub rate: Option<Hertz>,
    /// Bytes a sample, where it is nothing but samples.
    pub unit: Option<u8>,
    /// The longest timeout of the slave.
    pub timeout_max_ns: u64,
}

impl Asked {
    /// Nothing but that timeout.
    pub fn new(timeout_max_ns: u64) -> Asked {
        Asked {
            ma: None,
            slo: None,
            rate: None,
            unit: None,
            timeout_max_ns,
        }
    }
}

/// A recording, read as it is used.
pub struct Recording {
    source: Box<dyn Source>,
    name: String,
    notes: Vec<String>,
    slicer: Slicer,
    /// Cycles that were looked at before it was their turn.
    ahead: VecDeque<Trace>,
    clocks: Clocks,
    /// The rate was asked for.
    rated: bool,
    now_ns: u64,
    ended: bool,
    damage: Option<Error>,
}

const HINT: &str = "biss reads sessions of sigrok (.sr), VCD, CSV of logic analysers, and samples alone with rate=: file:PATH,rate=100MHz,ma=0,slo=1";

/// Reads a recording, whose kind is found from its first bytes, and finds MA and SLO in it. `name` is for messages.
///
/// # Errors
/// When it cannot be read, is of no known kind, or has no such signals.
pub fn open(input: Input, name: &str, asked: &Asked) -> Result<Recording, Error> {
    let doing = format!("reading the header of {name}");
    let reader = Reader::new(input, asked, doing)?;
    let (mut source, bits) = reader.fresh()?;
    let doing = &reader.doing;
    let ma = pick(&*source, &bits.0, asked.ma.as_deref(), &MA, doing)?;
    let slo = pick(&*source, &bits.1, asked.slo.as_deref(), &SLO, doing)?;
    let notes = said_of_names(&ma, &slo);
    let (ma, slo, notes) = match (ma, slo) {
        (Picked::Sure(ma) | Picked::Usual(ma), Picked::Sure(slo) | Picked::Usual(slo)) => {
            (ma, slo, notes)
        }
        (ma, slo) => {
            drop(source);
            let (ma, slo, note) = reader.by_behaviour(&ma, &slo)?;
            reader.tape.let_go();
            (source, _) = reader.fresh()?;
            (ma, slo, vec![note])
        }
    };
    reader.tape.let_go();
    if ma.id == slo.id {
        return Err(Error::new(
            doing,
            "ma and slo name the same signal",
            "give both: file:PATH,ma=NAME,slo=NAME",
        ));
    }
    source.select(ma.id, slo.id);
    Ok(Recording {
        source,
        name: name.to_owned(),
        notes,
        slicer: Slicer::new(asked.timeout_max_ns),
        ahead: VecDeque::new(),
        clocks: Clocks::default(),
        rated: asked.rate.is_some(),
        now_ns: 0,
        ended: false,
        damage: None,
    })
}

/// That names were taken for those of the wires.
fn said_of_names(ma: &Picked, slo: &Picked) -> Vec<String> {
    let usual = [(&MA, ma), (&SLO, slo)];
    let usual = usual.iter().filter_map(|(wire, picked)| match picked {
        Picked::Usual(channel) => Some(format!("{} is `{}`", wire.name(), channel.path)),
        _ => None,
    });
    let usual: Vec<String> = usual.collect();
    if usual.is_empty() {
        return Vec::new();
    }
    vec![format!("{}, by name", usual.join(", "))]
}

/// The kinds of recordings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Sr,
    Vcd,
    Csv,
    Raw { rate_hz: u64, unit: usize },
}

/// Opens a recording, several times if need be.
struct Reader<'a> {
    tape: Tape,
    disk: Option<Disk>,
    kind: Kind,
    asked: &'a Asked,
    doing: String,
}

/// What tells one kind from another.
const HEAD: usize = 4096;

/// What else bears the names that were asked for.
type Bits = (Vec<Channel>, Vec<Channel>);

impl Reader<'_> {
    fn new(input: Input, asked: &Asked, doing: String) -> Result<Reader<'_>, Error> {
        let (tape, disk) = input.open();
        // The first line that is more than nothing.
        let enough =
            |head: &[u8]| head.starts_with(sr::MAGIC) || head.trim_ascii_start().contains(&b'\n');
        let head = tape.head(HEAD, enough);
        let head = head.map_err(|error| Error::new(&doing, error, HINT))?;
        let kind = kind(&head, asked).map_err(|(said, hint)| Error::new(&doing, said, hint))?;
        Ok(Reader {
            tape,
            disk,
            kind,
            asked,
            doing,
        })
    }

    fn fresh(&self) -> Result<(Box<dyn Source>, Bits), Error> {
        let source = self.source();
        let mut source = source.map_err(|said| Error::new(&self.doing, said, HINT))?;
        let mut named =
            |name: &Option<String>| name.as_ref().map_or(Vec::new(), |name| source.named(name));
        let bits = (named(&self.asked.ma), named(&self.asked.slo));
        Ok((source, bits))
    }

    fn source(&self) -> Result<Box<dyn Source>, String> {
        if !self.tape.rewind() {
            return Err(
                "its header is so long that only names are looked at: say ma= and slo=".to_owned(),
            );
        }
        let rate_hz = self.asked.rate.map(|rate| u64::from(rate.0));
        let input = self.tape.clone();
        Ok(match (self.kind, &self.disk) {
            (Kind::Sr, Some(disk)) => Box::new(Sr::open(disk.clone(), rate_hz)?),
            (Kind::Sr, None) => Box::new(Sr::stream(input, rate_hz)?),
            (Kind::Vcd, _) => Box::new(Vcd::open(input)?),
            (Kind::Csv, _) => Box::new(Csv::open(input, rate_hz)?),
            (Kind::Raw { rate_hz, unit }, _) => Box::new(Raw::open(input, rate_hz, unit)),
        })
    }

    fn by_behaviour(&self, ma: &Picked, slo: &Picked) -> Result<(Channel, Channel, String), Error> {
        const SAY: &str = "say which: file:PATH,ma=NAME,slo=NAME";
        let kept = self.tape.keep();
        kept.map_err(|error| Error::new(&self.doing, error, HINT))?;
        let fresh = || Ok(self.fresh()?.0);
        let timeout_ns = self.asked.timeout_max_ns;
        let mut pairs = behaviour::find(candidates(ma), candidates(slo), timeout_ns, fresh)?;
        if pairs.len() > 1 {
            let both = |(ma, slo): &behaviour::Pair| format!("{} and {}", ma.path, slo.path);
            let all: Vec<String> = pairs.iter().map(both).collect();
            let said = format!("several pairs behave like MA and SLO: {}", all.join(", "));
            return Err(Error::new(&self.doing, said, SAY));
        }
        let Some((ma, slo)) = pairs.pop() else {
            return Err(self.nothing_found(ma, slo));
        };
        let note = format!("MA is `{}`, SLO is `{}`, by behaviour", ma.path, slo.path);
        Ok((ma, slo, note))
    }

    fn nothing_found(&self, ma: &Picked, slo: &Picked) -> Error {
        let open: Vec<&[Channel]> = [ma, slo]
            .into_iter()
            .filter_map(|picked| match picked {
                Picked::Open(channels) => Some(channels.as_slice()),
                _ => None,
            })
            .collect();
        let (what, say) = match (ma, slo) {
            (Picked::Open(_), Picked::Open(_)) => (
                "no two signals look or behave like MA and SLO".to_owned(),
                "say which: file:PATH,ma=NAME,slo=NAME".to_owned(),
            ),
            (Picked::Open(_), _) => unlike(&MA),
            _ => unlike(&SLO),
        };
        let names = list(open.first().copied().unwrap_or_default());
        let said = format!("{what}; one-bit signals are: {names}");
        Error::new(&self.doing, said, say)
    }
}

fn unlike(wire: &names::Wire) -> (String, String) {
    let what = format!("no signal looks or behaves like {}", wire.name());
    (what, wire.say())
}

/// Those that could be it.
fn candidates(picked: &Picked) -> &[Channel] {
    match picked {
        Picked::Sure(channel) | Picked::Usual(channel) => std::slice::from_ref(channel),
        Picked::Open(channels) => channels,
    }
}

/// What is wrong, and what to try.
type Misfit = (String, &'static str);

/// What these first bytes begin.
fn kind(head: &[u8], asked: &Asked) -> Result<Kind, Misfit> {
    let session = head.starts_with(sr::MAGIC);
    let text = vcd::looks_like(head) || csv::looks_like(head);
    if asked.unit.is_some() && (session || text && asked.rate.is_none()) {
        let is = match session {
            true => "a session of sigrok (.sr)",
            false if vcd::looks_like(head) => "a VCD",
            false => "CSV",
        };
        let said = format!("it is {is}, which says itself where its channels stand");
        return Err((said, "leave unit= out: it is for samples alone"));
    }
    // Samples that happen to be printable go on without an end of line.
    let samples = asked.rate.is_some() && text && head.len() == HEAD && !head.contains(&b'\n');
    if asked.unit.is_some() || samples {
        return raw(asked);
    }
    if session {
        return Ok(Kind::Sr);
    }
    if vcd::looks_like(head) {
        return match asked.rate {
            Some(_) => Err((
                "it is a VCD, which has times of its own".to_owned(),
                "leave rate= out",
            )),
            None => Ok(Kind::Vcd),
        };
    }
    if csv::looks_like(head) {
        return Ok(Kind::Csv);
    }
    if head.is_empty() {
        return Err(("it is empty".to_owned(), HINT));
    }
    if asked.rate.is_some() {
        return raw(asked);
    }
    let said = format!(
        "it is no recording of a kind that biss knows: it begins with {}",
        beginning(head)
    );
    Err((said, HINT))
}

fn raw(asked: &Asked) -> Result<Kind, Misfit> {
    let Some(rate) = asked.rate else {
        let said = "unit= is for samples alone, which need rate= too".to_owned();
        return Err((said, HINT));
    };
    let number = |name: &Option<String>| name.as_ref().and_then(|name| name.parse::<usize>().ok());
    let highest = number(&asked.ma).max(number(&asked.slo)).unwrap_or(0);
    let unit = asked.unit.map_or(highest / 8 + 1, usize::from);
    if highest >= 64 {
        let said = format!("there is no channel {highest}: samples have up to 64");
        return Err((said, HINT));
    }
    Ok(Kind::Raw {
        rate_hz: rate.0.into(),
        unit,
    })
}

/// The first bytes as text, or as numbers.
fn beginning(head: &[u8]) -> String {
    let few = &head[..head.len().min(16)];
    if few.iter().all(|b| b.is_ascii_graphic() || *b == b' ') {
        return format!("`{}`", few.escape_ascii());
    }
    let bytes: Vec<String> = few.iter().map(|b| format!("{b:02x}")).collect();
    bytes.join(" ")
}

impl Recording {
    fn next_trace(&mut self, trace: &mut Trace) -> bool {
        loop {
            if self.slicer.take(trace) {
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
            self.source.finish(&mut self.slicer);
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

impl Recording {
    /// The next one, whether it was looked at before or not.
    fn turn(&mut self, trace: &mut Trace) -> bool {
        let there = match self.ahead.pop_front() {
            Some(next) => {
                // Somebody may have asked for waveforms meanwhile.
                let wave = trace.wave.take().filter(|_| next.wave.is_none());
                *trace = next;
                trace.wave = trace.wave.take().or(wave);
                true
            }
            None => self.next_trace(trace),
        };
        if there {
            self.now_ns = trace.t_ns;
            self.clocks.note(trace);
        }
        there
    }
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
            if !self.turn(trace) {
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

    fn ahead(&mut self, index: usize, trace: &mut Trace) -> bool {
        while self.ahead.len() <= index {
            let mut next = Trace::default();
            if self.slicer.keeps_waveform() {
                next.wave = Some(Box::default());
            }
            if !self.next_trace(&mut next) {
                return false;
            }
            self.ahead.push_back(next);
        }
        trace.clone_from(&self.ahead[index]);
        true
    }

    fn waveform(&mut self, wave: &mut Waveform) -> Result<(), Error> {
        self.slicer.keep_waveform();
        if !self.ahead.is_empty() {
            // What there is belongs to those cycles.
            return Ok(());
        }
        self.slicer.rest(wave);
        if self.ended {
            self.now_ns = self.source.now_ns();
        }
        Ok(())
    }

    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    fn advice(&self, any_good: bool) -> Option<String> {
        let (changes, timeout_ns) = (self.slicer.first(), self.slicer.timeout_ns());
        advice::advice(&self.clocks, changes, timeout_ns, self.rated, !any_good)
    }
}
