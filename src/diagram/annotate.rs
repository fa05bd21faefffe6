//! What each stretch of a cycle means: from its trace, what it was decoded to, and the format.

use super::{Axis, Cell, Diagram, Lane, Span, Step, Tone, frequency, time};
use crate::cycle::{Cycle, Fault, Word};
use crate::format::{Channel, Field, Format, Kind};
use crate::trace::{Cut, MAX_CLOCKS, Trace};
use crate::waveform::Change;

/// What is drawn of the rest before a cycle, and behind its end, in halves of a clock.
const MARGIN_HALVES: u64 = 3;

/// So many changes between two cycles belong to the end of the first one; the others are noise.
const MOST_BEHIND: usize = 64;

/// Of clocks in which nothing happens so many are drawn at each end ...
const DULL_ENDS: usize = 4;
/// ... if there are more than this.
const DULL_CLOCKS: usize = 14;

pub(super) fn diagram(
    trace: &Trace,
    cycle: &Cycle,
    format: Option<&Format>,
    behind: &[Change],
) -> Option<Diagram> {
    let wires = Wires::of(trace, cycle, behind)?;
    let cells = wires.cells(trace, cycle);
    let mut notes = Notes {
        trace,
        cycle,
        wires: &wires,
        cells: &cells,
        spans: Vec::new(),
        facts: Vec::new(),
        stalled: None,
    };
    notes.clock();
    notes.stall();
    let data = notes.frame(format);
    notes.delay();
    notes.timeout();
    notes.faults(format);
    let Notes {
        spans,
        facts,
        stalled,
        ..
    } = notes;
    let dull = dull(&wires, &spans, data);
    let mut times = vec![wires.begin_ns, wires.end_ns];
    times.extend(wires.ma.iter().map(|step| step.t_ns));
    times.extend(wires.slo.iter().map(|step| step.t_ns));
    times.extend(cells.iter().flat_map(|cell| [cell.from_ns, cell.until_ns]));
    times.extend(spans.iter().flat_map(|span| [span.from_ns, span.until_ns]));
    times.retain(|t_ns| (wires.begin_ns..=wires.end_ns).contains(t_ns));
    times.sort_unstable();
    let axis = Axis::new(&times, &dull, wires.period_ns);
    let word_fault = || cycle.words().iter().find_map(|word| word.fault());
    Some(Diagram {
        axis,
        cells,
        spans,
        stalled,
        facts,
        fault: cycle.fault().or_else(word_fault),
        end_ns: wires.end_ns,
        ma: wires.ma,
        slo: wires.slo,
        edges: wires.edges,
    })
}

/// Both wires, as far as they are drawn.
struct Wires {
    ma: Vec<Step<bool>>,
    slo: Vec<Step<Option<bool>>>,
    begin_ns: u64,
    end_ns: u64,
    period_ns: u64,
    /// The rising edges that count.
    edges: Vec<u64>,
    /// The last change of MA before SL may be 1 again.
    last_edge_ns: u64,
    /// Where the next cycle begins, if that is known.
    over_ns: u64,
    /// From an edge to the bit that it sets, as far as the waveform shows it.
    delay_ns: u64,
}

/// From the second rising edge to SL falling, by the waveform alone: for links that see every change, and measure none.
pub(super) fn line_delay(trace: &Trace, cycle: &Cycle) -> Option<u64> {
    let wave = trace.wave.as_ref()?;
    let second = *rises(&wave.changes, trace.t_ns).get(1)?;
    let sampled = wave
        .samples_ns
        .get(1 + usize::from(cycle.head()?.delay_clk))?;
    let mut level = None;
    let falls = wave.changes.iter().filter(|change| {
        let fell = change.slo == Some(false) && level != change.slo;
        level = change.slo;
        fell
    });
    let seen = falls
        .map(|change| change.t_ns)
        .filter(|t_ns| (second..=*sampled).contains(t_ns));
    seen.last().map(|fall| fall - second)
}

impl Wires {
    fn of(trace: &Trace, cycle: &Cycle, behind: &[Change]) -> Option<Wires> {
        let own = &trace.wave.as_ref()?.changes;
        let over_ns = own.last().map_or(0, |last| last.t_ns);
        let later = behind.iter().filter(|change| change.t_ns >= over_ns);
        let mut all: Vec<Change> = own.iter().chain(later.take(MOST_BEHIND)).copied().collect();
        if own.is_empty() {
            // Nothing has changed.
            let rest = Change {
                t_ns: trace.t_ns,
                ma: true,
                slo: trace.idle,
            };
            all.insert(0, rest);
        }
        let first = *all.first()?;
        let mut edges = rises(own, trace.t_ns);
        let released = edges.last().copied().filter(|_| {
            // MA let go after CDM = 1: that edge does not count (D2, p. 15).
            trace.cdm == Some(true) && own.last().is_some_and(|last| last.ma)
        });
        if released.is_some() {
            edges.pop();
        }
        edges.truncate(MAX_CLOCKS);
        let period_ns = match trace.ma_period_ns {
            Some(period) if period > 0 => period.into(),
            _ => median_period(&edges),
        };
        let margin = period_ns * MARGIN_HALVES / 2;
        let clocks = cycle.head().map_or(0, |head| u64::from(head.delay_clk));
        let delay = trace
            .delay_ns
            .map(u64::from)
            .or_else(|| line_delay(trace, cycle));
        let delay_ns = delay.unwrap_or(clocks * period_ns);
        let late = delay_ns.saturating_sub(clocks * period_ns);
        let full = (edges.len() == MAX_CLOCKS)
            .then(|| edges.last().copied())
            .flatten();
        // What the next cycle begins with is none of this one's.
        let next = moves(&all).find(|step| step.t_ns > over_ns && !step.level);
        let over_ns = next
            .map_or(u64::MAX, |next| next.t_ns)
            .min(full.unwrap_or(u64::MAX));
        let mut slo = None;
        let last_ns = all.iter().filter(|change| {
            // SL = 1 may be what the next cycle began with.
            let moved = std::mem::replace(&mut slo, change.slo) != change.slo;
            change.t_ns < over_ns || change.t_ns == over_ns && moved
        });
        let last_ns = last_ns.last().map(|change| change.t_ns);
        let bits = edges.get(..trace.bits.len()).unwrap_or(&edges);
        let bits_end = bits.last().map_or(0, |edge| edge + late + period_ns);
        let waited = trace.waited_ns.filter(|_| edges.is_empty()).unwrap_or(0);
        let mut begin_ns = trace.t_ns.saturating_sub(margin);
        if trace.cut == Some(Cut::Begin) {
            begin_ns = begin_ns.max(first.t_ns);
        }
        let last_ns = last_ns?.max(trace.t_ns + waited);
        let end_ns = last_ns.max(bits_end.saturating_sub(margin)) + margin;
        let last_edge_ns = moves(own)
            .map(|step| step.t_ns)
            .filter(|t_ns| released.is_none_or(|released| *t_ns < released))
            .last()
            .unwrap_or(begin_ns);
        let drawn = |t_ns: u64| t_ns > begin_ns && t_ns <= end_ns;
        let at_begin = all.iter().rfind(|change| change.t_ns <= begin_ns);
        let idle = trace.idle.or(first.slo);
        let mut ma = vec![Step {
            t_ns: begin_ns,
            level: at_begin.is_none_or(|change| change.ma),
        }];
        let mut slo = vec![Step {
            t_ns: begin_ns,
            level: at_begin.map_or(idle, |change| change.slo),
        }];
        for change in all.iter().filter(|change| drawn(change.t_ns)) {
            note(&mut ma, change.t_ns, change.ma);
            note(&mut slo, change.t_ns, change.slo);
        }
        Some(Wires {
            ma,
            slo,
            begin_ns,
            end_ns,
            period_ns,
            edges,
            last_edge_ns,
            delay_ns,
            over_ns,
        })
    }

    fn cells(&self, trace: &Trace, cycle: &Cycle) -> Vec<Cell> {
        // A link that samples with its clock sees a bit so many clocks after the edge that set it.
        let shift = cycle.head().map_or(0, |head| usize::from(head.delay_clk));
        let late = self.delay_ns.saturating_sub(shift as u64 * self.period_ns);
        let from = |index: usize| match index.checked_sub(shift).filter(|at| shift == 0 || *at > 0)
        {
            Some(at) => self.edges.get(at).map(|edge| edge + self.delay_ns),
            None => self
                .edges
                .get(index)
                .map(|edge| edge + late.min(self.period_ns)),
        };
        let samples = trace.wave.as_ref().map_or(&[][..], |wave| &wave.samples_ns);
        let bits = trace.bits.iter().take(self.edges.len()).enumerate();
        let cell = |(index, level): (usize, bool)| {
            let from_ns = from(index).unwrap_or(self.end_ns);
            let next = from(index + 1).unwrap_or(from_ns + self.period_ns);
            let number = (index + 1).checked_sub(shift);
            Cell {
                from_ns,
                until_ns: next.max(from_ns),
                sample_ns: samples.get(index).copied(),
                level,
                edge: number
                    .filter(|number| *number > usize::from(shift > 0))
                    .map(|n| n as u16),
            }
        };
        bits.map(cell).collect()
    }
}

fn note<L: PartialEq>(steps: &mut Vec<Step<L>>, t_ns: u64, level: L) {
    if steps.last().is_some_and(|last| last.level != level) {
        steps.push(Step { t_ns, level });
    }
}

/// The changes of MA, which is high before the first one.
fn moves(changes: &[Change]) -> impl Iterator<Item = Step<bool>> {
    let mut level = true;
    changes.iter().filter_map(move |change| {
        let moved = std::mem::replace(&mut level, change.ma) != change.ma;
        moved.then_some(Step {
            t_ns: change.t_ns,
            level: change.ma,
        })
    })
}

fn rises(changes: &[Change], from_ns: u64) -> Vec<u64> {
    let cycle = moves(changes).skip_while(|step| step.t_ns < from_ns);
    let rises = cycle.filter(|step| step.level).map(|step| step.t_ns);
    rises.collect()
}

fn median_period(edges: &[u64]) -> u64 {
    let mut spans: Vec<u64> = edges.windows(2).map(|pair| pair[1] - pair[0]).collect();
    spans.sort_unstable();
    spans.get(spans.len() / 2).copied().unwrap_or(1_000).max(1)
}

/// Stretches of clocks in which nothing happens, neither on SLO nor in the data.
fn dull(wires: &Wires, spans: &[Span], data: Option<(u64, u64)>) -> Vec<(u64, u64)> {
    let mut news: Vec<u64> = vec![wires.begin_ns, wires.end_ns];
    news.extend(wires.slo.iter().map(|step| step.t_ns));
    let parts = spans.iter().filter(|span| span.lane != Lane::Between);
    news.extend(parts.flat_map(|span| [span.from_ns, span.until_ns]));
    news.sort_unstable();
    let quiet = news.windows(2).filter_map(|pair| {
        let (from, until) = (pair[0], pair[1]);
        if data.is_some_and(|(first, end)| from >= first && until <= end) {
            return None;
        }
        let first = wires.edges.partition_point(|edge| *edge < from);
        let end = wires.edges.partition_point(|edge| *edge <= until);
        let inside = wires.edges.get(first..end)?;
        if inside.len() <= DULL_CLOCKS {
            return None;
        }
        let cut = (inside[DULL_ENDS], inside[inside.len() - 1 - DULL_ENDS]);
        // A pause in it is news.
        let even = inside
            .windows(2)
            .all(|pair| pair[1] - pair[0] < 2 * wires.period_ns);
        even.then_some(cut)
    });
    quiet.collect()
}

struct Notes<'a> {
    trace: &'a Trace,
    cycle: &'a Cycle,
    wires: &'a Wires,
    cells: &'a [Cell],
    spans: Vec<Span>,
    facts: Vec<String>,
    stalled: Option<(u64, u64)>,
}

fn several(n: usize, what: &str) -> String {
    match n {
        1 => format!("1 {what}"),
        _ => format!("{n} {what}s"),
    }
}

/// A field as formats spell it: `st26`, `nE`.
fn spelled(field: &Field) -> String {
    let width = field.bits();
    match field.kind() {
        Kind::Turn => format!("mt{width}"),
        Kind::SingleTurn => format!("st{width}"),
        Kind::Position => format!("pos{width}"),
        Kind::Padding => format!("pad{width}"),
        Kind::Life => format!("lc{width}"),
        Kind::Data(name) if name == "data" => format!("data{width}"),
        Kind::Data(name) => format!("data{width}={name}"),
        Kind::Error { active_low: true } => "nE".into(),
        Kind::Error { .. } => "E".into(),
        Kind::Warning { active_low: true } => "nW".into(),
        Kind::Warning { .. } => "W".into(),
    }
}

impl Notes<'_> {
    fn push(&mut self, span: Span) {
        self.spans.push(span);
    }

    /// Below SLO, from one bit to before another.
    fn part(&self, at: usize, bits: usize, name: impl Into<String>) -> Option<Span> {
        let cells = self.cells.get(at..(at + bits).min(self.cells.len()))?;
        let (first, last) = cells.first().zip(cells.last())?;
        Some(Span::new(Lane::Field, first.from_ns, last.until_ns, name))
    }

    fn clock(&mut self) {
        let Some(period_ns) = self.trace.ma_period_ns.filter(|ns| *ns > 0) else {
            return;
        };
        let (length, clock) = (time(period_ns.into()), frequency(period_ns));
        self.facts.push(format!("MA {clock}"));
        let usual = |pair: &&[u64]| {
            (pair[1] - pair[0]).abs_diff(period_ns.into()) <= u64::from(period_ns / 8)
        };
        let edges = self.wires.edges.get(2..).unwrap_or_default();
        if let Some(pair) = edges.windows(2).find(usual) {
            let span = Span::new(Lane::Above, pair[0], pair[1], format!("T = {length}"));
            let span = span
                .value(format!(" ({clock})"))
                .or(format!("T = {length}"));
            self.push(span.tone(Tone::Faint));
        }
    }

    /// The level of MA that was too long, by the edge that ended it.
    fn stall(&mut self) {
        let Some(Fault::Stalled {
            level_ns,
            limit_ns,
            edge,
        }) = self.cycle.fault()
        else {
            return;
        };
        let edges = &self.wires.edges;
        let at = usize::from(edge);
        let Some(until) = edges.get(at.saturating_sub(1)).copied() else {
            return;
        };
        let from = match at {
            0 | 1 => self.wires.begin_ns.max(self.trace.t_ns.min(until)),
            _ => edges[at - 2],
        };
        // The part of that clock which is as long as what was found.
        let fall = self
            .wires
            .ma
            .iter()
            .rfind(|step| !step.level && step.t_ns < until);
        let fall = fall.map_or(from, |step| step.t_ns).max(from);
        let parts = [(fall, until), (from, fall), (from, until)];
        let best = parts
            .into_iter()
            .min_by_key(|(from, until)| (until - from).abs_diff(level_ns.into()));
        let (from, until) = best.unwrap_or((from, until));
        self.stalled = Some((from, until));
        let length = time(level_ns.into());
        let span = Span::new(Lane::Between, from, until, format!("up to {length}"))
            .value(format!(", limit {}", time(limit_ns.into())))
            .or(format!("up to {length}"))
            .or(length);
        self.push(span.tone(Tone::Bad));
    }

    /// Where Ack and the start bit are, and whether what follows can be told apart.
    fn head(&self) -> Option<(usize, Option<usize>)> {
        if let Some(head) = self.cycle.head() {
            let ack = 1 + usize::from(head.delay_clk);
            return Some((ack, Some(ack + usize::from(head.ack))));
        }
        let searched = matches!(
            self.cycle.fault(),
            Some(Fault::Short { .. } | Fault::Stalled { .. } | Fault::NoStart { .. })
        );
        if !searched || self.trace.cut == Some(Cut::Begin) || self.trace.misplaced_ns.is_some() {
            return None;
        }
        let bits = &self.trace.bits;
        let ack = bits.find(1, false)?;
        let start = bits.find(ack, true);
        Some((
            ack,
            start.filter(|_| !matches!(self.cycle.fault(), Some(Fault::NoStart { .. }))),
        ))
    }

    /// The parts of the frame. Where the data is.
    fn frame(&mut self, format: Option<&Format>) -> Option<(u64, u64)> {
        let (ack, start) = self.head()?;
        let near = self.cells.first().zip(self.wires.edges.first());
        let near =
            near.is_some_and(|(cell, edge)| cell.from_ns - edge < self.wires.period_ns * 3 / 4);
        if near && ack == 1 {
            let span = self.part(0, 1, "LAT");
            self.spans.extend(span.map(|span| span.tone(Tone::Faint)));
        } else if let [first, second, ..] = self.wires.edges[..] {
            self.push(Span::new(Lane::Above, first, second, "LAT").tone(Tone::Faint));
        }
        let clocks = start.unwrap_or(self.cells.len()).saturating_sub(ack);
        let mut span = self.part(ack, clocks, "Ack")?;
        if clocks > 1 {
            let width = time(span.until_ns - span.from_ns);
            span = span
                .value(format!(" {}, {width}", several(clocks, "clock")))
                .or(format!("Ack {}", several(clocks, "clock")));
        }
        self.push(span.or("Ack"));
        self.facts.push(format!("Ack {}", several(clocks, "clock")));
        let start = start?;
        let span = self.part(start, 1, "start");
        self.spans.extend(span);
        let cds = self.cells.get(start + 1)?.level;
        let span = self.part(start + 1, 1, "CDS");
        let span = span.map(|span| span.value(format!(" = {}", u8::from(cds))).or("CDS"));
        self.spans.extend(span);
        self.facts.push(format!("CDS {}", u8::from(cds)));
        let at = start + 2;
        let end = match format {
            Some(format) => self.channels(format, at),
            None => self.raw(at),
        };
        self.cut_at_stall();
        let first = self.cells.get(at)?.from_ns;
        let last = self.cells.get(end.min(self.cells.len()).checked_sub(1)?)?;
        Some((first, last.until_ns))
    }

    /// Bits that nobody has explained.
    fn raw(&mut self, at: usize) -> usize {
        let bits = self.cells.len().saturating_sub(at);
        let name = format!("{}, format not known", several(bits, "bit"));
        if let Some(span) = self.part(at, bits, name) {
            self.push(span.or(several(bits, "bit")));
        }
        self.cells.len()
    }

    /// All channels, then the stop bit and what was clocked behind it.
    fn channels(&mut self, format: &Format, mut at: usize) -> usize {
        let many = format.channels().len() > 1;
        for (index, channel) in format.channels().iter().enumerate() {
            let word = self.cycle.words().get(index).copied();
            let bits = usize::from(channel.data_bits() + channel.crc_bits());
            let span = self.part(at, bits, format!("channel {index}"));
            if let Some(span) = span.filter(|_| many) {
                let span = span
                    .value(format!(": {channel}"))
                    .or(format!("channel {index}"));
                self.push(Span {
                    lane: Lane::Channel,
                    ..span
                });
            }
            at = self.channel(channel, word, at);
        }
        let end = at;
        let high = matches!(self.cycle.fault(), Some(Fault::Stop { clock }) if usize::from(clock) == at + 1);
        let tone = if high { Tone::Bad } else { Tone::Plain };
        let span = self.part(at, 1, "stop");
        self.spans.extend(span.map(|span| span.tone(tone)));
        let surplus = self.cells.len().saturating_sub(at + 1);
        if let Some(span) = self.part(at + 1, surplus, "surplus") {
            let whole = span.value(format!(" {}", several(surplus, "clock")));
            self.push(whole.or("surplus").or("").tone(Tone::Faint));
        }
        end
    }

    fn channel(&mut self, channel: &Channel, word: Option<Word>, mut at: usize) -> usize {
        let whole = at + usize::from(channel.data_bits() + channel.crc_bits()) <= self.cells.len();
        let known = whole && !self.trace.unconfirmed;
        let good = word.and_then(|word| word.good()).filter(|_| known);
        for field in channel.fields() {
            let bits = usize::from(field.bits());
            if let Some(span) = self.part(at, bits, spelled(field)) {
                self.push(match good {
                    Some(data) => with_value(span, field, field.get(data)),
                    None => span,
                });
            }
            at += bits;
        }
        let crc_bits = usize::from(channel.crc_bits());
        if let Some(span) = self.part(at, crc_bits, format!("crc{crc_bits}")) {
            let digits = crc_bits.div_ceil(4).max(2) + 2;
            let name = span.name.clone();
            self.push(match word.map(|word| (word.fault(), word.raw().1)) {
                Some((Some(Fault::Crc { got, want }), _)) => span
                    .value(format!(" = {got:#0digits$x}, want {want:#0digits$x}"))
                    .tone(Tone::Bad),
                Some((_, crc)) => span
                    .value(format!(" = {crc:#0digits$x}: good"))
                    .or(format!("{name} = {crc:#0digits$x}"))
                    .tone(Tone::Good),
                None => span,
            });
        }
        at + crc_bits
    }

    /// What comes behind a pause that is too long may belong to another frame.
    fn cut_at_stall(&mut self) {
        let Some((stall_ns, _)) = self.stalled else {
            return;
        };
        let part = |span: &Span| [Lane::Field, Lane::Channel].contains(&span.lane);
        self.spans
            .retain(|span| !part(span) || span.from_ns < stall_ns);
        for span in self.spans.iter_mut().filter(|span| part(span)) {
            span.until_ns = span.until_ns.min(stall_ns).max(span.from_ns);
        }
    }

    fn delay(&mut self) {
        let Some(second) = self.wires.edges.get(1).copied() else {
            return;
        };
        let clocks = self.cycle.head().map(|head| head.delay_clk);
        let (until, length) = match (self.trace.delay_ns, clocks) {
            (Some(ns), _) => (second + u64::from(ns), time(ns.into())),
            (None, Some(0)) => {
                self.facts.push("line delay below 1 clock".into());
                return;
            }
            (None, Some(clocks)) => {
                let Some(cell) = self.cells.get(1 + usize::from(clocks)) else {
                    return;
                };
                (cell.from_ns, format!("{clocks} to {} clocks", clocks + 1))
            }
            (None, None) => return,
        };
        self.facts.push(format!("line delay {length}"));
        let span = Span::new(Lane::Between, second, until, "line delay");
        self.push(span.value(format!(" {length}")).or(length));
    }

    /// From MA's last edge to SL = 1, and what MA says meanwhile.
    fn timeout(&mut self) {
        let last = self.wires.last_edge_ns;
        let bits_end = self.cells.last().map_or(0, |cell| cell.until_ns);
        let own = self
            .wires
            .slo
            .iter()
            .take_while(|step| step.t_ns <= self.wires.over_ns);
        let high = |step: &&Step<Option<bool>>| step.level == Some(true) && step.t_ns > last;
        let rise = own.last().filter(high).map(|step| step.t_ns);
        let ready = self.trace.ready_ns.map(|ns| last + u64::from(ns));
        let ready = ready
            .filter(|ready| Some(*ready) == rise)
            .or(rise.filter(|rise| *rise + self.wires.period_ns / 4 >= bits_end));
        if let Some(ready) = ready {
            // The slave saw that edge, and the master sees SL = 1, a line delay later in all.
            let seen = ready - last;
            let delay = self.trace.delay_ns.map_or(0, u64::from).min(seen);
            let length = time(seen - delay);
            self.facts.push(format!("timeout {length}"));
            let span = Span::new(Lane::Between, last, ready, "timeout");
            self.push(match delay {
                0 => span.value(format!(" {length}")).or(length),
                _ => span
                    .value(format!(" {length} + line delay"))
                    .or(format!("timeout {length} + delay")),
            });
        }
        if let Some(cdm) = self.trace.cdm {
            self.facts.push(format!("CDM {}", u8::from(cdm)));
            let until = ready.unwrap_or(self.wires.end_ns);
            if until > last {
                let span = Span::new(Lane::Above, last, until, "CDM");
                self.push(span.value(format!(" = {}", u8::from(cdm))).or("CDM"));
            }
        }
    }

    /// What is wrong, where it is.
    fn faults(&mut self, format: Option<&Format>) {
        if let Some(fault) = self.cycle.fault() {
            let (from, until) = self.place(fault);
            self.push(Span::new(Lane::Fault, from, until, fault.to_string()).tone(Tone::Bad));
        }
        let channels = format.map_or(&[][..], Format::channels);
        let mut at = self
            .head()
            .and_then(|(_, start)| start)
            .map_or(0, |start| start + 2);
        for (index, (channel, word)) in channels.iter().zip(self.cycle.words()).enumerate() {
            if let Some(fault) = word.fault() {
                let (offset, bits) = within(channel, fault);
                let text = match channels.len() {
                    1 => fault.to_string(),
                    _ => format!("channel {index}: {fault}"),
                };
                if let Some(span) = self.part(at + offset, bits, text) {
                    self.push(Span {
                        lane: Lane::Fault,
                        ..span.tone(Tone::Bad)
                    });
                }
            }
            at += usize::from(channel.data_bits() + channel.crc_bits());
        }
    }

    fn place(&self, fault: Fault) -> (u64, u64) {
        let all = (self.wires.begin_ns, self.wires.end_ns);
        let cell = |at: usize| {
            let cell = self.cells.get(at.min(self.cells.len().saturating_sub(1)));
            cell.map_or(all, |cell| (cell.from_ns, cell.until_ns))
        };
        let last = self.cells.last().map_or(all.1, |cell| cell.until_ns);
        match fault {
            Fault::NotReady { .. } => (all.0, cell(0).1),
            Fault::NoAck { .. } => (cell(1).0, last),
            Fault::NoStart { .. } => {
                let ack = self.head().map_or(1, |(ack, _)| ack);
                (cell(ack).0, last)
            }
            Fault::Short { .. } if self.trace.cut == Some(Cut::Begin) => (all.0, cell(0).1),
            Fault::Short { .. } => (
                last,
                last.max(self.wires.end_ns.min(last + self.wires.period_ns)),
            ),
            Fault::Stop { clock } => cell(usize::from(clock).saturating_sub(1)),
            Fault::Stalled { .. } => self.stalled.unwrap_or(cell(0)),
            Fault::Mismatch { head, .. } => (cell(1).0, cell(1 + usize::from(head)).1),
            Fault::Delay { ns, .. } => {
                let second = self.wires.edges.get(1).copied().unwrap_or(all.0);
                (second, second + u64::from(ns))
            }
            Fault::Crc { .. } | Fault::Null | Fault::Life { .. } | Fault::Pair { .. } => all,
        }
    }
}

/// Which bits of a channel a fault is about: how far from its first one, and how many.
fn within(channel: &Channel, fault: Fault) -> (usize, usize) {
    let data = usize::from(channel.data_bits());
    let field = |want: fn(&Kind) -> bool| {
        let mut at = 0;
        for field in channel.fields() {
            if want(field.kind()) {
                return (at, usize::from(field.bits()));
            }
            at += usize::from(field.bits());
        }
        (0, data)
    };
    match fault {
        Fault::Crc { .. } => (data, usize::from(channel.crc_bits())),
        Fault::Life { .. } => field(|kind| *kind == Kind::Life),
        Fault::Pair { .. } => field(|kind| matches!(kind, Kind::SingleTurn | Kind::Position)),
        _ => (0, data),
    }
}

fn with_value(span: Span, field: &Field, value: u64) -> Span {
    let name = span.name.clone();
    let (active_low, trouble, tone) = match field.kind() {
        Kind::Padding => return span.tone(Tone::Faint),
        Kind::Error { active_low } => (active_low, "error", Tone::Bad),
        Kind::Warning { active_low } => (active_low, "warning", Tone::Warning),
        _ => return span.value(format!(" = {value}")),
    };
    let active = (value == 1) != *active_low;
    let said = match active {
        true => trouble.to_owned(),
        false => format!("no {trouble}"),
    };
    let span = span.value(format!(" = {value}: {said}"));
    let span = span.or(format!("{name} = {value}")).or(name);
    span.tone(if active { tone } else { Tone::Good })
}
