//! Cycles of an encoder that nobody has described.

use crate::cycle::Cycle;
use crate::format::{Format, MAX_CHANNELS};
use crate::frame::BissC;
use crate::protocol::{Ability, Protocol};
use crate::trace::{Clocks, Trace};
use std::cell::Cell;

/// Bits of the longest channel.
const CHANNEL: usize = 80;

/// The head of each frame is decoded, and enough is clocked behind it to see where it ends.
#[derive(Debug)]
pub struct Listen {
    head: BissC,
    /// With 1, 2, 3 … of the longest channels.
    rooms: Vec<BissC>,
    chosen: Cell<usize>,
}

impl Listen {
    /// With room for the longest frame there is.
    pub fn new(limits: BissC) -> Listen {
        let mut rooms: Vec<BissC> = Vec::new();
        let mut text = String::new();
        for _ in 0..MAX_CHANNELS {
            text.push_str("data64,crc16");
            rooms.extend(text.parse().ok().map(|format| BissC {
                format,
                head_only: false,
                ..limits.clone()
            }));
            text.push('+');
        }
        Listen {
            head: BissC {
                head_only: true,
                ..limits
            },
            chosen: Cell::new(rooms.len() - 1),
            rooms,
        }
    }

    /// From now on clocks as many bits, and one more channel, so that nothing comes behind unseen.
    pub fn expect(&self, bits: usize) {
        let channels = bits.div_ceil(CHANNEL);
        self.chosen.set(channels.min(self.rooms.len() - 1));
    }
}

impl Protocol for Listen {
    fn format(&self) -> &Format {
        self.head.format()
    }
    fn request(&self, ability: &Ability) -> Clocks {
        self.rooms[self.chosen.get()].request(ability)
    }
    fn init(&self) -> Option<Clocks> {
        self.head.init()
    }
    fn decode(&self, trace: &Trace, cycle: &mut Cycle) {
        self.head.decode(trace, cycle);
    }
}
