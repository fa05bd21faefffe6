//! Records as JSON Lines. No name of a record and no text in it needs escaping, see [`Object`].

use super::{Good, Place, Record, Scd, Time, number};
use biss::format::Kind;
use serde::ser::SerializeMap;
use std::io;

/// Writes the entries of an object, whose first one stands. Names are those of fields, which are a-z, 0-9 and _, and the
/// program's own; text is the program's own too.
struct Object<'a>(&'a mut Vec<u8>);

impl Object<'_> {
    fn name(&mut self, name: &str) -> &mut Vec<u8> {
        self.0.extend_from_slice(b",\"");
        self.0.extend_from_slice(name.as_bytes());
        self.0.extend_from_slice(b"\":");
        self.0
    }

    fn number(&mut self, name: &str, value: impl itoa::Integer) {
        number(self.name(name), value);
    }

    fn flag(&mut self, name: &str, value: bool) {
        let text: &[u8] = if value { b"true" } else { b"false" };
        self.name(name).extend_from_slice(text);
    }

    fn text(&mut self, name: &str, put: impl FnOnce(&mut Vec<u8>)) {
        self.name(name).push(b'"');
        put(self.0);
        self.0.push(b'"');
    }
}

impl Record<'_> {
    pub(super) fn json(&self, out: &mut Vec<u8>) -> io::Result<()> {
        out.extend_from_slice(b"{\"type\":\"frame\"");
        let mut object = Object(out);
        match self.time {
            Time::Zero(ns) => object.number("t_ns", ns),
            Time::Delta(ns) => object.number("dt_ns", ns),
            Time::Unix(us) => object.number("t_unix_us", us),
            Time::None => {}
        }
        object.number("seq", self.shot.seq);
        if let Some(Place { index, shown: true }) = self.ch {
            object.number("ch", index);
        }
        if let Some(slave) = self.slave() {
            object.number("slave", slave);
        }
        let good = self.good();
        let error = good.as_ref().and_then(|good| good.channel.error(good.data));
        object.flag("ok", good.is_some() && error != Some(true));
        match &good {
            Some(good) => good.entries(error, &mut object)?,
            None => self.fault_entries(&mut object),
        }
        if let Some(tries) = self.shot.tries {
            object.number("tries", tries);
        }
        self.head_entries(&mut object);
        self.raw_entries(&mut object);
        out.push(b'}');
        Ok(())
    }

    fn fault_entries(&self, object: &mut Object) {
        let Some(fault) = self.fault() else { return };
        object.text("fault", |out| {
            out.extend_from_slice(fault.name().as_bytes());
        });
        for (name, value) in fault.numbers() {
            object.number(name, value);
        }
        if let Some((first, last)) = self.clocks() {
            object.number("first_clock", first);
            object.number("last_clock", last);
        }
    }

    fn head_entries(&self, object: &mut Object) {
        let head = self.shot.cycle.head();
        if let Some(head) = head {
            object.number("ack", head.ack);
        }
        match (self.shot.trace.delay_ns, head) {
            (Some(ns), _) => object.number("delay_ns", ns),
            (None, Some(head)) => object.number("delay_clk", head.delay_clk),
            (None, None) => {}
        }
        let measured = self.measured();
        if let Some(ns) = measured.busy_ns {
            object.number("busy_ns", ns);
        }
        if let Some(hz) = measured.clock_hz {
            object.number("clock_hz", hz);
        }
        if let Some(ns) = measured.timeout_ns {
            object.number("timeout_ns", ns);
        }
        if let Some(head) = head {
            object.number("cds", u8::from(head.cds));
        }
    }

    fn raw_entries(&self, object: &mut Object) {
        if let Some((channel, word)) = self.channel() {
            match channel.crc() {
                Some(_) => object.number("crc", word.raw().1),
                None => object.flag("unprotected", true),
            }
            object.text("scd", |out| Scd(channel, word).put(out));
        }
        if self.verbose || self.ch.is_none() {
            let levels = self.shot.trace.bits.iter();
            object.text("bits", |out| {
                out.extend(levels.map(|bit| b'0' + u8::from(bit)));
            });
        }
    }
}

impl Good<'_> {
    fn entries(&self, error: Option<bool>, object: &mut Object) -> io::Result<()> {
        for want in [Kind::Turn, Kind::SingleTurn, Kind::Position] {
            if let Some(field) = self.channel.find(|kind| *kind == want) {
                let name = if want == Kind::Turn { "turn" } else { "pos" };
                object.number(name, field.get(self.data));
            }
        }
        for field in self.channel.fields() {
            if let Kind::Data(name) = field.kind() {
                object.number(name, field.get(self.data));
            }
        }
        if let Some(field) = self.channel.find(|kind| *kind == Kind::Life) {
            object.number("lc", field.get(self.data));
        }
        if let Some(counts) = self.counts {
            object.number("counts", counts);
        }
        if let Some((unit, value, _)) = self.measured() {
            serde_json::to_writer(object.name(unit.name()), &value)?;
        }
        if let Some(error) = error {
            object.flag("error", error);
        }
        if let Some(warning) = self.channel.warning(self.data) {
            object.flag("warning", warning);
        }
        Ok(())
    }
}

/// The same entry for records that serde writes.
pub(super) fn time<M: SerializeMap>(map: &mut M, time: Time) -> Result<(), M::Error> {
    match time {
        Time::Zero(ns) => map.serialize_entry("t_ns", &ns),
        Time::Delta(ns) => map.serialize_entry("dt_ns", &ns),
        Time::Unix(us) => map.serialize_entry("t_unix_us", &us),
        Time::None => Ok(()),
    }
}

/// serde_json, which escapes whatever comes, is the judge.
#[cfg(test)]
mod tests {
    use super::super::{Counted, Shot};
    use super::*;
    use biss::cycle::{Cycle, Fault, Head};
    use biss::format::Format;
    use biss::frame::{BissC, emit};
    use biss::measure::{Unit, scales};
    use biss::protocol::Protocol;
    use biss::trace::Trace;
    use fastrand::Rng;
    use serde_json::{Map, Value};
    use std::collections::HashSet;

    /// As serde_json would write it, told by this list of names.
    #[derive(Default)]
    struct Judge {
        text: String,
        map: Map<String, Value>,
    }

    impl Judge {
        fn entry(&mut self, name: &str, value: impl serde::Serialize) {
            let quoted = serde_json::to_string(name).unwrap();
            let before = if self.text.is_empty() { '{' } else { ',' };
            let text = serde_json::to_string(&value).unwrap();
            self.text += &format!("{before}{quoted}:{text}");
            let there = self
                .map
                .insert(name.into(), serde_json::from_str(&text).unwrap());
            assert_eq!(there, None, "{name} stands twice");
        }

        fn some(&mut self, name: &str, value: Option<impl serde::Serialize>) {
            if let Some(value) = value {
                self.entry(name, value);
            }
        }

        fn record(record: &Record) -> Judge {
            let mut judge = Judge::default();
            judge.entry("type", "frame");
            match record.time {
                Time::Zero(ns) => judge.entry("t_ns", ns),
                Time::Delta(ns) => judge.entry("dt_ns", ns),
                Time::Unix(us) => judge.entry("t_unix_us", us),
                Time::None => {}
            }
            judge.entry("seq", record.shot.seq);
            let place = record.ch.filter(|place| place.shown);
            judge.some("ch", place.map(|place| place.index));
            judge.some("slave", record.slave());
            let good = record.good();
            let error = good.as_ref().and_then(|good| good.channel.error(good.data));
            judge.entry("ok", good.is_some() && error != Some(true));
            if let Some(good) = good {
                judge.good(&good);
            } else if let Some(fault) = record.fault() {
                judge.entry("fault", fault.name());
                fault
                    .numbers()
                    .for_each(|(name, number)| judge.entry(name, number));
                judge.some("first_clock", record.clocks().map(|clocks| clocks.0));
                judge.some("last_clock", record.clocks().map(|clocks| clocks.1));
            }
            judge.some("tries", record.shot.tries);
            let (head, trace) = (record.shot.cycle.head(), record.shot.trace);
            judge.some("ack", head.map(|head| head.ack));
            judge.some("delay_ns", trace.delay_ns);
            let clocks = head.filter(|_| trace.delay_ns.is_none());
            judge.some("delay_clk", clocks.map(|head| head.delay_clk));
            let measured = record.measured();
            judge.some("busy_ns", measured.busy_ns);
            judge.some("clock_hz", measured.clock_hz);
            judge.some("timeout_ns", measured.timeout_ns);
            judge.some("cds", head.map(|head| u8::from(head.cds)));
            judge.raw(record);
            judge.text.push('}');
            judge
        }

        fn good(&mut self, good: &Good) {
            let field = |kind: Kind| Some(good.channel.find(|k| *k == kind)?.get(good.data));
            self.some("turn", field(Kind::Turn));
            self.some("pos", field(Kind::SingleTurn).or(field(Kind::Position)));
            for field in good.channel.fields() {
                if let Kind::Data(name) = field.kind() {
                    self.entry(name, field.get(good.data));
                }
            }
            self.some("lc", field(Kind::Life));
            self.some("counts", good.counts);
            if let Some((unit, value, _)) = good.measured() {
                self.entry(unit.name(), value);
            }
            self.some("error", good.channel.error(good.data));
            self.some("warning", good.channel.warning(good.data));
        }

        fn raw(&mut self, record: &Record) {
            if let Some((channel, word)) = record.channel() {
                let (data, crc) = word.raw();
                let unprotected = channel.crc().is_none();
                self.some("crc", (!unprotected).then_some(crc));
                self.some("unprotected", unprotected.then_some(true));
                let bits = usize::from(channel.data_bits() + channel.crc_bits());
                let (scd, digits) = (u128::from(data) << channel.crc_bits(), bits.div_ceil(4));
                self.entry("scd", format!("{:0digits$x}", scd | u128::from(crc)));
            }
            if record.verbose || record.ch.is_none() {
                self.entry("bits", record.shot.trace.bits.to_string());
            }
        }
    }

    fn format(rng: &mut Rng) -> Format {
        let fields = [
            "mt12",
            "mt24",
            "st1",
            "st20",
            "st40",
            "st64",
            "pos26",
            "pad4",
            "data8=temp",
            "data16",
            "data3=a_1",
            "lc6",
            "nE",
            "nW",
            "E",
            "W",
        ];
        loop {
            let mut channel = || {
                let fields: Vec<&str> = (0..rng.usize(1..6))
                    .map(|_| fields[rng.usize(..16)])
                    .collect();
                let crc = ["", ",crc5", ",crc6", ",crc16"][rng.usize(..4)];
                fields.join(",") + crc
            };
            let first = channel();
            let text = match channel() {
                second if second.len() % 2 == 0 => first + "+" + &second,
                _ => first,
            };
            if let Ok(format) = text.parse() {
                return format;
            }
        }
    }

    /// Numbers of every length.
    fn any(rng: &mut Rng) -> u64 {
        rng.u64(..) >> rng.u32(..64)
    }

    fn fault(rng: &mut Rng) -> Fault {
        let (a, b) = (any(rng), any(rng));
        let (c, d, n) = (a as u16, b as u16, b as u32);
        match rng.u8(..13) {
            0 => Fault::NotReady { waited_ns: None },
            1 => Fault::NotReady { waited_ns: Some(a) },
            2 => Fault::NoAck { clocks: c },
            3 => Fault::NoStart { clocks: c },
            4 => Fault::Short {
                have_bits: c,
                want_bits: d,
            },
            5 => Fault::Crc { got: c, want: d },
            6 => Fault::Stop { clock: c },
            7 => Fault::Null,
            8 => Fault::Stalled {
                level_ns: n,
                limit_ns: a as u32,
                edge: d,
            },
            9 => Fault::Life { got: a, want: b },
            10 => Fault::Mismatch {
                head: c,
                low: d,
                high: c,
            },
            11 => Fault::Delay {
                ns: n,
                learned_ns: n,
            },
            _ => Fault::Pair {
                cpw: a,
                spw: b,
                acc_bits: c as u8,
            },
        }
    }

    fn time(rng: &mut Rng) -> Time {
        let ns = any(rng);
        match rng.u8(..5) {
            0 => Time::None,
            1 => Time::Delta(ns),
            2 => Time::Unix(i128::from(ns) << rng.u32(..20)),
            _ => Time::Zero(ns),
        }
    }

    /// A frame of random words, now and then with bits turned, or with a fault of any kind.
    fn cycle(rng: &mut Rng, format: &Format, trace: &mut Trace) -> Cycle {
        let head = Head {
            delay_clk: rng.u16(..3),
            ack: rng.u16(1..4),
            cds: rng.bool(),
        };
        let words: Vec<u64> = format
            .channels()
            .iter()
            .map(|channel| any(rng) & u64::MAX >> (64 - channel.data_bits()))
            .collect();
        emit(format, head, &words, &mut trace.bits);
        if rng.u8(..4) == 0 {
            let levels: Vec<bool> = trace
                .bits
                .iter()
                .map(|bit| bit ^ (rng.u8(..16) == 0))
                .collect();
            trace.bits.clear();
            trace.bits.extend(levels);
        }
        let mut some = |most: u32| rng.bool().then(|| rng.u32(1..most));
        (trace.delay_ns, trace.busy_ns) = (some(3_000), some(40_000));
        (trace.ma_period_ns, trace.ready_ns) = (some(12_000), some(50_000));
        let mut cycle = Cycle::default();
        BissC::new(format.clone()).decode(trace, &mut cycle);
        if rng.u8(..4) == 0 {
            cycle.spoil(fault(rng));
        }
        cycle
    }

    #[test]
    fn every_record_is_what_serde_json_would_write() {
        let seed = fastrand::u64(..);
        println!("seed {seed}");
        let rng = &mut Rng::with_seed(seed);
        let (mut line, mut seen) = (Vec::new(), HashSet::new());
        for _ in 0..20_000 {
            let (format, mut trace) = (format(rng), Trace::default());
            let cycle = cycle(rng, &format, &mut trace);
            let counts =
                [any(rng), any(rng)].map(|n| (n % 5 > 0).then_some(i128::from(n) - (1 << 40)));
            let counted = Counted {
                counts: &counts,
                unwrapped: rng.bool(),
            };
            let unit = [None, Some(Unit::Radians), Some(Unit::Turns)][rng.usize(..3)];
            let scales = scales(&format, unit, None).unwrap_or_default();
            let shot = Shot {
                format: &format,
                cycle: &cycle,
                trace: &trace,
                t_ns: 0,
                seq: any(rng),
                scales: &scales,
                tries: rng.bool().then(|| rng.u32(1..20)),
                counted: rng.bool().then_some(counted),
                slaves: &[5, 255][..rng.usize(..=2)],
            };
            for record in Record::all(&shot, time(rng), rng.bool()) {
                line.clear();
                record.json(&mut line).unwrap();
                let text = std::str::from_utf8(&line).unwrap();
                let judge = Judge::record(&record);
                assert_eq!(text, judge.text, "{format}");
                let value: Value = serde_json::from_str(text).unwrap();
                assert_eq!(value, Value::Object(judge.map), "{format}");
                let names = value.as_object().unwrap().keys().cloned();
                seen.extend(names.chain(record.fault().map(|fault| fault.name().to_owned())));
            }
        }
        // Nothing was left out by chance.
        for name in Fault::NAMES {
            assert!(seen.contains(name), "{name}");
        }
        for name in [
            "turn", "pos", "temp", "data", "lc", "counts", "deg", "rad", "error", "warning",
            "slave", "ch", "bits",
        ] {
            assert!(seen.contains(name), "{name}");
        }
    }
}
