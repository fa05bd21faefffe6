//! The command line as clap sees it. `cmd` turns it into checked values.

pub(crate) use biss::config::Wanted;
use biss::control::RETRIES;
pub(crate) use biss::frame::Timeout;
use biss::link::Kind;
use biss::place::Zero;
use biss::preset::Frame;
use biss::unit::{Hertz, Nanos};
use clap::builder::Resettable;
use clap::error::ContextKind;
use clap::parser::ValueSource;
use clap::{ArgMatches, Args, ValueEnum};
use std::env;
use std::path::PathBuf;

/// What was typed, checked word by word.
#[derive(Debug)]
pub(crate) enum Command {
    Read(Box<Read>),
    Stats(Box<Stats>),
    Watch(Box<Watch>),
    Detect(Box<Detect>),
    Scope(Box<Scope>),
    Capture(Box<Capture>),
    Reg(Box<Reg>),
    Send(Box<Send>),
    Info(Box<Info>),
    List(List),
    Loopback(Box<Loopback>),
}

/// A verb, and what may stand behind it.
struct Verb {
    name: &'static str,
    about: &'static str,
    before_help: &'static str,
    after_help: &'static str,
    /// Adds its arguments.
    takes: fn(clap::Command) -> clap::Command,
    parse: fn(&ArgMatches) -> Result<Command, clap::Error>,
}

const VERBS: [Verb; 11] = [
    Verb {
        name: "read",
        about: "Read frames and print them, one record a line",
        before_help: "",
        after_help: READ_HELP,
        takes: takes::<Read>,
        parse: |typed| parse(typed, Command::Read),
    },
    Verb {
        name: "stats",
        about: "Many frames in a few numbers: rate, jitter, line delay, margins, faults, noise",
        before_help: "",
        after_help: stats::STATS_HELP,
        takes: takes::<Stats>,
        parse: |typed| parse(typed, Command::Stats),
    },
    Verb {
        name: "watch",
        about: "A live view for the bench: position, angle, speed, rate, jitter, faults",
        before_help: "",
        after_help: watch::WATCH_HELP,
        takes: takes::<Watch>,
        parse: |typed| parse(typed, Command::Watch),
    },
    Verb {
        name: "detect",
        about: "What an unknown encoder sends: frame format, CRC, Ack, timeout, usable clock",
        before_help: "",
        after_help: detect::DETECT_HELP,
        takes: takes::<Detect>,
        parse: |typed| parse(typed, Command::Detect),
    },
    Verb {
        name: "scope",
        about: "Draw cycles as a data sheet does: both wires, and what each bit of them is",
        before_help: "",
        after_help: scope::SCOPE_HELP,
        takes: takes::<Scope>,
        parse: |typed| parse(typed, Command::Scope),
    },
    Verb {
        name: "capture",
        about: "Record MA and SLO: VCD, sigrok session or CSV",
        before_help: "",
        after_help: CAPTURE_HELP,
        takes: takes::<Capture>,
        parse: |typed| parse(typed, Command::Capture),
    },
    Verb {
        name: "reg",
        about: "Registers of the slaves: read, write, dump, save, load",
        before_help: reg::REG_WARNING,
        after_help: reg::REG_HELP,
        takes: takes::<Reg>,
        parse: |typed| parse(typed, Command::Reg),
    },
    Verb {
        name: "command",
        about: "Tell slaves to do something",
        before_help: reg::COMMAND_WARNING,
        after_help: reg::COMMAND_HELP,
        takes: takes_code,
        parse: |typed| parse(typed, Command::Send),
    },
    Verb {
        name: "info",
        about: "Who is on the line: IDs, serial numbers, EDS, profiles, and the frame that follows",
        before_help: "",
        after_help: INFO_HELP,
        takes: takes::<Info>,
        parse: |typed| parse(typed, Command::Info),
    },
    Verb {
        name: "list",
        about: "What this machine offers, what is missing, and what helps",
        before_help: "",
        after_help: LIST_HELP,
        takes: takes::<List>,
        parse: |typed| parse(typed, |list: Box<List>| Command::List(*list)),
    },
    Verb {
        name: "loopback",
        about: "The master against a slave of its own: in process, or over jumpered pins",
        before_help: "",
        after_help: LOOPBACK_HELP,
        takes: takes::<Loopback>,
        parse: |typed| parse(typed, Command::Loopback),
    },
];

fn parse<A: Args>(
    typed: &ArgMatches,
    verb: impl FnOnce(Box<A>) -> Command,
) -> Result<Command, clap::Error> {
    A::from_arg_matches(typed).map(|args| verb(Box::new(args)))
}

/// A variable that is set to nothing counts as not set: so shells take one back.
fn takes<A: Args>(verb: clap::Command) -> clap::Command {
    // What describes a group of arguments in the source is not meant for users.
    let about = verb.get_about().cloned().unwrap_or_default();
    let mut verb = A::augment_args(verb).about(about);
    for (arg, variable) in [("link", LINK_VARIABLE), ("frame", FRAME_VARIABLE)] {
        if env::var_os(variable).is_some_and(|value| value.is_empty()) {
            verb = verb.mut_args(|known| match known.get_id() == arg {
                true => known.env(Resettable::Reset),
                false => known,
            });
        }
    }
    verb
}

/// The link need not be typed where it is set, though another argument stands behind it.
fn takes_code(verb: clap::Command) -> clap::Command {
    let verb = takes::<Send>(verb);
    if env::var_os(LINK_VARIABLE).is_none_or(|value| value.is_empty()) {
        return verb;
    }
    verb.allow_missing_positional(true)
        .mut_args(|arg| match arg.get_id() == "link" {
            true => arg.required(false),
            false => arg,
        })
}

/// The command line. Only the arguments of the verb that was typed are made: those of all are a third of a short run.
pub(crate) fn command() -> clap::Command {
    with_verbs(|verb, command| command.defer(verb.takes))
}

fn with_verbs(take: impl Fn(&Verb, clap::Command) -> clap::Command) -> clap::Command {
    let verbs = VERBS.iter().map(|verb| {
        let mut command = clap::Command::new(verb.name)
            .about(verb.about)
            .after_help(verb.after_help);
        if !verb.before_help.is_empty() {
            command = command.before_help(verb.before_help);
        }
        take(verb, command)
    });
    clap::Command::new("biss")
        .version(env!("CARGO_PKG_VERSION"))
        .about("Read BiSS-C encoders on plain Linux pins")
        .max_term_width(100)
        .after_help(EXAMPLES)
        .subcommand_required(true)
        .arg_required_else_help(true)
        .subcommands(verbs)
}

/// What was typed.
///
/// # Errors
/// When it is no verb, or what stands behind it does not fit.
pub(crate) fn typed(matches: &ArgMatches) -> Result<Command, clap::Error> {
    let verb = matches.subcommand().and_then(|(name, typed)| {
        let verb = VERBS.iter().find(|verb| verb.name == name)?;
        Some((verb, typed))
    });
    match verb {
        Some((verb, typed)) => {
            runs_nothing_unasked(typed)?;
            let mut command = (verb.parse)(typed)?;
            wire::complete(&mut command, typed)?;
            Ok(command)
        }
        None => Err(command().error(clap::error::ErrorKind::MissingSubcommand, "no verb")),
    }
}

/// Where the value of an argument comes from, of a verb that has it.
fn value_source(verb: &ArgMatches, arg: &str) -> Option<ValueSource> {
    let known = verb.try_contains_id(arg).is_ok();
    known.then(|| verb.value_source(arg)).flatten()
}

/// A command is run for whoever has typed it, not for whoever has set a variable somewhere.
fn runs_nothing_unasked(typed: &ArgMatches) -> Result<(), clap::Error> {
    let runs = match typed.try_get_one::<Target>("link") {
        Ok(Some(Target::Link(link))) => matches!(link.kind, Kind::Exec(_)),
        _ => false,
    };
    if runs && value_source(typed, "link") == Some(ValueSource::EnvVariable) {
        let what = format!(
            "an exec: link runs a command, so {LINK_VARIABLE} cannot name it\n  type it behind the verb, in quotes"
        );
        return Err(command().error(clap::error::ErrorKind::InvalidValue, what));
    }
    Ok(())
}

/// What is wrong with the command line, and which variable a value came from that nobody typed.
pub(crate) fn complaint(error: &clap::Error) -> String {
    let text = error.render().to_string();
    let text = text.trim_start_matches("error: ").trim_end();
    let context = |kind| error.get(kind).map(ToString::to_string);
    let invalid = context(ContextKind::InvalidValue).zip(context(ContextKind::InvalidArg));
    let Some((value, arg)) = invalid else {
        return text.into();
    };
    let typed = env::args_os().any(|typed| typed.to_string_lossy().ends_with(&value));
    let mut variables = [LINK_VARIABLE, FRAME_VARIABLE].into_iter();
    match variables.find(|name| !typed && env::var(name).is_ok_and(|set| set == value)) {
        Some(name) => text.replacen(&format!("'{arg}'"), &format!("'{arg}' from {name}"), 1),
        None => text.into(),
    }
}

const LINK_VARIABLE: &str = "BISS_LINK";
const FRAME_VARIABLE: &str = "BISS_FRAME";

const EXAMPLES: &str = "\
Examples:
  biss read sim                                                a simulated encoder, no hardware
  biss read spi:0.0 -f st26,nE,nW,crc6 -c 2MHz                 SCLK is MA, MISO is SLO
  biss read gpio:0,ma=17,slo=27 -f st26,nE,nW,crc6 -n 0 -i 1ms  two GPIO lines, every millisecond
  biss read file:bench.vcd -f st32,nE,nW,crc6 -o json          a recording
  biss stats sim                                               rate, jitter, margins, noise
  biss detect sim:device=none                                  what an unknown encoder sends
  biss list                                                    what this machine has for an encoder
  biss loopback                                                the program against itself";

/// All links, as the help of those verbs has them that take any.
macro_rules! links {
    () => {
        "\
Links:
  gpio:[CHIP,]ma=LINE,slo=LINE           two GPIO lines; CHIP is a number, name, label or path
       [,mo=LINE][,uapi=v1|v2]           MO, for slaves on a bus; the kernel's interface
  spi:BUS.CS[,phase=auto|2|3][,pad=N]    spidev: SCLK is MA, MISO is SLO
  wave:BUS.CS[,oversample=N][,invert][,idle=low|high]
                                         spidev: MOSI is MA, MISO is SLO
  sim[:KEY=VAL,…]                        simulated encoder; a wrong KEY lists them all
  file:PATH[,ma=NAME][,slo=NAME]         recording: sigrok session, VCD, CSV; - is standard input
       [,rate=HZ][,unit=BYTES]           samples alone: rate=100MHz,ma=0,slo=1
  exec:[tick=TIME,][silence=TIME,]COMMAND
                                         a slave in another process, such as an HDL simulator
  An option frame=FORMAT|PRESET ends the options and takes the rest.
  NAME                                   an encoder of the configuration; biss list shows them
"
    };
}

const READ_HELP: &str = concat!(
    links!(),
    "
Frame format, in wire order after CDS, channels joined by +:
  mtN stN posN padN dataN[=NAME] lcN  nE nW (active low)  E W  crcN[:POLY[:init=X][:plain]]

Presets, in the place of a format, bring the encoder's own limits along:
  resolute-26, lenz-irs, siko-msa213c and more: biss list shows them
  auto asks the slaves' registers, selects banks for that and restores them, and lets live frames decide.

Exit status:
  0  every frame asked for was good and without error bit
  1  the wire answered badly, or not at all
  2  usage or machine"
);

#[derive(Debug, Args)]
pub(crate) struct Read {
    #[command(flatten)]
    pub(crate) wire: Wire,

    #[command(flatten)]
    pub(crate) framed: Framed,

    #[command(flatten)]
    pub(crate) polling: Polling,

    /// How records look
    #[arg(short = 'o', long, value_enum, default_value_t = OutputFormat::Text)]
    pub(crate) format: OutputFormat,

    /// Tab-separated values of good records only: LIST is keys of the JSON records, such as t_ns,pos,deg
    #[arg(short = 'F', long, value_name = "LIST", conflicts_with = "format")]
    pub(crate) fields: Option<String>,

    /// Read these registers beside the frames, again and again [-n: until all are read once]
    #[arg(long, value_name = "ADDR[..ADDR],…", value_delimiter = ',')]
    pub(crate) registers: Vec<Span>,

    /// Whose registers: ID 0 is the slave farthest away
    #[arg(long, value_name = "ID", requires = "registers", default_value_t = 0, hide_default_value = true,
          value_parser = clap::value_parser!(u8).range(0..=7))]
    pub(crate) slave: u8,

    /// Count on where the position rolls over, less than half its range a frame: adds counts
    #[arg(long)]
    pub(crate) unwrap: bool,

    /// What counts as 0, as the encoder sends it, or the first good frame: adds counts
    #[arg(long, value_name = "COUNTS|here", allow_negative_numbers = true)]
    pub(crate) zero: Option<Zero>,

    /// Count against the encoder's direction: adds counts
    #[arg(long)]
    pub(crate) reverse: bool,

    /// Count in the encoder's direction, whatever a named encoder says
    #[arg(long, overrides_with = "reverse")]
    pub(crate) no_reverse: bool,

    #[command(flatten)]
    pub(crate) measure: Measure,

    /// Time stamps
    #[arg(short, long, value_enum, default_value_t = TimeStyle::Zero)]
    pub(crate) time: TimeStyle,

    /// Colours in text output
    #[arg(long, value_enum, default_value_t = ColorWhen::Auto)]
    pub(crate) color: ColorWhen,
}

/// What the encoder sends, for all commands that show it.
#[derive(Debug, Default, Args)]
pub(crate) struct Framed {
    /// Frame format, such as mt12,st20,nE,nW,crc6, the name of a preset, or auto: what the slaves' registers say
    #[arg(
        short,
        long,
        value_name = "FORMAT|PRESET|auto",
        env = FRAME_VARIABLE,
        hide_env_values = true
    )]
    pub(crate) frame: Option<Wanted>,
}

/// Frame after frame, for all commands that take many.
#[derive(Clone, Copy, Debug, Args)]
pub(crate) struct Polling {
    /// Number of frames, 0 for no end [default: 1, all of a recording]
    #[arg(short = 'n', long, value_name = "N", allow_negative_numbers = true)]
    pub(crate) count: Option<u64>,

    /// From start to start; missed slots are skipped and counted [default: back to back]
    #[arg(short, long, value_name = "TIME")]
    pub(crate) interval: Option<Nanos>,

    /// Repetitions of a bad frame per slot [default: 3 for stalled, else 0]
    #[arg(long, value_name = "N", display_order = 803)]
    pub(crate) retries: Option<u32>,

    /// How long to wait for a first good frame [default: 0s, or what a preset takes after power-on]
    #[arg(long, value_name = "TIME", display_order = 804)]
    pub(crate) wait: Option<Nanos>,
}

const CAPTURE_HELP: &str = concat!(
    "\
Files, by the end of their name or by --as:
  .vcd  value change dump: GTKWave, PulseView; with what each frame said beside the wires
  .sr   sigrok session: PulseView, sigrok-cli; sampled at --sample-rate
  .csv  a row a change, as Saleae Logic exports it

",
    links!(),
    "
What was captured reads back: biss read file:FILE -f FORMAT.

Examples:
  biss capture sim -n 3 -w sim.vcd                                   a simulated encoder
  biss capture gpio:0,ma=17,slo=27 -f st26,nE,nW,crc6 -n 100 -w x.sr  a hundred frames
  biss capture spi:0.0 --clocks 64 -w x.vcd                          an encoder of unknown format
  biss capture file:bench.sr -w bench.vcd                            from one kind to another

Exit status:
  0  every frame asked for is in FILE, good and without error bit; without a format, with Ack and start bit
  1  the wire answered badly, or not at all
  2  usage or machine"
);

#[derive(Debug, Args)]
pub(crate) struct Capture {
    #[command(flatten)]
    pub(crate) wire: Wire,

    /// The recording, - for standard output
    #[arg(short, long, value_name = "FILE")]
    pub(crate) write: PathBuf,

    /// What kind of recording [default: by the end of FILE's name]
    #[arg(long = "as", value_name = "KIND", value_enum)]
    pub(crate) kind: Option<RecordingKind>,

    /// Samples a second of a .sr [default: a usual rate, 16 samples a clock at least]
    #[arg(long, value_name = "FREQ")]
    pub(crate) sample_rate: Option<Hertz>,

    /// Frame format, such as mt12,st20,nE,nW,crc6, or the name of a preset [default: nothing is decoded but Ack and start]
    #[arg(
        short,
        long,
        value_name = "FORMAT|PRESET",
        env = FRAME_VARIABLE,
        hide_env_values = true
    )]
    pub(crate) frame: Option<Frame>,

    /// Clocks a frame, whatever comes [default: as many as the format needs, 128 without one]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(4..=biss::trace::MAX_CLOCKS as i64))]
    pub(crate) clocks: Option<u16>,

    #[command(flatten)]
    pub(crate) polling: Polling,

    /// Print the frames too, as biss read does
    #[arg(short = 'o', long, value_enum)]
    pub(crate) format: Option<OutputFormat>,
}

/// `--as`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum RecordingKind {
    /// Value change dump
    Vcd,
    /// sigrok session
    Sr,
    /// Comma-separated values, a row a change
    Csv,
}

const INFO_HELP: &str = "\
The slaves' registers say who they are and suggest frame formats; live frames decide between them. What no published
document explains, or what does not fit together, is marked with a question mark.

Nothing is written but the bank selection, and that is restored.

Links:
  gpio:[CHIP,]ma=LINE,slo=LINE  two GPIO lines
  wave:BUS.CS[,oversample=N]    spidev: MOSI is MA, MISO is SLO
  sim[:KEY=VAL,…]               simulated encoder
  exec:[tick=TIME,]COMMAND      a slave in another process, such as an HDL simulator
  With SCLK as MA (spi) slaves cannot be asked anything.

Examples:
  biss info sim                who the simulated encoder is
  biss read sim -f auto -n 5   its frames, of the format that follows

Exit status:
  0  every slave was read; the frame is known, or the slaves do not describe it
  1  nobody answers, registers could not be read, or frames contradict them or fit several formats
  2  usage or machine";

#[derive(Debug, Args)]
pub(crate) struct Info {
    #[command(flatten)]
    pub(crate) wire: Wire,

    #[command(flatten)]
    pub(crate) stubborn: Stubborn,

    /// Do not even select a bank: what is in others is left out
    #[arg(long)]
    pub(crate) no_write: bool,

    /// How it is told
    #[arg(short = 'o', long, value_enum, default_value_t = ReportFormat::Text)]
    pub(crate) format: ReportFormat,
}

const LOOPBACK_HELP: &str = "\
Links:
  none, or sim[:KEY=VAL,…]    in process: every link's way to clock, against the simulated slave
  gpio:CHIP,ma=LINE,slo=LINE,ma-in=LINE,slo-out=LINE[,uapi=v1|v2]
                              jumpers from MA to ma-in and from slo-out to SLO; the slave is a thread.
                              Finds the fastest clock that works
  wave:BUS.CS[,oversample=N][,invert]
                              a jumper from MOSI to MISO: every bit must come back. Measures SCLK

Disconnect the encoder first: pins are driven that it drives too.

Exit status:
  0  everything came back as it was sent
  1  it did not; what is wrong is on stdout
  2  usage or machine";

#[derive(Debug, Args)]
pub(crate) struct Loopback {
    /// Where the jumpers are [default: none, in process]
    pub(crate) link: Option<Target>,

    #[command(flatten)]
    pub(crate) files: Configuration,

    /// Frame format of the slave, or a preset
    #[arg(short, long, value_name = "FORMAT")]
    pub(crate) frame: Option<Frame>,

    /// The only frequency of MA to try
    #[arg(short, long, value_name = "FREQ")]
    pub(crate) clock: Option<Hertz>,

    /// Frames, or on wave transfers, at each clock [default: 1000 in process, 100 over lines, 8 on wave]
    #[arg(short = 'n', long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) count: Option<u64>,

    /// Where else to look for MA and the slave's SLO when a jumper is on the wrong line; each becomes an input
    #[arg(long, value_name = "LINE,…", value_delimiter = ',')]
    pub(crate) search: Vec<String>,

    /// How it is told
    #[arg(short = 'o', long, value_enum, default_value_t = ReportFormat::Text)]
    pub(crate) format: ReportFormat,

    /// Real-time priority (SCHED_FIFO), memory locked
    #[arg(long, value_name = "PRIO", value_parser = clap::value_parser!(u8).range(1..=99))]
    pub(crate) rt: Option<u8>,

    /// Run on this processor only
    #[arg(long, value_name = "N")]
    pub(crate) cpu: Option<usize>,

    /// No summary on stderr
    #[arg(short, long)]
    pub(crate) quiet: bool,
}

const LIST_HELP: &str = "\
Shown:
  GPIO chips, their lines and who holds them; spidevs and their drivers; named encoders; what this user may use;
  settings of the kernel that matter; presets. What is missing comes with its fix.

Exit status:
  0  it could look, whatever it found
  2  usage or machine";

#[derive(Debug, Args)]
pub(crate) struct List {
    /// How it is told
    #[arg(short = 'o', long, value_enum, default_value_t = ReportFormat::Text)]
    pub(crate) format: ReportFormat,

    /// Free lines too, and all about presets; JSON has everything anyway
    #[arg(short, long)]
    pub(crate) verbose: bool,

    #[command(flatten)]
    pub(crate) files: Configuration,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ReportFormat {
    /// For people
    Text,
    /// JSON Lines
    Json,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum OutputFormat {
    /// For people
    Text,
    /// JSON Lines
    Json,
    /// Comma-separated values, a header first
    Csv,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum TimeStyle {
    /// Since the first frame
    Zero,
    /// Since the frame before
    Delta,
    /// Since 1970
    Unix,
    /// None
    None,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ColorWhen {
    /// On a terminal, unless NO_COLOR is set
    Auto,
    /// Always
    Always,
    /// Never
    Never,
}

/// How stubborn talking to registers is.
#[derive(Clone, Copy, Debug, Args)]
pub(crate) struct Stubborn {
    /// Control frames without progress that are repeated
    #[arg(long, value_name = "N", default_value_t = RETRIES)]
    pub(crate) retries: u32,
}

/// Longest static timeout (D2 Table 10).
pub(crate) const TIMEOUT_MAX: Nanos = Nanos(biss::limits::TIMEOUT_MAX_NS);

mod detect;
mod reg;
mod scope;
mod stats;
mod watch;
mod wire;
pub(crate) use detect::{DETECT_FRAMES, Detect};
pub(crate) use reg::{Assign, Reg, RegVerb, Send, Span};
pub(crate) use scope::Scope;
pub(crate) use stats::{STATS_FRAMES, Stats};
pub(crate) use watch::Watch;
pub(crate) use wire::{Configuration, Measure, Target, Wire};

#[cfg(test)]
mod generated;
