//! A sampled recording, looked through for edges.

use crate::slice::Slicer;

/// Where a channel stands in a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// From the first byte of a sample.
    pub byte: usize,
    /// 0 is the least significant.
    pub bit: u8,
}

impl Place {
    /// Channel number `channel` of samples whose channels are counted from the first byte's least significant bit.
    pub fn of(channel: usize) -> Place {
        Place {
            byte: channel / 8,
            bit: (channel % 8) as u8,
        }
    }

    fn level(self, sample: &[u8]) -> bool {
        sample[self.byte] >> self.bit & 1 == 1
    }
}

/// Finds the edges in samples that come piece by piece, for a [`Slicer`].
#[derive(Clone, Debug)]
pub struct Scanner {
    step_fs: u64,
    unit: usize,
    ma: Place,
    slo: Place,
    /// Samples so far.
    samples: u64,
    levels: Option<(bool, bool)>,
}

impl Scanner {
    /// For samples of `unit` bytes, one every `step_fs` femtoseconds.
    ///
    /// # Panics
    /// Where a channel stands outside a sample.
    pub fn new(step_fs: u64, unit: usize, ma: Place, slo: Place) -> Scanner {
        assert!(ma.byte < unit && slo.byte < unit && ma.bit < 8 && slo.bit < 8);
        Scanner {
            step_fs,
            unit,
            ma,
            slo,
            samples: 0,
            levels: None,
        }
    }

    /// The time of the next sample.
    pub fn now_ns(&self) -> u64 {
        let fs = u128::from(self.samples) * u128::from(self.step_fs);
        u64::try_from(fs / 1_000_000).unwrap_or(u64::MAX)
    }

    /// Looks through whole samples; returns how many bytes that were. Call [`Slicer::finish`] with
    /// [`Scanner::now_ns`] after the last ones.
    pub fn scan(&mut self, bytes: &[u8], slicer: &mut Slicer) -> usize {
        let whole = bytes.len() - bytes.len() % self.unit;
        for sample in bytes[..whole].chunks_exact(self.unit) {
            let levels = (self.ma.level(sample), self.slo.level(sample));
            if self.levels != Some(levels) {
                slicer.push(self.now_ns(), levels.0, Some(levels.1));
                self.levels = Some(levels);
            }
            self.samples += 1;
        }
        whole
    }
}
