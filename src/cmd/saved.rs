//! Banks of registers as a file: text that can be read, compared and edited, and that is taken back as strictly as it is
//! written.
//!
//! ```text
//! biss-registers 1
//! slave 0
//! device 4d 48 4d 23 44 00
//! manufacturer 69 43
//! bank 0
//! 0x00: 48 44 00 78 80 00 00 00 cf 80 00 00 23 00 00 00
//! 0x10: 00 00 00 8c -- -- -- -- -- -- -- -- -- -- -- --
//! ```
//!
//! `--` is a register that is refused. What follows `#` is a comment.

use std::fmt;

/// Registers of a bank.
pub(super) const BANK: usize = 0x40;

/// Bytes, as far as the slave gives them.
pub(super) type Cells<const N: usize> = [Option<u8>; N];

/// What a slave is known by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Identity {
    /// 0x78 to 0x7d.
    pub(super) device: Cells<6>,
    /// 0x7e and 0x7f.
    pub(super) manufacturer: Cells<2>,
}

/// A bank.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Bank {
    pub(super) number: u8,
    pub(super) cells: Cells<BANK>,
}

/// A file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Saved {
    pub(super) slave: u8,
    pub(super) identity: Identity,
    pub(super) banks: Vec<Bank>,
}

/// A line that is none of such a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Wrong {
    pub(super) line: usize,
    what: String,
    hint: &'static str,
}

impl fmt::Display for Wrong {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}\n  {}", self.what, self.hint)
    }
}

const VERSION: &str = "1";
const BY_SAVE: &str = "`biss reg LINK save -w FILE` writes such files";
const ROW: &str = "write it like 0x10: 5a 00 -- ff, registers 0x00 to 0x3f in their order";

struct Shown<'a>(&'a [Option<u8>]);

impl fmt::Display for Shown<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|cell| match cell {
            Some(byte) => write!(f, " {byte:02x}"),
            None => f.write_str(" --"),
        })
    }
}

impl fmt::Display for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (device, maker) = (Shown(&self.device), Shown(&self.manufacturer));
        write!(f, "device{device}, manufacturer{maker}")
    }
}

impl fmt::Display for Saved {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "# Registers of a BiSS-C slave; `biss reg LINK load FILE` writes them back"
        )?;
        writeln!(f, "biss-registers {VERSION}")?;
        writeln!(f, "slave {}", self.slave)?;
        writeln!(f, "device{}", Shown(&self.identity.device))?;
        writeln!(f, "manufacturer{}", Shown(&self.identity.manufacturer))?;
        for bank in &self.banks {
            writeln!(f, "bank {}", bank.number)?;
            for (row, cells) in bank.cells.chunks(16).enumerate() {
                writeln!(f, "{:#04x}:{}", row * 16, Shown(cells))?;
            }
        }
        Ok(())
    }
}

/// The lines that say something, with their numbers.
struct Lines<'a> {
    lines: std::iter::Peekable<Box<dyn Iterator<Item = (usize, &'a str)> + 'a>>,
    last: usize,
}

impl<'a> Lines<'a> {
    fn new(text: &'a str) -> Lines<'a> {
        let said = |line: &'a str| line.split('#').next().unwrap_or_default().trim();
        let lines = (1..).zip(text.lines().map(said));
        let lines: Box<dyn Iterator<Item = _>> = Box::new(lines.filter(|line| !line.1.is_empty()));
        Lines {
            lines: lines.peekable(),
            last: text.lines().count().max(1),
        }
    }

    /// What follows `key`, which must come now.
    fn expect(&mut self, key: &str) -> Result<(usize, Vec<&'a str>), Wrong> {
        let Some((line, text)) = self.lines.next() else {
            let what = format!("the file ends where `{key}` should stand");
            return Err(wrong(self.last, what, BY_SAVE));
        };
        let mut words = text.split_whitespace();
        match words.next() {
            Some(word) if word == key => Ok((line, words.collect())),
            _ => Err(wrong(
                line,
                format!("`{text}` stands where `{key}` should"),
                BY_SAVE,
            )),
        }
    }

    /// One number after `key`.
    fn number(&mut self, key: &str, most: u8) -> Result<(usize, u8), Wrong> {
        let (line, words) = self.expect(key)?;
        let number = match words[..] {
            [word] => word.parse().ok().filter(|number| *number <= most),
            _ => None,
        };
        let what = format!("`{key}` is a number from 0 to {most}");
        number
            .map(|number| (line, number))
            .ok_or_else(|| wrong(line, what, BY_SAVE))
    }

    fn cells<const N: usize>(&mut self, key: &str) -> Result<Cells<N>, Wrong> {
        let (line, words) = self.expect(key)?;
        let cells = cells(line, words.into_iter())?;
        let what = format!("`{key}` is {N} bytes, not {}", cells.len());
        cells.try_into().map_err(|_| wrong(line, what, BY_SAVE))
    }

    /// A row of a bank, if one comes now.
    fn row(&mut self) -> Option<(usize, &'a str, &'a str)> {
        let (line, text) = *self.lines.peek()?;
        let (address, cells) = text.split_once(':')?;
        self.lines.next();
        Some((line, address.trim(), cells))
    }
}

fn wrong(line: usize, what: impl Into<String>, hint: &'static str) -> Wrong {
    Wrong {
        line,
        what: what.into(),
        hint,
    }
}

fn cells<'a>(line: usize, words: impl Iterator<Item = &'a str>) -> Result<Vec<Option<u8>>, Wrong> {
    let cell = |word: &str| {
        let digits = word.len() == 2 && word.bytes().all(|byte| byte.is_ascii_hexdigit());
        match u8::from_str_radix(word, 16) {
            _ if word == "--" => Ok(None),
            Ok(byte) if digits => Ok(Some(byte)),
            _ => Err(wrong(
                line,
                format!("`{word}` is no byte"),
                "two hexadecimal digits, or -- where it is refused",
            )),
        }
    };
    words.map(cell).collect()
}

impl Saved {
    /// # Errors
    /// The first line that is not as it should be.
    pub(super) fn parse(text: &str) -> Result<Saved, Wrong> {
        let mut lines = Lines::new(text);
        match lines.expect("biss-registers")? {
            (_, words) if words == [VERSION] => {}
            (line, words) => {
                let what = format!("version `{}` is not known", words.join(" "));
                return Err(wrong(line, what, "this biss knows version 1"));
            }
        }
        let (_, slave) = lines.number("slave", 7)?;
        let identity = Identity {
            device: lines.cells("device")?,
            manufacturer: lines.cells("manufacturer")?,
        };
        let mut banks: Vec<Bank> = Vec::new();
        while banks.is_empty() || lines.lines.peek().is_some() {
            let (line, number) = lines.number("bank", u8::MAX)?;
            if banks.iter().any(|bank| bank.number == number) {
                let what = format!("bank {number} is there already");
                return Err(wrong(line, what, "each bank once"));
            }
            let cells = bank(&mut lines, line)?;
            banks.push(Bank { number, cells });
        }
        Ok(Saved {
            slave,
            identity,
            banks,
        })
    }
}

fn bank(lines: &mut Lines, line: usize) -> Result<Cells<BANK>, Wrong> {
    let mut all = [None; BANK];
    let mut free = 0;
    let mut rows = 0;
    while let Some((line, address, text)) = lines.row() {
        rows += 1;
        let digits = address.strip_prefix("0x");
        let first = digits.and_then(|digits| usize::from_str_radix(digits, 16).ok());
        let Some(first) = first.filter(|first| *first < BANK) else {
            let what = format!("`{address}` is no register of a bank");
            return Err(wrong(line, what, ROW));
        };
        if first < free {
            let what = format!("register {first:#04x} was there before");
            return Err(wrong(line, what, ROW));
        }
        let row = cells(line, text.split_whitespace())?;
        free = first + row.len();
        let Some(room) = all.get_mut(first..free).filter(|_| !row.is_empty()) else {
            let what = format!("{} bytes from {address} on do not fit in a bank", row.len());
            return Err(wrong(line, what, ROW));
        };
        room.copy_from_slice(&row);
    }
    match rows {
        0 => Err(wrong(line, "a bank without registers", ROW)),
        _ => Ok(all),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn saved() -> Saved {
        let mut cells = [None; BANK];
        (cells[0], cells[0x3F]) = (Some(0x48), Some(0xFF));
        Saved {
            slave: 3,
            identity: Identity {
                device: [Some(0x4D), None, Some(1), Some(2), Some(3), Some(4)],
                manufacturer: [Some(0x69), Some(0x43)],
            },
            banks: vec![
                Bank { number: 0, cells },
                Bank {
                    number: 255,
                    cells: [Some(7); BANK],
                },
            ],
        }
    }

    #[test]
    fn what_is_written_is_read() {
        let text = saved().to_string();
        assert_eq!(Saved::parse(&text), Ok(saved()), "{text}");
        let edited = "biss-registers 1\n\n# by hand\nslave 0\ndevice -- -- -- -- -- --\nmanufacturer 69 43\n\
                      bank 2 # the third one\n0x10: 5A\n  0x3f:  -- \n";
        let edited = Saved::parse(edited).unwrap();
        assert_eq!(edited.banks[0].cells[0x10], Some(0x5A));
        assert_eq!(edited.banks[0].cells.iter().flatten().count(), 1);
    }

    #[test]
    fn what_is_wrong_is_told_with_its_line() {
        let good = saved().to_string();
        for (old, new, line, words) in [
            ("biss-registers 1", "biss-registers 2", 2, "version `2`"),
            (
                "biss-registers 1\n",
                "",
                2,
                "`slave 3` stands where `biss-registers`",
            ),
            ("slave 3", "slave 8", 3, "from 0 to 7"),
            ("slave 3", "slave", 3, "from 0 to 7"),
            ("69 43", "69 43 00", 5, "2 bytes, not 3"),
            ("69 43", "69 4", 5, "`4` is no byte"),
            ("69 43", "69 +3", 5, "`+3` is no byte"),
            ("bank 0", "bank 256", 6, "from 0 to 255"),
            ("bank 255", "bank 0", 11, "there already"),
            ("0x10:", "0x0f:", 8, "there before"),
            ("0x30:", "0x40:", 10, "no register of a bank"),
            ("0x30:", "0x31:", 10, "do not fit"),
            ("0x30:", "30:", 10, "no register of a bank"),
            ("0x30:", "0x30", 10, "stands where `bank`"),
        ] {
            assert!(good.contains(old), "{old}");
            let error = Saved::parse(&good.replacen(old, new, 1)).unwrap_err();
            let text = error.to_string();
            assert!(text.contains(words), "{old} -> {new}: {text}");
            assert_eq!(error.line, line, "{old} -> {new}: {text}");
        }
        for (text, words) in [
            ("", "`biss-registers` should"),
            ("biss-registers 1\nslave 0\n", "`device` should"),
            ("biss-registers 1\nslave 0\ndevice 1\n", "`1` is no byte"),
        ] {
            let error = Saved::parse(text).unwrap_err().to_string();
            assert!(error.contains(words), "{text}: {error}");
        }
        let headless: String = good
            .lines()
            .take(6)
            .map(|line| format!("{line}\n"))
            .collect();
        let error = Saved::parse(&headless).unwrap_err().to_string();
        assert!(error.contains("without registers"), "{error}");
    }
}
