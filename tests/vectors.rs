//! Frames whose every bit is known from published sources, decoded and emitted.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

use biss::Format;
use biss::cycle::{Cycle, Head};
use biss::frame::{BissC, emit};
use biss::preset::Frame;
use biss::protocol::Protocol;
use biss::trace::{Bits, Trace};

struct Vector {
    source: &'static str,
    format: &'static str,
    /// SL after rising edge 1, 2, 3 …
    slo: &'static str,
    head: Head,
    data: &'static [u64],
    crc: &'static [u16],
}

const HEAD: Head = Head {
    delay_clk: 0,
    ack: 1,
    cds: false,
};

/// CRC values of these frames were computed by a generator of its own, checked against hpm_sdk's bissc log, AN21 and
/// the capture of AN22 (all iC-Haus or BiSS Association application notes).
const VECTORS: [Vector; 11] = [
    Vector {
        source: "RESOLUTE 26 bit (Renishaw L-9709-9005-03-F, p. 3)",
        format: "st26,nE,nW,crc6",
        slo: "101010001101000101011001111000110100110",
        head: HEAD,
        data: &[0x234_5678 << 2 | 0b11],
        crc: &[0x13],
    },
    Vector {
        source: "the same with CDS = 1 and two more Ack clocks",
        format: "st26,nE,nW,crc6",
        slo: "10001110001101000101011001111000110100110",
        head: Head {
            delay_clk: 0,
            ack: 3,
            cds: true,
        },
        data: &[0x234_5678 << 2 | 0b11],
        crc: &[0x13],
    },
    Vector {
        source: "BP3 multi-turn, warning set (BiSS Safety Concept A5, p. 4)",
        format: "mt12,st13,nE,nW,crc6",
        slo: "10100001001000110101010111100100001000",
        head: HEAD,
        data: &[0x123 << 15 | 0xABC << 2 | 0b10],
        crc: &[0x04],
    },
    Vector {
        source: "RESOLUTE 32 bit, error set",
        format: "st32,nE,nW,crc6",
        slo: "101011011110101011011011111011101111010101110",
        head: HEAD,
        data: &[0xDEAD_BEEF << 2 | 0b01],
        crc: &[0x17],
    },
    Vector {
        source: "position zero is no null value (BiSS C protocol D2, p. 13)",
        format: "st24,nE,nW,crc6",
        slo: "1010000000000000000000000000111110100",
        head: HEAD,
        data: &[0b11],
        crc: &[0x3A],
    },
    Vector {
        source: "RESOLUTE 18 bit, all ones",
        format: "st18,nE,nW,crc6",
        slo: "1010111111111111111111110000100",
        head: HEAD,
        data: &[0xF_FFFF],
        crc: &[0x02],
    },
    Vector {
        source: "Broadcom AS37 (OnStepX configuration)",
        format: "mt16,st23,nE,nW,crc6",
        slo: "1010000000010000001001101000101011001111000111111100",
        head: HEAD,
        data: &[0x0102 << 25 | 0x34_5678 << 2 | 0b11],
        crc: &[0x3E],
    },
    Vector {
        source: "iC-MHM read by an MB3U master (BiSS AN22, logic analyser picture)",
        format: "st28,nE,nW,crc6",
        slo: "10100000000000000000001101011001111100010",
        head: HEAD,
        data: &[0xD67],
        crc: &[0x31],
    },
    Vector {
        source: "iC-MR temperature channel, CRC5 0x25 (iC-MR datasheet)",
        format: "data16=temp,crc5",
        slo: "10100000000100100011111010",
        head: HEAD,
        data: &[0x0123],
        crc: &[0x1D],
    },
    Vector {
        source: "PandABlocks-FPGA biss0.prn, an encoder recorded at 1 MHz",
        format: "st32,nE,nW,crc6",
        slo: "101000000000000000000000000111001010111011100",
        head: HEAD,
        data: &[458 << 2 | 0b11],
        crc: &[0x2E],
    },
    Vector {
        source: "PandABlocks-FPGA biss2.prn, one surplus clock",
        format: "st32,nE,nW,crc6",
        slo: "101011111111111111111111111110010000110000110",
        head: HEAD,
        data: &[0xFFFF_FF90 << 2 | 0b11],
        crc: &[0x03],
    },
];

fn trace(slo: &str) -> Trace {
    let mut trace = Trace {
        idle: Some(true),
        ..Trace::default()
    };
    trace.bits.extend(slo.bytes().map(|bit| bit == b'1'));
    trace
}

fn text(bits: &Bits) -> String {
    bits.iter().map(|bit| if bit { '1' } else { '0' }).collect()
}

#[test]
fn decode() {
    for vector in VECTORS {
        let protocol = BissC::new(vector.format.parse().unwrap());
        let mut cycle = Cycle::default();
        protocol.decode(&trace(vector.slo), &mut cycle);
        assert_eq!(cycle.fault(), None, "{}", vector.source);
        assert_eq!(cycle.head(), Some(vector.head), "{}", vector.source);
        let good: Vec<_> = cycle.words().iter().map(|word| word.good()).collect();
        let want: Vec<_> = vector.data.iter().copied().map(Some).collect();
        assert_eq!(good, want, "{}", vector.source);
        let crc: Vec<_> = cycle.words().iter().map(|word| word.raw().1).collect();
        assert_eq!(crc, vector.crc, "{}", vector.source);
    }
}

/// The published frames of encoders that have a preset, read through its name.
#[test]
fn presets_decode_what_is_published() {
    let mut seen = 0;
    for (name, source) in [
        ("resolute-18", "RESOLUTE 18 bit"),
        ("resolute-26", "RESOLUTE 26 bit"),
        ("resolute-32", "RESOLUTE 32 bit"),
        ("resolute-32", "PandABlocks-FPGA biss0.prn"),
    ] {
        let frame: Frame = name.parse().unwrap();
        let protocol = BissC::new(frame.format);
        for vector in VECTORS.iter().filter(|v| v.source.starts_with(source)) {
            let mut cycle = Cycle::default();
            protocol.decode(&trace(vector.slo), &mut cycle);
            assert_eq!(cycle.words()[0].good(), Some(vector.data[0]), "{name}");
            seen += 1;
        }
    }
    assert_eq!(seen, 4);
}

#[test]
fn emit_the_same_bits() {
    for vector in VECTORS {
        let format: Format = vector.format.parse().unwrap();
        let mut bits = Bits::default();
        emit(&format, vector.head, vector.data, &mut bits);
        let emitted = text(&bits);
        assert!(
            vector.slo.starts_with(&emitted),
            "{}: {emitted}",
            vector.source
        );
        assert!(
            vector.slo[emitted.len()..].bytes().all(|bit| bit == b'0'),
            "{}",
            vector.source
        );
    }
}

/// D2, p. 13, and its CRC computed: the null value passes its CRC and is no position.
#[test]
fn null_value() {
    let protocol = BissC::new("st24,nE,nW,crc6".parse().unwrap());
    let mut cycle = Cycle::default();
    protocol.decode(&trace("1010000000000000000000000000001111110"), &mut cycle);
    assert_eq!(cycle.words()[0].fault(), Some(biss::cycle::Fault::Null));
    assert_eq!(cycle.words()[0].good(), None);
    assert_eq!(cycle.words()[0].raw(), (0, 0x3F));
}

/// BiSS Safety: CPW and SPW of one encoder as two channels (BiSS Safety Concept A5, p. 4), and AN21's CRC16 example.
#[test]
fn safety_channels() {
    let format: Format = "mt12,st24,nE,nW,crc6+mt12,st24,nE,nW,lc6,crc16"
        .parse()
        .unwrap();
    let cpw = 0x123u64 << 26 | 0x45_6789 << 2 | 0b11;
    let spw = (0x123u64 << 26 | 0x45_6788 << 2 | 0b11) << 6 | 5;
    let crcs: Vec<u16> = format
        .channels()
        .iter()
        .zip([cpw, spw])
        .map(|(c, data)| c.crc().unwrap().of(data, c.data_bits()))
        .collect();
    assert_eq!(crcs, [0x34, 0x2968]);
    let started: Format = "mt12,st24,nE,nW,lc6,crc16:0x190D9:init=0xFFFF"
        .parse()
        .unwrap();
    let channel = &started.channels()[0];
    assert_eq!(channel.crc().unwrap().of(spw, channel.data_bits()), 0x7A97);

    let mut frame = trace("");
    emit(&format, HEAD, &[cpw, spw], &mut frame.bits);
    let mut cycle = Cycle::default();
    BissC::new(format).decode(&frame, &mut cycle);
    let good: Vec<_> = cycle.words().iter().map(|word| word.good()).collect();
    assert_eq!(good, [Some(cpw), Some(spw)]);

    let an21: Format = "mt12,st20,nE,nW,lc6,crc16".parse().unwrap();
    let mut frame = trace("");
    emit(&an21, HEAD, &[0xD9_CFE0_C0DA], &mut frame.bits);
    assert!(text(&frame.bits).ends_with(&format!("{:016b}0", 0x5F29)));
}
