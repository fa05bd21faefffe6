//! The second trait beside [`crate::link::Link`]: a request becomes a cycle, a trace becomes words.
//!
//! BiSS-C ([`crate::frame::BissC`]) is the first to implement it; links and commands know only this.

use crate::cycle::Cycle;
use crate::format::Format;
use crate::trace::{Clocks, Trace};

/// What the link can do and what has been learned about the encoder, as far as it shapes the next cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ability {
    /// The link sees SL while it clocks, so the number of clocks can depend on it.
    pub reacts: bool,
    /// MA period.
    pub period_ns: u32,
    /// Most clocks from edge 2 to the start edge seen so far.
    pub head: Option<u16>,
    /// Most whole clocks of line delay seen so far.
    pub delay_clk: Option<u16>,
    /// How often a frame did not fit into the clocks planned for it: each doubles the room.
    pub widen: u8,
}

/// A protocol on MA and SLO.
pub trait Protocol {
    /// The fields of the words it decodes.
    fn format(&self) -> &Format;
    /// The cycle to run next.
    fn request(&self, ability: &Ability) -> Clocks;
    /// What wakes a slave whose SL stays 0; `None` where the protocol has nothing of the kind.
    fn init(&self) -> Option<Clocks> {
        None
    }
    /// A cycle that carries CDM and nothing else; `None` where the protocol has nothing of the kind.
    fn reduced(&self, _ability: &Ability) -> Option<Clocks> {
        None
    }
    /// Whether the slave has taken CDM from such a cycle: else it is a fault.
    fn decode_reduced(&self, _trace: &Trace, cycle: &mut Cycle) {
        cycle.reset();
    }
    /// Whatever the wire said, as words or named faults. Never panics.
    fn decode(&self, trace: &Trace, cycle: &mut Cycle);
}
