//! Registers over a wire with bit errors: what CRC-4 lets pass is counted beside what its mathematics allows.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;
#[path = "common/links.rs"]
mod links;

use biss::control::Failure;
use biss::frame::BissC;
use biss::link::Link;
use biss::master::Master;
use biss::registers::{Cell, Registers, Trouble};
use biss::slave::Event;
use links::{HasSlave, commands, map, sim, sim_wave, with};

/// x⁴+x+1 over `bits`, and the remainder behind them, inverted.
fn crc4(bits: u32, len: u32) -> u32 {
    let mut rest = bits << 4;
    for place in (0..len).rev() {
        if rest >> (place + 4) & 1 == 1 {
            rest ^= 0b10011 << place;
        }
    }
    rest ^ 0xF
}

/// How many patterns of so many bit errors turn a word of `len` bits and CRC into another one that is right.
fn undetected(len: u32) -> Vec<u64> {
    let zero = crc4(0, len);
    let mut counts = vec![0; len as usize + 5];
    for bits in 1..1u32 << len {
        let word = bits << 4 | crc4(bits, len) ^ zero;
        counts[word.count_ones() as usize] += 1;
    }
    counts
}

/// How likely it is that a word with a good CRC is not the one that was sent, each bit being wrong with `p`.
fn share_of_wrong(counts: &[u64], p: f64) -> f64 {
    let bits = counts.len() - 1;
    let pattern = |w: usize| p.powi(w as i32) * (1.0 - p).powi((bits - w) as i32);
    let wrong: f64 = counts
        .iter()
        .enumerate()
        .map(|(w, count)| *count as f64 * pattern(w))
        .sum();
    wrong / (wrong + pattern(0))
}

/// No more than this where `mean` are to be expected: six standard deviations, and a few.
fn at_most(mean: f64) -> u64 {
    (mean + 6.0 * mean.sqrt() + 3.0) as u64
}

#[test]
fn the_codes_have_the_known_weights() {
    let data = undetected(8);
    assert_eq!((&data[..4], data[3]), (&[0, 0, 0, 17][..], 17), "of 220");
    let header = undetected(11);
    assert_eq!(&header[..4], [0, 0, 0, 35], "of 455");
}

#[derive(Debug, Default)]
struct Count {
    right: u64,
    wrong: u64,
    refused: u64,
    failed: u64,
    retries: u64,
    frames: u64,
}

impl Count {
    fn add(&mut self, cells: &[Cell], want: &[u8]) {
        for (cell, want) in cells.iter().zip(want) {
            match cell {
                Cell::Byte(byte) if byte == want => self.right += 1,
                Cell::Byte(_) => self.wrong += 1,
                Cell::Refused => self.refused += 1,
                Cell::Failed(_) => self.failed += 1,
            }
        }
    }
}

/// Addresses that can be written, whatever is behind them.
const OPEN: std::ops::Range<u16> = 0x00..0x40;

/// Reads a window full of chance so many times.
fn reads<L: Link + HasSlave + Clone>(
    mut link: L,
    rng: &mut fastrand::Rng,
    verify: bool,
    rounds: usize,
    count: &mut Count,
) {
    let watch = link.clone();
    let protocol = BissC::head_only();
    let mut master = Master::new(&mut link, &protocol, None);
    assert!(master.open().unwrap());
    let mut registers = Registers::new(&mut master);
    registers.verify(verify);
    for _ in 0..rounds {
        let want: Vec<u8> = OPEN.map(|_| rng.u8(..)).collect();
        watch.slave(|slave| {
            let poked = OPEN
                .zip(&want)
                .all(|(at, byte)| slave.poke(0, 0, at as u8, *byte));
            assert!(poked);
        });
        let mut at = OPEN.start;
        while at < OPEN.end {
            match registers.cells(0, at..OPEN.end) {
                Ok(cells) => {
                    count.add(&cells, &want[usize::from(at)..]);
                    at += cells.len() as u16;
                }
                Err(Trouble::Slave { .. }) => {
                    count.failed += 1;
                    at += 1;
                }
                Err(other) => panic!("{other}"),
            }
        }
    }
    count.retries += registers.retries();
    count.frames += registers.frames();
}

const ONE: &str = "frame=st12,nE,nW,crc6";

fn campaign(verify: bool, (late, busy): (bool, bool), p: f64, rounds: usize) -> Count {
    let mut rng = common::rng();
    let mut count = Count::default();
    let mut left = common::size(rounds);
    while left > 0 {
        let rounds = left.min(20);
        left -= rounds;
        let busy = if busy { "reg-busy=0us..300us," } else { "" };
        let config = format!("seed={},cds-flip={p},{busy}{ONE}", rng.u32(..));
        match late {
            true => reads(sim_wave(&config), &mut rng, verify, rounds, &mut count),
            false => reads(sim(&config), &mut rng, verify, rounds, &mut count),
        }
    }
    count
}

/// A link that reacts or is late, a slave that is busy or never.
const WAYS: [(bool, bool); 4] = [(false, false), (false, true), (true, false), (true, true)];

/// A byte that comes a frame late, or whose S was missed so that its first 1 is taken for it, never has a good CRC: it takes a
/// second bit error to hide that.
#[test]
fn no_shift_alone_passes() {
    for byte in 0..=255u32 {
        let word = byte << 4 | crc4(byte, 8);
        let first = 31 - word.leading_zeros();
        for p in 0..=1 {
            // P follows the CRC, and nothing follows P.
            let missed = (word << 1 | p) << (11 - first) & 0xFFF;
            let early = 0x800 | word >> 1;
            for shifted in [missed, early] {
                assert_ne!(crc4(shifted >> 4, 8), shifted & 0xF, "{byte:#x}");
            }
        }
    }
}

#[test]
fn wrong_bytes_are_as_rare_as_crc4_makes_them() {
    let p = 0.01;
    let share = share_of_wrong(&undetected(8), p);
    for way in WAYS {
        let count = campaign(false, way, p, 40);
        let mean = share * (count.right + count.wrong) as f64;
        println!("late, busy {way:?}: {count:?}, {mean:.1} wrong are allowed");
        assert!(count.right > 10 * count.failed);
        assert!(count.wrong <= at_most(mean));
    }
}

#[test]
fn no_byte_that_was_read_twice_is_wrong() {
    for way in WAYS {
        let count = campaign(true, way, 0.01, 15);
        println!("late, busy {way:?}: {count:?}");
        assert_eq!(count.wrong, 0);
        assert!(count.right > 10 * count.failed);
    }
}

/// Registers that change with every reading never read the same twice, so none of them is ever verified: however a reading
/// ends, the one before it does not count alone.
#[test]
fn what_was_read_once_is_not_verified() {
    let mut rng = common::rng();
    let (mut unsteady, mut other) = (0, 0);
    for _ in 0..common::size(60) {
        let p = *rng.choice(&[0.0, 0.001, 0.003, 0.01]).unwrap();
        let mut link = sim(&format!("seed={},cds-flip={p},{ONE}", rng.u32(..)));
        let watch = link.clone();
        watch.slave(|slave| slave.record_events(true));
        let value = std::cell::Cell::new(0u8);
        let count = || {
            watch.slave(|slave| {
                if !slave.take_events().is_empty() {
                    value.set(value.get().wrapping_add(1));
                    assert!((0..0x40).all(|at| slave.poke(0, 0, at, value.get())));
                }
            });
            false
        };
        let protocol = BissC::head_only();
        let mut master = Master::new(&mut link, &protocol, None);
        assert!(master.open().unwrap());
        master.stop_when(&count);
        master.set_access_retries(rng.u32(0..=2));
        let mut registers = Registers::new(&mut master);
        registers.verify(true);
        let end = rng.u16(1..=20);
        let Ok(cells) = registers.cells(0, 0..end) else {
            continue;
        };
        for cell in cells {
            match cell {
                Cell::Failed(Failure::Unsteady { .. }) => unsteady += 1,
                Cell::Failed(_) => other += 1,
                Cell::Refused | Cell::Byte(_) => panic!("{cell:?} at {p}"),
            }
        }
    }
    println!("{unsteady} unsteady, {other} otherwise");
    assert!(unsteady > 0 && other > 0);
}

/// All that was asked for, or an error: a reading that ends early is no shorter answer. Nor does it stand for what was not
/// read back of a write.
#[test]
fn an_answer_is_whole() {
    let mut rng = common::rng();
    let (mut read, mut failed) = (0, 0);
    for _ in 0..common::size(150) {
        let p = *rng.choice(&[0.001, 0.003, 0.02]).unwrap();
        let mut link = sim(&format!(
            "seed={},cds-flip={p},write-lost=0.03,{ONE}",
            rng.u32(..)
        ));
        let watch = link.clone();
        let protocol = BissC::head_only();
        let mut master = Master::new(&mut link, &protocol, None);
        assert!(master.open().unwrap());
        master.set_access_retries(rng.u32(0..=1));
        let mut registers = Registers::new(&mut master);
        registers.verify(true);
        let count = rng.u8(1..=20);
        match registers.read(0, 0, count) {
            Ok(bytes) => assert_eq!(bytes, vec![0; count.into()]),
            Err(_) => failed += 1,
        }
        let data: Vec<u8> = (0..count).map(|_| rng.u8(1..)).collect();
        if registers.write(0, 0, &data, true).is_ok() {
            let there = watch.slave(|slave| map(slave, &[0]));
            for (address, byte) in (0..).zip(&data) {
                assert_eq!(there.get(&(0, 0, address)), Some(byte), "{address:#x}");
            }
            read += 1;
        }
    }
    println!("{read} written, {failed} not read");
    assert!(read > 0 && failed > 0);
}

/// Single registers, one access each: a slave that has lost count of the bits must not answer the next access with something
/// else.
#[test]
fn no_access_is_answered_by_the_one_before() {
    let mut rng = common::rng();
    let header = undetected(11);
    for (late, p) in [(false, 0.01), (true, 0.01), (false, 0.002)] {
        let (mut right, mut wrong) = (0u64, 0u64);
        let mut left = common::size(1_000);
        while left > 0 {
            let rounds = left.min(500);
            left -= rounds;
            let config = format!("seed={},cdm-flip={p},{ONE}", rng.u32(..));
            let mut single = |registers: &mut Registers<'_, '_>| {
                for _ in 0..rounds {
                    let at = rng.u8(..0x40);
                    match registers.read(0, at, 1) {
                        Ok(bytes) if bytes == [scattered(at)] => right += 1,
                        Ok(_) => wrong += 1,
                        Err(Trouble::Slave { .. }) => {}
                        Err(other) => panic!("{other}"),
                    }
                }
            };
            match late {
                true => with(&mut scatter(sim_wave(&config)), &mut single),
                false => with(&mut scatter(sim(&config)), &mut single),
            }
        }
        let mean = share_of_wrong(&header, p) * (right + wrong) as f64;
        println!("late {late}, {p}: {right} right, {wrong} wrong, {mean:.2} are allowed");
        assert!(right > 0);
        assert!(wrong <= at_most(mean));
    }
}

/// What stands at an address where every address has something else, and bytes are all over the place.
fn scattered(at: u8) -> u8 {
    at.wrapping_mul(0xAD).wrapping_add(0x35)
}

fn scatter<L: HasSlave>(link: L) -> L {
    link.slave(|slave| {
        for at in 0..0x40 {
            assert!(slave.poke(0, 0, at, scattered(at)));
        }
    });
    link
}

/// What a campaign of writes has come to.
#[derive(Debug, Default)]
struct Writes {
    good: u64,
    /// Said to be good, and the map holds something else.
    lies: u64,
    failed: u64,
    /// Bytes that went to where nobody wanted them, or were others than those.
    elsewhere: u64,
    control_frames: u64,
}

/// Writes and reads back, one to four bytes each.
fn writes<L: Link + HasSlave + Clone>(
    mut link: L,
    rng: &mut fastrand::Rng,
    rounds: usize,
    count: &mut Writes,
) {
    let watch = link.clone();
    watch.slave(|slave| slave.record_events(true));
    let protocol = BissC::head_only();
    let mut master = Master::new(&mut link, &protocol, None);
    assert!(master.open().unwrap());
    let mut registers = Registers::new(&mut master);
    for _ in 0..rounds {
        let address = rng.u8(0..0x3C);
        let data: Vec<u8> = (0..rng.usize(1..=4)).map(|_| rng.u8(..)).collect();
        watch.slave(|slave| slave.take_events());
        let result = registers.write(0, address, &data, true);
        let there = watch.slave(|slave| map(slave, &[0]));
        let holds = (address..)
            .zip(&data)
            .all(|(at, byte)| there.get(&(0, 0, at)) == Some(byte));
        match result {
            Ok(()) if holds => count.good += 1,
            Ok(()) => count.lies += 1,
            Err(Trouble::Slave { .. }) => count.failed += 1,
            Err(other) => panic!("{other}"),
        }
        let wanted: Vec<(u8, u8)> = (address..).zip(data).collect();
        let other = |event: &Event| matches!(event, Event::Write { address, value, .. } if !wanted.contains(&(*address, *value)));
        let events = watch.slave(|slave| slave.take_events());
        count.elsewhere += events.iter().filter(|event| other(event)).count() as u64;
        // Bank select is written to by accident as well: back to where the map is looked at.
        watch.slave(|slave| slave.poke(0, 0, 0x40, 0));
        count.control_frames += 1;
    }
    count.control_frames += registers.retries();
}

/// Faults of the slave and of the wire, singly and together.
const KNOBS: [&str; 9] = [
    "cds-flip=0.005",
    "cdm-flip=0.005",
    "cds-flip=0.005,cdm-flip=0.005",
    "echo-wrong=0.2",
    "write-lost=0.2",
    "w-inverted=0.2,no-s=0.1,stop-bit=0.2",
    "idl-wrong=0.2,data-crc=0.2",
    "write-lost=0.1,echo-wrong=0.1,cds-flip=0.003",
    "cdm-flip=0.003,write-lost=0.1,stop-bit=0.1,data-crc=0.1",
];

#[test]
fn a_write_that_was_not_done_is_not_said_to_be() {
    let mut rng = common::rng();
    for knobs in KNOBS {
        for late in [false, true] {
            let mut count = Writes::default();
            let rounds = common::size(40);
            let busy = *rng.choice(&["", "reg-busy=0us..300us,"]).unwrap();
            let config = format!("seed={},{busy}{knobs},{ONE}", rng.u32(..));
            match late {
                true => writes(sim_wave(&config), &mut rng, rounds, &mut count),
                false => writes(sim(&config), &mut rng, rounds, &mut count),
            }
            println!("late {late}, {knobs}: {count:?}");
            assert_eq!(count.lies, 0, "{config}");
            assert!(count.good > 0, "{config}");
            if !knobs.contains("cdm-flip") {
                assert_eq!(count.elsewhere, 0, "{config}");
            }
        }
    }
}

/// A bit error on the way to the slave makes another header of it, or another byte, where it changes three bits at least.
#[test]
fn what_is_written_elsewhere_is_as_rare_as_crc4_makes_it() {
    let mut rng = common::rng();
    let p = 0.01;
    let mut count = Writes::default();
    let mut left = common::size(1_000);
    while left > 0 {
        let rounds = left.min(500);
        left -= rounds;
        let config = format!("seed={},cdm-flip={p},{ONE}", rng.u32(..));
        writes(sim(&config), &mut rng, rounds, &mut count);
    }
    // Each control frame has a header, and four bytes at most.
    let share = share_of_wrong(&undetected(11), p) + 4.0 * share_of_wrong(&undetected(8), p);
    let mean = share * count.control_frames as f64;
    println!("{count:?}, {mean:.2} are allowed");
    assert_eq!(count.lies, 0);
    assert!(count.elsewhere <= at_most(mean));
}

/// A command is executed by whom it was for, once, or not at all; or nobody can know.
#[test]
fn a_command_is_executed_as_often_as_is_said() {
    let mut rng = common::rng();
    for knobs in [
        "cds-flip=0.01",
        "ida-wrong=0.3",
        "idl-wrong=0.3,ida-wrong=0.2",
    ] {
        for late in [false, true] {
            let (mut done, mut failed) = (0, 0);
            for _ in 0..common::size(80) {
                let config = format!("seed={},{knobs},{ONE}", rng.u32(..));
                let executed = match late {
                    true => command_once(sim_wave(&config)),
                    false => command_once(sim(&config)),
                };
                done += u32::from(executed);
                failed += u32::from(!executed);
            }
            println!("late {late}, {knobs}: {done} executed, {failed} not");
            assert!(done > 0);
        }
    }
}

fn command_once<L: Link + HasSlave + Clone>(mut link: L) -> bool {
    let watch = link.clone();
    watch.slave(|slave| slave.record_events(true));
    let protocol = BissC::head_only();
    let mut master = Master::new(&mut link, &protocol, None);
    assert!(master.open().unwrap());
    let result = Registers::new(&mut master).command(1, 2, true, false);
    let executed = commands(&watch.slave(|slave| slave.take_events()));
    assert_eq!(executed, usize::from(result.is_ok()), "{result:?}");
    result.is_ok()
}
