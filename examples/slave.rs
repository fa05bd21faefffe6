//! The library's simulated slave as a process of its own: MA in, SLO out, a byte a tick each way.
//!
//! `slave [tick=TIME] [CONFIG]`, where CONFIG is what a `sim:` link takes and TIME the tick of the `exec:` link, 8ns unless
//! said. See `docs/exec.md`.

use biss::slave::{Config, Slave};
use biss::unit::Nanos;
use std::error::Error;
use std::io::{self, Read, Write};
use std::process::ExitCode;

/// What the master expects where nobody says otherwise.
const TICK: Nanos = Nanos(8);

fn main() -> ExitCode {
    match arguments().and_then(|(slave, tick)| serve(slave, tick, io::stdin(), io::stdout())) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // stdout is SLO's.
            let _ = writeln!(io::stderr(), "slave: {error}");
            ExitCode::from(2)
        }
    }
}

fn arguments() -> Result<(Slave, Nanos), Box<dyn Error>> {
    let (mut config, mut tick) = (Config::default(), TICK);
    for argument in std::env::args().skip(1) {
        match argument.strip_prefix("tick=") {
            Some(time) => tick = time.parse()?,
            None => config = argument.parse()?,
        }
    }
    Ok((Slave::new(config), tick))
}

/// Answers each level of MA with the level of SLO at the end of that tick, until there are no more.
pub fn serve(
    mut slave: Slave,
    tick: Nanos,
    mut ma: impl Read,
    mut slo: impl Write,
) -> Result<(), Box<dyn Error>> {
    let mut now_ns = 0;
    let mut levels = [0; 4096];
    loop {
        let ticks = match ma.read(&mut levels)? {
            0 => return Ok(()),
            ticks => ticks,
        };
        for level in &mut levels[..ticks] {
            slave.ma(now_ns, *level == b'1');
            now_ns += tick.0;
            *level = if slave.slo(now_ns) { b'1' } else { b'0' };
        }
        slo.write_all(&levels[..ticks])?;
        slo.flush()?;
    }
}
