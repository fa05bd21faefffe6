//! What `biss list` found, for people and for scripts.

use crate::cli::ReportFormat;
use biss::unit::{Hertz, Nanos};
use serde::Serialize;
use std::fmt::{self, Display};

/// Everything that was found.
#[derive(Debug, Default)]
pub(crate) struct Report {
    pub(crate) board: Board,
    pub(crate) chips: Vec<Chip>,
    pub(crate) spidevs: Vec<Spidev>,
    pub(crate) encoders: Vec<Encoder>,
    pub(crate) missing: Vec<Missing>,
    pub(crate) settings: Vec<Setting>,
    pub(crate) presets: Vec<Preset>,
}

/// The machine.
#[derive(Debug, Default, Serialize)]
pub(crate) struct Board {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) model: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) kernel: Option<String>,
    pub(crate) arch: &'static str,
}

/// A device that this user may open, or why not and what helps.
#[derive(Debug, Serialize)]
#[serde(untagged)]
pub(crate) enum Access<T> {
    Open(T),
    Refused { error: String, fix: String },
}

/// A GPIO chip.
#[derive(Debug, Serialize)]
pub(crate) struct Chip {
    /// How links name it.
    pub(crate) link: String,
    pub(crate) path: String,
    /// Whether this user may open it.
    pub(crate) open: bool,
    #[serde(flatten)]
    pub(crate) inside: Access<ChipInside>,
}

/// What an open chip says of itself.
#[derive(Debug, Serialize)]
pub(crate) struct ChipInside {
    pub(crate) name: String,
    pub(crate) label: String,
    /// The GPIO interface that biss would use.
    pub(crate) uapi: &'static str,
    /// Number of lines.
    #[serde(rename = "lines", serialize_with = "count")]
    pub(crate) lines: Vec<Line>,
}

/// Lines are records of their own; their chip has the number.
fn count<S: serde::Serializer>(lines: &[Line], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_u64(lines.len() as u64)
}

/// A line of a chip.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Line {
    /// The chip's name.
    pub(crate) chip: String,
    pub(crate) line: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) name: Option<String>,
    pub(crate) direction: &'static str,
    pub(crate) used: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) consumer: Option<String>,
}

/// A spidev.
#[derive(Debug, Serialize)]
pub(crate) struct Spidev {
    /// SCLK is MA.
    pub(crate) link: String,
    /// MOSI is MA.
    pub(crate) wave: String,
    pub(crate) path: String,
    /// The controller's driver.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) driver: Option<String>,
    pub(crate) open: bool,
    #[serde(flatten)]
    pub(crate) inside: Access<Empty>,
}

/// Nothing to say beyond that it opens.
#[derive(Debug, Serialize)]
pub(crate) struct Empty {}

/// An encoder that a configuration has. What it does not say is absent.
#[derive(Debug, Serialize)]
pub(crate) struct Encoder {
    pub(crate) name: String,
    pub(crate) file: String,
    pub(crate) link: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) frame: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) clock_hz: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) interval_ns: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) timeout: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) zero: Option<String>,
    pub(crate) reverse: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) resolution: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) unit: Option<&'static str>,
}

/// What could be there and is not.
#[derive(Debug, Serialize)]
pub(crate) struct Missing {
    /// `gpio`, `spi` or `config`.
    pub(crate) what: &'static str,
    pub(crate) why: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) fix: Option<String>,
}

/// A setting of the kernel, or a limit of this user.
#[derive(Debug, Serialize)]
pub(crate) struct Setting {
    pub(crate) name: &'static str,
    pub(crate) value: String,
    pub(crate) means: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) fix: Option<String>,
}

/// An encoder with a name. What its sheet does not say is absent.
#[derive(Debug, Serialize)]
pub(crate) struct Preset {
    pub(crate) name: &'static str,
    pub(crate) about: &'static str,
    pub(crate) frame: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) clock_min_hz: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) clock_max_hz: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) timeout: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) interval_ns: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) power_on_ns: Option<u64>,
    pub(crate) source: &'static str,
    #[serde(skip_serializing_if = "str::is_empty")]
    pub(crate) note: &'static str,
}

/// One line of `-o json`.
#[derive(Serialize)]
#[serde(tag = "type")]
enum Record<'a> {
    #[serde(rename = "list-board")]
    Board(&'a Board),
    #[serde(rename = "list-chip")]
    Chip(&'a Chip),
    #[serde(rename = "list-line")]
    Line(&'a Line),
    #[serde(rename = "list-spidev")]
    Spidev(&'a Spidev),
    #[serde(rename = "list-encoder")]
    Encoder(&'a Encoder),
    #[serde(rename = "list-missing")]
    Missing(&'a Missing),
    #[serde(rename = "list-setting")]
    Setting(&'a Setting),
    #[serde(rename = "list-preset")]
    Preset(&'a Preset),
}

impl Chip {
    pub(crate) fn new(number: u32, path: String, inside: Access<ChipInside>) -> Chip {
        Chip {
            link: format!("gpio:{number}"),
            path,
            open: inside.opened().is_some(),
            inside,
        }
    }
}

impl Spidev {
    pub(crate) fn new(
        bus: u32,
        cs: u32,
        path: String,
        driver: Option<String>,
        refused: Option<Access<Empty>>,
    ) -> Spidev {
        // Without CPHA there is no mode 3 (drivers/spi/spi-bcm2835aux.c, mode_bits).
        let half = driver.as_deref() == Some("spi-bcm2835aux");
        let phase = if half { ",phase=2" } else { "" };
        Spidev {
            link: format!("spi:{bus}.{cs}{phase}"),
            wave: format!("wave:{bus}.{cs}"),
            path,
            driver,
            open: refused.is_none(),
            inside: refused.unwrap_or(Access::Open(Empty {})),
        }
    }
}

impl<T> Access<T> {
    fn opened(&self) -> Option<&T> {
        match self {
            Access::Open(inside) => Some(inside),
            Access::Refused { .. } => None,
        }
    }
}

impl Report {
    /// All of it in one format. Text counts free lines and names presets, unless `all` wants everything of them.
    pub(crate) fn render(&self, format: ReportFormat, all: bool) -> serde_json::Result<String> {
        match format {
            ReportFormat::Text => Ok(Text { report: self, all }.to_string()),
            ReportFormat::Json => self.json(),
        }
    }

    fn records(&self) -> impl Iterator<Item = Record<'_>> {
        let chips = self.chips.iter().flat_map(|chip| {
            let lines = chip.inside.opened().map_or(&[][..], |inside| &inside.lines);
            std::iter::once(Record::Chip(chip)).chain(lines.iter().map(Record::Line))
        });
        std::iter::once(Record::Board(&self.board))
            .chain(chips)
            .chain(self.spidevs.iter().map(Record::Spidev))
            .chain(self.encoders.iter().map(Record::Encoder))
            .chain(self.missing.iter().map(Record::Missing))
            .chain(self.settings.iter().map(Record::Setting))
            .chain(self.presets.iter().map(Record::Preset))
    }

    fn json(&self) -> serde_json::Result<String> {
        let mut out = String::new();
        for record in self.records() {
            out.push_str(&serde_json::to_string(&record)?);
            out.push('\n');
        }
        Ok(out)
    }
}

/// Names come from devices, and a terminal obeys what it is sent.
struct Clean<'a>(&'a str);

impl Display for Clean<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let direction = |c: char| matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
        let shown: String = self
            .0
            .chars()
            .map(|c| {
                if c.is_control() || direction(c) {
                    '?'
                } else {
                    c
                }
            })
            .collect();
        f.pad(&shown)
    }
}

/// For people.
struct Text<'a> {
    report: &'a Report,
    all: bool,
}

impl Display for Text<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let report = self.report;
        write!(f, "{}", report.board)?;
        f.write_str("\nGPIO\n")?;
        for chip in &report.chips {
            self.chip(f, chip)?;
        }
        self.missing(f, "gpio")?;
        f.write_str("\nSPI\n")?;
        for spidev in &report.spidevs {
            self.spidev(f, spidev)?;
        }
        self.missing(f, "spi")?;
        self.encoders(f)?;
        self.settings(f)?;
        self.presets(f)?;
        if report.chips.is_empty() && report.spidevs.is_empty() {
            f.write_str("\nNothing to connect an encoder to; `biss read sim` needs none.\n")?;
        }
        Ok(())
    }
}

fn fix(f: &mut fmt::Formatter<'_>, indent: usize, fix: &str) -> fmt::Result {
    writeln!(f, "{:indent$}fix: {}", "", Clean(fix))
}

impl Display for Board {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let model = self.model.as_deref().unwrap_or("unknown board");
        let kernel = self.kernel.as_deref().unwrap_or("of unknown release");
        writeln!(
            f,
            "{}, Linux {}, {}",
            Clean(model),
            Clean(kernel),
            self.arch
        )
    }
}

impl Text<'_> {
    fn chip(&self, f: &mut fmt::Formatter<'_>, chip: &Chip) -> fmt::Result {
        write!(f, "  {}  ", Clean(&chip.link))?;
        match &chip.inside {
            Access::Open(inside) => {
                writeln!(
                    f,
                    "{} [{}], {} lines, GPIO {}",
                    Clean(&inside.name),
                    Clean(&inside.label),
                    inside.lines.len(),
                    inside.uapi
                )?;
                self.lines(f, &inside.lines)
            }
            Access::Refused { error, fix: remedy } => {
                writeln!(f, "{}: {}", Clean(&chip.path), Clean(error))?;
                fix(f, 4, remedy)
            }
        }
    }

    fn lines(&self, f: &mut fmt::Formatter<'_>, lines: &[Line]) -> fmt::Result {
        let shown: Vec<&Line> = lines.iter().filter(|line| self.all || line.used).collect();
        let name = |line: &Line| Clean(line.name.as_deref().unwrap_or("-")).to_string();
        let widest = shown.iter().map(|line| name(line).chars().count()).max();
        let width = widest.unwrap_or_default();
        for line in &shown {
            let holder = match (&line.consumer, line.used) {
                (Some(consumer), true) => format!("held by {}", Clean(consumer)),
                (None, true) => "in use".to_owned(),
                (_, false) => "free".to_owned(),
            };
            writeln!(
                f,
                "    {:>3}  {:width$}  {:6}  {holder}",
                line.line,
                name(line),
                line.direction
            )?;
        }
        let free = lines.iter().filter(|line| !line.used).count();
        match free {
            _ if self.all => Ok(()),
            0 => f.write_str("    no line is free\n"),
            1 => f.write_str("    1 line is free, -v shows it\n"),
            free => writeln!(f, "    {free} lines are free, -v shows them"),
        }
    }

    fn spidev(&self, f: &mut fmt::Formatter<'_>, spidev: &Spidev) -> fmt::Result {
        let widest = |of: fn(&Spidev) -> usize| self.report.spidevs.iter().map(of).max();
        let link = widest(|spidev| spidev.link.len()).unwrap_or_default();
        let wave = widest(|spidev| spidev.wave.len()).unwrap_or_default();
        write!(f, "  {:link$}  {:wave$}  ", spidev.link, spidev.wave)?;
        if let Some(driver) = &spidev.driver {
            write!(f, "{}, ", Clean(driver))?;
        }
        match &spidev.inside {
            Access::Open(_) => f.write_str("may be used\n"),
            Access::Refused { error, fix: remedy } => {
                writeln!(f, "{}", Clean(error))?;
                fix(f, 4, remedy)
            }
        }
    }

    fn missing(&self, f: &mut fmt::Formatter<'_>, what: &str) -> fmt::Result {
        let missing = self.report.missing.iter();
        for missing in missing.filter(|missing| missing.what == what) {
            writeln!(f, "  {}", Clean(&missing.why))?;
            if let Some(remedy) = &missing.fix {
                fix(f, 4, remedy)?;
            }
        }
        Ok(())
    }

    fn encoders(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let encoders = &self.report.encoders;
        let wrong = |missing: &Missing| missing.what == "config";
        if !encoders.is_empty() || self.report.missing.iter().any(wrong) {
            f.write_str("\nEncoders, by name\n")?;
        }
        let widest = encoders.iter().map(|encoder| encoder.name.len()).max();
        let width = widest.unwrap_or_default();
        for encoder in encoders {
            write!(f, "  {:width$}  {}", encoder.name, Clean(&encoder.link))?;
            if let Some(frame) = &encoder.frame {
                write!(f, " -f {}", Clean(frame))?;
            }
            if self.all {
                encoder.more(f)?;
            }
            f.write_str("\n")?;
        }
        self.missing(f, "config")
    }

    fn settings(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let settings = &self.report.settings;
        if !settings.is_empty() {
            f.write_str("\nSettings\n")?;
        }
        let widest = |of: fn(&Setting) -> usize| settings.iter().map(of).max().unwrap_or_default();
        let name = widest(|setting| setting.name.len());
        let value = widest(|setting| setting.value.chars().count());
        for setting in settings {
            writeln!(
                f,
                "  {:name$}  {:value$}  {}",
                setting.name,
                Clean(&setting.value),
                Clean(&setting.means)
            )?;
            if let Some(remedy) = &setting.fix {
                fix(f, 4, remedy)?;
            }
        }
        Ok(())
    }

    fn presets(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let presets = &self.report.presets;
        f.write_str("\nPresets, for -f")?;
        f.write_str(if self.all {
            "\n"
        } else {
            "; -v has their frames, limits and sources\n"
        })?;
        let widest = presets.iter().map(|preset| preset.name.len()).max();
        let width = widest.unwrap_or_default();
        for preset in presets {
            writeln!(f, "  {:width$}  {}", preset.name, preset.about)?;
            if self.all {
                preset.more(f)?;
            }
        }
        Ok(())
    }
}

impl Encoder {
    fn more(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (option, value) in [
            ("-c", self.clock_hz.map(|hz| Hertz(hz).to_string())),
            ("-i", self.interval_ns.map(|ns| Nanos(ns).to_string())),
            ("--timeout", self.timeout.clone()),
            ("--zero", self.zero.clone()),
            ("--resolution", self.resolution.clone()),
            ("--unit", self.unit.map(str::to_owned)),
        ] {
            if let Some(value) = value {
                write!(f, " {option} {value}")?;
            }
        }
        if self.reverse {
            f.write_str(" --reverse")?;
        }
        write!(f, "\n    from {}", Clean(&self.file))
    }
}

impl Preset {
    fn more(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "    {}", self.frame)?;
        match (self.clock_min_hz.map(Hertz), self.clock_max_hz.map(Hertz)) {
            (Some(min), Some(max)) => write!(f, "; clock {min} to {max}")?,
            (Some(min), None) => write!(f, "; clock from {min}")?,
            (None, Some(max)) => write!(f, "; clock up to {max}")?,
            (None, None) => {}
        }
        if let Some(timeout) = &self.timeout {
            write!(f, "; timeout {timeout}")?;
        }
        if let Some(interval) = self.interval_ns.map(Nanos) {
            write!(f, "; interval from {interval}")?;
        }
        if let Some(power_on) = self.power_on_ns.map(Nanos) {
            write!(f, "; ready {power_on} after power-on")?;
        }
        writeln!(f, "\n    source: {}", self.source)?;
        match self.note {
            "" => Ok(()),
            note => writeln!(f, "    {note}"),
        }
    }
}
