//! The passive side: what master and slaves say to each other, from the CDM and CDS of frames somebody else has run.

use super::failure::{Failure, missing, refusal};
use super::{REST_FRAMES, crc4};

/// One thing that was said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Heard {
    /// When its first frame began: that with S of the control frame, or of a byte behind the first one with its own.
    pub t_ns: u64,
    /// So many frames from there to its last one, both included.
    pub frames: u64,
    /// Frames in which S had to be repeated before the slave echoed it.
    pub busy: u32,
    /// From the first S of the byte to its echo, or to where it was given up.
    pub waited_ns: u64,
    /// What the slaves said in the header.
    pub head: Idl,
    /// What.
    pub spoken: Spoken,
}

/// What slaves say while the header goes out: who takes an ID, and nothing else.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Idl {
    /// Bit k for ID k, bit 8 for a ninth slave.
    pub taken: u16,
    /// CDS was 1 where nobody has anything to say.
    pub out_of_step: bool,
}

impl Idl {
    fn hears(&mut self, n: u8, cds: bool) {
        match n {
            1..=9 => self.taken |= u16::from(cds) << (n - 1),
            0 | 10..=16 => self.out_of_step |= cds,
            _ => {}
        }
    }

    /// Why those who are wanted cannot have answered.
    fn failure(self, wanted: u16) -> Option<Failure> {
        match self.out_of_step {
            true => Some(Failure::OutOfStep),
            false => missing(wanted, self.taken),
        }
    }
}

impl Heard {
    /// What a master that checks everything would say of it; none where all of it is right. No value that comes with a
    /// failure is to be believed, whatever its CRC.
    pub fn failure(&self) -> Option<Failure> {
        let slave = |slave: u8| self.head.failure(1 << slave);
        match self.spoken {
            Spoken::Read { slave: id, .. } | Spoken::Written { slave: id, .. } => slave(id),
            Spoken::Bad {
                address, cdm, cds, ..
            } => Some(bad_byte(address, cdm, cds)),
            Spoken::Refused {
                slave: id,
                address,
                write,
                rw,
            } => slave(id).or(refusal(address, write, rw)),
            Spoken::Silent {
                slave: id,
                address,
                write,
            } => slave(id).or(Some(match write {
                true => Failure::NotEchoed { address },
                false => Failure::Silent {
                    address,
                    waited_ns: self.waited_ns,
                },
            })),
            Spoken::Command {
                slaves,
                acknowledged,
                ..
            } => {
                let want = (slaves, acknowledged);
                let acknowledge = || {
                    (want.0 != want.1).then_some(Failure::Acknowledge {
                        want: want.0,
                        got: want.1,
                    })
                };
                self.head.failure(slaves.into()).or_else(acknowledge)
            }
            Spoken::Cut { .. } => Some(Failure::Cut),
            Spoken::CutCommand { undecided, .. } => Some(match undecided {
                true => Failure::Undecided,
                false => Failure::Cut,
            }),
            Spoken::BadHeader { .. } => None,
        }
    }
}

impl Heard {
    /// Byte and CRC as they came from the slave, 12 bits.
    pub fn came(&self) -> Option<u16> {
        match self.spoken {
            Spoken::Read { value, .. } | Spoken::Written { value, .. } => {
                Some(u16::from(value) << 4 | u16::from(crc4(value.into(), 8)))
            }
            Spoken::Bad { cds, .. } => Some(cds),
            _ => None,
        }
    }

    /// Whether what came from the slave fits its CRC; false too where nothing came.
    pub fn crc_ok(&self) -> bool {
        self.came().is_some_and(fits)
    }

    /// The byte that was to be written, if the master's own CRC belongs to it.
    pub fn sent(&self) -> Option<u8> {
        match self.spoken {
            Spoken::Written { value, .. } => Some(value),
            Spoken::Bad {
                cdm: Some(sent), ..
            } if fits(sent) => Some((sent >> 4) as u8),
            _ => None,
        }
    }
}

/// A byte and its CRC.
fn fits(bits: u16) -> bool {
    crc4(u64::from(bits >> 4), 8) == (bits & 0xF) as u8
}

fn bad_byte(address: u8, cdm: Option<u16>, cds: u16) -> Failure {
    match cdm.filter(|sent| *sent != cds) {
        Some(sent) => Failure::Echo {
            address,
            sent,
            got: cds,
        },
        None => Failure::DataCrc {
            address,
            got: (cds & 0xF) as u8,
            want: crc4(u64::from(cds >> 4), 8),
        },
    }
}

/// What was said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spoken {
    /// A register was read; the CRC of the byte was good.
    Read {
        /// Slave ID.
        slave: u8,
        /// The register.
        address: u8,
        /// Its content.
        value: u8,
    },
    /// A register was written; the CRC of the byte was good, and the slave echoed it.
    Written {
        /// Slave ID.
        slave: u8,
        /// The register.
        address: u8,
        /// What was written.
        value: u8,
    },
    /// A byte that was not received as it was sent: a wrong CRC, or another echo.
    Bad {
        /// Slave ID.
        slave: u8,
        /// The register.
        address: u8,
        /// Byte and CRC from the master; none in a read.
        cdm: Option<u16>,
        /// Byte and CRC from the slave.
        cds: u16,
    },
    /// An access that the slave did not take: R and W as it echoed them, 11 and 00 being a refusal.
    Refused {
        /// Slave ID.
        slave: u8,
        /// The register.
        address: u8,
        /// It was to be written.
        write: bool,
        /// Its echo of R and W.
        rw: (bool, bool),
    },
    /// S was given up before the slave echoed it.
    Silent {
        /// Slave ID.
        slave: u8,
        /// The register.
        address: u8,
        /// It was to be written.
        write: bool,
    },
    /// An access under way when a frame was not whole: what became of it is not known.
    Cut {
        /// Slave ID.
        slave: u8,
        /// The register.
        address: u8,
        /// It was to be written.
        write: bool,
    },
    /// Likewise a command.
    CutCommand {
        /// As in [`Spoken::Command`].
        slaves: u8,
        /// Likewise.
        code: u8,
        /// The frame was the one that could execute it.
        undecided: bool,
    },
    /// A command.
    Command {
        /// Bit k stands for slave ID k; 0 is a broadcast.
        slaves: u8,
        /// 0 to 3.
        code: u8,
        /// Who acknowledged, likewise.
        acknowledged: u8,
        /// EX was sent.
        executed: bool,
    },
    /// A header whose CRC is wrong.
    BadHeader {
        /// CTS, ID and ADR, or CTS, IDS and CMD, and the CRC: 15 bits.
        header: u16,
    },
}

/// Follows control communication bit by bit. Before the first control frame it needs 14 frames with CDM = 0, as a slave
/// does, and again after each frame that was not whole.
#[derive(Clone, Copy, Debug)]
pub struct Listener {
    frame: u64,
    t_ns: u64,
    zeros: u8,
    at: At,
    /// The frame of the control frame's S, or of a later byte's own, and when that was.
    began: (u64, u64),
    head: Idl,
    busy: u32,
    /// When S of the byte under way first went out, and how long its echo took.
    asked_ns: u64,
    waited_ns: u64,
}

#[derive(Clone, Copy, Debug)]
enum At {
    /// Nothing is under way.
    Rest,
    /// So many bits of the header after S.
    Header { n: u8, bits: u32 },
    /// Awaits the echo of W.
    Acknowledge { target: Target, r: bool },
    /// S is out.
    Await { target: Target },
    /// So many frames after the echo of S.
    Byte {
        target: Target,
        i: u8,
        sent: u16,
        came: u16,
    },
    /// IDA and EX of a command.
    Command {
        slaves: u8,
        code: u8,
        n: u8,
        ida: u8,
    },
}

#[derive(Clone, Copy, Debug)]
struct Target {
    slave: u8,
    address: u8,
    write: bool,
}

impl Default for Listener {
    fn default() -> Listener {
        Listener::new()
    }
}

impl Listener {
    /// Knows nothing of what was before.
    pub fn new() -> Listener {
        Listener {
            frame: 0,
            t_ns: 0,
            zeros: 0,
            at: At::Rest,
            began: (0, 0),
            head: Idl::default(),
            busy: 0,
            asked_ns: 0,
            waited_ns: 0,
        }
    }

    /// A frame that was not whole, or none: what was under way is lost. If it was known what that is, it is said.
    pub fn lost(&mut self) -> Option<Heard> {
        let heard = match self.at {
            At::Acknowledge { target, .. } | At::Await { target } | At::Byte { target, .. } => self
                .says(Spoken::Cut {
                    slave: target.slave,
                    address: target.address,
                    write: target.write,
                }),
            At::Command {
                slaves, code, n, ..
            } => self.says(Spoken::CutCommand {
                slaves,
                code,
                undecided: n == 7 || slaves == 0,
            }),
            At::Rest | At::Header { .. } => None,
        };
        self.frame += 1;
        self.zeros = 0;
        self.at = At::Rest;
        heard
    }

    /// When a whole frame began, and its bits.
    pub fn frame(&mut self, t_ns: u64, cdm: bool, cds: bool) -> Option<Heard> {
        self.t_ns = t_ns;
        let heard = self.step(cdm, cds);
        self.frame += 1;
        heard
    }

    fn begins(&mut self) {
        self.began = (self.frame, self.t_ns);
    }

    /// S of a byte has just been sent.
    fn asks(&mut self, target: Target) {
        (self.busy, self.asked_ns) = (0, self.t_ns);
        self.at = At::Await { target };
    }

    fn step(&mut self, cdm: bool, cds: bool) -> Option<Heard> {
        let rested = self.zeros >= REST_FRAMES;
        self.zeros = match cdm {
            true => 0,
            false => self.zeros.saturating_add(1),
        };
        match self.at {
            At::Rest => {
                if cdm && rested {
                    self.begins();
                    self.head = Idl::default();
                    self.head.hears(0, cds);
                    (self.busy, self.waited_ns) = (0, 0);
                    self.at = At::Header { n: 1, bits: 0 };
                }
                None
            }
            At::Header { n, bits } => self.header(n, bits << 1 | u32::from(cdm), cds),
            At::Acknowledge { target, r } => self.acknowledge(target, (r, cds), cdm),
            At::Await { target } if cds => {
                self.waited_ns = self.t_ns.saturating_sub(self.asked_ns);
                self.at = At::Byte {
                    target,
                    i: 1,
                    sent: u16::from(cdm),
                    came: 0,
                };
                None
            }
            At::Await { .. } if cdm => {
                self.busy += 1;
                None
            }
            At::Await { target } => {
                self.waited_ns = self.t_ns.saturating_sub(self.asked_ns);
                self.says(Spoken::Silent {
                    slave: target.slave,
                    address: target.address,
                    write: target.write,
                })
            }
            At::Byte {
                target,
                i,
                sent,
                came,
            } => self.byte(target, i, (sent, came), (cdm, cds)),
            At::Command {
                slaves,
                code,
                n,
                ida,
            } => self.command((slaves, code), n, ida, (cdm, cds)),
        }
    }

    /// `bits` came with frames 1 to `n`. CDS is IDL here, and the echo of R in the last frame.
    fn header(&mut self, n: u8, bits: u32, cds: bool) -> Option<Heard> {
        self.head.hears(n, cds);
        let command = n >= 15 && bits >> (n - 1) & 1 == 0;
        let header = (bits >> n.saturating_sub(15)) as u16 & 0x7FFF;
        if n == 15 && crc4(u64::from(header >> 4), 11) != (header & 0xF) as u8 {
            return self.says(Spoken::BadHeader { header });
        }
        self.at = match n {
            // S of a command comes right after its CRC.
            16 if command && bits & 1 == 1 => At::Command {
                slaves: ((header >> 6) as u8).reverse_bits(),
                code: (header >> 4) as u8 & 3,
                n: 0,
                ida: 0,
            },
            16 if command => At::Rest,
            // Neither a read nor a write: the rest of a header that was given up.
            17 if bits & 0b11 == 0b00 || bits & 0b11 == 0b11 => At::Rest,
            17 => At::Acknowledge {
                target: Target {
                    slave: (header >> 11) as u8 & 7,
                    address: (header >> 4) as u8 & 0x7F,
                    write: bits & 0b11 == 0b01,
                },
                r: cds,
            },
            _ => At::Header { n: n + 1, bits },
        };
        None
    }

    fn acknowledge(&mut self, target: Target, rw: (bool, bool), s: bool) -> Option<Heard> {
        if rw != (!target.write, target.write) {
            return self.says(Spoken::Refused {
                slave: target.slave,
                address: target.address,
                write: target.write,
                rw,
            });
        }
        match s {
            true => self.asks(target),
            false => self.at = At::Rest,
        }
        None
    }

    fn byte(
        &mut self,
        target: Target,
        i: u8,
        (sent, came): (u16, u16),
        (cdm, cds): (bool, bool),
    ) -> Option<Heard> {
        if i < 13 {
            self.at = At::Byte {
                target,
                i: i + 1,
                // The twelfth bit went out with the frame before the last bit came back.
                sent: if i < 12 {
                    sent << 1 | u16::from(cdm)
                } else {
                    sent
                },
                came: came << 1 | u16::from(cds),
            };
            return None;
        }
        let heard = self.says(said(target, sent, came));
        // P = 0 and S: the next register.
        let next = Target {
            address: target.address + 1,
            ..target
        };
        if cdm && !cds && next.address < super::ADDRESSES {
            self.begins();
            self.asks(next);
        }
        heard
    }

    fn command(
        &mut self,
        (slaves, code): (u8, u8),
        n: u8,
        ida: u8,
        (cdm, cds): (bool, bool),
    ) -> Option<Heard> {
        let ida = ida | u8::from(cds && slaves != 0) << n;
        if n == 7 || slaves == 0 {
            return self.says(Spoken::Command {
                slaves,
                code,
                acknowledged: ida,
                executed: cdm,
            });
        }
        self.at = At::Command {
            slaves,
            code,
            n: n + 1,
            ida,
        };
        None
    }

    fn says(&mut self, spoken: Spoken) -> Option<Heard> {
        self.at = At::Rest;
        let (frame, t_ns) = self.began;
        Some(Heard {
            t_ns,
            frames: self.frame - frame + 1,
            busy: self.busy,
            waited_ns: self.waited_ns,
            head: self.head,
            spoken,
        })
    }
}

/// What a byte was, if what was sent and what came back fit together.
fn said(
    Target {
        slave,
        address,
        write,
    }: Target,
    sent: u16,
    came: u16,
) -> Spoken {
    let value = (came >> 4) as u8;
    let good = fits(came);
    match write {
        true if good && sent == came => Spoken::Written {
            slave,
            address,
            value,
        },
        false if good => Spoken::Read {
            slave,
            address,
            value,
        },
        _ => Spoken::Bad {
            slave,
            address,
            cdm: write.then_some(sent),
            cds: came,
        },
    }
}
