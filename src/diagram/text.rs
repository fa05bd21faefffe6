//! A diagram in characters, as wide as a terminal: what does not fit in one row goes on in the next.

use super::labels::{Measure, Place, Wish};
use super::{Diagram, Lane, Span, Step, Tone, micro};

/// A character, and what it says beside itself.
pub type Glyph = (char, Tone);

/// How a diagram is written.
#[derive(Clone, Copy, Debug)]
pub struct Style {
    /// No line is longer.
    pub width: usize,
    /// Lines and corners instead of `-` and `+`.
    pub unicode: bool,
}

/// What stands on the left of each row, where the width allows it.
const GUTTER: usize = 7;
/// Below this width it does not.
const NARROW: usize = 40;
/// A clock takes so many columns, the best first.
const CLOCK_COLUMNS: [usize; 3] = [6, 4, 2];
/// More rows than these ask for narrower clocks.
const MANY_ROWS: usize = 8;

/// The lines of a diagram.
pub fn draw(diagram: &Diagram, style: Style) -> Vec<Vec<Glyph>> {
    let width = style.width.max(1);
    let gutter = if width < NARROW { 0 } else { GUTTER };
    let columns = Columns::of(diagram, width - gutter);
    let rows = columns.rows(width - gutter);
    let mut pen = Pen {
        diagram,
        columns: &columns,
        set: if style.unicode { &UNICODE } else { &ASCII },
        unicode: style.unicode,
        width,
        gutter,
        lines: Vec::new(),
        listed: Vec::new(),
    };
    for (index, row) in rows.iter().enumerate() {
        if index > 0 {
            pen.lines.push(Vec::new());
        }
        pen.row(row, &rows);
    }
    pen.list();
    pen.lines
}

/// The characters that lines are made of.
struct Set {
    flat: char,
    fall: [char; 2],
    rise: [char; 2],
    /// Down and up again in one column; up and down again.
    dip: [char; 2],
    spike: [char; 2],
    unknown: char,
    sample: char,
    cut: &'static str,
    bar: char,
    left: char,
    right: char,
    cross: char,
    down: char,
    hang: char,
    hang_left: char,
}

const UNICODE: Set = Set {
    flat: '─',
    fall: ['┐', '└'],
    rise: ['┌', '┘'],
    dip: ['┬', '╵'],
    spike: ['╷', '┴'],
    unknown: '░',
    sample: '●',
    cut: "⌇",
    bar: '│',
    left: '├',
    right: '┤',
    cross: '┼',
    down: '┬',
    hang: '╰',
    hang_left: '╯',
};

const ASCII: Set = Set {
    flat: '-',
    fall: ['+', '+'],
    rise: ['+', '+'],
    dip: ['+', '\''],
    spike: ['.', '+'],
    unknown: 'x',
    sample: 'o',
    cut: "//",
    bar: '|',
    left: '|',
    right: '|',
    cross: '|',
    down: '+',
    hang: '`',
    hang_left: '\'',
};

/// The columns of times. Edges of MA never share one.
struct Columns {
    knots: Vec<(u64, usize)>,
    /// Where rows may begin: with a rising edge.
    clocks: Vec<usize>,
    /// Columns a clock.
    clock: usize,
    end: usize,
}

impl Columns {
    fn of(diagram: &Diagram, room: usize) -> Columns {
        let all = CLOCK_COLUMNS.map(|clock| Columns::with(diagram, clock));
        let rows = |columns: &Columns| columns.end.div_ceil(room.max(1));
        // The widest that takes no more rows than the usual one.
        let [wide, usual, narrow] = all;
        if rows(&wide) <= rows(&usual) {
            wide
        } else if rows(&usual) <= MANY_ROWS {
            usual
        } else {
            narrow
        }
    }

    fn with(diagram: &Diagram, clock: usize) -> Columns {
        let axis = &diagram.axis;
        let scale = clock as f64;
        let begin = diagram.begin_ns();
        let mut knots = vec![(begin, 0)];
        let mut last = (axis.at(begin), 0usize);
        // A clock has whole columns, so that all look alike; what is between its edges finds its place there.
        let shown = |t_ns: &u64| *t_ns > begin && !diagram.hides(*t_ns);
        for edge in diagram.edges.iter().copied().filter(shown) {
            let place = axis.at(edge);
            if place <= last.0 {
                continue;
            }
            let step = ((place - last.0) * scale).round().max(2.0) as usize;
            last = (place, last.1 + step);
            knots.push((edge, last.1));
        }
        let rest = ((axis.at(diagram.end_ns) - last.0) * scale)
            .round()
            .max(1.0) as usize;
        let end = last.1 + rest;
        knots.push((diagram.end_ns.max(begin + 1), end));
        knots.dedup_by_key(|(t_ns, _)| *t_ns);
        let clocks = knots.iter().skip(1).map(|(_, column)| *column).collect();
        let mut columns = Columns {
            knots,
            clocks,
            clock,
            end,
        };
        columns.part_falls(diagram);
        columns
    }

    /// Gives falling edges columns of their own.
    fn part_falls(&mut self, diagram: &Diagram) {
        let falls = diagram.ma.iter().skip(1).map(|step| step.t_ns);
        let falls = falls.filter(|t_ns| !diagram.hides(*t_ns));
        let new: Vec<(u64, usize)> = falls
            .filter_map(|t_ns| {
                let behind = self.knots.partition_point(|(knot, _)| *knot <= t_ns);
                let (from, low) = *self.knots.get(behind.checked_sub(1)?)?;
                let (_, high) = *self.knots.get(behind)?;
                if from == t_ns || high < low + 2 {
                    return None;
                }
                Some((t_ns, self.at(&diagram.axis, t_ns).clamp(low + 1, high - 1)))
            })
            .collect();
        self.knots.extend(new);
        self.knots.sort_unstable();
        self.knots.dedup_by_key(|(t_ns, _)| *t_ns);
    }

    fn at(&self, axis: &super::Axis, t_ns: u64) -> usize {
        let behind = self.knots.partition_point(|(knot, _)| *knot <= t_ns);
        let low = behind.checked_sub(1).map(|at| self.knots[at]);
        match (low, self.knots.get(behind)) {
            (Some((from, low)), Some((until, high))) => {
                let (a, b) = (axis.at(from), axis.at(*until));
                let part = match b > a {
                    true => (axis.at(t_ns) - a) / (b - a),
                    false => 0.0,
                };
                low + (part * (high - low) as f64).round() as usize
            }
            (Some((_, low)), None) => low,
            (None, _) => 0,
        }
    }

    /// Rows of about equal length that begin with a clock.
    fn rows(&self, room: usize) -> Vec<Row> {
        let room = room.max(1);
        let mut rows = Vec::new();
        let mut from = 0;
        while from < self.end {
            let left = self.end - from;
            let count = left.div_ceil(room);
            let want = left.div_ceil(count).min(room);
            // The next clock is a little farther, where there is room.
            let next = |at: usize| {
                let mut clocks = self.clocks.iter().copied();
                clocks.rfind(|column| *column > from && *column <= at)
            };
            let until = match count {
                1 => self.end,
                _ => next((from + want + self.clock).min(from + room)).unwrap_or(from + want),
            };
            rows.push(Row { from, until });
            from = until;
        }
        rows
    }
}

/// The columns of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Row {
    from: usize,
    until: usize,
}

impl Row {
    /// As much of a stretch as it shows, and whether its ends are there.
    fn piece(&self, from: usize, until: usize) -> Option<Piece> {
        let last = until == from && (self.from..self.until).contains(&from);
        let shown = from < self.until && until > self.from;
        (shown || last).then(|| Piece {
            from: from.max(self.from) - self.from,
            until: until.min(self.until) - self.from,
            begins: from >= self.from,
            ends: until < self.until,
        })
    }
}

#[derive(Clone, Copy, Debug)]
struct Piece {
    from: usize,
    until: usize,
    begins: bool,
    ends: bool,
}

struct Pen<'a> {
    diagram: &'a Diagram,
    columns: &'a Columns,
    set: &'static Set,
    unicode: bool,
    width: usize,
    gutter: usize,
    lines: Vec<Vec<Glyph>>,
    /// Words that have found no place.
    listed: Vec<(String, Tone)>,
}

/// Some lines of a row.
struct Band {
    lines: Vec<Vec<Glyph>>,
    /// Where each line begins.
    left: usize,
}

impl Band {
    fn put(&mut self, line: usize, column: usize, glyph: char, tone: Tone) {
        let cell = self
            .lines
            .get_mut(line)
            .and_then(|line| line.get_mut(self.left + column));
        if let Some(cell) = cell {
            *cell = (glyph, tone);
        }
    }

    fn write(&mut self, line: usize, column: usize, text: &str, tone: Tone) {
        for (at, glyph) in text.chars().enumerate() {
            self.put(line, column + at, glyph, tone);
        }
    }
}

impl Pen<'_> {
    fn at(&self, t_ns: u64) -> usize {
        self.columns.at(&self.diagram.axis, t_ns)
    }

    /// Lines with a name in front of them.
    fn band(&self, lines: usize, name: &str) -> Band {
        let mut band = Band {
            lines: vec![vec![(' ', Tone::Plain); self.width]; lines],
            left: 0,
        };
        if self.gutter > 0 {
            band.write(0, 0, name, Tone::Plain);
        }
        band.left = self.gutter;
        band
    }

    fn keep(&mut self, band: Band) {
        self.lines.extend(band.lines.into_iter().map(trimmed));
    }

    fn words(&self, text: &str) -> String {
        if self.unicode {
            micro(text)
        } else {
            text.to_owned()
        }
    }

    fn row(&mut self, row: &Row, rows: &[Row]) {
        self.beside(Lane::Above, row, rows);
        self.numbers(row);
        self.wire("MA", row, |pen, wire| pen.ma(wire));
        self.beside(Lane::Between, row, rows);
        self.wire("SLO", row, |pen, wire| pen.slo(wire));
        self.bits(row);
        self.origins(row);
        self.below(Lane::Field, row, rows);
        self.below(Lane::Channel, row, rows);
        self.beside(Lane::Fault, row, rows);
    }

    /// Numbers over the rising edges of MA.
    fn numbers(&mut self, row: &Row) {
        let edges = self.diagram.edges.iter().enumerate();
        let at: Vec<(usize, usize)> = edges
            .filter(|(_, t_ns)| !self.diagram.hides(**t_ns))
            .map(|(index, t_ns)| (index + 1, self.at(*t_ns)))
            .collect();
        self.number("edge", row, &at, self.diagram.edges.len());
    }

    fn number(&mut self, name: &str, row: &Row, at: &[(usize, usize)], most: usize) {
        let digits = most.max(1).to_string().len();
        let every = [1, 2, 5, 10, 20, 50]
            .into_iter()
            .find(|every| every * self.columns.clock > digits)
            .unwrap_or(100);
        let mut band = self.band(1, name);
        let mut free = 0;
        let mut some = false;
        for (number, column) in at {
            let shown = *number <= 2 || number % every == 0;
            let text = number.to_string();
            let fits = *column >= row.from + free && column + text.len() <= row.until;
            if shown && fits {
                band.write(0, column - row.from, &text, Tone::Faint);
                free = column - row.from + text.len() + 1;
                some = true;
            }
        }
        if some {
            self.keep(band);
        }
    }

    /// The edges that set the bits, where those come so late that it is not plain to see.
    fn origins(&mut self, row: &Row) {
        if !self.diagram.is_far() {
            return;
        }
        let cells = self.diagram.cells.iter();
        let at: Vec<(usize, usize)> = cells
            .filter(|cell| !self.diagram.hides_bit(cell))
            .filter_map(|cell| {
                let (from, until) = (self.at(cell.from_ns), self.at(cell.until_ns));
                let digits = cell.edge?.to_string().len();
                let column = (from + until.max(from + 1))
                    .div_ceil(2)
                    .saturating_sub(digits / 2);
                Some((usize::from(cell.edge?), column.max(from + 1)))
            })
            .collect();
        self.number("set by", row, &at, self.diagram.edges.len());
    }

    fn wire(&mut self, name: &str, row: &Row, draw: impl Fn(&Pen, &mut Wire)) {
        let mut wire = Wire {
            band: self.band(2, name),
            row: *row,
        };
        draw(self, &mut wire);
        self.keep(wire.band);
    }

    fn ma(&self, wire: &mut Wire) {
        let steps: Vec<Step<Option<bool>>> = self
            .diagram
            .ma
            .iter()
            .filter(|step| !self.diagram.hides(step.t_ns))
            .map(|step| Step {
                t_ns: step.t_ns,
                level: Some(step.level),
            })
            .collect();
        let stalled = self.diagram.stalled;
        let tone = |t_ns: u64| match stalled {
            Some((from, until)) if (from..=until).contains(&t_ns) => Tone::Bad,
            _ => Tone::Plain,
        };
        self.levels(wire, &steps, tone);
        self.cuts(wire, &steps);
    }

    fn slo(&self, wire: &mut Wire) {
        self.levels(wire, &self.diagram.slo, |_| Tone::Plain);
        self.cuts(wire, &self.diagram.slo);
        for cell in self
            .diagram
            .cells
            .iter()
            .filter(|cell| !self.diagram.hides_bit(cell))
        {
            if cell.sample_ns.is_some() {
                let column = self.sample(cell);
                wire.put(
                    column,
                    usize::from(!cell.level),
                    self.set.sample,
                    Tone::Good,
                );
            }
        }
    }

    /// The column of a sample: never that of an edge, which may be just before or behind it.
    fn sample(&self, cell: &super::Cell) -> usize {
        let (from, until) = (self.at(cell.from_ns), self.at(cell.until_ns));
        let middle = (from + until) / 2;
        let column = cell.sample_ns.map_or(middle, |t_ns| self.at(t_ns));
        match until > from + 1 {
            true => column.clamp(from + 1, until - 1),
            false => from,
        }
    }

    fn levels(&self, wire: &mut Wire, steps: &[Step<Option<bool>>], tone: impl Fn(u64) -> Tone) {
        let set = self.set;
        let flat = |wire: &mut Wire, column: usize, level: Option<bool>, tone: Tone| match level {
            Some(high) => wire.put(column, usize::from(!high), set.flat, tone),
            None => {
                wire.put(column, 0, set.unknown, tone);
                wire.put(column, 1, set.unknown, tone);
            }
        };
        let mut steps = steps.iter().peekable();
        let mut level = None;
        let mut column = 0;
        while let Some(step) = steps.next() {
            let at = self.at(step.t_ns);
            // Several changes in one column: what counts is where they lead, and whether something was there.
            let (mut to, mut count, mut end) = (step.level, 1, step.t_ns);
            while let Some(more) = steps.next_if(|more| self.at(more.t_ns) == at) {
                (to, count, end) = (more.level, count + 1, more.t_ns);
            }
            if at == 0 && column == 0 {
                level = to;
            }
            for column in column..at {
                flat(wire, column, level, tone(step.t_ns));
            }
            column = at;
            if at == 0 {
                continue;
            }
            let corner = match (level, to) {
                (Some(true), Some(false)) => Some(set.fall),
                (Some(false), Some(true)) => Some(set.rise),
                (Some(true), Some(true)) if count > 1 => Some(set.dip),
                (Some(false), Some(false)) if count > 1 => Some(set.spike),
                _ => None,
            };
            if let Some([top, bottom]) = corner {
                let shade = match tone(end) {
                    Tone::Plain => tone(step.t_ns),
                    shade => shade,
                };
                wire.put(at, 0, top, shade);
                wire.put(at, 1, bottom, shade);
                column += 1;
            }
            level = to;
        }
        for column in column..self.columns.end {
            flat(wire, column, level, Tone::Plain);
        }
    }

    /// Marks what is drawn shorter than it was.
    fn cuts(&self, wire: &mut Wire, steps: &[Step<Option<bool>>]) {
        for cut in self.diagram.axis.cuts() {
            let (from, until) = (self.at(cut.from_ns), self.at(cut.until_ns));
            let width = self.set.cut.chars().count();
            let middle = ((from + until + 1).saturating_sub(width) / 2).max(from);
            let before = steps.partition_point(|step| step.t_ns <= cut.from_ns);
            let level = before.checked_sub(1).and_then(|at| steps[at].level);
            for (at, glyph) in self.set.cut.chars().enumerate() {
                wire.put(
                    middle + at,
                    usize::from(level == Some(false)),
                    glyph,
                    Tone::Faint,
                );
            }
        }
    }

    /// What was read, digit by digit.
    fn bits(&mut self, row: &Row) {
        let mut band = self.band(1, "bit");
        let mut some = false;
        for cell in self
            .diagram
            .cells
            .iter()
            .filter(|cell| !self.diagram.hides_bit(cell))
        {
            let column = self.sample(cell);
            if (row.from..row.until).contains(&column) {
                let digit = if cell.level { '1' } else { '0' };
                band.put(0, column - row.from, digit, Tone::Plain);
                some = true;
            }
        }
        if some {
            self.keep(band);
        }
    }

    /// The annotations of a lane in a row, and which of them show their words there.
    fn pieces(&self, lane: Lane, row: &Row, rows: &[Row]) -> Vec<(&Span, Piece, bool)> {
        let spans = self.diagram.spans.iter().filter(|span| span.lane == lane);
        let found = spans.filter_map(|span| {
            let (from, until) = (self.at(span.from_ns), self.at(span.until_ns));
            let piece = row.piece(from, until)?;
            let length = |row: &Row| {
                row.piece(from, until)
                    .map_or(0, |piece| piece.until - piece.from + 1)
            };
            // Words stand once, where there is most room for them.
            let longest = rows.iter().map(length).max();
            let best = rows.iter().find(|row| Some(length(row)) == longest);
            Some((span, piece, best == Some(row)))
        });
        found.collect()
    }

    fn wishes(&self, pieces: &[(&Span, Piece, bool)]) -> Vec<Wish> {
        let wish = |(span, piece, shown): &(&Span, Piece, bool)| Wish {
            x0: piece.from as f64,
            x1: piece.until as f64,
            labels: match shown {
                true => span.labels().map(|label| self.words(&label)).collect(),
                false => vec![String::new()],
            },
        };
        pieces.iter().map(wish).collect()
    }

    fn measure(&self) -> Measure {
        Measure {
            char: 1.0,
            pad: 0.5,
            left: 0.0,
            right: (self.width - self.gutter) as f64,
            whole: true,
        }
    }

    /// A lane of parts that follow one another, words in or below them.
    fn below(&mut self, lane: Lane, row: &Row, rows: &[Row]) {
        let pieces = self.pieces(lane, row, rows);
        if pieces.is_empty() {
            return;
        }
        let (places, levels) = self.measure().below(&self.wishes(&pieces));
        let name = if lane == Lane::Field { "field" } else { "" };
        let mut band = self.band(1 + levels, name);
        let mut listed = Vec::new();
        let set = self.set;
        for (span, piece, _) in &pieces {
            self.bar(&mut band, 0, piece, span.tone);
        }
        for (index, (_, piece, _)) in pieces.iter().enumerate() {
            let before = index > 0 && pieces[index - 1].1.until == piece.from;
            if piece.begins {
                let glyph = if before { set.cross } else { set.left };
                band.put(0, piece.from, glyph, Tone::Plain);
            }
            if piece.ends {
                band.put(0, piece.until, set.right, Tone::Plain);
            }
        }
        for ((span, ..), place) in pieces.iter().zip(places) {
            match place {
                Place::Inside { text, x } => words_on(&mut band, 0, x as usize, &text, span.tone),
                Place::Below {
                    text,
                    leader,
                    level,
                    x,
                } => {
                    let column = leader as usize;
                    band.put(0, column, set.down, span.tone);
                    for line in 1..=level {
                        band.put(line, column, set.bar, span.tone);
                    }
                    let right = x > leader;
                    let hang = if right { set.hang } else { set.hang_left };
                    band.put(1 + level, column, hang, span.tone);
                    band.write(1 + level, x as usize, &text, span.tone);
                }
                Place::Listed { text } => listed.push((text, span.tone)),
                Place::Beside { .. } | Place::Under { .. } | Place::Nothing => {}
            }
        }
        self.listed.extend(listed);
        self.keep(band);
    }

    fn bar(&self, band: &mut Band, line: usize, piece: &Piece, tone: Tone) {
        for column in piece.from..piece.until {
            band.put(line, column, self.set.flat, tone);
        }
    }

    /// A lane of stretches that stand alone, words in or beside them.
    fn beside(&mut self, lane: Lane, row: &Row, rows: &[Row]) {
        let pieces = self.pieces(lane, row, rows);
        if pieces.is_empty() {
            return;
        }
        let (places, lines) = self.measure().beside(&self.wishes(&pieces));
        let mut band = self.band(lines.max(1), if lane == Lane::Fault { "fault" } else { "" });
        let mut listed = Vec::new();
        for ((span, piece, _), place) in pieces.iter().zip(places) {
            let line = match &place {
                Place::Beside { line, .. } | Place::Under { line, .. } => *line,
                _ => 0,
            };
            if lane == Lane::Fault {
                for column in piece.from..piece.until.max(piece.from + 1) {
                    band.put(line, column, '^', span.tone);
                }
            } else {
                self.dimension(&mut band, line, piece, span.tone);
            }
            match place {
                Place::Beside { text, line, x } => {
                    words_on(&mut band, line, x as usize, &text, span.tone);
                }
                Place::Under { text, line, x } => {
                    band.write(line + 1, x as usize, &text, span.tone);
                }
                Place::Listed { text } => listed.push((text, span.tone)),
                _ => {}
            }
        }
        self.listed.extend(listed);
        self.keep(band);
    }

    fn dimension(&self, band: &mut Band, line: usize, piece: &Piece, tone: Tone) {
        self.bar(band, line, piece, tone);
        if piece.from == piece.until && piece.begins {
            return band.put(line, piece.from, self.set.bar, tone);
        }
        if piece.begins {
            band.put(line, piece.from, self.set.left, tone);
        }
        if piece.ends {
            band.put(line, piece.until, self.set.right, tone);
        }
    }

    /// What has found no place in the drawing, below it.
    fn list(&mut self) {
        for (text, tone) in std::mem::take(&mut self.listed) {
            let mut line: Vec<Glyph> = Vec::new();
            for word in text.split(' ') {
                let room = line.len() + 1 + word.chars().count() <= self.width;
                if !line.is_empty() && !room {
                    self.lines.push(std::mem::take(&mut line));
                }
                if !line.is_empty() {
                    line.push((' ', tone));
                }
                for glyph in word.chars() {
                    if line.len() == self.width {
                        self.lines.push(std::mem::take(&mut line));
                    }
                    line.push((glyph, tone));
                }
            }
            self.lines.push(line);
        }
    }
}

/// A space on each side keeps words from a line, where there is one.
fn words_on(band: &mut Band, line: usize, column: usize, text: &str, tone: Tone) {
    let flat = |band: &Band, column: usize| {
        let cell = band
            .lines
            .get(line)
            .and_then(|line| line.get(band.left + column));
        cell.is_some_and(|(glyph, _)| ['─', '-', '^'].contains(glyph))
    };
    let end = column + text.chars().count();
    if column > 0 && flat(band, column - 1) {
        band.put(line, column - 1, ' ', tone);
    }
    if flat(band, end) {
        band.put(line, end, ' ', tone);
    }
    band.write(line, column, text, tone);
}

/// Two lines, and the part of the wire that they show.
struct Wire {
    band: Band,
    row: Row,
}

impl Wire {
    fn put(&mut self, column: usize, line: usize, glyph: char, tone: Tone) {
        if (self.row.from..self.row.until).contains(&column) {
            self.band.put(line, column - self.row.from, glyph, tone);
        }
    }
}

fn trimmed(mut line: Vec<Glyph>) -> Vec<Glyph> {
    while line.last().is_some_and(|(glyph, _)| *glyph == ' ') {
        line.pop();
    }
    line
}
