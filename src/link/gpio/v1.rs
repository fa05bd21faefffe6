//! The first interface, through gpio-cdev. A handle has one direction and no bias.

use super::lines::{LineInfo, Refusal};
use gpio_cdev::{Chip, Line, LineDirection, LineHandle, LineRequestFlags};
use nix::errno::Errno;
use std::error::Error as _;
use std::path::Path;

impl From<gpio_cdev::Error> for Refusal {
    fn from(error: gpio_cdev::Error) -> Refusal {
        let errno = error.source().and_then(|source| {
            let of_ioctl = source.downcast_ref::<Errno>().map(|errno| *errno as i32);
            let of_io = || source.downcast_ref::<std::io::Error>()?.raw_os_error();
            of_ioctl.or_else(of_io)
        });
        Refusal {
            errno,
            said: error.to_string(),
        }
    }
}

fn info(line: &Line) -> Result<LineInfo, Refusal> {
    let info = line.info()?;
    Ok(LineInfo {
        offset: line.offset(),
        name: info.name().map(str::to_owned),
        consumer: info.consumer().map(str::to_owned),
        // Not `is_used`, which holds for every output: what gpio-cdev calls KERNEL is the flag for lines in use.
        used: info.is_kernel(),
        output: info.direction() == LineDirection::Out,
    })
}

pub(super) fn lines(chip: &Path) -> Result<Vec<LineInfo>, Refusal> {
    Chip::new(chip)?.lines().map(|line| info(&line)).collect()
}

pub(super) fn line(chip: &Path, offset: u32) -> Result<LineInfo, Refusal> {
    info(&Chip::new(chip)?.get_line(offset)?)
}

/// An output at `level`, or an input when there is none.
pub(super) fn request(
    chip: &Path,
    offset: u32,
    level: Option<bool>,
    consumer: &str,
) -> Result<LineHandle, Refusal> {
    let flags = match level {
        Some(_) => LineRequestFlags::OUTPUT,
        None => LineRequestFlags::INPUT,
    };
    let line = Chip::new(chip)?.get_line(offset)?;
    Ok(line.request(flags, level.unwrap_or_default().into(), consumer)?)
}
