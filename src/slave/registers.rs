//! The registers of a slave: a window of 64 bytes onto its banks, and 64 bytes of its own behind it (D2, p. 20-22).

use std::ops::RangeInclusive;

/// Selects the bank in the window.
pub(super) const BSEL: u8 = 0x40;
/// First address that is the same whatever the bank.
pub(super) const DIRECT: u8 = 0x40;
/// Last address.
pub(super) const LAST: u8 = 0x7F;

/// Sixty-four bytes, some of which may be read, some of these written.
#[derive(Clone, Debug)]
pub(super) struct Bank {
    bytes: [u8; 64],
    /// A bit an address.
    readable: u64,
    writable: u64,
}

impl Bank {
    /// Nothing there.
    pub(super) fn absent() -> Bank {
        Bank {
            bytes: [0; 64],
            readable: 0,
            writable: 0,
        }
    }

    /// Puts `bytes` at `from`, to be read only.
    pub(super) fn put(&mut self, from: u8, bytes: &[u8]) -> &mut Bank {
        for (at, byte) in (usize::from(from % DIRECT)..64).zip(bytes) {
            self.bytes[at] = *byte;
            self.readable |= 1 << at;
        }
        self
    }

    /// Lets addresses be written as well.
    pub(super) fn open(&mut self, addresses: RangeInclusive<u8>) -> &mut Bank {
        self.writable |= self.readable & mask(&addresses);
        self
    }
}

/// A bit for each address, which may be one behind the window.
fn mask(addresses: &RangeInclusive<u8>) -> u64 {
    addresses
        .clone()
        .fold(0, |mask, address| mask | 1 << (address % DIRECT))
}

/// All registers of a slave. Banks that are not there take no room.
#[derive(Clone, Debug)]
pub(super) struct Registers {
    banks: Vec<(u8, Bank)>,
    direct: Bank,
}

impl Registers {
    pub(super) fn new(banks: Vec<(u8, Bank)>, direct: Bank) -> Registers {
        Registers { banks, direct }
    }

    /// Takes addresses away, whatever the bank.
    pub(super) fn refuse(&mut self, addresses: &RangeInclusive<u8>) {
        self.restrict(addresses, |bank, kept| {
            bank.readable &= kept;
            bank.writable &= kept;
        });
    }

    /// Addresses that cannot be written, whatever the bank.
    pub(super) fn protect(&mut self, addresses: &RangeInclusive<u8>) {
        self.restrict(addresses, |bank, kept| bank.writable &= kept);
    }

    fn restrict(&mut self, addresses: &RangeInclusive<u8>, restrict: impl Fn(&mut Bank, u64)) {
        let (from, to) = (*addresses.start(), *addresses.end());
        if from < DIRECT {
            let kept = !mask(&(from..=to.min(DIRECT - 1)));
            for (_, bank) in &mut self.banks {
                restrict(bank, kept);
            }
        }
        if to >= DIRECT {
            restrict(&mut self.direct, !mask(&(from.max(DIRECT)..=to)));
        }
    }

    /// The bank in the window.
    pub(super) fn selected(&self) -> u8 {
        self.direct.bytes[usize::from(BSEL % DIRECT)]
    }

    fn bank(&self, bank: u8, address: u8) -> Option<&Bank> {
        match address {
            DIRECT..=LAST => Some(&self.direct),
            0..DIRECT => self
                .banks
                .iter()
                .find(|(number, _)| *number == bank)
                .map(|(_, bank)| bank),
            _ => None,
        }
    }

    /// A byte, unless it is not there.
    pub(super) fn peek(&self, bank: u8, address: u8) -> Option<u8> {
        let at = address % DIRECT;
        self.bank(bank, address)
            .filter(|bank| bank.readable >> at & 1 == 1)
            .map(|bank| bank.bytes[usize::from(at)])
    }

    /// Changes a byte that is there, whoever else may.
    pub(super) fn poke(&mut self, bank: u8, address: u8, value: u8) -> bool {
        if self.peek(bank, address).is_none() {
            return false;
        }
        let at = usize::from(address % DIRECT);
        if address >= DIRECT {
            self.direct.bytes[at] = value;
        } else if let Some((_, bank)) = self.banks.iter_mut().find(|(number, _)| *number == bank) {
            bank.bytes[at] = value;
        }
        true
    }

    /// Whether the master may read, or write, at an address of the window as it stands.
    pub(super) fn allows(&self, address: u8, write: bool) -> bool {
        self.bank(self.selected(), address).is_some_and(|bank| {
            let allowed = if write { bank.writable } else { bank.readable };
            allowed >> (address % DIRECT) & 1 == 1
        })
    }
}
