//! A waveform with its edges stamped becomes cycles: MA's own edges cut it, SL is sampled in mid-bit.
//!
//! A cycle ends where the slave says so, when SL returns to 1 while MA rests, or when MA has rested longer than
//! any timeout. A pause that is neither stays inside its cycle, where it is found as a stall.
//!
//! Time stamps from a sampled recording are late by up to a sample, q, each. In clocks, at eight samples a clock:
//!
//! | a bit is read at the Ack edge + n clocks + 1/2 | |
//! | --- | --- |
//! | to the nearest bit edge | 1/2 |
//! | bit edges against Ack, as far as D2 Table 10 lets them | -1/4 |
//! | stamps of the Ack and the bit edge, against each other | -q = -1/8 |
//! | stamps of rising edges 2 and n + 2, against each other | -q = -1/8 |
//! | left | 0 |
//!
//! Where the clock is constant a line through all rising edges stands for them, late by half a sample all of it, and the
//! last -1/8 is nearly gone. Where it is not quite, edges are taken halfway between their stamps and that line, else one by
//! one: a pause is never smoothed over.
//! The same sum parts a bit from SL = 1: after the last rising edge and the line delay a bit comes at most 1/4 + 2q = 1/2
//! later, SL = 1 of an adaptive slave at least 3/2 - 1/4 - 2q = 1 later. Without line delay the next
//! bit is no later than that, but with its own edge, or a sample before it where the analyser's channels are not quite in
//! step.

use crate::limits::{CLOCK_MIN_HZ, LINE_DELAY_MAX_NS, TIMEOUT_MIN_NS};
use crate::scan::Regular;
use crate::trace::{Cut, Level, MAX_CLOCKS, Trace};
use crate::waveform::{Change, Waveform};
use std::collections::VecDeque;

/// Cuts a waveform into traces. Feed it levels in order of time with [`Slicer::push`] and take the cycles from
/// [`Slicer::take`].
#[derive(Debug)]
pub struct Slicer {
    timeout_ns: u64,
    t_ns: u64,
    begun: bool,
    ma: bool,
    /// `None` where the recording shows neither 0 nor 1.
    slo: Option<bool>,
    state: State,
    cycle: Edges,
    /// SL rose as at the end of a cycle: it was that, unless MA rises with it.
    let_go: Option<u64>,
    done: VecDeque<Done>,
    /// So many at the end of `done` wait for the next ones to confirm them.
    held: usize,
    spare: Vec<Edges>,
    /// MA's last edge, or where it was first seen.
    moved_ns: u64,
    /// What the next falling edge begins.
    begin: Begin,
    /// MA's last rising edge that counted, and from there to the last rise of SL.
    risen_ns: u64,
    ready_ns: u64,
    /// SL's last change, or where it was first seen.
    slo_ns: u64,
    /// The first changes, for those who wonder what they are.
    first: Vec<Change>,
    /// Every change that belongs to no trace yet, where somebody wants them.
    log: Option<VecDeque<Change>>,
}

/// A finished cycle.
#[derive(Debug)]
enum Done {
    /// As it was pushed.
    Pushed(Edges),
    /// As it was read from samples.
    Read(Regular),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// MA rests. A rising edge here releases CDM = 1 and counts for nothing (D2, p. 15).
    Rest,
    /// A falling edge came.
    Armed,
    /// Rising edges count.
    Running,
}

/// What is known of the place where a cycle begins.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
enum Begin {
    /// Nothing: the recording begins inside it.
    #[default]
    Unknown,
    /// MA may have paused there: SL = 1 came later than the line delay, but that was measured on a piece.
    Likely,
    /// MA rested for longer than any timeout, or the line delay is known.
    Certain,
}

/// Rising edges at a constant clock: the line through all of them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Line {
    first_ns: f64,
    period_ns: f64,
    /// No two edges part by more than a sample of eight a clock: no pattern of longer and shorter clocks is in them.
    constant: bool,
}

impl Line {
    /// Least squares. `None` where an edge is farther from the line than eight samples a clock explain: a pause is
    /// never smoothed over.
    pub(crate) fn through(rises: &[u64]) -> Option<Line> {
        let [origin, _, _, ..] = rises else {
            return None;
        };
        let n = rises.len() as f64;
        let middle = (n - 1.0) / 2.0;
        let (mut sum, mut slope) = (0.0, 0.0);
        for (index, rise) in rises.iter().enumerate() {
            let t_ns = (rise - origin) as f64;
            sum += t_ns;
            slope += (index as f64 - middle) * t_ns;
        }
        let period_ns = slope * 12.0 / (n * (n * n - 1.0));
        let first_ns = sum / n - middle * period_ns;
        // Whole nanoseconds are a sample too.
        let most = period_ns / 8.0 + 1.0;
        let (mut early, mut late) = (0f64, 0f64);
        for (index, rise) in rises.iter().enumerate() {
            let t_ns = (rise - origin) as f64;
            let off_ns = t_ns - first_ns - index as f64 * period_ns;
            (early, late) = (early.min(off_ns), late.max(off_ns));
        }
        let first_ns = first_ns + *origin as f64;
        (late.max(-early) <= most).then_some(Line {
            first_ns,
            period_ns,
            constant: late - early <= most,
        })
    }

    /// Rising edges count from 0 here.
    fn at(&self, index: usize) -> f64 {
        self.first_ns + index as f64 * self.period_ns
    }

    /// The middle of the bit that a rising edge set, the Ack having come at `ack_ns`.
    #[inline]
    pub(crate) fn middle(&self, rises: &[u64], index: usize, ack_ns: Option<u64>) -> u64 {
        // Where some clocks are longer than others the truth is between the line and the edges.
        let weight = if self.constant { 0.0 } else { 0.5 };
        let place = |index: usize| {
            let edge_ns = rises.get(index).map_or(0.0, |rise| *rise as f64);
            self.at(index) * (1.0 - weight) + edge_ns * weight
        };
        let delay = ack_ns.map_or(0.0, |ack| ack as f64 - place(1));
        (place(index) + delay + self.period_ns / 2.0) as u64
    }
}

/// A time that is later stands for this one, 292 years from the beginning: there has to be room to reckon with it.
const END_NS: u64 = u64::MAX / 2;

/// By how much a rest may be shorter than its stamps say: a sample, of eight at the slowest clock.
const STAMP_MAX_NS: u64 = 1_000_000_000 / (CLOCK_MIN_HZ as u64 * 8) + 1;

/// SL changes once a clock at most, and spikes may be among that. More is noise, or MA never rests: from there on SL counts
/// as unknown, and no memory and no time are spent on it.
const MOST_CHANGES: usize = 2 * MAX_CLOCKS;

/// Changes that are kept for the next trace, where somebody wants them: more than a block of any source holds. Where SL makes
/// noise and nobody clocks it the oldest ones are of no use.
const MOST_LOGGED: usize = 1 << 17;

/// Frames enough to tell MA from SLO.
const FIRST_CHANGES: usize = 1 << 11;

/// So many likely cycles in a row with the same line delay are certain. Pieces measure a delay too, and all bits of a line
/// stand at the same place in a clock: two or three that agree were met, by chance, in millions of recordings.
const CONFIRMING: usize = 4;

/// One cycle's edges as recorded, times in ns.
#[derive(Debug, Default)]
struct Edges {
    idle: Option<bool>,
    /// How long MA had been at rest.
    rest_ns: u64,
    /// From the last rising edge before it to SL = 1.
    ready_before_ns: u64,
    /// SL did not move meanwhile.
    still: bool,
    /// It is the first one, and ended with SL = 1 in less than half the time that MA had rested: the slave would have
    /// timed out in a rest inside a frame.
    lone: bool,
    begin: Begin,
    tailless: bool,
    falls: Vec<u64>,
    rises: Vec<u64>,
    /// Shortest rise-to-rise time.
    shortest_ns: Option<u64>,
    /// SL changes, the first entry is the level when the cycle began.
    slo: Vec<(u64, Option<bool>)>,
    /// So often SL rose as at the end of a cycle, but for the line delay that was measured.
    doubts: u8,
    /// Until then an Ack may belong to the cycle before, from which this one was split by a pause, because nothing had
    /// answered; and how long that pause was.
    suspect: Option<(u64, u64)>,
    cdm: Option<bool>,
    ready_ns: Option<u64>,
    end_ns: u64,
}

impl Edges {
    fn clear(&mut self) {
        let (mut falls, mut rises, mut slo) = (
            std::mem::take(&mut self.falls),
            std::mem::take(&mut self.rises),
            std::mem::take(&mut self.slo),
        );
        falls.clear();
        rises.clear();
        slo.clear();
        *self = Edges {
            falls,
            rises,
            slo,
            ..Edges::default()
        };
    }

    fn last_edge(&self) -> Option<u64> {
        self.rises.last().copied().max(self.falls.last().copied())
    }

    /// Mean of the rise-to-rise times about their median: one pause does not change it.
    fn period(&self) -> Option<u64> {
        if let Some(steady) = self.steady() {
            return Some(steady);
        }
        let spans = || self.rises.windows(2).map(|pair| pair[1] - pair[0]);
        let mut sorted: Vec<u64> = spans().collect();
        if sorted.is_empty() {
            return None;
        }
        let middle = sorted.len() / 2;
        let median = *sorted.select_nth_unstable(middle).1;
        let usual = spans().filter(|span| span.abs_diff(median) <= median / 4);
        let (count, sum) = usual.fold((0, 0), |(count, sum), span| (count + 1, sum + span));
        Some(sum / count)
    }

    /// Mean of all rise-to-rise times, where none is far from it.
    fn steady(&self) -> Option<u64> {
        let mean = mean_period(&self.rises)?;
        let usual = |pair: &[u64]| (pair[1] - pair[0]).abs_diff(mean) <= mean / 4;
        self.rises.windows(2).all(usual).then_some(mean)
    }

    /// SL falling after the second rising edge (D2, p. 8), until the start bit: that comes a clock later, or three quarters
    /// of one. What is shorter is a spike, and no Ack.
    fn delay(&self) -> Option<u64> {
        let (acked, _) = self.ack()?;
        Some(acked.saturating_sub(*self.rises.get(1)?))
    }

    /// When the Ack came, and which change of SL it is. One that was there with the second rising edge came with it.
    fn ack(&self) -> Option<(u64, usize)> {
        let second = *self.rises.get(1)?;
        let after = self.slo.partition_point(|(t, _)| *t <= second);
        let before = after
            .checked_sub(1)
            .and_then(|at| Some((at, self.slo.get(at)?)));
        if let Some((at, (_, Some(false)))) = before {
            // Down already: the analyser's channels are not quite in step.
            return Some((second, at));
        }
        self.stays(after, false)
    }

    /// Ack to start.
    fn busy(&self) -> Option<u64> {
        let (acked, at) = self.ack()?;
        let (started, _) = self.stays(at + 1, true)?;
        Some(started - acked)
    }

    /// When SL was `level` for longer than a spike, at change `from` or a later one, and which that is.
    fn stays(&self, from: usize, level: bool) -> Option<(u64, usize)> {
        let shortest = self.shortest_ns.unwrap_or(0) / 2;
        let changes = self.slo.get(from..)?;
        changes.iter().enumerate().find_map(|(at, (t, is))| {
            let next = changes.get(at + 1);
            let stays = next.is_none_or(|(next, _)| next - t > shortest);
            (*is == Some(level) && stays).then_some((*t, from + at))
        })
    }

    /// Three rising edges within little more than a clock: one of them is a spike on MA, and whether the slave took it for
    /// a clock nobody knows. A clock that catches up after a pause has a long one beside the short ones.
    fn crowded(&self, index: usize, period: u64) -> bool {
        let next = self.rises.get(index + 1);
        let before = index.checked_sub(1).and_then(|at| self.rises.get(at));
        before
            .zip(next)
            .is_some_and(|(before, next)| next - before <= period + period / 4)
    }

    /// When SL was first 0 since the cycle began: before that there is nothing that a pause could cut.
    fn answered(&self) -> Option<u64> {
        let fall = |(t_ns, level): &(u64, Option<bool>)| (*level == Some(false)).then_some(*t_ns);
        self.slo.iter().find_map(fall)
    }

    /// The latest edge that may have asked for an Ack, MA falling again at `t_ns`. After a pause the slave may have
    /// begun anew at any edge, even the last one: then its second one is still to come.
    fn asked_by(&self, t_ns: u64) -> u64 {
        let period = self.period().unwrap_or(0);
        let (Some(fall), [first, second, ..]) = (self.falls.first(), &self.rises[..]) else {
            return t_ns + period;
        };
        let paused = Line::through(&self.rises).is_none() || first.saturating_sub(*fall) > period;
        if paused || self.begin != Begin::Certain {
            return t_ns + period;
        }
        *second
    }

    /// SL fell before anything had been asked: bits of an earlier cycle are still under way.
    fn overtaken(&self, period: u64) -> bool {
        let asked = self.rises.get(1).or(self.rises.last());
        self.answered()
            .zip(asked)
            .is_some_and(|(answered, asked)| answered + skew(period) < *asked)
    }
}

impl Slicer {
    /// For slaves whose timeout is at most this long. A rest of MA longer than that and the line delay ends every
    /// frame, whatever SL does (D2, p. 12: 40 µs).
    pub fn new(timeout_max_ns: u64) -> Slicer {
        Slicer {
            timeout_ns: timeout_max_ns,
            t_ns: 0,
            begun: false,
            ma: true,
            slo: None,
            state: State::Rest,
            cycle: Edges::default(),
            let_go: None,
            done: VecDeque::new(),
            held: 0,
            spare: Vec::new(),
            moved_ns: 0,
            begin: Begin::Unknown,
            risen_ns: 0,
            ready_ns: 0,
            slo_ns: 0,
            first: Vec::new(),
            log: None,
        }
    }

    /// So many changes are kept for the next trace.
    pub(crate) fn backlog(&self) -> usize {
        self.log.as_ref().map_or(0, VecDeque::len)
    }

    /// The first changes that were pushed, a few frames of them.
    pub(crate) fn first(&self) -> &[Change] {
        &self.first
    }

    /// From now on [`Trace::wave`] of each cycle gets all changes, where there is one.
    pub fn keep_waveform(&mut self) {
        self.log.get_or_insert_default();
    }

    /// MA and SLO from `t_ns` on, until the next call. `None` for SLO means neither 0 nor 1. Times that go
    /// backwards are taken for the last one.
    pub fn push(&mut self, t_ns: u64, ma: bool, slo: Option<bool>) {
        let t_ns = t_ns.min(END_NS).max(self.t_ns);
        if !self.begun {
            (self.begun, self.ma, self.slo) = (true, ma, slo);
            (self.moved_ns, self.slo_ns) = (t_ns, t_ns);
        }
        self.settle(t_ns);
        self.t_ns = t_ns;
        if self.first.len() < FIRST_CHANGES {
            self.first.push(Change { t_ns, ma, slo });
        }
        if let Some(log) = &mut self.log {
            if log.len() == MOST_LOGGED {
                log.pop_front();
            }
            log.push_back(Change { t_ns, ma, slo });
        }
        if slo != self.slo {
            self.slo_changes(t_ns, slo);
        }
        if ma != self.ma {
            self.ma_changes(t_ns, ma);
        }
    }

    /// From `t_ns` on MA is not known: what runs is cut, and what comes next begins like a recording.
    pub fn gap(&mut self, t_ns: u64) {
        self.finish(t_ns);
        self.begun = false;
        self.begin = Begin::Unknown;
    }

    /// The recording is over at `t_ns`.
    pub fn finish(&mut self, t_ns: u64) {
        let t_ns = t_ns.min(END_NS).max(self.t_ns);
        self.settle(t_ns);
        self.t_ns = t_ns;
        if let Some(at) = self.let_go {
            self.ready(at);
        }
        if self.state != State::Rest {
            self.cycle.tailless = true;
            self.end(t_ns, None);
        }
        self.vouch(t_ns);
        self.held = 0;
    }

    /// The next finished cycle, written to `trace`. False when there is none yet.
    pub fn take(&mut self, trace: &mut Trace) -> bool {
        if self.done.len() <= self.held {
            return false;
        }
        if let Some(Done::Read(regular)) = self.done.front() {
            show(regular, trace);
            self.done.pop_front();
            return true;
        }
        let Some(Done::Pushed(mut edges)) = self.done.pop_front() else {
            return false;
        };
        sample(&edges, trace);
        if let (Some(wave), Some(log)) = (&mut trace.wave, &mut self.log) {
            while let Some(change) = log.front().filter(|change| change.t_ns <= edges.end_ns) {
                wave.note(change.t_ns, change.ma, change.slo);
                log.pop_front();
            }
        }
        edges.clear();
        self.spare.push(edges);
        true
    }

    /// Whether all changes are wanted, and not the cycles alone.
    pub(crate) fn keeps_waveform(&self) -> bool {
        self.log.is_some()
    }

    /// The slave's longest timeout.
    pub(crate) fn timeout_ns(&self) -> u64 {
        self.timeout_ns
    }

    /// Whether a cycle that begins at `t_ns` with a falling edge of MA can be read as a whole: both wires are 1, and nothing
    /// that came before has a say in it.
    pub(crate) fn is_calm(&mut self, t_ns: u64) -> bool {
        if self.begun {
            self.settle(t_ns);
        }
        let rested = t_ns.saturating_sub(self.moved_ns) > self.longest_rest();
        self.begun
            && self.state == State::Rest
            && (self.begin == Begin::Certain || rested)
            && self.held == 0
            && self.ma
            && self.slo == Some(true)
    }

    /// A cycle that was read as a whole, where the slicer is calm.
    pub(crate) fn accept(&mut self, regular: Regular) {
        self.begin = Begin::Certain;
        self.moved_ns = regular.risen_ns;
        self.risen_ns = regular.risen_ns;
        self.ready_ns = regular.ready_ns;
        self.t_ns = regular.risen_ns + regular.ready_ns;
        self.done.push_back(Done::Read(regular));
    }

    /// Hands over the changes that belong to no cycle yet, from where the last one was over.
    pub fn rest(&mut self, wave: &mut Waveform) {
        for change in self.log.iter_mut().flat_map(|log| log.drain(..)) {
            wave.note(change.t_ns, change.ma, change.slo);
        }
    }

    /// A rest of MA that ends every frame, and after which no bit is on its way.
    fn longest_rest(&self) -> u64 {
        self.timeout_ns
            .max(LINE_DELAY_MAX_NS)
            .saturating_add(STAMP_MAX_NS)
    }

    /// Ends the cycle when MA has rested long enough by `t_ns`.
    fn settle(&mut self, t_ns: u64) {
        if self.state == State::Rest {
            return;
        }
        if let Some(at) = self
            .let_go
            .filter(|at| t_ns - at > skew(self.cycle.period().unwrap_or(0)))
        {
            self.ready(at);
            return;
        }
        let timeout = self.timeout_ns.saturating_add(STAMP_MAX_NS);
        if t_ns.saturating_sub(self.moved_ns) <= timeout {
            return;
        }
        let limit = match (self.cycle.begin, self.cycle.delay()) {
            (Begin::Unknown, _) => timeout.saturating_add(LINE_DELAY_MAX_NS),
            (_, Some(delay)) => timeout.saturating_add(delay.min(LINE_DELAY_MAX_NS)),
            (_, None) => self.longest_rest(),
        };
        if t_ns.saturating_sub(self.moved_ns) > limit {
            self.end(self.moved_ns.saturating_add(limit), Some(!self.ma));
        }
    }

    fn slo_changes(&mut self, t_ns: u64, level: Option<bool>) {
        self.vouch(t_ns);
        (self.slo, self.slo_ns) = (level, t_ns);
        if level == Some(true) {
            self.ready_ns = t_ns - self.risen_ns;
        }
        if self.state == State::Rest {
            return;
        }
        match self.cycle.slo.len() {
            ..MOST_CHANGES => self.cycle.slo.push((t_ns, level)),
            MOST_CHANGES => self.cycle.slo.push((t_ns, None)),
            _ => {}
        }
        if level == Some(true) && self.slave_let_go(t_ns) {
            self.let_go = Some(t_ns);
        }
    }

    fn ready(&mut self, at_ns: u64) {
        let since = self.cycle.last_edge().unwrap_or(at_ns);
        self.cycle.ready_ns = Some(at_ns - since);
        self.end(at_ns, Some(!self.ma));
    }

    /// SL rises although no rising edge is left that could have set it: between a bit that is half a clock late and
    /// the earliest SL = 1 of an adaptive slave.
    fn slave_let_go(&self, t_ns: u64) -> bool {
        let (Some(last), Some(shortest)) = (self.cycle.rises.last(), self.cycle.shortest_ns) else {
            return false;
        };
        let rest = t_ns - last;
        // Less than what is asked for below, whatever the line delay and the period: most changes are no end.
        if rest <= shortest * 3 / 4 {
            return false;
        }
        let delay = match self.cycle.begin {
            Begin::Unknown => None,
            _ => Some(self.cycle.delay().unwrap_or(0)),
        };
        if delay.is_some_and(|delay| delay <= LINE_DELAY_MAX_NS && rest <= delay + shortest / 2) {
            return false;
        }
        let Some(period) = self.cycle.period() else {
            return false;
        };
        match delay.filter(|delay| *delay <= LINE_DELAY_MAX_NS + period) {
            Some(delay) => rest > delay + period * 3 / 4,
            // It was measured from an edge that was hardly the second one of its frame. The shortest timeout is as long as the
            // slowest clock, and MA rests.
            None => rest > period * 7 / 8 && t_ns - self.moved_ns > period * 3 / 4,
        }
    }

    /// Whether the next rising edge would have come before: one that comes with SL = 1 then releases CDM = 1. MA was low for
    /// longer than in a clock, unless it rested high and goes on: then SL rises for the edge.
    fn is_late(&self, t_ns: u64) -> bool {
        let known = self.cycle.begin != Begin::Unknown;
        let last = self.cycle.rises.last().zip(self.cycle.period());
        let delay = self.cycle.delay().unwrap_or(0);
        last.is_some_and(|(last, period)| {
            let held = t_ns.saturating_sub(self.moved_ns) > period * 3 / 4;
            known && held && t_ns - last > delay + period * 7 / 4
        })
    }

    fn ma_changes(&mut self, t_ns: u64, ma: bool) {
        let ends = |slicer: &Slicer, at: &u64| !ma || slicer.is_late(*at);
        if let Some(at) = self.let_go.take().filter(|at| ends(self, at)) {
            self.ready(at);
        }
        self.ma = ma;
        let rest_ns = t_ns - self.moved_ns;
        self.moved_ns = t_ns;
        if self.state == State::Rest && rest_ns > self.longest_rest() {
            self.begin = Begin::Certain;
        }
        // Nothing has answered yet: a rest of three clocks begins anew, else frames without an encoder would run
        // into one. Unless the Ack of the old one is only late.
        let mut suspect = None;
        if self.state == State::Running && !ma && self.cycle.answered().is_none() {
            let rest = t_ns - self.cycle.rises.last().copied().unwrap_or(t_ns);
            // Hardly ever, and the period takes a look at all edges.
            let long = self.cycle.shortest_ns.is_some_and(|ns| rest > 3 * ns);
            if long && self.cycle.period().is_some_and(|period| rest > 3 * period) {
                let until = self.cycle.asked_by(t_ns).saturating_add(LINE_DELAY_MAX_NS);
                suspect = Some((until, rest)).max(self.cycle.suspect);
                self.end(t_ns, None);
            }
        }
        if self.state == State::Running && !ma && self.has_ended_twice(rest_ns) {
            self.ready(self.slo_ns);
            // Nobody knows how long the line delays, so neither what is still on its way.
            self.begin = Begin::Unknown;
        }
        match (self.state, ma) {
            (State::Rest, false) => {
                self.arm(t_ns, rest_ns);
                self.cycle.suspect = suspect;
            }
            (State::Rest, true) => {}
            (State::Armed | State::Running, false) => {
                let falls = &mut self.cycle.falls;
                if falls.len() > MAX_CLOCKS {
                    // As the rising edges: those before the last two are kept, and the one to come.
                    falls.remove(MAX_CLOCKS - 2);
                }
                falls.push(t_ns);
            }
            (State::Armed | State::Running, true) => self.rise(t_ns),
        }
    }

    /// Whether this rest of MA is the second one that looks like the end of a cycle, but for a line delay that is longer: no
    /// master pauses so often, so it was none. Without this one answer that comes late would make one cycle of all.
    fn has_ended_twice(&mut self, rest_ns: u64) -> bool {
        if rest_ns <= TIMEOUT_MIN_NS || self.slo != Some(true) {
            return false;
        }
        let risen = self.slo_ns.saturating_sub(self.risen_ns);
        let clock = self.cycle.shortest_ns.unwrap_or(0);
        if risen > clock * 3 / 4 {
            self.cycle.doubts = self.cycle.doubts.saturating_add(1);
        }
        self.cycle.doubts > 1
    }

    fn rise(&mut self, t_ns: u64) {
        self.state = State::Running;
        self.risen_ns = t_ns;
        let rises = &mut self.cycle.rises;
        let span = rises.last().map(|last| t_ns - last);
        self.cycle.shortest_ns = self.cycle.shortest_ns.or(span).min(span);
        let full = rises.len() >= MAX_CLOCKS;
        if let [.., before, last] = &mut rises[..] {
            if full {
                // Longer than any frame: the last two are kept, and the gap before them is a stall.
                (*before, *last) = (*last, t_ns);
                return;
            }
        }
        rises.push(t_ns);
    }

    fn arm(&mut self, t_ns: u64, rest_ns: u64) {
        self.vouch(t_ns);
        self.state = State::Armed;
        self.cycle.still = t_ns - self.slo_ns >= rest_ns;
        self.cycle.idle = self.slo;
        self.cycle.rest_ns = rest_ns;
        self.cycle.begin = self.begin;
        self.cycle.ready_before_ns = self.ready_ns;
        self.cycle.slo.push((t_ns, self.slo));
        self.cycle.falls.push(t_ns);
    }

    fn end(&mut self, t_ns: u64, cdm: Option<bool>) {
        let mut edges = std::mem::replace(&mut self.cycle, self.spare.pop().unwrap_or_default());
        self.let_go = None;
        edges.end_ns = t_ns;
        edges.cdm = cdm;
        let period = edges.period();
        let first = edges.begin == Begin::Unknown;
        if first {
            // Only the recording's own beginning tells: MA at rest for longer than a frame may pause, SL high.
            let needed = period.map(|period| TIMEOUT_MIN_NS.max(period + period / 2));
            if edges.idle == Some(true) && needed.is_some_and(|needed| edges.rest_ns > needed) {
                edges.begin = Begin::Likely;
                let rest_ns = edges.rest_ns;
                edges.lone = edges.still && edges.ready_ns.is_some_and(|ns| rest_ns > 2 * ns);
            }
        }
        let answered = edges.answered();
        edges.suspect = edges
            .suspect
            .filter(|(until, _)| answered.is_some_and(|t_ns| t_ns <= *until));
        let overtaken = edges.overtaken(period.unwrap_or(0));
        // By its own line delay SL may have risen with a bit of the cycle before, not at its end.
        let early = edges
            .delay()
            .zip(period)
            .is_some_and(|(delay, period)| edges.ready_before_ns <= delay + period * 3 / 4);
        match edges.begin {
            Begin::Likely if overtaken || early && !first => edges.begin = Begin::Unknown,
            Begin::Certain if overtaken => edges.suspect = Some((u64::MAX, edges.rest_ns)),
            _ => {}
        }
        let delay = edges
            .delay()
            .filter(|_| edges.suspect.is_none() && !overtaken);
        self.state = State::Rest;
        if edges.rises.is_empty() {
            edges.clear();
            self.spare.push(edges);
            self.begin = self.begin.max(Begin::Likely);
            return;
        }
        self.confirm(&mut edges, delay, period);
        // An answer that is missing cannot mislead; one that may be another's can.
        let known = edges.begin == Begin::Certain && (delay.is_some() || answered.is_none());
        self.begin = if known { Begin::Certain } else { Begin::Likely };
        self.done.push_back(Done::Pushed(edges));
    }

    /// The first cycle began where it seems to, if SL has been 1 since its end for so long by `t_ns` that no bit can be on its
    /// way: then that 1 was the end, and shows how long the slave waits.
    fn vouch(&mut self, t_ns: u64) {
        if self.held != 1 || t_ns.saturating_sub(self.slo_ns) <= LINE_DELAY_MAX_NS {
            return;
        }
        if let Some(Done::Pushed(edges)) = self.done.back_mut() {
            if edges.lone && self.slo == Some(true) {
                edges.begin = Begin::Certain;
                (self.begin, self.held) = (Begin::Certain, 0);
            }
        }
    }

    /// Cycles in a row with the same line delay, each measured on its own, began where they seem to.
    fn confirm(&mut self, edges: &mut Edges, delay: Option<u64>, period: Option<u64>) {
        let (Some(delay), Some(period)) = (delay, period) else {
            self.held = 0;
            return;
        };
        let held = self.done.len() - self.held..;
        let alike = |other: &Done| {
            let Done::Pushed(other) = other else {
                return false;
            };
            // A cycle that was cut short has no period of its own, or a wrong one.
            let period = other.period().unwrap_or(0).min(period);
            let other = other.delay().unwrap_or(u64::MAX);
            other.abs_diff(delay) <= period / 2 + 1
        };
        if edges.begin == Begin::Unknown || !self.done.range(held.clone()).all(alike) {
            self.held = 0;
        } else if edges.begin == Begin::Certain || self.held + 1 >= CONFIRMING {
            for other in self.done.range_mut(held) {
                if let Done::Pushed(other) = other {
                    other.begin = Begin::Certain;
                }
            }
            edges.begin = Begin::Certain;
            self.held = 0;
            return;
        }
        self.held += usize::from(edges.begin == Begin::Likely);
    }
}

/// From the first rising edge to the last one, a clock on average, rounded.
pub(crate) fn mean_period(rises: &[u64]) -> Option<u64> {
    let (first, last) = rises.first().zip(rises.last())?;
    let spans = rises.len() as u64 - 1;
    (last - first + spans / 2).checked_div(spans)
}

/// By how much two channels of an analyser may be out of step: a sample.
fn skew(period: u64) -> u64 {
    period / 8 + 1
}

/// What was read as a whole.
fn show(regular: &Regular, trace: &mut Trace) {
    trace.reset();
    trace.t_ns = regular.t_ns;
    trace.idle = Some(true);
    trace.cdm = Some(false);
    trace.ready_ns = u32::try_from(regular.ready_ns).ok();
    trace.ma_period_ns = Some(regular.period_ns);
    trace.delay_ns = Some(regular.delay_ns);
    trace.busy_ns = Some(regular.busy_ns);
    trace.reference_ns = Some(regular.reference_ns);
    trace.longest = Some(Level {
        ns: regular.longest_ns,
        edge: regular.longest_edge,
    });
    trace.bits.set(&regular.bits, regular.clocks);
}

/// One level a rising edge, in the middle of the bit it set.
fn sample(edges: &Edges, trace: &mut Trace) {
    trace.reset();
    trace.t_ns = edges
        .falls
        .first()
        .or(edges.rises.first())
        .copied()
        .unwrap_or(0);
    trace.idle = edges.idle;
    trace.misplaced_ns = edges
        .suspect
        .map(|(_, pause)| u32::try_from(pause).unwrap_or(u32::MAX));
    trace.cut = match (edges.begin, edges.tailless) {
        (Begin::Unknown, _) => Some(Cut::Begin),
        (_, true) => Some(Cut::End),
        _ => None,
    };
    trace.unconfirmed = edges.begin == Begin::Likely;
    trace.cdm = edges.cdm;
    trace.ready_ns = edges.ready_ns.and_then(|ns| u32::try_from(ns).ok());
    let line = Line::through(&edges.rises);
    let (period, delay) = (edges.period(), edges.delay());
    trace.ma_period_ns = period.and_then(|ns| u32::try_from(ns).ok());
    trace.delay_ns = delay.and_then(|ns| u32::try_from(ns).ok());
    trace.busy_ns = edges.busy().and_then(|ns| u32::try_from(ns).ok());
    measure_levels(edges, trace);
    let period = period.unwrap_or(0);
    // The middle of the bit as it arrives: whole clocks of line delay are taken out too, so that MA may pause
    // while bits are still on their way.
    let ack_ns = edges
        .rises
        .get(1)
        .zip(delay)
        .map(|(second, delay)| second + delay);
    let mut changes = edges.slo.iter().peekable();
    let mut level = edges.idle;
    for (index, rise) in edges.rises.iter().enumerate() {
        let at = match line {
            Some(line) => line.middle(&edges.rises, index, ack_ns),
            None => {
                // A bit is as long as its clock, which may be shorter than most.
                let clock = edges.rises.get(index + 1).map(|next| next - rise);
                let short = clock.filter(|clock| clock + period / 8 < period);
                rise.saturating_add(delay.unwrap_or(0) + short.unwrap_or(period) / 2)
            }
        };
        if at > edges.end_ns || edges.crowded(index, period) {
            break;
        }
        while let Some((_, next)) = changes.next_if(|(t, _)| *t <= at) {
            level = *next;
        }
        if let Some(wave) = &mut trace.wave {
            wave.samples_ns.push(at);
        }
        match level {
            Some(level) => trace.bits.push(level),
            // What is neither 0 nor 1 is not guessed: the frame ends here.
            None => break,
        }
    }
}

fn measure_levels(edges: &Edges, trace: &mut Trace) {
    if let (Some(first), Some(second)) = (edges.falls.first(), edges.rises.get(1)) {
        trace.reference_ns = u32::try_from(second.saturating_sub(*first)).ok();
    }
    let mut falls = edges.falls.iter().peekable();
    let mut previous: Option<u64> = None;
    for (index, rise) in edges.rises.iter().enumerate() {
        let edge = index as u16 + 1;
        let mut low_from = None;
        while let Some(fall) = falls.next_if(|fall| *fall <= rise) {
            low_from = Some(*fall);
        }
        if let Some(fall) = low_from {
            trace.level(rise - fall, edge);
            if let Some(previous) = previous {
                trace.level(fall.saturating_sub(previous), edge);
            }
        }
        if let Some(previous) = previous {
            trace.level(rise - previous, edge);
        }
        previous = Some(*rise);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cycle::{Cycle, Fault};
    use crate::frame::{BissC, Stall};
    use crate::protocol::Protocol;
    use crate::slave::{Config, Slave};

    /// A recorder on the wires of a simulated slave.
    struct Bench {
        slave: Slave,
        slicer: Slicer,
        t: u64,
        ma: bool,
    }

    impl Bench {
        fn new(config: &str) -> Bench {
            let config: Config = config.parse().unwrap_or_else(|e| panic!("{e}"));
            let mut bench = Bench {
                slave: Slave::new(config),
                slicer: Slicer::new(40_000),
                t: 0,
                ma: true,
            };
            bench.slicer.push(0, true, Some(bench.slave.slo(0)));
            bench
        }

        /// Lets time pass, recording SL's own changes.
        fn pass(&mut self, ns: u64) {
            let end = self.t + ns;
            while let Some(at) = self.slave.next_change().filter(|at| *at <= end) {
                let level = self.slave.slo(at);
                self.slicer.push(at, self.ma, Some(level));
            }
            self.t = end;
        }

        fn ma(&mut self, level: bool) {
            self.ma = level;
            self.slave.ma(self.t, level);
            let slo = self.slave.slo(self.t);
            self.slicer.push(self.t, level, Some(slo));
        }

        fn clock(&mut self, edges: usize, half: u64) {
            for _ in 0..edges {
                self.ma(false);
                self.pass(half);
                self.ma(true);
                self.pass(half);
            }
        }

        fn faults(&mut self, format: &str) -> Vec<Result<u64, Fault>> {
            self.faults_of(format, None)
        }

        /// Of a slave that is known to wait so long at least.
        fn faults_of(
            &mut self,
            format: &str,
            least_ns: impl Into<Option<u32>>,
        ) -> Vec<Result<u64, Fault>> {
            self.slicer.finish(self.t);
            let mut protocol = BissC::new(format.parse().unwrap());
            if let Some(min_ns) = least_ns.into() {
                protocol.stall = Stall::Static { min_ns };
            }
            let (mut trace, mut cycle) = (Trace::default(), Cycle::default());
            let mut all = Vec::new();
            while self.slicer.take(&mut trace) {
                protocol.decode(&trace, &mut cycle);
                all.push(match cycle.fault() {
                    Some(fault) => Err(fault),
                    None => cycle.words()[0]
                        .good()
                        .ok_or_else(|| cycle.words()[0].fault().unwrap()),
                });
            }
            all
        }
    }

    const CONFIG: &str = "motion=count,pos=165,delay=300ns,timeout=15us,frame=st8,crc6";
    const FORMAT: &str = "st8,crc6";
    /// LAT, Ack, start, CDS, 8 + 6, stop.
    const EDGES: usize = 19;

    #[test]
    fn frames_with_rests_between() {
        let mut bench = Bench::new(CONFIG);
        bench.pass(50_000);
        for rest in [20_000, 16_000, 500_000, 20_000] {
            bench.clock(EDGES, 500);
            bench.pass(rest);
        }
        assert_eq!(bench.faults(FORMAT), [Ok(165), Ok(166), Ok(167), Ok(168)]);
    }

    /// Behind a pause SL rises with its own edge, without a line delay at the same time: no master lets go of CDM = 1 there.
    #[test]
    fn a_bit_that_rises_with_its_edge_behind_a_pause_is_no_end() {
        for at in 2..EDGES {
            let config = "motion=still,pos=165,delay=0ns,timeout=20us,frame=st8,crc6";
            let mut bench = Bench::new(config);
            bench.pass(50_000);
            bench.clock(at, 1_000);
            bench.pass(17_000);
            bench.clock(EDGES - at, 1_000);
            bench.pass(60_000);
            let all = bench.faults(FORMAT);
            assert!(
                matches!(all[..], [Err(Fault::Stalled { .. })]),
                "{at}: {all:?}"
            );
        }
    }

    /// A trigger's capture: one frame, less than a line delay and a timeout behind its beginning. The slave's own timeout
    /// tells that it would have ended a frame in that rest.
    #[test]
    fn a_lone_frame_vouches_for_itself() {
        let config = "motion=count,pos=165,delay=112ns,timeout=adaptive,frame=st8,crc6";
        for (lead, tail, counts) in [
            (33_000, 50_000, true),
            (33_000, 39_000, false),
            (12_000, 50_000, false),
        ] {
            let mut bench = Bench::new(config);
            bench.pass(lead);
            bench.clock(EDGES, 500);
            bench.pass(tail);
            let mut trace = Trace::default();
            bench.slicer.finish(bench.t);
            assert!(bench.slicer.take(&mut trace));
            let known = trace.cut != Some(Cut::Begin) && !trace.unconfirmed;
            assert_eq!(known, counts, "{lead} {tail} {trace:?}");
        }
        // Where the slave waits longer than half the rest, it could have been a rest inside a frame.
        let mut bench = Bench::new(CONFIG);
        bench.pass(29_000);
        bench.clock(EDGES, 500);
        bench.pass(60_000);
        bench.slicer.finish(bench.t);
        let mut trace = Trace::default();
        assert!(bench.slicer.take(&mut trace) && trace.unconfirmed);
    }

    #[test]
    fn the_release_of_cdm_is_no_edge() {
        let mut bench = Bench::new(CONFIG);
        bench.pass(50_000);
        for _ in 0..3 {
            bench.clock(EDGES, 500);
            bench.ma(false);
            bench.pass(20_000);
            bench.ma(true);
            bench.pass(1_000);
        }
        assert_eq!(bench.faults(FORMAT), [Ok(165), Ok(166), Ok(167)]);
    }

    /// Masters that see SL = 1 at once.
    #[test]
    fn the_release_of_cdm_may_come_with_ready() {
        for (delay, reaction) in [("0ns", 0), ("300ns", 0), ("300ns", 100), ("2300ns", 0)] {
            let config = CONFIG.replace("300ns", delay);
            let mut bench = Bench::new(&config);
            bench.pass(90_000);
            for _ in 0..3 {
                bench.clock(EDGES, 500);
                bench.ma(false);
                while let Some(at) = bench.slave.next_change() {
                    bench.pass(at - bench.t);
                }
                bench.pass(reaction);
                bench.ma(true);
                bench.pass(1_000);
            }
            let all = bench.faults(FORMAT);
            assert_eq!(all, [Ok(165), Ok(166), Ok(167)], "{delay} {reaction}");
        }
    }

    #[test]
    fn a_pause_inside_is_a_stall_or_two_pieces() {
        let mut bench = Bench::new(CONFIG);
        bench.pass(50_000);
        bench.clock(8, 500);
        bench.pass(13_000);
        bench.clock(EDGES - 8, 500);
        bench.pass(30_000);
        let all = bench.faults(FORMAT);
        assert!(
            matches!(
                all[..],
                [Err(Fault::Stalled {
                    level_ns: 14_000,
                    edge: 9,
                    ..
                })]
            ),
            "{all:?}"
        );
        for at in 3..EDGES {
            let mut bench = Bench::new(CONFIG);
            bench.pass(50_000);
            bench.clock(at, 500);
            bench.pass(30_000);
            bench.clock(EDGES - at, 500);
            bench.pass(30_000);
            let all = bench.faults(FORMAT);
            assert!(all.iter().all(Result::is_err), "{at}: {all:?}");
        }
    }

    #[test]
    fn starts_and_ends_anywhere() {
        let mut whole = Bench::new(CONFIG);
        whole.pass(50_000);
        let mut levels = vec![(0, true, Some(true))];
        for _ in 0..3 {
            for _ in 0..EDGES {
                for level in [false, true] {
                    whole.ma(level);
                    levels.push((whole.t, level, Some(whole.slave.slo(whole.t))));
                    while let Some(at) = whole.slave.next_change().filter(|at| *at <= whole.t + 500)
                    {
                        levels.push((at, level, Some(whole.slave.slo(at))));
                    }
                    whole.t += 500;
                }
            }
            let at = whole.t + 16_000;
            levels.push((at, true, Some(whole.slave.slo(at))));
            whole.t += 40_000;
        }
        let protocol = BissC::new(FORMAT.parse().unwrap());
        for from in 0..levels.len() {
            for to in [from + 20, from + 60, levels.len()] {
                let mut slicer = Slicer::new(40_000);
                let part = &levels[from..to.min(levels.len())];
                for (t, ma, slo) in part {
                    slicer.push(*t, *ma, *slo);
                }
                slicer.finish(part.last().map_or(0, |(t, ..)| *t));
                let (mut trace, mut cycle) = (Trace::default(), Cycle::default());
                while slicer.take(&mut trace) {
                    protocol.decode(&trace, &mut cycle);
                    if let Some(good) = cycle.words().first().and_then(|w| w.good()) {
                        assert!((165..168).contains(&good), "{good} from {from} to {to}");
                    }
                }
            }
        }
    }

    /// Bits of a long line rise while MA rests, as SL does at the end of a cycle: what follows in the same frame is no
    /// cycle whose beginning is known, unless MA rested longer than any timeout.
    #[test]
    fn a_rest_in_which_bits_arrive_is_no_certain_beginning() {
        let config = "motion=still,pos=85,delay=15us,timeout=40us,frame=st8,crc6";
        let mut pieces = 0;
        for rest in [17_000, 25_000, 38_000] {
            for (from, at) in
                (2..EDGES).flat_map(|from| (from + 1..EDGES).map(move |at| (from, at)))
            {
                let mut bench = Bench::new(config);
                bench.pass(50_000);
                bench.clock(from, 500);
                bench.slicer = Slicer::new(40_000);
                let level = bench.slave.slo(bench.t);
                bench.slicer.push(bench.t, true, Some(level));
                bench.clock(at - from, 500);
                bench.pass(rest);
                bench.clock(EDGES - at + 20, 500);
                bench.pass(90_000);
                bench.slicer.finish(bench.t);
                let mut trace = Trace::default();
                while bench.slicer.take(&mut trace) {
                    let known = trace.cut != Some(Cut::Begin) && !trace.unconfirmed;
                    assert!(!known, "{rest} {from} {at}: {trace:?}");
                    pieces += 1;
                }
            }
        }
        assert!(pieces > 600, "{pieces}: nothing was cut in two");
    }

    #[test]
    fn unknown_levels_cut_the_frame() {
        let mut slicer = Slicer::new(40_000);
        slicer.push(0, true, Some(true));
        for edge in 0..10u64 {
            let slo = if edge > 5 { None } else { Some(edge < 2) };
            slicer.push(100_000 + edge * 1000, false, slo);
            slicer.push(100_500 + edge * 1000, true, slo);
        }
        slicer.finish(200_000);
        let mut trace = Trace::default();
        assert!(slicer.take(&mut trace));
        assert_eq!(trace.bits.len(), 5);
    }

    /// MA never rests, and SL is quiet, or spikes in every clock. The next frame is read all the same.
    #[test]
    fn an_endless_cycle_takes_no_memory() {
        for spikes in [false, true] {
            let mut bench = Bench::new(CONFIG);
            for clock in 0..3 * MAX_CLOCKS as u64 {
                let t_ns = 1000 * (clock + 1);
                bench.slicer.push(t_ns, false, Some(true));
                bench.slicer.push(t_ns + 500, true, Some(true));
                bench.slicer.push(t_ns + 600, true, Some(!spikes));
                bench.slicer.push(t_ns + 620, true, Some(true));
            }
            let cycle = &bench.slicer.cycle;
            let kept = [&cycle.rises, &cycle.falls].map(Vec::len);
            assert_eq!(kept, [MAX_CLOCKS, MAX_CLOCKS + 1]);
            assert_eq!(cycle.slo.len(), if spikes { MOST_CHANGES + 1 } else { 1 });
            // The last edges, and the gap before them.
            bench.t = 1000 * (3 * MAX_CLOCKS as u64 + 1);
            assert_eq!(cycle.last_edge(), Some(bench.t - 500));
            let mut trace = Trace::default();
            measure_levels(cycle, &mut trace);
            let longest = trace.longest.map(|level| (level.ns, level.edge));
            let gap = 1000 * (2 * MAX_CLOCKS as u32 + 1);
            assert_eq!(longest, Some((gap, MAX_CLOCKS as u16 - 1)));
            bench.pass(200_000);
            bench.clock(EDGES, 500);
            bench.pass(30_000);
            let all = bench.faults(FORMAT);
            assert!(matches!(all[..], [Err(_), Ok(165)]), "{all:?}");
        }
    }

    /// An encoder that is plugged in during a frame answers, but nobody that asked so long ago.
    #[test]
    fn an_answer_that_is_too_late_keeps_no_cycle_open() {
        for (plugged_us, rest_ns) in [(22, 25_000), (30, 25_000), (43, 25_000), (52, 21_000)] {
            let config = format!(
                "motion=count,pos=165,absent={}us,timeout=20us,frame=st8,crc6",
                50 + plugged_us
            );
            let mut bench = Bench::new(&config);
            bench.pass(50_000);
            for _ in 0..8 {
                bench.clock(75, 500);
                bench.pass(rest_ns);
            }
            let all = bench.faults(FORMAT);
            // A line may delay by up to 40 µs: a rest is needed to see that it does not.
            let lost = if plugged_us < 42 { 2 } else { 1 };
            let good = (165 + lost..173).map(Ok).collect::<Vec<_>>();
            assert_eq!(all[1..], good, "{plugged_us}: {all:?}");
            assert!(all[0].is_err(), "{all:?}");
        }
    }

    /// The slowest clocks and the shortest timeout: SL = 1 comes a clock after the last edge, or little more.
    #[test]
    fn a_slow_clock_and_a_short_timeout_end_even_a_piece() {
        for half in [4_000, 5_000, 6_000, 6_250] {
            for delay in ["0ns", "100ns", "3us", "7us"] {
                for (lead, cdm) in [(1_500, false), (1_500, true), (9_000, false)] {
                    let config = format!(
                        "motion=count,pos=165,delay={delay},timeout=12500ns,frame=st8,crc6"
                    );
                    let mut bench = Bench::new(&config);
                    bench.pass(lead);
                    for _ in 0..8 {
                        bench.clock(EDGES, half);
                        bench.ma(!cdm);
                        bench.pass(25_000);
                        bench.ma(true);
                        bench.pass(half);
                    }
                    bench.pass(90_000);
                    let all = bench.faults_of(FORMAT, 13_000);
                    let good = (166..173).map(Ok).collect::<Vec<_>>();
                    assert_eq!(all[1..], good, "{half} {delay} {lead} {cdm}: {all:?}");
                }
            }
        }
    }

    /// SL makes noise and nobody clocks it, for long. The next frame has all of its own changes.
    #[test]
    fn noise_without_cycles_takes_no_memory() {
        let mut bench = Bench::new(CONFIG);
        bench.slicer.keep_waveform();
        for spike in 0..3 * MOST_LOGGED as u64 {
            bench.slicer.push(10 * spike, true, Some(spike % 2 == 0));
        }
        assert_eq!(bench.slicer.backlog(), MOST_LOGGED);
        bench.t = 30 * MOST_LOGGED as u64 + 1000;
        bench.slicer.push(bench.t, true, Some(true));
        bench.pass(100_000);
        let began = bench.t;
        bench.clock(EDGES, 500);
        bench.pass(100_000);
        let mut trace = Trace {
            wave: Some(Box::default()),
            ..Trace::default()
        };
        bench.slicer.finish(bench.t);
        assert!(bench.slicer.take(&mut trace));
        let changes = &trace.wave.as_ref().unwrap().changes;
        let own = changes.iter().filter(|change| change.t_ns >= began);
        let mut falls = 0;
        let mut before = true;
        for change in own {
            falls += usize::from(before && !change.ma);
            before = change.ma;
        }
        assert_eq!((trace.t_ns, falls), (began, EDGES));
        assert!(changes.len() <= MOST_LOGGED + 1);
        assert!(bench.slicer.backlog() < 2);
    }

    #[test]
    fn an_absent_encoder_is_no_ack_in_every_cycle() {
        let mut bench = Bench::new("stuck=1,frame=st8,crc6");
        bench.pass(50_000);
        for _ in 0..3 {
            bench.clock(EDGES, 500);
            bench.pass(20_000);
        }
        bench.pass(90_000);
        let all = bench.faults(FORMAT);
        assert_eq!(all.len(), 3);
        assert!(
            all.iter().all(|f| matches!(f, Err(Fault::NoAck { .. }))),
            "{all:?}"
        );
    }
}
