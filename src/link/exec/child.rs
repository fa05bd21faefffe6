//! The child process: bytes to it and back, what can go wrong with it, and its end.

use crate::link::Error;
use crate::link::spec::Process;
use crate::unit::Nanos;
use nix::errno::Errno;
use nix::fcntl::{FcntlArg, OFlag, fcntl};
use nix::poll::{PollFd, PollFlags, poll};
use nix::sys::signal::{Signal, killpg};
use nix::sys::wait::{Id, WaitPidFlag, WaitStatus, waitid};
use nix::unistd::Pid;
use std::fmt;
use std::io::{self, ErrorKind, Read, Write};
use std::os::fd::{AsRawFd, RawFd};
use std::os::unix::process::CommandExt;
use std::process::{self, ChildStdin, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

/// Signals are looked for so often while nothing comes.
const SLICE_MS: i32 = 100;

/// From a signal on: for a child that answers, longer than an access that must not be cut is borne with; for one that
/// does not.
const STOP_BUSY: Duration = Duration::from_secs(3);
const STOP_SILENT: Duration = Duration::from_millis(500);

/// A child that has closed a pipe may be about to end, or to say why.
const LAST_WORDS: Duration = Duration::from_millis(200);

pub(super) struct Child {
    command: String,
    silence: Duration,
    stop: Box<dyn Fn() -> bool>,
    process: process::Child,
    stdin: Option<ChildStdin>,
    stdout: ChildStdout,
    buffer: Box<[u8]>,
    /// Answers so far.
    answered: u64,
    /// When a signal was first seen to wait.
    stop_seen: Option<Instant>,
    /// It has failed: there is nothing to say to it any more.
    sound: bool,
}

/// One exchange.
struct Talk {
    sent: usize,
    back: usize,
    /// It takes no more bytes since then.
    deaf: Option<Instant>,
    heard: Instant,
}

impl Child {
    pub(super) fn start(options: &Process, stop: Box<dyn Fn() -> bool>) -> Result<Child, Error> {
        let wrong = |said: io::Error| {
            Error::new(
                format!("starting `{}` with /bin/sh", options.command),
                said,
                "is a limit of this process used up (`ulimit -a`)?",
            )
        };
        // Ctrl-C goes to a whole process group. The child has one of its own: it ends when we say so, MA high first.
        let mut process = Command::new("/bin/sh")
            .args(["-c", &options.command])
            .process_group(0)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(wrong)?;
        let (Some(stdin), Some(stdout)) = (process.stdin.take(), process.stdout.take()) else {
            unreachable!("both are pipes")
        };
        let child = Child {
            command: options.command.clone(),
            silence: Duration::from_nanos(options.silence.0),
            stop,
            process,
            stdin: Some(stdin),
            stdout,
            buffer: vec![0; 1 << 16].into(),
            answered: 0,
            stop_seen: None,
            sound: true,
        };
        let ends = [
            child.stdin.as_ref().map(AsRawFd::as_raw_fd),
            Some(child.stdout.as_raw_fd()),
        ];
        match ends.into_iter().flatten().try_for_each(never_block) {
            Ok(()) => Ok(child),
            Err(said) => Err(wrong(said)),
        }
    }

    /// Sends `out`, a byte a tick, and waits for as many answers. The last one.
    pub(super) fn exchange(&mut self, out: &[u8]) -> Result<Option<u8>, Error> {
        let result = self.talk(out);
        self.sound = result.is_ok();
        result
    }

    fn talk(&mut self, out: &[u8]) -> Result<Option<u8>, Error> {
        let mut talk = Talk {
            sent: 0,
            back: 0,
            deaf: None,
            heard: Instant::now(),
        };
        let mut last = None;
        while talk.back < out.len() {
            // Read first: what is there before anything was sent answers nothing.
            match self.stdout.read(&mut self.buffer) {
                Ok(0) => return Err(self.ended()),
                Ok(bytes) => {
                    self.judge(bytes, &talk)?;
                    talk.back += bytes;
                    self.answered += bytes as u64;
                    talk.heard = Instant::now();
                    last = self.buffer[..bytes].last().copied();
                    continue;
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                Err(error) => return Err(self.error(error, HINT_RUN)),
            }
            if talk.deaf.is_none() && talk.sent < out.len() {
                self.send(out, &mut talk)?;
            }
            self.wait(out, &mut talk)?;
        }
        if (self.stop)() {
            self.bear(talk.heard)?;
        }
        Ok(last)
    }

    /// As much as goes into the pipe.
    fn send(&mut self, out: &[u8], talk: &mut Talk) -> Result<(), Error> {
        let Some(stdin) = &mut self.stdin else {
            return Ok(());
        };
        match stdin.write(&out[talk.sent..]) {
            Ok(bytes) => talk.sent += bytes,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) if error.kind() == ErrorKind::WouldBlock => {}
            // What it has printed, or how it ended, says more.
            Err(error) if error.kind() == ErrorKind::BrokenPipe => talk.deaf = Some(Instant::now()),
            Err(error) => return Err(self.error(error, HINT_RUN)),
        }
        Ok(())
    }

    /// Until something can be read or sent.
    fn wait(&mut self, out: &[u8], talk: &mut Talk) -> Result<(), Error> {
        let full = talk.sent < out.len();
        // Asked for nothing, a pipe still tells that nobody reads it any more.
        let wanted = [PollFlags::empty(), PollFlags::POLLOUT][usize::from(full)];
        let answers = PollFd::new(&self.stdout, PollFlags::POLLIN);
        let hears = self.stdin.as_ref().filter(|_| talk.deaf.is_none());
        let mut ends = [answers, answers];
        let count = match hears {
            Some(stdin) => {
                ends[1] = PollFd::new(stdin, wanted);
                2
            }
            None => 1,
        };
        let ready = poll(&mut ends[..count], SLICE_MS);
        let closed = PollFlags::POLLERR;
        if count == 2 && ends[1].revents().is_some_and(|what| what.contains(closed)) {
            talk.deaf = Some(Instant::now());
        }
        if talk.deaf.is_some_and(|since| since.elapsed() > LAST_WORDS) {
            return Err(self.error(
                format!("it has closed its stdin {}", self.when()),
                "it has to read MA from there until that ends, a byte a tick",
            ));
        }
        match ready {
            Ok(0) | Err(Errno::EINTR) => self.bear(talk.heard),
            Ok(_) => Ok(()),
            Err(errno) => Err(self.error(errno, HINT_RUN)),
        }
    }

    /// Whether it is worth to wait on.
    fn bear(&mut self, heard: Instant) -> Result<(), Error> {
        let silent = heard.elapsed();
        if (self.stop)() {
            let since = self.stop_seen.get_or_insert_with(Instant::now).elapsed();
            if since > STOP_BUSY || since.min(silent) > STOP_SILENT {
                return self.stopped();
            }
        }
        if silent > self.silence {
            let silence = Nanos(self.silence.as_nanos() as u64);
            let said = match self.answered {
                0 => format!("it has answered nothing for {silence}"),
                _ => format!("it has answered nothing for {silence}, {}", self.when()),
            };
            return Err(self.error(said, HINT_SILENT));
        }
        Ok(())
    }

    /// Whether a signal has said that it is time to end.
    pub(super) fn stopped(&self) -> Result<(), Error> {
        match (self.stop)() {
            false => Ok(()),
            true => Err(self.error(
                "stopped by a signal while it was at work",
                "a longer tick takes less work",
            )),
        }
    }

    /// What has been read: nothing but levels, and no more of them than were asked for.
    fn judge(&mut self, bytes: usize, talk: &Talk) -> Result<(), Error> {
        /// So much of what should not be there is shown.
        const SHOWN: usize = 40;
        let read = &self.buffer[..bytes];
        if let Some(at) = read.iter().position(|byte| !matches!(byte, b'0' | b'1')) {
            let strange = &read[at..bytes.min(at + SHOWN)];
            let dots = if bytes > at + SHOWN { "…" } else { "" };
            let when = When(self.answered + at as u64);
            return Err(self.error(
                format!(
                    "it printed \"{}{dots}\" for SLO, {when}",
                    strange.escape_ascii()
                ),
                "its stdout is for the bytes 0 and 1 alone, without line ends: messages go to stderr (>&2)",
            ));
        }
        if talk.back + bytes > talk.sent {
            return Err(self.error(
                format!("it answers more than it was asked, {}", self.when()),
                "it has to wait for a byte of MA, and answer each with one byte of SLO",
            ));
        }
        Ok(())
    }

    /// Its stdout is at its end.
    fn ended(&self) -> Error {
        let when = self.when();
        match self.status(LAST_WORDS) {
            Some(WaitStatus::Exited(_, status)) => {
                let hint = match status {
                    126 | 127 => "the shell cannot run that: is it there, executable, and in PATH?",
                    _ => HINT_RUN,
                };
                let meant = status
                    .checked_sub(128)
                    .and_then(|number| Signal::try_from(number).ok())
                    .map(|signal| format!(" (the shell's word for {signal})"))
                    .unwrap_or_default();
                self.error(
                    format!("it ended with exit status {status}{meant} {when}"),
                    hint,
                )
            }
            Some(WaitStatus::Signaled(_, signal, _)) => {
                self.error(format!("it was killed by {signal} {when}"), HINT_RUN)
            }
            _ => self.error(
                format!("it has closed its stdout {when}"),
                "it has to answer each byte of MA there until its stdin ends",
            ),
        }
    }

    /// How it ended, if it does so in time. It stays there, so that its process group cannot become another's.
    fn status(&self, patience: Duration) -> Option<WaitStatus> {
        let since = Instant::now();
        let flags = WaitPidFlag::WEXITED | WaitPidFlag::WNOHANG | WaitPidFlag::WNOWAIT;
        loop {
            match waitid(Id::Pid(self.pid()), flags) {
                Ok(WaitStatus::StillAlive) | Err(Errno::EINTR) => {}
                other => return other.ok(),
            }
            if since.elapsed() >= patience {
                return None;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Nothing is worth a longer wait any more.
    pub(super) fn hurry(&mut self, patience: Duration) {
        self.silence = self.silence.min(patience);
        self.stop_seen = None;
    }

    /// Whether it can be talked to.
    pub(super) fn is_sound(&self) -> bool {
        self.sound
    }

    /// Its stdin ends, so it should. What it still prints then is no answer to anything.
    pub(super) fn end(&mut self, patience: Duration) {
        self.stdin = None;
        let since = Instant::now();
        while self.sound && since.elapsed() < patience {
            while matches!(self.stdout.read(&mut self.buffer), Ok(1..))
                && since.elapsed() < patience
            {}
            if self.status(Duration::from_millis(2)).is_some() {
                break;
            }
        }
        // What the shell has started, and left, is in its group. There may be nobody.
        let _ = killpg(self.pid(), Signal::SIGTERM);
        self.status(patience / 4);
        let _ = killpg(self.pid(), Signal::SIGKILL);
        let _ = self.process.wait();
    }

    fn pid(&self) -> Pid {
        Pid::from_raw(self.process.id() as i32)
    }

    fn when(&self) -> When {
        When(self.answered)
    }

    fn error(&self, said: impl fmt::Display, hint: &str) -> Error {
        Error::new(format!("running the slave `{}`", self.command), said, hint)
    }
}

/// After how many answers.
struct When(u64);

impl fmt::Display for When {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            0 => f.write_str("before its first answer"),
            1 => f.write_str("after 1 tick"),
            ticks => write!(f, "after {ticks} ticks"),
        }
    }
}

const HINT_RUN: &str = "try it by hand: `printf 1111` into it must come out as four bytes of 0 or 1; what it says on stderr stands above";
const HINT_SILENT: &str = "it must read no more than is there, and flush stdout after each answer; a slow one gets more time: silence=60s";

/// A read or write that cannot be done at once says so.
fn never_block(fd: RawFd) -> io::Result<()> {
    let flags = OFlag::from_bits_retain(fcntl(fd, FcntlArg::F_GETFL)?);
    fcntl(fd, FcntlArg::F_SETFL(flags | OFlag::O_NONBLOCK))?;
    Ok(())
}

impl fmt::Debug for Child {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Child")
            .field("command", &self.command)
            .field("process", &self.process)
            .finish_non_exhaustive()
    }
}
