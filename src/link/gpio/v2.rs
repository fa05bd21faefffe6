//! The second interface (Linux 5.10), through gpiocdev. Inputs can have a pull.

use super::lines::{LineInfo, Refusal};
use gpiocdev::line::{Bias, Direction, Info, Value};
use gpiocdev::{Chip, Request};
use gpiocdev_uapi::v2::{Errno as Code, Error as Uapi};
use std::path::Path;

impl From<gpiocdev::Error> for Refusal {
    fn from(error: gpiocdev::Error) -> Refusal {
        let errno = match &error {
            gpiocdev::Error::Os(Code(code)) => Some(*code),
            gpiocdev::Error::Uapi(_, Uapi::Os(Code(code))) => Some(*code),
            _ => None,
        };
        Refusal {
            errno,
            said: error.to_string(),
        }
    }
}

fn info(line: Info) -> LineInfo {
    let given = |text: String| (!text.is_empty()).then_some(text);
    LineInfo {
        offset: line.offset,
        name: given(line.name),
        consumer: given(line.consumer),
        used: line.used,
        output: line.direction == Direction::Output,
    }
}

pub(super) fn lines(chip: &Path) -> Result<Vec<LineInfo>, Refusal> {
    let chip = Chip::from_path(chip)?;
    let all = chip.line_info_iter()?;
    all.map(|line| Ok(info(line?))).collect()
}

pub(super) fn line(chip: &Path, offset: u32) -> Result<LineInfo, Refusal> {
    Ok(info(Chip::from_path(chip)?.line_info(offset)?))
}

pub(super) fn output(
    chip: &Path,
    offset: u32,
    level: bool,
    consumer: &str,
) -> Result<Request, Refusal> {
    let mut request = Request::builder();
    request.on_chip(chip).with_consumer(consumer);
    request.with_line(offset).as_output(Value::from(level));
    Ok(request.request()?)
}

pub(super) fn input(
    chip: &Path,
    offset: u32,
    consumer: &str,
    bias: Option<Bias>,
) -> Result<Request, Refusal> {
    let mut request = Request::builder();
    request.on_chip(chip).with_consumer(consumer);
    request.with_line(offset).as_input().with_bias(bias);
    Ok(request.request()?)
}

/// An input with a pull-up; without one (then false is returned beside it) where the driver refuses it.
pub(super) fn pulled_up(
    chip: &Path,
    offset: u32,
    consumer: &str,
) -> Result<(Request, bool), Refusal> {
    match input(chip, offset, consumer, Some(Bias::PullUp)) {
        Ok(line) => Ok((line, true)),
        Err(refusal) if refusal.may_be_about_bias() => {
            Ok((input(chip, offset, consumer, None)?, false))
        }
        Err(refusal) => Err(refusal),
    }
}
