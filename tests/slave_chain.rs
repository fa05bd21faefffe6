//! Chains of simulated slaves, seen from the wires of the one nearest the master.
#![allow(clippy::print_stdout, clippy::unwrap_used)]
mod common;
#[path = "common/wire.rs"]
mod wire;
use biss::Format;
use biss::slave::{Config, Event};
use fastrand::Rng;
use wire::{Wire, after_start, command, register};

/// `1:0:2`: the channels of a format, shared out among so many slaves.
fn shares(rng: &mut Rng, format: &str, slaves: usize) -> String {
    let mut counts = vec![0; slaves];
    for _ in format.split('+') {
        counts[rng.usize(..slaves)] += 1;
    }
    let counts: Vec<String> = counts.iter().map(usize::to_string).collect();
    counts.join(":")
}

/// Which clock brought the start bit, from 1.
fn start_of(seen: &str) -> usize {
    seen.len() - after_start(seen).len()
}

/// Every slave puts its channels before what it hears, and takes a clock.
#[test]
fn a_chain_is_one_slave_a_clock_later_for_each() {
    let mut rng = common::rng();
    for _ in 0..common::size(400) {
        let format = common::format(&mut rng);
        let slaves = rng.usize(1..=8);
        let timeout = *rng
            .choice(&["timeout=20us", "timeout=adaptive", "timeout=request"])
            .unwrap();
        let ack = rng.usize(1..6);
        let knobs = format!(
            "{timeout},ack={ack},rpm={},pos={},seed={},crc-error=20%,flip=1%,error=20%",
            rng.i32(-6000..6000),
            rng.u32(..),
            rng.u32(..)
        );
        let mut one = Wire::new(&format!("{knobs},frame={format}"));
        let shares = shares(&mut rng, &format, slaves);
        let mut chain = Wire::new(&format!("{knobs},slaves={shares},frame={format}"));
        assert_eq!(chain.slave.devices(), slaves);
        let clocks = chain.clocks + ack + rng.usize(..5);
        (one.clocks, chain.clocks) = (clocks, clocks);
        for _ in 0..3 {
            let (alone, seen) = (one.frame(false), chain.frame(false));
            let what = format!("{knobs},slaves={shares},frame={format}");
            assert_eq!(start_of(&alone), 2 + ack, "{what}");
            assert_eq!(start_of(&seen), 2 + ack + slaves - 1, "{what}");
            let after = after_start(&seen);
            assert_eq!(after, &after_start(&alone)[..after.len()], "{what}");
            assert_eq!(one.slave.latched(), chain.slave.latched());
        }
    }
}

/// Whoever is not ready holds the start bit back, and keeps what it hears meanwhile.
#[test]
fn busy_slaves_keep_what_they_hear() {
    let mut rng = common::rng();
    let mut late = 0;
    for _ in 0..common::size(200) {
        let format = common::format(&mut rng);
        let slaves = rng.usize(2..=8);
        let knobs = format!("rpm={},pos={}", rng.i32(-6000..6000), rng.u32(..));
        let mut one = Wire::new(&format!("{knobs},frame={format}"));
        let shares = shares(&mut rng, &format, slaves);
        let seed = rng.u32(..);
        let busy = format!("seed={seed},busy=0us..40us,slaves={shares}");
        let mut chain = Wire::new(&format!("{knobs},{busy},frame={format}"));
        let clocks = chain.clocks + 40;
        (one.clocks, chain.clocks) = (clocks, clocks);
        for _ in 0..3 {
            let (alone, seen) = (one.frame(false), chain.frame(false));
            let start = start_of(&seen);
            assert!((2 + slaves..=42 + slaves).contains(&start), "{start}");
            late += usize::from(start > 2 + slaves);
            let after = after_start(&seen);
            assert_eq!(
                after,
                &after_start(&alone)[..after.len()],
                "{knobs},{busy},frame={format}"
            );
        }
    }
    assert!(
        late > common::size(200),
        "{late} of {} were late",
        common::size(600)
    );
}

/// From the far end on, in every control frame anew; the ninth of a chain has none that could be said.
#[test]
fn ids_are_counted_from_the_far_end() {
    for slaves in 1..=12 {
        let shares = ["1"].into_iter().chain(vec!["0"; slaves - 1]);
        let shares: Vec<&str> = shares.collect();
        let mut wire = Wire::new(&format!("slaves={},frame=st4", shares.join(":")));
        wire.reset();
        let idl = wire.control(&format!("1{}", register(7, 0x44)));
        let ones = "1".repeat(slaves.min(9));
        assert_eq!(&idl[1..], format!("{ones:0<15}"), "{slaves} slaves");
        for id in 0..8 {
            let serial = (100_001 + u32::from(id)).to_be_bytes();
            let want = (usize::from(id) < slaves).then(|| (serial.to_vec(), false));
            assert_eq!(wire.read(id, 0x44, 4), want, "slave {id} of {slaves}");
        }
        // Without the farthest two everybody moves up.
        wire.reset();
        wire.control(&format!("1{}00000001", command(&[0, 1], 1)));
        let next = wire.read(0, 0x44, 4);
        let serial = 100_003u32.to_be_bytes().to_vec();
        assert_eq!(next, (slaves > 2).then_some((serial, false)));
        assert!(!wire.slave.control_active(1));
        assert_eq!(wire.slave.control_active(2), slaves > 2);
        wire.reset();
        wire.control(&format!("1{}1", command(&[], 1)));
        wire.reset();
        let again = wire.control(&format!("1{}", register(7, 0x44)));
        assert_eq!(again, idl);
    }
}

#[test]
fn who_is_meant_acknowledges_and_acts() {
    let mut rng = common::rng();
    for _ in 0..common::size(60) {
        let slaves = rng.usize(1..=8);
        let formats: Vec<String> = (0..slaves)
            .map(|_| format!("st{},nE,nW,crc6", rng.u8(1..=20)))
            .collect();
        let format = formats.join("+");
        let knobs = format!(
            "motion=still,pos={},slaves=each,frame={format}",
            rng.u16(..)
        );
        let mut wire = Wire::new(&knobs);
        wire.slave.record_events(true);
        wire.reset();
        wire.control(&format!("1{}1", command(&[], 0)));
        assert_eq!(wire.slave.take_events().len(), slaves);
        let whole = Wire::new(&knobs).frame(false);
        let meant: Vec<u8> = (0..8).filter(|_| rng.bool()).collect();
        let code = rng.u8(..4);
        if meant.is_empty() {
            continue;
        }
        wire.reset();
        let seen = wire.control(&format!("1{}00000001", command(&meant, code)));
        let acts: Vec<usize> = (0..slaves)
            .filter(|id| meant.contains(&(*id as u8)))
            .collect();
        let ida: String = (0..8)
            .map(|id| if acts.contains(&id) { '1' } else { '0' })
            .collect();
        assert_eq!(&seen[17..], ida, "{meant:?} of {slaves}");
        let done: Vec<Event> = acts
            .iter()
            .map(|id| Event::Command {
                id: *id,
                command: code,
                broadcast: false,
            })
            .collect();
        assert_eq!(wire.slave.take_events(), done);
        // Only who was switched on again sends data; the nearest, last in number, comes first.
        let mut want = String::from("0");
        let mut at = 1;
        let after = after_start(&whole);
        for (wire_place, format) in formats.iter().enumerate() {
            let bits = usize::from(format.parse::<Format>().unwrap().bits());
            let id = slaves - 1 - wire_place;
            assert_eq!(wire.slave.data_active(id), code == 0 && acts.contains(&id));
            if wire.slave.data_active(id) {
                want.push_str(&after[at..at + bits]);
            }
            at += bits;
        }
        let seen = wire.frame(false);
        assert_eq!(
            after_start(&seen).trim_end_matches('0'),
            want.trim_end_matches('0')
        );
        assert_eq!(
            wire.slave.control_active(0),
            !(code == 1 && acts.contains(&0))
        );
    }
}

/// An access reaches one slave, whatever the others hold.
#[test]
fn registers_are_each_slaves_own() {
    let mut rng = common::rng();
    for _ in 0..common::size(30) {
        let slaves = rng.usize(1..=8);
        let format = vec!["st4,crc3"; slaves].join("+");
        let seed = rng.u32(..);
        let mut wire = Wire::new(&format!(
            "seed={seed},slaves=each,reg-busy=0us..300us,frame={format}"
        ));
        let mut want = [[0; 64]; 8];
        for _ in 0..6 {
            let id = rng.usize(..slaves);
            let address = rng.u8(..0x40);
            let value = rng.u8(..);
            let done = wire.write(id as u8, address, &[value]);
            assert_eq!(done, Some((1, address == 0x3F)));
            want[id][usize::from(address)] = value;
            let id = rng.usize(..slaves);
            let address = rng.u8(..0x38);
            let (got, _) = wire.read(id as u8, address, 8).unwrap();
            assert_eq!(got, want[id][usize::from(address)..][..8]);
        }
        for (id, want) in want.iter().take(slaves).enumerate() {
            for (address, want) in want.iter().enumerate() {
                assert_eq!(wire.slave.peek(id, 0, address as u8), Some(*want));
            }
        }
        assert_eq!(wire.slave.peek(slaves, 0, 0), None);
    }
}

/// A pause in the middle of a frame leaves nothing behind.
#[test]
fn a_cut_frame_leaves_nothing_behind() {
    let mut rng = common::rng();
    for _ in 0..common::size(100) {
        // A sign of life would tell the frames apart.
        let format = loop {
            let format = common::format(&mut rng);
            if !format.contains("lc") {
                break format;
            }
        };
        let slaves = rng.usize(1..=8);
        let shares = shares(&mut rng, &format, slaves);
        let knobs = format!(
            "motion=still,pos={},slaves={shares},frame={format}",
            rng.u32(..)
        );
        let mut wire = Wire::new(&knobs);
        let whole = wire.frame(false);
        wire.clock(rng.usize(1..wire.clocks));
        wire.rest(rng.bool());
        wire.reset();
        assert_eq!(wire.frame(false), whole, "{knobs}");
    }
}

#[test]
fn a_chain_powers_up_low_until_a_frame_has_passed() {
    let knobs = "slaves=1:0:1,motion=still,pos=77,frame=st8,crc6+st8";
    let mut usual = Wire::new(knobs);
    let mut wire = Wire::new(&format!("power-up=low,{knobs}"));
    assert!(!wire.slave.slo(wire.t_ns));
    assert_eq!(wire.frame_of(2, false), "00");
    assert!(wire.slave.slo(wire.t_ns));
    assert_eq!(wire.frame(false), usual.frame(false));
    assert_eq!(wire.read(2, 0x44, 4), Some((vec![0, 1, 0x86, 0xA3], false)));
}

#[test]
fn slaves_that_do_not_share_out_the_channels_are_refused() {
    for (slaves, format, fits) in [
        ("1", "st8", true),
        ("0:1", "st8", true),
        ("each", "st8+st8", true),
        ("2", "st8", false),
        ("1:1", "st8+st8+st8", false),
        ("0", "st8", false),
    ] {
        let text = format!("slaves={slaves},frame={format}");
        assert_eq!(text.parse::<Config>().is_ok(), fits, "{text}");
    }
    for (text, words) in [
        ("slaves=1:x", "such as 1:2, or each"),
        ("slaves=9", "such as 1:2, or each"),
        ("slaves=", "such as 1:2, or each"),
        ("sli=high", "low|mo"),
        ("device=abc", "own|mhm|none"),
        ("refusal=loud", "invert|silent"),
        ("reg-busy=3", "no unit"),
        ("refuse=0x80", "0x00 to 0x7F"),
        ("refuse=0x20..0x10", "0x00 to 0x7F"),
        ("read-only=x", "0x00 to 0x7F"),
        ("cds-flip=2", "2"),
        ("life-skips-zero=yes", "0|1"),
    ] {
        let error = text.parse::<Config>().unwrap_err().to_string();
        assert!(error.contains(words), "{text}: {error}");
    }
}

/// The far slave's SLI on the master's MO: it waits for the start bit there, and for MO after its timeout.
#[test]
fn mo_is_the_slave_before_the_farthest() {
    let frame = "slaves=1:1,motion=still,pos=200,frame=st8,crc6+st8";
    let grounded = Wire::new(frame).frame(false);
    let mut wire = Wire::new(&format!("sli=mo,{frame}"));
    wire.clocks += 16;
    assert!(wire.slave.has_mo());
    // MO at rest: nobody begins.
    let never = format!("1{}", "0".repeat(wire.clocks - 1));
    assert_eq!(wire.frame(false), never);
    // Ack, start 4 clocks later than could be, CDS 0, then a few bits of its own.
    let mo = "1000001011001";
    let mut seen = String::new();
    for clock in 0..wire.clocks {
        seen.push_str(&wire.clock(1));
        let level = mo[clock.min(mo.len() - 1)..].starts_with('1');
        // MO moves after the rising edge; the falling one that reads it comes at once.
        wire.slave.mo(wire.t_ns, level);
    }
    assert_eq!(start_of(&seen), 9, "{seen}");
    // CDS and data of both slaves, then what MO had behind its CDS.
    let words = &after_start(&grounded)[..1 + 14 + 8];
    let want = format!("{words}1100{}", "1".repeat(80));
    let after = after_start(&seen);
    assert_eq!(after, &want[..after.len()]);
    assert!(after.len() > words.len() + 4);
    // Its timeout has passed, MO is still low.
    wire.slave.mo(wire.t_ns, false);
    wire.slave.ma(wire.t_ns, true);
    wire.t_ns += 50_000;
    assert!(!wire.slave.slo(wire.t_ns));
    wire.slave.mo(wire.t_ns + 10, true);
    assert!(wire.slave.slo(wire.t_ns + 11));
    // SLI is 0 when a frame begins: it takes itself for the first.
    wire.t_ns += 1_000;
    wire.slave.mo(wire.t_ns, false);
    assert!(wire.slave.slo(wire.t_ns));
    assert!(wire.clock(23).starts_with(&grounded[..23]));
}
