//! What stands in the registers when a slave is switched on.
//!
//! The places are D2's (p. 20-22); those within an EDS are known from NXP's driver (fsl_biss.h) only. What an EDS has no
//! way to say, or says in a unit nobody published, is 0.

use super::config::{Config, Device};
use super::registers::{Bank, DIRECT, Registers};
use crate::crc::Crc;
use crate::format::{Channel, Field, Format, Kind};

/// Where both images have their EDS.
const EDS_BANK: u8 = 2;
/// The profile of each channel of `device=own`, from here on.
const PROFILES: u8 = 0x10;
/// Of `device=own`, for whoever wants to keep something there.
const USER: [u8; 2] = [4, 5];

/// The registers of the slave at a place in the chain, which sends `channels`.
pub(super) fn build(config: &Config, place: usize, channels: &[Channel]) -> Registers {
    let mut registers = match config.device {
        Device::Own => own(config, place, channels),
        Device::Mhm => mhm(),
        Device::None => Registers::new(Vec::new(), Bank::absent()),
    };
    if let Some(addresses) = &config.read_only {
        registers.protect(addresses);
    }
    if let Some(addresses) = &config.refuse {
        registers.refuse(addresses);
    }
    registers
}

fn own(config: &Config, place: usize, channels: &[Channel]) -> Registers {
    let mut free = Bank::absent();
    free.put(0, &[0; 64]).open(0..=63);
    let mut banks = vec![(0, free.clone())];
    banks.extend(USER.map(|bank| (bank, free.clone())));
    // One clock from Ack to start is there anyway.
    let busy_clocks = u8::try_from(config.ack.saturating_sub(1)).unwrap_or(u8::MAX);
    banks.extend(eds(channels, USER, busy_clocks, PROFILES));
    let [profile_high, profile_low] = match channels {
        [one] => profile(one),
        _ => [0; 2],
    };
    let serial = (100_001 + place as u32).to_be_bytes();
    let mut direct = Bank::absent();
    direct
        .put(0x40, &[0, EDS_BANK, profile_high, profile_low])
        .put(0x44, &serial)
        .put(0x48, &[0; 0x18])
        .put(0x60, &[0; 0x10])
        .put(0x78, b"BISSIM")
        // Nobody's manufacturer ID.
        .put(0x7E, &[0; 2])
        .open(0x40..=0x40)
        .open(0x48..=0x5F);
    Registers::new(banks, direct)
}

/// The common EDS, and a bank for each channel that is an encoder's.
fn eds(channels: &[Channel], user: [u8; 2], busy_clocks: u8, profiles: u8) -> Vec<(u8, Bank)> {
    let mut common = [0; 64];
    // Version; length in banks; first and last user bank; shortest MA period in ns, 10 MHz (D2 Table 10).
    common[..5].copy_from_slice(&[1, 1, user[0], user[1], 100]);
    common[0x0D] = busy_clocks;
    // Channels; IDs of the device; which of them this is.
    common[0x10..0x13].copy_from_slice(&[channels.len() as u8, 1, 0]);
    if channels.is_empty() {
        // What has an ID and no channel is a bus coupler.
        common[0x34] = 0x10;
    }
    let mut banks = Vec::new();
    for ((number, channel), place) in (profiles..)
        .zip(channels)
        .zip(common[0x14..0x34].chunks_exact_mut(4))
    {
        let encoder = encoder(channel);
        let bank = encoder.as_ref().map_or(0, |_| number);
        // A sensor (bit 0), right-aligned (bit 1).
        place.copy_from_slice(&[bank, channel.data_bits(), 0, short_poly(channel)]);
        banks.extend(encoder.map(|bank| (number, bank)));
    }
    let mut bank = Bank::absent();
    bank.put(0, &common);
    banks.insert(0, (EDS_BANK, bank));
    banks
}

/// The CRC as every BiSS device sends it: the start value 0, inverted.
fn usual(crc: &Crc) -> bool {
    crc.inverted() && crc.init() == 0
}

/// The polynomial in 8 bits as iC-Haus writes it, without the constant term (iC-MB3, p. 15). 0 where that does not
/// say it all.
fn short_poly(channel: &Channel) -> u8 {
    let said = |crc: &&Crc| usual(crc) && crc.poly() & 1 == 1;
    let poly = channel.crc().filter(said).map_or(0, Crc::poly);
    u8::try_from(poly >> 1).unwrap_or(0)
}

/// The profile EDS of a channel that is an encoder's word.
fn encoder(channel: &Channel) -> Option<Bank> {
    let position = encoder_position(channel)?;
    let mut bytes = [0; 64];
    bytes[0x08] = u8::from(*position.kind() == Kind::Position);
    bytes[0x0A] = channel
        .find(|kind| *kind == Kind::Turn)
        .map_or(0, Field::bits);
    if *position.kind() == Kind::SingleTurn {
        let steps = 1u32.checked_shl(position.bits().into()).unwrap_or(0);
        bytes[0x14..0x18].copy_from_slice(&steps.to_be_bytes());
    }
    if let Some(crc) = channel.crc().filter(|crc| crc.inverted()) {
        bytes[0x1C..0x20].copy_from_slice(&crc.poly().to_be_bytes());
        bytes[0x20..0x24].copy_from_slice(&u32::from(crc.init()).to_be_bytes());
    }
    let mut bank = Bank::absent();
    bank.put(0, &bytes);
    Some(bank)
}

/// Turns if there are any, position, nE, nW, sign of life if there is one, in this order: the words of profiles BP3 and
/// BP3S.
fn encoder_position(channel: &Channel) -> Option<&Field> {
    let fields = channel.fields();
    let after_turn = match fields {
        [turn, rest @ ..] if *turn.kind() == Kind::Turn => rest,
        _ => fields,
    };
    let [position, error, warning, life @ ..] = after_turn else {
        return None;
    };
    let place = matches!(position.kind(), Kind::SingleTurn | Kind::Position);
    let flags = *error.kind() == Kind::Error { active_low: true }
        && *warning.kind() == Kind::Warning { active_low: true };
    let life = match life {
        [] => true,
        [life] => *life.kind() == Kind::Life && life.bits() == 6,
        _ => false,
    };
    (place && flags && life).then_some(position)
}

/// BP_ID of a slave with one channel; 0 where no profile says it.
fn profile(channel: &Channel) -> [u8; 2] {
    let check = channel.crc().filter(|crc| usual(crc));
    let life = channel.find(|kind| *kind == Kind::Life).is_some();
    let encoder = encoder_position(channel).is_some();
    let bits = channel.data_bits();
    match check.map(Crc::poly) {
        // The version is that of the iC-MHM.
        Some(0x43) if encoder && !life => [0x62, bits],
        Some(0x190D9) if encoder && life => [0x72, bits],
        // The universal profile, of a channel that is no encoder's.
        Some(0x25) if !encoder && bits < 32 => [bits, 0],
        _ => [0; 2],
    }
}

/// The 30 bits that an iC-MHM's BP_ID speaks of.
pub(super) fn mhm_format() -> Format {
    #[allow(clippy::unwrap_used)] // a constant of ours
    "mt12,st16,nE,nW,crc6".parse().unwrap()
}

/// What an iC-MHM showed to an iC-Haus master (AN22, "BiSS Reader Content"). It does not say what can be written: here
/// all but identification and status.
fn mhm() -> Registers {
    let mut bank = Bank::absent();
    let content = [
        0x48, 0x44, 0x00, 0x78, 0x80, 0x00, 0x00, 0x00, 0xCF, 0x80, 0x00, 0x00, 0x23, 0x00, 0x00,
        0x00, 0x00, 0x00, 0x00, 0x8C,
    ];
    bank.put(0, &content).open(0..=0x13);
    let mut direct = Bank::absent();
    let content = [
        0x00, EDS_BANK, 0x62, 0x1E, 0xFF, 0xFF, 0xFF, 0xFF, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
        0x8C, 0xFF,
    ];
    direct
        .put(DIRECT, &content)
        .put(0x50, &[0xFF; 0x20])
        .put(0x70, &[0x00, 0x01, 0x15, 0x15])
        .put(0x78, b"MHM#D\0iC")
        .open(0x40..=0x6F);
    // That dump names the bank of the EDS and shows none of it: the content is ours.
    let mut banks = vec![(0, bank)];
    banks.extend(eds(mhm_format().channels(), [0; 2], 0, EDS_BANK + 1));
    Registers::new(banks, direct)
}
