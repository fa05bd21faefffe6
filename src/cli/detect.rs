//! `biss detect` as clap sees it.

use super::{ReportFormat, Wire};
use biss::ParseError;
use biss::config::check_name;
use biss::unit::Nanos;
use clap::Args;

pub(super) const DETECT_HELP: &str = concat!(
    "\
Found:
  what is on the line: BiSS-C, SSI, or nothing that lives
  length of the frame, channels, width and polynomial of each CRC, start value and inversion as the usual pair that
  does the same at this length; nE and nW, zero padding, single-turn and multi-turn where motion or registers show it
  on live links: Ack, busy time, timeout, shortest interval, MA clocks that work, the better SPI phase
  Every format that fits is told of, with its probability. Frames that move decide: turn the encoder.

Where the link can send CDM the slaves' registers are asked first. Nothing is written but the bank selection, and that is
restored.

",
    links!(),
    "
Examples:
  biss detect sim:device=none                 an encoder without registers
  biss detect spi:0.0 -c 500kHz               an encoder without a data sheet, slowly
  biss detect file:bench.vcd -o json          a recording, as one JSON object
  biss detect gpio:0,ma=17,slo=27 --save axis  from then on biss read axis

Exit status:
  0  exactly one format fits
  1  none, or several; or nobody answers
  2  usage or machine"
);

/// Live frames where the user has not said how many.
pub(crate) const DETECT_FRAMES: u64 = 1_000;

#[derive(Debug, Args)]
pub(crate) struct Detect {
    #[command(flatten)]
    pub(crate) wire: Wire,

    /// Most frames to look at; fewer where they are certain [default: 1000, all of a recording]
    #[arg(short = 'n', long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) count: Option<u64>,

    /// How long to wait for motion where a position that stands still leaves several formats [default: 10s, 0s with -n or on sim]
    #[arg(long, value_name = "TIME", conflicts_with = "count")]
    pub(crate) wait: Option<Nanos>,

    /// Do not even select a bank to ask for the EDS
    #[arg(long)]
    pub(crate) no_write: bool,

    /// Where exactly one format fits, keep link, format and clock under this name: `biss read NAME` reads it then
    #[arg(long, value_name = "NAME", value_parser = name)]
    pub(crate) save: Option<String>,

    /// How it is told
    #[arg(short = 'o', long, value_enum, default_value_t = ReportFormat::Text)]
    pub(crate) format: ReportFormat,
}

fn name(text: &str) -> Result<String, ParseError> {
    check_name(text).map(|()| text.to_owned())
}
