//! What one frame cannot tell and a row of them can: where the start bit may stand, how long the line delays, and whether
//! the sign-of-life counter counts.

use crate::cycle::{Cycle, Fault, Head};
use crate::format::{Format, Kind, MAX_CHANNELS};
use crate::pair;
use crate::trace::Trace;

/// What to do with a cycle that was judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It stands as it is, good or not.
    Stands,
    /// Nothing is wrong with it but where its start bit stands, or its line delay: read again before it counts.
    Doubtful(Fault),
}

/// Learned from frame to frame, in the order they came.
#[derive(Clone, Debug, Default)]
pub struct Tracker {
    heads: Heads,
    line: LineDelay,
    delay_clk: Option<u16>,
    life: [Option<Life>; MAX_CHANNELS],
}

impl Tracker {
    /// A recording cannot be read again, so its first good frame teaches where the start bit stands and the line delay.
    pub fn trusting() -> Tracker {
        Tracker {
            heads: Heads {
                trusting: true,
                ..Heads::default()
            },
            line: LineDelay {
                trusting: true,
                ..LineDelay::default()
            },
            ..Tracker::default()
        }
    }

    /// Judges a decoded cycle and learns from it. Words whose sign of life is wrong become faults, and both words of a
    /// safety pair that does not agree.
    pub fn judge(&mut self, format: &Format, trace: &Trace, cycle: &mut Cycle) -> Verdict {
        self.check_life(format, cycle);
        let verdict = self.place(trace, cycle);
        // Two words with good CRCs are where they belong, whether they agree or not: compared after that is learned.
        pair::compare(format, cycle);
        verdict
    }

    fn place(&mut self, trace: &Trace, cycle: &Cycle) -> Verdict {
        let (Some(head), true) = (cycle.head(), cycle.fault().is_none()) else {
            self.heads.doubt();
            return Verdict::Stands;
        };
        if cycle.words().is_empty() {
            self.heads.reach(head.clocks());
            self.delay_clk = self.delay_clk.max(Some(head.delay_clk));
            return Verdict::Stands;
        }
        let good = cycle
            .words()
            .iter()
            .filter(|word| word.good().is_some())
            .count();
        let null = cycle
            .words()
            .iter()
            .filter(|word| word.fault() == Some(Fault::Null))
            .count();
        if good + null == 0 {
            // A wrong window fails its CRCs nearly always; there is nothing to learn from it.
            self.heads.doubt();
            return Verdict::Stands;
        }
        let sound = good + null == cycle.words().len();
        let clocks = head.clocks();
        let delay = trace.delay_ns.zip(trace.ma_period_ns);
        let strange = delay.and_then(|(ns, period_ns)| self.line.strange(ns, period_ns, sound));
        let start = Start {
            shown: strange.is_none() && Start::shows(trace, head),
            ..Start::of(trace, head)
        };
        let placed = self.heads.learn(start, sound);
        if let (true, Some(fault)) = (placed, strange) {
            return Verdict::Doubtful(fault);
        }
        if placed {
            self.delay_clk = self.delay_clk.max(Some(head.delay_clk));
            return Verdict::Stands;
        }
        let (low, high) = self.heads.range.unwrap_or((clocks, clocks));
        Verdict::Doubtful(Fault::Mismatch {
            head: clocks,
            low,
            high,
        })
    }

    /// Of a recording what comes after a cycle may vouch for it, that is doubtful for where its start bit stands. Takes the
    /// cycles behind it, one after the other and counted from 1, and learns nothing else from them; `None` asks for the next one.
    pub fn vouch(&mut self, later: u8, trace: &Trace, cycle: &Cycle) -> Option<bool> {
        let whole = trace.cut.is_none() && !trace.unconfirmed && cycle.fault().is_none();
        let fine = |fault: Option<Fault>| matches!(fault, None | Some(Fault::Null));
        let sound = whole && cycle.words().iter().all(|word| fine(word.fault()));
        let Some(head) = cycle.head().filter(|_| sound) else {
            return Some(false);
        };
        let delay = trace.delay_ns.zip(trace.ma_period_ns);
        let known = delay.is_some_and(|(ns, period_ns)| self.line.is_known(ns, period_ns));
        let start = Start {
            shown: known && Start::shows(trace, head),
            ..Start::of(trace, head)
        };
        self.heads.vouch(later, start)
    }

    /// Least and most clocks from edge 2 to the start edge that are trusted.
    pub fn heads(&self) -> Option<(u16, u16)> {
        self.heads.range
    }

    /// Most whole clocks of line delay seen.
    pub fn delay_clk(&self) -> Option<u16> {
        self.delay_clk
    }

    /// Forgets where the start bit stands and what was counted, after the sampling phase or the clock has changed, or
    /// frames were run that nobody judged.
    pub fn forget(&mut self) {
        self.heads = Heads {
            trusting: self.heads.trusting,
            ..Heads::default()
        };
        self.line = LineDelay {
            trusting: self.line.trusting,
            ..LineDelay::default()
        };
        self.delay_clk = None;
        self.lose_count();
    }

    /// The slave may have latched more or less often than frames were judged: signs of life begin anew.
    pub fn lose_count(&mut self) {
        self.life = [None; MAX_CHANNELS];
    }

    fn check_life(&mut self, format: &Format, cycle: &mut Cycle) {
        if cycle.fault().is_some() {
            // The slave may have latched once, twice or never.
            self.lose_count();
            return;
        }
        for ((life, channel), word) in self
            .life
            .iter_mut()
            .zip(format.channels())
            .zip(cycle.words_mut())
        {
            let Some(field) = channel.find(|k| *k == Kind::Life) else {
                continue;
            };
            let Some(data) = word.good() else {
                if let Some(life) = life {
                    life.missed += 1;
                }
                continue;
            };
            let (got, wrap) = (field.get(data), u64::MAX >> (64 - u32::from(field.bits())));
            if let Some(want) = life.and_then(|l| l.mismatch(got, wrap)) {
                word.spoil(Fault::Life { got, want });
            }
            *life = Some(Life {
                last: got,
                missed: 0,
            });
        }
    }
}

/// The sign-of-life counter of one channel.
#[derive(Clone, Copy, Debug)]
struct Life {
    last: u64,
    missed: u64,
}

impl Life {
    /// What was expected, if not `got`. Devices wrap to 0 or, like iC-MHM, skip it (SAF; MHM datasheet).
    fn mismatch(&self, got: u64, wrap: u64) -> Option<u64> {
        let before = self.last.wrapping_add(self.missed);
        let want = before.wrapping_add(1) & wrap;
        // One bit that skips 0 would count nothing.
        let skipping = (wrap > 1).then(|| before % wrap + 1);
        (got != want && Some(got) != skipping).then_some(want)
    }
}

/// Where the start bit of a frame stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Start {
    /// Clocks from edge 2.
    clocks: u16,
    /// Clocks from there to the last one.
    left: u16,
    /// SL changed twice until then, both times with a clock, and the line delay is the one that is known.
    shown: bool,
}

impl Start {
    fn of(trace: &Trace, head: Head) -> Start {
        Start {
            clocks: head.clocks(),
            left: (trace.bits.len() as u16).saturating_sub(head.clocks()),
            shown: false,
        }
    }

    /// Whether Ack and start bit stand whole clocks apart where they were measured too. A spike in Ack or a start bit that is
    /// missing leaves SL elsewhere, but for one that is exactly a bit.
    fn shows(trace: &Trace, head: Head) -> bool {
        let (Some(period), Some(busy)) = (trace.ma_period_ns, trace.busy_ns) else {
            return false;
        };
        let clocked = u32::from(head.ack).saturating_mul(period);
        trace.delay_ns.is_some() && busy.abs_diff(clocked) <= period / 4 + 1
    }
}

/// How many clocks after edge 2 the start bit may stand.
///
/// A length counts once it has been seen twice within a few frames, or lies between two that have: an encoder's busy
/// time wanders, and a flipped bit does not come back so soon at the same place with a good CRC.
///
/// A recording shows more. A start bit that is misread gives a bad frame far more often than a good one, so two good frames
/// close to each other, nothing bad between them, are two of an encoder whose busy time wanders by more. And a master that
/// counts from the start bit on has seen it where it was read here: then it clocks as often behind it in every frame, wherever
/// it stood.
#[derive(Clone, Copy, Debug, Default)]
struct Heads {
    range: Option<(u16, u16)>,
    /// Seen once: outside the range, or before there is one.
    candidate: Option<Candidate>,
    counted: Counted,
    trusting: bool,
}

#[derive(Clone, Copy, Debug)]
struct Candidate {
    start: Start,
    /// Frames since.
    age: u8,
    /// One of them was bad.
    doubted: bool,
}

impl Candidate {
    /// Whether another start vouches for this one, wherever it stands.
    fn agrees(&self, other: Start) -> bool {
        self.start.shown && other.shown && !self.doubted
    }
}

/// A master that ran as many clocks behind the start bit so often, and one time more, counts them from there.
const COUNTED_FRAMES: u8 = 3;

/// How many clocks a master ran behind the start bit, in good frames one after the other.
#[derive(Clone, Copy, Debug, Default)]
struct Counted {
    last: Option<Start>,
    /// As many in so many frames.
    frames: u8,
    /// In which the start bit stood at different places.
    wandered: bool,
}

impl Counted {
    fn note(&mut self, start: Start) {
        let same = self.last.filter(|last| last.left == start.left);
        *self = match same {
            Some(last) => Counted {
                last: Some(start),
                frames: self.frames.saturating_add(1),
                wandered: self.wandered || last.clocks != start.clocks,
            },
            None => Counted {
                last: Some(start),
                ..Counted::default()
            },
        };
    }

    /// Whether the master has seen the start bit there.
    fn agrees(&self, start: Start) -> bool {
        let same = self.last.is_some_and(|last| last.left == start.left);
        start.shown && same && self.wandered && self.frames >= COUNTED_FRAMES
    }
}

/// A candidate that has not come back within so many frames was noise: an encoder that stands still would show the
/// same wrong frame again, however much later.
const CANDIDATE_FRAMES: u8 = 8;

impl Heads {
    /// A head without a word: no CRC tells which start bit is right, so none is doubted. Clocks are planned for the longest.
    fn reach(&mut self, clocks: u16) {
        let (low, high) = self.range.unwrap_or((clocks, clocks));
        self.range = Some((low.min(clocks), high.max(clocks)));
    }

    /// A frame was bad.
    fn doubt(&mut self) {
        self.counted = Counted::default();
        if let Some(candidate) = &mut self.candidate {
            candidate.doubted = true;
        }
    }

    /// Whether a frame of this length counts. `sound` frames have no bad word.
    fn learn(&mut self, start: Start, sound: bool) -> bool {
        if !sound {
            self.doubt();
        }
        let clocks = start.clocks;
        if self.holds(clocks) {
            self.counted.note(start);
            self.candidate = self
                .candidate
                .map(|c| Candidate {
                    age: c.age + 1,
                    ..c
                })
                .filter(|c| c.age < CANDIDATE_FRAMES);
            return true;
        }
        if self.range.is_some() && !sound {
            // A shifted window may give one of several channels a good CRC; it teaches nothing.
            return false;
        }
        if self.trusting && self.counted.agrees(start) {
            self.counted.note(start);
            self.reach(clocks);
            return true;
        }
        let seen = self.candidate.replace(Candidate {
            start,
            age: 0,
            doubted: false,
        });
        let agrees = |seen: &Candidate| !self.holds(seen.start.clocks) && seen.agrees(start);
        if let Some(seen) = seen.filter(|seen| self.trusting && agrees(seen)) {
            self.counted.note(start);
            self.reach(seen.start.clocks);
            self.reach(clocks);
            return true;
        }
        let seen = seen
            .map(|c| c.start.clocks)
            .filter(|seen| seen.abs_diff(clocks) <= 1);
        let (low, high) = match (self.range, seen) {
            (None, None) if self.trusting && sound => (clocks, clocks),
            (_, None) => return false,
            (None, Some(seen)) => (seen.min(clocks), seen.max(clocks)),
            // Only as far as both sightings reach.
            (Some((low, high)), Some(seen)) if clocks < low => (seen.max(clocks), high),
            (Some((low, _)), Some(seen)) => (low, seen.min(clocks)),
        };
        self.range = Some((low, high));
        self.counted.note(start);
        self.holds(clocks)
    }

    fn holds(&self, clocks: u16) -> bool {
        let range = self.range;
        range.is_some_and(|(low, high)| (low..=high).contains(&clocks))
    }

    /// Whether a frame that came `later` ones behind the last one vouches for it.
    fn vouch(&mut self, later: u8, start: Start) -> Option<bool> {
        let candidate = self.candidate.filter(|_| self.trusting);
        let Some(first) = candidate.filter(|_| later <= CANDIDATE_FRAMES) else {
            return Some(false);
        };
        if self.holds(start.clocks) {
            return None;
        }
        if !first.agrees(start) {
            return Some(false);
        }
        self.reach(first.start.clocks);
        self.reach(start.clocks);
        self.counted.note(first.start);
        self.candidate = None;
        Some(true)
    }
}

/// The line delay, where it is known in ns: that of a line does not change, but for its jitter. Another one counts once it
/// has been seen twice in a row.
#[derive(Clone, Copy, Debug, Default)]
struct LineDelay {
    learned_ns: Option<u32>,
    candidate_ns: Option<u32>,
    trusting: bool,
}

impl LineDelay {
    fn is_known(&self, ns: u32, period_ns: u32) -> bool {
        self.learned_ns
            .is_some_and(|learned| learned.abs_diff(ns) <= period_ns)
    }

    /// What is strange about the delay of a frame. `sound` frames have no bad word.
    fn strange(&mut self, ns: u32, period_ns: u32, sound: bool) -> Option<Fault> {
        let near = |other: &u32| other.abs_diff(ns) <= period_ns;
        if self.is_known(ns, period_ns) {
            self.candidate_ns = None;
            return None;
        }
        let fault = Fault::Delay {
            ns,
            learned_ns: self.learned_ns.unwrap_or(ns),
        };
        if !sound {
            return Some(fault);
        }
        let seen = self
            .candidate_ns
            .replace(ns)
            .is_some_and(|seen| near(&seen));
        if seen || self.trusting && self.learned_ns.is_none() {
            (self.learned_ns, self.candidate_ns) = (Some(ns), None);
            return None;
        }
        Some(fault)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{BissC, emit};
    use crate::protocol::Protocol;
    use crate::trace::Trace;

    fn cycle(format: &str, ack: u16, data: &[u64], flip: Option<usize>) -> (Format, Cycle) {
        let format: Format = format.parse().unwrap();
        let mut trace = Trace::default();
        let head = Head {
            delay_clk: 0,
            ack,
            cds: false,
        };
        emit(&format, head, data, &mut trace.bits);
        if let Some(at) = flip {
            let flipped: Vec<bool> = trace
                .bits
                .iter()
                .enumerate()
                .map(|(i, b)| b ^ (i == at))
                .collect();
            trace.bits.clear();
            trace.bits.extend(flipped);
        }
        let mut cycle = Cycle::default();
        BissC::new(format.clone()).decode(&trace, &mut cycle);
        (format, cycle)
    }

    fn run(tracker: &mut Tracker, acks: &[u16]) -> String {
        acks.iter()
            .map(|ack| {
                let (format, mut cycle) = cycle("st8,crc6", *ack, &[1], None);
                match tracker.judge(&format, &Trace::default(), &mut cycle) {
                    Verdict::Stands => '+',
                    Verdict::Doubtful(_) => '-',
                }
            })
            .collect()
    }

    #[test]
    fn the_first_frame_needs_a_second_that_agrees() {
        assert_eq!(run(&mut Tracker::default(), &[3, 3, 3]), "-++");
        assert_eq!(run(&mut Tracker::default(), &[3, 9, 3, 3]), "---+");
        assert_eq!(run(&mut Tracker::trusting(), &[3, 3, 7, 3]), "++-+");
    }

    #[test]
    fn a_length_that_comes_back_is_learned_and_a_single_one_is_not() {
        assert_eq!(
            run(&mut Tracker::default(), &[3, 3, 6, 3, 6, 5, 4]),
            "-+-++++"
        );
        let mut tracker = Tracker::default();
        assert_eq!(run(&mut tracker, &[5, 5, 2, 5, 9, 5]), "-+-+-+");
        assert_eq!(tracker.heads(), Some((5, 5)));
        assert_eq!(run(&mut tracker, &[3, 8, 3, 3, 9, 8]), "---+-+");
        assert_eq!(tracker.heads(), Some((3, 8)));
    }

    /// What a recording shows of such a frame, with so many clocks in it.
    fn shown(ack: u16, clocks: usize) -> (Format, Trace, Cycle) {
        let (format, cycle) = cycle("st8,crc6", ack, &[1], None);
        let mut trace = Trace {
            delay_ns: Some(100),
            busy_ns: Some(1000 * u32::from(ack)),
            ma_period_ns: Some(1000),
            ..Trace::default()
        };
        trace.bits.extend((0..clocks).map(|_| false));
        (format, trace, cycle)
    }

    /// Good frames of a recording; `x` is a bad one.
    fn run_shown(frames: &[(u16, usize)]) -> String {
        let mut tracker = Tracker::trusting();
        let mut judge = |(ack, clocks): &(u16, usize)| {
            if *ack == 0 {
                let (format, mut bad) = cycle("st8,crc6", 3, &[1], Some(7));
                tracker.judge(&format, &Trace::default(), &mut bad);
                return 'x';
            }
            let (format, trace, mut cycle) = shown(*ack, *clocks);
            match tracker.judge(&format, &trace, &mut cycle) {
                Verdict::Stands => '+',
                Verdict::Doubtful(_) => '-',
            }
        };
        frames.iter().map(&mut judge).collect()
    }

    #[test]
    fn a_recording_shows_that_busy_times_wander() {
        let same =
            |acks: &[u16]| -> Vec<(u16, usize)> { acks.iter().map(|ack| (*ack, 60)).collect() };
        assert_eq!(run_shown(&same(&[3, 7, 11, 5])), "+-++");
        // A bad frame between them, or too many frames.
        assert_eq!(run_shown(&same(&[3, 7, 0, 11, 5])), "+-x-+");
        assert_eq!(
            run_shown(&same(&[3, 7, 3, 3, 3, 3, 3, 3, 3, 3, 11])),
            "+-++++++++-"
        );
        // As many clocks behind the start bit, wherever it stands.
        let counted = |acks: &[u16]| -> Vec<(u16, usize)> {
            acks.iter()
                .map(|ack| (*ack, 30 + usize::from(*ack)))
                .collect()
        };
        let wander = [3, 4, 4, 3, 4, 3, 3, 3, 3, 3, 3, 3, 3, 9];
        assert_eq!(run_shown(&counted(&wander)), "+-++++++++++++");
        let mut odd = counted(&wander);
        odd[13].1 += 1;
        assert_eq!(run_shown(&odd), "+-+++++++++++-");
        assert_eq!(run_shown(&counted(&[3, 3, 3, 3, 3, 9])), "+++++-");
    }

    #[test]
    fn what_comes_behind_a_frame_may_vouch_for_it() {
        let vouched = |later: &[(u16, usize)], flip: Option<usize>| {
            let mut tracker = Tracker::trusting();
            for ack in [3, 7] {
                let (format, trace, mut cycle) = shown(ack, 60);
                tracker.judge(&format, &trace, &mut cycle);
            }
            let answers = later.iter().zip(1..).map(|((ack, clocks), later)| {
                let (_, trace, good) = shown(*ack, *clocks);
                let (_, bad) = cycle("st8,crc6", *ack, &[1], flip);
                tracker.vouch(later, &trace, if flip.is_some() { &bad } else { &good })
            });
            let answers: Vec<Option<bool>> = answers.collect();
            (answers, tracker.heads())
        };
        let (yes, no) = (Some(true), Some(false));
        assert_eq!(
            vouched(&[(3, 60), (9, 60)], None),
            (vec![None, yes], Some((3, 9)))
        );
        assert_eq!(vouched(&[(9, 60)], Some(14)), (vec![no], Some((3, 3))));
        let (answers, heads) = vouched(&[(3, 60); 9], None);
        assert_eq!(answers[..8], [None; 8]);
        assert_eq!((answers[8], heads), (no, Some((3, 3))));
    }

    /// Line delays in ns at a clock of 1 µs, the start bit always in its place.
    fn run_delays(tracker: &mut Tracker, delays: &[u32]) -> String {
        delays
            .iter()
            .map(|delay| {
                let (format, mut cycle) = cycle("st8,crc6", 3, &[1], None);
                let trace = Trace {
                    delay_ns: Some(*delay),
                    ma_period_ns: Some(1000),
                    ..Trace::default()
                };
                match tracker.judge(&format, &trace, &mut cycle) {
                    Verdict::Stands => '+',
                    Verdict::Doubtful(_) => '-',
                }
            })
            .collect()
    }

    #[test]
    fn another_line_delay_counts_when_it_comes_back() {
        let mut tracker = Tracker::trusting();
        assert_eq!(run_delays(&mut tracker, &[5000, 4000, 6000]), "+++");
        assert_eq!(run_delays(&mut tracker, &[6001, 5000, 3999, 8000]), "-+--");
        assert_eq!(run_delays(&mut tracker, &[8900, 5000, 8000]), "+-+");
        assert_eq!(run_delays(&mut Tracker::default(), &[900, 900, 900]), "-++");
        let fault = Fault::Delay {
            ns: 0,
            learned_ns: 8900,
        };
        let (format, mut wrong) = cycle("st8,crc6", 3, &[1], None);
        let trace = Trace {
            delay_ns: Some(0),
            ma_period_ns: Some(1000),
            ..Trace::default()
        };
        let verdict = tracker.judge(&format, &trace, &mut wrong);
        assert_eq!(verdict, Verdict::Doubtful(fault));
        assert_eq!(
            fault.to_string(),
            "mismatch: line delay 0.00 us, learned 8.90 us"
        );
    }

    /// Twice in a row, and with every word good: a piece of an earlier frame that comes now and then is no other line.
    #[test]
    fn another_line_delay_between_frames_of_the_old_one_does_not_count() {
        let mut tracker = Tracker::trusting();
        assert_eq!(
            run_delays(&mut tracker, &[5000, 8000, 5000, 8000, 5000]),
            "+-+-+"
        );
        let pair = "st8,crc6+st8,crc6";
        let mut judge = |delay_ns: u32, flip: Option<usize>| {
            let (format, mut cycle) = cycle(pair, 3, &[1, 2], flip);
            let trace = Trace {
                delay_ns: Some(delay_ns),
                ma_period_ns: Some(1000),
                ..Trace::default()
            };
            tracker.judge(&format, &trace, &mut cycle)
        };
        for _ in 0..3 {
            let half = judge(8000, Some(25));
            assert!(matches!(half, Verdict::Doubtful(Fault::Delay { .. })));
        }
        assert!(matches!(judge(8000, None), Verdict::Doubtful(_)));
        assert_eq!(judge(5000, None), Verdict::Stands);
    }

    #[test]
    fn a_single_one_is_forgotten() {
        let mut tracker = Tracker::default();
        run(&mut tracker, &[3, 3, 9]);
        assert_eq!(run(&mut tracker, &[3; 10]), "+".repeat(10));
        assert_eq!(run(&mut tracker, &[9, 9]), "-+");
    }

    /// A window that is shifted may still give one of several channels a good CRC.
    #[test]
    fn one_good_word_among_bad_ones_is_judged_too() {
        let mut tracker = Tracker::default();
        let pair = "st8,crc6+st8,crc6";
        for _ in 0..2 {
            let (format, mut cycle) = cycle(pair, 2, &[1, 2], None);
            tracker.judge(&format, &Trace::default(), &mut cycle);
        }
        let (format, mut half) = cycle(pair, 5, &[1, 2], Some(25));
        assert!(half.words()[0].good().is_some() && half.words()[1].good().is_none());
        assert!(matches!(
            tracker.judge(&format, &Trace::default(), &mut half),
            Verdict::Doubtful(_)
        ));
        let (format, mut half) = cycle(pair, 2, &[1, 2], Some(22));
        assert_eq!(
            tracker.judge(&format, &Trace::default(), &mut half),
            Verdict::Stands,
            "bad, but where it belongs"
        );
    }

    #[test]
    fn a_spoiled_frame_teaches_nothing() {
        let mut tracker = Tracker::default();
        run(&mut tracker, &[3, 3]);
        let (format, mut wrong) = cycle("st8,crc6", 9, &[1], Some(14));
        assert!(!wrong.is_good());
        assert_eq!(
            tracker.judge(&format, &Trace::default(), &mut wrong),
            Verdict::Stands
        );
        assert_eq!(run(&mut tracker, &[9, 3]), "-+");
    }

    #[test]
    fn sign_of_life() {
        let mut tracker = Tracker::trusting();
        let mut verdicts = |values: &[u64]| -> Vec<Option<Fault>> {
            values
                .iter()
                .map(|lc| {
                    let (format, mut cycle) =
                        cycle("st8,nE,nW,lc6,crc16", 1, &[1 << 8 | 0b11 << 6 | lc], None);
                    tracker.judge(&format, &Trace::default(), &mut cycle);
                    cycle.words()[0].fault()
                })
                .collect()
        };
        assert_eq!(verdicts(&[61, 62, 63, 0, 1]), [None; 5]);
        assert_eq!(verdicts(&[2, 3]), [None; 2]);
        assert_eq!(
            verdicts(&[3, 4, 5]),
            [Some(Fault::Life { got: 3, want: 4 }), None, None]
        );
        assert_eq!(
            verdicts(&[63, 1, 2]),
            [Some(Fault::Life { got: 63, want: 6 }), None, None],
            "63 to 1 is a wrap too"
        );
        assert_eq!(verdicts(&[4]), [Some(Fault::Life { got: 4, want: 3 })]);
    }

    #[test]
    fn sign_of_life_counts_over_spoiled_words() {
        let mut tracker = Tracker::trusting();
        let mut judge = |lc: u64, flip: Option<usize>| {
            let (format, mut cycle) = cycle("st8,lc6,crc16", 1, &[1 << 6 | lc], flip);
            tracker.judge(&format, &Trace::default(), &mut cycle);
            cycle.words().first().and_then(|w| w.fault())
        };
        assert_eq!(judge(7, None), None);
        assert!(matches!(judge(8, Some(6)), Some(Fault::Crc { .. })));
        assert_eq!(judge(9, None), None);
    }
}
