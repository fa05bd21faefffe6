//! What the simulated slave does wrong when it is told to, and what its registers say of it.
#![allow(clippy::print_stdout, clippy::unwrap_used)]
mod common;
#[path = "common/wire.rs"]
mod wire;
use biss::slave::Event;
use wire::{Wire, after_start, command, crc4, register};

const READ: (&str, &str) = (
    "110001111000010110100000000000000",
    "010000000000000001010100001011100",
);
const WRITE: (&str, &str) = (
    "110000010000001101101011010000000",
    "010000000000000000110101101000000",
);

/// CDS of a control frame, and where it differs from `cds`.
fn differs(wire: &mut Wire, (cdm, cds): (&str, &str)) -> Vec<usize> {
    wire.reset();
    let seen = wire.control(cdm);
    (0..cds.len())
        .filter(|n| seen[*n..=*n] != cds[*n..=*n])
        .collect()
}

#[test]
fn each_fault_is_what_it_says() {
    let both = |knob: &str| {
        let mut wire = Wire::new(&format!("{knob}=1,frame=st4"));
        let read = differs(&mut wire, READ);
        let mut wire = Wire::new(&format!("{knob}=1,frame=st4"));
        wire.slave.record_events(true);
        let write = differs(&mut wire, WRITE);
        (read, write, wire.slave.take_events().len())
    };
    assert_eq!(
        both("life-stuck"),
        (vec![], vec![], 1),
        "a knob of another kind"
    );
    assert_eq!(both("idl-wrong"), (vec![1], vec![1], 1));
    // W comes back inverted, and nothing after it.
    let ones = |cds: &str, from: usize| -> Vec<usize> {
        let bits = cds.char_indices().skip(from);
        bits.filter(|(_, bit)| *bit == '1')
            .map(|(n, _)| n)
            .collect()
    };
    let refused = |cds| [vec![18], ones(cds, 19)].concat();
    assert_eq!(both("w-inverted"), (refused(READ.1), refused(WRITE.1), 0));
    assert_eq!(both("no-s"), (ones(READ.1, 19), ones(WRITE.1, 19), 0));
    assert_eq!(both("stop-bit"), (vec![32], vec![32], 1));
    assert_eq!(both("data-crc"), (vec![31], vec![], 1));
    assert_eq!(both("write-lost"), (vec![], vec![], 0));
    let (read, write, stored) = both("echo-wrong");
    assert!(read.is_empty() && (20..28).contains(&write[0]) && write.len() == 1);
    assert_eq!(stored, 1);
    // All of CDS, and all of CDM.
    let (read, write, stored) = both("cds-flip");
    assert_eq!((read.len(), write.len(), stored), (33, 33, 1));
    let mut wire = Wire::new("cdm-flip=1,frame=st4");
    let inverted: String = WRITE
        .0
        .chars()
        .map(|bit| if bit == '1' { '0' } else { '1' })
        .collect();
    wire.control("11111111111111");
    assert_eq!(wire.control(&inverted), WRITE.1);
    assert_eq!(wire.slave.take_cdm(), Some(false));
}

#[test]
fn a_stop_bit_ends_a_sequence_that_has_more() {
    let mut wire = Wire::new("stop-bit=1,frame=st4");
    assert_eq!(wire.write(0, 0x10, &[1, 2, 3]), Some((1, true)));
    assert_eq!(wire.read(0, 0x10, 3), Some((vec![1], true)));
    assert_eq!(wire.slave.peek(0, 0, 0x11), Some(0));
}

#[test]
fn a_wrong_idl_gives_an_id_twice() {
    let mut wire = Wire::new("idl-wrong=1,slaves=1:0,frame=st4");
    wire.reset();
    let seen = wire.control(&format!("1{}", register(0, 0x10)));
    assert!(!seen.contains('1'), "{seen}");
    assert_eq!(wire.write(0, 0x10, &[7]), Some((1, false)));
    assert_eq!([0, 1].map(|id| wire.slave.peek(id, 0, 0x10)), [Some(7); 2]);
}

#[test]
fn a_wrong_ida_is_acknowledged_by_the_others() {
    let mut wire = Wire::new("ida-wrong=1,slaves=1:0:0,frame=st4");
    wire.slave.record_events(true);
    wire.reset();
    let seen = wire.control(&format!("1{}00000001", command(&[1], 3)));
    assert_eq!(&seen[17..], "10100000");
    let done = Event::Command {
        id: 1,
        command: 3,
        broadcast: false,
    };
    assert_eq!(wire.slave.take_events(), [done]);
}

/// As often as asked, and the same way for the same seed.
#[test]
fn faults_come_as_often_as_asked() {
    let rounds = 400;
    let run = |knob: &str, seed: u32| {
        let mut wire = Wire::new(&format!("{knob}=20%,seed={seed},frame=st4"));
        wire.period_ns = 100;
        wire.clocks = 4;
        (0..rounds)
            .map(|_| [differs(&mut wire, READ), differs(&mut wire, WRITE)].concat())
            .collect::<Vec<_>>()
    };
    for (knob, hits) in [
        ("idl-wrong", 2),
        ("w-inverted", 2),
        ("no-s", 2),
        ("stop-bit", 2),
        ("data-crc", 1),
        ("echo-wrong", 1),
        ("cds-flip", 66),
    ] {
        let found = run(knob, 3);
        assert_eq!(found, run(knob, 3));
        assert_ne!(found, run(knob, 4), "{knob}");
        let per_hit = match knob {
            "w-inverted" => 13,
            "no-s" => 11,
            _ => 2,
        };
        let count: usize = found.iter().map(Vec::len).sum();
        // One in five; each refused frame differs in several places.
        let want = rounds * hits * per_hit / 2 / 5;
        assert!(
            (want * 3 / 4..want * 5 / 4).contains(&count),
            "{knob}: {count}, not {want}"
        );
    }
}

#[test]
fn register_faults_leave_the_data_alone() {
    let frames = |knobs: &str, control: bool| {
        let mut wire = Wire::new(&format!("{knobs},jitter=100ns,flip=5%,error=20%,seed=9"));
        let cdm = if control {
            WRITE.0
        } else {
            "000000000000000000000000000000000"
        };
        let words = |seen: String| after_start(&seen)[1..].to_owned();
        let mut seen = Vec::new();
        for bit in cdm.chars() {
            // In the same rhythm, whatever CDM is.
            seen.push(words(wire.clock(wire.clocks)));
            wire.rest(bit == '1');
        }
        seen
    };
    let knobs = "reg-busy=0us..1ms,no-s=30%,cds-flip=0%,echo-wrong=50%,cdm-flip=0%";
    assert_eq!(frames("cds=0", true), frames(knobs, true));
}

#[test]
fn events_are_bounded_and_only_kept_when_wanted() {
    let mut wire = Wire::new("frame=st4");
    wire.read(0, 0, 1).unwrap();
    assert_eq!(wire.slave.take_events(), []);
    wire.slave.record_events(true);
    wire.read(0, 0x78, 2).unwrap();
    wire.slave.record_events(false);
    wire.read(0, 0, 1).unwrap();
    let addresses: Vec<Event> = [(0x78, b'B'), (0x79, b'I')]
        .map(|(address, value)| Event::Read {
            id: 0,
            bank: 0,
            address,
            value,
        })
        .into();
    assert_eq!(wire.slave.events().copied().collect::<Vec<_>>(), addresses);
    assert_eq!(wire.slave.take_events(), addresses);
}

fn dump(wire: &Wire, bank: u8, addresses: std::ops::Range<u8>) -> String {
    let cells = addresses.map(|address| match wire.slave.peek(0, bank, address) {
        Some(byte) => format!("{byte:02X}"),
        None => "--".into(),
    });
    cells.collect::<Vec<_>>().join(" ")
}

/// The dump of iC-Haus AN22, "BiSS Reader Content".
#[test]
fn the_mhm_is_the_published_one() {
    let mut wire = Wire::new("device=mhm");
    let refused = |count: usize| vec!["--"; count].join(" ");
    let bytes = |byte: &str, count: usize| vec![byte; count].join(" ");
    assert_eq!(
        dump(&wire, 0, 0..0x40),
        format!(
            "48 44 00 78 80 00 00 00 CF 80 00 00 23 00 00 00 00 00 00 8C {}",
            refused(0x2C)
        )
    );
    assert_eq!(
        dump(&wire, 0, 0x40..0x80),
        format!(
            "00 02 62 1E FF FF FF FF 00 00 00 00 00 00 8C FF {} 00 01 15 15 {} 4D 48 4D 23 44 00 69 43",
            bytes("FF", 0x20),
            refused(4)
        )
    );
    assert_eq!(wire.clocks, 5 + 30 + 6);
    assert_eq!(wire.read(0, 0x14, 1), None);
    assert_eq!(wire.read(0, 0x13, 2), Some((vec![0x8C], true)));
    // Its EDS, by way of BSEL.
    assert_eq!(wire.write(0, 0x40, &[2]), Some((1, false)));
    let (eds, _) = wire.read(0, 0, 0x18).unwrap();
    assert_eq!(eds[0x10..0x18], [1, 1, 0, 0, 3, 30, 0, 0x21]);
    assert_eq!(wire.write(0, 0x40, &[3]), Some((1, false)));
    let (profile, _) = wire.read(0, 0x0A, 1).unwrap();
    assert_eq!(profile, [12]);
    // A frame of its own beats that of the registers.
    assert_eq!(Wire::new("device=mhm,frame=st8").clocks, 5 + 8);
}

#[test]
fn own_registers_describe_own_channels() {
    // Channels of the one slave; BP_ID; bank, DLEN, FORMAT and CPOLY of each channel.
    for (format, profile, channels) in [
        ("mt12,st20,nE,nW,crc6", "62 22", "10 22 00 21"),
        ("st26,nE,nW,crc6", "62 1C", "10 1C 00 21"),
        ("pos32,nE,nW,crc6:0x43:plain", "00 00", "10 22 00 00"),
        ("st26,E,W,crc6", "00 00", "00 1C 00 21"),
        ("st12,nE,nW,lc6,crc16", "72 14", "10 14 00 00"),
        ("data16=temp,crc5", "10 00", "00 10 00 12"),
        ("data16=temp,crc8", "00 00", "00 10 00 97"),
        ("data16", "00 00", "00 10 00 00"),
        (
            "mt12,st24,nE,nW,crc6+mt12,st24,nE,nW,lc6,crc16",
            "00 00",
            "10 26 00 21 11 2C 00 00",
        ),
    ] {
        let wire = Wire::new(&format!("ack=3,frame={format}"));
        assert_eq!(
            dump(&wire, 0, 0x40..0x48),
            format!("00 02 {profile} 00 01 86 A1")
        );
        let count = format.split('+').count();
        let spare = "00 ".repeat(32 - 4 * count);
        assert_eq!(
            dump(&wire, 2, 0..0x40),
            format!(
                "01 01 04 05 64 {}02 00 00 0{count} 01 00 00 {channels} {spare}{}",
                "00 ".repeat(8),
                "00 ".repeat(12).trim_end()
            ),
            "{format}"
        );
        assert_eq!(dump(&wire, 0, 0x78..0x80), "42 49 53 53 49 4D 00 00");
    }
    let wire = Wire::new("frame=mt12,st24,nE,nW,crc6+mt4,pos30,nE,nW,lc6,crc16:0x190D9:init=5+st8");
    assert_eq!(dump(&wire, 0x10, 0x08..0x0C), "00 00 0C 00");
    assert_eq!(dump(&wire, 0x10, 0x14..0x18), "01 00 00 00");
    assert_eq!(dump(&wire, 0x10, 0x1C..0x24), "00 00 00 43 00 00 00 00");
    assert_eq!(dump(&wire, 0x11, 0x08..0x0C), "01 00 04 00");
    assert_eq!(dump(&wire, 0x11, 0x14..0x18), "00 00 00 00");
    assert_eq!(dump(&wire, 0x11, 0x1C..0x24), "00 01 90 D9 00 00 00 05");
    assert_eq!(wire.slave.peek(0, 0x12, 0), None);
    assert_eq!(wire.slave.peek(0, 1, 0), None);
    // Each slave speaks of its own.
    let wire = Wire::new("slaves=1:0:1,frame=st8,nE,nW,crc6+data9,crc5");
    let profile = |id| [0x42, 0x43].map(|address| wire.slave.peek(id, 0, address));
    assert_eq!(profile(0), [Some(9), Some(0)]);
    assert_eq!(profile(1), [Some(0); 2]);
    assert_eq!(profile(2), [Some(0x62), Some(10)]);
    assert_eq!(
        [0, 1, 2].map(|id| wire.slave.peek(id, 2, 0x10)),
        [1, 0, 1].map(Some)
    );
}

#[test]
fn read_only_and_refused_addresses_may_lie_anywhere() {
    let mut wire = Wire::new("refuse=62..0x41,read-only=0x0A..0x0B,frame=st4");
    for address in 0x3E..=0x41 {
        assert_eq!(wire.slave.peek(0, 0, address), None);
        assert_eq!(wire.slave.peek(0, 5, address), None);
    }
    assert!(!wire.slave.poke(0, 0, 0x3E, 1));
    assert_eq!(wire.read(0, 0x3D, 2), Some((vec![0], true)));
    assert_eq!(wire.write(0, 0x09, &[1, 2]), Some((1, true)));
    assert_eq!(wire.write(0, 0x0A, &[1]), None);
    assert!(wire.slave.poke(0, 0, 0x0A, 9));
    assert_eq!(wire.read(0, 0x09, 2), Some((vec![1, 9], false)));
}

const PAIR: &str = "mt12,st24,nE,nW,crc6+mt12,st24,nE,nW,lc6,crc16";

#[test]
fn a_pair_differs_by_a_quarter_turn() {
    let mut wire = Wire::new(&format!("pair-differs=30%,seed=5,frame={PAIR}"));
    let mut differ = 0;
    for _ in 0..1_000 {
        wire.frame(false);
        let words = wire.slave.latched();
        let (first, second) = (words[0] >> 2 & 0xFF_FFFF, words[1] >> 8 & 0xFF_FFFF);
        if first == second {
            continue;
        }
        assert_eq!(second, (first + (1 << 22)) & 0xFF_FFFF);
        differ += 1;
    }
    assert!((230..370).contains(&differ), "{differ}");
}

#[test]
fn signs_of_life_count() {
    let lives = |knobs: &str, frames: usize| -> Vec<u64> {
        let mut wire = Wire::new(&format!("{knobs},frame=st4,lc3"));
        (0..frames)
            .map(|_| {
                wire.frame(false);
                wire.slave.latched()[0] & 7
            })
            .collect()
    };
    assert_eq!(lives("seed=1", 10), [1, 2, 3, 4, 5, 6, 7, 0, 1, 2]);
    assert_eq!(
        lives("life-skips-zero=1", 10),
        [1, 2, 3, 4, 5, 6, 7, 1, 2, 3]
    );
    assert_eq!(lives("life-stuck=1", 3), [0, 0, 0]);
    let stuck = lives("life-stuck=50%", 400);
    let same = stuck.windows(2).filter(|pair| pair[0] == pair[1]).count();
    assert!((150..250).contains(&same), "{same}");
}

/// One shaft, however many bits a channel has for it.
#[test]
fn channels_of_different_widths_show_one_angle() {
    let mut rng = common::rng();
    for _ in 0..common::size(200) {
        let (one, two) = (rng.u8(1..=40), rng.u8(1..=40));
        let motion = match rng.u8(..3) {
            0 => format!("motion=speed,rpm={}", rng.i32(-6000..6000)),
            1 => "motion=sine,degrees=400,period=1ms".into(),
            _ => "motion=count".into(),
        };
        let mut wire = Wire::new(&format!(
            "{motion},turn={},pos={},frame=data4,crc3+mt9,st{one}+pos{two},mt9",
            rng.u16(..),
            rng.u64(..1 << one),
        ));
        for _ in 0..10 {
            wire.frame(false);
            let words = wire.slave.latched();
            let (turn, first) = (words[1] >> one, words[1] & ((1 << one) - 1));
            let (second, same_turn) = (words[2] >> 9, words[2] & 0x1FF);
            assert_eq!(turn, same_turn);
            let common = one.min(two);
            assert_eq!(first >> (one - common), second >> (two - common));
        }
    }
}

/// The one that the strings above are made of.
#[test]
fn the_strings_are_consistent() {
    assert_eq!(&READ.0[1..16], register(0, 0x78));
    assert_eq!(
        &READ.1[20..32],
        format!("{:08b}{}", b'B', crc4(&format!("{:08b}", b'B')))
    );
}
