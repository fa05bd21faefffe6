//! Registers over whole frames: master and control machine on one side, the simulated slave on the other.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;
#[path = "common/links.rs"]
mod links;

use biss::control::{Access, BUSY_MAX_NS, Failure, REST_FRAMES};
use biss::frame::{BissC, Stall};
use biss::identify;
use biss::link::sim::Controller;
use biss::link::wave::Options;
use biss::link::{Link, Phase};
use biss::master::{Master, Slot};
use biss::registers::{BANK_SELECT, Cell, Registers, Trouble};
use biss::slave::Event;
use links::{HasSlave, map, sim, sim_wave, sim_wave_on, with};
use std::collections::BTreeMap;

fn failure(trouble: &Trouble) -> Failure {
    match trouble {
        Trouble::Slave { failure, .. } => *failure,
        other => panic!("{other}"),
    }
}

/// 33 frames for the first byte, 14 for each that follows, as many more as the slave is busy, and 14 of rest before.
#[test]
fn an_access_costs_what_the_standard_says() {
    let mut link = sim("device=mhm");
    with(&mut link, |registers| {
        let mut frames = |count| {
            let before = registers.frames();
            let outcome = registers
                .access(Access::Read {
                    slave: 0,
                    address: 0x40,
                    count,
                })
                .unwrap();
            assert_eq!(outcome.failure, None);
            (outcome.frames, registers.frames() - before)
        };
        // Opening has left part of the rest, a read leaves all of it.
        let (inside, all) = frames(1);
        assert_eq!(inside, 33);
        assert!(all <= 33 + u64::from(REST_FRAMES));
        assert_eq!(frames(1), (33, 33));
        assert_eq!(frames(2), (47, 47));
        assert_eq!(frames(16), (33 + 14 * 15, 33 + 14 * 15));
        let write = |registers: &mut Registers<'_, '_>| {
            let before = registers.frames();
            let outcome = registers
                .access(Access::Write {
                    slave: 0,
                    address: BANK_SELECT,
                    data: [0u8].as_slice().into(),
                })
                .unwrap();
            assert_eq!(outcome.failure, None);
            (outcome.frames, registers.frames() - before)
        };
        assert_eq!(write(registers), (33, 33));
        // One of the fourteen is in the write's own frames, the one behind P.
        assert_eq!(write(registers), (33, 33 + 13));
    });
}

struct Model {
    map: BTreeMap<(usize, u8, u8), u8>,
    banks: Vec<u8>,
}

/// Accesses of every kind; returns how many bytes were read and written.
fn rounds<L: Link + HasSlave + Clone>(
    link: &mut L,
    rng: &mut fastrand::Rng,
    accesses: usize,
    model: &mut Model,
) -> (u64, u64) {
    let watch = link.clone();
    let (mut read, mut written) = (0, 0);
    with(link, |registers| {
        for _ in 0..accesses {
            let devices = watch.slave(|slave| slave.devices());
            let id = rng.usize(0..devices + 1);
            let address = rng.u8(0..0x80);
            let count = if rng.u8(..3) == 0 {
                rng.u8(1..=64)
            } else {
                rng.u8(1..=4)
            };
            let count = count.min(0x80 - address);
            let bank = watch.slave(|slave| slave.peek(id.min(devices - 1), 0, BANK_SELECT));
            let bank = bank.unwrap_or(0);
            let key = |address: u8| (id, if address < 0x40 { bank } else { 0 }, address);
            let write = rng.u8(..3) == 0;
            let data: Vec<u8> = (0..count)
                .map(|offset| {
                    // Only banks that the model knows.
                    match address + offset {
                        BANK_SELECT => *rng.choice(&model.banks).unwrap(),
                        _ => rng.u8(..),
                    }
                })
                .collect();
            let outcome = registers
                .access(match write {
                    true => Access::Write {
                        slave: id as u8,
                        address,
                        data: data.as_slice().into(),
                    },
                    false => Access::Read {
                        slave: id as u8,
                        address,
                        count,
                    },
                })
                .unwrap();
            let done = outcome.bytes.as_slice();
            let whole = done.len() == usize::from(count);
            assert_eq!(outcome.failure.is_none(), whole, "{outcome:?}");
            if id == devices {
                let absent = Failure::Absent {
                    slave: id as u8,
                    present: devices as u8,
                };
                assert_eq!((outcome.failure, done.len()), (Some(absent), 0));
                continue;
            }
            assert_eq!(usize::from(outcome.present()), devices);
            for (address, byte) in (address..).zip(done) {
                if write {
                    model.map.insert(key(address), *byte);
                    written += 1;
                } else {
                    assert_eq!(model.map.get(&key(address)), Some(byte), "{address:#x}");
                    read += 1;
                }
            }
            if write {
                assert_eq!(done, &data[..done.len()]);
            }
            if let Some(failure) = outcome.failure {
                let at = address + done.len() as u8;
                let answer = matches!(failure, Failure::Refused { address } | Failure::Silent { address, .. } | Failure::NotEchoed { address } if address == at);
                assert!(answer, "{failure} at {at:#x}");
                let writable = watch.slave(|slave| slave.peek(id, bank, at)).is_some();
                assert!(!writable || write, "{failure}, but the slave has it");
            }
            let now = watch.slave(|slave| map(slave, &model.banks));
            assert_eq!(now, model.map, "after {outcome:?}");
        }
    });
    (read, written)
}

fn knobs(rng: &mut fastrand::Rng) -> String {
    let mut knobs = format!("seed={}", rng.u32(..));
    let devices = rng.usize(1..=4);
    if rng.bool() {
        knobs += ",reg-busy=0us..300us";
    }
    if rng.u8(..4) == 0 {
        knobs += ",refusal=silent";
    }
    if rng.bool() {
        let first = rng.u8(0..0x40);
        knobs += &format!(
            ",refuse={first:#x}..{:#x}",
            rng.u8(first..=first.saturating_add(9))
        );
    }
    if rng.bool() {
        let first = rng.u8(0..0x60);
        knobs += &format!(",read-only={first:#x}..{:#x}", rng.u8(first..=first + 9));
    }
    if rng.bool() {
        knobs += &format!(",delay={}ns", rng.u32(0..3_000));
    }
    if rng.bool() {
        knobs += ",busy=0us..5us";
    }
    let channel = "st12,nE,nW,crc6";
    knobs += &format!(",slaves=each,frame={}", vec![channel; devices].join("+"));
    knobs
}

/// The map is exactly what was acknowledged, and every byte read is the slave's.
#[test]
fn a_wire_without_errors_makes_none() {
    let mut rng = common::rng();
    let (mut read, mut written) = (0, 0);
    for _ in 0..common::size(12) {
        let knobs = knobs(&mut rng);
        println!("{knobs}");
        let mut link = sim(&knobs);
        let banks = vec![0, 2, 4, 5];
        let map = link.slave(|slave| map(slave, &banks));
        let mut model = Model { map, banks };
        let (r, w) = rounds(&mut link, &mut rng, 25, &mut model);
        (read, written) = (read + r, written + w);
    }
    println!("{read} bytes read, {written} written");
    assert!(read > 100 && written > 20, "{read} {written}");
}

/// Likewise where CDM is laid out before CDS is seen.
#[test]
fn a_late_master_makes_none_either() {
    let mut rng = common::rng();
    for _ in 0..common::size(4) {
        let knobs = knobs(&mut rng);
        println!("{knobs}");
        let mut link = sim_wave(&knobs);
        let banks = vec![0, 2, 4, 5];
        let map = link.slave(|slave| map(slave, &banks));
        let mut model = Model { map, banks };
        rounds(&mut link, &mut rng, 10, &mut model);
    }
}

#[test]
fn banks_are_restored() {
    let mut link = sim("frame=st12,nE,nW,crc6");
    let watch = link.clone();
    with(&mut link, |registers| {
        let cells = registers
            .within(0, 4, |registers| registers.cells(0, 0x00..0x04))
            .unwrap();
        let want: Vec<_> = (0..4)
            .map(|at| watch.slave(|slave| slave.peek(0, 4, at)))
            .collect();
        assert_eq!(
            cells.iter().map(|cell| cell.byte()).collect::<Vec<_>>(),
            want
        );
        let selected = watch.slave(|slave| slave.peek(0, 0, BANK_SELECT));
        assert_eq!(selected, Some(0));
        let refused = registers.within(0, 4, |registers| registers.read(0, 0x77, 1));
        assert_eq!(
            failure(&refused.unwrap_err()),
            Failure::Refused { address: 0x77 }
        );
        let selected = watch.slave(|slave| slave.peek(0, 0, BANK_SELECT));
        assert_eq!(selected, Some(0));
    });
}

/// The iC-MHM's own registers, refused ones between them.
#[test]
fn an_ic_mhm_reads_as_published() {
    let mut link = sim("device=mhm");
    with(&mut link, |registers| {
        let cells = registers.cells(0, 0x00..0x80).unwrap();
        let bytes = |range: std::ops::Range<usize>| -> Vec<u8> {
            cells[range]
                .iter()
                .map(|cell| cell.byte().unwrap())
                .collect()
        };
        assert_eq!(bytes(0x00..0x04), [0x48, 0x44, 0x00, 0x78]);
        assert!(cells[0x14..0x40].iter().all(|cell| *cell == Cell::Refused));
        assert_eq!(bytes(0x41..0x44), [0x02, 0x62, 0x1E]);
        assert!(cells[0x74..0x78].iter().all(|cell| *cell == Cell::Refused));
        assert_eq!(bytes(0x78..0x80), *b"MHM#D\0iC");
    });
}

/// Whichever bank was selected, and however many are looked at.
#[test]
fn asking_for_identity_leaves_the_bank() {
    for bank in [0, 2, 4, 0x10] {
        let mut link = sim("frame=st12,nE,nW,crc6");
        assert!(link.slave(|slave| slave.poke(0, 0, BANK_SELECT, bank)));
        let watch = link.clone();
        let bus = with(&mut link, |registers| identify::ask(registers, true)).unwrap();
        assert_eq!((bus.present, bus.failed.len()), (1, 0));
        let selected = watch.slave(|slave| slave.peek(0, 0, BANK_SELECT));
        assert_eq!(selected, Some(bank));
    }
}

/// A late link plans its clocks. Heads of frames that take more of them than is usual, always or now and then, must not
/// cut one frame in two: the slaves would never come to rest.
#[test]
fn a_late_master_learns_how_long_heads_are() {
    for knob in [
        "busy=15us",
        "busy=30us",
        "ack=20",
        "delay=30us",
        "busy=2us..12us",
    ] {
        let mut link = sim_wave(&format!("device=mhm,{knob}"));
        let bytes = with(&mut link, |registers| registers.read(0, 0x78, 8));
        let bytes = bytes.unwrap_or_else(|trouble| panic!("{knob}: {trouble}"));
        assert_eq!(bytes, b"MHM#D\0iC", "{knob}");
    }
}

/// Where MOSI rests low MA moves before and after each transfer. No slave may take that for a frame: it would take a bit of
/// CDM from it.
#[test]
fn a_resting_mosi_is_no_bit() {
    for timeout in ["12500ns", "20us", "40us"] {
        for call_ns in [0, 10_000, 30_000, 100_000] {
            let controller = Controller {
                mosi_rests: Some(false),
                call_ns,
                ..Controller::default()
            };
            let options = Options {
                idle: Some(false),
                ..Options::default()
            };
            let config = format!("timeout={timeout},frame=st12,nE,nW,crc6");
            let mut link = sim_wave_on(&config, controller, options);
            let watch = link.clone();
            with(&mut link, |registers| {
                let bytes = registers.read(0, 0x78, 6).unwrap();
                assert_eq!(bytes, b"BISSIM", "{timeout} {call_ns}");
                registers.write(0, 0x50, &[1, 0xFF], true).unwrap();
                assert_eq!(registers.retries(), 0, "{timeout} {call_ns}");
            });
            let written = [0x4F, 0x50, 0x51, 0x52].map(|at| watch.slave(|s| s.peek(0, 0, at)));
            assert_eq!(written, [Some(0), Some(1), Some(0xFF), Some(0)]);
        }
    }
}

/// There are 128 registers: nothing beyond them is read from elsewhere, or left out of a write in silence.
#[test]
fn nothing_is_beyond_the_last_register() {
    let mut link = sim("frame=st12,nE,nW,crc6");
    let watch = link.clone();
    watch.slave(|slave| slave.record_events(true));
    with(&mut link, |registers| {
        let beyond = |result: Result<(), Trouble>| {
            let said = result.unwrap_err().to_string();
            assert!(said.contains("registers end at 0x7f"), "{said}");
        };
        beyond(registers.write(0, 0, &[0; 129], true));
        beyond(registers.write(0, 0, &[0; 384], true));
        beyond(registers.write(0, 0x7F, &[0; 2], false));
        beyond(registers.read(0, 0x7F, 2).map(drop));
        beyond(registers.cells(0, 0..300).map(drop));
        beyond(registers.cells(0, 0x150..0x152).map(drop));
    });
    assert_eq!(watch.slave(|slave| slave.take_events()), []);
}

/// One bit error in an IDL slot can look like one more slave, or hide one. It spoils nothing; two in a row are too rare here.
#[test]
fn a_slave_that_is_not_there_is_not_reported() {
    let mut rng = common::rng();
    let mut asked = 0;
    for _ in 0..common::size(100) {
        let devices = rng.usize(1..=3);
        let frame = vec!["st12,nE,nW,crc6"; devices].join("+");
        let knobs = format!(
            "seed={},cds-flip=0.0004,slaves=each,frame={frame}",
            rng.u32(..)
        );
        let mut link = sim(&knobs);
        match with(&mut link, |registers| identify::ask(registers, false)) {
            Ok(bus) => {
                assert_eq!(usize::from(bus.present), devices, "{knobs}");
                assert_eq!(bus.devices.len(), devices, "{knobs}");
                asked += 1;
            }
            // A slave that is there was not seen twice in a row.
            Err(Trouble::Slave { failure, .. }) => {
                let Failure::Absent { slave, .. } = failure else {
                    panic!("{knobs}: {failure}");
                };
                assert!(usize::from(slave) < devices, "{knobs}: {failure}");
            }
            Err(other) => panic!("{other}"),
        }
    }
    println!("{asked} asked");
    assert!(asked > 0);
}

/// Every kind of timeout, wherever in a bit SL is sampled, by heads and by whole frames: CDM = 1 is held as long as it must be,
/// and no last bit is read from the level that carries it.
#[test]
fn every_timeout_takes_every_bit() {
    let phases = [
        Phase::Quarter,
        Phase::Half,
        Phase::ThreeQuarters,
        Phase::Whole,
    ];
    let timeouts = [
        "timeout=12500ns",
        "timeout=40us",
        "timeout=request",
        "timeout=adaptive",
        "timeout=adaptive,tclk=500ns,timer=rising",
    ];
    for timeout in timeouts {
        for phase in phases {
            for head_only in [false, true] {
                let config = format!("delay=700ns,{timeout},frame=st12,nE,nW,crc6");
                let mut link = sim(&config);
                link.borrow_mut().set_phase(phase).unwrap();
                let mut protocol = match head_only {
                    true => BissC::head_only(),
                    false => BissC::new("st12,nE,nW,crc6".parse().unwrap()),
                };
                if timeout.contains("adaptive") {
                    protocol.stall = Stall::Adaptive;
                }
                // Not opened, so that the phase stays.
                let mut master = Master::new(&mut link, &protocol, Some(0));
                let mut registers = Registers::new(&mut master);
                let about = format!("{config} {phase} {head_only}");
                let bytes = registers
                    .read(0, 0x78, 6)
                    .unwrap_or_else(|e| panic!("{about}: {e}"));
                assert_eq!(bytes, b"BISSIM", "{about}");
                registers.write(0, 0x50, &[0x5A, 0xFF, 0], true).unwrap();
                registers.command(1, 2, true, false).unwrap();
                registers.command(0, 2, true, true).unwrap();
                assert_eq!(registers.retries(), 0, "{about}");
            }
        }
    }
}

/// A register may take 20 ms, and no longer, however rarely frames come.
#[test]
fn a_busy_register_is_waited_for_and_not_for_ever() {
    for distance_ns in [0, 1_000_000, 7_000_000] {
        for (busy, is_read) in [("19ms", true), ("60ms", false)] {
            let config = format!("reg-busy={busy},frame=st12,nE,nW,crc6");
            let (mut soon, mut late) = (sim(&config), sim_wave(&config));
            let links: [&mut dyn Link; 2] = [&mut soon, &mut late];
            for link in links {
                let protocol = BissC::head_only();
                let mut master = Master::new(link, &protocol, None);
                assert!(master.open().unwrap());
                master.keep_distance(distance_ns);
                let began = master.link().now_ns();
                let mut registers = Registers::new(&mut master);
                let outcome = registers
                    .access(Access::Read {
                        slave: 0,
                        address: 0x78,
                        count: 1,
                    })
                    .unwrap();
                let took_ns = registers.master().link().now_ns() - began;
                match outcome.failure {
                    None => assert!(is_read && outcome.waited == 1, "{config}"),
                    Some(Failure::Silent { waited_ns, .. }) => {
                        assert!(!is_read && waited_ns > BUSY_MAX_NS, "{config}");
                        assert!(waited_ns <= BUSY_MAX_NS + distance_ns + 1_000_000);
                    }
                    Some(other) => panic!("{config} {distance_ns}: {other}"),
                }
                assert!(took_ns < 2 * (BUSY_MAX_NS + 60 * distance_ns.max(200_000)));
            }
        }
    }
}

/// An answer is believed when it comes twice, a byte that is stored is waited for, and each byte has repetitions of its own.
#[test]
fn what_is_repeated_is_repeated_as_often_as_it_helps() {
    let access = |config: &str, retries: Option<u32>, access: Access| {
        let mut link = sim(config);
        let protocol = BissC::head_only();
        let mut master = Master::new(&mut link, &protocol, None);
        assert!(master.open().unwrap());
        if let Some(retries) = retries {
            master.set_access_retries(retries);
        }
        Registers::new(&mut master).access(access).unwrap()
    };
    let frame = "frame=st12,nE,nW,crc6";
    let read = |count| Access::Read {
        slave: 0,
        address: 0,
        count,
    };
    let outcome = access(&format!("refuse=0..4,{frame}"), None, read(1));
    assert_eq!(outcome.failure, Some(Failure::Refused { address: 0 }));
    assert_eq!(outcome.retries, 1);
    let write = Access::Write {
        slave: 0,
        address: 0,
        data: [1, 2].as_slice().into(),
    };
    let outcome = access(&format!("reg-busy=15ms,{frame}"), Some(0), write);
    assert_eq!(
        (outcome.failure, outcome.bytes.as_slice()),
        (None, &[1, 2][..])
    );
    assert!(outcome.retries > 0);
    let all = (0..50).map(|seed| {
        let config = format!("seed={seed},data-crc=0.1,{frame}");
        access(&config, Some(3), read(64))
    });
    let whole = all.filter(|outcome| outcome.failure.is_none() && outcome.retries > 3);
    assert!(whole.count() > 20);
}

/// P = 1 ends a sequence, not an access: the next control frame goes on behind it.
#[test]
fn a_sequence_that_ends_early_is_continued() {
    for config in [
        "stop-bit=1,frame=st12,nE,nW,crc6",
        "stop-bit=0.5,frame=st12,nE,nW,crc6",
    ] {
        let (mut soon, mut late) = (sim(config), sim_wave(config));
        let work = |registers: &mut Registers<'_, '_>| {
            assert_eq!(registers.read(0, 0x78, 6).unwrap(), b"BISSIM");
            registers.write(0, 0x50, &[1, 2, 3], true).unwrap();
            assert_eq!(registers.retries(), 0);
        };
        with(&mut soon, work);
        with(&mut late, work);
    }
}

/// A late link reads back whether it was asked to or not.
#[test]
fn a_late_write_is_read_back() {
    let mut link = sim_wave("write-lost=1,frame=st12,nE,nW,crc6");
    let result = with(&mut link, |registers| registers.write(0, 0x50, &[7], false));
    let want = Failure::ReadBack {
        address: 0x50,
        want: 7,
        got: 0,
    };
    assert_eq!(failure(&result.unwrap_err()), want);
}

/// A register that has changed between two readings is read once more.
#[test]
fn two_of_several_readings_agree() {
    let mut link = sim("frame=st12,nE,nW,crc6");
    let watch = link.clone();
    watch.slave(|slave| slave.record_events(true));
    let count = || {
        watch.slave(|slave| {
            // The first two readings give 0, then 9.
            let readings = slave.events().count() as u8;
            slave.poke(0, 0, 0x10, if readings == 0 { 0 } else { 9 });
        });
        false
    };
    let protocol = BissC::head_only();
    let mut master = Master::new(&mut link, &protocol, None);
    assert!(master.open().unwrap());
    master.stop_when(&count);
    let mut registers = Registers::new(&mut master);
    registers.verify(true);
    assert_eq!(registers.read(0, 0x10, 1).unwrap(), [9]);
}

/// A bank that is selected already is not written to.
#[test]
fn a_bank_is_selected_only_where_another_is() {
    let mut link = sim("frame=st12,nE,nW,crc6");
    let watch = link.clone();
    watch.slave(|slave| slave.record_events(true));
    with(&mut link, |registers| {
        registers
            .within(0, 0, |registers| registers.read(0, 0x10, 1))
            .unwrap();
    });
    let events = watch.slave(|slave| slave.take_events());
    assert!(
        events
            .iter()
            .all(|event| matches!(event, Event::Read { .. })),
        "{events:x?}"
    );
}

/// The rest before an access is counted anew after INIT, and after a frame whose start bit was in doubt: it was none, or nobody
/// knows which bit of it was CDS.
#[test]
fn rest_is_whole_frames_in_a_row() {
    let mut doubtful = 0;
    for seed in 0..10 {
        let mut link = sim(&format!("busy=0us..9us,seed={seed},frame=st12,nE,nW,crc6"));
        let protocol = BissC::new("st12,nE,nW,crc6".parse().unwrap());
        let mut master = Master::new(&mut link, &protocol, Some(0));
        assert!(master.open().unwrap());
        let mut in_row = 0;
        for _ in 0..200 {
            if master.slot(0, None).unwrap() == (Slot::Done { tries: 1 }) {
                in_row += 1;
            } else {
                (doubtful, in_row) = (doubtful + 1, 1);
                assert!(!master.rests());
            }
            if in_row >= REST_FRAMES {
                assert!(master.rests());
                master.reset_bus().unwrap();
                assert!(!master.rests());
                in_row = 0;
            }
        }
    }
    println!("{doubtful} doubtful");
    assert!(doubtful > 0);
}

/// In reduced frames a command takes two clocks a frame, and the timeout.
#[test]
fn reduced_frames_have_two_clocks() {
    let config = "frame=st12,nE,nW,crc6";
    let (mut soon, mut late) = (sim(config), sim_wave(config));
    let links: [&mut dyn Link; 2] = [&mut soon, &mut late];
    for link in links {
        let protocol = BissC::new("st12,nE,nW,crc6".parse().unwrap());
        let mut master = Master::new(link, &protocol, Some(0));
        assert!(master.open().unwrap());
        let access = Access::Command {
            slaves: 0,
            code: 2,
            checked: true,
            reduced: true,
        };
        master.ask(access).unwrap();
        let mut frames = 0;
        let outcome = loop {
            master.slot(0, None).unwrap();
            assert_eq!(
                (master.cycle().fault(), master.trace().bits.len()),
                (None, 2)
            );
            frames += 1;
            if let Some(outcome) = master.outcome() {
                break outcome;
            }
        };
        assert_eq!(outcome.failure, None);
        assert!(frames <= 18 + u32::from(REST_FRAMES), "{frames}");
        // The next one is a whole frame again.
        master.slot(0, None).unwrap();
        assert!(master.cycle().words()[0].good().is_some());
    }
}

/// A frame that is left after its head leaves SL at a bit of data: a 1 there, or one that is still under way, does not mean that
/// the slave is ready.
#[test]
fn data_is_not_taken_for_readiness() {
    for position in ["0", "4095", "2047", "1023", "1365", "2730"] {
        for delay in ["0us", "3us", "5us", "11us", "35us"] {
            for timeout in ["12500ns", "40us"] {
                let config = format!(
                    "motion=still,pos={position},delay={delay},timeout={timeout},frame=st12,nE,nW,crc6"
                );
                let work = |registers: &mut Registers<'_, '_>| {
                    assert_eq!(registers.read(0, 0x78, 2).unwrap(), b"BI", "{config}");
                    registers.write(0, 0x50, &[0x5A], true).unwrap();
                    registers.command(0, 2, true, true).unwrap();
                    assert_eq!(registers.retries(), 0, "{config}");
                };
                with(&mut sim(&config), work);
                with(&mut sim_wave(&config), work);
            }
        }
    }
}

/// A byte that was waited for may be a shifted one, so it is read again; one that came at once is not.
#[test]
fn a_byte_that_was_waited_for_is_read_again() {
    for (busy, readings) in [("0us", 1), ("1ms", 2)] {
        let mut link = sim(&format!("reg-busy={busy},frame=st12,nE,nW,crc6"));
        let watch = link.clone();
        watch.slave(|slave| slave.record_events(true));
        with(&mut link, |registers| registers.read(0, 0x78, 2)).unwrap();
        assert_eq!(watch.slave(|slave| slave.take_events()).len(), 2 * readings);
    }
}
