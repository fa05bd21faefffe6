//! What a link knows of its trace, and what a row of frames teaches.
#![allow(clippy::print_stdout, clippy::unwrap_used)]
use biss::cycle::{Cycle, Fault, Head};
use biss::frame::{BissC, emit};
use biss::link::{Link, sim};
use biss::protocol::{Ability, Protocol};
use biss::slave::Config;
use biss::trace::{Ask, Level, Trace, Until};
use biss::track::{Tracker, Verdict};
use biss::unit::Hertz;

fn frame_of(
    format: &str,
    ack: u16,
    data: &[u64],
    change: impl Fn(&mut Trace),
) -> (biss::Format, Cycle) {
    let format: biss::Format = format.parse().unwrap();
    let mut trace = Trace {
        idle: Some(true),
        ma_period_ns: Some(1000),
        ..Trace::default()
    };
    emit(
        &format,
        Head {
            delay_clk: 0,
            ack,
            cds: false,
        },
        data,
        &mut trace.bits,
    );
    change(&mut trace);
    let mut cycle = Cycle::default();
    BissC::new(format.clone()).decode(&trace, &mut cycle);
    (format, cycle)
}

fn flip(trace: &mut Trace, at: usize) {
    let bits: Vec<bool> = trace
        .bits
        .iter()
        .enumerate()
        .map(|(i, b)| b ^ (i == at))
        .collect();
    trace.bits.clear();
    trace.bits.extend(bits);
}

#[test]
fn what_a_link_knows_of_its_trace_is_checked() {
    let fault = |change: &dyn Fn(&mut Trace)| frame_of("st8,crc6", 1, &[5], change).1.fault();
    let have = 19;
    for surplus in 0..4 {
        let got = fault(&|t| {
            t.surplus = surplus;
            t.bits.extend([false; 2]);
        });
        let want = (surplus > 2).then_some(Fault::Short {
            have_bits: have + 2,
            want_bits: have + surplus,
        });
        assert_eq!(got, want, "{surplus} surplus clocks");
    }
    for (late, stalled) in [(0, false), (125, false), (126, true), (250, true)] {
        let got = fault(&|t| t.late = Some(Level { ns: late, edge: 9 }));
        let want = stalled.then_some(Fault::Stalled {
            level_ns: 1000 + late,
            limit_ns: 1125,
            edge: 9,
        });
        assert_eq!(got, want, "{late} ns late");
    }
    for (delay, none) in [(0, false), (40_000, false), (40_001, true)] {
        let got = fault(&|t| t.delay_ns = Some(delay));
        assert_eq!(
            got,
            none.then_some(Fault::NoAck { clocks: 40 }),
            "{delay} ns of line delay"
        );
    }
    assert_eq!(
        fault(&|t| t.misplaced_ns = Some(4_000)),
        Some(Fault::Stalled {
            level_ns: 4_000,
            limit_ns: 2_000,
            edge: 0
        })
    );
    let (_, cycle) = frame_of("st8,crc6", 40, &[5], |_| ());
    assert_eq!(cycle.fault(), None, "the busy limit itself is allowed");
}

#[test]
fn no_frame_with_a_bad_word_teaches_a_start_bit() {
    let pair = "st8,crc6+st8,crc6";
    let judge = |tracker: &mut Tracker, ack: u16, bad: bool| {
        let (format, mut cycle) = frame_of(pair, ack, &[1, 2], |t| {
            if bad {
                flip(t, t.bits.len() - 2)
            }
        });
        assert_eq!(cycle.words().iter().all(|w| w.good().is_some()), !bad);
        tracker.judge(&format, &Trace::default(), &mut cycle)
    };
    let doubtful = |v: Verdict| matches!(v, Verdict::Doubtful(_));
    // Once a range is known: never, however often it comes.
    let mut tracker = Tracker::default();
    judge(&mut tracker, 2, false);
    judge(&mut tracker, 2, false);
    for _ in 0..4 {
        assert!(doubtful(judge(&mut tracker, 6, true)));
    }
    assert!(
        doubtful(judge(&mut tracker, 6, false)),
        "the first sound one there"
    );
    assert_eq!(tracker.heads(), Some((2, 2)));
    // A recording trusts its first frame only if that is sound.
    let mut tracker = Tracker::trusting();
    assert!(doubtful(judge(&mut tracker, 6, true)));
    assert_eq!(tracker.heads(), None);
}

#[test]
fn the_range_grows_only_as_far_as_two_sightings_reach() {
    let heads = |acks: &[u16]| {
        let mut tracker = Tracker::default();
        for ack in acks {
            let (format, mut cycle) = frame_of("st8,crc6", *ack, &[1], |_| ());
            tracker.judge(&format, &Trace::default(), &mut cycle);
        }
        tracker.heads()
    };
    assert_eq!(heads(&[9, 9, 4, 3]), Some((4, 9)));
    assert_eq!(heads(&[9, 9, 3, 4]), Some((4, 9)));
    assert_eq!(heads(&[9, 9, 14, 15]), Some((9, 14)));
    assert_eq!(heads(&[9, 9, 15, 14]), Some((9, 14)));
    assert_eq!(heads(&[9, 10]), Some((9, 10)));
    assert_eq!(heads(&[9, 9, 4, 2]), Some((9, 9)), "too far apart");
    assert_eq!(heads(&[9, 11]), None);
}

#[test]
fn life_accepts_only_the_next_count_after_a_wrap() {
    let mut tracker = Tracker::trusting();
    let mut judge = |lc: u64| {
        let (format, mut cycle) = frame_of("st8,lc6,crc16", 1, &[1 << 6 | lc], |_| ());
        tracker.judge(&format, &Trace::default(), &mut cycle);
        cycle.words()[0].fault()
    };
    assert_eq!(judge(62), None);
    assert_eq!(judge(63), None);
    assert_eq!(judge(17), Some(Fault::Life { got: 17, want: 0 }));
}

/// A frame that failed as a whole may have been latched or not: the count begins anew.
#[test]
fn life_begins_anew_after_a_lost_cycle() {
    let mut tracker = Tracker::trusting();
    let mut judge = |lc: u64, lost: bool| {
        let (format, mut cycle) = frame_of("st8,lc6,crc16", 1, &[1 << 6 | lc], |t| {
            if lost {
                t.bits.clear()
            }
        });
        tracker.judge(&format, &Trace::default(), &mut cycle);
        cycle.words().first().and_then(|w| w.fault())
    };
    assert_eq!(judge(7, false), None);
    judge(0, true);
    assert_eq!(judge(12, false), None);
}

#[test]
fn only_a_frame_seen_to_its_end_makes_sl_high_mean_ready() {
    let config: Config = "timeout=20us,motion=count,pos=0,frame=st8,crc6"
        .parse()
        .unwrap();
    let mut link = sim::open(config);
    link.set_clock(Hertz(1_000_000)).unwrap();
    let protocol = BissC::new("st8,crc6".parse().unwrap());
    let ability = Ability {
        reacts: true,
        period_ns: 1000,
        head: None,
        delay_clk: None,
        widen: 0,
    };
    let (mut trace, mut cycle) = (Trace::default(), Cycle::default());
    let mut run = |link: &mut dyn Link, until: Option<u16>| {
        let mut clocks = protocol.request(&ability);
        if let Some(n) = until {
            clocks.until = Until::Clocks(n);
        }
        link.cycles(
            &[Ask { at_ns: 0, clocks }],
            std::slice::from_mut(&mut trace),
        )
        .unwrap();
        protocol.decode(&trace, &mut cycle);
        (trace.waited_ns.unwrap(), cycle.fault())
    };
    link.idle(100_000).unwrap();
    assert!(
        run(&mut link, None).0 >= 80_000,
        "nothing has been seen yet"
    );
    let (waited, fault) = run(&mut link, None);
    assert!(
        (19_000..22_000).contains(&waited) && fault.is_none(),
        "after a stop bit SL = 1 is enough: {waited} {fault:?}"
    );
    // Cut after the start bit: SL is CDS or data, 0 or 1.
    for cut in 3..7 {
        let (_, fault) = run(&mut link, Some(cut));
        assert!(fault.is_some());
        let (waited, fault) = run(&mut link, None);
        assert!(
            waited >= 80_000 && fault.is_none(),
            "{cut}: {waited} {fault:?}"
        );
    }
    // Asked for after a fault.
    run(&mut link, None);
    link.idle(1_000).unwrap();
    let (waited, _) = run(&mut link, None);
    assert!(waited >= 80_000, "{waited}");
}

#[test]
fn no_level_reaches_the_shortest_timeout() {
    for (level, period, stalled) in [
        (12_000, 10_000, false),
        (12_001, 10_000, true),
        (12_500, 10_000, true),
    ] {
        let (_, cycle) = frame_of("st8,crc6", 1, &[5], |t| {
            t.ma_period_ns = Some(period);
            t.level(level, 7);
        });
        assert_eq!(
            matches!(cycle.fault(), Some(Fault::Stalled { .. })),
            stalled,
            "{level}"
        );
    }
}
