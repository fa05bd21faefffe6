//! Diagrams of cycles, as text with colours or as SVG.

use super::{Record, Shot, Time, colored, terminal_width, utf8_locale};
use crate::cli::ColorWhen;
use anstyle::{AnsiColor, Style};
use biss::cycle::Cycle;
use biss::diagram::text::{self, Glyph};
use biss::diagram::{Diagram, Tone, svg};
use biss::format::{Channel, Format};
use biss::measure::Scale;
use biss::trace::{Cut, Trace};

/// A cycle, and how it is drawn.
pub(crate) struct Picture {
    pub(crate) trace: Trace,
    pub(crate) cycle: Cycle,
    pub(crate) seq: u64,
    /// It is a piece of a cycle only.
    pub(crate) cut: Option<Cut>,
    /// Since the first cycle.
    pub(crate) since_ns: u64,
    /// None where nothing was seen of it.
    pub(crate) diagram: Option<Diagram>,
}

/// All that is to be drawn.
pub(crate) struct Sheet<'a> {
    pub(crate) pictures: &'a [Picture],
    pub(crate) format: Option<&'a Format>,
    /// How positions are measured.
    pub(crate) scales: &'a [Option<Scale>],
}

/// How it was asked for.
#[derive(Clone, Copy)]
pub(crate) struct Wish {
    /// Columns; none takes the terminal's.
    pub(crate) width: Option<u16>,
    pub(crate) ascii: bool,
    pub(crate) color: ColorWhen,
}

/// As characters.
pub(crate) fn text(sheet: &Sheet, wish: Wish) -> String {
    let style = text::Style {
        width: wish.width.map_or_else(terminal_width, usize::from),
        unicode: !wish.ascii && utf8_locale(),
    };
    let color = colored(wish.color);
    let mut out = String::new();
    for (index, picture) in sheet.pictures.iter().enumerate() {
        if index > 0 {
            out.push('\n');
        }
        for (line, tone) in sheet.heading(picture, style.unicode) {
            for line in wrapped(&line, style.width) {
                paint(
                    &mut out,
                    &line.chars().map(|c| (c, tone)).collect::<Vec<_>>(),
                    color,
                );
            }
        }
        let lines = picture
            .diagram
            .iter()
            .flat_map(|diagram| text::draw(diagram, style));
        for line in lines {
            paint(&mut out, &line, color);
        }
    }
    out
}

/// As a picture.
pub(crate) fn svg(sheet: &Sheet) -> String {
    let drawn = sheet.pictures.iter().filter_map(|picture| {
        let lines = sheet.heading(picture, true);
        Some(svg::Panel {
            heading: lines,
            diagram: picture.diagram.as_ref()?,
        })
    });
    svg::draw(&drawn.collect::<Vec<_>>())
}

impl Sheet<'_> {
    /// What `read` says of a cycle, and what holds for all of the drawing.
    fn heading(&self, picture: &Picture, unicode: bool) -> Vec<(String, Tone)> {
        let mut lines = Vec::new();
        let format = self.format.map(|format| format!(", {format}"));
        let format = format.unwrap_or_default();
        match picture.cut {
            None => {
                lines.push((format!("cycle {}{format}", picture.seq), Tone::Plain));
                lines.extend(self.records(picture, unicode));
            }
            Some(cut) => {
                let place = if cut == Cut::Begin { "begins" } else { "ends" };
                let piece = "a piece of a cycle";
                lines.push((format!("{piece}{format}"), Tone::Plain));
                let said = format!("the recording {place} inside a cycle, as far as can be told");
                lines.push((said, Tone::Warning));
            }
        }
        if let Some(diagram) = &picture.diagram {
            let facts = diagram.facts.join(", ");
            lines.push((facts, Tone::Plain));
            lines.retain(|(line, _)| !line.is_empty());
        } else {
            lines.push(("nothing was seen of MA and SLO".into(), Tone::Plain));
        }
        if unicode {
            for (line, _) in &mut lines {
                *line = biss::diagram::micro(line);
            }
        }
        lines
    }

    fn records(&self, picture: &Picture, unicode: bool) -> Vec<(String, Tone)> {
        let none = Format::default();
        let shot = Shot {
            format: self.format.unwrap_or(&none),
            cycle: &picture.cycle,
            trace: &picture.trace,
            t_ns: picture.since_ns,
            seq: picture.seq,
            tries: None,
            counted: None,
            scales: self.scales,
            slaves: &[],
        };
        let records = Record::all(&shot, Time::Zero(picture.since_ns), false);
        let line = |record: Record| {
            let mut text = Vec::new();
            let degree = if unicode { "°" } else { "deg" };
            // Nothing fails that is written into memory.
            let _ = record.text(&mut text, false, degree);
            let good = record.good();
            let says = |flag: fn(&Channel, u64) -> Option<bool>| {
                let good = good.as_ref();
                good.and_then(|good| flag(good.channel, good.data)) == Some(true)
            };
            let tone = match record.fault() {
                Some(_) => Tone::Bad,
                None if says(Channel::error) => Tone::Bad,
                None if says(Channel::warning) => Tone::Warning,
                None => Tone::Plain,
            };
            (String::from_utf8_lossy(&text).trim_start().to_owned(), tone)
        };
        records.map(line).collect()
    }
}

fn wrapped(line: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in line.split(' ') {
        let last = lines.last().map_or(0, |line| line.chars().count());
        if last > 0 && last + 1 + word.chars().count() > width {
            lines.push(String::new());
        } else if last > 0 {
            lines.last_mut().into_iter().for_each(|line| line.push(' '));
        }
        for c in word.chars() {
            if lines
                .last()
                .is_none_or(|line| line.chars().count() >= width)
            {
                lines.push(String::new());
            }
            lines.last_mut().into_iter().for_each(|line| line.push(c));
        }
    }
    lines
}

/// A line of glyphs, each run of one tone in its colour.
fn paint(out: &mut String, line: &[Glyph], color: bool) {
    for run in line.chunk_by(|a, b| a.1 == b.1) {
        let text: String = run.iter().map(|(glyph, _)| glyph).collect();
        let style = match run[0].1 {
            Tone::Plain => None,
            Tone::Faint => Some(Style::new().dimmed()),
            Tone::Good => Some(AnsiColor::Green.on_default()),
            Tone::Warning => Some(AnsiColor::Yellow.on_default()),
            Tone::Bad => Some(AnsiColor::Red.on_default()),
        };
        match style.filter(|_| color && !text.trim().is_empty()) {
            Some(style) => out.push_str(&format!("{style}{text}{style:#}")),
            None => out.push_str(&text),
        }
    }
    out.push('\n');
}
