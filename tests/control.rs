//! Control communication as bits: the published and computed control frames, both directions.
#![allow(clippy::unwrap_used)]

mod common;

use biss::control::{
    Access, Control, Failure, Heard, Listener, Outcome, REST_FRAMES, Seen, Spoken,
};

/// CDM and CDS of a control frame, from its S on. The AN22 recording of an iC-MHM has the shape of `BUSY_READ`; all are
/// computed by a generator of their own and checked against TI's and Lenz's published words.
struct Golden {
    name: &'static str,
    access: Access,
    cdm: &'static str,
    cds: &'static str,
    bytes: &'static [u8],
    failure: Option<Failure>,
}

fn read(slave: u8, address: u8, count: u8) -> Access {
    Access::Read {
        slave,
        address,
        count,
    }
}

fn write(slave: u8, address: u8, data: &[u8]) -> Access {
    Access::Write {
        slave,
        address,
        data: data.into(),
    }
}

fn command(slaves: u8, code: u8) -> Access {
    Access::Command {
        slaves,
        code,
        checked: true,
        reduced: false,
    }
}

fn golden() -> Vec<Golden> {
    let row = |name, access, cdm, cds, bytes| Golden {
        name,
        access,
        cdm,
        cds,
        bytes,
        failure: None,
    };
    vec![
        row(
            "read 0x78",
            read(0, 0x78, 1),
            "110001111000010110100000000000000",
            "010000000000000001010100110111000",
            &[0x4D],
        ),
        row(
            "write 0x5A to 0x10",
            write(0, 0x10, &[0x5A]),
            "110000010000001101101011010000000",
            "010000000000000000110101101000000",
            &[0x5A],
        ),
        row(
            "read 0x7E and 0x7F, the next address absent",
            read(0, 0x7E, 2),
            "11000111111011111010000000000000100000000000000",
            "01000000000000000101011010011010010100001111011",
            &[0x69, 0x43],
        ),
        row(
            "write two bytes to 0x10",
            write(0, 0x10, &[0x11, 0x22]),
            "11000001000000110110001000110010100100010001100",
            "01000000000000000011000100011001010010001000110",
            &[0x11, 0x22],
        ),
        row(
            "read two bytes, busy before the second",
            read(0, 0x00, 2),
            "110000000000011010100000000000001100000000000000",
            "010000000000000001010100100000110010100010001000",
            &[0x48, 0x44],
        ),
        row(
            "select bank 2",
            write(0, 0x40, &[0x02]),
            "110001000000000101100000010100100",
            "010000000000000000110000001010010",
            &[0x02],
        ),
        row(
            "read 0x78 of slave 2 of 3",
            read(2, 0x78, 1),
            "110101111000101010100000000000000",
            "011100000000000001011010010101000",
            &[0xA5],
        ),
        Golden {
            failure: Some(Failure::Refused { address: 0x78 }),
            ..row(
                "a read refused",
                read(0, 0x78, 1),
                "1100011110000101100",
                "0100000000000000011",
                &[],
            )
        },
        Golden {
            failure: Some(Failure::Refused { address: 0x10 }),
            ..row(
                "a write refused",
                write(0, 0x10, &[1]),
                "1100000100000011010",
                "0100000000000000000",
                &[],
            )
        },
        row(
            "broadcast 00",
            command(0, 0),
            "1000000000001111110",
            "0100000000000000000",
            &[],
        ),
        row(
            "broadcast 01",
            command(0, 1),
            "1000000000011100110",
            "0100000000000000000",
            &[],
        ),
        row(
            "command 00 to slave 0",
            command(1, 0),
            "10100000000000101000000010",
            "01000000000000000100000000",
            &[],
        ),
        row(
            "command 10 to slave 0",
            command(1, 2),
            "10100000001001001000000010",
            "01000000000000000100000000",
            &[],
        ),
    ]
}

/// What the machine sends when the slave sends `cds` after the rest, and how it ends.
fn run(access: Access, cds: &str, late: bool) -> (String, Option<Outcome>) {
    let mut control = Control::new(late);
    control.set_retries(0);
    control.ask(access).unwrap();
    for frame in 0..REST_FRAMES {
        assert_eq!(control.cdm(), [false; 2], "rest frame {frame}");
        let seen = Seen::Whole {
            cds: false,
            cdm: false,
        };
        control.seen(0, seen);
    }
    let mut sent = String::new();
    let mut ended = None;
    for (n, cds) in cds.chars().enumerate() {
        let cds = cds == '1';
        let table = control.cdm();
        assert!(!late || table[0] == table[1], "frame {n}");
        let cdm = table[usize::from(cds)];
        sent.push(if cdm { '1' } else { '0' });
        control.seen(n as u64 * 100_000, Seen::Whole { cds, cdm });
        ended = control.take().or(ended);
    }
    (sent, ended)
}

#[test]
fn sends_the_golden_bits_and_understands_the_answers() {
    for row in golden() {
        let (sent, ended) = run(row.access, row.cds, false);
        assert_eq!(sent, row.cdm, "{}", row.name);
        let ended = ended.unwrap_or_else(|| panic!("{}: still busy", row.name));
        assert_eq!(ended.failure, row.failure, "{}", row.name);
        assert_eq!(ended.bytes.as_slice(), row.bytes, "{}", row.name);
    }
}

/// A link that lays out CDM before it sees CDS repeats S in reads, where that means nothing, and else sends the same.
#[test]
fn a_late_master_gets_the_same_bytes() {
    for row in golden() {
        let single = !matches!(row.access, Access::Write { data, .. } if data.as_slice().len() > 1);
        if row.failure.is_some() || !single {
            continue;
        }
        let (sent, ended) = run(row.access, row.cds, true);
        let ended = ended.unwrap_or_else(|| panic!("{}: still busy", row.name));
        assert_eq!(ended.failure, None, "{}", row.name);
        assert_eq!(ended.bytes.as_slice(), row.bytes, "{}", row.name);
        if !matches!(row.access, Access::Read { .. }) {
            assert_eq!(sent, row.cdm, "{}", row.name);
        }
    }
}

/// The listener hears in both strings what was said.
#[test]
fn the_listener_understands_both_directions() {
    for row in golden() {
        let mut listener = Listener::new();
        let mut heard: Vec<Heard> = Vec::new();
        for _ in 0..REST_FRAMES {
            assert_eq!(listener.frame(0, false, false), None);
        }
        for (cdm, cds) in row.cdm.chars().zip(row.cds.chars()) {
            heard.extend(listener.frame(0, cdm == '1', cds == '1'));
        }
        let said: Vec<Spoken> = heard.iter().map(|heard| heard.spoken).collect();
        let want: Vec<Spoken> = match row.access {
            Access::Read { slave, address, .. } if row.failure.is_some() => vec![Spoken::Refused {
                slave,
                address,
                write: false,
                rw: (true, true),
            }],
            Access::Write { slave, address, .. } if row.failure.is_some() => {
                vec![Spoken::Refused {
                    slave,
                    address,
                    write: true,
                    rw: (false, false),
                }]
            }
            Access::Read { slave, address, .. } => (address..)
                .zip(row.bytes)
                .map(|(address, value)| Spoken::Read {
                    slave,
                    address,
                    value: *value,
                })
                .collect(),
            Access::Write { slave, address, .. } => (address..)
                .zip(row.bytes)
                .map(|(address, value)| Spoken::Written {
                    slave,
                    address,
                    value: *value,
                })
                .collect(),
            Access::Command { slaves, code, .. } => vec![Spoken::Command {
                slaves,
                code,
                acknowledged: slaves,
                executed: true,
            }],
        };
        assert_eq!(said, want, "{}", row.name);
    }
}

/// Thirteen read words published with TI's motor-control-sdk: CTS to the second S, left-aligned in 32 bits.
#[test]
fn sends_the_words_that_ti_publishes() {
    for (address, word) in [
        (0x44, 0x889B_4000u32),
        (0x45, 0x88BD_4000),
        (0x46, 0x88D7_4000),
        (0x47, 0x88F1_4000),
        (0x60, 0x8C17_4000),
        (0x67, 0x8CE5_4000),
        (0x68, 0x8D01_4000),
        (0x78, 0x8F0B_4000),
        (0x79, 0x8F2D_4000),
        (0x7A, 0x8F47_4000),
        (0x7B, 0x8F61_4000),
        (0x7C, 0x8F93_4000),
        (0x7D, 0x8FB5_4000),
    ] {
        let cds = "0100000000000000010";
        let (sent, _) = run(read(0, address, 1), cds, false);
        let bits = u32::from_str_radix(&sent, 2).unwrap();
        assert_eq!(bits & 0x3_FFFF, word >> 14, "{address:#x}");
        assert_eq!(sent.len(), 19);
    }
}

/// The CRC of a header for slave 0, of broadcasts and of addressed commands.
#[test]
fn headers_have_the_published_crcs() {
    let crc = |access| {
        let (sent, _) = run(access, "0100000000000000", false);
        u8::from_str_radix(&sent[12..16], 2).unwrap()
    };
    for (address, want) in (0x40..=0x47)
        .zip([1, 2, 7, 4, 0xD, 0xE, 0xB, 8])
        .chain((0x78..=0x7F).zip([5, 6, 3, 0, 9, 0xA, 0xF, 0xC]))
        .chain([(0, 6)])
    {
        assert_eq!(crc(read(0, address, 1)), want, "{address:#x}");
    }
    let unchecked = |slaves, code| Access::Command {
        slaves,
        code,
        checked: false,
        reduced: false,
    };
    for (slaves, want) in [
        (0u8, [0xF, 0xC, 0x9, 0xA]),
        (1 << 0, [0x2, 0x1, 0x4, 0x7]),
        (1 << 1, [0x0, 0x3, 0x6, 0x5]),
        (1 << 2, [0x1, 0x2, 0x7, 0x4]),
        (1 << 3, [0x8, 0xB, 0xE, 0xD]),
        (1 << 4, [0x5, 0x6, 0x3, 0x0]),
        (1 << 5, [0xA, 0x9, 0xC, 0xF]),
        (1 << 6, [0x4, 0x7, 0x2, 0x1]),
        (1 << 7, [0x3, 0x0, 0x5, 0x6]),
    ] {
        for (code, want) in (0..4).zip(want) {
            assert_eq!(crc(unchecked(slaves, code)), want, "{slaves:#x} {code}");
        }
    }
}

#[test]
fn what_the_wire_cannot_carry_is_refused() {
    let mut control = Control::new(false);
    assert!(control.ask(read(8, 0, 1)).is_err());
    assert!(control.ask(read(0, 0x7F, 2)).is_err());
    assert!(control.ask(read(0, 0, 0)).is_err());
    assert!(control.ask(command(0, 4)).is_err());
    assert!(control.ask(command(0x80, 0)).is_ok());
    assert!(Control::new(true).ask(command(0x80, 0)).is_err());
}

/// Frames for which nothing is wrong, the slave saying nothing.
fn quiet(control: &mut Control, frames: usize) {
    for _ in 0..frames {
        let cdm = control.cdm()[0];
        control.seen(0, Seen::Whole { cds: false, cdm });
    }
}

/// A late master has sent EX before it sees the last IDA, so a bit error there makes nothing undone: said to have failed,
/// the command would be repeated.
#[test]
fn a_late_master_executes_no_command_twice() {
    let cds = "0100000000000000010000001";
    let (sent, ended) = run(command(1, 2), cds, true);
    assert_eq!(sent.as_bytes()[24], b'1', "EX is out");
    assert_eq!(ended.unwrap().failure, None);
    // A master that reacts has seen it, and does not execute.
    let (sent, ended) = run(command(1, 2), cds, false);
    assert_eq!(sent.as_bytes()[24], b'0');
    let wrong = Failure::Acknowledge { want: 1, got: 0x81 };
    assert_eq!(ended.unwrap().failure, Some(wrong));
}

/// A command that was cut and given up is nobody's business any more.
#[test]
fn an_access_is_not_blamed_for_the_one_before() {
    let mut control = Control::new(false);
    control.ask(command(0, 2)).unwrap();
    quiet(&mut control, usize::from(REST_FRAMES) + 5);
    control.seen(0, Seen::Cut { cdm: Some(false) });
    control.give_up();
    control.ask(read(0, 0x78, 1)).unwrap();
    control.seen(0, Seen::Cut { cdm: Some(false) });
    assert!(control.take().is_none(), "one frame of the rest was lost");
    assert!(control.is_busy());
}

/// However many repetitions are allowed.
#[test]
fn any_number_of_retries_can_be_counted() {
    let mut control = Control::new(false);
    control.set_retries(u32::MAX);
    control.ask(read(0, 0x78, 1)).unwrap();
    for _ in 0..1_000 {
        control.seen(0, Seen::Cut { cdm: None });
    }
    assert!(control.is_busy());
}

/// On a late link S may be out when its echo is seen before it comes. Then what comes is a frame late, and the last bit of the
/// CRC stands where P is awaited. With one more bit error the CRC is good: it takes a second reading.
#[test]
fn a_byte_that_may_have_come_late_is_doubtful() {
    // 0x11 has the CRC 1001: 1 0001 0001 100|1, with one bit wrong.
    let shifted = "100010101100";
    let head = "0100000000000000010";
    let access = read(0, 0x78, 1);
    let (_, ended) = run(access, &format!("{head}1{shifted}1"), true);
    let ended = ended.unwrap();
    assert_eq!((ended.failure, ended.waited), (None, 1));
    assert_eq!(ended.bytes.as_slice(), [0x8A]);
    // Where S is not repeated nothing comes after an echo that was none.
    let (_, ended) = run(access, &format!("{head}1{shifted}1"), false);
    assert_eq!(ended.unwrap().waited, 0);
    // Where P says that there is more, no bit of a CRC is in its place.
    let (_, ended) = run(read(0, 0x78, 2), &format!("{head}1{shifted}0"), true);
    assert!(ended.is_none());
    let (_, ended) = run(access, &format!("{head}1{shifted}0"), true);
    assert_eq!(ended.unwrap().waited, 0);
}

/// A slave that speaks while it should rest has taken a bit error for the beginning of something: the rest begins anew.
#[test]
fn a_slave_that_speaks_does_not_rest() {
    let mut control = Control::new(false);
    control.set_retries(0);
    control.ask(read(0, 0x78, 1)).unwrap();
    for _ in 0..10 {
        quiet(&mut control, usize::from(REST_FRAMES) - 1);
        let cdm = control.cdm()[0];
        control.seen(0, Seen::Whole { cds: true, cdm });
        assert_eq!(control.cdm(), [false; 2]);
    }
    quiet(&mut control, usize::from(REST_FRAMES));
    assert_eq!(control.cdm(), [true; 2], "S");
    // One that never stops is named.
    control.ask(read(0, 0x78, 1)).unwrap();
    for frame in 0..REST_FRAMES {
        assert!(control.is_busy(), "{frame}");
        let cdm = control.cdm()[0];
        control.seen(0, Seen::Whole { cds: true, cdm });
    }
    let failure = control.take().unwrap().failure;
    assert_eq!(failure, Some(Failure::OutOfStep));
}

/// Nobody speaks before IDL, nor between it and the echo of R, or IDA; and IDs follow each other.
#[test]
fn a_header_is_heard_in_silence() {
    for access in [read(0, 0x78, 1), write(0, 0x10, &[1]), command(1, 2)] {
        for frame in (0..17).filter(|frame| *frame == 0 || *frame > 9) {
            let cds: String = (0..17)
                .map(|n| if n == 1 || n == frame { '1' } else { '0' })
                .collect();
            let (_, ended) = run(access, &cds, false);
            let failure = ended.and_then(|ended| ended.failure);
            assert_eq!(failure, Some(Failure::OutOfStep), "{access:?} {frame}");
        }
        for idl in ["101000000", "110000001"] {
            let (_, ended) = run(access, &format!("0{idl}"), false);
            let failure = ended.and_then(|ended| ended.failure);
            assert!(matches!(failure, Some(Failure::Garbled { .. })), "{idl}");
        }
    }
}

/// R and W that nobody can mean are what is left of a header that was given up: no access was refused.
#[test]
fn the_listener_hears_no_refusal_of_nothing() {
    let mut listener = Listener::new();
    for _ in 0..REST_FRAMES {
        assert_eq!(listener.frame(0, false, false), None);
    }
    // S, CTS, ID 0 and an address whose CRC is zeros, as those of the rest are.
    let address = (0..0x80u8)
        .find(|address| {
            let (sent, _) = run(read(0, *address, 1), "0100000000000000", false);
            sent.ends_with("0000")
        })
        .unwrap();
    let (sent, _) = run(read(0, address, 1), "0100000000000000", false);
    for cdm in sent.chars().chain("000000000000000000".chars()) {
        assert_eq!(listener.frame(0, cdm == '1', false), None, "{address:#x}");
    }
}

/// A slave that may have been left in the middle of a command waits for EX. Another frame that is not whole may be taken for it:
/// then nobody knows.
#[test]
fn a_command_cut_twice_is_undecided() {
    let mut control = Control::new(false);
    control.ask(command(1, 2)).unwrap();
    quiet(&mut control, usize::from(REST_FRAMES) + 1);
    let idl = Seen::Whole {
        cds: true,
        cdm: control.cdm()[1],
    };
    control.seen(0, idl);
    quiet(&mut control, 10);
    control.seen(0, Seen::Cut { cdm: Some(false) });
    assert!(control.is_busy(), "it is repeated");
    quiet(&mut control, 5);
    control.seen(0, Seen::Cut { cdm: Some(false) });
    let ended = control.take().unwrap();
    assert_eq!(ended.failure, Some(Failure::Undecided));
    assert_eq!(ended.retries, 1);
}

/// A sequence does not cross from the window to the registers behind it, whatever the slave says (D2, p. 16).
#[test]
fn a_sequence_ends_where_the_window_does() {
    for late in [false, true] {
        // R, W, S, 0x48 with its CRC as in the golden strings, and P = 0: there is more.
        let cds = format!("0100000000000000010101001000001{}", "10");
        let (sent, ended) = run(read(0, 0x3F, 2), &cds, late);
        assert_eq!(sent.len(), 33);
        assert_eq!(sent.as_bytes()[32], b'0', "late {late}: no S follows");
        assert!(
            ended.is_none(),
            "late {late}: the second byte is still to come"
        );
        let (sent, _) = run(read(0, 0x3E, 2), &cds, late);
        assert_eq!(sent.as_bytes()[32], b'1', "late {late}: S");
    }
}

/// S goes out again only where it can do no harm: not in a write, whose next bit it would be, and not where P says that there is
/// no more.
#[test]
fn s_is_repeated_only_in_reads() {
    let (sent, ended) = run(write(0, 0x10, &[0xFF]), "01000000000000000010", false);
    assert_eq!(&sent[18..], "10");
    let failure = ended.unwrap().failure;
    assert_eq!(failure, Some(Failure::NotEchoed { address: 0x10 }));
    let (sent, _) = run(read(0, 0x10, 1), "010000000000000001000", false);
    assert_eq!(&sent[18..], "111");
    let last = "010000000000000001010100100000111";
    let (sent, _) = run(read(0, 0x10, 2), last, false);
    assert_eq!(sent.as_bytes()[32], b'0', "P = 1");
}

/// In which frames of a command a pause may execute it: from where three bits more reach EX.
#[test]
fn only_near_its_end_a_cut_command_is_undecided() {
    for (slaves, first, last) in [(1, 23, 24), (0, 15, 17)] {
        for cut in 1..=last {
            let mut control = Control::new(false);
            control.set_retries(0);
            control.ask(command(slaves, 2)).unwrap();
            quiet(&mut control, usize::from(REST_FRAMES));
            for frame in 0..cut {
                let cds = frame == 1 || slaves == 1 && frame == 17;
                let cdm = control.cdm()[usize::from(cds)];
                control.seen(0, Seen::Whole { cds, cdm });
            }
            control.seen(0, Seen::Cut { cdm: None });
            let want = match cut >= first {
                true => Failure::Undecided,
                false => Failure::Cut,
            };
            assert_eq!(
                control.take().unwrap().failure,
                Some(want),
                "{slaves} {cut}"
            );
        }
    }
}

/// What the slave can echo for R and W, and what that means.
#[test]
fn every_echo_of_r_and_w_has_a_name() {
    let address = 0x10;
    let refused = Failure::Refused { address };
    let strange = |r, w| Failure::Strange { address, r, w };
    for (access, rw, want) in [
        (read(0, address, 1), "10", None),
        (read(0, address, 1), "11", Some(refused)),
        (
            read(0, address, 1),
            "00",
            Some(Failure::NoReaction { address }),
        ),
        (read(0, address, 1), "01", Some(strange(false, true))),
        (write(0, address, &[1]), "01", None),
        (write(0, address, &[1]), "00", Some(refused)),
        (write(0, address, &[1]), "11", Some(strange(true, true))),
        (write(0, address, &[1]), "10", Some(strange(true, false))),
    ] {
        for late in [false, true] {
            let (sent, ended) = run(access, &format!("01000000000000000{rw}"), late);
            let failure = ended.and_then(|ended| ended.failure);
            assert_eq!(failure, want, "{access:?} {rw}");
            let s = sent.ends_with('1');
            assert!(s == want.is_none() || late && s, "{access:?} {rw}: {sent}");
        }
    }
}

/// An echo that differs in one bit, of the byte or of its CRC, is none.
#[test]
fn every_bit_of_an_echo_counts() {
    // 0x5A and its CRC, as in the golden strings.
    let echo = "010110100000";
    for wrong in 0..12 {
        let cds: String = echo
            .chars()
            .enumerate()
            .map(|(at, bit)| {
                if (bit == '1') != (at == wrong) {
                    '1'
                } else {
                    '0'
                }
            })
            .collect();
        let cds = format!("01000000000000000011{cds}0");
        let (_, ended) = run(write(0, 0x10, &[0x5A]), &cds, false);
        let failure = ended.and_then(|ended| ended.failure);
        assert!(
            matches!(failure, Some(Failure::Echo { .. })),
            "{wrong}: {failure:?}"
        );
    }
}

/// Nobody executes what not all have acknowledged, on a late link either.
#[test]
fn a_late_master_looks_before_it_executes() {
    let (sent, ended) = run(command(0b11, 2), "0110000000000000010000000", true);
    assert_eq!(sent.as_bytes()[24], b'0');
    let want = Failure::Acknowledge { want: 3, got: 1 };
    assert_eq!(ended.unwrap().failure, Some(want));
}

/// What a listener makes of these bits after so many frames of rest.
fn listened(rest: u8, cdm: &str, cds: &str) -> Vec<Spoken> {
    let mut listener = Listener::new();
    let rest = (0..rest).map(|_| (false, false));
    let bits = cdm.chars().zip(cds.chars());
    rest.chain(bits.map(|(cdm, cds)| (cdm == '1', cds == '1')))
        .filter_map(|(cdm, cds)| listener.frame(0, cdm, cds))
        .map(|heard| heard.spoken)
        .collect()
}

/// The listener believes no byte that is not right in both directions, and no frame before it is sure where one begins.
#[test]
fn the_listener_checks_what_it_hears() {
    let read_cdm = "110001111000010110100000000000000";
    let read_cds = "010000000000000001010100110111000";
    let (slave, address) = (0, 0x78);
    let value = 0x4D;
    let right = Spoken::Read {
        slave,
        address,
        value,
    };
    assert_eq!(listened(14, read_cdm, read_cds), [right]);
    assert_eq!(listened(13, read_cdm, read_cds), []);
    let mut listener = Listener::new();
    for frame in 0..20 {
        match frame {
            10 => assert_eq!(listener.lost(), None),
            _ => assert_eq!(listener.frame(0, false, false), None),
        }
    }
    for (cdm, cds) in read_cdm.chars().zip(read_cds.chars()) {
        assert_eq!(
            listener.frame(0, cdm == '1', cds == '1'),
            None,
            "9 frames of rest"
        );
    }
    // A wrong bit in the byte, R missing in the echo.
    let wrong = "010000000000000001010101110111000";
    assert!(matches!(
        listened(14, read_cdm, wrong)[..],
        [Spoken::Bad { cdm: None, .. }]
    ));
    let rw = (false, false);
    let silent = format!("01{}", "0".repeat(31));
    let refused = Spoken::Refused {
        slave,
        address,
        write: false,
        rw,
    };
    assert_eq!(listened(14, read_cdm, &silent), [refused]);
    // P = 1, and an S that came too late to know.
    let (cdm, cds) = (&read_cdm[..32], &read_cds[..32]);
    let heard = listened(14, &format!("{cdm}100"), &format!("{cds}100"));
    assert_eq!(heard, [right]);
    let heard = listened(14, &format!("{cdm}100"), &format!("{cds}000"));
    let next = Spoken::Silent {
        slave,
        address: 0x79,
        write: false,
    };
    assert_eq!(heard, [right, next]);
    // 0x5A is written, 0x05 with its CRC, which is 0 as well, comes back.
    let write_cdm = "110000010000001101101011010000000";
    let echo = "010000000000000000110000010100000";
    assert!(matches!(
        listened(14, write_cdm, echo)[..],
        [Spoken::Bad {
            cdm: Some(0x5A0),
            ..
        }]
    ));
    // The header of a command without the S behind it.
    assert_eq!(
        listened(14, "1000000000001111000", "0100000000000000000"),
        []
    );
}
