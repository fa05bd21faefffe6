//! What a run came to, on stderr.

use super::{note, say};
use crate::cli::OutputFormat;
use biss::cycle::{Cycle, Fault, Word};
use biss::format::Format;
use serde::ser::{Serialize, SerializeMap, Serializer};
use std::fmt::Display;

/// What a run came to.
#[derive(Clone, Debug, Default)]
pub(crate) struct Summary {
    /// Cycles with every channel good.
    pub(crate) good: u64,
    /// By [`Fault::index`].
    pub(crate) faults: [u64; Fault::NAMES.len()],
    pub(crate) error: u64,
    pub(crate) warning: u64,
    pub(crate) skipped: u64,
    pub(crate) retries: u64,
    pub(crate) elapsed_ns: u64,
    /// All cycles.
    pub(crate) cycles: u64,
    /// Start of the first and of the last cycle.
    pub(crate) span_ns: Option<(u64, u64)>,
    /// Why frames were bad.
    pub(crate) diagnosis: Vec<Why>,
}

/// A cause, and what to do about it.
#[derive(Clone, Debug, serde::Serialize)]
pub(crate) struct Why {
    pub(crate) cause: &'static str,
    pub(crate) text: String,
    pub(crate) count: u64,
    #[serde(rename = "try")]
    pub(crate) command: String,
}

impl Summary {
    /// Counts a cycle that took so many tries.
    pub(crate) fn count(&mut self, format: &Format, cycle: &Cycle, t_ns: u64, tries: u32) {
        self.cycles += 1;
        let (first, _) = self.span_ns.unwrap_or((t_ns, t_ns));
        self.span_ns = Some((first, t_ns));
        self.good += u64::from(cycle.is_good());
        self.retries += u64::from(tries) - 1;
        let words = cycle.words().iter();
        let faults = words.clone().filter_map(Word::fault);
        for fault in cycle.fault().into_iter().chain(faults) {
            self.faults[fault.index()] += 1;
        }
        for (channel, word) in format.channels().iter().zip(words) {
            if let Some(data) = word.good() {
                self.error += u64::from(channel.error(data) == Some(true));
                self.warning += u64::from(channel.warning(data) == Some(true));
            }
        }
    }

    /// What was counted after `base`.
    pub(super) fn since(&self, base: &Summary) -> Summary {
        Summary {
            good: self.good - base.good,
            faults: std::array::from_fn(|index| self.faults[index] - base.faults[index]),
            error: self.error - base.error,
            warning: self.warning - base.warning,
            skipped: self.skipped - base.skipped,
            retries: self.retries - base.retries,
            cycles: self.cycles - base.cycles,
            ..self.clone()
        }
    }

    /// Cycles a second, from start to start; none where there is no second start.
    fn rate_hz(&self) -> Option<f64> {
        let (first, last) = self.span_ns?;
        let seconds = last.saturating_sub(first) as f64 / 1e9;
        (seconds > 0.0).then(|| ((self.cycles - 1) as f64 / seconds * 10.0).round() / 10.0)
    }

    pub(super) fn kinds(&self) -> impl Iterator<Item = (&'static str, u64)> {
        Fault::NAMES
            .into_iter()
            .zip(self.faults)
            .filter(|(_, count)| *count > 0)
    }

    /// On stderr, so that stdout stays records only.
    pub(crate) fn print(&self, format: OutputFormat) {
        match format {
            OutputFormat::Json => say(&serde_json::to_string(self).unwrap_or_default()),
            OutputFormat::Text | OutputFormat::Csv => note(self),
        }
    }
}

impl Display for Summary {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let faults: u64 = self.faults.iter().sum();
        let plural = |count: u64| if count == 1 { "" } else { "s" };
        write!(
            f,
            "{} frame{}, {} good, ",
            self.cycles,
            plural(self.cycles),
            self.good
        )?;
        write!(f, "{faults} fault{}", plural(faults))?;
        let mut before = " (";
        for (name, count) in self.kinds() {
            write!(f, "{before}{count} {name}")?;
            before = ", ";
        }
        if faults > 0 {
            f.write_str(")")?;
        }
        for (count, name) in [
            (self.error, "error"),
            (self.warning, "warning"),
            (self.skipped, "skipped"),
            (self.retries, "retries"),
        ] {
            if count > 0 {
                write!(f, ", {count} {name}")?;
            }
        }
        write!(f, " in {:.3} s", self.elapsed_ns as f64 / 1e9)?;
        match self.rate_hz() {
            Some(rate) => write!(f, ", {rate:.1} frames/s"),
            None => Ok(()),
        }
    }
}

impl Summary {
    /// All keys but the type.
    pub(super) fn entries<M: SerializeMap>(&self, map: &mut M) -> Result<(), M::Error> {
        struct Kinds<'a>(&'a Summary);
        impl Serialize for Kinds<'_> {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.collect_map(self.0.kinds())
            }
        }
        map.serialize_entry("frames", &self.cycles)?;
        map.serialize_entry("good", &self.good)?;
        map.serialize_entry("faults", &Kinds(self))?;
        map.serialize_entry("error", &self.error)?;
        map.serialize_entry("warning", &self.warning)?;
        map.serialize_entry("skipped", &self.skipped)?;
        map.serialize_entry("retries", &self.retries)?;
        map.serialize_entry("elapsed_ns", &self.elapsed_ns)?;
        map.serialize_entry("rate_hz", &self.rate_hz())?;
        map.serialize_entry("diagnosis", &self.diagnosis)
    }
}

impl Serialize for Summary {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("type", "summary")?;
        self.entries(&mut map)?;
        map.end()
    }
}
