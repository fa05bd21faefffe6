//! Pins of a busy machine.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used)]

use biss::link::Error;
use biss::link::bitbang::Pins;
use biss::link::sim::SimPins;
use fastrand::Rng;
use std::cell::RefCell;
use std::rc::Rc;

/// Pins whose calls take time, and now and then far too much of it.
pub struct Paused {
    pub pins: Rc<RefCell<SimPins>>,
    pub rng: Rng,
    pub call_ns: u64,
    /// Pauses to come, in calls from now.
    pub plan: Rc<RefCell<Vec<u32>>>,
    /// So many have come.
    pub paused: Rc<RefCell<u64>>,
}

impl Paused {
    fn pass(&mut self, ns: u64) {
        let mut pins = self.pins.borrow_mut();
        let now = pins.now_ns();
        pins.until(now + ns);
    }

    fn pause(&mut self) {
        // 200 ns to 100 µs, as many short as long ones.
        let ns = 10f64.powf(2.3 + 2.7 * self.rng.f64()) as u64;
        self.pass(ns);
        *self.paused.borrow_mut() += 1;
    }

    /// Runs `call` somewhere inside its time, with a pause before, inside (either side of it), or after.
    fn call<T>(&mut self, call: impl FnOnce(&mut SimPins) -> Result<T, Error>) -> Result<T, Error> {
        let due = {
            let mut plan = self.plan.borrow_mut();
            plan.iter_mut()
                .for_each(|left| *left = left.saturating_sub(1));
            let before = plan.len();
            plan.retain(|left| *left > 0);
            plan.len() < before
        };
        let place = if due { self.rng.u8(1..=4) } else { 0 };
        let early = self.rng.u64(0..=self.call_ns);
        let here = |paused: &mut Paused, at: u8| {
            if place == at {
                paused.pause();
            }
        };
        here(self, 1);
        self.pass(early);
        here(self, 2);
        let result = call(&mut self.pins.borrow_mut());
        here(self, 3);
        self.pass(self.call_ns - early);
        here(self, 4);
        result
    }
}

impl Pins for Paused {
    fn ma(&mut self, high: bool) -> Result<(), Error> {
        self.call(|pins| pins.ma(high))
    }
    fn sl(&mut self) -> Result<bool, Error> {
        self.call(|pins| pins.sl())
    }
    fn now_ns(&self) -> u64 {
        self.pins.borrow().now_ns()
    }
    fn until(&mut self, ns: u64) {
        self.pins.borrow_mut().until(ns);
    }
    fn cost_ns(&self) -> (u64, u64) {
        (self.call_ns, self.call_ns)
    }
    fn virtual_time(&self) -> bool {
        true
    }
}
