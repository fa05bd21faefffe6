//! Frame formats to try on live frames.

use super::device::variant_bits;
use super::{Device, Eds, EdsChannel, Encoder, Known, Profile, ProfileEds};
use crate::crc::Crc;
use crate::format::Format;

/// Most formats that [`candidates`] returns.
pub const MAX_CANDIDATES: usize = 64;

/// A frame format that the registers suggest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Candidate {
    /// What to try.
    pub format: Format,
    /// The slave ID of each channel, in wire order.
    pub slaves: Vec<u8>,
    /// What in the registers it was made of.
    pub reason: String,
    /// What no frame can show to be right, because the CRC passes either way.
    pub doubts: Vec<&'static str>,
}

/// Formats to try, most likely first, without doubles, at most [`MAX_CANDIDATES`].
///
/// `devices` are all slave IDs on the bus, in any order. There is none where something about one of them is missing:
/// [`unexplained`] says which.
///
/// A candidate is right when frames with changing data pass its CRC again and again, and where it has a sign of life,
/// when that counts. One whose channels have no CRC cannot be confirmed.
pub fn candidates(devices: &[Known]) -> Vec<Candidate> {
    let Some(groups) = groups(devices) else {
        return Vec::new();
    };
    let parts: Vec<Vec<Part>> = groups.iter().map(Group::parts).collect();
    let counts: Vec<usize> = parts.iter().map(Vec::len).collect();
    let mut found: Vec<Candidate> = Vec::new();
    for pick in picks(&counts, 4 * MAX_CANDIDATES) {
        let chosen = parts.iter().zip(&pick).map(|(parts, at)| &parts[*at]);
        let channels: Vec<&(u8, Choice)> = chosen.flatten().collect();
        // The CRC passes either way: whether the sign of life counts must be seen before it is taken for something else.
        for life in [true, false] {
            found.extend(joined(&channels, life).filter(|candidate| {
                let twin = |known: &Candidate| known.format == candidate.format;
                !found.iter().any(twin)
            }));
        }
        if found.len() >= MAX_CANDIDATES {
            break;
        }
    }
    found.truncate(MAX_CANDIDATES);
    found
}

/// The slave IDs whose registers do not say what they send: a format of the whole frame cannot be made while there is
/// one. IDs that are missing between the others are among them.
pub fn unexplained(devices: &[Known]) -> Vec<u8> {
    let Some(last) = devices.iter().map(|known| known.device.slave).max() else {
        return Vec::new();
    };
    let have = |id: &u8| devices.iter().any(|known| known.device.slave == *id);
    let missing: Vec<u8> = (0..=last).filter(|id| !have(id)).collect();
    if !missing.is_empty() {
        return missing;
    }
    let groups = groups(devices).unwrap_or_default();
    let dark = groups.iter().filter(|group| group.parts().is_empty());
    let mut ids: Vec<u8> = dark.flat_map(|group| group.ids.clone()).collect();
    ids.sort_unstable();
    ids
}

/// The polynomials that 8 bits can stand for, leading term included, likelier first: as they stand, or with the constant
/// term left out, which is how iC-Haus stores them (iC-MB3, p. 15). A polynomial that stands for its width is likelier
/// than one that does not; without a constant term it is none.
///
/// ```
/// use biss::identity::readings;
///
/// assert_eq!(readings(0x43), [0x43, 0x87]);
/// assert_eq!(readings(0x21), [0x43, 0x21]);
/// assert_eq!(readings(0x97), [0x12F, 0x97]);
/// assert_eq!(readings(0x12), [0x25]);
/// ```
pub fn readings(cpoly: u8) -> Vec<u32> {
    ordered(u32::from(cpoly), Convention::Short)
}

/// The polynomials that the four bytes of a profile EDS can stand for, likelier first, each with whether it takes the low
/// byte first: that is tried only where the number is too large as it stands.
pub fn wide_readings(cpoly: u32) -> Vec<(u32, bool)> {
    wide_ordered(cpoly, Convention::Short)
}

fn wide_ordered(cpoly: u32, unless_known: Convention) -> Vec<(u32, bool)> {
    let read = |number, low_first| {
        let polys = ordered(number, unless_known);
        polys.into_iter().map(move |poly| (poly, low_first))
    };
    if cpoly > 0x1_FFFF {
        return read(cpoly.swap_bytes(), true).collect();
    }
    read(cpoly, false).collect()
}

/// How a device writes its polynomials.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Convention {
    /// With the constant term.
    Whole,
    /// Without.
    Short,
}

fn ordered(number: u32, unless_known: Convention) -> Vec<u32> {
    let whole = Some(number).filter(|poly| is_polynomial(*poly));
    let short = number.checked_mul(2).map(|twice| twice | 1);
    let short = short.filter(|poly| is_polynomial(*poly));
    let short_first = match convention(number) {
        Some(shown) => shown == Convention::Short,
        None => unless_known == Convention::Short,
    };
    let both = if short_first {
        [short, whole]
    } else {
        [whole, short]
    };
    both.into_iter().flatten().collect()
}

/// What a number shows about how it is written: one of the two readings is a polynomial that stands for its width.
fn convention(number: u32) -> Option<Convention> {
    match (is_usual(number), is_usual(number.wrapping_mul(2) | 1)) {
        (true, false) => Some(Convention::Whole),
        (false, true) => Some(Convention::Short),
        _ => None,
    }
}

/// 1 to 16 CRC bits, and a constant term.
fn is_polynomial(poly: u32) -> bool {
    (0b11..=0x1_FFFF).contains(&poly) && poly & 1 == 1
}

fn is_usual(poly: u32) -> bool {
    is_polynomial(poly) && Crc::standard(degree(poly)).is_some_and(|crc| crc.poly() == poly)
}

/// The CRC bits of a polynomial: the place of its top bit.
fn degree(poly: u32) -> u8 {
    poly.checked_ilog2().unwrap_or(0) as u8
}

/// A channel as it might be: its text, why, and what remains open.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Choice {
    text: String,
    /// The same bits read without a sign of life, where `text` has one.
    lifeless: Option<String>,
    why: String,
    doubts: Vec<&'static str>,
}

/// The channels of one device in wire order, each with its slave ID.
type Part = Vec<(u8, Choice)>;

/// Channels in wire order with all that each might be, likelier first.
type Arrangement = Vec<(u8, Vec<Choice>)>;

fn joined(channels: &[&(u8, Choice)], life: bool) -> Option<Candidate> {
    let text = |choice: &'_ Choice| match &choice.lifeless {
        Some(lifeless) if !life => lifeless.clone(),
        _ => choice.text.clone(),
    };
    let texts: Vec<String> = channels.iter().map(|(_, choice)| text(choice)).collect();
    let format = texts.join("+").parse().ok()?;
    let reasons: Vec<String> = match channels {
        [(_, choice)] => vec![choice.why.clone()],
        _ => channels
            .iter()
            .map(|(slave, choice)| format!("slave {slave}: {}", choice.why))
            .collect(),
    };
    let mut doubts: Vec<&'static str> = Vec::new();
    for doubt in channels.iter().flat_map(|(_, choice)| &choice.doubts) {
        if !doubts.contains(doubt) {
            doubts.push(doubt);
        }
    }
    Some(Candidate {
        format,
        slaves: channels.iter().map(|(slave, _)| *slave).collect(),
        reason: reasons.join("; "),
        doubts,
    })
}

/// The slave IDs of one device.
struct Group<'a> {
    /// Nearest the master first: highest first (D2, p. 11-14).
    ids: Vec<u8>,
    /// In the same order.
    members: Vec<&'a Known>,
    /// Which member's EDS describes them.
    eds: Option<(&'a Known, &'a Eds)>,
    /// Other devices are on the bus.
    in_chain: bool,
    /// How polynomials are written where the device itself does not show it.
    usual: Convention,
}

/// The devices on the bus, nearest the master first; `None` unless the IDs are 0 to n. A trusted EDS with several slave
/// IDs makes one device of them, if all of them are there and nobody else has claimed them.
fn groups(devices: &[Known]) -> Option<Vec<Group<'_>>> {
    let mut slaves: Vec<&Known> = devices.iter().collect();
    slaves.sort_by_key(|known| known.device.slave);
    slaves.dedup_by_key(|known| known.device.slave);
    let count = slaves.len();
    if count == 0 || usize::from(slaves[count - 1].device.slave) + 1 != count {
        return None;
    }
    let mut owner: Vec<Option<usize>> = vec![None; count];
    for (at, known) in slaves.iter().enumerate() {
        let Some(range) = known.trusted_eds().and_then(|eds| claim(at, eds, count)) else {
            continue;
        };
        if owner[range.clone()].iter().all(Option::is_none) {
            owner[range].fill(Some(at));
        }
    }
    let mut groups: Vec<Group<'_>> = Vec::new();
    let mut last_owner = None;
    for at in (0..count).rev() {
        let known = slaves[at];
        if let (Some(by), Some(group)) = (owner[at], groups.last_mut()) {
            if last_owner == Some(by) {
                group.ids.push(known.device.slave);
                group.members.push(known);
                continue;
            }
        }
        last_owner = owner[at];
        let described = slaves[owner[at].unwrap_or(at)];
        groups.push(Group {
            ids: vec![known.device.slave],
            members: vec![known],
            eds: described.trusted_eds().map(|eds| (described, eds)),
            in_chain: true,
            usual: Convention::Short,
        });
    }
    if let [only] = groups.as_mut_slice() {
        only.in_chain = false;
    }
    let described = groups.iter().filter_map(|group| group.eds);
    let shown: Vec<Convention> = described
        .flat_map(|(through, eds)| shown_by(through, eds))
        .collect();
    if let Some(usual) = majority(&shown) {
        groups.iter_mut().for_each(|group| group.usual = usual);
    }
    Some(groups)
}

/// The IDs that an EDS read through ID `at` describes, where they are several and all on the bus.
fn claim(at: usize, eds: &Eds, count: usize) -> Option<std::ops::Range<usize>> {
    let slaves = usize::from(eds.slave_count.filter(|count| *count > 1)?);
    let first = at.checked_sub(usize::from(eds.slave_offset?))?;
    let range = first..first + slaves;
    (range.contains(&at) && range.end <= count).then_some(range)
}

impl Group<'_> {
    /// All that the device might send, likelier first.
    fn parts(&self) -> Vec<Part> {
        let mut arrangements = self.by_eds();
        arrangements.extend(self.by_profile());
        let mut columns: Vec<_> = arrangements
            .iter()
            .map(|arrangement| expanded(arrangement).into_iter())
            .collect();
        // In turn, so that the many readings of one arrangement do not hide the next.
        let mut parts: Vec<Part> = Vec::new();
        loop {
            let row: Vec<Part> = columns.iter_mut().filter_map(Iterator::next).collect();
            if row.is_empty() || parts.len() >= MAX_CANDIDATES {
                break;
            }
            for part in row {
                if !parts.contains(&part) {
                    parts.push(part);
                }
            }
        }
        parts.truncate(MAX_CANDIDATES);
        parts
    }

    fn member(&self, id: u8) -> Option<&Device> {
        let at = self.ids.iter().position(|have| *have == id)?;
        Some(&self.members[at].device)
    }

    /// The channels in both orders: which of them is nearest the master is said by their slave IDs, where they have
    /// their own, and by nothing else.
    fn by_eds(&self) -> Vec<Arrangement> {
        let Some((through, eds)) = self.eds else {
            return Vec::new();
        };
        let (Some(highest), Some(lowest)) = (self.ids.first(), self.ids.last()) else {
            return Vec::new();
        };
        let shown = majority(&shown_by(through, eds)).unwrap_or(self.usual);
        let describe = |channel: &EdsChannel, id: u8| {
            let device = self.member(id).unwrap_or(&through.device);
            let profile = channel.profile_bank.and_then(|bank| through.profile(bank));
            let profile = profile.filter(|profile| profile.distrust.is_none());
            (id, eds_choices(channel, device.profile, profile, shown))
        };
        let used = || eds.channels.iter().filter(|channel| channel.data_bits > 0);
        let up = |channel: &EdsChannel| lowest.saturating_add(channel.slave).min(*highest);
        let down = |channel: &EdsChannel| highest.saturating_sub(channel.slave).max(*lowest);
        let far_last: Arrangement = used().rev().map(|c| describe(c, up(c))).collect();
        let near_first: Arrangement = used().map(|c| describe(c, down(c))).collect();
        match (self.ids.len(), far_last.len()) {
            (_, 0 | 1) => vec![far_last],
            (1, _) => vec![near_first, far_last],
            _ => vec![far_last, near_first],
        }
    }

    /// Each slave ID as its own BP_ID says; nothing unless all say something.
    fn by_profile(&self) -> Vec<Arrangement> {
        let lowest = self.ids.last().copied().unwrap_or(0);
        let coupler = self.eds.and_then(|(_, eds)| eds.bus_coupler);
        let coupler = coupler.map(|index| lowest.saturating_add(index));
        let alone = !self.in_chain && self.ids.len() == 1;
        let alternatives: Vec<Vec<Arrangement>> = self
            .members
            .iter()
            .map(|known| match known.device.profile {
                Profile::None if coupler == Some(known.device.slave) => vec![Vec::new()],
                _ => profile_arrangements(&known.device, alone),
            })
            .collect();
        let counts: Vec<usize> = alternatives.iter().map(Vec::len).collect();
        picks(&counts, 16)
            .iter()
            .map(|pick| {
                let chosen = alternatives.iter().zip(pick);
                chosen.flat_map(|(all, at)| all[*at].clone()).collect()
            })
            .collect()
    }
}

/// An arrangement with one choice made for each channel, likelier first.
fn expanded(arrangement: &Arrangement) -> Vec<Part> {
    let counts: Vec<usize> = arrangement.iter().map(|(_, all)| all.len()).collect();
    let all = picks(&counts, MAX_CANDIDATES);
    all.iter()
        .map(|pick| {
            let chosen = arrangement.iter().zip(pick);
            chosen
                .map(|((slave, choices), at)| (*slave, choices[*at].clone()))
                .collect()
        })
        .collect()
}

/// One index for each of `counts`, below it: first all alike, as a device does not write its channels in different ways,
/// then by how many ranks they are from the likeliest. At most `limit`.
fn picks(counts: &[usize], limit: usize) -> Vec<Vec<usize>> {
    if counts.contains(&0) {
        return Vec::new();
    }
    let most = counts.iter().copied().max().unwrap_or(1);
    let mut found: Vec<Vec<usize>> = Vec::new();
    for rank in 0..most.min(8) {
        let alike = counts.iter().map(|count| rank.min(count - 1)).collect();
        if !found.contains(&alike) {
            found.push(alike);
        }
    }
    let farthest: usize = counts.iter().map(|count| count - 1).sum();
    for ranks in 0..=farthest {
        if found.len() >= limit {
            break;
        }
        spread(counts, ranks, &mut Vec::new(), &mut found, limit);
    }
    found.truncate(limit);
    found
}

/// All ways to share `ranks` out among `counts`.
fn spread(
    counts: &[usize],
    ranks: usize,
    begun: &mut Vec<usize>,
    found: &mut Vec<Vec<usize>>,
    limit: usize,
) {
    let left = &counts[begun.len()..];
    let room: usize = left.iter().map(|count| count - 1).sum();
    if ranks > room || found.len() >= limit {
        return;
    }
    let Some(count) = left.first() else {
        if !found.contains(begun) {
            found.push(begun.clone());
        }
        return;
    };
    for rank in 0..*count.min(&(ranks + 1)) {
        begun.push(rank);
        spread(counts, ranks - rank, begun, found, limit);
        begun.pop();
    }
}

/// How a device writes its polynomials, where its channels show it.
fn shown_by(through: &Known, eds: &Eds) -> Vec<Convention> {
    let used = eds.channels.iter().filter(|channel| channel.data_bits > 0);
    let stored = used.flat_map(|channel| {
        let profile = channel.profile_bank.and_then(|bank| through.profile(bank));
        [
            Some(channel.cpoly.into()),
            profile.and_then(|profile| profile.poly),
        ]
    });
    stored.flatten().filter_map(convention).collect()
}

fn majority(shown: &[Convention]) -> Option<Convention> {
    let count = |want| shown.iter().filter(|shown| **shown == want).count();
    match count(Convention::Whole).cmp(&count(Convention::Short)) {
        std::cmp::Ordering::Greater => Some(Convention::Whole),
        std::cmp::Ordering::Less => Some(Convention::Short),
        std::cmp::Ordering::Equal => None,
    }
}

const LEFT: &str = "left-aligned: the lowest bits of the position may mean nothing";
const SPLIT: &str = "how many of the bits count turns is not known";
const ROTARY: &str = "taken for a rotary encoder: the registers do not say";
const STOP: &str = "taken to send a stop bit before its data, as FORMAT says";
const BP1: &str = "BP1 is known from two data sheets only";
const SAFETY_POLY: u32 = 0x190D9;
const ENCODER_POLY: u32 = 0x43;
/// Bits of the sign of life (BiSS Safety Concept A5).
const LIFE_BITS: u8 = 6;

/// What the data of a channel is.
#[derive(Clone, Copy)]
struct Content<'a> {
    bits: u8,
    profile: Option<&'a ProfileEds>,
    encoder: bool,
    stop: bool,
    left: bool,
}

impl Content<'_> {
    /// The fields before the CRC, as text, with what is open about them; `None` where they do not fit.
    fn fields(&self, life: bool) -> Option<(String, Vec<&'static str>)> {
        if !self.encoder {
            let text = format!("data{}", self.bits);
            return Some((text, Vec::new()));
        }
        let flags = if life { 2 + LIFE_BITS } else { 2 };
        let position = self.bits.checked_sub(flags).filter(|bits| *bits > 0)?;
        let turns = self.profile.and_then(|profile| profile.turn_bits);
        let kind = self.profile.and_then(|profile| profile.encoder);
        let mut doubts = Vec::new();
        let text = match (kind, turns) {
            (Some(Encoder::Linear), _) => format!("pos{position}"),
            (_, Some(0)) => format!("st{position}"),
            (_, Some(turns)) if turns < position => format!("mt{turns},st{}", position - turns),
            _ => {
                doubts.push(SPLIT);
                format!("st{position}")
            }
        };
        if kind.is_none() {
            doubts.push(ROTARY);
        }
        if self.left {
            doubts.push(LEFT);
        }
        let life = if life { ",lc6" } else { "" };
        Some((format!("{text},nE,nW{life}"), doubts))
    }

    /// The channel with a CRC. Only the safety polynomial goes with a sign of life, which may be left out.
    fn with(&self, crc: &CrcChoice, why: &str) -> Vec<Choice> {
        let life = self.encoder && crc.poly == SAFETY_POLY && self.bits > 2 + LIFE_BITS;
        let Some((fields, doubts)) = self.fields(life) else {
            return Vec::new();
        };
        let lifeless = life.then(|| self.fields(false)).flatten();
        let choice = Choice {
            text: format!("{fields},{crc}"),
            lifeless: lifeless.map(|(fields, _)| format!("{fields},{crc}")),
            why: format!("{why}, {}", crc.why),
            doubts,
        };
        let mut found = Vec::new();
        // Leading zeros change a CRC only if it starts with something else than 0.
        if self.stop && crc.start == 0 {
            found.push(Choice {
                text: format!("pad1,{}", choice.text),
                doubts: vec![STOP],
                ..choice.clone()
            });
        }
        found.push(choice);
        found.retain(|choice| choice.text.parse::<Format>().is_ok());
        found
    }
}

/// A CRC that a channel may have.
#[derive(Clone, Debug, PartialEq, Eq)]
struct CrcChoice {
    poly: u32,
    start: u32,
    why: String,
}

impl std::fmt::Display for CrcChoice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "crc{}:{:#X}", degree(self.poly), self.poly)?;
        match self.start {
            0 => Ok(()),
            start => write!(f, ":init={start:#X}"),
        }
    }
}

/// A channel of an EDS with all that it might be. Polynomials of the profile EDS come first, then those of the EDS, then
/// what goes with the profile.
fn eds_choices(
    channel: &EdsChannel,
    bp: Profile,
    profile: Option<&ProfileEds>,
    unless_known: Convention,
) -> Vec<Choice> {
    let kind = profile.and_then(|profile| profile.encoder);
    let content = Content {
        bits: channel.data_bits,
        profile,
        encoder: !channel.actuator
            && (bp.is_encoder() || kind.is_some() && !matches!(bp, Profile::Universal { .. })),
        stop: channel.actuator && channel.leading_stop,
        left: channel.left_aligned,
    };
    let crcs = eds_crcs(channel, bp, profile, unless_known, content.encoder);
    let bits = channel.data_bits;
    let plural = if bits == 1 { "" } else { "s" };
    let why = format!("EDS: {bits} bit{plural}");
    let mut choices: Vec<Choice> = Vec::new();
    for choice in crcs.iter().flat_map(|crc| content.with(crc, &why)) {
        if choices.iter().all(|have| have.text != choice.text) {
            choices.push(choice);
        }
    }
    if crcs.is_empty() && !content.encoder {
        choices.push(Choice {
            text: format!("data{bits}"),
            lifeless: None,
            why: format!("{why}, no CRC"),
            doubts: vec!["without a CRC nothing shows whether it is right"],
        });
    }
    choices
}

fn eds_crcs(
    channel: &EdsChannel,
    bp: Profile,
    profile: Option<&ProfileEds>,
    unless_known: Convention,
    encoder: bool,
) -> Vec<CrcChoice> {
    let mut polys: Vec<(u32, String)> = Vec::new();
    let stored = profile.and_then(|profile| profile.poly).unwrap_or(0);
    for (poly, low_first) in wide_ordered(stored, unless_known) {
        let order = if low_first { ", low byte first" } else { "" };
        polys.push((
            poly,
            format!("profile EDS: {}{order}", read_as(stored, poly)),
        ));
    }
    let cpoly = u32::from(channel.cpoly);
    for poly in ordered(cpoly, unless_known) {
        polys.push((poly, read_as(cpoly, poly)));
    }
    if let (Some(poly), Some(name)) = (bp.poly(), bp.name()) {
        polys.push((poly, format!("CRC {poly:#X} of {name}")));
    } else if encoder {
        polys.push((ENCODER_POLY, format!("CRC {ENCODER_POLY:#X} of encoders")));
    }
    // 8 bits cannot hold the safety polynomial: these are what is left of it, in either reading.
    if encoder && matches!(cpoly, 0x00 | 0xD9 | 0x6C) {
        polys.push((SAFETY_POLY, format!("CRC {SAFETY_POLY:#X} of BP3S")));
    }
    let starts = starts(profile);
    let all = polys.iter().flat_map(|(poly, why)| {
        let fits = starts.iter().filter(|start| **start < 1 << degree(*poly));
        fits.map(move |start| CrcChoice {
            poly: *poly,
            start: *start,
            why: match start {
                0 => why.clone(),
                start => format!("{why}, CSTART {start:#X}"),
            },
        })
    });
    all.collect()
}

fn read_as(stored: u32, poly: u32) -> String {
    if stored == poly {
        format!("CPOLY {stored:#X}")
    } else {
        format!("CPOLY {stored:#X} read as {poly:#X}")
    }
}

/// Start values to try: the device's own, then the usual 0.
fn starts(profile: Option<&ProfileEds>) -> Vec<u32> {
    let stored = profile.and_then(|profile| profile.start).unwrap_or(0);
    let start = if stored > 0xFFFF {
        stored.swap_bytes()
    } else {
        stored
    };
    match start {
        0 => vec![0],
        start => vec![start, 0],
    }
}

/// MT and ST of CPW and SPW in the profiles of the BiSS Safety Concept A5, Table 1 (p. 4): RXM RXH RSM RSH RLM RLH RUM RUH.
const SAFETY_PAIRS: [[u8; 4]; 8] = [
    [0, 16, 0, 12],
    [0, 24, 0, 16],
    [12, 16, 12, 12],
    [12, 24, 12, 16],
    [24, 16, 24, 12],
    [24, 24, 24, 16],
    [12, 16, 0, 12],
    [12, 24, 0, 16],
];

/// The channels of a slave ID as its BP_ID says them, each way they might be; none where it says nothing.
fn profile_arrangements(device: &Device, alone: bool) -> Vec<Arrangement> {
    let (id, bp) = (device.slave, device.profile);
    let number = device.field(0x42).and_then(|field| field.value);
    let name = bp.name().unwrap_or_default();
    let Some(bits) = bp.data_bits() else {
        return Vec::new();
    };
    let plural = if bits == 1 { "" } else { "s" };
    let why = format!(
        "BP_ID {:#06X}: {name}, {bits} bit{plural}",
        number.unwrap_or(0)
    );
    let content = |bits, encoder| Content {
        bits,
        profile: None,
        encoder,
        stop: false,
        left: false,
    };
    let own = |poly: u32| CrcChoice {
        poly,
        start: 0,
        why: format!("its CRC {poly:#X}"),
    };
    let channel = |bits, poly| content(bits, bp.is_encoder()).with(&own(poly), &why);
    let one = |choices: Vec<Choice>| vec![(id, choices)];
    match bp {
        Profile::Universal { data_bits: 0, .. } => vec![Vec::new()],
        Profile::Universal { .. } => vec![one(channel(bits, 0x25))],
        Profile::EncoderVariant { variant, .. } if variant_bits(variant).is_some() => {
            let mut choices = channel(bits, ENCODER_POLY);
            for choice in &mut choices {
                choice.doubts = vec![BP1, ROTARY];
            }
            vec![one(choices)]
        }
        Profile::Encoder { .. } => {
            let mut choices = channel(bits, ENCODER_POLY);
            // iC-MHM and iC-MR can be told to send the longer CRC.
            choices.extend(channel(bits, SAFETY_POLY));
            vec![one(choices)]
        }
        Profile::Safety { .. } => safety_arrangements(id, bits, alone, &why),
        _ => Vec::new(),
    }
}

/// A safety encoder sends two words, CPW and SPW. Which of them BP_ID describes, and whether they share a slave ID, is not
/// published: alone on the bus it must send both.
fn safety_arrangements(id: u8, bits: u8, alone: bool, why: &str) -> Vec<Arrangement> {
    let word = |text: String, doubts: &[&'static str]| {
        let doubts = doubts.to_vec();
        let why = format!("{why}, CPW and SPW");
        let choice = Choice {
            text,
            lifeless: None,
            why,
            doubts,
        };
        (id, vec![choice])
    };
    let cpw = |turns, position| word(format!("{}nE,nW,crc6", split(turns, position)), &[]);
    let spw = |turns, position| word(format!("{}nE,nW,lc6,crc16", split(turns, position)), &[]);
    let mut pairs: Vec<Arrangement> = Vec::new();
    for flags in [2 + LIFE_BITS, 2] {
        if let Some(position) = bits.checked_sub(flags).filter(|bits| *bits > 0) {
            let mut pair = vec![cpw(0, position), spw(0, position)];
            pair.iter_mut()
                .flat_map(|(_, choices)| choices)
                .for_each(|choice| choice.doubts = vec![SPLIT, ROTARY]);
            pairs.push(pair);
        }
    }
    for [cpw_turns, cpw_position, spw_turns, spw_position] in SAFETY_PAIRS {
        let cpw_bits = cpw_turns + cpw_position + 2;
        let spw_bits = spw_turns + spw_position + 2 + LIFE_BITS;
        if [cpw_bits, spw_bits].contains(&bits) {
            pairs.push(vec![
                cpw(cpw_turns, cpw_position),
                spw(spw_turns, spw_position),
            ]);
        }
    }
    let turned: Vec<Arrangement> = pairs
        .iter()
        .map(|pair| pair.iter().rev().cloned().collect())
        .collect();
    let content = Content {
        bits,
        profile: None,
        encoder: true,
        stop: false,
        left: false,
    };
    let own = |poly: u32| CrcChoice {
        poly,
        start: 0,
        why: format!("its CRC {poly:#X}"),
    };
    let mut single = content.with(&own(SAFETY_POLY), why);
    single.extend(content.with(&own(ENCODER_POLY), why));
    let single = vec![vec![(id, single)]];
    if alone {
        [pairs, single, turned].concat()
    } else {
        [single, pairs, turned].concat()
    }
}

/// `mt12,st24,` or `st24,`.
fn split(turns: u8, position: u8) -> String {
    match turns {
        0 => format!("st{position},"),
        _ => format!("mt{turns},st{position},"),
    }
}
