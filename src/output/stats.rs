//! What many frames came to, as a table with histograms or as one JSON object.

use super::{Summary, say, terminal_width, utf8_locale};
use crate::cli::ReportFormat;
use biss::format::{Format, Kind};
use biss::measure::Scale;
use biss::stats::{Bin, Distribution, Motion, NS_PER_METRE, Spread, Stats};
use biss::unit::{Hertz, Nanos};
use serde::ser::{Serialize, SerializeMap, Serializer};
use std::fmt::Write;

/// MA is never faster (D2, Table 10).
const CLOCK_MAX: Hertz = Hertz(10_000_000);

/// Bars of a histogram, and one more for what is far out.
const BINS: u64 = 10;

/// All that is told.
pub(crate) struct Report {
    pub(crate) stats: Stats,
    pub(crate) format: Format,
    /// The slave of each channel; none where nobody has said.
    pub(crate) slaves: Vec<u8>,
    /// How the position of each channel is measured.
    pub(crate) scales: Vec<Option<Scale>>,
    pub(crate) interval: Option<Nanos>,
    /// The encoder's own, where a preset knows it.
    pub(crate) clock_limit: Option<Hertz>,
    /// By how much SL may come earlier or later, where it was looked for, in eighths of a clock.
    pub(crate) margin_eighths: Option<u8>,
}

/// What one row is about.
struct Row<'a> {
    /// In the table; the key of the JSON object has the unit behind it.
    name: &'static str,
    unit: Unit,
    values: &'a Distribution,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Unit {
    Nanos,
    Clocks,
    Hertz,
}

impl Unit {
    fn suffix(self) -> &'static str {
        match self {
            Unit::Nanos => "ns",
            Unit::Clocks => "clk",
            Unit::Hertz => "hz",
        }
    }

    /// How it is shown up to this value, and so many of it are one.
    fn scale(self, most: f64) -> (&'static str, f64) {
        let steps: &[(&str, f64)] = match self {
            Unit::Nanos => &[("s", 1e9), ("ms", 1e6), ("us", 1e3), ("ns", 1.0)],
            Unit::Hertz => &[("MHz", 1e6), ("kHz", 1e3), ("Hz", 1.0)],
            Unit::Clocks => &[("clk", 1.0)],
        };
        let fits = steps.iter().find(|(_, size)| most >= *size);
        fits.or(steps.last()).copied().unwrap_or(("", 1.0))
    }
}

/// With the digits that a number of this size deserves.
fn shown(value: f64, size: f64) -> String {
    let value = value / size;
    // A whole number of the smallest unit has none behind the point.
    let digits = match value.abs() {
        _ if size == 1.0 && value.fract() == 0.0 => 0,
        0.0..10.0 => 3,
        10.0..100.0 => 2,
        100.0..1000.0 => 1,
        _ => 0,
    };
    format!("{value:.digits$}")
}

impl Report {
    /// The rows that this link fills.
    fn rows(&self) -> impl Iterator<Item = Row<'_>> {
        let stats = &self.stats;
        let rows = [
            ("period", Unit::Nanos, &stats.period_ns),
            ("jitter", Unit::Nanos, &stats.jitter_ns),
            ("late", Unit::Nanos, &stats.late_ns),
            ("clock", Unit::Hertz, &stats.clock_hz),
            ("ack", Unit::Clocks, &stats.ack_clk),
            ("busy", Unit::Nanos, &stats.busy_ns),
            ("delay", Unit::Clocks, &stats.delay_clk),
            ("delay", Unit::Nanos, &stats.delay_ns),
            ("timeout", Unit::Nanos, &stats.timeout_ns),
            ("level", Unit::Nanos, &stats.level_ns),
        ];
        let rows = rows
            .into_iter()
            .map(|(name, unit, values)| Row { name, unit, values });
        rows.filter(|row| !row.values.is_empty())
    }

    /// As a whole answer.
    pub(crate) fn render(
        &self,
        summary: &Summary,
        format: ReportFormat,
    ) -> Result<String, serde_json::Error> {
        let mut text = match format {
            ReportFormat::Text => self.text(summary),
            ReportFormat::Json => serde_json::to_string(&All(self, summary))? + "\n",
        };
        if text.is_empty() {
            text.push('\n');
        }
        Ok(text)
    }

    /// On stderr, while it goes on.
    pub(crate) fn say(&self, summary: &Summary, format: ReportFormat) {
        say(self.render(summary, format).unwrap_or_default().trim_end());
    }

    fn text(&self, summary: &Summary) -> String {
        let mut out = format!("{summary}\n");
        if let Some(asked) = self.interval {
            let late = self.stats.late;
            let asked_hz = 1e9 / asked.0.max(1) as f64;
            let _ = writeln!(
                out,
                "asked for {asked_hz:.1} frames/s, {late} of {} slots late by a tenth or more, {} skipped",
                summary.cycles, summary.skipped
            );
        }
        self.table(&mut out);
        self.verdicts(&mut out);
        for (index, motion) in self.motions() {
            self.motion(&mut out, index, motion);
        }
        for row in self.rows() {
            self.histogram(&mut out, &row);
        }
        out
    }

    fn table(&self, out: &mut String) {
        if self.rows().next().is_none() {
            return;
        }
        let _ = writeln!(
            out,
            "\n{:8} {:>10} {:>10} {:>10} {:>10} {:>10}",
            "", "min", "mean", "p50", "p99", "max"
        );
        for row in self.rows() {
            let Some(spread) = row.values.spread() else {
                continue;
            };
            let (unit, size) = row.unit.scale(spread.max as f64);
            let _ = write!(out, "{:8}", row.name);
            for value in values(&spread) {
                let _ = write!(out, " {:>10}", shown(value, size));
            }
            let _ = writeln!(out, " {unit}");
        }
    }

    /// What the numbers mean for the line.
    fn verdicts(&self, out: &mut String) {
        let mut lines = Vec::new();
        if let Some(metres) = self.stats.cable_m() {
            lines.push(format!(
                "the delay is that of {metres:.1} m of cable at {NS_PER_METRE:.0} ns a metre, less what the encoder takes"
            ));
        }
        match (self.stats.margin_ns(), self.margin_eighths) {
            (Some(ns), _) => {
                let (unit, size) = Unit::Nanos.scale(ns as f64);
                lines.push(format!(
                    "margin: SL may change {} {unit} later or earlier for a master that samples with the next rising MA edge",
                    shown(ns as f64, size)
                ));
            }
            (None, Some(eighths)) => lines.push(format!(
                "margin: SL may change {eighths}/8 of a clock later or earlier, at least, where it is sampled"
            )),
            (None, None) => {}
        }
        if let Some(hz) = self.steady_up_to() {
            lines.push(format!(
                "highest MA: {hz}, as far as the spread of the line delay goes"
            ));
        }
        if !lines.is_empty() {
            out.push('\n');
        }
        for line in lines {
            out.push_str(&line);
            out.push('\n');
        }
    }

    fn steady_up_to(&self) -> Option<Hertz> {
        let limit = self.clock_limit.unwrap_or(CLOCK_MAX).min(CLOCK_MAX);
        self.stats.steady_up_to_hz(limit.0).map(Hertz)
    }

    fn motions(&self) -> impl Iterator<Item = (usize, &Motion)> {
        let motions = self.stats.motions.iter().enumerate();
        motions.filter_map(|(index, motion)| Some((index, motion.as_ref()?)))
    }

    /// How a position is measured, where it is.
    fn scale(&self, index: usize) -> Option<&Scale> {
        self.scales.get(index)?.as_ref()
    }

    /// Counts of a turn, where the position is one.
    fn turn(&self, index: usize) -> Option<f64> {
        if let Some(scale) = self.scale(index) {
            return scale.turn();
        }
        let channel = self.format.channels().get(index)?;
        let field = channel.find(|kind| *kind == Kind::SingleTurn)?;
        Some(2f64.powi(field.bits().into()))
    }

    fn motion(&self, out: &mut String, index: usize, motion: &Motion) {
        let Some(travel) = motion.travel() else {
            return;
        };
        let several = self.format.channels().len() > 1;
        let name = match (several, self.slaves.get(index)) {
            (false, _) => "position".into(),
            (true, None) => format!("position of channel {index}"),
            (true, Some(slave)) => format!("position of channel {index}, slave {slave}"),
        };
        let measured = |counts: f64| match self.scale(index) {
            Some(scale) => format!(" ({:.6} {})", scale.of_counts(counts), scale.unit()),
            None => String::new(),
        };
        let _ = write!(out, "\n{name}: travel {travel}{}", measured(travel as f64));
        if let Some(noise) = motion.noise() {
            let _ = write!(out, ", noise {noise:.2} rms{}", measured(noise));
        }
        if let Some(speed) = motion.speed() {
            let _ = write!(out, "\n  speed {:.0} counts/s", speed.mean);
            match (self.turn(index), self.scale(index)) {
                (Some(turn), _) => {
                    let _ = write!(out, " ({:.4} turns/s)", speed.mean / turn);
                }
                (None, Some(scale)) => {
                    let rate = scale.of_counts(speed.mean);
                    let _ = write!(out, " ({rate:.4} {}/s)", scale.unit());
                }
                (None, None) => {}
            }
            let _ = write!(out, ", {:.0} to {:.0}", speed.min, speed.max);
        }
        out.push('\n');
    }

    /// Nothing of a single value.
    fn histogram(&self, out: &mut String, row: &Row) {
        let bins = row.values.bins(BINS);
        let most = bins.iter().map(|bin| bin.count).max().unwrap_or(0);
        if bins.len() < 2 {
            return;
        }
        let spread = row.values.spread();
        let (unit, size) = row
            .unit
            .scale(spread.map_or(0.0, |spread| spread.max as f64));
        let _ = writeln!(out, "\n{} from, {unit}", row.name);
        let width = bins[0].to - bins[0].from;
        let room = terminal_width().saturating_sub(24).clamp(8, 60);
        for bin in &bins {
            let bar = bar(bin.count, most, room);
            let from = shown(bin.from as f64, size);
            // The last one may hold all that is farther out.
            let more = if bin.to - bin.from > width { "+" } else { " " };
            let line = format!("{from:>10}{more}{:>10}  {bar}", bin.count);
            let _ = writeln!(out, "{}", line.trim_end());
        }
    }
}

/// In eighths of a character where the locale has them. What is there is seen.
fn bar(count: u64, most: u64, room: usize) -> String {
    const PARTS: [char; 8] = ['▏', '▎', '▍', '▌', '▋', '▊', '▉', '█'];
    if count == 0 {
        return String::new();
    }
    let eighths = (count as f64 / most.max(1) as f64 * (room * 8) as f64).ceil() as usize;
    if !utf8_locale() {
        return "#".repeat(eighths.div_ceil(8));
    }
    let mut bar = "█".repeat(eighths / 8);
    if eighths % 8 > 0 {
        bar.push(PARTS[eighths % 8 - 1]);
    }
    bar
}

fn values(spread: &Spread) -> [f64; 5] {
    let [min, p50, p99, max] = [spread.min, spread.p50, spread.p99, spread.max].map(|n| n as f64);
    [min, spread.mean, p50, p99, max]
}

/// The JSON object.
struct All<'a>(&'a Report, &'a Summary);

impl Serialize for All<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let All(report, summary) = self;
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("type", "stats")?;
        map.serialize_entry("format", &report.format.to_string())?;
        summary.entries(&mut map)?;
        if let Some(asked) = report.interval {
            map.serialize_entry("interval_ns", &asked.0)?;
            map.serialize_entry("late", &report.stats.late)?;
        }
        for row in report.rows() {
            let key = format!("{}_{}", row.name, row.unit.suffix());
            map.serialize_entry(&key, &Shares(row.values))?;
        }
        if let Some(metres) = report.stats.cable_m() {
            map.serialize_entry("cable_m", &rounded(metres, 10.0))?;
        }
        match (report.stats.margin_ns(), report.margin_eighths) {
            (Some(ns), _) => map.serialize_entry("margin_ns", &ns)?,
            (None, Some(eighths)) => {
                map.serialize_entry("margin_clk", &(f64::from(eighths) / 8.0))?;
            }
            (None, None) => {}
        }
        if let Some(hz) = report.steady_up_to() {
            map.serialize_entry("clock_max_hz", &hz.0)?;
        }
        let channels: Vec<Channel> = report
            .motions()
            .map(|(index, motion)| Channel {
                report,
                index,
                motion,
            })
            .collect();
        map.serialize_entry("channels", &channels)?;
        map.end()
    }
}

fn rounded(value: f64, parts: f64) -> f64 {
    (value * parts).round() / parts
}

struct Shares<'a>(&'a Distribution);

impl Serialize for Shares<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        if let Some(spread) = self.0.spread() {
            map.serialize_entry("min", &spread.min)?;
            map.serialize_entry("mean", &rounded(spread.mean, 100.0))?;
            map.serialize_entry("p50", &spread.p50)?;
            map.serialize_entry("p99", &spread.p99)?;
            map.serialize_entry("max", &spread.max)?;
        }
        let bins = self.0.bins(BINS);
        let bins: Vec<[u64; 3]> = bins
            .iter()
            .map(|Bin { from, to, count }| [*from, *to, *count])
            .collect();
        map.serialize_entry("bins", &bins)?;
        map.end()
    }
}

struct Channel<'a> {
    report: &'a Report,
    index: usize,
    motion: &'a Motion,
}

impl Serialize for Channel<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("ch", &self.index)?;
        if let Some(slave) = self.report.slaves.get(self.index) {
            map.serialize_entry("slave", slave)?;
        }
        if let Some(travel) = self.motion.travel() {
            map.serialize_entry("travel", &travel)?;
        }
        if let Some(noise) = self.motion.noise() {
            map.serialize_entry("noise", &rounded(noise, 1000.0))?;
        }
        if let Some(speed) = self.motion.speed() {
            map.serialize_entry("speed_min", &rounded(speed.min, 10.0))?;
            map.serialize_entry("speed", &rounded(speed.mean, 10.0))?;
            map.serialize_entry("speed_max", &rounded(speed.max, 10.0))?;
            if let Some(scale) = self
                .report
                .scale(self.index)
                .filter(|scale| scale.turn().is_none())
            {
                let key = format!("{}_per_s", scale.unit());
                map.serialize_entry(&key, &rounded(scale.of_counts(speed.mean), 1e6))?;
            }
            if let Some(turn) = self.report.turn(self.index) {
                map.serialize_entry("turns_per_s", &rounded(speed.mean / turn, 1e6))?;
            }
        }
        map.end()
    }
}
