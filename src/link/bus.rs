//! What every link on an SPI bus shares: the spidev itself, its errors, and its clock as it really runs.

use super::{Clock, Error, Known, Monotonic};
use crate::limits::REST_NS;
use crate::unit::Hertz;
use spidev::{SpiModeFlags, Spidev, SpidevOptions, SpidevTransfer};
use std::io;
use std::path::{Path, PathBuf};

/// A controller that shifts bits out on MOSI and in from MISO at the same time.
pub trait Bus {
    /// Shifts `out` out, and as many bytes into `back`, at `hz` or what the controller makes of it. Returns when it
    /// began; by the time it returns the last bit has passed.
    ///
    /// # Errors
    /// When the controller refuses it.
    fn shift(&mut self, hz: Hertz, out: &[u8], back: &mut [u8]) -> Result<u64, Error>;
    /// Time on the bus's clock.
    fn now_ns(&self) -> u64;
    /// Waits until then; returns at once when late.
    fn until(&mut self, ns: u64);
    /// Most bytes of one transfer.
    fn max_bytes(&self) -> usize;
    /// What it is called in messages.
    fn name(&self) -> String;
    /// Asks for MOSI to rest at this level between transfers. Whether the driver can.
    fn rest_mosi_at(&mut self, _high: bool) -> bool {
        false
    }
    /// Time passes only by these calls.
    fn virtual_time(&self) -> bool {
        false
    }
}

/// A spidev, open.
pub struct SpiBus {
    device: Spidev,
    path: PathBuf,
    time: Monotonic,
    /// The end of the last transfer.
    pub(crate) last_end_ns: u64,
    max_bytes: usize,
}

/// spidev's own default, where its parameter cannot be read.
const USUAL_BUFSIZ: usize = 4096;

impl SpiBus {
    /// Opens it; nothing moves on the wires yet.
    ///
    /// # Errors
    /// When there is no such device, or it may not be used.
    pub fn open(path: &Path) -> Result<SpiBus, Error> {
        let device = Spidev::open(path)
            .map_err(|e| Error::new(format!("opening {}", path.display()), &e, open_hint(&e)))?;
        let bufsiz = std::fs::read_to_string("/sys/module/spidev/parameters/bufsiz");
        Ok(SpiBus {
            device,
            path: path.to_owned(),
            time: Monotonic::start(),
            last_end_ns: 0,
            max_bytes: bufsiz
                .ok()
                .and_then(|text| text.trim().parse().ok())
                .unwrap_or(USUAL_BUFSIZ),
        })
    }

    /// The device file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Sets the mode, with words of eight bits.
    ///
    /// # Errors
    /// When the controller does not have it; `hint` says what that means to the link.
    pub fn configure(&mut self, mode: SpiModeFlags, hint: &str) -> Result<(), Error> {
        let options = SpidevOptions::new().bits_per_word(8).mode(mode).build();
        self.device.configure(&options).map_err(|e| {
            let doing = format!("setting SPI mode {}", mode.bits() & 3);
            self.failed(&doing, e, hint)
        })
    }

    /// Mode 0, in which every controller shifts MOSI out and MISO in.
    ///
    /// # Errors
    /// When the controller does not have it.
    pub fn patterns(&mut self) -> Result<(), Error> {
        let hint = "the controller must offer SPI mode 0 and 8-bit words";
        self.configure(SpiModeFlags::SPI_MODE_0, hint)
    }

    fn failed(&self, doing: &str, error: io::Error, hint: &str) -> Error {
        Error::new(format!("{doing} on {}", self.path.display()), error, hint)
    }

    /// Clocks in so many bytes, MOSI low or wherever the driver leaves it. Returns when it began.
    ///
    /// # Errors
    /// When the transfer fails.
    pub(crate) fn read(&mut self, hz: Hertz, buffer: &mut [u8]) -> Result<u64, Error> {
        let bytes = buffer.len();
        self.run(hz, bytes, SpidevTransfer::read(buffer))
    }

    fn run(&mut self, hz: Hertz, bytes: usize, mut transfer: SpidevTransfer) -> Result<u64, Error> {
        transfer.speed_hz = hz.0;
        let began = self.time.now_ns();
        let result = self.device.transfer(&mut transfer);
        self.last_end_ns = self.time.now_ns();
        result.map_err(|e| {
            let hint = "a message is limited to spidev's bufsiz, the clock to what the controller can divide";
            self.failed(&format!("a transfer of {bytes} bytes at {hz}"), e, hint)
        })?;
        Ok(began)
    }
}

impl Bus for SpiBus {
    fn shift(&mut self, hz: Hertz, out: &[u8], back: &mut [u8]) -> Result<u64, Error> {
        let bytes = out.len().min(back.len());
        let transfer = SpidevTransfer::read_write(&out[..bytes], &mut back[..bytes]);
        self.run(hz, bytes, transfer)
    }

    fn now_ns(&self) -> u64 {
        self.time.now_ns()
    }

    fn until(&mut self, ns: u64) {
        self.time.until(ns);
    }

    fn max_bytes(&self) -> usize {
        self.max_bytes
    }

    fn name(&self) -> String {
        self.path.display().to_string()
    }

    fn rest_mosi_at(&mut self, high: bool) -> bool {
        // SPI_MOSI_IDLE_LOW and _HIGH of linux/spi/spi.h, since Linux 6.5 and 6.11; few drivers have them.
        let bit = if high { 1 << 18 } else { 1 << 17 };
        let mode = SpiModeFlags::SPI_MODE_0 | SpiModeFlags::from_bits_retain(bit);
        self.device
            .configure(&SpidevOptions::new().mode(mode).build())
            .is_ok()
    }
}

impl std::fmt::Debug for SpiBus {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SpiBus")
            .field("path", &self.path)
            .finish_non_exhaustive()
    }
}

/// The bit clock as it is, from the time of a short and a long transfer, `took` returning how long one of so many bytes
/// takes: drivers report what was asked for. `None` where the calls themselves take longer than the bits.
///
/// # Errors
/// When a transfer fails.
pub(crate) fn measure(
    asked: Hertz,
    rounds: usize,
    lengths: [usize; 2],
    mut took: impl FnMut(usize) -> Result<u64, Error>,
) -> Result<Option<Hertz>, Error> {
    let mut best = [u64::MAX; 2];
    for _ in 0..rounds {
        for (best, bytes) in best.iter_mut().zip(lengths) {
            *best = (*best).min(took(bytes)?);
        }
    }
    let [short, long] = lengths;
    let clocks = (long - short) as u64 * 8;
    let hz = (clocks * 1_000_000_000)
        .checked_div(best[1].saturating_sub(best[0]))
        .unwrap_or(u64::MAX);
    // Faster than asked for cannot be.
    let asked = u64::from(asked.0);
    Ok((hz <= asked + asked / 20).then_some(Hertz(hz.max(1) as u32)))
}

/// From here on a bcm2835 leaves a transfer to DMA, without a gap after each byte (Linux, spi-bcm2835.c:
/// BCM2835_SPI_DMA_MIN_LENGTH).
pub(crate) const DMA_BYTES: usize = 96;

/// SCLK as it is when `asked` is asked for, measured on transfers that differ by about half a millisecond. `took` sends so
/// many bytes, at most `max_bytes`, and returns how long that took.
///
/// # Errors
/// When a transfer fails.
pub fn sclk(
    asked: Hertz,
    max_bytes: usize,
    took: impl FnMut(usize) -> Result<u64, Error>,
) -> Result<Clock, Error> {
    const SPAN_NS: u64 = 500_000;
    let bytes = |ns: u64| (u64::from(asked.0) * ns / 8_000_000_000) as usize;
    let span = bytes(SPAN_NS);
    // Where MOSI falls after a transfer, a slave must have timed out before, or it reads CDM = 1.
    let rest = bytes(REST_NS) + 1;
    let short = if span < DMA_BYTES { 8 } else { DMA_BYTES };
    let short = short.max(rest).min(max_bytes / 4);
    let long = (short + span.max(32)).min(max_bytes);
    if short == 0 {
        return Ok(asked_for(asked));
    }
    Ok(match measure(asked, 5, [short, long], took)? {
        Some(hz) => Clock {
            hz,
            known: Known::Measured,
        },
        None => asked_for(asked),
    })
}

fn asked_for(hz: Hertz) -> Clock {
    Clock {
        hz,
        known: Known::Asked,
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Transfers are no longer than a message, and where they can be, long enough for a slave to time out meanwhile.
    #[test]
    fn sclk_is_measured_with_any_length_of_message() {
        for max_bytes in [0, 3, 4, 64, 128, 1024, 4096, 65_536, usize::MAX] {
            for hz in [1, 8_000, 640_000, 8_000_000, 125_000_000, 640_000_000] {
                let (mut shortest, mut longest) = (usize::MAX, 0);
                let clock = sclk(Hertz(hz), max_bytes, |bytes| {
                    (shortest, longest) = (shortest.min(bytes), longest.max(bytes));
                    Ok(7_000 + bytes as u64 * 8_000_000_000 / u64::from(hz))
                });
                let clock = clock.unwrap_or_else(|e| panic!("{e}"));
                assert!(
                    longest <= max_bytes && longest < 100_000,
                    "{max_bytes} {hz}"
                );
                if max_bytes < 4 {
                    assert_eq!((clock.known, clock.hz), (Known::Asked, Hertz(hz)));
                    continue;
                }
                assert!(shortest < longest, "{max_bytes} {hz}");
                let off = clock.hz.0.abs_diff(hz);
                assert!(off <= hz / 50 + 1 || clock.known == Known::Asked, "{clock}");
                let short_ns = shortest as u64 * 8_000_000_000 / u64::from(hz);
                assert!(
                    max_bytes < 4 * 3201 || short_ns >= REST_NS,
                    "{max_bytes} {hz}"
                );
            }
        }
    }
}
