#![no_main]

use biss_fuzz::drain;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| drain(data, |asked| {
    asked.rate = Some("10MHz".parse().expect("a rate"));
    asked.unit = Some(1);
    if data.first().is_some_and(|first| first % 2 == 1) {
        (asked.ma, asked.slo) = (Some("0".into()), Some("1".into()));
    }
}));
