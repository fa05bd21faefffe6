//! `spi`: spidev clocks MA with SCLK and samples SLO on MISO. One transfer a frame.
//!
//! In SPI modes 2 and 3 the clock idles high. The first sample of a transfer is the idle level, sample k the level
//! that rising edge k has set: mode 3 takes it with edge k+1, mode 2 half a clock before.

use super::{Caps, Clock, Error, Known, Link, Monotonic, Phase};
use crate::limits::{LINE_DELAY_MAX_NS, REST_NS};
use crate::trace::{Ask, MAX_CLOCKS, Trace, Until};
use crate::unit::Hertz;
use spidev::{SpiModeFlags, Spidev, SpidevOptions, SpidevTransfer};
use std::io;
use std::path::{Path, PathBuf};

/// An encoder on an SPI bus.
pub struct Spi {
    device: Spidev,
    path: PathBuf,
    time: Monotonic,
    phase: Phase,
    phase_fixed: bool,
    pad: u8,
    /// What the driver is asked for.
    asked: Hertz,
    /// What it does, as far as that is known.
    clock: Clock,
    last_end_ns: u64,
    buffer: Vec<u8>,
}

/// What every encoder must take at first contact (D2 Table 10).
const FIRST_CLOCK: Hertz = Hertz(1_000_000);

/// MA rests this long after the controller may have moved it: the slave's rest, and the way back.
const SETTLE_NS: u64 = REST_NS + LINE_DELAY_MAX_NS;

/// Opens a spidev. `phase` fixes the sampling phase, `pad` bytes are clocked on top of every frame.
///
/// # Errors
/// When the device cannot be opened or does not take an idle-high clock.
pub fn open(
    path: &Path,
    phase: Option<Phase>,
    pad: u8,
    clock: Option<Hertz>,
) -> Result<Spi, Error> {
    let device = Spidev::open(path)
        .map_err(|e| Error::new(format!("opening {}", path.display()), &e, open_hint(&e)))?;
    let mut spi = Spi {
        device,
        path: path.to_owned(),
        time: Monotonic::start(),
        phase: phase.unwrap_or(Phase::Whole),
        phase_fixed: phase.is_some(),
        pad,
        asked: FIRST_CLOCK,
        clock: Clock {
            hz: FIRST_CLOCK,
            known: Known::Asked,
        },
        last_end_ns: 0,
        buffer: Vec::with_capacity(MAX_CLOCKS / 8 + 256),
    };
    spi.configure(spi.phase)?;
    spi.set_clock(clock.unwrap_or(FIRST_CLOCK))?;
    Ok(spi)
}

fn open_hint(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::NotFound => {
            let present = devices();
            let list = if present.is_empty() {
                "there is none".into()
            } else {
                format!("present: {}", present.join(" "))
            };
            format!(
                "{list}; on a Raspberry Pi, SPI is switched on by `dtparam=spi=on` in config.txt"
            )
        }
        io::ErrorKind::PermissionDenied => {
            "this user may not use it: join its group (usually `spi`), or run as root".into()
        }
        _ => "check that it is a spidev and that nothing else holds it".into(),
    }
}

/// The SPI mode that samples there; modes 3 and 2 are all there are with an idle-high clock.
fn number(phase: Phase) -> u8 {
    if phase > Phase::Half { 3 } else { 2 }
}

fn devices() -> Vec<String> {
    let names = std::fs::read_dir("/dev").into_iter().flatten().flatten();
    let mut found: Vec<String> = names
        .filter_map(|entry| entry.file_name().into_string().ok())
        .filter_map(|name| {
            name.strip_prefix("spidev")
                .map(|numbers| format!("spi:{numbers}"))
        })
        .collect();
    found.sort();
    found
}

impl Spi {
    fn failed(&self, doing: &str, error: io::Error, hint: &str) -> Error {
        Error::new(format!("{doing} on {}", self.path.display()), error, hint)
    }

    fn configure(&mut self, phase: Phase) -> Result<(), Error> {
        let mode = match number(phase) {
            3 => SpiModeFlags::SPI_MODE_3,
            _ => SpiModeFlags::SPI_MODE_2,
        };
        let options = SpidevOptions::new().bits_per_word(8).mode(mode).build();
        self.device.configure(&options).map_err(|e| {
            let doing = format!("setting SPI mode {}", number(phase));
            self.failed(
                &doing,
                e,
                "the controller must offer an idle-high clock (CPOL = 1) and 8-bit words",
            )
        })?;
        self.phase = phase;
        Ok(())
    }

    /// One transfer of so many bytes into the buffer. Returns when it began.
    fn transfer(&mut self, bytes: usize) -> Result<u64, Error> {
        self.buffer.clear();
        self.buffer.resize(bytes, 0);
        let mut transfer = SpidevTransfer::read(&mut self.buffer);
        transfer.speed_hz = self.asked.0;
        let began = self.time.now_ns();
        let result = self.device.transfer(&mut transfer);
        self.last_end_ns = self.time.now_ns();
        result.map_err(|e| {
            let hint = "a message is limited to spidev's bufsiz, the clock to what the controller can divide";
            self.failed(&format!("a transfer of {bytes} bytes at {}", self.asked), e, hint)
        })?;
        Ok(began)
    }

    fn rest(&mut self, ns: u64) {
        self.time.until(self.last_end_ns + ns);
    }

    /// The clock as it is, from the time of a short and a long transfer: drivers report what was asked for.
    fn measure(&mut self) -> Result<Option<Hertz>, Error> {
        let (short, long) = (8usize, 64usize);
        let mut best = [u64::MAX; 2];
        for _ in 0..5 {
            for (best, bytes) in best.iter_mut().zip([short, long]) {
                let began = self.transfer(bytes)?;
                *best = (*best).min(self.last_end_ns - began);
                self.rest(SETTLE_NS);
            }
        }
        let clocks = (long - short) as u64 * 8;
        let span = best[1].saturating_sub(best[0]);
        let hz = (clocks * 1_000_000_000)
            .checked_div(span)
            .unwrap_or(u64::MAX);
        // Faster than asked for cannot be: then the calls themselves took longer than the bits.
        let asked = u64::from(self.asked.0);
        Ok((hz <= asked + asked / 20).then_some(Hertz(hz.max(1) as u32)))
    }
}

impl std::fmt::Debug for Spi {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Spi")
            .field("path", &self.path)
            .finish_non_exhaustive()
    }
}

impl Link for Spi {
    fn caps(&self) -> Caps {
        Caps {
            live: true,
            reacts: false,
            cdm: false,
            sees_idle: false,
            times_levels: false,
            phases: if self.phase_fixed {
                &[]
            } else {
                &[Phase::Whole, Phase::Half]
            },
            virtual_time: false,
            burst: 1,
        }
    }

    fn now_ns(&self) -> u64 {
        self.time.now_ns()
    }

    fn clock(&self) -> Clock {
        self.clock
    }

    fn set_clock(&mut self, hz: Hertz) -> Result<Clock, Error> {
        self.asked = hz;
        self.clock = Clock {
            hz,
            known: Known::Asked,
        };
        // Drivers set the idle level of the clock with the first message only. To the encoder this is INIT.
        self.transfer(1)?;
        self.rest(SETTLE_NS);
        Ok(self.clock)
    }

    fn measure_clock(&mut self) -> Result<Clock, Error> {
        if let Some(hz) = self.measure()? {
            self.clock = Clock {
                hz,
                known: Known::Measured,
            };
        }
        Ok(self.clock)
    }

    fn set_phase(&mut self, phase: Phase) -> Result<(), Error> {
        self.configure(phase)?;
        self.time.until(self.time.now_ns() + SETTLE_NS);
        Ok(())
    }

    fn idle(&mut self, ns: u64) -> Result<Option<bool>, Error> {
        self.time.until(self.time.now_ns() + ns);
        Ok(None)
    }

    fn cycles(&mut self, asks: &[Ask], out: &mut [Trace]) -> Result<usize, Error> {
        for (ask, trace) in asks.iter().zip(out.iter_mut()) {
            trace.reset();
            let Until::Clocks(clocks) = ask.clocks.until else {
                let doing = format!("a frame on {}", self.path.display());
                return Err(Error::new(
                    doing,
                    "spidev cannot react to SL while it clocks",
                    "plan the clocks beforehand",
                ));
            };
            let rest = ask.clocks.ready_ns.map_or(0, u64::from);
            self.time.until(ask.at_ns.max(self.last_end_ns + rest));
            // The last edge's level is never sampled, the first sample is the idle level.
            let bytes = (usize::from(clocks) + 1).div_ceil(8) + usize::from(self.pad);
            trace.t_ns = self.transfer(bytes)?;
            trace.ma_period_ns = u32::try_from(self.clock.hz.period_ns()).ok();
            trace.cdm = Some(false);
            trace.surplus = ask.clocks.surplus;
            let bits = self
                .buffer
                .iter()
                .flat_map(|byte| (0..8).rev().map(move |place| byte >> place & 1 == 1));
            trace.idle = self.buffer.first().map(|byte| byte >> 7 == 1);
            trace.bits.extend(bits.skip(1));
        }
        Ok(asks.len().min(out.len()))
    }

    fn notes(&self) -> Vec<String> {
        vec![format!(
            "{}: mode {}, {}; other devices on this bus clock MA too",
            self.path.display(),
            number(self.phase),
            self.clock
        )]
    }
}
