//! The way to an encoder: its link, or its name and all that a file says of it.

use super::{Command, LINK_VARIABLE, Loopback, Polling, Read, Timeout, Wanted, value_source};
use crate::named::{Files, Unfound};
use biss::ParseError;
use biss::config::{Encoder, check_name};
use biss::link::Spec;
use biss::measure::{Resolution, Unit};
use biss::unit::{Hertz, Nanos};
use clap::error::ErrorKind;
use clap::parser::ValueSource;
use clap::{ArgMatches, Args, Error, FromArgMatches};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// LINK as it was typed.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Target {
    /// Where an encoder is.
    Link(Box<Spec>),
    /// What an encoder is called.
    Name(String),
}

impl FromStr for Target {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Target, ParseError> {
        match check_name(text) {
            Ok(()) => Ok(Target::Name(text.to_owned())),
            Err(_) => text.parse().map(|link| Target::Link(Box::new(link))),
        }
    }
}

/// The way to an encoder.
#[derive(Debug)]
pub(crate) struct Wire {
    pub(crate) link: Spec,
    /// The link or the name, as it was typed or set.
    pub(crate) written: String,
    /// The file that names were looked up in, where it was typed.
    pub(crate) config: Option<PathBuf>,
    /// What a file says, where it was called by its name. Link, clock and timeout are those of this already.
    pub(crate) named: Option<Box<Encoder>>,
    pub(crate) clock: Option<Hertz>,
    pub(crate) timeout: Option<Timeout>,
    pub(crate) ack_limit: Nanos,
    pub(crate) busy_limit: Nanos,
    pub(crate) rt: Option<u8>,
    pub(crate) cpu: Option<usize>,
    pub(crate) quiet: bool,
    pub(crate) verbose: bool,
}

/// The same, as it was typed.
#[derive(Debug, Args)]
struct Typed {
    /// Where the encoder is, or its name in the configuration
    #[arg(env = LINK_VARIABLE, hide_env_values = true)]
    link: Target,

    /// Frequency of MA [default: 1MHz, on gpio 250kHz or the fastest it does]
    #[arg(short, long, value_name = "FREQ")]
    clock: Option<Hertz>,

    /// The slave's timeout: MIN bounds an MA level, MAX how long CDM is held and SL = 1 awaited [default: 12us..40us]
    #[arg(long, value_name = "MIN[..MAX]|adaptive", display_order = 800)]
    timeout: Option<Timeout>,

    /// How long Ack is searched, eight clocks at least
    #[arg(long, value_name = "TIME", default_value = "40us", display_order = 801)]
    ack_limit: Nanos,

    /// How long the start bit is searched, eight clocks at least
    #[arg(long, value_name = "TIME", default_value = "40us", display_order = 802)]
    busy_limit: Nanos,

    /// Real-time priority (SCHED_FIFO), memory locked
    #[arg(long, value_name = "PRIO", display_order = 900, value_parser = clap::value_parser!(u8).range(1..=99))]
    rt: Option<u8>,

    /// Run on this processor only
    #[arg(long, value_name = "N", display_order = 901)]
    cpu: Option<usize>,

    /// No summary and no notes on stderr
    #[arg(short, long, conflicts_with = "verbose", display_order = 902)]
    quiet: bool,

    /// Say how the link runs, and what it took; where records are printed, add the bits
    #[arg(short, long, display_order = 903)]
    verbose: bool,

    #[command(flatten)]
    files: Configuration,
}

/// Where names stand.
#[derive(Debug, Args)]
pub(crate) struct Configuration {
    /// Named encoders are in FILE [default: ~/.config/biss/config.toml and /etc/biss.toml]
    #[arg(long, value_name = "FILE", display_order = 904)]
    pub(crate) config: Option<PathBuf>,
}

/// What positions are measured in.
#[derive(Clone, Copy, Debug, Default, Args)]
pub(crate) struct Measure {
    /// Counts of a turn, where a field has room for more, or the measuring step of a linear encoder: 50nm, 2mm/8192
    #[arg(long, value_name = "COUNTS|LENGTH")]
    pub(crate) resolution: Option<Resolution>,

    /// Measure positions in deg, rad, turns, mm, um, or none [default: deg of st fields, mm with a measuring step]
    #[arg(long, value_name = "UNIT")]
    pub(crate) unit: Option<Unit>,
}

impl Args for Wire {
    fn augment_args(verb: clap::Command) -> clap::Command {
        Typed::augment_args(verb)
    }

    fn augment_args_for_update(verb: clap::Command) -> clap::Command {
        Typed::augment_args_for_update(verb)
    }
}

impl FromArgMatches for Wire {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Wire, Error> {
        let typed = Typed::from_arg_matches(matches)?;
        let config = typed.files.config.as_deref();
        let (link, named) = look_up(&typed.link, config, matches)?;
        let said = named.as_deref();
        let mut written = matches.get_raw("link").into_iter().flatten();
        let written = written.next().unwrap_or_default();
        Ok(Wire {
            link,
            written: written.to_string_lossy().into_owned(),
            config: typed.files.config,
            clock: typed.clock.or(said.and_then(|said| said.clock)),
            timeout: typed.timeout.or(said.and_then(|said| said.timeout)),
            ack_limit: typed.ack_limit,
            busy_limit: typed.busy_limit,
            rt: typed.rt,
            cpu: typed.cpu,
            quiet: typed.quiet,
            verbose: typed.verbose,
            named,
        })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        Wire::from_arg_matches(matches).map(|wire| *self = wire)
    }
}

/// The link, and what a file says where an encoder was called by its name. A frame that was typed takes the place of the
/// file's.
fn look_up(
    target: &Target,
    config: Option<&Path>,
    matches: &ArgMatches,
) -> Result<(Spec, Option<Box<Encoder>>), Error> {
    let name = match target {
        Target::Link(link) => return Ok(((**link).clone(), None)),
        Target::Name(name) => name,
    };
    let whose = match value_source(matches, "link") {
        Some(ValueSource::EnvVariable) => format!(" from {LINK_VARIABLE}"),
        _ => String::new(),
    };
    let wrong = |what: String| Error::raw(ErrorKind::ValueValidation, what + "\n");
    let encoder = Files::of(config).find(name).map_err(|error| match error {
        // All links, and where names are.
        Unfound::Nobody(names) => {
            let links = name.parse::<Spec>().err();
            let links = links.map_or_else(String::new, |error| error.hint().to_owned());
            let what = format!("unknown link `{name}`, and no encoder has that name");
            let error = ParseError::usage(name, &what, &format!("{names}\n  {links}"));
            wrong(format!(
                "invalid value '{name}' for '<LINK>'{whose}: {error}"
            ))
        }
        Unfound::Wrong(what) => wrong(what),
    })?;
    let frame_typed = value_source(matches, "frame") == Some(ValueSource::CommandLine);
    let link = encoder.spec(!frame_typed);
    let link = link.map_err(|error| wrong(format!("encoder {name}: {error}")))?;
    Ok((link, Some(Box::new(encoder))))
}

/// What was typed beats the file, and the file what is usual.
pub(super) fn complete(command: &mut Command, matches: &ArgMatches) -> Result<(), Error> {
    match command {
        Command::Read(read) => {
            want(&mut read.framed.frame, &read.wire, matches);
            pace(&mut read.polling, &read.wire);
            read.measure.complete(&read.wire);
            count(read);
        }
        Command::Stats(stats) => {
            want(&mut stats.framed.frame, &stats.wire, matches);
            stats.measure.complete(&stats.wire);
            pace(&mut stats.polling, &stats.wire);
        }
        Command::Watch(watch) => {
            want(&mut watch.framed.frame, &watch.wire, matches);
            watch.measure.complete(&watch.wire);
            pace(&mut watch.polling, &watch.wire);
        }
        Command::Scope(scope) => want(&mut scope.frame, &scope.wire, matches),
        Command::Capture(capture) => pace(&mut capture.polling, &capture.wire),
        Command::Loopback(loopback) => {
            if let Some(target) = &loopback.link {
                let config = loopback.files.config.as_deref();
                let (link, _) = look_up(target, config, matches)?;
                loopback.link = Some(Target::Link(Box::new(link)));
            }
        }
        Command::Detect(_)
        | Command::Reg(_)
        | Command::Send(_)
        | Command::Info(_)
        | Command::List(_) => {}
    }
    Ok(())
}

/// A frame that was written down is the link's by now; the slaves are asked where the file says so and nobody else does.
fn want(frame: &mut Option<Wanted>, wire: &Wire, matches: &ArgMatches) {
    let asks = |encoder: &Encoder| encoder.frame == Some(Wanted::Auto);
    let typed = value_source(matches, "frame") == Some(ValueSource::CommandLine);
    if !typed && wire.named.as_deref().is_some_and(asks) {
        *frame = Some(Wanted::Auto);
    }
}

/// An interval of 0 undoes that of the file, and has no meaning elsewhere.
fn pace(polling: &mut Polling, wire: &Wire) {
    let Some(interval) = wire.named.as_ref().and_then(|named| named.interval) else {
        return;
    };
    polling.interval = match polling.interval {
        Some(Nanos(0)) => None,
        typed => typed.or(Some(interval)),
    };
}

fn count(read: &mut Read) {
    let Some(named) = &read.wire.named else {
        return;
    };
    read.zero = read.zero.or(named.zero);
    read.reverse = (read.reverse || named.reverse) && !read.no_reverse;
}

impl Measure {
    /// As a file says.
    pub(crate) fn of(encoder: &Encoder) -> Measure {
        Measure {
            resolution: encoder.resolution,
            unit: encoder.unit,
        }
    }

    /// Another resolution may be another kind of encoder, for which the file's unit is none.
    fn complete(&mut self, wire: &Wire) {
        if let (None, Some(named)) = (self.resolution, &wire.named) {
            self.resolution = named.resolution;
            self.unit = self.unit.or(named.unit);
        }
    }
}

impl Loopback {
    /// Where the jumpers are.
    pub(crate) fn link(&self) -> Option<&Spec> {
        match self.link.as_ref()? {
            Target::Link(link) => Some(link),
            Target::Name(_) => None,
        }
    }
}
