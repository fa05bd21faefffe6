//! BiSS-C encoders on plain Linux pins.

pub mod crc;
pub mod format;
pub mod parse;
pub mod slave;
pub mod unit;

pub use format::Format;
pub use parse::ParseError;
