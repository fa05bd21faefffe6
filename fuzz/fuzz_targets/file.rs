#![no_main]

use biss_fuzz::drain_as;
use libfuzzer_sys::fuzz_target;

const FORMATS: [&str; 4] = [
    "st26,nE,nW,crc6",
    "mt12,st20,nE,nW,crc6",
    "mt12,st24,nE,nW,crc6+mt12,st24,nE,nW,lc6,crc16",
    "data64=all",
];

// The first byte says how the recording is asked for. Its kind is found from what is in it.
fuzz_target!(|data: &[u8]| {
    let (how, bytes) = data.split_first().unwrap_or((&0, &[]));
    let format = FORMATS[usize::from(how >> 6)];
    drain_as(bytes, format, |asked| {
        asked.rate = (how & 1 == 1).then(|| "10MHz".parse().expect("a rate"));
        asked.unit = (how & 3 == 3).then_some(1 + (how >> 2 & 1));
        if how >> 3 & 1 == 1 {
            (asked.ma, asked.slo) = (Some("0".into()), Some("1".into()));
        }
        if how >> 4 & 1 == 1 {
            asked.timeout_max_ns = 12_000;
        }
    });
});
