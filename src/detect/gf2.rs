//! Polynomials over GF(2), as bit masks: bit n is the coefficient of xⁿ.

use std::sync::OnceLock;

/// The place of the top bit; `None` for 0.
pub(super) fn degree(a: u128) -> Option<u32> {
    a.checked_ilog2()
}

/// What remains of `a` divided by `g`, which is not 0.
pub(super) fn remainder(a: u128, g: u128) -> u128 {
    division(a, g).1
}

/// Quotient and remainder of `a` by `g`, which is not 0.
pub(super) fn division(mut a: u128, g: u128) -> (u128, u128) {
    let low = degree(g).unwrap_or(0);
    let mut quotient = 0;
    while let Some(high) = degree(a).filter(|high| *high >= low) {
        a ^= g << (high - low);
        quotient |= 1 << (high - low);
    }
    (quotient, a)
}

/// The greatest common divisor; that of 0 and 0 is 0.
pub(super) fn gcd(mut a: u128, mut b: u128) -> u128 {
    while b != 0 {
        (a, b) = (b, remainder(a, b));
    }
    a
}

/// Without the factors x.
pub(super) fn odd(a: u128) -> u128 {
    match a {
        0 => 0,
        _ => a >> a.trailing_zeros(),
    }
}

/// How many of the vectors are linearly independent.
pub(super) fn rank(vectors: impl Iterator<Item = u128>) -> u32 {
    let mut basis = [0u128; 128];
    let mut rank = 0;
    for mut vector in vectors {
        while let Some(top) = degree(vector) {
            let known = &mut basis[top as usize];
            if *known == 0 {
                *known = vector;
                rank += 1;
                break;
            }
            vector ^= *known;
        }
    }
    rank
}

/// The divisors of `a` with a degree of `least` to `most`, `most` at most 16, and a constant term, largest degree first;
/// at most `limit`.
pub(super) fn divisors(a: u128, least: u32, most: u32, limit: usize) -> Vec<u32> {
    let a = odd(a);
    if a == 0 {
        return Vec::new();
    }
    let mut found: Vec<u32> = vec![1];
    let mut left = a;
    let mut take = |prime: u128| {
        for index in 0..found.len() {
            let product = multiply(u128::from(found[index]), prime);
            let fits = degree(product).is_some_and(|degree| degree <= most);
            if let (true, Ok(product)) = (fits, u32::try_from(product)) {
                if !found.contains(&product) && found.len() < 8 * limit {
                    found.push(product);
                }
            }
        }
    };
    for prime in irreducible() {
        let prime = u128::from(*prime);
        // What is left has no factor of less than half its degree.
        if 2 * degree(prime).unwrap_or(0) > degree(left).unwrap_or(0) {
            break;
        }
        loop {
            let (quotient, rest) = division(left, prime);
            if rest != 0 {
                break;
            }
            left = quotient;
            take(prime);
        }
    }
    if degree(left).is_some_and(|degree| degree <= most) {
        take(left);
    }
    found.retain(|divisor| degree((*divisor).into()).is_some_and(|degree| degree >= least));
    found.sort_unstable_by(|a, b| b.cmp(a));
    found.truncate(limit);
    found
}

fn multiply(a: u128, b: u128) -> u128 {
    let places = 0..=degree(b).unwrap_or(0);
    let set = places.filter(|place| b >> place & 1 == 1);
    set.fold(0, |sum, place| sum ^ a << place)
}

/// Those of degree 1 to 16 with a constant term, in order.
fn irreducible() -> &'static [u32] {
    static ALL: OnceLock<Vec<u32>> = OnceLock::new();
    ALL.get_or_init(|| {
        const END: usize = 1 << 17;
        let mut composite = vec![false; END];
        let mut found = Vec::new();
        for a in 3..END {
            if a % 2 == 0 || composite[a] {
                continue;
            }
            found.push(a as u32);
            // A product's other factor is at least as large, or the product is marked already.
            let most = 16u32.saturating_sub(a.ilog2());
            if most < a.ilog2() {
                continue;
            }
            for b in a..2 << most {
                let product = multiply(a as u128, b as u128) as usize;
                if product < END {
                    composite[product] = true;
                }
            }
        }
        found
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn division_undoes_multiplication() {
        let mut rng = fastrand::Rng::with_seed(1);
        for _ in 0..10_000 {
            let (a, b) = (u128::from(rng.u64(1..)), u128::from(rng.u64(1..) >> 1 | 1));
            let rest = remainder(rng.u64(..).into(), b);
            assert_eq!(division(multiply(a, b) ^ rest, b), (a, rest));
            assert_eq!(remainder(multiply(a, b), gcd(a, b)), 0);
            assert_eq!(remainder(a, gcd(a, b)), 0);
        }
    }

    /// 3 of degree 5 and below have a constant term and no other factor twice over: 1, 1, 2, 3, 6, 9, 18, 30, 56, 99,
    /// 186, 335, 630, 1161, 2182, 4080 of degree 1 to 16 (OEIS A001037), x left out.
    #[test]
    fn as_many_irreducible_ones_as_there_are() {
        let counts = [
            1, 1, 2, 3, 6, 9, 18, 30, 56, 99, 186, 335, 630, 1161, 2182, 4080,
        ];
        for (index, count) in counts.iter().enumerate() {
            let of_degree = |p: &&u32| p.ilog2() as usize == index + 1;
            assert_eq!(
                irreducible().iter().filter(of_degree).count(),
                *count,
                "{index}"
            );
        }
    }

    #[test]
    fn divisors_divide() {
        let mut rng = fastrand::Rng::with_seed(2);
        for _ in 0..200 {
            let a = u128::from(rng.u32(8..)) << 32 | u128::from(rng.u32(..));
            let found = divisors(a, 3, 16, 64);
            for divisor in &found {
                assert_eq!(remainder(a, u128::from(*divisor)), 0);
                assert!((8..1 << 17).contains(divisor) && divisor % 2 == 1);
            }
            for known in [0xBu32, 0x43, 0x12F, 0x190D9] {
                let divides = remainder(a, known.into()) == 0;
                assert_eq!(
                    divides,
                    found.contains(&known) || found.len() == 64 && divides,
                    "{known:#x}"
                );
            }
        }
        assert_eq!(divisors(multiply(0x190D9, 0x43), 16, 16, 9).len(), {
            let all = divisors(multiply(0x190D9, 0x43), 3, 16, 999);
            all.iter().filter(|divisor| **divisor >= 1 << 16).count()
        });
    }

    #[test]
    fn ranks() {
        assert_eq!(rank([0, 1, 2, 3, 4, 7].into_iter()), 3);
        assert_eq!(rank([0u128; 4].into_iter()), 0);
    }
}
