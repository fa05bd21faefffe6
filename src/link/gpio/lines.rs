//! Chips and lines, alike whichever interface the kernel has: v1 where it was not left out, else v2.

use super::{v1, v2};
use crate::link::{Error, Uapi};
use libc::{EACCES, EBUSY, EINVAL, ENOENT, ENOTTY, EOPNOTSUPP, EPERM};
use std::path::{Path, PathBuf};

/// What a chip says of itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChipInfo {
    /// Its device file.
    pub path: PathBuf,
    /// The kernel's name: `gpiochip0`.
    pub name: String,
    /// The driver's name: `pinctrl-bcm2711`.
    pub label: String,
    /// How many lines it has.
    pub lines: u32,
}

/// What a line says of itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LineInfo {
    /// Its number on the chip.
    pub offset: u32,
    /// The board's name for it: `GPIO17`.
    pub name: Option<String>,
    /// Who holds it.
    pub consumer: Option<String>,
    /// Somebody holds it, whether or not he gave a name.
    pub used: bool,
    /// It is an output.
    pub output: bool,
}

/// The chips of this machine.
#[derive(Debug, Default)]
pub struct Chips {
    /// Those that can be opened, by number.
    pub found: Vec<ChipInfo>,
    /// Those that cannot, and why.
    pub refused: Vec<(PathBuf, Error)>,
}

/// What one of the two crates said, and the errno in it.
pub(super) struct Refusal {
    pub(super) errno: Option<i32>,
    pub(super) said: String,
}

/// What drivers say inside the kernel for what they cannot do. It should not come out, but does.
const ENOTSUPP: i32 = 524;

impl Refusal {
    pub(super) fn may_be_about_bias(&self) -> bool {
        matches!(self.errno, Some(EOPNOTSUPP | EINVAL | ENOTSUPP))
    }

    fn into_error(self, doing: impl Into<String>, hint: impl Into<String>) -> Error {
        Error::new(doing, self.said, hint)
    }
}

const NAMING: &str = "a chip is given by number, name, label or path";
const NO_PERMISSION: &str =
    "this user may not use it: join its group (usually `gpio`), or run as root";

fn hint(errno: Option<i32>) -> &'static str {
    match errno {
        Some(EACCES | EPERM) => NO_PERMISSION,
        _ => NAMING,
    }
}

fn open(path: &Path) -> Result<ChipInfo, Refusal> {
    let chip = gpio_cdev::Chip::new(path)?;
    Ok(ChipInfo {
        path: path.to_owned(),
        name: chip.name().to_owned(),
        label: chip.label().to_owned(),
        lines: chip.num_lines(),
    })
}

/// Everything in `/dev` that is called a GPIO chip.
///
/// # Errors
/// When `/dev` cannot be read.
pub fn all_chips() -> Result<Chips, Error> {
    let failed = |e| Error::new("looking for GPIO chips", e, "is /dev mounted?");
    let mut paths = Vec::new();
    for entry in std::fs::read_dir("/dev").map_err(failed)? {
        let entry = entry.map_err(failed)?;
        if entry
            .file_name()
            .as_encoded_bytes()
            .starts_with(b"gpiochip")
        {
            // Boards link old names to new ones: that is one chip.
            paths.push(entry.path().canonicalize().unwrap_or(entry.path()));
        }
    }
    paths.sort_by_key(|path| (path.as_os_str().len(), path.clone()));
    paths.dedup();
    let mut chips = Chips::default();
    for path in paths {
        match open(&path) {
            Ok(chip) if chips.found.iter().any(|other| other.name == chip.name) => {}
            Ok(chip) => chips.found.push(chip),
            Err(refusal) => {
                let hint = hint(refusal.errno);
                let doing = format!("opening the GPIO chip {}", path.display());
                chips.refused.push((path, refusal.into_error(doing, hint)));
            }
        }
    }
    Ok(chips)
}

/// The chips that can be opened; never an empty list.
///
/// # Errors
/// When there is none, or none that this user may use.
pub fn chips() -> Result<Vec<ChipInfo>, Error> {
    let Chips { found, refused } = all_chips()?;
    if !found.is_empty() {
        return Ok(found);
    }
    Err(match refused.into_iter().next() {
        Some((_, error)) => error,
        None => Error::new(
            "looking for GPIO chips",
            "this machine has no /dev/gpiochip*",
            "`biss read sim` works without",
        ),
    })
}

/// The chips among which lines are looked for: the one given by number, name, label or path, else all.
///
/// # Errors
/// When the chip does not exist, may not be used, or is one of several with this label.
pub fn among(chip: Option<&str>) -> Result<Vec<ChipInfo>, Error> {
    let Some(text) = chip else { return chips() };
    let path = match text.parse::<u32>() {
        Ok(number) => format!("/dev/gpiochip{number}"),
        Err(_) if text.starts_with('/') => text.to_owned(),
        Err(_) if text.starts_with("gpiochip") => format!("/dev/{text}"),
        Err(_) => return labelled(text).map(|chip| vec![chip]),
    };
    let chip = open(Path::new(&path)).map_err(|refusal| {
        let hint = match refusal.errno {
            Some(ENOENT) => present(),
            errno => hint(errno).into(),
        };
        refusal.into_error(format!("opening the GPIO chip {path}"), hint)
    })?;
    Ok(vec![chip])
}

fn present() -> String {
    let chips = chips().unwrap_or_default();
    let names: Vec<_> = chips
        .iter()
        .map(|chip| format!("{} [{}]", chip.name, chip.label))
        .collect();
    match names.is_empty() {
        true => format!("there is none; {NAMING}"),
        false => format!("present: {}; {NAMING}", names.join(", ")),
    }
}

fn labelled(label: &str) -> Result<ChipInfo, Error> {
    let doing = format!("looking for the GPIO chip `{label}`");
    let mut fitting = chips()?;
    fitting.retain(|chip| chip.label == label);
    match fitting.len() {
        1 => Ok(fitting.remove(0)),
        0 => Err(Error::new(
            doing,
            "no chip has this name or label",
            present(),
        )),
        _ => {
            let all: Vec<_> = fitting.iter().map(|chip| chip.name.as_str()).collect();
            Err(Error::new(
                doing,
                format!("several chips have this label: {}", all.join(", ")),
                "name one of them",
            ))
        }
    }
}

fn line(chip: &ChipInfo, offset: u32, uapi: Uapi) -> Result<LineInfo, Refusal> {
    match uapi {
        Uapi::V1 => v1::line(&chip.path, offset),
        Uapi::V2 => v2::line(&chip.path, offset),
    }
}

fn asking(chip: &ChipInfo) -> impl Fn(Refusal) -> Error {
    move |refusal| {
        let doing = format!("asking {} about its lines", chip.name);
        refusal.into_error(doing, "`biss list` shows what the chip says")
    }
}

/// Every line of a chip.
///
/// # Errors
/// When the chip is gone, or the kernel does not have this interface.
pub fn lines(chip: &ChipInfo, uapi: Uapi) -> Result<Vec<LineInfo>, Error> {
    match uapi {
        Uapi::V1 => v1::lines(&chip.path),
        Uapi::V2 => v2::lines(&chip.path),
    }
    .map_err(asking(chip))
}

/// Whether the kernel has this interface. It opens chips in any case, and refuses calls that it was built without with
/// EINVAL; what is asked here changes nothing.
///
/// # Errors
/// When the chip is gone.
pub fn has(chip: &ChipInfo, uapi: Uapi) -> Result<bool, Error> {
    match line(chip, 0, uapi) {
        Ok(_) => Ok(true),
        Err(refusal) if matches!(refusal.errno, Some(EINVAL | ENOTTY)) => Ok(false),
        Err(refusal) => Err(asking(chip)(refusal)),
    }
}

/// The interface that is used when nobody says which: v1 where the kernel has it, else v2.
///
/// # Errors
/// When it has neither, or the chip is gone.
pub fn uapi(chip: &ChipInfo) -> Result<Uapi, Error> {
    for uapi in [Uapi::V1, Uapi::V2] {
        if has(chip, uapi)? {
            return Ok(uapi);
        }
    }
    Err(Error::new(
        format!("asking {} about its lines", chip.name),
        "this kernel answers neither GPIO v1 nor v2 calls",
        "boot a kernel that does, or connect the encoder to SPI: biss read spi:0.0",
    ))
}

/// The one that was asked for, else as [`uapi`]. The interface is the kernel's, so any chip can tell.
///
/// # Errors
/// When the kernel does not have it.
pub fn choose(chip: &ChipInfo, wanted: Option<Uapi>) -> Result<Uapi, Error> {
    let Some(wanted) = wanted else {
        return uapi(chip);
    };
    if has(chip, wanted)? {
        return Ok(wanted);
    }
    let (said, hint) = match wanted {
        Uapi::V1 => (
            "this kernel has no GPIO v1 interface (CONFIG_GPIO_CDEV_V1 is off)",
            "leave out uapi=v1: biss takes v2 by itself",
        ),
        Uapi::V2 => (
            "this kernel has no GPIO v2 interface, which Linux 5.10 brought",
            "leave out uapi=v2: biss takes v1 by itself",
        ),
    };
    Err(Error::new(
        format!("using GPIO {wanted} on {}", chip.name),
        said,
        hint,
    ))
}

/// A line that exists.
#[derive(Clone, Debug)]
pub struct Place {
    chip: ChipInfo,
    offset: u32,
    uapi: Uapi,
    /// For messages.
    shown: String,
}

/// Looks for a line by name, or by number when `chips` is one chip.
///
/// # Errors
/// When there is no such line, or several.
pub fn find(chips: &[ChipInfo], wanted: &str, uapi: Uapi) -> Result<Place, Error> {
    let place = |chip: &ChipInfo, offset, shown| Place {
        chip: chip.clone(),
        offset,
        uapi,
        shown,
    };
    if let (Ok(offset), [chip]) = (wanted.parse::<u32>(), chips) {
        let shown = format!("line {offset} of {}", chip.name);
        if offset < chip.lines {
            return Ok(place(chip, offset, shown));
        }
        let last = chip.lines.saturating_sub(1);
        return Err(Error::new(
            format!("looking for {shown}"),
            format!("{} has the lines 0 to {last}", chip.name),
            "lines are given by number or by name",
        ));
    }
    let mut found = Vec::new();
    for chip in chips {
        for line in lines(chip, uapi)? {
            if line.name.as_deref() == Some(wanted) {
                let shown = format!("line {wanted} ({} {})", chip.name, line.offset);
                found.push(place(chip, line.offset, shown));
            }
        }
    }
    let doing = format!("looking for the line `{wanted}`");
    match found.len() {
        1 => Ok(found.remove(0)),
        0 => Err(Error::new(
            doing,
            "no line has this name",
            "`biss list -v` shows names; a number needs its chip: gpio:0,ma=17,slo=27",
        )),
        _ => {
            let all: Vec<_> = found.iter().map(|place| place.shown.as_str()).collect();
            Err(Error::new(
                doing,
                format!("several lines have this name: {}", all.join(", ")),
                "say which chip: gpio:CHIP,ma=…,slo=…",
            ))
        }
    }
}

impl Place {
    /// How messages call it.
    pub fn shown(&self) -> &str {
        &self.shown
    }

    /// Which chip and line.
    pub fn is_same(&self, other: &Place) -> bool {
        self.chip.name == other.chip.name && self.offset == other.offset
    }

    /// Requests it as an output that starts at `level`. `role` is what the line is: `MA`.
    ///
    /// # Errors
    /// When somebody holds it, or this user may not use it.
    pub fn output(&self, role: &'static str, level: bool) -> Result<Line, Error> {
        self.request(role, Some(level), false)
    }

    /// Requests it as an input, on v2 with a pull-up.
    ///
    /// # Errors
    /// When somebody holds it, or this user may not use it.
    pub fn input(&self, role: &'static str) -> Result<Line, Error> {
        self.request(role, None, true)
    }

    /// Requests it as an input without touching its pull, to look at a line that is an input already.
    ///
    /// # Errors
    /// When somebody holds it, or this user may not use it.
    pub fn watch(&self, role: &'static str) -> Result<Line, Error> {
        self.request(role, None, false)
    }

    fn request(
        &self,
        role: &'static str,
        level: Option<bool>,
        pull_up: bool,
    ) -> Result<Line, Error> {
        let consumer = format!("biss {role}");
        let doing = format!("requesting {} as {consumer}", self.shown);
        let info = line(&self.chip, self.offset, self.uapi).map_err(asking(&self.chip))?;
        if info.used {
            let holder = info.consumer.as_deref().unwrap_or("the kernel");
            return Err(Error::new(
                doing,
                format!("it is held by `{holder}`"),
                "free it, or wire the encoder to another line",
            ));
        }
        let (chip, offset) = (self.chip.path.as_path(), self.offset);
        let taken = match (self.uapi, level) {
            (Uapi::V1, _) => v1::request(chip, offset, level, &consumer)
                .map(|handle| (Held::V1(handle), Pull::AsItWas)),
            (Uapi::V2, Some(level)) => v2::output(chip, offset, level, &consumer)
                .map(|request| (Held::V2(request), Pull::AsItWas)),
            (Uapi::V2, None) if pull_up => {
                v2::pulled_up(chip, offset, &consumer).map(|(request, up)| {
                    let pull = if up { Pull::Up } else { Pull::Refused };
                    (Held::V2(request), pull)
                })
            }
            (Uapi::V2, None) => v2::input(chip, offset, &consumer, None)
                .map(|request| (Held::V2(request), Pull::AsItWas)),
        };
        match taken {
            Ok((held, pull)) => Ok(Line { held, role, pull }),
            Err(refusal) => {
                let hint = match refusal.errno {
                    Some(EBUSY) => "somebody else took it just now; `biss list` shows who",
                    Some(EACCES | EPERM) => NO_PERMISSION,
                    _ => "`biss list -v` shows what the line says",
                };
                Err(refusal.into_error(doing, hint))
            }
        }
    }
}

/// The pull of a requested line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pull {
    /// Nobody asked for one.
    AsItWas,
    /// A pull-up was asked for, and the driver did not refuse it. One without pulls may say nothing.
    Up,
    /// A pull-up was asked for, but the driver has none.
    Refused,
}

#[derive(Debug)]
enum Held {
    V1(gpio_cdev::LineHandle),
    V2(gpiocdev::Request),
}

/// A requested line. Setting and reading it is one call of the kernel's and allocates nothing.
#[derive(Debug)]
pub struct Line {
    held: Held,
    role: &'static str,
    pull: Pull,
}

const LOST: &str = "the line was lost: was the chip or its driver removed?";

impl Line {
    /// Drives it.
    ///
    /// # Errors
    /// When it is gone, or an input.
    pub fn set(&self, high: bool) -> Result<(), Error> {
        match &self.held {
            Held::V1(handle) => handle.set_value(high.into()).map_err(Refusal::from),
            Held::V2(request) => request.set_lone_value(high.into()).map_err(Refusal::from),
        }
        .map_err(|refusal| refusal.into_error(format!("driving {}", self.role), LOST))
    }

    /// Reads it.
    ///
    /// # Errors
    /// When it is gone.
    pub fn get(&self) -> Result<bool, Error> {
        match &self.held {
            Held::V1(handle) => match handle.get_value() {
                Ok(level) => Ok(level != 0),
                Err(e) => Err(Refusal::from(e)),
            },
            Held::V2(request) => match request.lone_value() {
                Ok(level) => Ok(level.into()),
                Err(e) => Err(Refusal::from(e)),
            },
        }
        .map_err(|refusal| refusal.into_error(format!("reading {}", self.role), LOST))
    }

    /// Its pull.
    pub fn pull(&self) -> Pull {
        self.pull
    }
}
