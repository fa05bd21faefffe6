//! From register bytes to who a slave is and what it sends.
#![allow(clippy::unwrap_used)]

mod common;

use biss::crc::Crc;
use biss::cycle::{Cycle, Head};
use biss::frame::{BissC, emit};
use biss::identity::{
    BankSelect, Candidate, Cell, Device, Direct, Eds, EdsBank, Encoder, Field, Known,
    MAX_CANDIDATES, Profile, ProfileEds, Read, Window, candidates, readings, unexplained,
    wide_readings,
};
use biss::protocol::Protocol;
use biss::trace::Trace;
use biss::{Format, format::Channel};
use fastrand::Rng;

/// A slave as a test has it: registers that answer, banks that can be selected.
#[derive(Clone, Default)]
struct Slave {
    direct: Vec<(u8, Vec<u8>)>,
    banks: Vec<(u8, Vec<u8>)>,
}

impl Slave {
    fn with(mut self, address: u8, bytes: &[u8]) -> Slave {
        self.direct.push((address, bytes.to_vec()));
        self
    }

    fn bank(mut self, number: u8, bytes: &[u8]) -> Slave {
        self.banks.push((number, bytes.to_vec()));
        self
    }

    fn cell(&self, read: &Read, address: u8) -> Cell {
        let regions = match read.bank {
            None => self.direct.iter().map(|(at, b)| (*at, b)).collect(),
            Some(bank) => self
                .banks
                .iter()
                .filter(|(number, _)| *number == bank)
                .map(|(_, b)| (0, b))
                .collect::<Vec<_>>(),
        };
        let found = regions
            .iter()
            .find_map(|(at, bytes)| bytes.get(usize::from(address.checked_sub(*at)?)));
        found.map_or(Cell::Refused, |byte| Cell::Byte(*byte))
    }

    /// Everything that is wanted, as a master would read it, and how many reads that took.
    fn read(&self, id: u8) -> (Known, usize) {
        let mut known = Known::new(id);
        let mut reads = 0;
        while let Some(read) = known.wanted() {
            assert_eq!(read.slave, id);
            let cells: Vec<Cell> = read.addresses().map(|a| self.cell(&read, a)).collect();
            assert_eq!(cells.len(), 64);
            known.store(&read, &cells);
            reads += 1;
            assert!(reads <= 10, "asks without end: {read:?}");
        }
        (known, reads)
    }

    fn known(&self, id: u8) -> Known {
        self.read(id).0
    }
}

/// AN22 "BiSS Reader Content": a real iC-MHM.
fn ic_mhm() -> Slave {
    let bank = [
        0x48, 0x44, 0x00, 0x78, 0x80, 0x00, 0x00, 0x00, 0xCF, 0x80, 0x00, 0x00, 0x23, 0x00, 0x00,
        0x00, 0x00, 0x00, 0x00, 0x8C,
    ];
    Slave::default()
        .with(
            0x40,
            &[
                0x00, 0x02, 0x62, 0x1E, 0xFF, 0xFF, 0xFF, 0xFF, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
                0x8C, 0xFF,
            ],
        )
        .with(0x50, &[0xFF; 0x20])
        .with(0x70, &[0x00, 0x01, 0x15, 0x15])
        .with(0x78, &[0x4D, 0x48, 0x4D, 0x23, 0x44, 0x00, 0x69, 0x43])
        .bank(0, &bank)
}

fn texts(found: &[Candidate]) -> Vec<String> {
    found.iter().map(|c| c.format.to_string()).collect()
}

fn named<'a>(fields: &'a [Field], name: &str) -> &'a Field {
    fields.iter().find(|field| field.name == name).unwrap()
}

/// Whether a frame that carries `words` in format `truth` decodes in format `tried`.
fn passes(truth: &Format, words: &[u64], tried: &Format) -> bool {
    let head = Head {
        delay_clk: 0,
        ack: 1,
        cds: false,
    };
    let mut trace = Trace::default();
    emit(truth, head, words, &mut trace.bits);
    // As a link does it: as many clocks as the format asks for, zeros behind the stop bit.
    let want = 5 + usize::from(tried.bits()) + 2;
    trace.bits.extend(std::iter::repeat_n(
        false,
        want.saturating_sub(trace.bits.len()),
    ));
    let mut cycle = Cycle::default();
    BissC::new(tried.clone()).decode(&trace, &mut cycle);
    cycle.fault().is_none() && cycle.words().iter().all(|word| word.good().is_some())
}

/// What a master would settle on: the first that all of so many frames pass.
fn settled<'a>(
    truth: &Format,
    found: &'a [Candidate],
    frames: usize,
    rng: &mut Rng,
) -> Option<&'a Candidate> {
    let frames: Vec<Vec<u64>> = (0..frames)
        .map(|_| {
            let word = |c: &Channel| common::word(rng, c.data_bits()).max(1);
            truth.channels().iter().map(word).collect()
        })
        .collect();
    found
        .iter()
        .find(|c| frames.iter().all(|words| passes(truth, words, &c.format)))
}

#[test]
fn a_real_ic_mhm() {
    let (known, reads) = ic_mhm().read(0);
    assert_eq!(
        reads, 2,
        "IDs, and the EDS bank that it names but does not have"
    );
    let device = &known.device;
    assert_eq!(device.bank_select, BankSelect::At(0));
    assert_eq!(device.eds_bank, EdsBank::At(2));
    let profile = Profile::Encoder {
        version: 1,
        crc_flag: false,
        data_bits: 30,
    };
    assert_eq!(device.profile, profile);
    assert_eq!(device.serial.number(), None, "0xFFFFFFFF is no number");
    assert_eq!(device.id.number(), Some(0x4D48_4D23_4400));
    assert_eq!(device.id.text().as_deref(), Some("MHM#D"));
    assert_eq!(device.manufacturer.number(), Some(0x6943));
    assert_eq!(device.manufacturer.text().as_deref(), Some("iC"));
    assert_eq!(device.manufacturer.name(), Some("iC-Haus"));
    let lines: Vec<(u8, &str, String, &str)> = device
        .fields
        .iter()
        .map(|f| (f.offset, f.name, f.hex(), f.meaning.as_str()))
        .collect();
    assert_eq!(lines[0], (0x40, "BSEL", "00".into(), "bank 0 is selected"));
    assert_eq!(lines[1], (0x41, "EDS_BANK", "02".into(), "EDS in bank 2"));
    let meaning = "BP3 standard encoder, version 1, 30 bits with nE and nW";
    assert_eq!(lines[2], (0x42, "BP_ID", "62 1E".into(), meaning));
    let serial = (0x44, "DEV_SN", "FF FF FF FF".into(), "no serial number");
    assert_eq!(lines[3], serial);
    assert_eq!(lines[4].2.split(' ').nth(0x2C), Some("--"), "0x74");
    let id = (0x78, "DEV_ID", "4D 48 4D 23 44 00".into(), "\"MHM#D\"");
    assert_eq!(lines[5], id);
    let maker = (0x7E, "MFR_ID", "69 43".into(), "iC-Haus (\"iC\")");
    assert_eq!(lines[6], maker);

    let eds = known.eds.as_ref().unwrap();
    assert_eq!(eds.distrust, Some("no register could be read"));
    let found = candidates(std::slice::from_ref(&known));
    assert_eq!(found[0].format.to_string(), "st28,nE,nW,crc6");
    assert_eq!(found[0].slaves, [0]);
    assert_eq!(found[0].reason, "BP_ID 0x621E: BP3, 30 bits, its CRC 0x43");
    assert!(unexplained(&[known]).is_empty());

    // The frame in the same application note: SCD 0xD67 with CRC 0x31.
    let mut trace = Trace::default();
    let slo = "10100000000000000000001101011001111100010";
    trace.bits.extend(slo.bytes().map(|level| level == b'1'));
    let mut cycle = Cycle::default();
    BissC::new(found[0].format.clone()).decode(&trace, &mut cycle);
    assert_eq!(cycle.fault(), None);
    let word = cycle.words()[0].good().unwrap();
    assert_eq!(cycle.words()[0].raw(), (0xD67, 0x31));
    let channel = &found[0].format.channels()[0];
    assert_eq!(channel.position().unwrap().get(word), 0x359);
    assert_eq!(
        (channel.error(word), channel.warning(word)),
        (Some(false), Some(false))
    );
}

#[test]
fn profiles_as_data_sheets_have_them() {
    let bp1 = |variant, significant_bits| Profile::EncoderVariant {
        variant,
        significant_bits,
    };
    let bp0 = |data_bits, actuator, application| Profile::Universal {
        data_bits,
        actuator,
        application,
    };
    for (number, profile, first) in [
        (0x2814, bp1(8, 20), Some("st24,nE,nW,crc6")),
        (0x2C0C, bp1(12, 12), Some("st12,nE,nW,crc6")),
        (0x2C09, bp1(12, 9), Some("st12,nE,nW,crc6")),
        (0x2014, bp1(0, 20), None),
        (0x0000, Profile::None, None),
        (0x1005, bp0(16, false, 5), Some("data16,crc5")),
        (0x1085, bp0(16, true, 5), Some("data16,crc5")),
        (0x0101, bp0(1, false, 1), Some("data1,crc5")),
        (0x8000, Profile::Other(0x8000), None),
        (0xFFFF, Profile::Other(0xFFFF), None),
    ] {
        let bytes = u16::to_be_bytes(number);
        let known = Slave::default().with(0x42, &bytes).known(0);
        assert_eq!(known.device.profile, profile, "{number:#06x}");
        let found = candidates(std::slice::from_ref(&known));
        let text = found.first().map(|c| c.format.to_string());
        assert_eq!(text.as_deref(), first, "{number:#06x}");
        let dark: &[u8] = if first.is_none() { &[0] } else { &[] };
        assert_eq!(unexplained(&[known]), dark, "{number:#06x}");
    }
    // Nothing fits into two bits, or into more than 64.
    for bits in [0x00, 0x02, 0x41, 0x7F] {
        for profile in [0x62, 0x72] {
            let known = Slave::default().with(0x42, &[profile, bits]).known(0);
            let field = known.device.field(0x42).unwrap();
            assert!(field.doubt.is_some(), "{profile:#x} {bits:#x}");
            assert_eq!(texts(&candidates(&[known])), [""; 0]);
        }
    }
    let known = Slave::default().with(0x42, &[0x62, 0x40]).known(0);
    assert_eq!(known.device.field(0x42).unwrap().doubt, None);
    assert_eq!(texts(&candidates(&[known]))[0], "st62,nE,nW,crc6");
    // Length is seven bits, version three.
    let known = Slave::default().with(0x42, &[0x7F, 0x9E]).known(0);
    let safety = Profile::Safety {
        version: 7,
        crc_flag: true,
        data_bits: 30,
    };
    assert_eq!(known.device.profile, safety);
    assert!(known.device.field(0x42).unwrap().doubt.is_some());
}

#[test]
fn serial_numbers_in_both_orders() {
    let device = |bytes: [u8; 4]| Device::decode(0, &Direct::of(0x44, &bytes));
    let lika = device([0x00, 0x00, 0x01, 0x02]);
    assert_eq!(lika.serial.number(), Some(0x102));
    assert_eq!(lika.serial.low_first(), Some(0x0201_0000));
    let field = lika.field(0x44).unwrap();
    assert_eq!(field.meaning, "258 (0x102); low byte first it is 33619968");
    for none in [[0; 4], [0xFF; 4]] {
        assert_eq!(device(none).serial.number(), None);
        assert_eq!(
            device(none).field(0x44).unwrap().meaning,
            "no serial number"
        );
    }
    let unread = Device::decode(0, &Direct::unread());
    assert_eq!(unread.serial.number(), None);
    assert!(unread.is_silent());
}

#[test]
fn names_only_for_known_manufacturers_and_printable_text() {
    let maker = |bytes: &[u8]| Device::decode(0, &Direct::of(0x7E, bytes)).manufacturer;
    assert_eq!(maker(&[0x4C, 0x69]).name(), Some("Lika"));
    assert_eq!(maker(&[0x43, 0x69]).name(), None, "the wrong byte order");
    assert_eq!(maker(&[0x52, 0x4E]).name(), None);
    assert_eq!(maker(&[0x52, 0x4E]).text().as_deref(), Some("RN"));
    assert_eq!(maker(&[0x00, 0x01]).text(), None);
    assert_eq!(maker(&[0x69]).number(), None);
    let id = |bytes: &[u8]| Device::decode(0, &Direct::of(0x78, bytes)).id;
    assert_eq!(id(b"AMM3\0\0").text().as_deref(), Some("AMM3"));
    assert_eq!(id(b"AM\0M3\0").text(), None, "a zero inside is no text");
    assert_eq!(id(&[0; 6]).text(), None);
    assert_eq!(id(b"AMM3").number(), None);
}

#[test]
fn why_there_is_no_eds() {
    for (cells, bank) in [
        (Cell::Byte(0x00), EdsBank::Absent("EDS_BANK is 0: no EDS")),
        (
            Cell::Byte(0xFF),
            EdsBank::Absent("EDS_BANK is 0xFF: no EDS"),
        ),
        (
            Cell::Refused,
            EdsBank::Absent("EDS_BANK is refused: no EDS"),
        ),
        (Cell::Unread, EdsBank::Unread),
        (Cell::Byte(0xFE), EdsBank::At(0xFE)),
    ] {
        let mut direct = Direct::of(0x40, &[0]);
        direct.set(0x41, cells);
        let device = Device::decode(0, &direct);
        assert_eq!(device.eds_bank, bank);
        let expected = if let EdsBank::At(bank) = bank {
            Some(bank)
        } else {
            None
        };
        let mut known = Known::new(0);
        let read = known.wanted().unwrap();
        let all: Vec<Cell> = direct.iter().map(|(_, cell)| cell).collect();
        known.store(&read, &all);
        assert_eq!(known.wanted().and_then(|read| read.bank), expected);
    }
    // A bank that cannot be selected is not asked for.
    let single = Slave::default().with(0x41, &[2, 0x62, 0x1E]);
    let (known, reads) = single.read(0);
    assert_eq!(known.device.bank_select, BankSelect::OneBank);
    assert_eq!(reads, 1);
    assert!(known.device.field(0x41).unwrap().doubt.is_some());
}

/// How a device writes its polynomials.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Stored {
    Whole,
    Short,
}

/// A data channel as the test writes it into an EDS, and the text of what it sends.
#[derive(Clone, Debug)]
struct Sent {
    text: String,
    data_bits: u8,
    actuator: bool,
    crc: Option<(u8, u32)>,
    encoder: Option<(u8, u8)>,
    start: u32,
}

fn encoder(turns: u8, position: u8, bits: u8, poly: u32) -> Sent {
    let turn = if turns > 0 {
        format!("mt{turns},")
    } else {
        String::new()
    };
    Sent {
        text: format!("{turn}st{position},nE,nW,crc{bits}:{poly:#x}"),
        data_bits: turns + position + 2,
        actuator: false,
        crc: Some((bits, poly)),
        encoder: Some((0, turns)),
        start: 0,
    }
}

fn linear(position: u8) -> Sent {
    Sent {
        text: format!("pos{position},nE,nW,crc6"),
        encoder: Some((1, 0)),
        ..encoder(0, position, 6, 0x43)
    }
}

fn safety_word(turns: u8, position: u8, start: u32) -> Sent {
    let turn = if turns > 0 {
        format!("mt{turns},")
    } else {
        String::new()
    };
    let init = if start > 0 {
        format!(":0x190D9:init={start:#x}")
    } else {
        String::new()
    };
    Sent {
        text: format!("{turn}st{position},nE,nW,lc6,crc16{init}"),
        data_bits: turns + position + 8,
        crc: Some((16, 0x190D9)),
        start,
        ..encoder(turns, position, 16, 0x190D9)
    }
}

fn data(bits: u8, actuator: bool, crc: Option<(u8, u32)>) -> Sent {
    let check = crc.map_or(String::new(), |(bits, poly)| {
        format!(",crc{bits}:{poly:#x}")
    });
    Sent {
        text: format!("data{bits}{check}"),
        data_bits: bits,
        actuator,
        crc,
        encoder: None,
        start: 0,
    }
}

fn format_of(channels: &[&Sent]) -> Format {
    let texts: Vec<&str> = channels.iter().map(|c| c.text.as_str()).collect();
    texts.join("+").parse().unwrap()
}

/// An EDS in bank 2 with profile EDS in banks 3 and up, one slave ID for all channels or one each.
fn slave_with(channels: &[Sent], stored: Stored, ids: u8, offset: u8) -> Slave {
    let mut eds = vec![0u8; 64];
    eds[0x00] = 1;
    eds[0x01] = 64;
    eds[0x02] = 16;
    eds[0x03] = 31;
    eds[0x04] = 100;
    eds[0x0E] = 0x01;
    eds[0x0F] = 0x02;
    eds[0x10] = channels.len() as u8;
    eds[0x11] = ids;
    eds[0x12] = offset;
    let mut slave = Slave::default().with(0x40, &[0, 2]);
    for (k, channel) in channels.iter().enumerate() {
        let at = 0x14 + 4 * k;
        let poly = channel.crc.map_or(0, |(_, poly)| poly);
        eds[at + 1] = channel.data_bits;
        eds[at + 2] = u8::from(channel.actuator);
        eds[at + 3] = match stored {
            Stored::Whole if poly <= 0xFF => poly as u8,
            Stored::Short if poly <= 0x1FF => (poly >> 1) as u8,
            _ => 0,
        };
        if let Some((kind, turns)) = channel.encoder {
            let bank = 3 + k as u8;
            eds[at] = bank;
            let mut profile = vec![0u8; 64];
            profile[0x08] = kind;
            profile[0x0A] = turns;
            profile[0x14..0x18].copy_from_slice(&4096u32.to_be_bytes());
            let wide = match stored {
                Stored::Short => poly >> 1,
                _ => poly,
            };
            profile[0x1C..0x20].copy_from_slice(&wide.to_be_bytes());
            profile[0x20..0x24].copy_from_slice(&channel.start.to_be_bytes());
            slave = slave.bank(bank, &profile);
        }
    }
    slave.bank(2, &eds)
}

#[test]
fn an_eds_of_one_channel() {
    let slave = slave_with(&[encoder(12, 20, 6, 0x43)], Stored::Short, 1, 0);
    let (known, reads) = slave.read(0);
    assert_eq!(reads, 3, "IDs, EDS, profile EDS");
    let eds = known.trusted_eds().unwrap();
    assert_eq!(eds.user_banks, Some((16, 31)));
    assert_eq!((eds.slave_count, eds.slave_offset), (Some(1), Some(0)));
    assert_eq!((eds.version, eds.length), (Some(1), Some(64)));
    let channel = eds.channels[0];
    assert_eq!((channel.slot, channel.slave), (0, 0));
    assert_eq!((channel.data_bits, channel.cpoly), (34, 0x21));
    assert_eq!(channel.profile_bank, Some(3));
    assert_eq!(named(&eds.fields, "PON_DLY").value, Some(0x0102));
    let unit = Some("unit not published");
    assert_eq!(named(&eds.fields, "PON_DLY").doubt, unit);
    assert_eq!(named(&eds.fields, "TCYC").doubt, unit);
    assert_eq!(named(&eds.fields, "DLEN1").meaning, "34 bits");
    assert_eq!(named(&eds.fields, "CPOLY1").meaning, "CRC 0x43 or 0x21");
    let format = &named(&eds.fields, "FORMAT1").meaning;
    assert_eq!(format, "sensor, right-aligned");
    assert_eq!(named(&eds.fields, "DLEN2").meaning, "not used");
    let profile = known.profile(3).unwrap();
    assert_eq!(profile.encoder, Some(Encoder::Rotary));
    assert_eq!((profile.turn_bits, profile.step), (Some(12), Some(4096)));
    let found = candidates(std::slice::from_ref(&known));
    assert_eq!(found[0].format.to_string(), "mt12,st20,nE,nW,crc6");
    assert_eq!(
        found[0].reason,
        "EDS: 34 bits, profile EDS: CPOLY 0x21 read as 0x43"
    );
    assert_eq!(found[0].doubts, [""; 0]);
    let limits = known.limits();
    let tma = limits.iter().find(|limit| limit.name == "TMA").unwrap();
    assert_eq!((tma.value.as_str(), tma.source), ("100", "EDS"));
    assert!(tma.doubt.is_some());
    let busy = limits.iter().find(|limit| limit.name == "BUSY_S").unwrap();
    assert_eq!(busy.value, "0 clocks");
}

#[test]
fn every_register_of_a_bank_is_listed_once_and_in_order() {
    let known = slave_with(&[encoder(0, 24, 6, 0x43)], Stored::Whole, 1, 0).known(0);
    let eds = known.eds.unwrap();
    let profile = &known.profiles[0].1;
    for (fields, first) in [
        (&eds.fields, 0x00u8),
        (&profile.fields, 0x00),
        (&known.device.fields, 0x40),
    ] {
        let covered: Vec<u8> = fields
            .iter()
            .flat_map(|f| f.offset..f.offset + f.len() as u8)
            .collect();
        let all: Vec<u8> = (first..first + 64).collect();
        assert_eq!(covered, all);
    }
}

/// The published layout, address by address (NXP's driver), with a different byte in each register.
#[test]
fn every_field_is_at_its_address() {
    let bytes: Vec<u8> = (0..64).map(|at| at ^ 0x80).collect();
    let window = Window::of(0, &bytes);
    let eds = Eds::decode(&window).fields;
    for (name, offset, value) in [
        ("EDS_VER", 0x00, 0x80),
        ("EDS_LEN", 0x01, 0x81),
        ("USR_STA", 0x02, 0x82),
        ("USR_END", 0x03, 0x83),
        ("TMA", 0x04, 0x84),
        ("TO_MIN", 0x05, 0x85),
        ("TO_MAX", 0x06, 0x86),
        ("TOS_MIN", 0x07, 0x87),
        ("TOS_MAX", 0x08, 0x88),
        ("TCLK_MIN", 0x09, 0x89),
        ("TCLK_MAX", 0x0A, 0x8A),
        ("TCYC", 0x0B, 0x8B),
        ("TBUSY_MAX", 0x0C, 0x8C),
        ("BUSY_S", 0x0D, 0x8D),
        ("PON_DLY", 0x0E, 0x8E8F),
        ("DC_NUM", 0x10, 0x90),
        ("SL_NUM", 0x11, 0x91),
        ("SL_OFF", 0x12, 0x92),
        ("BANK1", 0x14, 0x94),
        ("DLEN1", 0x15, 0x95),
        ("FORMAT1", 0x16, 0x96),
        ("CPOLY1", 0x17, 0x97),
        ("BANK8", 0x30, 0xB0),
        ("CPOLY8", 0x33, 0xB3),
        ("BC_OFF", 0x34, 0xB4),
    ] {
        let field = named(&eds, name);
        assert_eq!((field.offset, field.value), (offset, Some(value)), "{name}");
    }
    let profile = ProfileEds::decode(&window).fields;
    for (name, offset, value) in [
        ("ENTYP", 0x08, 0x88),
        ("MTLEN", 0x0A, 0x8A),
        ("MTFMT", 0x0B, 0x8B),
        ("SIPCNT", 0x14, 0x9495_9697),
        ("CPOLY", 0x1C, 0x9C9D_9E9F),
        ("CSTART", 0x20, 0xA0A1_A2A3),
    ] {
        let field = named(&profile, name);
        assert_eq!((field.offset, field.value), (offset, Some(value)), "{name}");
    }
}

/// Each polynomial that stands for its width, stored either way, is the first that live frames confirm.
#[test]
fn both_readings_of_cpoly() {
    let rng = &mut common::rng();
    for (bits, poly) in [
        (3, 0xB),
        (4, 0x13),
        (5, 0x25),
        (6, 0x43),
        (7, 0x89),
        (8, 0x12F),
        (16, 0x190D9u32),
    ] {
        for stored in [poly, poly >> 1] {
            let wide = wide_readings(stored);
            assert_eq!(wide[0], (poly, false), "{stored:#x} in 32 bits");
            let Ok(narrow) = u8::try_from(stored) else {
                continue;
            };
            assert_eq!(readings(narrow)[0], poly, "{stored:#x} in 8 bits");
            let sent = data(20, false, Some((bits, poly)));
            let whole = if stored == poly {
                Stored::Whole
            } else {
                Stored::Short
            };
            let slave = slave_with(std::slice::from_ref(&sent), whole, 1, 0);
            let found = candidates(&[slave.known(0)]);
            let truth = format_of(&[&sent]);
            let right = settled(&truth, &found, 40, rng).unwrap();
            assert_eq!(right.format, truth, "{stored:#x}");
            assert!(
                right.reason.contains(&format!("CPOLY {stored:#X}")),
                "{}",
                right.reason
            );
        }
    }
    // A polynomial that stands for no width is tried both ways.
    assert_eq!(readings(0x4D), [0x9B, 0x4D]);
    assert_eq!(readings(0), [0; 0]);
    assert_eq!(readings(1), [3]);
    assert_eq!(wide_readings(0), []);
    assert_eq!(
        wide_readings(0x4300_0000),
        [(0x43, true), (0x87, true)],
        "the low byte first"
    );
    assert_eq!(wide_readings(0xFFFF_FFFF), []);
}

/// Every channel of a device is written in one way: if one shows it, the others are read likewise.
#[test]
fn a_known_polynomial_shows_how_the_others_are_written() {
    let odd = |bits, poly| data(24, false, Some((bits, poly)));
    for stored in [Stored::Whole, Stored::Short] {
        let sent = [odd(6, 0x43), odd(7, 0x9D), odd(5, 0x37)];
        let found = candidates(&[slave_with(&sent, stored, 1, 0).known(0)]);
        assert_eq!(
            found[0].format,
            format_of(&[&sent[0], &sent[1], &sent[2]]),
            "{stored:?}"
        );
    }
}

#[test]
fn a_polynomial_of_no_width_is_read_as_ic_haus_writes_it() {
    let sent = data(24, false, Some((8, 0x197)));
    let found = candidates(&[slave_with(&[sent], Stored::Short, 1, 0).known(0)]);
    assert_eq!(texts(&found), ["data24,crc8:0x197", "data24,crc7:0xCB"]);
}

/// A device that does not show it is taken for one like the others on the bus.
#[test]
fn devices_of_a_bus_write_alike() {
    for stored in [Stored::Whole, Stored::Short] {
        let clear = encoder(12, 20, 6, 0x43);
        let unclear = data(24, false, Some((7, 0x9D)));
        let device =
            |sent: &Sent, id| slave_with(std::slice::from_ref(sent), stored, 1, 0).known(id);
        let found = candidates(&[device(&clear, 0), device(&unclear, 1)]);
        assert_eq!(
            found[0].format,
            format_of(&[&unclear, &clear]),
            "{stored:?}"
        );
    }
}

/// One device with one slave ID for each channel: the highest ID is nearest, and its channel comes first.
#[test]
fn channels_with_their_own_ids_come_highest_first() {
    let sent = [encoder(12, 20, 6, 0x43), data(16, false, Some((5, 0x25)))];
    let slave = slave_with(&sent, Stored::Whole, 2, 0);
    let bus = [slave.known(0), Slave::default().known(1)];
    let found = candidates(&bus);
    assert_eq!(
        texts(&found)[..2],
        [
            "data16,crc5+mt12,st20,nE,nW,crc6",
            "mt12,st20,nE,nW,crc6+data16,crc5"
        ],
        "and then the other way round"
    );
    assert!(found.iter().all(|c| c.slaves == [1, 0]));
    assert!(unexplained(&bus).is_empty());

    let ids = |known: &Known| -> Vec<u8> {
        let eds = known.trusted_eds().unwrap();
        eds.channels.iter().map(|channel| channel.slave).collect()
    };
    assert_eq!(ids(&bus[0]), [0, 1]);

    // The same with one ID: the EDS's own order is the likelier one.
    let slave = slave_with(&sent, Stored::Whole, 1, 0);
    assert_eq!(ids(&slave.known(0)), [0, 0]);
    let found = candidates(&[slave.known(0)]);
    assert_eq!(
        found[0].format.to_string(),
        "mt12,st20,nE,nW,crc6+data16,crc5"
    );
    assert_eq!(found[0].slaves, [0, 0]);
    assert_eq!(
        found[1].format.to_string(),
        "data16,crc5+mt12,st20,nE,nW,crc6"
    );
}

/// Two equal devices of two IDs each, whose IDs all show the same EDS.
#[test]
fn a_device_of_several_ids_counts_once() {
    let sent = [encoder(12, 20, 6, 0x43), data(16, false, Some((5, 0x25)))];
    let pair = "data16,crc5+mt12,st20,nE,nW,crc6";
    for offset in [0, 1] {
        let slave = slave_with(&sent, Stored::Whole, 2, offset);
        let bus: Vec<Known> = (0..4).rev().map(|id| slave.known(id)).collect();
        let found = candidates(&bus);
        assert_eq!(found[0].format.to_string(), format!("{pair}+{pair}"));
        assert_eq!(found[0].slaves, [3, 2, 1, 0]);
    }
    // Beside an encoder that is nearer, and one that is farther.
    let near = Slave::default().with(0x42, &[0x62, 0x14]);
    let far = Slave::default().with(0x42, &[0x10, 0x00]);
    let slave = slave_with(&sent, Stored::Whole, 2, 1);
    let bus = [
        far.known(0),
        Slave::default().known(1),
        slave.known(2),
        near.known(3),
    ];
    let found = candidates(&bus);
    assert_eq!(
        found[0].format.to_string(),
        format!("st18,nE,nW,crc6+{pair}+data16,crc5")
    );
    assert_eq!(found[0].slaves, [3, 2, 1, 0]);
    assert_eq!(
        found[0].reason,
        "slave 3: BP_ID 0x6214: BP3, 20 bits, its CRC 0x43; slave 2: EDS: 16 bits, CPOLY 0x25; \
         slave 1: EDS: 34 bits, profile EDS: CPOLY 0x43; slave 0: BP_ID 0x1000: BP0, 16 bits, its CRC 0x25"
    );
    // An EDS that claims more IDs than there are describes its own.
    let found = candidates(&[slave.known(0)]);
    assert!(found.iter().all(|c| c.slaves == [0, 0]));
    assert!(!found.is_empty());
}

#[test]
fn a_bus_coupler_has_no_channel() {
    let sent = [encoder(0, 24, 6, 0x43), data(16, true, Some((5, 0x25)))];
    let mut slave = slave_with(&sent, Stored::Whole, 3, 0);
    let eds = &mut slave.banks.last_mut().unwrap().1;
    // Its slot is the middle one, left empty.
    let second: Vec<u8> = eds[0x18..0x1C].to_vec();
    eds[0x18..0x1C].fill(0);
    eds[0x1C..0x20].copy_from_slice(&second);
    eds[0x34] = 0x11;
    let none = Slave::default();
    let bus = [slave.known(0), none.known(1), none.known(2)];
    let eds = bus[0].trusted_eds().unwrap();
    assert_eq!(eds.bus_coupler, Some(1));
    assert_eq!(
        named(&eds.fields, "BC_OFF").meaning,
        "bus coupler is number 1 of the device"
    );
    let found = candidates(&bus);
    let expected = "data16,crc5+st24,nE,nW,crc6";
    assert_eq!(found[0].format.to_string(), expected);
    assert_eq!(found[0].slaves, [2, 0]);

    // Whatever stands in its slot, as there are fewer channels than IDs.
    slave.banks.last_mut().unwrap().1[0x19] = 30;
    let bus = [slave.known(0), none.known(1), none.known(2)];
    assert_eq!(candidates(&bus)[0].format.to_string(), expected);

    // Where the EDS makes no frame, BP_ID does, and the coupler is no hole.
    let mut slave = slave_with(&[encoder(0, 24, 6, 0x43)], Stored::Whole, 2, 0);
    let eds = &mut slave.banks.last_mut().unwrap().1;
    (eds[0x15], eds[0x34]) = (2, 0x11);
    let bus = [
        slave.with(0x42, &[0x62, 0x1E]).known(0),
        Slave::default().known(1),
    ];
    let found = candidates(&bus);
    assert_eq!(found[0].format.to_string(), "st28,nE,nW,crc6");
    assert_eq!(found[0].slaves, [0]);
}

#[test]
fn a_bus_coupler_alone_is_no_hole() {
    let mut slave = slave_with(&[], Stored::Whole, 1, 0);
    slave.banks[0].1[0x34] = 0x10;
    let encoder = Slave::default().with(0x42, &[0x62, 0x1E]);
    let bus = [slave.known(0), encoder.known(1)];
    assert_eq!(unexplained(&bus), [0; 0]);
    let found = candidates(&bus);
    assert_eq!(found[0].format.to_string(), "st28,nE,nW,crc6");
    assert_eq!(found[0].slaves, [1]);
}

/// As NXP's driver would read it.
#[test]
fn a_profile_eds_with_the_low_byte_first() {
    let mut slave = slave_with(&[safety_word(12, 24, 0)], Stored::Whole, 1, 0);
    let profile = &mut slave.banks[0].1;
    profile[0x1C..0x20].copy_from_slice(&0x190D9u32.to_le_bytes());
    profile[0x20..0x24].copy_from_slice(&0xFFFFu32.to_le_bytes());
    let known = slave.known(0);
    let fields = &known.profile(3).unwrap().fields;
    for name in ["CPOLY", "CSTART"] {
        let doubt = named(fields, name).doubt.unwrap();
        assert!(doubt.contains("low byte first"), "{name}: {doubt}");
    }
    let found = candidates(&[known]);
    assert_eq!(
        found[0].format.to_string(),
        "mt12,st24,nE,nW,lc6,crc16:0x190D9:init=0xFFFF"
    );
    assert_eq!(
        found[0].reason,
        "EDS: 44 bits, profile EDS: CPOLY 0xD9900100 read as 0x190D9, low byte first, CSTART 0xFFFF"
    );
}

#[test]
fn contradictions_are_marked() {
    let good = slave_with(&[encoder(12, 20, 6, 0x43)], Stored::Whole, 1, 0);
    for (address, byte, name) in [
        (0x02, 32, "USR_END"),
        (0x0D, 9, "BUSY_S"),
        (0x11, 0, "SL_NUM"),
        (0x11, 9, "SL_NUM"),
        (0x12, 1, "SL_OFF"),
        (0x14, 0xFF, "BANK1"),
        (0x16, 0x04, "FORMAT1"),
        (0x19, 20, "DLEN2"),
        (0x34, 0x02, "BC_OFF"),
        (0x34, 0x10, "BC_OFF"),
        (0x34, 0x32, "BC_OFF"),
    ] {
        let eds = |slave: &Slave| slave.known(0).eds.unwrap();
        let mut slave = good.clone();
        assert_eq!(named(&eds(&slave).fields, name).doubt, None, "{name}");
        slave.banks.last_mut().unwrap().1[address] = byte;
        let eds = eds(&slave);
        assert!(named(&eds.fields, name).doubt.is_some(), "{name} {byte:#x}");
        assert_eq!(eds.distrust, None, "{name} says nothing about the frame");
        let found = candidates(&[slave.known(0)]);
        assert_eq!(found[0].format.channels()[0].data_bits(), 34, "{name}");
    }
    let mut slave = good.clone();
    slave.banks.last_mut().unwrap().1[0x16] = 0x02;
    let found = candidates(&[slave.known(0)]);
    assert!(found[0].doubts[0].contains("left-aligned"));
}

#[test]
fn actuators_and_unknown_data_are_data() {
    let mut slave = slave_with(
        &[data(16, true, Some((5, 0x25))), data(8, false, None)],
        Stored::Whole,
        1,
        0,
    );
    let found = candidates(&[slave.known(0)]);
    assert_eq!(found[0].format.to_string(), "data16,crc5+data8");
    assert_eq!(
        found[0].doubts,
        ["without a CRC nothing shows whether it is right"]
    );
    // Not even the profile of an encoder makes a position of it.
    let own = slave.clone().with(0x42, &[0x62, 0x1E]).known(0);
    assert_eq!(texts(&candidates(&[own]))[0], "data16,crc5+st6,nE,nW,crc6");
    slave.banks.last_mut().unwrap().1[0x16] = 0b1001;
    let known = slave.known(0);
    let eds = known.trusted_eds().unwrap();
    assert!(eds.channels[0].leading_stop && eds.channels[0].actuator);
    let format = &named(&eds.fields, "FORMAT1").meaning;
    assert_eq!(format, "actuator, right-aligned, leading stop bit");
    let found = texts(&candidates(&[known]));
    assert_eq!(found[0], "pad1,data16,crc5+data8");
    assert!(found.contains(&"data16,crc5+data8".to_owned()));
}

#[test]
fn linear_encoders_have_a_position() {
    let known = slave_with(&[linear(32)], Stored::Whole, 1, 0).known(0);
    let found = candidates(&[known]);
    assert_eq!(found[0].format.to_string(), "pos32,nE,nW,crc6");
}

/// Without the profile EDS nothing says how many of the bits are turns.
#[test]
fn an_unknown_split_is_said() {
    let mut slave = slave_with(&[encoder(12, 20, 6, 0x43)], Stored::Whole, 1, 0);
    slave.banks.retain(|(bank, _)| *bank == 2);
    let slave = slave.with(0x42, &[0x62, 0x22]);
    let found = candidates(&[slave.known(0)]);
    assert_eq!(found[0].format.to_string(), "st32,nE,nW,crc6");
    assert_eq!(found[0].reason, "EDS: 34 bits, CPOLY 0x43");
    assert_eq!(found[0].doubts.len(), 2, "{:?}", found[0].doubts);
    // A split that does not fit is none.
    let mut slave = slave_with(&[encoder(12, 20, 6, 0x43)], Stored::Whole, 1, 0);
    slave.banks[0].1[0x0A] = 32;
    let found = candidates(&[slave.known(0)]);
    assert_eq!(found[0].format.to_string(), "st32,nE,nW,crc6");
}

/// 8 bits do not hold the polynomial of a safety word.
#[test]
fn a_safety_word_without_a_profile_eds() {
    let rng = &mut common::rng();
    for (stored, cpoly) in [
        (Stored::Whole, 0x00),
        (Stored::Whole, 0xD9),
        (Stored::Short, 0x6C),
    ] {
        let sent = [encoder(0, 24, 6, 0x43), safety_word(0, 16, 0)];
        let mut slave = slave_with(&sent, stored, 1, 0);
        slave.banks.retain(|(bank, _)| *bank == 2);
        slave.banks[0].1[0x1B] = cpoly;
        let known = slave.with(0x42, &[0x62, 0x1A]).known(0);
        let truth = format_of(&[&sent[0], &sent[1]]);
        let found = candidates(&[known]);
        let right = settled(&truth, &found, 40, rng).unwrap();
        assert_eq!(right.format, truth, "{cpoly:#x}: {:#?}", texts(&found));
    }
}

#[test]
fn safety_pairs() {
    let rng = &mut common::rng();
    // In an EDS, the polynomial of the second word in the profile EDS only.
    for (ids, start) in [(1, 0), (2, 0), (1, 0xFFFF), (2, 0x1234)] {
        let sent = [encoder(12, 24, 6, 0x43), safety_word(12, 16, start)];
        let slave = slave_with(&sent, Stored::Whole, ids, 0);
        let mut bus = vec![slave.known(0)];
        if ids == 2 {
            bus.push(Slave::default().known(1));
        }
        let wire: Vec<&Sent> = if ids == 2 {
            sent.iter().rev().collect()
        } else {
            sent.iter().collect()
        };
        let truth = format_of(&wire);
        let found = candidates(&bus);
        assert_eq!(found[0].format, truth, "{ids} IDs, start {start:#x}");
        // The CRC does not show whether the last six bits are a sign of life: that reading is next, never before.
        let lifeless = truth.to_string().replace("st16,nE,nW,lc6", "st22,nE,nW");
        assert_eq!(found[1].format.to_string(), lifeless);
        // It might be the other way round as well, and frames say which.
        let truth = format_of(&wire.into_iter().rev().collect::<Vec<_>>());
        let right = settled(&truth, &found, 40, rng).unwrap();
        assert_eq!(right.format, truth, "{ids} IDs, start {start:#x}");
    }
    // By BP_ID alone: a lone slave must send both words, its length being either's.
    for (bits, truth) in [
        (0x20, "mt12,st16,nE,nW,crc6+mt12,st12,nE,nW,lc6,crc16"),
        (0x18, "st24,nE,nW,crc6+st16,nE,nW,lc6,crc16"),
        (0x1A, "st18,nE,nW,crc6+st18,nE,nW,lc6,crc16"),
        (0x1A, "st24,nE,nW,crc6+st24,nE,nW,lc6,crc16"),
        (0x1A, "st18,nE,nW,lc6,crc16"),
    ] {
        let known = Slave::default().with(0x42, &[0x72, bits]).known(0);
        let found = candidates(&[known]);
        let truth: Format = truth.parse().unwrap();
        let right = settled(&truth, &found, 40, rng).unwrap();
        assert_eq!(right.format, truth);
    }
    // Two slaves with a word each.
    let cpw = Slave::default().with(0x42, &[0x62, 0x1E]).known(1);
    let spw = Slave::default().with(0x42, &[0x72, 0x20]).known(0);
    let found = candidates(&[spw, cpw]);
    assert_eq!(
        found[0].format.to_string(),
        "st28,nE,nW,crc6+st24,nE,nW,lc6,crc16"
    );
    assert_eq!(found[0].slaves, [1, 0]);
}

fn any_channel(rng: &mut Rng, stored: Stored, few: bool) -> Sent {
    // A polynomial of 8 bits does not fit into CPOLY as it stands. The last one stands for no width.
    let polys: [(u8, u32); 4] = match stored {
        Stored::Short => [(5, 0x25), (6, 0x43), (8, 0x12F), (8, 0x197)],
        _ => [(5, 0x25), (6, 0x43), (7, 0x89), (7, 0x9D)],
    };
    let (bits, poly) = polys[rng.usize(..if few { 4 } else { 3 })];
    let turns = if rng.bool() { rng.u8(1..=24) } else { 0 };
    match rng.u8(..5) {
        0 => data(rng.u8(4..=48), rng.bool(), Some((bits, poly))),
        1 => linear(rng.u8(12..=48)),
        2 => safety_word(turns, rng.u8(8..=28), 0),
        _ => encoder(turns, rng.u8(8..=32), bits, poly),
    }
}

/// Devices of our own making, alone and in chains, in both conventions: what live frames confirm is what was sent.
#[test]
fn what_frames_confirm_is_what_was_sent() {
    let rng = &mut common::rng();
    for round in 0..common::size(300) {
        let stored = *rng.choice(&[Stored::Whole, Stored::Short]).unwrap();
        let mut bus = Vec::new();
        let mut wire: Vec<(u8, Sent)> = Vec::new();
        let mut room = *rng.choice(&[1, 2, 8]).unwrap();
        let few = room <= 2;
        while room > 0 {
            let count = rng.usize(1..=room);
            room -= count;
            let own: Vec<Sent> = (0..count).map(|_| any_channel(rng, stored, few)).collect();
            let first = bus.len() as u8;
            if count > 1 && rng.bool() {
                // One slave ID for all: in the order of the EDS, all of them before what is farther.
                bus.push(slave_with(&own, stored, 1, 0).known(first));
                let channels = own.into_iter().map(|sent| (first, sent));
                wire = channels.chain(wire).collect();
            } else {
                let through = rng.u8(..count as u8);
                for id in 0..count as u8 {
                    let slave = if id == through {
                        slave_with(&own, stored, count as u8, through)
                    } else {
                        Slave::default()
                    };
                    bus.push(slave.known(first + id));
                }
                for (id, sent) in (first..).zip(own) {
                    wire.insert(0, (id, sent));
                }
            }
        }
        let sent: Vec<&Sent> = wire.iter().map(|(_, sent)| sent).collect();
        let truth = format_of(&sent);
        let found = candidates(&bus);
        check(&found);
        let right = settled(&truth, &found, 40, rng);
        let right =
            right.unwrap_or_else(|| panic!("round {round}: {truth} not in {:#?}", texts(&found)));
        assert_eq!(right.format, truth, "round {round}: {:#?}", texts(&found));
        let ids: Vec<u8> = wire.iter().map(|(id, _)| *id).collect();
        assert_eq!(right.slaves, ids);
    }
}

/// What holds for every list of candidates.
fn check(found: &[Candidate]) {
    assert!(found.len() <= MAX_CANDIDATES);
    for (at, candidate) in found.iter().enumerate() {
        let text = candidate.format.to_string();
        assert_eq!(text.parse::<Format>().as_ref(), Ok(&candidate.format));
        assert_eq!(candidate.slaves.len(), candidate.format.channels().len());
        assert!(
            candidate.slaves.windows(2).all(|pair| pair[0] >= pair[1]),
            "the nearest slave comes first: {candidate:?}"
        );
        assert!(!candidate.reason.is_empty());
        let twin = found[..at].iter().find(|c| c.format == candidate.format);
        assert_eq!(twin, None, "twice in the list");
    }
}

#[test]
fn a_large_device_keeps_its_list_short_and_both_orders() {
    let sent: Vec<Sent> = (0..8)
        .map(|k| data(20 + k, false, Some((6, 0x59))))
        .collect();
    let found = candidates(&[slave_with(&sent, Stored::Whole, 1, 0).known(0)]);
    check(&found);
    assert_eq!(found.len(), MAX_CANDIDATES);
    let order: Vec<&Sent> = sent.iter().collect();
    let turned: Vec<&Sent> = sent.iter().rev().collect();
    for truth in [format_of(&order), format_of(&turned)] {
        let place = found.iter().position(|c| c.format == truth);
        assert!(place.is_some_and(|at| at < 8), "{truth} at {place:?}");
    }
    // Nine channels are more than a frame has.
    let bus: Vec<Known> = [slave_with(&sent, Stored::Whole, 1, 0).known(0)]
        .into_iter()
        .chain([Slave::default().with(0x42, &[0x62, 0x1E]).known(1)])
        .collect();
    assert_eq!(candidates(&bus), []);
    assert_eq!(unexplained(&bus), [0; 0]);
}

#[test]
fn what_is_not_written_is_not_believed() {
    for (bytes, why) in [
        (vec![0x00; 64], "all registers are 0"),
        (vec![0xFF; 64], "all registers are 0xFF: never written"),
        (vec![], "no register could be read"),
    ] {
        let window = Window::of(0, &bytes);
        let eds = Eds::decode(&window);
        assert_eq!(eds.distrust, Some(why));
        assert_eq!(ProfileEds::decode(&window).distrust, Some(why));
        let id = Slave::default().with(0x40, &[0, 2, 0x62, 0x1E]);
        let (known, reads) = id.bank(2, &bytes).read(0);
        assert_eq!(reads, 2, "nothing behind it is read");
        let found = candidates(&[known]);
        assert_eq!(found[0].format.to_string(), "st28,nE,nW,crc6", "by BP_ID");
    }
    let good = slave_with(&[encoder(12, 20, 6, 0x43)], Stored::Whole, 1, 0);
    for (address, byte, why) in [
        (0x01, 0x00, "EDS_LEN is no length"),
        (0x01, 0xFF, "EDS_LEN is no length"),
        (0x00, 0xFF, "EDS_VER is 0xFF: never written"),
        (0x10, 0, "DC_NUM is 0: no data channels"),
        (0x10, 9, "DC_NUM is more than 8"),
        (0x15, 0, "no channel has data bits"),
        (0x15, 65, "a channel has more than 64 data bits"),
    ] {
        let mut slave = good.clone();
        slave.banks.last_mut().unwrap().1[address] = byte;
        let (known, reads) = slave.read(0);
        assert_eq!(reads, 2, "the profile EDS it names is not read");
        let eds = known.eds.as_ref().unwrap();
        assert_eq!(eds.distrust, Some(why));
        let field = eds.fields.iter().find(|f| usize::from(f.offset) == address);
        assert!(field.unwrap().doubt.is_some(), "{why}: not marked");
        assert_eq!(candidates(std::slice::from_ref(&known)), []);
        assert_eq!(unexplained(&[known]), [0]);
    }
    for (bytes, why) in [
        ([0, 0, 63], "MTLEN leaves no position"),
        ([2, 0, 12], "ENTYP is neither rotary nor linear"),
    ] {
        let mut window = Window::of(0, &[0; 64]);
        (0x08..)
            .zip(bytes)
            .for_each(|(at, byte)| window.set(at, Cell::Byte(byte)));
        assert_eq!(ProfileEds::decode(&window).distrust, Some(why));
    }
    // Refused where it matters, and where it does not.
    let bytes = good.banks.last().unwrap().1.clone();
    for (address, why) in [
        (0x10, Some("DC_NUM could not be read")),
        (0x15, Some("a channel's registers could not be read")),
        (0x17, Some("a channel's registers could not be read")),
        (0x04, None),
        (0x19, None),
    ] {
        let mut window = Window::of(0, &bytes);
        window.set(address, Cell::Refused);
        let eds = Eds::decode(&window);
        assert_eq!(eds.distrust, why, "{address:#x}");
        let field = eds.fields.iter().find(|f| f.offset == address).unwrap();
        assert_eq!((field.value, field.meaning.as_str()), (None, "refused"));
        assert_eq!(field.hex(), "--");
    }
}

#[test]
fn ids_that_are_not_there() {
    let slave = Slave::default().with(0x42, &[0x62, 0x1E]);
    assert_eq!(candidates(&[]), []);
    assert_eq!(unexplained(&[]), [0; 0]);
    let gap = [slave.known(0), slave.known(3)];
    assert_eq!(candidates(&gap), []);
    assert_eq!(unexplained(&gap), [1, 2]);
    let twice = [slave.known(0), slave.known(0)];
    assert_eq!(candidates(&twice)[0].slaves, [0]);
    let dark = [slave.known(0), Slave::default().known(1)];
    assert_eq!(candidates(&dark), []);
    assert_eq!(unexplained(&dark), [1]);
    // A slave without data has no channel, and is no hole.
    let silent = Slave::default().with(0x42, &[0x00, 0x01]);
    let bus = [slave.known(0), silent.known(1)];
    assert_eq!(candidates(&bus)[0].slaves, [0]);
    assert_eq!(unexplained(&bus), [0; 0]);
}

fn noise(rng: &mut Rng, likely: &[u8]) -> Cell {
    match rng.u8(..16) {
        0 => Cell::Refused,
        1 => Cell::Unread,
        2..6 => Cell::Byte(rng.u8(..)),
        _ => Cell::Byte(*rng.choice(likely).unwrap()),
    }
}

/// Whatever the registers hold: no panic, no end to the reading that does not come, no format that is none.
#[test]
fn any_bytes() {
    let rng = &mut common::rng();
    let likely = [
        0, 1, 2, 3, 4, 8, 12, 16, 24, 32, 0x43, 0x21, 0x25, 0x62, 0x72, 0x10, 0xFF,
    ];
    let (mut some, mut trusted) = (0, 0);
    let rounds = common::size(2000);
    for _ in 0..rounds {
        let bus: Vec<Known> = (0..rng.u8(1..=4))
            .map(|id| {
                let mut known = Known::new(if rng.u8(..20) == 0 { rng.u8(..) } else { id });
                let mut reads = 0;
                while let Some(read) = known.wanted() {
                    let cells: Vec<Cell> = read
                        .addresses()
                        .map(|address| match (read.bank, address) {
                            (None, 0x42) => {
                                Cell::Byte(*rng.choice(&[0x62, 0x72, 0x10, 0]).unwrap())
                            }
                            (Some(_), 0x01) => Cell::Byte(64),
                            (Some(_), 0x10) if rng.bool() => Cell::Byte(rng.u8(1..=2)),
                            _ => noise(rng, &likely),
                        })
                        .collect();
                    let short = rng.usize(..=64).max(rng.usize(..=64)).max(60);
                    known.store(&read, &cells[..short.min(64)]);
                    reads += 1;
                    assert!(reads <= 10);
                }
                known
            })
            .collect();
        let found = candidates(&bus);
        check(&found);
        let dark = unexplained(&bus);
        assert!(found.is_empty() || dark.is_empty());
        some += usize::from(!found.is_empty());
        trusted += bus.iter().filter(|k| k.trusted_eds().is_some()).count();
        for known in &bus {
            assert!(known.limits().len() >= 3);
            for field in &known.device.fields {
                assert!(!field.meaning.is_empty(), "{field:?}");
            }
        }
    }
    println!("{some} with candidates, {trusted} EDS trusted");
    assert!(
        some > rounds / 8 && trusted > rounds / 20,
        "{some} {trusted}"
    );
}

#[test]
fn random_bytes_alone() {
    let rng = &mut common::rng();
    for _ in 0..common::size(3000) {
        let bytes: Vec<u8> = (0..64).map(|_| rng.u8(..)).collect();
        let device = Device::decode(rng.u8(..), &Direct::of(0x40, &bytes));
        assert_eq!(device.fields.len(), 7);
        let eds = Eds::decode(&Window::of(0, &bytes));
        assert!(eds.channels.len() <= 8);
        let believable = usize::from(bytes[0x10]) <= 8;
        assert!(eds.distrust.is_some() || believable);
        ProfileEds::decode(&Window::of(0, &bytes));
        for poly in readings(bytes[0]) {
            let bits = poly.ilog2() as u8;
            assert!(Crc::new(bits, poly, 0, true).is_ok(), "{poly:#x}");
        }
        let wide = u32::from_be_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
        for (poly, _) in wide_readings(wide >> rng.u8(..32)) {
            let bits = poly.ilog2() as u8;
            assert!((1..=16).contains(&bits), "{poly:#x}");
        }
    }
}
