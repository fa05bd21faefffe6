//! The simulated slave's registers and commands, seen from its two wires.
#![allow(clippy::print_stdout, clippy::unwrap_used)]
mod common;
#[path = "common/wire.rs"]
mod wire;
use biss::slave::Event;
use wire::{Wire, command, crc4, register};

/// CDM as sent, CDS as it must come back, by what; made by a program that shares nothing with this one, from D2
/// (p. 14-19) and the capture in iC-Haus AN22.
const STRINGS: [(&str, &str, &str, &str); 13] = [
    (
        "read 0x78 = 0x4D",
        "device=mhm",
        "110001111000010110100000000000000",
        "010000000000000001010100110111000",
    ),
    (
        "write 0x10 = 0x5A",
        "",
        "110000010000001101101011010000000",
        "010000000000000000110101101000000",
    ),
    (
        "read 0x7E, 0x7F = 0x69, 0x43, the last ones",
        "device=mhm",
        "11000111111011111010000000000000100000000000000",
        "01000000000000000101011010011010010100001111011",
    ),
    (
        "write 0x10, 0x11 = 0x11, 0x22",
        "",
        "11000001000000110110001000110010100100010001100",
        "01000000000000000011000100011001010010001000110",
    ),
    (
        "read 0x00, 0x01 = 0x48, 0x44, busy before the second",
        "device=mhm,reg-busy=1us",
        "110000000000011010100000000000001100000000000000",
        "010000000000000001010100100000110010100010001000",
    ),
    (
        "select bank 2",
        "device=mhm",
        "110001000000000101100000010100100",
        "010000000000000000110000001010010",
    ),
    (
        "read 0x78 of slave 2 of 3 = 0xA5",
        "slaves=1:0:0",
        "110101111000101010100000000000000",
        "011100000000000001011010010101000",
    ),
    (
        "read 0x78, refused",
        "refuse=0x78",
        "1100011110000101100",
        "0100000000000000011",
    ),
    (
        "write 0x10, refused",
        "read-only=0x10",
        "1100000100000011010",
        "0100000000000000000",
    ),
    (
        "command 0 to all",
        "",
        "1000000000001111110",
        "0100000000000000000",
    ),
    (
        "command 1 to all",
        "",
        "1000000000011100110",
        "0100000000000000000",
    ),
    (
        "command 0 to slave 0",
        "",
        "10100000000000101000000010",
        "01000000000000000100000000",
    ),
    (
        "command 2 to slave 0",
        "",
        "10100000001001001000000010",
        "01000000000000000100000000",
    ),
];

#[test]
fn answers_the_known_strings() {
    for (what, knobs, cdm, cds) in STRINGS {
        let mut wire = Wire::new(&format!("{knobs},frame=st12,nE,nW,crc6"));
        wire.slave.poke(2, 0, 0x78, 0xA5);
        wire.reset();
        assert_eq!(wire.control(cdm), cds, "{what}");
        // Fourteen zeros later everything starts anew.
        wire.reset();
        wire.slave.poke(2, 0, 0x78, 0xA5);
        assert_eq!(wire.control(cdm), cds, "{what}, once more");
    }
}

#[test]
fn does_what_the_known_strings_say() {
    let run = |index: usize| {
        let (_, knobs, cdm, _) = STRINGS[index];
        let mut wire = Wire::new(&format!("{knobs},frame=st12,nE,nW,crc6"));
        wire.slave.record_events(true);
        wire.reset();
        wire.control(cdm);
        wire
    };
    let write = |address, value| Event::Write {
        id: 0,
        bank: 0,
        address,
        value,
    };
    let mut wire = run(1);
    assert_eq!(wire.slave.peek(0, 0, 0x10), Some(0x5A));
    assert_eq!(wire.slave.take_events(), [write(0x10, 0x5A)]);
    assert_eq!(wire.slave.events().count(), 0);
    let mut wire = run(3);
    let events = [write(0x10, 0x11), write(0x11, 0x22)];
    assert_eq!(wire.slave.take_events(), events);
    let mut wire = run(2);
    let read = |address, value| Event::Read {
        id: 0,
        bank: 0,
        address,
        value,
    };
    let events = [read(0x7E, 0x69), read(0x7F, 0x43)];
    assert_eq!(wire.slave.take_events(), events);
    let mut wire = run(5);
    assert_eq!(wire.slave.take_events(), [write(0x40, 2)]);
    for refused in [7, 8] {
        assert_eq!(run(refused).slave.take_events(), []);
    }
    for (index, command, broadcast) in [(9, 0, true), (10, 1, true), (11, 0, false), (12, 2, false)]
    {
        let done = Event::Command {
            id: 0,
            command,
            broadcast,
        };
        assert_eq!(run(index).slave.take_events(), [done]);
    }
}

/// At the timeout of the frame that brings its last bit, and not before.
#[test]
fn acts_when_the_last_bit_is_there() {
    // A byte with its CRC, EX to all, EX to one; S of a byte to be read.
    for (index, last) in [(1, 30), (3, 44), (9, 17), (11, 24), (0, 18)] {
        let (what, knobs, cdm, _) = STRINGS[index];
        let mut wire = Wire::new(&format!("{knobs},frame=st12,nE,nW,crc6"));
        wire.slave.record_events(true);
        wire.reset();
        wire.control(&cdm[..last]);
        let before = wire.slave.events().count();
        wire.clock(wire.clocks);
        if cdm[last..].starts_with('1') {
            wire.slave.ma(wire.t_ns, false);
        }
        let edge = match cdm[last..].starts_with('1') {
            true => wire.t_ns,
            false => wire.t_ns - wire.period_ns / 2,
        };
        wire.slave.slo(edge + 19_999);
        assert_eq!(wire.slave.events().count(), before, "{what}");
        wire.slave.slo(edge + 20_000);
        assert_eq!(wire.slave.events().count(), before + 1, "{what}");
    }
}

/// The published headers (TI motor-control-sdk; iC-Haus AN22) and what a hand can divide.
#[test]
fn this_master_divides_right() {
    for (address, crc) in [(0x40, 0x1), (0x47, 0x8), (0x60, 0xB), (0x78, 0x5), (0, 0x6)] {
        assert!(register(0, address).ends_with(&format!("{crc:04b}")));
    }
    for (byte, crc) in [
        ("01001000", "0011"),
        ("01000100", "0100"),
        ("00000000", "1111"),
    ] {
        assert_eq!(crc4(byte), crc);
    }
}

/// A slave takes a bit for a frame, whatever became of that frame.
#[test]
fn a_cut_frame_is_a_control_bit() {
    let mut rng = common::rng();
    let (_, _, cdm, _) = STRINGS[1];
    for _ in 0..common::size(60) {
        let mut wire = Wire::new("frame=st12,nE,nW,crc6");
        wire.slave.record_events(true);
        wire.reset();
        let mut has_id = false;
        for (n, bit) in cdm.chars().enumerate() {
            let clocks = rng.usize(2..=wire.clocks);
            wire.frame_of(clocks, bit == '1');
            // Where it could not send IDL0 it did not take ID 0.
            has_id |= n == 1 && clocks >= 4;
        }
        assert_eq!(wire.slave.timeouts(), 14 + cdm.len() as u64);
        assert_eq!(wire.slave.take_events().len(), usize::from(has_id));

        // A pause within a frame whose MA happens to be low there is a 1 of its own.
        let mut wire = Wire::new("frame=st12,nE,nW,crc6");
        wire.slave.record_events(true);
        wire.reset();
        let cut = rng.usize(0..cdm.len());
        let low = rng.bool();
        let mut sent = String::new();
        for (n, bit) in cdm.chars().enumerate() {
            if n == cut {
                wire.clock(rng.usize(4..wire.clocks));
                wire.rest(low);
                sent.push(if low { '1' } else { '0' });
            }
            wire.frame(bit == '1');
            sent.push(bit);
        }
        assert_eq!(wire.slave.timeouts(), 14 + sent.len() as u64);
        // The same bits without a cut do the same.
        let mut whole = Wire::new("frame=st12,nE,nW,crc6");
        whole.slave.record_events(true);
        whole.reset();
        whole.control(&sent);
        assert_eq!(
            wire.slave.take_events(),
            whole.slave.take_events(),
            "{sent}"
        );
    }
}

/// Whatever it has heard, fourteen zeros bring it back.
#[test]
fn fourteen_zeros_end_anything() {
    let mut rng = common::rng();
    for _ in 0..common::size(300) {
        let mut wire = Wire::new("reg-busy=0us..3ms,frame=st4");
        let begins = *rng
            .choice(&[
                "",
                "1",
                "110000010000001",
                "11000000000001101010",
                "1000000000001111",
            ])
            .unwrap();
        let noise: String = (0..rng.usize(0..60))
            .map(|_| if rng.bool() { '1' } else { '0' })
            .collect();
        wire.control(&format!("{begins}{noise}"));
        wire.reset();
        // Noise can be a command that switches control communication off, or select a bank that is not there.
        if !wire.slave.control_active(0) || wire.slave.peek(0, 0, 0x40) != Some(0) {
            continue;
        }
        let (what, _, cdm, cds) = STRINGS[1];
        assert_eq!(wire.control(cdm), cds, "{what} after {begins}{noise}");
        // Thirteen are not enough.
        wire.reset();
        wire.control("11");
        wire.control("0000000000000");
        assert_ne!(wire.control(cdm), cds);
    }
}

#[test]
fn commands_need_their_last_bit_and_their_crc() {
    let mut wire = Wire::new("frame=st12,nE,nW,crc6");
    wire.slave.record_events(true);
    let off = command(&[], 0);
    wire.reset();
    wire.control(&format!("1{off}0"));
    wire.reset();
    let mut wrong = off.clone().into_bytes();
    wrong[12] ^= 1;
    wire.control(&format!("1{}1", String::from_utf8(wrong).unwrap()));
    wire.reset();
    wire.control(&format!("1{}0000000", command(&[0], 1)));
    assert_eq!(wire.control("0"), "0");
    wire.reset();
    assert_eq!(wire.slave.take_events(), []);
    assert!(wire.slave.data_active(0) && wire.slave.control_active(0));
    wire.control(&format!("1{off}1"));
    assert_eq!(wire.slave.take_events().len(), 1);
    assert!(!wire.slave.data_active(0));
}

#[test]
fn a_slave_without_data_sends_a_header_and_zeros() {
    let mut wire = Wire::new("motion=still,pos=4095,frame=st12,nE,nW,crc6");
    assert!(wire.frame(false).starts_with("10101111"));
    wire.reset();
    wire.control(&format!("1{}1", command(&[], 0)));
    let short = format!("101{}", "0".repeat(wire.clocks - 3));
    assert_eq!(wire.frame(false), short);
    // Registers go on.
    assert_eq!(wire.read(0, 0x78, 6), Some((b"BISSIM".into(), false)));
    wire.reset();
    let echo = wire.control(&format!("1{}00000001", command(&[0], 0)));
    assert_eq!(&echo[17..], "10000000");
    assert!(wire.frame(false).starts_with("10101111"));
    assert!(wire.slave.data_active(0));
}

#[test]
fn a_slave_without_control_has_no_id() {
    let mut wire = Wire::new("frame=st12,nE,nW,crc6");
    wire.reset();
    wire.control(&format!("1{}00000001", command(&[0], 1)));
    assert!(!wire.slave.control_active(0));
    assert_eq!(wire.read(0, 0x78, 1), None);
    wire.reset();
    let silence = wire.control(&format!("1{}", register(0, 0x78)));
    assert!(!silence.contains('1'), "{silence}");
    wire.reset();
    // In two clocks and a timeout: nobody has to answer.
    for bit in format!("1{}1", command(&[], 1)).chars() {
        wire.frame_of(2, bit == '1');
    }
    assert!(wire.slave.control_active(0));
    assert_eq!(wire.read(0, 0x78, 1), Some((vec![b'B'], false)));
}

/// Any address, any bank, any length: what the registers hold is what was acknowledged.
#[test]
fn the_map_is_what_was_acknowledged() {
    let mut rng = common::rng();
    for _ in 0..common::size(12) {
        let from = rng.u8(..0x80);
        let to = rng.u8(from..0x80);
        let knobs = format!(
            "refuse={from}..{to},read-only=0x50..0x57,seed={}",
            rng.u32(..)
        );
        let mut wire = Wire::new(&format!("{knobs},frame=st4"));
        let mut map = [[None; 0x80]; 256];
        let refresh = |wire: &Wire, map: &mut [[Option<u8>; 0x80]; 256]| {
            for (bank, bytes) in map.iter_mut().enumerate() {
                for (address, byte) in bytes.iter_mut().enumerate() {
                    *byte = wire.slave.peek(0, bank as u8, address as u8);
                }
            }
        };
        refresh(&wire, &mut map);
        let mut refused = 0;
        for _ in 0..12 {
            let address = rng.u8(..0x80);
            let bank = map[0][0x40].unwrap_or(0);
            if rng.bool() {
                let got = wire.read(0, address, 1).map(|(bytes, _)| bytes);
                let want = map[usize::from(bank)][usize::from(address)];
                assert_eq!(got, want.map(|byte| vec![byte]), "{knobs} {address:#x}");
                refused += u32::from(got.is_none());
            } else {
                let value = rng.u8(..);
                let done = wire.write(0, address, &[value]).is_some();
                let writable = match address {
                    _ if (from..=to).contains(&address) => false,
                    0x40 => true,
                    0x41.. => (0x48..=0x5F).contains(&address) && !(0x50..=0x57).contains(&address),
                    _ => [0, 4, 5].contains(&bank),
                };
                assert_eq!(done, writable, "{knobs} {address:#x}");
                if done && address == 0x40 {
                    map.iter_mut().for_each(|bank| bank[0x40] = Some(value));
                } else if done {
                    let direct = address > 0x40;
                    for (number, bytes) in map.iter_mut().enumerate() {
                        if direct || number == usize::from(bank) {
                            bytes[usize::from(address)] = Some(value);
                        }
                    }
                }
            }
            let before = map;
            refresh(&wire, &mut map);
            assert_eq!(map, before, "{knobs} {address:#x}");
        }
        println!("{refused} reads refused");
    }
}

/// Each register and each step from one to the next, up to 64 bytes, and P where it ends.
#[test]
fn sequences_end_where_the_map_does() {
    let mut rng = common::rng();
    let mut stopped = 0;
    for _ in 0..common::size(40) {
        let hole = rng.u8(..0x80);
        let knobs = format!(
            "refuse={hole},reg-busy=0us..{}us,seed={},frame=st4",
            rng.u32(..500),
            rng.u32(..)
        );
        let mut wire = Wire::new(&knobs);
        let address = rng.u8(..0x80);
        let wanted = rng.usize(1..=64);
        let byte = |wire: &Wire, address: u8| wire.slave.peek(0, 0, address);
        let mut want = Vec::new();
        let mut next = address;
        while want.len() < wanted
            && (want.is_empty() || ![0x40, 0x80].contains(&next))
            && byte(&wire, next).is_some()
        {
            want.extend(byte(&wire, next));
            next += 1;
        }
        let over = [0x40, 0x80].contains(&next) || byte(&wire, next).is_none() || want.len() == 64;
        let got = wire.read(0, address, wanted);
        if want.is_empty() {
            assert_eq!(got, None, "{knobs} {address:#x}");
            continue;
        }
        assert_eq!(got, Some((want, over)), "{knobs} {address:#x} {wanted}");
        stopped += usize::from(over);

        // The window's bank 0 is free to write, but for the hole.
        let address = rng.u8(..0x40);
        let bytes: Vec<u8> = (0..wanted).map(|_| rng.u8(..)).collect();
        let end = if hole >= address {
            hole.min(0x40)
        } else {
            0x40
        };
        let room = usize::from(end - address).min(bytes.len());
        let got = wire.write(0, address, &bytes);
        if room == 0 {
            assert_eq!(got, None);
            continue;
        }
        let over = address as usize + room == usize::from(end) || room == 64;
        assert_eq!(got, Some((room, over)), "{knobs} {address:#x} {wanted}");
        for (address, want) in (address..).zip(&bytes[..room]) {
            assert_eq!(wire.slave.peek(0, 0, address), Some(*want));
        }
    }
    println!("{stopped} reads ended by P");
}

/// The first byte to write is never held back, everything else may be.
#[test]
fn a_busy_register_holds_s_back() {
    let frame_ns = 57_000;
    let (_, _, cdm, cds) = STRINGS[1];
    let mut wire = Wire::new("reg-busy=15ms,frame=st4");
    wire.reset();
    assert_eq!(wire.control(cdm), cds);
    let began = wire.t_ns;
    assert_eq!(wire.read(0, 0x10, 1), Some((vec![0x5A], false)));
    assert!((15_000_000..15_000_000 + 60 * frame_ns).contains(&(wire.t_ns - began)));
    // Fifteen milliseconds of S, and the bytes behind it.
    assert_eq!(wire.write(0, 0x10, &[1, 2, 3]), Some((3, false)));
    assert_eq!(wire.read(0, 0x10, 3), Some((vec![1, 2, 3], false)));
    // A master that has had enough.
    wire.reset();
    wire.control(&format!("1{}10", register(0, 0x78)));
    let silence = wire.control(&"1".repeat(100));
    assert_eq!(&silence[..2], "00");
    assert!(!silence[1..].contains('1'), "{silence}");
    wire.reset();
    assert_eq!(wire.control(cdm), cds);
}

#[test]
fn a_byte_with_a_wrong_crc_is_not_written() {
    let (_, _, cdm, cds) = STRINGS[3];
    for flipped in 19..31 {
        let mut sent = cdm.to_owned().into_bytes();
        sent[flipped] ^= 1;
        let mut wire = Wire::new("frame=st4");
        wire.slave.record_events(true);
        wire.reset();
        let seen = wire.control(&String::from_utf8(sent).unwrap());
        // It echoes what it got; then P, and nothing for the second byte.
        let differ: Vec<usize> = (0..32).filter(|n| seen[*n..=*n] != cds[*n..=*n]).collect();
        assert_eq!(differ, [flipped + 1]);
        assert_eq!(&seen[32..], "100000000000000");
        assert_eq!(wire.slave.take_events(), []);
    }
}

#[test]
fn a_wrong_header_is_not_answered() {
    for (index, last) in [(0, 15), (1, 15), (9, 15), (11, 15)] {
        let (what, knobs, cdm, _) = STRINGS[index];
        for flipped in 2..=last {
            let mut sent = cdm.to_owned().into_bytes();
            sent[flipped] ^= 1;
            let mut wire = Wire::new(&format!("{knobs},frame=st4"));
            wire.slave.record_events(true);
            wire.reset();
            let seen = wire.control(&String::from_utf8(sent).unwrap());
            assert!(!seen[2..].contains('1'), "{what}, bit {flipped}: {seen}");
            assert_eq!(wire.slave.take_events(), []);
        }
    }
}

#[test]
fn refuses_in_its_own_way() {
    // R and W as sent, and as they come back from an address that is not there.
    for (refusal, read, write, none) in [("invert", "11", "00", "01"), ("silent", "10", "01", "00")]
    {
        for (sent, back) in [("10", read), ("01", write), ("00", none)] {
            let mut wire = Wire::new(&format!("refusal={refusal},frame=st4"));
            wire.slave.record_events(true);
            wire.reset();
            wire.control(&format!("1{}", register(0, 0x70)));
            let seen = wire.control(&format!("{sent}{}", "1".repeat(100)));
            assert_eq!(&seen[1..3], back, "{refusal} {sent}");
            assert!(!seen[3..].contains('1'), "{refusal} {sent}: {seen}");
            assert_eq!(wire.slave.take_events(), []);
        }
    }
}

#[test]
fn a_unidirectional_slave_hears_nothing() {
    for (knobs, level) in [("device=none", '0'), ("cds=0", '0'), ("cds=1", '1')] {
        let mut wire = Wire::new(&format!("{knobs},frame=st4"));
        wire.slave.record_events(true);
        wire.reset();
        let seen = wire.control(STRINGS[1].2);
        assert!(seen.chars().all(|bit| bit == level), "{seen}");
        wire.control(&format!("1{}1", command(&[], 0)));
        assert!(wire.slave.data_active(0) && !wire.slave.control_active(0));
        assert_eq!(wire.slave.take_events(), []);
    }
    assert_eq!(Wire::new("device=none").slave.peek(0, 0, 0x78), None);
}
