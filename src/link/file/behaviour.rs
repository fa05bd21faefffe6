//! Which channels are MA and SLO, by what they do.
//!
//! MA rests high and comes in bursts. SLO is high while MA rests, falls with the second rising edge and the line delay, has
//! a start bit, changes only as long behind a rising edge as that, once a clock at most, and is high again at the end. What
//! is cut says nothing, nor does a cycle that nobody answers.

use super::source::{Channel, Source};
use crate::slice::Slicer;
use crate::trace::Trace;
use crate::waveform::Change;

/// Two channels that behave like MA and SLO.
pub(super) type Pair = (Channel, Channel);

/// More than anybody would look at one by one.
const MOST_CHANNELS: usize = 64;
/// So many blocks of samples are looked at, 32 MiB.
const MOST_READS: usize = 256;
/// So many good cycles are enough.
const ENOUGH: u32 = 64;
/// Most changes between the ends of two cycles, or before MA rests. Above that it is noise, or MA never rests.
const MOST_CHANGES: usize = 1 << 16;
/// LAT, Ack, start, CDS, one bit of data, stop.
const LEAST_CLOCKS: usize = 6;

/// All pairs that fit about as well as the best, of those that could be MA and those that could be SLO. `fresh` opens the recording anew.
///
/// # Errors
/// When it cannot be opened anew.
pub(super) fn find<E>(
    ma: &[Channel],
    slo: &[Channel],
    timeout_ns: u64,
    mut fresh: impl FnMut() -> Result<Box<dyn Source>, E>,
) -> Result<Vec<Pair>, E> {
    let (ma, slo) = (once(ma), once(slo));
    let mut pairs = Vec::new();
    if ma.len().max(slo.len()) > MOST_CHANNELS {
        return Ok(Vec::new());
    }
    for ma in ma {
        let mut source = fresh()?;
        source.select(ma.id, ma.id);
        if !comes_in_bursts(&mut *source, timeout_ns) {
            continue;
        }
        for slo in slo.iter().filter(|slo| slo.id != ma.id) {
            let mut source = fresh()?;
            source.select(ma.id, slo.id);
            let score = judge(&mut *source, timeout_ns);
            if score.fits() {
                pairs.push((score.good, (ma.clone(), slo.clone())));
            }
        }
    }
    // Chance lets one cycle or two look like a frame.
    let best = pairs.iter().map(|(good, _)| *good).max();
    pairs.retain(|(good, _)| best.is_some_and(|best| 4 * good >= best));
    Ok(pairs.into_iter().map(|(_, pair)| pair).collect())
}

/// Whether the two that are selected do.
pub(super) fn behaves(source: &mut dyn Source, timeout_ns: u64) -> bool {
    judge(source, timeout_ns).fits()
}

/// Each signal once, whatever it is called.
fn once(channels: &[Channel]) -> Vec<Channel> {
    let mut all: Vec<Channel> = Vec::new();
    for channel in channels {
        if all.iter().all(|other| other.id != channel.id) {
            all.push(channel.clone());
        }
    }
    all
}

#[derive(Debug, Default)]
struct Score {
    good: u32,
    bad: u32,
    /// MA was seen to rest high.
    rested: bool,
}

impl Score {
    fn fits(&self) -> bool {
        self.good > 0 && self.rested && 4 * self.bad <= self.good
    }

    fn is_decided(&self) -> bool {
        self.good >= ENOUGH || self.bad > self.good + 8
    }
}

/// For cycles with all that came between them.
fn slicer(timeout_ns: u64) -> (Slicer, Trace) {
    let mut slicer = Slicer::new(timeout_ns);
    slicer.keep_waveform();
    let trace = Trace {
        wave: Some(Box::default()),
        ..Trace::default()
    };
    (slicer, trace)
}

/// Whether this could be MA: a rest, high, and clocks after it that are shorter.
fn comes_in_bursts(source: &mut dyn Source, timeout_ns: u64) -> bool {
    let (mut slicer, mut trace) = slicer(timeout_ns);
    let mut recent: Vec<Change> = Vec::new();
    let mut seen = 0;
    for _ in 0..MOST_READS {
        let more = source.read(&mut slicer) == Ok(true);
        if !more {
            source.finish(&mut slicer);
        }
        // Without SLO nobody knows where a cycle ends: it does here.
        slicer.gap(source.now_ns());
        while slicer.take(&mut trace) {
            let wave = trace.wave.as_ref();
            let changes = wave.map_or(&[][..], |wave| &wave.changes);
            // A rest lies between two of them.
            recent.extend_from_slice(changes);
            seen += changes.len();
            if has_burst(&recent) {
                return true;
            }
            recent.drain(..recent.len().saturating_sub(4 * LEAST_CLOCKS));
        }
        if !more || seen > MOST_CHANGES {
            break;
        }
    }
    false
}

fn has_burst(changes: &[Change]) -> bool {
    let edges = changes.windows(2).filter(|pair| pair[0].ma != pair[1].ma);
    let edges: Vec<u64> = edges.map(|pair| pair[1].t_ns).collect();
    // Two edges a clock, from one that ends a rest on.
    let Some(first) = changes.first() else {
        return false;
    };
    let falls = (0..edges.len()).filter(|at| (at % 2 == 0) == first.ma);
    falls.into_iter().any(|fall| {
        let before = if fall == 0 {
            first.t_ns
        } else {
            edges[fall - 1]
        };
        let rest_ns = edges[fall] - before;
        let clocks = edges.get(fall..fall + 2 * LEAST_CLOCKS);
        clocks.is_some_and(|edges| {
            let periods = edges.windows(3).map(|three| three[2] - three[0]);
            // The first clock may be stretched. The others are of one clock, and noise is not.
            let shortest = periods.clone().skip(3).min().unwrap_or(0);
            let longest = periods.clone().skip(3).max().unwrap_or(0);
            longest <= 2 * shortest && periods.max().is_some_and(|longest| 2 * longest <= rest_ns)
        })
    })
}

fn judge(source: &mut dyn Source, timeout_ns: u64) -> Score {
    let (mut slicer, mut trace) = slicer(timeout_ns);
    let mut score = Score::default();
    let mut cycle = Cycle::default();
    for _ in 0..MOST_READS {
        let more = source.read(&mut slicer) == Ok(true);
        if !more {
            source.finish(&mut slicer);
            slicer.finish(source.now_ns());
        }
        while slicer.take(&mut trace) {
            cycle.take(&trace);
            match is_answered(&trace, &cycle) {
                Some(true) => {
                    score.good += 1;
                    score.rested |= cycle.has_rested(&trace);
                }
                Some(false) => score.bad += 1,
                None => {}
            }
        }
        if slicer.backlog() > MOST_CHANGES {
            return Score::default();
        }
        if !more || score.is_decided() {
            break;
        }
    }
    score
}

/// Edges of one cycle.
#[derive(Debug, Default)]
struct Cycle {
    /// Both wires before it, and since when MA has been as it was.
    last: Option<Change>,
    moved_ns: u64,
    /// How long MA had been high when it fell.
    rest_ns: u64,
    rises: Vec<u64>,
    /// Changes of SLO since MA fell.
    slo: Vec<(u64, Option<bool>)>,
    /// SLO fell before that.
    strayed: bool,
}

impl Cycle {
    fn take(&mut self, trace: &Trace) {
        self.rises.clear();
        self.slo.clear();
        (self.strayed, self.rest_ns) = (false, 0);
        let changes = trace.wave.as_ref().map_or(&[][..], |wave| &wave.changes);
        for change in changes {
            let Some(last) = self.last.replace(*change) else {
                self.moved_ns = change.t_ns;
                continue;
            };
            if change.ma != last.ma {
                if change.t_ns == trace.t_ns && last.ma {
                    self.rest_ns = change.t_ns - self.moved_ns;
                }
                if change.ma && change.t_ns > trace.t_ns {
                    self.rises.push(change.t_ns);
                }
                self.moved_ns = change.t_ns;
            }
            if change.slo != last.slo {
                if change.t_ns >= trace.t_ns {
                    self.slo.push((change.t_ns, change.slo));
                } else {
                    self.strayed |= change.slo == Some(false);
                }
            }
        }
    }

    fn has_rested(&self, trace: &Trace) -> bool {
        let period_ns = trace.ma_period_ns.map_or(u64::MAX, u64::from);
        self.rest_ns / 2 >= period_ns
    }
}

/// Whether SLO answers MA; `None` is that this cycle does not tell.
fn is_answered(trace: &Trace, cycle: &Cycle) -> Option<bool> {
    let silent = cycle.slo.is_empty() && trace.idle == Some(true) && !cycle.strayed;
    let unknown = cycle.slo.iter().any(|(_, level)| level.is_none());
    if trace.cut.is_some() || silent || unknown {
        return None;
    }
    let good =
        trace.idle == Some(true) && !cycle.strayed && is_frame(trace) && is_in_step(trace, cycle);
    // Where an unconfirmed one begins is not certain.
    (good || !trace.unconfirmed).then_some(good)
}

/// `1 0…0 1`, and something behind it.
fn is_frame(trace: &Trace) -> bool {
    let bits = &trace.bits;
    let begins = bits.get(0) == Some(true) && bits.get(1) == Some(false);
    let start = bits.find(1, true);
    begins && start.is_some_and(|start| start + LEAST_CLOCKS - 3 <= bits.len())
}

/// Whether SLO changes with the clock and at no other time.
fn is_in_step(trace: &Trace, cycle: &Cycle) -> bool {
    let (Some(period_ns), Some(second)) = (trace.ma_period_ns, cycle.rises.get(1)) else {
        return false;
    };
    let period_ns = u64::from(period_ns);
    // Stamps are late by a sample each, and channels may be apart by one.
    let sample_ns = period_ns / 8 + 1;
    let Some(((ack_ns, Some(false)), rest)) = cycle.slo.split_first() else {
        return false;
    };
    if ack_ns + sample_ns < *second {
        return false;
    }
    let delay_ns = ack_ns.saturating_sub(*second);
    let Some(((_, Some(true)), bits)) = rest.split_last() else {
        return false;
    };
    // The last one is the end of the timeout, which may come at any time.
    let mut rises = cycle.rises.iter().skip(2).peekable();
    bits.iter().all(|(t_ns, _)| {
        let tolerance_ns = period_ns / 4 + 1;
        while rises
            .next_if(|rise| **rise + delay_ns + tolerance_ns < *t_ns)
            .is_some()
        {}
        let near = rises.next_if(|rise| **rise + delay_ns <= *t_ns + tolerance_ns);
        near.is_some()
    })
}
