//! Why frames are bad, told once, with the next command to type.

use super::poll::Poll;
use crate::output::{Why, note};
use biss::diagnose::{Diagnosis, Evidence, Remedy, Setup};
use biss::link::{Kind, Link, Phase};
use biss::master::Master;
use biss::trials;
use std::env;

/// Options that `scope` takes as well, with what stands behind them.
const LINE_OPTIONS: [(&str, &str); 5] = [
    ("--frame", "-f"),
    ("--clock", "-c"),
    ("--timeout", ""),
    ("--ack-limit", ""),
    ("--busy-limit", ""),
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
            self.summary.diagnosis = all.iter().map(told).collect();
        }
        news.iter().map(line).collect()
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

fn told(diagnosis: &Diagnosis) -> Why {
    Why {
        cause: diagnosis.cause.name(),
        text: diagnosis.to_string(),
        count: diagnosis.count,
        command: command(&diagnosis.remedy),
    }
}

fn line(diagnosis: &Diagnosis) -> String {
    let then = match diagnosis.advice {
        "" => "try",
        _ => "then",
    };
    format!("{diagnosis}; {then}: {}", command(&diagnosis.remedy))
}

/// The command to type: the one that was typed, with something changed.
fn command(remedy: &Remedy) -> String {
    let typed: Vec<String> = env::args_os()
        .skip(1)
        .map(|word| word.to_string_lossy().into_owned())
        .collect();
    let set = env::var("BISS_LINK").ok();
    let words = changed(&typed, set.as_deref(), remedy);
    let words = words.iter().map(|word| quoted(word));
    format!("biss {}", words.collect::<Vec<_>>().join(" "))
}

fn changed(typed: &[String], set: Option<&str>, remedy: &Remedy) -> Vec<String> {
    let mut words = typed.to_vec();
    match remedy {
        Remedy::Again => {}
        Remedy::Options(options) => {
            for (option, value) in options {
                take(&mut words, option, short(&SHORT, option));
                let name = match short(&SHORT, option) {
                    "" => option,
                    short => short,
                };
                words.extend([name.to_owned(), value.clone()]);
            }
        }
        Remedy::Key(key, value) => match words.iter_mut().find(|word| is_link(word)) {
            Some(link) => *link = with_key(link, key, value),
            None => words.insert(1, with_key(set.unwrap_or_default(), key, value)),
        },
        Remedy::Draw => {
            let link = words.iter().find(|word| is_link(word)).cloned();
            let mut drawn = vec!["scope".to_owned()];
            drawn.extend(link);
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

fn short(options: &[(&'static str, &'static str)], option: &str) -> &'static str {
    let known = options.iter().find(|(long, _)| *long == option);
    known.map_or("", |(_, short)| short)
}

/// Whether this word is the way to an encoder.
fn is_link(word: &str) -> bool {
    ["gpio", "spi", "wave", "sim", "file", "exec"]
        .iter()
        .any(|kind| {
            word.strip_prefix(kind)
                .is_some_and(|rest| rest.is_empty() || rest.starts_with(':'))
        })
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

/// As a shell reads it back.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "_./:=,+@%-".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

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
        ] {
            assert_eq!(
                changed(&words(typed), None, &remedy),
                words(next),
                "{typed}"
            );
        }
        let set = changed(&words("read -n 2"), Some("spi:0.0"), &key("pad", "90"));
        assert_eq!(set, words("read spi:0.0,pad=90 -n 2"));
        assert_eq!(quoted("exec:vvp -n 'a'"), r"'exec:vvp -n '\''a'\'''");
    }
}
