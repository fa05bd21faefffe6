//! Why frames are bad, told once, with the next command to type.

use super::poll::Poll;
use super::quoted;
use crate::cli;
use crate::output::{Why, note};
use biss::config::Encoder;
use biss::diagnose::{Diagnosis, Evidence, Remedy, Setup};
use biss::link::{Kind, Link, Phase};
use biss::master::Master;
use biss::trials;
use std::env;

/// Options that `scope` takes as well, with what stands behind them.
const LINE_OPTIONS: [(&str, &str); 6] = [
    ("--frame", "-f"),
    ("--clock", "-c"),
    ("--timeout", ""),
    ("--ack-limit", ""),
    ("--busy-limit", ""),
    ("--config", ""),
];

/// What a diagnosis may set.
const SHORT: [(&str, &str); 3] = [("--frame", "-f"), ("--clock", "-c"), ("--count", "-n")];

impl Poll<'_> {
    /// What is needed to say why, once the line is open and its clock known.
    pub(super) fn gather(&self, master: &Master) -> Option<Evidence> {
        if self.wire.quiet {
            return None;
        }
        let live = master.link().caps().live;
        let mode = match self.wire.link.kind {
            Kind::Spi { phase, .. } => phase.map(|phase| if phase > Phase::Half { 3 } else { 2 }),
            _ => None,
        };
        Some(Evidence::new(Setup {
            protocol: self.protocol.clone(),
            preset: self.preset,
            clock: live.then(|| master.link().clock().hz),
            in_bytes: matches!(self.wire.link.kind, Kind::Spi { .. }),
            mode,
        }))
    }

    /// What is new, as lines for the user, and all of it for the summary.
    pub(super) fn reasons(&mut self, end: bool) -> Vec<String> {
        let Some(evidence) = &mut self.evidence else {
            return Vec::new();
        };
        let news = evidence.news(end);
        if end {
            let all = evidence.diagnoses();
            self.summary.diagnosis = all.iter().map(|one| told(self.wire, one)).collect();
        }
        news.iter().map(|one| line(self.wire, one)).collect()
    }

    /// The end of it: what the run has left open is tried, if nothing has gone wrong by then and nobody wants to leave.
    pub(super) fn explain(&mut self, link: &mut dyn Link, well: bool) {
        let stop = self.signals.watch();
        if let (Some(evidence), true) = (&mut self.evidence, well && !stop()) {
            // The frames that were asked for have been read: what fails after them is no failure of theirs.
            drop(trials::run(link, self.protocol, evidence, &stop));
        }
        self.reasons(true).iter().for_each(note);
    }
}

fn told(wire: &cli::Wire, diagnosis: &Diagnosis) -> Why {
    Why {
        cause: diagnosis.cause.name(),
        text: diagnosis.to_string(),
        count: diagnosis.count,
        command: command(&changed(&typed(), Way::of(wire), &diagnosis.remedy)),
    }
}

fn line(wire: &cli::Wire, diagnosis: &Diagnosis) -> String {
    let typed = typed();
    let next = changed(&typed, Way::of(wire), &diagnosis.remedy);
    if next == typed && diagnosis.remedy != Remedy::Again {
        // That is what was done.
        return diagnosis.to_string();
    }
    let then = match diagnosis.advice {
        "" => "try",
        _ => "then",
    };
    format!("{diagnosis}; {then}: {}", command(&next))
}

fn typed() -> Vec<String> {
    let words = env::args_os().skip(1);
    words
        .map(|word| word.to_string_lossy().into_owned())
        .collect()
}

fn command(words: &[String]) -> String {
    let words = words.iter().map(|word| quoted(word));
    format!("biss {}", words.collect::<Vec<_>>().join(" "))
}

/// The way to an encoder in a command.
#[derive(Clone, Copy)]
struct Way<'a> {
    /// Its link or its name.
    written: &'a str,
    /// What stands under that name.
    named: Option<&'a Encoder>,
}

impl Way<'_> {
    fn of(wire: &cli::Wire) -> Way<'_> {
        Way {
            written: &wire.written,
            named: wire.named.as_deref(),
        }
    }
}

/// The command to type: the one that was typed, with something changed.
fn changed(typed: &[String], way: Way, remedy: &Remedy) -> Vec<String> {
    let mut words = typed.to_vec();
    // Behind the verb; nowhere where a variable names it.
    let link_at = words.iter().skip(1).position(|word| word == way.written);
    let link_at = link_at.map(|at| at + 1);
    match remedy {
        Remedy::Again => {}
        Remedy::Options(options) => {
            for (option, value) in options {
                let name = match short(&SHORT, option) {
                    "" => option,
                    short => short,
                };
                let mut rest = words.clone();
                if take(&mut rest, option, short(&SHORT, option)).as_ref() != Some(value) {
                    rest.extend([name.to_owned(), value.clone()]);
                    words = rest;
                }
            }
        }
        Remedy::Key(key, value) => {
            let link = way.named.map_or(way.written, |named| &named.link);
            let link = with_key(link, key, value);
            match link_at {
                Some(at) => words[at] = link,
                None => words.insert(1, link),
            }
            way.named.iter().for_each(|named| spell(&mut words, named));
        }
        Remedy::Draw => {
            let mut drawn = vec!["scope".to_owned()];
            drawn.extend(link_at.map(|at| words[at].clone()));
            for (option, short) in LINE_OPTIONS {
                if let Some(value) = take(&mut words, option, short) {
                    let name = if short.is_empty() { option } else { short };
                    drawn.extend([name.to_owned(), value]);
                }
            }
            drawn.push("--fault".into());
            words = drawn;
        }
    }
    words
}

/// Without its name an encoder has nothing of what stands under it, unless it was typed.
fn spell(words: &mut Vec<String>, named: &Encoder) {
    let said = [
        ("--frame", named.frame.as_ref().map(ToString::to_string)),
        ("--clock", named.clock.map(|clock| clock.to_string())),
        (
            "--timeout",
            named.timeout.map(|timeout| timeout.to_string()),
        ),
    ];
    for (option, value) in said {
        let name = short(&LINE_OPTIONS, option);
        let typed = take(&mut words.clone(), option, name).is_some();
        if let Some(value) = value.filter(|_| !typed) {
            let name = if name.is_empty() { option } else { name };
            words.extend([name.to_owned(), value]);
        }
    }
}

fn short(options: &[(&'static str, &'static str)], option: &str) -> &'static str {
    let known = options.iter().find(|(long, _)| *long == option);
    known.map_or("", |(_, short)| short)
}

/// Takes an option away, in any way it can be spelled, and returns the value it had last.
fn take(words: &mut Vec<String>, long: &str, short: &str) -> Option<String> {
    let mut value = None;
    let mut at = 1;
    while at < words.len() {
        let word = &words[at];
        if word == long || !short.is_empty() && word == short {
            words.remove(at);
            if at < words.len() {
                value = Some(words.remove(at));
            }
            continue;
        }
        let joined = word
            .strip_prefix(long)
            .and_then(|rest| rest.strip_prefix('='));
        let behind = || Some(word.strip_prefix(short)?.trim_start_matches('='));
        let joined = joined.or_else(|| behind().filter(|_| !short.is_empty()));
        match joined.map(str::to_owned) {
            Some(said) => {
                words.remove(at);
                value = Some(said);
            }
            None => at += 1,
        }
    }
    value
}

/// The link with one of its options set, before the frame, which takes the rest.
fn with_key(link: &str, key: &str, value: &str) -> String {
    let (options, frame) = match link.find(",frame=") {
        Some(at) => link.split_at(at),
        None => (link, ""),
    };
    let other = |option: &&str| option.split('=').next() != Some(key);
    let kept: Vec<&str> = options.split(',').filter(other).collect();
    format!("{},{key}={value}{frame}", kept.join(","))
}

#[cfg(test)]
mod tests {
    use super::*;
    use biss::unit::Hertz;

    fn words(text: &str) -> Vec<String> {
        text.split(' ').map(str::to_owned).collect()
    }

    #[test]
    fn the_next_command_is_the_one_that_was_typed_but_for_one_thing() {
        let option = |name, value: &str| Remedy::Options(vec![(name, value.into())]);
        let key = |name, value: &str| Remedy::Key(name, value.into());
        for (typed, remedy, next) in [
            (
                "read spi:0.0 -f st26,nE,nW,crc6 -n 5",
                option("--frame", "st24,nE,nW,crc6"),
                "read spi:0.0 -n 5 -f st24,nE,nW,crc6",
            ),
            (
                "read sim -fst26,crc6 -c1MHz",
                option("--clock", "2MHz"),
                "read sim -fst26,crc6 -c 2MHz",
            ),
            (
                "read sim --clock=1MHz",
                option("--clock", "2MHz"),
                "read sim -c 2MHz",
            ),
            (
                "stats sim --busy-limit 40us -n 9",
                option("--busy-limit", "80us"),
                "stats sim -n 9 --busy-limit 80us",
            ),
            (
                "read sim --rt 20",
                option("--wait", "30s"),
                "read sim --rt 20 --wait 30s",
            ),
            (
                "read spi:0.0,phase=3,pad=1,frame=st8,crc6 -n 2",
                key("phase", "2"),
                "read spi:0.0,pad=1,phase=2,frame=st8,crc6 -n 2",
            ),
            ("read spi:0.0 -n 2", Remedy::Again, "read spi:0.0 -n 2"),
            (
                "read file:x.vcd -f st8,crc6 -o json --timeout=12us -n 2",
                Remedy::Draw,
                "scope file:x.vcd -f st8,crc6 --timeout 12us --fault",
            ),
            (
                "read axis --config e.toml -o json",
                Remedy::Draw,
                "scope axis --config e.toml --fault",
            ),
            (
                "read axis --wait 30s -n 2",
                option("--wait", "30s"),
                "read axis --wait 30s -n 2",
            ),
        ] {
            let typed = words(typed);
            let way = Way {
                written: &typed[1],
                named: None,
            };
            assert_eq!(changed(&typed, way, &remedy), words(next), "{typed:?}");
        }
        let set = Way {
            written: "spi:0.0",
            named: None,
        };
        let next = changed(&words("read -n 2"), set, &key("pad", "90"));
        assert_eq!(next, words("read spi:0.0,pad=90 -n 2"));
        let encoder = Encoder {
            link: "spi:0.0".into(),
            frame: "st8,crc6".parse().ok(),
            clock: Some(Hertz(2_000_000)),
            ..Encoder::default()
        };
        let named = Way {
            written: "axis",
            named: Some(&encoder),
        };
        let next = changed(&words("read axis -c 1MHz"), named, &key("phase", "2"));
        assert_eq!(next, words("read spi:0.0,phase=2 -c 1MHz -f st8,crc6"));
        assert_eq!(quoted("exec:vvp -n 'a'"), r"'exec:vvp -n '\''a'\'''");
    }
}
