#![no_main]

use biss_fuzz::{drain, with_head};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| drain(&with_head(b"PK\x03\x04", data), |_| ()));
