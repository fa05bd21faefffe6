//! VCD (IEEE 1364-2005, clause 18), as PulseView, GTKWave, sigrok-cli and HDL simulators write it.
//!
//! More is read than the standard has, because users bring it: names with spaces (PulseView's channels), commands in the
//! header that it does not know (`$attrbegin` of GTKWave's converters), the levels `h` and `l`, and `u` and `-` for
//! neither, as libsigrok's `src/input/vcd.c` does.

mod header;

use super::source::{Channel, Damage, Source};
use super::text::{SLACK, Text, all_eight, digits, load};
use crate::slice::Slicer;
use header::Header;
use std::io::Read;

/// Text that begins as a VCD does.
pub(super) fn looks_like(head: &[u8]) -> bool {
    let head = head.strip_prefix(BOM).unwrap_or(head).trim_ascii_start();
    head.first() == Some(&b'$') && head.get(1).is_some_and(u8::is_ascii_lowercase)
}

const BOM: &[u8] = b"\xef\xbb\xbf";

/// A VCD file.
pub(super) struct Vcd {
    text: Text,
    channels: Vec<Channel>,
    /// By [`Channel::id`].
    wires: Vec<Wire>,
    vectors: Vec<Vector>,
    /// Channels that had an index in the header.
    indexed: Vec<(usize, i64)>,
    state: State,
}

/// How far the changes have been understood.
struct State {
    ma: Wanted,
    slo: Wanted,
    wave: Wave,
    pending: Pending,
    /// Inside `$dumpvars` or one of its kind.
    dump: bool,
    /// Identifier codes of strings.
    strings: Vec<String>,
}

/// One bit of what an identifier code stands for; the lowest is 0.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Wire {
    code: String,
    bit: usize,
}

/// More than one bit under one name.
#[derive(Debug)]
struct Vector {
    name: String,
    path: String,
    code: String,
    /// As in `[7:0]`.
    left: i64,
    right: i64,
}

/// What a command that is spread over several words still waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pending {
    Nothing,
    /// The identifier code of a change, with what MA and SLO are if it is theirs.
    Code(Option<bool>, Option<bool>),
    /// The identifier code of a change that is no level.
    NoLevel,
    /// The same after an empty string, which must not swallow anything else.
    Empty,
    /// `$end`.
    Comment,
}

impl Vcd {
    /// Reads the header.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(super) fn open(input: impl Read + 'static) -> Result<Vcd, String> {
        let mut text = Text::new(input);
        let mut header = Header::new(&mut text);
        let read = header.read();
        let at = header.word_at;
        let header = match read {
            Ok(()) => header.found,
            Err(said) => return Err(format!("line {}: {said}", text.line(at))),
        };
        let tick_fs = header.tick_fs.ok_or("it has no $timescale")?;
        Ok(Vcd {
            text,
            channels: header.channels,
            wires: header.wires,
            vectors: header.vectors,
            indexed: header.indexed,
            state: State {
                ma: Wanted::default(),
                slo: Wanted::default(),
                wave: Wave::new(Scale::of(tick_fs)),
                pending: Pending::Nothing,
                dump: false,
                strings: header.strings,
            },
        })
    }
}

impl Source for Vcd {
    fn channels(&self) -> &[Channel] {
        &self.channels
    }

    fn named(&mut self, name: &str) -> Vec<Channel> {
        let mut found: Vec<Channel> = Vec::new();
        let bit = name
            .strip_suffix(']')
            .and_then(|name| name.rsplit_once('['));
        if let Some((base, bit)) = bit.and_then(|(base, bit)| Some((base, bit.parse().ok()?))) {
            let same = |name: &str, path: &str| base.trim_end() == name || base.trim_end() == path;
            for (index, of) in &self.indexed {
                let channel = &self.channels[*index];
                if *of == bit && same(&channel.name, &channel.path) {
                    found.push(channel.clone());
                }
            }
            for vector in self.vectors.iter().filter(|v| same(&v.name, &v.path)) {
                let Some(place) = vector.place(bit) else {
                    continue;
                };
                let wire = Wire {
                    code: vector.code.clone(),
                    bit: place,
                };
                let known = self.wires.iter().position(|known| *known == wire);
                let id = known.unwrap_or(self.wires.len());
                if known.is_none() {
                    self.wires.push(wire);
                }
                found.push(Channel {
                    name: format!("{}[{bit}]", vector.name),
                    path: format!("{}[{bit}]", vector.path),
                    id,
                });
            }
        }
        found
    }

    fn select(&mut self, ma: usize, slo: usize) {
        let wanted = |id: usize| self.wires.get(id).map(Wanted::of).unwrap_or_default();
        (self.state.ma, self.state.slo) = (wanted(ma), wanted(slo));
    }

    fn read(&mut self, slicer: &mut Slicer) -> Result<bool, Damage> {
        let more = self.text.more("a word", is_space);
        let scanned = match more {
            Ok(true) => self.scan(slicer),
            Ok(false) if self.state.pending != Pending::Nothing => {
                let what = match self.state.pending {
                    Pending::Comment => "in a command without `$end`",
                    _ => "inside a change",
                };
                Err((self.text.at.saturating_sub(1), format!("it ends {what}")))
            }
            Ok(false) => Ok(()),
            Err(ref said) => Err((self.text.at, said.clone())),
        };
        let damage = scanned.map_err(|(at, said)| self.text.damage(at, said));
        if damage.is_err() || more == Ok(false) {
            self.state.wave.flush(slicer);
        } else {
            self.state.wave.stand(slicer);
        }
        damage.map(|()| more == Ok(true))
    }

    fn now_ns(&self) -> u64 {
        self.state.wave.scale.ns(self.state.wave.tick)
    }
}

/// What is wrong, and with which byte of the window.
type Wrong = (usize, String);

impl Vcd {
    /// Takes everything that has come.
    fn scan(&mut self, slicer: &mut Slicer) -> Result<(), Wrong> {
        let (text, state) = (self.text.window(), &mut self.state);
        let (mut at, end) = (self.text.at, self.text.len());
        while at < end {
            at = state.hurry(text, at, end, slicer);
            if at < end {
                at = state.step(text, at, slicer)?;
            }
        }
        self.text.at = at;
        Ok(())
    }
}

impl State {
    /// Takes what nearly all of a recording is made of, up to the end or to something else.
    fn hurry(&mut self, text: &[u8], at: usize, end: usize, slicer: &mut Slicer) -> usize {
        let (ma, slo) = (&self.ma, &self.slo);
        let bits = ma.bit | slo.bit > 0 || ma.code == slo.code;
        if bits || self.pending != Pending::Nothing {
            return at;
        }
        match (ma.len, slo.len) {
            (1, 1) => self.hurry_with::<1>(text, at, end, slicer),
            (2, 2) => self.hurry_with::<2>(text, at, end, slicer),
            (3, 3) => self.hurry_with::<3>(text, at, end, slicer),
            (4, 4) => self.hurry_with::<4>(text, at, end, slicer),
            (1..=4, 1..=4) => self.hurry_with::<0>(text, at, end, slicer),
            _ => at,
        }
    }

    /// Times that go on, and changes of single bits. Identifier codes have `LEN` characters, or any number up to four when it
    /// is 0. It is fast as the place of the next word follows from branches, which a processor guesses, and not from
    /// computed numbers.
    #[inline(always)]
    fn hurry_with<const LEN: usize>(
        &mut self,
        text: &[u8],
        mut at: usize,
        end: usize,
        slicer: &mut Slicer,
    ) -> usize {
        let (ma, slo, mut wave) = (&self.ma, &self.slo, self.wave);
        let mask = |wanted: &Wanted| {
            if LEN == 0 {
                wanted.mask
            } else {
                (1 << (8 * LEN)) - 1
            }
        };
        let len = |wanted: &Wanted| if LEN == 0 { wanted.len } else { LEN };
        while at < end {
            let Some(line) = text
                .get(at..at + SLACK)
                .and_then(|l| <&[u8; SLACK]>::try_from(l).ok())
            else {
                break;
            };
            let byte = line[0];
            if byte == b'#' {
                let (mut tick, mut place) = all_eight(line, 1).map_or((0, 1), |tick| (tick, 9));
                let next = loop {
                    let byte = line[place % SLACK];
                    let digit = byte.wrapping_sub(b'0');
                    if digit > 9 || place > 19 {
                        break byte;
                    }
                    tick = tick * 10 + u64::from(digit);
                    place += 1;
                };
                if tick <= wave.tick || !is_space(next) {
                    break;
                }
                wave.flush(slicer);
                wave.tick = tick;
                at += place + 1;
            } else if byte | 1 == b'1' {
                let level = Some(byte == b'1');
                let code = load(line, 1);
                if code & mask(ma) == ma.code && is_space(line[1 + len(ma)]) {
                    if wave.moved && wave.ma != level {
                        break;
                    }
                    wave.ma_changes(level);
                    at += 2 + len(ma);
                } else if code & mask(slo) == slo.code && is_space(line[1 + len(slo)]) {
                    wave.slo_changes(level);
                    at += 2 + len(slo);
                } else {
                    let mut next = at + 1;
                    while KIND[usize::from(text[next])] & CODE != 0 {
                        next += 1;
                    }
                    if next == at + 1 || !is_space(text[next]) {
                        break;
                    }
                    at = next + 1;
                }
            } else if is_space(byte) {
                at += 1;
            } else {
                break;
            }
        }
        self.wave = wave;
        at
    }

    /// Takes a word, or part of a command.
    fn step(&mut self, text: &[u8], mut at: usize, slicer: &mut Slicer) -> Result<usize, Wrong> {
        let (ma, slo, wave) = (&self.ma, &self.slo, &mut self.wave);
        let byte = text[at];
        if is_space(byte) {
            return Ok(at + 1);
        }
        match self.pending {
            Pending::Nothing => {}
            Pending::Code(of_ma, of_slo) => {
                let next = code_end(text, at)?;
                wave.change(ma.is(text, at), of_ma, slo.is(text, at), of_slo)
                    .map_err(|said| (at, said.to_owned()))?;
                self.pending = Pending::Nothing;
                return Ok(next);
            }
            Pending::Empty => {
                let next = code_end(text, at)?;
                if !self.strings.iter().any(|s| s.as_bytes() == &text[at..next]) {
                    return Err((at, format!("{} is no string", word(text, at))));
                }
                self.pending = Pending::Nothing;
                return Ok(next);
            }
            Pending::NoLevel => {
                self.pending = Pending::Nothing;
                return code_end(text, at);
            }
            Pending::Comment => {
                let next = word_end(text, at);
                if is_end(&text[at..next]).map_err(|said| (at, said))? {
                    self.pending = Pending::Nothing;
                }
                return Ok(next);
            }
        }
        match byte {
            b'#' => {
                let (tick, n) = digits(text, at + 1)
                    .ok_or_else(|| (at, format!("the time {} is too large", word(text, at))))?;
                let next = at + 1 + n;
                if n == 0 || !is_space(text[next]) {
                    return Err((at, format!("{} is no time", word(text, at))));
                }
                if tick != wave.tick {
                    wave.goes_to(tick, slicer)
                        .map_err(|said| (at, said.to_owned()))?;
                }
                at = next + 1;
            }
            _ if KIND[usize::from(byte)] & LEVEL != 0 => {
                let value = [byte];
                let (of_ma, of_slo) = (ma.level(&value), slo.level(&value));
                if is_space(text[at + 1]) {
                    self.pending = Pending::Code(of_ma, of_slo);
                    at += 1;
                } else {
                    let next = code_end(text, at + 1)?;
                    let (to_ma, to_slo) = (ma.is(text, at + 1), slo.is(text, at + 1));
                    wave.change(to_ma, of_ma, to_slo, of_slo)
                        .map_err(|said| (at, said.to_owned()))?;
                    at = next;
                }
            }
            b'b' | b'B' => {
                let mut next = at + 1;
                while KIND[usize::from(text[next])] & LEVEL != 0 {
                    next += 1;
                }
                let value = &text[at + 1..next];
                if value.is_empty() || !is_space(text[next]) {
                    return Err((at, format!("{} is no vector", word(text, at))));
                }
                self.pending = Pending::Code(ma.level(value), slo.level(value));
                at = next + 1;
            }
            b'r' | b'R' if !is_space(text[at + 1]) => {
                self.pending = Pending::NoLevel;
                at = word_end(text, at);
            }
            b's' | b'S' => {
                let empty = is_space(text[at + 1]);
                self.pending = if empty {
                    Pending::Empty
                } else {
                    Pending::NoLevel
                };
                at = word_end(text, at);
            }
            b'$' => {
                let next = word_end(text, at);
                match &text[at..next] {
                    b"$comment" | b"$date" | b"$version" => self.pending = Pending::Comment,
                    b"$dumpvars" | b"$dumpall" | b"$dumpon" | b"$dumpoff" => self.dump = true,
                    b"$end" if self.dump => self.dump = false,
                    b"$end" => return Err((at, "`$end` of nothing".to_owned())),
                    _ => {
                        let said = format!("{} has no place here", word(text, at));
                        return Err((at, said));
                    }
                }
                at = next;
            }
            _ => return Err((at, format!("{} is no VCD", word(text, at)))),
        }
        Ok(at)
    }
}

/// What a byte can be: `!` to `~`, of which identifier codes are made.
const CODE: u8 = 1;
const LEVEL: u8 = 2;

const KIND: [u8; 256] = {
    let mut kind = [0; 256];
    let mut byte = b'!';
    while byte <= b'~' {
        kind[byte as usize] = CODE;
        byte += 1;
    }
    let levels = b"01xXzZhHlLuU-";
    let mut at = 0;
    while at < levels.len() {
        kind[levels[at] as usize] |= LEVEL;
        at += 1;
    }
    kind
};

#[inline(always)]
fn is_space(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | b'\r' | b'\n')
}

#[inline(always)]
fn level(byte: u8) -> Option<bool> {
    match byte {
        b'0' | b'l' | b'L' => Some(false),
        b'1' | b'h' | b'H' => Some(true),
        _ => None,
    }
}

/// Behind a word of any bytes.
fn word_end(text: &[u8], at: usize) -> usize {
    let rest = &text[at..];
    at + rest.iter().position(|b| is_space(*b)).unwrap_or(rest.len())
}

/// Whether a comment ends with this word, as it may with no space before `$end`. Behind it there must be one: nobody knows
/// what would be swallowed otherwise.
fn is_end(word: &[u8]) -> Result<bool, String> {
    match word.windows(4).position(|four| four == b"$end") {
        None => Ok(false),
        Some(at) if at + 4 == word.len() => Ok(true),
        Some(_) => Err(format!("`$end` inside `{}`", word.escape_ascii())),
    }
}

/// Behind an identifier code.
#[inline(always)]
fn code_end(text: &[u8], at: usize) -> Result<usize, Wrong> {
    let mut next = at;
    while KIND[usize::from(text[next])] & CODE != 0 {
        next += 1;
    }
    if next == at || !is_space(text[next]) {
        return Err((at, format!("{} is no identifier code", word(text, at))));
    }
    Ok(next)
}

/// A word, for a message.
#[cold]
fn word(text: &[u8], at: usize) -> String {
    let word = &text[at..word_end(text, at)];
    let more = if word.len() > 24 { "…" } else { "" };
    format!("`{}{more}`", word[..word.len().min(24)].escape_ascii())
}

/// A signal whose changes are looked for.
#[derive(Default)]
struct Wanted {
    /// The identifier code, lowest byte first, when it has no more than seven.
    code: u64,
    mask: u64,
    len: usize,
    /// The identifier code when it is longer.
    long: Vec<u8>,
    bit: usize,
}

impl Wanted {
    fn of(wire: &Wire) -> Wanted {
        let bytes = wire.code.as_bytes();
        let mut wanted = Wanted {
            len: bytes.len(),
            bit: wire.bit,
            ..Wanted::default()
        };
        if bytes.len() < 8 {
            let mut word = [0; 8];
            word[..bytes.len()].copy_from_slice(bytes);
            wanted.code = u64::from_le_bytes(word);
            wanted.mask = (1 << (8 * bytes.len())) - 1;
        } else {
            wanted.long = bytes.to_vec();
        }
        wanted
    }

    /// Whether this identifier code stands there.
    #[inline(always)]
    fn is(&self, text: &[u8], at: usize) -> bool {
        if self.mask == 0 {
            return self.is_long(text, at);
        }
        load(text, at) & self.mask == self.code && is_space(text[at + self.len])
    }

    #[cold]
    fn is_long(&self, text: &[u8], at: usize) -> bool {
        self.len > 0
            && text[at..].starts_with(&self.long)
            && text.get(at + self.len).copied().is_some_and(is_space)
    }

    /// The level of its bit in the value of a vector, the highest bit first. Left of what is written stands 0, or what is
    /// neither 0 nor 1 once more (IEEE 1364-2005, table 18-7).
    #[inline(always)]
    fn level(&self, value: &[u8]) -> Option<bool> {
        match value.len().checked_sub(self.bit + 1) {
            Some(place) => level(value[place]),
            None => value.first().copied().and_then(level).map(|_| false),
        }
    }
}

const TWICE: &str = "MA changes twice within one tick: the time scale is too coarse for it";

/// The levels from `tick` on, to be handed on when the next time comes.
#[derive(Clone, Copy)]
struct Wave {
    scale: Scale,
    tick: u64,
    ma: Option<bool>,
    slo: Option<bool>,
    changed: bool,
    /// MA has changed in this tick.
    moved: bool,
}

impl Wave {
    fn new(scale: Scale) -> Wave {
        Wave {
            scale,
            tick: 0,
            ma: None,
            slo: None,
            changed: false,
            moved: false,
        }
    }

    #[inline(always)]
    fn goes_to(&mut self, tick: u64, slicer: &mut Slicer) -> Result<(), &'static str> {
        self.flush(slicer);
        if tick < self.tick {
            return Err("time goes backwards");
        }
        self.tick = tick;
        Ok(())
    }

    /// Hands on the levels of the tick that is over, if they are others.
    #[inline(always)]
    fn flush(&mut self, slicer: &mut Slicer) {
        if self.changed {
            (self.changed, self.moved) = (false, false);
            self.push(slicer);
        }
    }

    /// Time may have gone on without a change.
    fn stand(&self, slicer: &mut Slicer) {
        if !self.changed && self.ma.is_some() {
            self.push(slicer);
        }
    }

    #[inline(always)]
    fn push(&self, slicer: &mut Slicer) {
        let t_ns = self.scale.ns(self.tick);
        match self.ma {
            Some(ma) => slicer.push(t_ns, ma, self.slo),
            // Before MA is known there is nothing to time, and no edge can be told after it was lost.
            None => slicer.gap(t_ns),
        }
    }

    fn change(
        &mut self,
        to_ma: bool,
        of_ma: Option<bool>,
        to_slo: bool,
        of_slo: Option<bool>,
    ) -> Result<(), &'static str> {
        if to_slo {
            self.slo_changes(of_slo);
        }
        if to_ma && self.ma_changes(of_ma) {
            return Err(TWICE);
        }
        Ok(())
    }

    #[inline(always)]
    fn slo_changes(&mut self, level: Option<bool>) {
        self.changed |= level != self.slo;
        self.slo = level;
    }

    /// True when there is more than one change in a tick, of which nobody knows how long the level between them was. What
    /// MA was before it was known is none.
    #[inline(always)]
    fn ma_changes(&mut self, level: Option<bool>) -> bool {
        if level == self.ma {
            return false;
        }
        let twice = self.moved && level.is_some();
        self.moved |= self.ma.is_some();
        self.changed = true;
        self.ma = level;
        twice
    }
}

/// From ticks to nanoseconds, rounded down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Scale {
    /// So many nanoseconds.
    Times(u64),
    /// The so manieth part of one.
    Part(u64),
    /// So many femtoseconds: neither.
    Fs(u64),
}

const NS_FS: u64 = 1_000_000;

impl Scale {
    fn of(tick_fs: u64) -> Scale {
        match tick_fs {
            fs if fs % NS_FS == 0 => Scale::Times(fs / NS_FS),
            fs if NS_FS % fs == 0 => Scale::Part(NS_FS / fs),
            fs => Scale::Fs(fs),
        }
    }

    #[inline(always)]
    fn ns(self, tick: u64) -> u64 {
        match self {
            Scale::Times(1) => tick,
            Scale::Times(n) => tick.saturating_mul(n),
            // Divided by a constant is multiplied.
            Scale::Part(1_000) => tick / 1_000,
            Scale::Part(10_000) => tick / 10_000,
            Scale::Part(100_000) => tick / 100_000,
            Scale::Part(1_000_000) => tick / 1_000_000,
            Scale::Part(n) => tick / n,
            Scale::Fs(fs) => {
                let ns = u128::from(tick) * u128::from(fs) / u128::from(NS_FS);
                u64::try_from(ns).unwrap_or(u64::MAX)
            }
        }
    }
}

impl Vector {
    /// How far from the lowest bit `bit` stands, if there is such a one.
    fn place(&self, bit: i64) -> Option<usize> {
        let within = bit >= self.left.min(self.right) && bit <= self.left.max(self.right);
        within.then(|| usize::try_from(bit.abs_diff(self.right)).ok())?
    }
}
