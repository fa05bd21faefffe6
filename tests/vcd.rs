//! The reader of VCD against crate `vcd`, event for event, and against what it must refuse.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;

use fastrand::Rng;
use file::{Failure, ours};
use slice::Event;
use vcd::{Command, IdCode, ParseError, Parser, ReferenceIndex, ScopeItem, Value};

/// The reader, with what it stands on.
#[path = "../src/link/file"]
#[allow(dead_code, private_interfaces, unreachable_pub)]
mod file {
    pub(crate) mod source;
    pub(crate) mod text;
    pub(crate) mod vcd;

    use crate::slice::{Event, Slicer};
    use source::Source;
    use std::io::Read;

    /// What went wrong, or that there is no such signal.
    #[derive(Clone, Debug, PartialEq, Eq)]
    pub(crate) enum Failure {
        NoSignal,
        Said(String),
    }

    fn channel(source: &mut impl Source, name: &str) -> Option<usize> {
        let same = |channel: &&source::Channel| channel.path == name || channel.name == name;
        let listed = source
            .channels()
            .iter()
            .find(same)
            .map(|channel| channel.id);
        listed.or_else(|| source.named(name).first().map(|channel| channel.id))
    }

    /// All events of two signals, and how it ended.
    pub(crate) fn ours(
        input: impl Read + 'static,
        ma: &str,
        slo: &str,
    ) -> (Vec<Event>, Result<u64, Failure>) {
        let mut slicer = Slicer::default();
        let mut source = match vcd::Vcd::open(input) {
            Ok(source) => source,
            Err(said) => return (Vec::new(), Err(Failure::Said(said))),
        };
        let (Some(ma), Some(slo)) = (channel(&mut source, ma), channel(&mut source, slo)) else {
            return (Vec::new(), Err(Failure::NoSignal));
        };
        source.select(ma, slo);
        let end = loop {
            match source.read(&mut slicer) {
                Ok(true) => {}
                Ok(false) => break Ok(source.now_ns()),
                Err(damage) => {
                    break Err(Failure::Said(format!("{}: {}", damage.place, damage.said)));
                }
            }
        };
        (slicer.events(), end)
    }
}

/// Writes down what it is told.
mod slice {
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub(crate) enum Event {
        Push(u64, bool, Option<bool>),
        Gap(u64),
    }

    #[derive(Default)]
    pub(crate) struct Slicer(Vec<Event>);

    impl Slicer {
        pub(crate) fn push(&mut self, t_ns: u64, ma: bool, slo: Option<bool>) {
            self.0.push(Event::Push(t_ns, ma, slo));
        }

        pub(crate) fn gap(&mut self, t_ns: u64) {
            self.0.push(Event::Gap(t_ns));
        }

        /// Without those that change nothing.
        pub(crate) fn events(self) -> Vec<Event> {
            let mut last = None;
            let mut news = |event: &Event| {
                let state = match event {
                    Event::Push(_, ma, slo) => Some((*ma, *slo)),
                    Event::Gap(_) => None,
                };
                std::mem::replace(&mut last, state) != state
            };
            self.0.into_iter().filter(|event| news(event)).collect()
        }
    }
}

/// One bit of a signal, as crate `vcd` names it.
#[derive(Clone, Copy)]
struct Bit(IdCode, usize);

fn find(items: &[ScopeItem], scope: &str, path: &str) -> Option<Bit> {
    items.iter().find_map(|item| match item {
        ScopeItem::Scope(inner) => {
            find(&inner.items, &format!("{scope}{}.", inner.identifier), path)
        }
        ScopeItem::Var(var) => {
            let name = format!("{scope}{}", var.reference);
            let (base, bit) = match path.strip_suffix(']').and_then(|p| p.rsplit_once('[')) {
                Some((base, bit)) => (base, bit.parse::<i64>().ok()),
                None => (path, None),
            };
            match (var.size, bit, var.index) {
                (1, ..) if name == path => Some(Bit(var.code, 0)),
                (2.., Some(bit), Some(ReferenceIndex::Range(left, right))) if name == base => {
                    let (left, right) = (i64::from(left), i64::from(right));
                    let within = (left.min(right)..=left.max(right)).contains(&bit);
                    within.then(|| Bit(var.code, bit.abs_diff(right) as usize))
                }
                _ => None,
            }
        }
        _ => None,
    })
}

/// The same with crate `vcd`, bit by bit and without hurry.
fn theirs(text: &[u8], ma: &str, slo: &str) -> (Vec<Event>, Result<u64, Failure>) {
    let mut text = text.to_vec();
    text.push(b'\n');
    let said = |error: std::io::Error| {
        let parse = error.get_ref().and_then(|e| e.downcast_ref::<ParseError>());
        Failure::Said(parse.map_or(error.to_string(), |e| format!("{:?}", e.kind())))
    };
    let mut parser = Parser::new(&text[..]);
    let header = match parser.parse_header() {
        Ok(header) => header,
        Err(error) => return (Vec::new(), Err(said(error))),
    };
    let Some((count, unit)) = header.timescale else {
        return (Vec::new(), Err(Failure::Said("no time scale".into())));
    };
    let bits = find(&header.items, "", ma).zip(find(&header.items, "", slo));
    let Some((ma_bit, slo_bit)) = bits else {
        return (Vec::new(), Err(Failure::NoSignal));
    };
    let tick_fs = u128::from(count) * u128::from(1_000_000_000_000_000 / unit.divisor());
    let ns = |tick: u64| u64::try_from(u128::from(tick) * tick_fs / 1_000_000).unwrap_or(u64::MAX);
    let level = |value: Option<Value>| match value {
        Some(Value::V0) => Some(false),
        Some(Value::V1) => Some(true),
        _ => None,
    };
    let bit = |values: &[Value], bit: usize| match values.len().checked_sub(bit + 1) {
        Some(at) => level(Some(values[at])),
        None => level(values.first().copied()).map(|_| false),
    };
    let mut slicer = slice::Slicer::default();
    let (mut tick, mut ma, mut slo) = (0, None, None);
    let mut moves = 0;
    let flush = |slicer: &mut slice::Slicer, tick, ma, slo| match ma {
        Some(ma) => slicer.push(ns(tick), ma, slo),
        None => slicer.gap(ns(tick)),
    };
    let end = loop {
        let (code, values) = match parser.next() {
            None => break Ok(ns(tick)),
            Some(Err(error)) => break Err(said(error)),
            Some(Ok(Command::Timestamp(next))) if next == tick => continue,
            Some(Ok(Command::Timestamp(next))) if next < tick => {
                break Err(Failure::Said("backwards".into()));
            }
            Some(Ok(Command::Timestamp(next))) => {
                flush(&mut slicer, tick, ma, slo);
                (tick, moves) = (next, 0);
                continue;
            }
            Some(Ok(Command::ChangeScalar(code, value))) => (code, vec![value]),
            Some(Ok(Command::ChangeVector(code, values))) => {
                (code, values.iter().collect::<Vec<_>>())
            }
            Some(Ok(_)) => continue,
        };
        if values.is_empty() {
            break Err(Failure::Said("empty vector".into()));
        }
        if code == slo_bit.0 {
            slo = bit(&values, slo_bit.1);
        }
        if code == ma_bit.0 {
            let level = bit(&values, ma_bit.1);
            if level != ma {
                let twice = moves > 0 && level.is_some();
                moves += usize::from(ma.is_some());
                ma = level;
                if twice {
                    break Err(Failure::Said("twice".into()));
                }
            }
        }
    };
    flush(&mut slicer, tick, ma, slo);
    (slicer.events(), end)
}

/// A random VCD of the kinds that both readers know.
struct Maker<'a> {
    rng: &'a mut Rng,
    text: Vec<u8>,
    end_of_line: &'static str,
}

struct Made {
    text: Vec<u8>,
    ma: String,
    slo: String,
}

impl Maker<'_> {
    fn say(&mut self, text: &str) {
        self.text.extend_from_slice(text.as_bytes());
    }

    /// What parts two words.
    fn gap(&mut self) {
        let gap = match self.rng.u8(..12) {
            0 => " ",
            1 => "\t",
            2 => "  ",
            3 => "\n\n",
            _ => self.end_of_line,
        };
        self.say(gap);
    }

    fn code(&mut self) -> String {
        let longest = if self.rng.u8(..4) == 0 { 8 } else { 3 };
        let n = self.rng.usize(1..=longest);
        (0..n)
            .map(|_| char::from(self.rng.u8(b'!'..=b'~')))
            .collect()
    }

    fn level(&mut self) -> char {
        *self.rng.choice(b"0101010101xzXZ").unwrap() as char
    }

    fn noise(&mut self) {
        let text = match self.rng.u8(..5) {
            0 => "$comment #5 0! b1 $var $end".into(),
            1 => "$date today $end".into(),
            2 => format!("r{}.5e-3 !!r", self.rng.u16(..)),
            3 => "sidle !!s".into(),
            _ => {
                let kind = *self
                    .rng
                    .choice(&["dumpvars", "dumpall", "dumpon", "dumpoff"])
                    .unwrap();
                format!("${kind} $end")
            }
        };
        self.say(&text);
        self.gap();
    }
}

fn make(rng: &mut Rng) -> Made {
    let end_of_line = if rng.u8(..4) == 0 { "\r\n" } else { "\n" };
    let mut maker = Maker {
        rng,
        text: Vec::new(),
        end_of_line,
    };
    let mut codes: Vec<String> = Vec::new();
    while codes.len() < 5 {
        let code = maker.code();
        if !codes.contains(&code) && code != "!!r" && code != "!!s" {
            codes.push(code);
        }
    }
    let unit = *maker
        .rng
        .choice(&["s", "ms", "us", "ns", "ps", "fs"])
        .unwrap();
    let count = *maker.rng.choice(&["1", "10", "100"]).unwrap();
    let space = if maker.rng.bool() { " " } else { "" };
    maker.say("$version a test $end\n$comment\n two lines\n$end\n");
    maker.say(&format!("$timescale {count}{space}{unit} $end\n"));
    // Both wires alone, both in one vector, or one of each.
    let widths = [maker.rng.usize(2..=40), maker.rng.usize(2..=40)];
    let (mut names, mut places) = (Vec::new(), Vec::new());
    let scopes = maker.rng.usize(0..3);
    for scope in 0..scopes {
        maker.say(&format!("$scope module s{scope} $end\n"));
    }
    let scope: String = (0..scopes).map(|n| format!("s{n}.")).collect();
    for (at, name) in ["ma", "slo"].iter().enumerate() {
        let code = codes[at].clone();
        if maker.rng.u8(..3) > 0 {
            let name = if maker.rng.bool() {
                format!("\\{name}!")
            } else {
                (*name).to_owned()
            };
            let range = *maker.rng.choice(&["", " [0:0]", " [5]"]).unwrap();
            let kind = *maker.rng.choice(&["wire", "reg", "tri1"]).unwrap();
            maker.say(&format!("$var {kind} 1 {code} {name}{range} $end\n"));
            if maker.rng.bool() {
                // The same under another name.
                maker.say(&format!("$var wire 1 {code} alias{at} $end\n"));
            }
            names.push(format!("{scope}{name}"));
            places.push(None);
        } else {
            let width = widths[at] as i64;
            let low = maker.rng.i64(-3..4);
            let (left, right) = match maker.rng.bool() {
                true => (low + width - 1, low),
                false => (low, low + width - 1),
            };
            maker.say(&format!(
                "$var wire {width} {code} {name} [{left}:{right}] $end\n"
            ));
            let bit = maker.rng.i64(low..low + width);
            names.push(format!("{scope}{name}[{bit}]"));
            places.push(Some(width as usize));
        }
    }
    maker.say(&format!("$var wire 1 {} other $end\n", codes[2]));
    maker.say(&format!("$var wire 9 {} wide $end\n", codes[3]));
    maker.say("$var real 64 !!r temperature $end\n$var string 1 !!s state $end\n");
    for _ in 0..scopes {
        maker.say("$upscope $end\n");
    }
    maker.say("$enddefinitions $end\n");
    let mut tick: u64 = if maker.rng.bool() {
        0
    } else {
        maker.rng.u64(..) >> maker.rng.u8(..64)
    };
    for _ in 0..maker.rng.usize(1..150) {
        if maker.rng.u8(..4) > 0 {
            maker.say(&format!("#{tick}"));
            maker.gap();
            let most = 1u64 << maker.rng.u8(..32);
            tick = tick.saturating_add(maker.rng.u64(1..=most));
        }
        for _ in 0..maker.rng.usize(..3) {
            let which = maker.rng.usize(..4);
            let code = codes[which].clone();
            let width = match which {
                0 | 1 => places[which],
                2 => None,
                _ => Some(9),
            };
            match width {
                None if maker.rng.u8(..6) > 0 => {
                    let level = maker.level();
                    maker.say(&format!("{level}{code}"));
                }
                width => {
                    let n = maker.rng.usize(1..=width.unwrap_or(1));
                    let value: String = (0..n).map(|_| maker.level()).collect();
                    let letter = if maker.rng.u8(..4) == 0 { 'B' } else { 'b' };
                    maker.say(&format!("{letter}{value} {code}"));
                }
            }
            maker.gap();
        }
        if maker.rng.u8(..16) == 0 {
            maker.noise();
        }
    }
    if maker.rng.bool() {
        maker.text.truncate(maker.text.trim_ascii_end().len());
    }
    let [ma, slo] = names.try_into().unwrap();
    Made {
        text: maker.text,
        ma,
        slo,
    }
}

/// Gives a few bytes at a time.
struct Dribble(Vec<u8>, usize, Rng);

impl std::io::Read for Dribble {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let left = self.0.len() - self.1;
        let most = [1, 7, 100, 5000][self.2.usize(..4)];
        let n = self.2.usize(1..=most).min(left).min(buffer.len());
        buffer[..n].copy_from_slice(&self.0[self.1..self.1 + n]);
        self.1 += n;
        Ok(n)
    }
}

#[test]
fn equals_the_crate_on_valid_files() {
    let mut rng = common::rng();
    let mut events = 0;
    for _ in 0..common::size(3_000) {
        let made = make(&mut rng);
        let (want, want_end) = theirs(&made.text, &made.ma, &made.slo);
        let input = Dribble(made.text.clone(), 0, rng.fork());
        let (got, end) = ours(input, &made.ma, &made.slo);
        let text = || String::from_utf8_lossy(&made.text).into_owned();
        let same = match (&want_end, &end) {
            (Ok(a), Ok(b)) => a == b,
            (Err(Failure::Said(a)), Err(Failure::Said(b))) => b.contains(a.as_str()),
            _ => false,
        };
        assert!(same, "{want_end:?} {end:?} {}", text());
        assert_eq!(got, want, "{} {} {}", made.ma, made.slo, text());
        events += got.len();
    }
    println!("{events} events");
}

/// Where ours says no and the crate goes on: what would be taken for something that it is not.
const STRICTER: &[&str] = &[
    // The beginning of another file: its codes and its time scale are not the first one's.
    "has no place",
    // A value apart from its letter, a sign.
    "is no time",
    "is no vector",
    "is no VCD",
    // `$end` within a word; a time scale of 0; a command that another one begins in.
    "`$end` inside",
    "is no time scale",
    "without `$end`",
    // `s` alone is an empty string here, and swallows the next word there.
    "is no string",
    "inside a change",
    "is no identifier code",
];

/// Where the crate says no and ours goes on: what other programs write, or what does not concern MA and SLO.
const LENIENT: &[&str] = &[
    "InvalidUtf8",
    "TokenTooLong",
    // In capitals.
    "InvalidTimescaleUnit",
    // Levels `h` and `l`; in the header, commands, types and names that it does not know.
    "UnexpectedCharacter",
    "InvalidValueChar",
    "UnknownCommand",
    "InvalidScopeType",
    "InvalidVarType",
    "InvalidReferenceIndex",
    "ExpectedEndCommand",
    "UnexpectedHeaderCommand",
    "ParseFloatError",
    "TooLong",
    "UnmatchedEnd",
    "unexpected end of VCD file",
    "empty vector",
];

fn mutate(rng: &mut Rng, text: &mut Vec<u8>) {
    for _ in 0..rng.usize(1..4) {
        let at = rng.usize(..text.len().max(1));
        if text.is_empty() {
            return;
        }
        match rng.u8(..6) {
            0 => text[at] = rng.u8(..),
            1 => text[at] = *rng.choice(b"01xzb#$ \n\"!-hr[]:").unwrap(),
            2 => drop(text.remove(at)),
            3 => text.insert(at, *rng.choice(b"01xzb#$ \n\"!-hr[]:").unwrap()),
            4 => text.truncate(at),
            _ => {
                let end = (at + rng.usize(1..30)).min(text.len());
                let piece = text[at..end].to_vec();
                let to = rng.usize(..text.len());
                text.splice(to..to, piece);
            }
        }
    }
}

#[test]
fn damaged_files_are_refused_or_read_as_the_crate_does() {
    let mut rng = common::rng();
    let (mut agreed, mut refused, mut apart) = (0, 0, 0);
    for _ in 0..common::size(10_000) {
        let mut made = make(&mut rng);
        mutate(&mut rng, &mut made.text);
        let (want, want_end) = theirs(&made.text, &made.ma, &made.slo);
        let input = Dribble(made.text.clone(), 0, rng.fork());
        let (got, end) = ours(input, &made.ma, &made.slo);
        let text = || String::from_utf8_lossy(&made.text).into_owned();
        match (&want_end, &end) {
            (Ok(_), Ok(_)) => {
                agreed += 1;
                assert_eq!((&got, &end), (&want, &want_end), "{}", text());
            }
            (Err(Failure::NoSignal), _) | (_, Err(Failure::NoSignal)) => continue,
            (Err(_), Err(_)) => refused += 1,
            (Ok(_), Err(Failure::Said(said))) => {
                apart += 1;
                let known = STRICTER.iter().any(|known| said.contains(known));
                assert!(known, "only ours: {said} {}", text());
            }
            (Err(Failure::Said(said)), Ok(_)) => {
                apart += 1;
                let known = LENIENT.iter().any(|known| said.contains(known));
                assert!(known, "only theirs: {said} {}", text());
            }
        }
        // Up to the place where one of them stopped, and the tick in which that was, they agree.
        let n = got.len().min(want.len());
        let n = n.saturating_sub(usize::from(want_end.is_err() || end.is_err()));
        assert_eq!(got[..n], want[..n], "{want_end:?} {end:?} {}", text());
    }
    println!("{agreed} read, {refused} refused by both, {apart} by one");
}

const BODY: &str = "#0 1! 1\" #5 0! #7 1! 0\"";

fn with(header: &str, body: &str) -> Vec<u8> {
    format!("{header} $enddefinitions $end {body}").into_bytes()
}

fn read(text: Vec<u8>, ma: &str, slo: &str) -> Result<Vec<Event>, String> {
    let (events, end) = ours(std::io::Cursor::new(text), ma, slo);
    match end {
        Ok(_) => Ok(events),
        Err(Failure::NoSignal) => Err("no such signal".into()),
        Err(Failure::Said(said)) => Err(said),
    }
}

fn plain() -> Vec<Event> {
    vec![
        Event::Push(0, true, Some(true)),
        Event::Push(5, false, Some(true)),
        Event::Push(7, true, Some(false)),
    ]
}

#[test]
fn names_are_those_of_the_file() {
    let wires = |ma: &str, slo: &str| {
        let header =
            format!("$timescale 1ns $end $var wire 1 ! {ma} $end $var wire 1 \" {slo} $end");
        with(&header, BODY)
    };
    for (written, named) in [
        ("ma", "ma"),
        ("SPI CLK 2", "SPI CLK 2"),
        ("\\ma+", "\\ma+"),
        ("ma [0:0]", "ma"),
        ("ma [3]", "ma"),
        ("ma [3]", "ma[3]"),
        ("bus[3]", "bus[3]"),
        ("a[1] b", "a[1] b"),
        ("caf\u{e9}", "caf\u{e9}"),
    ] {
        assert_eq!(
            read(wires(written, "slo"), named, "slo"),
            Ok(plain()),
            "{written}"
        );
    }
    // A vector that is written bit by bit.
    let apart = wires("bus [3]", "bus [4]");
    assert_eq!(read(apart.clone(), "bus[3]", "bus[4]"), Ok(plain()));
    assert_eq!(read(apart, "bus", "bus[4]"), Err("no such signal".into()));
    let scoped = with(
        "$timescale 1ns $end $attrbegin misc 02 bits $end $scope interface top level $end $scope $end \
         $var wire 1 ! ma $end $upscope $end $var wire 1 \" ma $end $upscope $end",
        BODY,
    );
    assert_eq!(read(scoped, "top level..ma", "top level.ma"), Ok(plain()));
}

#[test]
fn bits_of_vectors_are_counted_from_the_right_end() {
    let header = |range: &str| format!("$timescale 1ns $end $var wire 8 ! bus{range} $end");
    // Bit 3 is 1, 0, 1 and bit 0 is 1, 1, 0.
    let body = "#0 b1001 ! #5 b0000001 ! #7 bx0001000 !";
    for (range, ma, slo) in [
        ("[7:0]", "bus[3]", "bus[0]"),
        (" [7:0]", "bus[3]", "bus[0]"),
        (" [0:7]", "bus[4]", "bus[7]"),
        (" [ 2 : -5 ]", "bus[-2]", "bus[-5]"),
        ("", "bus[3]", "bus[0]"),
    ] {
        let text = with(&header(range), body);
        assert_eq!(read(text.clone(), ma, slo), Ok(plain()), "{range}");
        assert_eq!(
            read(text, "bus[8]", slo),
            Err("no such signal".into()),
            "{range}"
        );
    }
    // What is not written is 0, or x as the first one.
    let text = with(&header(""), "#0 b1 ! #5 bx01 ! #7 b1x000000 !");
    let want = [
        Event::Push(0, true, Some(false)),
        Event::Push(5, true, None),
    ];
    assert_eq!(read(text, "bus[0]", "bus[7]").unwrap()[..2], want);
}

#[test]
fn times_are_exact_in_every_scale() {
    let times = |scale: &str, tick: &str| {
        let header =
            format!("$timescale {scale} $end $var wire 1 ! ma $end $var wire 1 \" slo $end");
        let events = read(with(&header, &format!("#{tick} 1! 1\"")), "ma", "slo")?;
        Ok::<_, String>(events[0])
    };
    for (scale, tick, ns) in [
        ("1 ns", "18446744073709551615", u64::MAX),
        ("100ps", "19", 1),
        ("10 ps", "0000000000000000000000000199", 1),
        ("1 ps", "18446744073709551615", 18_446_744_073_709_551),
        ("100 fs", "9999", 0),
        ("10fs", "99999999999", 999_999),
        ("1fs", "123456789012345678", 123_456_789_012),
        ("25 ps", "41", 1),
        ("1 us", "123456789", 123_456_789_000),
        ("100 s", "3", 300_000_000_000),
        ("1 s", "18446744074", u64::MAX),
        ("1\n NS", "12345678", 12_345_678),
    ] {
        assert_eq!(
            times(scale, tick),
            Ok(Event::Push(ns, true, Some(true))),
            "{scale} {tick}"
        );
    }
    for (scale, tick) in [
        ("0 ns", "1"),
        ("ns", "1"),
        ("1 ly", "1"),
        ("1 ns", "18446744073709551616"),
    ] {
        times(scale, tick).unwrap_err();
    }
    let none = with("$var wire 1 ! ma $end $var wire 1 \" slo $end", BODY);
    assert!(read(none, "ma", "slo").unwrap_err().contains("$timescale"));
}

#[test]
fn damage_names_its_line() {
    let header = "$timescale 1ns $end\n$var wire 1 ! ma $end\n$var wire 1 \" slo $end\n";
    for (body, line, what) in [
        ("#5\n1!\n\n#4\n", 7, "backwards"),
        ("#5\n1!\n0!\n1!\n", 7, "twice"),
        ("#5\n$dumpvars 1!\n$end $end", 6, "`$end`"),
        ("#5\n$comment never", 5, "without `$end`"),
        ("#5\nb01", 5, "inside a change"),
        ("#5\n$var wire 1 % x $end", 5, "`$var`"),
        ("#5\n1\u{e9}", 5, "identifier code"),
        ("#5\nwhat?", 5, "`what?`"),
    ] {
        let text = format!("{header}$enddefinitions $end {body}");
        println!("{body:?}");
        let said = read(text.into(), "ma", "slo");
        let said = said.unwrap_err();
        assert!(
            said.contains(&format!("line {line}: ")) && said.contains(what),
            "{body:?}: {said}"
        );
    }
    let deep = "\n".repeat(1_000_000) + "$var wire x ! ma $end";
    let said = read(deep.into_bytes(), "ma", "slo").unwrap_err();
    assert!(said.starts_with("line 1000001: "), "{said}");
}
