//! CSV as Saleae Logic 2 exports digital channels: `Time [s],MA,SLO`, one row for each change.

use super::{Head, Lines, Recorder};
use crate::waveform::Change;
use std::io;

pub(super) struct Csv {
    lines: Lines,
    last: Change,
}

impl Csv {
    pub(super) fn begin(lines: Lines, head: &Head) -> io::Result<Csv> {
        let mut csv = Csv {
            lines,
            last: head.first,
        };
        csv.lines.add(format_args!("Time [s],MA,SLO\n"))?;
        csv.row(head.first.t_ns)?;
        Ok(csv)
    }

    fn row(&mut self, t_ns: u64) -> io::Result<()> {
        let (seconds, ns) = (t_ns / 1_000_000_000, t_ns % 1_000_000_000);
        let (ma, slo) = (u8::from(self.last.ma), u8::from(slo(&self.last)));
        self.lines
            .add(format_args!("{seconds}.{ns:09},{ma},{slo}\n"))?;
        self.lines.pass()
    }
}

/// There is no third level.
fn slo(change: &Change) -> bool {
    change.slo == Some(true)
}

impl Recorder for Csv {
    fn change(&mut self, change: &Change) -> io::Result<()> {
        if self.last.ma == change.ma && slo(&self.last) == slo(change) {
            return Ok(());
        }
        let t_ns = change.t_ns.max(self.last.t_ns);
        self.last = Change { t_ns, ..*change };
        self.row(t_ns)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.lines.write()
    }

    /// The last row says how long the levels stayed.
    fn end(&mut self, t_ns: u64) -> io::Result<()> {
        if t_ns > self.last.t_ns {
            self.row(t_ns)?;
        }
        self.lines.write()
    }
}
