//! `gpio`: lines of a GPIO chip through the character device, v1 where the kernel has it, else v2.
//!
//! Each line is a request of its own: a v1 request has one direction, and a single line needs no allocation.

mod lines;
mod serve;
mod v1;
mod v2;

pub use lines::{
    ChipInfo, Chips, Line, LineInfo, Place, Pull, all_chips, among, chips, choose, find, has,
    lines, uapi,
};

pub use serve::Served;

use super::bitbang::{Bang, Pins};
use super::{Error, Monotonic, Uapi};
use crate::limits::REST_NS;

/// MA, SLO and perhaps MO as requested lines. Dropping it leaves MA high for 40 µs before the kernel takes it back.
#[derive(Debug)]
pub struct GpioPins {
    ma: Line,
    slo: Line,
    mo: Option<Line>,
    uapi: Uapi,
    time: Monotonic,
    set_ns: u64,
    get_ns: u64,
}

/// Requests the lines, MA and MO driven high from the first moment on.
///
/// # Errors
/// When the chip or a line does not exist, may not be used, or is in use: then its consumer is named. When the kernel
/// does not have the interface that was asked for.
pub fn open(
    chip: Option<&str>,
    ma: &str,
    slo: &str,
    mo: Option<&str>,
    uapi: Option<Uapi>,
) -> Result<Bang<GpioPins>, Error> {
    let chips = among(chip)?;
    let uapi = choose(&chips[0], uapi)?;
    let ma = find(&chips, ma, uapi)?;
    let slo = find(&chips, slo, uapi)?;
    let mo = mo.map(|mo| find(&chips, mo, uapi)).transpose()?;
    let all: Vec<&Place> = [&ma, &slo].into_iter().chain(&mo).collect();
    different(&all)?;
    // MA last: whoever has it has to leave it high for a while.
    let slo = slo.input("SLO")?;
    let mo = mo.map(|mo| mo.output("MO", true)).transpose()?;
    let ma = ma.output("MA", true)?;
    Ok(Bang::new(GpioPins::new(ma, slo, mo, uapi)?))
}

/// A line can be given by name and by number.
///
/// # Errors
/// When one is given twice.
pub fn different(lines: &[&Place]) -> Result<(), Error> {
    for (index, line) in lines.iter().enumerate() {
        if lines[..index].iter().any(|other| other.is_same(line)) {
            return Err(Error::new(
                "choosing lines",
                format!("{} is given twice", line.shown()),
                "each line is for one thing",
            ));
        }
    }
    Ok(())
}

impl GpioPins {
    /// Takes over lines, MA and MO driven high.
    ///
    /// # Errors
    /// When they cannot be used.
    pub fn new(ma: Line, slo: Line, mo: Option<Line>, uapi: Uapi) -> Result<GpioPins, Error> {
        let mut pins = GpioPins {
            ma,
            slo,
            mo,
            uapi,
            time: Monotonic::start(),
            set_ns: 0,
            get_ns: 0,
        };
        pins.measure_calls()?;
        Ok(pins)
    }

    /// Lets a slave in another thread run while waiting, where both have one processor.
    pub fn share_processor(&mut self) {
        self.time.share();
    }

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

impl Pins for GpioPins {
    fn ma(&mut self, high: bool) -> Result<(), Error> {
        self.ma.set(high)
    }

    fn sl(&mut self) -> Result<bool, Error> {
        self.slo.get()
    }

    fn has_mo(&self) -> bool {
        self.mo.is_some()
    }

    fn mo(&mut self, high: bool) -> Result<(), Error> {
        match &self.mo {
            Some(mo) => mo.set(high),
            None => Ok(()),
        }
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

    fn note(&self) -> Option<String> {
        let pull = match self.slo.pull() {
            Pull::AsItWas => "the pull of SLO is as it was",
            Pull::Up => "a pull-up asked for on SLO",
            Pull::Refused => "the driver refuses a pull-up on SLO, so its pull is as it was",
        };
        Some(format!("GPIO {}, {pull}", self.uapi))
    }
}

impl Drop for GpioPins {
    fn drop(&mut self) {
        // On the way out there is nobody left to tell; the kernel frees the line next.
        let _ = self.ma.set(true);
        let _ = self.mo(true);
        self.time.until(self.time.now_ns() + REST_NS);
    }
}
