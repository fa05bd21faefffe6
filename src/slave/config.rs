//! What can be set about a simulated encoder.

use super::image;
use crate::format::{Format, MAX_CHANNELS};
use crate::parse::ParseError;
use crate::preset::{Frame, Timeout as Published};
use crate::unit::{Hertz, Nanos, probability};
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

/// Which channels belong to which slave.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Slaves {
    /// All to one.
    One,
    /// One channel a slave.
    Each,
    /// So many to each, in wire order: the slave nearest the master first.
    Of(Vec<u8>),
}

/// What the registers of each slave hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Device {
    /// An EDS that describes this slave's own channels.
    Own,
    /// What an iC-MHM showed (iC-Haus AN22).
    Mhm,
    /// Nothing: it is unidirectional, its CDS is 0 and it ignores CDM.
    None,
}

/// The SLI of the slave farthest away.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sli {
    /// Grounded: it is slave 0 of a chain of its own.
    Low,
    /// On the master's MO.
    Mo,
}

/// Which pairs have their two wires exchanged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Swapped {
    /// The encoder sees MA upside down.
    pub ma: bool,
    /// The master sees SLO upside down.
    pub slo: bool,
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
    /// The CDS bit of each frame; `None` is control communication.
    pub cds: Option<bool>,
    /// The slaves of the chain.
    pub slaves: Slaves,
    /// What stands in their registers.
    pub device: Device,
    /// What drives the SLI of the slave farthest away.
    pub sli: Sli,
    /// A refusal is told by never echoing S, as before D2; else by inverting W.
    pub refuses_silently: bool,
    /// How long a register takes, drawn for each byte.
    pub reg_busy: RangeInclusive<Nanos>,
    /// Addresses that are not there, as on the wire.
    pub refuse: Option<RangeInclusive<u8>>,
    /// Addresses that cannot be written.
    pub read_only: Option<RangeInclusive<u8>>,
    /// The sign of life goes from its highest value to 1.
    pub life_skips_zero: bool,
    /// SLO is stuck at this level.
    pub stuck: Option<bool>,
    /// Pairs whose wires are exchanged.
    pub swapped: Swapped,
    /// It begins a frame only where MA has been high for its timeout, so not behind a CDM = 1.
    pub rests_high: bool,
    /// A rising MA edge that comes sooner after the one before than a period of this is missed.
    pub clock_max: Option<Hertz>,
    /// How long MA stands where the machine that moves it has other things to do.
    pub pause: Nanos,
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
    /// The position of the second channel that has one is a quarter of its range off.
    pub pair_differs: u32,
    /// The sign of life stays what it was.
    pub life_stuck: u32,
    /// IDL is not set where the slave takes its ID; per control frame.
    pub idl_wrong: u32,
    /// IDA is inverted; per control frame.
    pub ida_wrong: u32,
    /// W is inverted though the address is there; per control frame.
    pub w_inverted: u32,
    /// S is not echoed; per control frame.
    pub no_s: u32,
    /// P is 1 though there is more; per control frame.
    pub stop_bit: u32,
    /// The CRC of a register's data is sent wrong; per byte.
    pub data_crc: u32,
    /// The echo of a byte is wrong, the byte is stored as it came; per byte.
    pub echo_wrong: u32,
    /// A byte is acknowledged and not stored; per byte.
    pub write_lost: u32,
    /// CDS is sent inverted; per bit.
    pub cds_flip: u32,
    /// CDM is read inverted; per bit.
    pub cdm_flip: u32,
    /// MA stands for [`Config::pause`] after an edge; per edge, where the master's time is simulated too.
    pub pauses: u32,
}

impl Rates {
    /// The one that is set by this key.
    fn rate(&mut self, key: &str) -> Option<&mut u32> {
        Some(match key {
            "crc-error" => &mut self.crc_error,
            "no-ack" => &mut self.no_ack,
            "no-start" => &mut self.no_start,
            "null" => &mut self.null,
            "error" => &mut self.error,
            "warning" => &mut self.warning,
            "flip" => &mut self.flip,
            "pair-differs" => &mut self.pair_differs,
            "life-stuck" => &mut self.life_stuck,
            "idl-wrong" => &mut self.idl_wrong,
            "ida-wrong" => &mut self.ida_wrong,
            "w-inverted" => &mut self.w_inverted,
            "no-s" => &mut self.no_s,
            "stop-bit" => &mut self.stop_bit,
            "data-crc" => &mut self.data_crc,
            "echo-wrong" => &mut self.echo_wrong,
            "write-lost" => &mut self.write_lost,
            "cds-flip" => &mut self.cds_flip,
            "cdm-flip" => &mut self.cdm_flip,
            "pauses" => &mut self.pauses,
            _ => return None,
        })
    }
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
            cds: None,
            slaves: Slaves::One,
            device: Device::Own,
            sli: Sli::Low,
            refuses_silently: false,
            reg_busy: Nanos(0)..=Nanos(0),
            refuse: None,
            read_only: None,
            life_skips_zero: false,
            stuck: None,
            swapped: Swapped::default(),
            rests_high: false,
            clock_max: None,
            pause: Nanos(20_000),
            rates: Rates::default(),
        }
    }
}

/// The keys of [`Config::set`] with their values, as shown to users.
pub const KEYS: [(&str, &str); 38] = [
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
    ("cds", "0|1, instead of control communication"),
    ("slaves", "CHANNELS[:CHANNELS…]|each, nearest first"),
    ("sli", "low|mo, of the farthest slave"),
    ("device", "own|mhm|none"),
    ("refusal", "invert|silent"),
    ("reg-busy", "TIME[..TIME]"),
    ("refuse read-only", "ADDRESS[..ADDRESS]"),
    ("stuck", "0|1"),
    ("swapped", "ma|slo|both"),
    ("ma-rest", "any|high"),
    ("clock-max", "FREQ"),
    ("pause", "TIME, how long MA stands"),
    ("pauses", "PROBABILITY per MA edge"),
    ("crc-error no-ack no-start null", "PROBABILITY"),
    ("error warning", "PROBABILITY"),
    ("flip", "PROBABILITY per bit"),
    ("pair-differs life-stuck", "PROBABILITY"),
    ("life-skips-zero", "0|1"),
    (
        "idl-wrong ida-wrong w-inverted no-s stop-bit",
        "PROBABILITY per control frame",
    ),
    ("data-crc echo-wrong write-lost", "PROBABILITY per byte"),
    ("cds-flip cdm-flip", "PROBABILITY per bit"),
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

    /// How many channels each slave has, the nearest first.
    ///
    /// # Errors
    /// When [`Slaves::Of`] does not share out the channels of the format.
    pub fn chain(&self) -> Result<Vec<usize>, ParseError> {
        let channels = self.format.channels().len();
        let Slaves::Of(counts) = &self.slaves else {
            return Ok(match self.slaves {
                Slaves::Each => vec![1; channels],
                _ => vec![channels],
            });
        };
        let counts: Vec<usize> = counts.iter().map(|count| usize::from(*count)).collect();
        if counts.iter().sum::<usize>() == channels {
            return Ok(counts);
        }
        let text = counts.iter().map(usize::to_string).collect::<Vec<_>>();
        let text = text.join(":");
        let has: usize = counts.iter().sum();
        Err(ParseError::new(
            &text,
            0..text.len(),
            format!("the slaves `{text}` have {has} channels, the frame has {channels}"),
            format!(
                "give each channel of {} to a slave, the first to the nearest",
                self.format
            ),
        ))
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
            "cds" => self.cds = Some(level(value).ok_or_else(|| wrong("0|1"))?),
            "slaves" => {
                self.slaves = slaves(value)
                    .ok_or_else(|| wrong("CHANNELS[:CHANNELS…], such as 1:2, or each"))?
            }
            "sli" => {
                self.sli = match value {
                    "low" => Sli::Low,
                    "mo" => Sli::Mo,
                    _ => return Err(wrong("low|mo")),
                }
            }
            "device" => {
                self.device = match value {
                    "own" => Device::Own,
                    "mhm" => Device::Mhm,
                    "none" => Device::None,
                    _ => return Err(wrong("own|mhm|none")),
                };
                if self.device == Device::Mhm {
                    self.format = image::mhm_format();
                }
            }
            "refusal" => {
                self.refuses_silently = match value {
                    "invert" => false,
                    "silent" => true,
                    _ => return Err(wrong("invert|silent")),
                }
            }
            "reg-busy" => {
                let (from, to) = Nanos::range(value)?;
                self.reg_busy = from..=to.unwrap_or(from);
            }
            "refuse" => {
                let range = addresses(value).ok_or_else(|| wrong(ADDRESSES))?;
                self.refuse = Some(range);
            }
            "read-only" => {
                let range = addresses(value).ok_or_else(|| wrong(ADDRESSES))?;
                self.read_only = Some(range);
            }
            "life-skips-zero" => self.life_skips_zero = level(value).ok_or_else(|| wrong("0|1"))?,
            "swapped" => {
                self.swapped = match value {
                    "ma" => Swapped {
                        ma: true,
                        slo: false,
                    },
                    "slo" => Swapped {
                        ma: false,
                        slo: true,
                    },
                    "both" => Swapped {
                        ma: true,
                        slo: true,
                    },
                    _ => return Err(wrong("ma|slo|both")),
                }
            }
            "ma-rest" => {
                self.rests_high = match value {
                    "any" => false,
                    "high" => true,
                    _ => return Err(wrong("any|high")),
                }
            }
            "clock-max" => self.clock_max = Some(value.parse()?),
            "pause" => self.pause = value.parse()?,
            "stuck" => self.stuck = Some(level(value).ok_or_else(|| wrong("0|1"))?),
            _ if self.rates.rate(key).is_some() => {
                let parts = probability(value)?;
                if let Some(rate) = self.rates.rate(key) {
                    *rate = parts;
                }
            }
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

const ADDRESSES: &str = "ADDRESS[..ADDRESS], 0x00 to 0x7F, such as 0x10..0x1F";

/// `0x10`, `16..31`.
fn addresses(text: &str) -> Option<RangeInclusive<u8>> {
    let address = |text: &str| {
        let hex = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"));
        let number = match hex {
            Some(digits) => u8::from_str_radix(digits, 16),
            None => text.parse(),
        };
        number.ok().filter(|address| *address < 0x80)
    };
    let (from, to) = text.split_once("..").unwrap_or((text, text));
    let (from, to) = (address(from)?, address(to)?);
    (from <= to).then_some(from..=to)
}

/// More would only make frames long.
const MOST_SLAVES: usize = 32;

/// `1:2:0`, `each`.
fn slaves(text: &str) -> Option<Slaves> {
    if text == "each" {
        return Some(Slaves::Each);
    }
    let counts: Option<Vec<u8>> = text
        .split(':')
        .map(|count| {
            count
                .parse()
                .ok()
                .filter(|n| usize::from(*n) <= MAX_CHANNELS)
        })
        .collect();
    counts
        .filter(|counts| counts.len() <= MOST_SLAVES)
        .map(Slaves::Of)
}

fn level(value: &str) -> Option<bool> {
    match value {
        "0" => Some(false),
        "1" => Some(true),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
