//! What a cycle came to, whatever the protocol: a head and words, or named faults.

use crate::format::MAX_CHANNELS;
use std::fmt;

/// What the wire said wrong. Every number is what was seen, in the unit of its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// SL was 0 before the frame, or at its first edge. Slave not powered or not initialised; line stuck low.
    NotReady {
        /// How long SL = 1 was awaited.
        waited_ns: Option<u64>,
    },
    /// SL never fell. No encoder, no power, or the MA pair swapped or cut.
    NoAck {
        /// Clocks searched from edge 2.
        clocks: u16,
    },
    /// SL fell and did not rise again. Encoder busy beyond the limit, or line stuck low.
    NoStart {
        /// Clocks searched from the Ack edge.
        clocks: u16,
    },
    /// The frame ended before its last bit. Too few clocks, or a recording that begins or ends inside it.
    Short {
        /// SL levels there are, LAT included.
        have_bits: u16,
        /// SL levels this frame needs.
        want_bits: u16,
    },
    /// The CRC does not belong to the data. Noise, sampling at the wrong time, or a wrong frame format.
    Crc {
        /// As received.
        got: u16,
        /// As computed from the received data.
        want: u16,
    },
    /// The stop bit or a surplus clock read 1. Wrong frame format, or a frame that restarted underway.
    Stop {
        /// The rising edge that set it, counted from 1.
        clock: u16,
    },
    /// All data bits are 0 in a channel with nE or nW: the slave's own "no valid data" (D2, p. 13).
    Null,
    /// MA stood still for so long that the slave may have timed out and begun a new frame.
    Stalled {
        /// Upper bound of the level or period.
        level_ns: u32,
        /// What was allowed.
        limit_ns: u32,
        /// The rising edge that ended it; 0 where the pause was before the first one.
        edge: u16,
    },
    /// The sign-of-life counter did not count on: the encoder repeats itself, or frames are lost.
    Life {
        /// As received.
        got: u64,
        /// The next one after the last.
        want: u64,
    },
    /// Clocks from edge 2 to the start bit differ from what this encoder has shown: the start bit, which nothing on
    /// the wire protects, may be a flipped bit.
    Mismatch {
        /// Clocks from edge 2 to the start edge in this frame.
        head: u16,
        /// Least learned.
        low: u16,
        /// Most learned.
        high: u16,
    },
    /// The line delay differs by more than a clock from what this line has shown: what answered may be an earlier
    /// frame, or a bit of one.
    Delay {
        /// In this frame.
        ns: u32,
        /// Learned.
        learned_ns: u32,
    },
    /// The two positions of a safety pair do not agree; each came with a good CRC.
    Pair {
        /// Of the control position word, in steps of 1/2^`acc_bits`; turns that both have count above.
        cpw: u64,
        /// Of the safety position word, likewise.
        spw: u64,
        /// Bits of the position that were compared.
        acc_bits: u8,
    },
}

impl Fault {
    /// Its name in every output.
    pub fn name(&self) -> &'static str {
        Fault::NAMES[self.index()]
    }

    /// All names, in the order of [`Fault::index`].
    pub const NAMES: [&'static str; 10] = [
        "not-ready",
        "no-ack",
        "no-start",
        "short",
        "crc",
        "stop",
        "null",
        "stalled",
        "lc",
        "mismatch",
    ];

    /// A number for counting.
    pub fn index(&self) -> usize {
        match self {
            Fault::NotReady { .. } => 0,
            Fault::NoAck { .. } => 1,
            Fault::NoStart { .. } => 2,
            Fault::Short { .. } => 3,
            Fault::Crc { .. } => 4,
            Fault::Stop { .. } => 5,
            Fault::Null => 6,
            Fault::Stalled { .. } => 7,
            Fault::Life { .. } => 8,
            Fault::Mismatch { .. } | Fault::Delay { .. } | Fault::Pair { .. } => 9,
        }
    }

    /// Its numbers under their names.
    pub fn numbers(&self) -> impl Iterator<Item = (&'static str, u64)> {
        let list: [Option<(&'static str, u64)>; 3] = match *self {
            Fault::NotReady { waited_ns } => [waited_ns.map(|ns| ("waited_ns", ns)), None, None],
            Fault::NoAck { clocks } | Fault::NoStart { clocks } => {
                [Some(("clocks", clocks.into())), None, None]
            }
            Fault::Short {
                have_bits,
                want_bits,
            } => [
                Some(("have_bits", have_bits.into())),
                Some(("want_bits", want_bits.into())),
                None,
            ],
            Fault::Crc { got, want } => {
                [Some(("got", got.into())), Some(("want", want.into())), None]
            }
            Fault::Stop { clock } => [Some(("clock", clock.into())), None, None],
            Fault::Null => [None; 3],
            Fault::Stalled {
                level_ns,
                limit_ns,
                edge,
            } => [
                Some(("level_ns", level_ns.into())),
                Some(("limit_ns", limit_ns.into())),
                Some(("edge", edge.into())),
            ],
            Fault::Life { got, want } => [Some(("got", got)), Some(("want", want)), None],
            Fault::Mismatch { head, low, high } => [
                Some(("head_clk", head.into())),
                Some(("min_clk", low.into())),
                Some(("max_clk", high.into())),
            ],
            // The frame's own stands in its record.
            Fault::Delay { learned_ns, .. } => {
                [Some(("learned_ns", learned_ns.into())), None, None]
            }
            Fault::Pair { cpw, spw, acc_bits } => [
                Some(("cpw", cpw)),
                Some(("spw", spw)),
                Some(("acc_bits", acc_bits.into())),
            ],
        };
        list.into_iter().flatten()
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())?;
        let us = |ns: u64| ns as f64 / 1000.0;
        match *self {
            Fault::NotReady {
                waited_ns: Some(ns),
            } => write!(f, ": SL still low after {:.1} us", us(ns)),
            Fault::NotReady { waited_ns: None } => f.write_str(": SL low before the frame"),
            Fault::NoAck { clocks } => write!(f, ": SL still high after {clocks} clocks"),
            Fault::NoStart { clocks } => write!(f, ": SL still low {clocks} clocks after Ack"),
            Fault::Short {
                have_bits,
                want_bits,
            } => write!(f, ": {have_bits} of {want_bits} bits"),
            Fault::Crc { got, want } => write!(f, ": got {got:#04x}, want {want:#04x}"),
            Fault::Stop { clock } => {
                write!(f, ": SL high at clock {clock}, after the last data bit")
            }
            Fault::Null => f.write_str(": the encoder says it has no valid data"),
            Fault::Stalled {
                level_ns, edge: 0, ..
            } => {
                write!(
                    f,
                    ": MA stood {:.1} us before clock 1, while an Ack was on its way",
                    us(level_ns.into())
                )
            }
            Fault::Stalled {
                level_ns,
                limit_ns,
                edge,
            } => write!(
                f,
                ": MA stood up to {:.1} us at clock {edge}, limit {:.1} us",
                us(level_ns.into()),
                us(limit_ns.into())
            ),
            Fault::Life { got, want } => write!(f, ": got {got}, want {want}"),
            Fault::Mismatch { head, low, high } => {
                write!(
                    f,
                    ": start bit at clock {}, learned {} to {}",
                    head + 2,
                    low + 2,
                    high + 2
                )
            }
            Fault::Delay { ns, learned_ns } => write!(
                f,
                ": line delay {:.2} us, learned {:.2} us",
                us(ns.into()),
                us(learned_ns.into())
            ),
            Fault::Pair { cpw, spw, acc_bits } => write!(
                f,
                ": CPW at {cpw}, SPW at {spw}, compared to {acc_bits} bits"
            ),
        }
    }
}

/// What a frame says before its data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Head {
    /// Whole clocks of line delay: from edge 2 to the sample that first reads 0.
    pub delay_clk: u16,
    /// Clocks from the Ack edge to the start edge, at least 1.
    pub ack: u16,
    /// The control bit of the slave.
    pub cds: bool,
}

impl Head {
    /// Clocks from edge 2 to the start edge.
    pub fn clocks(&self) -> u16 {
        self.delay_clk + self.ack
    }
}

/// One channel as it was received: raw bits, and a verdict.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Word {
    data: u64,
    crc: u16,
    fault: Option<Fault>,
}

impl Word {
    /// The data word, only if nothing was wrong with it. In a channel with a CRC, that was good.
    pub fn good(&self) -> Option<u64> {
        self.fault.is_none().then_some(self.data)
    }

    /// What was wrong with it.
    pub fn fault(&self) -> Option<Fault> {
        self.fault
    }

    /// The bits as received, data and CRC, whatever they are worth: for looking at, never a position.
    pub fn raw(&self) -> (u64, u16) {
        (self.data, self.crc)
    }

    /// As received, with what was found wrong.
    pub(crate) fn received(data: u64, crc: u16, fault: Option<Fault>) -> Word {
        Word { data, crc, fault }
    }

    pub(crate) fn spoil(&mut self, fault: Fault) {
        self.fault = Some(fault);
    }
}

/// A decoded cycle: a fault of its own, or a head and one word per channel. Reused from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct Cycle {
    /// What spoils the whole cycle; then there are no words.
    fault: Option<Fault>,
    head: Option<Head>,
    words: [Word; MAX_CHANNELS],
    channels: u8,
}

impl Cycle {
    /// The fault of the whole cycle.
    pub fn fault(&self) -> Option<Fault> {
        self.fault
    }

    /// Ack, start and CDS, where they were found.
    pub fn head(&self) -> Option<Head> {
        self.head
    }

    /// One word per channel in wire order; none when the cycle itself is a fault.
    pub fn words(&self) -> &[Word] {
        &self.words[..usize::from(self.channels)]
    }

    pub(crate) fn words_mut(&mut self) -> &mut [Word] {
        &mut self.words[..usize::from(self.channels)]
    }

    /// Whether everything in it is good.
    pub fn is_good(&self) -> bool {
        self.fault.is_none() && self.words().iter().all(|w| w.fault.is_none())
    }

    /// Makes the whole cycle a fault; its words are gone.
    pub fn spoil(&mut self, fault: Fault) {
        self.fault = Some(fault);
        self.channels = 0;
    }

    /// Forgets the cycle before.
    pub(crate) fn reset(&mut self) {
        // Words that are not counted are not shown.
        (self.fault, self.head, self.channels) = (None, None, 0);
    }

    /// Ack, start and CDS were found.
    pub(crate) fn found(&mut self, head: Head) {
        self.head = Some(head);
    }

    /// So many channels, still without words.
    pub(crate) fn open(&mut self, channels: usize) -> &mut [Word] {
        self.channels = channels.min(MAX_CHANNELS) as u8;
        self.words_mut()
    }
}
