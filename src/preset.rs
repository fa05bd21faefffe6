//! Encoders whose frame is published, by name: format, limits and where they stand.
//!
//! Nothing here is guessed: a number that no sheet gives is absent, an encoder whose field order or flag polarity
//! nobody has published is not in the list.

use crate::format::Format;
use crate::frame::Stall;
use crate::limits;
use crate::parse::ParseError;
use crate::unit::{Hertz, Nanos};
use std::fmt;
use std::str::FromStr;

/// A published encoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Preset {
    /// What `-f` takes.
    pub name: &'static str,
    /// What it is.
    pub about: &'static str,
    /// Its frame.
    pub format: &'static str,
    /// Slowest MA clock.
    pub clock_min: Option<Hertz>,
    /// Fastest MA clock.
    pub clock_max: Option<Hertz>,
    /// How it finds the end of a frame.
    pub timeout: Option<Timeout>,
    /// Shortest time from the start of one frame to the start of the next.
    pub interval: Option<Nanos>,
    /// Longest time from power-on to the first good frame.
    pub power_on: Option<Nanos>,
    /// The document, and the page where it has one.
    pub source: &'static str,
    /// What else to know; doubts stand here.
    pub note: &'static str,
}

/// A published timeout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Timeout {
    /// After the last MA edge, between these two.
    Static {
        /// The shortest.
        min: Nanos,
        /// The longest.
        max: Nanos,
    },
    /// About so long after the last MA edge; the sheet gives no tolerance.
    Nominal(Nanos),
    /// As long as first falling to second rising MA edge.
    Adaptive,
    /// SLO stays low until so long after the frame began.
    FromRequest(Nanos),
}

impl fmt::Display for Timeout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Timeout::Static { min, max } => write!(f, "{min}..{max}"),
            Timeout::Nominal(time) => write!(f, "about {time}"),
            Timeout::Adaptive => f.write_str("adaptive"),
            Timeout::FromRequest(time) => write!(f, "{time} from the start of the frame"),
        }
    }
}

const RESOLUTE: Preset = Preset {
    name: "",
    about: "",
    format: "",
    clock_min: Some(Hertz(250_000)),
    clock_max: Some(Hertz(10_000_000)),
    timeout: Some(Timeout::FromRequest(Nanos(40_000))),
    interval: Some(Nanos(40_000)),
    power_on: None,
    source: "Renishaw L-9709-9005-03-F, p. 2-3",
    note: "for a ring; a linear scale of the same width has no degrees: write pos for st. \
           The sheet asks for a constant clock; Ack takes up to about 20 us",
};

const LIKA_AMM36: Preset = Preset {
    name: "",
    about: "",
    format: "",
    clock_min: None,
    clock_max: None,
    timeout: Some(Timeout::Adaptive),
    interval: None,
    power_on: None,
    source: "Lika MAN AMx36 SSI_BiSS E 1.1, p. 22",
    note: "error and warning bit are not used, they are always 1",
};

const ALL: [Preset; 12] = [
    Preset {
        name: "balluff-bml-s1g0",
        about: "Balluff BML-S1G0-B, magnetic linear, 28 bit",
        format: "pad4,pos28,nE,nW,crc6",
        clock_min: Some(Hertz(100_000)),
        clock_max: Some(Hertz(10_000_000)),
        timeout: None,
        interval: None,
        power_on: None,
        source: "Balluff BML-S1G0 user's guide, section 6.2, Tab. 6-6 and 6-7",
        note: "the guide gives the clock as 0.1...10 kHz; MHz must be meant, as BiSS-C begins at 80 kHz",
    },
    Preset {
        name: "balluff-bml-sl1",
        about: "Balluff BML SL1-ALZ1-B, magnetic linear, 24 bit",
        format: "pos24,nE,nW,crc6",
        clock_min: None,
        clock_max: Some(Hertz(10_000_000)),
        timeout: None,
        interval: None,
        power_on: None,
        source: "Balluff BML SL1-ALZ1-B user's guide, section 6.2, Tab. 6-2 and 6-3",
        note: "",
    },
    Preset {
        name: "faulhaber-aemt",
        about: "Faulhaber AEMT-12/16 L, magnetic, 16 bit of turns, 12 bit a turn",
        format: "mt16,st12,nE,nW,crc6",
        clock_min: None,
        clock_max: Some(Hertz(2_000_000)),
        timeout: Some(Timeout::Nominal(Nanos(20_000))),
        interval: None,
        power_on: None,
        source: "Faulhaber 7000.05070, 1st edition of 17-09-2020, description of the interface, Fig. 4",
        note: "the sheet says that Data and CLK are inverted against its figure. The factory presets the position for a signed \
               reading; biss counts it without sign",
    },
    Preset {
        name: "lenz-irs",
        about: "Lenz IRS and SAB, inductive ring, 24 bit",
        format: "st24,nE,nW,crc6",
        clock_min: Some(Hertz(100_000)),
        clock_max: Some(Hertz(5_000_000)),
        timeout: Some(Timeout::Static {
            min: Nanos(12_600),
            max: Nanos(13_200),
        }),
        interval: Some(Nanos(21_053)),
        power_on: None,
        source: "Lenz B3 encoder manual; lenzencoders/BISS-C",
        note: "the manual calls the error bit high when valid, and says less about the warning bit: BP3 has it active low. \
               Up to 47500 frames/s; 12.5 MHz on request; timeout 13.5us..14.5us during register access",
    },
    Preset {
        name: "lika-amm3616",
        about: "Lika AMM3616/4096SC, 12 bit of turns, 16 bit a turn",
        format: "mt12,st16,nE,nW,crc6",
        ..LIKA_AMM36
    },
    Preset {
        name: "lika-amm3619",
        about: "Lika AMM3619/4096SC, 12 bit of turns, 19 bit a turn",
        format: "mt12,st19,nE,nW,crc6",
        ..LIKA_AMM36
    },
    Preset {
        name: "lika-sma1",
        about: "Lika SMA1, magnetic linear, 24 bit",
        format: "pos24,nE,nW,crc6",
        clock_min: None,
        clock_max: None,
        timeout: None,
        interval: None,
        power_on: None,
        source: "Lika MAN SMA1 E 2.9, section 7",
        note: "in BiSS C-mode only; the same encoder is sold with BiSS B-mode, which biss does not read",
    },
    Preset {
        name: "resolute-18",
        about: "Renishaw RESOLUTE, optical, 18 bit",
        format: "st18,nE,nW,crc6",
        ..RESOLUTE
    },
    Preset {
        name: "resolute-26",
        about: "Renishaw RESOLUTE, optical, 26 bit",
        format: "st26,nE,nW,crc6",
        ..RESOLUTE
    },
    Preset {
        name: "resolute-32",
        about: "Renishaw RESOLUTE, optical, 32 bit",
        format: "st32,nE,nW,crc6",
        ..RESOLUTE
    },
    Preset {
        name: "resolute-36",
        about: "Renishaw RESOLUTE, optical, 36 bit",
        format: "pos36,nE,nW,crc6",
        note: "for a linear scale. The sheet asks for a constant clock; Ack takes up to about 20 us",
        ..RESOLUTE
    },
    Preset {
        name: "siko-msa213c",
        about: "Siko MSA213C, magnetic linear, 25 bit",
        format: "pos25,nE,nW,crc6",
        clock_min: None,
        clock_max: Some(Hertz(10_000_000)),
        timeout: Some(Timeout::Adaptive),
        interval: Some(Nanos(50_000)),
        power_on: Some(Nanos(250_000_000)),
        source: "Siko MSA213C-S (BiSS/C), Art. No. 90036 of 24.05.2022, p. 17",
        note: "the first of the 25 bits is a sign; biss counts them as one number without sign",
    },
];

/// All of them, by name.
pub const fn all() -> &'static [Preset] {
    &ALL
}

impl Preset {
    /// The preset of that name.
    pub fn named(name: &str) -> Option<&'static Preset> {
        ALL.iter().find(|preset| preset.name == name)
    }

    /// The clock of these that is nearest to `usual`.
    pub fn clock_near(&self, usual: Hertz) -> Hertz {
        let least = self.clock_min.map_or(usual, |min| usual.max(min));
        self.clock_max.map_or(least, |max| least.min(max))
    }

    /// How to judge stalls, and how long SL = 1 is awaited. Nothing is trusted further than it says: a time without a
    /// tolerance changes nothing, and no MA level may last longer than every slave bears.
    pub fn judged(&self) -> (Stall, Nanos) {
        let usual = Nanos(limits::TIMEOUT_MAX_NS);
        match self.timeout {
            Some(Timeout::Static { min, max }) => {
                let min = min.0.min(limits::LEVEL_MAX_NS);
                let min_ns = u32::try_from(min).unwrap_or(u32::MAX);
                (Stall::Static { min_ns }, max)
            }
            Some(Timeout::Adaptive) => (Stall::Adaptive, usual),
            // Not adaptive: a stopped clock ends the frame early, but the first levels must not be stretched.
            Some(Timeout::FromRequest(time)) => (Stall::Unknown, time),
            Some(Timeout::Nominal(_)) | None => (Stall::Unknown, usual),
        }
    }

    /// What is wrong with a clock, if anything.
    pub fn clock_outside(&self, clock: Hertz) -> Option<String> {
        let (what, limit) = match (self.clock_min, self.clock_max) {
            (Some(min), _) if clock < min => ("below the least", min),
            (_, Some(max)) if clock > max => ("above the most", max),
            _ => return None,
        };
        let (name, source) = (self.name, self.source);
        Some(format!(
            "MA at {clock} is {what} that {name} is made for, {limit} ({source})"
        ))
    }

    /// What is wrong with an interval, if anything.
    pub fn interval_outside(&self, interval: Nanos) -> Option<String> {
        let least = self.interval.filter(|least| interval < *least)?;
        let (name, source) = (self.name, self.source);
        Some(format!(
            "frames every {interval} are closer than {name} is made for, {least} ({source})"
        ))
    }

    /// What is wrong with a timeout of the user's own, if anything: with how long he lets MA stand, and with how long
    /// he awaits SL = 1.
    pub fn timeout_outside(&self, stall: Stall, max: Nanos) -> Option<String> {
        let published = self.timeout?;
        let (min, longest) = match published {
            Timeout::Static { min, max } => (Some(min), max),
            Timeout::Nominal(time) => (Some(time), time),
            Timeout::Adaptive => (None, Nanos(0)),
            Timeout::FromRequest(time) => (None, time),
        };
        let fits = match stall {
            Stall::Unknown => true,
            Stall::Static { min_ns } => min.is_some_and(|min| u64::from(min_ns) <= min.0),
            Stall::Adaptive => published == Timeout::Adaptive,
        };
        let (name, source) = (self.name, self.source);
        (!fits || max < longest).then(|| {
            format!("--timeout does not fit {name}, whose timeout is {published} ({source})")
        })
    }
}

/// What `-f`, `BISS_FRAME` and `frame=` take: a format, or the name of a preset.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// What follows CDS.
    pub format: Format,
    /// Where it was chosen by name.
    pub preset: Option<&'static Preset>,
}

impl FromStr for Frame {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Frame, ParseError> {
        if let Some(preset) = Preset::named(text) {
            return Ok(Frame {
                format: preset.format.parse()?,
                preset: Some(preset),
            });
        }
        match text.parse() {
            Ok(format) => Ok(Frame {
                format,
                preset: None,
            }),
            Err(error) if !looks_like_a_name(text) => Err(error),
            Err(error) => {
                let names: Vec<&str> = ALL.iter().map(|preset| preset.name).collect();
                let hint = format!("presets are {}", names.join(" "));
                let what = format!("`{text}` is neither a frame format nor a preset");
                Err(error.instead(&what).also(&format!("\n  {hint}")))
            }
        }
    }
}

/// One word that does not begin as a field does.
fn looks_like_a_name(text: &str) -> bool {
    let letters = text.find(|c: char| !c.is_ascii_alphabetic());
    let first = &text[..letters.unwrap_or(text.len())];
    let field = ["mt", "st", "pos", "pad", "data", "lc", "crc", ""].contains(&first);
    !text.contains([',', '+']) && (!field || text.contains('-'))
}

impl fmt::Display for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.preset {
            Some(preset) => f.write_str(preset.name),
            None => write!(f, "{}", self.format),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(name: &str) -> Preset {
        *Preset::named(name).unwrap_or_else(|| panic!("no {name}"))
    }

    #[test]
    fn every_format_parses_and_no_name_is_a_format() {
        for preset in all() {
            let name = preset.name;
            let format: Format = preset.format.parse().unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(format.to_string(), preset.format, "{name}");
            for channel in format.channels() {
                assert!(
                    channel.crc().is_some() && channel.position().is_some(),
                    "{name}"
                );
            }
            assert!(name.parse::<Format>().is_err(), "{name}");
            let frame: Frame = name.parse().unwrap_or_else(|e| panic!("{e}"));
            assert_eq!((frame.format, frame.preset), (format, Some(preset)));
        }
        let sorted = all().windows(2).all(|pair| pair[0].name < pair[1].name);
        assert!(sorted, "names are found by eye, and once");
    }

    #[test]
    fn limits_are_within_biss_c_and_have_a_source() {
        let clocks = Hertz(limits::CLOCK_MIN_HZ)..=Hertz(10_000_000);
        for preset in all() {
            let Preset {
                name,
                clock_min,
                clock_max,
                ..
            } = *preset;
            for clock in [clock_min, clock_max].into_iter().flatten() {
                assert!(clocks.contains(&clock), "{name}: {clock}");
            }
            if let (Some(min), Some(max)) = (clock_min, clock_max) {
                assert!(min < max, "{name}");
            }
            let times = match preset.timeout {
                Some(Timeout::Static { min, max }) => vec![min, max],
                Some(Timeout::Nominal(time) | Timeout::FromRequest(time)) => vec![time],
                Some(Timeout::Adaptive) | None => vec![],
            };
            for time in times {
                let range = limits::TIMEOUT_MIN_NS..=limits::TIMEOUT_MAX_NS;
                assert!(range.contains(&time.0), "{name}: {time}");
            }
            if let Some(interval) = preset.interval {
                // Every slave supports this cycle time (D2 Table 10).
                assert!((10_000..=250_000).contains(&interval.0), "{name}");
            }
            assert!(!preset.source.is_empty() && !preset.about.is_empty());
        }
    }

    #[test]
    fn an_unknown_name_lists_the_names_and_the_fields() {
        for text in [
            "resolute",
            "resolute-27",
            "stegmann",
            "st-26",
            "Resolute-26",
        ] {
            let error = text.parse::<Frame>().unwrap_err();
            assert_eq!(error.span(), 0..text.len());
            let said = error.to_string();
            for word in ["neither", "resolute-26", "siko-msa213c", "mtN stN", "crcN"] {
                assert!(said.contains(word), "{text}: no {word} in {said}");
            }
        }
        for text in ["st26,nE,nF", "st0", "sx12,st4", "", "é"] {
            let error = text.parse::<Frame>().unwrap_err();
            let format = text.parse::<Format>().unwrap_err();
            let name = looks_like_a_name(text);
            assert_eq!(error == format, !name, "{error}");
            error.to_string();
        }
    }

    #[test]
    fn what_is_published_is_applied_and_nothing_more() {
        let judged = |name: &str| {
            let (stall, max) = named(name).judged();
            (stall, max.0)
        };
        let twelve = Stall::Static { min_ns: 12_000 };
        assert_eq!(judged("lenz-irs"), (twelve, 13_200));
        assert_eq!(judged("siko-msa213c"), (Stall::Adaptive, 40_000));
        // Its sheet asks for a constant clock, which an adaptive timeout would have stretched.
        assert_eq!(judged("resolute-26"), (Stall::Unknown, 40_000));
        assert_eq!(judged("faulhaber-aemt"), (Stall::Unknown, 40_000));
        assert_eq!(judged("lika-sma1"), (Stall::Unknown, 40_000));
    }

    #[test]
    fn what_is_outside_is_said_with_its_source() {
        let resolute = named("resolute-26");
        let said = resolute.clock_outside(Hertz(100_000)).unwrap();
        assert!(
            said.contains("250kHz") && said.contains(resolute.source),
            "{said}"
        );
        assert!(resolute.clock_outside(Hertz(20_000_000)).is_some());
        for inside in [250_000, 1_000_000, 10_000_000] {
            assert_eq!(resolute.clock_outside(Hertz(inside)), None);
        }
        assert!(resolute.interval_outside(Nanos(39_999)).is_some());
        assert_eq!(resolute.interval_outside(Nanos(40_000)), None);
        assert_eq!(named("lika-sma1").interval_outside(Nanos(1)), None);
        assert_eq!(named("lika-sma1").clock_outside(Hertz(1)), None);

        let lenz =
            |min_ns, max| named("lenz-irs").timeout_outside(Stall::Static { min_ns }, Nanos(max));
        assert_eq!(lenz(12_600, 13_200), None);
        assert!(lenz(12_601, 40_000).is_some() && lenz(12_000, 13_199).is_some());
        let forty = Nanos(40_000);
        let adaptive = |name: &str| named(name).timeout_outside(Stall::Adaptive, forty);
        assert!(adaptive("lenz-irs").is_some() && adaptive("resolute-26").is_some());
        assert_eq!(adaptive("siko-msa213c"), None);
        assert_eq!(adaptive("lika-sma1"), None);
    }

    #[test]
    fn the_usual_clock_gives_way_to_the_published_one() {
        let near = |name: &str, hz| named(name).clock_near(Hertz(hz)).0;
        assert_eq!(near("resolute-26", 1_000_000), 1_000_000);
        assert_eq!(near("resolute-26", 100_000), 250_000);
        assert_eq!(near("faulhaber-aemt", 5_000_000), 2_000_000);
        assert_eq!(near("lika-sma1", 5_000_000), 5_000_000);
    }
}
