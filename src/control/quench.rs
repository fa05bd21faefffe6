//! How a write is ended that was disturbed.
//!
//! A slave that is in the middle of a byte reads on: whatever CDM comes next completes it, and 1 in 16 bytes made of
//! half a value and zeros has the right CRC. So the bits that follow are chosen so that no CRC can be right, wherever
//! the slave is: a frame in which MA stood still may have given it no bit, one, or several.
//!
//! After one such frame there are always bits that are right everywhere. After several within a dozen there may be none;
//! then those that are wrong for the least likely places.

use super::crc4;

/// Bits after which every slave has read its byte to the end: data, CRC, P and what it may be behind.
const LONGEST: usize = 16;

/// How many beginnings are followed when the bits are chosen.
const BEAM: usize = 64;

/// Where in a write a slave is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Reader {
    /// It waits for S.
    Waits,
    /// It has so many bits of a byte and its CRC.
    Bits { have: u8, bits: u16 },
    /// It takes one bit more, whatever that is, before it waits for S.
    Ends,
}

impl Reader {
    /// Takes a bit; `None` if it now takes the byte for good.
    fn takes(self, bit: bool) -> Option<Reader> {
        match self {
            Reader::Waits if bit => Some(Reader::Bits { have: 0, bits: 0 }),
            Reader::Waits | Reader::Ends => Some(Reader::Waits),
            Reader::Bits { have, bits } => {
                let bits = bits << 1 | u16::from(bit);
                if have < 11 {
                    return Some(Reader::Bits {
                        have: have + 1,
                        bits,
                    });
                }
                let good = u16::from(crc4(u64::from(bits >> 4), 8)) == bits & 0xF;
                (!good).then_some(Reader::Ends)
            }
        }
    }

    /// Whether it takes a byte for good when only zeros follow.
    fn completes(self) -> bool {
        let zeros = match self {
            Reader::Bits { have, .. } => 12 - have,
            _ => 0,
        };
        let rest = (0..zeros).try_fold(self, |reader, _| reader.takes(false));
        rest.is_none()
    }
}

/// A place where the slave may be, and how likely that is.
#[derive(Clone, Copy, Debug)]
struct Place {
    reader: Reader,
    weight: u64,
}

/// The bits to send next, and where the slave may be.
#[derive(Clone, Debug, Default)]
pub(super) struct Quench {
    places: Vec<Place>,
    /// To be sent, the next one last.
    tail: Vec<bool>,
}

impl Quench {
    /// For a slave that is in one of these places.
    pub(super) fn new(readers: &[Reader]) -> Quench {
        let places = readers.iter().map(|reader| Place {
            reader: *reader,
            weight: 1,
        });
        let mut quench = Quench {
            places: places.collect(),
            tail: Vec::new(),
        };
        quench.plan();
        quench
    }

    /// The next bit; none when it is over.
    pub(super) fn bit(&self) -> Option<bool> {
        self.tail.last().copied()
    }

    /// Whether no slave is in a byte any more.
    pub(super) fn is_over(&self) -> bool {
        self.tail.is_empty()
    }

    /// A whole frame has carried this bit.
    pub(super) fn sent(&mut self, bit: bool) {
        self.tail.pop();
        let moved = self
            .places
            .iter()
            .map(|place| (place.weight, place.reader.takes(bit)));
        self.places = merged(moved);
    }

    /// A frame was not whole. Each pause in it that was longer than the slave's timeout has given the slave a bit; `cdm` is
    /// what came after its last clock, unless a pause there hid it.
    pub(super) fn slip(&mut self, cdm: Option<bool>) {
        let taken = taken(cdm);
        // Weights need not grow for ever.
        let most = self
            .places
            .iter()
            .map(|place| place.weight)
            .max()
            .unwrap_or(1);
        let scale = (most >> 16).max(1);
        let moved = self.places.iter().flat_map(|place| {
            taken.iter().map(move |(likely, bits)| {
                let after = bits
                    .iter()
                    .try_fold(place.reader, |reader, bit| reader.takes(*bit));
                ((place.weight / scale).max(1) * likely, after)
            })
        });
        self.places = merged(moved);
        self.plan();
    }

    /// Chooses the bits. Those of a byte that zeros end well enough are zeros, and are followed as well: another frame may be
    /// disturbed before it is over.
    fn plan(&mut self) {
        let mut ways = vec![Way {
            lost: 0,
            bits: Vec::new(),
            places: self.places.clone(),
        }];
        for _ in 0..LONGEST {
            ways = ways
                .iter()
                .flat_map(|way| [way.then(false), way.then(true)])
                .collect();
            ways.sort_by_key(|way| (way.lost, way.length()));
            ways.truncate(BEAM);
        }
        let best = ways
            .into_iter()
            .min_by_key(|way| (way.lost_in_the_end(), way.length()));
        let mut bits = best.map_or_else(Vec::new, |way| way.bits[..way.length()].to_vec());
        bits.extend(std::iter::repeat_n(false, self.left_after(&bits)));
        bits.reverse();
        self.tail = bits;
    }

    /// Bits until every byte that may be under way is over.
    fn longest(&self) -> usize {
        let left = |place: &Place| match place.reader {
            Reader::Bits { have, .. } => usize::from(12 - have),
            _ => 0,
        };
        self.places.iter().map(left).max().unwrap_or(0)
    }

    /// Bits until every byte is over that may be under way after these ones.
    fn left_after(&self, bits: &[bool]) -> usize {
        let mut after = self.clone();
        for bit in bits {
            after.sent(*bit);
        }
        after.longest()
    }
}

/// A beginning of the bits to send.
#[derive(Clone, Debug)]
struct Way {
    /// Weight of the places where it completes a byte.
    lost: u64,
    bits: Vec<bool>,
    places: Vec<Place>,
}

impl Way {
    fn then(&self, bit: bool) -> Way {
        let mut lost = self.lost;
        let mut moved = Vec::with_capacity(self.places.len());
        for place in &self.places {
            match place.reader.takes(bit) {
                None => lost += place.weight,
                after => moved.push((place.weight, after)),
            }
        }
        let mut bits = self.bits.clone();
        bits.push(bit);
        Way {
            lost,
            bits,
            places: merged(moved.into_iter()),
        }
    }

    /// Bits up to the last one that is 1.
    fn length(&self) -> usize {
        self.bits
            .iter()
            .rposition(|bit| *bit)
            .map_or(0, |last| last + 1)
    }

    fn lost_in_the_end(&self) -> u64 {
        let completes = self.places.iter().filter(|place| place.reader.completes());
        self.lost + completes.map(|place| place.weight).sum::<u64>()
    }
}

/// Each place once. A slave that has taken a byte for good waits for its end.
fn merged(moved: impl Iterator<Item = (u64, Option<Reader>)>) -> Vec<Place> {
    let mut places: Vec<Place> = moved
        .map(|(weight, reader)| Place {
            reader: reader.unwrap_or(Reader::Ends),
            weight,
        })
        .collect();
    places.sort_unstable_by_key(|place| place.reader);
    places.dedup_by(|next, kept| {
        let same = next.reader == kept.reader;
        kept.weight += if same { next.weight } else { 0 };
        same
    });
    places
}

/// What a slave may have taken from a frame that was not whole, and how likely that is. One pause is likelier than two.
fn taken(cdm: Option<bool>) -> Vec<(u64, Vec<bool>)> {
    let strings = |count: u32| {
        (0..1u32 << count).map(move |bits| (0..count).map(|at| bits >> at & 1 == 1).collect())
    };
    let Some(sent) = cdm else {
        return vec![(4, vec![]), (1, vec![false])];
    };
    (0..=3)
        .flat_map(strings)
        .filter_map(|bits: Vec<bool>| {
            let ends = bits.last() == Some(&sent);
            match (bits.len(), ends) {
                (1 | 2, true) => Some((32, bits)),
                (1 | 2, false) => Some((8, bits)),
                (3, true) | (0, _) => Some((1, bits)),
                _ => None,
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every byte, cut at every bit of it: whatever the slave took from that frame, what follows writes nothing.
    #[test]
    fn no_rest_of_a_byte_is_written() {
        let mut longest = 0;
        for byte in (0..=255u16).step_by(5) {
            let frame = byte << 4 | u16::from(crc4(byte.into(), 8));
            for have in 0..12u8 {
                let begun = Reader::Bits {
                    have,
                    bits: frame >> (12 - have),
                };
                let next = frame >> (11 - have) & 1 == 1;
                let mut quench = Quench::new(&[begun, Reader::Waits]);
                quench.slip(Some(next));
                let sent: Vec<bool> = quench.tail.iter().rev().copied().collect();
                longest = longest.max(sent.len());
                for place in &quench.places {
                    let mut reader = place.reader;
                    for bit in sent.iter().copied().chain([false; 40]) {
                        reader = reader
                            .takes(bit)
                            .unwrap_or_else(|| panic!("{byte:#x} cut after {have} bits: {sent:?}"));
                    }
                }
            }
        }
        assert!((1..=20).contains(&longest), "{longest}");
    }

    /// Zeros alone would complete a byte: this is what the tail is for.
    #[test]
    fn zeros_would_write_something() {
        let completes = |have| move |bits: &u16| Reader::Bits { have, bits: *bits }.completes();
        assert_eq!((0..1u16 << 4).filter(completes(4)).count(), 1);
        assert_eq!((0..1u16 << 8).filter(completes(8)).count(), 16);
    }

    /// Nothing is left open: a slave that was in a byte is out of it when the tail is sent.
    #[test]
    fn the_tail_lasts_until_no_byte_is_open() {
        for have in 0..12u8 {
            let begun = Reader::Bits { have, bits: 0 };
            let mut quench = Quench::new(&[begun]);
            while let Some(bit) = quench.bit() {
                quench.sent(bit);
            }
            assert_eq!(quench.longest(), 0, "{have}");
        }
    }
}
