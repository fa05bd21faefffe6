//! `biss scope` as clap sees it.

use super::{ColorWhen, FRAME_VARIABLE, Wanted, Wire};
use biss::unit::Nanos;
use clap::Args;
use std::path::PathBuf;

pub(super) const SCOPE_HELP: &str = concat!(
    "\
Drawn:
  MA and SLO over time, each rising edge of MA with its number; where SLO was sampled, and what was read; Ack, start, CDS,
  every field with its width and value, CRC, stop; line delay, timeout, CDM; what is wrong, where it is. What takes long
  and says nothing is cut short, and marked. A frame that is longer than a line goes on below.
  A value stands only where the word passed every check.

",
    links!(),
    "
Examples:
  biss scope sim                                          a frame of the simulated encoder
  biss scope file:bench.vcd -f st26,nE,nW,crc6 --fault    the first bad one of a recording
  biss scope spi:0.0 -f st26,nE,nW,crc6 -w frame.svg      a picture for a data sheet

Exit status:
  0  what is drawn is good and without error bit, or no fault was found
  1  the wire answered badly, or not at all: a fault is drawn
  2  usage or machine"
);

#[derive(Debug, Args)]
pub(crate) struct Scope {
    #[command(flatten)]
    pub(crate) wire: Wire,

    /// Frame format, such as mt12,st20,nE,nW,crc6, the name of a preset, or auto; without one the bits are drawn
    #[arg(
        short,
        long,
        value_name = "FORMAT|PRESET|auto",
        env = FRAME_VARIABLE,
        hide_env_values = true
    )]
    pub(crate) frame: Option<Wanted>,

    /// Number of cycles to draw
    #[arg(short = 'n', long, value_name = "N", default_value_t = 1,
          value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub(crate) count: u64,

    /// Cycles to leave out before: the first one drawn has this seq in the records of read
    #[arg(
        long,
        value_name = "N",
        default_value_t = 0,
        hide_default_value = true,
        visible_alias = "seq"
    )]
    pub(crate) skip: u64,

    /// Begin with the first cycle at this time or later, as read shows it: since the first cycle
    #[arg(long, value_name = "TIME")]
    pub(crate) at: Option<Nanos>,

    /// Draw the first cycle with a fault; -n draws those behind it too
    #[arg(long)]
    pub(crate) fault: bool,

    /// Cycles to look at for a fault [default: 10000, all of a recording]
    #[arg(long, value_name = "N", requires = "fault", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) within: Option<u64>,

    /// Write an SVG instead, - for standard output
    #[arg(short, long, value_name = "FILE.svg", conflicts_with_all = ["ascii", "width", "color"])]
    pub(crate) write: Option<PathBuf>,

    /// Lines of - and + even where the locale knows better ones
    #[arg(long)]
    pub(crate) ascii: bool,

    /// Length of the lines [default: the terminal's, COLUMNS, else 80]
    #[arg(long, value_name = "COLUMNS", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) width: Option<u16>,

    /// Colours
    #[arg(long, value_enum, default_value_t = ColorWhen::Auto)]
    pub(crate) color: ColorWhen,
}
