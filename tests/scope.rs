//! `biss scope`: what it draws, in characters and as SVG.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod common;

use biss::cycle::Cycle;
use biss::diagram::text::{Style, draw};
use biss::diagram::{Diagram, Lane, Span, Tone, svg};
use biss::format::{Format, Kind};
use biss::frame::BissC;
use biss::link::bitbang::{Bang, Pins};
use biss::link::sim::{Controller, SimBus, SimPins};
use biss::link::wave::{Options, Wave};
use biss::link::{Error, Link, sim};
use biss::master::{Master, Slot};
use biss::slave::Config;
use biss::unit::Hertz;
use common::{biss, run, texts};
use fastrand::Rng;
use roxmltree::{Document, Node};
use std::fs;
use std::path::{Path, PathBuf};

/// How SLO is seen.
#[derive(Clone, Copy, Debug)]
enum Eye {
    /// When it changes.
    All,
    /// Where a bit is sampled, as pins do.
    Pins,
    /// Several times a clock.
    Samples,
}

/// Pins that are read when they are asked for, and take their time.
struct Plain(SimPins);

impl Pins for Plain {
    fn ma(&mut self, high: bool) -> Result<(), Error> {
        self.0.ma(high)?;
        self.0.until(self.0.now_ns() + 60);
        Ok(())
    }
    fn sl(&mut self) -> Result<bool, Error> {
        let level = self.0.sl();
        self.0.until(self.0.now_ns() + 40);
        level
    }
    fn now_ns(&self) -> u64 {
        self.0.now_ns()
    }
    fn until(&mut self, ns: u64) {
        self.0.until(ns);
    }
    fn cost_ns(&self) -> (u64, u64) {
        (60, 40)
    }
    fn virtual_time(&self) -> bool {
        true
    }
}

/// A cycle of a simulated encoder, and what is drawn of it.
fn diagram_by(eye: Eye, config: &str, format: &Format, hz: u32) -> (Diagram, Cycle) {
    let config: Config = config.parse().unwrap_or_else(|e| panic!("{config}: {e}"));
    let mut link: Box<dyn Link> = match eye {
        Eye::All => Box::new(sim::open(config)),
        Eye::Pins => Box::new(Bang::new(Plain(SimPins::new(config)))),
        Eye::Samples => {
            let bus = SimBus::new(config, Controller::default());
            Box::new(Wave::new(bus, Options::default(), None).unwrap())
        }
    };
    link.set_clock(Hertz(hz)).unwrap();
    let protocol = BissC::new(format.clone());
    let mut master = Master::new(link.as_mut(), &protocol, Some(0));
    master.open().unwrap();
    master.keep_waveform();
    let mut slot = || {
        let at_ns = master.link().now_ns() + 100_000;
        assert!(matches!(master.slot(at_ns, None), Ok(Slot::Done { .. })));
        (master.trace().clone(), master.cycle().clone())
    };
    let ((trace, cycle), (behind, _)) = (slot(), slot());
    let behind = &behind.wave.unwrap().changes;
    let drawn = Diagram::of(&trace, &cycle, Some(format), behind);
    (drawn.expect("there is a waveform"), cycle)
}

fn diagram(config: &str, format: &Format, hz: u32) -> (Diagram, Cycle) {
    diagram_by(Eye::All, config, format, hz)
}

fn lines(diagram: &Diagram, width: usize, unicode: bool) -> Vec<String> {
    let lines = draw(diagram, Style { width, unicode });
    let text = |line: Vec<(char, Tone)>| line.into_iter().map(|(glyph, _)| glyph).collect();
    lines.into_iter().map(text).collect()
}

/// Words of a drawing, of fields and what hangs below them: not those of the channels, which hold whole formats.
fn words(lines: &[String]) -> Vec<&str> {
    let other = |line: &&String| !line.contains("channel");
    let breaks = |c: char| !c.is_alphanumeric() && !"=_".contains(c);
    let words = lines
        .iter()
        .filter(other)
        .flat_map(|line| line.split(breaks));
    words
        .filter(|word| !word.is_empty() && *word != "=")
        .collect()
}

fn fields(diagram: &Diagram) -> impl Iterator<Item = &Span> {
    diagram.spans.iter().filter(|span| span.lane == Lane::Field)
}

/// A frame of any format, from a line of any kind, as the options of `sim`.
fn any(rng: &mut Rng) -> (Eye, String, Format, u32) {
    let format = common::format(rng);
    let mut config = vec![format!("seed={}", rng.u64(..1000))];
    if rng.u8(..3) == 0 {
        let clocks = rng.choice([0, 100, 400, 1_600, 3_300, 40_000]).unwrap();
        config.push(format!("delay={clocks}ns"));
    }
    if rng.u8(..3) == 0 {
        config.push(format!("busy={}ns", rng.u32(..40_000)));
    }
    if rng.u8(..4) == 0 {
        config.push("timeout=adaptive".into());
    }
    config.push(format!("frame={format}"));
    let hz = *rng
        .choice(&[250_000, 1_000_000, 2_000_000, 10_000_000])
        .unwrap();
    let eye = *rng.choice(&[Eye::All, Eye::Pins, Eye::Samples]).unwrap();
    (eye, config.join(","), format.parse().unwrap(), hz)
}

#[test]
fn every_field_is_named_once_with_its_value() {
    let mut rng = common::rng();
    let mut good = 0;
    for _ in 0..common::size(60) {
        let (eye, config, format, hz) = any(&mut rng);
        let (diagram, cycle) = diagram_by(eye, &config, &format, hz);
        if !cycle.is_good() {
            continue;
        }
        good += 1;
        let width = rng.usize(60..400);
        let lines = lines(&diagram, width, rng.bool());
        let place = format!("{eye:?} {config} {hz} {width}\n{}", lines.join("\n"));
        let words = words(&lines);
        for span in fields(&diagram).filter(|span| span.name != "surplus") {
            let name = span.name.as_str();
            let want = fields(&diagram).filter(|span| span.name == name).count();
            let found = words.iter().filter(|word| **word == name).count();
            assert_eq!(found, want, "{name}: {place}");
        }
        // What was decoded stands there, and at its own field.
        let text = lines.join("\n");
        let mut from = 0;
        for (channel, word) in format.channels().iter().zip(cycle.words()) {
            let data = word.good().unwrap();
            for field in channel.fields() {
                let found = fields(&diagram)
                    .skip(from)
                    .position(|span| is_called(&span.name, &spelled(field.kind())));
                from += found.expect("the field") + 1;
                let span = fields(&diagram).nth(from - 1).unwrap();
                let value = format!(" = {}", field.get(data));
                match field.kind() {
                    Kind::Padding => assert_eq!(span.value, ""),
                    Kind::Error { .. } | Kind::Warning { .. } => {
                        assert!(span.value.starts_with(&format!("{value}: ")), "{place}");
                    }
                    _ => {
                        assert_eq!(span.value, value, "{place}");
                        assert!(text.contains(&format!("{}{value}", span.name)), "{place}");
                    }
                }
            }
        }
    }
    assert!(good > common::size(60) / 2, "only {good} good frames");
}

/// By its kind, and a width if it has one.
fn is_called(name: &str, kind: &str) -> bool {
    let width = name.strip_prefix(kind);
    width.is_some_and(|width| width.is_empty() || width.starts_with(|c: char| c.is_ascii_digit()))
}

fn spelled(kind: &Kind) -> String {
    match kind {
        Kind::Turn => "mt".into(),
        Kind::SingleTurn => "st".into(),
        Kind::Position => "pos".into(),
        Kind::Padding => "pad".into(),
        Kind::Data(_) => "data".into(),
        Kind::Life => "lc".into(),
        Kind::Error { active_low } => if *active_low { "nE" } else { "E" }.into(),
        Kind::Warning { active_low } => if *active_low { "nW" } else { "W" }.into(),
    }
}

#[test]
fn no_width_is_exceeded_and_none_is_too_small() {
    let mut rng = common::rng();
    let faults = [
        "crc-error=1",
        "no-ack=1",
        "no-start=1",
        "stuck=0",
        "stuck=1",
        "flip=3%",
        "null=1",
        "turn=1",
    ];
    for round in 0..common::size(8) {
        let fault = faults[round % faults.len()];
        let (eye, config, format, hz) = any(&mut rng);
        let (diagram, _) = diagram_by(eye, &format!("{fault},{config}"), &format, hz);
        // All small ones, and some of the others.
        for width in (1..60).chain((60..=400).step_by(17)) {
            for unicode in [false, true] {
                let lines = lines(&diagram, width, unicode);
                let longest = lines.iter().map(|line| line.chars().count()).max();
                assert!(longest <= Some(width), "{config} {width}: {lines:#?}");
                assert!(
                    unicode || lines.iter().all(|line| line.is_ascii()),
                    "{lines:#?}"
                );
            }
        }
    }
}

/// The rule of the house: a position that is not good is not printed. The bits are.
#[test]
fn no_value_of_a_bad_word_is_drawn() {
    let mut rng = common::rng();
    let mut bad = 0;
    for _ in 0..common::size(60) {
        let bits = rng.u8(20..40);
        let format: Format = format!("st{bits},nE,nW,crc6+mt12,pos{bits},lc6,crc8")
            .parse()
            .unwrap();
        let position = rng.u64(1 << 18..1 << 20);
        let rate = rng
            .choice(["crc-error=1", "flip=4%", "no-start=1"])
            .unwrap();
        let config = format!("{rate},motion=still,pos={position},frame={format}");
        let (diagram, cycle) = diagram(&config, &format, 1_000_000);
        let text = lines(&diagram, 160, true).join("\n");
        let named = ["st", "pos"]
            .map(|name| fields(&diagram).find(|span| span.name == format!("{name}{bits}")));
        for (index, span) in named.into_iter().enumerate() {
            let word = cycle.words().get(index);
            if word.is_some_and(|word| word.good().is_some()) {
                assert_eq!(span.unwrap().value, format!(" = {position}"), "{text}");
                continue;
            }
            bad += 1;
            assert!(span.is_none_or(|span| span.value.is_empty()), "{text}");
            let (data, _) = word.map_or((0, 0), |word| word.raw());
            let field = format.channels()[index].position().unwrap().get(data);
            assert!(
                field < 1000 || !text.contains(&format!("= {field}")),
                "{text}"
            );
        }
        let fault = diagram.fault.map(|fault| fault.name());
        assert!(
            cycle.is_good() || fault.is_some_and(|fault| text.contains(fault)),
            "{text}"
        );
    }
    assert!(bad > 10, "only {bad} bad words");
}

// --- SVG ---

/// The box of a text, as wide as the fonts that were asked for are.
fn text_box(node: &Node) -> [f64; 4] {
    let number = |name: &str| -> f64 { node.attribute(name).unwrap().parse().unwrap() };
    let class: Vec<&str> = node.attribute("class").unwrap().split(' ').collect();
    let size = match class {
        _ if class.contains(&"h") => 13.0,
        _ if class.contains(&"s") => 9.0,
        _ => 11.0,
    };
    let text = node.text().unwrap_or_else(|| panic!("{node:?}"));
    let width = text.chars().count() as f64 * size * 0.6;
    let x = number("x")
        - match class {
            _ if class.contains(&"m") => width / 2.0,
            _ if class.contains(&"e") => width,
            _ => 0.0,
        };
    let y = number("y");
    [x, y - 0.7 * size, x + width, y + 0.1 * size]
}

/// All coordinates of a path that has none but M, L, H, V and Z.
fn path_points(path: &str) -> Vec<(f64, f64)> {
    let mut points = Vec::new();
    let mut at = (0.0, 0.0);
    assert!(!path.contains(['C', 'Q', 'A']), "{path}");
    let mut rest = path;
    while let Some(kind) = rest.chars().next() {
        rest = &rest[1..];
        let end = rest.find(char::is_alphabetic).unwrap_or(rest.len());
        let numbers: Vec<f64> = rest[..end]
            .split_whitespace()
            .map(|n| n.parse().unwrap())
            .collect();
        rest = &rest[end..];
        match (kind, &numbers[..]) {
            ('M' | 'L', [x, y]) => at = (*x, *y),
            ('H', [x]) => at.0 = *x,
            ('V', [y]) => at.1 = *y,
            ('Z', []) => {}
            _ => panic!("{kind} {numbers:?} in {path}"),
        }
        points.push(at);
    }
    points
}

/// Well-formed, on its own, inside its own frame, no text over another.
fn check_svg(svg: &str, place: &str) {
    let document = Document::parse(svg).unwrap_or_else(|e| panic!("{place}: {e}\n{svg}"));
    let root = document.root_element();
    assert_eq!(root.tag_name().name(), "svg");
    let view: Vec<f64> = root
        .attribute("viewBox")
        .unwrap()
        .split(' ')
        .map(|n| n.parse().unwrap())
        .collect();
    let inside = |x: f64, y: f64| {
        assert!(
            (view[0]..=view[2]).contains(&x) && (view[1]..=view[3]).contains(&y),
            "{place}: {x} {y} {view:?}"
        );
    };
    let known = [
        "svg", "title", "desc", "style", "text", "path", "rect", "circle",
    ];
    let mut boxes: Vec<([f64; 4], &str)> = Vec::new();
    for node in root.descendants().filter(Node::is_element) {
        let name = node.tag_name().name();
        assert!(known.contains(&name), "{place}: <{name}>");
        for attribute in node.attributes() {
            assert!(
                !attribute.name().contains("href") && !attribute.name().starts_with("on"),
                "{place}"
            );
        }
        let number = |name: &str| -> f64 { node.attribute(name).unwrap().parse().unwrap() };
        match name {
            "text" => {
                let found = text_box(&node);
                inside(found[0], found[1]);
                inside(found[2], found[3]);
                boxes.push((found, node.text().unwrap()));
            }
            "path" => path_points(node.attribute("d").unwrap())
                .into_iter()
                .for_each(|(x, y)| inside(x, y)),
            "rect" => {
                inside(number("x"), number("y"));
                inside(
                    number("x") + number("width"),
                    number("y") + number("height"),
                );
            }
            "circle" => inside(number("cx"), number("cy")),
            _ => {}
        }
    }
    for (index, (a, text)) in boxes.iter().enumerate() {
        for (b, other) in &boxes[..index] {
            let apart = a[0] >= b[2] || b[0] >= a[2] || a[1] >= b[3] || b[1] >= a[3];
            assert!(apart, "{place}: `{text}` over `{other}`");
        }
    }
    let title = root
        .children()
        .find(|node| node.has_tag_name(("http://www.w3.org/2000/svg", "title")));
    assert!(title.is_some_and(|title| title.text().is_some_and(|text| text.starts_with("BiSS-C"))));
}

#[test]
fn any_svg_is_well_formed_and_nothing_covers_anything() {
    let mut rng = common::rng();
    let faults = [
        "crc-error=1",
        "no-ack=1",
        "no-start=1",
        "stuck=0",
        "flip=3%",
        "turn=1",
        "turn=2",
        "turn=3",
    ];
    for round in 0..common::size(60) {
        let fault = faults[round % faults.len()];
        let (eye, config, format, hz) = any(&mut rng);
        let place = format!("{eye:?} {fault},{config} {hz}");
        let (diagram, _) = diagram_by(eye, &format!("{fault},{config}"), &format, hz);
        let heading = vec![
            ("cycle 0 <&\">".to_owned(), Tone::Plain),
            (diagram.facts.join(", "), Tone::Bad),
        ];
        let panel = || svg::Panel {
            heading: heading.clone(),
            diagram: &diagram,
        };
        check_svg(&svg::draw(&[panel()]), &place);
        if round % 8 == 0 {
            check_svg(&svg::draw(&[panel(), panel()]), &place);
        }
    }
}

// --- the program ---

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The pictures of docs/scope.md, and what draws them.
const PICTURES: [(&str, &str); 5] = [
    (
        "frame",
        "sim:delay=112ns,motion=still,pos=1003388,frame=st26,nE,nW,crc6",
    ),
    (
        "chain",
        "sim:slaves=each,warning=1,turn=7,motion=still,pos=839,frame=mt12,st16,nE,nW,crc6+st16,nE,nW,crc6 -c 2MHz",
    ),
    (
        "crc",
        "sim:crc-error=20%,seed=3,motion=still,pos=165,delay=80ns,frame=st12,nE,nW,crc6 --fault",
    ),
    (
        "stalled",
        "file:tests/recordings/faults.vcd -f st26,nE,nW,crc6 --fault",
    ),
    (
        "far",
        "sim:delay=40us,motion=still,pos=165,frame=st12,nE,nW,crc6",
    ),
];

/// BISS_BLESS=1 writes them anew.
#[test]
fn the_pictures_of_the_page_are_what_is_drawn() {
    let page = fs::read_to_string(root().join("docs/scope.md")).unwrap();
    for (name, args) in PICTURES {
        let (svg, stderr, status) = run(&format!("scope {args} -w -"));
        assert!(status.is_some_and(|status| status < 2), "{args}: {stderr}");
        check_svg(&svg, args);
        let path = root().join(format!("docs/scope/{name}.svg"));
        if std::env::var_os("BISS_BLESS").is_some() {
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(&path, &svg).unwrap();
        }
        assert_eq!(fs::read_to_string(&path).unwrap_or_default(), svg, "{name}");
        assert!(
            page.contains(&format!("](scope/{name}.svg)")),
            "{name} is not on the page"
        );
        assert!(
            page.contains(&format!("biss scope {args} -w {name}.svg")),
            "{name}: {args} is not on the page"
        );
    }
}

const SMALL: &str = "scope sim:motion=still,pos=5,delay=300ns,frame=st4,E,crc3 --width 90";

#[test]
fn a_small_frame_looks_like_this() {
    let want = "\
cycle 0, st4,E,crc3
0.000000  pos 5  112.5°  ok
MA 1 MHz, Ack 1 clock, CDS 0, line delay 300 ns, timeout 20 µs, CDM 0
                       ├───┤ T = 1 µs (1 MHz)                  ├───── CDM = 0 ──────┤
edge           1   2   3   4   5   6   7   8   9   10  11  12  13
MA     ──────┐ ┌─┐ ┌─┐ ┌─┐ ┌─┐ ┌─┐ ┌─┐ ┌─┐ ┌─┐ ┌─┐ ┌─┐ ┌─┐ ┌─┐ ┌────────────⌇─────────────
             └─┘ └─┘ └─┘ └─┘ └─┘ └─┘ └─┘ └─┘ └─┘ └─┘ └─┘ └─┘ └─┘
                   ├┤ line delay 300 ns  timeout 20 µs + delay ├────────────────────┤
SLO    ────────────●┐   ┌──●┐       ┌──●┐   ┌──●┐   ┌──●┐                           ┌─────
                    └──●┘   └──●───●┘   └──●┘   └──●┘   └──●───●───●────────⌇───────┘
bit                1   0   1   0   0   1   0   1   0   1   0   0   0
field           ├LAT┼Ack┼─┬─┼CDS┼─── st4 = 5 ───┼ E ┼crc3 = 0x04┼─┬─┤
                          ╰ start                                 ╰ stop
";
    let (stdout, stderr, status) = run(SMALL);
    assert_eq!(stdout, want, "\n{stdout}");
    assert_eq!((stderr.as_str(), status), ("", Some(0)));
}

/// In two rows; what has no room hangs below.
#[test]
fn a_small_fault_looks_like_this() {
    let want = "\
cycle 0, st4,E,crc3
0.000000  fault crc: got 0x05, want 0x04
MA 1 MHz, Ack 1 clock, CDS 0, line delay 300 ns, timeout 20
us, CDM 0
                       |---| T = 1 us (1 MHz)
edge           1   2   3   4   5   6   7   8   9
MA     ------+ +-+ +-+ +-+ +-+ +-+ +-+ +-+ +-+ +-+
             +-+ +-+ +-+ +-+ +-+ +-+ +-+ +-+ +-+ +-
                   || line delay 300 ns
SLO    ------------o+   +--o+       +--o+   +--o+
                    +--o+   +--o---o+   +--o+   +--
bit                1   0   1   0   0   1   0   1
field           |LAT|Ack|-+-|CDS|----- st4 -----|E
                          ` start

                   |----- CDM = 0 ------|
edge   10  11  12  13
MA     +-+ +-+ +-+ +-----------//-------------
       + +-+ +-+ +-+
                   |--------------------|
                   timeout 20 us + line delay
SLO     +--o+   +--o+                   +-----
       o+   +--o+   +--o-------//-------+
bit    0   1   0   1   0
field  -|-----+-----|-+-|
              |       ` stop
              ` crc3 = 0x05, want 0x04
fault   ^^^^^^^^^^^^  crc: got 0x05, want 0x04
";
    let args = "sim:crc-error=1,motion=still,pos=5,delay=300ns,frame=st4,E,crc3";
    let (stdout, _, status) = run(&format!("scope {args} --width 60 --ascii"));
    assert_eq!(stdout, want, "\n{stdout}");
    assert_eq!(status, Some(1));
}

#[test]
fn plain_characters_where_the_locale_has_no_others() {
    let args: Vec<&str> = SMALL.split(' ').collect();
    let plain = texts(biss(&args).env("LC_ALL", "C").output().unwrap()).0;
    assert!(
        plain.is_ascii() && plain.contains("timeout 20 us"),
        "{plain}"
    );
    let (asked, ..) = run(&format!("{SMALL} --ascii"));
    assert_eq!(plain, asked);
    let (rich, ..) = run(SMALL);
    assert_eq!(rich.lines().count(), plain.lines().count());
}

#[test]
fn columns_say_how_wide() {
    let drawn = |columns: &str| {
        let mut command = biss(&["scope", "sim"]);
        texts(command.env("COLUMNS", columns).output().unwrap()).0
    };
    for columns in ["60", "100"] {
        let text = drawn(columns);
        let longest = text.lines().map(|line| line.chars().count()).max().unwrap();
        let columns: usize = columns.parse().unwrap();
        assert!(
            longest <= columns && longest > columns * 2 / 3,
            "{longest}\n{text}"
        );
    }
    assert_eq!(drawn("nonsense"), drawn("80"));
}

#[test]
fn colours_only_where_they_are_asked_for() {
    let (plain, ..) = run(SMALL);
    assert!(!plain.contains('\x1b'));
    let (colored, ..) = run(&format!("{SMALL} --color always"));
    let mut stripped = String::new();
    let mut rest = colored.as_str();
    while let Some((before, behind)) = rest.split_once('\x1b') {
        stripped.push_str(before);
        rest = behind.split_once('m').unwrap().1;
    }
    assert_eq!(stripped + rest, plain);
    let (bad, ..) = run("scope sim:crc-error=1 --color always");
    assert!(bad.contains("\x1b[31m"), "{bad}");
}

#[test]
fn a_fault_is_found_and_drawn() {
    let file = "scope file:tests/recordings/faults.vcd -f st26,nE,nW,crc6";
    let (stdout, _, status) = run(&format!("{file} --fault --width 120"));
    assert_eq!(status, Some(1));
    assert!(
        stdout.starts_with("cycle 1,") && stdout.contains("up to 15 µs, limit 1.5 µs"),
        "{stdout}"
    );
    assert!(!stdout.contains("st26 ="), "{stdout}");
    let (stdout, _, status) = run(&format!("{file} --fault --skip 2"));
    assert!(
        stdout.starts_with("cycle 2,") && stdout.contains("short: 20 of 39 bits"),
        "{stdout}"
    );
    assert_eq!(status, Some(1));
    let (stdout, stderr, status) =
        run("scope file:tests/recordings/bench.vcd -f st26,nE,nW,crc6 --fault");
    assert_eq!((stdout.as_str(), status), ("", Some(0)));
    assert_eq!(stderr, "biss: no fault in this recording: 5 cycles\n");
    let (stdout, stderr, status) = run("scope sim --fault --within 20");
    assert_eq!((stdout.as_str(), status), ("", Some(0)));
    assert!(stderr.contains("no fault in 20 cycles"), "{stderr}");
    let (stdout, _, status) = run("scope sim:crc-error=10% --fault");
    assert!(stdout.contains("crc: got 0x"), "{stdout}");
    assert_eq!(status, Some(1));
}

/// After a doubtful frame others are run in the same slot: none of them is what came right behind the one that is drawn.
#[test]
fn the_timeout_ends_where_the_cycle_ends() {
    let (stdout, ..) = run("scope sim:busy=0us..30us,timeout=20us,frame=st8,crc6 --fault");
    assert!(stdout.contains("mismatch: start bit at clock"), "{stdout}");
    assert!(stdout.contains(", timeout 20 µs,"), "{stdout}");
}

#[test]
fn a_cycle_is_picked_as_read_counts_it() {
    let file = "file:tests/recordings/faults.vcd -f st26,nE,nW,crc6";
    let (records, ..) = run(&format!("read {file}"));
    for (seq, record) in records.lines().enumerate() {
        let record = record.trim_start().replace(" us", " µs");
        let (drawn, ..) = run(&format!("scope {file} --seq {seq} --width 200"));
        assert_eq!(drawn.lines().nth(1), Some(record.as_str()));
        let time = record.split(' ').next().unwrap();
        let (drawn, ..) = run(&format!("scope {file} --at {time}s --width 200"));
        assert_eq!(drawn.lines().nth(1), Some(record.as_str()), "{time}");
    }
    let (drawn, ..) = run(&format!("scope {file} -n 6"));
    let seqs = drawn.lines().filter(|line| line.starts_with("cycle "));
    assert_eq!(seqs.count(), 6);
    let (drawn, stderr, status) = run(&format!("scope {file} --skip 6"));
    assert_eq!((drawn.as_str(), status), ("", Some(1)));
    assert!(stderr.contains("it has 6 cycles"), "{stderr}");
    let (_, stderr, status) =
        run("scope file:tests/recordings/bench.vcd -f st26,nE,nW,crc6 --skip 4 -n 2");
    assert_eq!(
        (stderr.as_str(), status),
        ("biss: the recording ended, cycles drawn: 1\n", Some(1))
    );
}

#[test]
fn without_a_format_the_bits_are_drawn() {
    let (stdout, stderr, status) = run("scope file:tests/recordings/bench.vcd --width 200");
    assert_eq!(status, Some(0));
    assert!(
        stdout.contains("35 bits, format not known") && stdout.contains("CDS"),
        "{stdout}"
    );
    assert!(stderr.contains("no frame format"), "{stderr}");
}

/// MA is held low until SL = 1 and let go then: that rising edge has no number.
#[test]
fn cdm_shows_to_its_end() {
    let (stdout, ..) = run("scope file:tests/recordings/far.vcd -f st26,nE,nW,crc6 --width 250");
    assert!(
        stdout.contains("CDM = 1") && stdout.contains(", CDM 1\n"),
        "{stdout}"
    );
    let edges = stdout
        .lines()
        .find(|line| line.starts_with("edge"))
        .unwrap();
    assert!(edges.trim_end().ends_with(" 43"), "{stdout}");
    let ma = stdout
        .lines()
        .position(|line| line.starts_with("MA  "))
        .unwrap();
    let (top, low) = (
        stdout.lines().nth(ma).unwrap(),
        stdout.lines().nth(ma + 1).unwrap(),
    );
    assert!(low.contains("└───────"), "{stdout}");
    // Low, let go, and the first edge of the next cycle.
    assert!(top.ends_with("                ┌───┐"), "{stdout}");
    assert!(low.ends_with("────────────────┘   └─"), "{stdout}");
}

/// Bits that come clocks after the edges that set them carry the numbers of these.
#[test]
fn late_bits_name_their_edges() {
    let (stdout, ..) =
        run("scope sim:delay=40us,motion=still,pos=165,frame=st12,nE,nW,crc6 --width 120");
    assert!(
        stdout.contains("├ Ack ┼") || stdout.contains("├Ack┼"),
        "{stdout}"
    );
    let rows: Vec<&str> = stdout.lines().collect();
    let set_by = rows
        .iter()
        .position(|line| line.starts_with("set by"))
        .unwrap();
    let column = |line: &str, what: &str| line.split(what).next().unwrap().chars().count();
    // Ack is what edge 2 set.
    let ack = column(rows[set_by + 1], "Ack");
    let two = column(rows[set_by], " 2") + 1;
    assert!(two.abs_diff(ack) <= 3, "{stdout}");
    let (near, ..) = run("scope sim --width 120");
    assert!(!near.contains("set by"), "{near}");
}

fn scratch(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("biss-scope-{}", std::process::id()));
    fs::create_dir_all(&folder).unwrap();
    folder.join(name)
}

#[test]
fn an_svg_is_written_whole_or_not_at_all() {
    let path = scratch("frame.svg");
    let there = path.display().to_string();
    let (stdout, stderr, status) = run(&format!("scope sim -w {there}"));
    assert_eq!(
        (stdout.as_str(), stderr.as_str(), status),
        ("", "", Some(0))
    );
    let (direct, ..) = run("scope sim -w -");
    assert_eq!(fs::read_to_string(&path).unwrap(), direct);
    let (_, stderr, status) = run(&format!("scope sim -w {there}/no/frame.svg"));
    assert_eq!(status, Some(2));
    assert!(
        stderr.contains("writing ") && stderr.contains("may you write there"),
        "{stderr}"
    );
    fs::remove_file(path).unwrap();
}

#[test]
fn what_makes_no_sense_is_refused() {
    for (args, words) in [
        (
            "scope file:tests/recordings/bench.vcd -c 1MHz",
            "--clock has no meaning on a recording",
        ),
        ("scope sim -n 0", "0 is not in"),
        ("scope sim -w x.svg --ascii", "cannot be used with"),
        ("scope sim --within 5", "--fault"),
        ("scope sim --width 0", "0 is not in"),
        ("scope sim --at 5", "no unit"),
        ("scope sim -w x.png", "-w x.svg"),
        ("scope sim -w a.b.PDF", "-w a.b.svg"),
        ("scope sim --skip 99999999999", "--skip 99999999999"),
        (
            "scope file:tests/recordings/none.vcd",
            "opening the recording",
        ),
    ] {
        let (stdout, stderr, status) = run(args);
        assert_eq!((stdout.as_str(), status), ("", Some(2)), "{args}");
        assert!(stderr.contains(words), "{args}: {stderr}");
    }
}

/// What is left out may take long: Ctrl-C ends it, and it says so.
#[test]
#[cfg(unix)]
fn what_is_left_out_can_be_stopped() {
    let mut command = biss(&["scope", "sim", "--skip", "9999999"]);
    command.stderr(std::process::Stdio::piped());
    let child = command.spawn().unwrap();
    // Time to begin in; what comes too early ends it as well.
    std::thread::sleep(std::time::Duration::from_millis(300));
    let pid = child.id().to_string();
    let mut kill = std::process::Command::new("kill");
    assert!(kill.args(["-INT", &pid]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(
        stderr.starts_with("biss: stopped, cycles looked at: "),
        "{stderr}"
    );
    assert!(stderr.ends_with("drawn: none\n"), "{stderr}");
    assert_eq!(stderr.lines().count(), 1);
}
