//! The latest frames that failed, as they were on the wire, and what else they could be.

use crate::crc::Crc;
use crate::format::{Channel, Format, MAX_CHANNELS, MAX_DATA_BITS};
use crate::trace::{Bits, Trace};

/// So many frames are kept.
const KEPT: usize = 32;

/// By how many bits a channel may be longer or shorter than it was said to be.
const WIDER: i16 = 32;

/// Beyond what trying so many formats takes, CRCs must have said so many bits.
const CERTAIN_BITS: u32 = 20;

/// A frame that failed.
#[derive(Clone, Debug)]
pub(super) struct Sample {
    pub(super) idle: Option<bool>,
    pub(super) bits: Bits,
}

impl Sample {
    /// Behind start bit and CDS.
    fn data_at(&self) -> Option<usize> {
        Some(self.start_at()? + 2)
    }

    /// Of Ack and start bit.
    pub(super) fn start_at(&self) -> Option<usize> {
        let ack_at = self.bits.find(1, false)?;
        self.bits.find(ack_at, true)
    }

    /// The same upside down.
    fn inverted(&self) -> Sample {
        let mut bits = Bits::default();
        bits.extend(self.bits.iter().map(|bit| !bit));
        Sample {
            idle: self.idle.map(|level| !level),
            bits,
        }
    }
}

/// The latest frames that failed.
#[derive(Clone, Debug, Default)]
pub(super) struct Samples {
    kept: Vec<Sample>,
    next: usize,
}

impl Samples {
    pub(super) fn add(&mut self, trace: &Trace) {
        let sample = Sample {
            idle: trace.idle,
            bits: trace.bits.clone(),
        };
        match self.kept.get_mut(self.next) {
            Some(oldest) => *oldest = sample,
            None => self.kept.push(sample),
        }
        self.next = (self.next + 1) % KEPT;
    }

    /// The one that was added last.
    pub(super) fn latest(&self) -> Option<&Sample> {
        self.kept.get((self.next + KEPT - 1) % KEPT)
    }

    pub(super) fn len(&self) -> usize {
        self.kept.len()
    }

    /// Whether all are the same from Ack on.
    pub(super) fn alike(&self) -> bool {
        let same = |pair: &[Sample]| pair[0].bits == pair[1].bits;
        self.kept.len() == KEPT && self.kept.windows(2).all(same)
    }

    /// The one other format of which they are good frames, where they say enough for that.
    pub(super) fn fit(&self, format: &Format) -> Option<Format> {
        let tried: Vec<Candidate> = candidates(format).collect();
        let proven = CERTAIN_BITS + tried.len().max(2).ilog2() + 1;
        let fits = |candidate: &&Candidate| self.say(format, candidate) >= proven;
        let fitting: Vec<&Candidate> = tried.iter().filter(fits).collect();
        // With the CRC that was asked for, else with the longest one. Zeros behind a frame may make longer ones of it, so the
        // shortest is meant.
        let asked = fitting.iter().any(|c| c.crc_as_asked);
        let longest = fitting.iter().map(|c| c.crc.bits()).max()?;
        let meant = |c: &&&Candidate| match asked {
            true => c.crc_as_asked,
            false => c.crc.bits() == longest,
        };
        let found = fitting.iter().filter(meant).min_by_key(|c| c.data_bits)?;
        let other = |c: &&Candidate| c.channel != found.channel || c.crc != found.crc;
        if fitting.iter().filter(meant).any(other) {
            return None;
        }
        format.altered(found.channel, found.data_bits, Some(found.crc.clone()))
    }

    /// How many bits the CRCs say for a format; none where more than one frame in ten is none of it. What follows from other
    /// words says nothing more: a CRC is linear.
    fn say(&self, format: &Format, candidate: &Candidate) -> u32 {
        let most = self.kept.len() / 10;
        let (mut misfits, mut spans) = (0, <[Span; MAX_CHANNELS]>::default());
        // What ends in nothing but zeros may end in the stop bit and the clocks behind it: any CRC that is wrong by a constant
        // passes for some longer word.
        let mut ends = !candidate.is_longer(format);
        for sample in &self.kept {
            match candidate.read(format, sample, &mut spans) {
                Read::Cut => {}
                Read::Fits { last } => ends |= last,
                Read::Misfit => misfits += 1,
            }
            if misfits > most {
                return 0;
            }
        }
        if !ends {
            return 0;
        }
        spans.iter().map(Span::says).sum()
    }

    /// Whether they are good frames upside down.
    pub(super) fn fit_inverted(&self, format: &Format) -> bool {
        let upside = Samples {
            kept: self.kept.iter().map(Sample::inverted).collect(),
            next: self.next,
        };
        let Some(candidate) = Candidate::asked(format) else {
            return false;
        };
        upside.say(format, &candidate) >= CERTAIN_BITS
    }
}

/// Another length or CRC of one channel.
struct Candidate {
    channel: usize,
    data_bits: u8,
    crc: Crc,
    crc_as_asked: bool,
}

impl Candidate {
    /// The format as it is.
    fn asked(format: &Format) -> Option<Candidate> {
        let with_crc = |(_, channel): &(usize, &Channel)| channel.crc().is_some();
        let (at, channel) = format.channels().iter().enumerate().find(with_crc)?;
        Some(Candidate {
            channel: at,
            data_bits: channel.data_bits(),
            crc: channel.crc()?.clone(),
            crc_as_asked: true,
        })
    }

    /// Adds the words from this channel on to `spans` if all checks pass.
    fn read(&self, format: &Format, sample: &Sample, spans: &mut [Span; MAX_CHANNELS]) -> Read {
        let bits = &sample.bits;
        let Some(mut at) = sample.data_at() else {
            return Read::Cut;
        };
        let mut words = [0; MAX_CHANNELS];
        for (index, channel) in format.channels().iter().enumerate() {
            let (data_bits, crc) = self.of(index, channel);
            let Some(data) = bits.word(at, usize::from(data_bits)) else {
                return Read::Cut;
            };
            at += usize::from(data_bits);
            let Some(crc) = crc else { continue };
            let Some(got) = bits.word(at, usize::from(crc.bits())) else {
                return Read::Cut;
            };
            at += usize::from(crc.bits());
            if got != u64::from(crc.of(data, data_bits)) {
                return Read::Misfit;
            }
            words[index] = data;
        }
        // Stop, and all surplus clocks.
        match (bits.get(at), bits.find(at, true)) {
            (None, _) => return Read::Cut,
            (_, Some(_)) => return Read::Misfit,
            _ => {}
        }
        let channels = format.channels().iter().enumerate();
        for (index, channel) in channels.skip(self.channel) {
            if let (_, Some(crc)) = self.of(index, channel) {
                spans[index].add(words[index], crc.bits());
            }
        }
        Read::Fits {
            last: bits.get(at - 1) == Some(true),
        }
    }

    /// Whether its frames have more bits than was said.
    fn is_longer(&self, format: &Format) -> bool {
        let bits = |data: u8, crc: u8| u32::from(data) + u32::from(crc);
        format.channels().get(self.channel).is_some_and(|channel| {
            bits(self.data_bits, self.crc.bits()) > bits(channel.data_bits(), channel.crc_bits())
        })
    }

    fn of<'a>(&'a self, index: usize, channel: &'a Channel) -> (u8, Option<&'a Crc>) {
        match index == self.channel {
            true => (self.data_bits, Some(&self.crc)),
            false => (channel.data_bits(), channel.crc()),
        }
    }
}

enum Read {
    Fits {
        /// The last bit of the frame.
        last: bool,
    },
    Misfit,
    /// Too few clocks to tell.
    Cut,
}

/// What exclusive or makes of some words.
#[derive(Clone, Debug, Default)]
struct Span {
    first: Option<u64>,
    /// Differences from the first word, none of which follows from the others.
    basis: Vec<u64>,
    crc_bits: u8,
}

impl Span {
    fn add(&mut self, word: u64, crc_bits: u8) {
        self.crc_bits = crc_bits;
        let first = *self.first.get_or_insert(word);
        let rest = self
            .basis
            .iter()
            .fold(word ^ first, |rest, known| rest.min(rest ^ known));
        if rest != 0 {
            self.basis.push(rest);
        }
    }

    /// Bits of CRC that did not follow from others.
    fn says(&self) -> u32 {
        let words = u32::from(self.first.is_some()) + self.basis.len() as u32;
        words * u32::from(self.crc_bits)
    }
}

/// CRCs that are in use, and their opposites; the one that was asked for first.
fn checks(asked: &Crc) -> Vec<Crc> {
    let mut list = vec![asked.clone()];
    let usual = [3, 4, 5, 6, 7, 8, 16].into_iter().filter_map(Crc::standard);
    let rare = Crc::new(8, 0x197, 0, true).ok();
    for crc in std::iter::once(asked.clone()).chain(usual).chain(rare) {
        for inverted in [true, false] {
            let other = Crc::new(crc.bits(), crc.poly(), crc.init(), inverted);
            list.extend(other.ok().filter(|other| !list.contains(other)));
        }
    }
    list
}

fn candidates(format: &Format) -> impl Iterator<Item = Candidate> {
    let channels = format.channels().iter().enumerate();
    channels.flat_map(|(index, channel)| {
        let asked = channel.crc().cloned();
        let known = asked.as_ref().map(checks).unwrap_or_default();
        known.into_iter().flat_map(move |crc| {
            let asked = asked.clone();
            let bits = i16::from(channel.data_bits());
            (bits - WIDER..=bits + WIDER).filter_map(move |data_bits| {
                let crc_as_asked = asked.as_ref() == Some(&crc);
                let other = !crc_as_asked || data_bits != bits;
                let data_bits = u8::try_from(data_bits).ok()?;
                let fits = data_bits > 0 && u32::from(data_bits) <= MAX_DATA_BITS;
                (fits && other).then(|| Candidate {
                    channel: index,
                    data_bits,
                    crc: crc.clone(),
                    crc_as_asked,
                })
            })
        })
    })
}
