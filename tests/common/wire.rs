//! A master of a few lines: levels on MA, levels seen on SLO, and nothing of the program's own master.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used)]

use biss::slave::{Config, Slave};

pub struct Wire {
    pub slave: Slave,
    pub t_ns: u64,
    pub period_ns: u64,
    /// How long MA keeps its level after the last clock.
    pub rest_ns: u64,
    /// Rising edges of a usual frame.
    pub clocks: usize,
}

impl Wire {
    pub fn new(text: &str) -> Wire {
        let config: Config = text.parse().unwrap_or_else(|e| panic!("{e}"));
        let bits = usize::from(config.format.bits());
        let slave = Slave::new(config);
        Wire {
            t_ns: 100_000,
            period_ns: 1_000,
            rest_ns: 45_000,
            clocks: 5 + bits + slave.devices() - 1,
            slave,
        }
    }

    /// So many clocks; SLO as it is just before the edge that follows each rising one, rising.
    pub fn clock(&mut self, clocks: usize) -> String {
        let mut seen = String::new();
        for _ in 0..clocks {
            self.slave.ma(self.t_ns, false);
            self.slave.ma(self.t_ns + self.period_ns / 2, true);
            self.t_ns += self.period_ns;
            let at = self.t_ns + self.period_ns / 2 - 1;
            seen.push(if self.slave.slo(at) { '1' } else { '0' });
        }
        seen
    }

    /// The timeout with MA at the inverse of CDM, then MA high.
    pub fn rest(&mut self, cdm: bool) {
        if cdm {
            self.slave.ma(self.t_ns, false);
        }
        self.t_ns += self.rest_ns;
        self.slave.slo(self.t_ns);
        self.slave.ma(self.t_ns, true);
        self.t_ns += self.period_ns;
    }

    /// A whole frame of so many clocks.
    pub fn frame_of(&mut self, clocks: usize, cdm: bool) -> String {
        let seen = self.clock(clocks);
        self.rest(cdm);
        seen
    }

    pub fn frame(&mut self, cdm: bool) -> String {
        self.frame_of(self.clocks, cdm)
    }

    /// A CDM bit a frame; the CDS bits of these frames.
    pub fn control(&mut self, cdm: &str) -> String {
        cdm.chars()
            .map(|bit| after_start(&self.frame(bit == '1')).chars().next().unwrap())
            .collect()
    }

    /// Ends whatever was going on.
    pub fn reset(&mut self) {
        self.control("00000000000000");
    }

    /// One frame whose CDM depends on its CDS; returns CDS.
    pub fn react(&mut self, cdm: [bool; 2]) -> bool {
        let seen = self.clock(self.clocks);
        let cds = after_start(&seen).starts_with('1');
        self.rest(cdm[usize::from(cds)]);
        cds
    }

    /// S until it is echoed; the frame of the echo carries `next`. None when the slave never does.
    fn start(&mut self, next: bool) -> Option<()> {
        (0..1_000).find(|_| self.react([true, next])).map(drop)
    }

    /// R and W, and the first S. None where they come back otherwise.
    fn open(&mut self, id: u8, address: u8, read_write: &str) -> Option<()> {
        self.reset();
        self.control(&format!("1{}", register(id, address)));
        let seen = self.control(&format!("{read_write}1"));
        (seen[1..] == *read_write).then_some(())
    }

    /// Reads so many bytes and returns P behind them; `None` where the slave refuses.
    pub fn read(&mut self, id: u8, address: u8, count: usize) -> Option<(Vec<u8>, bool)> {
        self.open(id, address, "10")?;
        let mut bytes = Vec::new();
        for left in (0..count).rev() {
            self.start(false)?;
            let bits = self.control("000000000000");
            let (byte, crc) = bits.split_at(8);
            assert_eq!(crc, crc4(byte), "{bits}");
            bytes.push(u8::from_str_radix(byte, 2).unwrap());
            let stop = self.control(if left > 0 { "1" } else { "0" });
            if stop == "1" || left == 0 {
                return Some((bytes, stop == "1"));
            }
        }
        None
    }

    /// Writes bytes and returns how many were taken, and P behind them; `None` where the slave refuses.
    pub fn write(&mut self, id: u8, address: u8, bytes: &[u8]) -> Option<(usize, bool)> {
        self.open(id, address, "01")?;
        for (taken, byte) in (1..).zip(bytes) {
            let bits = format!("{byte:08b}");
            let bits = format!("{bits}{}", crc4(&bits));
            self.start(bits.starts_with('1'))?;
            let echo = self.control(&format!("{}0", &bits[1..]));
            assert_eq!(echo, bits);
            let more = taken < bytes.len();
            let stop = self.control(if more { "1" } else { "0" });
            if stop == "1" || !more {
                return Some((taken, stop == "1"));
            }
        }
        None
    }
}

/// What follows Ack and start: CDS, data, stop.
pub fn after_start(seen: &str) -> &str {
    let ack = seen.find('0').unwrap_or_else(|| panic!("no Ack: {seen}"));
    let start = seen[ack..]
        .find('1')
        .unwrap_or_else(|| panic!("no start: {seen}"));
    &seen[ack + start + 1..]
}

/// CTS, ID, ADR and their CRC.
pub fn register(id: u8, address: u8) -> String {
    let header = format!("1{id:03b}{address:07b}");
    format!("{header}{}", crc4(&header))
}

/// CTS, IDS, CMD and their CRC, then S; EX is still to come.
pub fn command(ids: &[u8], command: u8) -> String {
    let ids: String = (0..8)
        .map(|id| if ids.contains(&id) { '1' } else { '0' })
        .collect();
    let header = format!("0{ids}{command:02b}");
    format!("{header}{}1", crc4(&header))
}

/// Long division by x^4 + x + 1, as on paper, then inverted.
pub fn crc4(bits: &str) -> String {
    let mut rest: Vec<u8> = bits.bytes().chain(*b"0000").map(|bit| bit - b'0').collect();
    for at in 0..bits.len() {
        if rest[at] == 1 {
            for (offset, bit) in [1, 0, 0, 1, 1].into_iter().enumerate() {
                rest[at + offset] ^= bit;
            }
        }
    }
    rest[bits.len()..]
        .iter()
        .map(|bit| if *bit == 0 { '1' } else { '0' })
        .collect()
}
