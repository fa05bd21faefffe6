//! How a write is ended that was disturbed.
//!
//! A slave that is in the middle of a byte reads on: whatever CDM comes next completes it, and 1 in 16 bytes made of
//! half a value and zeros has the right CRC. So the bits that follow are chosen so that no CRC can be right, wherever
//! the slave is: a frame that stalled, or was cut, may have given it no bit, one, or several.

use super::{REST_FRAMES, crc4};

/// Bits after which every slave has read its byte to the end: data, CRC, P and the slip.
const LONGEST: usize = 18;

/// Where in a write a slave is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reader {
    /// It waits for S.
    Waits,
    /// It has so many bits of a byte and its CRC.
    Bits { have: u8, bits: u16 },
    /// It expects P.
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
}

/// The bits to send next, and where the slave may be.
#[derive(Clone, Debug, Default)]
pub(super) struct Quench {
    readers: Vec<Reader>,
    /// To be sent, the next one last.
    tail: Vec<bool>,
}

impl Quench {
    /// For a slave that is in one of these places.
    pub(super) fn new(readers: &[Reader]) -> Quench {
        let mut quench = Quench::default();
        readers.iter().for_each(|reader| quench.may_be(*reader));
        quench.plan();
        quench
    }

    /// The next bit; none when only zeros are left.
    pub(super) fn bit(&self) -> Option<bool> {
        self.tail.last().copied()
    }

    /// Whether zeros do no harm any more.
    pub(super) fn is_over(&self) -> bool {
        self.tail.is_empty()
    }

    /// A whole frame has carried this bit.
    pub(super) fn sent(&mut self, bit: bool) {
        self.tail.pop();
        for reader in std::mem::take(&mut self.readers) {
            self.takes(reader, &[bit]);
        }
    }

    /// A frame was not whole, so the slave may have taken any bits, or none.
    pub(super) fn slip(&mut self) {
        // The likely ones come first: a bit as usual, one more from a pause, none, two more.
        const COUNTS: [u32; 4] = [1, 2, 0, 3];
        let readers = std::mem::take(&mut self.readers);
        for count in COUNTS {
            for reader in &readers {
                for bits in 0..1u32 << count {
                    let bits: Vec<bool> = (0..count).map(|at| bits >> at & 1 == 1).collect();
                    self.takes(*reader, &bits);
                }
            }
        }
        self.plan();
    }

    fn may_be(&mut self, reader: Reader) {
        if !self.readers.contains(&reader) {
            self.readers.push(reader);
        }
    }

    /// A slave that has taken the byte by now has it for good; nothing can be done about that one.
    fn takes(&mut self, reader: Reader, bits: &[bool]) {
        let after = bits
            .iter()
            .try_fold(reader, |reader, bit| reader.takes(*bit));
        self.may_be(after.unwrap_or(Reader::Ends));
    }

    /// After several frames that were not whole there may be no bits that are right everywhere: then for as many of the
    /// likely places as possible.
    fn plan(&mut self) {
        let mut likely = self.readers.len();
        self.tail = loop {
            match tail(&self.readers[..likely], LONGEST) {
                Some(tail) => break tail,
                None => likely -= likely.div_ceil(8),
            }
        };
    }
}

/// The shortest bits, last one first, after which zeros complete no byte for any reader, in none of them on the way.
fn tail(readers: &[Reader], depth: usize) -> Option<Vec<bool>> {
    (0..=depth).find_map(|length| tail_of(readers, length))
}

fn tail_of(readers: &[Reader], length: usize) -> Option<Vec<bool>> {
    if length == 0 {
        let zeros = usize::from(REST_FRAMES) + LONGEST;
        let safe = readers.iter().all(|reader| {
            (0..zeros)
                .try_fold(*reader, |reader, _| reader.takes(false))
                .is_some()
        });
        return safe.then(Vec::new);
    }
    [false, true].into_iter().find_map(|bit| {
        let after: Option<Vec<Reader>> = readers.iter().map(|reader| reader.takes(bit)).collect();
        let mut after = after?;
        after.sort_unstable_by_key(|reader| match reader {
            Reader::Waits => (0, 0),
            Reader::Ends => (1, 0),
            Reader::Bits { have, bits } => (2 + have, *bits),
        });
        after.dedup();
        let mut tail = tail_of(&after, length - 1)?;
        tail.push(bit);
        Some(tail)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every byte, cut at every bit of it: whatever the slave took from that frame, what follows writes nothing.
    #[test]
    fn no_rest_of_a_byte_is_written() {
        let mut longest = 0;
        for byte in 0..=255u16 {
            let bits = byte << 4 | u16::from(crc4(byte.into(), 8));
            for have in 0..12u8 {
                let begun = Reader::Bits {
                    have,
                    bits: bits >> (12 - have),
                };
                let mut quench = Quench::new(&[begun, Reader::Waits]);
                quench.slip();
                let sent: Vec<bool> = quench.tail.iter().rev().copied().collect();
                longest = longest.max(sent.len());
                for reader in &quench.readers {
                    let mut reader = *reader;
                    for bit in sent.iter().copied().chain([false; 40]) {
                        reader = reader
                            .takes(bit)
                            .unwrap_or_else(|| panic!("{byte:#x} cut after {have} bits: {sent:?}"));
                    }
                }
            }
        }
        assert!((1..=16).contains(&longest), "{longest}");
    }

    /// Zeros alone would complete a byte: this is what the tail is for.
    #[test]
    fn zeros_would_write_something() {
        let zeros = |have| {
            move |bits: &u16| {
                let begun = Reader::Bits { have, bits: *bits };
                let rest = (have..12).try_fold(begun, |reader, _| reader.takes(false));
                rest.is_none()
            }
        };
        assert_eq!((0..1u16 << 4).filter(zeros(4)).count(), 1);
        assert_eq!((0..1u16 << 8).filter(zeros(8)).count(), 16);
    }

    /// A slave can be disturbed again while it is led out, by any bit each time.
    #[test]
    fn a_second_slip_is_led_out_too() {
        for case in (0..1u32 << 14).step_by(67) {
            let bit = |at: u32| case >> at & 1 == 1;
            let have = 1 + (case >> 12) as u8 * 3;
            let bits = case as u16 & ((1 << have) - 1);
            let begun = Reader::Bits { have, bits };
            let mut quench = Quench::new(&[begun]);
            let mut reader = Some(begun);
            for slip in [12, 13] {
                quench.slip();
                reader = reader.and_then(|reader| reader.takes(bit(slip)));
                let next = quench.bit().unwrap_or(false);
                reader = reader.and_then(|reader| reader.takes(next));
                quench.sent(next);
            }
            let sent = quench.tail.iter().rev().copied().chain([false; 40]);
            let end = reader.and_then(|reader| sent.into_iter().try_fold(reader, Reader::takes));
            assert!(end.is_some(), "{begun:?}, case {case}");
        }
    }
}
