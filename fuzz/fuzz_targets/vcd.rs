#![no_main]

use biss_fuzz::{drain, with_head};
use libfuzzer_sys::fuzz_target;

const HEAD: &[u8] =
    b"$timescale 1 ns $end $var wire 1 ! ma $end $var wire 1 \" slo $end $enddefinitions $end\n";

fuzz_target!(|data: &[u8]| drain(&with_head(HEAD, data), |_| ()));
