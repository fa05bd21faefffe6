//! Safety pairs: one position sent twice in a frame, as control position word (CPW) and as safety position word (SPW),
//! and whether both say the same (BiSS Safety Concept A5, p. 3-4).
//!
//! Each word is from a sensor of its own, and the SPW is usually the coarser one. So they are compared from the top, down
//! to the bits that are sure to be accurate, ACCmin, and may differ there by one.

use crate::cycle::{Cycle, Fault};
use crate::format::{Channel, Field, Format, Kind};

/// What a channel is in a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Role {
    /// A position with nE or nW and a CRC.
    Control,
    /// A position with a sign of life and a CRC of 16 bits.
    Safety,
}

fn role(channel: &Channel) -> Option<Role> {
    channel.position()?;
    let life = channel.find(|kind| *kind == Kind::Life).is_some();
    match (life, channel.crc_bits()) {
        (true, 16) => Some(Role::Safety),
        (false, 1..) if channel.has_null() => Some(Role::Control),
        _ => None,
    }
}

/// Compares the words of every safety pair, and makes both a fault where they do not agree: nobody knows which is right.
///
/// A pair is a CPW and an SPW beside each other, either one first, both with `st` or both with `pos`; from the start of
/// the frame on, each channel is in one pair at most. Where a word is bad, or its encoder says so by the error bit, there
/// is nothing to compare with.
pub fn compare(format: &Format, cycle: &mut Cycle) {
    let channels = format.channels();
    let mut at = 0;
    while let Some([first, second]) = channels.get(at..at + 2) {
        let Some(pair) = Pair::of(first, second) else {
            at += 1;
            continue;
        };
        if let Some([one, other]) = cycle.words_mut().get_mut(at..at + 2) {
            let fault = one
                .good()
                .zip(other.good())
                .and_then(|(one, other)| pair.differ(one, other));
            if let Some(fault) = fault {
                one.spoil(fault);
                other.spoil(fault);
            }
        }
        at += 2;
    }
}

/// Two channels that show one position.
struct Pair<'a> {
    cpw: Place<'a>,
    spw: Place<'a>,
    spw_first: bool,
}

struct Place<'a> {
    channel: &'a Channel,
    turn: Option<&'a Field>,
    position: &'a Field,
}

impl<'a> Pair<'a> {
    fn of(first: &'a Channel, second: &'a Channel) -> Option<Pair<'a>> {
        let spw_first = match (role(first)?, role(second)?) {
            (Role::Control, Role::Safety) => false,
            (Role::Safety, Role::Control) => true,
            _ => return None,
        };
        let (cpw, spw) = if spw_first {
            (second, first)
        } else {
            (first, second)
        };
        let (cpw, spw) = (Place::of(cpw)?, Place::of(spw)?);
        let alike = cpw.position.kind() == spw.position.kind();
        alike.then_some(Pair {
            cpw,
            spw,
            spw_first,
        })
    }

    /// The fault, if the words in wire order are two positions.
    fn differ(&self, first: u64, second: u64) -> Option<Fault> {
        let (cpw, spw) = if self.spw_first {
            (second, first)
        } else {
            (first, second)
        };
        if self.cpw.says_error(cpw) || self.spw.says_error(spw) {
            return None;
        }
        let acc_bits = acc_bits(self.cpw.position.bits(), self.spw.position.bits());
        let (cpw_turns, spw_turns) = (self.cpw.turn_bits(), self.spw.turn_bits());
        let turn_bits = cpw_turns.min(spw_turns);
        let cpw = self.cpw.steps(cpw, turn_bits, acc_bits);
        let spw = self.spw.steps(spw, turn_bits, acc_bits);
        // An angle comes round, and so does a number that has lost its upper end; a length does not.
        let round = *self.cpw.position.kind() == Kind::SingleTurn || cpw_turns != spw_turns;
        let most = low(turn_bits + acc_bits);
        let apart = cpw.abs_diff(spw);
        let agree = apart <= 1 || round && apart == most;
        (!agree).then_some(Fault::Pair { cpw, spw, acc_bits })
    }
}

impl<'a> Place<'a> {
    fn of(channel: &'a Channel) -> Option<Place<'a>> {
        Some(Place {
            channel,
            turn: channel.find(|kind| *kind == Kind::Turn),
            position: channel.position()?,
        })
    }

    fn turn_bits(&self) -> u8 {
        self.turn.map_or(0, Field::bits)
    }

    fn says_error(&self, data: u64) -> bool {
        self.channel.error(data) == Some(true)
    }

    /// The position down to ACCmin, with the lowest turn bits above it: one number, so that the border of a turn is none.
    fn steps(&self, data: u64, turn_bits: u8, acc_bits: u8) -> u64 {
        let position = self.position.get(data) >> (self.position.bits() - acc_bits);
        let turn = self.turn.map_or(0, |turn| turn.get(data)) & low(turn_bits);
        turn.checked_shl(acc_bits.into()).unwrap_or(0) | position
    }
}

fn low(bits: u8) -> u64 {
    match bits {
        0 => 0,
        bits => u64::MAX >> (64 - u32::from(bits.min(64))),
    }
}

/// ACCmin: how many bits of the position must be accurate.
///
/// Of each pair of widths in table 1 of the BiSS Safety Concept (A5, p. 4) it is three bits less than the coarser word has
/// where that is the SPW (16/12: 9, 24/16: 13), and five less where both are as wide (16/16: 11); other widths are taken
/// likewise. Wider positions without turns do too, as the table adds turns and position of a linear encoder up.
fn acc_bits(cpw_bits: u8, spw_bits: u8) -> u8 {
    let spare = if cpw_bits == spw_bits { 5 } else { 3 };
    cpw_bits.min(spw_bits).saturating_sub(spare).max(1)
}
