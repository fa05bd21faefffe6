//! Control communication: registers and commands, one CDM bit out and one CDS bit in a frame (D2, p. 13-19).
//!
//! [`Control`] is the master's side as a pure machine. Before a frame it says which CDM to send, as a table over the CDS
//! of that very frame; after it, it is told what was seen. Sensor data flows on meanwhile.
//!
//! ```text
//! frame    0   1    2-4  5-11  12-15  16 17  18   19-26  27-30  31  32
//! CDM      S  CTS   ID   ADR    CRC   R  W   S    DATA    CRC   P   S of the next byte, or 0
//! CDS      0  IDL0  IDL1 …IDL8   0    0  R   W    S 19, DATA 20-27, CRC 28-31,   P 32
//! ```
//!
//! Before S at least 14 frames have CDM = 0. They are counted anew after every frame that was not whole: the slave may
//! have taken a bit of its own from it; and after every one with CDS = 1, which a slave at rest does not send. After a cut
//! the rest of a write is laid out so that no slave can take it for a byte that nobody wanted to write, wherever in the frame
//! it believes to be (see `quench`).

mod access;
mod exchange;
mod failure;
mod listen;
mod quench;

pub use access::{Access, Bytes};
pub use failure::Failure;
pub use listen::{Heard, Idl, Listener, Spoken};

use crate::crc::Crc;
use exchange::{Aim, Came, Exchange, Progress};
use quench::Quench;
use std::sync::OnceLock;

/// Frames with CDM = 0 before a control frame (C6, p. 9).
pub const REST_FRAMES: u8 = 14;

/// Bytes of one control frame at most (D2, p. 16).
pub const MAX_SEQUENCE: usize = 64;

/// Longest register processing, in which the slave holds S back (D2, p. 16: 20 ms).
pub const BUSY_MAX_NS: u64 = 20_000_000;

/// Registers that can be addressed without a bank.
pub const ADDRESSES: u8 = 0x80;

/// Repetitions without progress where nobody has said how many.
pub const RETRIES: u32 = 8;

/// Slaves that can have an ID (D2, p. 14).
pub const MAX_IDS: u8 = 8;

/// The CRC of header and data: x⁴+x+1, start value 0, sent inverted (D2, p. 14 and 16).
fn crc4(data: u64, len: u8) -> u8 {
    static CRC: OnceLock<Option<Crc>> = OnceLock::new();
    let crc = CRC.get_or_init(|| Crc::standard(4)).as_ref();
    crc.map_or(0, |crc| crc.of(data, len)) as u8
}

/// What came of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seen {
    /// All its clocks came as they should, and its head was read.
    Whole {
        /// The slave's bit.
        cds: bool,
        /// The master's bit, as sent.
        cdm: bool,
    },
    /// A reduced frame, which has no CDS.
    Reduced {
        /// The master's bit, as sent.
        cdm: bool,
    },
    /// It stalled, or nobody answered, or its start bit was in doubt: the slave has taken this bit, or others.
    Cut {
        /// The master's bit, as sent after all clocks; none where there were none, or those of INIT.
        cdm: Option<bool>,
    },
}

/// How an access ended.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// What was wanted.
    pub access: Access,
    /// Why there is not all of it.
    pub failure: Option<Failure>,
    /// What was read, or written and echoed: all of it without a failure, else what came before it.
    pub bytes: Bytes,
    /// Bytes for which S had to be repeated, bit k for byte k: because the slave was busy, or because a bit error hid its
    /// echo; and those for which a late link may have seen an echo that was none. Then what was read may be shifted. No
    /// shift alone passes the CRC, but one more bit error can hide it, so it takes a second reading.
    pub waited: u128,
    /// Control frames that had to be given up.
    pub retries: u32,
    /// What the last of them had failed with.
    pub retried_for: Option<Failure>,
    /// Frames from the first S to the end of the last control frame, the rest between them included.
    pub frames: u32,
    /// IDs taken in the last control frame that came so far: bit k for ID k, bit 8 for a ninth slave.
    pub idl: u16,
}

impl Outcome {
    /// Slaves that took an ID; 9 stands for nine or more.
    pub fn present(&self) -> u8 {
        self.idl.trailing_ones() as u8
    }
}

/// The master's side of control communication.
#[derive(Clone, Debug)]
pub struct Control {
    /// CDM has to be chosen before this frame's CDS is seen.
    late: bool,
    retries: u32,
    /// Consecutive frames with CDM = 0 that count as rest.
    zeros: u8,
    /// For so many frames a slave may still wait for the bit that executes a command.
    armed: u8,
    /// When the last frame began.
    now_ns: u64,
    job: Option<Job>,
    exchange: Option<Exchange>,
    quench: Quench,
    ended: Option<Outcome>,
}

/// An access under way.
#[derive(Clone, Copy, Debug)]
struct Job {
    outcome: Outcome,
    /// Control frames that failed since the last byte.
    in_row: u32,
    /// What the last control frame failed with, if no byte has come since.
    before: Option<Failure>,
    /// Frames since then in which the slaves should have rested, and may not have.
    lost: u32,
    /// When the first control frame since then failed.
    failing_since_ns: Option<u64>,
}

impl Control {
    /// Nothing to do. `late` links lay out CDM before they see CDS. The slaves' state is not known, so 14 frames of rest
    /// come first.
    pub fn new(late: bool) -> Control {
        Control {
            late,
            retries: RETRIES,
            zeros: 0,
            armed: 0,
            now_ns: 0,
            job: None,
            exchange: None,
            quench: Quench::default(),
            ended: None,
        }
    }

    /// How many control frames without progress are repeated.
    pub fn set_retries(&mut self, retries: u32) {
        self.retries = retries;
    }

    /// Begins an access; one that was under way is forgotten, but ended as it has to be.
    ///
    /// # Errors
    /// When the wire cannot carry it.
    pub fn ask(&mut self, access: Access) -> Result<(), String> {
        access.check(self.late)?;
        self.abort(None);
        // A command that may still be waited for was somebody else's.
        (self.ended, self.armed) = (None, 0);
        self.job = Some(Job {
            outcome: Outcome {
                access,
                failure: None,
                bytes: Bytes::new(),
                waited: 0,
                retries: 0,
                retried_for: None,
                frames: 0,
                idl: 0,
            },
            in_row: 0,
            before: None,
            lost: 0,
            failing_since_ns: None,
        });
        self.begin();
        Ok(())
    }

    /// Gives an access up. Frames must go on until [`Control::rests`]: a slave in the middle of a write would take later
    /// frames for the rest of it.
    pub fn give_up(&mut self) {
        self.abort(None);
        self.job = None;
    }

    /// Whether the slaves wait for nothing: no access is under way, and the last one has been ended by rest.
    pub fn rests(&self) -> bool {
        self.job.is_none() && self.quench.is_over() && self.zeros >= REST_FRAMES
    }

    /// Whether an access is under way.
    pub fn is_busy(&self) -> bool {
        self.job.is_some()
    }

    /// Whether the next frame shall be a reduced one.
    pub fn reduced(&self) -> bool {
        let reduced =
            |job: &Job| matches!(job.outcome.access, Access::Command { reduced, .. } if reduced);
        self.job.as_ref().is_some_and(reduced)
    }

    /// CDM of the next frame, as a function of its own CDS: `cdm()[cds]`.
    pub fn cdm(&self) -> [bool; 2] {
        if let Some(bit) = self.quench.bit() {
            return [bit; 2];
        }
        self.exchange
            .as_ref()
            .map_or([false; 2], |exchange| exchange.cdm(self.late))
    }

    /// What came of the frame that was sent with [`Control::cdm`], and when it began.
    pub fn seen(&mut self, t_ns: u64, seen: Seen) {
        if let Some(job) = self
            .job
            .as_mut()
            .filter(|job| job.outcome.frames > 0 || self.exchange.is_some())
        {
            job.outcome.frames += 1;
        }
        self.now_ns = t_ns;
        match seen {
            Seen::Cut { cdm } => self.cut(cdm),
            Seen::Whole { cds, cdm } => self.whole(t_ns, cds, cdm),
            Seen::Reduced { cdm } => self.whole(t_ns, false, cdm),
        }
        self.begin();
    }

    /// How the access ended, once.
    pub fn take(&mut self) -> Option<Outcome> {
        self.ended.take()
    }

    fn whole(&mut self, t_ns: u64, cds: bool, cdm: bool) {
        self.armed = self.armed.saturating_sub(1);
        if self.quench.bit().is_some() {
            self.quench.sent(cdm);
            self.zeros = 0;
            return;
        }
        let Some(exchange) = self.exchange.as_mut() else {
            if cds {
                // A bit error has told a slave that something begins: it would take the next access for the rest of that.
                self.zeros = 0;
                return self.lost(Failure::OutOfStep);
            }
            self.zeros = if cdm {
                0
            } else {
                self.zeros.saturating_add(1).min(REST_FRAMES)
            };
            return;
        };
        let rest = exchange.is_rest();
        let progress = exchange.seen(t_ns, cds, cdm);
        self.zeros = match cdm || !rest {
            true => 0,
            false => self.zeros.saturating_add(1).min(REST_FRAMES),
        };
        match progress {
            Progress::Going => {}
            Progress::Byte(came) => self.byte(came),
            Progress::Last(came) => {
                self.byte(came);
                self.frame_ends(None);
            }
            Progress::Done => self.frame_ends(None),
            Progress::Failed(failure) => self.abort(Some(failure)),
        }
    }

    fn byte(&mut self, came: Came) {
        if let Some(job) = &mut self.job {
            job.outcome.waited |= u128::from(came.waited) << job.outcome.bytes.as_slice().len();
            job.outcome.bytes.push(came.byte);
            (job.in_row, job.before, job.lost) = (0, None, 0);
            job.failing_since_ns = None;
        }
    }

    fn cut(&mut self, cdm: Option<bool>) {
        self.zeros = 0;
        if !self.quench.is_over() {
            self.quench.slip(cdm);
        }
        let Some(exchange) = &self.exchange else {
            self.lost(Failure::Cut);
            return;
        };
        self.quench = exchange.abandoned();
        self.quench.slip(cdm);
        self.armed = exchange.armed();
        let failure = match exchange.may_have_executed() {
            true => Failure::Undecided,
            false => Failure::Cut,
        };
        self.frame_ends(Some(failure));
    }

    /// The slaves should have rested in a frame, and may not have. Where that goes on they never do.
    fn lost(&mut self, failure: Failure) {
        let most = u32::from(REST_FRAMES).saturating_mul(self.retries.saturating_add(1));
        if let Some(job) = &mut self.job {
            job.lost += 1;
            let undecided = self.armed > 0 && failure == Failure::Cut;
            if job.lost >= most || undecided {
                job.outcome.failure = Some(match undecided {
                    true => Failure::Undecided,
                    false => failure,
                });
                self.ended = Some(job.outcome);
                self.job = None;
            }
        }
    }

    /// Ends a control frame whose place is known on both sides.
    fn abort(&mut self, failure: Option<Failure>) {
        if let Some(exchange) = &self.exchange {
            self.quench = exchange.abandoned();
            self.zeros = 0;
            if failure.is_some() {
                self.frame_ends(failure);
            } else {
                self.exchange = None;
            }
        }
    }

    /// One control frame is over; the access may need more of them.
    fn frame_ends(&mut self, failure: Option<Failure>) {
        let Some(exchange) = self.exchange.take() else {
            return;
        };
        let Some(mut job) = self.job.take() else {
            return;
        };
        job.outcome.idl = exchange.idl().unwrap_or(job.outcome.idl);
        let Some(failure) = failure else {
            match job.left() {
                0 => self.ended = Some(job.outcome),
                _ => self.job = Some(job),
            }
            return;
        };
        let since_ns = *job.failing_since_ns.get_or_insert(self.now_ns);
        // A slave that stores a byte may take that long until it takes another.
        let storing = matches!(failure, Failure::NotEchoed { .. })
            && !job.outcome.bytes.as_slice().is_empty()
            && self.now_ns - since_ns <= BUSY_MAX_NS;
        let sure = failure.is_answer() && job.before.is_some_and(|before| failure.repeats(before));
        let enough = (sure || job.in_row >= self.retries) && !storing;
        if failure == Failure::Undecided || enough {
            job.outcome.failure = Some(failure);
            self.ended = Some(job.outcome);
            return;
        }
        job.in_row += 1;
        job.before = Some(failure);
        job.outcome.retries += 1;
        job.outcome.retried_for = Some(failure);
        self.job = Some(job);
    }

    /// Begins the next control frame as soon as the slaves have rested.
    fn begin(&mut self) {
        if self.exchange.is_some() || !self.quench.is_over() || self.zeros < REST_FRAMES {
            return;
        }
        self.exchange = self
            .job
            .as_ref()
            .map(|job| Exchange::new(job.aim(self.late)));
    }
}

impl Job {
    /// Bytes still to come; a command counts as one.
    fn left(&self) -> usize {
        let done = self.outcome.bytes.as_slice().len();
        match &self.outcome.access {
            Access::Read { count, .. } => usize::from(*count) - done,
            Access::Write { data, .. } => data.as_slice().len() - done,
            Access::Command { .. } => 0,
        }
    }

    /// What the next control frame is for.
    fn aim(&self, late: bool) -> Aim {
        let done = self.outcome.bytes.as_slice().len();
        // A sequence does not cross from the bank to the registers beside it (D2, p. 16).
        let sequence = |address: u8, left: usize| {
            let end = if address < 0x40 {
                0x40
            } else {
                usize::from(ADDRESSES)
            };
            left.min(end - usize::from(address)).min(MAX_SEQUENCE)
        };
        match &self.outcome.access {
            Access::Read { slave, address, .. } => {
                let address = address + done as u8;
                Aim::Read {
                    slave: *slave,
                    address,
                    count: sequence(address, self.left()) as u8,
                }
            }
            Access::Write {
                slave,
                address,
                data,
            } => {
                let address = address + done as u8;
                // A late link cannot wait for S before a second byte: it would send data meanwhile (D2, p. 17).
                let count = if late {
                    1
                } else {
                    sequence(address, self.left())
                };
                Aim::Write {
                    slave: *slave,
                    address,
                    data: data.as_slice()[done..done + count].into(),
                }
            }
            Access::Command {
                slaves,
                code,
                checked,
                ..
            } => Aim::Command {
                slaves: *slaves,
                code: *code,
                checked: *checked,
            },
        }
    }
}
