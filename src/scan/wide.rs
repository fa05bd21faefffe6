//! What a processor can do with many samples at once: in portable code, and with the instructions that some have.
//!
//! Beside `sys.rs` the only unsafe code: the instructions are asked for before they are used.
#![allow(unsafe_code)]

use super::region::BLOCK;

/// Work on 64 samples at a time.
pub(super) trait Wide {
    /// Asks memory for what comes some blocks behind the first byte, so that it works while a cycle is looked at.
    #[inline(always)]
    fn ahead(_bytes: &[u8]) {}

    /// In how many blocks, from the first one on, each byte is `level` in all bits of `mask`. Asks for more on its way.
    fn quiet(bytes: &[u8], level: u8, mask: u8) -> usize;

    /// Bit `bit` of each byte, the first one least significant.
    fn pick(bytes: &[u8; BLOCK], bit: u8) -> u64;

    /// Whether many bits are gathered as fast as one.
    const GATHERS: bool = false;

    /// The bits of `word` where `mask` is 1, side by side from the least significant one on.
    #[inline(always)]
    fn gather(word: u64, mask: u64) -> u64 {
        let bits = super::region::places(mask).zip(0..);
        bits.fold(0, |all, (at, place)| all | (word >> at & 1) << place)
    }
}

/// Something to be done with the widest instructions there are.
pub(super) trait Job {
    /// Marked `#[inline(always)]`, so that what it does becomes part of a function that may use those instructions.
    fn run<W: Wide>(self);
}

/// Does it.
pub(super) fn widest(job: impl Job) {
    #[cfg(target_arch = "x86_64")]
    if std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("bmi2") {
        // SAFETY: the processor has just said that it has both; every one that has BMI2 has the others.
        return unsafe { x86::run(job) };
    }
    portable(job);
}

/// Does it with what every processor of its kind has: nothing is asked for.
pub(super) fn portable(job: impl Job) {
    #[cfg(target_arch = "x86_64")]
    job.run::<x86::Sse2>();
    #[cfg(not(target_arch = "x86_64"))]
    job.run::<Portable>();
}

/// How many blocks, from the first one on, have nothing strange in them. Four at a time: a branch costs as much as half a
/// block.
#[inline(always)]
fn quiet_blocks<V: Copy>(
    bytes: &[u8],
    strange: impl Fn(&[u8; BLOCK]) -> V,
    both: impl Fn(V, V) -> V,
    none: impl Fn(V) -> bool,
) -> usize {
    let mut quiet = 0;
    let (blocks, _) = bytes.split_at(bytes.len() - bytes.len() % BLOCK);
    let mut fours = blocks.chunks_exact(4 * BLOCK);
    for four in fours.by_ref() {
        let [Some(a), Some(b), Some(c), Some(d)] = [0, 1, 2, 3].map(|at| {
            let (_, block) = four.split_at(at * BLOCK);
            block.first_chunk().map(&strange)
        }) else {
            break;
        };
        if !none(both(both(a, b), both(c, d))) {
            return quiet + [a, b, c, d].into_iter().take_while(|v| none(*v)).count();
        }
        quiet += 4;
    }
    for block in fours.remainder().chunks_exact(BLOCK) {
        match block.first_chunk() {
            Some(block) if none(strange(block)) => quiet += 1,
            _ => break,
        }
    }
    quiet
}

/// Every processor.
#[cfg_attr(target_arch = "x86_64", allow(dead_code))]
struct Portable;

impl Wide for Portable {
    #[inline(always)]
    fn quiet(bytes: &[u8], level: u8, mask: u8) -> usize {
        let all = |byte: u8| u64::from_ne_bytes([byte; 8]);
        let (level, mask) = (all(level), all(mask));
        let strange = |block: &[u8; BLOCK]| {
            block.chunks_exact(8).fold(0, |strange, eight| {
                strange | eight.try_into().map_or(!0, u64::from_ne_bytes) ^ level
            })
        };
        quiet_blocks(
            bytes,
            strange,
            |one, other| one | other,
            |all| all & mask == 0,
        )
    }

    #[inline(always)]
    fn pick(bytes: &[u8; BLOCK], bit: u8) -> u64 {
        const LOWEST: u64 = 0x0101_0101_0101_0101;
        /// Adds up the bits of eight bytes in the top one, each in a place of its own.
        const TOGETHER: u64 = 0x0102_0408_1020_4080;
        let mut word = 0;
        for (index, eight) in bytes.chunks_exact(8).enumerate() {
            let eight = eight.try_into().map_or(0, u64::from_le_bytes);
            let bits = (eight >> bit) & LOWEST;
            word |= (bits.wrapping_mul(TOGETHER) >> 56) << (8 * index);
        }
        word
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{BLOCK, Job, Wide, quiet_blocks};
    use std::arch::x86_64::{
        __m128i, __m256i, _MM_HINT_T1, _mm_and_si128, _mm_cmpeq_epi8, _mm_cvtsi32_si128,
        _mm_loadu_si128, _mm_movemask_epi8, _mm_or_si128, _mm_prefetch, _mm_set1_epi8,
        _mm_setzero_si128, _mm_sll_epi16, _mm_xor_si128, _mm256_loadu_si256, _mm256_movemask_epi8,
        _mm256_or_si256, _mm256_set1_epi8, _mm256_sll_epi16, _mm256_testz_si256, _mm256_xor_si256,
        _pext_u64,
    };

    /// # Safety
    /// The processor must have these.
    #[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
    pub(super) unsafe fn run(job: impl Job) {
        job.run::<Avx2>();
    }

    /// How far ahead memory is asked for: about what it delivers while a cycle is looked at.
    const AHEAD: usize = 64 * BLOCK;

    #[inline(always)]
    fn ahead(bytes: &[u8]) {
        // SAFETY: asking for memory that does not exist does nothing, and every x86-64 may ask.
        unsafe { _mm_prefetch::<_MM_HINT_T1>(bytes.as_ptr().wrapping_add(AHEAD).cast()) };
    }

    /// SSE2, which every x86-64 has.
    pub(super) struct Sse2;

    impl Sse2 {
        #[inline(always)]
        fn quarters(bytes: &[u8; BLOCK]) -> [__m128i; 4] {
            [0, 16, 32, 48].map(|at| {
                let quarter: &[u8] = &bytes[at..at + 16];
                // SAFETY: a quarter has 16 bytes, and the load needs no alignment.
                unsafe { _mm_loadu_si128(quarter.as_ptr().cast()) }
            })
        }
    }

    impl Wide for Sse2 {
        #[inline(always)]
        fn ahead(bytes: &[u8]) {
            ahead(bytes);
        }

        #[inline(always)]
        fn quiet(bytes: &[u8], level: u8, mask: u8) -> usize {
            let idle = level & mask == mask;
            // SAFETY: works on registers only, and every x86-64 has SSE2.
            let (level, mask) = unsafe { (_mm_set1_epi8(level as i8), _mm_set1_epi8(mask as i8)) };
            let none = |seen, level| {
                // SAFETY: as above.
                unsafe {
                    let equal = _mm_cmpeq_epi8(_mm_and_si128(seen, mask), level);
                    _mm_movemask_epi8(equal) == 0xffff
                }
            };
            // SAFETY: as above.
            let and = |one, other| unsafe { _mm_and_si128(one, other) };
            // SAFETY: as above.
            let or = |one, other| unsafe { _mm_or_si128(one, other) };
            // SAFETY: as above.
            let strange = |quarter| unsafe { _mm_xor_si128(quarter, level) };
            let quarters = |block: &[u8; BLOCK]| {
                ahead(block);
                Sse2::quarters(block)
            };
            if idle {
                // Ones everywhere: most of a recording, and told with less.
                let all = |block: &[u8; BLOCK]| {
                    let [a, b, c, d] = quarters(block);
                    and(and(a, b), and(c, d))
                };
                return quiet_blocks(bytes, all, and, |all| none(all, mask));
            }
            let any = |block: &[u8; BLOCK]| {
                let [a, b, c, d] = quarters(block).map(strange);
                or(or(a, b), or(c, d))
            };
            // SAFETY: as above.
            let zero = unsafe { _mm_setzero_si128() };
            quiet_blocks(bytes, any, or, |any| none(any, zero))
        }

        #[inline(always)]
        fn pick(bytes: &[u8; BLOCK], bit: u8) -> u64 {
            let tops = Sse2::quarters(bytes).map(|quarter| {
                // SAFETY: works on registers only, and every x86-64 has SSE2.
                let tops = unsafe {
                    let top = _mm_cvtsi32_si128(7 - i32::from(bit));
                    _mm_movemask_epi8(_mm_sll_epi16(quarter, top))
                };
                u64::from(tops as u32)
            });
            tops[0] | tops[1] << 16 | tops[2] << 32 | tops[3] << 48
        }
    }

    /// AVX2 and BMI2: used by [`run`] only.
    struct Avx2;

    impl Avx2 {
        #[inline(always)]
        fn halves(bytes: &[u8; BLOCK]) -> [__m256i; 2] {
            let (low, high) = bytes.split_at(BLOCK / 2);
            // SAFETY: each half has 32 bytes, and the load needs no alignment; AVX2 is there, see `Avx2`.
            [low, high].map(|half| unsafe { _mm256_loadu_si256(half.as_ptr().cast()) })
        }
    }

    impl Wide for Avx2 {
        const GATHERS: bool = true;

        #[inline(always)]
        fn ahead(bytes: &[u8]) {
            ahead(bytes);
        }

        #[inline(always)]
        fn quiet(bytes: &[u8], level: u8, mask: u8) -> usize {
            // SAFETY: works on registers only; AVX2 is there, see `Avx2`.
            let (level, mask) =
                unsafe { (_mm256_set1_epi8(level as i8), _mm256_set1_epi8(mask as i8)) };
            let strange = |block: &[u8; BLOCK]| {
                ahead(block);
                let [low, high] = Avx2::halves(block);
                // SAFETY: as above.
                unsafe {
                    _mm256_or_si256(_mm256_xor_si256(low, level), _mm256_xor_si256(high, level))
                }
            };
            // SAFETY: as above.
            let none = |strange| unsafe { _mm256_testz_si256(strange, mask) != 0 };
            // One at a time: four cost less work, and more wrong guesses.
            let blocks = bytes.chunks_exact(BLOCK).map(<[u8]>::first_chunk);
            blocks
                .take_while(|block| block.is_some_and(|block| none(strange(block))))
                .count()
        }

        #[inline(always)]
        fn pick(bytes: &[u8; BLOCK], bit: u8) -> u64 {
            let [low, high] = Avx2::halves(bytes).map(|half| {
                // SAFETY: works on registers only; AVX2 is there, see `Avx2`.
                let tops = unsafe {
                    _mm256_movemask_epi8(_mm256_sll_epi16(
                        half,
                        _mm_cvtsi32_si128(7 - i32::from(bit)),
                    ))
                };
                u64::from(tops as u32)
            });
            low | high << 32
        }

        #[inline(always)]
        fn gather(word: u64, mask: u64) -> u64 {
            // SAFETY: works on registers only; BMI2 is there, see `Avx2`.
            unsafe { _pext_u64(word, mask) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Look<'a>(&'a [u8; BLOCK], u8, u64, &'a mut Vec<(usize, u64, u64)>);

    impl Job for Look<'_> {
        #[inline(always)]
        fn run<W: Wide>(self) {
            let Look(bytes, bit, mask, seen) = self;
            let quiet = W::quiet(bytes, bytes[0], 1 << bit);
            seen.push((
                quiet,
                W::pick(bytes, bit),
                W::gather(mask.rotate_left(9), mask),
            ));
        }
    }

    struct Quiet<'a>(&'a [u8], u8, u8, &'a mut Vec<usize>);

    impl Job for Quiet<'_> {
        #[inline(always)]
        fn run<W: Wide>(self) {
            let Quiet(bytes, level, mask, seen) = self;
            seen.push(W::quiet(bytes, level, mask));
        }
    }

    /// Many blocks, of which one is strange, or one bit that does not count.
    #[test]
    fn all_ways_find_the_first_strange_block() {
        let seed = fastrand::u64(..);
        println!("seed {seed}");
        let mut rng = fastrand::Rng::with_seed(seed);
        for _ in 0..20_000 {
            let (level, mask) = (rng.u8(..), 1 << rng.u8(0..8) | 1 << rng.u8(0..8));
            let len = rng.usize(0..=11 * BLOCK);
            let mut bytes: Vec<u8> = (0..len)
                .map(|_| level & mask | rng.u8(..) & !mask)
                .collect();
            for _ in 0..rng.usize(0..3) {
                if let Some(byte) = bytes.get_mut(rng.usize(0..11 * BLOCK)) {
                    *byte ^= 1 << rng.u8(0..8);
                }
            }
            let strange = |block: &[u8]| block.iter().any(|byte| (byte ^ level) & mask != 0);
            let blocks = bytes.chunks_exact(BLOCK);
            let want = blocks.take_while(|block| !strange(block)).count();
            let mut seen = Vec::new();
            // Without the bits that do not count, as the scanner has it, and with them.
            for level in [level & mask, level] {
                widest(Quiet(&bytes, level, mask, &mut seen));
                portable(Quiet(&bytes, level, mask, &mut seen));
                Quiet(&bytes, level, mask, &mut seen).run::<Portable>();
            }
            assert_eq!(seen, [want; 6]);
        }
    }

    /// Both against the definitions.
    #[test]
    fn all_ways_agree() {
        let seed = fastrand::u64(..);
        println!("seed {seed}");
        let mut rng = fastrand::Rng::with_seed(seed);
        for _ in 0..20_000 {
            let few = rng.bool();
            let bytes: [u8; BLOCK] = std::array::from_fn(|_| {
                if few {
                    u8::from(rng.u8(..) == 0)
                } else {
                    rng.u8(..)
                }
            });
            let (bit, mask) = (rng.u8(0..8), rng.u64(..) & rng.u64(..));
            let pick = |word, (at, byte): (usize, &u8)| word | u64::from(byte >> bit & 1) << at;
            let picked = bytes.iter().enumerate().fold(0, pick);
            let ones = (0..64).filter(|at| mask >> at & 1 == 1);
            let gathered = ones.enumerate().fold(0, |word, (place, at)| {
                word | (mask.rotate_left(9) >> at & 1) << place
            });
            let quiet = usize::from(picked == 0 || picked == !0);
            let want = (quiet, picked, gathered);
            let mut seen = Vec::new();
            widest(Look(&bytes, bit, mask, &mut seen));
            portable(Look(&bytes, bit, mask, &mut seen));
            Look(&bytes, bit, mask, &mut seen).run::<Portable>();
            assert_eq!(seen, [want; 3]);
        }
    }
}
