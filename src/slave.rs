//! The simulated slave: an encoder, or a chain of them, as one state machine driven by MA edges and time.
//!
//! It stands in for hardware in `sim:` links, in the kernel lab and in every test. It shares no code with the
//! decoder: its bits and its CRC are made one at a time by a loop of their own, so that a wrong bit order in
//! either cannot pass. The same seed gives the same levels at the same times.
//!
//! Rules and numbers: BiSS C protocol description D2, p. 5-8, 12 and Table 10.

mod config;
mod control;
mod device;
mod image;
mod line;
mod random;
mod registers;
mod words;

pub use config::{Config, Device, KEYS, Motion, Rates, Slaves, Sli, Swapped, Timeout};

use crate::unit::Hertz;
use device::Device as Member;
use line::Line;
use random::Random;
use std::collections::VecDeque;

/// Static ceiling that stays active while an adaptive slave measures; 20 µs is what most parts use.
const ADAPTIVE_CEILING_NS: u64 = 20_000;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Waiting for a falling edge.
    Idle,
    /// A falling edge came: the next rising edge is number 1.
    Armed,
    /// In a frame; the number of rising edges so far.
    Frame(u32),
    /// The frame is over, SLO is low until the given time (timeouts that count from the request).
    Ending(u64),
}

/// What a slave did because the master told it to. Its `id` is its place in the chain, 0 the farthest from the master: the
/// ID it has while all before it take part in control communication.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// A register was read.
    Read {
        /// Which slave.
        id: usize,
        /// The bank in its window then.
        bank: u8,
        /// 0x00 to 0x7F.
        address: u8,
        /// What was sent.
        value: u8,
    },
    /// A register was written.
    Write {
        /// Which slave.
        id: usize,
        /// The bank in its window then.
        bank: u8,
        /// 0x00 to 0x7F.
        address: u8,
        /// What is in it now.
        value: u8,
    },
    /// A command was executed.
    Command {
        /// Which slave.
        id: usize,
        /// 0 to 3.
        command: u8,
        /// It went to all.
        broadcast: bool,
    },
}

/// The latest events, when somebody wants them.
#[derive(Clone, Debug, Default)]
struct Events {
    wanted: bool,
    log: VecDeque<Event>,
}

/// So many events are kept.
const MOST_EVENTS: usize = 1 << 16;

impl Events {
    fn add(&mut self, event: Event) {
        if !self.wanted {
            return;
        }
        if self.log.len() == MOST_EVENTS {
            self.log.pop_front();
        }
        self.log.push_back(event);
    }
}

/// The simulated encoder, or chain of encoders. Feed it MA edges in order of time and ask it for SLO.
///
/// All slaves of a chain have the same timeout, so they come to rest together.
#[derive(Clone, Debug)]
pub struct Slave {
    config: Config,
    random: Random,
    state: State,
    present: bool,
    powered_up: bool,
    ma: bool,
    mo: bool,
    /// Nothing happens by itself before then, if MA and MO stay as they are.
    due_ns: u64,
    last_edge_ns: u64,
    first_fall_ns: u64,
    adaptive_ns: Option<u64>,
    latch_ns: u64,
    last_rise_ns: u64,
    mute: bool,
    dead: bool,
    /// The chain from its far end.
    members: Vec<Member>,
    /// There is an SLI that moves.
    hears: bool,
    /// From the last SLO to the master.
    line: Line,
    latches: u64,
    life: u64,
    words: Vec<u64>,
    cdm: Option<bool>,
    timeouts: u64,
    events: Events,
}

impl Slave {
    /// A slave at rest: MA high, SLO high unless `power_up_low`. Slaves that do not share out the channels of the format
    /// ([`Config::chain`]) are one.
    pub fn new(config: Config) -> Slave {
        let level = config.stuck.unwrap_or(!config.power_up_low);
        let channels = config.format.channels().len();
        let counts = config.chain().unwrap_or_else(|_| vec![channels]);
        let mut members = Vec::with_capacity(counts.len());
        let mut end = channels;
        for (place, count) in counts.iter().rev().enumerate() {
            let slo = !config.power_up_low;
            members.push(Member::new(&config, place, end - count..end, slo));
            end -= count;
        }
        Slave {
            random: Random(config.seed),
            state: State::Idle,
            present: config.absent.0 == 0,
            powered_up: !config.power_up_low,
            ma: !config.swapped.ma,
            mo: true,
            due_ns: 0,
            last_edge_ns: 0,
            first_fall_ns: 0,
            adaptive_ns: None,
            latch_ns: 0,
            last_rise_ns: 0,
            mute: false,
            dead: false,
            hears: members.len() > 1 || config.sli == Sli::Mo,
            members,
            line: Line::new(level),
            latches: 0,
            life: 0,
            words: Vec::with_capacity(channels),
            cdm: None,
            timeouts: 0,
            events: Events::default(),
            config,
        }
    }

    /// How often a measurement was latched.
    pub fn latches(&self) -> u64 {
        self.latches
    }

    /// The data word of each channel, as latched last (before any bit flips).
    pub fn latched(&self) -> &[u64] {
        &self.words
    }

    /// The CDM bit sampled at the last timeout, by the slave nearest the master, once.
    pub fn take_cdm(&mut self) -> Option<bool> {
        self.cdm.take()
    }

    /// How many frames its timeout has ended.
    pub fn timeouts(&self) -> u64 {
        self.timeouts
    }

    /// How many slaves there are.
    pub fn devices(&self) -> usize {
        self.members.len()
    }

    /// What stands at an address of slave `id`, counted from 0, the farthest; below 0x40 in a bank. `None` where a read is
    /// refused.
    pub fn peek(&self, id: usize, bank: u8, address: u8) -> Option<u8> {
        self.members.get(id)?.peek(&self.config, bank, address)
    }

    /// Changes what stands at an address that [`Slave::peek`] sees, even where the master cannot; false elsewhere.
    pub fn poke(&mut self, id: usize, bank: u8, address: u8, value: u8) -> bool {
        self.members
            .get_mut(id)
            .is_some_and(|member| member.poke(&self.config, bank, address, value))
    }

    /// Keeps the latest events from now on, or no more.
    pub fn record_events(&mut self, wanted: bool) {
        self.events.wanted = wanted;
    }

    /// The events since [`Slave::take_events`], 65536 at most, the oldest first.
    pub fn events(&self) -> impl Iterator<Item = &Event> {
        self.events.log.iter()
    }

    /// The events so far, once.
    pub fn take_events(&mut self) -> Vec<Event> {
        self.events.log.drain(..).collect()
    }

    /// Whether the data channels of slave `id` are switched on.
    pub fn data_active(&self, id: usize) -> bool {
        self.members.get(id).is_some_and(Member::data_active)
    }

    /// Whether slave `id` takes part in control communication.
    pub fn control_active(&self, id: usize) -> bool {
        self.members.get(id).is_some_and(Member::control_active)
    }

    /// MA changes to `level` at `t_ns`. Times must not go backwards; a level that is there already is no edge.
    pub fn ma(&mut self, t_ns: u64, level: bool) {
        self.advance(t_ns);
        let level = level != self.config.swapped.ma;
        if level == self.ma {
            return;
        }
        self.ma = level;
        if !self.present || self.config.clock_max.is_some() && self.misses(t_ns, level) {
            return;
        }
        let rested_ns = t_ns - self.last_edge_ns;
        if level || !self.config.rising_only || self.state == State::Idle {
            self.last_edge_ns = t_ns;
        }
        match (self.state, level) {
            (State::Idle, false) if self.config.rests_high && rested_ns < self.rest_ns() => {}
            (State::Idle, false) => {
                self.state = State::Armed;
                self.first_fall_ns = t_ns;
                self.adaptive_ns = None;
                self.each_with_sli(Member::arm);
                self.due_by(self.expiry());
            }
            (State::Armed, true) => self.latch(t_ns),
            (State::Frame(edge), true) => self.rise(t_ns, edge + 1),
            // A lone slave on the ground has nothing to hear.
            (State::Frame(_), false) if self.hears => self.each_with_sli(Member::fall),
            _ => {}
        }
    }

    /// Whether it is too slow for this edge.
    #[cold]
    fn misses(&mut self, t_ns: u64, level: bool) -> bool {
        let least_ns = self.config.clock_max.map_or(0, Hertz::period_ns);
        match (self.state, level) {
            (State::Frame(_), true) if t_ns < self.last_rise_ns + least_ns => true,
            (_, true) => {
                self.last_rise_ns = t_ns;
                false
            }
            _ => false,
        }
    }

    /// For how long MA stands now, because the machine that moves it has other things to do.
    pub(crate) fn pause_ns(&mut self) -> u64 {
        match self.random.hit(self.config.rates.pauses) {
            true => self.config.pause.0,
            false => 0,
        }
    }

    /// Whether an SLI is on the master's MO.
    pub fn has_mo(&self) -> bool {
        self.config.sli == Sli::Mo
    }

    /// MO changes to `level` at `t_ns`, for a slave whose SLI is on it. Times must not go backwards.
    #[cold]
    pub fn mo(&mut self, t_ns: u64, level: bool) {
        self.advance(t_ns);
        self.mo = level;
        if self.state == State::Idle {
            self.each_with_sli(Member::follow);
            self.drive_nearest(t_ns);
        }
    }

    /// SLO as the master sees it at `t_ns`. Times must not go backwards.
    pub fn slo(&mut self, t_ns: u64) -> bool {
        self.advance(t_ns);
        let level = if self.present {
            self.line.seen()
        } else {
            self.config.stuck.unwrap_or(true)
        };
        level != self.config.swapped.slo
    }

    /// When SLO next changes, or a timeout next expires, if MA stays as it is.
    pub fn next_change(&self) -> Option<u64> {
        if !self.present {
            return Some(self.config.absent.0);
        }
        match (self.line.next_change(), self.expiry()) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        }
    }

    /// When the running frame ends if MA stays as it is.
    fn expiry(&self) -> Option<u64> {
        match self.state {
            State::Idle => None,
            State::Ending(at) => Some(at),
            State::Armed | State::Frame(_) => Some(self.last_edge_ns + self.timeout_ns()),
        }
    }

    fn timeout_ns(&self) -> u64 {
        match self.config.timeout {
            Timeout::Static(t) => t.0,
            Timeout::Adaptive { .. } => self.adaptive_ns.unwrap_or(ADAPTIVE_CEILING_NS),
            // Twice the time from first falling to second rising edge is three clocks.
            Timeout::FromRequest(t) => self.adaptive_ns.map_or(t.0, |reference| 2 * reference),
        }
    }

    /// How long MA has to be high before a frame, for a slave that asks for it.
    fn rest_ns(&self) -> u64 {
        match self.config.timeout {
            Timeout::Static(t) => t.0,
            _ => ADAPTIVE_CEILING_NS,
        }
    }

    /// Something happens then, or before.
    fn due_by(&mut self, t_ns: Option<u64>) {
        self.due_ns = self.due_ns.min(t_ns.unwrap_or(u64::MAX));
    }

    fn advance(&mut self, t_ns: u64) {
        if t_ns >= self.due_ns {
            self.settle(t_ns);
        }
    }

    #[inline(never)]
    fn settle(&mut self, t_ns: u64) {
        self.present |= t_ns >= self.config.absent.0;
        while let Some(at) = self.expiry().filter(|at| *at <= t_ns) {
            self.expire(at);
        }
        self.line.advance(t_ns);
        self.due_ns = self.next_change().unwrap_or(u64::MAX);
    }

    // Once a frame: kept out of what runs at every edge, as is the latch.
    #[inline(never)]
    fn expire(&mut self, at: u64) {
        if let (State::Frame(_), Timeout::FromRequest(t)) = (self.state, self.config.timeout) {
            let ready = self.first_fall_ns + t.0;
            if ready > at {
                self.members
                    .iter_mut()
                    .for_each(|member| member.slo = false);
                self.drive(at, false);
                self.state = State::Ending(ready);
                return;
            }
        }
        if self.state != State::Armed {
            for member in &mut self.members {
                let cdm = member.hear(!self.ma, at, &self.config, &mut self.events);
                self.cdm = Some(cdm);
            }
            self.timeouts += 1;
            self.powered_up = true;
        }
        self.state = State::Idle;
        self.dead = false;
        self.each_with_sli(Member::rest);
        self.drive_nearest(at);
    }

    /// From the far end on, as levels run.
    fn each_with_sli(&mut self, what: impl Fn(&mut Member, bool)) {
        let mut sli = self.has_mo() && self.mo;
        for member in &mut self.members {
            what(member, sli);
            sli = member.slo;
        }
    }

    /// Rising edge 1: the measurement is taken.
    #[inline(never)]
    fn latch(&mut self, t_ns: u64) {
        self.state = State::Frame(1);
        self.latch_ns = t_ns;
        let (from, to) = (self.config.busy.start().0, self.config.busy.end().0);
        for member in self.members.iter_mut().rev() {
            member.busy_ns = self.random.between(from, to);
        }
        let rates = self.config.rates;
        self.mute = self.random.hit(rates.no_ack);
        self.dead = self.random.hit(rates.no_start);
        self.measure();
        self.load();
        self.latches += 1;
    }

    fn rise(&mut self, t_ns: u64, edge: u32) {
        self.state = State::Frame(edge);
        if edge == 2 {
            let extra = match self.config.timeout {
                Timeout::Adaptive { sample_clock } => self.random.between(0, 3 * sample_clock.0),
                _ => 0,
            };
            self.adaptive_ns = Some(t_ns - self.first_fall_ns + extra);
            self.due_by(self.expiry());
        }
        if !self.powered_up {
            return;
        }
        let acknowledged = edge >= 2 + u32::from(self.config.ack);
        let nearest = self.members.len() - 1;
        let mut level = true;
        for (place, member) in self.members.iter_mut().enumerate() {
            let ready = acknowledged && t_ns >= self.latch_ns + member.busy_ns;
            let held = self.dead && place == nearest;
            member.rise(ready && !held, &self.config);
            level = member.slo;
        }
        if !self.mute {
            self.drive(t_ns, level);
        }
    }

    fn drive_nearest(&mut self, t_ns: u64) {
        let level = self.members.last().is_none_or(|nearest| nearest.slo);
        self.drive(t_ns, level);
    }

    /// The last SLO changes at `t_ns` and arrives later.
    fn drive(&mut self, t_ns: u64, level: bool) {
        if self.config.stuck.is_none() && self.powered_up {
            self.line.drive(t_ns, level, &self.config, &mut self.random);
            self.due_by(self.line.next_change());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Clocks `edges` rising edges of 1 µs and returns SLO just before the edge after each.
    fn clock(slave: &mut Slave, t: &mut u64, edges: usize) -> String {
        let mut seen = String::new();
        for _ in 0..edges {
            slave.ma(*t, false);
            slave.ma(*t + 500, true);
            *t += 1000;
            seen.push(if slave.slo(*t + 499) { '1' } else { '0' });
        }
        seen
    }

    fn slave(text: &str) -> Slave {
        Slave::new(text.parse().unwrap_or_else(|e| panic!("{e}")))
    }

    /// SL after rising edges 1, 2, 3 …: own computation, checked against hpm_sdk, AN21, AN22 by the generator
    /// that made it (the CRCs of these words are proven in `crc.rs`).
    #[test]
    fn sends_the_known_sequences() {
        for (config, want) in [
            (
                "motion=still,pos=36984440,frame=st26,nE,nW,crc6",
                "101010001101000101011001111000110100110",
            ),
            (
                "motion=still,pos=36984440,cds=1,ack=3,frame=st26,nE,nW,crc6",
                "10001110001101000101011001111000110100110",
            ),
            (
                "motion=still,turn=291,pos=2748,warning=1,frame=mt12,st13,nE,nW,crc6",
                "10100001001000110101010111100100001000",
            ),
            (
                "motion=still,pos=3735928559,error=1,frame=pos32,nE,nW,crc6",
                "101011011110101011011011111011101111010101110",
            ),
            (
                "null=1,frame=st24,nE,nW,crc6",
                "1010000000000000000000000000001111110",
            ),
            (
                "motion=still,frame=st24,nE,nW,crc6",
                "1010000000000000000000000000111110100",
            ),
            (
                "motion=still,pos=262143,frame=st18,nE,nW,crc6",
                "1010111111111111111111110000100",
            ),
            (
                "motion=still,turn=258,pos=3430008,frame=mt16,st23,nE,nW,crc6",
                "1010000000010000001001101000101011001111000111111100",
            ),
            (
                "motion=still,pos=857,frame=st28,nE,nW,crc6",
                "10100000000000000000001101011001111100010",
            ),
        ] {
            let mut slave = slave(config);
            let mut t = 100_000;
            assert_eq!(clock(&mut slave, &mut t, want.len()), want);
            assert!(
                !slave.slo(t + 19_400),
                "the timeout runs from the last edge"
            );
            assert!(slave.slo(t + 19_600));
            assert_eq!(slave.take_cdm(), Some(false));
        }
    }

    #[test]
    fn surplus_clocks_read_zero_and_restart_the_timer() {
        let mut slave = slave("motion=still,pos=3,frame=st8,crc6");
        let mut t = 0;
        let all = clock(&mut slave, &mut t, 40);
        assert!(all.ends_with(&"0".repeat(40 - 18)), "{all}");
        assert!(!slave.slo(t + 19_000));
    }

    #[test]
    fn a_pause_ends_the_frame_and_the_next_edge_starts_another() {
        let mut slave = slave("motion=count,pos=255,frame=st8,crc6");
        let mut t = 0;
        let first = clock(&mut slave, &mut t, 8);
        assert_eq!(first, "10101111");
        t += 20_000;
        assert_eq!(
            clock(&mut slave, &mut t, 6),
            "101000",
            "a new frame with the next position"
        );
        assert_eq!((slave.latches(), slave.timeouts()), (2, 1));
        assert_eq!(slave.latched(), &[0]);
    }

    /// D2 p. 15: after CDM = 1 MA rises before it falls, and that edge is not counted.
    #[test]
    fn the_edge_that_releases_cdm_is_not_counted() {
        let mut slave = slave("cds=0,motion=still,pos=170,frame=st8,crc6");
        let mut t = 0;
        let first = clock(&mut slave, &mut t, 19);
        slave.ma(t, false);
        assert!(slave.slo(t + 21_000));
        assert_eq!(slave.take_cdm(), Some(true));
        slave.ma(t + 22_000, true);
        t += 23_000;
        assert_eq!(clock(&mut slave, &mut t, 19), first);
    }

    #[test]
    fn adaptive_timeout_is_one_and_a_half_clocks() {
        let mut slave = slave("timeout=adaptive,motion=still,frame=st8,crc6");
        let mut t = 0;
        clock(&mut slave, &mut t, 19);
        let last = t - 500;
        assert!(!slave.slo(last + 1_499));
        assert!(slave.slo(last + 1_500));
    }

    /// Renishaw: SLO is low until 40 µs after the frame was requested.
    #[test]
    fn timeout_from_the_request() {
        let mut slave = slave("timeout=request,motion=still,pos=1,frame=st8,crc6");
        let mut t = 0;
        clock(&mut slave, &mut t, 19);
        assert!(!slave.slo(39_999));
        assert!(slave.slo(40_000));
        let mut t = 100_000;
        clock(&mut slave, &mut t, 60);
        assert!(
            !slave.slo(t - 500 + 2_999),
            "a frame longer than that ends three clocks after the last edge"
        );
        assert!(slave.slo(t - 500 + 3_000));
    }

    #[test]
    fn powers_up_low_until_a_frame_has_passed() {
        let mut slave = slave("power-up=low,motion=still,frame=st8,crc6");
        assert!(!slave.slo(1_000_000));
        let mut t = 2_000_000;
        assert_eq!(clock(&mut slave, &mut t, 2), "00");
        assert!(slave.slo(t + 20_000));
        t += 50_000;
        assert!(clock(&mut slave, &mut t, 3).starts_with("101"));
    }

    #[test]
    fn busy_and_delay_hold_the_start_back() {
        let mut busy = slave("busy=4us,motion=still,pos=255,frame=st8,crc6");
        let mut t = 0;
        assert_eq!(
            clock(&mut busy, &mut t, 8),
            "10001011",
            "start at the first edge 4 us after LAT"
        );
        let mut late = slave("delay=2500ns,motion=still,pos=255,frame=st8,crc6");
        let mut t = 0;
        assert_eq!(clock(&mut late, &mut t, 8), "11101011");
    }

    #[test]
    fn faults_are_what_they_say() {
        let run = |text: &str| clock(&mut slave(text), &mut 0, 20);
        assert_eq!(run("stuck=0"), "0".repeat(20));
        assert_eq!(run("stuck=1"), "1".repeat(20));
        assert_eq!(run("no-ack=1"), "1".repeat(20));
        assert_eq!(run("no-start=1"), format!("1{}", "0".repeat(19)));
        let good = run("motion=still,frame=st8,crc6");
        let bad = run("motion=still,crc-error=1,frame=st8,crc6");
        let differ: Vec<_> = good
            .bytes()
            .zip(bad.bytes())
            .enumerate()
            .filter(|(_, (a, b))| a != b)
            .map(|(i, _)| i)
            .collect();
        assert_eq!(differ, [17]);
    }

    #[test]
    fn same_seed_same_bytes() {
        let text = "flip=1%,jitter=100ns,busy=1us..9us,crc-error=10%,error=10%,seed=7";
        let run = |text: &str| {
            let mut slave = slave(text);
            let mut t = 0;
            (0..50)
                .map(|_| {
                    let s = clock(&mut slave, &mut t, 60);
                    t += 50_000;
                    s
                })
                .collect::<String>()
        };
        assert_eq!(run(text), run(text));
        assert_ne!(run(text), run(&text.replace("seed=7", "seed=8")));
    }

    #[test]
    fn keeps_the_latest_events() {
        let mut events = Events::default();
        let event = |id| Event::Command {
            id,
            command: 0,
            broadcast: true,
        };
        events.add(event(0));
        events.wanted = true;
        (1..=MOST_EVENTS + 2).for_each(|id| events.add(event(id)));
        assert_eq!(events.log.len(), MOST_EVENTS);
        assert_eq!(events.log.front(), Some(&event(3)));
        assert_eq!(events.log.back(), Some(&event(MOST_EVENTS + 2)));
    }
}
