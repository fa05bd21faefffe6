//! Registers read beside the frames: each bit of the talk rides on one of them, so no frame is lost for it.

use super::session::can_send;
use crate::cli::{self, Span};
use crate::output::reg::{Bad, Register};
use anyhow::{Result, bail};
use biss::control::{Access, Failure, MAX_IDS, Outcome};
use biss::master::Master;
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// Registers that are read again and again.
#[derive(Debug)]
pub(super) struct Beside {
    slave: u8,
    wanted: Vec<Span>,
    /// What is left of this round, the first under way.
    left: VecDeque<Span>,
    rounds: u64,
    bad: bool,
    /// What a register gave when S had to be repeated for it, which takes a second reading that agrees, and how often no
    /// two agreed.
    doubtful: BTreeMap<u8, (u8, u32)>,
    /// Registers that have come, or cannot, since all of them last had.
    settled: BTreeSet<u8>,
}

impl Beside {
    /// What was asked for, if the link can carry it.
    pub(super) fn asked(args: &cli::Read) -> Result<Option<Beside>> {
        if args.registers.is_empty() {
            return Ok(None);
        }
        can_send(&args.wire.link)?;
        if args.fields.is_some() || args.format == cli::OutputFormat::Csv {
            bail!(
                "--registers adds records of another kind, which has no place in a table\n  take -o json or text, or `biss reg` beside it"
            );
        }
        debug_assert!(args.slave < MAX_IDS);
        Ok(Some(Beside {
            slave: args.slave,
            wanted: args.registers.clone(),
            left: VecDeque::new(),
            rounds: 0,
            bad: false,
            doubtful: BTreeMap::new(),
            settled: BTreeSet::new(),
        }))
    }

    /// Rounds that are complete.
    pub(super) fn rounds(&self) -> u64 {
        self.rounds
    }

    /// Whether a register could not be read.
    pub(super) fn is_bad(&self) -> bool {
        self.bad
    }

    /// Begins the next access.
    pub(super) fn go_on(&mut self, master: &mut Master<'_>) -> Result<()> {
        if self.left.is_empty() {
            self.left.extend(&self.wanted);
        }
        if let Some(span) = self.left.front() {
            master.ask(Access::Read {
                slave: self.slave,
                address: span.first,
                count: span.last - span.first + 1,
            })?;
        }
        Ok(())
    }

    /// What has come by now; then the next access begins.
    pub(super) fn look(&mut self, master: &mut Master<'_>) -> Result<Vec<Register>> {
        let Some(outcome) = master.outcome() else {
            return Ok(Vec::new());
        };
        let fault = master.cycle().fault();
        let records = self.take(&outcome, fault);
        self.go_on(master)?;
        Ok(records)
    }

    fn take(&mut self, outcome: &Outcome, fault: Option<biss::cycle::Fault>) -> Vec<Register> {
        let Some(span) = self.left.pop_front() else {
            return Vec::new();
        };
        let bytes = outcome.bytes.as_slice();
        let mut records = Vec::new();
        for (index, (address, byte)) in (span.first..).zip(bytes).enumerate() {
            let waited = outcome.waited >> index & 1 == 1;
            records.extend(self.believed(address, *byte, waited));
        }
        if let Some(failure) = outcome.failure {
            let address = span.first + bytes.len() as u8;
            let record = Register {
                bad: Some(Bad::new(failure, fault)),
                ..Register::untouched(self.slave, None, address)
            };
            self.bad = true;
            records.push(record);
            // One that is refused hides none of those behind it.
            if address < span.last {
                self.left.push_front(Span {
                    first: address + 1,
                    last: span.last,
                });
            }
        }
        self.settled
            .extend(records.iter().map(|record| record.address));
        let mut wanted = self.wanted.iter().flat_map(|span| span.addresses());
        if wanted.all(|address| self.settled.contains(&address)) {
            self.rounds += 1;
            self.settled.clear();
        }
        records
    }

    /// A register that has come, if it can be believed already, or not at all.
    fn believed(&mut self, address: u8, byte: u8, waited: bool) -> Option<Register> {
        /// As many as `biss reg` takes.
        const READINGS: u32 = 5;
        let register = Register::untouched(self.slave, None, address);
        let before = self.doubtful.remove(&address).filter(|_| waited);
        if !waited || before.is_some_and(|(before, _)| before == byte) {
            return Some(Register {
                value: Some(byte),
                ..register
            });
        }
        let readings = before.map_or(1, |(_, readings)| readings + 1);
        if let Some((first, _)) = before.filter(|_| readings >= READINGS) {
            self.bad = true;
            let unsteady = Failure::Unsteady {
                address,
                first,
                second: byte,
            };
            return Some(Register {
                bad: Some(Bad::new(unsteady, None)),
                ..register
            });
        }
        self.doubtful.insert(address, (byte, readings));
        None
    }
}
