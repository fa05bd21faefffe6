//! What MA and SLO did, change by change: for those who draw or write it.

/// Both wires from `t_ns` on, until the next change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Change {
    /// On the link's clock.
    pub t_ns: u64,
    /// MA.
    pub ma: bool,
    /// SLO; `None` where neither 0 nor 1 was seen.
    pub slo: Option<bool>,
}

/// All changes since the cycle before was over, in order of time: what came between them first, then the cycle.
///
/// Links that see SLO only where they sample it note its changes with the rising edge that set the level and not where they
/// sampled: what is between is not known.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Waveform {
    /// The changes.
    pub changes: Vec<Change>,
    /// Where each bit of the trace was sampled; may be shorter.
    pub samples_ns: Vec<u64>,
}

impl Waveform {
    /// Forgets everything, keeps the memory.
    pub fn clear(&mut self) {
        self.changes.clear();
        self.samples_ns.clear();
    }

    /// Notes both levels, if one is another than before.
    pub fn note(&mut self, t_ns: u64, ma: bool, slo: Option<bool>) {
        let same = |last: &Change| last.ma == ma && last.slo == slo;
        if !self.changes.last().is_some_and(same) {
            self.changes.push(Change { t_ns, ma, slo });
        }
    }
}

/// Both wires, each noted on its own, until a cycle's [`Waveform`] takes them in order of time.
#[derive(Clone, Debug)]
pub struct Log {
    ma: Vec<(u64, bool)>,
    slo: Vec<(u64, Option<bool>)>,
    /// As far as it has been handed over.
    last: Change,
}

impl Log {
    /// Begins with these levels.
    pub fn new(t_ns: u64, ma: bool, slo: Option<bool>) -> Log {
        Log {
            ma: vec![(t_ns, ma)],
            slo: vec![(t_ns, slo)],
            last: Change { t_ns, ma, slo },
        }
    }

    /// MA from `t_ns` on. Times that go backwards are taken for the last one.
    pub fn ma(&mut self, t_ns: u64, level: bool) {
        push(&mut self.ma, self.last.t_ns, t_ns, level);
    }

    /// SLO from `t_ns` on, in the same way.
    pub fn slo(&mut self, t_ns: u64, level: Option<bool>) {
        push(&mut self.slo, self.last.t_ns, t_ns, level);
    }

    /// SLO as it was noted last.
    pub fn slo_now(&self) -> Option<bool> {
        self.slo.last().map_or(self.last.slo, |(_, level)| *level)
    }

    /// Forgets all but the levels as they are.
    pub fn forget(&mut self) {
        if let Some((t_ns, level)) = self.ma.pop() {
            (self.last.t_ns, self.last.ma) = (self.last.t_ns.max(t_ns), level);
        }
        if let Some((t_ns, level)) = self.slo.pop() {
            (self.last.t_ns, self.last.slo) = (self.last.t_ns.max(t_ns), level);
        }
        self.ma.clear();
        self.slo.clear();
    }

    /// Hands everything over. What changes at the same time is one change.
    pub fn pour(&mut self, wave: &mut Waveform) {
        let (mut ma, mut slo) = (self.ma.drain(..).peekable(), self.slo.drain(..).peekable());
        while let Some(t_ns) = [ma.peek().map(|(t, _)| *t), slo.peek().map(|(t, _)| *t)]
            .into_iter()
            .flatten()
            .min()
        {
            self.last.t_ns = t_ns;
            while let Some((_, level)) = ma.next_if(|(t, _)| *t == t_ns) {
                self.last.ma = level;
            }
            while let Some((_, level)) = slo.next_if(|(t, _)| *t == t_ns) {
                self.last.slo = level;
            }
            wave.note(t_ns, self.last.ma, self.last.slo);
        }
    }
}

fn push<T>(changes: &mut Vec<(u64, T)>, poured_ns: u64, t_ns: u64, level: T) {
    let last_ns = changes.last().map_or(poured_ns, |(t, _)| *t);
    changes.push((t_ns.max(last_ns), level));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_wires_become_one_waveform() {
        let mut log = Log::new(5, true, None);
        log.ma(10, false);
        log.slo(12, Some(true));
        log.ma(20, true);
        log.slo(20, Some(false));
        log.slo(18, Some(true));
        let mut wave = Waveform::default();
        log.pour(&mut wave);
        let seen = |wave: &Waveform| -> Vec<_> {
            let changes = wave.changes.iter();
            changes.map(|c| (c.t_ns, c.ma, c.slo)).collect()
        };
        let want = [
            (5, true, None),
            (10, false, None),
            (12, false, Some(true)),
            // The last word of a time counts, and what would go back in time does not.
            (20, true, Some(true)),
        ];
        assert_eq!(seen(&wave), want);
        wave.clear();
        log.ma(1, false);
        log.pour(&mut wave);
        assert_eq!(seen(&wave), [(20, false, Some(true))]);
    }
}
