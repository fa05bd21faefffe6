//! Who a slave is and what frame it sends, from the bytes of its registers.
//!
//! A [`Device`] is what 0x40 to 0x7F say: IDs, serial number, profile. An [`Eds`] and a [`ProfileEds`] are banks that
//! describe data channels. [`Known`] collects them for one slave ID and says what to read next; [`candidates()`] makes
//! frame formats of them, which live frames must confirm: many encoders carry partial or wrong data (KEB F6 manual,
//! p. 222).
//!
//! ```
//! use biss::identity::{Cell, Known, candidates};
//!
//! // A slave that has its IDs, and refuses everything else.
//! let registers = |address: u8| match address {
//!     0x42 => Cell::Byte(0x62),
//!     0x43 => Cell::Byte(0x1E),
//!     _ => Cell::Refused,
//! };
//! let mut known = Known::new(0);
//! while let Some(read) = known.wanted() {
//!     // Here a master selects `read.bank`, if any.
//!     let cells: Vec<Cell> = read.addresses().map(registers).collect();
//!     known.store(&read, &cells);
//! }
//! let found = candidates(&[known]);
//! assert_eq!(found[0].format.to_string(), "st28,nE,nW,crc6");
//! assert_eq!(found[0].reason, "BP_ID 0x621E: BP3, 30 bits, its CRC 0x43");
//! ```

mod candidates;
mod device;
mod eds;
mod map;
mod profile;

pub use candidates::{Candidate, MAX_CANDIDATES, candidates, readings, unexplained, wide_readings};
pub use device::{BankSelect, Device, DeviceId, EdsBank, Manufacturer, Profile, Serial};
pub use eds::{CHANNELS, Eds, EdsChannel, NO_UNIT, NOT_USED};
pub use map::{Cell, Cells, Direct, Field, Window};
pub use profile::{Encoder, ProfileEds};

use crate::limits as standard;
use crate::unit::{Hertz, Nanos};
use std::ops::RangeInclusive;

/// Registers to read next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Read {
    /// From this slave ID.
    pub slave: u8,
    /// With this bank selected; `None` for addresses that are the same in all banks.
    pub bank: Option<u8>,
    /// The first address.
    pub first: u8,
    /// The last address.
    pub last: u8,
    /// What is there.
    pub what: &'static str,
}

impl Read {
    /// The addresses in order.
    pub fn addresses(&self) -> RangeInclusive<u8> {
        self.first..=self.last
    }
}

/// What is known of one slave ID.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Known {
    /// 0x40 to 0x7F.
    pub device: Device,
    /// The EDS, once its bank was asked for.
    pub eds: Option<Eds>,
    /// Profile EDS by bank, once asked for.
    pub profiles: Vec<(u8, ProfileEds)>,
    direct: bool,
}

impl Known {
    /// A slave ID of which nothing was read.
    pub fn new(slave: u8) -> Known {
        Known {
            device: Device::decode(slave, &Direct::unread()),
            eds: None,
            profiles: Vec::new(),
            direct: false,
        }
    }

    /// What to read next; `None` when everything that says something about the slave was asked for. Where banks cannot
    /// be selected, or the EDS is not to be believed, there is nothing behind it to read.
    pub fn wanted(&self) -> Option<Read> {
        let slave = self.device.slave;
        if !self.direct {
            return Some(Read {
                slave,
                bank: None,
                first: 0x40,
                last: 0x7F,
                what: "IDs",
            });
        }
        if self.device.bank_select == BankSelect::OneBank {
            return None;
        }
        let bank = |bank, what| Read {
            slave,
            bank: Some(bank),
            first: 0x00,
            last: 0x3F,
            what,
        };
        let Some(eds) = &self.eds else {
            let number = self.device.eds_bank.number()?;
            return Some(bank(number, "EDS"));
        };
        if eds.distrust.is_some() {
            return None;
        }
        eds.channels
            .iter()
            .filter_map(|channel| channel.profile_bank)
            .find(|number| self.profile(*number).is_none())
            .map(|number| bank(number, "profile EDS"))
    }

    /// Keeps what `read` brought, from its first address on; what is missing counts as not read. Whatever it brought,
    /// the same is not wanted again: a master that must not select banks stores no cells and goes on.
    pub fn store(&mut self, read: &Read, cells: &[Cell]) {
        let pairs = || read.addresses().zip(cells.iter().copied());
        let Some(bank) = read.bank else {
            let mut direct = Direct::unread();
            pairs().for_each(|(address, cell)| direct.set(address, cell));
            self.device = Device::decode(self.device.slave, &direct);
            self.direct = true;
            return;
        };
        let mut window = Window::unread();
        pairs().for_each(|(address, cell)| window.set(address, cell));
        if self.eds.is_none() {
            self.eds = Some(Eds::decode(&window));
        } else if self.profile(bank).is_none() {
            self.profiles.push((bank, ProfileEds::decode(&window)));
        }
    }

    /// The profile EDS in that bank.
    pub fn profile(&self, bank: u8) -> Option<&ProfileEds> {
        let found = self.profiles.iter().find(|(number, _)| *number == bank);
        found.map(|(_, profile)| profile)
    }

    /// The EDS where it may be believed.
    pub fn trusted_eds(&self) -> Option<&Eds> {
        self.eds.as_ref().filter(|eds| eds.distrust.is_none())
    }

    /// What the standard guarantees for clock and times, and what the EDS adds, which are hints only.
    ///
    /// ```
    /// let limits = biss::identity::Known::new(0).limits();
    /// assert_eq!(limits[0].value, "250kHz..1MHz");
    /// assert_eq!(limits[1].value, "12.5us..40us");
    /// ```
    pub fn limits(&self) -> Vec<Limit> {
        let mut limits = guaranteed();
        if let Some(eds) = &self.eds {
            limits.extend(eds.fields.iter().filter_map(hint));
        }
        limits
    }
}

/// Slowest clock of the range that every slave takes (D2 Table 10).
pub const CLOCK_EVERY_MIN: Hertz = Hertz(250_000);
/// Fastest clock of the range that every slave takes, up to 100 m of cable (D2 Table 10).
pub const CLOCK_EVERY_MAX: Hertz = Hertz(1_000_000);

/// A limit ready to print.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Limit {
    /// What it limits.
    pub name: &'static str,
    /// With its unit, or the bare register where no unit is published.
    pub value: String,
    /// Who says so.
    pub source: &'static str,
    /// Why not to rely on it; `None` where there is no doubt.
    pub doubt: Option<&'static str>,
}

fn guaranteed() -> Vec<Limit> {
    let limit = |name, value, source| Limit {
        name,
        value,
        source,
        doubt: None,
    };
    let times = |from, to| format!("{}..{}", Nanos(from), Nanos(to));
    vec![
        limit(
            "clock",
            format!("{CLOCK_EVERY_MIN}..{CLOCK_EVERY_MAX}"),
            "D2 Table 10: what every slave takes, up to 100 m",
        ),
        limit(
            "timeout",
            times(standard::TIMEOUT_MIN_NS, standard::TIMEOUT_MAX_NS),
            "D2 Table 10: static timeout; an adaptive one is shorter",
        ),
        limit(
            "busy",
            format!("at most {}", Nanos(standard::BUSY_MAX_NS)),
            "D2 Table 10",
        ),
    ]
}

/// The fields of the EDS that say something about time.
fn hint(field: &Field) -> Option<Limit> {
    let named = [
        "TMA",
        "TO_MIN",
        "TO_MAX",
        "TOS_MIN",
        "TOS_MAX",
        "TCLK_MIN",
        "TCLK_MAX",
        "TCYC",
        "TBUSY_MAX",
        "BUSY_S",
        "PON_DLY",
    ];
    // 0 is no limit where nobody knows of what.
    let said = |value: &u64| *value > 0 || field.doubt.is_none();
    let value = field
        .value
        .filter(|value| said(value) && named.contains(&field.name))?;
    let value = match field.name {
        "BUSY_S" => format!("{value} clocks"),
        _ => value.to_string(),
    };
    Some(Limit {
        name: field.name,
        value,
        source: "EDS",
        doubt: field.doubt,
    })
}
