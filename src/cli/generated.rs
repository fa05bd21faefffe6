//! Completions and the man page are made from the command line as clap sees it, and committed.
//!
//! `BISS_BLESS=1 cargo test --bin biss generated` writes them anew.

use super::with_verbs;
use clap::builder::{PossibleValue, PossibleValuesParser};
use clap::{Arg, Command, ValueHint};
use clap_complete::{Shell, generate};
use clap_mangen::Man;
use clap_mangen::roff::{Inline, Roff, bold, italic, roman};
use std::fs;
use std::path::Path;

/// All verbs with all their arguments.
fn whole() -> Command {
    with_verbs(|verb, command| (verb.takes)(command))
}

/// Every verb but `help`, with the names of its options filled in.
fn verbs() -> Vec<Command> {
    let mut command = whole().disable_help_subcommand(true);
    command.build();
    command.get_subcommands().cloned().collect()
}

/// A part of the text below the options: what stands between a title and the next one. A line that is not indented and
/// does not end in a colon is a part of its own, without a title.
struct Section {
    title: Option<String>,
    lines: Vec<Line>,
}

enum Line {
    /// Something, and what it is.
    Pair(String, String),
    Text(String),
}

impl Line {
    fn new(line: &str) -> Line {
        match pair(line) {
            Some((left, right)) => Line::Pair(left.into(), right.into()),
            None => Line::Text(line.into()),
        }
    }

    /// A line that is indented further goes on in one column, or in both.
    fn go_on(&mut self, line: &str) {
        match (pair(line), self) {
            (Some((left, right)), Line::Pair(what, about)) => {
                what.push_str(left);
                about.push_str("; ");
                about.push_str(right);
            }
            (None, Line::Pair(_, about)) => {
                about.push(' ');
                about.push_str(line);
            }
            // It was too long to have its other column beside it.
            (_, alone @ Line::Text(_)) => {
                let Line::Text(what) = &alone else { return };
                *alone = Line::Pair(what.clone(), line.into());
            }
        }
    }
}

/// Columns are wider apart than words; more than two are no pair.
fn pair(line: &str) -> Option<(&str, &str)> {
    let (left, right) = line.split_once("  ")?;
    let right = right.trim_start();
    (!right.contains("  ")).then_some((left, right))
}

fn sections(help: &str) -> Vec<Section> {
    let mut all: Vec<Section> = Vec::new();
    for line in help.lines().filter(|line| !line.is_empty()) {
        let Some((line, section)) = line.strip_prefix("  ").zip(all.last_mut()) else {
            let title = line.strip_suffix(':').map(str::to_owned);
            let text = title.is_none().then(|| Line::Text(line.into()));
            let lines = text.into_iter().collect();
            all.push(Section { title, lines });
            continue;
        };
        match section.lines.last_mut() {
            Some(last) if line.starts_with(' ') => last.go_on(line.trim_start()),
            _ => section.lines.push(Line::new(line)),
        }
    }
    all
}

fn help_below(command: &Command) -> String {
    command
        .get_after_help()
        .map(ToString::to_string)
        .unwrap_or_default()
}

// --- completions ---

/// How the links of a verb begin, and what they are; what follows depends on the machine, and `biss list` tells it.
fn links(verb: &Command) -> Vec<(String, String)> {
    let sections = sections(&help_below(verb)).into_iter();
    let of_links = sections.filter(|section| section.title.as_deref() == Some("Links"));
    let lines = of_links.flat_map(|section| section.lines);
    let links: Vec<_> = lines
        .filter_map(|line| match line {
            Line::Pair(link, about) => {
                let link = link.trim_start_matches("none, or ");
                let word = link.split('[').next()?.split_inclusive(':').next()?;
                // A straight quote would end the shell's own.
                let about = about.split([';', '.']).next()?.replace('\'', "’");
                Some((word.to_owned(), about))
            }
            Line::Text(_) => None,
        })
        .collect();
    assert!(links.len() > 2, "{}: {links:?}", verb.get_name());
    links
}

fn verbs_with_links() -> Vec<Command> {
    let takes_link = |verb: &Command| verb.get_arguments().any(|arg| arg.get_id() == "link");
    verbs().into_iter().filter(takes_link).collect()
}

/// Shells offer the words of an argument, or nothing; without a hint some of them offer files.
fn hinted(arg: Arg) -> Arg {
    match arg.get_id().as_str() {
        // Formats are free, presets have names.
        "frame" => {
            let presets = biss::preset::all().iter();
            let named = presets.map(|preset| PossibleValue::new(preset.name).help(preset.about));
            let auto = PossibleValue::new("auto").help("what the slaves' registers say");
            let asks =
                |names: &[clap::builder::Str]| names.iter().any(|name| name.ends_with("auto"));
            let auto = arg.get_value_names().is_some_and(asks).then_some(auto);
            let named = named.chain(auto);
            arg.value_parser(PossibleValuesParser::new(named))
        }
        _ if arg.get_value_hint() == ValueHint::Unknown
            && arg.get_possible_values().is_empty()
            && arg.get_action().takes_values() =>
        {
            arg.value_hint(ValueHint::Other)
        }
        _ => arg,
    }
}

fn all_hinted(verb: Command) -> Command {
    verb.mut_args(hinted).mut_subcommands(all_hinted)
}

fn completions(shell: Shell) -> String {
    let mut command = whole();
    for verb in verbs() {
        command = command.mut_subcommand(verb.get_name(), all_hinted);
    }
    for verb in verbs_with_links() {
        // clap wants words that live as long as the program does.
        let words = links(&verb).into_iter().map(|(link, _)| &*link.leak());
        let words = PossibleValuesParser::new(words.collect::<Vec<_>>());
        // Not mut_arg, which puts it behind the others.
        command = command.mut_subcommand(verb.get_name(), |verb| {
            verb.mut_args(|arg| match arg.get_id() == "link" {
                true => arg.value_parser(words.clone()),
                false => arg,
            })
        });
    }
    let mut script = Vec::new();
    generate(shell, &mut command, "biss", &mut script);
    let script = String::from_utf8(script).unwrap();
    match shell {
        Shell::Bash => bash(&script),
        Shell::Zsh => zsh(&script),
        _ => fish(&script),
    }
}

/// Puts something in the place of all there is of something else.
fn replace(script: &str, old: &str, new: &str) -> String {
    assert!(script.contains(old), "clap_complete no longer writes {old}");
    script.replace(old, new)
}

/// No space behind `gpio:`.
fn bash(script: &str) -> String {
    let own = "\
_biss_link() {
    _biss \"$@\"
    [[ ${#COMPREPLY[@]} -eq 1 && ${COMPREPLY[0]} == *: ]] && compopt -o nospace
    return 0
}

if [[ \"${BASH_VERSINFO";
    let script = script.replacen(
        "if [[ \"${BASH_VERSINFO[0]}\" -eq 4",
        &format!("{own}[0]}}\" -eq 4"),
        1,
    );
    replace(&script, "complete -F _biss ", "complete -F _biss_link ")
}

/// No space behind `gpio:`, and files behind `file:`.
fn zsh(script: &str) -> String {
    let mut script = script.to_owned();
    let mut own = String::new();
    for verb in verbs_with_links() {
        let (name, links) = (verb.get_name(), links(&verb));
        let words = links.iter().map(|(link, _)| link.replace(':', "\\:"));
        let words: Vec<String> = words.collect();
        let old = format!(":({})'", words.join(" "));
        assert!(
            script.contains(&old),
            "clap_complete no longer writes {old}"
        );
        script = script.replacen(&old, &format!(":_biss_{name}_links'"), 1);
        own.push_str(&format!("_biss_{name}_links() {{\n"));
        if links.iter().any(|(link, _)| link == "file:") {
            own.push_str(
                "    if compset -P 'file:'; then\n        _files\n        return\n    fi\n",
            );
        }
        own.push_str("    local -a links=(\n");
        for ((_, about), word) in links.iter().zip(words) {
            own.push_str(&format!("        '{word}:{about}'\n"));
        }
        own.push_str("    )\n    _describe -t links 'link' links -S ''\n}\n\n");
    }
    let last = "if [ \"$funcstack[1]\"";
    replace(&script, last, &format!("{own}{last}"))
}

/// The links, which clap_complete leaves out here.
fn fish(script: &str) -> String {
    let mut script = script.to_owned();
    for verb in verbs_with_links() {
        let links = links(&verb);
        let links = links
            .iter()
            .map(|(link, about)| format!("{link}\\t'{about}'"));
        let links = links.collect::<Vec<_>>().join("\n");
        let mut condition = format!("__fish_biss_using_subcommand {}", verb.get_name());
        let below: Vec<&str> = verb.get_subcommands().map(Command::get_name).collect();
        if !below.is_empty() {
            condition += &format!("; and not __fish_seen_subcommand_from {}", below.join(" "));
            // A verb is no file.
            let old = format!("\"{condition}\" -a ");
            script = replace(&script, &old, &format!("\"{condition}\" -f -a "));
        }
        script.push_str(&format!(
            "complete -c biss -n \"{condition}\" -a \"{links}\"\n"
        ));
    }
    script
}

// --- man page ---

/// roff as it is collected, without the preamble that each piece would have.
struct Page(String);

impl Page {
    fn control(&mut self, name: &str, args: &[&str]) {
        let mut roff = Roff::new();
        roff.control(name, args.iter().copied());
        self.0.push_str(&roff.to_roff());
    }

    fn text(&mut self, inlines: Vec<Inline>) {
        let mut roff = Roff::new();
        roff.text(inlines);
        self.0.push_str(&roff.to_roff());
    }

    fn paragraph(&mut self, text: &str) {
        self.control("PP", &[]);
        self.text(vec![roman(text)]);
    }

    fn item(&mut self, what: Inline, about: &str) {
        self.control("TP", &[]);
        self.text(vec![what]);
        self.text(vec![roman(about)]);
    }

    /// The options of a command below a heading of this size, the values of each close together.
    fn options(&mut self, command: &Command, heading: &str) {
        let mut piece = Vec::new();
        Man::new(command.clone())
            .render_options_section(&mut piece)
            .unwrap();
        let piece = String::from_utf8(piece).unwrap();
        let first = piece.find(".SH OPTIONS").unwrap();
        let piece = piece[first..]
            .replace(".SH ", &format!(".{heading} "))
            .replace(".SS OPTIONS", ".SS Options")
            .replace(".br\n\n.br\n", ".br\n")
            .replace(".RS 14\n", ".PD 0\n.RS 7\n")
            .replace(".RE\n", ".RE\n.PD\n");
        self.0.push_str(&piece);
    }

    fn lines(&mut self, section: &Section) {
        let mut running = false;
        for line in &section.lines {
            match line {
                Line::Pair(what, about) => self.item(bold(what), about),
                Line::Text(text) if running => self.text(vec![roman(text)]),
                Line::Text(text) => self.paragraph(text),
            }
            running = matches!(line, Line::Text(_));
        }
    }
}

const DESCRIPTION: [&str; 2] = [
    "biss clocks MA, samples SLO and prints checked positions of BiSS-C encoders: over two GPIO lines, an SPI bus, a \
     recording or a simulated encoder. It never prints a position that the encoder did not send: a frame that fails a \
     check shows its fault instead.",
    "stdout carries records, one a line, and nothing else; notes, summary and errors go to stderr, each beginning with \
     biss:. Quantities carry units: 500kHz, 40us, 2ms.",
];

const EXIT_STATUS: [(&str, &str); 3] = [
    ("0", "all that was asked for came, and was good"),
    ("1", "the wire answered badly, or not at all"),
    (
        "2",
        "wrong usage, or the machine: no such device, no permission, device lost",
    ),
];

const FILES: [(&str, &str); 3] = [
    (
        "/dev/gpiochipN",
        "GPIO chips, for gpio links; usually of the group gpio",
    ),
    (
        "/dev/spidevB.C",
        "SPI devices, for spi links; usually of the group spi",
    ),
    (
        "/sys/module/spidev/parameters/bufsiz",
        "how many bytes one SPI transfer may have",
    ),
];

const ENVIRONMENT: [(&str, &str); 2] = [
    ("NO_COLOR", "if set, text has no colours"),
    (
        "LC_ALL, LC_CTYPE, LANG",
        "where they do not name UTF-8, text says deg for the degree sign",
    ),
];

fn man_page() -> String {
    let command = whole();
    let mut page = Page(String::new());
    // Not by clap_mangen, which loses the date when it is empty.
    let version = env!("CARGO_PKG_VERSION");
    let head = format!(".TH BISS 1 \"\" \"biss {version}\" \"User Commands\"\n");
    page.0.push_str(".ie \\n(.g .ds Aq \\(aq\n.el .ds Aq '\n");
    page.0.push_str(&head);
    // Formats and options are no words to be torn apart.
    page.control("nh", &[]);
    page.control("ad", &["l"]);
    page.control("SH", &["NAME"]);
    let about = command
        .get_about()
        .map(ToString::to_string)
        .unwrap_or_default();
    page.text(vec![roman(format!("biss - {about}"))]);

    page.control("SH", &["SYNOPSIS"]);
    let mut verbs = verbs();
    for verb in &mut verbs {
        usage(&mut page, verb);
    }
    page.control("SH", &["DESCRIPTION"]);
    DESCRIPTION.iter().for_each(|text| page.paragraph(text));
    page.control("SH", &["COMMANDS"]);
    for verb in &verbs {
        let about = verb
            .get_about()
            .map(ToString::to_string)
            .unwrap_or_default();
        page.item(bold(format!("biss {}", verb.get_name())), &about);
    }
    page.options(&command, "SH");
    for verb in &mut verbs {
        page.control("SH", &[&format!("BISS {}", verb.get_name().to_uppercase())]);
        usage(&mut page, verb);
        if let Some(warning) = verb.get_before_help() {
            page.paragraph(&warning.to_string());
        }
        below(&mut page, verb);
        page.options(verb, "SS");
        let help = help_below(verb);
        for section in sections(&help) {
            if let Some(title) = &section.title {
                page.control("SS", &[title]);
            }
            page.lines(&section);
        }
    }
    ending(&mut page, &command, &verbs);
    page.0
}

fn usage(page: &mut Page, verb: &mut Command) {
    let usage = verb.render_usage().to_string();
    let usage = usage.trim_start_matches("Usage: ").trim();
    let (program, rest) = usage.split_at(usage.find([' ']).unwrap_or(usage.len()));
    let name = verb.get_name();
    let rest = rest.trim_start().trim_start_matches(name);
    page.control("PP", &[]);
    page.text(vec![bold(format!("{program} {name}")), roman(rest)]);
}

/// The verbs of a verb, with what only they take.
fn below(page: &mut Page, verb: &Command) {
    for sub in verb.get_subcommands() {
        let name = format!("biss {} LINK {}", verb.get_name(), sub.get_name());
        page.control("SS", &[&name]);
        let about = sub.get_about().map(ToString::to_string);
        page.paragraph(&about.unwrap_or_default());
        for arg in own(verb, sub) {
            let about = arg.get_help().map(ToString::to_string);
            page.item(bold(spelt(arg)), &about.unwrap_or_default());
        }
    }
}

/// What a verb of a verb takes that its parent does not.
fn own<'a>(verb: &'a Command, sub: &'a Command) -> impl Iterator<Item = &'a Arg> {
    let known = |arg: &&Arg| {
        verb.get_arguments()
            .any(|other| other.get_id() == arg.get_id())
    };
    sub.get_arguments().filter(move |arg| !known(arg))
}

/// `-w, --write FILE`, or what a positional argument is called.
fn spelt(arg: &Arg) -> String {
    let values = arg.get_value_names().unwrap_or_default().join(" ");
    let values = Some(values).filter(|_| arg.get_action().takes_values());
    let short = arg.get_short().map(|short| format!("-{short},"));
    let long = arg.get_long().map(|long| format!("--{long}"));
    let words: Vec<String> = [short, long, values].into_iter().flatten().collect();
    words.join(" ")
}

fn ending(page: &mut Page, command: &Command, verbs: &[Command]) {
    page.control("SH", &["EXIT STATUS"]);
    EXIT_STATUS
        .iter()
        .for_each(|(status, means)| page.item(bold(*status), means));
    page.control("SH", &["ENVIRONMENT"]);
    let mut seen = Vec::new();
    for arg in verbs.iter().flat_map(Command::get_arguments) {
        let Some(variable) = arg.get_env().filter(|variable| !seen.contains(variable)) else {
            continue;
        };
        seen.push(variable);
        let stands_for = match arg.get_long() {
            Some(long) => format!("--{long}"),
            None => arg.get_id().as_str().to_uppercase(),
        };
        page.item(
            bold(variable.to_string_lossy()),
            &format!("stands in for {stands_for}; set to nothing it counts as not set"),
        );
    }
    ENVIRONMENT
        .iter()
        .for_each(|(name, about)| page.item(bold(*name), about));
    page.control("SH", &["FILES"]);
    FILES
        .iter()
        .for_each(|(path, about)| page.item(italic(*path), about));
    let help = help_below(command);
    for section in sections(&help) {
        if let Some(title) = &section.title {
            page.control("SH", &[&title.to_uppercase()]);
        }
        page.lines(&section);
    }
    page.control("SH", &["SEE ALSO"]);
    page.text(vec![
        bold("gpioinfo"),
        roman("(1), "),
        bold("chrt"),
        roman("(1), "),
        bold("udev"),
        roman("(7), "),
        bold("sched"),
        roman("(7)"),
    ]);
    page.paragraph(
        "The project's docs folder: links, wiring, setup, output, protocol, performance.",
    );
}

// --- the files ---

#[test]
fn generated_files_are_up_to_date() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let files = [
        ("completions/biss.bash", completions(Shell::Bash)),
        ("completions/_biss", completions(Shell::Zsh)),
        ("completions/biss.fish", completions(Shell::Fish)),
        ("docs/biss.1", man_page()),
    ];
    let mut stale = Vec::new();
    for (name, text) in files {
        let path = root.join(name);
        if fs::read_to_string(&path).is_ok_and(|committed| committed == text) {
            continue;
        }
        if std::env::var_os("BISS_BLESS").is_some() {
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(&path, text).unwrap();
        } else {
            stale.push(name);
        }
    }
    assert!(
        stale.is_empty(),
        "{stale:?} do not fit src/cli.rs: BISS_BLESS=1 cargo test --bin biss generated"
    );
}

/// Whoever reads the man page misses nothing that `--help` tells.
#[test]
fn the_man_page_has_everything_that_help_has() {
    // As `man` would show it, one space between words.
    let shown = |roff: &str| {
        let lines = roff
            .lines()
            .filter(|line| !line.starts_with(".TP") && !line.starts_with(".PP"));
        let text = lines.collect::<Vec<_>>().join(" ");
        let text = [
            ("\\fB", ""),
            ("\\fI", ""),
            ("\\fR", ""),
            ("\\-", "-"),
            ("\\*(Aq", "'"),
        ]
        .iter()
        .fold(text, |text, (old, new)| text.replace(old, new));
        text.split_whitespace().collect::<Vec<_>>().join(" ")
    };
    let page = shown(&man_page());
    for verb in verbs() {
        for arg in verb.get_arguments().filter(|arg| arg.get_id() != "help") {
            let about = arg.get_help().map(ToString::to_string).unwrap_or_default();
            assert!(page.contains(&shown(&about)), "{about}");
            if let Some(long) = arg.get_long() {
                assert!(page.contains(&format!("--{long}")), "{long}");
            }
        }
        for sub in verb.get_subcommands() {
            let about = sub.get_about().map(ToString::to_string);
            assert!(page.contains(&shown(&about.unwrap_or_default())), "{sub}");
            for arg in own(&verb, sub) {
                let about = arg.get_help().map(ToString::to_string);
                assert!(page.contains(&shown(&about.unwrap_or_default())), "{arg}");
                assert!(page.contains(&shown(&spelt(arg))), "{arg}");
            }
        }
        let warning = verb.get_before_help().map(ToString::to_string);
        assert!(
            page.contains(&shown(&warning.unwrap_or_default())),
            "{verb}"
        );
        let help = help_below(&verb);
        for part in help.lines().flat_map(|line| line.trim().split("  ")) {
            assert!(page.contains(&shown(part.trim_end_matches(':'))), "{part}");
        }
    }
}
