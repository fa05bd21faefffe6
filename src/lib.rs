//! BiSS-C encoders on plain Linux pins.

pub mod crc;
pub mod format;
pub mod frame;
pub mod link;
pub mod master;
pub mod parse;
pub mod protocol;
pub mod slave;
pub mod slice;
pub mod trace;
pub mod track;
pub mod unit;

pub use format::Format;
pub use parse::ParseError;
