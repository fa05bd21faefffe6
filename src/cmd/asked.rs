//! What was asked for: checked, and completed, before anything is opened.

use crate::cli::{self, Wanted};
use crate::output::{Column, Look, Shape, choose, columns, note};
use anyhow::{Result, anyhow, bail};
use biss::format::Format;
use biss::link::{Kind, Spec};
use biss::measure::Scale;
use biss::preset::{Frame, Preset};
use biss::unit::{Hertz, Nanos};

/// `-c` where nothing else is said, on links that do it.
pub(super) const USUAL_CLOCK: Hertz = Hertz(1_000_000);

/// `-f` beats the link's own `frame=`, that beats the environment, and a simulated slave has a format anyway.
///
/// None where nobody has said it.
pub(super) fn choose_frame(frame: Option<&Wanted>, link: &Spec, given: bool) -> Option<Wanted> {
    let flag = frame.filter(|_| given).cloned();
    let own = || match &link.kind {
        Kind::Sim { config, .. } => Some(Wanted::Given(Frame {
            format: config.format.clone(),
            preset: None,
        })),
        _ => None,
    };
    flag.or_else(|| link.frame.clone().map(Wanted::Given))
        .or_else(|| frame.cloned())
        .or_else(own)
}

/// What to do about that.
pub(super) const NO_FRAME: &str = "no frame format: say what the encoder sends, such as -f st26,nE,nW,crc6\n  \
    its data sheet names position bits, error and warning bit and CRC; `biss read --help` lists the fields,\n  \
    -f resolute-26 or another preset saves the trouble, and an encoder with registers may say it itself: -f auto;\n  \
    `biss detect` finds it out from the frames themselves";

/// What has no meaning on a recording is a mistake, not something to be ignored.
pub(super) fn check(wire: &cli::Wire, polling: &cli::Polling) -> Result<()> {
    if polling.interval == Some(Nanos(0)) {
        bail!("--interval 0 is no interval\n  leave it out to read back to back");
    }
    live_only(
        wire,
        &[
            ("--clock", wire.clock.is_some()),
            ("--interval", polling.interval.is_some()),
            ("--retries", polling.retries.is_some()),
            ("--wait", polling.wait.is_some_and(|wait| wait.0 > 0)),
        ],
    )
}

/// Refuses options, set or not, that are for live links.
pub(super) fn live_only(wire: &cli::Wire, options: &[(&str, bool)]) -> Result<()> {
    if !matches!(wire.link.kind, Kind::File { .. }) {
        return Ok(());
    }
    match options.iter().find(|(_, set)| *set) {
        Some((option, _)) => bail!("{option} has no meaning on a recording\n  leave it out"),
        None => Ok(()),
    }
}

/// How records look, decided before anything is opened.
pub(super) fn look(
    args: &cli::Read,
    format: &Format,
    slaves: bool,
    counted: bool,
    scales: &[Option<Scale>],
) -> Result<Look> {
    let kind = &args.wire.link.kind;
    let clocks_only = matches!(
        kind,
        Kind::Gpio { .. } | Kind::Spi { .. } | Kind::Sim { .. } | Kind::Exec(_)
    );
    let live = !matches!(kind, Kind::File { .. });
    let there = columns(&Shape {
        format,
        time: args.time,
        slaves,
        counted,
        scales,
        live,
        delay_clk: clocks_only,
        delay_ns: !clocks_only,
    });
    if let Some(list) = &args.fields {
        let chosen = choose(list, &there).map_err(|e| anyhow!("--fields: {e}"))?;
        return Ok(Look::Fields(chosen));
    }
    Ok(match args.format {
        cli::OutputFormat::Text => Look::Text,
        cli::OutputFormat::Json => Look::Json,
        cli::OutputFormat::Csv => {
            let shown = |column: &Column| args.wire.verbose || *column != Column::Bits;
            Look::Csv(there.into_iter().filter(shown).collect())
        }
    })
}

/// What the user asks for and the encoder is not made for. He may know better, so he gets it.
pub(super) fn warn_outside(wire: &cli::Wire, interval: Option<Nanos>, preset: &Preset) {
    let clock = wire.clock.and_then(|clock| preset.clock_outside(clock));
    let interval = interval.and_then(|time| preset.interval_outside(time));
    let timeout = wire
        .timeout
        .and_then(|timeout| preset.timeout_outside(timeout.stall, timeout.max));
    if !wire.quiet {
        [clock, interval, timeout].iter().flatten().for_each(note);
    }
}

/// What is wrong with the clock that a link has reached, unless the one asked for was warned of already.
pub(super) fn slower(preset: &Preset, asked: Option<Hertz>, reached: Hertz) -> Option<String> {
    // A measured clock is not that exact.
    let most = Hertz(reached.0.saturating_add(reached.0 / 20));
    let slow = preset.clock_min.is_some_and(|min| most < min);
    let said = asked.is_some_and(|asked| preset.clock_outside(asked).is_some());
    preset.clock_outside(reached).filter(|_| slow && !said)
}

/// What the user has not said, the preset may.
pub(super) fn fill_in(wire: &mut cli::Wire, preset: &Preset) {
    if matches!(
        wire.link.kind,
        Kind::Spi { .. } | Kind::Wave { .. } | Kind::Sim { .. } | Kind::Exec(_)
    ) {
        wire.clock
            .get_or_insert_with(|| preset.clock_near(USUAL_CLOCK));
    }
    let (stall, max) = preset.judged();
    wire.timeout.get_or_insert(cli::Timeout { stall, max });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_that_a_link_does_not_reach_is_outside_too() {
        let resolute = Preset::named("resolute-26").unwrap();
        let said = |asked: Option<u32>, reached| {
            slower(resolute, asked.map(Hertz), Hertz(reached)).is_some()
        };
        assert!(said(None, 150_000) && said(Some(1_000_000), 150_000));
        assert!(!said(None, 240_000) && !said(Some(250_000), 240_000));
        assert!(!said(Some(1_000_000), 1_000_000));
        assert!(!said(Some(100_000), 100_000), "said before");
    }
}
