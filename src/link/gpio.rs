//! `gpio`: two lines of a GPIO chip through the character device's v1 interface.
//!
//! A v1 handle has one direction, so MA and SLO have one each; single-line handles do not allocate.

use super::bitbang::{Bang, Pins};
use super::{Error, Monotonic};
use crate::limits::REST_NS;
use gpio_cdev::{Chip, Line, LineHandle, LineRequestFlags};
use nix::errno::Errno;
use std::error::Error as _;

/// MA and SLO as requested lines. Dropping it leaves MA high for 40 µs before the kernel takes it back.
#[derive(Debug)]
pub struct GpioPins {
    ma: LineHandle,
    slo: LineHandle,
    time: Monotonic,
    set_ns: u64,
    get_ns: u64,
}

/// Requests both lines, MA driven high from the first moment on.
///
/// # Errors
/// When the chip or a line does not exist, may not be used, or is in use: then its consumer is named.
pub fn open(chip: Option<&str>, ma: &str, slo: &str) -> Result<Bang<GpioPins>, Error> {
    let ma = find_line(chip, ma)?;
    let slo = find_line(chip, slo)?;
    // SLO first: whoever has MA has to leave it high for a while.
    let slo = request(&slo, LineRequestFlags::INPUT, 0, "biss SLO")?;
    let ma = request(&ma, LineRequestFlags::OUTPUT, 1, "biss MA")?;
    let mut pins = GpioPins {
        ma,
        slo,
        time: Monotonic::start(),
        set_ns: 0,
        get_ns: 0,
    };
    pins.measure_calls()?;
    Ok(Bang::new(pins))
}

struct Place {
    line: Line,
    name: String,
}

fn errno(error: &gpio_cdev::Error) -> Option<Errno> {
    let source = error.source()?;
    let os = |e: &std::io::Error| e.raw_os_error().map(Errno::from_i32);
    source
        .downcast_ref::<Errno>()
        .copied()
        .or_else(|| source.downcast_ref::<std::io::Error>().and_then(os))
}

fn open_chip(text: &str) -> Result<Chip, Error> {
    let path = match text.parse::<u32>() {
        Ok(number) => format!("/dev/gpiochip{number}"),
        Err(_) if text.starts_with('/') => text.to_owned(),
        Err(_) if text.starts_with("gpiochip") => format!("/dev/{text}"),
        Err(_) => return chip_by_label(text),
    };
    Chip::new(&path).map_err(|e| {
        Error::new(
            format!("opening the GPIO chip {path}"),
            &e,
            chip_hint(errno(&e)),
        )
    })
}

fn chip_hint(errno: Option<Errno>) -> String {
    match errno {
        Some(Errno::ENOENT) => {
            let present = chip_names();
            let list = if present.is_empty() {
                "there is none".into()
            } else {
                format!("present: {}", present.join(", "))
            };
            format!("{list}; a chip is given by number, name, label or path")
        }
        Some(Errno::EACCES | Errno::EPERM) => {
            "this user may not use it: join its group (usually `gpio`), or run as root".into()
        }
        _ => "a chip is given by number, name, label or path".into(),
    }
}

/// The chips that can be opened, and the first error if none can.
fn chips() -> Result<Vec<Chip>, Error> {
    let doing = "looking for GPIO chips";
    let failed = |e: gpio_cdev::Error| Error::new(doing, &e, chip_hint(errno(&e)));
    let mut found = Vec::new();
    let mut refused = None;
    for chip in gpio_cdev::chips().map_err(failed)? {
        match chip {
            Ok(chip) => found.push(chip),
            Err(error) => refused = Some(error),
        }
    }
    // Boards link old names to new ones: that is one chip.
    found.sort_by(|a, b| (a.name(), a.path()).cmp(&(b.name(), b.path())));
    found.dedup_by(|a, b| a.name() == b.name());
    match (found.is_empty(), refused) {
        (false, _) => Ok(found),
        (true, Some(error)) => Err(failed(error)),
        (true, None) => Err(Error::new(
            doing,
            "this machine has no /dev/gpiochip*",
            "`biss read sim` works without",
        )),
    }
}

fn chip_names() -> Vec<String> {
    chips()
        .unwrap_or_default()
        .iter()
        .map(|chip| format!("{} [{}]", chip.name(), chip.label()))
        .collect()
}

fn chip_by_label(label: &str) -> Result<Chip, Error> {
    let doing = format!("looking for the GPIO chip `{label}`");
    let mut fitting: Vec<Chip> = chips()?
        .into_iter()
        .filter(|chip| chip.label() == label)
        .collect();
    match fitting.len() {
        1 => Ok(fitting.remove(0)),
        0 => Err(Error::new(
            doing,
            "no chip has this name or label",
            chip_hint(Some(Errno::ENOENT)),
        )),
        _ => {
            let all: Vec<_> = fitting.iter().map(|chip| chip.name().to_owned()).collect();
            Err(Error::new(
                doing,
                format!("several chips have this label: {}", all.join(", ")),
                "name one of them",
            ))
        }
    }
}

fn find_line(chip: Option<&str>, line: &str) -> Result<Place, Error> {
    let within = match chip {
        Some(chip) => vec![open_chip(chip)?],
        None => chips()?,
    };
    if let (Ok(offset), [chip]) = (line.parse::<u32>(), &within[..]) {
        let name = format!("line {offset} of {}", chip.name());
        return match chip.lines().nth(offset as usize) {
            Some(line) => Ok(Place { line, name }),
            None => {
                let said = format!(
                    "{} has the lines 0 to {}",
                    chip.name(),
                    chip.num_lines().saturating_sub(1)
                );
                Err(Error::new(
                    format!("looking for {name}"),
                    said,
                    "lines are given by number or by name",
                ))
            }
        };
    }
    let mut found = Vec::new();
    for chip in within {
        for candidate in chip.lines() {
            let info = candidate.info().map_err(|e| no_v1(&chip, &e))?;
            if info.name() == Some(line) {
                let name = format!("line {line} ({} {})", chip.name(), candidate.offset());
                found.push(Place {
                    line: candidate,
                    name,
                });
            }
        }
    }
    let doing = format!("looking for the line `{line}`");
    match found.len() {
        1 => Ok(found.remove(0)),
        0 => Err(Error::new(
            doing,
            "no line has this name",
            "`gpioinfo` lists names; a number needs its chip: gpio:0,ma=17,slo=27",
        )),
        _ => {
            let all: Vec<_> = found.iter().map(|place| place.name.as_str()).collect();
            Err(Error::new(
                doing,
                format!("several lines have this name: {}", all.join(", ")),
                "say which chip: gpio:CHIP,ma=…,slo=…",
            ))
        }
    }
}

/// A kernel without CONFIG_GPIO_CDEV_V1 opens the chip and refuses every v1 call about a line with EINVAL.
fn no_v1(chip: &Chip, error: &gpio_cdev::Error) -> Error {
    let doing = format!("asking {} about its lines", chip.name());
    match errno(error) {
        Some(Errno::EINVAL | Errno::ENOTTY) => Error::new(
            doing,
            "this kernel has no GPIO v1 interface (CONFIG_GPIO_CDEV_V1 is off)",
            "boot a kernel with GPIO v1, or connect the encoder to SPI: biss read spi:0.0",
        ),
        _ => Error::new(doing, error, "check the chip with `gpioinfo`"),
    }
}

fn request(
    place: &Place,
    flags: LineRequestFlags,
    value: u8,
    consumer: &str,
) -> Result<LineHandle, Error> {
    let doing = format!("requesting {} as {consumer}", place.name);
    let (line, chip) = (&place.line, place.line.chip());
    let info = line.info().map_err(|e| no_v1(&chip, &e))?;
    // Not `is_used`, which holds for every output: what gpio-cdev calls KERNEL is the flag for lines in use.
    if info.is_kernel() {
        let consumer = info.consumer().unwrap_or("the kernel");
        return Err(Error::new(
            doing,
            format!("it is held by `{consumer}`"),
            "free it, or wire the encoder to another line",
        ));
    }
    line.request(flags, value, consumer)
        .map_err(|e| match errno(&e) {
            Some(Errno::EBUSY) => Error::new(
                &doing,
                &e,
                "somebody else took it just now; `gpioinfo` shows who",
            ),
            Some(Errno::EACCES | Errno::EPERM) => {
                Error::new(&doing, &e, chip_hint(Some(Errno::EACCES)))
            }
            _ => Error::new(&doing, &e, "check the line with `gpioinfo`"),
        })
}

impl GpioPins {
    /// The middle of a few calls. MA is high already, so setting it high moves nothing.
    fn measure_calls(&mut self) -> Result<(), Error> {
        let mut sets = [0u64; 15];
        let mut gets = [0u64; 15];
        for (set, get) in sets.iter_mut().zip(&mut gets) {
            let t0 = self.time.now_ns();
            self.ma(true)?;
            let t1 = self.time.now_ns();
            self.sl()?;
            (*set, *get) = (t1 - t0, self.time.now_ns() - t1);
        }
        sets.sort_unstable();
        gets.sort_unstable();
        (self.set_ns, self.get_ns) = (sets[7], gets[7]);
        Ok(())
    }
}

const LOST: &str = "the line was lost: was the chip or its driver removed?";

impl Pins for GpioPins {
    fn ma(&mut self, high: bool) -> Result<(), Error> {
        self.ma
            .set_value(high.into())
            .map_err(|e| Error::new("driving MA", e, LOST))
    }

    fn sl(&mut self) -> Result<bool, Error> {
        self.slo
            .get_value()
            .map(|level| level != 0)
            .map_err(|e| Error::new("reading SLO", e, LOST))
    }

    fn now_ns(&self) -> u64 {
        self.time.now_ns()
    }

    fn until(&mut self, ns: u64) {
        self.time.until(ns);
    }

    fn cost_ns(&self) -> (u64, u64) {
        (self.set_ns, self.get_ns)
    }
}

impl Drop for GpioPins {
    fn drop(&mut self) {
        // On the way out there is nobody left to tell; the kernel frees the line next.
        let _ = self.ma.set_value(1);
        self.time.until(self.time.now_ns() + REST_NS);
    }
}
