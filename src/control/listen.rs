//! The passive side: what master and slaves say to each other, from the CDM and CDS of frames somebody else has run.

use super::{REST_FRAMES, crc4};

/// One thing that was said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Heard {
    /// The frame in which it began, counted from the first one listened to: S of the control frame or of the byte.
    pub frame: u64,
    /// What.
    pub spoken: Spoken,
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
    zeros: u8,
    at: At,
    began: u64,
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
            zeros: 0,
            at: At::Rest,
            began: 0,
        }
    }

    /// A frame that was not whole, or none: what was under way is lost.
    pub fn lost(&mut self) {
        self.frame += 1;
        self.zeros = 0;
        self.at = At::Rest;
    }

    /// The bits of a whole frame.
    pub fn frame(&mut self, cdm: bool, cds: bool) -> Option<Heard> {
        let heard = self.step(cdm, cds);
        self.frame += 1;
        heard
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
                    self.began = self.frame;
                    self.at = At::Header { n: 1, bits: 0 };
                }
                None
            }
            At::Header { n, bits } => self.header(n, bits << 1 | u32::from(cdm), cds),
            At::Acknowledge { target, r } => self.acknowledge(target, (r, cds), cdm),
            At::Await { target } if cds => {
                self.at = At::Byte {
                    target,
                    i: 1,
                    sent: u16::from(cdm),
                    came: 0,
                };
                None
            }
            At::Await { .. } if cdm => None,
            At::Await { target } => self.says(Spoken::Silent {
                slave: target.slave,
                address: target.address,
            }),
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
        self.began = self.frame;
        self.at = match s {
            true => At::Await { target },
            false => At::Rest,
        };
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
            self.began = self.frame;
            self.at = At::Await { target: next };
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
        Some(Heard {
            frame: self.began,
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
    let good = crc4(value.into(), 8) == (came & 0xF) as u8;
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
