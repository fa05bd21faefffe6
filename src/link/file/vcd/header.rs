//! What stands in a VCD before its changes.

use super::super::source::Channel;
use super::super::text::Text;
use super::{CODE, KIND, Vector, Wire, is_end, is_space, word_end};
use std::collections::HashMap;

/// What a header may take of the memory.
const NAMES_MAX: usize = 40 << 20;
/// What one signal takes beside its names, about.
const SIGNAL: usize = 224;
/// One command of a header that is not skipped.
const COMMAND_MAX: usize = 64 << 10;

/// Reads what comes before the first change.
pub(super) struct Header<'a> {
    text: &'a mut Text,
    /// Where the last word began.
    pub(super) word_at: usize,
    spent: usize,
    /// Scopes, each with a point behind it; and how long this was outside each of them.
    scope: String,
    outer: Vec<usize>,
    ids: HashMap<String, usize>,
    pub(super) found: Found,
}

/// What a header says.
#[derive(Default)]
pub(super) struct Found {
    pub(super) tick_fs: Option<u64>,
    pub(super) channels: Vec<Channel>,
    pub(super) wires: Vec<Wire>,
    pub(super) vectors: Vec<Vector>,
    pub(super) indexed: Vec<(usize, i64)>,
    pub(super) strings: Vec<String>,
}

impl Header<'_> {
    pub(super) fn new(text: &mut Text) -> Header<'_> {
        Header {
            text,
            word_at: 0,
            spent: 0,
            scope: String::new(),
            outer: Vec::new(),
            ids: HashMap::new(),
            found: Found::default(),
        }
    }

    pub(super) fn read(&mut self) -> Result<(), String> {
        let mut first = true;
        loop {
            let word = self.word()?;
            let word = match word.strip_prefix('\u{feff}') {
                Some(word) if first => word,
                _ => &word,
            };
            first = false;
            match word {
                "$enddefinitions" => {
                    self.nothing_more(word)?;
                    break;
                }
                "$timescale" => {
                    let said = self.words(word)?.join(" ");
                    let tick_fs = timescale(&said);
                    let tick_fs = tick_fs.ok_or_else(|| format!("`{said}` is no time scale"))?;
                    self.found.tick_fs = Some(tick_fs);
                }
                "$scope" => {
                    let words = self.words(word)?;
                    self.outer.push(self.scope.len());
                    if let [_, name @ ..] = &words[..] {
                        self.scope.push_str(&name.join(" "));
                    }
                    self.scope.push('.');
                    if self.scope.len() > COMMAND_MAX {
                        return Err("scopes are nested too deeply".into());
                    }
                }
                "$upscope" => {
                    self.nothing_more(word)?;
                    let outer = self.outer.pop();
                    let outer = outer.ok_or("`$upscope` without a `$scope`")?;
                    self.scope.truncate(outer);
                }
                "$var" => {
                    let words = self.words(word)?;
                    self.var(&words)?;
                }
                "$dumpvars" | "$dumpall" | "$dumpon" | "$dumpoff" | "$end" => {
                    return Err(format!("`{word}` has no place in the header"));
                }
                _ if word.len() > 1 && word.starts_with('$') => self.skip()?,
                _ => {
                    let word: String = word.escape_debug().take(24).collect();
                    return Err(format!("`{word}` is no VCD"));
                }
            }
        }
        self.tell_apart();
        Ok(())
    }

    /// The next word.
    fn word(&mut self) -> Result<String, String> {
        while self.text.more("a word", is_space)? {
            let (text, at) = (self.text.window(), self.text.at);
            let spaces = text[at..self.text.len()].iter();
            let Some(gap) = spaces
                .take(self.text.len() - at)
                .position(|b| !is_space(*b))
            else {
                self.text.at = self.text.len();
                continue;
            };
            let next = word_end(text, at + gap);
            let word = String::from_utf8_lossy(&text[at + gap..next]).into_owned();
            (self.word_at, self.text.at) = (at + gap, next);
            return Ok(word);
        }
        self.word_at = self.text.at.saturating_sub(1);
        Err("it ends before `$enddefinitions`".into())
    }

    fn nothing_more(&mut self, command: &str) -> Result<(), String> {
        match self.words(command)?.first() {
            Some(word) => Err(format!("`{word}` in `{command}`, which takes nothing")),
            None => Ok(()),
        }
    }

    /// All words up to `$end`.
    fn words(&mut self, command: &str) -> Result<Vec<String>, String> {
        let (mut words, mut long) = (Vec::new(), 0);
        loop {
            let word = self.word()?;
            match word.as_str() {
                "$end" => return Ok(words),
                "$var" | "$scope" | "$upscope" | "$enddefinitions" => {
                    return Err(format!("`{command}` without `$end`"));
                }
                _ => {}
            }
            long += word.len() + 24;
            if long > COMMAND_MAX {
                return Err(format!("a `{command}` of more than 64 KiB"));
            }
            words.push(word);
        }
    }

    fn skip(&mut self) -> Result<(), String> {
        while !is_end(self.word()?.as_bytes())? {}
        Ok(())
    }

    fn var(&mut self, words: &[String]) -> Result<(), String> {
        let [kind, size, code, name @ ..] = words else {
            return Err("a `$var` without type, size, identifier code and name".into());
        };
        let size: u32 = size
            .parse()
            .map_err(|_| format!("`{size}` is no size of a `$var`"))?;
        if let Some(other) = code.bytes().find(|b| KIND[usize::from(*b)] & CODE == 0) {
            return Err(format!("an identifier code with the byte {other:#04x}"));
        }
        if name.is_empty() {
            return Err("a `$var` without a name".into());
        }
        let name = name.join(" ");
        let (name, range) = split_range(&name, size);
        let path = format!("{}{name}", self.scope);
        self.spent += 2 * name.len() + path.len() + code.len() + SIGNAL;
        if self.spent > NAMES_MAX {
            return Err("more signals than biss has room for: record or dump fewer".into());
        }
        match kind.as_str() {
            "string" => {
                self.found.strings.push(code.clone());
                return Ok(());
            }
            "real" | "realtime" | "shortreal" => return Ok(()),
            _ if size == 0 => return Ok(()),
            _ => {}
        }
        let name = name.to_owned();
        if size > 1 {
            let (left, right) = range.unwrap_or((i64::from(size) - 1, 0));
            self.found.vectors.push(Vector {
                name,
                path,
                code: code.clone(),
                left,
                right,
            });
            return Ok(());
        }
        if let Some((bit, _)) = range {
            self.found.indexed.push((self.found.channels.len(), bit));
        }
        let wires = &mut self.found.wires;
        let id = *self.ids.entry(code.clone()).or_insert_with(|| {
            wires.push(Wire {
                code: code.clone(),
                bit: 0,
            });
            wires.len() - 1
        });
        self.found.channels.push(Channel { name, path, id });
        Ok(())
    }

    /// A vector that is written bit by bit: each gets its index into its name. One alone is called as it is called.
    fn tell_apart(&mut self) {
        let Found {
            channels, indexed, ..
        } = &mut self.found;
        indexed.sort_by(|a, b| (&channels[a.0].path, a.1).cmp(&(&channels[b.0].path, b.1)));
        let mut from = 0;
        while from < indexed.len() {
            let path = channels[indexed[from].0].path.clone();
            let alike = indexed[from..]
                .iter()
                .take_while(|(index, _)| channels[*index].path == path)
                .count();
            if alike > 1 {
                for (index, bit) in &indexed[from..from + alike] {
                    let channel = &mut channels[*index];
                    channel.name = format!("{}[{bit}]", channel.name);
                    channel.path = format!("{path}[{bit}]");
                }
            }
            from += alike;
        }
    }
}

/// A name without `[7:0]`, or ` [3]`, and that. Without a space before it, an index alone belongs to the name of one bit.
fn split_range(name: &str, size: u32) -> (&str, Option<(i64, i64)>) {
    let whole = (name, None);
    let Some((base, range)) = name.strip_suffix(']').and_then(|n| n.rsplit_once('[')) else {
        return whole;
    };
    let number = |text: &str| text.trim().parse::<i64>().ok();
    let range = match range.split_once(':') {
        Some((left, right)) => number(left).zip(number(right)),
        None if base.ends_with(' ') => number(range).map(|bit| (bit, bit)),
        None => None,
    };
    let base = base.trim_end();
    match range {
        Some((left, right))
            if !base.is_empty() && left.abs_diff(right).checked_add(1) == Some(size.into()) =>
        {
            (base, range)
        }
        _ => whole,
    }
}

/// `1ns`, `10 us`: femtoseconds.
fn timescale(text: &str) -> Option<u64> {
    let unit_at = text.find(|c: char| !c.is_ascii_digit())?;
    let (count, unit) = text.split_at(unit_at);
    let unit_fs: u64 = match unit.trim_start().to_ascii_lowercase().as_str() {
        "s" => 1_000_000_000_000_000,
        "ms" => 1_000_000_000_000,
        "us" => 1_000_000_000,
        "ns" => 1_000_000,
        "ps" => 1_000,
        "fs" => 1,
        _ => return None,
    };
    let count: u64 = count.parse().ok()?;
    count.checked_mul(unit_fs).filter(|fs| *fs > 0)
}
