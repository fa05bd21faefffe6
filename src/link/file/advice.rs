//! What may be wrong with how a recording is read, out of the recording itself.

use super::behaviour;
use super::source::{Channel, Damage, Source};
use crate::slice::Slicer;
use crate::trace::Trace;
use crate::waveform::Change;

/// No encoder is clocked faster, nor more slowly.
const FASTEST_NS: u64 = 50;
const SLOWEST_NS: u64 = 100_000;

/// So many clocks tell of their length.
const LEAST_CLOCKS: usize = 8;

/// MA's clock, over all cycles.
#[derive(Debug, Default)]
pub(super) struct Clocks {
    range: Option<(u64, u64)>,
}

impl Clocks {
    #[inline]
    pub(super) fn note(&mut self, trace: &Trace) {
        if let Some(ns) = trace.ma_period_ns.map(u64::from) {
            let (least, most) = self.range.unwrap_or((ns, ns));
            self.range = Some((least.min(ns), most.max(ns)));
        }
    }

    /// What MA's clock is, if no encoder bears it: in all cycles, or where there is none at all, by the first `changes`.
    fn implausible(&self, changes: &[Change]) -> Option<u64> {
        let (least, most) = self.range.or_else(|| {
            let ns = usual_clock(changes)?;
            Some((ns, ns))
        })?;
        (most < FASTEST_NS || least > SLOWEST_NS).then_some(least)
    }
}

/// The median from one rise of MA to the next.
fn usual_clock(changes: &[Change]) -> Option<u64> {
    let pairs = changes.windows(2);
    let rises = pairs.filter(|pair| !pair[0].ma && pair[1].ma);
    let rises: Vec<u64> = rises.map(|pair| pair[1].t_ns).collect();
    let mut spans: Vec<u64> = rises.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if spans.len() < LEAST_CLOCKS {
        return None;
    }
    let middle = spans.len() / 2;
    Some(*spans.select_nth_unstable(middle).1)
}

/// One line, where something is plain. `swapped` asks whether the wires may be, as no frame is good. `rated` says that the rate
/// was asked for.
pub(super) fn advice(
    clocks: &Clocks,
    changes: &[Change],
    timeout_ns: u64,
    rated: bool,
    swapped: bool,
) -> Option<String> {
    if let Some(ns) = clocks.implausible(changes) {
        let hz = 1_000_000_000 / ns.max(1);
        let clock = match hz {
            1_000_000.. => format!("{:.1} MHz", hz as f64 / 1e6),
            _ => format!("{:.2} kHz", hz as f64 / 1e3),
        };
        let what = if rated { "rate=" } else { "its time scale" };
        return Some(format!(
            "MA runs at {clock}, and BiSS-C at 80 kHz to 10 MHz: is {what} right?"
        ));
    }
    let behaves = |crossed| {
        let mut replay = Replay { changes, crossed };
        behaviour::behaves(&mut replay, timeout_ns)
    };
    (swapped && !behaves(false) && behaves(true)).then(|| {
        "what is read as SLO behaves like MA, and MA like SLO: swap ma= and slo=".to_owned()
    })
}

/// Changes as a recording, MA and SLO crossed if need be.
struct Replay<'a> {
    changes: &'a [Change],
    crossed: bool,
}

impl Source for Replay<'_> {
    fn channels(&self) -> &[Channel] {
        &[]
    }

    fn select(&mut self, _: usize, _: usize) {}

    fn read(&mut self, slicer: &mut Slicer) -> Result<bool, Damage> {
        for change in self.changes {
            match (self.crossed, change.slo) {
                (false, _) => slicer.push(change.t_ns, change.ma, change.slo),
                (true, Some(slo)) => slicer.push(change.t_ns, slo, Some(change.ma)),
                (true, None) => slicer.gap(change.t_ns),
            }
        }
        Ok(false)
    }

    fn now_ns(&self) -> u64 {
        self.changes.last().map_or(0, |change| change.t_ns)
    }
}
