//! Links: everything that can run cycles, from two GPIO lines to a recording, behind one trait.

pub mod bitbang;
pub mod bus;
pub mod exec;
pub mod file;
pub mod gpio;
pub mod sim;
pub mod spec;
pub mod spi;
pub mod tap;
pub mod wave;

pub use spec::{Kind, Spec};

use crate::trace::{Ask, Trace};
use crate::unit::Hertz;
use crate::waveform::Waveform;
use std::cell::RefCell;
use std::fmt;
use std::rc::Rc;
use std::time::{Duration, Instant};

/// What a link can do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Caps {
    /// False for a recording: what is asked is ignored, nothing is paced, repeated or recovered.
    pub live: bool,
    /// Sees SL while clocking: [`crate::trace::Until::Frame`] and differing CDM entries are honoured.
    pub reacts: bool,
    /// Can send CDM = 1.
    pub cdm: bool,
    /// Sees SL without clocking.
    pub sees_idle: bool,
    /// Bounds the length of MA levels.
    pub times_levels: bool,
    /// Where in a bit it can sample SL, the usual place first; empty where there is no choice.
    pub phases: &'static [Phase],
    /// Time passes only while cycles run.
    pub virtual_time: bool,
    /// Cycles that one system call can hold.
    pub burst: u16,
}

/// An MA clock, and how far to trust the figure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clock {
    /// The frequency.
    pub hz: Hertz,
    /// Where it comes from.
    pub known: Known,
}

/// Where a figure comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Known {
    /// What the driver was asked for; it may do less.
    Asked,
    /// Measured on this link.
    Measured,
}

impl fmt::Display for Clock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.hz)?;
        match self.known {
            Known::Asked => f.write_str(" (asked)"),
            Known::Measured => f.write_str(" (measured)"),
        }
    }
}

/// Where in a bit SL is sampled: so many quarters of a clock after the rising edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phase {
    /// In the middle of the high level.
    Quarter = 1,
    /// With the falling edge, as SPI mode 2 does.
    Half = 2,
    /// In the middle of the low level.
    ThreeQuarters = 3,
    /// With the next rising edge, as SPI mode 3 does: the whole bit is delay budget.
    Whole = 4,
}

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Phase::Quarter => "a quarter of a clock after each rising MA edge",
            Phase::Half => "with each falling MA edge",
            Phase::ThreeQuarters => "three quarters of a clock after each rising MA edge",
            Phase::Whole => "just before the next rising MA edge",
        })
    }
}

/// The kernel's interfaces to GPIO lines. Each can be left out of a kernel, and v1 is on recent ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Uapi {
    /// The first one, since Linux 4.8.
    V1,
    /// The second one, since Linux 5.10: inputs can have a pull.
    V2,
}

impl fmt::Display for Uapi {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Uapi::V1 => "v1",
            Uapi::V2 => "v2",
        })
    }
}

/// The machine failed: what was being done, what the system said, what to try.
#[derive(Debug)]
pub struct Error {
    doing: String,
    said: String,
    hint: String,
}

impl Error {
    /// All three parts.
    pub fn new(
        doing: impl Into<String>,
        said: impl fmt::Display,
        hint: impl Into<String>,
    ) -> Error {
        Error {
            doing: doing.into(),
            said: said.to_string(),
            hint: hint.into(),
        }
    }

    /// What the system said.
    pub fn said(&self) -> &str {
        &self.said
    }

    /// What to try.
    pub fn hint(&self) -> &str {
        &self.hint
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}\n  {}", self.doing, self.said, self.hint)
    }
}

impl std::error::Error for Error {}

/// Two wires, or what stands for them.
pub trait Link {
    /// What it can do.
    fn caps(&self) -> Caps;

    /// Its own clock: monotonic on hardware, virtual for `sim`, recorded for `file`.
    fn now_ns(&self) -> u64;

    /// The MA clock as it runs.
    fn clock(&self) -> Clock;

    /// Asks for an MA clock and says what was achieved.
    ///
    /// # Errors
    /// When the device refuses it, and on recordings.
    fn set_clock(&mut self, hz: Hertz) -> Result<Clock, Error>;

    /// Measures the clock as it really runs, where that takes transfers of its own.
    ///
    /// # Errors
    /// When a transfer fails.
    fn measure_clock(&mut self) -> Result<Clock, Error> {
        Ok(self.clock())
    }

    /// Samples SL at another place in the bit, one of [`Caps::phases`].
    ///
    /// # Errors
    /// When the device refuses it.
    fn set_phase(&mut self, _phase: Phase) -> Result<(), Error> {
        Ok(())
    }

    /// Drives MA upside down from now on, as behind a swapped pair, and lets it rest so; or no more. False where that cannot be
    /// done without another way of running.
    ///
    /// # Errors
    /// When MA cannot be driven.
    fn turn_ma(&mut self, _upside_down: bool) -> Result<bool, Error> {
        Ok(false)
    }

    /// MA high for so long, then SL, where it can be seen without clocking.
    ///
    /// # Errors
    /// When a line cannot be driven or read.
    fn idle(&mut self, ns: u64) -> Result<Option<bool>, Error>;

    /// Runs `asks` in order into `out`, which is as long; returns how many ran. Fewer means the recording has ended.
    ///
    /// # Errors
    /// When the device fails, or a recording is damaged: after everything good before it was delivered.
    fn cycles(&mut self, asks: &[Ask], out: &mut [Trace]) -> Result<usize, Error>;

    /// Copies the cycle of a recording that comes `index` cycles behind the next one, without taking it. False where there is
    /// none, and on links that run cycles as they are asked for.
    fn ahead(&mut self, _index: usize, _trace: &mut Trace) -> bool {
        false
    }

    /// Adds what both wires have done since the last cycle, and keeps it from now on: the first call hands over the levels as
    /// they are. A cycle hands over its own, and what came before it, through [`Trace::wave`]. Needed only by those who want what
    /// is before the first cycle and after the last one.
    ///
    /// # Errors
    /// When SL cannot be read.
    fn waveform(&mut self, _wave: &mut Waveform) -> Result<(), Error> {
        Ok(())
    }

    /// What the user should know about how this link runs, one line each.
    fn notes(&self) -> Vec<String> {
        Vec::new()
    }

    /// What may be wrong with how a recording is read, in one line: after its end, and where it shows it.
    fn advice(&self, _any_good: bool) -> Option<String> {
        None
    }
}

/// One link, looked at from two sides.
impl<L: Link> Link for Rc<RefCell<L>> {
    fn caps(&self) -> Caps {
        self.borrow().caps()
    }
    fn now_ns(&self) -> u64 {
        self.borrow().now_ns()
    }
    fn clock(&self) -> Clock {
        self.borrow().clock()
    }
    fn set_clock(&mut self, hz: Hertz) -> Result<Clock, Error> {
        self.borrow_mut().set_clock(hz)
    }
    fn measure_clock(&mut self) -> Result<Clock, Error> {
        self.borrow_mut().measure_clock()
    }
    fn set_phase(&mut self, phase: Phase) -> Result<(), Error> {
        self.borrow_mut().set_phase(phase)
    }
    fn turn_ma(&mut self, upside_down: bool) -> Result<bool, Error> {
        self.borrow_mut().turn_ma(upside_down)
    }
    fn idle(&mut self, ns: u64) -> Result<Option<bool>, Error> {
        self.borrow_mut().idle(ns)
    }
    fn cycles(&mut self, asks: &[Ask], out: &mut [Trace]) -> Result<usize, Error> {
        self.borrow_mut().cycles(asks, out)
    }
    fn ahead(&mut self, index: usize, trace: &mut Trace) -> bool {
        self.borrow_mut().ahead(index, trace)
    }
    fn waveform(&mut self, wave: &mut Waveform) -> Result<(), Error> {
        self.borrow_mut().waveform(wave)
    }
    fn notes(&self) -> Vec<String> {
        self.borrow().notes()
    }
    fn advice(&self, any_good: bool) -> Option<String> {
        self.borrow().advice(any_good)
    }
}

/// The monotonic clock of hardware links.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Monotonic {
    start: Instant,
    /// Another thread of ours waits for this processor too.
    shared: bool,
}

/// A sleep ends late by some tens of microseconds: the rest is spun.
const SPIN_NS: u64 = 200_000;

impl Monotonic {
    pub(crate) fn start() -> Monotonic {
        Monotonic {
            start: Instant::now(),
            shared: false,
        }
    }

    pub(crate) fn now_ns(self) -> u64 {
        self.start.elapsed().as_nanos() as u64
    }

    /// Lets another thread run while waiting, where there is one processor for both.
    pub(crate) fn share(&mut self) {
        self.shared = std::thread::available_parallelism().is_ok_and(|n| n.get() == 1);
    }

    /// Gives the processor away if it is shared.
    pub(crate) fn yields(self) {
        if self.shared {
            std::thread::yield_now();
        } else {
            std::hint::spin_loop();
        }
    }

    /// Waits until `ns`, and not at all when that has passed.
    pub(crate) fn until(self, ns: u64) {
        let left = ns.saturating_sub(self.now_ns());
        if left > 2 * SPIN_NS {
            std::thread::sleep(Duration::from_nanos(left - SPIN_NS));
        }
        while self.now_ns() < ns {
            self.yields();
        }
    }
}
