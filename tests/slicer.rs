//! No frame of a sampled recording is lost, none is wrong: a simulated slave and a master of its own, a sampler on
//! both wires, and what the product makes of it, straight from the slicer and from the text of a VCD file.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;
#[path = "common/pushed.rs"]
mod pushed;

use biss::frame::{BissC, Stall};
use biss::link::{Link, file};
use biss::master::{Master, Slot};
use biss::slave::{Config, Slave};
use biss::slice::Slicer;
use common::{rng, size};
use fastrand::Rng;
use pushed::Pushed;
use std::fmt::Write;

const FORMAT: &str = "st26,nE,nW,crc6";
/// LAT, Ack, start, CDS, 34 bits, stop.
const EDGES: u64 = 39;

/// Both levels from a time on.
type Level = (u64, bool, bool);

/// A master's MA and a slave's SLO, edge by edge as they are on the wire.
struct Wires {
    slave: Slave,
    delay_ns: u64,
    /// Each edge of SLO is so much earlier or later than this frame's Ack wants, mostly by all of it.
    jitter_ns: u64,
    rng: Rng,
    t_ns: u64,
    ma: Vec<(u64, bool)>,
    slo: Vec<(u64, bool)>,
    acked: bool,
    latched: Vec<(u64, u64)>,
    /// MA fell before SL = 1 had arrived, and the frame began all the same.
    eager: Vec<u64>,
}

impl Wires {
    /// The slave itself without line delay and jitter: both are added here.
    fn new(config: &str, delay_ns: u64, jitter_ns: u64, rng: &mut Rng) -> Wires {
        let config: Config = config.parse().unwrap_or_else(|e| panic!("{config}: {e}"));
        let mut slave = Slave::new(config);
        let slo = slave.slo(0);
        Wires {
            slave,
            delay_ns,
            jitter_ns,
            rng: Rng::with_seed(rng.u64(..)),
            t_ns: 0,
            ma: vec![(0, true)],
            slo: vec![(0, slo)],
            acked: true,
            latched: Vec::new(),
            eager: Vec::new(),
        }
    }

    fn look(&mut self, at_ns: u64) {
        let level = self.slave.slo(at_ns);
        let Some((last_ns, _)) = self.slo.last().filter(|(_, last)| *last != level) else {
            return;
        };
        let jitter_ns = match self.rng.u8(..4) {
            0 => self.rng.u64(0..=2 * self.jitter_ns),
            1 => 0,
            _ => 2 * self.jitter_ns,
        };
        let ack = !std::mem::replace(&mut self.acked, true);
        let late = if ack { self.jitter_ns } else { jitter_ns };
        // Never before the edge that set it.
        let arrives = (at_ns + self.delay_ns + late).saturating_sub(self.jitter_ns);
        let arrives = arrives.max(at_ns).max(*last_ns);
        self.slo.push((arrives, level));
    }

    fn until(&mut self, t_ns: u64) {
        while let Some(at) = self.slave.next_change().filter(|at| *at <= t_ns) {
            self.look(at);
        }
        self.t_ns = t_ns;
    }

    fn ma(&mut self, t_ns: u64, level: bool) {
        self.until(t_ns);
        self.ma.push((t_ns, level));
        let latches = self.slave.latches();
        self.slave.ma(t_ns, level);
        if self.slave.latches() > latches {
            self.latched.push((t_ns, self.slave.latched()[0]));
            let (fell, _) = self.ma[self.ma.len() - 2];
            let seen = self.slo.iter().rev().find(|(at, _)| *at <= fell);
            if seen.is_some_and(|(_, level)| !level) {
                self.eager.push(t_ns);
            }
            self.acked = false;
        }
        self.look(t_ns);
    }

    /// Rests until the slave is ready and SL has been 1 for `rest_ns`.
    fn ready(&mut self, rest_ns: u64) {
        while let Some(at) = self.slave.next_change() {
            self.until(at);
        }
        let risen = self.slo.last().map_or(0, |(at, _)| *at);
        self.until(self.t_ns.max(risen) + rest_ns);
    }

    /// Both wires, in order of time.
    fn levels(&self) -> Vec<Level> {
        let mut all: Vec<(u64, bool, bool)> = Vec::new();
        all.extend(self.ma.iter().map(|(t, level)| (*t, true, *level)));
        all.extend(self.slo.iter().map(|(t, level)| (*t, false, *level)));
        all.sort_by_key(|(t, ma, _)| (*t, !ma));
        let (mut ma, mut slo) = (true, true);
        let set = all.into_iter().map(|(t, of_ma, level)| {
            *(if of_ma { &mut ma } else { &mut slo }) = level;
            (t, ma, slo)
        });
        set.collect()
    }
}

/// What an ideal sampler with `every` ns between samples shows of it, its first sample `phase` ns after the start.
fn sampled(levels: &[Level], every: f64, phase: f64) -> Vec<Level> {
    let mut seen: Vec<Level> = Vec::new();
    for (t_ns, ma, slo) in levels {
        let sample = ((*t_ns as f64 - phase) / every).ceil().max(0.0);
        let at = (phase + sample * every).round() as u64;
        match seen.last_mut() {
            Some(last) if last.0 == at => (last.1, last.2) = (*ma, *slo),
            Some(last) if (last.1, last.2) == (*ma, *slo) => {}
            _ => seen.push((at, *ma, *slo)),
        }
    }
    seen
}

fn vcd(levels: &[Level]) -> String {
    let mut text = "$timescale 1 ns $end\n$var wire 1 ! MA $end\n$var wire 1 \" SLO $end\n$enddefinitions $end\n".to_owned();
    let mut old = None;
    for (t_ns, ma, slo) in levels {
        writeln!(text, "#{t_ns}").unwrap();
        if old.is_none_or(|(old, _)| old != ma) {
            writeln!(text, "{}!", u8::from(*ma)).unwrap();
        }
        if old.is_none_or(|(_, old)| old != slo) {
            writeln!(text, "{}\"", u8::from(*slo)).unwrap();
        }
        old = Some((ma, slo));
    }
    text
}

/// Every word that came out good, with the time of its cycle, and every fault.
type Read = (Vec<(u64, u64)>, Vec<String>);

fn read(link: &mut dyn Link, protocol: &BissC) -> Read {
    let mut master = Master::new(link, protocol, None);
    master.open().unwrap();
    let (mut words, mut faults) = (Vec::new(), Vec::new());
    loop {
        match master.slot(0, None).unwrap() {
            Slot::Ended => return (words, faults),
            Slot::Piece(_) => continue,
            Slot::Done { .. } => {}
        }
        let cycle = master.cycle();
        let good = cycle.words().first().and_then(|word| word.good());
        words.extend(good.map(|word| (master.trace().t_ns, word)));
        let fault = cycle
            .fault()
            .or(cycle.words().first().and_then(|word| word.fault()));
        faults.extend(fault.map(|fault| format!("{fault} in {:?}", master.trace())));
    }
}

fn read_levels(levels: &[Level], end_ns: u64, protocol: &BissC) -> Read {
    let mut slicer = Slicer::new(protocol.timeout_max_ns.into());
    for (t_ns, ma, slo) in levels {
        slicer.push(*t_ns, *ma, Some(*slo));
    }
    slicer.finish(end_ns);
    read(&mut Pushed(slicer), protocol)
}

fn read_vcd(levels: &[Level], end_ns: u64, protocol: &BissC) -> Read {
    let text = format!("{}#{end_ns}\n", vcd(levels));
    let input = std::io::Cursor::new(text.into_bytes());
    let timeout_ns = protocol.timeout_max_ns.into();
    let input = file::Input::pipe(input);
    let mut link = file::open(input, "text", &file::Asked::new(timeout_ns)).unwrap();
    read(&mut link, protocol)
}

/// One set-up: a clock, a slave, a line.
struct Case {
    period_ns: f64,
    config: String,
    delay_ns: u64,
    cdm: bool,
    /// Rising edges of a frame.
    clocks: u64,
    /// MA rests so much longer after every eighth clock, as SPI controllers do.
    gap_ns: f64,
}

impl Case {
    fn new(period_ns: f64, delay_ns: u64, timeout: &str, ack: u16, rng: &mut Rng) -> Case {
        // In the middle between two edges: a start bit that wanders is another matter (`track`).
        let busy_clocks = rng.u64(0..20).min((39_000.0 / period_ns) as u64);
        let busy_ns = (busy_clocks as f64 * period_ns - period_ns / 2.0) as u64;
        // The whole delay again, as a master does that does not know it, or nothing.
        let spare = if rng.bool() {
            (delay_ns as f64 / period_ns) as u64 + 2
        } else {
            rng.u64(0..4)
        };
        let least = busy_clocks.max(ack.into());
        // Above that a clock and its gap are longer than a stall.
        let gap_ns = if period_ns < 8_000.0 && rng.u8(..4) == 0 {
            0.2 * period_ns
        } else {
            0.0
        };
        Case {
            period_ns,
            config: format!(
                "seed={},motion=count,pos={},timeout={timeout},ack={ack},busy={busy_ns}ns,cds={},\
                 frame={FORMAT}",
                rng.u32(..),
                rng.u32(..1 << 26),
                rng.u8(..2)
            ),
            delay_ns,
            cdm: rng.bool(),
            clocks: EDGES + least + spare,
            gap_ns,
        }
    }

    /// Without a line through all edges nothing is left at eight, and the clock is known less well.
    fn enough(&self, samples: f64) -> f64 {
        samples.max(if self.gap_ns > 0.0 { 10.0 } else { 0.0 })
    }

    fn protocol(&self) -> BissC {
        let mut protocol = BissC::new(FORMAT.parse().unwrap());
        if self.period_ns > 10_000.0 {
            // Two rising edges are as far apart as the shortest timeout is long: which one it is must be known.
            protocol.stall = Stall::Static { min_ns: 19_000 };
        }
        protocol
    }

    /// `frames` frames, each begun as soon as the slave is ready, and the words that were latched.
    fn run(&self, frames: usize, rng: &mut Rng) -> (Wires, Vec<u64>) {
        // A quarter of a clock relative to the Ack edge (D2 Table 10).
        let jitter_ns = (self.period_ns / 4.0) as u64;
        let mut wires = Wires::new(&self.config, self.delay_ns, jitter_ns, rng);
        let half = self.period_ns / 2.0;
        wires.until(rng.u64(45_000..90_000));
        for _ in 0..frames {
            let begin = wires.t_ns as f64;
            let edge_ns = |edge: u64| {
                let gaps = (edge / 16) as f64 * self.gap_ns;
                (begin + edge as f64 * half + gaps).round() as u64
            };
            for edge in 0..2 * self.clocks {
                let t_ns = edge_ns(edge);
                wires.ma(t_ns, edge % 2 == 1);
            }
            if self.cdm && rng.bool() {
                wires.ma(edge_ns(2 * self.clocks), false);
                wires.ready(self.period_ns as u64);
                wires.ma(wires.t_ns, true);
                wires.until(wires.t_ns + self.period_ns as u64);
            } else {
                wires.ready(rng.u64(1..=half as u64));
            }
        }
        wires.until(wires.t_ns + 90_000);
        let latched = wires.latched.iter().map(|(_, word)| *word).collect();
        (wires, latched)
    }
}

/// Clocks from 80 kHz to 10 MHz, as many slow ones as fast ones.
fn any_period(rng: &mut Rng) -> f64 {
    if rng.u8(..4) == 0 {
        return *rng
            .choice(&[100.0, 125.0, 200.0, 1_000.0, 4_000.0, 12_500.0])
            .unwrap();
    }
    100.0 * 125f64.powf(rng.f64())
}

fn any_delay(period_ns: f64, rng: &mut Rng) -> u64 {
    match rng.u8(..4) {
        0 => 0,
        1 => rng.u64(0..=period_ns as u64),
        2 => rng.u64(0..=40_000 - period_ns as u64),
        // Whole clocks, as many as there may be.
        _ => {
            let most = ((39_900.0 - period_ns / 8.0) / period_ns) as u64;
            (rng.u64(0..=most) as f64 * period_ns) as u64
        }
    }
}

/// Start bits that are late by 40 µs or eight clocks (D2 Table 10).
fn any_ack(period_ns: f64, rng: &mut Rng) -> u16 {
    let most = (38_000.0 / period_ns - 2.0).max(8.0) as u16;
    *rng.choice(&[1, 2, 9.min(most), 30.min(most), most])
        .unwrap()
}

fn any_timeout(period_ns: f64, rng: &mut Rng) -> String {
    let timeouts = [
        "adaptive",
        "adaptive,tclk=20ns",
        "12500ns",
        "20us",
        "40us",
        "request",
    ];
    match *rng.choice(&timeouts).unwrap() {
        "12500ns" | "adaptive,tclk=20ns" if period_ns > 10_000.0 => "20us".into(),
        // An adaptive slave listens for 20 µs at most while it measures (D2, p. 8).
        timeout => timeout.into(),
    }
}

#[derive(Default)]
struct Tally {
    frames: usize,
    lost: usize,
    wrong: usize,
    first: Option<String>,
}

impl Tally {
    fn count(&mut self, case: &Case, samples: f64, latched: &[u64], read: &Read) {
        let (words, faults) = read;
        let words: Vec<u64> = words.iter().map(|(_, word)| *word).collect();
        let wrong = words.iter().filter(|word| !latched.contains(word)).count();
        self.frames += latched.len();
        self.wrong += wrong;
        self.lost += latched.len().saturating_sub(words.len() - wrong);
        if words != latched && self.first.is_none() {
            self.first = Some(format!(
                "{} ns, gaps of {} ns, delay {} ns, {samples} samples a clock, {} clocks, {}: {words:?}, latched {latched:?}\n{}",
                case.period_ns,
                case.gap_ns,
                case.delay_ns,
                case.clocks,
                case.config,
                faults.join("\n")
            ));
        }
    }

    fn say(&self, name: &str) {
        println!(
            "{name}: {} frames, {} lost, {} wrong",
            self.frames, self.lost, self.wrong
        );
        if let Some(first) = &self.first {
            println!("{first}");
        }
    }
}

/// Samples a clock. Below eight only the line through all edges helps, and only down to six: of the quarter of a clock that
/// jitter leaves, a sample goes to the stamps of Ack and bit, and half of one to the edges, which count beside a line that
/// they do not quite stand on.
const SAMPLES: [f64; 9] = [6.3, 8.0, 8.02, 8.3, 8.9, 12.5, 16.1, 25.0, 64.0];

#[test]
fn no_frame_is_lost_over_the_grid() {
    let mut rng = rng();
    let mut total = Tally::default();
    let rounds = size(2);
    for period_ns in [100.0, 160.0, 400.0, 1_000.0, 3_333.0, 10_000.0, 12_500.0] {
        for delay_clocks in [0.0, 0.4, 1.0, 3.5, 40.0, 399.0] {
            let delay_ns = (delay_clocks * period_ns) as u64;
            if delay_ns as f64 + period_ns / 8.0 > 40_000.0 {
                continue;
            }
            for timeout in ["adaptive", "20us"] {
                for samples in SAMPLES {
                    for _ in 0..rounds {
                        let ack = any_ack(period_ns, &mut rng);
                        let case = Case::new(period_ns, delay_ns, timeout, ack, &mut rng);
                        let (wires, latched) = case.run(3, &mut rng);
                        let samples = case.enough(samples);
                        let every = period_ns / samples;
                        let seen = sampled(&wires.levels(), every, rng.f64() * every);
                        let read = read_levels(&seen, wires.t_ns, &case.protocol());
                        total.count(&case, samples, &latched, &read);
                    }
                }
            }
        }
    }
    total.say("grid");
    assert!(
        total.lost == 0 && total.wrong == 0,
        "lost or wrong: see above"
    );
}

#[test]
fn no_frame_is_lost_anywhere_between() {
    let mut rng = rng();
    let mut total = Tally::default();
    for round in 0..size(2_000) {
        let period_ns = any_period(&mut rng);
        let samples = match rng.u8(..3) {
            0 => 8.0,
            1 => 8.0 + rng.f64(),
            _ => 8.0 * 8f64.powf(rng.f64()),
        };
        let delay_ns = any_delay(period_ns, &mut rng);
        let timeout = any_timeout(period_ns, &mut rng);
        let ack = any_ack(period_ns, &mut rng);
        let case = Case::new(period_ns, delay_ns, &timeout, ack, &mut rng);
        let (wires, latched) = case.run(6, &mut rng);
        let samples = case.enough(samples);
        let every = period_ns / samples;
        let seen = sampled(&wires.levels(), every, rng.f64() * every);
        let read = match round % 2 {
            0 => read_levels(&seen, wires.t_ns, &case.protocol()),
            _ => read_vcd(&seen, wires.t_ns, &case.protocol()),
        };
        total.count(&case, samples, &latched, &read);
    }
    total.say("anywhere");
    assert!(
        total.lost == 0 && total.wrong == 0,
        "lost or wrong: see above"
    );
}

/// A controller that rests after every eighth clock makes a staircase of the edges, which no line goes through: bits are
/// read neither by a line alone nor by stamps that are a sample late each.
#[test]
fn no_frame_is_lost_where_every_eighth_clock_is_longer() {
    let mut rng = rng();
    let mut total = Tally::default();
    for _ in 0..size(5_000) {
        let period_ns = 100.0 * 70f64.powf(rng.f64());
        let samples = 8.0 + 0.1 * rng.f64() * f64::from(rng.u8(..2));
        let delay_ns = any_delay(period_ns, &mut rng);
        let mut case = Case::new(period_ns, delay_ns, "20us", 1, &mut rng);
        case.gap_ns = period_ns * *rng.choice(&[0.1, 0.15, 0.2]).unwrap();
        let (wires, latched) = case.run(6, &mut rng);
        let every = period_ns / samples;
        let seen = sampled(&wires.levels(), every, rng.f64() * every);
        let read = read_levels(&seen, wires.t_ns, &case.protocol());
        total.count(&case, samples, &latched, &read);
    }
    total.say("gaps");
    assert!(
        total.lost == 0 && total.wrong == 0,
        "lost or wrong: see above"
    );
}

/// Whole frames after a piece are known by the line delay they have in common, however close they follow.
#[test]
fn a_recording_may_begin_inside_a_frame() {
    let mut rng = rng();
    let (mut whole, mut lost, mut most, mut wrong) = (0, 0, 0, 0);
    let rounds = size(500);
    for _ in 0..rounds {
        let period_ns = any_period(&mut rng);
        let delay_ns = any_delay(period_ns, &mut rng);
        let timeout = any_timeout(period_ns, &mut rng);
        let case = Case::new(period_ns, delay_ns, &timeout, 1, &mut rng);
        let (wires, _) = case.run(8, &mut rng);
        let every = period_ns / case.enough(8.0 + 8.0 * rng.f64());
        let mut seen = sampled(&wires.levels(), every, rng.f64() * every);
        let (first, _) = wires.latched[0];
        let (third, _) = wires.latched[2];
        let from = rng.u64(first..third);
        let begin = seen
            .iter()
            .rposition(|(t_ns, ..)| *t_ns <= from)
            .unwrap_or(0);
        seen.drain(..begin);
        seen[0].0 = from;
        let (words, _) = read_levels(&seen, wires.t_ns, &case.protocol());
        let after = wires
            .latched
            .iter()
            .filter(|(t_ns, _)| *t_ns > from + period_ns as u64);
        let sent: Vec<u64> = after.map(|(_, word)| *word).collect();
        whole += sent.len();
        wrong += words
            .iter()
            .filter(|(_, word)| !sent.contains(word))
            .count();
        let here = sent.len().saturating_sub(words.len());
        (lost, most) = (lost + here, most.max(here));
    }
    println!(
        "begun anywhere: {whole} whole frames, {lost} lost, at most {most} of a recording, {wrong} wrong"
    );
    assert_eq!(wrong, 0);
    // The first one, where the recording begins so shortly before it that this may be a pause inside a frame.
    assert!(2 * lost < rounds, "lost: see above");
}

/// A recording that begins anywhere, of frames in which MA pauses anywhere for any time.
struct Cut {
    levels: Vec<Level>,
    end_ns: u64,
    latched: Vec<(u64, u64)>,
    eager: Vec<u64>,
    period_ns: f64,
    what: String,
}

fn cut(rng: &mut Rng) -> (Cut, BissC) {
    let format = *rng.choice(&["st8,crc6", "st8,nE,nW,crc6", FORMAT]).unwrap();
    let protocol = BissC::new(format.parse().unwrap());
    let edges = 5 + u64::from(protocol.format.bits());
    let period_ns = 100.0 * 40f64.powf(rng.f64());
    let delay_ns = any_delay(period_ns, rng);
    let timeout = any_timeout(period_ns, rng);
    let config = format!(
        "seed={},motion={},pos={},timeout={timeout},ack={},frame={format}",
        rng.u32(..),
        rng.choice(&["count", "still"]).unwrap(),
        rng.u64(0..1 << 26) | *rng.choice(&[0, (1 << 26) - 1]).unwrap(),
        rng.u8(1..4),
    );
    let jitter_ns = (period_ns * *rng.choice(&[0.0, 0.1, 0.25]).unwrap()) as u64;
    let mut wires = Wires::new(&config, delay_ns, jitter_ns, rng);
    let half = period_ns / 2.0;
    wires.until(rng.u64(45_000..90_000));
    let began = wires.t_ns;
    let spare = if rng.bool() {
        (delay_ns as f64 / period_ns) as u64 + 2
    } else {
        0
    };
    let often = *rng.choice(&[0, 1, 2, 4]).unwrap();
    for _ in 0..rng.u8(2..6) {
        let mut clocks = rng.u64(2..=edges + spare + 3);
        if rng.u8(..4) > 0 {
            clocks = clocks.max(edges + spare);
        }
        let pause_at: Vec<u64> = (0..rng.u64(0..=often))
            .map(|_| rng.u64(1..2 * clocks))
            .collect();
        let begin = wires.t_ns as f64;
        let mut paused = 0.0;
        for edge in 0..2 * clocks {
            if pause_at.contains(&edge) {
                // 50 ns to 100 µs, as many short as long ones; or some clocks.
                paused += match rng.bool() {
                    true => 50.0 * 2_000f64.powf(rng.f64()),
                    false => period_ns * (0.5 + 60.0 * rng.f64()),
                };
            }
            wires.ma(
                (begin + paused + edge as f64 * half).round() as u64,
                edge % 2 == 1,
            );
        }
        if rng.u8(..3) > 0 {
            wires.ready(rng.u64(1..=4 * half as u64));
        } else {
            wires.until(wires.t_ns + (half * 500f64.powf(rng.f64())) as u64);
        }
    }
    wires.ready(90_000);
    let mut levels = wires.levels();
    let from = rng.u64(0..began + (wires.t_ns - began) * 2 / 3);
    let first = levels
        .iter()
        .rposition(|(t_ns, ..)| *t_ns <= from)
        .unwrap_or(0);
    levels.drain(..first);
    levels[0].0 = from;
    let what = format!("{period_ns} ns, delay {delay_ns} ns, {config}");
    let end_ns = wires.t_ns;
    let latched = wires.latched;
    let eager = wires.eager;
    (
        Cut {
            levels,
            end_ns,
            latched,
            eager,
            period_ns,
            what,
        },
        protocol,
    )
}

/// What the pauses of MA, and a beginning inside a frame, must not make of a recording.
#[test]
fn no_cut_and_no_pause_yields_a_position() {
    let mut rng = rng();
    let (mut good, mut wrong, mut latched) = (0, 0, 0);
    let rounds = size(20_000);
    for _ in 0..rounds {
        let (cut, protocol) = cut(&mut rng);
        let every = match rng.bool() {
            true => cut.period_ns / (8.0 * 8f64.powf(rng.f64())),
            false => 1.0,
        };
        let seen = sampled(&cut.levels, every, rng.f64() * every);
        let (words, _) = read_levels(&seen, cut.end_ns, &protocol);
        latched += cut.latched.len();
        for (t_ns, word) in words {
            // Latched with the first rising edge after the cycle began, stalls left aside. Where MA did not wait for
            // SL = 1 the slicer may take that edge for the release of CDM: then the cycle begins a clock late.
            let early = every as u64 + 1 + 2 * cut.period_ns as u64;
            let soon = t_ns.saturating_sub(early)..=t_ns + 12_000 + cut.period_ns as u64;
            let before = t_ns.saturating_sub(40_000)..=t_ns;
            let true_one = cut.latched.iter().any(|(at, sent)| {
                let here = soon.contains(at) || before.contains(at) && cut.eager.contains(at);
                here && *sent == word
            });
            good += 1;
            if !true_one {
                wrong += 1;
                if wrong < 4 {
                    println!(
                        "{word} at {t_ns}, latched {:?}, {every} ns a sample, {}",
                        cut.latched, cut.what
                    );
                }
            }
        }
    }
    println!(
        "cuts and pauses: {rounds} recordings, {latched} latched, {good} positions, {wrong} wrong"
    );
    assert_eq!(wrong, 0);
    assert!(good > rounds / 10, "the campaign shows nothing");
}

/// One frame of a word that nobody knows before, as on the wire.
fn one_frame(rng: &mut Rng) -> Wires {
    let config = format!("pos={},timeout=20us,frame={FORMAT}", rng.u32(..1 << 26));
    let mut wires = Wires::new(&config, 700, 0, rng);
    wires.until(90_000);
    for edge in 0..2 * EDGES {
        wires.ma(90_000 + edge * 500, edge % 2 == 1);
    }
    wires.ready(90_000);
    wires
}

/// Both wires, one of them inverted for 60 ns.
fn with_spike(levels: &[Level], at_ns: u64, on_ma: bool) -> Vec<Level> {
    let until = at_ns + 60;
    let after = |t_ns: u64| levels.iter().rposition(|(t, ..)| *t <= t_ns).unwrap();
    let mut all: Vec<Level> = levels.to_vec();
    for t_ns in [at_ns, until] {
        let (_, ma, slo) = levels[after(t_ns)];
        all.push((t_ns, ma, slo));
    }
    all.sort_by_key(|(t, ..)| *t);
    for (t_ns, ma, slo) in &mut all {
        let spike = (at_ns..until).contains(t_ns);
        *(if on_ma { ma } else { slo }) ^= spike;
    }
    all
}

/// Crosstalk on the wire to the analyser: SLO falls for a moment between the second rising edge and Ack. The line delay is
/// not measured from that, else bits would be read where they change.
#[test]
fn a_spike_on_slo_is_no_ack() {
    let mut rng = rng();
    let protocol = BissC::new(FORMAT.parse().unwrap());
    // Not where LAT is read.
    for at in [10, 75, 120, 210, 300, 420, 600] {
        let wires = one_frame(&mut rng);
        let (second, _) = wires.ma[4];
        let levels = with_spike(&wires.levels(), second + at, false);
        let mut slicer = Slicer::new(40_000);
        for (t_ns, ma, slo) in levels {
            slicer.push(t_ns, ma, Some(slo));
        }
        slicer.finish(wires.t_ns);
        let mut link = Pushed(slicer);
        let mut master = Master::new(&mut link, &protocol, None);
        master.slot(0, None).unwrap();
        assert_eq!(master.trace().delay_ns, Some(700), "{at}");
        let word = master.cycle().words().first().and_then(|word| word.good());
        assert_eq!(word, Some(wires.latched[0].1), "{at}");
    }
}

/// The same on MA: was it a clock to the slave? All bits after it may be in the wrong place, and of those a CRC of six bits
/// lets some pass.
#[test]
fn nothing_after_a_spike_on_ma_is_a_bit() {
    let mut rng = rng();
    let protocol = BissC::new(FORMAT.parse().unwrap());
    for _ in 0..size(4_000) {
        let wires = one_frame(&mut rng);
        let (edge_ns, _) = *rng.choice(&wires.ma[4..wires.ma.len() - 4]).unwrap();
        let levels = with_spike(&wires.levels(), edge_ns + rng.u64(20..420), true);
        let (words, _) = read_levels(&levels, wires.t_ns, &protocol);
        assert_eq!(words, [], "latched {:?}", wires.latched);
    }
}

/// A recording begins inside a frame, and too few follow to tell by their line delay that they are whole: pieces, none of
/// them a position.
#[test]
fn too_few_frames_after_a_piece_are_pieces() {
    let mut rng = rng();
    let protocol = BissC::new(FORMAT.parse().unwrap());
    for follow in 1..=4 {
        let config = format!("motion=count,timeout=adaptive,frame={FORMAT}");
        let mut wires = Wires::new(&config, 700, 0, &mut rng);
        wires.until(90_000);
        for _ in 0..=follow {
            let begin = wires.t_ns;
            for edge in 0..2 * EDGES {
                wires.ma(begin + edge * 500, edge % 2 == 1);
            }
            wires.ready(500);
        }
        wires.until(wires.t_ns + 90_000);
        let mut levels = wires.levels();
        levels.retain(|(t_ns, ..)| *t_ns > 100_000);
        let (words, faults) = read_levels(&levels, wires.t_ns, &protocol);
        let want = if follow < 4 { 0 } else { 4 };
        assert_eq!(words.len(), want, "{follow} after it: {words:?} {faults:?}");
    }
}
