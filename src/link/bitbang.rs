//! One clocked cycle over three primitives: set MA, read SL, wait. Shared by every link that moves MA itself.
//!
//! On a bus the master may drive the SLI of the slave farthest away as well, by MO ([`Pins::mo`]). There it plays a slave
//! without data, which the others take for the first of them (BiSS C protocol description D2, p. 10-12):
//!
//! ```text
//! edge          1     2     3     4     5        n
//!       _____    __    __    __    __    __        __________________________
//! MA         |__|  |__|  |__|  |__|  |__|  |.. |__|
//!       _______________       _____                               ___________
//! MO                   |_____|     |__________ .. _______________|
//!        idle           Ack   Start CDS 0, stop      timeout      ready
//! ```
//!
//! A slave reads its SLI with the falling MA edge, so MO moves right after the rising one. It rests high, and is high
//! again [`TIMEOUT_MIN_NS`] after the last MA edge: a slave is ready when its own timeout has passed and its SLI is 1, so
//! one with a longer timeout waits for that, one with a shorter for MO. In INIT MO stays high.

use super::{Caps, Clock, Error, Known, Link, Phase};
use crate::limits::{REST_NS, TIMEOUT_MIN_NS};
use crate::trace::{Ask, Bits, Clocks, Level, MAX_CLOCKS, Trace, Until};
use crate::unit::Hertz;
use crate::waveform::{Log, Waveform};

/// MA and SL as single levels, and a clock.
pub trait Pins {
    /// Drives MA.
    ///
    /// # Errors
    /// When the line cannot be driven.
    fn ma(&mut self, high: bool) -> Result<(), Error>;
    /// Reads SL.
    ///
    /// # Errors
    /// When the line cannot be read.
    fn sl(&mut self) -> Result<bool, Error>;
    /// Whether there is an MO.
    fn has_mo(&self) -> bool {
        false
    }
    /// Drives MO, where there is one.
    ///
    /// # Errors
    /// When the line cannot be driven.
    fn mo(&mut self, _high: bool) -> Result<(), Error> {
        Ok(())
    }
    /// Time on the link's clock.
    fn now_ns(&self) -> u64;
    /// Waits until then; returns at once when late.
    fn until(&mut self, ns: u64);
    /// How long one call of [`Pins::ma`] and of [`Pins::sl`] take.
    fn cost_ns(&self) -> (u64, u64);
    /// The shortest time there is: MA levels last whole ones.
    fn grain_ns(&self) -> u64 {
        1
    }
    /// What the user should know about how these pins run.
    fn note(&self) -> Option<String> {
        None
    }
    /// Time passes only by these calls.
    fn virtual_time(&self) -> bool {
        false
    }
    /// The changes of SLO, each when it came, for pins that see all of them: they keep them from the first call on, and
    /// whoever has used them takes them away.
    fn slo_changes(&mut self) -> Option<&mut Vec<(u64, bool)>> {
        None
    }
}

/// A link that moves MA edge by edge.
#[derive(Debug)]
pub struct Bang<P> {
    pins: P,
    period_ns: u64,
    measured_ns: Option<u64>,
    phase: Phase,
    /// How long setting MA takes. The pins' own figure is of calls that change nothing, until frames have been run.
    set_ns: u64,
    /// The user has not asked for a clock.
    usual_clock: bool,
    /// The rising edges of the frame that were sampled.
    times: Vec<Sampled>,
    scratch: Vec<u64>,
    ma_high: bool,
    /// The pin is low where MA is high.
    upside_down: bool,
    last_edge_ns: u64,
    mo_high: bool,
    /// The last frame ended with its stop bit seen as 0, so SL = 1 means ready. Else SL = 1 may be a data bit
    /// of a frame that was cut (D2, p. 7; Renishaw, p. 2).
    stop_seen: bool,
    /// Both wires, where somebody wants them.
    log: Option<Box<Log>>,
}

/// 250 kHz: the slowest clock that every slave must take (D2 Table 10).
const USUAL_PERIOD_NS: u64 = 4_000;

/// An adaptive slave's timeout is 1.5 periods less a call, a period can last a call more than was meant: below four
/// calls a period nothing could be proven. A fifth gives room.
fn usual_period_ns(set_ns: u64) -> u64 {
    USUAL_PERIOD_NS.max(5 * set_ns)
}

/// A period of whole ticks, at least one for each level, and never a faster clock than was meant.
fn whole(period_ns: u64, pins: &impl Pins) -> u64 {
    let grain_ns = pins.grain_ns();
    period_ns.div_ceil(grain_ns).max(2) * grain_ns
}

impl<P: Pins> Bang<P> {
    /// Takes over pins whose MA has just been driven high, and whose MO is.
    pub fn new(pins: P) -> Bang<P> {
        let (set_ns, _) = pins.cost_ns();
        let period_ns = whole(usual_period_ns(set_ns), &pins);
        let last_edge_ns = pins.now_ns();
        Bang {
            pins,
            period_ns,
            measured_ns: None,
            set_ns,
            usual_clock: true,
            phase: Phase::Whole,
            times: Vec::with_capacity(MAX_CLOCKS),
            scratch: Vec::with_capacity(MAX_CLOCKS),
            ma_high: true,
            upside_down: false,
            last_edge_ns,
            mo_high: true,
            stop_seen: false,
            log: None,
        }
    }

    /// The pins, to change what they stand for.
    pub fn pins_mut(&mut self) -> &mut P {
        &mut self.pins
    }

    /// Two sets and a read a clock. MO has to move in the first half of a high level (D2 Table 10).
    fn least_period_ns(&self) -> u64 {
        let (_, read_ns) = self.pins.cost_ns();
        match self.pins.has_mo() {
            true => self.set_ns * 4,
            false => 0,
        }
        .max(2 * self.set_ns + read_ns)
    }

    /// Drives MA; the times before and after the call enclose the edge.
    fn edge(&mut self, high: bool) -> Result<Edge, Error> {
        let before = self.pins.now_ns();
        self.pins.ma(high != self.upside_down)?;
        self.ma_high = high;
        let after = self.pins.now_ns();
        self.last_edge_ns = after;
        let edge = Edge { before, after };
        if let Some(log) = &mut self.log {
            log.ma(edge.noted(self.set_ns), high);
        }
        Ok(edge)
    }

    /// Reads SL, and notes what it is.
    fn look(&mut self) -> Result<bool, Error> {
        let level = self.pins.sl()?;
        if self.log.is_some() {
            self.note_level(level);
        }
        Ok(level)
    }

    /// MO after rising edge `edge`, as a slave without data shows it.
    fn mo_follows(&mut self, edge: u16) -> Result<(), Error> {
        let high = match edge {
            2 | 4 => false,
            3 => true,
            _ => return Ok(()),
        };
        self.mo_high = high;
        self.pins.mo(high)
    }

    /// The slave that MO plays times out.
    fn mo_rests(&mut self) -> Result<(), Error> {
        if self.mo_high {
            return Ok(());
        }
        self.pins.until(self.last_edge_ns + TIMEOUT_MIN_NS);
        self.mo_high = true;
        self.pins.mo(true)
    }

    /// Waits for SL = 1. False when it stays 0.
    fn ready(&mut self, ready_ns: u32, trace: &mut Trace) -> Result<bool, Error> {
        let limit = self.last_edge_ns + u64::from(ready_ns);
        if !self.stop_seen {
            self.pins.until(limit);
        }
        let level = loop {
            let late = self.pins.now_ns() >= limit;
            let level = self.look()?;
            if level || late {
                break level;
            }
            self.pins.until(self.pins.now_ns() + POLL_NS);
        };
        trace.idle = Some(level);
        trace.waited_ns = Some(self.pins.now_ns() - self.last_edge_ns);
        Ok(level)
    }

    fn cycle(&mut self, ask: &Ask, trace: &mut Trace) -> Result<(), Error> {
        trace.reset();
        if trace.wave.is_some() {
            self.keep_log()?;
        }
        let result = self.run(ask, trace);
        if let Some(log) = &mut self.log {
            pour(log, &mut self.pins, trace.wave.as_deref_mut());
        }
        result
    }

    fn run(&mut self, ask: &Ask, trace: &mut Trace) -> Result<(), Error> {
        let clocks = &ask.clocks;
        if !self.ma_high {
            self.edge(true)?;
        }
        self.pins
            .until(ask.at_ns.max(self.last_edge_ns + self.period_ns));
        trace.t_ns = self.pins.now_ns();
        trace.ma_period_ns = u32::try_from(self.period_ns).ok();
        if let Some(ready_ns) = clocks.ready_ns {
            if !self.ready(ready_ns, trace)? {
                return Ok(());
            }
        }
        let search = self.clock_out(clocks, trace)?;
        self.control(clocks, &search, trace)
    }

    /// All edges of the frame, and the levels between them.
    fn clock_out(&mut self, clocks: &Clocks, trace: &mut Trace) -> Result<Search, Error> {
        // Levels 0, 2, 4 … are low, the others high; together they make the period exactly.
        let grain_ns = self.pins.grain_ns();
        let low = self.period_ns / 2 / grain_ns * grain_ns;
        let high = self.period_ns - low;
        let stretched = u64::from(clocks.stretch_ns) / 3;
        let length = |index: u32| {
            let usual = if index % 2 == 0 { low } else { high };
            if index < 3 {
                usual.max(stretched)
            } else {
                usual
            }
        };
        let in_high = self.phase <= Phase::Half;
        // INIT does not look for SL, and is no frame.
        let with_mo = self.pins.has_mo() && clocks.ready_ns.is_some();
        let mut search = Search::new(clocks.until);
        let first_fall = self.edge(false)?;
        trace.t_ns = first_fall.before;
        let (mut fall, mut rise) = (first_fall, None::<Edge>);
        let mut due = first_fall.before;
        let mut edge = 0u16;
        self.times.clear();
        loop {
            due = self.after(due, fall, length(2 * u32::from(edge)));
            if let (Some(rise), false) = (rise, in_high) {
                self.bit(edge, rise, due, &mut search, trace)?;
            }
            self.pins.until(due);
            let now = self.edge(true)?;
            edge += 1;
            if with_mo {
                self.mo_follows(edge)?;
            }
            trace.level(now.after - fall.before, edge);
            if let Some(rise) = rise {
                trace.level(now.after - rise.before, edge);
            }
            if edge == 2 {
                trace.reference_ns =
                    u32::try_from(now.before.saturating_sub(first_fall.after)).ok();
            }
            rise = Some(now);
            if edge >= search.end() {
                self.last_bit(clocks, edge, now, &mut search, trace)?;
                self.judge_times(&search, trace);
                return Ok(search);
            }
            due = self.after(due, now, length(2 * u32::from(edge) - 1));
            if in_high {
                self.bit(edge, now, due, &mut search, trace)?;
            }
            self.pins.until(due);
            fall = self.edge(false)?;
            trace.level(fall.after - now.before, edge);
        }
    }

    /// When the next edge is due: a level after the last one was, and never so soon that a call that took too long
    /// would take the level's length, in which SL has to arrive, away.
    fn after(&self, due: u64, edge: Edge, length: u64) -> u64 {
        (due + length).max(edge.after.saturating_sub(self.set_ns) + length)
    }

    /// Reads what rising edge number `edge` has set, not before the phase's place in the bit, in time for the MA edge
    /// that is due next.
    fn bit(
        &mut self,
        edge: u16,
        rise: Edge,
        due: u64,
        search: &mut Search,
        trace: &mut Trace,
    ) -> Result<(), Error> {
        // SL cannot change at LAT, so there is nothing to read yet.
        let level = if edge == 1 {
            trace.idle.unwrap_or(true)
        } else {
            self.sample(rise, Some(due))?
        };
        trace.bits.push(level);
        search.see(edge, level);
        Ok(())
    }

    fn sample(&mut self, rise: Edge, due: Option<u64>) -> Result<bool, Error> {
        let (_, read_ns) = self.pins.cost_ns();
        let into_bit = self.period_ns * self.phase as u64 / 4;
        let place = rise.after.saturating_sub(self.set_ns) + into_bit;
        let with_edge = matches!(self.phase, Phase::Half | Phase::Whole);
        let at = due.filter(|_| with_edge).unwrap_or(place);
        let from = at.saturating_sub(read_ns);
        self.pins.until(from);
        let level = self.pins.sl();
        self.times.push(Sampled {
            edge: rise,
            from: from.max(rise.after),
            read: self.pins.now_ns(),
        });
        level
    }

    /// What the times of the edges and samples say about the frame: its period, as far as pauses leave one, and the
    /// latest sample.
    fn judge_times(&mut self, search: &Search, trace: &mut Trace) {
        let rises = self
            .times
            .windows(2)
            .map(|pair| pair[1].edge.before - pair[0].edge.before);
        let period = median(&mut self.scratch, rises);
        self.measured_ns = period.or(self.measured_ns);
        // A frame that was slow throughout must not widen its own limits.
        trace.ma_period_ns = period
            .unwrap_or(self.period_ns)
            .min(self.period_ns)
            .try_into()
            .ok();
        trace.late = self.latest(search);
        if let Some(wave) = &mut trace.wave {
            self.note_bits(search, &trace.bits, wave);
        }
    }

    /// How much later than usual in this frame the latest sample came after the edge that had set its bit, which is as
    /// many edges back as the line delay has whole clocks. With less than a clock, nothing newer can have arrived.
    fn latest(&mut self, search: &Search) -> Option<Level> {
        let delay_clk = usize::from(search.ack?.checked_sub(2).filter(|clocks| *clocks > 0)?);
        let times = &self.times;
        let sampled_after = || {
            let late = times.iter().skip(delay_clk);
            late.zip(times)
                .map(|(sampled, sent)| sampled.read - sent.edge.before)
        };
        let usual = median(&mut self.scratch, sampled_after())?;
        let (index, latest) = sampled_after().enumerate().max_by_key(|(_, ns)| *ns)?;
        let ns = u32::try_from(latest - usual).unwrap_or(u32::MAX);
        // The first sample is that of edge 2.
        Some(Level {
            ns,
            edge: (index + delay_clk + 2) as u16,
        })
    }

    /// Begins to note both wires, as they are.
    #[cold]
    fn keep_log(&mut self) -> Result<(), Error> {
        if self.log.is_none() {
            self.pins.slo_changes();
            let slo = self.pins.sl()?;
            let now_ns = self.pins.now_ns();
            self.log = Some(Box::new(Log::new(now_ns, self.ma_high, Some(slo))));
        }
        Ok(())
    }

    #[cold]
    fn note_level(&mut self, level: bool) {
        if self.pins.slo_changes().is_some() {
            // They say it better.
            return;
        }
        let now_ns = self.pins.now_ns();
        if let Some(log) = self.log.as_mut().filter(|log| log.slo_now() != Some(level)) {
            log.slo(now_ns, Some(level));
        }
    }

    /// Notes the bits of a cycle with the edges that set them, as many back as the line delay has clocks: a line delays all
    /// bits alike, and it does so while MA pauses.
    #[cold]
    fn note_bits(&mut self, search: &Search, bits: &Bits, wave: &mut Waveform) {
        let (_, read_ns) = self.pins.cost_ns();
        // SL cannot change at LAT, and was not sampled before edge 2.
        let second = self.times.first();
        wave.samples_ns
            .extend(second.map(|second| second.edge.noted(self.set_ns)));
        let samples = self.times.iter().map(|sampled| sampled.read - read_ns / 2);
        wave.samples_ns.extend(samples);
        if self.pins.slo_changes().is_some() {
            return;
        }
        let (Some(log), Some(first)) = (&mut self.log, bits.get(1)) else {
            return;
        };
        let back = usize::from(search.ack.map_or(0, |ack| ack - 2));
        let rise = |index: usize| self.times[index].edge.noted(self.set_ns);
        let period = self.measured_ns.unwrap_or(self.period_ns);
        let into_bit = period * self.phase.min(Phase::Half) as u64 / 8;
        if back > 0 && log.slo_now() != Some(first) {
            log.slo(rise(0) + into_bit, Some(first));
        }
        let before = log.slo_now();
        let levels = || std::iter::once(before).chain(bits.iter().skip(1).map(Some));
        let changes = || {
            let pairs = levels().zip(bits.iter().skip(1)).enumerate().skip(back);
            pairs.filter(|(_, (old, new))| *old != Some(*new))
        };
        // When a level was seen first, and the one before it last, bound the delay from both sides.
        let (mut least, mut most) = (1, u64::MAX);
        for (index, _) in changes() {
            let Edge { before, after } = self.times[index - back].edge;
            most = most.min(self.times[index].read.saturating_sub(before));
            let old = index.checked_sub(1).map_or(0, |old| self.times[old].from);
            least = least.max((old + 1).saturating_sub(after));
        }
        let delay = (back as u64 * period + into_bit).max(least).min(most);
        for (index, (_, new)) in changes() {
            // Where no delay explains all samples, nobody knows what was on the line after Ack.
            let level = Some(new).filter(|_| least <= most || index == back);
            let t_ns = rise(index - back) + delay;
            log.slo(t_ns.min(self.times[index].read), level);
        }
    }

    /// The last bit has no edge after it. CDM = 1 takes MA low half a period after its edge.
    fn last_bit(
        &mut self,
        clocks: &Clocks,
        edge: u16,
        rise: Edge,
        search: &mut Search,
        trace: &mut Trace,
    ) -> Result<(), Error> {
        let cdm = clocks.cdm[usize::from(search.cds)];
        let half = rise.before + self.period_ns / 2;
        if cdm && self.phase > Phase::Half {
            self.pins.until(half);
            self.edge(false)?;
        }
        let level = self.sample(rise, None)?;
        // The level lasts until it was read: a slave that timed out before has let SL go.
        trace.level(self.pins.now_ns() - rise.before, edge);
        trace.bits.push(level);
        search.see(edge, level);
        trace.cdm = Some(cdm);
        if cdm && self.ma_high {
            self.pins.until(half);
            // A slave that timed out before has taken CDM = 0, and this edge for the first one of a frame.
            let fall = self.edge(false)?;
            trace.level(fall.after - rise.before, edge);
        }
        Ok(())
    }

    /// Holds CDM = 1 until SL = 1, then releases MA. CDM = 0 leaves MA where it is.
    fn control(
        &mut self,
        clocks: &Clocks,
        search: &Search,
        trace: &mut Trace,
    ) -> Result<(), Error> {
        // Of a frame that is left early nothing is under way any more if the line delays by less than a clock.
        let last = trace.bits.get(trace.bits.len().wrapping_sub(1));
        let arrived = !clocks.partial || search.ack == Some(2);
        self.stop_seen = search.complete && last == Some(false) && arrived;
        self.mo_rests()?;
        if trace.cdm != Some(true) {
            return Ok(());
        }
        let since = self.last_edge_ns;
        let mut ready = false;
        while self.pins.now_ns() < since + u64::from(clocks.hold_ns) {
            self.pins.until(self.pins.now_ns() + POLL_NS);
            if self.stop_seen && self.look()? {
                trace.ready_ns = u32::try_from(self.pins.now_ns() - since).ok();
                ready = true;
                break;
            }
        }
        // The longest timeout and line delay have passed: SL = 1 is no data bit any more.
        self.stop_seen = ready || self.look()?;
        self.edge(true).map(drop)
    }
}

/// Hands over what was noted, if somebody wants it.
#[cold]
fn pour(log: &mut Log, pins: &mut impl Pins, wave: Option<&mut Waveform>) {
    if let Some(changes) = pins.slo_changes() {
        for (t_ns, level) in changes.drain(..) {
            log.slo(t_ns, Some(level));
        }
    }
    match wave {
        Some(wave) => log.pour(wave),
        None => log.forget(),
    }
}

/// The middle one of some spans, which a few long ones do not change.
fn median(scratch: &mut Vec<u64>, spans: impl Iterator<Item = u64>) -> Option<u64> {
    scratch.clear();
    scratch.extend(spans);
    let middle = scratch.len() / 2;
    (!scratch.is_empty()).then(|| *scratch.select_nth_unstable(middle).1)
}

/// Between two looks at SL while nothing else happens.
const POLL_NS: u64 = 500;

/// A rising edge, and when the sample that belongs to it was taken.
#[derive(Clone, Copy, Debug)]
struct Sampled {
    edge: Edge,
    /// Not before.
    from: u64,
    read: u64,
}

/// The call that made an edge, from before to after.
#[derive(Clone, Copy, Debug)]
struct Edge {
    before: u64,
    after: u64,
}

impl Edge {
    /// In the middle of the call; at the end of one that took longer than they do, so that the level before it is as long as
    /// it can have been: a pause must not look shorter in a recording.
    fn noted(self, usual_ns: u64) -> u64 {
        self.after.saturating_sub(usual_ns / 2).max(self.before)
    }
}

/// Follows SL while clocking, to know when the frame is over.
struct Search {
    until: Until,
    ack: Option<u16>,
    start: Option<u16>,
    cds: bool,
    complete: bool,
}

impl Search {
    fn new(until: Until) -> Search {
        Search {
            until,
            ack: None,
            start: None,
            cds: false,
            complete: false,
        }
    }

    /// SL after rising edge `edge`.
    fn see(&mut self, edge: u16, level: bool) {
        match (self.ack, self.start) {
            (None, _) if edge > 1 && !level => self.ack = Some(edge),
            (Some(_), None) if level => self.start = Some(edge),
            (_, Some(start)) if edge == start + 1 => self.cds = level,
            _ => {}
        }
        self.complete = matches!((self.until, self.start), (Until::Frame { then, .. }, Some(start)) if edge == start + then);
    }

    /// The last rising edge, as far as it is known now.
    fn end(&self) -> u16 {
        match (self.until, self.ack, self.start) {
            (Until::Clocks(clocks), ..) => clocks,
            (Until::Frame { then, .. }, _, Some(start)) => start + then,
            (Until::Frame { start, .. }, Some(ack), None) => ack + start,
            (Until::Frame { ack, .. }, None, None) => 2 + ack,
        }
    }
}

impl<P: Pins> Link for Bang<P> {
    fn caps(&self) -> Caps {
        Caps {
            live: true,
            reacts: true,
            cdm: true,
            sees_idle: true,
            times_levels: true,
            phases: &[
                Phase::Whole,
                Phase::ThreeQuarters,
                Phase::Half,
                Phase::Quarter,
            ],
            virtual_time: self.pins.virtual_time(),
            burst: 1,
        }
    }

    fn now_ns(&self) -> u64 {
        self.pins.now_ns()
    }

    fn clock(&self) -> Clock {
        let hz = |period: u64| Hertz((1_000_000_000 / period.max(1)) as u32);
        match self.measured_ns {
            Some(period) => Clock {
                hz: hz(period),
                known: Known::Measured,
            },
            None => Clock {
                hz: hz(self.period_ns),
                known: Known::Asked,
            },
        }
    }

    fn set_clock(&mut self, hz: Hertz) -> Result<Clock, Error> {
        self.usual_clock = false;
        let period_ns = hz.period_ns().max(self.least_period_ns());
        self.period_ns = whole(period_ns, &self.pins);
        self.measured_ns = None;
        Ok(self.clock())
    }

    fn turn_ma(&mut self, upside_down: bool) -> Result<bool, Error> {
        self.upside_down = upside_down;
        self.edge(true)?;
        self.idle(REST_NS)?;
        Ok(true)
    }

    /// From the last frame: calls that move a line can take longer than those that were timed at the start, and then
    /// the clock is slower than was asked for.
    fn measure_clock(&mut self) -> Result<Clock, Error> {
        let calls = self
            .times
            .iter()
            .map(|sampled| sampled.edge.after - sampled.edge.before);
        if let Some(set_ns) = median(&mut self.scratch, calls) {
            self.set_ns = set_ns;
        }
        let period_ns = match self.usual_clock {
            true => usual_period_ns(self.set_ns),
            false => self.period_ns.max(self.least_period_ns()),
        };
        self.period_ns = whole(period_ns, &self.pins);
        Ok(self.clock())
    }

    fn set_phase(&mut self, phase: Phase) -> Result<(), Error> {
        self.phase = phase;
        Ok(())
    }

    fn notes(&self) -> Vec<String> {
        let phase = format!("SL is sampled {}", self.phase);
        let grain_ns = self.pins.grain_ns();
        let ticks = (grain_ns > 1).then(|| {
            let ticks = self.period_ns / grain_ns;
            format!("a tick is {grain_ns} ns, a clock {ticks} of them")
        });
        [self.pins.note(), ticks, Some(phase)]
            .into_iter()
            .flatten()
            .collect()
    }

    fn idle(&mut self, ns: u64) -> Result<Option<bool>, Error> {
        if !self.ma_high {
            self.edge(true)?;
        }
        // Asked for after a fault: then a stop bit may have been seen where there was none.
        self.stop_seen = false;
        self.pins.until(self.pins.now_ns() + ns);
        self.look().map(Some)
    }

    fn cycles(&mut self, asks: &[Ask], out: &mut [Trace]) -> Result<usize, Error> {
        for (ask, trace) in asks.iter().zip(out.iter_mut()) {
            self.cycle(ask, trace)?;
        }
        Ok(asks.len().min(out.len()))
    }

    fn waveform(&mut self, wave: &mut Waveform) -> Result<(), Error> {
        self.keep_log()?;
        if let Some(log) = &mut self.log {
            pour(log, &mut self.pins, Some(wave));
        }
        Ok(())
    }
}
