//! `wave`: MA is a pattern on MOSI, SLO is MISO sampled several times a clock. One transfer a frame holds everything
//! from the rest before it to the timeout after it, at exact spacing.
//!
//! The pattern begins and ends with MA high. Where MOSI rests between transfers is the driver's business: most leave it
//! at the last bit or pull it low, few can be told. Resting where MA is low, it makes an edge of MA before each transfer and
//! one after it. A slave with a static timeout bears that: after the first one it is given 40 µs of MA high, its timeout is
//! over before the second one, and again before the next transfer, so that both together begin no frame.

use super::bus::{self, Bus, DMA_BYTES, SpiBus};
use super::{Caps, Clock, Error, Known, Link};
use crate::limits::{LINE_DELAY_MAX_NS, REST_NS};
use crate::pattern::{Grid, LEAST_SAMPLES, LEAST_SAMPLES_BROKEN, Pattern, Plan};
use crate::trace::{Ask, Clocks, Trace, Until};
use crate::unit::Hertz;
use crate::waveform::{Log, Waveform};
use std::path::Path;

/// How MA is laid on MOSI.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// Samples a clock; `None` finds a number that the controller's dividers can make.
    pub oversample: Option<u8>,
    /// The MA pair is swapped: MOSI low is MA high.
    pub invert: bool,
    /// Where MOSI rests between transfers; `None` expects it where MA is high, and asks the driver for that.
    pub idle: Option<bool>,
}

impl Options {
    /// Whether MA is high between transfers.
    pub fn ma_rests_high(&self) -> bool {
        self.idle.is_none_or(|mosi| mosi != self.invert)
    }
}

/// An encoder on MOSI and MISO.
#[derive(Debug)]
pub struct Wave<B: Bus> {
    bus: B,
    options: Options,
    pattern: Pattern,
    choice: Choice,
    out: Vec<u8>,
    back: Vec<u8>,
    last_end_ns: u64,
    /// The end of the last transfer showed SL = 1 after its timeout.
    ready: bool,
    /// Longest line delay seen, in samples.
    farthest: usize,
    /// The driver holds MOSI at rest where it was asked to.
    held: bool,
    /// Both wires, where somebody wants them.
    log: Option<Box<Log>>,
}

/// SCLK, and how MA's clocks lie on it.
#[derive(Clone, Copy, Debug)]
struct Choice {
    /// SCLK as the driver is asked for it.
    asked: Hertz,
    /// SCLK as it is, and how that is known.
    sclk: Clock,
    grid: Grid,
}

impl Choice {
    /// MA.
    fn clock(&self) -> Clock {
        Clock {
            hz: Hertz((f64::from(self.sclk.hz.0) / self.grid.samples_per_clock()).round() as u32),
            known: self.sclk.known,
        }
    }
}

/// What every encoder must take at first contact (D2 Table 10).
const FIRST_CLOCK: Hertz = Hertz(1_000_000);

/// Samples a clock where the user has not said. Half of a clock each way is delay and jitter.
const USUAL_SAMPLES: u32 = 8;

/// MA rests this long after the controller may have moved it: the slave's rest, and the way back.
const SETTLE_NS: u64 = REST_NS + LINE_DELAY_MAX_NS;

/// Opens a spidev for patterns on MOSI.
///
/// # Errors
/// When the device cannot be opened or a transfer fails.
pub fn open(path: &Path, options: Options, clock: Option<Hertz>) -> Result<Wave<SpiBus>, Error> {
    let mut bus = SpiBus::open(path)?;
    bus.patterns()?;
    Wave::new(bus, options, clock)
}

impl<B: Bus> Wave<B> {
    /// Takes over a bus, and brings MA to rest.
    ///
    /// # Errors
    /// When a transfer fails, or the clock is out of the controller's reach.
    pub fn new(mut bus: B, options: Options, clock: Option<Hertz>) -> Result<Wave<B>, Error> {
        let held = options.idle.is_none() && bus.rest_mosi_at(!options.invert);
        let asked = Hertz(USUAL_SAMPLES * FIRST_CLOCK.0);
        let sclk = Clock {
            hz: asked,
            known: Known::Asked,
        };
        let grid = Grid::whole(USUAL_SAMPLES, asked.0);
        let mut wave = Wave {
            last_end_ns: bus.now_ns(),
            bus,
            options,
            pattern: Pattern::new(grid),
            choice: Choice { asked, sclk, grid },
            out: Vec::new(),
            back: Vec::new(),
            ready: false,
            farthest: 0,
            held,
            log: None,
        };
        wave.set_clock(clock.unwrap_or(FIRST_CLOCK))?;
        Ok(wave)
    }

    /// The bus, to change what it stands for.
    pub fn bus_mut(&mut self) -> &mut B {
        &mut self.bus
    }

    /// How clocks lie on samples now.
    pub fn grid(&self) -> Grid {
        self.choice.grid
    }

    /// What was sent last, MA high as 1, and what came back.
    pub fn last(&self) -> (&Pattern, &[u8]) {
        (&self.pattern, &self.back)
    }

    /// MA high for so many bytes. Returns how long that took.
    fn high(&mut self, bytes: usize) -> Result<u64, Error> {
        self.out.clear();
        self.out
            .resize(bytes, if self.options.invert { 0x00 } else { 0xFF });
        let began = self.send()?;
        Ok(self.last_end_ns - began)
    }

    /// Sends `out`, and takes as much back. Returns when it began.
    fn send(&mut self) -> Result<u64, Error> {
        let most = self.bus.max_bytes();
        if self.out.len() > most {
            let name = self.bus.name();
            let doing = format!("a cycle of {} samples on {name}", 8 * self.out.len());
            let said = format!("it takes {} bytes, a message {most}", self.out.len());
            let hint = "load spidev with bufsiz=65536, or take a smaller oversample=, --timeout or --ack-limit";
            return Err(Error::new(doing, said, hint));
        }
        self.back.clear();
        self.back.resize(self.out.len(), 0);
        let began = self
            .bus
            .shift(self.choice.asked, &self.out, &mut self.back)?;
        self.last_end_ns = self.bus.now_ns();
        if self.log.is_some() {
            self.note(began);
        }
        Ok(began)
    }

    /// Begins to note both wires. SLO is not seen before the first transfer.
    #[cold]
    fn keep_log(&mut self) {
        let (now_ns, ma) = (self.bus.now_ns(), self.options.ma_rests_high());
        self.log
            .get_or_insert_with(|| Box::new(Log::new(now_ns, ma, None)));
    }

    /// Notes a transfer, sample by sample: MOSI moves half an SCLK before MISO is sampled, and what is seen there first came
    /// at some time in the SCLK before.
    #[cold]
    fn note(&mut self, began_ns: u64) {
        let Some(log) = &mut self.log else {
            return;
        };
        let hz = u64::from(self.choice.sclk.hz.0.max(1));
        // While SCLK is measured it is another, and MA stands still.
        let at =
            |sample: usize| (began_ns + sample as u64 * 1_000_000_000 / hz).min(self.last_end_ns);
        let (mut ma, mut slo) = (None, log.slo_now());
        for sample in 0..8 * self.out.len() {
            let level = |bytes: &[u8]| bytes[sample / 8] & 0x80 >> (sample % 8) != 0;
            let now = level(&self.out) != self.options.invert;
            if ma != Some(now) {
                log.ma(at(sample), now);
                ma = Some(now);
            }
            let now = level(&self.back);
            if slo != Some(now) {
                log.slo(at(sample), Some(now));
                slo = Some(now);
            }
        }
        if !self.options.ma_rests_high() {
            log.ma(at(8 * self.out.len()), false);
        }
    }

    /// SCLK as it is when so much is asked for. MA stands still meanwhile.
    fn measure(&mut self, asked: Hertz) -> Result<Clock, Error> {
        let before = std::mem::replace(&mut self.choice.asked, asked);
        bus::sclk(asked, self.bus.max_bytes(), |bytes| self.high(bytes))
            // At a clock that is refused nothing could be sent, not even MA high on the way out.
            .inspect_err(|_| self.choice.asked = before)
    }

    /// Finds an SCLK of which MA is a whole part, within a twentieth of what was asked for, or else cuts clocks of
    /// slightly different lengths.
    fn choose_grid(&mut self, ma: Hertz) -> Result<(), Error> {
        let ma = ma.max(Hertz(1));
        let first = self.options.oversample.map_or(USUAL_SAMPLES, u32::from);
        // Where a controller cannot divide to this multiple it may to another.
        let last = self.options.oversample.map_or(2 * first, u32::from);
        let mut slower: Option<Choice> = None;
        let mut broken: Option<Choice> = None;
        for samples in first..=last {
            let asked = Hertz(self.sclk_for(ma, samples)?);
            let sclk = self.measure(asked)?;
            let least = sclk.hz.0.div_ceil(ma.0).max(LEAST_SAMPLES);
            let whole = self.options.oversample.map_or(least, u32::from);
            let choice = |grid| Choice { asked, sclk, grid };
            let whole = choice(Grid::whole(whole, sclk.hz.0));
            if whole.clock().hz.0 >= ma.0 - ma.0 / 20 || first == last {
                self.take(whole);
                return Ok(());
            }
            slower = slower.or(Some(whole));
            let finer = broken.as_ref().is_none_or(|b| b.sclk.hz < sclk.hz);
            if sclk.hz.0 / ma.0 >= LEAST_SAMPLES_BROKEN && finer {
                broken = Some(choice(Grid::broken(ma.0, sclk.hz.0)));
            }
            if sclk.hz.0 < asked.0 / 2 {
                // It does not get any faster.
                break;
            }
        }
        if let Some(choice) = broken.or(slower) {
            self.take(choice);
        }
        Ok(())
    }

    fn sclk_for(&self, ma: Hertz, samples: u32) -> Result<u32, Error> {
        ma.0.checked_mul(samples).ok_or_else(|| {
            let doing = format!("setting MA to {ma} on {}", self.bus.name());
            let said = format!("SCLK would have to be {samples} times as fast");
            Error::new(doing, said, "ask for a slower clock with -c")
        })
    }

    fn take(&mut self, choice: Choice) {
        self.pattern = Pattern::new(choice.grid);
        self.choice = choice;
        self.farthest = 0;
    }

    /// MA high before the first falling edge: a clock, or what a slave needs to forget the edge that came with the
    /// transfer, its timeout being at most so long.
    fn lead(&self, timeout_ns: u64) -> usize {
        let clock = self.choice.grid.samples(self.choice.grid.period_ns()) + 1;
        if self.options.ma_rests_high() {
            clock
        } else {
            clock.max(self.choice.grid.samples(REST_NS.max(timeout_ns)))
        }
    }

    /// What the cycle needs around its clocks.
    fn plan(&self, clocks: u16, ask: &Clocks) -> Plan {
        let cdm = ask.cdm[0];
        let clock = self.choice.grid.samples(self.choice.grid.period_ns()) + 1;
        // With CDM = 0 MA stays high until SL = 1; with CDM = 1 that is what the hold is for.
        let wait = if cdm { 0 } else { ask.ready_ns.unwrap_or(0) };
        let end = if self.options.ma_rests_high() {
            wait.into()
        } else {
            SETTLE_NS.max(wait.into())
        };
        Plan {
            clocks,
            lead: self.lead(ask.ready_ns.unwrap_or(0).into()),
            hold: cdm.then(|| self.choice.grid.samples(ask.hold_ns.into())),
            tail: clock + self.farthest + self.choice.grid.samples(end),
            least: 8 * DMA_BYTES,
        }
    }

    fn cycle(&mut self, ask: &Ask, trace: &mut Trace) -> Result<(), Error> {
        trace.reset();
        if trace.wave.is_some() {
            self.keep_log();
        }
        let clocks = self.planned(&ask.clocks)?;
        // Where MOSI rests low MA has fallen after the last transfer. While the slave waits for more of that frame the edge that
        // begins this one would be its first, and the lead a frame without clocks, from which it takes CDM = 0.
        let armed = !self.options.ma_rests_high();
        if let Some(ready_ns) = ask.clocks.ready_ns.filter(|_| armed || !self.ready) {
            self.bus.until(self.last_end_ns + u64::from(ready_ns));
        }
        let plan = self.plan(clocks, &ask.clocks);
        self.pattern.plan(&plan);
        let lead_ns = self.choice.grid.ns(self.pattern.first_fall());
        self.bus.until(ask.at_ns.saturating_sub(lead_ns));
        self.out.clear();
        let flip = if self.options.invert { 0xFF } else { 0x00 };
        self.out
            .extend(self.pattern.bytes().iter().map(|byte| byte ^ flip));
        trace.t_ns = self.send()? + lead_ns;
        trace.surplus = ask.clocks.surplus;
        let delay = self.pattern.read(&self.back, trace);
        if let Some(log) = &mut self.log {
            match &mut trace.wave {
                Some(wave) => {
                    log.pour(wave);
                    let hz = u64::from(self.choice.sclk.hz.0.max(1));
                    let began_ns = trace.t_ns - lead_ns;
                    let at = |sample: usize| began_ns + sample as u64 * 1_000_000_000 / hz;
                    let into_bit = self.pattern.into_bit(delay.unwrap_or(0));
                    let bits = self.pattern.rises().iter().take(trace.bits.len());
                    wave.samples_ns.extend(bits.map(|rise| at(rise + into_bit)));
                }
                None => log.forget(),
            }
        }
        // The hold allows for the longest line delay; what comes later is noise.
        let most = self.choice.grid.samples(ask.clocks.hold_ns.into());
        self.farthest = self.farthest.max(delay.unwrap_or(0).min(most));
        // The pattern ends when the longest timeout has passed, so SL = 1 there is no data bit.
        let rests = self.back.last().is_some_and(|byte| byte & 1 == 1);
        self.ready = trace.ready_ns.is_some() || ask.clocks.partial && rests;
        Ok(())
    }

    /// MA is laid out before SL is seen, so nothing can depend on it.
    fn planned(&self, clocks: &Clocks) -> Result<u16, Error> {
        let doing = || format!("a frame on {}", self.bus.name());
        let hint = "plan the clocks and CDM beforehand";
        if clocks.cdm[0] != clocks.cdm[1] {
            let said = "the pattern is laid out before CDS is seen, CDM cannot depend on it";
            return Err(Error::new(doing(), said, hint));
        }
        match clocks.until {
            Until::Clocks(clocks) => Ok(clocks),
            Until::Frame { .. } => {
                let said =
                    "the pattern is laid out before SL is seen, its clocks cannot depend on it";
                Err(Error::new(doing(), said, hint))
            }
        }
    }
}

impl<B: Bus> Link for Wave<B> {
    fn caps(&self) -> Caps {
        Caps {
            live: true,
            reacts: false,
            cdm: true,
            sees_idle: true,
            times_levels: false,
            phases: &[],
            virtual_time: self.bus.virtual_time(),
            burst: 1,
        }
    }

    fn now_ns(&self) -> u64 {
        self.bus.now_ns()
    }

    fn clock(&self) -> Clock {
        self.choice.clock()
    }

    fn set_clock(&mut self, hz: Hertz) -> Result<Clock, Error> {
        self.choose_grid(hz)?;
        // To the encoder the measurement was a rest, or one short edge where MOSI rests low.
        self.bus.until(self.last_end_ns + SETTLE_NS);
        Ok(self.clock())
    }

    /// MA is high while samples of SL are taken.
    fn idle(&mut self, ns: u64) -> Result<Option<bool>, Error> {
        self.bus.until(self.bus.now_ns() + ns);
        self.high(self.lead(0).div_ceil(8) + 1)?;
        let level = self.back.last().map(|byte| byte & 1 == 1);
        self.ready = ns >= REST_NS && level == Some(true);
        Ok(level)
    }

    fn cycles(&mut self, asks: &[Ask], out: &mut [Trace]) -> Result<usize, Error> {
        for (ask, trace) in asks.iter().zip(out.iter_mut()) {
            self.cycle(ask, trace)?;
        }
        Ok(asks.len().min(out.len()))
    }

    fn waveform(&mut self, wave: &mut Waveform) -> Result<(), Error> {
        self.keep_log();
        if let Some(log) = &mut self.log {
            log.pour(wave);
        }
        Ok(())
    }

    fn notes(&self) -> Vec<String> {
        let name = self.bus.name();
        let Choice { sclk, grid, .. } = &self.choice;
        let mut notes = vec![if grid.is_whole() {
            format!(
                "{name}: SCLK {}, {} samples a clock",
                sclk,
                grid.samples_per_clock()
            )
        } else {
            format!(
                "{name}: SCLK {}, {:.3} samples a clock on average: MA's edges stand up to {} ns before their place",
                sclk,
                grid.samples_per_clock(),
                grid.jitter_ns()
            )
        }];
        let level = if self.options.invert { "low" } else { "high" };
        if !self.options.ma_rests_high() {
            notes.push("MA falls after each transfer and rises before the next one: only for slaves with a static timeout".into());
        } else if self.held {
            notes.push(format!("the driver keeps MOSI {level} between transfers"));
        } else if self.options.idle.is_none() {
            notes.push(format!(
                "MOSI must rest {level} between transfers, which this driver cannot be asked for; if it does not, say idle="
            ));
        }
        notes
    }
}

impl<B: Bus> Drop for Wave<B> {
    fn drop(&mut self) {
        // MA high for 40 µs last; nobody is left to tell if that fails.
        let bytes = self.choice.grid.samples(REST_NS).div_ceil(8);
        let _ = self.high(bytes.min(self.bus.max_bytes()));
    }
}
