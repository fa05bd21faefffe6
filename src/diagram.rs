//! A cycle as engineers draw it: both wires over time, and what each stretch of them means.
//!
//! A [`Diagram`] is all that is to be drawn, with its places in time; [`text`] and [`svg`] are two ways to draw it.

mod annotate;
mod axis;
mod labels;
pub mod svg;
pub mod text;

pub use axis::Axis;

use crate::cycle::{Cycle, Fault};
use crate::format::Format;
use crate::trace::Trace;
use crate::waveform::Change;

/// A change of a wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Step<L> {
    /// When.
    pub t_ns: u64,
    /// The level from then on.
    pub level: L,
}

/// A bit of the trace, where it is seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cell {
    /// From here.
    pub from_ns: u64,
    /// To here.
    pub until_ns: u64,
    /// Where it was sampled.
    pub sample_ns: Option<u64>,
    /// What was read.
    pub level: bool,
    /// The rising edge that set it, counted from 1, as far as the line delay is known.
    pub edge: Option<u16>,
}

/// Where an annotation stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Lane {
    /// Above MA: its clock, and CDM.
    Above,
    /// Between the wires: times from one to the other.
    Between,
    /// Below SLO: the parts of the frame.
    Field,
    /// The channels that these belong to.
    Channel,
    /// What is wrong, below all.
    Fault,
}

/// What an annotation says beside its words.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tone {
    /// Nothing.
    #[default]
    Plain,
    /// A part of the drawing that only guides the eye.
    Faint,
    /// It was checked, and is good.
    Good,
    /// The encoder warns.
    Warning,
    /// The encoder or the wire says that something is wrong.
    Bad,
}

/// A stretch of time with a meaning.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Span {
    /// Where it stands.
    pub lane: Lane,
    /// From here.
    pub from_ns: u64,
    /// To here; not before.
    pub until_ns: u64,
    /// What it is called: `st26`, `Ack`, `line delay`.
    pub name: String,
    /// What it holds, ` = 1003388`, if that is known and good; the name's last words where it is a fault.
    pub value: String,
    /// Shorter ways to say both, where there is no room.
    pub shorter: Vec<String>,
    /// What else it says.
    pub tone: Tone,
}

impl Span {
    fn new(lane: Lane, from_ns: u64, until_ns: u64, name: impl Into<String>) -> Span {
        Span {
            lane,
            from_ns,
            until_ns: until_ns.max(from_ns),
            name: name.into(),
            value: String::new(),
            shorter: Vec::new(),
            tone: Tone::Plain,
        }
    }

    fn value(self, value: impl Into<String>) -> Span {
        let value = value.into();
        Span { value, ..self }
    }

    fn or(mut self, shorter: impl Into<String>) -> Span {
        self.shorter.push(shorter.into());
        self
    }

    fn tone(self, tone: Tone) -> Span {
        Span { tone, ..self }
    }

    /// All that can be written, the longest first.
    fn labels(&self) -> impl Iterator<Item = String> {
        let whole = format!("{}{}", self.name, self.value);
        std::iter::once(whole).chain(self.shorter.iter().cloned())
    }
}

/// What is drawn of a cycle.
#[derive(Clone, Debug)]
pub struct Diagram {
    /// MA, the first entry where the drawing begins.
    pub ma: Vec<Step<bool>>,
    /// SLO likewise; `None` where neither 0 nor 1 was seen.
    pub slo: Vec<Step<Option<bool>>>,
    /// Where the drawing ends.
    pub end_ns: u64,
    /// The rising edges of MA that count.
    pub edges: Vec<u64>,
    /// The bits.
    pub cells: Vec<Cell>,
    /// What they mean.
    pub spans: Vec<Span>,
    /// Where MA stood still for too long.
    pub stalled: Option<(u64, u64)>,
    /// What holds for all of it: the clock, the line delay, the timeout.
    pub facts: Vec<String>,
    /// The fault of the cycle, or of its first bad word.
    pub fault: Option<Fault>,
    /// Time as it is drawn.
    pub axis: Axis,
}

impl Diagram {
    /// What there is to see of a cycle whose trace has kept its waveform. `behind` is what the wires did when it was over.
    /// Without a format what follows CDS is bits.
    ///
    /// `None` where there is nothing: MA never moved, or nobody has kept it.
    pub fn of(
        trace: &Trace,
        cycle: &Cycle,
        format: Option<&Format>,
        behind: &[Change],
    ) -> Option<Diagram> {
        annotate::diagram(trace, cycle, format, behind)
    }

    /// From the second rising edge to SL falling, by the waveform alone: for links that see every change as it happens, and
    /// measure no delay.
    pub fn line_delay_ns(trace: &Trace, cycle: &Cycle) -> Option<u32> {
        annotate::line_delay(trace, cycle).and_then(|ns| u32::try_from(ns).ok())
    }

    /// Where the drawing begins.
    pub fn begin_ns(&self) -> u64 {
        self.ma.first().map_or(0, |step| step.t_ns)
    }

    /// Whether it is in one of the clocks that are left out.
    fn hides(&self, t_ns: u64) -> bool {
        let mut cuts = self.axis.cuts().iter().filter(|cut| cut.clocks);
        cuts.any(|cut| t_ns > cut.from_ns && t_ns < cut.until_ns)
    }

    /// Whether that holds for all of a bit.
    fn hides_bit(&self, cell: &Cell) -> bool {
        let mut cuts = self.axis.cuts().iter().filter(|cut| cut.clocks);
        cuts.any(|cut| (cut.from_ns..cut.until_ns).contains(&cell.from_ns))
    }

    /// Whether bits are seen a clock or more after the edge that set them, so that both want numbers.
    pub fn is_far(&self) -> bool {
        self.cells.iter().enumerate().any(|(index, cell)| {
            let own = self.edges.get(index);
            let shifted = cell.edge.is_some_and(|edge| usize::from(edge) != index + 1);
            let late =
                own.is_some_and(|own| self.axis.at(cell.from_ns) - self.axis.at(*own) >= 0.75);
            shifted || late
        })
    }
}

/// A time as people write it, four digits at most.
fn time(ns: u64) -> String {
    let (scale, unit) = match ns {
        0..1_000 => return format!("{ns} ns"),
        1_000..1_000_000 => (1e3, "us"),
        1_000_000..1_000_000_000 => (1e6, "ms"),
        _ => (1e9, "s"),
    };
    format!("{} {unit}", digits(ns as f64 / scale))
}

/// The frequency of a period.
fn frequency(period_ns: u32) -> String {
    let khz = 1e6 / f64::from(period_ns.max(1));
    match khz >= 999.5 {
        true => format!("{} MHz", digits(khz / 1e3)),
        false => format!("{} kHz", digits(khz)),
    }
}

/// Four digits, without zeros that say nothing.
fn digits(value: f64) -> String {
    let places = match value {
        ..10.0 => 3,
        10.0..100.0 => 2,
        100.0..1000.0 => 1,
        _ => 0,
    };
    let text = format!("{value:.places$}");
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

/// Words about times, with the sign that microseconds have.
pub fn micro(text: &str) -> String {
    let mut out = String::with_capacity(text.len() + 1);
    let mut rest = text;
    while let Some(at) = rest.find(" us") {
        let (before, behind) = rest.split_at(at);
        let number = before.ends_with(|c: char| c.is_ascii_digit());
        let word = behind[3..].starts_with(|c: char| c.is_ascii_alphanumeric());
        out.push_str(before);
        out.push_str(if number && !word { " µs" } else { " us" });
        rest = &behind[3..];
    }
    out + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_four_digits_and_units() {
        for (ns, text) in [
            (0, "0 ns"),
            (112, "112 ns"),
            (1_000, "1 us"),
            (1_234, "1.234 us"),
            (12_500, "12.5 us"),
            (40_112, "40.11 us"),
            (123_456, "123.5 us"),
            (20_000_000, "20 ms"),
            (1_500_000_000, "1.5 s"),
        ] {
            assert_eq!(time(ns), text);
        }
        for (period, text) in [
            (100, "10 MHz"),
            (999, "1.001 MHz"),
            (1_000, "1 MHz"),
            (4_000, "250 kHz"),
            (12_500, "80 kHz"),
            (1_001, "999 kHz"),
        ] {
            assert_eq!(frequency(period), text, "{period}");
        }
        assert_eq!(
            micro("stood 15.0 us, limit 1.5 us"),
            "stood 15.0 µs, limit 1.5 µs"
        );
        assert_eq!(micro("for us 5 used"), "for us 5 used");
    }
}
