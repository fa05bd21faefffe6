//! `LINK` on the command line: `gpio:0,ma=17,slo=27`, `spi:0.0`, `sim:delay=3us`, `file:bench.vcd`,
//! `exec:vvp slave.vvp`.

use super::{Phase, Uapi};
use crate::parse::ParseError;
use crate::pattern::LEAST_SAMPLES;
use crate::preset::Frame;
use crate::slave::Config;
use crate::unit::{Hertz, Nanos};
use std::path::PathBuf;
use std::str::FromStr;

/// A link as it was asked for, checked as far as it can be without opening anything.
#[derive(Clone, Debug, PartialEq)]
pub struct Spec {
    /// Which kind, with its own options.
    pub kind: Kind,
    /// The format or preset behind `frame=`, which ends the options and takes the rest.
    pub frame: Option<Frame>,
}

/// The kinds of links.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// Lines of a GPIO chip.
    Gpio {
        /// Number, name, label or path; without it a line's name finds its chip.
        chip: Option<String>,
        /// MA: offset or name.
        ma: String,
        /// SLO: offset or name.
        slo: String,
        /// MO, for slaves on a bus: offset or name.
        mo: Option<String>,
        /// Which of the kernel's interfaces; `None` takes what there is.
        uapi: Option<Uapi>,
        /// The far ends of jumpers, for `biss loopback` only.
        far: Option<Far>,
    },
    /// SCLK is MA, MISO is SLO.
    Spi {
        /// `/dev/spidevB.C`.
        path: PathBuf,
        /// Where to sample; `None` finds out.
        phase: Option<Phase>,
        /// Bytes clocked on top of what a frame needs.
        pad: u8,
    },
    /// MOSI is MA, MISO is SLO.
    Wave {
        /// `/dev/spidevB.C`.
        path: PathBuf,
        /// Samples a clock; `None` finds out.
        oversample: Option<u8>,
        /// The MA pair is swapped.
        invert: bool,
        /// MOSI between transfers; `None` where MA is high.
        idle: Option<bool>,
    },
    /// The simulated slave.
    Sim {
        /// The encoder it plays.
        config: Box<Config>,
        /// Never sleeps, not even to keep an interval.
        fast: bool,
    },
    /// A recording.
    File {
        /// Where it is; `-` is standard input.
        path: PathBuf,
        /// Name or number of MA in it.
        ma: Option<String>,
        /// Name or number of SLO in it.
        slo: Option<String>,
        /// Samples a second, where it does not say so.
        rate: Option<Hertz>,
        /// Bytes a sample, where it is nothing but samples.
        unit: Option<u8>,
    },
    /// A slave in another process.
    Exec(Process),
}

/// Two more lines of the same chip, where a simulated slave sits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Far {
    /// MA arrives there: offset or name.
    pub ma_in: String,
    /// SLO comes from there: offset or name.
    pub slo_out: String,
}

/// A slave in another process, as it is started and fed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Process {
    /// How much time a byte stands for.
    pub tick: Nanos,
    /// By the wall clock: where no answer has come for so long, none is expected any more.
    pub silence: Nanos,
    /// What `/bin/sh -c` runs.
    pub command: String,
}

/// A tick where nothing else is said: 125 a clock at 1 MHz.
const TICK: Nanos = Nanos(8);

/// How long an answer is waited for where nothing else is said.
const SILENCE: Nanos = Nanos(10_000_000_000);

const KINDS: &str = "links are gpio:[CHIP,]ma=LINE,slo=LINE[,mo=LINE][,uapi=v1|v2]  spi:BUS.CS[,phase=auto|2|3][,pad=BYTES]  \
                     wave:BUS.CS[,oversample=N][,invert][,idle=low|high]  sim[:KEY=VAL,…]  file:PATH[,ma=NAME][,slo=NAME][,rate=HZ][,unit=BYTES]  \
                     exec:[tick=TIME,][silence=TIME,]COMMAND";

/// One option: where it starts, and its text with `\,` already a comma.
struct Item {
    at: usize,
    len: usize,
    text: String,
}

impl Item {
    fn pair(&self) -> Option<(&str, &str)> {
        self.text.split_once('=')
    }
}

/// Cuts at commas that have no backslash before them.
fn items(text: &str, from: usize) -> Vec<Item> {
    let mut items = Vec::new();
    let mut current = Item {
        at: from,
        len: 0,
        text: String::new(),
    };
    let mut escaped = false;
    for (at, c) in text[from..].char_indices().map(|(at, c)| (from + at, c)) {
        match c {
            ',' if escaped => current.text.push(','),
            ',' => {
                let next = Item {
                    at: at + 1,
                    len: 0,
                    text: String::new(),
                };
                items.push(std::mem::replace(&mut current, next));
                continue;
            }
            _ if escaped => current.text.extend(['\\', c]),
            '\\' => {}
            _ => current.text.push(c),
        }
        escaped = c == '\\' && !escaped;
        current.len = at + c.len_utf8() - current.at;
    }
    if escaped {
        current.text.push('\\');
    }
    items.push(current);
    items.retain(|item| item.len > 0);
    items
}

impl FromStr for Spec {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Spec, ParseError> {
        let (kind, from) = match text.split_once(':') {
            Some((kind, _)) => (kind, kind.len() + 1),
            None => (text, text.len()),
        };
        if kind == "exec" {
            let kind = Parser { text, kind }.exec(from).map(Kind::Exec)?;
            return Ok(Spec { kind, frame: None });
        }
        let (options, frame) = match frame_at(text, from) {
            Some(at) => {
                let format = text[at + 6..]
                    .parse()
                    .map_err(|e: ParseError| e.within(text, at + 6))?;
                (&text[..at], Some(format))
            }
            None => (text, None),
        };
        let parser = Parser { text, kind };
        let items = items(options, from.min(options.len()));
        parser.no_twins(&items)?;
        let kind = match kind {
            "gpio" => parser.gpio(items)?,
            "spi" => parser.spi(items)?,
            "wave" => parser.wave(items)?,
            "sim" => parser.sim(items)?,
            "file" => parser.file(items)?,
            _ => {
                return Err(ParseError::new(
                    text,
                    0..kind.len(),
                    format!("unknown link `{kind}`"),
                    KINDS,
                ));
            }
        };
        if let (Kind::Sim { config, .. }, Some(frame)) = (&kind, &frame) {
            parser.shared_out(config, frame)?;
        }
        Ok(Spec { kind, frame })
    }
}

/// Where `frame=` stands as an option of its own.
fn frame_at(text: &str, from: usize) -> Option<usize> {
    text.match_indices("frame=").map(|(at, _)| at).find(|at| {
        *at >= from && (*at == from || text[..*at].ends_with(',') && !text[..*at].ends_with("\\,"))
    })
}

struct Parser<'a> {
    text: &'a str,
    kind: &'a str,
}

impl Parser<'_> {
    fn wrong(&self, item: &Item, what: impl Into<String>) -> ParseError {
        ParseError::new(self.text, item.at..item.at + item.len, what, KINDS)
    }

    fn unknown(&self, item: &Item, known: &str) -> ParseError {
        let key = item.pair().map_or(item.text.as_str(), |(key, _)| key);
        let what = format!("`{}` has no option `{key}`", self.kind);
        let hint = format!("known are {known} frame=");
        self.inside(item, ParseError::new(key, 0..key.len(), what, hint), 0)
    }

    /// An error about a part of an item, which starts `at` bytes into it. An item with a backslash reads otherwise
    /// than it stands there, so it is marked whole.
    fn inside(&self, item: &Item, error: ParseError, at: usize) -> ParseError {
        if self.text[item.at..item.at + item.len] == item.text {
            error.within(self.text, item.at + at)
        } else {
            error.about(self.text, item.at..item.at + item.len)
        }
    }

    fn missing(&self, what: &str) -> ParseError {
        ParseError::new(
            self.text,
            self.text.len()..self.text.len(),
            format!("`{}` needs {what}", self.kind),
            KINDS,
        )
    }

    fn no_twins(&self, items: &[Item]) -> Result<(), ParseError> {
        for (index, item) in items.iter().enumerate() {
            let same = |other: &Item| matches!((item.pair(), other.pair()), (Some((a, _)), Some((b, _))) if a == b);
            if items[..index].iter().any(same) {
                return Err(self.wrong(item, "this option is there already"));
            }
        }
        Ok(())
    }

    fn gpio(&self, items: Vec<Item>) -> Result<Kind, ParseError> {
        let (mut chip, mut ma, mut slo, mut mo, mut uapi) = (None, None, None, None, None);
        let (mut ma_in, mut slo_out) = (None, None);
        for (index, item) in items.iter().enumerate() {
            match item.pair() {
                Some(("uapi", "v1")) => uapi = Some(Uapi::V1),
                Some(("uapi", "v2")) => uapi = Some(Uapi::V2),
                Some(("uapi", _)) => return Err(self.wrong(item, "uapi is v1 or v2")),
                Some((_, "")) => return Err(self.wrong(item, "a line has a number or a name")),
                Some(("ma", line)) => ma = Some(line.to_owned()),
                Some(("slo", line)) => slo = Some(line.to_owned()),
                Some(("mo", line)) => mo = Some(line.to_owned()),
                Some(("ma-in", line)) => ma_in = Some(line.to_owned()),
                Some(("slo-out", line)) => slo_out = Some(line.to_owned()),
                None if index == 0 => chip = Some(item.text.clone()),
                _ => return Err(self.unknown(item, "ma= slo= mo= uapi=")),
            }
        }
        let ma = ma.ok_or_else(|| self.missing("ma=LINE"))?;
        let slo = slo.ok_or_else(|| self.missing("slo=LINE"))?;
        let far = match (ma_in, slo_out) {
            (None, None) => None,
            (Some(ma_in), Some(slo_out)) => Some(Far { ma_in, slo_out }),
            _ => return Err(self.missing("both ma-in=LINE and slo-out=LINE, for loopback")),
        };
        let ends = far.iter().flat_map(|far| [&far.ma_in, &far.slo_out]);
        let lines: Vec<&String> = [&ma, &slo].into_iter().chain(&mo).chain(ends).collect();
        let numbered = lines.iter().any(|line| line.parse::<u32>().is_ok());
        if chip.is_none() && numbered {
            return Err(self.missing("a chip when lines are numbers: gpio:0,ma=17,slo=27"));
        }
        let twice = |(index, line): (usize, &&String)| lines[..index].contains(line);
        if lines.iter().enumerate().any(twice) {
            let number = ["two", "three", "four", "five"][lines.len() - 2];
            return Err(self.missing(&format!("{number} different lines")));
        }
        Ok(Kind::Gpio {
            chip,
            ma,
            slo,
            mo,
            uapi,
            far,
        })
    }

    /// `BUS.CS` or a path.
    fn spidev(&self, device: Option<Item>) -> Result<PathBuf, ParseError> {
        let example = format!("BUS.CS, such as {}:0.0", self.kind);
        let device = device.ok_or_else(|| self.missing(&example))?;
        let numbers = device
            .text
            .split_once('.')
            .is_some_and(|(bus, cs)| bus.parse::<u16>().is_ok() && cs.parse::<u16>().is_ok());
        match device.text.as_str() {
            path if path.starts_with('/') => Ok(PathBuf::from(path)),
            name if numbers => Ok(PathBuf::from(format!("/dev/spidev{name}"))),
            name => Err(self.wrong(&device, format!("`{name}` is not BUS.CS"))),
        }
    }

    fn spi(&self, items: Vec<Item>) -> Result<Kind, ParseError> {
        let mut items = items.into_iter();
        let path = self.spidev(items.next())?;
        let (mut phase, mut pad) = (None, 0);
        for item in items {
            match item.pair() {
                Some(("phase", "auto")) => phase = None,
                Some(("phase", "2")) => phase = Some(Phase::Half),
                Some(("phase", "3")) => phase = Some(Phase::Whole),
                Some(("phase", _)) => return Err(self.wrong(&item, "phase is auto, 2 or 3")),
                Some(("pad", bytes)) => {
                    pad = bytes
                        .parse()
                        .map_err(|_| self.wrong(&item, "pad is 0 to 255 bytes"))?;
                }
                _ => return Err(self.unknown(&item, "phase= pad=")),
            }
        }
        Ok(Kind::Spi { path, phase, pad })
    }

    fn wave(&self, items: Vec<Item>) -> Result<Kind, ParseError> {
        /// More would not make anything finer that matters, and transfers long.
        const MOST: u8 = 64;
        let mut items = items.into_iter();
        let path = self.spidev(items.next())?;
        let (mut oversample, mut invert, mut idle) = (None, false, None);
        for item in items {
            match item.pair() {
                Some(("oversample", text)) => {
                    let fits = |n: &u8| (LEAST_SAMPLES..=MOST.into()).contains(&u32::from(*n));
                    let samples = text.parse().ok().filter(fits).ok_or_else(|| {
                        let what =
                            format!("oversample is {LEAST_SAMPLES} to {MOST} samples a clock");
                        self.wrong(&item, what)
                    })?;
                    oversample = Some(samples);
                }
                None if item.text == "invert" => invert = true,
                Some(("idle", "low")) => idle = Some(false),
                Some(("idle", "high")) => idle = Some(true),
                Some(("idle", _)) => return Err(self.wrong(&item, "idle is low or high")),
                _ => return Err(self.unknown(&item, "oversample= invert idle=")),
            }
        }
        Ok(Kind::Wave {
            path,
            oversample,
            invert,
            idle,
        })
    }

    fn sim(&self, mut items: Vec<Item>) -> Result<Kind, ParseError> {
        let mut config = Config::default();
        // Which motion, which timeout, then what belongs to them, in whatever order they were given.
        items.sort_by_key(|item| !matches!(item.pair(), Some(("motion" | "timeout", _))));
        let mut fast = false;
        for item in items {
            match item.pair() {
                None if item.text == "fast" => fast = true,
                pair => {
                    let (key, value) = pair.unwrap_or((&item.text, ""));
                    let value_at = if Config::knows(key) && pair.is_some() {
                        key.len() + 1
                    } else {
                        0
                    };
                    let known = Config::knows(key);
                    config.set(key, value).map_err(|error| {
                        let error = self.inside(&item, error, value_at);
                        if known {
                            error
                        } else {
                            error.also("\n    fast (never sleeps, not even to keep an interval)")
                        }
                    })?;
                }
            }
        }
        Ok(Kind::Sim {
            config: Box::new(config),
            fast,
        })
    }

    /// Whether `slaves=` fits the frame behind it.
    fn shared_out(&self, config: &Config, frame: &Frame) -> Result<(), ParseError> {
        let mut config = config.clone();
        config.format = frame.format.clone();
        let error = match config.chain() {
            Ok(_) => return Ok(()),
            Err(error) => error,
        };
        let at = self.text.find("slaves=").unwrap_or_default();
        let length = self.text[at..].find(',').unwrap_or(self.text.len() - at);
        Err(error.about(self.text, at..at + length))
    }

    fn file(&self, items: Vec<Item>) -> Result<Kind, ParseError> {
        /// 64 channels: no logic analyser's samples are wider.
        const MOST_UNIT: u8 = 8;
        let mut items = items.into_iter();
        let path = items.next().ok_or_else(|| self.missing("a path"))?;
        let (mut ma, mut slo, mut rate, mut unit) = (None, None, None, None);
        for item in items {
            match item.pair() {
                Some(("ma" | "slo", "")) => {
                    return Err(self.wrong(&item, "a channel has a name or a number"));
                }
                Some(("ma", name)) => ma = Some(name.to_owned()),
                Some(("slo", name)) => slo = Some(name.to_owned()),
                Some(("rate", text)) => {
                    let hz = text.parse();
                    rate = Some(hz.map_err(|error| self.inside(&item, error, "rate=".len()))?);
                }
                Some(("unit", text)) => {
                    let fits = |n: &u8| (1..=MOST_UNIT).contains(n);
                    let bytes = text.parse().ok().filter(fits).ok_or_else(|| {
                        self.wrong(&item, format!("unit is 1 to {MOST_UNIT} bytes a sample"))
                    })?;
                    unit = Some(bytes);
                }
                _ => return Err(self.unknown(&item, "ma= slo= rate= unit=")),
            }
        }
        Ok(Kind::File {
            path: PathBuf::from(path.text),
            ma,
            slo,
            rate,
            unit,
        })
    }

    /// The command is the shell's: its commas are no separators, and nothing in it is an option of ours.
    fn exec(&self, from: usize) -> Result<Process, ParseError> {
        /// With a longer one no clock would be fast enough for BiSS-C: it takes two.
        const LONGEST: Nanos = Nanos(5_000);
        let (mut tick, mut silence) = (None, None);
        let mut at = from;
        loop {
            let rest = &self.text[at.min(self.text.len())..];
            let (name, value, twin) = match rest.split_once('=') {
                Some((name @ "tick", value)) => (name, value, &mut tick),
                Some((name @ "silence", value)) => (name, value, &mut silence),
                _ => break,
            };
            let value = value.split_once(',').map_or(value, |(value, _)| value);
            let value_at = at + name.len() + 1;
            let wrong = |what: &str| {
                let end = value_at + value.len();
                let hint = "write it like exec:tick=10ns,silence=60s,vvp slave.vvp";
                ParseError::new(self.text, at..end, what, hint)
            };
            if twin.is_some() {
                return Err(wrong("this option is there already"));
            }
            let time: Nanos = value
                .parse()
                .map_err(|e: ParseError| e.within(self.text, value_at))?;
            match name {
                _ if time.0 == 0 => return Err(wrong("no time at all")),
                "tick" if time > LONGEST => return Err(wrong("tick is 1 ns to 5 us")),
                _ => *twin = Some(time),
            }
            at = value_at + value.len() + 1;
        }
        let command = self.text.get(at..).unwrap_or_default();
        if command.trim().is_empty() {
            return Err(self.missing("a command that plays the slave: exec:vvp slave.vvp"));
        }
        Ok(Process {
            tick: tick.unwrap_or(TICK),
            silence: silence.unwrap_or(SILENCE),
            command: command.to_owned(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spec(text: &str) -> Spec {
        text.parse().unwrap_or_else(|e| panic!("{e}"))
    }

    #[test]
    fn reads_every_kind() {
        let gpio = Kind::Gpio {
            chip: Some("0".into()),
            ma: "17".into(),
            slo: "27".into(),
            mo: None,
            uapi: None,
            far: None,
        };
        assert_eq!(
            spec("gpio:0,ma=17,slo=27"),
            Spec {
                kind: gpio,
                frame: None
            }
        );
        let gpio = Kind::Gpio {
            chip: None,
            ma: "GPIO17".into(),
            slo: "a,b".into(),
            mo: Some("GPIO22".into()),
            uapi: Some(Uapi::V2),
            far: Some(Far {
                ma_in: "GPIO23".into(),
                slo_out: "GPIO24".into(),
            }),
        };
        assert_eq!(
            spec(r"gpio:uapi=v2,ma=GPIO17,mo=GPIO22,slo=a\,b,slo-out=GPIO24,ma-in=GPIO23").kind,
            gpio
        );
        let spi = Kind::Spi {
            path: "/dev/spidev0.1".into(),
            phase: Some(Phase::Half),
            pad: 3,
        };
        assert_eq!(spec("spi:0.1,phase=2,pad=3").kind, spi);
        let spec_with_frame = spec("spi:0.0,frame=st26,nE,nW,crc6");
        assert_eq!(
            spec_with_frame.frame.map(|f| f.to_string()),
            Some("st26,nE,nW,crc6".into())
        );
        let wave = Kind::Wave {
            path: "/dev/spidev1.0".into(),
            oversample: Some(16),
            invert: true,
            idle: Some(false),
        };
        assert_eq!(spec("wave:1.0,oversample=16,invert,idle=low").kind, wave);
        let file = Kind::File {
            path: r"a,b\c.vcd".into(),
            ma: Some("clk".into()),
            slo: None,
            rate: None,
            unit: None,
        };
        assert_eq!(spec(r"file:a\,b\c.vcd,ma=clk").kind, file);
        let raw = Kind::File {
            path: "-".into(),
            ma: Some("0".into()),
            slo: Some("11".into()),
            rate: Some(Hertz(12_500_000)),
            unit: Some(2),
        };
        assert_eq!(spec("file:-,rate=12.5MHz,unit=2,ma=0,slo=11").kind, raw);
        assert!(matches!(spec("sim").kind, Kind::Sim { fast: false, .. }));
        assert_eq!(
            spec("sim:rpm=6000,motion=speed"),
            spec("sim:motion=speed,rpm=6000")
        );
        assert_eq!(
            spec("sim:tclk=1us,timeout=adaptive"),
            spec("sim:timeout=adaptive,tclk=1us")
        );
        let Kind::Sim { config, fast } = spec("sim:fast,delay=3us,frame=st8,crc6").kind else {
            panic!()
        };
        assert!(fast);
        assert_eq!(config.delay.0, 3_000);
    }

    #[test]
    fn a_command_takes_the_rest() {
        let exec = |tick, silence, command: &str| {
            let command = command.into();
            Kind::Exec(Process {
                tick: Nanos(tick),
                silence: Nanos(silence),
                command,
            })
        };
        let ten_s = 10_000_000_000;
        for (text, kind) in [
            ("exec:cat", exec(8, ten_s, "cat")),
            (
                r"exec:a\,b,frame=st8 x=y",
                exec(8, ten_s, r"a\,b,frame=st8 x=y"),
            ),
            ("exec:tick=10ns,cat", exec(10, ten_s, "cat")),
            (
                "exec:silence=1s,tick=1us,frame=st8",
                exec(1_000, 1_000_000_000, "frame=st8"),
            ),
            ("exec:ticks=1,b", exec(8, ten_s, "ticks=1,b")),
            ("exec: tick=1us,b", exec(8, ten_s, " tick=1us,b")),
        ] {
            assert_eq!(spec(text), Spec { kind, frame: None }, "{text}");
        }
    }

    #[test]
    fn errors_mark_the_place() {
        for (text, place, words) in [
            ("spy:0.0", 0..3, "unknown link `spy`"),
            ("", 0..0, "unknown link"),
            ("gpio:0,ma=17", 12..12, "slo=LINE"),
            ("gpio:ma=17,slo=27", 17..17, "needs a chip"),
            ("gpio:0,ma=17,slo=17", 19..19, "two different lines"),
            ("gpio:0,ma=17,slo=27,pull=up", 20..24, "no option `pull`"),
            ("gpio:0,ma=17,slo=27,mo=17", 25..25, "three different lines"),
            ("gpio:0,ma=17,slo=27,mo=27", 25..25, "three different lines"),
            ("gpio:0,ma=17,slo=27,mo=", 20..23, "number or a name"),
            ("gpio:ma=A,slo=B,mo=22", 21..21, "needs a chip"),
            ("gpio:0,ma=17,slo=27,uapi=3", 20..26, "v1 or v2"),
            ("gpio:0,ma=17,slo=27,uapi=", 20..25, "v1 or v2"),
            ("gpio:uapi=v1,uapi=v2,ma=a,slo=b", 13..20, "there already"),
            ("gpio:0,ma=17,slo=27,ma-in=22", 28..28, "slo-out=LINE"),
            (
                "gpio:0,ma=17,slo=27,ma-in=22,slo-out=17",
                39..39,
                "four different lines",
            ),
            ("gpio:0,ma=,slo=27", 7..10, "number or a name"),
            ("spi:0", 4..5, "not BUS.CS"),
            ("spi:0.0,phase=1", 8..15, "auto, 2 or 3"),
            ("spi:0.0,pad=999", 8..15, "0 to 255"),
            ("wave:", 5..5, "wave:0.0"),
            ("wave:0.0,oversample=3", 9..21, "4 to 64"),
            ("wave:0.0,idle=up", 9..16, "low or high"),
            ("wave:0.0,inverted", 9..17, "no option `inverted`"),
            ("sim:dellay=3us", 4..10, "no `dellay`"),
            ("sim:seed=1,delay=3", 17..18, "no unit"),
            ("sim:slow", 4..8, "no `slow`"),
            (
                "sim:seed=1,slaves=1:2,cds=0,frame=st8+st8",
                11..21,
                "have 3 channels, the frame has 2",
            ),
            ("sim:seed=1,slaves=1:x", 18..21, "does not fit `slaves`"),
            ("sim:refuse=0x7F..0x80", 11..21, "0x00 to 0x7F"),
            ("sim:foo=1", 4..7, "fast"),
            ("sim:seed=1,seed=2", 11..17, "there already"),
            ("sim:motion=still,rpm=60", 21..23, "only with motion=speed"),
            (
                "sim:tclk=1us,timeout=20us",
                9..12,
                "only with timeout=adaptive",
            ),
            ("gpio:0,ma=17,ma=18,slo=2", 13..18, "there already"),
            ("file:", 5..5, "needs a path"),
            ("file:x.bin,rate=100", 16..19, "no unit"),
            ("file:x.bin,rate=0Hz", 16..19, "out of range"),
            (r"file:x.bin,rate=1\,5MHz", 11..23, "unknown unit"),
            ("file:x.bin,rate=1MHz,unit=9", 21..27, "1 to 8 bytes"),
            ("file:x.bin,unit=0", 11..17, "1 to 8 bytes"),
            ("file:x.bin,ma=", 11..14, "a name or a number"),
            ("file:x.bin,clock=1MHz", 11..16, "no option `clock`"),
            ("sim:frame=st26,sx", 15..17, "unknown field"),
            ("exec:", 5..5, "needs a command"),
            ("exec", 4..4, "needs a command"),
            ("exec:tick=8ns", 13..13, "needs a command"),
            ("exec:tick=8ns, ", 15..15, "needs a command"),
            ("exec:tick=8,cat", 10..11, "no unit"),
            ("exec:tick=0ns,cat", 5..13, "no time"),
            ("exec:tick=6us,cat", 5..13, "1 ns to 5 us"),
            ("exec:tick=1ns,tick=1ns,cat", 14..22, "there already"),
            ("exec:silence=0s,cat", 5..15, "no time"),
        ] {
            let error = text.parse::<Spec>().unwrap_err();
            assert_eq!(error.span(), place, "{error}");
            assert!(error.to_string().contains(words), "{error}");
        }
    }

    #[test]
    fn no_text_panics() {
        let seed = fastrand::u64(..);
        println!("seed {seed}");
        let mut rng = fastrand::Rng::with_seed(seed);
        let parts = [
            "gpio:", "spi:", "wave:", "sim:", "file:", "exec:", "tick=", "ma=", "slo=", "mo=",
            "uapi=", "v2", "0.0", ",", "\\", "=", "frame=", "st26", "é", "delay=", "1us", "phase=",
        ];
        for _ in 0..20_000 {
            let text: String = (0..rng.usize(0..9))
                .map(|_| *rng.choice(&parts).unwrap())
                .collect();
            if let Err(error) = text.parse::<Spec>() {
                assert!(
                    text.get(error.span()).is_some(),
                    "{text}: {:?}",
                    error.span()
                );
                error.to_string();
            }
        }
    }
}
