//! What the bit-bang cycle measures of itself, and when the master repeats and rests.
#![allow(clippy::print_stdout, clippy::unwrap_used)]
mod common;
use biss::frame::BissC;
use biss::link::bitbang::{Bang, Pins};
use biss::link::sim::SimPins;
use biss::link::{Error, Link, sim};
use biss::master::{Master, Slot};
use biss::protocol::{Ability, Protocol};
use biss::trace::{Ask, Trace};
use biss::unit::Hertz;
use fastrand::Rng;

/// Pins that note when MA really moved, somewhere inside the call, and pause when told to.
struct Timed {
    pins: SimPins,
    rng: Rng,
    call_ns: u64,
    edges: Vec<(u64, bool)>,
    /// A pause in so many calls of MA, and of SL from now.
    ma_pause: Option<(u32, u64)>,
    sl_pause: Option<(u32, u64)>,
}

impl Timed {
    fn new(config: &str, call_ns: u64) -> Timed {
        Timed {
            pins: SimPins::new(config.parse().unwrap()),
            rng: common::rng(),
            call_ns,
            edges: Vec::new(),
            ma_pause: None,
            sl_pause: None,
        }
    }
    fn pass(&mut self, ns: u64) {
        self.pins.until(self.pins.now_ns() + ns);
    }
    fn due(pause: &mut Option<(u32, u64)>) -> u64 {
        match pause {
            Some((0, ns)) => {
                let ns = *ns;
                *pause = None;
                ns
            }
            Some((calls, _)) => {
                *calls -= 1;
                0
            }
            None => 0,
        }
    }
}

impl Pins for Timed {
    fn ma(&mut self, high: bool) -> Result<(), Error> {
        let pause = Timed::due(&mut self.ma_pause);
        let (early, before) = (self.rng.u64(0..=self.call_ns), self.rng.bool());
        self.pass(early + if before { pause } else { 0 });
        self.edges.push((self.pins.now_ns(), high));
        self.pins.ma(high)?;
        self.pass(self.call_ns - early + if before { 0 } else { pause });
        Ok(())
    }
    fn sl(&mut self) -> Result<bool, Error> {
        let pause = Timed::due(&mut self.sl_pause);
        self.pass(self.call_ns);
        let level = self.pins.sl();
        self.pass(pause);
        level
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

fn ask(delay_clk: Option<u16>) -> Ask {
    let protocol = BissC::new("st8,crc6".parse().unwrap());
    let ability = Ability {
        reacts: true,
        period_ns: 4000,
        head: None,
        delay_clk,
        widen: 0,
    };
    Ask {
        at_ns: 0,
        clocks: protocol.request(&ability),
    }
}

/// Wherever MA pauses: no level and no period was longer than is said, the reference not shorter.
#[test]
fn what_is_measured_of_ma_bounds_what_it_did() {
    let mut rng = common::rng();
    let mut link = Bang::new(Timed::new("timeout=40us,frame=st8,crc6", 300));
    let mut trace = Trace::default();
    for _ in 0..common::size(2_000) {
        link.idle(100_000).unwrap();
        link.pins_mut().edges.clear();
        link.pins_mut().ma_pause = Some((rng.u32(..40), rng.u64(500..9_000)));
        link.cycles(&[ask(None)], std::slice::from_mut(&mut trace))
            .unwrap();
        let edges = &link.pins_mut().edges;
        let levels = edges.windows(2).map(|pair| pair[1].0 - pair[0].0);
        let rises: Vec<u64> = edges
            .iter()
            .filter(|(_, high)| *high)
            .map(|(t, _)| *t)
            .collect();
        let periods = rises.windows(2).map(|pair| pair[1] - pair[0]);
        let most = levels.chain(periods).max().unwrap();
        let longest = trace.longest.unwrap();
        assert!(
            u64::from(longest.ns) >= most,
            "{longest:?}, in truth {most}: {edges:?}"
        );
        assert!(
            u64::from(longest.ns) <= most + 9_000 + 4 * 300,
            "{longest:?}, in truth {most}"
        );
        let reference = u64::from(trace.reference_ns.unwrap());
        assert!(reference <= rises[1] - edges[0].0, "{reference} {edges:?}");
    }
}

/// With whole clocks of line delay: by how much a sample came late, and where.
#[test]
fn a_late_sample_is_measured_where_bits_are_under_way() {
    for (delay, clocks) in [("1us", 0), ("4.5us", 1), ("9us", 2), ("13us", 3)] {
        for late in [0, 400, 900] {
            for sample in 6..12 {
                let mut link = Bang::new(Timed::new(
                    &format!("timeout=40us,delay={delay},frame=st8,crc6"),
                    100,
                ));
                let mut trace = Trace::default();
                link.idle(100_000).unwrap();
                // The first call looks whether SL is ready; the first sample is that of edge 2.
                link.pins_mut().sl_pause = Some((1 + sample, late));
                link.cycles(&[ask(None)], std::slice::from_mut(&mut trace))
                    .unwrap();
                let found = trace.late.map(|level| (level.ns, level.edge));
                if clocks == 0 {
                    assert_eq!(found, None);
                } else if late > 0 {
                    // All bits that were under way then are as late; the last one is named.
                    assert_eq!(
                        found,
                        Some((late as u32, sample as u16 + 2 + clocks)),
                        "{delay} {late} {sample}"
                    );
                } else {
                    assert!(found.is_some_and(|(ns, _)| ns <= 100), "{found:?}");
                }
            }
        }
    }
}

#[test]
fn only_what_repeating_can_help_is_repeated() {
    let tries = |config: &str, hz: u32, retries: Option<u32>, stop: bool| {
        let mut link = sim::open(format!("{config},frame=st8,crc6").parse().unwrap());
        link.set_clock(Hertz(hz)).unwrap();
        let protocol = BissC::new("st8,crc6".parse().unwrap());
        let mut master = Master::new(&mut link, &protocol, retries);
        let stop = move || stop;
        master.stop_when(&stop);
        match master.slot(0, None).unwrap() {
            Slot::Done { tries } => tries,
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(
        tries("crc-error=100%", 1_000_000, None, false),
        1,
        "faults of the wire are shown"
    );
    assert_eq!(tries("crc-error=100%", 1_000_000, Some(5), false), 6);
    assert_eq!(
        tries("crc-error=100%", 1_000_000, Some(5), true),
        1,
        "nothing is repeated after a signal"
    );
    assert_eq!(
        tries("timeout=40us", 40_000, None, false),
        4,
        "stalls are repeated"
    );
    assert_eq!(tries("timeout=40us", 40_000, Some(0), false), 1);
    assert_eq!(
        tries("crc-error=0%", 1_000_000, None, false),
        2,
        "the first frame of all is read twice"
    );
    let wander = tries("busy=0us..35us,seed=4", 10_000_000, None, false);
    assert!((2..=8).contains(&wander), "{wander}");
}

/// Opening takes a dozen frames and more; a signal ends it after the one that runs.
#[test]
fn opening_ends_with_a_signal() {
    for frames in [0, 1, 3, 7] {
        let mut link = sim::open("frame=st8,crc6".parse().unwrap());
        let protocol = BissC::new("st8,crc6".parse().unwrap());
        let mut master = Master::new(&mut link, &protocol, None);
        let asked = std::cell::Cell::new(0);
        let stop = move || asked.replace(asked.get() + 1) >= frames;
        master.stop_when(&stop);
        master.open().unwrap();
        assert_eq!(link.pins_mut().slave().latches(), frames);
    }
}

const FRAME: &str = "st26,nE,nW,crc6";

#[test]
fn the_line_rests_after_whatever_was_not_good() {
    use biss::{
        frame::BissC,
        link::{Link, sim},
        master::Master,
        unit::Hertz,
    };
    let waited = |config: &str, retries: Option<u32>| {
        let mut link = sim::open(
            format!("{config},timeout=20us,frame=st8,crc6")
                .parse()
                .unwrap(),
        );
        link.set_clock(Hertz(1_000_000)).unwrap();
        let protocol = BissC::new("st8,crc6".parse().unwrap());
        let mut master = Master::new(&mut link, &protocol, retries);
        master.slot(0, None).unwrap();
        master.trace().waited_ns.unwrap()
    };
    assert!(
        waited("motion=still", None) >= 80_000,
        "a doubtful frame, read again"
    );
    assert!(
        waited("crc-error=100%", Some(2)) >= 80_000,
        "a bad word, read again"
    );
}

#[test]
fn the_phase_is_the_one_farthest_from_where_sl_changes() {
    use biss::{
        frame::BissC,
        link::{Link, sim},
        master::Master,
        unit::Hertz,
    };
    for (delay, place) in [
        ("0.5us", "just before the next rising MA edge"),
        ("3.4us", "a quarter of a clock after each rising MA edge"),
        ("4.5us", "with each falling MA edge"),
        (
            "5.4us",
            "three quarters of a clock after each rising MA edge",
        ),
        ("6.5us", "just before the next rising MA edge"),
        ("7.5us", "a quarter of a clock after each rising MA edge"),
    ] {
        let mut link = sim::open(
            format!("motion=count,delay={delay},frame={FRAME}")
                .parse()
                .unwrap(),
        );
        link.set_clock(Hertz(250_000)).unwrap();
        let protocol = BissC::new(FRAME.parse().unwrap());
        let mut master = Master::new(&mut link, &protocol, None);
        assert!(master.open().unwrap());
        assert_eq!(
            master.link().notes()[0],
            format!("SL is sampled {place}"),
            "{delay}"
        );
    }
}

/// Frames that only looked for the phase count on the slave's side too: that is no sign of a life that stopped.
#[test]
fn looking_for_the_phase_spoils_no_sign_of_life() {
    let format = "st8,nE,nW,lc6,crc16";
    let mut link = sim::open(
        format!("motion=count,delay=900ns,frame={format}")
            .parse()
            .unwrap(),
    );
    link.set_clock(Hertz(1_000_000)).unwrap();
    let protocol = BissC::new(format.parse().unwrap());
    let mut master = Master::new(&mut link, &protocol, Some(0));
    assert!(master.open().unwrap());
    let latches_of_opening = master.cycle().words()[0].good().map(|word| word & 0x3F);
    for _ in 0..20 {
        master.slot(0, None).unwrap();
        assert!(master.cycle().is_good(), "{:?}", master.cycle());
    }
    // Learning twice, and a few frames in each of four phases.
    assert!(
        latches_of_opening.is_some_and(|frames| frames <= 2 + 4 * 4 + 2),
        "{latches_of_opening:?}"
    );
}
