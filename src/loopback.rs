//! What comes back over a jumper, and what that says about it.

use std::fmt;

/// One look at two lines that are driven and the two that should follow them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Look {
    /// MA as driven.
    pub ma: bool,
    /// SLO as the slave drives it.
    pub slo_out: bool,
    /// MA as the slave sees it.
    pub ma_in: bool,
    /// SLO as the master sees it.
    pub slo: bool,
}

/// What an input shows while two outputs take all their levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shows {
    /// The output it should be wired to.
    Own,
    /// The same, upside down.
    OwnInverted,
    /// The other output.
    Other,
    /// The other one, upside down.
    OtherInverted,
    /// One level, whatever is driven.
    Stuck(bool),
    /// None of these: noise, or several outputs on one wire.
    Unsteady,
}

/// The four levels that two outputs can have together, in an order that moves one at a time.
pub const LEVELS: [(bool, bool); 4] = [(true, true), (false, true), (false, false), (true, false)];

impl Shows {
    fn of(
        looks: &[Look],
        own: fn(&Look) -> bool,
        other: fn(&Look) -> bool,
        read: fn(&Look) -> bool,
    ) -> Shows {
        let all = |test: &dyn Fn(&Look) -> bool| looks.iter().all(test);
        if all(&|look| read(look) == own(look)) {
            Shows::Own
        } else if all(&|look| read(look) != own(look)) {
            Shows::OwnInverted
        } else if all(&|look| read(look) == other(look)) {
            Shows::Other
        } else if all(&|look| read(look) != other(look)) {
            Shows::OtherInverted
        } else if all(&|look| read(look)) {
            Shows::Stuck(true)
        } else if all(&|look| !read(look)) {
            Shows::Stuck(false)
        } else {
            Shows::Unsteady
        }
    }
}

/// How two jumpers are wired, as far as levels tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wiring {
    /// The slave's MA, whose own output is the master's MA.
    pub ma_in: Shows,
    /// The master's SLO, whose own output is the slave's.
    pub slo: Shows,
}

impl Wiring {
    /// From a look at each of [`LEVELS`], several rounds of them.
    pub fn of(looks: &[Look]) -> Wiring {
        Wiring {
            ma_in: Shows::of(
                looks,
                |look| look.ma,
                |look| look.slo_out,
                |look| look.ma_in,
            ),
            slo: Shows::of(looks, |look| look.slo_out, |look| look.ma, |look| look.slo),
        }
    }

    /// Whether both inputs show what they should.
    pub fn is_good(&self) -> bool {
        (self.ma_in, self.slo) == (Shows::Own, Shows::Own)
    }

    /// What is wrong, and what to do about it: a line each, none when all is well.
    pub fn complaints(&self) -> Vec<String> {
        use Shows::{Other, OtherInverted};
        if let (Other | OtherInverted, Other | OtherInverted) = (self.ma_in, self.slo) {
            return vec![
                "the jumpers are crossed: MA arrives at slo=, slo-out= at ma-in=; swap their ends at one side".into(),
            ];
        }
        let one = |shows, input: &str, own: &str, other: &str| match shows {
            Shows::Own => None,
            Shows::OwnInverted => Some(format!(
                "{input} shows {own} upside down: something inverts on the way, or a differential pair is swapped"
            )),
            Shows::Other => Some(format!(
                "{input} shows {other} instead of {own}: its jumper is on the wrong line"
            )),
            Shows::OtherInverted => Some(format!(
                "{input} shows {other} upside down instead of {own}: its jumper is on the wrong line"
            )),
            Shows::Stuck(level) => Some(format!(
                "{input} stays {} whatever {own} does: no jumper, one on another line, or a short",
                if level { "high" } else { "low" }
            )),
            Shows::Unsteady => Some(format!(
                "{input} shows neither {own} nor {other}: a loose jumper, or two outputs on one wire"
            )),
        };
        [
            one(self.ma_in, "ma-in=", "ma=", "slo-out="),
            one(self.slo, "slo=", "slo-out=", "ma="),
        ]
        .into_iter()
        .flatten()
        .collect()
    }
}

/// What came back of bits that were shifted out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Echo {
    /// The same.
    Same,
    /// All of them high.
    StuckHigh,
    /// All of them low.
    StuckLow,
    /// All of them upside down.
    Inverted,
    /// The same, one bit later.
    Late,
    /// Some are not.
    Differs {
        /// How many.
        bits: usize,
        /// The first one.
        first: usize,
    },
}

impl Echo {
    /// Compares bits that were sent, which should hold both levels and no short period, with those that came back.
    pub fn of(sent: &[u8], back: &[u8]) -> Echo {
        let pairs = || sent.iter().zip(back);
        let differing: usize = pairs().map(|(a, b)| (a ^ b).count_ones() as usize).sum();
        let late = || {
            let mut carry = back.first().map_or(0, |first| first >> 7);
            pairs().all(|(sent, back)| {
                let shifted = carry << 7 | sent >> 1;
                carry = sent & 1;
                shifted == *back
            })
        };
        if differing == 0 {
            Echo::Same
        } else if back.iter().all(|byte| *byte == 0xFF) {
            Echo::StuckHigh
        } else if back.iter().all(|byte| *byte == 0x00) {
            Echo::StuckLow
        } else if differing == 8 * sent.len().min(back.len()) {
            Echo::Inverted
        } else if late() {
            Echo::Late
        } else {
            let first = pairs().position(|(a, b)| a != b).unwrap_or(0);
            let bit = pairs()
                .nth(first)
                .map_or(0, |(a, b)| (a ^ b).leading_zeros() as usize);
            Echo::Differs {
                bits: differing,
                first: 8 * first + bit,
            }
        }
    }

    /// Its name in records.
    pub fn name(&self) -> &'static str {
        match self {
            Echo::Same => "same",
            Echo::StuckHigh => "stuck-high",
            Echo::StuckLow => "stuck-low",
            Echo::Inverted => "inverted",
            Echo::Late => "late",
            Echo::Differs { .. } => "differs",
        }
    }
}

impl fmt::Display for Echo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Echo::Same => f.write_str("the same, bit for bit"),
            Echo::StuckHigh => {
                f.write_str("MISO stays high: no jumper from MOSI, or one on another pin")
            }
            Echo::StuckLow => f.write_str(
                "MISO stays low: no jumper from MOSI, one on another pin, or a short to ground",
            ),
            Echo::Inverted => f.write_str(
                "upside down: something inverts on the way, or a differential pair is swapped",
            ),
            Echo::Late => f.write_str("one bit late: the way is too long for this SCLK"),
            Echo::Differs { bits, first } => {
                write!(f, "{bits} bits differ, the first is bit {first}")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All four levels, twice, and what two inputs make of them.
    fn wiring(ma_in: fn(bool, bool) -> bool, slo: fn(bool, bool) -> bool) -> Wiring {
        let looks: Vec<Look> = LEVELS
            .iter()
            .chain(&LEVELS)
            .map(|(ma, slo_out)| Look {
                ma: *ma,
                slo_out: *slo_out,
                ma_in: ma_in(*ma, *slo_out),
                slo: slo(*ma, *slo_out),
            })
            .collect();
        Wiring::of(&looks)
    }

    #[test]
    fn wiring_is_told_from_levels() {
        let good = wiring(|ma, _| ma, |_, slo_out| slo_out);
        assert!(good.is_good() && good.complaints().is_empty());
        type Input = fn(bool, bool) -> bool;
        let cases: [(Input, Input, &str); 8] = [
            (|_, slo| slo, |ma, _| ma, "crossed"),
            (|_, _| true, |_, slo| slo, "ma-in= stays high"),
            (|_, _| false, |_, slo| slo, "ma-in= stays low"),
            (|ma, _| ma, |_, _| true, "slo= stays high"),
            (|ma, _| ma, |ma, _| ma, "slo= shows ma= instead"),
            (|ma, _| !ma, |_, slo| slo, "ma-in= shows ma= upside down"),
            (|ma, slo| ma && slo, |_, slo| slo, "neither"),
            (|_, slo| !slo, |_, slo| slo, "shows slo-out= upside down"),
        ];
        for (ma_in, slo, words) in cases {
            let wiring = wiring(ma_in, slo);
            let complaints = wiring.complaints();
            assert!(!wiring.is_good());
            assert_eq!(complaints.len(), 1, "{complaints:?}");
            assert!(complaints[0].contains(words), "{complaints:?}");
        }
        let both = wiring(|_, _| true, |_, _| false);
        assert_eq!(both.complaints().len(), 2);
    }

    #[test]
    fn echoes_are_told_apart() {
        let sent = [0xA5, 0x0F, 0x33, 0xC1, 0x80];
        assert_eq!(Echo::of(&sent, &sent), Echo::Same);
        assert_eq!(Echo::of(&sent, &[0xFF; 5]), Echo::StuckHigh);
        assert_eq!(Echo::of(&sent, &[0x00; 5]), Echo::StuckLow);
        assert_eq!(Echo::of(&sent, &sent.map(|byte| !byte)), Echo::Inverted);
        assert_eq!(Echo::of(&sent, &[0x52, 0x87, 0x99, 0xE0, 0xC0]), Echo::Late);
        assert_eq!(Echo::of(&sent, &[0xD2, 0x87, 0x99, 0xE0, 0xC0]), Echo::Late);
        let differs = Echo::Differs { bits: 2, first: 10 };
        assert_eq!(Echo::of(&sent, &[0xA5, 0x2F, 0x33, 0xC1, 0x81]), differs);
    }
}
