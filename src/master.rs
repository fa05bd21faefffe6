//! The master: opens a link gently, runs one frame a slot, recovers, repeats where that can help, and lets no
//! position through that has not passed every check there is.
//!
//! It knows no clock but the link's.

use crate::control::{Access, Control, Outcome, Seen};
use crate::cycle::{Cycle, Fault};
use crate::format::Format;
use crate::limits::REST_NS;
use crate::link::{Error, Link, Phase};
use crate::protocol::{Ability, Protocol};
use crate::trace::{Ask, Cut, Trace};
use crate::track::{Tracker, Verdict};
use crate::unit::Hertz;

/// Frames spent on learning where the start bit stands, and on a frame whose start bit stands elsewhere.
const LEARNING_FRAMES: u32 = 8;

/// Frames for each phase and clock when looking for the better sampling phase.
const PHASE_FRAMES: u32 = 4;

/// Retries of a stalled frame when the user has not said how many: the wire was fine, the machine was not.
const STALL_RETRIES: u32 = 3;

/// Line delay as seen from one sampling phase.
enum Delay {
    /// So many whole clocks, in every frame.
    Clocks(u16),
    /// Frames differ, or are bad: SL changes about where it is sampled.
    Wavering,
    /// No encoder answers.
    Unknown,
}

/// Where [`Link::set_phase`] can put the sample, on links with all four places.
const PHASES: [Phase; 4] = [
    Phase::Quarter,
    Phase::Half,
    Phase::ThreeQuarters,
    Phase::Whole,
];

/// Where in a clock SL changes, as seen from all four places.
struct Changes {
    /// Whole clocks of line delay seen a quarter, a half, three quarters and a whole clock after the edge, `None` where
    /// frames did not agree.
    delays: [Option<u16>; 4],
    /// In eighths of a clock, where the places stand at 2, 4, 6 and 8: at those that waver, else between two that differ.
    eighths: Vec<usize>,
}

impl Changes {
    fn seen(delays: [Option<u16>; 4]) -> Changes {
        let next = |index: usize| match index {
            3 => delays[0].and_then(|clocks| clocks.checked_sub(1)),
            _ => delays[index + 1],
        };
        let wavers = (0..4)
            .filter(|index| delays[*index].is_none())
            .map(|index| 2 * index + 2);
        let steps = (0..4)
            .filter(|index| delays[*index] != next(*index))
            .map(|index| 2 * index + 3);
        let eighths = if delays.contains(&None) {
            wavers.collect()
        } else {
            steps.collect()
        };
        Changes { delays, eighths }
    }

    /// Eighths of a clock to the next change after this place, and from the last one before it.
    fn rooms(&self, index: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
        let place = 2 * index + 2;
        let rooms = move |change: &usize| ((change + 8 - place) % 8, (place + 8 - change) % 8);
        self.eighths.iter().map(rooms)
    }

    /// The steady place farthest from where SL changes.
    fn farthest(&self) -> Option<Phase> {
        // Room to the next change counts a little more: a pause samples late, nothing samples early.
        let distance = |index: &usize| {
            let room = self.rooms(*index);
            room.map(|(after, before)| (after.min(before), after))
                .min()
                .unwrap_or((8, 8))
        };
        let steady = (0..4).filter(|index| self.delays[*index].is_some());
        steady.max_by_key(distance).map(|index| PHASES[index])
    }

    /// How far SL's changes keep from this place at least, in eighths of a clock.
    fn margin(&self, phase: Phase) -> u8 {
        let index = phase as usize - 1;
        // Nothing comes before its edge: what takes less than a clock cannot come too early.
        let within = self.delays[index] == Some(0);
        let room = self.rooms(index).map(|(after, before)| match within {
            true => before,
            false => before.min(after),
        });
        // A change between two places may be at either of them.
        room.min()
            .map_or(8, |eighths| eighths.saturating_sub(1) as u8)
    }
}

/// What a slot came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Slot {
    /// A cycle was run, so many times.
    Done {
        /// 1, and one more for each repetition.
        tries: u32,
    },
    /// A piece of a cycle, cut by the recording's beginning or end: no frame, and no fault of the wire.
    Piece(Cut),
    /// The recording is over.
    Ended,
}

/// What a cycle was run for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// A frame, which may be repeated.
    Frame,
    /// A piece of one, as [`Slot::Piece`].
    Piece,
    /// To learn about the encoder, at clocks and sampling phases that may be wrong.
    Learning,
    /// To initialise the slaves: nobody looks at SL.
    Init,
}

/// A cycle that was run, whatever becomes of it.
#[derive(Clone, Copy, Debug)]
pub struct Try<'t> {
    /// Why.
    pub role: Role,
    /// What was seen of it.
    pub trace: &'t Trace,
    /// What it came to; nothing for INIT.
    pub cycle: &'t Cycle,
    /// Why nothing in it counts although nothing in it is wrong.
    pub doubt: Option<Fault>,
}

/// Runs frames of a protocol over a link.
pub struct Master<'a> {
    link: &'a mut dyn Link,
    protocol: &'a dyn Protocol,
    /// Repetitions of any fault; `None` repeats stalled frames only.
    retries: Option<u32>,
    tracker: Tracker,
    control: Control,
    /// What the last cycle means to control communication, until it has been judged.
    seen: Option<Seen>,
    trace: Trace,
    cycle: Cycle,
    widen: u8,
    /// The line needs its rest, and a look, before the next cycle.
    unsettled: bool,
    faults_in_row: u32,
    /// Look for a better phase after so many faults in a row.
    patience: u32,
    phase: Phase,
    /// Says that it is time to end, before a frame is repeated or run for learning.
    stop: Option<&'a dyn Fn() -> bool>,
    /// Looks at every try.
    witness: Option<&'a dyn Fn(&Try)>,
    /// The clock to come back to after looking at another.
    asked: Hertz,
    /// From start to start at least, and when the last frame started.
    distance_ns: u64,
    began_ns: Option<u64>,
}

impl<'a> Master<'a> {
    /// A master that has not touched the line yet.
    pub fn new(
        link: &'a mut dyn Link,
        protocol: &'a dyn Protocol,
        retries: Option<u32>,
    ) -> Master<'a> {
        let tracker = if link.caps().live {
            Tracker::default()
        } else {
            Tracker::trusting()
        };
        Master {
            control: Control::new(!link.caps().reacts),
            seen: None,
            asked: link.clock().hz,
            link,
            protocol,
            retries,
            tracker,
            trace: Trace::default(),
            cycle: Cycle::default(),
            widen: 0,
            unsettled: true,
            faults_in_row: 0,
            patience: 3,
            phase: Phase::Whole,
            stop: None,
            witness: None,
            distance_ns: 0,
            began_ns: None,
        }
    }

    /// From the next cycle on [`Trace::wave`] holds both wires, change by change.
    pub fn keep_waveform(&mut self) {
        self.trace.wave = Some(Box::default());
    }

    /// Starts no frame earlier than so long after the one before, whoever asks for it.
    pub fn keep_distance(&mut self, ns: u64) {
        self.distance_ns = ns;
    }

    /// Repeats no frame any more once `stop` says so, and learns nothing: at a slow clock that takes a minute.
    pub fn stop_when(&mut self, stop: &'a dyn Fn() -> bool) {
        self.stop = Some(stop);
    }

    /// Shows `witness` every cycle that is run from now on: those that are repeated and those that learn about the encoder,
    /// too. A slave that does not get ready for a frame is told of as a frame without edges.
    pub fn show_tries(&mut self, witness: &'a dyn Fn(&Try)) {
        self.witness = Some(witness);
    }

    fn show(&self, role: Role, doubt: Option<Fault>) {
        if let Some(witness) = self.witness {
            witness(&Try {
                role,
                trace: &self.trace,
                cycle: &self.cycle,
                doubt,
            });
        }
    }

    /// Whether it is time to end.
    pub fn stops(&self) -> bool {
        self.stop.is_some_and(|stop| stop())
    }

    /// How many control frames without progress an access repeats.
    pub fn set_access_retries(&mut self, retries: u32) {
        self.control.set_retries(retries);
    }

    /// Begins an access to registers, or a command: it goes on with every slot, beside the sensor data.
    ///
    /// # Errors
    /// When the link cannot carry it.
    pub fn ask(&mut self, access: Access) -> Result<(), Error> {
        let doing = "talking to the slave's registers";
        if !self.link.caps().cdm {
            let said = "this link cannot hold MA low after a frame, which is how CDM = 1 is sent";
            let hint = "take a link that moves MA as a level: two lines, or MA on the data output";
            return Err(Error::new(doing, said, hint));
        }
        self.tell();
        self.control
            .ask(access)
            .map_err(|said| Error::new(doing, said, "look at the addresses and slave IDs"))
    }

    /// How the access ended, once.
    pub fn outcome(&mut self) -> Option<Outcome> {
        self.tell();
        self.control.take()
    }

    /// Gives the access up. Slots must go on until [`Master::rests`].
    pub fn give_up(&mut self) {
        self.tell();
        self.control.give_up();
    }

    /// Whether no slave waits for the rest of an access.
    pub fn rests(&mut self) -> bool {
        self.tell();
        self.control.rests()
    }

    /// Tells control communication of the last cycle.
    fn tell(&mut self) {
        if let Some(seen) = self.seen.take() {
            self.control.seen(self.trace.t_ns, seen);
        }
    }

    /// The link.
    pub fn link(&self) -> &dyn Link {
        self.link
    }

    /// The fields of the frames.
    pub fn format(&self) -> &Format {
        self.protocol.format()
    }

    /// The cycle of the last slot.
    pub fn cycle(&self) -> &Cycle {
        &self.cycle
    }

    /// What was seen of it.
    pub fn trace(&self) -> &Trace {
        &self.trace
    }

    /// Where in a bit SL is sampled, on links that have a choice.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Least and most clocks from edge 2 to the start bit, once the encoder has shown them.
    pub fn learned(&self) -> Option<(u16, u16)> {
        self.tracker.heads()
    }

    /// Rests MA, initialises a slave that is not ready, finds the sampling phase and learns where the start bit
    /// stands. Whether an encoder has answered well: an absent one is no error here, it is a fault of every slot.
    ///
    /// # Errors
    /// When the link fails.
    pub fn open(&mut self) -> Result<bool, Error> {
        if !self.link.caps().live {
            return Ok(true);
        }
        let caps = self.link.caps();
        if caps.times_levels {
            // The clock is measured on frames.
            self.learn()?;
        }
        if caps.times_levels || caps.phases.is_empty() {
            self.link.measure_clock()?;
            // The slave has counted those frames, if there were any.
            self.tracker.lose_count();
        }
        self.choose_phase()?;
        self.learn()?;
        Ok(self.learned().is_some()
            || self.cycle.is_good() && self.protocol.format().channels().is_empty())
    }

    /// Brings the slaves to where nothing was before: MA rests, then INIT, then MA rests again (D2, p. 12 and 26).
    ///
    /// # Errors
    /// When the link fails.
    pub fn reset_bus(&mut self) -> Result<(), Error> {
        let ready_ns = self.protocol.request(&self.ability()).ready_ns;
        let rest = ready_ns.map_or(REST_NS, u64::from).max(REST_NS);
        self.link.idle(rest)?;
        self.initialise()?;
        self.link.idle(rest).map(drop)
    }

    fn initialise(&mut self) -> Result<(), Error> {
        let Some(clocks) = self.protocol.init() else {
            return Ok(());
        };
        self.tell();
        let init = Ask { at_ns: 0, clocks };
        self.link
            .cycles(&[init], std::slice::from_mut(&mut self.trace))?;
        self.cycle.reset();
        self.show(Role::Init, None);
        self.seen = Some(Seen::Cut { cdm: None });
        // The slave has counted that frame.
        self.tracker.lose_count();
        Ok(())
    }

    /// Waits without clocking, for an encoder to appear.
    ///
    /// # Errors
    /// When the link fails.
    pub fn pause(&mut self, ns: u64) -> Result<(), Error> {
        self.link.idle(ns).map(drop)
    }

    fn learn(&mut self) -> Result<(), Error> {
        for _ in 0..LEARNING_FRAMES {
            if self.learned().is_some() {
                // From here on the clocks are planned by what is known.
                self.widen = 0;
                break;
            }
            if self.stops() {
                break;
            }
            self.attempt(0)?;
            let doubt = self.judge();
            self.show(Role::Learning, doubt);
            if let Some(fault) = self.fault() {
                self.more_room(fault);
            }
        }
        Ok(())
    }

    /// Runs one frame at `at_ns`, repeated while that can help and, where `end_ns` says so, the slot has room.
    ///
    /// # Errors
    /// When the link fails.
    pub fn slot(&mut self, at_ns: u64, end_ns: Option<u64>) -> Result<Slot, Error> {
        let live = self.link.caps().live;
        let (mut tries, mut retried, mut reread) = (0, 0, 0);
        loop {
            let began = self.link.now_ns().max(at_ns);
            if !self.attempt(at_ns)? {
                return Ok(Slot::Ended);
            }
            if let Some(cut) = self.piece() {
                self.tracker.lose_count();
                self.show(Role::Piece, None);
                return Ok(Slot::Piece(cut));
            }
            tries += 1;
            let doubt = self.judge();
            self.show(Role::Frame, doubt);
            let fault = self.fault();
            let again = if doubt.is_some() {
                reread += 1;
                reread < LEARNING_FRAMES
            } else if fault.is_some_and(|fault| self.more_room(fault)) {
                true
            } else {
                let again = fault.is_some_and(|fault| retried < self.retries_for(fault));
                retried += u32::from(again);
                again
            };
            let now = self.link.now_ns();
            let room = end_ns.is_none_or(|end| now + now.saturating_sub(began) + REST_NS <= end);
            if !(live && again && room) || self.stops() {
                if let Some(fault) = doubt {
                    self.cycle.spoil(fault);
                }
                break;
            }
        }
        self.tell();
        self.count_faults()?;
        Ok(Slot::Done { tries })
    }

    /// Whether this is no whole cycle, or may be the rest of one.
    fn piece(&self) -> Option<Cut> {
        match self.cycle.fault() {
            Some(Fault::Short { .. }) => self.trace.cut,
            None => self.trace.unconfirmed.then_some(Cut::Begin),
            Some(_) => None,
        }
    }

    fn retries_for(&self, fault: Fault) -> u32 {
        let stalled = matches!(fault, Fault::Stalled { .. });
        self.retries
            .unwrap_or(if stalled { STALL_RETRIES } else { 0 })
    }

    /// The fault of the cycle, or of its first bad word.
    fn fault(&self) -> Option<Fault> {
        let word = || self.cycle.words().iter().find_map(|word| word.fault());
        self.cycle.fault().or_else(word)
    }

    fn ability(&self) -> Ability {
        let caps = self.link.caps();
        Ability {
            reacts: caps.reacts,
            period_ns: u32::try_from(self.link.clock().hz.period_ns()).unwrap_or(u32::MAX),
            head: self.tracker.heads().map(|(_, most)| most),
            delay_clk: self.tracker.delay_clk(),
            widen: self.widen,
        }
    }

    /// Runs and decodes one cycle. False at the end of a recording.
    fn attempt(&mut self, at_ns: u64) -> Result<bool, Error> {
        let caps = self.link.caps();
        if caps.live && self.unsettled && !self.settle(at_ns)? {
            return Ok(true);
        }
        self.tell();
        let ability = self.ability();
        let reduced = self
            .protocol
            .reduced(&ability)
            .filter(|_| self.control.reduced());
        let mut clocks = reduced.unwrap_or_else(|| self.protocol.request(&ability));
        clocks.cdm = self.control.cdm();
        let free_ns = self.began_ns.map_or(0, |began| began + self.distance_ns);
        let at_ns = at_ns.max(free_ns);
        let ran = self.link.cycles(
            &[Ask { at_ns, clocks }],
            std::slice::from_mut(&mut self.trace),
        )?;
        self.began_ns = Some(self.trace.t_ns).filter(|_| caps.live);
        match reduced {
            Some(_) => self.protocol.decode_reduced(&self.trace, &mut self.cycle),
            None => self.protocol.decode(&self.trace, &mut self.cycle),
        }
        self.seen = caps
            .live
            .then(|| self.control_saw(clocks.cdm, reduced.is_some()));
        self.unsettled = !self.cycle.is_good();
        Ok(ran == 1)
    }

    /// What the cycle means to control communication. A channel with a wrong CRC is a whole frame: CDS and what it
    /// carries have checks of their own.
    fn control_saw(&self, cdm: [bool; 2], reduced: bool) -> Seen {
        let sent = |cds: bool| self.trace.cdm.unwrap_or(cdm[usize::from(cds)]);
        match (self.cycle.fault(), self.cycle.head()) {
            (None, _) if reduced => Seen::Reduced { cdm: sent(false) },
            (None, Some(head)) => Seen::Whole {
                cds: head.cds,
                cdm: sent(head.cds),
            },
            _ => Seen::Cut {
                cdm: self.trace.cdm.filter(|_| !self.trace.bits.is_empty()),
            },
        }
    }

    fn judge(&mut self) -> Option<Fault> {
        let verdict = self
            .tracker
            .judge(self.protocol.format(), &self.trace, &mut self.cycle);
        self.unsettled |= !self.cycle.is_good();
        match verdict {
            Verdict::Stands => None,
            Verdict::Doubtful(fault) if self.is_vouched_for(fault) => None,
            Verdict::Doubtful(fault) => {
                self.unsettled = true;
                // Where the start bit is in doubt, so is CDS.
                self.seen = Some(Seen::Cut {
                    cdm: self.trace.cdm,
                });
                Some(fault)
            }
        }
    }

    /// Whether what a recording has behind a cycle shows that its start bit stands where it may.
    fn is_vouched_for(&mut self, fault: Fault) -> bool {
        if self.link.caps().live || !matches!(fault, Fault::Mismatch { .. }) {
            return false;
        }
        let (mut trace, mut cycle) = (Trace::default(), Cycle::default());
        for index in 0..u8::MAX {
            if !self.link.ahead(index.into(), &mut trace) {
                return false;
            }
            self.protocol.decode(&trace, &mut cycle);
            if let Some(answer) = self.tracker.vouch(index + 1, &trace, &cycle) {
                return answer;
            }
        }
        false
    }

    /// The rest after a fault; where SL can be seen and stays 0, INIT, and only then is the slave not ready.
    fn settle(&mut self, at_ns: u64) -> Result<bool, Error> {
        let ready = self
            .protocol
            .request(&self.ability())
            .ready_ns
            .map_or(REST_NS, u64::from)
            .max(REST_NS);
        // The look belongs to the slot, not to the end of the one before.
        let early = at_ns.saturating_sub(self.link.now_ns() + ready);
        if early > 0 {
            self.link.idle(early)?;
        }
        let began = self.link.now_ns();
        if self.link.idle(REST_NS)? != Some(false)
            || self.link.idle(ready - REST_NS)? != Some(false)
        {
            return Ok(true);
        }
        if self.protocol.init().is_none() {
            return Ok(true);
        }
        self.initialise()?;
        if self.link.idle(ready)? != Some(false) {
            return Ok(true);
        }
        self.trace.reset();
        self.trace.t_ns = self.link.now_ns();
        self.trace.idle = Some(false);
        self.trace.waited_ns = Some(self.trace.t_ns - began);
        self.protocol.decode(&self.trace, &mut self.cycle);
        Ok(false)
    }

    /// Whether the frame may only have been longer than the clocks planned for it; then there will be more.
    fn more_room(&mut self, fault: Fault) -> bool {
        let ability = self.ability();
        let cut = matches!(
            fault,
            Fault::Short { .. } | Fault::NoAck { .. } | Fault::NoStart { .. }
        );
        if !cut || ability.reacts || !self.link.caps().live {
            return false;
        }
        let wider = Ability {
            widen: self.widen + 1,
            ..ability
        };
        let grows = self.protocol.request(&wider).until != self.protocol.request(&ability).until;
        self.widen += u8::from(grows);
        grows
    }

    /// Three faults in a row may mean that the sampling phase is not right any more.
    fn count_faults(&mut self) -> Result<(), Error> {
        if self.fault().is_none() {
            // What is known of the encoder is enough again.
            self.widen = 0;
            self.faults_in_row = 0;
            self.patience = 3;
            return Ok(());
        }
        // A stall, a busy time that wanders, and a pair with good CRCs that differs say nothing about the phase.
        let of_phase = !matches!(
            self.fault(),
            Some(
                Fault::Stalled { .. }
                    | Fault::Mismatch { .. }
                    | Fault::Delay { .. }
                    | Fault::Pair { .. }
            )
        );
        self.faults_in_row += u32::from(of_phase);
        if self.faults_in_row >= self.patience && !self.link.caps().phases.is_empty() {
            self.faults_in_row = 0;
            // A dead line stays dead: look more and more rarely.
            self.patience = (self.patience * 2).min(1_000);
            let (trace, cycle) = (self.trace.clone(), self.cycle.clone());
            self.choose_phase()?;
            self.learn()?;
            (self.trace, self.cycle) = (trace, cycle);
        }
        Ok(())
    }

    /// Finds the place in a bit at which SL stands still.
    fn choose_phase(&mut self) -> Result<(), Error> {
        let caps = self.link.caps();
        match caps.phases {
            [] | [_] => return Ok(()),
            _ if caps.times_levels => self.centre()?,
            phases => self.steadier_of(phases)?,
        }
        self.tracker.forget();
        Ok(())
    }

    /// Looks where in a bit SL changes and samples as far from there as it can. Without enough good frames
    /// everything stays as it was.
    fn centre(&mut self) -> Result<(), Error> {
        let phase = self.calm_phase()?.unwrap_or(self.phase);
        self.phase = phase;
        self.link.set_phase(phase)
    }

    fn calm_phase(&mut self) -> Result<Option<Phase>, Error> {
        let mut delays = [None; PHASES.len()];
        for (index, phase) in PHASES.into_iter().enumerate().rev() {
            match self.delay_at(phase)? {
                Delay::Unknown => return Ok(None),
                Delay::Wavering => {}
                Delay::Clocks(clocks) => delays[index] = Some(clocks),
            }
            if delays[2..] == [Some(0); 2] {
                // SL changes less than three quarters after its edge, and never again before the next one.
                return Ok(Some(Phase::Whole));
            }
        }
        Ok(Changes::seen(delays).farthest())
    }

    /// How far SL's changes keep from where it is sampled, in eighths of a clock: so much earlier or later may a bit come
    /// and still be read. Runs some twenty frames to see it. None where the link has one place only, times no levels, or
    /// frames are bad wherever they are sampled.
    ///
    /// # Errors
    /// When the link fails.
    pub fn margin(&mut self) -> Result<Option<u8>, Error> {
        /// A single bad frame may be noise.
        const PATIENCE: usize = 3;
        let caps = self.link.caps();
        if !caps.live || !caps.times_levels || caps.phases.len() < PHASES.len() {
            return Ok(None);
        }
        let mut delays = [None; PHASES.len()];
        for (index, phase) in PHASES.into_iter().enumerate() {
            for _ in 0..PATIENCE {
                if let Delay::Clocks(clocks) = self.delay_at(phase)? {
                    delays[index] = Some(clocks);
                    break;
                }
            }
        }
        self.link.set_phase(self.phase)?;
        self.tracker.forget();
        self.learn()?;
        // Where even the place in use is not steady, it is not the place that frames differ for.
        let steady = delays[self.phase as usize - 1].is_some();
        Ok(steady.then(|| Changes::seen(delays).margin(self.phase)))
    }

    /// Whole clocks of line delay when sampling there, from a few good frames.
    fn delay_at(&mut self, phase: Phase) -> Result<Delay, Error> {
        self.link.set_phase(phase)?;
        self.tracker.forget();
        let (mut good, mut silent, mut found) = (0, 0, None::<u16>);
        // On a busy machine most frames are stalled.
        for _ in 0..16 * PHASE_FRAMES {
            if self.stops() {
                return Ok(Delay::Unknown);
            }
            self.attempt(0)?;
            self.show(Role::Learning, None);
            match self.fault() {
                // The machine's fault, not the phase's.
                Some(Fault::Stalled { .. }) => continue,
                // So may one frame without an answer be; two are the encoder's.
                Some(Fault::NotReady { .. } | Fault::NoAck { .. }) => {
                    silent += 1;
                    if silent == 2 {
                        return Ok(Delay::Unknown);
                    }
                    continue;
                }
                _ => {}
            }
            let delay = self
                .cycle
                .head()
                .filter(|_| self.cycle.is_good())
                .map(|head| head.delay_clk);
            match (delay, found) {
                (Some(delay), None) => found = Some(delay),
                (Some(delay), Some(before)) if delay == before => {}
                _ => return Ok(Delay::Wavering),
            }
            good += 1;
            if good == PHASE_FRAMES {
                return Ok(found.map_or(Delay::Unknown, Delay::Clocks));
            }
        }
        // Samples there come too late in the bit to be told from stalls.
        Ok(Delay::Wavering)
    }

    /// Reads a few frames in each phase, at the clock and just below, and keeps the steadier one.
    fn steadier_of(&mut self, phases: &[Phase]) -> Result<(), Error> {
        let near = Hertz(self.asked.0 - self.asked.0 / 16);
        let mut best = None;
        for phase in phases {
            self.link.set_phase(*phase)?;
            let mut steady = 0;
            for clock in [near, self.asked] {
                if self.link.set_clock(clock).is_err() && clock == near {
                    // Below what the controller can divide; a device that is gone says so at the next clock.
                    continue;
                }
                steady += self.steady_frames()?;
            }
            if best.is_none_or(|(most, _)| steady > most) {
                best = Some((steady, *phase));
            }
            if steady == 2 * PHASE_FRAMES {
                break;
            }
        }
        if let Some((_, phase)) = best {
            self.phase = phase;
            self.link.set_phase(phase)?;
            self.link.set_clock(self.asked)?;
            self.link.measure_clock()?;
        }
        Ok(())
    }

    /// How many of a few frames are good and have their start bit within a clock of each other.
    fn steady_frames(&mut self) -> Result<u32, Error> {
        self.tracker.forget();
        let (mut good, mut tries, mut heads) = (0, 0, None::<(u16, u16)>);
        while tries < PHASE_FRAMES && !self.stops() {
            self.attempt(0)?;
            self.show(Role::Learning, None);
            if self.fault().is_some_and(|fault| self.more_room(fault)) {
                continue;
            }
            tries += 1;
            if let (true, Some(head)) = (self.cycle.is_good(), self.cycle.head()) {
                let (low, high) = heads.unwrap_or((head.clocks(), head.clocks()));
                heads = Some((low.min(head.clocks()), high.max(head.clocks())));
                good += 1;
            }
        }
        let steady = heads.is_some_and(|(low, high)| high - low <= 1);
        Ok(if steady { good } else { good / 2 })
    }
}

impl std::fmt::Debug for Master<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Master")
            .field("learned", &self.learned())
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_phase_keeps_away_from_where_sl_changes() {
        use Phase::{Half, Quarter, ThreeQuarters, Whole};
        for (delays, phase) in [
            // SL changes in the first, second, third and last quarter.
            ([Some(1), Some(1), Some(1), Some(1)], Some(Half)),
            ([Some(2), Some(1), Some(1), Some(1)], Some(ThreeQuarters)),
            ([Some(2), Some(2), Some(1), Some(1)], Some(Whole)),
            ([Some(2), Some(2), Some(2), Some(1)], Some(Quarter)),
            // It changes where it was sampled, or over a wide range.
            ([None, Some(1), Some(1), Some(1)], Some(ThreeQuarters)),
            ([Some(2), None, Some(1), Some(1)], Some(Whole)),
            ([None, None, Some(1), Some(1)], Some(ThreeQuarters)),
            ([Some(1), Some(1), None, Some(0)], Some(Quarter)),
            ([Some(2), Some(2), None, None], Some(Quarter)),
            ([None, None, None, Some(3)], Some(Whole)),
            ([None; 4], None),
        ] {
            let found = Changes::seen(delays).farthest();
            assert_eq!(found, phase, "{delays:?}");
        }
    }

    #[test]
    fn the_margin_is_what_is_left_at_least() {
        for (delays, phase, eighths) in [
            // SL changes within an eighth or two of the first place, and never before its edge.
            ([Some(0); 4], Phase::Whole, 6),
            ([Some(0); 4], Phase::Half, 2),
            ([Some(1), Some(0), Some(0), Some(0)], Phase::Whole, 4),
            // A clock and more: it may come too early, too.
            ([Some(1); 4], Phase::Half, 2),
            ([Some(1); 4], Phase::Whole, 0),
            (
                [Some(2), Some(1), Some(1), Some(1)],
                Phase::ThreeQuarters,
                2,
            ),
            ([None, Some(1), Some(1), Some(1)], Phase::ThreeQuarters, 3),
            ([None, None, Some(1), Some(1)], Phase::ThreeQuarters, 1),
            ([None; 4], Phase::Whole, 0),
        ] {
            let margin = Changes::seen(delays).margin(phase);
            assert_eq!(margin, eighths, "{delays:?} {phase:?}");
        }
    }
}
