//! What a slave says about itself at 0x40 to 0x7F (D2, p. 20-22).

use super::map::{Cell, Direct, Field, Said, field, unnamed};

/// One slave ID, as its registers describe it.
///
/// ```
/// use biss::identity::{Device, Direct, Profile};
///
/// // Read from a real iC-MHM (BiSS application note AN22).
/// let mut direct = Direct::of(0x40, &[0x00, 0x02, 0x62, 0x1E, 0xFF, 0xFF, 0xFF, 0xFF]);
/// for (address, byte) in (0x78..).zip(*b"MHM#D\0iC") {
///     direct.set(address, biss::identity::Cell::Byte(byte));
/// }
/// let device = Device::decode(0, &direct);
/// assert_eq!(device.manufacturer.name(), Some("iC-Haus"));
/// assert_eq!(device.id.text().as_deref(), Some("MHM#D"));
/// assert_eq!(device.eds_bank.number(), Some(2));
/// let encoder = Profile::Encoder { version: 1, crc_flag: false, data_bits: 30 };
/// assert_eq!(device.profile, encoder);
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Device {
    /// Its ID on the bus; 0 is the slave farthest from the master (D2, p. 11-14).
    pub slave: u8,
    /// Whether banks can be selected.
    pub bank_select: BankSelect,
    /// Where its EDS is.
    pub eds_bank: EdsBank,
    /// BP_ID.
    pub profile: Profile,
    /// DEV_SN.
    pub serial: Serial,
    /// DEV_ID.
    pub id: DeviceId,
    /// MFR_ID.
    pub manufacturer: Manufacturer,
    /// Every group of registers, in address order.
    pub fields: Vec<Field>,
}

/// BSEL, 0x40.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BankSelect {
    /// Banks can be selected; this one is.
    At(u8),
    /// Refused: there is one bank only (D2, p. 20-22).
    OneBank,
    /// Not read.
    Unread,
}

/// EDS_BANK, 0x41.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EdsBank {
    /// The bank the EDS begins in.
    At(u8),
    /// There is none, and why.
    Absent(&'static str),
    /// Not read.
    Unread,
}

impl EdsBank {
    /// The bank, where there is one.
    pub fn number(self) -> Option<u8> {
        match self {
            EdsBank::At(bank) => Some(bank),
            EdsBank::Absent(_) | EdsBank::Unread => None,
        }
    }
}

/// BP_ID, 0x42 and 0x43: what kind of data the slave sends. Bits 15 to 13 are the number of the profile
/// (profilebiss.xml of the BiSS Association).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Profile {
    /// 0x0000: none (D2, p. 20-22), or the registers are not there.
    None,
    /// BP0, universal (profilebiss.xml).
    Universal {
        /// 0 to 31; 0 is a slave without data.
        data_bits: u8,
        /// An actuator, else a sensor.
        actuator: bool,
        /// What the data is about, 7 bits.
        application: u8,
    },
    /// BP1, standard encoder in one of several data formats. Known from two data sheets only, Lika SMA1 (0x2814) and
    /// iC-MH16 (0x2C..).
    EncoderVariant {
        /// Which data format, 5 bits.
        variant: u8,
        /// Bits of the position that count.
        significant_bits: u8,
    },
    /// BP3, standard encoder: position, nE, nW, CRC 0x43 (NXP's driver; BiSS Safety Concept A5).
    Encoder {
        /// Of the profile, 3 bits.
        version: u8,
        /// Bit 8 of BP_ID; what it says is not published.
        crc_flag: bool,
        /// Data bits including nE and nW, 0 to 127; a channel has at most 64.
        data_bits: u8,
    },
    /// BP3S, safety encoder: sign of life and CRC 0x190D9 as well (same sources).
    Safety {
        /// Of the profile, 3 bits.
        version: u8,
        /// Bit 8 of BP_ID; what it says is not published.
        crc_flag: bool,
        /// Data bits including nE and nW, 0 to 127; a channel has at most 64.
        data_bits: u8,
    },
    /// A number that no published profile has.
    Other(u16),
}

impl Profile {
    /// From the 16 bits of BP_ID, 0x42 being the high byte.
    ///
    /// ```
    /// use biss::identity::Profile;
    ///
    /// let (version, crc_flag) = (1, false);
    /// assert_eq!(Profile::of(0x621E), Profile::Encoder { version, crc_flag, data_bits: 30 });
    /// assert_eq!(Profile::of(0x2814), Profile::EncoderVariant { variant: 8, significant_bits: 20 });
    /// assert_eq!(Profile::of(0xFFFF), Profile::Other(0xFFFF));
    /// ```
    pub fn of(number: u16) -> Profile {
        let [high, low] = number.to_be_bytes();
        let version = high >> 1 & 0x07;
        let crc_flag = high & 1 == 1;
        let data_bits = low & 0x7F;
        match (high >> 5, high >> 4 & 1) {
            _ if number == 0 => Profile::None,
            (0, _) => Profile::Universal {
                data_bits: high & 0x1F,
                actuator: low & 0x80 != 0,
                application: low & 0x7F,
            },
            (1, _) => Profile::EncoderVariant {
                variant: high & 0x1F,
                significant_bits: low,
            },
            (3, 0) => Profile::Encoder {
                version,
                crc_flag,
                data_bits,
            },
            (3, _) => Profile::Safety {
                version,
                crc_flag,
                data_bits,
            },
            _ => Profile::Other(number),
        }
    }

    /// Its short name, `BP3S`; `None` where there is no profile or no published one.
    pub fn name(self) -> Option<&'static str> {
        match self {
            Profile::Universal { .. } => Some("BP0"),
            Profile::EncoderVariant { .. } => Some("BP1"),
            Profile::Encoder { .. } => Some("BP3"),
            Profile::Safety { .. } => Some("BP3S"),
            Profile::None | Profile::Other(_) => None,
        }
    }

    /// The polynomial that goes with it, leading term included.
    pub fn poly(self) -> Option<u32> {
        match self {
            Profile::Universal { .. } => Some(0x25),
            Profile::EncoderVariant { .. } | Profile::Encoder { .. } => Some(0x43),
            Profile::Safety { .. } => Some(0x190D9),
            Profile::None | Profile::Other(_) => None,
        }
    }

    /// An encoder's: the data ends in nE and nW.
    pub fn is_encoder(self) -> bool {
        matches!(
            self,
            Profile::EncoderVariant { .. } | Profile::Encoder { .. } | Profile::Safety { .. }
        )
    }

    /// Data bits where BP_ID says them: BP0, BP3, BP3S, and the two variants of BP1 that are known.
    pub fn data_bits(self) -> Option<u8> {
        match self {
            Profile::Universal { data_bits, .. }
            | Profile::Encoder { data_bits, .. }
            | Profile::Safety { data_bits, .. } => Some(data_bits),
            Profile::EncoderVariant { variant, .. } => variant_bits(variant).map(|bits| bits + 2),
            Profile::None | Profile::Other(_) => None,
        }
    }

    fn say(self) -> Said {
        match self {
            Profile::None => ("no profile".into(), None),
            Profile::Universal {
                data_bits,
                actuator,
                application,
            } => {
                let kind = if actuator { "actuator" } else { "sensor" };
                let what = format!(
                    "BP0 universal, {kind}, {}, application {application:#04X}",
                    bits(data_bits)
                );
                (what, None)
            }
            Profile::EncoderVariant {
                variant,
                significant_bits,
            } => {
                let length = match variant_bits(variant) {
                    Some(length) => format!(" ({length} bits of position)"),
                    None => String::new(),
                };
                let what = format!(
                    "BP1 standard encoder, variant {variant}{length}, {significant_bits} significant bits"
                );
                (what, Some("BP1 is known from two data sheets only"))
            }
            Profile::Encoder {
                version, data_bits, ..
            } => (
                format!(
                    "BP3 standard encoder, version {version}, {} with nE and nW",
                    bits(data_bits)
                ),
                too_long(data_bits),
            ),
            Profile::Safety {
                version, data_bits, ..
            } => (
                format!(
                    "BP3S safety encoder, version {version}, {} with nE and nW",
                    bits(data_bits)
                ),
                too_long(data_bits),
            ),
            Profile::Other(_) => ("not a published profile".into(), Some("not published")),
        }
    }
}

fn bits(count: u8) -> String {
    let plural = if count == 1 { "" } else { "s" };
    format!("{count} bit{plural}")
}

fn too_long(data_bits: u8) -> Option<&'static str> {
    match data_bits {
        0..=2 => Some("no room for a position beside nE and nW"),
        3..=64 => None,
        _ => Some("a channel has at most 64 data bits"),
    }
}

/// Bits of position in the formats of BP1 that a data sheet shows: Lika SMA1 calls 8 the variant "0-24", iC-MH16 sends
/// 12 bits with variant 12.
pub(super) fn variant_bits(variant: u8) -> Option<u8> {
    match variant {
        8 => Some(24),
        12 => Some(12),
        _ => None,
    }
}

/// DEV_SN, 0x44 to 0x47.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Serial {
    /// The registers, low address first.
    pub raw: [Cell; 4],
}

impl Serial {
    /// Big endian, as the standard has it (D2, p. 20). `None` for 0 and 0xFFFFFFFF, which are no numbers (D2, p. 20-22).
    pub fn number(&self) -> Option<u32> {
        self.bytes().map(u32::from_be_bytes).and_then(real_serial)
    }

    /// The same with the low byte first, as some manufacturers print it (Lika AMM36, p. 38; iC-MU, p. 19).
    pub fn low_first(&self) -> Option<u32> {
        self.bytes().map(u32::from_le_bytes).and_then(real_serial)
    }

    fn bytes(&self) -> Option<[u8; 4]> {
        let [a, b, c, d] = self.raw.map(Cell::byte);
        Some([a?, b?, c?, d?])
    }
}

fn real_serial(number: u32) -> Option<u32> {
    (number != 0 && number != u32::MAX).then_some(number)
}

/// DEV_ID, 0x78 to 0x7D.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceId {
    /// The registers, low address first.
    pub raw: [Cell; 6],
}

impl DeviceId {
    /// Big endian: 0x78 has bits 47 to 40 (D2, p. 20-22).
    pub fn number(&self) -> Option<u64> {
        self.raw
            .iter()
            .try_fold(0, |id, cell| Some(id << 8 | u64::from(cell.byte()?)))
    }

    /// As ASCII, where all of it is printable up to zeros at the end.
    pub fn text(&self) -> Option<String> {
        text(&self.raw)
    }
}

/// MFR_ID, 0x7E and 0x7F.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Manufacturer {
    /// The registers, low address first.
    pub raw: [Cell; 2],
}

impl Manufacturer {
    /// Big endian: 0x7E is the high byte (D2, p. 20-22).
    pub fn number(&self) -> Option<u16> {
        let [high, low] = self.raw.map(Cell::byte);
        Some(u16::from_be_bytes([high?, low?]))
    }

    /// As ASCII, where it is printable.
    pub fn text(&self) -> Option<String> {
        text(&self.raw)
    }

    /// Who it is, where the number is known: iC-Haus from a capture of an iC-MHM (AN22), Lika from its manuals
    /// (idbiss4C69.xml).
    pub fn name(&self) -> Option<&'static str> {
        match self.number()? {
            0x6943 => Some("iC-Haus"),
            0x4C69 => Some("Lika"),
            _ => None,
        }
    }
}

fn text(raw: &[Cell]) -> Option<String> {
    let bytes: Vec<u8> = raw.iter().map(|cell| cell.byte()).collect::<Option<_>>()?;
    let end = bytes.iter().rposition(|byte| *byte != 0)? + 1;
    let shown = &bytes[..end];
    let printable = shown.iter().all(|b| b.is_ascii_graphic() || *b == b' ');
    printable.then(|| shown.iter().copied().map(char::from).collect())
}

impl Device {
    /// What the registers of slave ID `slave` say. Never panics.
    pub fn decode(slave: u8, direct: &Direct) -> Device {
        let cells = |address| direct.get(address);
        let bank_select = match cells(0x40) {
            Cell::Byte(bank) => BankSelect::At(bank),
            Cell::Refused => BankSelect::OneBank,
            Cell::Unread => BankSelect::Unread,
        };
        let eds_bank = match cells(0x41) {
            Cell::Byte(0x00) => EdsBank::Absent("EDS_BANK is 0: no EDS"),
            Cell::Byte(0xFF) => EdsBank::Absent("EDS_BANK is 0xFF: no EDS"),
            Cell::Byte(bank) => EdsBank::At(bank),
            Cell::Refused => EdsBank::Absent("EDS_BANK is refused: no EDS"),
            Cell::Unread => EdsBank::Unread,
        };
        let profile = match (cells(0x42).byte(), cells(0x43).byte()) {
            (Some(high), Some(low)) => Profile::of(u16::from_be_bytes([high, low])),
            _ => Profile::None,
        };
        let mut device = Device {
            slave,
            bank_select,
            eds_bank,
            profile,
            serial: Serial {
                raw: [0x44, 0x45, 0x46, 0x47].map(cells),
            },
            id: DeviceId {
                raw: [0x78, 0x79, 0x7A, 0x7B, 0x7C, 0x7D].map(cells),
            },
            manufacturer: Manufacturer {
                raw: [0x7E, 0x7F].map(cells),
            },
            fields: Vec::new(),
        };
        device.fields = device.listed(direct);
        device
    }

    fn listed(&self, direct: &Direct) -> Vec<Field> {
        let mut bank = field(direct, 0x40, 1, "BSEL", |bank| {
            (format!("bank {bank} is selected"), None)
        });
        if self.bank_select == BankSelect::OneBank {
            bank.meaning = "refused: one bank only".into();
        }
        let mut eds = field(direct, 0x41, 1, "EDS_BANK", |bank| {
            (format!("EDS in bank {bank}"), None)
        });
        if let EdsBank::Absent(why) = self.eds_bank {
            eds.meaning = why.into();
        } else if self.eds_bank.number().is_some() && self.bank_select == BankSelect::OneBank {
            eds.doubt = Some("there are no banks to select it from");
        }
        let profile = field(direct, 0x42, 2, "BP_ID", |number| {
            let (meaning, doubt) = self.profile.say();
            let length = matches!(
                self.profile,
                Profile::Encoder { .. } | Profile::Safety { .. }
            );
            let odd = length && number & 0x80 != 0;
            (
                meaning,
                doubt.or(odd.then_some("bit 7 has no published meaning")),
            )
        });
        let serial = field(direct, 0x44, 4, "DEV_SN", |_| {
            match (self.serial.number(), self.serial.low_first()) {
                (Some(number), Some(swapped)) => (
                    format!("{number} ({number:#X}); low byte first it is {swapped}"),
                    None,
                ),
                _ => ("no serial number".into(), None),
            }
        });
        let free = unnamed(direct, 0x48, 0x30, "", "the manufacturer's own");
        let id = field(direct, 0x78, 6, "DEV_ID", |id| match self.id.text() {
            Some(text) => (format!("\"{text}\""), None),
            None => (format!("{id:#014X}"), None),
        });
        let maker = field(direct, 0x7E, 2, "MFR_ID", |number| {
            let text = self.manufacturer.text().map(|text| format!("\"{text}\""));
            let words = match (self.manufacturer.name(), text) {
                (Some(name), Some(text)) => format!("{name} ({text})"),
                (Some(name), None) => name.to_owned(),
                (None, Some(text)) => text,
                (None, None) => format!("{number:#06X}"),
            };
            (words, None)
        });
        vec![bank, eds, profile, serial, free, id, maker]
    }

    /// The field at `offset`.
    pub fn field(&self, offset: u8) -> Option<&Field> {
        self.fields.iter().find(|field| field.offset == offset)
    }

    /// Whether nothing at all answered.
    pub fn is_silent(&self) -> bool {
        self.fields
            .iter()
            .all(|field| field.raw.iter().all(|cell| cell.byte().is_none()))
    }
}
