//! BiSS-C encoders on plain Linux pins.
//!
//! One cycle, as MA and SLO show it (BiSS C protocol description D2, p. 5-7):
//!
//! ```text
//! edge          1     2     3     4     5     6        n-1    n
//!       _____    __    __    __    __    __    __        __    __________________
//! MA         |__|  |__|  |__|  |__|  |__|  |__|   .. ___|  |__|
//!       _______________       _____       _____ _____    ______              _______
//! SLO                  |_____|     |_____|__D__|__D__ .. |__C__|____________|
//!        idle    LAT    Ack   Start  CDS   data          CRC    stop, timeout  ready
//! ```
//!
//! * **MA**: clock, master to slave, idle high. **SLO**, at the master **SL**: data, idle high, changes after rising
//!   MA edges, which count from 1.
//! * **LAT**: rising edge 1, the moment of measurement. **Ack**: SLO falls with edge 2 and stays low while the slave is
//!   busy. **Start**: the 1 after it. **CDS**: control bit of the slave, one a frame.
//! * **Channels**: data and CRC, most significant bit first; **nE** and **nW** are 0 for error and warning. **Stop**: 0.
//! * **Timeout**: after the last edge; when it has passed SLO is 1 again. MA's level then is **CDM**, the control bit of
//!   the master, inverted.
//! * **Line delay**: from the second rising MA edge to SL falling.
//!
//! The library is an hourglass. A [`link`] runs cycles on two wires and returns one [`trace::Trace`] each: one SL level
//! per rising edge. A [`protocol::Protocol`], BiSS-C being [`frame::BissC`], turns a trace into words or a named
//! [`cycle::Fault`]. The [`master::Master`] joins them. The [`slave`] is the other end of the wires.
//!
//! One CDM bit out and one CDS bit back in each cycle are the control communication: [`control`] knows its bits,
//! [`registers::Registers`] reads and writes over a master, [`identify`] finds out who is on the line and what they send.
//!
//! ```
//! use biss::{frame::BissC, link::sim, master::Master};
//!
//! let mut link = sim::open("motion=count,pos=458,frame=st32,nE,nW,crc6".parse()?);
//! let protocol = BissC::new("st32,nE,nW,crc6".parse()?);
//! let mut master = Master::new(&mut link, &protocol, None);
//! assert!(master.open()?, "an encoder answers");
//! master.slot(0, None)?;
//! let channel = &protocol.format.channels()[0];
//! let word = master.cycle().words()[0].good().expect("a good frame");
//! assert!(channel.position().map(|field| field.get(word)) >= Some(458));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod config;
pub mod control;
pub mod crc;
pub mod cycle;
pub mod detect;
pub mod diagnose;
pub mod diagram;
pub mod format;
pub mod frame;
pub mod identify;
pub mod identity;
pub mod limits;
pub mod link;
pub mod loopback;
pub mod master;
pub mod measure;
pub mod pair;
pub mod parse;
pub mod pattern;
pub mod place;
pub mod preset;
pub mod protocol;
pub mod record;
pub mod registers;
pub mod scan;
pub mod slave;
pub mod slice;
pub mod stats;
pub mod trace;
pub mod track;
pub mod trials;
pub mod unit;
pub mod waveform;

pub use format::Format;
pub use parse::ParseError;
