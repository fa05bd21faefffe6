//! Several channels in one frame: each stands for itself, but for the two of a safety pair.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;

use biss::Format;
use biss::cycle::{Cycle, Fault, Head, Word};
use biss::frame::{BissC, emit};
use biss::link::{Caps, Clock, Error, Known, Link};
use biss::master::{Master, Slot};
use biss::protocol::Protocol;
use biss::trace::{Ask, Cut, Trace, Until};
use biss::track::{Tracker, Verdict};
use biss::unit::Hertz;
use common::{json, rng, run, size};
use std::collections::BTreeSet;
use std::path::Path;

const HEAD: Head = Head {
    delay_clk: 0,
    ack: 1,
    cds: false,
};
const PAIR: &str = "mt12,st24,nE,nW,crc6+mt12,st16,nE,nW,lc6,crc16";

fn format(text: &str) -> Format {
    text.parse().unwrap_or_else(|e| panic!("{e}"))
}

fn trace(format: &Format, data: &[u64]) -> Trace {
    let mut trace = Trace {
        idle: Some(true),
        ma_period_ns: Some(1000),
        ..Trace::default()
    };
    emit(format, HEAD, data, &mut trace.bits);
    trace
}

fn flip(trace: &mut Trace, flipped: &BTreeSet<usize>) {
    let bits: Vec<bool> = trace.bits.iter().collect();
    trace.bits.clear();
    let wrong = |(at, bit): (usize, bool)| bit ^ flipped.contains(&at);
    trace.bits.extend(bits.into_iter().enumerate().map(wrong));
}

/// As a master does it: decoded, then judged. One frame only, so that nothing was learned before.
fn judged(format: &Format, trace: &Trace) -> (Verdict, Cycle) {
    let mut cycle = Cycle::default();
    BissC::new(format.clone()).decode(trace, &mut cycle);
    let verdict = Tracker::trusting().judge(format, trace, &mut cycle);
    (verdict, cycle)
}

fn faults(cycle: &Cycle) -> Vec<Option<Fault>> {
    cycle.words().iter().map(Word::fault).collect()
}

/// A word of a channel: turns, position, and no error or warning.
fn word(format: &Format, channel: usize, turn: u64, position: u64) -> u64 {
    use biss::format::Kind;
    let fields = format.channels()[channel].fields();
    fields.iter().fold(0, |data, field| match field.kind() {
        Kind::Turn => field.set(data, turn),
        Kind::SingleTurn | Kind::Position => field.set(data, position),
        Kind::Error { active_low } | Kind::Warning { active_low } => {
            field.set(data, u64::from(*active_low))
        }
        _ => data,
    })
}

/// What two positions of a pair come to.
fn pair_of(text: &str, first: (u64, u64), second: (u64, u64)) -> Vec<Option<Fault>> {
    let format = format(text);
    let data = [
        word(&format, 0, first.0, first.1),
        word(&format, 1, second.0, second.1),
    ];
    let (verdict, cycle) = judged(&format, &trace(&format, &data));
    assert_eq!(verdict, Verdict::Stands);
    faults(&cycle)
}

fn agree(text: &str, first: (u64, u64), second: (u64, u64)) -> bool {
    let faults = pair_of(text, first, second);
    assert_eq!(faults[0], faults[1], "both words or none");
    assert!(faults[0].is_none() || matches!(faults[0], Some(Fault::Pair { .. })));
    faults[0].is_none()
}

/// However many bits of one channel are wrong, the others are what was sent.
#[test]
fn one_bad_channel_does_not_hide_the_others() {
    let mut rng = rng();
    let (mut bad, mut hidden) = (0, 0);
    for _ in 0..size(10_000) {
        let format = format(&common::format(&mut rng));
        let channels = format.channels();
        let data: Vec<u64> = channels
            .iter()
            .map(|c| common::word(&mut rng, c.data_bits()))
            .collect();
        let widths: Vec<usize> = channels
            .iter()
            .map(|c| usize::from(c.data_bits() + c.crc_bits()))
            .collect();
        let spoiled = rng.usize(..channels.len());
        let begin = 4 + widths[..spoiled].iter().sum::<usize>();
        let flipped: BTreeSet<usize> = (0..rng.usize(1..=8))
            .map(|_| begin + rng.usize(..widths[spoiled]))
            .collect();
        let mut trace = trace(&format, &data);
        flip(&mut trace, &flipped);
        let mut cycle = Cycle::default();
        BissC::new(format.clone()).decode(&trace, &mut cycle);
        assert_eq!((cycle.fault(), cycle.head()), (None, Some(HEAD)));
        assert_eq!(cycle.words().len(), channels.len());
        for (index, (word, channel)) in cycle.words().iter().zip(channels).enumerate() {
            if index == spoiled {
                bad += usize::from(word.good().is_none());
                continue;
            }
            let null = data[index] == 0 && channel.has_null();
            assert_eq!(word.good(), (!null).then_some(data[index]), "{format}");
            assert_eq!(word.fault(), null.then_some(Fault::Null), "{format}");
            hidden += usize::from(cycle.words()[spoiled].good().is_none());
        }
    }
    assert!(bad > 0 && hidden > bad, "{bad} bad channels");
}

/// Two sensors that differ by less than a step of ACCmin agree, two steps apart they do not, in every width and at every
/// border: of a turn, and of all turns.
#[test]
fn a_pair_agrees_within_one_step() {
    let mut rng = rng();
    let (mut same, mut other) = (0, 0);
    for _ in 0..size(20_000) {
        let (cpw_turns, spw_turns) = (rng.u32(0..=24), rng.u32(0..=24));
        let (cpw_bits, spw_bits) = (rng.u32(8..=32), rng.u32(8..=32));
        let acc_bits = if cpw_bits == spw_bits {
            cpw_bits - 5
        } else {
            cpw_bits.min(spw_bits) - 3
        };
        let channel = |turns: u32, bits: u32| match turns {
            0 => format!("st{bits},nE,nW"),
            turns => format!("mt{turns},st{bits},nE,nW"),
        };
        let (cpw, spw) = (channel(cpw_turns, cpw_bits), channel(spw_turns, spw_bits));
        let spw_first = rng.bool();
        let text = if spw_first {
            format!("{spw},lc6,crc16+{cpw},crc6")
        } else {
            format!("{cpw},crc6+{spw},lc6,crc16")
        };
        // The angle in 2^-40 of a turn, near a border half of the time.
        const TURN: i128 = 1 << 40;
        let step = TURN >> acc_bits;
        let range = TURN << cpw_turns.min(spw_turns);
        let angle = match rng.u8(..4) {
            0 => i128::from(rng.u64(..)) % TURN * i128::from(rng.u32(..1 << 24)),
            1 => i128::from(rng.u32(..1 << 24)) * TURN,
            2 => range,
            _ => 0,
        } + i128::from(rng.i64(-4..=4)) * step / 2;
        let near = rng.bool();
        let apart = if near {
            i128::from(rng.u64(..)) % step
        } else {
            2 * step + i128::from(rng.u64(..)) % (range - 4 * step + 1).max(1)
        };
        if !near && 4 * step > range {
            continue;
        }
        let apart = if near && rng.bool() { -apart } else { apart };
        let shown = |angle: i128, bits: u32| {
            let turn = angle.div_euclid(TURN) as u64;
            (turn, (angle.rem_euclid(TURN) >> (40 - bits)) as u64)
        };
        let (cpw, spw) = (shown(angle, cpw_bits), shown(angle + apart, spw_bits));
        let (first, second) = if spw_first { (spw, cpw) } else { (cpw, spw) };
        assert_eq!(
            agree(&text, first, second),
            near,
            "{text}: {first:?} {second:?}, {apart} of {step}"
        );
        same += usize::from(near);
        other += usize::from(!near);
    }
    assert!(same > 0 && other > 0, "{same} {other}");
}

/// BiSS Safety Concept A5, table 1: turns and position of CPW and SPW, ACCmin; and RESOLUTE FS, whose lengths are those of
/// RSH, RSM and LMM, turns and position in one (installation guide, p. 3).
#[test]
fn the_table_of_the_safety_concept() {
    for (cpw, spw, acc_bits) in [
        ("st16", "st12", 9),
        ("st24", "st16", 13),
        ("mt12,st16", "mt12,st12", 9),
        ("mt12,st24", "mt12,st16", 13),
        ("mt24,st16", "mt24,st12", 9),
        ("mt24,st24", "mt24,st16", 13),
        ("mt12,st16", "st12", 9),
        ("mt12,st24", "st16", 13),
        ("mt16,pos16", "mt16,pos16", 11),
        ("pos36", "pos28", 12 + 13),
        ("pos28", "pos24", 12 + 9),
        ("pos32", "pos32", 16 + 11),
        ("st32", "st32", 16 + 11),
        // Not in it.
        ("st12", "st14", 9),
        ("st4", "st3", 1),
        ("mt2,st1", "mt2,st1", 1),
    ] {
        let text = format!("{cpw},nE,nW,crc6+{spw},nE,nW,lc6,crc16");
        let top = |channel: usize| {
            let format = format(&text);
            1 << (format.channels()[channel].position().unwrap().bits() - 1)
        };
        let far = pair_of(&text, (0, top(0)), (2, 0));
        let seen = far[0].map(|fault| fault.numbers().last());
        if acc_bits > 1 || cpw.starts_with("mt") && spw.starts_with("mt") {
            assert_eq!(seen, Some(Some(("acc_bits", acc_bits))), "{text}");
        } else {
            assert_eq!(seen, None, "{text}: half a turn is as exact as it gets");
        }
    }
}

#[test]
fn a_disagreement_shows_both_positions() {
    let fault = Fault::Pair {
        cpw: 2 << 13 | 5,
        spw: 2 << 13 | 7,
        acc_bits: 13,
    };
    for (text, swap) in [
        (PAIR, false),
        (
            "mt12,st16,nE,nW,lc6,crc16+mt12,st24,nE,nW,crc6:0x43:init=5",
            true,
        ),
    ] {
        let (cpw, spw) = ((2, 5 << 11 | 99), (2, 7 << 3));
        let (first, second) = if swap { (spw, cpw) } else { (cpw, spw) };
        assert_eq!(pair_of(text, first, second), [Some(fault); 2]);
    }
    assert_eq!(fault.name(), "mismatch");
    assert_eq!(
        fault.to_string(),
        "mismatch: CPW at 16389, SPW at 16391, compared to 13 bits"
    );
    let numbers: Vec<_> = fault.numbers().collect();
    assert_eq!(numbers, [("cpw", 16389), ("spw", 16391), ("acc_bits", 13)]);
}

#[test]
fn the_border_of_a_turn_is_no_border() {
    let last = ((1 << 24) - 1, (1 << 16) - 1);
    assert!(agree(PAIR, (4, last.0), (5, 0)));
    assert!(agree(PAIR, (5, 0), (4, last.1)));
    assert!(agree(PAIR, (4095, last.0), (0, 0)), "all turns are over");
    assert!(agree(PAIR, (0, 0), (4095, last.1)));
    assert!(!agree(PAIR, (4, last.0), (4, 0)), "a turn apart");
    assert!(!agree(PAIR, (4, last.0), (6, 0)));
    assert!(!agree(PAIR, (4, 1 << 20), (5, 1 << 12)), "a turn apart");
    // Only the turns that both show.
    let few = "mt12,st24,nE,nW,crc6+mt4,st16,nE,nW,lc6,crc16";
    assert!(agree(few, (0x125, 0), (5, 0)) && agree(few, (0x12F, last.0), (0, 0)));
    assert!(!agree(few, (0x125, 0), (6, 0)));
    let none = "mt12,st24,nE,nW,crc6+st16,nE,nW,lc6,crc16";
    assert!(agree(none, (0x125, last.0), (0, 0)));
    // A length has two ends, unless its upper bits are cut.
    let length = "pos24,nE,nW,crc6+pos16,nE,nW,lc6,crc16";
    assert!(agree(length, (0, 5 << 11), (0, 6 << 3)));
    assert!(!agree(length, (0, last.0), (0, 0)));
    assert!(!agree(
        &length.replace("pos", "mt2,pos"),
        (3, last.0),
        (0, 0)
    ));
    assert!(agree(
        &length.replace("pos24", "mt2,pos24"),
        (3, last.0),
        (0, 0)
    ));
}

/// A CPW beside an SPW, and nothing else.
#[test]
fn what_is_a_pair() {
    let far = |text: &str| {
        let format = format(text);
        let data: Vec<u64> = (0..format.channels().len())
            .map(|channel| {
                let position = format.channels()[channel].position();
                let quarter = 1u64 << position.map_or(0, |field| field.bits() - 2);
                word(&format, channel, 0, quarter * (channel as u64 % 4))
            })
            .collect();
        let (_, cycle) = judged(&format, &trace(&format, &data));
        let letters = faults(&cycle).into_iter().map(|fault| match fault {
            Some(Fault::Pair { .. }) => 'x',
            None => '.',
            other => panic!("{other:?}"),
        });
        letters.collect::<String>()
    };
    let (c, s) = ("st16,nE,nW,crc6", "st12,nE,nW,lc6,crc16");
    let t = "data8=temp,crc5";
    for (chain, pairs) in [
        ([c, s].as_slice(), "xx"),
        (&[s, c], "xx"),
        (&[c, t, s], "..."),
        (&[c, s, t], "xx."),
        (&[t, c, s], ".xx"),
        (&[c, c, s], ".xx"),
        (&[c, s, s], "xx."),
        (&[c, s, c], "xx."),
        (&[c, s, c, s], "xxxx"),
        (&[s, c, s, c], "xxxx"),
        (&[c, s, t, s, c, t, c, s], "xx.xx.xx"),
        (&[c, c], ".."),
        (&[s, s], ".."),
    ] {
        assert_eq!(far(&chain.join("+")), pairs, "{chain:?}");
    }
    for (cpw, spw, pairs) in [
        ("st16,nW,crc8", "lc4,st12,crc16:0x11021", "xx"),
        ("data3=hall,st16,nE,crc16", s, "xx"),
        ("st16,nE,nW", s, ".."),
        ("st16,E,W,crc6", s, ".."),
        ("st16,crc6", s, ".."),
        ("data16=raw,nE,nW,crc6", s, ".."),
        ("pos16,nE,nW,crc6", s, ".."),
        ("st16,nE,nW,lc4,crc6", s, ".."),
        (c, "st12,nE,nW,crc16", ".."),
        (c, "st12,nE,nW,lc6,crc8", ".."),
        (c, "data12=raw,nE,nW,lc6,crc16", ".."),
    ] {
        assert_eq!(far(&format!("{cpw}+{spw}")), pairs, "{cpw} {spw}");
    }
}

/// What is bad already is compared with nothing, and neither is what the encoder itself does not stand for.
#[test]
fn a_good_word_beside_a_bad_one_stands_alone() {
    let format = format(PAIR);
    let (cpw, spw) = (word(&format, 0, 1, 1 << 20), word(&format, 1, 9, 3 << 12));
    let seen = |data: [u64; 2], flipped: &[usize]| {
        let mut trace = trace(&format, &data);
        flip(&mut trace, &flipped.iter().copied().collect());
        let (_, cycle) = judged(&format, &trace);
        let name = |word: &Word| word.fault().map_or("ok", |fault| fault.name());
        cycle.words().iter().map(name).collect::<Vec<_>>().join(" ")
    };
    assert_eq!(seen([cpw, spw], &[]), "mismatch mismatch");
    assert_eq!(seen([cpw, spw], &[10]), "crc ok");
    assert_eq!(seen([cpw, spw], &[60]), "ok crc");
    assert_eq!(seen([0, spw], &[]), "null ok");
    assert_eq!(seen([cpw, 0], &[]), "ok null");
    assert_eq!(seen([cpw & !2, spw], &[]), "ok ok", "nE of the CPW");
    assert_eq!(seen([cpw, spw & !(2 << 6)], &[]), "ok ok", "nE of the SPW");
    assert_eq!(seen([cpw & !1, spw], &[]), "mismatch mismatch", "nW only");
}

/// The sign of life is looked at first: an SPW that repeats itself is no witness.
#[test]
fn a_repeated_safety_word_is_a_life_that_stopped() {
    let format = format(PAIR);
    let mut tracker = Tracker::trusting();
    let mut seen = |turn: u64, spw_turn: u64, life: u64| {
        let data = [
            word(&format, 0, turn, 0),
            word(&format, 1, spw_turn, 0) | life,
        ];
        let trace = trace(&format, &data);
        let mut cycle = Cycle::default();
        BissC::new(format.clone()).decode(&trace, &mut cycle);
        assert_eq!(
            tracker.judge(&format, &trace, &mut cycle),
            Verdict::Stands,
            "no other start bit, no other line"
        );
        let name = |word: &Word| word.fault().map_or("ok", |fault| fault.name());
        cycle.words().iter().map(name).collect::<Vec<_>>().join(" ")
    };
    assert_eq!(seen(1, 1, 7), "ok ok");
    assert_eq!(seen(2, 1, 7), "ok lc");
    assert_eq!(seen(3, 1, 8), "mismatch mismatch");
    assert_eq!(seen(4, 4, 9), "ok ok", "what differed has counted too");
}

/// A live link that shows what it is told, frame by frame.
struct Told {
    format: Format,
    /// The words of cycle 0, 1, 2 and so on.
    words: fn(&Format, u64) -> Vec<u64>,
    /// Every cycle that the slave latched, whoever asked for it.
    latched: u64,
    /// Looks at SL at rest that show 0.
    low: u32,
    rests: u64,
    now_ns: u64,
}

impl Told {
    fn new(text: &str, words: fn(&Format, u64) -> Vec<u64>) -> Told {
        Told {
            format: format(text),
            words,
            latched: 0,
            low: 0,
            rests: 0,
            now_ns: 0,
        }
    }
}

impl Link for Told {
    fn caps(&self) -> Caps {
        Caps {
            live: true,
            reacts: true,
            cdm: true,
            sees_idle: true,
            times_levels: true,
            phases: &[],
            virtual_time: true,
            burst: 1,
        }
    }
    fn now_ns(&self) -> u64 {
        self.now_ns
    }
    fn clock(&self) -> Clock {
        Clock {
            hz: Hertz(1_000_000),
            known: Known::Measured,
        }
    }
    fn set_clock(&mut self, _: Hertz) -> Result<Clock, Error> {
        Ok(self.clock())
    }
    fn measure_clock(&mut self) -> Result<Clock, Error> {
        self.latched += 5;
        Ok(self.clock())
    }
    fn idle(&mut self, ns: u64) -> Result<Option<bool>, Error> {
        self.now_ns += ns;
        self.rests += 1;
        let low = self.low > 0;
        self.low -= u32::from(low);
        Ok(Some(!low))
    }
    fn cycles(&mut self, asks: &[Ask], out: &mut [Trace]) -> Result<usize, Error> {
        for (ask, out) in asks.iter().zip(out) {
            let words = (self.words)(&self.format, self.latched);
            *out = trace(&self.format, &words);
            out.t_ns = self.now_ns;
            if let Until::Clocks(clocks) = ask.clocks.until {
                let bits: Vec<bool> = out.bits.iter().take(clocks.into()).collect();
                out.bits.clear();
                out.bits.extend(bits);
            }
            self.latched += 1;
            self.now_ns += 100_000;
        }
        Ok(asks.len())
    }
}

const LIFE: &str = "st8,nE,nW,lc6,crc16";

fn counting(format: &Format, latched: u64) -> Vec<u64> {
    vec![word(format, 0, 0, 5) | latched & 0x3F]
}

/// Frames that only measure the clock are latched by the slave as well: they must not look like frames that were lost.
#[test]
fn frames_that_nobody_judged_are_no_fault_of_the_count() {
    let mut link = Told::new(LIFE, counting);
    let protocol = BissC::new(format(LIFE));
    let mut master = Master::new(&mut link, &protocol, Some(0));
    assert!(master.open().unwrap());
    for _ in 0..3 {
        master.slot(0, None).unwrap();
        assert!(master.cycle().is_good(), "{:?}", master.cycle());
    }
}

/// A pause in which the slave is found not ready, and woken: INIT is latched too.
#[test]
fn init_begins_a_new_count() {
    struct Sleepy(Told);
    impl Link for Sleepy {
        fn caps(&self) -> Caps {
            self.0.caps()
        }
        fn now_ns(&self) -> u64 {
            self.0.now_ns
        }
        fn clock(&self) -> Clock {
            self.0.clock()
        }
        fn set_clock(&mut self, hz: Hertz) -> Result<Clock, Error> {
            self.0.set_clock(hz)
        }
        fn idle(&mut self, ns: u64) -> Result<Option<bool>, Error> {
            self.0.idle(ns)
        }
        fn cycles(&mut self, asks: &[Ask], out: &mut [Trace]) -> Result<usize, Error> {
            let init = asks[0].clocks.until == Until::Clocks(2);
            let ran = self.0.cycles(asks, out)?;
            if self.0.latched == 5 {
                // A bit of the CRC; from here on SL stays 0 until INIT.
                flip(&mut out[0], &BTreeSet::from([30]));
                self.0.low = 2;
            }
            assert!(!init || self.0.low == 0);
            Ok(ran)
        }
    }
    let mut link = Sleepy(Told::new(LIFE, counting));
    let protocol = BissC::new(format(LIFE));
    let mut master = Master::new(&mut link, &protocol, Some(0));
    assert!(master.open().unwrap());
    let mut seen = Vec::new();
    for _ in 0..6 {
        master.slot(0, None).unwrap();
        let cycle = master.cycle();
        seen.push(cycle.words()[0].fault().map_or("ok", |fault| fault.name()));
    }
    assert_eq!(seen, ["ok", "ok", "crc", "ok", "ok", "ok"]);
    assert_eq!(link.0.latched, 2 + 6 + 1, "INIT was run");
}

/// What differs is the encoder's: it is read again as often as was asked for, after a rest, and no other sampling phase
/// is looked for.
#[test]
fn a_disagreement_is_a_fault_like_others() {
    let words = |format: &Format, latched: u64| {
        let spw_turn = if latched % 4 == 3 { 2 } else { 1 };
        vec![
            word(format, 0, 1, 0),
            word(format, 1, spw_turn, 0) | latched & 0x3F,
        ]
    };
    let protocol = BissC::new(format(PAIR));
    for retries in [None, Some(1)] {
        let mut link = Told::new(PAIR, words);
        let mut master = Master::new(&mut link, &protocol, retries);
        assert!(master.open().unwrap());
        let mut tries = Vec::new();
        let mut bad = 0;
        for _ in 0..12 {
            let slot = master.slot(0, None).unwrap();
            let Slot::Done { tries: ran } = slot else {
                panic!("{slot:?}")
            };
            tries.push(ran);
            bad += usize::from(!master.cycle().is_good());
        }
        let again = tries.iter().filter(|tries| **tries > 1).count();
        assert_eq!(retries.is_some(), again >= 3, "{tries:?}");
        assert_eq!(retries.is_none(), bad >= 2, "{bad}");
        // One rest at the opening, one after the frame that needed a second, and one after each that differed.
        let differed = (7..link.latched - 1).filter(|latched| latched % 4 == 3);
        assert_eq!(link.rests, 2 + differed.count() as u64);
    }
    // All the time.
    let words = |format: &Format, latched: u64| {
        vec![
            word(format, 0, 1, 0),
            word(format, 1, 2, 0) | latched & 0x3F,
        ]
    };
    let mut link = Told::new(PAIR, words);
    let mut master = Master::new(&mut link, &protocol, None);
    assert!(
        master.open().unwrap(),
        "it answers, and well: it says two things"
    );
    let opened = 2 + 5;
    for _ in 0..10 {
        assert_eq!(master.slot(0, None).unwrap(), Slot::Done { tries: 1 });
        let fault = master.cycle().words()[0].fault();
        assert!(matches!(fault, Some(Fault::Pair { .. })), "{fault:?}");
    }
    assert_eq!(link.latched, opened + 10, "no frames for anything else");
}

/// A recording may lose its place: what was latched meanwhile nobody knows.
#[test]
fn a_piece_begins_a_new_count() {
    struct Recorded(Vec<Trace>);
    impl Link for Recorded {
        fn caps(&self) -> Caps {
            Caps {
                live: false,
                ..Told::new(LIFE, counting).caps()
            }
        }
        fn now_ns(&self) -> u64 {
            0
        }
        fn clock(&self) -> Clock {
            Told::new(LIFE, counting).clock()
        }
        fn set_clock(&mut self, _: Hertz) -> Result<Clock, Error> {
            Ok(self.clock())
        }
        fn idle(&mut self, _: u64) -> Result<Option<bool>, Error> {
            Ok(None)
        }
        fn cycles(&mut self, _: &[Ask], out: &mut [Trace]) -> Result<usize, Error> {
            match self.0.pop() {
                Some(trace) => {
                    out[0] = trace;
                    Ok(1)
                }
                None => Ok(0),
            }
        }
    }
    let format = format(LIFE);
    let frame = |life: u64| trace(&format, &counting(&format, life));
    let mut piece = frame(3);
    piece.cut = Some(Cut::Begin);
    let mut traces = vec![frame(1), frame(2), piece, frame(5), frame(6), frame(8)];
    traces.reverse();
    let mut link = Recorded(traces);
    let protocol = BissC::new(format.clone());
    let mut master = Master::new(&mut link, &protocol, None);
    let mut seen = Vec::new();
    loop {
        match master.slot(0, None).unwrap() {
            Slot::Done { .. } => {
                let cycle = master.cycle();
                seen.push(cycle.words()[0].fault().map_or("ok", |fault| fault.name()));
            }
            Slot::Piece(_) => seen.push("piece"),
            Slot::Ended => break,
        }
    }
    assert_eq!(seen, ["ok", "ok", "piece", "ok", "ok", "lc"]);
}

/// A counter that skips 0 loses one count a round, and frames that were missed count in it too.
#[test]
fn a_count_goes_on_over_missed_frames_and_rounds() {
    let mut rng = rng();
    for _ in 0..size(2_000) {
        let bits = rng.u32(2..=8);
        let format = format(&format!("st8,lc{bits},crc16"));
        let skips = rng.bool();
        let states = if skips { (1 << bits) - 1 } else { 1u64 << bits };
        let life = |n: u64| n % states + u64::from(skips);
        let mut tracker = Tracker::trusting();
        let mut judge = |life: u64, spoil: bool| {
            let mut trace = trace(&format, &[1 << bits | life]);
            if spoil {
                flip(&mut trace, &BTreeSet::from([5]));
            }
            let mut cycle = Cycle::default();
            BissC::new(format.clone()).decode(&trace, &mut cycle);
            tracker.judge(&format, &trace, &mut cycle);
            cycle.words()[0].fault()
        };
        let first = rng.u64(..1000);
        assert_eq!(judge(life(first), false), None);
        let missed = rng.u64(..2 * states);
        for n in 1..=missed {
            let fault = judge(life(first + n), true);
            assert!(matches!(fault, Some(Fault::Crc { .. })));
        }
        let next = first + missed + 1;
        assert_eq!(judge(life(next), false), None, "{format} {skips} {missed}");
        let repeated = judge(life(next), false);
        assert!(
            matches!(repeated, Some(Fault::Life { .. })),
            "{format} {skips}: {repeated:?}"
        );
        assert_eq!(judge(life(next + 1), false), None);
    }
}

/// One bit that would skip 0 would stand still.
#[test]
fn a_count_of_one_bit_alternates() {
    let format = format("st8,lc1,crc16");
    let mut tracker = Tracker::trusting();
    let mut judge = |life: u64| {
        let trace = trace(&format, &[1 << 1 | life]);
        let mut cycle = Cycle::default();
        BissC::new(format.clone()).decode(&trace, &mut cycle);
        tracker.judge(&format, &trace, &mut cycle);
        cycle.words()[0].fault()
    };
    assert_eq!([judge(1), judge(0), judge(1)], [None; 3]);
    assert_eq!(judge(1), Some(Fault::Life { got: 1, want: 0 }));
}

/// A recording of frames as a logic analyser makes it: 1 MHz, SLO 100 ns after the edge, a timeout of 20 µs.
fn recording(name: &str, frames: &[Trace]) -> String {
    let mut text = "$timescale 1 ns $end\n$scope module bench $end\n$var wire 1 ! MA $end\n\
                    $var wire 1 \" SLO $end\n$upscope $end\n$enddefinitions $end\n#0\n1!\n1\"\n"
        .to_owned();
    let mut t = 50_000;
    for frame in frames {
        for bit in frame.bits.iter() {
            let (rise, change) = (t + 500, t + 600);
            let bit = u8::from(bit);
            text.push_str(&format!("#{t}\n0!\n#{rise}\n1!\n#{change}\n{bit}\"\n"));
            t += 1000;
        }
        t += 20_000;
        text.push_str(&format!("#{t}\n1\"\n"));
        t += 50_000;
    }
    text.push_str(&format!("#{t}\n"));
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::write(&file, text).unwrap();
    format!("file:{}", file.display())
}

/// As typed: a pair that agrees, one that does not, and one with a bad word, with a channel that has nothing to do with it.
#[test]
fn a_pair_is_compared_in_recordings_too() {
    let chain = format!("data8=temp,crc5+{PAIR}");
    let format = format(&chain);
    let frame = |spw: u64, life: u64| {
        let pair = [
            word(&format, 1, 3, 77 << 11),
            word(&format, 2, 3, spw << 3) | life,
        ];
        trace(&format, &[40 + life, pair[0], pair[1]])
    };
    let mut noisy = frame(90, 4);
    flip(&mut noisy, &BTreeSet::from([40]));
    let frames = [
        frame(77, 1),
        frame(78, 2),
        frame(79, 3),
        noisy,
        frame(76, 5),
    ];
    let link = recording("pair.vcd", &frames);
    let (stdout, stderr, status) = run(&format!("read {link} -f {chain} -o json"));
    let seen: Vec<String> = json(&stdout)
        .iter()
        .map(|record| match &record["fault"] {
            serde_json::Value::Null => format!("{} {}", record["seq"], record["ch"]),
            fault => format!("{} {} {fault}", record["seq"], record["ch"]),
        })
        .collect();
    let mut want: Vec<String> = (0..5)
        .flat_map(|seq| (0..3).map(move |ch| format!("{seq} {ch}")))
        .collect();
    for (at, fault) in [(7, "mismatch"), (8, "mismatch"), (10, "crc")] {
        want[at].push_str(&format!(" \"{fault}\""));
    }
    assert_eq!(seen, want, "{stderr}");
    let (cpw, spw) = (3 << 13 | 77, 3 << 13 | 79);
    let differs =
        format!("\"ok\":false,\"fault\":\"mismatch\",\"cpw\":{cpw},\"spw\":{spw},\"acc_bits\":13,");
    assert_eq!(stdout.matches(&differs).count(), 2, "{stdout}");
    let summary: serde_json::Value = serde_json::from_str(stderr.trim()).unwrap();
    assert_eq!(summary["frames"], 5);
    assert_eq!(summary["good"], 3);
    assert_eq!(summary["faults"].to_string(), r#"{"crc":1,"mismatch":2}"#);
    assert_eq!(status, Some(1));
    // Lines of the good ones only.
    let (fields, _, status) = run(&format!("read {link} -f {chain} -F seq,ch,lc -q"));
    let good: Vec<&str> = fields.lines().map(|line| &line[..3]).collect();
    let want: Vec<String> = (want.iter())
        .filter(|line| !line.contains('"'))
        .map(|line| line.replace(' ', "\t"))
        .collect();
    assert_eq!(
        (good, status),
        (want.iter().map(String::as_str).collect(), Some(1))
    );
    let (csv, ..) = run(&format!("read {link} -f {chain} -o csv -q"));
    let detail = format!(",mismatch,cpw={cpw} spw={spw} acc_bits=13 first_clock=");
    assert_eq!(csv.matches(&detail).count(), 2, "{csv}");
    let (text, ..) = run(&format!("read {link} -f {chain} -q"));
    let told = format!("  ch 1  fault mismatch: CPW at {cpw}, SPW at {spw}, compared to 13 bits\n");
    assert_eq!(text.matches(&told).count(), 1, "{text}");
    // A name of one's own, where they are two encoders.
    let apart = chain.replace("mt12,st16", "mt12,data16=other");
    let (stdout, _, status) = run(&format!("read {link} -f {apart} -n 3 -o json -q"));
    assert_eq!((stdout.matches("fault").count(), status), (0, Some(0)));
}

/// As typed: noise on one channel or another, and what is good is what was sent.
#[test]
fn noise_in_a_chain_spoils_only_what_it_hits() {
    let chain = "st20,nE,nW,crc16+mt4,st12,crc16+pos9,data7=temp,E,crc16";
    let noise = format!("read sim:rpm=60000,flip=0.4%,seed=8,frame={chain} -n 300");
    let (stdout, stderr, status) = run(&format!("{noise} -o json"));
    assert_eq!(status, Some(1));
    let records = json(&stdout);
    let mut alone = 0;
    let mut faults = 0;
    let mut good_frames = 0;
    for seq in 0..300 {
        let frame: Vec<_> = records.iter().filter(|r| r["seq"] == seq).collect();
        if frame[0].get("ch").is_none() {
            assert_eq!(frame.len(), 1, "one record for the whole frame");
            faults += 1;
            continue;
        }
        assert_eq!(frame.len(), 3);
        let good: Vec<_> = frame.iter().filter(|r| r["ok"] == true).collect();
        let bad = frame.iter().filter(|r| r.get("fault").is_some()).count();
        assert_eq!(good.len() + bad, 3, "{frame:?}");
        faults += bad;
        good_frames += usize::from(bad == 0);
        alone += usize::from(bad == 1);
        for (ch, record) in frame.iter().enumerate() {
            assert_eq!(record["ch"], ch);
            assert_eq!(record["t_ns"], frame[0]["t_ns"]);
            assert_eq!(record.get("pos").is_some(), record["ok"] == true);
        }
        // Each shows the same angle, in its own width.
        let pos: BTreeSet<u64> = good
            .iter()
            .map(|record| {
                let finer = [20 - 9, 12 - 9, 0][record["ch"].as_u64().unwrap() as usize];
                record["pos"].as_u64().unwrap() >> finer
            })
            .collect();
        assert!(pos.len() <= 1, "{frame:?}");
    }
    assert!(alone > 50, "{alone} frames with one bad channel");
    let (why, summary) = stderr.trim().split_once('\n').unwrap();
    assert!(why.starts_with("biss: noise on the line"), "{why}");
    let summary: serde_json::Value = serde_json::from_str(summary).unwrap();
    let counted = summary["faults"].as_object().unwrap().values();
    let counted: u64 = counted.map(|count| count.as_u64().unwrap()).sum();
    assert_eq!(summary["good"], good_frames);
    assert_eq!(counted, faults as u64, "a fault a bad channel");
    // Fields: the lines of the good channels, whatever their neighbours are.
    let (fields, ..) = run(&format!("{noise} -q -F seq,ch,pos"));
    let want: Vec<String> = records
        .iter()
        .filter(|record| record["ok"] == true)
        .map(|r| format!("{}\t{}\t{}", r["seq"], r["ch"], r["pos"]))
        .collect();
    assert_eq!(fields.lines().collect::<Vec<_>>(), want);
    let (csv, ..) = run(&format!("{noise} -q -o csv"));
    let mut rows = csv.lines();
    assert_eq!(
        rows.next(),
        Some(
            "t_ns,seq,ch,ok,turn,pos,temp,deg,error,warning,fault,detail,tries,ack,delay_clk,cds,crc,scd"
        )
    );
    assert_eq!(rows.count(), records.len(), "a row a record");
}
