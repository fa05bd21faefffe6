//! Encoders by name, as a file has them: `[encoder.spindle]` with its link, frame, clock, and how its position is counted.
//!
//! Texts come in and go out here; who reads files is elsewhere, but for [`save()`].

mod save;

pub use save::save;

use crate::frame::Timeout;
use crate::link::{Kind, Spec};
use crate::measure::{Resolution, Unit, scales};
use crate::parse::{ParseError, nearest};
use crate::place::Zero;
use crate::preset::{Frame, Preset};
use crate::unit::{Hertz, Nanos};
use std::fmt::{self, Display};
use std::ops::Range;
use std::str::FromStr;
use toml_edit::{Document, DocumentMut, Item, Key, Table, TableLike, value};

/// What an encoder sends.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// The slaves' registers shall say it.
    Auto,
    /// As it was written down.
    Given(Frame),
}

impl FromStr for Wanted {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Wanted, ParseError> {
        match text {
            "auto" => Ok(Wanted::Auto),
            _ => text.parse().map(Wanted::Given),
        }
    }
}

impl Display for Wanted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Wanted::Auto => f.write_str("auto"),
            Wanted::Given(frame) => write!(f, "{frame}"),
        }
    }
}

/// An encoder that has a name.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Encoder {
    /// Where it is, as LINK is written.
    pub link: String,
    /// What it sends; none where the link says so, or nobody.
    pub frame: Option<Wanted>,
    /// MA.
    pub clock: Option<Hertz>,
    /// From start to start.
    pub interval: Option<Nanos>,
    /// How it finds the end of a frame.
    pub timeout: Option<Timeout>,
    /// What counts as 0.
    pub zero: Option<Zero>,
    /// Whether it counts the other way.
    pub reverse: bool,
    /// How much a count is.
    pub resolution: Option<Resolution>,
    /// What its position is measured in.
    pub unit: Option<Unit>,
}

/// Keys of `[encoder.NAME]`.
const KEYS: [&str; 10] = [
    "link",
    "frame",
    "preset",
    "clock",
    "interval",
    "timeout",
    "zero",
    "reverse",
    "resolution",
    "unit",
];

/// What a link begins with; no encoder is called so.
const KINDS: [&str; 6] = ["gpio", "spi", "wave", "sim", "file", "exec"];

/// More text is no configuration.
pub const MOST_BYTES: usize = 256 * 1024;

/// More dots in a line are no keys of ours, and tables within tables without end.
const MOST_DOTS: usize = 100;

/// Whether this can be the name of an encoder, which no LINK is taken for.
///
/// # Errors
/// Why it cannot.
pub fn check_name(name: &str) -> Result<(), ParseError> {
    const HINT: &str =
        "a name has letters, digits, -, _ and ., and begins with a letter or a digit";
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    let wrong = |what: &str, hint: &str| Err(ParseError::usage(name, what, hint));
    if !name.chars().all(plain) || !name.starts_with(|c: char| c.is_ascii_alphanumeric()) {
        return wrong("no name for an encoder", HINT);
    }
    match KINDS.iter().find(|kind| name.eq_ignore_ascii_case(kind)) {
        Some(kind) => wrong(
            &format!("`{kind}` is a kind of link, not a name"),
            "take another one",
        ),
        None => Ok(()),
    }
}

impl Encoder {
    /// Where it is, and what it sends there unless `frame` says that somebody else does.
    ///
    /// # Errors
    /// What is wrong with the link.
    pub fn spec(&self, frame: bool) -> Result<Spec, ParseError> {
        match self.frame.as_ref().filter(|_| frame) {
            Some(given @ Wanted::Given(_)) => {
                let mark = if self.link.contains(':') { ',' } else { ':' };
                format!("{}{mark}frame={given}", self.link).parse()
            }
            _ => self.link.parse(),
        }
    }

    /// Its keys and values, in the order in which they are written.
    fn values(&self) -> [(&'static str, Option<Item>); 9] {
        fn text(shown: &impl Display) -> Item {
            value(shown.to_string())
        }
        let zero = self.zero.map(|zero| match zero {
            Zero::At(counts) => i64::try_from(counts).map_or_else(|_| text(&counts), value),
            Zero::Here => value("here"),
        });
        let resolution = self.resolution.map(|resolution| match resolution {
            Resolution::Turn(counts) => i64::try_from(counts).map_or_else(|_| text(&counts), value),
            Resolution::Length { .. } => text(&resolution),
        });
        [
            ("link", Some(value(&self.link))),
            ("frame", self.frame.as_ref().map(text)),
            ("clock", self.clock.as_ref().map(text)),
            ("interval", self.interval.as_ref().map(text)),
            ("timeout", self.timeout.as_ref().map(text)),
            ("zero", zero),
            ("reverse", self.reverse.then(|| value(true))),
            ("resolution", resolution),
            ("unit", self.unit.as_ref().map(text)),
        ]
    }
}

/// What is wrong in a file, and where.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Error {
    line: usize,
    /// The key, with those that it is in.
    key: String,
    what: String,
}

impl Error {
    /// The line, from 1.
    pub fn line(&self) -> usize {
        self.line
    }

    /// The key, with those that it is in; empty where it is none.
    pub fn key(&self) -> &str {
        &self.key
    }
}

/// As it goes behind the name of the file: `7: encoder.spindle.clock: …`.
impl Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: ", self.line)?;
        if !self.key.is_empty() {
            write!(f, "{}: ", self.key)?;
        }
        f.write_str(&self.what)
    }
}

impl std::error::Error for Error {}

/// All encoders of a file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Config {
    encoders: Vec<(String, Encoder)>,
}

impl Config {
    /// Reads the text of a file.
    ///
    /// # Errors
    /// The first thing that is wrong in it.
    pub fn parse(bytes: &[u8]) -> Result<Config, Error> {
        let text = readable(bytes)?;
        let document = Document::parse(text).map_err(|error| unparsed(text, &error))?;
        let reader = Reader { text };
        reader.config(document.as_table())
    }

    /// The names and what they stand for, as they stand in the file.
    pub fn encoders(&self) -> impl Iterator<Item = (&str, &Encoder)> {
        let encoders = self.encoders.iter();
        encoders.map(|(name, encoder)| (name.as_str(), encoder))
    }

    /// The encoder of that name.
    pub fn encoder(&self, name: &str) -> Option<&Encoder> {
        let mut encoders = self.encoders.iter();
        encoders.find(|known| known.0 == name).map(|known| &known.1)
    }
}

/// The text, if it can be one.
fn readable(bytes: &[u8]) -> Result<&str, Error> {
    let wrong = |line: usize, what: String| {
        Err(Error {
            line,
            key: String::new(),
            what,
        })
    };
    if bytes.len() > MOST_BYTES {
        let hint = "is it a configuration at all?";
        return wrong(1, format!("more than {MOST_BYTES} bytes\n  {hint}"));
    }
    let text = match std::str::from_utf8(bytes) {
        Ok(text) => text,
        Err(error) => {
            let before = &bytes[..error.valid_up_to()];
            let line = 1 + before.iter().filter(|byte| **byte == b'\n').count();
            return wrong(line, "no UTF-8\n  a configuration is text".into());
        }
    };
    let dots =
        |line: &str| !line.trim_start().starts_with('#') && line.matches('.').count() > MOST_DOTS;
    match text.lines().position(dots) {
        Some(index) => wrong(index + 1, "tables too deep in each other".into()),
        None => Ok(text),
    }
}

fn line_at(text: &str, at: usize) -> usize {
    let before = text.as_bytes().get(..at).unwrap_or(text.as_bytes());
    1 + before.iter().filter(|byte| **byte == b'\n').count()
}

fn unparsed(text: &str, error: &toml_edit::TomlError) -> Error {
    Error {
        line: line_at(text, error.span().map_or(text.len(), |span| span.start)),
        key: String::new(),
        what: format!(
            "{}\n  the file is TOML: [encoder.NAME], and below it lines such as link = \"spi:0.0\"",
            error.message()
        ),
    }
}

/// Looks at what stands in a file that is TOML.
struct Reader<'a> {
    text: &'a str,
}

/// A value, and where it stands.
struct Entry<'a> {
    /// Of the key.
    line: usize,
    name: String,
    item: &'a Item,
}

impl Entry<'_> {
    fn wrong(&self, what: impl Display) -> Error {
        Error {
            line: self.line,
            key: self.name.clone(),
            what: what.to_string(),
        }
    }

    /// Text without what would move the cursor of a terminal.
    fn string(&self, example: &str) -> Result<&str, Error> {
        let Some(text) = self.item.as_str() else {
            let kind = self.item.type_name();
            return Err(self.wrong(format!(
                "{kind}, and text is wanted\n  write it in quotes: {example}"
            )));
        };
        match text.chars().any(char::is_control) {
            true => Err(self.wrong("a control character\n  leave it out")),
            false => Ok(text),
        }
    }

    fn parse<T: FromStr<Err = ParseError>>(&self, example: &str) -> Result<T, Error> {
        let parsed = self.string(example)?.parse();
        parsed.map_err(|error: ParseError| self.wrong(error))
    }

    /// Counts, as a number or in quotes.
    fn counts<T: FromStr<Err = ParseError>>(&self, example: &str) -> Result<T, Error> {
        match self.item.as_integer() {
            Some(number) => number
                .to_string()
                .parse()
                .map_err(|error: ParseError| self.wrong(error)),
            None => self.parse(example),
        }
    }
}

impl Reader<'_> {
    fn line(&self, span: Option<Range<usize>>) -> usize {
        line_at(self.text, span.map_or(0, |span| span.start))
    }

    fn entry<'i>(&self, within: &str, key: Option<&Key>, name: &str, item: &'i Item) -> Entry<'i> {
        let shown: String = name.chars().filter(|c| !c.is_control()).collect();
        let dot = if within.is_empty() { "" } else { "." };
        Entry {
            line: self.line(key.and_then(Key::span).or_else(|| item.span())),
            name: format!("{within}{dot}{shown}"),
            item,
        }
    }

    fn config(&self, root: &Table) -> Result<Config, Error> {
        let mut config = Config::default();
        for (name, item) in root.iter() {
            let entry = self.entry("", root.key(name), name, item);
            let encoders = match (name, item.as_table_like()) {
                ("encoder", Some(encoders)) => encoders,
                ("encoder", None) => return Err(entry.wrong(TABLES)),
                _ => {
                    let meant =
                        nearest(name, &["encoder"]).map_or("", |_| ": [encoder.NAME] is meant");
                    return Err(entry.wrong(format!("no such table{meant}\n  {TABLES}")));
                }
            };
            for (name, item) in encoders.iter() {
                let entry = self.entry("encoder", encoders.key(name), name, item);
                check_name(name).map_err(|error| entry.wrong(printable(error)))?;
                let Some(table) = item.as_table_like() else {
                    return Err(entry.wrong(TABLES));
                };
                let encoder = self.encoder(&entry, table)?;
                config.encoders.push((name.to_owned(), encoder));
            }
        }
        Ok(config)
    }

    fn encoder(&self, whole: &Entry, table: &dyn TableLike) -> Result<Encoder, Error> {
        let mut encoder = Encoder::default();
        for (name, item) in table.iter() {
            let entry = self.entry(&whole.name, table.key(name), name, item);
            if name == "preset" && table.contains_key("frame") {
                return Err(entry.wrong("beside frame\n  one of them says it all"));
            }
            encoder.take(name, &entry)?;
        }
        if encoder.link.is_empty() {
            return Err(whole.wrong("no link\n  where is it? link = \"spi:0.0\", for example"));
        }
        let at = |names: &[&str]| {
            let mut there = names.iter().filter_map(|name| table.get_key_value(name));
            there
                .next()
                .map(|(key, item)| self.entry(&whole.name, Some(key), key.get(), item))
        };
        encoder.check(&at)?;
        Ok(encoder)
    }
}

const TABLES: &str = "encoders are tables: [encoder.NAME], and below it link = \"spi:0.0\"";

/// A name may be anything; what is shown of it may not.
fn printable(error: ParseError) -> String {
    let shown = error.to_string();
    let plain = |c: &char| *c == '\n' || !c.is_control();
    shown.chars().filter(plain).collect()
}

impl Encoder {
    fn take(&mut self, name: &str, entry: &Entry) -> Result<(), Error> {
        match name {
            "link" => {
                let text = entry.string("\"spi:0.0\"")?;
                let link: Spec = text
                    .parse()
                    .map_err(|error: ParseError| entry.wrong(error))?;
                if matches!(link.kind, Kind::Exec(_)) {
                    return Err(entry.wrong(
                        "an exec: link runs a command, so no file can name it\n  type it behind the verb, in quotes",
                    ));
                }
                self.link = text.to_owned();
            }
            "frame" => self.frame = Some(entry.parse("\"st26,nE,nW,crc6\"")?),
            "preset" => {
                let text = entry.string("\"resolute-26\"")?;
                if Preset::named(text).is_none() {
                    let names: Vec<&str> = crate::preset::all()
                        .iter()
                        .map(|known| known.name)
                        .collect();
                    let meant = meant(text, &names);
                    let names = names.join(" ");
                    return Err(
                        entry.wrong(format!("no preset `{text}`{meant}\n  presets are {names}"))
                    );
                }
                self.frame = Some(entry.parse("")?);
            }
            "clock" => self.clock = Some(entry.parse("\"2MHz\"")?),
            "interval" => {
                let interval = entry.parse("\"1ms\"")?;
                if interval == Nanos(0) {
                    return Err(
                        entry.wrong("0 is no interval\n  leave it out to read back to back")
                    );
                }
                self.interval = Some(interval);
            }
            "timeout" => self.timeout = Some(entry.parse("\"12us..40us\"")?),
            "zero" => self.zero = Some(entry.counts("\"here\", or counts without quotes")?),
            "reverse" => {
                let reverse = entry.item.as_bool();
                self.reverse = reverse.ok_or_else(|| entry.wrong("neither true nor false"))?;
            }
            "resolution" => {
                self.resolution =
                    Some(entry.counts("\"50nm\", or counts of a turn without quotes")?);
            }
            "unit" => self.unit = Some(entry.parse("\"mm\"")?),
            _ => {
                let (meant, keys) = (meant(name, &KEYS), KEYS.join(" "));
                return Err(entry.wrong(format!("no such key{meant}\n  there are {keys}")));
            }
        }
        Ok(())
    }

    /// What does not go together. `at` finds the first of some keys that is there.
    fn check<'i>(&self, at: &dyn Fn(&[&str]) -> Option<Entry<'i>>) -> Result<(), Error> {
        let wrong = |names: &[&str], what: &dyn Display| match at(names) {
            Some(entry) => Err(entry.wrong(what)),
            None => Ok(()),
        };
        let Ok(link) = self.link.parse::<Spec>() else {
            return Ok(());
        };
        if link.frame.is_some() {
            wrong(
                &["frame", "preset"],
                &"the link has a frame= already\n  leave one of them out",
            )?;
        }
        if matches!(link.kind, Kind::File { .. }) {
            wrong(
                &["clock", "interval"],
                &"no meaning on a recording\n  leave it out",
            )?;
        }
        if let Err(error) = self.spec(true) {
            wrong(&["link"], &error)?;
        }
        let given = match (&self.frame, &link.frame, &link.kind) {
            (Some(Wanted::Given(frame)), ..) | (_, Some(frame), _) => &frame.format,
            (None, _, Kind::Sim { config, .. }) => &config.format,
            _ => return Ok(()),
        };
        match scales(given, self.unit, self.resolution) {
            Ok(_) => Ok(()),
            Err(misfit) => wrong(&["unit", "resolution"], &misfit),
        }
    }
}

fn meant(name: &str, known: &[&str]) -> String {
    nearest(name, known).map_or_else(String::new, |meant| format!(", `{meant}` is meant"))
}

/// The text of a file with this encoder in it, in the place of the one that had its name. Comments, order and other text
/// stay as they are.
///
/// # Errors
/// When the text is no configuration, or this is no encoder that one can have.
pub fn with(text: &str, name: &str, encoder: &Encoder) -> Result<String, Error> {
    Config::parse(text.as_bytes())?;
    let nowhere = |what: &dyn Display| Error {
        line: line_at(text, text.len()),
        key: format!("encoder.{name}"),
        what: what.to_string(),
    };
    check_name(name).map_err(|error| nowhere(&printable(error)))?;
    let mut document: DocumentMut = text.parse().map_err(|error| unparsed(text, &error))?;
    let fresh = document.is_empty();
    let encoders = document.entry("encoder").or_insert_with(|| {
        let mut table = Table::new();
        table.set_implicit(true);
        Item::Table(table)
    });
    let Some(encoders) = encoders.as_table_like_mut() else {
        return Err(nowhere(&TABLES));
    };
    if !encoders.contains_key(name) {
        let mut table = Table::new();
        // Behind all others.
        table.set_position(Some(isize::MAX));
        if !fresh {
            table.decor_mut().set_prefix("\n");
        }
        encoders.insert(name, Item::Table(table));
    }
    let Some(table) = encoders.get_mut(name).and_then(Item::as_table_like_mut) else {
        return Err(nowhere(&TABLES));
    };
    table.remove("preset");
    for (key, new) in encoder.values() {
        put(table, key, new);
    }
    let text = document.to_string();
    // What cannot be read is not written.
    match Config::parse(text.as_bytes())?.encoder(name) {
        Some(read) if read == encoder => Ok(text),
        _ => Err(nowhere(&"not as it was meant when it is read again")),
    }
}

/// With the comment that the old value has behind it.
fn put(table: &mut dyn TableLike, key: &str, new: Option<Item>) {
    let Some(mut new) = new else {
        table.remove(key);
        return;
    };
    match table.get_mut(key) {
        Some(there) => {
            if let (Some(old), Some(new)) = (there.as_value(), new.as_value_mut()) {
                *new.decor_mut() = old.decor().clone();
            }
            *there = new;
        }
        None => drop(table.insert(key, new)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(text: &str) -> String {
        match Config::parse(text.as_bytes()) {
            Err(error) => error.to_string(),
            Ok(config) => panic!("{text}\n{config:?}"),
        }
    }

    const ALL: &str = "\
# what is on the bench
[encoder.spindle]
link = \"spi:0.0\"          # the left one
frame = 'mt12,st16,nE,nW,crc6'
clock = \"2MHz\"
interval = \"1ms\"
timeout = \"12us..20us\"
zero = 524288
reverse = true
resolution = 50_000
unit = \"turn\"

[encoder]
axis.link = \"gpio:0,ma=17,slo=27\"
axis.preset = \"resolute-36\"
axis.resolution = \"50nm\"
demo = { link = \"sim\", frame = \"auto\", zero = \"here\" }
";

    #[test]
    fn every_key_is_read() {
        let config = Config::parse(ALL.as_bytes()).unwrap();
        let names: Vec<&str> = config.encoders().map(|(name, _)| name).collect();
        assert_eq!(names, ["spindle", "axis", "demo"]);
        let spindle = Encoder {
            link: "spi:0.0".into(),
            frame: Some("mt12,st16,nE,nW,crc6".parse().unwrap()),
            clock: Some(Hertz(2_000_000)),
            interval: Some(Nanos(1_000_000)),
            timeout: Some("12us..20us".parse().unwrap()),
            zero: Some(Zero::At(524_288)),
            reverse: true,
            resolution: Some(Resolution::Turn(50_000)),
            unit: Some(Unit::Turns),
        };
        assert_eq!(config.encoder("spindle"), Some(&spindle));
        let axis = config.encoder("axis").unwrap();
        assert_eq!(axis.frame, Some("resolute-36".parse().unwrap()));
        let spec = axis.spec(true).unwrap();
        assert_eq!(spec.frame.unwrap().preset.unwrap().name, "resolute-36");
        assert_eq!(axis.spec(false).unwrap().frame, None);
        let demo = config.encoder("demo").unwrap();
        assert_eq!(
            (demo.frame.as_ref(), demo.zero),
            (Some(&Wanted::Auto), Some(Zero::Here))
        );
        assert_eq!(demo.spec(true).unwrap().frame, None);
        assert_eq!(config.encoder("nobody"), None);
        assert_eq!(Config::parse(b""), Ok(Config::default()));
        assert_eq!(Config::parse(b"[encoder]\n"), Ok(Config::default()));
    }

    #[test]
    fn errors_name_line_and_key() {
        let x = "[encoder.x]\nlink = \"spi:0.0\"\n";
        let below = |line: &str| error(&format!("{x}{line}\n"));
        for (said, starts, words) in [
            (
                below("clok = '2MHz'"),
                "3: encoder.x.clok: no such key, `clock` is meant\n",
                "there are link frame preset",
            ),
            (
                below("colour = 1"),
                "3: encoder.x.colour: no such key\n",
                "resolution unit",
            ),
            (
                below("clock = 2000000"),
                "3: encoder.x.clock: integer, and text is wanted",
                "in quotes: \"2MHz\"",
            ),
            (
                below("clock = '2000000'"),
                "3: encoder.x.clock: `2000000` has no unit",
                "500kHz",
            ),
            (
                below("interval = '0s'"),
                "3: encoder.x.interval: 0 is no interval",
                "",
            ),
            (
                below("timeout = '0us'"),
                "3: encoder.x.timeout: a timeout of 0",
                "",
            ),
            (
                below("reverse = 1"),
                "3: encoder.x.reverse: neither true nor false",
                "",
            ),
            (
                below("zero = -1"),
                "3: encoder.x.zero: `-1` is no position",
                "",
            ),
            (
                below("resolution = 0"),
                "3: encoder.x.resolution: a turn does not have 0",
                "",
            ),
            (
                below("unit = 'inch'"),
                "3: encoder.x.unit: unknown unit `inch`",
                "deg rad turns",
            ),
            (below("frame = 'sx12'"), "3: encoder.x.frame: ", "^"),
            (
                below("preset = 'resolut-26'"),
                "3: encoder.x.preset: no preset `resolut-26`, `resolute-26` is meant",
                "siko",
            ),
            (
                below("frame = 'st8'\npreset = 'resolute-26'"),
                "4: encoder.x.preset: beside frame",
                "",
            ),
            (
                below("frame = 'st12'\nunit = 'mm'"),
                "4: encoder.x.unit: unit mm takes",
                "resolution 50nm",
            ),
            (
                below("frame = 'st12'\nresolution = 5000"),
                "4: encoder.x.resolution: resolution 5000",
                "pos12",
            ),
            (below("link = 'sim'"), "3: ", "duplicate"),
            (below("clock = '\\u001b[2J'"), "3: encoder.x.clock: ", ""),
            (
                below("clock = \"\\u001b[2J\""),
                "3: encoder.x.clock: a control character",
                "",
            ),
            (
                error("[encoder.x]\nclock = '2MHz'\n"),
                "1: encoder.x: no link",
                "",
            ),
            (
                error("[encoder.x]\nlink = 'exec:rm -rf /'\n"),
                "2: encoder.x.link: an exec: link runs",
                "type it",
            ),
            (
                error("[encoder.x]\nlink = 'spy:0.0'\n"),
                "2: encoder.x.link: unknown link `spy`",
                "^^^",
            ),
            (
                error("[encoder.x]\nlink = 'spi:0.0,frame=st8'\nframe = 'st9'\n"),
                "3: encoder.x.frame: the link has",
                "",
            ),
            (
                error("[encoder.x]\nlink = 'file:a.vcd'\nclock = '1MHz'\n"),
                "3: encoder.x.clock: no meaning",
                "",
            ),
            (
                error("[encoder.sim]\nlink = 'sim'\n"),
                "1: encoder.sim: `sim` is a kind of link",
                "",
            ),
            (
                error("[encoder.SPI]\nlink = 'sim'\n"),
                "1: encoder.SPI: `spi` is a kind of link",
                "",
            ),
            (
                error("[encoder.'a b']\nlink = 'sim'\n"),
                "1: encoder.a b: no name",
                "letters",
            ),
            (
                error("[encoder.\"\\u001b\"]\nlink = 'sim'\n"),
                "1: encoder.: no name",
                "letters",
            ),
            (
                error("\n[encoders.x]\nlink = 'sim'\n"),
                "2: encoders: no such table: [encoder.NAME] is meant",
                "",
            ),
            (
                error("link = 'sim'\n"),
                "1: link: no such table",
                "[encoder.NAME]",
            ),
            (
                error("encoder = 5\n"),
                "1: encoder: encoders are tables",
                "",
            ),
            (
                error("[encoder]\nx = 5\n"),
                "2: encoder.x: encoders are tables",
                "",
            ),
            (
                error("[[encoder]]\nlink = 'sim'\n"),
                "1: encoder: encoders are tables",
                "",
            ),
            (error("[encoder.x\nlink = 'sim'\n"), "1: ", "TOML"),
            (error("[encoder.x]\nlink = \n"), "2: ", "TOML"),
        ] {
            assert!(said.starts_with(starts), "{starts}\n{said}");
            assert!(said.contains(words), "{words}\n{said}");
            assert!(!said.contains('\u{1b}'), "{said:?}");
        }
    }

    /// An error, never a panic.
    #[test]
    fn nothing_that_is_no_configuration_is_taken_for_one() {
        let said = |bytes: &[u8]| Config::parse(bytes).expect_err("an error").to_string();
        assert!(said(&[b'\n', 0xFF, 0]).starts_with("2: no UTF-8"));
        assert!(said(&[0; 100]).starts_with("1: "));
        assert!(said(&vec![b'#'; MOST_BYTES + 1]).starts_with("1: more than"));
        for part in [
            "[", "{a=", "[[", "a.", "[a.", "'", "\"\"\"", "x=[", "-", "\u{feff}", "é",
        ] {
            let count = MOST_BYTES / part.len();
            said(part.repeat(count).as_bytes());
            said(format!("x = {}", part.repeat(count - 4)).as_bytes());
        }
        // As deep as lines of keys within tables within each other get.
        let keys = "a.".repeat(MOST_DOTS - 1);
        let deep = format!("{keys}a = {{\n").repeat(60);
        said(deep.as_bytes());
        said(format!("{deep}{}", "}\n".repeat(60)).as_bytes());
        said(format!("[{keys}b]\n{keys}c = {{ {keys}d = 1 }}").as_bytes());
    }

    #[test]
    fn no_text_panics() {
        let seed = fastrand::u64(..);
        println!("seed {seed}");
        let mut rng = fastrand::Rng::with_seed(seed);
        let parts = [
            "[encoder.x]\n",
            "[encoder]\n",
            "x.",
            "link",
            "frame",
            "preset",
            "clock",
            "zero",
            "unit",
            "resolution",
            " = ",
            "'sim'",
            "'spi:0.0'",
            "'sim:frame=st8'",
            "'st8'",
            "'mm'",
            "'50nm'",
            "50",
            "-1",
            "true",
            "{",
            "}",
            "[",
            "]",
            "\n",
            ",",
            "#",
            "\"",
            "'",
            "\\",
            "é",
            "\0",
            "'2MHz'",
        ];
        for _ in 0..20_000 {
            let text: String = (0..rng.usize(0..14))
                .map(|_| *rng.choice(&parts).unwrap())
                .collect();
            match Config::parse(text.as_bytes()) {
                Err(error) => assert!(error.line() <= text.lines().count() + 1, "{text}: {error}"),
                Ok(config) => {
                    for (name, encoder) in config.encoders() {
                        let again = with(&text, name, encoder).unwrap();
                        assert_eq!(
                            Config::parse(again.as_bytes()).unwrap(),
                            config,
                            "{text}\n{again}"
                        );
                    }
                }
            }
        }
    }

    fn sim(link: &str) -> Encoder {
        Encoder {
            link: link.into(),
            clock: Some(Hertz(1_000_000)),
            ..Encoder::default()
        }
    }

    #[test]
    fn a_new_encoder_leaves_the_others_as_they_are() {
        let text = with(ALL, "new", &sim("sim")).unwrap();
        assert_eq!(
            text,
            format!("{ALL}\n[encoder.new]\nlink = \"sim\"\nclock = \"1MHz\"\n")
        );
        let first = with("", "new", &sim("sim")).unwrap();
        assert_eq!(first, "[encoder.new]\nlink = \"sim\"\nclock = \"1MHz\"\n");
        let comment = with("# mine\n", "new", &sim("sim")).unwrap();
        assert!(
            comment.contains("# mine") && comment.contains("[encoder.new]"),
            "{comment}"
        );
    }

    #[test]
    fn an_encoder_that_is_there_is_replaced_where_it_stands() {
        let text = with(ALL, "spindle", &sim("sim")).unwrap();
        let want = "\
# what is on the bench
[encoder.spindle]
link = \"sim\"          # the left one
clock = \"1MHz\"

[encoder]
";
        assert!(text.starts_with(want), "{text}");
        assert!(ALL.ends_with(&text[want.len()..]), "{text}");
        for name in ["axis", "demo"] {
            let text = with(ALL, name, &sim("sim:ack=3")).unwrap();
            assert!(
                text.contains("# the left one") && !text.contains("preset = \"\""),
                "{text}"
            );
            let config = Config::parse(text.as_bytes()).unwrap();
            assert_eq!(config.encoder(name), Some(&sim("sim:ack=3")));
            assert_eq!(config.encoders().count(), 3);
        }
    }

    #[test]
    fn nothing_is_written_that_cannot_be_read() {
        let said = |text: &str, name: &str, link: &str| {
            with(text, name, &sim(link)).unwrap_err().to_string()
        };
        assert!(said("[encoder.x]\n", "y", "sim").contains("encoder.x: no link"));
        assert!(said("", "sim", "sim").contains("a kind of link"));
        assert!(said("", "a b", "sim").contains("no name"));
        assert!(said("", "x", "exec:true").contains("runs a command"));
        assert!(said("", "x", "spy:0").contains("unknown link"));
        assert!(said("", "x", "").contains("unknown link"));
    }
}
