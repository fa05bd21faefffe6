#![no_main]

use biss_fuzz::{drain, with_head};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| drain(&with_head(b"Time [ns],MA,SLO\n", data), |_| ()));
