//! Who may know whom: the hourglass, enforced.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};

fn sources(folder: &str) -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    let mut folders = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join(folder)];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                let text = std::fs::read_to_string(&path).unwrap();
                // What stands in a module's own tests is not part of the layering.
                let code = text
                    .split("#[cfg(test)]")
                    .next()
                    .unwrap_or_default()
                    .to_owned();
                found.push((path, code));
            }
        }
    }
    found
}

/// Files of `src` below which none of `words` may stand.
fn forbid(files: &[&str], words: &[&str]) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    for file in files {
        assert!(root.join(file).exists(), "{file} has moved: say so here");
    }
    for (path, code) in sources("src") {
        let name = path
            .strip_prefix(&root)
            .unwrap()
            .to_string_lossy()
            .into_owned();
        if files.contains(&name.as_str()) {
            for (number, line) in code.lines().enumerate() {
                let line = line.split("//").next().unwrap_or_default();
                for word in words {
                    assert!(
                        !line.contains(word),
                        "{name}:{}: {word} in: {line}",
                        number + 1
                    );
                }
            }
        }
    }
}

/// Knows nothing of links, has no I/O and no clock.
const CORE: &[&str] = &[
    "control.rs",
    "control/access.rs",
    "control/exchange.rs",
    "control/failure.rs",
    "control/listen.rs",
    "control/quench.rs",
    "crc.rs",
    "cycle.rs",
    "diagnose.rs",
    "diagnose/flips.rs",
    "diagnose/restarts.rs",
    "diagnose/samples.rs",
    "detect.rs",
    "detect/chain.rs",
    "detect/fields.rs",
    "detect/gf2.rs",
    "detect/line.rs",
    "detect/listen.rs",
    "diagram.rs",
    "diagram/annotate.rs",
    "diagram/axis.rs",
    "diagram/labels.rs",
    "diagram/svg.rs",
    "diagram/text.rs",
    "format.rs",
    "frame.rs",
    "identity.rs",
    "identity/candidates.rs",
    "identity/device.rs",
    "identity/eds.rs",
    "identity/map.rs",
    "identity/profile.rs",
    "limits.rs",
    "loopback.rs",
    "measure.rs",
    "pair.rs",
    "parse.rs",
    "pattern.rs",
    "place.rs",
    "preset.rs",
    "protocol.rs",
    "scan.rs",
    "scan/region.rs",
    "scan/step.rs",
    "scan/wide.rs",
    "slave.rs",
    "slave/config.rs",
    "slave/control.rs",
    "slave/device.rs",
    "slave/image.rs",
    "slave/line.rs",
    "slave/random.rs",
    "slave/registers.rs",
    "slave/words.rs",
    "slice.rs",
    "stats.rs",
    "trace.rs",
    "track.rs",
    "unit.rs",
    "waveform.rs",
];
/// Know the core, not each other.
const LINKS: &[&str] = &[
    "link/bitbang.rs",
    "link/bus.rs",
    "link/exec.rs",
    "link/exec/child.rs",
    "link/file.rs",
    "link/file/advice.rs",
    "link/file/behaviour.rs",
    "link/file/csv.rs",
    "link/file/csv/number.rs",
    "link/file/csv/preamble.rs",
    "link/file/names.rs",
    "link/file/raw.rs",
    "link/file/source.rs",
    "link/file/sr.rs",
    "link/file/sr/archive.rs",
    "link/file/sr/metadata.rs",
    "link/file/tape.rs",
    "link/file/text.rs",
    "link/file/vcd.rs",
    "link/file/vcd/header.rs",
    "link/gpio.rs",
    "link/gpio/lines.rs",
    "link/gpio/serve.rs",
    "link/gpio/v1.rs",
    "link/gpio/v2.rs",
    "link/sim.rs",
    "link/spec.rs",
    "link/spi.rs",
    "link/tap.rs",
    "link/wave.rs",
];
/// Joins both.
const JOINTS: &[&str] = &[
    "config.rs",
    "config/save.rs",
    "identify.rs",
    "lib.rs",
    "link.rs",
    "master.rs",
    "record.rs",
    "record/csv.rs",
    "record/journal.rs",
    "record/sr.rs",
    "record/vcd.rs",
    "registers.rs",
    "trials.rs",
];
const BINARY: &[&str] = &[
    "cli.rs",
    "cli/detect.rs",
    "cli/generated.rs",
    "cli/reg.rs",
    "cli/scope.rs",
    "cli/stats.rs",
    "cli/watch.rs",
    "cli/wire.rs",
    "cmd.rs",
    "cmd/asked.rs",
    "cmd/auto.rs",
    "cmd/bank.rs",
    "cmd/beside.rs",
    "cmd/capture.rs",
    "cmd/command.rs",
    "cmd/counting.rs",
    "cmd/detect.rs",
    "cmd/info.rs",
    "cmd/line.rs",
    "cmd/list.rs",
    "cmd/loopback.rs",
    "cmd/overheard.rs",
    "cmd/poll.rs",
    "cmd/read.rs",
    "cmd/reg.rs",
    "cmd/saved.rs",
    "cmd/scope.rs",
    "cmd/session.rs",
    "cmd/stats.rs",
    "cmd/talk.rs",
    "cmd/watch.rs",
    "cmd/why.rs",
    "main.rs",
    "named.rs",
    "output.rs",
    "output/columns.rs",
    "output/detect.rs",
    "output/heard.rs",
    "output/info.rs",
    "output/json.rs",
    "output/list.rs",
    "output/loopback.rs",
    "output/progress.rs",
    "output/reg.rs",
    "output/scope.rs",
    "output/stats.rs",
    "output/summary.rs",
    "output/text.rs",
    "output/watch.rs",
    "sys.rs",
    "sys/ahead.rs",
];

#[test]
fn every_file_has_its_layer() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut found: Vec<String> = sources("src")
        .iter()
        .map(|(path, _)| {
            path.strip_prefix(&root)
                .unwrap()
                .to_string_lossy()
                .into_owned()
        })
        .collect();
    let mut listed: Vec<&str> = [CORE, LINKS, JOINTS, BINARY].concat();
    found.sort();
    listed.sort_unstable();
    assert_eq!(found, listed, "say in which layer a new file belongs");
}

#[test]
fn the_core_has_no_io_and_no_clock() {
    let outside = [
        "link",
        "master::",
        "std::{",
        "std::fs",
        "std::io",
        "std::time",
        "std::thread",
        "std::process",
        "std::net",
        "std::env",
        "Instant",
        "libc",
        "nix::",
        "spidev",
        "gpio_cdev",
        "gpiocdev",
        "signal_hook",
        "vcd",
    ];
    forbid(CORE, &outside);
    forbid(
        &["master.rs"],
        &[
            "std::fs",
            "std::io",
            "std::time",
            "Instant",
            "gpio",
            "spidev",
        ],
    );
}

#[test]
fn the_slave_shares_no_code_with_the_decoder() {
    forbid(
        &[
            "slave.rs",
            "slave/config.rs",
            "slave/control.rs",
            "slave/device.rs",
            "slave/image.rs",
            "slave/line.rs",
            "slave/random.rs",
            "slave/registers.rs",
            "slave/words.rs",
        ],
        &[
            "crate::frame",
            "crate::trace",
            "crate::control",
            ".of(",
            "crate::slice",
        ],
    );
}

#[test]
fn links_do_not_know_each_other_nor_what_frames_mean() {
    for link in LINKS {
        let kinds: Vec<String> = ["gpio", "spi", "wave", "sim", "file", "exec"]
            .iter()
            .filter(|kind| !link.starts_with(&format!("link/{kind}")))
            .flat_map(|kind| [format!("super::{kind}"), format!("link::{kind}")])
            .collect();
        let words: Vec<&str> = kinds.iter().map(String::as_str).collect();
        forbid(&[*link], &words);
        forbid(
            &[*link],
            &[
                "crate::frame",
                "crate::protocol",
                "crate::master",
                "crate::track",
            ],
        );
    }
}

#[test]
fn only_output_prints_and_only_main_exits() {
    let all: Vec<(PathBuf, String)> = sources("src");
    for (path, code) in &all {
        let name = path.file_name().unwrap().to_string_lossy();
        for (number, line) in code.lines().enumerate() {
            let place = format!("{}:{}: {line}", path.display(), number + 1);
            let prints = ["println!", "print!(", "io::stdout(", "io::stderr("]
                .iter()
                .any(|word| line.contains(word));
            let prints_it = name == "output.rs" || path.ends_with("output/progress.rs");
            assert!(!prints || prints_it, "{place}");
            assert!(
                !line.contains("process::exit")
                    && (!line.contains("ExitCode") || name == "main.rs"),
                "{place}"
            );
            let may = name == "sys.rs" || path.ends_with("scan/wide.rs");
            assert!(!line.contains("unsafe {") || may, "{place}");
            assert!(!line.contains("allow(unsafe_code)") || may, "{place}");
            assert!(!line.contains("dbg!"), "{place}");
            let binary = line.contains("anyhow") || line.contains("clap");
            let in_binary = ["main.rs", "cli.rs", "cmd.rs", "output.rs"].contains(&name.as_ref())
                || path
                    .parent()
                    .is_some_and(|p| p.ends_with("cmd") || p.ends_with("cli"));
            assert!(!binary || in_binary, "{place}");
        }
    }
}
