//! Why frames are bad: what a row of them shows that the name of a fault cannot say.
//!
//! [`Evidence`] is fed every judged cycle, keeps a fixed amount of it, and says what follows. What does not follow it does
//! not say: a wrong hint costs more than none. Where the frames of a run leave it open, a [`Trial`] can decide.

mod flips;
mod restarts;
mod samples;

use crate::cycle::{Cycle, Fault, Head};
use crate::format::{Format, MAX_CHANNELS};
use crate::frame::{BissC, Stall};
use crate::limits;
use crate::preset::Preset;
use crate::trace::{Level, Trace};
use crate::unit::{Hertz, Nanos};
use flips::Flips;
use restarts::Restarts;
use samples::Samples;
use std::collections::VecDeque;
use std::fmt;

/// So many cycles without any other answer are the line's, while a run goes on.
const ROW: u64 = 8;

/// Frames of a trial.
const TRIAL_FRAMES: u32 = 32;

/// Clocks behind the frame in a trial that looks for a longer one.
const TRIAL_SURPLUS: u16 = 40;

/// Why frames are bad.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cause {
    /// SL is high at rest and nothing ever answered: no encoder, no power, or MA does not arrive.
    NoEncoder,
    /// It answers when MA is upside down.
    MaSwapped,
    /// It answered, and does not any more.
    Lost,
    /// SL is low throughout.
    SloLow,
    /// SL is upside down.
    SloSwapped,
    /// Ack and no start bit within the limit.
    Busy,
    /// Ack later than the limit.
    LateAck,
    /// The frame has another length.
    Frame,
    /// The CRC is another one.
    Crc,
    /// All frames fail, and all are the same.
    Unmoved,
    /// MA stood still inside frames.
    Pause,
    /// MA stood still between bytes of a transfer, and the encoder began anew.
    Gaps,
    /// MA is too fast or too slow for the encoder or the line.
    Clock,
    /// SL changes where it is sampled.
    Edge,
    /// Single bits are wrong here and there.
    Noise,
}

impl Cause {
    /// Its name in every output.
    pub fn name(self) -> &'static str {
        match self {
            Cause::NoEncoder => "no-encoder",
            Cause::MaSwapped => "ma-swapped",
            Cause::Lost => "lost",
            Cause::SloLow => "slo-low",
            Cause::SloSwapped => "slo-swapped",
            Cause::Busy => "busy",
            Cause::LateAck => "late-ack",
            Cause::Frame => "frame",
            Cause::Crc => "crc",
            Cause::Unmoved => "unmoved",
            Cause::Pause => "pause",
            Cause::Gaps => "gaps",
            Cause::Clock => "clock",
            Cause::Edge => "edge",
            Cause::Noise => "noise",
        }
    }

    /// All of them.
    pub const ALL: [Cause; 15] = [
        Cause::NoEncoder,
        Cause::MaSwapped,
        Cause::Lost,
        Cause::SloLow,
        Cause::SloSwapped,
        Cause::Busy,
        Cause::LateAck,
        Cause::Frame,
        Cause::Crc,
        Cause::Unmoved,
        Cause::Pause,
        Cause::Gaps,
        Cause::Clock,
        Cause::Edge,
        Cause::Noise,
    ];
}

/// What to type next.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Remedy {
    /// The same again, when that has been done which only hands can do.
    Again,
    /// The same with these options, each in place of what was said.
    Options(Vec<(&'static str, String)>),
    /// The same with this key of the way to the encoder set to another value.
    Key(&'static str, String),
    /// A drawing of a cycle that fails.
    Draw,
}

/// A cause, and what speaks for it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnosis {
    /// Why.
    pub cause: Cause,
    /// What was seen, and what that means.
    pub text: String,
    /// Cycles that show it.
    pub count: u64,
    /// What hands can do before the next command; may be nothing.
    pub advice: &'static str,
    /// The next command.
    pub remedy: Remedy,
}

impl fmt::Display for Diagnosis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)?;
        match self.advice {
            "" => Ok(()),
            advice => write!(f, "; {advice}"),
        }
    }
}

/// How the frames are read.
#[derive(Clone, Debug)]
pub struct Setup {
    /// Their format, and the limits that hold.
    pub protocol: BissC,
    /// Where the format was chosen by name.
    pub preset: Option<&'static Preset>,
    /// MA as it runs; `None` for a recording, whose cycles say it.
    pub clock: Option<Hertz>,
    /// MA runs in bytes, and may stand between two of them without anybody seeing it.
    pub in_bytes: bool,
    /// The SPI mode that was asked for, where one was.
    pub mode: Option<u8>,
}

/// Frames to be read for their cause alone, after those of the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trial {
    /// At another clock.
    pub clock: Option<Hertz>,
    /// With MA upside down.
    pub upside_down: bool,
    /// With so many clocks behind each frame.
    pub surplus: Option<u16>,
    /// So many of them.
    pub frames: u32,
}

/// What the cycles of a run show.
#[derive(Clone, Debug)]
pub struct Evidence {
    setup: Setup,
    cycles: u64,
    good: u64,
    delays: Delays,
    last: Last,
    bad: Option<Box<Bad>>,
}

/// The last good cycle.
#[derive(Clone, Debug, Default)]
struct Last {
    head: Option<Head>,
    words: [u64; MAX_CHANNELS],
    channels: usize,
}

impl Last {
    fn keep(&mut self, cycle: &Cycle) {
        self.head = cycle.head();
        self.channels = cycle.words().len();
        for (kept, word) in self.words.iter_mut().zip(cycle.words()) {
            (*kept, _) = word.raw();
        }
    }
}

/// Whole clocks of line delay, where they are all that is known of it.
#[derive(Clone, Debug, Default)]
struct Delays {
    seen: [(u16, u64); 8],
    /// None of these.
    others: u64,
    last: u16,
    /// From one cycle to the next.
    changes: u64,
}

impl Delays {
    fn see(&mut self, clocks: u16) {
        let same = |(known, count): &&mut (u16, u64)| *count == 0 || *known == clocks;
        match self.seen.iter_mut().find(same) {
            Some((known, count)) => (*known, *count) = (clocks, *count + 1),
            None => self.others += 1,
        }
        self.changes += u64::from(clocks != self.last);
        self.last = clocks;
    }

    /// Two lengths that differ by a clock, and how often each was seen, the rarer one last.
    fn two(&self) -> Option<[(u16, u64); 2]> {
        let all: u64 = self.seen.iter().map(|(_, count)| count).sum();
        let pairs = self.seen.iter().flat_map(|first| {
            let beside = |second: &&(u16, u64)| second.1 > 0 && second.0 == first.0 + 1;
            let second = self.seen.iter().filter(beside);
            second.map(move |second| [*first, *second])
        });
        let mut pair = pairs
            .filter(|[first, _]| first.1 > 0)
            .max_by_key(|[first, second]| first.1 + second.1)?;
        pair.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        let [often, rarely] = pair;
        // Where Ack itself was missed, something else was taken for it.
        let most = 3 * (often.1 + rarely.1) > all + self.others;
        // Another sampling phase changes them once.
        let wavers = 2 * self.changes >= rarely.1;
        (most && wavers).then_some(pair)
    }
}

/// What is known since the first bad cycle.
#[derive(Clone, Debug, Default)]
struct Bad {
    cycles: u64,
    /// Since the last good one.
    row: u64,
    row_silent: u64,
    row_low: u64,
    /// SL never moved from 1.
    silent: u64,
    clocks: u16,
    /// SL never moved from 0.
    low: u64,
    waited_ns: Option<u64>,
    /// SL was 0 at rest and moved.
    upset: u64,
    upside: Samples,
    /// Ack and no start bit, and the longest busy time where the start bit came after the limit.
    no_start: u64,
    start_clocks: u16,
    start_after: Option<u16>,
    /// Ack after the limit, and its longest delay.
    late: u64,
    ack_after: u16,
    /// Frames that are whole and wrong.
    wrong: u64,
    samples: Samples,
    flips: Flips,
    restarts: Restarts,
    /// The start bit or the line delay was not where it used to be.
    moved: u64,
    stalls: u64,
    longest: Option<(Level, u32)>,
    /// Levels that are as long as the clock makes them.
    slow: u64,
    period_ns: Option<u32>,
    /// What is still to be tried, once that was asked for.
    trials: Option<VecDeque<Trial>>,
    /// More frames of the same kind were good.
    recovered: bool,
    /// The clock that frames were good at, how many, and of how many.
    better: Option<(Hertz, u32, u32)>,
    /// Frames that were good with MA upside down, and of how many.
    turned: Option<(u32, u32)>,
    told: Vec<(Cause, Remedy, u64)>,
}

impl Evidence {
    /// Nothing yet.
    pub fn new(setup: Setup) -> Evidence {
        Evidence {
            setup,
            cycles: 0,
            good: 0,
            delays: Delays::default(),
            last: Last::default(),
            bad: None,
        }
    }

    /// A cycle that was run and judged.
    #[inline]
    pub fn cycle(&mut self, trace: &Trace, cycle: &Cycle) {
        self.cycles += 1;
        if let (Some(head), None) = (cycle.head(), trace.delay_ns) {
            self.delays.see(head.delay_clk);
        }
        if !cycle.is_good() {
            return self.fails(trace, cycle);
        }
        self.good += 1;
        self.last.keep(cycle);
        if self.bad.is_some() {
            self.is_good_again(cycle);
        }
    }

    /// SL is sampled at another place in the bit from now on: line delays in clocks begin anew.
    pub fn resampled(&mut self) {
        self.delays = Delays::default();
    }

    #[cold]
    fn is_good_again(&mut self, cycle: &Cycle) {
        let Some(bad) = &mut self.bad else { return };
        (bad.row, bad.row_silent, bad.row_low) = (0, 0, 0);
        if bad.flips.waits() {
            bad.flips.good(&self.setup.protocol.format, cycle);
        }
    }

    #[cold]
    fn fails(&mut self, trace: &Trace, cycle: &Cycle) {
        let words = || cycle.words().iter().find_map(|word| word.fault());
        let Some(fault) = cycle.fault().or_else(words) else {
            return;
        };
        let bad = self.bad.get_or_insert_default();
        bad.cycles += 1;
        bad.row += 1;
        bad.period_ns = trace.ma_period_ns.or(bad.period_ns);
        match fault {
            Fault::NotReady { waited_ns } => bad.not_ready(trace, waited_ns),
            Fault::NoAck { clocks } => bad.no_ack(trace, clocks),
            Fault::NoStart { clocks } => bad.no_start(trace, clocks),
            Fault::Stalled {
                level_ns,
                limit_ns,
                edge,
            } => {
                let level = Level { ns: level_ns, edge };
                bad.stalled(trace, level, limit_ns);
            }
            Fault::Mismatch { .. } | Fault::Delay { .. } => bad.moved += 1,
            Fault::Crc { .. } | Fault::Stop { .. } | Fault::Short { .. } => {
                bad.wrong += 1;
                bad.samples.add(trace);
                let words = &self.last.words[..self.last.channels];
                if matches!(fault, Fault::Crc { .. }) {
                    bad.flips.failed(cycle, words);
                }
                if self.setup.in_bytes {
                    let good = self.last.head.map(|head| (head, words));
                    let format = &self.setup.protocol.format;
                    if let Some(sample) = bad.samples.latest() {
                        bad.restarts.look(sample, format, good);
                    }
                }
            }
            Fault::Null | Fault::Life { .. } | Fault::Pair { .. } => {}
        }
    }

    /// Whether it may be worth asking, while the run goes on.
    pub fn is_due(&self) -> bool {
        let due = |bad: &Bad| bad.row == ROW || bad.cycles >= 2 && bad.cycles.is_power_of_two();
        self.bad.as_deref().is_some_and(due)
    }

    /// What has not been said yet: of a cause once, and at the `end` what has become of it.
    pub fn news(&mut self, end: bool) -> Vec<Diagnosis> {
        let mut found = self.found(end);
        let Some(bad) = &mut self.bad else {
            return Vec::new();
        };
        found.retain(|new| {
            let said = |(cause, remedy, count): &(Cause, Remedy, u64)| {
                *cause == new.cause && (!end || *remedy == new.remedy && *count == new.count)
            };
            !bad.told.iter().any(said)
        });
        let told = found
            .iter()
            .map(|new| (new.cause, new.remedy.clone(), new.count));
        bad.told.extend(told);
        found
    }

    /// All that the run shows.
    pub fn diagnoses(&self) -> Vec<Diagnosis> {
        self.found(true)
    }

    fn found(&self, end: bool) -> Vec<Diagnosis> {
        let Some(bad) = self.bad.as_deref() else {
            return Vec::new();
        };
        let enough = if end { 1 } else { ROW };
        let mut found: Vec<Diagnosis> = [
            self.absent(bad, enough),
            self.ma_upside_down(bad),
            self.low(bad, enough),
            self.upside_down(bad),
            self.lost(bad),
            self.busy(bad),
            self.late_ack(bad),
            self.pause(bad),
            self.clock(bad),
        ]
        .into_iter()
        .flatten()
        .collect();
        let sent = self.other_format(bad).or_else(|| self.gaps(bad));
        match sent {
            Some(sent) => found.push(sent),
            None if found.iter().any(|known| known.cause == Cause::Clock) => {}
            None => {
                let line = self.edge(bad).or_else(|| self.noise(bad));
                found.extend(line.or_else(|| self.unmoved(bad)));
            }
        }
        found
    }

    /// `in 3 of 8 cycles`.
    fn of(&self, count: u64) -> String {
        match self.cycles {
            1 => "in the one cycle".into(),
            all => format!("in {count} of {all} cycles"),
        }
    }

    fn absent(&self, bad: &Bad, enough: u64) -> Option<Diagnosis> {
        let all = bad.silent == self.cycles && bad.silent >= enough && bad.better.is_none();
        let all = all && !bad.recovered && bad.turned.is_none();
        all.then(|| Diagnosis {
            cause: Cause::NoEncoder,
            text: format!(
                "SL is high and never moves, {} clocks long, {}: no encoder, no power, or MA does not arrive (pair cut or swapped)",
                bad.clocks,
                self.of(bad.silent)
            ),
            count: bad.silent,
            advice: match self.setup.clock {
                Some(_) => "look at supply and plug, swap the two wires of MA",
                None => "see whether slo= is the right channel",
            },
            remedy: match self.setup.clock {
                Some(_) => Remedy::Options(vec![("--wait", "30s".into())]),
                None => Remedy::Draw,
            },
        })
    }

    fn ma_upside_down(&self, bad: &Bad) -> Option<Diagnosis> {
        let (good, frames) = bad.turned?;
        Some(Diagnosis {
            cause: Cause::MaSwapped,
            text: format!(
                "SL is high and never moves {}, and with MA upside down {good} of {frames} are good: the MA pair is swapped",
                self.of(bad.silent)
            ),
            count: bad.silent,
            advice: "swap the two wires of MA",
            remedy: Remedy::Again,
        })
    }

    fn low(&self, bad: &Bad, enough: u64) -> Option<Diagnosis> {
        let all = bad.low == self.cycles && bad.low >= enough && !bad.recovered;
        let waited = match bad.waited_ns {
            Some(ns) => format!(
                "SL is low at rest, {:.0} us long and after INIT too, {}",
                ns as f64 / 1000.0,
                self.of(bad.low)
            ),
            None => format!("SL is low and never moves, {}", self.of(bad.low)),
        };
        all.then(|| Diagnosis {
            cause: Cause::SloLow,
            text: format!("{waited}: no power, SLO pair swapped, or SLO shorted"),
            count: bad.low,
            advice: match self.setup.clock {
                Some(_) => "look at the supply, swap the two wires of SLO",
                None => "see whether slo= is the right channel",
            },
            remedy: match self.setup.clock {
                Some(_) => Remedy::Options(vec![("--wait", "30s".into())]),
                None => Remedy::Draw,
            },
        })
    }

    fn upside_down(&self, bad: &Bad) -> Option<Diagnosis> {
        let all = bad.upset > 0 && self.good == 0;
        let proven = all && bad.upside.fit_inverted(&self.setup.protocol.format);
        proven.then(|| Diagnosis {
            cause: Cause::SloSwapped,
            text: format!(
                "SL rests low {}, and upside down its bits pass every check: the SLO pair is swapped",
                self.of(bad.upset)
            ),
            count: bad.upset,
            advice: "swap the two wires of SLO",
            remedy: Remedy::Again,
        })
    }

    fn lost(&self, bad: &Bad) -> Option<Diagnosis> {
        let silent = bad.row_silent == bad.row;
        let low = bad.row_low == bad.row;
        let gone = self.good > 0 && bad.row >= ROW && (silent || low);
        let level = if silent { "high" } else { "low" };
        gone.then(|| Diagnosis {
            cause: Cause::Lost,
            text: format!(
                "{} good frames, then SL stayed {level} in the last {} cycles: the encoder, its supply or a wire has gone",
                self.good, bad.row
            ),
            count: bad.row,
            advice: "look at plug and supply",
            remedy: match self.setup.clock {
                Some(_) => Remedy::Options(vec![("--wait", "30s".into())]),
                None => Remedy::Draw,
            },
        })
    }

    fn busy(&self, bad: &Bad) -> Option<Diagnosis> {
        let period_ns = u64::from(bad.period_ns?);
        let limit_ns = u64::from(self.setup.protocol.busy_limit_ns);
        let seen = bad.start_after.map(|clocks| u64::from(clocks) * period_ns);
        let next_ns = seen.map_or(2 * limit_ns, |ns| ns + ns / 4);
        let came = seen.map_or_else(
            || {
                format!(
                    "did not within {} clocks: busy for longer than --busy-limit, {}, or SLO is held low",
                    bad.start_clocks,
                    Nanos(limit_ns)
                )
            },
            |ns| {
                format!(
                    "only after {:.1} us: --busy-limit is {}",
                    ns as f64 / 1000.0,
                    Nanos(limit_ns)
                )
            },
        );
        let most = bad.no_start > 0 && 4 * bad.no_start >= bad.cycles;
        (most && self.edge(bad).is_none()).then(|| Diagnosis {
            cause: Cause::Busy,
            text: format!(
                "{} Ack came and the start bit {came}",
                self.of(bad.no_start)
            ),
            count: bad.no_start,
            advice: "",
            remedy: Remedy::Options(vec![("--busy-limit", micros(next_ns))]),
        })
    }

    fn late_ack(&self, bad: &Bad) -> Option<Diagnosis> {
        let after_ns = u64::from(bad.ack_after) * u64::from(bad.period_ns?);
        let most = bad.late > 0 && 4 * bad.late >= bad.cycles;
        (most && self.edge(bad).is_none()).then(|| Diagnosis {
            cause: Cause::LateAck,
            text: format!(
                "{} Ack came only after {:.1} us: --ack-limit is {}",
                self.of(bad.late),
                after_ns as f64 / 1000.0,
                Nanos(self.setup.protocol.ack_limit_ns.into())
            ),
            count: bad.late,
            advice: "",
            remedy: Remedy::Options(vec![("--ack-limit", micros(after_ns + after_ns / 4))]),
        })
    }

    fn pause(&self, bad: &Bad) -> Option<Diagnosis> {
        let (level, limit_ns) = bad.longest?;
        let limit = match self.setup.protocol.stall {
            Stall::Static { .. } => "the shortest timeout of --timeout",
            Stall::Adaptive => "the adaptive timeout that these clocks set",
            Stall::Unknown => "as no --timeout is given, two clocks, 12 us at most",
        };
        let us = |ns: u32| f64::from(ns) / 1000.0;
        let (advice, remedy) = match self.setup.clock {
            Some(_) => (
                "another program had the processor",
                Remedy::Options(vec![("--rt", "50".into())]),
            ),
            None => ("the master that was recorded pauses", Remedy::Draw),
        };
        (bad.stalls > 0).then(|| Diagnosis {
            cause: Cause::Pause,
            text: format!(
                "{} MA stood still inside the frame, up to {:.1} us at clock {}, where the encoder may have begun a new one after {:.1} us ({limit})",
                self.of(bad.stalls),
                us(level.ns),
                level.edge,
                us(limit_ns)
            ),
            count: bad.stalls,
            advice,
            remedy,
        })
    }

    fn clock(&self, bad: &Bad) -> Option<Diagnosis> {
        let most = 2 * bad.cycles >= self.cycles;
        let to = |hz: Hertz| Remedy::Options(vec![("--clock", hz.to_string())]);
        let now = self.setup.clock;
        let edge = self.edge(bad).is_some();
        let better = bad.better.filter(|_| most && !edge);
        if let (Some(now), Some((hz, good, frames))) = (now, better) {
            let way = if hz < now { "fast" } else { "slow" };
            return Some(Diagnosis {
                cause: Cause::Clock,
                text: format!(
                    "MA at {now} is too {way} for this encoder or line: {} bad, and {good} of {frames} good at {hz}",
                    self.of(bad.cycles)
                ),
                count: bad.cycles,
                advice: "",
                remedy: to(hz),
            });
        }
        let measured = bad.period_ns.map(|ns| Hertz(1_000_000_000 / ns.max(1)));
        let runs = now.or(measured)?;
        if bad.slow > 0 {
            return Some(Diagnosis {
                cause: Cause::Clock,
                text: format!(
                    "{} a level of MA or a clock is as long as some encoders wait for the end of a frame: at {runs} that is the clock itself",
                    self.of(bad.slow)
                ),
                count: bad.slow,
                advice: match now {
                    Some(_) => "",
                    None => "where the data sheet gives a longer timeout, say --timeout",
                },
                remedy: now.map_or(Remedy::Draw, |_| to(limits::CLOCK_FIRST)),
            });
        }
        let preset = self.setup.preset?;
        let outside = preset.clock_outside(runs).filter(|_| most)?;
        Some(Diagnosis {
            cause: Cause::Clock,
            text: format!("{outside}, and frames are bad {}", self.of(bad.cycles)),
            count: bad.cycles,
            advice: "",
            remedy: now.map_or(Remedy::Draw, |now| to(preset.clock_near(now))),
        })
    }

    /// Frames of this format are so rare that chance can make them.
    fn is_strange(&self, bad: &Bad) -> bool {
        3 * self.good < bad.wrong
    }

    fn other_format(&self, bad: &Bad) -> Option<Diagnosis> {
        if !self.is_strange(bad) {
            return None;
        }
        let format = &self.setup.protocol.format;
        let found = bad.samples.fit(format)?;
        let bits = |format: &Format| format.bits();
        let same_crc = format
            .channels()
            .iter()
            .zip(found.channels())
            .all(|(asked, found)| asked.crc() == found.crc());
        let (cause, what) = match (same_crc, bits(&found).cmp(&bits(format))) {
            (true, std::cmp::Ordering::Greater) => (
                Cause::Frame,
                format!(
                    "the frame is {} bits longer than -f says",
                    bits(&found) - bits(format)
                ),
            ),
            (true, _) => (
                Cause::Frame,
                format!(
                    "the frame is {} bits shorter than -f says",
                    bits(format) - bits(&found)
                ),
            ),
            (false, _) => (Cause::Crc, "the CRC is another one than -f says".into()),
        };
        let what = what.replace(" 1 bits ", " 1 bit ");
        Some(Diagnosis {
            cause,
            text: format!(
                "{what}: bad {}, and the last {} pass with {found}",
                self.of(bad.wrong),
                bad.samples.len()
            ),
            count: bad.wrong,
            advice: "",
            remedy: Remedy::Options(vec![("--frame", found.to_string())]),
        })
    }

    fn unmoved(&self, bad: &Bad) -> Option<Diagnosis> {
        let all = self.good == 0 && bad.wrong == self.cycles && bad.samples.alike();
        all.then(|| Diagnosis {
            cause: Cause::Unmoved,
            text: format!(
                "all frames fail, and the last {} are the same bit for bit: that is no noise, and too little to tell what else",
                bad.samples.len()
            ),
            count: bad.wrong,
            advice: "turn the encoder a little while it is read",
            remedy: Remedy::Options(vec![("--count", "100".into())]),
        })
    }

    fn gaps(&self, bad: &Bad) -> Option<Diagnosis> {
        let restarts = &bad.restarts;
        restarts.are_certain(bad.wrong).then(|| Diagnosis {
            cause: Cause::Gaps,
            text: format!(
                "{} the encoder began a new frame with a byte of the transfer, the first time with byte {}: MA stands between two bytes longer than its timeout",
                self.of(restarts.frames),
                restarts.byte + 1
            ),
            count: restarts.frames,
            advice: "long transfers go by DMA, on the bcm2835 without gaps; or let MOSI be MA, with wave:",
            remedy: Remedy::Key("pad", "90".into()),
        })
    }

    fn edge(&self, bad: &Bad) -> Option<Diagnosis> {
        let spoilt = bad.wrong + bad.moved;
        let wavers = self.delays.two().filter(|[often, rarely]| {
            // Ack is one edge of many: where it wavers much, the others do.
            let much = rarely.1 >= 4 && 10 * rarely.1 >= often.1 && spoilt >= 4;
            let some = rarely.1 >= 3 && bad.flips.are_late();
            (much || some) && !self.is_noisy(bad)
        });
        let seen = match wavers {
            Some([often, rarely]) => format!(
                "Ack came {} late in {} frames and {} in {}",
                clocks(often.0),
                often.1,
                rarely.0,
                rarely.1
            ),
            None if bad.flips.are_surely_late() => format!(
                "all wrong bits of {} frames are like the bit before or behind them",
                bad.flips.single
            ),
            None => return None,
        };
        let remedy = match (self.setup.mode, self.setup.clock) {
            (Some(2), _) => Remedy::Key("phase", "3".into()),
            (Some(_), _) => Remedy::Key("phase", "2".into()),
            (None, Some(now)) => {
                let slower = bad.better.map_or(Hertz(now.0 / 4 * 3), |(hz, ..)| hz);
                Remedy::Options(vec![("--clock", slower.to_string())])
            }
            (None, None) => Remedy::Draw,
        };
        Some(Diagnosis {
            cause: Cause::Edge,
            text: format!(
                "SL changes where it is sampled: {seen}, bad {}",
                self.of(spoilt)
            ),
            count: spoilt,
            advice: "",
            remedy,
        })
    }

    fn is_noisy(&self, bad: &Bad) -> bool {
        3 * self.good > bad.wrong && bad.flips.are_noise()
    }

    fn noise(&self, bad: &Bad) -> Option<Diagnosis> {
        let flips = &bad.flips;
        let bits = self.cycles * u64::from(self.setup.protocol.format.bits());
        let every = bits / (flips.single + 2 * flips.other).max(1);
        let lower = self.setup.clock.map(|now| Hertz(now.0 / 2));
        self.is_noisy(bad).then(|| Diagnosis {
            cause: Cause::Noise,
            text: format!(
                "noise on the line: {} of {} bad frames have one wrong bit, here and there, about one of {} bits in all",
                flips.single,
                flips.single + flips.other,
                rounded(every)
            ),
            count: flips.single,
            advice: "look at termination, shield and ground",
            remedy: lower.map_or(Remedy::Draw, |hz| {
                Remedy::Options(vec![("--clock", hz.to_string())])
            }),
        })
    }

    /// The next frames that would decide, on a line that is not a recording, after the run.
    pub fn next_trial(&mut self) -> Option<Trial> {
        let plan = self.plan();
        let bad = self.bad.as_deref_mut()?;
        let trials = bad.trials.get_or_insert(plan);
        if bad.better.is_some() {
            trials.clear();
        }
        trials.pop_front()
    }

    fn plan(&self) -> VecDeque<Trial> {
        let (Some(bad), Some(now)) = (self.bad.as_deref(), self.setup.clock) else {
            return VecDeque::new();
        };
        if 4 * self.good > self.cycles {
            return VecDeque::new();
        }
        let first = [limits::CLOCK_FIRST, Hertz(250_000)];
        let at = |hz: Hertz| Trial {
            clock: Some(hz),
            upside_down: false,
            surplus: None,
            frames: TRIAL_FRAMES,
        };
        let same = |surplus: Option<u16>| Trial {
            clock: None,
            upside_down: false,
            surplus,
            frames: TRIAL_FRAMES,
        };
        let preset = self.setup.preset;
        let allowed = |hz: &Hertz| preset.is_none_or(|preset| preset.clock_outside(*hz).is_none());
        if bad.low == self.cycles {
            return VecDeque::from([same(None)]);
        }
        if bad.silent == self.cycles {
            let apart = |hz: &Hertz| hz.0 >= now.0 / 2 * 3 || hz.0 <= now.0 / 3 * 2;
            let others = first.into_iter().filter(apart).filter(allowed).map(at);
            let turned = Trial {
                upside_down: true,
                ..same(None)
            };
            let first = std::iter::once(same(None));
            return first.chain(others).chain([turned]).collect();
        }
        if 2 * bad.wrong < self.cycles || self.gaps(bad).is_some() {
            return VecDeque::new();
        }
        // Down to what every encoder has to bear.
        let slower = [Hertz(now.0 / 2), Hertz(now.0 / 4), first[0], first[1]];
        let slower = slower
            .into_iter()
            .filter(|hz| *hz < now && *hz >= first[1])
            .filter(allowed)
            .map(at);
        let longer = same(Some(TRIAL_SURPLUS));
        std::iter::once(longer).chain(slower).collect()
    }

    /// A cycle of a trial with more clocks.
    pub fn show(&mut self, trace: &Trace) {
        if let Some(bad) = &mut self.bad {
            bad.samples.add(trace);
        }
    }

    /// What a trial came to: the clock that it ran at, and how many frames were good.
    pub fn tried(&mut self, trial: &Trial, hz: Hertz, good: u32) {
        let format = &self.setup.protocol.format;
        let Some(bad) = &mut self.bad else { return };
        if trial.upside_down {
            let most = good >= trial.frames - trial.frames / 16;
            bad.turned = Some((good, trial.frames)).filter(|_| most);
            return;
        }
        match trial.clock {
            Some(_) if good >= trial.frames - trial.frames / 16 => {
                bad.better = Some((hz, good, trial.frames));
            }
            Some(_) => {}
            None => {
                // What was bad in the run is no matter of the clock.
                let most = match trial.surplus {
                    Some(_) => trial.frames / 4 * 3,
                    None => 1,
                };
                bad.recovered = good >= most;
                if bad.recovered || trial.surplus.is_some() && bad.samples.fit(format).is_some() {
                    bad.trials = Some(VecDeque::new());
                }
            }
        }
    }
}

impl Bad {
    fn not_ready(&mut self, trace: &Trace, waited_ns: Option<u64>) {
        if trace.bits.find(0, true).is_some() || trace.idle != Some(false) {
            self.upset += u64::from(trace.idle == Some(false));
            self.upside.add(trace);
            return;
        }
        self.low += 1;
        self.row_low += 1;
        self.waited_ns = self.waited_ns.max(waited_ns);
    }

    fn no_ack(&mut self, trace: &Trace, clocks: u16) {
        match trace.bits.find(0, false) {
            None => {
                self.silent += 1;
                self.row_silent += 1;
                self.clocks = self.clocks.max(clocks);
            }
            Some(ack_at) if ack_at > usize::from(clocks) => {
                self.late += 1;
                self.ack_after = self.ack_after.max(ack_at as u16 - 1);
            }
            Some(_) => {}
        }
    }

    fn no_start(&mut self, trace: &Trace, clocks: u16) {
        let ack_at = trace.bits.find(1, false);
        let start_at = ack_at.and_then(|at| trace.bits.find(at, true));
        let after = start_at
            .zip(ack_at)
            .map(|(start, ack)| (start - ack) as u16);
        self.no_start += 1;
        self.start_clocks = self.start_clocks.max(clocks);
        self.start_after = self.start_after.max(after);
    }

    fn stalled(&mut self, trace: &Trace, level: Level, limit_ns: u32) {
        let of_clock = |period: u32| level.ns <= period.saturating_add(period / 4);
        if trace.ma_period_ns.is_some_and(of_clock) {
            self.slow += 1;
            return;
        }
        self.stalls += 1;
        if self
            .longest
            .is_none_or(|(longest, _)| level.ns > longest.ns)
        {
            self.longest = Some((level, limit_ns));
        }
    }
}

fn clocks(count: u16) -> String {
    match count {
        1 => "1 clock".into(),
        _ => format!("{count} clocks"),
    }
}

/// Whole microseconds, upwards.
fn micros(ns: u64) -> String {
    Nanos(ns.div_ceil(1_000) * 1_000).to_string()
}

/// Two digits of it.
fn rounded(value: u64) -> u64 {
    let mut scale = 1;
    while value / scale >= 100 {
        scale *= 10;
    }
    value / scale * scale
}
