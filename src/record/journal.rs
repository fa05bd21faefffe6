//! What goes into a recording of a live link, try by try, so that nothing reads as good from it that was not.
//!
//! A file has one time for each edge. A frame that was `stalled` live, because a call may have hidden a pause, could look
//! whole there, and one that was read again for its start bit could teach a reader the wrong one. So their SLO is unknown
//! from where Ack would be, behind the second rising edge, to half of the rest behind them. Where a kind of file has no unknown
//! level, SLO is low there, and so it is in every cycle in which it is unknown anywhere: without a rise there is no start bit.

use super::{Kind, LEAST_SAMPLES, sample};
use crate::cycle::{Cycle, Fault};
use crate::master::{Role, Try};
use crate::unit::Hertz;
use crate::waveform::Change;

/// A part of a recording, in order of time.
#[derive(Clone, Debug)]
pub enum Entry {
    /// A change of a wire.
    Change(Change),
    /// A frame that began then, and what it came to, before its changes.
    Frame(u64, Box<Cycle>),
}

impl Entry {
    /// The change.
    pub fn change(&self) -> Option<&Change> {
        match self {
            Entry::Change(change) => Some(change),
            Entry::Frame(..) => None,
        }
    }

    /// The change.
    pub fn change_mut(&mut self) -> Option<&mut Change> {
        match self {
            Entry::Change(change) => Some(change),
            Entry::Frame(..) => None,
        }
    }
}

/// Takes down every try, and hands on what may be written.
#[derive(Debug)]
pub struct Journal {
    live: bool,
    /// The file has 0 and 1, and nothing else.
    levels_only: bool,
    /// Samples a second, where the file has samples.
    rate: Option<Hertz>,
    entries: Vec<Entry>,
    /// When the recording begins.
    first_ns: Option<u64>,
    /// As it was noted last.
    last: Option<Change>,
    /// SLO of the last cycle is unknown.
    blank: bool,
    scratch: Vec<Change>,
}

impl Journal {
    /// For a file of this kind. What another master has recorded, which is not live, keeps its levels.
    pub fn new(kind: Kind, live: bool) -> Journal {
        Journal {
            live,
            levels_only: kind != Kind::Vcd,
            rate: None,
            entries: Vec::new(),
            first_ns: None,
            last: None,
            blank: false,
            scratch: Vec::new(),
        }
    }

    /// What a file with so many samples a second cannot show is unknown too.
    pub fn sampled(&mut self, rate: Hertz) {
        self.rate = Some(rate);
    }

    /// A try is over. `changes` are those since the one before.
    pub fn tell(&mut self, changes: impl IntoIterator<Item = Change>, tried: &Try) {
        let begun_ns = tried.trace.t_ns;
        let mut all = std::mem::take(&mut self.scratch);
        all.clear();
        all.extend(changes);
        // It begins with a fall of MA. SLO may have been looked at in that very moment.
        let before = |change: &&Change| change.t_ns < begun_ns || change.ma;
        let before = all.iter().take_while(before).count();
        let (between, cycle) = all.split_at_mut(before);
        self.between(between, cycle.first());
        // The encoder is looked at anew, at clocks and places that are not those of its frames: left out, as before the first.
        if tried.role != Role::Learning {
            self.cycle(cycle, tried);
        }
        self.scratch = all;
    }

    /// What came behind the last try.
    pub fn rest(&mut self, changes: impl IntoIterator<Item = Change>) {
        let mut all: Vec<Change> = changes.into_iter().collect();
        self.between(&mut all, None);
    }

    /// Hands over what there is.
    pub fn take(&mut self) -> impl Iterator<Item = Entry> + '_ {
        self.entries.drain(..)
    }

    fn cycle(&mut self, changes: &mut [Change], tried: &Try) {
        self.blank = self.hides(changes, tried);
        if self.blank {
            hide(changes);
        }
        if tried.role == Role::Frame {
            let mut cycle = Box::new(tried.cycle.clone());
            if let Some(doubt) = tried.doubt {
                cycle.spoil(doubt);
            }
            self.entries.push(Entry::Frame(tried.trace.t_ns, cycle));
        }
        self.note(changes);
    }

    /// Whether a reader could take for true what is not known.
    fn hides(&self, changes: &[Change], tried: &Try) -> bool {
        let stalled = matches!(tried.cycle.fault(), Some(Fault::Stalled { .. }));
        let unknown = || changes.iter().any(|change| change.slo.is_none());
        let unproven = stalled || tried.doubt.is_some();
        self.live && unproven || self.levels_only && unknown() || self.loses_edges(changes, tried)
    }

    /// Whether there are too few samples a clock, or MA has a level between two of them.
    fn loses_edges(&self, changes: &[Change], tried: &Try) -> bool {
        let (Some(rate), Some(first_ns)) = (self.rate, self.first_ns) else {
            return false;
        };
        let period_ns = tried.trace.ma_period_ns.unwrap_or(u32::MAX);
        if u64::from(period_ns) * u64::from(rate.0) < u64::from(LEAST_SAMPLES) * 999_000_000 {
            return true;
        }
        let sample = |change: &Change| sample(rate, change.t_ns.saturating_sub(first_ns));
        let edges = changes.windows(2).filter(|pair| pair[0].ma != pair[1].ma);
        let mut last = changes.first().map(sample);
        edges.map(|pair| sample(&pair[1])).any(|edge| {
            let lost = last == Some(edge);
            last = Some(edge);
            lost
        })
    }

    /// SLO stays unknown for half of the rest; then it is what the next cycle found. When it became that nobody knows.
    fn between(&mut self, changes: &mut [Change], next: Option<&Change>) {
        let found = next.or(changes.last()).copied();
        let (true, Some(last), Some(found)) = (self.blank, self.last, found) else {
            return self.note(changes);
        };
        self.blank = false;
        let middle_ns = last.t_ns.midpoint(found.t_ns);
        let early = changes.partition_point(|change| change.t_ns <= middle_ns);
        let (early, late) = changes.split_at_mut(early);
        early.iter_mut().for_each(|change| change.slo = None);
        late.iter_mut().for_each(|change| change.slo = found.slo);
        self.note(early);
        self.note(&[Change {
            t_ns: middle_ns,
            ma: early.last().map_or(last.ma, |change| change.ma),
            slo: found.slo,
        }]);
        self.note(late);
    }

    fn note(&mut self, changes: &[Change]) {
        for change in changes {
            let same = |last: &Change| last.ma == change.ma && last.slo == change.slo;
            if !self.last.as_ref().is_some_and(same) {
                self.entries.push(Entry::Change(*change));
                self.first_ns.get_or_insert(change.t_ns);
                self.last = Some(*change);
            }
        }
    }
}

/// Leaves SLO as it was before up to the fall behind the second rising edge, and unknown from there on.
fn hide(changes: &mut [Change]) {
    let idle = changes.first().and_then(|first| first.slo);
    let (mut ma, mut rises, mut hidden) = (false, 0, false);
    for change in changes {
        rises += u32::from(change.ma && !ma);
        ma = change.ma;
        hidden |= rises >= 2 && !ma;
        change.slo = idle.filter(|_| !hidden);
    }
}
