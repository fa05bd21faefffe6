//! `biss loopback`: the master against the simulated slave, in process or over jumpered pins.

use super::{Ended, Outcome, schedule};
use crate::cli;
use crate::output::loopback::{Bits, Found, Frames, Wires, render};
use crate::output::{answer, note};
use crate::sys::Signals;
use anyhow::{Result, anyhow, bail};
use biss::Format;
use biss::frame::{BissC, Stall};
use biss::limits::REST_NS;
use biss::link::bitbang::{Bang, Pins};
use biss::link::bus::{self, Bus, SpiBus};
use biss::link::gpio::{self, GpioPins, Line, Place, Served};
use biss::link::sim::{Controller, SimBus, SimPins};
use biss::link::spec::Far;
use biss::link::wave::{Options, Wave};
use biss::link::{Clock, Error, Kind, Link, Uapi};
use biss::loopback::{Echo, LEVELS, Look, Wiring};
use biss::master::{Master, Slot};
use biss::slave::{Config, Motion, Timeout};
use biss::unit::{Hertz, Nanos};
use serde::Serialize;
use std::cell::RefCell;
use std::fmt::Display;
use std::io;
use std::path::Path;
use std::rc::Rc;
use std::time::{Duration, Instant};

pub(crate) fn run(args: cli::Loopback) -> Result<Ended> {
    check(&args)?;
    schedule(args.cpu, args.rt)?;
    let signals = Signals::catch().map_err(|e| {
        anyhow!("catching signals: {e}\n  is a limit of this process used up (`ulimit -a`)?")
    })?;
    let mut bench = Bench {
        args: &args,
        signals,
        piped: true,
    };
    let good = match args.link().map(|link| &link.kind) {
        None => bench.in_process(Config::default()),
        Some(Kind::Sim { config, .. }) => bench.in_process((**config).clone()),
        Some(Kind::Gpio { mo: Some(_), .. }) => bail!(
            "the simulated slave of a loopback has no SLI that MO could drive\n  leave mo= out"
        ),
        Some(Kind::Gpio {
            chip,
            ma,
            slo,
            uapi,
            far: Some(far),
            ..
        }) => bench.gpio(chip.as_deref(), [ma, slo], far, *uapi),
        Some(Kind::Gpio { .. }) => bail!(
            "a loopback over GPIO needs two more lines\n  jumper MA to a third line and a fourth line to SLO, then say all: gpio:0,ma=17,slo=27,ma-in=22,slo-out=23"
        ),
        Some(Kind::Wave {
            path,
            oversample,
            invert,
            ..
        }) => bench.wave(path, *oversample, *invert),
        Some(Kind::Spi { path, .. }) => bail!(
            "on spi MA is SCLK, which no jumper brings back to MISO\n  jumper MOSI to MISO and try the same device as a pattern: {}",
            path.display()
                .to_string()
                .replace("/dev/spidev", "biss loopback wave:")
        ),
        Some(Kind::Exec(_)) => bail!(
            "`biss loopback` brings a slave of its own\n  `biss read` and `biss reg` run against the one in a command"
        ),
        Some(Kind::File { .. }) => {
            bail!("a recording has no far end\n  `biss loopback` without a link needs no hardware")
        }
    }?;
    let signal = bench.signals.caught();
    let outcome = if good && signal.is_none() {
        Outcome::Good
    } else {
        Outcome::Bad
    };
    Ok(Ended { outcome, signal })
}

/// What has no meaning is a mistake, not something to be ignored.
fn check(args: &cli::Loopback) -> Result<()> {
    let kind = args.link().map(|link| &link.kind);
    if !args.search.is_empty() && !matches!(kind, Some(Kind::Gpio { .. })) {
        bail!(
            "--search looks for a jumper on GPIO lines\n  leave it out, or name the link: gpio:0,ma=17,slo=27,ma-in=22,slo-out=23"
        );
    }
    if args.frame.is_some() && matches!(kind, Some(Kind::Wave { .. })) {
        bail!(
            "--frame has no meaning on wave: bits are compared there, not frames\n  leave it out"
        );
    }
    Ok(())
}

struct Bench<'a> {
    args: &'a cli::Loopback,
    signals: Signals,
    /// Somebody still reads.
    piped: bool,
}

/// Clocks that are tried where all of them can be had: a slow one, the usual ones, the fastest of the specification
/// (D2 Table 10).
const CLOCKS: [Hertz; 4] = [
    Hertz(100_000),
    Hertz(250_000),
    Hertz(1_000_000),
    Hertz(10_000_000),
];

/// Frames of a step in process, and over pins, where each takes its time.
const FRAMES: u64 = 1_000;
const FRAMES_OVER_PINS: u64 = 100;

impl Bench<'_> {
    /// Prints a step. A reader who has enough ends the run.
    fn tell(&mut self, step: &(impl Display + Serialize)) -> Result<()> {
        match answer(&render(step, self.args.format)?) {
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => self.piped = false,
            Err(error) => bail!("writing records: {error}\n  make room, or write elsewhere"),
            Ok(()) => {}
        }
        Ok(())
    }

    fn goes_on(&self) -> bool {
        self.piped && self.signals.caught().is_none()
    }

    fn summary(&self, text: impl Display) {
        if !self.args.quiet {
            note(text);
        }
    }

    /// What the slave shall send: `-f` beats the link.
    fn format(&self) -> Option<Format> {
        let link = || self.args.link()?.frame.clone();
        self.args
            .frame
            .clone()
            .or_else(link)
            .map(|frame| frame.format)
    }

    fn in_process(&mut self, config: Config) -> Result<bool> {
        let config = Config {
            format: self.format().unwrap_or(config.format.clone()),
            ..config
        };
        config.chain()?;
        let asked = self.args.clock.as_slice();
        let clocks = if asked.is_empty() { &CLOCKS } else { asked };
        let mut good = true;
        for clock in clocks {
            let mut link = Bang::new(SimPins::new(config.clone()));
            link.set_clock(*clock)?;
            good &= self.against("edge by edge", link, &config.format, |link, words| {
                link.pins_mut().slave().latched() == words
            })?;
        }
        for clock in clocks {
            let bus = SimBus::new(config.clone(), Controller::default());
            let link = Wave::new(bus, Options::default(), Some(*clock))?;
            good &= self.against("pattern", link, &config.format, |link, words| {
                link.bus_mut().pins().slave().latched() == words
            })?;
        }
        if self.goes_on() {
            self.summary(if good {
                "every position that was read is what the slave sent"
            } else {
                "not everything came back as the slave sent it"
            });
        }
        Ok(good)
    }

    /// Frames over a link of which both ends are in hand. `sent` compares words with what the slave latched.
    fn against<L: Link>(
        &mut self,
        rig: &'static str,
        link: L,
        format: &Format,
        sent: impl Fn(&mut L, &[u64]) -> bool,
    ) -> Result<bool> {
        if !self.goes_on() {
            return Ok(true);
        }
        let link = Rc::new(RefCell::new(link));
        let protocol = BissC::new(format.clone());
        let count = self.args.count.unwrap_or(FRAMES);
        let mut shared = Rc::clone(&link);
        let frames = self.frames(rig, &mut shared, &protocol, count, |words| {
            sent(&mut link.borrow_mut(), words)
        })?;
        let good = frames.is_good();
        self.tell(&frames)?;
        Ok(good)
    }

    /// Runs frames and compares each with what was sent. Gives up early where nothing works.
    fn frames(
        &mut self,
        rig: &'static str,
        link: &mut dyn Link,
        protocol: &BissC,
        count: u64,
        sent: impl Fn(&[u64]) -> bool,
    ) -> Result<Frames> {
        /// So many bad frames and no good one: it will not get any better.
        const HOPELESS: u64 = 8;
        let mut frames = Frames::new(rig, count);
        let stop = self.signals.watch();
        let mut master = Master::new(link, protocol, None);
        master.stop_when(&stop);
        master.open()?;
        let mut words = Vec::new();
        while frames.run < count && self.goes_on() {
            let Slot::Done { .. } = master.slot(0, None)? else {
                break;
            };
            frames.run += 1;
            let cycle = master.cycle();
            words.clear();
            words.extend(cycle.words().iter().filter_map(|word| word.good()));
            let all = words.len() == protocol.format.channels().len();
            let fault = || cycle.words().iter().find_map(|word| word.fault());
            match cycle.fault().or_else(fault) {
                Some(fault) => frames.faults[fault.index()] += 1,
                None if all && sent(&words) => frames.as_sent += 1,
                None => frames.wrong += 1,
            }
            if frames.as_sent == 0 && frames.run == HOPELESS.min(count) {
                break;
            }
        }
        frames.clock = Some(master.link().clock());
        Ok(frames)
    }

    fn gpio(
        &mut self,
        chip: Option<&str>,
        [ma, slo]: [&str; 2],
        far: &Far,
        uapi: Option<Uapi>,
    ) -> Result<bool> {
        let chips = gpio::among(chip)?;
        let uapi = gpio::choose(&chips[0], uapi)?;
        let find = |line: &str| gpio::find(&chips, line, uapi);
        let places = [
            find(ma)?,
            find(slo)?,
            find(&far.ma_in)?,
            find(&far.slo_out)?,
        ];
        let others = self.args.search.iter().map(|line| find(line));
        let others = others.collect::<Result<Vec<_>, _>>()?;
        let all: Vec<&Place> = places.iter().chain(&others).collect();
        gpio::different(&all)?;
        let [ma, slo, ma_in, slo_out] = &places;
        let (slo, ma_in) = (slo.input("SLO")?, ma_in.input("MA of the slave")?);
        let slo_out = slo_out.output("SLO of the slave", true)?;
        let mut wires = FourLines {
            near: GpioPins::new(ma.output("MA", true)?, slo, None, uapi)?,
            ma_in,
            slo_out,
        };
        let wiring = wires.wiring()?;
        let good = wiring.is_good();
        let found = if good {
            Vec::new()
        } else {
            wires.search(&others)?
        };
        self.tell(&Wires {
            wiring,
            found,
            uapi,
        })?;
        if !good {
            let hint = match self.args.search.is_empty() {
                true => "; --search looks for MA and SLO on the lines that it names",
                false => "",
            };
            self.summary(format_args!(
                "the jumpers are not where they should be, so no frames were run{hint}"
            ));
            return Ok(false);
        }
        self.fastest(wires)
    }

    /// Frames at one clock after the other, until the fastest that works is known.
    fn fastest(&mut self, wires: FourLines) -> Result<bool> {
        /// Below this a loopback says nothing about reading encoders any more.
        const SLOWEST: Hertz = Hertz(100);
        let FourLines {
            mut near,
            ma_in,
            slo_out,
        } = wires;
        near.share_processor();
        let mut link = Bang::new(near);
        let mut far = (ma_in, slo_out);
        let asked = self.args.clock;
        let mut clock = link.set_clock(asked.unwrap_or(Hertz(10_000_000)))?.hz;
        // As asked for, and as it ran: calls may take longer than they were thought to.
        let (mut works, mut fails) = (None::<(Hertz, Clock)>, None::<Hertz>);
        let mut wrong = 0;
        while self.goes_on() {
            let frames;
            (frames, far) = self.at(&mut link, clock, far)?;
            self.tell(&frames)?;
            wrong += frames.wrong;
            match frames.clock.filter(|_| frames.is_good()) {
                Some(ran) => works = Some((clock, ran)),
                None => fails = Some(clock),
            }
            clock = match (works, fails) {
                _ if asked.is_some() => break,
                (None, _) if clock <= SLOWEST => break,
                (None, _) => Hertz((clock.0 / 2).max(SLOWEST.0)),
                (Some((works, _)), Some(fails)) if works.0 < fails.0 - fails.0 / 8 => {
                    Hertz(works.0.midpoint(fails.0))
                }
                _ => break,
            };
        }
        if self.goes_on() {
            match works {
                // A clock that is too fast may lose frames, but not make them up.
                _ if wrong > 0 => self.summary(format_args!(
                    "{wrong} positions passed every check that the slave did not send"
                )),
                Some((_, ran)) if asked.is_none() => {
                    self.summary(format_args!("the fastest clock that works is {ran}"));
                }
                Some((_, ran)) => self.summary(format_args!("{ran} works")),
                None => self.summary(
                    "the jumpers are right, but no clock works: is another program using the processors? try --rt 50",
                ),
            }
        }
        Ok(works.is_some() && wrong == 0)
    }

    /// Frames at one clock against a slave whose timeout bears it.
    fn at(
        &mut self,
        link: &mut Bang<GpioPins>,
        clock: Hertz,
        (ma_in, slo_out): (Line, Line),
    ) -> Result<(Frames, (Line, Line))> {
        let period = link.set_clock(clock)?.hz.period_ns();
        // The slave looks at MA when its thread runs, so its clock is not what is tested here.
        let timeout = (4 * period).max(40_000);
        let config = Config::default();
        let config = Config {
            format: self.format().unwrap_or(config.format.clone()),
            motion: Motion::Count,
            timeout: Timeout::Static(Nanos(timeout)),
            ..config
        };
        let ns = |ns: u64| u32::try_from(ns).unwrap_or(u32::MAX);
        let mut protocol = BissC::new(config.format.clone());
        protocol.stall = Stall::Static {
            min_ns: ns(timeout - timeout / 8),
        };
        protocol.timeout_max_ns = ns(timeout + timeout / 8);
        let served = Served::start(ma_in, slo_out, config);
        let count = self.args.count.unwrap_or(FRAMES_OVER_PINS);
        let frames = self.frames("jumpered lines", link, &protocol, count, |words| {
            served.sent(words.iter().copied())
        });
        let lines = served.stop()?;
        let mut frames = frames?;
        frames.asked = Some(clock);
        Ok((frames, lines))
    }

    fn wave(&mut self, path: &Path, samples: Option<u8>, invert: bool) -> Result<bool> {
        let mut bus = SpiBus::open(path)?;
        bus.patterns()?;
        let mut wire = Jumpered { bus, invert };
        let samples = samples.unwrap_or(8).into();
        let ladder: Vec<Hertz> = match self.args.clock {
            Some(clock) => vec![Hertz(clock.0.saturating_mul(samples))],
            None => (0..8).map(|power| Hertz(1_000_000 << power)).collect(),
        };
        let mut clean = None;
        let mut before = 0;
        let mut good = true;
        for asked in ladder {
            if !self.goes_on() {
                break;
            }
            let sclk = match wire.sclk(asked) {
                Ok(sclk) => sclk,
                // Slower ones worked, so that is an answer too.
                Err(error) if clean.is_some() => {
                    self.summary(error);
                    break;
                }
                Err(error) => return Err(error.into()),
            };
            if sclk.hz.0 <= before + before / 20 {
                // The controller does not get any faster.
                break;
            }
            before = sclk.hz.0;
            let bits = wire.echo(asked, sclk, self.args.count.unwrap_or(8), &|| {
                self.goes_on()
            })?;
            if bits.bits == 0 {
                // A signal came first.
                break;
            }
            let same = bits.echo == Echo::Same;
            self.tell(&bits)?;
            if !same {
                good = clean.is_some() && matches!(bits.echo, Echo::Late | Echo::Differs { .. });
                break;
            }
            clean = Some(sclk);
        }
        if self.goes_on() {
            match clean {
                Some(sclk) => {
                    let ma = Hertz(sclk.hz.0 / biss::pattern::LEAST_SAMPLES);
                    self.summary(format_args!(
                        "every bit comes back up to SCLK {sclk}: enough for MA up to {ma}"
                    ));
                }
                None => self.summary("MOSI does not come back on MISO"),
            }
        }
        Ok(good)
    }
}

/// A controller with MOSI jumpered to MISO. An encoder may still hang on it, so it leaves MOSI where MA is high.
struct Jumpered<B: Bus> {
    bus: B,
    /// The MA pair is swapped.
    invert: bool,
}

impl<B: Bus> Jumpered<B> {
    /// MA is high so long. Returns how long it took.
    fn high(&mut self, asked: Hertz, bytes: usize) -> Result<u64, Error> {
        let out = vec![if self.invert { 0x00 } else { 0xFF }; bytes];
        let began = self.bus.shift(asked, &out, &mut out.clone())?;
        Ok(self.bus.now_ns() - began)
    }

    /// SCLK as it is when so much is asked for.
    fn sclk(&mut self, asked: Hertz) -> Result<Clock, Error> {
        bus::sclk(asked, self.bus.max_bytes(), |bytes| self.high(asked, bytes))
    }

    /// Random bits out and back, in so many transfers.
    fn echo(
        &mut self,
        asked: Hertz,
        sclk: Clock,
        count: u64,
        goes_on: &dyn Fn() -> bool,
    ) -> Result<Bits, Error> {
        /// A transfer lasts no longer than about this.
        const SPAN_MS: usize = 50;
        let most = self.bus.max_bytes().max(64);
        let bytes = (sclk.hz.0 as usize / 8 / 1000 * SPAN_MS).clamp(64, most);
        let mut noise = Noise(u64::from(asked.0));
        let (mut out, mut back) = (vec![0; bytes], vec![0; bytes]);
        let mut bits = Bits {
            asked,
            sclk,
            bits: 0,
            echo: Echo::Same,
        };
        for _ in 0..count {
            if !goes_on() {
                break;
            }
            out.fill_with(|| noise.byte());
            self.bus.shift(asked, &out, &mut back)?;
            bits.bits += 8 * bytes as u64;
            bits.echo = Echo::of(&out, &back);
            if bits.echo != Echo::Same {
                break;
            }
        }
        Ok(bits)
    }
}

impl<B: Bus> Drop for Jumpered<B> {
    fn drop(&mut self) {
        // 40 µs at the slowest clock of the ladder; nobody is left to tell if that fails.
        let bytes = (REST_NS * 1_000_000).div_ceil(8_000_000_000) as usize;
        let _ = self.high(Hertz(1_000_000), bytes);
    }
}

/// Bits without a period that a stuck or shifted line could hide in. The same ones in every run.
struct Noise(u64);

impl Noise {
    fn byte(&mut self) -> u8 {
        // Knuth's constants (MMIX).
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 56) as u8
    }
}

/// The lines of a loopback: the master's own two, which leave MA high whatever happens, and the slave's.
struct FourLines {
    near: GpioPins,
    ma_in: Line,
    slo_out: Line,
}

/// Levels settle within this: optocouplers included.
const SETTLE: Duration = Duration::from_micros(100);

impl FourLines {
    /// Both outputs, and whatever follows them.
    fn drive(&mut self, ma: bool, slo_out: bool) -> Result<()> {
        self.near.ma(ma)?;
        self.slo_out.set(slo_out)?;
        let end = Instant::now() + SETTLE;
        while Instant::now() < end {
            std::hint::spin_loop();
        }
        Ok(())
    }

    /// Moves both outputs through all their levels and looks.
    fn wiring(&mut self) -> Result<Wiring> {
        const ROUNDS: usize = 4;
        let mut looks = Vec::new();
        for (ma, slo_out) in LEVELS.repeat(ROUNDS) {
            self.drive(ma, slo_out)?;
            looks.push(Look {
                ma,
                slo_out,
                ma_in: self.ma_in.get()?,
                slo: self.near.sl()?,
            });
        }
        self.drive(true, true)?;
        Ok(Wiring::of(&looks))
    }

    /// Our outputs on other lines. Only on those that were named: a pin that serves I2C, a UART or an SD card looks like
    /// a free input, and asking for it takes it away from them (Linux, pinctrl-bcm2835.c).
    fn search(&mut self, others: &[Place]) -> Result<Vec<Found>> {
        let mut found = Vec::new();
        for place in others {
            let line = place.watch("looking for MA")?;
            for (output, is_ma) in [("ma", true), ("slo-out", false)] {
                let mut follows = true;
                for level in [false, true, false, true] {
                    // The other one stays high.
                    self.drive(level || !is_ma, level || is_ma)?;
                    follows &= line.get()? == level;
                }
                if follows {
                    let line = place.shown().to_owned();
                    found.push(Found { output, line });
                }
            }
        }
        Ok(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use biss::link::Known;

    /// MISO shows MOSI, or not; what was sent last stays on MOSI.
    struct Short {
        now_ns: u64,
        jumper: fn(u8) -> u8,
        last: std::rc::Rc<RefCell<Vec<u8>>>,
    }

    impl Bus for Short {
        fn shift(&mut self, hz: Hertz, out: &[u8], back: &mut [u8]) -> Result<u64, Error> {
            let began = self.now_ns;
            self.now_ns += out.len() as u64 * 8_000_000_000 / u64::from(hz.0);
            for (out, back) in out.iter().zip(back) {
                *back = (self.jumper)(*out);
            }
            *self.last.borrow_mut() = out.to_vec();
            Ok(began)
        }
        fn now_ns(&self) -> u64 {
            self.now_ns
        }
        fn until(&mut self, _: u64) {}
        fn max_bytes(&self) -> usize {
            4096
        }
        fn name(&self) -> String {
            "a short".into()
        }
    }

    #[test]
    fn bits_come_back_and_ma_is_left_high() {
        type Jumper = fn(u8) -> u8;
        let cases: [(Jumper, Echo); 3] = [
            (|sent| sent, Echo::Same),
            (|_| 0, Echo::StuckLow),
            (|sent| !sent, Echo::Inverted),
        ];
        for ((jumper, echo), invert) in cases.iter().flat_map(|c| [(*c, false), (*c, true)]) {
            let last = std::rc::Rc::default();
            let mut wire = Jumpered {
                bus: Short {
                    now_ns: 0,
                    jumper,
                    last: std::rc::Rc::clone(&last),
                },
                invert,
            };
            let sclk = wire
                .sclk(Hertz(4_000_000))
                .unwrap_or_else(|e| panic!("{e}"));
            assert_eq!((sclk.hz, sclk.known), (Hertz(4_000_000), Known::Measured));
            let bits = wire.echo(sclk.hz, sclk, 3, &|| true);
            let bits = bits.unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(bits.echo, echo);
            let rounds = if echo == Echo::Same { 3 } else { 1 };
            assert_eq!(bits.bits, rounds * 8 * 4096);
            drop(wire);
            let high = if invert { 0x00 } else { 0xFF };
            assert_eq!(*last.borrow(), [high; 5], "40 us at 1 MHz");
        }
    }
}
