//! `spi`: spidev clocks MA with SCLK and samples SLO on MISO. One transfer a frame.
//!
//! In SPI modes 2 and 3 the clock idles high. The first sample of a transfer is the idle level, sample k the level
//! that rising edge k has set: mode 3 takes it with edge k+1, mode 2 half a clock before.

use super::bus::{self, Bus, SpiBus};
use super::{Caps, Clock, Error, Known, Link, Phase};
use crate::limits::{LINE_DELAY_MAX_NS, REST_NS};
use crate::trace::{Ask, MAX_CLOCKS, Trace, Until};
use crate::unit::Hertz;
use crate::waveform::{Log, Waveform};
use spidev::SpiModeFlags;
use std::path::Path;

/// An encoder on an SPI bus.
pub struct Spi {
    bus: SpiBus,
    phase: Phase,
    phase_fixed: bool,
    pad: u8,
    /// What the driver is asked for.
    asked: Hertz,
    /// What it does, as far as that is known.
    clock: Clock,
    buffer: Vec<u8>,
    /// Both wires, where somebody wants them.
    log: Option<Box<Log>>,
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
    let mut spi = Spi {
        bus: SpiBus::open(path)?,
        phase: phase.unwrap_or(Phase::Whole),
        phase_fixed: phase.is_some(),
        pad,
        asked: FIRST_CLOCK,
        clock: Clock {
            hz: FIRST_CLOCK,
            known: Known::Asked,
        },
        buffer: Vec::with_capacity(MAX_CLOCKS / 8 + 256),
        log: None,
    };
    spi.configure(spi.phase)?;
    spi.set_clock(clock.unwrap_or(FIRST_CLOCK))?;
    Ok(spi)
}

/// Notes a transfer as the clock says it was: SCLK from its beginning, and every sample a quarter of a clock after the edge
/// that had set it.
#[cold]
fn note(log: &mut Log, began_ns: u64, hz: Hertz, samples: &[u8]) {
    let quarter =
        |quarters: u64| began_ns + quarters * 1_000_000_000 / (4 * u64::from(hz.0.max(1)));
    for clock in 0..8 * samples.len() as u64 {
        let level = samples[(clock / 8) as usize] >> (7 - clock % 8) & 1 == 1;
        let set_ns = match clock {
            // From before the first edge.
            0 => began_ns.saturating_sub(quarter(1) - began_ns),
            _ => quarter(4 * clock - 1),
        };
        if log.slo_now() != Some(level) {
            log.slo(set_ns, Some(level));
        }
        log.ma(quarter(4 * clock), false);
        log.ma(quarter(4 * clock + 2), true);
    }
}

/// The SPI mode that samples there; modes 3 and 2 are all there are with an idle-high clock.
fn number(phase: Phase) -> u8 {
    if phase > Phase::Half { 3 } else { 2 }
}

impl Spi {
    fn configure(&mut self, phase: Phase) -> Result<(), Error> {
        let mode = match number(phase) {
            3 => SpiModeFlags::SPI_MODE_3,
            _ => SpiModeFlags::SPI_MODE_2,
        };
        self.bus.configure(
            mode,
            "the controller must offer an idle-high clock (CPOL = 1) and 8-bit words",
        )?;
        self.phase = phase;
        Ok(())
    }

    /// One transfer of so many bytes into the buffer. Returns when it began.
    fn transfer(&mut self, bytes: usize) -> Result<u64, Error> {
        self.buffer.clear();
        self.buffer.resize(bytes, 0);
        let began = self.bus.read(self.asked, &mut self.buffer)?;
        if let Some(log) = &mut self.log {
            note(log, began, self.clock.hz, &self.buffer);
        }
        Ok(began)
    }

    /// Begins to note both wires. SLO is not seen before the first transfer.
    #[cold]
    fn keep_log(&mut self) {
        let now_ns = self.bus.now_ns();
        self.log
            .get_or_insert_with(|| Box::new(Log::new(now_ns, true, None)));
    }

    fn rest(&mut self, ns: u64) {
        self.bus.until(self.bus.last_end_ns + ns);
    }
}

impl std::fmt::Debug for Spi {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Spi")
            .field("bus", &self.bus)
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
        self.bus.now_ns()
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
        let asked = self.asked;
        let measured = bus::measure(asked, 5, [8, 64], |bytes| {
            let began = self.transfer(bytes)?;
            let took = self.bus.last_end_ns - began;
            self.rest(SETTLE_NS);
            Ok(took)
        })?;
        if let Some(hz) = measured {
            self.clock = Clock {
                hz,
                known: Known::Measured,
            };
        }
        Ok(self.clock)
    }

    fn set_phase(&mut self, phase: Phase) -> Result<(), Error> {
        self.configure(phase)?;
        self.bus.until(self.bus.now_ns() + SETTLE_NS);
        Ok(())
    }

    fn idle(&mut self, ns: u64) -> Result<Option<bool>, Error> {
        self.bus.until(self.bus.now_ns() + ns);
        Ok(None)
    }

    fn cycles(&mut self, asks: &[Ask], out: &mut [Trace]) -> Result<usize, Error> {
        for (ask, trace) in asks.iter().zip(out.iter_mut()) {
            trace.reset();
            if trace.wave.is_some() {
                self.keep_log();
            }
            let Until::Clocks(clocks) = ask.clocks.until else {
                let doing = format!("a frame on {}", self.bus.path().display());
                return Err(Error::new(
                    doing,
                    "spidev cannot react to SL while it clocks",
                    "plan the clocks beforehand",
                ));
            };
            let rest = ask.clocks.ready_ns.map_or(0, u64::from);
            self.bus.until(ask.at_ns.max(self.bus.last_end_ns + rest));
            // The last edge's level is never sampled, the first sample is the idle level.
            let bytes = (usize::from(clocks) + 1).div_ceil(8) + usize::from(self.pad);
            trace.t_ns = self.transfer(bytes)?;
            trace.ma_period_ns = u32::try_from(self.clock.hz.period_ns()).ok();
            trace.cdm = Some(false);
            trace.surplus = ask.clocks.surplus;
            trace.idle = self.buffer.first().map(|byte| byte >> 7 == 1);
            trace.bits.set_behind_first(&self.buffer);
            if let Some(log) = &mut self.log {
                match &mut trace.wave {
                    Some(wave) => {
                        log.pour(wave);
                        let quarters = 4 + self.phase as u64;
                        let hz = 4 * u64::from(self.clock.hz.0.max(1));
                        let at = |bit: u64| (4 * bit + quarters - 2) * 1_000_000_000 / hz;
                        let places = (0..trace.bits.len() as u64).map(|bit| trace.t_ns + at(bit));
                        wave.samples_ns.extend(places);
                    }
                    None => log.forget(),
                }
            }
        }
        Ok(asks.len().min(out.len()))
    }

    fn waveform(&mut self, wave: &mut Waveform) -> Result<(), Error> {
        self.keep_log();
        if let Some(log) = &mut self.log {
            log.pour(wave);
        }
        Ok(())
    }

    fn notes(&self) -> Vec<String> {
        vec![format!(
            "{}: mode {}, {}; other devices on this bus clock MA too",
            self.bus.path().display(),
            number(self.phase),
            self.clock
        )]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::slice::Slicer;

    /// What is noted of two transfers reads back to the bits of both.
    #[test]
    fn transfers_read_back() {
        // Idle, then LAT, Ack, start, CDS, eight bits and zeros: Ack as it comes, and three clocks late.
        for (bits, delay_clk) in [("1101010100110000", 0), ("111110101010011000000000", 3)] {
            let byte = |bits: &[u8]| {
                let bit = |byte: u8, bit: &u8| byte << 1 | (bit - b'0');
                bits.iter().fold(0, bit)
            };
            let bytes: Vec<u8> = bits.as_bytes().chunks(8).map(byte).collect();
            for hz in [250_000, 1_000_000, 7_812_500, 10_000_000] {
                let mut log = Log::new(1_000, true, None);
                note(&mut log, 200_000, Hertz(hz), &bytes);
                note(&mut log, 900_000, Hertz(hz), &bytes);
                let mut wave = Waveform::default();
                log.pour(&mut wave);
                let mut slicer = Slicer::new(40_000);
                for change in &wave.changes {
                    slicer.push(change.t_ns, change.ma, change.slo);
                }
                slicer.finish(2_000_000);
                let mut trace = Trace::default();
                for begins in [200_000, 900_000] {
                    assert!(slicer.take(&mut trace));
                    assert_eq!((trace.t_ns, trace.idle), (begins, Some(true)));
                    let late = trace.delay_ns.map(|ns| ns * (hz / 1000) / 1_000_000);
                    assert_eq!(late, Some(delay_clk));
                    let sent = format!("1{}", &bits[2 + delay_clk as usize..]);
                    let seen = trace.bits.to_string();
                    assert_eq!(seen[..sent.len() - 1], sent[..sent.len() - 1]);
                }
                assert!(!slicer.take(&mut trace));
            }
        }
    }
}
