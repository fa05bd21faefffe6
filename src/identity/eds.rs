//! The electronic data sheet (EDS): one bank that describes a whole device, all its slave IDs and data channels.
//!
//! The official tables were not at hand. The layout is the one that NXP's driver uses (mcuxsdk-core, drivers/biss); where
//! it gives no unit, none is invented.

use super::map::{Cell, Field, Said, Window, field, unnamed};

/// Room for channels in the EDS (NXP).
pub const CHANNELS: usize = 8;

/// Said where a number has no published unit.
pub const NO_UNIT: &str = "unit not published";

/// Said of the fields of channels that the device does not have.
pub const NOT_USED: &str = "not used";

/// A decoded EDS.
///
/// ```
/// use biss::identity::{Cell, Eds, Window};
///
/// let mut window = Window::of(0x00, &[0; 64]);
/// window.set(0x01, Cell::Byte(64)); // EDS_LEN
/// window.set(0x10, Cell::Byte(1)); // DC_NUM
/// window.set(0x11, Cell::Byte(1)); // SL_NUM
/// window.set(0x15, Cell::Byte(30)); // DLEN1
/// window.set(0x17, Cell::Byte(0x43)); // CPOLY1
/// let eds = Eds::decode(&window);
/// assert_eq!(eds.distrust, None);
/// assert_eq!(eds.channels[0].data_bits, 30);
/// let line = eds.fields.iter().find(|field| field.name == "DLEN1");
/// assert_eq!(line.map(|field| field.meaning.as_str()), Some("30 bits"));
///
/// // An EEPROM that was never written is no data sheet.
/// assert!(Eds::decode(&Window::of(0x00, &[0xFF; 64])).distrust.is_some());
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Eds {
    /// EDS_VER.
    pub version: Option<u8>,
    /// EDS_LEN.
    pub length: Option<u8>,
    /// USR_STA and USR_END: first and last bank for the user.
    pub user_banks: Option<(u8, u8)>,
    /// DC_NUM: data channels of the device.
    pub channel_count: Option<u8>,
    /// SL_NUM: slave IDs of the device.
    pub slave_count: Option<u8>,
    /// SL_OFF: index within the device of the slave ID through which this was read; the first has ID - SL_OFF.
    pub slave_offset: Option<u8>,
    /// BC_OFF: index within the device of the bus coupler, which has no data channel.
    pub bus_coupler: Option<u8>,
    /// The data channels, as many as DC_NUM says and the EDS has room for; empty ones included.
    pub channels: Vec<EdsChannel>,
    /// Why the channels are not to be believed; `None` where they are consistent.
    pub distrust: Option<&'static str>,
    /// Every group of registers, in address order.
    pub fields: Vec<Field>,
}

/// A data channel as the EDS has it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EdsChannel {
    /// Which of the 8 slots describes it, from 0.
    pub slot: u8,
    /// Its slave ID within the device, from 0.
    pub slave: u8,
    /// BANK: the bank of its profile EDS.
    pub profile_bank: Option<u8>,
    /// DLEN: data bits, nE and nW included; 0 is a channel without data.
    pub data_bits: u8,
    /// FORMAT bit 0: an actuator, else a sensor.
    pub actuator: bool,
    /// FORMAT bit 1: the value is left-aligned in its bits.
    pub left_aligned: bool,
    /// FORMAT bit 3: a stop bit leads the data.
    pub leading_stop: bool,
    /// CPOLY: 8 bits of the polynomial; whether the constant term is among them, the device must show
    /// ([`readings`](super::readings)).
    pub cpoly: u8,
}

/// Names of the four registers of each slot, as NXP counts them.
const SLOTS: [[&str; 4]; CHANNELS] = [
    ["BANK1", "DLEN1", "FORMAT1", "CPOLY1"],
    ["BANK2", "DLEN2", "FORMAT2", "CPOLY2"],
    ["BANK3", "DLEN3", "FORMAT3", "CPOLY3"],
    ["BANK4", "DLEN4", "FORMAT4", "CPOLY4"],
    ["BANK5", "DLEN5", "FORMAT5", "CPOLY5"],
    ["BANK6", "DLEN6", "FORMAT6", "CPOLY6"],
    ["BANK7", "DLEN7", "FORMAT7", "CPOLY7"],
    ["BANK8", "DLEN8", "FORMAT8", "CPOLY8"],
];

impl Eds {
    /// What a bank says when it is read as an EDS. Never panics.
    pub fn decode(window: &Window) -> Eds {
        let byte = |address| window.get(address).byte();
        let mut eds = Eds {
            version: byte(0x00),
            length: byte(0x01),
            user_banks: byte(0x02).zip(byte(0x03)),
            channel_count: byte(0x10),
            slave_count: byte(0x11),
            slave_offset: byte(0x12),
            bus_coupler: byte(0x34).filter(|b| b & 0x10 != 0).map(|b| b & 0x0F),
            channels: Vec::new(),
            distrust: None,
            fields: Vec::new(),
        };
        let slots = eds.slots(window);
        eds.channels = slots
            .iter()
            .filter_map(|slot| eds.channel(window, *slot))
            .collect();
        eds.distrust = eds.judge(window, slots.len());
        eds.fields = eds.listed(window, &slots);
        eds
    }

    /// The slots that describe channels. Slot k belongs to the k-th slave ID of the device (NXP), so the bus coupler's
    /// is left out where the IDs are more than the channels.
    fn slots(&self, window: &Window) -> Vec<u8> {
        let wanted = usize::from(self.channel_count.unwrap_or(0)).min(CHANNELS);
        let more_ids = self.slave_count > self.channel_count;
        let empty = |slot: u8| window.get(0x15 + 4 * slot) == Cell::Byte(0);
        let coupler = |slot: u8| self.bus_coupler == Some(slot) && (more_ids || empty(slot));
        (0..CHANNELS as u8)
            .filter(|slot| !coupler(*slot))
            .take(wanted)
            .collect()
    }

    fn channel(&self, window: &Window, slot: u8) -> Option<EdsChannel> {
        let at = |register: u8| window.get(0x14 + 4 * slot + register).byte();
        let format = at(2)?;
        let last = self.slave_count.unwrap_or(1).saturating_sub(1);
        Some(EdsChannel {
            slot,
            slave: slot.min(last),
            profile_bank: at(0).filter(|bank| !matches!(bank, 0x00 | 0xFF)),
            data_bits: at(1)?,
            actuator: format & 0x01 != 0,
            left_aligned: format & 0x02 != 0,
            leading_stop: format & 0x08 != 0,
            cpoly: at(3)?,
        })
    }

    /// Why not to build a frame format from it.
    fn judge(&self, window: &Window, slots: usize) -> Option<&'static str> {
        match window.uniform() {
            Some(0x00) => return Some("all registers are 0"),
            Some(0xFF) => return Some("all registers are 0xFF: never written"),
            _ if !window.any_byte() => return Some("no register could be read"),
            _ => {}
        }
        if matches!(self.length, Some(0x00 | 0xFF)) {
            return Some("EDS_LEN is no length");
        }
        if self.version == Some(0xFF) {
            return Some("EDS_VER is 0xFF: never written");
        }
        match self.channel_count {
            None => return Some("DC_NUM could not be read"),
            // A bus coupler on its own has none.
            Some(0) if self.bus_coupler.is_some() => return None,
            Some(0) => return Some("DC_NUM is 0: no data channels"),
            Some(count) if usize::from(count) > CHANNELS => {
                return Some("DC_NUM is more than 8");
            }
            Some(_) => {}
        }
        if self.channels.len() < slots {
            return Some("a channel's registers could not be read");
        }
        if self.channels.len() < usize::from(self.channel_count.unwrap_or(0)) {
            return Some("DC_NUM is more than there is room for beside the bus coupler");
        }
        if self.channels.iter().any(|channel| channel.data_bits > 64) {
            return Some("a channel has more than 64 data bits");
        }
        if self.channels.iter().all(|channel| channel.data_bits == 0) {
            return Some("no channel has data bits");
        }
        None
    }

    fn listed(&self, window: &Window, slots: &[u8]) -> Vec<Field> {
        let one = |offset, name, say: fn(u64) -> Said| field(window, offset, 1, name, say);
        let mut fields = vec![
            one(0x00, "EDS_VER", version),
            one(0x01, "EDS_LEN", length),
            one(0x02, "USR_STA", |bank| {
                (format!("first user bank {bank}"), None)
            }),
            field(window, 0x03, 1, "USR_END", |last| {
                let backwards = self.user_banks.is_some_and(|(first, last)| first > last);
                let doubt = backwards.then_some("before the first user bank");
                (format!("last user bank {last}"), doubt)
            }),
            one(0x04, "TMA", clock_period),
            one(0x05, "TO_MIN", |n| plain("shortest timeout", n)),
            one(0x06, "TO_MAX", |n| plain("longest timeout", n)),
            one(0x07, "TOS_MIN", |n| plain("shortest reduced timeout", n)),
            one(0x08, "TOS_MAX", |n| plain("longest reduced timeout", n)),
            one(0x09, "TCLK_MIN", |n| {
                plain("shortest sample clock of the adaptive timeout", n)
            }),
            one(0x0A, "TCLK_MAX", |n| {
                plain("longest sample clock of the adaptive timeout", n)
            }),
            one(0x0B, "TCYC", |n| plain("shortest cycle", n)),
            one(0x0C, "TBUSY_MAX", |n| plain("longest processing time", n)),
            one(0x0D, "BUSY_S", |n| {
                (
                    format!("start bit up to {n} clocks later"),
                    (n > 8).then_some("more than the 8 clocks of D2 Table 10"),
                )
            }),
            field(window, 0x0E, 2, "PON_DLY", |n| plain("power-on delay", n)),
            one(0x10, "DC_NUM", channel_count),
            one(0x11, "SL_NUM", slave_count),
            field(window, 0x12, 1, "SL_OFF", |n| {
                let outside = self.slave_count.is_some_and(|count| n >= u64::from(count));
                let doubt = outside.then_some("not below SL_NUM");
                (format!("this ID is number {n} of the device"), doubt)
            }),
            rest(window, 0x13, 1),
        ];
        for slot in 0..CHANNELS as u8 {
            fields.extend(slot_fields(window, slot, slots.contains(&slot)));
        }
        fields.push(field(window, 0x34, 1, "BC_OFF", |n| self.coupler(n, slots)));
        fields.push(rest(window, 0x35, 11));
        fields
    }

    fn coupler(&self, number: u64, slots: &[u8]) -> Said {
        let Some(index) = self.bus_coupler else {
            let doubt = (number != 0).then_some("says where, but not that there is one");
            return ("no bus coupler".into(), doubt);
        };
        let doubt = if number & 0xE0 != 0 {
            Some("bits without published meaning are set")
        } else if slots.contains(&index) {
            Some("its slot is that of a data channel")
        } else {
            None
        };
        (
            format!("bus coupler is number {index} of the device"),
            doubt,
        )
    }
}

fn slot_fields(window: &Window, slot: u8, used: bool) -> [Field; 4] {
    let [bank, dlen, format, cpoly] = SLOTS[usize::from(slot)];
    let at = 0x14 + 4 * slot;
    let one = |register: u8, name, say: fn(u64) -> Said| {
        field(window, at + register, 1, name, |number| {
            if used {
                return say(number);
            }
            let empty = matches!(number, 0x00 | 0xFF);
            let doubt = (!empty).then_some("beyond DC_NUM");
            (NOT_USED.into(), doubt)
        })
    };
    [
        one(0, bank, profile_bank),
        one(1, dlen, data_length),
        one(2, format, format_flags),
        one(3, cpoly, polynomial),
    ]
}

/// A number whose unit nobody has published.
fn plain(what: &str, number: u64) -> Said {
    (format!("{what}: {number}"), Some(NO_UNIT))
}

fn rest(window: &Window, offset: u8, len: u8) -> Field {
    unnamed(window, offset, len, "", "not in the published layout")
}

fn version(number: u64) -> Said {
    let doubt = (number == 0xFF).then_some("never written");
    (format!("version {number}"), doubt)
}

fn length(number: u64) -> Said {
    let doubt = match number {
        0x00 | 0xFF => "no length",
        _ => NO_UNIT,
    };
    (format!("length {number}"), Some(doubt))
}

/// NXP calls the unit 1 ns, but one byte of them cannot say anything slower than 3.9 MHz.
fn clock_period(number: u64) -> Said {
    let doubt = "NXP reads it in ns, which one byte is too small for";
    (format!("shortest clock period: {number}"), Some(doubt))
}

fn channel_count(number: u64) -> Said {
    let doubt = match number {
        0 => Some("a device without data channels"),
        1..=8 => None,
        _ => Some("a device has at most 8 channels"),
    };
    (format!("{number} data channel{}", plural(number)), doubt)
}

fn slave_count(number: u64) -> Said {
    let doubt = match number {
        0 => Some("a device has at least one slave ID"),
        1..=8 => None,
        _ => Some("there are 8 slave IDs"),
    };
    (format!("{number} slave ID{}", plural(number)), doubt)
}

fn plural(number: u64) -> &'static str {
    if number == 1 { "" } else { "s" }
}

fn profile_bank(number: u64) -> Said {
    match number {
        0x00 => ("no profile EDS".into(), None),
        0xFF => ("no profile EDS".into(), Some("never written")),
        bank => (format!("profile EDS in bank {bank}"), None),
    }
}

fn data_length(number: u64) -> Said {
    let doubt = match number {
        0 => Some("a channel without data"),
        1..=64 => None,
        _ => Some("a channel has at most 64 data bits"),
    };
    (format!("{number} bit{}", plural(number)), doubt)
}

fn format_flags(number: u64) -> Said {
    let kind = if number & 1 == 0 {
        "sensor"
    } else {
        "actuator"
    };
    let side = if number & 2 == 0 { "right" } else { "left" };
    let stop = if number & 8 == 0 {
        ""
    } else {
        ", leading stop bit"
    };
    let unknown = number & !0b1011 != 0;
    let doubt = unknown.then_some("bits without published meaning are set");
    (format!("{kind}, {side}-aligned{stop}"), doubt)
}

fn polynomial(number: u64) -> Said {
    if number == 0 {
        return ("no polynomial".into(), None);
    }
    let readings = super::readings(number as u8);
    let words: Vec<String> = readings.iter().map(|poly| format!("{poly:#X}")).collect();
    let doubt = match words.len() {
        0 => Some("no polynomial in either reading"),
        1 => None,
        _ => Some("with or without the constant term: not published"),
    };
    (format!("CRC {}", words.join(" or ")), doubt)
}
