//! The decoder as the specification reads, one bit after the other: what the fast one is measured by.
#![allow(dead_code, unreachable_pub)]

use biss::crc::Crc;
use biss::cycle::{Fault, Head};
use biss::format::Channel;
use biss::frame::{BissC, Stall};
use biss::trace::{Cut, Trace};

/// A word as received: data, CRC, and what is wrong with it.
pub type Received = (u64, u16, Option<Fault>);

/// Levels, first to last.
struct Levels<'a> {
    trace: &'a Trace,
    at: usize,
}

impl Levels<'_> {
    fn next(&mut self) -> Option<bool> {
        let level = self.trace.bits.get(self.at)?;
        self.at += 1;
        Some(level)
    }

    fn number(&mut self, bits: u8) -> u64 {
        let mut number = 0;
        for _ in 0..bits {
            number = number << 1 | u64::from(self.next() == Some(true));
        }
        number
    }
}

/// The register shifts, and its top bit decides.
fn crc(crc: &Crc, data: u64, bits: u8) -> u16 {
    let (width, mut register) = (crc.bits(), u32::from(crc.init()));
    let mask = (1u32 << width) - 1;
    for place in (0..bits).rev() {
        let top = register >> (width - 1) & 1 ^ (data >> place & 1) as u32;
        register = register << 1 & mask;
        if top == 1 {
            register ^= crc.poly() & mask;
        }
    }
    (if crc.inverted() {
        register ^ mask
    } else {
        register
    }) as u16
}

/// Limits in clocks, eight at least (design: search limits).
fn clocks(limit_ns: u32, period_ns: Option<u32>) -> u64 {
    match period_ns {
        Some(period) if period > 0 => u64::from(limit_ns.div_ceil(period)).clamp(8, 2048),
        _ => 2048,
    }
}

fn stalled(protocol: &BissC, trace: &Trace) -> Option<Fault> {
    let reference = trace.reference_ns.unwrap_or(u32::MAX);
    let limit_ns = match protocol.stall {
        Stall::Static { min_ns } => min_ns,
        Stall::Adaptive => reference.min(12_000),
        Stall::Unknown => {
            let two = trace
                .ma_period_ns
                .map_or(u32::MAX, |ns| ns.saturating_mul(2));
            reference.min(12_000).min(two)
        }
    };
    if let Some(level) = trace.longest.filter(|level| level.ns > limit_ns) {
        return Some(Fault::Stalled {
            level_ns: level.ns,
            limit_ns,
            edge: level.edge,
        });
    }
    if let (Some(late), Some(period)) = (trace.late, trace.ma_period_ns) {
        let (level_ns, limit_ns) = (
            period.saturating_add(late.ns),
            period.saturating_add(period / 8),
        );
        if level_ns > limit_ns {
            return Some(Fault::Stalled {
                level_ns,
                limit_ns,
                edge: late.edge,
            });
        }
    }
    trace.misplaced_ns.map(|level_ns| Fault::Stalled {
        level_ns,
        limit_ns,
        edge: 0,
    })
}

/// A head, and all words in `words`, or what spoils the cycle.
pub fn decode(protocol: &BissC, trace: &Trace, words: &mut Vec<Received>) -> Result<Head, Fault> {
    words.clear();
    let have = trace.bits.len() as u64;
    let tail = 2 + u64::from(protocol.format.bits());
    let short = |want: u64| {
        Err(Fault::Short {
            have_bits: have as u16,
            want_bits: want as u16,
        })
    };
    if trace.cut == Some(Cut::Begin) {
        return short((3 + tail).max(have + 1));
    }
    let mut levels = Levels { trace, at: 0 };
    if trace.idle == Some(false) || levels.next() == Some(false) {
        return Err(Fault::NotReady {
            waited_ns: trace.waited_ns,
        });
    }
    if let Some(fault) = stalled(protocol, trace) {
        return Err(fault);
    }
    let (ack_limit, start_limit) = (
        clocks(protocol.ack_limit_ns, trace.ma_period_ns),
        clocks(protocol.busy_limit_ns, trace.ma_period_ns),
    );
    let ended = trace.cut == Some(Cut::End);
    let (mut delay, mut busy) = (0, 0);
    loop {
        match levels.next() {
            Some(true) => delay += 1,
            Some(false) => break,
            None => {
                let clocks = have.saturating_sub(2);
                return match have >= 3 + tail && !ended || clocks >= ack_limit {
                    true => Err(Fault::NoAck {
                        clocks: clocks as u16,
                    }),
                    false => short((3 + tail).max(have + 1)),
                };
            }
        }
    }
    let period_ns = trace.ma_period_ns.map_or(u64::MAX >> 16, u64::from);
    let late = trace
        .delay_ns
        .is_some_and(|ns| u64::from(ns) > ack_limit * period_ns);
    if delay > ack_limit || late {
        return Err(Fault::NoAck {
            clocks: ack_limit as u16,
        });
    }
    loop {
        match levels.next() {
            Some(false) => busy += 1,
            Some(true) => break,
            None => {
                return match busy >= start_limit || have >= 3 + tail && !ended && busy > 8 {
                    true => Err(Fault::NoStart {
                        clocks: busy as u16,
                    }),
                    false => short(2 + delay + busy + 1 + tail),
                };
            }
        }
    }
    if busy + 1 > start_limit {
        return Err(Fault::NoStart {
            clocks: start_limit as u16,
        });
    }
    let want = 2 + delay + busy + 1 + tail + u64::from(trace.surplus);
    if have < want {
        return short(want);
    }
    let head = Head {
        delay_clk: delay as u16,
        ack: busy as u16 + 1,
        cds: levels.next() == Some(true),
    };
    for channel in protocol.format.channels() {
        words.push(word(channel, &mut levels));
    }
    while let Some(level) = levels.next() {
        if level {
            return Err(Fault::Stop {
                clock: levels.at as u16,
            });
        }
    }
    Ok(head)
}

fn word(channel: &Channel, levels: &mut Levels) -> Received {
    let data = levels.number(channel.data_bits());
    let Some(check) = channel.crc() else {
        let null = data == 0 && channel.has_null();
        return (data, 0, null.then_some(Fault::Null));
    };
    let got = levels.number(check.bits()) as u16;
    let want = crc(check, data, channel.data_bits());
    let fault = match got == want {
        false => Some(Fault::Crc { got, want }),
        true if data == 0 && channel.has_null() => Some(Fault::Null),
        true => None,
    };
    (data, got, fault)
}
