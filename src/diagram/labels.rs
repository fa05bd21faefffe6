//! Where words go so that none covers another: inside what they name, below it on a line that leads there, beside it, or
//! in a list of their own where nothing else fits.
//!
//! All in one unit of length: columns of a terminal, or the user units of an SVG.

/// What wants a label.
pub(super) struct Wish {
    /// From here ...
    pub(super) x0: f64,
    /// ... to here.
    pub(super) x1: f64,
    /// What to write, the longest first; an empty one says that nothing need be written.
    pub(super) labels: Vec<String>,
}

impl Wish {
    fn listed(&self) -> Place {
        match self.labels.first() {
            Some(text) if !text.is_empty() => Place::Listed { text: text.clone() },
            _ => Place::Nothing,
        }
    }
}

/// How wide things are.
#[derive(Clone, Copy)]
pub(super) struct Measure {
    /// A character.
    pub(super) char: f64,
    /// What is left free on each side of words inside something.
    pub(super) pad: f64,
    /// Nothing is left of this ...
    pub(super) left: f64,
    /// ... nor right of that.
    pub(super) right: f64,
    /// Places are whole numbers.
    pub(super) whole: bool,
}

/// Where a label goes.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Place {
    /// It begins at `x`, in what it names.
    Inside { text: String, x: f64 },
    /// A line leads down from `leader` to `level`, from 0, where the words begin at `x`, on its right or left.
    Below {
        text: String,
        leader: f64,
        level: usize,
        x: f64,
    },
    /// On its own line, from 0: it begins at `x`, beside what it names or in it.
    Beside { text: String, line: usize, x: f64 },
    /// Likewise, but it has the line below to itself.
    Under { text: String, line: usize, x: f64 },
    /// There is no room.
    Listed { text: String },
    /// It has none.
    Nothing,
}

/// Room for what is drawn: more levels than this are no help to the eye.
const MOST_LEVELS: usize = 12;

impl Measure {
    fn width(&self, text: &str) -> f64 {
        text.chars().count() as f64 * self.char
    }

    fn snap(&self, x: f64) -> f64 {
        if self.whole { x.floor() } else { x }
    }

    /// In the middle of what it names.
    fn inside(&self, wish: &Wish) -> Option<Place> {
        let room = wish.x1 - wish.x0 - 2.0 * self.pad;
        let text = wish.labels.iter().find(|text| self.width(text) <= room)?;
        if text.is_empty() {
            return Some(Place::Nothing);
        }
        // The left border takes its own column where places are whole.
        let spare = room - self.width(text);
        let x = self.snap(wish.x0 + self.pad + spare / 2.0 + if self.whole { 0.5 } else { 0.0 });
        Some(Place::Inside {
            text: text.clone(),
            x,
        })
    }

    /// Inside where that fits, else below.
    pub(super) fn below(&self, wishes: &[Wish]) -> (Vec<Place>, usize) {
        let mut places: Vec<Place> = vec![Place::Nothing; wishes.len()];
        let mut taken: Vec<Hung> = Vec::new();
        for (index, wish) in wishes.iter().enumerate().rev() {
            places[index] = match self.inside(wish) {
                Some(place) => place,
                None if wish.labels.is_empty() => Place::Nothing,
                None => self.hang(wish, &mut taken),
            };
        }
        let levels = taken.iter().map(|hung| hung.level + 1).max().unwrap_or(0);
        (places, levels)
    }

    fn hang(&self, wish: &Wish, taken: &mut Vec<Hung>) -> Place {
        let leader = self.snap((wish.x0 + wish.x1) / 2.0);
        let levels = taken.iter().map(|hung| hung.level + 2).max().unwrap_or(1);
        for text in wish.labels.iter().filter(|text| !text.is_empty()) {
            let width = self.width(text) + 2.0 * self.char;
            for level in 0..levels.min(MOST_LEVELS) {
                for x0 in [leader, leader + self.char - width] {
                    let hung = Hung {
                        leader,
                        level,
                        x0,
                        x1: x0 + width,
                    };
                    let fits = x0 >= self.left && hung.x1 <= self.right;
                    if !fits || taken.iter().any(|other| hung.crosses(other, self.char)) {
                        continue;
                    }
                    let right = x0 == leader;
                    taken.push(hung);
                    return Place::Below {
                        text: text.clone(),
                        leader,
                        level,
                        x: if right { x0 + 2.0 * self.char } else { x0 },
                    };
                }
            }
        }
        wish.listed()
    }

    /// Inside where that fits, else on the right, else on the left, on as few lines as do.
    pub(super) fn beside(&self, wishes: &[Wish]) -> (Vec<Place>, usize) {
        let mut taken: Vec<(usize, f64, f64)> = Vec::new();
        let places = wishes.iter().map(|wish| {
            let own = if wish.x1 > wish.x0 { wish.x1 } else { wish.x0 } + self.char;
            let place = self.beside_one(wish, own, &taken);
            match &place {
                Place::Beside { line, x, text } => {
                    let end = x + self.width(text);
                    taken.push((*line, x.min(wish.x0), end.max(own)));
                }
                Place::Under { line, .. } => {
                    taken.push((*line, self.left, self.right));
                    taken.push((line + 1, self.left, self.right));
                }
                // What has no room for words is marked all the same.
                _ => taken.push((0, wish.x0, own)),
            }
            place
        });
        let places: Vec<Place> = places.collect();
        let lines = taken.iter().map(|(line, ..)| line + 1).max().unwrap_or(0);
        (places, lines)
    }

    fn beside_one(&self, wish: &Wish, own: f64, taken: &[(usize, f64, f64)]) -> Place {
        let lines = taken.iter().map(|(line, ..)| line + 1).max().unwrap_or(0);
        for line in 0..=lines {
            for text in wish.labels.iter().filter(|text| !text.is_empty()) {
                let inside = match self.inside(&Wish {
                    labels: vec![text.clone()],
                    ..*wish
                }) {
                    Some(Place::Inside { x, .. }) => Some(x),
                    _ => None,
                };
                let right = own + self.char;
                let left = wish.x0 - self.char - self.width(text);
                for x in inside.into_iter().chain([right, left]) {
                    let (from, to) = (x.min(wish.x0), (x + self.width(text)).max(own));
                    let within = x >= self.left && x + self.width(text) <= self.right;
                    let free = taken
                        .iter()
                        .filter(|(other, ..)| *other == line)
                        .all(|(_, x0, x1)| to + self.char <= *x0 || from >= *x1 + self.char);
                    if within && free {
                        return Place::Beside {
                            text: text.clone(),
                            line,
                            x,
                        };
                    }
                }
            }
        }
        let room = self.right - self.left;
        let fits = |text: &&String| !text.is_empty() && self.width(text) <= room;
        if let Some(text) = wish.labels.iter().find(fits) {
            let x = wish.x0.min(self.right - self.width(text)).max(self.left);
            return Place::Under {
                text: text.clone(),
                line: lines,
                x,
            };
        }
        wish.listed()
    }
}

/// Words below a line that leads to them.
struct Hung {
    leader: f64,
    level: usize,
    x0: f64,
    x1: f64,
}

impl Hung {
    fn crosses(&self, other: &Hung, gap: f64) -> bool {
        let level = self.level == other.level;
        let overlap = self.x0 < other.x1 + gap && other.x0 < self.x1 + gap;
        let cuts = |above: &Hung, text: &Hung| {
            above.level >= text.level
                && above.leader + gap > text.x0
                && above.leader < text.x1 + gap / 2.0
        };
        level && overlap || cuts(self, other) || cuts(other, self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLUMNS: Measure = Measure {
        char: 1.0,
        pad: 0.5,
        left: 0.0,
        right: 40.0,
        whole: true,
    };

    fn wish(x0: f64, x1: f64, labels: &[&str]) -> Wish {
        let labels = labels.iter().map(|label| (*label).to_owned()).collect();
        Wish { x0, x1, labels }
    }

    fn below(text: &str, leader: f64, level: usize, x: f64) -> Place {
        let text = text.to_owned();
        Place::Below {
            text,
            leader,
            level,
            x,
        }
    }

    #[test]
    fn what_fits_stands_inside_and_the_rest_hangs_below_in_steps() {
        let wishes = [
            wish(0.0, 4.0, &["start"]),
            wish(4.0, 8.0, &["CDS = 0", "CDS"]),
            wish(8.0, 12.0, &["stop"]),
        ];
        let inside = Place::Inside {
            text: "CDS".into(),
            x: 5.0,
        };
        let (places, levels) = COLUMNS.below(&wishes);
        let want = [
            below("start", 2.0, 0, 4.0),
            inside,
            below("stop", 10.0, 0, 12.0),
        ];
        assert_eq!((&places[..], levels), (&want[..], 1));
        // Where the line of one would cut the words of another, they go below it.
        let wishes = [wish(0.0, 4.0, &["start"]), wish(4.0, 8.0, &["CDS = 0"])];
        let (places, levels) = COLUMNS.below(&wishes);
        let want = [below("start", 2.0, 1, 4.0), below("CDS = 0", 6.0, 0, 8.0)];
        assert_eq!((&places[..], levels), (&want[..], 2));
        // At the right end they stand on the left of their line.
        let (places, _) = COLUMNS.below(&[wish(36.0, 40.0, &["stop"])]);
        assert_eq!(places, [below("stop", 38.0, 0, 33.0)]);
    }

    #[test]
    fn what_stands_alone_has_its_words_inside_beside_or_under_it() {
        let wishes = [
            wish(0.0, 10.0, &["20 us"]),
            wish(14.0, 15.0, &["112 ns"]),
            wish(30.0, 36.0, &["timeout 20 us"]),
            wish(
                20.0,
                22.0,
                &["words that take more than the half of a line"],
            ),
        ];
        let (places, lines) = COLUMNS.beside(&wishes);
        let beside = |text: &str, line, x| Place::Beside {
            text: text.into(),
            line,
            x,
        };
        assert_eq!(places[0], beside("20 us", 0, 3.0));
        assert_eq!(places[1], beside("112 ns", 0, 17.0));
        assert_eq!(places[2], beside("timeout 20 us", 1, 16.0));
        assert!(matches!(&places[3], Place::Listed { .. }), "{places:?}");
        assert_eq!(lines, 2);
        let (places, lines) =
            COLUMNS.beside(&[wish(20.0, 22.0, &["more than the half of all columns"])]);
        assert!(
            matches!(
                places[..],
                [Place::Under {
                    line: 0,
                    x: 7.0,
                    ..
                }]
            ),
            "{places:?}"
        );
        assert_eq!(lines, 2);
    }

    #[test]
    fn nothing_covers_anything() {
        let seed = fastrand::u64(..);
        println!("seed {seed}");
        let mut rng = fastrand::Rng::with_seed(seed);
        for _ in 0..2_000 {
            let mut x = 0.0;
            let mut wishes = Vec::new();
            while x < 38.0 {
                let end = x + f64::from(rng.u8(1..8));
                wishes.push(wish(x, end, &["0123456789"[..rng.usize(1..10)].as_ref()]));
                x = end;
            }
            let measure = Measure {
                right: x,
                ..COLUMNS
            };
            let (places, levels) = measure.below(&wishes);
            let mut drawn = vec![vec![false; 64]; levels];
            for place in &places {
                let Place::Below {
                    text,
                    leader,
                    level,
                    x,
                } = place
                else {
                    continue;
                };
                let mut take = |level: usize, column: f64| {
                    let cell = &mut drawn[level][column as usize];
                    assert!(!std::mem::replace(cell, true), "{places:?}");
                };
                (0..=*level).for_each(|level| take(level, *leader));
                (0..text.len()).for_each(|at| take(*level, x + at as f64));
            }
        }
    }
}
