//! A link as it was asked for on the command line, opened.

use super::asked::USUAL_CLOCK;
use crate::cli;
use crate::output::Progress;
use crate::sys::{self, Signals};
use anyhow::{Result, anyhow, bail};
use biss::format::Format;
use biss::frame::{BissC, Stall};
use biss::limits;
use biss::link::{self, Clock, Kind, Link, Spec};
use biss::preset::Frame;
use biss::unit::{Hertz, Nanos};
use std::io::{self, Read, Seek, SeekFrom};

/// What all commands that talk to an encoder are told about the way to it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line<'a> {
    pub(super) link: &'a Spec,
    /// What a simulated slave sends unless its link says otherwise.
    pub(super) frame: Option<&'a Frame>,
    pub(super) clock: Option<Hertz>,
    pub(super) timeout: Option<cli::Timeout>,
    pub(super) ack_limit: Nanos,
    pub(super) busy_limit: Nanos,
    /// Nothing is said about how far a recording has been read.
    pub(super) quiet: bool,
}

impl<'a> Line<'a> {
    /// The one that was asked for, where a simulated slave may send `frame`.
    pub(super) fn of(wire: &'a cli::Wire, frame: Option<&'a Frame>) -> Line<'a> {
        Line {
            link: &wire.link,
            frame,
            clock: wire.clock,
            timeout: wire.timeout,
            ack_limit: wire.ack_limit,
            busy_limit: wire.busy_limit,
            quiet: wire.quiet,
        }
    }

    /// Opens it. `flush` is called before a slow recording is waited for.
    pub(super) fn open(
        &self,
        signals: &Signals,
        flush: impl Fn() + 'static,
    ) -> Result<Box<dyn Link>> {
        Ok(match &self.link.kind {
            Kind::Gpio {
                chip,
                ma,
                slo,
                mo,
                uapi,
                far,
            } => {
                if far.is_some() {
                    bail!(
                        "ma-in= and slo-out= are the far ends of jumpers, where `biss loopback` puts a slave of its own\n  leave them out to read an encoder"
                    );
                }
                let mut link = link::gpio::open(chip.as_deref(), ma, slo, mo.as_deref(), *uapi)?;
                if let Some(clock) = self.clock {
                    link.set_clock(clock)?;
                }
                Box::new(link)
            }
            Kind::Spi { path, phase, pad } => {
                Box::new(link::spi::open(path, *phase, *pad, self.clock)?)
            }
            Kind::Wave {
                path,
                oversample,
                invert,
                idle,
            } => {
                let options = link::wave::Options {
                    oversample: *oversample,
                    invert: *invert,
                    idle: *idle,
                };
                let adaptive =
                    matches!(self.timeout, Some(timeout) if timeout.stall == Stall::Adaptive);
                if adaptive && !options.ma_rests_high() {
                    bail!(
                        "an adaptive timeout on a wave link whose MA rests low: the edges around each transfer would begin frames of their own\n  \
                     swap the MA pair and say invert, or use gpio"
                    );
                }
                Box::new(link::wave::open(path, options, self.clock)?)
            }
            Kind::Sim { config, .. } => {
                let mut config = (**config).clone();
                // The slave sends what its link says, else what is asked for.
                if let Some(frame) = self.link.frame.as_ref().or(self.frame) {
                    config.play(frame);
                }
                config.chain()?;
                let mut link = link::sim::open(config);
                link.set_clock(self.clock.unwrap_or(USUAL_CLOCK))?;
                Box::new(link)
            }
            Kind::File {
                path,
                ma,
                slo,
                rate,
                unit,
            } => {
                let stdin = path.as_os_str() == "-";
                let name = if stdin {
                    "standard input".into()
                } else {
                    path.display().to_string()
                };
                let said = |e| {
                    anyhow!(
                        "opening the recording {name}: {e}\n  check the path; a comma in it is written \\,"
                    )
                };
                let file = if stdin { sys::stdin() } else { sys::open(path) }.map_err(said)?;
                if file.metadata().is_ok_and(|data| data.is_dir()) {
                    bail!(
                        "opening the recording {name}: it is a folder\n  a recording is one file: say which, as file:{}",
                        path.join("NAME.sr").display()
                    );
                }
                let whole = sys::is_whole(&file);
                let total = file
                    .metadata()
                    .ok()
                    .filter(|_| whole)
                    .map(|data| data.len());
                let inner = sys::Input::new(file, signals, flush).map_err(|e| {
                anyhow!(
                    "waiting for input: {e}\n  is a limit of this process used up (`ulimit -a`)?"
                )
            })?;
                let input = Watched {
                    inner,
                    progress: Progress::new(&name, total, self.quiet),
                };
                let timeout_max_ns = self
                    .timeout
                    .map_or(cli::TIMEOUT_MAX, |timeout| timeout.max)
                    .0;
                let input = if whole {
                    link::file::Input::blocks(input)
                } else {
                    link::file::Input::pipe(input)
                };
                let asked = link::file::Asked {
                    ma: ma.clone(),
                    slo: slo.clone(),
                    rate: *rate,
                    unit: *unit,
                    timeout_max_ns,
                };
                Box::new(link::file::open(input, &name, &asked)?)
            }
            Kind::Exec(options) => {
                let mut link = link::exec::open(options, signals.watch())?;
                link.set_clock(self.clock.unwrap_or(USUAL_CLOCK))?;
                Box::new(link)
            }
        })
    }

    /// BiSS-C with the limits that were asked for.
    pub(super) fn protocol(&self, format: Format) -> BissC {
        let mut protocol = BissC::new(format);
        let ns = |time: Nanos| u32::try_from(time.0).unwrap_or(u32::MAX);
        protocol.ack_limit_ns = ns(self.ack_limit);
        protocol.busy_limit_ns = ns(self.busy_limit);
        if let Some(timeout) = self.timeout {
            protocol.stall = timeout.stall;
            protocol.timeout_max_ns = ns(timeout.max);
        }
        protocol
    }
}

/// An input that says how far it is.
struct Watched {
    inner: sys::Input,
    progress: Progress,
}

impl Read for Watched {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let n = self.inner.read(buffer)?;
        self.progress.add(n);
        Ok(n)
    }
}

impl link::file::Blocks for Watched {
    fn exchange(&mut self, block: &mut Vec<u8>) -> io::Result<usize> {
        let n = self.inner.exchange(block)?;
        self.progress.add(n);
        Ok(n)
    }
}

impl Seek for Watched {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.inner.seek(to)
    }
}

/// That the clock is not the one that was asked for.
pub(super) fn unreached(clock: Clock, asked: Option<Hertz>) -> Option<String> {
    let asked = asked.filter(|asked| clock.hz.0 < asked.0 - asked.0 / 10)?;
    Some(format!(
        "MA runs at {clock}: {asked} is more than this link can do"
    ))
}

/// That the clock is slower than a slave has to bear.
pub(super) fn too_slow(clock: Clock) -> Option<String> {
    (clock.hz.0 < limits::CLOCK_MIN_HZ)
        .then(|| format!("MA runs at {clock}, below the 80 kHz that BiSS-C asks for"))
}

/// That the clock alone makes frames count as stalled, where nobody has said how long the slave waits.
pub(super) fn stalls(clock: Clock) -> Option<&'static str> {
    (clock.hz.period_ns() >= limits::LEVEL_MAX_NS).then_some(
        "a clock takes 12 us or more, as long as some slaves wait: frames count as stalled unless --timeout says more",
    )
}
