//! `biss info`: who is on the line.

use super::auto::{Found, Unknown};
use super::session::Session;
use super::{Ended, Outcome, deliver};
use crate::cli;
use crate::output::{info, note};
use anyhow::Result;

pub(crate) fn run(args: &cli::Info) -> Result<Ended> {
    let mut session = Session::open(&args.wire, args.stubborn.retries)?;
    let found = match Found::on(&mut session, !args.no_write) {
        Ok(found) => found,
        Err((doing, trouble)) => return session.fail(doing, trouble),
    };
    let shape = found.shape();
    let text = match args.format {
        cli::ReportFormat::Text => info::text(&shape, args.wire.verbose),
        cli::ReportFormat::Json => info::json(&shape)?,
    };
    deliver(&text)?;
    Ok(session.end(told(args, &found)))
}

/// Says what is missing, and whether that is a bad end: an encoder that does not describe itself is none.
fn told(args: &cli::Info, found: &Found) -> Outcome {
    let say = |text: String| {
        if !args.wire.quiet {
            note(text);
        }
    };
    for (read, failure) in &found.bus.failed {
        say(format!(
            "reading the {} of slave {}: {failure}\n  try a slower -c, or more --retries",
            read.what, read.slave
        ));
    }
    for read in &found.bus.left_out {
        say(format!(
            "the {} of slave {} is in bank {}, which is not selected, and --no-write forbids to select it",
            read.what,
            read.slave,
            read.bank.unwrap_or(0)
        ));
    }
    let unknown = found.format().err();
    if let Some(unknown) = &unknown {
        say(unknown.explain(&found.candidates));
    }
    match unknown {
        Some(Unknown::Contradicted | Unknown::Ambiguous(_)) => Outcome::Bad,
        _ if !found.bus.failed.is_empty() => Outcome::Bad,
        _ => Outcome::Good,
    }
}
