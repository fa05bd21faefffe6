//! The line from the last SLO to the master: its delay and its jitter.

use super::config::Config;
use super::random::Random;
use std::collections::VecDeque;

/// Levels under way.
#[derive(Clone, Debug)]
pub(super) struct Line {
    /// As it left the slave last.
    sent: bool,
    /// As it arrived last, and the changes behind it.
    seen: bool,
    under_way: VecDeque<(u64, bool)>,
}

impl Line {
    pub(super) fn new(level: bool) -> Line {
        Line {
            sent: level,
            seen: level,
            under_way: VecDeque::with_capacity(64),
        }
    }

    /// The far end changes at `t_ns`.
    pub(super) fn drive(&mut self, t_ns: u64, level: bool, config: &Config, random: &mut Random) {
        if level == self.sent {
            return;
        }
        self.sent = level;
        let jitter = config.jitter.0;
        let wander = random.between(0, 2 * jitter);
        let earliest = self.under_way.back().map_or(t_ns, |(t, _)| *t);
        let at = (t_ns + config.delay.0 + wander)
            .saturating_sub(jitter)
            .max(earliest);
        self.under_way.push_back((at, level));
    }

    /// What has arrived by `t_ns`.
    pub(super) fn advance(&mut self, t_ns: u64) {
        while let Some(&(at, level)) = self.under_way.front() {
            if at > t_ns {
                break;
            }
            self.seen = level;
            self.under_way.pop_front();
        }
    }

    /// The level at the master.
    pub(super) fn seen(&self) -> bool {
        self.seen
    }

    /// When the next change arrives.
    pub(super) fn next_change(&self) -> Option<u64> {
        self.under_way.front().map(|(t, _)| *t)
    }
}
