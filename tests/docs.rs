//! README.md and docs/*.md, run.
//!
//! Every fenced block carries a tag, and the tag says what is done with it:
//!
//! * `console`: `$ COMMAND` (continued by `> ` lines) and, below it, exactly what a terminal would show: stdout and
//!   stderr in one stream. Each command is a `sh -c` of its own in the project's root, with the biss under test first in
//!   PATH; `$?` is the exit status of the command before it in the block, other shell state is not kept. In expected
//!   lines `[..]` stands for anything within a line, a line `...` for any lines. `cargo run --release -- ARGS` runs as
//!   `biss ARGS`. Where a pipeline's two ends write to the same stream its order is chance: such a biss wants `-q`.
//!   A block with a program of `FOREIGN` is left out, and that said, where it is not installed.
//!   Without jq, what stands before `| jq` must still succeed and print JSON Lines.
//!   BISS_BLESS=1 writes what is printed now in the place of what is shown, where that has no `[..]` and no `...`.
//! * `sh`: commands for hardware, never run. What a verb of biss takes there must parse, and its options must exist.
//! * `json`: one value a line, each must parse. `verilog`: stands so in a file of docs/exec. `text`, `toml`, `ini`:
//!   nothing.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

use biss::control::Failure;
use biss::cycle::Fault;
use biss::link::Spec;
use biss::measure::{Resolution, Unit};
use biss::place::Zero;
use biss::preset::Frame;
use biss::slave::KEYS;
use biss::unit::{Hertz, Nanos};
use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::Read;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const TAGS: [&str; 7] = ["console", "sh", "text", "toml", "json", "ini", "verilog"];

/// Programs that pages show and biss does not need.
const FOREIGN: [&str; 5] = ["python3", "iverilog", "vvp", "sqlite3", "gnuplot"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// README.md first, then docs/ by name.
fn pages() -> Vec<(String, String)> {
    let mut docs: Vec<PathBuf> = fs::read_dir(root().join("docs"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|end| end == "md"))
        .collect();
    docs.sort();
    docs.insert(0, root().join("README.md"));
    let read = |path: PathBuf| {
        let name = path.strip_prefix(root()).unwrap().display().to_string();
        (name, fs::read_to_string(path).unwrap())
    };
    docs.into_iter().map(read).collect()
}

fn page(name: &str) -> String {
    fs::read_to_string(root().join(name)).unwrap()
}

/// A fenced block.
#[derive(Debug)]
struct Block {
    page: String,
    /// How many lines of the page stand before its first one.
    above: usize,
    tag: String,
    lines: Vec<String>,
}

impl Block {
    fn at(&self) -> String {
        format!("{}:{}", self.page, self.above)
    }
}

fn blocks(name: &str, text: &str) -> Result<Vec<Block>, String> {
    let mut all: Vec<Block> = Vec::new();
    let mut open = false;
    for (index, line) in text.lines().enumerate() {
        let at = format!("{name}:{}", index + 1);
        match line.trim_start().strip_prefix("```") {
            Some("") if open => open = false,
            Some(_) if open => return Err(format!("{at}: a block begins inside a block")),
            Some(tag) if !TAGS.contains(&tag) => {
                return Err(format!("{at}: the tag `{tag}` is none of {TAGS:?}"));
            }
            Some(tag) => {
                open = true;
                all.push(Block {
                    page: name.to_owned(),
                    above: index + 1,
                    tag: tag.to_owned(),
                    lines: Vec::new(),
                });
            }
            None if open => all.last_mut().unwrap().lines.push(line.to_owned()),
            None => {}
        }
    }
    match open {
        true => Err(format!("{name}: the last block does not end")),
        false => Ok(all),
    }
}

fn blocks_tagged(tag: &str) -> Vec<Block> {
    let all = pages().into_iter().flat_map(|(name, text)| {
        blocks(&name, &text).unwrap_or_else(|complaint| panic!("{complaint}"))
    });
    all.filter(|block| block.tag == tag).collect()
}

/// One command of a console block and the lines below it.
#[derive(Debug, PartialEq)]
struct Step {
    command: String,
    expected: Vec<String>,
    /// How many lines of the page stand above the expected ones.
    above: usize,
}

fn steps(block: &Block) -> Result<Vec<Step>, String> {
    let mut steps: Vec<Step> = Vec::new();
    for (index, line) in block.lines.iter().enumerate() {
        let above = block.above + index + 1;
        if let Some(command) = line.strip_prefix("$ ") {
            steps.push(Step {
                command: command.to_owned(),
                expected: Vec::new(),
                above,
            });
            continue;
        }
        let Some(step) = steps.last_mut() else {
            return Err(format!("{}: output before the first `$ `", block.at()));
        };
        match line.strip_prefix("> ") {
            Some(more) if step.expected.is_empty() => {
                step.command.push('\n');
                step.command.push_str(more);
                step.above = above;
            }
            _ => step.expected.push(line.clone()),
        }
    }
    match steps.is_empty() {
        true => Err(format!("{}: no `$ ` in a console block", block.at())),
        false => Ok(steps),
    }
}

/// `[..]` stands for anything within a line.
fn line_fits(pattern: &str, line: &str) -> bool {
    let mut parts = pattern.split("[..]");
    let Some(mut rest) = parts.next().and_then(|first| line.strip_prefix(first)) else {
        return false;
    };
    let mut parts: Vec<&str> = parts.collect();
    let Some(last) = parts.pop() else {
        return rest.is_empty();
    };
    for part in parts {
        match rest.find(part) {
            Some(at) => rest = &rest[at + part.len()..],
            None => return false,
        }
    }
    rest.ends_with(last)
}

/// A line `...` stands for any lines.
fn fits(expected: &[String], lines: &[&str]) -> bool {
    match expected.split_first() {
        None => lines.is_empty(),
        Some((dots, below)) if dots == "..." => {
            (0..=lines.len()).any(|skipped| fits(below, &lines[skipped..]))
        }
        Some((pattern, below)) => lines
            .split_first()
            .is_some_and(|(line, rest)| line_fits(pattern, line) && fits(below, rest)),
    }
}

struct Ran {
    output: String,
    status: i32,
}

/// Runs one command as a terminal would show it. `before` is the exit status of the command before it.
fn run(command: &str, before: i32) -> Ran {
    let biss = Path::new(env!("CARGO_BIN_EXE_biss"));
    let mut path = biss.parent().unwrap().as_os_str().to_owned();
    path.push(":");
    path.push(std::env::var_os("PATH").unwrap_or_default());
    let command = command.replace("cargo run --release -- ", "biss ");
    let mut child = Command::new("sh")
        .args(["-c", &format!("exec 2>&1\n(exit {before})\n{command}")])
        .current_dir(root())
        .env("PATH", path)
        .env("LC_ALL", "C.UTF-8")
        .env("NO_COLOR", "1")
        .env_remove("BISS_LINK")
        .env_remove("BISS_FRAME")
        .env("XDG_CONFIG_HOME", "/nonexistent")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut output = String::new();
    child
        .stdout
        .take()
        .unwrap()
        .read_to_string(&mut output)
        .unwrap();
    // A shell that died of a signal shows as one that was told so.
    let status = child.wait().unwrap().code().unwrap_or(-1);
    Ran { output, status }
}

fn installed(program: &str) -> bool {
    run(&format!("command -v {program} > /dev/null"), 0).status == 0
}

/// Whether a block needs what is not installed, and need not be.
fn lacks(block: &Block, all: bool) -> bool {
    let shown = |program: &str| {
        let command = |line: &String| line.starts_with("$ ") && line.contains(program);
        block.lines.iter().any(command)
    };
    let missing = FOREIGN
        .iter()
        .find(|program| shown(program) && !installed(program));
    if let Some(program) = missing {
        assert!(!all, "{program} is not installed");
        println!("{program} is not installed: {} is not run", block.at());
    }
    missing.is_some()
}

/// What was printed instead of what is shown.
#[derive(Debug, PartialEq)]
enum Wrong {
    Lines(Vec<String>),
    NoJq(String),
}

/// The exit status of a step, and what it did wrong, if anything.
fn check(step: &Step, before: i32, jq: bool) -> (i32, Option<Wrong>) {
    if let (Some((head, _)), false) = (step.command.split_once("| jq"), jq) {
        let Ran { output, status } = run(head, before);
        println!("jq is not installed, ran only: {head}");
        let json = |line: &str| serde_json::from_str::<Map<String, Value>>(line).is_ok();
        let good = status == 0 && !output.is_empty() && output.lines().all(json);
        return (0, (!good).then_some(Wrong::NoJq(output)));
    }
    let Ran { output, status } = run(&step.command, before);
    let lines: Vec<&str> = output.lines().collect();
    if fits(&step.expected, &lines) {
        return (status, None);
    }
    let lines = lines.into_iter().map(str::to_owned).collect();
    (status, Some(Wrong::Lines(lines)))
}

fn complain(block: &Block, step: &Step, wrong: &Wrong) -> String {
    const MOST: usize = 20;
    let printed = match wrong {
        Wrong::NoJq(output) => format!("a failure, or no JSON Lines before `| jq`:\n{output}"),
        Wrong::Lines(lines) if lines.len() > MOST => {
            format!("{}\n(and more)", lines[..MOST].join("\n"))
        }
        Wrong::Lines(lines) => lines.join("\n"),
    };
    let (at, shown) = (block.at(), step.expected.join("\n"));
    format!(
        "{at}\n$ {}\nshown:\n{shown}\nprinted:\n{printed}\n",
        step.command
    )
}

/// The lines of a page to be replaced, and by what.
type Change = (Range<usize>, Vec<String>);

fn blessed(text: &str, mut changes: Vec<Change>) -> String {
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    changes.sort_by_key(|(range, _)| range.start);
    for (range, new) in changes.into_iter().rev() {
        lines.splice(range, new);
    }
    lines.join("\n") + "\n"
}

#[test]
fn console_blocks_show_what_happens() {
    let jq = installed("jq");
    // What pages build goes there.
    fs::create_dir_all(root().join("target")).unwrap();
    let all = std::env::var_os("BISS_TEST_ALL").is_some();
    assert!(jq || !all, "jq is not installed");
    let bless = std::env::var_os("BISS_BLESS").is_some();
    let blocks = blocks_tagged("console");
    for page in [
        "README.md",
        "docs/output.md",
        "docs/registers.md",
        "docs/scope.md",
    ] {
        let shows = blocks.iter().any(|block| block.page == page);
        assert!(shows, "{page} has no console block");
    }
    let mut ran = 0;
    let mut complaints = Vec::new();
    let mut changes: BTreeMap<&str, Vec<Change>> = BTreeMap::new();
    for block in &blocks {
        if lacks(block, all) {
            continue;
        }
        let steps = steps(block).unwrap_or_else(|complaint| panic!("{complaint}"));
        let mut status = 0;
        for step in steps {
            let (now, wrong) = check(&step, status, jq);
            status = now;
            ran += 1;
            let exact = |line: &String| line != "..." && !line.contains("[..]");
            match wrong {
                Some(Wrong::Lines(lines)) if bless && step.expected.iter().all(exact) => {
                    let range = step.above..step.above + step.expected.len();
                    changes.entry(&block.page).or_default().push((range, lines));
                }
                Some(wrong) => complaints.push(complain(block, &step, &wrong)),
                None => {}
            }
        }
    }
    for (name, changes) in changes {
        fs::write(root().join(name), blessed(&page(name), changes)).unwrap();
    }
    println!("{ran} commands run");
    assert!(complaints.is_empty(), "{}", complaints.join("\n"));
}

#[test]
fn verilog_is_that_of_a_file() {
    let file = page("docs/exec/slave.v");
    for block in blocks_tagged("verilog") {
        let shown = block.lines.join("\n");
        assert!(file.contains(&shown), "{} is not in the file", block.at());
    }
}

/// The words of one shell command, quotes removed; enough for commands shown to people.
fn words(command: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut quote = None;
    for c in command.chars() {
        match (c, quote) {
            ('\'' | '"', None) => quote = Some(c),
            (c, Some(open)) if c == open => quote = None,
            (' ', None) => words.push(String::new()),
            (c, _) => words.last_mut().unwrap().push(c),
        }
    }
    words.retain(|word| !word.is_empty());
    words
}

/// What the value of an option must be.
type Check = fn(&str) -> Result<(), String>;

/// Options that take a value.
const VALUED: [(&str, Check); 24] = [
    ("--unit", |v| parses::<Unit>(v)),
    ("--resolution", |v| parses::<Resolution>(v)),
    ("-f --frame", |v| parses::<Frame>(v)),
    ("-c --clock", |v| parses::<Hertz>(v)),
    ("-i --interval", |v| parses::<Nanos>(v)),
    ("--wait", |v| parses::<Nanos>(v)),
    ("--ack-limit", |v| parses::<Nanos>(v)),
    ("--busy-limit", |v| parses::<Nanos>(v)),
    ("--timeout", |v| match v {
        "adaptive" => Ok(()),
        range => Nanos::range(range).map(drop).map_err(|e| e.to_string()),
    }),
    ("-n --count", |v| parses::<u64>(v)),
    ("--retries", |v| parses::<u32>(v)),
    ("--skip --seq --within", |v| parses::<u64>(v)),
    ("--at", |v| parses::<Nanos>(v)),
    ("--width", |v| parses::<u16>(v)),
    ("-w --write", |v| {
        match v.starts_with("--") || v.is_empty() {
            true => Err("a file".into()),
            false => Ok(()),
        }
    }),
    ("--rt", |v| parses::<u8>(v)),
    ("--cpu", |v| parses::<usize>(v)),
    ("-o --format", |v| one_of(v, &["text", "json", "csv"])),
    ("-F --fields", |v| {
        match v.starts_with('-') || v.is_empty() {
            true => Err("a list of names".into()),
            false => Ok(()),
        }
    }),
    ("--search", |v| {
        let named = v.split(',').all(|line| !line.is_empty());
        named
            .then_some(())
            .ok_or(format!("`{v}` is no list of lines"))
    }),
    ("--zero", |v| parses::<Zero>(v)),
    ("-t --time", |v| {
        one_of(v, &["zero", "delta", "unix", "none"])
    }),
    ("--color", |v| one_of(v, &["auto", "always", "never"])),
    ("-h --help", |_| Err("shows help only".into())),
];

fn parses<T: std::str::FromStr<Err: ToString>>(text: &str) -> Result<(), String> {
    text.parse::<T>().map(drop).map_err(|e| e.to_string())
}

fn one_of(value: &str, known: &[&str]) -> Result<(), String> {
    match known.contains(&value) {
        true => Ok(()),
        false => Err(format!("`{value}` is none of {known:?}")),
    }
}

/// A verb and its own help.
struct Verb {
    name: String,
    help: String,
}

/// All that `biss --help` lists.
fn verbs() -> Vec<Verb> {
    let help = run("biss --help", 0).output;
    let listed = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let names = listed.map_while(|line| line.split_whitespace().next());
    let verb = |name: &str| Verb {
        name: name.to_owned(),
        help: run(&format!("biss {name} --help"), 0).output,
    };
    names.filter(|name| *name != "help").map(verb).collect()
}

/// Checks one command line of an `sh` block. Whether it holds a verb of biss.
fn check_hardware(command: &str, verbs: &[Verb]) -> Result<bool, String> {
    let end = command.find(['|', '>', ';', '&', '#']);
    let words = words(&command[..end.unwrap_or(command.len())]);
    let Some(at) = words.iter().position(|word| word == "biss") else {
        // In quotes, for another program to run.
        let quoted = words.iter().filter(|word| word.starts_with("biss "));
        let checked: Vec<bool> = quoted
            .map(|word| check_hardware(word, verbs))
            .collect::<Result<_, _>>()?;
        return Ok(!checked.is_empty());
    };
    let variable = |name: &str| words[..at].iter().find_map(|word| word.strip_prefix(name));
    if let Some(format) = variable("BISS_FRAME=") {
        parses::<Frame>(format)?;
    }
    let mut rest = words[at + 1..].iter();
    let name = rest.next().ok_or("no verb")?;
    if ["-h", "--help", "-V", "--version"].contains(&name.as_str()) {
        return Ok(false);
    }
    let verb = verbs.iter().find(|verb| verb.name == *name);
    let help = &verb.ok_or(format!("biss has no verb `{name}`"))?.help;
    let mut link = variable("BISS_LINK=").map(str::to_owned);
    let usage = help.lines().find(|line| line.starts_with("Usage:"));
    let usage = usage.unwrap_or_default();
    let takes_more = !usage.trim_end().ends_with("LINK>") && !usage.trim_end().ends_with("[LINK]");
    while let Some(word) = rest.next() {
        if !word.starts_with('-') {
            // What comes behind it is for verbs that take more than a link.
            if link.is_none() || !takes_more {
                link = Some(word.clone());
            }
            continue;
        }
        if !help.split([' ', ',', '\n']).any(|known| known == word) {
            return Err(format!("`biss {name} --help` has no {word}"));
        }
        let valued = VALUED
            .iter()
            .find(|(names, _)| names.split(' ').any(|name| name == word));
        if let Some((_, value_fits)) = valued {
            value_fits(rest.next().map_or("", String::as_str))?;
        }
    }
    match link {
        Some(link) if usage.contains("LINK") => parses::<Spec>(&link)?,
        Some(word) => return Err(format!("`biss {name}` takes no {word}")),
        None if usage.contains("<LINK>") => return Err("no link".into()),
        None => {}
    }
    Ok(true)
}

#[test]
fn hardware_commands_parse() {
    let verbs = verbs();
    let mut checked = 0;
    for block in blocks_tagged("sh") {
        let text = block.lines.join("\n").replace("\\\n", " ");
        for command in text.lines() {
            match check_hardware(command, &verbs) {
                Ok(biss) => checked += usize::from(biss),
                Err(complaint) => panic!("{}\n{command}\n{complaint}", block.at()),
            }
        }
    }
    println!("{checked} commands checked");
    assert!(
        checked >= 4,
        "only {checked} hardware commands in all pages"
    );
}

#[test]
fn json_blocks_are_json() {
    for block in blocks_tagged("json") {
        for line in &block.lines {
            let value = serde_json::from_str::<Value>(line);
            assert!(value.is_ok(), "{}: {line}\n{value:?}", block.at());
        }
    }
}

#[test]
fn every_fault_is_explained() {
    for name in ["README.md", "docs/output.md"] {
        let text = page(name);
        for fault in Fault::NAMES {
            let row = format!("| `{fault}` |");
            assert!(text.contains(&row), "{name} has no row {row}");
        }
    }
}

#[test]
fn every_failure_of_an_access_is_explained() {
    let text = page("docs/output.md");
    for failure in Failure::NAMES {
        assert!(
            text.contains(&format!("| `{failure}` |")),
            "docs/output.md has no row for {failure}"
        );
    }
}

/// Those of objects within objects too.
fn every_key(value: &Value, keys: &mut BTreeSet<String>) {
    match value {
        Value::Object(object) => object.iter().for_each(|(key, value)| {
            keys.insert(key.clone());
            every_key(value, keys);
        }),
        Value::Array(all) => all.iter().for_each(|value| every_key(value, keys)),
        _ => {}
    }
}

#[test]
fn every_key_of_a_record_is_explained() {
    let text = page("docs/output.md");
    let mut keys = BTreeSet::new();
    for args in [
        "sim:motion=count,frame=mt12,st24,nE,nW,crc6+mt12,pos24,nE,nW,lc6,crc16 -v -n 2",
        "sim -f st14 -t delta",
        "sim -t unix --unwrap",
        "sim:stuck=0",
        "sim:stuck=1",
        "sim:no-start=1",
        "sim:crc-error=1",
        "sim:null=1",
        "sim:frame=st26,nE,nW,crc6 -f st25,nE,nW,crc6 -n 3",
        "sim:busy=0us..9us -i 100us -n 8",
        "sim:timeout=100us -c 30kHz -n 2",
        "file:tests/recordings/bench.vcd -f st26,nE,nW,crc6",
        "file:tests/recordings/faults.vcd -f st26,nE,nW,crc6",
        "file:tests/recordings/registers.vcd -f st3,nE,nW,crc3",
    ] {
        let output = run(&format!("biss read {args} -o json"), 0).output;
        for line in output.lines().filter(|line| line.starts_with('{')) {
            let record: Map<String, Value> = serde_json::from_str(line).unwrap();
            keys.extend(record.into_iter().map(|(key, _)| key));
        }
    }
    for args in [
        "reg sim:read-only=0x11 --bank 4 write 0x10=1,2 0x20=3 -o json -v",
        "command sim 10 --slave 0 -o json -v",
        "command sim:stuck=1 00 --broadcast -o json",
    ] {
        let output = run(&format!("biss {args}"), 0).output;
        for line in output.lines().filter(|line| line.starts_with('{')) {
            let record: Map<String, Value> = serde_json::from_str(line).unwrap();
            keys.extend(record.into_iter().map(|(key, _)| key));
        }
    }
    for args in [
        "detect sim -o json",
        "detect sim:device=none,motion=still -n 8 -o json",
        "detect file:tests/recordings/bench.vcd -o json",
    ] {
        let output = run(&format!("biss {args}"), 0).output;
        let object = output.lines().find(|line| line.starts_with('{')).unwrap();
        let record: Value = serde_json::from_str(object).unwrap();
        every_key(&record, &mut keys);
    }
    let statistics = page("docs/stats.md");
    for args in [
        "sim:frame=st12,crc6+st14,crc6 -f auto -n 20 -i 1ms",
        "file:tests/recordings/bench.vcd -f st26,nE,nW,crc6",
    ] {
        let output = run(&format!("biss stats {args} -o json"), 0).output;
        let object = output.lines().find(|line| line.starts_with('{')).unwrap();
        let record: Map<String, Value> = serde_json::from_str(object).unwrap();
        for (key, value) in record {
            let inner = value.as_array().and_then(|all| all.first()?.as_object());
            let inner = inner.or(value.as_object()).cloned().unwrap_or_default();
            for key in inner.into_iter().map(|(key, _)| key).chain([key]) {
                assert!(statistics.contains(&format!("`{key}`")), "stats.md: {key}");
            }
        }
    }
    let csv = run("biss read sim -o csv -v", 0).output;
    let header = csv.lines().find(|line| line.contains(",seq,")).unwrap();
    keys.extend(header.split(',').map(str::to_owned));
    assert!(keys.len() > 35, "too few keys to show anything: {keys:?}");
    for key in keys {
        assert!(text.contains(&format!("`{key}`")), "docs/output.md: {key}");
    }
}

#[test]
fn every_key_of_the_simulated_slave_is_explained() {
    let text = page("docs/links.md");
    for key in KEYS.iter().flat_map(|(keys, _)| keys.split(' ')) {
        assert!(text.contains(&format!("`{key}=")), "docs/links.md: {key}");
    }
}

/// Links within the project lead somewhere.
#[test]
fn links_lead_somewhere() {
    let mut seen = 0;
    for (name, text) in pages() {
        let here = root().join(&name);
        for target in text.split("](").skip(1).filter_map(|t| t.split(')').next()) {
            if target.contains("://") {
                continue;
            }
            let (file, anchor) = target.split_once('#').unwrap_or((target, ""));
            let there = match file {
                "" => here.clone(),
                file => here.parent().unwrap().join(file),
            };
            assert!(there.exists(), "{name}: no {target}");
            if !anchor.is_empty() {
                let text = fs::read_to_string(&there).unwrap();
                let found = headings(&text).any(|heading| heading == anchor);
                assert!(found, "{name}: no heading for {target}");
            }
            seen += 1;
        }
    }
    assert!(seen >= 5, "README.md does not lead to the other pages");
}

/// Headings as the anchors that forges make of them.
fn headings(text: &str) -> impl Iterator<Item = String> + '_ {
    let titles = text.lines().filter(|line| line.starts_with('#'));
    titles.map(|title| {
        let title = title.trim_start_matches('#').trim().to_lowercase();
        title
            .chars()
            .filter(|c| c.is_alphanumeric() || " -_".contains(*c))
            .map(|c| if c == ' ' { '-' } else { c })
            .collect()
    })
}

/// A test that cannot fail is worth nothing: each check refuses what it should.
#[test]
fn the_checks_refuse() {
    let own = |lines: &[&str]| lines.iter().map(|l| (*l).to_owned()).collect::<Vec<_>>();
    for (pattern, line, good) in [
        ("a b", "a b", true),
        ("a b", "a b ", false),
        ("a[..]b", "a x b", true),
        ("a[..]b", "a x", false),
        ("[..]", "", true),
        ("a[..]b[..]c", "a-b-c", true),
        ("a[..]b[..]c", "a-c", false),
        ("ab[..]bc", "abc", false),
    ] {
        assert_eq!(line_fits(pattern, line), good, "{pattern} {line}");
    }
    for (expected, lines, good) in [
        (&["a", "b"][..], &["a", "b"][..], true),
        (&["a"], &["a", "b"], false),
        (&["a", "b"], &["a"], false),
        (&["a", "..."], &["a", "b", "c"], true),
        (&["...", "c"], &["a", "b"], false),
        (&[], &["a"], false),
    ] {
        assert_eq!(fits(&own(expected), lines), good, "{expected:?} {lines:?}");
    }
    let step = |command: &str, expected: &[&str], above: usize| Step {
        command: command.to_owned(),
        expected: own(expected),
        above,
    };
    assert_eq!(check(&step("echo $?", &["3"], 0), 3, true), (0, None));
    assert_eq!(
        check(&step("echo no; exit 7", &["yes"], 0), 0, true),
        (7, Some(Wrong::Lines(own(&["no"]))))
    );
    let missing_jq = |command: &str| check(&step(command, &[], 0), 0, false).1;
    assert_eq!(missing_jq("biss read sim -o json | jq .pos"), None);
    assert!(missing_jq("biss read sim | jq .pos").is_some());
    assert!(missing_jq("biss read sim:stuck=1 -o json | jq .pos").is_some());

    for (text, words) in [
        ("```\nx\n```", "none of"),
        ("```rust\nx\n```", "none of"),
        ("```sh\nx", "does not end"),
        ("```sh\n```sh\n```", "inside a block"),
    ] {
        let complaint = blocks("page", text).unwrap_err();
        assert!(complaint.contains(words), "{complaint}");
    }
    let console = |text: &str| steps(&blocks("page", text).unwrap()[0]);
    assert!(console("```console\nx\n```").is_err());
    assert!(console("```console\n```").is_err());
    assert_eq!(
        console("```console\n$ for i in 1; do\n> echo $i\n> done\n1\n```").unwrap(),
        [step("for i in 1; do\necho $i\ndone", &["1"], 4)]
    );
    let changes = vec![(3..3, own(&["x", "y"])), (1..2, own(&["z"]))];
    assert_eq!(blessed("a\nb\nc\nd\n", changes), "a\nz\nc\nx\ny\nd\n");

    let verbs = verbs();
    for (command, good) in [
        ("biss read spi:0.0 -f st26,nE,nW,crc6 -c 2MHz", true),
        ("BISS_LINK=spi:0.0 biss read -q | jq .", true),
        ("sudo biss read spi:0.0,frame=st8 --rt 50 --cpu 3", true),
        ("hyperfine 'biss read sim -q' 'cat x'", true),
        ("hyperfine 'cat x' 'biss read simm'", false),
        ("biss read spi:0 -f st26", false),
        ("biss read spi:0.0 -f sx26", false),
        ("biss read spi:0.0 -f resolute-26 --zero here -o csv", true),
        ("BISS_FRAME=resolute-26 biss read spi:0.0 -F t_ns,pos", true),
        ("biss read spi:0.0 -f resolute-27", false),
        ("biss read spi:0.0 --zero home", false),
        ("biss read spi:0.0 -F", false),
        ("biss read spi:0.0 -c 2", false),
        ("biss read spi:0.0 -i 5", false),
        ("biss read spi:0.0 --rate 5", false),
        ("biss read", false),
        ("biss scope spi:0.0 -f st8 --fault --within 5", true),
        ("biss scope spi:0.0 -f st8 --within", false),
        ("biss scope spi:0.0 -w x.svg --at 5us", true),
        ("biss scope spi:0.0 --at 5", false),
        ("biss list", true),
        ("biss list -v -o json", true),
        ("biss list spi:0.0", false),
        ("biss list -f st26", false),
        ("biss guess spi:0.0", false),
        ("biss --quiet", false),
        ("biss", false),
    ] {
        let checked = check_hardware(command, &verbs);
        assert_eq!(checked.is_ok_and(|biss| biss), good, "{command}");
    }
}
