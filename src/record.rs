//! Recordings as they are written: both wires, change by change, for PulseView, GTKWave, Saleae Logic and ourselves.
//!
//! Whatever happens, what is on disk can be read: lines of text are whole ones, and a `.sr` keeps its directory.

mod csv;
pub mod journal;
mod sr;
mod vcd;

use crate::cycle::Cycle;
use crate::format::Format;
use crate::unit::Hertz;
use crate::waveform::Change;
use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};

/// The kinds of files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Value change dump (IEEE 1364), in nanoseconds.
    Vcd,
    /// A sigrok session, samples at a constant rate.
    Sr,
    /// Comma-separated as Saleae Logic exports it, a row a change.
    Csv,
}

/// What stands at the head of a recording.
#[derive(Clone, Debug)]
pub struct Head<'a> {
    /// Where it comes from, line by line.
    pub notes: &'a [String],
    /// The fields that [`Recorder::frame`] will tell of.
    pub format: Option<&'a Format>,
    /// Samples a second, for kinds that sample.
    pub rate: Hertz,
    /// The levels that it begins with.
    pub first: Change,
}

/// Writes a recording. Times that go backwards are taken for the last one.
pub trait Recorder {
    /// The next change of a wire.
    ///
    /// # Errors
    /// When it cannot be written; what was written before stays readable.
    fn change(&mut self, change: &Change) -> io::Result<()>;

    /// A frame that began at `t_ns`, before the changes that come with it: kinds that can show what it said.
    ///
    /// # Errors
    /// As [`Recorder::change`].
    fn frame(&mut self, _t_ns: u64, _cycle: &Cycle) -> io::Result<()> {
        Ok(())
    }

    /// Hands on what is kept back, before a wait.
    ///
    /// # Errors
    /// As [`Recorder::change`].
    fn flush(&mut self) -> io::Result<()>;

    /// The levels stayed as they are until `t_ns`, where the recording ends.
    ///
    /// # Errors
    /// As [`Recorder::change`].
    fn end(&mut self, t_ns: u64) -> io::Result<()>;
}

/// Where a recording goes.
pub enum Output {
    /// A file that can be cut and read back; it is overwritten.
    File(File),
    /// A pipe or a device.
    Stream(Box<dyn Write>),
}

impl std::fmt::Debug for Output {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Output::File(_) => "File",
            Output::Stream(_) => "Stream",
        })
    }
}

/// Begins a recording.
///
/// # Errors
/// When its head cannot be written.
pub fn begin(kind: Kind, output: Output, head: &Head) -> io::Result<Box<dyn Recorder>> {
    if let Output::File(file) = &output {
        file.set_len(0)?;
    }
    Ok(match kind {
        Kind::Vcd => Box::new(vcd::Vcd::begin(Lines::new(output), head)?),
        Kind::Sr => Box::new(sr::Sr::begin(output, head)?),
        Kind::Csv => Box::new(csv::Csv::begin(Lines::new(output), head)?),
    })
}

/// Usual sample rates of logic analysers.
const RATES_MHZ: [u32; 26] = [
    1, 2, 4, 5, 8, 10, 12, 16, 20, 24, 25, 32, 40, 48, 50, 64, 80, 100, 125, 160, 200, 250, 320,
    400, 500, 1000,
];

/// Samples a clock, at least, where nobody says how many.
pub const SAMPLES: u32 = 16;

/// Samples a clock, at least, that a reader needs. With less, and SLO edges up to a quarter of a clock off, it took a bit for
/// the next one, and now and then the CRC was good.
pub const LEAST_SAMPLES: u32 = 8;

/// The smallest usual rate at which a clock has enough samples, one on which its edges fall if there is one within four
/// times that.
pub fn usual_rate(clock: Hertz) -> Hertz {
    let least = u64::from(clock.0.max(1)) * u64::from(SAMPLES);
    let rates = || {
        let rates = RATES_MHZ.iter().map(|mhz| mhz * 1_000_000);
        rates.filter(|hz| u64::from(*hz) >= least)
    };
    let even = rates().find(|hz| hz % (2 * clock.0.max(1)) == 0);
    let even = even.filter(|hz| u64::from(*hz) <= 4 * least.max(1_000_000));
    Hertz(even.or_else(|| rates().next()).unwrap_or(1_000_000_000))
}

/// The first sample that is not before `ns`, from the beginning on.
fn sample(rate: Hertz, ns: u64) -> u64 {
    let sample = (u128::from(ns) * u128::from(rate.0)).div_ceil(1_000_000_000);
    u64::try_from(sample).unwrap_or(u64::MAX)
}

/// So much text is written at once.
const BLOCK: usize = 1 << 16;

/// Lines of text, of which only whole ones stay.
struct Lines {
    output: Output,
    text: Vec<u8>,
    /// Nothing more is written.
    broken: bool,
}

impl Lines {
    fn new(output: Output) -> Lines {
        Lines {
            output,
            text: Vec::with_capacity(2 * BLOCK),
            broken: false,
        }
    }

    /// Adds a line or a few.
    fn add(&mut self, text: std::fmt::Arguments<'_>) -> io::Result<()> {
        self.text.write_fmt(text)
    }

    /// After whole lines.
    fn pass(&mut self) -> io::Result<()> {
        if self.text.len() < BLOCK {
            return Ok(());
        }
        self.write()
    }

    fn write(&mut self) -> io::Result<()> {
        if self.broken {
            return Ok(());
        }
        let written = match &mut self.output {
            Output::File(file) => write_lines(file, &self.text),
            Output::Stream(stream) => stream.write_all(&self.text).and_then(|()| stream.flush()),
        };
        self.text.clear();
        self.broken = written.is_err();
        written
    }
}

/// Writes whole lines or cuts what came of them.
fn write_lines(file: &mut File, text: &[u8]) -> io::Result<()> {
    let before = file.stream_position()?;
    file.write_all(text).inspect_err(|_| {
        // That there is no room is what counts, not what else fails for it.
        let _ = (|| {
            let there = file.stream_position()?.saturating_sub(before) as usize;
            let whole = text[..there].iter().rposition(|byte| *byte == b'\n');
            let end = before + whole.map_or(0, |at| at as u64 + 1);
            file.set_len(end)?;
            file.seek(SeekFrom::Start(end))
        })();
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_usual_and_high_enough() {
        for (clock, rate) in [
            (1_000_000, 16_000_000),
            (250_000, 4_000_000),
            (100_000, 2_000_000),
            (80_000, 4_000_000),
            (2_000_000, 32_000_000),
            (10_000_000, 160_000_000),
            (2_500_000, 40_000_000),
            (3_125_000, 50_000_000),
            (333_333, 8_000_000),
            (7_812_500, 125_000_000),
            (100_000_000, 1_000_000_000),
            (0, 1_000_000),
        ] {
            assert_eq!(usual_rate(Hertz(clock)).0, rate, "{clock}");
        }
    }
}
