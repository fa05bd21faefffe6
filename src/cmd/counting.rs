//! `--unwrap`, `--zero` and `--reverse`: the user's own way of counting, beside what the encoder sends.

use crate::cli;
use crate::output::{Counted, note};
use anyhow::{Result, bail};
use biss::cycle::Cycle;
use biss::format::Format;
use biss::measure::{Scale, number, scales};
use biss::place::{Count, Counter, Number, Step, Zero};

/// `--unit` and `--resolution`: how positions are measured.
pub(crate) struct Measuring {
    scales: Vec<Option<Scale>>,
    /// The numbers of turns that have fewer counts than their field could hold.
    turns: Vec<Option<Number>>,
    quiet: bool,
}

impl Measuring {
    /// What unit and resolution make of the positions of this format.
    pub(crate) fn asked(args: &cli::Read, format: &Format) -> Result<Measuring> {
        let cli::Measure { resolution, unit } = args.measure;
        let scales = scales(format, unit, resolution)?;
        let channels = format.channels().iter();
        let turns = channels.map(|channel| number(channel, resolution));
        let turns = turns.collect::<Result<_, _>>()?;
        Ok(Measuring {
            scales,
            turns: resolution.map_or_else(Vec::new, |_| turns),
            quiet: args.wire.quiet,
        })
    }

    /// One a channel.
    pub(crate) fn scales(&self) -> &[Option<Scale>] {
        &self.scales
    }

    /// Says, once, that a position is none of its turn.
    pub(crate) fn look(&mut self, cycle: &Cycle) {
        let words = self.turns.iter().zip(cycle.words());
        let mut beyond = words.filter_map(|(number, word)| {
            let (number, data) = number.as_ref().zip(word.good())?;
            (!number.is_within(data)).then_some(data)
        });
        if beyond.next().is_some() {
            self.turns.clear();
            if !self.quiet {
                note(
                    "a position is beyond the counts that a turn has by its resolution: it is shown as it was sent, and neither \
                     counted nor measured",
                );
            }
        }
    }
}

/// Counts every channel that has a position.
pub(crate) struct Counting {
    counters: Vec<Option<Counter>>,
    counts: Vec<Option<i128>>,
    unwrap: bool,
    quiet: bool,
    said_fast: bool,
    said_unknown: bool,
    said_lost: bool,
}

impl Counting {
    /// None where the user counts as the encoder does.
    pub(crate) fn asked(args: &cli::Read, format: &Format) -> Result<Option<Counting>> {
        let count = Count {
            unwrap: args.unwrap,
            zero: args.zero.unwrap_or(Zero::At(0)),
            reverse: args.reverse,
        };
        let asked = [
            ("--unwrap", args.unwrap),
            ("--zero", args.zero.is_some()),
            ("--reverse", args.reverse),
        ];
        let Some((option, _)) = asked.iter().find(|(_, set)| *set) else {
            return Ok(None);
        };
        let numbers: Vec<Option<Number>> = format
            .channels()
            .iter()
            .map(|channel| number(channel, args.measure.resolution))
            .collect::<Result<_, _>>()?;
        let numbers = || numbers.iter().map(Option::as_ref);
        if numbers().all(|number| number.is_none()) {
            bail!("{option} counts a position, and `{format}` has none\n  it would be stN or posN");
        }
        if let Some(Zero::At(zero)) = args.zero {
            let places = numbers().enumerate();
            let beyond = places.filter_map(|(ch, number)| Some((ch, number?.most())));
            if let Some((ch, most)) = beyond.clone().find(|(_, most)| zero > *most) {
                let channel = if format.channels().len() > 1 {
                    format!("channel {ch}")
                } else {
                    "the encoder".into()
                };
                bail!(
                    "--zero {zero} is never reached: {channel} counts from 0 to {most}\n  \
                     --zero here takes the first good frame, whatever it is"
                );
            }
        }
        let counter = |number: Option<&Number>| Some(Counter::of(number?.clone(), count));
        let counters: Vec<Option<Counter>> = numbers().map(counter).collect();
        Ok(Some(Counting {
            counts: vec![None; counters.len()],
            counters,
            unwrap: args.unwrap,
            quiet: args.wire.quiet,
            said_fast: false,
            said_unknown: false,
            said_lost: false,
        }))
    }

    /// The counts of a cycle. A word that is bad, or says itself that it is, has none and moves none.
    pub(crate) fn next(&mut self, format: &Format, cycle: &Cycle, t_ns: u64) -> Counted<'_> {
        self.counts.fill(None);
        for (index, channel) in format.channels().iter().enumerate() {
            let word = cycle.words().get(index).and_then(|word| word.good());
            let sound = word.filter(|data| channel.error(*data) != Some(true));
            match (sound, &mut self.counters[index]) {
                (Some(data), Some(counter)) if counter.number().is_within(data) => {
                    let (counts, step) = counter.next(data, t_ns);
                    self.counts[index] = Some(counts);
                    self.warn(step);
                }
                (_, Some(counter)) => counter.miss(),
                (_, None) => {}
            }
        }
        Counted {
            counts: &self.counts,
            unwrapped: self.unwrap,
        }
    }

    /// Once each.
    fn warn(&mut self, step: Step) {
        let (said, text) = match step {
            Step::Clear => return,
            Step::Fast => (
                &mut self.said_fast,
                "the position moved a quarter of its range or more between two frames: from half on --unwrap follows \
                 it the wrong way, and cannot tell; a shorter -i helps",
            ),
            Step::Unknown => (
                &mut self.said_unknown,
                "the position moved half its range between two frames: which way cannot be told, --unwrap counts it up",
            ),
            Step::Lost => (
                &mut self.said_lost,
                "good frames were so far apart that the position may have moved a quarter of its range or more between \
                 them: from half on --unwrap follows it the wrong way, and cannot tell",
            ),
        };
        if !std::mem::replace(said, true) && !self.quiet {
            note(text);
        }
    }
}
