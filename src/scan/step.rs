//! The time between samples.

const FS_PER_NS: u64 = 1_000_000;

/// From sample to sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Step {
    whole_ns: u64,
    rest_fs: u64,
}

impl Step {
    pub(super) fn fs(fs: u64) -> Step {
        Step {
            whole_ns: fs / FS_PER_NS,
            rest_fs: fs % FS_PER_NS,
        }
    }

    /// When sample number `sample` was taken, rounded down.
    #[inline(always)]
    pub(super) fn ns(self, sample: u64) -> u64 {
        let whole = sample.saturating_mul(self.whole_ns);
        if self.rest_fs == 0 {
            return whole;
        }
        let rest = match sample.checked_mul(self.rest_fs) {
            Some(fs) => fs / FS_PER_NS,
            None => (u128::from(sample) * u128::from(self.rest_fs) / u128::from(FS_PER_NS)) as u64,
        };
        whole.saturating_add(rest)
    }

    /// The last sample, counted from `first` on and looked for from `guess` on, that was not taken after `t_ns`.
    #[inline(always)]
    pub(super) fn sample(self, t_ns: u64, first: u64, guess: u32) -> u32 {
        let at = |place: u32| self.ns(first + u64::from(place));
        let ahead = t_ns.saturating_sub(at(guess)) / (self.whole_ns + 1);
        let mut place = guess + ahead as u32;
        while at(place + 1) <= t_ns {
            place += 1;
        }
        place
    }

    /// Where it is a whole number of nanoseconds.
    pub(super) fn whole_ns(self) -> Option<u64> {
        (self.rest_fs == 0).then_some(self.whole_ns)
    }
}
