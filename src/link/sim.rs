//! `sim`: the bit-bang cycle on a simulated slave and a virtual clock. No hardware, no randomness but the seed's.

use super::bitbang::{Bang, Pins};
use super::{Error, Kind, Spec};
use crate::parse::ParseError;
use crate::slave::{Config, Slave};
use std::str::FromStr;

/// A simulated slave as two pins. Calls take no time; waiting does.
#[derive(Debug)]
pub struct SimPins {
    slave: Slave,
    now_ns: u64,
}

impl SimPins {
    /// A slave that has just been switched on.
    pub fn new(config: Config) -> SimPins {
        SimPins {
            slave: Slave::new(config),
            now_ns: 0,
        }
    }

    /// The slave.
    pub fn slave(&self) -> &Slave {
        &self.slave
    }

    /// The slave, to take its CDM bits.
    pub fn slave_mut(&mut self) -> &mut Slave {
        &mut self.slave
    }
}

/// The `sim` link.
pub fn open(config: Config) -> Bang<SimPins> {
    Bang::new(SimPins::new(config))
}

/// `KEY=VAL,…,frame=FORMAT`: what stands behind `sim:`.
impl FromStr for Config {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Config, ParseError> {
        let spec: Spec = format!("sim:{text}").parse()?;
        let Kind::Sim { config, .. } = spec.kind else {
            unreachable!("the text begins with sim:")
        };
        let format = spec.frame.unwrap_or(config.format.clone());
        Ok(Config { format, ..*config })
    }
}

impl Pins for SimPins {
    fn ma(&mut self, high: bool) -> Result<(), Error> {
        self.slave.ma(self.now_ns, high);
        Ok(())
    }

    fn sl(&mut self) -> Result<bool, Error> {
        Ok(self.slave.slo(self.now_ns))
    }

    fn now_ns(&self) -> u64 {
        self.now_ns
    }

    fn until(&mut self, ns: u64) {
        self.now_ns = self.now_ns.max(ns);
    }

    fn cost_ns(&self) -> (u64, u64) {
        (0, 0)
    }

    fn virtual_time(&self) -> bool {
        true
    }
}
