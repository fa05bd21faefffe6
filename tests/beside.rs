//! Control communication in company: beside sensor data, overheard, on late links, among other slaves, and when it is time to
//! end.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;
#[path = "common/links.rs"]
mod links;

use biss::control::{Access, Failure, Heard, Listener, MAX_IDS, Outcome, Spoken};
use biss::frame::BissC;
use biss::link::Link;
use biss::master::{Master, Slot};
use biss::registers::{BANK_SELECT, Registers, Trouble};
use biss::slave::Event;
use fastrand::Rng;
use links::{HasSlave, map, sim, sim_wave, with};

const ONE: &str = "st12,nE,nW,crc6";

/// As many slaves, each with one channel.
fn chain(slaves: usize) -> String {
    format!("slaves=each,frame={}", vec![ONE; slaves].join("+"))
}

fn any_access(rng: &mut Rng, slaves: u8) -> Access {
    let slave = rng.u8(..slaves);
    let address = rng.u8(..0x80);
    let most = 0x80 - address;
    match rng.u8(..5) {
        0 => Access::Command {
            slaves: rng.u8(..) & ((1u16 << slaves) - 1) as u8,
            // Nothing that takes a slave off the line.
            code: rng.u8(2..=3),
            checked: rng.bool(),
            reduced: false,
        },
        1 | 2 => {
            // Bank select stays, so that the map does.
            let address = [0x00, 0x48, 0x70][rng.usize(..3)] + rng.u8(..8);
            let data: Vec<u8> = (0..rng.usize(1..=3)).map(|_| rng.u8(..)).collect();
            Access::Write {
                slave,
                address,
                data: data.as_slice().into(),
            }
        }
        _ => Access::Read {
            slave,
            address,
            count: rng.u8(1..=most.min(6)),
        },
    }
}

/// Slots beside which registers are accessed, or not: what they deliver.
fn delivered<L: Link>(mut link: L, slots: usize, talk: Option<&mut Rng>) -> Vec<u64> {
    let format = ONE.parse().unwrap();
    let protocol = BissC::new(format);
    let mut master = Master::new(&mut link, &protocol, Some(0));
    assert!(master.open().unwrap());
    let (mut talk, mut accesses) = (talk, 0);
    let mut busy = false;
    let positions = (0..slots)
        .map(|_| {
            if let (Some(rng), false) = (&mut talk, busy) {
                master.ask(any_access(rng, 1)).unwrap();
                busy = true;
            }
            assert_eq!(master.slot(0, None).unwrap(), Slot::Done { tries: 1 });
            if master.outcome().is_some() {
                (busy, accesses) = (false, accesses + 1);
            }
            master.cycle().words()[0].good().unwrap() >> 2
        })
        .collect();
    assert!(talk.is_none() || accesses > 3, "{accesses}");
    positions
}

/// No position is lost, doubled or late because registers are accessed meanwhile.
#[test]
fn sensor_data_flows_on() {
    let mut rng = common::rng();
    for _ in 0..common::size(6) {
        let knobs = ["", "reg-busy=0us..300us,", "delay=3us,", "busy=2us,"];
        let config = format!("motion=count,{}frame={ONE}", rng.choice(&knobs).unwrap());
        println!("{config}");
        let slots = 1_000;
        let alone = delivered(sim(&config), slots, None);
        assert!(alone.windows(2).all(|pair| pair[1] == (pair[0] + 1) % 4096));
        assert_eq!(delivered(sim(&config), slots, Some(&mut rng)), alone);
        let alone = delivered(sim_wave(&config), slots, None);
        assert!(alone.windows(2).all(|pair| pair[1] == (pair[0] + 1) % 4096));
        assert_eq!(delivered(sim_wave(&config), slots, Some(&mut rng)), alone);
    }
}

/// What a listener has heard, as the slaves would tell it.
fn told(heard: &[Heard], slaves: usize) -> Vec<Event> {
    let mut events = Vec::new();
    for heard in heard {
        match heard.spoken {
            Spoken::Read {
                slave,
                address,
                value,
            } => events.push(Event::Read {
                id: slave.into(),
                bank: 0,
                address,
                value,
            }),
            Spoken::Written {
                slave,
                address,
                value,
            } => events.push(Event::Write {
                id: slave.into(),
                bank: 0,
                address,
                value,
            }),
            Spoken::Command {
                slaves: ids,
                code,
                executed: true,
                ..
            } => events.extend(
                (0..slaves)
                    .filter(|id| ids == 0 || ids >> id & 1 == 1)
                    .map(|id| Event::Command {
                        id,
                        command: code,
                        broadcast: ids == 0,
                    }),
            ),
            _ => {}
        }
    }
    events
}

/// Long traffic of all kinds, some of it given up; what the slaves did and what the listener heard of it.
fn overheard<L: Link + HasSlave + Clone>(
    mut link: L,
    rng: &mut Rng,
    accesses: usize,
) -> (Vec<Event>, Vec<Event>) {
    let watch = link.clone();
    watch.slave(|slave| slave.record_events(true));
    let slaves = watch.slave(|slave| slave.devices());
    let protocol = BissC::head_only();
    let mut master = Master::new(&mut link, &protocol, Some(0));
    assert!(master.open().unwrap());
    let (mut listener, mut heard) = (Listener::new(), Vec::new());
    let mut frame = |master: &mut Master<'_>| {
        master.slot(0, None).unwrap();
        match (master.cycle().fault(), master.cycle().head()) {
            (None, Some(head)) => heard.extend(listener.frame(
                master.trace().t_ns,
                master.trace().cdm.unwrap(),
                head.cds,
            )),
            _ => drop(listener.lost()),
        }
    };
    // What a listener needs before it understands anything.
    for _ in 0..14 {
        frame(&mut master);
    }
    for _ in 0..accesses {
        master.ask(any_access(rng, slaves as u8)).unwrap();
        let patience = if rng.u8(..4) == 0 {
            rng.usize(..80)
        } else {
            100_000
        };
        for _ in 0..patience {
            frame(&mut master);
            if master.outcome().is_some() {
                break;
            }
        }
        master.give_up();
        for _ in 0..rng.usize(..40) {
            frame(&mut master);
        }
    }
    for _ in 0..100 {
        frame(&mut master);
    }
    let heard = told(&heard, slaves);
    (watch.slave(|slave| slave.take_events()), heard)
}

#[test]
fn a_listener_hears_what_slaves_do() {
    let mut rng = common::rng();
    let mut events = 0;
    for _ in 0..common::size(6) {
        let slaves = rng.usize(1..=3);
        let knobs = [
            "",
            "reg-busy=0us..500us,",
            "read-only=0x04..0x4f,",
            "refuse=0x02..0x60,refusal=silent,",
            "w-inverted=0.2,stop-bit=0.2,",
        ];
        let knobs = rng.choice(&knobs).unwrap();
        let config = format!("seed={},{knobs}{}", rng.u32(..), chain(slaves));
        let (done, heard) = match rng.bool() {
            true => overheard(sim(&config), &mut rng, 60),
            false => overheard(sim_wave(&config), &mut rng, 60),
        };
        println!("{config}: {} events", done.len());
        events += done.len();
        assert_eq!(heard, done, "{config}");
    }
    assert!(events > 10, "{events}");
}

/// Where frames are lost it hears less, and nothing else.
#[test]
fn a_listener_invents_nothing() {
    let mut rng = common::rng();
    for _ in 0..common::size(6) {
        let slaves = rng.usize(1..=3);
        let config = format!(
            "seed={},no-ack=0.01,no-start=0.01,{}",
            rng.u32(..),
            chain(slaves)
        );
        let (done, heard) = overheard(sim(&config), &mut rng, 60);
        println!("{config}: {} events, {} heard", done.len(), heard.len());
        let mut rest = done.iter();
        assert!(
            heard.iter().all(|event| rest.any(|done| done == event)),
            "{config}"
        );
        assert!(heard.len() > 10 && heard.len() <= done.len());
    }
}

/// What an access has come to, without how long it took.
fn result(outcome: &Outcome) -> (Vec<u8>, Option<Failure>) {
    let failure = outcome.failure.map(|failure| match failure {
        Failure::Silent { address, .. } => Failure::Silent {
            address,
            waited_ns: 0,
        },
        other => other,
    });
    (outcome.bytes.as_slice().to_vec(), failure)
}

/// The same accesses on a link that reacts and on one that is late.
#[test]
fn a_late_link_does_the_same() {
    let mut rng = common::rng();
    for _ in 0..common::size(8) {
        let slaves = rng.usize(1..=4);
        let knobs = [
            "",
            "reg-busy=0us..300us,",
            "refuse=0x02..0x0a,",
            "read-only=0x05..0x4f,",
        ];
        let config = format!("{}{}", rng.choice(&knobs).unwrap(), chain(slaves));
        let accesses: Vec<Access> = (0..40)
            .map(|_| any_access(&mut rng, slaves as u8))
            .collect();
        let run = |registers: &mut Registers<'_, '_>| -> Vec<Outcome> {
            let all = accesses.iter();
            all.map(|access| registers.access(*access).unwrap())
                .collect()
        };
        let (mut soon, mut late) = (sim(&config), sim_wave(&config));
        let (watch_soon, watch_late) = (soon.clone(), late.clone());
        let (by_soon, by_late) = (with(&mut soon, run), with(&mut late, run));
        for ((access, soon), late) in accesses.iter().zip(&by_soon).zip(&by_late) {
            assert_eq!(result(soon), result(late), "{config}: {access:?}");
            let bytes = late.bytes.as_slice().len() as u32;
            if matches!(access, Access::Write { .. }) && bytes > 0 {
                // A control frame for each byte, and the rest between them.
                assert!(late.frames >= 33 * bytes + 13 * (bytes - 1), "{late:?}");
            }
        }
        let map = |slave: &mut biss::slave::Slave| map(slave, &[0]);
        assert_eq!(watch_soon.slave(map), watch_late.slave(map), "{config}");
    }
}

/// One to eight slaves: each has its ID and its registers, and commands go to whom they are for.
#[test]
fn every_slave_of_a_chain_is_itself() {
    let mut rng = common::rng();
    for slaves in 1..=8usize {
        let config = format!("seed={},{}", rng.u32(..), chain(slaves));
        let mut link = sim(&config);
        let watch = link.clone();
        watch.slave(|slave| slave.record_events(true));
        with(&mut link, |registers| {
            for id in 0..slaves as u8 {
                let data = [id, rng.u8(..), rng.u8(..)];
                registers.write(id, 0x50, &data, true).unwrap();
                assert_eq!(usize::from(registers.present()), slaves);
                for address in [0x44, 0x50, 0x78] {
                    let read = registers.read(id, address, 4).unwrap();
                    let there: Vec<u8> = (address..address + 4)
                        .map(|at| watch.slave(|slave| slave.peek(id.into(), 0, at)).unwrap())
                        .collect();
                    assert_eq!(read, there, "{id} {address:#x}");
                }
            }
            if slaves < 8 {
                let absent = registers.read(slaves as u8, 0x78, 1).unwrap_err();
                let want = Failure::Absent {
                    slave: slaves as u8,
                    present: slaves as u8,
                };
                assert!(matches!(absent, Trouble::Slave { failure, .. } if failure == want));
            }
            for _ in 0..5 {
                watch.slave(|slave| slave.take_events());
                let ids = rng.u8(1..) & ((1u16 << slaves) - 1) as u8;
                let code = rng.u8(2..=3);
                registers.command(ids, code, true, false).unwrap();
                let want: Vec<Event> = (0..slaves)
                    .filter(|id| ids == 0 || ids >> id & 1 == 1)
                    .map(|id| Event::Command {
                        id,
                        command: code,
                        broadcast: ids == 0,
                    })
                    .collect();
                assert_eq!(watch.slave(|slave| slave.take_events()), want);
            }
            // Data channels: off for all, on for some. Broadcasts in reduced frames, too.
            for reduced in [false, true] {
                registers.command(0, 0, true, reduced).unwrap();
                let on = |id| watch.slave(|slave| slave.data_active(id));
                assert!((0..slaves).all(|id| !on(id)));
                let ids = rng.u8(1..) & ((1u16 << slaves) - 1) as u8 | 1;
                registers.command(ids, 0, true, false).unwrap();
                assert!((0..slaves).all(|id| on(id) == (ids >> id & 1 == 1)));
            }
        });
    }
}

/// A ninth slave has no ID. It gets one when others give theirs up, and all have theirs again after the broadcast.
#[test]
fn nine_slaves_are_more_than_eight() {
    for reduced in [false, true] {
        let shares = "slaves=1:0:0:0:0:0:0:0:0";
        let mut link = sim(&format!("{shares},frame={ONE}"));
        let watch = link.clone();
        let serial = |id: usize| -> Vec<u8> {
            let byte = |at| watch.slave(|slave| slave.peek(id, 0, at)).unwrap();
            (0x44..0x48).map(byte).collect()
        };
        with(&mut link, |registers| {
            for id in 0..MAX_IDS {
                assert_eq!(registers.read(id, 0x44, 4).unwrap(), serial(id.into()));
                assert_eq!(registers.present(), 9);
            }
            // The two farthest away; those before them move up.
            registers.command(0b11, 1, true, false).unwrap();
            for id in 0..7 {
                let read = registers.read(id, 0x44, 4).unwrap();
                assert_eq!(read, serial(usize::from(id) + 2));
            }
            assert_eq!(registers.present(), 7);
            assert!(registers.read(7, 0x44, 1).is_err());
            registers.command(0, 1, true, reduced).unwrap();
            assert_eq!(registers.read(0, 0x44, 4).unwrap(), serial(0));
            assert_eq!(registers.count().unwrap(), 9);
        });
    }
}

/// Something to be interrupted. Whether it went through.
type Work = fn(&mut Registers<'_, '_>) -> Result<(), Trouble>;

const WORKS: [(&str, Work); 5] = [
    ("read", |registers| registers.read(0, 0x78, 3).map(drop)),
    ("write", |registers| {
        registers.write(0, 0x50, &[0x5A, 0xC3], true)
    }),
    ("command", |registers| {
        registers.command(1, 3, true, false).map(drop)
    }),
    ("broadcast", |registers| {
        registers.command(0, 3, true, true).map(drop)
    }),
    ("bank", |registers| {
        registers.within(0, 4, |registers| registers.write(0, 0x10, &[0x77], true))
    }),
];

/// Ends the work after so many frames. Whether it was over before.
fn stopped<L: Link + HasSlave + Clone>(mut link: L, name: &str, work: Work, frames: u64) -> bool {
    let (watch, second) = (link.clone(), link.clone());
    let before = watch.slave(|slave| map(slave, &[0, 4]));
    watch.slave(|slave| slave.record_events(true));
    let protocol = BissC::head_only();
    let mut master = Master::new(&mut link, &protocol, None);
    assert!(master.open().unwrap());
    let end = watch.slave(|slave| slave.timeouts()) + frames;
    let stop = || watch.slave(|slave| slave.timeouts()) >= end;
    master.stop_when(&stop);
    let mut registers = Registers::new(&mut master);
    let result = work(&mut registers);
    match &result {
        Ok(()) | Err(Trouble::Stopped) => {}
        Err(other) => panic!("{name} after {frames}: {other}"),
    }
    registers.rest().unwrap();
    if matches!(result, Err(Trouble::Stopped)) && name != "bank" {
        let more = watch.slave(|slave| slave.timeouts()) - end;
        assert!(
            more < 40,
            "{name} after {frames}: goes on for {more} frames"
        );
    }
    assert!(registers.master().rests(), "{name} after {frames}");
    drop(master);
    let events = watch.slave(|slave| slave.take_events());
    let after = watch.slave(|slave| map(slave, &[0, 4]));
    let wanted = |key: &(usize, u8, u8), value: u8| match (name, *key) {
        ("write", (0, 0, 0x50)) => value == 0x5A,
        ("write", (0, 0, 0x51)) => value == 0xC3,
        ("bank", (0, 4, 0x10)) => value == 0x77,
        _ => false,
    };
    for (key, value) in &after {
        let same = before.get(key) == Some(value);
        assert!(
            same || wanted(key, *value),
            "{name} after {frames}: {key:x?} {value:#x}"
        );
    }
    let executed = links::commands(&events);
    assert!(executed <= usize::from(name == "command" || name == "broadcast"));
    if result.is_ok() && executed == 0 {
        assert!(!name.contains("command") && !name.contains("broadcast"));
    }
    // Another master finds everything as it is, and nobody waiting.
    let mut second = second;
    let there: Vec<u8> = (0x4E..0x54)
        .filter_map(|at| after.get(&(0, 0, at)).copied())
        .collect();
    with(&mut second, |registers| {
        assert_eq!(registers.read(0, 0x4E, 6).unwrap(), there);
        assert_eq!(registers.read(0, BANK_SELECT, 1).unwrap(), [0]);
        assert_eq!(registers.retries(), 0, "{name} after {frames}");
    });
    let now = watch.slave(|slave| map(slave, &[0, 4]));
    assert_eq!(now, after, "{name} after {frames}");
    result.is_ok()
}

/// Whenever it is time to end, the slave is led out of what was going on, and no byte is written but those that were to be.
#[test]
fn it_can_be_ended_at_any_frame() {
    let config = format!("frame={ONE}");
    for (name, work) in WORKS {
        for late in [false, true] {
            let whole = (0..2_000).find(|frames| match late {
                true => stopped(sim_wave(&config), name, work, *frames),
                false => stopped(sim(&config), name, work, *frames),
            });
            println!("{name}, late {late}: {whole:?} frames");
            assert!(whole.is_some_and(|frames| frames > 14));
        }
    }
}
