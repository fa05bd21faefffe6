//! `biss capture`: what `biss read` reads, with both wires written to a file.

use super::Ended;
use super::poll::writing_to;
use super::read::{run_given, unix_us};
use crate::cli::{self, RecordingKind};
use crate::output::{self, note};
use anyhow::{Result, anyhow, bail};
use biss::frame::BissC;
use biss::limits::{LINE_DELAY_MAX_NS, REST_NS};
use biss::link::tap::Tap;
use biss::link::{Kind as LinkKind, Link};
use biss::master::{Master, Try};
use biss::preset::Frame;
use biss::record::journal::{Entry, Journal};
use biss::record::{self, Head, Kind, Output, Recorder};
use biss::unit::Hertz;
use biss::waveform::{Change, Waveform};
use std::cell::RefCell;
use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// Clocks of a frame that nobody knows: enough for two channels of 48 bits, and a line delay of 16 clocks.
const UNKNOWN_CLOCKS: u16 = 128;

pub(crate) fn run(args: cli::Capture, frame_given: bool) -> Result<Ended> {
    let kind = kind(&args)?;
    let recorded = matches!(args.wire.link.kind, LinkKind::File { .. });
    check(&args, kind, recorded)?;
    let frame = frame(&args, frame_given);
    let clocks = args.clocks.or(frame.is_none().then_some(UNKNOWN_CLOCKS));
    if frame.is_none() && !args.wire.quiet && !recorded && args.clocks.is_none() {
        note(format_args!(
            "no frame format: {UNKNOWN_CLOCKS} clocks a frame, and only Ack and start bit are looked at\n  \
             say what the encoder sends with -f, or how many clocks with --clocks"
        ));
    }
    let sink = Sink {
        target: Some(Target::open(&args.write)?),
        name: shown(&args.write),
        kind,
        rate: args.sample_rate,
        prints: args.format.is_some(),
        clocks: clocks.filter(|_| !recorded),
        known: frame.is_some(),
        notes: Vec::new(),
        quiet: args.wire.quiet,
        ear: None,
        recorder: None,
        waiting: Vec::new(),
        zero_ns: 0,
        slowest_ns: None,
    };
    let known = frame.is_some();
    let frame = frame.unwrap_or(Frame {
        format: Default::default(),
        preset: None,
    });
    run_given(as_read(args, known), frame, Some(sink))
}

/// `-f` beats the link's own `frame=`, that beats the environment. A simulated slave has a format anyway.
fn frame(args: &cli::Capture, given: bool) -> Option<Frame> {
    let typed = args.frame.clone().filter(|_| given);
    let chosen = typed
        .or_else(|| args.wire.link.frame.clone())
        .or_else(|| args.frame.clone());
    chosen.or_else(|| match &args.wire.link.kind {
        LinkKind::Sim { config, .. } if args.clocks.is_none() => Some(Frame {
            format: config.format.clone(),
            preset: None,
        }),
        _ => None,
    })
}

fn check(args: &cli::Capture, kind: Kind, recorded: bool) -> Result<()> {
    let stdout = is_stdout(&args.write);
    if stdout && args.format.is_some() {
        bail!(
            "records and the recording cannot both go to standard output\n  name a file with -w, or leave -o out"
        );
    }
    if stdout && kind == Kind::Sr {
        bail!(
            "a .sr on standard output is written by no tool and read by none\n  name a file with -w, or take --as vcd"
        );
    }
    if args.sample_rate == Some(Hertz(0)) {
        bail!("--sample-rate 0 is no rate\n  leave it out for one that suits the clock");
    }
    if args.sample_rate.is_some() && kind != Kind::Sr {
        bail!(
            "--sample-rate has no meaning on this kind of file: every change has its own time there\n  leave it out, or write a .sr"
        );
    }
    if recorded && args.clocks.is_some() {
        bail!("--clocks has no meaning on a recording\n  leave it out");
    }
    if let LinkKind::File { path, .. } = &args.wire.link.kind {
        let same = |path: &Path| fs::canonicalize(path).ok();
        if same(path)
            .is_some_and(|from| same(&args.write).as_ref() == Some(&from) && from.is_file())
        {
            bail!(
                "{} would be written while it is read\n  name another file with -w",
                shown(path)
            );
        }
    }
    Ok(())
}

fn kind(args: &cli::Capture) -> Result<Kind> {
    let known = |kind| match kind {
        RecordingKind::Vcd => Kind::Vcd,
        RecordingKind::Sr => Kind::Sr,
        RecordingKind::Csv => Kind::Csv,
    };
    if let Some(kind) = args.kind {
        return Ok(known(kind));
    }
    let end = args.write.extension().map(|end| end.to_ascii_lowercase());
    match end.as_ref().and_then(|end| end.to_str()) {
        Some("vcd") => Ok(Kind::Vcd),
        Some("sr") => Ok(Kind::Sr),
        Some("csv") => Ok(Kind::Csv),
        _ => bail!(
            "{} does not end in .vcd, .sr or .csv\n  say what it shall be: --as vcd, --as sr or --as csv",
            shown(&args.write)
        ),
    }
}

/// The same, for `biss read`. Records of a known frame count as the encoder's name says.
fn as_read(args: cli::Capture, known: bool) -> cli::Read {
    let named = args.wire.named.as_deref();
    let named = named.filter(|_| known && args.format.is_some());
    let zero = named.and_then(|named| named.zero);
    let reverse = named.is_some_and(|named| named.reverse);
    let measure = named.map_or_else(cli::Measure::default, cli::Measure::of);
    cli::Read {
        wire: args.wire,
        framed: cli::Framed::default(),
        polling: args.polling,
        format: args.format.unwrap_or(cli::OutputFormat::Text),
        fields: None,
        registers: Vec::new(),
        slave: 0,
        unwrap: false,
        zero,
        reverse,
        no_reverse: false,
        measure,
        time: cli::TimeStyle::Zero,
        color: cli::ColorWhen::Auto,
    }
}

fn is_stdout(path: &Path) -> bool {
    path.as_os_str() == "-" || path == Path::new("/dev/stdout")
}

fn shown(path: &Path) -> String {
    match is_stdout(path) {
        true => "standard output".into(),
        false => path.display().to_string(),
    }
}

/// A file that is open and has not been touched: what was in it goes when the first frame has come.
struct Target {
    output: Option<Output>,
    /// Was not there before.
    made: Option<PathBuf>,
}

impl Target {
    fn open(path: &Path) -> Result<Target> {
        let said = |e: io::Error| {
            anyhow!(
                "opening {}: {e}\n  is there such a folder, and may you write there?",
                shown(path)
            )
        };
        if is_stdout(path) {
            return Ok(Target::stream(output::raw()));
        }
        // An open file by its number: what is in it belongs to whoever has opened it.
        let numbered = ["/dev/fd", "/dev/stderr", "/proc"]
            .iter()
            .any(|open| path.starts_with(open));
        if numbered {
            let file = OpenOptions::new().append(true).open(path).map_err(said)?;
            return Ok(Target::stream(Box::new(file)));
        }
        if fs::metadata(path).is_ok_and(|there| is_stream(&there.file_type())) {
            let file = OpenOptions::new().write(true).open(path).map_err(said)?;
            return Ok(Target::stream(Box::new(file)));
        }
        let mut options = OpenOptions::new();
        options.read(true).write(true);
        let (file, made): (File, _) = match options.open(path) {
            Ok(file) => (file, None),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                let file = options.create_new(true).open(path).map_err(said)?;
                (file, Some(path.to_owned()))
            }
            Err(error) => return Err(said(error)),
        };
        Ok(Target {
            output: Some(Output::File(file)),
            made,
        })
    }

    fn stream(output: Box<dyn io::Write>) -> Target {
        Target {
            output: Some(Output::Stream(output)),
            made: None,
        }
    }

    fn take(mut self) -> Option<Output> {
        self.made = None;
        self.output.take()
    }
}

impl Drop for Target {
    /// A start that failed leaves nothing behind.
    fn drop(&mut self) {
        if let Some(path) = &self.made {
            // If it cannot go it stays, and is empty.
            let _ = fs::remove_file(path);
        }
    }
}

fn is_stream(kind: &fs::FileType) -> bool {
    kind.is_fifo() || kind.is_char_device() || kind.is_block_device() || kind.is_socket()
}

/// Hears every try while it is run.
#[derive(Clone)]
pub(super) struct Ear {
    tap: Rc<RefCell<Tap>>,
    /// None until the recording begins.
    journal: Rc<RefCell<Option<Journal>>>,
}

impl Ear {
    /// A try is over.
    pub(super) fn hear(&self, tried: &Try) {
        if let Some(journal) = self.journal.borrow_mut().as_mut() {
            journal.tell(self.tap.borrow_mut().take(), tried);
        }
    }

    /// What came behind the last try.
    fn rest(&self) {
        if let Some(journal) = self.journal.borrow_mut().as_mut() {
            journal.rest(self.tap.borrow_mut().take());
        }
    }
}

/// Where both wires are written to.
pub(super) struct Sink {
    target: Option<Target>,
    name: String,
    kind: Kind,
    rate: Option<Hertz>,
    prints: bool,
    clocks: Option<u16>,
    known: bool,
    quiet: bool,
    notes: Vec<String>,
    ear: Option<Ear>,
    recorder: Option<Box<dyn Recorder>>,
    /// Taken from the journal, and not written yet.
    waiting: Vec<Entry>,
    /// The link's time at which the recording begins.
    zero_ns: u64,
    /// The shortest clock that was told of as too fast for the sample rate.
    slowest_ns: Option<u32>,
}

impl Sink {
    /// Whether records are wanted too.
    pub(super) fn prints(&self) -> bool {
        self.prints
    }

    /// Listens in.
    pub(super) fn tap(&mut self, link: Box<dyn Link>) -> Box<dyn Link> {
        let tap = Rc::new(RefCell::new(Tap::new(link)));
        self.ear = Some(Ear {
            tap: Rc::clone(&tap),
            journal: Rc::default(),
        });
        Box::new(tap)
    }

    /// What hears every try.
    pub(super) fn ear(&self) -> Option<Ear> {
        self.ear.clone()
    }

    /// What is clocked and looked at where the format is not known.
    pub(super) fn shape(&self, protocol: &mut BissC) {
        protocol.clocks = self.clocks;
        protocol.head_only = !self.known;
    }

    /// From here on everything is written: first a rest that is long enough for whoever reads it to know that a frame begins
    /// after it.
    pub(super) fn begin(&mut self, master: &mut Master, protocol: &BissC) -> Result<()> {
        let Some(ear) = &self.ear else {
            return Ok(());
        };
        ear.tap.borrow_mut().begin()?;
        let caps = master.link().caps();
        let mut journal = Journal::new(self.kind, caps.live);
        if caps.live {
            let clock = master.link().clock().hz;
            self.check_rate(clock)?;
            self.rate.get_or_insert(record::usual_rate(clock));
        }
        if let (Kind::Sr, Some(rate)) = (self.kind, self.rate) {
            journal.sampled(rate);
        }
        *ear.journal.borrow_mut() = Some(journal);
        if !caps.live {
            return Ok(());
        }
        let now_ns = master.link().now_ns();
        self.zero_ns = now_ns;
        self.notes.push(format!("MA {}", master.link().clock()));
        if self.known {
            self.notes.push(format!("frame {}", protocol.format));
        }
        self.notes.extend(master.link().notes());
        if !caps.virtual_time {
            let unix_us = unix_us();
            let (seconds, us) = (unix_us / 1_000_000, unix_us % 1_000_000);
            self.notes.push(format!(
                "begun {seconds}.{us:06} s after 1970-01-01 00:00 UTC"
            ));
        }
        master.pause(rest_ns(protocol))?;
        Ok(())
    }

    /// Writes what has happened since the last call.
    pub(super) fn cycle(&mut self, master: &Master) -> Result<()> {
        self.listen();
        if self.recorder.is_none() && !self.start(master)? {
            return Ok(());
        }
        self.warn_of_clock(master.trace().ma_period_ns);
        self.write()
    }

    /// Takes what is to be written from the journal.
    fn listen(&mut self) {
        let zero_ns = self.zero_ns;
        let since = |entry: Entry| match entry {
            Entry::Change(change) => Entry::Change(Change {
                t_ns: change.t_ns.saturating_sub(zero_ns),
                ..change
            }),
            Entry::Frame(t_ns, cycle) => Entry::Frame(t_ns.saturating_sub(zero_ns), cycle),
        };
        let Some(ear) = &self.ear else { return };
        if let Some(journal) = ear.journal.borrow_mut().as_mut() {
            self.waiting.extend(journal.take().map(since));
        }
    }

    fn at(&self, t_ns: u64) -> u64 {
        t_ns.saturating_sub(self.zero_ns)
    }

    /// Begins the file, as soon as there is something to write. What was in it is gone then.
    fn start(&mut self, master: &Master) -> Result<bool> {
        // Before the first transfer nobody sees SLO: it is what it was then.
        let mut changes = self.waiting.iter().filter_map(Entry::change);
        let known = changes.find_map(|change| change.slo);
        let changes = self.waiting.iter_mut().filter_map(Entry::change_mut);
        let unknown = changes.take_while(|change| change.slo.is_none());
        unknown.for_each(|change| change.slo = known);
        // The recorder passes over it when it comes again.
        let mut changes = self.waiting.iter().filter_map(Entry::change);
        let Some(first) = changes.next().copied() else {
            return Ok(false);
        };
        let clock = match master.link().caps().live {
            true => master.link().clock().hz,
            false => Hertz(1_000_000_000 / master.trace().ma_period_ns.unwrap_or(1_000).max(1)),
        };
        self.check_rate(clock)?;
        let rate = self.rate.unwrap_or_else(|| record::usual_rate(clock));
        self.rate = Some(rate).filter(|_| self.kind == Kind::Sr);
        let head = Head {
            notes: &self.notes,
            format: master_format(self.known, master),
            rate,
            first,
        };
        let Some(output) = self.target.take().and_then(Target::take) else {
            return Ok(false);
        };
        let begun = record::begin(self.kind, output, &head);
        self.recorder = Some(begun.map_err(|e| writing_to(&self.name, e))?);
        if self.kind == Kind::Sr && !self.quiet && !master.link().caps().live {
            note(format_args!("{} has {rate} samples a second", self.name));
        }
        Ok(true)
    }

    /// So few samples a clock that nothing could be read from them.
    fn check_rate(&self, clock: Hertz) -> Result<()> {
        let least = Hertz(clock.0.saturating_mul(record::LEAST_SAMPLES));
        match self.rate {
            // The clock was measured.
            Some(rate) if rate.0 < least.0 - least.0 / 1_000 => bail!(
                "--sample-rate {rate} is less than {} samples a clock at {clock}: a reader would take one bit for another\n  \
                 ask for {least} at least; {} is usual",
                record::LEAST_SAMPLES,
                record::usual_rate(clock)
            ),
            _ => Ok(()),
        }
    }

    /// A clock with too few samples loses bits.
    fn warn_of_clock(&mut self, period_ns: Option<u32>) {
        const LEAST: u64 = 8;
        let (Some(rate), Some(period_ns)) = (self.rate, period_ns) else {
            return;
        };
        let few = u64::from(period_ns) * u64::from(rate.0) < LEAST * 1_000_000_000;
        let faster = self.slowest_ns.is_none_or(|told| period_ns < told / 2);
        if few && faster && !self.quiet {
            let clock = Hertz(1_000_000_000 / period_ns.max(1));
            note(format_args!(
                "{rate} samples a second are fewer than {LEAST} a clock at {clock}: edges lose their place\n  \
                 ask for more with --sample-rate"
            ));
            self.slowest_ns = Some(period_ns);
        }
    }

    fn write(&mut self) -> Result<()> {
        let Some(recorder) = &mut self.recorder else {
            return Ok(());
        };
        let mut all = || -> io::Result<()> {
            for entry in self.waiting.drain(..) {
                match entry {
                    Entry::Change(change) => recorder.change(&change)?,
                    Entry::Frame(t_ns, cycle) => recorder.frame(t_ns, &cycle)?,
                }
            }
            Ok(())
        };
        all().map_err(|e| {
            self.recorder = None;
            writing_to(&self.name, e)
        })
    }

    /// Hands on what is kept back, before a wait.
    pub(super) fn flush(&mut self) -> Result<()> {
        match self.recorder.as_mut().map(|recorder| recorder.flush()) {
            Some(Err(e)) => {
                self.recorder = None;
                Err(writing_to(&self.name, e))
            }
            _ => Ok(()),
        }
    }

    /// Ends the file, with a rest in which the last frame ends. Where all went wrong before a frame came, nothing is touched.
    pub(super) fn end(&mut self, master: &mut Master, well: bool) -> Result<()> {
        let Some(ear) = self.ear.clone() else {
            return Ok(());
        };
        let live = master.link().caps().live;
        // Where the link has failed, its error is the one to tell of; what there is has to be written all the same.
        let mut rested = Ok(());
        if live {
            rested = master.pause(2 * REST_NS + LINE_DELAY_MAX_NS);
        }
        let mut rest = Waveform::default();
        let rested = rested.and_then(|()| ear.tap.borrow_mut().waveform(&mut rest));
        ear.rest();
        self.listen();
        if self.recorder.is_none() && self.target.is_some() && well {
            self.start(master)?;
        }
        self.write()?;
        if let Some(mut recorder) = self.recorder.take() {
            let now_ns = self.at(master.link().now_ns());
            recorder
                .end(now_ns)
                .map_err(|e| writing_to(&self.name, e))?;
        }
        rested.map_err(Into::into)
    }
}

fn master_format<'a>(known: bool, master: &'a Master) -> Option<&'a biss::format::Format> {
    known.then(|| master.format())
}

/// Longer than any timeout and line delay that a reader has to reckon with.
fn rest_ns(protocol: &BissC) -> u64 {
    u64::from(protocol.timeout_max_ns).max(REST_NS) + 2 * LINE_DELAY_MAX_NS
}
