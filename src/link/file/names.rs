//! Which channels are MA and SLO, as far as names and numbers tell.

use super::Error;
use super::source::{Channel, Source};

/// One of the two wires.
pub(super) struct Wire {
    pub(super) key: &'static str,
    usual: &'static [&'static str],
}

pub(super) const MA: Wire = Wire {
    key: "ma",
    usual: &["ma", "ma+", "ma_p", "clk", "clock", "mao"],
};

pub(super) const SLO: Wire = Wire {
    key: "slo",
    usual: &["slo", "sl", "slo+", "sl+", "slo_p", "sl_p", "data"],
};

impl Wire {
    pub(super) fn name(&self) -> String {
        self.key.to_uppercase()
    }

    pub(super) fn say(&self) -> String {
        format!("say which: file:PATH,{}=NAME", self.key)
    }
}

/// What a name says.
#[derive(Clone, Debug)]
pub(super) enum Picked {
    /// Asked for, or called as the wire is.
    Sure(Channel),
    /// It has another name that is usual for it.
    Usual(Channel),
    /// One of these.
    Open(Vec<Channel>),
}

/// `bits` are what else bears the name that was asked for.
pub(super) fn pick(
    source: &dyn Source,
    bits: &[Channel],
    asked: Option<&str>,
    wire: &Wire,
    doing: &str,
) -> Result<Picked, Error> {
    let channels = source.channels();
    let Some(name) = asked else {
        let usual = wire.usual.iter().map(|name| by_name(channels, name));
        let found = usual.into_iter().find(|found| !found.is_empty());
        return Ok(match found {
            Some(found) if is_one(&found) => {
                if found[0].name.eq_ignore_ascii_case(wire.key) {
                    Picked::Sure(found[0].clone())
                } else {
                    Picked::Usual(found[0].clone())
                }
            }
            found => Picked::Open(found.unwrap_or_else(|| channels.to_vec())),
        });
    };
    let mut found = by_name(channels, name);
    if found.is_empty() {
        found = bits.to_vec();
    }
    if found.is_empty() {
        let number = name.parse().ok().and_then(|number| source.numbered(number));
        found.extend(number);
    }
    if is_one(&found) {
        return Ok(Picked::Sure(found.remove(0)));
    }
    let said = if found.is_empty() {
        format!(
            "no signal `{name}`; one-bit signals are: {}",
            list(channels)
        )
    } else {
        format!("several signals could be {}: {}", wire.name(), list(&found))
    };
    Err(Error::new(doing, said, wire.say()))
}

fn by_name(channels: &[Channel], name: &str) -> Vec<Channel> {
    let exact = channels
        .iter()
        .filter(|channel| channel.path == name || channel.name == name);
    let exact: Vec<Channel> = exact.cloned().collect();
    if !exact.is_empty() {
        return exact;
    }
    let alike = channels
        .iter()
        .filter(|channel| channel.name.eq_ignore_ascii_case(name));
    alike.cloned().collect()
}

/// The same signal under several names is one signal.
fn is_one(found: &[Channel]) -> bool {
    let first = found.first();
    first.is_some_and(|first| found.iter().all(|channel| channel.id == first.id))
}

/// For a message.
pub(super) fn list(channels: &[Channel]) -> String {
    if channels.is_empty() {
        return "none".to_owned();
    }
    let paths: Vec<&str> = channels.iter().map(|c| c.path.as_str()).collect();
    paths.join(", ")
}
