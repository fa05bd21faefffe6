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

mod exchange;
mod listen;
mod quench;

pub use listen::{Heard, Listener, Spoken};

use crate::crc::Crc;
use exchange::{Aim, Came, Exchange, Progress};
use quench::Quench;
use std::fmt;
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

/// Up to 128 bytes, without a heap.
#[derive(Clone, Copy)]
pub struct Bytes {
    bytes: [u8; ADDRESSES as usize],
    len: u8,
}

impl Bytes {
    /// The bytes.
    pub fn as_slice(&self) -> &[u8] {
        &self.bytes[..usize::from(self.len)]
    }

    const fn new() -> Bytes {
        Bytes {
            bytes: [0; ADDRESSES as usize],
            len: 0,
        }
    }

    fn push(&mut self, byte: u8) {
        if let Some(place) = self.bytes.get_mut(usize::from(self.len)) {
            *place = byte;
            self.len += 1;
        }
    }
}

impl From<&[u8]> for Bytes {
    /// What is beyond 128 bytes is left out.
    fn from(bytes: &[u8]) -> Bytes {
        let mut all = Bytes::new();
        bytes.iter().for_each(|byte| all.push(*byte));
        all
    }
}

impl fmt::Debug for Bytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.as_slice().fmt(f)
    }
}

impl PartialEq for Bytes {
    fn eq(&self, other: &Bytes) -> bool {
        self.as_slice() == other.as_slice()
    }
}

impl Eq for Bytes {}

/// What is wanted of the slaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Registers one after the other.
    Read {
        /// Its ID, 0 to 7: 0 is the slave farthest away.
        slave: u8,
        /// The first register, 0x00 to 0x7F.
        address: u8,
        /// How many.
        count: u8,
    },
    /// Registers one after the other.
    Write {
        /// Its ID, 0 to 7.
        slave: u8,
        /// The first register.
        address: u8,
        /// What goes there.
        data: Bytes,
    },
    /// A command.
    Command {
        /// Bit k stands for slave ID k; 0 is a broadcast.
        slaves: u8,
        /// 0 to 3; what they mean depends on who is addressed (D2, p. 17-19).
        code: u8,
        /// Execute only when exactly these slaves have acknowledged.
        checked: bool,
        /// In reduced frames: two clocks and the timeout, no CDS. For broadcasts.
        reduced: bool,
    },
}

impl Access {
    /// Whether the wire can carry it.
    ///
    /// # Errors
    /// What is wrong with it, in words.
    pub fn check(&self, late: bool) -> Result<(), String> {
        let register = |slave: u8, address: u8, count: usize| {
            if slave >= MAX_IDS {
                return Err(format!("slave IDs are 0 to 7, not {slave}"));
            }
            if count == 0 {
                return Err("no register at all".into());
            }
            let end = usize::from(address) + count;
            if end > usize::from(ADDRESSES) {
                return Err(format!("registers end at 0x7f, not at {:#04x}", end - 1));
            }
            Ok(())
        };
        match self {
            Access::Read {
                slave,
                address,
                count,
            } => register(*slave, *address, usize::from(*count)),
            Access::Write {
                slave,
                address,
                data,
            } => register(*slave, *address, data.as_slice().len()),
            Access::Command { code: 4.., .. } => Err("commands are 0 to 3".into()),
            Access::Command {
                slaves,
                reduced: true,
                ..
            } if *slaves != 0 => {
                Err("reduced frames have no CDS for the slaves' acknowledge, they are for broadcasts".into())
            }
            Access::Command {
                slaves,
                checked: true,
                ..
            } if late && slaves & 0x80 != 0 => Err(
                "slave 7 acknowledges in the frame that executes, where CDM is laid out before CDS is seen".into(),
            ),
            Access::Command { .. } => Ok(()),
        }
    }
}

/// Why an access failed: what the slave did, or did not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Failure {
    /// No slave took an ID: nobody on this line answers to control frames.
    Unheard,
    /// Fewer slaves took IDs.
    Absent {
        /// Who was wanted.
        slave: u8,
        /// How many took one.
        present: u8,
    },
    /// The IDs taken do not follow each other.
    Garbled {
        /// Bit k: ID k was taken.
        idl: u16,
    },
    /// The slave inverted W: no such register, or not for this purpose (D2, p. 16).
    Refused {
        /// The register.
        address: u8,
    },
    /// The slave echoed neither R nor W: it found the header's CRC wrong.
    NoReaction {
        /// The register.
        address: u8,
    },
    /// The slave echoed R and W as they cannot be.
    Strange {
        /// The register.
        address: u8,
        /// R.
        r: bool,
        /// W.
        w: bool,
    },
    /// The slave did not echo S before a byte to be written. Before the first one it may not wait (D2, p. 17); before others
    /// it may, but S is not repeated: where only the echo was lost it would be taken for a bit of the byte.
    NotEchoed {
        /// The register.
        address: u8,
    },
    /// The slave did not echo S in time: busy for too long, or its way to refuse (D2, p. 16).
    Silent {
        /// The register.
        address: u8,
        /// How long S was repeated.
        waited_ns: u64,
    },
    /// The CRC of a byte that was read does not belong to it.
    DataCrc {
        /// The register.
        address: u8,
        /// As received.
        got: u8,
        /// As computed from the byte received.
        want: u8,
    },
    /// The slave echoed something else than was written.
    Echo {
        /// The register.
        address: u8,
        /// Byte and CRC as sent.
        sent: u16,
        /// Byte and CRC as echoed.
        got: u16,
    },
    /// The slaves that acknowledged a command are not those it was for: it was not executed.
    Acknowledge {
        /// Bit k stands for slave ID k.
        want: u8,
        /// Likewise.
        got: u8,
    },
    /// CDS was 1 where slaves that rest, or hear a header, have nothing to say: one of them was in the middle of something
    /// else.
    OutOfStep,
    /// A frame was not whole, so nobody knows which bit the slave has taken.
    Cut,
    /// Read back, a register holds something else than was written.
    ReadBack {
        /// The register.
        address: u8,
        /// What was written.
        want: u8,
        /// What was read.
        got: u8,
    },
    /// A register gave another value each time.
    Unsteady {
        /// The register.
        address: u8,
        /// The last but one.
        first: u8,
        /// The last one.
        second: u8,
    },
    /// A frame in which a command may be executed was not whole: whether it was is not known, so it is not repeated.
    Undecided,
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Failure::Unheard => {
                f.write_str("no slave took an ID: the encoder does not answer to control frames")
            }
            Failure::Absent { slave, present: 1 } => {
                write!(f, "no slave with ID {slave}: only ID 0 is there")
            }
            Failure::Absent { slave, present } => write!(
                f,
                "no slave with ID {slave}: IDs 0 to {} are there",
                present.saturating_sub(1)
            ),
            Failure::Garbled { idl } => write!(
                f,
                "the slaves took IDs that do not follow each other (IDL {idl:#011b})"
            ),
            Failure::Refused { address } => write!(f, "the slave refuses register {address:#04x}"),
            Failure::NoReaction { address } => write!(
                f,
                "the slave did not react to the address of register {address:#04x}: it found its CRC wrong"
            ),
            Failure::Strange { address, r, w } => write!(
                f,
                "the slave echoed RW = {}{} for register {address:#04x}, which means nothing",
                u8::from(r),
                u8::from(w)
            ),
            Failure::NotEchoed { address } => write!(
                f,
                "the slave did not echo the start of the byte for register {address:#04x}: some refuse so"
            ),
            Failure::Silent { address, waited_ns } => write!(
                f,
                "the slave did not get ready for register {address:#04x} within {:.1} ms: some refuse so",
                waited_ns as f64 / 1e6
            ),
            Failure::DataCrc { address, got, want } => write!(
                f,
                "register {address:#04x} came with CRC {got:#x}, want {want:#x}"
            ),
            Failure::Echo { address, sent, got } => write!(
                f,
                "register {address:#04x}: the slave echoed {:#04x} CRC {:#x}, sent was {:#04x} CRC {:#x}",
                got >> 4,
                got & 0xF,
                sent >> 4,
                sent & 0xF
            ),
            Failure::Acknowledge { want, got } => write!(
                f,
                "the command was acknowledged by {}, it was for {}, and not executed",
                ids(got),
                ids(want)
            ),
            Failure::OutOfStep => f.write_str(
                "a slave spoke though nobody had asked it: CDS was 1 where it has to be 0",
            ),
            Failure::Cut => f.write_str("a frame was not whole"),
            Failure::ReadBack { address, want, got } => write!(
                f,
                "register {address:#04x} reads {got:#04x} after {want:#04x} was written and echoed"
            ),
            Failure::Unsteady {
                address,
                first,
                second,
            } => write!(
                f,
                "register {address:#04x} gave {first:#04x}, then {second:#04x}: no two readings agree"
            ),
            Failure::Undecided => f.write_str(
                "a frame that could execute the command was not whole: it may have been executed or not",
            ),
        }
    }
}

/// `slave 0, 2`, or that there is none.
fn ids(bits: u8) -> String {
    let list: Vec<String> = (0..MAX_IDS)
        .filter(|id| bits >> id & 1 == 1)
        .map(|id| id.to_string())
        .collect();
    match list.is_empty() {
        true => "no slave".into(),
        false => format!("slave {}", list.join(", ")),
    }
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
            job.outcome.waited |= u128::from(came.waited) << job.outcome.bytes.len;
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
            && job.outcome.bytes.len > 0
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

impl Failure {
    /// Whether it is the same once more, however long it took.
    fn repeats(self, other: Failure) -> bool {
        match (self, other) {
            (Failure::Silent { address, .. }, Failure::Silent { address: other, .. }) => {
                address == other
            }
            _ => self == other,
        }
    }

    /// Its name in every output.
    pub fn name(&self) -> &'static str {
        let index = match self {
            Failure::Unheard => 0,
            Failure::Absent { .. } => 1,
            Failure::Garbled { .. } => 2,
            Failure::Refused { .. } => 3,
            Failure::NoReaction { .. } => 4,
            Failure::Strange { .. } => 5,
            Failure::NotEchoed { .. } => 6,
            Failure::Silent { .. } => 7,
            Failure::DataCrc { .. } => 8,
            Failure::Echo { .. } => 9,
            Failure::Acknowledge { .. } => 10,
            Failure::Cut => 11,
            Failure::ReadBack { .. } => 12,
            Failure::Unsteady { .. } => 13,
            Failure::Undecided => 14,
            Failure::OutOfStep => 15,
        };
        Failure::NAMES[index]
    }

    /// All names.
    pub const NAMES: [&'static str; 16] = [
        "unheard",
        "absent",
        "garbled",
        "refused",
        "no-reaction",
        "strange",
        "not-echoed",
        "silent",
        "data-crc",
        "echo",
        "acknowledge",
        "cut",
        "read-back",
        "unsteady",
        "undecided",
        "out-of-step",
    ];

    /// The slaves' own answer. Seen twice in a row it is believed, as no bit of it is protected by a CRC.
    fn is_answer(&self) -> bool {
        matches!(
            self,
            Failure::Unheard
                | Failure::Absent { .. }
                | Failure::Refused { .. }
                | Failure::NotEchoed { .. }
                | Failure::Silent { .. }
                | Failure::Acknowledge { .. }
        )
    }
}
