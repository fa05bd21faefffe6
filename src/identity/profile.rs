//! The profile EDS of an encoder: how the position of one channel is made up.
//!
//! As in NXP's driver (mcuxsdk-core, drivers/biss), except for the byte order: numbers are big endian (D2, p. 20), NXP
//! reads them into little-endian ones as they come.

use super::map::{Field, Said, Window, field, unnamed};

/// A decoded profile EDS.
///
/// ```
/// use biss::identity::{Cell, Encoder, ProfileEds, Window};
///
/// let mut window = Window::of(0x00, &[0; 64]);
/// window.set(0x0A, Cell::Byte(12)); // MTLEN
/// window.set(0x1F, Cell::Byte(0x43)); // CPOLY, low byte last
/// let profile = ProfileEds::decode(&window);
/// assert_eq!(profile.encoder, Some(Encoder::Rotary));
/// assert_eq!((profile.turn_bits, profile.poly), (Some(12), Some(0x43)));
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProfileEds {
    /// ENTYP.
    pub encoder: Option<Encoder>,
    /// MTLEN: bits of the turn counter, at most 62.
    pub turn_bits: Option<u8>,
    /// MTFMT: how the turns are aligned; the codes are not published.
    pub turn_format: Option<u8>,
    /// SIPCNT: what one turn or step is divided into; NXP calls it the step.
    pub step: Option<u32>,
    /// CPOLY as the registers have it, big endian.
    pub poly: Option<u32>,
    /// CSTART, the start value of the CRC, big endian.
    pub start: Option<u32>,
    /// Why not to believe it; `None` where it is consistent.
    pub distrust: Option<&'static str>,
    /// Every group of registers, in address order.
    pub fields: Vec<Field>,
}

/// What moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoder {
    /// ENTYP 0.
    Rotary,
    /// ENTYP 1.
    Linear,
}

impl ProfileEds {
    /// What a bank says when it is read as the profile EDS of an encoder. Never panics.
    pub fn decode(window: &Window) -> ProfileEds {
        let byte = |address| window.get(address).byte();
        let distrust = match (window.uniform(), byte(0x08), byte(0x0A)) {
            (Some(0xFF), ..) => Some("all registers are 0xFF: never written"),
            (Some(0x00), ..) => Some("all registers are 0"),
            _ if !window.any_byte() => Some("no register could be read"),
            (_, Some(2..), _) => Some("ENTYP is neither rotary nor linear"),
            (_, _, Some(63..)) => Some("MTLEN leaves no position"),
            _ => None,
        };
        let fields = listed(window);
        let number = |name| {
            let field = fields.iter().find(|field| field.name == name)?;
            u32::try_from(field.value?).ok()
        };
        ProfileEds {
            encoder: match byte(0x08) {
                Some(0) => Some(Encoder::Rotary),
                Some(1) => Some(Encoder::Linear),
                _ => None,
            },
            turn_bits: byte(0x0A).filter(|bits| *bits <= 62),
            turn_format: byte(0x0B),
            step: number("SIPCNT"),
            poly: number("CPOLY"),
            start: number("CSTART"),
            distrust,
            fields,
        }
    }
}

fn listed(window: &Window) -> Vec<Field> {
    let one = |offset, name, say: fn(u64) -> Said| field(window, offset, 1, name, say);
    let four = |offset, name, say: fn(u64) -> Said| field(window, offset, 4, name, say);
    let rest = |offset, len| unnamed(window, offset, len, "", "not in the published layout");
    vec![
        rest(0x00, 8),
        one(0x08, "ENTYP", |number| match number {
            0 => ("rotary".into(), None),
            1 => ("linear".into(), None),
            _ => (format!("type {number}"), Some("not published")),
        }),
        rest(0x09, 1),
        one(0x0A, "MTLEN", |bits| {
            let doubt = (bits > 62).then_some("leaves no position");
            (format!("{bits} bits of turns"), doubt)
        }),
        one(0x0B, "MTFMT", |number| {
            let doubt = "which code is which alignment is not published";
            (format!("alignment of the turns: {number}"), Some(doubt))
        }),
        rest(0x0C, 8),
        four(0x14, "SIPCNT", |number| {
            (format!("resolution {number}"), Some(super::eds::NO_UNIT))
        }),
        rest(0x18, 4),
        four(0x1C, "CPOLY", polynomial),
        four(0x20, "CSTART", |number| {
            let swapped = (number as u32).swap_bytes();
            let low_first = number > 0xFFFF && swapped <= 0xFFFF;
            let doubt = match number {
                0..=0xFFFF => None,
                _ if low_first => Some("fits with the low byte first only, as NXP reads it"),
                _ => Some("too large for a CRC of 16 bits"),
            };
            (format!("CRC starts with {number:#X}"), doubt)
        }),
        rest(0x24, 0x1C),
    ]
}

fn polynomial(number: u64) -> Said {
    if number == 0 {
        return ("no polynomial".into(), None);
    }
    let read = super::wide_readings(number as u32);
    let words: Vec<String> = read.iter().map(|(poly, _)| format!("{poly:#X}")).collect();
    let doubt = match read.first() {
        None => Some("no polynomial in any reading"),
        Some((_, true)) => Some("fits with the low byte first only, as NXP reads it"),
        Some(_) if words.len() > 1 => Some("with or without the constant term: not published"),
        Some(_) => None,
    };
    let words = match words.len() {
        0 => format!("{number:#X}"),
        _ => words.join(" or "),
    };
    (format!("CRC {words}"), doubt)
}
