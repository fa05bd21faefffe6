//! Time as it is drawn: in clocks, with long rests and rows of clocks without news cut short.

/// Where each time stands, in clocks of MA. It never goes back.
#[derive(Clone, Debug)]
pub struct Axis {
    /// Time and place, both growing; between two of them time is even.
    knots: Vec<(u64, f64)>,
    cuts: Vec<Cut>,
    period_ns: f64,
}

/// A stretch that is drawn shorter than it was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cut {
    /// From here.
    pub from_ns: u64,
    /// To here.
    pub until_ns: u64,
    /// There were clocks in it.
    pub clocks: bool,
}

/// Where nothing moves for longer than this many clocks ...
const REST_CLOCKS: f64 = 5.0;
/// ... it is drawn like this many, and clocks that say nothing like the other.
const REST_DRAWN: f64 = 4.0;
const CLOCKS_DRAWN: f64 = 3.0;

impl Axis {
    /// For these times, in order; each of `dull` is a stretch of clocks that say nothing.
    pub(super) fn new(times: &[u64], dull: &[(u64, u64)], period_ns: u64) -> Axis {
        let mut axis = Axis {
            knots: Vec::with_capacity(times.len()),
            cuts: Vec::new(),
            period_ns: period_ns.max(1) as f64,
        };
        let mut dull = dull.iter().peekable();
        let mut place = 0.0;
        let mut last: Option<u64> = None;
        for t_ns in times.iter().copied() {
            let Some(before) = last else {
                axis.knots.push((t_ns, place));
                last = Some(t_ns);
                continue;
            };
            while dull.next_if(|(_, until)| *until <= before).is_some() {}
            if let Some((from_ns, until_ns)) = dull.peek().copied() {
                if before >= *from_ns && t_ns < *until_ns {
                    continue;
                }
                if before >= *from_ns && t_ns == *until_ns {
                    place += CLOCKS_DRAWN;
                    axis.cut(before, t_ns, true);
                    axis.knots.push((t_ns, place));
                    last = Some(t_ns);
                    continue;
                }
            }
            if t_ns == before {
                continue;
            }
            let clocks = (t_ns - before) as f64 / axis.period_ns;
            if clocks > REST_CLOCKS {
                place += REST_DRAWN;
                axis.cut(before, t_ns, false);
            } else {
                place += clocks;
            }
            axis.knots.push((t_ns, place));
            last = Some(t_ns);
        }
        axis
    }

    fn cut(&mut self, from_ns: u64, until_ns: u64, clocks: bool) {
        self.cuts.push(Cut {
            from_ns,
            until_ns,
            clocks,
        });
    }

    /// The place of a time.
    pub fn at(&self, t_ns: u64) -> f64 {
        let behind = self.knots.partition_point(|(knot, _)| *knot <= t_ns);
        let part = |from: u64| (t_ns.abs_diff(from)) as f64 / self.period_ns;
        match (
            behind.checked_sub(1).map(|at| self.knots[at]),
            self.knots.get(behind),
        ) {
            (Some((from, low)), Some((until, high))) => {
                low + (high - low) * ((t_ns - from) as f64 / (until - from) as f64)
            }
            (Some((from, low)), None) => low + part(from),
            (None, Some((until, high))) => high - part(*until),
            (None, None) => 0.0,
        }
    }

    /// What is drawn shorter than it was.
    pub fn cuts(&self) -> &[Cut] {
        &self.cuts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rests_and_dull_clocks_are_short_and_all_else_is_to_scale() {
        let times: Vec<u64> = (0..=40).map(|clock| clock * 1000).chain([90_000]).collect();
        let axis = Axis::new(&times, &[(10_000, 30_000)], 1000);
        assert_eq!(axis.at(5_500), 5.5);
        assert_eq!(axis.at(10_000), 10.0);
        assert_eq!(axis.at(20_000), 11.5);
        assert_eq!(axis.at(30_000), 13.0);
        assert_eq!(axis.at(40_000), 23.0);
        assert_eq!(axis.at(90_000), 27.0);
        assert_eq!(axis.at(91_000), 28.0);
        let cuts: Vec<bool> = axis.cuts().iter().map(|cut| cut.clocks).collect();
        assert_eq!(cuts, [true, false]);
    }
}
