//! The limits of BiSS-C, each where its number comes from: BiSS C protocol description D2.

use crate::unit::Hertz;

/// After power-up, after a fault and after any abort MA rests high for so long; everything resets (D2, p. 12).
pub const REST_NS: u64 = 40_000;

/// Shortest static timeout of a slave (D2 Table 10).
pub const TIMEOUT_MIN_NS: u64 = 12_500;

/// Longest timeout of a slave (D2 Table 10).
pub const TIMEOUT_MAX_NS: u64 = 40_000;

/// Longest line delay, second rising MA edge to SL falling (D2 Table 10).
pub const LINE_DELAY_MAX_NS: u64 = 40_000;

/// Longest processing time, LAT to start (D2 Table 10).
pub const BUSY_MAX_NS: u64 = 40_000;

/// Clocks by which a start bit may be late whatever the time limits say (busy_s, D2 Table 10).
pub const BUSY_CLOCKS: u16 = 8;

/// Slowest MA clock (D2 Table 10).
pub const CLOCK_MIN_HZ: u32 = 80_000;

/// The fastest MA clock that every slave bears at first contact (D2 Table 10); the slowest such one is 250 kHz.
pub const CLOCK_FIRST: Hertz = Hertz(1_000_000);

/// How long MA may stand when the encoder's timeout is not known: a little below the shortest.
pub const LEVEL_MAX_NS: u64 = 12_000;
