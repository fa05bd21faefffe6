//! `biss`: BiSS-C encoders on plain Linux pins.

mod cli;
mod cmd;
mod named;
mod output;
mod sys;

use clap::ArgMatches;
use clap::error::ErrorKind;
use clap::parser::ValueSource;
use cmd::Outcome;
use std::process::ExitCode;

/// Usage or machine.
const FAILED: u8 = 2;

fn main() -> ExitCode {
    match cli::command().try_get_matches() {
        Ok(matches) => run(&matches),
        // Bare `biss` asks for help and does not get it on stdout: there is nothing to pipe.
        Err(error)
            if error.use_stderr()
                && error.kind() != ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand =>
        {
            misused(&error)
        }
        // Help and version, on stdout.
        Err(error) => error.exit(),
    }
}

/// Whether an option was typed, and does not come from the environment.
fn typed(verb: &ArgMatches, option: &str) -> bool {
    let source = verb
        .try_contains_id(option)
        .is_ok()
        .then(|| verb.value_source(option));
    source.flatten() == Some(ValueSource::CommandLine)
}

fn misused(error: &clap::Error) -> ExitCode {
    output::note(cli::complaint(error));
    ExitCode::from(FAILED)
}

fn run(matches: &ArgMatches) -> ExitCode {
    let command = match cli::typed(matches) {
        Ok(command) => command,
        Err(error) => return misused(&error),
    };
    let frame_given = matches
        .subcommand()
        .is_some_and(|(_, verb)| typed(verb, "frame"));
    let result = match command {
        cli::Command::Read(args) => cmd::read::run(*args, frame_given),
        cli::Command::Stats(args) => cmd::stats::run(*args, frame_given),
        cli::Command::Watch(args) => cmd::watch::run(*args, frame_given),
        cli::Command::Detect(args) => cmd::detect::run(*args),
        cli::Command::Scope(args) => cmd::scope::run(*args, frame_given),
        cli::Command::Capture(args) => cmd::capture::run(*args, frame_given),
        cli::Command::Info(args) => cmd::info::run(&args),
        cli::Command::Reg(args) => cmd::reg::run(*args),
        cli::Command::Send(args) => cmd::command::run(*args),
        cli::Command::List(args) => cmd::list::run(args),
        cli::Command::Loopback(args) => cmd::loopback::run(*args),
    };
    match result {
        Ok(ended) => {
            // By now every link is closed and MA is high.
            ended.signal.into_iter().for_each(sys::die_by);
            match ended.outcome {
                Outcome::Good => ExitCode::SUCCESS,
                Outcome::Bad => ExitCode::from(1),
            }
        }
        Err(error) => {
            output::note(&error);
            ExitCode::from(FAILED)
        }
    }
}
