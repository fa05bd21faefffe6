//! The simulated slave at the far end of two lines, in a thread of its own.

use super::lines::Line;
use crate::link::{Error, Monotonic};
use crate::slave::{Config, Slave};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

/// A slave that answers until it is told to stop.
#[derive(Debug)]
pub struct Served {
    ended: Arc<AtomicBool>,
    latched: Arc<Mutex<Vec<u64>>>,
    thread: JoinHandle<Result<(Line, Line), Error>>,
}

impl Served {
    /// Looks at MA on `ma_in` and drives SLO on `slo_out` as fast as it can.
    pub fn start(ma_in: Line, slo_out: Line, config: Config) -> Served {
        let ended = Arc::new(AtomicBool::new(false));
        let latched = Arc::new(Mutex::new(Vec::new()));
        let (stop, words) = (Arc::clone(&ended), Arc::clone(&latched));
        let thread = std::thread::spawn(move || {
            serve(&ma_in, &slo_out, config, &stop, &words)?;
            Ok((ma_in, slo_out))
        });
        Served {
            ended,
            latched,
            thread,
        }
    }

    /// Whether these are the data words latched last.
    pub fn sent(&self, words: impl IntoIterator<Item = u64>) -> bool {
        let latched = self.latched.lock().unwrap_or_else(PoisonError::into_inner);
        words.into_iter().eq(latched.iter().copied())
    }

    /// Ends it and gives the lines back.
    ///
    /// # Errors
    /// What ended it before it was told to.
    pub fn stop(self) -> Result<(Line, Line), Error> {
        self.ended.store(true, Ordering::Relaxed);
        self.thread.join().unwrap_or_else(|_| {
            Err(Error::new(
                "running the simulated slave in a thread",
                "it panicked",
                "this is an error of biss: please report it",
            ))
        })
    }
}

fn serve(
    ma_in: &Line,
    slo_out: &Line,
    config: Config,
    stop: &AtomicBool,
    latched: &Mutex<Vec<u64>>,
) -> Result<(), Error> {
    let mut time = Monotonic::start();
    time.share();
    let mut slave = Slave::new(config);
    let mut out = slave.slo(0);
    let mut latches = 0;
    slo_out.set(out)?;
    while !stop.load(Ordering::Relaxed) {
        let ma = ma_in.get()?;
        // The edge was before the look.
        slave.ma(time.now_ns(), ma);
        let slo = slave.slo(time.now_ns());
        if slo != out {
            slo_out.set(slo)?;
            out = slo;
        }
        if slave.latches() != latches {
            latches = slave.latches();
            let mut words = latched.lock().unwrap_or_else(PoisonError::into_inner);
            words.clear();
            words.extend(slave.latched());
        }
        time.yields();
    }
    Ok(())
}
