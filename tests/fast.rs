//! The fast ways say what the plain ones say: frames decoded a word at a time, recordings read 64 samples at a time.
//!
//! Ten million frames: `BISS_TEST_SIZE=10000 cargo test --release --test fast`.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;
#[path = "common/plain.rs"]
mod plain;

use biss::cycle::{Cycle, Head};
use biss::frame::{BissC, Stall, emit};
use biss::protocol::Protocol;
use biss::scan::{Place, Scanner};
use biss::slave::{Config, Slave};
use biss::slice::Slicer;
use biss::trace::{Bits, Cut, Level, Trace};
use common::{format, rng, size, word};
use fastrand::Rng;

/// A frame, often with something wrong.
fn frame(protocol: &BissC, rng: &mut Rng, trace: &mut Trace) {
    trace.reset();
    let small = |rng: &mut Rng| match rng.u8(..8) {
        0 => rng.u16(..60),
        1 => rng.u16(..12),
        _ => rng.u16(..4),
    };
    let head = Head {
        delay_clk: small(rng),
        ack: 1 + small(rng),
        cds: rng.bool(),
    };
    let data: Vec<u64> = protocol
        .format
        .channels()
        .iter()
        .map(|channel| match rng.u8(..8) {
            0 => 0,
            _ => word(rng, channel.data_bits()),
        })
        .collect();
    let mut sent = Bits::default();
    emit(&protocol.format, head, &data, &mut sent);
    let mut levels: Vec<bool> = sent.iter().collect();
    levels.extend(std::iter::repeat_n(false, rng.usize(..4)));
    if rng.u8(..3) == 0 {
        for _ in 0..rng.usize(1..4) {
            let at = rng.usize(..levels.len());
            levels[at] = !levels[at];
        }
    }
    match rng.u8(..12) {
        0 => levels.truncate(rng.usize(..levels.len())),
        1 => levels.iter_mut().for_each(|level| *level = rng.bool()),
        2 => levels.extend((0..rng.usize(..90)).map(|_| rng.u8(..9) == 0)),
        3 => levels = vec![rng.bool(); rng.usize(1..2100)],
        _ => {}
    }
    trace.bits.extend(levels);
    wrap(rng, trace);
}

/// What was measured about it.
fn wrap(rng: &mut Rng, trace: &mut Trace) {
    let maybe = |rng: &mut Rng, often: u8, most: u32| {
        let there = rng.u8(..often) > 0;
        there.then(|| rng.u32(..most))
    };
    let period = [100u32, 400, 1000, 12_500, 0];
    trace.ma_period_ns = (rng.u8(..8) > 0).then(|| *rng.choice(&period).unwrap());
    trace.idle = [None, Some(true), Some(true), Some(true), Some(false)][rng.usize(..5)];
    trace.waited_ns = maybe(rng, 2, 90_000).map(u64::from);
    let most = if rng.u8(..8) == 0 { 60_000 } else { 900 };
    trace.delay_ns = maybe(rng, 2, most);
    trace.reference_ns = maybe(rng, 3, 20_000);
    trace.longest = maybe(rng, 2, 3_000).map(|ns| Level {
        ns,
        edge: rng.u16(1..40),
    });
    if rng.u8(..8) == 0 {
        trace.late = maybe(rng, 2, 300).map(|ns| Level { ns, edge: 5 });
    }
    if rng.u8(..16) == 0 {
        trace.misplaced_ns = maybe(rng, 2, 20_000);
    }
    trace.surplus = if rng.u8(..4) == 0 { rng.u16(..4) } else { 0 };
    trace.cut = [Some(Cut::Begin), Some(Cut::End)]
        .get(rng.usize(..30))
        .copied()
        .flatten();
}

#[test]
fn frames_equal_the_plain_decoder() {
    let mut rng = rng();
    let (mut trace, mut cycle) = (Trace::default(), Cycle::default());
    let (mut good, mut faults, mut words) = (0, [0; 10], Vec::new());
    for _ in 0..size(1_000) {
        let text = format(&mut rng);
        let mut protocol = BissC::new(text.parse().unwrap());
        protocol.stall = match rng.u8(..3) {
            0 => Stall::Unknown,
            1 => Stall::Adaptive,
            _ => Stall::Static {
                min_ns: rng.u32(..3_000),
            },
        };
        for _ in 0..100 {
            frame(&protocol, &mut rng, &mut trace);
            protocol.decode(&trace, &mut cycle);
            let show = || format!("{text}: {trace:?}");
            match plain::decode(&protocol, &trace, &mut words) {
                Err(fault) => {
                    assert_eq!(cycle.fault(), Some(fault), "{}", show());
                    assert!(cycle.words().is_empty());
                    faults[fault.index()] += 1;
                }
                Ok(head) => {
                    assert_eq!(
                        (cycle.fault(), cycle.head()),
                        (None, Some(head)),
                        "{}",
                        show()
                    );
                    let fast: Vec<plain::Received> = cycle
                        .words()
                        .iter()
                        .map(|word| (word.raw().0, word.raw().1, word.fault()))
                        .collect();
                    assert_eq!(fast, words, "{}", show());
                    good += u32::from(cycle.is_good());
                }
            }
        }
    }
    println!("{good} good, cycles that are faults, by kind: {faults:?}");
    assert!(good > 0 && [0, 1, 2, 3, 5, 7].iter().all(|kind| faults[*kind] > 0));
}

/// A recorder on the wires of a simulated slave, and a master with habits.
struct Recorder {
    slave: Slave,
    samples: Vec<u8>,
    /// Bits of the bytes.
    ma_bit: u8,
    slo_bit: u8,
    /// Between samples, in femtoseconds.
    step_fs: u64,
    ma: bool,
    /// One sample in so many reads SLO, or MA, wrong.
    noise: u64,
    ma_noise: u64,
    rng: Rng,
}

impl Recorder {
    fn until(&mut self, t_fs: u64) {
        while self.samples.len() as u64 * self.step_fs < t_fs {
            let t_ns = self.samples.len() as u64 * self.step_fs / 1_000_000;
            let mut hit = |one_in: u64| one_in > 0 && self.rng.u64(..one_in) == 0;
            let ma = self.ma ^ hit(self.ma_noise);
            let slo = self.slave.slo(t_ns) ^ hit(self.noise);
            let others = self.rng.u8(..) & !(1 << self.ma_bit | 1 << self.slo_bit);
            let levels = u8::from(ma) << self.ma_bit | u8::from(slo) << self.slo_bit;
            self.samples.push(levels | others);
        }
    }

    fn ma(&mut self, t_fs: u64, level: bool) {
        self.until(t_fs);
        self.ma = level;
        self.slave.ma(t_fs / 1_000_000, level);
    }
}

/// Some frames at one clock, with what goes wrong on real wires now and then.
fn recording(rng: &mut Rng) -> (Recorder, u64) {
    const STEPS_FS: [u64; 6] = [
        10_000_000, 2_000_000, 41_666_666, 20_000_000, 62_500_000, 8_333_333,
    ];
    let step_fs = *rng.choice(&STEPS_FS).unwrap();
    // Samples in half a clock, of which a whole number is the rule and not a law.
    let half_fs = match rng.u8(..4) {
        0 => step_fs * rng.u64(4..70),
        1 => step_fs * rng.u64(2..10),
        _ => step_fs * rng.u64(4..20) + rng.u64(..step_fs),
    };
    let delay_ns = match rng.u8(..4) {
        0 => 0,
        1 => rng.u64(..40_000),
        _ => rng.u64(..half_fs / 1_000_000 + 2),
    };
    let jitter_ns = if rng.u8(..4) == 0 {
        rng.u64(..step_fs / 1_000_000 + 1)
    } else {
        0
    };
    let timeout_ns = rng.u64(12_500..40_000);
    let (ack, busy) = (rng.u64(1..4), rng.u64(..3) * 1000);
    let config = format!(
        "motion=count,pos=77,delay={delay_ns}ns,jitter={jitter_ns}ns,timeout={timeout_ns}ns,ack={ack},busy={busy}ns,frame=st12,nE,nW,crc6"
    );
    let config: Config = config.parse().unwrap_or_else(|e| panic!("{config}: {e}"));
    let mut bits = [0, 1, 2, 3, 4, 5, 6, 7];
    rng.shuffle(&mut bits);
    let one_in = |rng: &mut Rng| {
        if rng.u8(..8) == 0 {
            rng.u64(50..5_000)
        } else {
            0
        }
    };
    let (noise, ma_noise) = (one_in(rng), one_in(rng) * u64::from(rng.bool()));
    let mut recorder = Recorder {
        slave: Slave::new(config),
        samples: Vec::new(),
        ma_bit: bits[0],
        slo_bit: bits[1],
        step_fs,
        ma: true,
        noise,
        ma_noise,
        rng: Rng::with_seed(rng.u64(..)),
    };
    let mut t_fs = rng.u64(..200_000_000_000);
    let spare_ns = if rng.bool() {
        rng.u64(..2_000)
    } else {
        rng.u64(..60_000)
    };
    for _ in 0..rng.u64(2..8) {
        let odd = rng.u8(..10);
        let edges = if odd == 0 {
            rng.u64(2..40)
        } else {
            2 + ack + busy * 1_000_000 / (2 * half_fs) + 24
        };
        let paused = if odd == 1 { rng.u64(..edges) } else { u64::MAX };
        for edge in 0..edges {
            recorder.ma(t_fs, false);
            t_fs += half_fs;
            recorder.ma(t_fs, true);
            t_fs += half_fs;
            if edge == paused {
                t_fs += rng.u64(..90_000_000_000);
            }
        }
        if odd == 2 {
            // CDM = 1.
            recorder.ma(t_fs, false);
        }
        t_fs += (timeout_ns + delay_ns + spare_ns) * 1_000_000;
        if odd == 2 {
            recorder.ma(t_fs, true);
            t_fs += half_fs;
        }
        if odd == 3 {
            t_fs += rng.u64(..300_000_000_000);
        }
    }
    t_fs += rng.u64(..100_000_000_000);
    recorder.until(t_fs);
    (recorder, step_fs)
}

/// What a scanner finds, and how many cycles it read as a whole.
fn found(mut scanner: Scanner, samples: &[u8], rng: &mut Rng) -> (Vec<Trace>, u64) {
    let mut slicer = Slicer::new(40_000);
    let (mut rest, mut trace, mut all) = (samples, Trace::default(), Vec::new());
    while !rest.is_empty() {
        let most = *rng.choice(&[1, 70, 1000, 100_000]).unwrap();
        let piece = &rest[..rng.usize(2.min(rest.len())..=most.max(2).min(rest.len()))];
        let used = scanner.scan(piece, &mut slicer);
        rest = &rest[used..];
        while slicer.take(&mut trace) {
            all.push(trace.clone());
        }
    }
    scanner.finish(&mut slicer);
    while slicer.take(&mut trace) {
        all.push(trace.clone());
    }
    (all, scanner.wholes())
}

#[test]
fn recordings_equal_the_plain_way() {
    let mut rng = rng();
    let (mut cycles, mut wholes) = (0, 0);
    for _ in 0..size(300) {
        let (mut recorder, step_fs) = recording(&mut rng);
        let from = if rng.bool() {
            0
        } else {
            rng.usize(..recorder.samples.len().min(9_000))
        };
        let (ma, slo) = (recorder.ma_bit.into(), recorder.slo_bit.into());
        let samples = &mut recorder.samples[from..];
        if rng.u8(..16) == 0 {
            samples
                .iter_mut()
                .for_each(|sample| *sample = rng.u8(..) | 128 >> rng.u8(..8));
        }
        let scanner = || Scanner::new(step_fs, 1, Place::of(ma), Place::of(slo));
        let (plain, none) = found(scanner().plain(), samples, &mut rng);
        assert_eq!(none, 0);
        // The same in samples of two bytes.
        let double: Vec<u8> = samples
            .iter()
            .flat_map(|sample| [sample.wrapping_mul(7), *sample])
            .collect();
        let wide = Scanner::new(step_fs, 2, Place::of(8 + ma), Place::of(8 + slo));
        let fast = [
            found(scanner(), samples, &mut rng),
            found(scanner().portable(), samples, &mut rng),
            found(wide, &double, &mut rng),
        ];
        for (fast, whole) in &fast {
            for (at, (fast, plain)) in fast.iter().zip(&plain).enumerate() {
                assert_eq!(
                    fast, plain,
                    "cycle {at} of {}, step {step_fs} fs",
                    fast.t_ns
                );
            }
            assert_eq!(fast.len(), plain.len());
            wholes += whole;
        }
        cycles += plain.len();
    }
    println!("{cycles} cycles, {} read as a whole", wholes / 3);
    assert!(
        wholes / 3 > cycles as u64 / 20,
        "the fast way is hardly ever taken"
    );
}
