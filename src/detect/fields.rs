//! What the data bits in front of a CRC mean, as far as their motion shows it.

/// Which bits stand behind the position, and how likely that is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reading {
    pub(super) flags: Flags,
    /// Bits of a sign of life at the end, 0 or 6.
    pub(super) life: u8,
    /// Zeros at the end of the position, which move with nothing.
    pub(super) zeros: u8,
    /// log2 of its odds against the other readings.
    pub(super) score: f64,
}

/// Error and warning bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Flags {
    None,
    /// nE,nW
    Low,
    /// E,W
    High,
    /// nE alone
    OneLow,
}

impl Flags {
    pub(super) fn bits(self) -> u8 {
        match self {
            Flags::None => 0,
            Flags::OneLow => 1,
            Flags::Low | Flags::High => 2,
        }
    }

    /// As they stand in a format.
    pub(super) fn names(self) -> &'static [&'static str] {
        match self {
            Flags::None => &[],
            Flags::OneLow => &["nE"],
            Flags::Low => &["nE", "nW"],
            Flags::High => &["E", "W"],
        }
    }

    /// How likely encoders have them (nearly all follow profile BP3: nE and nW), before anything is seen.
    fn prior(self) -> f64 {
        match self {
            Flags::None => 0.13,
            Flags::OneLow => 0.01,
            Flags::Low => 0.82,
            Flags::High => 0.04,
        }
    }

    /// How likely they stand like that.
    fn shows(self, value: u64) -> f64 {
        match (self, value) {
            (Flags::None, _) => 0.25,
            (Flags::OneLow, 1 | 3) => 0.475,
            (Flags::OneLow, _) => 0.025,
            (Flags::Low, 0b11) | (Flags::High, 0b00) => 0.93,
            (Flags::Low, 0b10) | (Flags::High, 0b01) => 0.04,
            (Flags::Low, 0b01) | (Flags::High, 0b10) => 0.02,
            (Flags::Low, _) => 0.002,
            (Flags::High, _) => 0.01,
        }
    }
}

/// A multi-turn counter above a single-turn position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Split {
    pub(super) turn_bits: u8,
    /// Bits between both that never moved.
    pub(super) between: u8,
    /// Turns count down while the position counts up.
    pub(super) against: bool,
}

/// Data words in the order they came; where one is missing, or bad, there is none.
pub(super) struct Words {
    pub(super) bits: u8,
    pub(super) words: Vec<Option<u64>>,
}

/// log2 of the odds that a position's lowest bits stand still while it moves.
const FROZEN: f64 = -6.7;
/// The same where all its steps are alike, so that they may be multiples of four.
const FROZEN_IN_STEPS: f64 = -3.5;
/// What motion can tell of one bit, in bits; more of it is not more certain.
const MOST: f64 = 14.0;
/// Bits of the sign of life (BiSS Safety Concept A5).
const LIFE_BITS: u8 = 6;

impl Words {
    fn good(&self) -> impl Iterator<Item = u64> + '_ {
        self.words.iter().copied().flatten()
    }

    /// Each good word and the good one after it.
    fn pairs(&self) -> impl Iterator<Item = (u64, u64)> + '_ {
        self.words
            .windows(2)
            .filter_map(|pair| Some((pair[0]?, pair[1]?)))
    }

    /// Which bits are not the same in all words.
    pub(super) fn moving(&self) -> u64 {
        let first = self.good().next().unwrap_or(0);
        self.good().fold(0, |ever, word| ever | (word ^ first))
    }

    /// All readings that are worth telling, likeliest first. `life_likely` where the CRC is one of a safety profile.
    pub(super) fn readings(&self, life_likely: bool) -> Vec<Reading> {
        let life = match life_likely && self.bits > LIFE_BITS + 2 {
            true => self.life(),
            false => None,
        };
        let mut found = match life {
            Some(Life::Counts) => self.flagged(LIFE_BITS),
            Some(Life::Perhaps) => {
                let mut both = self.flagged(LIFE_BITS);
                both.extend(self.flagged(0));
                both
            }
            None => self.flagged(0),
        };
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
        found
    }

    /// Readings by their flags, above `life` bits of a sign of life.
    fn flagged(&self, life: u8) -> Vec<Reading> {
        let all = [Flags::Low, Flags::None, Flags::High, Flags::OneLow];
        let fits = |flags: &Flags| self.bits > flags.bits() + life;
        all.into_iter()
            .filter(fits)
            .map(|flags| self.reading(flags, life))
            .collect()
    }

    fn reading(&self, flags: Flags, life: u8) -> Reading {
        let tail = flags.bits() + life;
        let zeros = self.zeros(tail);
        Reading {
            flags,
            life,
            zeros,
            score: self.flags_score(flags, life),
        }
    }

    /// Bits that stand still while the position above them moves are no part of it, nor are some that change rarely.
    fn flags_score(&self, flags: Flags, life: u8) -> f64 {
        let two = |word: u64| word >> life & 3;
        let majority =
            (0..4).max_by_key(|value| self.good().filter(|word| two(*word) == *value).count());
        let shown = majority.unwrap_or(0);
        let still = [0, 1].map(|bit| self.apart(life + bit, life + 2).clamp(-4.0 * MOST, MOST));
        let moves = |bit: u8| self.moving() >> (life + bit) & 1 == 1;
        let both = still[0] + still[1];
        // What is left-aligned ends in zeros: then two more of them are no flags that happen to be 0.
        let left_aligned = shown == 0 && self.zeros(life) > 2;
        let frozen = match self.uneven_steps(life + 2) {
            _ if left_aligned => -1.0,
            0 => FROZEN_IN_STEPS,
            _ => FROZEN,
        };
        let prior = (flags.prior() * flags.shows(shown) / 0.25).log2();
        prior
            + match flags {
                Flags::Low | Flags::High if left_aligned => both - 2.0,
                Flags::Low | Flags::High => both,
                Flags::OneLow if !moves(1) => FROZEN + both,
                Flags::OneLow => still[0],
                // A position whose lowest bits stand still: by chance, or because it moves in steps.
                Flags::None if !moves(0) && !moves(1) => (frozen + both).max(0.0),
                Flags::None => 0.0,
            }
    }

    /// How much speaks for a bit that is no part of the position from bit `above` on, in bits: what the position's lowest
    /// bit would have told, less what this one tells by how often it changes and how it mostly stands.
    fn apart(&self, bit: u8, above: u8) -> f64 {
        let (mut pairs, mut moved, mut changes, mut ones) = (0u32, 0u32, 0u32, 0u32);
        for (a, b) in self.pairs() {
            pairs += 1;
            moved += u32::from((a ^ b).checked_shr(above.into()) > Some(0));
            changes += u32::from((a ^ b) >> bit & 1 == 1);
            ones += u32::from(a >> bit & 1 == 1);
        }
        if pairs == 0 {
            return 0.0;
        }
        let share = |count: u32| f64::from(count) / f64::from(pairs);
        let told = entropy(share(changes).min(0.5)).max(entropy(share(ones)));
        // One that changes by chance is no flag.
        let random = (f64::from(pairs) / 2.0).min(2.0 * MOST) * ((told - 0.9) / 0.1).max(0.0);
        f64::from(moved) - told * f64::from(pairs) - random
    }

    /// Zeros above the lowest `tail` bits that never move while the position above them does.
    fn zeros(&self, tail: u8) -> u8 {
        // A few frames show nothing, and steps that are all alike are multiples of anything.
        const LEAST: usize = 8;
        let moved = self.pairs().filter(|(a, b)| a >> tail != b >> tail);
        if moved.count() < LEAST || self.uneven_steps(tail) < LEAST / 2 {
            return 0;
        }
        let ever = self.good().fold(0, |ever, word| ever | word) >> tail;
        match self.moving() >> tail {
            0 => 0,
            moving => moving.trailing_zeros().min(ever.trailing_zeros()) as u8,
        }
    }

    /// How often what is above the lowest `tail` bits has not moved as far as the time before.
    fn uneven_steps(&self, tail: u8) -> usize {
        let step = |a: u64, b: u64| (b >> tail).wrapping_sub(a >> tail) << tail;
        let uneven = |three: &&[Option<u64>]| match three {
            [Some(a), Some(b), Some(c)] => step(*a, *b) != step(*b, *c),
            _ => false,
        };
        self.words.windows(3).filter(uneven).count()
    }

    fn life(&self) -> Option<Life> {
        const LEAST: usize = 2;
        let mask = (1 << LIFE_BITS) - 1;
        let (mut pairs, mut wraps, mut carries) = (0, 0, 0);
        for (a, b) in self.pairs() {
            let (low, next) = (a & mask, b & mask);
            let skips_zero = low == mask && next == 1;
            if next != ((low + 1) & mask) && !skips_zero {
                return None;
            }
            pairs += 1;
            if next < low {
                wraps += 1;
                // A position would carry into the bits above.
                carries +=
                    usize::from(a >> LIFE_BITS != b >> LIFE_BITS && (a ^ b) >> LIFE_BITS & 1 == 1);
            }
        }
        match (pairs, wraps) {
            (pairs, _) if pairs < LEAST => None,
            (_, 0) => Some(Life::Perhaps),
            _ if carries == wraps => None,
            _ => Some(Life::Counts),
        }
    }

    /// Turns above a position show only where both are not one seamless number: bits between them that stand still, turns
    /// that count the other way, or a position that wraps before its bits do.
    pub(super) fn split(&self, reading: &Reading) -> Option<Split> {
        let tail = reading.flags.bits() + reading.life;
        let width = self.bits - tail;
        (3..width).find_map(|low_bits| self.splits_at(tail, low_bits, width))
    }

    fn splits_at(&self, tail: u8, low_bits: u8, width: u8) -> Option<Split> {
        const LEAST_WRAPS: u32 = 2;
        let mask = (1u64 << low_bits) - 1;
        let low = |word: u64| (word >> tail & mask) as i128;
        let high = |word: u64| (word >> tail >> low_bits) as i128;
        let most = self.good().map(low).max()?;
        let range = most + 1;
        if range <= i128::from(mask / 2) {
            return None;
        }
        let (mut step, mut wraps, mut shift, mut against) = (0, 0, None, None);
        for (a, b) in self.pairs() {
            let dl = low(b) - low(a);
            // Turns roll over too; of a single bit nobody knows which way.
            let all = 1i128 << (width - low_bits);
            let dh = match (high(b) - high(a)).rem_euclid(all) {
                half if 2 * half == all && dl > 0 => -half,
                up if 2 * up > all => up - all,
                up => up,
            };
            if dh == 0 {
                step = step.max(dl.abs());
                continue;
            }
            let turned_back = (dl > 0) == (dh > 0);
            let place = dh.unsigned_abs();
            let same = shift.is_none_or(|known| known == place)
                && against.is_none_or(|known| known == turned_back);
            if !place.is_power_of_two() || !same || 2 * dl.abs() < range {
                return None;
            }
            (shift, against) = (Some(place), Some(turned_back));
            wraps += 1;
        }
        let (between, against) = (shift?.trailing_zeros() as u8, against?);
        let early = i128::from(mask) - most > 2 * step + 2;
        let seen = between > 0 || against || early;
        let turn_bits = (width - low_bits)
            .checked_sub(between)
            .filter(|bits| *bits > 0)?;
        (wraps >= LEAST_WRAPS && 4 * step < range && seen).then_some(Split {
            turn_bits,
            between,
            against,
        })
    }
}

/// Of something that comes with this probability, in bits.
fn entropy(share: f64) -> f64 {
    let part = |share: f64| {
        if share > 0.0 {
            -share * share.log2()
        } else {
            0.0
        }
    };
    part(share) + part(1.0 - share)
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Life {
    Counts,
    /// It has not rolled over yet: a position may count so too.
    Perhaps,
}
