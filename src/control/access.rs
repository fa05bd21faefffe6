//! What is wanted of the slaves.

use super::{ADDRESSES, MAX_IDS};
use std::fmt;

/// Up to 128 bytes, without a heap.
#[derive(Clone, Copy)]
pub struct Bytes {
    bytes: [u8; ADDRESSES as usize],
    len: u8,
}

impl Bytes {
    /// The bytes.
    pub fn as_slice(&self) -> &[u8] {
        &self.bytes[..usize::from(self.len)]
    }

    pub(super) const fn new() -> Bytes {
        Bytes {
            bytes: [0; ADDRESSES as usize],
            len: 0,
        }
    }

    pub(super) fn push(&mut self, byte: u8) {
        if let Some(place) = self.bytes.get_mut(usize::from(self.len)) {
            *place = byte;
            self.len += 1;
        }
    }
}

impl From<&[u8]> for Bytes {
    /// What is beyond 128 bytes is left out.
    fn from(bytes: &[u8]) -> Bytes {
        let mut all = Bytes::new();
        bytes.iter().for_each(|byte| all.push(*byte));
        all
    }
}

impl fmt::Debug for Bytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.as_slice().fmt(f)
    }
}

impl PartialEq for Bytes {
    fn eq(&self, other: &Bytes) -> bool {
        self.as_slice() == other.as_slice()
    }
}

impl Eq for Bytes {}

/// What is wanted of the slaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Registers one after the other.
    Read {
        /// Its ID, 0 to 7: 0 is the slave farthest away.
        slave: u8,
        /// The first register, 0x00 to 0x7F.
        address: u8,
        /// How many.
        count: u8,
    },
    /// Registers one after the other.
    Write {
        /// Its ID, 0 to 7.
        slave: u8,
        /// The first register.
        address: u8,
        /// What goes there.
        data: Bytes,
    },
    /// A command.
    Command {
        /// Bit k stands for slave ID k; 0 is a broadcast.
        slaves: u8,
        /// 0 to 3; what they mean depends on who is addressed (D2, p. 17-19).
        code: u8,
        /// Execute only when exactly these slaves have acknowledged.
        checked: bool,
        /// In reduced frames: two clocks and the timeout, no CDS. For broadcasts.
        reduced: bool,
    },
}

impl Access {
    /// Whether the wire can carry it.
    ///
    /// # Errors
    /// What is wrong with it, in words.
    pub fn check(&self, late: bool) -> Result<(), String> {
        let register = |slave: u8, address: u8, count: usize| {
            if slave >= MAX_IDS {
                return Err(format!("slave IDs are 0 to 7, not {slave}"));
            }
            if count == 0 {
                return Err("no register at all".into());
            }
            let end = usize::from(address) + count;
            if end > usize::from(ADDRESSES) {
                return Err(format!("registers end at 0x7f, not at {:#04x}", end - 1));
            }
            Ok(())
        };
        match self {
            Access::Read {
                slave,
                address,
                count,
            } => register(*slave, *address, usize::from(*count)),
            Access::Write {
                slave,
                address,
                data,
            } => register(*slave, *address, data.as_slice().len()),
            Access::Command { code: 4.., .. } => Err("commands are 0 to 3".into()),
            Access::Command {
                slaves,
                reduced: true,
                ..
            } if *slaves != 0 => {
                Err("reduced frames have no CDS for the slaves' acknowledge, they are for broadcasts".into())
            }
            Access::Command {
                slaves,
                checked: true,
                ..
            } if late && slaves & 0x80 != 0 => Err(
                "slave 7 acknowledges in the frame that executes, where CDM is laid out before CDS is seen".into(),
            ),
            Access::Command { .. } => Ok(()),
        }
    }
}
