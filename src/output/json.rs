//! Records as JSON Lines.

use super::{Good, Place, Record, Scd, Time};
use biss::format::Kind;
use serde::ser::{Serialize, SerializeMap, Serializer};

impl Serialize for Record<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("type", "frame")?;
        time(&mut map, self.time)?;
        map.serialize_entry("seq", &self.shot.seq)?;
        if let Some(Place { index, shown: true }) = self.ch {
            map.serialize_entry("ch", &index)?;
        }
        if let Some(slave) = self.slave() {
            map.serialize_entry("slave", &slave)?;
        }
        let good = self.good();
        let error = good.as_ref().and_then(|good| good.channel.error(good.data));
        map.serialize_entry("ok", &(good.is_some() && error != Some(true)))?;
        if let Some(good) = &good {
            good.entries(&mut map)?;
        } else if let Some(fault) = self.fault() {
            map.serialize_entry("fault", fault.name())?;
            for (name, number) in fault.numbers() {
                map.serialize_entry(name, &number)?;
            }
            if let Some((first, last)) = self.clocks() {
                map.serialize_entry("first_clock", &first)?;
                map.serialize_entry("last_clock", &last)?;
            }
        }
        if let Some(tries) = self.shot.tries {
            map.serialize_entry("tries", &tries)?;
        }
        self.head_entries(&mut map)?;
        self.raw_entries(&mut map)?;
        map.end()
    }
}

pub(super) fn time<M: SerializeMap>(map: &mut M, time: Time) -> Result<(), M::Error> {
    match time {
        Time::Zero(ns) => map.serialize_entry("t_ns", &ns),
        Time::Delta(ns) => map.serialize_entry("dt_ns", &ns),
        Time::Unix(us) => map.serialize_entry("t_unix_us", &us),
        Time::None => Ok(()),
    }
}

impl Good<'_> {
    fn entries<M: SerializeMap>(&self, map: &mut M) -> Result<(), M::Error> {
        for want in [Kind::Turn, Kind::SingleTurn, Kind::Position] {
            if let Some(field) = self.channel.find(|kind| *kind == want) {
                let name = if want == Kind::Turn { "turn" } else { "pos" };
                map.serialize_entry(name, &field.get(self.data))?;
            }
        }
        for field in self.channel.fields() {
            if let Kind::Data(name) = field.kind() {
                map.serialize_entry(name, &field.get(self.data))?;
            }
        }
        if let Some(field) = self.channel.find(|kind| *kind == Kind::Life) {
            map.serialize_entry("lc", &field.get(self.data))?;
        }
        if let Some(counts) = self.counts {
            map.serialize_entry("counts", &counts)?;
        }
        if let Some((degrees, _)) = self.degrees() {
            map.serialize_entry("deg", &degrees)?;
        }
        if let Some(error) = self.channel.error(self.data) {
            map.serialize_entry("error", &error)?;
        }
        if let Some(warning) = self.channel.warning(self.data) {
            map.serialize_entry("warning", &warning)?;
        }
        Ok(())
    }
}

impl Record<'_> {
    fn head_entries<M: SerializeMap>(&self, map: &mut M) -> Result<(), M::Error> {
        let head = self.shot.cycle.head();
        if let Some(head) = head {
            map.serialize_entry("ack", &head.ack)?;
        }
        match (self.shot.trace.delay_ns, head) {
            (Some(ns), _) => map.serialize_entry("delay_ns", &ns)?,
            (None, Some(head)) => map.serialize_entry("delay_clk", &head.delay_clk)?,
            (None, None) => {}
        }
        let measured = self.measured();
        if let Some(ns) = measured.busy_ns {
            map.serialize_entry("busy_ns", &ns)?;
        }
        if let Some(hz) = measured.clock_hz {
            map.serialize_entry("clock_hz", &hz)?;
        }
        if let Some(ns) = measured.timeout_ns {
            map.serialize_entry("timeout_ns", &ns)?;
        }
        if let Some(head) = head {
            map.serialize_entry("cds", &u8::from(head.cds))?;
        }
        Ok(())
    }

    fn raw_entries<M: SerializeMap>(&self, map: &mut M) -> Result<(), M::Error> {
        if let Some((channel, word)) = self.channel() {
            match channel.crc() {
                Some(_) => map.serialize_entry("crc", &word.raw().1)?,
                None => map.serialize_entry("unprotected", &true)?,
            }
            let scd = Scd(channel, word);
            map.serialize_entry("scd", &Shown(format_args!("{scd}")))?;
        }
        if self.verbose || self.ch.is_none() {
            map.serialize_entry("bits", &Shown(format_args!("{}", self.shot.trace.bits)))?;
        }
        Ok(())
    }
}

/// Text made while it is written.
struct Shown<'a>(std::fmt::Arguments<'a>);

impl Serialize for Shown<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&self.0)
    }
}
