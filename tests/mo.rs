//! MO as the slaves behind it see it: a slave without data, before them on the bus.
#![allow(clippy::print_stdout, clippy::unwrap_used)]
mod common;
use biss::frame::BissC;
use biss::limits::TIMEOUT_MIN_NS;
use biss::link::bitbang::{Bang, Pins};
use biss::link::sim::SimPins;
use biss::link::{Error, Link, Phase};
use biss::master::{Master, Slot};
use biss::protocol::{Ability, Protocol};
use biss::trace::{Ask, Trace};
use biss::unit::Hertz;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Line {
    Ma,
    Mo,
}

/// That of the encoders on the bus.
const TIMEOUT_NS: u64 = 20_000;

/// An encoder on a bus whose SLI is MO: it is not ready before MO is. Every call takes time, and moves its line halfway.
struct Bus {
    pins: SimPins,
    call_ns: u64,
    with_mo: bool,
    mo: bool,
    /// When what moved, and to which level.
    moved: Vec<(u64, Line, bool)>,
}

impl Bus {
    fn new(config: &str, call_ns: u64, with_mo: bool) -> Bus {
        Bus {
            pins: SimPins::new(config.parse().unwrap()),
            call_ns,
            with_mo,
            mo: true,
            moved: Vec::new(),
        }
    }
    fn half_a_call(&mut self) {
        self.pins.until(self.pins.now_ns() + self.call_ns / 2);
    }
}

impl Pins for Bus {
    fn ma(&mut self, high: bool) -> Result<(), Error> {
        self.half_a_call();
        self.moved.push((self.pins.now_ns(), Line::Ma, high));
        self.pins.ma(high)?;
        self.half_a_call();
        Ok(())
    }
    fn sl(&mut self) -> Result<bool, Error> {
        self.half_a_call();
        let now = self.pins.now_ns();
        // What the encoder has after its stop bit is 0 until MO is 1.
        let last_edge = self
            .moved
            .iter()
            .rev()
            .find(|(_, line, _)| *line == Line::Ma);
        let timed_out = last_edge.is_none_or(|(at, ..)| now > at + TIMEOUT_NS);
        let level = self.pins.sl()? && (self.mo || !timed_out);
        self.half_a_call();
        Ok(level)
    }
    fn has_mo(&self) -> bool {
        self.with_mo
    }
    fn mo(&mut self, high: bool) -> Result<(), Error> {
        self.half_a_call();
        self.mo = high;
        self.moved.push((self.pins.now_ns(), Line::Mo, high));
        self.half_a_call();
        Ok(())
    }
    fn now_ns(&self) -> u64 {
        self.pins.now_ns()
    }
    fn until(&mut self, ns: u64) {
        self.pins.until(ns);
    }
    fn cost_ns(&self) -> (u64, u64) {
        (self.call_ns, self.call_ns)
    }
    fn virtual_time(&self) -> bool {
        true
    }
}

/// Judges one cycle by what moved in it, and returns MO as the next slave samples it: with each falling MA edge.
fn as_sampled(moved: &[(u64, Line, bool)], period_ns: u64) -> String {
    let mut sampled = String::new();
    let (mut mo, mut rises, mut edge) = (true, 0, (0, true));
    for &(at, line, level) in moved {
        match line {
            Line::Ma => {
                edge = (at, level);
                rises += u32::from(level);
                if !level {
                    sampled.push(if mo { '1' } else { '0' });
                }
            }
            Line::Mo => {
                assert_ne!(level, mo, "an MO edge that is none");
                mo = level;
                match (rises, level) {
                    // Within the first half of the high level (D2 Table 10: lag of SLO against MAO).
                    (2 | 4, false) | (3, true) => {
                        assert!(edge.1 && at - edge.0 <= period_ns / 4, "{}", at - edge.0);
                    }
                    (_, true) => assert!(at - edge.0 >= TIMEOUT_MIN_NS, "{}", at - edge.0),
                    _ => panic!("MO falls after edge {rises}"),
                }
            }
        }
    }
    assert!(mo, "MO does not return to 1");
    sampled
}

fn request(protocol: &BissC, period_ns: u32) -> Ask {
    let ability = Ability {
        reacts: true,
        period_ns,
        head: None,
        delay_clk: None,
        widen: 0,
    };
    Ask {
        at_ns: 0,
        clocks: protocol.request(&ability),
    }
}

#[test]
fn mo_is_a_slave_without_data() {
    let mut rng = common::rng();
    let phases = [
        Phase::Quarter,
        Phase::Half,
        Phase::ThreeQuarters,
        Phase::Whole,
    ];
    for _ in 0..common::size(500) {
        let config = format!(
            "timeout={}ns,ack={},seed={},frame=st8,crc6",
            rng.u32(12_500..40_000),
            rng.u32(1..9),
            rng.u32(..)
        );
        let call_ns = rng.u64(2..1_200);
        let mut link = Bang::new(Bus::new(&config, call_ns, true));
        let hz = link.set_clock(Hertz(rng.u32(80_000..10_000_000))).unwrap();
        let period_ns = u64::from(1_000_000_000 / hz.hz.0);
        link.set_phase(phases[rng.usize(..4)]).unwrap();
        link.idle(40_000).unwrap();
        let protocol = BissC::new("st8,crc6".parse().unwrap());
        let mut ask = request(&protocol, period_ns as u32);
        let mut trace = Trace::default();
        for _ in 0..4 {
            let cdm = rng.bool();
            ask.clocks.cdm = [cdm; 2];
            link.pins_mut().moved.clear();
            link.cycles(&[ask], std::slice::from_mut(&mut trace))
                .unwrap();
            let moved = std::mem::take(&mut link.pins_mut().moved);
            // One falling edge before each rising one, and one more for CDM = 1.
            let falls = trace.bits.len() + usize::from(cdm);
            let sampled = as_sampled(&moved, period_ns);
            assert_eq!(
                sampled,
                format!("1101{}", "0".repeat(falls - 4)),
                "{config}"
            );
            // A slave is ready only after MO, so CDM = 1 was held until then.
            let mo_rises = moved.iter().rposition(|(_, line, _)| *line == Line::Mo);
            let released = moved.iter().rposition(|m| (m.1, m.2) == (Line::Ma, true));
            assert_eq!(released > mo_rises, cdm, "{moved:?}");
        }
    }
}

#[test]
fn a_bus_is_read_like_one_encoder() {
    let format = "st12,nE,nW,crc6";
    let config = format!("motion=count,timeout=20us,frame={format}");
    for (call_ns, clock) in [(100, 1_000_000), (800, 250_000), (1_500, 60_000)] {
        let mut link = Bang::new(Bus::new(&config, call_ns, true));
        link.set_clock(Hertz(clock)).unwrap();
        let mut protocol = BissC::new(format.parse().unwrap());
        protocol.stall = biss::frame::Stall::Static {
            min_ns: TIMEOUT_NS as u32,
        };
        let mut master = Master::new(&mut link, &protocol, Some(0));
        assert!(master.open().unwrap());
        for n in 0..50 {
            assert!(matches!(master.slot(0, None).unwrap(), Slot::Done { .. }));
            let cycle = master.cycle();
            assert!(cycle.is_good(), "frame {n} at {clock} Hz: {cycle:?}");
        }
    }
}

/// The whole of it against slaves that hear MO: their start comes a clock later for MO too, and SL = 1 when the slowest of
/// timeout and MO has passed.
#[test]
fn slaves_on_a_bus_follow_mo() {
    let mut rng = common::rng();
    // Who is busy longer than MO takes starts when it would have without it.
    let mut starts = [0; 2];
    for _ in 0..common::size(150) {
        let format = common::format(&mut rng);
        let knobs = format!(
            "slaves=each,busy=0us..{}us,delay={}ns,timeout={}ns,seed={},rpm=600",
            rng.u32(..5),
            rng.u32(..3_000),
            rng.u32(3_000..40_000),
            rng.u32(..)
        );
        let config = |sli: &str| format!("{knobs},sli={sli},frame={format}").parse().unwrap();
        let hz = Hertz(rng.u32(250_000..10_000_000));
        let mut traces = ["low", "mo"].map(|sli| {
            let mut link = Bang::new(SimPins::new(config(sli)));
            assert_eq!(link.pins_mut().has_mo(), sli == "mo");
            let period_ns = 1_000_000_000 / link.set_clock(hz).unwrap().hz.0;
            let protocol = BissC::new(format.parse().unwrap());
            let mut ask = request(&protocol, period_ns);
            ask.clocks.cdm = [true; 2];
            let mut trace = Trace::default();
            link.idle(40_000).unwrap();
            link.cycles(&[ask], std::slice::from_mut(&mut trace))
                .unwrap();
            let level = link.idle(45_000).unwrap();
            assert_eq!(level, Some(true), "{knobs}");
            trace
        });
        let [low, mo] = &mut traces;
        let bits = |trace: &Trace| trace.bits.to_string();
        let start = |text: &str| {
            let ack = text.find('0').unwrap();
            ack + text[ack..].find('1').unwrap()
        };
        let (low_bits, mo_bits) = (bits(low), bits(mo));
        let later = start(&mo_bits) - start(&low_bits);
        assert!(later <= 1, "{knobs} {hz}\n{low_bits}\n{mo_bits}");
        starts[later] += 1;
        let words = low_bits.len() - start(&low_bits);
        assert_eq!(
            mo_bits[start(&mo_bits)..][..words],
            low_bits[start(&low_bits)..]
        );
        // CDM = 1 was held until they were ready, which is never before MO is.
        let ready = mo.ready_ns.unwrap();
        assert!(u64::from(ready) >= TIMEOUT_MIN_NS, "{knobs}: {ready}");
        // SL is looked at every half a microsecond.
        assert!(low.ready_ns.unwrap() <= ready + 500, "{knobs}: {ready}");
    }
    assert!(
        starts.iter().all(|count| *count > common::size(150) / 10),
        "{starts:?}"
    );
}

#[test]
fn init_and_cycles_that_do_not_start_leave_mo_high() {
    let mut link = Bang::new(Bus::new("stuck=0,frame=st8,crc6", 100, true));
    let protocol = BissC::new("st8,crc6".parse().unwrap());
    let mut trace = Trace::default();
    let init = Ask {
        at_ns: 0,
        clocks: protocol.init().unwrap(),
    };
    for ask in [init, request(&protocol, 4_000)] {
        link.cycles(&[ask], std::slice::from_mut(&mut trace))
            .unwrap();
        link.idle(40_000).unwrap();
    }
    let moved = &link.pins_mut().moved;
    assert_eq!(
        moved.iter().filter(|m| m.1 == Line::Ma).count(),
        4,
        "{moved:?}"
    );
    assert!(moved.iter().all(|m| m.1 == Line::Ma), "{moved:?}");
}

#[test]
fn without_mo_nothing_is_called() {
    let mut link = Bang::new(Bus::new("frame=st8,crc6", 100, false));
    let protocol = BissC::new("st8,crc6".parse().unwrap());
    let mut trace = Trace::default();
    link.cycles(
        &[request(&protocol, 4_000)],
        std::slice::from_mut(&mut trace),
    )
    .unwrap();
    let moved = &link.pins_mut().moved;
    assert!(
        moved.len() > 30 && moved.iter().all(|m| m.1 == Line::Ma),
        "{moved:?}"
    );
}
