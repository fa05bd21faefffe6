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
