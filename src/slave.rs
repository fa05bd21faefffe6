//! The simulated slave: an encoder as one state machine driven by MA edges and time.
//!
//! It stands in for hardware in `sim:` links, in the kernel lab and in every test. It shares no code with the
//! decoder: its bits and its CRC are made one at a time by a loop of their own, so that a wrong bit order in
//! either cannot pass. The same seed gives the same levels at the same times.
//!
//! Rules and numbers: BiSS C protocol description D2, p. 5-8, 12 and Table 10.

use crate::format::{Channel, Format, Kind};
use crate::parse::ParseError;
use crate::preset::{Frame, Timeout as Published};
use crate::unit::{Nanos, probability};
use std::collections::VecDeque;
use std::ops::RangeInclusive;

/// When the slave takes a pause on MA for the end of the frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Timeout {
    /// A fixed time after the last MA edge: 12.5 to 40 µs (D2 Table 10).
    Static(Nanos),
    /// First falling to second rising MA edge of this frame, plus up to three periods of the slave's sample
    /// clock; a static timeout of 20 µs is the ceiling while it is measured.
    Adaptive {
        /// Period of the slave's sample clock.
        sample_clock: Nanos,
    },
    /// SLO stays low until this long after the frame was requested; a stopped clock is noticed within three
    /// clocks (Renishaw L-9709-9005-03-F, p. 2: 40 µs).
    FromRequest(Nanos),
}

/// Static ceiling that stays active while an adaptive slave measures; 20 µs is what most parts use.
const ADAPTIVE_CEILING_NS: u64 = 20_000;

/// How the position moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// Stays where it is.
    Still,
    /// One step a frame; makes lost or doubled frames visible.
    Count,
    /// Constant speed in revolutions per minute; a linear scale's whole length counts as a revolution.
    Speed(f64),
    /// Swings around the start position.
    Sine {
        /// Largest deviation in degrees.
        degrees: f64,
        /// One full swing.
        period: Nanos,
    },
}

/// Everything that can be set about a simulated encoder; parsed from `KEY=VAL,…`.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Frame format.
    pub format: Format,
    /// Seed of everything random.
    pub seed: u64,
    /// Motion of the position in every channel.
    pub motion: Motion,
    /// Position at time 0, in counts.
    pub position: u64,
    /// Turn count at time 0.
    pub turn: u64,
    /// Kind and length of the timeout.
    pub timeout: Timeout,
    /// The timeout was asked for, so no preset sets another.
    pub timeout_given: bool,
    /// The timer restarts on rising MA edges only, as in some HDL slaves (PandABlocks).
    pub rising_only: bool,
    /// Processing time from LAT, drawn anew for each frame.
    pub busy: RangeInclusive<Nanos>,
    /// Clocks from Ack to start at least.
    pub ack: u16,
    /// Line delay: MA edge at the master to SLO edge at the master.
    pub delay: Nanos,
    /// Each SLO edge comes up to this much earlier or later, order kept.
    pub jitter: Nanos,
    /// Not there until then: SLO reads high, whatever MA does.
    pub absent: Nanos,
    /// SLO stays low after power-up until the first frame or INIT has passed.
    pub power_up_low: bool,
    /// The CDS bit of each frame.
    pub cds: bool,
    /// SLO is stuck at this level.
    pub stuck: Option<bool>,
    /// Faults and flags, each with its probability per frame in parts per billion.
    pub rates: Rates,
}

/// Probabilities in parts per billion, per frame unless said otherwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rates {
    /// The CRC of every channel is sent wrong.
    pub crc_error: u32,
    /// SLO stays high all frame.
    pub no_ack: u32,
    /// SLO stays low from Ack to the timeout.
    pub no_start: u32,
    /// Every data bit is sent as 0, with the CRC that belongs to it.
    pub null: u32,
    /// The error bit is set.
    pub error: u32,
    /// The warning bit is set.
    pub warning: u32,
    /// A bit of the data or CRC is sent inverted; per bit.
    pub flip: u32,
}

impl Default for Config {
    fn default() -> Config {
        #[allow(clippy::unwrap_used)] // a constant of ours
        let format = "mt12,st20,nE,nW,crc6".parse().unwrap();
        Config {
            format,
            seed: 1,
            motion: Motion::Speed(60.0),
            position: 0,
            turn: 0,
            timeout: Timeout::Static(Nanos(20_000)),
            timeout_given: false,
            rising_only: false,
            busy: Nanos(0)..=Nanos(0),
            ack: 1,
            delay: Nanos(0),
            jitter: Nanos(0),
            absent: Nanos(0),
            power_up_low: false,
            cds: false,
            stuck: None,
            rates: Rates::default(),
        }
    }
}

/// The keys of [`Config::set`] with their values, as shown to users.
pub const KEYS: [(&str, &str); 22] = [
    ("frame", "FORMAT, last, takes the rest"),
    ("seed", "N"),
    ("motion", "still|count|speed|sine"),
    ("pos", "COUNTS"),
    ("turn", "N"),
    ("rpm", "N"),
    ("degrees", "N"),
    ("period", "TIME"),
    ("timeout", "TIME|adaptive|request"),
    ("tclk", "TIME"),
    ("timer", "any|rising"),
    ("busy", "TIME[..TIME]"),
    ("ack", "CLOCKS"),
    ("delay", "TIME"),
    ("jitter", "TIME"),
    ("absent", "TIME, from the start on"),
    ("power-up", "high|low"),
    ("cds", "0|1"),
    ("stuck", "0|1"),
    ("crc-error no-ack no-start null", "PROBABILITY"),
    ("error warning", "PROBABILITY"),
    ("flip", "PROBABILITY per bit"),
];

impl Config {
    /// Whether there is such a key.
    pub fn knows(key: &str) -> bool {
        KEYS.iter()
            .any(|(keys, _)| keys.split(' ').any(|known| known == key))
    }

    /// Plays a published encoder: its frame, and its timeout where none was asked for.
    pub fn play(&mut self, frame: &Frame) {
        self.format = frame.format.clone();
        let published = frame.preset.and_then(|preset| preset.timeout);
        if let Some(timeout) = published.filter(|_| !self.timeout_given) {
            self.timeout = match timeout {
                Published::Static { max: time, .. } | Published::Nominal(time) => {
                    Timeout::Static(time)
                }
                Published::Adaptive => Timeout::Adaptive {
                    sample_clock: Nanos(0),
                },
                Published::FromRequest(time) => Timeout::FromRequest(time),
            };
        }
    }

    /// Sets one `KEY=VAL`; `motion` and `timeout` come before the keys that say more about them.
    ///
    /// # Errors
    /// An unknown key, naming the known ones, or a value that does not fit its key.
    pub fn set(&mut self, key: &str, value: &str) -> Result<(), ParseError> {
        let wrong = |hint: &str| {
            ParseError::new(
                value,
                0..value.len(),
                format!("`{value}` does not fit `{key}`"),
                format!("write {key}={hint}"),
            )
        };
        let count = |hint| value.parse::<u64>().map_err(|_| wrong(hint));
        let decimal = |hint| {
            value
                .parse::<f64>()
                .ok()
                .filter(|v| v.is_finite())
                .ok_or_else(|| wrong(hint))
        };
        match key {
            "frame" => self.format = value.parse()?,
            "seed" => self.seed = count("N")?,
            "pos" => self.position = count("COUNTS")?,
            "turn" => self.turn = count("N")?,
            "motion" => {
                self.motion = match value {
                    "still" => Motion::Still,
                    "count" => Motion::Count,
                    "speed" => Motion::Speed(60.0),
                    "sine" => Motion::Sine {
                        degrees: 90.0,
                        period: Nanos(1_000_000_000),
                    },
                    _ => return Err(wrong("still|count|speed|sine")),
                }
            }
            "rpm" => match self.motion {
                Motion::Speed(_) => self.motion = Motion::Speed(decimal("N, such as 60 or -0.5")?),
                _ => return Err(wrong("… only with motion=speed")),
            },
            "degrees" => match &mut self.motion {
                Motion::Sine { degrees, .. } => *degrees = decimal("N, such as 90")?,
                _ => return Err(wrong("… only with motion=sine")),
            },
            "period" => match &mut self.motion {
                Motion::Sine { period, .. } => {
                    *period = value.parse()?;
                    if period.0 == 0 {
                        return Err(wrong("TIME above 0"));
                    }
                }
                _ => return Err(wrong("… only with motion=sine")),
            },
            "timeout" => {
                self.timeout_given = true;
                self.timeout = match value {
                    "adaptive" => Timeout::Adaptive {
                        sample_clock: Nanos(0),
                    },
                    "request" => Timeout::FromRequest(Nanos(40_000)),
                    _ => Timeout::Static(value.parse()?),
                }
            }
            "tclk" => match &mut self.timeout {
                Timeout::Adaptive { sample_clock } => *sample_clock = value.parse()?,
                _ => return Err(wrong("… only with timeout=adaptive")),
            },
            "timer" => {
                self.rising_only = match value {
                    "any" => false,
                    "rising" => true,
                    _ => return Err(wrong("any|rising")),
                }
            }
            "busy" => {
                let (from, to) = Nanos::range(value)?;
                self.busy = from..=to.unwrap_or(from);
            }
            "ack" => {
                self.ack = value
                    .parse()
                    .ok()
                    .filter(|n| (1..=1000).contains(n))
                    .ok_or_else(|| wrong("CLOCKS, 1 to 1000"))?
            }
            "delay" => self.delay = value.parse()?,
            "jitter" => self.jitter = value.parse()?,
            "absent" => self.absent = value.parse()?,
            "power-up" => {
                self.power_up_low = match value {
                    "high" => false,
                    "low" => true,
                    _ => return Err(wrong("high|low")),
                }
            }
            "cds" => self.cds = level(value).ok_or_else(|| wrong("0|1"))?,
            "stuck" => self.stuck = Some(level(value).ok_or_else(|| wrong("0|1"))?),
            "crc-error" => self.rates.crc_error = probability(value)?,
            "no-ack" => self.rates.no_ack = probability(value)?,
            "no-start" => self.rates.no_start = probability(value)?,
            "null" => self.rates.null = probability(value)?,
            "error" => self.rates.error = probability(value)?,
            "warning" => self.rates.warning = probability(value)?,
            "flip" => self.rates.flip = probability(value)?,
            _ => {
                let known: Vec<String> = KEYS
                    .iter()
                    .map(|(keys, value)| format!("{}={value}", keys.replace(' ', "= ")))
                    .collect();
                let what = format!("the simulated slave has no `{key}`");
                return Err(ParseError::new(
                    key,
                    0..key.len(),
                    what,
                    format!("known are\n    {}", known.join("\n    ")),
                ));
            }
        }
        Ok(())
    }
}

fn level(value: &str) -> Option<bool> {
    match value {
        "0" => Some(false),
        "1" => Some(true),
        _ => None,
    }
}

/// A small deterministic generator (SplitMix64), ours so that a seed means the same for ever.
#[derive(Clone, Debug)]
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ z >> 31
    }

    /// True `parts` times in a billion.
    fn hit(&mut self, parts: u32) -> bool {
        parts > 0 && self.next() % 1_000_000_000 < u64::from(parts)
    }

    fn between(&mut self, from: u64, to: u64) -> u64 {
        if from >= to {
            from
        } else {
            from + self.next() % (to - from + 1)
        }
    }
}

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

/// The simulated encoder. Feed it MA edges in order of time and ask it for SLO.
#[derive(Clone, Debug)]
pub struct Slave {
    config: Config,
    random: Random,
    state: State,
    present: bool,
    powered_up: bool,
    ma: bool,
    last_edge_ns: u64,
    first_fall_ns: u64,
    adaptive_ns: Option<u64>,
    latch_ns: u64,
    busy_ns: u64,
    mute: bool,
    dead: bool,
    /// Bits still to be sent after Ack, the next one last.
    queue: Vec<bool>,
    /// SLO as the slave drives it.
    out: bool,
    /// SLO as it arrives at the master, and the changes under way.
    seen: bool,
    under_way: VecDeque<(u64, bool)>,
    latches: u64,
    words: Vec<u64>,
    cdm: Option<bool>,
    timeouts: u64,
}

impl Slave {
    /// A slave at rest: MA high, SLO high unless `power_up_low`.
    pub fn new(config: Config) -> Slave {
        let level = config.stuck.unwrap_or(!config.power_up_low);
        let bits = usize::from(config.format.bits());
        Slave {
            random: Random(config.seed),
            state: State::Idle,
            present: config.absent.0 == 0,
            powered_up: !config.power_up_low,
            ma: true,
            last_edge_ns: 0,
            first_fall_ns: 0,
            adaptive_ns: None,
            latch_ns: 0,
            busy_ns: 0,
            mute: false,
            dead: false,
            queue: Vec::with_capacity(bits + 2),
            out: level,
            seen: level,
            under_way: VecDeque::with_capacity(64),
            latches: 0,
            words: Vec::with_capacity(config.format.channels().len()),
            cdm: None,
            timeouts: 0,
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

    /// The CDM bit sampled at the last timeout, once.
    pub fn take_cdm(&mut self) -> Option<bool> {
        self.cdm.take()
    }

    /// How many frames its timeout has ended.
    pub fn timeouts(&self) -> u64 {
        self.timeouts
    }

    /// MA changes to `level` at `t_ns`. Times must not go backwards; a level that is there already is no edge.
    pub fn ma(&mut self, t_ns: u64, level: bool) {
        self.advance(t_ns);
        if level == self.ma {
            return;
        }
        self.ma = level;
        if !self.present {
            return;
        }
        if level || !self.config.rising_only || self.state == State::Idle {
            self.last_edge_ns = t_ns;
        }
        match (self.state, level) {
            (State::Idle, false) => {
                self.state = State::Armed;
                self.first_fall_ns = t_ns;
                self.adaptive_ns = None;
            }
            (State::Armed, true) => self.latch(t_ns),
            (State::Frame(edge), true) => self.rise(t_ns, edge + 1),
            _ => {}
        }
    }

    /// SLO as the master sees it at `t_ns`. Times must not go backwards.
    pub fn slo(&mut self, t_ns: u64) -> bool {
        self.advance(t_ns);
        if self.present {
            self.seen
        } else {
            self.config.stuck.unwrap_or(true)
        }
    }

    /// When SLO next changes, or a timeout next expires, if MA stays as it is.
    pub fn next_change(&self) -> Option<u64> {
        if !self.present {
            return Some(self.config.absent.0);
        }
        let arriving = self.under_way.front().map(|(t, _)| *t);
        match (arriving, self.expiry()) {
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

    fn advance(&mut self, t_ns: u64) {
        self.present |= t_ns >= self.config.absent.0;
        while let Some(at) = self.expiry().filter(|at| *at <= t_ns) {
            self.expire(at);
        }
        while let Some(&(at, level)) = self.under_way.front() {
            if at > t_ns {
                break;
            }
            self.seen = level;
            self.under_way.pop_front();
        }
    }

    fn expire(&mut self, at: u64) {
        if let (State::Frame(_), Timeout::FromRequest(t)) = (self.state, self.config.timeout) {
            let ready = self.first_fall_ns + t.0;
            if ready > at {
                self.drive(at, false);
                self.state = State::Ending(ready);
                return;
            }
        }
        if self.state != State::Armed {
            self.cdm = Some(!self.ma);
            self.timeouts += 1;
            self.powered_up = true;
        }
        self.state = State::Idle;
        self.dead = false;
        self.drive(at, true);
    }

    /// Rising edge 1: the measurement is taken.
    fn latch(&mut self, t_ns: u64) {
        self.state = State::Frame(1);
        self.latch_ns = t_ns;
        let (from, to) = (self.config.busy.start().0, self.config.busy.end().0);
        self.busy_ns = self.random.between(from, to);
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
        }
        if self.mute || !self.powered_up {
            return;
        }
        let ready = t_ns >= self.latch_ns + self.busy_ns && edge >= 2 + u32::from(self.config.ack);
        let bit = if edge == 2 || !self.started() && (!ready || self.dead) {
            false
        } else {
            self.queue.pop().unwrap_or(false)
        };
        self.drive(t_ns, bit);
    }

    fn started(&self) -> bool {
        self.queue.len() < usize::from(self.config.format.bits()) + 2
    }

    /// SLO changes at the slave at `t_ns` and arrives later.
    fn drive(&mut self, t_ns: u64, level: bool) {
        if self.config.stuck.is_some() || !self.powered_up || level == self.out {
            return;
        }
        self.out = level;
        let jitter = self.config.jitter.0;
        let wander = self.random.between(0, 2 * jitter);
        let earliest = self.under_way.back().map_or(t_ns, |(t, _)| *t);
        let at = (t_ns + self.config.delay.0 + wander)
            .saturating_sub(jitter)
            .max(earliest);
        self.under_way.push_back((at, level));
    }

    /// The data word of each channel for the position at the latch.
    fn measure(&mut self) {
        let rates = self.config.rates;
        let (error, warning) = (self.random.hit(rates.error), self.random.hit(rates.warning));
        let null = self.random.hit(rates.null);
        self.words.clear();
        for channel in self.config.format.channels() {
            let (turn, position) = self.place(channel);
            let mut word = 0;
            for field in channel.fields() {
                let value = match field.kind() {
                    Kind::Turn => turn,
                    Kind::SingleTurn | Kind::Position => position,
                    Kind::Padding => 0,
                    Kind::Data(_) => position,
                    Kind::Life => self.latches + 1,
                    Kind::Error { active_low } => u64::from(error != *active_low),
                    Kind::Warning { active_low } => u64::from(warning != *active_low),
                };
                word = field.set(word, value);
            }
            self.words.push(if null { 0 } else { word });
        }
    }

    /// Turn and position of a channel now, in its own counts.
    fn place(&self, channel: &Channel) -> (u64, u64) {
        let bits = channel.position().map_or(16, |f| u32::from(f.bits()));
        let range = 2f64.powi(bits as i32);
        let seconds = self.latch_ns as f64 / 1e9;
        let moved: i128 = match self.config.motion {
            Motion::Still => 0,
            Motion::Count => i128::from(self.latches),
            Motion::Speed(rpm) => (rpm / 60.0 * seconds * range) as i128,
            Motion::Sine { degrees, period } => {
                let turns = self.latch_ns as f64 / period.0 as f64;
                (degrees / 360.0 * range * sine(turns)) as i128
            }
        };
        let start =
            (i128::from(self.config.turn) << bits).wrapping_add(i128::from(self.config.position));
        let whole = start.wrapping_add(moved);
        (
            (whole >> bits) as u64,
            (whole & ((1i128 << bits) - 1)) as u64,
        )
    }

    /// Start, CDS, then every channel bit by bit with its CRC; what follows is the stop bit and zeros.
    fn load(&mut self) {
        let rates = self.config.rates;
        let spoiled = self.random.hit(rates.crc_error);
        self.queue.clear();
        self.queue.push(true);
        self.queue.push(self.config.cds);
        for (channel, word) in self.config.format.channels().iter().zip(&self.words) {
            let spec = channel.crc().map(CrcBits::new);
            let mut register = spec.as_ref().map_or(0, |s| s.init);
            for place in (0..channel.data_bits()).rev() {
                let bit = word >> place & 1 == 1;
                if let Some(spec) = &spec {
                    register = spec.shift(register, bit);
                }
                self.queue.push(bit ^ self.random.hit(rates.flip));
            }
            if let Some(spec) = &spec {
                for place in (0..spec.bits).rev() {
                    let bit = (register >> place & 1 == 1) ^ spec.inverted;
                    let wrong = spoiled && place == 0;
                    self.queue.push(bit ^ wrong ^ self.random.hit(rates.flip));
                }
            }
        }
        self.queue.reverse();
    }
}

/// Sine of so many turns, by its series: the same digits on every machine, and no library of mathematics to load for it.
fn sine(turns: f64) -> f64 {
    let turns = match turns.fract() {
        turn if turn > 0.75 => turn - 1.0,
        turn if turn > 0.25 => 0.5 - turn,
        turn => turn,
    };
    let angle = turns * std::f64::consts::TAU;
    let term = |rest: f64, n: u32| 1.0 - angle * angle / f64::from(2 * n * (2 * n + 1)) * rest;
    angle * (1..=11).rev().fold(1.0, term)
}

/// A CRC as a shift register: parameters of the format, arithmetic of its own.
struct CrcBits {
    bits: u32,
    poly: u32,
    init: u32,
    inverted: bool,
}

impl CrcBits {
    fn new(crc: &crate::crc::Crc) -> CrcBits {
        CrcBits {
            bits: u32::from(crc.bits()),
            poly: crc.poly(),
            init: u32::from(crc.init()),
            inverted: crc.inverted(),
        }
    }

    fn shift(&self, register: u32, bit: bool) -> u32 {
        let top = register >> (self.bits - 1) & 1 == 1;
        let shifted = register << 1 & ((1 << self.bits) - 1);
        if top != bit {
            shifted ^ (self.poly & ((1 << self.bits) - 1))
        } else {
            shifted
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
        let mut slave = slave("motion=still,pos=170,frame=st8,crc6");
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
    fn the_series_is_the_sine() {
        for step in 0..=4000 {
            let turns = f64::from(step) / 1000.0;
            let want = (turns * std::f64::consts::TAU).sin();
            assert!((sine(turns) - want).abs() < 4e-15, "{turns}");
        }
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
    fn unknown_keys_list_the_known_ones() {
        let error = Config::default().set("dellay", "1us").unwrap_err();
        let text = error.to_string();
        for (keys, _) in KEYS {
            for key in keys.split(' ') {
                assert!(text.contains(key), "{key} in {text}");
                assert!(Config::knows(key));
            }
        }
    }
}
