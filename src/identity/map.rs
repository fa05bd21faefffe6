//! Registers as they were read, and one named group of them.

use std::fmt;

/// One register of a slave, as the attempt to read it ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Cell {
    /// What the slave sent.
    Byte(u8),
    /// The slave answered that there is nothing to read: protected, or not implemented; it does not say which (D2, p. 20).
    Refused,
    /// Nobody asked, or no answer came.
    #[default]
    Unread,
}

impl Cell {
    /// What the slave sent, if it sent something.
    pub fn byte(self) -> Option<u8> {
        match self {
            Cell::Byte(byte) => Some(byte),
            Cell::Refused | Cell::Unread => None,
        }
    }
}

/// Two characters: the byte in hex, `--` for refused, `??` for not read.
impl fmt::Display for Cell {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Cell::Byte(byte) => write!(f, "{byte:02X}"),
            Cell::Refused => f.write_str("--"),
            Cell::Unread => f.write_str("??"),
        }
    }
}

/// 64 registers in a row, from address `FIRST` on; unread where nothing else is said.
///
/// Only the low six bits of an address count, as the type says which half of the addresses is meant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cells<const FIRST: u8>([Cell; 64]);

/// Addresses 0x40 to 0x7F: the same whatever bank is selected (D2, p. 20-22).
///
/// ```
/// use biss::identity::{Cell, Direct};
///
/// let mut direct = Direct::of(0x42, &[0x62, 0x1E]);
/// direct.set(0x74, Cell::Refused);
/// assert_eq!(direct.get(0x43), Cell::Byte(0x1E));
/// assert_eq!(direct.get(0x74).to_string(), "--");
/// assert_eq!(direct.get(0x40), Cell::Unread);
/// ```
pub type Direct = Cells<0x40>;

/// Addresses 0x00 to 0x3F: one bank (D2, p. 20).
pub type Window = Cells<0x00>;

impl<const FIRST: u8> Cells<FIRST> {
    /// Nothing read yet.
    pub fn unread() -> Self {
        Cells([Cell::Unread; 64])
    }

    /// These bytes from `address` on, the rest unread. What does not fit is left out.
    pub fn of(address: u8, bytes: &[u8]) -> Self {
        let mut cells = Cells::unread();
        let room = cells.0.iter_mut().skip(usize::from(address & 0x3F));
        for (cell, byte) in room.zip(bytes) {
            *cell = Cell::Byte(*byte);
        }
        cells
    }

    /// The register at `address`.
    pub fn get(&self, address: u8) -> Cell {
        self.0[usize::from(address & 0x3F)]
    }

    /// Says how reading the register at `address` ended.
    pub fn set(&mut self, address: u8, cell: Cell) {
        self.0[usize::from(address & 0x3F)] = cell;
    }

    /// All 64 with their addresses.
    pub fn iter(&self) -> impl Iterator<Item = (u8, Cell)> + '_ {
        (FIRST..).zip(self.0.iter().copied())
    }

    pub(super) fn slice(&self, address: u8, len: u8) -> &[Cell] {
        let from = usize::from(address & 0x3F);
        let to = (from + usize::from(len)).min(self.0.len());
        &self.0[from..to]
    }

    /// What every register holds, if it is the same byte in all of them.
    pub(super) fn uniform(&self) -> Option<u8> {
        let first = self.0[0].byte()?;
        let same = self.0.iter().all(|cell| cell.byte() == Some(first));
        same.then_some(first)
    }

    pub(super) fn any_byte(&self) -> bool {
        self.0.iter().any(|cell| cell.byte().is_some())
    }
}

/// A group of registers with a name, what it says, and how sure that is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    /// Address of the first register.
    pub offset: u8,
    /// Registers as read, low address first.
    pub raw: Vec<Cell>,
    /// The name in the specification (D2) or in NXP's driver.
    pub name: &'static str,
    /// The registers as one number, big endian (D2, p. 20); `None` above 8 of them, or where one was not read.
    pub value: Option<u64>,
    /// What it says, in words with units where units are published.
    pub meaning: String,
    /// Why not to rely on it; `None` where there is no doubt.
    pub doubt: Option<&'static str>,
}

impl Field {
    /// Registers in the group.
    pub fn len(&self) -> usize {
        self.raw.len()
    }

    /// Never: every field has a register.
    pub fn is_empty(&self) -> bool {
        self.raw.is_empty()
    }

    /// The registers in hex, low address first: `62 1E`; `--` stands for refused, `??` for not read.
    pub fn hex(&self) -> String {
        let cells: Vec<String> = self.raw.iter().map(Cell::to_string).collect();
        cells.join(" ")
    }

    /// All registers as bytes.
    pub fn bytes(&self) -> Option<Vec<u8>> {
        self.raw.iter().map(|cell| cell.byte()).collect()
    }
}

/// What a field says and what to doubt about it.
pub(super) type Said = (String, Option<&'static str>);

/// A field of `len` registers; `say` puts its number into words when all of them were read.
pub(super) fn field<const FIRST: u8>(
    cells: &Cells<FIRST>,
    offset: u8,
    len: u8,
    name: &'static str,
    say: impl FnOnce(u64) -> Said,
) -> Field {
    let raw = cells.slice(offset, len).to_vec();
    let value = big_endian(&raw);
    let (meaning, doubt) = match value {
        Some(value) => say(value),
        None => absent(&raw),
    };
    Field {
        offset,
        raw,
        name,
        value,
        meaning,
        doubt,
    }
}

/// Registers that no published layout names, shown as they are.
pub(super) fn unnamed<const FIRST: u8>(
    cells: &Cells<FIRST>,
    offset: u8,
    len: u8,
    name: &'static str,
    meaning: &str,
) -> Field {
    let raw = cells.slice(offset, len).to_vec();
    Field {
        offset,
        value: big_endian(&raw),
        raw,
        name,
        meaning: meaning.to_owned(),
        doubt: None,
    }
}

fn big_endian(raw: &[Cell]) -> Option<u64> {
    if raw.len() > 8 {
        return None;
    }
    raw.iter()
        .try_fold(0, |value, cell| Some(value << 8 | u64::from(cell.byte()?)))
}

/// Words for a group that is not complete, or too long for a number.
pub(super) fn absent(raw: &[Cell]) -> Said {
    let all = |want: Cell| raw.iter().all(|cell| *cell == want);
    let any = |want: Cell| raw.contains(&want);
    if all(Cell::Refused) {
        ("refused".into(), None)
    } else if all(Cell::Unread) {
        ("not read".into(), None)
    } else if any(Cell::Refused) {
        ("incomplete".into(), Some("part of it was refused"))
    } else if any(Cell::Unread) {
        ("incomplete".into(), Some("part of it was not read"))
    } else {
        (String::new(), None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_have_their_half() {
        let mut direct = Direct::of(0x7E, &[0x69, 0x43, 0xFF]);
        assert_eq!(direct.get(0x7F), Cell::Byte(0x43));
        assert_eq!(
            direct.get(0x40),
            Cell::Unread,
            "what does not fit is left out"
        );
        direct.set(0x40, Cell::Refused);
        let listed: Vec<(u8, Cell)> = direct.iter().collect();
        assert_eq!(listed.len(), 64);
        assert_eq!(listed[0], (0x40, Cell::Refused));
        assert_eq!(listed[63], (0x7F, Cell::Byte(0x43)));
    }

    #[test]
    fn a_field_is_big_endian_or_says_what_is_missing() {
        let mut window = Window::of(0x10, &[0x12, 0x34, 0x56]);
        let read = |window: &Window, len| {
            field(window, 0x10, len, "X", |value| {
                (format!("{value:#x}"), None)
            })
        };
        assert_eq!(read(&window, 3).meaning, "0x123456");
        assert_eq!(read(&window, 3).hex(), "12 34 56");
        assert_eq!(read(&window, 4).doubt, Some("part of it was not read"));
        assert_eq!(read(&window, 4).hex(), "12 34 56 ??");
        window.set(0x11, Cell::Refused);
        assert_eq!(read(&window, 3).value, None);
        assert_eq!(read(&window, 3).doubt, Some("part of it was refused"));
        let none = field(&window, 0x20, 2, "X", |_| unreachable!());
        assert_eq!((none.meaning.as_str(), none.doubt), ("not read", None));
    }
}
