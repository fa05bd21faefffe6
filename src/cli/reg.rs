//! `biss reg` and `biss command` as clap sees them.

use super::{ReportFormat, Stubborn, Wire};
use biss::ParseError;
use biss::control::ADDRESSES;
use clap::{Args, Subcommand};
use std::fmt;
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::str::FromStr;

pub(super) const REG_WARNING: &str = "\
WARNING: writing registers can change a device for good: settings are stored, calibrations lost, registers locked. Know \
from its data sheet what a register does before you write it.";

pub(super) const COMMAND_WARNING: &str = "\
WARNING: commands can change a device for good: 10 and 11 do what its maker liked, such as presetting the position. Know \
from its data sheet what a command does before you send it.";

pub(super) const REG_HELP: &str = "\
Registers, of each slave, 0x00 to 0x7f:
  0x00..0x3f       a window into one of up to 256 banks
  0x40             which bank that is; --bank selects one, and afterwards the one before
  0x41             the bank of the electronic data sheet
  0x42..0x43       profile
  0x44..0x47       serial number
  0x78..0x7d       device ID
  0x7e..0x7f       manufacturer ID

Addresses and values are decimal, 0x hexadecimal or 0b binary. A range has both its ends: 0x40..0x7f ends with 0x7f.

Links:
  gpio:[CHIP,]ma=LINE,slo=LINE  two GPIO lines
  wave:BUS.CS[,oversample=N]    spidev: MOSI is MA, MISO is SLO
  sim[:KEY=VAL,…]               simulated encoder
  exec:[tick=TIME,]COMMAND      a slave in another process, such as an HDL simulator
  With SCLK as MA (spi) nothing can be said to a slave.

Examples:
  biss reg sim dump                          all registers, hexadecimal and ASCII
  biss reg sim read 0x78..0x7f               who made it
  biss reg sim write 0x10=0x5a 0x11=1,2,3    0x10 to 0x13
  biss reg sim --bank 0..2 save -w enc.bank  three banks into a file
  biss reg sim load enc.bank --dry-run       how the encoder differs from it

Exit status:
  0  everything as it was asked for; dump and save: refused registers are an answer
  1  the slave refused, failed, holds something else than was written, or there is none
  2  usage or machine";

pub(super) const COMMAND_HELP: &str = "\
Commands to slaves:
  00  activate-data: their data channels send
  01  deactivate-control: they take no ID and hear nothing more, until activate-control
  10  what their maker says; bus couplers: standard operation
  11  what their maker says

Commands as a broadcast:
  00  deactivate-data: no data channel sends, until activate-data
  01  activate-control: all slaves take an ID again
  10  bus couplers: feedback mode
  11  reserved

Links:
  gpio:[CHIP,]ma=LINE,slo=LINE  two GPIO lines
  wave:BUS.CS[,oversample=N]    spidev: MOSI is MA, MISO is SLO
  sim[:KEY=VAL,…]               simulated encoder
  exec:[tick=TIME,]COMMAND      a slave in another process, such as an HDL simulator
  With SCLK as MA (spi) nothing can be said to a slave.

Exit status:
  0  acknowledged by those it was for, and executed; broadcasts: sent
  1  not acknowledged, not executed, or nobody there
  2  usage or machine";

/// What can be done with registers. Options may stand behind the verb too.
#[derive(Debug, Args)]
#[command(
    mut_args(everywhere),
    subcommand_value_name = "VERB",
    disable_help_subcommand = true
)]
pub(crate) struct Reg {
    #[command(flatten)]
    pub(crate) wire: Wire,

    #[command(flatten)]
    pub(crate) stubborn: Stubborn,

    /// Whose registers: ID 0 is the slave farthest away [default: 0; load: the file's]
    #[arg(long, value_name = "ID", value_parser = clap::value_parser!(u8).range(0..=7))]
    pub(crate) slave: Option<u8>,

    /// Bank to be selected for the work; save takes several, load means that one of the file
    #[arg(long, value_name = "N[,N|N..N]")]
    pub(crate) bank: Option<Banks>,

    /// Read everything twice: a CRC of four bits lets some errors of three bits pass
    #[arg(long)]
    pub(crate) verify: bool,

    /// How records look
    #[arg(short = 'o', long, value_enum, default_value_t = ReportFormat::Text)]
    pub(crate) format: ReportFormat,

    #[command(subcommand)]
    pub(crate) verb: RegVerb,
}

fn everywhere(arg: clap::Arg) -> clap::Arg {
    let option = !arg.is_positional();
    arg.global(option)
}

#[derive(Debug, Subcommand)]
pub(crate) enum RegVerb {
    /// Read registers, one record each
    Read {
        /// A register, or a range with both its ends
        #[arg(required = true, value_name = "ADDR[..ADDR]")]
        spans: Vec<Span>,
    },

    /// Write registers in this order, and read them back: one record each with the old and the new value
    #[command(before_help = REG_WARNING)]
    Write {
        /// Where, and what: several values go to this register and those behind it
        #[arg(required = true, value_name = "ADDR=VALUE[,VALUE…]")]
        assigns: Vec<Assign>,

        /// Do not read them back: for registers that do not keep what is written
        #[arg(long)]
        unchecked: bool,
    },

    /// All registers as a table: hexadecimal and ASCII, -- is refused, XX could not be read
    Dump {
        /// Only these
        #[arg(value_name = "ADDR..ADDR")]
        span: Option<Span>,
    },

    /// Save 0x00 to 0x3f of a bank, or of several, in a file that load takes
    Save {
        /// The file, - for standard output; what is there is replaced once all is read
        #[arg(short, long, value_name = "FILE")]
        write: PathBuf,
    },

    /// Write what differs from a saved file, and read everything back
    #[command(before_help = REG_WARNING)]
    Load {
        /// What save wrote, - for standard input
        #[arg(value_name = "FILE")]
        file: PathBuf,

        /// Only show what differs
        #[arg(long)]
        dry_run: bool,

        /// Though the file was saved from another kind of device
        #[arg(long)]
        force: bool,
    },
}

/// What slaves can be told to do.
#[derive(Debug, Args)]
pub(crate) struct Send {
    #[command(flatten)]
    pub(crate) wire: Wire,

    #[command(flatten)]
    pub(crate) stubborn: Stubborn,

    /// In binary, 00 01 10 11, or activate-data, deactivate-control; broadcast: deactivate-data, activate-control
    #[arg(value_name = "CODE")]
    pub(crate) code: Code,

    /// For these slaves: ID 0 is the one farthest away
    #[arg(
        long,
        value_name = "ID[,ID…]",
        value_delimiter = ',',
        required_unless_present = "broadcast",
        conflicts_with = "broadcast",
        value_parser = clap::value_parser!(u8).range(0..=7)
    )]
    pub(crate) slave: Vec<u8>,

    /// For all slaves, none of which acknowledges it
    #[arg(long)]
    pub(crate) broadcast: bool,

    /// Execute whoever acknowledges it
    #[arg(long, conflicts_with = "broadcast")]
    pub(crate) unchecked: bool,

    /// In frames of two clocks, which slaves understand whose data channels are off
    #[arg(long, requires = "broadcast", conflicts_with = "slave")]
    pub(crate) reduced: bool,

    /// How the record looks
    #[arg(short = 'o', long, value_enum, default_value_t = ReportFormat::Text)]
    pub(crate) format: ReportFormat,
}

/// Decimal, hexadecimal or binary.
fn number(text: &str) -> Option<u32> {
    let digits = |text: &str, radix| match text.starts_with('+') {
        true => None,
        false => u32::from_str_radix(text, radix).ok(),
    };
    match text.split_at_checked(2) {
        Some(("0x" | "0X", digits_)) => digits(digits_, 16),
        Some(("0b" | "0B", digits_)) => digits(digits_, 2),
        _ => digits(text, 10),
    }
}

/// The number that is `text[at]` of an argument, up to `most`.
fn part(text: &str, at: RangeInclusive<usize>, most: u8, what: &str) -> Result<u8, ParseError> {
    let (from, to) = at.into_inner();
    let part = &text[from..to];
    let fits = |number: &u32| *number <= u32::from(most);
    if let Some(number) = number(part).filter(fits) {
        return Ok(number as u8);
    }
    let what = match number(part) {
        Some(_) => format!("{what} end at {most:#04x}, and `{part}` is beyond"),
        None => format!("`{part}` is no number"),
    };
    let hint = "write it like 0x4d, 77 or 0b1001101; LINK stands before the verb";
    Err(ParseError::new(text, from..to, what, hint))
}

const REGISTERS: &str = "registers";

/// Registers one after the other, both ends included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Span {
    pub(crate) first: u8,
    pub(crate) last: u8,
}

impl Span {
    /// Everything that can be addressed.
    pub(crate) const ALL: Span = Span {
        first: 0,
        last: ADDRESSES - 1,
    };

    /// Its addresses.
    pub(crate) fn addresses(self) -> RangeInclusive<u8> {
        self.first..=self.last
    }
}

impl FromStr for Span {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Span, ParseError> {
        let address = |at| part(text, at, ADDRESSES - 1, REGISTERS);
        let Some((first, _)) = text.split_once("..") else {
            let only = address(0..=text.len())?;
            return Ok(Span {
                first: only,
                last: only,
            });
        };
        let behind = first.len() + 2;
        // As in other ranges of this kind, for those who are used to it.
        let behind = behind + usize::from(text[behind..].starts_with('='));
        let span = Span {
            first: address(0..=first.len())?,
            last: address(behind..=text.len())?,
        };
        if span.first > span.last {
            let what = format!("`{text}` ends before it begins");
            return Err(ParseError::usage(text, &what, "write the lower one first"));
        }
        Ok(span)
    }
}

/// What goes to a register and those behind it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Assign {
    pub(crate) address: u8,
    pub(crate) values: Vec<u8>,
}

impl FromStr for Assign {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Assign, ParseError> {
        let Some((before, values)) = text.split_once('=') else {
            let hint = "write it like 0x10=0x5a, and LINK before the verb";
            return Err(ParseError::usage(
                text,
                "a register and what goes there",
                hint,
            ));
        };
        let address = part(text, 0..=before.len(), ADDRESSES - 1, REGISTERS)?;
        let mut at = before.len() + 1;
        let mut bytes = Vec::new();
        for value in values.split(',') {
            bytes.push(part(text, at..=at + value.len(), u8::MAX, "values")?);
            at += value.len() + 1;
        }
        if usize::from(address) + bytes.len() > usize::from(ADDRESSES) {
            let what = format!("{} values reach beyond register 0x7f", bytes.len());
            return Err(ParseError::usage(text, &what, "0x7f is the last one"));
        }
        Ok(Assign {
            address,
            values: bytes,
        })
    }
}

/// Banks in the order they were given.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Banks(pub(crate) Vec<u8>);

impl FromStr for Banks {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Banks, ParseError> {
        let bank = |at| part(text, at, u8::MAX, "banks");
        let (mut banks, mut at) = (Vec::new(), 0);
        for item in text.split(',') {
            let end = at + item.len();
            let (first, last) = match item.split_once("..") {
                Some((first, _)) => {
                    let middle = at + first.len();
                    (bank(at..=middle)?, bank(middle + 2..=end)?)
                }
                None => (bank(at..=end)?, bank(at..=end)?),
            };
            for number in first..=last {
                if banks.contains(&number) {
                    let what = format!("bank {number} is there twice");
                    return Err(ParseError::new(text, at..end, what, "once is enough"));
                }
                banks.push(number);
            }
            if first > last {
                let what = format!("`{item}` ends before it begins");
                let hint = "write the lower one first";
                return Err(ParseError::new(text, at..end, what, hint));
            }
            at = end + 1;
        }
        Ok(Banks(banks))
    }
}

impl fmt::Display for Banks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let numbers: Vec<String> = self.0.iter().map(u8::to_string).collect();
        f.write_str(&numbers.join(","))
    }
}

/// A command, and whom its name is meant for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Code {
    pub(crate) code: u8,
    /// The name it was given by, and whether that is one of broadcasts.
    pub(crate) named: Option<(&'static str, bool)>,
}

/// Commands that have a name in the specification (D2, p. 18): the code, and whether it is a broadcast.
const NAMES: [(&str, u8, bool); 4] = [
    ("activate-data", 0b00, false),
    ("deactivate-control", 0b01, false),
    ("deactivate-data", 0b00, true),
    ("activate-control", 0b01, true),
];

impl FromStr for Code {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Code, ParseError> {
        if let Some((name, code, broadcast)) = NAMES.into_iter().find(|known| known.0 == text) {
            return Ok(Code {
                code,
                named: Some((name, broadcast)),
            });
        }
        let code = ["00", "01", "10", "11"]
            .iter()
            .position(|code| *code == text);
        match code {
            Some(code) => Ok(Code {
                code: code as u8,
                named: None,
            }),
            None => Err(ParseError::usage(
                text,
                "no such command",
                "in binary, as the specification writes them: 00 01 10 11; or activate-data and deactivate-control for \
                 slaves, deactivate-data and activate-control as broadcasts. It follows LINK",
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_have_both_their_ends() {
        let span = |text: &str| text.parse::<Span>().map(|span| (span.first, span.last));
        assert_eq!(span("0x40..0x7f"), Ok((0x40, 0x7F)));
        assert_eq!(span("64..=127"), Ok((0x40, 0x7F)));
        assert_eq!(span("0b11"), Ok((3, 3)));
        for (text, marked) in [
            ("0x80", 0..4),
            ("1..0x80", 3..7),
            ("2..1", 0..4),
            ("..", 0..0),
            ("1..", 3..3),
            ("", 0..0),
            ("+1", 0..2),
            ("0x", 0..2),
            ("sim", 0..3),
            ("é", 0..2),
            ("99999999999", 0..11),
        ] {
            let error = text.parse::<Span>().expect_err(text);
            assert_eq!(error.span(), marked, "{text}: {error}");
            drop(error.to_string());
        }
    }

    #[test]
    fn values_go_one_behind_the_other() {
        let assign = "0x7e=1,0xff".parse::<Assign>().unwrap();
        assert_eq!((assign.address, assign.values), (0x7E, vec![1, 255]));
        for (text, marked) in [
            ("0x10", 0..4),
            ("0x10=", 5..5),
            ("0x10=256", 5..8),
            ("0x10=1,,2", 7..7),
            ("0x7f=1,2", 0..8),
            ("x=1", 0..1),
        ] {
            let error = text.parse::<Assign>().expect_err(text);
            assert_eq!(error.span(), marked, "{text}: {error}");
            drop(error.to_string());
        }
    }

    #[test]
    fn banks_are_numbers_and_ranges() {
        let banks = |text: &str| text.parse::<Banks>().map(|banks| banks.0);
        assert_eq!(banks("2,0x10,4..6"), Ok(vec![2, 16, 4, 5, 6]));
        assert_eq!(banks("0..255").unwrap().len(), 256);
        for text in ["", "256", "1,1", "0..2,1", "3..1", "1,", "a"] {
            drop(banks(text).expect_err(text).to_string());
        }
    }

    #[test]
    fn codes_are_binary() {
        let code = |text: &str| text.parse::<Code>().map(|code| code.code);
        assert_eq!(code("10"), Ok(2));
        assert_eq!(code("activate-control"), Ok(1));
        for text in ["2", "0", "100", "activate", ""] {
            drop(code(text).expect_err(text).to_string());
        }
    }
}
