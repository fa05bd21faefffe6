//! Links to simulated slaves that a test can look into while a master runs over them.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used)]

use biss::frame::BissC;
use biss::link::Link;
use biss::link::bitbang::Bang;
use biss::link::sim::{self, Controller, SimBus, SimPins};
use biss::link::wave::{Options, Wave};
use biss::master::Master;
use biss::registers::Registers;
use biss::slave::{Config, Event, Slave};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

pub type Sim = Rc<RefCell<Bang<SimPins>>>;
pub type SimWave = Rc<RefCell<Wave<SimBus>>>;

pub fn sim(config: &str) -> Sim {
    Rc::new(RefCell::new(sim::open(parsed(config))))
}

pub fn sim_wave(config: &str) -> SimWave {
    sim_wave_on(config, Controller::default(), Options::default())
}

pub fn sim_wave_on(config: &str, controller: Controller, options: Options) -> SimWave {
    let bus = SimBus::new(parsed(config), controller);
    Rc::new(RefCell::new(Wave::new(bus, options, None).unwrap()))
}

fn parsed(config: &str) -> Config {
    config.parse().unwrap_or_else(|e| panic!("{config}: {e}"))
}

pub trait HasSlave {
    fn slave<T>(&self, look: impl FnOnce(&mut Slave) -> T) -> T;
}

impl HasSlave for Sim {
    fn slave<T>(&self, look: impl FnOnce(&mut Slave) -> T) -> T {
        look(self.borrow_mut().pins_mut().slave_mut())
    }
}

impl HasSlave for SimWave {
    fn slave<T>(&self, look: impl FnOnce(&mut Slave) -> T) -> T {
        look(self.borrow_mut().bus_mut().pins_mut().slave_mut())
    }
}

/// Does something with the registers of a link, by heads of frames.
pub fn with<L: Link, T>(link: &mut L, work: impl FnOnce(&mut Registers<'_, '_>) -> T) -> T {
    let protocol = BissC::head_only();
    let mut master = Master::new(link, &protocol, None);
    assert!(master.open().unwrap(), "an encoder answers");
    work(&mut Registers::new(&mut master))
}

/// All that the slaves hold in the banks looked at.
pub fn map(slave: &Slave, banks: &[u8]) -> BTreeMap<(usize, u8, u8), u8> {
    let mut map = BTreeMap::new();
    for id in 0..slave.devices() {
        for address in 0x40..0x80 {
            if let Some(value) = slave.peek(id, 0, address) {
                map.insert((id, 0, address), value);
            }
        }
        for bank in banks {
            for address in 0x00..0x40 {
                if let Some(value) = slave.peek(id, *bank, address) {
                    map.insert((id, *bank, address), value);
                }
            }
        }
    }
    map
}

/// How often a command was executed.
pub fn commands(events: &[Event]) -> usize {
    let command = |event: &&Event| matches!(event, Event::Command { .. });
    events.iter().filter(command).count()
}
