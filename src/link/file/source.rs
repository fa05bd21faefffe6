//! What readers of recordings have in common.

use crate::slice::Slicer;

/// A one-bit signal of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Channel {
    /// As the file names it, without what it stands in.
    pub(super) name: String,
    /// With what it stands in, `top.encoder.ma`; else the name.
    pub(super) path: String,
    /// What [`Source::select`] wants. Two channels with the same one are the same signal.
    pub(super) id: usize,
}

/// What a recording's reader stumbled over.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Damage {
    /// `line 12`, `byte 4711`.
    pub(super) place: String,
    /// What is wrong there.
    pub(super) said: String,
}

/// A reader of one kind of recording. Its header has been read.
pub(super) trait Source {
    /// What there is to choose from.
    fn channels(&self) -> &[Channel];

    /// What else bears this name, though it is not worth a place in the list: one bit of a vector.
    fn named(&mut self, _name: &str) -> Vec<Channel> {
        Vec::new()
    }

    /// The one with this number, counted from 0, where there is no name.
    fn numbered(&self, number: usize) -> Option<Channel> {
        self.channels().get(number).cloned()
    }

    /// Which of them are MA and SLO. Once, before anything is read.
    fn select(&mut self, ma: usize, slo: usize);

    /// Reads on, a block at a time, and hands what it finds to `slicer`. False at the end.
    ///
    /// # Errors
    /// Where it can read no further; everything before that place has been handed over.
    fn read(&mut self, slicer: &mut Slicer) -> Result<bool, Damage>;

    /// How far it has come.
    fn now_ns(&self) -> u64;

    /// Hands over what it has kept, after the last [`Source::read`], whatever ended that.
    fn finish(&mut self, _slicer: &mut Slicer) {}
}

/// From one sample to the next.
pub(super) fn step_fs(rate_hz: u64) -> u64 {
    const SECOND_FS: u64 = 1_000_000_000_000_000;
    (SECOND_FS + rate_hz / 2) / rate_hz.max(1)
}
