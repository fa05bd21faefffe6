//! Why an access failed.

use super::MAX_IDS;
use std::fmt;

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

/// Why not all who are wanted can answer; bit k for ID k in both.
pub(super) fn missing(wanted: u16, idl: u16) -> Option<Failure> {
    let missing = wanted & !idl;
    let present = idl.trailing_ones();
    match (missing, idl) {
        // Each slave takes the first ID that is left.
        (_, idl) if idl >> present != 0 => Some(Failure::Garbled { idl }),
        (0, _) => None,
        (_, 0) => Some(Failure::Unheard),
        _ => Some(Failure::Absent {
            slave: missing.trailing_zeros() as u8,
            present: present as u8,
        }),
    }
}

/// What R and W as they were echoed mean: a read echoes 10, a write 01.
pub(super) fn refusal(address: u8, write: bool, (r, w): (bool, bool)) -> Option<Failure> {
    match (r, w) {
        (true, false) if !write => None,
        (false, true) if write => None,
        (true, true) if !write => Some(Failure::Refused { address }),
        // A slave that found the header's CRC wrong looks the same; it will not twice.
        (false, false) if write => Some(Failure::Refused { address }),
        (false, false) => Some(Failure::NoReaction { address }),
        (r, w) => Some(Failure::Strange { address, r, w }),
    }
}

impl Failure {
    /// Whether it is the same once more, however long it took.
    pub(super) fn repeats(self, other: Failure) -> bool {
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
    pub(super) fn is_answer(&self) -> bool {
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
