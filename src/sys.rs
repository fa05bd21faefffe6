//! What only the operating system can do: signals, scheduling, pacing. The only unsafe code.
#![allow(unsafe_code)]

mod ahead;

use ahead::Ahead;
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGTSTP};
use signal_hook::{flag, low_level};
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom};
use std::os::fd::{AsFd, AsRawFd};
use std::os::unix::fs::OpenOptionsExt;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// Ends loops on Ctrl-C, SIGTERM and SIGHUP, and wakes waits.
#[derive(Debug)]
pub(crate) struct Signals {
    caught: Arc<AtomicUsize>,
    /// SIGQUIT has come.
    asked: Arc<AtomicBool>,
    wake: UnixStream,
}

impl Signals {
    /// Catches the first signal; a second one of the same kind ends the process at once.
    pub(crate) fn catch() -> io::Result<Signals> {
        let caught = Arc::new(AtomicUsize::new(0));
        let (wake, write) = UnixStream::pair()?;
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            let armed = Arc::new(AtomicBool::new(false));
            // In this order: the first signal finds the flag not set yet.
            flag::register_conditional_default(signal, Arc::clone(&armed))?;
            flag::register(signal, armed)?;
            flag::register_usize(signal, Arc::clone(&caught), signal as usize)?;
            low_level::pipe::register(signal, write.try_clone()?)?;
        }
        Ok(Signals {
            caught,
            asked: Arc::default(),
            wake,
        })
    }

    /// From here on SIGQUIT asks how it goes, and ends nothing.
    pub(crate) fn answer_quit(&mut self) -> io::Result<()> {
        flag::register(SIGQUIT, Arc::clone(&self.asked)).map(drop)
    }

    /// Whether somebody has asked how it goes, since the last time.
    pub(crate) fn was_asked(&self) -> bool {
        self.asked.load(Ordering::Relaxed) && self.asked.swap(false, Ordering::Relaxed)
    }

    /// The signal that was caught.
    pub(crate) fn caught(&self) -> Option<i32> {
        let signal = self.caught.load(Ordering::Relaxed);
        i32::try_from(signal).ok().filter(|signal| *signal != 0)
    }

    /// Whether a signal was caught, asked from elsewhere.
    pub(crate) fn watch(&self) -> impl Fn() -> bool + use<> {
        let caught = Arc::clone(&self.caught);
        move || caught.load(Ordering::Relaxed) != 0
    }

    /// Waits so long, or until a signal comes, or somebody asks.
    pub(crate) fn wait(&mut self, time: Duration) {
        let end = Instant::now() + time;
        // A socket's timeout counts in scheduler ticks: it serves for the long part only.
        const TICKS: Duration = Duration::from_millis(20);
        // Who asks need not be answered at once, and must not be forgotten.
        const PATIENCE: Duration = Duration::from_millis(200);
        while self.caught().is_none() && !self.asked.load(Ordering::Relaxed) {
            let left = end.saturating_duration_since(Instant::now());
            if left <= TICKS {
                std::thread::sleep(left);
                return;
            }
            let timeout = self
                .wake
                .set_read_timeout(Some((left - TICKS / 2).min(PATIENCE)));
            if timeout.is_err() || matches!(self.wake.read(&mut [0]), Ok(1..)) {
                return;
            }
        }
    }
}

/// A file or pipe that calls back before it waits for data, and that ends when a signal comes.
pub(crate) struct Input {
    file: File,
    wake: UnixStream,
    caught: Arc<AtomicUsize>,
    before_wait: Box<dyn FnMut()>,
    /// Read from one place on, so many bytes in a row.
    in_row: u64,
    /// A whole file, and where in it the next byte is.
    whole: Option<u64>,
    ahead: Option<Ahead>,
}

/// From so many bytes in a row on a file is read by another thread: short ones are not worth one.
const WORTH_A_THREAD: u64 = 4 << 20;

impl Input {
    pub(crate) fn new(
        file: File,
        signals: &Signals,
        before_wait: impl FnMut() + 'static,
    ) -> io::Result<Input> {
        let wake = signals.wake.try_clone()?;
        Ok(Input {
            wake,
            caught: Arc::clone(&signals.caught),
            before_wait: Box::new(before_wait),
            in_row: 0,
            whole: is_whole(&file).then_some(0),
            ahead: None,
            file,
        })
    }

    /// What is left of a file that is long enough comes from another thread, where there is a processor for it.
    fn read_ahead(&mut self) {
        let Some(at) = self.whole else {
            return;
        };
        let left = self.file.metadata().map_or(0, |data| data.len());
        let alone = std::thread::available_parallelism().is_ok_and(|n| n.get() == 1);
        if alone || left.saturating_sub(at) < WORTH_A_THREAD {
            return;
        }
        // Without one it is read as before.
        let ahead = self.file.try_clone();
        self.ahead = ahead.and_then(|file| Ahead::start(file, at)).ok();
    }

    /// Whether there is something to read, or its end, within so many milliseconds; -1 waits for a signal too.
    fn ready(&self, timeout_ms: i32) -> io::Result<bool> {
        let entry = |fd: i32| libc::pollfd {
            fd,
            events: libc::POLLIN,
            revents: 0,
        };
        let mut fds = [entry(self.file.as_raw_fd()), entry(self.wake.as_raw_fd())];
        // SAFETY: the pointer and the count are those of a live array.
        let n = unsafe { libc::poll(fds.as_mut_ptr(), fds.len() as libc::nfds_t, timeout_ms) };
        if n < 0 {
            let error = io::Error::last_os_error();
            return if error.kind() == io::ErrorKind::Interrupted {
                Ok(false)
            } else {
                Err(error)
            };
        }
        Ok(fds[0].revents != 0)
    }

    /// Until there is something to read, or a signal has come.
    fn wait(&mut self) -> io::Result<()> {
        if !self.ready(0)? {
            (self.before_wait)();
        }
        while !self.ready(-1)? {
            if self.caught.load(Ordering::Relaxed) != 0 {
                break;
            }
        }
        Ok(())
    }
}

impl Input {
    /// As [`Read::read`]; `block` may be exchanged for another one, so that nothing has to be copied.
    pub(crate) fn exchange(&mut self, block: &mut Vec<u8>) -> io::Result<usize> {
        self.read_by(block, |ahead, block| ahead.exchange(block))
    }

    fn read_by<B: AsMut<[u8]> + ?Sized>(
        &mut self,
        buffer: &mut B,
        from: impl FnOnce(&mut Ahead, &mut B) -> io::Result<usize>,
    ) -> io::Result<usize> {
        if self.ahead.is_none() {
            self.wait()?;
        }
        if self.caught.load(Ordering::Relaxed) != 0 {
            return Ok(0);
        }
        let n = match &mut self.ahead {
            Some(ahead) => from(ahead, buffer)?,
            None => self.file.read(buffer.as_mut())?,
        };
        let before = self.in_row;
        self.in_row += n as u64;
        self.whole = self.whole.map(|at| at + n as u64);
        if before < WORTH_A_THREAD && self.in_row >= WORTH_A_THREAD {
            self.read_ahead();
        }
        Ok(n)
    }
}

impl Read for Input {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.read_by(buffer, Read::read)
    }
}

impl Seek for Input {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let to = match (to, self.whole) {
            // The file's own place is not ours while it is read ahead.
            (SeekFrom::Current(by), Some(at)) => SeekFrom::Start(at.saturating_add_signed(by)),
            (to, _) => to,
        };
        let at = self.file.seek(to)?;
        self.whole = self.whole.map(|_| at);
        (self.ahead, self.in_row) = (None, 0);
        Ok(at)
    }
}

/// Whether every place in it can be read, and nothing was read so far.
pub(crate) fn is_whole(mut file: &File) -> bool {
    file.metadata().is_ok_and(|data| data.is_file())
        && file.stream_position().is_ok_and(|at| at == 0)
}

/// A file to read as [`Input`], which waits for the writer of a named pipe too: then a signal ends that wait.
pub(crate) fn open(path: &Path) -> io::Result<File> {
    OpenOptions::new()
        .read(true)
        .custom_flags(libc::O_NONBLOCK)
        .open(path)
}

/// Standard input as a file of its own.
pub(crate) fn stdin() -> io::Result<File> {
    Ok(File::from(io::stdin().as_fd().try_clone_to_owned()?))
}

/// After cleaning up: what the signal would have done to a process that does not catch it. Service managers take
/// an exit status of 143 for a failure, a death by SIGTERM not.
pub(crate) fn die_by(signal: i32) {
    if signal != SIGINT {
        // Falls through to an ordinary exit where it cannot be raised.
        let _ = low_level::emulate_default_handler(signal);
    }
}

/// SCHED_FIFO at this priority, all memory locked.
pub(crate) fn real_time(priority: u8) -> io::Result<()> {
    let parameter = libc::sched_param {
        sched_priority: priority.into(),
    };
    // SAFETY: the pointer is to a live sched_param; 0 is this process.
    let scheduled = unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &parameter) };
    if scheduled != 0 {
        return Err(io::Error::last_os_error());
    }
    // SAFETY: takes flags only.
    match unsafe { libc::mlockall(libc::MCL_CURRENT | libc::MCL_FUTURE) } {
        0 => Ok(()),
        _ => Err(io::Error::last_os_error()),
    }
}

/// This process runs on one processor only.
pub(crate) fn pin_to_cpu(cpu: usize) -> io::Result<()> {
    if cpu >= libc::CPU_SETSIZE as usize {
        return Err(io::Error::from(io::ErrorKind::InvalidInput));
    }
    // SAFETY: cpu_set_t is an array of integers, for which all zeros is the empty set.
    let mut set: libc::cpu_set_t = unsafe { std::mem::zeroed() };
    // SAFETY: `cpu` is below CPU_SETSIZE, so the bit lies within the set.
    unsafe { libc::CPU_SET(cpu, &mut set) };
    // SAFETY: the pointer and the size are those of a live cpu_set_t; 0 is this process.
    match unsafe { libc::sched_setaffinity(0, size_of::<libc::cpu_set_t>(), &set) } {
        0 => Ok(()),
        _ => Err(io::Error::last_os_error()),
    }
}

/// What the terminal has to be told when it is given back.
static FAREWELL: OnceLock<&'static [u8]> = OnceLock::new();
/// How it took keys before; none where they do not come from a terminal.
static BEFORE: OnceLock<Option<libc::termios>> = OnceLock::new();
/// It is ours.
static TAKEN: AtomicBool = AtomicBool::new(false);

/// The terminal, taken for a picture on all of it and for keys without echo. It is given back when this is dropped, when
/// a signal ends the process, when it is stopped, and before a panic is told of.
pub(crate) struct Terminal {
    stops: Arc<AtomicBool>,
}

impl Terminal {
    /// `farewell` undoes what is going to be printed.
    pub(crate) fn take(farewell: &'static [u8]) -> io::Result<Terminal> {
        FAREWELL.get_or_init(|| farewell);
        BEFORE.get_or_init(keys);
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            // SAFETY: the action does nothing but what a signal handler may: atomics, write and tcsetattr.
            unsafe { low_level::register(signal, give_back) }?;
        }
        let stops = Arc::new(AtomicBool::new(false));
        flag::register(SIGTSTP, Arc::clone(&stops))?;
        let told = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            give_back();
            told(panic);
        }));
        let terminal = Terminal { stops };
        terminal.again();
        Ok(terminal)
    }

    /// Keys come one by one, and are not shown.
    fn again(&self) {
        TAKEN.store(true, Ordering::SeqCst);
        if let Some(Some(before)) = BEFORE.get() {
            let mut now = *before;
            now.c_lflag &= !(libc::ICANON | libc::ECHO);
            now.c_cc[libc::VMIN] = 0;
            now.c_cc[libc::VTIME] = 0;
            set_keys(&now);
        }
    }

    /// The next key that was pressed.
    pub(crate) fn key(&self) -> Option<u8> {
        BEFORE.get()?.as_ref()?;
        if !self.is_taken() {
            // Keys come line by line again: this would wait for one.
            return None;
        }
        let mut key = 0u8;
        // SAFETY: the pointer is to one live byte. With VMIN and VTIME 0 nothing is waited for.
        let n = unsafe { libc::read(libc::STDIN_FILENO, (&raw mut key).cast(), 1) };
        (n == 1).then_some(key)
    }

    /// Whether it has not been given back.
    pub(crate) fn is_taken(&self) -> bool {
        TAKEN.load(Ordering::SeqCst)
    }

    /// Stops the process where Ctrl-Z was pressed. True when it goes on after that.
    pub(crate) fn stop_if_asked(&self) -> bool {
        if !self.stops.swap(false, Ordering::Relaxed) {
            return false;
        }
        give_back();
        // Where it cannot be stopped it simply goes on.
        let _ = low_level::emulate_default_handler(SIGTSTP);
        self.again();
        true
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        give_back();
    }
}

fn keys() -> Option<libc::termios> {
    // SAFETY: termios is made of integers, for which zeros are values.
    let mut now: libc::termios = unsafe { std::mem::zeroed() };
    // SAFETY: the pointer is to a live termios.
    let there = unsafe { libc::tcgetattr(libc::STDIN_FILENO, &mut now) } == 0;
    there.then_some(now)
}

fn set_keys(how: &libc::termios) {
    // SAFETY: the pointer is to a live termios. A terminal that is gone needs nothing.
    unsafe { libc::tcsetattr(libc::STDIN_FILENO, libc::TCSANOW, how) };
}

/// In a signal handler too.
fn give_back() {
    if !TAKEN.swap(false, Ordering::SeqCst) {
        return;
    }
    if let Some(farewell) = FAREWELL.get() {
        // SAFETY: pointer and length are those of a static. A terminal that is gone needs nothing.
        unsafe {
            libc::write(
                libc::STDOUT_FILENO,
                farewell.as_ptr().cast(),
                farewell.len(),
            )
        };
    }
    if let Some(Some(before)) = BEFORE.get() {
        set_keys(before);
    }
}
