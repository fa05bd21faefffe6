//! `exec`: the bit-bang cycle over another process, such as an HDL simulator. Time is counted in ticks: MA goes out as one
//! byte a tick, `0` or `1`, SLO comes back as one byte for each.
//!
//! ```text
//! tick          0         1         2         3
//! MA sent       |'1'      |'0'      |'0'      |'1'        holds for the tick
//! SLO answered          '1'|      '1'|      '0'|          as it stands when the tick ends
//! ```

mod child;

use super::Error;
use super::bitbang::{Bang, Pins};
use super::spec::Process;
use crate::limits::REST_NS;
use child::Child;
use std::time::Duration;

/// Levels go out in pieces of so many ticks at most: small enough that a signal is noticed between two.
const MOST: usize = 1 << 15;

/// MA and SLO of a child process. Dropping it leaves MA high, lets the child end, and ends it where it does not.
pub struct ExecPins {
    child: Child,
    tick_ns: u64,
    /// Ticks since the start, those included that still have to be sent.
    ticks: u64,
    ma: bool,
    /// Ticks that nobody has needed an answer to yet.
    out: Vec<u8>,
    sl: Option<bool>,
    /// What went wrong while nobody could be told.
    failed: Option<Error>,
}

/// No access waits so long between two edges: such a rest can be cut at once.
const LONG_NS: u64 = 20_000_000;

/// Starts the child. A wait is cut short once `stop` says that it is time to end.
///
/// # Errors
/// When there is no shell to run it, or no pipe to talk to it.
pub fn open(options: &Process, stop: impl Fn() -> bool + 'static) -> Result<Bang<ExecPins>, Error> {
    Ok(Bang::new(ExecPins {
        child: Child::start(options, Box::new(stop))?,
        tick_ns: options.tick.0.max(1),
        ticks: 0,
        ma: true,
        out: Vec::with_capacity(MOST),
        sl: None,
        failed: None,
    }))
}

impl ExecPins {
    /// Sends what has not been sent. The last answer is SLO now.
    fn exchange(&mut self) -> Result<(), Error> {
        if let Some(last) = self.child.exchange(&self.out)? {
            self.sl = Some(last == b'1');
        }
        self.out.clear();
        Ok(())
    }

    /// So many ticks of MA as it is.
    fn pass(&mut self, ticks: u64) -> Result<(), Error> {
        let level = if self.ma { b'1' } else { b'0' };
        let mut left = ticks;
        while left > 0 {
            if left.saturating_mul(self.tick_ns) > LONG_NS {
                self.child.stopped()?;
            }
            let piece = left.min((MOST - self.out.len()) as u64);
            self.out.resize(self.out.len() + piece as usize, level);
            left -= piece;
            if self.out.len() == MOST {
                self.exchange()?;
            }
        }
        Ok(())
    }

    fn sound(&mut self) -> Result<(), Error> {
        self.failed.take().map_or(Ok(()), Err)
    }
}

impl Pins for ExecPins {
    fn ma(&mut self, high: bool) -> Result<(), Error> {
        self.ma = high;
        self.sound()
    }

    fn sl(&mut self) -> Result<bool, Error> {
        self.sound()?;
        if self.sl.is_none() && self.out.is_empty() {
            self.until((self.ticks + 1) * self.tick_ns);
            self.sound()?;
        }
        self.exchange()?;
        Ok(self.sl.unwrap_or(true))
    }

    fn now_ns(&self) -> u64 {
        self.ticks.saturating_mul(self.tick_ns)
    }

    fn until(&mut self, ns: u64) {
        let then = ns.div_ceil(self.tick_ns);
        let ticks = then.saturating_sub(self.ticks);
        self.ticks += ticks;
        if self.failed.is_none() {
            self.failed = self.pass(ticks).err();
        }
    }

    fn cost_ns(&self) -> (u64, u64) {
        (0, 0)
    }

    fn grain_ns(&self) -> u64 {
        self.tick_ns
    }

    fn virtual_time(&self) -> bool {
        true
    }
}

impl Drop for ExecPins {
    fn drop(&mut self) {
        /// Nobody waits longer for a child that is not needed any more.
        const PATIENCE: Duration = Duration::from_secs(1);
        self.child.hurry(PATIENCE);
        // On the way out there is nobody left to tell.
        if self.ma(true).is_ok() && self.child.is_sound() {
            self.until(self.now_ns().saturating_add(REST_NS));
            let _ = self.exchange();
        }
        self.child.end(PATIENCE);
    }
}
