//! The steps of `biss loopback`, for people and for scripts.

use crate::cli::ReportFormat;
use biss::cycle::Fault;
use biss::link::{Clock, Known, Uapi};
use biss::loopback::{Echo, Shows, Wiring};
use biss::unit::Hertz;
use serde::ser::{Serialize, SerializeMap, Serializer};
use std::fmt::{self, Display};

/// A step as a line, or a few where something is wrong.
pub(crate) fn render<S: Display + Serialize>(
    step: &S,
    format: ReportFormat,
) -> Result<String, serde_json::Error> {
    let mut text = match format {
        ReportFormat::Text => step.to_string(),
        ReportFormat::Json => serde_json::to_string(step)?,
    };
    text.push('\n');
    Ok(text)
}

/// Frames over a link of which both ends are in hand.
pub(crate) struct Frames {
    pub(crate) rig: &'static str,
    /// The clock that was tried, where that is not simply the one that ran.
    pub(crate) asked: Option<Hertz>,
    pub(crate) clock: Option<Clock>,
    /// How many should have run.
    pub(crate) count: u64,
    pub(crate) run: u64,
    pub(crate) as_sent: u64,
    /// Positions that the slave did not send. There must not be any.
    pub(crate) wrong: u64,
    /// By [`Fault::index`].
    pub(crate) faults: [u64; Fault::NAMES.len()],
}

impl Frames {
    pub(crate) fn new(rig: &'static str, count: u64) -> Frames {
        Frames {
            rig,
            asked: None,
            clock: None,
            count,
            run: 0,
            as_sent: 0,
            wrong: 0,
            faults: [0; Fault::NAMES.len()],
        }
    }

    pub(crate) fn is_good(&self) -> bool {
        self.as_sent == self.count
    }

    fn kinds(&self) -> impl Iterator<Item = (&'static str, u64)> {
        Fault::NAMES
            .into_iter()
            .zip(self.faults)
            .filter(|(_, count)| *count > 0)
    }
}

impl Display for Frames {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "  {}", self.rig)?;
        if let Some(asked) = self.asked {
            write!(f, "  asked {asked}")?;
        }
        if let Some(clock) = self.clock {
            write!(f, "  MA {clock}")?;
        }
        write!(f, "  {} of {} frames as sent", self.as_sent, self.run)?;
        for (name, count) in self.kinds() {
            write!(f, ", {count} {name}")?;
        }
        if self.wrong > 0 {
            write!(f, ", {} WRONG POSITIONS", self.wrong)?;
        }
        if self.run < self.count {
            write!(f, ", given up")?;
        }
        Ok(())
    }
}

impl Serialize for Frames {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = head(serializer, "frames", self.is_good())?;
        map.serialize_entry("rig", self.rig)?;
        if let Some(asked) = self.asked {
            map.serialize_entry("asked_hz", &asked.0)?;
        }
        if let Some(clock) = self.clock {
            map.serialize_entry("clock_hz", &clock.hz.0)?;
            map.serialize_entry("measured", &(clock.known == Known::Measured))?;
        }
        map.serialize_entry("frames", &self.run)?;
        map.serialize_entry("as_sent", &self.as_sent)?;
        map.serialize_entry("wrong", &self.wrong)?;
        map.serialize_entry("faults", &Kinds(self))?;
        map.end()
    }
}

struct Kinds<'a>(&'a Frames);

impl Serialize for Kinds<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.kinds())
    }
}

fn head<S: Serializer>(serializer: S, step: &str, ok: bool) -> Result<S::SerializeMap, S::Error> {
    let mut map = serializer.serialize_map(None)?;
    map.serialize_entry("type", "loopback")?;
    map.serialize_entry("step", step)?;
    map.serialize_entry("ok", &ok)?;
    Ok(map)
}

/// Where an output of ours arrives although no jumper should bring it there.
pub(crate) struct Found {
    /// The output's key in the link.
    pub(crate) output: &'static str,
    pub(crate) line: String,
}

impl Display for Found {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}= arrives at {}", self.output, self.line)
    }
}

/// The jumpers of a GPIO loopback.
pub(crate) struct Wires {
    pub(crate) wiring: Wiring,
    pub(crate) found: Vec<Found>,
    pub(crate) uapi: Uapi,
}

impl Wires {
    fn complaints(&self) -> Vec<String> {
        let found = self.found.iter().map(Found::to_string);
        self.wiring.complaints().into_iter().chain(found).collect()
    }
}

impl Display for Wires {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "  jumpers  GPIO {}  ", self.uapi)?;
        if self.wiring.is_good() {
            return f.write_str("ma= arrives at ma-in=, slo-out= at slo=");
        }
        f.write_str(&self.complaints().join("\n            "))
    }
}

impl Serialize for Wires {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let shows = |shows| match shows {
            Shows::Own => "own",
            Shows::OwnInverted => "own-inverted",
            Shows::Other => "other",
            Shows::OtherInverted => "other-inverted",
            Shows::Stuck(true) => "stuck-high",
            Shows::Stuck(false) => "stuck-low",
            Shows::Unsteady => "unsteady",
        };
        let mut map = head(serializer, "jumpers", self.wiring.is_good())?;
        map.serialize_entry("uapi", &self.uapi.to_string())?;
        map.serialize_entry("ma_in", shows(self.wiring.ma_in))?;
        map.serialize_entry("slo", shows(self.wiring.slo))?;
        map.serialize_entry("says", &self.complaints())?;
        map.end()
    }
}

/// Bits that were sent on MOSI and came back on MISO.
pub(crate) struct Bits {
    pub(crate) asked: Hertz,
    pub(crate) sclk: Clock,
    pub(crate) bits: u64,
    pub(crate) echo: Echo,
}

impl Display for Bits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "  SCLK asked {}, runs at {}  {} bits: {}",
            self.asked, self.sclk, self.bits, self.echo
        )
    }
}

impl Serialize for Bits {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = head(serializer, "bits", self.echo == Echo::Same)?;
        map.serialize_entry("asked_hz", &self.asked.0)?;
        map.serialize_entry("sclk_hz", &self.sclk.hz.0)?;
        map.serialize_entry("measured", &(self.sclk.known == Known::Measured))?;
        map.serialize_entry("bits", &self.bits)?;
        map.serialize_entry("echo", self.echo.name())?;
        if let Echo::Differs { bits, first } = self.echo {
            map.serialize_entry("differ", &bits)?;
            map.serialize_entry("first", &first)?;
        }
        map.end()
    }
}
