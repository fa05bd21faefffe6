//! `biss stats` as clap sees it.

use super::{Framed, Measure, Polling, ReportFormat, Wire};
use clap::Args;

pub(super) const STATS_HELP: &str = concat!(
    "\
Told:
  period, jitter  from start to start, and from one period to the next; late: after the slot of -i
  ack, busy       clocks, or time where both wires are seen, from Ack to the start bit
  delay           of the line, there and back, with what it would be in metres of cable
  timeout         of the encoder, from the last MA edge to SL = 1
  level           the longest MA level or time from rise to rise of each frame
  margin          by how much earlier or later a bit may come and still be read
  position        its noise from frame to frame, how far it went, and how fast
  What a link cannot see is left out. SIGQUIT tells on stderr how it goes.

",
    links!(),
    "
Examples:
  biss stats sim                                       a thousand frames of the simulated encoder
  biss stats gpio:0,ma=17,slo=27 -f st26,nE,nW,crc6 -n 0 -i 1ms   until Ctrl-C, every millisecond
  biss stats file:bench.vcd -f st26,nE,nW,crc6 -o json  a recording, as one JSON object

Exit status:
  0  every frame was good and without error bit
  1  the wire answered badly, or not at all
  2  usage or machine"
);

/// Frames where the user has not said how many: one in a hundred is then still ten.
pub(crate) const STATS_FRAMES: u64 = 1_000;

#[derive(Debug, Args)]
#[command(mut_arg("count", |count| count.help("Number of frames, 0 for no end [default: 1000, all of a recording]")))]
pub(crate) struct Stats {
    #[command(flatten)]
    pub(crate) wire: Wire,

    #[command(flatten)]
    pub(crate) framed: Framed,

    #[command(flatten)]
    pub(crate) polling: Polling,

    #[command(flatten)]
    pub(crate) measure: Measure,

    /// How it is told
    #[arg(short = 'o', long, value_enum, default_value_t = ReportFormat::Text)]
    pub(crate) format: ReportFormat,
}
