//! MA laid on a grid of samples, as a shift register sends it, and the levels that came back sampled on the same grid.
//!
//! Every edge of MA stands where it was planned, so nothing has to be found but the line delay: the Ack tells it, in
//! every frame anew (D2, p. 8). All bits are then sampled relative to that Ack.

use crate::trace::Trace;

/// Fewest samples a clock. Ack is seen up to one sample late, and a bit may come a quarter of a clock earlier or later than
/// that (D2 Table 10): with four samples a clock the one two after a bit's own place still lies within it.
pub const LEAST_SAMPLES: u32 = 4;

/// Fewest samples a clock where they are no whole number: a clock may then last one sample less than it should.
pub const LEAST_SAMPLES_BROKEN: u32 = 5;

/// How clocks lie on samples: so many samples for so many clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    samples: u64,
    clocks: u64,
    /// Samples a second.
    rate_hz: u64,
}

impl Grid {
    /// `samples` of `rate_hz` for each clock.
    pub fn whole(samples: u32, rate_hz: u32) -> Grid {
        Grid {
            samples: samples.max(1).into(),
            clocks: 1,
            rate_hz: rate_hz.max(1).into(),
        }
    }

    /// MA of `ma_hz` on samples of `rate_hz`, which need not be a multiple of it: each edge stands less than one sample
    /// before its place (a phase accumulator).
    pub fn broken(ma_hz: u32, rate_hz: u32) -> Grid {
        Grid {
            samples: rate_hz.max(1).into(),
            clocks: ma_hz.max(1).into(),
            rate_hz: rate_hz.max(1).into(),
        }
    }

    /// Where half clock number `half` begins, in samples.
    fn half(&self, half: usize) -> usize {
        (half as u64 * self.samples / (2 * self.clocks)) as usize
    }

    /// Samples of a clock, of the shortest one where they differ.
    fn period(&self) -> usize {
        (self.samples / self.clocks) as usize
    }

    /// Whether all clocks are alike.
    pub fn is_whole(&self) -> bool {
        self.samples % self.clocks == 0
    }

    /// Samples a clock.
    pub fn samples_per_clock(&self) -> f64 {
        self.samples as f64 / self.clocks as f64
    }

    /// The length of so many samples.
    pub fn ns(&self, samples: usize) -> u64 {
        samples as u64 * 1_000_000_000 / self.rate_hz
    }

    /// Samples that last at least so long.
    pub fn samples(&self, ns: u64) -> usize {
        (ns * self.rate_hz).div_ceil(1_000_000_000) as usize
    }

    /// MA's period.
    pub fn period_ns(&self) -> u64 {
        self.samples * 1_000_000_000 / (self.clocks * self.rate_hz)
    }

    /// By how much an edge may stand before its place; 0 where all clocks are alike.
    pub fn jitter_ns(&self) -> u64 {
        if self.is_whole() { 0 } else { self.ns(1) }
    }
}

/// What a cycle needs beside its clocks, in samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Rising edges.
    pub clocks: u16,
    /// MA high before the first falling edge, at least.
    pub lead: usize,
    /// For CDM = 1: MA is low for so long, from half a clock after the last rising edge on.
    pub hold: Option<usize>,
    /// MA high at the end, at least.
    pub tail: usize,
    /// All of it, at least; what is missing goes before the first edge.
    pub least: usize,
}

/// MA of one cycle, sample by sample. Reused from cycle to cycle.
#[derive(Clone, Debug)]
pub struct Pattern {
    grid: Grid,
    /// Most significant bit first, as SPI sends it.
    ma: Vec<u8>,
    first_fall: usize,
    rises: Vec<usize>,
    /// MA falls for CDM = 1, and rises again.
    cdm: Option<(usize, usize)>,
}

impl Pattern {
    /// Nothing planned yet.
    pub fn new(grid: Grid) -> Pattern {
        Pattern {
            grid,
            ma: Vec::new(),
            first_fall: 0,
            rises: Vec::new(),
            cdm: None,
        }
    }

    /// Lays a cycle on the samples.
    pub fn plan(&mut self, plan: &Plan) {
        let clocks = usize::from(plan.clocks);
        let body = self.grid.half(2 * clocks) + plan.hold.unwrap_or(0) + plan.tail;
        let whole = (plan.lead + body).max(plan.least).next_multiple_of(8);
        self.ma.clear();
        self.ma.resize(whole / 8, 0xFF);
        self.rises.clear();
        self.first_fall = whole - body;
        for clock in 0..clocks {
            let fall = self.first_fall + self.grid.half(2 * clock);
            let rise = self.first_fall + self.grid.half(2 * clock + 1);
            self.low(fall, rise);
            self.rises.push(rise);
        }
        self.cdm = plan.hold.map(|hold| {
            let fall = self.first_fall + self.grid.half(2 * clocks);
            (fall, fall + hold)
        });
        if let Some((fall, rise)) = self.cdm {
            self.low(fall, rise);
        }
    }

    fn low(&mut self, from: usize, to: usize) {
        for at in from..to {
            self.ma[at / 8] &= !(0x80 >> (at % 8));
        }
    }

    /// The bytes to send, MA high as 1.
    pub fn bytes(&self) -> &[u8] {
        &self.ma
    }

    /// Samples before the first falling edge.
    pub fn first_fall(&self) -> usize {
        self.first_fall
    }

    /// Samples before rising edge 1, 2, 3 …
    pub fn rises(&self) -> &[usize] {
        &self.rises
    }

    /// Where a bit is read, after its rising edge, in samples like the line delay.
    pub fn into_bit(&self, delay: usize) -> usize {
        delay + self.grid.period() / 2
    }

    fn last_edge(&self) -> usize {
        let rise = self.rises.last().copied().unwrap_or(self.first_fall);
        self.cdm.map_or(rise, |(fall, _)| fall)
    }

    /// Reads the levels that came back while the pattern was sent, sample for sample, into a trace. The line delay is
    /// taken out of the bits, whole clocks too. Returns the delay in samples where something answered.
    pub fn read(&self, sl: &[u8], trace: &mut Trace) -> Option<usize> {
        let grid = &self.grid;
        let level = |at: usize| sl.get(at / 8).map(|byte| byte & 0x80 >> (at % 8) != 0);
        let find =
            |from: usize, wanted: bool| (from..8 * sl.len()).find(|at| level(*at) == Some(wanted));
        trace.idle = self.first_fall.checked_sub(1).and_then(level);
        trace.cdm = Some(self.cdm.is_some());
        let ns = |samples: usize| u32::try_from(grid.ns(samples)).ok();
        trace.ma_period_ns = u32::try_from(grid.period_ns()).ok();
        let second = self.rises.get(1).copied();
        trace.reference_ns = second.and_then(|rise| ns(rise - self.first_fall));
        // As planned; a gap between two bytes that the controller makes is not seen.
        for (edge, pair) in self.rises.windows(2).enumerate() {
            trace.level(grid.ns(pair[1] - pair[0]), edge as u16 + 2);
        }
        let delay = second.and_then(|rise| {
            let mut from = rise;
            loop {
                let ack = find(from, false)?;
                // Three quarters of a clock at least until the start bit: what is shorter is a spike, and no Ack.
                match find(ack, true) {
                    Some(up) if up - ack < grid.period() / 2 => from = up,
                    _ => return Some(ack - rise),
                }
            }
        });
        trace.delay_ns = delay.and_then(ns);
        // Down before the edge that brings Ack: that is no answer to this frame.
        let early = second.is_some_and(|rise| level(rise - 1) == Some(false));
        let into_bit = self.into_bit(delay.unwrap_or(0));
        for (index, rise) in self.rises.iter().enumerate() {
            match level(rise + into_bit) {
                Some(level) => trace.bits.push(level && !(early && index == 0)),
                None => break,
            }
        }
        let last = self.rises.last().map(|rise| rise + into_bit);
        trace.ready_ns = last
            .filter(|at| level(*at) == Some(false))
            .and_then(|at| find(at, true))
            .and_then(|at| ns(at - self.last_edge().min(at)));
        delay
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn levels(bytes: &[u8]) -> String {
        bytes
            .iter()
            .flat_map(|byte| {
                (0..8)
                    .rev()
                    .map(move |place| if byte >> place & 1 == 1 { '1' } else { '0' })
            })
            .collect()
    }

    const PLAN: Plan = Plan {
        clocks: 3,
        lead: 4,
        hold: None,
        tail: 6,
        least: 0,
    };

    #[test]
    fn clocks_between_a_lead_and_a_tail() {
        let mut pattern = Pattern::new(Grid::whole(4, 4_000_000));
        pattern.plan(&PLAN);
        // 4 of lead, 12 of clocks and 6 of tail are 22: two more go before the first edge.
        assert_eq!(levels(pattern.bytes()), "111111001100110011111111");
        assert_eq!(
            (pattern.first_fall(), pattern.rises()),
            (6, &[8, 12, 16][..])
        );
        pattern.plan(&Plan { least: 40, ..PLAN });
        assert_eq!(
            levels(pattern.bytes()),
            "1111111111111111111111001100110011111111"
        );
    }

    #[test]
    fn cdm_is_held_and_let_go() {
        let mut pattern = Pattern::new(Grid::whole(4, 4_000_000));
        pattern.plan(&Plan {
            hold: Some(5),
            tail: 7,
            ..PLAN
        });
        let (lead, clocks, hold, tail) = ("11111111", "001100110011", "00000", "1111111");
        let whole = [lead, clocks, hold, tail].concat();
        assert_eq!(levels(pattern.bytes()), whole);
    }

    /// Every edge of a broken grid stands less than a sample before its place, and never after it.
    #[test]
    fn a_broken_grid_stays_within_a_sample() {
        let mut pattern = Pattern::new(Grid::broken(1_500_000, 7_812_500));
        pattern.plan(&Plan {
            clocks: 500,
            ..PLAN
        });
        let per_clock = 7_812_500.0 / 1_500_000.0;
        for (clock, rise) in pattern.rises().iter().enumerate() {
            let place = pattern.first_fall() as f64 + (clock as f64 + 0.5) * per_clock;
            let early = place - *rise as f64;
            assert!((0.0..1.0).contains(&early), "{clock}: {early}");
        }
        let spans = pattern.rises().windows(2).map(|pair| pair[1] - pair[0]);
        assert_eq!(spans.clone().min(), Some(5));
        assert_eq!(spans.max(), Some(6));
        let grid = Grid::broken(1_500_000, 7_812_500);
        assert_eq!((grid.jitter_ns(), grid.ns(1)), (128, 128));
        assert_eq!(Grid::broken(1_000_000, 8_000_000).jitter_ns(), 0);
    }

    #[test]
    fn samples_last_as_long_as_they_should() {
        let grid = Grid::whole(8, 7_000_000);
        for (ns, samples) in [
            (0, 0),
            (1, 1),
            (142, 1),
            (143, 2),
            (40_000, 280),
            (40_001, 281),
        ] {
            assert_eq!(grid.samples(ns), samples, "{ns}");
        }
        // The longest times at the fastest rate.
        let grid = Grid::whole(4, u32::MAX);
        assert_eq!(grid.samples(u32::MAX.into()) as u64, 18_446_744_066);
    }

    /// What comes back of `bits`, one after each rising edge and `delay` samples later, then SL = 1 at `ready`.
    fn back(pattern: &Pattern, bits: &str, delay: usize, ready: usize) -> Vec<u8> {
        let mut sl = vec![0xFF; pattern.bytes().len()];
        for (rise, bit) in pattern.rises().iter().zip(bits.chars()) {
            for at in rise + delay..ready {
                set(&mut sl, at, bit == '1');
            }
        }
        sl
    }

    fn set(sl: &mut [u8], at: usize, level: bool) {
        let mask = 0x80 >> (at % 8);
        sl[at / 8] = sl[at / 8] & !mask | if level { mask } else { 0 };
    }

    #[test]
    fn levels_become_a_trace() {
        let plan = Plan {
            clocks: 6,
            tail: 60,
            ..PLAN
        };
        for (hold, delay) in [(None, 0), (None, 3), (None, 13), (Some(20), 6)] {
            let mut pattern = Pattern::new(Grid::whole(4, 4_000_000));
            pattern.plan(&Plan { hold, ..plan });
            let (first, rises) = (pattern.first_fall(), pattern.rises());
            // CDM = 1 takes MA low half a clock after the last rising edge.
            let last = rises[5] + if hold.is_some() { 2 } else { 0 };
            let good = back(&pattern, "101100", delay, last + delay + 9);
            let mut trace = Trace::default();
            assert_eq!(pattern.read(&good, &mut trace), Some(delay));
            assert_eq!(trace.bits.to_string(), "101100", "{hold:?} {delay}");
            assert_eq!(trace.idle, Some(true));
            assert_eq!(trace.cdm, Some(hold.is_some()));
            assert_eq!(trace.delay_ns, Some(250 * delay as u32));
            assert_eq!(trace.ready_ns, Some(250 * (delay as u32 + 9)));
            assert_eq!(trace.reference_ns, Some(1500));
            assert_eq!(trace.ma_period_ns, Some(1000));
            let longest = trace.longest.map(|level| (level.ns, level.edge));
            assert_eq!(longest, Some((1000, 2)));

            // SL before the first edge.
            for (at, idle) in [(first - 1, false), (first, true)] {
                let mut sl = good.clone();
                set(&mut sl, at, false);
                let mut trace = Trace::default();
                pattern.read(&sl, &mut trace);
                assert_eq!(trace.idle, Some(idle));
            }
            // Down before edge 2: something else than this frame has answered.
            let mut sl = good.clone();
            set(&mut sl, rises[1] - 1, false);
            let mut trace = Trace::default();
            pattern.read(&sl, &mut trace);
            assert_eq!(trace.bits.to_string(), "001100", "{hold:?} {delay}");
            // A line that does not come back, and one that is longer than the pattern.
            let stuck = back(&pattern, "101100", delay, 8 * good.len());
            let mut trace = Trace::default();
            pattern.read(&stuck, &mut trace);
            assert_eq!(trace.ready_ns, None);
            let mut trace = Trace::default();
            pattern.read(&good[..(rises[5] + delay) / 8], &mut trace);
            assert!(trace.bits.len() < 6 && trace.ready_ns.is_none());
            let mut trace = Trace::default();
            assert_eq!(pattern.read(&vec![0xFF; good.len()], &mut trace), None);
            assert_eq!(trace.bits.to_string(), "111111");
            assert_eq!((trace.delay_ns, trace.ready_ns), (None, None));
        }
    }

    /// Crosstalk: SL is low for less than half a clock before its Ack. The bits lie where the Ack says.
    #[test]
    fn a_spike_is_no_ack() {
        for (samples, spike) in [(4, 1), (5, 1), (8, 3), (16, 7)] {
            let clocks = 6;
            let mut pattern = Pattern::new(Grid::whole(samples, 8_000_000));
            pattern.plan(&Plan {
                clocks,
                tail: 40,
                ..PLAN
            });
            let period = samples as usize;
            let second = pattern.rises()[1];
            let ack = second + period + period / 2;
            let mut sl = vec![0xFF; pattern.bytes().len()];
            let mut low = |from: usize, to: usize| {
                (from..to).for_each(|at| sl[at / 8] &= !(0x80u8 >> (at % 8)));
            };
            // Ack, start, and zeros; in its last quarter an Ack may be cut short.
            low(second + 1, second + 1 + spike);
            low(ack, ack + period - period / 4);
            low(ack + 2 * period, ack + 4 * period);
            let mut trace = Trace::default();
            let delay = pattern.read(&sl, &mut trace);
            assert_eq!(delay, Some(ack - second), "{samples} samples a clock");
            assert_eq!(trace.bits.to_string(), "101001");
        }
    }
}
