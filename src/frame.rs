//! BiSS-C: a trace becomes a head and words, or a named fault; and the inverse.
//!
//! A frame after rising edge 1, 2, 3 … reads `1 0…0 1 CDS channel… 0` (D2, p. 5-7): LAT, Ack from edge 2 plus
//! the line delay, start, CDS, each channel's data and CRC, stop.

use crate::cycle::{Cycle, Fault, Head, Word};
use crate::format::{Channel, Format};
use crate::limits;
use crate::parse::ParseError;
use crate::protocol::{Ability, Protocol};
use crate::trace::{Bits, Clocks, Cut, MAX_CLOCKS, Trace, Until};
use crate::unit::Nanos;
use std::fmt;
use std::str::FromStr;

/// From how long a level on MA a slave may have timed out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stall {
    /// The encoder is not known: 12 µs, two clocks and the frame's own adaptive reference, whichever is least.
    Unknown,
    /// A static timeout of at least this long.
    Static {
        /// The shortest timeout.
        min_ns: u32,
    },
    /// An adaptive timeout: the frame's own reference, at most 12 µs.
    Adaptive,
}

/// How an encoder finds the end of a frame, as users say it: `12us`, `12us..40us`, `adaptive`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timeout {
    /// How long a level on MA may last.
    pub stall: Stall,
    /// How long SL = 1 is awaited.
    pub max: Nanos,
}

impl FromStr for Timeout {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Timeout, ParseError> {
        const MAX: Nanos = Nanos(limits::TIMEOUT_MAX_NS);
        if text == "adaptive" {
            return Ok(Timeout {
                stall: Stall::Adaptive,
                max: MAX,
            });
        }
        let (min, max) = Nanos::range(text)?;
        if min.0 == 0 {
            return Err(ParseError::usage(
                text,
                "a timeout of 0 ends every frame at once",
                "write it like 12us..40us",
            ));
        }
        let min_ns = u32::try_from(min.0).unwrap_or(u32::MAX);
        Ok(Timeout {
            stall: Stall::Static { min_ns },
            max: max.unwrap_or(min.max(MAX)),
        })
    }
}

impl fmt::Display for Timeout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let min_ns = match self.stall {
            Stall::Adaptive => return f.write_str("adaptive"),
            Stall::Static { min_ns } => min_ns.into(),
            Stall::Unknown => limits::TIMEOUT_MIN_NS,
        };
        write!(f, "{}..{}", Nanos(min_ns), self.max)
    }
}

/// [`limits::LEVEL_MAX_NS`] as levels are counted.
const LEVEL_MAX_NS: u32 = limits::LEVEL_MAX_NS as u32;

/// BiSS-C with the limits that hold for this encoder.
#[derive(Clone, Debug)]
pub struct BissC {
    /// What follows CDS.
    pub format: Format,
    /// Longest line delay: edge 2 to Ack (D2 Table 10: 40 µs).
    pub ack_limit_ns: u32,
    /// Longest processing time: Ack to start (D2 Table 10: 40 µs).
    pub busy_limit_ns: u32,
    /// When a frame counts as stalled.
    pub stall: Stall,
    /// Longest timeout of the slave (D2 Table 10: 40 µs).
    pub timeout_max_ns: u32,
    /// Read Ack, start and CDS only, and leave the channels in the slave: their format need not be known, and a frame may
    /// be ended anywhere (D2, p. 12).
    pub head_only: bool,
    /// Rising edges of each cycle, whatever comes; `None` clocks as many as the frame needs.
    pub clocks: Option<u16>,
    /// Clocks after the stop bit that have to read 0; `None` clocks as many as the link needs.
    pub surplus: Option<u16>,
}

impl BissC {
    /// The specification's limits for a frame of this format.
    pub fn new(format: Format) -> BissC {
        BissC {
            format,
            ack_limit_ns: limits::LINE_DELAY_MAX_NS as u32,
            busy_limit_ns: limits::BUSY_MAX_NS as u32,
            stall: Stall::Unknown,
            timeout_max_ns: limits::TIMEOUT_MAX_NS as u32,
            head_only: false,
            clocks: None,
            surplus: None,
        }
    }

    /// For control communication with an encoder whose frame is not known.
    pub fn head_only() -> BissC {
        BissC {
            head_only: true,
            ..BissC::new(Format::default())
        }
    }

    /// Rising edges after the start edge: CDS, all channels, stop. With the head only one more than CDS, so that CDM can
    /// depend on it.
    fn tail(&self) -> u16 {
        2 + if self.head_only {
            0
        } else {
            self.format.bits()
        }
    }

    /// Clocks after the stop bit.
    fn surplus(&self) -> u16 {
        match self.surplus {
            _ if self.head_only => 0,
            Some(asked) => asked,
            None => SURPLUS,
        }
    }

    /// How long SL = 1 is awaited after the last MA edge.
    fn ready_ns(&self, ability: &Ability) -> u32 {
        let delay = match ability.delay_clk {
            Some(clocks) => (u32::from(clocks) + 1).saturating_mul(ability.period_ns),
            None => self.ack_limit_ns,
        };
        self.timeout_max_ns.saturating_add(delay)
    }

    /// Bits of the shortest possible frame: LAT, Ack, start, then the tail.
    fn least_bits(&self) -> u16 {
        3 + self.tail()
    }

    fn stall_limit_ns(&self, trace: &Trace) -> u32 {
        let reference = trace.reference_ns.unwrap_or(u32::MAX);
        match self.stall {
            Stall::Static { min_ns } => min_ns,
            Stall::Adaptive => LEVEL_MAX_NS.min(reference),
            Stall::Unknown => {
                let two_clocks = trace
                    .ma_period_ns
                    .map_or(u32::MAX, |period| period.saturating_mul(2));
                LEVEL_MAX_NS.min(reference).min(two_clocks)
            }
        }
    }

    /// MA stood still for too long for the slave, or for a bit to be told from the next one.
    fn stalled(&self, trace: &Trace) -> Option<Fault> {
        if let Some(level) = trace.longest {
            let limit_ns = self.stall_limit_ns(trace);
            if level.ns > limit_ns {
                return Some(Fault::Stalled {
                    level_ns: level.ns,
                    limit_ns,
                    edge: level.edge,
                });
            }
        }
        // The sampling phase keeps a quarter of a clock to the next bit; half of that is left to calls that take
        // longer than usual. Nothing on the wire protects the start bit from being read twice.
        let (late, period) = (trace.late?, trace.ma_period_ns?);
        let limit_ns = period.saturating_add(period / 8);
        let level_ns = period.saturating_add(late.ns);
        (level_ns > limit_ns).then_some(Fault::Stalled {
            level_ns,
            limit_ns,
            edge: late.edge,
        })
    }

    /// Ack, start and CDS where they stand in most frames, a word at a time; `None` where [`BissC::head`] has to look.
    #[inline]
    fn usual_head(&self, trace: &Trace) -> Option<(Head, usize)> {
        let bits = &trace.bits;
        let first = bits.chunk(0);
        let ack_at = first.leading_ones();
        let ack = (first << (ack_at % 64)).leading_zeros();
        let start_at = (ack_at + ack) as usize;
        let few = limits::BUSY_CLOCKS.into();
        let near = (1..=few + 1).contains(&ack_at) && ack <= few;
        let whole = bits.len() > start_at + usize::from(self.tail()) + usize::from(trace.surplus);
        let plain = trace.cut.is_none()
            && trace.idle != Some(false)
            && trace.misplaced_ns.is_none()
            && trace.late.is_none()
            && trace.delay_ns.is_none_or(|ns| {
                u64::from(ns) <= u64::from(limits::BUSY_CLOCKS).saturating_mul(period(trace))
            })
            && trace
                .longest
                .is_none_or(|level| level.ns <= self.stall_limit_ns(trace));
        if !(near && whole && plain) {
            return None;
        }
        let head = Head {
            delay_clk: ack_at as u16 - 1,
            ack: ack as u16,
            cds: first << (start_at + 1) >> 63 == 1,
        };
        Some((head, start_at + 2))
    }

    #[inline(never)]
    fn head(&self, trace: &Trace) -> Result<(Head, usize), Fault> {
        let bits = &trace.bits;
        let have = bits.len() as u16;
        let short = |want: u16| Fault::Short {
            have_bits: have,
            want_bits: want,
        };
        if trace.cut == Some(Cut::Begin) {
            return Err(short(self.least_bits().max(have.saturating_add(1))));
        }
        if trace.idle == Some(false) || bits.get(0) == Some(false) {
            return Err(Fault::NotReady {
                waited_ns: trace.waited_ns,
            });
        }
        // A frame in which MA stood still shows nothing, not even that nobody answers.
        if let Some(fault) = self.stalled(trace) {
            return Err(fault);
        }
        if let Some(level_ns) = trace.misplaced_ns {
            return Err(Fault::Stalled {
                level_ns,
                limit_ns: self.stall_limit_ns(trace),
                edge: 0,
            });
        }
        let whole = have >= self.least_bits();
        // What had time to come yet may have come behind the end of the recording.
        let ended = trace.cut == Some(Cut::End);
        let ack_limit = search_clocks(self.ack_limit_ns, trace.ma_period_ns);
        let start_limit = search_clocks(self.busy_limit_ns, trace.ma_period_ns);
        let Some(ack_at) = bits.find(1, false) else {
            let clocks = have.saturating_sub(2);
            let enough = clocks >= ack_limit || whole && !ended;
            return Err(if enough {
                Fault::NoAck { clocks }
            } else {
                short(self.least_bits().max(have.saturating_add(1)))
            });
        };
        let delay_clk = (ack_at - 1) as u16;
        let late = trace
            .delay_ns
            .is_some_and(|ns| u64::from(ns) > u64::from(ack_limit) * period(trace));
        if delay_clk > ack_limit || late {
            return Err(Fault::NoAck { clocks: ack_limit });
        }
        let want = |head: u16| 2u16.saturating_add(head).saturating_add(self.tail());
        let Some(start_at) = bits.find(ack_at, true) else {
            let clocks = have - ack_at as u16 - 1;
            let enough = clocks >= start_limit || whole && !ended && clocks > limits::BUSY_CLOCKS;
            return Err(if enough {
                Fault::NoStart { clocks }
            } else {
                short(want(delay_clk + clocks + 1))
            });
        };
        let ack = (start_at - ack_at) as u16;
        if ack > start_limit {
            return Err(Fault::NoStart {
                clocks: start_limit,
            });
        }
        let want = want(delay_clk + ack).saturating_add(trace.surplus);
        if have < want {
            return Err(short(want));
        }
        let cds = bits.get(start_at + 1) == Some(true);
        Ok((
            Head {
                delay_clk,
                ack,
                cds,
            },
            start_at + 2,
        ))
    }
}

/// Clocks after the stop bit that are checked to be 0 on links that plan their clocks: a frame that began anew where
/// nobody looked passes 1.2 % of the time without them, 0.15 % with two (300 000 simulated restarts, CRC-6, 34 bits).
const SURPLUS: u16 = 2;

/// Without a clock there is no limit in time.
fn period(trace: &Trace) -> u64 {
    trace.ma_period_ns.map_or(u64::MAX >> 16, u64::from)
}

/// A time limit in clocks, eight at least; without a clock there is no limit.
fn search_clocks(limit_ns: u32, period_ns: Option<u32>) -> u16 {
    match period_ns {
        Some(period) if period > 0 => {
            (limit_ns.div_ceil(period)).clamp(limits::BUSY_CLOCKS.into(), MAX_CLOCKS as u32) as u16
        }
        _ => MAX_CLOCKS as u16,
    }
}

impl Protocol for BissC {
    fn format(&self) -> &Format {
        &self.format
    }

    fn request(&self, ability: &Ability) -> Clocks {
        let period = Some(ability.period_ns);
        let ack = search_clocks(self.ack_limit_ns, period);
        let start = search_clocks(self.busy_limit_ns, period);
        let until = if let Some(clocks) = self.clocks {
            Until::Clocks(clocks.min(MAX_CLOCKS as u16))
        } else if ability.reacts {
            Until::Frame {
                ack,
                start,
                then: self.tail() + self.surplus.unwrap_or(0),
            }
        } else {
            // Two more than must be there let the encoder's busy time wander.
            let most = ack.saturating_add(start);
            let head = ability.head.map_or(limits::BUSY_CLOCKS, |head| head + 2);
            let head = (u32::from(head) << ability.widen.min(8)).min(most.into()) as u16;
            Until::Clocks((2 + head + self.tail() + self.surplus()).min(MAX_CLOCKS as u16))
        };
        let stretch_ns = match self.stall {
            // A little less than the 12 µs in sum that stay below every static ceiling; not while bits may be under
            // way longer than a clock, when every level must be like the others.
            Stall::Adaptive if ability.reacts && ability.delay_clk == Some(0) => 11_000,
            _ => 0,
        };
        Clocks {
            until,
            surplus: self.surplus(),
            stretch_ns,
            cdm: [false; 2],
            hold_ns: self.timeout_max_ns.saturating_add(self.ack_limit_ns),
            ready_ns: Some(self.ready_ns(ability)),
            partial: self.head_only,
        }
    }

    /// INIT: two low pulses on MA, which then stays high (D2, p. 12 Fig 22).
    fn init(&self) -> Option<Clocks> {
        Some(Clocks {
            until: Until::Clocks(2),
            surplus: 0,
            stretch_ns: 0,
            cdm: [false; 2],
            hold_ns: 0,
            ready_ns: None,
            partial: true,
        })
    }

    /// Two clocks and the timeout (D2, p. 19).
    fn reduced(&self, ability: &Ability) -> Option<Clocks> {
        Some(Clocks {
            until: Until::Clocks(2),
            surplus: 0,
            stretch_ns: 0,
            partial: true,
            ..self.request(ability)
        })
    }

    fn decode_reduced(&self, trace: &Trace, cycle: &mut Cycle) {
        cycle.reset();
        if trace.idle == Some(false) || trace.bits.get(0) != Some(true) {
            return cycle.spoil(Fault::NotReady {
                waited_ns: trace.waited_ns,
            });
        }
        if let Some(fault) = self.stalled(trace) {
            cycle.spoil(fault);
        }
    }

    #[inline]
    fn decode(&self, trace: &Trace, cycle: &mut Cycle) {
        cycle.reset();
        let (head, data_at) = match self.usual_head(trace) {
            Some(found) => found,
            None => match self.head(trace) {
                Ok(found) => found,
                Err(fault) => return cycle.spoil(fault),
            },
        };
        cycle.found(head);
        if self.head_only {
            return;
        }
        let bits = &trace.bits;
        let stop_at = data_at + usize::from(self.format.bits());
        if let Some(high) = bits.find(stop_at, true) {
            return cycle.spoil(Fault::Stop {
                clock: high as u16 + 1,
            });
        }
        let channels = self.format.channels();
        let mut at = data_at;
        for (word, channel) in cycle.open(channels.len()).iter_mut().zip(channels) {
            *word = read_word(bits, at, channel);
            at += usize::from(channel.data_bits()) + usize::from(channel.crc_bits());
        }
    }
}

/// The bits are there: the stop bit, which comes later, is.
#[inline]
fn read_word(bits: &Bits, at: usize, channel: &Channel) -> Word {
    let (data_bits, crc) = (channel.data_bits(), channel.crc());
    let chunk = bits.chunk(at);
    let data = chunk >> (64 - u32::from(data_bits));
    let (got, want) = crc.map_or((0, 0), |crc| {
        let behind = if data_bits + crc.bits() <= 64 {
            chunk << data_bits
        } else {
            bits.chunk(at + usize::from(data_bits))
        };
        let got = (behind >> (64 - u32::from(crc.bits()))) as u16;
        (got, crc.of_all(data, data_bits))
    });
    let fault = if got != want {
        Some(Fault::Crc { got, want })
    } else if data == 0 && channel.has_null() {
        Some(Fault::Null)
    } else {
        None
    };
    Word::received(data, got, fault)
}

/// The inverse of decoding: the SL levels of a frame, from edge 1 to the stop bit.
///
/// `data` has one word per channel of `format`.
pub fn emit(format: &Format, head: Head, data: &[u64], bits: &mut Bits) {
    bits.clear();
    bits.push(true);
    bits.extend(std::iter::repeat_n(true, head.delay_clk.into()));
    bits.extend(std::iter::repeat_n(false, head.ack.into()));
    bits.push(true);
    bits.push(head.cds);
    for (channel, data) in format.channels().iter().zip(data) {
        let crc = channel
            .crc()
            .map_or(0, |c| c.of(*data, channel.data_bits()));
        bits.extend(
            (0..channel.data_bits())
                .rev()
                .map(|place| data >> place & 1 == 1),
        );
        bits.extend(
            (0..channel.crc_bits())
                .rev()
                .map(|place| crc >> place & 1 == 1),
        );
    }
    bits.push(false);
}
