//! `wave` against the simulated slave behind a simulated SPI controller: MA as a pattern on MOSI, MISO over-sampled.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;

use biss::cycle::Fault;
use biss::frame::{BissC, Stall};
use biss::link::bus::Bus;
use biss::link::sim::{Controller, SimBus};
use biss::link::wave::{Options, Wave};
use biss::link::{Error, Link};
use biss::master::{Master, Slot};
use biss::protocol::{Ability, Protocol};
use biss::trace::{Ask, Clocks, Trace, Until};
use biss::unit::Hertz;
use fastrand::Rng;
use std::cell::{Cell, RefCell};
use std::rc::Rc;

const FRAME: &str = "st26,nE,nW,crc6";

/// The SCLK that comes of the one asked for.
type Divide = fn(Hertz) -> Hertz;

/// Controllers as they divide: any clock, an even part of a core clock (bcm2835), a power of two of it, all with an end.
const DIVIDERS: [(&str, Divide); 5] = [
    ("any", |hz| hz),
    ("250 MHz, even", |hz| even(250_000_000, hz)),
    ("400 MHz, even", |hz| even(400_000_000, hz)),
    ("256 MHz, power of two", |hz| power(256_000_000, hz)),
    ("50 MHz at most", |hz| hz.min(Hertz(50_000_000))),
];

fn even(core: u32, hz: Hertz) -> Hertz {
    Hertz(core / (core.div_ceil(hz.0).div_ceil(2) * 2).max(2))
}

fn power(core: u32, hz: Hertz) -> Hertz {
    Hertz(core / core.div_ceil(hz.0).next_power_of_two())
}

fn open(config: &str, controller: Controller, options: Options, hz: u32) -> Wave<SimBus> {
    let config = config.parse().unwrap_or_else(|e| panic!("{e}"));
    Wave::new(SimBus::new(config, controller), options, Some(Hertz(hz))).unwrap()
}

/// Reads so many frames of a slave that counts them; every one must be the next. Returns the longest departure of the
/// measured from the true line delay, in ns.
fn read_all(link: &mut Wave<SimBus>, frames: u32, delay_ns: u64) -> Result<u64, String> {
    let mut protocol = BissC::new(FRAME.parse().unwrap());
    // 80 kHz has clocks longer than what is allowed where the timeout is not known.
    protocol.stall = Stall::Static { min_ns: 14_000 };
    let mut master = Master::new(link, &protocol, Some(0));
    if !master.open().unwrap() {
        return Err(format!("nothing learned: {:?}", master.cycle().fault()));
    }
    let (mut last, mut off) = (None, 0);
    for frame in 0..frames {
        let slot = master.slot(0, None).unwrap();
        let word = master.cycle().words().first().copied();
        let Some(data) = word.and_then(|word| word.good()) else {
            let fault = master
                .cycle()
                .fault()
                .or(word.and_then(|word| word.fault()));
            return Err(format!("frame {frame} is lost: {fault:?}"));
        };
        if slot != (Slot::Done { tries: 1 }) {
            return Err(format!("frame {frame}: {slot:?}"));
        }
        let position = data >> 2;
        if last.is_some_and(|last: u64| position != last + 1) {
            return Err(format!("{position} after {last:?}"));
        }
        last = Some(position);
        let measured = u64::from(master.trace().delay_ns.ok_or("no delay")?);
        off = off.max(measured.abs_diff(delay_ns));
    }
    Ok(off)
}

/// The specification's jitter of a quarter of a clock each way relative to Ack, any line delay, any phase of SL's edges
/// to the samples: no frame is lost.
#[test]
fn no_frame_is_lost_from_four_samples_a_clock() {
    let mut rng = common::rng();
    let rounds = common::size(1_500);
    let mut broken = 0;
    let mut least = f64::MAX;
    for round in 0..rounds {
        let samples = *rng.choice(&[4, 4, 5, 6, 7, 8, 11, 16, 32]).unwrap();
        let hz = *rng
            .choice(&[
                80_000, 100_000, 250_000, 333_333, 1_000_000, 1_500_000, 2_000_000, 4_700_000,
                10_000_000,
            ])
            .unwrap();
        let (name, divide) = *rng.choice(&DIVIDERS).unwrap();
        // Told how many samples to take, a coarse controller may make half of the clock that was asked for.
        let oversample = (hz >= 250_000 && hz * u32::from(samples) <= 125_000_000 && rng.bool())
            .then_some(samples);
        let period = 1_000_000_000 / u64::from(hz);
        let delay = match rng.u8(..4) {
            0 => 0,
            1 => rng.u64(..period),
            2 => rng.u64(..5 * period).min(39_000),
            _ => rng.u64(..39_000),
        };
        // Ack and a bit each move, so that they part by twice as much. A clock of a fast controller may be a little
        // shorter than what was asked for.
        let jitter = (period - period / 20) / 8 * rng.u64(0..=1);
        let delay = delay.max(jitter);
        let timeout = match rng.u8(..3) {
            0 if period * 3 / 2 < 20_000 => "adaptive".into(),
            _ => format!("{}ns", rng.u64(14_000..=40_000)),
        };
        // In clocks: a busy time would make the start bit wander by one where it ends about an edge.
        let ack = rng.u64(1..=(18_000 / period).clamp(1, 60));
        let config = format!(
            "motion=count,timeout={timeout},delay={delay}ns,jitter={jitter}ns,ack={ack},seed={round},frame={FRAME}"
        );
        let options = Options {
            oversample,
            ..Options::default()
        };
        let controller = Controller {
            divide,
            call_ns: rng.u64(..40_000),
            ..Controller::default()
        };
        let mut link = open(&config, controller, options, hz);
        let grid = link.grid();
        broken += u32::from(!grid.is_whole());
        least = least.min(grid.samples_per_clock());
        let about = format!("{name}, {samples:?} samples at {hz} Hz, {grid:?}, {config}");
        if options.oversample.is_some() {
            assert!(grid.is_whole(), "{about}");
        }
        let off = read_all(&mut link, 12, delay).unwrap_or_else(|e| panic!("{e}\n{about}"));
        let sample = grid.ns(1) + 1;
        assert!(off <= sample + jitter, "delay off by {off} ns: {about}");
        let slave = link.bus_mut().pins().slave();
        assert_eq!(
            slave.timeouts(),
            slave.latches(),
            "a frame, a timeout: {about}"
        );
    }
    println!("{broken} on broken grids, down to {least} samples a clock");
    assert!(broken > 0 && least == 4.0, "the grid of cases is too small");
}

/// MA in samples, as the controller sends it: levels and their lengths.
fn levels(bytes: &[u8]) -> Vec<(bool, usize)> {
    let mut runs: Vec<(bool, usize)> = Vec::new();
    for at in 0..8 * bytes.len() {
        let level = bytes[at / 8] & 0x80 >> (at % 8) != 0;
        match runs.last_mut() {
            Some((last, length)) if *last == level => *length += 1,
            _ => runs.push((level, 1)),
        }
    }
    runs
}

/// The bytes that were sent, by what they must hold: rest, clocks, timeout and CDM inside, MA high at both ends.
#[test]
fn the_pattern_is_a_whole_cycle() {
    let mut rng = common::rng();
    for _ in 0..common::size(300) {
        let timeout = rng.u64(12_500..=40_000);
        let delay = rng.u64(..39_000);
        let config = format!("motion=count,timeout={timeout}ns,delay={delay}ns,frame={FRAME}");
        let hz = rng.u32(80_000..=10_000_000);
        let (_, divide) = *rng.choice(&DIVIDERS).unwrap();
        let controller = Controller {
            divide,
            ..Controller::default()
        };
        let mut link = open(&config, controller, Options::default(), hz);
        let protocol = BissC::new(FRAME.parse().unwrap());
        let ability = Ability {
            reacts: false,
            period_ns: link.clock().hz.period_ns() as u32,
            head: None,
            delay_clk: None,
            widen: 0,
        };
        let mut trace = Trace::default();
        for frame in 0..6u64 {
            let cdm = rng.bool();
            let clocks = Clocks {
                cdm: [cdm; 2],
                ..protocol.request(&ability)
            };
            let Until::Clocks(edges) = clocks.until else {
                panic!()
            };
            let asks = [Ask { at_ns: 0, clocks }];
            link.cycles(&asks, std::slice::from_mut(&mut trace))
                .unwrap();
            let about = format!("{hz} Hz, {:?}, {config}, CDM {cdm}", link.grid());

            let grid = link.grid();
            let (pattern, _) = link.last();
            // A bcm2835 pauses between the bytes of shorter ones.
            assert!(pattern.bytes().len() >= 96, "{about}");
            let runs = levels(pattern.bytes());
            let per_clock = grid.samples_per_clock();
            assert!(runs[0].0 && runs[0].1 as f64 >= per_clock, "{about}");
            let (last, tail) = *runs.last().unwrap();
            assert!(last && tail as f64 >= per_clock, "{about}");
            let pulses = usize::from(edges) + usize::from(cdm);
            assert_eq!(runs.len(), 2 * pulses + 1, "{about}");
            for (_, length) in &runs[1..2 * usize::from(edges)] {
                let off = (*length as f64 - per_clock / 2.0).abs();
                assert!(off < 1.0, "{about}: {length}");
                assert!(grid.ns(*length) < 12_000, "{about}");
            }

            // The slave saw one frame, one timeout, and the CDM that was meant.
            let slave = link.bus_mut().pins_mut().slave_mut();
            assert_eq!(slave.take_cdm(), Some(cdm), "{about}");
            assert_eq!(
                (slave.latches(), slave.timeouts()),
                (frame + 1, frame + 1),
                "{about}"
            );
            assert_eq!((trace.cdm, trace.surplus), (Some(cdm), 2));
            let ready = u64::from(
                trace
                    .ready_ns
                    .unwrap_or_else(|| panic!("not ready: {about}")),
            );
            assert!(
                ready.abs_diff(timeout + delay) <= grid.ns(2),
                "{ready}: {about}"
            );
        }
    }
}

/// Where MOSI rests, and which way round the pair is.
#[test]
fn mosi_may_rest_low_and_the_pair_be_swapped() {
    // Where MOSI rests, whether the pair is swapped; idle= and invert as they must be given.
    let cases = [
        (None, false, None, false),
        (Some(true), false, None, false),
        (Some(false), false, Some(false), false),
        (Some(false), true, None, true),
        (None, true, None, true),
        (Some(true), true, Some(true), true),
    ];
    for (mosi_rests, swapped, idle, invert) in cases {
        for delay in [0u64, 300, 5_200, 20_000] {
            let controller = Controller {
                mosi_rests,
                swapped,
                call_ns: 20_000,
                ..Controller::default()
            };
            let options = Options {
                idle,
                invert,
                ..Options::default()
            };
            let config = format!("motion=count,timeout=20us,delay={delay}ns,frame={FRAME}");
            let mut link = open(&config, controller, options, 1_000_000);
            let off = read_all(&mut link, 20, delay)
                .unwrap_or_else(|e| panic!("{e}: {controller:?} {options:?} {delay}"));
            assert!(off <= 125, "{controller:?} {options:?} {delay}: {off}");
        }
    }
}

/// What the wire says wrong has its own name, and no position.
#[test]
fn faults_have_their_names() {
    for (config, name) in [
        ("stuck=1", "no-ack"),
        ("stuck=0", "not-ready"),
        ("no-ack=1", "no-ack"),
        ("no-start=1", "no-start"),
        ("crc-error=1", "crc"),
        ("null=1", "null"),
        ("delay=45us", "no-ack"),
        ("busy=60us", "no-start"),
    ] {
        let config = format!("{config},frame={FRAME}");
        let mut link = open(
            &config,
            Controller::default(),
            Options::default(),
            1_000_000,
        );
        let protocol = BissC::new(FRAME.parse().unwrap());
        let mut master = Master::new(&mut link, &protocol, Some(0));
        // The place of the start bit can be learned from null values.
        assert_eq!(master.open().unwrap(), name == "null", "{config}");
        for _ in 0..5 {
            master.slot(0, None).unwrap();
            let word = master.cycle().words().first().and_then(|word| word.fault());
            let fault = master.cycle().fault().or(word);
            assert_eq!(
                fault.map(|fault| fault.name()),
                Some(name),
                "{config}: {fault:?}"
            );
        }
    }
}

/// A slow SCLK makes levels that some slaves take for the end of the frame: that is a stall, as on any link.
#[test]
fn a_clock_slower_than_the_timeout_is_a_stall() {
    let mut link = open(
        &format!("frame={FRAME}"),
        Controller::default(),
        Options::default(),
        50_000,
    );
    let protocol = BissC::new(FRAME.parse().unwrap());
    let mut master = Master::new(&mut link, &protocol, Some(0));
    master.open().unwrap();
    master.slot(0, None).unwrap();
    assert!(matches!(
        master.cycle().fault(),
        Some(Fault::Stalled { .. })
    ));
}

/// A controller that pauses between bytes stretches bits and delay alike.
#[test]
fn gaps_between_bytes_are_borne() {
    for samples in [4, 8, 16] {
        let controller = Controller {
            gap_bits: 1,
            ..Controller::default()
        };
        let options = Options {
            oversample: Some(samples),
            ..Options::default()
        };
        let config = format!("motion=count,delay=700ns,timeout=20us,frame={FRAME}");
        let mut link = open(&config, controller, options, 1_000_000);
        read_all(&mut link, 20, 700).unwrap();
    }
}

/// The clock that is reached is said, and MA is a whole part of SCLK wherever the controller has one near by.
#[test]
fn the_grid_follows_the_controller() {
    let reached = |divide: Divide, hz: u32, oversample: Option<u8>| {
        let controller = Controller {
            divide,
            call_ns: 30_000,
            ..Controller::default()
        };
        let options = Options {
            oversample,
            ..Options::default()
        };
        let link = open(&format!("frame={FRAME}"), controller, options, hz);
        (
            link.clock().hz.0,
            link.grid().samples_per_clock(),
            link.notes().join("\n"),
        )
    };
    let near = |is: u32, should: u32| is.abs_diff(should) <= should / 200;
    let [any, even_250, _, power_256, most_50] = DIVIDERS.map(|(_, divide)| divide);
    let (hz, samples, notes) = reached(any, 1_000_000, None);
    assert!(near(hz, 1_000_000) && samples == 8.0, "{hz} {samples}");
    assert!(
        notes.contains("8 samples a clock") && notes.contains("(measured)"),
        "{notes}"
    );
    let (hz, samples, _) = reached(even_250, 1_000_000, None);
    assert!(near(hz, 976_562) && samples == 8.0, "{hz} {samples}");
    let (hz, samples, notes) = reached(power_256, 1_900_000, None);
    assert!(near(hz, 1_900_000) && samples > 8.0, "{hz} {samples}");
    assert!(
        notes.contains("(measured)") && notes.contains("up to 62 ns before their place"),
        "{notes}"
    );
    let (hz, samples, _) = reached(power_256, 1_500_000, Some(8));
    assert!(near(hz, 1_000_000) && samples == 8.0, "{hz} {samples}");
    let (hz, samples, _) = reached(most_50, 10_000_000, None);
    assert!(near(hz, 10_000_000) && samples == 5.0, "{hz} {samples}");
    let (hz, samples, _) = reached(|hz| hz.min(Hertz(20_000_000)), 10_000_000, None);
    assert!(near(hz, 5_000_000) && samples == 4.0, "{hz} {samples}");
    // 40 / 9 samples a clock are too few for clocks of different lengths.
    let (hz, samples, _) = reached(|hz| hz.min(Hertz(40_000_000)), 9_000_000, None);
    assert!(near(hz, 8_000_000) && samples == 5.0, "{hz} {samples}");
}

#[test]
fn what_cannot_be_sent_is_an_error() {
    let bus = SimBus::new("sim".parse().unwrap_or_default(), Controller::default());
    let error = Wave::new(bus, Options::default(), Some(Hertz(4_000_000_000))).unwrap_err();
    assert!(error.to_string().contains("-c"), "{error}");

    let mut link = open(
        &format!("frame={FRAME}"),
        Controller::default(),
        Options::default(),
        10_000_000,
    );
    let mut run = |clocks: Clocks| -> Error {
        let asks = [Ask { at_ns: 0, clocks }];
        link.cycles(&asks, &mut [Trace::default()]).unwrap_err()
    };
    let clocks = Clocks {
        until: Until::Clocks(40),
        surplus: 2,
        stretch_ns: 0,
        cdm: [false; 2],
        hold_ns: 80_000,
        ready_ns: Some(80_000),
        partial: false,
    };
    let error = run(Clocks {
        ready_ns: Some(500_000),
        partial: false,
        ..clocks
    })
    .to_string();
    assert!(error.contains("bufsiz"), "{error}");
    let error = run(Clocks {
        cdm: [false, true],
        ..clocks
    })
    .to_string();
    assert!(error.contains("CDS"), "{error}");
    let frame = Until::Frame {
        ack: 8,
        start: 8,
        then: 36,
    };
    let error = run(Clocks {
        until: frame,
        ..clocks
    })
    .to_string();
    assert!(error.contains("before SL is seen"), "{error}");
}

/// A random pause of SCLK in one frame after the other, long enough for the slave to start anew: nobody sees it but the
/// checks of the frame itself, and what the master has learned of the line.
#[test]
fn restarts_in_unseen_pauses() {
    /// Frames of one encoder.
    const ROW: usize = 100;
    let mut rng: Rng = common::rng();
    let rounds = common::size(20_000) / ROW;
    let protocol = BissC::new(FRAME.parse().unwrap());
    let (mut wrong, mut good) = (0, 0);
    for _ in 0..rounds {
        let (pos, delay, ack) = (rng.u64(..1 << 26), rng.u64(..3_000), rng.u8(1..6));
        let config =
            format!("motion=count,pos={pos},timeout=15us,delay={delay}ns,ack={ack},frame={FRAME}");
        let link = open(
            &config,
            Controller::default(),
            Options::default(),
            1_000_000,
        );
        let link = Rc::new(RefCell::new(link));
        let mut shared = Rc::clone(&link);
        let mut master = Master::new(&mut shared, &protocol, None);
        assert!(master.open().unwrap(), "{config}");
        for _ in 0..ROW {
            let latches = || link.borrow_mut().bus_mut().pins().slave().latches();
            let before = latches();
            let (byte, ns) = (rng.usize(1..60), rng.u64(16_000..60_000));
            link.borrow_mut().bus_mut().pause(byte, ns);
            master.slot(0, None).unwrap();
            let word = master.cycle().words().first().and_then(|w| w.good());
            if let Some(word) = word {
                let latched = (before..latches()).map(|n| (pos + n) % (1 << 26));
                let sent = word & 3 == 3 && latched.into_iter().any(|pos| pos == word >> 2);
                wrong += usize::from(!sent);
                good += usize::from(sent);
            }
        }
    }
    let frames = rounds * ROW;
    println!("{wrong} wrong positions and {good} good ones in {frames} frames with a pause");
    assert!(good < frames * 3 / 4, "the pauses cut nothing");
    assert!(wrong * 500 <= frames, "more than 0.2 %");
}

/// How many of some frames are good; all of those the slave must have latched.
fn good_of(link: Wave<SimBus>, timeout_max_ns: u32, about: &str) -> u32 {
    let link = Rc::new(RefCell::new(link));
    let mut protocol = BissC::new(FRAME.parse().unwrap());
    protocol.timeout_max_ns = timeout_max_ns;
    let mut shared = Rc::clone(&link);
    let mut master = Master::new(&mut shared, &protocol, Some(0));
    master.open().unwrap();
    let mut good = 0;
    for _ in 0..FEW {
        master.slot(0, None).unwrap();
        let word = master.cycle().words().first().copied();
        if let Some(data) = word.and_then(|word| word.good()) {
            let mut link = link.borrow_mut();
            let latched = link.bus_mut().pins().slave().latched();
            assert_eq!(latched, [data], "{about}");
            good += 1;
        }
    }
    good
}

const FEW: u32 = 6;

/// MOSI falls after each transfer and nobody has said so: each begins with an edge that the slave counts. Frames may be
/// lost by that, but none may be wrong.
#[test]
fn a_mosi_that_rests_low_unsaid_makes_nothing_wrong() {
    let mut rng = common::rng();
    let (mut good, mut frames) = (0, 0);
    for seed in 0..common::size(400) {
        let hz = rng.u32(80_000..=10_000_000);
        let delay = match rng.bool() {
            true => rng.u64(..39_000),
            false => rng.u64(..2_000_000_000 / u64::from(hz)),
        };
        let timeout = match rng.u8(..4) {
            0 => "adaptive".into(),
            _ => format!("{}ns", rng.u64(12_500..=40_000)),
        };
        let config = format!(
            "motion=count,timeout={timeout},delay={delay}ns,jitter={}ns,seed={seed},ack={},frame={FRAME}",
            delay.min(rng.u64(..1_000_000_000 / u64::from(hz) / 8)),
            rng.u8(1..6),
        );
        let controller = Controller {
            mosi_rests: Some(false),
            call_ns: rng.u64(..60_000),
            ..Controller::default()
        };
        let link = open(&config, controller, Options::default(), hz);
        let about = format!("{hz} Hz, {controller:?}, {config}");
        good += good_of(link, 40_000, &about);
        frames += FEW;
    }
    println!("{good} of {frames} frames were good");
    assert!(good > 0 && good < frames);
}

/// Where MOSI rests low, MA is high for as long as the slave's timeout may be before the first edge.
#[test]
fn a_long_timeout_is_waited_for_where_mosi_rests_low() {
    for delay in [0, 300, 20_000] {
        let config = format!("motion=count,timeout=90us,delay={delay}ns,frame={FRAME}");
        let controller = Controller {
            mosi_rests: Some(false),
            ..Controller::default()
        };
        let options = Options {
            idle: Some(false),
            ..Options::default()
        };
        let link = open(&config, controller, options, 1_000_000);
        assert_eq!(good_of(link, 100_000, &config), FEW, "{config}");
    }
}

/// A slave that keeps SL low after power-up gets its INIT, which ends with MA high: CDM = 0 (D2, p. 12).
#[test]
fn a_slave_is_initialised() {
    for mosi_rests in [None, Some(false)] {
        let config = format!("power-up=low,timeout=40us,delay=3us,frame={FRAME}");
        let controller = Controller {
            mosi_rests,
            ..Controller::default()
        };
        let options = Options {
            idle: mosi_rests,
            ..Options::default()
        };
        let mut bus = Watched::new(&config, controller);
        bus.late_ns = [50_000; 2];
        let control = Rc::clone(&bus.control);
        let mut link = Wave::new(bus, options, None).unwrap();
        let protocol = BissC::new(FRAME.parse().unwrap());
        let mut master = Master::new(&mut link, &protocol, Some(0));
        assert!(master.open().unwrap());
        master.slot(0, None).unwrap();
        assert!(master.cycle().is_good());
        drop(link);
        assert_eq!(control.get(), 0, "{mosi_rests:?}");
    }
}

/// A frame begins with its first falling edge, and not before it was asked for.
#[test]
fn a_frame_begins_when_it_was_asked_for() {
    let controller = Controller::default();
    let config = format!("frame={FRAME}");
    let mut link = open(&config, controller, Options::default(), 1_000_000);
    let protocol = BissC::new(FRAME.parse().unwrap());
    let mut master = Master::new(&mut link, &protocol, Some(0));
    assert!(master.open().unwrap());
    let at_ns = master.link().now_ns() + 1_000_000;
    master.slot(at_ns, None).unwrap();
    assert!(master.trace().t_ns.abs_diff(at_ns) <= 1, "{at_ns}");
}

/// SL = 1 is looked for at the end of each transfer, however late it comes back, so that the next frame need not wait.
#[test]
fn ready_is_seen_behind_the_longest_line() {
    let config = format!("timeout=40us,delay=39us,frame={FRAME}");
    let mut link = open(
        &config,
        Controller::default(),
        Options::default(),
        1_000_000,
    );
    let protocol = BissC::new(FRAME.parse().unwrap());
    let mut master = Master::new(&mut link, &protocol, Some(0));
    assert!(master.open().unwrap());
    master.slot(0, None).unwrap();
    assert!(master.cycle().is_good());
    assert_eq!(master.trace().ready_ns, Some(79_000));
}

/// Where it was not seen, the next frame waits.
#[test]
fn a_frame_waits_where_ready_was_not_seen() {
    let clocks = Clocks {
        until: Until::Clocks(41),
        surplus: 2,
        stretch_ns: 0,
        cdm: [false; 2],
        hold_ns: 80_000,
        // The slave's timeout is longer; twice of it is enough.
        ready_ns: Some(25_000),
        partial: false,
    };
    let asks = [Ask { at_ns: 0, clocks }];
    for look in [false, true] {
        let config = format!("timeout=40us,frame={FRAME}");
        let mut link = open(
            &config,
            Controller::default(),
            Options::default(),
            4_000_000,
        );
        for frame in 1..4 {
            let mut trace = Trace::default();
            link.cycles(&asks, std::slice::from_mut(&mut trace))
                .unwrap();
            assert_eq!(trace.ready_ns, None);
            assert_eq!(link.bus_mut().pins().slave().latches(), frame, "{look}");
            if look {
                assert_eq!(link.idle(1_000).unwrap(), Some(false));
            }
        }
    }
}

/// A controller that refuses to run faster than so, and is watched.
#[derive(Debug)]
struct Watched {
    bus: SimBus,
    most: Hertz,
    /// How often the slave has read CDM = 1.
    control: Rc<Cell<u32>>,
    /// How long the machine takes before each transfer, in turn.
    late_ns: [u64; 2],
    /// One sample of each transfer is upside down.
    spikes: Option<Rng>,
    /// Eight samples of each transfer are low.
    bursts: Option<Rng>,
    /// Where MOSI was asked to rest.
    rests: Option<bool>,
    /// What MOSI shows, once it has been moved.
    mosi: Rc<Cell<Option<bool>>>,
}

impl Bus for Watched {
    fn shift(&mut self, hz: Hertz, out: &[u8], back: &mut [u8]) -> Result<u64, Error> {
        if hz > self.most {
            return Err(Error::new("a transfer", "EINVAL", "ask for less"));
        }
        self.late_ns.swap(0, 1);
        let now = self.bus.now_ns() + self.late_ns[0];
        self.bus.until(now);
        let slave = self.bus.pins_mut().slave_mut();
        slave.slo(now);
        let control = slave.take_cdm() == Some(true);
        self.control.set(self.control.get() + u32::from(control));
        self.mosi.set(out.last().map(|byte| byte & 1 == 1));
        let began = self.bus.shift(hz, out, back)?;
        if let Some(rng) = &mut self.spikes {
            back[rng.usize(..out.len())] ^= 0x80 >> rng.u8(..8);
        }
        if let Some(rng) = &mut self.bursts {
            back[rng.usize(..out.len())] = 0;
        }
        Ok(began)
    }
    fn now_ns(&self) -> u64 {
        self.bus.now_ns()
    }
    fn until(&mut self, ns: u64) {
        self.bus.until(ns);
    }
    fn max_bytes(&self) -> usize {
        self.bus.max_bytes()
    }
    fn rest_mosi_at(&mut self, high: bool) -> bool {
        self.rests = Some(high);
        true
    }
    fn name(&self) -> String {
        self.bus.name()
    }
}

impl Watched {
    fn new(config: &str, controller: Controller) -> Watched {
        Watched {
            bus: SimBus::new(config.parse().unwrap(), controller),
            most: Hertz(u32::MAX),
            mosi: Rc::default(),
            control: Rc::default(),
            late_ns: [0; 2],
            spikes: None,
            bursts: None,
            rests: None,
        }
    }
}

/// A clock that is refused changes nothing, and MA is still left high.
#[test]
fn a_refused_clock_leaves_the_link_as_it_was() {
    let mut bus = Watched::new(&format!("frame={FRAME}"), Controller::default());
    bus.most = Hertz(20_000_000);
    let mut link = Wave::new(bus, Options::default(), Some(Hertz(2_000_000))).unwrap();
    link.set_clock(Hertz(5_000_000)).unwrap_err();
    assert_eq!(link.clock().hz, Hertz(2_000_000));
    let protocol = BissC::new(FRAME.parse().unwrap());
    let mut master = Master::new(&mut link, &protocol, Some(0));
    assert!(master.open().unwrap());
    master.slot(0, None).unwrap();
    assert!(master.cycle().is_good());
}

/// Opened at a clock that the controller refuses, MA is driven high all the same.
#[test]
fn a_link_that_does_not_open_leaves_ma_high() {
    for invert in [false, true] {
        let mut bus = Watched::new(&format!("frame={FRAME}"), Controller::default());
        bus.most = Hertz(20_000_000);
        let mosi = Rc::clone(&bus.mosi);
        let options = Options {
            invert,
            ..Options::default()
        };
        Wave::new(bus, options, Some(Hertz(5_000_000))).unwrap_err();
        assert_eq!(mosi.get(), Some(!invert));
    }
}

/// One sample in each transfer is upside down: it may be the Ack, a bit, or the look at SL = 1.
#[test]
fn a_spike_on_sl_makes_nothing_wrong() {
    let mut rng = common::rng();
    let (mut good, mut frames) = (0, 0);
    for seed in 0..common::size(40) {
        let hz = rng.u32(250_000..=10_000_000);
        let config = format!(
            "motion=count,timeout=20us,delay={}ns,seed={seed},ack={},frame={FRAME}",
            rng.u64(..8_000_000_000 / u64::from(hz)),
            rng.u8(1..6),
        );
        let mut bus = Watched::new(&config, Controller::default());
        bus.spikes = Some(rng.fork());
        let link = Wave::new(bus, Options::default(), Some(Hertz(hz))).unwrap();
        let link = Rc::new(RefCell::new(link));
        let protocol = BissC::new(FRAME.parse().unwrap());
        let mut shared = Rc::clone(&link);
        let mut master = Master::new(&mut shared, &protocol, Some(0));
        master.open().unwrap();
        for _ in 0..100 {
            master.slot(0, None).unwrap();
            frames += 1;
            let word = master.cycle().words().first().copied();
            if let Some(data) = word.and_then(|word| word.good()) {
                let mut link = link.borrow_mut();
                let latched = link.bus_mut().bus.pins().slave().latched();
                assert_eq!(latched, [data], "{hz} Hz, {config}");
                good += 1;
            }
        }
    }
    println!("{good} of {frames} frames were good");
    assert!(good > 0 && good < frames);
}

/// Bursts of noise on a dead line look like answers that come late, but a line delays by so much and no more: transfers
/// do not grow without end.
#[test]
fn noise_on_a_dead_line_does_not_lengthen_transfers() {
    let mut bus = Watched::new(&format!("stuck=1,frame={FRAME}"), Controller::default());
    bus.bursts = Some(common::rng());
    let link = Wave::new(bus, Options::default(), Some(Hertz(1_000_000))).unwrap();
    let link = Rc::new(RefCell::new(link));
    let mut shared = Rc::clone(&link);
    let protocol = BissC::new(FRAME.parse().unwrap());
    let mut master = Master::new(&mut shared, &protocol, Some(0));
    master.open().unwrap();
    let mut longest = 0;
    for _ in 0..2_000 {
        master.slot(0, None).unwrap();
        assert!(!master.cycle().is_good());
        longest = longest.max(link.borrow().last().0.bytes().len());
    }
    // 8 samples a µs: both searches, timeout and delay at their longest, and the frame.
    assert!(longest < 40 + 40 + 80 + 80 + 60, "{longest} bytes");
}

#[test]
fn where_mosi_rests_is_said_as_far_as_it_is_known() {
    let note = |idle, invert| {
        let options = Options {
            idle,
            invert,
            ..Options::default()
        };
        let config = format!("frame={FRAME}");
        open(&config, Controller::default(), options, 1_000_000).notes()[1..].join(" ")
    };
    assert!(note(None, false).contains("must rest high"));
    assert!(note(None, true).contains("must rest low"));
    assert!(note(Some(false), false).contains("MA falls after"));
    for (idle, invert, rests, words) in [
        (None, false, Some(true), "keeps MOSI high"),
        (None, true, Some(false), "keeps MOSI low"),
        (Some(false), false, None, "MA falls after"),
        (Some(true), true, None, "MA falls after"),
    ] {
        let bus = Watched::new(&format!("frame={FRAME}"), Controller::default());
        let options = Options {
            idle,
            invert,
            ..Options::default()
        };
        let mut link = Wave::new(bus, options, None).unwrap();
        assert_eq!(link.bus_mut().rests, rests, "{idle:?} {invert}");
        assert!(link.notes()[1].contains(words), "{:?}", link.notes());
    }
    // As the user said: there is nothing to doubt.
    assert_eq!(note(Some(true), false), "");
    assert_eq!(note(Some(false), true), "");
}

/// Measuring SCLK is no control communication, even where MOSI falls after each transfer.
#[test]
fn opening_sends_no_control_bit() {
    for mhz in [1, 3, 10] {
        let controller = Controller {
            mosi_rests: Some(false),
            ..Controller::default()
        };
        let mut bus = Watched::new(&format!("timeout=20us,frame={FRAME}"), controller);
        // Soon enough for the edge to count, then so late that the slave times out.
        bus.late_ns = [60_000, 5_000];
        let control = Rc::clone(&bus.control);
        let options = Options {
            idle: Some(false),
            ..Options::default()
        };
        let link = Wave::new(bus, options, Some(Hertz(mhz * 1_000_000))).unwrap();
        drop(link);
        assert_eq!(control.get(), 0, "{mhz} MHz");
    }
}
