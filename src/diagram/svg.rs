//! A diagram as SVG: no scripts, nothing from elsewhere, for light and dark pages.

use super::labels::{Measure, Place, Wish};
use super::{Cell, Diagram, Lane, Span, Step, Tone, micro};
use std::fmt::Write;

/// A diagram and what stands above it.
pub struct Panel<'a> {
    /// Lines of words; the first one is its title.
    pub heading: Vec<(String, Tone)>,
    /// What is drawn.
    pub diagram: &'a Diagram,
}

/// A clock is so wide.
const CLOCK: f64 = 28.0;
/// A row has no more clocks than this.
const ROW_CLOCKS: f64 = 50.0;
/// Words, and how wide a character of them is at most: `DejaVu Sans Mono` has 0.602 of its size.
const SIZE: f64 = 11.0;
const CHAR: f64 = 6.65;
const SMALL: f64 = 9.0;
const SMALL_CHAR: f64 = 5.45;
/// The names of the wires, left of all.
const LEFT: f64 = 52.0;
const EDGE: f64 = 12.0;
/// From 0 to 1.
const SWING: f64 = 24.0;
const LINE: f64 = 17.0;
/// The drawing is this wide at least, so that its heading has room.
const LEAST: f64 = 480.0;

/// Colours that can be read on white and on black, and better ones for those who know which it is.
const STYLE: &str = "\
text{font-family:'DejaVu Sans Mono',Menlo,Consolas,'Liberation Mono',monospace;font-size:11px;fill:#757575}
.h{font-size:13px;font-weight:bold}.s{font-size:9px}.m{text-anchor:middle}.e{text-anchor:end}
path{fill:none;stroke:#757575}.w{stroke-width:1.8;stroke-linejoin:round}.d{stroke-width:1}
.g{stroke-width:.7;stroke-dasharray:2 2}.a{stroke:none;fill:#757575}.b{stroke:none;fill:#808080;fill-opacity:.13}
.dot{fill:#757575}.f,.f text{opacity:.85}
text.good{fill:#178217}text.warn{fill:#a86800}text.bad{fill:#d93838}
.good.dot{fill:#178217}.a.warn{fill:#a86800}.a.bad{fill:#d93838}
path.good{stroke:#178217}path.warn{stroke:#a86800}path.bad{stroke:#d93838}
.b.good{fill:#2da44e}.b.warn{fill:#e09000}.b.bad{fill:#e5534b}path.a{stroke:none}
@media (prefers-color-scheme:light){text,.dot,.a{fill:#24292f}path{stroke:#24292f}path.g{stroke:#57606a}
text.good,.good.dot{fill:#0f6b1d}text.warn,.a.warn{fill:#8a5200}text.bad,.a.bad{fill:#c01c28}
path.good{stroke:#0f6b1d}path.warn{stroke:#8a5200}path.bad{stroke:#c01c28}path.a{stroke:none}}
@media (prefers-color-scheme:dark){text,.dot,.a{fill:#e6edf3}path{stroke:#e6edf3}path.g{stroke:#9198a1}
text.good,.good.dot{fill:#56d364}text.warn,.a.warn{fill:#e3b341}text.bad,.a.bad{fill:#ff7b72}
path.good{stroke:#56d364}path.warn{stroke:#e3b341}path.bad{stroke:#ff7b72}path.a{stroke:none}}
";

/// All diagrams, one below the other.
pub fn draw(panels: &[Panel]) -> String {
    let mut page = Page {
        y: EDGE,
        ..Page::default()
    };
    for panel in panels {
        page.panel(panel);
    }
    page.finish(panels)
}

/// A length, to a tenth.
fn n(value: f64) -> String {
    let text = format!("{value:.1}");
    text.strip_suffix(".0").map_or(text.clone(), str::to_owned)
}

fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            // No other control character may stand in XML.
            c if c.is_control() => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

fn class(tone: Tone) -> &'static str {
    match tone {
        Tone::Plain => "",
        Tone::Faint => " f",
        Tone::Good => " good",
        Tone::Warning => " warn",
        Tone::Bad => " bad",
    }
}

/// The part of a diagram in one row.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Row {
    from_ns: u64,
    until_ns: u64,
    /// Clocks.
    from: f64,
    until: f64,
}

/// As much of a stretch as a row shows, and whether its ends are there.
#[derive(Clone, Copy, Debug)]
struct Piece {
    x0: f64,
    x1: f64,
    begins: bool,
    ends: bool,
}

impl Row {
    fn x(&self, place: f64) -> f64 {
        LEFT + (place.clamp(self.from, self.until) - self.from) * CLOCK
    }

    fn right(&self) -> f64 {
        self.x(self.until)
    }

    fn piece(&self, from: f64, until: f64) -> Option<Piece> {
        let point = from == until && from >= self.from && from < self.until;
        let shown = from < self.until && until > self.from;
        (shown || point).then(|| Piece {
            x0: self.x(from),
            x1: self.x(until),
            begins: from >= self.from,
            ends: until <= self.until,
        })
    }
}

fn rows(diagram: &Diagram) -> Vec<Row> {
    let (begin, end) = (diagram.begin_ns(), diagram.end_ns);
    let at = |t_ns| diagram.axis.at(t_ns);
    let hidden = |t_ns: u64| diagram.hides(t_ns);
    let mut rows = Vec::new();
    let mut from_ns = begin;
    loop {
        let left = at(end) - at(from_ns);
        let count = (left / ROW_CLOCKS).ceil();
        let want = at(from_ns) + left / count.max(1.0) + 0.5;
        let most = at(from_ns) + ROW_CLOCKS;
        let mut edges = diagram.edges.iter().copied();
        let cut =
            edges.rfind(|edge| *edge > from_ns && !hidden(*edge) && at(*edge) <= want.min(most));
        let until_ns = match cut {
            Some(cut) if count > 1.0 => cut,
            _ => end,
        };
        rows.push(Row {
            from_ns,
            until_ns,
            from: at(from_ns),
            until: at(until_ns).max(at(from_ns) + 0.5),
        });
        if until_ns >= end {
            return rows;
        }
        from_ns = until_ns;
    }
}

/// Where a level is drawn.
fn height(top: f64, level: Option<bool>) -> f64 {
    match level {
        Some(true) => top,
        Some(false) => top + SWING,
        None => top + SWING / 2.0,
    }
}

#[derive(Default)]
struct Page {
    out: String,
    y: f64,
    right: f64,
}

impl Page {
    fn finish(self, panels: &[Panel]) -> String {
        let (width, height) = (n(self.right.max(LEAST) + EDGE), n(self.y + EDGE));
        let title = match panels {
            [one] => one.heading.first().map_or("", |(line, _)| line).to_owned(),
            more => format!("{} cycles", more.len()),
        };
        let lines = panels.iter().flat_map(|panel| &panel.heading);
        let words: Vec<&str> = lines.map(|(line, _)| line.as_str()).collect();
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" role=\"img\" aria-labelledby=\"biss-title biss-desc\" \
             width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\">\n\
             <title id=\"biss-title\">BiSS-C: {}</title>\n<desc id=\"biss-desc\">{}</desc>\n\
             <style>\n{STYLE}</style>\n{}</svg>\n",
            escaped(&title),
            escaped(&words.join("; ")),
            self.out
        )
    }

    fn put(&mut self, element: std::fmt::Arguments) {
        // Writing into a string does not fail.
        let _ = self.out.write_fmt(element);
        self.out.push('\n');
    }

    fn words(&mut self, x: f64, y: f64, class: &str, text: &str) {
        self.put(format_args!(
            "<text class=\"{}\" x=\"{}\" y=\"{}\">{}</text>",
            class.trim(),
            n(x),
            n(y),
            escaped(text)
        ));
    }

    fn line(&mut self, class: &str, from: (f64, f64), to: (f64, f64)) {
        self.put(format_args!(
            "<path class=\"{}\" d=\"M{} {}L{} {}\"/>",
            class.trim(),
            n(from.0),
            n(from.1),
            n(to.0),
            n(to.1)
        ));
    }

    /// The head of an arrow that points right, or left.
    fn arrow(&mut self, tone: Tone, x: f64, y: f64, right: bool) {
        let back = if right { x - 5.0 } else { x + 5.0 };
        self.put(format_args!(
            "<path class=\"a{}\" d=\"M{} {}L{} {}V{}Z\"/>",
            class(tone),
            n(x),
            n(y),
            n(back),
            n(y - 2.5),
            n(y + 2.5)
        ));
    }

    fn panel(&mut self, panel: &Panel) {
        if self.y > EDGE {
            self.y += 2.0 * LINE;
        }
        let lines = panel.heading.iter().filter(|(line, _)| !line.is_empty());
        for (index, (line, tone)) in lines.enumerate() {
            self.y += if index == 0 { LINE } else { LINE - 1.0 };
            let size = if index == 0 { "h" } else { "" };
            // What `read` prints is in columns.
            self.words(
                EDGE,
                self.y,
                &format!("{size}{}", class(*tone)),
                &line.replace("  ", "\u{a0} "),
            );
            self.right = self
                .right
                .max(EDGE + line.chars().count() as f64 * (CHAR + 1.4));
        }
        self.y += LINE;
        let rows = rows(panel.diagram);
        for (index, row) in rows.iter().enumerate() {
            if index > 0 {
                self.y += LINE;
            }
            let mut pen = Pen {
                page: self,
                diagram: panel.diagram,
                row,
                rows: &rows,
            };
            pen.draw();
        }
    }
}

struct Pen<'a> {
    page: &'a mut Page,
    diagram: &'a Diagram,
    row: &'a Row,
    rows: &'a [Row],
}

impl Pen<'_> {
    fn at(&self, t_ns: u64) -> f64 {
        self.diagram.axis.at(t_ns)
    }

    fn x(&self, t_ns: u64) -> f64 {
        self.row.x(self.at(t_ns))
    }

    fn shows(&self, t_ns: u64) -> bool {
        let place = self.at(t_ns);
        place >= self.row.from && place < self.row.until && !self.diagram.hides(t_ns)
    }

    fn draw(&mut self) {
        self.page.right = self.page.right.max(self.row.right());
        let above = self.beside(Lane::Above);
        let numbers_y = self.page.y;
        self.numbers();
        let ma_y = self.page.y + 6.0;
        self.page.y = ma_y + SWING;
        self.name("MA", ma_y + SWING / 2.0 + 4.0);
        let steps: Vec<Step<Option<bool>>> = self.ma();
        self.wire(&steps, ma_y, self.diagram.stalled);
        self.page.y += 6.0;
        let between = self.beside(Lane::Between);
        self.page.y += 6.0;
        let slo_y = self.page.y;
        self.page.y += SWING;
        self.name("SLO", slo_y + SWING / 2.0 + 4.0);
        self.wire(&self.diagram.slo, slo_y, None);
        self.guides(&above, numbers_y + 1.0);
        let below: Vec<_> = above
            .iter()
            .map(|(piece, _, tone)| (*piece, ma_y - 8.0, *tone))
            .collect();
        self.guides(&below, ma_y + SWING / 2.0);
        self.guides(&between, ma_y + SWING / 2.0);
        self.guides(&between, slo_y + SWING / 2.0);
        self.samples(slo_y);
        self.page.y += 4.0;
        self.below(Lane::Field);
        self.below(Lane::Channel);
        self.beside(Lane::Fault);
        // What hangs below may have had no room.
        self.page.y += 2.0;
    }

    fn name(&mut self, name: &str, y: f64) {
        self.page.words(LEFT - 14.0, y, "e", name);
    }

    /// MA without the clocks that are left out.
    fn ma(&self) -> Vec<Step<Option<bool>>> {
        let steps = self.diagram.ma.iter();
        let shown = steps.filter(|step| !self.diagram.hides(step.t_ns));
        let level = |step: &Step<bool>| Step {
            t_ns: step.t_ns,
            level: Some(step.level),
        };
        shown.map(level).collect()
    }

    fn numbers(&mut self) {
        self.page.y += SMALL + 2.0;
        let y = self.page.y;
        self.page.words(LEFT - 14.0, y, "s e f", "edge");
        let mut free = f64::MIN;
        for (index, t_ns) in self.diagram.edges.iter().enumerate() {
            let text = (index + 1).to_string();
            let half = text.len() as f64 * SMALL_CHAR / 2.0;
            let x = self.x(*t_ns);
            if self.shows(*t_ns) && x - half > free {
                self.page.words(x, y, "s m f", &text);
                free = x + half + 2.0;
            }
        }
    }

    /// Both levels of a wire, with gaps where it is drawn shorter than it was, and in another colour where it is marked.
    fn wire(&mut self, steps: &[Step<Option<bool>>], top: f64, marked: Option<(u64, u64)>) {
        let whole = Piece {
            x0: LEFT,
            x1: self.row.right(),
            begins: true,
            ends: true,
        };
        let path = self.path(steps, top, &whole);
        self.page
            .put(format_args!("<path class=\"w\" d=\"{path}\"/>"));
        let marked = marked.and_then(|(from, until)| self.row.piece(self.at(from), self.at(until)));
        if let Some(piece) = marked {
            let path = self.path(steps, top, &piece);
            self.page
                .put(format_args!("<path class=\"w bad\" d=\"{path}\"/>"));
        }
        for (start, end) in self.gaps() {
            let before = steps.partition_point(|step| self.x(step.t_ns) <= start);
            let level = before.checked_sub(1).and_then(|at| steps[at].level);
            let middle = height(top, level);
            for x in [start, end] {
                self.page
                    .line("d", (x - 2.5, middle + 6.0), (x + 2.5, middle - 6.0));
            }
        }
    }

    fn path(&self, steps: &[Step<Option<bool>>], top: f64, piece: &Piece) -> String {
        let gaps = self.gaps();
        let x = |step: &Step<Option<bool>>| self.x(step.t_ns);
        let last_row = self.rows.last() == Some(self.row);
        let shown = |step: &&Step<Option<bool>>| {
            self.at(step.t_ns) > self.row.from
                && (step.t_ns < self.row.until_ns || last_row)
                && x(step) > piece.x0
                && x(step) < piece.x1 + 0.01
        };
        // A change with which the piece begins has been made.
        let before = |step: &&Step<Option<bool>>| {
            step.t_ns <= self.row.from_ns
                || self.at(step.t_ns) > self.row.from && x(step) <= piece.x0
        };
        let mut level = steps
            .iter()
            .take_while(before)
            .last()
            .and_then(|step| step.level);
        let mut at = piece.x0;
        let mut path = format!("M{} {}", n(at), n(height(top, level)));
        let end = Step {
            t_ns: 0,
            level: None,
        };
        let steps = steps.iter().filter(shown).map(|step| (x(step), step));
        for (x, step) in steps.chain([(piece.x1, &end)]) {
            for (start, end) in gaps.iter().filter(|(start, end)| *start >= at && *end <= x) {
                let y = n(height(top, level));
                let _ = write!(path, "H{}M{} {y}", n(*start), n(*end));
            }
            let _ = write!(path, "H{}", n(x));
            if step != &end {
                level = step.level;
                let _ = write!(path, "V{}", n(height(top, level)));
            }
            at = x;
        }
        path
    }

    /// Where wires are interrupted.
    fn gaps(&self) -> Vec<(f64, f64)> {
        let cuts = self.diagram.axis.cuts().iter();
        let middles = cuts.map(|cut| (self.at(cut.from_ns) + self.at(cut.until_ns)) / 2.0);
        let shown = middles.filter(|place| *place > self.row.from && *place < self.row.until);
        shown
            .map(|place| (self.row.x(place) - 3.0, self.row.x(place) + 3.0))
            .collect()
    }

    /// Where SLO was sampled, what was read, and where that comes from if this is not plain to see.
    fn samples(&mut self, top: f64) {
        let far = self.diagram.is_far();
        let y = self.page.y + SMALL + 5.0;
        self.page.words(LEFT - 14.0, y, "s e f", "bit");
        self.page.y = y + 3.0;
        if far {
            self.page.y += SMALL + 3.0;
            self.page
                .words(LEFT - 14.0, self.page.y - 2.0, "s e f", "set by");
        }
        let cells: Vec<Cell> = self.diagram.cells.clone();
        let mut free = f64::MIN;
        for cell in cells {
            let (from, until) = (self.at(cell.from_ns), self.at(cell.until_ns));
            let middle = (from + until) / 2.0;
            if self.diagram.hides_bit(&cell) || middle < self.row.from || middle >= self.row.until {
                continue;
            }
            let x = self.row.x(middle);
            let level_y = if cell.level { top } else { top + SWING };
            if let Some(sample_ns) = cell.sample_ns {
                // One that is taken with an edge shows on which side of it.
                let aside = (0.1_f64).min((until - from) / 3.0);
                let place = self.at(sample_ns).clamp(from + aside, until - aside);
                let dot = self.row.x(place);
                if (dot - x).abs() < SMALL_CHAR {
                    self.page.line("g", (dot, level_y), (dot, y - SMALL));
                }
                self.page.put(format_args!(
                    "<circle class=\"dot good\" cx=\"{}\" cy=\"{}\" r=\"2.3\"/>",
                    n(dot),
                    n(level_y)
                ));
            }
            self.page
                .words(x, y, "s m", if cell.level { "1" } else { "0" });
            let Some(edge) = cell.edge.filter(|_| far) else {
                continue;
            };
            let text = edge.to_string();
            let half = text.len() as f64 * SMALL_CHAR / 2.0;
            if x - half > free {
                self.page.words(x, self.page.y - 2.0, "s m f", &text);
                free = x + half + 2.0;
            }
        }
    }

    fn pieces(&self, lane: Lane) -> Vec<(Span, Piece, bool)> {
        let spans = self.diagram.spans.iter().filter(|span| span.lane == lane);
        let found = spans.filter_map(|span| {
            let (from, until) = (self.at(span.from_ns), self.at(span.until_ns));
            let piece = self.row.piece(from, until)?;
            let length = |row: &Row| {
                let piece = row.piece(from, until);
                piece.map_or(-1.0, |piece| piece.x1 - piece.x0)
            };
            // Words stand once, where there is most room for them.
            let longest = self.rows.iter().map(length).fold(-1.0, f64::max);
            let best = self.rows.iter().find(|row| length(row) >= longest);
            Some((span.clone(), piece, best == Some(self.row)))
        });
        found.collect()
    }

    fn wishes(pieces: &[(Span, Piece, bool)]) -> Vec<Wish> {
        let wish = |(span, piece, shown): &(Span, Piece, bool)| Wish {
            x0: piece.x0,
            x1: piece.x1,
            labels: match shown {
                true => span.labels().map(|label| micro(&label)).collect(),
                false => vec![String::new()],
            },
        };
        pieces.iter().map(wish).collect()
    }

    fn measure(&self, pad: f64) -> Measure {
        Measure {
            char: CHAR,
            pad,
            left: LEFT - 8.0,
            right: self.row.right().max(LEAST),
            whole: false,
        }
    }

    /// A lane of boxes that follow one another, words in or below them.
    fn below(&mut self, lane: Lane) {
        let pieces = self.pieces(lane);
        if pieces.is_empty() {
            return;
        }
        let (places, levels) = self.measure(3.0).below(&Pen::wishes(&pieces));
        let top = self.page.y + 2.0;
        let bottom = top + LINE + 1.0;
        let base = |level: usize| bottom + 3.0 + (level as f64 + 1.0) * (SIZE + 3.0);
        for ((span, piece, _), place) in pieces.iter().zip(&places) {
            let tone = class(span.tone);
            let (x0, x1) = (piece.x0, piece.x1);
            let (width, height) = (n(x1 - x0), n(bottom - top));
            self.page.put(format_args!(
                "<rect class=\"b{tone}\" x=\"{}\" y=\"{}\" width=\"{width}\" height=\"{height}\"/>",
                n(x0),
                n(top)
            ));
            // Open where it comes from, or goes on in, another row.
            let mut path = format!(
                "M{} {}H{}M{} {}H{}",
                n(x0),
                n(top),
                n(x1),
                n(x0),
                n(bottom),
                n(x1)
            );
            for x in [(piece.begins, x0), (piece.ends, x1)]
                .iter()
                .filter(|(there, _)| *there)
            {
                let _ = write!(path, "M{} {}V{}", n(x.1), n(top), n(bottom));
            }
            self.page
                .put(format_args!("<path class=\"d{tone}\" d=\"{path}\"/>"));
            match place {
                Place::Inside { text, x } => {
                    self.page.words(*x, bottom - 5.0, tone, text);
                }
                Place::Below {
                    text,
                    leader,
                    level,
                    x,
                } => {
                    let y = base(*level) - 4.0;
                    let right = x > leader;
                    let end = if right { leader + CHAR } else { leader - CHAR };
                    self.page.put(format_args!(
                        "<path class=\"d{tone}\" d=\"M{} {}V{}H{}\"/>",
                        n(*leader),
                        n(bottom),
                        n(y),
                        n(end)
                    ));
                    self.page.words(*x, base(*level), tone, text);
                }
                _ => {}
            }
        }
        self.page.y = bottom + 2.0;
        if levels > 0 {
            self.page.y = base(levels - 1) + 4.0;
        }
        self.list(&pieces, &places);
    }

    /// What has found no other place.
    fn list(&mut self, pieces: &[(Span, Piece, bool)], places: &[Place]) {
        for ((span, ..), place) in pieces.iter().zip(places) {
            if let Place::Listed { text } = place {
                self.page.y += SIZE + 3.0;
                self.page.words(LEFT, self.page.y, class(span.tone), text);
                let end = LEFT + text.chars().count() as f64 * CHAR;
                self.page.right = self.page.right.max(end);
            }
        }
    }

    /// A lane of arrows from here to there, words in or beside them. Where they stand.
    fn beside(&mut self, lane: Lane) -> Vec<(Piece, f64, Tone)> {
        let pieces = self.pieces(lane);
        if pieces.is_empty() {
            return Vec::new();
        }
        let (places, lines) = self.measure(12.0).beside(&Pen::wishes(&pieces));
        let top = self.page.y;
        let mut stand = Vec::new();
        for ((span, piece, _), place) in pieces.iter().zip(&places) {
            let (line, text, x, under) = match place {
                Place::Beside { line, text, x } => (*line, Some(text), *x, 0.0),
                Place::Under { line, text, x } => (*line, Some(text), *x, LINE),
                _ => (0, None, 0.0, 0.0),
            };
            let y = top + (line as f64 + 0.5) * LINE;
            let tone = class(span.tone);
            let width = text.map_or(0.0, |text| text.chars().count() as f64 * CHAR);
            let inside = text.is_some() && under == 0.0 && x >= piece.x0 && x + width <= piece.x1;
            let gap = inside.then_some((x - 3.0, x + width + 3.0));
            self.dimension(piece, y, span.tone, gap);
            if let Some(text) = text {
                self.page.words(x, y + 4.0 + under, tone, text);
                self.page.right = self.page.right.max(x + width);
            }
            stand.push((*piece, y, span.tone));
        }
        self.page.y = top + lines.max(1) as f64 * LINE;
        self.list(&pieces, &places);
        stand
    }

    fn dimension(&mut self, piece: &Piece, y: f64, tone: Tone, gap: Option<(f64, f64)>) {
        let kind = format!("d{}", class(tone));
        let (x0, x1) = (piece.x0, piece.x1);
        if x1 - x0 < 14.0 {
            // Too short for arrows of its own: they point at it from outside, the right one where words begin.
            self.page.line(&kind, (x0, y), (x1, y));
        } else if let Some((a, b)) = gap {
            self.page.line(&kind, (x0, y), (a.max(x0), y));
            self.page.line(&kind, (b.min(x1), y), (x1, y));
        } else {
            self.page.line(&kind, (x0, y), (x1, y));
        }
        if x1 - x0 >= 14.0 {
            if piece.begins {
                self.page.arrow(tone, x0, y, false);
            }
            if piece.ends {
                self.page.arrow(tone, x1, y, true);
            }
        }
        for (there, x) in [(piece.begins, x0), (piece.ends, x1)] {
            if there {
                self.page.line(&kind, (x, y - 4.0), (x, y + 4.0));
            }
        }
    }

    /// Thin lines from where arrows end to what they measure.
    fn guides(&mut self, stand: &[(Piece, f64, Tone)], to: f64) {
        for (piece, y, _) in stand {
            let mut ends = vec![(piece.begins, piece.x0)];
            if piece.x1 > piece.x0 {
                ends.push((piece.ends, piece.x1));
            }
            for (there, x) in ends {
                if there {
                    let from = if to > *y { y + 4.0 } else { y - 4.0 };
                    self.page.line("g", (x, from), (x, to));
                }
            }
        }
    }
}
