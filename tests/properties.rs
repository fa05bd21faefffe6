//! What must hold for every format, delay, Ack length and every error on the wire.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;

use biss::Format;
use biss::cycle::{Cycle, Fault, Head};
use biss::frame::{BissC, emit};
use biss::link::{Link, sim};
use biss::master::{Master, Slot};
use biss::protocol::{Ability, Protocol};
use biss::slave::{Config, Motion, Slave, Timeout};
use biss::trace::{Ask, Clocks, Cut, Trace};
use biss::unit::{Hertz, Nanos};
use common::{rng, size};

#[test]
fn formats_print_and_read_back() {
    let mut rng = rng();
    for _ in 0..size(5_000) {
        let text = common::format(&mut rng);
        let once: Format = text.parse().unwrap_or_else(|e| panic!("{e}"));
        let again: Format = once.to_string().parse().unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(once, again, "{text}");
    }
}

#[test]
fn emit_then_decode_is_the_identity() {
    let mut rng = rng();
    let (mut trace, mut cycle) = (Trace::default(), Cycle::default());
    for _ in 0..size(20_000) {
        let text = common::format(&mut rng);
        let format: Format = text.parse().unwrap();
        let head = Head {
            delay_clk: rng.u16(..300),
            ack: rng.u16(1..300),
            cds: rng.bool(),
        };
        let data: Vec<u64> = format
            .channels()
            .iter()
            .map(|c| common::word(&mut rng, c.data_bits()))
            .collect();
        trace.reset();
        emit(&format, head, &data, &mut trace.bits);
        trace.bits.extend((0..rng.usize(..5)).map(|_| false));
        BissC::new(format.clone()).decode(&trace, &mut cycle);
        assert_eq!(cycle.fault(), None, "{text} {data:x?}");
        assert_eq!(cycle.head(), Some(head));
        for ((word, data), channel) in cycle.words().iter().zip(&data).zip(format.channels()) {
            let null = *data == 0 && channel.has_null();
            assert_eq!(word.fault(), null.then_some(Fault::Null));
            assert_eq!(word.good(), (!null).then_some(*data));
        }
    }
}

/// The slave makes its bits with code of its own: what it latched is what the master reads, for every format, clock,
/// line delay, busy time and kind of timeout.
#[test]
fn the_master_reads_what_the_slave_latched() {
    let mut rng = rng();
    let mut good = 0;
    let rounds = size(1_500);
    for _ in 0..rounds {
        let text = common::format(&mut rng);
        let clock = Hertz(rng.u32(100_000..10_000_000));
        let busy = rng.u64(..39_000);
        let config = Config {
            format: text.parse().unwrap(),
            seed: rng.u64(..),
            motion: Motion::Speed(rng.f64() * 6000.0 - 3000.0),
            position: rng.u64(..),
            turn: rng.u64(..1 << 40),
            timeout: match rng.u8(..3) {
                0 => Timeout::Static(Nanos(rng.u64(12_500..40_000))),
                1 => Timeout::Adaptive {
                    sample_clock: Nanos(rng.u64(..100)),
                },
                _ => Timeout::FromRequest(Nanos(40_000)),
            },
            busy: Nanos(busy)..=Nanos(busy),
            ack: rng.u16(1..8),
            delay: Nanos(rng.u64(..39_000)),
            cds: Some(rng.bool()),
            power_up_low: rng.bool(),
            ..Config::default()
        };
        let what = format!("{text} at {clock}, {config:?}");
        let mut link = sim::open(config.clone());
        link.set_clock(clock).unwrap();
        let protocol = BissC::new(config.format.clone());
        let mut master = Master::new(&mut link, &protocol, None);
        let open = master.open().unwrap();
        let null = |c: &Cycle| {
            c.words()
                .iter()
                .any(|w| matches!(w.fault(), Some(Fault::Null)))
        };
        assert!(
            open || null(master.cycle()) || config.format.bits() < 80,
            "{what}: {:?}",
            master.cycle()
        );
        for _ in 0..3 {
            let slot = master.slot(0, None).unwrap();
            assert!(matches!(slot, Slot::Done { .. }));
            let cycle = master.cycle();
            assert_eq!(cycle.fault(), None, "{what}");
            assert_eq!(cycle.head().map(|head| head.cds), config.cds, "{what}");
            // The same slave, clocked by hand at the moment of this frame's LAT.
            let lat = master.trace().t_ns + clock.period_ns() / 2;
            let words = latched_at(config.clone(), lat);
            for ((word, want), channel) in cycle
                .words()
                .iter()
                .zip(&words)
                .zip(config.format.channels())
            {
                let life = channel.find(|k| *k == biss::format::Kind::Life);
                let blank = |data: u64| life.map_or(data, |field| field.set(data, 0));
                match word.good() {
                    Some(data) => {
                        good += 1;
                        assert_eq!(blank(data), blank(*want), "{what}");
                    }
                    // What the slave calls its position in two widths may make no pair.
                    None => assert!(
                        matches!(word.fault(), Some(Fault::Null | Fault::Pair { .. })),
                        "{what}"
                    ),
                }
            }
        }
    }
    assert!(good > rounds * 3, "{good} good words");
}

fn latched_at(config: Config, lat_ns: u64) -> Vec<u64> {
    let mut slave = Slave::new(config);
    slave.ma(lat_ns - 1, false);
    slave.ma(lat_ns, true);
    slave.latched().to_vec()
}

/// Up to which length, data and CRC together, all 1- and 2-bit errors are found: computed from the order of the
/// polynomials; a channel has 64 data bits at most.
#[test]
fn every_one_and_two_bit_error_is_a_fault() {
    let mut rng = rng();
    for (crc, most) in [
        ("crc3", 7),
        ("crc4", 15),
        ("crc5", 31),
        ("crc6", 63),
        ("crc7", 71),
        ("crc8", 72),
        ("crc16", 80),
    ] {
        let crc_bits: u8 = crc[3..].parse().unwrap();
        let data_bits = most - crc_bits;
        let format: Format = format!("pos{data_bits},{crc}").parse().unwrap();
        let protocol = BissC::new(format.clone());
        let data = common::word(&mut rng, data_bits);
        let mut clean = Trace::default();
        emit(
            &format,
            Head {
                delay_clk: 0,
                ack: 1,
                cds: false,
            },
            &[data],
            &mut clean.bits,
        );
        let bits: Vec<bool> = clean.bits.iter().collect();
        let (first, last) = (4, 4 + usize::from(most));
        let mut checked = 0;
        for a in first..last {
            for b in a..last {
                let mut trace = Trace::default();
                trace.bits.extend(
                    bits.iter()
                        .enumerate()
                        .map(|(i, bit)| bit ^ (i == a || i == b)),
                );
                let mut cycle = Cycle::default();
                protocol.decode(&trace, &mut cycle);
                assert!(
                    cycle.words().iter().all(|word| word.good().is_none()),
                    "{crc}: bits {a} and {b} of {data:#x}"
                );
                checked += 1;
            }
        }
        assert_eq!(checked, usize::from(most) * (usize::from(most) + 1) / 2);
    }
}

#[test]
fn no_input_panics_and_what_is_good_has_a_good_crc() {
    let mut rng = rng();
    let mut good = 0;
    for _ in 0..size(100_000) {
        let text = common::channel(&mut rng);
        let format: Format = text.parse().unwrap();
        let mut trace = Trace {
            idle: *rng.choice(&[None, Some(false), Some(true)]).unwrap(),
            ma_period_ns: *rng
                .choice(&[None, Some(0), Some(1), Some(1000), Some(u32::MAX)])
                .unwrap(),
            reference_ns: rng.bool().then(|| rng.u32(..)),
            cut: *rng
                .choice(&[None, None, None, Some(Cut::Begin), Some(Cut::End)])
                .unwrap(),
            ..Trace::default()
        };
        if rng.bool() {
            trace.level(rng.u64(..), rng.u16(..));
        }
        let density = rng.u8(..9);
        trace
            .bits
            .extend((0..rng.usize(..200)).map(|_| rng.u8(..8) < density));
        let mut cycle = Cycle::default();
        BissC::new(format.clone()).decode(&trace, &mut cycle);
        assert!(cycle.fault().is_none() || cycle.words().is_empty());
        for (word, channel) in cycle.words().iter().zip(format.channels()) {
            if let Some(data) = word.good() {
                good += 1;
                let want = channel
                    .crc()
                    .map_or(0, |crc| crc.of(data, channel.data_bits()));
                assert_eq!(word.raw(), (data, want));
            }
        }
    }
    println!("{good} good by chance");
}

/// Every fault, with its numbers, from a frame that has it.
#[test]
fn every_fault_has_its_numbers() {
    let format = "st8,nE,nW,crc6";
    let good = "1010000000011111010";
    let decode = |slo: &str, change: &dyn Fn(&mut Trace)| {
        let mut trace = Trace {
            idle: Some(true),
            ma_period_ns: Some(1000),
            ..Trace::default()
        };
        trace.bits.extend(slo.bytes().map(|bit| bit == b'1'));
        change(&mut trace);
        let mut cycle = Cycle::default();
        BissC::new(format.parse().unwrap()).decode(&trace, &mut cycle);
        cycle.fault().or_else(|| cycle.words()[0].fault())
    };
    let plain = |slo: &str| decode(slo, &|_| ());
    let frame = {
        let mut bits = biss::trace::Bits::default();
        let head = Head {
            delay_clk: 0,
            ack: 1,
            cds: false,
        };
        emit(&format.parse().unwrap(), head, &[0b11], &mut bits);
        bits.iter()
            .map(|bit| if bit { '1' } else { '0' })
            .collect::<String>()
    };
    assert_ne!(frame, good);
    assert_eq!(plain(&frame), None);
    let waited = |t: &mut Trace| {
        t.idle = Some(false);
        t.waited_ns = Some(80_000);
        t.bits.clear();
    };
    assert_eq!(
        decode("", &waited),
        Some(Fault::NotReady {
            waited_ns: Some(80_000)
        })
    );
    assert_eq!(
        plain(&frame.replacen('1', "0", 1)),
        Some(Fault::NotReady { waited_ns: None })
    );
    assert_eq!(plain(&"1".repeat(60)), Some(Fault::NoAck { clocks: 58 }));
    assert_eq!(
        plain(&format!("{}{}", "1".repeat(45), &frame[1..])),
        Some(Fault::NoAck { clocks: 40 }),
        "beyond the limit"
    );
    assert_eq!(
        plain(&format!("1{}", "0".repeat(50))),
        Some(Fault::NoStart { clocks: 49 })
    );
    assert_eq!(
        plain(&format!("1{}{}", "0".repeat(45), &frame[2..])),
        Some(Fault::NoStart { clocks: 40 })
    );
    let have_bits = frame.len() as u16 - 1;
    assert_eq!(
        plain(&frame[..frame.len() - 1]),
        Some(Fault::Short {
            have_bits,
            want_bits: have_bits + 1
        })
    );
    assert_eq!(
        plain("111"),
        Some(Fault::Short {
            have_bits: 3,
            want_bits: 21
        })
    );
    assert!(matches!(
        decode(&frame, &|t| t.cut = Some(Cut::Begin)),
        Some(Fault::Short { .. })
    ));
    let stop = frame.len();
    assert_eq!(
        plain(&format!("{}1", &frame[..stop - 1])),
        Some(Fault::Stop { clock: stop as u16 })
    );
    assert_eq!(
        plain(&format!("{frame}01")),
        Some(Fault::Stop {
            clock: stop as u16 + 2
        })
    );
    let flipped = format!(
        "{}{}{}",
        &frame[..19],
        if &frame[19..20] == "1" { "0" } else { "1" },
        &frame[20..]
    );
    assert!(
        matches!(plain(&flipped), Some(Fault::Crc { got, want }) if got ^ want == 1),
        "{:?}",
        plain(&flipped)
    );
    assert_eq!(
        plain(&format!("1010{}1111110", "0".repeat(10))),
        Some(Fault::Null)
    );
    for (level, reference, stalled) in [
        (1_999, 2_000, None),
        (2_001, 9_000, Some(2_000)),
        (1_600, 1_500, Some(1_500)),
        (50_000, 90_000, Some(2_000)),
    ] {
        let change = |t: &mut Trace| {
            t.level(level, 7);
            t.reference_ns = Some(reference);
        };
        let want = stalled.map(|limit_ns| Fault::Stalled {
            level_ns: level as u32,
            limit_ns,
            edge: 7,
        });
        assert_eq!(decode(&frame, &change), want);
    }
}

/// One CDM bit a timeout, chosen by the CDS of this very frame; the edge that releases MA is no clock, so the frames
/// after it are good.
#[test]
fn cdm_goes_out_as_the_cds_of_the_same_frame_says() {
    use biss::link::Phase::{Half, Quarter, ThreeQuarters, Whole};
    for (timeout, cds, phase) in [
        ("20us", false, Whole),
        ("20us", true, ThreeQuarters),
        ("adaptive", false, Half),
        ("adaptive", true, Quarter),
        ("request", true, Whole),
    ] {
        let config = format!(
            "timeout={timeout},cds={},motion=count,pos=9,frame=st8,crc6",
            u8::from(cds)
        );
        let mut link = sim::open(config.parse().unwrap());
        link.set_clock(Hertz(1_000_000)).unwrap();
        link.set_phase(phase).unwrap();
        let protocol = BissC::new("st8,crc6".parse().unwrap());
        let ability = Ability {
            reacts: true,
            period_ns: 1000,
            head: None,
            delay_clk: None,
            widen: 0,
        };
        let (mut trace, mut cycle) = (Trace::default(), Cycle::default());
        for (frame, table) in [
            [false, true],
            [true, false],
            [true, true],
            [false, false],
            [true, true],
        ]
        .into_iter()
        .enumerate()
        {
            let ask = Ask {
                at_ns: 0,
                clocks: Clocks {
                    cdm: table,
                    ..protocol.request(&ability)
                },
            };
            assert_eq!(
                link.cycles(&[ask], std::slice::from_mut(&mut trace))
                    .unwrap(),
                1
            );
            protocol.decode(&trace, &mut cycle);
            assert_eq!(
                cycle.words()[0].good(),
                Some(9 + frame as u64),
                "{timeout}: {:?}",
                cycle.fault()
            );
            let sent = table[usize::from(cds)];
            assert_eq!(trace.cdm, Some(sent));
            assert_eq!(trace.ready_ns.is_some(), sent, "MA is held until SL = 1");
            link.idle(100_000).unwrap();
            assert_eq!(
                link.pins_mut().slave_mut().take_cdm(),
                Some(sent),
                "{timeout}, frame {frame}"
            );
        }
    }
}

/// The first levels are stretched for slaves known to be adaptive, and never while bits may be under way for longer
/// than a clock.
#[test]
fn only_adaptive_slaves_without_delay_get_a_stretched_head() {
    use biss::frame::Stall;
    for stall in [
        Stall::Unknown,
        Stall::Static { min_ns: 12_000 },
        Stall::Adaptive,
    ] {
        for reacts in [false, true] {
            for delay_clk in [None, Some(0), Some(1)] {
                let mut protocol = BissC::new("st8,crc6".parse().unwrap());
                protocol.stall = stall;
                let ability = Ability {
                    reacts,
                    period_ns: 4000,
                    head: None,
                    delay_clk,
                    widen: 0,
                };
                let stretched = protocol.request(&ability).stretch_ns;
                let wanted = stall == Stall::Adaptive && reacts && delay_clk == Some(0);
                assert_eq!(stretched > 0, wanted, "{stall:?} {ability:?}");
                assert!(stretched <= 12_000, "in sum below every static ceiling");
            }
        }
    }
}
