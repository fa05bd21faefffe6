//! Who is on the line, for people and for scripts.

use biss::control::Failure;
use biss::identify::Trial;
use biss::identity::{Candidate, Cell, Field, Known, Limit, NOT_USED, Read};
use serde::Serialize;
use std::fmt::Write;

/// Everything that was found.
pub(crate) struct Shape<'a> {
    /// Slaves that took an ID; 9 stands for more.
    pub(crate) present: u8,
    pub(crate) devices: &'a [Known],
    pub(crate) left_out: &'a [Read],
    pub(crate) failed: &'a [(Read, Failure)],
    pub(crate) candidates: &'a [Candidate],
    pub(crate) trials: &'a [Option<Trial>],
    /// The candidate that fits.
    pub(crate) chosen: Option<usize>,
    /// What frames have not shown about it.
    pub(crate) doubts: Vec<&'static str>,
    pub(crate) limits: Vec<Limit>,
}

/// Registers of one kind.
struct Part<'a> {
    title: String,
    bank: Option<u8>,
    distrust: Option<&'static str>,
    fields: &'a [Field],
}

fn parts(known: &Known) -> Vec<Part<'_>> {
    let mut parts = vec![Part {
        title: format!("slave {}", known.device.slave),
        bank: None,
        distrust: None,
        fields: &known.device.fields,
    }];
    if let (Some(eds), Some(bank)) = (&known.eds, known.device.eds_bank.number()) {
        parts.push(Part {
            title: format!("EDS of slave {}, bank {bank}", known.device.slave),
            bank: Some(bank),
            distrust: eds.distrust,
            fields: &eds.fields,
        });
    }
    for (bank, profile) in &known.profiles {
        parts.push(Part {
            title: format!("profile EDS of slave {}, bank {bank}", known.device.slave),
            bank: Some(*bank),
            distrust: profile.distrust,
            fields: &profile.fields,
        });
    }
    parts.retain(|part| part.bank.is_none() || part.fields.iter().any(is_read));
    parts
}

fn is_read(field: &Field) -> bool {
    field.raw.iter().any(|cell| *cell != Cell::Unread)
}

/// Lines for people. Registers without a published meaning, and of channels that are not there, are shown where `all` are.
pub(crate) fn text(shape: &Shape<'_>, all: bool) -> String {
    let mut out = String::new();
    for known in shape.devices {
        for part in parts(known) {
            part.text(&mut out, all);
        }
    }
    if shape.present > 8 {
        out.push_str("more than eight slaves: those without an ID were not asked\n");
    }
    // Writing to a string does not fail.
    let _ = shape.frame_text(&mut out);
    out
}

impl Part<'_> {
    fn text(&self, out: &mut String, all: bool) {
        let _ = writeln!(out, "{}{}", self.title, marked(self.distrust));
        let said = |field: &&Field| {
            all || !field.name.is_empty() && (field.meaning != NOT_USED || field.doubt.is_some())
        };
        for field in self.fields.iter().filter(said) {
            let line = format!(
                "  0x{:02x}  {:9} {:17}  {}{}",
                field.offset,
                field.name,
                short_hex(field),
                field.meaning,
                marked(field.doubt),
            );
            let _ = writeln!(out, "{}", line.trim_end());
        }
    }
}

/// A doubt as it stands behind what is doubted.
fn marked(doubt: Option<&str>) -> String {
    doubt.map_or(String::new(), |why| format!("  ? {why}"))
}

/// The bytes, a long run of equal ones only once.
fn short_hex(field: &Field) -> String {
    match field.raw.first() {
        Some(first) if field.raw.len() > 6 && field.raw.iter().all(|cell| cell == first) => {
            format!("{first} x {}", field.raw.len())
        }
        _ => field.hex(),
    }
}

impl Shape<'_> {
    fn frame_text(&self, out: &mut String) -> std::fmt::Result {
        if let Some(chosen) = self.chosen {
            let candidate = &self.candidates[chosen];
            writeln!(out, "frame {}", candidate.format)?;
            writeln!(out, "  {}", candidate.reason)?;
            if let Some(trial) = self.trials[chosen] {
                writeln!(
                    out,
                    "  confirmed by {} of {} frames",
                    trial.good, trial.frames
                )?;
            }
            for doubt in &self.doubts {
                writeln!(out, "  ? {doubt}")?;
            }
        } else {
            self.tried_text(out)?;
        }
        writeln!(out, "limits")?;
        for limit in &self.limits {
            writeln!(
                out,
                "  {:9} {:17}  {}{}",
                limit.name,
                limit.value,
                limit.source,
                marked(limit.doubt)
            )?;
        }
        Ok(())
    }

    /// What was tried, where nothing or too much fits.
    fn tried_text(&self, out: &mut String) -> std::fmt::Result {
        for (candidate, trial) in self.candidates.iter().zip(self.trials) {
            writeln!(out, "tried {}", candidate.format)?;
            writeln!(out, "  {}", candidate.reason)?;
            let Some(trial) = trial else {
                writeln!(out, "  no CRC, so no frame can confirm it")?;
                continue;
            };
            write!(out, "  {} of {} frames fit", trial.good, trial.frames)?;
            match trial.fault {
                Some(fault) => writeln!(out, ", last fault {fault}")?,
                None => writeln!(out)?,
            }
        }
        Ok(())
    }
}

/// One record a slave, then one of all of them.
pub(crate) fn json(shape: &Shape<'_>) -> serde_json::Result<String> {
    let mut out = String::new();
    for known in shape.devices {
        out += &serde_json::to_string(&Slave::of(known))?;
        out.push('\n');
    }
    out += &serde_json::to_string(&Line::of(shape))?;
    out.push('\n');
    Ok(out)
}

#[derive(Serialize)]
struct Slave<'a> {
    r#type: &'static str,
    slave: u8,
    #[serde(skip_serializing_if = "Option::is_none")]
    dev_id: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    dev_id_text: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    mfr_id: Option<u16>,
    #[serde(skip_serializing_if = "Option::is_none")]
    mfr: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    dev_sn: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    profile: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    data_bits: Option<u8>,
    #[serde(skip_serializing_if = "Option::is_none")]
    eds_bank: Option<u8>,
    fields: Vec<Entry<'a>>,
}

#[derive(Serialize)]
struct Entry<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    bank: Option<u8>,
    addr: u8,
    name: &'a str,
    raw: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    value: Option<u64>,
    meaning: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    doubt: Option<&'a str>,
}

impl Slave<'_> {
    fn of(known: &Known) -> Slave<'_> {
        let device = &known.device;
        let id = || {
            device
                .id
                .raw
                .iter()
                .map(|cell| cell.byte())
                .collect::<Option<Vec<u8>>>()
        };
        Slave {
            r#type: "info",
            slave: device.slave,
            dev_id: id().map(|bytes| bytes.iter().map(|byte| format!("{byte:02x}")).collect()),
            dev_id_text: device.id.text(),
            mfr_id: device.manufacturer.number(),
            mfr: device.manufacturer.name(),
            dev_sn: device.serial.number(),
            profile: device.profile.name(),
            data_bits: device.profile.data_bits(),
            eds_bank: device.eds_bank.number(),
            fields: parts(known).into_iter().flat_map(Part::entries).collect(),
        }
    }
}

impl<'a> Part<'a> {
    fn entries(self) -> Vec<Entry<'a>> {
        let fields = self.fields.iter();
        fields
            .map(|field| Entry {
                bank: self.bank,
                addr: field.offset,
                name: field.name,
                raw: field.hex().replace(' ', ""),
                value: field.value,
                meaning: &field.meaning,
                doubt: field.doubt.or(self.distrust),
            })
            .collect()
    }
}

#[derive(Serialize)]
struct Line<'a> {
    r#type: &'static str,
    /// 9 stands for more than eight.
    slaves: u8,
    #[serde(skip_serializing_if = "Option::is_none")]
    frame: Option<String>,
    /// The slave of each channel.
    #[serde(skip_serializing_if = "Option::is_none")]
    channels: Option<&'a [u8]>,
    #[serde(skip_serializing_if = "<[&str]>::is_empty")]
    doubts: &'a [&'static str],
    tried: Vec<Tried<'a>>,
    limits: Vec<Bound<'a>>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    left_out: Vec<Missing>,
}

#[derive(Serialize)]
struct Tried<'a> {
    frame: String,
    reason: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    good: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    frames: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    fault: Option<&'static str>,
}

#[derive(Serialize)]
struct Bound<'a> {
    name: &'a str,
    value: &'a str,
    source: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    doubt: Option<&'a str>,
}

#[derive(Serialize)]
struct Missing {
    slave: u8,
    #[serde(skip_serializing_if = "Option::is_none")]
    bank: Option<u8>,
    what: &'static str,
    why: String,
}

impl<'a> Line<'a> {
    fn of(shape: &'a Shape<'_>) -> Line<'a> {
        let chosen = shape.chosen.map(|index| &shape.candidates[index]);
        let missing = |read: &Read, why: String| Missing {
            slave: read.slave,
            bank: read.bank,
            what: read.what,
            why,
        };
        let failed = shape
            .failed
            .iter()
            .map(|(read, failure)| missing(read, failure.to_string()));
        let left_out = shape
            .left_out
            .iter()
            .map(|read| missing(read, "--no-write".into()));
        Line {
            r#type: "info",
            slaves: shape.present,
            frame: chosen.map(|candidate| candidate.format.to_string()),
            channels: chosen.map(|candidate| candidate.slaves.as_slice()),
            doubts: &shape.doubts,
            tried: shape
                .candidates
                .iter()
                .zip(shape.trials)
                .map(Tried::of)
                .collect(),
            limits: shape.limits.iter().map(Bound::of).collect(),
            left_out: failed.chain(left_out).collect(),
        }
    }
}

impl Tried<'_> {
    fn of<'a>((candidate, trial): (&'a Candidate, &Option<Trial>)) -> Tried<'a> {
        Tried {
            frame: candidate.format.to_string(),
            reason: &candidate.reason,
            good: trial.map(|trial| trial.good),
            frames: trial.map(|trial| trial.frames),
            fault: trial
                .and_then(|trial| trial.fault)
                .map(|fault| fault.name()),
        }
    }
}

impl Bound<'_> {
    fn of(limit: &Limit) -> Bound<'_> {
        Bound {
            name: limit.name,
            value: &limit.value,
            source: limit.source,
            doubt: limit.doubt,
        }
    }
}
