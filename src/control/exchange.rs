//! One control frame, bit by bit: what goes out as CDM, and what comes back as CDS (D2, p. 14-19).

use super::failure::{missing, refusal};
use super::quench::{Quench, Reader};
use super::{BUSY_MAX_NS, Bytes, Failure, crc4};

/// What a control frame is for.
#[derive(Clone, Copy, Debug)]
pub(super) enum Aim {
    Read { slave: u8, address: u8, count: u8 },
    Write { slave: u8, address: u8, data: Bytes },
    Command { slaves: u8, code: u8, checked: bool },
}

/// What a frame has brought.
#[derive(Clone, Copy, Debug)]
pub(super) enum Progress {
    Going,
    /// A register was read, or written and echoed.
    Byte(Came),
    /// Likewise, and the control frame is over: nothing more was wanted, or the slave says that it has no more.
    Last(Came),
    /// The command is out.
    Done,
    Failed(Failure),
}

/// A byte with a good CRC, or echoed as it was sent.
#[derive(Clone, Copy, Debug)]
pub(super) struct Came {
    pub(super) byte: u8,
    /// S had to be repeated for it, or was before its echo was seen.
    pub(super) waited: bool,
}

/// Where in the control frame the next frame is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// S, CTS, ID, ADR, CRC, R, W; for a command S, CTS, IDS, CMD, CRC, S.
    Header(u8),
    /// Its CDS is the echo of W; S goes out if it is right.
    Acknowledge,
    /// S was sent and its echo is awaited.
    Await { first_ns: u64, last_ns: u64 },
    /// So many frames after the echo of S: 1-8 data, 9-12 CRC, 13 P.
    Byte(u8),
    /// IDA0 to IDA6.
    Addressed(u8),
    /// IDA7, and EX.
    Execute,
}

/// Frames that carry the header of a register access.
const REGISTER_HEADER: u8 = 18;
/// Frames that carry the header of a command.
const COMMAND_HEADER: u8 = 17;
/// Frames of a header in which no slave says anything: before IDL, and from there to the echo of R, or IDA.
const SILENT: [std::ops::RangeInclusive<u8>; 2] = [0..=0, 10..=16];
/// Frames that show IDL0 to IDL8.
const IDL: std::ops::RangeInclusive<u8> = 1..=9;

/// A control frame under way.
#[derive(Clone, Debug)]
pub(super) struct Exchange {
    aim: Aim,
    header: u32,
    stage: Stage,
    idl: u16,
    /// Echo of R.
    r: bool,
    /// Bytes done.
    done: u8,
    /// The bits of a byte and its CRC, as far as they have come.
    bits: u16,
    /// S was not echoed at once before the byte under way.
    waited: bool,
    /// S was out again when its echo was seen.
    repeated: bool,
    ida: u8,
}

impl Exchange {
    pub(super) fn new(aim: Aim) -> Exchange {
        let header = match aim {
            Aim::Read { slave, address, .. } => register_header(slave, address) << 2 | 0b10,
            Aim::Write { slave, address, .. } => register_header(slave, address) << 2 | 0b01,
            Aim::Command { slaves, code, .. } => command_header(slaves, code) << 1 | 1,
        };
        Exchange {
            aim,
            header,
            stage: Stage::Header(0),
            idl: 0,
            r: false,
            done: 0,
            bits: 0,
            waited: false,
            repeated: false,
            ida: 0,
        }
    }

    /// IDs taken, once all slaves have had their turn.
    pub(super) fn idl(&self) -> Option<u16> {
        match self.stage {
            Stage::Header(n) if n <= *IDL.end() => None,
            _ => Some(self.idl),
        }
    }

    /// CDM of the next frame over its own CDS.
    pub(super) fn cdm(&self, late: bool) -> [bool; 2] {
        let write = matches!(self.aim, Aim::Write { .. });
        match self.stage {
            Stage::Header(n) => [self.header >> (self.header_len() - 1 - n) & 1 == 1; 2],
            // A read echoes RW = 10, a write 01.
            Stage::Acknowledge if self.r == write => [false; 2],
            Stage::Acknowledge if late => [true; 2],
            Stage::Acknowledge => [!write, write],
            // What follows S in a read means nothing, so it can be repeated before it is known that it was not needed.
            Stage::Await { .. } if write && late => [self.out(0); 2],
            // Repeated where only its echo was lost, S would be taken for the first bit of the byte.
            Stage::Await { .. } if write => [false, self.out(0)],
            Stage::Await { .. } if late => [true; 2],
            Stage::Await { .. } => [true, false],
            Stage::Byte(13) if late => [self.more(); 2],
            Stage::Byte(13) => [self.more(), false],
            Stage::Byte(i) => [write && self.out(i); 2],
            Stage::Addressed(_) => [false; 2],
            Stage::Execute => self.execute(late),
        }
    }

    /// Whether CDM = 0 in the next frame is rest: after a read the frames that carry nothing are, in a write none
    /// before the one behind P: a 1 there would be the S of another byte, and its echo shows whether the slave has seen one.
    pub(super) fn is_rest(&self) -> bool {
        match self.aim {
            Aim::Read { .. } => !matches!(self.stage, Stage::Header(_) | Stage::Acknowledge),
            Aim::Write { .. } => matches!(self.stage, Stage::Byte(13)),
            Aim::Command { .. } => false,
        }
    }

    /// The command may be executed by what a slave takes from the next frame, should that not be whole: up to three
    /// bits, of which MA's level in a pause can be any.
    pub(super) fn may_have_executed(&self) -> bool {
        let broadcast = matches!(self.aim, Aim::Command { slaves: 0, .. });
        match self.stage {
            Stage::Execute | Stage::Addressed(6) => true,
            Stage::Header(15..) => broadcast,
            _ => false,
        }
    }

    /// For how many frames a slave that was left here would still take a 1 for EX.
    pub(super) fn armed(&self) -> u8 {
        match self.aim {
            Aim::Command { .. } => COMMAND_HEADER + 8,
            _ => 0,
        }
    }

    pub(super) fn seen(&mut self, t_ns: u64, cds: bool, cdm: bool) -> Progress {
        match self.stage {
            Stage::Header(n) => self.header(n, cds),
            Stage::Acknowledge => self.acknowledge(t_ns, cds),
            Stage::Await { .. } if cds => {
                (self.stage, self.bits, self.repeated) = (Stage::Byte(1), 0, cdm);
                Progress::Going
            }
            Stage::Await { first_ns, last_ns } => self.waits(t_ns, first_ns, last_ns),
            Stage::Byte(13) => self.ends_byte(t_ns, cds),
            Stage::Byte(i) => {
                self.bits = self.bits << 1 | u16::from(cds);
                self.stage = Stage::Byte(i + 1);
                match i {
                    12 => self.check(),
                    _ => Progress::Going,
                }
            }
            Stage::Addressed(id) => {
                self.ida |= u8::from(cds) << id;
                self.stage = match id {
                    6 => Stage::Execute,
                    _ => Stage::Addressed(id + 1),
                };
                Progress::Going
            }
            Stage::Execute => self.executed(cds, cdm),
        }
    }

    fn header_len(&self) -> u8 {
        match self.aim {
            Aim::Command { .. } => COMMAND_HEADER,
            _ => REGISTER_HEADER,
        }
    }

    fn header(&mut self, n: u8, cds: bool) -> Progress {
        if IDL.contains(&n) {
            self.idl |= u16::from(cds) << (n - IDL.start());
        }
        if n == REGISTER_HEADER - 1 {
            self.r = cds;
        }
        self.stage = match self.aim {
            _ if n + 1 < self.header_len() => Stage::Header(n + 1),
            Aim::Command { slaves: 0, .. } => Stage::Execute,
            Aim::Command { .. } => Stage::Addressed(0),
            _ => Stage::Acknowledge,
        };
        let failure = match n {
            _ if cds && SILENT.iter().any(|frames| frames.contains(&n)) => Some(Failure::OutOfStep),
            _ if n == *IDL.end() => self.missing(),
            _ => None,
        };
        failure.map_or(Progress::Going, Progress::Failed)
    }

    /// Whether somebody who was wanted has no ID.
    fn missing(&self) -> Option<Failure> {
        let wanted = match self.aim {
            Aim::Read { slave, .. } | Aim::Write { slave, .. } => 1 << slave,
            Aim::Command { checked: false, .. } => 0,
            Aim::Command { slaves, .. } => u16::from(slaves),
        };
        missing(wanted, self.idl)
    }

    fn acknowledge(&mut self, t_ns: u64, w: bool) -> Progress {
        let address = self.address();
        let write = matches!(self.aim, Aim::Write { .. });
        let failure = refusal(address, write, (self.r, w));
        match failure {
            Some(failure) => Progress::Failed(failure),
            None => self.begins_byte(t_ns),
        }
    }

    /// S has just been sent.
    fn begins_byte(&mut self, t_ns: u64) -> Progress {
        self.stage = Stage::Await {
            first_ns: t_ns,
            last_ns: t_ns,
        };
        Progress::Going
    }

    /// S was not echoed. What was seen answers the S of the frame before.
    fn waits(&mut self, t_ns: u64, first_ns: u64, last_ns: u64) -> Progress {
        let address = self.address();
        if matches!(self.aim, Aim::Write { .. }) {
            return Progress::Failed(Failure::NotEchoed { address });
        }
        self.waited = true;
        let waited_ns = last_ns.saturating_sub(first_ns);
        if waited_ns > BUSY_MAX_NS {
            return Progress::Failed(Failure::Silent { address, waited_ns });
        }
        self.stage = Stage::Await {
            first_ns,
            last_ns: t_ns,
        };
        Progress::Going
    }

    /// The CRC of what was read, the echo of what was written.
    fn check(&mut self) -> Progress {
        let address = self.address();
        let (byte, got) = ((self.bits >> 4) as u8, (self.bits & 0xF) as u8);
        match self.aim {
            Aim::Write { .. } => {
                let sent = self.frame();
                if self.bits != sent {
                    let got = self.bits;
                    return Progress::Failed(Failure::Echo { address, sent, got });
                }
            }
            _ => {
                let want = crc4(byte.into(), 8);
                if got != want {
                    return Progress::Failed(Failure::DataCrc { address, got, want });
                }
            }
        }
        Progress::Going
    }

    /// P has come: the next address is there or not.
    fn ends_byte(&mut self, t_ns: u64, p: bool) -> Progress {
        // An echo seen before it came, and the byte is a frame late: P is the last bit of its CRC.
        let late = self.repeated && p && matches!(self.aim, Aim::Read { .. });
        let came = Came {
            byte: (self.bits >> 4) as u8,
            waited: std::mem::take(&mut self.waited) || late,
        };
        let more = self.more();
        self.done += 1;
        if !more || p {
            return Progress::Last(came);
        }
        self.begins_byte(t_ns);
        Progress::Byte(came)
    }

    fn executed(&mut self, cds: bool, cdm: bool) -> Progress {
        self.ida |= u8::from(cds) << 7;
        match self.aim {
            Aim::Command { slaves, .. } if !cdm => Progress::Failed(Failure::Acknowledge {
                want: slaves,
                got: self.ida,
            }),
            // EX was sent, so it is done, even if a late link's last IDA turns out to be wrong.
            _ => Progress::Done,
        }
    }

    fn execute(&self, late: bool) -> [bool; 2] {
        let Aim::Command {
            slaves, checked, ..
        } = self.aim
        else {
            return [false; 2];
        };
        if slaves == 0 || !checked {
            return [true; 2];
        }
        if late {
            return [self.ida == slaves; 2];
        }
        [self.ida == slaves, self.ida | 0x80 == slaves]
    }

    /// More bytes are wanted after this one.
    fn more(&self) -> bool {
        let count = match &self.aim {
            Aim::Read { count, .. } => *count,
            Aim::Write { data, .. } => data.as_slice().len() as u8,
            Aim::Command { .. } => 0,
        };
        self.done + 1 < count
    }

    /// The register of the byte under way.
    fn address(&self) -> u8 {
        match &self.aim {
            Aim::Read { address, .. } | Aim::Write { address, .. } => address + self.done,
            Aim::Command { .. } => 0,
        }
    }

    /// Byte and CRC to be written.
    fn frame(&self) -> u16 {
        match &self.aim {
            Aim::Write { data, .. } => {
                let byte = data
                    .as_slice()
                    .get(usize::from(self.done))
                    .copied()
                    .unwrap_or(0);
                u16::from(byte) << 4 | u16::from(crc4(byte.into(), 8))
            }
            _ => 0,
        }
    }

    /// Bit `i` of byte and CRC; P and what comes after it is 0.
    fn out(&self, i: u8) -> bool {
        i < 12 && self.frame() >> (11 - i) & 1 == 1
    }

    /// How a slave may read on where both sides know how far the control frame is.
    fn readers(&self) -> Vec<Reader> {
        let Aim::Write { .. } = self.aim else {
            return Vec::new();
        };
        let has = |have, bits| Reader::Bits { have, bits };
        match self.stage {
            // It takes R and W, whatever they are, before it waits for S.
            Stage::Header(16..) => vec![Reader::Ends],
            Stage::Header(_) | Stage::Addressed(_) | Stage::Execute => Vec::new(),
            Stage::Acknowledge => vec![Reader::Waits, has(0, 0)],
            // S is out and may have been taken, and a first bit after it.
            Stage::Await { .. } => vec![Reader::Waits, has(0, 0), has(1, 0), has(1, 1)],
            Stage::Byte(i @ 1..=11) => vec![has(i, self.frame() >> (12 - i))],
            Stage::Byte(_) => vec![Reader::Ends, Reader::Waits],
        }
    }

    /// How to end it here.
    pub(super) fn abandoned(&self) -> Quench {
        Quench::new(&self.readers())
    }
}

/// S, CTS = 1, ID, ADR and their CRC.
fn register_header(slave: u8, address: u8) -> u32 {
    protected(0x400 | u32::from(slave & 7) << 7 | u32::from(address & 0x7F))
}

/// S, CTS = 0, IDS, CMD and their CRC. IDS0 comes first.
fn command_header(slaves: u8, code: u8) -> u32 {
    protected(u32::from(slaves.reverse_bits()) << 2 | u32::from(code & 3))
}

/// S, eleven bits, and their CRC.
fn protected(bits: u32) -> u32 {
    1 << 15 | bits << 4 | u32::from(crc4(bits.into(), 11))
}
