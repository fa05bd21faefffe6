//! Recordings as samples, and in the files that hold them.

use std::io::{Cursor, Write};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// What MA (bit 0) and SLO (bit 1) are at 0, `step_ns`, `2 * step_ns`…, of one of our VCDs, whose ticks are nanoseconds.
pub fn samples(vcd: &str, step_ns: u64) -> Vec<u8> {
    let (header, body) = vcd.split_once("$enddefinitions $end\n").unwrap();
    let code = |name: &str| {
        let var = header.lines().find(|line| line.contains(name)).unwrap();
        var.split(' ').nth(3).unwrap().to_owned()
    };
    let (ma, slo) = (code(" MA "), code(" SLO "));
    let mut samples = Vec::new();
    let (mut levels, mut begun) = (0u8, None);
    for line in body.lines() {
        if let Some(t) = line.strip_prefix('#') {
            let t_ns: u64 = t.parse().unwrap();
            let count = (t_ns - *begun.get_or_insert(t_ns)).div_ceil(step_ns);
            samples.resize(count as usize, levels);
            continue;
        }
        let (level, code) = line.split_at(1);
        let bit = if code == ma {
            1
        } else if code == slo {
            2
        } else {
            continue;
        };
        levels = if level == "1" {
            levels | bit
        } else {
            levels & !bit
        };
    }
    samples
}

/// As Saleae Logic exports it: a row a change.
pub fn csv(samples: &[u8], step_ns: u64) -> String {
    let mut text = "Time [ns],MA,SLO\n".to_owned();
    let mut row = |at: usize, levels: u8| {
        let t_ns = at as u64 * step_ns;
        text.push_str(&format!("{t_ns},{},{}\n", levels & 1, levels >> 1 & 1));
    };
    let mut last = None;
    for (at, levels) in samples.iter().enumerate() {
        if last != Some(levels) {
            row(at, *levels);
        }
        last = Some(levels);
    }
    row(samples.len(), *samples.last().unwrap());
    text
}

pub const METADATA: &str = "[global]\nsigrok version=0.5.2\n\n[device 1]\ncapturefile=logic-1\ntotal probes=2\nsamplerate=RATE\ntotal analog=0\nprobe1=MA\nprobe2=SLO\nunitsize=1\n";

/// A zip of these entries, in this order.
pub fn zip(entries: &[(&str, &[u8])], method: CompressionMethod) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(method);
    for (name, bytes) in entries {
        zip.start_file(*name, options).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

/// A session of sigrok: chunks of so many bytes.
pub fn session(samples: &[u8], rate: &str, chunk: usize) -> Vec<u8> {
    let metadata = METADATA.replace("RATE", rate);
    let names: Vec<String> = (1..=samples.len().div_ceil(chunk))
        .map(|number| format!("logic-1-{number}"))
        .collect();
    let chunks = names.iter().map(String::as_str).zip(samples.chunks(chunk));
    let mut entries: Vec<(&str, &[u8])> =
        vec![("version", b"2"), ("metadata", metadata.as_bytes())];
    entries.extend(chunks);
    zip(&entries, CompressionMethod::Deflated)
}
