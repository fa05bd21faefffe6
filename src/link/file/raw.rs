//! Nothing but samples, as `sigrok-cli -O binary`, a PRU, an FPGA or a DMA buffer leaves them: bit 0 of the first byte of each
//! is channel 0.

use super::source::{Channel, Damage, Source, step_fs};
use super::tape::Blocks;
use crate::scan::{Place, Scanner};
use crate::slice::Slicer;
use std::io::{ErrorKind, Read};

/// Read at once.
pub(super) const BLOCK: usize = 128 << 10;

/// Samples of so many bytes.
pub(super) struct Raw {
    input: Box<dyn Blocks>,
    rate_hz: u64,
    unit: usize,
    channels: Vec<Channel>,
    scanner: Option<Scanner>,
    buffer: Vec<u8>,
    /// Bytes at its beginning that are no whole sample yet.
    rest: usize,
    /// Bytes before it.
    before: u64,
}

impl Raw {
    pub(super) fn open(input: impl Blocks + 'static, rate_hz: u64, unit: usize) -> Raw {
        let channels = (0..8 * unit).map(|id| Channel {
            name: id.to_string(),
            path: id.to_string(),
            id,
        });
        Raw {
            input: Box::new(input),
            rate_hz,
            unit,
            channels: channels.collect(),
            scanner: None,
            buffer: vec![0; BLOCK],
            rest: 0,
            before: 0,
        }
    }
}

impl Source for Raw {
    fn channels(&self) -> &[Channel] {
        &self.channels
    }

    fn select(&mut self, ma: usize, slo: usize) {
        let (ma, slo) = (Place::of(ma), Place::of(slo));
        self.scanner = Some(Scanner::new(step_fs(self.rate_hz), self.unit, ma, slo));
    }

    fn read(&mut self, slicer: &mut Slicer) -> Result<bool, Damage> {
        let Some(scanner) = &mut self.scanner else {
            return Ok(false);
        };
        let damage = |at: u64, said: String| Damage {
            place: format!("byte {at}"),
            said,
        };
        let n = loop {
            let read = match self.rest {
                0 => self.input.exchange(&mut self.buffer),
                rest => self.input.read(&mut self.buffer[rest..]),
            };
            match read {
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(damage(self.before, error.to_string())),
                Ok(n) => break n,
            }
        };
        if n == 0 && self.rest > 0 {
            let (rest, unit) = (self.rest, self.unit);
            let said = format!("{rest} bytes are left, and a sample has {unit}");
            return Err(damage(self.before, said));
        }
        let end = self.rest + n;
        let used = scanner.scan(&self.buffer[..end], slicer);
        self.buffer.copy_within(used..end, 0);
        self.rest = end - used;
        self.before += used as u64;
        Ok(n > 0)
    }

    fn now_ns(&self) -> u64 {
        self.scanner.as_ref().map_or(0, Scanner::now_ns)
    }

    fn finish(&mut self, slicer: &mut Slicer) {
        if let Some(scanner) = &mut self.scanner {
            scanner.finish(slicer);
        }
    }
}
