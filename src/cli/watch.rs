//! `biss watch` as clap sees it.

use super::{ColorWhen, Framed, Measure, Polling, Wire};
use clap::Args;

pub(super) const WATCH_HELP: &str = concat!(
    "\
Shown, ten times a second whatever the rate of frames:
  every position as number, angle and bar, with speed, error and warning; where the last frame was bad, how long ago
  the last good one came; rate, late and skipped slots, jitter, line delay, Ack; faults by kind, and the last ones.
  Without a terminal on standard output one plain line a second.

Keys:
  z  count from here     r  begin the counters anew     q  end, as Ctrl-C does

",
    links!(),
    "
Examples:
  biss watch sim                                                  the simulated encoder turns
  biss watch gpio:0,ma=17,slo=27 -f st26,nE,nW,crc6               a hundred frames a second
  biss watch spi:0.0 -f resolute-26 -c 2MHz -i 1ms                a thousand

Exit status:
  0  every frame was good and without error bit
  1  the wire answered badly, or not at all
  2  usage or machine"
);

#[derive(Debug, Args)]
#[command(
    mut_arg("count", |count| count.help("Number of frames, 0 for no end [default: 0]")),
    mut_arg("interval", |interval| interval.help("From start to start; missed slots are skipped and counted [default: 10ms]"))
)]
pub(crate) struct Watch {
    #[command(flatten)]
    pub(crate) wire: Wire,

    #[command(flatten)]
    pub(crate) framed: Framed,

    #[command(flatten)]
    pub(crate) polling: Polling,

    #[command(flatten)]
    pub(crate) measure: Measure,

    /// Lines of - and # even where the locale knows better ones
    #[arg(long)]
    pub(crate) ascii: bool,

    /// Colours
    #[arg(long, value_enum, default_value_t = ColorWhen::Auto)]
    pub(crate) color: ColorWhen,
}
