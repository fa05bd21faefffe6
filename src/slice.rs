//! A waveform with its edges stamped becomes cycles: MA's own edges cut it, SL is sampled in mid-bit.
//!
//! A cycle ends where the slave says so, when SL returns to 1 while MA rests, or when MA has rested longer than
//! any timeout. A pause that is neither stays inside its cycle, where it is found as a stall.

use crate::limits::{LINE_DELAY_MAX_NS, TIMEOUT_MIN_NS};
use crate::trace::{Cut, MAX_CLOCKS, Trace};
use std::collections::VecDeque;

/// Cuts a waveform into traces. Feed it levels in order of time with [`Slicer::push`] and take the cycles from
/// [`Slicer::take`].
#[derive(Debug)]
pub struct Slicer {
    timeout_ns: u64,
    t_ns: u64,
    begun: Option<u64>,
    ma: bool,
    /// `None` where the recording shows neither 0 nor 1.
    slo: Option<bool>,
    state: State,
    cycle: Edges,
    done: VecDeque<Edges>,
    spare: Vec<Edges>,
    /// The cycle before has ended, or MA has rested for longer than any timeout: the next falling edge begins a cycle
    /// for certain.
    rested: bool,
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

/// One cycle's edges as recorded, times in ns.
#[derive(Debug, Default)]
struct Edges {
    idle: Option<bool>,
    idle_since: Option<u64>,
    headless: bool,
    tailless: bool,
    falls: Vec<u64>,
    rises: Vec<u64>,
    /// SL changes, the first entry is the level when the cycle began.
    slo: Vec<(u64, Option<bool>)>,
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

    /// Median of the rise-to-rise times: one pause does not change it.
    fn period(&self) -> Option<u64> {
        let mut spans: Vec<u64> = self
            .rises
            .windows(2)
            .map(|pair| pair[1] - pair[0])
            .collect();
        let middle = spans.len() / 2;
        (!spans.is_empty()).then(|| *spans.select_nth_unstable(middle).1)
    }

    /// SL falling after the second rising edge (D2, p. 8).
    fn delay(&self) -> Option<u64> {
        let second = *self.rises.get(1)?;
        let before = self.slo.iter().take_while(|(t, _)| *t <= second).last();
        if before.is_some_and(|(_, level)| *level == Some(false)) {
            // Down already: the analyser's channels are not quite in step.
            return Some(0);
        }
        let (t, _) = self
            .slo
            .iter()
            .skip(1)
            .find(|(t, level)| *t >= second && *level == Some(false))?;
        Some(t - second)
    }

    /// Whether SL was seen at 0 since the cycle began: there is something that a pause could cut.
    fn acked(&self) -> bool {
        self.slo.iter().any(|(_, level)| *level == Some(false))
    }
}

impl Slicer {
    /// For slaves whose timeout is at most this long. A rest of MA longer than that and the line delay ends every
    /// frame, whatever SL does (D2, p. 12: 40 µs).
    pub fn new(timeout_max_ns: u64) -> Slicer {
        Slicer {
            timeout_ns: timeout_max_ns,
            t_ns: 0,
            begun: None,
            ma: true,
            slo: None,
            state: State::Rest,
            cycle: Edges::default(),
            done: VecDeque::new(),
            spare: Vec::new(),
            rested: false,
        }
    }

    /// MA and SLO from `t_ns` on, until the next call. `None` for SLO means neither 0 nor 1. Times that go
    /// backwards are taken for the last one.
    pub fn push(&mut self, t_ns: u64, ma: bool, slo: Option<bool>) {
        let t_ns = t_ns.max(self.t_ns);
        if self.begun.is_none() {
            (self.begun, self.ma, self.slo) = (Some(t_ns), ma, slo);
            self.cycle.idle_since = Some(t_ns);
        }
        self.settle(t_ns);
        self.t_ns = t_ns;
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
        self.begun = None;
        self.rested = false;
    }

    /// The recording is over at `t_ns`.
    pub fn finish(&mut self, t_ns: u64) {
        let t_ns = t_ns.max(self.t_ns);
        self.settle(t_ns);
        self.t_ns = t_ns;
        if self.state != State::Rest {
            self.cycle.tailless = true;
            self.end(t_ns, None);
        }
    }

    /// The next finished cycle, written to `trace`. False when there is none yet.
    pub fn take(&mut self, trace: &mut Trace) -> bool {
        let Some(mut edges) = self.done.pop_front() else {
            return false;
        };
        sample(&edges, trace);
        edges.clear();
        self.spare.push(edges);
        true
    }

    /// Ends the cycle when MA has rested long enough by `t_ns`.
    fn settle(&mut self, t_ns: u64) {
        let since = self.cycle.last_edge().or(self.begun).unwrap_or(t_ns);
        let delay = match self.cycle.headless {
            true => LINE_DELAY_MAX_NS,
            false => self.cycle.delay().unwrap_or(0).min(LINE_DELAY_MAX_NS),
        };
        let limit = self.timeout_ns.saturating_add(delay);
        if t_ns.saturating_sub(since) <= limit {
            return;
        }
        match self.state {
            State::Rest => self.rested = true,
            State::Armed | State::Running => self.end(since.saturating_add(limit), Some(!self.ma)),
        }
    }

    fn slo_changes(&mut self, t_ns: u64, level: Option<bool>) {
        self.slo = level;
        if self.state == State::Rest {
            return;
        }
        self.cycle.slo.push((t_ns, level));
        if level == Some(true) && self.slave_let_go(t_ns) {
            let since = self.cycle.last_edge().unwrap_or(t_ns);
            self.cycle.ready_ns = Some(t_ns - since);
            self.end(t_ns, Some(!self.ma));
        }
    }

    /// SL rises although no rising edge is left that could have set it: later than the line delay and a good
    /// quarter of a clock after the last one.
    fn slave_let_go(&self, t_ns: u64) -> bool {
        let [.., before, last] = self.cycle.rises[..] else {
            return false;
        };
        let rest = t_ns - last;
        if rest <= (last - before) / 2 {
            return false;
        }
        let Some(period) = self.cycle.period() else {
            return false;
        };
        let mut delay = self.cycle.delay().unwrap_or(0);
        if self.cycle.headless {
            // Measured from an edge that was hardly the second one of its frame.
            delay = delay.min(4 * period);
        }
        rest > delay + period + period / 4
    }

    fn ma_changes(&mut self, t_ns: u64, ma: bool) {
        self.ma = ma;
        // Nothing has answered yet: a rest of three clocks begins anew, else frames without an encoder would run
        // into one. Unless the Ack of the old one is only late.
        let mut suspect = None;
        if self.state == State::Running && !ma && !self.cycle.acked() {
            let rest = t_ns - self.cycle.rises.last().copied().unwrap_or(t_ns);
            if self.cycle.period().is_some_and(|period| rest > 3 * period) {
                let asked = self.cycle.rises.get(1).or(self.cycle.rises.last());
                suspect = asked
                    .map(|t| (t.saturating_add(LINE_DELAY_MAX_NS), rest))
                    .max(self.cycle.suspect);
                self.end(t_ns, None);
            }
        }
        match (self.state, ma) {
            (State::Rest, false) => {
                self.arm(t_ns);
                self.cycle.suspect = suspect;
            }
            (State::Rest, true) => {}
            (State::Armed | State::Running, false) => self.cycle.falls.push(t_ns),
            (State::Armed | State::Running, true) => {
                self.state = State::Running;
                let full = self.cycle.rises.len() >= MAX_CLOCKS;
                if let [.., before, last] = &mut self.cycle.rises[..] {
                    if full {
                        // Longer than any frame: the last two are kept, and the gap before them is a stall.
                        (*before, *last) = (*last, t_ns);
                        return;
                    }
                }
                self.cycle.rises.push(t_ns);
            }
        }
    }

    fn arm(&mut self, t_ns: u64) {
        self.state = State::Armed;
        self.cycle.idle = self.slo;
        self.cycle.headless = !self.rested;
        self.cycle.slo.push((t_ns, self.slo));
        self.cycle.falls.push(t_ns);
    }

    fn end(&mut self, t_ns: u64, cdm: Option<bool>) {
        let mut edges = std::mem::replace(&mut self.cycle, self.spare.pop().unwrap_or_default());
        edges.end_ns = t_ns;
        edges.cdm = cdm;
        if edges.headless {
            // Only the recording's own beginning tells: MA at rest for longer than a frame may pause, SL high.
            let (first, before) = (edges.falls.first().copied(), edges.idle_since);
            let rest = first.zip(before).map(|(first, before)| first - before);
            let needed = edges
                .period()
                .map(|period| TIMEOUT_MIN_NS.max(period + period / 2));
            let rested = rest.zip(needed).is_some_and(|(rest, needed)| rest > needed);
            edges.headless = edges.idle != Some(true) || !rested;
        }
        let answered = edges.slo.iter().find(|(_, level)| *level == Some(false));
        edges.suspect = edges
            .suspect
            .filter(|(until, _)| answered.is_some_and(|(t, _)| t <= until));
        if !edges.rises.is_empty() {
            self.done.push_back(edges);
        } else {
            edges.clear();
            self.spare.push(edges);
        }
        self.rested = true;
        self.state = State::Rest;
    }
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
    trace.cut = match (edges.headless, edges.tailless) {
        (true, _) => Some(Cut::Begin),
        (false, true) => Some(Cut::End),
        (false, false) => None,
    };
    trace.cdm = edges.cdm;
    trace.ready_ns = edges.ready_ns.and_then(|ns| u32::try_from(ns).ok());
    let (period, delay) = (edges.period(), edges.delay());
    trace.ma_period_ns = period.and_then(|ns| u32::try_from(ns).ok());
    trace.delay_ns = delay.and_then(|ns| u32::try_from(ns).ok());
    measure_levels(edges, trace);
    let period = period.unwrap_or(0);
    // The middle of the bit as it arrives: whole clocks of line delay are taken out too, so that MA may pause
    // while bits are still on their way.
    let delay = delay.unwrap_or(0);
    let nexts = edges
        .rises
        .iter()
        .skip(1)
        .map(|next| Some(*next))
        .chain([None]);
    let mut changes = edges.slo.iter().peekable();
    let mut level = edges.idle;
    for (rise, next) in edges.rises.iter().zip(nexts) {
        // A bit is as long as its clock, which may be shorter than most.
        let bit = next.map_or(period, |next| (next - rise).min(period));
        let at = rise.saturating_add(delay + bit / 2);
        if at > edges.end_ns {
            break;
        }
        while let Some((_, next)) = changes.next_if(|(t, _)| *t <= at) {
            level = *next;
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
    use crate::frame::BissC;
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
            self.slicer.finish(self.t);
            let protocol = BissC::new(format.parse().unwrap());
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

    #[test]
    fn an_absent_encoder_is_no_ack_in_every_cycle() {
        let mut bench = Bench::new("stuck=1,frame=st8,crc6");
        bench.pass(50_000);
        for _ in 0..3 {
            bench.clock(EDGES, 500);
            bench.pass(20_000);
        }
        let all = bench.faults(FORMAT);
        assert_eq!(all.len(), 3);
        assert!(
            all.iter().all(|f| matches!(f, Err(Fault::NoAck { .. }))),
            "{all:?}"
        );
    }
}
