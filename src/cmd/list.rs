//! `biss list`: what this machine offers, what is missing, and what helps.
//!
//! Everything is looked up below a root folder, so that tests can build machines of their own; only opening a device
//! and asking a GPIO chip go past the file system.

use super::{Ended, Outcome};
use crate::cli;
use crate::named::Files;
use crate::output::answer;
use crate::output::list::{
    Access, Board, Chip, ChipInside, Encoder, Line, Missing, Preset, Report, Setting, Spidev,
};
use anyhow::{Result, anyhow};
use biss::link::{self, Uapi, gpio};
use biss::measure::Unit;
use biss::preset;
use std::fs::{self, OpenOptions};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

pub(crate) fn run(args: cli::List) -> Result<Ended> {
    let machine = Machine {
        root: Path::new("/"),
        open: &|path, write| {
            let mut how = OpenOptions::new();
            how.read(true).write(write).open(path).map(drop)
        },
        ask: &ask,
    };
    let mut report = machine.report();
    named(&Files::of(args.files.config.as_deref()), &mut report);
    let text = report.render(args.format, args.verbose)?;
    match answer(&text) {
        // Whoever reads may have enough.
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(anyhow!(
            "writing the list: {error}\n  make room, or write elsewhere"
        )),
        _ => Ok(Ended {
            outcome: Outcome::Good,
            signal: None,
        }),
    }
}

/// Encoders of the configuration, and what is wrong with it.
fn named(files: &Files, report: &mut Report) {
    let (encoders, wrong) = files.all();
    let encoders = encoders.into_iter().map(|named| {
        let encoder = named.encoder;
        Encoder {
            name: named.name,
            file: named.file.display().to_string(),
            link: encoder.link,
            frame: encoder.frame.map(|frame| frame.to_string()),
            clock_hz: encoder.clock.map(|clock| clock.0),
            interval_ns: encoder.interval.map(|interval| interval.0),
            timeout: encoder.timeout.map(|timeout| timeout.to_string()),
            zero: encoder.zero.map(|zero| zero.to_string()),
            reverse: encoder.reverse,
            resolution: encoder.resolution.map(|resolution| resolution.to_string()),
            unit: encoder.unit.map(Unit::name),
        }
    });
    report.encoders = encoders.collect();
    report.missing.extend(wrong.into_iter().map(|(_, error)| {
        // The first line is what is wrong, the last one what helps.
        let mut lines = error.lines();
        let why = lines.next().unwrap_or_default().to_owned();
        Missing {
            what: "config",
            why,
            fix: lines.next_back().map(|fix| fix.trim().to_owned()),
        }
    }));
}

/// What a GPIO chip says of itself.
fn ask(path: &Path) -> Result<ChipInside, link::Error> {
    let chip = gpio::among(path.to_str())?.remove(0);
    let uapi = gpio::uapi(&chip)?;
    let lines = gpio::lines(&chip, uapi)?.into_iter().map(|line| Line {
        chip: chip.name.clone(),
        line: line.offset,
        name: line.name,
        direction: if line.output { "output" } else { "input" },
        used: line.used,
        consumer: line.consumer,
    });
    let lines = lines.collect();
    Ok(ChipInside {
        name: chip.name,
        label: chip.label,
        uapi: match uapi {
            Uapi::V1 => "v1",
            Uapi::V2 => "v2",
        },
        lines,
    })
}

fn presets() -> Vec<Preset> {
    let presets = preset::all().iter().map(|preset| Preset {
        name: preset.name,
        about: preset.about,
        frame: preset.format,
        clock_min_hz: preset.clock_min.map(|clock| clock.0),
        clock_max_hz: preset.clock_max.map(|clock| clock.0),
        timeout: preset.timeout.map(|timeout| timeout.to_string()),
        interval_ns: preset.interval.map(|interval| interval.0),
        power_on_ns: preset.power_on.map(|power_on| power_on.0),
        source: preset.source,
        note: preset.note,
    });
    presets.collect()
}

/// Where the machine shows itself, and how its devices are tried.
struct Machine<'a> {
    root: &'a Path,
    /// Opens a device, for writing too if told so, and closes it.
    open: &'a dyn Fn(&Path, bool) -> io::Result<()>,
    ask: &'a dyn Fn(&Path) -> Result<ChipInside, link::Error>,
}

/// Long enough for a frame of `wave` with the longest rests at any SCLK: 4 ms at 125 MHz.
const AMPLE_BUFSIZ: u64 = 65536;

impl Machine<'_> {
    fn report(&self) -> Report {
        let chips = self.chips();
        let spidevs = self.spidevs();
        let mut missing = Vec::new();
        if chips.is_empty() {
            missing.push(self.no_chip());
        }
        if spidevs.is_empty() {
            missing.extend(self.no_spidev());
        }
        let settings = [
            self.bufsiz(),
            self.persist(!chips.is_empty()),
            self.priority(),
            self.memory(),
            self.throttling(),
            self.governor(),
            self.isolated(),
        ];
        Report {
            board: self.board(),
            chips,
            spidevs,
            encoders: Vec::new(),
            missing,
            settings: settings.into_iter().flatten().collect(),
            presets: presets(),
        }
    }

    fn at(&self, path: &str) -> PathBuf {
        self.root.join(path.trim_start_matches('/'))
    }

    /// A short file without what surrounds its text.
    fn read(&self, path: &str) -> Option<String> {
        let bytes = fs::read(self.at(path)).ok()?;
        let text = String::from_utf8_lossy(&bytes);
        let text = text.trim_matches(|c: char| c == '\0' || c.is_whitespace());
        (!text.is_empty()).then(|| text.to_owned())
    }

    /// The names in a folder, in order; none where there is no such folder.
    fn names(&self, path: &str) -> Vec<String> {
        let entries = fs::read_dir(self.at(path)).into_iter().flatten().flatten();
        let mut names: Vec<String> = entries
            .filter_map(|entry| entry.file_name().into_string().ok())
            .collect();
        names.sort();
        names
    }

    /// Where a link of the kernel's leads, its last part.
    fn link_name(&self, path: &str) -> Option<String> {
        let target = fs::read_link(self.at(path)).ok()?;
        Some(target.file_name()?.to_string_lossy().into_owned())
    }

    fn board(&self) -> Board {
        let pc = || {
            let vendor = self.read("/sys/class/dmi/id/sys_vendor")?;
            let product = self.read("/sys/class/dmi/id/product_name")?;
            Some(format!("{vendor} {product}"))
        };
        Board {
            model: self.tree_model().or_else(pc),
            kernel: self.read("/proc/sys/kernel/osrelease"),
            arch: std::env::consts::ARCH,
        }
    }

    fn tree_model(&self) -> Option<String> {
        self.read("/proc/device-tree/model")
            .or_else(|| self.read("/sys/firmware/devicetree/base/model"))
    }

    fn is_pi(&self) -> bool {
        self.tree_model()
            .is_some_and(|model| model.starts_with("Raspberry Pi"))
    }

    /// A file of a Raspberry Pi's boot partition, which has moved with Debian 12.
    fn boot_file(&self, name: &str) -> String {
        let places = ["/boot/firmware", "/boot"].map(|folder| format!("{folder}/{name}"));
        let found = places.into_iter().find(|path| self.at(path).exists());
        found.unwrap_or_else(|| format!("{name} of the boot partition"))
    }
}

/// The GPIO part.
impl Machine<'_> {
    fn chips(&self) -> Vec<Chip> {
        let mut numbers: Vec<u32> = self
            .names("/dev")
            .iter()
            .filter_map(|name| name.strip_prefix("gpiochip")?.parse().ok())
            // Boards link old names to new ones: that is one chip.
            .filter(|number| fs::read_link(self.at(&format!("/dev/gpiochip{number}"))).is_err())
            .collect();
        numbers.sort_unstable();
        numbers
            .into_iter()
            .map(|number| self.chip(number))
            .collect()
    }

    fn chip(&self, number: u32) -> Chip {
        let path = format!("/dev/gpiochip{number}");
        let inside = match (self.open)(&self.at(&path), false) {
            Ok(()) => match (self.ask)(&self.at(&path)) {
                Ok(inside) => Access::Open(inside),
                Err(error) => Access::Refused {
                    error: error.said().to_owned(),
                    fix: error.hint().to_owned(),
                },
            },
            Err(error) => self.refused(&path, &error),
        };
        Chip::new(number, path, inside)
    }

    fn no_chip(&self) -> Missing {
        let (why, fix) = match self.names("/sys/bus/gpio/devices").first() {
            Some(name) => absent(name),
            None => ("this machine has no GPIO chip".to_owned(), None),
        };
        Missing {
            what: "gpio",
            why,
            fix,
        }
    }
}

/// The kernel has it, `/dev` not.
fn absent(name: &str) -> (String, Option<String>) {
    let fix = format!("in a container, pass it in: docker run --device /dev/{name}");
    (
        format!("the kernel has {name}, but there is no /dev/{name}"),
        Some(fix),
    )
}

/// What this user may open.
impl Machine<'_> {
    fn refused<T>(&self, path: &str, error: &io::Error) -> Access<T> {
        Access::Refused {
            error: error.to_string(),
            fix: self.remedy(path, error),
        }
    }

    fn remedy(&self, path: &str, error: &io::Error) -> String {
        match error.raw_os_error() {
            Some(libc::EACCES) => match self.group(path) {
                // `$USER` is for the shell that it is pasted into.
                Some(group) => format!("sudo usermod -aG {group} $USER, then log out and in"),
                None => "only root may: run as root, or add the udev rule of docs/setup.md".into(),
            },
            Some(libc::EPERM) => {
                format!("if this is a container, let it in: docker run --device {path}")
            }
            Some(libc::ENOENT | libc::ENODEV | libc::ENXIO) => {
                "it is a leftover without a driver; `dmesg` says what became of it".into()
            }
            _ => "`dmesg` may say more".into(),
        }
    }

    fn group(&self, path: &str) -> Option<String> {
        let about = fs::metadata(self.at(path)).ok()?;
        let groups = self.read("/etc/group").unwrap_or_default();
        group(about.mode(), about.gid(), &groups)
    }
}

/// The group that may read and write a file, unless that is root's own.
fn group(mode: u32, gid: u32, groups: &str) -> Option<String> {
    if mode & 0o060 != 0o060 || gid == 0 {
        return None;
    }
    let name = groups.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        (fields.nth(1)?.parse() == Ok(gid)).then(|| name.to_owned())
    });
    Some(name.unwrap_or_else(|| gid.to_string()))
}

/// The SPI part.
impl Machine<'_> {
    fn spidevs(&self) -> Vec<Spidev> {
        let number = |name: &str| {
            let (bus, cs) = name.strip_prefix("spidev")?.split_once('.')?;
            Some((bus.parse().ok()?, cs.parse().ok()?))
        };
        let mut found: Vec<(u32, u32)> = self
            .names("/dev")
            .iter()
            .filter_map(|name| number(name))
            .collect();
        found.sort_unstable();
        found
            .into_iter()
            .map(|(bus, cs)| self.spidev(bus, cs))
            .collect()
    }

    fn spidev(&self, bus: u32, cs: u32) -> Spidev {
        let path = format!("/dev/spidev{bus}.{cs}");
        let refused = match (self.open)(&self.at(&path), true) {
            Ok(()) => None,
            Err(error) => Some(self.refused(&path, &error)),
        };
        let driver = self.link_name(&format!("/sys/class/spi_master/spi{bus}/device/driver"));
        Spidev::new(bus, cs, path, driver, refused)
    }

    /// Why there is no spidev: no controller, nothing on it, or something that spidev does not drive.
    fn no_spidev(&self) -> Vec<Missing> {
        let missing = |(why, fix)| Missing {
            what: "spi",
            why,
            fix,
        };
        let spidevs = self.names("/sys/class/spidev");
        if let Some(name) = spidevs.first() {
            return vec![missing(absent(name))];
        }
        let controllers = self.names("/sys/class/spi_master");
        if controllers.is_empty() {
            return vec![missing(self.no_controller())];
        }
        let devices = self.names("/sys/bus/spi/devices");
        if devices.is_empty() {
            let why = format!(
                "nothing is declared on the SPI bus ({})",
                controllers.join(", ")
            );
            let fix = "declare a device for spidev in the device tree: docs/setup.md";
            return vec![missing((why, Some(fix.into())))];
        }
        devices
            .iter()
            .map(|device| missing(self.without_spidev(device)))
            .collect()
    }

    fn no_controller(&self) -> (String, Option<String>) {
        if self.is_pi() {
            let config = self.boot_file("config.txt");
            (
                "SPI is not switched on".into(),
                Some(format!("add dtparam=spi=on to {config} and reboot")),
            )
        } else if self.tree_model().is_some() {
            (
                "no SPI controller is switched on".into(),
                Some("switch one on in the board's device tree: docs/setup.md".into()),
            )
        } else {
            ("this machine has no SPI controller".into(), None)
        }
    }

    fn without_spidev(&self, device: &str) -> (String, Option<String>) {
        let folder = format!("/sys/bus/spi/devices/{device}");
        match self.link_name(&format!("{folder}/driver")) {
            Some(driver) => (
                format!("{device} belongs to the driver {driver}"),
                Some("take out the overlay that gives it to that driver: docs/setup.md".into()),
            ),
            None if !self.at("/sys/bus/spi/drivers/spidev").exists() => (
                format!("{device} has no driver: the module spidev is not loaded"),
                Some("sudo modprobe spidev".into()),
            ),
            None => (
                format!("{device} is no device that spidev takes by itself"),
                Some(format!(
                    "echo spidev | sudo tee {folder}/driver_override; echo {device} | sudo tee /sys/bus/spi/drivers/spidev/bind"
                )),
            ),
        }
    }
}

/// Settings of the kernel and limits of this user.
impl Machine<'_> {
    fn bufsiz(&self) -> Option<Setting> {
        let value = self.read("/sys/module/spidev/parameters/bufsiz")?;
        let bytes: u64 = value.parse().ok()?;
        // Only what was loaded has a state.
        let module = self.at("/sys/module/spidev/initstate").exists();
        let raise = if module {
            format!(
                "echo options spidev bufsiz={AMPLE_BUFSIZ} | sudo tee /etc/modprobe.d/spidev.conf, then reboot"
            )
        } else {
            let line = if self.is_pi() {
                self.boot_file("cmdline.txt")
            } else {
                "the kernel's command line".into()
            };
            format!("add spidev.bufsiz={AMPLE_BUFSIZ} to {line} and reboot")
        };
        Some(Setting {
            name: "spidev.bufsiz",
            means: "bytes in one transfer at most".into(),
            fix: (bytes < AMPLE_BUFSIZ).then_some(raise),
            value,
        })
    }

    /// What the kernel makes of MA when biss has ended.
    fn persist(&self, gpio: bool) -> Option<Setting> {
        let drivers = ["pinctrl_bcm2835", "pinctrl_rp1"];
        let value = drivers.iter().find_map(|driver| {
            self.read(&format!(
                "/sys/module/{driver}/parameters/persist_gpio_outputs"
            ))
        });
        let means = match value.as_deref() {
            Some("Y") => "MA stays high after biss has ended",
            Some(_) => "MA becomes an input after biss has ended: pull it up, docs/wiring.md",
            None if !gpio => return None,
            None if self.is_pi() => "this kernel does not say: pull MA up, docs/wiring.md",
            None => {
                "not a bcm2835: what MA does after biss has ended is its driver's choice; pull it up, docs/wiring.md"
            }
        };
        Some(Setting {
            name: "persist_gpio_outputs",
            value: value.unwrap_or_else(|| "-".into()),
            means: means.into(),
            fix: None,
        })
    }

    /// A soft limit of this process, as text; the kernel's own words for it.
    fn limit(&self, name: &str) -> Option<String> {
        let limits = self.read("/proc/self/limits")?;
        let line = limits.lines().find_map(|line| line.strip_prefix(name))?;
        Some(line.split_whitespace().next()?.to_owned())
    }

    /// Whether this process has a capability, by its number in linux/capability.h.
    fn capable(&self, number: u32) -> bool {
        let status = self.read("/proc/self/status").unwrap_or_default();
        let set = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
        let set = set.and_then(|set| u64::from_str_radix(set.trim(), 16).ok());
        set.is_some_and(|set| set >> number & 1 == 1)
    }

    fn priority(&self) -> Option<Setting> {
        const CAP_SYS_NICE: u32 = 23;
        const MOST: u32 = 99;
        let limit = self.limit("Max realtime priority")?;
        let most = match limit.parse::<u32>() {
            Ok(limit) if !self.capable(CAP_SYS_NICE) => limit.min(MOST),
            // Where there is none it is a word.
            _ => MOST,
        };
        let (means, fix) = match most {
            0 => (
                "--rt is refused",
                Some("allow it in /etc/security/limits.conf: docs/setup.md".into()),
            ),
            _ => ("--rt takes priorities up to this", None),
        };
        Some(Setting {
            name: "rtprio",
            value: most.to_string(),
            means: means.into(),
            fix,
        })
    }

    fn memory(&self) -> Option<Setting> {
        const CAP_IPC_LOCK: u32 = 14;
        /// For what this process has not asked for yet; `read` is not much larger than `list`.
        const MORE_KIB: u64 = 2048;
        let limit = self.limit("Max locked memory")?;
        let status = self.read("/proc/self/status")?;
        let size = status
            .lines()
            .find_map(|line| line.strip_prefix("VmSize:"))?;
        let size_kib: u64 = size.split_whitespace().next()?.parse().ok()?;
        let want_mib = (size_kib + MORE_KIB).div_ceil(1024);
        let limit_mib = limit.parse::<u64>().ok().map(|bytes| bytes >> 20);
        let limit_mib = limit_mib.filter(|_| !self.capable(CAP_IPC_LOCK));
        let fix = limit_mib
            .filter(|mib| *mib < want_mib)
            .map(|_| "allow it in /etc/security/limits.conf: docs/setup.md".into());
        Some(Setting {
            name: "memlock",
            value: limit_mib.map_or("unlimited".into(), |mib| format!("{mib} MiB")),
            means: format!("memory that --rt may lock; it wants {want_mib} MiB"),
            fix,
        })
    }

    fn throttling(&self) -> Option<Setting> {
        let microseconds =
            |name| -> Option<i64> { self.read(&format!("/proc/sys/kernel/{name}"))?.parse().ok() };
        let runtime = microseconds("sched_rt_runtime_us")?;
        let period = microseconds("sched_rt_period_us")?;
        let means = if runtime < 0 || runtime >= period {
            "--rt may run without a pause".to_owned()
        } else {
            format!(
                "--rt pauses up to {} ms in every {} ms for other programs",
                (period - runtime) / 1000,
                period / 1000
            )
        };
        Some(Setting {
            name: "sched_rt_runtime_us",
            value: runtime.to_string(),
            means,
            fix: None,
        })
    }

    fn governor(&self) -> Option<Setting> {
        const PATH: &str = "/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor";
        let value = self.read(PATH)?;
        let steady = value == "performance";
        let means = if steady {
            "the processor's clock is steady"
        } else {
            "the processor's clock changes, and gpio's timing with it"
        };
        let fix = PATH.replace("cpu0", "cpu*");
        Some(Setting {
            name: "governor",
            value,
            means: means.into(),
            fix: (!steady).then(|| format!("echo performance | sudo tee {fix}")),
        })
    }

    fn isolated(&self) -> Option<Setting> {
        let value = self.read("/sys/devices/system/cpu/isolated")?;
        Some(Setting {
            name: "isolcpus",
            value,
            means: "processors kept free of other programs: good for --cpu".into(),
            fix: None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::ReportFormat;
    use std::os::unix::fs::symlink;
    use std::sync::atomic::{AtomicU32, Ordering};

    /// A machine made of files.
    struct Fake(PathBuf);

    impl Fake {
        fn new(files: &[(&str, &str)]) -> Fake {
            static COUNT: AtomicU32 = AtomicU32::new(0);
            let count = COUNT.fetch_add(1, Ordering::Relaxed);
            let name = format!("biss-list-{}-{count}", std::process::id());
            let fake = Fake(std::env::temp_dir().join(name));
            fs::create_dir(&fake.0).unwrap();
            for (path, text) in files {
                fs::write(fake.place(path), text).unwrap();
            }
            fake
        }

        fn place(&self, path: &str) -> PathBuf {
            let path = self.0.join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            path
        }

        fn links(self, links: &[(&str, &str)]) -> Fake {
            for (path, target) in links {
                symlink(target, self.place(path)).unwrap();
            }
            self
        }

        fn with(&self, open: &dyn Fn(&Path, bool) -> io::Result<()>) -> Report {
            Machine {
                root: &self.0,
                open,
                ask: &|_| Ok(chip()),
            }
            .report()
        }

        fn report(&self) -> Report {
            self.with(&|_, _| Ok(()))
        }

        fn text(&self) -> String {
            let report = self.report();
            let text = report.render(ReportFormat::Text, false).unwrap();
            // The presets are every machine's.
            let (own, presets) = text.split_once("\nPresets").unwrap();
            let (_, hint) = presets.split_once("\n\n").unwrap_or_default();
            own.replacen(std::env::consts::ARCH, "ARCH", 1) + hint
        }
    }

    impl Drop for Fake {
        fn drop(&mut self) {
            fs::remove_dir_all(&self.0).unwrap();
        }
    }

    fn chip() -> ChipInside {
        let line = |line, name: &str, output, consumer: Option<&str>| Line {
            chip: "gpiochip0".into(),
            line,
            name: Some(name.into()),
            direction: if output { "output" } else { "input" },
            used: consumer.is_some(),
            consumer: consumer.map(str::to_owned),
        };
        ChipInside {
            name: "gpiochip0".into(),
            label: "pinctrl-bcm2711".into(),
            uapi: "v1",
            lines: vec![
                line(0, "ID_SDA", false, None),
                line(8, "SPI_CE0_N", true, Some("spi0 CS0")),
                line(17, "GPIO17", true, Some("biss MA")),
            ],
        }
    }

    const PI: (&str, &str) = ("proc/device-tree/model", "Raspberry Pi 4 Model B Rev 1.5\0");
    const LIMITS: (&str, &str) = (
        "proc/self/limits",
        "Limit  Soft Limit  Hard Limit  Units\n\
         Max locked memory         8388608              8388608              bytes\n\
         Max realtime priority     0                    0\n",
    );
    const STATUS: (&str, &str) = (
        "proc/self/status",
        "VmSize:\t    5000 kB\nCapEff:\t0000000000000000\n",
    );

    /// A Raspberry Pi with everything.
    fn pi() -> Fake {
        Fake::new(&[
            PI,
            LIMITS,
            STATUS,
            ("proc/sys/kernel/osrelease", "6.12.47+rpt-rpi-v8\n"),
            ("proc/sys/kernel/sched_rt_runtime_us", "950000\n"),
            ("proc/sys/kernel/sched_rt_period_us", "1000000\n"),
            ("dev/gpiochip0", ""),
            ("dev/spidev0.1", ""),
            ("dev/spidev0.0", ""),
            ("dev/spidev10.0", ""),
            ("dev/spidev1.0", ""),
            ("dev/spidev0.x", ""),
            ("sys/module/spidev/parameters/bufsiz", "4096\n"),
            ("sys/module/spidev/initstate", "live\n"),
            (
                "sys/module/pinctrl_bcm2835/parameters/persist_gpio_outputs",
                "Y\n",
            ),
            (
                "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor",
                "ondemand\n",
            ),
            ("sys/devices/system/cpu/isolated", "3\n"),
        ])
        .links(&[
            ("dev/gpiochip4", "gpiochip0"),
            (
                "sys/class/spi_master/spi0/device/driver",
                "../../../bus/platform/drivers/spi-bcm2835",
            ),
            (
                "sys/class/spi_master/spi1/device/driver",
                "../../../bus/platform/drivers/spi-bcm2835aux",
            ),
        ])
    }

    #[test]
    fn a_raspberry_pi_with_everything() {
        assert_eq!(
            pi().text(),
            "\
Raspberry Pi 4 Model B Rev 1.5, Linux 6.12.47+rpt-rpi-v8, ARCH

GPIO
  gpio:0  gpiochip0 [pinctrl-bcm2711], 3 lines, GPIO v1
      8  SPI_CE0_N  output  held by spi0 CS0
     17  GPIO17     output  held by biss MA
    1 line is free, -v shows it

SPI
  spi:0.0          wave:0.0   spi-bcm2835, may be used
  spi:0.1          wave:0.1   spi-bcm2835, may be used
  spi:1.0,phase=2  wave:1.0   spi-bcm2835aux, may be used
  spi:10.0         wave:10.0  may be used

Settings
  spidev.bufsiz         4096      bytes in one transfer at most
    fix: echo options spidev bufsiz=65536 | sudo tee /etc/modprobe.d/spidev.conf, then reboot
  persist_gpio_outputs  Y         MA stays high after biss has ended
  rtprio                0         --rt is refused
    fix: allow it in /etc/security/limits.conf: docs/setup.md
  memlock               8 MiB     memory that --rt may lock; it wants 7 MiB
  sched_rt_runtime_us   950000    --rt pauses up to 50 ms in every 1000 ms for other programs
  governor              ondemand  the processor's clock changes, and gpio's timing with it
    fix: echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor
  isolcpus              3         processors kept free of other programs: good for --cpu
"
        );
    }

    /// What is reported as missing, and its fix.
    fn missing(fake: &Fake, what: &str) -> Vec<(String, Option<String>)> {
        let missing = fake.report().missing.into_iter();
        missing
            .filter(|missing| missing.what == what)
            .map(|missing| (missing.why, missing.fix))
            .collect()
    }

    #[test]
    fn every_way_to_have_no_spidev_has_its_fix() {
        let bus = ("sys/class/spi_master/spi0/uevent", "");
        let device = ("sys/bus/spi/devices/spi0.0/modalias", "spi:foo");
        let spidev = ("sys/bus/spi/drivers/spidev/uevent", "");
        let one = |files: &[(&str, &str)], links: &[(&str, &str)]| {
            let fake = Fake::new(files).links(links);
            let mut found = missing(&fake, "spi");
            assert_eq!(found.len(), 1, "{found:?}");
            let (why, fix) = found.remove(0);
            format!("{why} > {}", fix.unwrap_or_default())
        };
        let firmware = ("boot/firmware/config.txt", "");
        assert_eq!(
            one(&[PI, firmware], &[]),
            "SPI is not switched on > add dtparam=spi=on to /boot/firmware/config.txt and reboot"
        );
        assert_eq!(
            one(&[PI, ("boot/config.txt", "")], &[]),
            "SPI is not switched on > add dtparam=spi=on to /boot/config.txt and reboot"
        );
        let other = ("sys/firmware/devicetree/base/model", "Radxa ROCK 5B\0");
        assert_eq!(
            one(&[other], &[]),
            "no SPI controller is switched on > switch one on in the board's device tree: docs/setup.md"
        );
        assert_eq!(
            one(&[PI, bus], &[]),
            "nothing is declared on the SPI bus (spi0) > declare a device for spidev in the device tree: docs/setup.md"
        );
        assert_eq!(
            one(&[PI, bus, device], &[]),
            "spi0.0 has no driver: the module spidev is not loaded > sudo modprobe spidev"
        );
        assert_eq!(
            one(&[PI, bus, device, spidev], &[]),
            "spi0.0 is no device that spidev takes by itself > echo spidev | sudo tee \
             /sys/bus/spi/devices/spi0.0/driver_override; echo spi0.0 | sudo tee /sys/bus/spi/drivers/spidev/bind"
        );
        let driver = ("sys/bus/spi/devices/spi0.0/driver", "../../drivers/mcp251x");
        assert_eq!(
            one(&[PI, bus, device, spidev], &[driver]),
            "spi0.0 belongs to the driver mcp251x > take out the overlay that gives it to that driver: docs/setup.md"
        );
        let class = ("sys/class/spidev/spidev0.0/dev", "153:0");
        assert_eq!(
            one(&[PI, bus, device, spidev, class], &[]),
            "the kernel has spidev0.0, but there is no /dev/spidev0.0 > in a container, pass it in: \
             docker run --device /dev/spidev0.0"
        );
    }

    #[test]
    fn presets_come_with_what_their_sheets_say() {
        let report = Fake::new(&[]).report();
        let short = report.render(ReportFormat::Text, false).unwrap();
        let long = report.render(ReportFormat::Text, true).unwrap();
        let json = report.render(ReportFormat::Json, false).unwrap();
        for preset in preset::all() {
            assert!(short.contains(&format!("\n  {}  ", preset.name)), "{short}");
            assert!(
                short.contains(preset.about) && !short.contains(preset.source),
                "{short}"
            );
            for part in [preset.format, preset.source, preset.note] {
                assert!(long.contains(part), "{long}");
            }
            let name = format!("{{\"type\":\"list-preset\",\"name\":\"{}\"", preset.name);
            let line = json.lines().find(|line| line.starts_with(&name)).unwrap();
            let record: serde_json::Value = serde_json::from_str(line).unwrap();
            assert_eq!(record["frame"], preset.format);
            let clock = preset.clock_max.map(|clock| clock.0);
            assert_eq!(record["clock_max_hz"].as_u64(), clock.map(u64::from));
            assert_eq!(
                record["interval_ns"].as_u64(),
                preset.interval.map(|time| time.0)
            );
        }
    }

    #[test]
    fn a_laptop_is_told_what_works_without() {
        let fake = Fake::new(&[
            ("sys/class/dmi/id/sys_vendor", "LENOVO\n"),
            ("sys/class/dmi/id/product_name", "20XW\n"),
            ("proc/sys/kernel/osrelease", "6.1.0-56-amd64\n"),
        ]);
        assert_eq!(
            fake.text(),
            "\
LENOVO 20XW, Linux 6.1.0-56-amd64, ARCH

GPIO
  this machine has no GPIO chip

SPI
  this machine has no SPI controller
Nothing to connect an encoder to; `biss read sim` needs none.
"
        );
        let container = Fake::new(&[("sys/bus/gpio/devices/gpiochip0/dev", "254:0")]);
        assert_eq!(
            missing(&container, "gpio")[0].0,
            "the kernel has gpiochip0, but there is no /dev/gpiochip0"
        );
    }

    #[test]
    fn who_may_not_open_is_told_the_group() {
        let groups = "root:x:0:\nspi:x:989:pi\ngpio:x:986:pi\nbroken\n";
        assert_eq!(group(0o020_660, 986, groups).as_deref(), Some("gpio"));
        assert_eq!(group(0o020_660, 989, groups).as_deref(), Some("spi"));
        assert_eq!(group(0o020_660, 7, groups).as_deref(), Some("7"), "no name");
        assert_eq!(group(0o020_600, 986, groups), None, "not the group's");
        assert_eq!(group(0o020_640, 986, groups), None, "not for writing");
        assert_eq!(group(0o020_660, 0, groups), None, "nobody joins root");
    }

    #[test]
    fn a_refused_device_is_listed_with_its_fix() {
        let fake = Fake::new(&[PI, ("dev/gpiochip0", ""), ("dev/spidev0.0", "")]);
        for (errno, said, fix) in [
            (libc::EACCES, "Permission denied", "udev rule|usermod"),
            (libc::EPERM, "Operation not permitted", "container"),
            (libc::ENXIO, "No such device", "driver"),
            (libc::EIO, "Input/output error", "dmesg"),
        ] {
            let report = fake.with(&|_, _| Err(io::Error::from_raw_os_error(errno)));
            let text = report.render(ReportFormat::Text, false).unwrap();
            let lines: Vec<&str> = text.lines().collect();
            let chip = lines.iter().position(|line| line.starts_with("  gpio:0"));
            let spidev = lines.iter().position(|line| line.starts_with("  spi:0.0"));
            for at in [chip.unwrap(), spidev.unwrap()] {
                assert!(lines[at].contains(said), "{text}");
                assert!(
                    fix.split('|').any(|fix| lines[at + 1].contains(fix)),
                    "{text}"
                );
            }
            let json = report.render(ReportFormat::Json, false).unwrap();
            let refused = json.lines().filter(|line| line.contains("\"open\":false"));
            assert_eq!(refused.count(), 2, "{json}");
            assert!(!json.contains("list-line"), "{json}");
        }
    }

    #[test]
    fn a_chip_that_opens_and_does_not_answer_says_why() {
        let fake = Fake::new(&[("dev/gpiochip0", "")]);
        let report = Machine {
            root: &fake.0,
            open: &|_, _| Ok(()),
            ask: &|_| {
                Err(link::Error::new(
                    "asking",
                    "no v1, no v2",
                    "boot another kernel",
                ))
            },
        }
        .report();
        let text = report.render(ReportFormat::Text, false).unwrap();
        let wanted = "  gpio:0  /dev/gpiochip0: no v1, no v2\n    fix: boot another kernel\n";
        assert!(text.contains(wanted), "{text}");
    }

    #[test]
    fn limits_yield_to_capabilities() {
        let all = (
            "proc/self/status",
            "VmSize:\t    5000 kB\nCapEff:\t000001ffffffffff\n",
        );
        let values = |files: &[(&str, &str)]| {
            let settings = Fake::new(files).report().settings;
            let shown = settings.iter().map(|setting| {
                format!(
                    "{} {} {}",
                    setting.name,
                    setting.value,
                    setting.fix.is_some()
                )
            });
            shown.collect::<Vec<_>>()
        };
        assert_eq!(
            values(&[LIMITS, STATUS]),
            ["rtprio 0 true", "memlock 8 MiB false"]
        );
        assert_eq!(
            values(&[LIMITS, all]),
            ["rtprio 99 false", "memlock unlimited false"]
        );
        let tight = (
            "proc/self/limits",
            "Max locked memory  4194304  67108864  bytes\nMax realtime priority  50  99\n",
        );
        assert_eq!(
            values(&[tight, STATUS]),
            ["rtprio 50 false", "memlock 4 MiB true"]
        );
        let none = (
            "proc/self/limits",
            "Max locked memory  unlimited  unlimited  bytes\nMax realtime priority  unlimited  unlimited\n",
        );
        assert_eq!(
            values(&[none, STATUS]),
            ["rtprio 99 false", "memlock unlimited false"]
        );
    }

    #[test]
    fn what_becomes_of_ma_is_said_for_each_kind_of_kernel() {
        let means = |files: &[(&str, &str)]| {
            let settings = Fake::new(files).report().settings;
            let persist = settings
                .into_iter()
                .find(|s| s.name == "persist_gpio_outputs");
            persist.map(|setting| (setting.value, setting.means))
        };
        let chip = ("dev/gpiochip0", "");
        let said = |value: &str, means: &str| Some((value.to_owned(), means.to_owned()));
        let parameter = "sys/module/pinctrl_rp1/parameters/persist_gpio_outputs";
        assert_eq!(
            means(&[PI, chip, (parameter, "Y\n")]),
            said("Y", "MA stays high after biss has ended")
        );
        assert_eq!(
            means(&[PI, chip, (parameter, "N\n")]),
            said(
                "N",
                "MA becomes an input after biss has ended: pull it up, docs/wiring.md"
            )
        );
        assert_eq!(
            means(&[PI, chip]),
            said("-", "this kernel does not say: pull MA up, docs/wiring.md")
        );
        assert!(means(&[chip]).unwrap().1.starts_with("not a bcm2835"));
        assert_eq!(means(&[]), None);
    }

    #[test]
    fn names_from_devices_cannot_command_the_terminal() {
        let fake = Fake::new(&[
            ("dev/gpiochip0", ""),
            ("proc/device-tree/model", "a\u{1b}[2Jb\0"),
        ]);
        let hostile = || {
            let mut chip = chip();
            chip.label = "x\u{9b}31m\u{202e}y".into();
            chip.lines[1].consumer = Some("evil\r\u{7}\n  fix: rm".into());
            chip
        };
        let report = Machine {
            root: &fake.0,
            open: &|_, _| Ok(()),
            ask: &|_| Ok(hostile()),
        }
        .report();
        let text = report.render(ReportFormat::Text, true).unwrap();
        assert!(text.contains("a?[2Jb"), "{text}");
        assert!(text.contains("[x?31m?y]"), "{text}");
        assert!(text.contains("held by evil???  fix: rm\n"), "{text}");
        assert!(
            text.chars().all(|c| c == '\n' || !c.is_control()),
            "{text:?}"
        );
        let json = report.render(ReportFormat::Json, false).unwrap();
        let line = json.lines().find(|line| line.contains("evil")).unwrap();
        let line: serde_json::Value = serde_json::from_str(line).unwrap();
        assert_eq!(
            line["consumer"], "evil\r\u{7}\n  fix: rm",
            "scripts get the name as it is"
        );
    }

    #[test]
    fn every_key_is_explained() {
        let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/output.md");
        let page = fs::read_to_string(page).unwrap();
        let bare = Fake::new(&[PI, LIMITS, STATUS, ("proc/sys/kernel/osrelease", "6.12")]);
        let full = pi();
        let refused = full.with(&|_, _| Err(io::Error::from_raw_os_error(libc::EACCES)));
        let mut keys = std::collections::BTreeSet::new();
        let mut explained = |word: &str| {
            assert!(
                page.contains(&format!("`{word}`")),
                "docs/output.md: {word}"
            );
            keys.insert(word.to_owned());
        };
        for report in [bare.report(), full.report(), refused] {
            for line in report.render(ReportFormat::Json, false).unwrap().lines() {
                let record: serde_json::Map<_, _> = serde_json::from_str(line).unwrap();
                explained(record["type"].as_str().unwrap());
                record.keys().for_each(|key| explained(key));
                if record["type"] == "list-setting" {
                    explained(record["name"].as_str().unwrap());
                }
            }
        }
        assert!(keys.len() > 30, "too few to show anything: {keys:?}");
    }

    #[test]
    fn json_has_an_object_a_thing_and_its_type_first() {
        let fake = Fake::new(&[
            PI,
            LIMITS,
            STATUS,
            ("dev/gpiochip0", ""),
            ("dev/spidev0.0", ""),
        ]);
        let json = fake.report().render(ReportFormat::Json, false).unwrap();
        let lines: Vec<&str> = json.lines().collect();
        assert_eq!(
            lines[1],
            r#"{"type":"list-chip","link":"gpio:0","path":"/dev/gpiochip0","open":true,"name":"gpiochip0","label":"pinctrl-bcm2711","uapi":"v1","lines":3}"#
        );
        assert_eq!(
            lines[3],
            r#"{"type":"list-line","chip":"gpiochip0","line":8,"name":"SPI_CE0_N","direction":"output","used":true,"consumer":"spi0 CS0"}"#
        );
        assert_eq!(
            lines[5],
            r#"{"type":"list-spidev","link":"spi:0.0","wave":"wave:0.0","path":"/dev/spidev0.0","open":true}"#
        );
        let types: Vec<&str> = lines
            .iter()
            .map(|line| line.split('"').nth(3).unwrap())
            .collect();
        let wanted = "list-board list-chip list-line list-line list-line list-spidev";
        assert!(types.join(" ").starts_with(wanted), "{types:?}");
        assert!(
            types[6..]
                .iter()
                .all(|kind| ["list-setting", "list-preset"].contains(kind))
        );
    }
}
