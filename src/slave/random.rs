//! Chance that a seed repeats.

/// A small deterministic generator (SplitMix64), ours so that a seed means the same for ever.
#[derive(Clone, Debug)]
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ z >> 31
    }

    /// True `parts` times in a billion.
    pub(super) fn hit(&mut self, parts: u32) -> bool {
        parts > 0 && self.next() % 1_000_000_000 < u64::from(parts)
    }

    pub(super) fn between(&mut self, from: u64, to: u64) -> u64 {
        if from >= to {
            from
        } else {
            from + self.next() % (to - from + 1)
        }
    }
}
