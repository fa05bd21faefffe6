//! Many frames in a few numbers, in constant memory: how steadily they came, what the line and the encoder took, and how
//! the position moved.
//!
//! Shares are read from histograms of four significant digits; least, most and mean are exact.

use crate::cycle::Cycle;
use crate::format::{Format, MAX_CHANNELS};
use crate::place::{Count, Counter, Number, Zero};
use crate::trace::Trace;
use hdrhistogram::Histogram;

/// Nanoseconds of delay for each metre of cable, there and back (REN, p. 3; 5 ns each way).
pub const NS_PER_METRE: f64 = 10.0;

/// SL may come so much of a clock earlier or later than the line delay that was measured (D2, Table 10).
const JITTER_CLOCKS: f64 = 0.25;

/// Speeds are means over so long at least: a step of one count between two frames is no speed.
const SPEED_OVER_NS: u64 = 10_000_000;

/// Values, of which only shares are kept.
#[derive(Clone, Debug)]
pub struct Distribution {
    counts: Histogram<u32>,
    least: u64,
    most: u64,
    sum: u128,
}

/// A distribution in numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// The least value.
    pub min: u64,
    /// The mean of all.
    pub mean: f64,
    /// Half of the values are not above it.
    pub p50: u64,
    /// 99 of 100 values are not above it.
    pub p99: u64,
    /// The largest value.
    pub max: u64,
}

/// Values from `from` up to and without `to`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bin {
    /// Where it begins.
    pub from: u64,
    /// Where the next one begins.
    pub to: u64,
    /// How many values.
    pub count: u64,
}

impl Default for Distribution {
    fn default() -> Distribution {
        let counts = Histogram::new(4).expect("one to five digits");
        Distribution {
            counts,
            least: u64::MAX,
            most: 0,
            sum: 0,
        }
    }
}

impl Distribution {
    /// Takes one more.
    pub fn add(&mut self, value: u64) {
        // It grows as it has to, up to here.
        let _ = self.counts.record(value.min(u64::MAX / 4));
        self.least = self.least.min(value);
        self.most = self.most.max(value);
        self.sum += u128::from(value);
    }

    /// How many there are.
    pub fn len(&self) -> u64 {
        self.counts.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.counts.is_empty()
    }

    /// None of no value.
    pub fn spread(&self) -> Option<Spread> {
        if self.is_empty() {
            return None;
        }
        let share = |quantile| {
            let value = self.counts.value_at_quantile(quantile);
            value.clamp(self.least, self.most)
        };
        Some(Spread {
            min: self.least,
            mean: self.sum as f64 / self.len() as f64,
            p50: share(0.5),
            p99: share(0.99),
            max: self.most,
        })
    }

    /// `bins` of equal width for 99 of 100 values, and what is left in one more: outliers must not flatten all the others.
    pub fn bins(&self, bins: u64) -> Vec<Bin> {
        let Some(spread) = self.spread() else {
            return Vec::new();
        };
        let width = (spread.p99 - spread.min).div_ceil(bins.max(1)).max(1);
        let mut found: Vec<Bin> = Vec::new();
        for bin in 0..bins {
            let from = spread.min + bin * width;
            if from > spread.p99 {
                break;
            }
            let to = from + width;
            found.push(Bin { from, to, count: 0 });
        }
        let end = found.last().map_or(spread.min, |bin| bin.to);
        let mut tail = 0;
        for value in self.counts.iter_recorded() {
            let at = value.value_iterated_to().clamp(spread.min, spread.max);
            let bin = ((at - spread.min) / width) as usize;
            match found.get_mut(bin) {
                Some(bin) => bin.count += u64::from(value.count_at_value()),
                None => tail += u64::from(value.count_at_value()),
            }
        }
        if tail > 0 {
            let to = spread.max + 1;
            found.push(Bin {
                from: end,
                to,
                count: tail,
            });
        }
        found
    }
}

/// How one channel's position behaved. Counts are turns and position as one number, the shorter way round from frame to frame.
#[derive(Clone, Debug)]
pub struct Motion {
    counter: Counter,
    /// The last two good frames; the first one only where nothing bad was between them.
    last: [Option<Sample>; 2],
    /// A frame that is no good one came behind them.
    missed: bool,
    /// Where the first good frame was; places count from there.
    first: Option<Sample>,
    least: i128,
    most: i128,
    /// Squares of what the middle one of three frames is off the line between the others.
    squares: f64,
    triples: u64,
    window: Option<Sample>,
    speed: Option<(f64, f64)>,
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    t_ns: u64,
    place: i128,
}

/// A speed in counts a second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Speed {
    /// The least, over 10 ms at least.
    pub min: f64,
    /// From the first frame to the last.
    pub mean: f64,
    /// The largest, over 10 ms at least.
    pub max: f64,
}

impl Motion {
    fn of(number: Number) -> Motion {
        let count = Count {
            unwrap: true,
            zero: Zero::Here,
            reverse: false,
        };
        Motion {
            counter: Counter::of(number, count),
            last: [None; 2],
            missed: false,
            first: None,
            least: 0,
            most: 0,
            squares: 0.0,
            triples: 0,
            window: None,
            speed: None,
        }
    }

    fn next(&mut self, t_ns: u64, data: u64) {
        if !self.counter.number().is_within(data) {
            return self.miss();
        }
        let (place, _) = self.counter.next(data, t_ns);
        let sample = Sample { t_ns, place };
        self.first.get_or_insert(sample);
        self.least = self.least.min(place);
        self.most = self.most.max(place);
        let [before, middle] = self.last.map(|last| last.filter(|_| !self.missed));
        if let (Some(before), Some(middle)) = (before, middle) {
            self.off_the_line(before, middle, sample);
        }
        let window = self.window.get_or_insert(sample);
        if t_ns.saturating_sub(window.t_ns) >= SPEED_OVER_NS {
            let speed = speed(*window, sample);
            let (least, most) = self.speed.unwrap_or((speed, speed));
            self.speed = Some((least.min(speed), most.max(speed)));
            self.window = Some(sample);
        }
        (self.last, self.missed) = ([middle, Some(sample)], false);
    }

    /// Frames are missing: what comes next is no neighbour of what was before.
    fn miss(&mut self) {
        self.counter.miss();
        self.missed = true;
    }

    /// A line through three frames takes out any steady speed, whatever the times between them.
    fn off_the_line(&mut self, before: Sample, middle: Sample, after: Sample) {
        let span = after.t_ns.saturating_sub(before.t_ns) as f64;
        if span <= 0.0 {
            return;
        }
        let share = middle.t_ns.saturating_sub(before.t_ns) as f64 / span;
        let line = (after.place - before.place) as f64 * share;
        let off = (middle.place - before.place) as f64 - line;
        // Three independent errors of one size add up to this.
        let weight = 1.0 + share * share + (1.0 - share) * (1.0 - share);
        self.squares += off * off / weight;
        self.triples += 1;
    }

    /// Root mean square of a position's error in counts, from frame to frame: the frames' own noise, whatever the
    /// speed; acceleration counts as noise. None of less than three frames in a row.
    pub fn noise(&self) -> Option<f64> {
        (self.triples > 0).then(|| (self.squares / self.triples as f64).sqrt())
    }

    /// From the least to the largest place, in counts. None without a frame.
    pub fn travel(&self) -> Option<i128> {
        self.first.map(|_| self.most - self.least)
    }

    /// Counts a second. None of a single moment.
    pub fn speed(&self) -> Option<Speed> {
        let (first, last) = (self.first?, self.last[1]?);
        if last.t_ns <= first.t_ns {
            return None;
        }
        let mean = speed(first, last);
        let (min, max) = self.speed.unwrap_or((mean, mean));
        Some(Speed { min, mean, max })
    }
}

fn speed(from: Sample, to: Sample) -> f64 {
    let seconds = to.t_ns.saturating_sub(from.t_ns) as f64 / 1e9;
    (to.place - from.place) as f64 / seconds
}

/// When a slot was to begin, and how long it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Due {
    /// When, on the link's clock.
    pub at_ns: u64,
    /// Until the next one.
    pub interval_ns: u64,
}

/// What many cycles had in common, and what not.
#[derive(Clone, Debug)]
pub struct Stats {
    /// From start to start.
    pub period_ns: Distribution,
    /// By how much a period differs from the one before.
    pub jitter_ns: Distribution,
    /// By how much a cycle began after its slot, where there are slots.
    pub late_ns: Distribution,
    /// Slots whose cycle began a tenth of their length late or more.
    pub late: u64,
    /// MA, as it was measured in each frame.
    pub clock_hz: Distribution,
    /// From the edge that sets Ack to the edge that sets the start bit.
    pub ack_clk: Distribution,
    /// The same in nanoseconds, where both wires are seen.
    pub busy_ns: Distribution,
    /// Line delay in whole clocks, on links that see no more of it.
    pub delay_clk: Distribution,
    /// Line delay: second rising MA edge to SL falling.
    pub delay_ns: Distribution,
    /// The slave's timeout: last MA edge to SL = 1, less the line delay.
    pub timeout_ns: Distribution,
    /// The longest MA level or time from rise to rise of each frame.
    pub level_ns: Distribution,
    /// One a channel; none for channels without a position.
    pub motions: [Option<Motion>; MAX_CHANNELS],
    last_ns: Option<u64>,
    last_period_ns: Option<u64>,
}

impl Stats {
    /// For frames of this format.
    pub fn new(format: &Format) -> Stats {
        Stats::of(format.channels().iter().map(Number::of))
    }

    /// For frames whose channels have these numbers, where a turn has fewer counts than its field could hold.
    pub fn of(mut numbers: impl Iterator<Item = Option<Number>>) -> Stats {
        Stats {
            period_ns: Distribution::default(),
            jitter_ns: Distribution::default(),
            late_ns: Distribution::default(),
            late: 0,
            clock_hz: Distribution::default(),
            ack_clk: Distribution::default(),
            busy_ns: Distribution::default(),
            delay_clk: Distribution::default(),
            delay_ns: Distribution::default(),
            timeout_ns: Distribution::default(),
            level_ns: Distribution::default(),
            motions: std::array::from_fn(|_| numbers.next().flatten().map(Motion::of)),
            last_ns: None,
            last_period_ns: None,
        }
    }

    /// Counts a cycle that was judged, and that began its slot at `due` where it has one.
    pub fn add(&mut self, trace: &Trace, cycle: &Cycle, format: &Format, due: Option<Due>) {
        self.time(trace.t_ns, due);
        if let Some(level) = trace.longest {
            self.level_ns.add(level.ns.into());
        }
        self.motion(trace.t_ns, cycle, format);
        // What is measured on a frame that is no frame, is no measure of the encoder.
        let (true, Some(head)) = (cycle.is_good(), cycle.head()) else {
            return;
        };
        self.ack_clk.add(head.ack.into());
        let ready = trace.ready_ns.zip(trace.delay_ns);
        let timeout = ready.and_then(|(ready, delay)| ready.checked_sub(delay));
        for (value, distribution) in [
            (trace.busy_ns, &mut self.busy_ns),
            (trace.delay_ns, &mut self.delay_ns),
            (timeout, &mut self.timeout_ns),
        ] {
            if let Some(ns) = value {
                distribution.add(ns.into());
            }
        }
        if trace.delay_ns.is_none() {
            self.delay_clk.add(head.delay_clk.into());
        }
        if let Some(period) = trace.ma_period_ns.filter(|period| *period > 0) {
            self.clock_hz.add((1e9 / f64::from(period)).round() as u64);
        }
    }

    /// The next cycle does not follow the last one: something between them was left out.
    pub fn gap(&mut self) {
        self.last_ns = None;
        self.last_period_ns = None;
        self.motions.iter_mut().flatten().for_each(Motion::miss);
    }

    fn time(&mut self, t_ns: u64, due: Option<Due>) {
        if let Some(last) = self.last_ns.replace(t_ns) {
            let period = t_ns.saturating_sub(last);
            self.period_ns.add(period);
            if let Some(before) = self.last_period_ns.replace(period) {
                self.jitter_ns.add(period.abs_diff(before));
            }
        }
        if let Some(due) = due {
            let late = t_ns.saturating_sub(due.at_ns);
            self.late_ns.add(late);
            self.late += u64::from(late >= (due.interval_ns / 10).max(1));
        }
    }

    fn motion(&mut self, t_ns: u64, cycle: &Cycle, format: &Format) {
        let channels = format.channels().iter().enumerate();
        for ((index, channel), motion) in channels.zip(&mut self.motions) {
            let Some(motion) = motion else { continue };
            let word = cycle.words().get(index).filter(|_| cycle.fault().is_none());
            let sound = word
                .and_then(|word| word.good())
                .filter(|data| channel.error(*data) != Some(true));
            match sound {
                Some(data) => motion.next(t_ns, data),
                None => motion.miss(),
            }
        }
    }

    /// What a line of this delay would be in metres, there and back, if the encoder itself took no time: an upper bound.
    pub fn cable_m(&self) -> Option<f64> {
        Some(self.delay_ns.spread()?.mean / NS_PER_METRE)
    }

    /// How much later or, beyond a whole clock of delay, earlier SL may come until a master reads the wrong bit that
    /// samples with the next rising MA edge and does not compensate the line delay: the least that was seen.
    pub fn margin_ns(&self) -> Option<u64> {
        let delay = self.delay_ns.spread()?;
        let period = 1e9 / self.clock_hz.spread()?.mean;
        let room = |delay: u64| {
            let (delay, into) = (delay as f64, delay as f64 % period);
            // Nothing comes before its edge, so less than a clock cannot come too early.
            let early = if delay < period { period } else { into };
            (period - into).min(early)
        };
        Some(room(delay.min).min(room(delay.max)) as u64)
    }

    /// The fastest MA for which the line delay is as steady as it has to be, within `limit_hz`.
    pub fn steady_up_to_hz(&self, limit_hz: u32) -> Option<u32> {
        let delay = self.delay_ns.spread()?;
        let wander = (delay.max as f64 - delay.mean).max(delay.mean - delay.min as f64);
        if wander <= 0.0 {
            return Some(limit_hz);
        }
        Some((JITTER_CLOCKS * 1e9 / wander).min(f64::from(limit_hz)) as u32)
    }
}
