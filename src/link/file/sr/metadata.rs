//! `metadata`, which says what a sigrok session holds. Source: libsigrok `src/output/srzip.c` and `src/session_file.c` (0.5.2).

/// A session's first device with logic channels.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Metadata {
    /// What the names of its chunks begin with.
    pub(super) capture: String,
    pub(super) rate_hz: Option<u64>,
    /// Bytes a sample.
    pub(super) unit: usize,
    /// Bits of a sample that were recorded, and their names.
    pub(super) probes: Vec<(usize, String)>,
}

/// No logic analyser has more channels.
const MOST_UNIT: usize = 8;

/// One `[device N]`.
#[derive(Default)]
struct Device {
    capture: Option<String>,
    rate_hz: Option<u64>,
    unit: Option<usize>,
    total: Option<usize>,
    analog: bool,
    probes: Vec<(usize, String)>,
}

impl Metadata {
    pub(super) fn parse(text: &str) -> Result<Metadata, String> {
        let mut devices: Vec<Device> = Vec::new();
        let mut inside = false;
        for (number, line) in text.lines().enumerate() {
            let line = line.trim();
            if line.is_empty() || line.starts_with(['#', ';']) {
                continue;
            }
            if let Some(section) = line.strip_prefix('[').and_then(|l| l.strip_suffix(']')) {
                inside = section.starts_with("device ");
                if inside {
                    devices.push(Device::default());
                }
            } else if let (true, Some(device)) = (inside, devices.last_mut()) {
                let pair = line
                    .split_once('=')
                    .ok_or_else(|| "is not KEY=VALUE".to_owned());
                let set = pair.and_then(|(key, value)| device.set(key.trim(), value.trim()));
                set.map_err(|said| {
                    format!(
                        "`metadata`, line {}: `{}` {said}",
                        number + 1,
                        shortened(line)
                    )
                })?;
            }
        }
        let analog = devices.iter().any(|device| device.analog);
        let logic = devices.into_iter().find(Device::is_logic);
        match logic {
            Some(device) => device.finish(),
            None if analog => {
                Err("it holds analog channels only: record logic channels".to_owned())
            }
            None => Err("its `metadata` speak of no logic channels".to_owned()),
        }
    }
}

impl Device {
    fn set(&mut self, key: &str, value: &str) -> Result<(), String> {
        let count = || {
            value
                .parse::<usize>()
                .map_err(|_| "is no number".to_owned())
        };
        match key {
            "capturefile" => self.capture = Some(value.to_owned()),
            "samplerate" => {
                self.rate_hz = Some(rate(value).ok_or_else(|| "is no sample rate".to_owned())?);
            }
            "unitsize" => self.unit = Some(count()?),
            "total probes" => self.total = Some(count()?),
            "total analog" => self.analog = count()? > 0,
            _ => {
                // Channels count from 1.
                let number = key
                    .strip_prefix("probe")
                    .and_then(|n| n.parse::<usize>().ok());
                if let Some(bit) = number.and_then(|number| number.checked_sub(1)) {
                    if bit >= 8 * MOST_UNIT {
                        return Err(format!("is more than {} channels", 8 * MOST_UNIT));
                    }
                    self.probes.push((bit, value.to_owned()));
                }
            }
        }
        Ok(())
    }

    fn is_logic(&self) -> bool {
        self.capture.is_some() && self.total != Some(0)
    }

    fn finish(self) -> Result<Metadata, String> {
        let last = self.probes.iter().map(|(bit, _)| bit + 1).max();
        let total = self.total.or(last).unwrap_or(0);
        let unit = self.unit.unwrap_or(total.div_ceil(8));
        if !(1..=MOST_UNIT).contains(&unit) {
            return Err(format!(
                "its samples have {unit} bytes: 1 to {MOST_UNIT} can be read"
            ));
        }
        if last.is_some_and(|last| last > 8 * unit) {
            return Err(format!("more channels than samples of {unit} bytes have"));
        }
        let mut probes = self.probes;
        if probes.is_empty() {
            let total = total.min(8 * unit);
            probes = (0..total).map(|bit| (bit, bit.to_string())).collect();
        }
        Ok(Metadata {
            capture: self.capture.unwrap_or_default(),
            rate_hz: self.rate_hz,
            unit,
            probes,
        })
    }
}

fn shortened(line: &str) -> String {
    let more = if line.chars().nth(60).is_some() {
        "…"
    } else {
        ""
    };
    let line: String = line.chars().take(60).collect();
    format!("{}{more}", line.escape_debug())
}

/// `24 MHz`, `12.5MHz`, `1000000`: in hertz, at most a terahertz.
fn rate(text: &str) -> Option<u64> {
    const MOST_HZ: u64 = 1_000_000_000_000;
    let digits = |c: char| c.is_ascii_digit() || c == '.';
    let at = text.find(|c| !digits(c)).unwrap_or(text.len());
    let (number, unit) = (&text[..at], text[at..].trim().to_ascii_lowercase());
    let power = match unit.strip_suffix("hz").unwrap_or(&unit) {
        "" => 0,
        "k" => 3,
        "m" => 6,
        "g" => 9,
        _ => return None,
    };
    let (whole, part) = number.split_once('.').unwrap_or((number, ""));
    let part = part.trim_end_matches('0');
    let zeros = usize::checked_sub(power, part.len())?;
    let digits = format!("{whole}{part}{}", "0".repeat(zeros));
    let hz = digits.parse().ok()?;
    (1..=MOST_HZ).contains(&hz).then_some(hz)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As sigrok-cli 0.7.2 with libsigrok 0.5.2 writes it.
    const SIGROK: &str = "[global]\nsigrok version=0.5.2\n\n[device 1]\ncapturefile=logic-1\ntotal probes=2\nsamplerate=24 MHz\ntotal analog=0\nprobe1=MA\nprobe2=SLO\nunitsize=1\n";

    #[test]
    fn reads_what_sigrok_writes() {
        let metadata = Metadata::parse(SIGROK).unwrap();
        let want = Metadata {
            capture: "logic-1".into(),
            rate_hz: Some(24_000_000),
            unit: 1,
            probes: vec![(0, "MA".into()), (1, "SLO".into())],
        };
        assert_eq!(metadata, want);
        let gaps = SIGROK
            .replace("total probes=2", "total probes=16")
            .replace("probe2", "probe12")
            .replace("unitsize=1\n", "");
        let metadata = Metadata::parse(&gaps).unwrap();
        assert_eq!(
            (metadata.unit, metadata.probes[1].clone()),
            (2, (11, "SLO".into()))
        );
    }

    #[test]
    fn says_what_is_wrong() {
        for (from, to, said) in [
            ("unitsize=1", "unitsize=0", "0 bytes"),
            ("unitsize=1", "unitsize=9", "9 bytes"),
            (
                "unitsize=1",
                "unitsize=-1",
                "line 11: `unitsize=-1` is no number",
            ),
            ("probe2", "probe9", "more channels"),
            ("probe2", "probe65", "64 channels"),
            ("24 MHz", "0 Hz", "no sample rate"),
            ("24 MHz", "24 parsec", "no sample rate"),
            ("24 MHz", "1.5 Hz", "no sample rate"),
            ("24 MHz", "99999999999999999999 GHz", "no sample rate"),
            ("capturefile", "capture", "no logic channels"),
            ("total probes=2", "total probes=0", "no logic channels"),
            ("samplerate=", "samplerate ", "line 7"),
            ("[device 1]", "[dev]", "no logic channels"),
        ] {
            let text = SIGROK.replace(from, to);
            let error = Metadata::parse(&text).unwrap_err();
            assert!(error.contains(said), "{to}: {error}");
        }
        let analog = "[device 1]\nsamplerate=1 MHz\ntotal analog=2\nanalog1=A\n";
        assert!(Metadata::parse(analog).unwrap_err().contains("analog"));
    }

    #[test]
    fn rates() {
        for (text, hz) in [
            ("24 MHz", Some(24_000_000)),
            ("12.5 MHz", Some(12_500_000)),
            ("1 GHz", Some(1_000_000_000)),
            ("200kHz", Some(200_000)),
            ("1000000", Some(1_000_000)),
            ("500 Hz", Some(500)),
            ("1.50 kHz", Some(1_500)),
            ("", None),
            ("MHz", None),
            (".", None),
            ("1.2.3 MHz", None),
        ] {
            assert_eq!(rate(text), hz, "{text}");
        }
    }
}
